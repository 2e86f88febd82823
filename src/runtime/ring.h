/* The ring of neighbours around a node, and what the two moves do to records of corners. See
 * ring.c. */
#ifndef MNI_RING_H
#define MNI_RING_H

#include "front.h"

/* Corner k of simplex s is 4 s + k; its place in the arrays, 3 s + k. Simplex 0 is none. */
static inline size_t mni_corner_at(uint32_t corner) {
    return corner - corner / 4;
}
static inline uint32_t mni_corner_after(uint32_t corner) {
    return corner + 1 - 3 * (corner / 2 % 2);
}
static inline uint32_t mni_corner_before(uint32_t corner) {
    return corner + 2 - 3 * ((corner | corner / 2) % 2);
}
/* Its simplex's page; outside, simplex 1 is the first. */
static inline uint32_t mni_simplex_page(uint32_t corner) {
    return (corner - 4) / (4 * MN_FRONT_PAGE);
}
/* The slot of a corner; nobody's where there is none. */
static inline uint32_t mni_corner_slot(const mni_front *f, uint32_t corner) {
    uint32_t slot = f->simplex_node[mni_corner_at(corner)];
    return slot < f->nobody ? slot : f->nobody;
}

/* ---- lists of any length --------------------------------------------------------------------- */

/* A stretch of a node's corners: those before the first 0. */
typedef struct mni_run {
    uint32_t *corner; /* NULL: no more */
    uint32_t room, more;
} mni_run;

static inline mni_run mni_run_first(const mni_front *f, uint32_t slot) {
    mni_front_node *n = &f->node[slot];
    return (mni_run){n->corner, MNI_FRONT_CORNERS, mni_front_is_long(n) ? n->more : MN_NONE};
}

static inline mni_run mni_run_next(const mni_front *f, mni_run r) {
    if (r.more == MN_NONE)
        return (mni_run){NULL, 0, MN_NONE};
    return (mni_run){f->chunk[r.more].corner, MNI_FRONT_CHUNK, f->chunk[r.more].next};
}

/* ---- rings ----------------------------------------------------------------------------------- */

/* May the processor take the short way (mni_front.vectors)? */
bool mni_ring_has_vectors(void);

/* All of these: of nodes whose lists are no longer than the record. */
/* Bit i: ring->slot[i] must split before the slot may. The ring is looked at. */
uint32_t mni_ring_block_split(const mni_front *front, uint32_t slot, mni_ring *ring);
/* The rings around a fork's two children, and the nodes there asked for. */
void mni_ring_look(const mni_front *front, uint32_t left, uint32_t right, mni_rings *rings);
/* Of the nodes around the two, the first one whose parent's order id is below that; MN_NONE: there
 * is none. */
uint32_t mni_ring_block_collapse(const mni_front *front, const mni_rings *rings, uint32_t order);
/* Who of the ring holds the leaf; MN_NONE: nobody. */
uint32_t mni_ring_find(const mni_front *front, const mni_ring *ring, uint32_t leaf);
/* A split's: corners of leaves from mid on go to the right child, whose record is empty. */
void mni_ring_part(mni_front *front, uint32_t slot, uint32_t right, uint32_t mid);
/* Of a collapse: the corner that is in neither child, of each simplex with one in both, which dies;
 * and those for which the record has no room. */
typedef struct mni_joined {
    uint32_t died, third[MNI_FRONT_CORNERS];
    uint32_t lost; /* a bit each: that node has no other simplex with one of the two */
    uint32_t over_count, over[MNI_FRONT_CORNERS];
} mni_joined;
/* A collapse's: the left child has the corners of both, but those of what dies. */
void mni_ring_join(mni_front *front, uint32_t left, uint32_t right, mni_joined *joined);
/* Where in the record the corner stands; MNI_FRONT_CORNERS: nowhere. */
uint32_t mni_ring_place(const mni_front *front, uint32_t slot, uint32_t corner);

#endif
