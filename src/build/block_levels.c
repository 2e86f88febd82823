/* Policy `levels`: a block is the top L levels of one subtree, the paper's meta-node (Figure 4).
 *
 *        o          block: root and L - 1 levels below it
 *       / \
 *      o   o
 *     /|   |\       exits: each the root of a block of its own
 *
 * Hides: nothing but the cut. Order: one call on an open plan. One thread; no memory of its own.
 * Paper: §3.2. */
#include "assert.h"
#include "plan.h"

/* Marks the top l levels below root as the block's. */
static void take_levels(mni_plan *plan, uint32_t block, uint32_t root, uint32_t l) {
    struct {
        uint32_t node, level;
    } stack[32];
    uint32_t waiting = 0;
    stack[waiting].node = root;
    stack[waiting++].level = 1;
    while (waiting > 0) {
        uint32_t node = stack[--waiting].node, level = stack[waiting].level;
        plan->block_of[node] = block;
        for (uint32_t side = 0; side < 2 && level < l; side++) {
            uint32_t child = mni_plan_child(plan->tree, node, side);
            if (child != MN_NONE) {
                MN_ASSERT(waiting < 32);
                stack[waiting].node = child;
                stack[waiting++].level = level + 1;
            }
        }
    }
}

/* A block of its own for each exit of the listed block. */
static mn_code plan_exits(mni_plan *plan, uint32_t block, mn_status *st) {
    mn_code code = MN_OK;
    plan->block[block].child_first = plan->blocks;
    for (uint32_t i = 0; i < plan->listed; i++)
        for (uint32_t side = 0; side < 2 && code == MN_OK; side++) {
            uint32_t child = mni_plan_child(plan->tree, plan->list[i], side), made;
            if (child == MN_NONE || plan->block_of[child] != MN_NONE)
                continue;
            code = mni_plan_block(plan, block, &made, st);
            if (code == MN_OK)
                code =
                    mni_plan_root_add(plan, (mni_plan_root){child, plan->tree->leaf_lo[child]}, st);
        }
    plan->block[block].child_count = plan->blocks - plan->block[block].child_first;
    return code;
}

mn_code mni_plan_levels(mni_plan *plan, mn_status *st) {
    const mn_tree *tree = plan->tree;
    mn_code code = MN_OK;
    uint32_t placed = 0, made;
    for (uint32_t r = 0; r < tree->roots && code == MN_OK; r++) {
        uint32_t root = tree->root[r] - tree->leaves;
        code = mni_plan_block(plan, MN_NONE, &made, st);
        if (code == MN_OK)
            code = mni_plan_root_add(plan, (mni_plan_root){root, tree->leaf_lo[root]}, st);
    }
    for (uint32_t b = 0; b < plan->blocks && code == MN_OK; b++) {
        if (plan->block[b].is_overflow)
            continue;
        take_levels(plan, b, plan->root[plan->block[b].root_first].node, plan->desc->l);
        mni_plan_list(plan, b);
        code = plan_exits(plan, b, st);
        if (code == MN_OK)
            code = mni_plan_overflow(plan, b, st);
        if (code != MN_OK)
            break;
        mni_tally tally;
        mni_plan_tally(plan, b, &tally);
        uint64_t bytes = mni_tally_bytes(&tally, plan->block[b].child_count);
        if (bytes > UINT32_MAX / 2)
            return mn_fail(st, MN_USAGE, "a block of %u levels would take %llu bytes: lower -L",
                           plan->desc->l, (unsigned long long)bytes);
        plan->block[b].payload_bytes = (uint32_t)bytes;
        placed += plan->listed;
        if (plan->desc->progress != NULL && b % 256 == 0 &&
            !plan->desc->progress(plan->desc->progress_context, "blocking", placed, tree->inner))
            return mn_fail(st, MN_FAILED, "interrupted");
    }
    return code;
}
