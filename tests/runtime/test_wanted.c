/* Goal: what a camera wants is nested (a child is never wanted where its parent is not) and means
 * pixels. Method: closed forms at simple cameras, then random nodes, children, cameras and weights.
 */
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
    mni_lens_make(&lens, &camera, 200, 100, mni_lens_distance_min(1), tolerance_px, NULL);
    return lens;
}

static mn_cone no_bound(void) {
    return (mn_cone){.axis = {0, 0}, .angle = MN_CONE_NO_BOUND};
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

/* One factor, the others off. */
static mni_lens lens_with(mn_weights weights) {
    mn_camera camera = looking_down_z();
    mni_lens lens;
    if (weights.outside == 0)
        weights.outside = 1;
    if (weights.away == 0)
        weights.away = 1;
    mni_lens_make(&lens, &camera, 200, 100, mni_lens_distance_min(1), 1, &weights);
    return lens;
}

static double weight_of(const mni_lens *lens, const mni_bounds *node) {
    return mni_lens_priority(lens, node) / mni_lens_error_px(lens, node);
}

START_TEST(switched_off) {
    const float back[3] = {0, 0, -1};
    float in_view[3] = {0, 0, 0}, above[3] = {0, 20, 10};
    mni_bounds behind = {in_view, 0, 1, mn_cone_make(back, 0.1f)};
    mni_bounds outside = {above, 0, 1, mn_cone_make(back, 0.1f)};
    mni_lens none = lens_with((mn_weights){0}), far = lens_with((mn_weights){.outside = 5});
    mni_lens rear = lens_with((mn_weights){.away = 7});
    ck_assert_double_eq(weight_of(&none, &behind), 1);
    ck_assert_double_eq(weight_of(&none, &outside), 1);
    ck_assert_double_eq_tol(weight_of(&far, &outside), 0.2, 1e-12);
    ck_assert_double_eq(weight_of(&far, &behind), 1);
    ck_assert_double_eq_tol(weight_of(&rear, &behind), 1 / 7.0, 1e-12);
    ck_assert_double_eq(weight_of(&rear, &outside), 1); /* seen from above: edge on */
    ck_assert(!mni_lens_tightens(&rear));
}
END_TEST

/* At distance 10 on the axis, where the eye sees a point's normal under its own angle. */
START_TEST(silhouettes) {
    mni_lens lens = lens_with((mn_weights){.silhouette = 4});
    float at[3] = {0, 0, 0};
    static const struct {
        double tilt, half, radius, weight;
    } cases[] = {{0, 0, 0, 1},      /* face on: the sine is 0, and 1 the least weight */
                 {PI / 6, 0, 0, 2}, /* 4 sin 30° */
                 {0, PI / 6, 0, 2}, /* a cone counts by its far side */
                 {PI / 2 - 0.1, 0.2, 0, 4},
                 {PI / 2, 0, 0, 4},
                 {0, 0, 5, 2}, /* asin(5 / 10) */
                 {PI / 2 + 0.1, 0.2, 0, 4},
                 {0, PI, 0, 4},
                 {0, 0, 10, 4},          /* the eye inside */
                 {PI - 0.5, 0.2, 0, 1}}; /* away, which is off: as if there were nothing */
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const float axis[3] = {(float)sin(cases[i].tilt), 0, (float)cos(cases[i].tilt)};
        mni_bounds node = {at, (float)cases[i].radius, 1, mn_cone_make(axis, (float)cases[i].half)};
        double over = weight_of(&lens, &node) - cases[i].weight; /* cones are widened by a degree */
        ck_assert_msg(over > -1e-3 && over < 0.08, "case %zu: %g", i, weight_of(&lens, &node));
    }
}
END_TEST

/* From the right of the camera. */
START_TEST(light) {
    mni_lens lens = lens_with((mn_weights){.light = 3, .light_from = {2, 0, 0}});
    float at[3] = {0, 0, 0};
    static const struct {
        double tilt, half, weight;
    } cases[] = {{PI / 2, 0, 1},      /* one normal has no difference */
                 {PI / 2, PI / 3, 2}, /* cos 0 - cos 60° */
                 {PI / 2, PI / 2, 3},
                 {0, PI, 3},                   /* all and none */
                 {0, PI / 6, 2},               /* cos 60° - nothing beyond the horizon */
                 {-PI / 3, PI / 6 - 1e-3, 1}}; /* all in the dark */
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const float axis[3] = {(float)sin(cases[i].tilt), 0, (float)cos(cases[i].tilt)};
        mni_bounds node = {at, 0, 1, mn_cone_make(axis, (float)cases[i].half)};
        double over = weight_of(&lens, &node) - cases[i].weight; /* cones are widened by a degree */
        ck_assert_msg(over > -1e-3 && over < 0.08, "case %zu: %g", i, weight_of(&lens, &node));
    }
    /* without a direction: the key light of the pictures, left, above and behind the camera */
    mni_lens key = lens_with((mn_weights){.light = 3});
    ck_assert(key.light_from[0] < -0.4 && key.light_from[1] > 0.5 && key.light_from[2] > 0.5);
}
END_TEST

static float random_factor(void) {
    return uniform(0, 1) < 0.5 ? 0 : (float)uniform(1, 8);
}

static mn_weights random_weights(void) {
    mn_weights w = {random_factor(), random_factor(), random_factor(), random_factor(), {0}};
    for (int i = 0; i < 3; i++)
        w.light_from[i] = (float)uniform(-1, 1);
    return w;
}

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
        mni_lens lens;
        mn_weights weights = random_weights();
        mni_lens_make(&lens, &camera, 200, 100, mni_lens_distance_min(1), uniform(0.01, 1),
                      &weights);
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
    tcase_add_test(tc, switched_off);
    tcase_add_test(tc, silhouettes);
    tcase_add_test(tc, light);
    tcase_add_test(tc, nested);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
