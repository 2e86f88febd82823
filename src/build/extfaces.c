/* Triangles, outside memory: see extintake.h. Each is sorted by its three places, smallest first,
 * so that twins are neighbours, the first of the input first, and so that what is left lies along
 * the vertices' curve already. How its corners stood is kept in the same 16 bytes:
 *
 *   high: smallest place, middle one
 *   low:  largest << 33 | number << 1 | largest right after smallest
 *
 * Which places are used is a bit each; with how many are before each eighth word of bits, that
 * renumbers them.
 *
 * Secret: the packing, the bits. One thread. (design.md §3.1, §3.3) */
#include "extintake.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <xxhash.h>

#include "assert.h"
#include "exttriangles.h"
#include "reader.h"

enum { USED_SHARE = 8 };

typedef struct packed {
    uint64_t high, low;
} packed;

bool mni_ext_faces_open(mni_extintake *x) {
    uint64_t words = x->places / 64 + 1, ranks = words / MNI_EXT_RANK_WORDS + 1;
    uint64_t bytes = words * sizeof *x->used + ranks * sizeof *x->used_before;
    if (bytes > x->desc.work_bytes / USED_SHARE && bytes > 4096) {
        mni_ext_too_small(x, x->places, (bytes + 1) * USED_SHARE);
        return false;
    }
    x->used = calloc(1, bytes);
    if (x->used == NULL) {
        mn_fail(x->st, MN_FAILED, "%s: no memory", x->name);
        return false;
    }
    x->used_before = (uint32_t *)(void *)(x->used + words);
    return mni_ext_sort_open(x, &x->triangle_sort, sizeof(packed), MNI_SORT_U128, MNI_EXT_QUARTER);
}

/* ---- one by one ------------------------------------------------------------------------------ */

static packed pack(const uint32_t place[3], uint32_t number) {
    uint32_t first = place[0] < place[1] ? 0 : 1;
    first = place[first] < place[2] ? first : 2;
    uint32_t next = place[(first + 1) % 3], last = place[(first + 2) % 3];
    bool turned = next > last;
    uint32_t middle = turned ? last : next, largest = turned ? next : last;
    return (packed){(uint64_t)place[first] << 32 | middle,
                    (uint64_t)largest << 33 | (uint64_t)number << 1 | turned};
}

static mni_exttriangle unpack(const packed *p) {
    uint32_t smallest = (uint32_t)(p->high >> 32), middle = (uint32_t)p->high;
    uint32_t largest = (uint32_t)(p->low >> 33);
    bool turned = p->low & 1;
    return (mni_exttriangle){{smallest, turned ? largest : middle, turned ? middle : largest}};
}

void mni_ext_judge(mni_extintake *x, const uint32_t place[3], uint32_t number) {
    if (place[0] == MN_NONE || place[1] == MN_NONE || place[2] == MN_NONE) {
        x->counts.nonfinite_faces++;
    } else if (place[0] == place[1] || place[1] == place[2] || place[2] == place[0]) {
        x->counts.degenerate_faces++;
    } else {
        packed p = pack(place, number);
        for (int i = 0; i < 3; i++)
            x->used[place[i] / 64] |= UINT64_C(1) << place[i] % 64;
        mni_sort_put(x->triangle_sort, &p);
    }
}

/* ---- places in use --------------------------------------------------------------------------- */

static bool is_used(const mni_extintake *x, uint64_t place) {
    return x->used[place / 64] >> place % 64 & 1;
}

static void count_used(mni_extintake *x) {
    uint64_t words = x->places / 64 + 1, count = 0;
    for (uint64_t w = 0; w < words; w++) {
        if (w % MNI_EXT_RANK_WORDS == 0)
            x->used_before[w / MNI_EXT_RANK_WORDS] = (uint32_t)count;
        count += (uint64_t)__builtin_popcountll(x->used[w]);
    }
    x->result.vertices = count;
    x->counts.unused_vertices = x->places + x->nonfinite - count;
}

/* The vertex that a place in use becomes. */
static uint32_t vertex_of(const mni_extintake *x, uint32_t place) {
    uint32_t word = place / 64, w = word / MNI_EXT_RANK_WORDS * MNI_EXT_RANK_WORDS;
    uint32_t rank = x->used_before[word / MNI_EXT_RANK_WORDS];
    for (; w < word; w++)
        rank += (uint32_t)__builtin_popcountll(x->used[w]);
    uint64_t below = (UINT64_C(1) << place % 64) - 1;
    return rank + (uint32_t)__builtin_popcountll(x->used[word] & below);
}

/* ---- all of them ----------------------------------------------------------------------------- */

static bool write_triangles(mni_extintake *x) {
    mni_spill_writer w;
    const packed *p;
    packed before = {0};
    uint32_t last = 0;
    uint64_t done = x->triangles;
    mni_spill_writer_open(&w, &x->result.triangle, x->buffer[0], x->buffer_bytes);
    while ((p = mni_sort_next(x->triangle_sort, x->st)) != NULL &&
           mni_ext_tell_triangles(x, done++)) {
        bool twin =
            x->result.triangles > 0 && p->high == before.high && p->low >> 33 == before.low >> 33;
        if (twin) {
            x->counts.duplicate_faces++;
            continue;
        }
        mni_exttriangle t = unpack(p);
        before = *p;
        for (int i = 0; i < 3; i++)
            t.corner[i] = vertex_of(x, t.corner[i]);
        mni_exttriangle_put(&w, &t, &last);
        mni_ext_edges_add(x, &t, (uint32_t)(p->low >> 1));
        x->result.triangles++;
    }
    mni_spill_end(&w);
    return x->st->code == MN_OK && mni_ext_spill_good(x, &x->result.triangle);
}

/* Different records, by all of their bytes. */
static bool count_different(mni_extintake *x, mni_sort *sort, size_t bytes, uint64_t *count) {
    unsigned char before[16];
    const void *record;
    MN_ASSERT(bytes <= sizeof before);
    *count = 0;
    if (mni_sort_finish(sort, x->st) != MN_OK)
        return false;
    while ((record = mni_sort_next(sort, x->st)) != NULL) {
        *count += *count == 0 || memcmp(before, record, bytes) != 0;
        memcpy(before, record, bytes);
    }
    return x->st->code == MN_OK;
}

/* ---- vertices -------------------------------------------------------------------------------- */

/* The next place in use, from a reader of placed ones; false: no more. */
static bool next_used(mni_extintake *x, mni_spill_reader *r, uint64_t *place, mni_ext_wide *out) {
    for (;;) {
        bool wide = mni_ext_is_wide(x);
        const void *record = mni_spill_take(r, wide ? sizeof(mni_ext_wide) : sizeof(mni_extvertex));
        if (record == NULL)
            return false;
        if (!is_used(x, (*place)++))
            continue;
        if (wide) {
            memcpy(out, record, sizeof *out);
        } else {
            const mni_extvertex *v = record;
            *out = (mni_ext_wide){{v->position[0], v->position[1], v->position[2]}, v->rgba, 0};
        }
        return true;
    }
}

static void read_placed(mni_extintake *x, mni_spill_reader *r, bool discard) {
    mni_spill_reader_open(r, &x->placed, 0, x->placed.size_bytes, x->buffer[0], x->buffer_bytes,
                          discard);
}

/* The origin, from the box of what is used; whether floats hold all of it. */
static bool find_origin(mni_extintake *x) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    bool exact = true;
    mni_spill_reader r;
    mni_ext_wide v;
    read_placed(x, &r, false);
    for (uint64_t place = 0; next_used(x, &r, &place, &v);)
        for (int i = 0; i < 3; i++) {
            double p = v.position[i];
            low[i] = p < low[i] ? p : low[i];
            high[i] = p > high[i] ? p : high[i];
            exact = exact && (double)(float)p == p;
        }
    mni_intake_origin(low, high, exact, x->result.origin);
    return exact;
}

/* Positions as floats; where those tell fewer apart, how many fewer. */
static bool write_vertices(mni_extintake *x, bool exact) {
    mni_sort *floats = NULL, *doubles = NULL;
    mni_spill_reader r;
    mni_spill_writer w;
    mni_ext_wide v;
    if (!exact &&
        (!mni_ext_sort_open(x, &floats, 16, MNI_SORT_U128, MNI_EXT_QUARTER) ||
         (x->apart && !mni_ext_sort_open(x, &doubles, 16, MNI_SORT_U128, MNI_EXT_QUARTER)))) {
        mni_ext_sort_close(x, &floats);
        return false;
    }
    read_placed(x, &r, true);
    mni_spill_writer_open(&w, &x->result.vertex, x->buffer[1], x->buffer_bytes);
    for (uint64_t place = 0; next_used(x, &r, &place, &v);) {
        struct {
            float position[3];
            uint32_t zero;
        } key = {0};
        mni_extvertex out = {.rgba = v.rgba};
        for (int i = 0; i < 3; i++)
            out.position[i] = (float)(v.position[i] - x->result.origin[i]) + 0.0f;
        memcpy(key.position, out.position, sizeof key.position);
        mni_spill_put(&w, &out, sizeof out);
        if (floats != NULL)
            mni_sort_put(floats, &key);
        if (doubles != NULL) {
            XXH128_hash_t hash = XXH3_128bits(v.position, sizeof v.position);
            mni_sort_put(doubles, &hash);
        }
    }
    mni_spill_end(&w);
    uint64_t places = 0, apart = x->result.vertices;
    bool ok = mni_ext_spill_good(x, &x->placed) && mni_ext_spill_good(x, &x->result.vertex) &&
              (floats == NULL || count_different(x, floats, 16, &places)) &&
              (doubles == NULL || count_different(x, doubles, 16, &apart));
    x->counts.merged_positions = floats != NULL ? apart - places : 0;
    mni_ext_sort_close(x, &floats);
    mni_ext_sort_close(x, &doubles);
    return ok;
}

static bool finish_vertices(mni_extintake *x) {
    bool ok = true;
    if (!mni_ext_is_wide(x) && x->result.vertices == x->places) {
        x->result.vertex = x->placed; /* as it is */
        x->placed.fd = -1;
        return true;
    }
    bool exact = !mni_ext_is_wide(x) || find_origin(x);
    ok = mni_ext_spill_good(x, &x->placed) && mni_ext_spill_open(x, &x->result.vertex) &&
         write_vertices(x, exact);
    mni_ext_spill_close(x, &x->placed);
    return ok;
}

bool mni_ext_faces_finish(mni_extintake *x) {
    count_used(x);
    if (!mni_intake_any_left(&x->counts, x->vertices, x->result.vertices, x->name, x->st))
        return false; /* no vertex is used, so no triangle is left */
    bool ok =
        mni_spill_open_kept(&x->result.triangle, x->desc.temp_dir, x->desc.keep, x->st) == MN_OK &&
        mni_sort_finish(x->triangle_sort, x->st) == MN_OK && mni_ext_edges_open(x) &&
        write_triangles(x);
    mni_ext_sort_close(x, &x->triangle_sort);
    ok = ok && mni_ext_edges_finish(x);
    mni_ext_edges_close(x);
    return ok && finish_vertices(x);
}
