/* The front: the expanded tree, the active simplices, and the two moves between them.
 *
 * Hides: how a move changes slots, branches, simplices and corner lists, how a child's record is
 * found in the blocks, and how the third corner of a simplex that appears is found.
 *
 * Order of calls: open; then blocker tests and moves in any order. A split is followed by release
 * (it stays) or unsplit (it never was), the latter in reverse order of the splits.
 *
 * Threads: Navigate only. Memory: all from the arena, by the counts given to open. Paper: §3.3.1
 * (active nodes and triangles) and §3.3.5 (implicit dependencies). */
#include "front.h"

#include <string.h>

#include "mn_assert.h"
#include "corners.h"
#include "frame.h"
#include "rate.h"
#include "ring.h"
#include "sieve.h"

/* ---- memory ---------------------------------------------------------------------------------- */

static size_t take(mni_arena *arena, void *field, size_t count, size_t size) {
    if (arena == NULL)
        return mni_arena_need(count, size, 64);
    void *memory = mni_arena_take(arena, count, size, 64);
    memcpy(field, &memory, sizeof memory);
    return 0;
}

/* Takes the arrays, or, without an arena, says what they would need: one list for both. */
static size_t lay_out(mni_front *f, mni_arena *arena, bool colors) {
    /* whole batches, for who reads them so */
    size_t slots = ((size_t)f->nodes_max + MNI_SIEVE_BATCH - 1) / MNI_SIEVE_BATCH * MNI_SIEVE_BATCH;
    size_t simplices = (size_t)f->simplices_max + 1, sum = 0; /* and simplex 0 */
    f->chunks_max = (uint32_t)(3 * (size_t)f->simplices_max / MNI_FRONT_CHUNK);
    sum += take(arena, &f->position, slots, 3 * sizeof *f->position);
    sum += colors ? take(arena, &f->color, slots, sizeof *f->color) : 0;
    sum += take(arena, &f->switch_value, slots, sizeof *f->switch_value);
    sum += take(arena, &f->radius, slots, sizeof *f->radius);
    sum += take(arena, &f->face, slots, sizeof *f->face);
    sum += take(arena, &f->node, slots + 1, sizeof *f->node); /* and nobody's */
    sum += take(arena, &f->branch, slots, sizeof *f->branch);
    sum += take(arena, &f->simplex_node, simplices, 3 * sizeof *f->simplex_node);
    sum += take(arena, &f->simplex_leaf, simplices, 3 * sizeof *f->simplex_leaf);
    sum += take(arena, &f->chunk, f->chunks_max, sizeof *f->chunk);
    sum += take(arena, &f->forks, slots / 64, sizeof *f->forks);
    sum += take(arena, &f->node_stamp, slots / MN_FRONT_PAGE + 1, sizeof *f->node_stamp);
    sum += take(arena, &f->simplex_stamp, simplices / MN_FRONT_PAGE + 1, sizeof *f->simplex_stamp);
    if (arena == NULL)
        return sum + mni_vacancy_need(f->nodes_max) + mni_vacancy_need((uint32_t)simplices);
    mni_vacancy_open(&f->slots, f->nodes_max, arena);
    mni_vacancy_open(&f->simplices, (uint32_t)simplices, arena);
    return 0;
}

size_t mni_front_need_bytes(const mn_header *header, uint32_t nodes_max, uint32_t simplices_max) {
    mni_front shape = {.nodes_max = nodes_max, .simplices_max = simplices_max};
    return lay_out(&shape, NULL, header->has_colors);
}

static void fork_set_if(mni_front *f, uint32_t branch, bool is) {
    f->forks[branch / 64] |= (uint64_t)is << (branch % 64);
}

static void fork_clear(mni_front *f, uint32_t branch) {
    f->forks[branch / 64] &= ~(UINT64_C(1) << (branch % 64));
}

/* Slots and simplices of pages that nobody has been in. */
static void slots_open(mni_front *f) {
    const uint32_t high = mni_vacancy_high(&f->slots);
    for (; f->slots_high < high; f->slots_high++)
        f->node[f->slots_high].order = f->branch[f->slots_high].slot = MN_NONE;
}

static void simplices_open(mni_front *f) {
    const uint32_t high = mni_vacancy_high(&f->simplices);
    for (; f->simplices_high < high; f->simplices_high++)
        f->simplex_node[3 * (size_t)f->simplices_high] = MN_NONE;
}

/* Slot `nobody` and simplex 0, which stand where there is none (ring.c). */
static void nobody_set(mni_front *f) {
    f->nobody = f->nodes_max;
    f->vectors = mni_ring_has_vectors();
    f->node[f->nobody] =
        (mni_front_node){.above = MN_NONE, .more = MNI_FRONT_SHORT, .witness = MN_NONE};
    const uint32_t none = mni_vacancy_take(&f->simplices, 0);
    MN_ASSERT(none == 0);
    simplices_open(f);
    memset(f->simplex_node, 0xff, 3 * sizeof *f->simplex_node);
    memset(f->simplex_leaf, 0, 3 * sizeof *f->simplex_leaf);
}

static uint32_t slot_new(mni_front *f, uint32_t near) {
    MN_ASSERT(f->active < f->nodes_max);
    const uint32_t slot = mni_vacancy_take(&f->slots, near);
    if (slot >= f->slots_high)
        slots_open(f);
    f->active++;
    return slot;
}

static void slot_free(mni_front *f, uint32_t slot) {
    f->node[slot].order = MN_NONE;
    mni_vacancy_give(&f->slots, slot);
    f->active--;
}

static uint32_t simplex_new(mni_front *f, uint32_t near) {
    MN_ASSERT(f->simplices_used < f->simplices_max);
    const uint32_t s = mni_vacancy_take(&f->simplices, near);
    if (s >= f->simplices_high)
        simplices_open(f);
    f->simplices_used++;
    return s;
}

static void simplex_free(mni_front *f, uint32_t s) {
    f->simplex_node[3 * (size_t)s] = MN_NONE;
    f->simplex_stamp[mni_simplex_page(4 * s)] = (uint32_t)f->version;
    mni_vacancy_give(&f->simplices, s);
    f->simplices_used--;
}

/* ---- blocks ---------------------------------------------------------------------------------- */

static const mni_block *view_of(mni_front *f, mni_entry entry, const void **bytes_out) {
    bool fresh = false;
    const void *bytes = mni_store_bytes(f->store, entry, &fresh);
    mni_front_view *view = &f->view[entry % MNI_FRONT_VIEWS];
    if (fresh || view->entry != entry || view->bytes != bytes) {
        view->entry = entry;
        view->bytes = bytes;
        mni_block_reopen(&view->block, bytes);
    }
    if (bytes_out != NULL)
        *bytes_out = bytes;
    return &view->block;
}

bool mni_front_block_check(const void *context, const void *bytes, uint32_t length_bytes) {
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    if (frame.kind == MNI_FRAME_OVERFLOW) {
        mni_overflow overflow;
        return mni_overflow_open(&overflow, bytes, length_bytes, context, NULL, 0);
    }
    mni_block block;
    return frame.kind == MNI_FRAME_METANODE &&
           mni_block_open(&block, bytes, length_bytes, context, NULL, 0);
}

/* Is entry's block a meta-node, with that subtree? */
static bool holds_subtree(mni_front *f, mni_entry entry, uint32_t subtree) {
    bool fresh = false;
    mni_frame frame;
    mni_frame_get(mni_store_bytes(f->store, entry, &fresh), &frame);
    if (fresh) /* whoever asks is told once: forget the view */
        f->view[entry % MNI_FRONT_VIEWS].entry = MNI_NO_ENTRY;
    return frame.kind == MNI_FRAME_METANODE && subtree < view_of(f, entry, NULL)->subtrees;
}

/* A block of another file's, or lying, content: what it says of the node must be what its parent's
 * block said. */
static bool same_node(const mni_front *f, uint32_t slot, const mni_subtree *s,
                      const mni_facts *said) {
    const mni_front_node *key = &f->node[slot];
    const mni_facts facts = {key->order, f->switch_value[slot], f->radius[slot],
                             f->face[slot].cone};
    return mni_facts_equal(&facts, said) && s->leaf_lo == key->leaf_lo &&
           s->leaf_hi == key->leaf_hi;
}

static mni_place place_of(const mni_front *f, uint32_t slot) {
    const mni_front_node *n = &f->node[slot];
    const float *at = &f->position[3 * (size_t)slot];
    return (mni_place){n->leaf_lo, n->leaf_hi, {at[0], at[1], at[2]}};
}

/* Takes the block of a node's record into use once, for the first of its children; *view: that
 * block. */
static mni_outcome record_take(mni_front *f, uint32_t slot, mni_entry *entry, mni_node *record,
                               const mni_block **view) {
    const mni_front_node *p = &f->node[slot];
    const mni_place at = place_of(f, slot);
    mni_entry own = mni_front_entry(f, p->parent, slot);
    const void *bytes;
    const mni_block *block = view_of(f, own, &bytes);
    *view = block;
    if ((p->flags & MNI_NODE_EXIT) == 0) {
        mni_block_split(block, f->face[slot].index, &at, record);
        *entry = own;
        mni_store_add(f->store, *entry);
        return MNI_DONE;
    }
    mni_child where = {.exit = f->face[slot].index};
    mni_block_way(block, &where);
    mn_block_ref ref = mni_frame_ref(bytes, where.ref);
    mni_answer answer = mni_store_down(f->store, own, ref, entry);
    if (answer == MNI_ABSENT) {
        const mni_note note = mni_rate_note(where.subtree, at.position);
        mni_store_note(f->store, ref, &note);
    }
    if (answer != MNI_GRANTED)
        return answer == MNI_ABSENT ? MNI_MISS : MNI_REFUSED_POOL;
    if (holds_subtree(f, *entry, where.subtree)) {
        mni_subtree subtree;
        *view = block = view_of(f, *entry, NULL);
        mni_facts facts;
        mni_block_subtree(block, where.subtree, &subtree);
        mni_block_facts(block, subtree.node, &facts);
        if (same_node(f, slot, &subtree, &facts)) {
            mni_block_split(block, subtree.node, &at, record);
            return MNI_DONE;
        }
    }
    mni_store_sub(f->store, *entry);
    return MNI_BAD;
}

void mni_front_fetch_record(const mni_front *f, uint32_t slot) {
    const mni_entry own = mni_front_entry(f, f->node[slot].parent, slot);
    const mni_front_view *view = &f->view[own % MNI_FRONT_VIEWS];
    if (view->entry == own)
        mni_block_fetch(&view->block, f->face[slot].index,
                        (f->node[slot].flags & MNI_NODE_EXIT) != 0);
    __builtin_prefetch(&f->position[3 * (size_t)slot]);
}

mni_entry mni_front_exit(mni_front *f, uint32_t slot, mn_block_ref *ref, mni_note *note) {
    MN_ASSERT(mni_front_is_active(f, slot) && (f->node[slot].flags & MNI_NODE_EXIT) != 0);
    mni_entry own = mni_front_entry(f, f->node[slot].parent, slot);
    const void *bytes;
    const mni_block *block = view_of(f, own, &bytes);
    mni_child where = {.exit = f->face[slot].index};
    mni_block_way(block, &where);
    *ref = mni_frame_ref(bytes, where.ref);
    *note = mni_rate_note(where.subtree, &f->position[3 * (size_t)slot]);
    return own;
}

/* ---- the simplices that a split brings ------------------------------------------------------- */

/* The first leaf of a node, expanded or not. */
static uint32_t first_leaf(const mni_front *f, uint32_t at) {
    return at & MNI_FRONT_BRANCH ? f->branch[at & ~MNI_FRONT_BRANCH].leaf_lo : f->node[at].leaf_lo;
}

/* The active node that holds a leaf of that one. */
static uint32_t find_beneath(const mni_front *f, uint32_t at, uint32_t leaf) {
    while (at & MNI_FRONT_BRANCH) {
        const mni_front_branch *b = &f->branch[at & ~MNI_FRONT_BRANCH];
        at = b->child[leaf >= first_leaf(f, b->child[1])];
    }
    return at;
}

uint32_t mni_front_find(const mni_front *f, uint32_t leaf) {
    uint32_t roots = f->header->roots, lo = 0;
    for (uint32_t step = roots; step > 1;) { /* the last root that begins at or before leaf */
        uint32_t half = step / 2;
        if (f->node[lo + half].leaf_lo <= leaf) /* a root's slot has its first leaf for ever */
            lo += half;
        step -= half;
    }
    return find_beneath(f, f->root[lo], leaf);
}

/* The same, up from a slot and down again: for a leaf that is near in the tree, which may be deep.
 * Of the nodes that begin right of the way up, the last one at or before the leaf has it. */
static uint32_t find_from(const mni_front *f, uint32_t slot, uint32_t leaf) {
    uint32_t at = slot, right = MN_NONE;
    for (uint32_t up = f->node[slot].parent; up != MNI_FRONT_NO_PARENT; up = f->branch[up].parent) {
        const mni_front_branch *b = &f->branch[up];
        if (at == b->child[1]) {
            if (leaf >= b->leaf_lo && leaf < first_leaf(f, at))
                return find_beneath(f, b->child[0], leaf);
        } else if (leaf >= first_leaf(f, b->child[1])) {
            right = b->child[1];
        } else if (right != MN_NONE) {
            return find_beneath(f, right, leaf);
        }
        at = up | MNI_FRONT_BRANCH;
    }
    return mni_front_find(f, leaf);
}

static inline bool within(const mni_front_node *n, uint32_t leaf) {
    return leaf - n->leaf_lo < n->leaf_hi - n->leaf_lo;
}

/* The active node of a leaf that is a neighbour of slot's, where the file is what it should be, and
 * slot's list is long. */
static uint32_t find_near_far(mni_front *f, uint32_t slot, uint32_t leaf) {
    uint32_t looked = 0;
    if (mni_front_is_pole(&f->node[slot])) {
        const uint32_t pole = mni_pole_find(f, slot, leaf);
        return pole != MN_NONE ? pole : find_from(f, slot, leaf);
    }
    for (mni_run r = mni_run_first(f, slot); r.corner != NULL && looked < MNI_FRONT_NEAR_MAX;
         r = mni_run_next(f, r), looked += r.room)
        for (uint32_t i = 0; i < r.room && r.corner[i] != 0; i++) {
            uint32_t after = mni_corner_slot(f, mni_corner_after(r.corner[i]));
            uint32_t before = mni_corner_slot(f, mni_corner_before(r.corner[i]));
            if (within(&f->node[after], leaf))
                return after;
            if (within(&f->node[before], leaf))
                return before;
        }
    f->descents++;
    return mni_front_find(f, leaf);
}

/* What a split has found out before it changes anything. */
typedef struct split_plan {
    uint32_t slot, mid;
    bool is_long;   /* slot's list; otherwise the front has the ring around slot */
    uint32_t chain; /* simplices that appear, by their corners at the right child: until its slot is
                       known, the next one stands there */
} split_plan;

/* One simplex killed at the plan's slot, its third corner found, onto the chain. false: the block
 * lies: a corner is not where it must be, or an edge would appear between nodes that a valid front
 * does not hold together. The corners in the children come first. */
static bool simplex_prepare(mni_front *f, split_plan *plan, const uint32_t corner[3]) {
    const mni_front_node *p = &f->node[plan->slot];
    uint32_t right = corner[1] >= plan->mid, at = MN_NONE;
    if (corner[right] - plan->mid >= p->leaf_hi - plan->mid ||
        corner[1 - right] - p->leaf_lo >= plan->mid - p->leaf_lo)
        return false;
    if (corner[2] != MN_NONE) {
        if (corner[2] >= f->header->leaves || within(p, corner[2]))
            return false;
        at = plan->is_long ? MN_NONE : mni_ring_find(f, &f->ring, corner[2]);
        if (at == MN_NONE)
            at = find_near_far(f, plan->slot, corner[2]);
        if (f->node[at].order >= p->order || f->node[at].above <= p->order)
            return false;
    }
    uint32_t kin = plan->chain | (p->corner[0] & (0 - (uint32_t)(plan->chain == 0)));
    if (kin == 0 && at != MN_NONE) /* a pole */
        kin = f->node[at].corner[0];
    uint32_t s = simplex_new(f, kin / 4), *node = &f->simplex_node[3 * (size_t)s];
    memcpy(&f->simplex_leaf[3 * (size_t)s], corner, 3 * sizeof *corner);
    node[2] = at;
    node[1 - right] = plan->slot;
    node[right] = plan->chain;
    plan->chain = 4 * s + right;
    return true;
}

static void plan_drop(mni_front *f, split_plan *plan) {
    while (plan->chain != 0) {
        uint32_t corner = plan->chain;
        plan->chain = f->simplex_node[mni_corner_at(corner)];
        simplex_free(f, corner / 4);
    }
}

/* The simplices of a node's overflow blocks, onto the chain. */
static mni_outcome overflow_prepare(mni_front *f, split_plan *plan, mni_entry entry,
                                    const mni_node *record) {
    bool fresh = false;
    const mni_front_node *p = &f->node[plan->slot];
    const void *bytes = mni_store_bytes(f->store, entry, &fresh);
    uint32_t at = record->overflow_ref;
    for (uint32_t hop = 0; at != MN_NONE; hop++) {
        mn_block_ref ref = mni_frame_ref(bytes, at);
        if (hop == f->header->overflow_max)
            return MNI_BAD;
        mni_answer answer = mni_store_overflow(f->store, entry, ref, &bytes);
        if (answer != MNI_GRANTED)
            return answer == MNI_ABSENT ? MNI_MISS : MNI_REFUSED_POOL;
        mni_frame frame;
        mni_overflow overflow;
        mni_frame_get(bytes, &frame);
        if (frame.kind != MNI_FRAME_OVERFLOW ||
            !mni_overflow_open(&overflow, bytes, ref.pages * MN_PAGE_BYTES, &f->limits, NULL, 0) ||
            overflow.order != p->order || overflow.leaf_lo != p->leaf_lo ||
            overflow.leaf_mid != record->leaf_mid || overflow.leaf_hi != p->leaf_hi)
            return MNI_BAD;
        if (overflow.simplices > f->simplices_max - f->simplices_used)
            return MNI_REFUSED_FRONT;
        for (uint32_t i = 0; i < overflow.simplices; i++) {
            uint32_t corner[3];
            mni_overflow_simplex(&overflow, i, corner);
            if (!simplex_prepare(f, plan, corner))
                return MNI_BAD;
        }
        at = frame.refs > 0 ? 0 : MN_NONE;
    }
    return MNI_DONE;
}

static mni_outcome simplices_prepare(mni_front *f, split_plan *plan, mni_entry entry,
                                     const mni_block *block, const mni_node *record) {
    if (record->simplex_count > f->simplices_max - f->simplices_used)
        return MNI_REFUSED_FRONT;
    for (uint32_t i = 0; i < record->simplex_count; i++) {
        uint32_t corner[3];
        mni_block_simplex(block, record, i, corner);
        if (!simplex_prepare(f, plan, corner))
            return MNI_BAD;
    }
    return record->overflow_ref == MN_NONE ? MNI_DONE : overflow_prepare(f, plan, entry, record);
}

/* ---- split ----------------------------------------------------------------------------------- */

/* The reference to a branch or slot in its parent, or where the roots stand. */
static uint32_t *reference(mni_front *f, uint32_t parent, uint32_t slot, uint32_t from) {
    if (parent == MNI_FRONT_NO_PARENT)
        return &f->root[slot];
    mni_front_branch *b = &f->branch[parent];
    uint32_t *child = &b->child[b->child[0] != from]; /* which it is nobody can guess */
    MN_ASSERT(*child == from);
    return child;
}

/* The float, or 0. */
static inline float masked(float value, uint32_t mask) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits &= mask;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* What its parent's block says of a node, into a slot; its first leaf stands there already. */
static void node_set(mni_front *f, uint32_t slot, uint32_t parent, uint32_t above,
                     const mni_child *from) {
    mni_front_node *n = &f->node[slot];
    /* which kind it is nobody can guess */
    uint32_t inner = 0 - (uint32_t)(from->kind != MNI_CHILD_LEAF);
    uint32_t exit = 0 - (uint32_t)(from->kind == MNI_CHILD_SUBTREE);
    mni_front_face *face = &f->face[slot];
    n->parent = parent & MNI_FRONT_NO_PARENT;
    n->witness = MN_NONE;
    n->flags = MNI_NODE_EXIT & exit;
    n->order = n->leaf_lo ^ ((n->leaf_lo ^ from->facts.order) & inner);
    n->above = above;
    face->cone.axis[0] = (int8_t)(from->facts.cone.axis[0] & (int32_t)inner);
    face->cone.axis[1] = (int8_t)(from->facts.cone.axis[1] & (int32_t)inner);
    face->cone.angle = (uint8_t)(from->facts.cone.angle & inner);
    face->index = (uint16_t)(from->node ^ ((from->node ^ from->exit) & exit));
    f->radius[slot] = masked(from->facts.radius, inner);
    f->switch_value[slot] = masked(from->facts.switch_value, inner);
    f->node_stamp[slot / MN_FRONT_PAGE] = (uint32_t)f->version;
}

/* A branch has the number of its right child's slot, which is held as long as it stands. */
static uint32_t branch_make(mni_front *f, uint32_t slot, uint32_t right, mni_entry home) {
    const mni_front_node *p = &f->node[slot];
    const uint32_t b = right;
    f->branch[b] = (mni_front_branch){.order = f->node[slot].order,
                                      .switch_value = f->switch_value[slot],
                                      .radius = f->radius[slot],
                                      .face = f->face[slot],
                                      .child = {slot, right},
                                      .parent = p->parent,
                                      .home = home,
                                      .slot = slot,
                                      .leaf_lo = p->leaf_lo,
                                      .exit = (p->flags & MNI_NODE_EXIT) != 0};
    *reference(f, p->parent, slot, slot) = b | MNI_FRONT_BRANCH;
    fork_set_if(f, b, true);
    if (p->parent != MNI_FRONT_NO_PARENT)
        fork_clear(f, p->parent);
    return b;
}

/* Hands those of a node's corners that are the right child's to it. */
static void corners_part(mni_front *f, uint32_t slot, uint32_t right, uint32_t mid) {
    if (!mni_front_is_long(&f->node[slot])) {
        mni_ring_part(f, slot, right, mid);
        return;
    }
    while (mni_front_is_pole(&f->node[slot])) {
        const uint32_t c = mni_pole_pop(f, slot, mid);
        if (c == 0)
            return;
        mni_corners_give(f, right, c);
    }
    mni_loose list = mni_corners_take(f, slot);
    do {
        for (const uint32_t *c = list.corner; c < list.corner + MNI_FRONT_CORNERS && *c != 0; c++) {
            const uint32_t to[] = {slot, right}; /* nobody can guess which */
            mni_corners_give(f, to[f->simplex_leaf[mni_corner_at(*c)] >= mid], *c);
        }
    } while (mni_corners_next(f, &list));
}

/* The simplices of the plan appear. Returns how many. */
static uint32_t simplices_link(mni_front *f, const split_plan *plan, uint32_t right) {
    uint32_t count = 0;
    for (uint32_t c = plan->chain, next; c != 0; c = next, count++) {
        uint32_t first = c & ~3u, *node = &f->simplex_node[3 * (size_t)(c / 4)], third = node[2];
        next = node[c - first];
        node[c - first] = right;
        mni_corners_note(f, c);
        if (third != MN_NONE) { /* first: of the other two, whatever they become, poles are told */
            mni_corners_push(f, third, first + 2);
            f->triangles++;
        }
        mni_corners_push(f, right, c);
        mni_corners_push(f, plan->slot, first + 1 - (c - first));
    }
    return count;
}

/* The plan's node, whose record is read, becomes a branch. */
static uint32_t part(mni_front *f, const split_plan *plan, mni_entry home, const mni_node *record) {
    uint32_t slot = plan->slot, right = slot_new(f, slot), b = branch_make(f, slot, right, home);
    uint32_t order = f->node[slot].order;
    f->ring_slot = MN_NONE;
    f->node[right].leaf_lo = record->leaf_mid;
    f->node[right].leaf_hi = f->node[slot].leaf_hi;
    f->node[slot].leaf_hi = record->leaf_mid;
    memcpy(&f->position[3 * (size_t)right], record->right_position, 3 * sizeof *f->position);
    if (f->color != NULL)
        f->color[right] = record->right_color;
    mni_corners_clear(f, right);
    corners_part(f, slot, right, record->leaf_mid);
    node_set(f, slot, b, order, &record->left);
    node_set(f, right, b, order, &record->right);
    f->branch[b].killed = simplices_link(f, plan, right) & INT32_MAX;
    if (f->poles != MN_NONE) {
        mni_poles_tell(f, slot);
        mni_poles_tell(f, right);
    }
    return b;
}

mni_outcome mni_front_split(mni_front *f, uint32_t slot, uint32_t *branch) {
    MN_ASSERT(mni_front_is_active(f, slot) && !mni_front_is_leaf(f, slot));
    if (f->node[slot].flags & MNI_NODE_BAD)
        return MNI_BAD;
    if (f->active == f->nodes_max)
        return MNI_REFUSED_FRONT;
    mni_node record;
    mni_entry home;
    const mni_block *block;
    split_plan plan = {.slot = slot, .is_long = mni_front_is_long(&f->node[slot])};
    mni_outcome outcome = record_take(f, slot, &home, &record, &block);
    if (outcome == MNI_DONE) {
        plan.mid = record.leaf_mid;
        MN_ASSERT(plan.is_long || mni_front_split_blocker(f, slot) == MN_NONE);
        outcome = simplices_prepare(f, &plan, home, block, &record);
        if (outcome != MNI_DONE) {
            plan_drop(f, &plan);
            mni_store_sub(f->store, home);
        }
    }
    if (outcome == MNI_BAD) {
        f->node[slot].flags |= MNI_NODE_BAD;
        f->bad++;
    }
    if (outcome != MNI_DONE)
        return outcome;
    mni_store_add(f->store, home);      /* for the second child */
    mni_block_children(block, &record); /* has been on its way since the split */
    *branch = part(f, &plan, home, &record);
    return MNI_DONE;
}

void mni_front_release(mni_front *f, uint32_t branch) {
    const mni_front_branch *b = &f->branch[branch];
    MN_ASSERT(mni_front_is_branch(f, branch));
    mni_store_sub(f->store, mni_front_entry(f, b->parent, b->slot));
    f->version++;
}

/* ---- collapse -------------------------------------------------------------------------------- */

/* A simplex that both children hold dies: c is its corner at one of them, third the one at
 * neither. lost: that may be no neighbour of what they become. */
static void simplex_kill(mni_front *f, uint32_t c, uint32_t third, bool lost) {
    uint32_t slot = f->simplex_node[mni_corner_at(third)];
    if (slot != MN_NONE) {
        mni_corners_remove(f, slot, third);
        f->triangles--;
        if (lost && f->lost_count++ < MNI_FRONT_LOST)
            f->lost[f->lost_count - 1] = slot;
    }
    simplex_free(f, c / 4);
}

/* Kills what has a corner in both children, and hands the right one's other corners to the left.
 * Returns how many died. */
static uint32_t records_join(mni_front *f, uint32_t left, uint32_t right) {
    mni_joined j;
    mni_ring_join(f, left, right, &j);
    for (uint32_t i = 0; i < j.over_count; i++)
        mni_corners_push(f, left, j.over[i]);
    for (uint32_t i = 0; i < j.died; i++)
        simplex_kill(f, j.third[i], j.third[i], (j.lost >> i & 1) != 0);
    return j.died;
}

static uint32_t corners_join(mni_front *f, uint32_t left, uint32_t right) {
    if (!mni_front_is_long(&f->node[left]) && !mni_front_is_long(&f->node[right]))
        return records_join(f, left, right);
    uint32_t killed = 0;
    mni_loose list = mni_corners_take(f, right);
    do {
        for (const uint32_t *c = list.corner; c < list.corner + MNI_FRONT_CORNERS && *c != 0; c++) {
            uint32_t after = mni_corner_after(*c), before = mni_corner_before(*c);
            bool left_after = mni_corner_slot(f, after) == left;
            if (!left_after && mni_corner_slot(f, before) != left) {
                mni_corners_give(f, left, *c);
                continue;
            }
            mni_corners_remove(f, left, left_after ? after : before);
            simplex_kill(f, *c, left_after ? before : after, true);
            killed++;
        }
    } while (mni_corners_next(f, &list));
    return killed;
}

static bool children_are_active(const mni_front_branch *b) {
    return ((b->child[0] | b->child[1]) & MNI_FRONT_BRANCH) == 0;
}

/* Without the stores' part, which differs. */
static void join(mni_front *f, uint32_t branch) {
    const mni_front_branch *b = &f->branch[branch];
    MN_ASSERT(mni_front_is_fork(f, branch) && b->child[0] == b->slot);
    f->lost_count = 0;
    uint32_t slot = b->slot, right = b->child[1], killed = corners_join(f, slot, right);
    MN_ASSERT(killed == b->killed);
    f->ring_slot = MN_NONE;
    f->node[slot].order = b->order;
    f->node[slot].above = b->parent == MNI_FRONT_NO_PARENT ? MN_NONE : f->branch[b->parent].order;
    f->node[slot].leaf_hi = f->node[right].leaf_hi;
    f->radius[slot] = b->radius;
    f->switch_value[slot] = b->switch_value;
    mni_front_node *p = &f->node[slot];
    p->parent = b->parent & MNI_FRONT_NO_PARENT;
    p->witness = MN_NONE;
    f->face[slot] = b->face;
    p->flags = b->exit ? MNI_NODE_EXIT : 0;
    f->node_stamp[slot / MN_FRONT_PAGE] = (uint32_t)f->version;
    *reference(f, b->parent, slot, branch | MNI_FRONT_BRANCH) = slot;
    fork_clear(f, branch);
    if (b->parent != MNI_FRONT_NO_PARENT)
        fork_set_if(f, b->parent, children_are_active(&f->branch[b->parent]));
    f->branch[branch].slot = MN_NONE;
    slot_free(f, right);
    if (f->poles != MN_NONE)
        mni_poles_tell(f, slot);
}

void mni_front_unsplit(mni_front *f, uint32_t branch) {
    mni_entry home = f->branch[branch].home; /* both count there */
    join(f, branch);
    mni_store_sub(f->store, home);
    mni_store_sub(f->store, home);
}

mni_outcome mni_front_collapse(mni_front *f, uint32_t fork) {
    const mni_front_branch *b = &f->branch[fork];
    MN_ASSERT(mni_front_is_fork(f, fork));
    mni_answer answer = mni_store_up(f->store, mni_front_entry(f, b->parent, b->slot));
    if (answer != MNI_GRANTED)
        return answer == MNI_ABSENT ? MNI_MISS : MNI_REFUSED_POOL;
    mni_front_unsplit(f, fork);
    f->version++;
    return MNI_DONE;
}

/* ---- open ------------------------------------------------------------------------------------ */

static mn_code root_open(mni_front *f, uint32_t r, uint32_t leaf_lo, mn_status *st) {
    mni_entry entry = mni_store_root(f->store, r);
    uint32_t subtree_index = f->header->root[r].subtree;
    if (!holds_subtree(f, entry, subtree_index))
        return mn_fail(st, MN_BAD_INPUT, "root %u: its block has no subtree %u; rebuild the file",
                       r, subtree_index);
    const mni_block *block = view_of(f, entry, NULL);
    mni_subtree subtree;
    mni_child self = {.kind = MNI_CHILD_INNER};
    mni_block_subtree(block, subtree_index, &subtree);
    mni_block_facts(block, subtree.node, &self.facts);
    self.node = subtree.node;
    if (subtree.leaf_lo != leaf_lo)
        return mn_fail(st, MN_BAD_INPUT, "root %u: not where the forest needs it; rebuild the file",
                       r);
    uint32_t slot = slot_new(f, r > 0 ? r - 1 : 0);
    MN_ASSERT(slot == r); /* mni_front_find and mni_front_entry count on it */
    f->node[slot].leaf_lo = subtree.leaf_lo;
    f->node[slot].leaf_hi = subtree.leaf_hi;
    mni_corners_clear(f, slot);
    const mn_root *root = &f->header->root[r];
    memcpy(&f->position[3 * (size_t)slot], root->position, sizeof root->position);
    if (f->color != NULL)
        f->color[slot] = root->color;
    node_set(f, slot, MNI_FRONT_NO_PARENT, MN_NONE, &self);
    f->root[r] = slot;
    f->root_entry[r] = entry;
    return MN_OK;
}

mn_code mni_front_open(mni_front *f, mni_store *store, const mn_header *header, uint32_t nodes_max,
                       uint32_t simplices_max, mni_arena *arena, mn_status *st) {
    *f = (mni_front){.store = store,
                     .header = header,
                     .nodes_max = nodes_max,
                     .simplices_max = simplices_max,
                     .chunk_free = MN_NONE,
                     .poles = MN_NONE};
    f->limits = mni_block_limits_of(header);
    f->ring_slot = MN_NONE;
    MN_ASSERT(nodes_max >= header->roots && nodes_max < MNI_FRONT_NODES_MAX);
    MN_ASSERT(simplices_max < MNI_FRONT_SIMPLICES_MAX);
    lay_out(f, arena, header->has_colors);
    for (uint32_t i = 0; i < MNI_FRONT_VIEWS; i++)
        f->view[i].entry = MNI_NO_ENTRY;
    nobody_set(f);
    uint32_t leaf = 0;
    for (uint32_t r = 0; r < header->roots; r++) {
        mn_code code = root_open(f, r, leaf, st);
        if (code != MN_OK)
            return code;
        leaf = f->node[r].leaf_hi;
    }
    if (leaf != header->leaves)
        return mn_fail(st, MN_BAD_INPUT, "the roots hold %u leaves of %u; rebuild the file", leaf,
                       header->leaves);
    return MN_OK;
}
