/* Numbers for vertices and corners, outside memory: see extintake.h.
 *
 * Vertices are sorted by where they lie along a Z-order curve through the box of all, and by a hash
 * of their position where they share a cell of it; equal positions are then neighbours, the first
 * of the input first, and their rank is their place. Cells are parts of what is rounded to one
 * place of the grid, so what will fall together there is one run as well. Of an entry only what the
 * key is made of goes to the disk, as differences: 12 bytes of 36.
 *
 * The map from pushed vertices to places is an array, of all vertices or of one bucket's: then
 * pairs of vertex and place go to their buckets, as triangles did before. A bucket's triangles are
 * looked up there and then. Of those that lie in several, each bucket finds its corners' places;
 * then all are read side by side, in the sequence that was kept. A soup's corners are its vertices:
 * its buckets are its triangles, one after the other.
 *
 * (To sort corners by vertex, to join, and to sort back would move 96 bytes a triangle; this moves
 * 12 where neighbours in the input are near each other in the model, and at most 40.)
 *
 * With two threads allowed vertices are sorted in one of its own while triangles still come, since
 * all vertices have most likely come with the first of these; where more come, it was for nothing.
 * Triangles are judged and sorted in one beside the looking up of their places (mni_ext_judge).
 *
 * Secret: the curve, the buckets. (design.md §3.1, §3.3) */
#include "extintake.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <xxhash.h>

#include "mn_assert.h"
#include "reader.h"
#include "relay.h"

enum {
    AXIS_BITS = MNI_EXT_CURVE_BITS_MAX + 1, /* 3 × 21 fit a word */
    LOOK_EVERY = 1 << 14,                   /* vertices */
    SAME_KEY_MAX = 16, /* different positions of one cell and one hash of 64 bits: hardly two */
};

typedef struct entry { /* what is sorted; of narrow ones, as much as they have */
    uint64_t cell, hash;
    uint32_t word[1 + MNI_EXT_WIDE_WORDS]; /* its number, then a vertex */
} __attribute__((packed, aligned(4))) entry;
#define NO_CELL UINT64_MAX /* of what is not finite: past all others */
enum { PACKED_MAX = (1 + MNI_EXT_WIDE_WORDS) * MNI_VARINT32_MAX };

static uint32_t words_of(const mni_extintake *x) {
    return 1 + mni_ext_count(mni_ext_is_wide(x));
}

static size_t entry_bytes(const mni_extintake *x) {
    return offsetof(entry, word) + words_of(x) * sizeof(uint32_t);
}

/* Every third bit. */
static uint64_t spread(uint64_t x) {
    x = (x | x << 32) & UINT64_C(0x001f00000000ffff);
    x = (x | x << 16) & UINT64_C(0x001f0000ff0000ff);
    x = (x | x << 8) & UINT64_C(0x100f00f00f00f00f);
    x = (x | x << 4) & UINT64_C(0x10c30c30c30c30c3);
    return (x | x << 2) & UINT64_C(0x1249249249249249);
}

static uint64_t cell_of(const mni_extintake *x, const double p[3]) {
    const mni_ext_frame *f = &x->frame;
    const double steps_per_unit = 1 / (double)f->step; /* a power of two, as the step is */
    const int part_bits = AXIS_BITS - 1 - (int)mni_ext_curve_bits(x);
    uint64_t cell = 0;
    for (int i = 0; i < 3; i++) {
        const double at = (double)mni_ext_from_origin(f, p[i], i) * steps_per_unit, step = rint(at),
                     first = rint((double)f->low[i] * steps_per_unit);
        const uint32_t part = (uint32_t)((at - step + 0.5) * (1 << part_bits)),
                       last = (1u << part_bits) - 1;
        cell |= spread((uint64_t)(step - first) << part_bits | (part < last ? part : last)) << i;
    }
    return cell;
}

static void set_key(const mni_extintake *x, entry *e) {
    const mni_ext_vertex v = mni_ext_vertex_of(e->word + 1, mni_ext_is_wide(x));
    e->cell = e->hash = NO_CELL;
    if (isnan(v.position[0]))
        return;
    e->cell = cell_of(x, v.position);
    e->hash = x->apart ? e->word[0] : XXH3_64bits(v.position, sizeof v.position);
}

static unsigned char *pack(const void *context, unsigned char *to, const void *record,
                           const void *before) {
    const entry *e = record, *b = before;
    return mni_words_put(to, e->word, b->word, words_of(context));
}

static const unsigned char *unpack(const void *context, const unsigned char *from, void *record) {
    entry *e = record;
    from = mni_words_get(from, e->word, words_of(context));
    set_key(context, e);
    return from;
}

/* ---- the map --------------------------------------------------------------------------------- */

static bool take_map(mni_extintake *x) {
    uint64_t vertices = x->vertices < x->window ? x->vertices : x->window;
    x->map_bytes = vertices * sizeof *x->map + 1;
    x->map = malloc(x->map_bytes);
    if (x->map == NULL)
        mn_fail(x->st, MN_FAILED, "%s: no memory", x->name);
    return x->map != NULL;
}

static void free_map(mni_extintake *x) {
    free(x->map);
    x->map = NULL;
    x->map_bytes = 0;
}

static bool map_vertex(mni_extintake *x, uint32_t vertex, uint32_t place) {
    if (x->map != NULL) {
        x->map[vertex] = place;
        return true;
    }
    const uint64_t bucket = vertex / x->window;
    const uint32_t pair[2] = {vertex, place};
    mni_spill_writer *w = mni_ext_bucket_writer(x, bucket);
    unsigned char packed[2 * MNI_VARINT32_MAX];
    if (w == NULL)
        return false;
    mni_spill_put(w, packed,
                  (size_t)(mni_words_put(packed, pair, x->bucket[bucket].last, 2) - packed));
    memcpy(x->bucket[bucket].last, pair, sizeof pair);
    return true;
}

/* ---- vertices ------------------------------------------------------------------------------- */

static bool open_sort(mni_extintake *x) {
    mni_ext_sorting *g = &x->sorting;
    const mni_sort_desc desc = {.record_bytes = (uint32_t)entry_bytes(x),
                                .key = MNI_SORT_U128,
                                .budget_bytes = mni_ext_share(x, MNI_EXT_SORT_SHARE),
                                .after_bytes = mni_ext_share(x, MNI_EXT_AFTER_SHARE),
                                .packing = &g->packing};
    g->packing = (mni_sort_packing){PACKED_MAX, pack, unpack, x};
    if (x->nonfinite < x->vertices)
        x->frame = mni_ext_frame_of(x, x->low, x->high, !mni_ext_is_wide(x));
    return mni_ext_sort_open(x, &g->sort, &desc);
}

/* In either thread: gets its key, and goes to the sort. */
static void sort_entries(void *context, void *records, uint32_t count) {
    const mni_extintake *x = context;
    const size_t bytes = entry_bytes(x);
    unsigned char *at = records;
    for (; count > 0; count--, at += bytes) {
        set_key(x, (entry *)(void *)at);
        mni_sort_put(x->sorting.sort, at);
    }
}

/* All vertices, from the copy of `pushed`; threads: 1, or more for one beside this. goes_on: asked
 * now and then. */
static void sort_vertices(mni_extintake *x, bool discards, uint32_t threads,
                          bool (*goes_on)(mni_extintake *x, uint64_t number)) {
    mni_ext_sorting *g = &x->sorting;
    mni_relay relay;
    mni_spill_reader r;
    mni_ext_words last = {0};
    mni_ext_vertex v;
    uint64_t number = 0;
    mni_spill_reader_open(&r, &g->from, 0, g->from.size_bytes, x->buffer[0], x->buffer_bytes,
                          discards);
    mni_relay_open(&relay, sort_entries, x, entry_bytes(x), x->buffer[2], x->buffer_bytes, threads);
    for (; mni_ext_next(&r, &last, number >= x->narrow_vertices, &v); number++) {
        const mni_ext_words words = mni_ext_words_of(&v, mni_ext_is_wide(x));
        entry e = {.word = {(uint32_t)number}};
        memcpy(e.word + 1, words.word, sizeof words);
        mni_relay_put(&relay, &e);
        if (number % LOOK_EVERY == 0 && !goes_on(x, number))
            break;
    }
    mni_relay_close(&relay);
    if (g->from.trouble.code == MN_OK && number == x->vertices)
        mni_sort_finish(g->sort, &g->st);
}

static bool is_wanted(mni_extintake *x, uint64_t number) {
    atomic_store_explicit(&x->sorting.sorted, number, memory_order_relaxed);
    return !atomic_load_explicit(&x->sorting.stop, memory_order_relaxed);
}

static void sort_beside(void *context, void *records, uint32_t count) {
    mni_extintake *x = context;
    (void)records;
    MN_ASSERT(count == 1);
    sort_vertices(x, false, 1, is_wanted);
    atomic_store_explicit(&x->sorting.over, true, memory_order_release);
}

bool mni_ext_sorting_begin(mni_extintake *x) {
    mni_ext_sorting *g = &x->sorting;
    if (x->desc.threads < 2 || x->vertices == 0)
        return true;
    mni_spill_end(&x->to_pushed);
    if (!mni_ext_spill_good(x, &x->pushed) || !open_sort(x))
        return false;
    g->from = x->pushed;
    mni_relay_open(&g->relay, sort_beside, x, sizeof *g->batch, g->batch, sizeof g->batch,
                   x->desc.threads);
    g->open = true;
    mni_relay_put(&g->relay, g->batch);
    return true;
}

/* The thread is over. */
static void end_sorting(mni_extintake *x) {
    mni_relay_close(&x->sorting.relay);
    x->sorting.open = false;
    x->pushed.bytes_read = x->sorting.from.bytes_read;
}

void mni_ext_sorting_stop(mni_extintake *x) {
    if (!x->sorting.open)
        return;
    atomic_store_explicit(&x->sorting.stop, true, memory_order_relaxed);
    end_sorting(x);
    mni_ext_sort_close(x, &x->sorting.sort);
    x->sorting.st = (mn_status){0};
}

/* Says how far it has come, and listens whether it is to go on. */
static bool wait_for_sorting(mni_extintake *x) {
    static const struct timespec nap = {.tv_nsec = 200 * 1000};
    while (!atomic_load_explicit(&x->sorting.over, memory_order_acquire)) {
        const uint64_t sorted = atomic_load_explicit(&x->sorting.sorted, memory_order_relaxed);
        if (mni_watch(&x->desc.watch, "number", sorted, 2 * x->vertices, x->st) != MN_OK)
            return false;
        nanosleep(&nap, NULL);
    }
    return true;
}

static bool tell_sorted(mni_extintake *x, uint64_t number) {
    return mni_ext_tell_vertices(x, number);
}

/* All vertices are in the sort, which hands them out from now on. */
static bool have_sorted(mni_extintake *x) {
    mni_ext_sorting *g = &x->sorting;
    if (g->open && !wait_for_sorting(x))
        return false;
    if (g->open) {
        end_sorting(x);
    } else {
        if (!open_sort(x))
            return false;
        g->from = x->pushed;
        sort_vertices(x, true, x->desc.threads, tell_sorted);
        x->pushed.bytes_read = g->from.bytes_read;
    }
    if (g->from.trouble.code != MN_OK)
        mn_fail(x->st, g->from.trouble.code, "%s", g->from.trouble.text);
    if (g->st.code != MN_OK)
        mn_fail(x->st, g->st.code, "%s", g->st.text);
    mni_ext_spill_close(x, &x->pushed);
    return x->st->code == MN_OK;
}

/* In order: the first of each position becomes a place. */
static bool weld_sorted(mni_extintake *x, mni_sort *sort) {
    const bool wide = mni_ext_is_wide(x);
    const size_t bytes = entry_bytes(x), position_bytes = (words_of(x) - 2) * sizeof(uint32_t);
    entry same[SAME_KEY_MAX] = {0}, e = {0}; /* places of this cell and hash, the last ones */
    mni_ext_words last = {0};
    uint32_t count = 0;
    uint64_t done = x->vertices;
    const void *record;
    mni_spill_writer w;
    mni_spill_writer_open(&w, &x->placed, x->buffer[1], x->buffer_bytes);
    while ((record = mni_sort_next(sort, x->st)) != NULL && mni_ext_tell_vertices(x, done++)) {
        memcpy(&e, record, bytes);
        if (e.cell == NO_CELL) {
            if (!map_vertex(x, e.word[0], MN_NONE))
                return false;
            continue;
        }
        if (count > 0 && (same[0].cell != e.cell || same[0].hash != e.hash))
            count = 0;
        uint32_t i = 0;
        while (i < count && memcmp(same[i].word + 1, e.word + 1, position_bytes) != 0)
            i++;
        if (i == SAME_KEY_MAX) {
            mn_fail(x->st, MN_BAD_INPUT, "%s: made to collide: its vertices cannot be told apart",
                    x->name);
            return false;
        }
        if (i == count) {
            const mni_ext_vertex place = mni_ext_vertex_of(e.word + 1, wide);
            same[count++] = e;
            mni_ext_put(&w, &last, wide, &place);
            x->places++;
        }
        if (!map_vertex(x, e.word[0], (uint32_t)(x->places - count + i)))
            return false;
    }
    mni_spill_end(&w);
    return x->st->code == MN_OK && mni_ext_spill_good(x, &x->placed);
}

bool mni_ext_place_vertices(mni_extintake *x) {
    bool one = mni_ext_buckets(x) == 1;
    bool ok = mni_ext_spill_open(x, &x->placed) && have_sorted(x) && (!one || take_map(x)) &&
              weld_sorted(x, x->sorting.sort);
    if (!x->sorting.open)
        mni_ext_sort_close(x, &x->sorting.sort);
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
    uint32_t pair[2] = {0};
    const unsigned char *at;
    mni_spill_reader_open(&r, &b->spill, b->pairs, b->found, x->buffer[0], x->buffer_bytes, true);
    while ((at = mni_spill_peek(&r, sizeof pair / 4 * MNI_VARINT32_MAX)) != NULL) {
        mni_spill_skip(&r, mni_words_get(at, pair, 2));
        x->map[pair[0] % x->window] = pair[1];
    }
    return mni_ext_spill_good(x, &b->spill);
}

static uint32_t place_of(const mni_extintake *x, uint32_t vertex) {
    MN_ASSERT(vertex < x->vertices); /* readers have seen to it */
    return x->map[vertex % x->window];
}

/* A bucket's triangles, by places; and lone corners, for the sequence. */
static bool look_up(mni_extintake *x, mni_ext_bucket *b) {
    mni_spill_reader r;
    mni_spill_writer w;
    mni_ext_item item = {0};
    uint32_t last[2] = {0}, last_place = 0;
    const unsigned char *at;
    mni_spill_reader_open(&r, &b->spill, 0, b->pairs, x->buffer[0], x->buffer_bytes, true);
    mni_spill_writer_open(&w, &b->spill, x->buffer[1], x->buffer_bytes);
    while ((at = mni_spill_peek(&r, MNI_EXT_ITEM_MAX)) != NULL) {
        mni_spill_skip(&r, mni_ext_item_get(at, &item, last));
        uint32_t place[3] = {place_of(x, item.corner[0])};
        if (item.lone) {
            unsigned char packed[MNI_VARINT32_MAX];
            mni_spill_put(&w, packed,
                          (size_t)(mni_words_put(packed, place, &last_place, 1) - packed));
            last_place = place[0];
            continue;
        }
        place[1] = place_of(x, item.corner[1]);
        place[2] = place_of(x, item.corner[2]);
        if (!mni_ext_judge(x, place, item.number))
            return false;
    }
    mni_spill_end(&w);
    return mni_ext_spill_good(x, &b->spill);
}

/* The next place that was found in a bucket. */
static bool next_found(mni_extintake *x, uint8_t bucket, uint32_t *place) {
    mni_ext_bucket *b = &x->bucket[bucket];
    const unsigned char *at = mni_spill_peek(&b->from, MNI_VARINT32_MAX);
    if (at == NULL)
        return mni_ext_spill_good(x, &b->spill) && false;
    mni_spill_skip(&b->from, mni_words_get(at, b->last, 1));
    *place = b->last[0];
    return true;
}

/* Triangles in several buckets: these side by side, each corner from the one that it was in. */
static bool in_sequence(mni_extintake *x) {
    mni_spill_reader r;
    uint32_t number = 0, place[3];
    const unsigned char *at;
    if (x->sequence.fd < 0)
        return true;
    for (uint64_t k = 0; k < mni_ext_buckets(x); k++) {
        mni_ext_bucket *b = &x->bucket[k];
        memset(b->last, 0, sizeof b->last);
        if (b->spill.fd >= 0)
            mni_spill_reader_open(&b->from, &b->spill, b->found, b->spill.size_bytes, b->buffer,
                                  x->bucket_bytes, true);
    }
    mni_spill_reader_open(&r, &x->sequence, 0, x->sequence.size_bytes, x->buffer[0],
                          x->buffer_bytes, true);
    while ((at = mni_spill_peek(&r, MNI_VARINT32_MAX + 3)) != NULL) {
        number += (uint32_t)mni_varint_get(&at);
        for (int i = 0; i < 3; i++)
            if (!next_found(x, at[i], &place[i]))
                return false;
        mni_spill_skip(&r, at + 3);
        if (!mni_ext_judge(x, place, number))
            return false;
    }
    return mni_ext_spill_good(x, &x->sequence);
}

static bool triangles_by_buckets(mni_extintake *x) {
    const bool whole = mni_ext_buckets(x) == 1; /* the map is there already */
    for (uint64_t k = 0; k < mni_ext_buckets(x); k++) {
        mni_ext_bucket *b = &x->bucket[k];
        if (b->spill.fd >= 0 && ((!whole && !load_map(x, b)) || !look_up(x, b)))
            return false;
    }
    return in_sequence(x);
}

/* A bucket's vertices are its triangles' corners. */
static bool triangles_of_soup(mni_extintake *x) {
    const bool whole = mni_ext_buckets(x) == 1;
    for (uint64_t t = 0; t < x->triangles; t++) {
        uint64_t at = 3 * t % x->window;
        if (at == 0 && !whole && !load_map(x, &x->bucket[3 * t / x->window]))
            return false;
        if (!mni_ext_judge(x, x->map + at, (uint32_t)t))
            return false;
    }
    return true;
}

bool mni_ext_place_triangles(mni_extintake *x) {
    bool ok = mni_ext_buckets(x) == 1 || (end_pairs(x) && take_map(x));
    ok = ok && mni_ext_faces_open(x) && (x->soup ? triangles_of_soup(x) : triangles_by_buckets(x));
    mni_ext_judge_end(x);
    MN_ASSERT(!ok || x->judged == x->triangles);
    for (int i = 0; i < MNI_EXT_BUCKETS; i++)
        mni_ext_spill_close(x, &x->bucket[i].spill);
    mni_ext_spill_close(x, &x->sequence);
    free_map(x);
    return ok;
}
