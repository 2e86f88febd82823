/* The checker: hostile bytes in, a view or one phrase out.
 *
 * Hides: how a whole block is checked in one pass without memory. Subtrees stand in preorder, so a
 * stack of what is still to come, at most one entry a level (MNI_BLOCK_DEPTH_MAX), carries each
 * node's interval and its parent's bounds. First the columns' places, then everything through the
 * decoder. Pure; any thread; the same checker before writing and after reading. Paper: none. */
#include "block_layout.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#include "frame.h"

/* A node that must come, and what is known of it from above. */
typedef struct expected {
    uint32_t node, lo, hi, depth;
    mni_facts parent;
    float parent_position[3], position[3];
} expected;

typedef struct checker {
    const mni_block *view;
    const mni_block_limits *limits;
    uint32_t refs;
    uint32_t next_node, next_exit, next_simplex;
    uint32_t waiting;
    expected stack[MNI_BLOCK_DEPTH_MAX + 2];
    char *why;
    uint32_t why_bytes;
} checker;

__attribute__((format(printf, 3, 4))) static bool fail(char *why, uint32_t why_bytes,
                                                       const char *format, ...) {
    if (why != NULL && why_bytes > 0) {
        va_list args;
        va_start(args, format);
        vsnprintf(why, why_bytes, format, args);
        va_end(args);
    }
    return false;
}
#define FAIL(c, ...) fail((c)->why, (c)->why_bytes, __VA_ARGS__)

bool mni_sphere_encloses(const float position[3], float radius, const float child_position[3],
                         float child_radius) {
    double square = 0;
    for (int i = 0; i < 3; i++) {
        double d = (double)position[i] - child_position[i];
        square += d * d;
    }
    return sqrt(square) + child_radius <= radius * (1 + 1e-5);
}

static bool finite3(const float p[3]) {
    return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
}

static bool bound_ok(float value) {
    return isfinite(value) && !signbit(value);
}

/* Corners of a simplex killed by a node [lo, mid, hi). */
static bool simplex_ok(const uint32_t corner[3], uint32_t lo, uint32_t mid, uint32_t hi,
                       uint32_t leaves) {
    uint32_t in_left = 0, in_right = 0, outside = 0;
    for (int i = 0; i < 3; i++) {
        if (corner[i] >= lo && corner[i] < hi)
            *(corner[i] < mid ? &in_left : &in_right) += 1;
        else if (corner[i] < leaves || (i == 2 && corner[i] == MN_NONE))
            outside++;
    }
    return in_left == 1 && in_right == 1 && outside == 1;
}

/* Do a node's facts nest in its parent's? */
static bool facts_ok(const checker *c, const mni_facts *facts, const float position[3],
                     const mni_facts *parent, const float parent_position[3]) {
    return facts->order >= c->limits->leaves && facts->order < c->limits->nodes &&
           facts->order < parent->order && bound_ok(facts->switch_value) &&
           facts->switch_value <= parent->switch_value && bound_ok(facts->radius) &&
           mni_sphere_encloses(parent_position, parent->radius, position, facts->radius);
}

static bool check_child(checker *c, const expected *from, const mni_node *node,
                        const mni_child *child, bool is_left) {
    uint32_t lo = is_left ? from->lo : node->leaf_mid;
    uint32_t hi = is_left ? node->leaf_mid : from->hi;
    if ((child->kind == MNI_CHILD_LEAF) != (hi - lo == 1))
        return FAIL(c, "node %u: a child of %u leaves is said to be %s", from->node, hi - lo,
                    hi - lo == 1 ? "inner" : "a leaf");
    const float *position = is_left ? from->position : node->right_position;
    if (child->kind == MNI_CHILD_SUBTREE) {
        c->next_exit++;
        if (child->ref >= c->refs)
            return FAIL(c, "node %u: child in reference %u of %u", from->node, child->ref, c->refs);
        if (!facts_ok(c, &child->facts, position, &node->facts, from->position))
            return FAIL(c, "node %u: what it says of its child %u does not nest", from->node,
                        child->facts.order);
    }
    if (child->kind == MNI_CHILD_INNER) {
        if (from->depth + 1 >= MNI_BLOCK_DEPTH_MAX)
            return FAIL(c, "node %u: deeper than %d levels", from->node, MNI_BLOCK_DEPTH_MAX);
        expected *to = &c->stack[c->waiting++];
        *to = (expected){child->node, lo, hi, from->depth + 1, node->facts, {0}, {0}};
        memcpy(to->parent_position, from->position, sizeof to->parent_position);
        memcpy(to->position, position, sizeof to->position);
    }
    return true;
}

static bool check_simplices(checker *c, const expected *from, const mni_node *node) {
    if (node->simplex_first != c->next_simplex ||
        node->simplex_count > c->view->simplices - c->next_simplex)
        return FAIL(c, "node %u: its simplices do not follow the last node's", from->node);
    for (uint32_t i = 0; i < node->simplex_count; i++) {
        uint32_t corner[3];
        mni_block_simplex(c->view, c->next_simplex++, corner);
        if (!simplex_ok(corner, from->lo, node->leaf_mid, from->hi, c->limits->leaves))
            return FAIL(c, "node %u: simplex %u (%u %u %u) is not killed there", from->node, i,
                        corner[0], corner[1], corner[2]);
    }
    return true;
}

static bool check_node(checker *c, const expected *from) {
    const mni_block *view = c->view;
    if (from->node != c->next_node || from->node >= view->nodes)
        return FAIL(c, "node %u is not where its parent says (%u)", c->next_node, from->node);
    c->next_node++;
    if (mni_column_get(&view->column[COL_KINDS], from->node) > 8 ||
        mni_column_get(&view->column[COL_EXIT], from->node) != c->next_exit)
        return FAIL(c, "node %u: children of no kind or in a wrong place", from->node);
    uint32_t kinds = mni_column_get(&view->column[COL_KINDS], from->node);
    uint32_t exits = (kinds / 3 == MNI_CHILD_SUBTREE) + (kinds % 3 == MNI_CHILD_SUBTREE);
    if (exits > view->exits - c->next_exit)
        return FAIL(c, "node %u: more exits than the head says", from->node);
    uint32_t below = view->nodes - from->node; /* a child's facts are read with the node */
    if ((kinds / 3 == MNI_CHILD_INNER && below < 2) ||
        (kinds % 3 == MNI_CHILD_INNER &&
         mni_column_get(&view->column[COL_RIGHT], from->node) >= below))
        return FAIL(c, "node %u: a child beyond the last node", from->node);
    mni_node node;
    mni_block_node(view, from->node, &node);
    if (!facts_ok(c, &node.facts, from->position, &from->parent, from->parent_position))
        return FAIL(c, "node %u: order id %u, switch value %g or radius %g does not nest",
                    from->node, node.facts.order, node.facts.switch_value, node.facts.radius);
    if (node.leaf_mid <= from->lo || node.leaf_mid >= from->hi)
        return FAIL(c, "node %u: leaf_mid %u outside (%u, %u)", from->node, node.leaf_mid, from->lo,
                    from->hi);
    if (!finite3(node.right_position) ||
        !mni_sphere_encloses(from->position, node.facts.radius, node.right_position, 0))
        return FAIL(c, "node %u: its sphere (radius %g) does not hold leaf %u", from->node,
                    node.facts.radius, node.leaf_mid);
    if (node.overflow_ref != MN_NONE && node.overflow_ref >= c->refs)
        return FAIL(c, "node %u: overflow in reference %u of %u", from->node, node.overflow_ref,
                    c->refs);
    return check_simplices(c, from, &node) &&
           /* the right one first: the left one, on top, comes next */
           check_child(c, from, &node, &node.right, false) &&
           check_child(c, from, &node, &node.left, true);
}

static bool check_subtree(checker *c, uint32_t index) {
    mni_subtree s;
    mni_block_subtree(c->view, index, &s);
    if (s.leaf_lo >= s.leaf_hi || s.leaf_hi > c->limits->leaves || s.leaf_hi - s.leaf_lo < 2)
        return FAIL(c, "subtree %u: leaves [%u, %u)", index, s.leaf_lo, s.leaf_hi);
    if (!finite3(s.position))
        return FAIL(c, "subtree %u: its position is not finite", index);
    expected top = {.node = s.node,
                    .lo = s.leaf_lo,
                    .hi = s.leaf_hi,
                    /* whether it nests is said by the parent's block, which repeats its facts */
                    .parent = {MN_NONE, INFINITY, INFINITY, {{0}, 0}}};
    memcpy(top.position, s.position, sizeof top.position);
    memcpy(top.parent_position, s.position, sizeof top.parent_position);
    c->waiting = 0;
    c->stack[c->waiting++] = top;
    while (c->waiting > 0) {
        expected from = c->stack[--c->waiting];
        if (!check_node(c, &from))
            return false;
    }
    return true;
}

static bool check_columns(mni_block *view, const uint8_t *payload, uint64_t room, uint64_t used,
                          bool has_colors, char *why, uint32_t why_bytes) {
    if (room < MNI_HEAD_BYTES + MNI_BLOCK_TAIL_BYTES)
        return fail(why, why_bytes, "no room for a block's head");
    for (uint32_t i = 0; i < COL_END; i++)
        if (payload[MNI_HEAD_WIDTH + i] > 32)
            return fail(why, why_bytes, "column %u is %u bits wide", i,
                        payload[MNI_HEAD_WIDTH + i]);
    uint32_t flags[2];
    memcpy(flags, payload + 16, sizeof flags);
    if (flags[0] != (has_colors ? MNI_FLAG_COLORS : 0) || flags[1] != 0)
        return fail(why, why_bytes, "flags %x", flags[0]);
    uint64_t end = mni_block_layout(view, payload);
    if (view->nodes == 0 || view->nodes > MNI_BLOCK_NODES_MAX || view->subtrees == 0 ||
        view->subtrees > view->nodes || view->exits > view->nodes + view->subtrees ||
        view->exits > MNI_BLOCK_EXITS_MAX ||
        view->simplices > 8 * room) /* distinct ones take a bit each: bounds the work */
        return fail(why, why_bytes, "%u nodes, %u subtrees, %u exits, %u simplices", view->nodes,
                    view->subtrees, view->exits, view->simplices);
    if (end != used || end + MNI_BLOCK_TAIL_BYTES > room)
        return fail(why, why_bytes, "columns end at %llu, the payload at %llu of %llu",
                    (unsigned long long)end, (unsigned long long)used, (unsigned long long)room);
    return true;
}

/* The payload's place in a block of that length, from its frame. */
static bool payload_of(const void *bytes, uint32_t length_bytes, mni_frame *frame,
                       const uint8_t **payload, uint64_t *room, uint64_t *used) {
    mni_frame_get(bytes, frame);
    uint64_t at = MNI_FRAME_BYTES + 8ull * frame->refs;
    if (at > frame->payload_bytes || frame->payload_bytes > length_bytes)
        return false;
    *payload = (const uint8_t *)bytes + at;
    *room = length_bytes - at;
    *used = frame->payload_bytes - at;
    return true;
}

bool mni_block_open(mni_block *view, const void *bytes, uint32_t length_bytes,
                    const mni_block_limits *limits, char *why, uint32_t why_bytes) {
    mni_frame frame;
    const uint8_t *payload;
    uint64_t room, used;
    if (!payload_of(bytes, length_bytes, &frame, &payload, &room, &used))
        return fail(why, why_bytes, "payload outside the block");
    if (frame.kind != MNI_FRAME_METANODE)
        return fail(why, why_bytes, "not a meta-node (kind %u)", frame.kind);
    if (!check_columns(view, payload, room, used, limits->has_colors, why, why_bytes))
        return false;
    checker c = {
        .view = view, .limits = limits, .refs = frame.refs, .why = why, .why_bytes = why_bytes};
    for (uint32_t i = 0; i < view->subtrees; i++)
        if (!check_subtree(&c, i))
            return false;
    if (c.next_node != view->nodes || c.next_exit != view->exits ||
        c.next_simplex != view->simplices ||
        mni_column_get(&view->column[COL_SIMPLEX_FIRST], view->nodes) != view->simplices)
        return fail(why, why_bytes, "%u nodes, %u exits, %u simplices where the head says more",
                    c.next_node, c.next_exit, c.next_simplex);
    return true;
}

bool mni_overflow_open(mni_overflow *view, const void *bytes, uint32_t length_bytes,
                       const mni_block_limits *limits, char *why, uint32_t why_bytes) {
    mni_frame frame;
    const uint8_t *payload;
    uint64_t room, used;
    if (!payload_of(bytes, length_bytes, &frame, &payload, &room, &used) ||
        room < MNI_OVERFLOW_HEAD_BYTES + MNI_BLOCK_TAIL_BYTES)
        return fail(why, why_bytes, "payload outside the block");
    if (frame.kind != MNI_FRAME_OVERFLOW || frame.refs > 1)
        return fail(why, why_bytes, "not an overflow block (kind %u, %u references)", frame.kind,
                    frame.refs);
    memcpy(&view->order, payload, 4);
    memcpy(&view->leaf_lo, payload + 4, 4);
    memcpy(&view->leaf_mid, payload + 8, 4);
    memcpy(&view->leaf_hi, payload + 12, 4);
    memcpy(&view->simplices, payload + 16, 4);
    if (view->order < limits->leaves || view->order >= limits->nodes ||
        view->leaf_lo >= view->leaf_mid || view->leaf_mid >= view->leaf_hi ||
        view->leaf_hi > limits->leaves || view->simplices == 0 || view->simplices > 8 * room)
        return fail(why, why_bytes, "overflow of node %u, leaves [%u, %u, %u), %u simplices",
                    view->order, view->leaf_lo, view->leaf_mid, view->leaf_hi, view->simplices);
    uint64_t at = MNI_OVERFLOW_HEAD_BYTES;
    for (uint32_t i = 0; i < 3; i++) {
        uint32_t width = payload[32 + i];
        if (width > 32)
            return fail(why, why_bytes, "column %u is %u bits wide", i, width);
        view->column[i].width = width;
        memcpy(&view->column[i].base, payload + 20 + 4 * i, 4);
        view->column[i].bits = payload + at;
        at += mni_column_bytes(view->simplices, width);
    }
    if (at != used || at + MNI_BLOCK_TAIL_BYTES > room)
        return fail(why, why_bytes, "columns end at %llu, the payload at %llu of %llu",
                    (unsigned long long)at, (unsigned long long)used, (unsigned long long)room);
    for (uint32_t i = 0; i < view->simplices; i++) {
        uint32_t corner[3];
        mni_overflow_simplex(view, i, corner);
        if (!simplex_ok(corner, view->leaf_lo, view->leaf_mid, view->leaf_hi, limits->leaves))
            return fail(why, why_bytes, "overflow simplex %u (%u %u %u) is not killed there", i,
                        corner[0], corner[1], corner[2]);
    }
    return true;
}
