/* Simplification in rounds: the surface in records outside of memory, a few cells at a time inside.
 *
 * Each round cuts a curve through space (curve.h) into cells of so many vertices, and simplifies
 * each by itself (cell.h) as far as it can without what lies in other cells. What is left goes on
 * to the next round, whose curve is cut elsewhere, until all of it fits one cell:
 *
 *      mesh ──► deal ──► cells ──► sort ──► cells ──► sort ──► …  ──► one cell, to the roots
 *                          │                  │                          │
 *                          └───► collapses and killed simplices ◄────────┘
 *
 * Order of collapses: inside a cell cheapest first; none with a cheaper legal one beside it that is
 * put off. Afterwards all are put in the order of their keys, the largest cost that each has waited
 * for: so a collapse of a late round that was cheap stands among the cheap ones.
 * Vertices of too many simplices for a cell are frozen.h's: their simplices go where the other
 * corners go. Once rounds do nothing more in any order, one carries these hubs through its cells,
 * one after the other, so that what is left at them can go into them. What cannot be cut at all is
 * set aside (aside.h).
 * What comes out depends on the mesh and the options, never on memory or the number of threads.
 *
 * One call, which starts its threads and ends them; it blocks on temporary files. Memory: cells and
 * sorts within work_bytes, nothing that grows with the mesh.
 * Paper: §3.1; design.md §3.3. */
#ifndef MNI_ROUNDS_H
#define MNI_ROUNDS_H

#include "extmesh.h"
#include "history.h"

enum { MNI_CELL_VERTICES = 8192 };

typedef struct mni_rounds_desc {
    mn_metric metric;
    uint32_t cell_vertices;      /* 0: MNI_CELL_VERTICES; the tree depends on it */
    uint32_t threads;            /* 0: 1; fewer are used where memory has no room for their cells */
    uint64_t work_bytes;         /* all that is taken; 0: as much as keeps off the disk */
    mni_cap cap;                 /* of which it is: for the number that a refusal names */
    uint32_t cell_vertices_most; /* with that cap: 0: cell_vertices */
    const char *temp_dir;        /* outlives *out */
    bool keep;                   /* *out is of kept spills */
    mn_progress progress;
    void *progress_context;
} mni_rounds_desc;

/* The least work_bytes, for one thread. */
uint64_t mni_rounds_work_min(uint32_t cell_vertices);
/* For tests of little memory: the largest cells that so much is enough for, of cell_vertices (0:
 * MNI_CELL_VERTICES), half as many and so on; 0: any. */
uint32_t mni_rounds_cells_for(uint32_t cell_vertices, uint64_t work_bytes);
/* Collapses the mesh to one root. It is read, not changed. *out is the caller's to close; on
 * failure it is closed. MN_FAILED: memory, or "interrupted". MN_NO_SPACE: temporary files filled
 * the disk. MN_CAP_TOO_SMALL: cells had to grow past what work_bytes has room for. */
mn_code mni_rounds(mni_extmesh *mesh, const mni_rounds_desc *desc, mni_history *out, mn_status *st);

#endif
