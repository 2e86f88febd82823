/* Goal: what a collapse that is put off closes: its ends from its own cost on, their rings from
 * MNI_WAIT_RING times as much on, nobody else, and nothing that is closed opens again.
 * Method: one cell of a flat grid, every inner edge in turn, against rings found from its
 * triangles. */
#include <check.h>
#include <stdlib.h>
#include <string.h>

#include "suite.h"
#include "tree_fixture.h"
#include "wait.h"

enum { SIDE = 7, VERTICES = SIDE * SIDE, TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1) };

static float position[3 * VERTICES];
static uint32_t corner[3 * TRIANGLES];
static mni_simplifier simplifier;
static mni_heap_key closed[VERTICES];
static float ring[VERTICES];

static void open_all(void) {
    for (uint32_t v = 0; v < VERTICES; v++) {
        closed[v] = MNI_HEAP_KEY_NONE;
        ring[v] = INFINITY;
    }
}

static void setup(void) {
    const mn_mesh mesh = {
        .position = position, .corner = corner, .vertices = VERTICES, .triangles = TRIANGLES};
    mn_status st = {0};
    uint32_t t = 0;
    for (uint32_t v = 0; v < VERTICES; v++) {
        position[3 * v] = (float)(v % SIDE);
        position[3 * v + 1] = (float)(v / SIDE);
        position[3 * v + 2] = 0;
    }
    for (uint32_t y = 0; y + 1 < SIDE; y++)
        for (uint32_t x = 0; x + 1 < SIDE; x++) {
            uint32_t a = y * SIDE + x, b = a + 1, c = a + SIDE, d = c + 1;
            memcpy(&corner[3 * t++], (uint32_t[]){a, b, d}, 3 * sizeof *corner);
            memcpy(&corner[3 * t++], (uint32_t[]){a, d, c}, 3 * sizeof *corner);
        }
    memset(&simplifier, 0, sizeof simplifier);
    ck_assert_int_eq(mni_surface_open(&simplifier.surface, &mesh, &st), MN_OK);
    simplifier.part = (mni_part){.closed = closed, .ring = ring, .slack = 1, .rings = true};
    open_all();
}

static void teardown(void) {
    mni_surface_close(&simplifier.surface);
}

static bool beside(uint32_t v, uint32_t n) {
    for (uint32_t t = 0; t < TRIANGLES; t++) {
        const uint32_t *c = &corner[3 * t];
        if ((c[0] == v || c[1] == v || c[2] == v) && (c[0] == n || c[1] == n || c[2] == n))
            return true;
    }
    return false;
}

/* Each edge r, k of the grid. */
static bool next_edge(uint32_t *r, uint32_t *k) {
    do {
        if (++*k == VERTICES) {
            *k = 0;
            ++*r;
        }
    } while (*r < VERTICES && (*r == *k || !beside(*r, *k)));
    return *r < VERTICES;
}

START_TEST(ends_and_rings_close) {
    const float cost = 2;
    uint32_t edges = 0;
    for (uint32_t r = 0, k = 0; next_edge(&r, &k); edges++) {
        open_all();
        mni_heap_key key = mni_heap_key_make(cost, k);
        ck_assert(mni_wait_would_close(&simplifier.part, r, k, key));
        mni_wait_close(&simplifier, r, k, key);
        ck_assert(mni_wait_is_idle(&simplifier.part, r, k, key));
        for (uint32_t v = 0; v < VERTICES; v++) {
            mni_heap_key want = MNI_HEAP_KEY_NONE;
            if (v == r || v == k)
                want = mni_wait_key(cost, k);
            else if (beside(r, v) || beside(k, v))
                want = mni_wait_key(MNI_WAIT_RING * cost, 0);
            ck_assert_msg(closed[v] == want, "edge %u %u, vertex %u", r, k, v);
            ck_assert(ring[v] == (v == r || v == k ? MNI_WAIT_RING * cost : INFINITY));
        }
    }
    ck_assert_uint_eq(edges, 2 * (2 * SIDE * (SIDE - 1) + (SIDE - 1) * (SIDE - 1)));
}
END_TEST

START_TEST(without_rings_ends_close_alone) {
    const uint32_t r = 3 * SIDE + 3, k = r + 1;
    simplifier.part.rings = false;
    mni_wait_close(&simplifier, r, k, mni_heap_key_make(2, k));
    for (uint32_t v = 0; v < VERTICES; v++)
        ck_assert((closed[v] != MNI_HEAP_KEY_NONE) == (v == r || v == k));
}
END_TEST

/* The end k is of another cell: its ring is not known here, and r waits alone. */
START_TEST(beyond_the_cell_ends_close_alone) {
    const uint32_t r = 3 * SIDE + 3, k = r + 1;
    closed[r] = 0;
    mni_wait_close(&simplifier, r, k, mni_heap_key_make(2, k));
    for (uint32_t v = 0; v < VERTICES; v++)
        ck_assert((closed[v] != MNI_HEAP_KEY_NONE) == (v == r || v == k));
    ck_assert_uint_eq(closed[r], 0);
}
END_TEST

START_TEST(what_is_closed_stays_so) {
    mni_heap_key before[VERTICES];
    uint64_t seed = fixture_seed(5);
    for (int turn = 0; turn < 2000; turn++) {
        uint32_t r = (uint32_t)(fixture_random(&seed) % VERTICES), k = VERTICES;
        float cost = (float)(1 + fixture_random(&seed) % 1000);
        for (uint32_t n = (uint32_t)(fixture_random(&seed) % VERTICES); k == VERTICES;
             n = (n + 1) % VERTICES)
            k = n != r && beside(r, n) ? n : k;
        memcpy(before, closed, sizeof before);
        mni_wait_close(&simplifier, r, k, mni_heap_key_make(cost, k));
        for (uint32_t v = 0; v < VERTICES; v++) {
            ck_assert_uint_le(closed[v], before[v]);
            if (beside(r, v) || beside(k, v))
                ck_assert_uint_le(closed[v], mni_wait_key(MNI_WAIT_RING * cost, 0));
        }
        ck_assert(mni_wait_is_idle(&simplifier.part, r, k, mni_heap_key_make(cost, k)));
        ck_assert(mni_wait_rings_hold(&simplifier));
    }
    for (uint32_t v = 0; v < VERTICES; v++) { /* one that is open beside those that wait */
        const mni_heap_key was = closed[v];
        closed[v] = MNI_HEAP_KEY_NONE;
        ck_assert(!mni_wait_rings_hold(&simplifier));
        closed[v] = was;
    }
}
END_TEST

/* A level with slack lets more go: all closes from that many times the cost on. */
START_TEST(slack_closes_later) {
    const uint32_t r = 3 * SIDE + 3, k = r + 1;
    simplifier.part.slack = 4;
    mni_wait_close(&simplifier, r, k, mni_heap_key_make(2, k));
    ck_assert_uint_eq(closed[r], mni_wait_key(8, k));
    ck_assert_uint_eq(closed[k], mni_wait_key(8, k));
    ck_assert_uint_eq(closed[r - 1], mni_wait_key(MNI_WAIT_RING * 8, 0));
    ck_assert(!mni_wait_closed(&simplifier.part, r, k, mni_heap_key_make(7.5f, k)));
    ck_assert(mni_wait_closed(&simplifier.part, r, k, mni_heap_key_make(8.5f, k)));
}
END_TEST

/* Who comes into a ring that waits, waits. */
START_TEST(who_comes_in_waits) {
    const uint32_t r = 3 * SIDE + 3, k = r + 1, newcomer = 0;
    mni_wait_close(&simplifier, r, k, mni_heap_key_make(2, k));
    mni_wait_meet(&simplifier.part, newcomer, newcomer + 1);
    ck_assert_uint_eq(closed[newcomer + 1], MNI_HEAP_KEY_NONE);
    mni_wait_meet(&simplifier.part, k, newcomer);
    ck_assert_uint_eq(closed[newcomer], mni_wait_key(MNI_WAIT_RING * 2, 0));
}
END_TEST

int main(void) {
    Suite *s = suite_create("wait");
    TCase *t = tcase_create("wait");
    tcase_add_checked_fixture(t, setup, teardown);
    tcase_add_test(t, ends_and_rings_close);
    tcase_add_test(t, without_rings_ends_close_alone);
    tcase_add_test(t, beyond_the_cell_ends_close_alone);
    tcase_add_test(t, what_is_closed_stays_so);
    tcase_add_test(t, slack_closes_later);
    tcase_add_test(t, who_comes_in_waits);
    suite_add_tcase(s, t);
    return suite_run(s);
}
