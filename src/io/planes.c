/* Rows of bits as planes of bits. See planes.h.
 *
 * Secret: 8 × 8 bits are turned over in a word, by three exchanges of halves (Warren, Hacker's
 * Delight, 7-3); a group's rows are taken from, and put to, their places 64 bits at a time. */
#include "planes.h"

#include <string.h>

#include "mn_assert.h"

enum { GROUP = 8, WORDS_MAX = MNI_PLANES_BITS_MAX / 64 };

/* Byte i of the one has, as bit j, bit i of byte j of the other. */
static uint64_t turn_over(uint64_t x) {
    uint64_t swap = (x ^ (x >> 7)) & UINT64_C(0x00aa00aa00aa00aa);
    x ^= swap ^ (swap << 7);
    swap = (x ^ (x >> 14)) & UINT64_C(0x0000cccc0000cccc);
    x ^= swap ^ (swap << 14);
    swap = (x ^ (x >> 28)) & UINT64_C(0x00000000f0f0f0f0);
    return x ^ swap ^ (swap << 28);
}

/* Up to 64 bits from bit `at` on. end: of the bytes that may be read. */
static uint64_t bits_at(const uint8_t *bytes, const uint8_t *end, uint64_t at) {
    const uint8_t *from = bytes + at / 8;
    uint64_t word = 0;
    if (end - from >= 8)
        memcpy(&word, from, sizeof word);
    else
        memcpy(&word, from, (size_t)(end - from));
    word >>= at % 8;
    if (at % 8 != 0 && end - from > 8)
        word |= (uint64_t)from[8] << (64 - at % 8);
    return word;
}

void mni_planes_of_rows(const uint8_t *rows, uint32_t groups, uint32_t bits, uint8_t *planes) {
    MN_ASSERT(bits > 0 && bits <= MNI_PLANES_BITS_MAX);
    for (uint32_t g = 0; g < groups; g++) {
        const uint8_t *group = rows + (size_t)g * bits, *end = group + bits;
        for (uint32_t from = 0; from < bits; from += 64) {
            uint64_t word[GROUP];
            for (uint32_t r = 0; r < GROUP; r++)
                word[r] = bits_at(group, end, (uint64_t)r * bits + from);
            for (uint32_t j = from; j < bits && j < from + 64; j += 8) {
                uint64_t square = 0;
                for (uint32_t r = 0; r < GROUP; r++)
                    square |= (word[r] >> (j - from) & 0xff) << 8 * r;
                square = turn_over(square);
                for (uint32_t k = j; k < bits && k < j + 8; k++, square >>= 8)
                    planes[(size_t)k * groups + g] = (uint8_t)square;
            }
        }
    }
}

/* Writes bits one after the other, 64 at a time. */
typedef struct filler {
    uint8_t *to;
    uint64_t word;
    uint32_t fill; /* bits of word, below 64 */
} filler;

static void put(filler *f, uint64_t value, uint32_t count) {
    f->word |= value << f->fill;
    if (f->fill + count >= 64) {
        memcpy(f->to, &f->word, sizeof f->word);
        f->to += sizeof f->word;
        f->word = f->fill > 0 ? value >> (64 - f->fill) : 0;
        f->fill += count - 64;
    } else {
        f->fill += count;
    }
}

void mni_planes_to_rows(const uint8_t *planes, uint32_t groups, uint32_t bits, uint8_t *rows) {
    MN_ASSERT(bits > 0 && bits <= MNI_PLANES_BITS_MAX);
    for (uint32_t g = 0; g < groups; g++) {
        uint64_t word[WORDS_MAX][GROUP];
        for (uint32_t j = 0; j < bits; j += 8) {
            const uint8_t *from = planes + (size_t)j * groups + g;
            uint64_t square = 0;
            for (uint32_t k = 0; k < 8 && j + k < bits; k++)
                square |= (uint64_t)from[(size_t)k * groups] << 8 * k;
            square = turn_over(square);
            for (uint32_t r = 0; r < GROUP; r++)
                word[j / 64][r] = (j % 64 > 0 ? word[j / 64][r] : 0) | (square >> 8 * r & 0xff)
                                                                           << j % 64;
        }
        filler f = {.to = rows + (size_t)g * bits};
        for (uint32_t r = 0; r < GROUP; r++)
            for (uint32_t from = 0; from < bits; from += 64)
                put(&f, word[from / 64][r], bits - from < 64 ? bits - from : 64);
        memcpy(f.to, &f.word, f.fill / 8); /* a group ends with a byte */
    }
}
