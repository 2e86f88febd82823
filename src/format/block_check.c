/* The checker: hostile bytes in, a view or one phrase out.
 *
 * Hides: how a whole block is checked in one pass without memory. Subtrees stand in preorder, so a
 * stack of what is still to come, at most one entry a level (MNI_BLOCK_DEPTH_MAX), carries each
 * node's interval and its parent's bounds. First the rows' places, then everything through the
 * decoder. Positions are not in a block, only differences of them; spheres need no more. Pure; any
 * thread; the same checker before writing and after reading. Paper: none. */
#include "block_layout.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#include "frame.h"

/* A node that must come, and what is known of it from above. */
typedef struct expected {
    uint32_t node, lo, hi, depth;
    mni_facts parent; /* but for its cone */
    double reach;     /* from the parent's position to this node's */
} expected;

typedef struct checker {
    const mni_block *view;
    const mni_block_limits *limits;
    uint32_t refs;
    uint32_t next_node, next_exit, next_more, next_far;
    char *why;
    uint32_t why_bytes;
    uint32_t waiting; /* right children on the stack; the left one is next */
    expected stack[MNI_BLOCK_DEPTH_MAX + 2];
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

/* A sphere, and another within it at that distance; up to float rounding. */
static bool sphere_holds(float radius, double distance, float child_radius) {
    return distance + child_radius <= radius * (1 + 1e-5);
}

bool mni_sphere_encloses(const float position[3], float radius, const float child_position[3],
                         float child_radius) {
    double square = 0;
    for (int i = 0; i < 3; i++) {
        double d = (double)position[i] - child_position[i];
        square += d * d;
    }
    return sphere_holds(radius, sqrt(square), child_radius);
}

/* Finite, not negative, and not above one that is neither negative: then floats compare as their
 * bits do. */
static bool bound_ok(float value, float above) {
    uint32_t bits = mni_float_bits(value);
    int finite = bits < mni_float_bits(INFINITY), below = bits <= mni_float_bits(above);
    return finite & below;
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

/* Do a node's facts nest in its parent's? Whoever is sound fails nowhere: so one question. */
static inline bool facts_ok(const checker *c, const mni_facts *facts, const mni_facts *parent,
                            double reach) {
    int is_inner = facts->order - c->limits->leaves < c->limits->nodes - c->limits->leaves;
    int falls = facts->order < parent->order;
    int switches = bound_ok(facts->switch_value, parent->switch_value);
    int bounded = bound_ok(facts->radius, parent->radius);
    int held = sphere_holds(parent->radius, reach, facts->radius);
    return is_inner & falls & switches & bounded & held;
}

/* Simplices of a node: a corner in each child, the third outside, far rows in their turn. Corners
 * are numbers that count from the ends of intervals, so all is said by how large these are; and on
 * which side, or whether far, nobody can guess. */
static bool check_simplices(checker *c, const expected *from, uint32_t mid, const mni_row *row,
                            uint32_t count) {
    const mni_block *view = c->view;
    for (uint32_t i = 0; i < count; i++) {
        mni_simplex_row simplex;
        if (i < MNI_INLINE)
            simplex = row->simplex[i];
        else
            mni_block_more_row(view, row->more + i - MNI_INLINE, &simplex);
        uint32_t is_far = simplex.third >= view->near, third = simplex.third;
        uint32_t far = mni_block_far(view, c->next_far);
        third ^= (third ^ far) & (0 - is_far);
        if (is_far & ((simplex.third - view->near != c->next_far) | (c->next_far == view->far)))
            return FAIL(c, "node %u: simplex %u: its third corner is in no far row", from->node, i);
        c->next_far += is_far;
        uint32_t below = from->lo, above = c->limits->leaves - from->hi;
        uint32_t room = below ^ ((below ^ above) & (0 - (third & 1)));
        if ((simplex.a >= mid - from->lo) | (simplex.b >= from->hi - mid) | (third >> 1 > room))
            return FAIL(c, "node %u: simplex %u (%u %u %u) is not killed there", from->node, i,
                        from->lo + simplex.a, mid + simplex.b,
                        mni_third_of(third, from->lo, from->hi));
    }
    return true;
}

/* What must be right before anything that the row leads to may be read; *count: its simplices. */
static bool check_row(checker *c, const expected *from, const mni_row *row, uint32_t *count) {
    const mni_block *view = c->view;
    uint32_t node = from->node, below = view->nodes - node, leaves = from->hi - from->lo;
    uint32_t left = row->left + 1, distance = view->exits > 0 ? row->right : left;
    if (left == 0 || left >= leaves)
        return FAIL(c, "node %u: %u of %u leaves on its left", node, left, leaves);
    if (row->exit != c->next_exit ||
        (row->exits & 1) + (row->exits >> 1) > view->exits - c->next_exit)
        return FAIL(c, "node %u: exits in a wrong place", node);
    bool left_is_inner = (left > 1) & ~row->exits, right_is_inner = leaves - left > 1;
    right_is_inner &= ~row->exits >> 1;
    if ((left_is_inner & (below < 2)) | (right_is_inner & (distance - 1 >= below - 1)))
        return FAIL(c, "node %u: a child beyond the last node", node);
    uint32_t more_end = 0;
    if (view->has_rest)
        more_end = below > 1 ? mni_block_more_after(view, node) : view->more;
    if (row->lack > MNI_INLINE || row->more != c->next_more || more_end < row->more ||
        more_end > view->more || (row->lack > 0 && more_end > row->more))
        return FAIL(c, "node %u: its simplices do not follow the last node's", node);
    *count = MNI_INLINE - row->lack + (more_end - row->more);
    c->next_more = more_end;
    return true;
}

/* A child that is an exit. */
static bool check_exit(checker *c, uint32_t leaves, const mni_facts *parent, double reach) {
    mni_child child;
    mni_block_exit(c->view, c->next_exit++, &child);
    if (leaves == 1)
        return FAIL(c, "node %u: an exit to a leaf", c->next_node - 1);
    if (child.ref >= c->refs)
        return FAIL(c, "node %u: child in reference %u of %u", c->next_node - 1, child.ref,
                    c->refs);
    if (!facts_ok(c, &child.facts, parent, reach))
        return FAIL(c, "node %u: what it says of its child %u does not nest", c->next_node - 1,
                    child.facts.order);
    return true;
}

/* It is to come, if it is inner: whether it is nobody can guess. Field by field: it is read so. */
static inline void push(checker *c, expected to, bool is_inner) {
    expected *at = &c->stack[c->waiting];
    at->node = to.node;
    at->lo = to.lo;
    at->hi = to.hi;
    at->depth = to.depth;
    at->parent.order = to.parent.order;
    at->parent.switch_value = to.parent.switch_value;
    at->parent.radius = to.parent.radius;
    at->reach = to.reach;
    c->waiting += is_inner;
}

/* Both children: exits are checked, inner ones are to come, the left one first. */
static bool check_children(checker *c, const expected *from, uint32_t mid, const mni_row *row,
                           double reach) {
    uint32_t node = from->node, lo = from->lo, hi = from->hi, depth = from->depth + 1;
    uint32_t exits = row->exits, distance = c->view->exits > 0 ? row->right : mid - lo;
    if (exits != 0 && (((exits & 1) != 0 && !check_exit(c, mid - lo, &row->facts, 0)) ||
                       ((exits & 2) != 0 && !check_exit(c, hi - mid, &row->facts, reach))))
        return false;
    push(c, (expected){node + distance, mid, hi, depth, row->facts, reach},
         (hi - mid > 1) & ~exits >> 1);
    push(c, (expected){node + 1, lo, mid, depth, row->facts, 0}, (mid - lo > 1) & ~exits);
    return true;
}

static bool check_node(checker *c, const expected *from) {
    if (from->node != c->next_node || from->node >= c->view->nodes)
        return FAIL(c, "node %u is not where its parent says (%u)", c->next_node, from->node);
    if (from->depth >= MNI_BLOCK_DEPTH_MAX)
        return FAIL(c, "node %u: deeper than %d levels", from->node, MNI_BLOCK_DEPTH_MAX);
    mni_row row;
    uint32_t count = 0;
    mni_block_row(c->view, from->node, &row);
    if (!check_row(c, from, &row, &count))
        return false;
    c->next_node++;
    const uint32_t mid = from->lo + row.left + 1;
    const double far = MNI_GRID_STEPS_MAX * (double)c->view->step;
    const float *d = row.delta;
    double square = (double)d[0] * d[0] + (double)d[1] * d[1] + (double)d[2] * d[2];
    for (int i = 0; i < 3; i++)
        if (!(fabs((double)d[i]) <= far))
            return FAIL(c, "node %u: leaf %u is %g away", from->node, mid, (double)d[i]);
    if (!facts_ok(c, &row.facts, &from->parent, from->reach))
        return FAIL(c, "node %u: order id %u, switch value %g or radius %g does not nest",
                    from->node, row.facts.order, row.facts.switch_value, row.facts.radius);
    double reach = sqrt(square);
    if (!sphere_holds(row.facts.radius, reach, 0))
        return FAIL(c, "node %u: its sphere (radius %g) does not hold leaf %u", from->node,
                    row.facts.radius, mid);
    if (row.overflow > c->refs)
        return FAIL(c, "node %u: overflow in reference %u of %u", from->node, row.overflow - 1,
                    c->refs);
    return check_simplices(c, from, mid, &row, count) && check_children(c, from, mid, &row, reach);
}

static bool check_subtree(checker *c, uint32_t index) {
    mni_subtree s;
    mni_block_subtree(c->view, index, &s);
    if (s.leaf_lo >= s.leaf_hi || s.leaf_hi > c->limits->leaves || s.leaf_hi - s.leaf_lo < 2)
        return FAIL(c, "subtree %u: leaves [%u, %u)", index, s.leaf_lo, s.leaf_hi);
    /* whether it nests is said by the parent's block, which repeats its facts */
    c->waiting = 1;
    c->stack[0] = (expected){.node = s.node,
                             .lo = s.leaf_lo,
                             .hi = s.leaf_hi,
                             .parent = {MN_NONE, INFINITY, INFINITY, {{0}, 0}}};
    while (c->waiting > 0) {
        if (!check_node(c, &c->stack[--c->waiting]))
            return false;
    }
    return true;
}

/* The most bits that a field may have; 0 in edges that end a row. */
static const uint8_t width_max[FIELDS] = {
    [FIELD_ORDER] = 32,
    [FIELD_SWITCH] = 8 + MNI_SWITCH_MANTISSA,
    [FIELD_RADIUS] = 8 + MNI_RADIUS_MANTISSA,
    [FIELD_AXIS] = 8,
    [FIELD_AXIS + 1] = 8,
    [FIELD_ANGLE] = 8,
    [FIELD_LEFT] = 32,
    [FIELD_DELTA] = 26,
    [FIELD_DELTA + 1] = 26,
    [FIELD_DELTA + 2] = 26,
    [FIELD_COLOR] = 8,
    [FIELD_COLOR + 1] = 8,
    [FIELD_COLOR + 2] = 8,
    [FIELD_COLOR + 3] = 8,
    [FIELD_EXITS] = 2,
    [FIELD_RIGHT] = 16,
    [FIELD_EXIT] = 17,
    [FIELD_OVERFLOW] = 32,
    [FIELD_LACK] = 2,
    [FIELD_MORE] = 32,
    [FIELD_TURN] = 1,
    [FIELD_A] = 32,
    [FIELD_B] = 32,
    [FIELD_THIRD] = 32,
    [FIELD_REF] = 32,
    [FIELD_SUBTREE] = 32,
    [FIELD_NODE] = 32,
    [FIELD_LO] = 32,
    [FIELD_SIZE] = 32,
};

static bool edges_ok(const uint8_t *edge, uint32_t first, uint32_t last, char *why,
                     uint32_t why_bytes) {
    for (uint32_t f = first; f < last; f++) {
        uint32_t from = mni_edge(edge, f - first), to = mni_edge(edge, f + 1 - first);
        if (to < from || to - from > width_max[f] || (f == FIELD_TURN && to != 1))
            return fail(why, why_bytes, "field %u stands in bits [%u, %u)", f, from, to);
    }
    return true;
}

static bool check_head(const uint8_t *payload, const mni_block_limits *limits, char *why,
                       uint32_t why_bytes) {
    static const uint32_t row[][2] = {{FIELD_ORDER, FIELD_NODE_END},
                                      {FIELD_TURN, FIELD_SIMPLEX_END},
                                      {FIELD_REF, FIELD_EXIT_END},
                                      {FIELD_NODE, FIELD_SUBTREE_END}};
    /* the most that bases of facts may be, after the order id's */
    static const uint32_t base_max[] = {(1u << (8 + MNI_SWITCH_MANTISSA)) - 1,
                                        (1u << (8 + MNI_RADIUS_MANTISSA)) - 1, 255, 255, 255};
    const uint8_t *edge = payload + MNI_HEAD_EDGE;
    uint32_t flags;
    float step;
    memcpy(&flags, payload + 16, sizeof flags);
    memcpy(&step, payload + MNI_HEAD_STEP, sizeof step);
    uint32_t colors = limits->has_colors ? MNI_FLAG_COLORS : 0;
    if ((flags & 255) != colors || (flags >> 8 & 255) > 31 || flags >> 16 > 32)
        return fail(why, why_bytes, "flags %x", flags);
    if (!(step == limits->grid_step))
        return fail(why, why_bytes, "a grid of %g, the file's is %g", step, limits->grid_step);
    for (uint32_t i = BASE_SWITCH; i < BASE_DELTA; i++)
        if (mni_base(payload + MNI_HEAD_BASE, i) > base_max[i - BASE_SWITCH])
            return fail(why, why_bytes, "values of field %u count from %u", i,
                        mni_base(payload + MNI_HEAD_BASE, i));
    for (uint32_t i = 0; i < 4; i++) {
        uint32_t first = row[i][0] == FIELD_REF ? mni_edge(edge, FIELD_LEFT) : 0;
        if (mni_edge(edge, row[i][0]) != first)
            return fail(why, why_bytes, "rows of kind %u begin at bit %u", i,
                        mni_edge(edge, row[i][0]));
        if (!edges_ok(edge + 2 * (size_t)row[i][0], row[i][0], row[i][1], why, why_bytes))
            return false;
    }
    return true;
}

static bool check_layout(mni_block *view, const uint8_t *payload, uint64_t room, uint64_t used,
                         const mni_block_limits *limits, char *why, uint32_t why_bytes) {
    if (room < MNI_HEAD_BYTES + MNI_BLOCK_TAIL_BYTES)
        return fail(why, why_bytes, "no room for a block's head");
    if (!check_head(payload, limits, why, why_bytes))
        return false;
    uint32_t count[4], far;
    memcpy(count, payload, sizeof count);
    memcpy(&far, payload + MNI_HEAD_FAR, sizeof far);
    /* before they are multiplied; distinct simplices take a bit each: bounds the work */
    if (count[0] == 0 || count[0] > MNI_BLOCK_NODES_MAX || count[1] == 0 || count[1] > count[0] ||
        count[2] > count[0] + count[1] || count[2] > MNI_BLOCK_EXITS_MAX || count[3] > 8 * room ||
        far > 8 * room)
        return fail(why, why_bytes, "%u nodes, %u subtrees, %u exits, %u more simplices", count[0],
                    count[1], count[2], count[3]);
    uint64_t end = mni_block_layout(view, payload);
    if (end != used || end + MNI_BLOCK_TAIL_BYTES > room)
        return fail(why, why_bytes, "rows end at %llu, the payload at %llu of %llu",
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
    if (!check_layout(view, payload, room, used, limits, why, why_bytes))
        return false;
    checker c; /* its stack need not be zero */
    c.view = view;
    c.limits = limits;
    c.refs = frame.refs;
    c.next_node = c.next_exit = c.next_more = c.next_far = 0;
    c.why = why;
    c.why_bytes = why_bytes;
    for (uint32_t i = 0; i < view->subtrees; i++)
        if (!check_subtree(&c, i))
            return false;
    if (c.next_node != view->nodes || c.next_exit != view->exits || c.next_more != view->more ||
        c.next_far != view->far)
        return fail(why, why_bytes,
                    "%u nodes, %u exits, %u more simplices, %u far where the head says more",
                    c.next_node, c.next_exit, c.next_more, c.next_far);
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
    view->edge = payload + MNI_OVERFLOW_EDGE;
    view->rows = payload + MNI_OVERFLOW_HEAD_BYTES;
    if (mni_edge(view->edge, 0) != 0 ||
        !edges_ok(view->edge, FIELD_TURN, FIELD_SIMPLEX_END, why, why_bytes))
        return fail(why, why_bytes, "rows of simplices with wrong edges");
    uint64_t end =
        MNI_OVERFLOW_HEAD_BYTES +
        mni_row_bytes(view->simplices, mni_edge(view->edge, FIELD_SIMPLEX_END - FIELD_TURN));
    if (end != used || end + MNI_BLOCK_TAIL_BYTES > room)
        return fail(why, why_bytes, "rows end at %llu, the payload at %llu of %llu",
                    (unsigned long long)end, (unsigned long long)used, (unsigned long long)room);
    for (uint32_t i = 0; i < view->simplices; i++) {
        uint32_t corner[3];
        mni_overflow_simplex(view, i, corner);
        if (!simplex_ok(corner, view->leaf_lo, view->leaf_mid, view->leaf_hi, limits->leaves))
            return fail(why, why_bytes, "overflow simplex %u (%u %u %u) is not killed there", i,
                        corner[0], corner[1], corner[2]);
    }
    return true;
}
