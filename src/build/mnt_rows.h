/* A walk (walk.h) over the blocks of a .mnt, each of which is read once.
 *
 *   open ── walk × n ── close
 *
 * What is handed out has been checked against its own block and its parent's. Memory: open blocks,
 * one a level, and a bit a node, within the cap. */
#ifndef MNI_MNT_ROWS_H
#define MNI_MNT_ROWS_H

#include "block.h"
#include "extents.h"
#include "walk.h"

typedef struct mni_mnt {
    const char *path; /* the caller's */
    mn_header header; /* what all walks go by, whatever becomes of the file */
    mni_stored stored;
} mni_mnt;
/* Reads and checks the header. */
mn_code mni_mnt_open(mni_mnt *mnt, const char *path, mn_status *st);
void mni_mnt_close(mni_mnt *mnt); /* harmless on one that failed to open */
/* What it says of the tree: counts and facts. */
mn_tree mni_mnt_head(const mni_mnt *mnt);

/* What the cap must have room for beside the program and held_bytes; less may do. */
uint64_t mni_mnt_walk_bytes(const mn_header *header);
/* MN_BAD_INPUT names the first thing that is wrong; MN_CAP_TOO_SMALL, what would do. */
mn_code mni_mnt_walk(mni_mnt *mnt, const mni_walk_desc *desc, const mni_walk_sink *sink,
                     mn_status *st);

#endif
