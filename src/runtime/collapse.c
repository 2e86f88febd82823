/* The pass of collapses: all that nobody wants, now or in a moment, goes, as far as it is free to.
 *
 *   - judged are forks whose look is due, 64 together; who comes to be one in the pass joins the
 *     next 64;
 *   - tested is who is unwanted, in rising order of the parent's id, or, where there are many and
 *     no budget, by place: 16 together. Who is blocked waits for its blocker (waiting.h);
 *   - collapsed is each in its turn. Who waited for what went is tested again: at once in a crowd,
 *     else by rank.
 *
 * One pass is complete: a parent's id exceeds its children's, and what blocks a collapse has a
 * lower one, so it has had its turn.
 *
 * Hides: in which order, and how many together, forks are judged, tested and collapsed, and who is
 * woken by what goes. Others know of it `crowded`, which they leave alone, and that between passes
 * nobody is fresh.
 *
 * Order of calls: once a frame, before the pass of splits. Threads: Navigate only. Memory: the
 * navigator's; the agenda is its for the pass. Paper: §3.3.1, §3.3.5. */
#include "collapse.h"

#include "chain.h"
#include "mn_assert.h"
#include "verdict.h"

enum { TOGETHER = 16 }; /* forks to test */

/* A fork's turn: by order id; or by place, so that neighbours have theirs one after the other. */
static uint32_t fork_key(const mni_navigator *nav, uint32_t fork) {
    const mni_front_branch *b = &nav->front.branch[fork];
    return nav->crowded ? b->leaf_lo : b->order;
}

/* Those of a batch of forks that are wanted neither now nor in a moment, nor by a chain that lacks
 * a block, onto the agenda, but those that wait already. begun: during the pass. */
static void judge_forks(mni_navigator *nav, const uint32_t *fork, int count, bool begun) {
    const mni_front *front = &nav->front;
    uint8_t verdict[MNI_SIEVE_BATCH], soon[MNI_SIEVE_BATCH];
    float margin[MNI_SIEVE_BATCH], soon_margin[MNI_SIEVE_BATCH];
    for (int i = 0; i < count; i++) {
        const mni_front_branch *b = &front->branch[fork[i]];
        mni_sieve_put(&nav->batch, i, &front->position[3 * (size_t)b->slot], b->radius,
                      b->switch_value, b->face.cone);
    }
    mni_sieve_judge(&nav->sieve, &nav->batch, verdict, margin);
    mni_judge_soon(nav, soon, soon_margin);
    for (int i = 0; i < count; i++) {
        bool wants = verdict[i] == MNI_WANTED, stays = soon[i] == MNI_WANTED;
        const bool waits = mni_waiting_has(&nav->waiting, fork[i]);
        const bool kept = nav->early && front->branch[fork[i]].kept >= nav->frame;
        if (verdict[i] == MNI_UNSURE || soon[i] == MNI_UNSURE) {
            const mni_bounds bounds = mni_front_branch_bounds(front, fork[i]);
            wants = wants || (verdict[i] == MNI_UNSURE && mni_lens_wants(&nav->lens, &bounds));
            stays =
                stays || (soon[i] == MNI_UNSURE && mni_lens_wants(&nav->ahead.soon.lens, &bounds));
        }
        const float least = mni_nearer(margin[i], soon_margin[i]);
        const float until[] = {least, soon_margin[i], margin[i], margin[i]}; /* nobody can guess */
        nav->fork_due[fork[i]] = kept ? MNI_DUE_NOW : mni_due_after(nav, until[2 * wants + stays]);
        stays |= wants | kept;
        if (stays & waits)
            mni_waiting_drop(&nav->waiting, fork[i]);
        const mni_agenda_item item = {0, fork_key(nav, fork[i]), fork[i]};
        if (!begun)
            mni_agenda_add_if(&nav->agenda, item, !(stays | waits));
        else if (!(stays | waits))
            mni_agenda_push(&nav->agenda, item);
    }
}

/* Those that have become forks during the pass. */
static void judge_fresh(mni_navigator *nav) {
    judge_forks(nav, nav->fresh, nav->fresh_count, true);
    nav->fresh_count = 0;
}

/* A node, if it is a fork now. */
static void consider_fork(mni_navigator *nav, uint32_t fork) {
    if (fork == MNI_FRONT_NO_PARENT)
        return;
    __builtin_prefetch(&nav->front.position[3 * (size_t)nav->front.branch[fork].slot]);
    nav->fresh[nav->fresh_count] = fork;
    nav->fresh_count += mni_front_is_fork(&nav->front, fork); /* nobody can guess */
    if (nav->fresh_count == MNI_SIEVE_BATCH)
        judge_fresh(nav);
}

/* A fork whose next look is not due is wanted still, or not wanted still and waits. In a crowd who
 * comes later goes first: it is where the last ones were. */
static void collapse_agenda(mni_navigator *nav, uint32_t *tests) {
    const mni_front *front = &nav->front;
    uint32_t fork[MNI_SIEVE_BATCH];
    int count = 0;
    mni_agenda_clear(&nav->agenda);
    for (uint32_t first = 0; first < front->slots_high; first += MNI_SIEVE_BATCH) {
        uint64_t bits = front->forks[first / 64];
        if (bits != 0)
            bits &= mni_sieve_late(&nav->fork_due[first], nav->clock);
        for (; bits != 0; bits &= bits - 1) {
            fork[count] = first + (uint32_t)__builtin_ctzll(bits);
            __builtin_prefetch(&front->branch[fork[count]]);
            if (++count < MNI_SIEVE_BATCH)
                continue;
            judge_forks(nav, fork, count, false);
            count = 0;
        }
    }
    judge_forks(nav, fork, count, false);
    *tests = nav->agenda.heap;
    (nav->crowded ? mni_agenda_begin_queue : mni_agenda_begin)(&nav->agenda);
}

static inline void fetch_children(const mni_front *front, uint32_t fork) {
    mni_front_fetch_node(front, front->branch[fork].child[0]);
    mni_front_fetch_node(front, front->branch[fork].child[1]);
}

static void test_again(mni_navigator *nav, uint32_t fork) {
    fetch_children(&nav->front, fork);
    mni_agenda_push(&nav->agenda, (mni_agenda_item){0, fork_key(nav, fork), fork});
}

/* Two nodes have become one, in the first's slot. Those that waited for one of them have higher
 * order ids, so their turn is still to come, and verdicts that stand; their nodes are asked for.
 * Neighbours of the two are the one's, and who is blocked by it waits for it, unseen: thousands
 * may, at a hub. In a lying file some of them are no neighbours now: whatever they waited for, they
 * look again. */
static void wake(mni_navigator *nav, uint32_t slot, uint32_t other) {
    const mni_front *front = &nav->front;
    const bool all = front->lost_count > MNI_FRONT_LOST;
    const uint32_t free = all ? MN_NONE : front->node[slot].above;
    uint32_t fork;
    mni_waiting_pass(&nav->waiting, other, slot);
    while ((fork = mni_waiting_wake(&nav->waiting, slot, free)) != MN_NONE)
        test_again(nav, fork);
    for (uint32_t i = 0; i < front->lost_count && !all; i++) {
        fork = front->node[front->lost[i]].parent;
        if (fork == MNI_FRONT_NO_PARENT || !mni_waiting_has(&nav->waiting, fork))
            continue;
        mni_waiting_drop(&nav->waiting, fork);
        test_again(nav, fork);
    }
}

/* Forks whose turn it is. */
static uint32_t next_forks(mni_navigator *nav, uint32_t *fork, uint32_t room) {
    mni_agenda_item item;
    uint32_t count = 0;
    for (; count < room && mni_agenda_pop(&nav->agenda, &item); count++) {
        __builtin_prefetch(&nav->front.branch[item.what]);
        fork[count] = item.what;
    }
    uint32_t left = TOGETHER;
    const mni_agenda_item *next = mni_agenda_ahead(&nav->agenda, &left);
    for (uint32_t i = 0; i < left; i++)
        __builtin_prefetch(&nav->front.branch[next[i].what]);
    return count;
}

/* Those whose turn it is are tested together, so that what each needs of the memory is on its way
 * while the others are: nodes, then simplices, then neighbours. Who is free stays free until its
 * turn: what collapses before it was no neighbour of its, or it would have blocked it. For those
 * its parent is asked for, and who waits for its children; the others wait. Returns how many are
 * free. */
static uint32_t test_forks(mni_navigator *nav, uint32_t *fork, uint32_t count) {
    mni_front *front = &nav->front;
    uint32_t blocker[TOGETHER], blocked[TOGETHER], kept = 0, waits = 0;
    mni_rings rings[TOGETHER];
    nav->work.tested += count;
    for (uint32_t i = 0; i < count; i++)
        fetch_children(front, fork[i]);
    for (uint32_t i = 0; i < count; i++)
        for (int side = 0; side < 2; side++)
            mni_front_fetch_simplices(front, front->branch[fork[i]].child[side], false);
    for (uint32_t i = 0; i < count; i++)
        mni_front_look(front, fork[i], &rings[i]);
    for (uint32_t i = 0; i < count; i++) { /* of which kind it is nobody can guess */
        const uint32_t by = mni_front_blocker_among(front, fork[i], &rings[i]);
        blocked[waits] = fork[i];
        blocker[waits] = by;
        waits += by != MN_NONE;
        fork[kept] = fork[i];
        kept += by == MN_NONE;
    }
    for (uint32_t i = 0; i < waits; i++)
        mni_waiting_add(&nav->waiting, blocked[i], blocker[i]);
    for (uint32_t i = 0; i < kept; i++) {
        const mni_front_branch *b = &front->branch[fork[i]];
        __builtin_prefetch(&front->branch[b->parent]);
        mni_waiting_fetch(&nav->waiting, b->slot);
        mni_waiting_fetch(&nav->waiting, fork[i]);
    }
    return kept;
}

static void collapse(mni_navigator *nav, uint32_t fork) {
    mni_front *front = &nav->front;
    const mni_front_branch *b = &front->branch[fork];
    uint32_t parent = b->parent, left = b->slot, right = b->child[1], triangles = front->triangles;
    mni_outcome outcome = mni_front_collapse(front, fork);
    nav->work.triangles_removed += triangles - front->triangles;
    mni_store_attempt_over(front->store);
    mni_chain_check_small(nav);
    nav->work.collapses += outcome == MNI_DONE;
    nav->work.misses += outcome == MNI_MISS;
    nav->work.refused_pool += outcome == MNI_REFUSED_POOL;
    nav->work.refused_collapse |= outcome != MNI_DONE;
    if (outcome == MNI_MISS)
        MNI_TRACE_MISS(1, false);
    if (outcome != MNI_DONE) {
        nav->fork_due[fork] = MNI_DUE_NOW;
        return;
    }
    MNI_TRACE_OFTEN(MN_TRACE_COLLAPSE,
                    mni_store_block_id(front->store, mni_front_entry(front, parent, left)));
    mni_barred_drop(&nav->barred, left);
    mni_barred_drop(&nav->barred, right);
    nav->slot_due[left] = MNI_DUE_NOW;
    nav->slot_due[right] = MNI_DUE_NEVER;
    wake(nav, left, right);
    consider_fork(nav, parent);
}

/* With a budget, where the order decides, and in a small front one has its turn at a time. */
void mni_collapse_pass(mni_navigator *nav) {
    const bool alone = nav->ops_max > 0 || nav->front.active < MNI_PLACES_MIN;
    uint32_t fork[TOGETHER], count, tests;
    collapse_agenda(nav, &tests);
    while ((count = next_forks(nav, fork, alone ? 1 : TOGETHER)) > 0 || nav->fresh_count > 0) {
        if (count == 0)
            judge_fresh(nav);
        count = test_forks(nav, fork, count);
        for (uint32_t i = 0; i < count; i++) {
            MN_ASSERT_SLOW(mni_front_collapse_blocker(&nav->front, fork[i]) == MN_NONE);
            if (nav->ops_max > 0 && mni_navigator_ops(nav) >= nav->ops_max) {
                nav->work.refused_budget++;
                nav->work.refused_collapse = true;
                nav->fork_due[fork[i]] = MNI_DUE_NOW;
            } else {
                collapse(nav, fork[i]);
            }
        }
    }
    nav->work.waits_dependency = nav->waiting.count;
    nav->crowded = nav->by_place && tests > nav->front.active / MNI_CROWD_SHARE;
}
