/* The view-dependence tree in memory: making, checking, freeing.
 *
 * Hides: what makes a tree sound. mn_tree_check is asked before anything is written and after
 * anything is read. One thread a tree; memory: the tree's arrays, freed by mn_tree_free.
 * Paper: §2.2 and §3.1. */
#include "tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "block.h"

static void *zeroed(size_t count, size_t size) {
    return calloc(count > 0 ? count : 1, size);
}

mn_code mni_tree_alloc(mn_tree *t, uint32_t leaves, uint32_t roots, uint32_t simplices,
                       bool has_colors, mn_status *st) {
    memset(t, 0, sizeof *t);
    t->leaves = leaves;
    t->roots = roots;
    t->inner = leaves - roots;
    t->simplices = simplices;
    size_t inner = t->inner;
    t->leaf_position = zeroed(3 * (size_t)leaves, sizeof(float));
    t->leaf_color = has_colors ? zeroed(leaves, sizeof(uint32_t)) : NULL;
    t->left = zeroed(inner, sizeof(uint32_t));
    t->right = zeroed(inner, sizeof(uint32_t));
    t->leaf_lo = zeroed(inner, sizeof(uint32_t));
    t->leaf_mid = zeroed(inner, sizeof(uint32_t));
    t->leaf_hi = zeroed(inner, sizeof(uint32_t));
    t->switch_value = zeroed(inner, sizeof(float));
    t->radius = zeroed(inner, sizeof(float));
    t->cone = zeroed(inner, sizeof(mn_cone));
    t->root = zeroed(roots, sizeof(uint32_t));
    t->simplex_start = zeroed(inner + 1, sizeof(uint32_t));
    t->corner = zeroed(3 * (size_t)simplices, sizeof(uint32_t));
    if (t->leaf_position != NULL && (!has_colors || t->leaf_color != NULL) && t->left != NULL &&
        t->right != NULL && t->leaf_lo != NULL && t->leaf_mid != NULL && t->leaf_hi != NULL &&
        t->switch_value != NULL && t->radius != NULL && t->cone != NULL && t->root != NULL &&
        t->simplex_start != NULL && t->corner != NULL)
        return MN_OK;
    mn_tree_free(t);
    return mn_fail(st, MN_FAILED, "no memory for a tree of %u vertices", leaves);
}

void mn_tree_free(mn_tree *t) {
    free(t->leaf_position);
    free(t->leaf_color);
    free(t->left);
    free(t->right);
    free(t->leaf_lo);
    free(t->leaf_mid);
    free(t->leaf_hi);
    free(t->switch_value);
    free(t->radius);
    free(t->cone);
    free(t->root);
    free(t->simplex_start);
    free(t->corner);
    memset(t, 0, sizeof *t);
}

/* ---- structure from children ---------------------------------------------------------------- */

/* Interval of any node by order id. */
static void interval(const mn_tree *t, uint32_t order, uint32_t *lo, uint32_t *hi) {
    bool leaf = order < t->leaves;
    *lo = leaf ? order : t->leaf_lo[order - t->leaves];
    *hi = leaf ? order + 1 : t->leaf_hi[order - t->leaves];
}

static mn_code derive_depth(mn_tree *t, mn_status *st) {
    uint32_t *depth = zeroed(t->inner, sizeof *depth); /* levels below, the node included */
    if (depth == NULL)
        return mn_fail(st, MN_FAILED, "no memory for the depths of %u nodes", t->inner);
    t->depth_max = 1;
    for (uint32_t i = 0; i < t->inner; i++) {
        uint32_t l = t->left[i] < t->leaves ? 1 : depth[t->left[i] - t->leaves];
        uint32_t r = t->right[i] < t->leaves ? 1 : depth[t->right[i] - t->leaves];
        depth[i] = (l > r ? l : r) + 1;
        t->depth_max = depth[i] > t->depth_max ? depth[i] : t->depth_max;
    }
    free(depth);
    return MN_OK;
}

mn_code mni_tree_derive(mn_tree *t, mn_status *st) {
    uint32_t nodes = t->leaves + t->inner, roots = 0;
    unsigned char *has_parent = zeroed(nodes, 1);
    if (has_parent == NULL)
        return mn_fail(st, MN_FAILED, "no memory to check %u nodes", nodes);
    mn_code code = MN_OK;
    for (uint32_t i = 0; i < t->inner && code == MN_OK; i++) {
        uint32_t l = t->left[i], r = t->right[i], lo, mid, from, hi;
        if (l >= t->leaves + i || r >= t->leaves + i || l == r || has_parent[l] || has_parent[r]) {
            code = mn_fail(st, MN_BAD_INPUT, "node %u: children %u and %u cannot be its own",
                           t->leaves + i, l, r);
            break;
        }
        has_parent[l] = has_parent[r] = 1;
        interval(t, l, &lo, &mid);
        interval(t, r, &from, &hi);
        if (mid != from)
            code = mn_fail(st, MN_BAD_INPUT,
                           "node %u: leaves [%u, %u) and [%u, %u) of its children do not meet",
                           t->leaves + i, lo, mid, from, hi);
        t->leaf_lo[i] = lo;
        t->leaf_mid[i] = mid;
        t->leaf_hi[i] = hi;
    }
    /* Roots by leaf_lo: a root's interval ends where the next one's begins, so all are found by
     * their lows; marks of the roots' places, then one sweep. */
    uint32_t *root_at = code == MN_OK ? malloc(sizeof *root_at * t->leaves) : NULL;
    if (code == MN_OK && root_at == NULL)
        code = mn_fail(st, MN_FAILED, "no memory to find the roots of %u vertices", t->leaves);
    if (code == MN_OK) {
        memset(root_at, 0xff, sizeof *root_at * t->leaves);
        for (uint32_t n = 0; n < nodes; n++) {
            uint32_t lo, hi;
            interval(t, n, &lo, &hi);
            if (!has_parent[n])
                root_at[lo] = n;
        }
        for (uint32_t v = 0; v < t->leaves; v++)
            if (root_at[v] != MN_NONE && roots < t->roots)
                t->root[roots++] = root_at[v];
        if (roots != t->roots)
            code = mn_fail(st, MN_BAD_INPUT, "%u roots where %u were promised", roots, t->roots);
    }
    free(root_at);
    free(has_parent);
    return code == MN_OK ? derive_depth(t, st) : code;
}

/* ---- the check ------------------------------------------------------------------------------ */

static const float *position_of(const mn_tree *t, uint32_t leaf) {
    return t->leaf_position + 3 * (size_t)leaf;
}

static mn_code check_bounds(const mn_tree *t, uint32_t i, uint32_t child, uint32_t child_lo,
                            mn_status *st) {
    float value = 0, radius = 0;
    const float cone_slack = 1e-6f;
    if (child >= t->leaves) {
        value = t->switch_value[child - t->leaves];
        radius = t->radius[child - t->leaves];
        if (!mni_cone_encloses(t->cone[i], t->cone[child - t->leaves], cone_slack))
            return mn_fail(st, MN_BAD_INPUT, "node %u: its cone does not hold that of child %u",
                           t->leaves + i, child);
    }
    if (mni_switch_up(t->switch_value[i]) != t->switch_value[i] ||
        mni_radius_up(t->radius[i]) != t->radius[i])
        return mn_fail(st, MN_BAD_INPUT, "node %u: switch value %g or radius %g is too exact",
                       t->leaves + i, t->switch_value[i], t->radius[i]);
    if (!isfinite(t->switch_value[i]) || signbit(t->switch_value[i]) || t->switch_value[i] < value)
        return mn_fail(st, MN_BAD_INPUT, "node %u: switch value %g below its child's %g",
                       t->leaves + i, t->switch_value[i], value);
    if (!isfinite(t->radius[i]) || signbit(t->radius[i]) ||
        !mni_sphere_encloses(position_of(t, t->leaf_lo[i]), t->radius[i], position_of(t, child_lo),
                             radius))
        return mn_fail(st, MN_BAD_INPUT, "node %u: its sphere (radius %g) does not hold child %u's",
                       t->leaves + i, t->radius[i], child);
    return MN_OK;
}

static mn_code check_node(const mn_tree *t, uint32_t i, mn_status *st) {
    uint32_t order = t->leaves + i, lo, mid, from, hi;
    if (t->left[i] >= order || t->right[i] >= order)
        return mn_fail(st, MN_BAD_INPUT, "node %u: children %u and %u do not come before it", order,
                       t->left[i], t->right[i]);
    interval(t, t->left[i], &lo, &mid);
    interval(t, t->right[i], &from, &hi);
    if (mid != from || lo != t->leaf_lo[i] || mid != t->leaf_mid[i] || hi != t->leaf_hi[i])
        return mn_fail(st, MN_BAD_INPUT,
                       "node %u: leaves [%u, %u, %u), its children's [%u, %u) and [%u, %u)", order,
                       t->leaf_lo[i], t->leaf_mid[i], t->leaf_hi[i], lo, mid, from, hi);
    mn_code code = check_bounds(t, i, t->left[i], lo, st);
    return code == MN_OK ? check_bounds(t, i, t->right[i], mid, st) : code;
}

static mn_code check_simplices(const mn_tree *t, uint32_t i, uint32_t *triangles, mn_status *st) {
    if (t->simplex_start[i] > t->simplex_start[i + 1] || t->simplex_start[i + 1] > t->simplices)
        return mn_fail(st, MN_BAD_INPUT, "node %u: its simplices end before they begin",
                       t->leaves + i);
    for (uint32_t s = t->simplex_start[i]; s < t->simplex_start[i + 1]; s++) {
        const uint32_t *c = t->corner + 3 * (size_t)s;
        uint32_t left = 0, right = 0, outside = 0;
        for (uint32_t k = 0; k < 3; k++) {
            left += c[k] >= t->leaf_lo[i] && c[k] < t->leaf_mid[i];
            right += c[k] >= t->leaf_mid[i] && c[k] < t->leaf_hi[i];
            outside += (c[k] < t->leaf_lo[i] || c[k] >= t->leaf_hi[i]) &&
                       (c[k] < t->leaves || (k == 2 && c[k] == MN_NONE));
        }
        if (left != 1 || right != 1 || outside != 1)
            return mn_fail(st, MN_BAD_INPUT, "node %u: simplex (%u %u %u) is not killed there",
                           t->leaves + i, c[0], c[1], c[2]);
        *triangles += c[2] != MN_NONE;
    }
    return MN_OK;
}

static mn_code check_positions(const mn_tree *t, mn_status *st) {
    float least[3] = {INFINITY, INFINITY, INFINITY}, most[3] = {-INFINITY, -INFINITY, -INFINITY};
    double step = t->grid_step;
    if (step != 0 && !mni_grid_ok(t->grid_step))
        return mn_fail(st, MN_BAD_INPUT, "a grid of steps of %g cannot be", step);
    for (size_t i = 0; i < 3 * (size_t)t->leaves; i++) {
        float at = t->leaf_position[i];
        if (!isfinite(at))
            return mn_fail(st, MN_BAD_INPUT, "leaf %zu: position is not finite", i / 3);
        if (step != 0 && rint(at / step) * step != at)
            return mn_fail(st, MN_BAD_INPUT, "leaf %zu: %.9g is not on the grid of steps of %g",
                           i / 3, at, step);
        least[i % 3] = at < least[i % 3] ? at : least[i % 3];
        most[i % 3] = at > most[i % 3] ? at : most[i % 3];
    }
    for (int i = 0; i < 3; i++)
        if (((double)most[i] - least[i]) > MNI_GRID_STEPS_MAX * step && step != 0)
            return mn_fail(st, MN_BAD_INPUT, "positions span more than %d steps of %g",
                           MNI_GRID_STEPS_MAX, step);
    return MN_OK;
}

mn_code mn_tree_check(const mn_tree *t, mn_status *st) {
    if (t->leaves == 0 || t->leaves > (1u << 31) || t->roots == 0 || t->roots > t->leaves ||
        t->inner != t->leaves - t->roots || t->triangles > t->simplices)
        return mn_fail(st, MN_BAD_INPUT, "a tree of %u leaves, %u inner nodes, %u roots cannot be",
                       t->leaves, t->inner, t->roots);
    mn_code code = check_positions(t, st);
    if (code != MN_OK)
        return code;
    if (t->legal_last < t->leaves - 1 || t->legal_last >= t->leaves + t->inner)
        return mn_fail(st, MN_BAD_INPUT, "legal_last %u outside [%u, %u)", t->legal_last,
                       t->leaves - 1, t->leaves + t->inner);
    uint32_t triangles = 0, next_leaf = 0;
    for (uint32_t i = 0; i < t->inner && code == MN_OK; i++) {
        code = check_node(t, i, st);
        if (code == MN_OK)
            code = check_simplices(t, i, &triangles, st);
    }
    for (uint32_t r = 0; r < t->roots && code == MN_OK; r++) {
        uint32_t lo = 0, hi = 0;
        if (t->root[r] < t->leaves + t->inner)
            interval(t, t->root[r], &lo, &hi);
        if (lo != next_leaf || hi <= lo)
            code = mn_fail(st, MN_BAD_INPUT, "root %u: its leaves do not begin at %u", t->root[r],
                           next_leaf);
        next_leaf = hi;
    }
    if (code == MN_OK && (next_leaf != t->leaves || t->simplex_start[0] != 0 ||
                          t->simplex_start[t->inner] != t->simplices || triangles != t->triangles))
        code = mn_fail(st, MN_BAD_INPUT, "roots hold %u of %u leaves; %u of %u triangles are there",
                       next_leaf, t->leaves, triangles, t->triangles);
    return code;
}

/* ---- bounds and the dive point --------------------------------------------------------------- */

void mni_tree_shape(const mn_tree *tree, mn_header *h) {
    uint32_t top = 0;
    for (int i = 0; i < 3; i++)
        h->box_min[i] = h->box_max[i] = tree->leaf_position[i];
    for (uint32_t v = 0; v < tree->leaves; v++) {
        const float *p = tree->leaf_position + 3 * (size_t)v;
        for (int i = 0; i < 3; i++) {
            h->box_min[i] = p[i] < h->box_min[i] ? p[i] : h->box_min[i];
            h->box_max[i] = p[i] > h->box_max[i] ? p[i] : h->box_max[i];
        }
        if (p[1] > tree->leaf_position[3 * (size_t)top + 1])
            top = v;
    }
    double normal[3] = {0, 0, 0};
    for (uint32_t s = 0; s < tree->simplices; s++) {
        const uint32_t *c = tree->corner + 3 * (size_t)s;
        if (c[2] == MN_NONE || (c[0] != top && c[1] != top && c[2] != top))
            continue;
        double e[2][3];
        for (int i = 0; i < 3; i++) {
            e[0][i] = (double)tree->leaf_position[3 * (size_t)c[1] + i] -
                      tree->leaf_position[3 * (size_t)c[0] + i];
            e[1][i] = (double)tree->leaf_position[3 * (size_t)c[2] + i] -
                      tree->leaf_position[3 * (size_t)c[0] + i];
        }
        for (int i = 0; i < 3; i++)
            normal[i] +=
                e[0][(i + 1) % 3] * e[1][(i + 2) % 3] - e[0][(i + 2) % 3] * e[1][(i + 1) % 3];
    }
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    memcpy(h->dive_point, tree->leaf_position + 3 * (size_t)top, sizeof h->dive_point);
    for (int i = 0; i < 3; i++)
        h->dive_normal[i] = length > 0 && isfinite(length) ? (float)(normal[i] / length) : i == 1;
}
