/* What the making of any block needs: limits, memory, records.
 *
 * Hides: how long overflow blocks are and when a node needs them. Order: open, drafts and whole
 * subtrees, close. One thread a plan. Memory: the simplices of one node, some
 * pages of the tree. Paper: §3.2. */
#include "plan.h"

#include <stdlib.h>
#include <string.h>

#include "header.h"

enum { SIMPLEX_BYTES_MAX = 13 }; /* three numbers of 32 bits, and one of 1 */

mn_code mni_plan_open(mni_plan *plan, const mn_tree *head, mni_rows *rows,
                      const mn_block_desc *desc, mn_status *st) {
    bool packed = desc->blocking == MN_BLOCKING_PACKED;
    uint32_t overflow_bytes = packed ? desc->block_bytes : MNI_MNT_OVERFLOW_BYTES;
    *plan = (mni_plan){
        .rows = rows,
        .head = head,
        .desc = desc,
        .st = st,
        .limits = mni_row_limits_of(head, rows->source.has_colors),
        .overflow_bytes = overflow_bytes,
        /* half a packed block: the node, its subtree's record and the head fit in the rest */
        .simplices_max = (packed ? overflow_bytes / 2 : overflow_bytes) / SIMPLEX_BYTES_MAX};
    mni_found_none(&plan->found);
    plan->simplex_room = malloc(sizeof *plan->simplex_room * plan->simplices_max);
    return mni_rows_near_open(&plan->near, rows) && plan->simplex_room != NULL
               ? MN_OK
               : mni_plan_trouble(plan, "a plan of blocks");
}

void mni_plan_close(mni_plan *plan) {
    free(plan->simplex_room);
    mni_rows_near_close(&plan->near);
    memset(plan, 0, sizeof *plan);
}

mn_code mni_plan_trouble(mni_plan *plan, const char *what) {
    mn_code code = mni_rows_trouble(plan->rows, plan->st);
    return code != MN_OK ? code : mn_fail(plan->st, MN_FAILED, "no memory for %s", what);
}

bool mni_plan_room(void **array, uint32_t needed, uint32_t *capacity, size_t size) {
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

mni_facts mni_plan_facts(const mni_row *row) {
    return (mni_facts){row->order, row->switch_value, row->radius, row->cone};
}

void mni_plan_record(const mni_plan *plan, uint32_t at, const mni_row *row, uint32_t simplex_end,
                     const float position[3], mni_node *out) {
    uint32_t simplices = simplex_end - row->simplex_start;
    const mni_child leaf = {.kind = MNI_CHILD_LEAF, .node = MN_NONE, .ref = MN_NONE};
    bool over = simplices > plan->simplices_max;
    *out = (mni_node){
        .at = {row->leaf_lo, row->leaf_hi, {position[0], position[1], position[2]}},
        .facts = mni_plan_facts(row),
        .leaf_mid = at,
        .right_position = {row->position[0], row->position[1], row->position[2]},
        .right_color = row->rgba,
        .left = leaf,
        .right = leaf,
        .simplex_count = over ? plan->simplices_max : simplices,
        .overflow_ref = over ? 0 : MN_NONE,
    };
}

/* ---- roots ---------------------------------------------------------------------------------- */

static mn_code get(mni_plan *plan, uint32_t at, mni_row *row, uint32_t *simplex_end) {
    return mni_rows_near_get(&plan->near, at, row, simplex_end) ? MN_OK
                                                                : mni_plan_trouble(plan, "rows");
}

/* Nodes of the root that begins with leaf lo. */
static mn_code climb(mni_plan *plan, uint32_t lo, mni_exit *x) {
    mni_row_root root;
    mni_row row;
    uint32_t ignored;
    mn_code code = mni_row_root_of(plan->rows, &plan->limits, lo, &root, plan->st);
    if (code != MN_OK)
        return code;
    if (root.row == MN_NONE)
        return mn_fail(plan->st, MN_USAGE,
                       "the root of leaf %u is a single vertex: simplify to the end", lo);
    x->row = root.row;
    x->nodes = root.leaf_hi - lo - 1;
    x->order = root.order;
    code = get(plan, root.row, &row, &ignored);
    return code == MN_OK ? mni_row_check_values(&row, plan->st) : code;
}

mn_code mni_plan_roots(mni_plan *plan, mni_draft *draft, mni_family *roots) {
    const mn_tree *head = plan->head;
    if (!mni_plan_room((void **)&roots->exit, head->roots, &roots->exits_capacity,
                       sizeof *roots->exit))
        return mni_plan_trouble(plan, "roots");
    uint32_t lo = 0;
    for (roots->exits = 0; roots->exits < head->roots && lo < head->leaves; roots->exits++) {
        mni_exit *x = &roots->exit[roots->exits];
        mni_row first;
        uint32_t simplex_end;
        mn_code code = get(plan, lo, &first, &simplex_end);
        if (code == MN_OK)
            code = mni_row_check_first(&plan->limits, lo, &first, simplex_end, plan->st);
        if (code != MN_OK)
            return code;
        *x = (mni_exit){.leaf_lo = lo, .known = roots->exits};
        memcpy(x->position, first.position, sizeof x->position);
        code = climb(plan, lo, x);
        if (code != MN_OK)
            return code;
        mni_found_leaf(&plan->found, lo, first.position);
        lo += x->nodes + 1;
    }
    if (lo != head->leaves || roots->exits != head->roots)
        return mn_fail(plan->st, MN_BAD_INPUT, "%u roots hold %u of %u leaves, promised were %u",
                       roots->exits, lo, head->leaves, head->roots);
    return mni_draft_begin(plan, draft, roots->exit, roots->exits);
}
