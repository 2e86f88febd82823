/* The front: the expanded tree, the active simplices, and the two moves between them.
 *
 * The children of a split lie in slots 2i and 2i + 1 (a pair): the sibling of s is s ^ 1, and a
 * pair has one parent slot. A root has a pair of its own, whose second slot stays free.
 *
 *      parent (expanded) ──> pair i = { left: slot 2i, right: slot 2i + 1 }
 *                                        │                │
 *                            active: corners of simplices, or expanded: a pair below
 *
 * Threads: Navigate only. Nothing allocates after mni_front_open. */
#ifndef MNI_FRONT_H
#define MNI_FRONT_H

#include "block.h"
#include "store.h"
#include "wanted.h"

enum {
    MNI_FRONT_VIEWS = 64,    /* opened blocks at hand; a power of two */
    MNI_FRONT_NEAR_MAX = 64, /* corners looked through for a third corner before descending */
};

typedef enum mni_outcome {
    MNI_DONE = 0,
    MNI_MISS,           /* a block is absent: asked for */
    MNI_BAD,            /* a block contradicts its parent: as absent, until the node is new */
    MNI_REFUSED_POOL,   /* the pool's rules */
    MNI_REFUSED_FRONT,  /* no room for nodes or simplices */
    MNI_REFUSED_BUDGET, /* set by Navigate only */
    MNI_OUTCOMES
} mni_outcome;

enum {
    MNI_NODE_ACTIVE = 1,
    MNI_NODE_EXPANDED = 2,
    MNI_NODE_BAD = 4,      /* its split found a bad block */
    MNI_NODE_GIVEN_UP = 8, /* Navigate's: its chain was refused by the pool */
    MNI_NODE_LEAF = 16,    /* has no record of its own */
    MNI_NODE_STUB = 32,    /* its record is in another block than its parent's */
    MNI_NODE_KIND = MNI_NODE_LEAF | MNI_NODE_STUB, /* constant while it is in its slot */
};

/* What a slot holds besides its position and switch value, which stand apart for the renderer. */
typedef struct mni_front_node {
    uint32_t order; /* order id */
    uint32_t leaf_lo, leaf_hi;
    float radius;
    uint32_t entry;                  /* of its parent's block, where it counts; a root's: its own */
    uint32_t pair;                   /* EXPANDED: of its children */
    uint32_t first;                  /* ACTIVE: first corner on its list, or MN_NONE */
    uint32_t witness, witness_order; /* the neighbour that blocked its split, as long as active */
    uint16_t index;                  /* its record: node in that block, or, of a stub, exit */
    uint16_t flags;
    mn_cone cone;
} mni_front_node;

typedef struct mni_front_pair {
    uint32_t parent; /* slot; MN_NONE: a root, or free */
    uint32_t killed; /* simplices that the split of parent brought; free: next free pair */
    uint32_t witness, witness_order; /* the neighbour that blocked its collapse */
} mni_front_pair;

typedef struct mni_front_view {
    mni_entry entry;
    const void *bytes;
    mni_block block;
} mni_front_view;

typedef struct mni_front {
    /* const after open */
    mni_store *store;
    const mn_header *header;
    mni_block_limits limits;
    uint32_t pairs_max, simplices_max;

    float *position; /* 3 × slots */
    uint32_t *color; /* slots, or NULL */
    float *switch_value;
    mni_front_node *node;
    mni_front_pair *pair;
    uint32_t *simplex_leaf; /* 3 × simplices; corner c = 3 × simplex + 0 … 2 */
    uint32_t *simplex_node; /* slots; [3s] MN_NONE: free */
    uint32_t *next, *prev;  /* a node's corners; next[3s] of a free simplex: the next free one */
    uint32_t *node_stamp; /* a page of MN_FRONT_PAGE slots: low bits of version, last written at */
    uint32_t *simplex_stamp;

    uint32_t pairs_high, pair_free, pairs_used; /* high: never used from here on */
    uint32_t simplices_high, simplex_free, simplices_used;
    uint32_t active, triangles;
    uint64_t version;  /* rises with every split and collapse that stays */
    uint64_t descents; /* third corners not found among the neighbours looked through */
    uint64_t bad;      /* splits that met a bad block */
    mni_front_view view[MNI_FRONT_VIEWS];
} mni_front;

/* Arena bytes of a front with that room; for the plan. */
size_t mni_front_need_bytes(const mn_header *header, uint32_t nodes_max, uint32_t simplices_max);
/* Starts at the roots, whose blocks the store holds. MN_BAD_INPUT: a root is not what the header
 * says. */
mn_code mni_front_open(mni_front *front, mni_store *store, const mn_header *header,
                       uint32_t nodes_max, uint32_t simplices_max, mni_arena *arena, mn_status *st);
/* The check of a block's content that the store makes of what comes from the disk. context: an
 * mni_block_limits. */
bool mni_front_block_check(const void *context, const void *bytes, uint32_t length_bytes);

static inline bool mni_front_is_active(const mni_front *front, uint32_t slot) {
    return (front->node[slot].flags & MNI_NODE_ACTIVE) != 0;
}
static inline bool mni_front_is_leaf(const mni_front *front, uint32_t slot) {
    return (front->node[slot].flags & MNI_NODE_LEAF) != 0;
}
static inline uint32_t mni_front_parent(const mni_front *front, uint32_t slot) {
    return front->pair[slot >> 1].parent;
}
/* Can the pair collapse as far as the tree goes: both children active, not a root? */
static inline bool mni_front_is_fork(const mni_front *front, uint32_t pair) {
    return front->pair[pair].parent != MN_NONE &&
           (front->node[2 * pair].flags & front->node[2 * pair + 1].flags & MNI_NODE_ACTIVE);
}
static inline mni_bounds mni_front_bounds(const mni_front *front, uint32_t slot) {
    const mni_front_node *n = &front->node[slot];
    return (mni_bounds){&front->position[3 * (size_t)slot], n->radius, front->switch_value[slot],
                        n->cone};
}

/* A neighbour that must split before slot may (its order id is larger), or MN_NONE. */
uint32_t mni_front_split_blocker(mni_front *front, uint32_t slot);
/* All of them, as far as room goes, repeated where they share several simplices. Returns how many.
 */
uint32_t mni_front_split_blockers(mni_front *front, uint32_t slot, uint32_t *out, uint32_t room);
/* A neighbour whose parent's order id is below that of the pair's parent, or MN_NONE. */
uint32_t mni_front_collapse_blocker(mni_front *front, uint32_t pair);

/* Splits an active inner node that nothing blocks. The block where the node counts stays in use
 * until release, so that unsplit, the exact inverse, cannot fail. */
mni_outcome mni_front_split(mni_front *front, uint32_t slot);
void mni_front_release(mni_front *front, uint32_t slot);
void mni_front_unsplit(mni_front *front, uint32_t slot);
/* Collapses a fork that nothing blocks, if the parent's block is in memory. */
mni_outcome mni_front_collapse(mni_front *front, uint32_t pair);

/* The active node that holds a leaf. */
uint32_t mni_front_find(const mni_front *front, uint32_t leaf);
/* Where the input has that leaf: read through the blocks. false: one of them is not in memory. */
bool mni_front_leaf_position(mni_front *front, uint32_t leaf, float position[3]);
/* XXH3 of the active order ids, sorted. scratch: 2 × active values. */
uint64_t mni_front_hash(const mni_front *front, uint32_t *scratch);
/* 0 when every edge of the front is used equally often in both directions (and else, but for a
 * chance of 2^-64, not). */
uint64_t mni_front_imbalance(const mni_front *front);
/* Is the input closed and consistently oriented, so that every front's imbalance is 0? Reads the
 * whole file; false also when some of it is not sound. For checks. */
bool mni_front_input_is_closed(const char *path, const mn_header *header);
/* Invariant 1, the validity of the front, and the equations of this struct, by recount. Asserts. */
void mni_front_check(const mni_front *front);
/* Adds up active nodes by entry. counts: zeroed, one an entry. */
void mni_front_usage(const mni_front *front, uint32_t *counts);

#endif
