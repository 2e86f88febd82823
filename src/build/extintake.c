/* The intake of meshes larger than memory: see extintake.h for the way that everything goes. Here:
 * what readers push goes to disk as it is, 16 bytes a vertex and 12 a triangle; and which step
 * comes when. Secret: that vertices are narrow until the first that floats do not hold. Memory:
 * shares of work_bytes. One thread. (design.md §3.1, §3.3) */
#include "extintake.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "reader.h"

enum { BUFFERS_SHARE = 8, BUFFER_BYTES_MAX = 1 << 20, MAP_SHARE = 2, BUCKETS_SHARE = 4 };

/* A multiple of all records that are read or written here: 4, 12, 16, 20, 32 bytes. */
#define BUFFER_UNIT 480

bool mni_ext_sort_open(mni_extintake *x, mni_sort **sort, uint32_t record_bytes, mni_sort_key key,
                       mni_ext_share share) {
    const mni_sort_desc desc = {.record_bytes = record_bytes,
                                .key = key,
                                .budget_bytes = x->desc.work_bytes / share,
                                .temp_dir = x->desc.temp_dir};
    return mni_sort_open(sort, &desc, x->st) == MN_OK;
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

bool mni_ext_bucket_put(mni_extintake *x, uint64_t bucket, const void *bytes, size_t count) {
    mni_ext_bucket *b = &x->bucket[bucket];
    if (b->spill.fd < 0) {
        if (!mni_ext_spill_open(x, &b->spill))
            return false;
        mni_spill_writer_open(&b->to, &b->spill, b->buffer, x->bucket_bytes);
    }
    mni_spill_put(&b->to, bytes, count);
    return true;
}

void mni_ext_too_small(mni_extintake *x, uint64_t vertices, uint64_t work_bytes) {
    uint64_t ram = work_bytes + x->desc.beside_bytes, unit = 1 << 20;
    mn_fail(x->st, MN_CAP_TOO_SMALL,
            "%s: %llu vertices are too many for that memory: try --ram %lluM", x->name,
            (unsigned long long)vertices, (unsigned long long)((ram + unit - 1) / unit));
}

/* ---- open, close ----------------------------------------------------------------------------- */

static bool open_buffers(mni_extintake *x) {
    uint64_t work = x->desc.work_bytes, each = work / BUFFERS_SHARE / MNI_EXT_BUFFERS;
    each = each < BUFFER_BYTES_MAX ? each : BUFFER_BYTES_MAX;
    x->buffer_bytes = each / BUFFER_UNIT * BUFFER_UNIT;
    each = work / BUCKETS_SHARE / MNI_EXT_BUCKETS;
    x->bucket_bytes = (each < BUFFER_BYTES_MAX ? each : BUFFER_BYTES_MAX) / 16 * 16;
    x->window = work / MAP_SHARE / sizeof *x->map / 3 * 3; /* a soup's triangles are not cut */
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
    x->narrow.fd = x->wide.fd = x->sequence.fd = x->placed.fd = -1;
    x->result.vertex.fd = x->result.triangle.fd = -1;
    for (int i = 0; i < MNI_EXT_BUCKETS; i++)
        x->bucket[i].spill.fd = -1;
    for (int i = 0; i < 3; i++) {
        x->low[i] = INFINITY;
        x->high[i] = -INFINITY;
    }
    if (!open_buffers(x) || !mni_ext_spill_open(x, &x->narrow)) {
        mni_extintake_close(x);
        return NULL;
    }
    mni_spill_writer_open(&x->to_narrow, &x->narrow, x->buffer[0], x->buffer_bytes);
    mni_spill_writer_open(&x->to_sequence, &x->sequence, x->buffer[1], x->buffer_bytes);
    mni_spill_writer_open(&x->to_wide, &x->wide, x->buffer[2], x->buffer_bytes);
    return x;
}

void mni_extintake_close(mni_extintake *x) {
    if (x == NULL)
        return;
    mni_spill *spills[] = {&x->narrow, &x->wide, &x->sequence, &x->placed};
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
    return mni_ext_spill_good(x, &x->narrow) && mni_ext_spill_good(x, &x->wide) &&
           mni_ext_spill_good(x, &x->sequence);
}

static bool is_float(double x) {
    return (double)(float)x == x;
}

bool mni_extintake_vertex(mni_extintake *x, const double position[3], uint32_t rgba) {
    double p[3] = {position[0], position[1], position[2]};
    bool finite = mni_weld_normalise(p),
         narrow = is_float(p[0]) && is_float(p[1]) && is_float(p[2]);
    x->nonfinite += !finite;
    x->has_colors |= rgba != MNI_WHITE;
    for (int i = 0; i < 3 && finite; i++) {
        x->low[i] = p[i] < x->low[i] ? p[i] : x->low[i];
        x->high[i] = p[i] > x->high[i] ? p[i] : x->high[i];
    }
    if (x->wide.fd < 0 && (narrow || !finite)) {
        mni_ext_narrow v = {{(float)p[0], (float)p[1], (float)p[2]}, rgba};
        mni_spill_put(&x->to_narrow, &v, sizeof v);
        x->narrow_vertices++;
    } else {
        mni_ext_wide v = {{p[0], p[1], p[2]}, rgba, 0};
        if (x->wide.fd < 0 && !mni_ext_spill_open(x, &x->wide))
            return false;
        mni_spill_put(&x->to_wide, &v, sizeof v);
    }
    x->vertices++;
    return x->vertices % 1024 != 0 || written(x);
}

/* Into its bucket. One past all buckets is too many vertices, or none: known when all have come. */
static bool put_corner(mni_extintake *x, uint32_t vertex, uint64_t corner) {
    uint64_t to = vertex / x->window;
    uint8_t bucket = to < MNI_EXT_BUCKETS ? (uint8_t)to : MNI_EXT_BUCKETS - 1;
    if (bucket > 0 && x->sequence.fd < 0) {
        x->sequence_begin = corner;
        if (!mni_ext_spill_open(x, &x->sequence))
            return false;
    }
    if (x->sequence.fd >= 0)
        mni_spill_put(&x->to_sequence, &bucket, 1);
    return mni_ext_bucket_put(x, bucket, &vertex, sizeof vertex);
}

bool mni_extintake_triangle(mni_extintake *x, uint32_t a, uint32_t b, uint32_t c) {
    const uint32_t corner[3] = {a, b, c};
    x->counts.input_faces++;
    if (a == MN_NONE) {
        x->counts.degenerate_faces++;
        return true;
    }
    for (uint32_t i = 0; i < 3 && !x->soup; i++)
        if (!put_corner(x, corner[i], 3 * x->triangles + i))
            return false;
    x->triangles++;
    return x->triangles % 1024 != 0 || written(x);
}

/* ---- the steps ------------------------------------------------------------------------------- */

static bool end_pushing(mni_extintake *x) {
    mni_spill_end(&x->to_narrow);
    if (x->wide.fd >= 0)
        mni_spill_end(&x->to_wide);
    if (x->sequence.fd >= 0)
        mni_spill_end(&x->to_sequence);
    for (int i = 0; i < MNI_EXT_BUCKETS; i++) {
        mni_ext_bucket *b = &x->bucket[i];
        if (b->spill.fd >= 0)
            mni_spill_end(&b->to);
        b->pairs = b->spill.size_bytes;
    }
    if (x->vertices <= MNI_EXT_BUCKETS * x->window)
        return written(x);
    /* a soup has few places to its corners */
    mni_ext_too_small(x, x->vertices, x->soup ? x->vertices / 4 : x->vertices + x->vertices / 8);
    return false;
}

bool mni_extintake_finish(mni_extintake *x, mni_extmesh *out) {
    if (!end_pushing(x) || !mni_ext_place_vertices(x) || !mni_ext_place_triangles(x) ||
        !mni_ext_faces_finish(x))
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
