/* Goal: what a camera wants is nested (a child is never wanted where its parent is not) and means
 * pixels. Method: closed forms at simple cameras, then random nodes, children and cameras. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "suite.h"
#include "wanted.h"

#define PI 3.14159265358979323846

static uint64_t random_state;

static double uniform(double lo, double hi) {
    random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return lo + (hi - lo) * (double)(random_state >> 11) * 0x1p-53;
}

static void seed_random(void) {
    const char *text = getenv("MN_SEED");
    random_state = text != NULL ? strtoull(text, NULL, 10) : 20261122;
    printf("MN_SEED=%llu\n", (unsigned long long)random_state);
}

static mn_camera looking_down_z(void) {
    return (mn_camera){.eye = {0, 0, 10}, .target = {0, 0, 0}, .up = {0, 1, 0}, .fov_y_deg = 90};
}

static mni_lens lens_of(mn_camera camera, double tolerance_px) {
    mni_lens lens;
    mni_lens_make(&lens, &camera, 200, 100, 1, tolerance_px);
    return lens;
}

static mn_cone no_bound(void) {
    return (mn_cone){.axis = {0, 0}, .angle = UINT16_MAX};
}

/* 100 pixels high at 90 degrees: 50 pixels a unit at distance 1. */
START_TEST(pixels) {
    mni_lens lens = lens_of(looking_down_z(), 1);
    float at[3] = {0, 0, 0};
    mni_bounds node = {at, 5, 0.2f, no_bound()};
    ck_assert_double_eq_tol(mni_lens_error_px(&lens, &node), 50 * 0.2 / 5, 1e-6);
    ck_assert(mni_lens_wants(&lens, &node));
    node.switch_value = 0.09f;
    ck_assert(!mni_lens_wants(&lens, &node));
}
END_TEST

/* The eye inside the sphere: a large error, but a finite one; a flat node has none anywhere. */
START_TEST(inside_the_sphere) {
    mni_lens lens = lens_of(looking_down_z(), 1);
    float at[3] = {0, 0, 9};
    mni_bounds node = {at, 5, 1e-3f, no_bound()};
    ck_assert(isfinite(mni_lens_error_px(&lens, &node)) && mni_lens_wants(&lens, &node));
    node.switch_value = 0;
    ck_assert(!mni_lens_wants(&lens, &node));
}
END_TEST

START_TEST(limits_of_the_tolerance) {
    float at[3] = {0, 0, 0};
    mni_bounds flat = {at, 0, 0, no_bound()}, coarse = {at, 20, 1e30f, no_bound()};
    mni_lens all = lens_of(looking_down_z(), -1), none = lens_of(looking_down_z(), INFINITY);
    ck_assert(mni_lens_wants(&all, &flat) && mni_lens_wants(&all, &coarse));
    ck_assert(!mni_lens_wants(&none, &flat) && !mni_lens_wants(&none, &coarse));
}
END_TEST

/* The half angle of view is 45 degrees up and atan 2 sideways. */
START_TEST(frustum) {
    mni_lens lens = lens_of(looking_down_z(), 1);
    static const struct {
        float at[3], radius;
        bool inside;
    } cases[] = {{{0, 0, 0}, 0, true},     {{0, 9.9f, 0}, 0, true},   {{0, 10.1f, 0}, 0, false},
                 {{0, 10.1f, 0}, 1, true}, {{19.9f, 0, 0}, 0, true},  {{20.1f, 0, 0}, 0, false},
                 {{0, 0, 11}, 0.5, false}, {{0, 0, 11}, 1.5, true},   {{0, -12, 0}, 1, false},
                 {{0, 0, -1e6f}, 0, true}, {{-20.1f, 0, 0}, 1, true}, {{0, 0, 10}, 0, true}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        mni_bounds node = {cases[i].at, cases[i].radius, 1, no_bound()};
        ck_assert_msg(mni_lens_inside(&lens, &node) == cases[i].inside, "case %zu", i);
    }
}
END_TEST

/* Twice the tolerance: wanted in view, not outside, nor where all faces away; and there wanted as
 * well when it is larger by the factor. */
START_TEST(tolerance_grows) {
    mni_lens lens = lens_of(looking_down_z(), 1);
    const float back[3] = {0, 0, -1}, front[3] = {0, 0, 1};
    float in_view[3] = {0, 0, 0}, above[3] = {0, 20, 10};
    mni_bounds seen = {in_view, 0, 2 * 10 / 50.0f, mn_cone_make(front, 0.1f)};
    mni_bounds behind = {in_view, 0, 2 * 10 / 50.0f, mn_cone_make(back, 0.1f)};
    mni_bounds outside = {above, 0, 2 * 20 / 50.0f, no_bound()};
    ck_assert(mni_lens_wants(&lens, &seen));
    ck_assert(!mni_lens_wants(&lens, &behind) && !mni_lens_wants(&lens, &outside));
    behind.switch_value *= 1.01f * MNI_WANTED_AWAY / 2;
    outside.switch_value *= 1.01f * MNI_WANTED_OUTSIDE / 2;
    ck_assert(mni_lens_wants(&lens, &behind) && mni_lens_wants(&lens, &outside));
}
END_TEST

START_TEST(away) {
    mni_lens lens = lens_of(looking_down_z(), 1);
    float at[3] = {0, 0, 0};
    const float back[3] = {0, 0, -1}, front[3] = {0, 0, 1}, side[3] = {1, 0, 0};
    mni_bounds node = {at, 1, 1, mn_cone_make(back, (float)(PI / 6))};
    ck_assert(mni_lens_away(&lens, &node));
    node.cone = mn_cone_make(front, (float)(PI / 6));
    ck_assert(!mni_lens_away(&lens, &node));
    node.cone = mn_cone_make(side, 0.01f); /* edge on: the sphere's spread decides */
    ck_assert(!mni_lens_away(&lens, &node));
    node.cone = mn_cone_make(back, (float)(PI / 2));
    ck_assert(!mni_lens_away(&lens, &node));
    node.cone = mn_cone_make(back, 0.1f);
    node.radius = 11; /* the eye is inside */
    ck_assert(!mni_lens_away(&lens, &node));
}
END_TEST

/* Up along the line of sight, eye on the target: no NaN comes of it. */
START_TEST(degenerate_cameras) {
    mn_camera camera = looking_down_z();
    camera.up[1] = 0, camera.up[2] = 1;
    float at[3] = {0, 0, 0};
    mni_bounds node = {at, 1, 1, no_bound()};
    mni_lens lens = lens_of(camera, 1);
    ck_assert(mni_lens_inside(&lens, &node) && isfinite(mni_lens_priority(&lens, &node)));
    camera.eye[2] = 0;
    lens = lens_of(camera, 1);
    ck_assert(isfinite(mni_lens_priority(&lens, &node)));
}
END_TEST

static void random_direction(float out[3]) {
    double v[3], length;
    do {
        for (int i = 0; i < 3; i++)
            v[i] = uniform(-1, 1);
        length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    } while (length < 0.1 || length > 1);
    for (int i = 0; i < 3; i++)
        out[i] = (float)(v[i] / length);
}

/* A child, and a parent as the build makes them: bounds just so large that they enclose. */
START_TEST(nested) {
    seed_random();
    uint64_t wanted_parents = 0, wanted_children = 0;
    for (int i = 0; i < 200000; i++) {
        float child_at[3], parent_at[3], axis[3], other[3];
        double offset = 0;
        for (int k = 0; k < 3; k++) {
            child_at[k] = (float)uniform(-1, 1);
            parent_at[k] = i % 3 == 0 ? child_at[k] : child_at[k] + (float)uniform(-0.3, 0.3);
            double d = (double)parent_at[k] - (double)child_at[k];
            offset += d * d;
        }
        float radius = i % 5 == 0 ? 0 : (float)uniform(0, 0.3);
        random_direction(axis);
        random_direction(other);
        mn_cone cone = mn_cone_make(axis, (float)uniform(0, 1));
        mni_bounds child = {child_at, radius, (float)uniform(0, 0.01), cone};
        mni_bounds parent = {parent_at, nextafterf((float)(sqrt(offset) + radius), INFINITY),
                             child.switch_value * (i % 2 ? 1.0f : 1.2f),
                             mn_cone_merge(cone, mn_cone_make(other, (float)uniform(0, 0.3)))};
        mn_camera camera = {.up = {0, 1, 0}, .fov_y_deg = (float)uniform(10, 120)};
        for (int k = 0; k < 3; k++) {
            camera.eye[k] = (float)uniform(-3, 3);
            camera.target[k] = (float)uniform(-3, 3);
        }
        mni_lens lens = lens_of(camera, uniform(0.01, 1));
        ck_assert(!mni_lens_inside(&lens, &child) || mni_lens_inside(&lens, &parent));
        ck_assert(!mni_lens_away(&lens, &parent) || mni_lens_away(&lens, &child));
        ck_assert(mni_lens_priority(&lens, &child) <= mni_lens_priority(&lens, &parent));
        bool c = mni_lens_wants(&lens, &child), p = mni_lens_wants(&lens, &parent);
        ck_assert(!c || p);
        ck_assert(c == (mni_lens_priority(&lens, &child) > lens.tolerance_px));
        wanted_children += c;
        wanted_parents += p;
    }
    ck_assert(wanted_children > 1000 && wanted_children < wanted_parents); /* both sides seen */
    ck_assert(wanted_parents < 199000);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("wanted");
    TCase *tc = tcase_create("wanted");
    tcase_add_test(tc, pixels);
    tcase_add_test(tc, inside_the_sphere);
    tcase_add_test(tc, limits_of_the_tolerance);
    tcase_add_test(tc, frustum);
    tcase_add_test(tc, tolerance_grows);
    tcase_add_test(tc, away);
    tcase_add_test(tc, degenerate_cameras);
    tcase_add_test(tc, nested);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
