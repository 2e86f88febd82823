/* The ancestor table: every block in use and all its ancestors, so that a block that has gone can
 * be found again on the way up, though no parent's place is in the file (design.md §3.5).
 *
 * Secret: how entries are kept and found. An entry exists while its usage is above 0 or it has
 * children in the table; its index is stable while it exists. The number of entries is the |A| of
 * the `packed` rule. Navigate only. Its memory is the arena's, of fixed size. */
#ifndef MNI_ANCESTORS_H
#define MNI_ANCESTORS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "hashmap.h"
#include "metanode/format.h"
#include "store.h"

typedef struct mni_ancestor {
    mn_block_ref ref;  /* id 0: the entry is free */
    mni_entry parent;  /* MNI_NO_ENTRY: a root block; of a free entry: the next free one */
    uint32_t usage;    /* active nodes in the block */
    uint32_t children; /* entries whose parent this is */
    bool fresh;        /* bytes have come since they were last asked for */
    const void *bytes; /* while usage > 0 */
} mni_ancestor;

typedef struct mni_ancestors {
    mni_ancestor *entry;
    mni_hashmap by_id;
    uint32_t max;
    uint32_t count;  /* |A| */
    uint32_t in_use; /* entries with usage above 0 */
    mni_entry first_free;
} mni_ancestors;

size_t mni_ancestors_need(uint32_t max);
void mni_ancestors_open(mni_ancestors *table, uint32_t max, mni_arena *arena);
mni_entry mni_ancestors_find(const mni_ancestors *table, uint32_t block_id);
/* The id of the parent's block; 0 of a root block. */
uint32_t mni_ancestors_parent_id(const mni_ancestors *table, mni_entry entry);
/* Brings a block into use: makes its entry below `parent` unless there is one; usage 0 -> 1. Room
 * for one more is the caller's to see to. */
mni_entry mni_ancestors_enter(mni_ancestors *table, mn_block_ref ref, mni_entry parent,
                              const void *bytes);
/* usage - 1; true when it has become 0. Entries that nothing needs any more go. */
bool mni_ancestors_lower(mni_ancestors *table, mni_entry entry);
void mni_ancestors_check(const mni_ancestors *table); /* by full recount */

#endif
