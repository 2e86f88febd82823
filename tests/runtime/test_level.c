/* Goal: the search for a tolerance ends at the lowest level that fits, from wherever it starts, and
 * in motion moves evenly, up and back. Method: worlds whose room is a formula, so that the level
 * that it ends at is known; random ones with a seed; no front. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "level.h"
#include "suite.h"

enum { FRAMES_MAX = 1000 };

static uint64_t random_state;

static uint64_t below(uint64_t n) {
    random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (random_state >> 33) % n;
}

/* Everything below `lowest` is too low. The error of what is refused is anything above. */
static mni_level_signs look(int level, int lowest, bool knows_errors, bool knows_fill) {
    mni_level_signs s = {.full = level < lowest};
    if (s.full && knows_errors)
        s.refused.px = exp2((double)(lowest + (int)below(200)) / MNI_LEVELS_A_DOUBLING);
    s.refused.away = INFINITY;
    s.box_away = 1;
    if (knows_fill)
        s.fill = s.full ? 1 : exp2((double)(lowest - level) / MNI_LEVELS_A_DOUBLING);
    return s;
}

/* Frames with a standing camera until settled. */
static int stand(mni_level *l, int lowest, bool knows_errors, bool knows_fill) {
    bool too_low[MNI_LEVEL_MAX + 1] = {false};
    int frames = 0;
    do {
        mni_level_signs s = look(l->level, lowest, knows_errors, knows_fill);
        s.moved = frames == 0;
        ck_assert_msg(!too_low[l->level], "level %d again", l->level); /* or it would thrash */
        too_low[l->level] = s.full;
        mni_level_next(l, 1, &s);
        frames++;
    } while (!l->settled && frames < FRAMES_MAX);
    return frames;
}

START_TEST(the_lowest_that_fits) {
    for (int i = 0; i < 2000; i++) {
        mni_level l;
        mni_level_open(&l);
        l.level = (int)below(below(2) ? 10 : MNI_LEVEL_MAX + 1);
        int lowest = below(8) == 0 ? 0 : (int)below(MNI_LEVEL_MAX + 1), start = l.level;
        int frames = stand(&l, lowest, _i & 1, _i & 2);
        ck_assert_int_eq(l.level, lowest);
        ck_assert_int_le(frames, abs(lowest - start) / MNI_LEVEL_STRIDE + 30);
        for (int again = 0; again < 20; again++) { /* and there it stays */
            mni_level_signs s = look(l.level, lowest, _i & 1, _i & 2);
            mni_level_next(&l, 1, &s);
            ck_assert(l.settled && l.level == lowest);
        }
    }
}
END_TEST

/* A front made in one frame says where the tolerance must be. */
START_TEST(at_once_from_scratch) {
    mni_level l;
    mni_level_open(&l);
    mni_level_signs s = {.moved = true, .full = true, .from_scratch = true};
    s.refused.px = 64; /* six doublings above the tolerance */
    s.refused.away = INFINITY;
    s.box_away = 1;
    mni_level_next(&l, 1, &s);
    ck_assert_int_eq(l.level, 6 * MNI_LEVELS_A_DOUBLING);
    ck_assert_int_lt(stand(&l, 6 * MNI_LEVELS_A_DOUBLING - 1, true, true), 8);
    ck_assert_int_eq(l.level, 6 * MNI_LEVELS_A_DOUBLING - 1);
}
END_TEST

/* What is as near as anything is taken to be is taken to be farther as well: soon as far as the
 * box, and slowly from there, of a tolerance below a pixel from a pixel on. (A jump to beside a hub
 * went to a million pixels, and came down from there.) */
START_TEST(at_once_beside_the_eye) {
    const int error[] = {0, 10, 10, 10, 20, 20, 10, 10}, away[] = {0, 0, 0, 0, 0, 0, 6, 40};
    const int box[] = {0, 0, 20, 7, 18, 2, 6, 40};
    const double asked[] = {1, 1, 1, 1, 1, 1, 1, 1.0 / 1024};
    const double level[] = {0, 10.0 / 3, 2, 3, 4, 20.0 / 3, 16.0 / 3, 20};
    for (int i = 0; i < 8; i++) {
        mni_level l;
        mni_level_open(&l);
        mni_level_signs s = {.moved = true, .full = true, .from_scratch = true};
        s.refused.px = exp2(error[i]);
        s.refused.away = exp2(away[i]);
        s.box_away = exp2(box[i]);
        mni_level_next(&l, asked[i], &s);
        const double wants = fmax(1, ceil(level[i] * MNI_LEVELS_A_DOUBLING));
        ck_assert_int_eq(l.level, (int)wants);
        if (away[i] > 0 || error[i] == 0)
            continue;
        const double still = s.refused.px / mni_level_reach(&l, asked[i], s.box_away);
        ck_assert_double_le(still, mni_level_tolerance(&l, asked[i]) * 1.0001);
        l.level--;
        ck_assert_double_gt(s.refused.px / mni_level_reach(&l, asked[i], s.box_away),
                            mni_level_tolerance(&l, asked[i]));
    }
}
END_TEST

/* Where many find no room the level goes to where they are not wanted, and no farther in search of
 * the one with the largest error. (With a target, and a tolerance of 1/1024 to begin with, blocks
 * that came over three frames filled the front with what is small, and 50 frames gave way to what
 * is 10,000 times as large.) */
START_TEST(at_once_where_many_find_no_room) {
    for (int moved = 0; moved < 2; moved++) {
        mni_level l;
        mni_level_open(&l);
        mni_level_signs s = {.moved = moved, .full = true, .busy = true};
        s.refused = (mni_level_refused){.px = 64, .away = INFINITY};
        s.crowd = (mni_level_refused){.px = 4, .away = INFINITY};
        s.box_away = 1;
        mni_level_next(&l, 1.0 / 1024, &s);
        const int crowd = 12 * MNI_LEVELS_A_DOUBLING, mid = 8 * MNI_LEVELS_A_DOUBLING;
        ck_assert_int_eq(l.level, moved ? crowd : mid);
        s.crowd = (mni_level_refused){0};
        const int before = l.level;
        mni_level_next(&l, 1.0 / 1024, &s);
        ck_assert_int_eq(l.level, before + 2);
    }
}
END_TEST

/* In motion a frame that is full once in a while is met by one step, however often. (Each step was
 * twice the last one, up to a sixth of the tolerance, and a fifth of the room stood empty.) */
START_TEST(strides_begin_anew) {
    mni_level l;
    mni_level_open(&l);
    for (int frame = 0; frame < 60; frame++) {
        mni_level_signs s = {.moved = true, .busy = true, .full = frame % 6 == 0, .fill = 0.99};
        s.refused = (mni_level_refused){.px = s.full ? 1e6 : 0, .away = INFINITY};
        s.box_away = 1;
        mni_level_next(&l, 1, &s);
        ck_assert_int_eq(l.level, frame / 6 + 1);
    }
}
END_TEST

/* What is known to be near is not taken to be farther than the box, nor, in it, by more than the
 * square of a tolerance that can be seen. (To 2^14 times, though it was near.) */
START_TEST(near_stays_near) {
    mni_level l;
    double before = 1;
    mni_level_open(&l);
    ck_assert(mni_level_reach(&l, 1, 1 << 20) == 1);
    for (l.level = 0; l.level <= 20 * MNI_LEVELS_A_DOUBLING; l.level++) {
        const double tolerance_px = mni_level_tolerance(&l, 1.0 / 1024);
        const double seen = fmax(tolerance_px, 1), reach = mni_level_reach(&l, 1.0 / 1024, 64);
        ck_assert_double_le(reach, fmax(64, seen * seen) * 1.0001);
        ck_assert_double_ge(reach, before);
        ck_assert(tolerance_px > 1 || mni_level_reach(&l, 1.0 / 1024, 1) == 1);
        before = reach;
    }
}
END_TEST

/* The room needed swells and shrinks while the camera moves. */
START_TEST(even_in_motion) {
    mni_level l;
    mni_level_open(&l);
    int turns = 0, way = 0, wanting = 0;
    for (int frame = 0; frame < 2000; frame++) {
        int lowest = frame >= 1600 ? -20 : (int)(200 - 200 * cos(frame * 0.004));
        mni_level_signs s = look(l.level, lowest, _i & 1, _i & 2);
        s.moved = s.busy = true;
        int before = l.level;
        mni_level_next(&l, 1, &s);
        int step = l.level - before;
        ck_assert_int_le(abs(step), MNI_LEVEL_STRIDE);
        turns += step * way < 0;
        way = step != 0 ? step : way;
        wanting += abs(l.level - lowest) > 2 * MNI_LEVEL_STRIDE;
    }
    ck_assert_int_eq(l.level, 0); /* it comes back */
    ck_assert_int_lt(wanting, 100);
    ck_assert_int_lt(turns, _i & 2 ? 40 : 400);
}
END_TEST

/* While blocks are on their way nobody knows whether a level fits: it stands. */
START_TEST(waits_for_blocks) {
    mni_level l;
    mni_level_open(&l);
    l.level = 100;
    mni_level_signs s = {.busy = true};
    for (int i = 0; i < 50; i++) {
        mni_level_next(&l, 1, &s);
        ck_assert(l.level == 100 && !l.settled);
    }
    s.busy = false;
    mni_level_next(&l, 1, &s);
    ck_assert_int_lt(l.level, 100);
}
END_TEST

/* While the camera stands the room that is there is taken in a few frames, also where a level takes
 * next to nothing of it. (A level a frame, for 100 frames, from 35 px to 1: a front of which most
 * was in blocks that were there.) */
START_TEST(stands_and_comes_back) {
    const int steep[] = {1, 2, 8, 40};
    for (int i = 0; i < 400; i++) {
        mni_level l;
        mni_level_open(&l);
        l.level = (int)below(MNI_LEVEL_MAX) + 1;
        const int lowest = (int)below((uint64_t)l.level);
        int tried_too_low = 0, frames = 0;
        do {
            mni_level_signs s = {.full = l.level < lowest, .moved = frames == 0, .box_away = 1};
            const double above = (double)(l.level - lowest) / MNI_LEVELS_A_DOUBLING;
            s.fill = s.full ? 1 : exp2(-above / steep[i % 4]);
            s.refused = (mni_level_refused){.px = s.full ? 1e12 : 0, .away = INFINITY};
            tried_too_low += s.full;
            mni_level_next(&l, 1, &s);
            frames++;
        } while (!l.settled && frames < FRAMES_MAX);
        ck_assert_int_eq(l.level, lowest);
        ck_assert_int_le(frames, 60);
        ck_assert_int_le(tried_too_low, 12);
    }
}
END_TEST

/* What is used stays when another tolerance is asked for, unless it had not given way. */
START_TEST(asked_for_another) {
    const double before[] = {1, 1, 1, 1, 1, 1, -1, INFINITY, 0, 1e30, 1e-30};
    const double now[] = {1, 0.125, 8, 100, -1, INFINITY, 1, 1, 1, 1e-30, 1e30};
    const int doublings[] = {6, 9, 3, 0, 0, 0, 0, 0, 0, 40, 0};
    for (int i = 0; i < 11; i++) {
        mni_level l;
        mni_level_open(&l);
        l.level = 6 * MNI_LEVELS_A_DOUBLING;
        mni_level_asked(&l, before[i], now[i]);
        ck_assert_int_eq(l.level, doublings[i] * MNI_LEVELS_A_DOUBLING);
        mni_level_open(&l);
        mni_level_asked(&l, before[i], now[i]);
        ck_assert_int_eq(l.level, 0);
    }
}
END_TEST

/* What could not be collapsed yet may hold the room: the level that was refused is tried again. */
START_TEST(stale_refusals_are_no_verdict) {
    mni_level l;
    mni_level_open(&l);
    mni_level_signs s = {.full = true, .stale = true, .busy = true};
    for (int i = 0; i < 5; i++)
        mni_level_next(&l, 1, &s);
    ck_assert_int_gt(l.level, 5);
    ck_assert_int_lt(stand(&l, 0, true, true), 40);
    ck_assert_int_eq(l.level, 0);
}
END_TEST

/* Nothing fits, and errors that are no numbers. */
START_TEST(limits) {
    mni_level l;
    mni_level_open(&l);
    const double errors[] = {NAN, INFINITY, 1e300, 1e-300, 0};
    for (int i = 0; i < 5 * MNI_LEVEL_MAX / MNI_LEVEL_STRIDE; i++) {
        mni_level_signs s = {.full = true, .refused.px = errors[i % 5], .fill = 2};
        s.refused.away = errors[(i + 1) % 5];
        s.box_away = i % 3 == 0 ? 1 : 1e20;
        mni_level_next(&l, i % 2 ? 1 : -1, &s);
    }
    ck_assert(l.level == MNI_LEVEL_MAX && l.settled);
    ck_assert_double_eq(mni_level_tolerance(&l, 0.5), 0x1p39);
    ck_assert_double_eq(mni_level_tolerance(&l, INFINITY), INFINITY);
}
END_TEST

int main(void) {
    const char *seed = getenv("MN_SEED");
    random_state = seed != NULL ? strtoull(seed, NULL, 10) : 20261122;
    printf("MN_SEED=%llu\n", (unsigned long long)random_state);
    Suite *suite = suite_create("level");
    TCase *tc = tcase_create("level");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, the_lowest_that_fits, 0, 4);
    tcase_add_test(tc, at_once_from_scratch);
    tcase_add_test(tc, at_once_beside_the_eye);
    tcase_add_test(tc, at_once_where_many_find_no_room);
    tcase_add_test(tc, strides_begin_anew);
    tcase_add_test(tc, near_stays_near);
    tcase_add_loop_test(tc, even_in_motion, 0, 4);
    tcase_add_test(tc, stands_and_comes_back);
    tcase_add_test(tc, asked_for_another);
    tcase_add_test(tc, waits_for_blocks);
    tcase_add_test(tc, stale_refusals_are_no_verdict);
    tcase_add_test(tc, limits);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
