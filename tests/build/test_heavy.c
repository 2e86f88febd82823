/* Goal: whoever comes often is found, however many others come in between. Method: seeded streams
 * with a few heavy numbers, counted beside in full; orders that are worst; no more counters than
 * heavy numbers need. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>

#include "heavy.h"
#include "suite.h"

enum { NUMBERS = 5000, EVENTS = 200000 };

static uint64_t seed;

static uint32_t random_below(uint32_t limit) {
    uint64_t x = seed += UINT64_C(0x9e3779b97f4a7c15);
    x = (x ^ x >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ x >> 27) * UINT64_C(0x94d049bb133111eb);
    return (uint32_t)((x ^ x >> 31) % limit);
}

/* What is counted is never too much, and too little by the weight of all over the counters. */
static void check_counts(mni_heavy *h, const uint32_t *truth, uint64_t all, uint32_t counters) {
    mni_heavy_counter *taken;
    uint32_t counted[NUMBERS] = {0}, count = mni_heavy_take(h, 0, &taken);
    ck_assert_uint_le(count, counters);
    for (uint32_t i = 0; i < count; i++) {
        ck_assert_uint_eq(counted[taken[i].number], 0);
        counted[taken[i].number] = taken[i].count;
    }
    for (uint32_t n = 0; n < NUMBERS; n++) {
        ck_assert_uint_le(counted[n], truth[n]);
        ck_assert_uint_le(truth[n], counted[n] + all / (counters + 1));
    }
}

START_TEST(whoever_comes_often_is_counted) {
    static uint32_t truth[NUMBERS];
    uint64_t all = 0;
    const uint32_t counters = 1 + random_below(_i % 3 == 0 ? 3 : 200), heavy = 1 + random_below(20);
    mni_heavy h;
    ck_assert(mni_heavy_open(&h, counters));
    for (uint32_t n = 0; n < NUMBERS; n++)
        truth[n] = 0;
    for (uint32_t i = 0; i < EVENTS; i++) {
        bool is_heavy = random_below(3) == 0;
        uint32_t n = is_heavy ? random_below(heavy) * 7 % NUMBERS : i % NUMBERS;
        uint32_t weight = random_below(50) == 0 ? 1 + random_below(60) : 1;
        mni_heavy_add(&h, n, weight);
        truth[n] += weight;
        all += weight;
    }
    check_counts(&h, truth, all, counters);
    mni_heavy_close(&h);
}
END_TEST

START_TEST(only_more_than_the_least_is_taken) {
    mni_heavy h;
    mni_heavy_counter *taken;
    ck_assert(mni_heavy_open(&h, 100));
    for (uint32_t n = 0; n < 100; n++)
        mni_heavy_add(&h, n, n + 1);
    ck_assert_uint_eq(mni_heavy_take(&h, 0, &taken), 100);
    ck_assert_uint_eq(mni_heavy_take(&h, 99, &taken), 1);
    ck_assert(taken->number == 99 && taken->count == 100);
    ck_assert_uint_eq(mni_heavy_take(&h, 100, &taken), 0);
    mni_heavy_close(&h);
    mni_heavy_close(&h);
}
END_TEST

int main(void) {
    const char *text = getenv("MN_SEED");
    seed = text != NULL ? strtoull(text, NULL, 10) : 3;
    printf("MN_SEED=%llu\n", (unsigned long long)seed);
    fflush(stdout);
    Suite *suite = suite_create("heavy");
    TCase *tc = tcase_create("heavy");
    tcase_add_loop_test(tc, whoever_comes_often_is_counted, 0, 12);
    tcase_add_test(tc, only_more_than_the_least_is_taken);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
