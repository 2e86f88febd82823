/* Grants: urgent prefetches that were allowed and have been neither used nor dropped.
 *
 *   asked for ──► waiting (a command is posted; posted again when it was given up)
 *                    │ loaded: the place holder is pinned
 *                    ▼
 *                 arrived ──► used (in use at the end of a frame)            ─┐
 *                    │                                                        ├─► gone
 *                    └─────► dropped (a frame in which nobody asked for it)  ─┘
 *
 * A block that a failed attempt had taken into use and gave back is granted too while the attempt
 * stands, or the blocks of one chain would evict each other for ever (design.md §2, §4).
 *
 * Secret: how they are found, and the two sums that the rules need. Guarded by pool.lock. */
#ifndef MNI_GRANTS_H
#define MNI_GRANTS_H

#include "hashmap.h"
#include "store_kind.h"

typedef struct mni_grant {
    mn_block_ref ref; /* id 0: the record is free */
    uint32_t parent_id;
    uint32_t serial; /* of the record: rises with each grant */
    mni_way way;
    bool posted;     /* a command for it is open */
    bool waiting;    /* the last answer was that it is absent */
    bool used;       /* its block's usage is above 0 */
    bool outside;    /* its block has no entry in the ancestor table */
    mni_notes notes; /* Navigate's alone */
    uint64_t asked_frame;
    uint32_t attempt;       /* number of the last that asked for it; 0: of none */
    uint64_t absent_serial; /* OVERFLOW: answers "absent" in this run when it was handed over */
} mni_grant;

typedef struct mni_grants {
    mni_grant *grant;
    mni_hashmap by_id;
    uint32_t max, high; /* records [0, high) have been used */
    uint32_t first_free;
    uint32_t idle;         /* grants whose blocks are not in use … */
    uint32_t idle_outside; /* … nor in the ancestor table */
} mni_grants;

size_t mni_grants_need(uint32_t max);
void mni_grants_open(mni_grants *grants, uint32_t max, mni_arena *arena);
uint32_t mni_grants_find(const mni_grants *grants, uint32_t block_id); /* or MNI_HASHMAP_NONE */
/* A new one, idle; MNI_HASHMAP_NONE when there is no room. */
uint32_t mni_grants_add(mni_grants *grants, mn_block_ref ref, uint32_t parent_id, mni_way way,
                        bool outside);
void mni_grants_set(mni_grants *grants, uint32_t index, bool used, bool outside);
void mni_grants_remove(mni_grants *grants, uint32_t index);
void mni_grants_check(const mni_grants *grants);

#endif
