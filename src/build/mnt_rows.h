/* The rows of a .mnt (rows.h), leaf by leaf, straight from its blocks, believing nothing.
 *
 *   open ── walk × n ── close
 *
 * A walk reads each block once and hands out what stands in it in the order of leaves, which is
 * that of a .vdt: nothing is sorted, and nothing is on the disk. What is handed out has been
 * checked against its own block and its parent's; that the file as a whole is sound is known when
 * the walk has ended well. One thread; calls block on the disk. Memory: open blocks, one a level,
 * and a bit a node, within the cap. */
#ifndef MNI_MNT_ROWS_H
#define MNI_MNT_ROWS_H

#include "block.h"
#include "extents.h"
#include "rows.h"

typedef struct mni_mnt {
    const char *path; /* the caller's */
    mn_header header; /* what all walks go by, whatever becomes of the file */
    mni_stored stored;
} mni_mnt;
/* Reads and checks the header. */
mn_code mni_mnt_open(mni_mnt *mnt, const char *path, mn_status *st);
void mni_mnt_close(mni_mnt *mnt); /* harmless on one that failed to open */

/* Who takes what is handed out; either may be NULL. What they return, if it is not MN_OK, ends the
 * walk. */
typedef struct mni_mnt_sink {
    /* Row `at`; node: its inner node, NULL where a root begins. The row's `right` is known though
     * it comes later; where a child was left out, what would be its row is MN_NONE. */
    mn_code (*row)(void *context, uint32_t at, const mni_row *row, const mni_node *node);
    /* Of the row that came last. */
    mn_code (*simplex)(void *context, const mni_row_simplex *simplex);
    void *context;
} mni_mnt_sink;

typedef struct mni_mnt_desc {
    uint64_t ram_bytes;  /* of the process; 0: no bound */
    uint64_t held_bytes; /* of them, what the caller has */
    uint32_t order_from; /* subtrees of nodes below are left out; then nothing is asked of the file
                            as a whole. 0: everything */
    const mn_watch *watch;
    const char *phase; /* what it is told */
} mni_mnt_desc;

/* What the cap must have room for beside the program and held_bytes; less may do. */
uint64_t mni_mnt_walk_bytes(const mn_header *header);
/* MN_BAD_INPUT names the first thing that is wrong; MN_CAP_TOO_SMALL, what would do. */
mn_code mni_mnt_walk(mni_mnt *mnt, const mni_mnt_desc *desc, const mni_mnt_sink *sink,
                     mn_status *st);

#endif
