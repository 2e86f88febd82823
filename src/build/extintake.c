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

enum { BUFFERS_SHARE = 8, BUFFER_BYTES_MAX = 1 << 20 };

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

/* ---- open, close -------------------------------------------------------------------------------
 */

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
    x->name = name;
    x->st = st;
    x->narrow.fd = x->wide.fd = x->corners.fd = x->placed.fd = -1;
    x->result.vertex.fd = x->result.triangle.fd = -1;
    for (int i = 0; i < 3; i++) {
        x->low[i] = INFINITY;
        x->high[i] = -INFINITY;
    }
    uint64_t each = desc->work_bytes / BUFFERS_SHARE / MNI_EXT_BUFFERS;
    x->buffer_bytes =
        (each < BUFFER_BYTES_MAX ? each : BUFFER_BYTES_MAX) / BUFFER_UNIT * BUFFER_UNIT;
    bool ok = mni_arena_open(&x->arena, MNI_EXT_BUFFERS * (x->buffer_bytes + 16), st) == MN_OK;
    for (int i = 0; i < MNI_EXT_BUFFERS && ok; i++)
        x->buffer[i] = mni_arena_take(&x->arena, x->buffer_bytes, 1, 16);
    ok = ok && mni_ext_spill_open(x, &x->narrow) && (soup || mni_ext_spill_open(x, &x->corners));
    if (!ok) {
        mni_extintake_close(x);
        return NULL;
    }
    mni_spill_writer_open(&x->to_narrow, &x->narrow, x->buffer[0], x->buffer_bytes);
    mni_spill_writer_open(&x->to_corners, &x->corners, x->buffer[1], x->buffer_bytes);
    mni_spill_writer_open(&x->to_wide, &x->wide, x->buffer[2], x->buffer_bytes);
    return x;
}

void mni_extintake_close(mni_extintake *x) {
    if (x == NULL)
        return;
    mni_spill *spills[] = {&x->narrow, &x->wide, &x->corners, &x->placed};
    mni_sort **sorts[] = {&x->map_sort, &x->corner_sort, &x->triangle_sort};
    for (size_t i = 0; i < sizeof spills / sizeof spills[0]; i++)
        mni_spill_close(spills[i]);
    for (size_t i = 0; i < sizeof sorts / sizeof sorts[0]; i++)
        mni_sort_close(*sorts[i]);
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

/* ---- pushing -----------------------------------------------------------------------------------
 */

/* Looks at the disk's answers now and then: a reader is to stop when the disk is full. */
static bool written(mni_extintake *x) {
    return mni_ext_spill_good(x, &x->narrow) && mni_ext_spill_good(x, &x->wide) &&
           mni_ext_spill_good(x, &x->corners);
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

bool mni_extintake_triangle(mni_extintake *x, uint32_t a, uint32_t b, uint32_t c) {
    const uint32_t corner[3] = {a, b, c};
    x->counts.input_faces++;
    if (a == MN_NONE) {
        x->counts.degenerate_faces++;
        return true;
    }
    if (!x->soup)
        mni_spill_put(&x->to_corners, corner, sizeof corner);
    x->triangles++;
    return x->triangles % 1024 != 0 || written(x);
}

/* ---- the steps ---------------------------------------------------------------------------------
 */

static bool end_pushing(mni_extintake *x) {
    mni_spill_end(&x->to_narrow);
    if (x->corners.fd >= 0)
        mni_spill_end(&x->to_corners);
    if (x->wide.fd >= 0)
        mni_spill_end(&x->to_wide);
    return written(x);
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
