/* See heap.h. */
#include "heap.h"

#include <stdlib.h>
#include <string.h>

enum { ARITY = 4 };

bool mni_heap_open(mni_heap *h, uint32_t vertices) {
    *h = (mni_heap){.key = malloc((size_t)vertices * sizeof *h->key),
                    .item = malloc((size_t)vertices * sizeof *h->item),
                    .at = malloc((size_t)vertices * sizeof *h->at)};
    if (h->key == NULL || h->item == NULL || h->at == NULL) {
        mni_heap_close(h);
        return false;
    }
    memset(h->at, 0xff, (size_t)vertices * sizeof *h->at);
    return true;
}

void mni_heap_close(mni_heap *h) {
    free(h->key);
    free(h->item);
    free(h->at);
    memset(h, 0, sizeof *h);
}

static bool less(const mni_heap *h, uint32_t a, uint32_t b) {
    return mni_heap_key_less(h->key[a], a, h->key[b], b);
}

static void put(mni_heap *h, uint32_t i, uint32_t vertex) {
    h->item[i] = vertex;
    h->at[vertex] = i;
}

static void up(mni_heap *h, uint32_t i, uint32_t vertex) {
    while (i > 0) {
        uint32_t parent = (i - 1) / ARITY;
        if (!less(h, vertex, h->item[parent]))
            break;
        put(h, i, h->item[parent]);
        i = parent;
    }
    put(h, i, vertex);
}

static void down(mni_heap *h, uint32_t i, uint32_t vertex) {
    for (;;) {
        uint64_t first = (uint64_t)i * ARITY + 1;
        if (first >= h->count)
            break;
        uint32_t end = first + ARITY < h->count ? (uint32_t)first + ARITY : h->count;
        uint32_t best = (uint32_t)first;
        for (uint32_t c = best + 1; c < end; c++)
            if (less(h, h->item[c], h->item[best]))
                best = c;
        if (!less(h, h->item[best], vertex))
            break;
        put(h, i, h->item[best]);
        i = best;
    }
    put(h, i, vertex);
}

void mni_heap_set(mni_heap *h, uint32_t vertex, mni_heap_key key) {
    uint32_t i = h->at[vertex];
    if (i == UINT32_MAX) {
        h->key[vertex] = key;
        up(h, h->count++, vertex);
        return;
    }
    bool rises = mni_heap_key_less(key, vertex, h->key[vertex], vertex);
    h->key[vertex] = key;
    if (rises)
        up(h, i, vertex);
    else
        down(h, i, vertex);
}

void mni_heap_remove(mni_heap *h, uint32_t vertex) {
    uint32_t i = h->at[vertex];
    if (i == UINT32_MAX)
        return;
    h->at[vertex] = UINT32_MAX;
    uint32_t last = h->item[--h->count];
    if (last == vertex)
        return;
    if (less(h, last, vertex))
        up(h, i, last);
    else
        down(h, i, last);
}
