/* The encoder: what a block would take, and its bytes.
 *
 * Hides: which fields have their width from a range of values and which from a count, so that a
 * tally is exact before the order of nodes is known. Order: tally everything, begin with that
 * tally, write the same things, end. One thread a tally or encoder; both are the caller's, of fixed
 * size; the bytes are the caller's. Paper: §3.2. */
#include "block_layout.h"

#include "mn_assert.h"
#include "frame.h"

/* Ranges beyond the bases: of fields that count from 0. */
enum { RANGE_LEFT = BASES, RANGE_A, RANGE_B, RANGE_LACK, RANGE_SIZE, RANGES };
_Static_assert((int)RANGES == (int)MNI_TALLY_RANGES, "a tally holds every range");

void mni_tally_init(mni_tally *tally, bool has_colors, float grid_step) {
    memset(tally, 0, sizeof *tally);
    tally->has_colors = has_colors;
    tally->step = grid_step;
    for (uint32_t r = 0; r < BASES; r++)
        tally->min[r] = UINT32_MAX;
}

/* ---- values to numbers ---------------------------------------------------------------------- */

enum { FACTS = BASE_DELTA, PLACES = BASE_LO - BASE_DELTA, SIMPLEX_FIELDS = 4 };

static void fact_numbers(const mni_facts *facts, uint32_t number[FACTS]) {
    number[BASE_ORDER] = facts->order;
    number[BASE_SWITCH] = mni_float_bits(facts->switch_value) >> MNI_SWITCH_SHIFT;
    number[BASE_RADIUS] = mni_float_bits(facts->radius) >> MNI_RADIUS_SHIFT;
    for (int i = 0; i < 2; i++)
        number[BASE_AXIS + i] = (uint32_t)(facts->cone.axis[i] + 128);
    number[BASE_ANGLE] = facts->cone.angle;
}

/* From BASE_DELTA on. */
static void place_numbers(const mni_node *node, bool has_colors, float step,
                          uint32_t number[PLACES]) {
    for (int i = 0; i < 3; i++) {
        double steps = ((double)node->right_position[i] - (double)node->at.position[i]) / step;
        number[i] = (uint32_t)(int32_t)steps + MNI_BIAS;
    }
    for (int i = 0; i < 4; i++)
        number[3 + i] = has_colors ? node->right_color >> (8 * i) & 255 : 0;
}

/* In the order of the fields. */
static void corner_numbers(const uint32_t corner[3], uint32_t lo, uint32_t mid, uint32_t hi,
                           uint32_t number[SIMPLEX_FIELDS]) {
    uint32_t turn = corner[0] >= mid;
    number[0] = turn;
    number[1] = corner[turn] - lo;
    number[2] = corner[1 - turn] - mid;
    number[3] = mni_third_code(corner[2], lo, hi);
}

/* ---- the tally ------------------------------------------------------------------------------ */

static void widen(mni_tally *tally, uint32_t range, const uint32_t *number, uint32_t count) {
    uint32_t *min = tally->min + range, *max = tally->max + range;
    for (uint32_t i = 0; i < count; i++) {
        min[i] = number[i] < min[i] ? number[i] : min[i];
        max[i] = number[i] > max[i] ? number[i] : max[i];
    }
}

static void tally_facts(mni_tally *tally, const mni_facts *facts) {
    uint32_t number[FACTS];
    fact_numbers(facts, number);
    widen(tally, BASE_ORDER, number, FACTS);
}

static void tally_exit(mni_tally *tally, const mni_child *child) {
    if (child->kind == MNI_CHILD_SUBTREE) {
        tally->exits++;
        tally_facts(tally, &child->facts);
    }
}

static uint32_t lack_of(const mni_node *node) {
    return node->simplex_count < MNI_INLINE ? MNI_INLINE - node->simplex_count : 0;
}

void mni_tally_node(mni_tally *tally, const mni_node *node) {
    uint32_t number[PLACES], left = node->leaf_mid - node->at.leaf_lo - 1, lack = lack_of(node);
    tally_facts(tally, &node->facts);
    place_numbers(node, tally->has_colors, tally->step, number);
    widen(tally, BASE_DELTA, number, PLACES);
    widen(tally, RANGE_LEFT, &left, 1);
    widen(tally, RANGE_LACK, &lack, 1);
    tally->nodes++;
    tally->more += node->simplex_count + lack - MNI_INLINE;
    tally_exit(tally, &node->left);
    tally_exit(tally, &node->right);
    tally->has_overflow |= node->overflow_ref != MN_NONE;
    tally->leaf_lo = node->at.leaf_lo;
    tally->leaf_mid = node->leaf_mid;
    tally->leaf_hi = node->at.leaf_hi;
}

void mni_tally_simplex(mni_tally *tally, const uint32_t corner[3]) {
    uint32_t number[SIMPLEX_FIELDS];
    corner_numbers(corner, tally->leaf_lo, tally->leaf_mid, tally->leaf_hi, number);
    widen(tally, RANGE_A, number + 1, 2);
    tally->third[mni_bits(number[3])]++;
}

void mni_tally_subtree(mni_tally *tally, const mni_subtree *subtree) {
    uint32_t size = subtree->leaf_hi - subtree->leaf_lo - 2;
    widen(tally, BASE_LO, &subtree->leaf_lo, 1);
    widen(tally, RANGE_SIZE, &size, 1);
    tally->subtrees++;
}

void mni_tally_merge(mni_tally *tally, const mni_tally *other) {
    tally->nodes += other->nodes;
    tally->subtrees += other->subtrees;
    tally->exits += other->exits;
    tally->more += other->more;
    tally->has_overflow |= other->has_overflow;
    for (uint32_t bits = 0; bits < MNI_TALLY_LENGTHS; bits++)
        tally->third[bits] += other->third[bits];
    for (uint32_t r = 0; r < RANGES; r++) {
        tally->min[r] = other->min[r] < tally->min[r] ? other->min[r] : tally->min[r];
        tally->max[r] = other->max[r] > tally->max[r] ? other->max[r] : tally->max[r];
    }
}

static void part_range(mni_tally_part *part, uint32_t range, const uint32_t *number,
                       uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        part->min[range + i] = number[i] < part->min[range + i] ? number[i] : part->min[range + i];
        part->max[range + i] = number[i] > part->max[range + i] ? number[i] : part->max[range + i];
    }
}

static void part_child(mni_tally_part *part, const mni_child *child) {
    uint32_t number[FACTS];
    if (child->kind != MNI_CHILD_SUBTREE)
        return;
    part->exits++;
    fact_numbers(&child->facts, number);
    part_range(part, BASE_ORDER, number, FACTS);
}

bool mni_tally_part_of(mni_tally_part *part, const mni_node *node, const uint32_t *corner,
                       bool has_colors, float step) {
    uint32_t number[PLACES], left = node->leaf_mid - node->at.leaf_lo - 1, lack = lack_of(node);
    if (node->simplex_count > MNI_PART_THIRDS)
        return false;
    memset(part, 0, sizeof *part);
    memset(part->min, 0xff, BASES * sizeof *part->min);
    fact_numbers(&node->facts, number);
    part_range(part, BASE_ORDER, number, FACTS);
    part_child(part, &node->left);
    part_child(part, &node->right);
    place_numbers(node, has_colors, step, number);
    part_range(part, BASE_DELTA, number, PLACES);
    part->max[RANGE_LEFT] = left;
    part->max[RANGE_LACK] = lack;
    part->more = node->simplex_count + lack - MNI_INLINE;
    part->has_overflow = node->overflow_ref != MN_NONE;
    for (uint32_t s = 0; s < node->simplex_count; s++) {
        corner_numbers(corner + 3 * (size_t)s, node->at.leaf_lo, node->leaf_mid, node->at.leaf_hi,
                       number);
        part_range(part, RANGE_A, number + 1, 2);
        part->third[part->thirds++] = (uint8_t)mni_bits(number[3]);
    }
    return true;
}

void mni_tally_add(mni_tally *tally, const mni_tally_part *part) {
    tally->nodes++;
    tally->exits += part->exits;
    tally->more += part->more;
    tally->has_overflow |= part->has_overflow;
    for (uint32_t i = 0; i < part->thirds; i++)
        tally->third[part->third[i]]++;
    for (uint32_t r = 0; r < RANGES; r++) {
        tally->min[r] = part->min[r] < tally->min[r] ? part->min[r] : tally->min[r];
        tally->max[r] = part->max[r] > tally->max[r] ? part->max[r] : tally->max[r];
    }
}

static uint32_t range_width(const mni_tally *t, uint32_t range) {
    return t->min[range] < t->max[range] ? mni_bits(t->max[range] - t->min[range]) : 0;
}

/* Widths of the fields before each edge become the edges. */
static uint32_t edges_of(const uint32_t *width, uint32_t fields, uint32_t from, uint16_t *edge) {
    edge[0] = (uint16_t)from;
    for (uint32_t f = 0; f < fields; f++)
        edge[f + 1] = (uint16_t)(edge[f] + width[f]);
    return edge[fields];
}

static uint32_t simplex_edges(const mni_tally *t, uint32_t third, uint16_t *edge) {
    const uint32_t width[SIMPLEX_FIELDS] = {1, range_width(t, RANGE_A), range_width(t, RANGE_B),
                                            third};
    return edges_of(width, SIMPLEX_FIELDS, 0, edge);
}

/* Third corners: codes of up to `near` bits are near; so many are far, in rows of their own; and
 * the width of the field that holds either. */
typedef struct thirds {
    uint32_t near, far, far_bits, width;
} thirds;

static uint32_t longest_third(const mni_tally *t) {
    uint32_t bits = MNI_TALLY_LENGTHS - 1;
    while (bits > 0 && t->third[bits] == 0)
        bits--;
    return bits;
}

/* The cut that takes the fewest bits. places: for third corners, also where there is none. */
static thirds cut_thirds(const mni_tally *t, uint64_t places) {
    uint32_t most = longest_third(t), near = most < 32 ? most : 31;
    uint32_t far = most < 32 ? 0 : t->third[most];
    thirds best = {0, 0, 0, 0};
    uint64_t least = UINT64_MAX;
    for (;; near--) {
        uint32_t width = mni_bits((1u << near) - 1 + far);
        uint64_t bits = width * places + (uint64_t)far * most;
        if (bits < least) {
            best = (thirds){near, far, most, width};
            least = bits;
        }
        if (near == 0)
            return best;
        far += t->third[near];
    }
}

/* Near ones have codes of up to so many bits. */
static thirds thirds_at(const mni_tally *t, uint32_t near) {
    uint32_t most = near, far = 0;
    for (uint32_t bits = near + 1; bits < MNI_TALLY_LENGTHS; bits++) {
        far += t->third[bits];
        most = t->third[bits] > 0 ? bits : most;
    }
    return (thirds){near, far, most, mni_bits((1u << near) - 1 + far)};
}

/* Widths of the fields of a node row in one sum, and of the two kinds that count references. */
static uint32_t facts_bits(const mni_tally *t) {
    uint32_t bits = 0;
    for (uint32_t i = 0; i < FACTS; i++)
        bits += range_width(t, BASE_ORDER + i);
    return bits;
}

/* What the rows take, third corners cut like that: the sum of what lay_out gives places to. */
static uint64_t rows_bytes(const mni_tally *t, uint32_t refs, const thirds *third) {
    uint32_t facts = facts_bits(t), exit_bits = mni_bits(t->exits), places = 0;
    for (uint32_t i = 0; i < PLACES; i++)
        places += range_width(t, BASE_DELTA + i);
    uint32_t simplex = 1 + range_width(t, RANGE_A) + range_width(t, RANGE_B) + third->width;
    uint32_t node = facts + range_width(t, RANGE_LEFT) + places +
                    (t->exits > 0 ? 2 + mni_bits(t->nodes) : 0) + exit_bits +
                    (t->has_overflow ? mni_bits(refs) : 0) + range_width(t, RANGE_LACK) +
                    mni_bits(t->more) + MNI_INLINE * simplex;
    uint32_t subtree = mni_bits(t->nodes) + range_width(t, BASE_LO) + range_width(t, RANGE_SIZE);
    return mni_row_bytes(t->nodes, node) +
           mni_row_bytes(t->exits, facts + mni_bits(refs) + exit_bits) +
           mni_row_bytes(t->subtrees, subtree) + mni_row_bytes(t->more, simplex) +
           mni_row_bytes(third->far, third->far_bits);
}

/* Gives every field its edges; returns what the rows take. */
static uint64_t lay_out(const mni_tally *t, uint32_t refs, uint16_t edge[FIELDS], thirds *third) {
    uint32_t node[FIELD_NODE_END];
    bool exits = t->exits > 0;
    for (uint32_t i = 0; i < FACTS; i++)
        node[FIELD_ORDER + i] = range_width(t, BASE_ORDER + i);
    node[FIELD_LEFT] = range_width(t, RANGE_LEFT);
    for (uint32_t i = 0; i < PLACES; i++)
        node[FIELD_DELTA + i] = range_width(t, BASE_DELTA + i);
    node[FIELD_EXITS] = exits ? 2 : 0;
    node[FIELD_RIGHT] = exits ? mni_bits(t->nodes) : 0;
    node[FIELD_EXIT] = mni_bits(t->exits);
    node[FIELD_OVERFLOW] = t->has_overflow ? mni_bits(refs) : 0;
    node[FIELD_LACK] = range_width(t, RANGE_LACK);
    node[FIELD_MORE] = mni_bits(t->more);
    /* a child block's subtrees all hang from this one */
    const uint32_t exit[] = {mni_bits(refs), mni_bits(t->exits)};
    const uint32_t subtree[] = {mni_bits(t->nodes), range_width(t, BASE_LO),
                                range_width(t, RANGE_SIZE)};
    *third = cut_thirds(t, MNI_INLINE * (uint64_t)t->nodes + t->more);
    uint32_t simplex_bits = simplex_edges(t, third->width, edge + FIELD_TURN);
    uint32_t node_bits = edges_of(node, FIELD_NODE_END, 0, edge) + MNI_INLINE * simplex_bits;
    uint32_t exit_bits = edges_of(exit, 2, edge[FIELD_LEFT], edge + FIELD_REF);
    uint32_t subtree_bits = edges_of(subtree, 3, 0, edge + FIELD_NODE);
    uint64_t bytes = mni_row_bytes(t->nodes, node_bits) + mni_row_bytes(t->exits, exit_bits) +
                     mni_row_bytes(t->subtrees, subtree_bits) +
                     mni_row_bytes(t->more, simplex_bits) +
                     mni_row_bytes(third->far, third->far_bits);
    MN_ASSERT(bytes == rows_bytes(t, refs, third));
    return bytes;
}

uint64_t mni_tally_bytes(const mni_tally *t, uint32_t refs) {
    thirds third = cut_thirds(t, MNI_INLINE * (uint64_t)t->nodes + t->more);
    return mni_frame_payload_at(refs) + MNI_HEAD_BYTES + rows_bytes(t, refs, &third);
}

/* The best cut seldom moves, and none takes less than the best but for rounding, of rows up to
 * bytes, thrice. */
bool mni_tally_fits(mni_tally *t, uint32_t refs, uint64_t limit_bytes) {
    uint64_t head = mni_frame_payload_at(refs) + MNI_HEAD_BYTES;
    thirds third = thirds_at(t, t->near);
    if (head + rows_bytes(t, refs, &third) + 3 <= limit_bytes)
        return true;
    third = cut_thirds(t, MNI_INLINE * (uint64_t)t->nodes + t->more);
    t->near = third.near;
    return head + rows_bytes(t, refs, &third) <= limit_bytes;
}

/* ---- the bytes ------------------------------------------------------------------------------ */

static uint32_t base_of(const mni_tally *tally, uint32_t range) {
    return tally->min[range] <= tally->max[range] ? tally->min[range] : 0;
}

void mni_encoder_begin(mni_encoder *encoder, void *bytes, uint32_t length_bytes,
                       const mni_tally *tally, uint32_t refs) {
    MN_ASSERT(mni_tally_bytes(tally, refs) + MNI_BLOCK_TAIL_BYTES <= length_bytes);
    memset(bytes, 0, length_bytes);
    memset(encoder, 0, sizeof *encoder);
    encoder->tally = *tally;
    uint8_t *payload = (uint8_t *)bytes + mni_frame_payload_at(refs);
    uint32_t base[BASES];
    uint16_t edge[FIELDS];
    thirds third;
    lay_out(tally, refs, edge, &third);
    uint32_t head[5] = {tally->nodes, tally->subtrees, tally->exits, tally->more,
                        (tally->has_colors ? MNI_FLAG_COLORS : 0) | third.near << 8 |
                            third.far_bits << 16};
    for (uint32_t b = 0; b < BASES; b++)
        base[b] = base_of(tally, b);
    memcpy(payload, head, sizeof head);
    memcpy(payload + MNI_HEAD_STEP, &tally->step, sizeof tally->step);
    memcpy(payload + MNI_HEAD_BASE, base, sizeof base);
    memcpy(payload + MNI_HEAD_FAR, &third.far, sizeof third.far);
    memcpy(payload + MNI_HEAD_EDGE, edge, sizeof edge);
    mni_block_layout(&encoder->view, payload);
}

/* Numbers into the fields from f on, of a row that begins at that bit. */
static void put(const uint8_t *edge, const uint8_t *rows, uint64_t row, uint32_t f,
                const uint32_t *number, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        uint32_t from = mni_edge(edge, f + i);
        MN_ASSERT(mni_bits(number[i]) <= mni_edge(edge, f + i + 1) - from);
        mni_bits_put((uint8_t *)(uintptr_t)rows, row + from, number[i]);
    }
}

static void put_based(const mni_encoder *e, const uint8_t *rows, uint64_t row, uint32_t f,
                      uint32_t base, uint32_t *number, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        number[i] -= mni_base(e->view.base, base + i);
    put(e->view.edge, rows, row, f, number, count);
}

static void put_facts(const mni_encoder *e, const uint8_t *rows, uint64_t row,
                      const mni_facts *facts) {
    uint32_t number[FACTS];
    MN_ASSERT(mni_switch_up(facts->switch_value) == facts->switch_value);
    MN_ASSERT(mni_radius_up(facts->radius) == facts->radius);
    fact_numbers(facts, number);
    put_based(e, rows, row, FIELD_ORDER, BASE_ORDER, number, FACTS);
}

static void put_exit(mni_encoder *e, const mni_child *child) {
    if (child->kind != MNI_CHILD_SUBTREE)
        return;
    uint64_t row = (uint64_t)e->exits++ * e->view.exit_bits;
    put_facts(e, e->view.exit_rows, row, &child->facts);
    put(e->view.edge, e->view.exit_rows, row, FIELD_REF, (uint32_t[]){child->ref, child->subtree},
        2);
}

void mni_encoder_node(mni_encoder *e, const mni_node *node) {
    MN_ASSERT(e->nodes < e->tally.nodes && e->last.simplex_count == e->placed);
    MN_ASSERT(node->left.kind != MNI_CHILD_INNER || node->left.node == e->nodes + 1);
    const uint8_t *rows = e->view.node_rows;
    uint64_t row = (uint64_t)e->nodes * e->view.node_bits;
    uint32_t number[PLACES], left = node->leaf_mid - node->at.leaf_lo - 1;
    bool exits = e->tally.exits > 0;
    put_facts(e, rows, row, &node->facts);
    put(e->view.edge, rows, row, FIELD_LEFT, &left, 1);
    place_numbers(node, e->tally.has_colors, e->tally.step, number);
    put_based(e, rows, row, FIELD_DELTA, BASE_DELTA, number, PLACES);
    const uint32_t rest[] = {
        (uint32_t)(node->left.kind == MNI_CHILD_SUBTREE) +
            2 * (uint32_t)(node->right.kind == MNI_CHILD_SUBTREE),
        exits && node->right.kind == MNI_CHILD_INNER ? node->right.node - e->nodes : 0,
        e->exits,
        node->overflow_ref + 1, /* MN_NONE + 1 is 0 */
        lack_of(node),
        e->more};
    put(e->view.edge, rows, row, FIELD_EXITS, rest, sizeof rest / sizeof rest[0]);
    put_exit(e, &node->left);
    put_exit(e, &node->right);
    e->nodes++;
    e->last = *node;
    e->placed = 0;
}

void mni_encoder_simplex(mni_encoder *e, const uint32_t corner[3]) {
    uint32_t number[SIMPLEX_FIELDS], i = e->placed++;
    MN_ASSERT(e->nodes > 0 && i < e->last.simplex_count);
    const uint8_t *rows = e->view.node_rows, *edge = e->view.edge + 2 * (size_t)FIELD_TURN;
    uint64_t at =
        (uint64_t)e->nodes * e->view.node_bits - (uint64_t)(MNI_INLINE - i) * e->view.simplex_bits;
    if (i >= MNI_INLINE) {
        rows = e->view.more_rows;
        at = (uint64_t)e->more++ * e->view.simplex_bits;
    }
    corner_numbers(corner, e->last.at.leaf_lo, e->last.leaf_mid, e->last.at.leaf_hi, number);
    if (number[3] >= e->view.near) {
        MN_ASSERT(e->far < e->view.far && mni_bits(number[3]) <= e->view.far_bits);
        mni_bits_put((uint8_t *)(uintptr_t)e->view.far_rows, (uint64_t)e->far * e->view.far_bits,
                     number[3]);
        number[3] = e->view.near + e->far++;
    }
    put(edge, rows, at, 0, number, SIMPLEX_FIELDS);
}

void mni_encoder_subtree(mni_encoder *e, const mni_subtree *subtree) {
    uint64_t row = (uint64_t)e->subtrees++ * e->view.subtree_bits;
    MN_ASSERT(e->subtrees <= e->tally.subtrees);
    const uint32_t number[] = {subtree->node, subtree->leaf_lo - mni_base(e->view.base, BASE_LO),
                               subtree->leaf_hi - subtree->leaf_lo - 2};
    put(e->view.edge, e->view.subtree_rows, row, FIELD_NODE, number, 3);
}

void mni_encoder_end(mni_encoder *e) {
    MN_ASSERT(e->nodes == e->tally.nodes);
    MN_ASSERT(e->subtrees == e->tally.subtrees);
    MN_ASSERT(e->exits == e->tally.exits);
    MN_ASSERT(e->more == e->tally.more);
    MN_ASSERT(e->far == e->view.far);
    MN_ASSERT(e->placed == e->last.simplex_count);
}

/* ---- overflow blocks ------------------------------------------------------------------------ */

static void overflow_tally(mni_tally *tally, const mni_overflow *head) {
    mni_tally_init(tally, false, 0);
    tally->leaf_lo = head->leaf_lo;
    tally->leaf_mid = head->leaf_mid;
    tally->leaf_hi = head->leaf_hi;
}

static uint64_t overflow_bytes(const mni_tally *t, uint32_t count, uint32_t refs) {
    uint16_t edge[SIMPLEX_FIELDS + 1];
    return mni_frame_payload_at(refs) + MNI_OVERFLOW_HEAD_BYTES +
           mni_row_bytes(count, simplex_edges(t, longest_third(t), edge));
}

uint32_t mni_overflow_fit(const mni_overflow *head, const uint32_t *corner, uint32_t count,
                          uint32_t length_bytes) {
    mni_tally tally;
    overflow_tally(&tally, head);
    for (uint32_t i = 0; i < count; i++) {
        mni_tally_simplex(&tally, corner + 3 * (size_t)i);
        if (overflow_bytes(&tally, i + 1, 1) + MNI_BLOCK_TAIL_BYTES > length_bytes)
            return i;
    }
    return count;
}

uint32_t mni_overflow_bytes(const mni_overflow *head, const uint32_t *corner, uint32_t count,
                            uint32_t refs) {
    mni_tally tally;
    overflow_tally(&tally, head);
    for (uint32_t i = 0; i < count; i++)
        mni_tally_simplex(&tally, corner + 3 * (size_t)i);
    return (uint32_t)overflow_bytes(&tally, count, refs);
}

uint32_t mni_overflow_encode(void *bytes, uint32_t length_bytes, uint32_t refs,
                             const mni_overflow *head, const uint32_t *corner, uint32_t count) {
    mni_tally tally;
    overflow_tally(&tally, head);
    for (uint32_t i = 0; i < count; i++)
        mni_tally_simplex(&tally, corner + 3 * (size_t)i);
    uint64_t end = overflow_bytes(&tally, count, refs);
    MN_ASSERT(count > 0 && end + MNI_BLOCK_TAIL_BYTES <= length_bytes);
    memset(bytes, 0, length_bytes);
    uint8_t *payload = (uint8_t *)bytes + mni_frame_payload_at(refs);
    uint32_t words[5] = {head->order, head->leaf_lo, head->leaf_mid, head->leaf_hi, count};
    uint16_t edge[SIMPLEX_FIELDS + 1];
    uint32_t row = simplex_edges(&tally, longest_third(&tally), edge);
    memcpy(payload, words, sizeof words);
    memcpy(payload + MNI_OVERFLOW_EDGE, edge, sizeof edge);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t number[SIMPLEX_FIELDS];
        corner_numbers(corner + 3 * (size_t)i, head->leaf_lo, head->leaf_mid, head->leaf_hi,
                       number);
        put(payload + MNI_OVERFLOW_EDGE, payload + MNI_OVERFLOW_HEAD_BYTES, (uint64_t)i * row, 0,
            number, SIMPLEX_FIELDS);
    }
    return (uint32_t)end;
}
