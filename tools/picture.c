/* See picture.h. Every call into the module is measured (gl_load.h). */
#include "picture.h"

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
                     mn_status *st) {
    mn_gl_desc desc;
    mn_code code = gl_load_module(&p->load, st);
    if (code != MN_OK)
        return code;
    picture_desc(session, width, height, &desc);
    const uint64_t entered = gl_load_enter(&p->load);
    code = p->load.api->offscreen_open(&desc, &p->gl, st);
    gl_load_leave(&p->load, entered);
    return code;
}

mn_code picture_write(picture *p, const mn_session *session, const mn_camera *camera,
                      const mn_gl_look *look, const char *path, mn_status *st) {
    const mn_gl_api *api = p->load.api;
    mn_front front;
    mn_session_front(session, &front);
    const uint64_t entered = gl_load_enter(&p->load);
    mn_code code = api->front(p->gl, &front, st);
    if (code == MN_OK)
        code = api->draw(p->gl, camera, look, st);
    if (code == MN_OK)
        code = api->png(p->gl, path, st);
    gl_load_leave(&p->load, entered);
    return code;
}

void picture_close(picture *p) {
    if (p->gl != NULL)
        p->load.api->close(p->gl);
    p->gl = NULL;
}
