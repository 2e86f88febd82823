/* Numbers for vertices and corners, outside memory: see extintake.h.
 *
 * Vertices are sorted by where they lie along a Z-order curve through the box of all, and by a hash
 * of their position where they share a cell of it; equal positions are then neighbours, the first
 * of the input first, and their rank is their place.
 *
 * The map from pushed vertices to places is an array, of one bucket's vertices at a time: pairs of
 * vertex and place went to their buckets, as corners did before. A bucket's corners are read,
 * looked up and written anew; then all are read side by side, in the sequence that was kept, and
 * are in the input's order again. With one bucket nothing of that is written. A soup's corners are
 * its vertices: its buckets are its triangles, one after the other.
 *
 * (To sort corners by vertex, to join, and to sort back would move 96 bytes a triangle; this
 * is 30.)
 *
 * Secret: the curve, the buckets. One thread. (design.md §3.1, §3.3) */
#include "extintake.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include <xxhash.h>

#include "assert.h"
#include "reader.h"

enum {
    AXIS_BITS = 21,    /* 3 × 21 fit a word */
    SAME_KEY_MAX = 16, /* different positions of one cell and one hash of 64 bits: hardly two */
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

typedef struct pair {
    uint32_t vertex, place;
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

static bool map_vertex(mni_extintake *x, uint32_t vertex, uint32_t place) {
    const pair p = {vertex, place};
    if (x->map == NULL)
        return mni_ext_bucket_put(x, vertex / x->window, &p, sizeof p);
    x->map[vertex] = place;
    return true;
}

static bool take_map(mni_extintake *x) {
    uint64_t vertices = x->vertices < x->window ? x->vertices : x->window;
    x->map = malloc(vertices * sizeof *x->map + 1);
    if (x->map == NULL)
        mn_fail(x->st, MN_FAILED, "%s: no memory", x->name);
    return x->map != NULL;
}

/* ---- vertices ------------------------------------------------------------------------------- */

static bool sort_vertex(mni_extintake *x, mni_sort *sort, double scale, const double p[3],
                        uint32_t rgba, uint64_t number) {
    if (!mni_ext_tell_vertices(x, number))
        return false;
    if (isnan(p[0]))
        return map_vertex(x, (uint32_t)number, MN_NONE);
    entry e = {.cell = cell_of(x, scale, p), .number = (uint32_t)number, .rgba = rgba};
    e.hash = x->apart ? number : XXH3_64bits(p, 3 * sizeof *p);
    if (mni_ext_is_wide(x))
        memcpy(e.at.wide, p, sizeof e.at.wide);
    else
        for (int i = 0; i < 3; i++)
            e.at.narrow[i] = (float)p[i];
    mni_sort_put(sort, &e);
    return true;
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
        if (!sort_vertex(x, sort, scale, p, narrow->rgba, number++))
            return false;
    }
    bool good = mni_ext_spill_good(x, &x->narrow);
    mni_ext_spill_close(x, &x->narrow);
    if (x->wide.fd >= 0 && good) {
        const mni_ext_wide *wide;
        mni_spill_reader_open(&r, &x->wide, 0, x->wide.size_bytes, x->buffer[0], x->buffer_bytes,
                              true);
        while ((wide = mni_spill_take(&r, sizeof *wide)) != NULL)
            if (!sort_vertex(x, sort, scale, wide->position, wide->rgba, number++))
                return false;
        good = mni_ext_spill_good(x, &x->wide);
    }
    mni_ext_spill_close(x, &x->wide);
    MN_ASSERT(!good || number == x->vertices);
    return good;
}

static void write_place(mni_extintake *x, mni_spill_writer *w, const entry *e) {
    if (mni_ext_is_wide(x)) {
        mni_ext_wide v = {{e->at.wide[0], e->at.wide[1], e->at.wide[2]}, e->rgba, 0};
        mni_spill_put(w, &v, sizeof v);
    } else {
        mni_extvertex v = {{e->at.narrow[0], e->at.narrow[1], e->at.narrow[2]}, e->rgba};
        mni_spill_put(w, &v, sizeof v);
    }
}

/* In order: the first of each position becomes a place. */
static bool weld_sorted(mni_extintake *x, mni_sort *sort) {
    size_t bytes = mni_ext_is_wide(x) ? WIDE_BYTES : NARROW_BYTES, at = offsetof(entry, at);
    entry same[SAME_KEY_MAX], e; /* places of this cell and hash, the last ones */
    uint32_t count = 0;
    uint64_t done = x->vertices;
    const void *record;
    mni_spill_writer w;
    mni_spill_writer_open(&w, &x->placed, x->buffer[1], x->buffer_bytes);
    while ((record = mni_sort_next(sort, x->st)) != NULL && mni_ext_tell_vertices(x, done++)) {
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
        if (!map_vertex(x, e.number, (uint32_t)(x->places - count + i)))
            return false;
    }
    mni_spill_end(&w);
    return x->st->code == MN_OK && mni_ext_spill_good(x, &x->placed);
}

bool mni_ext_place_vertices(mni_extintake *x) {
    mni_sort *sort = NULL;
    uint32_t bytes = (uint32_t)(mni_ext_is_wide(x) ? WIDE_BYTES : NARROW_BYTES);
    bool one = mni_ext_buckets(x) == 1;
    bool ok =
        (!one || take_map(x)) && mni_ext_spill_open(x, &x->placed) &&
        mni_ext_sort_open(x, &sort, bytes, MNI_SORT_U128, one ? MNI_EXT_QUARTER : MNI_EXT_HALF) &&
        sort_vertices(x, sort) && mni_sort_finish(sort, x->st) == MN_OK && weld_sorted(x, sort);
    mni_ext_sort_close(x, &sort);
    x->counts.welded_vertices = x->vertices - x->nonfinite - x->places;
    if (ok && x->places > MNI_VERTICES_MAX) { /* a soup's: others have been counted as they came */
        mn_fail(x->st, MN_BAD_INPUT,
                "%s: has %llu vertices, more than the %llu that can be taken in", x->name,
                (unsigned long long)x->places, (unsigned long long)MNI_VERTICES_MAX);
        ok = false;
    }
    return ok;
}

/* ---- corners -------------------------------------------------------------------------------- */

/* The buckets' writers have pairs; ends them. */
static bool end_pairs(mni_extintake *x) {
    for (uint64_t k = 0; k < mni_ext_buckets(x); k++) {
        mni_ext_bucket *b = &x->bucket[k];
        if (b->spill.fd >= 0 && mni_spill_end(&b->to) != MN_OK)
            return mni_ext_spill_good(x, &b->spill);
        b->found = b->spill.size_bytes;
    }
    return true;
}

/* The map of one bucket: each of its vertices has a pair. */
static bool load_map(mni_extintake *x, mni_ext_bucket *b) {
    mni_spill_reader r;
    const pair *p;
    mni_spill_reader_open(&r, &b->spill, b->pairs, b->found, x->buffer[0], x->buffer_bytes, true);
    while ((p = mni_spill_take(&r, sizeof *p)) != NULL)
        x->map[p->vertex % x->window] = p->place;
    return mni_ext_spill_good(x, &b->spill);
}

/* Corners, from vertices to places. */
static bool look_up(mni_extintake *x, mni_ext_bucket *b) {
    mni_spill_reader r;
    mni_spill_writer w;
    const uint32_t *corner;
    mni_spill_reader_open(&r, &b->spill, 0, b->pairs, x->buffer[0], x->buffer_bytes, true);
    mni_spill_writer_open(&w, &b->spill, x->buffer[1], x->buffer_bytes);
    while ((corner = mni_spill_take(&r, sizeof *corner)) != NULL)
        mni_spill_put(&w, &x->map[*corner % x->window], sizeof *x->map);
    mni_spill_end(&w);
    return mni_ext_spill_good(x, &b->spill);
}

/* All buckets side by side, each corner from the one that the sequence says. */
static bool in_sequence(mni_extintake *x) {
    mni_spill_reader r;
    uint32_t place[3];
    for (uint64_t k = 0; k < mni_ext_buckets(x); k++) {
        mni_ext_bucket *b = &x->bucket[k];
        if (b->spill.fd >= 0)
            mni_spill_reader_open(&b->from, &b->spill, b->found, b->spill.size_bytes, b->buffer,
                                  x->bucket_bytes, true);
    }
    if (x->sequence.fd >= 0)
        mni_spill_reader_open(&r, &x->sequence, 0, x->sequence.size_bytes, x->buffer[0],
                              x->buffer_bytes, true);
    for (uint64_t i = 0; i < 3 * x->triangles; i++) {
        static const uint8_t first = 0;
        const uint8_t *k =
            x->sequence.fd < 0 || i < x->sequence_begin ? &first : mni_spill_take(&r, 1);
        if (k == NULL)
            return mni_ext_spill_good(x, &x->sequence);
        const uint32_t *found = mni_spill_take(&x->bucket[*k].from, sizeof *found);
        if (found == NULL)
            return mni_ext_spill_good(x, &x->bucket[*k].spill);
        place[i % 3] = *found;
        if (i % 3 < 2)
            continue;
        if (!mni_ext_tell_triangles(x, i / 3))
            return false;
        mni_ext_judge(x, place, (uint32_t)(i / 3));
    }
    return true;
}

static bool triangles_by_buckets(mni_extintake *x) {
    for (uint64_t k = 0; k < mni_ext_buckets(x); k++) {
        mni_ext_bucket *b = &x->bucket[k];
        if (b->spill.fd >= 0 && (!load_map(x, b) || !look_up(x, b)))
            return false;
    }
    free(x->map);
    x->map = NULL;
    return mni_ext_faces_open(x) && in_sequence(x);
}

/* The map is of all vertices, and all corners are in the first bucket. */
static bool triangles_by_map(mni_extintake *x) {
    mni_ext_bucket *b = &x->bucket[0];
    mni_spill_reader r;
    const uint32_t *corner;
    if (b->spill.fd < 0)
        return true; /* no triangle */
    mni_spill_reader_open(&r, &b->spill, 0, b->pairs, x->buffer[0], x->buffer_bytes, true);
    for (uint32_t t = 0; (corner = mni_spill_take(&r, 3 * sizeof *corner)) != NULL; t++) {
        const uint32_t place[3] = {x->map[corner[0]], x->map[corner[1]], x->map[corner[2]]};
        if (!mni_ext_tell_triangles(x, t))
            return false;
        mni_ext_judge(x, place, t);
    }
    return mni_ext_spill_good(x, &b->spill);
}

/* Gives the memory of the buckets' buffers back: map and sort need it. */
static void release_buffers(const mni_extintake *x) {
    enum { PAGE_BYTES = 4096 };
    uintptr_t from = (uintptr_t)x->bucket[0].buffer;
    uintptr_t to = from + MNI_EXT_BUCKETS * x->bucket_bytes;
    from = (from + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
    to = to / PAGE_BYTES * PAGE_BYTES;
    if (to > from)
        (void)madvise((void *)from, to - from, MADV_DONTNEED);
}

/* A bucket's vertices are its triangles' corners. */
static bool triangles_of_soup(mni_extintake *x) {
    bool whole = mni_ext_buckets(x) == 1; /* the map is there already */
    release_buffers(x);
    for (uint64_t t = 0; t < x->triangles; t++) {
        uint64_t at = 3 * t % x->window;
        if (at == 0 && !whole && !load_map(x, &x->bucket[3 * t / x->window]))
            return false;
        if (!mni_ext_tell_triangles(x, t))
            return false;
        mni_ext_judge(x, x->map + at, (uint32_t)t);
    }
    return true;
}

bool mni_ext_place_triangles(mni_extintake *x) {
    bool one = mni_ext_buckets(x) == 1, ok = one || (end_pairs(x) && take_map(x));
    if (x->soup)
        ok = ok && mni_ext_faces_open(x) && triangles_of_soup(x);
    else if (one)
        ok = ok && mni_ext_faces_open(x) && triangles_by_map(x);
    else
        ok = ok && triangles_by_buckets(x);
    for (int i = 0; i < MNI_EXT_BUCKETS; i++)
        mni_ext_spill_close(x, &x->bucket[i].spill);
    mni_ext_spill_close(x, &x->sequence);
    free(x->map);
    x->map = NULL;
    return ok;
}
