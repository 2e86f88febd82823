/* Steps 2 and 3 of order.c: rows from the first to the last, then their simplices.
 *
 * Hides: how leaves' ids come with the rows. The right child of a row's node begins with the row's
 * leaf: where it is a leaf, it is that one. A left child that is a leaf is the one before. So each
 * leaf's id is told once, by its parent's row, this one or the next, and rows in order are leaves
 * in order.
 *
 * Simplices of a row are counted in step 2, a byte each (255: four more follow), so that in step 3
 * each is put where it belongs at once. A bucket that has more of them than there is room is gone
 * through several times. Memory: plan.rows_bytes. One thread. */
#include "mn_assert.h"
#include "order_parts.h"
#include "rowpack_write.h"
#include "unit.h"

enum { PAGE_BYTES = 1024, COUNT_MANY = 255, ALIGN = 16 };

typedef struct rows {
    mni_order_work *w;
    mni_pages vertex, leaf_of;
    mni_row *row; /* of a bucket; step 3: room for its simplices */
    uint32_t *id; /* of its leaves; step 3: where each row's simplices begin */
    void *room;   /* a chunk */
    mni_spill_writer counts;
    mni_rowpack_writer out;
    uint32_t first, count, simplices;
} rows;

static mn_code trouble(const mni_spill *spill, mn_status *st) {
    return mn_fail(st, spill->trouble.code, "%s", spill->trouble.text);
}

static uint32_t take_at(const unsigned char **at) {
    uint16_t row;
    memcpy(&row, *at, sizeof row);
    *at += sizeof row;
    return row;
}

/* ---- step 2: rows --------------------------------------------------------------------------- */

/* A leaf's id, or a node's split. */
static uint32_t take_child(const unsigned char **from, uint32_t leaves, uint32_t *last) {
    return leaves <= 1 ? mni_order_get_id(from, last) : (uint32_t)mni_varint_get(from);
}

static void take_row(rows *r, const unsigned char **from, uint32_t *last) {
    uint32_t i = take_at(from), left_leaves = (uint32_t)mni_varint_get(from);
    uint32_t left = take_child(from, left_leaves, last), at = r->first + i;
    if (left_leaves == 0) { /* of the leaf alone */
        r->id[i] = left;
        return;
    }
    uint32_t right_leaves = (uint32_t)mni_varint_get(from);
    uint32_t right = take_child(from, right_leaves, last);
    uint64_t facts;
    memcpy(&facts, *from, sizeof facts);
    facts &= (UINT64_C(1) << 8 * MNI_ORDER_FACTS_BYTES) - 1;
    *from += MNI_ORDER_FACTS_BYTES;
    uint64_t bounds = facts >> MNI_FACTS_VALUE_BITS;
    mni_row *row = &r->row[i];
    row->leaf_lo = at - left_leaves;
    row->leaf_hi = at + right_leaves;
    if (left_leaves > 1)
        row->left = row->leaf_lo + left;
    else if (i > 0)
        r->id[i - 1] = left;
    if (right_leaves > 1)
        row->right = at + right;
    else
        r->id[i] = right;
    row->switch_value = mni_unit_length(mni_facts_value_of(facts & 0x1fff), r->w->mesh->unit);
    row->radius = mni_unit_length(mni_facts_radius_of(bounds), r->w->mesh->unit);
    row->cone = mni_facts_cone_of(bounds);
    row->simplex_start = (uint32_t)mni_varint_get(from); /* a count, until rows stand in order */
}

static mn_code load_rows(rows *r, uint32_t bucket) {
    mni_order_work *w = r->w;
    mni_bucket_reader from;
    for (uint32_t i = 0; i < r->count; i++) {
        r->row[i] = (mni_row){.left = MN_NONE, .right = MN_NONE};
        r->id[i] = MN_NONE;
    }
    mni_bucket_read(&from, &w->row, bucket, r->room);
    do {
        while (from.at < from.end)
            take_row(r, &from.at, &from.last);
    } while (mni_bucket_more(&from, &w->row));
    mni_bucket_read(&from, &w->ordered, bucket, r->room);
    do {
        while (from.at < from.end) {
            mni_row *row = &r->row[take_at(&from.at)];
            memcpy(&row->order, from.at, sizeof row->order);
            from.at += sizeof row->order;
        }
    } while (mni_bucket_more(&from, &w->ordered));
    if (w->row.spill.trouble.code != MN_OK)
        return trouble(&w->row.spill, w->st);
    return w->ordered.spill.trouble.code != MN_OK ? trouble(&w->ordered.spill, w->st) : MN_OK;
}

/* The leaf's vertex; and where it stands is written down. */
static mn_code place_leaf(rows *r, uint32_t i) {
    mni_order_work *w = r->w;
    MN_ASSERT(r->id[i] < w->mesh->vertices);
    const mni_extvertex *v = mni_pages_at(&r->vertex, r->id[i], false);
    uint32_t *leaf = mni_pages_at(&r->leaf_of, r->id[i], true);
    if (v == NULL || leaf == NULL)
        return trouble(v == NULL ? &w->mesh->vertex : &w->leaf_of, w->st);
    for (int c = 0; c < 3; c++) /* -0 becomes 0: blocks hold differences */
        r->row[i].position[c] = mni_unit_length(v->position[c], w->mesh->unit) + 0.0f;
    r->row[i].rgba = w->mesh->has_colors ? v->rgba : UINT32_MAX;
    *leaf = r->first + i;
    return MN_OK;
}

static void put_count(rows *r, uint32_t count) {
    unsigned char byte = count < COUNT_MANY ? (unsigned char)count : COUNT_MANY;
    mni_spill_put(&r->counts, &byte, 1);
    if (byte == COUNT_MANY)
        mni_spill_put(&r->counts, &count, sizeof count);
}

static mn_code give_rows(rows *r) {
    mn_code code = MN_OK;
    for (uint32_t i = 0; i < r->count && code == MN_OK; i++) {
        uint32_t count = r->row[i].simplex_start;
        MN_ASSERT((r->row[i].order == 0) == (r->first + i == 0));
        r->row[i].simplex_start = r->simplices;
        r->simplices += count;
        put_count(r, count);
        code = place_leaf(r, i);
        if (code == MN_OK)
            mni_rowpack_row(&r->out, &r->row[i]);
    }
    return code;
}

/* ---- step 3: simplices ---------------------------------------------------------------------- */

/* The corner outside comes last. Of the corners below the node some are before the row, some not;
 * so the one outside is the first of all, or the last. */
static mni_row_simplex turned(const uint32_t c[3], uint32_t row) {
    uint32_t least = 0, most = 0, behind = 0;
    for (uint32_t k = 0; k < 3; k++) {
        least = c[k] < c[least] ? k : least;
        most = c[k] > c[most] ? k : most;
        behind += c[k] >= row;
    }
    MN_ASSERT(behind == 1 || behind == 2);
    uint32_t last = behind == 1 ? least : most;
    if (c[2] == MN_NONE)
        last = 2;
    return (mni_row_simplex){{c[(last + 1) % 3], c[(last + 2) % 3], c[last]}};
}

static bool take_simplex(rows *r, const unsigned char **from, uint32_t *last, uint32_t window,
                         uint32_t room) {
    uint32_t i = take_at(from), which = (uint32_t)mni_varint_get(from);
    uint32_t c[3], place = r->id[i] + which - window;
    c[0] = mni_order_get_id(from, last);
    c[1] = mni_unfold(mni_varint_get(from), c[0]);
    uint64_t third = mni_varint_get(from);
    if (place >= room) /* another window's */
        return true;
    c[2] = third == 0 ? MN_NONE : mni_unfold(third, c[0]);
    for (int k = 0; k < (third == 0 ? 2 : 3); k++) {
        const uint32_t *leaf = mni_pages_at(&r->leaf_of, c[k], false);
        if (leaf == NULL)
            return false;
        c[k] = *leaf;
    }
    ((mni_row_simplex *)r->row)[place] = turned(c, r->first + i);
    return true;
}

static mn_code give_window(rows *r, uint32_t bucket, uint32_t window, uint32_t count) {
    mni_order_work *w = r->w;
    mni_bucket_reader from;
    mni_bucket_read(&from, &w->simplex, bucket, r->room);
    do {
        while (from.at < from.end)
            if (!take_simplex(r, &from.at, &from.last, window, count))
                return trouble(&w->leaf_of, w->st);
    } while (mni_bucket_more(&from, &w->simplex));
    if (w->simplex.spill.trouble.code != MN_OK)
        return trouble(&w->simplex.spill, w->st);
    for (uint32_t i = 0; i < count; i++)
        mni_rowpack_simplex(&r->out, (const mni_row_simplex *)r->row + i);
    return MN_OK;
}

/* Where the simplices of each row begin in its bucket; their sum. */
static mn_code take_counts(rows *r, mni_spill_reader *counts, uint32_t *sum) {
    const unsigned char *byte;
    *sum = 0;
    for (uint32_t i = 0; i < r->count; i++) {
        if ((byte = mni_spill_take(counts, 1)) == NULL)
            return trouble(&r->w->counts, r->w->st);
        uint32_t count = *byte;
        if (count == COUNT_MANY) {
            count = 0;
            for (int k = 0; k < 4; k++) {
                if ((byte = mni_spill_take(counts, 1)) == NULL)
                    return trouble(&r->w->counts, r->w->st);
                count |= (uint32_t)*byte << 8 * k;
            }
        }
        r->id[i] = *sum;
        *sum += count;
    }
    return MN_OK;
}

static mn_code give_simplices(rows *r, uint32_t bucket, mni_spill_reader *counts) {
    uint32_t sum, room = r->w->plan.simplices_at_once;
    mn_code code = take_counts(r, counts, &sum);
    for (uint32_t window = 0; window < sum && code == MN_OK; window += room)
        code = give_window(r, bucket, window, sum - window < room ? sum - window : room);
    return code;
}

/* ---- both ----------------------------------------------------------------------------------- */

static void go_to_bucket(rows *r, uint32_t bucket) {
    uint32_t vertices = (uint32_t)r->w->mesh->vertices, size = 1u << r->w->plan.bits;
    r->first = bucket << r->w->plan.bits;
    r->count = vertices - r->first < size ? vertices - r->first : size;
}

static void open_rows(rows *r, mni_arena *arena, void *buffer[3]) {
    mni_order_work *w = r->w;
    const mni_order_plan *p = &w->plan;
    size_t size = (size_t)1 << p->bits;
    for (int i = 0; i < 3; i++)
        buffer[i] = mni_arena_take(arena, MNI_ORDER_BUFFER_BYTES, 1, ALIGN);
    r->row = mni_arena_take(arena, size, sizeof *r->row, ALIGN);
    r->id = mni_arena_take(arena, size, sizeof *r->id, ALIGN);
    r->room = mni_arena_take(arena, p->chunk_bytes, 1, ALIGN);
    mni_pages_open(&r->vertex, &w->mesh->vertex, sizeof(mni_extvertex), 4 * PAGE_BYTES,
                   w->mesh->vertices, arena, p->vertices_bytes);
    mni_pages_open(&r->leaf_of, &w->leaf_of, sizeof(uint32_t), PAGE_BYTES, w->mesh->vertices, arena,
                   p->leaves_bytes);
    mni_spill_writer_open(&r->counts, &w->counts, buffer[1], MNI_ORDER_BUFFER_BYTES);
    const mni_rowpack_buffer places = {mni_arena_take(arena, MNI_ORDER_PLACES_BYTES, 1, ALIGN),
                                       MNI_ORDER_PLACES_BYTES};
    mni_rowpack_open(&r->out, &w->out->file,
                     (mni_rowpack_buffer){buffer[0], MNI_ORDER_BUFFER_BYTES}, &w->places, places,
                     w->mesh->grid_step);
}

static mn_code all_rows(rows *r) {
    mni_order_work *w = r->w;
    mn_code code = MN_OK;
    for (uint32_t b = 0; b < w->plan.buckets && code == MN_OK; b++) {
        go_to_bucket(r, b);
        code = load_rows(r, b);
        if (code == MN_OK)
            code = give_rows(r);
        if (code == MN_OK)
            code = mni_order_tell(w, w->mesh->vertices + r->first);
    }
    MN_ASSERT(code != MN_OK || r->simplices == w->history->killed_count);
    if (code == MN_OK && mni_spill_end(&r->counts) != MN_OK)
        code = trouble(&w->counts, w->st);
    return code;
}

static mn_code all_simplices(rows *r, void *buffer) {
    mni_order_work *w = r->w;
    mni_spill_reader counts;
    mn_code code = MN_OK;
    mni_spill_reader_open(&counts, &w->counts, 0, w->counts.size_bytes, buffer,
                          MNI_ORDER_BUFFER_BYTES, true);
    for (uint32_t b = 0; b < w->plan.buckets && code == MN_OK; b++) {
        go_to_bucket(r, b);
        code = give_simplices(r, b, &counts);
        if (code == MN_OK)
            code = mni_order_tell(w, 2 * w->mesh->vertices + r->first);
    }
    return code;
}

mn_code mni_order_rows(mni_order_work *w) {
    mni_arena arena;
    void *buffer[3];
    rows r = {.w = w};
    mn_code code = mni_arena_open(&arena, w->plan.rows_bytes, w->st);
    if (code != MN_OK)
        return code;
    open_rows(&r, &arena, buffer);
    code = all_rows(&r);
    if (code == MN_OK)
        code = all_simplices(&r, buffer[2]);
    if (code == MN_OK)
        code = mni_rowpack_end(&r.out, (mni_rowpack_buffer){buffer[2], MNI_ORDER_BUFFER_BYTES},
                               w->out->sum, w->st);
    mni_arena_close(&arena);
    return code;
}
