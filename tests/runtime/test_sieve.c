/* Goal: what the sieve says is what mni_lens_wants says, and it rarely says nothing. Method: random
 * nodes, many near where the decision turns, random cameras near and far, random weights; every
 * vector width that the processor has is the same function by construction, so the one that is used
 * is compared. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "sieve.h"
#include "suite.h"

static uint64_t random_state;

static double uniform(double lo, double hi) {
    random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return lo + (hi - lo) * (double)(random_state >> 11) * 0x1p-53;
}

typedef struct node {
    float position[3], radius, switch_value;
    mn_cone cone;
} node;

static mni_bounds bounds_of(const node *n) {
    return (mni_bounds){n->position, n->radius, n->switch_value, n->cone};
}

static node random_node(double size) {
    node n = {.radius = uniform(0, 1) < 0.2 ? 0 : (float)(size * pow(10, uniform(-4, 0))),
              .switch_value = uniform(0, 1) < 0.1 ? 0 : (float)(size * pow(10, uniform(-7, -1)))};
    float axis[3];
    for (int i = 0; i < 3; i++) {
        n.position[i] = (float)uniform(-size, size);
        axis[i] = (float)uniform(-1, 1);
    }
    n.cone = uniform(0, 1) < 0.1 ? (mn_cone){{0, 0}, MN_CONE_NO_BOUND}
                                 : mn_cone_make(axis, (float)uniform(0, 1.7));
    return n;
}

/* Defaults half of the time; else each factor off, small or large. */
static mn_weights random_weights(void) {
    static const float factors[] = {0, 1, 1.5f, 4, 64};
    mn_weights w = {0};
    if (uniform(0, 1) < 0.5)
        return w;
    float *factor[] = {&w.outside, &w.away, &w.silhouette, &w.light};
    for (int i = 0; i < 4; i++)
        *factor[i] = factors[(int)uniform(0, 5)];
    for (int i = 0; i < 3; i++)
        w.light_from[i] = (float)uniform(-1, 1);
    return w;
}

static mn_camera random_camera(double size) {
    mn_camera camera = {.up = {0, 1, 0}, .fov_y_deg = (float)uniform(10, 120)};
    double far = pow(10, uniform(-2, 1.5));
    for (int i = 0; i < 3; i++) {
        camera.eye[i] = (float)uniform(-far * size, far * size);
        camera.target[i] = (float)uniform(-size, size);
    }
    return camera;
}

static mni_lens random_lens(double size, double tolerance_px) {
    mn_camera camera = random_camera(size);
    mni_lens lens;
    mn_weights weights = random_weights();
    mni_lens_make(&lens, &camera, 1280, 720, mni_lens_distance_min(size), tolerance_px, &weights);
    return lens;
}

/* Switch values so that the node is wanted by a hair, or not by one. */
static void move_to_the_edge(node *n, const mni_lens *lens) {
    mni_bounds bounds = bounds_of(n);
    double priority_px = mni_lens_priority(lens, &bounds);
    double hair = uniform(0, 1) < 0.5 ? 0 : uniform(-1, 1) * pow(10, uniform(-7, -3));
    if (priority_px > 0 && isfinite(priority_px))
        n->switch_value *= (float)(lens->tolerance_px / priority_px * (1 + hair));
}

/* From the same bounds, laid out otherwise. */
static void far_margins(const mni_sieve *sieve, const mni_sieve *soon, const node *nodes,
                        float far[MNI_SIEVE_BATCH]) {
    float position[3 * MNI_SIEVE_BATCH], radius[MNI_SIEVE_BATCH], value[MNI_SIEVE_BATCH];
    for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
        for (int k = 0; k < 3; k++)
            position[3 * i + k] = nodes[i].position[k];
        radius[i] = nodes[i].radius;
        value[i] = nodes[i].switch_value;
    }
    mni_sieve_far(sieve, soon, position, radius, value, far);
}

/* For two cameras: the lesser of what each says. */
static void check_both(const mni_sieve *sieve, const node *nodes,
                       const float far[MNI_SIEVE_BATCH]) {
    const mni_lens other = random_lens(1, 1);
    mni_sieve soon;
    float then[MNI_SIEVE_BATCH], both[MNI_SIEVE_BATCH];
    mni_sieve_make(&soon, &other, 1);
    far_margins(&soon, NULL, nodes, then);
    far_margins(sieve, &soon, nodes, both);
    for (int i = 0; i < MNI_SIEVE_BATCH; i++)
        ck_assert_float_eq(both[i], fminf(far[i], then[i]));
}

static void check_far(const mni_sieve *sieve, const mni_lens *lens, const node *nodes) {
    float far[MNI_SIEVE_BATCH];
    far_margins(sieve, NULL, nodes, far);
    check_both(sieve, nodes, far);
    for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
        mni_bounds bounds = bounds_of(&nodes[i]);
        ck_assert(!(far[i] > 0) ||
                  mni_lens_error_px(lens, &bounds) * lens->most <= lens->tolerance_px);
    }
}

static uint32_t compare(const mni_sieve *sieve, const mni_lens *lens, const node *nodes) {
    static mni_sieve_batch batch;
    uint8_t verdict[MNI_SIEVE_BATCH];
    float margin[MNI_SIEVE_BATCH];
    uint32_t unsure = 0;
    for (int i = 0; i < MNI_SIEVE_BATCH; i++)
        mni_sieve_put(&batch, i, nodes[i].position, nodes[i].radius, nodes[i].switch_value,
                      nodes[i].cone);
    mni_sieve_judge(sieve, &batch, verdict, margin);
    check_far(sieve, lens, nodes);
    for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
        mni_bounds bounds = bounds_of(&nodes[i]);
        bool wanted = mni_lens_wants(lens, &bounds);
        double priority_px = 0;
        ck_assert(mni_sieve_wants(sieve, lens, &bounds, &priority_px) == wanted);
        ck_assert(!wanted || priority_px == mni_lens_priority(lens, &bounds));
        ck_assert_uint_le(verdict[i], MNI_UNWANTED);
        ck_assert(verdict[i] != MNI_WANTED || wanted);
        ck_assert(verdict[i] != MNI_UNWANTED || !wanted);
        unsure += verdict[i] == MNI_UNSURE;
    }
    return unsure;
}

/* Models of any size: what is relative stays relative. */
START_TEST(never_wrong) {
    static const double sizes[] = {1, 1e-11, 1e16, 3e5};
    double size = sizes[_i % 4];
    uint64_t unsure[2] = {0}, wanted = 0, asked = 0;
    for (int round = 0; round < 4000; round++) {
        node nodes[MNI_SIEVE_BATCH];
        mni_lens lens = random_lens(size, pow(10, uniform(-2, 2)));
        mni_sieve sieve;
        mni_sieve_make(&sieve, &lens, (float)size);
        bool edge = round % 2;
        for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
            nodes[i] = random_node(size);
            if (edge)
                move_to_the_edge(&nodes[i], &lens);
            mni_bounds bounds = bounds_of(&nodes[i]);
            wanted += mni_lens_wants(&lens, &bounds);
        }
        unsure[edge] += compare(&sieve, &lens, nodes);
        asked += MNI_SIEVE_BATCH;
    }
    ck_assert(wanted > asked / 10 && wanted < asked * 9 / 10);
    ck_assert_uint_lt(unsure[0], asked / 2 / 50); /* rarely unsure where there is nothing special */
    ck_assert_uint_gt(unsure[1], asked / 2 / 20); /* the edge was met */
}
END_TEST

/* Everything wanted, nothing wanted, and numbers that squares do not hold: unsure or right. */
START_TEST(limits) {
    static const double tolerances[] = {-1, 0, 1e-300, 1e300, INFINITY};
    for (int t = 0; t < 5; t++)
        for (int round = 0; round < 50; round++) {
            node nodes[MNI_SIEVE_BATCH];
            static const double sizes[] = {1, 1e19, 1e-20, 1e-30};
            double size = sizes[round % 4];
            mni_lens lens = random_lens(size, tolerances[t]);
            mni_sieve sieve;
            mni_sieve_make(&sieve, &lens, (float)size);
            for (int i = 0; i < MNI_SIEVE_BATCH; i++)
                nodes[i] = random_node(size);
            compare(&sieve, &lens, nodes);
        }
}
END_TEST

/* Clocks before, at and after the reading, and of nobody. */
START_TEST(late_is_not_above) {
    for (int round = 0; round < 1000; round++) {
        float due[MNI_SIEVE_BATCH], clock = (float)uniform(0, 10);
        for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
            const double what = uniform(0, 1);
            due[i] = what < 0.2   ? clock
                     : what < 0.3 ? INFINITY
                     : what < 0.4 ? -1
                     : what < 0.5 ? nextafterf(clock, INFINITY)
                                  : (float)uniform(0, 10);
        }
        const uint64_t late = mni_sieve_late(due, clock);
        for (int i = 0; i < MNI_SIEVE_BATCH; i++)
            ck_assert_uint_eq(late >> i & 1, due[i] <= clock);
    }
}
END_TEST

/* The camera a little further on, by any of its parts. */
static mn_camera moved(mn_camera camera, double size) {
    double step = size * pow(10, uniform(-4, -0.5));
    for (int i = 0; i < 3; i++) {
        camera.eye[i] += (float)uniform(-step, step);
        camera.target[i] += (float)uniform(-step, step);
        camera.up[i] += (float)uniform(-0.1, 0.1);
    }
    return camera;
}

/* A verdict stands for as much motion as its margin says, and margins are worth having. */
START_TEST(margins_hold) {
    static mni_sieve_batch batch;
    uint64_t stood = 0, sure = 0;
    double size = _i == 0 ? 1 : 3e5;
    for (int round = 0; round < 6000; round++) {
        mn_camera from = random_camera(size), to = moved(from, size);
        mn_weights weights = random_weights();
        mni_lens before, after;
        double tolerance_px = pow(10, uniform(-2, 2));
        mni_lens_make(&before, &from, 1280, 720, mni_lens_distance_min(size), tolerance_px,
                      &weights);
        mni_lens_make(&after, &to, 1280, round % 2 ? 720 : 715, mni_lens_distance_min(size),
                      tolerance_px, &weights);
        double motion = mni_sieve_motion(&before, &after, size);
        ck_assert(round % 2 == 0 || isfinite(motion)); /* another height, another reach */
        mni_sieve sieve;
        mni_sieve_make(&sieve, &before, (float)size);
        node nodes[MNI_SIEVE_BATCH];
        uint8_t verdict[MNI_SIEVE_BATCH];
        float margin[MNI_SIEVE_BATCH], far[MNI_SIEVE_BATCH];
        for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
            nodes[i] = random_node(size);
            mni_sieve_put(&batch, i, nodes[i].position, nodes[i].radius, nodes[i].switch_value,
                          nodes[i].cone);
        }
        mni_sieve_judge(&sieve, &batch, verdict, margin);
        far_margins(&sieve, NULL, nodes, far);
        for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
            mni_bounds bounds = bounds_of(&nodes[i]);
            bool wanted = mni_lens_wants(&after, &bounds);
            ck_assert(!(far[i] > motion) || !wanted);
            ck_assert(!(margin[i] > motion) || wanted == (verdict[i] == MNI_WANTED));
            ck_assert(margin[i] == 0 || verdict[i] != MNI_UNSURE);
            stood += margin[i] > motion;
            sure += isfinite(motion) && verdict[i] != MNI_UNSURE;
        }
    }
    ck_assert_uint_gt(stood, sure / 4);
}
END_TEST

/* A camera that circles about the model at twice its size: no plane moves more than the eye does.
 */
START_TEST(a_circle_is_as_long_as_it_is) {
    const double size = 10, turn = 6.283185307 / 200;
    for (int i = 0; i < 200; i++) {
        mn_camera camera[2] = {{.up = {0, 1, 0}, .fov_y_deg = 45},
                               {.up = {0, 1, 0}, .fov_y_deg = 45}};
        mni_lens lens[2];
        for (int k = 0; k < 2; k++) {
            camera[k].eye[0] = (float)(2 * size * sin((i + k) * turn));
            camera[k].eye[1] = (float)(size / 2);
            camera[k].eye[2] = (float)(2 * size * cos((i + k) * turn));
            mni_lens_make(&lens[k], &camera[k], 1280, 720, mni_lens_distance_min(size), 1, NULL);
        }
        const double way = 2 * 2 * size * sin(turn / 2),
                     motion = mni_sieve_motion(&lens[0], &lens[1], size);
        ck_assert_double_ge(motion, way * 0.9999);
        ck_assert_double_le(motion, way * 1.0001);
        ck_assert(mni_sieve_motion(&lens[0], &lens[0], size) == 0);
    }
}
END_TEST

int main(void) {
    const char *seed = getenv("MN_SEED");
    random_state = seed != NULL ? strtoull(seed, NULL, 10) : 20261122;
    printf("MN_SEED=%llu\n", (unsigned long long)random_state);
    Suite *suite = suite_create("sieve");
    TCase *tc = tcase_create("sieve");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, never_wrong, 0, 4);
    tcase_add_loop_test(tc, margins_hold, 0, 2);
    tcase_add_test(tc, a_circle_is_as_long_as_it_is);
    tcase_add_test(tc, limits);
    tcase_add_test(tc, late_is_not_above);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
