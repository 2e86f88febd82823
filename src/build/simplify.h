/* What the files of the simplifier share: the run's state. One thread owns it all. */
#ifndef MNI_SIMPLIFY_H
#define MNI_SIMPLIFY_H

#include "heap.h"
#include "legal.h"
#include "surface.h"
#include "witness.h"

/* dᵀAd + 2bᵀd + c, A symmetric: squared distance × area, with d relative to the vertex whose
 * quadric it is. Absolute positions would lose the digits in which a flat part's costs differ. */
typedef struct mni_quadric {
    double xx, xy, xz, yy, yz, zz, x, y, z, c;
} mni_quadric;

static inline double mni_quadric_at(const mni_quadric *q, const double d[3]) {
    double x = d[0], y = d[1], z = d[2];
    double value =
        q->xx * x * x + q->yy * y * y + q->zz * z * z +
        2 * (q->xy * x * y + q->xz * x * z + q->yz * y * z + q->x * x + q->y * y + q->z * z) + q->c;
    return value > 0 ? value : 0;
}

/* d: from the vertex of `from` to that of `to`. */
static inline void mni_quadric_add(mni_quadric *to, const mni_quadric *from, const double d[3]) {
    to->c += mni_quadric_at(from, d);
    to->x += from->x + from->xx * d[0] + from->xy * d[1] + from->xz * d[2];
    to->y += from->y + from->xy * d[0] + from->yy * d[1] + from->yz * d[2];
    to->z += from->z + from->xz * d[0] + from->yz * d[1] + from->zz * d[2];
    to->xx += from->xx;
    to->xy += from->xy;
    to->xz += from->xz;
    to->yy += from->yy;
    to->yz += from->yz;
    to->zz += from->zz;
}

static inline void mni_way(const mn_mesh *mesh, uint32_t from, uint32_t to, double d[3]) {
    for (int i = 0; i < 3; i++)
        d[i] = (double)mesh->position[3 * (size_t)to + i] - mesh->position[3 * (size_t)from + i];
}

/* Enough for shallow trees in flat parts (fandisk: depth 26, without it 801), too little to be seen
 * in the distance to the original. */
#define MNI_LENGTH_SHARE 1e-9

/* Of r → k. length (no quadrics): the edge's squared length. qem: both quadrics at k, and a share
 * of the squared length, weighted as the quadrics are: in flat parts, where every collapse is free,
 * it keeps short edges first and trees shallow. When k's quadric grows the cost does not fall, not
 * even by rounding. */
static inline float mni_collapse_cost(const mn_mesh *mesh, const mni_quadric *quadric, uint32_t r,
                                      uint32_t k) {
    double d[3];
    mni_way(mesh, r, k, d);
    double length2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    if (quadric == NULL)
        return (float)length2;
    const mni_quadric *a = &quadric[r], *b = &quadric[k];
    double weight = (a->xx + a->yy + a->zz) + (b->xx + b->yy + b->zz);
    return (float)(mni_quadric_at(a, d) + b->c + MNI_LENGTH_SHARE * weight * length2);
}

/* Collapses as they were made, in input vertices: r went into k. */
typedef struct mni_collapses {
    uint32_t *left, *right; /* nodes: input vertex, or vertices + collapse */
    float *switch_value;
    uint32_t count;
} mni_collapses;

typedef struct mni_simplifier {
    const mn_mesh *mesh;
    mn_simplify_desc desc;
    mni_surface surface;
    mni_judge judge;
    mni_witness_book witness;
    mni_heap heap;
    mni_quadric *quadric; /* qem only */
    uint32_t *node;       /* a vertex: its current node; MN_NONE: collapsed into another */
    mni_heap_key *floor;  /* a vertex: no candidate of it is below this, tried ones included */
    bool *stale;          /* a vertex: its key in the heap is only a lower bound */
    mni_collapses made;
    mn_build_counts counts;
    uint32_t legal_last;
    int stage; /* 1 … 4 */
    bool stopped;
    mn_status *st;
} mni_simplifier;

/* quadric.c: one for each vertex, of its triangles. */
void mni_quadrics_fill(mni_quadric *quadric, const mn_mesh *mesh);
/* Adds the wall on the boundary edge v–w to the quadrics of its ends. */
void mni_quadric_wall(mni_quadric *quadric, const mn_mesh *mesh, mni_surface *surface, uint32_t v,
                      uint32_t w);

/* Records the collapse of r into k in the tree: the surface has been changed. MN_FAILED: memory. */
mn_code mni_simplify_record(mni_simplifier *s, uint32_t r, uint32_t k);
/* roots.c, stage 4: virtual edges between nearest roots, shortest first, until one is left. */
mn_code mni_simplify_roots(mni_simplifier *s);
/* tree_make.c: the run's collapses as a tree, leaves renumbered. */
mn_code mni_tree_make(mni_simplifier *s, mn_tree *out);

#endif
