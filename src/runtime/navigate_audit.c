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

double mni_navigator_error_px(const mni_navigator *nav, double *inside_px) {
    const float grid_error = mn_grid_error(nav->front.header->grid_step);
    double most = 0;
    *inside_px = 0;
    for (uint32_t slot = 0; slot < nav->front.slots_high; slot++) {
        if (!mni_front_is_active(&nav->front, slot))
            continue;
        mni_bounds bounds = mni_front_bounds(&nav->front, slot);
        bounds.switch_value += grid_error;
        double error_px = mni_lens_error_px(&nav->lens, &bounds);
        if (error_px <= most || !mni_lens_inside(&nav->lens, &bounds))
            continue;
        *inside_px = fmax(*inside_px, error_px);
        if (!mni_lens_away(&nav->lens, &bounds))
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
