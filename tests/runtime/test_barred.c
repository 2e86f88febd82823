/* Goal: the list of refused nodes has each that was put into it once, in order, until he is due or
 * goes, and gives way when it is full; and in a pool that is too small what a frame counts as
 * refused is what is wanted and has not been split, all of it, whether or not it was looked at.
 * Method: the list against an array of what each slot should be, by a seed (MN_SEED); and a
 * navigator over a pool of few place holders, every wanted node counted anew after each frame. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "barred.h"
#include "dice.h"
#include "flight.h"
#include "front.h"
#include "suite.h"

/* ---- the list -------------------------------------------------------------------------------- */

enum { PASSES = 100, SLOTS_MAX = 2048 };

typedef struct expected {
    bool barred;
    float due;
    mni_agenda_item item;
} expected;

static mni_agenda_item new_item(uint32_t slot) {
    static uint32_t order;
    return (mni_agenda_item){.order = ++order, .key = uniform(1000), .what = slot};
}

static int by_rank(const void *a, const void *b) {
    const uint64_t x = mni_agenda_rank(a), y = mni_agenda_rank(b);
    return x < y ? -1 : x > y;
}

/* Items of slots that are not barred, put in order: what the agenda would have. */
static uint32_t marked(mni_barred *barred, uint32_t slots, float clock, mni_agenda_item *item,
                       expected *expect) {
    uint32_t count = 0;
    for (uint32_t slot = 0; slot < slots; slot++) {
        if (mni_barred_has(barred, slot) || uniform(3) != 0)
            continue;
        const float due = clock + 1 + (float)uniform(9);
        item[count] = new_item(slot);
        expect[slot] = (expected){true, due, item[count++]};
        mni_barred_mark(barred, slot, due);
    }
    qsort(item, count, sizeof *item, by_rank);
    return count;
}

/* Goes through what comes before a rank: in order, each where it should be. Some have room now. */
static uint32_t turns(mni_barred *barred, uint64_t before, uint64_t *last, expected *expect) {
    const mni_barred_node *next;
    uint32_t count = 0;
    for (; (next = mni_barred_next(barred, before)) != NULL; count++) {
        const uint32_t slot = next->item.what;
        const uint64_t rank = mni_agenda_rank(&next->item);
        ck_assert(rank < before && rank >= *last);
        *last = rank;
        ck_assert(expect[slot].barred && expect[slot].due == next->due);
        ck_assert_uint_eq(expect[slot].item.order, next->item.order);
        ck_assert_uint_eq(next->refusal.block_id, next->item.order);
        if (uniform(10) == 0) {
            mni_barred_drop(barred, slot);
            expect[slot].barred = false;
        } else {
            mni_barred_keep(barred, next);
        }
    }
    return count;
}

START_TEST(as_an_array) {
    static const uint32_t sizes[] = {64, 1000, SLOTS_MAX};
    static expected expect[SLOTS_MAX];
    static mni_agenda_item item[SLOTS_MAX];
    static float due[SLOTS_MAX];
    const uint32_t slots = sizes[_i];
    mni_arena arena;
    mni_barred barred;
    mn_status st = {0};
    uint64_t turns_had = 0, full = 0;
    float clock = 0;
    ck_assert_int_eq(mni_arena_open(&arena, mni_barred_need(slots), &st), MN_OK);
    mni_barred_open(&barred, slots, due, &arena);
    for (uint32_t frame = 0; frame < PASSES; frame++, clock++) {
        if (uniform(100) == 0) {
            mni_barred_clear(&barred);
            for (uint32_t slot = 0; slot < slots; slot++)
                expect[slot].barred = false;
        }
        mni_barred_begin(&barred, clock, frame);
        for (uint32_t slot = 0; slot < slots; slot++) {
            const bool has = mni_barred_has(&barred, slot);
            ck_assert(!has || expect[slot].barred);
            ck_assert(!has || expect[slot].due > clock);
            ck_assert(!has || due[slot] == expect[slot].due);
            ck_assert(has || !expect[slot].barred || due[slot] == MNI_DUE_NOW);
            ck_assert(!has ||
                      expect[slot].item.order % MNI_BARRED_FRAMES != frame % MNI_BARRED_FRAMES);
            expect[slot].barred = has;
        }
        const uint32_t count = marked(&barred, slots, clock, item, expect);
        uint64_t last = 0;
        for (uint32_t i = 0; i < count; i++) {
            turns_had += turns(&barred, mni_agenda_rank(&item[i]), &last, expect);
            last = mni_agenda_rank(&item[i]);
            const uint32_t goes = uniform(slots);
            if (uniform(8) == 0) {
                mni_barred_drop(&barred, goes);
                expect[goes].barred = false;
            }
            const uint32_t slot = item[i].what;
            if (!mni_barred_has(&barred, slot) || expect[slot].item.order != item[i].order)
                continue;
            mni_barred_add(&barred, item[i], (mni_refusal){item[i].order, 1});
            full += !mni_barred_has(&barred, slot);
            expect[slot].barred = mni_barred_has(&barred, slot);
        }
        turns_had += turns(&barred, UINT64_MAX, &last, expect);
        for (uint32_t slot = 0; slot < slots; slot++)
            ck_assert(mni_barred_has(&barred, slot) == expect[slot].barred);
        mni_barred_check(&barred);
    }
    ck_assert(full > 0 || slots < 1000);
    ck_assert(turns_had > 0 || slots < 1000); /* the first are looked at in each frame */
    mni_arena_close(&arena);
}
END_TEST

/* ---- in a pool that is too small --------------------------------------------------------------
 */

enum { FRAMES = 120, STANDS = 12 };

static void over_globe(flight *f, mn_blocking blocking) {
    const mn_block_desc blocks = {.blocking = blocking, .block_bytes = 4096, .l = 4};
    const mn_header *header = flight_model(f, 12000, &blocks);
    const uint32_t k = mni_store_k_min(header) + header->blocks / 4;
    ck_assert_uint_lt(k, header->blocks);
    flight_open(f, k, (mni_store_desc){.io = MN_IO_SIM}, NODES_MAX);
}

/* Returns how many were refused without a look, at least. */
static uint32_t fly(flight *f, int frame) {
    const double along = frame / (double)FRAMES;
    const mn_camera camera = model_camera(&f->m, 0.3 * along, 3 - 1.6 * along);
    double most_px;
    flight_frame(f, &camera, 0.5);
    const mni_work *work = &f->nav.work;
    const uint32_t wanted = flight_left(f, &most_px);
    ck_assert_uint_eq(work->refused_front + work->refused_budget, 0);
    ck_assert_uint_le(work->refused_pool, wanted);
    ck_assert_uint_le(wanted, work->refused_pool + work->misses);
    if (work->misses == 0)
        ck_assert(work->refused.px >= most_px * 0.99);
    return f->nav.barred.count > MNI_BARRED_FIRST ? f->nav.barred.count - MNI_BARRED_FIRST : 0;
}

START_TEST(all_are_counted) {
    flight f;
    uint64_t unseen = 0, split = 0;
    over_globe(&f, _i == 0 ? MN_BLOCKING_PACKED : MN_BLOCKING_LEVELS);
    for (int i = 0; i < FRAMES; i++) {
        unseen += fly(&f, i);
        split += f.nav.work.splits;
    }
    ck_assert_uint_gt(split, 0);
    ck_assert_uint_gt(unseen, 0);
    for (int i = 0; i < STANDS; i++)
        (void)fly(&f, FRAMES - 1);
    flight_close(&f);
}
END_TEST

int main(void) {
    const char *seed = getenv("MN_SEED");
    random_state = seed != NULL ? strtoull(seed, NULL, 0) : 1;
    printf("MN_SEED=%llu\n", (unsigned long long)random_state);
    Suite *suite = suite_create("barred");
    TCase *tc = tcase_create("barred");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, as_an_array, 0, 3);
    tcase_add_loop_test(tc, all_are_counted, 0, 2);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
