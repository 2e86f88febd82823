/* What is left of a cell, given to the tiles of the next round.
 *
 * Called once a cell has run and has its number; any thread. Memory: 12 bytes a vertex, 8 a vertex
 * and a simplex that are left, and a parcel. */
#ifndef MNI_GIVE_H
#define MNI_GIVE_H

#include "cell.h"
#include "curve.h"

typedef struct mni_outlet {
    const mni_curve *curve; /* of the tiles */
    mni_tiles *tiles;
    float step;      /* of the grid; 0: there is none */
    uint32_t source; /* the cell's number */
} mni_outlet;

/* MN_FAILED: no memory. Whether the disk was full the tiles tell. */
mn_code mni_give(const mni_outlet *outlet, const mni_cell *cell, mn_status *st);

#endif
