/* Chains: a split with all the splits that must be made before it.
 *
 * Hides: the search, what becomes of a chain that cannot be carried out, and what one chain has
 * found out for the others of its frame (lacking.h).
 *
 *   goes through   its splits stand, and stay
 *   lacks a block  it is searched as far as it does not depend on that, so that all that it lacks
 *                  is asked for at once. While the camera moves and there is room, what has been
 *                  split stays, for MNI_KEPT_FRAMES though nobody wants it: the next search goes
 *                  on from there, and what it needs is in use. Otherwise it is undone, and its
 *                  blocks are granted as long as it is tried in every frame (pool_navigate.c)
 *   is refused     before it has split anything, where that is known then (scarce.h); otherwise it
 *                  is undone. It is known to the others that come by the same node (refusals.h).
 *                  With little room none is kept, or pieces of chains would keep each other from
 *                  being completed
 *
 * Threads: Navigate only. Memory: the navigator's. Paper: §3.3.5 has the dependencies; forced
 * splits: design.md §2. */
#include "chain.h"

#include <math.h>

#include "mn_assert.h"
#include "refusals.h"
#include "scarce.h"

enum { SMALL_TRIANGLES = 2000 };

void mni_chain_check_small(const mni_navigator *nav) {
#ifdef MN_SLOW_CHECKS
    if (nav->front.header->triangles < SMALL_TRIANGLES)
        mni_front_check(&nav->front);
#else
    (void)nav;
#endif
}

static void chain_undo(mni_navigator *nav, uint32_t count) {
    nav->work.undone += count;
    while (count > 0)
        mni_front_unsplit(&nav->front, nav->chain[--count]);
    mni_chain_check_small(nav);
}

/* Puts what must split before slot on the stack, half the room at most, and then one: so depth
 * always has the other half. Returns how many. */
static uint32_t push_blockers(mni_navigator *nav, uint32_t slot, uint32_t top) {
    const uint32_t room = top < MNI_STACK_MAX / 2 ? MNI_STACK_MAX / 2 - top : 1;
    if (top == MNI_STACK_MAX)
        return 0;
    return mni_front_split_blockers(&nav->front, slot, nav->stack + top, room);
}

/* Who was pushed stands there for the top, and what his split will touch is asked for: they are
 * tested and split one after the other. */
static void await_pushed(mni_navigator *nav, uint32_t top, uint32_t pushed) {
    for (uint32_t i = 0; i < pushed; i++) {
        nav->pusher[top + i] = (uint16_t)(top - 1);
        mni_front_fetch_split(&nav->front, nav->stack[top + i].slot);
    }
}

/* Of the blockers pushed last, those of which nothing is known yet that keeps them from being
 * split, to the front; *lack: of another one, so that whoever has pushed them cannot be split
 * either. Then those that are sound are left out as well. */
static uint32_t keep_unknown(mni_navigator *nav, uint32_t top, uint32_t pushed,
                             const mni_lack **lack) {
    const mni_lacking *lacking = &nav->lacking;
    uint32_t kept = 0, unknown = 0;
    for (uint32_t i = 0; i < pushed; i++) {
        const mni_lack *found = mni_lacking_of(lacking, nav->stack[top + i].order);
        if (found == NULL)
            nav->stack[top + kept++] = nav->stack[top + i];
        else
            *lack = found;
    }
    if (*lack == NULL)
        return kept;
    for (uint32_t i = 0; i < kept; i++)
        if (!mni_lacking_is_sound(lacking, nav->stack[top + i].order))
            nav->stack[top + unknown++] = nav->stack[top + i];
    return unknown;
}

/* What stands there on the stack cannot be split, nor can who had it pushed, and so on. */
static void chain_lacks(mni_navigator *nav, uint32_t at, mni_lack lack) {
    mni_lacking_put(&nav->lacking, nav->stack[at].order, lack.block_id, lack.brief);
    for (at = nav->pusher[at]; at != MNI_NOBODY; at = nav->pusher[at]) {
        const mni_lack *known = mni_lacking_of(&nav->lacking, nav->stack[at].order);
        if (known != NULL && known->brief <= lack.brief)
            return;
        mni_lacking_put(&nav->lacking, nav->stack[at].order, lack.block_id, lack.brief);
    }
}

static mni_lack block_absent(const mni_store *store) {
    mni_lack lack = {0};
    lack.brief = !mni_store_absent(store, &lack.block_id);
    return lack;
}

/* A chain that lacks a block will be undone: of what it has split it is known that it could be. */
static void chain_learn(mni_navigator *nav, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        mni_lacking_put_sound(&nav->lacking, nav->front.branch[nav->chain[i]].order);
}

/* Do the splits of a chain stay that lacks a block? */
static bool keeps(const mni_navigator *nav) {
    return nav->early && mni_navigator_fill(nav) < MNI_EARLY_FILL;
}

/* Has a chain that lacks a block asked for enough? What will be undone is not to cost much, nor
 * what is done before its time. What it may do in any case comes first, as to tell whether it stays
 * takes longer. idle: nodes since the last split that turned out to lack a block which is known. */
static bool has_asked(const mni_navigator *nav, uint32_t missed, uint32_t splits, uint32_t count,
                      uint32_t idle) {
    const double effort = nav->early_splits ? mni_navigator_effort(nav) : -INFINITY;
    if (nav->early_splits && idle >= MNI_IDLE_MAX)
        return true;
    if (missed < MNI_MISSED_MAX && splits < MNI_SURVEY_MAX && effort + 2 * count < nav->effort_max)
        return false;
    return !keeps(nav) || missed >= MNI_KEPT_MAX || splits >= MNI_KEPT_MAX ||
           effort + count >= nav->effort_max;
}

/* What has been split of a chain stays, or is undone. */
static void chain_end(mni_navigator *nav, mni_outcome outcome, uint32_t *count) {
    if (outcome == MNI_DONE)
        return;
    if (outcome == MNI_MISS && keeps(nav)) {
        for (uint32_t i = 0; i < *count; i++)
            nav->front.branch[nav->chain[i]].kept = nav->frame + MNI_KEPT_FRAMES;
        return;
    }
    if (outcome == MNI_MISS)
        chain_learn(nav, *count);
    chain_undo(nav, *count);
    *count = 0;
}

/* The next of a chain, which nobody blocks, is split if the frame's limits and the store let it. */
static mni_outcome split_next(mni_navigator *nav, uint32_t slot, uint32_t top, uint32_t *count) {
    mni_front *front = &nav->front;
    const uint64_t ops = mni_navigator_ops(nav);
    if (top == MNI_STACK_MAX || *count == nav->chain_max)
        return MNI_REFUSED_FRONT;
    if (nav->ops_max > 0 && ops > 0 && ops + *count >= nav->ops_max)
        return MNI_REFUSED_BUDGET;
    const mni_outcome outcome = mni_front_split(front, slot, &nav->chain[*count]);
    if (outcome != MNI_DONE)
        return outcome;
    ++*count;
    mni_chain_check_small(nav);
    return nav->triangles_max > 0 && front->triangles > nav->triangles_max ? MNI_REFUSED_FRONT
                                                                           : MNI_DONE;
}

/* No recursion: order ids rise from who has pushed to who was pushed, so that it ends. When a block
 * is absent it goes on with what does not depend on that; but not with what another chain has found
 * in this frame. */
mni_outcome mni_chain_find(mni_navigator *nav, uint32_t slot, uint32_t *count) {
    mni_front *front = &nav->front;
    mni_outcome outcome = MNI_DONE;
    uint32_t top = 1, missed = 0, first_missed = 0, idle = 0;
    uint32_t who = 0; /* on the stack, that cannot be split */
    nav->stack[0] = mni_front_ref_of(front, slot);
    nav->pusher[0] = MNI_NOBODY;
    *count = 0;
    const mni_lack *lack = mni_lacking_of(&nav->lacking, nav->stack[0].order);
    if (lack != NULL) {
        mni_trace_lacks(lack->block_id);
        return MNI_MISS;
    }
    mni_lacking_chain(&nav->lacking);
    if (mni_scarce_begin(nav, &top, &who))
        outcome = MNI_REFUSED_POOL;
    while (top > 0 && outcome == MNI_DONE) {
        mni_front_ref at = nav->stack[top - 1];
        if (!mni_front_stands(front, at)) {
            top--; /* another way has split it */
            continue;
        }
        mni_front_fetch_record(front, at.slot); /* while its neighbours are waited for */
        uint32_t pushed = push_blockers(nav, at.slot, top);
        who = top - 1;
        if (mni_refusals_bar(nav, top, pushed)) {
            outcome = MNI_REFUSED_POOL;
            break;
        }
        lack = mni_lacking_of(&nav->lacking, at.order);
        if (nav->lacking.any)
            pushed = keep_unknown(nav, top, pushed, &lack);
        if (lack != NULL) {
            first_missed = missed == 0 ? *count : first_missed;
            missed += missed == 0 || pushed == 0;
            mni_trace_lacks(lack->block_id);
            chain_lacks(nav, top - 1, *lack);
        }
        if (pushed > 0) {
            await_pushed(nav, top, pushed);
            top += pushed;
            if (mni_scarce_pushed(nav, top - pushed, pushed, &who))
                outcome = MNI_REFUSED_POOL;
        } else if (missed > 0 && has_asked(nav, missed, *count - first_missed, *count, idle)) {
            outcome = MNI_MISS;
        } else if (lack != NULL) {
            idle++;
            top--;
        } else {
            idle = 0;
            outcome = split_next(nav, at.slot, top, count);
            if (outcome == MNI_MISS) {
                first_missed = missed == 0 ? *count : first_missed;
                missed++;
                chain_lacks(nav, top - 1, block_absent(front->store));
                outcome = MNI_DONE;
            }
            top -= outcome == MNI_DONE;
        }
    }
    if (missed > 0 && outcome != MNI_REFUSED_POOL)
        outcome = MNI_MISS;
    if (outcome != MNI_MISS && missed > 0)
        mni_lacking_forget(&nav->lacking);
    chain_end(nav, outcome, count);
    if (outcome == MNI_REFUSED_POOL)
        mni_refusals_put_on_the_way(nav, who);
    mni_store_attempt_over(front->store);
    return outcome;
}
