/* Goal: distances to a star are right, and the same bits at every width; so are the keys of a
 * vertex's candidates and who stays of too many witnesses, and a wheel is what the list is.
 * Method: random fans of all kinds against the nearest place by brute force in double. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "simplify.h"
#include "star.h"
#include "thin.h"
#include "tree_fixture.h"

enum { RIM_MAX = 40, ROUNDS = 400 };

static uint64_t random_state;

static float draw_unit(void) {
    return (float)(fixture_random(&random_state) % (1 << 20)) / (1 << 20);
}

/* Vertex 0 in the middle of `rim` others: once round, or with gaps, or turned over in parts; with
 * edges of no length and triangles of no area among them. */
static void draw_fan(mn_mesh *m, float *position, uint32_t *corner) {
    uint32_t rim = 3 + fixture_random(&random_state) % (RIM_MAX - 3);
    uint32_t kind = fixture_random(&random_state) % 4;
    float far = draw_unit() < 0.2f ? 1e6f : 0, size = draw_unit() < 0.2f ? 1e-3f : 1;
    for (uint32_t v = 0; v <= rim; v++)
        for (int i = 0; i < 3; i++)
            position[3 * v + i] = far + size * draw_unit();
    if (kind == 3) /* some ends coincide, with each other and with the middle */
        for (uint32_t v = 1; v <= rim; v += 3)
            memcpy(&position[3 * v], &position[3 * (v % 2 * (v - 1))], 3 * sizeof(float));
    *m = (mn_mesh){.position = position, .corner = corner, .vertices = rim + 1};
    for (uint32_t v = 1; v <= rim; v++) {
        if (kind == 1 && v % 3 == 0)
            continue;
        uint32_t next = v % rim + 1, turned = kind == 2 && v % 2 == 0;
        uint32_t *c = &corner[3 * m->triangles++];
        c[v % 3] = 0;
        c[(v + 1) % 3] = turned ? next : v;
        c[(v + 2) % 3] = turned ? v : next;
    }
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double to_segment(const double *p, const double *a, const double *b) {
    double d[3], q[3];
    for (int i = 0; i < 3; i++) {
        d[i] = b[i] - a[i];
        q[i] = p[i] - a[i];
    }
    double t = dot(d, d) > 0 ? dot(q, d) / dot(d, d) : 0;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    for (int i = 0; i < 3; i++)
        q[i] -= t * d[i];
    return sqrt(dot(q, q));
}

static double to_triangle(const double *p, const double *a, const double *b) {
    const double k[3] = {0, 0, 0};
    double best = fmin(fmin(to_segment(p, k, a), to_segment(p, k, b)), to_segment(p, a, b));
    double aa = dot(a, a), bb = dot(b, b), ab = dot(a, b), area = aa * bb - ab * ab;
    double u = bb * dot(p, a) - ab * dot(p, b), v = aa * dot(p, b) - ab * dot(p, a);
    if (area > 1e-12 * aa * bb && u >= 0 && v >= 0 && u + v <= area) {
        double q[3];
        for (int i = 0; i < 3; i++)
            q[i] = p[i] - u / area * a[i] - v / area * b[i];
        best = fmin(best, sqrt(dot(q, q)));
    }
    return best;
}

static double to_star(const mn_mesh *m, const double *p) {
    double best = sqrt(dot(p, p));
    for (uint32_t t = 0; t < m->triangles; t++) {
        double end[3][3];
        uint32_t ends = 0;
        for (int c = 0; c < 3; c++)
            if (m->corner[3 * t + c] != 0) {
                for (int i = 0; i < 3; i++)
                    end[ends][i] =
                        (double)(m->position[3 * m->corner[3 * t + c] + i] - m->position[i]);
                ends++;
            }
        best = fmin(best, to_triangle(p, end[0], end[1]));
    }
    return best;
}

static void draw_points(mni_points *points, double reach) {
    points->count = 1 + fixture_random(&random_state) % MNI_POINTS;
    for (uint32_t i = 0; i < points->count; i++) {
        points->x[i] = (float)reach * (4 * draw_unit() - 2);
        points->y[i] = (float)reach * (4 * draw_unit() - 2);
        points->z[i] = (float)reach * (4 * draw_unit() - 2);
    }
}

static void check_fan(mni_star *wide, mni_star *narrow) {
    static mni_points points, again;
    float position[3 * (RIM_MAX + 1)];
    uint32_t corner[3 * RIM_MAX];
    mn_mesh mesh;
    mn_status st = {0};
    mni_surface surface;
    draw_fan(&mesh, position, corner);
    double reach = 0;
    for (uint32_t v = 1; v < mesh.vertices; v++)
        for (int i = 0; i < 3; i++)
            reach = fmax(reach, fabs((double)position[3 * v + i] - position[i]));
    ck_assert_int_eq(mni_surface_open(&surface, &mesh, &st), MN_OK);
    ck_assert(mni_star_take(wide, &surface, 0) && mni_star_take(narrow, &surface, 0));
    draw_points(&points, reach);
    again = points;
    mni_star_measure(wide, &points);
    mni_star_measure(narrow, &again);
    ck_assert_mem_eq(points.distance, again.distance, points.count * sizeof(float));
    for (uint32_t i = 0; i < points.count; i++) {
        double p[3] = {points.x[i], points.y[i], points.z[i]}, want = to_star(&mesh, p);
        ck_assert_msg(fabs(points.distance[i] - want) <= 1e-3 * (reach + sqrt(dot(p, p))),
                      "point %u of a fan of %u: %.9g, want %.9g, reach %g", i, mesh.triangles,
                      (double)points.distance[i], want, reach);
    }
    mni_surface_close(&surface);
}

START_TEST(nearest_of_random_fans) {
    mni_star wide, narrow;
    mni_star_open(&wide);
    mni_star_open(&narrow);
    mni_star_narrow(&narrow);
    random_state = fixture_seed(11);
    for (int i = 0; i < ROUNDS; i++)
        check_fan(&wide, &narrow);
    mni_star_close(&wide);
    mni_star_close(&narrow);
}
END_TEST

START_TEST(without_triangles_to_the_vertex) {
    mn_mesh mesh;
    mn_status st = {0};
    mni_surface surface;
    mni_star star;
    fixture_book(3, &mesh);
    ck_assert_int_eq(mni_surface_open(&surface, &mesh, &st), MN_OK);
    mni_star_open(&star);
    while (surface.alive_triangles > 0) /* down to a hinge or nothing */
        for (uint32_t x = 0; x < surface.triangles; x++)
            if (surface.simplex[x].killed == MN_NONE)
                ck_assert(mni_surface_collapse(&surface, surface.simplex[x].v[2],
                                               surface.simplex[x].v[0], x));
    for (uint32_t v = 0; v < mesh.vertices; v++) {
        mni_points points = {.x = {3}, .y = {4}, .z = {12}, .count = 1};
        ck_assert(mni_star_take(&star, &surface, v));
        mni_star_measure(&star, &points);
        ck_assert_float_eq(points.distance[0], 13);
    }
    mni_star_close(&star);
    mni_surface_close(&surface);
    mn_mesh_free(&mesh);
}
END_TEST

/* The star of both ends is the one that the collapse leaves, to the bit, however it is come by. */
START_TEST(before_and_after) {
    mn_mesh mesh;
    mni_surface surface;
    mni_star star;
    mn_status st = {0};
    uint32_t collapses = 0, wheels = 0;
    random_state = fixture_seed(3);
    fixture_sheet(14, 1, false, &mesh);
    ck_assert_int_eq(mni_surface_open(&surface, &mesh, &st), MN_OK);
    mni_star_open(&star);
    for (int i = 0; i < 150 && surface.alive_triangles > 0; i++) {
        uint32_t x = fixture_random(&random_state) % surface.triangles;
        if (surface.simplex[x].killed != MN_NONE)
            continue;
        uint32_t r = surface.simplex[x].v[i % 3], k = surface.simplex[x].v[(i + 1) % 3];
        mni_points before = {.count = MNI_LANES}, after;
        for (int l = 0; l < MNI_LANES; l++) {
            before.x[l] = 3 * draw_unit();
            before.y[l] = 3 * draw_unit();
            before.z[l] = draw_unit();
        }
        after = before;
        mni_points of_wheels = before;
        mni_wheel of_r, of_k;
        ck_assert(mni_star_take_of_both(&star, &surface, r, k));
        mni_star_measure(&star, &before);
        if (mni_surface_wheel(&surface, r, &of_r) && mni_surface_wheel(&surface, k, &of_k)) {
            ck_assert(mni_star_take_of_wheels(&star, &surface, &of_r, &of_k, r, k));
            mni_star_measure(&star, &of_wheels);
            ck_assert_mem_eq(before.distance, of_wheels.distance, MNI_LANES * sizeof(float));
            wheels++;
        }
        ck_assert(mni_surface_collapse(&surface, r, k, collapses++));
        ck_assert(mni_star_take(&star, &surface, k));
        mni_star_measure(&star, &after);
        ck_assert_mem_eq(before.distance, after.distance, MNI_LANES * sizeof(float));
    }
    ck_assert_uint_gt(collapses, 50);
    ck_assert_uint_gt(wheels, 25);
    mni_star_close(&star);
    mni_surface_close(&surface);
    mn_mesh_free(&mesh);
}
END_TEST

static bool is_in(const uint32_t *list, uint32_t count, uint32_t v) {
    for (uint32_t i = 0; i < count; i++)
        if (list[i] == v)
            return true;
    return false;
}

/* A wheel is the list of who is alive, in the list's order, with MN_NONE behind it. */
static void check_wheel(mni_surface *s, uint32_t v) {
    const mni_fan was = s->vertex[v].fan;
    uint32_t list[MNI_WHEEL_MAX], behind = s->pool[was.first + was.count], kept = 0;
    mni_wheel wheel;
    for (uint32_t i = 0; i < was.count; i++) {
        uint32_t x = s->pool[was.first + i];
        if (s->simplex[x].killed == MN_NONE)
            list[kept++] = x;
    }
    ck_assert(mni_surface_wheel(s, v, &wheel));
    ck_assert_uint_eq(wheel.count, kept);
    ck_assert_uint_eq(s->vertex[v].fan.count, kept);
    ck_assert_uint_eq(s->pool[was.first + was.count], behind);
    ck_assert_mem_eq(wheel.simplex, list, kept * sizeof *list);
    ck_assert_mem_eq(&s->pool[was.first], list, kept * sizeof *list);
    for (uint32_t i = 0; i < MNI_WHEEL_MAX; i++) {
        mni_corner c = {0, MN_NONE, MN_NONE};
        if (i < kept)
            c = mni_simplex_corner(&s->simplex[list[i]], v);
        ck_assert(wheel.next[i] == c.next && wheel.previous[i] == c.previous);
        if (i < kept)
            ck_assert(wheel.next[mni_wheel_find(wheel.next, kept, c.next)] == c.next &&
                      mni_wheel_find(wheel.next, kept, c.next) <= i);
    }
    for (uint32_t n = 0; n < s->vertices; n++)
        ck_assert((mni_wheel_find(wheel.next, kept, n) == MNI_WHEEL_MAX) ==
                  !is_in(wheel.next, kept, n));
}

START_TEST(wheels_are_lists) {
    float position[3 * (RIM_MAX + 1)];
    uint32_t corner[3 * RIM_MAX];
    random_state = fixture_seed(17);
    for (int i = 0; i < 10 * ROUNDS; i++) {
        mn_mesh mesh;
        mn_status st = {0};
        mni_surface surface;
        draw_fan(&mesh, position, corner);
        if (mesh.triangles > MNI_WHEEL_MAX)
            mesh.triangles = fixture_random(&random_state) % (MNI_WHEEL_MAX + 1);
        ck_assert_int_eq(mni_surface_open(&surface, &mesh, &st), MN_OK);
        for (uint32_t t = 0; t < mesh.triangles; t++)
            if (fixture_random(&random_state) % 8 < (uint32_t)i % 4)
                surface.simplex[t].killed = t;
        check_wheel(&surface, 0);
        mni_surface_close(&surface);
    }
}
END_TEST

/* Keys made side by side are those made one by one, to the bit, at every width. */
START_TEST(keys_are_costs) {
    enum { VERTICES = 64, MAX = 2 * MNI_WHEEL_MAX };
    static mni_vertex vertex[VERTICES];
    random_state = fixture_seed(23);
    for (int i = 0; i < 10 * ROUNDS; i++) {
        uint32_t kept[MNI_KEYS_MAX], count = fixture_random(&random_state) % (MAX + 1);
        mni_heap_key wide[MNI_KEYS_MAX], narrow[MNI_KEYS_MAX];
        float small = i % 3 == 0 ? 1e-12f : 1;
        for (uint32_t v = 0; v < VERTICES; v++) {
            double q[10];
            for (int j = 0; j < 10; j++) /* some are below 0 at most places */
                q[j] = small * ((double)draw_unit() - (j > 3 ? 0.5 : i % 2 == 0 ? 0.9 : 0));
            q[0] = fabs(q[0]);
            vertex[v] = (mni_vertex){.p = {draw_unit(), draw_unit(), draw_unit()},
                                     .value = NAN,
                                     .c = q[0],
                                     .xx = q[1],
                                     .yy = q[2],
                                     .zz = q[3],
                                     .xy = q[4],
                                     .xz = q[5],
                                     .yz = q[6],
                                     .x = q[7],
                                     .y = q[8],
                                     .z = q[9]};
        }
        for (uint32_t n = 0; n < MNI_KEYS_MAX; n++)
            kept[n] = fixture_random(&random_state) % VERTICES;
        mni_collapse_keys_best()(vertex, 5, kept, count, wide);
        mni_collapse_keys_narrow(vertex, 5, kept, count, narrow);
        ck_assert_mem_eq(wide, narrow, count * sizeof *wide);
        for (uint32_t n = 0; n < count; n++) {
            float cost = mni_collapse_cost(&vertex[5], &vertex[kept[n]], MN_METRIC_QEM);
            ck_assert(wide[n] == mni_heap_key_make(cost, kept[n]));
        }
    }
}
END_TEST

typedef struct thinned {
    mni_points points;
    float slack[MNI_POINTS];
    uint32_t home[MNI_POINTS];
} thinned;

/* On a grid, where most pairs are as close as others, or anywhere. */
static void draw_thinned(thinned *t, bool grid) {
    float *const of[3] = {t->points.x, t->points.y, t->points.z};
    t->points.count = fixture_random(&random_state) % (MNI_POINTS / (1 + 3 * (uint32_t)grid) + 1);
    for (uint32_t i = 0; i < t->points.count; i++) {
        for (int c = 0; c < 3; c++)
            of[c][i] = grid ? (float)(fixture_random(&random_state) % 4) : draw_unit();
        t->points.distance[i] = grid ? (float)(fixture_random(&random_state) % 3) : draw_unit();
        t->slack[i] = i % 2 == 0 ? 0 : draw_unit();
        t->home[i] = i;
    }
}

/* By force: of the closest pair the nearer one, until few are left. */
static void thin_by_force(thinned *t) {
    mni_points *w = &t->points;
    while (w->count > MNI_THIN_LEFT) {
        uint32_t a = 0, b = 1, last = w->count - 1;
        float least = INFINITY;
        for (uint32_t i = 0; i < w->count; i++)
            for (uint32_t j = 0; j < i; j++) {
                float x = w->x[i] - w->x[j], y = w->y[i] - w->y[j], z = w->z[i] - w->z[j];
                float apart = x * x + y * y + z * z;
                if (apart < least) {
                    least = apart;
                    a = i;
                    b = j;
                }
            }
        bool a_goes = !(w->distance[b] + t->slack[b] < w->distance[a] + t->slack[a]);
        uint32_t gone = a_goes ? a : b, heir = a_goes ? b : a;
        t->slack[heir] =
            fmaxf(t->slack[heir], w->distance[gone] + t->slack[gone] - w->distance[heir]);
        w->x[gone] = w->x[last], w->y[gone] = w->y[last], w->z[gone] = w->z[last];
        w->distance[gone] = w->distance[last];
        t->slack[gone] = t->slack[last];
        t->home[gone] = t->home[last];
        w->count--;
    }
}

static void check_alike(const thinned *a, const thinned *b) {
    uint32_t n = a->points.count;
    ck_assert_uint_eq(n, b->points.count);
    ck_assert_mem_eq(a->points.x, b->points.x, n * sizeof(float));
    ck_assert_mem_eq(a->points.y, b->points.y, n * sizeof(float));
    ck_assert_mem_eq(a->points.z, b->points.z, n * sizeof(float));
    ck_assert_mem_eq(a->points.distance, b->points.distance, n * sizeof(float));
    ck_assert_mem_eq(a->slack, b->slack, n * sizeof(float));
    ck_assert_mem_eq(a->home, b->home, n * sizeof(uint32_t));
}

START_TEST(thinned_alike) {
    static thinned wide, narrow, forced;
    random_state = fixture_seed(17);
    for (int i = 0; i < 20 * ROUNDS; i++) {
        bool grid = i % 2 == 0;
        draw_thinned(&wide, grid);
        narrow = forced = wide;
        mni_thin_best()(&(mni_thin_set){&wide.points, wide.slack, wide.home});
        mni_thin_narrow(&(mni_thin_set){&narrow.points, narrow.slack, narrow.home});
        check_alike(&wide, &narrow);
        if (grid) /* which of equals goes is the program's affair */
            continue;
        thin_by_force(&forced);
        check_alike(&wide, &forced);
    }
}
END_TEST

static void hash_bytes(uint64_t *hash, const void *bytes, size_t count) {
    for (size_t i = 0; i < count; i++)
        *hash = (*hash ^ ((const unsigned char *)bytes)[i]) * 0x100000001b3u;
}

/* Heights by lot: no libm, whose last bits differ. */
static void lot_sheet(uint32_t n, mn_mesh *m) {
    uint64_t lot = 1;
    fixture_sheet(n, 1, false, m);
    for (uint32_t v = 0; v < m->vertices; v++) {
        m->position[3 * v] = (float)(v % n);
        m->position[3 * v + 1] = (float)(v / n);
        m->position[3 * v + 2] = (float)(fixture_random(&lot) % 4096) / 2048;
    }
}

/* The tree's collapses and switch values, bounds aside, which are libm's. */
START_TEST(same_tree_on_every_machine) {
    static const uint64_t golden[2] = {0xff0afc3c2ffba229, 0x953db157cef34fd3};
    for (int metric = 0; metric < 2; metric++) {
        mn_mesh mesh;
        mn_tree tree;
        mn_status st = {0};
        mn_simplify_desc desc = {.metric = metric == 0 ? MN_METRIC_QEM : MN_METRIC_LENGTH};
        lot_sheet(60, &mesh);
        ck_assert_msg(mn_simplify(&mesh, &desc, &tree, &st) == MN_OK, "%s", st.text);
        uint64_t hash = 0xcbf29ce484222325u;
        hash_bytes(&hash, tree.left, tree.inner * sizeof *tree.left);
        hash_bytes(&hash, tree.right, tree.inner * sizeof *tree.right);
        hash_bytes(&hash, tree.switch_value, tree.inner * sizeof *tree.switch_value);
        hash_bytes(&hash, tree.corner, (size_t)tree.simplices * 3 * sizeof *tree.corner);
        ck_assert_msg(hash == golden[metric], "metric %d: %#llx", metric, (unsigned long long)hash);
        mn_tree_free(&tree);
        mn_mesh_free(&mesh);
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("star");
    TCase *tc = tcase_create("star");
    tcase_add_test(tc, nearest_of_random_fans);
    tcase_add_test(tc, without_triangles_to_the_vertex);
    tcase_add_test(tc, before_and_after);
    tcase_add_test(tc, wheels_are_lists);
    tcase_add_test(tc, keys_are_costs);
    tcase_add_test(tc, thinned_alike);
    tcase_add_test(tc, same_tree_on_every_machine);
    suite_add_tcase(suite, tc);
    SRunner *runner = srunner_create(suite);
    srunner_run_all(runner, CK_ENV);
    int failed = srunner_ntests_failed(runner);
    srunner_free(runner);
    return failed == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
