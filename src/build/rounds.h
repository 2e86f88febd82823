/* Simplification in rounds: the surface in records outside of memory, a few cells at a time inside.
 *
 * Each round sorts the vertices along a curve (curve.h), cuts it into cells of so many, and
 * simplifies each by itself (cell.h), down to a share of what it could do, so that neither the cuts
 * nor the depth of one cell can be seen. What is left goes on to the next round, whose curve is
 * cut elsewhere, until all of it fits one cell:
 *
 *      round 0 ──► sort ──► cells ──► round 1 ──► sort ──► cells ──► …  ──► one cell, to the roots
 *                             │                              │                 │
 *                             └──────────► collapses and killed simplices ◄────┘
 *
 * Order of collapses: inside a cell cheapest first; none with a cheaper legal one beside it that is
 * put off. Afterwards all are put in the order of their keys, the largest cost that each has waited
 * for: so a collapse of a late round that was cheap stands among the cheap ones.
 * What comes out depends on the mesh and the options, never on memory or the number of threads.
 *
 * One call, which starts its threads and ends them; it blocks on temporary files. Memory: the mesh
 * and the tree, 8 bytes a vertex, cells and sorts within what ram_bytes leaves.
 * Paper: §3.1; design.md §3.3. */
#ifndef MNI_ROUNDS_H
#define MNI_ROUNDS_H

#include "cell.h"

enum { MNI_CELL_VERTICES = 8192 };

typedef struct mni_rounds_desc {
    mn_metric metric;
    uint32_t cell_vertices; /* 0: MNI_CELL_VERTICES */
    uint32_t threads;       /* 0: 1; at most 64 are used */
    uint64_t ram_bytes;     /* of the process, the mesh in it; 0: as much as keeps off the disk */
    const char *temp_dir;
    mn_progress progress;
    void *progress_context;
} mni_rounds_desc;

/* What the process needs at least, with one thread, the mesh and the tree in memory. */
uint64_t mni_rounds_need_bytes(uint64_t vertices, uint64_t triangles);
/* MN_FAILED: memory, or "interrupted". MN_NO_SPACE: temporary files filled the disk.
 * MN_CAP_TOO_SMALL: cells had to grow past what ram_bytes has room for. */
mn_code mni_rounds(const mn_mesh *mesh, const mni_rounds_desc *desc, mn_tree *out, mn_status *st);

#endif
