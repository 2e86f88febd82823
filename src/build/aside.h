/* Simplices that are set aside, and what becomes of them: where a model cannot be cut.
 *
 * Rounds end because what is left fits a cell at last. Two things may not: triangles among hubs
 * alone (a pencil's hundred thousands, which no vertex in a cell holds), and vertices each of which
 * is joined to places all over the model. Then simplices go aside, to the disk, as they are:
 *
 *   hubs' own     where a cell is left with many of them; their hubs count as points from then on
 *   all           when cells would grow past what they may. The vertices that are left are joined
 *                 as roots are, nearest first, in cells of as many vertices as they like
 *
 * What a simplex needs of a tree is where it dies: the first collapse that joins two of its
 * corners. That is known of the tree alone, so it is asked when all is over, in one pass over the
 * simplices, with who went into whom in memory:
 *
 *   aside  (a b c) ──► climb: whose next collapse comes first? ──► (collapse, simplex) ──► sort
 *   late   collapses, in order ──────────────────────────────────────────┴──► history
 *
 * A triangle that dies leaves a hinge to its third corner, one for all that died in one collapse
 * with that corner: more than are needed where other simplices join them, never fewer.
 *
 * Errors: nobody measures what is aside. So a node's switch value is not less than its radius from
 * then on: no point of the input beneath it is farther from the node than that, wherever else its
 * triangles' corners go. (A point alone is part of any star.)
 *
 * Order of calls: open; add in the order of cells; put, all parcels; late, in the order of cells;
 * finish, close. One thread at a time.
 * Memory: a buffer; in finish 28 bytes a late collapse, and sorts. */
#ifndef MNI_ASIDE_H
#define MNI_ASIDE_H

#include "history.h"
#include "spill.h"

typedef struct mni_aside {
    mni_spill simplex, late;
    uint64_t count;
    uint32_t late_count; /* collapses since all simplices are aside, until the history has them */
    bool all;            /* they are */
    unsigned char *buffer;
    mni_spill_writer put_simplex, put_late;
} mni_aside;

#define MNI_ASIDE_CLOSED                                                                           \
    (mni_aside) {                                                                                  \
        .simplex = {.fd = -1}, .late = {.fd = -1 }                                                 \
    }
/* temp_dir outlives it. */
mn_code mni_aside_open(mni_aside *aside, const char *temp_dir, mn_status *st);
void mni_aside_close(mni_aside *aside); /* harmless on a closed one */
/* The least that finish takes after so many late collapses. */
uint64_t mni_aside_least(uint64_t collapses);
/* A parcel's simplices, written on that grid. */
mn_code mni_aside_put(mni_aside *aside, const mni_parcel *head, const unsigned char *simplices,
                      float grid, mn_status *st);
/* What a cell has set aside. */
mn_code mni_aside_add(mni_aside *aside, const mni_cell *cell, mn_status *st);
/* A cell that has its numbers, when all is aside: what it has made waits for finish. */
mn_code mni_aside_late(mni_aside *aside, const mni_cell *cell, mn_status *st);
/* One root is left: late collapses go to the history, with what they kill. work_bytes: 0: as much
 * as it takes; at least mni_aside_least. */
mn_code mni_aside_finish(mni_aside *aside, mni_history *history, uint64_t work_bytes,
                         const char *temp_dir, const mni_poll *poll, mn_status *st);

#endif
