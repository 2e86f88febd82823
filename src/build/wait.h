/* What waits in a part of the surface (mni_part). A collapse that would come next but for a closed
 * end is put off: it closes both its ends from its own cost on, and their rings from a few times as
 * much on, so that nothing goes before a cheaper one beside it. Who comes into such a ring later
 * waits as well. So what is closed stays so, and a candidate that is put off and closes nothing, as
 * four in five do, will never do anything while it is one: it is *idle*, and not offered.
 *
 * One thread; no memory of its own. */
#ifndef MNI_WAIT_H
#define MNI_WAIT_H

#include <float.h>
#include <math.h>

#include "simplify.h"

/* By trial, in cells of 8,192 vertices, on a scan of 134,345 and a globe of 145,262: vertices that
 * go on to a later round, all rounds counted, in parts of all; and how much farther from the
 * original half of the triangles are than when all is simplified at once.
 *
 *     2                  0.59 and 0.77    0.8 % and 0.7 %
 *     3                  0.50 and 0.56    1.3 % and 1.4 %
 *     4                  0.47 and 0.52    1.2 % and 1.8 %
 *     rings not closed                    2.5 % to 3 % */
#define MNI_WAIT_RING 3.0f

/* Where next to nothing waits any more: costs below this, which are rounding, count as this. */
#define MNI_WAIT_LEAST FLT_MIN

/* By which factor a collapse of a level may cost more than what waits beside it, as a power of two.
 * On the last level all that costs anything may go. */
static inline int mni_wait_log2(int level) {
    static const uint8_t log2[MNI_LEVELS] = {
        0, 1, 2, 3, 4, 6, 8, 12, 16, 32, 64, 128, FLT_MAX_EXP - FLT_MIN_EXP + 1};
    return log2[level];
}

/* From which cost on something is closed that is put off at this one. */
static inline float mni_wait_from(const mni_part *p, float cost) {
    if (p->slack > 1)
        cost = (float)(fmax((double)cost, (double)MNI_WAIT_LEAST) * p->slack);
    return cost;
}

/* From where on a vertex that waits for such a cost is closed. 0 is for vertices of other cells. */
static inline mni_heap_key mni_wait_key(float cost, uint32_t kept) {
    mni_heap_key key = mni_heap_key_make(cost, kept);
    return key > 0 ? key : 1;
}

/* Whether r → k, of such a key, is put off: an end is closed by then. */
static inline bool mni_wait_closed(const mni_part *p, uint32_t r, uint32_t k, mni_heap_key key) {
    return (p->closed[r] <= key) | (p->closed[k] <= key);
}

/* Whether to put it off would close what is open. */
static inline bool mni_wait_would_close(const mni_part *p, uint32_t r, uint32_t k,
                                        mni_heap_key key) {
    float cost = mni_wait_from(p, mni_heap_key_cost(key));
    mni_heap_key from = mni_wait_key(cost, mni_heap_key_kept(key));
    if ((p->closed[r] > from) | (p->closed[k] > from))
        return true;
    cost *= MNI_WAIT_RING;
    return p->rings && p->closed[r] > 0 && ((p->ring[r] > cost) | (p->ring[k] > cost));
}

/* r → k is put off, and may be legal. */
void mni_wait_close(mni_simplifier *s, uint32_t r, uint32_t k, mni_heap_key key);
/* Whether r → k would be put off and close nothing. */
static inline bool mni_wait_is_idle(const mni_part *p, uint32_t r, uint32_t k, mni_heap_key key) {
    return mni_wait_closed(p, r, k, key) && !mni_wait_would_close(p, r, k, key);
}

/* By which factor r → k costs more than what waits for it; 0: nothing does. */
double mni_wait_ratio(const mni_part *p, uint32_t r, uint32_t k, mni_heap_key key);
/* r → k is about to be made: it is counted by the least level on which it may be. Returns the
 * ratio, on a level without order. */
double mni_wait_count(mni_part *p, uint32_t r, uint32_t k, mni_heap_key key);
/* The least level on which r → k may be made. */
int mni_wait_level(double ratio);

/* n has come into v's ring, which may wait. */
static inline void mni_wait_meet(mni_part *p, uint32_t v, uint32_t n) {
    mni_heap_key from = mni_wait_key(p->ring[v], 0);
    if (p->ring[v] < INFINITY && from < p->closed[n])
        p->closed[n] = from;
}

/* Does everybody wait who stands beside a vertex that does? Hubs are left out. O(simplices). */
bool mni_wait_rings_hold(const mni_simplifier *s);

#endif
