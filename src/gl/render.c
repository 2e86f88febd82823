/* A front to pixels. Hides OpenGL: this is the only file that knows it.
 *
 * Order: open, front, draw, then pixels or present; resize at any time. The thread of the context.
 * Memory: buffers for the largest front, allocated at open (node slots × 24 bytes and simplex slots
 * × 12 with the driver, their mirror here), and the targets.
 *
 *     front ──> mirror ── what is new ──> buffers ── one call ──> drawn (4 samples) ──> shown
 *
 * Cracks: triangles share their corners by index, so no edge is rasterised from two roundings.
 * Depth: positions are taken relative to the eye before they are turned, and measured in the power
 * of two next below the model's radius: shaders square areas, which floats do not hold of models as
 * small as 1e-12 or as large as 1e12, and a power of two rounds nothing. Where the driver has
 * glClipControl, depth is near / distance in a float buffer: its relative precision is the same
 * everywhere, so the near plane may be close and there is no far one. Elsewhere the planes are
 * fitted to the model's bounding box. */
#include "parts.h"

#include <cglm/cglm.h>
#include <epoxy/gl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"

enum {
    SAMPLES_WANTED = 4,
    POSITION = 0, /* attribute locations, as in shaders.c */
    NORMAL = 1,
    COLOR = 2,
    SWITCH_VALUE = 3,
};
enum { WAIT_NS = 1000000000 }; /* then it is asked again: drivers may lie about longer ones */

/* What the driver holds of a front; the mirror has the same arrays. */
typedef enum buffer { VERTICES = 0, NORMALS, COLORS, INDICES, BUFFERS } buffer;
static const size_t stride[BUFFERS] = {16, 4, 4, 12};

/* How changes reach the driver. METANODE_GL_UPLOAD asks for one of them; MAPPED needs
 * ARB_buffer_storage and is taken where it is offered. */
typedef enum uploads {
    UPLOAD_MAPPED = 0, /* written into buffers that stay mapped, once the last picture is drawn */
    UPLOAD_RANGES,     /* handed over range by range */
    UPLOAD_WHOLE,      /* all, each time: to compare with */
    UPLOADS
} uploads;
static const char *const upload_name[UPLOADS] = {"mapped", "ranges", "whole"};
/* Changes closer than that are one range: a call costs more than it saves in bytes. */
static const size_t range_gap_bytes = 256;

typedef struct program {
    GLuint name;
    GLint eye, unit, view, scale, px_scale, depth, inv_radius, paint, flat_shading;
} program;

typedef struct target { /* what is drawn to, or read from */
    GLuint framebuffer, color, depth;
} target;

struct mni_render {
    /* const after open */
    bool reversed_depth;
    vec3 box_min, box_max;
    double radius; /* of the box; 1 if it is a point */
    float unit;    /* a power of two: radius × unit is 1 to 2 */
    GLint samples, size_max;
    char driver[128];
    program surface, wire;
    GLuint sky;
    GLuint surface_array, sky_array;
    uploads uploads;
    GLuint buffer[BUFFERS];
    uint8_t *mapped[BUFFERS]; /* NULL: not MAPPED */
    /* by front, draw and resize */
    mni_surface mirror;
    bool front_colors;
    GLsync drawn_at; /* when the driver has read the buffers for the last picture; NULL: it has */
    mn_gl_stats stats;
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

static bool open_program(program *p, const char *fragment, mn_status *st) {
    p->name = link_program(mni_shader_surface_vertex, mni_shader_surface_geometry, fragment, st);
    if (p->name == 0)
        return false;
    p->eye = glGetUniformLocation(p->name, "eye");
    p->unit = glGetUniformLocation(p->name, "unit");
    p->view = glGetUniformLocation(p->name, "view");
    p->scale = glGetUniformLocation(p->name, "scale");
    p->px_scale = glGetUniformLocation(p->name, "px_scale");
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
        return mn_fail(st, MN_NO_GRAPHICS,
                       "the driver refuses a picture of %u x %u: try a smaller one", width, height);
    return code;
}

/* ---- open and close ------------------------------------------------------------------------- */

static void open_buffer(mni_render *r, buffer which, GLenum point, size_t slots_max) {
    const GLbitfield stays = GL_MAP_WRITE_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT;
    const GLsizeiptr bytes = (GLsizeiptr)(stride[which] * (slots_max + 1)); /* never 0 */
    glGenBuffers(1, &r->buffer[which]);
    glBindBuffer(point, r->buffer[which]);
    if (r->uploads == UPLOAD_MAPPED) {
        glBufferStorage(point, bytes, NULL, stays);
        r->mapped[which] = glMapBufferRange(point, 0, bytes, stays);
    } else {
        glBufferData(point, bytes, NULL, GL_DYNAMIC_DRAW);
    }
}

static void open_attribute(buffer which, GLuint location, GLint size, GLenum type, size_t at) {
    glVertexAttribPointer(location, size, type, type != GL_FLOAT, (GLsizei)stride[which],
                          (const void *)at);
    glEnableVertexAttribArray(location);
}

static void open_buffers(mni_render *r, const mn_gl_desc *desc) {
    glGenVertexArrays(1, &r->sky_array);
    glGenVertexArrays(1, &r->surface_array);
    glBindVertexArray(r->surface_array);
    open_buffer(r, VERTICES, GL_ARRAY_BUFFER, desc->node_slots_max);
    open_attribute(VERTICES, POSITION, 3, GL_FLOAT, 0);
    open_attribute(VERTICES, SWITCH_VALUE, 1, GL_FLOAT, 12);
    open_buffer(r, NORMALS, GL_ARRAY_BUFFER, desc->node_slots_max);
    open_attribute(NORMALS, NORMAL, 4, GL_INT_2_10_10_10_REV, 0);
    if (desc->has_colors) {
        open_buffer(r, COLORS, GL_ARRAY_BUFFER, desc->node_slots_max);
        open_attribute(COLORS, COLOR, 4, GL_UNSIGNED_BYTE, 0);
    }
    open_buffer(r, INDICES, GL_ELEMENT_ARRAY_BUFFER, desc->simplex_slots_max);
}

static mn_code choose_uploads(mni_render *r, mn_status *st) {
    const bool may_map =
        epoxy_gl_version() >= 44 || epoxy_has_gl_extension("GL_ARB_buffer_storage");
    const char *only = getenv("METANODE_GL_UPLOAD");
    r->uploads = may_map ? UPLOAD_MAPPED : UPLOAD_RANGES;
    for (int i = 0; only != NULL && i < UPLOADS; i++)
        if (strcmp(only, upload_name[i]) == 0)
            r->uploads = (uploads)i;
    if (only != NULL && strcmp(only, upload_name[r->uploads]) != 0)
        return mn_fail(st, MN_USAGE, "METANODE_GL_UPLOAD is '%s', not mapped, ranges or whole",
                       only);
    if (r->uploads == UPLOAD_MAPPED && !may_map)
        return mn_fail(st, MN_NO_GRAPHICS,
                       "METANODE_GL_UPLOAD: this driver maps no buffer for "
                       "good (ARB_buffer_storage)");
    return MN_OK;
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

static void measure_box(mni_render *r, const mn_gl_desc *desc) {
    double square = 0;
    for (int i = 0; i < 3; i++) {
        const double side = (double)desc->box_max[i] - (double)desc->box_min[i];
        r->box_min[i] = desc->box_min[i];
        r->box_max[i] = desc->box_max[i];
        square += side * side;
    }
    r->radius = square > 0 ? 0.5 * sqrt(square) : 1;
    r->unit = (float)ldexp(1, -ilogb(r->radius));
}

mn_code mni_render_open(const mn_gl_desc *desc, mni_render **out, mn_status *st) {
    *out = NULL;
    if (epoxy_gl_version() < 33)
        return mn_fail(st, MN_NO_GRAPHICS, "OpenGL %d.%d; 3.3 is needed", epoxy_gl_version() / 10,
                       epoxy_gl_version() % 10);
    mni_render *r = calloc(1, sizeof *r);
    if (r == NULL || !mni_surface_open(&r->mirror, desc->node_slots_max, desc->simplex_slots_max,
                                       desc->has_colors)) {
        free(r);
        return mn_fail(st, MN_FAILED, "no memory to draw %u nodes", desc->node_slots_max);
    }
    measure_box(r, desc);
    fixed_state(r);
    mn_code code = choose_uploads(r, st);
    bool good = code == MN_OK && open_program(&r->surface, mni_shader_surface_fragment, st) &&
                open_program(&r->wire, mni_shader_wire_fragment, st);
    r->sky = good ? link_program(mni_shader_sky_vertex, NULL, mni_shader_sky_fragment, st) : 0;
    if (code == MN_OK && r->sky == 0)
        code = MN_NO_GRAPHICS;
    if (code == MN_OK)
        open_buffers(r, desc);
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
    glDeleteSync(r->drawn_at);           /* 0 is ignored */
    glDeleteBuffers(BUFFERS, r->buffer); /* and unmaps them */
    glDeleteVertexArrays(1, &r->surface_array);
    glDeleteVertexArrays(1, &r->sky_array);
    glDeleteProgram(r->surface.name);
    glDeleteProgram(r->wire.name);
    glDeleteProgram(r->sky);
    mni_surface_close(&r->mirror);
    free(r);
}

/* ---- the front ------------------------------------------------------------------------------ */

static void send(mni_render *r, buffer which, size_t at, size_t bytes, const void *data) {
    if (r->mapped[which] != NULL)
        memcpy(r->mapped[which] + at, data, bytes);
    else
        glBufferSubData(GL_COPY_WRITE_BUFFER, (GLintptr)at, (GLsizeiptr)bytes, data);
    r->stats.sent_bytes += bytes;
    r->stats.sent_ranges++;
}

static void send_new(mni_render *r, buffer which, uint64_t *bits, uint32_t limit,
                     const void *mirror) {
    const size_t size = stride[which];
    const uint32_t gap = r->uploads == UPLOAD_MAPPED ? 0 : (uint32_t)(range_gap_bytes / size);
    if (r->uploads == UPLOAD_WHOLE)
        mni_surface_all(bits, limit);
    glBindBuffer(GL_COPY_WRITE_BUFFER, r->buffer[which]);
    for (uint32_t first = 0, end; mni_surface_run(bits, limit, gap, &first, &end); first = end)
        send(r, which, size * first, size * (end - first), (const char *)mirror + size * first);
}

/* What lies in mapped buffers is the driver's until the picture is drawn. */
static void wait_for_drawing(mni_render *r) {
    if (r->drawn_at == NULL)
        return;
    while (glClientWaitSync(r->drawn_at, GL_SYNC_FLUSH_COMMANDS_BIT, WAIT_NS) == GL_TIMEOUT_EXPIRED)
        continue;
    glDeleteSync(r->drawn_at);
    r->drawn_at = NULL;
}

mn_code mni_render_front(mni_render *r, const mn_front *front, mn_status *st) {
    mni_surface *m = &r->mirror;
    r->front_colors = m->color != NULL && front->color != NULL;
    mni_surface_update(m, front);
    wait_for_drawing(r);
    send_new(r, VERTICES, m->vertex_new, m->node_high, m->vertex);
    send_new(r, NORMALS, m->normal_new, m->node_high, m->normal);
    if (m->color != NULL)
        send_new(r, COLORS, m->vertex_new, m->node_high, m->color);
    send_new(r, INDICES, m->index_new, m->simplex_high, m->index);
    mni_surface_sent(m);
    r->stats.fronts++;
    return gl_status("handing over the front", st);
}

/* ---- drawing -------------------------------------------------------------------------------- */

/* b - a, in units of the model. */
static void between(const mni_render *r, const float a[3], const float b[3], vec3 out) {
    for (int i = 0; i < 3; i++)
        out[i] = (b[i] - a[i]) * r->unit;
}

/* Rows: right, up, back. An up along the view is replaced by an axis that is not. */
static void view_of(const mni_render *r, const mn_camera *camera, mat3 view) {
    vec3 up, forward, right;
    glm_vec3_copy((float *)camera->up, up);
    between(r, camera->eye, camera->target, forward);
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

/* The smallest and largest distance along the view at which the model's box can be seen, in units.
 */
static void planes_of(const mni_render *r, const mn_camera *camera, mat3 view, float *near,
                      float *far) {
    vec3 to_min, to_max;
    float outside2 = 0;
    between(r, camera->eye, r->box_min, to_min);
    between(r, camera->eye, r->box_max, to_max);
    for (int i = 0; i < 3; i++) {
        const float d = fmaxf(fmaxf(to_min[i], -to_max[i]), 0);
        outside2 += d * d;
    }
    *far = 0;
    for (int corner = 0; corner < 8; corner++) {
        float z = 0;
        for (int i = 0; i < 3; i++)
            z -= view[i][2] * (corner >> i & 1 ? to_max[i] : to_min[i]);
        *far = fmaxf(*far, z);
    }
    /* The box's distance is along any direction; in the corner of a picture 60 degrees off its
     * axis the same point is half as far along the view. */
    const float closest = r->reversed_depth ? 1e-6f : 5e-4f;
    *near = fmaxf(0.4f * sqrtf(outside2), closest * (float)(r->radius * (double)r->unit));
    *far = fmaxf(1.01f * *far, 2 * *near);
}

static void use(const mni_render *r, const program *p, const mn_camera *camera,
                const mn_gl_look *look) {
    mat3 view;
    float near, far;
    view_of(r, camera, view);
    planes_of(r, camera, view, &near, &far);
    const float sy = 1 / tanf(0.5f * glm_rad(camera->fov_y_deg));
    glUseProgram(p->name);
    glUniform3fv(p->eye, 1, camera->eye);
    glUniform1f(p->unit, r->unit);
    glUniformMatrix3fv(p->view, 1, GL_FALSE, view[0]);
    glUniform2f(p->scale, sy * (float)r->height / (float)r->width, sy);
    glUniform1f(p->px_scale, 0.5f * sy * (float)r->height);
    if (r->reversed_depth)
        glUniform2f(p->depth, 0, near);
    else
        glUniform2f(p->depth, -(far + near) / (far - near), -2 * far * near / (far - near));
    glUniform1f(p->inv_radius, (float)(1 / r->radius));
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
    if (r->mirror.triangles > 0) {
        glEnable(GL_DEPTH_TEST);
        use(r, look->wireframe ? &r->wire : &r->surface, camera, look);
        glBindVertexArray(r->surface_array);
        glDrawElements(GL_TRIANGLES, (GLsizei)(3 * r->mirror.simplex_high), GL_UNSIGNED_INT, NULL);
        if (r->uploads == UPLOAD_MAPPED) {
            glDeleteSync(r->drawn_at);
            r->drawn_at = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
        }
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

void mni_render_stats(const mni_render *r, mn_gl_stats *out) {
    *out = r->stats;
}

const char *mni_render_driver(const mni_render *r) {
    return r->driver;
}
