/* How what a phase needs becomes a number to type: which option bounds it, and what of that is not
 * the phase's. A refusal names a cap with which the same refusal does not come again. */
#ifndef MNI_CAP_H
#define MNI_CAP_H

#include <stdint.h>

typedef struct mni_cap {
    const char *option;    /* NULL: --ram */
    uint64_t beside_bytes; /* what else the process takes of it */
    uint64_t small_bytes;  /* of what is above it, */
    uint32_t spare_part;   /* one part of so many is kept in hand; 0: none */
} mni_cap;

static inline const char *mni_cap_option(const mni_cap *cap) {
    return cap->option != NULL ? cap->option : "--ram";
}

/* What a phase has of a cap. */
static inline uint64_t mni_cap_work(const mni_cap *cap, uint64_t bytes) {
    const uint64_t spare = cap->spare_part > 0 && bytes > cap->small_bytes
                               ? (bytes - cap->small_bytes) / cap->spare_part
                               : 0;
    return bytes > cap->beside_bytes + spare ? bytes - cap->beside_bytes - spare : 1;
}

/* The least whole MB that hold so much. */
static inline unsigned long long mni_megabytes(uint64_t bytes) {
    return (unsigned long long)((bytes + (1 << 20) - 1) >> 20);
}

/* The least cap, in whole MB, of which a phase has so much. */
static inline unsigned long long mni_cap_megabytes(const mni_cap *cap, uint64_t work_bytes) {
    const uint64_t small = work_bytes + cap->beside_bytes;
    const uint64_t spare = cap->spare_part > 0 && small > cap->small_bytes
                               ? (small - cap->small_bytes) / (cap->spare_part - 1) + 1
                               : 0;
    return mni_megabytes(small + spare);
}

#endif
