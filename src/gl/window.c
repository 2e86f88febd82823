/* A window, and what the user does in it. Hides GLFW: this is the only file that knows it.
 *
 * Callbacks only add up what happened; mni_window_poll hands the sum out and clears it. GLFW is
 * global to its process, so there is one window at a time. The main thread only (GLFW's rule).
 * Memory: a struct, and GLFW's. */
#include "parts.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef enum drag { DRAG_NONE = 0, DRAG_ORBIT, DRAG_ZOOM, DRAG_PAN } drag;

struct mni_window {
    GLFWwindow *window;
    mn_gl_input input; /* since the last poll */
    drag drag;
    double x, y; /* the pointer at its last event, in screen units: where it is now may be ahead */
};

static const float zoom_a_height = 6; /* notches of the wheel that a drag over the window makes */

static char last_error[160]; /* GLFW's own, which is global too */

static void on_error(int code, const char *text) {
    (void)code;
    snprintf(last_error, sizeof last_error, "%s", text);
}

static void on_button(GLFWwindow *window, int button, int action, int mods) {
    mni_window *w = glfwGetWindowUserPointer(window);
    if (action != GLFW_PRESS)
        w->drag = DRAG_NONE;
    else if (button == GLFW_MOUSE_BUTTON_RIGHT)
        w->drag = DRAG_ZOOM;
    else if (button == GLFW_MOUSE_BUTTON_MIDDLE || (mods & GLFW_MOD_SHIFT) != 0)
        w->drag = DRAG_PAN;
    else
        w->drag = DRAG_ORBIT;
}

static void on_pointer(GLFWwindow *window, double x, double y) {
    mni_window *w = glfwGetWindowUserPointer(window);
    int width = 1, height = 1;
    glfwGetWindowSize(window, &width, &height);
    const float dx = (float)((x - w->x) / (height > 0 ? height : 1));
    const float dy = (float)((y - w->y) / (height > 0 ? height : 1));
    w->x = x;
    w->y = y;
    if (w->drag == DRAG_ORBIT) {
        w->input.orbit[0] += dx;
        w->input.orbit[1] += dy;
    } else if (w->drag == DRAG_PAN) {
        w->input.pan[0] += dx;
        w->input.pan[1] += dy;
    } else if (w->drag == DRAG_ZOOM) {
        w->input.zoom -= dy * zoom_a_height;
    }
}

static void on_wheel(GLFWwindow *window, double dx, double dy) {
    mni_window *w = glfwGetWindowUserPointer(window);
    (void)dx;
    w->input.zoom += (float)dy;
}

/* Characters, not key positions: '+' and '?' lie elsewhere on each keyboard. */
static void on_character(GLFWwindow *window, unsigned character) {
    mni_window *w = glfwGetWindowUserPointer(window);
    if (w->input.typed_count < MN_GL_TYPED_MAX)
        w->input.typed[w->input.typed_count++] = character;
}

static void on_key(GLFWwindow *window, int key, int code, int action, int mods) {
    mni_window *w = glfwGetWindowUserPointer(window);
    (void)code;
    (void)mods;
    if (key == GLFW_KEY_ESCAPE && action == GLFW_PRESS)
        w->input.closed = true;
}

static void on_expose(GLFWwindow *window) {
    mni_window *w = glfwGetWindowUserPointer(window);
    w->input.exposed = true;
}

static void on_resize(GLFWwindow *window, int width, int height) {
    (void)width;
    (void)height;
    on_expose(window);
}

static void on_close(GLFWwindow *window) {
    mni_window *w = glfwGetWindowUserPointer(window);
    w->input.closed = true;
}

static GLFWwindow *create(uint32_t width, uint32_t height, const char *title) {
    glfwWindowHint(GLFW_CLIENT_API, GLFW_OPENGL_API);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
    glfwWindowHint(GLFW_DEPTH_BITS, 0); /* the renderer draws to targets of its own */
    glfwWindowHint(GLFW_STENCIL_BITS, 0);
    return glfwCreateWindow((int)width, (int)height, title, NULL, NULL);
}

mn_code mni_window_open(uint32_t width, uint32_t height, const char *title, mni_window **out,
                        mn_status *st) {
    *out = NULL;
    last_error[0] = 0;
    glfwSetErrorCallback(on_error);
    if (!glfwInit())
        return mn_fail(st, MN_NO_GRAPHICS, "no display (%s); try metanode shoot", last_error);
    mni_window *w = calloc(1, sizeof *w);
    if (w == NULL) {
        glfwTerminate();
        return mn_fail(st, MN_FAILED, "no memory for a window");
    }
    w->window = create(width, height, title);
    if (w->window == NULL) {
        mn_fail(st, MN_NO_GRAPHICS, "no window with OpenGL 3.3 (%s); try metanode shoot",
                last_error);
        free(w);
        glfwTerminate();
        return MN_NO_GRAPHICS;
    }
    glfwSetWindowUserPointer(w->window, w);
    glfwSetMouseButtonCallback(w->window, on_button);
    glfwSetCursorPosCallback(w->window, on_pointer);
    glfwSetScrollCallback(w->window, on_wheel);
    glfwSetCharCallback(w->window, on_character);
    glfwSetKeyCallback(w->window, on_key);
    glfwSetWindowRefreshCallback(w->window, on_expose);
    glfwSetFramebufferSizeCallback(w->window, on_resize);
    glfwSetWindowCloseCallback(w->window, on_close);
    glfwMakeContextCurrent(w->window);
    glfwSwapInterval(1);
    glfwGetCursorPos(w->window, &w->x, &w->y);
    *out = w;
    return MN_OK;
}

void mni_window_size(const mni_window *w, uint32_t *width, uint32_t *height) {
    int x = 0, y = 0; /* 0 × 0 while the window is an icon */
    glfwGetFramebufferSize(w->window, &x, &y);
    *width = x > 0 ? (uint32_t)x : 0;
    *height = y > 0 ? (uint32_t)y : 0;
}

void mni_window_swap(mni_window *w) {
    glfwSwapBuffers(w->window);
}

void mni_window_poll(mni_window *w, double timeout_s, mn_gl_input *out) {
    if (timeout_s > 0)
        glfwWaitEventsTimeout(timeout_s);
    else
        glfwPollEvents();
    *out = w->input;
    memset(&w->input, 0, sizeof w->input);
}

void mni_window_title(mni_window *w, const char *text) {
    glfwSetWindowTitle(w->window, text);
}

void mni_window_close(mni_window *w) {
    if (w == NULL)
        return;
    glfwDestroyWindow(w->window);
    glfwTerminate();
    free(w);
}
