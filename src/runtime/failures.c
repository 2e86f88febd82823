/* Bad blocks and when to try them again. See failures.h. */
#include "failures.h"

size_t mni_failures_need(void) {
    return mni_arena_need(MNI_FAILURES_MAX, sizeof(mni_failure), _Alignof(mni_failure)) +
           mni_hashmap_need(MNI_FAILURES_MAX);
}

void mni_failures_open(mni_failures *failures, mni_arena *arena) {
    *failures =
        (mni_failures){.record = mni_arena_take(arena, MNI_FAILURES_MAX, sizeof(mni_failure),
                                                _Alignof(mni_failure))};
    mni_hashmap_open(&failures->by_id, MNI_FAILURES_MAX, arena);
}

bool mni_failures_add(mni_failures *failures, uint32_t block_id, uint64_t frame) {
    uint32_t at = mni_hashmap_find(&failures->by_id, block_id);
    bool first = at == MNI_HASHMAP_NONE;
    if (first) {
        at = failures->oldest;
        failures->oldest = (at + 1) % MNI_FAILURES_MAX;
        if (failures->record[at].block_id != 0)
            mni_hashmap_remove(&failures->by_id, failures->record[at].block_id);
        failures->record[at] = (mni_failure){.block_id = block_id};
        mni_hashmap_put(&failures->by_id, block_id, at);
    }
    mni_failure *failure = &failures->record[at];
    uint64_t wait_frames =
        failure->times < 6 ? UINT64_C(1) << failure->times : MNI_RETRY_FRAMES_MAX;
    failure->times++;
    failure->retry_frame = frame + wait_frames;
    return first;
}

bool mni_failures_due(const mni_failures *failures, uint32_t block_id, uint64_t frame) {
    uint32_t at = mni_hashmap_find(&failures->by_id, block_id);
    return at == MNI_HASHMAP_NONE || failures->record[at].retry_frame <= frame;
}

bool mni_failures_has(const mni_failures *failures, uint32_t block_id) {
    return mni_hashmap_find(&failures->by_id, block_id) != MNI_HASHMAP_NONE;
}

void mni_failures_forget(mni_failures *failures, uint32_t block_id) {
    uint32_t at = mni_hashmap_find(&failures->by_id, block_id);
    if (at == MNI_HASHMAP_NONE)
        return;
    mni_hashmap_remove(&failures->by_id, block_id);
    failures->record[at] = (mni_failure){0};
}
