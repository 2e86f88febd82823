/* Forks that wait for a neighbour to go: who waits for whom. See waiting.c. */
#ifndef MNI_WAITING_H
#define MNI_WAITING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"

typedef struct mni_waiting {
    uint32_t *first;  /* a slot: the first fork that waits for its node, or MN_NONE */
    uint32_t *next;   /* a branch: the next fork that waits for the same, or MN_NONE */
    uint32_t *before; /* a branch: the fork before it; of the first, the slot, with SLOT set;
                         MN_NONE: it does not wait */
    uint32_t count;   /* forks that wait */
    uint32_t nodes_max;
} mni_waiting;

size_t mni_waiting_need(uint32_t nodes_max);
void mni_waiting_open(mni_waiting *waiting, uint32_t nodes_max, mni_arena *arena);

static inline bool mni_waiting_has(const mni_waiting *waiting, uint32_t fork) {
    return waiting->before[fork] != UINT32_MAX;
}
void mni_waiting_add(mni_waiting *waiting, uint32_t fork, uint32_t slot);
/* It waits no longer, if it did. */
void mni_waiting_drop(mni_waiting *waiting, uint32_t fork);
/* All that wait for a slot's node wait no longer: the first, or MN_NONE; the others by `next`. */
uint32_t mni_waiting_wake(mni_waiting *waiting, uint32_t slot);
/* Asserts the equations of this struct. */
void mni_waiting_check(const mni_waiting *waiting);

#endif
