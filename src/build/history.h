/* What rounds have made, in files of its own until a tree is made of it. */
#ifndef MNI_HISTORY_H
#define MNI_HISTORY_H

#include "cell.h"
#include "spill.h"

typedef struct mni_history {
    mni_spill collapse,
        killed; /* mni_cell_collapse; three ids each. In the order of their making */
    uint32_t collapses, killed_count, hinges;
    float root_value;
    uint32_t root_levels; /* nodes on the longest way down */
    mn_build_counts counts;
    uint64_t bytes_read, bytes_written; /* of temporary files, while it was made */
} mni_history;

/* keep: as kept spills. */
mn_code mni_history_open(mni_history *history, const char *temp_dir, bool keep, mn_status *st);
void mni_history_close(mni_history *history); /* harmless on a closed one */
/* A cell that has been given its numbers. */
mn_code mni_history_add(mni_history *history, const mni_cell *cell, mn_status *st);
/* The tree of one root. vertex_of: of an id, the mesh's vertex. Memory: the tree, 16 bytes a
 * vertex, and a buffer. */
mn_code mni_history_tree(mni_history *history, const mn_mesh *mesh, const uint32_t *vertex_of,
                         mn_tree *out, mn_status *st);

#endif
