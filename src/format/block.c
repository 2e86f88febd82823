/* The decoder: indices in, values out.
 *
 * Hides: where rows and fields lie, bases, codes of floats, positions and corners. A view is made
 * by mni_block_open (block_check.c) or, of bytes that have passed it, mni_block_reopen; then the
 * getters, in any order, by any thread, while the bytes stay. No memory of its own. Indices must be
 * in range: the callers have them from the view's counts or from records that were checked.
 * Paper: §3.2 (meta-nodes). */
#include "block_layout.h"

#include "assert.h"
#include "frame.h"

mni_block_limits mni_block_limits_of(const mn_header *header) {
    return (mni_block_limits){.leaves = header->leaves,
                              .nodes = header->nodes,
                              .file_bytes = header->file_bytes,
                              .has_colors = header->has_colors,
                              .grid_step = header->grid_step};
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
    return (uint64_t)(view->more_rows - payload) + mni_row_bytes(view->more, view->simplex_bits);
}

void mni_block_reopen(mni_block *view, const void *bytes) {
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    mni_block_layout(view, (const uint8_t *)bytes + mni_frame_payload_at(frame.refs));
}

/* ---- fields --------------------------------------------------------------------------------- */

/* Field f of the row that begins at bit `row`, without its base. */
static inline uint32_t get(const uint8_t *edge, const uint8_t *rows, uint64_t row, uint32_t f) {
    uint32_t from_to;
    memcpy(&from_to, edge + 2 * (size_t)f, sizeof from_to);
    uint32_t from = from_to & 0xffff, to = from_to >> 16;
    return mni_bits_get(rows, row + from, to - from);
}

static inline uint32_t take(uint64_t *word, uint32_t width) {
    uint32_t value = (uint32_t)(*word & ((UINT64_C(1) << width) - 1));
    *word >>= width;
    return value;
}

/* All but the order id is read at once: 49 bits at most, the checker sees to that. */
static inline void get_facts(const mni_block *view, const uint8_t *rows, uint64_t row,
                             mni_facts *out) {
    uint16_t edge[FIELD_LEFT + 1];
    uint32_t base[BASE_DELTA];
    memcpy(edge, view->edge, sizeof edge);
    memcpy(base, view->base, sizeof base);
    uint64_t word = mni_bits_at(rows, row + edge[FIELD_SWITCH]);
    out->order = base[BASE_ORDER] + mni_bits_get(rows, row, edge[FIELD_SWITCH]);
    out->switch_value =
        mni_float_of((base[BASE_SWITCH] + take(&word, edge[FIELD_RADIUS] - edge[FIELD_SWITCH]))
                     << MNI_SWITCH_SHIFT);
    out->radius =
        mni_float_of((base[BASE_RADIUS] + take(&word, edge[FIELD_AXIS] - edge[FIELD_RADIUS]))
                     << MNI_RADIUS_SHIFT);
    uint32_t x = base[BASE_AXIS] + take(&word, edge[FIELD_AXIS + 1] - edge[FIELD_AXIS]);
    uint32_t y = base[BASE_AXIS + 1] + take(&word, edge[FIELD_ANGLE] - edge[FIELD_AXIS + 1]);
    uint32_t angle = base[BASE_ANGLE] + take(&word, edge[FIELD_LEFT] - edge[FIELD_ANGLE]);
    out->cone = (mn_cone){{(int8_t)(x - 128), (int8_t)(y - 128)}, (uint8_t)angle};
}

static uint32_t get_color(const mni_block *view, uint64_t row) {
    uint32_t color = 0;
    for (uint32_t i = 0; i < 4; i++)
        color |= ((mni_base(view->base, BASE_COLOR + i) +
                   get(view->edge, view->node_rows, row, FIELD_COLOR + i)) &
                  255)
                 << (8 * i);
    return color;
}

void mni_block_facts(const mni_block *view, uint32_t node, mni_facts *out) {
    MN_ASSERT(node < view->nodes);
    get_facts(view, view->node_rows, (uint64_t)node * view->node_bits, out);
}

static inline void get_exit(const mni_block *view, uint32_t exit, mni_child *out) {
    uint64_t row = (uint64_t)exit * view->exit_bits;
    out->kind = MNI_CHILD_SUBTREE;
    out->node = MN_NONE;
    out->exit = exit;
    out->ref = get(view->edge, view->exit_rows, row, FIELD_REF);
    out->subtree = get(view->edge, view->exit_rows, row, FIELD_SUBTREE);
    get_facts(view, view->exit_rows, row, &out->facts);
}

void mni_block_exit(const mni_block *view, uint32_t exit, mni_child *out) {
    MN_ASSERT(exit < view->exits);
    get_exit(view, exit, out);
}

static inline void get_child(const mni_block *view, mni_child_kind kind, uint32_t inner,
                             uint32_t exit, mni_child *out) {
    if (kind == MNI_CHILD_SUBTREE) {
        get_exit(view, exit, out);
        return;
    }
    *out = (mni_child){.kind = kind, .node = inner, .exit = MN_NONE, .ref = MN_NONE};
    if (kind == MNI_CHILD_INNER)
        get_facts(view, view->node_rows, (uint64_t)inner * view->node_bits, &out->facts);
}

void mni_block_node(const mni_block *view, uint32_t node, const mni_place *at, mni_node *out) {
    MN_ASSERT(node < view->nodes);
    const uint8_t *edge = view->edge, *rows = view->node_rows;
    const uint64_t row = (uint64_t)node * view->node_bits;
    out->at = *at;
    get_facts(view, rows, row, &out->facts);
    uint32_t left_leaves = 1 + get(edge, rows, row, FIELD_LEFT);
    out->leaf_mid = at->leaf_lo + left_leaves;
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t steps =
            mni_base(view->base, BASE_DELTA + i) + get(edge, rows, row, FIELD_DELTA + i);
        out->right_position[i] = at->position[i] + (float)(int32_t)(steps - MNI_BIAS) * view->step;
    }
    out->right_color = view->has_colors ? get_color(view, row) : UINT32_MAX;

    mni_child_kind left = left_leaves == 1 ? MNI_CHILD_LEAF : MNI_CHILD_INNER;
    mni_child_kind right = at->leaf_hi - out->leaf_mid == 1 ? MNI_CHILD_LEAF : MNI_CHILD_INNER;
    uint32_t distance = left_leaves, exit = 0; /* the left child's inner nodes are all between */
    if (view->exits > 0) {
        uint32_t exits = get(edge, rows, row, FIELD_EXITS);
        left = exits & 1 ? MNI_CHILD_SUBTREE : left;
        right = exits & 2 ? MNI_CHILD_SUBTREE : right;
        distance = get(edge, rows, row, FIELD_RIGHT);
        exit = get(edge, rows, row, FIELD_EXIT);
    }
    get_child(view, left, node + 1, exit, &out->left);
    get_child(view, right, node + distance, exit + (left == MNI_CHILD_SUBTREE), &out->right);

    out->row = node;
    out->simplex_count = MNI_INLINE - get(edge, rows, row, FIELD_LACK);
    if (view->more > 0) {
        out->more = get(edge, rows, row, FIELD_MORE);
        uint32_t end = node + 1 < view->nodes ? get(edge, rows, row + view->node_bits, FIELD_MORE)
                                              : view->more;
        out->simplex_count += end - out->more;
    }
    out->overflow_ref = get(edge, rows, row, FIELD_OVERFLOW) - 1;
}

void mni_block_subtree(const mni_block *view, uint32_t subtree, mni_subtree *out) {
    MN_ASSERT(subtree < view->subtrees);
    uint64_t row = (uint64_t)subtree * view->subtree_bits;
    out->node = get(view->edge, view->subtree_rows, row, FIELD_NODE);
    out->leaf_lo =
        mni_base(view->base, BASE_LO) + get(view->edge, view->subtree_rows, row, FIELD_LO);
    out->leaf_hi = out->leaf_lo + 2 + get(view->edge, view->subtree_rows, row, FIELD_SIZE);
}

bool mni_facts_equal(const mni_facts *a, const mni_facts *b) {
    return a->order == b->order && a->switch_value == b->switch_value && a->radius == b->radius &&
           a->cone.axis[0] == b->cone.axis[0] && a->cone.axis[1] == b->cone.axis[1] &&
           a->cone.angle == b->cone.angle;
}

/* ---- simplices ------------------------------------------------------------------------------ */

/* The simplex at bit `at`; edge: of FIELD_TURN. */
static inline void get_corners(const uint8_t *edge, const uint8_t *rows, uint64_t at,
                               uint32_t third_base, uint32_t lo, uint32_t mid, uint32_t corner[3]) {
    uint32_t turn = get(edge, rows, at, FIELD_TURN - FIELD_TURN);
    uint32_t third = third_base + get(edge, rows, at, FIELD_THIRD - FIELD_TURN);
    corner[turn] = lo + get(edge, rows, at, FIELD_A - FIELD_TURN);
    corner[1 - turn] = mid + get(edge, rows, at, FIELD_B - FIELD_TURN);
    corner[2] = third == MNI_BIAS ? MN_NONE : mid + (third - MNI_BIAS);
}

void mni_block_simplex(const mni_block *view, const mni_node *node, uint32_t i,
                       uint32_t corner[3]) {
    MN_ASSERT(i < node->simplex_count);
    const uint8_t *rows = view->node_rows;
    uint64_t at = (uint64_t)node->row * view->node_bits + mni_edge(view->edge, FIELD_NODE_END) +
                  (uint64_t)i * view->simplex_bits;
    if (i >= MNI_INLINE) {
        rows = view->more_rows;
        at = (uint64_t)(node->more + i - MNI_INLINE) * view->simplex_bits;
    }
    get_corners(view->edge + 2 * (size_t)FIELD_TURN, rows, at, mni_base(view->base, BASE_THIRD),
                node->at.leaf_lo, node->leaf_mid, corner);
}

void mni_overflow_simplex(const mni_overflow *view, uint32_t simplex, uint32_t corner[3]) {
    MN_ASSERT(simplex < view->simplices);
    uint64_t bits = mni_edge(view->edge, FIELD_SIMPLEX_END - FIELD_TURN);
    get_corners(view->edge, view->rows, simplex * bits, mni_base(view->base, 0), view->leaf_lo,
                view->leaf_mid, corner);
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
