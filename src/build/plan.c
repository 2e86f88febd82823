/* The plan of blocks: what both policies share.
 *
 * Hides: how blocks, roots and numberings are kept. Order: open, one policy, then block_write.c
 * reads it, close. One thread. Memory: 8 bytes an inner node, 60 a block, 12 a subtree, and a list
 * of one block's nodes. Paper: §3.2. */
#include "plan.h"

#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "header.h"

enum { SIMPLEX_BYTES_MAX = 13 }; /* three numbers of 32 bits, and one of 1 */

mn_code mni_plan_open(mni_plan *plan, const mn_tree *tree, const mn_block_desc *desc,
                      mn_status *st) {
    memset(plan, 0, sizeof *plan);
    plan->tree = tree;
    plan->desc = desc;
    bool packed = desc->blocking == MN_BLOCKING_PACKED;
    plan->overflow_bytes = packed ? desc->block_bytes : MNI_MNT_OVERFLOW_BYTES;
    /* half a packed block: the node itself, its subtree's record and the head fit in the rest */
    plan->simplices_max =
        (packed ? desc->block_bytes / 2 : MNI_MNT_OVERFLOW_BYTES) / SIMPLEX_BYTES_MAX;
    plan->block_of = malloc(sizeof *plan->block_of * tree->inner);
    plan->index = malloc(sizeof *plan->index * tree->inner);
    plan->list = malloc(sizeof *plan->list * MNI_BLOCK_NODES_MAX);
    if (plan->block_of == NULL || plan->index == NULL || plan->list == NULL)
        return mn_fail(st, MN_FAILED, "no memory for the plan of %u nodes", tree->inner);
    memset(plan->block_of, 0xff, sizeof *plan->block_of * tree->inner);
    return MN_OK;
}

void mni_plan_close(mni_plan *plan) {
    free(plan->block_of);
    free(plan->index);
    free(plan->list);
    free(plan->block);
    free(plan->root);
    memset(plan, 0, sizeof *plan);
}

/* Room for one more of `size` bytes. */
static mn_code grow(void **array, uint32_t used, uint32_t *capacity, size_t size, mn_status *st) {
    if (used < *capacity)
        return MN_OK;
    uint32_t wanted = *capacity < 64 ? 64 : *capacity + *capacity / 2;
    void *bigger = wanted > *capacity ? realloc(*array, wanted * size) : NULL;
    if (bigger == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a plan of %u blocks", wanted);
    *array = bigger;
    *capacity = wanted;
    return MN_OK;
}

mn_code mni_plan_block(mni_plan *plan, uint32_t parent, uint32_t *block, mn_status *st) {
    mn_code code =
        grow((void **)&plan->block, plan->blocks, &plan->blocks_capacity, sizeof *plan->block, st);
    if (code != MN_OK)
        return code;
    *block = plan->blocks++;
    plan->block[*block] =
        (mni_planned){.parent = parent,
                      .depth = parent == MN_NONE ? 1 : plan->block[parent].depth + 1,
                      .root_first = plan->roots};
    return MN_OK;
}

mn_code mni_plan_root_add(mni_plan *plan, mni_plan_root root, mn_status *st) {
    mn_code code =
        grow((void **)&plan->root, plan->roots, &plan->roots_capacity, sizeof *plan->root, st);
    if (code != MN_OK)
        return code;
    plan->root[plan->roots++] = root;
    plan->block[plan->blocks - 1].root_count++;
    return MN_OK;
}

uint32_t mni_plan_child(const mn_tree *tree, uint32_t node, uint32_t side) {
    uint32_t order = side == 0 ? tree->left[node] : tree->right[node];
    return order < tree->leaves ? MN_NONE : order - tree->leaves;
}

void mni_plan_list(mni_plan *plan, uint32_t block) {
    const mni_planned *b = &plan->block[block];
    uint32_t stack[MNI_BLOCK_DEPTH_MAX + 1];
    plan->listed = 0;
    for (uint32_t r = 0; r < b->root_count; r++) {
        uint32_t waiting = 0;
        stack[waiting++] = plan->root[b->root_first + r].node;
        while (waiting > 0) {
            uint32_t node = stack[--waiting];
            MN_ASSERT(plan->listed < MNI_BLOCK_NODES_MAX && plan->block_of[node] == block);
            plan->index[node] = plan->listed;
            plan->list[plan->listed++] = node;
            for (uint32_t side = 2; side-- > 0;) { /* the left one on top */
                uint32_t child = mni_plan_child(plan->tree, node, side);
                if (child != MN_NONE && plan->block_of[child] == block) {
                    MN_ASSERT(waiting <= MNI_BLOCK_DEPTH_MAX);
                    stack[waiting++] = child;
                }
            }
        }
    }
    plan->block[block].nodes = plan->listed;
}

uint32_t mni_plan_simplices(const mni_plan *plan, uint32_t node) {
    uint32_t count = plan->tree->simplex_start[node + 1] - plan->tree->simplex_start[node];
    return count < plan->simplices_max ? count : plan->simplices_max;
}

void mni_plan_simplex(const mn_tree *tree, uint32_t node, uint32_t s, uint32_t corner[3]) {
    const uint32_t *c = tree->corner + 3 * (size_t)s;
    uint32_t outside = 2;
    for (uint32_t i = 0; i < 3; i++)
        if (c[i] < tree->leaf_lo[node] || c[i] >= tree->leaf_hi[node])
            outside = i;
    for (uint32_t i = 0; i < 3; i++)
        corner[i] = c[(outside + 1 + i) % 3];
}

static mn_code add_overflow(mni_plan *plan, uint32_t parent, uint32_t node, uint32_t simplex_first,
                            uint32_t *made, mn_status *st) {
    mn_code code = mni_plan_block(plan, parent, made, st);
    if (code != MN_OK)
        return code;
    mni_planned *b = &plan->block[*made];
    b->is_overflow = true;
    b->depth = plan->block[parent].depth;
    b->node = node;
    b->simplex_first = simplex_first;
    b->simplices = plan->tree->simplex_start[node + 1] - simplex_first;
    return MN_OK;
}

mni_overflow mni_plan_overflow_head(const mn_tree *tree, uint32_t node) {
    return (mni_overflow){.order = tree->leaves + node,
                          .leaf_lo = tree->leaf_lo[node],
                          .leaf_mid = tree->leaf_mid[node],
                          .leaf_hi = tree->leaf_hi[node]};
}

/* Cuts a new overflow block to its length, and makes the blocks that take the rest. */
static mn_code cut_overflow(mni_plan *plan, uint32_t at, mn_status *st) {
    const mn_tree *tree = plan->tree;
    uint32_t length = 1;
    for (;; length++) {
        mni_planned b = plan->block[at];
        uint32_t *corner = malloc(3 * sizeof *corner * b.simplices);
        if (corner == NULL)
            return mn_fail(st, MN_FAILED, "no memory for %u simplices", b.simplices);
        for (uint32_t i = 0; i < b.simplices; i++)
            mni_plan_simplex(tree, b.node, b.simplex_first + i, corner + 3 * (size_t)i);
        const mni_overflow head = mni_plan_overflow_head(tree, b.node);
        uint32_t fit = mni_overflow_fit(&head, corner, b.simplices, plan->overflow_bytes);
        plan->block[at].simplices = fit;
        plan->block[at].payload_bytes =
            mni_overflow_bytes(&head, corner, fit, fit < b.simplices ? 1 : 0);
        free(corner);
        if (fit == b.simplices)
            break;
        uint32_t next;
        mn_code code = add_overflow(plan, at, b.node, b.simplex_first + fit, &next, st);
        if (code != MN_OK)
            return code;
        plan->block[at].child_first = next;
        plan->block[at].child_count = 1;
        at = next;
    }
    if (length > plan->overflow_max)
        plan->overflow_max = length;
    return MN_OK;
}

mn_code mni_plan_overflow(mni_plan *plan, uint32_t block, mn_status *st) {
    uint32_t first = plan->blocks, made;
    mn_code code = MN_OK;
    for (uint32_t i = 0; i < plan->listed && code == MN_OK; i++) {
        uint32_t node = plan->list[i];
        if (plan->tree->simplex_start[node + 1] - plan->tree->simplex_start[node] >
            plan->simplices_max)
            code = add_overflow(plan, block, node,
                                plan->tree->simplex_start[node] + plan->simplices_max, &made, st);
    }
    uint32_t last = plan->blocks;
    plan->block[block].child_count += last - first;
    for (uint32_t at = first; at < last && code == MN_OK; at++)
        code = cut_overflow(plan, at, st);
    return code;
}

static mni_facts facts_of(const mn_tree *tree, uint32_t node) {
    return (mni_facts){tree->leaves + node, tree->switch_value[node], tree->radius[node],
                       tree->cone[node]};
}

static mni_child child_of(const mni_plan *plan, uint32_t node, uint32_t side) {
    uint32_t child = mni_plan_child(plan->tree, node, side);
    mni_child out = {.kind = MNI_CHILD_LEAF, .node = MN_NONE, .ref = MN_NONE};
    if (child == MN_NONE)
        return out;
    out.facts = facts_of(plan->tree, child);
    if (plan->block_of[child] == plan->block_of[node] && plan->block_of[node] != MN_NONE) {
        out.kind = MNI_CHILD_INNER;
        out.node = plan->index[child];
    } else {
        out.kind = MNI_CHILD_SUBTREE;
    }
    return out;
}

void mni_plan_leaf(const mn_tree *tree, uint32_t leaf, float position[3], uint32_t *color) {
    memcpy(position, tree->leaf_position + 3 * (size_t)leaf, 3 * sizeof *position);
    *color = tree->leaf_color != NULL ? tree->leaf_color[leaf] : UINT32_MAX;
}

void mni_plan_node(const mni_plan *plan, uint32_t node, mni_node *out) {
    const mn_tree *tree = plan->tree;
    uint32_t all = tree->simplex_start[node + 1] - tree->simplex_start[node];
    *out = (mni_node){.at = {tree->leaf_lo[node], tree->leaf_hi[node], {0}},
                      .facts = facts_of(tree, node),
                      .leaf_mid = tree->leaf_mid[node],
                      .left = child_of(plan, node, 0),
                      .right = child_of(plan, node, 1),
                      .simplex_count = mni_plan_simplices(plan, node),
                      .overflow_ref = all > plan->simplices_max ? 0 : MN_NONE};
    uint32_t color; /* its parent's business */
    mni_plan_leaf(tree, out->at.leaf_lo, out->at.position, &color);
    mni_plan_leaf(tree, out->leaf_mid, out->right_position, &out->right_color);
}

void mni_plan_subtree(const mni_plan *plan, const mni_plan_root *root, mni_subtree *out) {
    const mn_tree *tree = plan->tree;
    *out = (mni_subtree){.node = plan->index[root->node],
                         .leaf_lo = tree->leaf_lo[root->node],
                         .leaf_hi = tree->leaf_hi[root->node]};
}

void mni_plan_tally(mni_plan *plan, uint32_t block, mni_tally *tally) {
    const mni_planned *b = &plan->block[block];
    mni_tally_init(tally, plan->tree->leaf_color != NULL, plan->tree->grid_step);
    for (uint32_t r = 0; r < b->root_count; r++) {
        mni_subtree subtree;
        mni_plan_subtree(plan, &plan->root[b->root_first + r], &subtree);
        mni_tally_subtree(tally, &subtree);
    }
    for (uint32_t i = 0; i < plan->listed; i++) {
        uint32_t corner[3], node = plan->list[i];
        mni_node record;
        mni_plan_node(plan, node, &record);
        mni_tally_node(tally, &record);
        for (uint32_t s = 0; s < record.simplex_count; s++) {
            mni_plan_simplex(plan->tree, node, plan->tree->simplex_start[node] + s, corner);
            mni_tally_simplex(tally, corner);
        }
    }
}
