/* Numbers for vertices and corners, outside memory: see extintake.h.
 *
 * Vertices are sorted by where they lie along a Z-order curve through the box of all, and by a hash
 * of their position where they share a cell of it; equal positions are then neighbours, the first
 * of the input first, and their rank is their place. The map from pushed vertices to places is an
 * array where it fits. Else it is sorted by vertex, corners are sorted by vertex, the two are read
 * side by side, and what comes out, corners with their places, is sorted back into the input's
 * order. A soup's corners are its vertices, and need the last of these sorts only.
 *
 * Secret: the curve, the join. One thread. (design.md §3.1, §3.3) */
#include "extintake.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <xxhash.h>

#include "assert.h"
#include "reader.h"

enum {
    AXIS_BITS = 21,    /* 3 × 21 fit a word */
    SAME_KEY_MAX = 16, /* different positions of one cell and one hash of 64 bits: hardly two */
    MAP_SHARE = 2,
};

typedef struct entry { /* what is sorted; wide ones have all of it */
    uint64_t cell, hash;
    uint32_t number, rgba;
    union {
        float narrow[3];
        double wide[3];
    } at;
} entry;
#define NARROW_BYTES (offsetof(entry, at) + 3 * sizeof(float))
#define WIDE_BYTES (offsetof(entry, at) + 3 * sizeof(double))

/* number → place, or vertex → corner, or corner → place. */
typedef struct pair {
    uint32_t from, to;
} pair;

/* Every third bit. */
static uint64_t spread(uint64_t x) {
    x = (x | x << 32) & UINT64_C(0x001f00000000ffff);
    x = (x | x << 16) & UINT64_C(0x001f0000ff0000ff);
    x = (x | x << 8) & UINT64_C(0x100f00f00f00f00f);
    x = (x | x << 4) & UINT64_C(0x10c30c30c30c30c3);
    return (x | x << 2) & UINT64_C(0x1249249249249249);
}

static uint64_t cell_of(const mni_extintake *x, double scale, const double p[3]) {
    uint64_t cell = 0;
    for (int i = 0; i < 3; i++) {
        double step = (p[i] - x->low[i]) * scale;
        uint64_t q = step >= (1 << AXIS_BITS) - 1 ? (1 << AXIS_BITS) - 1 : (uint64_t)step;
        cell |= spread(q) << i;
    }
    return cell;
}

static bool map_vertex(mni_extintake *x, uint32_t number, uint32_t place) {
    const pair p = {number, place};
    if (x->map != NULL)
        x->map[number] = place;
    else
        mni_sort_put(x->map_sort, &p);
    return true;
}

static bool open_map(mni_extintake *x) {
    uint64_t bytes = x->vertices * sizeof *x->map;
    if (bytes > x->desc.work_bytes / MAP_SHARE)
        return mni_ext_sort_open(x, &x->map_sort, sizeof(pair), MNI_SORT_U32, MNI_EXT_QUARTER);
    x->map = malloc(bytes + 1);
    if (x->map == NULL)
        mn_fail(x->st, MN_FAILED, "%s: no memory", x->name);
    return x->map != NULL;
}

/* ---- vertices ------------------------------------------------------------------------------- */

static void sort_vertex(mni_extintake *x, mni_sort *sort, double scale, const double p[3],
                        uint32_t rgba, uint64_t number) {
    if (isnan(p[0])) {
        map_vertex(x, (uint32_t)number, MN_NONE);
        return;
    }
    entry e = {.cell = cell_of(x, scale, p), .number = (uint32_t)number, .rgba = rgba};
    e.hash = x->apart ? number : XXH3_64bits(p, 3 * sizeof *p);
    if (mni_ext_is_wide(x))
        memcpy(e.at.wide, p, sizeof e.at.wide);
    else
        for (int i = 0; i < 3; i++)
            e.at.narrow[i] = (float)p[i];
    mni_sort_put(sort, &e);
}

static bool sort_vertices(mni_extintake *x, mni_sort *sort) {
    double size =
        fmax(fmax(x->high[0] - x->low[0], x->high[1] - x->low[1]), x->high[2] - x->low[2]);
    double scale = size > 0 ? ldexp(1, AXIS_BITS) / size : 0;
    mni_spill_reader r;
    uint64_t number = 0;
    const mni_ext_narrow *narrow;
    mni_spill_reader_open(&r, &x->narrow, 0, x->narrow.size_bytes, x->buffer[0], x->buffer_bytes,
                          true);
    while ((narrow = mni_spill_take(&r, sizeof *narrow)) != NULL) {
        const double p[3] = {narrow->position[0], narrow->position[1], narrow->position[2]};
        sort_vertex(x, sort, scale, p, narrow->rgba, number++);
    }
    bool good = mni_ext_spill_good(x, &x->narrow);
    mni_ext_spill_close(x, &x->narrow);
    if (x->wide.fd >= 0 && good) {
        const mni_ext_wide *wide;
        mni_spill_reader_open(&r, &x->wide, 0, x->wide.size_bytes, x->buffer[0], x->buffer_bytes,
                              true);
        while ((wide = mni_spill_take(&r, sizeof *wide)) != NULL)
            sort_vertex(x, sort, scale, wide->position, wide->rgba, number++);
        good = mni_ext_spill_good(x, &x->wide);
    }
    mni_ext_spill_close(x, &x->wide);
    MN_ASSERT(!good || number == x->vertices);
    return good;
}

static void write_place(mni_extintake *x, mni_spill_writer *w, const entry *e) {
    if (mni_ext_is_wide(x)) {
        mni_ext_wide v = {{e->at.wide[0], e->at.wide[1], e->at.wide[2]}, e->rgba, e->number};
        mni_spill_put(w, &v, sizeof v);
    } else {
        mni_extvertex v = {{e->at.narrow[0], e->at.narrow[1], e->at.narrow[2]}, e->rgba, e->number};
        mni_spill_put(w, &v, sizeof v);
    }
}

/* In order: the first of each position becomes a place. */
static bool weld_sorted(mni_extintake *x, mni_sort *sort) {
    size_t bytes = mni_ext_is_wide(x) ? WIDE_BYTES : NARROW_BYTES, at = offsetof(entry, at);
    entry same[SAME_KEY_MAX], e; /* places of this cell and hash, the last ones */
    uint32_t count = 0;
    const void *record;
    mni_spill_writer w;
    mni_spill_writer_open(&w, &x->placed, x->buffer[1], x->buffer_bytes);
    while ((record = mni_sort_next(sort, x->st)) != NULL) {
        memcpy(&e, record, bytes);
        if (count > 0 && (same[0].cell != e.cell || same[0].hash != e.hash))
            count = 0;
        uint32_t i = 0;
        while (i < count &&
               memcmp((const char *)&same[i] + at, (const char *)&e + at, bytes - at) != 0)
            i++;
        if (i == SAME_KEY_MAX) {
            mn_fail(x->st, MN_BAD_INPUT, "%s: made to collide: its vertices cannot be told apart",
                    x->name);
            return false;
        }
        if (i == count) {
            same[count++] = e;
            write_place(x, &w, &e);
            x->places++;
        }
        map_vertex(x, e.number, (uint32_t)(x->places - count + i));
    }
    mni_spill_end(&w);
    return x->st->code == MN_OK && mni_ext_spill_good(x, &x->placed);
}

bool mni_ext_place_vertices(mni_extintake *x) {
    mni_sort *sort = NULL;
    uint32_t bytes = (uint32_t)(mni_ext_is_wide(x) ? WIDE_BYTES : NARROW_BYTES);
    bool ok = open_map(x) && mni_ext_spill_open(x, &x->placed) &&
              mni_ext_sort_open(x, &sort, bytes, MNI_SORT_U128, MNI_EXT_QUARTER) &&
              sort_vertices(x, sort) && mni_sort_finish(sort, x->st) == MN_OK &&
              weld_sorted(x, sort);
    mni_ext_sort_close(x, &sort);
    x->counts.welded_vertices = x->vertices - x->nonfinite - x->places;
    return ok;
}

/* ---- corners -------------------------------------------------------------------------------- */

static void read_corners(mni_extintake *x, mni_spill_reader *r) {
    mni_spill_reader_open(r, &x->corners, 0, x->corners.size_bytes, x->buffer[0], x->buffer_bytes,
                          true);
}

static bool triangles_by_map(mni_extintake *x) {
    mni_spill_reader r;
    if (!x->soup)
        read_corners(x, &r);
    for (uint64_t t = 0; t < x->triangles; t++) {
        const uint32_t of_soup[3] = {(uint32_t)(3 * t), (uint32_t)(3 * t + 1),
                                     (uint32_t)(3 * t + 2)};
        const uint32_t *corner = x->soup ? of_soup : mni_spill_take(&r, 3 * sizeof *corner);
        if (corner == NULL)
            break;
        const uint32_t place[3] = {x->map[corner[0]], x->map[corner[1]], x->map[corner[2]]};
        mni_ext_judge(x, place, (uint32_t)t);
    }
    return mni_ext_spill_good(x, &x->corners);
}

/* Corners by the vertex that they name. */
static bool sort_corners(mni_extintake *x) {
    mni_spill_reader r;
    const uint32_t *corner;
    uint32_t number = 0;
    if (!mni_ext_sort_open(x, &x->corner_sort, sizeof(pair), MNI_SORT_U32, MNI_EXT_QUARTER))
        return false;
    read_corners(x, &r);
    while ((corner = mni_spill_take(&r, sizeof *corner)) != NULL) {
        const pair p = {*corner, number++};
        mni_sort_put(x->corner_sort, &p);
    }
    bool good = mni_ext_spill_good(x, &x->corners);
    mni_ext_spill_close(x, &x->corners);
    return good && mni_sort_finish(x->corner_sort, x->st) == MN_OK;
}

/* Corners and map side by side, both by vertex; what is found goes into `back`, by corner. */
static bool join(mni_extintake *x, mni_sort *back) {
    const pair *corner, *vertex = NULL;
    while ((corner = mni_sort_next(x->corner_sort, x->st)) != NULL) {
        while (vertex == NULL || vertex->from < corner->from)
            if ((vertex = mni_sort_next(x->map_sort, x->st)) == NULL)
                return false;
        MN_ASSERT(vertex->from == corner->from); /* readers push no other */
        const pair found = {corner->to, vertex->to};
        mni_sort_put(back, &found);
    }
    return x->st->code == MN_OK && mni_sort_finish(back, x->st) == MN_OK;
}

static bool triangles_by_sorts(mni_extintake *x) {
    if (mni_sort_finish(x->map_sort, x->st) != MN_OK)
        return false;
    if (!x->soup) {
        mni_sort *back = NULL;
        bool ok = sort_corners(x) &&
                  mni_ext_sort_open(x, &back, sizeof(pair), MNI_SORT_U32, MNI_EXT_QUARTER) &&
                  join(x, back);
        mni_ext_sort_close(x, &x->corner_sort);
        mni_ext_sort_close(x, &x->map_sort);
        x->map_sort = back;
        if (!ok)
            return false;
    }
    if (!mni_ext_faces_open(x))
        return false;
    uint32_t place[3] = {0};
    const pair *p;
    for (uint64_t i = 0; (p = mni_sort_next(x->map_sort, x->st)) != NULL; i++) {
        place[i % 3] = p->to;
        if (i % 3 == 2)
            mni_ext_judge(x, place, (uint32_t)(i / 3));
    }
    mni_ext_sort_close(x, &x->map_sort);
    return x->st->code == MN_OK;
}

bool mni_ext_place_triangles(mni_extintake *x) {
    bool ok = x->map != NULL ? mni_ext_faces_open(x) && triangles_by_map(x) : triangles_by_sorts(x);
    mni_ext_spill_close(x, &x->corners);
    free(x->map);
    x->map = NULL;
    return ok;
}
