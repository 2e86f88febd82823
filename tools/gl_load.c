/* See gl_load.h. Hides where the module lies and how its memory is told from ours: /proc/self/statm
 * is read before and after. */
#include "gl_load.h"

#include <dlfcn.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define MODULE "metanode-gl.so"

uint64_t gl_load_enter(void) {
    unsigned long long pages = 0;
    FILE *f = fopen("/proc/self/statm", "re");
    if (f == NULL)
        return 0;
    if (fscanf(f, "%*u %llu", &pages) != 1)
        pages = 0;
    fclose(f);
    return pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

void gl_load_leave(gl_load *load, uint64_t entered) {
    const uint64_t now = gl_load_enter();
    if (now > entered)
        load->rss_bytes += now - entered;
}

/* The directories where the module may lie, in order; returns how many. */
static int module_dirs(char dir[2][PATH_MAX]) {
    const char *helper = getenv("METANODE_HELPER_DIR");
    if (helper != NULL) {
        snprintf(dir[0], PATH_MAX, "%s", helper);
        return 1;
    }
    char program[PATH_MAX];
    const ssize_t n = readlink("/proc/self/exe", program, sizeof program - 1);
    program[n > 0 ? n : 0] = 0;
    char *slash = strrchr(program, '/');
    if (slash == NULL)
        return 0;
    *slash = 0;
    snprintf(dir[0], PATH_MAX, "%s", program);
    if (strlen(program) + sizeof "/../src/gl" > PATH_MAX)
        return 1;
    snprintf(dir[1], PATH_MAX, "%.*s/../src/gl", PATH_MAX - 12, program);
    return 2;
}

mn_code gl_load_module(gl_load *load, mn_status *st) {
    if (load->api != NULL)
        return MN_OK;
    char dir[2][PATH_MAX], path[PATH_MAX + 16], why[300] = "the program's directory is unknown";
    const uint64_t entered = gl_load_enter();
    const int dirs = module_dirs(dir);
    for (int i = 0; i < dirs && load->module == NULL; i++) {
        snprintf(path, sizeof path, "%s/" MODULE, dir[i]);
        /* The first place that has the file is the one whose failure is worth telling. */
        if (i + 1 < dirs && access(path, F_OK) != 0)
            continue;
        load->module = dlopen(path, RTLD_NOW | RTLD_LOCAL);
        if (load->module == NULL)
            snprintf(why, sizeof why, "%s", dlerror());
        if (load->module == NULL && access(path, F_OK) == 0)
            break;
    }
    if (load->module == NULL)
        return mn_fail(st, MN_NO_GRAPHICS,
                       "no graphics: cannot load " MODULE
                       " (%s); it belongs beside metanode or in METANODE_HELPER_DIR",
                       why);
    const mn_gl_api *api = dlsym(load->module, MN_GL_SYMBOL);
    if (api == NULL || api->version != MN_GL_VERSION)
        return mn_fail(st, MN_NO_GRAPHICS, "no graphics: %s is of another version of metanode",
                       path);
    load->api = api;
    gl_load_leave(load, entered);
    return MN_OK;
}
