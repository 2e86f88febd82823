/* Forks that wait for a neighbour to go: who waits for whom.
 *
 * A fork that is not wanted and that a neighbour blocks is looked at again when that neighbour
 * goes, or when the camera has moved enough for another verdict; a third of a front waits, and in a
 * slow flight next to nobody goes. Hides: a list a slot, linked both ways, in words of the records
 * of nodes and branches, which whoever comes here has at hand.
 *
 *     slot 7 ──waits──> branch 3 <──> branch 9        branches 3 and 9 wait for the node in slot 7
 *
 * waits, wait_next: a branch + 1, or 0: none. wait_before: the same; of the first, slot + 1 and
 * SLOT; 0: it does not wait. So records that have never been written to say the right thing.
 *
 * Any order of calls after open. Threads: Navigate only. No memory of its own. Paper: none. */
#include "waiting.h"

#include "mn_assert.h"

#define SLOT 0x80000000u

void mni_waiting_open(mni_waiting *w, mni_front *front) {
    *w = (mni_waiting){.front = front};
}

void mni_waiting_add(mni_waiting *w, uint32_t fork, uint32_t slot) {
    MN_ASSERT(!mni_waiting_has(w, fork) && fork < SLOT - 1 && slot < SLOT - 1);
    mni_front_branch *branch = w->front->branch;
    uint32_t *first = &w->front->node[slot].waits, next = *first;
    *first = fork + 1;
    branch[fork].wait_before = (slot + 1) | SLOT;
    branch[fork].wait_next = next;
    if (next != 0)
        branch[next - 1].wait_before = fork + 1;
    w->count++;
}

void mni_waiting_drop(mni_waiting *w, uint32_t fork) {
    mni_front_branch *branch = w->front->branch;
    uint32_t before = branch[fork].wait_before, next = branch[fork].wait_next;
    if (before == 0)
        return;
    if (before & SLOT)
        w->front->node[(before & ~SLOT) - 1].waits = next;
    else
        branch[before - 1].wait_next = next;
    if (next != 0)
        branch[next - 1].wait_before = before;
    branch[fork].wait_before = 0;
    w->count--;
}

uint32_t mni_waiting_wake(mni_waiting *w, uint32_t slot) {
    uint32_t *first = &w->front->node[slot].waits, woken = *first;
    for (uint32_t at = woken; at != 0; at = w->front->branch[at - 1].wait_next, w->count--)
        w->front->branch[at - 1].wait_before = 0;
    *first = 0;
    return woken - 1;
}

void mni_waiting_check(const mni_waiting *w) {
    const mni_front *f = w->front;
    uint32_t count = 0;
    for (uint32_t slot = 0; slot < f->slots_high; slot++) {
        uint32_t before = (slot + 1) | SLOT;
        for (uint32_t at = f->node[slot].waits; at != 0;
             before = at, at = f->branch[at - 1].wait_next, count++)
            MN_ASSERT(f->branch[at - 1].wait_before == before && count < w->count);
    }
    MN_ASSERT(count == w->count);
}
