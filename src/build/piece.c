/* Overflow blocks: the simplices of one node that its own block has no room for, in pieces.
 *
 * Hides: where a chain is cut. Order: cut from the first simplex that overflows on, then encode.
 * One thread a plan. Memory: the caller's, for the simplices of one block. Paper: §3.2. */
#include "plan.h"

#include "mn_assert.h"

/* A simplex of less than a byte would have its corners in an interval of a few leaves: then there
 * are doubles, and more of them than that are cut. */
uint32_t mni_piece_most(const mni_plan *plan) {
    return plan->overflow_bytes;
}

static mni_overflow head_of(const mni_known *node) {
    return (mni_overflow){.order = node->row.order,
                          .leaf_lo = node->row.leaf_lo,
                          .leaf_mid = node->at,
                          .leaf_hi = node->row.leaf_hi};
}

/* NULL: trouble, told to the plan's status. */
static const uint32_t *read_corners(mni_plan *plan, const mni_known *node, uint32_t first,
                                    uint32_t count, mni_row_simplex *room) {
    const mni_row_simplex *simplex = mni_rows_simplices(plan->rows, first, count, room);
    if (simplex == NULL)
        mni_plan_trouble(plan, "simplices of a node");
    for (uint32_t s = 0; simplex != NULL && s < count; s++)
        if (mni_row_check_simplex(&plan->limits, node->at, &node->row, &simplex[s], plan->st) !=
            MN_OK)
            return NULL;
    return simplex != NULL ? simplex->corner : NULL;
}

mn_code mni_piece_cut(mni_plan *plan, const mni_known *node, uint32_t first, mni_row_simplex *room,
                      mni_piece *piece) {
    uint32_t left = node->simplex_end - first, most = mni_piece_most(plan);
    uint32_t count = left < most ? left : most;
    const mni_overflow head = head_of(node);
    const uint32_t *corner = read_corners(plan, node, first, count, room);
    if (corner == NULL)
        return plan->st->code;
    uint32_t fit = mni_overflow_fit(&head, corner, count, plan->overflow_bytes);
    bool last = fit == left;
    *piece = (mni_piece){.first = first, .count = fit, .last = last};
    piece->payload_bytes = mni_overflow_bytes(&head, corner, fit, last ? 0 : 1);
    return MN_OK;
}

mn_code mni_piece_encode(mni_plan *plan, const mni_known *node, const mni_piece *piece,
                         mni_row_simplex *room, void *bytes, uint32_t length_bytes) {
    const mni_overflow head = head_of(node);
    const uint32_t *corner = read_corners(plan, node, piece->first, piece->count, room);
    if (corner == NULL)
        return plan->st->code;
    for (uint32_t s = 0; s < piece->count; s++)
        *(corner[3 * (size_t)s + 2] == MN_NONE ? &plan->found.hinges : &plan->found.triangles) += 1;
    uint32_t end =
        mni_overflow_encode(bytes, length_bytes, piece->last ? 0 : 1, &head, corner, piece->count);
    MN_ASSERT(end == piece->payload_bytes);
    return MN_OK;
}
