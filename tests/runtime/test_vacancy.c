/* Goal: every number is given to one at a time, near its kin where there is room, and all can be
 * had. Method: random takes and gives against a list of who has what, for counts around whole
 * pages and whole words of pages. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dice.h"
#include "suite.h"
#include "vacancy.h"

enum { MAX = 70000 };
static const uint32_t sizes[] = {1, 2, 63, 64, 65, 511, 512, 513, 4096, 4160, 65537, MAX};
enum { SIZES = sizeof sizes / sizeof *sizes };

static mni_arena open_vacancy(mni_vacancy *v, uint32_t max) {
    mni_arena arena;
    mn_status st = {0};
    ck_assert_int_eq(mni_arena_open(&arena, mni_vacancy_need(max), &st), MN_OK);
    mni_vacancy_open(v, max, &arena);
    ck_assert_uint_eq(mni_vacancy_high(v), 0);
    return arena;
}

static uint32_t take(mni_vacancy *v, uint32_t near, bool *taken) {
    bool room = false;
    for (uint32_t i = near / 64 * 64; i < near / 64 * 64 + 64 && i < mni_vacancy_high(v); i++)
        room |= !taken[i];
    uint32_t number = mni_vacancy_take(v, near);
    ck_assert_uint_lt(number, mni_vacancy_high(v));
    ck_assert(!taken[number] && !mni_vacancy_is_free(v, number));
    ck_assert(!room || number / 64 == near / 64);
    taken[number] = true;
    return number;
}

static void give(mni_vacancy *v, uint32_t number, bool *taken) {
    taken[number] = false;
    mni_vacancy_give(v, number);
    ck_assert(mni_vacancy_is_free(v, number));
}

/* Fills up, gives back a random half, fills up again, and so on. */
START_TEST(all_can_be_had) {
    static bool taken[MAX];
    static uint32_t have[MAX];
    const uint32_t max = sizes[_i];
    uint32_t count = 0;
    mni_vacancy v;
    mni_arena arena = open_vacancy(&v, max);
    memset(taken, 0, sizeof taken);
    for (int round = 0; round < 6; round++) {
        for (; count < max; count++)
            have[count] = take(&v, count > 0 ? have[uniform(count)] : 0, taken);
        mni_vacancy_check(&v, max);
        ck_assert_uint_eq(mni_vacancy_high(&v), max);
        for (uint32_t left = max / (1 + uniform(5)); count > left; count--) {
            const uint32_t at = uniform(count);
            give(&v, have[at], taken);
            have[at] = have[count - 1];
        }
        mni_vacancy_check(&v, count);
    }
    mni_arena_close(&arena);
}
END_TEST

/* A count that stays small in room for many: pages that have emptied are used again. */
START_TEST(few_stay_together) {
    static bool taken[MAX];
    uint32_t have[200];
    mni_vacancy v;
    mni_arena arena = open_vacancy(&v, MAX);
    memset(taken, 0, sizeof taken);
    for (int round = 0; round < 500; round++) {
        for (int i = 0; i < 200; i++)
            have[i] = take(&v, i > 0 ? have[i - 1] : 0, taken);
        for (int i = 0; i < 200; i++)
            give(&v, have[i], taken);
    }
    mni_vacancy_check(&v, 0);
    ck_assert_uint_le(mni_vacancy_high(&v), 256);
    mni_arena_close(&arena);
}
END_TEST

/* Who comes gets the next place after its kin. */
START_TEST(next_to_kin) {
    bool taken[128] = {false};
    mni_vacancy v;
    mni_arena arena = open_vacancy(&v, 128);
    for (uint32_t i = 0; i < 64; i++)
        ck_assert_uint_eq(take(&v, i > 0 ? i - 1 : 0, taken), i);
    ck_assert_uint_eq(take(&v, 5, taken), 64);
    give(&v, 3, taken);
    give(&v, 40, taken);
    ck_assert_uint_eq(take(&v, 39, taken), 40);
    ck_assert_uint_eq(take(&v, 63, taken), 3);
    ck_assert_uint_eq(take(&v, 0, taken), 65);
    mni_arena_close(&arena);
}
END_TEST

int main(void) {
    const char *seed = getenv("MN_SEED");
    random_state = seed != NULL ? strtoull(seed, NULL, 10) : 20261122;
    printf("MN_SEED=%llu\n", (unsigned long long)random_state);
    Suite *suite = suite_create("vacancy");
    TCase *tc = tcase_create("vacancy");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, all_can_be_had, 0, SIZES);
    tcase_add_test(tc, few_stay_together);
    tcase_add_test(tc, next_to_kin);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
