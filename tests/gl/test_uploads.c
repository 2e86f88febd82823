/* Goal: sending only what changed draws what sending everything draws, pixel for pixel, in every
 * frame of a fast path on which slots are freed and used again; and it sends less. A picture
 * depends on the front alone. Method: the same path once for each way of sending, through the
 * module as the program loads it: mapped, ranges, whole, and now and then a new renderer, which
 * knows nothing of the frames before. Resident, and paged with few place holders on the simulated
 * disk, where chains are undone. Skipped without EGL. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "gl_load.h"
#include "model.h"
#include "suite.h"

enum { W = 96, H = 64, FRAMES = 30 };
static gl_load load;
static uint8_t pictures[FRAMES][4 * W * H];
static uint64_t splits, collapses;

static mn_gl *renderer(const mn_session *session) {
    const mn_header *h = mn_session_header(session);
    mn_plan plan;
    mn_gl *gl = NULL;
    mn_status st = {0};
    mn_session_plan(session, &plan);
    mn_gl_desc desc = {.width_px = W,
                       .height_px = H,
                       .node_slots_max = plan.front_max,
                       .simplex_slots_max = plan.simplices_max,
                       .has_colors = h->has_colors};
    memcpy(desc.box_min, h->box_min, sizeof desc.box_min);
    memcpy(desc.box_max, h->box_max, sizeof desc.box_max);
    ck_assert_msg(load.api->offscreen_open(&desc, &gl, &st) == MN_OK, "%s", st.text);
    return gl;
}

/* Bytes sent after the first frame; 0 with `fresh`, a renderer a picture. first: keeps the
 * pictures; else compares with those kept. */
static uint64_t run(const model *m, const mn_session_desc *desc, const char *uploads, bool fresh,
                    bool first) {
    static uint8_t now[4 * W * H];
    mn_session *session = model_open(desc);
    mn_gl_stats begun = {0}, ended = {0};
    mn_gl *gl = NULL;
    mn_status st = {0};
    setenv("METANODE_GL_UPLOAD", uploads, 1);
    splits = collapses = 0;
    for (int i = 0; i < FRAMES; i++) {
        const mn_camera camera = model_camera(m, 0.37 * i, i % 5 == 4 ? 4 : 1.1 + 0.05 * (i % 7));
        const mn_gl_look look = {.wireframe = i % 8 == 5, .lod_colors = i % 3 == 1};
        mn_front front;
        mn_frame_stats frame;
        mn_session_frame(session, &camera, &frame);
        mn_session_front(session, &front);
        splits += frame.splits;
        collapses += frame.collapses;
        if (fresh && i % 5 != 2)
            continue;
        gl = gl == NULL ? renderer(session) : gl;
        ck_assert_int_eq(load.api->front(gl, &front, &st), MN_OK);
        if (i == 0)
            load.api->stats(gl, &begun);
        ck_assert_int_eq(load.api->draw(gl, &camera, &look, &st), MN_OK);
        ck_assert_int_eq(load.api->pixels(gl, first ? pictures[i] : now, &st), MN_OK);
        ck_assert_msg(first || memcmp(now, pictures[i], sizeof now) == 0, "%s, frame %d", uploads,
                      i);
        load.api->stats(gl, &ended);
        if (fresh || i + 1 == FRAMES) {
            load.api->close(gl);
            gl = NULL;
        }
    }
    unsetenv("METANODE_GL_UPLOAD");
    mn_session_close(session);
    return fresh ? 0 : ended.sent_bytes - begun.sent_bytes;
}

static void all_ways(const model *m, const mn_session_desc *desc) {
    const uint64_t mapped = run(m, desc, "mapped", false, true);
    ck_assert_uint_gt(splits, 500);
    ck_assert_uint_gt(collapses, 100);
    const uint64_t ranges = run(m, desc, "ranges", false, false);
    const uint64_t whole = run(m, desc, "whole", false, false);
    run(m, desc, "ranges", true, false);
    printf("%llu bytes mapped, %llu in ranges, %llu whole\n", (unsigned long long)mapped,
           (unsigned long long)ranges, (unsigned long long)whole);
    ck_assert_uint_gt(mapped, 0);
    ck_assert_uint_lt(mapped, ranges);
    ck_assert_uint_lt(ranges, whole);
}

START_TEST(resident) {
    const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};
    model m;
    model_make(&m, (model_shape)_i, 2000, &blocks);
    mn_session_desc desc = model_desc(&m);
    desc.tolerance_px = 2;
    all_ways(&m, &desc);
    model_free(&m);
}
END_TEST

START_TEST(paged) {
    const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};
    model m;
    model_make(&m, MODEL_TERRAIN, 6000, &blocks);
    mn_session_desc desc = model_desc(&m);
    desc.store = MN_STORE_PAGED;
    desc.io = MN_IO_SIM;
    desc.io_serial = true;
    desc.k = 40;
    desc.fps = 60;
    all_ways(&m, &desc);
    model_free(&m);
}
END_TEST

/* Frames on a standing camera until settled, from another one: fronts are the same, slots are not.
 */
static void settled_picture(const model *m, const mn_session_desc *desc, double turn,
                            uint8_t *rgba) {
    mn_session *session = model_open(desc);
    const mn_camera before = model_camera(m, turn, 1.5), camera = model_camera(m, 0.1, 1.3);
    const mn_gl_look look = {0};
    mn_front front;
    mn_status st = {0};
    mn_session_settle(session, &before, 1000);
    ck_assert_uint_lt(mn_session_settle(session, &camera, 1000), 1000);
    mn_session_front(session, &front);
    mn_gl *gl = renderer(session);
    ck_assert_int_eq(load.api->front(gl, &front, &st), MN_OK);
    ck_assert_int_eq(load.api->draw(gl, &camera, &look, &st), MN_OK);
    ck_assert_int_eq(load.api->pixels(gl, rgba, &st), MN_OK);
    load.api->close(gl);
    mn_session_close(session);
}

START_TEST(slots_do_not_matter) {
    static uint8_t now[4 * W * H];
    const mn_block_desc blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};
    model m;
    model_make(&m, _i == 0 ? MODEL_TERRAIN : MODEL_GLOBE, 6000, &blocks);
    mn_session_desc desc = model_desc(&m);
    settled_picture(&m, &desc, 0.1, pictures[0]);
    for (int i = 0; i < 3; i++) {
        settled_picture(&m, &desc, 0.3 + 0.2 * i, now);
        ck_assert_mem_eq(now, pictures[0], sizeof now);
        if (i == 1) {
            desc.store = MN_STORE_PAGED;
            desc.io = MN_IO_SIM;
            desc.fps = 60;
        }
    }
    model_free(&m);
}
END_TEST

START_TEST(unknown_ways_are_said) {
    const mn_gl_desc desc = {.width_px = 8, .height_px = 8};
    mn_gl *gl = NULL;
    mn_status st = {0};
    setenv("METANODE_GL_UPLOAD", "pigeon", 1);
    ck_assert_int_eq(load.api->offscreen_open(&desc, &gl, &st), MN_USAGE);
    ck_assert_ptr_nonnull(strstr(st.text, "pigeon"));
    unsetenv("METANODE_GL_UPLOAD");
}
END_TEST

int main(void) {
    const mn_gl_desc desc = {.width_px = 8, .height_px = 8};
    mn_gl *gl = NULL;
    mn_status st = {0};
    mn_code code = gl_load_module(&load, &st);
    if (code == MN_OK)
        code = load.api->offscreen_open(&desc, &gl, &st);
    if (code != MN_OK) { /* 77: meson's word for skipped */
        fprintf(stderr, "skipped: %s\n", st.text);
        return code == MN_NO_GRAPHICS && load.api != NULL ? 77 : 1;
    }
    load.api->close(gl);
    Suite *suite = suite_create("uploads");
    TCase *tc = tcase_create("uploads");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, resident, 0, MODEL_SHAPES);
    tcase_add_test(tc, paged);
    tcase_add_loop_test(tc, slots_do_not_matter, 0, 2);
    tcase_add_test(tc, unknown_ways_are_said);
    suite_add_tcase(suite, tc);
    return suite_run_as(suite, CK_NOFORK); /* drivers have threads */
}
