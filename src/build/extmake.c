/* A mesh in memory, written as mni_extmesh_read would leave it: vertices along a curve, triangles
 * by their smallest vertex. Hidden here: nothing but the sorting. One thread; memory: 20 bytes a
 * vertex and 8 a triangle, given back. Paper: none. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "curve.h"
#include "exttriangles.h"

typedef struct place {
    uint64_t key;
    uint32_t vertex;
} place;

static int by_place(const void *a, const void *b) {
    const place *x = a, *y = b;
    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    return x->vertex < y->vertex ? -1 : x->vertex > y->vertex;
}

static int by_value(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

static mni_curve curve_of(const mn_mesh *m) {
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t i = 0; i < 3 * (size_t)m->vertices; i++) {
        low[i % 3] = fminf(low[i % 3], m->position[i]);
        high[i % 3] = fmaxf(high[i % 3], m->position[i]);
    }
    return mni_curve_make(low, high, 0);
}

static void write_vertices(const mn_mesh *m, place *order, uint32_t *vertex_of, uint32_t *id_of,
                           mni_spill_writer *w) {
    mni_curve curve = curve_of(m);
    for (uint32_t v = 0; v < m->vertices; v++)
        order[v] = (place){mni_curve_key(&curve, &m->position[3 * (size_t)v]), v};
    qsort(order, m->vertices, sizeof *order, by_place);
    for (uint32_t id = 0; id < m->vertices; id++) {
        uint32_t v = order[id].vertex;
        const float *p = &m->position[3 * (size_t)v];
        mni_extvertex to = {.position = {p[0], p[1], p[2]},
                            .rgba = m->color != NULL ? m->color[v] : UINT32_MAX};
        mni_spill_put(w, &to, sizeof to);
        vertex_of[id] = v;
        id_of[v] = id;
    }
    mni_spill_end(w);
}

static void write_triangles(const mn_mesh *m, uint64_t *order, const uint32_t *id_of,
                            mni_spill_writer *w) {
    for (uint32_t t = 0; t < m->triangles; t++) {
        uint32_t least = UINT32_MAX;
        for (int c = 0; c < 3; c++) {
            uint32_t id = id_of[m->corner[3 * (size_t)t + (size_t)c]];
            least = id < least ? id : least;
        }
        order[t] = (uint64_t)least << 32 | t;
    }
    qsort(order, m->triangles, sizeof *order, by_value);
    for (uint32_t i = 0, last = 0; i < m->triangles; i++) {
        const uint32_t *c = &m->corner[3 * (size_t)(uint32_t)order[i]];
        mni_exttriangle to = mni_exttriangle_turned(id_of[c[0]], id_of[c[1]], id_of[c[2]]);
        mni_exttriangle_put(w, &to, &last);
    }
    mni_spill_end(w);
}

mn_code mni_extmesh_make(const mn_mesh *m, const char *temp_dir, uint32_t *vertex_of,
                         mni_extmesh *out, mn_status *st) {
    enum { BUFFER_BYTES = 1 << 18 };
    *out = (mni_extmesh){.vertex.fd = -1,
                         .triangle.fd = -1,
                         .vertices = m->vertices,
                         .triangles = m->triangles,
                         .origin = {m->origin[0], m->origin[1], m->origin[2]},
                         .has_colors = m->color != NULL,
                         .grid_step = m->grid_step,
                         .intake = m->intake};
    mn_code code = mni_spill_open(&out->vertex, temp_dir, st);
    if (code == MN_OK)
        code = mni_spill_open(&out->triangle, temp_dir, st);
    uint32_t *id_of = malloc((size_t)m->vertices * sizeof *id_of);
    place *order = malloc((size_t)m->vertices * sizeof *order);
    uint64_t *triangle_order = malloc((size_t)m->triangles * sizeof *triangle_order);
    unsigned char *buffer = malloc(BUFFER_BYTES);
    if (code == MN_OK &&
        (id_of == NULL || order == NULL || triangle_order == NULL || buffer == NULL))
        code = mn_fail(st, MN_FAILED, "out of memory for %u vertices", m->vertices);
    if (code == MN_OK) {
        mni_spill_writer w;
        mni_spill_writer_open(&w, &out->vertex, buffer, BUFFER_BYTES);
        write_vertices(m, order, vertex_of, id_of, &w);
        mni_spill_writer_open(&w, &out->triangle, buffer, BUFFER_BYTES);
        write_triangles(m, triangle_order, id_of, &w);
        const mni_spill *bad = out->vertex.trouble.code != MN_OK ? &out->vertex : &out->triangle;
        if (bad->trouble.code != MN_OK)
            code = mn_fail(st, bad->trouble.code, "%s", bad->trouble.text);
    }
    free(id_of);
    free(order);
    free(triangle_order);
    free(buffer);
    if (code != MN_OK)
        mni_extmesh_close(out);
    return code;
}
