/* An OpenGL context without a display. Hides EGL: this is the only file that knows it.
 *
 * Tried in this order: Mesa's surfaceless platform (works without a GPU and without a device file),
 * each EGL device (drivers that lack the former), the default display. The first that gives OpenGL
 * 3.3 core is taken; nothing is drawn to an EGL surface, the renderer brings its own targets.
 * One thread: that of the context. Memory: a struct, and the driver's. */
#include "parts.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { DEVICES_MAX = 16 }; /* more GPUs than that in one machine are not looked at */

struct mni_offscreen {
    EGLDisplay display;
    EGLContext context;
    EGLSurface surface; /* a pixel, where contexts without surface are not offered */
};

static bool offers(const char *list, const char *name) {
    const size_t n = strlen(name);
    for (const char *at = list; at != NULL && (at = strstr(at, name)) != NULL; at += n)
        if ((at == list || at[-1] == ' ') && (at[n] == 0 || at[n] == ' '))
            return true;
    return false;
}

/* Why the display is of no use; NULL: its context is current. */
static const char *start(mni_offscreen *o, EGLDisplay display) {
    static const EGLint wanted[] = {EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT, EGL_SURFACE_TYPE,
                                    EGL_PBUFFER_BIT, EGL_NONE};
    static const EGLint version[] = {EGL_CONTEXT_MAJOR_VERSION,
                                     3,
                                     EGL_CONTEXT_MINOR_VERSION,
                                     3,
                                     EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                     EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                     EGL_NONE};
    static const EGLint pixel[] = {EGL_WIDTH, 1, EGL_HEIGHT, 1, EGL_NONE};
    if (display == EGL_NO_DISPLAY || !eglInitialize(display, NULL, NULL))
        return "no display";
    o->display = display;
    o->context = EGL_NO_CONTEXT;
    o->surface = EGL_NO_SURFACE;
    const char *why = NULL;
    EGLConfig config = NULL;
    EGLint configs = 0;
    if (!eglBindAPI(EGL_OPENGL_API))
        why = "no OpenGL";
    else if (!eglChooseConfig(display, wanted, &config, 1, &configs) || configs < 1)
        why = "no configuration for OpenGL";
    else if ((o->context = eglCreateContext(display, config, EGL_NO_CONTEXT, version)) ==
             EGL_NO_CONTEXT)
        why = "no OpenGL 3.3 core";
    else if (!offers(eglQueryString(display, EGL_EXTENSIONS), "EGL_KHR_surfaceless_context") &&
             (o->surface = eglCreatePbufferSurface(display, config, pixel)) == EGL_NO_SURFACE)
        why = "no surface";
    else if (!eglMakeCurrent(display, o->surface, o->surface, o->context))
        why = "context not accepted";
    if (why == NULL)
        return NULL;
    if (o->surface != EGL_NO_SURFACE)
        eglDestroySurface(display, o->surface);
    if (o->context != EGL_NO_CONTEXT)
        eglDestroyContext(display, o->context);
    eglTerminate(display);
    return why;
}

static const char *try_surfaceless(mni_offscreen *o, const char *client) {
    PFNEGLGETPLATFORMDISPLAYEXTPROC get =
        (PFNEGLGETPLATFORMDISPLAYEXTPROC)eglGetProcAddress("eglGetPlatformDisplayEXT");
    if (get == NULL || !offers(client, "EGL_MESA_platform_surfaceless"))
        return "not offered";
    return start(o, get(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL));
}

static const char *try_device(mni_offscreen *o, const char *client) {
    PFNEGLGETPLATFORMDISPLAYEXTPROC get =
        (PFNEGLGETPLATFORMDISPLAYEXTPROC)eglGetProcAddress("eglGetPlatformDisplayEXT");
    PFNEGLQUERYDEVICESEXTPROC query =
        (PFNEGLQUERYDEVICESEXTPROC)eglGetProcAddress("eglQueryDevicesEXT");
    EGLDeviceEXT device[DEVICES_MAX];
    EGLint devices = 0;
    if (get == NULL || query == NULL || !offers(client, "EGL_EXT_platform_device"))
        return "not offered";
    if (!query(DEVICES_MAX, device, &devices) || devices < 1)
        return "no device";
    const char *why = NULL;
    for (EGLint i = 0; i < devices; i++)
        if ((why = start(o, get(EGL_PLATFORM_DEVICE_EXT, device[i], NULL))) == NULL)
            return NULL;
    return why;
}

static const char *try_default(mni_offscreen *o, const char *client) {
    (void)client;
    return start(o, eglGetDisplay(EGL_DEFAULT_DISPLAY));
}

mn_code mni_offscreen_open(mni_offscreen **out, mn_status *st) {
    static const struct {
        const char *name;
        const char *(*attempt)(mni_offscreen *o, const char *client);
    } platform[] = {
        {"surfaceless", try_surfaceless}, {"device", try_device}, {"default", try_default}};
    const char *only = getenv("METANODE_EGL");
    const char *client = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
    char said[256] = "";
    mni_offscreen *o = calloc(1, sizeof *o);
    *out = NULL;
    if (o == NULL)
        return mn_fail(st, MN_FAILED, "no memory for an EGL context");
    for (size_t i = 0; i < sizeof platform / sizeof platform[0]; i++) {
        if (only != NULL && strcmp(only, platform[i].name) != 0)
            continue;
        const char *why = platform[i].attempt(o, client);
        if (why == NULL) {
            *out = o;
            return MN_OK;
        }
        const size_t n = strlen(said);
        snprintf(said + n, sizeof said - n, "%s%s: %s", n > 0 ? ", " : "", platform[i].name, why);
    }
    free(o);
    return mn_fail(st, MN_NO_GRAPHICS,
                   "no graphics: EGL gives no OpenGL 3.3 context (%s); install Mesa's EGL and GL "
                   "drivers",
                   said[0] != 0 ? said : "METANODE_EGL is not surfaceless, device or default");
}

void mni_offscreen_close(mni_offscreen *o) {
    if (o == NULL)
        return;
    eglMakeCurrent(o->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
    if (o->surface != EGL_NO_SURFACE)
        eglDestroySurface(o->display, o->surface);
    eglDestroyContext(o->display, o->context);
    eglTerminate(o->display);
    eglReleaseThread();
    free(o);
}
