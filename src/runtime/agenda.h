/* What a pass has still to do, smallest key first, equal keys by the lower order id; or, of what
 * turns up later, first come first.
 *
 * What is known at the start is added and sorted at once; what turns up later is pushed. Navigate
 * only; a fixed array of the arena's.
 *
 *     item: | heap: pushed later … | free | sorted: added first, taken from its front |
 */
#ifndef MNI_AGENDA_H
#define MNI_AGENDA_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"

/* No two items are alike in key and order. order and what are the user's. Key above order: the two
 * are compared as one number. */
typedef struct mni_agenda_item {
    uint32_t order, key, what;
} mni_agenda_item;

typedef struct mni_agenda {
    mni_agenda_item *item;
    uint32_t max;
    uint32_t heap; /* items in the heap; before begin: added */
    uint32_t next; /* first of the sorted ones; max: there are no more */
    bool queues;   /* what is pushed is taken in the order of pushing, before the sorted ones … */
    uint32_t head; /* … from there, up to `heap` */
} mni_agenda;

size_t mni_agenda_need(uint32_t max);
void mni_agenda_open(mni_agenda *agenda, uint32_t max, mni_arena *arena);

/* clear; add all that is known; begin; then pop, push, keep in any order. */
void mni_agenda_clear(mni_agenda *agenda);
void mni_agenda_begin(mni_agenda *agenda);
/* Instead of begin: what is pushed later is a queue, which goes before what was added; few items,
 * of any order, are its first. Then pop and push only. */
void mni_agenda_begin_queue(mni_agenda *agenda);
static inline bool mni_agenda_is_full(const mni_agenda *agenda) {
    return agenda->heap == agenda->next;
}
void mni_agenda_add(mni_agenda *agenda, mni_agenda_item item);
/* The same, without a guess at whether. There is room, whether or not. */
static inline void mni_agenda_add_if(mni_agenda *agenda, mni_agenda_item item, bool is_one) {
    agenda->item[agenda->heap] = item;
    agenda->heap += is_one;
}
void mni_agenda_push(mni_agenda *agenda, mni_agenda_item item);
bool mni_agenda_pop(mni_agenda *agenda, mni_agenda_item *out); /* false: empty */
/* Key and order as one number, of an item and of the one that would be popped; of none the largest
 * there is. Not of a queue. */
static inline uint64_t mni_agenda_rank(const mni_agenda_item *item) {
    return (uint64_t)item->key << 32 | item->order;
}
static inline uint64_t mni_agenda_first(const mni_agenda *agenda) {
    const uint64_t pushed = agenda->heap > 0 ? mni_agenda_rank(&agenda->item[0]) : UINT64_MAX;
    const uint64_t added =
        agenda->next < agenda->max ? mni_agenda_rank(&agenda->item[agenda->next]) : UINT64_MAX;
    return pushed < added ? pushed : added;
}
/* What is to be popped next as far as nothing is pushed before it: up to count items, *count of
 * them. */
const mni_agenda_item *mni_agenda_ahead(mni_agenda *agenda, uint32_t *count);
/* Takes a bit off the keys of all that has been pushed. O(items pushed). */
void mni_agenda_unmark(mni_agenda *agenda, uint32_t bit);
/* Drops what is not worth keeping. O(items). */
void mni_agenda_keep(mni_agenda *agenda, bool (*keep)(const void *context, mni_agenda_item item),
                     const void *context);

#endif
