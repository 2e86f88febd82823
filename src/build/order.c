/* From a history to a tree on disk.
 *
 * A collapse becomes a node, and a node's place in the file is its row: the number of the leaf with
 * which its right child begins (rows.h). What is to be found out is therefore where leaves stand,
 * depth first, and which order id each collapse gets. Three steps, each of which goes through its
 * input once:
 *
 *   1  history, last group to first       a parent tells its children where their leaves begin
 *        │  messages, by collapse ──┐     (order_nodes.c)
 *        │ ◄────────────────────────┘
 *        ├── rows, by row ─────────────┐
 *        ├── order ids, by row ────────┤
 *        └── simplices, by row ──┐     │
 *   2  rows, first to last ◄─────│─────┘  leaves' ids are known now: positions are fetched, and
 *        │  leaf numbers, by id ─┤        where each leaf stands goes to a table (order_rows.c)
 *   3  simplices, first to last ◄┘        ids become leaf numbers
 *
 * "By" is a deal to buckets (buckets.h): places are known in advance, so nothing is compared, and
 * each byte is written once and read once. Only order ids need a sort, by key. Vertices and the
 * table of leaves are asked for in the order of leaves; that is one in space too, as ids are, so a
 * few pages do (pages.h).
 *
 * A second thread, where memory has room for a second bucket, deals a bucket's rows and simplices
 * beside the next one's collapses in step 1, and loads the bucket that comes next in steps 2 and 3.
 *
 * Here: the plan of memory, and the steps' order. */
#include "order.h"

#include "mn_assert.h"
#include "extsort.h"
#include "order_parts.h"
#include "rows.h"

enum {
    BITS_MIN = 12,        /* of a group of the history: none is in two buckets */
    BITS_MAX = 16,        /* of a row or collapse in its bucket: 2 bytes */
    BITS_GOOD = 14,       /* two buckets of rows then fit a cache of 2 MB */
    CHUNK_MAX = 4 << 20,  /* most buckets fit one */
    CHUNK_GOOD = 256,     /* with less, the calls cost more than the bytes */
    CHUNK_FINE = 8 << 10, /* and from there on hardly anything */
    PLAN_LEAST = 1 << 20,
    PAGES_PART = 4, /* of the memory that pages must have beside two buckets */
    ALIGN = 16,
};

_Static_assert(1 << BITS_MIN == MNI_HISTORY_GROUP, "groups are parts of buckets");

/* A bucket's, of each kind that is dealt: messages, rows, order ids, simplices; and one to read. */
static uint64_t chunk_bytes(uint64_t leaves, uint64_t work, uint32_t bits) {
    const uint64_t size = UINT64_C(1) << bits, buckets = (leaves + size - 1) >> bits;
    return work / 2 / (4 * buckets + 1);
}

/* count × size, a line for each consumer. */
static bool plan_memory(mni_order_plan *p, uint64_t leaves, uint64_t work, uint32_t chunk_least,
                        uint32_t threads) {
    const uint64_t node = 48 /* a collapse in step 1 */,
                   row = sizeof(mni_row) + 4 /* its leaf's id */;
    const uint64_t fixed = 3 * MNI_ORDER_BUFFER_BYTES /* readers, a writer */ +
                           MNI_ORDER_PLACES_BYTES + 8 * ALIGN + 4096;
    *p = (mni_order_plan){.bits = BITS_MIN, .threads = threads};
    while (p->bits < BITS_MAX && (UINT64_C(2) << p->bits) * row <= work / 4 &&
           (UINT64_C(1) << p->bits) < leaves &&
           (p->bits < BITS_GOOD || chunk_bytes(leaves, work, p->bits) < CHUNK_FINE))
        p->bits++;
    uint64_t size = UINT64_C(1) << p->bits, buckets = (leaves + size - 1) >> p->bits;
    uint64_t chunk = chunk_bytes(leaves, work, p->bits);
    chunk = chunk > 64 ? (chunk - 64) / 8 * 8 : 0;
    p->chunk_bytes = (uint32_t)(chunk < CHUNK_MAX ? chunk : CHUNK_MAX);
    p->buckets = (uint32_t)buckets;
    if (buckets > UINT32_MAX || p->chunk_bytes < chunk_least)
        return false;
    uint64_t dealt = mni_buckets_need(p->buckets, p->chunk_bytes);
    p->dealt_bytes = 3 * dealt;
    p->nodes_bytes = dealt + threads * size * node + p->chunk_bytes + fixed;
    uint64_t rows = threads * size * row + p->chunk_bytes + fixed;
    if (work < p->dealt_bytes + p->nodes_bytes + 2 * MNI_SORT_BUDGET_MIN ||
        work < p->dealt_bytes + rows + 2 * MNI_PAGES_BUDGET_MIN)
        return false;
    p->sort_bytes = work - p->dealt_bytes - p->nodes_bytes;
    p->rows_bytes = work - p->dealt_bytes;
    uint64_t pages = p->rows_bytes - rows;
    /* in step 3 simplices take the rows' room */
    p->leaves_bytes = pages / 2;
    p->vertices_bytes = pages / 2;
    if (threads > 1 && pages < work / PAGES_PART)
        return false;
    p->simplices_at_once = (uint32_t)((size * (row - 4) - ALIGN) / sizeof(mni_row_simplex));
    return true;
}

/* Where nothing need leave memory, the plan is for as much. */
static uint64_t enough(uint64_t vertices, uint64_t simplices) {
    const uint64_t row = 24, order = 8, message = 8, simplex = 16; /* as dealt, and some */
    uint64_t dealt = vertices * (row + order + message) + simplices * simplex;
    return 4 * dealt + vertices * (sizeof(mni_extvertex) + 4) + 8 * PLAN_LEAST;
}

uint64_t mni_order_work_min(uint64_t vertices) {
    mni_order_plan plan;
    uint64_t work = PLAN_LEAST;
    while (!plan_memory(&plan, vertices, work, CHUNK_GOOD, 1))
        work += work / 16 / 4096 * 4096;
    return work;
}

static void close_work(mni_order_work *w) {
    mni_buckets *dealt[] = {&w->row, &w->simplex, &w->ordered};
    mni_spill *spill[] = {&w->leaf_of, &w->counts, &w->places};
    for (int i = 0; i < 3; i++) {
        w->out->bytes_read += dealt[i]->spill.bytes_read;
        w->out->bytes_written += dealt[i]->spill.bytes_written;
        mni_buckets_close(dealt[i]);
    }
    for (int i = 0; i < 3; i++) {
        w->out->bytes_read += spill[i]->bytes_read;
        w->out->bytes_written += spill[i]->bytes_written;
        mni_spill_close(spill[i]);
    }
    mni_arena_close(&w->arena);
}

static mn_code open_work(mni_order_work *w) {
    const mni_order_plan *p = &w->plan;
    mn_code code = mni_arena_open(&w->arena, p->dealt_bytes, w->st);
    if (code == MN_OK)
        code = mni_spill_open(&w->leaf_of, w->desc->temp_dir, w->st);
    if (code == MN_OK)
        code = mni_spill_open(&w->counts, w->desc->temp_dir, w->st);
    if (code == MN_OK)
        code = mni_spill_open(&w->places, w->desc->temp_dir, w->st);
    if (code != MN_OK)
        return code;
    mni_buckets_open(&w->row, p->buckets, p->chunk_bytes, &w->arena, w->desc->temp_dir);
    mni_buckets_open(&w->simplex, p->buckets, p->chunk_bytes, &w->arena, w->desc->temp_dir);
    mni_buckets_open(&w->ordered, p->buckets, p->chunk_bytes, &w->arena, w->desc->temp_dir);
    return MN_OK;
}

mn_code mni_order(mni_history *history, mni_extmesh *mesh, const mni_order_desc *desc,
                  mni_ordered *out, mn_status *st) {
    mni_order_work w = {.history = history,
                        .mesh = mesh,
                        .desc = desc,
                        .leaf_of = {.fd = -1},
                        .counts = {.fd = -1},
                        .places = {.fd = -1},
                        .out = out,
                        .st = st};
    uint64_t vertices = mesh->vertices, work = desc->work_bytes;
    uint64_t all = enough(vertices, history->killed_count);
    const mni_spill *input[] = {&history->collapse, &history->killed, &history->group,
                                &mesh->vertex};
    uint64_t read_before = 0;
    MN_ASSERT(history->collapses == vertices - 1 && vertices > 1);
    for (int i = 0; i < 4; i++)
        read_before += input[i]->bytes_read;
    *out = (mni_ordered){.file = {.fd = -1}};
    if (work == 0 || work > all)
        work = all;
    if ((desc->threads < 2 || !plan_memory(&w.plan, vertices, work, MNI_BUCKET_CHUNK_MIN, 2)) &&
        !plan_memory(&w.plan, vertices, work, MNI_BUCKET_CHUNK_MIN, 1))
        return mn_fail(st, MN_CAP_TOO_SMALL, "%.1f MB are too few to order %llu vertices",
                       (double)work / (1 << 20), (unsigned long long)vertices);
    mn_code code = mni_spill_open_kept(&out->file, desc->temp_dir, desc->keep, st);
    if (code == MN_OK)
        code = open_work(&w);
    if (code == MN_OK)
        code = mni_order_nodes(&w);
    if (code == MN_OK)
        code = mni_order_rows(&w);
    close_work(&w);
    for (int i = 0; i < 4; i++)
        out->bytes_read += input[i]->bytes_read;
    out->bytes_read -= read_before;
    out->bytes_written += out->file.bytes_written;
    if (code != MN_OK)
        mni_spill_close(&out->file);
    return code;
}
