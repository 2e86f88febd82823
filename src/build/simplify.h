/* What the files of the simplifier share: the run's state. One thread owns it all. */
#ifndef MNI_SIMPLIFY_H
#define MNI_SIMPLIFY_H

#include "heap.h"
#include "hub.h"
#include "legal.h"
#include "node_bounds.h"
#include "surface.h"
#include "witness.h"

static inline double mni_quadric_at(const mni_vertex *q, const double d[3]) {
    double x = d[0], y = d[1], z = d[2];
    double value =
        q->xx * x * x + q->yy * y * y + q->zz * z * z +
        2 * (q->xy * x * y + q->xz * x * z + q->yz * y * z + q->x * x + q->y * y + q->z * z) + q->c;
    return value > 0 ? value : 0;
}

static inline void mni_way(const mni_vertex *from, const mni_vertex *to, double d[3]) {
    for (int i = 0; i < 3; i++)
        d[i] = (double)to->p[i] - from->p[i];
}

/* The quadric of `from` to that of `to`. */
static inline void mni_quadric_add(mni_vertex *to, const mni_vertex *from) {
    double d[3];
    mni_way(from, to, d);
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

/* Enough for shallow trees in flat parts (fandisk: depth 26, without it 801), too little to be seen
 * in the distance to the original. */
#define MNI_LENGTH_SHARE 1e-9

/* By which squared distances are weighted in the quadrics of both. */
static inline double mni_collapse_weight(const mni_vertex *r, const mni_vertex *k) {
    return (r->xx + r->yy + r->zz) + (k->xx + k->yy + k->zz);
}

/* Of r → k. length: the edge's squared length. qem: both quadrics at k, and a share of the squared
 * length, weighted as the quadrics are: in flat parts, where every collapse is free, it keeps short
 * edges first and trees shallow. When k's quadric grows the cost does not fall, not even by
 * rounding. */
static inline float mni_collapse_cost(const mni_vertex *r, const mni_vertex *k, mn_metric metric) {
    double d[3];
    mni_way(r, k, d);
    double length2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    if (metric != MN_METRIC_QEM)
        return (float)length2;
    double share = MNI_LENGTH_SHARE * mni_collapse_weight(r, k);
    return (float)(mni_quadric_at(r, d) + k->c + share * length2);
}

/* The keys of some of r's candidates. By qem. Behind the last of kept[] comes a row of any
 * vertices, and key[] has room for one. */
enum { MNI_KEYS_ROW = 8, MNI_KEYS_MAX = 2 * MNI_WHEEL_MAX + MNI_KEYS_ROW };
typedef void mni_collapse_keys(const mni_vertex *vertex, uint32_t r, const uint32_t *kept,
                               uint32_t count, mni_heap_key *key);
/* quadric.c: the same bits, as wide as this machine can, and as all can. */
mni_collapse_keys *mni_collapse_keys_best(void);
mni_collapse_keys mni_collapse_keys_narrow;

/* Collapses as they were made: r, which went into k, is the right child. Nodes are numbered as they
 * come: those that vertices began with, then a collapse each. */
typedef struct mni_collapses {
    uint32_t *left, *right;
    float *value; /* of a node, from when it becomes a child on */
    float *key;   /* where it belongs in the order of all; NULL: where it stands */
    uint32_t count;
} mni_collapses;

/* How much out of order collapses may come (wait.h). */
enum { MNI_LEVELS = 13 };

/* What is known of a part only of the surface, at the edge of which it must not be changed. */
typedef struct mni_part {
    /* A vertex: no collapse with it from this key on. 0: its ring is not all here. Where a collapse
     * is put off, both its ends close at its key: so nothing goes before a cheaper one beside it.
     */
    mni_heap_key *closed;
    float *ring;  /* a vertex: all of its ring is closed from this cost on; INFINITY: it is not */
    float *key;   /* a vertex's node's: the largest cost of the collapses that it has waited for */
    double slack; /* by which factor a collapse may cost more than one beside it that is put off */
    bool rings;   /* what is put off makes the rings of its ends wait as well */
    bool carries; /* frozen hubs take what there is for them here */
    uint32_t
        could_go[MNI_LEVELS]; /* vertices that went or could have, by the least level (wait.h) */
    uint32_t *id;             /* the vertices' numbers; NULL: as they are here */
} mni_part;

enum { MNI_PROGRAM_BYTES = 7 << 19 }; /* code, libraries, stack, buffers */

/* Asked every 50 ms or so; false: the work is to stop. */
typedef struct mni_poll {
    bool (*go_on)(void *context); /* NULL: nobody asks */
    void *context;
} mni_poll;

/* The next candidates of a vertex of many neighbours, from one look at all of them: of which each
 * that is refused makes it ask for the one after. */
enum { MNI_NEXT_MAX = 64, MNI_NEXTS = 16 };
typedef struct mni_next {
    uint32_t vertex, at, count;
    mni_heap_key key[MNI_NEXT_MAX]; /* rising; nothing is between them */
} mni_next;

/* What the vertex looked at last has for candidates: its wheel's vertices, each once, as keys, and
 * a row of MNI_HEAP_KEY_NONE. Stands until something collapses. */
typedef struct mni_look {
    uint32_t vertex, count; /* MN_NONE: nobody's */
    mni_heap_key key[MNI_KEYS_MAX];
} mni_look;

typedef struct mni_simplifier {
    const mn_mesh *mesh;
    mn_simplify_desc desc;
    mni_surface surface;
    mni_judge judge;
    mni_witness_book witness;
    mni_heap heap;
    mni_hubs hubs;
    mni_look look;
    mni_collapse_keys *keys;
    mni_next next[MNI_NEXTS]; /* by vertex, hashed; since these were offered afresh */
    mni_collapses made;
    mni_part part;
    mni_node_bounds *leaf_bounds; /* the input's vertices */
    mn_build_counts counts;
    uint32_t legal_last;
    int stage; /* 1 … 4 */
    bool stopped;
    mni_poll poll;
    double polled_s;
    uint64_t turns; /* what came to the heap's top */
    mn_status *st;
} mni_simplifier;

/* quadric.c: one for each vertex, of its triangles. */
void mni_quadrics_fill(mni_surface *surface);
/* Adds the wall on the boundary edge v–w to the quadric of v. */
void mni_quadric_wall(mni_surface *surface, uint32_t v, uint32_t w);
/* Adds the plane of a triangle to that of v. */
void mni_quadric_add_triangle(mni_surface *surface, uint32_t v, uint32_t t);

/* What simplifying all at once takes at most (need_simplify.c). The peak is where the simplifier's
 * arrays, the mesh and the tree made of them are all there;
 * blocking takes less. Resident bytes of whole builds were 0.67 to 0.98 of this (scans, terrain of
 * a million triangles, lone triangles and tetrahedra). */
uint64_t mni_whole_bytes(uint64_t vertices, uint64_t triangles);
/* Beside rounds: the mesh, what it takes to write it out, and its numbers. */
uint64_t mni_rounds_beside_bytes(uint64_t vertices, uint64_t triangles);
/* Arrays for what is made of that many vertices; close frees them, and the surface, the judge, the
 * witnesses. MN_FAILED: memory. */
mn_code mni_simplify_room(mni_simplifier *s, uint32_t vertices);
void mni_simplify_close(mni_simplifier *s);
/* Quadrics of leaves, with walls at boundaries, and the counts of edges: in a part, those whose
 * lesser end has a node. */
void mni_simplify_look(mni_simplifier *s);
/* A stage, 1 … 3, until nothing more can be done. */
mn_code mni_simplify_stage(mni_simplifier *s, int stage);
/* Of a part: counts what waits though all of its ring is here, by the least level (wait.h). */
void mni_simplify_count_waiting(mni_simplifier *s);
/* The values of nodes that are no children. */
void mni_simplify_settle(mni_simplifier *s);
/* Records the collapse of r into k in the tree: the surface has been changed. MN_FAILED: memory. */
mn_code mni_simplify_record(mni_simplifier *s, uint32_t r, uint32_t k, float cost);
/* roots.c, stage 4: virtual edges between nearest roots, shortest first, until so many are left. */
mn_code mni_simplify_roots(mni_simplifier *s, uint32_t least);
/* tree_make.c: the run's collapses as a tree, leaves renumbered. */
mn_code mni_tree_make(mni_simplifier *s, mn_tree *out);

#endif
