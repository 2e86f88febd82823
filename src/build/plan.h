/* Which node goes into which block: what the two policies fill in and block_write.c writes out.
 *
 * Inner nodes are indices here: order id - leaves. Blocks are numbered as they are planned; the
 * blocks that one block refers to stand together, in the order of its reference table: child
 * blocks, then the first overflow blocks of its nodes in the order of the nodes.
 * Ownership: all arrays are the plan's, proportional to the tree. One thread. */
#ifndef MNI_PLAN_H
#define MNI_PLAN_H

#include "block.h"
#include "metanode/build.h"

typedef struct mni_planned {
    bool is_overflow;
    uint32_t parent;                   /* the block that refers to it; MN_NONE: a root block */
    uint32_t child_first, child_count; /* the blocks it refers to */
    uint32_t depth;                  /* blocks down to it, itself included; overflow: its owner's */
    uint32_t root_first, root_count; /* subtrees, in plan.root, by leaf_lo */
    uint32_t small; /* the policy's: subtrees of at most so many nodes go with their parent */
    uint32_t nodes;
    uint32_t node;                     /* overflow: whose simplices these are */
    uint32_t simplex_first, simplices; /* overflow: in tree.corner */
    uint32_t payload_bytes;
    mn_block_ref place;
} mni_planned;

typedef struct mni_plan_root {
    uint32_t node;
    uint32_t leaf_lo;
} mni_plan_root;

typedef struct mni_plan {
    const mn_tree *tree;
    const mn_block_desc *desc;
    uint32_t simplices_max;  /* of one node in its own block; more overflow */
    uint32_t overflow_bytes; /* length of an overflow block, at most */
    uint32_t *block_of;      /* inner: planned block, MN_NONE: not yet */
    uint32_t *index;         /* inner: place in its block's numbering, once listed */
    uint32_t overflow_max;   /* longest chain so far */
    mni_planned *block;
    uint32_t blocks, blocks_capacity;
    mni_plan_root *root;
    uint32_t roots, roots_capacity;
    uint32_t *list; /* nodes of one block, in its numbering: MNI_BLOCK_NODES_MAX */
    uint32_t listed;
} mni_plan;

mn_code mni_plan_open(mni_plan *plan, const mn_tree *tree, const mn_block_desc *desc,
                      mn_status *st);
void mni_plan_close(mni_plan *plan);

/* The policies: assign every inner node to a block and finish every block. */
mn_code mni_plan_levels(mni_plan *plan, mn_status *st);
mn_code mni_plan_packed(mni_plan *plan, mn_status *st);

/* A new block below parent (MN_NONE: a root block); roots are added to the newest block only. */
mn_code mni_plan_block(mni_plan *plan, uint32_t parent, uint32_t *block, mn_status *st);
mn_code mni_plan_root_add(mni_plan *plan, mni_plan_root root, mn_status *st);
/* The inner child of a node on that side (0 left, 1 right), or MN_NONE where it is a leaf. */
uint32_t mni_plan_child(const mn_tree *tree, uint32_t node, uint32_t side);
/* Lists a block's nodes in its numbering, from its roots and block_of. */
void mni_plan_list(mni_plan *plan, uint32_t block);
/* After the child blocks of the listed block have been planned: adds the overflow blocks of its
 * nodes. */
mn_code mni_plan_overflow(mni_plan *plan, uint32_t block, mn_status *st);
/* The exact tally of the listed block, whose references are all planned. */
void mni_plan_tally(mni_plan *plan, uint32_t block, mni_tally *tally);

/* Records as they stand in blocks. Children are INNER where block_of says the same block, SUBTREE
 * otherwise, their place in the child block not looked up. */
void mni_plan_node(const mni_plan *plan, uint32_t node, mni_node *out);
void mni_plan_subtree(const mni_plan *plan, const mni_plan_root *root, mni_subtree *out);
void mni_plan_leaf(const mn_tree *tree, uint32_t leaf, float position[3], uint32_t *color);
mni_overflow mni_plan_overflow_head(const mn_tree *tree, uint32_t node); /* order and interval */
/* Simplex s of the tree, killed by node: turned so that the corner outside the node comes last. */
void mni_plan_simplex(const mn_tree *tree, uint32_t node, uint32_t s, uint32_t corner[3]);
uint32_t mni_plan_simplices(const mni_plan *plan, uint32_t node); /* in the node's own block */

#endif
