/* Policy `packed`: blocks of fixed bytes, filled with several sibling subtrees of one parent block.
 *
 * A block gets its list of subtrees from its parent block, then its nodes, then groups its exits
 * into the lists of its child blocks:
 *
 *     exits of a block          child blocks
 *     small: fits whole   ──►   bins, first-fit: whole subtrees, nothing below
 *     big: does not       ──►   groups of neighbours with ROOM_BELOW blocks' worth of nodes: their
 *                               tops, best first (largest switch value next), until the block is
 * full a bin that stays    ──►   into the groups, where room is: fewer tops, no block half empty
 *     half empty
 *
 * A group must be worth several blocks, because what is left below it ends in bins, of which the
 * last is half empty on average. Leaving a big subtree alone in a group of little more than one
 * block costs a block in two; ROOM_BELOW = 16 leaves 8 % of 4 KiB blocks empty, 4 % of 16 KiB ones.
 *
 * Hides: the grouping, and the room kept for references, whose number is known only after the exits
 * are grouped: a block that then turns out too long is filled again with more room kept.
 * Order: one call on an open plan. One thread. Memory: a few words an exit of one block.
 * Paper: §3.2, and what design.md §3.4 says of it. */
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "plan.h"

enum {
    ROOM_BELOW = 16,       /* blocks' worth of nodes that a group of big subtrees holds at least */
    OPEN_BINS = 12,        /* bins that first-fit looks at: neighbours stay together */
    TRIES_MAX = 24,        /* nodes that did not fit before a block counts as full */
    START_NODE_BYTES = 40, /* a node with its simplices, before any block has been measured */
};
/* References kept room for, as a share of exits; the last always suffices. */
static const double ref_share[] = {0.06, 0.25, 0.6, 1};
enum { REF_SHARES = sizeof ref_share / sizeof ref_share[0] };

typedef struct candidate {
    float switch_value;
    uint32_t node, depth;
} candidate;

/* What a walk over a whole subtree still has before it. */
typedef struct step {
    uint32_t node, depth;
} step;

typedef struct bin {
    mni_tally tally;
    uint64_t weight; /* nodes */
    uint32_t order;  /* of its child block among its siblings, once that exists */
    bool is_group, open;
    uint32_t exits; /* how many were put in */
} bin;

typedef struct packer {
    mni_plan *plan;
    mn_status *st;
    uint32_t limit;     /* bytes that columns may end at */
    double node_bytes;  /* as measured in the block above */
    mni_tally tally;    /* of the block being filled */
    uint32_t overflows; /* its nodes that overflow */
    candidate *heap;
    uint32_t waiting, heap_capacity;
    mni_plan_root *exit; /* of the block being filled; whole: fits whole */
    uint32_t *bin_of;
    uint32_t exits, exits_capacity;
    bin *bin;
    uint32_t bins, bins_capacity;
    step *stack; /* at most an entry a level and one: whole subtrees are MNI_BLOCK_DEPTH_MAX deep */
} packer;

static mn_code no_memory(packer *p) {
    return mn_fail(p->st, MN_FAILED, "no memory to pack %u nodes", p->plan->tree->inner);
}

static bool room_for(void **array, uint32_t needed, uint32_t *capacity, size_t size) {
    if (needed <= *capacity)
        return true;
    uint32_t wanted = needed + needed / 2 + 64;
    void *bigger = realloc(*array, wanted * size);
    if (bigger == NULL)
        return false;
    *array = bigger;
    *capacity = wanted;
    return true;
}

static uint64_t inner_below(const mn_tree *t, uint32_t node) {
    return (uint64_t)t->leaf_hi[node] - t->leaf_lo[node] - 1;
}

/* ---- tallies -------------------------------------------------------------------------------- */

static bool overflows(const packer *p, uint32_t node) {
    const mn_tree *t = p->plan->tree;
    return t->simplex_start[node + 1] - t->simplex_start[node] > p->plan->simplices_max;
}

/* Adds a node as if its inner children were exits; of a node that was an exit, takes that back. */
static void tally_add(const packer *p, mni_tally *tally, uint32_t node, bool was_exit) {
    const mni_plan *plan = p->plan;
    mni_node record;
    mni_plan_node(plan, node, &record);
    mni_tally_node(tally, &record);
    tally->exits -= was_exit;
    for (uint32_t s = 0; s < record.simplex_count; s++) {
        uint32_t corner[3];
        mni_plan_simplex(plan->tree, node, plan->tree->simplex_start[node] + s, corner);
        mni_tally_simplex(tally, corner);
    }
}

static bool fits(const packer *p, const mni_tally *tally, uint32_t refs) {
    return tally->nodes <= MNI_BLOCK_NODES_MAX && tally->exits <= MNI_BLOCK_EXITS_MAX &&
           mni_tally_bytes(tally, refs) <= p->limit;
}

/* Adds a whole subtree, and says whether the result still fits; false also when it is too deep. A
 * tally that does not fit is of no more use. */
static bool tally_add_whole(packer *p, mni_tally *tally, const mni_plan_root *root) {
    const mn_tree *t = p->plan->tree;
    mni_subtree record;
    uint32_t waiting = 0;
    if (inner_below(t, root->node) + tally->nodes > MNI_BLOCK_NODES_MAX)
        return false;
    mni_plan_subtree(p->plan, root, &record);
    mni_tally_subtree(tally, &record);
    p->stack[waiting++] = (step){root->node, 0};
    while (waiting > 0) {
        step from = p->stack[--waiting];
        uint32_t node = from.node;
        if (overflows(p, node))
            return false; /* rare: let it be filled node by node, where references are counted */
        tally_add(p, tally, node, node != root->node);
        for (uint32_t side = 2; side-- > 0;) {
            uint32_t child = mni_plan_child(t, node, side);
            if (child == MN_NONE)
                continue;
            if (from.depth + 1 >= MNI_BLOCK_DEPTH_MAX)
                return false;
            p->stack[waiting++] = (step){child, from.depth + 1};
        }
        if (tally->nodes % 16 == 0) { /* without exits, which come and go, it only grows */
            mni_tally least = *tally;
            least.exits = 0;
            if (!fits(p, &least, 0))
                return false;
        }
    }
    return fits(p, tally, 0);
}

/* ---- the nodes of a block ------------------------------------------------------------------- */

static bool heap_above(const candidate *a, const candidate *b) {
    return a->switch_value != b->switch_value ? a->switch_value > b->switch_value
                                              : a->node > b->node;
}

static bool heap_push(packer *p, uint32_t node, uint32_t depth) {
    if (!room_for((void **)&p->heap, p->waiting + 1, &p->heap_capacity, sizeof *p->heap))
        return false;
    candidate added = {p->plan->tree->switch_value[node], node, depth};
    uint32_t at = p->waiting++;
    while (at > 0 && heap_above(&added, &p->heap[(at - 1) / 2])) {
        p->heap[at] = p->heap[(at - 1) / 2];
        at = (at - 1) / 2;
    }
    p->heap[at] = added;
    return true;
}

static candidate heap_pop(packer *p) {
    candidate top = p->heap[0], moved = p->heap[--p->waiting];
    uint32_t at = 0;
    for (uint32_t child = 1; child < p->waiting; child = 2 * at + 1) {
        if (child + 1 < p->waiting && heap_above(&p->heap[child + 1], &p->heap[child]))
            child++;
        if (!heap_above(&p->heap[child], &moved))
            break;
        p->heap[at] = p->heap[child];
        at = child;
    }
    p->heap[at] = moved;
    return top;
}

static mn_code push_children(packer *p, uint32_t node, uint32_t depth) {
    for (uint32_t side = 0; side < 2; side++) {
        uint32_t child = mni_plan_child(p->plan->tree, node, side);
        if (child != MN_NONE && depth + 1 < MNI_BLOCK_DEPTH_MAX && !heap_push(p, child, depth + 1))
            return no_memory(p);
    }
    return MN_OK;
}

static void take_whole(packer *p, uint32_t block, uint32_t root) {
    uint32_t waiting = 0;
    p->stack[waiting++] = (step){root, 0};
    while (waiting > 0) {
        uint32_t node = p->stack[--waiting].node;
        p->plan->block_of[node] = block;
        for (uint32_t side = 2; side-- > 0;) {
            uint32_t child = mni_plan_child(p->plan->tree, node, side);
            if (child != MN_NONE)
                p->stack[waiting++] = (step){child, 0};
        }
    }
}

static uint32_t refs_kept(const packer *p, uint32_t exits, double share) {
    double refs = share * exits;
    uint32_t up = (uint32_t)refs + (refs > (double)(uint32_t)refs);
    return (up > exits ? exits : up) + p->overflows;
}

/* Whole subtrees first, then the tops of the others, best first, until nothing fits. */
static mn_code fill(packer *p, uint32_t block, double share) {
    mni_plan *plan = p->plan;
    const mni_planned *b = &plan->block[block];
    p->waiting = p->overflows = 0;
    mni_tally_init(&p->tally, p->plan->tree->leaf_color != NULL);
    for (uint32_t r = 0; r < b->root_count; r++) {
        const mni_plan_root *root = &plan->root[b->root_first + r];
        if (root->whole) {
            bool fitted = tally_add_whole(p, &p->tally, root);
            MN_ASSERT(fitted);
            take_whole(p, block, root->node);
            continue;
        }
        mni_subtree record;
        mni_plan_subtree(plan, root, &record);
        mni_tally_subtree(&p->tally, &record);
        tally_add(p, &p->tally, root->node, false);
        p->overflows += overflows(p, root->node);
        plan->block_of[root->node] = block;
        if (push_children(p, root->node, 0) != MN_OK)
            return no_memory(p);
    }
    for (uint32_t tries = 0; p->waiting > 0 && tries < TRIES_MAX;) {
        candidate next = heap_pop(p);
        mni_tally with = p->tally;
        tally_add(p, &with, next.node, true);
        p->overflows += overflows(p, next.node);
        if (!fits(p, &with, refs_kept(p, with.exits, share))) {
            p->overflows -= overflows(p, next.node);
            tries++;
            continue;
        }
        p->tally = with;
        plan->block_of[next.node] = block;
        if (push_children(p, next.node, next.depth) != MN_OK)
            return no_memory(p);
    }
    return MN_OK;
}

/* ---- exits into bins ------------------------------------------------------------------------ */

static mn_code add_exit(packer *p, uint32_t node) {
    uint32_t capacity = p->exits_capacity;
    if (!room_for((void **)&p->exit, p->exits + 1, &p->exits_capacity, sizeof *p->exit) ||
        !room_for((void **)&p->bin_of, p->exits + 1, &capacity, sizeof *p->bin_of))
        return no_memory(p);
    p->exit[p->exits++] = (mni_plan_root){node, p->plan->tree->leaf_lo[node], false};
    return MN_OK;
}

static int by_leaf(const void *a, const void *b) {
    const mni_plan_root *x = a, *y = b;
    return x->leaf_lo < y->leaf_lo ? -1 : x->leaf_lo > y->leaf_lo;
}

/* In the order of their leaves: neighbours here are neighbours on the surface, more or less. */
static mn_code list_exits(packer *p) {
    const mni_plan *plan = p->plan;
    p->exits = 0;
    for (uint32_t i = 0; i < plan->listed; i++)
        for (uint32_t side = 0; side < 2; side++) {
            uint32_t child = mni_plan_child(plan->tree, plan->list[i], side);
            if (child != MN_NONE && plan->block_of[child] == MN_NONE && add_exit(p, child) != MN_OK)
                return MN_FAILED;
        }
    qsort(p->exit, p->exits, sizeof *p->exit, by_leaf);
    return MN_OK;
}

static bin *new_bin(packer *p, bool is_group) {
    if (!room_for((void **)&p->bin, p->bins + 1, &p->bins_capacity, sizeof *p->bin))
        return NULL;
    bin *b = &p->bin[p->bins++];
    *b = (bin){.is_group = is_group, .open = true, .order = MN_NONE};
    mni_tally_init(&b->tally, p->plan->tree->leaf_color != NULL);
    return b;
}

/* Does the subtree fit whole beside what is in the bin? Then it is put in. */
static bool put_whole(packer *p, uint32_t exit, uint32_t to, uint32_t refs, uint32_t limit) {
    bin *b = &p->bin[to];
    double bytes = (double)inner_below(p->plan->tree, p->exit[exit].node) * p->node_bytes;
    if (bytes + (double)mni_tally_bytes(&b->tally, refs) > 1.3 * limit)
        return false; /* not even nearly */
    mni_tally with = b->tally;
    if (!tally_add_whole(p, &with, &p->exit[exit]) || mni_tally_bytes(&with, refs) > limit)
        return false;
    b->tally = with;
    b->exits++;
    p->bin_of[exit] = to;
    p->exit[exit].whole = true;
    return true;
}

/* First-fit of the small ones, in the order of the leaves, into few open bins. */
static mn_code bin_small(packer *p) {
    uint32_t first_open = 0;
    for (uint32_t e = 0; e < p->exits; e++) {
        p->bin_of[e] = MN_NONE;
        uint32_t open = 0, fullest = MN_NONE;
        uint64_t most = 0;
        for (uint32_t b = first_open; b < p->bins && p->bin_of[e] == MN_NONE; b++) {
            if (!p->bin[b].open)
                continue;
            uint64_t bytes = mni_tally_bytes(&p->bin[b].tally, 0);
            open++;
            if (bytes > most) {
                most = bytes;
                fullest = b;
            }
            put_whole(p, e, b, 0, p->limit);
        }
        if (p->bin_of[e] != MN_NONE)
            continue;
        if (new_bin(p, false) == NULL)
            return no_memory(p);
        if (!put_whole(p, e, p->bins - 1, 0, p->limit))
            p->bins--; /* a big one */
        else if (open >= OPEN_BINS)
            p->bin[fullest].open = false;
        while (first_open < p->bins && !p->bin[first_open].open)
            first_open++;
    }
    return MN_OK;
}

/* Does a big one's root fit into the group? Then it is put in. */
static bool put_top(packer *p, uint32_t exit, uint32_t to) {
    bin *b = &p->bin[to];
    mni_tally with = b->tally;
    mni_subtree record;
    mni_plan_subtree(p->plan, &p->exit[exit], &record);
    mni_tally_subtree(&with, &record);
    tally_add(p, &with, p->exit[exit].node, false);
    uint32_t refs = with.exits + with.subtrees; /* the latter in case that roots overflow */
    if (b->exits > 0 && (!fits(p, &with, refs) || mni_tally_bytes(&with, refs) > p->limit / 2))
        return false;
    b->tally = with;
    b->exits++;
    b->weight += inner_below(p->plan->tree, p->exit[exit].node);
    p->bin_of[exit] = to;
    return true;
}

static mn_code group_big(packer *p) {
    double enough = ROOM_BELOW * (double)p->limit / p->node_bytes;
    uint32_t group = MN_NONE;
    for (uint32_t e = 0; e < p->exits; e++) {
        if (p->bin_of[e] != MN_NONE)
            continue;
        if (group != MN_NONE && (double)p->bin[group].weight < enough && put_top(p, e, group))
            continue;
        if (new_bin(p, true) == NULL)
            return no_memory(p);
        group = p->bins - 1;
        bool fitted = put_top(p, e, group);
        MN_ASSERT(fitted);
    }
    return MN_OK;
}

/* Moves what is in half-empty bins into groups, where half a block is for it at most. */
static void spread(packer *p) {
    for (uint32_t e = 0; e < p->exits; e++) {
        uint32_t from = p->bin_of[e];
        if (p->bin[from].is_group || mni_tally_bytes(&p->bin[from].tally, 0) > 0.9 * p->limit)
            continue;
        for (uint32_t g = 0; g < p->bins; g++)
            if (p->bin[g].is_group &&
                put_whole(p, e, g, p->bin[g].tally.exits + p->bin[g].tally.subtrees,
                          p->limit / 2)) {
                p->bin[from].exits--;
                break;
            }
    }
}

/* A child block for each bin, in the order of their first exits. */
static mn_code plan_bins(packer *p, uint32_t block) {
    mni_plan *plan = p->plan;
    uint32_t orders = 0;
    for (uint32_t e = 0; e < p->exits; e++)
        if (p->bin[p->bin_of[e]].order == MN_NONE)
            p->bin[p->bin_of[e]].order = orders++;
    /* exits come in the order of their leaves; a counting sort by block keeps that inside one */
    uint32_t *at = calloc(orders + 1, sizeof *at);
    uint32_t *sorted = malloc(sizeof *sorted * (p->exits + 1));
    mn_code code = at == NULL || sorted == NULL ? no_memory(p) : MN_OK;
    if (code == MN_OK) {
        for (uint32_t e = 0; e < p->exits; e++)
            at[p->bin[p->bin_of[e]].order + 1]++;
        for (uint32_t o = 0; o < orders; o++)
            at[o + 1] += at[o];
        for (uint32_t e = 0; e < p->exits; e++)
            sorted[at[p->bin[p->bin_of[e]].order]++] = e;
    }
    for (uint32_t i = 0; i < p->exits && code == MN_OK; i++) {
        uint32_t made, e = sorted[i];
        if (i == 0 || p->bin_of[sorted[i - 1]] != p->bin_of[e])
            code = mni_plan_block(plan, block, &made, p->st);
        if (code == MN_OK)
            code = mni_plan_root_add(plan, p->exit[e], p->st);
    }
    free(at);
    free(sorted);
    return code;
}

static mn_code plan_exits(packer *p, uint32_t block) {
    p->bins = 0;
    mn_code code = bin_small(p);
    if (code == MN_OK)
        code = group_big(p);
    if (code != MN_OK)
        return code;
    spread(p);
    return plan_bins(p, block);
}

/* ---- all of it ------------------------------------------------------------------------------ */

/* Fills a block and plans its children; with more room for references until they fit. */
static mn_code pack_block(packer *p, uint32_t block) {
    mni_plan *plan = p->plan;
    uint32_t blocks = plan->blocks, roots = plan->roots, overflow_max = plan->overflow_max;
    for (uint32_t share = 0;; share++) {
        MN_ASSERT(share < REF_SHARES);
        mn_code code = fill(p, block, ref_share[share]);
        if (code != MN_OK)
            return code;
        mni_plan_list(plan, block);
        mni_plan_tally(plan, block, &p->tally);
        p->node_bytes = (double)(mni_tally_bytes(&p->tally, 0) - 300) / p->tally.nodes;
        plan->block[block].child_first = plan->blocks;
        code = list_exits(p);
        if (code == MN_OK)
            code = plan_exits(p, block);
        plan->block[block].child_count = plan->blocks - blocks;
        if (code == MN_OK)
            code = mni_plan_overflow(plan, block, p->st);
        if (code != MN_OK)
            return code;
        uint64_t bytes = mni_tally_bytes(&p->tally, plan->block[block].child_count);
        if (bytes <= p->limit) {
            plan->block[block].payload_bytes = (uint32_t)bytes;
            return MN_OK;
        }
        for (uint32_t i = 0; i < plan->listed; i++)
            plan->block_of[plan->list[i]] = MN_NONE;
        plan->blocks = blocks;
        plan->roots = roots;
        plan->overflow_max = overflow_max;
    }
}

static mn_code pack_all(packer *p) {
    mni_plan *plan = p->plan;
    const mn_tree *t = plan->tree;
    for (uint32_t r = 0; r < t->roots; r++)
        if (add_exit(p, t->root[r] - t->leaves) != MN_OK)
            return MN_FAILED;
    mn_code code = plan_exits(p, MN_NONE);
    uint32_t placed = 0;
    for (uint32_t b = 0; b < plan->blocks && code == MN_OK; b++) {
        if (plan->block[b].is_overflow)
            continue;
        code = pack_block(p, b);
        placed += plan->listed;
        if (code == MN_OK && plan->desc->progress != NULL && b % 16 == 0 &&
            !plan->desc->progress(plan->desc->progress_context, "blocking", placed, t->inner))
            code = mn_fail(p->st, MN_FAILED, "interrupted");
    }
    MN_ASSERT(code != MN_OK || placed == t->inner);
    return code;
}

mn_code mni_plan_packed(mni_plan *plan, mn_status *st) {
    packer p = {.plan = plan,
                .st = st,
                .limit = plan->desc->block_bytes - MNI_BLOCK_TAIL_BYTES,
                .node_bytes = START_NODE_BYTES};
    p.stack = malloc(sizeof *p.stack * (MNI_BLOCK_DEPTH_MAX + 2));
    mn_code code = p.stack == NULL ? no_memory(&p) : pack_all(&p);
    free(p.stack);
    free(p.heap);
    free(p.exit);
    free(p.bin_of);
    free(p.bin);
    return code;
}
