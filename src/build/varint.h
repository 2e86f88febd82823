/* Numbers in as few bytes as they need: 7 bits a byte, the lowest first, the top bit set in all but
 * the last; differences folded so that small ones of either sign are short. Any thread. */
#ifndef MNI_VARINT_H
#define MNI_VARINT_H

#include <stdint.h>
#include <string.h>

enum { MNI_VARINT32_MAX = 5 }; /* bytes of a u32, or of a folded difference of two and a bit */
enum { MNI_VARINT_WINDOW = 8 };
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the first byte is the lowest");

/* Behind what was put. */
static inline unsigned char *mni_varint_put(unsigned char *to, uint64_t value) {
    for (; value >= 0x80; value >>= 7)
        *to++ = (unsigned char)(value | 0x80);
    *to++ = (unsigned char)value;
    return to;
}

/* Of bytes that were put: they are ours. */
static inline uint64_t mni_varint_get(const unsigned char **at) {
    const unsigned char *from = *at;
    uint64_t value = *from & 0x7f;
    for (uint32_t shift = 7; *from++ & 0x80; shift += 7)
        value |= (uint64_t)(*from & 0x7f) << shift;
    *at = from;
    return value;
}

/* The same, of numbers of at most 8 bytes, of which MNI_VARINT_WINDOW may be read, whatever stands
 * behind the number. How long it is cannot be predicted, so there is no branch. */
static inline uint64_t mni_varint_take(const unsigned char **at) {
    uint64_t bytes;
    memcpy(&bytes, *at, sizeof bytes);
    const uint64_t last = ~bytes & UINT64_C(0x8080808080808080), own = last ^ (last - 1);
    *at += (__builtin_ctzll(last) + 1) / 8;
    bytes &= own & UINT64_C(0x7f7f7f7f7f7f7f7f);
    bytes = (bytes & UINT64_C(0x007f007f007f007f)) | (bytes & UINT64_C(0x7f007f007f007f00)) >> 1;
    bytes = (bytes & UINT64_C(0x00003fff00003fff)) | (bytes & UINT64_C(0x3fff00003fff0000)) >> 2;
    return (bytes & UINT64_C(0x0fffffff)) | (bytes & UINT64_C(0x0fffffff00000000)) >> 4;
}

static inline uint64_t mni_fold(uint32_t value, uint32_t from) {
    int64_t d = (int64_t)value - from;
    return d < 0 ? (uint64_t)(-d) * 2 - 1 : (uint64_t)d * 2;
}

static inline uint32_t mni_unfold(uint64_t folded, uint32_t from) {
    uint64_t half = folded / 2;
    return folded & 1 ? (uint32_t)(from - half - 1) : (uint32_t)(from + half);
}

/* Words that are like those before: behind what was put, at most MNI_VARINT32_MAX bytes each. */
static inline unsigned char *mni_words_put(unsigned char *to, const uint32_t *word,
                                           const uint32_t *before, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        to = mni_varint_put(to, mni_fold(word[i], before[i]));
    return to;
}
/* In the place of those before. */
static inline const unsigned char *mni_words_get(const unsigned char *from, uint32_t *word,
                                                 uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        word[i] = mni_unfold(mni_varint_get(&from), word[i]);
    return from;
}

#endif
