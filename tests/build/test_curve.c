/* Goal: neighbours on the curve are neighbours in space, and each round has a curve of its own.
 * Method: all points of a grid in the order of their keys; the same key for the same place; keys of
 * random places against Skilling's program, which goes bit by bit. */
#include <check.h>
#include <stdlib.h>
#include <string.h>

#include "curve.h"
#include "suite.h"
#include "tree_fixture.h"

enum { SIDE = 16, POINTS = SIDE * SIDE * SIDE };

typedef struct point {
    uint64_t key;
    int at[3];
} point;

static int by_key(const void *a, const void *b) {
    uint64_t x = ((const point *)a)->key, y = ((const point *)b)->key;
    return (x > y) - (x < y);
}

/* Steps of more than one place along one axis, in the order of the keys. */
static int jumps(const mni_curve *curve, point *p) {
    int count = 0, n = 0;
    for (int x = 0; x < SIDE; x++)
        for (int y = 0; y < SIDE; y++)
            for (int z = 0; z < SIDE; z++, n++) {
                const float at[3] = {((float)x + 0.5f) / SIDE, ((float)y + 0.5f) / SIDE,
                                     ((float)z + 0.5f) / SIDE};
                p[n] = (point){mni_curve_key(curve, at), {x, y, z}};
            }
    qsort(p, POINTS, sizeof *p, by_key);
    for (int i = 1; i < POINTS; i++) {
        int steps = 0;
        for (int s = 0; s < 3; s++)
            steps += abs(p[i].at[s] - p[i - 1].at[s]);
        ck_assert(p[i].key != p[i - 1].key);
        count += steps != 1;
    }
    return count;
}

static const float low[3] = {0, 0, 0}, high[3] = {1, 1, 1};

START_TEST(one_step_at_a_time) {
    static point p[POINTS];
    mni_curve first = mni_curve_make(low, high, 0);
    ck_assert_int_eq(jumps(&first, p), 0);
}
END_TEST

/* Shifted, the box lies across several parts of the curve: a jump where it leaves one for another
 * outside of the box. */
START_TEST(each_round_its_own) {
    static point p[POINTS], before[POINTS];
    for (uint32_t round = 0; round < 12; round++) {
        mni_curve curve = mni_curve_make(low, high, round);
        ck_assert_int_lt(jumps(&curve, p), POINTS / 20);
        int same = 0;
        for (int i = 0; i < POINTS; i++)
            same += memcmp(p[i].at, before[i].at, sizeof p[i].at) == 0;
        ck_assert_int_lt(same, POINTS / 10);
        memcpy(before, p, sizeof p);
    }
}
END_TEST

START_TEST(boxes_without_width) {
    const float from[3] = {-3, 7, 1e-30f}, to[3] = {-3, 7, 1e-30f}, flat[3] = {5, 7, 1e-30f};
    mni_curve dot = mni_curve_make(from, to, 3), line = mni_curve_make(from, flat, 3);
    ck_assert_uint_eq(mni_curve_key(&dot, from), mni_curve_key(&dot, to));
    ck_assert_uint_ne(mni_curve_key(&line, from), mni_curve_key(&line, flat));
    ck_assert_uint_lt(mni_curve_key(&line, flat), UINT64_C(1) << 63);
}
END_TEST

/* As published, but for the order of the sides' bits in a key. */
static uint64_t skilling(const mni_curve *c, uint64_t place) {
    enum { BITS = MNI_CURVE_SIDE_BITS };
    uint32_t x[3], flip = 0;
    uint64_t key = 0;
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t side = (i + c->turn) % 3;
        x[i] = (uint32_t)(place >> side * MNI_PLACE_BITS) % (1u << MNI_PLACE_BITS) + c->shift[side];
    }
    for (uint32_t bit = 1u << (BITS - 1); bit > 1; bit /= 2)
        for (int i = 0; i < 3; i++) {
            uint32_t swap = x[i] & bit ? 0 : (x[0] ^ x[i]) & (bit - 1);
            x[0] ^= x[i] & bit ? bit - 1 : swap;
            x[i] ^= swap;
        }
    x[1] ^= x[0];
    x[2] ^= x[1];
    for (uint32_t bit = 1u << (BITS - 1); bit > 1; bit /= 2)
        flip ^= x[2] & bit ? bit - 1 : 0;
    for (int b = BITS - 1; b >= 0; b--)
        for (int i = 0; i < 3; i++)
            key = key << 1 | ((x[i] ^ flip) >> b & 1);
    return key;
}

START_TEST(keys_are_skillings) {
    uint64_t state = fixture_seed(65);
    for (uint32_t round = 0; round < 12; round++) {
        mni_curve curve = mni_curve_make(low, high, round);
        for (int i = 0; i < 5000; i++) {
            uint64_t place = ((uint64_t)fixture_random(&state) << 32 | fixture_random(&state)) >>
                             (64 - 3 * MNI_PLACE_BITS);
            ck_assert_uint_eq(mni_curve_place_key(&curve, place), skilling(&curve, place));
        }
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("curve");
    TCase *tc = tcase_create("curve");
    tcase_add_test(tc, one_step_at_a_time);
    tcase_add_test(tc, each_round_its_own);
    tcase_add_test(tc, boxes_without_width);
    tcase_add_test(tc, keys_are_skillings);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
