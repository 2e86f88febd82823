/* Hilbert's curve through the box of a model: vertices near each other on it are near in space.
 *
 * Each round cuts it into cells; so that the same places are not at the border again, each round
 * has a curve of its own, the box shifted and turned. No memory, any thread. Keys are the same on
 * every machine. Skilling, Programming the Hilbert curve (2004). */
#ifndef MNI_CURVE_H
#define MNI_CURVE_H

#include <stdint.h>

enum {
    MNI_CURVE_SIDE_BITS = 21,
    MNI_CURVE_BITS = 3 * MNI_CURVE_SIDE_BITS, /* of a key */
    MNI_PLACE_BITS = MNI_CURVE_SIDE_BITS - 1, /* of a place's side: half of the curve's */
};

typedef struct mni_curve {
    float low[3]; /* of the box */
    double scale; /* to half the curve's cube */
    uint32_t shift[3];
    uint32_t turn; /* which side goes first */
} mni_curve;

/* Of the round'th round; any number. high ≥ low, all finite. */
mni_curve mni_curve_make(const float low[3], const float high[3], uint32_t round);
/* On the grid of all rounds' curves; p inside the box. */
uint64_t mni_curve_place(const mni_curve *curve, const float p[3]);
/* Where on the curve a place is. Below 2^MNI_CURVE_BITS. */
uint64_t mni_curve_place_key(const mni_curve *curve, uint64_t place);

static inline uint64_t mni_curve_key(const mni_curve *curve, const float p[3]) {
    return mni_curve_place_key(curve, mni_curve_place(curve, p));
}

#endif
