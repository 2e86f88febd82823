/* Whether a collapse may be made, by the stage's rules (design.md §3.2).
 *
 * The ring of r is its neighbours, each with what is known of the edge that leads there:
 *
 *        n2 ──── n1          triangles: at the edge r–n;  balance: +1 for each triangle that runs
 *       ╱  ╲    ╱  ╲                    r → n, −1 for each that runs n → r
 *      n3 ── r ── k          apexes:    triangles (r, k, n)
 *                            group:     ring vertices joined by triangles of r share one
 *
 * An edge is singular if it has not exactly two triangles, or if these are not oppositely directed,
 * or if it is a hinge. Most vertices have neither such an edge nor more than MNI_WHEEL_MAX
 * triangles: their ring is a wheel that goes once round, and all is asked of a few registers:
 *
 *        2 ─── 1          around[0] is k; its apexes are 1 and the last, and k may have no other
 *       ╱ ╲  ╱  ╲         neighbour here
 *      3 ── r ── 0 = k
 *
 * Nothing here changes the surface but that dead simplices leave its lists.
 * One thread. Memory: 8 bytes a vertex, 12 a triangle, and the largest ring met. */
#ifndef MNI_LEGAL_H
#define MNI_LEGAL_H

#include "surface.h"

typedef struct mni_ring_vertex {
    uint32_t triangles, hinges, apexes;
    int32_t balance;
    uint32_t group;
} mni_ring_vertex;

/* Three hubs, by number: the triangle that holds them; MN_NONE: none did when the surface had come
 * to so many trios. */
typedef struct mni_trio {
    uint32_t v[3], triangle;
    uint64_t trios;
} mni_trio;

enum { MNI_TRIOS = 64 };

typedef struct mni_judge {
    float *normal; /* 3 × triangles: unit normals of the input; 0 for zero area */
    /* The ring looked at last. */
    uint32_t *around; /* its vertices */
    uint32_t ring_count, ring_room;
    bool round;        /* triangles once round, k first: wheel, spoke, and no ring[] */
    mni_wheel wheel;   /* of the vertex looked at last that has one */
    uint32_t wheel_of; /* which it is; MN_NONE: none, or the surface has changed since */
    mni_wheel kept;    /* and of who was asked about last as the one that stays, likewise */
    uint32_t kept_of;
    uint32_t spoke[MNI_WHEEL_MAX]; /* in the wheel, the triangle between around[i] and the next */
    mni_ring_vertex *ring;
    uint64_t *seen; /* a vertex: epoch << 32 | index in ring */
    uint32_t epoch;
    mni_trio trio[MNI_TRIOS]; /* hashed; the last that was asked about stays */
    bool stuck;               /* after mni_judge_link said no: r may go nowhere, whatever k is */
    bool no_memory;           /* sticky: the answers are worthless */
} mni_judge;

/* For a surface of which nothing has been collapsed. */
mn_code mni_judge_open(mni_judge *judge, const mni_surface *surface, mn_status *st);
/* Or in two steps, of which the second may be the caller's: normal[]. */
mn_code mni_judge_room(mni_judge *judge, uint32_t vertices, uint32_t triangles, mn_status *st);
void mni_judge_fill(mni_judge *judge, const mni_surface *surface);
void mni_judge_close(mni_judge *judge);

/* Sees to it that judge->wheel is v's, which mostly it is. False: v has none. */
bool mni_judge_wheel(mni_judge *judge, mni_surface *surface, uint32_t v);
/* Whoever collapses something says so. */
static inline void mni_judge_forget(mni_judge *judge) {
    judge->wheel_of = judge->kept_of = MN_NONE;
}
/* Fills judge->around and judge->ring with the neighbours of v. */
void mni_judge_ring(mni_judge *judge, mni_surface *surface, uint32_t v);
/* Fills judge->around with the neighbours of r, and what else is cheapest: see judge->round. */
void mni_judge_look(mni_judge *judge, mni_surface *surface, uint32_t r, uint32_t k);
/* Whether v's triangles go once round it: it is not singular, nor is an edge at it. Looks. */
bool mni_judge_regular(mni_judge *judge, mni_surface *surface, uint32_t v);
bool mni_ring_vertex_singular(const mni_ring_vertex *n);

/* Link condition and singular vertices: the rule of stages 1 and 2. Looks. */
bool mni_judge_link(mni_judge *judge, mni_surface *surface, uint32_t r, uint32_t k);
/* No triangle folds over, against what it was and against what it was in the input. After a look at
 * r and k. */
bool mni_judge_fold(const mni_judge *judge, mni_surface *surface, uint32_t r, uint32_t k);

#endif
