/* Forks that wait for a neighbour to go: who waits for whom. See waiting.c. */
#ifndef MNI_WAITING_H
#define MNI_WAITING_H

#include "front.h"

typedef struct mni_waiting {
    mni_front *front;
    uint32_t count; /* forks that wait */
} mni_waiting;

static inline bool mni_waiting_has(const mni_waiting *waiting, uint32_t fork) {
    return waiting->front->branch[fork].wait_before != 0;
}
/* In an opened front, of which nobody waits. */
void mni_waiting_open(mni_waiting *waiting, mni_front *front);
void mni_waiting_add(mni_waiting *waiting, uint32_t fork, uint32_t slot);
/* It waits no longer, if it did. */
void mni_waiting_drop(mni_waiting *waiting, uint32_t fork);
/* All that wait for a slot's node wait no longer: the first, or MN_NONE; the others by `next`,
 * until one of them waits again. */
uint32_t mni_waiting_wake(mni_waiting *waiting, uint32_t slot);
static inline uint32_t mni_waiting_next(const mni_waiting *waiting, uint32_t fork) {
    return waiting->front->branch[fork].wait_next - 1;
}
/* The first who waits for a slot's node to go, asked for ahead of time. */
static inline void mni_waiting_fetch(const mni_waiting *w, uint32_t slot) {
    const uint32_t first = w->front->node[slot].waits;
    __builtin_prefetch(&w->front->branch[first - (first != 0)]);
}
/* Asserts the equations of this struct. */
void mni_waiting_check(const mni_waiting *waiting);

#endif
