/* Blocks that have been looked at. See seen.h.
 *
 * Hides: how a digest is made. The first step does the work, a multiplication of 32 bits for each 8
 * bytes and key; the second has three coefficients a piece. No order of calls after open; paper:
 * none. */
#include "seen.h"

#include <string.h>
#include <sys/random.h>
#if defined(__SSE2__)
#include <emmintrin.h>
#endif

#include "mn_assert.h"

__extension__ typedef unsigned __int128 wide;

#define PRIME ((UINT64_C(1) << 61) - 1)
enum { ENTRIES_MIN = 16, WAYS = 8, PIECE_BYTES = 8 * MNI_SEEN_PIECE };
_Static_assert(MN_PAGE_BYTES % PIECE_BYTES == 0, "blocks are whole pieces");
#define LINE_BYTES (WAYS * sizeof(uint64_t))
#define KNOWN (UINT64_C(1) << 63) /* in a digest: so that none is 0 */

static uint32_t entries_for(uint32_t entries_max) {
    uint32_t entries = ENTRIES_MIN;
    while (entries < entries_max && entries < UINT32_C(1) << 30)
        entries *= 2;
    return entries;
}

size_t mni_seen_need(uint32_t entries_max) {
    return mni_arena_need(entries_for(entries_max), sizeof(uint64_t), LINE_BYTES);
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
    uint64_t drawn[MNI_SEEN_PIECE + 2];
    *seen = (mni_seen){.digest = mni_arena_take(arena, entries, sizeof(uint64_t), LINE_BYTES),
                       .shift = 32 - (uint32_t)__builtin_ctz(entries / WAYS)};
    if (getrandom(drawn, sizeof drawn, GRND_NONBLOCK) != sizeof drawn)
        return;
    seen->point = (drawn[0] & PRIME) % PRIME;
    memcpy(seen->key, drawn + 1, sizeof seen->key);
}

#if defined(__SSE2__)
static __m128i products(__m128i words, const uint64_t *key) {
    const __m128i sums = _mm_add_epi32(words, _mm_loadu_si128((const void *)key));
    return _mm_mul_epu32(sums, _mm_srli_epi64(sums, 32));
}

/* A piece's 128 bits. */
static void shorten(const mni_seen *seen, const unsigned char *piece, uint64_t sum[2]) {
    __m128i first = _mm_setzero_si128(), second = first;
    for (size_t i = 0; i < MNI_SEEN_PIECE; i += 2) {
        const __m128i words = _mm_loadu_si128((const void *)(piece + 8 * i));
        first = _mm_add_epi64(first, products(words, seen->key + i));
        second = _mm_add_epi64(second, products(words, seen->key + i + 1));
    }
    uint64_t lanes[4];
    _mm_storeu_si128((void *)lanes, first);
    _mm_storeu_si128((void *)(lanes + 2), second);
    sum[0] = lanes[0] + lanes[1];
    sum[1] = lanes[2] + lanes[3];
}
#else
static uint64_t product(uint64_t word, uint64_t key) {
    return (uint64_t)((uint32_t)word + (uint32_t)key) *
           ((uint32_t)(word >> 32) + (uint32_t)(key >> 32));
}

static void shorten(const mni_seen *seen, const unsigned char *piece, uint64_t sum[2]) {
    sum[0] = sum[1] = 0;
    for (size_t i = 0; i < MNI_SEEN_PIECE; i++) {
        uint64_t word;
        memcpy(&word, piece + 8 * i, sizeof word);
        sum[0] += product(word, seen->key[i]);
        sum[1] += product(word, seen->key[i + 1]);
    }
}
#endif

uint64_t mni_seen_digest(const mni_seen *seen, mn_block_ref ref, const void *bytes) {
    const size_t length_bytes = (size_t)ref.pages * MN_PAGE_BYTES;
    const uint64_t point = seen->point, low = (UINT64_C(1) << 56) - 1;
    uint64_t value = 0, sum[2];
    for (size_t at = 0; at < length_bytes; at += PIECE_BYTES) {
        shorten(seen, (const unsigned char *)bytes + at, sum);
        value = step(value, point, sum[0] & low);
        value = step(value, point, sum[1] & low);
        value = step(value, point, sum[0] >> 56 << 8 | sum[1] >> 56);
    }
    value = step(value, point, ref.id);
    value = step(value, point, ref.pages);
    return value % PRIME | KNOWN;
}

static uint64_t *ways(const mni_seen *seen, mn_block_ref ref) {
    return &seen->digest[WAYS * (size_t)((ref.id * UINT32_C(2654435769)) >> seen->shift)];
}

bool mni_seen_has(const mni_seen *seen, mn_block_ref ref, uint64_t digest) {
    const uint64_t *way = ways(seen, ref);
    bool has = false;
    for (uint32_t i = 0; i < WAYS; i++)
        has |= way[i] == digest;
    return has && seen->point != 0;
}

/* The first of its line, which moves the others on: the last is forgotten. */
void mni_seen_add(mni_seen *seen, mn_block_ref ref, uint64_t digest) {
    uint64_t *way = ways(seen, ref);
    MN_ASSERT((digest & KNOWN) != 0);
    memmove(way + 1, way, (WAYS - 1) * sizeof *way);
    way[0] = digest;
}
