/* Goal: a window shows what an offscreen picture shows, and polling neither blocks nor invents.
 * Method: the same front drawn both ways and compared, on the display there is (the build runs this
 * under xvfb-run). Skipped without a display. MN_GL_PICTURES=DIR keeps the window's picture. */
#include <check.h>
#include <stdio.h>

#include "fake.h"
#include "gl_load.h"
#include "suite.h"

enum { W = 320, H = 240 };
static gl_load load;

/* Draws the front in a new window or offscreen. The picture's size may be another one where the
 * display has no room, or more pixels than units: it is returned. Freed by the caller. */
static uint8_t *drawn(const fake *f, bool window, uint32_t *width, uint32_t *height) {
    mn_gl *gl = NULL;
    mn_status st = {0};
    const mn_gl_look look = {0};
    const mn_camera camera = {.eye = {1, 1, 3}, .up = {0, 1, 0}, .fov_y_deg = 45};
    mn_gl_desc desc = f->desc;
    desc.width_px = *width;
    desc.height_px = *height;
    const mn_code code =
        window ? load.api->window_open(&desc, &gl, &st) : load.api->offscreen_open(&desc, &gl, &st);
    ck_assert_msg(code == MN_OK, "%s", st.text);
    ck_assert_int_eq(load.api->front(gl, &f->front, &st), MN_OK);
    for (int i = 0; i < 3; i++) { /* a window manager may resize it at first */
        mn_gl_input input = {.closed = true};
        ck_assert_msg(load.api->draw(gl, &camera, &look, &st) == MN_OK, "%s", st.text);
        if (window) {
            load.api->title(gl, "test");
            load.api->poll(gl, i == 1 ? 0.05 : 0, &input);
            ck_assert(!input.closed && input.typed_count == 0 && input.zoom == 0);
            ck_assert(input.orbit[0] == 0 && input.orbit[1] == 0);
        }
    }
    load.api->size(gl, width, height);
    uint8_t *rgba = malloc(4 * (size_t)*width * *height);
    ck_assert_ptr_nonnull(rgba);
    ck_assert_msg(load.api->draw(gl, &camera, &look, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(load.api->pixels(gl, rgba, &st) == MN_OK, "%s", st.text);
    const char *dir = getenv("MN_GL_PICTURES");
    char path[256];
    if (window && dir != NULL) {
        snprintf(path, sizeof path, "%s/window.png", dir);
        ck_assert_msg(load.api->png(gl, path, &st) == MN_OK, "%s", st.text);
    }
    load.api->close(gl);
    return rgba;
}

/* Two drivers may be at work: a step of colour here and there, a few pixels of outline. */
START_TEST(shows_what_offscreen_shows) {
    fake f = fake_sphere(48, W, H);
    uint32_t width = W, height = H;
    uint8_t *window = drawn(&f, true, &width, &height);
    const uint32_t window_width = width, window_height = height;
    uint8_t *offscreen = drawn(&f, false, &width, &height);
    ck_assert_uint_eq(width, window_width);
    ck_assert_uint_eq(height, window_height);
    uint32_t other = 0, covered = 0;
    for (size_t i = 0; i < (size_t)width * height; i++) {
        bool same = true;
        for (size_t c = 4 * i; c < 4 * i + 4; c++)
            same = same && abs(window[c] - offscreen[c]) <= 8;
        other += !same;
        covered += window[4 * i + 3] == 255;
    }
    ck_assert_uint_gt(covered, width * height / 20);
    ck_assert_uint_lt(other, width * height / 200);
    free(window);
    free(offscreen);
    fake_free(&f);
}
END_TEST

/* GLFW is global: closing one window must leave room for the next. */
START_TEST(opens_again) {
    fake f = fake_sheet(4, W, H);
    for (int i = 0; i < 3; i++) {
        uint32_t width = W + 10 * (uint32_t)i, height = H;
        free(drawn(&f, true, &width, &height));
    }
    fake_free(&f);
}
END_TEST

int main(void) {
    fake f = fake_sheet(2, W, H);
    mn_gl *gl = NULL;
    mn_status st = {0};
    mn_code code = gl_load_module(&load, &st);
    if (code != MN_OK) {
        fprintf(stderr, "%s\n", st.text);
        return 1;
    }
    code = load.api->window_open(&f.desc, &gl, &st);
    if (code == MN_OK) {
        load.api->close(gl);
        code = load.api->offscreen_open(&f.desc, &gl, &st);
    }
    fake_free(&f);
    if (code != MN_OK) {
        fprintf(stderr, "skipped: %s\n", st.text);
        return code == MN_NO_GRAPHICS ? 77 : 1;
    }
    load.api->close(gl);
    Suite *suite = suite_create("window");
    TCase *tc = tcase_create("window");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, shows_what_offscreen_shows);
    tcase_add_test(tc, opens_again);
    suite_add_tcase(suite, tc);
    return suite_run_as(suite, CK_NOFORK); /* drivers have threads */
}
