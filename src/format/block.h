/* The meaning of a block: several subtrees of the view-dependence tree, in rows of bits.
 *
 * The decoder hides widths and bases: callers see indices and values. A view is pointers
 * into the block's bytes and lives only while they stay (a place holder pinned, a file mapped).
 * Threads: a view is read-only; any thread may open its own. Nothing here allocates or blocks.
 * docs/format.md gives the bytes.
 *
 *   block = frame (frame.h: checks, reference table) | block head | rows … | zero padding
 *
 * Inner nodes stand in one numbering a block, node 0 … nodes-1: subtree after subtree, each in
 * preorder, left before right (so children come after parents, and an inner left child is the next
 * node). A leaf has no record of its own: what there is of it (right_position, right_color) stands
 * with its parent.
 *
 * What decides about a node (mni_facts) stands in its parent's block, so an active node needs no
 * block but that one; its own record, which names its children, is needed when it splits:
 *
 *      block:  p ── record: left, right ── facts of a (INNER) and b (SUBTREE: an exit)
 *                                                        │
 *      child block:                                      b ── record: left, right …
 */
#ifndef MNI_BLOCK_H
#define MNI_BLOCK_H

#include <stdbool.h>
#include <stdint.h>

#include "metanode/format.h"
#include "planes.h"

/* What decides about a node: all that its parent's block says of it. */
typedef struct mni_facts {
    uint32_t order; /* order id */
    float switch_value, radius;
    mn_cone cone;
} mni_facts;

/* Where a child is. */
typedef enum mni_child_kind {
    MNI_CHILD_LEAF = 0, /* its record is the parent's */
    MNI_CHILD_INNER,    /* node `node` of the same block */
    MNI_CHILD_SUBTREE,  /* subtree `subtree` of the block refs[ref] of the frame */
} mni_child_kind;
typedef struct mni_child {
    mni_child_kind kind;
    uint32_t node;    /* INNER */
    uint32_t exit;    /* SUBTREE: its number among the block's exits; the encoder gives its own */
    uint32_t ref;     /* SUBTREE: index in the frame's reference table */
    uint32_t subtree; /* SUBTREE */
    mni_facts facts;  /* INNER, SUBTREE */
} mni_child;

/* What its parent says of a node besides: a left child has the parent's leaf_lo and position, a
 * right child begins at the parent's leaf_mid. The header has it of the roots. Records count from
 * it, so whoever reads them must know it. */
typedef struct mni_place {
    uint32_t leaf_lo, leaf_hi;
    float position[3];
} mni_place;

/* An inner node. */
typedef struct mni_node {
    mni_place at;
    mni_facts facts;
    uint32_t leaf_mid;
    float right_position[3]; /* of the right child, that is of leaf leaf_mid */
    uint32_t right_color;    /* RGBA8; 0xffffffff in a model without colours */
    mni_child left, right;
    uint32_t simplex_count; /* killed here, and in this block */
    uint32_t overflow_ref;  /* reference of the first overflow block, or MN_NONE */
    uint32_t row, more;     /* where its simplices are; the decoder's */
} mni_node;

/* A node with more simplices than its block has room for goes on in overflow blocks: overflow_ref
 * is the first, reference 0 of an overflow block's frame the next, until one has no references.
 * simplex_count counts those in the block itself. */

/* The root of a subtree. Its position and colour are its parent's alone to say. */
typedef struct mni_subtree {
    uint32_t node; /* its inner node */
    uint32_t leaf_lo, leaf_hi;
} mni_subtree;

enum {
    MNI_BLOCK_NODES_MAX = 65535,  /* inner nodes in a block */
    MNI_BLOCK_EXITS_MAX = 65536,  /* children that are SUBTREEs */
    MNI_GRID_STEPS_MAX = 1 << 24, /* across a model: differences are exact as floats */
    MNI_BLOCK_DEPTH_MAX = 256,    /* levels of a subtree in a block: bounds the checker's stack */
    MNI_BLOCK_TAIL_BYTES = 8,     /* zeroes after the last row: the decoder reads 8 bytes at once */
};

/* Private but for the counts. */
typedef struct mni_block {
    uint32_t nodes, subtrees;
    uint32_t exits; /* children that are SUBTREEs */
    uint32_t more;  /* simplices that do not stand with their nodes */
    bool has_colors;
    float step; /* of the grid of positions */
    uint32_t node_bits, exit_bits, subtree_bits, simplex_bits;
    const uint8_t *base, *edge;
    const uint8_t *node_rows, *exit_rows, *subtree_rows, *more_rows, *far_rows;
    uint32_t near, far, far_bits; /* third corners: see block_layout.h */
    bool has_rest;                /* overflow, lack and more are not all empty */
    bool is_short; /* fields are so narrow that few reads fetch them, by instructions that the
                      processor has; then these say how: */
    uint64_t facts_spread, facts_base;
    uint32_t delta_base[3];
    uint16_t place_at, way_at, simplex_at; /* bits into a row */
    uint8_t order_bits, left_bits, delta_bits[3], right_bits, exit_bits_of, a_bits, b_bits,
        third_bits;
} mni_block;

/* Bounds that a block of this file must respect. */
typedef struct mni_block_limits {
    uint32_t leaves, nodes; /* of the file: header.leaves, header.nodes */
    uint64_t file_bytes;
    bool has_colors;
    float grid_step;
} mni_block_limits;
mni_block_limits mni_block_limits_of(const mn_header *header);

/* Opens a view of bytes whose frame has been checked, and checks everything in it that one block
 * can show: rows inside the block, children a forest of the subtrees, intervals nested, order
 * ids falling, switch values and radii nested and finite, each simplex with one corner in each
 * child of its node and the third outside the node. false: why (may be NULL) gets one phrase.
 * O(block). */
bool mni_block_open(mni_block *view, const void *bytes, uint32_t length_bytes,
                    const mni_block_limits *limits, char *why, uint32_t why_bytes);
/* Where the rows of nodes stand, if they do, for who compresses the block: one of any kind that is
 * sound. */
mni_rows_place mni_block_rows_place(const void *bytes);
/* As mni_block_open, of bytes that passed it before: decodes the head and checks nothing. O(1). */
void mni_block_reopen(mni_block *view, const void *bytes);

/* at: what is known of the node from above. */
void mni_block_node(const mni_block *view, uint32_t node, const mni_place *at, mni_node *out);
/* The same but for what a split does not ask for: the node's own facts, and where exits lead. The
 * children's facts are asked for, and mni_block_children reads them. */
void mni_block_split(const mni_block *view, uint32_t node, const mni_place *at, mni_node *out);
void mni_block_children(const mni_block *view, mni_node *node);
/* What mni_block_split will read, or mni_block_exit, asked for ahead of time; the bytes may be gone
 * meanwhile. */
static inline void mni_block_fetch(const mni_block *view, uint32_t index, bool exit) {
    const uint8_t *const rows[] = {view->node_rows, view->exit_rows}; /* nobody can guess which */
    const uint32_t bits[] = {view->node_bits, view->exit_bits};
    const uint8_t *row = rows[exit] + ((uint64_t)index * bits[exit] >> 3);
    __builtin_prefetch(row);
    __builtin_prefetch(row + 64);
}
/* A node's own facts alone. */
void mni_block_facts(const mni_block *view, uint32_t node, mni_facts *out);
void mni_block_subtree(const mni_block *view, uint32_t subtree, mni_subtree *out);
/* Where an exit leads, a child that mni_block_split has found, of kind SUBTREE: ref and subtree. */
void mni_block_way(const mni_block *view, mni_child *exit);
/* An exit alone: a child of kind SUBTREE. */
void mni_block_exit(const mni_block *view, uint32_t exit, mni_child *out);
/* Simplex i of a node as mni_block_node gave it: three leaf ids in the input's cyclic order; the
 * third is MN_NONE for a hinge. */
void mni_block_simplex(const mni_block *view, const mni_node *node, uint32_t i, uint32_t corner[3]);

/* Goes through the nodes of a block in their order. Positions count from that of the subtree's
 * root, which the block does not know. */
typedef struct mni_walk {
    const mni_block *view;
    uint32_t subtree, waiting;
    struct mni_walk_node {
        uint32_t node;
        mni_place at;
    } stack[MNI_BLOCK_DEPTH_MAX + 2];
} mni_walk;
void mni_walk_begin(mni_walk *walk, const mni_block *view);
/* *node: its index. false: there are no more. */
bool mni_walk_next(mni_walk *walk, uint32_t *node, mni_node *out);

/* ---- overflow blocks ------------------------------------------------------------------------ */

typedef struct mni_overflow {
    uint32_t order, leaf_lo, leaf_mid, leaf_hi; /* of the node whose simplices these are */
    uint32_t simplices;
    const uint8_t *edge, *rows; /* private */
} mni_overflow;
/* As mni_block_open. The caller compares order and interval with the node's. */
bool mni_overflow_open(mni_overflow *view, const void *bytes, uint32_t length_bytes,
                       const mni_block_limits *limits, char *why, uint32_t why_bytes);
void mni_overflow_simplex(const mni_overflow *view, uint32_t simplex, uint32_t corner[3]);

/* ---- writing -------------------------------------------------------------------------------- */

/* What a block would take: counts and the range of each field. Adding is exact and cheap, so a
 * filler copies a tally, adds, and keeps the copy if it fits. */
enum { MNI_TALLY_RANGES = 19, MNI_TALLY_LENGTHS = 33 };
typedef struct mni_tally {
    uint32_t nodes, subtrees, exits, more;
    bool has_colors, has_overflow;
    float step; /* of the grid of positions */
    uint32_t min[MNI_TALLY_RANGES], max[MNI_TALLY_RANGES];
    uint32_t third[MNI_TALLY_LENGTHS];   /* third corners by the bits of their codes */
    uint32_t near;                       /* how these were cut when that was last looked at */
    uint32_t leaf_lo, leaf_mid, leaf_hi; /* of the last node */
} mni_tally;
/* grid_step: of the tree. */
void mni_tally_init(mni_tally *tally, bool has_colors, float grid_step);
/* Of the children the kinds matter and the facts of SUBTREEs, of the simplices their number. */
void mni_tally_node(mni_tally *tally, const mni_node *node);
/* A simplex of the last node, in its own block. */
void mni_tally_simplex(mni_tally *tally, const uint32_t corner[3]);
void mni_tally_subtree(mni_tally *tally, const mni_subtree *subtree);
/* Adds all that another tally holds: the sum is as if everything had been tallied in one. */
void mni_tally_merge(mni_tally *tally, const mni_tally *other);
/* Bytes from the block's start to the end of its last row, with that many references. */
uint64_t mni_tally_bytes(const mni_tally *tally, uint32_t refs);
/* Are these at most limit_bytes? Cheaper than to ask how many, where they are. */
bool mni_tally_fits(mni_tally *tally, uint32_t refs, uint64_t limit_bytes);

/* What one node with few simplices adds to a tally, to be added again and again. */
enum { MNI_PART_THIRDS = 6 };
typedef struct mni_tally_part {
    uint32_t min[MNI_TALLY_RANGES], max[MNI_TALLY_RANGES];
    uint32_t more;
    uint8_t exits, thirds;
    uint8_t third[MNI_PART_THIRDS]; /* bits of their codes */
    bool has_overflow;
} mni_tally_part;
/* corner: of its simplices. false: these are too many for a part. */
bool mni_tally_part_of(mni_tally_part *part, const mni_node *node, const uint32_t *corner,
                       bool has_colors, float grid_step);
void mni_tally_add(mni_tally *tally, const mni_tally_part *part);

/* Writes a block: begin, then every subtree, and every node followed by its simplices, in the order
 * of the numbering, then the references and the seal (frame.h). bytes[0, length_bytes) is zeroed;
 * the caller's. */
typedef struct mni_encoder {
    mni_block view;
    mni_tally tally;
    uint32_t nodes, subtrees, exits, more, far; /* written so far */
    mni_node last;   /* node; simplex_count: how many are still to come */
    uint32_t placed; /* of its simplices */
} mni_encoder;
void mni_encoder_begin(mni_encoder *encoder, void *bytes, uint32_t length_bytes,
                       const mni_tally *tally, uint32_t refs);
void mni_encoder_node(mni_encoder *encoder, const mni_node *node);
void mni_encoder_subtree(mni_encoder *encoder, const mni_subtree *subtree);
void mni_encoder_simplex(mni_encoder *encoder, const uint32_t corner[3]);
void mni_encoder_end(mni_encoder *encoder); /* asserts that all is there */

/* How many of count simplices (3 leaf ids each) an overflow block of that length holds. Order and
 * interval from *head. */
uint32_t mni_overflow_fit(const mni_overflow *head, const uint32_t *corner, uint32_t count,
                          uint32_t length_bytes);
/* Where the payload of an overflow block with those simplices ends. */
uint32_t mni_overflow_bytes(const mni_overflow *head, const uint32_t *corner, uint32_t count,
                            uint32_t refs);
/* Writes an overflow block's payload and returns where it ends. */
uint32_t mni_overflow_encode(void *bytes, uint32_t length_bytes, uint32_t refs,
                             const mni_overflow *head, const uint32_t *corner, uint32_t count);

/* ---- shared with the rest of the format ------------------------------------------------------ */

bool mni_facts_equal(const mni_facts *a, const mni_facts *b);
/* The least value not below it that the format knows: switch values have 6 significant bits, radii
 * 5. Monotone, so what nests still nests. 0 stays 0; what is past the largest becomes infinite. */
float mni_switch_up(float value);
float mni_radius_up(float value);
/* Steps of a grid: powers of two, so that positions, multiples of the step, are exact as floats. */
bool mni_grid_ok(float step);
/* Does the outer decoded cone hold the inner one, up to slack? */
bool mni_cone_encloses(mn_cone outer, mn_cone inner, double slack_rad);
/* May a node with this sphere have a child with that one? Allows for float rounding. */
bool mni_sphere_encloses(const float position[3], float radius, const float child_position[3],
                         float child_radius);

#endif
