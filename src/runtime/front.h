/* The front: the expanded tree, the active simplices, and the two moves between them.
 *
 * An active node has a slot, an expanded one a branch. When a node splits, its left child, which
 * has its position and its first leaf, keeps its slot: so positions stay where they are, and of the
 * corners around it only those change hands that go to the right child.
 *
 *      active p: slot 7   ──split──>   branch 3 (slot 7) ──┬─ left:  slot 7, or a branch of slot 7
 *                                                          └─ right: slot 9, or a branch of slot 9
 *
 * Threads: Navigate only. Nothing allocates after mni_front_open. */
#ifndef MNI_FRONT_H
#define MNI_FRONT_H

#include "block.h"
#include "store.h"
#include "vacancy.h"
#include "wanted.h"

enum {
    MNI_FRONT_NODES_MAX = 1 << 27,     /* × 16 words are 31 bits */
    MNI_FRONT_SIMPLICES_MAX = 1 << 29, /* × 4 likewise */
    MNI_FRONT_VIEWS = 64,              /* opened blocks at hand; a power of two */
    MNI_FRONT_LOST = 8, /* nodes that a collapse tells of: honest files have none, but at hubs */
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
    MNI_NODE_BAD = 1,      /* its split found a bad block */
    MNI_NODE_GIVEN_UP = 2, /* Navigate's: its chain was refused by the pool */
    MNI_NODE_EXIT = 4,     /* its record is in another block than its parent's */
};
#define MNI_FRONT_BRANCH 0x80000000u /* set in a reference to a branch, clear in one to a slot */

#define MNI_FRONT_NO_PARENT 0x1fffffffu /* of a root */
enum {
    MNI_FRONT_CORNERS = 8, /* of a node in its own record: most have no more, 6 on average */
    MNI_FRONT_CHUNK = 7,   /* and in each chunk of a list that is longer */
};
/* Of a list that is in the record: this + how many there are. */
#define MNI_FRONT_SHORT 0xfffffff0u
#define MNI_FRONT_POLE 0x80000000u /* set in `more` of a pole, above its chunk */

/* An active node but for what is streamed: position, switch value, radius and cone stand apart. One
 * line of the cache: whoever asks about a neighbour, or walks around a node, touches no other. */
typedef struct mni_front_node {
    uint32_t order; /* order id; MN_NONE: nobody is in the slot */
    uint32_t above; /* order id of its parent; MN_NONE: a root */
    uint32_t leaf_lo, leaf_hi;
    uint32_t corner[MNI_FRONT_CORNERS]; /* of simplices, then 0 */
    uint32_t more;        /* first chunk of further corners, or MNI_FRONT_SHORT …; or of a pole */
    uint32_t parent : 29; /* branch */
    uint32_t flags : 3;
    uint32_t witness; /* of a long list: a neighbour that blocked a move of it, as long as active */
    uint32_t waits;   /* Navigate's, of a slot: who waits for its node to go (waiting.h) */
} mni_front_node;
_Static_assert(sizeof(mni_front_node) == 64, "one line of the cache");

/* What the corners of a pole, or of a part of them, have at most. Neighbours: those that are no
 * poles. */
typedef struct mni_pole_bound {
    uint32_t leaf;  /* largest; 0: there are none */
    uint32_t order; /* of a neighbour, largest */
    uint32_t above; /* of a neighbour, least */
} mni_pole_bound;

/* Further corners of a node. All but the first chunk of a list are full, so 3 × simplices / 7
 * chunks are enough for any front. Those that lists do not need are for poles (pole.c). */
typedef union mni_front_chunk {
    struct {
        uint32_t corner[MNI_FRONT_CHUNK];
        uint32_t next; /* chunk, or MN_NONE; free: next free one */
        union {
            uint32_t witness_order; /* of a list's first chunk: of its node's witness */
            uint32_t chunks;        /* of its others: how many there are from here on */
        };
    };
    struct {
        uint32_t part[2]; /* of a pole's tree; see there */
        mni_pole_bound bound[2];
    } fork;
    struct {
        uint32_t slot, next; /* chunk of another pole, or MN_NONE */
        uint32_t number;     /* below MNI_POLES */
        uint32_t near;       /* a bit a number: those may be neighbours, all others are none */
        uint32_t witness;    /* a corner at which, last time, one was */
        uint32_t tree;
        mni_pole_bound bound;
    } pole;
} mni_front_chunk;
_Static_assert(sizeof(mni_front_chunk) == 36, "what the plan counts on: poles take no more");

typedef struct mni_front_face {
    mn_cone cone;
    uint16_t index; /* its record: node in its parent's block, or, of an exit, that */
} mni_front_face;

/* An expanded node. Its position and first leaf are those of its slot. One line of the cache as
 * well: what the last eight bytes and a test of a collapse ask for comes with the rest. */
typedef struct mni_front_branch {
    uint32_t order;
    float switch_value, radius;
    mni_front_face face;
    uint32_t child[2];    /* slots or, with MNI_FRONT_BRANCH, branches */
    uint32_t parent;      /* branch, or MNI_FRONT_NO_PARENT */
    uint32_t home;        /* entry of the block with its record: where its children count */
    uint32_t slot;        /* that it had, and its leftmost descendant has; MN_NONE: free */
    uint32_t exit : 1;    /* MNI_NODE_EXIT */
    uint32_t killed : 31; /* simplices that its split brought */
    uint32_t wait_next, wait_before, wait_below; /* Navigate's: what it waits for (waiting.h) */
    uint32_t leaf_lo; /* its first leaf: where it is, in the order of the tree */
    uint32_t kept;    /* Navigate's: last frame in which it stays unwanted */
} mni_front_branch;
_Static_assert(sizeof(mni_front_branch) == 64, "one line of the cache");

/* A node that may have gone: slots pass from node to node. */
typedef struct mni_front_ref {
    uint32_t slot, order;
} mni_front_ref;

/* Neighbours of a node, by the corners in its record: the slots of those after them in their
 * simplices, then of those before; `nobody` where there is none. Around a closed fan each neighbour
 * stands once in either half. */
enum { MNI_RING = 2 * MNI_FRONT_CORNERS };
typedef struct mni_ring {
    uint32_t slot[MNI_RING];
} mni_ring;

/* Around the two children of a fork: the left one's ring, the right one's, MN_NONE. */
typedef struct mni_rings {
    uint32_t slot[2 * MNI_RING + 1];
    bool is_none; /* a list is longer than its record: nothing is above */
} mni_rings;

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
    uint32_t nodes_max, simplices_max, chunks_max;
    uint32_t nobody; /* the slot past all, whose node is none (ring.c) */
    bool vectors;    /* for ring.c */
    uint32_t poles;  /* chunk of the first, or MN_NONE */

    float *position; /* 3 × slots */
    uint32_t *color; /* slots, or NULL */
    float *switch_value, *radius;
    mni_front_face *face;
    mni_front_node *node;
    mni_front_branch *branch;
    mni_front_chunk *chunk;
    /* 3 × simplices; corner k of simplex s is 4 s + k. Simplex 0 is none: its corners are MN_NONE
     */
    uint32_t *simplex_node; /* slots; [3s] MN_NONE: free */
    uint32_t *simplex_leaf; /* leaf ids */
    uint64_t *forks;        /* a bit a branch: both children are active */
    uint32_t *node_stamp; /* a page of MN_FRONT_PAGE slots: low bits of version, last written at */
    uint32_t *simplex_stamp; /* likewise of simplices, from simplex 1 on */

    mni_vacancy slots, simplices;
    uint32_t slots_high, simplices_high; /* never used from here on; of branches as of slots */
    uint32_t chunks_high, chunk_free;
    uint32_t simplices_used;
    uint32_t active, triangles;
    uint32_t chunks_used;
    /* slots of third corners of what the last collapse killed: of all that may be no neighbours
     * now, or of the first of those */
    uint32_t lost[MNI_FRONT_LOST], lost_count;
    uint64_t version;            /* rises with every split and collapse that stays */
    uint64_t descents;           /* third corners not found among the neighbours looked through */
    uint64_t bad;                /* splits that met a bad block */
    uint32_t root[MN_ROOTS_MAX]; /* slot r, or the branch that root r has become */
    mni_entry root_entry[MN_ROOTS_MAX]; /* of its block: where it counts itself */
    mni_front_view view[MNI_FRONT_VIEWS];
    /* around the slot whose blockers of a split were asked for last, until something moves;
     * MN_NONE: none. Blockers: bit i is ring.slot[i] */
    uint32_t ring_slot, ring_blockers;
    mni_ring ring;
#ifdef MN_SLOW_CHECKS
    uint64_t looked; /* corners of long lists (mni_front_looks) */
#endif
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

/* For tests: so many corners of a list that is longer than a record are looked at. */
static inline void mni_front_looks(mni_front *front, uint32_t corners) {
#ifdef MN_SLOW_CHECKS
    front->looked += corners;
#else
    (void)front, (void)corners;
#endif
}
static inline bool mni_front_is_long(const mni_front_node *node) {
    return node->more < MNI_FRONT_SHORT;
}
static inline bool mni_front_is_pole(const mni_front_node *node) {
    return mni_front_is_long(node) && (node->more & MNI_FRONT_POLE) != 0;
}
static inline bool mni_front_is_active(const mni_front *front, uint32_t slot) {
    return front->node[slot].order != MN_NONE;
}
static inline bool mni_front_is_leaf(const mni_front *front, uint32_t slot) {
    return front->node[slot].order < front->header->leaves;
}
static inline mni_front_ref mni_front_ref_of(const mni_front *front, uint32_t slot) {
    return (mni_front_ref){slot, front->node[slot].order};
}
/* Is it the same node still, and active? */
static inline bool mni_front_stands(const mni_front *front, mni_front_ref ref) {
    return front->node[ref.slot].order == ref.order;
}
static inline bool mni_front_is_branch(const mni_front *front, uint32_t branch) {
    return front->branch[branch].slot != MN_NONE;
}
/* Can the branch collapse as far as the tree goes: are both children active? */
static inline bool mni_front_is_fork(const mni_front *front, uint32_t branch) {
    return (front->forks[branch / 64] >> (branch % 64) & 1) != 0;
}
static inline mni_bounds mni_front_bounds(const mni_front *front, uint32_t slot) {
    return (mni_bounds){&front->position[3 * (size_t)slot], front->radius[slot],
                        front->switch_value[slot], front->face[slot].cone};
}
static inline mni_bounds mni_front_branch_bounds(const mni_front *front, uint32_t branch) {
    const mni_front_branch *b = &front->branch[branch];
    return (mni_bounds){&front->position[3 * (size_t)b->slot], b->radius, b->switch_value,
                        b->face.cone};
}

/* A neighbour that must split before slot may (its order id is larger), or MN_NONE. */
uint32_t mni_front_split_blocker(mni_front *front, uint32_t slot);
/* All of them, as far as room goes (at least 1), but at an open edge, where one may be told of when
 * the others have gone; in a list that is long repeated where they share several simplices. Returns
 * how many: 0 only where nobody blocks. */
uint32_t mni_front_split_blockers(mni_front *front, uint32_t slot, mni_front_ref *out,
                                  uint32_t room);
/* A neighbour whose parent's order id is below that of the fork, or MN_NONE. */
uint32_t mni_front_collapse_blocker(mni_front *front, uint32_t fork);
/* The same in two steps, so that several forks can be tested together: the neighbours, which are
 * asked for, then, before anything moves, the blocker. */
void mni_front_look(const mni_front *front, uint32_t fork, mni_rings *rings);
uint32_t mni_front_blocker_among(mni_front *front, uint32_t fork, const mni_rings *rings);

/* Memory that a move of a node will touch, asked for in three steps, each of which reads what the
 * one before asked for: the node, its simplices, its neighbours. */
static inline void mni_front_fetch_node(const mni_front *front, uint32_t slot) {
    __builtin_prefetch(&front->node[slot]);
}
void mni_front_fetch_simplices(const mni_front *front, uint32_t slot, bool leaves);
void mni_front_fetch_ring(const mni_front *front, uint32_t slot);
/* Its simplices, and all else that stands in the front of who is split next. */
static inline void mni_front_fetch_split(const mni_front *front, uint32_t slot) {
    mni_front_fetch_simplices(front, slot, true);
    __builtin_prefetch(&front->branch[front->node[slot].parent]);
    __builtin_prefetch(&front->face[slot]);
}
/* And its place and row in a block that is at hand; its parent has been asked for before. */
void mni_front_fetch_record(const mni_front *front, uint32_t slot);

/* Splits an active inner node that nothing blocks: *branch is what it becomes. The block where the
 * node counts stays in use until release, so that unsplit, the exact inverse, cannot fail. */
mni_outcome mni_front_split(mni_front *front, uint32_t slot, uint32_t *branch);
void mni_front_release(mni_front *front, uint32_t branch);
void mni_front_unsplit(mni_front *front, uint32_t branch);
/* Collapses a fork that nothing blocks, if the block where it will count is in memory. */
mni_outcome mni_front_collapse(mni_front *front, uint32_t fork);

/* Where an active node, or a node that was one, counts. */
static inline mni_entry mni_front_entry(const mni_front *front, uint32_t parent, uint32_t slot) {
    return parent == MNI_FRONT_NO_PARENT ? front->root_entry[slot] : front->branch[parent].home;
}
/* The active node that holds a leaf. */
uint32_t mni_front_find(const mni_front *front, uint32_t leaf);
/* Where the input has a leaf that an active node, in that slot, holds: read through the blocks.
 * false: one of them is not in memory. */
bool mni_front_leaf_position(mni_front *front, uint32_t slot, uint32_t leaf, float position[3]);
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
/* Of an active node that is an exit: the block with its record, a note on that block
 * (mni_rate_block), and the entry that refers to it. */
mni_entry mni_front_exit(mni_front *front, uint32_t slot, mn_block_ref *ref, mni_note *note);
/* Adds up active nodes by entry. counts: zeroed, one an entry. */
void mni_front_usage(const mni_front *front, uint32_t *counts);

#endif
