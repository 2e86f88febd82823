/* A heap of vertices, each with one candidate collapse: strict shortest-first order.
 *
 * Keys are (cost, kept, removed), compared in that order, so ties fall the same way in every run. A
 * vertex is in the heap at most once; its key is changed in place. Four children a node: fewer
 * cache lines on the way down. One thread; memory: 4 + 12 bytes a vertex, taken at open. */
#ifndef MNI_HEAP_H
#define MNI_HEAP_H

#include <stdbool.h>
#include <stdint.h>

typedef struct mni_heap_key {
    float cost;    /* ≥ 0; rounded from double the same way everywhere */
    uint32_t kept; /* the candidate's other end */
} mni_heap_key;

typedef struct mni_heap_item {
    mni_heap_key key;
    uint32_t vertex;
} mni_heap_item;

typedef struct mni_heap {
    mni_heap_item *item;
    uint32_t *at; /* a vertex: where in item[]; UINT32_MAX: not there */
    uint32_t count;
} mni_heap;

bool mni_heap_open(mni_heap *heap, uint32_t vertices);
void mni_heap_close(mni_heap *heap);
static inline uint32_t mni_heap_top(const mni_heap *heap) {
    return heap->count > 0 ? heap->item[0].vertex : UINT32_MAX;
}
/* Of a vertex that is there. */
static inline mni_heap_key mni_heap_key_of(const mni_heap *heap, uint32_t vertex) {
    return heap->item[heap->at[vertex]].key;
}
/* Inserts, or moves to where the new key belongs. */
void mni_heap_set(mni_heap *heap, uint32_t vertex, mni_heap_key key);
void mni_heap_remove(mni_heap *heap, uint32_t vertex); /* if it is there */
static inline bool mni_heap_key_less(mni_heap_key a, uint32_t a_removed, mni_heap_key b,
                                     uint32_t b_removed) {
    if (a.cost != b.cost)
        return a.cost < b.cost;
    if (a.kept != b.kept)
        return a.kept < b.kept;
    return a_removed < b_removed;
}

#endif
