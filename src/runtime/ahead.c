/* Where the camera is going, and which blocks it will want there. See ahead.h.
 *
 * Hides: the extrapolation, what counts as a jump, and when a node will be wanted: between now and
 * then its error on the screen is taken to rise by equal factors in equal times, as it does for a
 * camera that dives. The front has its turn with the camera at the horizon and half-way to it: what
 * only passes through the picture is not wanted at the end.
 *
 * Navigate only; no memory besides the struct. Paper: §5 (future work). */
#include "ahead.h"

#include <math.h>

#include "mn_assert.h"

/* A step that is this share of the model, and differs by this share of itself from the one before,
 * is a jump: the camera is somewhere else, and nothing is known of where it goes. The next one, if
 * it is alike, is motion, however fast. */
#define JUMP_SIZE_SHARE 0.05f
#define JUMP_CHANGE_SHARE 0.75f
/* Steps that differ by more than this share of one are no smooth motion: a start, a stop, a hand.
 */
#define SMOOTH_SHARE 0.25f

static float length_of(const float v[3]) {
    return sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/* Where a point goes on to, with the step that it made last and, where it moves smoothly, with the
 * change of its steps: a turn stays a turn. That adds as much as the step at most. */
static float go_on(const float before[3], const float last[3], const float now[3], float frames,
                   float there[3]) {
    float step[3], change[3];
    for (int i = 0; i < 3; i++) {
        step[i] = now[i] - last[i];
        change[i] = step[i] - (last[i] - before[i]);
    }
    const float most = frames * length_of(step),
                bend = frames * (frames + 1) / 2 * length_of(change);
    float share = bend > most ? most / bend : 1;
    if (length_of(change) > SMOOTH_SHARE * length_of(step))
        share = 0;
    for (int i = 0; i < 3; i++)
        there[i] = now[i] + frames * step[i] + share * frames * (frames + 1) / 2 * change[i];
    return most;
}

bool mni_ahead_extrapolate(mni_ahead *a, const mn_camera *camera, float frames, mn_camera *out) {
    mn_camera before = a->before;
    if (!a->has_before) /* as if it had gone on as it does now */
        for (int i = 0; i < 3; i++) {
            before.eye[i] = 2 * a->last.eye[i] - camera->eye[i];
            before.target[i] = 2 * a->last.target[i] - camera->target[i];
            before.up[i] = 2 * a->last.up[i] - camera->up[i];
        }
    *out = *camera;
    float moved = go_on(before.eye, a->last.eye, camera->eye, frames, out->eye);
    moved += go_on(before.target, a->last.target, camera->target, frames, out->target);
    moved += go_on(before.up, a->last.up, camera->up, frames, out->up);
    return moved > 0;
}

void mni_ahead_begin(mni_ahead *a, const mn_camera *camera, const mni_lens *now, uint32_t width_px,
                     uint32_t height_px, double size, const mn_weights *weights,
                     float coordinate_max) {
    mn_camera there;
    float step[3], change[3];
    for (int i = 0; i < 3; i++) {
        step[i] = camera->eye[i] - a->last.eye[i];
        change[i] = step[i] - a->step[i];
    }
    const bool jumped = length_of(step) > JUMP_SIZE_SHARE * (float)size &&
                        length_of(change) > JUMP_CHANGE_SHARE * length_of(step);
    a->look.now = a->look.ahead = *now;
    a->look.coordinate_max = coordinate_max;
    a->look.moves =
        a->has_last && !jumped && mni_ahead_extrapolate(a, camera, MNI_AHEAD_HORIZON, &there);
    if (a->look.moves) {
        mni_lens_make(&a->look.ahead, &there, width_px, height_px, now->distance_min,
                      now->tolerance_px, weights);
        a->frames = a->near ? MNI_AHEAD_NEAR : MNI_AHEAD_HORIZON;
        a->there = a->look.ahead;
        if (a->near && mni_ahead_extrapolate(a, camera, MNI_AHEAD_NEAR, &there))
            mni_lens_make(&a->there, &there, width_px, height_px, now->distance_min,
                          now->tolerance_px, weights);
        mni_sieve_make(&a->sieve, &a->there, coordinate_max);
        const mni_lens soon_before = a->soon.lens;
        (void)mni_ahead_extrapolate(a, camera, MNI_AHEAD_SOON, &there);
        mni_lens_make(&a->soon.lens, &there, width_px, height_px, now->distance_min,
                      now->tolerance_px, weights);
        mni_sieve_make(&a->soon.sieve, &a->soon.lens, coordinate_max);
        a->soon_motion = mni_sieve_motion(&soon_before, &a->soon.lens, (double)coordinate_max);
    }
    for (int i = 0; i < 3; i++)
        a->step[i] = step[i];
    a->before = a->last;
    a->has_before = a->has_last && !jumped;
    a->last = *camera;
    a->has_last = true;
}

/* Frames until an error that is now_px, and there_px at the horizon, crosses the tolerance. */
static uint32_t frames_until(double now_px, double there_px, double tolerance_px, uint32_t frames) {
    if (!(now_px > 0) || !(there_px > 0) || now_px == there_px)
        return frames;
    const double share = log(tolerance_px / now_px) / log(there_px / now_px);
    return (uint32_t)(frames * fmin(fmax(share, 0), 1));
}

/* An exit that is not wanted now and will be. */
static void foresee_split(mni_ahead *a, mni_front *front, uint32_t slot) {
    if (!mni_front_is_active(front, slot) || (front->node[slot].flags & MNI_NODE_EXIT) == 0)
        return;
    const mni_bounds bounds = mni_front_bounds(front, slot);
    const double tolerance_px = a->look.now.tolerance_px;
    const double there_px = mni_lens_priority(&a->there, &bounds);
    if (!(there_px > tolerance_px))
        return;
    const double now_px = mni_lens_priority(&a->look.now, &bounds);
    if (now_px > tolerance_px)
        return; /* asked for as it is */
    mn_block_ref ref;
    mni_note note;
    const mni_entry entry = mni_front_exit(front, slot, &ref, &note);
    mni_store_ahead_down(front->store, entry, ref,
                         frames_until(now_px, there_px, tolerance_px, a->frames));
    mni_store_note(front->store, ref, &note);
}

static void judge(mni_ahead *a, mni_front *front, const uint32_t *slot, int count) {
    uint8_t verdict[MNI_SIEVE_BATCH];
    float margin[MNI_SIEVE_BATCH];
    mni_sieve_judge(&a->sieve, &a->batch, verdict, margin);
    for (int i = 0; i < count; i++)
        if (verdict[i] != MNI_UNWANTED)
            foresee_split(a, front, slot[i]);
}

/* Whoever is in none of those slots of a batch is not wanted there. */
static void check_left_out(const mni_ahead *a, const mni_front *f, uint32_t first, uint64_t bits) {
#ifdef MN_SLOW_CHECKS
    for (uint32_t i = 0; i < MNI_SIEVE_BATCH && first + i < f->slots_high; i++) {
        if ((bits >> i & 1) != 0 || !mni_front_is_active(f, first + i) ||
            mni_front_is_leaf(f, first + i))
            continue;
        const mni_bounds bounds = mni_front_bounds(f, first + i);
        MN_ASSERT(!mni_lens_wants(&a->there, &bounds));
    }
#else
    (void)a, (void)f, (void)first, (void)bits;
#endif
}

/* As Navigate's pass of splits goes through all slots (navigate.c), through those of one turn that
 * may be wanted there: whose verdict does not stand until then. */
static void scan_slots(mni_ahead *a, mni_front *f, const mni_barred *barred, float until,
                       uint32_t from, uint32_t to) {
    float margin[MNI_SIEVE_BATCH];
    uint32_t slot[MNI_SIEVE_BATCH];
    int count = 0;
    for (uint32_t first = from; first < to; first += MNI_SIEVE_BATCH) {
        uint64_t bits = mni_sieve_late(&barred->due[first], until);
        check_left_out(a, f, first, bits | mni_barred_bits(barred, first));
        bits &= ~mni_barred_bits(barred, first);
        if (bits == 0)
            continue;
        mni_sieve_far(&a->sieve, NULL, &f->position[3 * (size_t)first], &f->radius[first],
                      &f->switch_value[first], margin);
        for (; bits != 0; bits &= bits - 1) {
            const uint32_t i = (uint32_t)__builtin_ctzll(bits), at = first + i;
            if (at >= to || margin[i] > 0)
                continue;
            mni_sieve_put(&a->batch, count, &f->position[3 * (size_t)at], f->radius[at],
                          f->switch_value[at], f->face[at].cone);
            slot[count++] = at;
            if (count < MNI_SIEVE_BATCH)
                continue;
            judge(a, f, slot, count);
            count = 0;
        }
    }
    judge(a, f, slot, count);
}

/* Forks whose collapse will need a block that is not in use. */
static void scan_branches(mni_ahead *a, mni_front *f, uint32_t from, uint32_t to) {
    for (uint32_t b = from; b < to; b++) {
        const mni_front_branch *branch = &f->branch[b];
        if (!branch->exit || !mni_front_is_fork(f, b))
            continue;
        const mni_entry entry = mni_front_entry(f, branch->parent, branch->slot);
        if (mni_store_usage(f->store, entry) > 0)
            continue;
        const mni_bounds bounds = mni_front_branch_bounds(f, b);
        const double tolerance_px = a->look.now.tolerance_px;
        const double there_px = mni_lens_priority(&a->look.ahead, &bounds);
        if (there_px > tolerance_px)
            continue;
        const double now_px = mni_lens_priority(&a->look.now, &bounds);
        if (now_px > tolerance_px)
            mni_store_ahead_up(f->store, entry,
                               frames_until(now_px, there_px, tolerance_px, MNI_AHEAD_HORIZON));
    }
}

/* The part [from, to) of `count` things that has its turn, in whole batches. */
typedef struct part {
    uint32_t from, to;
} part;
static part turn(uint32_t count, uint32_t turns, uint32_t *next) {
    const uint32_t size = (count / turns / MNI_SIEVE_BATCH + 1) * MNI_SIEVE_BATCH;
    const uint32_t from = *next < count ? *next : 0;
    const bool last = count - from <= size;
    *next = last ? 0 : from + size;
    return (part){from, last ? count : from + size};
}

void mni_ahead_scan(mni_ahead *a, mni_front *front, const mni_barred *barred, float clock) {
    if (!a->look.moves || !(a->look.now.tolerance_px > 0))
        return;
    const part slots = turn(front->slots_high, MNI_AHEAD_TURNS, &a->slot);
    const part branches = turn(front->slots_high, MNI_AHEAD_UP_TURNS, &a->branch);
    a->near ^= a->slot == 0;
    const double motion = mni_sieve_motion(&a->look.now, &a->there, (double)a->look.coordinate_max);
    const float until = nextafterf((float)((double)clock + motion), INFINITY);
    scan_slots(a, front, barred, until, slots.from, slots.to);
    scan_branches(a, front, branches.from, branches.to);
}
