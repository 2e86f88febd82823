/* Blocks that have been looked at. See seen.h.
 *
 * Hides: how a digest is made. Bytes are taken seven at a time, as numbers below the modulus, and
 * are the coefficients of four polynomials in the fourth power of the point, side by side so that
 * multiplications overlap; they become one, and what is left, the block's place and its length are
 * its last coefficients. So different blocks are different polynomials, and agree at as many points
 * as the degree says at most. No order of calls after open; paper: none. */
#include "seen.h"

#include <string.h>
#include <sys/random.h>

#include "assert.h"

__extension__ typedef unsigned __int128 wide;

#define PRIME ((UINT64_C(1) << 61) - 1)
enum { TAKEN = 7, LANES = 4, GROUP = LANES * TAKEN, ENTRIES_MIN = 16 };
#define KNOWN (UINT64_C(1) << 63) /* in a digest: so that none is 0 */

static uint32_t entries_for(uint32_t entries_max) {
    uint32_t entries = ENTRIES_MIN;
    while (entries < entries_max && entries < UINT32_C(1) << 30)
        entries *= 2;
    return entries;
}

size_t mni_seen_need(uint32_t entries_max) {
    return mni_arena_need(entries_for(entries_max), sizeof(uint64_t), _Alignof(uint64_t));
}

/* value × factor + next, as some number below 2^61 + 8 that is the same modulo the prime; of values
 * below 2^62 and a factor and a next below 2^61. */
static uint64_t step(uint64_t value, uint64_t factor, uint64_t next) {
    wide product = (wide)value * factor + next;
    uint64_t sum = ((uint64_t)product & PRIME) + (uint64_t)(product >> 61);
    return (sum & PRIME) + (sum >> 61);
}

void mni_seen_open(mni_seen *seen, uint32_t entries_max, mni_arena *arena) {
    uint32_t entries = entries_for(entries_max);
    uint64_t drawn = 0;
    *seen =
        (mni_seen){.digest = mni_arena_take(arena, entries, sizeof(uint64_t), _Alignof(uint64_t)),
                   .shift = 32 - (uint32_t)__builtin_ctz(entries)};
    if (getrandom(&drawn, sizeof drawn, GRND_NONBLOCK) != sizeof drawn)
        return;
    seen->point = (drawn & PRIME) % PRIME;
    uint64_t square = step(seen->point, seen->point, 0);
    seen->point4 = step(square, square % PRIME, 0) % PRIME;
}

static uint64_t take(const unsigned char *from) {
    uint64_t word;
    memcpy(&word, from, sizeof word);
    return word & ((UINT64_C(1) << 8 * TAKEN) - 1);
}

uint64_t mni_seen_digest(const mni_seen *seen, mn_block_ref ref, const void *bytes) {
    const unsigned char *from = bytes;
    const size_t length_bytes = (size_t)ref.pages * MN_PAGE_BYTES;
    const uint64_t point = seen->point, point4 = seen->point4;
    uint64_t lane[LANES] = {0}, value = 0;
    size_t at = 0;
    for (; at + GROUP + 1 <= length_bytes; at += GROUP) /* words are read a byte past their part */
        for (int i = 0; i < LANES; i++)
            lane[i] = step(lane[i], point4, take(from + at + (size_t)i * TAKEN));
    for (int i = 0; i < LANES; i++)
        value = step(value, point, lane[i] % PRIME);
    for (; at < length_bytes; at += TAKEN) {
        uint64_t word = 0;
        memcpy(&word, from + at, length_bytes - at < TAKEN ? length_bytes - at : TAKEN);
        value = step(value, point, word);
    }
    value = step(value, point, ref.id);
    value = step(value, point, ref.pages);
    return value % PRIME | KNOWN;
}

static uint64_t *place(const mni_seen *seen, mn_block_ref ref) {
    return &seen->digest[(ref.id * UINT32_C(2654435769)) >> seen->shift];
}

bool mni_seen_has(const mni_seen *seen, mn_block_ref ref, uint64_t digest) {
    return seen->point != 0 && *place(seen, ref) == digest;
}

void mni_seen_add(mni_seen *seen, mn_block_ref ref, uint64_t digest) {
    MN_ASSERT((digest & KNOWN) != 0);
    *place(seen, ref) = digest;
}
