/* The rows of a block, and how values become the numbers that stand in them. Shared by the decoder
 * (block.c), the checker (block_check.c) and the encoder (block_encode.c); nobody else.
 *
 *   head   0  nodes, subtrees, exits, more   4 × u32    more: simplices past two of a node
 *         16  flags                          u32        bit 0: colours; bits 8 … 15, 16 … 23: below
 *         20  step of the grid               f32
 *         24  bases                          14 × u32
 *         80  far                            u32        third corners that are far away
 *         84  edges                          33 × u16, then two bytes 0
 *        152  node rows | exit rows | subtree rows | more rows | far rows; each kind from a byte on
 *
 * Row i of a kind stands in bits [i × row, (i + 1) × row), least significant first; field f in bits
 * [edge f, edge f + 1) of its row. What belongs to a node lies in one or two lines of the cache:
 *
 *   node row     facts | left … more | simplex | simplex
 *   exit row     facts | ref | subtree
 *   subtree row  node | lo | size
 *   more row     simplex
 *   far row      third corner
 *
 * Most third corners are near their node, but a field as wide as the farthest's would be twice as
 * wide. So a field has room for codes of `near` bits (flags, bits 8 … 15), and greater values of it
 * are numbers of far rows, whose width is in flags, bits 16 … 23.
 */
#ifndef MNI_BLOCK_LAYOUT_H
#define MNI_BLOCK_LAYOUT_H

#include <string.h>

#include "block.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files are little-endian, and so are we");

enum {
    MNI_HEAD_STEP = 20,
    MNI_HEAD_BASE = 24,
    MNI_HEAD_EDGE = 84,
    MNI_HEAD_BYTES = 152,
    MNI_HEAD_FAR = 80,
    MNI_FLAG_COLORS = 1,
    MNI_OVERFLOW_EDGE = 20,
    MNI_OVERFLOW_HEAD_BYTES = 32,
    MNI_INLINE = 2, /* simplices in a node's own row: what nearly every collapse kills */
};

/* Each kind of row ends with an edge more than it has fields. */
enum mni_field_id {
    /* facts: of a node row, and of an exit row */
    FIELD_ORDER = 0,
    FIELD_SWITCH, /* bits of the float, but for the last ones, which are 0 */
    FIELD_RADIUS,
    FIELD_AXIS, /* 2: + 128 */
    FIELD_ANGLE = 5,
    /* the rest of a node row */
    FIELD_LEFT,       /* leaves of the left child, less one */
    FIELD_DELTA,      /* 3: from its position to the right child's, in steps, + 2^31 */
    FIELD_COLOR = 10, /* 4: of the right child: R, G, B, A */
    FIELD_EXITS = 14, /* bit 0: the left child is an exit; bit 1: the right one */
    FIELD_RIGHT,      /* INNER right child: its index - this one's; otherwise 0 */
    FIELD_EXIT,       /* exits of the nodes before this one */
    FIELD_OVERFLOW,   /* 1 + reference of the first overflow block; 0: none */
    FIELD_LACK,       /* places for simplices in this row that are empty */
    FIELD_MORE,       /* `more` simplices of the nodes before this one */
    FIELD_NODE_END,
    /* a simplex */
    FIELD_TURN,  /* 0: its corner in the left child comes first; 1: that in the right child */
    FIELD_A,     /* corner in the left child - leaf_lo */
    FIELD_B,     /* corner in the right child - leaf_mid */
    FIELD_THIRD, /* third corner: 2 (leaf_lo - corner), or 2 (corner - leaf_hi + 1) + 1; hinge: 0;
                    or 2^near + the number of a far row that says so */
    FIELD_SIMPLEX_END,
    /* the rest of an exit row: its first edge is that of FIELD_LEFT */
    FIELD_REF,
    FIELD_SUBTREE,
    FIELD_EXIT_END,
    /* a subtree row */
    FIELD_NODE,
    FIELD_LO,
    FIELD_SIZE, /* leaves, less two */
    FIELD_SUBTREE_END,
    FIELDS
};

/* Fields whose values count from the least of the block. */
enum mni_base_id {
    BASE_ORDER = 0,
    BASE_SWITCH,
    BASE_RADIUS,
    BASE_AXIS,
    BASE_ANGLE = 5,
    BASE_DELTA,
    BASE_COLOR = 9,
    BASE_LO = 13,
    BASES
};
_Static_assert(MNI_HEAD_BASE + 4 * BASES == MNI_HEAD_FAR, "bases, far, then edges");
_Static_assert(MNI_HEAD_EDGE + 2 * FIELDS <= MNI_HEAD_BYTES, "edges, then rows");

#define MNI_BIAS 0x80000000u

/* Floats of the facts have so many bits after the leading one; an exponent has 8. */
enum { MNI_SWITCH_MANTISSA = 5, MNI_RADIUS_MANTISSA = 4 };
enum { MNI_SWITCH_SHIFT = 23 - MNI_SWITCH_MANTISSA, MNI_RADIUS_SHIFT = 23 - MNI_RADIUS_MANTISSA };

/* Bits that hold every value up to max. */
static inline uint32_t mni_bits(uint32_t max) {
    return max == 0 ? 0 : 32 - (uint32_t)__builtin_clz(max);
}

static inline uint64_t mni_row_bytes(uint64_t rows, uint32_t bits) {
    return (rows * bits + 7) / 8;
}

/* Reads 8 bytes from the value's first byte on: MNI_BLOCK_TAIL_BYTES keep that inside the block.
 * So a value, or neighbours read at once, may have 57 bits. */
static inline uint64_t mni_bits_at(const uint8_t *rows, uint64_t at) {
    uint64_t word;
    memcpy(&word, rows + (at >> 3), sizeof word);
    return word >> (at & 7);
}

static inline uint32_t mni_bits_get(const uint8_t *rows, uint64_t at, uint32_t width) {
    return (uint32_t)(mni_bits_at(rows, at) & ((UINT64_C(1) << width) - 1));
}

/* rows: zeroed there. value must fit the width it is given. */
static inline void mni_bits_put(uint8_t *rows, uint64_t at, uint32_t value) {
    uint64_t word;
    memcpy(&word, rows + (at >> 3), sizeof word);
    word |= (uint64_t)value << (at & 7);
    memcpy(rows + (at >> 3), &word, sizeof word);
}

static inline uint32_t mni_edge(const uint8_t *edge, uint32_t field) {
    uint16_t value;
    memcpy(&value, edge + 2 * (size_t)field, sizeof value);
    return value;
}

static inline uint32_t mni_base(const uint8_t *base, uint32_t id) {
    uint32_t value;
    memcpy(&value, base + 4 * (size_t)id, sizeof value);
    return value;
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

/* A corner outside [lo, hi), or MN_NONE; and back. */
static inline uint32_t mni_third_code(uint32_t corner, uint32_t lo, uint32_t hi) {
    if (corner == MN_NONE)
        return 0;
    return corner < lo ? 2 * (lo - corner) : 2 * (corner - hi + 1) + 1;
}

static inline uint32_t mni_third_of(uint32_t code, uint32_t lo, uint32_t hi) {
    uint32_t distance = code >> 1, above = 0 - (code & 1); /* whose turn it is nobody can guess */
    uint32_t from = lo ^ ((lo ^ (hi - 1)) & above);
    uint32_t corner = from + ((distance ^ ~above) - ~above);
    return distance == 0 ? MN_NONE : corner;
}

/* A simplex: its corners in the children, from leaf_lo and from leaf_mid on, and FIELD_THIRD. */
typedef struct mni_simplex_row {
    uint32_t a, b, third;
} mni_simplex_row;

/* What stands in a node's row, bases added; for the checker, who must not follow it anywhere before
 * it is known to lead into the block. */
typedef struct mni_row {
    mni_facts facts;
    uint32_t left;                 /* FIELD_LEFT … */
    float delta[3];                /* to the right child */
    uint32_t exits, right, exit;   /* 0 in a block without exits */
    uint32_t overflow, lack, more; /* 0 where has_rest is not set */
    mni_simplex_row simplex[MNI_INLINE];
} mni_row;
void mni_block_row(const mni_block *view, uint32_t node, mni_row *out);
/* FIELD_MORE of the node after it, which there is. */
uint32_t mni_block_more_after(const mni_block *view, uint32_t node);
/* Simplex row `more` of those that are not in their node's. */
void mni_block_more_row(const mni_block *view, uint32_t more, mni_simplex_row *out);
/* The code of a third corner that stands in far row `far`; past the last row, nothing of meaning.
 */
static inline uint32_t mni_block_far(const mni_block *view, uint32_t far) {
    return mni_bits_get(view->far_rows, (uint64_t)far * view->far_bits, view->far_bits);
}

/* Decodes the head; no checks. Returns where the rows end, counted from the payload's beginning. */
uint64_t mni_block_layout(mni_block *view, const uint8_t *payload);

#endif
