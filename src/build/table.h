/* An open-addressing table of numbers below 2^32 - 1 whose keys live elsewhere: the caller
 * compares.
 *
 *   for (uint64_t at = mni_table_first(&t, hash); mni_table_at(&t, at, &number);
 *        at = mni_table_next(&t, at))
 *       if (key of number equals mine) …found…
 *   mni_table_put(&t, at, mine)     -- `at` is where the loop stopped
 *
 * Linear probing; at most three slots in four are taken. Threads: one a table. */
#ifndef MNI_TABLE_H
#define MNI_TABLE_H

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

typedef struct mni_table {
    uint32_t *slot; /* number + 1; 0: free */
    uint64_t slots;
} mni_table;

/* Slots, and bytes, for so many numbers. */
static inline uint64_t mni_table_slots(uint64_t numbers) {
    return numbers + numbers / 3 + 8;
}
static inline uint64_t mni_table_bytes(uint64_t numbers) {
    return mni_table_slots(numbers) * sizeof(uint32_t);
}
static inline bool mni_table_open(mni_table *table, uint64_t numbers) {
    table->slots = mni_table_slots(numbers);
    table->slot = calloc(table->slots, sizeof(uint32_t));
    return table->slot != NULL;
}
static inline void mni_table_close(mni_table *table) {
    free(table->slot);
    *table = (mni_table){0};
}

/* The hash's high half picks the slot; slots are below 2^32, as numbers are below 3 × 2^30. */
static inline uint64_t mni_table_first(const mni_table *table, uint64_t hash) {
    return ((hash >> 32) * table->slots) >> 32;
}
static inline uint64_t mni_table_next(const mni_table *table, uint64_t at) {
    return at + 1 == table->slots ? 0 : at + 1;
}
static inline bool mni_table_at(const mni_table *table, uint64_t at, uint32_t *number) {
    *number = table->slot[at] - 1;
    return table->slot[at] != 0;
}
static inline void mni_table_put(mni_table *table, uint64_t at, uint32_t number) {
    table->slot[at] = number + 1;
}

#endif
