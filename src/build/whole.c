/* Whole subtrees: most nodes are in blocks that end all that is in them.
 *
 * Hides: that a subtree of n nodes is n rows side by side, so that a tally goes through them as
 * they lie, and only the encoder goes down from the root. Order: tally, then encode with the sum of
 * the roots' tallies. One thread a plan. Memory: the rows and simplices of one subtree, for trees
 * in files. Paper: §3.2. */
#include <string.h>

#include "mn_assert.h"
#include "plan.h"

enum { TEST_EVERY = 64 }; /* nodes between looks whether it still fits */

typedef struct waiting {
    uint32_t at, lo, hi, order_below, depth;
    float position[3];
} waiting;

/* The rows of its inner nodes. *fits: false, its simplices are too many for one block. */
static mn_code fill_run(mni_plan *plan, const mni_exit *root, mni_rows_run *run, bool *fits) {
    uint32_t first = root->leaf_lo + 1, end = first + root->nodes;
    uint32_t most = 8 * plan->overflow_bytes; /* a simplex takes a bit at least */
    if (end < first || end > plan->limits.leaves)
        return mn_fail(plan->st, MN_BAD_INPUT, "row %u: leaves beyond the last", root->row);
    if (!mni_rows_fill_run(plan->rows, first, end, most, run))
        return mni_plan_trouble(plan, "the nodes of a subtree");
    *fits = run->simplex != NULL;
    if (!*fits &&
        (run->simplex_first > run->simplex_end || run->simplex_end > plan->limits.simplices))
        return mn_fail(plan->st, MN_BAD_INPUT, "rows [%u, %u): simplices [%u, %u) of %u", first,
                       end, run->simplex_first, run->simplex_end, plan->limits.simplices);
    return MN_OK;
}

static uint32_t simplices_end(const mni_rows_run *run, uint32_t at) {
    return at + 1 < run->end ? run->row[at + 1 - run->first].simplex_start : run->simplex_end;
}

/* Is the subtree deeper than a block may be? Goes down through rows that were found safe one by
 * one, but need not go together yet. */
static mn_code too_deep(mni_plan *plan, const mni_exit *root, const mni_rows_run *run, bool *deep) {
    struct {
        uint32_t at, lo, hi, depth;
    } stack[MNI_BLOCK_DEPTH_MAX + 2];
    uint32_t waits = 0;
    *deep = false;
    stack[waits].at = root->row;
    stack[waits].lo = root->leaf_lo;
    stack[waits].hi = root->leaf_lo + root->nodes + 1;
    stack[waits++].depth = 0;
    while (waits > 0) {
        uint32_t at = stack[--waits].at, depth = stack[waits].depth;
        const mni_row *row = &run->row[at - run->first];
        if (row->leaf_lo != stack[waits].lo || row->leaf_hi != stack[waits].hi)
            return mn_fail(plan->st, MN_BAD_INPUT,
                           "row %u: leaves [%u, %u) of a node, where its parent has [%u, %u)", at,
                           row->leaf_lo, row->leaf_hi, stack[waits].lo, stack[waits].hi);
        if (depth >= MNI_BLOCK_DEPTH_MAX) {
            *deep = true;
            return MN_OK;
        }
        for (uint32_t side = 0; side < 2; side++) {
            uint32_t child = side == 0 ? row->left : row->right;
            if (child == MN_NONE)
                continue;
            stack[waits].at = child;
            stack[waits].lo = side == 0 ? row->leaf_lo : at;
            stack[waits].hi = side == 0 ? at : row->leaf_hi;
            stack[waits++].depth = depth + 1;
        }
    }
    return MN_OK;
}

mn_code mni_whole_tally(mni_plan *plan, const mni_exit *root, uint32_t limit, mni_rows_run *run,
                        mni_tally *tally, bool *fits) {
    mn_code code = fill_run(plan, root, run, fits);
    if (code != MN_OK || !*fits)
        return code;
    const uint32_t lo = root->leaf_lo, hi = run->end;
    mni_row_limits limits = plan->limits;
    limits.simplices = run->simplex_end; /* what is in the run */
    const mni_subtree subtree = {.leaf_lo = lo, .leaf_hi = hi};
    mni_tally_subtree(tally, &subtree);
    for (uint32_t at = run->first; at < hi; at++) {
        const mni_row *row = &run->row[at - run->first];
        uint32_t end = simplices_end(run, at);
        mni_place place = {row->leaf_lo, row->leaf_hi, {0}};
        mni_node record;
        if (row->leaf_lo < lo || row->leaf_lo >= at || row->leaf_hi > hi)
            return mn_fail(plan->st, MN_BAD_INPUT, "row %u: leaves [%u, %u) of a node in [%u, %u)",
                           at, row->leaf_lo, row->leaf_hi, lo, hi);
        memcpy(place.position,
               row->leaf_lo == lo ? root->position : row[-(ptrdiff_t)(at - row->leaf_lo)].position,
               sizeof place.position);
        code = mni_row_safe(&limits, at, row, end, &place, root->order + 1, plan->st);
        if (code != MN_OK)
            return code;
        *fits = end - row->simplex_start <= plan->simplices_max;
        if (!*fits)
            return MN_OK; /* rare: such a node is filled in where references are counted */
        mni_plan_record(plan, at, row, end, place.position, &record);
        mni_tally_node(tally, &record);
        for (uint32_t s = row->simplex_start; s < end; s++)
            mni_tally_simplex(tally, run->simplex[s - run->simplex_first].corner);
        if ((at - lo) % TEST_EVERY == 0 && mni_tally_bytes(tally, 0) > limit) { /* it only grows */
            *fits = false;
            return MN_OK;
        }
    }
    *fits = mni_tally_bytes(tally, 0) <= limit;
    bool deep = false;
    if (*fits && root->nodes >= MNI_BLOCK_DEPTH_MAX)
        code = too_deep(plan, root, run, &deep);
    *fits = *fits && !deep;
    return code;
}

/* ---- the bytes ------------------------------------------------------------------------------- */

static mn_code encode_simplices(mni_plan *plan, uint32_t at, const mni_row *row, uint32_t end,
                                const mni_rows_run *run, mni_encoder *encoder) {
    if (row->simplex_start < run->simplex_first || end > run->simplex_end)
        return mn_fail(plan->st, MN_BAD_INPUT, "row %u: simplices [%u, %u) in [%u, %u)", at,
                       row->simplex_start, end, run->simplex_first, run->simplex_end);
    for (uint32_t s = row->simplex_start; s < end; s++) {
        const mni_row_simplex *simplex = &run->simplex[s - run->simplex_first];
        mn_code code = mni_row_check_simplex(&plan->limits, at, row, simplex, plan->st);
        if (code != MN_OK)
            return code;
        mni_encoder_simplex(encoder, simplex->corner);
        *(simplex->corner[2] == MN_NONE ? &plan->found.hinges : &plan->found.triangles) += 1;
    }
    return MN_OK;
}

static mn_code encode_node(mni_plan *plan, const waiting *from, const mni_rows_run *run,
                           mni_encoder *encoder) {
    const mni_row *row = &run->row[from->at - run->first];
    uint32_t end = simplices_end(run, from->at), at = from->at;
    mni_place place = {from->lo, from->hi, {0}};
    memcpy(place.position, from->position, sizeof place.position);
    mn_code code = mni_row_safe(&plan->limits, at, row, end, &place, from->order_below, plan->st);
    if (code != MN_OK)
        return code;
    code =
        mni_row_check(&plan->limits, at, row, from->position,
                      row->left == MN_NONE ? NULL : &run->row[row->left - run->first],
                      row->right == MN_NONE ? NULL : &run->row[row->right - run->first], plan->st);
    if (code != MN_OK)
        return code;
    mni_node record;
    mni_plan_record(plan, at, row, end, from->position, &record);
    if (row->left != MN_NONE) {
        record.left.kind = MNI_CHILD_INNER;
        record.left.node = encoder->nodes + 1;
    }
    if (row->right != MN_NONE) {
        record.right.kind = MNI_CHILD_INNER;
        record.right.node = encoder->nodes + (at - from->lo);
    }
    mni_encoder_node(encoder, &record);
    mni_found_leaf(&plan->found, at, row->position);
    mni_found_node(&plan->found, row->order, from->depth);
    return encode_simplices(plan, at, row, end, run, encoder);
}

static mn_code encode_subtree(mni_plan *plan, const mni_exit *root, mni_rows_run *run,
                              mni_encoder *encoder) {
    waiting stack[MNI_BLOCK_DEPTH_MAX + 2];
    uint32_t waits = 0;
    bool fits;
    mn_code code = fill_run(plan, root, run, &fits);
    if (code == MN_OK && !fits)
        code = mn_fail(plan->st, MN_FAILED, "the tree has changed while it was read");
    stack[waits] = (waiting){root->row,       root->leaf_lo, root->leaf_lo + root->nodes + 1,
                             root->order + 1, root->depth,   {0}};
    memcpy(stack[waits++].position, root->position, sizeof root->position);
    while (waits > 0 && code == MN_OK) {
        const waiting from = stack[--waits];
        code = encode_node(plan, &from, run, encoder);
        if (code != MN_OK)
            break;
        const mni_row *row = &run->row[from.at - run->first];
        MN_ASSERT(waits < MNI_BLOCK_DEPTH_MAX);
        if (row->right != MN_NONE) {
            waiting right = {row->right, from.at, from.hi, row->order, from.depth + 1, {0}};
            memcpy(right.position, row->position, sizeof right.position);
            stack[waits++] = right;
        }
        if (row->left != MN_NONE) {
            waiting left = {row->left, from.lo, from.at, row->order, from.depth + 1, {0}};
            memcpy(left.position, from.position, sizeof left.position);
            stack[waits++] = left;
        }
    }
    return code;
}

mn_code mni_whole_encode(mni_plan *plan, const mni_exit *root, uint32_t roots,
                         const mni_tally *tally, mni_rows_run *run, void *bytes,
                         uint32_t length_bytes) {
    mni_encoder encoder;
    uint32_t index = 0;
    mni_encoder_begin(&encoder, bytes, length_bytes, tally, 0);
    for (uint32_t r = 0; r < roots; r++) {
        const mni_exit *x = &root[r];
        mni_encoder_subtree(&encoder, &(mni_subtree){index, x->leaf_lo, x->leaf_lo + x->nodes + 1});
        index += x->nodes;
    }
    for (uint32_t r = 0; r < roots; r++) {
        mn_code code = encode_subtree(plan, &root[r], run, &encoder);
        if (code != MN_OK)
            return code;
    }
    mni_encoder_end(&encoder);
    return MN_OK;
}
