/* See tiles.h. Hidden here: the chain of a tile's parcels, and what is in memory of it.
 *
 * The buffer is the end of the file that is not written yet: when it is full, all of it is. */
#include "tiles.h"

#include <stdlib.h>
#include <string.h>

#include "mem.h"
#include "mn_assert.h"
#include "varint.h"

/* Whether the tile that begins there begins behind a vertex. */
static bool is_behind(const mni_tile_sample *cut, uint64_t key, uint32_t id) {
    return cut->key != key ? cut->key > key : cut->id > id;
}

static mn_code no_memory(mn_status *st) {
    return mn_fail(st, MN_FAILED, "out of memory for the parts of a round");
}

/* ---- cutting -------------------------------------------------------------------------------- */

static mn_code cut(mni_tiles *t, mni_sort *samples, mn_status *st) {
    uint64_t count = samples != NULL ? mni_sort_figures_get(samples).records : 0;
    uint32_t wanted = t->tiles;
    const mni_tile_sample *s;
    t->tiles = 1;
    for (uint64_t i = 0; i < count && (s = mni_sort_next(samples, st)) != NULL; i++)
        if (t->tiles < wanted && i >= count * t->tiles / wanted && i > 0)
            t->cut[t->tiles++] = *s;
    return st->code;
}

mn_code mni_tiles_open(mni_tiles *t, uint32_t tiles, mni_sort *samples, size_t buffer_bytes,
                       const char *temp_dir, mn_status *st) {
    MN_ASSERT(tiles > 0 && buffer_bytes > 0);
    *t = (mni_tiles){.lock = PTHREAD_MUTEX_INITIALIZER,
                     .tiles = tiles,
                     .buffer_bytes = buffer_bytes,
                     .spill = {.fd = -1, .dir = temp_dir}};
    t->cut = malloc(tiles * sizeof *t->cut);
    t->tile = calloc(tiles, sizeof *t->tile);
    t->buffer = malloc(buffer_bytes);
    mn_code code = MN_OK;
    if (t->cut == NULL || t->tile == NULL || t->buffer == NULL)
        code = no_memory(st);
    if (code == MN_OK)
        code = cut(t, samples, st);
    if (code != MN_OK)
        mni_tiles_close(t);
    return code;
}

void mni_tiles_close(mni_tiles *t) {
    mni_spill_close(&t->spill);
    free(t->cut);
    free(t->tile);
    free(t->buffer);
    free(t->first);
    *t = MNI_TILES_CLOSED;
}

uint32_t mni_tiles_find(const mni_tiles *t, uint64_t key, uint32_t id) {
    uint32_t low = 0, high = t->tiles;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        bool behind = is_behind(&t->cut[middle], key, id);
        low = behind ? low : middle;
        high = behind ? middle : high;
    }
    return low;
}

/* ---- putting -------------------------------------------------------------------------------- */

static size_t parcel_bytes(const mni_parcel *p) {
    return sizeof *p + p->ids_bytes + p->vertices_bytes + p->simplices_bytes + p->sights_bytes;
}

/* Under the lock. */
static void flush(mni_tiles *t) {
    if (t->spill.fd < 0 && t->spill.trouble.code == MN_OK) {
        mn_status st = {0};
        mni_spill opened;
        if (mni_spill_open(&opened, t->spill.dir, &st) == MN_OK)
            t->spill = opened;
        else
            t->spill.trouble = st;
    }
    mni_spill_append(&t->spill, t->buffer, t->used_bytes);
    t->used_bytes = 0;
}

/* Under the lock. */
static void append(mni_tiles *t, const unsigned char *bytes, size_t count) {
    while (count > 0) {
        if (t->used_bytes == t->buffer_bytes)
            flush(t);
        size_t room = t->buffer_bytes - t->used_bytes, part = count < room ? count : room;
        memcpy(t->buffer + t->used_bytes, bytes, part);
        t->used_bytes += part;
        bytes += part;
        count -= part;
    }
}

void mni_tiles_put(mni_tiles *t, mni_parcel *head, unsigned char *parcel) {
    MN_ASSERT(head->tile < t->tiles);
    pthread_mutex_lock(&t->lock);
    mni_tile *tile = &t->tile[head->tile];
    size_t bytes = parcel_bytes(head);
    head->before = tile->last;
    head->before_bytes = tile->last_bytes;
    memcpy(parcel, head, sizeof *head);
    tile->last = t->spill.size_bytes + t->used_bytes;
    tile->last_bytes = (uint32_t)bytes;
    tile->parcels++;
    tile->vertices += head->vertices;
    tile->simplices += head->simplices;
    tile->bytes += bytes;
    if (t->spill.trouble.code == MN_OK)
        append(t, parcel, bytes);
    pthread_mutex_unlock(&t->lock);
}

mn_code mni_tiles_empty(mni_tiles *t, mn_status *st) {
    if (t->used_bytes > 0)
        flush(t);
    free(t->buffer);
    t->buffer = NULL;
    t->buffer_bytes = 0;
    if (t->spill.trouble.code != MN_OK)
        mn_fail(st, t->spill.trouble.code, "%s", t->spill.trouble.text);
    return t->spill.trouble.code;
}

/* ---- cells ---------------------------------------------------------------------------------- */

/* As many vertices as it takes room for. A surface has twice as many simplices. */
static uint64_t weight_of(const mni_tile *tile) {
    uint64_t dense = (uint64_t)tile->simplices * 2 / 5;
    return tile->vertices > dense ? tile->vertices : dense;
}

mn_code mni_tiles_finish(mni_tiles *t, uint32_t cell_vertices, mn_status *st) {
    uint64_t all = 0, before = 0, own = 0; /* own: of the cell that is being filled */
    if (t->spill.trouble.code != MN_OK)
        return mn_fail(st, t->spill.trouble.code, "%s", t->spill.trouble.text);
    t->first = malloc(((size_t)t->tiles + 1) * sizeof *t->first);
    if (t->first == NULL)
        return no_memory(st);
    for (uint32_t i = 0; i < t->tiles; i++) {
        t->vertices += t->tile[i].vertices;
        t->simplices += t->tile[i].simplices;
        all += weight_of(&t->tile[i]);
    }
    uint64_t cells = (all + cell_vertices - 1) / cell_vertices;
    for (uint32_t i = 0; i < t->tiles; i++) {
        uint64_t weight = weight_of(&t->tile[i]);
        if (t->cells == 0 || (own > 0 && before + weight / 2 >= all * t->cells / cells)) {
            t->first[t->cells++] = i;
            own = 0;
        }
        before += weight;
        own += weight;
    }
    t->first[t->cells] = t->tiles;
    return MN_OK;
}

mni_crate mni_tiles_cell(const mni_tiles *t, uint32_t cell) {
    MN_ASSERT(cell < t->cells);
    mni_crate crate = {.first_tile = t->first[cell], .end_tile = t->first[cell + 1]};
    for (uint32_t i = crate.first_tile; i < crate.end_tile; i++) {
        const mni_tile *tile = &t->tile[i];
        crate.vertices += tile->vertices;
        crate.simplices += tile->simplices;
        crate.parcels += tile->parcels;
        crate.bytes += tile->bytes;
    }
    return crate;
}

/* ---- taking --------------------------------------------------------------------------------- */

/* Under the lock. */
static mn_code read_back(mni_tiles *t, uint64_t at, unsigned char *to, size_t count) {
    uint64_t written = t->spill.size_bytes;
    size_t there = at >= written ? 0 : count < written - at ? count : (size_t)(written - at);
    mn_code code = MN_OK;
    if (there > 0)
        code = mni_spill_read_at(&t->spill, at, to, there);
    if (there < count)
        memcpy(to + there, t->buffer + (at + there - written), count - there);
    return code;
}

static int by_source(const void *a, const void *b) {
    mni_parcel x, y;
    memcpy(&x, *(const unsigned char *const *)a, sizeof x);
    memcpy(&y, *(const unsigned char *const *)b, sizeof y);
    return x.source < y.source ? -1 : x.source > y.source;
}

static void leave_out(mni_parcel *head) {
    head->simplices = head->sights = 0;
    head->simplices_bytes = head->sights_bytes = 0;
}

/* Under the lock. A tile's parcels, from the last to the first; behind what they take. */
static unsigned char *take_tile(mni_tiles *t, const mni_tile *tile, mni_crate *c, uint32_t *next,
                                unsigned char *to) {
    mni_parcel head = {.before = tile->last, .before_bytes = tile->last_bytes};
    uint32_t first = *next;
    for (uint32_t i = 0; i < tile->parcels; i++) {
        size_t bytes = head.before_bytes;
        const uint64_t at = head.before;
        if (read_back(t, at, to, t->shed ? sizeof head : bytes) != MN_OK)
            break;
        memcpy(&head, to, sizeof head);
        if (t->shed) {
            leave_out(&head);
            memcpy(to, &head, sizeof head);
            bytes = parcel_bytes(&head);
            if (read_back(t, at + sizeof head, to + sizeof head, bytes - sizeof head) != MN_OK)
                break;
        }
        if (i + 1 < tile->parcels && head.before < t->spill.size_bytes)
            mni_spill_ask(&t->spill, head.before, head.before_bytes);
        c->nodes += head.nodes;
        c->points += head.points;
        c->parcel[(*next)++] = to;
        to += bytes;
    }
    qsort(c->parcel + first, *next - first, sizeof *c->parcel, by_source);
    return to;
}

mn_code mni_tiles_take(mni_tiles *t, mni_crate *c, mn_status *st) {
    unsigned char *to = c->content =
        mni_mem_take((size_t)c->bytes + MNI_VARINT_WINDOW, (size_t)c->bytes);
    uint32_t next = 0;
    c->parcel = mni_mem_take(((size_t)c->parcels + 1) * sizeof *c->parcel, 0);
    if (c->content == NULL || c->parcel == NULL)
        return no_memory(st);
    pthread_mutex_lock(&t->lock);
    for (uint32_t i = c->first_tile; i < c->end_tile && t->spill.trouble.code == MN_OK; i++)
        to = take_tile(t, &t->tile[i], c, &next, to);
    if (t->spill.trouble.code != MN_OK)
        mn_fail(st, t->spill.trouble.code, "%s", t->spill.trouble.text);
    pthread_mutex_unlock(&t->lock);
    return st->code;
}

/* ---- without simplices ---------------------------------------------------------------------- */

/* Where a parcel lies. */
typedef struct place {
    uint64_t at;
    mni_parcel head;
} place;

typedef struct shedding {
    mn_code (*take)(void *context, const mni_parcel *head, const unsigned char *simplices,
                    mn_status *st);
    void *context;
    place *place; /* of a tile's parcels */
    unsigned char *simplices;
    size_t room; /* for them */
    mn_status *st;
} shedding;

static int by_head(const void *a, const void *b) {
    const place *x = a, *y = b;
    return x->head.source < y->head.source ? -1 : x->head.source > y->head.source;
}

static mn_code shed_parcel(mni_tiles *t, const place *p, shedding *s) {
    const uint64_t at = p->at + sizeof p->head + p->head.ids_bytes + p->head.vertices_bytes;
    if (p->head.simplices_bytes > s->room) {
        mni_mem_give(s->simplices);
        s->room = p->head.simplices_bytes;
        s->simplices = mni_mem_take(s->room + MNI_VARINT_WINDOW, 0);
        if (s->simplices == NULL)
            return no_memory(s->st);
    }
    mn_code code = read_back(t, at, s->simplices, p->head.simplices_bytes);
    return code == MN_OK ? s->take(s->context, &p->head, s->simplices, s->st) : code;
}

static mn_code shed_tile(mni_tiles *t, mni_tile *tile, shedding *s) {
    mn_code code = MN_OK;
    uint64_t at = tile->last;
    s->place = mni_mem_take(((size_t)tile->parcels + 1) * sizeof *s->place, 0);
    if (s->place == NULL)
        return no_memory(s->st);
    for (uint32_t i = 0; i < tile->parcels && code == MN_OK; i++) {
        place *p = &s->place[i];
        p->at = at;
        code = read_back(t, at, (unsigned char *)&p->head, sizeof p->head);
        at = p->head.before;
    }
    if (code == MN_OK)
        qsort(s->place, tile->parcels, sizeof *s->place, by_head);
    for (uint32_t i = 0; i < tile->parcels && code == MN_OK; i++) {
        const mni_parcel *head = &s->place[i].head;
        tile->bytes -= head->simplices_bytes + head->sights_bytes;
        code = shed_parcel(t, &s->place[i], s);
    }
    tile->simplices = 0;
    mni_mem_give(s->place);
    return code;
}

mn_code mni_tiles_shed(mni_tiles *t,
                       mn_code (*take)(void *context, const mni_parcel *head,
                                       const unsigned char *simplices, mn_status *st),
                       void *context, mn_status *st) {
    shedding s = {.take = take, .context = context, .st = st};
    mn_code code = MN_OK;
    pthread_mutex_lock(&t->lock);
    for (uint32_t i = 0; i < t->tiles && code == MN_OK; i++)
        code = shed_tile(t, &t->tile[i], &s);
    t->simplices = 0;
    t->shed = true;
    if (t->spill.trouble.code != MN_OK)
        code = mn_fail(st, t->spill.trouble.code, "%s", t->spill.trouble.text);
    pthread_mutex_unlock(&t->lock);
    mni_mem_give(s.simplices);
    return code;
}

void mni_crate_free(mni_crate *c) {
    mni_mem_give(c->content);
    mni_mem_give(c->parcel);
    c->content = NULL;
    c->parcel = NULL;
}
