/* What rounds have made, in files of its own until a tree is made of it.
 *
 *   open ── add × n ── end ── groups, in any order ── close
 *
 * Collapses and killed simplices are kept in the order of their making, in few bytes: a cell's
 * numbers are near each other. Groups of MNI_HISTORY_GROUP collapses can be read each by itself.
 * Memory: three small buffers. One thread at a time. */
#ifndef MNI_HISTORY_H
#define MNI_HISTORY_H

#include "cell.h"
#include "spill.h"

enum { MNI_HISTORY_GROUP = 4096 };

typedef struct mni_history {
    mni_spill collapse, killed, group; /* packed; group: where each begins in the other two */
    uint32_t collapses, killed_count, hinges;
    float root_value;
    uint32_t root_levels; /* nodes on the longest way down */
    mn_build_counts counts;
    uint64_t bytes_read, bytes_written; /* of temporary files, while it was made */
    /* of what was put last in this group: what comes next is told by how it differs */
    uint32_t last_leaf, last_key, last_corner;
    unsigned char *pending[3]; /* put, not yet in a spill; by spill */
    uint32_t pending_bytes[3];
} mni_history;

#define MNI_HISTORY_CLOSED                                                                         \
    (mni_history) {                                                                                \
        .collapse = {.fd = -1}, .killed = {.fd = -1}, .group = {.fd = -1 }                         \
    }
/* keep: as kept spills. */
mn_code mni_history_open(mni_history *history, const char *temp_dir, bool keep, mn_status *st);
void mni_history_close(mni_history *history); /* harmless on a closed one */
/* A cell that has been given its numbers. */
mn_code mni_history_add(mni_history *history, const mni_cell *cell, mn_status *st);
/* The same piece by piece: begin, killed × n, then the collapse that killed so many; what is
 * counted is the caller's. Whether the disk was full is told by end. */
void mni_history_begin(mni_history *history);
void mni_history_add_killed(mni_history *history, const uint32_t corner[3]);
void mni_history_add_collapse(mni_history *history, const mni_cell_collapse *collapse);
/* Of a cell, what is counted, its collapses and simplices apart. */
void mni_history_count(mni_history *history, const mni_cell *cell);
/* All has been added: before anything is read. */
mn_code mni_history_end(mni_history *history, mn_status *st);

/* ---- reading ------------------------------------------------------------------------------- */

/* A collapse as it is kept. Switch values are rounded up to what files hold. */
typedef struct mni_history_collapse {
    uint32_t left, right;                                        /* as in mni_cell_collapse */
    uint32_t left_leaves, right_leaves, left_split, right_split; /* likewise */
    uint32_t key;                                                /* its bits */
    uint32_t simplices;
    uint64_t facts; /* radius, cone, switch values of left and right */
} mni_history_collapse;

enum { MNI_FACTS_VALUE_BITS = 13 };
/* Facts, from the lowest bit: switch value of the left child, of the right one, radius and cone of
 * the node: floats as their bits, without those that are always 0. */
static inline uint32_t mni_facts_left_value(uint64_t facts) {
    return facts & 0x1fff;
}
static inline uint32_t mni_facts_right_value(uint64_t facts) {
    return facts >> 13 & 0x1fff;
}
/* Radius and cone. */
static inline uint64_t mni_facts_bounds(uint64_t facts) {
    return facts >> 26;
}
uint32_t mni_facts_value(float value); /* a switch value, rounded up, in 13 bits */
float mni_facts_value_of(uint32_t bits);
float mni_facts_radius_of(uint64_t bounds);
mn_cone mni_facts_cone_of(uint64_t bounds);

/* Reads one group, of collapses or of the simplices that they killed, from front to back. */
typedef struct mni_history_reader {
    mni_spill *spill;
    uint64_t next, end; /* of the spill: not in the buffer yet */
    const unsigned char *at, *limit;
    unsigned char *buffer;
    size_t buffer_bytes;
    uint32_t number, last_leaf, last_key, last_corner;
} mni_history_reader;

enum { MNI_HISTORY_BUFFER_MIN = 1024 };
/* The caller's buffer; nothing else is taken. */
mn_code mni_history_group(mni_history_reader *r, mni_history *history, uint32_t group, void *buffer,
                          size_t buffer_bytes, mn_status *st);
mn_code mni_history_group_killed(mni_history_reader *r, mni_history *history, uint32_t group,
                                 void *buffer, size_t buffer_bytes, mn_status *st);
/* As many as there are, and no more; false: the spill has failed. */
bool mni_history_next(mni_history_reader *r, mni_history_collapse *out);
/* Three ids; a hinge's last is MN_NONE. */
bool mni_history_next_killed(mni_history_reader *r, uint32_t corner[3]);

/* ---- a tree in memory ----------------------------------------------------------------------- */

/* The tree of one root. vertex_of: of an id, the mesh's vertex. Memory: the tree, 16 bytes a
 * vertex, and a buffer. */
mn_code mni_history_tree(mni_history *history, const mn_mesh *mesh, const uint32_t *vertex_of,
                         mn_tree *out, mn_status *st);

#endif
