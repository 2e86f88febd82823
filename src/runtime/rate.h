/* How much a camera wants the blocks below a block: what the store asks of blocks that have come
 * (mni_store_rate). Pure; any thread. */
#ifndef MNI_RATE_H
#define MNI_RATE_H

#include "board.h"
#include "wanted.h"

/* What the camera sees, and will see in a moment. Plain data: posted as the store's look. */
typedef struct mni_look {
    mni_lens now, ahead;
    bool moves;           /* otherwise ahead is now */
    float coordinate_max; /* the model's largest */
} mni_look;

/* What a block does not say itself: where the root of one of its subtrees is. */
mni_note mni_rate_note(uint32_t subtree, const float position[3]);
/* urgency[i] of reference i: of the nodes whose records stand in that block the largest priority,
 * now or in a moment, over the tolerance; 0 where that is not above `least`; where it is 1 and
 * more, the first such that was found. below[i]: notes on it. Subtrees without notes are taken for
 * where their neighbours are; without any notes nothing is said. least 0, or a tolerance below: 1
 * for all. context: unused. The block has been checked. */
void mni_rate_block(const void *context, const void *look, const void *bytes,
                    const mni_notes *notes, float least, float *urgency, mni_notes *below);

#endif
