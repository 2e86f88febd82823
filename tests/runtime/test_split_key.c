/* Goal: larger errors have their turn first, by place those within half a doubling, and a key tells
 * an error that none with a later key exceeds. Method: errors over forty doublings, in pairs, at
 * random. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "dice.h"
#include "split_key.h"
#include "suite.h"

enum { PAIRS = 20000 };
#define TOLERANCE_PX 0.7

static double any_px(void) {
    return TOLERANCE_PX * pow(2, (double)uniform(400000) / 1e4);
}

START_TEST(by_error) {
    for (int i = 0; i < PAIRS; i++) {
        const double a = any_px(), b = any_px();
        const uint32_t key_a = mni_split_key(a), key_b = mni_split_key(b);
        ck_assert(a < b ? key_a >= key_b : key_a <= key_b);
        ck_assert_double_ge(mni_split_key_px(key_a), a);
        ck_assert_double_le(mni_split_key_px(key_a), 1.000001 * a);
    }
    ck_assert_uint_eq(mni_split_key(INFINITY), mni_split_key(1e30));
}
END_TEST

START_TEST(by_place) {
    for (int i = 0; i < PAIRS; i++) {
        const double a = any_px(), b = any_px();
        const uint32_t place_a = uniform(MNI_SPLIT_PLACES);
        const uint32_t place_b = uniform(MNI_SPLIT_PLACES);
        const uint32_t key_a = mni_split_key_by_place(a, TOLERANCE_PX, place_a);
        const uint32_t key_b = mni_split_key_by_place(b, TOLERANCE_PX, place_b);
        ck_assert_uint_eq(key_a % MNI_SPLIT_PLACES, place_a);
        if (a > 2 * b && b < 30000 * TOLERANCE_PX) /* above all are in one rank */
            ck_assert_uint_lt(key_a, key_b);
        if (key_b >= key_a)
            ck_assert_double_ge(mni_split_key_by_place_px(key_a, TOLERANCE_PX), b);
    }
    ck_assert(isinf(mni_split_key_by_place_px(0, TOLERANCE_PX)));
}
END_TEST

int main(void) {
    const char *seed = getenv("MN_SEED");
    random_state = seed != NULL ? strtoull(seed, NULL, 10) : 1;
    printf("seed %llu\n", (unsigned long long)random_state);
    Suite *suite = suite_create("split_key");
    TCase *tests = tcase_create("split_key");
    tcase_add_test(tests, by_error);
    tcase_add_test(tests, by_place);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
