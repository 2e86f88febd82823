/* Chains that found no room in the pool: when they are tried again, and who goes before them. See
 * refusals.c. */
#ifndef MNI_REFUSALS_H
#define MNI_REFUSALS_H

#include "navigate.h"
#include "split_key.h"

/* In a key of a split by error: its turn comes after all others'. Floats above 0 lack that bit. */
#define MNI_PUT_OFF MNI_SPLIT_KEYS

/* A pass of splits begins, and ends. The agenda is empty. */
void mni_refusals_begin(mni_navigator *nav);
void mni_refusals_end(mni_navigator *nav);
/* Was the chain of a slot refused, or one that came by it, for a block that is known? */
static inline bool mni_refusals_has(const mni_navigator *nav, uint32_t slot) {
    return (nav->front.node[slot].flags & MNI_NODE_GIVEN_UP) != 0 &&
           nav->refusal[slot].block_id != 0;
}
/* Would the chain of a slot be refused as it was before? And that of a node that is barred? */
bool mni_refusals_stands(const mni_navigator *nav, uint32_t slot);
bool mni_refusals_stands_barred(const mni_navigator *nav, const mni_barred_node *node);
/* Only what is there has its turn, and what the chain of a slot was refused for is not. */
bool mni_refusals_lacks(const mni_navigator *nav, uint32_t slot);
/* Remembers what the chain of a slot has just been refused for. */
void mni_refusals_put(mni_navigator *nav, uint32_t slot);
/* A chain has been refused, and undone, at what stands there on the stack, for whose sake all those
 * were pushed that lead there: remembers it of each of them. */
void mni_refusals_put_on_the_way(mni_navigator *nav, uint32_t at);
/* Would a chain be refused at one of the `pushed` blockers above the top of the stack, as one was
 * before? Then the store is told so. */
bool mni_refusals_bar(mni_navigator *nav, uint32_t top, uint32_t pushed);
/* What a chain was refused for is sought, where places are scarce, if one place more would do. */
void mni_refusals_seek(mni_navigator *nav, const mni_refusal *refusal);
/* An item of the agenda that has been popped: does it have to wait? Then it is on the agenda again.
 */
bool mni_refusals_wait(mni_navigator *nav, mni_agenda_item item);
/* The chain of an item is a miss while only what is there has its turn. */
void mni_refusals_put_off(mni_navigator *nav, mni_agenda_item item);

#endif
