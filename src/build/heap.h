/* A heap of vertices, each with one candidate collapse: strict shortest-first order.
 *
 * Items are ordered by (cost, kept, removed), so ties fall the same way in every run. A vertex is
 * in the heap at most once; its key is changed in place. Four children a node, which lie in one
 * line of the cache. One thread; memory: 4 + 16 bytes a vertex, taken at open. */
#ifndef MNI_HEAP_H
#define MNI_HEAP_H

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

/* The cost's bits, which order floats that are not negative as their values do, above the
 * candidate's other end. */
typedef uint64_t mni_heap_key;

#define MNI_HEAP_KEY_NONE UINT64_MAX /* above every key */

/* cost ≥ 0; rounded from double the same way everywhere. */
static inline mni_heap_key mni_heap_key_make(float cost, uint32_t kept) {
    uint32_t bits;
    memcpy(&bits, &cost, sizeof bits);
    return (uint64_t)bits << 32 | kept;
}

static inline float mni_heap_key_cost(mni_heap_key key) {
    uint32_t bits = (uint32_t)(key >> 32);
    float cost;
    memcpy(&cost, &bits, sizeof cost);
    return cost;
}

static inline uint32_t mni_heap_key_kept(mni_heap_key key) {
    return (uint32_t)key;
}

static inline bool mni_heap_key_less(mni_heap_key a, uint32_t a_removed, mni_heap_key b,
                                     uint32_t b_removed) {
    return (a < b) | ((a == b) & (a_removed < b_removed));
}

typedef struct mni_heap_item {
    mni_heap_key key;
    uint32_t vertex;
} mni_heap_item;

typedef struct mni_heap {
    mni_heap_item *item; /* the first one is the last of a line: its children fill the next */
    uint32_t *at;        /* a vertex: where in item[]; UINT32_MAX: not there */
    uint32_t count;
} mni_heap;

bool mni_heap_open(mni_heap *heap, uint32_t vertices);
void mni_heap_close(mni_heap *heap);
static inline uint32_t mni_heap_top(const mni_heap *heap) {
    return heap->count > 0 ? heap->item[0].vertex : UINT32_MAX;
}
static inline bool mni_heap_has(const mni_heap *heap, uint32_t vertex) {
    return heap->at[vertex] != UINT32_MAX;
}
/* Of a vertex that is there. */
static inline mni_heap_key mni_heap_key_of(const mni_heap *heap, uint32_t vertex) {
    return heap->item[heap->at[vertex]].key;
}
/* A forecast of what comes to the top next: the index of the least item below the top, and, of an
 * index, that of the first of the four items below it. Of a heap of MNI_HEAP_FORECAST and more. */
enum { MNI_HEAP_FORECAST = 1 + 4 + 16 };
uint32_t mni_heap_second(const mni_heap *heap);
static inline uint32_t mni_heap_below(uint32_t index) {
    return 4 * index + 1;
}
/* Inserts, or moves to where the new key belongs. */
void mni_heap_set(mni_heap *heap, uint32_t vertex, mni_heap_key key);
void mni_heap_remove(mni_heap *heap, uint32_t vertex); /* if it is there */

#endif
