/* See heap.h. Which of a node's children is least cannot be predicted: it is chosen without a
 * branch. */
#include "heap.h"

#include <stdlib.h>

enum { ARITY = 4, LINE_BYTES = ARITY * sizeof(mni_heap_item) };

bool mni_heap_open(mni_heap *h, uint32_t vertices) {
    size_t lines = (size_t)vertices / ARITY + 2;
    mni_heap_item *line = aligned_alloc(LINE_BYTES, lines * LINE_BYTES);
    *h = (mni_heap){.item = line != NULL ? line + ARITY - 1 : NULL,
                    .at = malloc((size_t)vertices * sizeof *h->at)};
    if (h->item == NULL || h->at == NULL) {
        mni_heap_close(h);
        return false;
    }
    memset(h->at, 0xff, (size_t)vertices * sizeof *h->at);
    return true;
}

void mni_heap_close(mni_heap *h) {
    if (h->item != NULL)
        free(h->item - (ARITY - 1));
    free(h->at);
    memset(h, 0, sizeof *h);
}

static inline bool less(const mni_heap_item *a, const mni_heap_item *b) {
    return mni_heap_key_less(a->key, a->vertex, b->key, b->vertex);
}

static inline void put(mni_heap *h, uint32_t i, mni_heap_item item) {
    h->item[i] = item;
    h->at[item.vertex] = i;
}

static void up(mni_heap *h, uint32_t i, mni_heap_item item) {
    while (i > 0) {
        uint32_t parent = (i - 1) / ARITY;
        if (!less(&item, &h->item[parent]))
            break;
        put(h, i, h->item[parent]);
        i = parent;
    }
    put(h, i, item);
}

static inline const mni_heap_item *lesser(const mni_heap_item *a, const mni_heap_item *b) {
    return less(b, a) ? b : a;
}

uint32_t mni_heap_second(const mni_heap *h) {
    const mni_heap_item *child = &h->item[1];
    return (uint32_t)(lesser(lesser(child, child + 1), lesser(child + 2, child + 3)) - h->item);
}

static void down(mni_heap *h, uint32_t i, mni_heap_item item) {
    for (;;) {
        uint64_t first = (uint64_t)i * ARITY + 1;
        const mni_heap_item *child = &h->item[first], *best = child;
        if ((first + ARITY) * ARITY < h->count) /* one of the children's children's lines is next */
            for (uint64_t c = 0; c < ARITY; c++)
                __builtin_prefetch(&h->item[(first + c) * ARITY + 1]);
        if (first + ARITY <= h->count)
            best = lesser(lesser(child, child + 1), lesser(child + 2, child + 3));
        else if (first < h->count)
            for (uint64_t c = 1; first + c < h->count; c++)
                best = lesser(best, child + c);
        else
            break;
        if (!less(best, &item))
            break;
        uint32_t at = (uint32_t)(best - h->item);
        put(h, i, *best);
        i = at;
    }
    put(h, i, item);
}

void mni_heap_set(mni_heap *h, uint32_t vertex, mni_heap_key key) {
    uint32_t i = h->at[vertex];
    mni_heap_item item = {key, vertex};
    if (i == UINT32_MAX)
        up(h, h->count++, item);
    else if (less(&item, &h->item[i]))
        up(h, i, item);
    else
        down(h, i, item);
}

void mni_heap_remove(mni_heap *h, uint32_t vertex) {
    uint32_t i = h->at[vertex];
    if (i == UINT32_MAX)
        return;
    mni_heap_item gone = h->item[i], last = h->item[--h->count];
    h->at[vertex] = UINT32_MAX;
    if (last.vertex == vertex)
        return;
    if (less(&last, &gone))
        up(h, i, last);
    else
        down(h, i, last);
}
