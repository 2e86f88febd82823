/* What a cell may do at a frozen hub (frozen.h), of whose simplices it holds a part.
 *
 * All simplices of a vertex whose ring is here are here, those with the hub among them. So whatever
 * does not concern two hubs, or vertices at the border, is seen. One thread; no memory. */
#ifndef MNI_FREEZE_H
#define MNI_FREEZE_H

#include "simplify.h"

/* Makes v a hub that offers nothing itself, with such a key around it. False: no memory. */
bool mni_freeze(mni_simplifier *s, uint32_t v, float around);
/* Of r and a hub k: whether k is not frozen, or all is seen that it takes to know whether r may go
 * into it. Where that would leave two hubs without a simplex that joins them here, it is not. */
bool mni_freeze_sees(mni_simplifier *s, uint32_t r, uint32_t k);

#endif
