/* A front to pixels. Hides OpenGL: this is the only file that knows it.
 *
 * Order: open, front, draw, then pixels or present; resize at any time. The thread of the context.
 * Memory: buffers for the largest front, allocated at open (node slots × 24 bytes and simplex slots
 * × 12 with the driver, node slots × 12 here for the sums of normals), and the targets.
 *
 *     front ── gather ──> index, normals ──> one draw call ──> drawn (4 samples) ──> shown
 *
 * Cracks: triangles share their corners by index, so no edge is rasterised from two roundings.
 * Depth: positions are taken relative to the eye before they are turned. Where the driver has
 * glClipControl, depth is near / distance in a float buffer: its relative precision is the same
 * everywhere, so the near plane may be close and there is no far one. Elsewhere the planes are
 * fitted to the model's bounding box. */
#include "parts.h"

#include <cglm/cglm.h>
#include <epoxy/gl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"

enum {
    SAMPLES_WANTED = 4,
    POSITION = 0, /* attribute locations, as in shaders.c */
    NORMAL = 1,
    COLOR = 2,
    SWITCH_VALUE = 3,
    ATTRIBUTES = 4,
};

typedef struct program {
    GLuint name;
    GLint eye, view, scale, depth, inv_radius, paint, flat_shading;
} program;

typedef struct target { /* what is drawn to, or read from */
    GLuint framebuffer, color, depth;
} target;

struct mni_render {
    /* const after open */
    uint32_t node_slots_max, simplex_slots_max;
    bool has_colors, reversed_depth;
    vec3 box_min, box_max;
    GLint samples, size_max;
    char driver[128];
    program surface, wire;
    GLuint sky;
    GLuint surface_array, sky_array;
    GLuint attribute[ATTRIBUTES], index;
    float *normal; /* 3 × node_slots_max: sums */
    /* by front and resize */
    uint32_t triangles;
    bool front_colors;
    uint32_t width, height;
    target drawn, shown; /* shown has one sample; pixels are read from it */
};

static mn_code gl_status(const char *doing, mn_status *st) {
    const GLenum error = glGetError();
    if (error == GL_NO_ERROR)
        return MN_OK;
    return mn_fail(st, MN_FAILED, "OpenGL error 0x%04x while %s%s", error, doing,
                   error == GL_OUT_OF_MEMORY ? ": the driver has no memory left" : "");
}

/* ---- programs ------------------------------------------------------------------------------- */

static GLuint compile(GLenum kind, const char *text, mn_status *st) {
    GLint good = GL_FALSE;
    char log[256] = "";
    const GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 1, &text, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
    if (good)
        return shader;
    glGetShaderInfoLog(shader, sizeof log, NULL, log);
    glDeleteShader(shader);
    mn_fail(st, MN_NO_GRAPHICS, "the driver refuses a shader: %s", log);
    return 0;
}

/* geometry may be NULL. 0: *st says why. */
static GLuint link_program(const char *vertex, const char *geometry, const char *fragment,
                           mn_status *st) {
    const char *const text[3] = {vertex, geometry, fragment};
    static const GLenum kind[3] = {GL_VERTEX_SHADER, GL_GEOMETRY_SHADER, GL_FRAGMENT_SHADER};
    GLuint shader[3] = {0, 0, 0};
    GLuint name = glCreateProgram();
    GLint good = GL_TRUE;
    for (int i = 0; i < 3 && good; i++) {
        if (text[i] == NULL)
            continue;
        shader[i] = compile(kind[i], text[i], st);
        good = shader[i] != 0;
        if (good)
            glAttachShader(name, shader[i]);
    }
    if (good) {
        glLinkProgram(name);
        glGetProgramiv(name, GL_LINK_STATUS, &good);
        char log[256] = "";
        glGetProgramInfoLog(name, sizeof log, NULL, log);
        if (!good)
            mn_fail(st, MN_NO_GRAPHICS, "the driver refuses a program: %s", log);
    }
    for (int i = 0; i < 3; i++)
        glDeleteShader(shader[i]); /* 0 is ignored; the program keeps what it needs */
    if (!good) {
        glDeleteProgram(name);
        name = 0;
    }
    return name;
}

static bool open_program(program *p, const char *geometry, const char *fragment, mn_status *st) {
    p->name = link_program(mni_shader_surface_vertex, geometry, fragment, st);
    if (p->name == 0)
        return false;
    p->eye = glGetUniformLocation(p->name, "eye");
    p->view = glGetUniformLocation(p->name, "view");
    p->scale = glGetUniformLocation(p->name, "scale");
    p->depth = glGetUniformLocation(p->name, "depth");
    p->inv_radius = glGetUniformLocation(p->name, "inv_radius");
    p->paint = glGetUniformLocation(p->name, "paint");
    p->flat_shading = glGetUniformLocation(p->name, "flat_shading");
    return true;
}

/* ---- targets -------------------------------------------------------------------------------- */

static void close_target(target *t) {
    glDeleteFramebuffers(1, &t->framebuffer);
    glDeleteRenderbuffers(1, &t->color);
    glDeleteRenderbuffers(1, &t->depth);
    *t = (target){0, 0, 0};
}

static GLuint attach(GLenum point, GLenum format, GLint samples, uint32_t width, uint32_t height) {
    GLuint name = 0;
    glGenRenderbuffers(1, &name);
    glBindRenderbuffer(GL_RENDERBUFFER, name);
    glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples, format, (GLsizei)width,
                                     (GLsizei)height);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, point, GL_RENDERBUFFER, name);
    return name;
}

static bool open_target(target *t, GLint samples, bool depth, uint32_t width, uint32_t height) {
    glGenFramebuffers(1, &t->framebuffer);
    glBindFramebuffer(GL_FRAMEBUFFER, t->framebuffer);
    t->color = attach(GL_COLOR_ATTACHMENT0, GL_RGBA8, samples, width, height);
    if (depth)
        t->depth = attach(GL_DEPTH_ATTACHMENT, GL_DEPTH_COMPONENT32F, samples, width, height);
    return glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
}

mn_code mni_render_resize(mni_render *r, uint32_t width, uint32_t height, mn_status *st) {
    close_target(&r->drawn);
    close_target(&r->shown);
    r->width = width;
    r->height = height;
    if (width < 1 || height < 1 || width > (uint32_t)r->size_max || height > (uint32_t)r->size_max)
        return mn_fail(st, MN_USAGE, "a picture of %u x %u: this driver makes 1 to %d each way",
                       width, height, r->size_max);
    const bool good = open_target(&r->shown, 0, false, width, height) &&
                      open_target(&r->drawn, r->samples, true, width, height);
    const mn_code code = gl_status("making room for the picture", st);
    if (code == MN_OK && !good)
        return mn_fail(st, MN_NO_GRAPHICS, "the driver refuses a picture of %u x %u", width,
                       height);
    return code;
}

/* ---- open and close ------------------------------------------------------------------------- */

static void open_attribute(mni_render *r, GLuint location, GLint size, GLenum type, size_t bytes) {
    glGenBuffers(1, &r->attribute[location]);
    glBindBuffer(GL_ARRAY_BUFFER, r->attribute[location]);
    glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)(bytes * r->node_slots_max), NULL, GL_STREAM_DRAW);
    glVertexAttribPointer(location, size, type, type != GL_FLOAT, 0, NULL);
    glEnableVertexAttribArray(location);
}

static void open_buffers(mni_render *r) {
    glGenVertexArrays(1, &r->sky_array);
    glGenVertexArrays(1, &r->surface_array);
    glBindVertexArray(r->surface_array);
    open_attribute(r, POSITION, 3, GL_FLOAT, 12);
    open_attribute(r, NORMAL, 4, GL_INT_2_10_10_10_REV, 4);
    if (r->has_colors)
        open_attribute(r, COLOR, 4, GL_UNSIGNED_BYTE, 4);
    open_attribute(r, SWITCH_VALUE, 1, GL_FLOAT, 4);
    glGenBuffers(1, &r->index);
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, r->index);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, (GLsizeiptr)(12 * (size_t)r->simplex_slots_max), NULL,
                 GL_STREAM_DRAW);
}

static void fixed_state(mni_render *r) {
    GLint samples_max = 0;
    glGetIntegerv(GL_MAX_SAMPLES, &samples_max);
    glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &r->size_max);
    r->samples = samples_max < SAMPLES_WANTED ? samples_max : SAMPLES_WANTED;
    r->reversed_depth = epoxy_gl_version() >= 45 || epoxy_has_gl_extension("GL_ARB_clip_control");
    if (r->reversed_depth)
        glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
    glDepthFunc(r->reversed_depth ? GL_GREATER : GL_LESS);
    glClearDepth(r->reversed_depth ? 0 : 1);
    glDisable(GL_CULL_FACE); /* open meshes show their backs */
    glEnable(GL_MULTISAMPLE);
    const char *name = (const char *)glGetString(GL_RENDERER);
    strncpy(r->driver, name != NULL ? name : "unknown", sizeof r->driver - 1);
}

mn_code mni_render_open(const mn_gl_desc *desc, mni_render **out, mn_status *st) {
    *out = NULL;
    if (epoxy_gl_version() < 33)
        return mn_fail(st, MN_NO_GRAPHICS, "OpenGL %d.%d; 3.3 is needed", epoxy_gl_version() / 10,
                       epoxy_gl_version() % 10);
    mni_render *r = calloc(1, sizeof *r);
    float *normal = malloc(sizeof(float) * 3 * ((size_t)desc->node_slots_max + 1));
    if (r == NULL || normal == NULL) {
        free(r);
        free(normal);
        return mn_fail(st, MN_FAILED, "no memory to draw %u nodes", desc->node_slots_max);
    }
    r->normal = normal;
    r->node_slots_max = desc->node_slots_max;
    r->simplex_slots_max = desc->simplex_slots_max;
    r->has_colors = desc->has_colors;
    glm_vec3_copy((float *)desc->box_min, r->box_min);
    glm_vec3_copy((float *)desc->box_max, r->box_max);
    fixed_state(r);
    bool good = open_program(&r->surface, NULL, mni_shader_surface_fragment, st) &&
                open_program(&r->wire, mni_shader_wire_geometry, mni_shader_wire_fragment, st);
    r->sky = good ? link_program(mni_shader_sky_vertex, NULL, mni_shader_sky_fragment, st) : 0;
    mn_code code = r->sky != 0 ? MN_OK : MN_NO_GRAPHICS;
    if (code == MN_OK)
        open_buffers(r);
    if (code == MN_OK)
        code = gl_status("making room for the front", st);
    if (code == MN_OK)
        code = mni_render_resize(r, desc->width_px, desc->height_px, st);
    if (code == MN_OK)
        *out = r;
    else
        mni_render_close(r);
    return code;
}

void mni_render_close(mni_render *r) {
    if (r == NULL)
        return;
    close_target(&r->drawn);
    close_target(&r->shown);
    glDeleteBuffers(ATTRIBUTES, r->attribute);
    glDeleteBuffers(1, &r->index);
    glDeleteVertexArrays(1, &r->surface_array);
    glDeleteVertexArrays(1, &r->sky_array);
    glDeleteProgram(r->surface.name);
    glDeleteProgram(r->wire.name);
    glDeleteProgram(r->sky);
    free(r->normal);
    free(r);
}

/* ---- the front ------------------------------------------------------------------------------ */

/* Orphans the buffer, so that the driver need not wait for the last frame's drawing. */
static void upload(GLuint buffer, const void *data, size_t bytes_max, size_t bytes) {
    glBindBuffer(GL_ARRAY_BUFFER, buffer);
    glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)bytes_max, NULL, GL_STREAM_DRAW);
    glBufferSubData(GL_ARRAY_BUFFER, 0, (GLsizeiptr)bytes, data);
}

static void *map(GLenum point, size_t bytes) {
    return glMapBufferRange(point, 0, (GLsizeiptr)bytes,
                            GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
}

/* Index list and normals, written where the driver reads them. */
static bool upload_surface(mni_render *r, const mn_front *front) {
    uint32_t *index = map(GL_ELEMENT_ARRAY_BUFFER, 12 * (size_t)front->simplex_slots);
    if (index == NULL)
        return false;
    r->triangles = mni_surface_gather(front, index, r->normal);
    bool good = glUnmapBuffer(GL_ELEMENT_ARRAY_BUFFER);
    glBindBuffer(GL_ARRAY_BUFFER, r->attribute[NORMAL]);
    uint32_t *packed = map(GL_ARRAY_BUFFER, 4 * (size_t)front->node_slots);
    if (packed == NULL)
        return false;
    for (uint32_t i = 0; i < front->node_slots; i++)
        packed[i] = mni_surface_pack(r->normal + 3 * (size_t)i);
    return glUnmapBuffer(GL_ARRAY_BUFFER) && good;
}

mn_code mni_render_front(mni_render *r, const mn_front *front, mn_status *st) {
    MN_ASSERT(front->node_slots <= r->node_slots_max);
    MN_ASSERT(front->simplex_slots <= r->simplex_slots_max);
    const size_t most = r->node_slots_max, n = front->node_slots;
    r->triangles = 0;
    r->front_colors = r->has_colors && front->color != NULL;
    if (n == 0 || front->simplex_slots == 0)
        return MN_OK;
    glBindVertexArray(r->surface_array);
    upload(r->attribute[POSITION], front->position, 12 * most, 12 * n);
    upload(r->attribute[SWITCH_VALUE], front->switch_value, 4 * most, 4 * n);
    if (r->front_colors)
        upload(r->attribute[COLOR], front->color, 4 * most, 4 * n);
    if (!upload_surface(r, front)) {
        r->triangles = 0;
        gl_status("handing over the front", st);
        return mn_fail(st, MN_FAILED, "the driver lost the front's buffers");
    }
    return gl_status("handing over the front", st);
}

/* ---- drawing -------------------------------------------------------------------------------- */

/* Rows: right, up, back. An up along the view is replaced by an axis that is not. */
static void view_of(const mn_camera *camera, mat3 view) {
    vec3 up, forward, right;
    glm_vec3_copy((float *)camera->up, up);
    glm_vec3_sub((float *)camera->target, (float *)camera->eye, forward);
    glm_vec3_normalize(forward);
    glm_vec3_normalize(up);
    if (fabsf(glm_vec3_dot(forward, up)) > 0.99999f)
        glm_vec3_copy(fabsf(forward[2]) < 0.9f ? (vec3){0, 0, 1} : (vec3){1, 0, 0}, up);
    glm_vec3_crossn(forward, up, right);
    glm_vec3_cross(right, forward, up);
    for (int i = 0; i < 3; i++) { /* GL's matrices are columns of rows */
        view[i][0] = right[i];
        view[i][1] = up[i];
        view[i][2] = -forward[i];
    }
}

/* The smallest and largest distance along the view at which the model's box can be seen. */
static void planes_of(const mni_render *r, const mn_camera *camera, mat3 view, float radius,
                      float *near, float *far) {
    float outside2 = 0;
    *far = 0;
    for (int i = 0; i < 3; i++) {
        const float e = camera->eye[i];
        const float d = fmaxf(fmaxf(r->box_min[i] - e, e - r->box_max[i]), 0);
        outside2 += d * d;
    }
    for (int corner = 0; corner < 8; corner++) {
        float z = 0;
        for (int i = 0; i < 3; i++)
            z -= view[i][2] * ((corner >> i & 1 ? r->box_max[i] : r->box_min[i]) - camera->eye[i]);
        *far = fmaxf(*far, z);
    }
    /* The box's distance is along any direction; in the corner of a picture 60 degrees off its
     * axis the same point is half as far along the view. */
    const float closest = r->reversed_depth ? 1e-6f : 5e-4f;
    *near = fmaxf(0.4f * sqrtf(outside2), closest * radius);
    *far = fmaxf(1.01f * *far, 2 * *near);
}

static void use(const mni_render *r, const program *p, const mn_camera *camera,
                const mn_gl_look *look) {
    mat3 view;
    view_of(camera, view);
    float radius = 0.5f * glm_vec3_distance((float *)r->box_min, (float *)r->box_max);
    if (!(radius > 0))
        radius = 1;
    float near, far;
    planes_of(r, camera, view, radius, &near, &far);
    const float sy = 1 / tanf(0.5f * glm_rad(camera->fov_y_deg));
    glUseProgram(p->name);
    glUniform3fv(p->eye, 1, camera->eye);
    glUniformMatrix3fv(p->view, 1, GL_FALSE, view[0]);
    glUniform2f(p->scale, sy * (float)r->height / (float)r->width, sy);
    if (r->reversed_depth)
        glUniform2f(p->depth, 0, near);
    else
        glUniform2f(p->depth, -(far + near) / (far - near), -2 * far * near / (far - near));
    glUniform1f(p->inv_radius, 1 / radius);
    glUniform1i(p->paint, look->lod_colors ? 2 : r->front_colors ? 1 : 0);
    glUniform1i(p->flat_shading, look->flat);
}

mn_code mni_render_draw(mni_render *r, const mn_camera *camera, const mn_gl_look *look,
                        mn_status *st) {
    glBindFramebuffer(GL_FRAMEBUFFER, r->drawn.framebuffer);
    glViewport(0, 0, (GLsizei)r->width, (GLsizei)r->height);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glDisable(GL_DEPTH_TEST);
    glUseProgram(r->sky);
    glBindVertexArray(r->sky_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    if (r->triangles > 0) {
        glEnable(GL_DEPTH_TEST);
        use(r, look->wireframe ? &r->wire : &r->surface, camera, look);
        glBindVertexArray(r->surface_array);
        glDrawElements(GL_TRIANGLES, (GLsizei)(3 * r->triangles), GL_UNSIGNED_INT, NULL);
    }
    glBindFramebuffer(GL_READ_FRAMEBUFFER, r->drawn.framebuffer);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, r->shown.framebuffer);
    glBlitFramebuffer(0, 0, (GLint)r->width, (GLint)r->height, 0, 0, (GLint)r->width,
                      (GLint)r->height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
    return gl_status("drawing", st);
}

void mni_render_present(mni_render *r) {
    glBindFramebuffer(GL_READ_FRAMEBUFFER, r->shown.framebuffer);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, 0);
    glBlitFramebuffer(0, 0, (GLint)r->width, (GLint)r->height, 0, 0, (GLint)r->width,
                      (GLint)r->height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
}

void mni_render_size(const mni_render *r, uint32_t *width, uint32_t *height) {
    *width = r->width;
    *height = r->height;
}

mn_code mni_render_pixels(mni_render *r, uint8_t *rgba, mn_status *st) {
    glBindFramebuffer(GL_READ_FRAMEBUFFER, r->shown.framebuffer);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    glReadPixels(0, 0, (GLsizei)r->width, (GLsizei)r->height, GL_RGBA, GL_UNSIGNED_BYTE, rgba);
    return gl_status("reading the picture", st);
}

const char *mni_render_driver(const mni_render *r) {
    return r->driver;
}
