/* Pictures and the window: the interface of the module metanode-gl.so.
 *
 * The program links no GL. Who wants a picture loads the module and asks for MN_GL_SYMBOL, a
 * constant mn_gl_api; everything goes through that table. Nothing here reads a .mnt: the mesh comes
 * as an mn_front, the eye as an mn_camera, both of runtime.h.
 *
 * Threads: an mn_gl belongs to the thread that opened it; one is current at a time in a thread.
 * After open our side allocates nothing but PNG rows (and targets when a window is resized); the
 * driver does as it likes. */
#ifndef METANODE_GL_H
#define METANODE_GL_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "metanode/runtime.h"
#include "metanode/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define MN_GL_SYMBOL "mn_gl_module"
enum { MN_GL_VERSION = 3 };

typedef struct mn_gl mn_gl; /* a context with its picture: offscreen, or a window */

typedef struct mn_gl_desc {
    uint32_t width_px, height_px;               /* of the picture; of a window at first */
    uint32_t node_slots_max, simplex_slots_max; /* the largest front that will come */
    bool has_colors;                            /* fronts may carry vertex colours */
    float box_min[3], box_max[3];               /* of the model: header's bounding box */
    const char *title;                          /* of a window; NULL: "metanode" */
} mn_gl_desc;

/* How a front is drawn; all false: smooth clay, or the vertices' colours. */
typedef struct mn_gl_look {
    bool wireframe;  /* edges over the surface */
    bool lod_colors; /* by the logarithm of the switch value: blue is fine, red is coarse */
    bool flat;       /* a normal for each triangle instead of smooth ones */
} mn_gl_look;

/* Totals since open. */
typedef struct mn_gl_stats {
    uint64_t fronts;      /* handed over */
    uint64_t sent_bytes;  /* to the driver: vertices, normals, indices */
    uint64_t sent_ranges; /* in so many pieces */
} mn_gl_stats;

/* How alike two pictures are (likeness.c gives the formulas). */
typedef struct mn_likeness {
    double mean_square;      /* of the differences, over pixels and channels, 0 … 255² */
    double psnr_db;          /* INFINITY: the same */
    double ssim;             /* at most 1; NaN: smaller than its window */
    uint32_t difference_max; /* of a channel, 0 … 255 */
} mn_likeness;
enum { MN_SSIM_WINDOW = 11 }; /* pixels each way */
static inline double mn_psnr_db(double mean_square) {
    return mean_square > 0 ? 10 * log10(255.0 * 255.0 / mean_square) : (double)INFINITY;
}

enum { MN_GL_TYPED_MAX = 32 }; /* characters between two polls; more are dropped */

/* What the user did since the last poll. Drags are in fractions of the window's height, right and
 * down positive. */
typedef struct mn_gl_input {
    float orbit[2], pan[2];
    float zoom; /* wheel notches and right drags; positive: nearer */
    uint32_t typed_count;
    uint32_t typed[MN_GL_TYPED_MAX]; /* Unicode, in order */
    bool exposed;                    /* the window must be drawn again (uncovered, resized) */
    bool closed;                     /* the window's cross, or escape */
} mn_gl_input;

typedef struct mn_gl_api {
    uint32_t version; /* MN_GL_VERSION; another one: do not touch the rest */

    /* A context without a display, through EGL: Mesa's surfaceless platform, then a device, then
     * the default display (METANODE_EGL=surfaceless|device|default asks for one of them).
     * MN_NO_GRAPHICS: none works, or no OpenGL 3.3. Freed by close. */
    mn_code (*offscreen_open)(const mn_gl_desc *desc, mn_gl **out, mn_status *st);
    /* A window; one in a process. MN_NO_GRAPHICS at once where there is no display. */
    mn_code (*window_open)(const mn_gl_desc *desc, mn_gl **out, mn_status *st);
    void (*close)(mn_gl *gl);

    /* Hands over the front, which is copied: call it when the front has changed. Larger than the
     * desc said is a bug. MN_FAILED: the driver has no memory. */
    mn_code (*front)(mn_gl *gl, const mn_front *front, mn_status *st);
    /* Draws the last front; in a window, shows it. The projection is the navigator's: vertical
     * opening fov_y_deg, aspect width / height. May wait for the display. */
    mn_code (*draw)(mn_gl *gl, const mn_camera *camera, const mn_gl_look *look, mn_status *st);
    /* Size of the picture in pixels: of a window, that of its framebuffer now. */
    void (*size)(const mn_gl *gl, uint32_t *width_px, uint32_t *height_px);
    /* The last picture drawn, width × height × RGBA8, top row first, into the caller's memory.
     * Alpha is the share of the pixel that the mesh covers. */
    mn_code (*pixels)(mn_gl *gl, uint8_t *rgba, mn_status *st);
    /* The same as an opaque PNG: written under a temporary name, renamed. */
    mn_code (*png)(mn_gl *gl, const char *path, mn_status *st);
    const char *(*driver)(const mn_gl *gl); /* the renderer's name; lives until close */
    void (*stats)(const mn_gl *gl, mn_gl_stats *out);

    /* Two pictures of width × height × RGB8. Needs no context; any thread. MN_FAILED: no memory. */
    mn_code (*likeness)(const uint8_t *a, const uint8_t *b, uint32_t width_px, uint32_t height_px,
                        mn_likeness *out, mn_status *st);
    /* A PNG of up to 16384 pixels each way as RGB8, top row first; what is transparent lies on
     * black, 16 bits are rounded to 8. *rgb: the caller frees it with free. MN_BAD_INPUT: it is
     * none. */
    mn_code (*png_read)(const char *path, uint8_t **rgb, uint32_t *width_px, uint32_t *height_px,
                        mn_status *st);

    /* Windows only. Waits at most timeout_s for something to happen (0: does not wait). */
    void (*poll)(mn_gl *gl, double timeout_s, mn_gl_input *out);
    void (*title)(mn_gl *gl, const char *text);
} mn_gl_api;

#ifdef __cplusplus
}
#endif
#endif
