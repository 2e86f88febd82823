/* What goes from round to round: records of vertices and simplices, as small as may be, since each
 * is written and read once a round.
 *
 * What is lost on the way: the last 16 bits of a quadric's doubles; witnesses are rounded to a
 * 32,767th of the farthest one's distance, their slack up to 8 bits; normals to 16 bits. All of it
 * is far below the grid of positions, and the same whoever does it. No memory, any thread. */
#ifndef MNI_WIRE_H
#define MNI_WIRE_H

#include "curve.h"
#include "node_bounds.h"
#include "witness.h"

/* Where a record belongs: the key on the curve, then the vertex's id, which tells vertices in one
 * place apart, then a number, which tells simplices of one vertex apart. Sorted as one number of
 * 128 bits, the key its high half. */
typedef struct mni_wire_head {
    uint64_t key;
    uint32_t number, id;
} mni_wire_head;

static inline int mni_wire_order(const mni_wire_head *x, const mni_wire_head *y) {
    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    if (x->id != y->id)
        return x->id < y->id ? -1 : 1;
    return x->number < y->number ? -1 : x->number > y->number;
}

/* Keys that a vertex's neighbours lie between. */
typedef struct mni_wire_range {
    uint64_t low, high;
} mni_wire_range;

static const mni_wire_range mni_wire_nothing = {UINT64_MAX, 0};

static inline void mni_wire_widen(mni_wire_range *r, mni_wire_range by) {
    r->low = by.low < r->low ? by.low : r->low;
    r->high = by.high > r->high ? by.high : r->high;
}

/* How far they reach from the vertex's own key, each way, rounded outwards: exact where cells are
 * small, as they are where a model is dense. */
typedef struct mni_wire_reach {
    float below, above;
} mni_wire_reach;

mni_wire_reach mni_wire_reach_of(uint64_t key, mni_wire_range range);
static inline void mni_wire_extend(mni_wire_reach *r, mni_wire_reach by) {
    r->below = by.below > r->below ? by.below : r->below;
    r->above = by.above > r->above ? by.above : r->above;
}
/* Whether all of it lies between two keys, and on neither; equal ones may be a neighbour's. */
static inline bool mni_wire_inside(uint64_t key, mni_wire_reach r, uint64_t first, uint64_t last) {
    return (uint64_t)r.below < key - first && (uint64_t)r.above < last - key;
}

enum { MNI_WIRE_NO_WITNESS = 0xffff }; /* as a slack; those that are there come first */

typedef struct mni_wire_vertex {
    mni_wire_head at;     /* number: its node */
    mni_wire_reach reach; /* of its neighbours, as far as its last cell saw them */
    float p[3];
    float value, key; /* of its node (mni_part) */
    mni_node_bounds bounds;
    uint32_t leaves, split, levels; /* below its node; below its left child; nodes downwards */
    uint8_t quadric[10][6];         /* c, xx, yy, zz, xy, xz, yz, x, y, z */
    float scale;                    /* of witnesses */
    int16_t witness[MNI_WITNESSES][3];
    uint16_t slack[MNI_WITNESSES];
} mni_wire_vertex;
_Static_assert(sizeof(mni_wire_vertex) == 192, "no padding: what is sorted is all defined");

typedef struct mni_wire_simplex {
    mni_wire_head at;   /* of its first corner; number: its own */
    uint32_t v[3];      /* ids of vertices; a hinge's third is MN_NONE */
    uint32_t origin[3]; /* the input's */
    uint64_t place[3];  /* of v, on the curve's grid */
    int16_t normal[3];  /* of the input's triangle */
    uint16_t zero;
} mni_wire_simplex;
_Static_assert(sizeof(mni_wire_simplex) == 72, "no padding: what is sorted is all defined");

/* Somebody at a vertex's simplex who saw so far. */
typedef struct mni_wire_sight {
    mni_wire_head at; /* the vertex; number 0 */
    mni_wire_reach reach;
} mni_wire_sight;

void mni_wire_put_quadric(mni_wire_vertex *to, const mni_vertex *from);
void mni_wire_get_quadric(const mni_wire_vertex *from, mni_vertex *to);
/* p has been set. A leaf's witnesses are points with slack 0. */
void mni_wire_put_witnesses(mni_wire_vertex *to, const mni_witnesses *from);
void mni_wire_get_witnesses(const mni_wire_vertex *from, mni_witnesses *to);
void mni_wire_put_normal(mni_wire_simplex *to, const float normal[3]);
void mni_wire_get_normal(const mni_wire_simplex *from, float normal[3]);

#endif
