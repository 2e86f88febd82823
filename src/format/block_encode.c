/* The encoder: what a block would take, and its bytes.
 *
 * Hides: which columns have their width from a range of values and which from a count, so that a
 * tally is exact before the order of nodes is known. Order: tally everything, begin with that
 * tally, write the same things, end. One thread a tally or encoder; both are the caller's, of fixed
 * size; the bytes are the caller's. Paper: §3.2. */
#include "block_layout.h"

#include "assert.h"
#include "frame.h"

static bool is_range_column(uint32_t c) {
    return c < COL_KINDS || (c >= COL_SUB_LO && c < COL_END);
}

void mni_tally_init(mni_tally *tally, bool has_colors) {
    memset(tally, 0, sizeof *tally);
    tally->has_colors = has_colors;
    for (uint32_t c = 0; c < COL_END; c++)
        if (is_range_column(c))
            tally->min[c] = UINT32_MAX;
}

/* ---- values to words ------------------------------------------------------------------------ */

static void position_words(const float position[3], uint32_t word[3]) {
    for (int i = 0; i < 3; i++)
        word[i] = mni_float_ordered(position[i]);
}

static void cone_words(mn_cone cone, uint32_t word[3]) {
    word[0] = (uint32_t)(cone.axis[0] + 32768);
    word[1] = (uint32_t)(cone.axis[1] + 32768);
    word[2] = cone.angle;
}

static void color_words(bool has_colors, uint32_t color, uint32_t word[4]) {
    for (int i = 0; i < 4; i++)
        word[i] = has_colors ? color >> (8 * i) & 255 : 0;
}

enum { KINDS_MAX = 3 * MNI_CHILD_SUBTREE + MNI_CHILD_SUBTREE };
enum {
    FACT_WORDS = COL_MID,
    NODE_WORDS = COL_KINDS + 1 - COL_MID,
    SUBTREE_WORDS = COL_CORNER - COL_SUB_LO
};

static void fact_words(const mni_facts *facts, uint32_t word[FACT_WORDS]) {
    word[COL_ORDER] = facts->order;
    word[COL_SWITCH] = mni_float_bits(facts->switch_value);
    word[COL_RADIUS] = mni_float_bits(facts->radius);
    cone_words(facts->cone, word + COL_CONE);
}

static void node_words(const mni_node *node, bool has_colors, uint32_t word[NODE_WORDS]) {
    word[0] = node->leaf_mid;
    position_words(node->right_position, word + (COL_POSITION - COL_MID));
    color_words(has_colors, node->right_color, word + (COL_COLOR - COL_MID));
    word[COL_KINDS - COL_MID] = (uint32_t)node->left.kind * 3 + (uint32_t)node->right.kind;
}

static void subtree_words(const mni_subtree *s, bool has_colors, uint32_t word[SUBTREE_WORDS]) {
    word[0] = s->leaf_lo;
    word[COL_SUB_HI - COL_SUB_LO] = s->leaf_hi;
    position_words(s->position, word + (COL_SUB_POSITION - COL_SUB_LO));
    color_words(has_colors, s->color, word + (COL_SUB_COLOR - COL_SUB_LO));
}

static void corner_words(const uint32_t corner[3], uint32_t word[3]) {
    uint32_t third = corner[2] == MN_NONE ? corner[0] : corner[2];
    word[0] = corner[0];
    word[1] = corner[1] - corner[0] + MNI_BIAS;
    word[2] = third - corner[0] + MNI_BIAS;
}

/* ---- the tally ------------------------------------------------------------------------------ */

static void widen(mni_tally *tally, uint32_t column, const uint32_t *word, uint32_t words) {
    uint32_t *min = tally->min + column, *max = tally->max + column;
    for (uint32_t i = 0; i < words; i++) {
        min[i] = word[i] < min[i] ? word[i] : min[i];
        max[i] = word[i] > max[i] ? word[i] : max[i];
    }
}

static void tally_facts(mni_tally *tally, const mni_facts *facts) {
    uint32_t word[FACT_WORDS];
    fact_words(facts, word);
    widen(tally, 0, word, FACT_WORDS);
}

static void tally_exit(mni_tally *tally, const mni_child *child) {
    if (child->kind == MNI_CHILD_SUBTREE) {
        tally->exits++;
        tally_facts(tally, &child->facts);
    }
}

void mni_tally_node(mni_tally *tally, const mni_node *node) {
    uint32_t word[NODE_WORDS];
    node_words(node, tally->has_colors, word);
    widen(tally, COL_MID, word, NODE_WORDS);
    tally_facts(tally, &node->facts);
    tally->nodes++;
    tally_exit(tally, &node->left);
    tally_exit(tally, &node->right);
    tally->has_overflow |= node->overflow_ref != MN_NONE;
}

void mni_tally_subtree(mni_tally *tally, const mni_subtree *subtree) {
    uint32_t word[SUBTREE_WORDS];
    subtree_words(subtree, tally->has_colors, word);
    widen(tally, COL_SUB_LO, word, SUBTREE_WORDS);
    tally->subtrees++;
}

void mni_tally_simplex(mni_tally *tally, const uint32_t corner[3]) {
    uint32_t word[3];
    corner_words(corner, word);
    widen(tally, COL_CORNER, word, 3);
    tally->simplices++;
}

void mni_tally_merge(mni_tally *tally, const mni_tally *other) {
    tally->nodes += other->nodes;
    tally->subtrees += other->subtrees;
    tally->exits += other->exits;
    tally->simplices += other->simplices;
    tally->has_overflow |= other->has_overflow;
    for (uint32_t c = 0; c < COL_END; c++) {
        tally->min[c] = other->min[c] < tally->min[c] ? other->min[c] : tally->min[c];
        tally->max[c] = other->max[c] > tally->max[c] ? other->max[c] : tally->max[c];
    }
}

static uint32_t column_width(const mni_tally *tally, uint32_t refs, uint32_t column) {
    switch (column) {
    case COL_KINDS: /* of a fixed width, as kinds change while a block is filled */
        return tally->nodes > 0 ? mni_bits(KINDS_MAX) : 0;
    case COL_RIGHT:
    case COL_SUB_NODE:
        return mni_bits(tally->nodes);
    case COL_EXIT:
    case COL_EXIT_SUBTREE: /* a child block's subtrees all hang from this one */
        return mni_bits(tally->exits);
    case COL_OVERFLOW:
        return tally->has_overflow ? mni_bits(refs) : 0;
    case COL_SIMPLEX_FIRST:
        return mni_bits(tally->simplices);
    case COL_EXIT_REF:
        return mni_bits(refs);
    default:
        return tally->min[column] < tally->max[column]
                   ? mni_bits(tally->max[column] - tally->min[column])
                   : 0;
    }
}

uint64_t mni_tally_bytes(const mni_tally *tally, uint32_t refs) {
    mni_block counts; /* the counts alone, for mni_column_rows */
    counts.nodes = tally->nodes;
    counts.subtrees = tally->subtrees;
    counts.simplices = tally->simplices;
    counts.exits = tally->exits;
    uint64_t bytes = mni_frame_payload_at(refs) + MNI_HEAD_BYTES;
    for (uint32_t c = 0; c < COL_END; c++)
        bytes += mni_column_bytes(mni_column_rows(&counts, c), column_width(tally, refs, c));
    return bytes;
}

/* ---- the bytes ------------------------------------------------------------------------------ */

void mni_encoder_begin(mni_encoder *encoder, void *bytes, uint32_t length_bytes,
                       const mni_tally *tally, uint32_t refs) {
    MN_ASSERT(mni_tally_bytes(tally, refs) + MNI_BLOCK_TAIL_BYTES <= length_bytes);
    memset(bytes, 0, length_bytes);
    memset(encoder, 0, sizeof *encoder);
    encoder->tally = *tally;
    uint8_t *payload = (uint8_t *)bytes + mni_frame_payload_at(refs);
    uint32_t head[5] = {tally->nodes, tally->subtrees, tally->exits, tally->simplices,
                        tally->has_colors ? MNI_FLAG_COLORS : 0};
    memcpy(payload, head, sizeof head);
    for (uint32_t c = 0; c < COL_END; c++) {
        uint32_t width = column_width(tally, refs, c);
        uint32_t base = is_range_column(c) && tally->min[c] <= tally->max[c] ? tally->min[c] : 0;
        payload[MNI_HEAD_WIDTH + c] = (uint8_t)width;
        memcpy(payload + MNI_HEAD_BASE + 4 * c, &base, sizeof base);
    }
    mni_block_layout(&encoder->view, payload);
}

static void put(mni_encoder *encoder, uint32_t column, uint32_t row, const uint32_t *word,
                uint32_t words) {
    for (uint32_t i = 0; i < words; i++) {
        const mni_column *c = &encoder->view.column[column + i];
        uint32_t value = word[i] - c->base;
        MN_ASSERT(mni_bits(value) <= c->width);
        mni_column_put((uint8_t *)(uintptr_t)c->bits, c->width, row, value);
    }
}

static void put_facts(mni_encoder *encoder, uint32_t row, const mni_facts *facts) {
    uint32_t word[FACT_WORDS];
    fact_words(facts, word);
    put(encoder, 0, row, word, FACT_WORDS);
}

static void put_exit(mni_encoder *encoder, const mni_child *child) {
    if (child->kind != MNI_CHILD_SUBTREE)
        return;
    put_facts(encoder, encoder->tally.nodes + encoder->exits, &child->facts);
    put(encoder, COL_EXIT_REF, encoder->exits, &child->ref, 1);
    put(encoder, COL_EXIT_SUBTREE, encoder->exits, &child->subtree, 1);
    encoder->exits++;
}

void mni_encoder_node(mni_encoder *encoder, const mni_node *node) {
    uint32_t row = encoder->nodes++, word[NODE_WORDS];
    MN_ASSERT(row < encoder->tally.nodes);
    MN_ASSERT(node->left.kind != MNI_CHILD_INNER || node->left.node == row + 1);
    node_words(node, encoder->tally.has_colors, word);
    put_facts(encoder, row, &node->facts);
    put(encoder, COL_MID, row, word, NODE_WORDS);
    uint32_t right = node->right.kind == MNI_CHILD_INNER ? node->right.node - row : 0;
    uint32_t overflow = node->overflow_ref + 1; /* MN_NONE + 1 is 0 */
    put(encoder, COL_RIGHT, row, &right, 1);
    put(encoder, COL_EXIT, row, &encoder->exits, 1);
    put(encoder, COL_OVERFLOW, row, &overflow, 1);
    put_exit(encoder, &node->left);
    put_exit(encoder, &node->right);
    encoder->killed += node->simplex_count;
    put(encoder, COL_SIMPLEX_FIRST, row + 1, &encoder->killed, 1); /* row 0 holds 0 */
}

void mni_encoder_subtree(mni_encoder *encoder, const mni_subtree *subtree) {
    uint32_t row = encoder->subtrees++, word[SUBTREE_WORDS];
    MN_ASSERT(row < encoder->tally.subtrees);
    subtree_words(subtree, encoder->tally.has_colors, word);
    put(encoder, COL_SUB_NODE, row, &subtree->node, 1);
    put(encoder, COL_SUB_LO, row, word, SUBTREE_WORDS);
}

void mni_encoder_simplex(mni_encoder *encoder, const uint32_t corner[3]) {
    uint32_t row = encoder->simplices++, word[3];
    MN_ASSERT(row < encoder->tally.simplices);
    corner_words(corner, word);
    put(encoder, COL_CORNER, row, word, 3);
}

void mni_encoder_end(mni_encoder *encoder) {
    MN_ASSERT(encoder->nodes == encoder->tally.nodes);
    MN_ASSERT(encoder->subtrees == encoder->tally.subtrees);
    MN_ASSERT(encoder->exits == encoder->tally.exits);
    MN_ASSERT(encoder->simplices == encoder->tally.simplices);
    MN_ASSERT(encoder->killed == encoder->simplices);
}

/* ---- overflow blocks ------------------------------------------------------------------------ */

static uint64_t overflow_bytes(const mni_tally *t, uint32_t refs) {
    uint64_t bytes = mni_frame_payload_at(refs) + MNI_OVERFLOW_HEAD_BYTES;
    for (uint32_t c = COL_CORNER; c < COL_END; c++)
        bytes += mni_column_bytes(t->simplices, column_width(t, refs, c));
    return bytes;
}

uint32_t mni_overflow_fit(const uint32_t *corner, uint32_t count, uint32_t length_bytes) {
    mni_tally tally;
    mni_tally_init(&tally, false);
    for (uint32_t i = 0; i < count; i++) {
        mni_tally_simplex(&tally, corner + 3 * (size_t)i);
        if (overflow_bytes(&tally, 1) + MNI_BLOCK_TAIL_BYTES > length_bytes)
            return i;
    }
    return count;
}

static void overflow_tally(const uint32_t *corner, uint32_t count, mni_tally *tally) {
    mni_tally_init(tally, false);
    for (uint32_t i = 0; i < count; i++)
        mni_tally_simplex(tally, corner + 3 * (size_t)i);
}

uint32_t mni_overflow_bytes(const uint32_t *corner, uint32_t count, uint32_t refs) {
    mni_tally tally;
    overflow_tally(corner, count, &tally);
    return (uint32_t)overflow_bytes(&tally, refs);
}

uint32_t mni_overflow_encode(void *bytes, uint32_t length_bytes, uint32_t refs,
                             const mni_overflow *head, const uint32_t *corner, uint32_t count) {
    mni_tally tally;
    overflow_tally(corner, count, &tally);
    uint64_t end = overflow_bytes(&tally, refs);
    MN_ASSERT(count > 0 && end + MNI_BLOCK_TAIL_BYTES <= length_bytes);
    memset(bytes, 0, length_bytes);
    uint8_t *payload = (uint8_t *)bytes + mni_frame_payload_at(refs);
    uint32_t words[8] = {head->order, head->leaf_lo, head->leaf_mid, head->leaf_hi, count};
    memcpy(words + 5, tally.min + COL_CORNER, 3 * sizeof words[0]);
    memcpy(payload, words, sizeof words);
    uint8_t *bits = payload + MNI_OVERFLOW_HEAD_BYTES;
    for (uint32_t c = 0; c < 3; c++) {
        uint32_t width = column_width(&tally, refs, COL_CORNER + c), word[3];
        payload[sizeof words + c] = (uint8_t)width;
        for (uint32_t i = 0; i < count; i++) {
            corner_words(corner + 3 * (size_t)i, word);
            mni_column_put(bits, width, i, word[c] - tally.min[COL_CORNER + c]);
        }
        bits += mni_column_bytes(count, width);
    }
    return (uint32_t)end;
}
