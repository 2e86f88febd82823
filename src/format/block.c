/* The decoder: indices in, values out.
 *
 * Hides: where rows and fields lie, bases, codes of floats, positions and corners. A view is made
 * by mni_block_open (block_check.c) or, of bytes that have passed it, mni_block_reopen; then the
 * getters, in any order, by any thread, while the bytes stay. No memory of its own. Indices must be
 * in range: the callers have them from the view's counts or from records that were checked.
 * Paper: §3.2 (meta-nodes). */
#include "block_layout.h"

#include "mn_assert.h"
#include "frame.h"

/* The short way: the processor takes bits out of words by one instruction (BMI2), a row is fetched
 * by few reads, and nothing branches. */
#if defined(__x86_64__)
#include <immintrin.h>
#define SHORT __attribute__((target("bmi2")))
#define SHORT_INLINE static inline __attribute__((target("bmi2"), always_inline))
#define HAS_SHORT __builtin_cpu_supports("bmi2")
#define SPREAD(word, mask) _pdep_u64(word, mask)
#else
#define SHORT
#define SHORT_INLINE static inline
#define HAS_SHORT false
#define SPREAD(word, mask) 0
#endif

/* Facts but for the order id, spread over a word so that numbers and bases are added at once and no
 * sum runs into the next: a sum has a bit more than the checker lets each of the two have. */
enum { AT_SWITCH = 0, AT_RADIUS = 15, AT_AXIS = 29, AT_AXIS_2 = 39, AT_ANGLE = 49, AT_END = 59 };
static const uint8_t spread_at[] = {AT_SWITCH, AT_RADIUS, AT_AXIS, AT_AXIS_2, AT_ANGLE};

enum { WORD = 57 }; /* bits that one read is good for */

mni_block_limits mni_block_limits_of(const mn_header *header) {
    return (mni_block_limits){.leaves = header->leaves,
                              .nodes = header->nodes,
                              .file_bytes = header->file_bytes,
                              .has_colors = header->has_colors,
                              .grid_step = header->grid_step};
}

static uint32_t width_of(const mni_block *view, uint32_t field) {
    return mni_edge(view->edge, field + 1) - mni_edge(view->edge, field);
}

static void lay_out_short(mni_block *view) {
    const uint8_t *edge = view->edge;
    view->facts_spread = view->facts_base = 0;
    for (uint32_t i = 0; i < BASE_DELTA - BASE_SWITCH; i++) {
        uint64_t ones = (UINT64_C(1) << width_of(view, FIELD_SWITCH + i)) - 1;
        view->facts_spread |= ones << spread_at[i];
        view->facts_base += (uint64_t)mni_base(view->base, BASE_SWITCH + i) << spread_at[i];
    }
    for (uint32_t i = 0; i < 3; i++) {
        view->delta_base[i] = mni_base(view->base, BASE_DELTA + i) - MNI_BIAS;
        view->delta_bits[i] = (uint8_t)width_of(view, FIELD_DELTA + i);
    }
    view->place_at = (uint16_t)mni_edge(edge, FIELD_LEFT);
    view->way_at = (uint16_t)mni_edge(edge, FIELD_EXITS);
    view->simplex_at = (uint16_t)mni_edge(edge, FIELD_NODE_END);
    view->order_bits = (uint8_t)width_of(view, FIELD_ORDER);
    view->left_bits = (uint8_t)width_of(view, FIELD_LEFT);
    view->right_bits = (uint8_t)width_of(view, FIELD_RIGHT);
    view->exit_bits_of = (uint8_t)width_of(view, FIELD_EXIT);
    view->a_bits = (uint8_t)width_of(view, FIELD_A);
    view->b_bits = (uint8_t)width_of(view, FIELD_B);
    view->third_bits = (uint8_t)width_of(view, FIELD_THIRD);
}

uint64_t mni_block_layout(mni_block *view, const uint8_t *payload) {
    uint32_t head[5];
    memcpy(head, payload, sizeof head);
    memcpy(&view->step, payload + MNI_HEAD_STEP, sizeof view->step);
    view->nodes = head[0];
    view->subtrees = head[1];
    view->exits = head[2];
    view->more = head[3];
    view->has_colors = (head[4] & MNI_FLAG_COLORS) != 0;
    view->base = payload + MNI_HEAD_BASE;
    view->edge = payload + MNI_HEAD_EDGE;
    view->simplex_bits = mni_edge(view->edge, FIELD_SIMPLEX_END);
    view->node_bits = mni_edge(view->edge, FIELD_NODE_END) + MNI_INLINE * view->simplex_bits;
    view->exit_bits = mni_edge(view->edge, FIELD_EXIT_END);
    view->subtree_bits = mni_edge(view->edge, FIELD_SUBTREE_END);
    view->node_rows = payload + MNI_HEAD_BYTES;
    view->exit_rows = view->node_rows + mni_row_bytes(view->nodes, view->node_bits);
    view->subtree_rows = view->exit_rows + mni_row_bytes(view->exits, view->exit_bits);
    view->more_rows = view->subtree_rows + mni_row_bytes(view->subtrees, view->subtree_bits);
    view->far_rows = view->more_rows + mni_row_bytes(view->more, view->simplex_bits);
    memcpy(&view->far, payload + MNI_HEAD_FAR, sizeof view->far);
    view->near = 1u << (head[4] >> 8 & 31);
    view->far_bits = head[4] >> 16 & 63;
    view->has_rest = mni_edge(view->edge, FIELD_OVERFLOW) < mni_edge(view->edge, FIELD_NODE_END);
    view->is_short = HAS_SHORT && view->simplex_bits <= WORD &&
                     mni_edge(view->edge, FIELD_COLOR) - mni_edge(view->edge, FIELD_LEFT) <= WORD &&
                     (view->exits == 0 || width_of(view, FIELD_EXITS) == 2);
    if (view->is_short)
        lay_out_short(view);
    return (uint64_t)(view->far_rows - payload) + mni_row_bytes(view->far, view->far_bits);
}

void mni_block_reopen(mni_block *view, const void *bytes) {
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    mni_block_layout(view, (const uint8_t *)bytes + mni_frame_payload_at(frame.refs));
}

mni_rows_place mni_block_rows_place(const void *bytes) {
    mni_frame frame;
    mni_block view;
    mni_frame_get(bytes, &frame);
    if (frame.kind != MNI_FRAME_METANODE)
        return (mni_rows_place){0};
    mni_block_reopen(&view, bytes);
    if (view.nodes < 8 || view.node_bits == 0 || view.node_bits > MNI_PLANES_BITS_MAX)
        return (mni_rows_place){0};
    return (mni_rows_place){.at = (uint32_t)(view.node_rows - (const uint8_t *)bytes),
                            .groups = view.nodes / 8,
                            .bits = view.node_bits};
}

/* ---- fields --------------------------------------------------------------------------------- */

/* Field f of the row that begins at bit `row`, without its base. */
static inline uint32_t get(const uint8_t *edge, const uint8_t *rows, uint64_t row, uint32_t f) {
    uint32_t from_to;
    memcpy(&from_to, edge + 2 * (size_t)f, sizeof from_to);
    uint32_t from = from_to & 0xffff, to = from_to >> 16;
    return mni_bits_get(rows, row + from, to - from);
}

/* Neighbours from field f on, read at once: they have 57 bits at most together. */
static inline void get_some(const uint8_t *edges, const uint8_t *rows, uint64_t row, uint32_t f,
                            uint32_t *value, uint32_t count) {
    uint16_t edge[8];
    memcpy(edge, edges + 2 * (size_t)f, (count + 1) * sizeof edge[0]);
    uint64_t word = mni_bits_at(rows, row + edge[0]);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t width = (uint32_t)(edge[i + 1] - edge[i]);
        value[i] = (uint32_t)(word & ((UINT64_C(1) << width) - 1));
        word >>= width;
    }
}

/* So many of the lowest bits. */
static inline uint32_t low_bits(uint64_t word, uint32_t width) {
    return (uint32_t)(word & ((UINT64_C(1) << width) - 1));
}

SHORT_INLINE void get_facts_short(const mni_block *view, const uint8_t *rows, uint64_t row,
                                  mni_facts *out) {
    uint64_t facts = SPREAD(mni_bits_at(rows, row + view->order_bits), view->facts_spread);
    facts += view->facts_base;
    out->order =
        mni_base(view->base, BASE_ORDER) + low_bits(mni_bits_at(rows, row), view->order_bits);
    out->switch_value = mni_float_of(low_bits(facts, AT_RADIUS) << MNI_SWITCH_SHIFT);
    out->radius =
        mni_float_of(low_bits(facts >> AT_RADIUS, AT_AXIS - AT_RADIUS) << MNI_RADIUS_SHIFT);
    out->cone =
        (mn_cone){{(int8_t)((facts >> AT_AXIS) - 128), (int8_t)((facts >> AT_AXIS_2) - 128)},
                  (uint8_t)(facts >> AT_ANGLE)};
}

/* Those after the order id have 49 bits at most, the checker sees to that. */
static inline void get_facts_long(const mni_block *view, const uint8_t *rows, uint64_t row,
                                  mni_facts *out) {
    uint32_t base[BASE_DELTA], value[BASE_DELTA];
    memcpy(base, view->base, sizeof base);
    value[0] = mni_bits_get(rows, row, mni_edge(view->edge, FIELD_SWITCH));
    get_some(view->edge, rows, row, FIELD_SWITCH, value + 1, BASE_DELTA - 1);
    for (uint32_t i = 0; i < BASE_DELTA; i++)
        value[i] += base[i];
    out->order = value[BASE_ORDER];
    out->switch_value = mni_float_of(value[BASE_SWITCH] << MNI_SWITCH_SHIFT);
    out->radius = mni_float_of(value[BASE_RADIUS] << MNI_RADIUS_SHIFT);
    out->cone = (mn_cone){{(int8_t)(value[BASE_AXIS] - 128), (int8_t)(value[BASE_AXIS + 1] - 128)},
                          (uint8_t)value[BASE_ANGLE]};
}

SHORT static void facts_short(const mni_block *view, const uint8_t *rows, uint64_t row,
                              mni_facts *out) {
    get_facts_short(view, rows, row, out);
}

static inline void get_facts(const mni_block *view, const uint8_t *rows, uint64_t row,
                             mni_facts *out) {
    if (view->is_short)
        facts_short(view, rows, row, out);
    else
        get_facts_long(view, rows, row, out);
}

static uint32_t get_color(const mni_block *view, uint64_t row) {
    uint32_t color = 0, value[4];
    get_some(view->edge, view->node_rows, row, FIELD_COLOR, value, 4);
    for (uint32_t i = 0; i < 4; i++)
        color |= ((mni_base(view->base, BASE_COLOR + i) + value[i]) & 255) << (8 * i);
    return color;
}

/* ---- records -------------------------------------------------------------------------------- */

void mni_block_facts(const mni_block *view, uint32_t node, mni_facts *out) {
    MN_ASSERT(node < view->nodes);
    get_facts(view, view->node_rows, (uint64_t)node * view->node_bits, out);
}

/* Where an exit leads. */
static inline void get_way(const mni_block *view, mni_child *exit) {
    uint64_t row = (uint64_t)exit->exit * view->exit_bits;
    exit->ref = get(view->edge, view->exit_rows, row, FIELD_REF);
    exit->subtree = get(view->edge, view->exit_rows, row, FIELD_SUBTREE);
}

void mni_block_way(const mni_block *view, mni_child *exit) {
    MN_ASSERT(exit->exit < view->exits);
    get_way(view, exit);
}

void mni_block_exit(const mni_block *view, uint32_t exit, mni_child *out) {
    MN_ASSERT(exit < view->exits);
    out->kind = MNI_CHILD_SUBTREE;
    out->node = MN_NONE;
    out->exit = exit;
    get_way(view, out);
    get_facts(view, view->exit_rows, (uint64_t)exit * view->exit_bits, &out->facts);
}

/* Where the facts of a child begin, in bits from the node rows. Which kind it is nobody can guess:
 * of a leaf it is some row. */
static inline uint64_t child_at(const mni_block *view, const mni_child *child) {
    const uint64_t is_exit = 0 - (uint64_t)(child->kind == MNI_CHILD_SUBTREE);
    const uint64_t is_inner = 0 - (uint64_t)(child->kind == MNI_CHILD_INNER);
    const uint64_t exits = (uint64_t)(view->exit_rows - view->node_rows) * 8;
    return ((exits + (uint64_t)child->exit * view->exit_bits) & is_exit) |
           ((uint64_t)child->node * view->node_bits & is_inner);
}

static inline void set_child(const mni_block *view, mni_child_kind kind, uint32_t inner,
                             uint32_t exit, mni_child *out) {
    out->kind = kind;
    out->node = inner;
    out->exit = exit;
    out->ref = MN_NONE;
    __builtin_prefetch(view->node_rows + (child_at(view, out) >> 3));
}

/* The leaves of the left child, and the steps to the right one. */
static inline void get_place(const mni_block *view, uint64_t row, uint32_t value[4]) {
    const uint8_t *edge = view->edge;
    if (mni_edge(edge, FIELD_COLOR) - mni_edge(edge, FIELD_LEFT) <= 57) {
        get_some(edge, view->node_rows, row, FIELD_LEFT, value, 4);
        return;
    }
    for (uint32_t i = 0; i < 4; i++)
        value[i] = get(edge, view->node_rows, row, FIELD_LEFT + i);
}

/* Simplices, where they are not two in the row, and overflow blocks. */
static inline void get_rest(const mni_block *view, uint64_t row, mni_node *out) {
    const uint8_t *edge = view->edge, *rows = view->node_rows;
    out->overflow_ref = get(edge, rows, row, FIELD_OVERFLOW) - 1;
    out->simplex_count = MNI_INLINE - get(edge, rows, row, FIELD_LACK);
    if (view->more == 0)
        return;
    out->more = get(edge, rows, row, FIELD_MORE);
    uint32_t end = out->row + 1 < view->nodes ? get(edge, rows, row + view->node_bits, FIELD_MORE)
                                              : view->more;
    out->simplex_count += end - out->more;
}

static void split_long(const mni_block *view, uint32_t node, const mni_place *at, mni_node *out) {
    const uint64_t row = (uint64_t)node * view->node_bits;
    uint32_t place[4], way[3]; /* exits, right, exit */
    get_place(view, row, place);
    const uint32_t left_leaves = 1 + place[0];
    out->leaf_mid = at->leaf_lo + left_leaves;
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t steps = place[i + 1] + mni_base(view->base, BASE_DELTA + i) - MNI_BIAS;
        out->right_position[i] = at->position[i] + (float)(int32_t)steps * view->step;
    }

    mni_child_kind left = left_leaves == 1 ? MNI_CHILD_LEAF : MNI_CHILD_INNER;
    mni_child_kind right = at->leaf_hi - out->leaf_mid == 1 ? MNI_CHILD_LEAF : MNI_CHILD_INNER;
    uint32_t distance = left_leaves, exit = 0; /* the left child's inner nodes are all between */
    if (view->exits > 0) {
        get_some(view->edge, view->node_rows, row, FIELD_EXITS, way, 3);
        left = way[0] & 1 ? MNI_CHILD_SUBTREE : left;
        right = way[0] & 2 ? MNI_CHILD_SUBTREE : right;
        distance = way[1];
        exit = way[2];
    }
    set_child(view, left, node + 1, exit, &out->left);
    set_child(view, right, node + distance, exit + (left == MNI_CHILD_SUBTREE), &out->right);
}

/* The same, the short way. */
SHORT static void split_short(const mni_block *view, uint32_t node, const mni_place *at,
                              mni_node *out) {
    const uint64_t row = (uint64_t)node * view->node_bits;
    uint64_t place = mni_bits_at(view->node_rows, row + view->place_at);
    const uint32_t left_leaves = 1 + low_bits(place, view->left_bits);
    out->leaf_mid = at->leaf_lo + left_leaves;
    place >>= view->left_bits;
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t steps = low_bits(place, view->delta_bits[i]) + view->delta_base[i];
        out->right_position[i] = at->position[i] + (float)(int32_t)steps * view->step;
        place >>= view->delta_bits[i];
    }

    uint32_t exits = 0, distance = left_leaves, exit = 0;
    if (view->exits > 0) {
        uint64_t way = mni_bits_at(view->node_rows, row + view->way_at);
        exits = way & 3;
        distance = low_bits(way >> 2, view->right_bits);
        exit = low_bits(way >> 2 >> view->right_bits, view->exit_bits_of);
    }
    _Static_assert(MNI_CHILD_LEAF == 0 && MNI_CHILD_INNER == 1 && MNI_CHILD_SUBTREE == 2, "below");
    uint32_t left = (exits & 1) << 1 | ((uint32_t)(left_leaves > 1) & ~exits);
    uint32_t right = (exits & 2) | ((uint32_t)(at->leaf_hi - out->leaf_mid > 1) & ~exits >> 1);
    set_child(view, left, node + 1, exit, &out->left);
    set_child(view, right, node + distance, exit + (exits & 1), &out->right);
}

SHORT static void children_short(const mni_block *view, mni_node *node) {
    get_facts_short(view, view->node_rows, child_at(view, &node->left), &node->left.facts);
    get_facts_short(view, view->node_rows, child_at(view, &node->right), &node->right.facts);
}

static void child_long(const mni_block *view, mni_child *child) {
    child->facts = (mni_facts){0};
    if (child->kind != MNI_CHILD_LEAF)
        get_facts_long(view, view->node_rows, child_at(view, child), &child->facts);
}

void mni_block_children(const mni_block *view, mni_node *node) {
    if (view->is_short) {
        children_short(view, node);
        return;
    }
    child_long(view, &node->left);
    child_long(view, &node->right);
}

void mni_block_split(const mni_block *view, uint32_t node, const mni_place *at, mni_node *out) {
    MN_ASSERT(node < view->nodes);
    const uint64_t row = (uint64_t)node * view->node_bits;
    out->at = *at;
    out->row = node;
    if (view->is_short)
        split_short(view, node, at, out);
    else
        split_long(view, node, at, out);
    out->right_color = view->has_colors ? get_color(view, row) : UINT32_MAX;
    out->simplex_count = MNI_INLINE;
    out->overflow_ref = MN_NONE;
    if (view->has_rest)
        get_rest(view, row, out);
}

void mni_block_node(const mni_block *view, uint32_t node, const mni_place *at, mni_node *out) {
    mni_block_split(view, node, at, out);
    mni_block_children(view, out);
    mni_block_facts(view, node, &out->facts);
    if (out->left.kind == MNI_CHILD_SUBTREE)
        get_way(view, &out->left);
    if (out->right.kind == MNI_CHILD_SUBTREE)
        get_way(view, &out->right);
}

void mni_block_subtree(const mni_block *view, uint32_t subtree, mni_subtree *out) {
    MN_ASSERT(subtree < view->subtrees);
    const uint64_t row = (uint64_t)subtree * view->subtree_bits;
    uint32_t value[3]; /* node, lo, size */
    if (view->subtree_bits <= WORD)
        get_some(view->edge, view->subtree_rows, row, FIELD_NODE, value, 3);
    else
        for (uint32_t i = 0; i < 3; i++)
            value[i] = get(view->edge, view->subtree_rows, row, FIELD_NODE + i);
    out->node = value[0];
    out->leaf_lo = mni_base(view->base, BASE_LO) + value[1];
    out->leaf_hi = out->leaf_lo + 2 + value[2];
}

bool mni_facts_equal(const mni_facts *a, const mni_facts *b) {
    return a->order == b->order && a->switch_value == b->switch_value && a->radius == b->radius &&
           a->cone.axis[0] == b->cone.axis[0] && a->cone.axis[1] == b->cone.axis[1] &&
           a->cone.angle == b->cone.angle;
}

/* ---- simplices ------------------------------------------------------------------------------ */

/* The simplex at bit `at`; edges: from FIELD_TURN on. Turn and first number have 33 bits at most.
 */
static inline void get_simplex_long(const uint8_t *edges, const uint8_t *rows, uint64_t at,
                                    mni_simplex_row *out, uint32_t *turn) {
    uint16_t edge[FIELD_SIMPLEX_END + 1 - FIELD_TURN];
    memcpy(edge, edges, sizeof edge);
    uint64_t word = mni_bits_at(rows, at);
    *turn = word & 1;
    out->a = low_bits(word >> 1, edge[2] - 1u);
    word = edge[3] <= WORD ? word >> edge[2] : mni_bits_at(rows, at + edge[2]);
    out->b = low_bits(word, (uint32_t)(edge[3] - edge[2]));
    out->third = mni_bits_get(rows, at + edge[3], (uint32_t)(edge[4] - edge[3]));
}

SHORT_INLINE void get_simplex_short(const mni_block *view, const uint8_t *rows, uint64_t at,
                                    mni_simplex_row *out, uint32_t *turn) {
    uint64_t word = mni_bits_at(rows, at);
    *turn = word & 1;
    word >>= 1;
    out->a = low_bits(word, view->a_bits);
    word >>= view->a_bits;
    out->b = low_bits(word, view->b_bits);
    out->third = low_bits(word >> view->b_bits, view->third_bits);
}

/* Where the simplices of a node's own row stand. */
static inline uint64_t inline_at(const mni_block *view, uint32_t node) {
    return (uint64_t)node * view->node_bits + mni_edge(view->edge, FIELD_NODE_END);
}

static inline void corners_of(const mni_simplex_row *row, uint32_t turn, uint32_t third,
                              uint32_t lo, uint32_t mid, uint32_t hi, uint32_t corner[3]) {
    uint32_t a = lo + row->a, b = mid + row->b, swap = (a ^ b) & (0 - turn);
    corner[0] = a ^ swap;
    corner[1] = b ^ swap;
    corner[2] = mni_third_of(third, lo, hi);
}

SHORT static uint32_t simplex_row_short(const mni_block *view, const uint8_t *rows, uint64_t at,
                                        mni_simplex_row *row) {
    uint32_t turn;
    get_simplex_short(view, rows, at, row, &turn);
    return turn;
}

/* Returns whether the corner in the right child comes first. */
static inline uint32_t simplex_row(const mni_block *view, const uint8_t *rows, uint64_t at,
                                   mni_simplex_row *row) {
    uint32_t turn;
    if (view->is_short)
        return simplex_row_short(view, rows, at, row);
    get_simplex_long(view->edge + 2 * (size_t)FIELD_TURN, rows, at, row, &turn);
    return turn;
}

void mni_block_more_row(const mni_block *view, uint32_t more, mni_simplex_row *out) {
    simplex_row(view, view->more_rows, (uint64_t)more * view->simplex_bits, out);
}

void mni_block_simplex(const mni_block *view, const mni_node *node, uint32_t i,
                       uint32_t corner[3]) {
    MN_ASSERT(i < node->simplex_count);
    const uint8_t *rows = i < MNI_INLINE ? view->node_rows : view->more_rows;
    uint64_t at = i < MNI_INLINE ? inline_at(view, node->row) + (uint64_t)i * view->simplex_bits
                                 : (uint64_t)(node->more + i - MNI_INLINE) * view->simplex_bits;
    mni_simplex_row row;
    uint32_t turn = simplex_row(view, rows, at, &row), third = row.third;
    if (third >= view->near)
        third = mni_block_far(view, third - view->near);
    corners_of(&row, turn, third, node->at.leaf_lo, node->leaf_mid, node->at.leaf_hi, corner);
}

void mni_overflow_simplex(const mni_overflow *view, uint32_t simplex, uint32_t corner[3]) {
    MN_ASSERT(simplex < view->simplices);
    uint64_t bits = mni_edge(view->edge, FIELD_SIMPLEX_END - FIELD_TURN);
    mni_simplex_row row;
    uint32_t turn;
    get_simplex_long(view->edge, view->rows, simplex * bits, &row, &turn);
    corners_of(&row, turn, row.third, view->leaf_lo, view->leaf_mid, view->leaf_hi, corner);
}

/* ---- rows, for the checker ------------------------------------------------------------------ */

SHORT static void row_short(const mni_block *view, uint64_t row, mni_row *out) {
    get_facts_short(view, view->node_rows, row, &out->facts);
    uint64_t place = mni_bits_at(view->node_rows, row + view->place_at), way = 0;
    out->left = low_bits(place, view->left_bits);
    place >>= view->left_bits;
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t steps = low_bits(place, view->delta_bits[i]) + view->delta_base[i];
        out->delta[i] = (float)(int32_t)steps * view->step;
        place >>= view->delta_bits[i];
    }
    if (view->exits > 0)
        way = mni_bits_at(view->node_rows, row + view->way_at);
    out->exits = way & 3;
    out->right = low_bits(way >> 2, view->right_bits);
    out->exit = low_bits(way >> 2 >> view->right_bits, view->exit_bits_of);
    row += view->simplex_at;
    for (uint32_t i = 0; i < MNI_INLINE; i++, row += view->simplex_bits) {
        uint32_t turn;
        get_simplex_short(view, view->node_rows, row, &out->simplex[i], &turn);
    }
}

static void row_long(const mni_block *view, uint64_t row, mni_row *out) {
    uint32_t place[4], way[3] = {0};
    get_facts_long(view, view->node_rows, row, &out->facts);
    get_place(view, row, place);
    out->left = place[0];
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t steps = place[i + 1] + mni_base(view->base, BASE_DELTA + i) - MNI_BIAS;
        out->delta[i] = (float)(int32_t)steps * view->step;
    }
    if (view->exits > 0)
        get_some(view->edge, view->node_rows, row, FIELD_EXITS, way, 3);
    out->exits = way[0];
    out->right = way[1];
    out->exit = way[2];
    row += mni_edge(view->edge, FIELD_NODE_END);
    for (uint32_t i = 0; i < MNI_INLINE; i++, row += view->simplex_bits)
        simplex_row(view, view->node_rows, row, &out->simplex[i]);
}

void mni_block_row(const mni_block *view, uint32_t node, mni_row *out) {
    const uint64_t row = (uint64_t)node * view->node_bits;
    out->overflow = out->lack = out->more = 0;
    if (view->has_rest) {
        out->overflow = get(view->edge, view->node_rows, row, FIELD_OVERFLOW);
        out->lack = get(view->edge, view->node_rows, row, FIELD_LACK);
        out->more = get(view->edge, view->node_rows, row, FIELD_MORE);
    }
    if (view->is_short)
        row_short(view, row, out);
    else
        row_long(view, row, out);
}

uint32_t mni_block_more_after(const mni_block *view, uint32_t node) {
    return get(view->edge, view->node_rows, (uint64_t)(node + 1) * view->node_bits, FIELD_MORE);
}

/* ---- all of a block ------------------------------------------------------------------------- */

void mni_walk_begin(mni_walk *walk, const mni_block *view) {
    walk->view = view;
    walk->subtree = walk->waiting = 0;
}

static void walk_push(mni_walk *walk, const mni_child *child, uint32_t lo, uint32_t hi,
                      const float position[3]) {
    if (child->kind != MNI_CHILD_INNER)
        return;
    struct mni_walk_node *to = &walk->stack[walk->waiting++];
    to->node = child->node;
    to->at.leaf_lo = lo;
    to->at.leaf_hi = hi;
    memcpy(to->at.position, position, sizeof to->at.position);
}

bool mni_walk_next(mni_walk *walk, uint32_t *node, mni_node *out) {
    if (walk->waiting == 0) {
        mni_subtree top;
        if (walk->subtree == walk->view->subtrees)
            return false;
        mni_block_subtree(walk->view, walk->subtree++, &top);
        walk->stack[walk->waiting++] =
            (struct mni_walk_node){top.node, {top.leaf_lo, top.leaf_hi, {0, 0, 0}}};
    }
    struct mni_walk_node next = walk->stack[--walk->waiting];
    *node = next.node;
    mni_block_node(walk->view, next.node, &next.at, out);
    walk_push(walk, &out->right, out->leaf_mid, next.at.leaf_hi, out->right_position);
    walk_push(walk, &out->left, next.at.leaf_lo, out->leaf_mid, next.at.position);
    return true;
}
