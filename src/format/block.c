/* The decoder: indices in, values out.
 *
 * Hides: where columns lie, widths, bases, codes of floats and corners. A view is made by
 * mni_block_open (block_check.c) or, of bytes that have passed it, mni_block_reopen; then the
 * getters, in any order, by any thread, while the bytes stay. No memory of its own. Indices must be
 * in range: the callers have them from the view's counts or from records that were checked.
 * Paper: §3.2 (meta-nodes). */
#include "block_layout.h"

#include "assert.h"
#include "frame.h"

uint64_t mni_block_layout(mni_block *view, const uint8_t *payload) {
    uint32_t head[5];
    memcpy(head, payload, sizeof head);
    view->nodes = head[0];
    view->subtrees = head[1];
    view->exits = head[2];
    view->simplices = head[3];
    view->has_colors = (head[4] & MNI_FLAG_COLORS) != 0;
    uint64_t at = MNI_HEAD_BYTES;
    for (uint32_t c = 0; c < COL_END; c++) {
        mni_column *column = &view->column[c];
        column->width = payload[MNI_HEAD_WIDTH + c];
        memcpy(&column->base, payload + MNI_HEAD_BASE + 4 * c, sizeof column->base);
        column->bits = payload + at;
        at += mni_column_bytes(mni_column_rows(view, c), column->width);
    }
    return at;
}

void mni_block_reopen(mni_block *view, const void *bytes) {
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    mni_block_layout(view, (const uint8_t *)bytes + mni_frame_payload_at(frame.refs));
}

static uint32_t get(const mni_block *view, uint32_t column, uint32_t row) {
    return mni_column_get(&view->column[column], row);
}

static void get_position(const mni_block *view, uint32_t column, uint32_t row, float out[3]) {
    for (uint32_t i = 0; i < 3; i++)
        out[i] = mni_float_unordered(get(view, column + i, row));
}

static mn_cone get_cone(const mni_block *view, uint32_t column, uint32_t row) {
    return (mn_cone){
        {(int16_t)(get(view, column, row) - 32768), (int16_t)(get(view, column + 1, row) - 32768)},
        (uint16_t)get(view, column + 2, row)};
}

static uint32_t get_color(const mni_block *view, uint32_t column, uint32_t row) {
    if (!view->has_colors)
        return UINT32_MAX;
    uint32_t color = 0;
    for (uint32_t i = 0; i < 4; i++)
        color |= (get(view, column + i, row) & 255) << (8 * i);
    return color;
}

static void get_facts(const mni_block *view, uint32_t row, mni_facts *out) {
    out->order = get(view, COL_ORDER, row);
    out->switch_value = mni_float_of(get(view, COL_SWITCH, row));
    out->radius = mni_float_of(get(view, COL_RADIUS, row));
    out->cone = get_cone(view, COL_CONE, row);
}

void mni_block_exit(const mni_block *view, uint32_t exit, mni_child *out) {
    MN_ASSERT(exit < view->exits);
    out->kind = MNI_CHILD_SUBTREE;
    out->node = MN_NONE;
    out->exit = exit;
    out->ref = get(view, COL_EXIT_REF, exit);
    out->subtree = get(view, COL_EXIT_SUBTREE, exit);
    get_facts(view, view->nodes + exit, &out->facts);
}

static void get_child(const mni_block *view, mni_child_kind kind, uint32_t inner, uint32_t exit,
                      mni_child *out) {
    if (kind == MNI_CHILD_SUBTREE) {
        mni_block_exit(view, exit, out);
        return;
    }
    *out = (mni_child){.kind = kind, .node = inner, .exit = MN_NONE, .ref = MN_NONE};
    if (kind == MNI_CHILD_INNER)
        get_facts(view, inner, &out->facts);
}

void mni_block_node(const mni_block *view, uint32_t node, mni_node *out) {
    MN_ASSERT(node < view->nodes);
    get_facts(view, node, &out->facts);
    out->leaf_mid = get(view, COL_MID, node);
    get_position(view, COL_POSITION, node, out->right_position);
    out->right_color = get_color(view, COL_COLOR, node);
    uint32_t kinds = get(view, COL_KINDS, node), exit = get(view, COL_EXIT, node);
    mni_child_kind left = kinds / 3, right = kinds % 3;
    get_child(view, left, node + 1, exit, &out->left);
    get_child(view, right, node + get(view, COL_RIGHT, node), exit + (left == MNI_CHILD_SUBTREE),
              &out->right);
    out->simplex_first = get(view, COL_SIMPLEX_FIRST, node);
    out->simplex_count = get(view, COL_SIMPLEX_FIRST, node + 1) - out->simplex_first;
    out->overflow_ref = get(view, COL_OVERFLOW, node) - 1;
}

void mni_block_subtree(const mni_block *view, uint32_t subtree, mni_subtree *out) {
    MN_ASSERT(subtree < view->subtrees);
    out->node = get(view, COL_SUB_NODE, subtree);
    out->leaf_lo = get(view, COL_SUB_LO, subtree);
    out->leaf_hi = get(view, COL_SUB_HI, subtree);
    get_position(view, COL_SUB_POSITION, subtree, out->position);
    out->color = get_color(view, COL_SUB_COLOR, subtree);
}

bool mni_facts_equal(const mni_facts *a, const mni_facts *b) {
    return a->order == b->order && a->switch_value == b->switch_value && a->radius == b->radius &&
           a->cone.axis[0] == b->cone.axis[0] && a->cone.axis[1] == b->cone.axis[1] &&
           a->cone.angle == b->cone.angle;
}

/* Three columns from `column` on. */
static void get_corners(const mni_column *column, uint32_t row, uint32_t corner[3]) {
    corner[0] = mni_column_get(&column[0], row);
    corner[1] = corner[0] + (mni_column_get(&column[1], row) - MNI_BIAS);
    corner[2] = corner[0] + (mni_column_get(&column[2], row) - MNI_BIAS);
    if (corner[2] == corner[0])
        corner[2] = MN_NONE;
}

void mni_block_simplex(const mni_block *view, uint32_t simplex, uint32_t corner[3]) {
    MN_ASSERT(simplex < view->simplices);
    get_corners(&view->column[COL_CORNER], simplex, corner);
}

void mni_overflow_simplex(const mni_overflow *view, uint32_t simplex, uint32_t corner[3]) {
    MN_ASSERT(simplex < view->simplices);
    get_corners(view->column, simplex, corner);
}
