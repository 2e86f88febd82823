/* What a chain needs of a pool that is nearly full, known before it is split.
 *
 * A chain splits what forces it first, and comes to need a block in the end: where there is no room
 * for that all of it is undone. But whoever stands on its stack is to be split, so the blocks that
 * those need are needed, whoever else there is: when they are more than there is room for, the
 * chain is refused as it would be in the end, for the last of them. So before the first split it is
 * looked through as far as nothing need be split for that, and whoever is pushed later is looked at
 * as well.
 *
 *     wanted ── blockers ── their blockers …      some are exits: their blocks, each once, but for
 *        └────────┴──────────────┘                those in use, their ancestors and what is granted
 *
 * When there is room for it, the chain goes on with all that have been found: they are to be split,
 * last ones first. So nobody is looked at only to be found again; and their simplices are asked for
 * while others are looked at.
 *
 * Hides: which blocks have been counted, and who has been looked at: a bit of a few hundred, by
 * order id. Whoever shares it with another is not looked at here, and found when it is split.
 *
 * Order of calls: begin, then pushed. Threads: Navigate only. Memory: the navigator's. Paper: none.
 */
#include "scarce.h"

#include <string.h>

#include "mn_assert.h"
#include "refusals.h"

enum { LOOKED_AT_MAX = 256, SEEN_BITS_LOG2 = 10, SEEN_BITS = 1 << SEEN_BITS_LOG2 };

/* Those that have come into use since, or have been granted, are not needed any more. */
static void drop_needs(mni_navigator *nav) {
    uint32_t kept = 0;
    for (uint32_t i = 0; i < nav->needs_count; i++)
        if (!mni_store_has_place(nav->front.store, nav->needs[i]))
            nav->needs[kept++] = nav->needs[i];
    nav->needs_count = kept;
}

/* Adds a block to those that the chain needs. false: there is room for fewer. */
static bool add_need(mni_navigator *nav, mn_block_ref ref, int64_t room) {
    for (uint32_t i = 0; i < nav->needs_count; i++)
        if (nav->needs[i].id == ref.id)
            return true;
    MN_ASSERT(nav->needs_count < MNI_NEEDS_MAX);
    nav->needs[nav->needs_count++] = ref;
    if (nav->needs_count > room)
        drop_needs(nav);
    return nav->needs_count <= room;
}

/* Does that node, which is to be split, need a block more than there is room for? Then the store is
 * told so. */
static bool is_refused(mni_navigator *nav, uint32_t slot, int64_t room) {
    mni_front *front = &nav->front;
    mn_block_ref ref;
    mni_note note;
    if ((front->node[slot].flags & MNI_NODE_EXIT) == 0)
        return false;
    const mni_entry from = mni_front_exit(front, slot, &ref, &note);
    if (mni_store_has_place(front->store, ref) || add_need(nav, ref, room))
        return false;
    mni_store_no_room(front->store, from, ref, nav->needs_count);
    return true;
}

/* Early splits are asked for what is foreseen, and end where there is little room. And while the
 * camera stands a chain is refused for what it has asked for alone: what is counted here leaves out
 * its own grants, so that it might find room for them again and again. */
static bool is_idle(const mni_navigator *nav, int64_t room) {
    return room >= MNI_NEEDS_MAX || nav->early_splits || !nav->moved;
}

bool mni_scarce_pushed(mni_navigator *nav, uint32_t from, uint32_t pushed, uint32_t *who) {
    const int64_t room = mni_store_room(nav->front.store);
    if (is_idle(nav, room))
        return false;
    for (uint32_t at = from; at < from + pushed; at++)
        if (is_refused(nav, nav->stack[at].slot, room)) {
            *who = at;
            return true;
        }
    return false;
}

/* Not seen before, so that it is to be looked at. */
static bool is_new(uint64_t seen[SEEN_BITS / 64], uint32_t order) {
    const uint32_t at = order * 0x9e3779b1u >> (32 - SEEN_BITS_LOG2);
    const bool is = (seen[at / 64] >> at % 64 & 1) == 0;
    seen[at / 64] |= UINT64_C(1) << at % 64;
    return is;
}

/* What looking at them and splitting them will touch is asked for. */
static void fetch_found(const mni_navigator *nav, uint32_t from, uint32_t to) {
    for (uint32_t i = from; i < to; i++)
        mni_front_fetch_split(&nav->front, nav->stack[i].slot);
    for (uint32_t i = from; i < to; i++)
        mni_front_fetch_record(&nav->front, nav->stack[i].slot);
}

/* The stack is a queue here: who is looked at stays on it, so that pushers lead back. */
bool mni_scarce_begin(mni_navigator *nav, uint32_t *all, uint32_t *who) {
    uint64_t seen[SEEN_BITS / 64];
    uint32_t top = 1;
    *all = 1;
    nav->needs_count = 0;
    if (mni_scarce_pushed(nav, 0, 1, who))
        return true;
    if (is_idle(nav, mni_store_room(nav->front.store)))
        return false;
    memset(seen, 0, sizeof seen);
    for (uint32_t next = 0; next < top && top < LOOKED_AT_MAX; next++) {
        const uint32_t first = top;
        const uint32_t found = mni_front_split_blockers(&nav->front, nav->stack[next].slot,
                                                        nav->stack + top, LOOKED_AT_MAX - top);
        *who = next;
        if (mni_refusals_bar(nav, top, found))
            return true;
        for (uint32_t i = first; i < first + found; i++)
            if (is_new(seen, nav->stack[i].order)) {
                nav->pusher[top] = (uint16_t)next;
                nav->stack[top++] = nav->stack[i];
            }
        fetch_found(nav, first, top);
        if (mni_scarce_pushed(nav, first, top - first, who))
            return true;
    }
    *all = top;
    return false;
}
