/* Goal: quantised cones never lose a normal, and parents enclose children as decoded.
 * Method: random and extreme cones, compared with their exact originals in double; merging also
 * with the same computed plainly, every angle by atan2, bit for bit. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "block.h"
#include "suite.h"

static uint64_t state;
static double chance(void) { /* [0, 1) */
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 11) / 9007199254740992.0;
}

static void random_axis(float axis[3]) {
    double length;
    do {
        length = 0;
        for (int i = 0; i < 3; i++) {
            axis[i] = (float)(2 * chance() - 1);
            length += (double)axis[i] * axis[i];
        }
    } while (length > 1 || length < 1e-4);
}

static double angle(const float a[3], const float b[3]) {
    double dot = 0, aa = 0, bb = 0;
    for (int i = 0; i < 3; i++) {
        dot += (double)a[i] * b[i];
        aa += (double)a[i] * a[i];
        bb += (double)b[i] * b[i];
    }
    double cosine = dot / sqrt(aa * bb);
    return acos(cosine > 1 ? 1 : cosine < -1 ? -1 : cosine);
}

static void seed(void) {
    const char *given = getenv("MN_SEED");
    state = given != NULL ? strtoull(given, NULL, 10) : 1;
    printf("seed %llu\n", (unsigned long long)state);
}

/* The square of codes is the octahedron |x| + |y| + |z| = 1 unfolded, each eighth of it a face,
 * laid out without a cut inside. Rounding moves a point by half a step at most in x and in y, so on
 * its face, or over an edge onto the next, along a path of at most sqrt(hh + hh + 4hh) = sqrt(6) h,
 * where h = 1 / (2 MN_CONE_AXIS). Faces are 1 / sqrt(3) from the origin, and what is as far away as
 * that at least is seen under no more than its length over that distance: sqrt(18) h. */
static const double axis_error_max = 4.242640687119285 / (2 * MN_CONE_AXIS);

START_TEST(made_cones_enclose) {
    for (int round = 0; round < 20000; round++) {
        float axis[3], decoded[3];
        random_axis(axis);
        float half = (float)(chance() * (round % 2 == 0 ? 0.01 : 1.5));
        mn_cone cone = mn_cone_make(axis, half);
        if (cone.angle == MN_CONE_NO_BOUND)
            continue;
        mn_cone_axis(cone, decoded);
        double need = angle(axis, decoded) + half, have = mn_cone_half_angle(cone);
        ck_assert_double_le(need, have + 1e-6);
        ck_assert_double_le(have, need + 0.0062); /* and is not wasteful: a step */
        ck_assert_double_le(angle(axis, decoded), axis_error_max + 1e-6);
    }
}
END_TEST

/* In the middle of a face, half a step off in x and in y: nowhere is the axis moved by more. */
START_TEST(an_axis_moves_no_more_than_that) {
    for (int face = 0; face < 8; face++) {
        float axis[3] = {42.5f, 42.5f, MN_CONE_AXIS - 85.0f}, decoded[3];
        for (int i = 0; i < 3; i++)
            axis[i] *= (face >> i & 1) != 0 ? -1.0f : 1.0f;
        mn_cone_axis(mn_cone_make(axis, 0), decoded);
        const double moved = angle(axis, decoded);
        ck_assert_double_le(moved, axis_error_max + 1e-6);
        ck_assert_double_ge(moved, 0.99 * axis_error_max);
    }
}
END_TEST

START_TEST(merged_cones_enclose_both) {
    for (int round = 0; round < 20000; round++) {
        float axis[3];
        random_axis(axis);
        mn_cone a = mn_cone_make(axis, (float)chance());
        if (round % 3 == 0)
            for (int i = 0; i < 3; i++) /* opposite, or nearly the same */
                axis[i] = (round % 2 == 0 ? -1.0f : 1.0f) * axis[i] + 1e-5f * (float)chance();
        else
            random_axis(axis);
        mn_cone b = mn_cone_make(axis, (float)chance());
        mn_cone both = mn_cone_merge(a, b);
        ck_assert(mni_cone_encloses(both, a, 0));
        ck_assert(mni_cone_encloses(both, b, 0));
        mn_cone again = mn_cone_merge(both, a); /* nothing is added by what is inside */
        ck_assert(again.angle == both.angle && again.axis[0] == both.axis[0] &&
                  again.axis[1] == both.axis[1]);
    }
}
END_TEST

/* ---- as it is defined ----------------------------------------------------------------------- */

#define UNIT_RAD (3.14159265358979323846 / 2 / MN_CONE_NO_BOUND)

static void plain_decode(mn_cone cone, double axis[3]) {
    double x = cone.axis[0] / (double)MN_CONE_AXIS, y = cone.axis[1] / (double)MN_CONE_AXIS,
           z = 1 - fabs(x) - fabs(y);
    if (z < 0) {
        double folded = (1 - fabs(y)) * (x >= 0 ? 1 : -1);
        y = (1 - fabs(x)) * (y >= 0 ? 1 : -1);
        x = folded;
    }
    double length = sqrt(x * x + y * y + z * z);
    axis[0] = x / length, axis[1] = y / length, axis[2] = z / length;
}

static mn_cone plain_encode(const double axis[3]) {
    double sum = fabs(axis[0]) + fabs(axis[1]) + fabs(axis[2]);
    double x = axis[0] / sum, y = axis[1] / sum;
    if (axis[2] < 0) {
        double folded = (1 - fabs(y)) * (x >= 0 ? 1 : -1);
        y = (1 - fabs(x)) * (y >= 0 ? 1 : -1);
        x = folded;
    }
    return (mn_cone){{(int8_t)lrint(x * MN_CONE_AXIS), (int8_t)lrint(y * MN_CONE_AXIS)}, 0};
}

static double plain_angle(const double u[3], const double v[3]) {
    double c[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    return atan2(sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]),
                 u[0] * v[0] + u[1] * v[1] + u[2] * v[2]);
}

static bool plain_encloses(mn_cone outer, mn_cone inner) {
    double u[3], v[3];
    plain_decode(outer, u);
    plain_decode(inner, v);
    return outer.angle == MN_CONE_NO_BOUND ||
           plain_angle(u, v) + inner.angle * UNIT_RAD <= outer.angle * UNIT_RAD;
}

static void plain_turn(const double u[3], const double v[3], double by, double out[3]) {
    double along = u[0] * v[0] + u[1] * v[1] + u[2] * v[2], w[3];
    for (int i = 0; i < 3; i++)
        w[i] = v[i] - along * u[i];
    double length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    if (length < 1e-9) {
        int least = fabs(u[0]) < fabs(u[1]) ? 0 : 1;
        least = fabs(u[2]) < fabs(u[least]) ? 2 : least;
        for (int i = 0; i < 3; i++)
            w[i] = (i == least) - u[least] * u[i];
        length = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    }
    for (int i = 0; i < 3; i++)
        out[i] = cos(by) * u[i] + sin(by) * w[i] / length;
}

static mn_cone plain_merge(mn_cone a, mn_cone b) {
    const mn_cone everything = {{0, 0}, MN_CONE_NO_BOUND};
    if (a.angle == MN_CONE_NO_BOUND || b.angle == MN_CONE_NO_BOUND)
        return everything;
    if (plain_encloses(a, b) || plain_encloses(b, a))
        return plain_encloses(a, b) ? a : b;
    double u[3], v[3], axis[3], alpha = a.angle * UNIT_RAD, beta = b.angle * UNIT_RAD;
    plain_decode(a, u);
    plain_decode(b, v);
    double half = (plain_angle(u, v) + alpha + beta) / 2;
    if (half >= 3.14159265358979323846)
        return everything;
    plain_turn(u, v, half - alpha, axis);
    mn_cone cone = plain_encode(axis);
    plain_decode(cone, axis);
    double units = ceil(fmax(plain_angle(axis, u) + alpha, plain_angle(axis, v) + beta) / UNIT_RAD);
    if (units >= MN_CONE_NO_BOUND)
        return everything;
    for (cone.angle = (uint8_t)units; !(plain_encloses(cone, a) && plain_encloses(cone, b));)
        cone.angle++;
    return cone.angle == MN_CONE_NO_BOUND ? everything : cone;
}

/* Any codes, near ones, opposite ones; narrow ones and wide ones. */
static void random_pair(int round, mn_cone *a, mn_cone *b) {
    const double widest = round % 2 == 0 ? 254 : 12;
    *a = (mn_cone){{(int8_t)(255 * chance() - 127), (int8_t)(255 * chance() - 127)},
                   (uint8_t)(widest * chance())};
    *b = (mn_cone){{(int8_t)(255 * chance() - 127), (int8_t)(255 * chance() - 127)},
                   (uint8_t)(widest * chance())};
    const int near = round % 5;
    for (int i = 0; i < 2 && near < 3; i++) {
        const int at = (near == 2 ? -1 : 1) * a->axis[i] + (int)(near * (3 * chance() - 1));
        b->axis[i] = (int8_t)(at < -127 ? -127 : at > 127 ? 127 : at);
    }
}

START_TEST(merged_as_defined) {
    for (int round = 0; round < 400000; round++) {
        mn_cone a, b;
        random_pair(round, &a, &b);
        const mn_cone is = mn_cone_merge(a, b), should = plain_merge(a, b);
        ck_assert_msg(is.axis[0] == should.axis[0] && is.axis[1] == should.axis[1] &&
                          is.angle == should.angle,
                      "(%d %d) %d and (%d %d) %d: (%d %d) %d instead of (%d %d) %d", a.axis[0],
                      a.axis[1], a.angle, b.axis[0], b.axis[1], b.angle, is.axis[0], is.axis[1],
                      is.angle, should.axis[0], should.axis[1], should.angle);
        ck_assert(mni_cone_encloses(a, b, 0) == plain_encloses(a, b));
    }
}
END_TEST

START_TEST(no_bound_is_kept) {
    float zero[3] = {0, 0, 0}, up[3] = {0, 1, 0}, bad[3] = {NAN, 0, 0};
    ck_assert_uint_eq(mn_cone_make(zero, 0.1f).angle, MN_CONE_NO_BOUND);
    ck_assert_uint_eq(mn_cone_make(bad, 0.1f).angle, MN_CONE_NO_BOUND);
    ck_assert_uint_eq(mn_cone_make(up, NAN).angle, MN_CONE_NO_BOUND);
    ck_assert_uint_eq(mn_cone_make(up, 1.571f).angle, MN_CONE_NO_BOUND);
    ck_assert_uint_eq(mn_cone_merge(mn_cone_make(zero, 0), mn_cone_make(up, 0)).angle,
                      MN_CONE_NO_BOUND);
    ck_assert_float_eq_tol(mn_cone_half_angle(mn_cone_make(zero, 0)), 3.14159265f, 1e-6f);
}
END_TEST

START_TEST(any_code_decodes_to_a_unit_axis) {
    for (int x = -128; x <= 127; x++)
        for (int y = -128; y <= 127; y++) {
            float axis[3];
            mn_cone_axis((mn_cone){{(int8_t)x, (int8_t)y}, 0}, axis);
            float square = axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2];
            ck_assert_float_eq_tol(square, 1, 1e-5f);
        }
}
END_TEST

int main(void) {
    Suite *s = suite_create("cone");
    TCase *t = tcase_create("cone");
    tcase_add_unchecked_fixture(t, seed, NULL);
    tcase_add_test(t, made_cones_enclose);
    tcase_add_test(t, an_axis_moves_no_more_than_that);
    tcase_add_test(t, merged_cones_enclose_both);
    tcase_add_test(t, merged_as_defined);
    tcase_add_test(t, no_bound_is_kept);
    tcase_add_test(t, any_code_decodes_to_a_unit_axis);
    suite_add_tcase(s, t);
    return suite_run(s);
}
