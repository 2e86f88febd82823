/* A cell: a part of the surface that is simplified by itself.
 *
 * Between rounds the surface is records (wire.h): vertices, each with all that simplification knows
 * of it, and simplices. A cell is the vertices that lie next to each other on a curve through
 * space, with the simplices among them. A vertex with a neighbour in another cell is at the border,
 * and stays as it is; the next round cuts the curve elsewhere. A simplex between cells passes
 * through that of its first corner. Hubs that are frozen (frozen.h) stand in every cell, behind its
 * vertices, and are nobody's: only the last cell, which has all that is left, makes them its own.
 *
 *     open_dealt or open_taken ── run ── number ── what is left: vertex, simplex … ── close
 *
 * What is made depends on the cell alone: so cells may be taken in any number of threads. One cell
 * belongs to one thread. Memory: while it is opened, the parcels and the surface made of them;
 * then the surface and what it has made. Paper: §3.1 (spanned sub-meshes). */
#ifndef MNI_CELL_H
#define MNI_CELL_H

#include "deal.h"
#include "frozen.h"
#include "simplify.h"
#include "tiles.h"
#include "wire.h"

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
    bool whole;   /* all that is left: every stage, to the last root */
    int stage;    /* otherwise: this one, 1 … 4; whole begins with it */
    double slack; /* stages 1 to 3: by which factor, from 1 on, a collapse may cost more than one
                     beside it that has to wait */
    bool rings;   /* of what waits the rings wait as well, with what costs more */
    const mni_frozen_table *frozen; /* NULL: none; does not change while cells are opened */
    bool carries; /* what hubs come to here is what they are from now on: cells one by one */
    bool points;  /* simplices have been set aside (aside.h): there are none */
    mni_poll poll;
} mni_cell_desc;

/* What is known of a vertex beside its place on the surface. */
typedef struct mni_cell_node {
    uint32_t id;
    uint32_t node; /* MNI_COLLAPSE + number of a collapse; made: of one made here */
    uint32_t leaves, split, levels; /* as in mni_wire_vertex */
    mni_node_bounds bounds;
} mni_cell_node;

/* A simplex whose corners are not all here: at: MN_NONE for those. */
typedef struct mni_cell_passing {
    mni_wire_simplex simplex;
    uint32_t at[3];
} mni_cell_passing;

/* A simplex that is set aside. */
typedef struct mni_aside_simplex {
    uint32_t v[3], origin[3]; /* as in mni_wire_simplex */
} mni_aside_simplex;

typedef struct mni_cell {
    mni_cell_desc desc;
    mni_simplifier s;
    mni_cell_node *node;
    uint32_t vertices, own;        /* own: those of the cell, first; behind them ghosts */
    uint32_t first_hub;            /* and behind them hubs, in the table's order */
    mni_wire_vertex *hub_leaf;     /* dealt: of each hub, what the cell's triangles make of it */
    uint32_t triangles, simplices; /* that were there from the start */
    mni_cell_passing *passing;
    uint32_t passing_count;
    mni_aside_simplex *aside;
    uint32_t aside_count;
    uint32_t inside; /* vertices with all of their ring here, hubs apart, when it was opened */
    /* Made by a run. */
    mni_cell_collapse *collapse;
    uint32_t collapses;
    uint32_t (*killed)[3]; /* origins of simplices, by collapse */
    uint32_t killed_count;
    uint32_t hinges;
    uint32_t could_go[MNI_LEVELS]; /* without rings: as in mni_part */
    uint32_t collapses_before;     /* in cells before */
} mni_cell;

/* All return MN_FAILED where memory is short; close frees what there is. */

/* Of the first round: vertices are leaves. */
mn_code mni_cell_open_dealt(mni_cell *cell, const mni_cell_desc *desc, const mni_hand *hand,
                            mn_status *st);
/* Of a later round; step: as the parcels were written with. */
mn_code mni_cell_open_taken(mni_cell *cell, const mni_cell_desc *desc, const mni_crate *crate,
                            float step, mn_status *st);
mn_code mni_cell_run(mni_cell *cell, mn_status *st);
/* Sets aside what is left among hubs alone, where there is much of it. MN_FAILED: memory. */
mn_code mni_cell_set_aside(mni_cell *cell, mn_status *st);
/* Gives collapses made here their numbers, after those of the cells before. */
void mni_cell_number(mni_cell *cell, uint32_t collapses);
/* Gives back what it has made, once that is kept elsewhere. */
void mni_cell_forget(mni_cell *cell);
/* What is left of vertex v: its record but for its reach. False: nothing, or it is a ghost. */
bool mni_cell_vertex(const mni_cell *cell, uint32_t v, mni_wire_vertex *out);
/* Whether simplex x of cell->s.surface, which is there still, is this cell's: it is that of its
 * vertex with the least id, hubs apart. */
bool mni_cell_has_simplex(const mni_cell *cell, uint32_t x);
/* Its record; where its corners are only if it reaches other tiles. */
void mni_cell_simplex(const mni_cell *cell, uint32_t x, mni_wire_reach reach,
                      mni_wire_simplex *out);
/* What frozen hubs have come to in a cell that has been given its numbers. */
void mni_cell_tell_hubs(const mni_cell *cell, mni_frozen_table *to);
void mni_cell_close(mni_cell *cell); /* harmless on a closed one */
/* Bytes that a cell takes at its peak, what it is opened from included: parcels of so many bytes;
 * a hand. Hubs count as vertices. */
uint64_t mni_cell_bytes(uint64_t vertices, uint64_t simplices, uint64_t parcels);
uint64_t mni_cell_dealt_bytes(uint64_t vertices, uint64_t triangles);

#endif
