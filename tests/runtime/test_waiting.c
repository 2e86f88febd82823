/* Goal: who waits is found when his turn may have come, and not before: nobody is forgotten, and
 * thousands who wait for one hub are not all tested each time that it moves. Method: random changes
 * against a table; a count of the forks that are tested, on hubs of more and more neighbours. */
#include <check.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"
#include "navigate.h"
#include "suite.h"

/* ---- random changes -------------------------------------------------------------------------- */

enum { SLOTS = 12, FORKS = 100, CHANGES = 10000 };

typedef struct table {
    mni_front front;
    mni_waiting waiting;
    uint32_t for_slot[FORKS]; /* MN_NONE: does not wait */
} table;

static uint32_t below(uint32_t limit) {
    return (uint32_t)(model_random() % limit);
}

static void wake(table *t, uint32_t slot, uint32_t order) {
    for (;;) {
        uint32_t least = MN_NONE;
        for (uint32_t f = 0; f < FORKS; f++)
            if (t->for_slot[f] == slot && t->front.branch[f].order < least)
                least = t->front.branch[f].order;
        const uint32_t fork = mni_waiting_wake(&t->waiting, slot, order);
        ck_assert((fork == MN_NONE) == (least == MN_NONE || least > order));
        if (fork == MN_NONE)
            return;
        ck_assert(t->for_slot[fork] == slot && t->front.branch[fork].order == least);
        ck_assert(!mni_waiting_has(&t->waiting, fork));
        t->for_slot[fork] = MN_NONE;
    }
}

static void change(table *t) {
    const uint32_t fork = below(FORKS), slot = below(SLOTS), to = below(SLOTS);
    switch (below(8)) {
    case 0:
        mni_waiting_drop(&t->waiting, fork); /* or he does not wait */
        t->for_slot[fork] = MN_NONE;
        return;
    case 1:
        wake(t, slot, below(2) ? MN_NONE : below(1000));
        return;
    case 2:
        if (slot == to)
            return;
        mni_waiting_pass(&t->waiting, slot, to);
        for (uint32_t f = 0; f < FORKS; f++)
            t->for_slot[f] = t->for_slot[f] == slot ? to : t->for_slot[f];
        return;
    default:
        if (t->for_slot[fork] != MN_NONE)
            return;
        t->front.branch[fork].order = below(1000);
        mni_waiting_add(&t->waiting, fork, slot);
        t->for_slot[fork] = slot;
    }
}

START_TEST(nobody_is_forgotten) {
    static table t;
    memset(&t, 0, sizeof t);
    t.front.node = calloc(SLOTS, sizeof *t.front.node);
    t.front.branch = calloc(FORKS, sizeof *t.front.branch);
    t.front.slots_high = SLOTS;
    ck_assert(t.front.node != NULL && t.front.branch != NULL);
    memset(t.for_slot, 0xff, sizeof t.for_slot);
    mni_waiting_open(&t.waiting, &t.front);
    for (int i = 0; i < CHANGES; i++) {
        uint32_t count = 0, wrong = 0;
        change(&t);
        for (uint32_t f = 0; f < FORKS; f++) {
            count += t.for_slot[f] != MN_NONE;
            wrong += mni_waiting_has(&t.waiting, f) != (t.for_slot[f] != MN_NONE);
        }
        ck_assert(t.waiting.count == count && wrong == 0);
        if (i % 16 == 0)
            mni_waiting_check(&t.waiting);
    }
    for (uint32_t slot = 0; slot < SLOTS; slot++)
        wake(&t, slot, MN_NONE);
    ck_assert_uint_eq(t.waiting.count, 0);
    free(t.front.node);
    free(t.front.branch);
}
END_TEST

/* ---- hubs ------------------------------------------------------------------------------------ */

enum { TESTS_MAX = 8 }; /* a collapse: it was as many as there were neighbours left */

static const mn_block_desc levels_5 = {.blocking = MN_BLOCKING_LEVELS, .l = 5};

/* From full detail to the roots, everything resident; forks tested for each that collapsed. */
static double tests_a_collapse(uint32_t triangles) {
    model m;
    mn_status st = {0};
    mni_arena arena;
    mni_store *store;
    model_make(&m, MODEL_LOOSE, triangles, &levels_5);
    mni_navigator *nav = calloc(1, sizeof *nav);
    ck_assert_ptr_nonnull(nav);
    const mn_header *h = &m.header;
    mni_block_limits limits = mni_block_limits_of(h);
    const uint32_t nodes = (h->leaves + 63) & ~63u;
    const uint32_t simplices = (uint32_t)(h->triangles + h->hinges);
    const mni_store_desc desc = {.path = m.path,
                                 .header = h,
                                 .kind = MN_STORE_RESIDENT,
                                 .check = mni_front_block_check,
                                 .check_context = &limits};
    mn_code code = mni_arena_open(&arena,
                                  mni_store_need_bytes(h, MN_STORE_RESIDENT, 0) +
                                      mni_navigator_need_bytes(h, nodes, simplices),
                                  &st);
    if (code == MN_OK)
        code = mni_store_open(&desc, &arena, &store, &st);
    nav->width_px = nav->height_px = 100;
    nav->size = 1;
    if (code == MN_OK)
        code = mni_navigator_open(nav, store, h, nodes, simplices, &arena, &st);
    ck_assert_msg(code == MN_OK, "%s", st.text);
    const mn_camera camera = model_camera(&m, 0, 3);
    mni_store_frame_begin(store);
    mni_navigator_frame(nav, &camera, -1);
    ck_assert_uint_eq(nav->front.active, h->leaves);
    mni_navigator_frame(nav, &camera, INFINITY);
    mni_store_frame_end(store, 0);
    mni_navigator_check(nav);
    ck_assert_uint_eq(nav->front.active, h->roots);
    const double tests = (double)nav->work.tested / (double)nav->work.collapses;
    mni_store_close(store);
    mni_arena_close(&arena);
    free(nav);
    model_free(&m);
    return tests;
}

START_TEST(a_hub_tells_few) {
    static const uint32_t sizes[] = {100, 200, 400};
    for (int i = 0; i < 3; i++) {
        const double tests = tests_a_collapse(sizes[i]);
        ck_assert_msg(tests < TESTS_MAX, "%u triangles: %.1f tests a collapse", sizes[i], tests);
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("waiting");
    TCase *tc = tcase_create("waiting");
    tcase_set_timeout(tc, 120);
    tcase_add_test(tc, nobody_is_forgotten);
    tcase_add_test(tc, a_hub_tells_few);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
