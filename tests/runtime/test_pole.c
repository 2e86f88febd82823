/* Goal: a node of hundreds of corners and more answers as all of its simplices would, through every
 * change around it, and however few chunks there are; and no move looks through it. Method: random
 * moves about such nodes, answers against a walk through all simplices; a count of the corners that
 * are looked at, on models of more and more neighbours. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>

#include "corners.h"
#include "front_rig.h"
#include "pole.h"
#include "suite.h"

static const mn_block_desc levels_5 = {.blocking = MN_BLOCKING_LEVELS, .l = 5};
static const model_shape shapes[] = {MODEL_GLOBE, MODEL_PENCIL, MODEL_LOOSE};
enum { SHAPES = sizeof shapes / sizeof *shapes, LOOKED_MAX = 60 };

static bool split_at(rig *r, uint32_t slot) {
    uint32_t branch;
    if (!mni_front_is_active(&r->front, slot) || mni_front_is_leaf(&r->front, slot))
        return false;
    if (mni_front_split_blocker(&r->front, slot) != MN_NONE)
        return false;
    ck_assert_int_eq(mni_front_split(&r->front, slot, &branch), MNI_DONE);
    mni_front_release(&r->front, branch);
    return true;
}

static bool collapse_at(rig *r, uint32_t fork) {
    if (!mni_front_is_fork(&r->front, fork))
        return false;
    if (mni_front_collapse_blocker(&r->front, fork) != MN_NONE)
        return false;
    ck_assert_int_eq(mni_front_collapse(&r->front, fork), MNI_DONE);
    return true;
}

/* To full detail, or to the roots. Returns the number of moves. */
static uint64_t go(rig *r, bool finer) {
    uint64_t moves = 0, before;
    do {
        before = moves;
        for (uint32_t at = 0; at < r->front.slots_high; at++)
            moves += finer ? split_at(r, at) : collapse_at(r, at);
    } while (moves > before);
    return moves;
}

static uint32_t poles_of(const mni_front *f) {
    uint32_t count = 0;
    for (uint32_t p = f->poles; p != MN_NONE; p = f->chunk[p].pole.next)
        count++;
    return count;
}

/* ---- answers --------------------------------------------------------------------------------- */

static bool fits(const mni_front *f, uint32_t slot, uint32_t order, uint32_t above) {
    return f->node[slot].order > order || f->node[slot].above < above;
}

/* Is there a neighbour that fits, by all simplices? */
static bool is_blocked(const mni_front *f, uint32_t slot, uint32_t order, uint32_t above) {
    for (uint32_t s = 1; s < f->simplices_high; s++) {
        const uint32_t *node = &f->simplex_node[3 * (size_t)s];
        if (node[0] == MN_NONE || (node[0] != slot && node[1] != slot && node[2] != slot))
            continue;
        for (int k = 0; k < 3; k++)
            if (node[k] != slot && node[k] != MN_NONE && fits(f, node[k], order, above))
                return true;
    }
    return false;
}

static void check_answers(rig *r) {
    mni_front *f = &r->front;
    mni_front_ref found[16];
    mni_front_check(f);
    for (uint32_t p = f->poles; p != MN_NONE; p = f->chunk[p].pole.next) {
        const uint32_t slot = f->chunk[p].pole.slot;
        for (int i = 0; i < 6; i++) {
            const uint32_t limit = (uint32_t)(model_random() % (2 * r->m.header.leaves));
            const uint32_t order = i % 2 ? MN_NONE : limit, above = i % 2 ? limit : 0;
            const uint32_t count = mni_pole_seek(f, slot, order, above, found, 16);
            ck_assert((count > 0) == is_blocked(f, slot, order, above));
            for (uint32_t k = 0; k < count; k++)
                ck_assert(fits(f, found[k].slot, order, above));
        }
    }
}

/* Random moves, some of them undone; there and back. Returns the most poles at a time. */
static uint32_t wander(rig *r) {
    uint32_t most = 0, branch;
    for (int phase = 0; phase < 4; phase++) {
        for (int i = 0; i < 4000; i++) {
            const uint32_t at = (uint32_t)(model_random() % r->front.slots_high);
            if (model_uniform(0, 1) < (phase % 2 ? 0.3 : 0.7))
                split_at(r, at);
            else
                collapse_at(r, at);
            if (i % 400 == 0)
                check_answers(r);
        }
        (void)go(r, phase % 2 == 0);
        for (uint32_t at = 0, undone = 0; at < r->front.slots_high && undone < 20; at++)
            if (mni_front_is_active(&r->front, at) && !mni_front_is_leaf(&r->front, at) &&
                mni_front_split_blocker(&r->front, at) == MN_NONE) {
                ck_assert_int_eq(mni_front_split(&r->front, at, &branch), MNI_DONE);
                mni_front_unsplit(&r->front, branch);
                undone++;
            }
        check_answers(r);
        most = poles_of(&r->front) > most ? poles_of(&r->front) : most;
    }
    ck_assert_uint_eq(r->front.active, r->m.header.roots);
    ck_assert_uint_eq(r->front.chunks_used, 0);
    return most;
}

START_TEST(answers) {
    rig r;
    rig_open(&r, shapes[_i], shapes[_i] == MODEL_GLOBE ? 6000 : 700, &levels_5);
    ck_assert_uint_eq(wander(&r), shapes[_i] == MODEL_LOOSE ? 1 : 2);
    rig_close(&r);
}
END_TEST

/* With chunks for lists and no more, trees stay small, and poles become lists again. */
START_TEST(few_chunks) {
    rig r;
    rig_open(&r, MODEL_PENCIL, 1500, &levels_5);
    r.front.chunks_max = 2 * 1500 / MNI_FRONT_CHUNK + 4;
    (void)wander(&r);
    (void)go(&r, true);
    ck_assert_uint_lt(poles_of(&r.front), 2);
    check_answers(&r);
    rig_close(&r);
}
END_TEST

/* The corner, at the pole of the larger order id, of a simplex that two poles share; 0: none. */
static uint32_t shared_corner(const mni_front *f) {
    for (uint32_t s = 1; f->poles != MN_NONE && s < f->simplices_high; s++) {
        const uint32_t *node = &f->simplex_node[3 * (size_t)s];
        uint32_t poles = 0, corner = 0, order = 0;
        for (uint32_t k = 0; node[0] != MN_NONE && k < 3; k++)
            if (node[k] != MN_NONE && mni_front_is_pole(&f->node[node[k]])) {
                poles++;
                corner = f->node[node[k]].order > order ? 4 * s + k : corner;
                order = f->node[mni_corner_slot(f, corner)].order;
            }
        if (poles == 2)
            return corner;
    }
    return 0;
}

/* A pole that becomes a list again, since there is no chunk for the corner that it is given, is
 * seen by the pole next to it, with which it shares nothing else. */
START_TEST(gives_way_beside_a_pole) {
    rig r;
    uint32_t corner = 0;
    mni_front_ref found[4];
    rig_open(&r, MODEL_PAIR, 1200, &levels_5);
    mni_front *f = &r.front;
    while (f->active < r.m.header.leaves && corner == 0) {
        for (uint32_t at = 0; at < f->slots_high; at++)
            if (model_uniform(0, 1) < 0.5)
                split_at(&r, at);
        corner = shared_corner(f);
    }
    ck_assert_uint_ne(corner, 0);
    const uint32_t chunks_max = f->chunks_max, slot = mni_corner_slot(f, corner);
    const uint32_t after = mni_corner_slot(f, mni_corner_after(corner));
    const uint32_t before = mni_corner_slot(f, mni_corner_before(corner));
    const uint32_t other = mni_front_is_pole(&f->node[after]) ? after : before;
    const uint32_t order = f->node[slot].order - 1;
    ck_assert_uint_eq(mni_pole_seek(f, other, order, 0, found, 4), 1); /* bounds are the best now */
    mni_corners_remove(f, slot, corner);
    f->chunks_max = f->chunks_used + 1;
    mni_corners_push(f, slot, corner);
    f->chunks_max = chunks_max;
    ck_assert(!mni_front_is_pole(&f->node[slot]) && mni_front_is_pole(&f->node[other]));
    ck_assert_uint_eq(mni_pole_seek(f, other, order, 0, found, 4), 1);
    ck_assert_uint_eq(found[0].slot, slot);
    check_answers(&r);
    rig_close(&r);
}
END_TEST

/* ---- costs ----------------------------------------------------------------------------------- */

/* Corners looked at for each move, there and back, whatever the number of neighbours. */
START_TEST(no_move_looks_through_a_pole) {
#ifdef MN_SLOW_CHECKS
    for (uint32_t triangles = 1000; triangles <= 4000; triangles *= 2) {
        rig r;
        rig_open(&r, shapes[_i], triangles * (shapes[_i] == MODEL_GLOBE ? 12 : 1), &levels_5);
        const uint64_t moves = go(&r, true) + go(&r, false);
        const double looked = (double)r.front.looked / (double)moves;
        printf("shape %d, %u: %.1f corners a move\n", (int)shapes[_i], triangles, looked);
        ck_assert_uint_gt(moves, triangles);
        ck_assert(looked < LOOKED_MAX);
        rig_close(&r);
    }
#endif
}
END_TEST

int main(void) {
    Suite *suite = suite_create("pole");
    TCase *tc = tcase_create("pole");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, answers, 0, SHAPES);
    tcase_add_test(tc, few_chunks);
    tcase_add_test(tc, gives_way_beside_a_pole);
    tcase_add_loop_test(tc, no_move_looks_through_a_pole, 0, SHAPES);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
