/* See heavy.h. Hidden here: how counters are found. */
#include "heavy.h"

#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"

bool mni_heavy_open(mni_heavy *h, uint32_t counters) {
    *h = (mni_heavy){.most = counters, .room = 16};
    while (h->room < 2 * counters)
        h->room *= 2;
    h->counter = calloc(h->room, sizeof *h->counter);
    h->scratch = calloc(h->room, sizeof *h->scratch);
    if (h->counter != NULL && h->scratch != NULL)
        return true;
    mni_heavy_close(h);
    return false;
}

void mni_heavy_close(mni_heavy *h) {
    free(h->counter);
    free(h->scratch);
    *h = (mni_heavy){0};
}

/* Its counter, or the free one where it would be. */
static mni_heavy_counter *find(const mni_heavy *h, uint32_t number) {
    uint32_t at = number * 0x9e3779b1u;
    for (at ^= at >> 15;; at++) {
        mni_heavy_counter *c = &h->counter[at & (h->room - 1)];
        if (c->count == 0 || c->number == number)
            return c;
    }
}

/* Lowers all by as much as the least of them has, and no more than `weight`. Returns by how much.
 */
static uint32_t lower_all(mni_heavy *h, uint32_t weight) {
    uint32_t by = weight;
    for (uint32_t i = 0; i < h->room; i++)
        if (h->counter[i].count > 0 && h->counter[i].count < by)
            by = h->counter[i].count;
    mni_heavy_counter *old = h->counter;
    h->counter = h->scratch;
    h->scratch = old;
    memset(h->counter, 0, h->room * sizeof *h->counter);
    h->used = 0;
    for (uint32_t i = 0; i < h->room; i++)
        if (old[i].count > by) {
            *find(h, old[i].number) = (mni_heavy_counter){old[i].number, old[i].count - by};
            h->used++;
        }
    return by;
}

void mni_heavy_add(mni_heavy *h, uint32_t number, uint32_t weight) {
    mni_heavy_counter *c = find(h, number);
    MN_ASSERT(weight > 0);
    while (c->count == 0 && h->used == h->most) {
        weight -= lower_all(h, weight);
        if (weight == 0)
            return;
        c = find(h, number);
    }
    h->used += c->count == 0;
    c->number = number;
    c->count += weight;
}

uint32_t mni_heavy_take(mni_heavy *h, uint32_t least, mni_heavy_counter **taken) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < h->room; i++)
        if (h->counter[i].count > least)
            h->scratch[count++] = h->counter[i];
    *taken = h->scratch;
    return count;
}
