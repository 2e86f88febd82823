/* What Navigate would bring into use next, were there room: see sought.c. */
#ifndef MNI_SOUGHT_H
#define MNI_SOUGHT_H

#include <stddef.h>
#include <stdint.h>

#include "mem.h"
#include "metanode/format.h"

enum { MNI_SOUGHT_TIMES = 2 }; /* records for each place holder, at least */

typedef struct mni_seek {
    mn_block_ref ref;   /* id 0: the record is empty */
    uint32_t parent_id; /* that the block must name */
} mni_seek;

typedef struct mni_sought {
    mni_seek *seek;
    uint32_t mask;
} mni_sought;

size_t mni_sought_need(uint32_t k);
void mni_sought_open(mni_sought *sought, uint32_t k, mni_arena *arena);
void mni_sought_put(mni_sought *sought, mn_block_ref ref, uint32_t parent_id);
/* NULL: it was never put, or has been forgotten; or the id is 0, no block's. */
const mni_seek *mni_sought_find(const mni_sought *sought, uint32_t block_id);

#endif
