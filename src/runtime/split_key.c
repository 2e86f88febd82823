/* A split's turn as one number. See split_key.h.
 *
 * Hides: that positive floats compare as their bits do. By place a key is which of 32 ranks its
 * error is in, then its place. Floats half a doubling apart, 1 and 1.5 and 2, differ by 2^22 as
 * numbers.
 *
 * No memory. Paper: none. */
#include "split_key.h"

#include <math.h>
#include <string.h>

#include "mn_assert.h"

enum { RANKS = 32, HALF_DOUBLING_BITS = 22 };
_Static_assert((uint64_t)RANKS *MNI_SPLIT_PLACES <= MNI_SPLIT_KEYS, "keys by place are keys");

uint32_t mni_split_key(double priority_px) {
    float value = priority_px < 1e30 ? (float)priority_px : 1e30f;
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return MNI_SPLIT_KEYS - 1 - bits;
}

uint32_t mni_split_key_by_place(double priority_px, double tolerance_px, uint32_t place) {
    MN_ASSERT(place < MNI_SPLIT_PLACES);
    const uint32_t key = mni_split_key(priority_px), least = mni_split_key(fmax(tolerance_px, 0));
    const uint32_t halves = key < least ? (least - key) >> HALF_DOUBLING_BITS : 0;
    const uint32_t rank = RANKS - 1 - (halves < RANKS - 1 ? halves : RANKS - 1);
    return rank * MNI_SPLIT_PLACES + place;
}

double mni_split_key_px(uint32_t key) {
    uint32_t bits = (MNI_SPLIT_KEYS - 1 - key) & (MNI_SPLIT_KEYS - 1);
    float value;
    memcpy(&value, &bits, sizeof value);
    return nextafterf(value, INFINITY);
}

double mni_split_key_by_place_px(uint32_t key, double tolerance_px) {
    const uint32_t rank = key / MNI_SPLIT_PLACES;
    if (rank == 0)
        return INFINITY;
    return mni_split_key_px(mni_split_key(fmax(tolerance_px, 0)) -
                            ((RANKS - rank) << HALF_DOUBLING_BITS));
}
