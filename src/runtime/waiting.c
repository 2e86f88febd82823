/* Forks that wait for a neighbour to go: who waits for whom.
 *
 * A fork that is not wanted and that a neighbour blocks is looked at again when that neighbour
 * goes, or when the camera has moved enough for another verdict; a third of a front waits, and in a
 * slow flight next to nobody goes. Hides: a list a slot, linked both ways.
 *
 *     slot 7 ──first──> branch 3 <──> branch 9        branches 3 and 9 wait for the node in slot 7
 *
 * Any order of calls after open. Threads: Navigate only. Memory: 12 bytes a node, from the arena.
 * Paper: none. */
#include "waiting.h"

#include <string.h>

#include "assert.h"
#include "metanode/format.h"

#define SLOT 0x80000000u

size_t mni_waiting_need(uint32_t nodes_max) {
    return 3 * mni_arena_need(nodes_max, sizeof(uint32_t), 64);
}

void mni_waiting_open(mni_waiting *w, uint32_t nodes_max, mni_arena *arena) {
    *w = (mni_waiting){.first = mni_arena_take(arena, nodes_max, sizeof *w->first, 64),
                       .next = mni_arena_take(arena, nodes_max, sizeof *w->next, 64),
                       .before = mni_arena_take(arena, nodes_max, sizeof *w->before, 64),
                       .nodes_max = nodes_max};
    memset(w->first, 0xff, nodes_max * sizeof *w->first);
    memset(w->before, 0xff, nodes_max * sizeof *w->before);
}

void mni_waiting_add(mni_waiting *w, uint32_t fork, uint32_t slot) {
    MN_ASSERT(!mni_waiting_has(w, fork) && fork < SLOT && slot < SLOT);
    uint32_t next = w->first[slot];
    w->first[slot] = fork;
    w->before[fork] = slot | SLOT;
    w->next[fork] = next;
    if (next != MN_NONE)
        w->before[next] = fork;
    w->count++;
}

void mni_waiting_drop(mni_waiting *w, uint32_t fork) {
    uint32_t before = w->before[fork], next = w->next[fork];
    if (before == MN_NONE)
        return;
    if (before & SLOT)
        w->first[before & ~SLOT] = next;
    else
        w->next[before] = next;
    if (next != MN_NONE)
        w->before[next] = before;
    w->before[fork] = MN_NONE;
    w->count--;
}

uint32_t mni_waiting_wake(mni_waiting *w, uint32_t slot) {
    uint32_t first = w->first[slot];
    for (uint32_t at = first; at != MN_NONE; at = w->next[at], w->count--)
        w->before[at] = MN_NONE;
    w->first[slot] = MN_NONE;
    return first;
}

void mni_waiting_check(const mni_waiting *w) {
    uint32_t count = 0;
    for (uint32_t slot = 0; slot < w->nodes_max; slot++) {
        uint32_t before = slot | SLOT;
        for (uint32_t at = w->first[slot]; at != MN_NONE; before = at, at = w->next[at], count++)
            MN_ASSERT(w->before[at] == before && count < w->count);
    }
    MN_ASSERT(count == w->count);
}
