/* See rowpack.h. Hidden here: the packing. Numbers are varints, Δ: folded differences (varint.h).
 *
 *   page      a byte: positions are steps of the grid, or, where they lie too far out, floats' bits
 *   row       Δ position × 3, Δ rgba, simplex_start - last one's, order id; if that is not 0:
 *             row - leaf_lo, leaf_hi - row, row - left, right - row (0: a leaf),
 *             switch value, radius (turned: what files hold of them are the upper bits), 3 of cone
 *   simplex   Δ first corner, Δ second and third from the first
 *
 * Order: none. Memory: none. Paper: none. */
#include "rowpack.h"

#include <string.h>

#include "mn_assert.h"
#include "varint.h"

enum { TURN = 18 /* the lower bits of switch values and radii are 0 */ };

static uint32_t bits_of(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static float float_of(uint32_t bits) {
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static unsigned char *put_float(unsigned char *to, float x) {
    const uint32_t bits = bits_of(x);
    return mni_varint_put(to, bits >> TURN | (bits & ((1u << TURN) - 1)) << (32 - TURN));
}

static float get_float(const unsigned char **from) {
    const uint32_t turned = (uint32_t)mni_varint_get(from);
    return float_of(turned << TURN | turned >> (32 - TURN));
}

/* ---- rows ----------------------------------------------------------------------------------- */

static unsigned char *put_node(unsigned char *to, const mni_row *r, uint32_t at) {
    to = mni_varint_put(to, at - r->leaf_lo);
    to = mni_varint_put(to, r->leaf_hi - at);
    to = mni_varint_put(to, r->left == MN_NONE ? 0 : at - r->left);
    to = mni_varint_put(to, r->right == MN_NONE ? 0 : r->right - at);
    to = put_float(to, r->switch_value);
    to = put_float(to, r->radius);
    memcpy(to, &r->cone, sizeof r->cone);
    return to + sizeof r->cone;
}

static void get_node(const unsigned char **from, mni_row *r, uint32_t at) {
    r->leaf_lo = at - (uint32_t)mni_varint_get(from);
    r->leaf_hi = at + (uint32_t)mni_varint_get(from);
    const uint32_t left = (uint32_t)mni_varint_get(from), right = (uint32_t)mni_varint_get(from);
    r->left = left == 0 ? MN_NONE : at - left;
    r->right = right == 0 ? MN_NONE : at + right;
    r->switch_value = get_float(from);
    r->radius = get_float(from);
    memcpy(&r->cone, *from, sizeof r->cone);
    *from += sizeof r->cone;
}

static bool are_steps(const mni_row *row, uint32_t count, float grid_step) {
    bool good = grid_step > 0;
    for (uint32_t i = 0; i < count && good; i++)
        for (int c = 0; c < 3; c++) {
            const float p = row[i].position[c], steps = p / grid_step;
            good &= steps > -0x1p31f && steps < 0x1p31f && (float)(int32_t)steps == steps &&
                    bits_of(steps * grid_step) == bits_of(p);
        }
    return good;
}

/* A coordinate as a number that is near its neighbours'; step 0: its bits. */
static uint32_t word_of(float p, float step) {
    return step > 0 ? (uint32_t)(int32_t)(p / step) ^ 1u << 31 : bits_of(p);
}

static float coordinate_of(uint32_t word, float step) {
    return step > 0 ? (float)(int32_t)(word ^ 1u << 31) * step : float_of(word);
}

size_t mni_rows_pack(unsigned char *to, const mni_row *row, uint32_t first, uint32_t count,
                     float grid_step) {
    const unsigned char *begin = to;
    const float step = are_steps(row, count, grid_step) ? grid_step : 0;
    uint32_t last[3] = {0}, rgba = 0, start = 0;
    MN_ASSERT(count <= MNI_ROWS_PAGE);
    *to++ = step > 0;
    for (uint32_t i = 0; i < count; i++) {
        const mni_row *r = &row[i];
        for (int c = 0; c < 3; c++) {
            const uint32_t word = word_of(r->position[c], step);
            to = mni_varint_put(to, mni_fold(word, last[c]));
            last[c] = word;
        }
        to = mni_varint_put(to, mni_fold(r->rgba, rgba));
        to = mni_varint_put(to, r->simplex_start - start);
        to = mni_varint_put(to, r->order);
        if (r->order != 0)
            to = put_node(to, r, first + i);
        rgba = r->rgba;
        start = r->simplex_start;
    }
    return (size_t)(to - begin);
}

void mni_rows_unpack(const unsigned char *from, mni_row *row, uint32_t first, uint32_t count,
                     float grid_step) {
    const float step = *from++ ? grid_step : 0;
    uint32_t last[3] = {0}, rgba = 0, start = 0;
    for (uint32_t i = 0; i < count; i++) {
        mni_row *r = &row[i];
        *r = (mni_row){.left = MN_NONE, .right = MN_NONE};
        for (int c = 0; c < 3; c++) {
            last[c] = mni_unfold(mni_varint_get(&from), last[c]);
            r->position[c] = coordinate_of(last[c], step);
        }
        r->rgba = rgba = mni_unfold(mni_varint_get(&from), rgba);
        r->simplex_start = start += (uint32_t)mni_varint_get(&from);
        r->order = (uint32_t)mni_varint_get(&from);
        if (r->order != 0)
            get_node(&from, r, first + i);
    }
}

/* ---- simplices ------------------------------------------------------------------------------ */

size_t mni_simplices_pack(unsigned char *to, const mni_row_simplex *simplex, uint32_t count) {
    const unsigned char *begin = to;
    uint32_t last = 0;
    MN_ASSERT(count <= MNI_SIMPLICES_PAGE);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *c = simplex[i].corner;
        to = mni_varint_put(to, mni_fold(c[0], last));
        to = mni_varint_put(to, mni_fold(c[1], c[0]));
        to = mni_varint_put(to, mni_fold(c[2], c[0]));
        last = c[0];
    }
    return (size_t)(to - begin);
}

void mni_simplices_unpack(const unsigned char *from, mni_row_simplex *simplex, uint32_t count) {
    uint32_t last = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t *c = simplex[i].corner;
        c[0] = last = mni_unfold(mni_varint_get(&from), last);
        c[1] = mni_unfold(mni_varint_get(&from), c[0]);
        c[2] = mni_unfold(mni_varint_get(&from), c[0]);
    }
}
