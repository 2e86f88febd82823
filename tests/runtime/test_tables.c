/* Goal: the tables behind the store: map, ancestor table, failures, blocks that are sought.
 * Method: random operations against plain arrays, at full load; limits by hand. */
#include <check.h>
#include <stdlib.h>

#include "ancestors.h"
#include "failures.h"
#include "sought.h"
#include "suite.h"
#include "walk.h"

START_TEST(map_against_array) {
    enum { MAX = 50, KEYS = 200 };
    uint64_t seed = seed_of_test(1);
    mni_arena arena;
    mni_hashmap map;
    uint32_t value[KEYS + 1];
    ck_assert_int_eq(mni_arena_open(&arena, mni_hashmap_need(MAX), NULL), MN_OK);
    mni_hashmap_open(&map, MAX, &arena);
    for (uint32_t key = 0; key <= KEYS; key++)
        value[key] = MNI_HASHMAP_NONE;
    for (uint64_t step = 0; step < 100000; step++) {
        uint32_t key = 1 + (uint32_t)(mix(seed, step) % KEYS);
        if (value[key] != MNI_HASHMAP_NONE) {
            mni_hashmap_remove(&map, key);
            value[key] = MNI_HASHMAP_NONE;
        } else if (map.count < MAX) {
            value[key] = (uint32_t)step;
            mni_hashmap_put(&map, key, value[key]);
        }
        uint32_t look = (uint32_t)(mix(seed, ~step) % (KEYS + 1));
        ck_assert_uint_eq(mni_hashmap_find(&map, look), value[look]);
    }
    for (uint32_t key = 0; key <= KEYS; key++)
        ck_assert_uint_eq(mni_hashmap_find(&map, key), value[key]);
    mni_arena_close(&arena);
}
END_TEST

/* What is known of a block is what was put last, or nothing. */
START_TEST(sought_forgets_and_does_not_invent) {
    enum { K = 40, KEYS = 500 };
    uint64_t seed = seed_of_test(2);
    mni_arena arena;
    mni_sought sought;
    uint32_t parent[KEYS + 1] = {0}, known = 0;
    ck_assert_int_eq(mni_arena_open(&arena, mni_sought_need(K), NULL), MN_OK);
    mni_sought_open(&sought, K, &arena);
    ck_assert_ptr_null(mni_sought_find(&sought, 0)); /* no block, though empty records say so */
    for (uint64_t step = 0; step < 20000; step++) {
        const uint32_t id = 1 + (uint32_t)(mix(seed, step) % KEYS);
        parent[id] = (uint32_t)step + 1;
        mni_sought_put(&sought, (mn_block_ref){.id = id, .pages = id % 3 + 1}, parent[id]);
        const uint32_t look = 1 + (uint32_t)(mix(seed, ~step) % KEYS);
        const mni_seek *found = mni_sought_find(&sought, look);
        ck_assert_ptr_nonnull(mni_sought_find(&sought, id));
        if (found == NULL)
            continue;
        known++;
        ck_assert(found->ref.id == look && found->ref.pages == look % 3 + 1);
        ck_assert_uint_eq(found->parent_id, parent[look]);
    }
    ck_assert_uint_gt(known, 20000 * MNI_SOUGHT_TIMES * K / KEYS / 2);
    mni_arena_close(&arena);
}
END_TEST

/* Entries go when neither they nor anything below them is in use, a whole branch at once. */
START_TEST(branches_of_ancestors) {
    enum { MAX = 6 };
    mni_arena arena;
    mni_ancestors table;
    ck_assert_int_eq(mni_arena_open(&arena, mni_ancestors_need(MAX), NULL), MN_OK);
    mni_ancestors_open(&table, MAX, &arena);
    for (int round = 0; round < 3; round++) {
        mni_entry chain[MAX];
        for (uint32_t i = 0; i < MAX; i++)
            chain[i] = mni_ancestors_enter(&table, (mn_block_ref){.id = 10 + i, .pages = 1},
                                           i > 0 ? chain[i - 1] : MNI_NO_ENTRY, "bytes");
        ck_assert_uint_eq(table.count, MAX);
        ck_assert_uint_eq(mni_ancestors_parent_id(&table, chain[3]), 12);
        ck_assert_uint_eq(mni_ancestors_parent_id(&table, chain[0]), 0);
        for (uint32_t i = 0; i + 1 < MAX; i++)
            ck_assert(mni_ancestors_lower(&table, chain[i]));
        ck_assert_uint_eq(table.count, MAX); /* ancestors of what is in use */
        ck_assert_uint_eq(table.in_use, 1);
        mni_ancestors_check(&table);
        ck_assert_uint_eq(
            mni_ancestors_enter(&table, (mn_block_ref){.id = 12, .pages = 1}, chain[1], "bytes"),
            chain[2]);
        ck_assert(mni_ancestors_lower(&table, chain[MAX - 1]));
        ck_assert_uint_eq(table.count, 3); /* down to the one in use */
        mni_ancestors_check(&table);
        ck_assert(mni_ancestors_lower(&table, chain[2]));
        ck_assert_uint_eq(table.count, 0);
        ck_assert_uint_eq(mni_ancestors_find(&table, 10), MNI_NO_ENTRY);
    }
    mni_arena_close(&arena);
}
END_TEST

START_TEST(failures_wait_longer_and_longer) {
    static const uint64_t waits[] = {1, 2, 4, 8, 16, 32, 64, 64, 64};
    mni_arena arena;
    mni_failures failures;
    ck_assert_int_eq(mni_arena_open(&arena, mni_failures_need(), NULL), MN_OK);
    mni_failures_open(&failures, &arena);
    uint64_t frame = 7;
    for (size_t i = 0; i < sizeof waits / sizeof *waits; i++) {
        ck_assert(mni_failures_due(&failures, 5, frame));
        ck_assert_int_eq(mni_failures_add(&failures, 5, frame), i == 0); /* reported once */
        ck_assert(!mni_failures_due(&failures, 5, frame + waits[i] - 1));
        frame += waits[i];
    }
    mni_failures_forget(&failures, 5);
    mni_failures_forget(&failures, 5);
    ck_assert(mni_failures_add(&failures, 5, frame)); /* anew */
    for (uint32_t id = 100; id < 100 + 2 * MNI_FAILURES_MAX; id++)
        ck_assert(mni_failures_add(&failures, id, frame));
    ck_assert(mni_failures_due(&failures, 5, frame)); /* forgotten for newer ones */
    ck_assert(!mni_failures_due(&failures, 100 + 2 * MNI_FAILURES_MAX - 1, frame));
    mni_arena_close(&arena);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("tables");
    TCase *tests = tcase_create("tables");
    tcase_add_test(tests, map_against_array);
    tcase_add_test(tests, sought_forgets_and_does_not_invent);
    tcase_add_test(tests, branches_of_ancestors);
    tcase_add_test(tests, failures_wait_longer_and_longer);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
