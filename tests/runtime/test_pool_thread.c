/* Goal: with the I/O thread, on pread and io_uring, nothing is lost and no invariant breaks.
 * Method: a walker over made files with few place holders, frames as fast as they go; recounts
 * after every frame; run under ThreadSanitizer too. io_uring is skipped, and says so, where
 * refused. */
#include <check.h>
#include <liburing.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "suite.h"
#include "walk.h"

enum { SEEDS = 6, FRAMES = 150, SETTLE_MAX = 3000 };

static const mn_io_kind METHODS[] = {MN_IO_PREAD, MN_IO_URING};

static bool may_use(mn_io_kind io) {
    struct io_uring ring;
    if (io != MN_IO_URING)
        return true;
    if (io_uring_queue_init(4, &ring, 0) != 0) {
        printf("skipped: io_uring is refused here\n");
        return false;
    }
    io_uring_queue_exit(&ring);
    return true;
}

static made_desc file_of(uint64_t seed) {
    return (made_desc){.seed = seed,
                       .blocks = 40 + (uint32_t)(mix(seed, 1) % 100),
                       .depth_max = 4 + (uint32_t)(mix(seed, 2) % 4),
                       .fanout_max = 4,
                       .pages_max = 4,
                       .overflow_max = mix(seed, 3) % 2 ? 2 : 0,
                       .blocking = mix(seed, 4) % 2 ? MN_BLOCKING_LEVELS : MN_BLOCKING_PACKED};
}

static void assert_sums_agree(walker *w) {
    mn_session_stats s = {0};
    mni_store_stats(w->store, &s);
    ck_assert_uint_eq(s.commands, s.commands_loaded + s.commands_resident + s.commands_given_up +
                                      s.commands_failed);
    ck_assert_uint_eq(s.reads, s.commands_loaded + s.commands_failed);
    ck_assert_uint_eq(s.commands_failed, 0);
}

static void pause_us(long us) {
    struct timespec time = {.tv_nsec = us * 1000};
    nanosleep(&time, NULL);
}

static void run_seed(uint64_t seed, mn_io_kind io) {
    made_file file;
    made_desc made = file_of(seed);
    made_file_make(&file, &made);
    uint32_t k_min = mni_store_k_min(&file.header);
    uint32_t ks[] = {k_min, 2 * k_min, file.blocks > k_min ? file.blocks : k_min};
    mni_store_desc desc = {.kind = MN_STORE_PAGED, .io = io, .k = ks[seed % 3]};
    walker w;
    ck_assert_msg(walker_open(&w, &file, desc), "%s", w.status.text);
    for (uint64_t frame = 0; frame < FRAMES; frame++) {
        walker_frame(&w, 1 + mix(seed, frame / 8) % 500, 0);
        if (frame % 3 == 0)
            pause_us(200); /* let reads land in the middle of the path */
    }
    uint32_t frames = walker_settle(&w, 74, SETTLE_MAX);
    ck_assert_uint_lt(frames, SETTLE_MAX);
    if (desc.k >= file.blocks)
        ck_assert(walker_has_all(&w));
    assert_sums_agree(&w);
    ck_assert_uint_lt(walker_settle(&w, 0, SETTLE_MAX), SETTLE_MAX);
    ck_assert(walker_at_roots(&w));
    assert_sums_agree(&w);
    walker_close(&w);
    made_file_free(&file);
}

static void without_times(mn_session_stats *stats) {
    stats->io_lock_hold_ns_max = stats->io_busy_ns = stats->io_depth_ns = stats->io_cpu_ns = 0;
    stats->io_full_ns = stats->io_full_bytes = 0;
}

START_TEST(nothing_is_lost) {
    uint64_t base = seed_of_test(1);
    if (!may_use(METHODS[_i]))
        return;
    for (uint64_t seed = base; seed < base + SEEDS; seed++)
        run_seed(seed, METHODS[_i]);
}
END_TEST

/* With io_serial two runs read the same, whatever the threads do, and whatever the method. */
START_TEST(serial_runs_repeat) {
    made_file file;
    made_desc made = file_of(7);
    made_file_make(&file, &made);
    mn_session_stats stats[3];
    memset(stats, 0, sizeof stats);
    static const mn_io_kind kinds[] = {MN_IO_PREAD, MN_IO_PREAD, MN_IO_URING};
    for (int run = 0; run < 3; run++) {
        walker w;
        mni_store_desc desc = {.kind = MN_STORE_PAGED,
                               .io = kinds[run],
                               .io_serial = true,
                               .k = mni_store_k_min(&file.header) + 3};
        ck_assert(walker_open(&w, &file, desc));
        for (uint64_t frame = 0; frame < 200; frame++) {
            walker_frame(&w, 1 + frame / 10, 0);
            ck_assert_uint_eq(w.misses == 0 ? mni_store_pending(w.store) : 0, 0);
        }
        mni_store_stats(w.store, &stats[run]);
        without_times(&stats[run]);
        walker_close(&w);
    }
    ck_assert_uint_gt(stats[0].reads, 10);
    ck_assert_mem_eq(&stats[0], &stats[1], sizeof stats[0]);
    ck_assert_mem_eq(&stats[0], &stats[2], sizeof stats[0]);
    made_file_free(&file);
}
END_TEST

/* So too when one frame asks for more than the board has room for. */
START_TEST(serial_runs_repeat_on_a_full_board) {
    made_file file;
    made_desc made = {.seed = 1,
                      .blocks = 400,
                      .depth_max = 2,
                      .fanout_max = 400,
                      .pages_max = 1,
                      .blocking = MN_BLOCKING_LEVELS,
                      .regular = true};
    made_file_make(&file, &made);
    mn_session_stats first = {0};
    for (int run = 0; run < 200; run++) {
        walker w;
        mn_session_stats stats = {0};
        mni_store_desc desc = {.kind = MN_STORE_PAGED,
                               .io = MN_IO_PREAD,
                               .prefetch = MN_PREFETCH_NEIGHBOURS,
                               .io_serial = true,
                               .k = 8};
        ck_assert(walker_open(&w, &file, desc));
        w.check_each_frame = false;
        walker_frame(&w, 0, 0);
        mni_store_stats(w.store, &stats);
        without_times(&stats);
        walker_close(&w);
        first = run == 0 ? stats : first;
        ck_assert_mem_eq(&stats, &first, sizeof stats);
    }
    ck_assert_uint_gt(first.prefetches, 256); /* the ring for them: PREFETCHES_MIN */
    made_file_free(&file);
}
END_TEST

/* Closing while reads are in flight: every command ends, every read has its completion. */
START_TEST(closes_in_the_middle) {
    made_file file;
    made_desc made = file_of(9);
    made_file_make(&file, &made);
    for (int run = 0; run < 40; run++) {
        walker w;
        mni_store_desc desc = {.kind = MN_STORE_PAGED, .io = METHODS[run % 2], .k = file.blocks};
        ck_assert(walker_open(&w, &file, desc));
        w.check_each_frame = false;
        for (int frame = 0; frame < run % 5; frame++)
            walker_frame(&w, 74, 0);
        walker_close(&w);
    }
    made_file_free(&file);
}
END_TEST

static void warn_count(void *context, const char *text) {
    ++*(uint32_t *)context;
    printf("warning: %s\n", text);
}

/* Little memory may be locked, or none: one warning, and the same blocks. (Root is not bound by the
 * limit; run as another user this shows both refusals, of buffers and of the ring.) */
START_TEST(goes_on_without_fixed_buffers) {
    static const rlim_t limit_bytes[] = {0, 64 << 10, 512 << 10};
    made_file file;
    made_desc made = file_of(10);
    made_file_make(&file, &made);
    struct rlimit limit;
    ck_assert_int_eq(getrlimit(RLIMIT_MEMLOCK, &limit), 0);
    limit.rlim_cur = limit_bytes[_i] < limit.rlim_max ? limit_bytes[_i] : limit.rlim_max;
    ck_assert_int_eq(setrlimit(RLIMIT_MEMLOCK, &limit), 0);
    uint32_t warnings = 0;
    walker w;
    mni_store_desc desc = {.kind = MN_STORE_PAGED,
                           .io = MN_IO_URING,
                           .k = file.blocks,
                           .warn = warn_count,
                           .warn_context = &warnings};
    ck_assert(walker_open(&w, &file, desc));
    ck_assert_uint_le(warnings, 1);
    ck_assert_uint_lt(walker_settle(&w, 74, SETTLE_MAX), SETTLE_MAX);
    ck_assert(walker_has_all(&w));
    walker_close(&w);
    made_file_free(&file);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("pool_thread");
    TCase *tests = tcase_create("pool_thread");
    tcase_set_timeout(tests, 300);
    tcase_add_loop_test(tests, nothing_is_lost, 0, 2);
    tcase_add_test(tests, serial_runs_repeat);
    tcase_add_test(tests, serial_runs_repeat_on_a_full_board);
    tcase_add_test(tests, closes_in_the_middle);
    tcase_add_loop_test(tests, goes_on_without_fixed_buffers, 0, 3);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
