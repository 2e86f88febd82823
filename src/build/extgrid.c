/* Positions onto one grid, on the disk: what grid.c does in memory, and counts as it does.
 *
 * Hides: how positions that fall together are found. Each is a number, of its steps along the
 * three axes where 64 bits hold them, otherwise a hash of them; equal ones meet in a sort. Order:
 * none. One thread. Memory: desc->work_bytes. Paper: none. */
#include <math.h>
#include <string.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "assert.h"
#include "extmesh.h"
#include "extsort.h"
#include "grid.h"
#include "mem.h"
#include "unit.h"
#include "watch.h"

enum { AXIS_BITS = 21 };

typedef struct gridder {
    mni_extmesh *mesh;
    const mni_extmesh_desc *desc;
    mn_status *st;
    mni_arena arena;
    unsigned char *buffer[2];
    size_t buffer_bytes; /* of vertices */
    float low[3], high[3];
    double step;
} gridder;

static bool good(const gridder *g, const mni_spill *spill) {
    if (spill->trouble.code != MN_OK)
        mn_fail(g->st, spill->trouble.code, "%s", spill->trouble.text);
    return spill->trouble.code == MN_OK;
}

static void read_vertices(const gridder *g, mni_spill_reader *r, bool discard) {
    mni_spill *spill = &g->mesh->vertex;
    mni_spill_reader_open(r, spill, 0, spill->size_bytes, g->buffer[0], g->buffer_bytes, discard);
}

static bool find_box(gridder *g) {
    mni_spill_reader r;
    const mni_extvertex *v;
    for (int i = 0; i < 3; i++) {
        g->low[i] = INFINITY;
        g->high[i] = -INFINITY;
    }
    read_vertices(g, &r, false);
    while ((v = mni_spill_take(&r, sizeof *v)) != NULL)
        for (int i = 0; i < 3; i++) {
            g->low[i] = fminf(g->low[i], v->position[i]);
            g->high[i] = fmaxf(g->high[i], v->position[i]);
        }
    return good(g, &g->mesh->vertex);
}

/* The same number for the same place, and, but for a hash, for no other. */
static uint64_t number_of(const gridder *g, const float p[3]) {
    uint64_t number = 0;
    float at[3];
    for (int i = 0; i < 3; i++) {
        double steps = g->step > 0 ? ((double)p[i] - g->low[i]) / g->step + 1 : -1;
        if (!(steps >= 0 && steps < (1 << AXIS_BITS) - 1)) { /* and rounded up: a number of them */
            for (i = 0; i < 3; i++)
                at[i] = p[i] + 0.0f; /* -0 becomes 0 */
            return XXH3_64bits(at, sizeof at);
        }
        number = number << AXIS_BITS | (uint64_t)(steps + 0.5);
    }
    return number;
}

static bool open_sort(gridder *g, mni_sort **sort) {
    mni_sort_desc desc = {.record_bytes = sizeof(uint64_t),
                          .key = MNI_SORT_U64,
                          .budget_bytes = g->desc->work_bytes / 2,
                          .temp_dir = g->desc->temp_dir};
    return mni_sort_open(sort, &desc, g->st) == MN_OK;
}

static bool count_different(gridder *g, mni_sort *sort, uint64_t *count) {
    const uint64_t *next;
    uint64_t last = 0;
    *count = 0;
    if (mni_sort_finish(sort, g->st) != MN_OK)
        return false;
    while ((next = mni_sort_next(sort, g->st)) != NULL) {
        *count += *count == 0 || *next != last;
        last = *next;
    }
    mni_sort_figures f = mni_sort_figures_get(sort);
    g->mesh->bytes_read += f.bytes_read;
    g->mesh->bytes_written += f.bytes_written;
    return g->st->code == MN_OK;
}

/* Different positions as they are: where they were welded, all but those that were counted. */
static bool count_before(gridder *g, uint64_t *before) {
    mni_sort *sort = NULL;
    mni_spill_reader r;
    const mni_extvertex *v;
    *before = g->mesh->vertices - g->mesh->intake.merged_positions;
    if (g->mesh->welded)
        return true;
    bool ok = open_sort(g, &sort);
    for (read_vertices(g, &r, false); ok && (v = mni_spill_take(&r, sizeof *v)) != NULL;) {
        uint64_t number = number_of(g, v->position); /* no step yet: a hash */
        mni_sort_put(sort, &number);
    }
    ok = ok && good(g, &g->mesh->vertex) && count_different(g, sort, before);
    mni_sort_close(sort);
    return ok;
}

static bool move_vertices(gridder *g, uint64_t *after) {
    mni_sort *sort = NULL;
    mni_spill to;
    mni_spill_reader r;
    mni_spill_writer w;
    const mni_extvertex *from;
    uint64_t done = 0;
    if (mni_spill_open_kept(&to, g->desc->temp_dir, g->desc->keep, g->st) != MN_OK)
        return false;
    bool ok = open_sort(g, &sort);
    mni_spill_writer_open(&w, &to, g->buffer[1], g->buffer_bytes);
    read_vertices(g, &r, true);
    while (ok && (from = mni_spill_take(&r, sizeof *from)) != NULL) {
        ok = mni_watch_each(&g->desc->watch, "grid", done++, g->mesh->vertices, g->st) == MN_OK;
        mni_extvertex v = *from;
        for (int i = 0; i < 3; i++)
            v.position[i] = mni_grid_round(v.position[i], (float)g->step);
        uint64_t number = number_of(g, v.position);
        for (int i = 0; i < 3; i++)
            v.position[i] = mni_unit_length(v.position[i], -g->mesh->unit);
        mni_sort_put(sort, &number);
        mni_spill_put(&w, &v, sizeof v);
    }
    mni_spill_end(&w);
    ok = ok && good(g, &g->mesh->vertex) && good(g, &to) && count_different(g, sort, after);
    mni_sort_close(sort);
    mni_spill swapped = g->mesh->vertex;
    to.bytes_read += swapped.bytes_read;
    to.bytes_written += swapped.bytes_written;
    g->mesh->vertex = to;
    mni_spill_close(&swapped);
    return ok;
}

static mn_code quantise(gridder *g, uint32_t bits) {
    uint64_t before = 0, after = 0;
    if (!find_box(g) || !count_before(g, &before))
        return g->st->code;
    g->mesh->grid_step = mni_grid_step(g->low, g->high, bits);
    g->step = (double)g->mesh->grid_step;
    float most = 0;
    for (int i = 0; i < 3; i++)
        most = fmaxf(most, fmaxf(fabsf(g->low[i]), fabsf(g->high[i])));
    g->mesh->unit = mni_unit_of_most(most);
    if (!move_vertices(g, &after))
        return g->st->code;
    if (before > after) /* two hashes alike may make `before` one too few */
        g->mesh->intake.merged_positions += before - after;
    return MN_OK;
}

mn_code mni_extmesh_quantise(mni_extmesh *mesh, uint32_t bits, const mni_extmesh_desc *desc,
                             mn_status *st) {
    gridder g = {.mesh = mesh, .desc = desc, .st = st};
    MN_ASSERT(desc->work_bytes >= MNI_EXTMESH_WORK_MIN);
    if (bits == 0)
        bits = MN_POSITION_BITS;
    if (bits < MN_POSITION_BITS_MIN || bits > MN_POSITION_BITS_MAX)
        return mn_fail(st, MN_USAGE, "%u bits a position: %d to %d", bits, MN_POSITION_BITS_MIN,
                       MN_POSITION_BITS_MAX);
    uint64_t each = desc->work_bytes / 8 < 1 << 20 ? desc->work_bytes / 8 : 1 << 20;
    g.buffer_bytes = (size_t)(each / sizeof(mni_extvertex) * sizeof(mni_extvertex));
    mn_code code = mni_arena_open(&g.arena, 2 * mni_arena_need(g.buffer_bytes, 1, 64), st);
    if (code != MN_OK)
        return code;
    for (int i = 0; i < 2; i++)
        g.buffer[i] = mni_arena_take(&g.arena, g.buffer_bytes, 1, 64);
    code = quantise(&g, bits);
    mni_arena_close(&g.arena);
    return code;
}
