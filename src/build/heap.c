/* See heap.h. Hidden here: the order of items in memory, and that choosing is arithmetic, since
 * which of four children is least cannot be predicted. */
#include "heap.h"

#include "mem.h"

enum { ARITY = 4, LINE_BYTES = ARITY * sizeof(mni_heap_item) };

bool mni_heap_open(mni_heap *h, uint32_t vertices) {
    size_t lines = (size_t)vertices / ARITY + 2;
    mni_heap_item *line = mni_mem_take(lines * LINE_BYTES, 0);
    *h = (mni_heap){.item = line != NULL ? line + ARITY - 1 : NULL,
                    .at = mni_mem_take((size_t)vertices * sizeof *h->at, 0)};
    if (h->item == NULL || h->at == NULL) {
        mni_heap_close(h);
        return false;
    }
    memset(h->at, 0xff, (size_t)vertices * sizeof *h->at);
    return true;
}

void mni_heap_close(mni_heap *h) {
    if (h->item != NULL)
        mni_mem_give(h->item - (ARITY - 1));
    mni_mem_give(h->at);
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

/* Which of four items in a row is the least. */
static inline uint32_t least_of_four(const mni_heap_item *item) {
    uint32_t a = less(&item[1], &item[0]), b = 2u + less(&item[3], &item[2]);
    return a ^ ((a ^ b) & (0u - less(&item[b], &item[a])));
}

uint32_t mni_heap_second(const mni_heap *h) {
    return 1 + least_of_four(&h->item[1]);
}

static void down(mni_heap *h, uint32_t i, mni_heap_item item) {
    for (;;) {
        uint64_t first = (uint64_t)i * ARITY + 1;
        if (first >= h->count)
            break;
        if ((first + ARITY) * ARITY < h->count) /* one of the children's children's lines is next */
            for (uint64_t c = 0; c < ARITY; c++)
                __builtin_prefetch(&h->item[(first + c) * ARITY + 1]);
        uint32_t best = (uint32_t)first;
        if (first + ARITY <= h->count)
            best += least_of_four(&h->item[first]);
        else
            for (uint32_t c = best + 1; c < h->count; c++)
                best = less(&h->item[c], &h->item[best]) ? c : best;
        if (!less(&h->item[best], &item))
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
