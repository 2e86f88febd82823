/* What decides about a node, in few bits, rounded outwards: normal cones in 24, lengths.
 *
 * Hides: the octahedral code, how many bits of a length are kept, and by how much rounding widens a
 * cone; and that atan2 is asked only where a polynomial leaves open what a comparison or a rounding
 * comes to. Order of calls: none, pure functions, any thread, no memory. What is compared is always
 * decoded cones, so a cone that was made or merged here encloses what it was made from exactly as
 * readers will see it. Paper: §3.1 (normal cones decide about silhouettes and back faces). */
#include "metanode/format.h"

#include <math.h>

#include "block_layout.h"

#define UNITS ((double)MN_CONE_AXIS) /* of an axis coordinate */
#define PI 3.14159265358979323846
#define ANGLE_UNIT (PI / 2 / MN_CONE_NO_BOUND)
static const mn_cone everything = {{0, 0}, MN_CONE_NO_BOUND};

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

static void place_of(const double axis[3], double place[2]) {
    double sum = fabs(axis[0]) + fabs(axis[1]) + fabs(axis[2]);
    double x = axis[0] / sum, y = axis[1] / sum;
    if (axis[2] < 0) {
        double folded = (1 - fabs(y)) * (x >= 0 ? 1 : -1);
        y = (1 - fabs(x)) * (y >= 0 ? 1 : -1);
        x = folded;
    }
    place[0] = x;
    place[1] = y;
}

static void encode(const double axis[3], int8_t code[2]) {
    double place[2];
    place_of(axis, place);
    code[0] = (int8_t)lrint(place[0] * UNITS);
    code[1] = (int8_t)lrint(place[1] * UNITS);
}

/* Of unit vectors; exact near 0 and pi, where acos is not. */
static double angle_between(const double u[3], const double v[3]) {
    double c[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    return atan2(sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]),
                 u[0] * v[0] + u[1] * v[1] + u[2] * v[2]);
}

/* The same to ROUGH, and by far: Abramowitz and Stegun, 4.4.46, is right to 3e-8, and the cosine's
 * last bit is as much near 0 and pi. */
#define ROUGH 1e-6
static double rough_angle(const double u[3], const double v[3]) {
    static const double a[] = {1.5707963050, -0.2145988016, 0.0889789874, -0.0501743046,
                               0.0308918810, -0.0170881256, 0.0066700901, -0.0012624911};
    const double cosine = u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    const double x = fabs(cosine) < 1 ? fabs(cosine) : 1;
    double sum = 0;
    for (int i = (int)(sizeof a / sizeof a[0]); i-- > 0;)
        sum = sum * x + a[i];
    sum *= sqrt(1 - x);
    return cosine < 0 ? PI - sum : sum;
}

static double half_angle(uint8_t units) {
    return units == MN_CONE_NO_BOUND ? PI : units * ANGLE_UNIT;
}

static uint8_t angle_up(double angle) {
    double units = ceil(angle / ANGLE_UNIT);
    return units >= 0 && units < MN_CONE_NO_BOUND ? (uint8_t)units : (uint8_t)MN_CONE_NO_BOUND;
}

/* Of the decoded axes u and v, whose angle is roughly that. */
static bool encloses(const double u[3], const double v[3], double rough, double outer,
                     double inner) {
    const double more = outer - inner - rough;
    return fabs(more) > ROUGH ? more > 0 : angle_between(u, v) + inner <= outer;
}

bool mni_cone_encloses(mn_cone outer, mn_cone inner, double slack_rad) {
    if (outer.angle == MN_CONE_NO_BOUND)
        return true;
    double u[3], v[3];
    decode(outer.axis, u);
    decode(inner.axis, v);
    return encloses(u, v, rough_angle(u, v), half_angle(outer.angle) + slack_rad,
                    half_angle(inner.angle));
}

/* angle_up of something to ROUGH; false: it may be a unit more or less. */
static bool rough_angle_up(double angle, uint8_t *units) {
    *units = angle_up(angle + 2 * ROUGH);
    return *units == angle_up(angle - 2 * ROUGH);
}

mn_cone mn_cone_make(const float axis[3], float half_angle_rad) {
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
    if (!rough_angle_up(half_angle_rad + rough_angle(u, v), &cone.angle))
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

typedef struct decoded {
    double axis[3], half;
} decoded;

static decoded decoded_of(mn_cone cone) {
    decoded d = {.half = half_angle(cone.angle)};
    decode(cone.axis, d.axis);
    return d;
}

static mn_cone merge_exactly(mn_cone a, mn_cone b, const decoded *u, const decoded *v) {
    double half = (angle_between(u->axis, v->axis) + u->half + v->half) / 2, axis[3];
    if (half >= PI)
        return everything;
    turn(u->axis, v->axis, half - u->half, axis);
    mn_cone cone;
    encode(axis, cone.axis);
    decode(cone.axis, axis);
    double to_a = angle_between(axis, u->axis) + u->half,
           to_b = angle_between(axis, v->axis) + v->half;
    cone.angle = angle_up(to_a > to_b ? to_a : to_b);
    while (cone.angle < MN_CONE_NO_BOUND &&
           !(mni_cone_encloses(cone, a, 0) && mni_cone_encloses(cone, b, 0)))
        cone.angle++; /* the last bit of the rounding */
    return cone.angle == MN_CONE_NO_BOUND ? everything : cone;
}

/* The same, where it does not depend on what is a thousand times as near as a code's step: angles
 * are known to ROUGH. false: it may. */
static bool merge_roughly(const decoded *u, const decoded *v, double rough, mn_cone *cone) {
    const double far = 1e-3, half = (rough + u->half + v->half) / 2;
    double axis[3], place[2];
    if (half > PI - far || rough < far || rough > PI - far)
        return false;
    turn(u->axis, v->axis, half - u->half, axis);
    if (fabs(axis[0]) < far || fabs(axis[1]) < far || fabs(axis[2]) < far)
        return false; /* the code is folded there */
    place_of(axis, place);
    for (int i = 0; i < 2; i++) {
        const double step = place[i] * UNITS;
        if (fabs(step - floor(step) - 0.5) < far)
            return false;
        cone->axis[i] = (int8_t)lrint(step);
    }
    decode(cone->axis, axis);
    const double to_a = rough_angle(axis, u->axis) + u->half,
                 to_b = rough_angle(axis, v->axis) + v->half;
    if (!rough_angle_up(to_a > to_b ? to_a : to_b, &cone->angle))
        return false;
    if (cone->angle == MN_CONE_NO_BOUND)
        *cone = everything;
    return true;
}

mn_cone mn_cone_merge(mn_cone a, mn_cone b) {
    if (a.angle == MN_CONE_NO_BOUND || b.angle == MN_CONE_NO_BOUND)
        return everything;
    if (a.axis[0] == b.axis[0] && a.axis[1] == b.axis[1])
        return a.angle >= b.angle ? a : b;
    const decoded u = decoded_of(a), v = decoded_of(b);
    const double rough = rough_angle(u.axis, v.axis);
    if (encloses(u.axis, v.axis, rough, u.half, v.half))
        return a;
    if (encloses(v.axis, u.axis, rough, v.half, u.half))
        return b;
    mn_cone cone;
    return merge_roughly(&u, &v, rough, &cone) ? cone : merge_exactly(a, b, &u, &v);
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
