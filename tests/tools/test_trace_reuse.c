/* Goal: reads told for a pool of K are those of one that keeps what was in use last. Method: random
 * uses; for each K a pool that is a plain list, and a walk over it. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>

#include "suite.h"
#include "trace_reuse.h"
#include "trace_words.h"

enum { BLOCKS = 60, STEPS = 4000 };

static uint64_t state;
static uint32_t dice(uint32_t below) {
    state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (uint32_t)(state >> 33) % below;
}

/* One that holds what is in use and, of the rest, what went last. */
typedef struct pool {
    uint32_t k, count;
    uint32_t idle[BLOCKS], idles; /* as they went */
    bool in_use[BLOCKS];
    uint64_t reads;
} pool;

static void pool_use(pool *p, uint32_t block) {
    uint32_t at = 0;
    while (at < p->idles && p->idle[at] != block)
        at++;
    if (at < p->idles) {
        for (p->idles--; at < p->idles; at++)
            p->idle[at] = p->idle[at + 1];
    } else {
        p->reads++;
        if (p->count == p->k && p->idles > 0) {
            for (at = 0, p->idles--; at < p->idles; at++)
                p->idle[at] = p->idle[at + 1];
            p->count--;
        }
        p->count++;
    }
    p->in_use[block] = true;
}

static void pool_leave(pool *p, uint32_t block) {
    p->in_use[block] = false;
    p->idle[p->idles++] = block;
}

/* Never more than `most` blocks in use, so that every K from there on holds them. */
static void walk(uint32_t most, trace_reuse *reuse, pool *pools, uint32_t pool_count) {
    bool in_use[BLOCKS] = {false};
    uint32_t count = 0;
    for (int i = 0; i < STEPS; i++) {
        const uint32_t near = dice(3) > 0 ? (uint32_t)i / 200 : 0,
                       block = (near + dice(25)) % BLOCKS;
        if (!in_use[block] && count == most)
            continue;
        if (in_use[block]) {
            trace_reuse_leave(reuse, block);
            count--;
        } else {
            if (dice(4) == 0) {
                trace_reuse_absent(reuse, block);
                trace_reuse_miss(reuse, block);
            }
            trace_reuse_use(reuse, block);
            count++;
        }
        for (uint32_t p = 0; p < pool_count; p++)
            if (in_use[block])
                pool_leave(&pools[p], block);
            else
                pool_use(&pools[p], block);
        in_use[block] = !in_use[block];
    }
}

START_TEST(as_a_pool_of_that_size) {
    const char *seed = getenv("MN_SEED");
    state = seed != NULL ? strtoull(seed, NULL, 10) : (uint64_t)_i + 1;
    printf("MN_SEED=%llu\n", (unsigned long long)state);
    const uint32_t most = 1 + dice(20);
    pool pools[BLOCKS + 1] = {0};
    const uint32_t count = BLOCKS + 1 - most;
    for (uint32_t p = 0; p < count; p++)
        pools[p].k = most + p;
    trace_reuse reuse = {0};
    walk(most, &reuse, pools, count);
    trace_reuse_end(&reuse);
    ck_assert(!reuse.failed);
    for (uint32_t p = 0; p < count; p++)
        ck_assert_uint_eq(trace_reuse_reads(&reuse, pools[p].k), pools[p].reads);
    ck_assert_uint_eq(trace_reuse_reads(&reuse, 0), reuse.accesses_all);
    ck_assert_uint_eq(trace_reuse_misses(&reuse, 0), reuse.misses_all);
    const uint32_t farthest = trace_reuse_farthest(&reuse);
    ck_assert_uint_le(farthest, BLOCKS);
    ck_assert_uint_eq(trace_reuse_reads(&reuse, farthest),
                      trace_reuse_reads(&reuse, UINT32_MAX - 1));
    trace_reuse_free(&reuse);
}
END_TEST

/* Longer than the tree has moments: it is squeezed, and nothing is lost. */
START_TEST(a_long_run) {
    trace_reuse reuse = {0};
    for (uint32_t i = 0; i < 300000; i++) {
        trace_reuse_use(&reuse, i % 1000);
        trace_reuse_leave(&reuse, i % 1000);
    }
    trace_reuse_end(&reuse);
    ck_assert(!reuse.failed);
    ck_assert_uint_eq(trace_reuse_reads(&reuse, 1000), 1000);
    ck_assert_uint_eq(trace_reuse_reads(&reuse, 999), 300000);
    ck_assert_uint_eq(trace_reuse_farthest(&reuse), 1000);
    ck_assert_uint_lt(reuse.tree_room, 20000);
    trace_reuse_free(&reuse);
}
END_TEST

/* Misses belong to the use that ends them, and to how far away the block was when first missed. */
START_TEST(misses_wait_for_their_use) {
    trace_reuse reuse = {0};
    for (uint32_t block = 0; block < 3; block++) {
        trace_reuse_use(&reuse, block);
        trace_reuse_leave(&reuse, block);
    }
    for (int i = 0; i < 5; i++)
        trace_reuse_miss(&reuse, 0); /* behind 2 and 1: a pool of 3 has it */
    trace_reuse_use(&reuse, 0);
    trace_reuse_miss(&reuse, 0); /* in use: of something else */
    trace_reuse_miss(&reuse, 7); /* never came */
    trace_reuse_end(&reuse);
    ck_assert_uint_eq(trace_reuse_misses(&reuse, 2), 6);
    ck_assert_uint_eq(trace_reuse_misses(&reuse, 3), 1);
    ck_assert_uint_eq(reuse.misses_all, 6);
    trace_reuse_free(&reuse);
}
END_TEST

START_TEST(blocks_have_numbers) {
    trace_map map = {0};
    for (uint32_t i = 0; i < 100000; i++)
        ck_assert_uint_eq(trace_map_number(&map, i * 2654435761u), i);
    for (uint32_t i = 0; i < 100000; i++)
        ck_assert_uint_eq(trace_map_number(&map, i * 2654435761u), i);
    trace_map_free(&map);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("trace_reuse");
    TCase *tc = tcase_create("trace_reuse");
    tcase_add_loop_test(tc, as_a_pool_of_that_size, 0, 20);
    tcase_add_test(tc, a_long_run);
    tcase_add_test(tc, misses_wait_for_their_use);
    tcase_add_test(tc, blocks_have_numbers);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
