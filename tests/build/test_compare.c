/* Goal: distances are exact: to triangles of every shape, between meshes whose distance is known.
 * Method: a tree of boxes against every triangle by brute force; planes, cubes, spheres. */
#include <check.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "distance.h"
#include "metanode/build.h"
#include "noise.h"
#include "sampler.h"
#include "suite.h"

static uint64_t seed = 1;

static double random_unit(void) {
    static uint64_t index;
    return mni_noise_unit(seed, index++);
}

/* By searching the triangle in ever finer steps around its best point: slow, shares no code. */
static double slow_distance(const float *a, const float *b, const float *c, const double p[3]) {
    double u = 1.0 / 3, v = 1.0 / 3, best = INFINITY;
    for (double step = 0.5; step > 1e-9; step *= 0.7)
        for (int turn = 0; turn < 3; turn++) {
            double bu = u, bv = v;
            for (int i = -2; i <= 2; i++)
                for (int j = -2; j <= 2; j++) {
                    double x = u + i * step, y = v + j * step, d2 = 0;
                    x = x < 0 ? 0 : x > 1 ? 1 : x;
                    y = y < 0 ? 0 : y > 1 - x ? 1 - x : y;
                    for (int k = 0; k < 3; k++) {
                        double r = (1 - x - y) * a[k] + x * b[k] + y * c[k] - p[k];
                        d2 += r * r;
                    }
                    if (d2 < best) {
                        best = d2;
                        bu = x;
                        bv = y;
                    }
                }
            u = bu;
            v = bv;
        }
    return sqrt(best);
}

/* Triangles of every shape: plain, needles, flat ones, segments, points, huge and tiny. */
static void fill_corners(float *position, uint32_t *corner, uint32_t vertices, uint32_t triangles) {
    for (uint32_t i = 0; i < 3 * vertices; i++)
        position[i] = (float)(2 * random_unit() - 1);
    for (uint32_t v = 0; v < vertices; v += 7) /* nearly on a line with its neighbours */
        for (uint32_t k = 0; v > 1 && k < 3; k++)
            position[3 * v + k] = 0.5f * (position[3 * v - 3 + k] + position[3 * v - 6 + k]);
    for (uint32_t i = 0; i < 3 * triangles; i++)
        corner[i] = (uint32_t)(random_unit() * vertices);
    for (uint32_t t = 0; t + 3 < triangles; t += 4) {
        corner[3 * t + 1] = corner[3 * t];
        if (t % 8 == 0)
            corner[3 * t + 2] = corner[3 * t];
    }
    for (uint32_t t = 1; t + 3 < triangles; t += 4) {
        uint32_t v = 7 * (1 + corner[3 * t] % (vertices / 7 - 1));
        for (uint32_t k = 0; k < 3; k++)
            corner[3 * t + k] = v - k;
    }
}

START_TEST(nearest_is_the_nearest) {
    enum { VERTICES = 60, TRIANGLES = 64, QUERIES = 60 };
    float position[3 * VERTICES];
    uint32_t corner[3 * TRIANGLES], hint = 0;
    uint32_t triangles = _i == 0 ? 1 : _i == 1 ? 5 : TRIANGLES;
    fill_corners(position, corner, VERTICES, TRIANGLES);
    mni_distance *distance = NULL;
    mn_status st = {0};
    ck_assert_int_eq(mni_distance_open(position, corner, triangles, &distance, &st), MN_OK);
    for (int q = 0; q < QUERIES; q++) {
        double p[3], best = INFINITY, scale = q % 3 == 0 ? 10 : 1;
        for (int k = 0; k < 3; k++)
            p[k] = scale * (2 * random_unit() - 1);
        for (uint32_t t = 0; t < triangles; t++)
            best = fmin(best, slow_distance(position + 3 * corner[3 * t],
                                            position + 3 * corner[3 * t + 1],
                                            position + 3 * corner[3 * t + 2], p));
        uint32_t cold = 0;
        double found = mni_distance_nearest(distance, p, &hint);
        ck_assert_msg(fabs(found - best) < 1e-6, "%.9g and not %.9g", found, best);
        ck_assert(found == mni_distance_nearest(distance, p, &cold));
    }
    mni_distance_close(distance);
}
END_TEST

/* Thousands of equal triangles: the median split has nothing to go by. */
START_TEST(equal_triangles_do_not_hurt) {
    enum { TRIANGLES = 5000 };
    float position[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    uint32_t *corner = malloc(12 * TRIANGLES), hint = TRIANGLES - 1;
    for (uint32_t i = 0; i < 3 * TRIANGLES; i++)
        corner[i] = i % 3;
    mni_distance *distance = NULL;
    mn_status st = {0};
    ck_assert_int_eq(mni_distance_open(position, corner, TRIANGLES, &distance, &st), MN_OK);
    double p[3] = {0.2, 0.2, 2}, q[3] = {-3, 0, 4};
    ck_assert_double_eq(mni_distance_nearest(distance, p, &hint), 2);
    ck_assert_double_eq(mni_distance_nearest(distance, q, &hint), 5);
    mni_distance_close(distance);
    free(corner);
}
END_TEST

/* A square of side 1 at height z, cut into 2 × n² triangles. */
static mn_mesh square(uint32_t n, float z) {
    mn_mesh m = {.vertices = (n + 1) * (n + 1), .triangles = 2 * n * n};
    m.position = malloc(12 * m.vertices);
    m.corner = malloc(12 * m.triangles);
    for (uint32_t v = 0; v < m.vertices; v++) {
        m.position[3 * v] = (float)(v % (n + 1)) / (float)n;
        m.position[3 * v + 1] = (float)(v / (n + 1)) / (float)n;
        m.position[3 * v + 2] = z;
    }
    uint32_t *c = m.corner;
    for (uint32_t i = 0; i < n * n; i++, c += 6) {
        uint32_t a = i / n * (n + 1) + i % n, d = a + n + 1;
        const uint32_t two[6] = {a, a + 1, d, d, a + 1, d + 1};
        memcpy(c, two, sizeof two);
    }
    return m;
}

/* A ball of radius r: an octahedron's faces cut n times and blown up. Corners are not shared. */
static mn_mesh ball(uint32_t n, double r) {
    mn_mesh m = {.triangles = 8 * n * n, .vertices = 24 * n * n};
    m.position = malloc(12 * m.vertices);
    m.corner = malloc(12 * m.triangles);
    float *p = m.position;
    for (int face = 0; face < 8; face++)
        for (uint32_t i = 0; i < n; i++)
            for (uint32_t j = 0; j < 2 * (n - i) - 1; j++)
                for (uint32_t k = 0; k < 3; k++, p += 3) {
                    uint32_t x = i, y = j / 2, down = j % 2;
                    x += (down ? k != 0 : k == 1);
                    y += (down ? k != 1 : k == 2);
                    double q[3] = {(double)x, (double)y, (double)n - x - y};
                    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
                    for (int a = 0; a < 3; a++)
                        p[a] = (float)((face >> a & 1 ? -r : r) * q[a] / length);
                }
    for (uint32_t i = 0; i < m.vertices; i++)
        m.corner[i] = i;
    return m;
}

static mn_compare_result compare(const mn_mesh *a, const mn_mesh *b, uint64_t samples) {
    mn_compare_result r;
    mn_status st = {0};
    ck_assert_msg(mn_mesh_compare(a, b, samples, seed, NULL, &r, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(r.samples, samples);
    return r;
}

static void drop(mn_mesh *m) {
    free(m->position);
    free(m->corner);
}

START_TEST(known_distances) {
    mn_mesh a = square(9, 0), b = square(4, 0.25f), low = ball(24, 1), high = ball(20, 1.5);
    mn_compare_result self = compare(&a, &a, 5000);
    ck_assert(self.max < 1e-15 && self.rms < 1e-15);
    mn_compare_result planes = compare(&a, &b, 5000);
    ck_assert_double_eq_tol(planes.mean_ab, 0.25, 1e-12);
    ck_assert_double_eq_tol(planes.mean_ba, 0.25, 1e-12);
    ck_assert_double_eq_tol(planes.rms, 0.25, 1e-12);
    ck_assert_double_eq_tol(planes.max, 0.25, 1e-12);
    /* flat triangles cut the balls' corners: r × (1 - cos) of half an edge */
    mn_compare_result balls = compare(&low, &high, 20000);
    ck_assert_double_eq_tol(balls.mean_ab, 0.5, 0.004);
    ck_assert_double_eq_tol(balls.mean_ba, 0.5, 0.004);
    ck_assert(balls.max < 0.51 && balls.rms >= 0.495);
    drop(&high);
    drop(&low);
    drop(&b);
    drop(&a);
}
END_TEST

/* The same surface under other origins; and a small one on a large one: far one way only. */
START_TEST(origins_and_sides) {
    mn_mesh a = square(3, 0), b = square(5, 1);
    a.origin[2] = 1e6 + 1;
    b.origin[2] = 1e6;
    ck_assert(compare(&a, &b, 1000).max < 1e-9);
    a.origin[2] = b.origin[2] = 0;
    for (uint32_t i = 0; i < 3 * a.vertices; i++)
        a.position[i] = i % 3 == 2 ? 1 : 3 * a.position[i] - 1;
    mn_compare_result r = compare(&a, &b, 20000);
    ck_assert(r.mean_ba < 1e-7);
    ck_assert_double_eq_tol(r.max, sqrt(2), 0.02);
    /* over a square of side 3 around one of side 1: 4 sides of mean 1/2 on 1/9 each, 4 corners of
       mean 0.7652 (of a unit square to its corner) on 1/9 each */
    ck_assert_double_eq_tol(r.mean_ab, (4 * 0.5 + 4 * 0.76520) / 9, 0.005);
    drop(&a);
    drop(&b);
}
END_TEST

START_TEST(samples_are_uniform_by_area) {
    /* one triangle with three quarters of the area, one with a quarter, one with none between */
    float position[] = {0, 0, 0, 3, 0, 0, 0, 1, 0, 0, -1, 0, 1, 0, 0};
    uint32_t corner[] = {0, 1, 2, 0, 1, 4, 0, 3, 4};
    mni_sampler sampler;
    double point[3], weight[3], sum[3] = {0};
    uint64_t triangle, count[3] = {0};
    mni_sampler_open(&sampler, position, corner, 3, 40000, seed);
    while (mni_sampler_next(&sampler, point, &triangle, weight)) {
        ck_assert(weight[0] >= 0 && weight[1] >= 0 && weight[2] >= 0);
        count[triangle]++;
        for (int i = 0; i < 3; i++)
            sum[i] += triangle == 0 ? weight[i] : 0;
    }
    ck_assert_uint_eq(count[0] + count[2], 40000);
    ck_assert(count[0] >= 29999 && count[0] <= 30001);
    for (int i = 0; i < 3; i++)
        ck_assert_double_eq_tol(sum[i] / 30000, 1.0 / 3, 0.01);
    /* without any area the corners are taken */
    mni_sampler_open(&sampler, position, corner + 3, 1, 9, seed);
    while (mni_sampler_next(&sampler, point, &triangle, weight))
        ck_assert(weight[0] + weight[1] + weight[2] == 1 && triangle == 0);
    ck_assert_uint_eq(sampler.sample, 9);
}
END_TEST

START_TEST(nothing_to_compare_is_refused) {
    mn_mesh a = square(1, 0), none = {0};
    mn_compare_result r;
    mn_status st = {0};
    ck_assert_int_eq(mn_mesh_compare(&a, &none, 10, 0, NULL, &r, &st), MN_BAD_INPUT);
    st = (mn_status){0};
    ck_assert_int_eq(mn_mesh_compare(&a, &a, 0, 0, NULL, &r, &st), MN_USAGE);
    drop(&a);
}
END_TEST

/* context: calls so far. Asks for an end at the 20th. */
static bool stop_at_20(void *context, const char *phase, uint64_t done, uint64_t total) {
    int *calls = context;
    ck_assert_str_eq(phase, "measuring");
    ck_assert_uint_eq(total, 2 * 60000);
    ck_assert_uint_eq(done, 4096 * (uint64_t)*calls);
    return ++*calls < 20;
}

/* Both ways count as one work, and it ends where it is told to. */
START_TEST(watched_and_stopped) {
    mn_mesh a = square(1, 0);
    mn_compare_result r;
    mn_status st = {0};
    int calls = 0;
    ck_assert_int_eq(mn_mesh_compare(&a, &a, 60000, 0, &(mn_watch){stop_at_20, &calls}, &r, &st),
                     MN_FAILED);
    ck_assert_str_eq(st.text, "interrupted");
    ck_assert_int_eq(calls, 20);
    drop(&a);
}
END_TEST

int main(void) {
    const char *given = getenv("MN_SEED");
    if (given != NULL)
        seed = strtoull(given, NULL, 10);
    printf("MN_SEED=%llu\n", (unsigned long long)seed);
    Suite *suite = suite_create("compare");
    TCase *tc = tcase_create("compare");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, nearest_is_the_nearest, 0, 3);
    tcase_add_test(tc, equal_triangles_do_not_hurt);
    tcase_add_test(tc, samples_are_uniform_by_area);
    tcase_add_test(tc, known_distances);
    tcase_add_test(tc, origins_and_sides);
    tcase_add_test(tc, nothing_to_compare_is_refused);
    tcase_add_test(tc, watched_and_stopped);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
