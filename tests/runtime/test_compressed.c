/* Goal: a session on a compressed file shows what it shows on the plain one, in the memory that it
 * plans, whatever the disk does. Method: small models written both ways; settled fronts compared by
 * hash, by each way to read, with faults, at the smallest caps; extents damaged in the file. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "extents.h"
#include "model.h"
#include "suite.h"

enum { CAMERAS = 4, TRIANGLES = 2500, MANY = 20000, ENOUGH = 5000, RETRY_FRAMES = 64 };

static const mn_block_desc blockings[][2] = {
    {{.block_bytes = 4096}, {.block_bytes = 4096, .zstd_level = 3}},
    {{.blocking = MN_BLOCKING_LEVELS, .l = 4},
     {.blocking = MN_BLOCKING_LEVELS, .l = 4, .zstd_level = 3}},
    {{.block_bytes = 16384}, {.block_bytes = 16384, .zstd_level = 3}},
};
enum { BLOCKINGS = sizeof blockings / sizeof blockings[0] };

START_TEST(same_fronts) {
    uint64_t expected[CAMERAS], hash[CAMERAS];
    for (int b = 0; b < BLOCKINGS; b++) {
        model plain, pressed;
        model_make(&plain, (model_shape)_i, TRIANGLES, &blockings[b][0]);
        model_make(&pressed, (model_shape)_i, TRIANGLES, &blockings[b][1]);
        ck_assert_uint_eq(plain.header.build_id, pressed.header.build_id);
        mn_session_desc desc = model_desc(&plain);
        ck_assert_uint_gt(model_walk(&desc, &plain, expected, CAMERAS), 100);
        for (int way = 0; way < 4; way++) {
            if (way < 2 && b != _i % BLOCKINGS) /* a disk takes its time: once a shape */
                continue;
            desc = model_desc(&pressed);
            desc.store = way < 3 ? MN_STORE_PAGED : MN_STORE_RESIDENT;
            desc.io = way == 0 ? MN_IO_URING : way == 1 ? MN_IO_PREAD : MN_IO_SIM;
            desc.k = way == 2 ? MN_K_FROM_RAM : 0;
            (void)model_walk(&desc, &pressed, hash, CAMERAS);
            ck_assert_mem_eq(hash, expected, sizeof hash);
        }
        model_free(&plain);
        model_free(&pressed);
    }
}
END_TEST

/* Short, failed, corrupt and misplaced reads; gone, the front is that of a sound disk. */
START_TEST(faults) {
    model m;
    model_make(&m, MODEL_TERRAIN, MANY, &blockings[_i % BLOCKINGS][1]);
    mn_session_desc desc = model_desc(&m);
    mn_camera camera = model_camera(&m, 0.1, 1.2);
    uint64_t hash[2];
    for (int way = 0; way < 2; way++) {
        desc.store = way == 0 ? MN_STORE_RESIDENT : MN_STORE_PAGED;
        desc.io = MN_IO_SIM;
        desc.seed = model_random();
        if (way == 1)
            desc.sim = (mn_sim_desc){.reorder = 100,
                                     .short_read = 200,
                                     .eio = 50,
                                     .eagain = 100,
                                     .corrupt = 200,
                                     .misplaced = 100,
                                     .fault_frames = 60};
        mn_session *s = model_open(&desc);
        mn_frame_stats f;
        for (int i = 0; i < 60; i++) {
            mn_camera moving = model_camera(&m, 0.02 * i, i % 20 < 10 ? 1.2 : 4);
            mn_session_frame(s, &moving, &f);
            mn_session_check(s);
        }
        for (int i = 0; i <= RETRY_FRAMES; i++) /* whatever failed is due again */
            mn_session_frame(s, &camera, &f);
        ck_assert_uint_lt(mn_session_settle(s, &camera, ENOUGH), ENOUGH);
        mn_session_frame(s, &camera, &f);
        hash[way] = f.front_hash;
        mn_session_stats total;
        mn_session_stats_get(s, &total);
        if (way == 1)
            ck_assert_uint_gt(total.checksum_failures, 0);
        mn_session_close(s);
    }
    ck_assert_uint_eq(hash[0], hash[1]);
    model_free(&m);
}
END_TEST

/* The plan counts what compressed blocks take: at its least cap a session opens, a KiB below it is
 * refused; and it needs more than the plain file's. */
START_TEST(least_caps) {
    model plain, pressed;
    model_make(&plain, MODEL_TORUS, TRIANGLES, &blockings[_i][0]);
    model_make(&pressed, MODEL_TORUS, TRIANGLES, &blockings[_i][1]);
    uint64_t least[2];
    for (int way = 0; way < 2; way++) {
        mn_session_desc desc = model_desc(way == 0 ? &plain : &pressed);
        mn_plan plan;
        mn_status st = {0};
        desc.store = MN_STORE_PAGED;
        desc.io = MN_IO_PREAD;
        desc.k = MN_K_MIN;
        mn_session *s = model_open(&desc);
        mn_session_plan(s, &plan);
        mn_session_close(s);
        least[way] = desc.ram_bytes = plan.ram_min_bytes;
        s = model_open(&desc);
        mn_session_plan(s, &plan);
        ck_assert_uint_le(plan.planned_bytes, desc.ram_bytes);
        mn_camera camera = model_camera(&pressed, 0, 1.5);
        ck_assert_uint_lt(mn_session_settle(s, &camera, ENOUGH), ENOUGH);
        mn_session_check(s);
        mn_session_close(s);
        desc.ram_bytes -= 1024;
        ck_assert_int_eq(mn_session_open(&desc, &s, &st), MN_CAP_TOO_SMALL);
    }
    ck_assert_uint_gt(least[1], least[0]);
    ck_assert_uint_lt(least[1], least[0] + mni_extents_need(&pressed.header, 4) + 4096);
    model_free(&plain);
    model_free(&pressed);
}
END_TEST

/* Sound blocks are navigated, damaged ones absent and counted; a damaged root block is refused, as
 * is a mapped file, with a word on what to do. */
START_TEST(damage_in_the_file) {
    model m;
    model_make(&m, MODEL_TERRAIN, MANY, &blockings[0][1]);
    mni_stored file;
    ck_assert_int_eq(mni_stored_open(&file, m.path, &m.header, NULL), MN_OK);
    FILE *f = fopen(m.path, "r+b");
    ck_assert_ptr_nonnull(f);
    mn_block_ref ref = m.header.root[0].block;
    const uint64_t root_at = mni_extents_find(&file.extents, ref).offset;
    uint32_t damaged = 0;
    while ((ref = mni_extents_next(&file.extents, ref.id + ref.pages)).pages > 0)
        if (model_random() % 4 == 0) {
            mni_extent e = mni_extents_find(&file.extents, ref);
            ck_assert_int_eq(fseek(f, (long)e.offset + 4 + (long)(model_random() % 200), SEEK_SET),
                             0);
            for (int i = 0; i < 16; i++)
                fputc((int)(model_random() % 256), f);
            damaged++;
        }
    ck_assert_int_eq(fflush(f), 0);
    ck_assert_uint_gt(damaged, 3);
    for (int way = 0; way < 3; way++) {
        mn_session_desc desc = model_desc(&m);
        desc.closed = false;
        desc.store = way == 0 ? MN_STORE_RESIDENT : MN_STORE_PAGED;
        desc.io = way == 1 ? MN_IO_PREAD : MN_IO_SIM;
        mn_session *s = model_open(&desc);
        for (int i = 0; i < 8; i++) {
            mn_camera camera = model_camera(&m, 0.2 * i, 1.1);
            mn_session_frame(s, &camera, NULL);
            mn_session_check(s);
        }
        mn_session_stats total;
        mn_session_stats_get(s, &total);
        ck_assert_uint_gt(total.checksum_failures, 0);
        mn_session_close(s);
    }
    ck_assert_int_eq(fseek(f, (long)root_at + 40, SEEK_SET), 0);
    for (int i = 0; i < 64; i++)
        fputc(0xee, f);
    fclose(f);
    for (int way = 0; way < 3; way++) {
        mn_session_desc desc = model_desc(&m);
        mn_session *s;
        mn_status st = {0};
        desc.io = MN_IO_SIM;
        desc.store = way == 0 ? MN_STORE_RESIDENT : way == 1 ? MN_STORE_PAGED : MN_STORE_MAPPED;
        ck_assert_int_eq(mn_session_open(&desc, &s, &st), way < 2 ? MN_BAD_INPUT : MN_USAGE);
        ck_assert_ptr_nonnull(strstr(st.text, way < 2 ? "root block" : "--zstd"));
    }
    mni_stored_close(&file);
    model_free(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("compressed");
    TCase *tc = tcase_create("compressed");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, same_fronts, 0, MODEL_SHAPES);
    tcase_add_loop_test(tc, faults, 0, 6);
    tcase_add_loop_test(tc, least_caps, 0, BLOCKINGS);
    tcase_add_test(tc, damage_in_the_file);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
