/* Counting different things in little memory, by HyperLogLog: a register for each of 16,384 kinds
 * of hash keeps the longest run of leading zeros seen, which grows with the logarithm of their
 * number. Any thread, one a sketch. Owns nothing. */
#include "sketch.h"

#include <math.h>

static const double error = 1.04 / (1 << MNI_SKETCH_BITS / 2); /* Flajolet et al., theorem 1 */

void mni_sketch_add(mni_sketch *sketch, uint64_t hash) {
    uint64_t at = hash >> (64 - MNI_SKETCH_BITS);
    uint64_t rest = hash << MNI_SKETCH_BITS | UINT64_C(1) << (MNI_SKETCH_BITS - 1);
    uint8_t run = (uint8_t)(__builtin_clzll(rest) + 1);
    if (run > sketch->longest[at])
        sketch->longest[at] = run;
}

uint64_t mni_sketch_bound(const mni_sketch *sketch) {
    const double m = MNI_SKETCH_REGISTERS, alpha = 0.7213 / (1 + 1.079 / m);
    double sum = 0, empty = 0;
    for (int i = 0; i < MNI_SKETCH_REGISTERS; i++) {
        sum += ldexp(1, -sketch->longest[i]);
        empty += sketch->longest[i] == 0;
    }
    double estimate = alpha * m * m / sum;
    if (estimate <= 2.5 * m && empty > 0) /* few: the empty registers tell more */
        estimate = m * log(m / empty);
    return (uint64_t)(estimate * (1 + 5 * error)) + 1;
}
