/* Goal: error_px is what the picture can be off by, and no more: where nothing is left to split it
 * is the grid's error as near as the surface is, however far the spheres of wide nodes reach.
 * Method: full detail seen from close by, at hubs and elsewhere, against the distance to every
 * triangle, searched for here; fronts in between, where the error as tolerance must ask for
 * nothing. */
#include <check.h>
#include <math.h>
#include <string.h>

#include "model.h"
#include "suite.h"

enum { TRIANGLES = 400, CAMERAS = 40, HEIGHT = 480, FOV = 45 };

static const mn_block_desc levels_5 = {.blocking = MN_BLOCKING_LEVELS, .l = 5};
static const model_shape shapes[] = {MODEL_GLOBE, MODEL_TERRAIN, MODEL_PENCIL, MODEL_LOOSE};
enum { SHAPES = sizeof shapes / sizeof *shapes };

typedef struct triangle {
    double corner[3][3];
} triangle;

static bool triangle_at(const mn_front *front, uint32_t simplex, triangle *out) {
    const uint32_t *node = &front->simplex_node[3 * (size_t)simplex];
    if (node[0] == MN_NONE || node[2] == MN_NONE)
        return false;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++)
            out->corner[k][i] = front->position[3 * (size_t)node[k] + i];
    return true;
}

static void point_of(const triangle *t, double u, double v, double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = (1 - u) * t->corner[0][i] + u * ((1 - v) * t->corner[1][i] + v * t->corner[2][i]);
}

static double distance(const double a[3], const float b[3]) {
    double square = 0;
    for (int i = 0; i < 3; i++)
        square += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(square);
}

/* Of a triangle's segment at u, by halving in three: distance is convex along it. */
static double segment_distance(const triangle *t, double u, const float eye[3]) {
    double low = 0, high = 1, p[3];
    for (int i = 0; i < 80; i++) {
        const double a = low + (high - low) / 3, b = high - (high - low) / 3;
        point_of(t, u, a, p);
        const double at_a = distance(p, eye);
        point_of(t, u, b, p);
        if (at_a < distance(p, eye))
            high = b;
        else
            low = a;
    }
    point_of(t, u, low, p);
    return distance(p, eye);
}

static double triangle_distance(const triangle *t, const float eye[3]) {
    double low = 0, high = 1;
    for (int i = 0; i < 80; i++) {
        const double a = low + (high - low) / 3, b = high - (high - low) / 3;
        if (segment_distance(t, a, eye) < segment_distance(t, b, eye))
            high = b;
        else
            low = a;
    }
    return segment_distance(t, low, eye);
}

/* Of the triangle's box: no point of it is nearer. */
static double box_distance(const triangle *t, const float eye[3]) {
    double square = 0;
    for (int i = 0; i < 3; i++) {
        const double a = t->corner[0][i], b = t->corner[1][i], c = t->corner[2][i];
        const double off = fmax(fmin(a, fmin(b, c)) - eye[i], eye[i] - fmax(a, fmax(b, c)));
        square += off > 0 ? off * off : 0;
    }
    return sqrt(square);
}

static double front_distance(const mn_front *front, const float eye[3]) {
    double least = INFINITY;
    triangle t;
    for (uint32_t s = 0; s < front->simplex_slots; s++)
        if (triangle_at(front, s, &t) && box_distance(&t, eye) < least)
            least = fmin(least, triangle_distance(&t, eye));
    return least;
}

/* Looks at a random point of the surface from close by. */
static mn_camera close_by(const mn_front *front, double size) {
    mn_camera camera = {.fov_y_deg = FOV};
    triangle t;
    double at[3], away[3], length;
    while (!triangle_at(front, (uint32_t)(model_random() % front->simplex_slots), &t))
        continue;
    point_of(&t, model_uniform(0, 1), model_uniform(0, 1), at);
    do {
        length = 0;
        for (int i = 0; i < 3; i++) {
            away[i] = model_uniform(-1, 1);
            length += away[i] * away[i];
        }
    } while (length < 0.1);
    const double height = size * exp(model_uniform(log(0.001), log(0.3)));
    for (int i = 0; i < 3; i++) {
        camera.target[i] = (float)at[i];
        camera.eye[i] = (float)(at[i] + height * away[i] / sqrt(length));
        camera.up[i] = (float)model_uniform(-1, 1);
    }
    return camera;
}

static double size_of(const model *m) {
    double square = 0;
    for (int i = 0; i < 3; i++)
        square += pow((double)m->header.box_max[i] - (double)m->header.box_min[i], 2);
    return sqrt(square) / 2;
}

static double grid_px_at(const model *m, double away) {
    const double scale_px = HEIGHT / (2 * tan(FOV * M_PI / 360));
    return scale_px * (double)mn_grid_error(m->header.grid_step) / away;
}

START_TEST(what_is_whole_is_off_by_the_grid) {
    model m;
    model_make(&m, shapes[_i], TRIANGLES, &levels_5);
    mn_session_desc desc = model_desc(&m);
    mn_session *s = model_open(&desc);
    mn_session_set_tolerance(s, -1);
    mn_camera camera = model_camera(&m, 0, 3);
    mn_frame_stats stats;
    mn_front front;
    mn_session_frame(s, &camera, &stats);
    mn_session_front(s, &front);
    ck_assert_uint_eq(front.triangles, m.header.triangles);
    for (int i = 0; i < CAMERAS; i++) {
        camera = close_by(&front, size_of(&m));
        mn_session_frame(s, &camera, &stats);
        const double looked_at[3] = {camera.target[0], camera.target[1], camera.target[2]};
        ck_assert_double_ge(stats.error_inside_px,
                            0.9999 * grid_px_at(&m, distance(looked_at, camera.eye)));
        ck_assert_double_le(stats.error_inside_px,
                            1.0001 * grid_px_at(&m, front_distance(&front, camera.eye)));
        ck_assert_double_le(stats.error_px, stats.error_inside_px);
    }
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* Of a flat fan most is never split, since nothing is wrong with it; its sphere holds the eye. */
START_TEST(what_is_flat_is_off_by_the_grid) {
    const double tolerance_px = 0.01;
    model m;
    model_make(&m, MODEL_FAN, TRIANGLES, &levels_5);
    mn_session_desc desc = model_desc(&m);
    mn_session *s = model_open(&desc);
    mn_session_set_tolerance(s, (float)tolerance_px);
    mn_camera camera = model_camera(&m, 0, 3);
    mn_frame_stats stats;
    mn_front front;
    uint64_t inner = 0;
    mn_session_frame(s, &camera, &stats);
    for (int i = 0; i < CAMERAS; i++) {
        mn_session_front(s, &front);
        camera = close_by(&front, size_of(&m));
        mn_session_frame(s, &camera, &stats);
        mn_session_front(s, &front);
        inner += front.triangles < m.header.triangles;
        ck_assert_double_le(stats.error_px,
                            tolerance_px +
                                1.0001 * grid_px_at(&m, front_distance(&front, camera.eye)));
    }
    ck_assert_uint_gt(inner, CAMERAS / 2);
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* Switch values are in it as they are in what is wanted. */
START_TEST(its_own_tolerance_asks_for_nothing) {
    model m;
    model_make(&m, shapes[_i], TRIANGLES, &levels_5);
    mn_session_desc desc = model_desc(&m);
    desc.weights.outside = 1e9f;
    desc.weights.away = 1;
    mn_session *s = model_open(&desc);
    uint64_t splits = 0;
    for (int i = 0; i < CAMERAS; i++) {
        const mn_camera camera = model_camera(&m, model_uniform(0, 1), exp(model_uniform(-1, 2)));
        mn_frame_stats stats;
        mn_session_set_tolerance(s, (float)exp(model_uniform(0, 4)));
        mn_session_frame(s, &camera, &stats);
        const double error_px = stats.error_inside_px;
        mn_session_set_tolerance(s, nextafterf((float)error_px, INFINITY));
        mn_session_frame(s, &camera, &stats);
        ck_assert_uint_eq(stats.splits, 0);
        mn_session_set_tolerance(s, (float)error_px / 2);
        mn_session_frame(s, &camera, &stats);
        splits += stats.splits;
    }
    ck_assert(splits > 0 || shapes[_i] == MODEL_LOOSE); /* of which most is whole */
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* Of a front that is next to nothing the spheres hold the eye, and what is drawn may be behind it;
 * nothing of the model is nearer than its box all the same. (2.5e9 pixels were told.) */
START_TEST(nothing_is_nearer_than_the_box) {
    model m;
    model_make(&m, shapes[_i], TRIANGLES, &levels_5);
    mn_session_desc desc = model_desc(&m);
    desc.triangles_max = 1;
    for (int i = 0; i < CAMERAS; i++) {
        const mn_camera camera = model_camera(&m, model_uniform(0, 1), exp(model_uniform(1, 3)));
        mn_frame_stats stats;
        double square = 0;
        for (int k = 0; k < 3; k++) {
            const double eye = (double)camera.eye[k], low = (double)m.header.box_min[k];
            const double off = fmax(low - eye, eye - (double)m.header.box_max[k]);
            square += off > 0 ? off * off : 0;
        }
        mn_session *s = model_open(&desc); /* whose tolerance has not given way yet */
        mn_session_frame(s, &camera, &stats);
        mn_session_close(s);
        /* no switch value is larger than twice the model across */
        ck_assert_double_le(stats.error_inside_px * mn_grid_error(m.header.grid_step),
                            grid_px_at(&m, sqrt(square)) *
                                (4 * size_of(&m) + mn_grid_error(m.header.grid_step)));
    }
    model_free(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("error");
    TCase *tc = tcase_create("error");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, what_is_whole_is_off_by_the_grid, 0, SHAPES);
    tcase_add_test(tc, what_is_flat_is_off_by_the_grid);
    tcase_add_loop_test(tc, its_own_tolerance_asks_for_nothing, 0, SHAPES);
    tcase_add_loop_test(tc, nothing_is_nearer_than_the_box, 0, SHAPES);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
