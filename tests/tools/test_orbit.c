/* Goal: the viewer's camera goes where the hand says and never rolls, flips or leaves its limits.
 * Method: places and moves worked out by hand, then random drags. MN_SEED replays. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "orbit.h"
#include "suite.h"

static const mn_camera front_view = {
    .eye = {0, 0, 4}, .target = {0, 0, 0}, .up = {0, 1, 0}, .fov_y_deg = 90};

static float distance(const mn_camera *c) {
    return hypotf(hypotf(c->eye[0] - c->target[0], c->eye[1] - c->target[1]),
                  c->eye[2] - c->target[2]);
}

START_TEST(stands_where_it_was) {
    const mn_camera slanted = {
        .eye = {3, 4, -2}, .target = {1, 2, 3}, .up = {0, 1, 0}, .fov_y_deg = 45};
    const orbit o = orbit_from(&slanted, 2);
    const mn_camera c = orbit_camera(&o);
    for (int i = 0; i < 3; i++) {
        ck_assert_float_eq_tol(c.eye[i], slanted.eye[i], 1e-5f);
        ck_assert_float_eq(c.target[i], slanted.target[i]);
    }
    ck_assert_float_eq(c.fov_y_deg, 45);
}
END_TEST

START_TEST(turns_with_the_hand) {
    orbit o = orbit_from(&front_view, 2);
    orbit_turn(&o, 0.5f, 0); /* half a window to the right: the eye goes a quarter to the left */
    mn_camera c = orbit_camera(&o);
    ck_assert_float_eq_tol(c.eye[0], -4, 1e-4f);
    ck_assert_float_eq_tol(c.eye[2], 0, 1e-4f);
    o = orbit_from(&front_view, 2);
    orbit_turn(&o, 0, 5); /* far down: over the top, no further */
    c = orbit_camera(&o);
    ck_assert_float_gt(c.eye[1], 3.9f);
    ck_assert_float_gt(c.eye[2], 0);
}
END_TEST

START_TEST(pans_with_the_pointer) {
    orbit o = orbit_from(&front_view, 2);
    orbit_pan(&o, 0.5f, -0.25f); /* at 90 degrees the window is 8 high at the target */
    ck_assert_float_eq_tol(o.target[0], -4, 1e-4f);
    ck_assert_float_eq_tol(o.target[1], -2, 1e-4f);
    ck_assert_float_eq_tol(o.target[2], 0, 1e-4f);
}
END_TEST

START_TEST(zooms_between_its_limits) {
    orbit o = orbit_from(&front_view, 2);
    orbit_zoom(&o, 1);
    ck_assert_float_eq_tol(o.distance, 3.5f, 1e-5f);
    orbit_zoom(&o, 1e6f);
    ck_assert_float_eq(o.distance, o.distance_min);
    ck_assert_float_gt(o.distance, 0);
    orbit_zoom(&o, -1e6f);
    ck_assert_float_eq(o.distance, o.distance_max);
}
END_TEST

START_TEST(aims_at_the_nearest_triangle) {
    /* Before the eye, nearer and wound the other way, behind the eye; a hinge; an empty slot. */
    const float position[] = {-1, -1, 0, 1, -1, 0,  0, 1, 0,  -1, -1, 1, 1, -1,
                              1,  0,  1, 1, -1, -1, 9, 1, -1, 9,  0,  1, 9};
    const uint32_t node[] = {0, 1, 2, 3, 5, 4, 6, 7, 8, 3, 4, MN_NONE, MN_NONE, 0, 0};
    const mn_front front = {
        .node_slots = 9, .position = position, .simplex_slots = 5, .simplex_node = node};
    orbit o = orbit_from(&front_view, 2);
    orbit_aim(&o, &front);
    mn_camera c = orbit_camera(&o);
    ck_assert_float_eq_tol(c.target[2], 1, 1e-5f);
    ck_assert_float_eq_tol(c.eye[2], 4, 1e-5f); /* the eye does not move */
    o = orbit_from(&front_view, 2);
    orbit_pan(&o, 0.5f, 0.5f); /* nothing there */
    const orbit before = o;
    orbit_aim(&o, &front);
    ck_assert_float_eq(o.distance, before.distance);
}
END_TEST

/* Models as small and as large as `build` takes them: the same moves, to the scale of the model. */
START_TEST(the_unit_of_length_does_not_show) {
    static const int exponents[] = {0, -82, -60, 60, 98};
    orbit one = {0};
    for (size_t e = 0; e < sizeof exponents / sizeof exponents[0]; e++) {
        const float scale = ldexpf(1, exponents[e]);
        float position[] = {-1, -1, 1, 1, -1, 1, 0, 1, 1};
        for (int i = 0; i < 9; i++)
            position[i] *= scale;
        const uint32_t node[] = {0, 1, 2};
        const mn_front front = {
            .node_slots = 3, .position = position, .simplex_slots = 1, .simplex_node = node};
        const mn_camera camera = {.eye = {0, 0, 4 * scale}, .up = {0, 1, 0}, .fov_y_deg = 90};
        orbit o = orbit_from(&camera, 2 * scale);
        orbit_zoom(&o, -1);
        orbit_aim(&o, &front);
        ck_assert_float_eq_tol(o.target[2] / scale, 1, 1e-5f);
        if (e == 0)
            one = o;
        ck_assert_float_eq(o.distance, one.distance * scale);
        ck_assert_float_eq(o.turn, one.turn);
        ck_assert_float_eq(o.tilt, one.tilt);
    }
}
END_TEST

START_TEST(nothing_breaks_it) {
    const char *given = getenv("MN_SEED");
    const unsigned seed = given != NULL ? (unsigned)strtoul(given, NULL, 10) : (unsigned)time(NULL);
    unsigned state = seed;
    printf("MN_SEED=%u\n", seed);
    orbit o = orbit_from(&front_view, 2);
    for (int i = 0; i < 10000; i++) {
        const float a = (float)rand_r(&state) / (float)RAND_MAX * 4 - 2;
        const float b = (float)rand_r(&state) / (float)RAND_MAX * 4 - 2;
        orbit_turn(&o, a, b);
        orbit_zoom(&o, 10 * a);
        orbit_pan(&o, b, a);
        const mn_camera c = orbit_camera(&o);
        ck_assert(isfinite(distance(&c)));
        ck_assert(o.distance >= o.distance_min && o.distance <= o.distance_max);
        ck_assert(fabsf(o.tilt) < 1.56f && fabsf(o.turn) < 3.1416f);
    }
}
END_TEST

START_TEST(a_point_has_a_camera_too) {
    const mn_camera nowhere = {.fov_y_deg = 45};
    const orbit o = orbit_from(&nowhere, 0);
    const mn_camera c = orbit_camera(&o);
    ck_assert_float_gt(distance(&c), 0);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("orbit");
    TCase *tc = tcase_create("orbit");
    tcase_add_test(tc, stands_where_it_was);
    tcase_add_test(tc, turns_with_the_hand);
    tcase_add_test(tc, pans_with_the_pointer);
    tcase_add_test(tc, zooms_between_its_limits);
    tcase_add_test(tc, aims_at_the_nearest_triangle);
    tcase_add_test(tc, the_unit_of_length_does_not_show);
    tcase_add_test(tc, nothing_breaks_it);
    tcase_add_test(tc, a_point_has_a_camera_too);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
