/* The mesh that is being simplified: flat arrays of vertices, simplices and incidence.
 *
 * Half-edge meshes cannot hold what may come here (edges with three or more triangles, vertices
 * joined by nothing but an edge, lone triangles), so there are no half-edges: a simplex is a
 * triangle or a hinge (an edge without apex, v[2] = MN_NONE), a vertex has a list of its simplices.
 * Lists are cleaned of dead simplices whenever they are walked.
 *
 *   fan[v] ──► pool[first … first+count)  simplex numbers, dead ones among them
 *   pool:  | v0's room | v1's room | …                 | free |
 *
 * A list that outgrows its room moves to the pool's free end; when that is used up the pool is
 * packed afresh. Order of calls: open, then collapse as one likes, close. One thread. */
#ifndef MNI_SURFACE_H
#define MNI_SURFACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "metanode/build.h"

typedef struct mni_simplex {
    uint32_t v[3];   /* current vertices; a hinge's third is MN_NONE */
    uint32_t killed; /* the collapse that made it degenerate; MN_NONE: alive */
} mni_simplex;

/* v's corner of a triangle, and the other two in its direction. No branch: which corner it is
 * cannot be predicted. */
typedef struct mni_corner {
    uint32_t at, next, previous;
} mni_corner;

static inline mni_corner mni_simplex_corner(const mni_simplex *x, uint32_t v) {
    uint32_t at = (x->v[1] == v) + 2u * (x->v[2] == v);
    return (mni_corner){at, x->v[9u >> 2 * at & 3], x->v[18u >> 2 * at & 3]}; /* 1 2 0, 2 0 1 */
}

typedef struct mni_fan {
    uint32_t first, count, room; /* in the pool */
} mni_fan;

typedef struct mni_surface {
    const float *position; /* 3 × vertices, of the mesh */
    uint32_t vertices, triangles;
    uint32_t simplices, simplices_room;
    uint32_t alive_triangles, alive_hinges;
    mni_simplex *simplex; /* triangles in the input's order, then hinges as they come */
    uint32_t *origin;     /* 3 × simplices: the input's vertices */
    mni_fan *fan;
    uint32_t *pool;
    size_t pool_used, pool_room;
    uint32_t *dead; /* scratch of one collapse: the triangles that died */
    uint32_t dead_room;
} mni_surface;

mn_code mni_surface_open(mni_surface *surface, const mn_mesh *mesh, mn_status *st);
void mni_surface_close(mni_surface *surface);

/* Alive simplices of v: drops the dead ones from its list and returns it. Valid until the next
 * collapse. */
const uint32_t *mni_surface_fan(mni_surface *surface, uint32_t v, uint32_t *count);
/* Whether an alive simplex holds both. Walks the shorter list. */
bool mni_surface_joined(mni_surface *surface, uint32_t a, uint32_t b);

/* Moves every simplex of r to k; those that hold both die with the mark `collapse`, and hinges take
 * their place where nothing else joins k to an apex. False: no memory. */
bool mni_surface_collapse(mni_surface *surface, uint32_t r, uint32_t k, uint32_t collapse);

#endif
