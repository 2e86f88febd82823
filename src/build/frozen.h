/* Frozen hubs: vertices whose simplices are too many for a cell (rounds.h).
 *
 * A cell holds all simplices of its vertices, so a vertex of 300,000 triangles would need a cell
 * for them all. So it belongs to no cell. Its record lies here, in memory, and each cell has it as
 * a corner of those of its simplices that the cell holds:
 *
 *             h                    the rim x0 … x9 is cut into cells as any other vertices are,
 *          / /|\ \                 h not counting as anybody's neighbour; a triangle (h, x1, x2)
 *        /  / | \  \               goes where x1 and x2 go. Whether x1 → x2 is legal is seen from
 *      x0 x1 x2 x3 x4 …            the stars of x1 and x2, which are in their cell with h in them
 *      └─ cell ─┘└─ cell           as in any
 *
 * What goes into h itself waits as for any vertex that is not here. In rounds in which nothing else
 * can be done h is carried from cell to cell, one after the other: there a vertex may go into it
 * whose ring is all in the cell. h goes into nobody until all that is left fits one cell; then it
 * is a vertex like others.
 *
 * One table is read while a round goes on; what cells tell goes into another, in the order of
 * cells. One thread at a time. Memory: 272 bytes a hub in each. */
#ifndef MNI_FROZEN_H
#define MNI_FROZEN_H

#include "deal.h"
#include "wire.h"

typedef struct mni_frozen {
    mni_wire_vertex is; /* its record; nobody asks how far it reaches */
    float around;       /* the largest of its neighbours' keys so far (mni_part) */
    bool seen;          /* is.bounds are of something */
    bool aside;         /* simplices of it are (aside.h): its value is at least its radius */
} mni_frozen;

typedef struct mni_frozen_table {
    mni_frozen *hub; /* by id */
    uint32_t count;
} mni_frozen_table;

/* Leaves of which nothing is known but id and place, in the order of ids; false: no memory. */
bool mni_frozen_open(mni_frozen_table *table, const mni_ghost *hub, uint32_t count);
void mni_frozen_close(mni_frozen_table *table); /* harmless on a closed one */
/* What is known of the hubs of *from, which is as long. */
void mni_frozen_copy(mni_frozen_table *to, const mni_frozen_table *from);
/* Which one it is; MN_NONE: none. */
uint32_t mni_frozen_find(const mni_frozen_table *table, uint32_t id);
/* Quadric, bounds and witnesses of a part of a leaf's triangles, in parts that do not overlap. */
void mni_frozen_add(mni_frozen *to, const mni_wire_vertex *part);
/* What both have risen to in a cell. */
void mni_frozen_raise(mni_frozen *to, float value, float around);

#endif
