/* Goal: the camera is looked ahead of as it goes, not where it has jumped or stands; what lies
 * below a block is rated as its nodes are; and whatever the camera does, prefetching costs nothing
 * but reads. Method: cameras made here; ratings against the tree itself; a model on the simulated
 * disk with jumps, reversals and stops, in all three ways of prefetching. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "block.h"
#include "frame.h"
#include "model.h"
#include "navigate.h"
#include "suite.h"

static mn_camera camera_at(float x) {
    return (mn_camera){.eye = {x, 0, 10}, .target = {0, 0, 0}, .up = {0, 1, 0}, .fov_y_deg = 45};
}

static bool look(mni_ahead *ahead, float x) {
    mn_camera camera = camera_at(x);
    mni_lens lens;
    mni_lens_make(&lens, &camera, 640, 480, mni_lens_distance_min(5), 1, NULL);
    mni_ahead_begin(ahead, &camera, &lens, 640, 480, 5, NULL, 5);
    return ahead->look.moves;
}

START_TEST(moves_jumps_and_stops) {
    mni_ahead ahead = {.has_last = false};
    ck_assert(!look(&ahead, 0)); /* nothing is known yet */
    for (int i = 1; i < 10; i++) {
        ck_assert(look(&ahead, 0.1f * (float)i));
        double x = 0.1 * i + 0.1 * MNI_AHEAD_HORIZON;
        ck_assert_double_eq_tol(ahead.look.ahead.eye[0], x, 1e-4);
    }
    ck_assert(look(&ahead, 0.8f)); /* back */
    ck_assert_double_eq_tol(ahead.look.ahead.eye[0], 0.8 - 0.1 * MNI_AHEAD_HORIZON, 1e-4);
    ck_assert(!look(&ahead, 0.8f)); /* stands */
    ck_assert_mem_eq(&ahead.look.now, &ahead.look.ahead, sizeof(mni_lens));
    ck_assert(!look(&ahead, 4)); /* jumps */
    ck_assert(look(&ahead, 4.1f));
    ck_assert(look(&ahead, 4.3f)); /* faster, but no jump */
}
END_TEST

/* What is wanted now and what will be differ by the camera alone: how far away the unknown is taken
 * to be has given way for both. (Ahead it had not, so that what nobody wanted any more was read.)
 */
START_TEST(ahead_gives_way_as_now) {
    mni_ahead ahead = {.has_last = false};
    for (int i = 0; i < 3; i++) {
        mn_camera camera = camera_at(0.1f * (float)i);
        mni_lens lens;
        mni_lens_make(&lens, &camera, 640, 480, 1000 * mni_lens_distance_min(5), 1, NULL);
        mni_ahead_begin(&ahead, &camera, &lens, 640, 480, 5, NULL, 5);
        ck_assert(ahead.look.ahead.distance_min == lens.distance_min);
    }
    ck_assert(ahead.look.moves);
    ck_assert(ahead.there.distance_min == ahead.look.now.distance_min);
    ck_assert(ahead.soon.lens.distance_min == ahead.look.now.distance_min);
}
END_TEST

/* Long steps that are alike are motion from the second on; to and fro over the model they are
 * jumps, however often. */
START_TEST(fast_is_no_jump) {
    mni_ahead ahead = {.has_last = false};
    for (int i = 0; i < 10; i++)
        ck_assert(look(&ahead, 2 * (float)i) == (i > 1));
    for (int i = 0; i < 10; i++)
        ck_assert(!look(&ahead, i % 2 == 0 ? -20 : 20));
}
END_TEST

/* On a circle the camera is found near it, where a straight line leads well outside. */
START_TEST(turns_stay_turns) {
    mni_ahead ahead = {.has_last = false};
    const double step = 0.02;
    for (int i = 0; i < 20; i++) {
        mn_camera camera = camera_at(0);
        mni_lens lens;
        camera.eye[0] = (float)(10 * sin(step * i));
        camera.eye[2] = (float)(10 * cos(step * i));
        mni_lens_make(&lens, &camera, 640, 480, mni_lens_distance_min(5), 1, NULL);
        mni_ahead_begin(&ahead, &camera, &lens, 640, 480, 5, NULL, 10);
        if (i < 2)
            continue;
        const double *there = ahead.look.ahead.eye;
        const double angle = step * (i + MNI_AHEAD_HORIZON);
        const double off = hypot(there[0] - 10 * sin(angle), there[2] - 10 * cos(angle));
        const double straight = 10 * (1 / cos(step * MNI_AHEAD_HORIZON) - 1);
        ck_assert_double_lt(off, 0.5 * straight);
        ck_assert(ahead.frames == (ahead.near ? MNI_AHEAD_NEAR : MNI_AHEAD_HORIZON));
    }
}
END_TEST

/* What the session does along a path of `frames` cameras; settles at its end. */
typedef struct outcome {
    uint64_t hash;
    mn_session_stats stats;
} outcome;

static mn_camera path_at(const model *m, int path, int frame) {
    switch (path) {
    case 0: /* round, with a jump to the other side now and then */
        return model_camera(m, 0.004 * frame + (frame / 20 % 2) * 0.5, 1.3);
    case 1: /* to and fro */
        return model_camera(m, 0.003 * (frame % 30 < 15 ? frame % 15 : 15 - frame % 15), 1.2);
    case 2: /* stops */
        return model_camera(m, 0.01 * (frame / 10), 1.2);
    }
    return model_camera(m, 0.1, 1.1 + 2 * fabs(cos(0.05 * frame))); /* in and out */
}

static outcome fly(const mn_session_desc *desc, const model *m, int path) {
    enum { FRAMES = 90 };
    outcome out;
    memset(&out, 0, sizeof out);
    mn_session *s = model_open(desc);
    mn_frame_stats frame = {0};
    mn_camera camera = {0};
    for (int i = 0; i < FRAMES; i++) {
        camera = path_at(m, path, i);
        mn_session_frame(s, &camera, &frame);
        if (i % 10 == 0)
            mn_session_check(s);
    }
    (void)mn_session_settle(s, &camera, 1000);
    mn_session_stats before;
    mn_session_stats_get(s, &before);
    for (int i = 0; i < 5; i++)
        mn_session_frame(s, &camera, &frame);
    mn_session_drain(s);
    mn_session_stats_get(s, &out.stats);
    ck_assert_uint_eq(before.reads, out.stats.reads); /* a camera that stands reads nothing */
    ck_assert(!frame.changed);
    out.hash = frame.front_hash;
    mn_session_set_tolerance(s, INFINITY);
    (void)mn_session_settle(s, &camera, 1000);
    ck_assert(mn_session_at_roots(s));
    mn_session_close(s);
    return out;
}

START_TEST(jumps_reversals_and_stops) {
    static const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};
    model m;
    model_make(&m, MODEL_GLOBE, 6000, &blocks);
    mn_session_desc desc = model_desc(&m);
    outcome resident = fly(&desc, &m, _i);
    desc.store = MN_STORE_PAGED;
    desc.io = MN_IO_SIM;
    desc.fps = 60;
    desc.degrade_off = true;
    uint64_t misses[3];
    for (int p = 0; p < 3; p++) {
        desc.prefetch = (mn_prefetch)p;
        desc.k = 0;
        outcome roomy = fly(&desc, &m, _i), again = fly(&desc, &m, _i);
        ck_assert_uint_eq(roomy.hash, resident.hash);
        ck_assert_mem_eq(&roomy.stats, &again.stats, sizeof roomy.stats);
        ck_assert_uint_le(roomy.stats.prefetches_used, roomy.stats.prefetches_loaded);
        if (p == MN_PREFETCH_OFF)
            ck_assert_uint_eq(roomy.stats.prefetches, 0);
        misses[p] = roomy.stats.misses;
        desc.k = MN_K_MIN;
        (void)fly(&desc, &m, _i);
    }
    ck_assert_uint_le(misses[MN_PREFETCH_AHEAD], misses[MN_PREFETCH_OFF]);
    model_free(&m);
}
END_TEST

/* Where nothing is missed, a front whose camera moves has all that is wanted, and some of what will
 * be; as soon as it stands, that alone which is wanted. */
START_TEST(splits_early_while_it_moves) {
    enum { FRAMES = 60, STANDS = 4 };
    static const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};
    model m;
    model_make(&m, MODEL_GLOBE, 6000, &blocks);
    mn_session_desc desc = model_desc(&m);
    mn_session *resident = model_open(&desc);
    desc.store = MN_STORE_PAGED;
    desc.io = MN_IO_SIM;
    desc.fps = 60;
    desc.degrade_off = true;
    mn_session *paged = model_open(&desc);
    uint32_t more = 0, complete = 0;
    for (int i = 0; i < FRAMES; i++) {
        mn_frame_stats want, have;
        const int moves = i < FRAMES - STANDS ? i : FRAMES - STANDS - 1;
        const mn_camera camera = model_camera(&m, 0.002 * moves, 3 - 0.03 * moves);
        mn_session_frame(resident, &camera, &want);
        mn_session_frame(paged, &camera, &have);
        mn_session_check(paged);
        if (have.misses > 0 || have.refused_pool > 0)
            continue;
        complete++;
        ck_assert_uint_ge(have.active_nodes, want.active_nodes);
        ck_assert_double_le(have.error_px, want.error_px);
        more += have.active_nodes > want.active_nodes;
        if (i == FRAMES - 1)
            ck_assert_uint_eq(have.front_hash, want.front_hash);
    }
    ck_assert_uint_gt(complete, FRAMES / 2);
    ck_assert_uint_gt(more, FRAMES / 4);
    mn_session_close(paged);
    mn_session_close(resident);
    model_free(&m);
}
END_TEST

/* What is said of a reference, and of where the subtrees behind it are, is what the tree says of
 * the nodes there; nothing is said of what is wanted less than asked for. One block: one note at a
 * time. Returns how many exits it has seen. */
static uint32_t check_block(const model *m, const mn_header *header, const mni_look *look,
                            float least, const unsigned char *bytes) {
    static float urgency[4096];
    static mni_notes below[4096];
    mni_frame frame;
    mni_block block;
    uint32_t seen = 0;
    mni_frame_get(bytes, &frame);
    ck_assert_uint_le(frame.refs, 4096);
    mni_block_reopen(&block, bytes);
    for (uint32_t s = 0; s < block.subtrees; s++) {
        mni_subtree subtree;
        mni_block_subtree(&block, s, &subtree);
        const float *root = &m->tree.leaf_position[3 * (size_t)subtree.leaf_lo];
        mni_notes notes = {.count = 0};
        mni_note note = mni_rate_note(s, root);
        mni_notes_add(&notes, &note);
        mni_rate_block(NULL, look, bytes, &notes, least, urgency, below);
        for (uint32_t i = 0; i < frame.refs; i++)
            ck_assert(urgency[i] >= least || (urgency[i] == 0 && below[i].count == 0));
        mni_walk walk;
        mni_node node;
        uint32_t index;
        mni_walk_begin(&walk, &block);
        while (mni_walk_next(&walk, &index, &node)) {
            if (node.at.leaf_lo < subtree.leaf_lo || node.at.leaf_hi > subtree.leaf_hi)
                continue;
            for (int side = 0; side < 2; side++) {
                const mni_child *child = side ? &node.right : &node.left;
                if (child->kind != MNI_CHILD_SUBTREE)
                    continue;
                uint32_t leaf = side ? node.leaf_mid : node.at.leaf_lo;
                const float *at = &m->tree.leaf_position[3 * (size_t)leaf];
                const mni_bounds bounds = {at, child->facts.radius, child->facts.switch_value,
                                           child->facts.cone};
                double own = mni_lens_priority(&look->now, &bounds) / look->now.tolerance_px;
                const mni_notes *known = &below[child->ref];
                bool noted = own < 1.05 * (double)least ||
                             known->count == MNI_NOTES_MAX; /* or a neighbour is */
                for (uint32_t i = 0; i < known->count; i++) {
                    float there[3];
                    memcpy(there, &known->note[i].word[1], sizeof there);
                    bool same = known->note[i].word[0] == child->subtree;
                    for (int k = 0; k < 3; k++)
                        same = same && fabsf(there[k] - at[k]) <= 1.01f * header->grid_step;
                    noted |= same;
                }
                ck_assert(noted);
                if (own >= 1.05 * (double)least)
                    ck_assert_double_ge((double)urgency[child->ref], fmin(0.9 * own, 1));
                seen++;
            }
        }
    }
    return seen;
}

START_TEST(ratings_are_those_of_the_nodes) {
    enum { BLOCK_BYTES = 4096 };
    static const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED,
                                         .block_bytes = BLOCK_BYTES};
    model m;
    model_make(&m, MODEL_GLOBE, 6000, &blocks);
    mn_session_desc desc = model_desc(&m);
    mn_header header;
    mn_status st = {0};
    ck_assert_int_eq(mn_header_read(desc.path, &header, &st), MN_OK);
    mni_look look = {.moves = false};
    mn_camera camera = model_camera(&m, 0.1, 1.3);
    mni_lens_make(&look.now, &camera, 640, 480, mni_lens_distance_min(1), 2, NULL);
    look.ahead = look.now;
    FILE *file = fopen(desc.path, "rb");
    ck_assert_ptr_nonnull(file);
    unsigned char bytes[BLOCK_BYTES];
    uint32_t seen = 0;
    for (uint64_t at = MN_PAGE_BYTES; at < header.file_bytes; at += BLOCK_BYTES) {
        mni_frame frame;
        ck_assert_int_eq(fseek(file, (long)at, SEEK_SET), 0);
        ck_assert_uint_eq(fread(bytes, 1, sizeof bytes, file), sizeof bytes);
        mni_frame_get(bytes, &frame);
        if (frame.kind == MNI_FRAME_METANODE)
            for (int least = 0; least < 3; least++)
                seen += check_block(&m, &header, &look, 0.5f * (float)least, bytes);
    }
    ck_assert_uint_gt(seen, 60);
    fclose(file);
    model_free(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("ahead");
    TCase *tc = tcase_create("ahead");
    tcase_set_timeout(tc, 120);
    tcase_add_test(tc, moves_jumps_and_stops);
    tcase_add_test(tc, ahead_gives_way_as_now);
    tcase_add_test(tc, fast_is_no_jump);
    tcase_add_test(tc, turns_stay_turns);
    tcase_add_loop_test(tc, jumps_reversals_and_stops, 0, 4);
    tcase_add_test(tc, splits_early_while_it_moves);
    tcase_add_test(tc, ratings_are_those_of_the_nodes);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
