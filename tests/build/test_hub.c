/* Goal: a vertex of n triangles costs about n, not n²; what comes of it is a tree with honest
 * values. Method: fans, cones, globes, books, bouquets and pencils of two sizes; entries of long
 * lists that are walked and turns are counted, not timed; measured distances against switch values;
 * a stop in between. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cell.h"
#include "tree_fixture.h"

/* Each piece of a kind has its own place and `n` triangles at each hub. */
typedef enum shape { FAN, CONE, BICONE, GLOBE, BOOK, BOUQUET, PENCIL, KINDS } shape;

enum { PIECES_MAX = 4, ROWS = 4, SMALL = 2500, LARGE = 10000 };

typedef struct maker {
    mn_mesh *m;
    float at[3];
    uint64_t random;
} maker;

static uint32_t point(maker *k, double x, double y, double z) {
    float *p = &k->m->position[3 * (size_t)k->m->vertices];
    p[0] = k->at[0] + (float)x;
    p[1] = k->at[1] + (float)y;
    p[2] = k->at[2] + (float)z;
    return k->m->vertices++;
}

static void triangle(maker *k, uint32_t a, uint32_t b, uint32_t c) {
    uint32_t *t = &k->m->corner[3 * (size_t)k->m->triangles++];
    t[0] = a;
    t[1] = b;
    t[2] = c;
}

/* A rim of n, a little uneven, at a height; returns its first. */
static uint32_t rim(maker *k, uint32_t n, double radius, double z) {
    uint32_t first = k->m->vertices;
    for (uint32_t i = 0; i < n; i++) {
        double uneven = 1 + 0.01 * (fixture_random(&k->random) % 1000) / 1000;
        double a = 2 * M_PI * i / n;
        point(k, radius * uneven * cos(a), radius * uneven * sin(a), z);
    }
    return first;
}

static void add_globe(maker *k, uint32_t n) {
    uint32_t north = point(k, 0, 0, 1), south = point(k, 0, 0, -1), row[ROWS];
    for (int j = 0; j < ROWS; j++) {
        double latitude = M_PI * (j + 1) / (ROWS + 1);
        row[j] = rim(k, n, sin(latitude), cos(latitude));
    }
    for (uint32_t i = 0; i < n; i++) {
        uint32_t next = (i + 1) % n;
        triangle(k, north, row[0] + i, row[0] + next);
        triangle(k, south, row[ROWS - 1] + next, row[ROWS - 1] + i);
        for (int j = 0; j + 1 < ROWS; j++) {
            triangle(k, row[j] + i, row[j + 1] + i, row[j + 1] + next);
            triangle(k, row[j] + i, row[j + 1] + next, row[j] + next);
        }
    }
}

/* Flat pyramids on one triangle, with their tips near one of its corners: when these have gone into
 * that corner, one triangle is there n times. */
static void add_pencil(maker *k, uint32_t n) {
    uint32_t a = point(k, 0, 0, 0), b = point(k, 0, 0, 1), c = point(k, 5, 0, 0.5);
    for (uint32_t i = 0; i < n; i++) {
        double off[3];
        for (int j = 0; j < 3; j++)
            off[j] = 0.2 * ((double)(fixture_random(&k->random) % 1000) / 1000 - 0.5);
        uint32_t tip = point(k, 5 + off[0], off[1], 0.5 + off[2]);
        triangle(k, a, b, tip);
        triangle(k, tip, b, c);
        triangle(k, a, tip, c);
    }
}

static void add(maker *k, shape kind, uint32_t n) {
    uint32_t a, b, first;
    if (kind == GLOBE) {
        add_globe(k, n);
    } else if (kind == PENCIL) {
        add_pencil(k, n);
    } else if (kind == BOUQUET) {
        a = point(k, 0, 0, 0);
        first = rim(k, 2 * n, 1, 0.5);
        for (uint32_t i = 0; i < n; i++)
            triangle(k, a, first + 2 * i, first + 2 * i + 1);
    } else if (kind == FAN) {
        first = rim(k, n + 2, 1, 0);
        for (uint32_t i = 1; i <= n; i++)
            triangle(k, first, first + i, first + i + 1);
    } else {
        a = point(k, 0, 0, 1);
        b = point(k, 0, 0, kind == BICONE ? -1 : 0);
        first = rim(k, n, 1, 0.1);
        for (uint32_t i = 0; i < n; i++)
            if (kind == BOOK) {
                triangle(k, a, b, first + i);
            } else {
                triangle(k, a, first + i, first + (i + 1) % n);
                if (kind == BICONE)
                    triangle(k, b, first + (i + 1) % n, first + i);
            }
    }
}

static void make(mn_mesh *m, shape kind, uint32_t pieces, uint32_t n) {
    size_t most = (size_t)pieces * ((size_t)n + 2) * (ROWS + 1) * 2;
    *m = (mn_mesh){.position = malloc(most * 12), .corner = malloc(most * 12)};
    maker k = {.m = m, .random = 1};
    for (uint32_t p = 0; p < pieces; p++) {
        k.at[0] = 3.0f * (float)p;
        add(&k, kind, n);
    }
}

static const char *const names[KINDS] = {"fan",  "cone",    "bicone", "globe",
                                         "book", "bouquet", "pencil"};

static bool always(void *context) {
    ++*(int *)context;
    return true;
}
static bool never(void *context) {
    ++*(int *)context;
    return false;
}

/* All of it as one cell. */
static mn_code run(mni_cell *cell, const mn_mesh *m, mni_poll poll, mn_status *st) {
    mni_hand h = {.vertices = m->vertices, .triangles = m->triangles};
    h.position = (float(*)[3])(void *)m->position;
    h.triangle = (mni_dealt_triangle *)(void *)m->corner;
    mni_cell_desc desc = {.whole = true, .stage = 1, .slack = 1, .poll = poll};
    mn_code code = mni_cell_open_dealt(cell, &desc, &h, st);
    return code == MN_OK ? mni_cell_run(cell, st) : code;
}

/* Walks through long lists, and turns, a vertex. */
static void count_work(shape kind, uint32_t pieces, uint32_t n, double *walked, double *turns) {
    mn_mesh m;
    mni_cell cell;
    mn_status st = {0};
    int asked = 0;
    make(&m, kind, pieces, n);
    ck_assert_msg(run(&cell, &m, (mni_poll){always, &asked}, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(cell.collapses, m.vertices - 1);
    ck_assert_int_gt(asked, 0);
    *walked = (double)cell.s.surface.walked / m.vertices;
    *turns = (double)cell.s.turns / m.vertices;
    printf("%s × %u of %u: %.1f entries walked, %.1f turns a vertex\n", names[kind], pieces, n,
           *walked, *turns);
    mni_cell_close(&cell);
    mn_mesh_free(&m);
}

/* Where a change costs a walk round the hub, the first is n, and grows with it. */
START_TEST(test_work_is_linear) {
    double small[2], large[2];
    count_work((shape)_i, 1, SMALL, &small[0], &small[1]);
    count_work((shape)_i, 1, LARGE, &large[0], &large[1]);
    ck_assert_double_lt(large[0], 500);
    ck_assert_double_lt(large[1], 300);
    ck_assert_double_lt(large[0], 2 * small[0] + 50);
    ck_assert_double_lt(large[1], 2 * small[1] + 10);
}
END_TEST

START_TEST(test_hubs_do_not_add_up) {
    double one[2], many[2];
    count_work((shape)_i, 1, SMALL, &one[0], &one[1]);
    count_work((shape)_i, PIECES_MAX, SMALL, &many[0], &many[1]);
    ck_assert_double_lt(many[0], 2 * one[0] + 50);
    ck_assert_double_lt(many[1], 2 * one[1] + 10);
}
END_TEST

/* One rim under n tips: all lists at the rim are long, and whether a tip may go to one of its
 * vertices was asked of each pair of them. */
static double count_rim(uint32_t round, uint32_t tips) {
    const size_t triangles = (size_t)round * tips;
    mn_mesh m = {.position = malloc((round + tips) * 12), .corner = malloc(triangles * 12)};
    maker k = {.m = &m, .random = 1};
    mni_cell cell;
    mn_status st = {0};
    int asked = 0;
    const uint32_t first = rim(&k, round, 1, 0);
    for (uint32_t tip = 0; tip < tips; tip++) {
        const uint32_t top = point(&k, 0.01 * (double)(tip % 64), 0, 1 + 0.001 * tip);
        for (uint32_t i = 0; i < round; i++)
            triangle(&k, top, first + i, first + (i + 1) % round);
    }
    ck_assert_msg(run(&cell, &m, (mni_poll){always, &asked}, &st) == MN_OK, "%s", st.text);
    const double walked = (double)cell.s.surface.walked / (double)triangles;
    printf("rim of %u under %u tips: %.1f entries walked a triangle\n", round, tips, walked);
    mni_cell_close(&cell);
    mn_mesh_free(&m);
    return walked;
}

START_TEST(test_tips_on_one_rim) {
    const double few = count_rim(100, 600), many = count_rim(200, 600);
    ck_assert_double_lt(many, 1.5 * few);
}
END_TEST

/* Distances from hubs are looked for, not all measured: they may be too large, never too small. */
START_TEST(test_values_are_honest) {
    mn_mesh m;
    mn_tree tree;
    mn_status st = {0};
    make(&m, (shape)_i, 2, SMALL);
    const mn_simplify_desc desc = {.metric = MN_METRIC_QEM};
    ck_assert_msg(mn_simplify(&m, &desc, &tree, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_tree_check(&tree, &st) == MN_OK, "%s", st.text);
    for (uint32_t part = 2; part <= 64; part *= 4) {
        mn_error_result e;
        ck_assert_msg(mn_error_measure(&tree, tree.triangles / part, 10000, 1, NULL, &e, &st) ==
                          MN_OK,
                      "%s", st.text);
        printf("%s: %llu triangles: %llu of %llu samples outside of the bound, mean bound %g, "
               "distance %g\n",
               names[_i], (unsigned long long)e.triangles, (unsigned long long)e.dishonest,
               (unsigned long long)e.samples, e.bound_mean, e.measured_mean);
        ck_assert_uint_le(e.dishonest * 1000, e.samples);
    }
    mn_tree_free(&tree);
    mn_mesh_free(&m);
}
END_TEST

START_TEST(test_a_cell_can_be_stopped) {
    mn_mesh m;
    mni_cell cell;
    mn_status st = {0};
    int asked = 0;
    make(&m, FAN, 1, SMALL);
    ck_assert(run(&cell, &m, (mni_poll){never, &asked}, &st) == MN_FAILED);
    ck_assert_str_eq(st.text, "interrupted");
    ck_assert_int_eq(asked, 1);
    mni_cell_close(&cell);
    mn_mesh_free(&m);
}
END_TEST

/* Nothing has a cost there, so one collapse goes on where the last one was, and each rounds its
 * sphere up. That is said, not written down. */
START_TEST(test_a_line_is_too_deep) {
    enum { POINTS = 3000 };
    mn_status st = {0};
    mni_cell cell;
    int asked = 0;
    mn_mesh m = {.position = malloc(POINTS * 12), .corner = malloc(POINTS * 12)};
    maker k = {.m = &m};
    for (int i = 0; i < POINTS; i++)
        point(&k, i, 0, 0);
    for (uint32_t i = 0; i + 2 < POINTS; i++)
        triangle(&k, i, i + 1, i + 2);
    ck_assert_int_eq(run(&cell, &m, (mni_poll){always, &asked}, &st), MN_BAD_INPUT);
    ck_assert_msg(strstr(st.text, "without area") && strstr(st.text, "--position-bits"), "%s",
                  st.text);
    mni_cell_close(&cell);
    mn_mesh_free(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("hub");
    TCase *work = tcase_create("work"), *result = tcase_create("result");
    tcase_set_timeout(work, 120);
    tcase_set_timeout(result, 120);
    tcase_add_loop_test(work, test_work_is_linear, 0, KINDS);
    tcase_add_loop_test(work, test_hubs_do_not_add_up, 0, KINDS);
    tcase_add_test(work, test_tips_on_one_rim);
    tcase_add_test(work, test_a_cell_can_be_stopped);
    tcase_add_loop_test(result, test_values_are_honest, 0, KINDS);
    tcase_add_test(result, test_a_line_is_too_deep);
    suite_add_tcase(suite, work);
    suite_add_tcase(suite, result);
    SRunner *runner = srunner_create(suite);
    srunner_run_all(runner, CK_ENV);
    int failed = srunner_ntests_failed(runner);
    srunner_free(runner);
    return failed == 0 ? 0 : 1;
}
