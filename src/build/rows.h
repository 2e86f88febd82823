/* A tree in rows, leaf by leaf: the form in which it stands in a .vdt and is cut into blocks.
 *
 * Row i holds leaf i, and the inner node whose right child begins with it (leaf_mid = i): a tree of
 * n leaves has n - 1 inner nodes, one for each leaf but the first. What is below a node is one run
 * of rows, and its simplices one run of theirs:
 *
 *     leaf          0   1   2   3   4   5            node of row 2: leaves [0, 6), its left child
 *     inner node    –   a   R   c   b   d            is row 1's, [0, 2), its right child row 4's,
 *                       └─2─┘   └─2─┴─2─┘            [2, 6). Row 0 has none: there a root begins
 *
 * So who works on a part of the model reads a part of the files. Nodes are called by their rows.
 *
 * Rows lie in memory, or in files of which so many pages are kept. One thread; calls on files
 * block, and what they cannot read is told by mni_rows_trouble. Paper: §3.2. */
#ifndef MNI_ROWS_H
#define MNI_ROWS_H

#include "metanode/build.h"

typedef struct mni_row {
    float position[3]; /* of the leaf */
    uint32_t rgba;     /* of the leaf; 0xffffffff in a model without colours */
    uint32_t order;    /* order id of the inner node; 0: there is none */
    uint32_t leaf_lo, leaf_hi;
    uint32_t left, right; /* rows of its children; MN_NONE: a leaf */
    float switch_value, radius;
    uint32_t simplex_start; /* the first of its simplices; they end where the next row's start */
    mn_cone cone;
    uint8_t zero;
} mni_row;
_Static_assert(sizeof(mni_row) == 52, "no padding: rows are written as they are");

/* Three leaf ids, as in mn_tree.corner. */
typedef struct mni_row_simplex {
    uint32_t corner[3];
} mni_row_simplex;

#endif
