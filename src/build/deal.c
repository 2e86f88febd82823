/* See deal.h. Hidden here: who lacks what, and how it gets there.
 *
 * Order of calls: open (both passes), next × cells, close. */
#include "deal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "exttriangles.h"
#include "heavy.h"
#include "mem.h"
#include "watch.h"
#include "wire.h"

enum { BUFFERS = 2, SORTS = 4 };
/* Times that cells with too many triangles are cut: of what lies unevenly in them, once more. */
enum { CUTS_MAX = 4 };

/* Triangles for which there is a counter of hubs. Numbers that cross are counted there, a few in a
 * hundred of a surface's: a fan falls short by a few. Where all of them cross, by 3 × 512, and by
 * more from 33 M triangles on. */
enum { TRIANGLES_A_COUNTER = 512, COUNTERS_MIN = 256, COUNTERS_MAX = 1 << 16 };
/* Where a cell has more than this times the triangles of a hub, it may be that each of several fans
 * is not too large, but all of them are: less makes a hub there, by this part. */
enum { CROWDED = 5, CROWDED_PART = 8 };

/* What a cell will be dealt, its own vertices apart. */
typedef struct tally {
    uint32_t triangles, ghosts;
} tally;

/* A triangle at vertices of a cell whose file position is another's. */
typedef struct copy {
    uint32_t cell, corner[3];
} copy;

/* A cell lacks a vertex: by vertex, then cell. */
typedef struct lack {
    uint32_t cell, vertex;
} lack;

/* By cell, then vertex. */
typedef struct found {
    uint32_t vertex, cell;
    float position[3];
} found;

struct mni_deal {
    mni_extmesh *mesh;
    mni_deal_desc desc;
    uint32_t cells;
    uint32_t *start; /* of a cell, and behind the last: first vertices; NULL: all are alike */
    uint32_t next;   /* cell */
    float low[3], high[3], step;
    mni_sort *copies, *lacks, *ghosts, *samples;
    const copy *next_copy;
    const found *next_ghost;
    mni_spill_reader vertices;
    mni_exttriangles triangles;
    const mni_exttriangle *next_triangle;
    unsigned char *buffer[BUFFERS];
    size_t buffer_bytes;
    uint64_t bytes_read, bytes_written; /* by sorts that are closed */
    tally *of_cell;
    mni_ghost *hub; /* by id */
    uint32_t hubs;
    /* while hubs are looked for */
    mni_heavy heavy;
    uint32_t *fan; /* of the vertices of the cell that the file is at */
};

static uint32_t cell_start(const mni_deal *d, uint32_t c) {
    return d->start != NULL ? d->start[c] : (uint32_t)(d->mesh->vertices * c / d->cells);
}

static uint32_t cell_of(const mni_deal *d, uint32_t id) {
    if (d->start != NULL) {
        uint32_t low = 0, high = d->cells;
        while (high - low > 1) {
            uint32_t middle = low + (high - low) / 2;
            bool before = d->start[middle] <= id;
            low = before ? middle : low;
            high = before ? high : middle;
        }
        return low;
    }
    uint32_t c = (uint32_t)(((uint64_t)id * d->cells) / d->mesh->vertices);
    while (cell_start(d, c + 1) <= id)
        c++;
    while (cell_start(d, c) > id)
        c--;
    return c;
}

static mn_code open_sort(const mni_deal *d, mni_sort **sort, size_t record, mni_sort_key key,
                         mn_status *st) {
    mni_sort_desc desc = {.record_bytes = (uint32_t)record,
                          .key = key,
                          .budget_bytes = d->desc.work_bytes / (SORTS + 1),
                          .temp_dir = d->desc.temp_dir};
    return mni_sort_open(sort, &desc, st);
}

static void close_sort(mni_deal *d, mni_sort **sort) {
    if (*sort != NULL) { /* or opening failed before */
        mni_sort_figures f = mni_sort_figures_get(*sort);
        d->bytes_read += f.bytes_read;
        d->bytes_written += f.bytes_written;
    }
    mni_sort_close(*sort);
    *sort = NULL;
}

static void read_triangles(mni_deal *d) {
    mni_exttriangles_open(&d->triangles, d->mesh, d->buffer[0], d->buffer_bytes);
    d->next_triangle = mni_exttriangles_next(&d->triangles);
}

static void read_vertices(mni_deal *d) {
    mni_spill *spill = &d->mesh->vertex;
    size_t bytes = d->buffer_bytes / sizeof(mni_extvertex) * sizeof(mni_extvertex);
    mni_spill_reader_open(&d->vertices, spill, 0, spill->size_bytes, d->buffer[1], bytes, false);
}

static mn_code spill_state(const mni_spill *spill, mn_status *st) {
    if (spill->trouble.code != MN_OK)
        mn_fail(st, spill->trouble.code, "%s", spill->trouble.text);
    return st->code;
}

/* ---- what crosses --------------------------------------------------------------------------- */

static bool is_hub(const mni_deal *d, uint32_t id) {
    uint32_t low = 0, high = d->hubs;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (d->hub[middle].id < id)
            low = middle + 1;
        else
            high = middle;
    }
    return low < d->hubs && d->hub[low].id == id;
}

/* The cells that a triangle is dealt to: those of its corners, hubs apart; where all are hubs, the
 * one where it lies in the file. Returns how many; which corners a cell may lack. */
static uint32_t cells_of(const mni_deal *d, const uint32_t v[3], uint32_t own, uint32_t cell[3],
                         bool lacked[3]) {
    uint32_t cells = 0;
    for (int i = 0; i < 3; i++) {
        lacked[i] = d->hubs == 0 || !is_hub(d, v[i]);
        if (!lacked[i])
            continue;
        uint32_t c = cell_of(d, v[i]);
        if ((cells < 1 || cell[0] != c) && (cells < 2 || cell[1] != c))
            cell[cells++] = c;
    }
    if (cells == 0)
        cell[cells++] = own;
    return cells;
}

/* Copies for the other cells; for each, the corners that it lacks. */
static void look_at_triangle(mni_deal *d, const uint32_t v[3], uint32_t own) {
    uint32_t cell[3];
    bool lacked[3];
    uint32_t cells = cells_of(d, v, own, cell, lacked);
    for (uint32_t i = 0; i < cells; i++) {
        for (int c = 0; c < 3; c++)
            if (lacked[c] && cell_of(d, v[c]) != cell[i]) {
                lack l = {cell[i], v[c]};
                mni_sort_put(d->lacks, &l);
            }
        d->of_cell[cell[i]].triangles++;
        if (cell[i] != own) {
            copy to = {cell[i], {v[0], v[1], v[2]}};
            mni_sort_put(d->copies, &to);
        }
    }
}

/* Those of a cell's vertices that are large; smaller ones would only be in the way. */
static void keep_fans(mni_deal *d, uint32_t cell) {
    uint32_t first = cell_start(d, cell), count = cell_start(d, cell + 1) - first;
    for (uint32_t i = 0; i < count; i++) {
        if (d->fan[i] > d->desc.hub_fan / (2 * CROWDED_PART))
            mni_heavy_add(&d->heavy, first + i, d->fan[i]);
        d->fan[i] = 0;
    }
}

static void count_fans(mni_deal *d, const uint32_t v[3], uint32_t first, uint32_t end) {
    for (int i = 0; i < 3; i++)
        if (v[i] < end)
            d->fan[v[i] - first]++;
        else
            mni_heavy_add(&d->heavy, v[i], 1);
}

static mn_code look_at_triangles(mni_deal *d, mn_status *st) {
    uint32_t own = 0, first = 0, end = cell_start(d, 1);
    uint64_t done = 0;
    for (read_triangles(d); d->next_triangle != NULL;
         d->next_triangle = mni_exttriangles_next(&d->triangles)) {
        const uint32_t *v = d->next_triangle->corner;
        if (mni_watch_each(&d->desc.watch, "deal", done++, d->mesh->triangles, st) != MN_OK)
            return st->code;
        while (v[0] >= end) {
            if (d->fan != NULL)
                keep_fans(d, own);
            own++;
            first = end;
            end = cell_start(d, own + 1);
        }
        if (d->fan != NULL)
            count_fans(d, v, first, end);
        if (d->hubs > 0 || v[1] >= end || v[2] >= end)
            look_at_triangle(d, v, own);
        else
            d->of_cell[own].triangles++;
    }
    if (d->fan != NULL)
        keep_fans(d, own);
    return spill_state(&d->mesh->triangle, st);
}

static void look_at_vertex(mni_deal *d, uint32_t id, const float p[3]) {
    for (int i = 0; i < 3; i++) {
        d->low[i] = fminf(d->low[i], p[i]);
        d->high[i] = fmaxf(d->high[i], p[i]);
    }
    if (d->step > 0 && !mni_wire_on_grid(p, d->step))
        d->step = 0;
    if (id % d->desc.sample_every == 0) {
        mni_ghost sample = {id, {p[0], p[1], p[2]}};
        mni_sort_put(d->samples, &sample);
    }
}

/* Each lack once becomes a ghost. */
static mn_code look_at_vertices(mni_deal *d, mn_status *st) {
    const mni_extvertex *v;
    const lack *next = mni_sort_next(d->lacks, st);
    uint32_t last_cell = 0, hub = 0;
    read_vertices(d);
    for (uint32_t id = 0; (v = mni_spill_take(&d->vertices, sizeof *v)) != NULL; id++) {
        if (mni_watch_each(&d->desc.watch, "deal", id, d->mesh->vertices, st) != MN_OK)
            return st->code;
        look_at_vertex(d, id, v->position);
        if (hub < d->hubs && d->hub[hub].id == id)
            memcpy(d->hub[hub++].position, v->position, sizeof v->position);
        for (bool again = false; next != NULL && next->vertex == id; again = true) {
            if (!again || next->cell != last_cell) {
                found f = {id, next->cell, {v->position[0], v->position[1], v->position[2]}};
                mni_sort_put(d->ghosts, &f);
                d->of_cell[next->cell].ghosts++;
            }
            last_cell = next->cell;
            next = mni_sort_next(d->lacks, st);
        }
    }
    return spill_state(&d->mesh->vertex, st);
}

/* ---- hubs ----------------------------------------------------------------------------------- */

static int by_count(const void *a, const void *b) {
    const mni_heavy_counter *x = a, *y = b;
    return x->count != y->count ? (x->count < y->count ? 1 : -1)
                                : (x->number > y->number) - (x->number < y->number);
}

static int by_id(const void *a, const void *b) {
    uint32_t x = ((const mni_ghost *)a)->id, y = ((const mni_ghost *)b)->id;
    return x < y ? -1 : x > y;
}

/* The heaviest that are hubs, or that crowd their cell. */
static mn_code choose_hubs(mni_deal *d, mn_status *st) {
    mni_heavy_counter *c;
    uint32_t fan = d->desc.hub_fan, count = mni_heavy_take(&d->heavy, fan / CROWDED_PART, &c);
    uint32_t most = count < d->desc.hubs_max ? count : d->desc.hubs_max;
    qsort(c, count, sizeof *c, by_count);
    d->hub = malloc(((size_t)most + 1) * sizeof *d->hub);
    if (d->hub == NULL)
        return mn_fail(st, MN_FAILED, "out of memory");
    for (uint32_t i = 0; i < count && d->hubs < most; i++)
        if (c[i].count > fan || d->of_cell[cell_of(d, c[i].number)].triangles > CROWDED * fan)
            d->hub[d->hubs++] = (mni_ghost){.id = c[i].number};
    qsort(d->hub, d->hubs, sizeof *d->hub, by_id);
    return MN_OK;
}

/* A look at all triangles, in which fans are counted. */
static mn_code find_hubs(mni_deal *d, mn_status *st) {
    uint64_t counters = COUNTERS_MIN + d->mesh->triangles / TRIANGLES_A_COUNTER;
    counters = counters < COUNTERS_MAX ? counters : COUNTERS_MAX;
    d->fan = calloc(d->mesh->vertices / d->cells + 1, sizeof *d->fan);
    if (d->fan == NULL || !mni_heavy_open(&d->heavy, (uint32_t)counters))
        return mn_fail(st, MN_FAILED, "out of memory");
    mn_code code = look_at_triangles(d, st);
    if (code == MN_OK)
        code = choose_hubs(d, st);
    mni_heavy_close(&d->heavy);
    free(d->fan);
    d->fan = NULL;
    return code;
}

/* ---- cells ---------------------------------------------------------------------------------- */

/* How many a cell becomes that has so many triangles. */
static uint32_t parts_of(const mni_deal *d, uint32_t cell) {
    const uint32_t vertices = cell_start(d, cell + 1) - cell_start(d, cell);
    const uint32_t most = d->desc.triangles_max, count = d->of_cell[cell].triangles;
    if (most == 0 || count <= most || vertices < 2)
        return 1;
    const uint32_t parts = (count + most - 1) / most;
    return parts < vertices ? parts : vertices;
}

/* Those with too many triangles are cut; whether there are any. */
static mn_code cut_cells(mni_deal *d, bool *cut, mn_status *st) {
    size_t cells = 0;
    for (uint32_t c = 0; c < d->cells; c++)
        cells += parts_of(d, c);
    *cut = cells > d->cells;
    if (!*cut)
        return MN_OK;
    uint32_t *start = malloc((cells + 1) * sizeof *start);
    tally *of_cell = calloc(cells, sizeof *of_cell);
    if (start == NULL || of_cell == NULL) {
        free(start);
        free(of_cell);
        return mn_fail(st, MN_FAILED, "out of memory");
    }
    uint32_t at = 0;
    for (uint32_t c = 0; c < d->cells; c++) {
        const uint32_t first = cell_start(d, c), parts = parts_of(d, c);
        const uint64_t count = cell_start(d, c + 1) - first;
        for (uint32_t i = 0; i < parts; i++)
            start[at++] = first + (uint32_t)(count * i / parts);
    }
    start[at] = (uint32_t)d->mesh->vertices;
    free(d->start);
    free(d->of_cell);
    d->start = start;
    d->of_cell = of_cell;
    d->cells = at;
    return MN_OK;
}

/* ---- what crosses, all of it ---------------------------------------------------------------- */

static mn_code open_crossing(mni_deal *d, mn_status *st) {
    mn_code code = open_sort(d, &d->copies, sizeof(copy), MNI_SORT_U32, st);
    return code == MN_OK ? open_sort(d, &d->lacks, sizeof(lack), MNI_SORT_U64, st) : code;
}

static mn_code look_again(mni_deal *d, mn_status *st) {
    close_sort(d, &d->copies);
    close_sort(d, &d->lacks);
    memset(d->of_cell, 0, d->cells * sizeof *d->of_cell);
    mn_code code = open_crossing(d, st);
    return code == MN_OK ? look_at_triangles(d, st) : code;
}

static mn_code find_crossing(mni_deal *d, mn_status *st) {
    mn_code code = open_crossing(d, st);
    if (code == MN_OK)
        code = open_sort(d, &d->ghosts, sizeof(found), MNI_SORT_U64, st);
    if (code == MN_OK) /* they come in order */
        code = open_sort(d, &d->samples, sizeof(mni_ghost), MNI_SORT_U32, st);
    if (code == MN_OK)
        code = d->desc.hub_fan > 0 ? find_hubs(d, st) : look_at_triangles(d, st);
    if (code == MN_OK && d->hubs > 0)
        code = look_again(d, st);
    bool cut = true;
    for (int i = 0; i < CUTS_MAX && code == MN_OK && cut; i++) {
        code = cut_cells(d, &cut, st);
        if (code == MN_OK && cut)
            code = look_again(d, st);
    }
    if (code == MN_OK)
        code = mni_sort_finish(d->copies, st);
    if (code == MN_OK)
        code = mni_sort_finish(d->lacks, st);
    if (code == MN_OK)
        code = look_at_vertices(d, st);
    if (code != MN_OK)
        return code;
    close_sort(d, &d->lacks);
    code = mni_sort_finish(d->samples, st);
    return code == MN_OK ? mni_sort_finish(d->ghosts, st) : code;
}

/* ---- from the outside ----------------------------------------------------------------------- */

mn_code mni_deal_open(mni_deal **deal, mni_extmesh *mesh, const mni_deal_desc *desc,
                      mn_status *st) {
    MN_ASSERT(desc->cells > 0 && desc->sample_every > 0 && desc->work_bytes >= MNI_DEAL_WORK_MIN);
    mni_deal *d = malloc(sizeof *d);
    *deal = d;
    if (d == NULL)
        return mn_fail(st, MN_FAILED, "out of memory");
    *d = (mni_deal){.mesh = mesh,
                    .desc = *desc,
                    .step = ldexpf(mesh->grid_step, -mesh->unit),
                    .low = {INFINITY, INFINITY, INFINITY},
                    .high = {-INFINITY, -INFINITY, -INFINITY}};
    d->buffer_bytes = desc->work_bytes / 16 < 1 << 20 ? (size_t)(desc->work_bytes / 16) : 1 << 20;
    d->cells = desc->cells;
    d->of_cell = calloc(desc->cells, sizeof *d->of_cell);
    if (d->of_cell == NULL)
        return mn_fail(st, MN_FAILED, "out of memory");
    for (int i = 0; i < BUFFERS; i++)
        if ((d->buffer[i] = malloc(d->buffer_bytes)) == NULL)
            return mn_fail(st, MN_FAILED, "out of memory");
    mn_code code = find_crossing(d, st);
    if (code != MN_OK)
        return code;
    d->next_copy = mni_sort_next(d->copies, st);
    d->next_ghost = mni_sort_next(d->ghosts, st);
    read_triangles(d);
    read_vertices(d);
    return st->code;
}

void mni_deal_box(const mni_deal *d, float low[3], float high[3]) {
    memcpy(low, d->low, sizeof d->low);
    memcpy(high, d->high, sizeof d->high);
}

uint32_t mni_deal_cells(const mni_deal *d) {
    return d->cells;
}

void mni_deal_counts(const mni_deal *d, uint32_t c, uint32_t *vertices, uint32_t *triangles) {
    *vertices = cell_start(d, c + 1) - cell_start(d, c) + d->of_cell[c].ghosts;
    *triangles = d->of_cell[c].triangles;
}

float mni_deal_step(const mni_deal *d) {
    return d->step;
}

const mni_ghost *mni_deal_hubs(const mni_deal *d, uint32_t *count) {
    *count = d->hubs;
    return d->hub;
}

const mni_ghost *mni_deal_sample(mni_deal *d, mn_status *st) {
    const mni_ghost *sample = mni_sort_next(d->samples, st);
    if (sample == NULL)
        close_sort(d, &d->samples);
    return sample;
}

void mni_deal_bytes(const mni_deal *d, uint64_t *read, uint64_t *written) {
    const mni_sort *const sorts[] = {d->copies, d->lacks, d->ghosts, d->samples};
    *read = d->bytes_read;
    *written = d->bytes_written;
    for (int i = 0; i < SORTS; i++)
        if (sorts[i] != NULL) {
            mni_sort_figures f = mni_sort_figures_get(sorts[i]);
            *read += f.bytes_read;
            *written += f.bytes_written;
        }
}

void mni_deal_close(mni_deal *d) {
    if (d == NULL)
        return;
    mni_sort_close(d->copies);
    mni_sort_close(d->lacks);
    mni_sort_close(d->ghosts);
    mni_sort_close(d->samples);
    for (int i = 0; i < BUFFERS; i++)
        free(d->buffer[i]);
    mni_heavy_close(&d->heavy);
    free(d->fan);
    free(d->hub);
    free(d->of_cell);
    free(d->start);
    free(d);
}

/* ---- a hand --------------------------------------------------------------------------------- */

/* Room for one more; false: no memory. */
static bool grow(void **array, uint32_t count, uint32_t *room, size_t bytes) {
    if (count < *room)
        return true;
    uint32_t wanted = *room + *room / 4 + 256;
    void *more = mni_mem_grow(*array, count * bytes, wanted * bytes);
    if (more == NULL)
        return false;
    *array = more;
    *room = wanted;
    return true;
}

static mn_code no_memory(const mni_hand *h, mn_status *st) {
    return mn_fail(st, MN_FAILED, "out of memory for a cell of %u vertices", h->vertices);
}

/* For what the looks at the mesh have counted. */
static bool take_room(const mni_deal *d, mni_hand *h) {
    const tally *of = &d->of_cell[d->next];
    h->ghosts_room = of->ghosts;
    h->triangles_room = of->triangles;
    h->position = mni_mem_take(h->vertices * sizeof *h->position, 0);
    h->ghost = mni_mem_take((size_t)of->ghosts * sizeof *h->ghost, 0);
    h->triangle = mni_mem_take((size_t)of->triangles * sizeof *h->triangle, 0);
    return h->position != NULL && h->ghost != NULL && h->triangle != NULL;
}

static mn_code deal_vertices(mni_deal *d, mni_hand *h, mn_status *st) {
    for (uint32_t i = 0; i < h->vertices; i++) {
        const mni_extvertex *v = mni_spill_take(&d->vertices, sizeof *v);
        if (v == NULL)
            return spill_state(&d->mesh->vertex, st);
        memcpy(h->position[i], v->position, sizeof h->position[i]);
    }
    for (h->ghosts = 0; d->next_ghost != NULL && d->next_ghost->cell == d->next;
         d->next_ghost = mni_sort_next(d->ghosts, st)) {
        const found *f = d->next_ghost;
        void *array = h->ghost;
        bool good = grow(&array, h->ghosts, &h->ghosts_room, sizeof *h->ghost);
        h->ghost = array;
        if (!good)
            return no_memory(h, st);
        h->ghost[h->ghosts++] =
            (mni_ghost){f->vertex, {f->position[0], f->position[1], f->position[2]}};
    }
    return st->code;
}

static bool add_triangle(mni_hand *h, const uint32_t v[3]) {
    void *array = h->triangle;
    bool good = grow(&array, h->triangles, &h->triangles_room, sizeof *h->triangle);
    h->triangle = array;
    if (good)
        h->triangle[h->triangles++] = (mni_dealt_triangle){{v[0], v[1], v[2]}};
    return good;
}

/* Whether a triangle that lies in this cell's part of the file is dealt to it: not if its only
 * corner there is a hub. */
static bool is_own(const mni_deal *d, const uint32_t v[3]) {
    uint32_t cell[3];
    bool lacked[3], own = d->hubs == 0;
    if (own)
        return true;
    for (uint32_t i = cells_of(d, v, d->next, cell, lacked); i-- > 0;)
        own |= cell[i] == d->next;
    return own;
}

static mn_code deal_triangles(mni_deal *d, mni_hand *h, mn_status *st) {
    h->triangles = 0;
    for (; d->next_copy != NULL && d->next_copy->cell == d->next;
         d->next_copy = mni_sort_next(d->copies, st))
        if (!add_triangle(h, d->next_copy->corner))
            return no_memory(h, st);
    h->copies = h->triangles;
    for (; d->next_triangle != NULL && d->next_triangle->corner[0] < h->first + h->vertices;
         d->next_triangle = mni_exttriangles_next(&d->triangles)) {
        if (is_own(d, d->next_triangle->corner) && !add_triangle(h, d->next_triangle->corner))
            return no_memory(h, st);
    }
    return spill_state(&d->mesh->triangle, st);
}

mn_code mni_deal_next(mni_deal *d, mni_hand *h, mn_status *st) {
    MN_ASSERT(d->next < d->cells);
    mni_hand_free(h);
    h->first = cell_start(d, d->next);
    h->vertices = cell_start(d, d->next + 1) - h->first;
    mn_code code = take_room(d, h) ? deal_vertices(d, h, st) : no_memory(h, st);
    if (code == MN_OK)
        code = deal_triangles(d, h, st);
    d->next++;
    return code;
}

void mni_hand_free(mni_hand *h) {
    mni_mem_give(h->position);
    mni_mem_give(h->ghost);
    mni_mem_give(h->triangle);
    *h = (mni_hand){0};
}
