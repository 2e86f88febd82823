/* Goal: what is said of switch values is true. Method: a tree of a unit square by hand, whose
 * distances and areas are known in closed form; trees of the simplifier at their extremes. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "metanode/build.h"
#include "suite.h"

/*  2 ─── 3     collapse 0: 1 → 0 kills (0, 1, 2), leaves (0, 3, 2): the half above the diagonal
 *  │ ╲ B │     collapse 1: 3 → 2 kills (1, 3, 2)
 *  │ A ╲ │     collapse 2: 2 → 0, killing the hinge (0, 2)
 *  0 ─── 1     */
static float position[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0};
static uint32_t left[] = {0, 2, 4}, right[] = {1, 3, 5}, lo[] = {0, 2, 0}, mid[] = {1, 3, 2},
                hi[] = {2, 4, 4}, root[] = {6}, start[] = {0, 1, 2, 3},
                corner[] = {0, 1, 2, 1, 3, 2, 0, 2, MN_NONE};
static float switch_value[] = {0.75f, 1.2f, 1.5f};
static const mn_tree square = {.leaves = 4,
                               .inner = 3,
                               .simplices = 3,
                               .triangles = 2,
                               .roots = 1,
                               .legal_last = 6,
                               .leaf_position = position,
                               .left = left,
                               .right = right,
                               .leaf_lo = lo,
                               .leaf_mid = mid,
                               .leaf_hi = hi,
                               .switch_value = switch_value,
                               .root = root,
                               .simplex_start = start,
                               .corner = corner};

static mn_error_result measure(const mn_tree *tree, uint64_t triangles, uint64_t samples) {
    mn_error_result r;
    mn_status st = {0};
    ck_assert_msg(mn_error_measure(tree, triangles, samples, 3, NULL, &r, &st) == MN_OK, "%s",
                  st.text);
    return r;
}

START_TEST(full_detail_is_exact) {
    mn_error_result r = measure(&square, 2, 5000);
    ck_assert_double_eq_tol(r.diagonal, sqrt(2), 1e-12);
    ck_assert_uint_eq(r.triangles, 2);
    ck_assert_uint_eq(r.nodes, 4);
    ck_assert_uint_eq(r.dishonest, 0);
    ck_assert(r.measured_max < 1e-12 && r.bound_max == 0 && r.ratio.nodes == 0);
    ck_assert(isnan(r.ratio.median));
}
END_TEST

START_TEST(half_a_square) {
    const uint64_t n = 40000;
    switch_value[0] = 0.75f;
    mn_error_result r = measure(&square, 1, n);
    ck_assert_uint_eq(r.triangles, 1);
    ck_assert_uint_eq(r.nodes, 3);
    ck_assert_uint_eq(r.samples, n);
    ck_assert_uint_eq(r.dishonest, 0);
    ck_assert_double_eq(r.bound_max, 0.75);
    ck_assert_double_eq_tol(r.bound_mean, 0.75, 1e-9);
    /* distance |x - y| / √2 where x > y: mean 1 / (6 √2), at most 1 / √2 */
    ck_assert_double_eq_tol(r.measured_mean, sqrt(0.5) / 6, 1e-3);
    ck_assert_double_eq_tol(r.measured_max, sqrt(0.5), 0.01);
    /* all: node 4 and two leaves, whose switch value is 0; near: the leaves see samples below the
       diagonal too */
    ck_assert_uint_eq(r.ratio.nodes, 3);
    ck_assert_double_eq(r.ratio.median, 0);
    ck_assert_double_eq_tol(r.ratio.p90, 0.75 / r.measured_max, 1e-12);
    ck_assert_double_eq_tol(r.near.p90, 0.75 / r.measured_max, 1e-12);

    switch_value[0] = 0.35f; /* dishonest where x - y > 0.35 √2 */
    r = measure(&square, 1, n);
    double side = 1 - 0.35 * sqrt(2);
    ck_assert_double_eq_tol((double)r.dishonest / (double)n, side * side / 2, 0.005);
    ck_assert_double_eq_tol(r.excess_max, r.measured_max / 0.35, 1e-6);
    switch_value[0] = 0.75f;
}
END_TEST

/* No triangle left: two nodes count as their points. */
START_TEST(lone_nodes_are_points) {
    mn_error_result r = measure(&square, 0, 20000);
    ck_assert_uint_eq(r.triangles, 0);
    ck_assert_uint_eq(r.nodes, 2);
    ck_assert_uint_eq(r.dishonest, 0);
    ck_assert_double_eq_tol(r.bound_max, 1.2, 1e-6);
    ck_assert_double_eq_tol(r.measured_max, sqrt(1.25), 0.01);
    ck_assert_uint_eq(r.ratio.nodes, 2);
}
END_TEST

START_TEST(simplifier_is_honest) {
    char path[] = "/tmp/mn-measure-XXXXXX";
    int fd = mkstemp(path);
    ck_assert_int_ge(fd, 0);
    close(fd);
    mn_make_desc make = {.shape = _i == 0 ? MN_SHAPE_SPHERE : MN_SHAPE_TERRAIN, .triangles = 4000};
    mn_mesh mesh;
    mn_tree tree;
    mn_status st = {0};
    ck_assert_msg(mn_make(path, &make, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_mesh_read(path, &(mn_read_desc){0}, &mesh, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_simplify(&mesh, &(mn_simplify_desc){0}, &tree, &st) == MN_OK, "%s", st.text);
    mn_error_result last = {0};
    static const int percent[] = {100, 50, 10, 1};
    for (int i = 0; i < 4; i++) {
        mn_error_result r = measure(&tree, tree.triangles * (uint64_t)percent[i] / 100, 100000);
        ck_assert_uint_le(r.triangles, tree.triangles * (uint64_t)percent[i] / 100);
        ck_assert_uint_le(r.dishonest, r.samples / 1000);
        ck_assert(r.measured_mean >= last.measured_mean && r.bound_mean >= last.bound_mean);
        ck_assert(i == 0 || r.ratio.median <= 3);
        last = r;
    }
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
    unlink(path);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("measure");
    TCase *tc = tcase_create("measure");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, full_detail_is_exact);
    tcase_add_test(tc, half_a_square);
    tcase_add_test(tc, lone_nodes_are_points);
    tcase_add_loop_test(tc, simplifier_is_honest, 0, 2);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
