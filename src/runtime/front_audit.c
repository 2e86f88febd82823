/* What can be said of a whole front: its hash, its balance, its invariants by recount.
 *
 * Hides: how they are computed. All but leaf_position only read the front. Threads: Navigate only;
 * no memory but the caller's scratch
 * (input_is_closed, which is called before the seal: one block). Each is O(front) and more: for
 * statistics and checks, outside the timed part of a frame. Paper: none; design.md §6. */
#include <stdlib.h>
#include <string.h>

#include <xxhash.h>

#include "mn_assert.h"
#include "extents.h"
#include "frame.h"
#include "front.h"
#include "pole.h"

/* Ascending, by three passes of 11 bits. */
static void sort_u32(uint32_t *values, uint32_t *other, size_t count) {
    for (int pass = 0; pass < 3; pass++) {
        uint32_t start[2049] = {0};
        int shift = 11 * pass;
        for (size_t i = 0; i < count; i++)
            start[1 + ((values[i] >> shift) & 2047)]++;
        for (int d = 0; d < 2048; d++)
            start[d + 1] += start[d];
        for (size_t i = 0; i < count; i++)
            other[start[(values[i] >> shift) & 2047]++] = values[i];
        uint32_t *swap = values;
        values = other;
        other = swap;
    }
}

uint64_t mni_front_hash(const mni_front *f, uint32_t *scratch) {
    size_t count = 0;
    for (uint32_t slot = 0; slot < f->slots_high; slot++)
        if (mni_front_is_active(f, slot))
            scratch[count++] = f->node[slot].order;
    MN_ASSERT(count == f->active);
    sort_u32(scratch, scratch + count, count); /* three passes: it ends in the other half */
    return XXH3_64bits(scratch + count, count * sizeof *scratch);
}

/* Each directed edge u → v adds a hash of the pair {u, v} if u < v and takes it away if not: the
 * sum vanishes when both directions are used equally often. */
static uint64_t directed(uint32_t u, uint32_t v) {
    uint64_t key = u < v ? (uint64_t)u << 32 | v : (uint64_t)v << 32 | u;
    uint64_t hash = XXH3_64bits(&key, sizeof key);
    return u < v ? hash : 0 - hash;
}

uint64_t mni_front_imbalance(const mni_front *f) {
    uint64_t sum = 0;
    for (uint32_t s = 0; s < f->simplices_high; s++) {
        const uint32_t *node = &f->simplex_node[3 * (size_t)s];
        if (node[0] == MN_NONE || node[2] == MN_NONE)
            continue;
        for (int k = 0; k < 3; k++)
            sum += directed(node[k], node[(k + 1) % 3]);
    }
    return sum;
}

/* ---- the input ------------------------------------------------------------------------------- */

static uint64_t edges_of(const uint32_t corner[3]) {
    uint64_t sum = 0;
    for (int k = 0; k < 3; k++)
        sum += directed(corner[k], corner[(k + 1) % 3]);
    return corner[2] == MN_NONE ? 0 : sum;
}

/* The directed edges of the triangles in one block. false: no sound block. */
static bool add_block(const void *bytes, uint32_t length_bytes, const mni_block_limits *limits,
                      uint64_t *sum) {
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    uint32_t corner[3];
    mni_overflow overflow;
    mni_block block;
    if (!mni_front_block_check(limits, bytes, length_bytes))
        return false;
    if (frame.kind == MNI_FRAME_OVERFLOW) {
        if (!mni_overflow_open(&overflow, bytes, length_bytes, limits, NULL, 0))
            return false;
        for (uint32_t i = 0; i < overflow.simplices; i++) {
            mni_overflow_simplex(&overflow, i, corner);
            *sum += edges_of(corner);
        }
        return true;
    }
    mni_walk walk;
    mni_node record;
    uint32_t node;
    mni_block_reopen(&block, bytes);
    mni_walk_begin(&walk, &block);
    while (mni_walk_next(&walk, &node, &record))
        for (uint32_t i = 0; i < record.simplex_count; i++) {
            mni_block_simplex(&block, &record, i, corner);
            *sum += edges_of(corner);
        }
    return true;
}

bool mni_front_input_is_closed(const char *path, const mn_header *header) {
    const mni_block_limits limits = mni_block_limits_of(header);
    unsigned char *bytes = aligned_alloc(MN_PAGE_BYTES, header->block_bytes_max);
    mni_stored file;
    if (bytes == NULL || mni_stored_open(&file, path, header, NULL) != MN_OK) {
        free(bytes);
        return false;
    }
    uint64_t sum = 0;
    bool sound = true;
    for (uint32_t id = 1; sound && id < header->file_bytes / MN_PAGE_BYTES;) {
        mn_block_ref ref = mni_stored_block(&file, id);
        uint64_t length = (uint64_t)ref.pages * MN_PAGE_BYTES;
        sound = length > 0 && length <= header->block_bytes_max &&
                mni_stored_read(&file, ref, bytes) == (int64_t)length &&
                mni_frame_check(bytes, ref, header->build_id, header->file_bytes) == MNI_FRAME_OK &&
                add_block(bytes, (uint32_t)length, &limits, &sum);
        id += ref.pages;
    }
    mni_stored_close(&file);
    free(bytes);
    return sound && sum == 0;
}

void mni_front_usage(const mni_front *f, uint32_t *counts) {
    for (uint32_t slot = 0; slot < f->slots_high; slot++)
        if (mni_front_is_active(f, slot))
            counts[mni_front_entry(f, f->node[slot].parent, slot)]++;
}

/* ---- recounts -------------------------------------------------------------------------------- */

/* Invariant 1 of a simplex: each corner at the active node that holds its leaf, no two at one; and
 * the validity of the front between the nodes that it joins. */
static void check_simplex(const mni_front *f, uint32_t s) {
    const uint32_t *leaf = &f->simplex_leaf[3 * (size_t)s], *node = &f->simplex_node[3 * (size_t)s];
    int corners = node[2] == MN_NONE ? 2 : 3;
    for (int k = 0; k < corners; k++) {
        const mni_front_node *n = &f->node[node[k]], *v = &f->node[node[(k + 1) % corners]];
        MN_ASSERT(n->order != MN_NONE && v != n);
        MN_ASSERT(n->leaf_lo <= leaf[k] && leaf[k] < n->leaf_hi);
        MN_ASSERT(n->order < v->above && v->order < n->above);
    }
}

/* Packed lists: only the first chunk may have room left. */
static uint64_t check_corners(const mni_front *f, uint32_t slot, const uint32_t *corner,
                              uint32_t room, bool first) {
    uint64_t count = 0;
    for (uint32_t i = 0; i < room && corner[i] != 0; i++, count++)
        MN_ASSERT(f->simplex_node[3 * (size_t)(corner[i] / 4) + corner[i] % 4] == slot);
    MN_ASSERT(first ? count > 0 : count == room);
    return count;
}

static uint64_t check_slot(const mni_front *f, uint32_t slot) {
    const mni_front_node *n = &f->node[slot];
    bool is_root = n->parent == MNI_FRONT_NO_PARENT;
    MN_ASSERT(n->leaf_lo < n->leaf_hi && n->leaf_hi <= f->header->leaves);
    MN_ASSERT(mni_front_find(f, n->leaf_lo) == slot);
    MN_ASSERT(mni_front_is_leaf(f, slot) == (n->leaf_hi - n->leaf_lo == 1));
    MN_ASSERT(is_root || f->branch[n->parent].slot != slot ||
              f->branch[n->parent].leaf_lo == n->leaf_lo);
    MN_ASSERT(n->above == (is_root ? MN_NONE : f->branch[n->parent].order));
    if (n->more == MNI_FRONT_SHORT && n->corner[0] == 0)
        return 0;
    if (mni_front_is_pole(n))
        return mni_pole_check(f, slot);
    bool is_long = mni_front_is_long(n);
    uint64_t corners = check_corners(f, slot, n->corner, MNI_FRONT_CORNERS, !is_long);
    MN_ASSERT(is_long || n->more == MNI_FRONT_SHORT + corners);
    for (uint32_t i = is_long ? n->more : MN_NONE; i != MN_NONE; i = f->chunk[i].next)
        corners += check_corners(f, slot, f->chunk[i].corner, MNI_FRONT_CHUNK, i == n->more);
    return corners;
}

/* The slot of a child's first leaf. */
static uint32_t check_child(const mni_front *f, uint32_t branch, uint32_t child) {
    const mni_front_branch *b = &f->branch[branch];
    if ((child & MNI_FRONT_BRANCH) == 0) {
        MN_ASSERT(f->node[child].parent == branch && f->node[child].order < b->order);
        return child;
    }
    const mni_front_branch *below = &f->branch[child & ~MNI_FRONT_BRANCH];
    MN_ASSERT(below->parent == branch && below->order < b->order);
    return below->slot;
}

static void check_branch(const mni_front *f, uint32_t branch) {
    const mni_front_branch *b = &f->branch[branch];
    uint32_t left = check_child(f, branch, b->child[0]),
             right = check_child(f, branch, b->child[1]);
    MN_ASSERT(left == b->slot && right == branch && mni_front_is_active(f, right));
    MN_ASSERT(f->node[left].leaf_lo < f->node[right].leaf_lo);
    MN_ASSERT(mni_front_is_fork(f, branch) ==
              (((b->child[0] | b->child[1]) & MNI_FRONT_BRANCH) == 0));
}

void mni_front_check(const mni_front *f) {
    uint64_t corners = 0, killed = 0, active = 0, expanded = 0, leaves = 0;
    for (uint32_t slot = 0; slot < f->slots_high; slot++) {
        MN_ASSERT(mni_front_is_active(f, slot) != mni_vacancy_is_free(&f->slots, slot));
        if (!mni_front_is_active(f, slot))
            continue;
        corners += check_slot(f, slot);
        leaves += f->node[slot].leaf_hi - f->node[slot].leaf_lo;
        active++;
    }
    for (uint32_t b = 0; b < f->slots_high; b++) {
        if (!mni_front_is_branch(f, b)) {
            MN_ASSERT(!mni_front_is_fork(f, b));
            continue;
        }
        check_branch(f, b);
        killed += f->branch[b].killed;
        expanded++;
    }
    uint64_t simplices = 0, triangles = 0;
    for (uint32_t s = 0; s < f->simplices_high; s++) {
        const uint32_t *node = &f->simplex_node[3 * (size_t)s];
        MN_ASSERT(s == 0 || (node[0] == MN_NONE) == mni_vacancy_is_free(&f->simplices, s));
        if (node[0] == MN_NONE)
            continue;
        check_simplex(f, s);
        simplices++;
        triangles += node[2] != MN_NONE;
    }
    mni_vacancy_check(&f->slots, f->active);
    mni_vacancy_check(&f->simplices, 1 + f->simplices_used); /* and simplex 0 */
    MN_ASSERT(active == f->active && active == expanded + f->header->roots);
    MN_ASSERT(leaves == f->header->leaves); /* found by their first leaf, so they cover all once */
    MN_ASSERT(simplices == f->simplices_used && triangles == f->triangles);
    MN_ASSERT(simplices == killed); /* all that is killed above the front, and nothing else */
    MN_ASSERT(corners == 2 * simplices + triangles);
}

/* ---- the input beneath the front ------------------------------------------------------------- */

static void block_reopen(mni_front *f, mni_entry entry, mni_block *block) {
    bool fresh;
    const void *bytes = mni_store_bytes(f->store, entry, &fresh);
    if (fresh) /* whoever asks is told once: forget the view */
        f->view[entry % MNI_FRONT_VIEWS].entry = MNI_NO_ENTRY;
    mni_block_reopen(block, bytes);
}

/* Takes the block of an exit into use. The exit's place and facts go into *at. */
static bool exit_down(mni_front *f, mni_entry entry, const mni_block *block, mni_child *at,
                      mni_entry *below) {
    bool fresh;
    mni_block_exit(block, at->exit, at);
    mn_block_ref ref = mni_frame_ref(mni_store_bytes(f->store, entry, &fresh), at->ref);
    return mni_store_down(f->store, entry, ref, below) == MNI_GRANTED;
}

/* The node of an exit in its own block. false: it is another, so a walk down would not end. */
static bool subtree_node(const mni_block *block, const mni_place *place, mni_child *at) {
    mni_subtree subtree;
    mni_facts facts;
    if (at->subtree >= block->subtrees)
        return false;
    mni_block_subtree(block, at->subtree, &subtree);
    mni_block_facts(block, subtree.node, &facts);
    at->node = subtree.node;
    return subtree.leaf_lo == place->leaf_lo && subtree.leaf_hi == place->leaf_hi &&
           facts.order == at->facts.order;
}

/* Down from an active node through the blocks. One block besides the node's own is in use at a
 * time, and given back. */
bool mni_front_leaf_position(mni_front *f, uint32_t slot, uint32_t leaf, float position[3]) {
    const mni_front_node *n = &f->node[slot];
    const mni_entry own = mni_front_entry(f, n->parent, slot);
    mni_entry entry = own;
    mni_place place = {n->leaf_lo, n->leaf_hi, {0}};
    memcpy(place.position, &f->position[3 * (size_t)slot], sizeof place.position);
    mni_child at = {.kind = n->flags & MNI_NODE_EXIT ? MNI_CHILD_SUBTREE : MNI_CHILD_INNER,
                    .node = f->face[slot].index,
                    .exit = f->face[slot].index};
    bool there = true;
    while (place.leaf_lo != leaf && there) {
        mni_block block;
        mni_node record;
        block_reopen(f, entry, &block);
        if (at.kind == MNI_CHILD_SUBTREE) {
            mni_entry below;
            there = exit_down(f, entry, &block, &at, &below);
            if (!there)
                break;
            if (entry != own)
                mni_store_sub(f->store, entry);
            entry = below;
            block_reopen(f, entry, &block);
            there = subtree_node(&block, &place, &at);
            if (!there)
                break;
        }
        mni_block_node(&block, at.node, &place, &record);
        bool right = leaf >= record.leaf_mid;
        at = right ? record.right : record.left;
        if (right) {
            place.leaf_lo = record.leaf_mid;
            memcpy(place.position, record.right_position, sizeof place.position);
        } else {
            place.leaf_hi = record.leaf_mid;
        }
        there = at.kind != MNI_CHILD_LEAF || place.leaf_lo == leaf;
    }
    memcpy(position, place.position, sizeof place.position);
    if (entry != own)
        mni_store_sub(f->store, entry);
    return there;
}
