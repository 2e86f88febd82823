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
 *   their roots finds as many active nodes in the block, where one deep subtree would give it two.
 * - What stands below a block of few exits is blocks of whole subtrees right below it: exits are
 *   gathered into each until the last byte is taken, and only the last of them stays part empty.
 * - So that this one is full too, a run is fitted: its block and those below it are packed for
 *   trial, and the run given subtrees or relieved of some until they come to whole blocks. What
 *   each whole subtree takes is measured once and added up, so a trial does not look at most nodes
 *   again. In long blocks the last run, which has what the others left, goes without its own block
 *   where that saves one.
 *
 * Hides: the grouping, and the room kept for references, whose number is known only after the exits
 * are grouped: a block that then turns out too long is filled again with more room kept.
 * Order: the roots, then each block after its parent; depth first, so that what was measured for a
 * trial is still there. What is still there decides about work, never about bytes. One thread.
 * Memory: two drafts, a few words an exit of one block, and what MEASURES subtrees take. Paper:
 * §3.2, and what design.md §3.4 says of it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "plan.h"

enum {
    TRIES_MAX = 24,   /* nodes that did not fit before a block counts as full */
    LOOK_AHEAD = 24,  /* exits that did not fit before a run counts as full */
    FITTINGS_MAX = 5, /* trials of one run */
    ENDED_TIMES = 14, /* nodes below a block, for one in it, that end in blocks right below it */
    ENDING_MOST = 4,  /* blocks of a last run that may end whole; of more, each would be narrow */
    ENDING_LEAST = 9 << 10, /* bytes of a block, for that: of shorter ones each is narrow */
    SMALL_NODES = 1,        /* of a subtree that goes with its parent wherever that is */
    SMALL_NODES_MAX = 15,   /* where a run needs a little less room */
    MEASURES = 4096,        /* kept: those of the runs of a block of 8 KiB */
    NODE_BYTES_LEAST = 8,   /* a whole subtree with less for each node is not looked for */
    CUT_STEPS = 32,         /* ends of a run are tried that are a 32nd of it apart */
    WHOLE = INT32_MAX,      /* run.small of a block that ends all its subtrees */
};
/* References kept room for: a share of exits, and how many at most; the last always suffices. A
 * block has as many blocks below it whatever its length, so at first only what four bits say. */
static const struct {
    double share;
    uint32_t most;
} refs_room[] = {{0.03, 15}, {0.2, UINT32_MAX}, {0.6, UINT32_MAX}, {1, UINT32_MAX}};
enum { REFS_ROOMS = sizeof refs_room / sizeof refs_room[0] };
static const double RUN_SHARE = 0.25, /* subtrees in a run, for a node in a block */
    TOP_SHARE = 0.33,  /* of a block's nodes, for the roots of its subtrees at most */
    TOP_STRETCH = 1.5, /* times that, where it makes a run fit */
    FEW_COST = 1.5,    /* blocks that a run of one subtree may cost less than a long one */
    FIT_COST = 0.25,   /* blocks left empty below a run that can be fitted */
    FAR_COST = 0.4, FAR_COST_EACH = 0.03, /* below one with too much below, and for each block */
    NEARLY = 0.98,      /* of a block: what a run that is to fit it may be estimated at */
    ENOUGH = 0.04,      /* a run that leaves no more of a block empty fits */
    MARGIN = 0.02,      /* of a block: aimed at */
    SQUEEZE = 0.06,     /* of a run's blocks: what larger SMALL_NODES can save */
    ENDING_SAVES = 0.4; /* of a block: what the exits of an inner one take, at most */

typedef struct candidate {
    uint32_t known, depth, key, order;
} candidate;

/* A place where exits may be cut: before exit i. */
typedef struct cut {
    uint64_t nodes; /* of all exits before it */
    double cost;    /* blocks' worth of room that the best runs from here on leave empty */
    uint32_t next;  /* where the run that begins here ends */
} cut;

/* The exits of a block: in the order of their leaves, from where no run has been cut yet. */
typedef struct exit_list {
    mni_family *family;
    mni_draft *draft; /* that they are exits of */
    mni_exit *kept;   /* the best order found while a run is fitted */
    cut *cut;         /* exits + 1 */
    uint32_t kept_capacity, cuts_capacity;
    uint32_t above; /* nodes of the block that they are exits of; 0: these are the tree's roots */
} exit_list;

/* What a whole subtree takes in a block. */
typedef struct measure {
    uint32_t row; /* 0: none */
    bool fits;    /* a block at all? */
    mni_tally tally;
} measure;

/* What becomes of a run, or of all exits of a block. */
typedef struct outcome {
    uint32_t blocks; /* 0: not known */
    double last;     /* of the last one, what is used */
} outcome;

struct mni_packer {
    mni_plan *plan;
    uint32_t limit;     /* bytes that a block may end at */
    double node_bytes;  /* of a node in the block above */
    double whole_bytes; /* of a node in a block that ends all its subtrees: a running mean */
    double whole_first; /* what it was at first */
    mni_tally tally;    /* of the block being filled */
    uint32_t overflows; /* its nodes that overflow */
    candidate *heap;
    uint32_t waiting, heap_capacity;
    exit_list exits, below; /* of the block being packed, and of one that is tried below it */
    uint32_t trials;        /* in the block's draft: whose nodes they take */
    mni_family trial_family;
    mni_draft first;  /* while nothing has been packed */
    measure *measure; /* MEASURES, by a hash of the row */
    mni_rows_run run;
};

static mn_code no_memory(mni_packer *p) {
    return mni_plan_trouble(p->plan, "the packing of blocks");
}

/* ---- tallies -------------------------------------------------------------------------------- */

static void tally_none(const mni_packer *p, mni_tally *tally) {
    mni_tally_init(tally, p->plan->limits.has_colors, p->plan->limits.grid_step);
}

static bool fits(const mni_packer *p, mni_tally *tally, uint32_t refs) {
    return tally->nodes <= MNI_BLOCK_NODES_MAX && tally->exits <= MNI_BLOCK_EXITS_MAX &&
           mni_tally_fits(tally, refs, p->limit);
}

/* What the whole subtree takes. Valid until the next call. */
static mn_code measure_of(mni_packer *p, const mni_exit *x, const measure **out) {
    measure *m = &p->measure[x->row * UINT32_C(0x9e3779b1) >> 20 & (MEASURES - 1)];
    mn_code code = MN_OK;
    *out = m;
    if (m->row == x->row)
        return MN_OK;
    *m = (measure){.row = 0};
    tally_none(p, &m->tally);
    if (x->nodes <= MNI_BLOCK_NODES_MAX && x->nodes <= p->limit / NODE_BYTES_LEAST &&
        x->nodes * p->whole_first < 1.6 * p->limit) /* at least nearly */
        code = mni_whole_tally(p->plan, x, p->limit, &p->run, &m->tally, &m->fits);
    if (code == MN_OK)
        m->row = x->row;
    return code;
}

/* ---- the nodes of a block ------------------------------------------------------------------- */

static bool heap_above(const candidate *a, const candidate *b) {
    return a->key != b->key ? a->key > b->key : a->order > b->order;
}

static bool heap_push(mni_packer *p, candidate added) {
    if (!mni_plan_room((void **)&p->heap, p->waiting + 1, &p->heap_capacity, sizeof *p->heap))
        return false;
    uint32_t at = p->waiting++;
    while (at > 0 && heap_above(&added, &p->heap[(at - 1) / 2])) {
        p->heap[at] = p->heap[(at - 1) / 2];
        at = (at - 1) / 2;
    }
    p->heap[at] = added;
    return true;
}

static candidate heap_pop(mni_packer *p) {
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
static mn_code push_children(mni_packer *p, const mni_draft *draft, uint32_t known, uint32_t depth,
                             uint32_t small) {
    for (uint32_t side = 0; side < 2; side++) {
        uint32_t child = draft->known[known].child[side];
        if (child == MN_NONE || depth + 1 >= MNI_BLOCK_DEPTH_MAX)
            continue;
        const mni_row *row = &draft->known[child].row;
        uint32_t key = row->leaf_hi - row->leaf_lo - 1 <= small ? UINT32_MAX : row->order;
        if (!heap_push(p, (candidate){child, depth + 1, key, row->order}))
            return no_memory(p);
    }
    return MN_OK;
}

static uint32_t refs_kept(const mni_packer *p, uint32_t exits, uint32_t room) {
    double refs = refs_room[room].share * exits;
    uint32_t up = (uint32_t)refs + (refs > (double)(uint32_t)refs), most = refs_room[room].most;
    up = up > most ? most : up;
    return (up > exits ? exits : up) + p->overflows;
}

static mn_code take(mni_packer *p, mni_draft *draft, uint32_t known, uint32_t takes, uint32_t depth,
                    uint32_t small) {
    draft->known[known].taken = takes;
    return push_children(p, draft, known, depth, small);
}

/* The tops of subtrees of the draft, best first, until nothing fits. takes: who gets them. */
static mn_code fill(mni_packer *p, mni_draft *draft, const mni_exit *root, uint32_t roots,
                    uint32_t takes, uint32_t small, uint32_t room) {
    mn_code code = MN_OK;
    p->waiting = p->overflows = 0;
    tally_none(p, &p->tally);
    for (uint32_t r = 0; r < roots && code == MN_OK; r++) {
        code = mni_draft_tally_root(p->plan, draft, root[r].known, &p->tally);
        p->overflows += mni_draft_overflows(p->plan, &draft->known[root[r].known]);
        if (code == MN_OK)
            code = take(p, draft, root[r].known, takes, 0, small);
    }
    for (uint32_t tries = 0; p->waiting > 0 && tries < TRIES_MAX && code == MN_OK;) {
        candidate next = heap_pop(p);
        mni_tally with = p->tally;
        code = mni_draft_tally(p->plan, draft, next.known, &with);
        if (code != MN_OK)
            break;
        uint32_t overflows = mni_draft_overflows(p->plan, &draft->known[next.known]);
        with.exits--; /* it was one */
        p->overflows += overflows;
        if (!fits(p, &with, refs_kept(p, with.exits, room))) {
            p->overflows -= overflows;
            tries++;
            continue;
        }
        p->tally = with;
        code = take(p, draft, next.known, takes, next.depth, small);
    }
    return code;
}

/* ---- the exits of a block ------------------------------------------------------------------- */

static int by_leaf(const void *a, const void *b) {
    const mni_exit *x = a, *y = b;
    return x->leaf_lo < y->leaf_lo ? -1 : x->leaf_lo > y->leaf_lo;
}

/* Neighbours in the order of their leaves are neighbours on the surface, more or less. */
static void sort_exits(exit_list *x, uint32_t first, uint32_t next) {
    mni_exit *exit = x->family->exit;
    uint32_t e = first + 1;
    while (e < next && exit[e - 1].leaf_lo < exit[e].leaf_lo)
        e++;
    if (e < next)
        qsort(exit + first, next - first, sizeof *exit, by_leaf);
}

static mn_code begin_list(mni_packer *p, exit_list *x, mni_draft *draft, uint32_t above,
                          mni_family *family) {
    x->family = family;
    x->draft = draft;
    x->above = above;
    if (!mni_plan_room((void **)&x->kept, family->exits, &x->kept_capacity, sizeof *x->kept) ||
        !mni_plan_room((void **)&x->cut, family->exits + 1, &x->cuts_capacity, sizeof *x->cut))
        return no_memory(p);
    sort_exits(x, 0, family->exits);
    return MN_OK;
}

/* The exits of who has taken those roots, by the last fill. */
static mn_code list_exits(mni_packer *p, exit_list *x, mni_draft *draft, const mni_exit *root,
                          uint32_t roots, uint32_t takes, mni_family *family) {
    mn_code code = mni_draft_exits(p->plan, draft, root, roots, takes, family);
    return code == MN_OK ? begin_list(p, x, draft, p->tally.nodes, family) : code;
}

/* Brings exit `from` to `to`, before those from there on. */
static void bring(exit_list *x, uint32_t from, uint32_t to) {
    mni_exit *exit = x->family->exit, moved = exit[from];
    memmove(&exit[to + 1], &exit[to], (from - to) * sizeof moved);
    exit[to] = moved;
}

/* A child block of exits [first, next); whole: what it takes, or NULL. */
static mn_code add_run(mni_packer *p, exit_list *x, uint32_t first, uint32_t next, uint32_t small,
                       const mni_tally *whole) {
    mni_family *f = x->family;
    if (!mni_plan_room((void **)&f->run, f->runs + 1, &f->runs_capacity, sizeof *f->run))
        return no_memory(p);
    sort_exits(x, first, next);
    mni_run *run = &f->run[f->runs++];
    *run = (mni_run){.first = first, .next = next, .small = small, .whole = whole != NULL};
    if (whole != NULL) {
        run->tally = *whole;
        run->payload_bytes = (uint32_t)mni_tally_bytes(whole, 0);
    }
    return MN_OK;
}

/* ---- blocks of whole subtrees --------------------------------------------------------------- */

/* Brings exits together from `first` on that fill a block, whole: neighbours, and when the next one
 * does not fit, one further on that does. *next: where they end, `first` if not even that one fits;
 * *tally: what they take. */
static mn_code gather_whole(mni_packer *p, exit_list *x, uint32_t first, uint32_t *next,
                            mni_tally *tally) {
    const mni_family *f = x->family;
    uint32_t missed = 0;
    tally_none(p, tally);
    *next = first;
    for (uint32_t e = first; e < f->exits && missed < LOOK_AHEAD; e++) {
        mni_tally with = *tally;
        const measure *m;
        mn_code code = measure_of(p, &f->exit[e], &m);
        if (code != MN_OK)
            return code;
        if (m->fits)
            mni_tally_merge(&with, &m->tally);
        if (m->fits && fits(p, &with, 0)) {
            *tally = with;
            bring(x, e, (*next)++);
        } else if (*next == first) {
            break;
        } else {
            missed++;
        }
    }
    uint64_t bytes = mni_tally_bytes(tally, 0);
    if (bytes > p->limit / 2) /* in a short one the head counts too much */
        p->whole_bytes += ((double)bytes / tally->nodes - p->whole_bytes) / 64;
    return MN_OK;
}

/* Are all exits of the block to end in the blocks right below it, if they can? A matter of exact
 * counts: a trial and what follows it must agree. */
static bool ends_below(const exit_list *x) {
    uint64_t nodes = 0;
    for (uint32_t e = 0; e < x->family->exits; e++)
        nodes += x->family->exit[e].nodes;
    return nodes <= (uint64_t)ENDED_TIMES * x->above;
}

/* All exits from there on into blocks of whole subtrees, planned or only counted. out->blocks 0:
 * some are too large, and nothing is planned. */
static mn_code end_all(mni_packer *p, exit_list *x, uint32_t first, bool planned, outcome *out) {
    const mni_family *f = x->family;
    *out = (outcome){0};
    for (uint32_t e = first; e < f->exits; e++) {
        const measure *m;
        mn_code code = measure_of(p, &f->exit[e], &m);
        if (code != MN_OK || !m->fits)
            return code;
    }
    for (uint32_t e = first, next; e < f->exits; e = next) {
        mni_tally tally;
        mn_code code = gather_whole(p, x, e, &next, &tally);
        if (code == MN_OK && planned)
            code = add_run(p, x, e, next, WHOLE, &tally);
        if (code != MN_OK)
            return code;
        out->blocks++;
        out->last = (double)mni_tally_bytes(&tally, 0) / p->limit;
    }
    return MN_OK;
}

/* ---- exits into runs ------------------------------------------------------------------------ */

static double blocks_of(const mni_packer *p, uint64_t nodes) {
    return (double)nodes * p->whole_bytes / p->limit;
}

/* What the subtrees of a run would take, whole: in blocks. */
static double run_blocks(const mni_packer *p, const exit_list *x, uint32_t first, uint32_t next) {
    return blocks_of(p, x->cut[next].nodes - x->cut[first].nodes);
}

/* What a run costs, in blocks: the room left empty in blocks below it, and something for having few
 * subtrees. */
static double run_cost(const mni_packer *p, const exit_list *x, uint32_t first, uint32_t next) {
    double lacking = 1 - (next - first) * p->whole_bytes / (RUN_SHARE * p->limit);
    double few = lacking > 0 ? FEW_COST * lacking : 0;
    double blocks = run_blocks(p, x, first, next);
    if (blocks <= NEARLY)
        return few + 1 - blocks;
    if (blocks > ENDED_TIMES + 1)
        return few + FAR_COST + FAR_COST_EACH * blocks;
    if (next < x->family->exits)
        return few + FIT_COST;
    blocks -= p->whole_bytes / p->node_bytes; /* its own nodes, dearer for their exits */
    return few + 1 - (blocks - floor(blocks));
}

/* Subtrees in a run that does not fit whole. */
static uint32_t run_most(const mni_packer *p, const exit_list *x, double stretch) {
    return x->above == 0 ? x->family->exits
                         : (uint32_t)(stretch * TOP_SHARE * p->limit / p->node_bytes) + 1;
}

/* From the last exit to `first`: where the run that begins there is best cut. */
static void plan_cuts(mni_packer *p, exit_list *x, uint32_t first) {
    cut *c = x->cut;
    uint32_t most = run_most(p, x, 1);
    c[first].nodes = 0;
    for (uint32_t e = first; e < x->family->exits; e++)
        c[e + 1].nodes = c[e].nodes + x->family->exit[e].nodes;
    c[x->family->exits].cost = 0;
    for (uint32_t e = x->family->exits; e-- > first;) {
        c[e].cost = INFINITY;
        for (uint32_t next = e + 1; next <= x->family->exits;) {
            if (next - e > most && run_blocks(p, x, e, next) > 1)
                break;
            double cost = c[next].cost + run_cost(p, x, e, next);
            if (cost < c[e].cost) {
                c[e].cost = cost;
                c[e].next = next;
            }
            uint32_t step = 1 + (next - e) / CUT_STEPS, rest = x->family->exits - next;
            next += rest > 0 && rest < step ? rest : step;
        }
    }
}

/* Do the roots of a run's subtrees fit one block? A single one does: what it lacks overflows. */
static mn_code tops_fit(mni_packer *p, exit_list *x, uint32_t first, uint32_t next, bool *fit) {
    mni_tally tally;
    mn_code code = MN_OK;
    tally_none(p, &tally);
    *fit = true;
    if (next - first == 1)
        return MN_OK;
    for (uint32_t e = first; e < next && code == MN_OK; e++)
        code = mni_draft_tally_root(p->plan, x->draft, x->family->exit[e].known, &tally);
    *fit = fits(p, &tally, tally.exits + tally.subtrees);
    return code;
}

/* ---- runs that fit -------------------------------------------------------------------------- */

/* Packs a run to see how many blocks it takes, if all below it is to end right there. */
static mn_code try_run(mni_packer *p, exit_list *x, uint32_t first, uint32_t next, uint32_t small,
                       outcome *out) {
    *out = (outcome){0};
    uint32_t takes = MNI_BLOCK_TAKES + ++p->trials;
    sort_exits(x, first, next);
    mn_code code = fill(p, x->draft, x->family->exit + first, next - first, takes, small, 0);
    if (code == MN_OK)
        code = list_exits(p, &p->below, x->draft, x->family->exit + first, next - first, takes,
                          &p->trial_family);
    if (code == MN_OK && ends_below(&p->below))
        code = end_all(p, &p->below, 0, false, out);
    if (p->trial_family.exits == 0)
        out->last = (double)mni_tally_bytes(&p->tally, p->overflows) / p->limit;
    if (out->blocks > 0 || p->trial_family.exits == 0)
        out->blocks++;
    return code;
}

/* Gives a run so many blocks' worth of subtrees more, or takes as many from its end and gives it
 * back what was too much. */
static uint32_t resize_run(mni_packer *p, exit_list *x, uint32_t first, uint32_t next,
                           double blocks) {
    uint32_t most = run_most(p, x, TOP_STRETCH), missed = 0;
    for (; blocks < 0 && next > first + 1; next--)
        blocks += blocks_of(p, x->family->exit[next - 1].nodes);
    sort_exits(x, next, x->family->exits);
    for (uint32_t e = next; e < x->family->exits && next - first < most && missed < LOOK_AHEAD;
         e++) {
        double more = blocks_of(p, x->family->exit[e].nodes);
        if (more > blocks) {
            missed++;
            continue;
        }
        blocks -= more;
        bring(x, e, next++);
    }
    return next;
}

/* Changes a run, and what its block is to do with small subtrees, until the last block is full; the
 * others are as full as they can be. */
static mn_code fit_run(mni_packer *p, exit_list *x, uint32_t first, uint32_t *next, uint32_t *small,
                       outcome *best) {
    const uint32_t exits = x->family->exits;
    size_t rest = (exits - first) * sizeof *x->kept;
    uint32_t end = *next, take = SMALL_NODES;
    *small = take;
    *best = (outcome){.last = -1};
    if (run_blocks(p, x, first, end) > ENDED_TIMES + 1)
        return MN_OK;
    memcpy(x->kept, x->family->exit + first, rest);
    for (uint32_t trial = 0; trial < FITTINGS_MAX; trial++) {
        outcome out;
        bool fit;
        mn_code code = tops_fit(p, x, first, end, &fit);
        if (code == MN_OK && !fit)
            break;
        if (code == MN_OK)
            code = try_run(p, x, first, end, take, &out);
        if (code != MN_OK)
            return code;
        if (out.blocks == 0)
            break;
        if (out.last > best->last) {
            *best = out;
            *next = end;
            *small = take;
            memcpy(x->kept, x->family->exit + first, rest);
        }
        if (out.last > 1 - ENOUGH)
            break;
        if (end < exits) {
            end =
                resize_run(p, x, first, end, (out.last > 0.5 ? 1 - out.last : -out.last) - MARGIN);
            if (end == exits)
                break; /* a rest that fits nothing else is no better */
        } else if (out.last < SQUEEZE * out.blocks && take < SMALL_NODES_MAX) {
            take += take + 1;
        } else {
            break;
        }
    }
    memcpy(x->family->exit + first, x->kept, rest);
    sort_exits(x, *next, exits);
    return MN_OK;
}

/* The last run, into blocks of whole subtrees if these are fewer: an inner block's exits take about
 * a third of its room, and of the last block below it little is used. */
static mn_code end_run(mni_packer *p, exit_list *x, uint32_t first, const outcome *fitted,
                       bool *ended) {
    outcome out = {0};
    mn_code code = MN_OK;
    if (p->limit >= ENDING_LEAST && fitted->blocks > 0 && fitted->blocks <= ENDING_MOST &&
        fitted->last < ENDING_SAVES)
        code = end_all(p, x, first, false, &out);
    *ended = out.blocks > 0 && out.blocks < fitted->blocks;
    return code == MN_OK && *ended ? end_all(p, x, first, true, &out) : code;
}

/* The first run of the exits from there on. */
static mn_code plan_next(mni_packer *p, exit_list *x, uint32_t first, uint32_t *next) {
    uint32_t small = WHOLE, end = first;
    bool ended = false;
    outcome fitted = {0};
    mni_tally whole;
    mn_code code = MN_OK;
    plan_cuts(p, x, first);
    *next = x->cut[first].next;
    if (run_blocks(p, x, first, *next) <= NEARLY)
        code = gather_whole(p, x, first, &end, &whole);
    if (code == MN_OK && end > first) {
        *next = end;
        return add_run(p, x, first, end, WHOLE, &whole);
    }
    for (bool fit = false; code == MN_OK && *next > first + 1;) {
        code = tops_fit(p, x, first, *next, &fit);
        if (fit)
            break;
        *next -= 1 + (*next - first) / 16;
    }
    if (code == MN_OK)
        code = fit_run(p, x, first, next, &small, &fitted);
    if (code == MN_OK && *next == x->family->exits)
        code = end_run(p, x, first, &fitted, &ended);
    return code == MN_OK && !ended ? add_run(p, x, first, *next, small, NULL) : code;
}

/* What trials have looked at below a run is of no use to the next one. */
static mn_code plan_exits(mni_packer *p, exit_list *x) {
    const uint32_t knowns = x->draft->knowns;
    outcome out = {0};
    mn_code code = MN_OK;
    p->trials = 0;
    if (ends_below(x))
        code = end_all(p, x, 0, true, &out);
    for (uint32_t e = out.blocks > 0 ? x->family->exits : 0;
         e < x->family->exits && code == MN_OK;) {
        code = plan_next(p, x, e, &e);
        mni_draft_forget(x->draft, knowns);
    }
    return code;
}

/* ---- all of it ------------------------------------------------------------------------------ */

mn_code mni_packer_block(mni_packer *p, mni_exit *root, uint32_t roots, uint32_t small,
                         mni_draft *draft, mni_family *family, mni_tally *tally) {
    for (uint32_t room = 0;; room++) {
        MN_ASSERT(room < REFS_ROOMS);
        mn_code code = mni_draft_begin(p->plan, draft, root, roots);
        for (uint32_t r = 0; r < roots; r++)
            root[r].known = r;
        if (code == MN_OK)
            code = fill(p, draft, root, roots, MNI_BLOCK_TAKES, small, room);
        if (code == MN_OK)
            code = mni_draft_list(p->plan, draft);
        if (code != MN_OK)
            return code;
        *tally = p->tally;
        uint32_t overflows = p->overflows; /* trials have others */
        p->node_bytes = (double)mni_tally_bytes(tally, 0) / tally->nodes;
        code = list_exits(p, &p->exits, draft, root, roots, MNI_BLOCK_TAKES, family);
        if (code == MN_OK)
            code = plan_exits(p, &p->exits);
        if (code != MN_OK || mni_tally_bytes(tally, family->runs + overflows) <= p->limit)
            return code;
    }
}

/* What a node takes where nothing has been packed yet: in a subtree that fits a block. */
static mn_code measure_first(mni_packer *p, const mni_exit *root) {
    mni_exit at = *root;
    p->whole_first = 0;        /* any may fit */
    p->whole_bytes = p->limit; /* of a tree whose every node overflows */
    for (;;) {
        const measure *m;
        mni_draft *draft = &p->first;
        mn_code code = measure_of(p, &at, &m);
        if (code == MN_OK && m->fits) {
            p->whole_bytes = (double)mni_tally_bytes(&m->tally, 0) / m->tally.nodes;
            break;
        }
        if (code == MN_OK)
            code = mni_draft_begin(p->plan, draft, &at, 1);
        if (code == MN_OK)
            code = mni_draft_expand(p->plan, draft, 0);
        if (code != MN_OK)
            return code;
        draft->known[0].taken = MNI_BLOCK_TAKES;
        at.known = 0;
        code = mni_draft_exits(p->plan, draft, &at, 1, MNI_BLOCK_TAKES, &p->trial_family);
        if (code != MN_OK)
            return code;
        const mni_family *f = &p->trial_family;
        if (f->exits == 0)
            break;
        at = f->exit[f->exits == 2 && f->exit[1].nodes >= f->exit[0].nodes ? 1 : 0];
    }
    p->whole_first = p->node_bytes = p->whole_bytes;
    memset(p->measure, 0, sizeof *p->measure * MEASURES); /* as if none had been measured */
    return MN_OK;
}

mn_code mni_packer_roots(mni_packer *p, mni_draft *draft, mni_family *roots) {
    mn_code code = measure_first(p, &roots->exit[0]);
    roots->runs = 0;
    if (code == MN_OK)
        code = begin_list(p, &p->exits, draft, 0, roots);
    return code == MN_OK ? plan_exits(p, &p->exits) : code;
}

mn_code mni_packer_open(mni_packer **out, mni_plan *plan) {
    mni_packer *p = *out = calloc(1, sizeof *p);
    if (p == NULL)
        return mni_plan_trouble(plan, "the packing of blocks");
    p->plan = plan;
    p->limit = plan->desc->block_bytes - MNI_BLOCK_TAIL_BYTES;
    p->measure = calloc(MEASURES, sizeof *p->measure);
    return p->measure != NULL ? MN_OK : no_memory(p);
}

static void close_list(exit_list *x) {
    free(x->kept);
    free(x->cut);
}

void mni_packer_close(mni_packer *p) {
    if (p == NULL)
        return;
    free(p->heap);
    free(p->measure);
    free(p->trial_family.exit);
    free(p->trial_family.run);
    mni_draft_free(&p->first);
    mni_rows_run_free(&p->run);
    close_list(&p->exits);
    close_list(&p->below);
    free(p);
}
