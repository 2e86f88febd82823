/* Policy `levels`: a block is the top L levels of one subtree, the paper's meta-node (Figure 4).
 *
 *        o          block: root and L - 1 levels below it
 *       / \
 *      o   o
 *     /|   |\       exits: each the root of a block of its own
 *
 * Hides: nothing but the cut. A block's length is known only when its nodes have been looked at, so
 * each is drafted twice: when its parent's references are written, and to be written itself.
 * Order: the roots, then each block after its parent. One thread; no memory of its own. Paper:
 * §3.2. */
#include "plan.h"

/* The top levels below the only root. */
static mn_code draft_levels(mni_plan *plan, const mni_exit *root, mni_draft *draft,
                            mni_tally *tally) {
    mn_code code = mni_draft_begin(plan, draft, root, 1);
    mni_tally_init(tally, plan->limits.has_colors, plan->limits.grid_step);
    uint32_t top = code == MN_OK ? draft->known[0].depth : 0;
    /* children come to be known after their parents */
    for (uint32_t k = 0; code == MN_OK && k < draft->knowns; k++) {
        if (draft->known[k].depth - top >= plan->desc->l)
            continue;
        draft->known[k].taken = MNI_BLOCK_TAKES;
        code = k == 0 ? mni_draft_tally_root(plan, draft, k, tally)
                      : mni_draft_tally(plan, draft, k, tally);
        tally->exits -= k > 0; /* it was one */
    }
    return code == MN_OK ? mni_draft_list(plan, draft) : code;
}

/* With a reference for each exit and each node that overflows. */
static mn_code payload_bytes(mni_plan *plan, const mni_draft *draft, const mni_tally *tally,
                             uint32_t *bytes) {
    uint64_t refs = tally->exits;
    for (uint32_t i = 0; i < draft->listed; i++)
        refs += mni_draft_overflows(plan, &draft->known[draft->list[i]]);
    uint64_t all = mni_tally_bytes(tally, (uint32_t)refs);
    if (all > UINT32_MAX / 2)
        return mn_fail(plan->st, MN_USAGE, "a block of %u levels would take %llu bytes: lower -L",
                       plan->desc->l, (unsigned long long)all);
    *bytes = (uint32_t)all;
    return MN_OK;
}

mn_code mni_levels_runs(mni_plan *plan, mni_family *family, mni_draft *scratch) {
    mn_code code = MN_OK;
    if (!mni_plan_room((void **)&family->run, family->exits, &family->runs_capacity,
                       sizeof *family->run))
        return mni_plan_trouble(plan, "the exits of a block");
    family->runs = family->exits;
    for (uint32_t e = 0; e < family->exits && code == MN_OK; e++) {
        mni_tally tally;
        family->run[e] = (mni_run){.first = e, .next = e + 1};
        code = draft_levels(plan, &family->exit[e], scratch, &tally);
        if (code == MN_OK)
            code = payload_bytes(plan, scratch, &tally, &family->run[e].payload_bytes);
    }
    return code;
}

mn_code mni_levels_block(mni_plan *plan, const mni_exit *root, mni_draft *draft, mni_draft *scratch,
                         mni_family *family, mni_tally *tally) {
    mn_code code = draft_levels(plan, root, draft, tally);
    if (code == MN_OK)
        code = mni_draft_exits(plan, draft, &(mni_exit){.known = 0}, 1, MNI_BLOCK_TAKES, family);
    return code == MN_OK ? mni_levels_runs(plan, family, scratch) : code;
}
