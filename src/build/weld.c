/* Welding: a hash table of positions, filled as vertices come.
 *
 * Secret: a look into the table is a cache miss, and one into the positions another. So vertices
 * wait in a small batch: their slots are fetched as they arrive, the positions that match when the
 * batch is full, and only then is each compared, in order.
 *
 *   add -> pending[0 … 31] (slot on its way) -> flush: position on its way -> compare -> number
 *
 * Order: open, reserve?, add …, flush, count_places?, close; count_only at any time before flush,
 * and then only add, vertices and close. Threads: one. Memory: 28 bytes a vertex (with
 * colours) and 10.7 to 16 a vertex for the table until close_table. (design.md §3.1) */
#include "weld.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "mn_assert.h"

#include <xxhash.h>

enum { CAPACITY_MIN = 1024, KEY_BYTES_MAX = 24 };

/* Floats must hold positions, and squares of differences should not overflow at once. */
static const double coordinate_max = FLT_MAX / 4;

void mni_weld_open(mni_weld *weld, bool apart, uint32_t **target) {
    /* seeded by an address: no file can be made to hash badly, and no result depends on it */
    *weld = (mni_weld){.apart = apart, .target = target, .seed = (uint64_t)(uintptr_t)weld};
}

void mni_weld_close_table(mni_weld *weld) {
    MN_ASSERT(weld->pending_count == 0);
    mni_table_close(&weld->table);
    weld->table_capacity = 0;
}

void mni_weld_close(mni_weld *weld) {
    free(weld->position);
    free(weld->color);
    mni_table_close(&weld->table);
    weld->position = NULL;
    weld->color = NULL;
    weld->capacity = weld->table_capacity = 0;
    weld->pending_count = 0;
}

/* ---- room ----------------------------------------------------------------------------------- */

static uint64_t grown(uint64_t capacity) {
    uint64_t more = capacity + capacity / 2;
    return more < CAPACITY_MIN ? CAPACITY_MIN : more;
}

uint64_t mni_weld_table_bytes(uint64_t vertices, bool reserved) {
    return mni_table_bytes(reserved ? vertices : grown(vertices));
}

static bool resize(void **array, uint64_t count, size_t item_bytes) {
    void *other = realloc(*array, count * item_bytes);
    if (other == NULL)
        return false;
    *array = other;
    return true;
}

static bool resize_vertices(mni_weld *weld, uint64_t capacity) {
    if (weld->color != NULL && !resize((void **)&weld->color, capacity, sizeof(uint32_t)))
        return false;
    if (!resize((void **)&weld->position, capacity, 3 * sizeof(double)))
        return false;
    weld->capacity = capacity;
    return true;
}

static uint64_t hash_of(const mni_weld *weld, const double position[3]) {
    return XXH3_64bits_withSeed(position, 3 * sizeof *position, weld->seed);
}

/* Another table: the old one is not needed to fill it, the positions are. */
static bool resize_table(mni_weld *weld, uint64_t capacity) {
    mni_table_close(&weld->table);
    weld->table_capacity = 0;
    if (!mni_table_open(&weld->table, capacity))
        return false;
    weld->table_capacity = capacity;
    for (uint64_t v = 0; v < weld->vertices; v++) {
        uint64_t hash = hash_of(weld, weld->position + 3 * v);
        uint64_t at = mni_table_first(&weld->table, hash);
        uint32_t other;
        while (mni_table_find(&weld->table, hash, &at, &other)) /* all are different */
            at = mni_table_next(&weld->table, at);
        mni_table_put(&weld->table, at, hash, (uint32_t)v);
    }
    return true;
}

bool mni_weld_reserve(mni_weld *weld, uint64_t vertices) {
    MN_ASSERT(weld->vertices == 0 && weld->position == NULL);
    if (vertices == 0)
        return true;
    return resize_vertices(weld, vertices) && (weld->apart || resize_table(weld, vertices));
}

/* ---- vertices ------------------------------------------------------------------------------- */

bool mni_weld_normalise(double p[3]) {
    for (int i = 0; i < 3; i++) {
        if (!(p[i] >= -coordinate_max && p[i] <= coordinate_max)) {
            p[0] = (double)NAN;
            p[1] = p[2] = 0;
            return false;
        }
        p[i] += 0.0;
    }
    return true;
}

static bool append(mni_weld *weld, const double p[3], uint32_t rgba) {
    if (weld->vertices == weld->capacity && !resize_vertices(weld, grown(weld->capacity)))
        return false;
    if (rgba != MNI_WHITE && weld->color == NULL) { /* all so far were without */
        if (!resize((void **)&weld->color, weld->capacity, sizeof(uint32_t)))
            return false;
        memset(weld->color, 0xff, weld->vertices * sizeof *weld->color);
    }
    memcpy(weld->position + 3 * weld->vertices, p, 3 * sizeof *p);
    if (weld->color != NULL)
        weld->color[weld->vertices] = rgba;
    weld->vertices++;
    return true;
}

/* Finds the vertex there, or makes it one. */
static bool settle(mni_weld *weld, const mni_weld_pending *p) {
    uint32_t *number = *weld->target + p->target;
    if (isnan(p->position[0])) { /* equals nothing */
        *number = (uint32_t)weld->vertices;
        return append(weld, p->position, p->rgba);
    }
    if (weld->vertices >= weld->table_capacity && !resize_table(weld, grown(weld->table_capacity)))
        return false;
    uint64_t at = mni_table_first(&weld->table, p->hash);
    while (mni_table_find(&weld->table, p->hash, &at, number)) {
        if (memcmp(weld->position + 3 * (uint64_t)*number, p->position, sizeof p->position) == 0)
            return true;
        at = mni_table_next(&weld->table, at);
    }
    *number = (uint32_t)weld->vertices;
    mni_table_put(&weld->table, at, p->hash, *number);
    return append(weld, p->position, p->rgba);
}

bool mni_weld_flush(mni_weld *weld) {
    uint32_t count = weld->pending_count;
    weld->pending_count = 0;
    for (uint32_t i = 0; i < count && weld->table_capacity > 0; i++) {
        uint64_t hash = weld->pending[i].hash, at = mni_table_first(&weld->table, hash);
        uint32_t vertex;
        if (mni_table_find(&weld->table, hash, &at, &vertex))
            __builtin_prefetch(weld->position + 3 * (uint64_t)vertex);
    }
    for (uint32_t i = 0; i < count; i++)
        if (!settle(weld, &weld->pending[i]))
            return false;
    return true;
}

static void count(mni_weld *weld, const double position[3]) {
    if (!isnan(position[0]))
        mni_sketch_add(&weld->sketch, hash_of(weld, position));
    weld->vertices++;
}

void mni_weld_count_only(mni_weld *weld) {
    if (weld->counting)
        return;
    uint64_t vertices = weld->vertices;
    weld->vertices = 0;
    for (uint64_t v = 0; v < vertices; v++)
        count(weld, weld->position + 3 * v);
    for (uint32_t i = 0; i < weld->pending_count; i++)
        count(weld, weld->pending[i].position);
    mni_weld_close(weld);
    weld->counting = true;
}

uint64_t mni_weld_vertices(const mni_weld *weld) {
    if (!weld->counting || weld->apart)
        return weld->vertices;
    uint64_t bound = mni_sketch_bound(&weld->sketch) + weld->nonfinite;
    return bound < weld->vertices ? bound : weld->vertices;
}

bool mni_weld_add(mni_weld *weld, const double position[3], uint32_t rgba, uint64_t target) {
    mni_weld_pending *p = &weld->pending[weld->pending_count];
    memcpy(p->position, position, sizeof p->position);
    weld->nonfinite += !mni_weld_normalise(p->position);
    if (weld->counting) {
        count(weld, p->position);
        return true;
    }
    if (weld->apart)
        return append(weld, p->position, rgba);
    p->rgba = rgba;
    p->target = target;
    p->hash = hash_of(weld, p->position);
    if (weld->table_capacity > 0)
        mni_table_prefetch(&weld->table, p->hash);
    return ++weld->pending_count < MNI_WELD_BATCH || mni_weld_flush(weld);
}

/* ---- counting places ------------------------------------------------------------------------ */

bool mni_weld_count_places(const mni_weld *weld, mni_weld_key key, const void *context,
                           size_t key_bytes, uint64_t *places) {
    MN_ASSERT(key_bytes <= KEY_BYTES_MAX);
    mni_table table;
    *places = 0;
    if (!mni_table_open(&table, weld->vertices))
        return false;
    for (uint64_t v = 0; v < weld->vertices; v++) {
        unsigned char mine[KEY_BYTES_MAX], theirs[KEY_BYTES_MAX];
        key(weld->position + 3 * v, context, mine);
        uint64_t hash = XXH3_64bits_withSeed(mine, key_bytes, weld->seed);
        uint64_t at = mni_table_first(&table, hash);
        uint32_t other;
        bool known = false;
        while (!known && mni_table_find(&table, hash, &at, &other)) {
            key(weld->position + 3 * (uint64_t)other, context, theirs);
            known = memcmp(mine, theirs, key_bytes) == 0;
            at = known ? at : mni_table_next(&table, at);
        }
        if (!known) {
            mni_table_put(&table, at, hash, (uint32_t)v);
            (*places)++;
        }
    }
    mni_table_close(&table);
    return true;
}
