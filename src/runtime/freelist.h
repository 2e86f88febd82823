/* The free list: place holders that may take a new block, first in, first out (paper §3.3.3).
 *
 * Secret: the order. A freed block goes to the end, so that its second chance lasts as long as it
 * can; a place holder without a block goes to the front. Linked through the place holders, so that
 * one can be taken out anywhere at once. Guarded by pool.lock. */
#ifndef MNI_FREELIST_H
#define MNI_FREELIST_H

#include "holder.h"

typedef struct mni_freelist {
    uint32_t first, last; /* MNI_NO_SLOT: none */
    uint32_t count;
} mni_freelist;

void mni_freelist_open(mni_freelist *list, mni_holders *holders); /* all of them, in order */
void mni_freelist_append(mni_freelist *list, mni_holders *holders, uint32_t slot);
void mni_freelist_prepend(mni_freelist *list, mni_holders *holders, uint32_t slot);
void mni_freelist_unlink(mni_freelist *list, mni_holders *holders, uint32_t slot);
uint32_t mni_freelist_take(mni_freelist *list, mni_holders *holders); /* or MNI_NO_SLOT */

#endif
