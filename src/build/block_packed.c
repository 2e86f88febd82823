/* Policy `packed`: blocks of fixed bytes, filled with several sibling subtrees of one parent block.
 *
 * A block gets its list of subtrees from its parent block, takes nodes from their tops, latest
 * collapse first, until it is full, and what is left below it, its exits, is cut into runs, one a
 * child block:
 *
 *     exits of a block, by leaf id:   e e e e | e e e e e | e e e
 *                                       └ child   └ child   └ child
 *
 * - Latest collapse first, because fronts are closed under the implicit dependencies, which compare
 *   order ids: nodes with near ids in one place are active together. (By switch value, fronts of
 *   the same cameras kept 1.1 to 1.4 times the blocks in use.)
 * - A run has many subtrees, RUN_SHARE of the nodes of a block: a front that passes just below
 * their roots finds as many active nodes in the block, where one deep subtree would give it two.
 * - What stands below a block of few exits is blocks of whole subtrees right below it: exits are
 *   gathered into each until the last byte is taken, and only the last of them stays part empty.
 * - So that this one is full too, a run is fitted: its block and those below it are packed for
 *   trial, and the run given subtrees or relieved of some until they come to whole blocks. What
 * each whole subtree takes is measured once and added up, so a trial does not look at most nodes
 * again.
 *
 * Hides: the grouping, and the room kept for references, whose number is known only after the exits
 * are grouped: a block that then turns out too long is filled again with more room kept.
 * Order: one call on an open plan; blocks are packed depth first, so that what was measured for a
 * trial is still there. One thread. Memory: 4 bytes an inner node, a few words an exit of one
 * block, and what MEASURES_MAX subtrees take or those of one block, when they are more. Paper:
 * §3.2, and what design.md §3.4 says of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "plan.h"

enum {
    TRIES_MAX = 24,   /* nodes that did not fit before a block counts as full */
    LOOK_AHEAD = 24,  /* exits that did not fit before a run counts as full */
    FITTINGS_MAX = 5, /* trials of one run */
    ENDED_TIMES = 12, /* nodes below a block, for one in it, that end in blocks right below it */
    SMALL_NODES = 1,  /* of a subtree that goes with its parent wherever that is */
    SMALL_NODES_MAX = 15, /* where a run needs a little less room */
    MEASURES_MAX = 8192,  /* kept from one block to the next */
    CUT_STEPS = 32,       /* ends of a run are tried that are a 32nd of it apart */
    WHOLE = INT32_MAX,    /* planned.small of a block that ends all its subtrees */
};
/* References kept room for, as a share of exits; the last always suffices. */
static const double ref_share[] = {0.03, 0.2, 0.6, 1};
enum { REF_SHARES = sizeof ref_share / sizeof ref_share[0] };
static const double RUN_SHARE = 0.25, /* subtrees in a run, for a node in a block */
    TOP_SHARE = 0.33,  /* of a block's nodes, for the roots of its subtrees at most */
    TOP_STRETCH = 1.5, /* times that, where it makes a run fit */
    FEW_COST = 1.5,    /* blocks that a run of one subtree may cost less than a long one */
    FIT_COST = 0.25,   /* blocks left empty below a run that can be fitted */
    FAR_COST = 0.4, FAR_COST_EACH = 0.03, /* below one with too much below, and for each block */
    NEARLY = 0.98,  /* of a block: what a run that is to fit it may be estimated at */
    ENOUGH = 0.06,  /* a run that leaves no more of a block empty fits */
    MARGIN = 0.02,  /* of a block: aimed at */
    SQUEEZE = 0.06; /* of a run's blocks: what larger SMALL_NODES can save */

typedef struct candidate {
    uint32_t node, depth, key;
} candidate;

/* An exit of a block. */
typedef struct item {
    uint32_t node, leaf_lo;
    uint32_t nodes; /* of its whole subtree */
} item;

/* A place where exits may be cut: before exit i. */
typedef struct cut {
    uint64_t nodes; /* of all exits before it */
    double cost;    /* blocks' worth of room that the best runs from here on leave empty */
    uint32_t next;  /* where the run that begins here ends */
} cut;

/* The exits of a block: in the order of their leaves, from where no run has been cut yet. */
typedef struct exit_list {
    item *item;
    item *kept; /* the best order found while a run is fitted */
    cut *cut;   /* count + 1 */
    uint32_t count, capacity, kept_capacity, cuts_capacity;
    uint32_t above; /* nodes of the block that they are exits of; 0: these are the tree's roots */
} exit_list;

/* What a whole subtree takes in a block. */
typedef struct measure {
    uint32_t node;
    bool fits; /* a block at all? */
    mni_tally tally;
} measure;

/* What becomes of a run, or of all exits of a block. */
typedef struct outcome {
    uint32_t blocks; /* 0: not known */
    double used;     /* of them, in blocks' worth of bytes */
} outcome;

typedef struct packer {
    mni_plan *plan;
    mn_status *st;
    uint32_t limit;     /* bytes that a block may end at */
    double node_bytes;  /* of a node in the block above */
    double whole_bytes; /* of a node in a block that ends all its subtrees: a running mean */
    mni_tally tally;    /* of the block being filled */
    uint32_t overflows; /* its nodes that overflow */
    candidate *heap;
    uint32_t waiting, heap_capacity;
    exit_list exits, below; /* of the block being packed, and of one that is tried below it */
    measure *measure;
    uint32_t measures, measures_capacity;
    uint32_t *measured; /* inner: which measure, if that one says so too */
    uint32_t *block;    /* still to be packed: a stack */
    uint32_t blocks, blocks_capacity;
    candidate *stack; /* an entry a level and one: whole subtrees are MNI_BLOCK_DEPTH_MAX deep */
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

static uint32_t nodes_below(const mn_tree *t, uint32_t node) {
    return t->leaf_hi[node] - t->leaf_lo[node] - 1; /* itself included */
}

/* ---- tallies -------------------------------------------------------------------------------- */

static void tally_none(const packer *p, mni_tally *tally) {
    mni_tally_init(tally, p->plan->tree->leaf_color != NULL, p->plan->tree->grid_step);
}

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

static void tally_add_root(const packer *p, mni_tally *tally, uint32_t node) {
    mni_subtree record;
    mni_plan_subtree(p->plan, &(mni_plan_root){.node = node}, &record);
    mni_tally_subtree(tally, &record);
    tally_add(p, tally, node, false);
}

static bool fits(const packer *p, const mni_tally *tally, uint32_t refs) {
    return tally->nodes <= MNI_BLOCK_NODES_MAX && tally->exits <= MNI_BLOCK_EXITS_MAX &&
           mni_tally_bytes(tally, refs) <= p->limit;
}

/* Adds a whole subtree, and says whether the result still fits; false also when it is too deep. A
 * tally that does not fit is of no more use. */
static bool tally_add_whole(packer *p, mni_tally *tally, uint32_t root) {
    const mn_tree *t = p->plan->tree;
    uint32_t waiting = 0;
    if ((uint64_t)nodes_below(t, root) + tally->nodes > MNI_BLOCK_NODES_MAX || overflows(p, root))
        return false; /* overflows are rare: such a node is filled in where references are counted
                       */
    tally_add_root(p, tally, root);
    p->stack[waiting++] = (candidate){.node = root};
    while (waiting > 0) {
        candidate from = p->stack[--waiting];
        for (uint32_t side = 2; side-- > 0;) {
            uint32_t child = mni_plan_child(t, from.node, side);
            if (child == MN_NONE)
                continue;
            if (from.depth + 1 >= MNI_BLOCK_DEPTH_MAX || overflows(p, child))
                return false;
            tally_add(p, tally, child, true);
            p->stack[waiting++] = (candidate){.node = child, .depth = from.depth + 1};
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

/* What the whole subtree takes; NULL: no memory. Valid until the next call. */
static const measure *measure_of(packer *p, const item *i) {
    uint32_t at = p->measured[i->node];
    if (at < p->measures && p->measure[at].node == i->node)
        return &p->measure[at];
    if (!room_for((void **)&p->measure, p->measures + 1, &p->measures_capacity, sizeof *p->measure))
        return NULL;
    measure *made = &p->measure[p->measures];
    made->node = i->node;
    tally_none(p, &made->tally);
    made->fits = i->nodes * p->whole_bytes < 1.3 * p->limit && /* at least nearly */
                 tally_add_whole(p, &made->tally, i->node);
    p->measured[i->node] = p->measures++;
    return made;
}

/* ---- the nodes of a block ------------------------------------------------------------------- */

static bool heap_above(const candidate *a, const candidate *b) {
    return a->key != b->key ? a->key > b->key : a->node > b->node;
}

static bool heap_push(packer *p, candidate added) {
    if (!room_for((void **)&p->heap, p->waiting + 1, &p->heap_capacity, sizeof *p->heap))
        return false;
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

/* Latest collapse first; small subtrees before all, for as exits they would cost more. */
static mn_code push_children(packer *p, uint32_t node, uint32_t depth, uint32_t small) {
    const mn_tree *t = p->plan->tree;
    for (uint32_t side = 0; side < 2; side++) {
        uint32_t child = mni_plan_child(t, node, side);
        if (child == MN_NONE || depth + 1 >= MNI_BLOCK_DEPTH_MAX)
            continue;
        uint32_t key = nodes_below(t, child) <= small ? UINT32_MAX : child;
        if (!heap_push(p, (candidate){child, depth + 1, key}))
            return no_memory(p);
    }
    return MN_OK;
}

static void take_whole(packer *p, uint32_t block, uint32_t root) {
    uint32_t waiting = 0;
    bool fitted = tally_add_whole(p, &p->tally, root);
    MN_ASSERT(fitted);
    p->stack[waiting++] = (candidate){.node = root};
    while (waiting > 0) {
        uint32_t node = p->stack[--waiting].node;
        p->plan->block_of[node] = block;
        for (uint32_t side = 2; side-- > 0;) {
            uint32_t child = mni_plan_child(p->plan->tree, node, side);
            if (child != MN_NONE)
                p->stack[waiting++] = (candidate){.node = child};
        }
    }
}

static uint32_t refs_kept(const packer *p, uint32_t exits, double share) {
    double refs = share * exits;
    uint32_t up = (uint32_t)refs + (refs > (double)(uint32_t)refs);
    return (up > exits ? exits : up) + p->overflows;
}

/* The tops of the block's subtrees, best first, until nothing fits. */
static mn_code fill(packer *p, uint32_t block, double share) {
    mni_plan *plan = p->plan;
    const mni_planned *b = &plan->block[block];
    p->waiting = p->overflows = 0;
    tally_none(p, &p->tally);
    for (uint32_t r = 0; r < b->root_count; r++) {
        uint32_t root = plan->root[b->root_first + r].node;
        if (b->small == WHOLE) {
            take_whole(p, block, root);
            continue;
        }
        tally_add_root(p, &p->tally, root);
        p->overflows += overflows(p, root);
        plan->block_of[root] = block;
        if (push_children(p, root, 0, b->small) != MN_OK)
            return MN_FAILED;
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
        if (push_children(p, next.node, next.depth, b->small) != MN_OK)
            return MN_FAILED;
    }
    return MN_OK;
}

/* Takes the listed block's nodes out of it. */
static void empty(mni_plan *plan) {
    for (uint32_t i = 0; i < plan->listed; i++)
        plan->block_of[plan->list[i]] = MN_NONE;
}

/* ---- the exits of a block ------------------------------------------------------------------- */

static mn_code add_exit(packer *p, exit_list *x, uint32_t node) {
    const mn_tree *t = p->plan->tree;
    if (!room_for((void **)&x->item, x->count + 1, &x->capacity, sizeof *x->item) ||
        !room_for((void **)&x->kept, x->count + 1, &x->kept_capacity, sizeof *x->kept) ||
        !room_for((void **)&x->cut, x->count + 2, &x->cuts_capacity, sizeof *x->cut))
        return no_memory(p);
    x->item[x->count++] = (item){node, t->leaf_lo[node], nodes_below(t, node)};
    return MN_OK;
}

static int by_leaf(const void *a, const void *b) {
    const item *x = a, *y = b;
    return x->leaf_lo < y->leaf_lo ? -1 : x->leaf_lo > y->leaf_lo;
}

/* Neighbours in the order of their leaves are neighbours on the surface, more or less. */
static void sort_exits(exit_list *x, uint32_t first, uint32_t next) {
    qsort(x->item + first, next - first, sizeof *x->item, by_leaf);
}

/* Of the listed block. */
static mn_code list_exits(packer *p, exit_list *x) {
    const mni_plan *plan = p->plan;
    x->count = 0;
    x->above = plan->listed;
    for (uint32_t i = 0; i < plan->listed; i++)
        for (uint32_t side = 0; side < 2; side++) {
            uint32_t child = mni_plan_child(plan->tree, plan->list[i], side);
            if (child != MN_NONE && plan->block_of[child] == MN_NONE &&
                add_exit(p, x, child) != MN_OK)
                return MN_FAILED;
        }
    sort_exits(x, 0, x->count);
    return MN_OK;
}

/* Brings exit `from` to `to`, before those from there on. */
static void bring(exit_list *x, uint32_t from, uint32_t to) {
    item moved = x->item[from];
    memmove(&x->item[to + 1], &x->item[to], (from - to) * sizeof moved);
    x->item[to] = moved;
}

/* A child block of exits [first, next). */
static mn_code plan_run(packer *p, exit_list *x, uint32_t block, uint32_t first, uint32_t next,
                        uint32_t small) {
    uint32_t made;
    mn_code code = mni_plan_block(p->plan, block, &made, p->st);
    sort_exits(x, first, next);
    for (uint32_t e = first; e < next && code == MN_OK; e++)
        code =
            mni_plan_root_add(p->plan, (mni_plan_root){x->item[e].node, x->item[e].leaf_lo}, p->st);
    if (code == MN_OK)
        p->plan->block[made].small = small;
    return code;
}

/* ---- blocks of whole subtrees --------------------------------------------------------------- */

/* Brings exits together from `first` on that fill a block, whole: neighbours, and when the next one
 * does not fit, one further on that does. *next: where they end, `first` if not even that one fits;
 * *bytes: what they take. */
static mn_code gather_whole(packer *p, exit_list *x, uint32_t first, uint32_t *next,
                            uint64_t *bytes) {
    mni_tally tally;
    uint32_t missed = 0;
    tally_none(p, &tally);
    *next = first;
    for (uint32_t e = first; e < x->count && missed < LOOK_AHEAD; e++) {
        mni_tally with = tally;
        const measure *m = measure_of(p, &x->item[e]);
        if (m == NULL)
            return no_memory(p);
        if (m->fits)
            mni_tally_merge(&with, &m->tally);
        if (m->fits && fits(p, &with, 0)) {
            tally = with;
            bring(x, e, (*next)++);
        } else if (*next == first) {
            break;
        } else {
            missed++;
        }
    }
    *bytes = mni_tally_bytes(&tally, 0);
    if (*bytes > p->limit / 2) /* in a short one the head counts too much */
        p->whole_bytes += ((double)*bytes / tally.nodes - p->whole_bytes) / 64;
    return MN_OK;
}

/* Are all exits of the block to end in the blocks right below it, if they can? A matter of exact
 * counts: a trial and what follows it must agree. */
static bool ends_below(const exit_list *x) {
    uint64_t nodes = 0;
    for (uint32_t e = 0; e < x->count; e++)
        nodes += x->item[e].nodes;
    return nodes <= (uint64_t)ENDED_TIMES * x->above;
}

/* All exits into blocks of whole subtrees, planned or only counted. out->blocks 0: some are too
 * large, and nothing is planned. */
static mn_code end_all(packer *p, exit_list *x, uint32_t block, bool planned, outcome *out) {
    *out = (outcome){0};
    for (uint32_t e = 0; e < x->count; e++) {
        const measure *m = measure_of(p, &x->item[e]);
        if (m == NULL)
            return no_memory(p);
        if (!m->fits)
            return MN_OK;
    }
    for (uint32_t e = 0, next; e < x->count; e = next) {
        uint64_t bytes;
        mn_code code = gather_whole(p, x, e, &next, &bytes);
        if (code == MN_OK && planned)
            code = plan_run(p, x, block, e, next, WHOLE);
        if (code != MN_OK)
            return code;
        out->blocks++;
        out->used += (double)bytes / p->limit;
    }
    return MN_OK;
}

/* ---- exits into runs ------------------------------------------------------------------------ */

static double blocks_of(const packer *p, uint64_t nodes) {
    return (double)nodes * p->whole_bytes / p->limit;
}

/* What the subtrees of a run would take, whole: in blocks. */
static double run_blocks(const packer *p, const exit_list *x, uint32_t first, uint32_t next) {
    return blocks_of(p, x->cut[next].nodes - x->cut[first].nodes);
}

/* What a run costs, in blocks: the room left empty in blocks below it, and something for having few
 * subtrees. */
static double run_cost(const packer *p, const exit_list *x, uint32_t first, uint32_t next) {
    double lacking = 1 - (next - first) * p->whole_bytes / (RUN_SHARE * p->limit);
    double few = lacking > 0 ? FEW_COST * lacking : 0;
    double blocks = run_blocks(p, x, first, next);
    if (blocks <= NEARLY)
        return few + 1 - blocks;
    if (blocks > ENDED_TIMES + 1)
        return few + FAR_COST + FAR_COST_EACH * blocks;
    if (next < x->count)
        return few + FIT_COST;
    blocks -= p->whole_bytes / p->node_bytes; /* its own nodes, dearer for their exits */
    return few + 1 - (blocks - floor(blocks));
}

/* Subtrees in a run that does not fit whole. */
static uint32_t run_most(const packer *p, const exit_list *x, double stretch) {
    return x->above == 0 ? x->count
                         : (uint32_t)(stretch * TOP_SHARE * p->limit / p->node_bytes) + 1;
}

/* From the last exit to `first`: where the run that begins there is best cut. */
static void plan_cuts(packer *p, exit_list *x, uint32_t first) {
    cut *c = x->cut;
    uint32_t most = run_most(p, x, 1);
    c[first].nodes = 0;
    for (uint32_t e = first; e < x->count; e++)
        c[e + 1].nodes = c[e].nodes + x->item[e].nodes;
    c[x->count].cost = 0;
    for (uint32_t e = x->count; e-- > first;) {
        c[e].cost = INFINITY;
        for (uint32_t next = e + 1; next <= x->count;) {
            if (next - e > most && run_blocks(p, x, e, next) > 1)
                break;
            double cost = c[next].cost + run_cost(p, x, e, next);
            if (cost < c[e].cost) {
                c[e].cost = cost;
                c[e].next = next;
            }
            uint32_t step = 1 + (next - e) / CUT_STEPS, rest = x->count - next;
            next += rest > 0 && rest < step ? rest : step;
        }
    }
}

/* Do the roots of a run's subtrees fit one block? A single one does: what it lacks overflows. */
static bool tops_fit(packer *p, const exit_list *x, uint32_t first, uint32_t next) {
    mni_tally tally;
    tally_none(p, &tally);
    for (uint32_t e = first; e < next; e++)
        tally_add_root(p, &tally, x->item[e].node);
    return next - first == 1 || fits(p, &tally, tally.exits + tally.subtrees);
}

/* ---- runs that fit -------------------------------------------------------------------------- */

/* Packs a run to see how many blocks it takes, if all below it is to end right there, and takes it
 * back. */
static mn_code try_run(packer *p, exit_list *x, uint32_t block, uint32_t first, uint32_t next,
                       uint32_t small, outcome *out) {
    mni_plan *plan = p->plan;
    uint32_t tried = plan->blocks, roots = plan->roots;
    *out = (outcome){0};
    mn_code code = plan_run(p, x, block, first, next, small);
    if (code == MN_OK)
        code = fill(p, tried, ref_share[0]);
    if (code != MN_OK)
        return code;
    mni_plan_list(plan, tried);
    code = list_exits(p, &p->below);
    if (code == MN_OK && ends_below(&p->below))
        code = end_all(p, &p->below, tried, false, out);
    if (out->blocks > 0 || p->below.count == 0) {
        out->used += (double)mni_tally_bytes(&p->tally, out->blocks + p->overflows) / p->limit;
        out->blocks++;
    }
    empty(plan);
    plan->blocks = tried;
    plan->roots = roots;
    return code;
}

/* Gives a run so many blocks' worth of subtrees more, or takes as many from its end and gives it
 * back what was too much. */
static uint32_t resize_run(packer *p, exit_list *x, uint32_t first, uint32_t next, double blocks) {
    uint32_t most = run_most(p, x, TOP_STRETCH), missed = 0;
    for (; blocks < 0 && next > first + 1; next--)
        blocks += blocks_of(p, x->item[next - 1].nodes);
    sort_exits(x, next, x->count);
    for (uint32_t e = next; e < x->count && next - first < most && missed < LOOK_AHEAD; e++) {
        double more = blocks_of(p, x->item[e].nodes);
        if (more > blocks) {
            missed++;
            continue;
        }
        blocks -= more;
        bring(x, e, next++);
    }
    return next;
}

/* Changes a run, and what its block is to do with small subtrees, until the blocks are full. */
static mn_code fit_run(packer *p, exit_list *x, uint32_t block, uint32_t first, uint32_t *next,
                       uint32_t *small) {
    size_t rest = (x->count - first) * sizeof *x->item;
    uint32_t end = *next, take = SMALL_NODES;
    double least = INFINITY;
    *small = take;
    if (run_blocks(p, x, first, end) > ENDED_TIMES + 1)
        return MN_OK;
    memcpy(x->kept, x->item + first, rest);
    for (uint32_t trial = 0; trial < FITTINGS_MAX && tops_fit(p, x, first, end); trial++) {
        outcome out;
        mn_code code = try_run(p, x, block, first, end, take, &out);
        if (code != MN_OK)
            return code;
        if (out.blocks == 0)
            break;
        double spare = out.blocks - out.used;
        if (spare < least) {
            least = spare;
            *next = end;
            *small = take;
            memcpy(x->kept, x->item + first, rest);
        }
        if (spare < ENOUGH)
            break;
        if (end < x->count) {
            end = resize_run(p, x, first, end, (spare < 0.5 ? spare : spare - 1) - MARGIN);
            if (end == x->count)
                break; /* a rest that fits nothing else is no better */
        } else if (1 - spare < SQUEEZE * out.blocks && take < SMALL_NODES_MAX) {
            take += take + 1;
        } else {
            break;
        }
    }
    memcpy(x->item + first, x->kept, rest);
    sort_exits(x, *next, x->count);
    return MN_OK;
}

/* The first run of the exits from there on, and its child block. */
static mn_code plan_next(packer *p, exit_list *x, uint32_t block, uint32_t first, uint32_t *next) {
    uint32_t small = WHOLE, end = first;
    mn_code code = MN_OK;
    plan_cuts(p, x, first);
    *next = x->cut[first].next;
    if (run_blocks(p, x, first, *next) <= NEARLY) {
        uint64_t bytes;
        code = gather_whole(p, x, first, &end, &bytes);
    }
    if (code == MN_OK && end > first) {
        *next = end;
    } else if (code == MN_OK) {
        while (*next > first + 1 && !tops_fit(p, x, first, *next))
            *next -= 1 + (*next - first) / 16;
        code = fit_run(p, x, block, first, next, &small);
    }
    return code == MN_OK ? plan_run(p, x, block, first, *next, small) : code;
}

static mn_code plan_exits(packer *p, uint32_t block) {
    exit_list *x = &p->exits;
    outcome out = {0};
    mn_code code = MN_OK;
    if (p->measures > MEASURES_MAX)
        p->measures = 0;
    if (ends_below(x))
        code = end_all(p, x, block, true, &out);
    for (uint32_t e = out.blocks > 0 ? x->count : 0; e < x->count && code == MN_OK;)
        code = plan_next(p, x, block, e, &e);
    return code;
}

/* ---- all of it ------------------------------------------------------------------------------ */

/* Fills a block and plans its children; with more room for references until they fit. */
static mn_code pack_block(packer *p, uint32_t block) {
    mni_plan *plan = p->plan;
    uint32_t blocks = plan->blocks, roots = plan->roots, overflow_max = plan->overflow_max;
    for (uint32_t share = 0;; share++) {
        mni_tally tally;
        MN_ASSERT(share < REF_SHARES);
        mn_code code = fill(p, block, ref_share[share]);
        if (code != MN_OK)
            return code;
        mni_plan_list(plan, block);
        mni_plan_tally(plan, block, &tally);
        p->node_bytes = (double)mni_tally_bytes(&tally, 0) / tally.nodes;
        plan->block[block].child_first = plan->blocks;
        code = list_exits(p, &p->exits);
        if (code == MN_OK)
            code = plan_exits(p, block);
        plan->block[block].child_count = plan->blocks - blocks;
        mni_plan_list(plan, block); /* again: trials have listed others */
        if (code == MN_OK)
            code = mni_plan_overflow(plan, block, p->st);
        if (code != MN_OK)
            return code;
        uint64_t bytes = mni_tally_bytes(&tally, plan->block[block].child_count);
        if (bytes <= p->limit) {
            plan->block[block].payload_bytes = (uint32_t)bytes;
            return MN_OK;
        }
        empty(plan);
        plan->blocks = blocks;
        plan->roots = roots;
        plan->overflow_max = overflow_max;
    }
}

/* Puts blocks on the stack, the first on top. */
static mn_code push_blocks(packer *p, uint32_t first, uint32_t count) {
    if (!room_for((void **)&p->block, p->blocks + count, &p->blocks_capacity, sizeof *p->block))
        return no_memory(p);
    for (uint32_t b = first + count; b-- > first;)
        if (!p->plan->block[b].is_overflow)
            p->block[p->blocks++] = b;
    return MN_OK;
}

/* What a node takes where nothing has been packed yet: in a subtree that fits a block. */
static void measure_first(packer *p) {
    const mn_tree *t = p->plan->tree;
    uint32_t node = t->root[0] - t->leaves;
    p->whole_bytes = p->limit; /* of a tree whose every node overflows */
    while (node != MN_NONE) {
        mni_tally tally;
        uint32_t left = mni_plan_child(t, node, 0), right = mni_plan_child(t, node, 1);
        tally_none(p, &tally);
        if (tally_add_whole(p, &tally, node)) {
            p->whole_bytes = (double)mni_tally_bytes(&tally, 0) / tally.nodes;
            break;
        }
        bool go_left =
            right == MN_NONE || (left != MN_NONE && nodes_below(t, left) > nodes_below(t, right));
        node = go_left ? left : right;
    }
    p->node_bytes = p->whole_bytes;
}

static mn_code pack_all(packer *p) {
    mni_plan *plan = p->plan;
    const mn_tree *t = plan->tree;
    for (uint32_t r = 0; r < t->roots; r++)
        if (add_exit(p, &p->exits, t->root[r] - t->leaves) != MN_OK)
            return MN_FAILED;
    measure_first(p);
    mn_code code = plan_exits(p, MN_NONE);
    if (code == MN_OK)
        code = push_blocks(p, 0, plan->blocks);
    uint32_t placed = 0;
    for (uint32_t done = 0; p->blocks > 0 && code == MN_OK; done++) {
        uint32_t b = p->block[--p->blocks];
        code = pack_block(p, b);
        placed += plan->listed;
        if (code == MN_OK)
            code = push_blocks(p, plan->block[b].child_first, plan->block[b].child_count);
        if (code == MN_OK && plan->desc->progress != NULL && done % 16 == 0 &&
            !plan->desc->progress(plan->desc->progress_context, "blocking", placed, t->inner))
            code = mn_fail(p->st, MN_FAILED, "interrupted");
    }
    MN_ASSERT(code != MN_OK || placed == t->inner);
    return code;
}

static void close_list(exit_list *x) {
    free(x->item);
    free(x->kept);
    free(x->cut);
}

mn_code mni_plan_packed(mni_plan *plan, mn_status *st) {
    packer p = {.plan = plan, .st = st, .limit = plan->desc->block_bytes - MNI_BLOCK_TAIL_BYTES};
    p.stack = malloc(sizeof *p.stack * (MNI_BLOCK_DEPTH_MAX + 2));
    p.measured = calloc(plan->tree->inner, sizeof *p.measured);
    mn_code code = p.stack == NULL || p.measured == NULL ? no_memory(&p) : pack_all(&p);
    free(p.stack);
    free(p.measured);
    free(p.measure);
    free(p.block);
    free(p.heap);
    close_list(&p.exits);
    close_list(&p.below);
    return code;
}
