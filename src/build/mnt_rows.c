/* From the blocks of a .mnt to rows, in the order of leaves.
 *
 * Hides: how blocks are followed and what is compared across them. A block's subtrees are gone
 * through left to right; where one ends in an exit, the walk goes on in the child block, and comes
 * back when that subtree is over. So the blocks from a root down to where the walk stands are open,
 * and no others:
 *
 *     level 0   roots of the header, as exits of no block
 *           1   [ subtree ┄ node ┄ exit ─┐  ┄ node … ]       inside a block the way up is a stack
 *           2                            [ subtree, … ]      of nodes: those whose left side the
 *                                                            walk is in
 *
 * A child block that has more subtrees stays open, for packed blocks hold neighbours; one that is
 * asked for again after all is read again. What its parent says of a child and what the child says
 * of itself must agree; every order id comes once; all that the header counts is counted again; the
 * build id is that of the rows as they come.
 *
 * Order: see mnt_rows.h. One thread; blocks on the disk. Memory: open blocks with 40 bytes a
 * node and 60 an exit; a bit a node, and where the cap has no room for all of them, one for as many
 * as it has, and another walk for the next. Paper: §3.2. */
#include "mnt_rows.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#define XXH_STATIC_LINKING_ONLY /* the state's size */
#include <xxhash.h>

#include "mn_assert.h"
#include "cap.h"
#include "frame.h"
#include "header.h"
#include "simplify.h"
#include "tree_rows.h"
#include "watch.h"

enum {
    WATCH_EVERY = 64,      /* blocks */
    ROOM_LEAST = 64 << 10, /* bytes, for open blocks and marks */
};

/* Where a side of a node leads: a node of the block, an exit, or a leaf. */
#define WAY_EXIT (UINT32_C(1) << 31)
#define WAY_LEAF UINT32_MAX

typedef struct place {
    mni_place at;
    uint32_t mid, depth; /* depth: nodes from the root down to it, itself included */
    uint32_t left, right;
} place;

typedef struct exit_place {
    mni_place at;
    mni_facts facts; /* not of a root */
    uint32_t ref, subtree, depth;
    uint32_t mid; /* MN_NONE until the walk has been there */
} exit_place;

/* A block that is open. */
typedef struct level {
    mn_block_ref self; /* pages 0: none */
    uint32_t ref;      /* of its parent, whose exits are its subtrees */
    unsigned char *bytes;
    mni_block view;
    uint32_t refs;
    place *node;
    exit_place *exit;
    uint32_t exits;
    uint32_t *by_ref;    /* exits by reference and subtree; of reference r, from ref_start[r] on */
    uint32_t *ref_start; /* refs + 1 */
    uint32_t bytes_room, node_room, exit_room, by_ref_room, ref_start_room;
    uint32_t go;     /* where the walk goes next; WAY_LEAF: up */
    uint32_t inside; /* nodes on the stack */
    uint32_t stack[MNI_BLOCK_DEPTH_MAX + 2];
} level;

typedef struct walk {
    const char *path;
    const mni_mnt *mnt;
    const mni_walk_desc *desc;
    const mni_walk_sink *sink;
    mn_header header; /* const */
    mn_header found;  /* the counts as they are in the blocks */
    mni_block_limits limits;
    mni_stored *stored;
    mn_status *st;
    uint64_t room, held; /* bytes of open blocks: at most, and now */
    level **level;       /* [0]: the roots */
    uint32_t levels, levels_room;
    unsigned char *overflow;
    uint32_t overflow_room;
    uint64_t *mark; /* of order ids from mark_from on */
    uint64_t mark_from, marks, ids;
    uint32_t simplices, triangles, next_leaf; /* so far */
    uint64_t pages, payload_bytes;
    XXH3_state_t sum[MNI_SECTIONS];
} walk;

static uint64_t byte_of(const walk *w, uint32_t id) {
    return mni_extents_find(&w->stored->extents, (mn_block_ref){id, 1}).offset;
}

#define BAD(w, id, format, ...)                                                                    \
    mn_fail((w)->st, MN_BAD_INPUT,                                                                 \
            "%s: block %u (at byte %llu): " format "; the file is damaged: build it again",        \
            (w)->path, id, (unsigned long long)byte_of(w, id), __VA_ARGS__)

/* ---- memory --------------------------------------------------------------------------------- */

static mn_code no_memory(walk *w) {
    return mn_fail(w->st, MN_FAILED, "%s: no memory for its blocks", w->path);
}

static uint64_t marks_bytes(uint64_t ids) {
    return (ids + 63) / 64 * sizeof(uint64_t);
}

/* The most that open blocks may take, by what the header says: exits are at most two a node. */
static uint64_t blocks_bytes(const mn_header *h) {
    const uint64_t node = sizeof(place) + 2 * (sizeof(exit_place) + sizeof(uint32_t));
    return ((uint64_t)h->block_depth + 1) * (sizeof(level) + 2 * (uint64_t)h->block_bytes_max +
                                             h->nodes_per_block_max * node * 9 / 8);
}

static uint64_t beside_bytes(const walk *w) {
    return MNI_PROGRAM_BYTES + w->desc->held_bytes + w->stored->arena.size_bytes;
}

/* Refuses, and names what does for blocks as large, as deep and as branched as the header allows,
 * since how they are is known when all have been read: mostly less would do. */
static mn_code too_small(walk *w) {
    const uint64_t marks = marks_bytes(w->ids), blocks = blocks_bytes(&w->header);
    const uint64_t bytes = blocks + (marks < blocks ? marks : blocks) + ROOM_LEAST;
    return mn_fail(w->st, MN_CAP_TOO_SMALL,
                   "%s: %.1f MB of memory are too few to read it in: try --ram %lluM", w->path,
                   (double)w->desc->ram_bytes / (1 << 20), mni_megabytes(beside_bytes(w) + bytes));
}

/* Makes an array of `room` items one of at least `needed`; what was in it may be lost. */
static mn_code grow(walk *w, void **array, uint32_t needed, uint32_t *room, size_t size) {
    if (needed <= *room && *array != NULL)
        return MN_OK;
    const uint64_t before = (uint64_t)*room * size;
    const uint64_t wanted = (uint64_t)needed + needed / 8 + 1;
    if (w->held - before + wanted * size > w->room)
        return too_small(w);
    free(*array);
    *array = malloc(wanted * size);
    w->held = w->held - before + (*array != NULL ? wanted * size : 0);
    *room = *array != NULL ? (uint32_t)wanted : 0;
    return *array != NULL ? MN_OK : no_memory(w);
}
#define GROW(w, array, needed, room) grow(w, (void **)&(array), needed, &(room), sizeof *(array))

static void free_level(level *l) {
    if (l == NULL)
        return;
    free(l->bytes);
    free(l->node);
    free(l->exit);
    free(l->by_ref);
    free(l->ref_start);
    free(l);
}

/* Level `at` is there, though it may hold nothing. */
static mn_code need_level(walk *w, uint32_t at) {
    if (at < w->levels)
        return MN_OK;
    if (at == w->levels_room) {
        const uint32_t room = 2 * w->levels_room + 16;
        level **more = realloc(w->level, room * sizeof *more);
        if (more == NULL)
            return no_memory(w);
        w->level = more;
        w->levels_room = room;
    }
    level *l = calloc(1, sizeof *l);
    if (l == NULL)
        return no_memory(w);
    w->held += sizeof *l;
    w->level[w->levels++] = l;
    return MN_OK;
}

/* ---- blocks --------------------------------------------------------------------------------- */

static mn_code read_block(walk *w, mn_block_ref at, unsigned char **bytes, uint32_t *room) {
    if (at.pages > w->header.block_bytes_max / MN_PAGE_BYTES)
        return BAD(w, at.id, "longer than the header's block_bytes_max (%u pages)", at.pages);
    const uint32_t length = at.pages * MN_PAGE_BYTES;
    mn_code code = grow(w, (void **)bytes, length, room, 1);
    if (code != MN_OK)
        return code;
    int64_t got = mni_stored_read(w->stored, at, *bytes);
    if (got == -EBADMSG)
        return BAD(w, at.id, "%s", "its extent is not that of a compressed block");
    if (got < 0)
        return mn_fail(w->st, MN_FAILED, "%s: block %u: cannot read: %s", w->path, at.id,
                       strerror((int)-got));
    if (got != length)
        return BAD(w, at.id, "only %lld of %u bytes are there", (long long)got, length);
    mni_frame_fault fault = mni_frame_check(*bytes, at, w->header.build_id, w->header.file_bytes);
    return fault == MNI_FRAME_OK ? MN_OK : BAD(w, at.id, "%s", mni_frame_fault_text(fault));
}

static mn_code count_block(walk *w, mn_block_ref at, const unsigned char *bytes) {
    mn_header *found = &w->found;
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    w->pages += at.pages;
    w->payload_bytes += frame.payload_bytes;
    if (at.pages * MN_PAGE_BYTES > found->block_bytes_max)
        found->block_bytes_max = at.pages * MN_PAGE_BYTES;
    if (frame.refs > found->children_max)
        found->children_max = frame.refs;
    if (++found->blocks > w->header.blocks)
        return BAD(w, at.id, "more than the %u blocks that the header counts", w->header.blocks);
    return found->blocks % WATCH_EVERY == 0
               ? mni_watch(w->desc->watch, w->desc->phase, found->blocks, w->header.blocks, w->st)
               : MN_OK;
}

/* ---- opening a block ------------------------------------------------------------------------ */

/* Puts the exits in order of reference and subtree. Where two claim one place, or one claims none,
 * another stays MN_NONE: the child block finds that. */
static mn_code sort_exits(walk *w, level *l) {
    mn_code code = GROW(w, l->ref_start, l->refs + 1, l->ref_start_room);
    if (code == MN_OK)
        code = GROW(w, l->by_ref, l->exits, l->by_ref_room);
    if (code != MN_OK)
        return code;
    memset(l->ref_start, 0, (l->refs + 1) * sizeof *l->ref_start);
    for (uint32_t e = 0; e < l->exits; e++) {
        l->ref_start[l->exit[e].ref + 1]++;
        l->by_ref[e] = MN_NONE;
    }
    for (uint32_t r = 0; r < l->refs; r++)
        l->ref_start[r + 1] += l->ref_start[r];
    for (uint32_t e = 0; e < l->exits; e++) {
        const exit_place *x = &l->exit[e];
        if (x->subtree < l->ref_start[x->ref + 1] - l->ref_start[x->ref])
            l->by_ref[l->ref_start[x->ref] + x->subtree] = e;
    }
    return MN_OK;
}

/* Each reference is there for exits or for one overflow, which have been counted in overflows. */
static mn_code check_refs(walk *w, const level *l, const unsigned char *overflows) {
    for (uint32_t r = 0; r < l->refs; r++) {
        const bool has_exits = l->ref_start[r + 1] > l->ref_start[r];
        if (has_exits + overflows[r] != 1)
            return BAD(w, l->self.id, "reference %u is used %s", r,
                       has_exits || overflows[r] > 0 ? "for two things" : "for nothing");
    }
    return MN_OK;
}

/* Where a child of a node at `parent` leads, and what is known of it there. */
static uint32_t way_to(level *l, const mni_child *child, mni_place at, uint32_t depth) {
    if (child->kind == MNI_CHILD_LEAF)
        return WAY_LEAF;
    if (child->kind == MNI_CHILD_INNER) {
        l->node[child->node].at = at;
        l->node[child->node].depth = depth;
        return child->node;
    }
    l->exit[l->exits] = (exit_place){at, child->facts, child->ref, child->subtree, depth, MN_NONE};
    return WAY_EXIT | l->exits++;
}

/* Nodes from top to bottom: the roots of subtrees have their places already. */
static mn_code place_nodes(walk *w, level *l) {
    mn_code code = GROW(w, l->exit, l->view.exits, l->exit_room);
    unsigned char *overflows = code == MN_OK ? calloc(l->refs + 1, 1) : NULL;
    if (overflows == NULL)
        return code == MN_OK ? no_memory(w) : code;
    l->exits = 0;
    for (uint32_t i = 0; i < l->view.nodes && code == MN_OK; i++) {
        place *p = &l->node[i];
        mni_node node;
        mni_block_node(&l->view, i, &p->at, &node);
        mni_place left = {p->at.leaf_lo, node.leaf_mid, {0}};
        mni_place right = {node.leaf_mid, p->at.leaf_hi, {0}};
        memcpy(left.position, p->at.position, sizeof left.position);
        memcpy(right.position, node.right_position, sizeof right.position);
        p->mid = node.leaf_mid;
        p->left = way_to(l, &node.left, left, p->depth + 1);
        p->right = way_to(l, &node.right, right, p->depth + 1);
        if ((p->left == WAY_LEAF || p->right == WAY_LEAF) && p->depth + 1 > w->found.depth_max)
            w->found.depth_max = p->depth + 1;
        if (node.overflow_ref != MN_NONE && overflows[node.overflow_ref]++ > 0)
            code = BAD(w, l->self.id, "reference %u leads to two overflows", node.overflow_ref);
    }
    if (code == MN_OK)
        code = sort_exits(w, l);
    if (code == MN_OK)
        code = check_refs(w, l, overflows);
    free(overflows);
    return code;
}

/* Are the block's subtrees those that its parent's exits by that reference lead to? */
static mn_code join_subtrees(walk *w, level *parent, uint32_t ref, level *l) {
    const uint32_t *exit = parent->by_ref + parent->ref_start[ref];
    const uint32_t exits = parent->ref_start[ref + 1] - parent->ref_start[ref];
    if (l->view.subtrees != exits)
        return BAD(w, l->self.id, "%u subtrees where its parent knows of %u", l->view.subtrees,
                   exits);
    for (uint32_t i = 0; i < exits; i++) {
        exit_place *from = exit[i] != MN_NONE ? &parent->exit[exit[i]] : NULL;
        mni_subtree s;
        mni_facts facts;
        mni_block_subtree(&l->view, i, &s);
        mni_block_facts(&l->view, s.node, &facts);
        if (from != NULL && parent == w->level[0]) { /* the header says less of a root */
            from->at.leaf_lo = s.leaf_lo;
            from->at.leaf_hi = s.leaf_hi;
            from->facts = facts;
        }
        if (from == NULL || s.leaf_lo != from->at.leaf_lo || s.leaf_hi != from->at.leaf_hi ||
            !mni_facts_equal(&facts, &from->facts))
            return BAD(w, l->self.id, "subtree %u is not what its parent says", i);
        l->node[s.node].at = from->at;
        l->node[s.node].depth = from->depth;
    }
    return MN_OK;
}

/* Reads the block that a reference of level `above` leads to into the next level. */
static mn_code open_block(walk *w, uint32_t above, uint32_t ref, mn_block_ref at) {
    mn_code code = need_level(w, above + 1);
    if (code != MN_OK)
        return code;
    level *parent = w->level[above], *l = w->level[above + 1];
    mni_frame frame;
    char why[160];
    l->self.pages = 0; /* until it is open */
    if (above + 2 < w->levels)
        w->level[above + 2]->self.pages = 0; /* another block's child */
    code = read_block(w, at, &l->bytes, &l->bytes_room);
    if (code != MN_OK)
        return code;
    l->self.id = at.id;
    mni_frame_get(l->bytes, &frame);
    if (frame.parent_id != parent->self.id)
        return BAD(w, at.id, "its parent is block %u, not %u", parent->self.id, frame.parent_id);
    if (!mni_block_open(&l->view, l->bytes, at.pages * MN_PAGE_BYTES, &w->limits, why, sizeof why))
        return BAD(w, at.id, "%s", why);
    l->refs = frame.refs;
    code = GROW(w, l->node, l->view.nodes, l->node_room);
    if (code == MN_OK)
        code = join_subtrees(w, parent, ref, l);
    if (code == MN_OK)
        code = place_nodes(w, l);
    if (code == MN_OK)
        l->self = at;
    l->ref = ref;
    return code;
}

/* ---- what is handed out --------------------------------------------------------------------- */

static mn_code mark_order(walk *w, uint32_t id, uint32_t order) {
    const uint64_t at = order - w->header.leaves - w->mark_from; /* below: past all others */
    if (at >= w->marks)
        return MN_OK;
    if (w->mark[at / 64] >> at % 64 & 1)
        return BAD(w, id, "node %u stands in the file twice", order);
    w->mark[at / 64] |= UINT64_C(1) << at % 64;
    return MN_OK;
}

static mn_code check_position(walk *w, uint32_t leaf, const float position[3]) {
    const double step = w->header.grid_step;
    mn_header *found = &w->found;
    for (int i = 0; i < 3; i++) {
        const float at = position[i];
        if (!isfinite(at) || rint(at / step) * step != at)
            return mn_fail(w->st, MN_BAD_INPUT,
                           "%s: leaf %u: %.9g is not on the grid of steps of %g", w->path, leaf, at,
                           step);
        found->box_min[i] = at < found->box_min[i] ? at : found->box_min[i];
        found->box_max[i] = at > found->box_max[i] ? at : found->box_max[i];
    }
    if (leaf == 0 || position[1] > found->dive_point[1])
        memcpy(found->dive_point, position, sizeof found->dive_point);
    return MN_OK;
}

static mn_code give_row(walk *w, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    mn_code code = check_position(w, at, row->position);
    XXH3_64bits_update(&w->sum[MNI_ROWS], row, sizeof *row);
    return code == MN_OK && w->sink->row != NULL ? w->sink->row(w->sink->context, at, row, child)
                                                 : code;
}

static mn_code give_simplex(walk *w, uint32_t id, const mni_row_simplex *simplex) {
    if (w->simplices == w->header.triangles + w->header.hinges)
        return BAD(w, id, "more than the %u simplices that the header counts", w->simplices);
    w->simplices++;
    w->triangles += simplex->corner[2] != MN_NONE;
    XXH3_64bits_update(&w->sum[MNI_SIMPLICES], simplex, sizeof *simplex);
    return w->sink->simplex != NULL ? w->sink->simplex(w->sink->context, simplex) : MN_OK;
}

static mn_code give_overflow(walk *w, const level *l, const mni_node *node) {
    mn_block_ref at = mni_frame_ref(l->bytes, node->overflow_ref);
    uint32_t parent_id = l->self.id, length = 0;
    mn_code code = MN_OK;
    for (bool more = true; more && code == MN_OK; length++) {
        mni_overflow view;
        mni_frame frame;
        char why[160];
        code = read_block(w, at, &w->overflow, &w->overflow_room);
        if (code == MN_OK)
            code = count_block(w, at, w->overflow);
        if (code != MN_OK)
            break;
        mni_frame_get(w->overflow, &frame);
        if (!mni_overflow_open(&view, w->overflow, at.pages * MN_PAGE_BYTES, &w->limits, why,
                               sizeof why))
            return BAD(w, at.id, "%s", why);
        if (view.order != node->facts.order || view.leaf_lo != node->at.leaf_lo ||
            view.leaf_mid != node->leaf_mid || view.leaf_hi != node->at.leaf_hi ||
            frame.parent_id != parent_id)
            return BAD(w, at.id, "overflow of node %u, not of %u", view.order, node->facts.order);
        for (uint32_t i = 0; i < view.simplices && code == MN_OK; i++) {
            mni_row_simplex simplex;
            mni_overflow_simplex(&view, i, simplex.corner);
            code = give_simplex(w, at.id, &simplex);
        }
        parent_id = at.id;
        more = frame.refs > 0;
        if (more)
            at = mni_frame_ref(w->overflow, 0);
    }
    if (length > w->found.overflow_max)
        w->found.overflow_max = length;
    return code;
}

static uint32_t row_of(const level *l, uint32_t way) {
    return way == WAY_LEAF         ? MN_NONE
           : (way & WAY_EXIT) != 0 ? l->exit[way & ~WAY_EXIT].mid
                                   : l->node[way].mid;
}

/* A leaf's order id is its number. */
static uint32_t order_of(const mni_child *child, uint32_t leaf_lo) {
    return child->kind == MNI_CHILD_LEAF ? leaf_lo : child->facts.order;
}

static mn_code check_cones(walk *w, const level *l, const mni_node *node) {
    const double slack = 1e-6;
    const mni_child *const child[2] = {&node->left, &node->right};
    for (int i = 0; i < 2; i++)
        if (child[i]->kind != MNI_CHILD_LEAF &&
            !mni_cone_encloses(node->facts.cone, child[i]->facts.cone, slack))
            return BAD(w, l->self.id, "node %u: its cone does not hold that of child %u",
                       node->facts.order, child[i]->facts.order);
    return MN_OK;
}

static mn_code give_node(walk *w, const level *l, uint32_t index) {
    const place *p = &l->node[index];
    mni_node node;
    mni_block_node(&l->view, index, &p->at, &node);
    mni_row row = {.rgba = node.right_color,
                   .order = node.facts.order,
                   .leaf_lo = node.at.leaf_lo,
                   .leaf_hi = node.at.leaf_hi,
                   .left = row_of(l, p->left),
                   .right = row_of(l, p->right),
                   .switch_value = node.facts.switch_value,
                   .radius = node.facts.radius,
                   .simplex_start = w->simplices,
                   .cone = node.facts.cone};
    memcpy(row.position, node.right_position, sizeof row.position);
    mn_code code = mark_order(w, l->self.id, row.order);
    if (code == MN_OK)
        code = check_cones(w, l, &node);
    if (code == MN_OK)
        code = give_row(
            w, p->mid, &row,
            (uint32_t[2]){order_of(&node.left, row.leaf_lo), order_of(&node.right, p->mid)});
    for (uint32_t s = 0; s < node.simplex_count && code == MN_OK; s++) {
        mni_row_simplex simplex;
        mni_block_simplex(&l->view, &node, s, simplex.corner);
        code = give_simplex(w, l->self.id, &simplex);
    }
    return code == MN_OK && node.overflow_ref != MN_NONE ? give_overflow(w, l, &node) : code;
}

/* The row where root r begins. */
static mn_code give_root(walk *w, uint32_t r) {
    const exit_place *root = &w->level[0]->exit[r];
    if (root->at.leaf_lo != w->next_leaf)
        return mn_fail(w->st, MN_BAD_INPUT, "%s: header: root %u is not in its place", w->path, r);
    w->next_leaf = root->at.leaf_hi;
    mni_row row = {.rgba = w->header.has_colors ? w->header.root[r].color : UINT32_MAX,
                   .left = MN_NONE,
                   .right = MN_NONE,
                   .simplex_start = w->simplices};
    memcpy(row.position, root->at.position, sizeof row.position);
    return give_row(w, root->at.leaf_lo, &row, NULL);
}

/* ---- the way -------------------------------------------------------------------------------- */

/* The block that an exit leads to is the next level, and the exit's `mid` is known. Each subtree is
 * entered once, so a block is counted with its first. */
static mn_code open_exit(walk *w, uint32_t above, exit_place *exit) {
    level *parent = w->level[above];
    const mn_block_ref at = above == 0 ? w->header.root[exit - parent->exit].block
                                       : mni_frame_ref(parent->bytes, exit->ref);
    mn_code code = MN_OK;
    if (above + 1 == w->levels || w->level[above + 1]->self.pages == 0 ||
        w->level[above + 1]->self.id != at.id || w->level[above + 1]->ref != exit->ref)
        code = open_block(w, above, exit->ref, at);
    if (code != MN_OK)
        return code;
    level *l = w->level[above + 1];
    mni_subtree s;
    mni_block_subtree(&l->view, exit->subtree, &s);
    exit->mid = l->node[s.node].mid;
    return MN_OK;
}

static mn_code enter(walk *w, uint32_t above, const exit_place *exit) {
    level *l = w->level[above + 1];
    mni_subtree s;
    mni_block_subtree(&l->view, exit->subtree, &s);
    l->go = s.node;
    l->inside = 0;
    if (exit->subtree != 0)
        return MN_OK;
    if (l->view.nodes > w->found.nodes_per_block_max)
        w->found.nodes_per_block_max = l->view.nodes;
    if (above + 1 > w->found.block_depth)
        w->found.block_depth = above + 1;
    return count_block(w, l->self, l->bytes);
}

static bool is_wanted(const walk *w, const exit_place *exit) {
    return w->desc->wanted == NULL || w->desc->wanted(w->sink->context, exit->facts.order);
}

/* The node on top of the stack, whose left side is done; then its right side. */
static mn_code pass_node(walk *w, uint32_t at) {
    level *l = w->level[at];
    const uint32_t node = l->stack[--l->inside], right = l->node[node].right;
    mn_code code = MN_OK;
    if (right != WAY_LEAF && (right & WAY_EXIT) != 0 && is_wanted(w, &l->exit[right & ~WAY_EXIT]))
        code = open_exit(w, at, &l->exit[right & ~WAY_EXIT]);
    if (code == MN_OK)
        code = give_node(w, l, node);
    l->go = right;
    return code;
}

/* All of the subtree that an exit of level 0 leads to. */
static mn_code walk_root(walk *w, uint32_t r) {
    mn_code code = open_exit(w, 0, &w->level[0]->exit[r]);
    if (code == MN_OK)
        code = give_root(w, r);
    if (code == MN_OK)
        code = enter(w, 0, &w->level[0]->exit[r]);
    for (uint32_t at = 1; at > 0 && code == MN_OK;) {
        level *l = w->level[at];
        const uint32_t go = l->go;
        if (go == WAY_LEAF && l->inside == 0) {
            at--;
        } else if (go == WAY_LEAF) {
            code = pass_node(w, at);
        } else if ((go & WAY_EXIT) == 0) {
            MN_ASSERT(l->inside <= MNI_BLOCK_DEPTH_MAX); /* mni_block_open has seen it */
            l->stack[l->inside++] = go;
            l->go = l->node[go].left;
        } else {
            exit_place *exit = &l->exit[go & ~WAY_EXIT];
            l->go = WAY_LEAF;
            if (!is_wanted(w, exit))
                continue;
            code = open_exit(w, at, exit);
            if (code == MN_OK)
                code = enter(w, at++, exit);
        }
    }
    return code;
}

/* ---- the whole ------------------------------------------------------------------------------ */

/* Level 0: the header's roots as exits. Those of one block have one reference. */
static mn_code place_roots(walk *w) {
    const mn_header *h = &w->header;
    mn_code code = need_level(w, 0);
    level *l = code == MN_OK ? w->level[0] : NULL;
    if (code == MN_OK)
        code = GROW(w, l->exit, h->roots, l->exit_room);
    if (code != MN_OK)
        return code;
    l->exits = h->roots;
    l->refs = 0;
    for (uint32_t at = 1; at < w->levels; at++) /* another walk's */
        w->level[at]->self.pages = 0;
    for (uint32_t r = 0; r < h->roots; r++) {
        uint32_t ref = l->refs;
        for (uint32_t before = 0; before < r && ref == l->refs; before++)
            if (h->root[before].block.id == h->root[r].block.id)
                ref = l->exit[before].ref;
        l->refs += ref == l->refs;
        l->exit[r] = (exit_place){.ref = ref, .subtree = h->root[r].subtree, .depth = 1};
        memcpy(l->exit[r].at.position, h->root[r].position, sizeof h->root[r].position);
    }
    return sort_exits(w, l);
}

#define SAME(w, field, format)                                                                     \
    do {                                                                                           \
        if ((w)->found.field != (w)->header.field)                                                 \
            return mn_fail((w)->st, MN_BAD_INPUT,                                                  \
                           "%s: header: " #field " is " format ", in the blocks it is " format     \
                           "; the file is damaged: build it again",                                \
                           (w)->path, (w)->header.field, (w)->found.field);                        \
    } while (0)

static mn_code compare_shape(walk *w) {
    const mn_header *h = &w->header, *found = &w->found;
    const double step = h->grid_step;
    for (int i = 0; i < 3; i++)
        if ((double)found->box_max[i] - found->box_min[i] > MNI_GRID_STEPS_MAX * step)
            return mn_fail(w->st, MN_BAD_INPUT, "%s: positions span more than %d steps of %g",
                           w->path, MNI_GRID_STEPS_MAX, step);
    if (memcmp(found->box_min, h->box_min, sizeof h->box_min) != 0 ||
        memcmp(found->box_max, h->box_max, sizeof h->box_max) != 0)
        return mn_fail(w->st, MN_BAD_INPUT, "%s: header: the box is not that of the vertices",
                       w->path);
    if (memcmp(found->dive_point, h->dive_point, sizeof h->dive_point) != 0)
        return mn_fail(w->st, MN_BAD_INPUT, "%s: header: dive_point is not the highest vertex",
                       w->path);
    return MN_OK;
}

static mn_code compare_build_id(walk *w) {
    const mn_header *h = &w->header;
    const mn_tree facts = mni_mnt_head(w->mnt);
    const mn_block_desc desc = {.blocking = h->blocking, .l = h->l, .block_bytes = h->block_bytes};
    uint64_t sum[MNI_SECTIONS];
    for (int i = 0; i < MNI_SECTIONS; i++)
        sum[i] = XXH3_64bits_digest(&w->sum[i]);
    if (mni_build_id(&facts, h->has_colors, sum, &desc) != h->build_id)
        return mn_fail(w->st, MN_BAD_INPUT,
                       "%s: header: build_id is not that of the content; the file is damaged",
                       w->path);
    return MN_OK;
}

/* Everything that the header says of the blocks is what was found there. */
static mn_code compare_header(walk *w) {
    const mn_header *h = &w->header;
    const uint64_t simplices = h->triangles + h->hinges;
    if (w->next_leaf != h->leaves)
        return mn_fail(w->st, MN_BAD_INPUT, "%s: header: its roots hold %u of %u leaves", w->path,
                       w->next_leaf, h->leaves);
    if (w->simplices != simplices || w->triangles != h->triangles)
        return mn_fail(w->st, MN_BAD_INPUT,
                       "%s: header: %llu simplices, %llu of them triangles, in the blocks are %u "
                       "and %u",
                       w->path, (unsigned long long)simplices, (unsigned long long)h->triangles,
                       w->simplices, w->triangles);
    SAME(w, blocks, "%u");
    SAME(w, block_bytes_max, "%u");
    SAME(w, block_depth, "%u");
    SAME(w, overflow_max, "%u");
    SAME(w, children_max, "%u");
    SAME(w, nodes_per_block_max, "%u");
    SAME(w, depth_max, "%u");
    w->found.file_bytes = (w->pages + 1) * MN_PAGE_BYTES;
    if (w->found.file_bytes != h->file_bytes)
        return mn_fail(w->st, MN_BAD_INPUT, "%s: %llu bytes belong to no block", w->path,
                       (unsigned long long)(h->file_bytes - w->found.file_bytes));
    double fill = (double)w->payload_bytes / h->blocks / h->block_bytes_max;
    if (fabs(fill - h->fill_mean) > 1e-9)
        return mn_fail(w->st, MN_BAD_INPUT, "%s: header: fill_mean is %g, in the blocks it is %g",
                       w->path, h->fill_mean, fill);
    mn_code code = compare_shape(w);
    return code == MN_OK ? compare_build_id(w) : code;
}

/* From the first root to the last. */
static mn_code walk_all(walk *w) {
    memset(&w->found, 0, sizeof w->found);
    for (int i = 0; i < 3; i++) {
        w->found.box_min[i] = INFINITY;
        w->found.box_max[i] = -INFINITY;
    }
    w->simplices = w->triangles = w->next_leaf = 0;
    w->pages = w->payload_bytes = 0;
    for (int i = 0; i < MNI_SECTIONS; i++)
        XXH3_64bits_reset(&w->sum[i]);
    memset(w->mark, 0, marks_bytes(w->marks));
    mn_code code = place_roots(w);
    for (uint32_t r = 0; r < w->header.roots && code == MN_OK; r++)
        code = walk_root(w, r);
    return code == MN_OK && w->desc->wanted == NULL ? compare_header(w) : code;
}

/* What the cap leaves: at least half to open blocks, to marks no more than they want. */
static mn_code plan_memory(walk *w) {
    const uint64_t ram = w->desc->ram_bytes, beside = beside_bytes(w);
    uint64_t marks;
    w->ids = w->desc->wanted == NULL ? w->header.nodes - w->header.leaves : 0;
    marks = marks_bytes(w->ids);
    w->room = UINT64_MAX / 2;
    if (ram > 0 && ram < beside + ROOM_LEAST)
        return too_small(w);
    if (ram > 0) {
        const uint64_t most = (ram - beside) / 2 / sizeof *w->mark * sizeof *w->mark;
        marks = marks < most ? marks : most;
        w->room = ram - beside - marks;
    }
    w->marks = 8 * marks < w->ids ? 8 * marks : w->ids;
    w->mark = malloc(marks + sizeof *w->mark);
    return w->mark != NULL ? MN_OK : no_memory(w);
}

uint64_t mni_mnt_walk_bytes(const mn_header *header) {
    return 2 * blocks_bytes(header) + ROOM_LEAST;
}

mn_code mni_mnt_open(mni_mnt *mnt, const char *path, mn_status *st) {
    *mnt = (mni_mnt){.path = path, .stored = {.in = {.fd = -1}}};
    mn_code code = mn_header_read(path, &mnt->header, st);
    return code == MN_OK ? mni_stored_open(&mnt->stored, path, &mnt->header, st) : code;
}

void mni_mnt_close(mni_mnt *mnt) {
    mni_stored_close(&mnt->stored);
}

mn_tree mni_mnt_head(const mni_mnt *mnt) {
    const mn_header *h = &mnt->header;
    mn_tree t = {.leaves = h->leaves,
                 .inner = h->nodes - h->leaves,
                 .simplices = (uint32_t)h->triangles + h->hinges,
                 .triangles = (uint32_t)h->triangles,
                 .roots = h->roots,
                 .legal_last = h->legal_last,
                 .depth_max = h->depth_max,
                 .metric = h->metric,
                 .grid_step = h->grid_step};
    memcpy(t.origin, h->origin, sizeof t.origin);
    return t;
}

mn_code mni_mnt_walk(mni_mnt *mnt, const mni_walk_desc *desc, const mni_walk_sink *sink,
                     mn_status *st) {
    static const mni_walk_sink nobody = {0};
    mn_status own = {0};
    walk w = {.path = mnt->path,
              .mnt = mnt,
              .desc = desc,
              .sink = sink,
              .header = mnt->header,
              .limits = mni_block_limits_of(&mnt->header),
              .stored = &mnt->stored,
              .st = st != NULL ? st : &own};
    mn_code code = plan_memory(&w);
    if (code == MN_OK)
        code = walk_all(&w);
    for (w.mark_from = w.marks; code == MN_OK && w.mark_from < w.ids; w.mark_from += w.marks) {
        w.sink = &nobody;
        code = walk_all(&w);
    }
    for (uint32_t i = 0; i < w.levels; i++)
        free_level(w.level[i]);
    free(w.level);
    free(w.overflow);
    free(w.mark);
    return code;
}
