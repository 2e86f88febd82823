/* The module's one symbol: a table over the parts. Ties a context (offscreen or a window) to a
 * renderer and sees that the picture has the window's size. Order: open, front, draw, then pixels
 * or png, in any number; close. Memory: one picture of bytes for png, kept until close. */
#include "parts.h"

#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"

struct mn_gl {
    mni_offscreen *offscreen; /* one of these two */
    mni_window *window;
    mni_render *render;
    uint8_t *rgba; /* for png; as large as the picture was when it was last written */
    size_t rgba_bytes;
};

static void module_close(mn_gl *gl) {
    if (gl == NULL)
        return;
    mni_render_close(gl->render);
    mni_window_close(gl->window);
    mni_offscreen_close(gl->offscreen);
    free(gl->rgba);
    free(gl);
}

/* Takes over the context, also when it fails. */
static mn_code finish_open(mn_gl *gl, const mn_gl_desc *desc, mn_gl **out, mn_status *st) {
    const mn_code code = mni_render_open(desc, &gl->render, st);
    if (code == MN_OK)
        *out = gl;
    else
        module_close(gl);
    return code;
}

static mn_code module_offscreen_open(const mn_gl_desc *desc, mn_gl **out, mn_status *st) {
    *out = NULL;
    mn_gl *gl = calloc(1, sizeof *gl);
    if (gl == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a picture");
    const mn_code code = mni_offscreen_open(&gl->offscreen, st);
    if (code != MN_OK) {
        free(gl);
        return code;
    }
    return finish_open(gl, desc, out, st);
}

static mn_code module_window_open(const mn_gl_desc *desc, mn_gl **out, mn_status *st) {
    *out = NULL;
    mn_gl *gl = calloc(1, sizeof *gl);
    if (gl == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a window");
    const char *title = desc->title != NULL ? desc->title : "metanode";
    const mn_code code = mni_window_open(desc->width_px, desc->height_px, title, &gl->window, st);
    if (code != MN_OK) {
        free(gl);
        return code;
    }
    return finish_open(gl, desc, out, st);
}

static mn_code module_front(mn_gl *gl, const mn_front *front, mn_status *st) {
    return mni_render_front(gl->render, front, st);
}

static void module_size(const mn_gl *gl, uint32_t *width, uint32_t *height) {
    if (gl->window != NULL)
        mni_window_size(gl->window, width, height);
    else
        mni_render_size(gl->render, width, height);
}

static mn_code module_draw(mn_gl *gl, const mn_camera *camera, const mn_gl_look *look,
                           mn_status *st) {
    uint32_t width, height, had_width, had_height;
    module_size(gl, &width, &height);
    mni_render_size(gl->render, &had_width, &had_height);
    if (width == 0 || height == 0)
        return MN_OK; /* an icon */
    mn_code code = MN_OK;
    if (width != had_width || height != had_height)
        code = mni_render_resize(gl->render, width, height, st);
    if (code == MN_OK)
        code = mni_render_draw(gl->render, camera, look, st);
    if (code == MN_OK && gl->window != NULL) {
        mni_render_present(gl->render);
        mni_window_swap(gl->window);
    }
    return code;
}

static void flip(uint8_t *rgba, size_t row_bytes, uint32_t height) {
    for (uint32_t y = 0; y < height / 2; y++) {
        uint8_t *a = rgba + row_bytes * y, *b = rgba + row_bytes * (height - 1 - y);
        for (size_t i = 0; i < row_bytes; i++) {
            const uint8_t t = a[i];
            a[i] = b[i];
            b[i] = t;
        }
    }
}

static mn_code module_pixels(mn_gl *gl, uint8_t *rgba, mn_status *st) {
    uint32_t width, height;
    mni_render_size(gl->render, &width, &height);
    const mn_code code = mni_render_pixels(gl->render, rgba, st);
    if (code == MN_OK)
        flip(rgba, 4 * (size_t)width, height);
    return code;
}

static mn_code module_png(mn_gl *gl, const char *path, mn_status *st) {
    uint32_t width, height;
    mni_render_size(gl->render, &width, &height);
    const size_t bytes = 4 * (size_t)width * height;
    if (bytes > gl->rgba_bytes) {
        free(gl->rgba);
        gl->rgba = malloc(bytes);
        gl->rgba_bytes = gl->rgba != NULL ? bytes : 0;
        if (gl->rgba == NULL)
            return mn_fail(st, MN_FAILED, "no memory for a picture of %u x %u", width, height);
    }
    const mn_code code = mni_render_pixels(gl->render, gl->rgba, st);
    return code != MN_OK ? code : mni_png_write(path, width, height, gl->rgba, st);
}

static const char *module_driver(const mn_gl *gl) {
    return mni_render_driver(gl->render);
}

static void module_stats(const mn_gl *gl, mn_gl_stats *out) {
    mni_render_stats(gl->render, out);
}

static void module_poll(mn_gl *gl, double timeout_s, mn_gl_input *out) {
    MN_ASSERT(gl->window != NULL);
    mni_window_poll(gl->window, timeout_s, out);
}

static void module_title(mn_gl *gl, const char *text) {
    MN_ASSERT(gl->window != NULL);
    mni_window_title(gl->window, text);
}

/* The one symbol that leaves the module. */
extern const mn_gl_api mn_gl_module __attribute__((visibility("default")));
const mn_gl_api mn_gl_module = {
    .version = MN_GL_VERSION,
    .offscreen_open = module_offscreen_open,
    .window_open = module_window_open,
    .close = module_close,
    .front = module_front,
    .draw = module_draw,
    .size = module_size,
    .pixels = module_pixels,
    .png = module_png,
    .driver = module_driver,
    .stats = module_stats,
    .likeness = mni_likeness,
    .png_read = mni_png_read,
    .poll = module_poll,
    .title = module_title,
};
