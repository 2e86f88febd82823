/* What the store's tests share: a made file of blocks without meshes, and a walker that uses a
 * store over it as Navigate does: splits with forced ones whole or not at all, collapses, frames.
 *
 * The made tree: subtrees in blocks. A subtree is absent (0), one node (1), or opened (2): then it
 * has `own` nodes in its block and one more there for each child subtree that is absent. */
#ifndef WALK_H
#define WALK_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"
#include "store.h"

typedef struct made_desc {
    uint64_t seed;
    uint32_t blocks;       /* meta-node blocks */
    uint32_t depth_max;    /* of the block tree */
    uint32_t fanout_max;   /* child subtrees of a subtree */
    uint32_t pages_max;    /* of a block */
    uint32_t overflow_max; /* longest chain; 0: none */
    uint32_t roots;        /* 0: 1 */
    mn_blocking blocking;
    bool regular; /* each block has fanout_max children, down to the depth, one subtree a block */
} made_desc;

typedef struct made_subtree {
    uint32_t block, parent; /* MN_NONE: a root */
    uint32_t first_child, children;
    uint32_t own;
    uint32_t overflow; /* blocks of its chain, needed to open it */
} made_subtree;

typedef struct made_block {
    mn_block_ref ref;
    uint32_t parent; /* block; MN_NONE: a root block */
    uint32_t depth;
    uint32_t overflow_of; /* subtree that goes on here, or MN_NONE */
} made_block;

typedef struct made_file {
    char path[64];
    mn_header header;
    made_block *block;
    uint32_t blocks;
    made_subtree *subtree; /* parents first; children of one are neighbours */
    uint32_t subtrees;
} made_file;

void made_file_make(made_file *file, const made_desc *desc);
void made_file_damage(const made_file *file, uint32_t block); /* turns one bit over */
void made_file_free(made_file *file);                         /* and removes it */
/* Content check of such a file's blocks, for mni_store_desc.check. */
bool made_check(const void *context, const void *bytes, uint32_t length_bytes);
/* What a camera (the look: its number) wants of a block's references, for mni_store_desc.rate. */
void made_rate(const void *context, const void *look, const void *bytes, const mni_notes *notes,
               float least, float *urgency, mni_notes *below);

typedef struct walker {
    made_file *file;
    mni_arena arena;
    mni_store *store;
    uint8_t *state;     /* a subtree */
    uint8_t *want;      /* a subtree, of the camera */
    uint64_t *given_up; /* a subtree: epoch + 1 in which it was refused; 0: not */
    mni_entry *entry;   /* a block */
    uint32_t *owner;    /* an entry: its block */
    uint32_t *recount;  /* a block: nodes in it */
    uint64_t camera;
    bool moved;                        /* in the last frame */
    uint32_t misses, changes, refused; /* of the last frame */
    bool check_each_step, check_each_frame;
    bool foresees;    /* looks, foresight, early switches, and seeking: MN_PREFETCH_AHEAD */
    mn_status status; /* of the opening */
} walker;

/* desc: kind, k, io …; path, header, check, rate are filled in. false: walker.status says why. */
bool walker_open(walker *w, made_file *file, mni_store_desc desc);
void walker_frame(walker *w, uint64_t camera, double frame_s); /* camera 0: to the roots */
/* Frames with a standing camera until quiet; the number, or frames_max. */
uint32_t walker_settle(walker *w, uint64_t camera, uint32_t frames_max);
bool walker_at_roots(const walker *w);
bool walker_has_all(const walker *w); /* everything that the camera wants */
void walker_check(walker *w);
void walker_close(walker *w);

uint64_t mix(uint64_t a, uint64_t b);  /* a hash of both */
uint64_t seed_of_test(uint64_t given); /* env MN_SEED, or given; printed */

#endif
