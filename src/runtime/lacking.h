/* What the chains of a frame lack: so that no two search as far as the same absent block. See
 * lacking.c. */
#ifndef MNI_LACKING_H
#define MNI_LACKING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"

enum {
    MNI_LACKING_MAX = 1 << 10, /* nodes remembered: what chains share, what one has split */
};

/* A node, and what a chain has found of it. */
typedef struct mni_lack {
    uint32_t order;    /* order id */
    uint32_t chain;    /* that found it; 0: the record is empty */
    uint32_t block_id; /* absent, so that the node cannot be split; of a sound one: unused */
    bool sound;        /* it was split, and undone: it lacks nothing */
    bool brief;        /* nobody knows when the block will come: known to this chain alone */
} mni_lack;

typedef struct mni_lacking {
    mni_lack *lack;
    uint32_t mask;
    uint32_t chain; /* the last that began; from 1 */
    uint32_t first; /* what chains before that have found is forgotten */
    bool any;       /* something is known to lack a block */
} mni_lacking;

size_t mni_lacking_need(uint32_t nodes_max);
void mni_lacking_open(mni_lacking *lacking, uint32_t nodes_max, mni_arena *arena);
/* All that is known is forgotten. */
void mni_lacking_forget(mni_lacking *lacking);
/* A chain begins. */
static inline void mni_lacking_chain(mni_lacking *lacking) {
    lacking->chain++;
}
/* NULL: nothing is known of the node, or no longer. */
static inline const mni_lack *mni_lacking_find(const mni_lacking *lacking, uint32_t order) {
    const mni_lack *at = &lacking->lack[order * 0x9e3779b1u >> 16 & lacking->mask];
    const uint32_t first = at->brief ? lacking->chain : lacking->first;
    return at->order == order && at->chain >= first ? at : NULL;
}
/* The block that it lacks, as far as is known; NULL: none. */
static inline const mni_lack *mni_lacking_of(const mni_lacking *lacking, uint32_t order) {
    const mni_lack *at = lacking->any ? mni_lacking_find(lacking, order) : NULL;
    return at != NULL && !at->sound ? at : NULL;
}
static inline bool mni_lacking_is_sound(const mni_lacking *lacking, uint32_t order) {
    const mni_lack *at = mni_lacking_find(lacking, order);
    return at != NULL && at->sound;
}
void mni_lacking_put(mni_lacking *lacking, uint32_t order, uint32_t block_id, bool brief);
void mni_lacking_put_sound(mni_lacking *lacking, uint32_t order);

#endif
