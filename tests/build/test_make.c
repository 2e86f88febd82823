/* Goal: made models are what --help says: so many triangles, manifold, oriented, the same bytes for
 * the same options. Method: models of several sizes, read back here, their directed edges sorted.
 */
#include <check.h>
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "metanode/build.h"
#include "made_model.h"
#include "noise.h"
#include "suite.h"

static char folder[] = "/tmp/mn-make-XXXXXX";
static char path[64];

static void make(mn_shape shape, uint64_t triangles, uint64_t seed) {
    mn_make_desc desc = {.shape = shape, .triangles = triangles, .seed = seed};
    mn_status st = {0};
    ck_assert_msg(mn_make(path, &desc, &st) == MN_OK, "%s", st.text);
}

static const uint64_t sizes[] = {1, 2, 12, 50, 1000, 30000};

START_TEST(sphere_is_a_closed_sphere) {
    uint64_t asked = sizes[_i], edges;
    make(MN_SHAPE_SPHERE, asked, 7);
    made_model m = made_load(path);
    ck_assert(fabs((double)m.triangles - (double)asked) <= 4 * sqrt((double)asked) + 12);
    ck_assert_uint_eq(made_check_edges(&m, &edges), 0);
    ck_assert_int_eq((int64_t)(m.vertices + m.triangles) - (int64_t)edges, 2);
    made_check_fans(&m);
    made_check_positions(&m);
    ck_assert(asked < 12 || (made_volume(&m) > 0.5 && made_volume(&m) < 16));
    made_drop(&m);
}
END_TEST

START_TEST(terrain_is_a_sheet_that_faces_up) {
    uint64_t asked = sizes[_i], edges;
    make(MN_SHAPE_TERRAIN, asked, 7);
    made_model m = made_load(path);
    ck_assert(fabs((double)m.triangles - (double)asked) <= sqrt((double)asked) + 1);
    ck_assert_uint_gt(made_check_edges(&m, &edges), 0);
    ck_assert_int_eq((int64_t)(m.vertices + m.triangles) - (int64_t)edges, 1);
    made_check_fans(&m);
    made_check_positions(&m);
    for (uint64_t t = 0; t < m.triangles; t++) {
        const float *a = m.position + 3 * m.corner[3 * t];
        const float *b = m.position + 3 * m.corner[3 * t + 1];
        const float *c = m.position + 3 * m.corner[3 * t + 2];
        double up = (double)(b[2] - a[2]) * (c[0] - a[0]) - (double)(b[0] - a[0]) * (c[2] - a[2]);
        ck_assert(up > 0);
    }
    made_drop(&m);
}
END_TEST

/* Closed, manifold and oriented at every size, whatever the noise does; genus far above 0. */
START_TEST(isosurface_is_closed) {
    static const uint64_t asked[] = {1, 3000, 12000, 60000};
    uint64_t edges;
    make(MN_SHAPE_ISOSURFACE, asked[_i], 11);
    made_model m = made_load(path);
    if (asked[_i] >= 10000)
        ck_assert(fabs((double)m.triangles / (double)asked[_i] - 1) < 0.05);
    else
        ck_assert(m.triangles < 5000);
    ck_assert_uint_eq(made_check_edges(&m, &edges), 0);
    int64_t euler = (int64_t)(m.vertices + m.triangles) - (int64_t)edges;
    ck_assert(euler % 2 == 0 && euler < -12);
    made_check_fans(&m);
    made_check_positions(&m);
    ck_assert(made_volume(&m) > 1 && made_volume(&m) < 4.2);
    made_drop(&m);
}
END_TEST

/* The bytes themselves: a compiler or machine that rounds otherwise shows here. */
START_TEST(same_options_same_bytes) {
    static const uint64_t golden[] = {0xbf20b5ff2145ca00, 0xc6edba1beb040fa9, 0xe567685c5eb0a6dc};
    mn_shape shape = (mn_shape)_i;
    make(shape, 5000, 1);
    made_model a = made_load(path);
    make(shape, 5000, 1);
    made_model b = made_load(path);
    make(shape, 5000, 2);
    made_model c = made_load(path);
    ck_assert_uint_eq(a.hash, b.hash);
    ck_assert_uint_ne(a.hash, c.hash);
    ck_assert_msg(a.hash == golden[_i], "shape %d is 0x%016llx now", _i,
                  (unsigned long long)a.hash);
    made_drop(&a);
    made_drop(&b);
    made_drop(&c);
}
END_TEST

/* Detail down to the grid: the second differences of neighbours do not vanish, as they would on a
 * smooth surface, when the grid is refined. */
START_TEST(terrain_is_rough_at_every_scale) {
    double rough[3];
    for (int i = 0; i < 3; i++) {
        uint64_t side = UINT64_C(64) << i;
        make(MN_SHAPE_TERRAIN, 2 * side * side, 3);
        made_model m = made_load(path);
        double sum = 0, step = 20.0 / (double)side;
        for (uint64_t r = 0; r <= side; r++)
            for (uint64_t c = 1; c < side; c++) {
                const float *p = m.position + 3 * (r * (side + 1) + c);
                sum += fabs(p[-2] - 2.0 * p[1] + p[4]) / step;
            }
        rough[i] = sum / (double)(side * side);
        made_drop(&m);
    }
    ck_assert_msg(rough[1] > 0.6 * rough[0] && rough[2] > 0.6 * rough[1], "%g %g %g", rough[0],
                  rough[1], rough[2]);
}
END_TEST

/* What the readers make of a model: nothing to weld, reject or notice. */
START_TEST(readers_have_nothing_to_say) {
    make((mn_shape)_i, 20000, 5);
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_msg(mn_mesh_read(path, &(mn_read_desc){0}, &mesh, &st) == MN_OK, "%s", st.text);
    const mn_intake none = {.input_faces = mesh.triangles};
    ck_assert_mem_eq(&mesh.intake, &none, sizeof none);
    ck_assert_ptr_nonnull(mesh.color);
    mn_mesh_free(&mesh);
}
END_TEST

static bool stop_halfway(void *context, const char *phase, uint64_t done, uint64_t total) {
    (void)phase;
    ck_assert_uint_le(done, total);
    return ++*(int *)context < 20;
}

START_TEST(failures_leave_nothing_behind) {
    unlink(path);
    int calls = 0;
    mn_make_desc desc = {.shape = (mn_shape)_i,
                         .triangles = 100000,
                         .progress = stop_halfway,
                         .progress_context = &calls};
    mn_status st = {0};
    ck_assert_int_eq(mn_make(path, &desc, &st), MN_FAILED);
    ck_assert_str_eq(st.text, "interrupted");
    ck_assert_int_eq(made_files(folder), 0);

    /* a file that may not grow stands for a disk that is full */
    struct rlimit old, small = {.rlim_cur = 400000, .rlim_max = RLIM_INFINITY};
    getrlimit(RLIMIT_FSIZE, &old);
    small.rlim_max = old.rlim_max;
    signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &small);
    desc.progress = NULL;
    st = (mn_status){0};
    mn_code code = mn_make(path, &desc, &st);
    setrlimit(RLIMIT_FSIZE, &old);
    ck_assert_int_eq(code, MN_NO_SPACE);
    ck_assert_ptr_nonnull(strstr(st.text, path));
    ck_assert_int_eq(made_files(folder), 0);

    desc.triangles = UINT64_MAX;
    st = (mn_status){0};
    ck_assert_int_eq(mn_make(path, &desc, &st), MN_USAGE);
    st = (mn_status){0};
    desc.triangles = 100;
    ck_assert_int_eq(mn_make("/nowhere/at/all.ply", &desc, &st), MN_FAILED);
}
END_TEST

/* The slope that mni_noise2 hands back is the slope of what it returns, across lattice lines too.
 */
START_TEST(noise_slopes_are_slopes) {
    double none[2], slope[2], h = 1e-6, low = 0, high = 0;
    for (int i = 0; i < 2000; i++) {
        double x = 40 * mni_noise_unit(1, 2 * (uint64_t)i) - 20;
        double y = 40 * mni_noise_unit(1, 2 * (uint64_t)i + 1) - 20;
        double v = mni_noise2(5, x, y, slope);
        double dx = (mni_noise2(5, x + h, y, none) - mni_noise2(5, x - h, y, none)) / (2 * h);
        double dy = (mni_noise2(5, x, y + h, none) - mni_noise2(5, x, y - h, none)) / (2 * h);
        ck_assert(fabs(dx - slope[0]) < 1e-5 && fabs(dy - slope[1]) < 1e-5);
        double w = mni_noise3(5, x, y, 0.5 * x - y);
        ck_assert(fabs(v) <= 1 && fabs(w) <= 1);
        low = fmin(low, fmin(v, w));
        high = fmax(high, fmax(v, w));
    }
    ck_assert(low < -0.4 && high > 0.4);
    ck_assert_int_eq(mni_noise_floor(-0.5), -1);
    ck_assert_int_eq(mni_noise_floor(-2), -2);
    ck_assert_int_eq(mni_noise_floor(2.9), 2);
}
END_TEST

int main(void) {
    if (mkdtemp(folder) == NULL)
        return 1;
    snprintf(path, sizeof path, "%s/model.ply", folder);
    Suite *suite = suite_create("make");
    TCase *tc = tcase_create("make");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, noise_slopes_are_slopes);
    tcase_add_loop_test(tc, sphere_is_a_closed_sphere, 0, 6);
    tcase_add_loop_test(tc, terrain_is_a_sheet_that_faces_up, 0, 6);
    tcase_add_loop_test(tc, isosurface_is_closed, 0, 4);
    tcase_add_loop_test(tc, same_options_same_bytes, 0, 3);
    tcase_add_loop_test(tc, readers_have_nothing_to_say, 0, 3);
    tcase_add_test(tc, terrain_is_rough_at_every_scale);
    tcase_add_loop_test(tc, failures_leave_nothing_behind, 0, 3);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    unlink(path);
    rmdir(folder);
    return failed;
}
