/* Goal: the navigator on a pool that is too small or a disk that fails: it settles, finds back to
 * the roots, and is what it would be without faults when they stop. Method: every shape and
 * blocking at the smallest K and at three times that; a simulated disk with seeds. */
#include <check.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"
#include "suite.h"

enum { CAMERAS = 6 };

static const mn_block_desc blockings[] = {{.blocking = MN_BLOCKING_LEVELS, .l = 3},
                                          {.blocking = MN_BLOCKING_LEVELS, .l = 6},
                                          {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096}};
enum { BLOCKINGS = sizeof blockings / sizeof blockings[0] };

/* Few place holders: settles at every camera, keeps every invariant, and finds back to the roots;
 * with the simulated disk, twice the same. */
START_TEST(few_holders) {
    static const mn_io_kind ios[] = {MN_IO_PREAD, MN_IO_SIM};
    uint64_t hash[2][CAMERAS];
    model m;
    model_make(&m, (model_shape)(_i % MODEL_SHAPES), _i % MODEL_SHAPES == MODEL_HEAP ? 300 : 1500,
               &blockings[_i / MODEL_SHAPES]);
    for (int io = 0; io < 2; io++)
        for (int factor = 1; factor <= 3; factor += 2)
            for (int degrade = 0; degrade < 2; degrade++) {
                mn_session_desc desc = model_desc(&m);
                desc.store = MN_STORE_PAGED;
                desc.io = ios[io];
                desc.io_serial = factor == 3;
                desc.degrade_off = degrade == 0;
                desc.k = MN_K_MIN;
                if (factor > 1) {
                    mn_session *probe = model_open(&desc);
                    mn_plan plan;
                    mn_session_plan(probe, &plan);
                    desc.k = (int64_t)plan.k_min * factor;
                    mn_session_close(probe);
                }
                model_walk(&desc, &m, hash[0], CAMERAS);
                if (ios[io] == MN_IO_SIM) {
                    model_walk(&desc, &m, hash[1], CAMERAS);
                    ck_assert_mem_eq(hash[0], hash[1], sizeof hash[0]);
                }
            }
    model_free(&m);
}
END_TEST

/* What the rules refuse is not found again, wherever the camera looks, while there is no room for
 * it; and is when there is. */
START_TEST(given_up_until_there_is_room) {
    model m;
    model_make(&m, MODEL_GLOBE, 6000, &blockings[_i]);
    mn_session_desc desc = model_desc(&m);
    desc.store = MN_STORE_PAGED;
    desc.io = MN_IO_SIM;
    desc.io_serial = true;
    desc.degrade_off = true;
    desc.k = MN_K_MIN;
    mn_session *s = model_open(&desc);
    mn_camera camera = model_camera(&m, 0, 1.2);
    mn_frame_stats frame;
    mn_session_stats settled, standing, moved;
    (void)mn_session_settle(s, &camera, 1000);
    mn_session_stats_get(s, &settled);
    mn_session_frame(s, &camera, &frame);
    mn_session_stats_get(s, &standing);
    ck_assert_uint_gt(frame.refused_pool, 0);
    ck_assert_uint_eq(standing.urgent_down_refused, settled.urgent_down_refused);
    uint64_t nodes = frame.active_nodes;
    for (int i = 0; i < 4; i++) { /* each slot has its turn in 16 frames: none has room */
        camera.eye[0] *= 1.00001f;
        mn_session_frame(s, &camera, &frame);
    }
    ck_assert_uint_gt(frame.refused_pool, 0);
    mn_session_stats_get(s, &moved);
    ck_assert_uint_le(moved.urgent_down_refused - standing.urgent_down_refused, frame.refused_pool);
    mn_session_set_tolerance(s, INFINITY); /* all room there is */
    (void)mn_session_settle(s, &camera, 1000);
    ck_assert(mn_session_at_roots(s));
    mn_session_set_tolerance(s, desc.tolerance_px);
    (void)mn_session_settle(s, &camera, 1000);
    mn_session_frame(s, &camera, &frame);
    ck_assert_uint_ge(frame.active_nodes, nodes / 2);
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* Where one chain was refused others are refused unseen: in a pool that is full by far, with the
 * camera going on, next to nothing is split only to be undone. */
START_TEST(refused_unseen) {
    model m;
    model_make(&m, MODEL_TERRAIN, 40000, &blockings[2]);
    mn_session_desc desc = model_desc(&m);
    desc.store = MN_STORE_PAGED;
    desc.io = MN_IO_SIM;
    desc.fps = 60;
    desc.degrade_off = true;
    desc.k = 60;
    mn_session *s = model_open(&desc);
    uint64_t splits = 0, undone = 0, refused = 0;
    for (int i = 0; i < 120; i++) {
        const mn_camera camera = model_camera(&m, 0.01 * i, 2 - 0.01 * i);
        mn_frame_stats frame;
        mn_session_frame(s, &camera, &frame);
        if (i < 10) /* from the roots: blocks are absent, too */
            continue;
        splits += frame.splits;
        undone += frame.splits_undone;
        refused += frame.refused_pool;
    }
    ck_assert_uint_gt(refused, splits);
    ck_assert_uint_lt(undone, splits / 2);
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* Place holders go out of service under a camera that stands, and come back: so does the detail.
 * (The levels that had not fitted were not tried again.) */
START_TEST(room_comes_back) {
    model m;
    model_make(&m, MODEL_TERRAIN, 40000, &blockings[0]);
    mn_session_desc desc = model_desc(&m);
    desc.store = MN_STORE_PAGED;
    desc.io = MN_IO_SIM;
    desc.tolerance_px = 0.03125F;
    mn_session *s = model_open(&desc);
    const mn_camera camera = model_camera(&m, 0.1, 1.5);
    mn_frame_stats whole, less, again;
    (void)mn_session_settle(s, &camera, 1000);
    mn_session_frame(s, &camera, &whole);
    ck_assert_double_eq(whole.tolerance_px, 0.03125);
    mn_session_set_tolerance(s, INFINITY);
    (void)mn_session_settle(s, &camera, 1000);
    while (mn_session_shrink(s))
        continue;
    mn_session_set_tolerance(s, desc.tolerance_px);
    (void)mn_session_settle(s, &camera, 1000);
    mn_session_frame(s, &camera, &less);
    ck_assert_double_gt(less.tolerance_px, 0.03125);
    while (mn_session_grow(s))
        continue;
    (void)mn_session_settle(s, &camera, 1000);
    mn_session_frame(s, &camera, &again);
    ck_assert_double_eq(again.tolerance_px, 0.03125);
    ck_assert_uint_eq(again.front_hash, whole.front_hash);
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* A tolerance that cannot be had is asked for, and then the one before: that is used at once. (It
 * was taken as many times as the other had given way.) */
START_TEST(another_tolerance) {
    model m;
    model_make(&m, MODEL_TERRAIN, 40000, &blockings[2]);
    mn_session_desc desc = model_desc(&m);
    desc.front_max = 4000;
    desc.tolerance_px = 20;
    mn_session *s = model_open(&desc);
    const mn_camera camera = model_camera(&m, 0.1, 1.5);
    mn_frame_stats whole, less, again;
    mn_session_frame(s, &camera, &whole);
    ck_assert_double_eq(whole.tolerance_px, 20);
    mn_session_set_tolerance(s, 0.1F);
    (void)mn_session_settle(s, &camera, 1000);
    mn_session_frame(s, &camera, &less);
    ck_assert(less.tolerance_px > 0.2 && less.tolerance_px < 20);
    mn_session_set_tolerance(s, 0.05F);
    mn_session_frame(s, &camera, &again);
    ck_assert_double_eq_tol(again.tolerance_px, less.tolerance_px, 0.02 * less.tolerance_px);
    mn_session_set_tolerance(s, 20);
    mn_session_frame(s, &camera, &again);
    ck_assert_double_eq(again.tolerance_px, 20);
    ck_assert_uint_eq(again.front_hash, whole.front_hash);
    mn_session_set_tolerance(s, -1);
    (void)mn_session_settle(s, &camera, 1000);
    mn_session_set_tolerance(s, 20);
    mn_session_frame(s, &camera, &again);
    ck_assert_double_eq(again.tolerance_px, 20);
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* Reads fail, lie and come late; when that ends, the front is the one that a sound disk gives. */
START_TEST(faults_end) {
    uint64_t sound[CAMERAS];
    model m;
    model_make(&m, (model_shape)(_i % MODEL_SHAPES), _i % MODEL_SHAPES == MODEL_HEAP ? 300 : 1500,
               &blockings[_i % BLOCKINGS]);
    mn_session_desc desc = model_desc(&m);
    model_walk(&desc, &m, sound, CAMERAS);
    desc.store = MN_STORE_PAGED;
    desc.io = MN_IO_SIM;
    desc.seed = model_random();
    desc.sim = (mn_sim_desc){.delay_us_max = 40000,
                             .reorder = 300,
                             .short_read = 100,
                             .eio = 60,
                             .eagain = 100,
                             .corrupt = 60,
                             .misplaced = 30,
                             .fault_frames = 40};
    desc.fps = 60;
    mn_session *s = model_open(&desc);
    for (int i = 0; i < 60; i++) {
        mn_camera camera = model_camera(&m, i / 40.0, 1 + 3 * fabs(cos(i)));
        mn_session_frame(s, &camera, NULL);
        mn_session_check(s);
    }
    for (int i = 0; i < CAMERAS; i++) {
        mn_camera camera = model_camera(&m, 0.13 * i, 1 + 3 * fabs(sin(i)));
        mn_frame_stats stats = {0};
        for (int frame = 0; frame < 300 && (frame < 80 || stats.misses > 0 || stats.changed);
             frame++) /* a retry may be 64 frames away */
            mn_session_frame(s, &camera, &stats);
        ck_assert(!stats.changed && stats.misses == 0);
        ck_assert_uint_eq(stats.front_hash, sound[i]);
    }
    mn_session_drain(s);
    mn_session_stats total;
    mn_session_stats_get(s, &total);
    ck_assert_uint_eq(total.commands, total.commands_loaded + total.commands_resident +
                                          total.commands_given_up + total.commands_failed);
    ck_assert_uint_eq(total.commands, total.prefetches + total.urgent_up + total.urgent_down);
    mn_session_close(s);
    model_free(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("session_pool");
    TCase *tc = tcase_create("session_pool");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, given_up_until_there_is_room, 0, BLOCKINGS);
    TCase *full = tcase_create("full");
    tcase_add_test(full, refused_unseen);
    tcase_add_test(full, room_comes_back);
    tcase_add_test(full, another_tolerance);
    suite_add_tcase(suite, full);
    tcase_add_loop_test(tc, few_holders, 0, MODEL_SHAPES * BLOCKINGS);
    tcase_add_loop_test(tc, faults_end, 0, 2 * MODEL_SHAPES);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
