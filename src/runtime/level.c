/* See level.h. A ladder of tolerances, 2^(1/64) apart: 1.1 % more tolerance is 1 to 2 % fewer
 * triangles, so the lowest rung that fits fills the room.
 *
 * Hides: which rung is next. Everything that has no room (the front, the place holders, a target of
 * triangles) is the same: the tolerance rises over the whole screen, and falls when there is room.
 *
 *   the camera stands  what fits at a level fits at every higher one: a search between the highest
 *                      that was too low and the lowest that is enough, in strides that double and,
 *                      between both, halve. No level is tried twice, so it ends, and with all
 *                      in memory at the same rung from whichever side: the lowest that fits. Down
 *                      by what room there is: too far would read what then has to go
 *   the camera moves   up as long as something is refused, in strides that double from frame to
 *                      frame; down, after a pause, as far as the room that is left allows
 *
 * Where those that are refused are many, they go before: the level rises at once to where the many
 * with the largest errors are all that is wanted. What stands may be small, because it was there
 * when nothing else had come from the disk, and hundreds of levels away from what is refused.
 *
 * Wanted nodes are split by falling error. So when one is refused, all that is wanted at its own
 * error stands: a level that is enough is known without a trial. (It may be too high by far, where
 * what stood before holds the room; hence strides. Where the frame has made most of its front from
 * nothing, it does not, and the level goes there at once.)
 *
 * Where the eye is in a node's sphere nobody knows how far its triangles are. They are taken to be
 * as near as a millionth of the model, and so whatever is not leaves or flat is wanted by any
 * tolerance: of a hub's 10,000 slivers, each as long as the eye is away, more than a small front
 * holds. So as the tolerance gives way they are taken to be farther as well: soon as far as the
 * model's box, than which nothing is nearer, and beyond that slowly, since whatever is known to be
 * near is then taken to be as far. Both rise with the level, so what fits at one fits at every
 * higher.
 *
 * Pure functions on plain data; Navigate only. Paper: none; design.md §4, "Degrading". */
#include "level.h"

#include <math.h>

#include "mn_assert.h"

enum { UNKNOWN = MNI_LEVEL_MAX + 1 };
/* The least distance rises with these powers of the tolerance: up to the box; and anywhere, there
 * of a tolerance that can be seen, from a pixel on. */
#define REACH_TO_BOX 4.0
#define REACH_ANYWHERE 2.0

/* While the camera moves so much room is left: at the rim every frame would refuse something. */
static const double FILL_MOVING = 0.97;

void mni_level_open(mni_level *l) {
    *l = (mni_level){.too_low = -1, .enough = UNKNOWN};
}

double mni_level_tolerance(const mni_level *l, double tolerance_px) {
    return tolerance_px * exp2((double)l->level / MNI_LEVELS_A_DOUBLING);
}

void mni_level_asked(mni_level *l, double before_px, double now_px) {
    const double doublings = log2(before_px / now_px);
    const double level = ceil(l->level + MNI_LEVELS_A_DOUBLING * doublings);
    if (l->level > 0)
        l->level = isfinite(doublings) ? (int)fmin(fmax(level, 0), MNI_LEVEL_MAX) : 0;
    l->stride = 0;
    l->settled = true;
}

/* Doublings of a tolerance until it can be seen. */
static double unseen(double tolerance_px) {
    return fmax(-log2(tolerance_px), 0);
}

double mni_level_reach(const mni_level *l, double tolerance_px, double box_away) {
    const double doublings = (double)l->level / MNI_LEVELS_A_DOUBLING;
    const double to_box = fmin(REACH_TO_BOX * doublings, log2(box_away));
    const double anywhere = REACH_ANYWHERE * fmax(doublings - unseen(tolerance_px), 0);
    return exp2(fmax(to_box, anywhere));
}

static int least(int a, int b) {
    return a < b ? a : b;
}

static int most(int a, int b) {
    return a > b ? a : b;
}

/* The first level at which what was refused is not wanted. If it is as near as anything is taken to
 * be, its distance gives way as well as the tolerance. */
static int level_of(mni_level_refused r, double box_away, double tolerance_px) {
    const double share = r.px / tolerance_px, near = log2(share * r.away);
    const double to_box = fmax(near / (1 + REACH_TO_BOX), near - log2(box_away));
    const double anywhere =
        fmin(near, (near + REACH_ANYWHERE * unseen(tolerance_px)) / (1 + REACH_ANYWHERE));
    const double giving = fmin(to_box, anywhere);
    const double level = ceil(MNI_LEVELS_A_DOUBLING * fmin(log2(share), giving));
    return level >= 0 && level < UNKNOWN ? (int)level : UNKNOWN; /* UNKNOWN for NaN too */
}

/* Twice as far as last time, if that was the same way. */
static int stride(const mni_level *l, int way) {
    return l->stride * way > 0 ? 2 * l->stride : way;
}

static void rise(mni_level *l, double tolerance_px, const mni_level_signs *s) {
    const int at_error = level_of(s->refused, s->box_away, tolerance_px);
    const int at_crowd = level_of(s->crowd, s->box_away, tolerance_px);
    if (!s->stale)
        l->too_low = most(l->too_low, l->level);
    if (l->enough <= l->level)
        l->enough = UNKNOWN; /* the front was another then */
    if (at_error > l->level)
        l->enough = least(l->enough, at_error);
    l->hold = MNI_LEVEL_HOLD_FRAMES;
    if (s->from_scratch && l->enough < UNKNOWN) {
        l->level = l->enough;
        l->stride = 0;
        return;
    }
    l->stride = least(stride(l, 1), MNI_LEVEL_STRIDE);
    int next = least(l->level + l->stride, MNI_LEVEL_MAX);
    if (at_crowd < UNKNOWN)
        next = most(next, at_crowd);
    if (!s->moved && l->enough < UNKNOWN)
        next = least(next, (l->level + l->enough + 1) / 2);
    l->level = next;
}

/* How far the level may fall at once: triangles grow about as the tolerance falls, or faster. */
static int reach(const mni_level_signs *s) {
    if (!(s->fill > 0))
        return MNI_LEVEL_STRIDE;
    const double share = s->moved ? FILL_MOVING : 1;
    const double at_most = s->moved ? MNI_LEVEL_STRIDE : MNI_LEVEL_MAX;
    const double levels = MNI_LEVELS_A_DOUBLING / 2 * log2(share / s->fill);
    return most((int)fmin(levels, at_most), !s->moved);
}

/* While the camera stands: so far, or, if the last fall has taken little of what there was, in
 * doublings of the fill, once or twice as far as that. */
static int reach_standing(const mni_level *l, const mni_level_signs *s) {
    const double taken = log2(s->fill / l->fill), left = -log2(s->fill);
    if (l->stride >= 0 || !(2 * taken <= left))
        return reach(s);
    return most(reach(s), 4 * taken <= left ? -2 * l->stride : -l->stride);
}

static void fall(mni_level *l, const mni_level_signs *s) {
    if (!s->busy)
        l->enough = least(l->enough, l->level);
    if (s->moved && l->stride > 0)
        l->stride = 0;
    if (l->level - 1 <= l->too_low) {
        l->stride = 0;
        return;
    }
    l->settled = false;
    if (s->moved ? l->hold > 0 : s->busy)
        return;
    l->stride = -(s->moved ? least(-stride(l, -1), reach(s)) : reach_standing(l, s));
    l->fill = s->fill;
    int next = most(l->level + l->stride, 0);
    if (next <= l->too_low)
        next = l->too_low + (l->level - l->too_low) / 2;
    l->level = next;
}

void mni_level_next(mni_level *l, double tolerance_px, const mni_level_signs *s) {
    l->settled = true;
    if (s->moved) {
        l->too_low = -1;
        l->enough = UNKNOWN;
    }
    if (l->hold > 0)
        l->hold--;
    if (s->full) {
        l->settled = l->level == MNI_LEVEL_MAX;
        rise(l, tolerance_px, s);
    } else {
        fall(l, s);
    }
    MN_ASSERT(l->level >= 0 && l->level <= MNI_LEVEL_MAX);
}
