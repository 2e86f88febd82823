/* Goal: paths are the formulas of docs/paths.md.
 * Method: distances and ends of each path from a made header. */
#include <check.h>
#include <math.h>
#include <string.h>

#include "metanode/runtime.h"
#include "suite.h"

static mn_header header_of(void) {
    mn_header h = {.box_min = {-3, -1, 2}, .box_max = {5, 1, 6}};
    h.dive_point[0] = 1;
    h.dive_point[1] = 1;
    h.dive_point[2] = 4;
    h.dive_normal[0] = 0.6f;
    h.dive_normal[1] = 0.8f;
    return h;
}

static const double radius = 4.582575694955840; /* half of |(8, 2, 4)| */
static mn_path *path;

static void open_path(const char *name) {
    mn_header header = header_of();
    mn_status st = {0};
    ck_assert_msg(mn_path_open(name, &header, 45, &path, &st) == MN_OK, "%s", st.text);
}

static double distance(const float a[3], const float b[3]) {
    double sum = 0;
    for (int i = 0; i < 3; i++)
        sum += ((double)a[i] - (double)b[i]) * ((double)a[i] - (double)b[i]);
    return sqrt(sum);
}

START_TEST(orbit) {
    mn_camera c, first;
    open_path("orbit");
    ck_assert_uint_eq(mn_path_frames(path), 0);
    mn_path_camera(path, 0, 600, &first);
    const float center[3] = {1, 0, 4};
    for (uint32_t f = 0; f < 600; f++) {
        mn_path_camera(path, f, 600, &c);
        ck_assert_double_eq_tol(distance(c.eye, center), 2 * radius, 1e-5);
        ck_assert_double_eq_tol(distance(c.target, center), 0, 1e-6);
        double angle = 2 * 3.14159265358979 * f / 600;
        double flat = 2 * radius * cos(3.14159265358979 / 12);
        ck_assert_double_eq_tol(c.eye[0], 1 + flat * sin(angle), 1e-5);
        ck_assert_double_eq_tol(c.eye[2], 4 + flat * cos(angle), 1e-5);
        ck_assert_float_eq(c.fov_y_deg, 45);
    }
    mn_path_camera(path, 600, 600, &c);
    ck_assert_mem_eq(&c, &first, sizeof c);
    mn_path_close(path);
}
END_TEST

START_TEST(dive) {
    mn_camera c;
    open_path("dive");
    const mn_header header = header_of();
    static const struct {
        uint32_t frame;
        double radii;
    } at[] = {{0, 4}, {100, 0.02}, {200, 4}};
    for (int i = 0; i < 3; i++) {
        mn_path_camera(path, at[i].frame, 201, &c);
        ck_assert_double_eq_tol(distance(c.eye, header.dive_point), at[i].radii * radius, 1e-5);
        ck_assert_mem_eq(c.target, header.dive_point, sizeof c.target);
    }
    mn_path_camera(path, 50, 201, &c); /* half way down: the geometric mean */
    ck_assert_double_eq_tol(distance(c.eye, header.dive_point), sqrt(4 * 0.02) * radius, 1e-5);
    mn_path_close(path);
}
END_TEST

START_TEST(flyover) {
    mn_camera c;
    open_path("flyover");
    mn_path_camera(path, 0, 11, &c);
    ck_assert_double_eq_tol(c.eye[0], 1 - 5, 1e-5);
    ck_assert_double_eq_tol(c.eye[1], 1 + 0.15 * radius, 1e-5);
    ck_assert_double_eq_tol(c.target[0] - c.eye[0], radius, 1e-5);
    mn_path_camera(path, 10, 11, &c);
    ck_assert_double_eq_tol(c.eye[0], 1 + 2, 1e-5);
    ck_assert_double_eq_tol(c.eye[2], 4, 1e-6);
    mn_path_close(path);
}
END_TEST

/* The box of a single point, one frame: nothing divides by 0. */
START_TEST(degenerate) {
    static const char *const names[] = {"orbit", "dive", "flyover"};
    mn_header header = {0};
    for (int i = 0; i < 3; i++) {
        mn_camera c;
        ck_assert_int_eq(mn_path_open(names[i], &header, 45, &path, NULL), MN_OK);
        mn_path_camera(path, 0, 1, &c);
        for (int k = 0; k < 3; k++)
            ck_assert(isfinite(c.eye[k]) && isfinite(c.target[k]));
        mn_path_close(path);
    }
}
END_TEST

START_TEST(unknown) {
    mn_header header = header_of();
    mn_status st = {0};
    ck_assert_int_eq(mn_path_open("no-such-path", &header, 45, &path, &st), MN_USAGE);
    ck_assert_ptr_null(path);
    ck_assert_ptr_nonnull(strstr(st.text, "orbit, dive nor flyover"));
}
END_TEST

int main(void) {
    Suite *suite = suite_create("path");
    TCase *tc = tcase_create("path");
    tcase_add_test(tc, orbit);
    tcase_add_test(tc, dive);
    tcase_add_test(tc, flyover);
    tcase_add_test(tc, degenerate);
    tcase_add_test(tc, unknown);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
