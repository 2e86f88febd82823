/* Goal: what is set aside dies where its corners meet, and leaves the hinges that are needed.
 * Method: collapses of three or four vertices by hand, one of them numbered 0; the history's
 * counts. */
#include <check.h>
#include <stdlib.h>

#include "aside.h"
#include "suite.h"

enum { VERTICES = 4 };

/* Vertex v has the id v. Collapse i: removed[i] goes into kept[i], a vertex that is still there. */
static void finish(const mni_aside_simplex *simplex, uint32_t count, const uint32_t removed[],
                   const uint32_t kept[], uint32_t collapses, mni_history *h) {
    mn_status st = {0};
    mni_aside a;
    mni_cell_node node[VERTICES];
    mni_cell_collapse collapse[VERTICES] = {0};
    uint32_t left[VERTICES], right[VERTICES], is[VERTICES]; /* is: a vertex's node by now */
    for (uint32_t v = 0; v < VERTICES; v++) {
        node[v] = (mni_cell_node){.id = v};
        is[v] = v;
    }
    for (uint32_t i = 0; i < collapses; i++) {
        left[i] = is[kept[i]];
        right[i] = is[removed[i]];
        is[kept[i]] = VERTICES + i;
        collapse[i] = (mni_cell_collapse){.left_leaves = 1, .right_leaves = 1};
    }
    mni_cell cell = {.vertices = VERTICES,
                     .node = node,
                     .collapse = collapse,
                     .collapses = collapses,
                     .s.made = {.left = left, .right = right, .count = collapses},
                     .aside = (mni_aside_simplex *)simplex,
                     .aside_count = count};
    const mni_poll poll = {0};
    ck_assert_int_eq(mni_history_open(h, "/tmp", false, &st), MN_OK);
    ck_assert_int_eq(mni_aside_open(&a, "/tmp", &st), MN_OK);
    ck_assert_int_eq(mni_aside_add(&a, &cell, &st), MN_OK);
    ck_assert_int_eq(mni_aside_late(&a, &cell, &st), MN_OK);
    ck_assert_uint_eq(a.late_count, collapses);
    ck_assert_msg(mni_aside_finish(&a, h, 0, "/tmp", &poll, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(h->collapses, collapses);
    ck_assert_uint_eq(a.late_count, 0); /* none is counted twice */
    mni_aside_close(&a);
}

/* Whoever of the three is the third corner, the one numbered 0 too. */
START_TEST(a_triangle_leaves_a_hinge) {
    mni_history h;
    const uint32_t apex = (uint32_t)_i, r = (apex + 1) % 3, k = (apex + 2) % 3;
    const mni_aside_simplex x = {{0, 1, 2}, {0, 1, 2}};
    finish(&x, 1, (uint32_t[]){r, k}, (uint32_t[]){k, apex}, 2, &h);
    ck_assert_uint_eq(h.hinges, 1);
    ck_assert_uint_eq(h.killed_count, 2);
    ck_assert_uint_eq(h.counts.components, 1);
    mni_history_close(&h);
}
END_TEST

/* Two triangles that die at once with one third corner; a vertex without any. */
START_TEST(one_hinge_is_enough) {
    mni_history h;
    const mni_aside_simplex x[] = {{{1, 2, 0}, {1, 2, 0}}, {{2, 1, 0}, {2, 1, 0}}};
    finish(x, 2, (uint32_t[]){1, 3, 2}, (uint32_t[]){2, 0, 0}, 3, &h);
    ck_assert_uint_eq(h.hinges, 1);
    ck_assert_uint_eq(h.killed_count, 3);
    ck_assert_uint_eq(h.counts.components, 2);
    mni_history_close(&h);
}
END_TEST

int main(void) {
    Suite *s = suite_create("aside");
    TCase *t = tcase_create("aside");
    tcase_add_loop_test(t, a_triangle_leaves_a_hinge, 0, 3);
    tcase_add_test(t, one_hinge_is_enough);
    suite_add_tcase(s, t);
    return suite_run(s);
}
