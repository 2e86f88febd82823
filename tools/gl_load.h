/* The module metanode-gl.so, loaded when a picture or a window is asked for, and the memory that it
 * takes, which is reported apart from the cap (gl_rss_bytes). Main thread only. */
#ifndef METANODE_GL_LOAD_H
#define METANODE_GL_LOAD_H

#include "metanode/gl.h"

typedef struct gl_load { /* zeroed: not loaded */
    const mn_gl_api *api;
    void *module;            /* stays loaded: drivers do not survive being unloaded */
    int64_t held_bytes;      /* by which the resident set grew between gl_load_enter and _leave */
    uint64_t rss_bytes;      /* the most that was */
    uint64_t own_peak_bytes; /* peak of the rest: before the module, and whenever it is entered */
} gl_load;

/* Loads the module from METANODE_HELPER_DIR, else from beside the program, else from the build
 * tree. MN_NO_GRAPHICS says what was tried. */
mn_code gl_load_module(gl_load *load, mn_status *st);
/* Around calls into the module: what the process grew by in between is the module's, and so are
 * allocations (cli_alloc_theirs). */
uint64_t gl_load_enter(gl_load *load);
void gl_load_leave(gl_load *load, uint64_t entered);

#endif
