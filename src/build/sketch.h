/* How many different things have been seen, from their hashes, in 16 kB: HyperLogLog (Flajolet et
 * al. 2007). The standard error is 0.8 %. Threads: one a sketch. */
#ifndef MNI_SKETCH_H
#define MNI_SKETCH_H

#include <stdint.h>

enum { MNI_SKETCH_BITS = 14, MNI_SKETCH_REGISTERS = 1 << MNI_SKETCH_BITS };

/* All zero is a sketch that has seen nothing. */
typedef struct mni_sketch {
    uint8_t longest[MNI_SKETCH_REGISTERS]; /* run of zeros + 1 among its hashes; 0: none came */
} mni_sketch;

void mni_sketch_add(mni_sketch *sketch, uint64_t hash);
/* Above the true number but for one case in a million: five standard errors are added. */
uint64_t mni_sketch_bound(const mni_sketch *sketch);

#endif
