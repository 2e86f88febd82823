/* Goal: a session end to end: one front whatever the store, figures that add up, foldovers that are
 * there, and no harm from files that lie. Method: small models; stores and blockings compared by
 * hash; the input's simplices mapped through the front again; blocks changed and sealed anew. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "frame.h"
#include "model.h"
#include "suite.h"

enum { CAMERAS = 6, ENOUGH = 5000, BLOCK_BYTES = 4096 };

static const mn_block_desc blockings[] = {{.blocking = MN_BLOCKING_LEVELS, .l = 3},
                                          {.blocking = MN_BLOCKING_LEVELS, .l = 6},
                                          {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096}};
enum { BLOCKINGS = sizeof blockings / sizeof blockings[0] };

/* The order of collapses is the tree's, so neither store nor blocking changes a settled front. */
START_TEST(one_front_in_all_stores) {
    uint64_t expected[CAMERAS] = {0}, hash[CAMERAS];
    for (int b = 0; b < BLOCKINGS; b++) {
        model m;
        model_make(&m, (model_shape)_i, 2100, &blockings[b]);
        for (int way = 0; way < 5; way++) {
            if (way < 2 && b != _i % BLOCKINGS) /* a disk takes its time: once a shape */
                continue;
            mn_session_desc desc = model_desc(&m);
            desc.store = way < 3 ? MN_STORE_PAGED : way == 3 ? MN_STORE_MAPPED : MN_STORE_RESIDENT;
            desc.io = way == 1 ? MN_IO_PREAD : way == 2 ? MN_IO_SIM : MN_IO_URING;
            desc.barrier = b == 1;
            ck_assert_uint_gt(model_walk(&desc, &m, hash, CAMERAS), 100);
            if (expected[0] == 0)
                memcpy(expected, hash, sizeof hash);
            ck_assert_mem_eq(hash, expected, sizeof hash);
        }
        model_free(&m);
    }
}
END_TEST

/* Each leaf is at one slot, whoever asks; foldovers are counted anew from the tree. */
static uint64_t check_image(const model *m, mn_session *s) {
    const mn_tree *tree = &m->tree;
    mn_front front;
    mn_session_front(s, &front);
    uint32_t *slot_of = malloc(tree->leaves * sizeof *slot_of);
    ck_assert_ptr_nonnull(slot_of);
    memset(slot_of, 0xff, tree->leaves * sizeof *slot_of);
    uint64_t triangles = 0, foldovers = 0, legal = 0;
    for (uint32_t i = 0; i < front.simplex_slots; i++) {
        const uint32_t *node = &front.simplex_node[3 * i], *leaf = &front.simplex_leaf[3 * i];
        if (node[0] == MN_NONE)
            continue;
        for (int k = 0; k < 3; k++)
            if (node[k] != MN_NONE) {
                ck_assert(slot_of[leaf[k]] == MN_NONE || slot_of[leaf[k]] == node[k]);
                slot_of[leaf[k]] = node[k];
            }
        if (node[2] == MN_NONE)
            continue;
        triangles++;
        double normal[2][3];
        for (int side = 0; side < 2; side++) {
            const float *p[3];
            for (int k = 0; k < 3; k++)
                p[k] = side ? &tree->leaf_position[3 * leaf[k]] : &front.position[3 * node[k]];
            for (int k = 0; k < 3; k++) {
                int a = (k + 1) % 3, b = (k + 2) % 3;
                normal[side][k] = ((double)p[1][a] - p[0][a]) * ((double)p[2][b] - p[0][b]) -
                                  ((double)p[1][b] - p[0][b]) * ((double)p[2][a] - p[0][a]);
            }
        }
        double dot = 0;
        for (int k = 0; k < 3; k++)
            dot += normal[0][k] * normal[1][k];
        foldovers += dot < 0;
    }
    ck_assert_uint_eq(triangles, front.triangles);
    ck_assert_uint_eq(mn_session_foldovers(s, &legal), foldovers);
    ck_assert_uint_eq(legal, 0);
    free(slot_of);
    return foldovers;
}

START_TEST(image_and_foldovers) {
    model m;
    model_make(&m, (model_shape)_i, 2000, &blockings[1]);
    mn_session_desc desc = model_desc(&m);
    mn_session *s = model_open(&desc);
    uint64_t foldovers = 0;
    for (int i = 0; i < 120; i++) {
        mn_camera camera = model_camera(&m, 0.05 * i, 2);
        mn_session_set_tolerance(s, 0.5f * powf(1.083f, (float)i)); /* up to the root's own error */
        mn_session_frame(s, &camera, NULL);
        foldovers += check_image(&m, s);
    }
    ck_assert(foldovers > 0 || _i != MODEL_FINS); /* near the roots fins do fold */
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* Frames add up to the totals; the cap is in the plan; a run repeats itself. */
START_TEST(figures) {
    model m;
    model_make(&m, MODEL_TERRAIN, 3000, &blockings[0]);
    mn_session_desc desc = model_desc(&m);
    desc.store = _i ? MN_STORE_PAGED : MN_STORE_RESIDENT;
    desc.io = MN_IO_SIM;
    desc.io_serial = true;
    desc.ram_bytes = 8 << 20;
    desc.nav_ops = 50;
    uint64_t hash[2] = {0};
    for (int run = 0; run < 2; run++) {
        mn_session *s = model_open(&desc);
        mn_session_stats total;
        mn_plan plan;
        uint64_t adapt = 0, refused = 0, waits = 0, undone = 0;
        for (int i = 0; i < 60; i++) {
            mn_camera camera = model_camera(&m, i / 60.0, 2);
            mn_frame_stats f;
            mn_session_frame(s, &camera, &f);
            ck_assert_uint_eq(f.frame, i);
            ck_assert_uint_eq(f.adapt, f.splits + f.collapses);
            ck_assert(isnan(f.front_over_wanted) && f.nav_ms >= 0);
            adapt += f.adapt;
            refused += f.refused_budget;
            waits += f.waits_dependency;
            undone += f.splits_undone;
            hash[run] = hash[run] * 31 + f.front_hash;
        }
        mn_session_stats_get(s, &total);
        ck_assert_uint_eq(total.frames, 60);
        ck_assert_uint_eq(total.adapt, adapt);
        ck_assert_uint_eq(total.refused_budget, refused);
        ck_assert_uint_eq(total.waits_dependency, waits);
        ck_assert_uint_eq(total.splits_undone, undone);
        ck_assert_uint_gt(undone, 0); /* for want of budget */
        mn_session_plan(s, &plan);
        ck_assert(plan.planned_bytes <= desc.ram_bytes && plan.ram_cap_bytes == desc.ram_bytes);
        mn_session_close(s);
    }
    ck_assert_uint_eq(hash[0], hash[1]);
    model_free(&m);
}
END_TEST

/* What is done before the first frame is in no frame's figures; the first finds nothing to do, with
 * the front of a session that got there in frames. */
START_TEST(opening) {
    model m;
    model_make(&m, (model_shape)_i, 2100, &blockings[_i % BLOCKINGS]);
    mn_camera camera = model_camera(&m, 0.3, 1.5);
    uint64_t hash[2];
    for (int way = 0; way < 2; way++) {
        mn_session_desc desc = model_desc(&m);
        desc.store = MN_STORE_PAGED;
        desc.io = way == 0 ? MN_IO_SIM : MN_IO_URING;
        desc.seed = 5;
        mn_session *s = model_open(&desc);
        mn_frame_stats f = {0};
        uint64_t adapt = 0;
        uint32_t rounds = 0;
        if (way == 1) {
            ck_assert_uint_lt(mn_session_settle(s, &camera, ENOUGH), ENOUGH);
        } else {
            while (mn_session_opening(s, &camera, &f)) {
                adapt += f.adapt;
                ck_assert_uint_lt(++rounds, ENOUGH);
            }
            ck_assert(adapt > 100 && f.adapt == 0);
        }
        mn_session_frame(s, &camera, &f);
        hash[way] = f.front_hash;
        ck_assert(f.adapt == 0 && f.misses == 0 && !f.changed);
        if (way == 0) {
            mn_session_stats total;
            mn_session_stats_get(s, &total);
            ck_assert(f.frame == 0 && total.frames == 1 && total.misses == 0 && total.adapt == 0);
            ck_assert_uint_gt(total.reads, f.reads);
        }
        mn_session_close(s);
    }
    ck_assert_uint_eq(hash[0], hash[1]);
    model_free(&m);
}
END_TEST

/* A session that is told its first camera reads at open what that wants, on a disk that takes its
 * time: the first frame begins with the roots, misses less, has more, and settles on the same. */
START_TEST(first_camera) {
    model m;
    model_make(&m, (model_shape)_i, 2100, &blockings[_i % BLOCKINGS]);
    mn_camera camera = model_camera(&m, 0.3, 1.5);
    uint64_t hash[2], misses[2], adapt[2];
    for (int told = 0; told < 2; told++) {
        mn_session_desc desc = model_desc(&m);
        desc.store = MN_STORE_PAGED;
        desc.io = MN_IO_SIM;
        desc.seed = 5;
        desc.degrade_off = true;
        desc.k = m.tree.leaves; /* room for all blocks: the top of the tree is half of that */
        mn_camera first = camera;
        desc.first_camera = told ? &first : NULL;
        mn_session *s = model_open(&desc);
        first.eye[0] = NAN; /* is the caller's again */
        mn_frame_stats f = {0};
        ck_assert(mn_session_at_roots(s));
        mn_session_frame(s, &camera, &f);
        misses[told] = f.misses;
        adapt[told] = f.adapt;
        ck_assert_uint_lt(mn_session_settle(s, &camera, ENOUGH), ENOUGH);
        mn_session_frame(s, &camera, &f);
        hash[told] = f.front_hash;
        mn_session_close(s);
    }
    ck_assert_uint_le(misses[1], misses[0]);
    ck_assert_uint_ge(adapt[1], adapt[0]);
    ck_assert_uint_eq(hash[0], hash[1]);
    model_free(&m);
}
END_TEST

START_TEST(refusals) {
    model m;
    model_make(&m, MODEL_TORUS, 500, &blockings[0]);
    mn_session_desc desc = model_desc(&m);
    mn_session *s;
    mn_status st = {0};
    desc.ram_bytes = 1 << 20;
    ck_assert_int_eq(mn_session_open(&desc, &s, &st), MN_CAP_TOO_SMALL);
    ck_assert_ptr_null(s);
    desc.ram_bytes = 0;
    desc.k = 1;
    st = (mn_status){0};
    ck_assert_int_eq(mn_session_open(&desc, &s, &st), MN_USAGE);
    desc.k = 0;
    desc.path = "no-such-file.mnt";
    st = (mn_status){0};
    ck_assert_int_eq(mn_session_open(&desc, &s, &st), MN_BAD_INPUT);
    model_free(&m);
}
END_TEST

/* ---- files that lie ----------------------------------------------------------------------------
 */

/* Changes a bit or two of a block's payload and seals it again, so that only meaning is wrong. */
static uint32_t corrupt(unsigned char *block, uint64_t build_id) {
    mni_frame frame;
    mni_frame_get(block, &frame);
    uint32_t self[2], from = mni_frame_payload_at(frame.refs);
    memcpy(self, block + 24, sizeof self);
    for (int bit = 0; bit < 1 + (int)(model_random() % 2); bit++) {
        uint64_t at = from + model_random() % (frame.payload_bytes - from);
        block[at] ^= (unsigned char)(1u << (model_random() % 8));
    }
    mni_frame_seal(block, &frame, (mn_block_ref){self[0], self[1]}, build_id);
    return self[1];
}

static void write_bytes(const char *path, const unsigned char *bytes, size_t count) {
    FILE *f = fopen(path, "wb");
    ck_assert_ptr_nonnull(f);
    ck_assert_uint_eq(fwrite(bytes, 1, count, f), count);
    ck_assert_int_eq(fclose(f), 0);
}

/* A quarter of all blocks lies: either the file is refused, or it is navigated with what holds. */
START_TEST(lying_blocks) {
    model m;
    model_make(&m, (model_shape)(_i % MODEL_SHAPES), 400, &blockings[0]);
    size_t count = m.header.file_bytes;
    unsigned char *whole = malloc(count), *bytes = malloc(count);
    ck_assert(whole != NULL && bytes != NULL);
    FILE *f = fopen(m.path, "rb");
    ck_assert(f != NULL && fread(whole, 1, count, f) == count);
    fclose(f);
    uint32_t opened = 0;
    uint64_t missed = 0;
    for (int round = 0; round < 25; round++) {
        memcpy(bytes, whole, count);
        for (size_t at = BLOCK_BYTES; at < count;) {
            uint32_t pages;
            memcpy(&pages, bytes + at + 28, sizeof pages);
            bool root = at / BLOCK_BYTES == m.header.root[0].block.id;
            if (model_random() % (root ? 40 : 4) == 0)
                corrupt(bytes + at, m.header.build_id);
            at += pages * (size_t)BLOCK_BYTES;
        }
        write_bytes(m.path, bytes, count);
        mn_session_desc desc = model_desc(&m);
        desc.store = (mn_store_kind)(round % 3);
        desc.io = MN_IO_SIM;
        desc.closed = false; /* what it says of its simplices may be another mesh */
        mn_session *s;
        mn_status st = {0};
        mn_code code = mn_session_open(&desc, &s, &st);
        ck_assert(code == MN_OK || code == MN_BAD_INPUT);
        if (code != MN_OK)
            continue;
        opened++;
        for (int i = 0; i < 8; i++) {
            mn_camera camera = model_camera(&m, 0.2 * i, i % 2 ? 1.1 : 30);
            mn_frame_stats stats;
            mn_session_set_tolerance(s, i % 4 == 3 ? -1 : 1);
            mn_session_frame(s, &camera, &stats);
            mn_session_check(s);
            missed += stats.misses;
        }
        mn_session_set_tolerance(s, INFINITY);
        mn_camera camera = model_camera(&m, 0, 2);
        ck_assert_uint_lt(mn_session_settle(s, &camera, ENOUGH), ENOUGH);
        mn_session_close(s);
    }
    ck_assert_uint_gt(opened, 5);
    ck_assert_uint_gt(missed, 0);
    free(whole);
    free(bytes);
    model_free(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("session");
    TCase *tc = tcase_create("session");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, one_front_in_all_stores, 0, MODEL_SHAPES);
    tcase_add_loop_test(tc, image_and_foldovers, 0, MODEL_SHAPES);
    tcase_add_loop_test(tc, figures, 0, 2);
    tcase_add_loop_test(tc, opening, 0, MODEL_SHAPES);
    tcase_add_loop_test(tc, first_camera, 0, MODEL_SHAPES);
    tcase_add_test(tc, refusals);
    tcase_add_loop_test(tc, lying_blocks, 0, MODEL_SHAPES);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
