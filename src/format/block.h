/* The meaning of a block: several subtrees of the view-dependence tree, in columns of bits.
 *
 * The decoder hides column widths and bases: callers see indices and values. A view is pointers
 * into the block's bytes and lives only while they stay (a place holder pinned, a file mapped).
 * Threads: a view is read-only; any thread may open its own. Nothing here allocates or blocks.
 * docs/format.md gives the bytes.
 *
 *   block = frame (frame.h: checks, reference table) | block head | columns … | zero padding
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

/* An inner node. Its leaf_lo, leaf_hi and position are its parent's business (a left child has the
 * parent's leaf_lo and position, a right child begins at the parent's leaf_mid). */
typedef struct mni_node {
    mni_facts facts;
    uint32_t leaf_mid;
    float right_position[3]; /* of the right child, that is of leaf leaf_mid */
    uint32_t right_color;    /* RGBA8; 0xffffffff in a model without colours */
    mni_child left, right;
    uint32_t simplex_first, simplex_count; /* killed here; in this block's numbering */
    uint32_t overflow_ref;                 /* reference of the first overflow block, or MN_NONE */
} mni_node;

/* A node with more simplices than its block has room for goes on in overflow blocks: overflow_ref
 * is the first, reference 0 of an overflow block's frame the next, until one has no references.
 * simplex_count counts those in the block itself. */

/* The root of a subtree, with what it has of its parent. */
typedef struct mni_subtree {
    uint32_t node; /* its inner node */
    uint32_t leaf_lo, leaf_hi;
    float position[3];
    uint32_t color;
} mni_subtree;

enum {
    MNI_BLOCK_COLUMNS = 34,      /* the decoder's table */
    MNI_BLOCK_NODES_MAX = 65535, /* inner nodes in a block */
    MNI_BLOCK_EXITS_MAX = 65536, /* children that are SUBTREEs */
    MNI_BLOCK_DEPTH_MAX = 256,   /* levels of a subtree in a block: bounds the checker's stack */
    MNI_BLOCK_TAIL_BYTES = 8, /* zeroes after the last column: the decoder reads 8 bytes at once */
};
typedef struct mni_column {
    const uint8_t *bits;
    uint32_t width; /* bits a value, 0 … 32 */
    uint32_t base;  /* added to what the bits say, modulo 2^32 */
} mni_column;

typedef struct mni_block {
    uint32_t nodes, subtrees, simplices;
    uint32_t exits; /* children that are SUBTREEs */
    bool has_colors;
    mni_column column[MNI_BLOCK_COLUMNS];
} mni_block;

/* Bounds that a block of this file must respect. */
typedef struct mni_block_limits {
    uint32_t leaves, nodes; /* of the file: header.leaves, header.nodes */
    uint64_t file_bytes;
    bool has_colors;
} mni_block_limits;

/* Opens a view of bytes whose frame has been checked, and checks everything in it that one block
 * can show: columns inside the block, children a forest of the subtrees, intervals nested, order
 * ids falling, switch values and radii nested and finite, each simplex with one corner in each
 * child of its node and the third outside the node. false: why (may be NULL) gets one phrase.
 * O(block). */
bool mni_block_open(mni_block *view, const void *bytes, uint32_t length_bytes,
                    const mni_block_limits *limits, char *why, uint32_t why_bytes);
/* As mni_block_open, of bytes that passed it before: decodes the head and checks nothing. O(1). */
void mni_block_reopen(mni_block *view, const void *bytes);

void mni_block_node(const mni_block *view, uint32_t node, mni_node *out);
void mni_block_subtree(const mni_block *view, uint32_t subtree, mni_subtree *out);
/* An exit alone: a child of kind SUBTREE. */
void mni_block_exit(const mni_block *view, uint32_t exit, mni_child *out);
/* Three leaf ids in the input's cyclic order; the third is MN_NONE for a hinge. */
void mni_block_simplex(const mni_block *view, uint32_t simplex, uint32_t corner[3]);

/* ---- overflow blocks ------------------------------------------------------------------------ */

typedef struct mni_overflow {
    uint32_t order, leaf_lo, leaf_mid, leaf_hi; /* of the node whose simplices these are */
    uint32_t simplices;
    mni_column column[3];
} mni_overflow;
/* As mni_block_open. The caller compares order and interval with the node's. */
bool mni_overflow_open(mni_overflow *view, const void *bytes, uint32_t length_bytes,
                       const mni_block_limits *limits, char *why, uint32_t why_bytes);
void mni_overflow_simplex(const mni_overflow *view, uint32_t simplex, uint32_t corner[3]);

/* ---- writing -------------------------------------------------------------------------------- */

/* What a block would take: counts and the range of each column. Adding is exact and cheap, so a
 * filler copies a tally, adds, and keeps the copy if it fits. */
typedef struct mni_tally {
    uint32_t nodes, subtrees, exits, simplices;
    bool has_colors, has_overflow;
    uint32_t min[MNI_BLOCK_COLUMNS], max[MNI_BLOCK_COLUMNS];
} mni_tally;
void mni_tally_init(mni_tally *tally, bool has_colors);
/* Of the children the kinds matter and the facts of SUBTREEs, of the simplices nothing. */
void mni_tally_node(mni_tally *tally, const mni_node *node);
void mni_tally_subtree(mni_tally *tally, const mni_subtree *subtree);
void mni_tally_simplex(mni_tally *tally, const uint32_t corner[3]);
/* Adds all that another tally holds: the sum is as if everything had been tallied in one. */
void mni_tally_merge(mni_tally *tally, const mni_tally *other);
/* Bytes from the block's start to the end of its last column, with that many references. */
uint64_t mni_tally_bytes(const mni_tally *tally, uint32_t refs);

/* Writes a block: begin, then every subtree, node and simplex in the order of the numbering, then
 * the references and the seal (frame.h). bytes[0, length_bytes) is zeroed; the caller's. */
typedef struct mni_encoder {
    mni_block view;
    mni_tally tally;
    uint32_t nodes, subtrees, exits, simplices, killed; /* written so far */
} mni_encoder;
void mni_encoder_begin(mni_encoder *encoder, void *bytes, uint32_t length_bytes,
                       const mni_tally *tally, uint32_t refs);
void mni_encoder_node(mni_encoder *encoder, const mni_node *node);
void mni_encoder_subtree(mni_encoder *encoder, const mni_subtree *subtree);
void mni_encoder_simplex(mni_encoder *encoder, const uint32_t corner[3]);
void mni_encoder_end(mni_encoder *encoder); /* asserts that all is there */

/* How many of count simplices (3 leaf ids each) an overflow block of that length holds. */
uint32_t mni_overflow_fit(const uint32_t *corner, uint32_t count, uint32_t length_bytes);
/* Where the payload of an overflow block with those simplices ends. */
uint32_t mni_overflow_bytes(const uint32_t *corner, uint32_t count, uint32_t refs);
/* Writes an overflow block's payload and returns where it ends. order and interval from *head. */
uint32_t mni_overflow_encode(void *bytes, uint32_t length_bytes, uint32_t refs,
                             const mni_overflow *head, const uint32_t *corner, uint32_t count);

/* ---- shared with the rest of the format -------------------------------------------------------
 */

bool mni_facts_equal(const mni_facts *a, const mni_facts *b);
/* Does the outer decoded cone hold the inner one, up to slack? */
bool mni_cone_encloses(mn_cone outer, mn_cone inner, double slack_rad);
/* May a node with this sphere have a child with that one? Allows for float rounding. */
bool mni_sphere_encloses(const float position[3], float radius, const float child_position[3],
                         float child_radius);

#endif
