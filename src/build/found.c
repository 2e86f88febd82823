/* What going through a tree has found: counts, box, dive point, and whether it is all there.
 *
 * Hides: how it is known in a few words of memory that no order id came twice: their hashes add up
 * to what they must. (Who forges a file may forge that too; such a tree does no harm and verify
 * finds it.) Order: none; add every node, leaf and root; then check and shape. One thread a
 * struct. */
#include <math.h>
#include <string.h>

#include "plan.h"
#include "watch.h"

enum { SIMPLICES_AT_ONCE = 1024 }; /* which divides the 65,536 of a look */

void mni_found_none(mni_found *found) {
    memset(found, 0, sizeof *found);
    for (int i = 0; i < 3; i++) {
        found->box_min[i] = INFINITY;
        found->box_max[i] = -INFINITY;
    }
    found->top = MN_NONE;
    found->top_position[1] = -INFINITY;
}

void mni_found_leaf(mni_found *found, uint32_t leaf, const float position[3]) {
    for (int i = 0; i < 3; i++) {
        found->box_min[i] = position[i] < found->box_min[i] ? position[i] : found->box_min[i];
        found->box_max[i] = position[i] > found->box_max[i] ? position[i] : found->box_max[i];
    }
    if (position[1] > found->top_position[1] ||
        (position[1] == found->top_position[1] && leaf < found->top)) {
        found->top = leaf;
        memcpy(found->top_position, position, sizeof found->top_position);
    }
}

static uint64_t hash_of(uint64_t order) { /* splitmix64 */
    order += UINT64_C(0x9e3779b97f4a7c15);
    order = (order ^ order >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    order = (order ^ order >> 27) * UINT64_C(0x94d049bb133111eb);
    return order ^ order >> 31;
}

void mni_found_node(mni_found *found, uint32_t order, uint32_t depth) {
    found->nodes++;
    found->order_sum += hash_of(order);
    if (depth + 2 > found->depth_max) /* itself and a leaf below */
        found->depth_max = depth + 2;
}

void mni_found_add(mni_found *to, const mni_found *from) {
    to->nodes += from->nodes;
    to->triangles += from->triangles;
    to->hinges += from->hinges;
    to->order_sum += from->order_sum;
    to->depth_max = from->depth_max > to->depth_max ? from->depth_max : to->depth_max;
    if (from->top == MN_NONE)
        return;
    uint32_t top = from->top;
    mni_found_leaf(to, MN_NONE, from->box_min); /* of no leaf: whatever is as high is before it */
    mni_found_leaf(to, top, from->top_position);
    for (int i = 0; i < 3; i++)
        to->box_max[i] = from->box_max[i] > to->box_max[i] ? from->box_max[i] : to->box_max[i];
}

mn_code mni_found_check(const mni_found *found, const mn_tree *head, mn_status *st) {
    uint64_t sum = 0;
    for (uint32_t i = 0; i < head->inner; i++)
        sum += hash_of((uint64_t)head->leaves + i);
    if (found->nodes != head->inner || found->order_sum != sum)
        return mn_fail(st, MN_BAD_INPUT, "the tree's %u nodes do not have %u different order ids",
                       head->inner, head->inner);
    if (found->triangles != head->triangles || found->hinges != head->simplices - head->triangles)
        return mn_fail(st, MN_BAD_INPUT,
                       "the tree has %llu triangles and %llu hinges, promised were %u and %u",
                       (unsigned long long)found->triangles, (unsigned long long)found->hinges,
                       head->triangles, head->simplices - head->triangles);
    if (found->depth_max != head->depth_max)
        return mn_fail(st, MN_BAD_INPUT, "the tree is %u nodes deep, promised was %u",
                       found->depth_max, head->depth_max);
    for (int i = 0; i < 3; i++)
        if (head->grid_step > 0 && (double)found->box_max[i] - found->box_min[i] >
                                       MNI_GRID_STEPS_MAX * (double)head->grid_step)
            return mn_fail(st, MN_BAD_INPUT, "positions span more than %d steps of %g",
                           MNI_GRID_STEPS_MAX, head->grid_step);
    return MN_OK;
}

/* ---- the dive point -------------------------------------------------------------------------- */

/* Adds the normal of a triangle, as long as twice its area. */
static bool add_normal(mni_rows *rows, const uint32_t corner[3], double normal[3]) {
    mni_row row[3];
    double e[2][3];
    uint32_t ignored;
    for (int k = 0; k < 3; k++) /* read once more: what was checked may have changed since */
        if (corner[k] >= rows->source.rows || !mni_rows_get(rows, corner[k], &row[k], &ignored))
            return false;
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 3; i++)
            e[k][i] = (double)row[k + 1].position[i] - row[0].position[i];
    for (int i = 0; i < 3; i++)
        normal[i] += e[0][(i + 1) % 3] * e[1][(i + 2) % 3] - e[0][(i + 2) % 3] * e[1][(i + 1) % 3];
    return true;
}

static mn_code not_read(mni_rows *rows, mn_status *st) {
    mn_code code = mni_rows_trouble(rows, st);
    return code != MN_OK ? code : mn_fail(st, MN_FAILED, "the tree has changed while it was read");
}

/* Of all triangles at the highest vertex. */
static mn_code add_normals(mni_rows *rows, uint32_t top, const mn_watch *watch, double normal[3],
                           mn_status *st) {
    mni_row_simplex room[SIMPLICES_AT_ONCE];
    for (uint32_t first = 0, all = rows->source.simplices; first < all;) {
        uint32_t count = all - first < SIMPLICES_AT_ONCE ? all - first : SIMPLICES_AT_ONCE;
        const mni_row_simplex *simplex = mni_rows_simplices(rows, first, count, room);
        if (simplex == NULL)
            return not_read(rows, st);
        if (mni_watch_each(watch, "dive point", first, all, st) != MN_OK)
            return st->code;
        for (uint32_t s = 0; s < count; s++) {
            const uint32_t *c = simplex[s].corner;
            if ((c[0] == top || c[1] == top || c[2] == top) && c[2] != MN_NONE &&
                !add_normal(rows, c, normal))
                return not_read(rows, st);
        }
        first += count;
    }
    return MN_OK;
}

mn_code mni_found_shape(const mni_found *found, mni_rows *rows, const mn_watch *watch, mn_header *h,
                        mn_status *st) {
    double normal[3] = {0, 0, 0};
    mn_code code = add_normals(rows, found->top, watch, normal, st);
    if (code != MN_OK)
        return code;
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    memcpy(h->box_min, found->box_min, sizeof h->box_min);
    memcpy(h->box_max, found->box_max, sizeof h->box_max);
    memcpy(h->dive_point, found->top_position, sizeof h->dive_point);
    for (int i = 0; i < 3; i++)
        h->dive_normal[i] = length > 0 && isfinite(length) ? (float)(normal[i] / length) : i == 1;
    return MN_OK;
}
