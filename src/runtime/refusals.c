/* Chains that found no room in the pool: when they are tried again, and who goes before them.
 *
 * Hides: what is remembered of a refusal, and the two parts of a pass of splits in a pool that was
 * full in the frame before.
 *
 *   what is there   by falling error. Whose block is absent is put off, and the block is sought: it
 *                   is fetched into the places that are left for what is to come. So is that of
 *                   whoever is refused for want of one place, and would be the next
 *   what is absent  as soon as the part above is through, or as many blocks are sought as there are
 *                   places for: by falling error again, all that have been put off and what has not
 *                   had its turn. Who finds room now is granted it, and is a miss until his block
 *                   has come. When the budget or the front is full before, who has been put off is
 *                   a miss: in his turn there was room
 *
 * A place that is granted for an absent block is idle until that has come, and there are more that
 * could use it than there are places. Who is put off is behind a block for a frame or two, in which
 * his own comes; then he is before all with smaller errors.
 *
 * Only while the camera moves: one that stands gives nothing back, so nobody is the next.
 *
 * Order of calls: in a pass of splits. Threads: Navigate only. Memory: the navigator's. Paper:
 * none; design.md §2, "Forced splits". */
#include "refusals.h"

/* Which refused chains are worth finding again in this pass. */
void mni_refusals_begin(mni_navigator *nav) {
    uint64_t epoch = mni_store_epoch(nav->front.store);
    bool changed = epoch != nav->epoch;
    nav->again = nav->moved || nav->front.version != nav->version || changed;
    nav->lenient = !nav->moved && changed;
    nav->turn = (nav->turn + 1) % MNI_TURNS;
    nav->epoch = epoch;
    nav->there_only = nav->seeks && mni_store_there_only(nav->front.store, true);
    mni_lacking_forget(&nav->lacking);
}

static void absent_next(mni_navigator *nav) {
    nav->there_only = false;
    (void)mni_store_there_only(nav->front.store, false);
    mni_agenda_unmark(&nav->agenda, MNI_PUT_OFF);
    mni_lacking_forget(&nav->lacking);
}

void mni_refusals_end(mni_navigator *nav) {
    if (nav->there_only)
        absent_next(nav);
}

/* It needs the block that it was refused for as long as it stands. If it needs others too that
 * others have brought in meanwhile, it needs less room than then: so all are tried when nothing
 * else moves, and each in its turn. */
static bool allows(const mni_navigator *nav, uint32_t order, const mni_refusal *refusal) {
    const bool lenient = nav->lenient || (nav->moved && order % MNI_TURNS == nav->turn);
    return mni_store_allows(nav->front.store, refusal, lenient);
}

bool mni_refusals_stands(const mni_navigator *nav, uint32_t slot) {
    if ((nav->front.node[slot].flags & MNI_NODE_GIVEN_UP) == 0)
        return false;
    if (nav->refusal[slot].block_id == 0)
        return !nav->again;
    return !allows(nav, nav->front.node[slot].order, &nav->refusal[slot]);
}

bool mni_refusals_stands_barred(const mni_navigator *nav, const mni_barred_node *node) {
    return !allows(nav, node->item.order, &node->refusal);
}

bool mni_refusals_lacks(const mni_navigator *nav, uint32_t slot) {
    const mni_refusal *refusal = &nav->refusal[slot];
    return nav->there_only && (nav->front.node[slot].flags & MNI_NODE_GIVEN_UP) != 0 &&
           refusal->block_id != 0 && !mni_store_has(nav->front.store, refusal);
}

void mni_refusals_put(mni_navigator *nav, uint32_t slot) {
    nav->front.node[slot].flags |= MNI_NODE_GIVEN_UP;
    nav->refusal[slot] = mni_store_refusal(nav->front.store, false);
}

/* Whoever comes to one of them needs that block as well, and no less room. */
void mni_refusals_put_on_the_way(mni_navigator *nav, uint32_t at) {
    const mni_refusal last = mni_store_refusal(nav->front.store, true);
    for (; last.block_id != 0 && at != MNI_NOBODY; at = nav->pusher[at]) {
        const mni_front_ref node = nav->stack[at];
        if (!mni_front_stands(&nav->front, node))
            continue; /* the chain had made it */
        mni_front_node *n = &nav->front.node[node.slot];
        mni_refusal *known = &nav->refusal[node.slot];
        if ((n->flags & MNI_NODE_GIVEN_UP) == 0 || known->block_id != last.block_id)
            *known = last; /* otherwise it is known better */
        n->flags |= MNI_NODE_GIVEN_UP;
    }
}

bool mni_refusals_bar(mni_navigator *nav, uint32_t top, uint32_t pushed) {
    for (uint32_t i = 0; i < pushed; i++) {
        const uint32_t slot = nav->stack[top + i].slot;
        if (!mni_refusals_stands(nav, slot) || nav->refusal[slot].block_id == 0)
            continue;
        mni_store_refuse(nav->front.store, &nav->refusal[slot]);
        return true;
    }
    return false;
}

/* The next to have room is who needs one place more than there is. */
void mni_refusals_seek(mni_navigator *nav, const mni_refusal *refusal) {
    if (nav->seeks && (int64_t)refusal->need - 1 <= mni_store_room(nav->front.store))
        nav->seeks = mni_store_seek(nav->front.store, refusal);
}

bool mni_refusals_wait(mni_navigator *nav, mni_agenda_item item) {
    if (!nav->there_only || ((item.key & MNI_PUT_OFF) == 0 && nav->seeks))
        return false;
    mni_agenda_push(&nav->agenda, item);
    absent_next(nav);
    return true;
}

void mni_refusals_put_off(mni_navigator *nav, mni_agenda_item item) {
    item.key |= MNI_PUT_OFF;
    mni_agenda_push(&nav->agenda, item);
}
