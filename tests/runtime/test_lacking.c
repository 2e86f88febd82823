/* Goal: what is known of a node is the last that was found of it in the frame, or nothing; what is
 * brief, to its own chain alone. Method: random chains against an array of what each node must be,
 * in tables from the smallest on, where a table may have forgotten but must not invent. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>

#include "dice.h"
#include "lacking.h"
#include "suite.h"

enum { NODES = 500 };

static mni_arena open_lacking(mni_lacking *lacking, uint32_t nodes_max) {
    mni_arena arena;
    mn_status st = {0};
    ck_assert_int_eq(mni_arena_open(&arena, mni_lacking_need(nodes_max), &st), MN_OK);
    mni_lacking_open(lacking, nodes_max, &arena);
    return arena;
}

typedef struct known_fact {
    enum { UNKNOWN = 0, LACKS, BRIEF, SOUND } what;
    uint32_t block_id;
} known_fact;

/* Returns of how many nodes something is known. */
static uint32_t compare(const mni_lacking *lacking, const known_fact *fact, uint32_t nodes) {
    uint32_t known = 0;
    for (uint32_t node = 0; node < nodes; node++) {
        const mni_lack *lack = mni_lacking_of(lacking, node);
        bool sound = mni_lacking_is_sound(lacking, node);
        ck_assert(lack == NULL || !sound);
        if (lack != NULL) {
            ck_assert_int_eq(fact[node].what, lack->brief ? BRIEF : LACKS);
            ck_assert_uint_eq(fact[node].block_id, lack->block_id);
        }
        ck_assert(!sound || fact[node].what == SOUND);
        known += lack != NULL || sound;
    }
    return known;
}

/* A chain's findings, as Navigate's: of a node that lacks a block it is not found that it is sound.
 */
static void chain(mni_lacking *lacking, known_fact *fact) {
    mni_lacking_chain(lacking);
    for (uint32_t node = 0; node < NODES; node++)
        if (fact[node].what == BRIEF)
            fact[node].what = UNKNOWN;
    for (uint32_t i = uniform(20); i > 0; i--) {
        uint32_t node = uniform(NODES), block_id = uniform(9);
        bool brief = uniform(3) == 0;
        if (fact[node].what == LACKS || (brief && fact[node].what == SOUND))
            continue;
        mni_lacking_put(lacking, node, block_id, brief);
        fact[node].what = brief ? BRIEF : LACKS;
        fact[node].block_id = block_id;
    }
    for (uint32_t i = uniform(20); i > 0; i--) {
        uint32_t node = uniform(NODES);
        if (fact[node].what != UNKNOWN && fact[node].what != SOUND)
            continue;
        mni_lacking_put_sound(lacking, node);
        fact[node].what = SOUND;
    }
}

START_TEST(nothing_is_invented) {
    static const uint32_t sizes[] = {0, 64, 65, 300, 1 << 20};
    known_fact fact[NODES];
    mni_lacking lacking;
    mni_arena arena = open_lacking(&lacking, sizes[_i]);
    uint32_t known = 0;
    for (int frame = 0; frame < 200; frame++) {
        mni_lacking_forget(&lacking);
        for (uint32_t node = 0; node < NODES; node++)
            fact[node].what = UNKNOWN;
        ck_assert_uint_eq(compare(&lacking, fact, NODES), 0);
        for (uint32_t chains = uniform(8); chains > 0; chains--) {
            chain(&lacking, fact);
            known += compare(&lacking, fact, NODES);
        }
    }
    ck_assert_uint_gt(known, 0);
    mni_arena_close(&arena);
}
END_TEST

/* Who is in the set of node 0 comes after *after. */
static uint32_t next_of_set(const mni_lacking *lacking, uint32_t after) {
    do
        after++;
    while (mni_lacking_set(lacking, after) != mni_lacking_set(lacking, 0));
    return after;
}

/* The oldest of a set makes room, but what lacks a block not for what is sound; and after hours
 * numbers begin again. */
START_TEST(places_and_numbers) {
    mni_lacking lacking;
    mni_arena arena = open_lacking(&lacking, 64);
    mni_lacking_forget(&lacking);
    uint32_t node[MNI_LACKING_WAYS + 1] = {0}, other = 0;
    for (int i = 0; i < MNI_LACKING_WAYS; i++) {
        mni_lacking_chain(&lacking);
        mni_lacking_put(&lacking, node[i], 7, false);
        node[i + 1] = other = next_of_set(&lacking, other);
    }
    mni_lacking_put_sound(&lacking, other);
    ck_assert(!mni_lacking_is_sound(&lacking, other));
    for (int i = 0; i < MNI_LACKING_WAYS; i++)
        ck_assert_uint_eq(mni_lacking_of(&lacking, node[i])->block_id, 7);
    mni_lacking_put(&lacking, other, 8, false);
    ck_assert_ptr_null(mni_lacking_of(&lacking, 0));
    ck_assert_ptr_nonnull(mni_lacking_of(&lacking, node[1]));
    ck_assert_uint_eq(mni_lacking_of(&lacking, other)->block_id, 8);
    lacking.chain = UINT32_MAX - 5;
    mni_lacking_forget(&lacking);
    ck_assert_uint_lt(lacking.chain, 5);
    ck_assert_ptr_null(mni_lacking_of(&lacking, other));
    mni_lacking_chain(&lacking);
    mni_lacking_put(&lacking, other, 9, true);
    ck_assert_uint_eq(mni_lacking_of(&lacking, other)->block_id, 9);
    mni_lacking_chain(&lacking);
    ck_assert_ptr_null(mni_lacking_of(&lacking, other));
    mni_arena_close(&arena);
}
END_TEST

/* What is sound, or brief, makes room for what lacks a block, however new it is; and what is
 * forgotten for both. */
START_TEST(what_is_worth_least_makes_room) {
    enum { LAST = MNI_LACKING_WAYS - 1 };
    mni_lacking lacking;
    mni_arena arena = open_lacking(&lacking, 64);
    uint32_t node[MNI_LACKING_WAYS + 1] = {0};
    for (int i = 1; i <= MNI_LACKING_WAYS; i++)
        node[i] = next_of_set(&lacking, node[i - 1]);
    mni_lacking_forget(&lacking);
    for (int i = 0; i < LAST; i++) {
        mni_lacking_chain(&lacking);
        mni_lacking_put(&lacking, node[i], 7, false);
    }
    mni_lacking_chain(&lacking);
    if (_i == 0) {
        mni_lacking_put_sound(&lacking, node[LAST]);
        ck_assert(mni_lacking_is_sound(&lacking, node[LAST]));
    } else {
        mni_lacking_put(&lacking, node[LAST], 7, true);
    }
    mni_lacking_put(&lacking, node[LAST + 1], 8, false);
    ck_assert_ptr_null(mni_lacking_find(&lacking, node[LAST]));
    for (int i = 0; i <= LAST + 1; i++)
        ck_assert((mni_lacking_of(&lacking, node[i]) != NULL) == (i != LAST));
    mni_lacking_forget(&lacking);
    mni_lacking_chain(&lacking);
    for (int i = 0; i < MNI_LACKING_WAYS; i++)
        mni_lacking_put_sound(&lacking, node[i]);
    for (int i = 0; i < MNI_LACKING_WAYS; i++)
        ck_assert(mni_lacking_is_sound(&lacking, node[i]));
    mni_arena_close(&arena);
}
END_TEST

/* Of a front, one node in 32 is remembered, nearly all of them: to lose much made chains search the
 * same nodes over and over, 100,000 in a frame that split a thousand. */
START_TEST(a_share_of_the_front_is_remembered) {
    enum { FRONT = 1 << 16, LACKING = FRONT / 32 };
    mni_lacking lacking;
    mni_arena arena = open_lacking(&lacking, FRONT);
    mni_lacking_forget(&lacking);
    mni_lacking_chain(&lacking);
    uint32_t known = 0;
    for (uint32_t i = 0; i < LACKING; i++)
        mni_lacking_put(&lacking, 5 * i, 1 + i % 100, false);
    for (uint32_t i = 0; i < LACKING; i++)
        known += mni_lacking_of(&lacking, 5 * i) != NULL;
    ck_assert_uint_gt(known, LACKING - LACKING / 10);
    mni_arena_close(&arena);
}
END_TEST

int main(void) {
    const char *seed = getenv("MN_SEED");
    random_state = seed != NULL ? strtoull(seed, NULL, 10) : 20261122;
    printf("MN_SEED=%llu\n", (unsigned long long)random_state);
    Suite *suite = suite_create("lacking");
    TCase *tc = tcase_create("lacking");
    tcase_add_loop_test(tc, nothing_is_invented, 0, 5);
    tcase_add_test(tc, places_and_numbers);
    tcase_add_loop_test(tc, what_is_worth_least_makes_room, 0, 2);
    tcase_add_test(tc, a_share_of_the_front_is_remembered);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
