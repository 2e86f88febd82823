/* Place holders. See holder.h. */
#include "holder.h"

#include "mn_assert.h"
#include "trace.h"

/* Chunks are registered with the kernel and given back apart: small enough that a cap can shrink
 * by steps, large enough that there are few. */
enum { CHUNK_BYTES = 2 << 20 };

size_t mni_holders_need(uint32_t k, uint32_t holder_bytes) {
    return mni_arena_need(k, sizeof(mni_holder), _Alignof(mni_holder)) +
           mni_arena_need(k, holder_bytes, MN_PAGE_BYTES);
}

void mni_holders_open(mni_holders *holders, uint32_t k, uint32_t holder_bytes, mni_arena *arena) {
    MN_ASSERT(k > 0 && holder_bytes > 0 && holder_bytes % MN_PAGE_BYTES == 0);
    uint32_t chunk_holders = holder_bytes < CHUNK_BYTES ? CHUNK_BYTES / holder_bytes : 1;
    *holders =
        (mni_holders){.holder = mni_arena_take(arena, k, sizeof(mni_holder), _Alignof(mni_holder)),
                      .bytes = mni_arena_take(arena, k, holder_bytes, MN_PAGE_BYTES),
                      .k = k,
                      .chunk_holders = chunk_holders,
                      .chunks = (k + chunk_holders - 1) / chunk_holders,
                      .holder_bytes = holder_bytes};
    holders->count[MNI_HOLDER_EMPTY] = k;
}

unsigned char *mni_holders_bytes(const mni_holders *holders, uint32_t slot) {
    MN_ASSERT(slot < holders->k);
    return holders->bytes + (size_t)slot * holders->holder_bytes;
}

uint32_t mni_holders_chunk(const mni_holders *holders, uint32_t slot) {
    return slot / holders->chunk_holders;
}

_Static_assert((int)MNI_HOLDER_FREED == (int)MN_TRACE_FREED &&
                   (int)MNI_HOLDER_STATES == (int)MN_TRACE_PLACES,
               "a trace says the same");

static bool edge_is_legal(mni_holder_state from, mni_holder_state to) {
    static const unsigned legal[MNI_HOLDER_STATES] = {
        [MNI_HOLDER_EMPTY] = 1u << MNI_HOLDER_LOADING | 1u << MNI_HOLDER_RETIRED,
        [MNI_HOLDER_LOADING] =
            1u << MNI_HOLDER_LOADED | 1u << MNI_HOLDER_FREED | 1u << MNI_HOLDER_EMPTY,
        [MNI_HOLDER_LOADED] =
            1u << MNI_HOLDER_FREED | 1u << MNI_HOLDER_LOADING | 1u << MNI_HOLDER_RETIRED,
        [MNI_HOLDER_FREED] =
            1u << MNI_HOLDER_LOADED | 1u << MNI_HOLDER_LOADING | 1u << MNI_HOLDER_RETIRED,
        [MNI_HOLDER_RETIRED] = 1u << MNI_HOLDER_EMPTY,
    };
    return legal[from] >> to & 1;
}

void mni_holders_set(mni_holders *holders, uint32_t slot, mni_holder_state state) {
    mni_holder *holder = &holders->holder[slot];
    mni_holder_state old = holder->state;
    MN_ASSERT(edge_is_legal(old, state));
    if (state != MNI_HOLDER_LOADED)
        MN_ASSERT(!holder->used && !holder->held && !holder->in_use);
    holder->state = state;
    holders->count[old]--;
    holders->count[state]++;
    MNI_TRACE(MN_TRACE_HOLDER, (uint32_t)old | (uint32_t)state << 3, holder->ref.id, slot);
}

bool mni_holder_is_loose(const mni_holder *holder) {
    return !holder->held && !holder->in_use && !holder->pinned && !holder->parent_in_use &&
           holder->children_in_use == 0;
}

bool mni_holder_is_evictable(const mni_holder *holder) {
    return holder->state == MNI_HOLDER_LOADED && !holder->held && !holder->in_use &&
           !holder->pinned;
}
