/* Goal: a front becomes a picture without cracks or black faces, with the navigator's projection.
 * Method: the module itself, loaded as the program does; fronts made by hand, seen from places
 * where the right pixels are known. Alpha is the share of a pixel that the mesh covers. Skipped
 * without EGL. MN_GL_PICTURES=DIR keeps what was drawn. */
#include <check.h>
#include <stdio.h>

#include "fake.h"
#include "gl_load.h"
#include "suite.h"

enum { W = 320, H = 240 };

static gl_load load;
static mn_gl *gl;
static uint8_t rgba[4 * W * H];

static const mn_gl_look smooth;
static const mn_gl_look wire = {.wireframe = true};

static void open_for(const fake *f) {
    mn_status st = {0};
    ck_assert_msg(load.api->offscreen_open(&f->desc, &gl, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(load.api->front(gl, &f->front, &st) == MN_OK, "%s", st.text);
}

static void draw(const mn_camera *camera, const mn_gl_look *look, const char *name) {
    mn_status st = {0};
    ck_assert_msg(load.api->draw(gl, camera, look, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(load.api->pixels(gl, rgba, &st) == MN_OK, "%s", st.text);
    const char *dir = getenv("MN_GL_PICTURES");
    char path[256];
    if (dir == NULL)
        return;
    snprintf(path, sizeof path, "%s/%s.png", dir, name);
    ck_assert_msg(load.api->png(gl, path, &st) == MN_OK, "%s", st.text);
}

static const uint8_t *at(int x, int y) {
    return rgba + 4 * (W * y + x);
}

static int brightness(const uint8_t *p) {
    return (p[0] + p[1] + p[2]) / 3;
}

static mn_camera from(float x, float y, float z) {
    return (mn_camera){.eye = {x, y, z}, .up = {0, 1, 0}, .fov_y_deg = 45};
}

/* Every pixel well inside a disc about the picture's centre is covered whole, every one well
 * outside is bare. Returns the mean brightness inside, and the darkest. */
static int check_disc(double radius_px, int *darkest) {
    long sum = 0, count = 0;
    *darkest = 255;
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) {
            const double r = hypot(x + 0.5 - W / 2.0, y + 0.5 - H / 2.0);
            if (r > radius_px + 2)
                ck_assert_msg(at(x, y)[3] == 0, "mesh at %d, %d", x, y);
            if (r >= radius_px - 2)
                continue;
            ck_assert_msg(at(x, y)[3] == 255, "background shows through at %d, %d", x, y);
            const int b = brightness(at(x, y));
            *darkest = b < *darkest ? b : *darkest;
            sum += b;
            count++;
        }
    return (int)(sum / count);
}

/* Also the projection: a sphere of radius 1 at distance d covers a disc of tangent 1 / √(d² - 1).
 */
START_TEST(a_sphere_is_a_whole_disc) {
    fake f = fake_sphere(96, W, H);
    open_for(&f);
    const double d = 3.5, radius_px = H / 2.0 / tan(M_PI / 8) / sqrt(d * d - 1);
    const mn_camera views[3] = {from(0, 0, 3.5f), from(3.5f, 0, 0), from(-2.1f, 0, -2.8f)};
    for (int i = 0; i < 3; i++)
        for (int look = 0; look < 4; look++) {
            const mn_gl_look l = {
                .wireframe = look == 1, .lod_colors = look == 2, .flat = look == 3};
            int darkest;
            char name[32];
            snprintf(name, sizeof name, "sphere-%d-%d", i, look);
            draw(&views[i], &l, name);
            const int mean = check_disc(radius_px, &darkest);
            ck_assert_int_gt(mean, look == 1 || look == 2 ? 60 : 110);
            ck_assert_int_lt(mean, 230);
            if (look != 1)
                ck_assert_int_gt(darkest, 30);
        }
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

START_TEST(both_sides_of_a_sheet_are_lit) {
    fake f = fake_sheet(8, W, H);
    open_for(&f);
    int front[3] = {0}, back[3] = {0};
    const mn_camera before = from(0, 0, 3), behind = from(0, 0, -3);
    draw(&before, &smooth, "sheet-front");
    for (int c = 0; c < 3; c++)
        front[c] = at(W / 2, H / 2)[c];
    draw(&behind, &smooth, "sheet-back");
    for (int c = 0; c < 3; c++)
        back[c] = at(W / 2, H / 2)[c];
    for (int c = 0; c < 3; c++) {
        ck_assert_int_gt(front[c], 90);
        ck_assert_int_le(abs(front[c] - back[c]), 2);
    }
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

START_TEST(vertex_colors_are_used) {
    fake f = fake_sheet(8, W, H);
    f.desc.has_colors = true;
    f.front.color = f.color;
    open_for(&f);
    const mn_camera camera = from(0, 0, 3);
    draw(&camera, &smooth, "sheet-red");
    ck_assert_int_gt(at(W / 2, H / 2)[0], 150);
    ck_assert_int_lt(at(W / 2, H / 2)[1], 90);
    f.front.color = NULL; /* a front without them falls back to clay */
    mn_status st = {0};
    ck_assert_int_eq(load.api->front(gl, &f.front, &st), MN_OK);
    draw(&camera, &smooth, "sheet-clay");
    ck_assert_int_gt(at(W / 2, H / 2)[1], 90);
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

/* Two sheets wound against each other share their edge: smooth normals cancel there. */
START_TEST(misoriented_neighbours_are_not_black) {
    fake f = fake_sheet(8, W, H);
    for (uint32_t s = 0; s < f.front.simplex_slots; s += 2) {
        uint32_t *v = f.node + 3 * s, t = v[0];
        if (v[0] == MN_NONE || v[2] == MN_NONE)
            continue;
        v[0] = v[1];
        v[1] = t;
    }
    open_for(&f);
    const mn_camera camera = from(0, 0, 3);
    draw(&camera, &smooth, "sheet-misoriented");
    for (int y = H / 2 - 40; y < H / 2 + 40; y++)
        for (int x = W / 2 - 40; x < W / 2 + 40; x++)
            ck_assert_int_gt(brightness(at(x, y)), 90);
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

/* A sheet folded at a right angle, towards the eye, with triangles twice as large on one side of
 * the fold as on the other: both faces are plain up to the fold, and not the same. In the second
 * turn both sides of the fold are slivers, two pixels high. */
START_TEST(sharp_edges_stay_sharp) {
    enum { N = 8 };
    fake f = fake_sheet(N, W, H);
    for (uint32_t i = 0; i < f.front.node_slots; i++) {
        float *p = f.position + 3 * i;
        const uint32_t x = i % (N + 1);
        p[0] = x > 0 ? 0 : _i == 0 ? -1 : -0.5f;
        p[1] *= _i == 0 ? 1 : 0.08f;
        p[2] = x < 2 ? 0 : -0.5f - 0.5f * (float)(x - 2) / (N - 2);
    }
    open_for(&f);
    const mn_camera camera = from(2, 0, 2);
    draw(&camera, &smooth, _i == 0 ? "fold" : "fold-slivers");
    int darkest[2] = {255, 255}, brightest[2] = {0, 0};
    for (int side = 0; side < 2; side++)
        for (int x = 3; x < (_i == 0 ? 50 : 30); x++) {
            const uint8_t *p = at(W / 2 + (side == 1 ? x : -x), H / 2 + 5);
            ck_assert_int_eq(p[3], 255);
            darkest[side] = brightness(p) < darkest[side] ? brightness(p) : darkest[side];
            brightest[side] = brightness(p) > brightest[side] ? brightness(p) : brightest[side];
        }
    ck_assert_int_le(brightest[0] - darkest[0], 6);
    ck_assert_int_le(brightest[1] - darkest[1], 6);
    ck_assert_int_gt(darkest[0], brightest[1] + 30);
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

/* Pixels inside the disc that stand out from the middle of their eight neighbours. */
static int specks(double radius_px) {
    int count = 0;
    for (int y = 1; y < H - 1; y++)
        for (int x = 1; x < W - 1; x++) {
            int sorted[8], n = 0;
            if (hypot(x + 0.5 - W / 2.0, y + 0.5 - H / 2.0) > radius_px - 4)
                continue;
            for (int k = 0; k < 9; k++) {
                const int b = brightness(at(x + k % 3 - 1, y + k / 3 - 1));
                int i = k == 4 ? 0 : n++;
                for (; k != 4 && i > 0 && sorted[i - 1] > b; i--)
                    sorted[i] = sorted[i - 1];
                if (k != 4)
                    sorted[i] = b;
            }
            count += abs(brightness(at(x, y)) - (sorted[3] + sorted[4]) / 2) > 16;
        }
    return count;
}

/* A sphere of triangles as small as pixels, rough enough that many stand askew and some are folded
 * over, has hardly a speck, where flat shading is full of them. */
START_TEST(small_triangles_do_not_speckle) {
    enum { N = 160 };
    fake f = fake_sphere(N, W, H);
    const double d = 3.5, radius_px = H / 2.0 / tan(M_PI / 8) / sqrt(d * d - 1);
    srand(7);
    for (uint32_t y = 1; y < N; y++)
        for (uint32_t x = 0; x < N; x++) {
            const float r = 1 + 0.02f * ((float)rand() / (float)RAND_MAX - 0.5f);
            for (uint32_t end = 0; end < (x == 0 ? 2 : 1); end++) /* both sides of the seam */
                for (int i = 0; i < 3; i++)
                    f.position[3 * (y * (N + 1) + x + end * N) + (uint32_t)i] *= r;
        }
    open_for(&f);
    const mn_camera camera = from(0.4f, 0, 3.48f);
    draw(&camera, &smooth, "rough");
    const int few = specks(radius_px);
    draw(&camera, &(mn_gl_look){.flat = true}, "rough-flat");
    const int many = specks(radius_px);
    ck_assert_int_gt(many, 500);
    ck_assert_int_lt(few, many / 16);
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

START_TEST(lod_colors_tell_fine_from_coarse) {
    fake f = fake_sheet(8, W, H);
    for (uint32_t i = 0; i < f.front.node_slots; i++)
        f.switch_value[i] = f.position[3 * i] < 0 ? 0 : 0.1f;
    open_for(&f);
    const mn_camera camera = from(0, 0, 3);
    const mn_gl_look lod = {.lod_colors = true};
    draw(&camera, &lod, "sheet-lod");
    const uint8_t *fine = at(W / 2 - 60, H / 2), *coarse = at(W / 2 + 60, H / 2);
    ck_assert_int_gt(fine[2], fine[0] + 60);
    ck_assert_int_gt(coarse[0], coarse[2] + 60);
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

START_TEST(wires_show) {
    fake f = fake_sheet(4, W, H);
    open_for(&f);
    const mn_camera camera = from(0, 0, 3);
    draw(&camera, &wire, "sheet-wire");
    int dark = 0;
    for (int x = W / 2 - 50; x < W / 2 + 50; x++)
        dark += brightness(at(x, H / 2 + 7)) < 80;
    ck_assert_int_ge(dark, 2);
    ck_assert_int_lt(dark, 30);
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

/* As close as dive comes, and a second sheet behind at a hundredth of that: no hole, no fighting.
 */
START_TEST(close_up_has_no_holes_and_no_fighting) {
    fake f = fake_sphere(160, W, H);
    open_for(&f);
    mn_camera camera = {
        .eye = {0, 1.02f, 0}, .target = {0.005f, 1, 0.003f}, .up = {0, 0, 1}, .fov_y_deg = 45};
    draw(&camera, &smooth, "close-up");
    for (int i = 0; i < W * H; i++)
        ck_assert_uint_eq(rgba[4 * i + 3], 255);
    load.api->close(gl);
    fake_free(&f);

    fake two = fake_sheet(2, W, H);
    for (int i = 0; i < 9; i++) /* nodes 0 … 3 and their triangles become a sheet of their own */
        two.color[i] = 0xff00ff00;
    const uint32_t quads[4][3] = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
    const float corner[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    for (int i = 0; i < 8; i++) {
        two.position[3 * i] = corner[i % 4][0];
        two.position[3 * i + 1] = corner[i % 4][1];
        two.position[3 * i + 2] = i < 4 ? 0 : -0.0002f;
        two.color[i] = i < 4 ? 0xff0000ff : 0xff00ff00;
    }
    two.front.simplex_slots = 4;
    memcpy(two.node, quads, sizeof quads);
    two.front.color = two.color;
    two.desc.has_colors = true;
    open_for(&two);
    static const float distance[3] = {0.02f, 0.5f, 4};
    for (int i = 0; i < 3; i++) {
        const mn_camera before = from(0, 0, distance[i]);
        draw(&before, &smooth, "two-sheets");
        for (int p = 0; p < W * H; p++)
            ck_assert(rgba[4 * p + 3] == 0 || rgba[4 * p] > rgba[4 * p + 1]);
    }
    load.api->close(gl);
    fake_free(&two);
}
END_TEST

/* A model in another unit of length, as small and as large as `build` takes them, is the same
 * picture to the bit: powers of two round nothing. */
START_TEST(the_unit_of_length_does_not_show) {
    static uint8_t one[4][sizeof rgba];
    static const int exponents[] = {0, -82, -67, -40, -20, 20, 40, 57, 98};
    for (size_t e = 0; e < sizeof exponents / sizeof exponents[0]; e++) {
        const float scale = ldexpf(1, exponents[e]);
        fake f = fake_sphere(48, W, H);
        for (uint32_t i = 0; i < f.front.node_slots; i++) {
            f.switch_value[i] *= scale;
            for (int k = 0; k < 3; k++)
                f.position[3 * i + (uint32_t)k] *= scale;
        }
        for (int k = 0; k < 3; k++) {
            f.desc.box_min[k] *= scale;
            f.desc.box_max[k] *= scale;
        }
        open_for(&f);
        const mn_camera camera = from(1.5f * scale, 0.5f * scale, 2 * scale);
        for (int look = 0; look < 4; look++) {
            const mn_gl_look l = {
                .wireframe = look == 1, .lod_colors = look == 2, .flat = look == 3};
            char name[32];
            snprintf(name, sizeof name, "unit-%d-%d", exponents[e], look);
            draw(&camera, &l, name);
            if (e == 0)
                memcpy(one[look], rgba, sizeof rgba);
            ck_assert_msg(memcmp(rgba, one[look], sizeof rgba) == 0, "2^%d, look %d", exponents[e],
                          look);
        }
        load.api->close(gl);
        fake_free(&f);
    }
}
END_TEST

/* Where a face looks straight at the eye, the cosine between them is rounded to more than 1 here
 * and there: through a lens of a degree, over hundreds of pixels. Sheets that stand at many angles,
 * each seen straight: no pixel differs from its neighbours. */
START_TEST(straight_faces_have_no_specks) {
    static const float degree = 0.0174533f;
    for (int i = 0; i < 24; i++) {
        const float turn = (3 + 14.3f * (float)i) * degree, tilt = (2 + 3.1f * (float)i) * degree;
        const float n[3] = {cosf(tilt) * sinf(turn), sinf(tilt), cosf(tilt) * cosf(turn)};
        const float a[3] = {cosf(turn), 0, -sinf(turn)};
        const float b[3] = {n[1] * a[2] - n[2] * a[1], n[2] * a[0] - n[0] * a[2],
                            n[0] * a[1] - n[1] * a[0]};
        fake f = fake_sheet(2, W, H);
        for (uint32_t k = 0; k < f.front.node_slots; k++) {
            float *p = f.position + 3 * k;
            const float x = p[0], y = p[1];
            for (int c = 0; c < 3; c++)
                p[c] = x * a[c] + y * b[c];
        }
        open_for(&f);
        mn_camera camera = from(40 * n[0], 40 * n[1], 40 * n[2]);
        camera.fov_y_deg = 1;
        for (int flat = 0; flat < 2; flat++) {
            draw(&camera, &(mn_gl_look){.flat = flat == 1}, "straight");
            const int middle = brightness(at(W / 2, H / 2));
            for (int p = 0; p < W * H; p++)
                ck_assert_msg(abs(brightness(rgba + 4 * p) - middle) <= 3, "sheet %d: %d, not %d",
                              i, brightness(rgba + 4 * p), middle);
        }
        load.api->close(gl);
        fake_free(&f);
    }
}
END_TEST

START_TEST(an_empty_front_is_sky) {
    fake f = fake_sheet(2, W, H);
    f.front.simplex_slots = 0;
    f.front.triangles = 0;
    open_for(&f);
    const mn_camera camera = from(0, 0, 3);
    draw(&camera, &smooth, "empty");
    for (int i = 0; i < W * H; i++)
        ck_assert(rgba[4 * i + 3] == 0 && rgba[4 * i] > 60);
    load.api->close(gl);
    fake_free(&f);
}
END_TEST

START_TEST(a_picture_too_large_is_refused) {
    fake f = fake_sheet(2, 1u << 24, 16);
    mn_status st = {0};
    ck_assert_int_eq(load.api->offscreen_open(&f.desc, &gl, &st), MN_USAGE);
    ck_assert_ptr_null(gl);
    ck_assert_ptr_nonnull(strstr(st.text, "16777216"));
    fake_free(&f);
}
END_TEST

START_TEST(no_display_is_said_at_once) {
    fake f = fake_sheet(2, W, H);
    mn_status st = {0};
    unsetenv("DISPLAY");
    unsetenv("WAYLAND_DISPLAY");
    ck_assert_int_eq(load.api->window_open(&f.desc, &gl, &st), MN_NO_GRAPHICS);
    ck_assert_ptr_nonnull(strstr(st.text, "metanode shoot"));
    fake_free(&f);
}
END_TEST

START_TEST(no_platform_is_said) {
    fake f = fake_sheet(2, W, H);
    mn_status st = {0};
    setenv("METANODE_EGL", "nothing", 1);
    ck_assert_int_eq(load.api->offscreen_open(&f.desc, &gl, &st), MN_NO_GRAPHICS);
    ck_assert_ptr_nonnull(strstr(st.text, "METANODE_EGL"));
    unsetenv("METANODE_EGL");
    fake_free(&f);
}
END_TEST

START_TEST(a_missing_module_is_said) {
    gl_load other = {0};
    mn_status st = {0};
    char *had = strdup(getenv("METANODE_HELPER_DIR"));
    setenv("METANODE_HELPER_DIR", "/nowhere", 1);
    ck_assert_int_eq(gl_load_module(&other, &st), MN_NO_GRAPHICS);
    ck_assert_ptr_nonnull(strstr(st.text, "/nowhere/metanode-gl.so"));
    ck_assert_ptr_null(other.api);
    setenv("METANODE_HELPER_DIR", had, 1);
    free(had);
}
END_TEST

/* 77: meson's word for a test that was skipped. */
static int skip_without_egl(void) {
    fake f = fake_sheet(2, W, H);
    mn_status st = {0};
    mn_code code = gl_load_module(&load, &st);
    if (code != MN_OK) { /* the module is built with the tests: it must load */
        fprintf(stderr, "%s\n", st.text);
        return 1;
    }
    code = load.api->offscreen_open(&f.desc, &gl, &st);
    fake_free(&f);
    if (code != MN_OK) {
        fprintf(stderr, "skipped: %s\n", st.text);
        return code == MN_NO_GRAPHICS ? 77 : 1;
    }
    printf("%s, %u kB\n", load.api->driver(gl), (unsigned)(load.rss_bytes / 1024));
    load.api->close(gl);
    return 0;
}

int main(void) {
    const int skip = skip_without_egl();
    if (skip != 0)
        return skip;
    Suite *suite = suite_create("render");
    TCase *tc = tcase_create("render");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, a_sphere_is_a_whole_disc);
    tcase_add_test(tc, both_sides_of_a_sheet_are_lit);
    tcase_add_test(tc, vertex_colors_are_used);
    tcase_add_test(tc, misoriented_neighbours_are_not_black);
    tcase_add_loop_test(tc, sharp_edges_stay_sharp, 0, 2);
    tcase_add_test(tc, small_triangles_do_not_speckle);
    tcase_add_test(tc, lod_colors_tell_fine_from_coarse);
    tcase_add_test(tc, wires_show);
    tcase_add_test(tc, close_up_has_no_holes_and_no_fighting);
    tcase_add_test(tc, the_unit_of_length_does_not_show);
    tcase_add_test(tc, straight_faces_have_no_specks);
    tcase_add_test(tc, an_empty_front_is_sky);
    tcase_add_test(tc, a_picture_too_large_is_refused);
    tcase_add_test(tc, no_display_is_said_at_once);
    tcase_add_test(tc, no_platform_is_said);
    tcase_add_test(tc, a_missing_module_is_said);
    suite_add_tcase(suite, tc);
    return suite_run_as(suite, CK_NOFORK); /* drivers have threads */
}
