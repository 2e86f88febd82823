/* The nodes of one block, copied from their rows while it is being made.
 *
 * Hides: which nodes are known, and their numbering. What has been looked at once, for the block or
 * for a trial below it, stays known, and what it takes as well.
 * Order: begin; tally, take (the policy sets `taken`); list; exits; encode. One thread a draft.
 * Memory: 300 bytes a node that is known: those of the block, their children, and what trials have
 * looked at. Paper: §3.2. */
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "plan.h"

void mni_draft_free(mni_draft *draft) {
    free(draft->known);
    free(draft->list);
    memset(draft, 0, sizeof *draft);
}

static mn_code no_room(mni_plan *plan) {
    return mni_plan_trouble(plan, "the nodes of a block");
}

/* ---- nodes come to be known ------------------------------------------------------------------ */

/* At the end of the draft, which has room. */
static mn_code know(mni_plan *plan, mni_draft *draft, const mni_known *made, const mni_place *place,
                    uint32_t order_below) {
    mn_code code = mni_row_safe(&plan->limits, made->at, &made->row, made->simplex_end, place,
                                order_below, plan->st);
    if (code == MN_OK)
        draft->known[draft->knowns++] = *made;
    return code;
}

static mn_code know_child(mni_plan *plan, mni_draft *draft, uint32_t parent, uint32_t side) {
    const mni_known *p = &draft->known[parent];
    uint32_t lo = side == 0 ? p->row.leaf_lo : p->at, hi = side == 0 ? p->at : p->row.leaf_hi;
    mni_known made = {.at = side == 0 ? p->row.left : p->row.right, .depth = p->depth + 1};
    if (made.at == MN_NONE)
        return MN_OK;
    memcpy(made.position, side == 0 ? p->position : p->row.position, sizeof made.position);
    mni_place place = {lo, hi, {made.position[0], made.position[1], made.position[2]}};
    if (!mni_rows_near_get(&plan->near, made.at, &made.row, &made.simplex_end))
        return no_room(plan);
    draft->known[parent].child[side] = draft->knowns;
    return know(plan, draft, &made, &place, p->row.order);
}

mn_code mni_draft_expand(mni_plan *plan, mni_draft *draft, uint32_t known) {
    if (draft->known[known].expanded)
        return MN_OK;
    if (!mni_plan_room((void **)&draft->known, draft->knowns + 2, &draft->knowns_capacity,
                       sizeof *draft->known))
        return no_room(plan);
    draft->known[known].expanded = true;
    draft->known[known].child[0] = draft->known[known].child[1] = MN_NONE;
    mn_code code = know_child(plan, draft, known, 0);
    return code == MN_OK ? know_child(plan, draft, known, 1) : code;
}

mn_code mni_draft_begin(mni_plan *plan, mni_draft *draft, const mni_exit *root, uint32_t roots) {
    draft->knowns = draft->listed = 0;
    draft->roots = roots;
    if (!mni_plan_room((void **)&draft->known, roots, &draft->knowns_capacity,
                       sizeof *draft->known))
        return no_room(plan);
    for (uint32_t r = 0; r < roots; r++) {
        const mni_exit *x = &root[r];
        mni_known made = {.at = x->row, .depth = x->depth};
        memcpy(made.position, x->position, sizeof made.position);
        mni_place place = {x->leaf_lo, x->leaf_lo + x->nodes + 1, {0}};
        memcpy(place.position, x->position, sizeof place.position);
        if (!mni_rows_near_get(&plan->near, x->row, &made.row, &made.simplex_end))
            return no_room(plan);
        mn_code code = know(plan, draft, &made, &place, x->order + 1);
        if (code != MN_OK)
            return code;
    }
    return MN_OK;
}

void mni_draft_forget(mni_draft *draft, uint32_t knowns) {
    draft->knowns = knowns;
    for (uint32_t k = 0; k < knowns; k++) {
        mni_known *known = &draft->known[k];
        for (uint32_t side = 0; side < 2 && known->expanded; side++)
            if (known->child[side] != MN_NONE && known->child[side] >= knowns)
                known->expanded = false;
    }
}

/* ---- what they take -------------------------------------------------------------------------- */

/* Those of a node that its own block has. NULL: a read that failed. */
static const mni_row_simplex *simplices_of(mni_plan *plan, const mni_known *k, uint32_t count) {
    return mni_rows_near_simplices(&plan->near, k->row.simplex_start, count, plan->simplex_room);
}

static mni_child exit_of(const mni_draft *draft, uint32_t child) {
    if (child == MN_NONE)
        return (mni_child){.kind = MNI_CHILD_LEAF, .node = MN_NONE, .ref = MN_NONE};
    const mni_known *k = &draft->known[child];
    return (mni_child){.kind = MNI_CHILD_SUBTREE,
                       .node = MN_NONE,
                       .ref = k->ref,
                       .subtree = k->subtree,
                       .facts = mni_plan_facts(&k->row)};
}

/* Adds a node that is not small, or makes a part of it. */
static mn_code measure(mni_plan *plan, mni_draft *draft, uint32_t known, mni_tally *tally) {
    mni_known *k = &draft->known[known];
    mni_node record;
    mni_plan_record(plan, k->at, &k->row, k->simplex_end, k->position, &record);
    record.left = exit_of(draft, k->child[0]);
    record.right = exit_of(draft, k->child[1]);
    const mni_row_simplex *simplex = simplices_of(plan, k, record.simplex_count);
    if (simplex == NULL)
        return no_room(plan);
    k->measured = mni_tally_part_of(&k->part, &record, simplex->corner, plan->limits.has_colors,
                                    plan->limits.grid_step);
    if (k->measured)
        return MN_OK;
    mni_tally_node(tally, &record);
    for (uint32_t s = 0; s < record.simplex_count; s++)
        mni_tally_simplex(tally, simplex[s].corner);
    return MN_OK;
}

mn_code mni_draft_tally(mni_plan *plan, mni_draft *draft, uint32_t known, mni_tally *tally) {
    mn_code code = mni_draft_expand(plan, draft, known);
    if (code == MN_OK && !draft->known[known].measured)
        code = measure(plan, draft, known, tally);
    if (code == MN_OK && draft->known[known].measured)
        mni_tally_add(tally, &draft->known[known].part);
    return code;
}

mn_code mni_draft_tally_root(mni_plan *plan, mni_draft *draft, uint32_t known, mni_tally *tally) {
    const mni_row *row = &draft->known[known].row;
    const mni_subtree subtree = {.leaf_lo = row->leaf_lo, .leaf_hi = row->leaf_hi};
    mni_tally_subtree(tally, &subtree);
    return mni_draft_tally(plan, draft, known, tally);
}

/* ---- numbering ------------------------------------------------------------------------------- */

mn_code mni_draft_list(mni_plan *plan, mni_draft *draft) {
    uint32_t stack[MNI_BLOCK_DEPTH_MAX + 1];
    draft->listed = 0;
    if (!mni_plan_room((void **)&draft->list, draft->knowns, &draft->list_capacity,
                       sizeof *draft->list))
        return no_room(plan);
    for (uint32_t r = 0; r < draft->roots; r++) {
        uint32_t waiting = 0;
        stack[waiting++] = r;
        while (waiting > 0) {
            uint32_t at = stack[--waiting];
            mni_known *k = &draft->known[at];
            MN_ASSERT(draft->listed < MNI_BLOCK_NODES_MAX && k->expanded);
            k->index = draft->listed;
            draft->list[draft->listed++] = at;
            for (uint32_t side = 2; side-- > 0;) { /* the left one on top */
                uint32_t child = k->child[side];
                if (child != MN_NONE && draft->known[child].taken == MNI_BLOCK_TAKES) {
                    MN_ASSERT(waiting <= MNI_BLOCK_DEPTH_MAX);
                    stack[waiting++] = child;
                }
            }
        }
    }
    return MN_OK;
}

static void add_exit(const mni_draft *draft, uint32_t known, mni_family *family) {
    const mni_known *k = &draft->known[known];
    mni_exit *x = &family->exit[family->exits++];
    *x = (mni_exit){.row = k->at,
                    .leaf_lo = k->row.leaf_lo,
                    .nodes = k->row.leaf_hi - k->row.leaf_lo - 1,
                    .order = k->row.order,
                    .depth = k->depth,
                    .known = known};
    memcpy(x->position, k->position, sizeof x->position);
}

mn_code mni_draft_exits(mni_plan *plan, const mni_draft *draft, const mni_exit *root,
                        uint32_t roots, uint32_t takes, mni_family *family) {
    uint32_t stack[MNI_BLOCK_DEPTH_MAX + 2];
    family->exits = family->runs = 0;
    if (!mni_plan_room((void **)&family->exit, draft->knowns, &family->exits_capacity,
                       sizeof *family->exit))
        return no_room(plan);
    for (uint32_t r = 0; r < roots; r++) {
        uint32_t waiting = 0;
        stack[waiting++] = root[r].known;
        while (waiting > 0) {
            uint32_t at = stack[--waiting];
            const mni_known *k = &draft->known[at];
            if (k->taken != takes) {
                add_exit(draft, at, family);
                continue;
            }
            MN_ASSERT(waiting < MNI_BLOCK_DEPTH_MAX);
            for (uint32_t side = 2; side-- > 0;) /* the left one on top */
                if (k->child[side] != MN_NONE)
                    stack[waiting++] = k->child[side];
        }
    }
    return MN_OK;
}

bool mni_draft_copy_block(const mni_draft *from, mni_draft *to) {
    uint32_t most = 2 * from->listed + from->roots, n = from->roots;
    if (!mni_plan_room((void **)&to->known, most, &to->knowns_capacity, sizeof *to->known) ||
        !mni_plan_room((void **)&to->list, from->listed, &to->list_capacity, sizeof *to->list))
        return false;
    to->roots = from->roots;
    to->listed = from->listed;
    for (uint32_t i = 0; i < from->listed; i++) { /* roots stay the first */
        uint32_t at = from->list[i] < from->roots ? from->list[i] : n++;
        to->known[at] = from->known[from->list[i]];
        to->list[i] = at;
    }
    for (uint32_t i = 0; i < to->listed; i++)
        for (uint32_t side = 0; side < 2; side++) {
            uint32_t *child = &to->known[to->list[i]].child[side];
            const mni_known *k = &from->known[*child == MN_NONE ? 0 : *child];
            if (*child == MN_NONE)
                continue;
            *child = k->taken == MNI_BLOCK_TAKES ? to->list[k->index] : n;
            if (*child == n)
                to->known[n++] = *k;
        }
    MN_ASSERT(n <= most);
    to->knowns = n;
    return true;
}

/* ---- the bytes ------------------------------------------------------------------------------- */

static mni_child child_of(const mni_draft *draft, uint32_t child) {
    mni_child out = exit_of(draft, child);
    if (child != MN_NONE && draft->known[child].taken == MNI_BLOCK_TAKES) {
        out.kind = MNI_CHILD_INNER;
        out.node = draft->known[child].index;
    }
    return out;
}

static const mni_row *row_of(const mni_draft *draft, uint32_t child) {
    return child == MN_NONE ? NULL : &draft->known[child].row;
}

static mn_code encode_node(mni_plan *plan, const mni_draft *draft, const mni_known *k,
                           uint32_t overflow_ref, mni_encoder *encoder) {
    mni_node record;
    mn_code code = mni_row_check(&plan->limits, k->at, &k->row, k->position,
                                 row_of(draft, k->child[0]), row_of(draft, k->child[1]), plan->st);
    if (code != MN_OK)
        return code;
    mni_plan_record(plan, k->at, &k->row, k->simplex_end, k->position, &record);
    record.left = child_of(draft, k->child[0]);
    record.right = child_of(draft, k->child[1]);
    record.overflow_ref = overflow_ref;
    const mni_row_simplex *simplex = simplices_of(plan, k, record.simplex_count);
    if (simplex == NULL)
        return no_room(plan);
    mni_encoder_node(encoder, &record);
    for (uint32_t s = 0; s < record.simplex_count; s++) {
        code = mni_row_check_simplex(&plan->limits, k->at, &k->row, &simplex[s], plan->st);
        if (code != MN_OK)
            return code;
        mni_encoder_simplex(encoder, simplex[s].corner);
        *(simplex[s].corner[2] == MN_NONE ? &plan->found.hinges : &plan->found.triangles) += 1;
    }
    mni_found_leaf(&plan->found, k->at, k->row.position);
    mni_found_node(&plan->found, k->row.order, k->depth);
    return MN_OK;
}

mn_code mni_draft_encode(mni_plan *plan, const mni_draft *draft, const mni_tally *tally,
                         uint32_t refs, uint32_t first_overflow, void *bytes,
                         uint32_t length_bytes) {
    mni_encoder encoder;
    mni_encoder_begin(&encoder, bytes, length_bytes, tally, refs);
    for (uint32_t r = 0; r < draft->roots; r++) {
        const mni_known *k = &draft->known[r];
        mni_encoder_subtree(&encoder, &(mni_subtree){k->index, k->row.leaf_lo, k->row.leaf_hi});
    }
    for (uint32_t i = 0; i < draft->listed; i++) {
        const mni_known *k = &draft->known[draft->list[i]];
        uint32_t overflow = mni_draft_overflows(plan, k) ? first_overflow++ : MN_NONE;
        mn_code code = encode_node(plan, draft, k, overflow, &encoder);
        if (code != MN_OK)
            return code;
    }
    mni_encoder_end(&encoder);
    return MN_OK;
}
