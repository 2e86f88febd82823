/* What can be asked of a navigator between frames: is it sound, and how far is it from what is
 * wanted? See navigate.h.
 *
 * Looks at the whole front, so it is called outside of what is timed. Navigate only; no memory.
 * Paper: none; design.md §6 (what is checked), §5 (error_px, front_over_wanted). */
#include <math.h>

#include "mn_assert.h"
#include "navigate.h"

static bool wants_soon(const mni_navigator *nav, const mni_bounds *node) {
    return nav->early && mni_lens_wants(&nav->ahead.soon.lens, node);
}

void mni_navigator_check(mni_navigator *nav) {
    mni_front *front = &nav->front;
    mni_front_check(front);
    mni_waiting_check(&nav->waiting);
    mni_barred_check(&nav->barred);
    for (uint32_t b = 0; b < front->slots_high; b++) {
        bool waiting = mni_waiting_has(&nav->waiting, b);
        if (!mni_front_is_fork(front, b)) {
            MN_ASSERT(!waiting);
            continue;
        }
        mni_bounds bounds = mni_front_branch_bounds(front, b);
        MN_ASSERT(!waiting || mni_front_collapse_blocker(front, b) != MN_NONE);
        if (nav->fork_due[b] > nav->clock)
            MN_ASSERT(wants_soon(nav, &bounds) || mni_lens_wants(&nav->lens, &bounds) != waiting);
    }
    for (uint32_t slot = 0; slot < front->slots_high; slot++) {
        mni_bounds bounds = mni_front_bounds(front, slot);
        const bool barred = mni_barred_has(&nav->barred, slot);
        if (mni_front_is_active(front, slot) && nav->slot_due[slot] > nav->clock)
            MN_ASSERT(mni_front_is_leaf(front, slot) ||
                      (barred
                           ? mni_lens_wants(&nav->lens, &bounds)
                           : !(wants_soon(nav, &bounds) || mni_lens_wants(&nav->lens, &bounds))));
        MN_ASSERT(!barred || (mni_front_is_active(front, slot) && !mni_front_is_leaf(front, slot) &&
                              nav->slot_due[slot] > nav->clock));
    }
}

/* ---- how near is what is drawn? -------------------------------------------------------------- */

static double lesser(double a, double b) {
    return a < b ? a : b;
}

static double greater(double a, double b) {
    return a > b ? a : b;
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* Squares of distances from the eye, which is at 0: of the line from a to b; of a triangle, which
 * is that of its plane where the eye is above it, and of an edge otherwise. */
static double to_edge(const double a[3], const double b[3]) {
    const double along[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double length = dot(along, along);
    double t = -dot(a, along);
    t = length > 0 ? lesser(greater(t / length, 0), 1) : 0;
    const double nearest[3] = {a[0] + t * along[0], a[1] + t * along[1], a[2] + t * along[2]};
    return dot(nearest, nearest);
}

static double to_triangle(double corner[3][3]) {
    double edge[3][3], normal[3], side[3], least = INFINITY;
    bool above = true;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++)
            edge[k][i] = corner[(k + 1) % 3][i] - corner[k][i];
    cross(edge[0], edge[1], normal);
    const double square = dot(normal, normal);
    for (int k = 0; k < 3; k++) {
        cross(corner[k], edge[k], side); /* the same turn as from the eye's foot point */
        above &= dot(side, normal) > 0;
        least = lesser(least, to_edge(corner[k], corner[(k + 1) % 3]));
    }
    const double height = dot(corner[0], normal);
    return above && square > 0 ? height * height / square : least;
}

/* From the eye to the nearest point of a triangle, or node: some have no triangle. */
static double nearest_drawn(const mni_navigator *nav) {
    const mni_front *f = &nav->front;
    const double *eye = nav->lens.eye;
    double least = INFINITY, corner[3][3];
    for (uint32_t slot = 0; slot < f->slots_high; slot++) {
        const float *p = &f->position[3 * (size_t)slot];
        const double to[3] = {p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]};
        if (mni_front_is_active(f, slot))
            least = lesser(least, dot(to, to));
    }
    for (uint32_t s = 0; s < f->simplices_high; s++) {
        const uint32_t *node = &f->simplex_node[3 * (size_t)s];
        if (node[0] == MN_NONE || node[2] == MN_NONE)
            continue;
        double box = 0;
        for (int i = 0; i < 3; i++) {
            for (int k = 0; k < 3; k++)
                corner[k][i] = f->position[3 * (size_t)node[k] + i] - eye[i];
            const double low = lesser(corner[0][i], lesser(corner[1][i], corner[2][i]));
            const double high = greater(corner[0][i], greater(corner[1][i], corner[2][i]));
            const double off = greater(greater(low, -high), 0);
            box += off * off;
        }
        if (box < least)
            least = lesser(least, to_triangle(corner));
    }
    return sqrt(least);
}

/* The switch value seen at the nearest point of the node's sphere, as what is wanted has it, and
 * the grid's error at the nearest point beneath it: no point of the input is nearer than what is
 * drawn less the switch value. The sphere of a node with wide triangles may hold the eye though all
 * of them are far from it: so of nodes that are wanted, and stand for want of a block or of room,
 * the switch value counts as near as that too. Nor is any nearer than the model's box. */
static double node_error_px(const mni_navigator *nav, const mni_bounds *node, double grid_px,
                            double drawn, double box) {
    const mni_lens *lens = &nav->lens;
    const double least = mni_lens_distance_min(nav->size), value = (double)node->switch_value;
    const double sphere = greater(mni_lens_to_sphere(lens, node), least);
    const double near = greater(sphere, greater(drawn - value, box));
    double error_px = lens->scale_px * value / sphere;
    if (error_px > lens->tolerance_px)
        error_px = greater(lens->tolerance_px, lens->scale_px * value / near);
    return error_px + grid_px / near;
}

double mni_navigator_error_px(const mni_navigator *nav, double *inside_px) {
    const mni_lens *lens = &nav->lens;
    const double drawn = greater(nearest_drawn(nav), mni_lens_distance_min(nav->size));
    const double box = mni_navigator_to_box(nav, lens->eye);
    const double grid_px = lens->scale_px * (double)mn_grid_error(nav->front.header->grid_step);
    double most =
        grid_px / drawn; /* beneath leaves: their triangles are drawn, and have no sphere */
    *inside_px = most;
    for (uint32_t slot = 0; slot < nav->front.slots_high; slot++) {
        if (!mni_front_is_active(&nav->front, slot))
            continue;
        const mni_bounds bounds = mni_front_bounds(&nav->front, slot);
        const double error_px = node_error_px(nav, &bounds, grid_px, drawn, box);
        if (error_px <= most || !mni_lens_inside(lens, &bounds))
            continue;
        *inside_px = fmax(*inside_px, error_px);
        if (!mni_lens_away(lens, &bounds))
            most = error_px;
    }
    return most;
}

double mni_navigator_front_over_wanted(const mni_navigator *nav) {
    uint64_t nodes = 0;
    for (uint32_t b = 0; b < nav->front.slots_high; b++) {
        if (!mni_front_is_branch(&nav->front, b))
            continue;
        mni_bounds bounds = mni_front_branch_bounds(&nav->front, b);
        nodes += mni_lens_wants(&nav->lens, &bounds);
    }
    uint32_t roots = nav->front.header->roots;
    return (double)nav->front.active / (double)(nodes + roots);
}
