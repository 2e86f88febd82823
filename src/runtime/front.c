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

#include "assert.h"
#include "frame.h"
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
    size_t simplices = f->simplices_max, sum = 0;
    f->chunks_max = (uint32_t)(3 * simplices / MNI_FRONT_CHUNK);
    sum += take(arena, &f->position, slots, 3 * sizeof *f->position);
    sum += colors ? take(arena, &f->color, slots, sizeof *f->color) : 0;
    sum += take(arena, &f->switch_value, slots, sizeof *f->switch_value);
    sum += take(arena, &f->radius, slots, sizeof *f->radius);
    sum += take(arena, &f->face, slots, sizeof *f->face);
    sum += take(arena, &f->node, slots, sizeof *f->node);
    sum += take(arena, &f->branch, slots, sizeof *f->branch);
    sum += take(arena, &f->simplex_node, simplices, 3 * sizeof *f->simplex_node);
    sum += take(arena, &f->simplex_leaf, simplices, 3 * sizeof *f->simplex_leaf);
    sum += take(arena, &f->chunk, f->chunks_max, sizeof *f->chunk);
    sum += take(arena, &f->changed, slots / 64, sizeof *f->changed);
    sum += take(arena, &f->node_stamp, slots / MN_FRONT_PAGE + 1, sizeof *f->node_stamp);
    sum += take(arena, &f->simplex_stamp, simplices / MN_FRONT_PAGE + 1, sizeof *f->simplex_stamp);
    return sum;
}

size_t mni_front_need_bytes(const mn_header *header, uint32_t nodes_max, uint32_t simplices_max) {
    mni_front shape = {.nodes_max = nodes_max, .simplices_max = simplices_max};
    return lay_out(&shape, NULL, header->has_colors);
}

static void change_note(mni_front *f, uint32_t slot) {
    f->changed[slot / 64] |= UINT64_C(1) << (slot % 64);
}

void mni_front_changes_forget(mni_front *f) {
    memset(f->changed, 0, ((size_t)f->slots_high + 63) / 64 * sizeof *f->changed);
}

static uint32_t slot_new(mni_front *f) {
    uint32_t slot = f->slot_free;
    if (slot != MN_NONE) {
        f->slot_free = f->node[slot].corner[0];
    } else {
        MN_ASSERT(f->slots_high < f->nodes_max);
        slot = f->slots_high++;
    }
    f->active++;
    return slot;
}

static void slot_free(mni_front *f, uint32_t slot) {
    f->node[slot].order = MN_NONE;
    f->node[slot].corner[0] = f->slot_free;
    f->slot_free = slot;
    f->active--;
}

static uint32_t branch_new(mni_front *f) {
    uint32_t b = f->branch_free;
    if (b != MN_NONE) {
        f->branch_free = f->branch[b].parent;
    } else {
        MN_ASSERT(f->branches_high < f->nodes_max);
        b = f->branches_high++;
    }
    return b;
}

static void branch_free(mni_front *f, uint32_t b) {
    f->branch[b].slot = MN_NONE;
    f->branch[b].parent = f->branch_free;
    f->branch_free = b;
}

static uint32_t simplex_new(mni_front *f) {
    uint32_t s = f->simplex_free;
    if (s != MN_NONE) {
        f->simplex_free = f->simplex_leaf[3 * (size_t)s];
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
    f->simplex_leaf[3 * (size_t)s] = f->simplex_free;
    f->simplex_free = s;
    f->simplices_used--;
}

/* ---- corner lists ---------------------------------------------------------------------------- */

static inline uint32_t *node_of(const mni_front *f, uint32_t c) {
    return &f->simplex_node[3 * (size_t)(c / 4) + c % 4];
}

static inline uint32_t leaf_of(const mni_front *f, uint32_t c) {
    return f->simplex_leaf[3 * (size_t)(c / 4) + c % 4];
}

/* A stretch of a node's corners: those before the first MN_NONE. */
typedef struct run {
    uint32_t *corner; /* NULL: no more */
    uint32_t room, more;
} run;

static inline run run_first(const mni_front *f, uint32_t slot) {
    mni_front_node *n = &f->node[slot];
    return (run){n->corner, MNI_FRONT_CORNERS, n->more};
}

static inline run run_next(const mni_front *f, run r) {
    if (r.more == MN_NONE)
        return (run){NULL, 0, MN_NONE};
    return (run){f->chunk[r.more].corner, MNI_FRONT_CHUNK, f->chunk[r.more].next};
}

static inline uint32_t run_count(const uint32_t *corner, uint32_t room) {
    uint32_t count = 0;
    while (count < room && corner[count] != MN_NONE)
        count++;
    return count;
}

static uint32_t chunk_new(mni_front *f) {
    uint32_t i = f->chunk_free;
    if (i != MN_NONE) {
        f->chunk_free = f->chunk[i].next;
    } else {
        MN_ASSERT(f->chunks_high < f->chunks_max);
        i = f->chunks_high++;
    }
    memset(f->chunk[i].corner, 0xff, sizeof f->chunk[i].corner);
    return i;
}

static void chunk_free(mni_front *f, uint32_t i) {
    f->chunk[i].next = f->chunk_free;
    f->chunk_free = i;
}

static void corners_clear(mni_front *f, uint32_t slot) {
    memset(f->node[slot].corner, 0xff, sizeof f->node[slot].corner);
    f->node[slot].more = MN_NONE;
}

static void corner_push(mni_front *f, uint32_t slot, uint32_t c) {
    mni_front_node *n = &f->node[slot];
    if (n->more == MN_NONE) {
        uint32_t count = run_count(n->corner, MNI_FRONT_CORNERS);
        if (count < MNI_FRONT_CORNERS) {
            n->corner[count] = c;
            return;
        }
    }
    uint32_t count = MNI_FRONT_CHUNK;
    if (n->more != MN_NONE)
        count = run_count(f->chunk[n->more].corner, MNI_FRONT_CHUNK);
    if (count == MNI_FRONT_CHUNK) {
        uint32_t i = chunk_new(f);
        f->chunk[i].next = n->more;
        n->more = i;
        count = 0;
    }
    f->chunk[n->more].corner[count] = c;
}

/* Gives a corner to a slot: on its list, and in its simplex. */
static void corner_give(mni_front *f, uint32_t slot, uint32_t c) {
    *node_of(f, c) = slot;
    f->simplex_stamp[c / (4 * MN_FRONT_PAGE)] = (uint32_t)f->version;
    corner_push(f, slot, c);
}

/* The last corner of the first chunk, or of the record, takes its place. */
static void corner_remove(mni_front *f, uint32_t c) {
    uint32_t slot = *node_of(f, c), *hole = NULL, *last;
    mni_front_node *n = &f->node[slot];
    for (run r = run_first(f, slot); hole == NULL; r = run_next(f, r)) {
        MN_ASSERT(r.corner != NULL);
        for (uint32_t i = 0; i < r.room && hole == NULL; i++)
            if (r.corner[i] == c)
                hole = &r.corner[i];
    }
    if (n->more == MN_NONE) {
        last = &n->corner[run_count(n->corner, MNI_FRONT_CORNERS) - 1];
        *hole = *last;
        *last = MN_NONE;
        return;
    }
    mni_front_chunk *chunk = &f->chunk[n->more];
    last = &chunk->corner[run_count(chunk->corner, MNI_FRONT_CHUNK) - 1];
    *hole = *last;
    *last = MN_NONE;
    if (last == chunk->corner) {
        uint32_t empty = n->more;
        n->more = chunk->next;
        chunk_free(f, empty);
    }
}

/* A list taken off its slot, to be handed out again; the record's corners first, so that there are
 * chunks enough at any time. */
typedef struct loose {
    uint32_t corner[MNI_FRONT_CORNERS]; /* at hand: a record's, or a chunk's */
    uint32_t count, more;
} loose;

static loose corners_take(mni_front *f, uint32_t slot) {
    mni_front_node *n = &f->node[slot];
    loose list = {.more = n->more};
    list.count = run_count(n->corner, MNI_FRONT_CORNERS);
    memcpy(list.corner, n->corner, sizeof n->corner);
    corners_clear(f, slot);
    return list;
}

static bool corners_next(mni_front *f, loose *list) {
    uint32_t i = list->more;
    if (i == MN_NONE)
        return false;
    memcpy(list->corner, f->chunk[i].corner, sizeof f->chunk[i].corner);
    list->count = run_count(list->corner, MNI_FRONT_CHUNK);
    list->more = f->chunk[i].next;
    chunk_free(f, i);
    return true;
}

/* The slots of the other two corners of a corner's simplex; MN_NONE: a hinge has one. */
static inline void others(const mni_front *f, uint32_t c, uint32_t out[2]) {
    static const uint8_t other[4][2] = {{1, 2}, {2, 0}, {0, 1}, {0, 0}};
    const uint32_t *node = &f->simplex_node[3 * (size_t)(c / 4)];
    out[0] = node[other[c % 4][0]];
    out[1] = node[other[c % 4][1]];
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
    const mni_front_node *key = &f->node[slot];
    const mni_facts facts = {key->order, f->switch_value[slot], f->radius[slot],
                             f->face[slot].cone};
    return mni_facts_equal(&facts, &record->facts) && s->leaf_lo == key->leaf_lo &&
           s->leaf_hi == key->leaf_hi &&
           memcmp(s->position, &f->position[3 * (size_t)slot], sizeof s->position) == 0 &&
           (f->color == NULL || s->color == f->color[slot]);
}

/* Takes the block of a node's record into use once, for the first of its children. */
static mni_outcome record_take(mni_front *f, uint32_t slot, mni_entry *entry, mni_node *record) {
    const mni_front_node *p = &f->node[slot];
    mni_entry own = mni_front_entry(f, p->parent, slot);
    const void *bytes;
    const mni_block *block = view_of(f, own, &bytes);
    if ((p->flags & MNI_NODE_EXIT) == 0) {
        mni_block_node(block, f->face[slot].index, record);
        *entry = own;
        mni_store_add(f->store, *entry);
        return MNI_DONE;
    }
    mni_child where;
    mni_block_exit(block, f->face[slot].index, &where);
    mni_answer answer = mni_store_down(f->store, own, mni_frame_ref(bytes, where.ref), entry);
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
        if (f->node[lo + half].leaf_lo <= leaf) /* a root's slot has its first leaf for ever */
            lo += half;
        step -= half;
    }
    uint32_t at = f->root[lo];
    while (at & MNI_FRONT_BRANCH) {
        const mni_front_branch *b = &f->branch[at & ~MNI_FRONT_BRANCH];
        uint32_t right = b->child[1];
        uint32_t slot =
            right & MNI_FRONT_BRANCH ? f->branch[right & ~MNI_FRONT_BRANCH].slot : right;
        at = leaf >= f->node[slot].leaf_lo ? right : b->child[0];
    }
    return at;
}

static bool within(const mni_front_node *n, uint32_t leaf) {
    return n->leaf_lo <= leaf && leaf < n->leaf_hi;
}

/* The active node of a leaf that is a neighbour of slot's, where the file is what it should be. */
static uint32_t find_near(mni_front *f, uint32_t slot, uint32_t leaf) {
    uint32_t looked = 0, other[2];
    for (run r = run_first(f, slot); r.corner != NULL && looked < MNI_FRONT_NEAR_MAX;
         r = run_next(f, r), looked += r.room)
        for (uint32_t i = 0; i < r.room && r.corner[i] != MN_NONE; i++) {
            others(f, r.corner[i], other);
            for (int k = 0; k < 2; k++)
                if (other[k] != MN_NONE && within(&f->node[other[k]], leaf))
                    return other[k];
        }
    f->descents++;
    return mni_front_find(f, leaf);
}

/* The corner of a simplex that goes to the right child of its kill node. */
static uint32_t *right_corner(const mni_front *f, uint32_t s, const mni_front_node *p,
                              uint32_t mid) {
    const uint32_t *leaf = &f->simplex_leaf[3 * (size_t)s];
    for (int k = 0; k < 2; k++)
        if (leaf[k] >= mid && leaf[k] < p->leaf_hi)
            return &f->simplex_node[3 * (size_t)s + (size_t)k];
    return &f->simplex_node[3 * (size_t)s + 2];
}

/* One simplex killed at slot, its third corner found, onto the chain: until it is known which slot
 * its right corner goes to, the next one stands there. false: the block lies: a corner is not where
 * it must be, or an edge would appear between nodes that a valid front does not hold together. */
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
            if (f->node[third].order >= p->order || f->node[third].above <= p->order)
                return false;
            node[k] = third;
        }
    }
    if (left != 1 || right != 1 || corner[0] == MN_NONE || corner[1] == MN_NONE)
        return false;
    uint32_t s = simplex_new(f);
    memcpy(&f->simplex_leaf[3 * (size_t)s], corner, 3 * sizeof *corner);
    memcpy(&f->simplex_node[3 * (size_t)s], node, sizeof node);
    *right_corner(f, s, p, mid) = *chain;
    *chain = s;
    return true;
}

static void chain_drop(mni_front *f, uint32_t slot, uint32_t mid, uint32_t chain) {
    while (chain != MN_NONE) {
        uint32_t next = *right_corner(f, chain, &f->node[slot], mid);
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

/* The reference to a branch or slot in its parent, or where the roots stand. */
static uint32_t *reference(mni_front *f, uint32_t parent, uint32_t slot, uint32_t from) {
    if (parent == MNI_FRONT_NO_PARENT)
        return &f->root[slot];
    mni_front_branch *b = &f->branch[parent];
    MN_ASSERT(b->child[0] == from || b->child[1] == from);
    return &b->child[b->child[0] != from];
}

/* What its parent's block says of a node, into a slot; its first leaf stands there already. */
static void node_set(mni_front *f, uint32_t slot, uint32_t parent, uint32_t above,
                     const mni_child *from) {
    mni_front_node *n = &f->node[slot];
    bool leaf = from->kind == MNI_CHILD_LEAF, is_exit = from->kind == MNI_CHILD_SUBTREE;
    n->parent = parent & MNI_FRONT_NO_PARENT;
    n->witness = MN_NONE;
    f->face[slot].cone = leaf ? (mn_cone){0} : from->facts.cone;
    f->face[slot].index = (uint16_t)(is_exit ? from->exit : from->node);
    n->flags = is_exit ? MNI_NODE_EXIT : 0;
    f->node[slot].order = leaf ? f->node[slot].leaf_lo : from->facts.order;
    f->node[slot].above = above;
    f->radius[slot] = leaf ? 0 : from->facts.radius;
    f->switch_value[slot] = leaf ? 0 : from->facts.switch_value;
    f->node_stamp[slot / MN_FRONT_PAGE] = (uint32_t)f->version;
}

static uint32_t branch_make(mni_front *f, uint32_t slot, uint32_t right, mni_entry home) {
    const mni_front_node *p = &f->node[slot];
    uint32_t b = branch_new(f);
    f->branch[b] = (mni_front_branch){.order = f->node[slot].order,
                                      .switch_value = f->switch_value[slot],
                                      .radius = f->radius[slot],
                                      .face = f->face[slot],
                                      .child = {slot, right},
                                      .parent = p->parent,
                                      .home = home,
                                      .slot = slot,
                                      .blocker = MN_NONE,
                                      .exit = (p->flags & MNI_NODE_EXIT) != 0};
    *reference(f, p->parent, slot, slot) = b | MNI_FRONT_BRANCH;
    return b;
}

/* Hands those of p's corners that are the right child's to it. */
static void corners_part(mni_front *f, uint32_t slot, uint32_t right, uint32_t mid) {
    loose list = corners_take(f, slot);
    do {
        for (uint32_t i = 0; i < list.count; i++) {
            if (leaf_of(f, list.corner[i]) < mid)
                corner_push(f, slot, list.corner[i]);
            else
                corner_give(f, right, list.corner[i]);
        }
    } while (corners_next(f, &list));
}

/* The simplices on the chain appear. Returns how many. p: as it was. */
static uint32_t chain_link(mni_front *f, const mni_front_node *p, uint32_t right, uint32_t mid,
                           uint32_t chain) {
    uint32_t count = 0;
    for (uint32_t s = chain; s != MN_NONE; count++) {
        uint32_t *node = &f->simplex_node[3 * (size_t)s], *moves = right_corner(f, s, p, mid);
        s = *moves;
        *moves = right;
        f->triangles += node[2] != MN_NONE;
        uint32_t at = (uint32_t)((node - f->simplex_node) / 3);
        for (uint32_t k = 0; k < 3; k++)
            if (node[k] != MN_NONE)
                corner_give(f, node[k], 4 * at + k);
    }
    return count;
}

/* p, whose record is read and whose simplices wait on the chain, becomes a branch. */
static uint32_t part(mni_front *f, uint32_t slot, mni_entry home, const mni_node *record,
                     uint32_t chain) {
    const mni_front_node p = f->node[slot];
    uint32_t right = slot_new(f), b = branch_make(f, slot, right, home);
    change_note(f, slot);
    change_note(f, right);
    f->node[slot].leaf_hi = record->leaf_mid;
    f->node[right].leaf_lo = record->leaf_mid;
    f->node[right].leaf_hi = p.leaf_hi;
    memcpy(&f->position[3 * (size_t)right], record->right_position, 3 * sizeof *f->position);
    if (f->color != NULL)
        f->color[right] = record->right_color;
    corners_clear(f, right);
    corners_part(f, slot, right, record->leaf_mid);
    node_set(f, slot, b, p.order, &record->left);
    node_set(f, right, b, p.order, &record->right);
    f->branch[b].killed = chain_link(f, &p, right, record->leaf_mid, chain) & INT32_MAX;
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
    uint32_t chain = MN_NONE;
    mni_outcome outcome = record_take(f, slot, &home, &record);
    if (outcome == MNI_DONE) {
        outcome = simplices_prepare(f, slot, home, &record, &chain);
        if (outcome != MNI_DONE) {
            chain_drop(f, slot, record.leaf_mid, chain);
            mni_store_sub(f->store, home);
        }
    }
    if (outcome == MNI_BAD) {
        f->node[slot].flags |= MNI_NODE_BAD;
        f->bad++;
    }
    if (outcome != MNI_DONE)
        return outcome;
    mni_store_add(f->store, home); /* for the second child */
    *branch = part(f, slot, home, &record, chain);
    return MNI_DONE;
}

void mni_front_release(mni_front *f, uint32_t branch) {
    const mni_front_branch *b = &f->branch[branch];
    MN_ASSERT(mni_front_is_branch(f, branch));
    mni_store_sub(f->store, mni_front_entry(f, b->parent, b->slot));
    f->version++;
}

/* ---- collapse -------------------------------------------------------------------------------- */

/* Kills what has a corner in both children, and hands the right one's other corners to the left. */
static uint32_t corners_join(mni_front *f, uint32_t left, uint32_t right) {
    uint32_t killed = 0;
    loose list = corners_take(f, right);
    do {
        for (uint32_t i = 0; i < list.count; i++) {
            uint32_t c = list.corner[i], s = c / 4, other[2];
            const uint32_t *node = &f->simplex_node[3 * (size_t)s];
            others(f, c, other);
            if (other[0] != left && other[1] != left) {
                corner_give(f, left, c);
                continue;
            }
            for (uint32_t k = 0; k < 3; k++)
                if (k != c % 4 && node[k] != MN_NONE)
                    corner_remove(f, 4 * s + k);
            f->triangles -= node[2] != MN_NONE;
            simplex_free(f, s);
            killed++;
        }
    } while (corners_next(f, &list));
    return killed;
}

/* Without the stores' part, which differs. */
static void join(mni_front *f, uint32_t branch) {
    const mni_front_branch *b = &f->branch[branch];
    MN_ASSERT(mni_front_is_fork(f, branch) && b->child[0] == b->slot);
    uint32_t slot = b->slot, right = b->child[1], killed = corners_join(f, slot, right);
    MN_ASSERT(killed == b->killed);
    change_note(f, slot);
    change_note(f, right);
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
    slot_free(f, right);
    branch_free(f, branch);
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

/* ---- implicit dependencies ------------------------------------------------------------------- */

/* A witness is a neighbour of n's still: the node that was seen is active. Two nodes that are
 * neighbours once stay so while both are active: a simplex that joins them dies only with one of
 * them. Whether it blocks now is for the caller to see: one serves both moves. */
static bool witness_stands(const mni_front *f, const mni_front_node *n) {
    return n->witness != MN_NONE && f->node[n->witness].order == n->witness_order;
}

static void witness_set(mni_front *f, uint32_t slot, uint32_t found) {
    f->node[slot].witness = found;
    f->node[slot].witness_order = f->node[found].order;
}

uint32_t mni_front_split_blockers(const mni_front *f, uint32_t slot, mni_front_ref *out,
                                  uint32_t room) {
    uint32_t order = f->node[slot].order, count = 0, other[2];
    for (run r = run_first(f, slot); r.corner != NULL; r = run_next(f, r))
        for (uint32_t i = 0; i < r.room && r.corner[i] != MN_NONE; i++) {
            others(f, r.corner[i], other);
            for (int k = 0; k < 2; k++) {
                if (other[k] == MN_NONE || f->node[other[k]].order <= order)
                    continue;
                out[count++] = mni_front_ref_of(f, other[k]);
                if (count == room)
                    return count;
            }
        }
    return count;
}

uint32_t mni_front_split_blocker(mni_front *f, uint32_t slot) {
    const mni_front_node *p = &f->node[slot];
    if (witness_stands(f, p) && p->witness_order > f->node[slot].order)
        return p->witness;
    mni_front_ref found;
    if (mni_front_split_blockers(f, slot, &found, 1) == 0)
        return MN_NONE;
    witness_set(f, slot, found.slot);
    return found.slot;
}

static uint32_t collapse_blocker_at(const mni_front *f, uint32_t slot, uint32_t order) {
    uint32_t other[2];
    for (run r = run_first(f, slot); r.corner != NULL; r = run_next(f, r))
        for (uint32_t i = 0; i < r.room && r.corner[i] != MN_NONE; i++) {
            others(f, r.corner[i], other);
            for (int k = 0; k < 2; k++) /* the sibling's parent is the fork itself */
                if (other[k] != MN_NONE && f->node[other[k]].above < order)
                    return other[k];
        }
    return MN_NONE;
}

uint32_t mni_front_collapse_blocker(mni_front *f, uint32_t fork) {
    const mni_front_branch *b = &f->branch[fork];
    for (int side = 0; side < 2; side++) {
        const mni_front_node *n = &f->node[b->child[side]];
        if (witness_stands(f, n) && f->node[n->witness].above < b->order)
            return n->witness;
    }
    for (int side = 0; side < 2; side++) {
        uint32_t found = collapse_blocker_at(f, b->child[side], b->order);
        if (found != MN_NONE) {
            witness_set(f, b->child[side], found);
            return found;
        }
    }
    return MN_NONE;
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
    uint32_t slot = slot_new(f);
    MN_ASSERT(slot == r); /* mni_front_find and mni_front_entry count on it */
    mni_child self = {.kind = MNI_CHILD_INNER, .node = subtree.node, .facts = record.facts};
    f->node[slot].leaf_lo = subtree.leaf_lo;
    f->node[slot].leaf_hi = subtree.leaf_hi;
    corners_clear(f, slot);
    memcpy(&f->position[3 * (size_t)slot], subtree.position, sizeof subtree.position);
    if (f->color != NULL)
        f->color[slot] = subtree.color;
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
                     .slot_free = MN_NONE,
                     .branch_free = MN_NONE,
                     .chunk_free = MN_NONE,
                     .simplex_free = MN_NONE};
    f->limits = (mni_block_limits){.leaves = header->leaves,
                                   .nodes = header->nodes,
                                   .file_bytes = header->file_bytes,
                                   .has_colors = header->has_colors};
    MN_ASSERT(nodes_max >= header->roots && nodes_max < MNI_FRONT_NO_PARENT);
    MN_ASSERT(simplices_max <= UINT32_MAX / 4);
    lay_out(f, arena, header->has_colors);
    for (uint32_t i = 0; i < MNI_FRONT_VIEWS; i++)
        f->view[i].entry = MNI_NO_ENTRY;
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
