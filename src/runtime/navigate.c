/* A frame of Navigate: collapse what is not wanted, split what is, and give way when it cannot be.
 *
 * Hides: the order of work, chains of forced splits, and the level of degrading.
 *
 *   collapse pass   unwanted forks in rising order of their parent's id. One pass is complete: a
 *                   parent's id exceeds its children's, and what blocks a collapse has a lower one.
 *   split pass      wanted nodes, largest error first, each with the chain of neighbours that must
 *                   split before it. A chain is found by splitting, and undone in reverse when it
 *                   cannot be carried out whole. Children that are wanted join the agenda.
 *   level           when the wanted mesh did not fit, the tolerance rises a step for the next
 * frame, and falls a step when there is room. While the camera stands, a level that did not fit is
 * not tried again, so it ends.
 *
 * Order of calls: open; then frames, each followed by give_way. Threads: Navigate only. Memory:
 * from the arena, bounded by the room of the front. Paper: §3.3.1, §3.3.5; forced splits and
 * degrading: design.md §2 and §4. */
#include "navigate.h"

#include <math.h>
#include <string.h>

#include "assert.h"

enum { SMALL_TRIANGLES = 2000 };

/* ---- the agenda: a binary heap -----------------------------------------------------------------
 */

static bool before(const mni_navigator *nav, mni_agenda_item a, mni_agenda_item b) {
    return a.key != b.key ? a.key < b.key
                          : nav->front.node[a.slot].order < nav->front.node[b.slot].order;
}

static void agenda_push(mni_navigator *nav, uint32_t key, uint32_t slot) {
    MN_ASSERT(nav->agenda_count < nav->agenda_max);
    mni_agenda_item item = {key, slot};
    uint32_t at = nav->agenda_count++;
    for (uint32_t up; at > 0 && before(nav, item, nav->agenda[up = (at - 1) / 2]); at = up)
        nav->agenda[at] = nav->agenda[up];
    nav->agenda[at] = item;
}

static uint32_t agenda_pop(mni_navigator *nav) {
    MN_ASSERT(nav->agenda_count > 0);
    uint32_t top = nav->agenda[0].slot, count = --nav->agenda_count, at = 0;
    mni_agenda_item item = nav->agenda[count];
    for (uint32_t down; (down = 2 * at + 1) < count; at = down) {
        if (down + 1 < count && before(nav, nav->agenda[down + 1], nav->agenda[down]))
            down++;
        if (!before(nav, nav->agenda[down], item))
            break;
        nav->agenda[at] = nav->agenda[down];
    }
    nav->agenda[at] = item;
    return top;
}

/* ---- collapses ---------------------------------------------------------------------------------
 */

static uint64_t ops(const mni_navigator *nav) {
    return nav->work.splits + nav->work.collapses;
}

/* After every operation on models under 2,000 triangles, where slow checks are built in. */
static void check_small(const mni_navigator *nav) {
#ifdef MN_SLOW_CHECKS
    if (nav->front.header->triangles < SMALL_TRIANGLES)
        mni_front_check(&nav->front);
#else
    (void)nav;
#endif
}

static bool wanted(const mni_navigator *nav, uint32_t slot) {
    mni_bounds bounds = mni_front_bounds(&nav->front, slot);
    return !mni_front_is_leaf(&nav->front, slot) && mni_lens_wants(&nav->lens, &bounds);
}

/* The fork's parent, keyed by its order id, if it is a fork and not wanted. */
static void consider_fork(mni_navigator *nav, uint32_t pair) {
    if (!mni_front_is_fork(&nav->front, pair))
        return;
    uint32_t parent = nav->front.pair[pair].parent;
    if (!wanted(nav, parent))
        agenda_push(nav, nav->front.node[parent].order, parent);
}

static void collapse_pass(mni_navigator *nav) {
    mni_front *front = &nav->front;
    nav->agenda_count = 0;
    for (uint32_t pair = 0; pair < front->pairs_high; pair++)
        consider_fork(nav, pair);
    while (nav->agenda_count > 0) {
        uint32_t parent = agenda_pop(nav), pair = front->node[parent].pair;
        if (mni_front_collapse_blocker(front, pair) != MN_NONE) {
            nav->work.waits_dependency++;
            continue;
        }
        if (nav->ops_max > 0 && ops(nav) >= nav->ops_max) {
            nav->work.refused_budget++;
            continue;
        }
        uint32_t triangles = front->triangles;
        mni_outcome outcome = mni_front_collapse(front, pair);
        nav->work.triangles_removed += triangles - front->triangles;
        mni_store_attempt_over(front->store);
        check_small(nav);
        nav->work.collapses += outcome == MNI_DONE;
        nav->work.misses += outcome == MNI_MISS;
        nav->work.refused_pool += outcome == MNI_REFUSED_POOL;
        if (outcome == MNI_DONE)
            consider_fork(nav, parent >> 1);
    }
}

/* ---- chains of forced splits -------------------------------------------------------------------
 */

static void chain_undo(mni_navigator *nav, uint32_t count) {
    while (count > 0)
        mni_front_unsplit(&nav->front, nav->chain[--count]);
    check_small(nav);
}

/* Puts what must split before slot on the stack: the known witness alone, or all, half the room at
 * most, so that depth always has the other half. Returns how many. */
static uint32_t push_blockers(mni_navigator *nav, uint32_t slot, uint32_t top) {
    uint32_t witness = mni_front_split_blocker(&nav->front, slot);
    if (witness == MN_NONE || top == MNI_STACK_MAX)
        return 0;
    nav->stack[top] = witness;
    uint32_t room = top < MNI_STACK_MAX / 2 ? MNI_STACK_MAX / 2 - top : 1;
    uint32_t all =
        room > 1 ? mni_front_split_blockers(&nav->front, slot, nav->stack + top, room) : 1;
    return all;
}

/* Splits slot and, before it, what must be split before it; whole, or not at all. *count: splits in
 * nav->chain. No recursion: order ids rise along the stack, so that it ends. */
static mni_outcome chain_find(mni_navigator *nav, uint32_t slot, uint32_t *count) {
    mni_front *front = &nav->front;
    mni_outcome outcome = MNI_DONE;
    uint32_t top = 1;
    nav->stack[0] = slot;
    *count = 0;
    while (top > 0 && outcome == MNI_DONE) {
        uint32_t at = nav->stack[top - 1];
        if (!mni_front_is_active(front, at)) { /* another way has split it */
            top--;
            continue;
        }
        uint32_t pushed = push_blockers(nav, at, top);
        if (pushed > 0) {
            top += pushed;
        } else if (top == MNI_STACK_MAX || *count == nav->chain_max) {
            outcome = MNI_REFUSED_FRONT;
        } else if (nav->ops_max > 0 && ops(nav) > 0 && ops(nav) + *count >= nav->ops_max) {
            outcome = MNI_REFUSED_BUDGET;
        } else {
            outcome = mni_front_split(front, at);
            if (outcome == MNI_DONE) {
                nav->chain[(*count)++] = at;
                top--;
                check_small(nav);
            }
        }
    }
    if (outcome != MNI_DONE)
        chain_undo(nav, *count);
    mni_store_attempt_over(front->store);
    return outcome;
}

/* ---- splits ------------------------------------------------------------------------------------
 */

/* Larger errors first: positive floats compare as their bits do. */
static uint32_t split_key(double priority_px) {
    float value = priority_px < 1e30 ? (float)priority_px : 1e30f;
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return UINT32_MAX - bits;
}

static void consider_split(mni_navigator *nav, uint32_t slot) {
    if (!wanted(nav, slot))
        return;
    mni_bounds bounds = mni_front_bounds(&nav->front, slot);
    agenda_push(nav, split_key(mni_lens_priority(&nav->lens, &bounds)), slot);
}

static void split_agenda(mni_navigator *nav, bool forget_given_up) {
    nav->agenda_count = 0;
    for (uint32_t slot = 0; slot < 2 * nav->front.pairs_high; slot++) {
        if (!mni_front_is_active(&nav->front, slot))
            continue;
        if (forget_given_up)
            nav->front.node[slot].flags &= (uint16_t)~MNI_NODE_GIVEN_UP;
        consider_split(nav, slot);
    }
}

static void refuse(mni_navigator *nav, uint32_t slot, mni_outcome outcome) {
    switch (outcome) {
    case MNI_MISS:
    case MNI_BAD:
        nav->work.misses++;
        break;
    case MNI_REFUSED_POOL:
        nav->front.node[slot].flags |= MNI_NODE_GIVEN_UP;
        nav->work.refused_pool++;
        nav->work.refused_split = true;
        break;
    case MNI_REFUSED_FRONT:
        nav->work.refused_front++;
        nav->work.refused_split = true;
        break;
    case MNI_REFUSED_BUDGET:
        nav->work.refused_budget++;
        break;
    case MNI_DONE:
    case MNI_OUTCOMES:
        MN_ASSERT(false);
    }
}

static void split_pass(mni_navigator *nav) {
    mni_front *front = &nav->front;
    uint64_t epoch = mni_store_epoch(front->store);
    bool again = nav->moved || front->version != nav->version || epoch != nav->epoch;
    nav->epoch = epoch;
    split_agenda(nav, again);
    mni_outcome closed = MNI_DONE; /* front or budget: whoever comes after is refused unseen */
    while (nav->agenda_count > 0) {
        uint32_t slot = agenda_pop(nav), count, triangles = front->triangles;
        if (!mni_front_is_active(front, slot)) /* forced by another */
            continue;
        mni_outcome outcome = closed;
        if (closed == MNI_DONE)
            outcome = front->node[slot].flags & MNI_NODE_GIVEN_UP ? MNI_REFUSED_POOL
                                                                  : chain_find(nav, slot, &count);
        if (outcome != MNI_DONE) {
            refuse(nav, slot, outcome);
            if (outcome == MNI_REFUSED_FRONT || outcome == MNI_REFUSED_BUDGET)
                closed = outcome;
            continue;
        }
        for (uint32_t i = 0; i < count; i++)
            mni_front_release(front, nav->chain[i]);
        nav->work.splits += count;
        nav->work.triangles_made += front->triangles - triangles;
        for (uint32_t i = 0; i < count; i++) {
            uint32_t pair = front->node[nav->chain[i]].pair;
            for (uint32_t child = 2 * pair; child < 2 * pair + 2; child++)
                if (mni_front_is_active(front, child))
                    consider_split(nav, child);
        }
    }
    nav->version = front->version;
}

/* ---- degrading ---------------------------------------------------------------------------------
 */

void mni_navigator_give_way(mni_navigator *nav, bool reading) {
    nav->settled_level = true;
    if (!nav->degrades)
        return;
    if (nav->moved)
        nav->failed = -1;
    if (nav->hold > 0)
        nav->hold--;
    if (nav->work.refused_split) {
        nav->failed = nav->level > nav->failed ? nav->level : nav->failed;
        nav->hold = MNI_HOLD_FRAMES;
        if (nav->level < MNI_LEVEL_MAX) {
            nav->level++;
            nav->settled_level = false;
        }
    } else if (nav->level > 0 && nav->level - 1 > nav->failed) {
        nav->settled_level = false;
        /* first what this level wants must stand, or it is unknown whether there is room */
        bool busy = reading || ops(nav) > 0 || nav->work.refused_budget > 0;
        if ((nav->moved || !busy) && nav->hold == 0)
            nav->level--;
    }
}

/* ---- a frame -----------------------------------------------------------------------------------
 */

void mni_navigator_frame(mni_navigator *nav, const mn_camera *camera, double tolerance_px) {
    nav->moved = memcmp(&nav->camera, camera, sizeof *camera) != 0 ||
                 memcmp(&nav->tolerance_px, &tolerance_px, sizeof tolerance_px) != 0;
    nav->camera = *camera;
    nav->tolerance_px = tolerance_px;
    double used_px = tolerance_px * exp2((double)nav->level / MNI_LEVELS_A_DOUBLING);
    bool same = nav->lens.tolerance_px == used_px;
    mni_lens_make(&nav->lens, camera, nav->width_px, nav->height_px, nav->size, used_px);
    nav->work = (mni_work){0};
    bool moved = nav->moved;
    nav->moved |= !same; /* chains that were given up may go through at another level */
    collapse_pass(nav);
    split_pass(nav);
    nav->moved = moved;
}

double mni_navigator_error_px(const mni_navigator *nav) {
    double most = 0;
    for (uint32_t slot = 0; slot < 2 * nav->front.pairs_high; slot++) {
        if (!mni_front_is_active(&nav->front, slot))
            continue;
        mni_bounds bounds = mni_front_bounds(&nav->front, slot);
        double error_px = mni_lens_error_px(&nav->lens, &bounds);
        if (error_px > most && mni_lens_inside(&nav->lens, &bounds) &&
            !mni_lens_away(&nav->lens, &bounds))
            most = error_px;
    }
    return most;
}

double mni_navigator_front_over_wanted(const mni_navigator *nav) {
    uint64_t nodes = 0;
    for (uint32_t slot = 0; slot < 2 * nav->front.pairs_high; slot++)
        nodes += (nav->front.node[slot].flags & MNI_NODE_EXPANDED) && wanted(nav, slot);
    uint32_t roots = nav->front.header->roots;
    return (double)nav->front.active / (double)(nodes + roots);
}

/* ---- open --------------------------------------------------------------------------------------
 */

static uint32_t chain_room(uint32_t nodes_max) {
    return nodes_max < MNI_CHAIN_MAX ? nodes_max : MNI_CHAIN_MAX;
}

size_t mni_navigator_need_bytes(const mn_header *header, uint32_t nodes_max,
                                uint32_t simplices_max) {
    return mni_front_need_bytes(header, nodes_max, simplices_max) +
           mni_arena_need(2 * (size_t)nodes_max, sizeof(mni_agenda_item), 64) +
           mni_arena_need(MNI_STACK_MAX, sizeof(uint32_t), 64) +
           mni_arena_need(chain_room(nodes_max), sizeof(uint32_t), 64);
}

mn_code mni_navigator_open(mni_navigator *nav, mni_store *store, const mn_header *header,
                           uint32_t nodes_max, uint32_t simplices_max, mni_arena *arena,
                           mn_status *st) {
    nav->agenda_max = 2 * nodes_max;
    nav->chain_max = chain_room(nodes_max);
    nav->agenda = mni_arena_take(arena, nav->agenda_max, sizeof *nav->agenda, 64);
    nav->stack = mni_arena_take(arena, MNI_STACK_MAX, sizeof *nav->stack, 64);
    nav->chain = mni_arena_take(arena, nav->chain_max, sizeof *nav->chain, 64);
    nav->failed = -1;
    return mni_front_open(&nav->front, store, header, nodes_max, simplices_max, arena, st);
}
