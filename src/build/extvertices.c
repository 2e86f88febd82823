/* Vertices as they are kept: the places that triangles use, counted from the origin, on the grid;
 * what mn_mesh_read and grid.c do in memory, and counted as they count. See extintake.h.
 *
 * The box of what is used gives origin and grid. Where all places are used it is known from the
 * pushing; otherwise they are read once more.
 *
 * Hides: how positions that fall together are found. Where the grid is the one that the vertices'
 * curve follows they come one after the other. Otherwise (vertices that are not used make the box
 * larger, steps are too fine for the curve) each becomes a number, of its steps along the three
 * axes where 64 bits hold them, or a hash of it; equal ones meet in a sort. One thread.
 * (design.md §3.1) */
#include "extintake.h"

#include <math.h>
#include <string.h>

#include <xxhash.h>

#include "grid.h"
#include "reader.h"
#include "unit.h"

enum { AXIS_BITS = 21 };
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

static void read_used(mni_extintake *x, used_reader *r, bool discard) {
    *r = (used_reader){0};
    mni_spill_reader_open(&r->bytes, &x->placed, 0, x->placed.size_bytes, x->buffer[0],
                          x->buffer_bytes, discard);
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
    for (read_used(x, &r, false); next_used(x, &r);)
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

/* before, after: numbers of positions as they came and as they are kept, or NULL. *runs: of equal
 * ones, one after the other. */
static bool write_all(mni_extintake *x, const mni_ext_frame *f, mni_sort *before, mni_sort *after,
                      uint64_t *runs) {
    used_reader r;
    mni_spill_writer w;
    mni_extvertex last = {0};
    uint64_t done = 0;
    *runs = 0;
    read_used(x, &r, true);
    mni_spill_writer_open(&w, &x->result.vertex, x->buffer[1], x->buffer_bytes);
    while (next_used(x, &r)) {
        const double *p = r.is.position;
        mni_extvertex v = {.rgba = r.is.rgba};
        for (int i = 0; i < 3; i++) {
            v.position[i] = mni_ext_from_origin(f, p[i], i);
            if (x->desc.position_bits > 0)
                v.position[i] = mni_grid_round(v.position[i], x->result.grid_step);
        }
        if (after != NULL)
            mni_sort_put(after, &(uint64_t){number_of(x, f, v.position)});
        if (before != NULL)
            mni_sort_put(before, &(uint64_t){XXH3_64bits(p, 3 * sizeof *p)});
        for (int i = 0; i < 3; i++)
            v.position[i] = mni_unit_length(v.position[i], -x->result.unit);
        *runs += done == 0 || memcmp(v.position, last.position, sizeof v.position) != 0;
        last = v;
        mni_spill_put(&w, &v, sizeof v);
        if (mni_watch_each(&x->desc.watch, "grid", done++, x->result.vertices, x->st) != MN_OK)
            return false;
    }
    mni_spill_end(&w);
    return mni_ext_spill_good(x, &x->placed) && mni_ext_spill_good(x, &x->result.vertex);
}

bool mni_ext_write_vertices(mni_extintake *x) {
    mni_sort *before = NULL, *after = NULL;
    mni_ext_frame f;
    uint64_t apart = x->result.vertices, places = 0;
    bool exact;
    if (!find_frame(x, &f, &exact))
        return false;
    const bool moved = !exact || x->desc.position_bits > 0, sorts = moved && !is_curves_grid(x, &f);
    bool ok =
        (!sorts || open_numbers(x, &after)) && (!moved || !x->apart || open_numbers(x, &before)) &&
        mni_spill_open_kept(&x->result.vertex, x->desc.temp_dir, x->desc.keep, x->st) == MN_OK &&
        write_all(x, &f, before, after, &places) &&
        (after == NULL || count_different(x, after, &places)) &&
        (before == NULL || count_different(x, before, &apart));
    x->counts.merged_positions = moved && apart > places ? apart - places : 0; /* of equal hashes */
    mni_ext_sort_close(x, &before);
    mni_ext_sort_close(x, &after);
    mni_ext_spill_close(x, &x->placed);
    return ok;
}
