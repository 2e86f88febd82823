/* The mesh that is being simplified: flat arrays of vertices, simplices and incidence.
 *
 * Half-edge meshes cannot hold what may come here (edges with three or more triangles, vertices
 * joined by nothing but an edge, lone triangles), so there are no half-edges: a simplex is a
 * triangle or a hinge (an edge without apex, v[2] = MN_NONE), a vertex has a list of its simplices.
 * Lists are cleaned of dead simplices whenever they are walked.
 *
 *   vertex[v].fan ──► pool[first … first+count)  simplex numbers, dead ones among them
 *   pool:  | v0's room | v1's room | …                 | free |
 *
 * A list that outgrows its room moves to the pool's free end; when that is used up the pool is
 * packed afresh. Order of calls: open (or room and index), then collapse as one likes, close. One
 * thread. Memory: 128 bytes a vertex, 52 a triangle, as much as the pool again while it is packed;
 * hinges come on top.
 */
#ifndef MNI_SURFACE_H
#define MNI_SURFACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined(__x86_64__)
#include <emmintrin.h>
#endif

#include "heap.h"
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

/* All that is known of a vertex. A collapse is bound by the lines of the cache that it meets, and
 * meets whole neighbourhoods: so what is asked of a neighbour lies in one line, and the rest of
 * what its own candidates need in the next.
 *
 * The quadric is dᵀAd + 2bᵀd + c, A symmetric: squared distance × area, with d relative to the
 * vertex. Absolute positions would lose the digits in which a flat part's costs differ. */
typedef struct mni_vertex {
    float p[3];           /* the mesh's */
    float value;          /* its node's switch value, which may still rise (witness.c) */
    double c, xx, yy, zz; /* of the quadric (quadric.c) */
    mni_heap_key floor;   /* no candidate of it is below this, tried ones included */
    uint32_t set;         /* its node's witnesses; MN_NONE: a leaf still (witness.c) */
    uint32_t node;        /* its current node; MN_NONE: collapsed into another */
    double xy, xz, yz;    /* the second line */
    double x, y, z;       /* b */
    mni_fan fan;          /* its simplices */
    bool stale;           /* its key in the heap is only a lower bound */
    bool tried;           /* it is not in the heap, or its key there is above the floor */
    bool measured;        /* its key in the heap is its least, with what was measured */
    bool hub;             /* see hub.h */
} mni_vertex;

typedef struct mni_surface {
    mni_vertex *vertex;
    uint32_t vertices, triangles;
    uint32_t simplices, simplices_room;
    uint32_t alive_triangles, alive_hinges;
    mni_simplex *simplex; /* triangles in the input's order, then hinges as they come */
    uint32_t *origin;     /* 3 × simplices: the input's vertices */
    bool is_part;         /* these are not numbers of vertices here */
    uint32_t *pool;
    size_t pool_used, pool_room;
    uint32_t *dead; /* scratch of one collapse: the triangles that died */
    uint32_t dead_room;
    uint64_t walked; /* entries of long lists, a walk each: what hubs cost */
    uint64_t trios;  /* rises whenever three hubs may have come to be a simplex's corners */
} mni_surface;

/* Leaves alone, and their triangles. */
mn_code mni_surface_open(mni_surface *surface, const mn_mesh *mesh, mn_status *st);
/* Or any state of a surface: room for so many, which the caller fills, vertex[0 … vertices) but for
 * the lists, simplex and origin, triangles first, in the order of the input; then index. */
mn_code mni_surface_room(mni_surface *surface, uint32_t vertices, uint32_t triangles,
                         uint32_t hinges, mn_status *st);
void mni_surface_index(mni_surface *surface);
void mni_surface_close(mni_surface *surface);

/* Alive simplices of v: drops the dead ones from its list and returns it. Valid until the next
 * collapse. */
const uint32_t *mni_surface_fan(mni_surface *surface, uint32_t v, uint32_t *count);
/* Whether an alive simplex holds both. Walks the shorter list. */
bool mni_surface_joined(mni_surface *surface, uint32_t a, uint32_t b);
/* Whether one that does not hold `but` does. Walks a's list until it comes to one. */
bool mni_surface_joined_beside(mni_surface *surface, uint32_t a, uint32_t b, uint32_t but);

enum { MNI_WHEEL_MAX = 16 };

/* A short list without hinges, as most are, with the corners it leads to: read once, asked about
 * many times. In the list's order. */
typedef struct mni_wheel {
    uint32_t count;
    uint32_t simplex[MNI_WHEEL_MAX];
    uint32_t next[MNI_WHEEL_MAX], previous[MNI_WHEEL_MAX]; /* MN_NONE behind the last */
} mni_wheel;

/* v's list as a wheel; drops the dead ones. False: it is longer, or holds a hinge. */
bool mni_surface_wheel(mni_surface *surface, uint32_t v, mni_wheel *wheel);

/* Four numbers side by side, which every machine that there is has registers for. */
typedef uint32_t mni_four __attribute__((vector_size(16)));

/* Which of four lanes are all ones, as bits. */
static inline uint32_t mni_four_bits(const mni_four *lanes) {
#if defined(__x86_64__)
    return (uint32_t)_mm_movemask_ps((__m128)*lanes);
#else
    const mni_four bit = *lanes & (mni_four){1, 2, 4, 8};
    const mni_four pair = bit | __builtin_shufflevector(bit, bit, 2, 3, 0, 1);
    return pair[0] | pair[1];
#endif
}

/* Where v is first in such a list of a wheel; MNI_WHEEL_MAX: nowhere. */
static inline uint32_t mni_wheel_find(const uint32_t *list, uint32_t count, uint32_t v) {
    mni_four at[4];
    memcpy(at, list, sizeof at);
    mni_four a = (mni_four)(at[0] == v), b = (mni_four)(at[1] == v);
    uint32_t found = mni_four_bits(&a) | mni_four_bits(&b) << 4;
    if (count > 8) {
        mni_four c = (mni_four)(at[2] == v), d = (mni_four)(at[3] == v);
        found |= mni_four_bits(&c) << 8 | mni_four_bits(&d) << 12;
    }
    return (uint32_t)__builtin_ctz(found | 1u << MNI_WHEEL_MAX);
}

/* Which of previous[] are in no triangle the next one, as bits: at boundaries alone there are any.
 */
static inline uint32_t mni_wheel_ends(const mni_wheel *w) {
    mni_four previous[4], in[4] = {0};
    memcpy(previous, w->previous, sizeof previous);
    for (uint32_t i = 0; i < w->count; i++) {
        in[0] |= (mni_four)(previous[0] == w->next[i]);
        in[1] |= (mni_four)(previous[1] == w->next[i]);
    }
    for (uint32_t i = 0; i < w->count && w->count > 8; i++) {
        in[2] |= (mni_four)(previous[2] == w->next[i]);
        in[3] |= (mni_four)(previous[3] == w->next[i]);
    }
    uint32_t found = mni_four_bits(&in[0]) | mni_four_bits(&in[1]) << 4 |
                     mni_four_bits(&in[2]) << 8 | mni_four_bits(&in[3]) << 12;
    return ~found & ((1u << w->count) - 1);
}

/* Nothing but haste: what will be asked about v soon is fetched meanwhile. Each wants the one
 * before to have arrived. */
static inline void mni_surface_fetch_vertex(const mni_surface *surface, uint32_t v) {
    __builtin_prefetch(&surface->vertex[v]);
    __builtin_prefetch(&surface->vertex[v].xy);
}
static inline void mni_surface_fetch_list(const mni_surface *surface, uint32_t v) {
    const mni_fan *f = &surface->vertex[v].fan;
    __builtin_prefetch(&surface->pool[f->first]);
    __builtin_prefetch(&surface->pool[f->first + f->count]);
}
static inline void mni_surface_fetch_simplices(const mni_surface *surface, uint32_t v) {
    const mni_fan *f = &surface->vertex[v].fan;
    for (uint32_t i = 0; i < f->count && i < MNI_WHEEL_MAX; i++)
        __builtin_prefetch(&surface->simplex[surface->pool[f->first + i]]);
}
static inline void mni_surface_fetch_neighbours(const mni_surface *surface, uint32_t v) {
    const mni_fan *f = &surface->vertex[v].fan;
    for (uint32_t i = 0; i < f->count && i < MNI_WHEEL_MAX; i++) {
        const mni_simplex *x = &surface->simplex[surface->pool[f->first + i]];
        __builtin_prefetch(&surface->vertex[mni_simplex_corner(x, v).next]);
    }
}

/* Moves every simplex of r to k; those that hold both die with the mark `collapse`, and hinges take
 * their place where nothing else joins k to an apex. False: no memory. */
bool mni_surface_collapse(mni_surface *surface, uint32_t r, uint32_t k, uint32_t collapse);
/* The same, for a wheel of r that goes once round it, through k: no hinge can come of it. */
bool mni_surface_collapse_round(mni_surface *surface, const mni_wheel *wheel, uint32_t r,
                                uint32_t k, uint32_t collapse);

#endif
