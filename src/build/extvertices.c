/* Vertices as they are kept: the places that triangles use, counted from the origin, on the grid;
 * what mn_mesh_read and grid.c do in memory, and counted as they count. See extintake.h.
 *
 * The box of what is used gives origin and grid. Where all places are used it is known from the
 * pushing; otherwise they are read once more.
 *
 * Hides: how positions that fall together are found. Where the grid is the one that the vertices'
 * curve follows they come one after the other. Otherwise (vertices that are not used make the box
 * larger, steps are too fine for the curve) each becomes a number, of its steps along the three
 * axes where 64 bits hold them, or a hash of it; equal ones meet in a sort.
 *
 * Where nothing is to be sorted, and two threads are allowed, all is written by one of its own,
 * beside the merging of triangles: it reads the places and which of them are used, and changes
 * nothing but what stands in mni_ext_writing and the spill of vertices. (design.md §3.1) */
#include "extintake.h"

#include <math.h>
#include <string.h>

#include <xxhash.h>

#include "grid.h"
#include "mn_assert.h"
#include "reader.h"
#include "unit.h"

enum { AXIS_BITS = 21, LOOK_EVERY = 65536 };
/* Sizes between which floats hold whatever is made of a model: switch values of 2^-40 of it, radii
 * that were rounded up at each of hundreds of levels. Nuclei and galaxies are, in metres. */
#define MODEL_SIZE_MIN 0x1p-84f
#define MODEL_SIZE_MAX 0x1p100f

/* ---- places in use --------------------------------------------------------------------------- */

typedef struct used_reader {
    mni_spill_reader bytes;
    mni_ext_words last;
    mni_ext_vertex is;
    uint64_t next; /* place */
} used_reader;

static void read_used(mni_extintake *x, used_reader *r, unsigned char *buffer, size_t bytes,
                      bool discard) {
    *r = (used_reader){0};
    mni_spill_reader_open(&r->bytes, &x->placed, 0, x->placed.size_bytes, buffer, bytes, discard);
}

/* false: no more. */
static bool next_used(mni_extintake *x, used_reader *r) {
    const bool wide = mni_ext_is_wide(x);
    do
        if (!mni_ext_next(&r->bytes, &r->last, wide, &r->is))
            return false;
    while (!mni_ext_is_used(x, r->next++));
    return true;
}

/* ---- origin and grid ------------------------------------------------------------------------- */

/* The box of what is used, and whether floats hold it all. */
static bool find_box(mni_extintake *x, double low[3], double high[3], bool *exact) {
    used_reader r;
    *exact = !mni_ext_is_wide(x);
    memcpy(low, x->low, sizeof x->low);
    memcpy(high, x->high, sizeof x->high);
    if (x->result.vertices == x->places)
        return true;
    *exact = true;
    for (int i = 0; i < 3; i++) {
        low[i] = INFINITY;
        high[i] = -INFINITY;
    }
    for (read_used(x, &r, x->buffer[0], x->buffer_bytes, false); next_used(x, &r);)
        for (int i = 0; i < 3; i++) {
            const double p = r.is.position[i];
            low[i] = p < low[i] ? p : low[i];
            high[i] = p > high[i] ? p : high[i];
            *exact = *exact && mni_ext_is_float(p);
        }
    return mni_ext_spill_good(x, &x->placed);
}

mni_ext_frame mni_ext_frame_of(const mni_extintake *x, const double low[3], const double high[3],
                               bool exact) {
    mni_ext_frame f;
    mni_intake_origin(low, high, exact, f.origin);
    for (int i = 0; i < 3; i++) {
        f.low[i] = mni_ext_from_origin(&f, low[i], i);
        f.high[i] = mni_ext_from_origin(&f, high[i], i);
    }
    f.step = mni_grid_step(f.low, f.high, mni_ext_curve_bits(x));
    return f;
}

/* What is said of all vertices; exact as above. */
static bool find_frame(mni_extintake *x, mni_ext_frame *f, bool *exact) {
    double low[3], high[3];
    float most = 0;
    if (!find_box(x, low, high, exact))
        return false;
    *f = mni_ext_frame_of(x, low, high, *exact);
    memcpy(x->result.origin, f->origin, sizeof f->origin);
    for (int i = 0; i < 3; i++)
        most = fmaxf(most, fmaxf(fabsf(f->low[i]), fabsf(f->high[i])));
    if (most > 0 && !(most >= MODEL_SIZE_MIN && most <= MODEL_SIZE_MAX)) {
        mn_fail(x->st, MN_BAD_INPUT,
                "%s: its coordinates are up to %g: floats hold models of %g to %g; give it in "
                "another unit of length",
                x->name, (double)most, (double)MODEL_SIZE_MIN, (double)MODEL_SIZE_MAX);
        return false;
    }
    if (x->desc.position_bits > 0) {
        x->result.grid_step = mni_grid_step(f->low, f->high, x->desc.position_bits);
        x->result.unit = mni_unit_of_most(most);
    }
    return true;
}

/* The curve's is the grid that positions go to. */
static bool is_curves_grid(const mni_extintake *x, const mni_ext_frame *f) {
    return x->result.grid_step > 0 && x->result.grid_step == x->frame.step &&
           memcmp(f->origin, x->frame.origin, sizeof f->origin) == 0;
}

/* ---- what falls together --------------------------------------------------------------------- */

/* The same for the same place, and, but for a hash, for no other. */
static uint64_t number_of(const mni_extintake *x, const mni_ext_frame *f, const float p[3]) {
    uint64_t number = 0;
    for (int i = 0; i < 3; i++) {
        const double step = (double)x->result.grid_step,
                     steps = step > 0 ? ((double)p[i] - f->low[i]) / step + 1 : -1;
        if (!(steps >= 0 && steps < (1 << AXIS_BITS) - 1)) /* and rounded up: a number of them */
            return XXH3_64bits(p, 3 * sizeof *p);
        number = number << AXIS_BITS | (uint64_t)(steps + 0.5);
    }
    return number;
}

static bool open_numbers(mni_extintake *x, mni_sort **sort) {
    const mni_sort_desc desc = {.record_bytes = sizeof(uint64_t),
                                .key = MNI_SORT_U64,
                                .budget_bytes = mni_ext_share(x, MNI_EXT_AFTER_SHARE)};
    return mni_ext_sort_open(x, sort, &desc);
}

static bool count_different(mni_extintake *x, mni_sort *sort, uint64_t *count) {
    const uint64_t *next;
    uint64_t last = 0;
    *count = 0;
    if (mni_sort_finish(sort, x->st) != MN_OK)
        return false;
    while ((next = mni_sort_next(sort, x->st)) != NULL) {
        *count += *count == 0 || *next != last;
        last = *next;
    }
    return x->st->code == MN_OK;
}

/* ---- vertices -------------------------------------------------------------------------------- */

/* Both numbers of a position, as it came and as it is kept, go to sorts where there are any. */
static void put_numbers(const mni_extintake *x, const mni_ext_writing *g, const double came[3],
                        const float kept[3]) {
    if (g->after != NULL)
        mni_sort_put(g->after, &(uint64_t){number_of(x, &g->frame, kept)});
    if (g->before != NULL)
        mni_sort_put(g->before, &(uint64_t){XXH3_64bits(came, 3 * sizeof *came)});
}

/* In either thread; the half of a buffer that nobody else has is for reading, the other for
 * writing. Failures stay in the spills. */
static void write_all(void *context, void *records, uint32_t count) {
    mni_extintake *x = context;
    mni_ext_writing *g = &x->writing;
    const size_t half = x->buffer_bytes / 2;
    used_reader r;
    mni_spill_writer w;
    mni_extvertex last = {0};
    (void)records;
    MN_ASSERT(count == 1);
    read_used(x, &r, x->buffer[2], half, true);
    mni_spill_writer_open(&w, &x->result.vertex, x->buffer[2] + half, half);
    for (uint64_t done = 0; next_used(x, &r); done++) {
        const double *p = r.is.position;
        mni_extvertex v = {.rgba = r.is.rgba};
        for (int i = 0; i < 3; i++) {
            v.position[i] = mni_ext_from_origin(&g->frame, p[i], i);
            if (x->desc.position_bits > 0)
                v.position[i] = mni_grid_round(v.position[i], x->result.grid_step);
        }
        put_numbers(x, g, p, v.position);
        for (int i = 0; i < 3; i++)
            v.position[i] = mni_unit_length(v.position[i], -x->result.unit);
        g->runs += done == 0 || memcmp(v.position, last.position, sizeof v.position) != 0;
        last = v;
        mni_spill_put(&w, &v, sizeof v);
        if (done % LOOK_EVERY != 0)
            continue;
        if (atomic_load_explicit(&g->stop, memory_order_relaxed))
            return;
        if (!g->beside &&
            mni_watch(&x->desc.watch, "grid", done, x->result.vertices, x->st) != MN_OK)
            return;
    }
    mni_spill_end(&w);
}

bool mni_ext_vertices_begin(mni_extintake *x) {
    mni_ext_writing *g = &x->writing;
    bool exact;
    if (!find_frame(x, &g->frame, &exact))
        return false;
    g->moved = !exact || x->desc.position_bits > 0;
    g->sorts = g->moved && (x->apart || !is_curves_grid(x, &g->frame));
    g->beside = x->desc.threads > 1 && !g->sorts;
    if (mni_spill_open_kept(&x->result.vertex, x->desc.temp_dir, x->desc.keep, x->st) != MN_OK)
        return false;
    if (!g->beside)
        return true;
    mni_relay_open(&g->relay, write_all, x, sizeof *g->batch, g->batch, sizeof g->batch,
                   x->desc.threads);
    g->open = true;
    mni_relay_put(&g->relay, g->batch);
    return true;
}

void mni_ext_vertices_stop(mni_extintake *x) {
    if (!x->writing.open)
        return;
    atomic_store_explicit(&x->writing.stop, true, memory_order_relaxed);
    mni_relay_close(&x->writing.relay);
    x->writing.open = false;
}

static bool write_here(mni_extintake *x, uint64_t *places, uint64_t *apart) {
    mni_ext_writing *g = &x->writing;
    const bool after = g->sorts && !is_curves_grid(x, &g->frame), before = g->sorts && x->apart;
    bool ok = (!after || open_numbers(x, &g->after)) && (!before || open_numbers(x, &g->before));
    if (ok)
        write_all(x, NULL, 1);
    ok = ok && x->st->code == MN_OK && (!after || count_different(x, g->after, places)) &&
         (!before || count_different(x, g->before, apart));
    mni_ext_sort_close(x, &g->before);
    mni_ext_sort_close(x, &g->after);
    return ok;
}

bool mni_ext_vertices_finish(mni_extintake *x) {
    mni_ext_writing *g = &x->writing;
    uint64_t apart = x->result.vertices, places = 0;
    bool ok = true;
    if (g->open)
        mni_relay_close(&g->relay);
    else
        ok = write_here(x, &places, &apart);
    g->open = false;
    if (places == 0)
        places = g->runs;
    ok = ok && mni_ext_spill_good(x, &x->placed) && mni_ext_spill_good(x, &x->result.vertex);
    x->counts.merged_positions =
        g->moved && apart > places ? apart - places : 0; /* of equal hashes */
    mni_ext_spill_close(x, &x->placed);
    return ok;
}
