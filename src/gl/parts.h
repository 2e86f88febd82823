/* The parts of the module: contexts (offscreen.c, window.c), drawing (render.c), and what needs no
 * GL at all (surface.c, png.c, likeness.c). One thread, that of the mn_gl. */
#ifndef MNI_GL_PARTS_H
#define MNI_GL_PARTS_H

#include <stdbool.h>
#include <stdint.h>

#include "metanode/gl.h"

/* ---- offscreen.c: a context without a display. The only file that knows EGL ----------------- */

typedef struct mni_offscreen mni_offscreen;
/* Makes an OpenGL 3.3 core context current. MN_NO_GRAPHICS says what each platform answered. */
mn_code mni_offscreen_open(mni_offscreen **out, mn_status *st);
void mni_offscreen_close(mni_offscreen *o);

/* ---- window.c: a window and what the user does. The only file that knows GLFW --------------- */

typedef struct mni_window mni_window;
mn_code mni_window_open(uint32_t width, uint32_t height, const char *title, mni_window **out,
                        mn_status *st); /* its context is current after it */
void mni_window_size(const mni_window *w, uint32_t *width, uint32_t *height); /* framebuffer's */
void mni_window_swap(mni_window *w);
void mni_window_poll(mni_window *w, double timeout_s, mn_gl_input *out);
void mni_window_title(mni_window *w, const char *text);
void mni_window_close(mni_window *w);

/* ---- render.c: a front to pixels. The only file that knows GL ------------------------------- */

typedef struct mni_render mni_render;
/* Needs a current context; allocates all buffers for the largest front. */
mn_code mni_render_open(const mn_gl_desc *desc, mni_render **out, mn_status *st);
mn_code mni_render_resize(mni_render *r, uint32_t width, uint32_t height, mn_status *st);
mn_code mni_render_front(mni_render *r, const mn_front *front, mn_status *st);
mn_code mni_render_draw(mni_render *r, const mn_camera *camera, const mn_gl_look *look,
                        mn_status *st);
void mni_render_present(mni_render *r); /* copies the picture to the window's framebuffer */
void mni_render_size(const mni_render *r, uint32_t *width, uint32_t *height);
mn_code mni_render_pixels(mni_render *r, uint8_t *rgba, mn_status *st); /* bottom row first */
void mni_render_stats(const mni_render *r, mn_gl_stats *out);
const char *mni_render_driver(const mni_render *r);
void mni_render_close(mni_render *r); /* the context still current */

/* ---- surface.c: a mirror of what the driver holds of a front, and what is new in it. Pure ---- */

typedef struct mni_surface {
    /* const after open */
    uint32_t node_slots_max, simplex_slots_max;
    /* what the driver has, or gets when the bits are sent; the caller reads it */
    float (*vertex)[4];   /* a node slot: position, switch value */
    uint32_t *color;      /* RGBA8; NULL: the model has none */
    uint32_t *normal;     /* packed */
    uint32_t (*index)[3]; /* a simplex slot: node slots; all the same where there is no triangle */
    uint64_t *vertex_new, *normal_new, *index_new; /* bits: changed, not sent yet */
    uint32_t node_high, simplex_high;              /* slots from here on were never used */
    uint32_t triangles;
    /* surface.c alone */
    uint32_t (*sum)[3]; /* a node slot: normals of its triangles, times angles; signed */
    const float *source;
    uint64_t version;    /* of the front that is mirrored, and where its positions lie */
    uint32_t node_fresh; /* slots from here on are new to the driver */
    bool pending;
} mni_surface;

/* false: no memory. */
bool mni_surface_open(mni_surface *s, uint32_t node_slots_max, uint32_t simplex_slots_max,
                      bool has_colors);
void mni_surface_close(mni_surface *s);
/* Mirrors the front; then the caller sends what has a bit, and says so. */
void mni_surface_update(mni_surface *s, const mn_front *front);
void mni_surface_sent(mni_surface *s);
/* The next run of set bits from *first on, up to limit; runs at most `gap` clear bits apart are
 * one. false: there is none. */
bool mni_surface_run(const uint64_t *bits, uint32_t limit, uint32_t gap, uint32_t *first,
                     uint32_t *end);
void mni_surface_all(uint64_t *bits, uint32_t limit); /* sets those below limit */
/* A sum to GL's 10-10-10-2, signed, normalised; 0 where there is no direction. */
uint32_t mni_surface_pack(const uint32_t sum[3]);

/* ---- png.c ---------------------------------------------------------------------------------- */

/* Opaque PNG of width × height × RGBA8, bottom row first, there at once and whole (mni_out).
 * MN_FAILED or MN_NO_SPACE; nothing is left behind then. */
mn_code mni_png_write(const char *path, uint32_t width, uint32_t height, const uint8_t *rgba,
                      mn_status *st);

/* As of mn_gl_api. */
mn_code mni_png_read(const char *path, uint8_t **rgb, uint32_t *width, uint32_t *height,
                     mn_status *st);

/* ---- likeness.c: two pictures compared. Pure ------------------------------------------------ */

/* As of mn_gl_api. */
mn_code mni_likeness(const uint8_t *a, const uint8_t *b, uint32_t width, uint32_t height,
                     mn_likeness *out, mn_status *st);

/* ---- shaders.c ------------------------------------------------------------------------------ */

extern const char mni_shader_surface_vertex[], mni_shader_surface_geometry[];
extern const char mni_shader_surface_fragment[], mni_shader_wire_fragment[];
extern const char mni_shader_sky_vertex[], mni_shader_sky_fragment[];

#endif
