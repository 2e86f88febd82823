/* Block ids to small numbers (slots, entries): a map of fixed capacity.
 *
 * Secret: open addressing with linear probing and backward shifts, so no tombstones pile up in a
 * map that lives as long as a session. Keys are above 0 (block 0 is the file's header). Owns
 * nothing: its arrays come from the arena. Guarded by whoever owns the map. */
#ifndef MNI_HASHMAP_H
#define MNI_HASHMAP_H

#include <stddef.h>
#include <stdint.h>

#include "mem.h"

#define MNI_HASHMAP_NONE UINT32_MAX

typedef struct mni_hashmap {
    uint32_t *key, *value; /* key 0: empty */
    uint32_t mask, shift;
    uint32_t count, max;
} mni_hashmap;

size_t mni_hashmap_need(uint32_t max);
void mni_hashmap_open(mni_hashmap *map, uint32_t max, mni_arena *arena);
/* The value, or MNI_HASHMAP_NONE. */
uint32_t mni_hashmap_find(const mni_hashmap *map, uint32_t key);
void mni_hashmap_put(mni_hashmap *map, uint32_t key, uint32_t value); /* key is not in the map */
void mni_hashmap_remove(mni_hashmap *map, uint32_t key);              /* key is in the map */

#endif
