/* What the files of the simplifier share: the run's state. One thread owns it all. */
#ifndef MNI_SIMPLIFY_H
#define MNI_SIMPLIFY_H

#include "heap.h"
#include "legal.h"
#include "surface.h"
#include "witness.h"

typedef struct mni_quadric { /* vᵀAv + 2bᵀv + c, A symmetric: squared distance × area */
    double xx, xy, xz, yy, yz, zz, x, y, z, c;
} mni_quadric;

/* Value at p of the sum of two quadrics. */
static inline double mni_quadric_at(const mni_quadric *a, const mni_quadric *b, const float p[3]) {
    double x = p[0], y = p[1], z = p[2];
    double value =
        (a->xx + b->xx) * x * x + (a->yy + b->yy) * y * y + (a->zz + b->zz) * z * z +
        2 * ((a->xy + b->xy) * x * y + (a->xz + b->xz) * x * z + (a->yz + b->yz) * y * z +
             (a->x + b->x) * x + (a->y + b->y) * y + (a->z + b->z) * z) +
        a->c + b->c;
    return value > 0 ? value : 0;
}

static inline void mni_quadric_add(mni_quadric *to, const mni_quadric *from) {
    to->xx += from->xx;
    to->xy += from->xy;
    to->xz += from->xz;
    to->yy += from->yy;
    to->yz += from->yz;
    to->zz += from->zz;
    to->x += from->x;
    to->y += from->y;
    to->z += from->z;
    to->c += from->c;
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
