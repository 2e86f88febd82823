/* What a chain needs of a pool that is nearly full, known before it is split. See scarce.c. */
#ifndef MNI_SCARCE_H
#define MNI_SCARCE_H

#include "navigate.h"

/* A chain begins, which is to split what stands at the bottom of the stack; or so many more have
 * been pushed onto it, from there on. Is it known to need more blocks than there is room for? Then
 * the store is told so, as if it had been asked for them, and *who is where on the stack the node
 * stands, or another one that it blocks, that needs the last of them (mni_navigator.pusher).
 * Otherwise, when it begins, *all are on the stack that have been found to be split with it, each
 * above its pusher. */
bool mni_scarce_begin(mni_navigator *nav, uint32_t *all, uint32_t *who);
bool mni_scarce_pushed(mni_navigator *nav, uint32_t from, uint32_t pushed, uint32_t *who);

#endif
