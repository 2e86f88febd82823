/* The ancestor table. See ancestors.h. */
#include "ancestors.h"

#include "mn_assert.h"

size_t mni_ancestors_need(uint32_t max) {
    return mni_arena_need(max, sizeof(mni_ancestor), _Alignof(mni_ancestor)) +
           mni_hashmap_need(max);
}

void mni_ancestors_open(mni_ancestors *table, uint32_t max, mni_arena *arena) {
    *table = (mni_ancestors){
        .entry = mni_arena_take(arena, max, sizeof(mni_ancestor), _Alignof(mni_ancestor)),
        .max = max,
        .first_free = max > 0 ? 0 : MNI_NO_ENTRY};
    mni_hashmap_open(&table->by_id, max, arena);
    for (mni_entry e = 0; e < max; e++)
        table->entry[e].parent = e + 1 < max ? e + 1 : MNI_NO_ENTRY;
}

mni_entry mni_ancestors_find(const mni_ancestors *table, uint32_t block_id) {
    return mni_hashmap_find(&table->by_id, block_id); /* MNI_HASHMAP_NONE is MNI_NO_ENTRY */
}

uint32_t mni_ancestors_parent_id(const mni_ancestors *table, mni_entry entry) {
    mni_entry parent = table->entry[entry].parent;
    return parent == MNI_NO_ENTRY ? 0 : table->entry[parent].ref.id;
}

static mni_entry take_entry(mni_ancestors *table, mn_block_ref ref, mni_entry parent) {
    mni_entry e = table->first_free;
    MN_ASSERT(e != MNI_NO_ENTRY);
    table->first_free = table->entry[e].parent;
    table->entry[e] = (mni_ancestor){.ref = ref, .parent = parent};
    mni_hashmap_put(&table->by_id, ref.id, e);
    if (parent != MNI_NO_ENTRY)
        table->entry[parent].children++;
    table->count++;
    return e;
}

mni_entry mni_ancestors_enter(mni_ancestors *table, mn_block_ref ref, mni_entry parent,
                              const void *bytes) {
    mni_entry e = mni_ancestors_find(table, ref.id);
    if (e == MNI_NO_ENTRY)
        e = take_entry(table, ref, parent);
    mni_ancestor *entry = &table->entry[e];
    MN_ASSERT(entry->parent == parent && entry->ref.pages == ref.pages && entry->usage == 0);
    entry->usage = 1;
    entry->bytes = bytes;
    entry->fresh = true;
    table->in_use++;
    return e;
}

bool mni_ancestors_lower(mni_ancestors *table, mni_entry entry) {
    mni_ancestor *lowered = &table->entry[entry];
    MN_ASSERT(lowered->usage > 0);
    if (--lowered->usage > 0)
        return false;
    table->in_use--;
    lowered->bytes = NULL;
    while (entry != MNI_NO_ENTRY && table->entry[entry].usage == 0 &&
           table->entry[entry].children == 0) {
        mni_ancestor *gone = &table->entry[entry];
        mni_entry parent = gone->parent;
        mni_hashmap_remove(&table->by_id, gone->ref.id);
        *gone = (mni_ancestor){.parent = table->first_free};
        table->first_free = entry;
        table->count--;
        if (parent != MNI_NO_ENTRY)
            table->entry[parent].children--;
        entry = parent;
    }
    return true;
}

void mni_ancestors_check(const mni_ancestors *table) {
    uint32_t count = 0, in_use = 0;
    uint64_t children = 0, parents = 0;
    for (mni_entry e = 0; e < table->max; e++) {
        const mni_ancestor *entry = &table->entry[e];
        if (entry->ref.id == 0)
            continue;
        count++;
        in_use += entry->usage > 0;
        children += entry->children;
        parents += entry->parent != MNI_NO_ENTRY;
        MN_ASSERT(entry->usage > 0 || entry->children > 0);
        MN_ASSERT((entry->usage > 0) == (entry->bytes != NULL));
        MN_ASSERT(mni_ancestors_find(table, entry->ref.id) == e);
        MN_ASSERT(entry->parent == MNI_NO_ENTRY || table->entry[entry->parent].ref.id != 0);
    }
    MN_ASSERT(count == table->count && in_use == table->in_use && count <= table->max);
    MN_ASSERT(children == parents && table->by_id.count == count);
}
