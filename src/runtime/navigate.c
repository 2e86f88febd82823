/* A frame of Navigate: collapse what is not wanted, split what is, and give way when it cannot be.
 *
 * Hides: the order of work, and the level of degrading.
 *
 *   collapse pass   what is not wanted, as far as it is free to go (collapse.h)
 *   split pass      wanted nodes, largest error first (in a large front with room and no budget to
 *                   within half a doubling, there by place), each with the chain of neighbours that
 *                   must split before it (chain.h). Children that are wanted join the agenda.
 *   rounds          in a long frame what it has missed is read meanwhile, and tried again
 *   early splits    what the camera, extrapolated, will want three frames on, while there is room,
 *                   and until the frame has done more than frames usually do
 *   foresight       blocks that it will want later, likewise
 *   level           when the wanted mesh did not fit, the tolerance rises a step for the next
 *                   frame, and falls a step when there is room. While the camera stands, a level
 *                   that did not fit is not tried again, so it ends.
 *
 * Order of calls: open; then frames, each followed by give_way. Threads: Navigate only. Memory:
 * from the arena, bounded by the room of the front. Paper: §3.3.1, §3.3.5; forced splits and
 * degrading: design.md §2 and §4. */
#include "navigate.h"

#include <math.h>
#include <string.h>

#include "chain.h"
#include "collapse.h"
#include "mn_assert.h"
#include "refusals.h"
#include "split_key.h"
#include "verdict.h"

enum { FETCHED = 12, PASSED = 64 }; /* nodes to split, in so many */
enum { REFUSED_CROWD_SHARE = 4 };   /* of the front's nodes: refused ones, if they are many */

/* × the largest coordinate: margins of a hundredth of that are 9 bits yet */
#define CLOCK_MAX 1000
/* For later frames one does something if it has not done more for itself than EFFORT_START of what
 * frames do on average, and a few operations; early splits until all is EFFORT_MAX of that: 2.5
 * made the longest frames of dives a tenth longer for a third fewer misses, of 0.03 %. */
#define EFFORT_START 1.5
#define EFFORT_MAX 1.75
enum { EFFORT_LEAST = 16, EFFORT_FRAMES = 8 };
#define OP_SECONDS 5e-7    /* that an operation takes, about: of a simulated disk's time */
#define BARRED 0x80000000u /* in an item of the agenda: a bit of no slot */

/* ---- splits ---------------------------------------------------------------------------------- */

/* See split_key.h. In a crowd by place as well, so that neighbours, and nodes of one block, have
 * their turn one after the other. */
static uint32_t split_key(const mni_navigator *nav, double priority_px, uint32_t slot) {
    if (!nav->by_place)
        return mni_split_key(priority_px);
    return mni_split_key_by_place(priority_px, nav->lens.tolerance_px,
                                  nav->front.node[slot].leaf_lo >> nav->place_shift);
}

/* The error of a key, or somewhat above. */
static double key_px(const mni_navigator *nav, uint32_t key) {
    return nav->by_place ? mni_split_key_by_place_px(key, nav->lens.tolerance_px)
                         : mni_split_key_px(key);
}

static bool wanted(const mni_navigator *nav, uint32_t slot, mni_agenda_item *item) {
    mni_bounds bounds = mni_front_bounds(&nav->front, slot);
    double priority_px;
    const mni_lens *lens = nav->early_splits ? &nav->ahead.soon.lens : &nav->lens;
    const mni_sieve *sieve = nav->early_splits ? &nav->ahead.soon.sieve : &nav->sieve;
    /* leaves, which are nearly never wanted anyway, last: who is one nobody can guess */
    if (!mni_sieve_wants(sieve, lens, &bounds, &priority_px) ||
        mni_front_is_leaf(&nav->front, slot))
        return false;
    *item = (mni_agenda_item){nav->front.node[slot].order, split_key(nav, priority_px, slot), slot};
    return true;
}

static bool item_stands(const void *context, mni_agenda_item item) {
    return mni_front_stands(context, (mni_front_ref){item.what & ~BARRED, item.order});
}

/* A node is considered once, when the pass begins or when it comes to be; those that still stand
 * are no more than the front's room. */
static void consider_split(mni_navigator *nav, uint32_t slot) {
    mni_agenda_item item;
    if (!wanted(nav, slot, &item))
        return;
    if (mni_agenda_is_full(&nav->agenda))
        mni_agenda_keep(&nav->agenda, item_stands, &nav->front);
    mni_agenda_push(&nav->agenda, item);
}

/* Who has been refused is marked: as long as he is wanted for sure, and refused, he need not be
 * looked at. Where splits go by place the list would not be in order. */
static mni_agenda_item may_bar(mni_navigator *nav, mni_agenda_item item, uint8_t verdict,
                               float margin) {
    const float due = mni_due_after(nav, margin);
    if (verdict != MNI_WANTED || due <= nav->clock || nav->by_place ||
        !mni_refusals_has(nav, item.what))
        return item;
    mni_barred_mark(&nav->barred, item.what, due);
    item.what |= BARRED;
    return item;
}

/* Those of a batch of slots that are wanted, onto the agenda; those that are not and will be in a
 * moment, on the list for later. */
static void judge_slots(mni_navigator *nav, const uint32_t *slot, int count) {
    uint8_t verdict[MNI_SIEVE_BATCH], soon[MNI_SIEVE_BATCH];
    float margin[MNI_SIEVE_BATCH], soon_margin[MNI_SIEVE_BATCH];
    mni_agenda_item item;
    mni_sieve_judge(&nav->sieve, &nav->batch, verdict, margin);
    mni_judge_soon(nav, soon, soon_margin);
    for (int i = 0; i < count; i++) {
        const bool splits =
            mni_front_is_active(&nav->front, slot[i]) && !mni_front_is_leaf(&nav->front, slot[i]);
        const bool far = verdict[i] == MNI_UNWANTED && soon[i] == MNI_UNWANTED;
        float due = far ? mni_due_after(nav, mni_nearer(margin[i], soon_margin[i])) : MNI_DUE_NOW;
        nav->slot_due[slot[i]] = splits ? due : MNI_DUE_NEVER;
        if (far || !splits)
            continue;
        if (verdict[i] != MNI_UNWANTED && wanted(nav, slot[i], &item))
            mni_agenda_add(&nav->agenda, may_bar(nav, item, verdict[i], margin[i]));
        else if (soon[i] != MNI_UNWANTED && nav->soon_count < MNI_SOON_MAX)
            nav->soon[nav->soon_count++] = slot[i];
    }
}

/* Slots of a batch whose next look is due and that are not simply too far away. Who is in no slot,
 * or a leaf, has the bounds of whoever was, and is asked for when wanted. The front has room for
 * whole batches. */
static uint64_t slots_due(mni_navigator *nav, uint32_t first) {
    const mni_front *f = &nav->front;
    const mni_sieve *soon = nav->early ? &nav->ahead.soon.sieve : NULL;
    float *due = &nav->slot_due[first], margin[MNI_SIEVE_BATCH];
    uint64_t late = mni_sieve_late(due, nav->clock), near = 0;
    late &= ~mni_barred_bits(&nav->barred, first);
    if (late == 0)
        return 0;
    mni_sieve_far(&nav->sieve, soon, &f->position[3 * (size_t)first], &f->radius[first],
                  &f->switch_value[first], margin);
    for (; late != 0; late &= late - 1) {
        int i = __builtin_ctzll(late);
        due[i] = mni_due_after(nav, margin[i]);
        near |= (uint64_t)(margin[i] <= 0) << i;
    }
    return near;
}

static void split_agenda(mni_navigator *nav) {
    const mni_front *f = &nav->front;
    uint32_t slot[MNI_SIEVE_BATCH];
    int count = 0;
    mni_agenda_clear(&nav->agenda);
    nav->soon_count = 0;
    for (uint32_t first = 0; first < f->slots_high; first += MNI_SIEVE_BATCH)
        for (uint64_t bits = slots_due(nav, first); bits != 0; bits &= bits - 1) {
            uint32_t at = first + (uint32_t)__builtin_ctzll(bits);
            if (at >= f->slots_high)
                break;
            mni_front_fetch_node(f, at);
            mni_sieve_put(&nav->batch, count, &f->position[3 * (size_t)at], f->radius[at],
                          f->switch_value[at], f->face[at].cone);
            slot[count++] = at;
            if (count < MNI_SIEVE_BATCH)
                continue;
            judge_slots(nav, slot, count);
            count = 0;
        }
    judge_slots(nav, slot, count);
    mni_agenda_begin(&nav->agenda);
}

/* Errors fall: the first that finds no room is the largest, and who comes after many is no larger
 * than any of them. In a front of a few nodes one is many, but the first is never: whether there
 * is one tells that something finds no room. */
static void no_room(mni_navigator *nav, mni_agenda_item item) {
    mni_work *work = &nav->work;
    const uint64_t before = work->refused_pool + work->refused_front;
    const bool crowd = work->refused.px > 0 && before >= nav->front.active / REFUSED_CROWD_SHARE;
    mni_level_refused *refused = crowd ? &work->crowd : &work->refused;
    if (refused->px > 0)
        return;
    const mni_bounds node = mni_front_bounds(&nav->front, item.what);
    refused->px = key_px(nav, item.key);
    refused->away = mni_lens_nearest(&nav->lens, &node) / mni_lens_distance_min(nav->size);
}

static void refuse(mni_navigator *nav, mni_agenda_item item, mni_outcome outcome) {
    if (outcome == MNI_REFUSED_POOL || outcome == MNI_REFUSED_FRONT)
        no_room(nav, item);
    switch (outcome) {
    case MNI_MISS:
    case MNI_BAD:
        nav->work.misses++;
        MNI_TRACE_MISS(0, outcome == MNI_BAD);
        break;
    case MNI_REFUSED_POOL:
        nav->work.refused_pool++;
        break;
    case MNI_REFUSED_FRONT:
        nav->work.refused_front++;
        break;
    case MNI_REFUSED_BUDGET:
        nav->work.refused_budget++;
        break;
    case MNI_DONE:
    case MNI_OUTCOMES:
        MN_ASSERT(false);
    }
}

/* Finds a chain and remembers what it was refused for, which is sought where places are scarce. */
static mni_outcome chain_try(mni_navigator *nav, uint32_t slot, uint32_t *count) {
    const bool refused = mni_refusals_stands(nav, slot);
    mni_outcome outcome = refused ? MNI_REFUSED_POOL : MNI_MISS;
    if (!refused && !mni_refusals_lacks(nav, slot)) {
        nav->front.node[slot].flags &= 7 & ~MNI_NODE_GIVEN_UP;
        outcome = mni_chain_find(nav, slot, count);
        if (outcome != MNI_REFUSED_POOL)
            return outcome;
        mni_refusals_put(nav, slot);
    }
    mni_refusals_seek(nav, &nav->refusal[slot]);
    return outcome;
}

/* What the next splits of those that were wanted from the start will touch, is asked for, but for
 * those that stand refused. Returns up to where, in the agenda. */
static uint32_t fetch_ahead(mni_navigator *nav) {
    mni_front *front = &nav->front;
    uint32_t left = PASSED, at = 0, count = 0, slot[FETCHED];
    const mni_agenda_item *next = mni_agenda_ahead(&nav->agenda, &left);
    for (; at < left && count < FETCHED; at++) {
        slot[count] = next[at].what;
        count += (next[at].what & BARRED) == 0;
    }
    for (uint32_t i = 0; i < count; i++)
        mni_front_fetch_node(front, slot[i]);
    for (uint32_t i = 0; i < count; i++)
        mni_front_fetch_simplices(front, slot[i], true);
    for (uint32_t i = 0; i < count; i++)
        __builtin_prefetch(&front->branch[front->node[slot[i]].parent]);
    for (uint32_t i = 0; i < count; i++)
        mni_front_fetch_ring(front, slot[i]);
    for (uint32_t i = 0; i < count; i++)
        mni_front_fetch_record(front, slot[i]);
    return nav->agenda.next + at;
}

/* The slot of a child, or that its leftmost descendant has. */
static inline uint32_t first_slot(const mni_front *front, uint32_t child) {
    return child & MNI_FRONT_BRANCH ? front->branch[child & ~MNI_FRONT_BRANCH].slot : child;
}

/* A split stays: who waited for its node is looked at in the next frame, its parent is no fork and
 * waits no more, and its children are new. Returns whether they may be wanted: not where the node,
 * by a verdict that stands, was not and has been forced; of those children that have been split in
 * turn the same is then known. */
static bool keep_split(mni_navigator *nav, uint32_t branch) {
    const mni_front *front = &nav->front;
    const mni_front_branch *b = &front->branch[branch];
    uint32_t fork;
    mni_barred_drop(&nav->barred, b->slot);
    float due = nav->slot_due[b->slot];
    MNI_TRACE_OFTEN(MN_TRACE_SPLIT, mni_store_block_id(front->store, b->home));
    mni_front_release(&nav->front, branch);
    while ((fork = mni_waiting_wake(&nav->waiting, b->slot, MN_NONE)) != MN_NONE)
        nav->fork_due[fork] = MNI_DUE_NOW;
    if (b->parent != MNI_FRONT_NO_PARENT)
        mni_waiting_drop(&nav->waiting, b->parent);
    nav->fork_due[branch] = MNI_DUE_NOW;
    for (int side = 0; side < 2; side++) {
        bool is_split = (b->child[side] & MNI_FRONT_BRANCH) != 0;
        nav->slot_due[first_slot(front, b->child[side])] = is_split ? due : MNI_DUE_NOW;
    }
    return due <= nav->clock;
}

/* The splits of a chain stay, made when there were so many triangles; their children that are
 * wanted are to be split. */
static void keep_chain(mni_navigator *nav, uint32_t count, uint32_t triangles) {
    const mni_front *front = &nav->front;
    uint32_t parents = 0; /* of children that may be wanted, at the front of the chain */
    nav->work.splits += count;
    nav->work.triangles_made += front->triangles - triangles;
    for (uint32_t i = 0; i < count; i++) {
        nav->chain[parents] = nav->chain[i];
        parents += keep_split(nav, nav->chain[i]);
    }
    for (uint32_t i = 0; i < parents; i++)
        for (int side = 0; side < 2; side++) {
            uint32_t child = front->branch[nav->chain[i]].child[side];
            if ((child & MNI_FRONT_BRANCH) == 0)
                consider_split(nav, child);
        }
}

/* Who lacked a block in a turn before, and have another one. */
typedef struct turn_before {
    uint32_t count;
    mni_missed missed[MNI_LISTED_MAX];
} turn_before;

/* What the node of an item lacked then. false: it had no turn. */
static bool lacked_before(const turn_before *before, mni_agenda_item item) {
    for (uint32_t i = 0; before != NULL && i < before->count; i++) {
        const mni_missed *missed = &before->missed[i];
        if (missed->item.what != item.what || missed->item.order != item.order)
            continue;
        mni_trace_lacks(missed->block_id);
        return true;
    }
    return false;
}

/* Puts a miss on the list of those that have another turn in this frame. false: there is none. */
static bool list_missed(mni_navigator *nav, mni_agenda_item item) {
    if (!nav->early || nav->missed_count == MNI_LISTED_MAX)
        return false;
    nav->missed[nav->missed_count++] = (mni_missed){item, mni_trace_absent()};
    return true;
}

/* Whoever is barred and has his turn before the agenda's next is refused as he was, or, if he
 * would be no longer, is the item whose turn it is. */
static bool barred_turn(mni_navigator *nav, mni_outcome closed, mni_agenda_item *item) {
    const uint64_t rank = mni_agenda_first(&nav->agenda);
    const mni_barred_node *next;
    while ((next = mni_barred_next(&nav->barred, rank)) != NULL) {
        if (closed == MNI_DONE && !mni_refusals_stands_barred(nav, next)) {
            *item = next->item;
            mni_barred_drop(&nav->barred, item->what);
            return true;
        }
        if (closed == MNI_DONE)
            mni_refusals_seek(nav, &next->refusal);
        refuse(nav, next->item, closed == MNI_DONE ? MNI_REFUSED_POOL : closed);
        mni_barred_keep(&nav->barred, next);
    }
    return false;
}

/* An item that was marked has had its turn. */
static void barred_put(mni_navigator *nav, mni_agenda_item item, mni_outcome outcome) {
    if (!mni_barred_has(&nav->barred, item.what))
        return;
    if (outcome == MNI_REFUSED_POOL && nav->refusal[item.what].block_id != 0)
        mni_barred_add(&nav->barred, item, nav->refusal[item.what]);
    else
        mni_barred_drop(&nav->barred, item.what);
}

/* All that is on the agenda or barred, and what comes to be wanted by it. counts: whoever cannot be
 * split has no other turn in this frame, but for those on the list. before: who had one; NULL:
 * nobody. */
static void splits_make(mni_navigator *nav, bool counts, const turn_before *before) {
    mni_front *front = &nav->front;
    mni_outcome closed = MNI_DONE; /* front or budget: whoever comes after is refused unseen */
    mni_agenda_item item;
    uint32_t fetched = 0; /* up to there, of the agenda's sorted items */
    for (;;) {
        if (nav->agenda.next >= fetched)
            fetched = fetch_ahead(nav);
        if (!barred_turn(nav, closed, &item) && !mni_agenda_pop(&nav->agenda, &item))
            break;
        if (closed == MNI_DONE && mni_refusals_wait(nav, item))
            continue;
        if (!item_stands(front, item)) /* forced by another */
            continue;
        item.what &= ~BARRED;
        const uint32_t slot = item.what, triangles = front->triangles;
        uint32_t count = 0;
        mni_outcome outcome = closed;
        if (closed == MNI_DONE)
            outcome = chain_try(nav, slot, &count);
        else if ((item.key & MNI_PUT_OFF) != 0 || lacked_before(before, item))
            outcome = MNI_MISS; /* in its turn it was its block that was absent */
        barred_put(nav, item, outcome);
        keep_chain(nav, count, triangles);
        if (closed == MNI_DONE && outcome == MNI_MISS && nav->there_only) {
            mni_refusals_put_off(nav, item);
            continue;
        }
        const bool listed = outcome == MNI_MISS && list_missed(nav, item);
        if (outcome != MNI_DONE && !listed && counts)
            refuse(nav, item, outcome);
        if (outcome == MNI_REFUSED_FRONT || outcome == MNI_REFUSED_BUDGET)
            closed = outcome;
    }
    mni_refusals_end(nav);
    nav->version = front->version;
}

static void split_pass(mni_navigator *nav) {
    nav->missed_count = 0;
    mni_refusals_begin(nav);
    mni_barred_begin(&nav->barred, nav->clock, nav->frame);
    split_agenda(nav);
    splits_make(nav, true, NULL);
}

/* ---- rounds ---------------------------------------------------------------------------------- */

/* What has been missed is read while something else is done, if that takes longer than to wake I/O:
 * it takes so many operations. */
static void round_begin(mni_navigator *nav, double ops) {
    nav->posted = -1;
    if (nav->missed_count == 0 || ops < nav->round_ops)
        return;
    mni_store_post(nav->front.store);
    nav->posted = mni_navigator_effort(nav);
}

/* Those that lacked a block have another turn. */
static void missed_again(mni_navigator *nav, bool counts) {
    turn_before before = {.count = nav->missed_count};
    memcpy(before.missed, nav->missed, before.count * sizeof *before.missed);
    nav->missed_count = 0;
    mni_refusals_begin(nav);
    mni_agenda_clear(&nav->agenda);
    for (uint32_t i = 0; i < before.count; i++)
        if (item_stands(&nav->front, before.missed[i].item))
            consider_split(nav, before.missed[i].item.what);
    splits_make(nav, counts, &before);
}

/* Has there been a round, in which something may have come? */
static bool round_end(mni_navigator *nav) {
    if (nav->posted < 0)
        return false;
    mni_store_meanwhile(nav->front.store, (mni_navigator_effort(nav) - nav->posted) * OP_SECONDS);
    nav->posted = -1;
    return true;
}

/* What the frame before missed and has come since goes on first of all, so that what it lacks next
 * is read while the frame begins. The pass of splits comes to it again. */
static void missed_first(mni_navigator *nav) {
    if (!nav->early || nav->missed_count == 0 || nav->usual < 2 * nav->round_ops)
        return;
    MNI_TRACE(MN_TRACE_PHASE, MN_TRACE_SPLITS, 0, 0);
    missed_again(nav, false);
    round_begin(nav, nav->usual);
}

/* Who has had his last turn. */
static void count_missed(mni_navigator *nav) {
    for (uint32_t i = 0; i < nav->missed_count; i++) {
        mni_trace_lacks(nav->missed[i].block_id);
        refuse(nav, nav->missed[i].item, MNI_MISS);
    }
}

/* ---- early splits ---------------------------------------------------------------------------- */

/* Whoever has been found to be wanted in a moment, when what is wanted now was looked for. */
static void early_agenda(mni_navigator *nav) {
    mni_agenda_item item;
    mni_agenda_clear(&nav->agenda);
    for (uint32_t i = 0; i < nav->soon_count; i++) {
        const uint32_t slot = nav->soon[i];
        if (!mni_front_is_active(&nav->front, slot) || !wanted(nav, slot, &item))
            continue;
        mni_agenda_add(&nav->agenda, item);
    }
    mni_agenda_begin(&nav->agenda);
}

double mni_navigator_fill(const mni_navigator *nav) {
    const mni_front *f = &nav->front;
    double share =
        fmax((double)f->active / f->nodes_max, (double)f->simplices_used / f->simplices_max);
    if (nav->triangles_max > 0)
        share = fmax(share, (double)f->triangles / (double)nav->triangles_max);
    return fmax(share, mni_store_fill(f->store));
}

/* What the camera will want in a moment is split as far as there are blocks and room, and stays: so
 * what is absent is known before it is missed, whatever forces it, and nothing is done twice. There
 * is time for it: what would make this frame one of the longest is left to the next one. */
static void early_pass(mni_navigator *nav) {
    mni_front *front = &nav->front;
    mni_agenda_item item;
    uint32_t fetched = 0, count;
    nav->early_splits = true;
    early_agenda(nav);
    mni_lacking_forget(&nav->lacking); /* what else those chains lack is to be told now */
    mni_store_early(front->store, MNI_AHEAD_SOON);
    for (;;) {
        if (nav->agenda.next >= fetched)
            fetched = fetch_ahead(nav);
        if (!mni_agenda_pop(&nav->agenda, &item) || mni_navigator_effort(nav) >= nav->effort_max ||
            mni_navigator_fill(nav) >= MNI_EARLY_FILL)
            break;
        const uint32_t triangles = front->triangles;
        if (!item_stands(front, item))
            continue;
        const mni_outcome outcome = mni_chain_find(nav, item.what, &count);
        keep_chain(nav, count, triangles);
        if (outcome != MNI_DONE && outcome != MNI_MISS)
            break;
    }
    mni_store_early(front->store, 0);
    nav->early_splits = false;
    nav->version = front->version;
}

/* For later frames: early splits, then foresight, for which a long frame has no time. With a budget
 * no frame is longer than the others. */
static void look_forward(mni_navigator *nav) {
    const bool brief = nav->ops_max == 0;
    const double start = EFFORT_START * nav->usual + EFFORT_LEAST;
    nav->effort_max = EFFORT_MAX * nav->usual + EFFORT_LEAST;
    if (nav->early && mni_navigator_effort(nav) < start) {
        MNI_TRACE(MN_TRACE_PHASE, MN_TRACE_EARLY_SPLITS, 0, 0);
        round_begin(nav, nav->usual - mni_navigator_effort(nav));
        early_pass(nav);
        if (round_end(nav))
            missed_again(nav, true);
    }
    if (mni_navigator_effort(nav) < nav->effort_max / (brief ? 2 : 1)) {
        MNI_TRACE(MN_TRACE_PHASE, MN_TRACE_FORESIGHT, 0, 0);
        mni_ahead_scan(&nav->ahead, &nav->front, &nav->barred, nav->clock);
    }
    nav->usual += (mni_navigator_effort(nav) - nav->usual) / EFFORT_FRAMES;
}

/* ---- degrading ------------------------------------------------------------------------------- */

void mni_navigator_give_way(mni_navigator *nav, bool reading) {
    const mni_work *work = &nav->work;
    bool over = nav->triangles_max > 0 && nav->front.triangles > nav->triangles_max;
    bool ops = mni_navigator_ops(nav) > 0, waits = reading || work->refused_budget > 0;
    bool busy = waits || (ops && work->misses > 0); /* a bad block is missed for ever */
    mni_level_signs signs = {.moved = nav->moved,
                             .full = over || work->refused.px > 0,
                             .stale = (waits || ops) && work->refused_collapse,
                             .busy = busy,
                             .from_scratch = work->splits > nav->front.active / 2,
                             .refused = work->refused,
                             .crowd = work->crowd,
                             .box_away = nav->box_away,
                             .fill = mni_navigator_fill(nav)};
    if (nav->degrades && nav->tolerance_px > 0)
        mni_level_next(&nav->level, nav->tolerance_px, &signs);
}

/* ---- a frame --------------------------------------------------------------------------------- */

/* The clock of motion, which begins again where it cannot tell how much has changed, or would get
 * too large for single precision: then everything is due. */
static void clock_advance(mni_navigator *nav, double motion) {
    double clock = (double)nav->clock + motion;
    if (clock < CLOCK_MAX * (double)nav->coordinate_max) {
        nav->clock = nextafterf((float)clock, INFINITY);
        return;
    }
    nav->clock = 0;
    mni_barred_clear(&nav->barred);
    for (uint32_t i = 0; i < nav->front.slots_high; i++)
        nav->fork_due[i] = MNI_DUE_NOW;
    for (uint32_t i = 0; i < nav->front.slots_high; i++)
        nav->slot_due[i] = MNI_DUE_NOW;
}

double mni_navigator_to_box(const mni_navigator *nav, const double eye[3]) {
    const mn_header *h = nav->front.header;
    double square = 0;
    for (int i = 0; i < 3; i++) {
        const double below = (double)h->box_min[i] - eye[i], above = eye[i] - (double)h->box_max[i];
        const double off = fmax(fmax(below, above), 0);
        square += off * off;
    }
    return sqrt(square);
}

/* The largest power of two that the eye is away from the model's box, in least distances. A power
 * of two, since whoever has been judged is judged again when the least distance changes. */
static double box_away(const mni_navigator *nav, const mn_camera *camera) {
    const double eye[3] = {camera->eye[0], camera->eye[1], camera->eye[2]};
    const double away = mni_navigator_to_box(nav, eye) / mni_lens_distance_min(nav->size);
    return away > 1 ? exp2(floor(log2(away))) : 1;
}

void mni_navigator_frame(mni_navigator *nav, const mn_camera *camera, double tolerance_px) {
    const bool moved_before = nav->ahead.look.moves, early_before = nav->early;
    nav->moved = memcmp(&nav->camera, camera, sizeof *camera) != 0 ||
                 memcmp(&nav->tolerance_px, &tolerance_px, sizeof tolerance_px) != 0;
    nav->camera = *camera;
    if (nav->tolerance_px != tolerance_px)
        mni_level_asked(&nav->level, nav->tolerance_px, tolerance_px);
    nav->tolerance_px = tolerance_px;
    double used_px = mni_level_tolerance(&nav->level, tolerance_px);
    nav->box_away = box_away(nav, camera);
    const double least = mni_lens_distance_min(nav->size) *
                         mni_level_reach(&nav->level, tolerance_px, nav->box_away);
    bool same = nav->lens.tolerance_px == used_px;
    mni_lens before = nav->lens;
    mni_lens_make(&nav->lens, camera, nav->width_px, nav->height_px, least, used_px, &nav->weights);
    mni_sieve_make(&nav->sieve, &nav->lens, nav->coordinate_max);
    double motion = mni_sieve_motion(&before, &nav->lens, (double)nav->coordinate_max);
    if (nav->looks_ahead) {
        mni_ahead_begin(&nav->ahead, camera, &nav->lens, nav->width_px, nav->height_px, nav->size,
                        &nav->weights, nav->coordinate_max);
        if (nav->moved || !same || moved_before)
            mni_store_look(nav->front.store, &nav->ahead.look);
    }
    /* with a budget, or where there was no room, it is the error that decides, to the last bit */
    nav->by_place = nav->ops_max == 0 && nav->triangles_max == 0 && nav->work.refused.px == 0 &&
                    nav->front.active >= MNI_PLACES_MIN;
    nav->early = nav->looks_ahead && nav->ahead.look.moves && used_px > 0 && nav->ops_max == 0 &&
                 nav->triangles_max == 0 && nav->work.refused.px == 0;
    if (nav->early)
        motion = fmax(motion, nav->ahead.soon_motion);
    clock_advance(nav, nav->early == early_before ? motion : (double)INFINITY);
    nav->seeks = nav->looks_ahead && nav->ahead.look.moves && nav->work.refused.px > 0 &&
                 nav->work.refused_pool > 0;
    nav->work = (mni_work){0};
    nav->frame++;
    nav->posted = -1;
    bool moved = nav->moved;
    nav->moved |= !same; /* chains that were given up may go through at another level */
    missed_first(nav);
    MNI_TRACE(MN_TRACE_PHASE, MN_TRACE_COLLAPSES, 0, 0);
    mni_collapse_pass(nav);
    (void)round_end(nav);
    MNI_TRACE(MN_TRACE_PHASE, MN_TRACE_SPLITS, 0, 0);
    split_pass(nav);
    if (nav->looks_ahead)
        look_forward(nav);
    count_missed(nav);
    nav->moved = moved;
}

/* ---- open ------------------------------------------------------------------------------------ */

static uint32_t chain_room(uint32_t nodes_max) {
    return nodes_max < MNI_CHAIN_MAX ? nodes_max : MNI_CHAIN_MAX;
}

static size_t whole_batches(uint32_t nodes) {
    return ((size_t)nodes + MNI_SIEVE_BATCH - 1) / MNI_SIEVE_BATCH * MNI_SIEVE_BATCH;
}

size_t mni_navigator_need_bytes(const mn_header *header, uint32_t nodes_max,
                                uint32_t simplices_max) {
    return mni_front_need_bytes(header, nodes_max, simplices_max) + mni_agenda_need(nodes_max) +
           mni_arena_need(MNI_STACK_MAX, sizeof(mni_front_ref), 64) +
           mni_arena_need(MNI_STACK_MAX, sizeof(uint16_t), 64) +
           mni_arena_need(chain_room(nodes_max), sizeof(uint32_t), 64) +
           mni_lacking_need(nodes_max) + mni_arena_need(nodes_max, sizeof(mni_refusal), 64) +
           mni_barred_need(nodes_max) +
           2 * mni_arena_need(whole_batches(nodes_max), sizeof(float), 64) +
           mni_arena_need(MNI_SOON_MAX, sizeof(uint32_t), 64);
}

float mni_coordinate_max(const mn_header *header) {
    float most = 0;
    for (int i = 0; i < 3; i++)
        most = fmaxf(most, fmaxf(fabsf(header->box_min[i]), fabsf(header->box_max[i])));
    return most;
}

mn_code mni_navigator_open(mni_navigator *nav, mni_store *store, const mn_header *header,
                           uint32_t nodes_max, uint32_t simplices_max, mni_arena *arena,
                           mn_status *st) {
    nav->chain_max = chain_room(nodes_max);
    nav->round_ops = MNI_ROUND_OPS;
    mni_agenda_open(&nav->agenda, nodes_max, arena);
    nav->stack = mni_arena_take(arena, MNI_STACK_MAX, sizeof *nav->stack, 64);
    nav->pusher = mni_arena_take(arena, MNI_STACK_MAX, sizeof *nav->pusher, 64);
    nav->chain = mni_arena_take(arena, nav->chain_max, sizeof *nav->chain, 64);
    mni_lacking_open(&nav->lacking, nodes_max, arena);
    nav->refusal = mni_arena_take(arena, nodes_max, sizeof *nav->refusal, 64);
    mni_waiting_open(&nav->waiting, &nav->front);
    while ((header->leaves >> nav->place_shift) >= MNI_SPLIT_PLACES)
        nav->place_shift++;
    nav->fork_due = mni_arena_take(arena, whole_batches(nodes_max), sizeof(float), 64);
    nav->soon = mni_arena_take(arena, MNI_SOON_MAX, sizeof *nav->soon, 64);
    nav->slot_due = mni_arena_take(arena, whole_batches(nodes_max), sizeof(float), 64);
    mni_barred_open(&nav->barred, nodes_max, nav->slot_due, arena);
    mni_level_open(&nav->level);
    nav->level.settled = true;
    nav->coordinate_max = mni_coordinate_max(header);
    return mni_front_open(&nav->front, store, header, nodes_max, simplices_max, arena, st);
}
