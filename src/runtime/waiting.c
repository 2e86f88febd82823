/* Forks that wait for a neighbour to go: who waits for whom.
 *
 * A fork that is not wanted and that a neighbour blocks is looked at again when that neighbour
 * goes, or when the camera has moved enough for another verdict; a third of a front waits, and in a
 * slow flight next to nobody goes. Thousands may wait for a hub, which goes as often as one of them
 * has had its turn: so whoever has its place then takes over those that it blocks as well, unseen.
 *
 * Hides: a pairing heap a slot, of least order ids first, in words of the records of nodes and
 * branches, which whoever comes here has at hand. So a heap passes from slot to slot whole, and
 * those of it who need not wait are found at its top.
 *
 *     slot 7 ──waits──> branch 3      branch 9 waits for the node in slot 7 as branch 3 does, whose
 *                          │          order id is less; 12 and 9 are neighbours on a list, in both
 *                        below        directions, that begins at `below` of 3
 *                          ▼
 *                      branch 12 <─next, before─> branch 9
 *
 * waits, wait_below, wait_next: a branch + 1, or 0: none. wait_before: the same, of the first of a
 * list the one above it; of a top, slot + 1 and SLOT; 0: it does not wait. So records that have
 * never been written to say the right thing.
 *
 * Any order of calls after open. Threads: Navigate only. No memory of its own. Paper: none;
 * Fredman, Sedgewick, Sleator and Tarjan 1986. */
#include "waiting.h"

#include "mn_assert.h"

#define SLOT 0x80000000u

void mni_waiting_open(mni_waiting *w, mni_front *front) {
    *w = (mni_waiting){.front = front};
}

/* ---- heaps: a top's number + 1, or 0 --------------------------------------------------------- */

static inline mni_front_branch *at(const mni_waiting *w, uint32_t one) {
    return &w->front->branch[one - 1];
}

/* Two heaps that hang nowhere are one. */
static uint32_t meld(mni_waiting *w, uint32_t a, uint32_t b) {
    if (a == 0 || b == 0)
        return a + b;
    if (at(w, b)->order < at(w, a)->order) {
        const uint32_t swap = a;
        a = b;
        b = swap;
    }
    mni_front_branch *top = at(w, a), *under = at(w, b);
    under->wait_next = top->wait_below;
    under->wait_before = a;
    if (top->wait_below != 0)
        at(w, top->wait_below)->wait_before = b;
    top->wait_below = b;
    return a;
}

/* The heaps of a list are one: in pairs from the front, then all from the back. */
static uint32_t meld_list(mni_waiting *w, uint32_t first) {
    uint32_t pairs = 0, all = 0;
    if (first == 0 || at(w, first)->wait_next == 0)
        return first;
    while (first != 0) {
        const uint32_t second = at(w, first)->wait_next;
        const uint32_t rest = second != 0 ? at(w, second)->wait_next : 0;
        const uint32_t pair = meld(w, first, second);
        at(w, pair)->wait_next = pairs;
        pairs = pair;
        first = rest;
    }
    while (pairs != 0) {
        const uint32_t rest = at(w, pairs)->wait_next;
        all = meld(w, all, pairs);
        pairs = rest;
    }
    return all;
}

static void hang(mni_waiting *w, uint32_t slot, uint32_t heap) {
    w->front->node[slot].waits = heap;
    if (heap == 0)
        return;
    at(w, heap)->wait_before = (slot + 1) | SLOT;
    at(w, heap)->wait_next = 0;
}

/* ---- who waits ------------------------------------------------------------------------------- */

void mni_waiting_add(mni_waiting *w, uint32_t fork, uint32_t slot) {
    MN_ASSERT(!mni_waiting_has(w, fork) && fork < SLOT - 1 && slot < SLOT - 1);
    w->front->branch[fork].wait_below = 0;
    hang(w, slot, meld(w, fork + 1, w->front->node[slot].waits));
    w->count++;
}

void mni_waiting_drop_some(mni_waiting *w, uint32_t fork) {
    mni_front_branch *gone = &w->front->branch[fork];
    const uint32_t before = gone->wait_before, next = gone->wait_next;
    const uint32_t heap = meld_list(w, gone->wait_below);
    if (before & SLOT) {
        hang(w, (before & ~SLOT) - 1, heap);
    } else { /* those below it have greater order ids, and take its place */
        const uint32_t here = heap != 0 ? heap : next;
        if (at(w, before)->wait_below == fork + 1)
            at(w, before)->wait_below = here;
        else
            at(w, before)->wait_next = here;
        if (here != 0)
            at(w, here)->wait_before = before;
        if (heap != 0) {
            at(w, heap)->wait_next = next;
            if (next != 0)
                at(w, next)->wait_before = heap;
        }
    }
    gone->wait_before = 0;
    w->count--;
}

void mni_waiting_pass_some(mni_waiting *w, uint32_t from, uint32_t to) {
    const uint32_t heap = w->front->node[from].waits;
    w->front->node[from].waits = 0;
    hang(w, to, meld(w, heap, w->front->node[to].waits));
}

uint32_t mni_waiting_wake_some(mni_waiting *w, uint32_t slot, uint32_t order) {
    const uint32_t top = w->front->node[slot].waits;
    mni_front_branch *first = at(w, top);
    if (first->order > order)
        return MN_NONE;
    hang(w, slot, meld_list(w, first->wait_below));
    first->wait_before = 0;
    w->count--;
    return top - 1;
}

/* The first of a list is beneath its end, and none of it less. */
static uint32_t above_list(const mni_waiting *w, uint32_t last) {
    uint32_t here = last, before;
    while (before = at(w, here)->wait_before, at(w, before)->wait_below != here)
        here = before;
    for (; here != 0; here = at(w, here)->wait_next)
        MN_ASSERT(at(w, here)->order >= at(w, before)->order);
    return before;
}

void mni_waiting_check(const mni_waiting *w) {
    const mni_front *f = w->front;
    uint32_t count = 0;
    for (uint32_t slot = 0; slot < f->slots_high; slot++) {
        const uint32_t top = f->node[slot].waits;
        uint32_t here = top, before = (slot + 1) | SLOT;
        while (here != 0) { /* down, or on, or up until one can go on */
            MN_ASSERT(at(w, here)->wait_before == before && count < w->count);
            count++;
            before = here;
            here = at(w, before)->wait_below;
            while (here == 0 && before != top && (here = at(w, before)->wait_next) == 0)
                before = above_list(w, before);
        }
        MN_ASSERT(top == 0 || at(w, top)->wait_next == 0);
    }
    MN_ASSERT(count == w->count);
}
