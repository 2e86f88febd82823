/* A cell: a part of the surface that is simplified by itself.
 *
 * Between rounds the surface is records (wire.h): vertices, each with all that simplification knows
 * of it, and simplices. A cell is the vertices that lie next to each other on a curve through
 * space, with the simplices among them. A vertex with a neighbour in another cell is at the border,
 * and stays as it is; the next round cuts the curve elsewhere.
 *
 *     open_dealt or open_taken ── run ── number ── what is left: vertex, simplex … ── close
 *
 * What is made depends on the cell alone: so cells may be taken in any number of threads. One cell
 * belongs to one thread. Memory: while it is opened, the records and the surface made of them;
 * then the surface and what it has made. Paper: §3.1 (spanned sub-meshes). */
#ifndef MNI_CELL_H
#define MNI_CELL_H

#include "deal.h"
#include "simplify.h"
#include "wire.h"

/* A node has the number of its leaf's vertex, or MNI_COLLAPSE + that of its collapse. A hinge has
 * MNI_COLLAPSE + its own, a triangle its place in the file. */
#define MNI_COLLAPSE 0x80000000u

/* A collapse: which nodes became one, with what they had come to. */
typedef struct mni_cell_collapse {
    uint32_t left, right; /* nodes */
    float left_value, right_value;
    float key;
    mni_node_bounds bounds;
    uint32_t left_leaves, right_leaves;
    uint32_t left_split, right_split; /* of these, below the child's own left child; 0: a leaf */
    uint32_t simplices;               /* killed */
} mni_cell_collapse;

typedef struct mni_cell_desc {
    mn_metric metric;
    bool whole;  /* all that is left: every stage, to the last root */
    int stage;   /* otherwise: this one, 1 … 4; whole begins with it */
    float slack; /* stages 1 to 3: by which factor, from 1 on, a collapse may cost more than one
                    beside it that has to wait; INFINITY: none waits but for what is not here */
} mni_cell_desc;

/* What is known of a vertex beside its place on the surface. */
typedef struct mni_cell_node {
    uint32_t id;
    uint32_t node; /* MNI_COLLAPSE + number of a collapse; made: of one made here */
    uint32_t leaves, split, levels; /* as in mni_wire_vertex */
    mni_node_bounds bounds;
} mni_cell_node;

typedef struct mni_cell {
    mni_cell_desc desc;
    mni_simplifier s;
    mni_cell_node *node;
    uint32_t vertices, own; /* own: those of the cell, first; behind them ghosts */
    uint32_t *number;       /* of simplices that were there from the start, triangles first */
    uint32_t triangles, simplices;
    /* Made by a run. */
    mni_cell_collapse *collapse;
    uint32_t collapses;
    uint32_t (*killed)[3]; /* origins of simplices, by collapse */
    uint32_t killed_count;
    uint32_t hinges;
    uint32_t collapses_before, hinges_before; /* in cells before */
} mni_cell;

/* All return MN_FAILED where memory is short; close frees what there is. */

/* Of the first round: vertices are leaves. */
mn_code mni_cell_open_dealt(mni_cell *cell, const mni_cell_desc *desc, const mni_hand *hand,
                            mn_status *st);
/* Records as a round took them, in order. *vertex is freed; *simplex is cut down to the first
 * *passing records: those with a vertex in another cell. */
mn_code mni_cell_open_taken(mni_cell *cell, const mni_cell_desc *desc, mni_wire_vertex **vertex,
                            uint32_t vertices, mni_wire_simplex **simplex, uint32_t simplices,
                            uint32_t *passing, mn_status *st);
mn_code mni_cell_run(mni_cell *cell, mn_status *st);
/* Gives collapses and hinges made here their numbers, after those of the cells before. */
void mni_cell_number(mni_cell *cell, uint32_t collapses, uint32_t hinges);
/* What is left of vertex v: its record but for key and reach. False: nothing, or it is a ghost. */
bool mni_cell_vertex(const mni_cell *cell, uint32_t v, mni_wire_vertex *out);
/* Simplex x of cell->s.surface: its record but for key and places. False: it is gone, or another
 * cell's, which is that of its vertex with the least id. */
bool mni_cell_simplex(const mni_cell *cell, uint32_t x, mni_wire_simplex *out);
void mni_cell_close(mni_cell *cell); /* harmless on a closed one */
/* Bytes that a cell takes at its peak, records included. */
uint64_t mni_cell_bytes(uint64_t vertices, uint64_t simplices);

#endif
