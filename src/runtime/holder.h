/* Place holders: K slots of memory, each as large as the longest block (paper §3.3.3).
 *
 * Secret: where a slot's bytes are, and which changes of state are legal. Every change goes through
 * mni_holders_set, which asserts the edge, keeps the counts and tells the trace.
 *
 *                     take                     loaded, wanted
 *        ┌─► EMPTY ──────────► LOADING ─────────────────────────► LOADED ◄─┐
 *        │     ▲                │ ▲  ▲ │ loaded, unwanted          │  │    │ second
 *  grow  │     └────────────────┘ │  │ └──────────────► FREED ◄────│──┘    │ chance
 *        │         failed         │  └────────────────── │ │ freed │       │
 *        │                        └──────────────────────│─│───────┘ evict │
 *     RETIRED ◄── EMPTY, FREED, LOADED (shrink)     take   └───────────────┘
 *
 * Everything here is guarded by pool.lock, but for bytes: see the states. */
#ifndef MNI_HOLDER_H
#define MNI_HOLDER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"
#include "metanode/format.h"
#include "metanode/runtime.h"

#define MNI_NO_SLOT UINT32_MAX

typedef enum mni_holder_state {
    MNI_HOLDER_EMPTY =
        0,              /* on the free list, no block; bytes are nobody's; then LOADING, RETIRED */
    MNI_HOLDER_LOADING, /* in the hash table; bytes are I/O's; then LOADED, FREED or EMPTY */
    MNI_HOLDER_LOADED,  /* in the hash table, real memory: in use, pinned or referenced; bytes do
                           not change; then FREED, LOADING (evicted), RETIRED */
    MNI_HOLDER_FREED,   /* in the hash table and on the free list: physical memory only; bytes do
                           not change; then LOADED (second chance), LOADING, RETIRED */
    MNI_HOLDER_RETIRED, /* nowhere; there are no bytes; then EMPTY */
    MNI_HOLDER_STATES
} mni_holder_state;

typedef struct mni_holder {
    mni_holder_state state;
    uint32_t generation; /* rises with each new block */
    mn_block_ref ref;    /* id 0: none */
    uint32_t parent_id;  /* LOADING: that the block must name; then: that it names */
    uint32_t kind;       /* mni_frame_kind, once loaded */

    /* usage: the ancestor table counts; here is whether it is above 0 */
    bool used;    /* usage is above 0 */
    bool held;    /* it is, or was in this frame: nothing may happen to the bytes */
    bool in_use;  /* usage was above 0 at the end of the last frame: its neighbours count it */
    bool touched; /* on Navigate's list for the end of the frame */
    bool pinned;  /* of a grant */

    bool prefetched;      /* came for nobody's grant, and has not been used since */
    uint32_t ahead_frame; /* low bits: of the frame in which somebody last foresaw its use */

    /* reference count = parent_in_use + children_in_use, of neighbours with in_use set */
    bool parent_in_use;
    uint32_t children_in_use;
    uint32_t stamp; /* scratch of a recount: seen already */

    /* while held or in use: the parent's place, for the prefetch */
    mn_block_ref parent;
    uint32_t grandparent_id;

    uint32_t next, prev; /* free list; MNI_NO_SLOT: end */
} mni_holder;

typedef struct mni_holders {
    mni_holder *holder;
    unsigned char *bytes;
    uint32_t k, chunk_holders, chunks;
    uint32_t holder_bytes;
    uint32_t count[MNI_HOLDER_STATES];
    uint32_t stamp;
} mni_holders;

size_t mni_holders_need(uint32_t k, uint32_t holder_bytes);
void mni_holders_open(mni_holders *holders, uint32_t k, uint32_t holder_bytes, mni_arena *arena);
unsigned char *mni_holders_bytes(const mni_holders *holders, uint32_t slot);
uint32_t mni_holders_chunk(const mni_holders *holders, uint32_t slot);
void mni_holders_set(mni_holders *holders, uint32_t slot, mni_holder_state state);
/* A loaded block that nothing holds and nobody refers to. */
bool mni_holder_is_loose(const mni_holder *holder);
/* May an urgent prefetch throw its block out? Loaded, and only prefetched. */
bool mni_holder_is_evictable(const mni_holder *holder);

#endif
