/* A front of a tree by its leaves: where its active nodes begin.
 *
 * Nodes stand in rows (rows.h): that of an inner node is where its right child begins. So active
 * nodes begin at the rows of split nodes, and where roots begin. Any thread, as the owner says. */
#ifndef MNI_FRONT_H
#define MNI_FRONT_H

#include <stdbool.h>
#include <stdint.h>

typedef struct mni_front {
    uint32_t leaves;
    uint64_t *begins; /* a bit a leaf, and some more */
} mni_front;

/* Of such bits. */
static inline uint64_t mni_front_words(uint32_t leaves) {
    return (uint64_t)leaves / 64 + 1;
}
static inline bool mni_bit(const uint64_t *bits, uint32_t at) {
    return bits[at / 64] >> at % 64 & 1;
}
static inline void mni_bit_set(uint64_t *bits, uint32_t at) {
    bits[at / 64] |= UINT64_C(1) << at % 64;
}

/* The last leaf up to this one at which an active node begins; leaf 0 always is one. */
static inline uint32_t mni_front_begin(const mni_front *f, uint32_t leaf) {
    uint32_t word = leaf / 64;
    uint64_t bits = f->begins[word] & (UINT64_MAX >> (63 - leaf % 64));
    while (bits == 0 && word > 0)
        bits = f->begins[--word];
    return bits == 0 ? 0 : word * 64 + 63 - (uint32_t)__builtin_clzll(bits);
}

/* The first leaf past this one at which another begins, or how many leaves there are. */
static inline uint32_t mni_front_end(const mni_front *f, uint32_t leaf) {
    const uint64_t words = mni_front_words(f->leaves);
    uint32_t word = leaf / 64;
    uint64_t bits = f->begins[word] & (UINT64_MAX << 1 << leaf % 64);
    while (bits == 0 && ++word < words)
        bits = f->begins[word];
    const uint64_t end = bits == 0 ? f->leaves : word * 64 + (uint64_t)__builtin_ctzll(bits);
    return end < f->leaves ? (uint32_t)end : f->leaves;
}

#endif
