/* Steps 2 and 3 of order.c: rows from the first to the last, then their simplices.
 *
 * Hides: how leaves' ids come with the rows. The right child of a row's node begins with the row's
 * leaf: where it is a leaf, it is that one. A left child that is a leaf is the one before. So each
 * leaf's id is told once, by its parent's row, this one or the next, and rows in order are leaves
 * in order.
 *
 * Simplices of a row are counted in step 2, a byte each (255: four more follow), so that in step 3
 * each is put where it belongs at once. A bucket that has more of them than there is room is gone
 * through several times, a window each.
 *
 * One side loads a bucket, or a window, while the other gives away the one before: two threads
 * where there are two (relay.h), otherwise one after the other. Memory: plan.rows_bytes. */
#include "mn_assert.h"
#include "order_parts.h"
#include "relay.h"
#include "rowpack_write.h"
#include "unit.h"

enum { PAGE_BYTES = 1024, COUNT_MANY = 255, ALIGN = 16 };

/* A bucket's rows; in step 3, a window of its simplices. */
typedef struct load {
    uint32_t first, count; /* rows; step 3: simplices */
    mni_row *row;          /* step 3: room for simplices */
    uint32_t *id;          /* of the rows' leaves */
} load;

typedef struct rows {
    mni_order_work *w; /* const but for buckets and counts */
    /* who loads */
    mni_pages vertex, leaf_of;
    void *room; /* a chunk */
    uint32_t bucket, window;
    uint32_t first, count, sum; /* step 3: the bucket's rows, and simplices */
    uint32_t *start;            /* step 3: where each row's simplices begin */
    mni_spill_reader from_counts;
    /* who gives */
    mni_spill_writer counts;
    mni_rowpack_writer out;
    uint32_t simplices;
    /* whose load it is */
    load *now, *next; /* of who gives; of who loads */
    load load[2];     /* both the same memory where there is one thread */
    mni_relay loader;
    load *batch[MNI_RELAY_BATCHES]; /* the relay's */
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

static void take_row(const load *l, const unsigned char **from, uint32_t *last, int unit) {
    uint32_t i = take_at(from), left_leaves = (uint32_t)mni_varint_get(from);
    uint32_t left = take_child(from, left_leaves, last), at = l->first + i;
    if (left_leaves == 0) { /* of the leaf alone */
        l->id[i] = left;
        return;
    }
    uint32_t right_leaves = (uint32_t)mni_varint_get(from);
    uint32_t right = take_child(from, right_leaves, last);
    uint64_t facts;
    memcpy(&facts, *from, sizeof facts);
    facts &= (UINT64_C(1) << 8 * MNI_ORDER_FACTS_BYTES) - 1;
    *from += MNI_ORDER_FACTS_BYTES;
    uint64_t bounds = facts >> MNI_FACTS_VALUE_BITS;
    mni_row *row = &l->row[i];
    row->leaf_lo = at - left_leaves;
    row->leaf_hi = at + right_leaves;
    if (left_leaves > 1)
        row->left = row->leaf_lo + left;
    else if (i > 0)
        l->id[i - 1] = left;
    if (right_leaves > 1)
        row->right = at + right;
    else
        l->id[i] = right;
    row->switch_value = mni_unit_length(mni_facts_value_of(facts & 0x1fff), unit);
    row->radius = mni_unit_length(mni_facts_radius_of(bounds), unit);
    row->cone = mni_facts_cone_of(bounds);
    row->simplex_start = (uint32_t)mni_varint_get(from); /* a count, until rows stand in order */
}

/* Of the bucket's rows, which are `size` unless it is the last. */
static uint32_t first_row(const rows *r, uint32_t bucket, uint32_t *count) {
    uint32_t vertices = (uint32_t)r->w->mesh->vertices, size = 1u << r->w->plan.bits;
    uint32_t first = bucket << r->w->plan.bits;
    *count = vertices - first < size ? vertices - first : size;
    return first;
}

/* The leaf's vertex; and where it stands is written down. */
static bool place_leaf(rows *r, const load *l, uint32_t i) {
    mni_order_work *w = r->w;
    MN_ASSERT(l->id[i] < w->mesh->vertices);
    const mni_extvertex *v = mni_pages_at(&r->vertex, l->id[i], false);
    uint32_t *leaf = mni_pages_at(&r->leaf_of, l->id[i], true);
    if (v == NULL || leaf == NULL)
        return false;
    for (int c = 0; c < 3; c++) /* -0 becomes 0: blocks hold differences */
        l->row[i].position[c] = mni_unit_length(v->position[c], w->mesh->unit) + 0.0f;
    l->row[i].rgba = w->mesh->has_colors ? v->rgba : UINT32_MAX;
    *leaf = l->first + i;
    return true;
}

/* The next bucket; past the last one, no rows. */
static void load_rows(rows *r, load *l) {
    mni_order_work *w = r->w;
    const int unit = w->mesh->unit;
    mni_bucket_reader from;
    l->count = 0;
    if (r->bucket == w->plan.buckets)
        return;
    l->first = first_row(r, r->bucket, &l->count);
    for (uint32_t i = 0; i < l->count; i++) {
        l->row[i] = (mni_row){.left = MN_NONE, .right = MN_NONE};
        l->id[i] = MN_NONE;
    }
    mni_bucket_read(&from, &w->row, r->bucket, r->room);
    do {
        while (from.at < from.end)
            take_row(l, &from.at, &from.last, unit);
    } while (mni_bucket_more(&from, &w->row));
    mni_bucket_read(&from, &w->ordered, r->bucket++, r->room);
    do {
        while (from.at < from.end) {
            mni_row *row = &l->row[take_at(&from.at)];
            memcpy(&row->order, from.at, sizeof row->order);
            from.at += sizeof row->order;
        }
    } while (mni_bucket_more(&from, &w->ordered));
    if (w->row.spill.trouble.code != MN_OK)
        return; /* ids are missing */
    for (uint32_t i = 0; i < l->count; i++)
        if (!place_leaf(r, l, i))
            return;
}

static void put_count(rows *r, uint32_t count) {
    unsigned char byte = count < COUNT_MANY ? (unsigned char)count : COUNT_MANY;
    mni_spill_put(&r->counts, &byte, 1);
    if (byte == COUNT_MANY)
        mni_spill_put(&r->counts, &count, sizeof count);
}

static void give_rows(rows *r, const load *l) {
    for (uint32_t i = 0; i < l->count; i++) {
        uint32_t count = l->row[i].simplex_start;
        MN_ASSERT((l->row[i].order == 0) == (l->first + i == 0));
        l->row[i].simplex_start = r->simplices;
        r->simplices += count;
        put_count(r, count);
        mni_rowpack_row(&r->out, &l->row[i]);
    }
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

static bool take_simplex(rows *r, const load *l, const unsigned char **from, uint32_t *last) {
    uint32_t i = take_at(from), which = (uint32_t)mni_varint_get(from);
    uint32_t c[3], place = r->start[i] + which - r->window;
    c[0] = mni_order_get_id(from, last);
    c[1] = mni_unfold(mni_varint_get(from), c[0]);
    uint64_t third = mni_varint_get(from);
    if (place >= l->count) /* another window's */
        return true;
    c[2] = third == 0 ? MN_NONE : mni_unfold(third, c[0]);
    for (int k = 0; k < (third == 0 ? 2 : 3); k++) {
        const uint32_t *leaf = mni_pages_at(&r->leaf_of, c[k], false);
        if (leaf == NULL)
            return false;
        c[k] = *leaf;
    }
    ((mni_row_simplex *)l->row)[place] = turned(c, r->first + i);
    return true;
}

/* Where the simplices of each row of the bucket begin in it. */
static bool take_counts(rows *r) {
    const unsigned char *byte;
    r->first = first_row(r, r->bucket, &r->count);
    r->sum = 0;
    for (uint32_t i = 0; i < r->count; i++) {
        if ((byte = mni_spill_take(&r->from_counts, 1)) == NULL)
            return false;
        uint32_t count = *byte;
        if (count == COUNT_MANY) {
            count = 0;
            for (int k = 0; k < 4; k++) {
                if ((byte = mni_spill_take(&r->from_counts, 1)) == NULL)
                    return false;
                count |= (uint32_t)*byte << 8 * k;
            }
        }
        r->start[i] = r->sum;
        r->sum += count;
    }
    return true;
}

/* The next window; past the last one, and after a failure, no simplices. */
static void load_simplices(rows *r, load *l) {
    const mni_order_plan *p = &r->w->plan;
    mni_bucket_reader from;
    l->count = 0;
    for (; r->window >= r->sum; r->bucket++) { /* of the bucket before */
        if (r->bucket == p->buckets || !take_counts(r))
            return;
        r->window = 0;
    }
    l->first = r->first;
    l->count =
        r->sum - r->window < p->simplices_at_once ? r->sum - r->window : p->simplices_at_once;
    mni_bucket_read(&from, &r->w->simplex, r->bucket - 1, r->room);
    do {
        while (from.at < from.end)
            if (!take_simplex(r, l, &from.at, &from.last))
                return;
    } while (mni_bucket_more(&from, &r->w->simplex));
    r->window += l->count;
}

static void give_simplices(rows *r, const load *l) {
    for (uint32_t i = 0; i < l->count; i++)
        mni_rowpack_simplex(&r->out, (const mni_row_simplex *)l->row + i);
}

/* ---- both ----------------------------------------------------------------------------------- */

static void load_next_rows(void *context, void *records, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        load_rows(context, ((load **)records)[i]);
}

static void load_next_simplices(void *context, void *records, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        load_simplices(context, ((load **)records)[i]);
}

/* What failed while it was loaded, if anything did. */
static mn_code loaded(const rows *r) {
    const mni_order_work *w = r->w;
    const mni_spill *from[] = {&w->row.spill, &w->ordered.spill, &w->simplex.spill,
                               &w->leaf_of,   &w->mesh->vertex,  &w->counts};
    for (size_t i = 0; i < sizeof from / sizeof *from; i++)
        if (from[i]->trouble.code != MN_OK)
            return trouble(from[i], w->st);
    return MN_OK;
}

/* Loads until one is empty, giving each away while the next one is loaded. */
static mn_code each_load(rows *r, mni_relay_work loads, void (*give)(rows *, const load *),
                         uint64_t done) {
    const bool ahead = r->w->plan.threads > 1;
    mn_code code;
    r->now = &r->load[0];
    r->next = &r->load[1];
    mni_relay_open(&r->loader, loads, r, sizeof *r->batch, r->batch, sizeof r->batch,
                   r->w->plan.threads);
    mni_relay_put(&r->loader, &r->next);
    for (;;) {
        mni_relay_drain(&r->loader);
        load *const now = r->next;
        r->next = r->now;
        r->now = now;
        code = loaded(r);
        if (code != MN_OK || now->count == 0)
            break;
        if (ahead)
            mni_relay_put(&r->loader, &r->next);
        give(r, now);
        code = mni_order_tell(r->w, done + now->first);
        if (code != MN_OK)
            break;
        if (!ahead)
            mni_relay_put(&r->loader, &r->next);
    }
    mni_relay_close(&r->loader);
    return code;
}

static void open_rows(rows *r, mni_arena *arena, void *buffer[3]) {
    mni_order_work *w = r->w;
    const mni_order_plan *p = &w->plan;
    size_t size = (size_t)1 << p->bits;
    for (int i = 0; i < 3; i++)
        buffer[i] = mni_arena_take(arena, MNI_ORDER_BUFFER_BYTES, 1, ALIGN);
    for (uint32_t i = 0; i < p->threads; i++) {
        r->load[i].row = mni_arena_take(arena, size, sizeof *r->load[i].row, ALIGN);
        r->load[i].id = mni_arena_take(arena, size, sizeof *r->load[i].id, ALIGN);
    }
    if (p->threads < 2)
        r->load[1] = r->load[0];
    r->start = r->load[0].id; /* leaves' ids are in step 2 */
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
    mn_code code = each_load(r, load_next_rows, give_rows, w->mesh->vertices);
    MN_ASSERT(code != MN_OK || r->simplices == w->history->killed_count);
    if (code == MN_OK && mni_spill_end(&r->counts) != MN_OK)
        code = trouble(&w->counts, w->st);
    return code;
}

static mn_code all_simplices(rows *r, void *buffer) {
    mni_order_work *w = r->w;
    mni_spill_reader_open(&r->from_counts, &w->counts, 0, w->counts.size_bytes, buffer,
                          MNI_ORDER_BUFFER_BYTES, true);
    r->bucket = r->window = r->sum = 0;
    return each_load(r, load_next_simplices, give_simplices, 2 * w->mesh->vertices);
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
