/* From a tree to a .mnt: plan, order, encode, write.
 *
 * Hides: the order of blocks in the file. Parents come before children and the blocks that one
 * refers to stand side by side, so that what is prefetched together is read together; root blocks
 * come first:
 *
 *     header | roots | children of root 0 | children of its first child | …
 *
 * Order: mn_block_write alone. One thread; blocks on the disk. Memory: the plan (plan.c) and one
 * block. Every block passes the reader's own checks before it is written. Paper: §3.2. */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "assert.h"
#include "file.h"
#include "frame.h"
#include "header.h"
#include "plan.h"
#include "tree.h"

typedef struct writer {
    mni_plan plan;
    const mn_tree *tree;
    mn_header *header;
    mni_out out;
    uint32_t *order; /* planned blocks in file order */
    unsigned char *bytes;
} writer;

static double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- the order in the file ------------------------------------------------------------------ */

static uint32_t pages_of(const mni_planned *b) {
    return (b->payload_bytes + MNI_BLOCK_TAIL_BYTES + MN_PAGE_BYTES - 1) / MN_PAGE_BYTES;
}

static mn_code place_blocks(writer *w, mn_status *st) {
    mni_plan *plan = &w->plan;
    uint32_t *stack = malloc(sizeof *stack * plan->blocks);
    w->order = malloc(sizeof *w->order * plan->blocks);
    if (stack == NULL || w->order == NULL) {
        free(stack);
        return mn_fail(st, MN_FAILED, "no memory to order %u blocks", plan->blocks);
    }
    uint64_t page = 1;
    uint32_t placed = 0, waiting = 0, first = 0, count = 0;
    while (count < plan->blocks && plan->block[count].parent == MN_NONE)
        count++; /* the root blocks were planned first */
    for (;;) {
        for (uint32_t i = first; i < first + count; i++) {
            mni_planned *b = &plan->block[i];
            b->place = (mn_block_ref){(uint32_t)page, pages_of(b)};
            page += b->place.pages;
            w->order[placed++] = i;
        }
        for (uint32_t i = first + count; i-- > first;)
            if (plan->block[i].child_count > 0)
                stack[waiting++] = i;
        if (waiting == 0)
            break;
        uint32_t next = stack[--waiting];
        first = plan->block[next].child_first;
        count = plan->block[next].child_count;
    }
    free(stack);
    MN_ASSERT(placed == plan->blocks);
    if (page >= UINT32_MAX)
        return mn_fail(st, MN_FAILED, "the file would be larger than 16 TiB");
    w->header->file_bytes = page * MN_PAGE_BYTES;
    return MN_OK;
}

/* ---- the header ----------------------------------------------------------------------------- */

static void fill_root(const mn_tree *tree, uint32_t k, mn_block_ref block, uint32_t subtree,
                      mn_root *out) {
    *out = (mn_root){.block = block, .subtree = subtree};
    mni_plan_leaf(tree, tree->leaf_lo[tree->root[k] - tree->leaves], out->position, &out->color);
}

static void fill_header(writer *w) {
    const mn_tree *tree = w->tree;
    const mni_plan *plan = &w->plan;
    mn_header *h = w->header;
    h->version = MNI_MNT_VERSION;
    h->triangles = tree->triangles;
    h->leaves = tree->leaves;
    h->nodes = tree->leaves + tree->inner;
    h->hinges = tree->simplices - tree->triangles;
    h->legal_last = tree->legal_last;
    h->has_colors = tree->leaf_color != NULL;
    memcpy(h->origin, tree->origin, sizeof h->origin);
    h->grid_step = tree->grid_step;
    h->metric = tree->metric;
    h->blocking = plan->desc->blocking;
    h->l = h->blocking == MN_BLOCKING_LEVELS ? plan->desc->l : 0;
    h->block_bytes = h->blocking == MN_BLOCKING_PACKED ? plan->desc->block_bytes : 0;
    h->blocks = plan->blocks;
    h->overflow_max = plan->overflow_max;
    h->depth_max = tree->depth_max;
    h->roots = tree->roots;
    double payload = 0;
    for (uint32_t i = 0; i < plan->blocks; i++) {
        const mni_planned *b = &plan->block[i];
        uint32_t length = b->place.pages * MN_PAGE_BYTES;
        payload += b->payload_bytes;
        h->block_bytes_max = length > h->block_bytes_max ? length : h->block_bytes_max;
        h->block_depth = b->depth > h->block_depth ? b->depth : h->block_depth;
        h->children_max = b->child_count > h->children_max ? b->child_count : h->children_max;
        h->nodes_per_block_max =
            b->nodes > h->nodes_per_block_max ? b->nodes : h->nodes_per_block_max;
        for (uint32_t r = 0; b->parent == MN_NONE && r < b->root_count; r++)
            for (uint32_t k = 0; k < tree->roots; k++)
                if (tree->root[k] - tree->leaves == plan->root[b->root_first + r].node)
                    fill_root(tree, k, b->place, r, &h->root[k]);
    }
    h->fill_mean = payload / plan->blocks / h->block_bytes_max;
    mni_tree_shape(tree, h);
}

/* ---- the bytes ------------------------------------------------------------------------------ */

/* Which reference and subtree of `block` a child node is in. Roots stand by leaf_lo. */
static void find_exit(const writer *w, const mni_planned *block, uint32_t node, mni_child *child) {
    const mni_plan *plan = &w->plan;
    uint32_t at = plan->block_of[node];
    const mni_planned *b = &plan->block[at];
    uint32_t lo = 0, hi = b->root_count - 1;
    while (lo < hi) {
        uint32_t middle = (lo + hi) / 2;
        if (plan->root[b->root_first + middle].leaf_lo < w->tree->leaf_lo[node])
            lo = middle + 1;
        else
            hi = middle;
    }
    MN_ASSERT(plan->root[b->root_first + lo].node == node);
    child->ref = at - block->child_first;
    MN_ASSERT(child->ref < block->child_count);
    child->subtree = lo;
}

static void encode_metanode(writer *w, uint32_t index) {
    mni_plan *plan = &w->plan;
    const mni_planned *b = &plan->block[index];
    mni_tally tally;
    mni_encoder encoder;
    mni_plan_list(plan, index);
    mni_plan_tally(plan, index, &tally);
    MN_ASSERT(mni_tally_bytes(&tally, b->child_count) == b->payload_bytes);
    mni_encoder_begin(&encoder, w->bytes, b->place.pages * MN_PAGE_BYTES, &tally, b->child_count);
    for (uint32_t r = 0; r < b->root_count; r++) {
        mni_subtree subtree;
        mni_plan_subtree(plan, &plan->root[b->root_first + r], &subtree);
        mni_encoder_subtree(&encoder, &subtree);
    }
    uint32_t overflow = 0; /* their references follow those of the child blocks */
    while (overflow < b->child_count && !plan->block[b->child_first + overflow].is_overflow)
        overflow++;
    for (uint32_t i = 0; i < plan->listed; i++) {
        uint32_t node = plan->list[i], corner[3];
        mni_node record;
        mni_plan_node(plan, node, &record);
        if (record.left.kind == MNI_CHILD_SUBTREE)
            find_exit(w, b, mni_plan_child(w->tree, node, 0), &record.left);
        if (record.right.kind == MNI_CHILD_SUBTREE)
            find_exit(w, b, mni_plan_child(w->tree, node, 1), &record.right);
        if (record.overflow_ref != MN_NONE)
            record.overflow_ref = overflow++;
        mni_encoder_node(&encoder, &record);
        for (uint32_t s = 0; s < record.simplex_count; s++) {
            mni_plan_simplex(w->tree, node, w->tree->simplex_start[node] + s, corner);
            mni_encoder_simplex(&encoder, corner);
        }
    }
    MN_ASSERT(overflow == b->child_count);
    mni_encoder_end(&encoder);
}

static mn_code encode_overflow(writer *w, const mni_planned *b, mn_status *st) {
    uint32_t *corner = malloc(3 * sizeof *corner * b->simplices);
    if (corner == NULL)
        return mn_fail(st, MN_FAILED, "no memory for %u simplices", b->simplices);
    for (uint32_t i = 0; i < b->simplices; i++)
        mni_plan_simplex(w->tree, b->node, b->simplex_first + i, corner + 3 * (size_t)i);
    const mni_overflow head = mni_plan_overflow_head(w->tree, b->node);
    uint32_t end = mni_overflow_encode(w->bytes, b->place.pages * MN_PAGE_BYTES, b->child_count,
                                       &head, corner, b->simplices);
    free(corner);
    MN_ASSERT(end == b->payload_bytes);
    return MN_OK;
}

static mn_code write_block(writer *w, uint32_t index, mn_status *st) {
    const mni_plan *plan = &w->plan;
    const mni_planned *b = &plan->block[index];
    uint32_t length = b->place.pages * MN_PAGE_BYTES;
    if (b->is_overflow) {
        mn_code code = encode_overflow(w, b, st);
        if (code != MN_OK)
            return code;
    } else {
        encode_metanode(w, index);
    }
    for (uint32_t i = 0; i < b->child_count; i++)
        mni_frame_set_ref(w->bytes, i, plan->block[b->child_first + i].place);
    mni_frame frame = {.kind = b->is_overflow ? MNI_FRAME_OVERFLOW : MNI_FRAME_METANODE,
                       .refs = b->child_count,
                       .payload_bytes = b->payload_bytes,
                       .parent_id = b->parent == MN_NONE ? 0 : plan->block[b->parent].place.id};
    mni_frame_seal(w->bytes, &frame, b->place, w->header->build_id);

    const mn_header *h = w->header;
    const mni_block_limits limits = mni_block_limits_of(h);
    char why[160] = "its frame is wrong";
    mni_block view;
    mni_overflow overflow;
    bool sound =
        mni_frame_check(w->bytes, b->place, h->build_id, h->file_bytes) == MNI_FRAME_OK &&
        (b->is_overflow ? mni_overflow_open(&overflow, w->bytes, length, &limits, why, sizeof why)
                        : mni_block_open(&view, w->bytes, length, &limits, why, sizeof why));
    if (!sound)
        return mn_fail(st, MN_FAILED, "bug: block %u would not be readable: %s", b->place.id, why);
    return mni_out_write(&w->out, w->bytes, length, st);
}

static mn_code write_file(writer *w, const char *path, mn_status *st) {
    const mni_plan *plan = &w->plan;
    unsigned char page[MN_PAGE_BYTES];
    w->bytes = malloc(w->header->block_bytes_max);
    if (w->bytes == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a block of %u bytes",
                       w->header->block_bytes_max);
    mni_header_encode(w->header, page);
    mn_code code = mni_out_open(&w->out, path, st);
    if (code == MN_OK)
        code = mni_out_write(&w->out, page, sizeof page, st);
    for (uint32_t i = 0; i < plan->blocks && code == MN_OK; i++) {
        code = write_block(w, w->order[i], st);
        if (code == MN_OK && plan->desc->progress != NULL && i % 256 == 0 &&
            !plan->desc->progress(plan->desc->progress_context, "writing", i, plan->blocks))
            code = mn_fail(st, MN_FAILED, "interrupted");
    }
    if (code == MN_OK)
        code = mni_out_commit(&w->out, st);
    mni_out_abort(&w->out);
    return code;
}

/* ---- all of it ------------------------------------------------------------------------------ */

static mn_code check_desc(const mn_tree *tree, mn_block_desc *desc, mn_status *st) {
    if (desc->l == 0)
        desc->l = 5;
    if (desc->block_bytes == 0)
        desc->block_bytes = 8192;
    if (desc->l > 16)
        return mn_fail(st, MN_USAGE, "-L %u: levels are 1 to 16", desc->l);
    if (desc->block_bytes % MN_PAGE_BYTES != 0 || desc->block_bytes > MNI_BLOCK_BYTES_MAX)
        return mn_fail(st, MN_USAGE, "blocks of %u bytes: a multiple of 4096 up to 1M is needed",
                       desc->block_bytes);
    if (tree->grid_step == 0)
        return mn_fail(st, MN_USAGE, "positions are on no grid: simplify them on one");
    if (tree->roots > MN_ROOTS_MAX)
        return mn_fail(st, MN_USAGE, "the tree has %u roots, a .mnt holds %d: simplify to the end",
                       tree->roots, MN_ROOTS_MAX);
    for (uint32_t r = 0; r < tree->roots; r++)
        if (tree->root[r] < tree->leaves)
            return mn_fail(st, MN_USAGE, "root %u is a single vertex: simplify to the end", r);
    return MN_OK;
}

mn_code mn_block_write(const char *path, const mn_tree *tree, const mn_block_desc *desc,
                       mn_header *header, mn_block_counts *counts, mn_status *st) {
    mn_block_desc checked = desc != NULL ? *desc : (mn_block_desc){0};
    mn_header scratch;
    double started_s = now_s();
    mn_code code = mn_tree_check(tree, st);
    if (code == MN_OK)
        code = check_desc(tree, &checked, st);
    if (code != MN_OK)
        return code;
    writer w = {.tree = tree, .header = header != NULL ? header : &scratch, .out = {.fd = -1}};
    memset(w.header, 0, sizeof *w.header);
    code = mni_plan_open(&w.plan, tree, &checked, st);
    if (code == MN_OK)
        code = checked.blocking == MN_BLOCKING_LEVELS ? mni_plan_levels(&w.plan, st)
                                                      : mni_plan_packed(&w.plan, st);
    if (code == MN_OK)
        code = place_blocks(&w, st);
    if (code == MN_OK) {
        fill_header(&w);
        code = mni_tree_build_id(tree, &checked, &w.header->build_id, st);
    }
    if (code == MN_OK)
        code = mni_header_check(w.header, w.header->file_bytes, path, st);
    if (code == MN_OK)
        code = write_file(&w, path, st);
    if (code == MN_OK && counts != NULL)
        *counts = (mn_block_counts){.seconds_block = now_s() - started_s,
                                    .bytes_written = w.header->file_bytes};
    free(w.bytes);
    free(w.order);
    mni_plan_close(&w.plan);
    return code;
}
