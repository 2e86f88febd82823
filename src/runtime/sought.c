/* Blocks that the rules left no room for, and what fetching them takes.
 *
 * A chain that was refused remembers the id of the block that it was refused for, and is asked
 * about in every frame, by falling error. So the first of them are the next to come into use, and
 * are worth fetching; but that needs the block's length and its parent, too, which an id does not
 * tell.
 *
 * Hides: a table by id in which a newer block takes an older one's place. Who has been forgotten is
 * fetched when he is asked for, as if nobody had known.
 *
 * Any order of calls after open. Threads: Navigate only. Memory: the arena's, by K. Paper: none. */
#include "sought.h"

static uint32_t records(uint32_t k) {
    uint64_t count = 64;
    while (count < (uint64_t)MNI_SOUGHT_TIMES * k)
        count *= 2;
    return (uint32_t)count;
}

size_t mni_sought_need(uint32_t k) {
    return mni_arena_need(records(k), sizeof(mni_seek), 64);
}

void mni_sought_open(mni_sought *sought, uint32_t k, mni_arena *arena) {
    sought->seek = mni_arena_take(arena, records(k), sizeof(mni_seek), 64);
    sought->mask = records(k) - 1;
}

static mni_seek *place(const mni_sought *sought, uint32_t block_id) {
    return &sought->seek[(block_id * 0x9e3779b1u >> 8) & sought->mask];
}

void mni_sought_put(mni_sought *sought, mn_block_ref ref, uint32_t parent_id) {
    *place(sought, ref.id) = (mni_seek){.ref = ref, .parent_id = parent_id};
}

const mni_seek *mni_sought_find(const mni_sought *sought, uint32_t block_id) {
    const mni_seek *at = place(sought, block_id);
    return block_id != 0 && at->ref.id == block_id ? at : NULL;
}
