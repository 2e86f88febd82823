/* Open addressing at a load of at most one half. See hashmap.h. */
#include "hashmap.h"

#include "mn_assert.h"

static uint32_t slots_for(uint32_t max) {
    MN_ASSERT(max <= UINT32_C(1) << 30);
    uint32_t slots = 16;
    while (slots < 2 * max)
        slots *= 2;
    return slots;
}

size_t mni_hashmap_need(uint32_t max) {
    return 2 * mni_arena_need(slots_for(max), sizeof(uint32_t), sizeof(uint32_t));
}

void mni_hashmap_open(mni_hashmap *map, uint32_t max, mni_arena *arena) {
    uint32_t slots = slots_for(max);
    *map = (mni_hashmap){.key = mni_arena_take(arena, slots, sizeof(uint32_t), sizeof(uint32_t)),
                         .value = mni_arena_take(arena, slots, sizeof(uint32_t), sizeof(uint32_t)),
                         .mask = slots - 1,
                         .shift = 32 - (uint32_t)__builtin_ctz(slots),
                         .max = max};
}

/* Fibonacci hashing: ids are multiples of a block's pages, so their low bits say little. */
static uint32_t home(const mni_hashmap *map, uint32_t key) {
    return (key * UINT32_C(2654435769)) >> map->shift;
}

/* Where key is, or the empty place where it would go. */
static uint32_t place(const mni_hashmap *map, uint32_t key) {
    uint32_t at = home(map, key);
    while (map->key[at] != 0 && map->key[at] != key)
        at = (at + 1) & map->mask;
    return at;
}

uint32_t mni_hashmap_find(const mni_hashmap *map, uint32_t key) {
    if (key == 0)
        return MNI_HASHMAP_NONE;
    uint32_t at = place(map, key);
    return map->key[at] == key ? map->value[at] : MNI_HASHMAP_NONE;
}

void mni_hashmap_put(mni_hashmap *map, uint32_t key, uint32_t value) {
    MN_ASSERT(key != 0 && map->count < map->max);
    uint32_t at = place(map, key);
    MN_ASSERT(map->key[at] == 0);
    map->key[at] = key;
    map->value[at] = value;
    map->count++;
}

void mni_hashmap_remove(mni_hashmap *map, uint32_t key) {
    uint32_t hole = place(map, key);
    MN_ASSERT(key != 0 && map->key[hole] == key);
    /* Shift back whatever probed past the hole on its way from home. */
    for (uint32_t at = (hole + 1) & map->mask; map->key[at] != 0; at = (at + 1) & map->mask) {
        uint32_t from_home = (at - home(map, map->key[at])) & map->mask;
        uint32_t from_hole = (at - hole) & map->mask;
        if (from_home >= from_hole) {
            map->key[hole] = map->key[at];
            map->value[hole] = map->value[at];
            hole = at;
        }
    }
    map->key[hole] = 0;
    map->count--;
}
