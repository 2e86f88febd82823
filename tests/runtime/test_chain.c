/* Goal: what a chain has split that lacks a block stays while the camera moves and there is room,
 * so that nothing is split only to be undone; it goes when nobody needs it; and it is undone where
 * there is no room; and what a frame has missed may come within it. Method: a navigator over a pool
 * whose simulated disk takes several frames, on a path that dives and turns; branches are counted
 * one by one. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "flight.h"
#include "chain.h"
#include "frame.h"
#include "front.h"
#include "scarce.h"
#include "suite.h"

enum { TRIANGLES = 16000, FRAMES = 90, STANDS = 40, DELAY_US = 120000 };
/* the disk; -1: one that is serialised, in a thread of its own */
enum { UNDONE_SHARE = 8 }; /* one in so many splits: 0.106 to 0.116 with three ways to cut blocks */
enum { SERIAL = -1, FAST_US = 1, USUAL = 100000 };

static void over_globe(flight *f, int delay_us, uint32_t nodes_max) {
    static const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};
    const mn_header *header = flight_model(f, TRIANGLES, &blocks);
    const mni_store_desc disk = {.io = delay_us == SERIAL ? MN_IO_PREAD : MN_IO_SIM,
                                 .io_serial = delay_us == SERIAL,
                                 .sim = {.delay_us_max = delay_us > 0 ? (uint32_t)delay_us : 0}};
    flight_open(f, header->blocks, disk, nodes_max);
}

static const mn_header *small_blocks(flight *f) {
    static const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};
    return flight_model(f, TRIANGLES, &blocks);
}

/* A disk that is there within a frame. */
static void with_places(flight *f, uint32_t k) {
    const mni_store_desc disk = {.io = MN_IO_SIM, .sim = {.delay_us_max = FAST_US}};
    flight_open(f, k, disk, NODES_MAX);
}

/* Places for two blocks of five. */
static void short_of_places(flight *f) {
    with_places(f, small_blocks(f)->blocks * 2 / 5);
}

static void fly_to(flight *f, const mn_camera *camera) {
    flight_frame(f, camera, 1);
}

static void fly(flight *f, int frame) {
    const double along = frame / (double)FRAMES;
    const mn_camera camera = model_camera(&f->m, 0.3 * along, 3 - 1.9 * along);
    fly_to(f, &camera);
}

/* Forks that nobody wants, now or in a moment, and that nothing blocks. */
static uint32_t idle(flight *f, bool kept) {
    mni_front *front = &f->nav.front;
    uint32_t count = 0;
    for (uint32_t b = 0; b < front->slots_high; b++) {
        if (!mni_front_is_fork(front, b))
            continue;
        const mni_bounds bounds = mni_front_branch_bounds(front, b);
        count += !mni_lens_wants(&f->nav.lens, &bounds) &&
                 !(f->nav.early && mni_lens_wants(&f->nav.ahead.soon.lens, &bounds)) &&
                 mni_front_collapse_blocker(front, b) == MN_NONE &&
                 (front->branch[b].kept >= f->nav.frame) == kept;
    }
    return count;
}

START_TEST(what_is_split_stays) {
    flight f;
    uint64_t misses = 0, kept = 0;
    over_globe(&f, DELAY_US, NODES_MAX);
    for (int i = 0; i < FRAMES; i++) {
        fly(&f, i);
        misses += f.nav.work.misses;
        if (!f.nav.early)
            continue;
        ck_assert_uint_eq(f.nav.work.undone, 0);
        kept += idle(&f, true);
    }
    ck_assert_uint_gt(misses, 0);
    ck_assert_uint_gt(kept, 0);
    for (int i = 0; i < STANDS; i++)
        fly(&f, FRAMES - 1);
    ck_assert_uint_eq(idle(&f, true) + idle(&f, false), 0);
    flight_close(&f);
}
END_TEST

/* Nobody tries the chain again: the camera turns away. */
START_TEST(what_nobody_needs_goes) {
    flight f;
    uint32_t most = 0;
    over_globe(&f, DELAY_US, NODES_MAX);
    for (int i = 0; i < FRAMES; i++) {
        fly(&f, i);
        for (uint32_t b = 0; b < f.nav.front.slots_high; b++) {
            const uint32_t until = f.nav.front.branch[b].kept;
            if (mni_front_is_branch(&f.nav.front, b))
                ck_assert_uint_le(until, f.nav.frame + MNI_KEPT_FRAMES);
        }
        /* those whose time is over, and that were judged in a frame that could collapse them */
        most = idle(&f, false) > most ? idle(&f, false) : most;
    }
    ck_assert_uint_eq(most, 0);
    flight_close(&f);
}
END_TEST

/* A front that is nearly full keeps nothing, or pieces of chains would have the room of whole ones.
 */
START_TEST(without_room_it_is_undone) {
    flight f;
    uint64_t undone = 0, full = 0;
    over_globe(&f, DELAY_US, 600);
    for (int i = 0; i < FRAMES; i++) {
        fly(&f, i);
        undone += f.nav.work.undone;
        full += mni_navigator_fill(&f.nav) >= MNI_EARLY_FILL;
        ck_assert_uint_le(f.nav.front.active, 600);
    }
    ck_assert_uint_gt(full, 0);
    ck_assert_uint_gt(undone, 0);
    flight_close(&f);
}
END_TEST

/* In rounds of so many operations. */
static mni_work fly_in_rounds(int delay_us, double round_ops) {
    flight f;
    mni_work sum = {0};
    over_globe(&f, delay_us, NODES_MAX);
    f.nav.round_ops = round_ops;
    for (int i = 0; i < FRAMES; i++) { /* in and out, so fast that foresight comes too late */
        const mn_camera camera = model_camera(&f.m, 0.02 * i, 1.1 + 4 * fabs(cos(0.3 * i)));
        f.nav.usual = USUAL; /* no frame is too long for what is early */
        fly_to(&f, &camera);
        sum.misses += f.nav.work.misses;
        sum.splits += f.nav.work.splits;
        sum.collapses += f.nav.work.collapses;
        sum.undone += f.nav.work.undone;
    }
    flight_close(&f);
    return sum;
}

/* A disk that is faster than a frame: what was missed comes within it. The same figures twice, also
 * where a thread reads. */
START_TEST(missed_again_in_the_frame) {
    const int delay_us = _i == 0 ? FAST_US : SERIAL;
    const mni_work once = fly_in_rounds(delay_us, INFINITY), often = fly_in_rounds(delay_us, 1),
                   again = fly_in_rounds(delay_us, 1);
    ck_assert_uint_gt(once.misses, 0);
    ck_assert_uint_lt(often.misses, once.misses);
    ck_assert_uint_eq(often.misses, again.misses);
    ck_assert_uint_eq(often.splits, again.splits);
    ck_assert_uint_eq(often.collapses, again.collapses);
    ck_assert_uint_eq(often.undone, again.undone);
}
END_TEST

/* What the last frame of a flight does, in rounds or without, where the front has so much room and
 * the disk is there at once. */
static mni_work last_frame(double round_ops, uint32_t nodes_max) {
    enum { LAST = 5 }; /* so much more is wanted there that some lacks a block */
    flight f;
    over_globe(&f, SERIAL, nodes_max);
    for (int i = 0; i <= LAST; i++) {
        const mn_camera camera = model_camera(&f.m, 0.02 * i, 1.1 + 4 * fabs(cos(0.3 * i)));
        f.nav.usual = USUAL;
        f.nav.round_ops = i < LAST ? INFINITY : round_ops;
        fly_to(&f, &camera);
    }
    const mni_work work = f.nav.work;
    flight_close(&f);
    return work;
}

/* Who lacked a block in his turn is a miss, also where the front has filled up before he has had
 * another one: that of all of them one is seen to be refused for want of room is no reason for the
 * others. */
START_TEST(a_miss_is_no_want_of_room) {
    int filled = 0;
    for (uint32_t nodes_max = 1600; nodes_max < 2600; nodes_max += 80) {
        const mni_work once = last_frame(INFINITY, nodes_max), again = last_frame(1, nodes_max);
        const uint64_t more = again.splits - once.splits;
        ck_assert_uint_ge(again.misses + 1 + more, once.misses);
        filled += again.refused_front > once.refused_front && once.misses > 1 + more;
    }
    ck_assert_int_gt(filled, 0);
}
END_TEST

/* A camera that turns over a globe which needs more blocks than there are places. */
static void turn_short(flight *f, int frame) {
    const mn_camera camera = model_camera(&f->m, 0.05 * frame, 1.6);
    flight_frame(f, &camera, 0.5);
}

/* The chain of an active node, found whatever is known of the room; what it splits is undone. */
static mni_outcome chain_by_splitting(flight *f, uint32_t slot) {
    uint32_t count = 0;
    f->nav.early_splits = true;
    const mni_outcome outcome = mni_chain_find(&f->nav, slot, &count);
    f->nav.early_splits = false;
    while (count > 0)
        mni_front_unsplit(&f->nav.front, f->nav.chain[--count]);
    mni_store_attempt_over(f->store);
    return outcome;
}

/* Whose chain is known to find no room, without a split, would be refused; or lack a block, since
 * it is asked for them one after the other, and not for all. */
START_TEST(no_room_is_known_before) {
    flight f;
    uint32_t known = 0, refused = 0, who, all;
    short_of_places(&f);
    for (int i = 0; i < FRAMES; i++) {
        turn_short(&f, i);
        mni_front *front = &f.nav.front;
        for (uint32_t slot = 0; i % 8 == 0 && slot < front->slots_high; slot++) {
            if (!mni_front_is_active(front, slot) || mni_front_is_leaf(front, slot))
                continue;
            f.nav.stack[0] = mni_front_ref_of(front, slot);
            f.nav.pusher[0] = MNI_NOBODY;
            const uint64_t version = front->version, before = f.nav.work.undone;
            const bool is = mni_scarce_begin(&f.nav, &all, &who);
            mni_store_attempt_over(f.store);
            ck_assert_uint_eq(front->version, version);
            ck_assert_uint_eq(f.nav.work.undone, before);
            if (!is)
                continue;
            known++;
            const mni_outcome outcome = chain_by_splitting(&f, slot);
            ck_assert(outcome == MNI_REFUSED_POOL || outcome == MNI_MISS);
            refused += outcome == MNI_REFUSED_POOL;
        }
    }
    ck_assert_uint_gt(known, 1000);
    ck_assert_uint_gt(2 * refused, known);
    flight_close(&f);
}
END_TEST

/* So few are split in vain, over pools from a third to half of the blocks: in one of them it is a
 * matter of how the blocks are cut. (A quarter, where nothing is known before.) */
START_TEST(few_splits_are_in_vain) {
    uint64_t undone = 0, splits = 0;
    for (uint32_t share = 34; share <= 50; share += 4) {
        flight f;
        with_places(&f, small_blocks(&f)->blocks * share / 100);
        for (int i = 0; i < FRAMES; i++) {
            turn_short(&f, i);
            undone += f.nav.work.undone;
            splits += f.nav.work.splits;
        }
        flight_close(&f);
    }
    ck_assert_uint_gt(splits, 0);
    ck_assert_msg(UNDONE_SHARE * undone < splits, "%ju splits, %ju undone", (uintmax_t)splits,
                  (uintmax_t)undone);
}
END_TEST

/* Who is found before the first split is to be split: each is above the one for whose sake he was
 * found on the stack, has a higher order id, and is gone when the chain has gone through. */
START_TEST(who_is_found_is_split) {
    enum { FOUND_MAX = 256 };
    flight f;
    mni_front_ref found[FOUND_MAX];
    uint32_t who, all, count, gone = 0;
    short_of_places(&f);
    for (int i = 0; i < FRAMES; i++) {
        turn_short(&f, i);
        mni_navigator *nav = &f.nav;
        for (uint32_t slot = 0; i % 8 == 0 && slot < nav->front.slots_high; slot++) {
            if (!mni_front_is_active(&nav->front, slot) || mni_front_is_leaf(&nav->front, slot))
                continue;
            nav->stack[0] = mni_front_ref_of(&nav->front, slot);
            nav->pusher[0] = MNI_NOBODY;
            const bool is = mni_scarce_begin(nav, &all, &who);
            mni_store_attempt_over(f.store);
            if (is)
                continue;
            ck_assert_uint_le(all, FOUND_MAX);
            memcpy(found, nav->stack, all * sizeof *found);
            for (uint32_t at = 1; at < all; at++) {
                ck_assert_uint_lt(nav->pusher[at], at);
                ck_assert_uint_gt(found[at].order, found[nav->pusher[at]].order);
            }
            if (mni_chain_find(nav, slot, &count) == MNI_DONE) {
                ck_assert_uint_ge(count, all);
                for (uint32_t at = 0; at < all; at++)
                    ck_assert(!mni_front_stands(&nav->front, found[at]));
                gone += all - 1;
            }
            while (count > 0)
                mni_front_unsplit(&nav->front, nav->chain[--count]);
            mni_store_attempt_over(f.store);
        }
    }
    ck_assert_uint_gt(gone, 100);
    flight_close(&f);
}
END_TEST

/* While the camera stands a chain is refused for what it has asked for, not for what is counted:
 * its own grants are room that it has, and so every round of reads ends in a switch or a refusal.
 */
START_TEST(a_still_camera_asks) {
    flight f;
    uint32_t all, who, refused = 0;
    short_of_places(&f);
    for (int i = 0; i < FRAMES; i++) {
        turn_short(&f, i / 10);
        const mni_front *front = &f.nav.front;
        refused += i % 10 != 0 && f.nav.work.refused_pool > 0;
        for (uint32_t slot = 0; i % 10 != 0 && slot < front->slots_high; slot++) {
            if (!mni_front_is_active(front, slot) || mni_front_is_leaf(front, slot))
                continue;
            f.nav.stack[0] = mni_front_ref_of(front, slot);
            f.nav.pusher[0] = MNI_NOBODY;
            ck_assert(!mni_scarce_begin(&f.nav, &all, &who) && all == 1);
        }
    }
    ck_assert_uint_gt(refused, 0);
    flight_close(&f);
}
END_TEST

/* One in four references of a block to others says that these are longer than any place. */
static void lie(unsigned char *block, const mn_header *header) {
    mni_frame frame;
    uint32_t self[2];
    mni_frame_get(block, &frame);
    memcpy(self, block + 24, sizeof self);
    for (uint32_t i = 3; i < frame.refs; i += 4) {
        mn_block_ref ref = mni_frame_ref(block, i);
        ref.pages = header->block_bytes_max / MN_PAGE_BYTES + 1;
        if (((uint64_t)ref.id + ref.pages) * MN_PAGE_BYTES <= header->file_bytes)
            mni_frame_set_ref(block, i, ref);
    }
    mni_frame_seal(block, &frame, (mn_block_ref){self[0], self[1]}, header->build_id);
}

/* A child that no place could hold is absent for ever: nobody asks for it, and it finds no room
 * wanting. */
START_TEST(what_no_place_could_hold_is_not_sought) {
    flight f;
    const mn_header *header = small_blocks(&f);
    unsigned char *block = malloc(header->block_bytes_max);
    FILE *file = fopen(f.m.path, "r+b");
    ck_assert(block != NULL && file != NULL);
    for (uint64_t at = MN_PAGE_BYTES; at < header->file_bytes; at += MN_PAGE_BYTES) {
        ck_assert_int_eq(fseek(file, (long)at, SEEK_SET), 0);
        ck_assert_uint_eq(fread(block, 1, MN_PAGE_BYTES, file), MN_PAGE_BYTES);
        lie(block, header);
        ck_assert_int_eq(fseek(file, (long)at, SEEK_SET), 0);
        ck_assert_uint_eq(fwrite(block, 1, MN_PAGE_BYTES, file), MN_PAGE_BYTES);
    }
    ck_assert_int_eq(fclose(file), 0);
    free(block);
    with_places(&f, mni_store_k_min(header) + 16); /* one is for what is to come */
    uint64_t refused = 0;
    for (int i = 0; i < FRAMES; i++) {
        turn_short(&f, i);
        refused += f.nav.work.refused_pool;
    }
    ck_assert_uint_gt(refused, 0);
    flight_close(&f);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("chain");
    TCase *tc = tcase_create("chain");
    tcase_set_timeout(tc, 120);
    tcase_add_test(tc, what_is_split_stays);
    tcase_add_test(tc, what_nobody_needs_goes);
    tcase_add_test(tc, without_room_it_is_undone);
    tcase_add_loop_test(tc, missed_again_in_the_frame, 0, 2);
    tcase_add_test(tc, a_miss_is_no_want_of_room);
    tcase_add_test(tc, no_room_is_known_before);
    tcase_add_test(tc, few_splits_are_in_vain);
    tcase_add_test(tc, who_is_found_is_split);
    tcase_add_test(tc, a_still_camera_asks);
    tcase_add_test(tc, what_no_place_could_hold_is_not_sought);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
