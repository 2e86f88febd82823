/* What a pass has still to do. See agenda.h.
 *
 * Hides: a run sorted by radix, which costs a few nanoseconds an item where a heap costs its
 * logarithm in cache misses, and a small heap, or a queue, for what comes later. Navigate only;
 * memory from the arena at open. Paper: none. */
#include "agenda.h"

#include <string.h>

#include "mn_assert.h"

enum {
    FEW = 256,      /* items: a radix pass costs as much as so many steps of a heap */
    TIE_STEPS = 16, /* an item, of insertion: what a heap would cost */
};

size_t mni_agenda_need(uint32_t max) {
    return mni_arena_need(max, sizeof(mni_agenda_item), 64);
}

void mni_agenda_open(mni_agenda *a, uint32_t max, mni_arena *arena) {
    *a = (mni_agenda){.item = mni_arena_take(arena, max, sizeof *a->item, 64), .max = max};
    mni_agenda_clear(a);
}

void mni_agenda_clear(mni_agenda *a) {
    a->heap = a->head = 0;
    a->next = a->max;
    a->queues = false;
}

static inline bool before(const mni_agenda_item *a, const mni_agenda_item *b) {
    return mni_agenda_rank(a) < mni_agenda_rank(b);
}

/* ---- the heap: four below each --------------------------------------------------------------- */

static inline void sift_up(mni_agenda_item *item, uint32_t top, uint32_t at,
                           mni_agenda_item moving) {
    for (uint32_t up; at > top && before(&moving, &item[up = (at - 1) / 4]); at = up)
        item[at] = item[up];
    item[at] = moving;
}

/* The least of the four that begin there. Sums, where a choice would be guessed at. */
static inline uint32_t least_of_four(const mni_agenda_item *item, uint32_t first) {
    uint32_t a = first + before(&item[first + 1], &item[first]);
    uint32_t b = first + 2 + before(&item[first + 3], &item[first + 2]);
    return a + (b - a) * before(&item[b], &item[a]);
}

/* To the bottom first, where what comes from there belongs: so the way is not guessed at. */
static void sift_down(mni_agenda_item *item, uint32_t count, uint32_t at, mni_agenda_item moving) {
    uint32_t top = at, first, least;
    for (; (first = 4 * at + 1) + 3 < count; at = least) {
        least = least_of_four(item, first);
        item[at] = item[least];
    }
    if (first < count) {
        least = first;
        for (uint32_t i = first + 1; i < count; i++)
            least = before(&item[i], &item[least]) ? i : least;
        item[at] = item[least];
        at = least;
    }
    sift_up(item, top, at, moving);
}

static void heapify(mni_agenda_item *item, uint32_t count) {
    for (uint32_t at = (count + 2) / 4; at-- > 0;)
        sift_down(item, count, at, item[at]);
}

/* At the end; what has been taken from the front is room. */
static void queue_push(mni_agenda *a, mni_agenda_item item) {
    if (a->heap == a->next) {
        MN_ASSERT(a->head > 0);
        memmove(a->item, a->item + a->head, (a->heap - a->head) * sizeof *a->item);
        a->heap -= a->head;
        a->head = 0;
    }
    a->item[a->heap++] = item;
}

void mni_agenda_push(mni_agenda *a, mni_agenda_item item) {
    if (a->queues) {
        queue_push(a, item);
        return;
    }
    MN_ASSERT(!mni_agenda_is_full(a));
    sift_up(a->item, 0, a->heap++, item);
}

/* ---- the sorted run -------------------------------------------------------------------------- */

void mni_agenda_add(mni_agenda *a, mni_agenda_item item) {
    MN_ASSERT(a->heap < a->max);
    a->item[a->heap++] = item;
}

/* One pass of 11 bits of the key, from one place to another. */
static void radix_pass(const mni_agenda_item *from, mni_agenda_item *to, uint32_t count,
                       int shift) {
    uint32_t start[2049] = {0};
    for (uint32_t i = 0; i < count; i++)
        start[1 + ((from[i].key >> shift) & 2047)]++;
    for (int d = 0; d < 2048; d++)
        start[d + 1] += start[d];
    for (uint32_t i = 0; i < count; i++)
        to[start[(from[i].key >> shift) & 2047]++] = from[i];
}

/* By their keys, to the end of the array: there they begin. */
static mni_agenda_item *sort(mni_agenda *a) {
    mni_agenda_item *end = a->item + (a->max - a->heap);
    radix_pass(a->item, end, a->heap, 0);
    radix_pass(end, a->item, a->heap, 11);
    radix_pass(a->item, end, a->heap, 22);
    return end;
}

/* Equal keys are few, or nearly sorted already. false: they are not, as in a file where every node
 * has one error, and the order of all is unsettled. */
static bool insert_ties(mni_agenda_item *item, uint32_t count) {
    uint64_t steps_left = (uint64_t)TIE_STEPS * count;
    for (uint32_t i = 1; i < count && steps_left > 0; i++) {
        mni_agenda_item moving = item[i];
        uint32_t at = i;
        for (; at > 0 && item[at - 1].key == moving.key && before(&moving, &item[at - 1]); at--)
            item[at] = item[at - 1];
        item[at] = moving;
        steps_left -= i - at < steps_left ? i - at : steps_left;
    }
    return steps_left > 0;
}

void mni_agenda_begin(mni_agenda *a) {
    uint32_t count = a->heap;
    if (count < FEW || 2 * count > a->max) {
        heapify(a->item, count); /* and they stay there */
        return;
    }
    mni_agenda_item *end = sort(a);
    if (!insert_ties(end, count)) {
        memcpy(a->item, end, count * sizeof *end);
        heapify(a->item, count);
        return;
    }
    a->heap = 0;
    a->next = a->max - count;
}

void mni_agenda_begin_queue(mni_agenda *a) {
    const uint32_t count = a->heap;
    a->queues = true;
    if (count < FEW || 2 * count > a->max)
        return; /* they are a queue as they stand */
    sort(a);
    a->heap = 0;
    a->next = a->max - count;
}

/* Of a queue. */
static bool queue_pop(mni_agenda *a, mni_agenda_item *out) {
    if (a->head < a->heap) {
        *out = a->item[a->head++];
        if (a->head == a->heap)
            a->head = a->heap = 0;
        return true;
    }
    if (a->next == a->max)
        return false;
    *out = a->item[a->next++];
    return true;
}

bool mni_agenda_pop(mni_agenda *a, mni_agenda_item *out) {
    if (a->queues)
        return queue_pop(a, out);
    bool sorted = a->next < a->max;
    if (!sorted && a->heap == 0)
        return false;
    if (sorted && (a->heap == 0 || before(&a->item[a->next], &a->item[0]))) {
        *out = a->item[a->next++];
        return true;
    }
    *out = a->item[0];
    a->heap--;
    if (a->heap > 0)
        sift_down(a->item, a->heap, 0, a->item[a->heap]);
    return true;
}

const mni_agenda_item *mni_agenda_ahead(mni_agenda *a, uint32_t *count) {
    uint32_t left = a->max - a->next;
    *count = *count < left ? *count : left;
    return a->item + a->next;
}

void mni_agenda_unmark(mni_agenda *a, uint32_t bit) {
    for (uint32_t i = 0; i < a->heap; i++)
        a->item[i].key &= ~bit;
    heapify(a->item, a->heap);
}

void mni_agenda_keep(mni_agenda *a, bool (*keep)(const void *context, mni_agenda_item item),
                     const void *context) {
    uint32_t kept = 0, to = a->max;
    for (uint32_t i = 0; i < a->heap; i++)
        if (keep(context, a->item[i]))
            a->item[kept++] = a->item[i];
    a->heap = kept;
    heapify(a->item, kept);
    for (uint32_t i = a->max; i-- > a->next;)
        if (keep(context, a->item[i]))
            a->item[--to] = a->item[i];
    a->next = to;
}
