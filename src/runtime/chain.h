/* Chains: a split with all the splits that must be made before it. See chain.c. */
#ifndef MNI_CHAIN_H
#define MNI_CHAIN_H

#include "navigate.h"

/* Splits slot and, before it, what must be split before it. Whoever calls keeps the splits that
 * stand after it: *count, in nav->chain. All of the chain with MNI_DONE; with MNI_MISS what there
 * are blocks for, or none; otherwise none. */
mni_outcome mni_chain_find(mni_navigator *nav, uint32_t slot, uint32_t *count);
/* After every operation on models under 2,000 triangles, where slow checks are built in. */
void mni_chain_check_small(const mni_navigator *nav);

#endif
