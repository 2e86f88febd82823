/* The rows of a tree in a file, a .mnt or a .vdt, leaf by leaf, believing nothing.
 *
 *   open ── walk × n ── close
 *
 * A walk hands out what stands in the file in the order of leaves (rows.h): nothing is sorted, and
 * nothing is on the disk. What is handed out has been checked against its node's parent; that the
 * file as a whole is sound is known when a walk over all of it has ended well. One thread; calls
 * block on the disk. Memory: that of the way from a root down, and buffers, within the cap. */
#ifndef MNI_WALK_H
#define MNI_WALK_H

#include "rows.h"

/* Who takes what is handed out; either may be NULL. What they return, if it is not MN_OK, ends the
 * walk. */
typedef struct mni_walk_sink {
    /* Row `at`; child: the order ids of its node's children (a leaf's is its number), NULL where a
     * root begins. Of `left` and `right` only whether they are MN_NONE is of use. */
    mn_code (*row)(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]);
    /* Of the row that came last. */
    mn_code (*simplex)(void *context, const mni_row_simplex *simplex);
    void *context;
} mni_walk_sink;

typedef struct mni_walk_desc {
    uint64_t ram_bytes;  /* of the process; 0: no bound */
    uint64_t held_bytes; /* of them, what the caller has */
    /* Is the subtree of the node of that order id to be gone through? Others are left out, or not;
     * and nothing is asked of the file as a whole. NULL: everything. context: the sink's */
    bool (*wanted)(const void *context, uint32_t order);
    const mn_watch *watch;
    const char *phase; /* what it is told */
} mni_walk_desc;

/* A file that is walked. */
typedef struct mni_walked {
    const char *path; /* the caller's */
    mn_tree head;     /* counts and facts: what all walks go by, whatever becomes of the file */
    bool has_colors;
    uint32_t blocks;     /* of a .mnt */
    struct mni_mnt *mnt; /* NULL: a .vdt */
    mn_vdt *vdt;         /* NULL: a .mnt */
} mni_walked;

/* Reads and checks the header; of a .vdt all of the file, once, for its checksums. */
mn_code mni_walked_open(mni_walked *w, const char *path, const mn_watch *watch, mn_status *st);
void mni_walked_close(mni_walked *w); /* harmless on one that failed to open */
/* What the cap must have room for beside the program and held_bytes; less may do. */
uint64_t mni_walk_bytes(const mni_walked *w);
/* MN_BAD_INPUT names the first thing that is wrong; MN_CAP_TOO_SMALL, what would do. */
mn_code mni_walk_file(mni_walked *w, const mni_walk_desc *desc, const mni_walk_sink *sink,
                      mn_status *st);

#endif
