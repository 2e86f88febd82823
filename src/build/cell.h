/* A cell: a part of the surface that is simplified by itself, and what goes from round to round.
 *
 * Between rounds the surface is records: vertices, each with all that simplification knows of it,
 * and simplices. A cell is the vertices that lie next to each other on a curve through space, with
 * the simplices among them. A vertex with a neighbour in another cell is at the border, and stays
 * as it is; the next round cuts the curve elsewhere.
 *
 * Nothing in a tree says by which cell a node was made, and what is made depends on the cell alone:
 * so cells may be taken in any number of threads. One cell belongs to one thread. Memory: the room
 * given at open, and about 400 bytes a vertex while it runs. Paper: §3.1 (spanned sub-meshes). */
#ifndef MNI_CELL_H
#define MNI_CELL_H

#include "simplify.h"

/* A node has the number of its leaf's vertex, or MNI_COLLAPSE + that of its collapse. */
#define MNI_COLLAPSE 0x80000000u

typedef struct mni_cell_vertex {
    uint32_t id, node;
    float p[3];
    float value; /* of its node, so far */
    float key;   /* of its node (mni_part) */
    mni_node_bounds bounds;
    uint32_t leaves;    /* below its node */
    uint32_t split;     /* of these, below its left child; 0: it is a leaf */
    uint32_t levels;    /* nodes on the longest way down from its node; of a leaf, 1 */
    bool border, ghost; /* ghost: of another cell, here to be seen */
    bool made;          /* node is of this cell: still without what cells before it have made */
    double quadric[10]; /* c, xx, yy, zz, xy, xz, yz, x, y, z */
    /* Of a leaf: the centres of its own triangles, slack 0. */
    mni_witnesses witness;
} mni_cell_vertex;

typedef struct mni_cell_simplex {
    uint32_t id;        /* triangles: the input's; hinges: MNI_COLLAPSE + their own */
    uint32_t v[3];      /* ids of vertices; a hinge's third is MN_NONE */
    uint32_t origin[3]; /* the input's */
    float p[3][3];      /* of v */
    uint32_t at[3];     /* where v stand in the cell's vertex[]; MN_NONE: not here */
    float normal[3];    /* of the input's triangle, as in mni_judge */
    bool made;
} mni_cell_simplex;

/* A collapse: which nodes became one, with what they had come to. */
typedef struct mni_cell_collapse {
    uint32_t left, right; /* nodes */
    float left_value, right_value;
    float key;
    mni_node_bounds bounds;
    uint32_t left_leaves, right_leaves;
    uint32_t left_split, right_split; /* of these, below the child's own left child; 0: a leaf */
    uint32_t simplices;               /* killed */
    bool left_made, right_made;       /* as in a vertex */
} mni_cell_collapse;

typedef struct mni_cell {
    mni_cell_vertex *vertex;
    uint32_t vertices;
    mni_cell_simplex *simplex; /* triangles first */
    uint32_t simplices, simplices_room;
    /* Made by a run. */
    mni_cell_collapse *collapse;
    uint32_t collapses;
    uint32_t (*killed)[3]; /* origins of simplices, by collapse */
    uint32_t killed_count;
    uint32_t hinges; /* made here: simplices' ids are MNI_COLLAPSE + 0, 1 … */
    mn_build_counts counts;
} mni_cell;

typedef struct mni_cell_desc {
    mn_metric metric;
    bool first;   /* vertices are leaves, and have nothing but id, node, p, border and ghost */
    bool whole;   /* all that is left: every stage, to the last root */
    int stage;    /* otherwise: this one, 1 … 4; whole begins with it */
    double share; /* stage 1: no collapse that costs more than this share of the vertices' first
                     candidates do; from 1 on: no limit */
} mni_cell_desc;

/* Simplifies: vertex and simplex become what is left, without ghosts. MN_FAILED: memory. */
mn_code mni_cell_run(mni_cell *cell, const mni_cell_desc *desc, mn_status *st);
/* Gives collapses and hinges made here their numbers, after those of the cells before. */
void mni_cell_number(mni_cell *cell, uint32_t collapses, uint32_t hinges);

#endif
