#include "model.h"

#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define TURN 6.283185307179586
enum { SETTLES_IN = 5000 };

uint64_t model_random(void) {
    static uint64_t state;
    if (state == 0) {
        const char *text = getenv("MN_SEED");
        state = text != NULL ? strtoull(text, NULL, 10) : 20261122;
        state = state != 0 ? state : 1;
        printf("MN_SEED=%llu\n", (unsigned long long)state);
    }
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state;
}

double model_uniform(double lo, double hi) {
    return lo + (hi - lo) * (double)(model_random() >> 11) * 0x1p-53;
}

/* ---- meshes ---------------------------------------------------------------------------------- */

static void vertex(mn_mesh *m, double x, double y, double z) {
    const double p[3] = {x, y, z};
    for (int i = 0; i < 3; i++)
        m->position[3 * (size_t)m->vertices + i] = (float)p[i];
    m->vertices++;
}

static void face(mn_mesh *m, uint32_t a, uint32_t b, uint32_t c) {
    uint32_t *corner = &m->corner[3 * (size_t)m->triangles++];
    corner[0] = a, corner[1] = b, corner[2] = c;
}

static void quad(mn_mesh *m, uint32_t a, uint32_t b, uint32_t c, uint32_t d) {
    face(m, a, b, c);
    face(m, a, c, d);
}

static double bump(double x, double y, double z) {
    return 0.05 * sin(5 * x + 1) * sin(4 * y + 2) * sin(6 * z) +
           0.01 * sin(31 * x + 17 * y + 23 * z);
}

/* Few rings, many sectors: the poles have as many neighbours as there are sectors. */
static void globe(mn_mesh *m, uint32_t triangles) {
    uint32_t rings = 6, sectors = triangles / (2 * rings);
    sectors = sectors < 3 ? 3 : sectors;
    vertex(m, 0, 1, 0);
    for (uint32_t r = 1; r <= rings; r++)
        for (uint32_t s = 0; s < sectors; s++) {
            double up = TURN / 2 * r / (rings + 1), a = TURN * s / sectors;
            double x = sin(up) * cos(a), y = cos(up), z = sin(up) * sin(a), k = 1 + bump(x, y, z);
            vertex(m, k * x, k * y, k * z);
        }
    vertex(m, 0, -1, 0);
    for (uint32_t s = 0; s < sectors; s++) {
        uint32_t t = (s + 1) % sectors, last = 1 + (rings - 1) * sectors;
        face(m, 0, 1 + t, 1 + s);
        for (uint32_t r = 0; r + 1 < rings; r++)
            quad(m, 1 + r * sectors + s, 1 + r * sectors + t, 1 + (r + 1) * sectors + t,
                 1 + (r + 1) * sectors + s);
        face(m, m->vertices - 1, last + s, last + t);
    }
}

static void torus(mn_mesh *m, uint32_t triangles) {
    uint32_t n = (uint32_t)sqrt(triangles / 4.0), big = 2 * n;
    n = n < 3 ? 3 : n;
    big = big < 6 ? 6 : big;
    for (uint32_t i = 0; i < big; i++)
        for (uint32_t j = 0; j < n; j++) {
            double a = TURN * i / big, b = TURN * j / n;
            double r = 0.4 + bump(cos(a), sin(a), b), d = 1 + r * cos(b);
            vertex(m, d * cos(a), r * sin(b), d * sin(a));
        }
    for (uint32_t i = 0; i < big; i++)
        for (uint32_t j = 0; j < n; j++) {
            uint32_t k = (i + 1) % big, l = (j + 1) % n;
            quad(m, i * n + j, i * n + l, k * n + l, k * n + j);
        }
}

static void terrain(mn_mesh *m, uint32_t triangles) {
    uint32_t n = (uint32_t)sqrt(triangles / 2.0) + 2;
    m->color = calloc((size_t)n * n, sizeof *m->color);
    ck_assert_ptr_nonnull(m->color);
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < n; j++) {
            double x = 2.0 * i / (n - 1) - 1, z = 2.0 * j / (n - 1) - 1;
            m->color[m->vertices] = 0xff000000u | (i * 255 / n) << 8 | (j * 255 / n);
            vertex(m, x, 4 * bump(x, 1, z) + 0.002 * sin(911 * x + 373 * z), z);
        }
    for (uint32_t i = 0; i + 1 < n; i++)
        for (uint32_t j = 0; j + 1 < n; j++)
            quad(m, i * n + j, i * n + j + 1, (i + 1) * n + j + 1, (i + 1) * n + j);
}

static void heap(mn_mesh *m, uint32_t triangles) {
    for (uint32_t t = 0; t < triangles; t++) {
        double at[3];
        for (int k = 0; k < 3; k++)
            at[k] = sin(12.9898 * t + 78.233 * k) * (1 + 0.3 * k);
        for (int c = 0; c < 3; c++)
            vertex(m, at[0] + 0.05 * cos(c * 2.1 + t), at[1] + 0.05 * sin(c * 2.1 + t),
                   at[2] + 0.03 * c);
        face(m, 3 * t, 3 * t + 1, 3 * t + 2);
    }
}

static void fins(mn_mesh *m, uint32_t triangles) {
    torus(m, triangles * 9 / 10);
    uint32_t body = m->triangles;
    for (uint32_t t = 0; t < body; t += 17) {
        uint32_t a = m->corner[3 * (size_t)t], b = m->corner[3 * (size_t)t + 1];
        const float *p = &m->position[3 * (size_t)a];
        face(m, a, b, m->vertices);
        vertex(m, 1.1 * p[0], p[1] + 0.1, 1.1 * p[2]);
    }
}

static void pencil(mn_mesh *m, uint32_t triangles) {
    vertex(m, 0, -1, 0);
    vertex(m, 0, 1, 0);
    for (uint32_t t = 0; t < triangles; t++) {
        double a = TURN * t / triangles, r = 0.6 + 0.4 * sin(12.9898 * t);
        vertex(m, r * cos(a), 0.5 * sin(78.233 * t), r * sin(a));
        face(m, 0, 1, m->vertices - 1);
    }
}

static void loose(mn_mesh *m, uint32_t triangles) {
    vertex(m, 0, 0, 0);
    for (uint32_t t = 0; t < triangles; t++) {
        double y = sin(78.233 * t), a = 2.399963 * t, r = 0.75 + 0.25 * sin(12.9898 * t);
        vertex(m, r * cos(a), r * y, r * sin(a));
        vertex(m, r * cos(a) + 0.01, r * y, r * sin(a) + 0.01 * sin(t));
        face(m, 0, m->vertices - 2, m->vertices - 1);
    }
}

static void pair(mn_mesh *m, uint32_t triangles) {
    vertex(m, -2, 0, 0);
    vertex(m, 2, 0, 0);
    for (uint32_t t = 0; t < triangles; t++) {
        const uint32_t at = t % 2;
        double x = at ? 2 : -2, y = sin(78.233 * t), a = 2.399963 * t;
        double r = 0.75 + 0.25 * sin(12.9898 * t);
        vertex(m, x + r * cos(a), r * y, r * sin(a));
        if (t > 0)
            vertex(m, x + r * cos(a) + 0.01, r * y, r * sin(a) + 0.01 * sin(t));
        face(m, at, t > 0 ? m->vertices - 2 : 1, m->vertices - 1);
    }
}

/* Its rim is a square: what lies on a side may go, and nothing is wrong. */
static void fan(mn_mesh *m, uint32_t triangles) {
    static const double side[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    const uint32_t each = triangles / 4;
    vertex(m, 0, 0, 0);
    for (uint32_t t = 0; t < 4 * each; t++) {
        const double *out = side[t / each], along = 2.0 * (t % each) / each - 1;
        vertex(m, out[0] - along * out[1], 0, out[1] + along * out[0]);
        face(m, 0, 1 + t, 1 + (t + 1) % (4 * each));
    }
}

static void mesh_make(mn_mesh *m, model_shape shape, uint32_t triangles) {
    static void (*const shapes[])(mn_mesh *, uint32_t) = {globe,  torus, terrain, heap, fins,
                                                          pencil, loose, pair,    fan};
    size_t room = 4 * (size_t)triangles + 1000;
    *m = (mn_mesh){0};
    m->position = calloc(room, 3 * sizeof *m->position);
    m->corner = calloc(room, 3 * sizeof *m->corner);
    ck_assert(m->position != NULL && m->corner != NULL);
    shapes[shape](m, triangles);
    ck_assert(m->vertices < room && m->triangles < room);
    m->intake.input_faces = m->triangles;
}

/* ---- models ---------------------------------------------------------------------------------- */

void model_make(model *out, model_shape shape, uint32_t triangles, const mn_block_desc *blocks) {
    static int serial;
    mn_mesh mesh;
    mn_status st = {0};
    mn_block_counts counts;
    *out = (model){.closed = shape == MODEL_GLOBE || shape == MODEL_TORUS};
    snprintf(out->path, sizeof out->path, "model.%d.%d.mnt", (int)getpid(), serial++);
    mesh_make(&mesh, shape, triangles);
    ck_assert_msg(mn_mesh_quantise(&mesh, 0, &st) == MN_OK, "%s", st.text);
    mn_code code = mn_simplify(&mesh, &(mn_simplify_desc){0}, &out->tree, &st);
    if (code == MN_OK)
        code = mn_block_write(out->path, &out->tree, blocks, &out->header, &counts, &st);
    ck_assert_msg(code == MN_OK, "%s", st.text);
    mn_mesh_free(&mesh);
}

void model_free(model *m) {
    unlink(m->path);
    mn_tree_free(&m->tree);
}

mn_session_desc model_desc(const model *m) {
    return (mn_session_desc){.path = m->path,
                             .store = MN_STORE_RESIDENT,
                             .width_px = 640,
                             .height_px = 480,
                             .closed = m->closed};
}

mn_session *model_open(const mn_session_desc *desc) {
    mn_session *session = NULL;
    mn_status st = {0};
    ck_assert_msg(mn_session_open(desc, &session, &st) == MN_OK, "%s", st.text);
    return session;
}

mn_camera model_camera(const model *m, double turn, double distance) {
    mn_camera c = {.up = {0, 1, 0}, .fov_y_deg = 45};
    double square = 0;
    for (int i = 0; i < 3; i++) {
        double half = 0.5 * ((double)m->header.box_max[i] - (double)m->header.box_min[i]);
        square += half * half;
        c.target[i] = 0.5f * (m->header.box_max[i] + m->header.box_min[i]);
    }
    double away = distance * sqrt(square);
    c.eye[0] = c.target[0] + (float)(away * sin(TURN * turn));
    c.eye[1] = c.target[1] + (float)(0.3 * away);
    c.eye[2] = c.target[2] + (float)(away * cos(TURN * turn));
    return c;
}

uint64_t model_walk(const mn_session_desc *desc, const model *m, uint64_t *hash, int cameras) {
    mn_session *s = model_open(desc);
    uint64_t adapted = 0;
    for (int i = 0; i < cameras; i++) {
        mn_camera camera = model_camera(m, 0.13 * i, 1 + 3 * fabs(sin(i)));
        mn_frame_stats stats;
        ck_assert_uint_lt(mn_session_settle(s, &camera, SETTLES_IN), SETTLES_IN);
        mn_session_check(s);
        mn_session_frame(s, &camera, &stats);
        ck_assert(!stats.changed);
        hash[i] = stats.front_hash;
        adapted += stats.active_nodes;
    }
    mn_camera last = model_camera(m, 0, 3);
    mn_session_set_tolerance(s, INFINITY);
    ck_assert_uint_lt(mn_session_settle(s, &last, SETTLES_IN), SETTLES_IN);
    ck_assert(mn_session_at_roots(s));
    mn_session_check(s);
    mn_session_close(s);
    return adapted;
}
