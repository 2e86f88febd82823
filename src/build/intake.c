/* From what a file says to a mesh: welding, rejection, counting, an origin.
 *
 * Secret: how vertices at equal positions are found (a hash table of positions, filled as they
 * come), and what is done in which order so that memory stays low and bounded. With a cap, what is
 * needed is worked out before it is taken; once it exceeds the cap everything is freed and the rest
 * of the file is only counted, so that the refusal can name a number that works.
 *
 *   read:    vertex -> weld -> position[]      triangle -> corner[] (vertices as the file counts)
 *   finish:  renumber by the weld, reject non-finite and degenerate -> reject duplicates
 *            -> drop unused vertices -> origin, floats
 *
 * Order: open, expect?, vertices and triangles in any order, finish?, close. Threads: one. Memory:
 * what mni need_bytes() sums. (design.md §3.1) */
#include "reader.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"
#include "faces.h"
#include "table.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

enum {
    CAPACITY_MIN = 1024,
    CAP_CHECK_EVERY = 4096, /* vertices or triangles: how far the cap may be overrun, some 200 kB */
    SLACK_BYTES = 1 << 20,  /* buffers, allocator, stack */
};

/* Floats must hold positions, and their squares of differences should not overflow soon. */
static const double COORDINATE_MAX = FLT_MAX / 4;

struct mni_intake {
    /* const after open */
    mn_weld weld;
    bool soup;
    uint64_t ram_bytes; /* 0: no cap */
    const char *name;
    mn_status *st;
    uint64_t seed;

    uint64_t pushed;    /* vertices, as the file has them */
    uint64_t vertices;  /* of them kept apart */
    uint64_t triangles; /* pushed */
    uint64_t nonfinite; /* vertices */
    bool expected;      /* vertices are as announced: the table is made once */
    bool over;          /* the cap: only counting since then */

    double *position; /* 3 × vertices; a non-finite one has NaN for its x */
    uint32_t *color;  /* vertices, or NULL until the first coloured one */
    uint64_t vertices_capacity;
    uint32_t *welded; /* pushed -> vertex; NULL in soups and without welding */
    uint64_t pushed_capacity;
    mni_table table; /* of vertices, by position */
    uint64_t table_capacity;
    uint32_t *corner; /* 3 × triangles; vertices as pushed (in a soup: kept) */
    uint64_t triangles_capacity;
    mn_intake counts;
};

/* ---- memory --------------------------------------------------------------------------------- */

static uint64_t largest(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

/* Peak for a file with so many vertices as it counts them, so many of them kept apart, and so many
 * triangles: the largest of the three steps. Colours are counted always, for simplicity. */
static uint64_t need_bytes(const mni_intake *intake, uint64_t pushed, uint64_t vertices,
                           uint64_t triangles) {
    uint64_t mesh = vertices * 3 * sizeof(double)       /* position */
                    + vertices * sizeof(uint32_t)       /* color */
                    + triangles * 3 * sizeof(uint32_t); /* corner */
    uint64_t welding = 0;
    if (intake->weld == MN_WELD_ON) {
        welding = mni_table_bytes(intake->expected ? vertices : vertices + vertices / 2);
        if (!intake->soup)
            welding += pushed * sizeof(uint32_t); /* welded */
    }
    uint64_t checking = mni_faces_bytes(vertices, triangles);
    uint64_t finishing = vertices * sizeof(uint32_t)  /* renumbering */
                         + mni_table_bytes(vertices); /* counting what falls together */
    uint64_t floats = vertices * 3 * sizeof(float);   /* beside the doubles */
    return mesh + largest(largest(welding, checking), largest(finishing, floats)) + SLACK_BYTES;
}

static void free_arrays(mni_intake *intake) {
    free(intake->position);
    free(intake->color);
    free(intake->welded);
    free(intake->corner);
    mni_table_close(&intake->table);
    intake->position = NULL;
    intake->color = intake->welded = intake->corner = NULL;
    intake->vertices_capacity = intake->pushed_capacity = 0;
    intake->triangles_capacity = intake->table_capacity = 0;
}

static bool no_memory(mni_intake *intake, uint64_t bytes) {
    mn_fail(intake->st, MN_FAILED, "%s: no memory for %llu bytes", intake->name,
            (unsigned long long)bytes);
    return false;
}

/* The cap is too small for `need`. */
static bool refuse(mni_intake *intake, uint64_t need) {
    mn_fail(intake->st, MN_CAP_TOO_SMALL,
            "%s: %llu vertices and %llu triangles take %llu bytes to read, the cap is %llu: "
            "--ram %lluM would do",
            intake->name, (unsigned long long)intake->pushed, (unsigned long long)intake->triangles,
            (unsigned long long)need, (unsigned long long)intake->ram_bytes,
            (unsigned long long)((need >> 20) + 1));
    return false;
}

/* Goes over to counting when what is there now, or is about to be, exceeds the cap. */
static void check_cap(mni_intake *intake) {
    if (intake->ram_bytes == 0 || intake->over)
        return;
    uint64_t need =
        need_bytes(intake, intake->pushed, intake->vertices, intake->triangles + CAP_CHECK_EVERY);
    if (need <= intake->ram_bytes)
        return;
    intake->over = true;
    free_arrays(intake);
}

/* Makes room for one more of `used`. */
static bool grow(mni_intake *intake, void **array, uint64_t used, uint64_t *capacity,
                 size_t item_bytes) {
    uint64_t room = *capacity + *capacity / 2;
    room = largest(room, used + 1);
    room = largest(room, CAPACITY_MIN);
    void *larger = realloc(*array, room * item_bytes);
    if (larger == NULL)
        return no_memory(intake, room * item_bytes);
    *array = larger;
    *capacity = room;
    return true;
}

static bool take(mni_intake *intake, void **array, uint64_t count, size_t item_bytes) {
    if (count == 0)
        return true;
    *array = malloc(count * item_bytes);
    return *array != NULL || no_memory(intake, count * item_bytes);
}

/* ---- open, expect, close -------------------------------------------------------------------- */

mni_intake *mni_intake_open(const mn_read_desc *desc, bool soup, const char *name, mn_status *st) {
    mni_intake *intake = calloc(1, sizeof *intake);
    if (intake == NULL) {
        mn_fail(st, MN_FAILED, "%s: no memory", name);
        return NULL;
    }
    intake->weld = soup ? MN_WELD_ON : desc->weld;
    intake->soup = soup;
    intake->ram_bytes = desc->ram_bytes;
    intake->name = name;
    intake->st = st;
    /* an address: no file can be made to hash badly, and no result depends on it */
    intake->seed = (uint64_t)(uintptr_t)intake;
    return intake;
}

static bool too_many(mni_intake *intake, uint64_t count, uint64_t max, const char *what) {
    mn_fail(intake->st, MN_BAD_INPUT, "%s: has %llu %s, more than the %llu that can be taken in",
            intake->name, (unsigned long long)count, what, (unsigned long long)max);
    return false;
}

bool mni_intake_expect(mni_intake *intake, uint64_t vertices, uint64_t triangles) {
    MN_ASSERT(intake->position == NULL && intake->corner == NULL);
    if (vertices > MNI_VERTICES_MAX)
        return too_many(intake, vertices, MNI_VERTICES_MAX, "vertices");
    if (triangles > MNI_TRIANGLES_MAX)
        return too_many(intake, triangles, MNI_TRIANGLES_MAX, "triangles");
    intake->expected = !intake->soup;
    if (intake->ram_bytes != 0 &&
        need_bytes(intake, vertices, vertices, triangles) > intake->ram_bytes) {
        intake->over = true;
        return true;
    }
    intake->triangles_capacity = triangles;
    if (!take(intake, (void **)&intake->corner, triangles, 3 * sizeof(uint32_t)))
        return false;
    if (intake->soup)
        return true;
    intake->vertices_capacity = intake->pushed_capacity = vertices;
    if (!take(intake, (void **)&intake->position, vertices, 3 * sizeof(double)))
        return false;
    if (intake->weld == MN_WELD_OFF)
        return true;
    if (!take(intake, (void **)&intake->welded, vertices, sizeof(uint32_t)))
        return false;
    if (!mni_table_open(&intake->table, vertices))
        return no_memory(intake, mni_table_bytes(vertices));
    intake->table_capacity = vertices;
    return true;
}

void mni_intake_close(mni_intake *intake) {
    if (intake == NULL)
        return;
    free_arrays(intake);
    free(intake);
}

uint64_t mni_intake_vertices(const mni_intake *intake) {
    return intake->pushed;
}

/* ---- vertices ------------------------------------------------------------------------------- */

static uint64_t hash_position(const mni_intake *intake, const double *p) {
    return XXH3_64bits_withSeed(p, 3 * sizeof *p, intake->seed);
}

/* -0 becomes 0, so that equal positions have equal bytes. false: not finite, or past what floats
 * hold; then x is NaN, which equals nothing. */
static bool normalise(double p[3]) {
    for (int i = 0; i < 3; i++) {
        if (!(p[i] >= -COORDINATE_MAX && p[i] <= COORDINATE_MAX)) {
            p[0] = (double)NAN;
            p[1] = p[2] = 0;
            return false;
        }
        p[i] += 0.0;
    }
    return true;
}

/* The slot of the vertex at p, or the free one where it belongs. */
static bool find_position(const mni_intake *intake, const double *p, uint64_t *at,
                          uint32_t *vertex) {
    for (*at = mni_table_first(&intake->table, hash_position(intake, p));
         mni_table_at(&intake->table, *at, vertex); *at = mni_table_next(&intake->table, *at))
        if (memcmp(intake->position + 3 * (uint64_t)*vertex, p, 3 * sizeof *p) == 0)
            return true;
    return false;
}

/* A larger table: the old one is not needed to fill it, the positions are. */
static bool grow_table(mni_intake *intake) {
    uint64_t room = largest(intake->table_capacity + intake->table_capacity / 2, CAPACITY_MIN);
    mni_table_close(&intake->table);
    intake->table_capacity = 0;
    if (!mni_table_open(&intake->table, room))
        return no_memory(intake, mni_table_bytes(room));
    intake->table_capacity = room;
    for (uint64_t v = 0; v < intake->vertices; v++) {
        uint64_t at;
        uint32_t other;
        if (!find_position(intake, intake->position + 3 * v, &at, &other))
            mni_table_put(&intake->table, at, (uint32_t)v);
    }
    return true;
}

/* All vertices so far were without colour. */
static bool start_colors(mni_intake *intake) {
    uint64_t room = largest(intake->vertices_capacity, 1);
    if (!take(intake, (void **)&intake->color, room, sizeof(uint32_t)))
        return false;
    for (uint64_t v = 0; v < intake->vertices; v++)
        intake->color[v] = MNI_WHITE;
    return true;
}

static bool append_vertex(mni_intake *intake, const double p[3], uint32_t rgba) {
    if (intake->vertices == intake->vertices_capacity) {
        uint64_t room = intake->vertices_capacity;
        if (intake->color != NULL &&
            !grow(intake, (void **)&intake->color, intake->vertices, &room, sizeof(uint32_t)))
            return false;
        if (!grow(intake, (void **)&intake->position, intake->vertices, &intake->vertices_capacity,
                  3 * sizeof(double)))
            return false;
    }
    memcpy(intake->position + 3 * intake->vertices, p, 3 * sizeof *p);
    if (intake->color != NULL)
        intake->color[intake->vertices] = rgba;
    intake->vertices++;
    return true;
}

/* Finds or makes the vertex at p. */
static bool add_vertex(mni_intake *intake, const double position[3], uint32_t rgba,
                       uint32_t *vertex) {
    double p[3] = {position[0], position[1], position[2]};
    bool finite = normalise(p);
    *vertex = (uint32_t)intake->vertices;
    if (!finite)
        intake->nonfinite++;
    if (intake->vertices >= MNI_VERTICES_MAX)
        return too_many(intake, intake->vertices + 1, MNI_VERTICES_MAX, "vertices");
    if (!finite || intake->weld == MN_WELD_OFF)
        return append_vertex(intake, p, rgba);
    if (intake->vertices >= intake->table_capacity && !grow_table(intake))
        return false;
    uint64_t at;
    if (find_position(intake, p, &at, vertex))
        return true;
    *vertex = (uint32_t)intake->vertices;
    mni_table_put(&intake->table, at, *vertex);
    return append_vertex(intake, p, rgba);
}

bool mni_intake_vertex(mni_intake *intake, const double position[3]) {
    return mni_intake_vertex_color(intake, position, MNI_WHITE);
}

bool mni_intake_vertex_color(mni_intake *intake, const double position[3], uint32_t rgba) {
    MN_ASSERT(!intake->soup);
    if (intake->pushed >= MNI_VERTICES_MAX)
        return too_many(intake, intake->pushed + 1, MNI_VERTICES_MAX, "vertices");
    if (intake->pushed % CAP_CHECK_EVERY == 0)
        check_cap(intake);
    if (intake->over) {
        intake->vertices = ++intake->pushed;
        return true;
    }
    if (rgba != MNI_WHITE && intake->color == NULL && !start_colors(intake))
        return false;
    uint32_t vertex;
    if (!add_vertex(intake, position, rgba, &vertex))
        return false;
    if (intake->weld == MN_WELD_ON) {
        if (intake->pushed == intake->pushed_capacity &&
            !grow(intake, (void **)&intake->welded, intake->pushed, &intake->pushed_capacity,
                  sizeof(uint32_t)))
            return false;
        intake->welded[intake->pushed] = vertex;
    }
    intake->pushed++;
    return true;
}

/* ---- triangles ------------------------------------------------------------------------------ */

bool mni_intake_triangle(mni_intake *intake, uint32_t a, uint32_t b, uint32_t c) {
    if (intake->triangles >= MNI_TRIANGLES_MAX)
        return too_many(intake, intake->triangles + 1, MNI_TRIANGLES_MAX, "triangles");
    if (intake->triangles % CAP_CHECK_EVERY == 0)
        check_cap(intake);
    if (!intake->over) {
        if (intake->triangles == intake->triangles_capacity &&
            !grow(intake, (void **)&intake->corner, intake->triangles, &intake->triangles_capacity,
                  3 * sizeof(uint32_t)))
            return false;
        uint32_t *corner = intake->corner + 3 * intake->triangles;
        corner[0] = a;
        corner[1] = b;
        corner[2] = c;
    }
    intake->triangles++;
    return true;
}

bool mni_intake_soup_triangle(mni_intake *intake, double corner[3][3]) {
    MN_ASSERT(intake->soup);
    uint32_t vertex[3] = {0, 0, 0};
    for (int i = 0; i < 3 && !intake->over; i++)
        if (!add_vertex(intake, corner[i], MNI_WHITE, &vertex[i]))
            return false;
    intake->pushed += 3;
    if (intake->over) /* how many are the same is not known any more: three each is safe */
        intake->vertices += 3;
    return mni_intake_triangle(intake, vertex[0], vertex[1], vertex[2]);
}

bool mni_polygon_corner(mni_polygon *polygon, mni_intake *intake, uint32_t vertex) {
    if (polygon->corners == 0)
        polygon->first = vertex;
    if (polygon->corners < 2) {
        polygon->corners++;
    } else {
        polygon->corners = 3;
        if (!mni_intake_triangle(intake, polygon->first, polygon->previous, vertex))
            return false;
    }
    polygon->previous = vertex;
    return true;
}

bool mni_polygon_end(mni_polygon *polygon, mni_intake *intake) {
    bool whole = polygon->corners == 3;
    *polygon = (mni_polygon){0};
    return whole || mni_intake_triangle(intake, MN_NONE, MN_NONE, MN_NONE);
}

bool mni_strip_corner(mni_strip *strip, mni_intake *intake, uint32_t vertex) {
    if (strip->corners < 2) {
        strip->first = strip->previous;
        strip->previous = vertex;
        strip->corners++;
        return true;
    }
    uint32_t a = strip->first, b = strip->previous;
    bool odd = strip->odd;
    strip->first = b;
    strip->previous = vertex;
    strip->odd = !odd;
    if (a == b || b == vertex || a == vertex)
        return true; /* stitches two strips together: no face */
    return odd ? mni_intake_triangle(intake, b, a, vertex)
               : mni_intake_triangle(intake, a, b, vertex);
}

void mni_strip_restart(mni_strip *strip) {
    *strip = (mni_strip){0};
}

/* ---- finish --------------------------------------------------------------------------------- */

static bool is_nonfinite(const mni_intake *intake, uint32_t vertex) {
    return isnan(intake->position[3 * (uint64_t)vertex]);
}

/* Renumbers corners by the weld and drops triangles that are wrong by themselves. */
static void reject_single_faces(mni_intake *intake) {
    uint64_t kept = 0;
    for (uint64_t t = 0; t < intake->triangles; t++) {
        uint32_t corner[3];
        memcpy(corner, intake->corner + 3 * t, sizeof corner);
        if (corner[0] == MN_NONE) { /* fewer than three corners */
            intake->counts.degenerate_faces++;
            continue;
        }
        for (int i = 0; i < 3 && intake->welded != NULL; i++)
            corner[i] = intake->welded[corner[i]];
        if (intake->nonfinite > 0 &&
            (is_nonfinite(intake, corner[0]) || is_nonfinite(intake, corner[1]) ||
             is_nonfinite(intake, corner[2]))) {
            intake->counts.nonfinite_faces++;
        } else if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0]) {
            intake->counts.degenerate_faces++;
        } else {
            memcpy(intake->corner + 3 * kept, corner, sizeof corner);
            kept++;
        }
    }
    intake->triangles = kept;
}

static bool reject_duplicates(mni_intake *intake) {
    uint64_t need = need_bytes(intake, intake->pushed, intake->vertices, intake->triangles);
    uint64_t spare = UINT64_MAX, missing = 0;
    if (intake->ram_bytes != 0)
        spare = intake->ram_bytes > need ? intake->ram_bytes - need : 0;
    mn_code code = mni_faces_filter(intake->corner, &intake->triangles, intake->vertices, spare,
                                    &missing, &intake->counts);
    if (code == MN_CAP_TOO_SMALL)
        return refuse(intake, largest(need, intake->ram_bytes) + missing);
    return code == MN_OK || no_memory(intake, mni_faces_bytes(intake->vertices, intake->triangles));
}

static bool any_left(mni_intake *intake) {
    if (intake->counts.input_faces == 0) {
        mn_fail(intake->st, MN_BAD_INPUT,
                "%s: has %llu vertices and no face: a mesh of triangles or polygons is wanted",
                intake->name, (unsigned long long)intake->pushed);
    } else if (intake->triangles == 0) {
        const mn_intake *c = &intake->counts;
        mn_fail(intake->st, MN_BAD_INPUT,
                "%s: no face is left of %llu: %llu degenerate, %llu with vertices that are not "
                "finite",
                intake->name, (unsigned long long)c->input_faces,
                (unsigned long long)c->degenerate_faces, (unsigned long long)c->nonfinite_faces);
    }
    return intake->triangles > 0;
}

/* Numbers the used vertices anew, in their order, and lets the others go. */
static bool drop_unused(mni_intake *intake) {
    uint32_t *number = NULL;
    if (!take(intake, (void **)&number, intake->vertices, sizeof *number))
        return false;
    memset(number, 0, intake->vertices * sizeof *number);
    for (uint64_t i = 0; i < 3 * intake->triangles; i++)
        number[intake->corner[i]] = 1;
    uint32_t used = 0;
    for (uint64_t v = 0; v < intake->vertices; v++) {
        if (number[v] == 0)
            continue;
        memmove(intake->position + 3 * (uint64_t)used, intake->position + 3 * v,
                3 * sizeof(double));
        if (intake->color != NULL)
            intake->color[used] = intake->color[v];
        number[v] = used++;
    }
    for (uint64_t i = 0; i < 3 * intake->triangles; i++)
        intake->corner[i] = number[intake->corner[i]];
    free(number);
    intake->counts.unused_vertices = intake->vertices - used;
    intake->vertices = used;
    return true;
}

/* 0 where floats hold every coordinate as it is (then true); else the middle of the box, on a grid
 * of a 256th of its size or finer, so that a mesh written and read again has the same. */
static bool choose_origin(const mni_intake *intake, double origin[3]) {
    double low[3] = {INFINITY, INFINITY, INFINITY};
    double high[3] = {-INFINITY, -INFINITY, -INFINITY};
    bool exact = true;
    for (uint64_t v = 0; v < intake->vertices; v++) {
        for (int i = 0; i < 3; i++) {
            double x = intake->position[3 * v + i];
            low[i] = fmin(low[i], x);
            high[i] = fmax(high[i], x);
            exact = exact && (double)(float)x == x;
        }
    }
    double size = fmax(fmax(high[0] - low[0], high[1] - low[1]), high[2] - low[2]);
    for (int i = 0; i < 3; i++) {
        double middle = low[i] + (high[i] - low[i]) / 2;
        double grid = size > 0 ? ldexp(1, ilogb(size) - 8) : 0;
        origin[i] = exact ? 0 : grid > 0 ? nearbyint(middle / grid) * grid + 0.0 : middle;
    }
    return exact;
}

static void as_floats(const mni_intake *intake, const double origin[3], uint64_t vertex,
                      float p[3]) {
    for (int i = 0; i < 3; i++)
        p[i] = (float)(intake->position[3 * vertex + i] - origin[i]) + 0.0f;
}

/* Vertices at different places as floats (or as doubles). */
static bool count_places(mni_intake *intake, const double origin[3], bool doubles,
                         uint64_t *places) {
    mni_table table;
    if (!mni_table_open(&table, intake->vertices))
        return no_memory(intake, mni_table_bytes(intake->vertices));
    *places = 0;
    for (uint64_t v = 0; v < intake->vertices; v++) {
        const double *exact = intake->position + 3 * v;
        float p[3], q[3];
        as_floats(intake, origin, v, p);
        uint64_t hash = doubles ? hash_position(intake, exact)
                                : XXH3_64bits_withSeed(p, sizeof p, intake->seed);
        uint64_t at = mni_table_first(&table, hash);
        uint32_t other;
        for (; mni_table_at(&table, at, &other); at = mni_table_next(&table, at)) {
            as_floats(intake, origin, other, q);
            if (doubles
                    ? memcmp(intake->position + 3 * (uint64_t)other, exact, 3 * sizeof *exact) == 0
                    : memcmp(p, q, sizeof p) == 0)
                break;
        }
        if (!mni_table_at(&table, at, &other)) {
            mni_table_put(&table, at, (uint32_t)v);
            (*places)++;
        }
    }
    mni_table_close(&table);
    return true;
}

static bool count_merged(mni_intake *intake, const double origin[3]) {
    uint64_t apart = intake->vertices, places;
    if (intake->weld == MN_WELD_OFF && !count_places(intake, origin, true, &apart))
        return false;
    if (!count_places(intake, origin, false, &places))
        return false;
    intake->counts.merged_positions = apart - places;
    return true;
}

/* Hands the arrays over, trimmed. */
static bool hand_over(mni_intake *intake, const double origin[3], mn_mesh *out) {
    float *position = NULL;
    if (!take(intake, (void **)&position, intake->vertices, 3 * sizeof(float)))
        return false;
    for (uint64_t v = 0; v < intake->vertices; v++)
        as_floats(intake, origin, v, position + 3 * v);
    free(intake->position);
    intake->position = NULL;
    uint32_t *corner = realloc(intake->corner, 3 * intake->triangles * sizeof(uint32_t));
    if (corner != NULL)
        intake->corner = corner;
    if (intake->color != NULL) {
        uint32_t *color = realloc(intake->color, intake->vertices * sizeof(uint32_t));
        if (color != NULL)
            intake->color = color;
    }
    *out = (mn_mesh){.vertices = (uint32_t)intake->vertices,
                     .triangles = (uint32_t)intake->triangles,
                     .position = position,
                     .color = intake->color,
                     .corner = intake->corner,
                     .origin = {origin[0], origin[1], origin[2]},
                     .intake = intake->counts};
    intake->color = intake->corner = NULL;
    return true;
}

bool mni_intake_finish(mni_intake *intake, mn_mesh *out) {
    if (intake->over)
        return refuse(intake, need_bytes(intake, intake->pushed, intake->vertices,
                                         intake->triangles + CAP_CHECK_EVERY));
    mn_intake *counts = &intake->counts;
    counts->input_faces = intake->triangles;
    counts->welded_vertices = intake->pushed - intake->vertices;
    mni_table_close(&intake->table);
    reject_single_faces(intake);
    free(intake->welded);
    intake->welded = NULL;
    if (!any_left(intake) || !reject_duplicates(intake) || !drop_unused(intake))
        return false;
    double origin[3];
    bool exact = choose_origin(intake, origin);
    if (!exact && !count_merged(intake, origin))
        return false;
    MN_ASSERT(counts->input_faces == intake->triangles + counts->duplicate_faces +
                                         counts->degenerate_faces + counts->nonfinite_faces);
    return hand_over(intake, origin, out);
}
