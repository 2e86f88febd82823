/* An open-addressing table of numbers below 2^32 - 1 whose keys live elsewhere: the caller
 * compares.
 *
 *   uint64_t at = mni_table_first(&t, hash);
 *   while (mni_table_find(&t, hash, &at, &number)) {
 *       if (key of number equals mine) …found…
 *       at = mni_table_next(&t, at);
 *   }
 *   mni_table_put(&t, at, hash, mine)     -- `at` is where the search ended
 *
 * Linear probing; at most three slots in four are taken. A slot keeps half of the hash beside the
 * number, so that a key, far away in memory, is looked at only when it is most likely the same.
 * Threads: one a table. */
#ifndef MNI_TABLE_H
#define MNI_TABLE_H

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

typedef struct mni_slot {
    uint32_t tag;   /* low half of the hash; its high half picks the slot */
    uint32_t taken; /* number + 1; 0: free */
} mni_slot;

typedef struct mni_table {
    mni_slot *slot;
    uint64_t slots; /* below 2^32, as numbers are below 3 × 2^30 */
} mni_table;

/* Slots, and bytes, for so many numbers. */
static inline uint64_t mni_table_slots(uint64_t numbers) {
    return numbers + numbers / 3 + 8;
}
static inline uint64_t mni_table_bytes(uint64_t numbers) {
    return mni_table_slots(numbers) * sizeof(mni_slot);
}
static inline bool mni_table_open(mni_table *table, uint64_t numbers) {
    table->slots = mni_table_slots(numbers);
    table->slot = calloc(table->slots, sizeof(mni_slot));
    return table->slot != NULL;
}
static inline void mni_table_close(mni_table *table) {
    free(table->slot);
    *table = (mni_table){0};
}

static inline uint64_t mni_table_first(const mni_table *table, uint64_t hash) {
    return ((hash >> 32) * table->slots) >> 32;
}
static inline uint64_t mni_table_next(const mni_table *table, uint64_t at) {
    return at + 1 == table->slots ? 0 : at + 1;
}
/* Says that the hash will be looked for soon. */
static inline void mni_table_prefetch(const mni_table *table, uint64_t hash) {
    __builtin_prefetch(&table->slot[mni_table_first(table, hash)], 1);
}
/* Goes on from *at to a number with this hash (true), or to the free slot where one belongs. */
static inline bool mni_table_find(const mni_table *table, uint64_t hash, uint64_t *at,
                                  uint32_t *number) {
    for (;; *at = mni_table_next(table, *at)) {
        const mni_slot *slot = &table->slot[*at];
        *number = slot->taken - 1;
        if (slot->taken == 0)
            return false;
        if (slot->tag == (uint32_t)hash)
            return true;
    }
}
static inline void mni_table_put(mni_table *table, uint64_t at, uint64_t hash, uint32_t number) {
    table->slot[at] = (mni_slot){.tag = (uint32_t)hash, .taken = number + 1};
}

#endif
