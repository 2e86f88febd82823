/* What makes a row safe, and what makes it right.
 *
 * Hides: which of the equations of a tree (mn_tree_check has them for trees in memory) are asked
 * before a node is looked at at all, for it may be looked at often, and which once. Order: safe
 * first. Any thread. */
#include "row_check.h"

#include <math.h>

mni_row_limits mni_row_limits_of(const mn_tree *head, bool has_colors) {
    return (mni_row_limits){head->leaves, head->leaves + head->inner, head->simplices,
                            head->grid_step, has_colors};
}

/* Where a child must be whose leaves are [lo, hi). */
static bool child_ok(uint32_t child, uint32_t lo, uint32_t hi) {
    return hi - lo == 1 ? child == MN_NONE : child > lo && child < hi;
}

mn_code mni_row_safe(const mni_row_limits *limits, uint32_t at, const mni_row *row,
                     uint32_t simplex_end, const mni_place *place, uint32_t order_below,
                     mn_status *st) {
    if (row->leaf_lo != place->leaf_lo || row->leaf_hi != place->leaf_hi || at <= row->leaf_lo ||
        at >= row->leaf_hi)
        return mn_fail(st, MN_BAD_INPUT,
                       "row %u: leaves [%u, %u) of a node, where its parent has [%u, %u)", at,
                       row->leaf_lo, row->leaf_hi, place->leaf_lo, place->leaf_hi);
    if (row->order < limits->leaves || row->order >= order_below)
        return mn_fail(st, MN_BAD_INPUT, "row %u: order id %u is not in [%u, %u)", at, row->order,
                       limits->leaves, order_below);
    if (!child_ok(row->left, row->leaf_lo, at) || !child_ok(row->right, at, row->leaf_hi))
        return mn_fail(st, MN_BAD_INPUT, "row %u: node %u cannot have its children in rows %u, %u",
                       at, row->order, row->left, row->right);
    if (row->simplex_start > simplex_end || simplex_end > limits->simplices)
        return mn_fail(st, MN_BAD_INPUT, "row %u: simplices [%u, %u) of %u", at, row->simplex_start,
                       simplex_end, limits->simplices);
    for (int i = 0; i < 3; i++)
        if (!(fabs((double)row->position[i] - place->position[i]) <=
              (limits->grid_step > 0 ? MNI_GRID_STEPS_MAX * (double)limits->grid_step : INFINITY)))
            return mn_fail(st, MN_BAD_INPUT, "row %u: leaf at %g, its node at %g: too far off", at,
                           row->position[i], place->position[i]);
    return MN_OK;
}

static bool bound_ok(float value) {
    return isfinite(value) && !signbit(value);
}

static mn_code check_leaf(const mni_row_limits *limits, uint32_t leaf, const mni_row *row,
                          mn_status *st) {
    double step = limits->grid_step;
    const float *position = row->position;
    for (int i = 0; i < 3; i++) /* there is one zero: blocks hold differences */
        if (!isfinite(position[i]) ||
            (step > 0 && (rint(position[i] / step) * step != position[i] ||
                          (position[i] == 0 && signbit(position[i])))))
            return mn_fail(st, MN_BAD_INPUT, "leaf %u: %.9g is not on the grid of steps of %g",
                           leaf, position[i], step);
    if (row->zero != 0 || (!limits->has_colors && row->rgba != UINT32_MAX))
        return mn_fail(st, MN_BAD_INPUT, "row %u: what is not there is not left empty", leaf);
    return MN_OK;
}

mn_code mni_row_check_first(const mni_row_limits *limits, uint32_t at, const mni_row *row,
                            uint32_t simplex_end, mn_status *st) {
    const mn_cone *cone = &row->cone;
    if (row->order != 0 || row->leaf_lo != 0 || row->leaf_hi != 0 || row->left != MN_NONE ||
        row->right != MN_NONE || row->switch_value != 0 || row->radius != 0 ||
        signbit(row->switch_value) || signbit(row->radius) || cone->axis[0] != 0 ||
        cone->axis[1] != 0 || cone->angle != 0)
        return mn_fail(st, MN_BAD_INPUT, "row %u: a root begins there, and yet a node %u is", at,
                       row->order);
    if (row->simplex_start != simplex_end || (at == 0 && simplex_end != 0))
        return mn_fail(st, MN_BAD_INPUT, "row %u: simplices [%u, %u) without a node", at,
                       row->simplex_start, simplex_end);
    return check_leaf(limits, at, row, st);
}

/* From the node of its first two leaves up along the left side: a parent's row is where its left
 * child ends. */
mn_code mni_row_root_of(mni_rows *rows, const mni_row_limits *limits, uint32_t lo,
                        mni_row_root *root, mn_status *st) {
    *root = (mni_row_root){MN_NONE, lo, lo, lo + 1};
    while (root->leaf_hi < limits->leaves) {
        const uint32_t at = root->leaf_hi;
        mni_row row;
        uint32_t ignored;
        if (!mni_rows_get(rows, at, &row, &ignored))
            return mni_rows_trouble(rows, st);
        if (row.order == 0)
            break;
        if (row.leaf_lo != lo || row.leaf_hi <= at || row.leaf_hi > limits->leaves ||
            row.order >= limits->nodes)
            return mn_fail(st, MN_BAD_INPUT, "row %u: leaves [%u, %u) of node %u", at, row.leaf_lo,
                           row.leaf_hi, row.order);
        *root = (mni_row_root){at, row.order, lo, row.leaf_hi};
    }
    return MN_OK;
}

mn_code mni_row_check_values(const mni_row *row, mn_status *st) {
    if (!bound_ok(row->switch_value) || !bound_ok(row->radius) ||
        mni_switch_up(row->switch_value) != row->switch_value ||
        mni_radius_up(row->radius) != row->radius)
        return mn_fail(st, MN_BAD_INPUT,
                       "node %u: switch value %g or radius %g is none, or too exact", row->order,
                       row->switch_value, row->radius);
    return MN_OK;
}

static mn_code check_child(const mni_row *row, const float position[3], const mni_row *child,
                           const float child_position[3], mn_status *st) {
    const double cone_slack = 1e-6;
    mn_code code = child != NULL ? mni_row_check_values(child, st) : MN_OK;
    if (code != MN_OK)
        return code;
    if (child != NULL && !(child->switch_value <= row->switch_value))
        return mn_fail(st, MN_BAD_INPUT, "node %u: switch value %g below its child's %g",
                       row->order, row->switch_value, child->switch_value);
    if (child != NULL && !mni_cone_encloses(row->cone, child->cone, cone_slack))
        return mn_fail(st, MN_BAD_INPUT, "node %u: its cone does not hold that of child %u",
                       row->order, child->order);
    if (!mni_sphere_encloses(position, row->radius, child_position,
                             child != NULL ? child->radius : 0))
        return mn_fail(st, MN_BAD_INPUT, "node %u: its sphere (radius %g) does not hold a child's",
                       row->order, row->radius);
    return MN_OK;
}

mn_code mni_row_check(const mni_row_limits *limits, uint32_t at, const mni_row *row,
                      const float position[3], const mni_row *left, const mni_row *right,
                      mn_status *st) {
    mn_code code = check_leaf(limits, at, row, st);
    if (code == MN_OK)
        code = check_child(row, position, left, position, st);
    return code == MN_OK ? check_child(row, position, right, row->position, st) : code;
}

mn_code mni_row_check_simplex(const mni_row_limits *limits, uint32_t at, const mni_row *row,
                              const mni_row_simplex *simplex, mn_status *st) {
    const uint32_t *c = simplex->corner, lo = row->leaf_lo, size = row->leaf_hi - lo;
    bool first_left = c[0] < at, second_left = c[1] < at;
    if (c[0] - lo >= size || c[1] - lo >= size || first_left == second_left || c[2] - lo < size ||
        (c[2] >= limits->leaves && c[2] != MN_NONE))
        return mn_fail(st, MN_BAD_INPUT, "node %u: simplex (%u %u %u) is not killed there",
                       row->order, c[0], c[1], c[2]);
    return MN_OK;
}
