/* From a tree to a .mnt: draft, place, encode, write, block by block.
 *
 * Hides: the order of blocks in the file. Parents come before children and the blocks that one
 * refers to stand side by side, so that what is prefetched together is read together; root blocks
 * come first:
 *
 *     header | roots | children of root 0 | children of its first child | …
 *
 * When a block's exits are grouped, the blocks that it refers to get their places at the end of
 * what has been given away, and the block is written, to the place that it got from its parent.
 * Blocks of whole subtrees, most of all, are written at once; the others wait on a stack, the first
 * on top.
 *
 *     stack:  [ siblings of B's parent | siblings of B | … ]     each: its place and its roots
 *
 * So a block must have a length before it is filled: one of `packed` that is to have exits has all
 * of its bytes.
 * Order: one call; blocks on the disk. Threads: the caller's, and with desc.threads one that
 * encodes and writes (block_send.c). Memory: a block and its draft, and the roots of those that
 * wait. Every block passes the reader's own checks before it is written. Paper: §3.2. */
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "mn_assert.h"
#include "block_press.h"
#include "block_rows.h"
#include "block_send.h"
#include "clock.h"
#include "header.h"
#include "need_block.h"
#include "plan.h"
#include "simplify.h"
#include "tree_rows.h"

/* What the process takes that neither grows with the model nor is pages of the tree, at least: more
 * for long blocks (need_block.h). Half of the rest is pages. */
static const uint64_t OWN_BYTES = 8 << 20, RAM_BYTES = 64 << 20;
/* More pages are not worth bringing: what is read again lies near, and the system's cache has the
 * rest. Blocks of the whole Earth took 0.90 of the time with so many, not all. */
static const uint64_t CACHE_BYTES_MOST = 16 << 20;

/* A block that has a place, and is to be filled. */
typedef struct pending {
    mni_exit *root;
    uint32_t roots, small;
    uint32_t parent_id, depth; /* blocks above it, itself included */
    mn_block_ref place;
} pending;

typedef struct writer {
    mni_plan plan;
    mni_packer *packer; /* NULL: levels */
    mn_header *header;
    mni_out *out;
    uint64_t pages; /* given away so far: of the file */
    uint64_t payload_bytes, nodes;
    pending *stack;
    uint32_t waiting, stack_capacity;
    mni_draft draft, scratch;
    mni_family family;
    mni_sender sender;
    mn_block_ref *ref; /* of the block in the making */
    uint32_t refs_capacity;
    mni_row_simplex *corner; /* of an overflow block */
    mni_piece *piece;        /* of the overflow blocks of one block's nodes */
    uint32_t *piece_node;    /* known */
    mn_block_ref *piece_place;
    uint32_t pieces, pieces_capacity, piece_nodes_capacity, piece_places_capacity;
} writer;

/* ---- places --------------------------------------------------------------------------------- */

static mn_block_ref give_place(writer *w, uint32_t payload_bytes) {
    uint32_t pages = (payload_bytes + MNI_BLOCK_TAIL_BYTES + MN_PAGE_BYTES - 1) / MN_PAGE_BYTES;
    mn_block_ref place = {(uint32_t)w->pages, pages};
    w->pages += pages;
    return place;
}

static mn_block_ref place_run(writer *w, const mni_run *run) {
    uint32_t full = w->plan.desc->block_bytes - MNI_BLOCK_TAIL_BYTES;
    return give_place(w, run->whole || w->packer == NULL ? run->payload_bytes : full);
}

static mn_code check_pages(writer *w) {
    if (w->pages >= UINT32_MAX)
        return mn_fail(w->plan.st, MN_FAILED, "the file would be larger than 16 TiB");
    return MN_OK;
}

/* ---- what the header says of blocks ---------------------------------------------------------- */

static void count_block(writer *w, const mni_job *job) {
    mn_header *h = w->header;
    const uint32_t length = job->place.pages * MN_PAGE_BYTES;
    h->blocks++;
    w->payload_bytes += job->payload_bytes;
    h->block_bytes_max = length > h->block_bytes_max ? length : h->block_bytes_max;
    h->children_max = job->refs > h->children_max ? job->refs : h->children_max;
}

static void count_nodes(writer *w, uint32_t nodes, uint32_t depth) {
    mn_header *h = w->header;
    w->nodes += nodes;
    h->nodes_per_block_max = nodes > h->nodes_per_block_max ? nodes : h->nodes_per_block_max;
    h->block_depth = depth > h->block_depth ? depth : h->block_depth;
}

/* ---- overflow ------------------------------------------------------------------------------- */

static mn_code add_piece(writer *w, uint32_t known, uint32_t first) {
    if (!mni_plan_room((void **)&w->piece, w->pieces + 1, &w->pieces_capacity, sizeof *w->piece) ||
        !mni_plan_room((void **)&w->piece_node, w->pieces + 1, &w->piece_nodes_capacity,
                       sizeof *w->piece_node) ||
        !mni_plan_room((void **)&w->piece_place, w->pieces + 1, &w->piece_places_capacity,
                       sizeof *w->piece_place))
        return mni_plan_trouble(&w->plan, "overflow blocks");
    w->piece_node[w->pieces] = known;
    return mni_piece_cut(&w->plan, &w->draft.known[known], first, w->corner,
                         &w->piece[w->pieces++]);
}

/* Cuts the overflow of the draft's nodes: the first piece of each, then the rests of the chains. */
static mn_code cut_pieces(writer *w, uint32_t *heads) {
    mn_code code = MN_OK;
    w->pieces = 0;
    for (uint32_t i = 0; i < w->draft.listed && code == MN_OK; i++) {
        const mni_known *k = &w->draft.known[w->draft.list[i]];
        if (!mni_draft_overflows(&w->plan, k))
            continue;
        if (w->corner == NULL)
            w->corner = malloc(sizeof *w->corner * mni_piece_most(&w->plan));
        code = w->corner == NULL
                   ? mni_plan_trouble(&w->plan, "an overflow block")
                   : add_piece(w, w->draft.list[i], k->row.simplex_start + w->plan.simplices_max);
    }
    *heads = w->pieces;
    for (uint32_t i = 0; i < *heads && code == MN_OK; i++) {
        mni_piece last = w->piece[i];
        uint32_t length = 1;
        for (; !last.last && code == MN_OK; length++) {
            code = add_piece(w, w->piece_node[i], last.first + last.count);
            last = w->piece[w->pieces - 1];
        }
        if (length > w->header->overflow_max)
            w->header->overflow_max = length;
    }
    return code;
}

/* After what has been posted: chains are too rare to be sent beside the packing. */
static mn_code write_pieces(writer *w, uint32_t heads, uint32_t parent_id) {
    mn_code code = heads > 0 ? mni_sender_drain(&w->sender, w->plan.st) : MN_OK;
    uint32_t rest = heads;
    for (uint32_t i = 0; i < heads && code == MN_OK; i++) {
        mni_job job = {.parent_id = parent_id, .file_bytes = w->pages * MN_PAGE_BYTES};
        for (uint32_t at = i; code == MN_OK; at = rest++) {
            const mni_piece *piece = &w->piece[at];
            job.place = w->piece_place[at];
            job.payload_bytes = piece->payload_bytes;
            job.refs = piece->last ? 0 : 1;
            job.ref = &w->piece_place[rest];
            count_block(w, &job);
            code = mni_sender_overflow(&w->sender, &job, &w->draft.known[w->piece_node[i]], piece,
                                       w->corner);
            if (piece->last)
                break;
            job.parent_id = job.place.id;
        }
    }
    return code;
}

/* ---- a block and those below it ------------------------------------------------------------- */

/* Puts a child block that is to be filled on the stack. */
static mn_code push(writer *w, const mni_run *run, mn_block_ref place, uint32_t parent_id,
                    uint32_t depth) {
    uint32_t roots = run->next - run->first;
    mni_exit *root = malloc(sizeof *root * roots);
    if (root == NULL ||
        !mni_plan_room((void **)&w->stack, w->waiting + 1, &w->stack_capacity, sizeof *w->stack)) {
        free(root);
        return mni_plan_trouble(&w->plan, "blocks that wait");
    }
    memcpy(root, w->family.exit + run->first, sizeof *root * roots);
    w->stack[w->waiting++] = (pending){root, roots, run->small, parent_id, depth, place};
    return MN_OK;
}

static mn_code post(writer *w, mni_job *job, uint32_t depth) {
    job->file_bytes = w->pages * MN_PAGE_BYTES;
    count_block(w, job);
    count_nodes(w, job->tally.nodes, depth);
    return mni_sender_post(&w->sender, job) ? MN_OK : MN_FAILED; /* drain tells why */
}

static mn_code post_whole(writer *w, const mni_run *run, mn_block_ref place, uint32_t parent_id,
                          uint32_t depth) {
    mni_job job = {.place = place,
                   .parent_id = parent_id,
                   .payload_bytes = run->payload_bytes,
                   .tally = run->tally,
                   .exit = w->family.exit + run->first,
                   .exits = run->next - run->first};
    return post(w, &job, depth);
}

/* The family's blocks, which have places from `first` page on: written, or put on the stack. */
static mn_code send_family(writer *w, uint64_t first, uint32_t parent_id, uint32_t depth) {
    const mni_family *f = &w->family;
    uint64_t end = first;
    uint32_t bottom = w->waiting;
    mn_code code = MN_OK;
    for (uint32_t r = 0; r < f->runs && code == MN_OK; r++) {
        const mni_run *run = &f->run[r];
        uint64_t given = w->pages;
        w->pages = end;
        mn_block_ref place = place_run(w, run);
        end = w->pages;
        w->pages = given;
        code = run->whole ? post_whole(w, run, place, parent_id, depth)
                          : push(w, run, place, parent_id, depth);
    }
    for (uint32_t a = bottom, b = w->waiting; a + 1 < b; a++) { /* the first on top */
        pending moved = w->stack[a];
        w->stack[a] = w->stack[--b];
        w->stack[b] = moved;
    }
    return code;
}

/* Places of the blocks that the draft's refers to, and of its chains. */
static mn_code place_below(writer *w, uint32_t heads) {
    const mni_family *f = &w->family;
    if (!mni_plan_room((void **)&w->ref, f->runs + heads, &w->refs_capacity, sizeof *w->ref))
        return mni_plan_trouble(&w->plan, "references");
    for (uint32_t r = 0; r < f->runs; r++) {
        w->ref[r] = place_run(w, &f->run[r]);
        for (uint32_t e = f->run[r].first; e < f->run[r].next; e++) {
            w->draft.known[f->exit[e].known].ref = r;
            w->draft.known[f->exit[e].known].subtree = e - f->run[r].first;
        }
    }
    for (uint32_t i = 0; i < w->pieces; i++) {
        w->piece_place[i] = give_place(w, w->piece[i].payload_bytes);
        if (i < heads)
            w->ref[f->runs + i] = w->piece_place[i];
    }
    return check_pages(w);
}

/* Fills the block, gives places to those below, sends it. */
static mn_code write_pending(writer *w, const pending *b) {
    mni_plan *plan = &w->plan;
    mni_family *f = &w->family;
    mni_job job = {.place = b->place, .parent_id = b->parent_id, .draft = &w->draft};
    uint32_t heads = 0;
    mn_code code =
        w->packer != NULL
            ? mni_packer_block(w->packer, b->root, b->roots, b->small, &w->draft, f, &job.tally)
            : mni_levels_block(plan, b->root, &w->draft, &w->scratch, f, &job.tally);
    const uint64_t first = w->pages;
    if (code == MN_OK)
        code = cut_pieces(w, &heads);
    if (code == MN_OK)
        code = place_below(w, heads);
    if (code != MN_OK)
        return code;
    job.ref = w->ref;
    job.refs = f->runs + heads;
    job.first_overflow = f->runs;
    job.payload_bytes = (uint32_t)mni_tally_bytes(&job.tally, job.refs);
    MN_ASSERT(job.payload_bytes + MNI_BLOCK_TAIL_BYTES <= job.place.pages * MN_PAGE_BYTES);
    code = post(w, &job, b->depth);
    if (code == MN_OK)
        code = write_pieces(w, heads, b->place.id);
    return code == MN_OK ? send_family(w, first, b->place.id, b->depth + 1) : code;
}

/* ---- the whole ------------------------------------------------------------------------------ */

static mn_code place_roots(writer *w) {
    mni_plan *plan = &w->plan;
    mni_family *f = &w->family;
    mn_code code = mni_plan_roots(plan, &w->draft, f);
    if (code == MN_OK)
        code = w->packer != NULL ? mni_packer_roots(w->packer, &w->draft, f)
                                 : mni_levels_runs(plan, f, &w->scratch);
    const uint64_t first = w->pages;
    for (uint32_t r = 0; r < f->runs && code == MN_OK; r++) {
        mn_block_ref place = place_run(w, &f->run[r]);
        for (uint32_t e = f->run[r].first; e < f->run[r].next; e++) {
            mn_root *root = &w->header->root[f->exit[e].known];
            mni_row row;
            uint32_t ignored;
            if (!mni_rows_get(plan->rows, f->exit[e].leaf_lo, &row, &ignored))
                return mni_plan_trouble(plan, "rows");
            *root = (mn_root){.block = place,
                              .subtree = e - f->run[r].first,
                              .color = plan->limits.has_colors ? row.rgba : UINT32_MAX};
            memcpy(root->position, row.position, sizeof root->position);
        }
    }
    if (code == MN_OK)
        code = check_pages(w);
    return code == MN_OK ? send_family(w, first, 0, 1) : code;
}

static mn_code say_progress(const writer *w) {
    const mn_block_desc *desc = w->plan.desc;
    if (desc->progress != NULL &&
        !desc->progress(desc->progress_context, "blocking", w->nodes, w->plan.head->inner))
        return mn_fail(w->plan.st, MN_FAILED, "interrupted");
    return MN_OK;
}

static mn_code write_blocks(writer *w) {
    mn_code code = place_roots(w);
    for (uint32_t done = 0; w->waiting > 0 && code == MN_OK; done++) {
        pending next = w->stack[--w->waiting];
        code = write_pending(w, &next);
        free(next.root);
        if (code == MN_OK && done % 16 == 0)
            code = say_progress(w);
    }
    while (w->waiting > 0)
        free(w->stack[--w->waiting].root);
    /* blocks that were sent come before the one that packing failed at */
    mn_status packing = *w->plan.st;
    *w->plan.st = (mn_status){0};
    mn_code sending = mni_sender_drain(&w->sender, w->plan.st);
    if (sending != MN_OK)
        return sending;
    *w->plan.st = packing;
    mni_found_add(&w->plan.found, mni_sender_found(&w->sender));
    if (code != MN_OK && packing.code == MN_OK) /* a job could not be kept */
        return mni_plan_trouble(&w->plan, "blocks that wait");
    return code == MN_OK ? mni_found_check(&w->plan.found, w->plan.head, w->plan.st) : code;
}

static void begin_header(writer *w, uint64_t build_id) {
    const mn_tree *tree = w->plan.head;
    const mn_block_desc *desc = w->plan.desc;
    mn_header *h = w->header;
    h->version = MNI_MNT_VERSION;
    h->build_id = build_id;
    h->triangles = tree->triangles;
    h->leaves = tree->leaves;
    h->nodes = tree->leaves + tree->inner;
    h->hinges = tree->simplices - tree->triangles;
    h->legal_last = tree->legal_last;
    h->has_colors = w->plan.limits.has_colors;
    memcpy(h->origin, tree->origin, sizeof h->origin);
    h->grid_step = tree->grid_step;
    h->metric = tree->metric;
    h->blocking = desc->blocking;
    h->l = h->blocking == MN_BLOCKING_LEVELS ? desc->l : 0;
    h->block_bytes = h->blocking == MN_BLOCKING_PACKED ? desc->block_bytes : 0;
    h->roots = tree->roots;
}

static mn_code write_header(writer *w, const char *path) {
    mn_header *h = w->header;
    const mn_watch watch = {w->plan.desc->progress, w->plan.desc->progress_context};
    unsigned char page[MN_PAGE_BYTES];
    h->file_bytes = w->pages * MN_PAGE_BYTES;
    h->depth_max = w->plan.found.depth_max;
    h->fill_mean = (double)w->payload_bytes / h->blocks / h->block_bytes_max;
    mn_code code = mni_found_shape(&w->plan.found, w->plan.rows, &watch, h, w->plan.st);
    if (code == MN_OK)
        code = mni_header_check(h, h->file_bytes, path, w->plan.st);
    if (code != MN_OK)
        return code;
    mni_header_encode(h, page);
    return mni_out_write_at(w->out, 0, page, sizeof page, w->plan.st);
}

static void close_writer(writer *w) {
    mni_sender_close(&w->sender);
    mni_packer_close(w->packer);
    mni_draft_free(&w->draft);
    mni_draft_free(&w->scratch);
    free(w->family.exit);
    free(w->family.run);
    free(w->stack);
    free(w->ref);
    free(w->corner);
    free(w->piece);
    free(w->piece_node);
    free(w->piece_place);
    mni_plan_close(&w->plan);
}

/* All but the commit: the file is in *out. */
static mn_code write_file(const char *path, const mn_tree *head, mni_rows *rows, uint64_t build_id,
                          const mn_block_desc *desc, mn_header *header, mni_out *out,
                          mn_status *st) {
    writer w = {.header = header, .out = out, .pages = 1};
    mn_code code = mni_plan_open(&w.plan, head, rows, desc, st);
    if (code == MN_OK && desc->blocking == MN_BLOCKING_PACKED)
        code = mni_packer_open(&w.packer, &w.plan);
    if (code == MN_OK)
        code = mni_out_open(out, path, st);
    if (code == MN_OK) {
        begin_header(&w, build_id);
        code = mni_sender_open(&w.sender, &w.plan, out, header, desc->threads, st);
    }
    if (code == MN_OK)
        code = write_blocks(&w);
    if (code == MN_OK)
        code = write_header(&w, path);
    close_writer(&w);
    return code;
}

/* ---- what may be blocked -------------------------------------------------------------------- */

static mn_code check_counts(const mn_tree *t, const mni_rows_source *source, mn_status *st) {
    if (t->leaves == 0 || t->leaves > (1u << 31) || t->roots == 0 || t->roots > t->leaves ||
        t->inner != t->leaves - t->roots || t->triangles > t->simplices ||
        source->rows != t->leaves || source->simplices != t->simplices)
        return mn_fail(st, MN_BAD_INPUT, "a tree of %u leaves, %u inner nodes, %u roots cannot be",
                       t->leaves, t->inner, t->roots);
    if (t->legal_last < t->leaves - 1 || t->legal_last >= t->leaves + t->inner)
        return mn_fail(st, MN_BAD_INPUT, "legal_last %u outside [%u, %u)", t->legal_last,
                       t->leaves - 1, t->leaves + t->inner);
    if (t->grid_step != 0 && !mni_grid_ok(t->grid_step))
        return mn_fail(st, MN_BAD_INPUT, "a grid of steps of %g cannot be", t->grid_step);
    return MN_OK;
}

mn_code mni_block_desc_check(const char *path, const mn_tree *tree, mn_block_desc *desc,
                             mn_status *st) {
    if (desc->l == 0)
        desc->l = MNI_BLOCK_LEVELS;
    if (desc->block_bytes == 0)
        desc->block_bytes = MNI_BLOCK_BYTES;
    if (desc->l > 16)
        return mn_fail(st, MN_USAGE, "-L %u: levels are 1 to 16", desc->l);
    if (desc->block_bytes % MN_PAGE_BYTES != 0 || desc->block_bytes > MNI_BLOCK_BYTES_MAX)
        return mn_fail(st, MN_USAGE, "blocks of %u bytes: a multiple of 4096 up to 1M is needed",
                       desc->block_bytes);
    if (desc->zstd_level > MNI_ZSTD_LEVEL_MAX)
        return mn_fail(st, MN_USAGE, "zstd's levels are 1 to %d", MNI_ZSTD_LEVEL_MAX);
    if (tree->grid_step == 0)
        return mn_fail(st, MN_USAGE, "positions are on no grid: simplify them on one");
    if (tree->roots > MN_ROOTS_MAX)
        return mn_fail(st, MN_USAGE, "the tree has %u roots, a .mnt holds %d: simplify to the end",
                       tree->roots, MN_ROOTS_MAX);
    return mn_block_fits(path, desc, tree->leaves, 0, st);
}

static uint64_t cache_bytes(const mn_block_desc *desc, uint64_t leaves) {
    const uint64_t ram = desc->ram_bytes != 0 ? desc->ram_bytes : RAM_BYTES;
    uint64_t own = MNI_PROGRAM_BYTES + mni_block_work(desc, leaves, desc->threads > 1);
    own = own > OWN_BYTES ? own : OWN_BYTES;
    const uint64_t half = ram > own ? (ram - own) / 2 : 0;
    return half < CACHE_BYTES_MOST ? half : CACHE_BYTES_MOST;
}

mn_code mni_block_rows(const char *path, const mn_tree *head, const mni_rows_source *source,
                       uint64_t build_id, const mn_block_desc *desc, mn_header *header,
                       mn_block_counts *counts, mn_status *st) {
    mn_block_desc checked = desc != NULL ? *desc : (mn_block_desc){0};
    mn_header scratch;
    mni_rows rows;
    mn_status why = {0};
    mn_block_counts count = {0};
    mni_out out = {.fd = -1};
    const double started_s = mni_now_s(), started_cpu_s = mni_cpu_s();
    header = header != NULL ? header : &scratch;
    memset(header, 0, sizeof *header);
    mn_code code = check_counts(head, source, &why);
    if (code == MN_OK)
        code = mni_block_desc_check(path, head, &checked, &why);
    const uint64_t held =
        source->row != NULL ? mni_tree_rows_bytes(head->leaves, head->simplices, source->has_colors)
                            : 0;
    if (!mni_block_threaded(&checked, head->leaves, held))
        checked.threads = 1;
    if (code == MN_OK)
        code = mni_rows_open(&rows, source, cache_bytes(&checked, head->leaves), &why);
    if (code == MN_OK) {
        code = write_file(path, head, &rows, build_id, &checked, header, &out, &why);
        count.bytes_read = rows.bytes_read;
        mni_rows_close(&rows);
    }
    count.bytes_written = header->file_bytes;
    if (code == MN_OK && checked.zstd_level > 0)
        code = mni_block_press(&out, path, &checked, header, &count, &why);
    if (code == MN_OK)
        code = mni_out_commit(&out, &why);
    mni_out_abort(&out);
    count.seconds_block = mni_now_s() - started_s;
    count.cpu_seconds_block = mni_cpu_s() - started_cpu_s;
    if (code == MN_OK && counts != NULL)
        *counts = count;
    if (code == MN_BAD_INPUT && source->name != NULL)
        return mn_fail(st, code, "%s: %s; the file is damaged: simplify again", source->name,
                       why.text);
    return code == MN_OK ? MN_OK : mn_fail(st, code, "%s", why.text);
}

/* ---- trees in memory ------------------------------------------------------------------------ */

typedef struct sections {
    unsigned char *bytes[MNI_SECTIONS];
    size_t used[MNI_SECTIONS];
} sections;

static mn_code put_section(void *context, int section, const void *bytes, size_t count) {
    sections *s = context;
    memcpy(s->bytes[section] + s->used[section], bytes, count);
    s->used[section] += count;
    return MN_OK;
}

static mn_code block_sections(const char *path, const mn_tree *tree, sections *s,
                              const mn_block_desc *desc, mn_header *header, mn_block_counts *counts,
                              mn_status *st) {
    mni_rows_source source = {.rows = tree->leaves,
                              .simplices = tree->simplices,
                              .has_colors = tree->leaf_color != NULL,
                              .row = (const mni_row *)(void *)s->bytes[MNI_ROWS],
                              .simplex = (const mni_row_simplex *)(void *)s->bytes[MNI_SIMPLICES]};
    mn_code code = mni_tree_rows(tree, put_section, s, st);
    if (code != MN_OK)
        return code;
    uint64_t sum[MNI_SECTIONS];
    for (int i = 0; i < MNI_SECTIONS; i++)
        sum[i] = XXH3_64bits(s->bytes[i], s->used[i]);
    uint64_t build_id = mni_build_id(tree, source.has_colors, sum, desc);
    return mni_block_rows(path, tree, &source, build_id, desc, header, counts, st);
}

mn_code mn_block_write(const char *path, const mn_tree *tree, const mn_block_desc *desc,
                       mn_header *header, mn_block_counts *counts, mn_status *st) {
    mn_block_desc checked = desc != NULL ? *desc : (mn_block_desc){0};
    mn_code code = mn_tree_check(tree, st);
    if (code == MN_OK)
        code = mni_block_desc_check(path, tree, &checked, st);
    if (code != MN_OK)
        return code;
    sections s = {.bytes = {malloc(sizeof(mni_row) * tree->leaves),
                            malloc(sizeof(mni_row_simplex) * ((size_t)tree->simplices + 1))}};
    code = s.bytes[MNI_ROWS] != NULL && s.bytes[MNI_SIMPLICES] != NULL
               ? block_sections(path, tree, &s, &checked, header, counts, st)
               : mn_fail(st, MN_FAILED, "no memory for the rows of %u vertices", tree->leaves);
    free(s.bytes[MNI_ROWS]);
    free(s.bytes[MNI_SIMPLICES]);
    return code;
}
