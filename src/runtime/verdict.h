/* Until when a verdict on a node stands, and what a batch is asked of both cameras: for whoever
 * judges, slots for splits (navigate.c) and forks for collapses (collapse.c). In their loops. */
#ifndef MNI_VERDICT_H
#define MNI_VERDICT_H

#include <math.h>

#include "navigate.h"

/* Nobody is in the slot, or a leaf: who comes sets it. */
#define MNI_DUE_NEVER INFINITY

/* The reading of the clock up to which a verdict stands, rounded down: without a margin it is past.
 */
static inline float mni_due_after(const mni_navigator *nav, float margin) {
    return (nav->clock + margin) * (1 - 1e-6f);
}

static inline float mni_nearer(float a, float b) {
    return a < b ? a : b;
}

/* What the camera in a moment says to the batch: nothing is wanted by it where nothing is done
 * early. */
static inline void mni_judge_soon(const mni_navigator *nav, uint8_t verdict[MNI_SIEVE_BATCH],
                                  float margin[MNI_SIEVE_BATCH]) {
    if (nav->early) {
        mni_sieve_judge(&nav->ahead.soon.sieve, &nav->batch, verdict, margin);
        return;
    }
    for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
        verdict[i] = MNI_UNWANTED;
        margin[i] = INFINITY;
    }
}

#endif
