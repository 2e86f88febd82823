/* Implicit dependencies: who stands in the way of a move.
 *
 * Hides: how the neighbours of a node are looked through. A ring that fits a record is looked at
 * whole and without a branch (ring.c). A longer list is not scanned each time: its node keeps
 * one that blocks as a witness; hundreds and more are sought in a tree (pole.c). Two nodes that are
 * neighbours once stay so while both are active, because a simplex that joins them dies only with
 * one of them; so a witness that is still active still is a neighbour, and whether it blocks now is
 * seen at once: one serves both moves.
 *
 * Any order of calls. Threads: Navigate only. No memory. Paper: §3.3.5. */
#include "pole.h"
#include "ring.h"

static bool is_long(const mni_front *f, uint32_t slot) {
    return mni_front_is_long(&f->node[slot]);
}

static bool is_pole(const mni_front *f, uint32_t slot) {
    return mni_front_is_pole(&f->node[slot]);
}

/* Of a long list, of no pole's. */
static bool witness_stands(const mni_front *f, const mni_front_node *n) {
    return n->witness != MN_NONE && f->node[n->witness].order == f->chunk[n->more].witness_order;
}

static void witness_set(mni_front *f, uint32_t slot, uint32_t found) {
    f->node[slot].witness = found;
    f->chunk[f->node[slot].more].witness_order = f->node[found].order;
}

/* ---- splits ---------------------------------------------------------------------------------- */

static uint32_t split_blockers_far(mni_front *f, uint32_t slot, mni_front_ref *out, uint32_t room) {
    uint32_t order = f->node[slot].order, count = 0;
    if (is_pole(f, slot))
        return mni_pole_seek(f, slot, order, 0, out, room);
    for (mni_run r = mni_run_first(f, slot); r.corner != NULL; r = mni_run_next(f, r))
        for (uint32_t i = 0; i < r.room && r.corner[i] != 0; i++, mni_front_looks(f, 1))
            for (int k = 0; k < 2; k++) {
                uint32_t c = r.corner[i];
                uint32_t at = mni_corner_slot(f, k ? mni_corner_before(c) : mni_corner_after(c));
                if (f->node[at].order <= order)
                    continue;
                out[count++] = mni_front_ref_of(f, at);
                if (count == room)
                    return count;
            }
    return count;
}

/* Of a list that is not long, unless the last look was at the same. */
static uint32_t look(mni_front *f, uint32_t slot) {
    if (f->ring_slot != slot) {
        f->ring_blockers = mni_ring_block_split(f, slot, &f->ring);
        f->ring_slot = slot;
    }
    return f->ring_blockers;
}

uint32_t mni_front_split_blockers(mni_front *f, uint32_t slot, mni_front_ref *out, uint32_t room) {
    if (is_long(f, slot))
        return split_blockers_far(f, slot, out, room);
    uint32_t count = 0, mask = look(f, slot);
    const uint32_t before = mask & ~((1u << MNI_FRONT_CORNERS) - 1);
    mask = before != 0 ? before : mask; /* of a closed fan either half has all */
    for (; mask != 0 && count < room; mask &= mask - 1)
        out[count++] = mni_front_ref_of(f, f->ring.slot[__builtin_ctz(mask)]);
    return count;
}

uint32_t mni_front_split_blocker(mni_front *f, uint32_t slot) {
    const mni_front_node *p = &f->node[slot];
    mni_front_ref found;
    if (!is_long(f, slot)) {
        uint32_t mask = look(f, slot);
        return mask == 0 ? MN_NONE : f->ring.slot[__builtin_ctz(mask)];
    }
    const bool pole = is_pole(f, slot);
    if (!pole && witness_stands(f, p) && f->node[p->witness].order > p->order)
        return p->witness;
    if (split_blockers_far(f, slot, &found, 1) == 0)
        return MN_NONE;
    if (!pole)
        witness_set(f, slot, found.slot);
    return found.slot;
}

/* ---- collapses ------------------------------------------------------------------------------- */

/* MN_NONE: none blocks. The sibling's parent is the fork itself. */
static uint32_t collapse_blocker_far(mni_front *f, uint32_t slot, uint32_t order) {
    const mni_front_node *n = &f->node[slot];
    mni_front_ref found;
    if (is_pole(f, slot))
        return mni_pole_seek(f, slot, MN_NONE, order, &found, 1) > 0 ? found.slot : MN_NONE;
    if (is_long(f, slot) && witness_stands(f, n) && f->node[n->witness].above < order)
        return n->witness;
    for (mni_run r = mni_run_first(f, slot); r.corner != NULL; r = mni_run_next(f, r))
        for (uint32_t i = 0; i < r.room && r.corner[i] != 0; i++, mni_front_looks(f, 1))
            for (int k = 0; k < 2; k++) {
                uint32_t c = r.corner[i];
                uint32_t at = mni_corner_slot(f, k ? mni_corner_before(c) : mni_corner_after(c));
                if (f->node[at].above >= order)
                    continue;
                if (is_long(f, slot))
                    witness_set(f, slot, at);
                return at;
            }
    return MN_NONE;
}

void mni_front_look(const mni_front *f, uint32_t fork, mni_rings *rings) {
    const uint32_t *child = f->branch[fork].child;
    rings->is_none = is_long(f, child[0]) || is_long(f, child[1]);
    if (!rings->is_none)
        mni_ring_look(f, child[0], child[1], rings);
}

uint32_t mni_front_blocker_among(mni_front *f, uint32_t fork, const mni_rings *rings) {
    const mni_front_branch *b = &f->branch[fork];
    if (!rings->is_none)
        return mni_ring_block_collapse(f, rings, b->order);
    uint32_t found = collapse_blocker_far(f, b->child[0], b->order);
    return found != MN_NONE ? found : collapse_blocker_far(f, b->child[1], b->order);
}

uint32_t mni_front_collapse_blocker(mni_front *f, uint32_t fork) {
    mni_rings rings;
    mni_front_look(f, fork, &rings);
    return mni_front_blocker_among(f, fork, &rings);
}
