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
void mni_waiting_drop_some(mni_waiting *waiting, uint32_t fork);
/* It waits no longer, if it did. */
static inline void mni_waiting_drop(mni_waiting *waiting, uint32_t fork) {
    if (mni_waiting_has(waiting, fork))
        mni_waiting_drop_some(waiting, fork);
}
void mni_waiting_pass_some(mni_waiting *waiting, uint32_t from, uint32_t to);
/* Who waits for the node of one slot waits for that of another. */
static inline void mni_waiting_pass(mni_waiting *waiting, uint32_t from, uint32_t to) {
    if (waiting->front->node[from].waits != 0)
        mni_waiting_pass_some(waiting, from, to);
}
uint32_t mni_waiting_wake_some(mni_waiting *waiting, uint32_t slot, uint32_t order);
/* Of those that wait for a slot's node the one of the least order id, if that is no more than
 * `order`, waits no longer: that fork, or MN_NONE. */
static inline uint32_t mni_waiting_wake(mni_waiting *waiting, uint32_t slot, uint32_t order) {
    return waiting->front->node[slot].waits == 0 ? MN_NONE
                                                 : mni_waiting_wake_some(waiting, slot, order);
}
/* The first of those that wait for a slot's node to go, asked for ahead of time. */
static inline void mni_waiting_fetch(const mni_waiting *w, uint32_t slot) {
    const uint32_t first = w->front->node[slot].waits;
    __builtin_prefetch(&w->front->branch[first - (first != 0)]);
}
/* Asserts the equations of this struct. */
void mni_waiting_check(const mni_waiting *waiting);

#endif
