/* See picture.h. Every call into the module is measured (gl_load.h). */
#include "picture.h"

#include <stdlib.h>
#include <string.h>

void picture_desc(const mn_session *session, uint32_t width, uint32_t height, mn_gl_desc *out) {
    const mn_header *header = mn_session_header(session);
    mn_plan plan;
    mn_session_plan(session, &plan);
    *out = (mn_gl_desc){.width_px = width,
                        .height_px = height,
                        .node_slots_max = plan.front_max,
                        .simplex_slots_max = plan.simplices_max,
                        .has_colors = header->has_colors};
    memcpy(out->box_min, header->box_min, sizeof out->box_min);
    memcpy(out->box_max, header->box_max, sizeof out->box_max);
}

mn_code picture_open(picture *p, const mn_session *session, uint32_t width, uint32_t height,
                     bool reads, mn_status *st) {
    mn_gl_desc desc;
    mn_code code = gl_load_module(&p->load, st);
    if (code != MN_OK)
        return code;
    picture_desc(session, width, height, &desc);
    const uint64_t entered = gl_load_enter(&p->load);
    code = p->load.api->offscreen_open(&desc, &p->gl, st);
    if (code == MN_OK && reads)
        p->pixels = malloc(4 * (size_t)width * height);
    if (code == MN_OK && reads && p->pixels == NULL)
        code = mn_fail(st, MN_FAILED, "no memory for a picture of %u x %u", width, height);
    gl_load_leave(&p->load, entered);
    return code;
}

mn_code picture_draw(picture *p, const mn_session *session, const mn_camera *camera,
                     const mn_gl_look *look, mn_status *st) {
    const mn_gl_api *api = p->load.api;
    mn_front front;
    mn_session_front(session, &front);
    const uint64_t entered = gl_load_enter(&p->load);
    mn_code code = api->front(p->gl, &front, st);
    if (code == MN_OK)
        code = api->draw(p->gl, camera, look, st);
    gl_load_leave(&p->load, entered);
    return code;
}

mn_code picture_png(picture *p, const char *path, mn_status *st) {
    const uint64_t entered = gl_load_enter(&p->load);
    const mn_code code = p->load.api->png(p->gl, path, st);
    gl_load_leave(&p->load, entered);
    return code;
}

/* RGBA becomes RGB where it lies. */
static void drop_alpha(uint8_t *pixels, size_t count) {
    for (size_t i = 1; i < count; i++)
        memmove(pixels + 3 * i, pixels + 4 * i, 3);
}

mn_code picture_rgb(picture *p, const uint8_t **rgb, uint32_t *width, uint32_t *height,
                    mn_status *st) {
    const uint64_t entered = gl_load_enter(&p->load);
    p->load.api->size(p->gl, width, height);
    const size_t count = (size_t)*width * *height;
    const mn_code code = p->load.api->pixels(p->gl, p->pixels, st);
    if (code == MN_OK)
        drop_alpha(p->pixels, count);
    gl_load_leave(&p->load, entered);
    *rgb = p->pixels;
    return code;
}

void picture_close(picture *p) {
    if (p->gl != NULL)
        p->load.api->close(p->gl);
    free(p->pixels);
    p->gl = NULL;
    p->pixels = NULL;
}
