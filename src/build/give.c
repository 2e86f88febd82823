/* See give.h. Hidden here: which tile, and in which order.
 *
 * First each vertex gets its tile, then simplices theirs, and their corners learn how far they
 * reach: corners that are not here by sights. Then tile by tile: vertices and simplices as they
 * stand in the cell, those that pass through it last. */
#include "give.h"

#include <string.h>

#include "mem.h"
#include "mn_assert.h"

/* What of the cell goes where: the tile in the upper half, which one in the lower. */
typedef struct list {
    uint64_t *item;
    uint32_t count, next;
} list;

typedef struct standing {
    uint32_t tile;
    mni_wire_reach reach;
} standing;

enum { VERTICES, SIMPLICES, SIGHTS, LISTS };
enum { TILE_SHIFT = 32, DIGIT_BITS = 8, DIGIT_MASK = (1 << DIGIT_BITS) - 1 };
enum { PARCEL_BYTES = 112 << 10 }; /* one of a surface is rarely longer */

typedef struct giver {
    mni_outlet to;
    const mni_cell *cell;
    standing *stands;      /* by vertex; of those that are there still */
    mni_wire_sight *sight; /* of passing simplices */
    list list[LISTS];      /* of vertices; of simplices, passing ones behind; of sights */
    uint64_t *other;       /* as long as the longest, while they are sorted */
    mni_parcel parcel;     /* that is being filled */
    unsigned char *bytes;
    size_t used, room;
} giver;

static uint32_t corners_of(const mni_wire_simplex *x) {
    return x->v[2] == MN_NONE ? 2 : 3;
}

static void add(giver *g, int which, uint32_t tile, uint32_t number) {
    list *l = &g->list[which];
    l->item[l->count++] = (uint64_t)tile << 32 | number;
}

/* ---- where everything goes ------------------------------------------------------------------ */

static uint32_t tile_of(const giver *g, const float p[3], uint32_t id) {
    return mni_tiles_find(g->to.tiles, mni_curve_key(g->to.curve, p), id);
}

static void stand(giver *g) {
    const mni_cell *cell = g->cell;
    for (uint32_t v = 0; v < cell->first_hub; v++) {
        const mni_vertex *vertex = &cell->s.surface.vertex[v];
        if (v < cell->own && vertex->node == MN_NONE)
            continue;
        uint32_t tile = tile_of(g, vertex->p, cell->node[v].id);
        g->stands[v] = (standing){tile, {tile, tile}};
        if (v < cell->own)
            add(g, VERTICES, tile, v);
    }
}

/* Hubs are in no tile. */
static bool is_hub(const giver *g, uint32_t v) {
    return v >= g->cell->first_hub && v != MN_NONE;
}

/* Where all are hubs, it matters to nobody. */
static mni_wire_reach reach_of(const giver *g, const uint32_t v[3]) {
    mni_wire_reach reach = {UINT32_MAX, 0};
    for (int c = 0; c < 3 && v[c] != MN_NONE; c++)
        if (!is_hub(g, v[c])) {
            uint32_t tile = g->stands[v[c]].tile;
            mni_wire_widen(&reach, (mni_wire_reach){tile, tile});
        }
    return reach.low <= reach.high ? reach : (mni_wire_reach){0, 0};
}

static void look_at_simplices(giver *g) {
    const mni_surface *s = &g->cell->s.surface;
    for (uint32_t x = 0; x < s->simplices; x++) {
        const uint32_t *v = s->simplex[x].v;
        if (s->simplex[x].killed != MN_NONE)
            continue;
        mni_wire_reach reach = reach_of(g, v);
        for (int c = 0; c < 3 && v[c] != MN_NONE; c++)
            if (!is_hub(g, v[c]))
                mni_wire_widen(&g->stands[v[c]].reach, reach);
        if (mni_cell_has_simplex(g->cell, x))
            add(g, SIMPLICES, reach.low, x);
    }
}

/* Of simplices between cells no cell has all corners: each is told of the others. */
static void look_at_passing(giver *g) {
    for (uint32_t i = 0; i < g->cell->passing_count; i++) {
        mni_cell_passing *p = &g->cell->passing[i];
        mni_wire_simplex *x = &p->simplex;
        uint32_t tile[3];
        x->reach = (mni_wire_reach){UINT32_MAX, 0};
        for (uint32_t c = 0; c < corners_of(x); c++) {
            if (is_hub(g, p->at[c]))
                continue;
            tile[c] = p->at[c] != MN_NONE ? g->stands[p->at[c]].tile : tile_of(g, x->p[c], x->v[c]);
            mni_wire_widen(&x->reach, (mni_wire_reach){tile[c], tile[c]});
        }
        for (uint32_t c = 0; c < corners_of(x); c++)
            if (is_hub(g, p->at[c])) {
                continue;
            } else if (p->at[c] != MN_NONE) {
                mni_wire_widen(&g->stands[p->at[c]].reach, x->reach);
            } else if (x->reach.low < x->reach.high) {
                uint32_t number = g->list[SIGHTS].count;
                add(g, SIGHTS, tile[c], number);
                g->sight[number] = (mni_wire_sight){x->v[c], x->reach};
            }
        add(g, SIMPLICES, x->reach.low, g->cell->s.surface.simplices + i);
    }
}

/* ---- parcels -------------------------------------------------------------------------------- */

/* Where so many bytes more may go; NULL: no memory. */
static unsigned char *more(giver *g, size_t bytes) {
    if (g->room - g->used < bytes) {
        size_t room = (g->room > 0 ? g->room + g->room / 2 : PARCEL_BYTES) + bytes;
        unsigned char *grown =
            g->room > 0 ? mni_mem_grow(g->bytes, g->used, room) : mni_mem_take(room, 0);
        if (grown == NULL)
            return NULL;
        g->bytes = grown;
        g->room = room;
    }
    return g->bytes + g->used;
}

/* How many of the list's next are in the tile. */
static uint32_t count_of(const list *l, uint32_t tile) {
    uint32_t count = 0;
    while (l->next + count < l->count && l->item[l->next + count] >> 32 == tile)
        count++;
    return count;
}

static unsigned char *put_id(giver *g, mni_wire_pen *pen, unsigned char *to, uint32_t v) {
    return mni_wire_put_id(pen, to, g->cell->node[v].id);
}

static unsigned char *put_vertex(giver *g, mni_wire_pen *pen, unsigned char *to, uint32_t v) {
    mni_wire_vertex out;
    bool there = mni_cell_vertex(g->cell, v, &out);
    MN_ASSERT(there);
    out.reach = g->stands[v].reach;
    g->parcel.nodes += out.node >= MNI_COLLAPSE;
    for (int i = 0; i < MNI_WITNESSES && out.node < MNI_COLLAPSE; i++)
        g->parcel.points += out.points.slack[i] >= 0;
    return mni_wire_put_vertex(pen, to, &out);
}

static unsigned char *put_simplex(giver *g, mni_wire_pen *pen, unsigned char *to, uint32_t x) {
    const mni_surface *s = &g->cell->s.surface;
    if (x >= s->simplices)
        return mni_wire_put_simplex(pen, to, &g->cell->passing[x - s->simplices].simplex);
    mni_wire_simplex out;
    mni_cell_simplex(g->cell, x, reach_of(g, s->simplex[x].v), &out);
    return mni_wire_put_simplex(pen, to, &out);
}

static unsigned char *put_sight(giver *g, mni_wire_pen *pen, unsigned char *to, uint32_t i) {
    return mni_wire_put_sight(pen, to, &g->sight[i]);
}

typedef unsigned char *(*put)(giver *g, mni_wire_pen *pen, unsigned char *to, uint32_t which);

/* So many of the list's, from its next on. */
static bool fill(giver *g, int which, uint32_t count, put what, size_t record_max,
                 uint32_t *section_bytes) {
    const list *l = &g->list[which];
    mni_wire_pen pen = mni_wire_pen_open(g->parcel.tile, g->to.step);
    size_t before = g->used;
    for (uint32_t i = 0; i < count; i++) {
        unsigned char *to = more(g, record_max);
        if (to == NULL)
            return false;
        g->used = (size_t)(what(g, &pen, to, (uint32_t)l->item[l->next + i]) - g->bytes);
    }
    *section_bytes = (uint32_t)(g->used - before);
    return true;
}

static bool give_tile(giver *g, uint32_t tile) {
    mni_parcel *p = &g->parcel;
    *p = (mni_parcel){.tile = tile,
                      .source = g->to.source,
                      .vertices = count_of(&g->list[VERTICES], tile),
                      .simplices = count_of(&g->list[SIMPLICES], tile),
                      .sights = count_of(&g->list[SIGHTS], tile)};
    g->used = 0;
    if (more(g, sizeof *p) == NULL)
        return false;
    g->used = sizeof *p;
    if (!fill(g, VERTICES, p->vertices, put_id, MNI_WIRE_ID_MAX, &p->ids_bytes) ||
        !fill(g, VERTICES, p->vertices, put_vertex, MNI_WIRE_VERTEX_MAX, &p->vertices_bytes) ||
        !fill(g, SIMPLICES, p->simplices, put_simplex, MNI_WIRE_SIMPLEX_MAX, &p->simplices_bytes) ||
        !fill(g, SIGHTS, p->sights, put_sight, MNI_WIRE_SIGHT_MAX, &p->sights_bytes))
        return false;
    g->list[VERTICES].next += p->vertices;
    g->list[SIMPLICES].next += p->simplices;
    g->list[SIGHTS].next += p->sights;
    mni_tiles_put(g->to.tiles, p, g->bytes);
    return true;
}

/* The least that any list has next; MN_NONE: none has anything. */
static uint32_t next_tile(const giver *g) {
    uint32_t tile = MN_NONE;
    for (int i = 0; i < LISTS; i++) {
        const list *l = &g->list[i];
        uint32_t next = l->next < l->count ? (uint32_t)(l->item[l->next] >> 32) : MN_NONE;
        tile = next < tile ? next : tile;
    }
    return tile;
}

/* By tile, and in each as they were put, which is by number: a digit at a time, up to the highest
 * in which any two differ. other: as long as the list. */
static void sort_by_tile(list *l, uint64_t *other) {
    uint64_t *from = l->item, *to = other, differ = 0;
    for (uint32_t i = 1; i < l->count; i++)
        differ |= from[i] ^ from[0];
    for (uint32_t shift = TILE_SHIFT; shift < 64 && differ >> shift > 0; shift += DIGIT_BITS) {
        uint32_t next[1 << DIGIT_BITS] = {0}, sum = 0;
        for (uint32_t i = 0; i < l->count; i++)
            next[from[i] >> shift & DIGIT_MASK]++;
        for (uint32_t d = 0; d <= DIGIT_MASK; d++) {
            const uint32_t here = next[d];
            next[d] = sum;
            sum += here;
        }
        for (uint32_t i = 0; i < l->count; i++)
            to[next[from[i] >> shift & DIGIT_MASK]++] = from[i];
        uint64_t *sorted = to;
        to = from;
        from = sorted;
    }
    if (from != l->item)
        memcpy(l->item, from, l->count * sizeof *from);
}

/* ---- from the outside ----------------------------------------------------------------------- */

static bool take_room(giver *g) {
    const mni_cell *cell = g->cell;
    const size_t most[LISTS] = {cell->own, (size_t)cell->s.surface.simplices + cell->passing_count,
                                3 * (size_t)cell->passing_count};
    bool good = true;
    size_t longest = 0;
    for (int i = 0; i < LISTS; i++) {
        longest = most[i] > longest ? most[i] : longest;
        g->list[i].item = mni_mem_take((most[i] + 1) * sizeof *g->list[i].item, 0);
        good &= g->list[i].item != NULL;
    }
    g->other = mni_mem_take((longest + 1) * sizeof *g->other, 0);
    g->stands = mni_mem_take(cell->vertices * sizeof *g->stands, 0);
    g->sight = mni_mem_take((most[SIGHTS] + 1) * sizeof *g->sight, 0);
    return good && g->other != NULL && g->stands != NULL && g->sight != NULL;
}

mn_code mni_give(const mni_outlet *outlet, const mni_cell *cell, mn_status *st) {
    giver g = {.to = *outlet, .cell = cell};
    bool good = take_room(&g);
    if (good) {
        stand(&g);
        look_at_simplices(&g);
        look_at_passing(&g);
        for (int i = 0; i < LISTS; i++)
            sort_by_tile(&g.list[i], g.other);
    }
    mni_mem_give(g.other);
    for (uint32_t tile; good && (tile = next_tile(&g)) != MN_NONE;)
        good = give_tile(&g, tile);
    for (int i = 0; i < LISTS; i++)
        mni_mem_give(g.list[i].item);
    mni_mem_give(g.stands);
    mni_mem_give(g.sight);
    mni_mem_give(g.bytes);
    return good ? MN_OK : mn_fail(st, MN_FAILED, "out of memory for a cell");
}
