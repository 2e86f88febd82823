/* Grants. See grants.h. */
#include "grants.h"

#include "mn_assert.h"
#include "trace.h"

size_t mni_grants_need(uint32_t max) {
    return mni_arena_need(max, sizeof(mni_grant), _Alignof(mni_grant)) + mni_hashmap_need(max);
}

void mni_grants_open(mni_grants *grants, uint32_t max, mni_arena *arena) {
    *grants =
        (mni_grants){.grant = mni_arena_take(arena, max, sizeof(mni_grant), _Alignof(mni_grant)),
                     .max = max,
                     .first_free = MNI_HASHMAP_NONE};
    mni_hashmap_open(&grants->by_id, max, arena);
}

uint32_t mni_grants_find(const mni_grants *grants, uint32_t block_id) {
    return mni_hashmap_find(&grants->by_id, block_id);
}

static void count_idle(mni_grants *grants, const mni_grant *grant, uint32_t by) {
    if (grant->used)
        return;
    grants->idle += by;
    if (grant->outside)
        grants->idle_outside += by;
}

uint32_t mni_grants_add(mni_grants *grants, mn_block_ref ref, uint32_t parent_id, mni_way way,
                        bool outside) {
    uint32_t index = grants->first_free;
    if (index != MNI_HASHMAP_NONE)
        grants->first_free = grants->grant[index].ref.pages; /* of a free record: the next one */
    else if (grants->high < grants->max)
        index = grants->high++;
    else
        return MNI_HASHMAP_NONE;
    mni_grant *grant = &grants->grant[index];
    *grant = (mni_grant){.ref = ref,
                         .parent_id = parent_id,
                         .serial = grant->serial + 1,
                         .way = way,
                         .outside = outside};
    mni_hashmap_put(&grants->by_id, ref.id, index);
    count_idle(grants, grant, 1);
    MNI_TRACE(MN_TRACE_GRANT, 0, ref.id, 0);
    return index;
}

void mni_grants_set(mni_grants *grants, uint32_t index, bool used, bool outside) {
    mni_grant *grant = &grants->grant[index];
    count_idle(grants, grant, UINT32_MAX); /* minus one */
    grant->used = used;
    grant->outside = outside;
    count_idle(grants, grant, 1);
}

void mni_grants_remove(mni_grants *grants, uint32_t index) {
    mni_grant *grant = &grants->grant[index];
    MNI_TRACE(MN_TRACE_GRANT_OVER, grant->used, grant->ref.id, 0);
    mni_hashmap_remove(&grants->by_id, grant->ref.id);
    count_idle(grants, grant, UINT32_MAX);
    grant->ref = (mn_block_ref){.pages = grants->first_free};
    grants->first_free = index;
}

void mni_grants_check(const mni_grants *grants) {
    uint32_t count = 0, idle = 0, idle_outside = 0;
    for (uint32_t i = 0; i < grants->high; i++) {
        const mni_grant *grant = &grants->grant[i];
        if (grant->ref.id == 0)
            continue;
        count++;
        idle += !grant->used;
        idle_outside += !grant->used && grant->outside;
        MN_ASSERT(mni_grants_find(grants, grant->ref.id) == i);
    }
    MN_ASSERT(count == grants->by_id.count && idle == grants->idle);
    MN_ASSERT(idle_outside == grants->idle_outside);
}
