/* Pictures of a session, without a display. Main thread only. */
#ifndef METANODE_PICTURE_H
#define METANODE_PICTURE_H

#include "gl_load.h"

typedef struct picture { /* zeroed: not open */
    gl_load load;        /* load.rss_bytes is gl_rss_bytes */
    mn_gl *gl;
    uint8_t *pixels; /* of picture_rgb; NULL: it is not called */
} picture;

/* What a renderer must know of a session before it starts. */
void picture_desc(const mn_session *session, uint32_t width, uint32_t height, mn_gl_desc *out);
/* Loads the module and makes a picture of that size for the session's fronts. After the session is
 * open, so that the driver's memory is not taken for the session's. reads: with room for
 * picture_rgb, which allocates nothing then. MN_NO_GRAPHICS and its like. */
mn_code picture_open(picture *p, const mn_session *session, uint32_t width, uint32_t height,
                     bool reads, mn_status *st);
/* Draws the session's front as the camera sees it. */
mn_code picture_draw(picture *p, const mn_session *session, const mn_camera *camera,
                     const mn_gl_look *look, mn_status *st);
/* What was drawn: as a PNG; as width × height × RGB8, top row first, until the next call. */
mn_code picture_png(picture *p, const char *path, mn_status *st);
mn_code picture_rgb(picture *p, const uint8_t **rgb, uint32_t *width, uint32_t *height,
                    mn_status *st);
void picture_close(picture *p);

#endif
