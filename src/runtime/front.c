/* The front: the expanded tree, the active simplices, and the two moves between them.
 *
 * Hides: how nodes, pairs, simplices and corner lists lie in memory, how a child's record is found
 * in the blocks, and how the third corner of a simplex that appears is found.
 *
 * Order of calls: open; then blocker tests and moves in any order. A split is followed by release
 * (it stays) or unsplit (it never was), the latter in reverse order of the splits.
 *
 * Threads: Navigate only. Memory: all from the arena, by the counts given to open. Paper: §3.3.1
 * (active nodes and triangles) and §3.3.5 (implicit dependencies). */
#include "front.h"

#include <string.h>

#include "assert.h"
#include "frame.h"

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
    size_t slots = 2 * (size_t)f->pairs_max, corners = 3 * (size_t)f->simplices_max, sum = 0;
    sum += take(arena, &f->position, slots, 3 * sizeof *f->position);
    sum += colors ? take(arena, &f->color, slots, sizeof *f->color) : 0;
    sum += take(arena, &f->switch_value, slots, sizeof *f->switch_value);
    sum += take(arena, &f->node, slots, sizeof *f->node);
    sum += take(arena, &f->pair, f->pairs_max, sizeof *f->pair);
    sum += take(arena, &f->simplex_leaf, corners, sizeof *f->simplex_leaf);
    sum += take(arena, &f->simplex_node, corners, sizeof *f->simplex_node);
    sum += take(arena, &f->next, corners, sizeof *f->next);
    sum += take(arena, &f->prev, corners, sizeof *f->prev);
    sum += take(arena, &f->node_stamp, slots / MN_FRONT_PAGE + 1, sizeof *f->node_stamp);
    sum += take(arena, &f->simplex_stamp, f->simplices_max / MN_FRONT_PAGE + 1,
                sizeof *f->simplex_stamp);
    return sum;
}

size_t mni_front_need_bytes(const mn_header *header, uint32_t nodes_max, uint32_t simplices_max) {
    mni_front shape = {.pairs_max = nodes_max, .simplices_max = simplices_max};
    return lay_out(&shape, NULL, header->has_colors);
}

static uint32_t pair_new(mni_front *f) {
    uint32_t i = f->pair_free;
    if (i != MN_NONE) {
        f->pair_free = f->pair[i].killed;
    } else {
        MN_ASSERT(f->pairs_high < f->pairs_max);
        i = f->pairs_high++;
    }
    f->pairs_used++;
    f->node_stamp[2 * i / MN_FRONT_PAGE] = (uint32_t)f->version; /* whoever takes it fills it */
    f->pair[i] = (mni_front_pair){.parent = MN_NONE, .witness = MN_NONE};
    return i;
}

static void pair_free(mni_front *f, uint32_t i) {
    f->node[2 * i].flags = f->node[2 * i + 1].flags = 0;
    f->pair[i].parent = MN_NONE;
    f->pair[i].killed = f->pair_free;
    f->pair_free = i;
    f->pairs_used--;
}

static uint32_t simplex_new(mni_front *f) {
    uint32_t s = f->simplex_free;
    if (s != MN_NONE) {
        f->simplex_free = f->next[3 * (size_t)s];
    } else {
        MN_ASSERT(f->simplices_high < f->simplices_max);
        s = f->simplices_high++;
    }
    f->simplices_used++;
    return s;
}

static void simplex_free(mni_front *f, uint32_t s) {
    f->simplex_node[3 * (size_t)s] = MN_NONE;
    f->simplex_stamp[s / MN_FRONT_PAGE] = (uint32_t)f->version;
    f->next[3 * (size_t)s] = f->simplex_free;
    f->simplex_free = s;
    f->simplices_used--;
}

/* ---- corner lists ---------------------------------------------------------------------------- */

static void corner_push(mni_front *f, uint32_t slot, uint32_t c) {
    uint32_t head = f->node[slot].first;
    f->simplex_node[c] = slot;
    f->simplex_stamp[c / (3 * MN_FRONT_PAGE)] = (uint32_t)f->version;
    f->prev[c] = MN_NONE;
    f->next[c] = head;
    if (head != MN_NONE)
        f->prev[head] = c;
    f->node[slot].first = c;
}

static void corner_remove(mni_front *f, uint32_t c) {
    if (f->prev[c] != MN_NONE)
        f->next[f->prev[c]] = f->next[c];
    else
        f->node[f->simplex_node[c]].first = f->next[c];
    if (f->next[c] != MN_NONE)
        f->prev[f->next[c]] = f->prev[c];
}

/* The other two corners of a corner's simplex. */
static inline void others(uint32_t c, uint32_t out[2]) {
    uint32_t k = c % 3;
    out[0] = k == 2 ? c - 2 : c + 1;
    out[1] = k == 0 ? c + 2 : c - 1;
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
                      const mni_node *record) {
    const mni_front_node *p = &f->node[slot];
    const mni_facts facts = {p->order, f->switch_value[slot], p->radius, p->cone};
    return mni_facts_equal(&facts, &record->facts) && s->leaf_lo == p->leaf_lo &&
           s->leaf_hi == p->leaf_hi &&
           memcmp(s->position, &f->position[3 * (size_t)slot], sizeof s->position) == 0;
}

/* Takes the block of a node's record into use once, for the first of its children. */
static mni_outcome record_take(mni_front *f, uint32_t slot, mni_entry *entry, mni_node *record) {
    const mni_front_node *p = &f->node[slot];
    const void *bytes;
    const mni_block *block = view_of(f, p->entry, &bytes);
    if ((p->flags & MNI_NODE_STUB) == 0) {
        mni_block_node(block, p->index, record);
        *entry = p->entry;
        mni_store_add(f->store, *entry);
        return MNI_DONE;
    }
    mni_child where;
    mni_block_exit(block, p->index, &where);
    mni_answer answer = mni_store_down(f->store, p->entry, mni_frame_ref(bytes, where.ref), entry);
    if (answer != MNI_GRANTED)
        return answer == MNI_ABSENT ? MNI_MISS : MNI_REFUSED_POOL;
    if (holds_subtree(f, *entry, where.subtree)) {
        mni_subtree subtree;
        block = view_of(f, *entry, NULL);
        mni_block_subtree(block, where.subtree, &subtree);
        mni_block_node(block, subtree.node, record);
        if (same_node(f, slot, &subtree, record))
            return MNI_DONE;
    }
    mni_store_sub(f->store, *entry);
    return MNI_BAD;
}

/* ---- the simplices that a split brings --------------------------------------------------------
 */

uint32_t mni_front_find(const mni_front *f, uint32_t leaf) {
    uint32_t roots = f->header->roots, lo = 0;
    for (uint32_t step = roots; step > 1;) { /* the last root that begins at or before leaf */
        uint32_t half = step / 2;
        if (f->node[2 * (lo + half)].leaf_lo <= leaf)
            lo += half;
        step -= half;
    }
    uint32_t slot = 2 * lo;
    while (f->node[slot].flags & MNI_NODE_EXPANDED) {
        uint32_t pair = f->node[slot].pair;
        slot = 2 * pair + (leaf >= f->node[2 * pair + 1].leaf_lo);
    }
    return slot;
}

static bool within(const mni_front_node *n, uint32_t leaf) {
    return n->leaf_lo <= leaf && leaf < n->leaf_hi;
}

/* The active node of a leaf that is a neighbour of slot's, where the file is what it should be. */
static uint32_t find_near(mni_front *f, uint32_t slot, uint32_t leaf) {
    uint32_t looked = 0;
    for (uint32_t c = f->node[slot].first; c != MN_NONE && looked < MNI_FRONT_NEAR_MAX;
         c = f->next[c], looked++) {
        uint32_t other[2];
        others(c, other);
        for (int i = 0; i < 2; i++) {
            uint32_t v = f->simplex_node[other[i]];
            if (v != MN_NONE && within(&f->node[v], leaf))
                return v;
        }
    }
    f->descents++;
    return mni_front_find(f, leaf);
}

/* One simplex killed at slot, on the list *chain by next[], its third corner found. false: the
 * block lies: a corner is not where it must be, or an edge would appear between nodes that a valid
 * front does not hold together. */
static bool simplex_prepare(mni_front *f, uint32_t slot, uint32_t mid, const uint32_t corner[3],
                            uint32_t *chain) {
    const mni_front_node *p = &f->node[slot];
    uint32_t node[3], left = 0, right = 0;
    for (int k = 0; k < 3; k++) {
        node[k] = MN_NONE;
        if (corner[k] != MN_NONE && within(p, corner[k])) {
            left += corner[k] < mid;
            right += corner[k] >= mid;
            node[k] = slot; /* its child, when the slots are known */
        } else if (corner[k] != MN_NONE) {
            if (corner[k] >= f->header->leaves)
                return false;
            uint32_t third = find_near(f, slot, corner[k]);
            uint32_t above = mni_front_parent(f, third);
            if (f->node[third].order >= p->order ||
                (above != MN_NONE && f->node[above].order <= p->order))
                return false;
            node[k] = third;
        }
    }
    if (left != 1 || right != 1 || corner[0] == MN_NONE || corner[1] == MN_NONE)
        return false;
    uint32_t s = simplex_new(f);
    memcpy(&f->simplex_leaf[3 * (size_t)s], corner, 3 * sizeof *corner);
    memcpy(&f->simplex_node[3 * (size_t)s], node, sizeof node);
    f->next[3 * (size_t)s] = *chain;
    *chain = s;
    return true;
}

static void chain_drop(mni_front *f, uint32_t chain) {
    while (chain != MN_NONE) {
        uint32_t next = f->next[3 * (size_t)chain];
        simplex_free(f, chain);
        chain = next;
    }
}

/* The simplices of a node's overflow blocks, onto the chain. */
static mni_outcome overflow_prepare(mni_front *f, uint32_t slot, mni_entry entry,
                                    const mni_node *record, uint32_t *chain) {
    bool fresh = false;
    const mni_front_node *p = &f->node[slot];
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
            if (!simplex_prepare(f, slot, record->leaf_mid, corner, chain))
                return MNI_BAD;
        }
        at = frame.refs > 0 ? 0 : MN_NONE;
    }
    return MNI_DONE;
}

static mni_outcome simplices_prepare(mni_front *f, uint32_t slot, mni_entry entry,
                                     const mni_node *record, uint32_t *chain) {
    *chain = MN_NONE;
    if (record->simplex_count > f->simplices_max - f->simplices_used)
        return MNI_REFUSED_FRONT;
    const mni_block *block = view_of(f, entry, NULL);
    for (uint32_t i = 0; i < record->simplex_count; i++) {
        uint32_t corner[3];
        mni_block_simplex(block, record->simplex_first + i, corner);
        if (!simplex_prepare(f, slot, record->leaf_mid, corner, chain))
            return MNI_BAD;
    }
    return record->overflow_ref == MN_NONE ? MNI_DONE
                                           : overflow_prepare(f, slot, entry, record, chain);
}

/* ---- split ----------------------------------------------------------------------------------- */

/* A node into a slot, active: position, color and interval by the caller. */
static void node_set(mni_front *f, uint32_t slot, mni_entry entry, const mni_child *from) {
    mni_front_node *n = &f->node[slot];
    n->entry = entry;
    n->pair = n->first = n->witness = MN_NONE;
    n->flags = MNI_NODE_ACTIVE;
    if (from->kind == MNI_CHILD_LEAF) {
        n->flags |= MNI_NODE_LEAF;
        n->order = n->leaf_lo;
        n->radius = f->switch_value[slot] = 0;
        n->cone = (mn_cone){0};
        return;
    }
    bool stub = from->kind == MNI_CHILD_SUBTREE;
    n->flags |= stub ? MNI_NODE_STUB : 0;
    n->index = (uint16_t)(stub ? from->exit : from->node);
    n->order = from->facts.order;
    n->radius = from->facts.radius;
    n->cone = from->facts.cone;
    f->switch_value[slot] = from->facts.switch_value;
}

static void place_set(mni_front *f, uint32_t slot, uint32_t lo, uint32_t hi,
                      const float position[3], uint32_t color) {
    f->node[slot].leaf_lo = lo;
    f->node[slot].leaf_hi = hi;
    memcpy(&f->position[3 * (size_t)slot], position, 3 * sizeof *position);
    if (f->color != NULL)
        f->color[slot] = color;
}

static void children_set(mni_front *f, uint32_t slot, uint32_t pair, mni_entry entry,
                         const mni_node *record) {
    const mni_front_node *p = &f->node[slot];
    uint32_t left = 2 * pair, right = left + 1;
    place_set(f, left, p->leaf_lo, record->leaf_mid, &f->position[3 * (size_t)slot],
              f->color != NULL ? f->color[slot] : 0);
    place_set(f, right, record->leaf_mid, p->leaf_hi, record->right_position, record->right_color);
    node_set(f, left, entry, &record->left);
    node_set(f, right, entry, &record->right);
}

/* Hands p's corners to its children by leaf id, and links the simplices that appear. */
static void corners_part(mni_front *f, uint32_t slot, uint32_t pair, uint32_t mid, uint32_t chain) {
    uint32_t left = 2 * pair, right = left + 1;
    for (uint32_t c = f->node[slot].first, next; c != MN_NONE; c = next) {
        next = f->next[c];
        corner_push(f, f->simplex_leaf[c] < mid ? left : right, c);
    }
    f->node[slot].first = MN_NONE;
    for (uint32_t s = chain, next; s != MN_NONE; s = next) {
        size_t c = 3 * (size_t)s;
        next = f->next[c];
        bool hinge = f->simplex_node[c + 2] == MN_NONE;
        for (uint32_t k = 0; k < (hinge ? 2u : 3u); k++) {
            uint32_t to = f->simplex_node[c + k];
            if (to == slot)
                to = f->simplex_leaf[c + k] < mid ? left : right;
            corner_push(f, to, (uint32_t)(c + k));
        }
        f->triangles += !hinge;
        f->pair[pair].killed++;
    }
}

mni_outcome mni_front_split(mni_front *f, uint32_t slot) {
    mni_front_node *p = &f->node[slot];
    MN_ASSERT((p->flags & (MNI_NODE_ACTIVE | MNI_NODE_EXPANDED)) == MNI_NODE_ACTIVE);
    MN_ASSERT(!mni_front_is_leaf(f, slot));
    /* Its caller has asked what blocks it: nothing does, and so no witness waits for the way back.
     */
    MN_ASSERT(p->witness == MN_NONE);
    if (p->flags & MNI_NODE_BAD)
        return MNI_BAD;
    if (f->pairs_used == f->pairs_max)
        return MNI_REFUSED_FRONT;
    mni_node record;
    mni_entry entry;
    uint32_t chain = MN_NONE;
    mni_outcome outcome = record_take(f, slot, &entry, &record);
    if (outcome == MNI_DONE) {
        outcome = simplices_prepare(f, slot, entry, &record, &chain);
        if (outcome != MNI_DONE) {
            chain_drop(f, chain);
            mni_store_sub(f->store, entry);
        }
    }
    if (outcome == MNI_BAD) {
        p->flags |= MNI_NODE_BAD;
        f->bad++;
    }
    if (outcome != MNI_DONE)
        return outcome;
    mni_store_add(f->store, entry); /* for the second child */
    uint32_t pair = pair_new(f);
    f->pair[pair].parent = slot;
    children_set(f, slot, pair, entry, &record);
    p->pair = pair;
    p->flags = (uint16_t)((p->flags & MNI_NODE_KIND) | MNI_NODE_EXPANDED);
    corners_part(f, slot, pair, record.leaf_mid, chain);
    f->active++;
    return MNI_DONE;
}

void mni_front_release(mni_front *f, uint32_t slot) {
    MN_ASSERT(f->node[slot].flags & MNI_NODE_EXPANDED);
    mni_store_sub(f->store, f->node[slot].entry);
    f->version++;
}

/* ---- collapse -------------------------------------------------------------------------------- */

/* Kills what has a corner in both children, and hands the other corners to the parent. */
static void corners_join(mni_front *f, uint32_t pair, uint32_t slot) {
    uint32_t left = 2 * pair, right = left + 1, killed = 0;
    for (uint32_t c = f->node[left].first, next; c != MN_NONE; c = next) {
        uint32_t other[2];
        next = f->next[c];
        others(c, other);
        if (f->simplex_node[other[0]] != right && f->simplex_node[other[1]] != right) {
            corner_push(f, slot, c);
            continue;
        }
        uint32_t s = c / 3;
        for (int k = 0; k < 2; k++)
            if (f->simplex_node[other[k]] != MN_NONE)
                corner_remove(f, other[k]);
        f->triangles -= f->simplex_node[3 * (size_t)s + 2] != MN_NONE;
        simplex_free(f, s);
        killed++;
    }
    for (uint32_t c = f->node[right].first, next; c != MN_NONE; c = next) {
        next = f->next[c];
        corner_push(f, slot, c);
    }
    MN_ASSERT(killed == f->pair[pair].killed);
}

/* Without the stores' part, which differs. */
static void join(mni_front *f, uint32_t pair) {
    uint32_t slot = f->pair[pair].parent;
    MN_ASSERT(mni_front_is_fork(f, pair) && f->node[slot].pair == pair);
    mni_front_node *p = &f->node[slot];
    p->first = MN_NONE;
    corners_join(f, pair, slot);
    p->flags = (uint16_t)((p->flags & MNI_NODE_KIND) | MNI_NODE_ACTIVE);
    p->pair = MN_NONE;
    pair_free(f, pair);
    f->active--;
}

void mni_front_unsplit(mni_front *f, uint32_t slot) {
    uint32_t pair = f->node[slot].pair;
    mni_entry entry = f->node[2 * pair].entry; /* both count there */
    join(f, pair);
    mni_store_sub(f->store, entry);
    mni_store_sub(f->store, entry);
}

mni_outcome mni_front_collapse(mni_front *f, uint32_t pair) {
    MN_ASSERT(mni_front_is_fork(f, pair));
    mni_answer answer = mni_store_up(f->store, f->node[f->pair[pair].parent].entry);
    if (answer != MNI_GRANTED)
        return answer == MNI_ABSENT ? MNI_MISS : MNI_REFUSED_POOL;
    mni_front_unsplit(f, f->pair[pair].parent);
    f->version++;
    return MNI_DONE;
}

/* ---- implicit dependencies ------------------------------------------------------------------- */

/* A witness is still one: the node that was seen is active. Two nodes that are neighbours once stay
 * so while both are active: a simplex that joins them dies only with one of them. */
static bool stands(const mni_front *f, uint32_t witness, uint32_t order) {
    return witness != MN_NONE && mni_front_is_active(f, witness) && f->node[witness].order == order;
}

uint32_t mni_front_split_blockers(mni_front *f, uint32_t slot, uint32_t *out, uint32_t room) {
    uint32_t order = f->node[slot].order, count = 0;
    for (uint32_t c = f->node[slot].first; c != MN_NONE && count < room; c = f->next[c]) {
        uint32_t other[2];
        others(c, other);
        for (int i = 0; i < 2 && count < room; i++) {
            uint32_t v = f->simplex_node[other[i]];
            if (v != MN_NONE && f->node[v].order > order)
                out[count++] = v;
        }
    }
    return count;
}

uint32_t mni_front_split_blocker(mni_front *f, uint32_t slot) {
    mni_front_node *p = &f->node[slot];
    if (stands(f, p->witness, p->witness_order))
        return p->witness;
    p->witness = MN_NONE;
    uint32_t found;
    if (mni_front_split_blockers(f, slot, &found, 1) == 0)
        return MN_NONE;
    p->witness = found;
    p->witness_order = f->node[found].order;
    return found;
}

static uint32_t collapse_blocker_at(const mni_front *f, uint32_t slot, uint32_t order) {
    for (uint32_t c = f->node[slot].first; c != MN_NONE; c = f->next[c]) {
        uint32_t other[2];
        others(c, other);
        for (int i = 0; i < 2; i++) {
            uint32_t v = f->simplex_node[other[i]];
            if (v == MN_NONE || v == (slot ^ 1))
                continue;
            uint32_t above = mni_front_parent(f, v);
            if (above != MN_NONE && f->node[above].order < order)
                return v;
        }
    }
    return MN_NONE;
}

uint32_t mni_front_collapse_blocker(mni_front *f, uint32_t pair) {
    mni_front_pair *fork = &f->pair[pair];
    if (stands(f, fork->witness, fork->witness_order))
        return fork->witness;
    uint32_t order = f->node[fork->parent].order;
    uint32_t found = collapse_blocker_at(f, 2 * pair, order);
    if (found == MN_NONE)
        found = collapse_blocker_at(f, 2 * pair + 1, order);
    fork->witness = found;
    fork->witness_order = found != MN_NONE ? f->node[found].order : 0;
    return found;
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
    mni_node record;
    mni_block_subtree(block, subtree_index, &subtree);
    mni_block_node(block, subtree.node, &record);
    if (subtree.leaf_lo != leaf_lo)
        return mn_fail(st, MN_BAD_INPUT, "root %u: not where the forest needs it; rebuild the file",
                       r);
    uint32_t pair = pair_new(f);
    MN_ASSERT(pair == r); /* mni_front_find counts on it */
    mni_child self = {.kind = MNI_CHILD_INNER, .node = subtree.node, .facts = record.facts};
    place_set(f, 2 * pair, subtree.leaf_lo, subtree.leaf_hi, subtree.position, subtree.color);
    node_set(f, 2 * pair, entry, &self);
    f->active++;
    return MN_OK;
}

mn_code mni_front_open(mni_front *f, mni_store *store, const mn_header *header, uint32_t nodes_max,
                       uint32_t simplices_max, mni_arena *arena, mn_status *st) {
    *f = (mni_front){.store = store,
                     .header = header,
                     .pairs_max = nodes_max,
                     .simplices_max = simplices_max,
                     .pair_free = MN_NONE,
                     .simplex_free = MN_NONE};
    f->limits = (mni_block_limits){.leaves = header->leaves,
                                   .nodes = header->nodes,
                                   .file_bytes = header->file_bytes,
                                   .has_colors = header->has_colors};
    MN_ASSERT(nodes_max >= header->roots);
    lay_out(f, arena, header->has_colors);
    for (uint32_t i = 0; i < MNI_FRONT_VIEWS; i++)
        f->view[i].entry = MNI_NO_ENTRY;
    uint32_t leaf = 0;
    for (uint32_t r = 0; r < header->roots; r++) {
        mn_code code = root_open(f, r, leaf, st);
        if (code != MN_OK)
            return code;
        leaf = f->node[2 * r].leaf_hi;
    }
    if (leaf != header->leaves)
        return mn_fail(st, MN_BAD_INPUT, "the roots hold %u leaves of %u; rebuild the file", leaf,
                       header->leaves);
    return MN_OK;
}
