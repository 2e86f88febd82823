/* The columns of a block, and how values become the 32-bit words that stand in them. Shared by the
 * decoder (block.c), the checker (block_check.c) and the encoder (block_encode.c); nobody else.
 *
 *   head   0  nodes, subtrees, exits, simplices   4 × u32
 *         16  flags                               u32   bit 0: colours
 *         20  zero                                u32
 *         24  base of each column                 34 × u32
 *        160  width of each column                34 × u8, bits
 *        196  columns, one after the other, each from a whole byte on; value i in bits
 *             [i × width, (i + 1) × width), least significant first, base added modulo 2^32
 */
#ifndef MNI_BLOCK_LAYOUT_H
#define MNI_BLOCK_LAYOUT_H

#include <string.h>

#include "block.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files are little-endian, and so are we");

enum { MNI_HEAD_BYTES = 196, MNI_HEAD_BASE = 24, MNI_HEAD_WIDTH = 160, MNI_FLAG_COLORS = 1 };
enum { MNI_OVERFLOW_HEAD_BYTES = 40 };

enum mni_column_id {
    /* facts: a row a node, then a row an exit */
    COL_ORDER = 0,
    COL_SWITCH, /* floats that are not negative: their bits */
    COL_RADIUS,
    COL_CONE,          /* 3: axis + 32768, twice; angle */
    COL_MID = 6,       /* a row a node */
    COL_POSITION = 7,  /* 3: floats in an order-preserving code */
    COL_COLOR = 10,    /* 4: R, G, B, A */
    COL_KINDS = 14,    /* left kind × 3 + right kind */
    COL_RIGHT,         /* INNER right child: its index - this one's; otherwise 0 */
    COL_EXIT,          /* exits of the nodes before this one */
    COL_OVERFLOW,      /* 1 + reference of the first overflow block; 0: none */
    COL_SIMPLEX_FIRST, /* a row a node, and one more */
    COL_EXIT_REF,      /* a row an exit */
    COL_EXIT_SUBTREE,
    COL_SUB_NODE, /* a row a subtree */
    COL_SUB_LO,
    COL_SUB_HI,
    COL_SUB_POSITION,   /* 3 */
    COL_SUB_COLOR = 27, /* 4 */
    COL_CORNER = 31,    /* a row a simplex: first corner; second - first and third - first, each
                           + 2^31; a hinge's third equals its first */
    COL_END = 34
};
_Static_assert((int)COL_END == (int)MNI_BLOCK_COLUMNS, "the decoder's table holds every column");

#define MNI_BIAS 0x80000000u

static inline uint32_t mni_column_rows(const mni_block *v, uint32_t column) {
    if (column < COL_MID)
        return v->nodes + v->exits;
    if (column < COL_SIMPLEX_FIRST)
        return v->nodes;
    if (column == COL_SIMPLEX_FIRST)
        return v->nodes + 1;
    if (column < COL_SUB_NODE)
        return v->exits;
    return column < COL_CORNER ? v->subtrees : v->simplices;
}

static inline uint64_t mni_column_bytes(uint64_t rows, uint32_t width) {
    return (rows * width + 7) / 8;
}

/* Bits that hold every value up to max. */
static inline uint32_t mni_bits(uint32_t max) {
    return max == 0 ? 0 : 32 - (uint32_t)__builtin_clz(max);
}

/* Reads 8 bytes from the value's first byte on: MNI_BLOCK_TAIL_BYTES keep that inside the block. */
static inline uint32_t mni_column_get(const mni_column *c, uint32_t row) {
    uint64_t at = (uint64_t)row * c->width, word;
    memcpy(&word, c->bits + (at >> 3), sizeof word);
    return c->base + (uint32_t)((word >> (at & 7)) & ((1ull << c->width) - 1));
}

/* bits: zeroed. value - base must fit the width. */
static inline void mni_column_put(uint8_t *bits, uint32_t width, uint32_t row, uint32_t value) {
    uint64_t at = (uint64_t)row * width, word;
    memcpy(&word, bits + (at >> 3), sizeof word);
    word |= (uint64_t)value << (at & 7);
    memcpy(bits + (at >> 3), &word, sizeof word);
}

static inline uint32_t mni_float_bits(float f) {
    uint32_t u;
    memcpy(&u, &f, sizeof u);
    return u;
}

static inline float mni_float_of(uint32_t u) {
    float f;
    memcpy(&f, &u, sizeof f);
    return f;
}

/* Order-preserving code of any float: neighbours in space get neighbouring words. */
static inline uint32_t mni_float_ordered(float f) {
    uint32_t u = mni_float_bits(f);
    return u & MNI_BIAS ? ~u : u | MNI_BIAS;
}

static inline float mni_float_unordered(uint32_t u) {
    return mni_float_of(u & MNI_BIAS ? u & ~MNI_BIAS : ~u);
}

/* Decodes the head and sets the columns' places; no checks. Returns where the columns end,
 * counted from the payload's beginning. */
uint64_t mni_block_layout(mni_block *view, const uint8_t *payload);

#endif
