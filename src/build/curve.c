/* See curve.h. */
#include "curve.h"

enum { BITS = MNI_CURVE_SIDE_BITS, SIDE = 1 << BITS };
_Static_assert(BITS <= 21, "three of them fit 64 bits");

mni_curve mni_curve_make(const float low[3], const float high[3], uint32_t round) {
    /* Multiples of irrational numbers that have nothing to do with each other: shifts of any
     * number of rounds are spread evenly. In 2^32nds. */
    static const uint32_t step[3] = {0xc13fa9a9u, 0x91e10da5u, 0x9e3779b9u};
    mni_curve c = {.turn = round % 3};
    double size = 0;
    for (int i = 0; i < 3; i++) {
        double side = (double)high[i] - low[i];
        size = side > size ? side : size;
        c.low[i] = low[i];
        c.shift[i] = (round * step[i]) >> (33 - BITS);
    }
    c.scale = size > 0 ? (SIDE / 2 - 1) / size : 0;
    return c;
}

uint64_t mni_curve_place(const mni_curve *c, const float p[3]) {
    uint64_t place = 0;
    for (int i = 3; i-- > 0;)
        place = place << MNI_PLACE_BITS | (uint64_t)(((double)p[i] - c->low[i]) * c->scale);
    return place;
}

/* Bit b goes to 3 b. */
static uint64_t spread(uint32_t x) {
    uint64_t s = x;
    s = (s | s << 32) & UINT64_C(0x001f00000000ffff);
    s = (s | s << 16) & UINT64_C(0x001f0000ff0000ff);
    s = (s | s << 8) & UINT64_C(0x100f00f00f00f00f);
    s = (s | s << 4) & UINT64_C(0x10c30c30c30c30c3);
    return (s | s << 2) & UINT64_C(0x1249249249249249);
}

uint64_t mni_curve_place_key(const mni_curve *c, uint64_t place) {
    uint32_t x[3];
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t side = (i + c->turn) % 3;
        x[i] = ((uint32_t)(place >> side * MNI_PLACE_BITS) & (SIDE / 2 - 1)) + c->shift[side];
    }
    for (uint32_t bit = SIDE / 2; bit > 1; bit /= 2)
        for (int i = 0; i < 3; i++) {
            uint32_t swap = x[i] & bit ? 0 : (x[0] ^ x[i]) & (bit - 1);
            x[0] ^= x[i] & bit ? bit - 1 : swap;
            x[i] ^= swap;
        }
    x[1] ^= x[0];
    x[2] ^= x[1];
    uint32_t flip = 0;
    for (uint32_t bit = SIDE / 2; bit > 1; bit /= 2)
        flip ^= x[2] & bit ? bit - 1 : 0;
    return spread(x[0] ^ flip) << 2 | spread(x[1] ^ flip) << 1 | spread(x[2] ^ flip);
}
