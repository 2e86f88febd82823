/* Policy `packed`: blocks of fixed bytes, filled with several sibling subtrees of one parent block.
 *
 * A block gets its list of subtrees from its parent block, takes nodes from their tops, latest
 * collapse first, until it is full, and cuts what is left below, its exits, into runs of
 * neighbours, one a child block:
 *
 *     exits of a block, by leaf id:   e e e e | e e e e e | e e e
 *                                       └ child   └ child   └ child
 *
 * - Latest collapse first, because fronts are closed under the implicit dependencies, which compare
 *   order ids: nodes with near ids in one place are active together. (By switch value, fronts of
 *   the same cameras kept 1.1 to 1.4 times the blocks in use.)
 * - A run has RUN_LEAST subtrees or more where it can: a front that passes just below their roots
 *   finds as many active nodes in the block, where one deep subtree would give it two.
 * - Runs are cut so that few blocks are left half empty: what stands below a run is some number of
 *   blocks, of which the last is filled by a remainder, so cuts are chosen by dynamic programming
 *   to have the remainders large. A run that fits one block whole is measured, not estimated.
 *
 * Hides: the grouping, and the room kept for references, whose number is known only after the exits
 * are grouped: a block that then turns out too long is filled again with more room kept.
 * Order: one call on an open plan. One thread. Memory: a few words an exit of one block.
 * Paper: §3.2, and what design.md §3.4 says of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "plan.h"

enum {
    RUN_LEAST = 16,        /* subtrees in a run, where that many can be had */
    SUBTREE_BYTES = 4,     /* of a subtree's root besides its node */
    TRIES_MAX = 24,        /* nodes that did not fit before a block counts as full */
    START_NODE_BYTES = 20, /* a node with its simplices, before any block has been measured */
};
/* References kept room for, as a share of exits; the last always suffices. */
static const double ref_share[] = {0.06, 0.25, 0.6, 1};
enum { REF_SHARES = sizeof ref_share / sizeof ref_share[0] };
static const double TOP_SHARE = 0.4, /* of a block, for the roots of its subtrees at most */
    FEW_COST = 0.5, /* blocks that a run of one subtree may cost less than one of RUN_LEAST */
    CAUTION = 0.1,  /* estimates of bytes are off by 0.06 (standard deviation) */
    FORESEEN = 6;   /* blocks below a run whose remainder can be foreseen */

typedef struct candidate {
    uint32_t node, depth;
} candidate;

/* A place where exits may be cut: before exit i. */
typedef struct cut {
    uint64_t nodes; /* of all exits before it */
    double cost;    /* blocks' worth of room that the best runs from here on leave empty */
    uint32_t next;  /* where the run that begins here ends */
} cut;

typedef struct packer {
    mni_plan *plan;
    mn_status *st;
    uint32_t limit;     /* bytes that rows may end at */
    double node_bytes;  /* of a node in the block above */
    double whole_bytes; /* of a node in a block that ends all its subtrees: a running mean */
    mni_tally tally;    /* of the block being filled */
    uint32_t overflows; /* its nodes that overflow */
    candidate *heap;
    uint32_t waiting, heap_capacity;
    mni_plan_root *exit; /* of the block being filled */
    uint32_t exits, exits_capacity;
    cut *cut; /* exits + 1 */
    uint32_t cuts_capacity;
    uint32_t run_most; /* subtrees in a run that does not fit whole */
    candidate *stack;  /* an entry a level and one: whole subtrees are MNI_BLOCK_DEPTH_MAX deep */
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
    p->stack[waiting++] = (candidate){root->node, 0};
    while (waiting > 0) {
        candidate from = p->stack[--waiting];
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
            p->stack[waiting++] = (candidate){child, from.depth + 1};
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
    return a->node > b->node;
}

static bool heap_push(packer *p, uint32_t node, uint32_t depth) {
    if (!room_for((void **)&p->heap, p->waiting + 1, &p->heap_capacity, sizeof *p->heap))
        return false;
    candidate added = {node, depth};
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
    p->stack[waiting++] = (candidate){root, 0};
    while (waiting > 0) {
        uint32_t node = p->stack[--waiting].node;
        p->plan->block_of[node] = block;
        for (uint32_t side = 2; side-- > 0;) {
            uint32_t child = mni_plan_child(p->plan->tree, node, side);
            if (child != MN_NONE)
                p->stack[waiting++] = (candidate){child, 0};
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
    mni_tally_init(&p->tally, plan->tree->leaf_color != NULL, plan->tree->grid_step);
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

/* ---- exits into runs ------------------------------------------------------------------------ */

static mn_code add_exit(packer *p, uint32_t node) {
    if (!room_for((void **)&p->exit, p->exits + 1, &p->exits_capacity, sizeof *p->exit))
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

/* What the subtrees of a run would take, whole: in blocks. */
static double run_blocks(const packer *p, uint32_t first, uint32_t next) {
    return (double)(p->cut[next].nodes - p->cut[first].nodes) * p->whole_bytes / p->limit;
}

/* What a run costs, in blocks: the room that the last block below it leaves empty, and half a block
 * for having a single subtree. */
static double run_cost(const packer *p, uint32_t first, uint32_t next) {
    double lacking = 1 - (double)(next - first) / RUN_LEAST;
    double few = lacking > 0 ? FEW_COST * lacking : 0;
    double blocks = run_blocks(p, first, next);
    if (blocks <= 1)
        return few + 1 - blocks;
    blocks -= p->whole_bytes / p->node_bytes; /* its own nodes, dearer for their exits */
    if (blocks > FORESEEN)
        return few + 0.5;
    blocks = blocks > 0 ? blocks * (1 + CAUTION) : 0; /* one too many costs a whole block */
    return few + 1 - (blocks - floor(blocks));
}

/* From the last exit to the first: where the run that begins there is best cut. */
static mn_code plan_cuts(packer *p) {
    if (!room_for((void **)&p->cut, p->exits + 1, &p->cuts_capacity, sizeof *p->cut))
        return no_memory(p);
    p->run_most = (uint32_t)(TOP_SHARE * p->limit / (p->node_bytes + SUBTREE_BYTES)) + 1;
    p->cut[0].nodes = 0;
    for (uint32_t e = 0; e < p->exits; e++)
        p->cut[e + 1].nodes = p->cut[e].nodes + inner_below(p->plan->tree, p->exit[e].node);
    p->cut[p->exits].cost = 0;
    for (uint32_t e = p->exits; e-- > 0;) {
        p->cut[e].cost = INFINITY;
        for (uint32_t next = e + 1; next <= p->exits; next++) {
            if (next - e > p->run_most && run_blocks(p, e, next) > 1)
                break;
            double cost = p->cut[next].cost + run_cost(p, e, next);
            if (cost < p->cut[e].cost) {
                p->cut[e].cost = cost;
                p->cut[e].next = next;
            }
        }
    }
    return MN_OK;
}

/* Does the run fit one block whole? Then *tally is that block's. */
static bool run_fits(packer *p, uint32_t first, uint32_t next, mni_tally *tally) {
    if (run_blocks(p, first, next) > 1.3)
        return false; /* not even nearly */
    mni_tally_init(tally, p->plan->tree->leaf_color != NULL, p->plan->tree->grid_step);
    for (uint32_t e = first; e < next; e++)
        if (!tally_add_whole(p, tally, &p->exit[e]))
            return false;
    return true;
}

/* Where a run that was hoped to fit whole, and is too long by some exits, has to end. A longer run
 * takes no fewer bytes, so this bisects. At least one exit; *whole: does it fit? */
static uint32_t longest_whole(packer *p, uint32_t first, uint32_t next, bool *whole,
                              mni_tally *tally) {
    uint32_t least = first, most = next - 1; /* least fits, or is the empty run */
    while (least < most) {
        uint32_t middle = least + (most - least + 1) / 2;
        mni_tally tried;
        if (run_fits(p, first, middle, &tried)) {
            least = middle;
            *tally = tried;
        } else {
            most = middle - 1;
        }
    }
    *whole = least > first;
    return *whole ? least : first + 1;
}

/* What a node takes in blocks that end all their subtrees, from one more of them. */
static void whole_learn(packer *p, const mni_tally *tally) {
    uint64_t bytes = mni_tally_bytes(tally, 0);
    if (bytes > p->limit / 2) /* the head counts too much in a short one */
        p->whole_bytes += ((double)bytes / tally->nodes - p->whole_bytes) / 64;
}

/* Do the roots of a run's subtrees fit one block? A single one does: what it lacks overflows. */
static bool tops_fit(packer *p, uint32_t first, uint32_t next) {
    mni_tally tally;
    mni_tally_init(&tally, p->plan->tree->leaf_color != NULL, p->plan->tree->grid_step);
    for (uint32_t e = first; e < next; e++) {
        mni_subtree record;
        mni_plan_subtree(p->plan, &p->exit[e], &record);
        mni_tally_subtree(&tally, &record);
        tally_add(p, &tally, p->exit[e].node, false);
    }
    return next - first == 1 || fits(p, &tally, tally.exits + tally.subtrees);
}

/* A child block for each run. */
static mn_code plan_exits(packer *p, uint32_t block) {
    mn_code code = plan_cuts(p);
    for (uint32_t e = 0, next; e < p->exits && code == MN_OK; e = next) {
        uint32_t made;
        mni_tally tally;
        next = p->cut[e].next;
        bool hoped = run_blocks(p, e, next) <= 1;
        bool whole = run_fits(p, e, next, &tally);
        if (!whole && hoped && next > e + 1)
            next = longest_whole(p, e, next, &whole, &tally);
        while (!whole && next > e + 1 && (next - e > p->run_most || !tops_fit(p, e, next)))
            whole = run_fits(p, e, --next, &tally);
        if (whole)
            whole_learn(p, &tally);
        code = mni_plan_block(p->plan, block, &made, p->st);
        for (uint32_t i = e; i < next && code == MN_OK; i++) {
            p->exit[i].whole = whole;
            code = mni_plan_root_add(p->plan, p->exit[i], p->st);
        }
    }
    return code;
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
        p->node_bytes = (double)mni_tally_bytes(&p->tally, 0) / p->tally.nodes;
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
                .node_bytes = START_NODE_BYTES,
                .whole_bytes = START_NODE_BYTES};
    p.stack = malloc(sizeof *p.stack * (MNI_BLOCK_DEPTH_MAX + 2));
    mn_code code = p.stack == NULL ? no_memory(&p) : pack_all(&p);
    free(p.stack);
    free(p.heap);
    free(p.exit);
    free(p.cut);
    return code;
}
