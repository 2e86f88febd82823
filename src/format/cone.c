/* What decides about a node, in few bits, rounded outwards: normal cones in 24, lengths.
 *
 * Hides: the octahedral code, how many bits of a length are kept, and by how much rounding widens a
 * cone. Order of calls: none, pure functions, any thread, no memory. What is compared is always
 * decoded cones, so a cone that was made or merged here encloses what it was made from exactly as
 * readers will see it. Paper: §3.1 (normal cones decide about silhouettes and back faces). */
#include "metanode/format.h"

#include <math.h>

#include "block_layout.h"

#define UNITS ((double)MN_CONE_AXIS) /* of an axis coordinate */
#define PI 3.14159265358979323846
#define ANGLE_UNIT (PI / 2 / MN_CONE_NO_BOUND)

static void decode(const int8_t code[2], double axis[3]) {
    double x = code[0] / UNITS, y = code[1] / UNITS;
    double z = 1 - fabs(x) - fabs(y);
    if (z < 0) { /* the lower half is folded outwards over the diagonals */
        double folded = (1 - fabs(y)) * (x >= 0 ? 1 : -1);
        y = (1 - fabs(x)) * (y >= 0 ? 1 : -1);
        x = folded;
    }
    double length = sqrt(x * x + y * y + z * z);
    axis[0] = x / length;
    axis[1] = y / length;
    axis[2] = z / length;
}

static void encode(const double axis[3], int8_t code[2]) {
    double sum = fabs(axis[0]) + fabs(axis[1]) + fabs(axis[2]);
    double x = axis[0] / sum, y = axis[1] / sum;
    if (axis[2] < 0) {
        double folded = (1 - fabs(y)) * (x >= 0 ? 1 : -1);
        y = (1 - fabs(x)) * (y >= 0 ? 1 : -1);
        x = folded;
    }
    code[0] = (int8_t)lrint(x * UNITS);
    code[1] = (int8_t)lrint(y * UNITS);
}

/* Of unit vectors; exact near 0 and pi, where acos is not. */
static double angle_between(const double u[3], const double v[3]) {
    double c[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    return atan2(sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]),
                 u[0] * v[0] + u[1] * v[1] + u[2] * v[2]);
}

static double half_angle(uint8_t units) {
    return units == MN_CONE_NO_BOUND ? PI : units * ANGLE_UNIT;
}

static uint8_t angle_up(double angle) {
    double units = ceil(angle / ANGLE_UNIT);
    return units >= 0 && units < MN_CONE_NO_BOUND ? (uint8_t)units : (uint8_t)MN_CONE_NO_BOUND;
}

bool mni_cone_encloses(mn_cone outer, mn_cone inner, double slack_rad) {
    if (outer.angle == MN_CONE_NO_BOUND)
        return true;
    double u[3], v[3];
    decode(outer.axis, u);
    decode(inner.axis, v);
    return angle_between(u, v) + half_angle(inner.angle) <= half_angle(outer.angle) + slack_rad;
}

mn_cone mn_cone_make(const float axis[3], float half_angle_rad) {
    const mn_cone everything = {{0, 0}, MN_CONE_NO_BOUND};
    double u[3] = {axis[0], axis[1], axis[2]};
    double length = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    if (!(length > 0) || !isfinite(length) || !(half_angle_rad >= 0))
        return everything;
    for (int i = 0; i < 3; i++)
        u[i] /= length;
    mn_cone cone;
    encode(u, cone.axis);
    double v[3];
    decode(cone.axis, v);
    cone.angle = angle_up(half_angle_rad + angle_between(u, v));
    return cone.angle == MN_CONE_NO_BOUND ? everything : cone;
}

void mn_cone_axis(mn_cone cone, float axis[3]) {
    double u[3];
    decode(cone.axis, u);
    for (int i = 0; i < 3; i++)
        axis[i] = (float)u[i];
}

float mn_cone_half_angle(mn_cone cone) {
    return (float)half_angle(cone.angle);
}

/* u turned towards v by that angle, in the plane of both; for opposite axes in any plane. */
static void turn(const double u[3], const double v[3], double angle, double out[3]) {
    double along = u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    double w[3], length = 0;
    for (int i = 0; i < 3; i++)
        w[i] = v[i] - along * u[i];
    length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    if (length < 1e-9) {
        int least = fabs(u[0]) < fabs(u[1]) ? 0 : 1;
        if (fabs(u[2]) < fabs(u[least]))
            least = 2;
        for (int i = 0; i < 3; i++)
            w[i] = (i == least) - u[least] * u[i];
        length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    }
    for (int i = 0; i < 3; i++)
        out[i] = cos(angle) * u[i] + sin(angle) * w[i] / length;
}

mn_cone mn_cone_merge(mn_cone a, mn_cone b) {
    const mn_cone everything = {{0, 0}, MN_CONE_NO_BOUND};
    if (a.angle == MN_CONE_NO_BOUND || b.angle == MN_CONE_NO_BOUND)
        return everything;
    if (mni_cone_encloses(a, b, 0))
        return a;
    if (mni_cone_encloses(b, a, 0))
        return b;
    double u[3], v[3], axis[3];
    decode(a.axis, u);
    decode(b.axis, v);
    double alpha = half_angle(a.angle), beta = half_angle(b.angle);
    double half = (angle_between(u, v) + alpha + beta) / 2;
    if (half >= PI)
        return everything;
    turn(u, v, half - alpha, axis);
    mn_cone cone;
    encode(axis, cone.axis);
    decode(cone.axis, axis);
    double to_a = angle_between(axis, u) + alpha, to_b = angle_between(axis, v) + beta;
    cone.angle = angle_up(to_a > to_b ? to_a : to_b);
    while (cone.angle < MN_CONE_NO_BOUND &&
           !(mni_cone_encloses(cone, a, 0) && mni_cone_encloses(cone, b, 0)))
        cone.angle++; /* the last bit of the rounding */
    return cone.angle == MN_CONE_NO_BOUND ? everything : cone;
}

/* ---- lengths -------------------------------------------------------------------------------- */

static float float_up(float value, uint32_t shift) {
    uint32_t unit = 1u << shift;
    return mni_float_of((mni_float_bits(value) + unit - 1) & ~(unit - 1));
}

float mni_switch_up(float value) {
    return float_up(value, MNI_SWITCH_SHIFT);
}

float mni_radius_up(float value) {
    return float_up(value, MNI_RADIUS_SHIFT);
}

bool mni_grid_ok(float step) {
    int exponent;
    return step > 0 && isfinite(step) && frexpf(step, &exponent) == 0.5f;
}

float mn_grid_error(float grid_step) {
    return grid_step * 0.8660255f; /* half of the root of three, rounded up */
}
