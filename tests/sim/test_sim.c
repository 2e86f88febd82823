/* Goal: whatever the disk does, no invariant of the pool breaks, nothing is lost, the way back to
 * the roots is open, and once the faults stop the front is what it would have been without.
 * Method: seeds (env MN_SEED: from that one, MN_SEEDS: so many); each makes a file, a number of
 * place holders, rules, a way to prefetch, faults and a path (new cameras: jumps, back, stops),
 * runs it on the simulated disk with full recounts after every frame (for some: every switch), then
 * settles.
 */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "suite.h"
#include "walk.h"

enum { SEEDS = 1000, FRAMES = 24, SETTLE_MAX = 3000 };

static mn_sim_desc faults_of(uint64_t seed) {
    mn_sim_desc sim = {.delay_us_max = 1 + (uint32_t)(mix(seed, 1) % 20000)};
    uint32_t *chance[] = {&sim.reorder, &sim.short_read, &sim.eio,
                          &sim.eagain,  &sim.corrupt,    &sim.misplaced};
    for (uint64_t i = 0; i < 6; i++)
        if (mix(seed, 2 + i) % 2 == 0)
            *chance[i] = (uint32_t)(mix(seed, 20 + i) % 400);
    sim.fault_frames = FRAMES;
    return sim;
}

static made_desc file_of(uint64_t seed) {
    return (made_desc){.seed = seed,
                       .blocks = 4 + (uint32_t)(mix(seed, 30) % 90),
                       .depth_max = 2 + (uint32_t)(mix(seed, 31) % 7),
                       .fanout_max = 2 + (uint32_t)(mix(seed, 32) % 5),
                       .pages_max = 1 + (uint32_t)(mix(seed, 33) % 4),
                       .overflow_max = mix(seed, 34) % 3 == 0 ? 2 : 0,
                       .roots = mix(seed, 35) % 4 == 0 ? 3 : 1,
                       .blocking = mix(seed, 36) % 2 ? MN_BLOCKING_LEVELS : MN_BLOCKING_PACKED};
}

static uint32_t k_of(const made_file *file, uint64_t seed) {
    uint32_t k_min = mni_store_k_min(&file->header);
    switch (mix(seed, 40) % 4) {
    case 0:
        return k_min;
    case 1:
        return k_min + 1 + (uint32_t)(mix(seed, 41) % 3);
    case 2:
        return 2 * k_min;
    }
    return file->blocks > k_min ? file->blocks : k_min;
}

static void assert_sums_agree(walker *w) {
    mn_session_stats s = {0};
    mni_store_stats(w->store, &s);
    ck_assert_uint_eq(mni_store_pending(w->store), 0);
    ck_assert_uint_eq(s.commands, s.commands_loaded + s.commands_resident + s.commands_given_up +
                                      s.commands_failed);
    ck_assert_uint_eq(s.reads, s.commands_loaded + s.commands_failed);
    ck_assert_uint_eq(s.commands, s.prefetches + s.urgent_up + s.urgent_down);
    ck_assert_uint_le(s.prefetches_used, s.prefetches_loaded);
    ck_assert_uint_le(s.prefetches_loaded, s.commands_loaded);
}

/* A path of FRAMES frames with faults, then the last camera until it settles. */
static void run_path(walker *w, uint64_t seed) {
    for (uint64_t frame = 0; frame < FRAMES; frame++)
        walker_frame(w, 1 + mix(seed, 50 + frame / 3 % (1 + seed % 4)) % 1000, 0.004);
    /* Blocks that failed are tried again within 64 frames; then it is quiet for good. */
    uint64_t camera = 1 + mix(seed, 99) % 1000;
    for (int frame = 0; frame < 70; frame++)
        walker_frame(w, camera, 0.004);
    uint32_t frames = walker_settle(w, camera, SETTLE_MAX);
    MN_ASSERT(frames < SETTLE_MAX);
    assert_sums_agree(w);
}

static void assert_rests(walker *w) {
    mn_session_stats before = {0}, after = {0};
    mni_store_stats(w->store, &before);
    for (int frame = 0; frame < 10; frame++) {
        walker_frame(w, w->camera, 0.1);
        ck_assert_uint_eq(w->changes, 0);
    }
    mni_store_stats(w->store, &after);
    ck_assert_uint_eq(before.reads, after.reads);
}

static void run_seed(uint64_t seed) {
    made_file file;
    made_desc made = file_of(seed);
    made_file_make(&file, &made);
    mni_store_desc desc = {.kind = MN_STORE_PAGED,
                           .io = MN_IO_SIM,
                           .k = k_of(&file, seed),
                           .io_serial = mix(seed, 42) % 4 == 0,
                           .prefetch = (mn_prefetch)(mix(seed, 43) % 3),
                           .seed = seed,
                           .sim = faults_of(seed)};
    walker w, calm;
    if (!walker_open(&w, &file, desc)) { /* a root that failed eight times in a row */
        ck_assert_int_eq(w.status.code, MN_BAD_INPUT);
        made_file_free(&file);
        return;
    }
    w.check_each_step = seed % 8 == 0;
    run_path(&w, seed);
    assert_rests(&w);
    if (desc.k >= file.blocks) {
        ck_assert(walker_open(&calm, &file, (mni_store_desc){.kind = MN_STORE_RESIDENT}));
        (void)walker_settle(&calm, w.camera, 100);
        ck_assert(walker_has_all(&w));
        ck_assert_mem_eq(w.state, calm.state, file.subtrees);
        walker_close(&calm);
    }
    ck_assert_uint_lt(walker_settle(&w, 0, SETTLE_MAX), SETTLE_MAX);
    ck_assert_msg(walker_at_roots(&w), "seed %llu", (unsigned long long)seed);
    assert_sums_agree(&w);
    walker_close(&w);
    made_file_free(&file);
}

START_TEST(faults_do_no_harm) {
    uint64_t base = seed_of_test(1);
    const char *seeds = getenv("MN_SEEDS");
    uint64_t count = seeds != NULL               ? strtoull(seeds, NULL, 10)
                     : getenv("MN_SEED") != NULL ? 1
                                                 : SEEDS;
    for (uint64_t seed = base; seed < base + count; seed++) {
        run_seed(seed);
        if (seed % 100 == 0)
            printf("seed %llu\n", (unsigned long long)seed);
    }
}
END_TEST

/* The same seed, the same figures: reads, commands, fronts. */
START_TEST(a_seed_replays) {
    made_desc made = {.seed = 5, .blocks = 60, .depth_max = 5, .fanout_max = 4, .pages_max = 3};
    made_file file;
    made_file_make(&file, &made);
    mn_session_stats stats[2];
    memset(stats, 0, sizeof stats);
    uint8_t *front[2];
    for (int run = 0; run < 2; run++) {
        walker w;
        mni_store_desc desc = {.kind = MN_STORE_PAGED,
                               .io = MN_IO_SIM,
                               .k = mni_store_k_min(&file.header) + 4,
                               .seed = 3,
                               .sim = {.reorder = 200, .short_read = 200, .eio = 50}};
        ck_assert(walker_open(&w, &file, desc));
        for (uint64_t frame = 0; frame < 100; frame++)
            walker_frame(&w, 1 + frame / 5, 0.0003);
        mni_store_stats(w.store, &stats[run]);
        front[run] = malloc(file.subtrees);
        memcpy(front[run], w.state, file.subtrees);
        walker_close(&w);
    }
    ck_assert_mem_eq(&stats[0], &stats[1], sizeof stats[0]);
    ck_assert_mem_eq(front[0], front[1], file.subtrees);
    ck_assert_uint_gt(stats[0].reads, 30);
    free(front[0]);
    free(front[1]);
    made_file_free(&file);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("sim");
    TCase *tests = tcase_create("sim");
    tcase_set_timeout(tests, 600);
    tcase_add_test(tests, faults_do_no_harm);
    tcase_add_test(tests, a_seed_replays);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
