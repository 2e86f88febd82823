/* The intake of meshes larger than memory: see extintake.h for the way that everything goes. Here:
 * what readers push goes to disk, and which step comes when. A triangle goes to the bucket of its
 * corners, most often one; otherwise each corner goes to its own, and which these were is kept:
 *
 *   item:      triangle: (number - last one's) × 2, first - last corner, next, last - first
 *              lone corner: 1, corner - last corner
 *   sequence:  number - last one's, and a byte a corner
 *
 * Secret: items, and how many vertices a bucket has: all, if their map has room, as vertices
 * nearly always come before the first triangle. Memory: shares of work_bytes. One thread.
 * (design.md §3.1, §3.3) */
#include "extintake.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "reader.h"

enum { BUFFER_BYTES_MAX = 1 << 20, BUFFER_UNIT = 16 /* a vertex, as it is kept */ };

static uint64_t at_least(uint64_t bytes, uint64_t least) {
    return bytes > least ? bytes : least;
}

bool mni_ext_sort_open(mni_extintake *x, mni_sort **sort, const mni_sort_desc *desc) {
    mni_sort_desc d = *desc;
    d.temp_dir = x->desc.temp_dir;
    if (d.after_bytes > 0)
        d.after_bytes = at_least(d.after_bytes, MNI_SORT_BUDGET_MIN);
    d.budget_bytes = at_least(d.budget_bytes, at_least(d.after_bytes, MNI_SORT_BUDGET_MIN));
    return mni_sort_open(sort, &d, x->st) == MN_OK;
}

void mni_ext_sort_close(mni_extintake *x, mni_sort **sort) {
    if (*sort == NULL)
        return;
    mni_sort_figures f = mni_sort_figures_get(*sort);
    x->result.bytes_read += f.bytes_read;
    x->result.bytes_written += f.bytes_written;
    mni_sort_close(*sort);
    *sort = NULL;
}

bool mni_ext_spill_open(mni_extintake *x, mni_spill *spill) {
    return mni_spill_open(spill, x->desc.temp_dir, x->st) == MN_OK;
}

void mni_ext_spill_close(mni_extintake *x, mni_spill *spill) {
    if (spill->fd < 0)
        return;
    x->result.bytes_read += spill->bytes_read;
    x->result.bytes_written += spill->bytes_written;
    mni_spill_close(spill);
}

bool mni_ext_spill_good(mni_extintake *x, const mni_spill *spill) {
    if (spill->trouble.code != MN_OK)
        mn_fail(x->st, spill->trouble.code, "%s", spill->trouble.text);
    return spill->trouble.code == MN_OK;
}

mni_spill_writer *mni_ext_bucket_writer(mni_extintake *x, uint64_t bucket) {
    mni_ext_bucket *b = &x->bucket[bucket];
    if (b->spill.fd < 0) {
        if (!mni_ext_spill_open(x, &b->spill))
            return NULL;
        mni_spill_writer_open(&b->to, &b->spill, b->buffer, x->bucket_bytes);
    }
    return &b->to;
}

void mni_ext_too_small(mni_extintake *x, uint64_t vertices, uint64_t work_bytes) {
    mn_fail(x->st, MN_CAP_TOO_SMALL, "%s: %llu vertices are too many for that memory: try %s %lluM",
            x->name, (unsigned long long)vertices, mni_cap_option(&x->desc.cap),
            mni_cap_megabytes(&x->desc.cap, work_bytes));
}

/* ---- open, close ----------------------------------------------------------------------------- */

static bool open_buffers(mni_extintake *x) {
    uint64_t each = mni_ext_share(x, MNI_EXT_BUFFERS_SHARE) / MNI_EXT_BUFFERS;
    each = each < BUFFER_BYTES_MAX ? each : BUFFER_BYTES_MAX;
    x->buffer_bytes = each / BUFFER_UNIT * BUFFER_UNIT;
    each = mni_ext_share(x, MNI_EXT_BUCKETS_SHARE) / MNI_EXT_BUCKETS;
    each = each < BUFFER_BYTES_MAX ? each : BUFFER_BYTES_MAX;
    x->bucket_bytes = each / BUFFER_UNIT * BUFFER_UNIT;
    uint64_t bytes =
        MNI_EXT_BUFFERS * (x->buffer_bytes + 16) + MNI_EXT_BUCKETS * x->bucket_bytes + 16;
    if (mni_arena_open(&x->arena, bytes, x->st) != MN_OK)
        return false;
    for (int i = 0; i < MNI_EXT_BUFFERS; i++)
        x->buffer[i] = mni_arena_take(&x->arena, x->buffer_bytes, 1, 16);
    for (int i = 0; i < MNI_EXT_BUCKETS; i++)
        x->bucket[i].buffer = mni_arena_take(&x->arena, x->bucket_bytes, 1, 16);
    return true;
}

mni_extintake *mni_extintake_open(const mni_extmesh_desc *desc, const mn_read_desc *read, bool soup,
                                  const char *name, mn_status *st) {
    MN_ASSERT(desc->work_bytes >= MNI_EXTMESH_WORK_MIN);
    mni_extintake *x = calloc(1, sizeof *x);
    if (x == NULL) {
        mn_fail(st, MN_FAILED, "%s: no memory", name);
        return NULL;
    }
    x->desc = *desc;
    x->soup = soup;
    x->apart = read->weld == MN_WELD_OFF && !soup;
    x->result.welded = !x->apart;
    x->name = name;
    x->st = st;
    x->pushed.fd = x->sequence.fd = x->placed.fd = -1;
    x->result.vertex.fd = x->result.triangle.fd = -1;
    for (int i = 0; i < MNI_EXT_BUCKETS; i++)
        x->bucket[i].spill.fd = -1;
    for (int i = 0; i < 3; i++) {
        x->low[i] = INFINITY;
        x->high[i] = -INFINITY;
    }
    if (!open_buffers(x) || !mni_ext_spill_open(x, &x->pushed)) {
        mni_extintake_close(x);
        return NULL;
    }
    mni_spill_writer_open(&x->to_pushed, &x->pushed, x->buffer[0], x->buffer_bytes);
    mni_spill_writer_open(&x->to_sequence, &x->sequence, x->buffer[1], x->buffer_bytes);
    return x;
}

void mni_extintake_close(mni_extintake *x) {
    if (x == NULL)
        return;
    mni_ext_sorting_stop(x);
    mni_ext_judge_end(x);
    mni_ext_vertices_stop(x);
    mni_spill *spills[] = {&x->pushed, &x->sequence, &x->placed};
    for (size_t i = 0; i < sizeof spills / sizeof spills[0]; i++)
        mni_spill_close(spills[i]);
    for (int i = 0; i < MNI_EXT_BUCKETS; i++)
        mni_spill_close(&x->bucket[i].spill);
    mni_sort_close(x->triangle_sort);
    mni_ext_edges_close(x);
    mni_extmesh_close(&x->result);
    free(x->map);
    free(x->used);
    mni_arena_close(&x->arena);
    free(x);
}

void mni_extmesh_close(mni_extmesh *mesh) {
    mni_spill_close(&mesh->vertex);
    mni_spill_close(&mesh->triangle);
}

/* ---- pushing --------------------------------------------------------------------------------- */

/* Looks at the disk's answers now and then: a reader is to stop when the disk is full. */
static bool written(mni_extintake *x) {
    for (int i = 0; i < MNI_EXT_BUCKETS; i++)
        if (!mni_ext_spill_good(x, &x->bucket[i].spill))
            return false;
    return mni_ext_spill_good(x, &x->pushed) && mni_ext_spill_good(x, &x->sequence);
}

bool mni_extintake_vertex(mni_extintake *x, const double position[3], uint32_t rgba) {
    double p[3] = {position[0], position[1], position[2]};
    mni_ext_sorting_stop(x);
    bool finite = mni_weld_normalise(p),
         narrow = mni_ext_is_float(p[0]) && mni_ext_is_float(p[1]) && mni_ext_is_float(p[2]);
    x->nonfinite += !finite;
    x->has_colors |= rgba != MNI_WHITE;
    for (int i = 0; i < 3 && finite; i++) {
        x->low[i] = p[i] < x->low[i] ? p[i] : x->low[i];
        x->high[i] = p[i] > x->high[i] ? p[i] : x->high[i];
    }
    const bool wide = mni_ext_is_wide(x) || (finite && !narrow);
    mni_ext_put(&x->to_pushed, &x->last, wide, &(mni_ext_vertex){{p[0], p[1], p[2]}, rgba});
    x->narrow_vertices += !wide;
    x->vertices++;
    return x->vertices % 1024 != 0 || written(x);
}

static void choose_window(mni_extintake *x) {
    const uint64_t all = mni_ext_share(x, MNI_EXT_MAP_SHARE) / sizeof *x->map;
    x->window =
        x->vertices <= all ? all : mni_ext_share(x, MNI_EXT_MAP_PART_SHARE) / sizeof *x->map;
    x->window = x->window / 3 * 3; /* a soup's triangles are not cut */
}

/* One past all buckets is too many vertices, or none: known when all have come. */
static uint8_t bucket_of(const mni_extintake *x, uint32_t vertex) {
    uint64_t to = vertex / x->window;
    return to < MNI_EXT_BUCKETS ? (uint8_t)to : MNI_EXT_BUCKETS - 1;
}

static bool put_item(mni_extintake *x, uint8_t bucket, const mni_ext_item *item) {
    mni_spill_writer *w = mni_ext_bucket_writer(x, bucket);
    const uint32_t *c = item->corner;
    uint32_t *last = x->bucket[bucket].last;
    unsigned char packed[MNI_EXT_ITEM_MAX], *to = packed;
    if (w == NULL)
        return false;
    to = mni_varint_put(to, item->lone ? 1 : 2 * (uint64_t)(item->number - last[0]));
    to = mni_varint_put(to, mni_fold(c[0], last[1]));
    last[1] = c[0];
    if (!item->lone) {
        last[0] = item->number;
        to = mni_varint_put(to, mni_fold(c[1], c[0]));
        to = mni_varint_put(to, mni_fold(c[2], c[0]));
    }
    mni_spill_put(w, packed, (size_t)(to - packed));
    return true;
}

const unsigned char *mni_ext_item_get(const unsigned char *from, mni_ext_item *item,
                                      uint32_t last[2]) {
    const uint64_t code = mni_varint_get(&from);
    uint32_t *c = item->corner;
    item->lone = code == 1;
    c[0] = last[1] = mni_unfold(mni_varint_get(&from), last[1]);
    if (!item->lone) {
        item->number = last[0] += (uint32_t)(code / 2);
        c[1] = mni_unfold(mni_varint_get(&from), c[0]);
        c[2] = mni_unfold(mni_varint_get(&from), c[0]);
    }
    return from;
}

static bool put_triangle(mni_extintake *x, const uint32_t corner[3]) {
    const uint32_t number = (uint32_t)x->triangles;
    if (x->window == 0) {
        choose_window(x);
        if (!mni_ext_sorting_begin(x))
            return false;
    }
    const uint8_t bucket[3] = {bucket_of(x, corner[0]), bucket_of(x, corner[1]),
                               bucket_of(x, corner[2])};
    if (bucket[0] == bucket[1] && bucket[1] == bucket[2])
        return put_item(x, bucket[0],
                        &(mni_ext_item){false, number, {corner[0], corner[1], corner[2]}});
    if (x->sequence.fd < 0 && !mni_ext_spill_open(x, &x->sequence))
        return false;
    unsigned char packed[MNI_VARINT32_MAX];
    unsigned char *to = mni_varint_put(packed, number - x->last_in_sequence);
    mni_spill_put(&x->to_sequence, packed, (size_t)(to - packed));
    mni_spill_put(&x->to_sequence, bucket, sizeof bucket);
    x->last_in_sequence = number;
    for (int i = 0; i < 3; i++)
        if (!put_item(x, bucket[i], &(mni_ext_item){true, 0, {corner[i]}}))
            return false;
    return true;
}

bool mni_extintake_triangle(mni_extintake *x, uint32_t a, uint32_t b, uint32_t c) {
    const uint32_t corner[3] = {a, b, c};
    x->counts.input_faces++;
    if (a == MN_NONE) {
        x->counts.degenerate_faces++;
        return true;
    }
    if (!x->soup && !put_triangle(x, corner))
        return false;
    x->triangles++;
    return x->triangles % 1024 != 0 || written(x);
}

/* ---- the steps ------------------------------------------------------------------------------- */

static bool end_pushing(mni_extintake *x) {
    mni_spill_end(&x->to_pushed);
    if (x->window == 0)
        choose_window(x);
    if (x->sequence.fd >= 0)
        mni_spill_end(&x->to_sequence);
    for (int i = 0; i < MNI_EXT_BUCKETS; i++) {
        mni_ext_bucket *b = &x->bucket[i];
        if (b->spill.fd >= 0)
            mni_spill_end(&b->to);
        b->pairs = b->spill.size_bytes;
        memset(b->last, 0, sizeof b->last);
    }
    if (x->vertices <= MNI_EXT_BUCKETS * x->window)
        return written(x);
    /* a soup has few places to its corners */
    mni_ext_too_small(x, x->vertices, x->soup ? x->vertices / 4 : x->vertices + x->vertices / 8);
    return false;
}

bool mni_extintake_finish(mni_extintake *x, mni_extmesh *out) {
    if (!end_pushing(x) || !mni_ext_place_vertices(x) || !mni_ext_place_triangles(x) ||
        !mni_ext_faces_judged(x) || !mni_ext_vertices_begin(x) || !mni_ext_faces_finish(x) ||
        !mni_ext_vertices_finish(x))
        return false;
    MN_ASSERT(x->counts.input_faces == x->result.triangles + x->counts.duplicate_faces +
                                           x->counts.degenerate_faces + x->counts.nonfinite_faces);
    x->result.intake = x->counts;
    x->result.has_colors = x->has_colors;
    x->result.bytes_read += x->result.vertex.bytes_read + x->result.triangle.bytes_read;
    x->result.bytes_written += x->result.vertex.bytes_written + x->result.triangle.bytes_written;
    *out = x->result;
    x->result.vertex.fd = x->result.triangle.fd = -1;
    return true;
}
