/* Goal: quantised cones never lose a normal, and parents enclose children as decoded.
 * Method: random and extreme cones, compared with their exact originals in double. */
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
        ck_assert_double_le(angle(axis, decoded), 0.016);
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
    tcase_add_test(t, merged_cones_enclose_both);
    tcase_add_test(t, no_bound_is_kept);
    tcase_add_test(t, any_code_decodes_to_a_unit_axis);
    suite_add_tcase(s, t);
    return suite_run(s);
}
