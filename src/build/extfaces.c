/* Triangles, outside memory: see extintake.h. Each is sorted by its three places, smallest first,
 * so that twins are neighbours, the first of the input first, and so that what is left lies along
 * the vertices' curve already. How its corners stood is kept in the same 16 bytes, which are 8 on
 * the disk:
 *
 *   high: smallest place, middle one
 *   low:  largest << 33 | number << 1 | largest right after smallest
 *
 * Which places are used is a bit each; with how many are before each eighth word of bits, that
 * renumbers them.
 *
 * Triangles are judged and sorted in a thread of their own, beside the looking up of places, and
 * edges are counted in one, beside the merging of what was sorted.
 *
 * Secret: the packing, the bits. (design.md §3.1, §3.3) */
#include "extintake.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <xxhash.h>

#include "mn_assert.h"
#include "exttriangles.h"
#include "reader.h"
#include "relay.h"

typedef struct packed {
    uint64_t high, low;
} packed;
enum { PACKED_MAX = 4 * MNI_VARINT32_MAX };

/* For the disk: smallest - the last one's, middle - smallest, largest - middle, number and turn. */
static unsigned char *pack_sorted(const void *context, unsigned char *to, const void *record,
                                  const void *before) {
    const packed *p = record, *b = before;
    const uint32_t smallest = (uint32_t)(p->high >> 32), middle = (uint32_t)p->high;
    (void)context;
    to = mni_varint_put(to, smallest - (uint32_t)(b->high >> 32));
    to = mni_varint_put(to, middle - smallest);
    to = mni_varint_put(to, (uint32_t)(p->low >> 33) - middle);
    return mni_varint_put(to, mni_fold((uint32_t)(p->low >> 1), (uint32_t)(b->low >> 1)) << 1 |
                                  (p->low & 1));
}

static const unsigned char *unpack_sorted(const void *context, const unsigned char *from,
                                          void *record) {
    packed *p = record;
    (void)context;
    const uint32_t smallest = (uint32_t)(p->high >> 32) + (uint32_t)mni_varint_get(&from),
                   middle = smallest + (uint32_t)mni_varint_get(&from),
                   largest = middle + (uint32_t)mni_varint_get(&from);
    const uint64_t rest = mni_varint_get(&from),
                   number = mni_unfold(rest >> 1, (uint32_t)(p->low >> 1));
    *p = (packed){(uint64_t)smallest << 32 | middle,
                  (uint64_t)largest << 33 | number << 1 | (rest & 1)};
    return from;
}

/* A triangle on its way to be judged. */
typedef struct placed {
    uint32_t place[3], number;
} placed;

static void judge_all(void *context, void *records, uint32_t count);

bool mni_ext_faces_open(mni_extintake *x) {
    static const mni_sort_packing packing = {PACKED_MAX, pack_sorted, unpack_sorted, NULL};
    const uint64_t words = x->places / 64 + 1, ranks = words / MNI_EXT_RANK_WORDS + 1;
    const uint64_t bytes = words * sizeof *x->used + ranks * sizeof *x->used_before;
    if (bytes > mni_ext_share(x, MNI_EXT_USED_SHARE) && bytes > 4096) {
        mni_ext_too_small(x, x->places, (bytes + 1) * MNI_EXT_SHARES / MNI_EXT_USED_SHARE);
        return false;
    }
    x->used = calloc(1, bytes);
    if (x->used == NULL) {
        mn_fail(x->st, MN_FAILED, "%s: no memory", x->name);
        return false;
    }
    x->used_before = (uint32_t *)(void *)(x->used + words);
    const uint64_t others = x->map_bytes + bytes + mni_ext_share(x, MNI_EXT_BUFFERS_SHARE) +
                            mni_ext_share(x, MNI_EXT_BUCKETS_SHARE);
    const mni_sort_desc desc = {.record_bytes = sizeof(packed),
                                .key = MNI_SORT_U128,
                                .budget_bytes = x->desc.work_bytes - others,
                                .after_bytes = mni_ext_share(x, MNI_EXT_AFTER_SHARE),
                                .packing = &packing};
    if (!mni_ext_sort_open(x, &x->triangle_sort, &desc))
        return false;
    mni_relay_open(&x->judge, judge_all, x, sizeof(placed), x->buffer[2], x->buffer_bytes,
                   x->desc.threads);
    x->judging = true;
    return true;
}

/* ---- one by one, in either thread ----------------------------------------------------------- */

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

static void judge(mni_extintake *x, const uint32_t place[3], uint32_t number) {
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

static void judge_all(void *context, void *records, uint32_t count) {
    const placed *t = records;
    for (uint32_t i = 0; i < count; i++)
        judge(context, t[i].place, t[i].number);
}

bool mni_ext_judge(mni_extintake *x, const uint32_t place[3], uint32_t number) {
    mni_relay_put(&x->judge, &(placed){{place[0], place[1], place[2]}, number});
    return mni_ext_tell_triangles(x, x->judged++);
}

void mni_ext_judge_end(mni_extintake *x) {
    if (x->judging)
        mni_relay_close(&x->judge);
    x->judging = false;
}

/* ---- places in use --------------------------------------------------------------------------- */

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
    if (x->result.vertices == x->places) /* all are */
        return place;
    uint32_t word = place / 64, w = word / MNI_EXT_RANK_WORDS * MNI_EXT_RANK_WORDS;
    uint32_t rank = x->used_before[word / MNI_EXT_RANK_WORDS];
    for (; w < word; w++)
        rank += (uint32_t)__builtin_popcountll(x->used[w]);
    uint64_t below = (UINT64_C(1) << place % 64) - 1;
    return rank + (uint32_t)__builtin_popcountll(x->used[word] & below);
}

/* ---- all of them ----------------------------------------------------------------------------- */

typedef struct numbered {
    mni_exttriangle is;
    uint32_t number;
} numbered;

static void add_edges(void *context, void *records, uint32_t count) {
    const numbered *t = records;
    for (uint32_t i = 0; i < count; i++)
        mni_ext_edges_add(context, &t[i].is, t[i].number);
}

static bool write_triangles(mni_extintake *x) {
    mni_spill_writer w;
    mni_relay edges;
    const packed *p;
    packed before = {0};
    uint32_t last = 0;
    uint64_t done = x->triangles;
    mni_spill_writer_open(&w, &x->result.triangle, x->buffer[0], x->buffer_bytes);
    mni_relay_open(&edges, add_edges, x, sizeof(numbered), x->buffer[1], x->buffer_bytes,
                   x->desc.threads);
    while ((p = mni_sort_next(x->triangle_sort, x->st)) != NULL &&
           mni_ext_tell_triangles(x, done++)) {
        bool twin =
            x->result.triangles > 0 && p->high == before.high && p->low >> 33 == before.low >> 33;
        if (twin) {
            x->counts.duplicate_faces++;
            continue;
        }
        numbered t = {unpack(p), (uint32_t)(p->low >> 1)};
        before = *p;
        for (int i = 0; i < 3; i++)
            t.is.corner[i] = vertex_of(x, t.is.corner[i]);
        mni_exttriangle_put(&w, &t.is, &last);
        mni_relay_put(&edges, &t);
        x->result.crossings += mni_exttriangle_crossings(&t.is);
        x->result.triangles++;
    }
    mni_relay_close(&edges);
    mni_spill_end(&w);
    return x->st->code == MN_OK && mni_ext_spill_good(x, &x->result.triangle);
}

bool mni_ext_faces_judged(mni_extintake *x) {
    count_used(x);
    /* no vertex is used, so no triangle is left */
    return mni_intake_any_left(&x->counts, x->vertices, x->result.vertices, x->name, x->st);
}

bool mni_ext_faces_finish(mni_extintake *x) {
    bool ok =
        mni_spill_open_kept(&x->result.triangle, x->desc.temp_dir, x->desc.keep, x->st) == MN_OK &&
        mni_sort_finish(x->triangle_sort, x->st) == MN_OK && mni_ext_edges_open(x) &&
        write_triangles(x);
    mni_ext_sort_close(x, &x->triangle_sort);
    ok = ok && mni_ext_edges_finish(x);
    mni_ext_edges_close(x);
    return ok;
}
