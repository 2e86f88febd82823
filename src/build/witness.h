/* The switch value: how far the input surface beneath a node is from its star.
 *
 * Each node carries a bounded set of witnesses, points of the input surface beneath it. When r
 * collapses into k, the witnesses of both are measured against the star that k has then; the
 * largest distance, with what dropped witnesses added on, counts. Of too many the closest pair
 * loses the one that is nearer to the surface, so that what stays is spread out and far off.
 *
 *   leaf: its own position and the centres of the input triangles that it answers for
 *   node: at most MNI_WITNESSES; the sets of two children become their parent's
 *
 * Witnesses are samples, and they see nothing where the new triangles lie across the old edges. So
 * the middle of each old edge r–n is measured too: it counts for the new node, and for n, whose
 * star has just changed as well. Samples fall short of a maximum by a factor; the factors in
 * witness.c were measured (`metanode bench error`) so that 99.9 % of the surface is within the
 * bound.
 *
 * A node's value is final when it becomes a child. One thread. Memory: 4 bytes a vertex, 12 a
 * triangle, and at most half the vertices × sizeof(mni_witnesses). */
#ifndef MNI_WITNESS_H
#define MNI_WITNESS_H

#include "surface.h"

enum { MNI_WITNESSES = 8 };

/* Two lines of the cache. */
typedef struct mni_witnesses {
    float x[MNI_WITNESSES], y[MNI_WITNESSES], z[MNI_WITNESSES];
    float slack[MNI_WITNESSES]; /* below 0: there is no such witness */
} mni_witnesses;

/* Where a hub's witnesses are near (hub.h): of each, a neighbour; MN_NONE: to be looked for. */
typedef struct mni_homes {
    uint32_t at[MNI_WITNESSES];
    uint64_t credit; /* simplices that may be walked to look for homes */
} mni_homes;

typedef struct mni_witness_book {
    mni_witnesses *sets;
    uint32_t sets_count, sets_room;
    uint32_t *own_start;       /* a leaf: in own[], the centres of the input triangles that it */
    float (*own)[3];           /* answers for, which are those that begin with it */
    struct mni_bench *bench;   /* scratch */
    uint32_t tried_r, tried_k; /* the collapse that is measured there already; MN_NONE: none */
    bool no_memory;
} mni_witness_book;

/* For a surface of which nothing has been collapsed. */
mn_code mni_witness_open(mni_witness_book *book, const mni_surface *surface, mn_status *st);
/* Or in two steps, of which the second may be the caller's: sets[], own_start[] and own[]. A set is
 * taken where two leaves collapse, and a leaf does so once: one for two leaves and one for each
 * other vertex suffice. */
mn_code mni_witness_room(mni_witness_book *book, uint32_t vertices, uint32_t sets, uint32_t points,
                         mn_status *st);
void mni_witness_fill(mni_witness_book *book, const mni_surface *surface);
void mni_witness_close(mni_witness_book *book);
/* What is known of r and k before one goes: r's ring; their wheels, or NULL for both. */
typedef struct mni_about {
    uint32_t r, k;
    const uint32_t *ring;
    uint32_t ring_count;
    const mni_wheel *of_r, *of_k;
} mni_about;

/* How far the surface beneath both would be from k's star if r collapsed into it: a lower bound of
 * the switch value that mni_witness_collapse would find. Changes nothing. A collapse that follows
 * at once does not measure again. */
float mni_witness_try(mni_witness_book *book, mni_surface *surface, const mni_about *about);
/* r has just collapsed into k on the surface; ring: r's as it was before. Sets k's value to the new
 * node's switch value and raises those of the nodes around it. */
void mni_witness_collapse(mni_witness_book *book, mni_surface *surface, const uint32_t *ring,
                          uint32_t ring_count, uint32_t r, uint32_t k);
/* The same where k is a hub: its star is too large to be measured against, so each point looks for
 * its nearest triangle from the neighbour on that is its home. What is found may be farther away
 * than what is nearest, never nearer. */
void mni_witness_collapse_hub(mni_witness_book *book, mni_surface *surface, const uint32_t *ring,
                              uint32_t ring_count, uint32_t r, uint32_t k, mni_homes *homes);
/* Nothing but haste: v's witnesses will be asked for soon. For leaves it wants to be called once
 * more, when that has arrived. */
static inline void mni_witness_fetch(const mni_witness_book *book, const mni_surface *surface,
                                     uint32_t v) {
    uint32_t set = surface->vertex[v].set;
    if (set == MN_NONE) {
        __builtin_prefetch(&book->own_start[v]);
    } else {
        __builtin_prefetch(&book->sets[set]);
        __builtin_prefetch(&book->sets[set].z);
    }
}
static inline void mni_witness_fetch_more(const mni_witness_book *book, const mni_surface *surface,
                                          uint32_t v) {
    if (surface->vertex[v].set == MN_NONE)
        __builtin_prefetch(&book->own[book->own_start[v]]);
}

#endif
