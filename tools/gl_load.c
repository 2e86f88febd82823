/* See gl_load.h. Hides where the module lies and how its memory is told from ours: /proc/self/statm
 * is read before and after. */
#include "gl_load.h"

#include "cli.h"

#include <dlfcn.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MODULE "metanode-gl.so"

uint64_t gl_load_enter(gl_load *load) {
    const uint64_t now = cli_rss_bytes();
    const int64_t own = (int64_t)now - load->held_bytes;
    if (own > (int64_t)load->own_peak_bytes)
        load->own_peak_bytes = (uint64_t)own;
    cli_alloc_theirs(true);
    return now;
}

void gl_load_leave(gl_load *load, uint64_t entered) {
    cli_alloc_theirs(false);
    load->held_bytes += (int64_t)(cli_rss_bytes() - entered); /* a driver gives back, too */
    if (load->held_bytes > (int64_t)load->rss_bytes)
        load->rss_bytes = (uint64_t)load->held_bytes;
}

/* Where the module lies; the place beside the program when it is nowhere. */
static void module_path(char path[PATH_MAX]) {
    const char *helper = getenv("METANODE_HELPER_DIR");
    if (helper != NULL) {
        snprintf(path, PATH_MAX, "%s/" MODULE, helper);
        return;
    }
    char dir[PATH_MAX - 32]; /* room for what is added */
    const ssize_t n = readlink("/proc/self/exe", dir, sizeof dir - 1);
    dir[n > 0 ? n : 0] = 0;
    char *slash = strrchr(dir, '/');
    if (slash != NULL)
        *slash = 0;
    snprintf(path, PATH_MAX, "%s/../src/gl/" MODULE, dir); /* in the build tree */
    char beside[PATH_MAX];
    snprintf(beside, PATH_MAX, "%s/" MODULE, dir);
    if (access(beside, F_OK) == 0 || access(path, F_OK) != 0)
        memcpy(path, beside, PATH_MAX);
}

mn_code gl_load_module(gl_load *load, mn_status *st) {
    if (load->api != NULL)
        return MN_OK;
    char path[PATH_MAX];
    load->own_peak_bytes = cli_rss_peak_bytes();
    module_path(path);
    cli_alloc_threads_are_ours();
    const uint64_t entered = gl_load_enter(load);
    load->module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    gl_load_leave(load, entered);
    if (load->module == NULL)
        return mn_fail(st, MN_NO_GRAPHICS,
                       "no graphics: cannot load " MODULE
                       " (%s); it belongs beside metanode or in METANODE_HELPER_DIR",
                       dlerror());
    const mn_gl_api *api = dlsym(load->module, MN_GL_SYMBOL);
    if (api == NULL || api->version != MN_GL_VERSION)
        return mn_fail(st, MN_NO_GRAPHICS, "no graphics: %s is of another version of metanode",
                       path);
    load->api = api;
    return MN_OK;
}
