/* See heap.h. */
#include "heap.h"

#include <stdlib.h>
#include <string.h>

enum { ARITY = 4 };

bool mni_heap_open(mni_heap *h, uint32_t vertices) {
    *h = (mni_heap){.item = malloc((size_t)vertices * sizeof *h->item),
                    .at = malloc((size_t)vertices * sizeof *h->at)};
    if (h->item == NULL || h->at == NULL) {
        mni_heap_close(h);
        return false;
    }
    memset(h->at, 0xff, (size_t)vertices * sizeof *h->at);
    return true;
}

void mni_heap_close(mni_heap *h) {
    free(h->item);
    free(h->at);
    memset(h, 0, sizeof *h);
}

static bool less(mni_heap_item a, mni_heap_item b) {
    return mni_heap_key_less(a.key, a.vertex, b.key, b.vertex);
}

static void put(mni_heap *h, uint32_t i, mni_heap_item item) {
    h->item[i] = item;
    h->at[item.vertex] = i;
}

static void up(mni_heap *h, uint32_t i, mni_heap_item item) {
    while (i > 0) {
        uint32_t parent = (i - 1) / ARITY;
        if (!less(item, h->item[parent]))
            break;
        put(h, i, h->item[parent]);
        i = parent;
    }
    put(h, i, item);
}

static void down(mni_heap *h, uint32_t i, mni_heap_item item) {
    for (;;) {
        uint64_t first = (uint64_t)i * ARITY + 1;
        if (first >= h->count)
            break;
        uint32_t end = first + ARITY < h->count ? (uint32_t)first + ARITY : h->count;
        uint32_t best = (uint32_t)first;
        for (uint32_t c = best + 1; c < end; c++)
            if (less(h->item[c], h->item[best]))
                best = c;
        if (!less(h->item[best], item))
            break;
        put(h, i, h->item[best]);
        i = best;
    }
    put(h, i, item);
}

void mni_heap_set(mni_heap *h, uint32_t vertex, mni_heap_key key) {
    uint32_t i = h->at[vertex];
    mni_heap_item item = {key, vertex};
    if (i == UINT32_MAX)
        up(h, h->count++, item);
    else if (less(item, h->item[i]))
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
    if (less(last, gone))
        up(h, i, last);
    else
        down(h, i, last);
}
