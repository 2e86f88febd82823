/* What the chains of a frame lack: so that no two search as far as the same absent block. See
 * lacking.c. */
#ifndef MNI_LACKING_H
#define MNI_LACKING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"

enum {
    MNI_LACKING_WAYS = 4,       /* records of a set: a line of the cache */
    MNI_LACKING_SETS_LOG2 = 14, /* sets at most */
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
    mni_lack *lack;  /* sets of records, by the top bits of a product */
    uint64_t *maybe; /* bits, eight a record: of whom none is set, nothing is known */
    uint32_t entries;
    int shift;      /* of a product, for the set */
    uint32_t chain; /* the last that began; from 1 */
    uint32_t first; /* what chains before that have found is forgotten */
    bool any;       /* something is known to lack a block */
    bool marked;    /* something is known of somebody */
} mni_lacking;

size_t mni_lacking_need(uint32_t nodes_max);
void mni_lacking_open(mni_lacking *lacking, uint32_t nodes_max, mni_arena *arena);
/* All that is known is forgotten. */
void mni_lacking_forget(mni_lacking *lacking);
/* A chain begins. */
static inline void mni_lacking_chain(mni_lacking *lacking) {
    lacking->chain++;
}
/* A node's bit, and the word that it is in: it leads on where its set ends, so they go together. */
static inline uint64_t *mni_lacking_word(const mni_lacking *lacking, uint32_t order,
                                         uint64_t *bit) {
    const uint32_t at = order * 0x9e3779b1u >> (lacking->shift - 5);
    *bit = (uint64_t)1 << at % 64;
    return &lacking->maybe[at / 64];
}
/* Where a node's record stands, if there is one. */
static inline mni_lack *mni_lacking_set(const mni_lacking *lacking, uint32_t order) {
    return &lacking->lack[MNI_LACKING_WAYS * (size_t)(order * 0x9e3779b1u >> lacking->shift)];
}
/* NULL: nothing is known of the node, or no longer. */
static inline const mni_lack *mni_lacking_find(const mni_lacking *lacking, uint32_t order) {
    uint64_t bit;
    if ((*mni_lacking_word(lacking, order, &bit) & bit) == 0)
        return NULL;
    const mni_lack *set = mni_lacking_set(lacking, order);
    for (int i = 0; i < MNI_LACKING_WAYS; i++)
        if (set[i].order == order &&
            set[i].chain >= (set[i].brief ? lacking->chain : lacking->first))
            return &set[i];
    return NULL;
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
