/* From what a file says to a mesh: welding, rejection, counting, an origin.
 *
 * Secret: what is done in which order, so that memory stays low and bounded. With a cap, what is
 * needed is worked out before it is taken; once it exceeds the cap everything is freed and the rest
 * of the file is only counted, so that the refusal can name a number that works.
 *
 *   read:    vertex -> weld -> position[]      triangle -> corner[] (vertices as the file counts)
 *   finish:  renumber by the weld, reject non-finite and degenerate -> reject duplicates
 *            -> drop unused vertices -> origin, floats
 *
 * Order: open, expect?, vertices and triangles in any order, finish?, close. Threads: one. Memory:
 * what need_bytes() sums. (design.md §3.1) */
#include "reader.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "cap.h"
#include "extintake.h"
#include "faces.h"
#include "weld.h"

enum {
    CAPACITY_MIN = 1024,
    CAP_CHECK_EVERY = 4096, /* vertices or triangles: how far the cap may be overrun, some 200 kB */
    SLACK_BYTES = 2 << 20,  /* buffers, allocator, stack */
};

struct mni_intake {
    /* const after open */
    bool apart; /* no welding */
    bool soup;
    uint64_t ram_bytes; /* 0: no cap */
    uint64_t (*then_need_bytes)(uint64_t vertices, uint64_t triangles);
    const char *name;
    mn_status *st;

    uint64_t pushed;    /* vertices, as the file has them */
    uint64_t triangles; /* pushed; since finish began: kept */
    bool expected;      /* vertices are as announced: room was made once */
    bool over;          /* the cap: only counting since then */

    mni_extintake *external; /* has all that is pushed, and nothing here; NULL: it is here */
    mni_claims *claims;      /* all that is wanted; NULL: the mesh is */
    mni_weld weld;
    uint32_t *welded; /* pushed -> vertex; NULL in soups and without welding */
    uint64_t pushed_capacity;
    uint32_t *corner; /* 3 × triangles; vertices as pushed (in a soup: welded) */
    uint64_t triangles_capacity;
    mn_intake counts;
};

/* ---- memory --------------------------------------------------------------------------------- */

static uint64_t largest(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

/* Peak for a file with so many vertices as it counts them, so many of them kept apart, and so many
 * triangles: the largest of the steps. Colours are counted always, for simplicity. */
static uint64_t reading_bytes(const mni_intake *intake, uint64_t pushed, uint64_t vertices,
                              uint64_t triangles) {
    uint64_t mesh = vertices * 3 * sizeof(double)       /* position */
                    + vertices * sizeof(uint32_t)       /* color */
                    + triangles * 3 * sizeof(uint32_t); /* corner */
    uint64_t welding = 0;
    if (!intake->apart)
        welding = mni_weld_table_bytes(vertices, intake->expected) +
                  (intake->soup ? 0 : pushed * sizeof(uint32_t)); /* welded */
    uint64_t checking = mni_faces_bytes(vertices, triangles);
    uint64_t finishing = vertices * sizeof(uint32_t)  /* renumbering */
                         + mni_table_bytes(vertices); /* counting what falls together */
    uint64_t floats = vertices * 3 * sizeof(float);   /* beside the doubles */
    return mesh + largest(largest(welding, checking), largest(finishing, floats)) + SLACK_BYTES;
}

/* The same, and what comes after reading. */
static uint64_t need_bytes(const mni_intake *intake, uint64_t pushed, uint64_t vertices,
                           uint64_t triangles) {
    uint64_t reading = reading_bytes(intake, pushed, vertices, triangles);
    if (intake->then_need_bytes == NULL)
        return reading;
    return largest(reading, intake->then_need_bytes(vertices, triangles));
}

static void free_arrays(mni_intake *intake) {
    mni_weld_close(&intake->weld);
    free(intake->welded);
    free(intake->corner);
    intake->welded = intake->corner = NULL;
    intake->pushed_capacity = intake->triangles_capacity = 0;
}

static bool no_memory(mni_intake *intake) {
    mn_fail(intake->st, MN_FAILED, "%s: no memory for %llu vertices and %llu triangles",
            intake->name, (unsigned long long)intake->pushed,
            (unsigned long long)intake->triangles);
    return false;
}

/* The cap is too small for `need`. */
static bool refuse(mni_intake *intake, uint64_t need) {
    mn_fail(intake->st, MN_CAP_TOO_SMALL,
            "%s: up to %llu vertices and %llu triangles take %.1f MB, the cap is %.1f MB: "
            "--ram %lluM would do",
            intake->name, (unsigned long long)mni_weld_vertices(&intake->weld),
            (unsigned long long)intake->triangles, (double)need / (1 << 20),
            (double)intake->ram_bytes / (1 << 20), mni_megabytes(need));
    return false;
}

static void give_up_keeping(mni_intake *intake) {
    intake->over = true;
    mni_weld_count_only(&intake->weld);
    free_arrays(intake);
}

/* Goes over to counting when what is there now, or is about to be, exceeds the cap. */
static void check_cap(mni_intake *intake) {
    if (intake->ram_bytes == 0 || intake->over)
        return;
    uint64_t need = need_bytes(intake, intake->pushed, mni_weld_vertices(&intake->weld),
                               intake->triangles + CAP_CHECK_EVERY);
    if (need <= intake->ram_bytes)
        return;
    give_up_keeping(intake);
}

/* Makes room for one more of `used`. */
static bool grow(mni_intake *intake, void **array, uint64_t used, uint64_t *capacity,
                 size_t item_bytes) {
    uint64_t room = *capacity + *capacity / 2;
    room = largest(room, used + 1);
    room = largest(room, CAPACITY_MIN);
    void *larger = realloc(*array, room * item_bytes);
    if (larger == NULL)
        return no_memory(intake);
    *array = larger;
    *capacity = room;
    return true;
}

static bool take(mni_intake *intake, void **array, uint64_t count, size_t item_bytes) {
    if (count == 0)
        return true;
    *array = malloc(count * item_bytes);
    return *array != NULL || no_memory(intake);
}

/* ---- open, expect, close -------------------------------------------------------------------- */

mni_intake *mni_intake_open(const mn_read_desc *desc, bool soup, const char *name, mn_status *st) {
    mni_intake *intake = calloc(1, sizeof *intake);
    if (intake == NULL) {
        mn_fail(st, MN_FAILED, "%s: no memory", name);
        return NULL;
    }
    intake->apart = desc->weld == MN_WELD_OFF && !soup;
    intake->soup = soup;
    intake->ram_bytes = desc->ram_bytes;
    intake->then_need_bytes = desc->then_need_bytes;
    intake->name = name;
    intake->st = st;
    mni_weld_open(&intake->weld, intake->apart, soup ? &intake->corner : &intake->welded);
    return intake;
}

mni_intake *mni_intake_open_to(mni_extintake *x, bool soup, const char *name, mn_status *st) {
    mni_intake *intake = mni_intake_open(&(mn_read_desc){0}, soup, name, st);
    if (intake != NULL)
        intake->external = x;
    return intake;
}

mni_intake *mni_intake_open_claims(mni_claims *claims, const char *name, mn_status *st) {
    mni_intake *intake = mni_intake_open(&(mn_read_desc){0}, false, name, st);
    if (intake != NULL)
        intake->claims = claims;
    return intake;
}

static bool too_many(mni_intake *intake, uint64_t count, uint64_t max, const char *what) {
    mn_fail(intake->st, MN_BAD_INPUT, "%s: has %llu %s, more than the %llu that can be taken in",
            intake->name, (unsigned long long)count, what, (unsigned long long)max);
    return false;
}

bool mni_intake_expect(mni_intake *intake, uint64_t vertices, uint64_t triangles) {
    MN_ASSERT(intake->pushed == 0 && intake->triangles == 0 && intake->corner == NULL);
    if (vertices > MNI_VERTICES_MAX)
        return too_many(intake, vertices, MNI_VERTICES_MAX, "vertices");
    if (triangles > MNI_TRIANGLES_MAX)
        return too_many(intake, triangles, MNI_TRIANGLES_MAX, "triangles");
    if (intake->claims != NULL) {
        *intake->claims = (mni_claims){true, vertices, triangles};
        mn_fail(intake->st, MN_FAILED, "%s: no more is wanted", intake->name);
        return false;
    }
    if (intake->external != NULL)
        return true;
    intake->expected = !intake->soup;
    if (intake->ram_bytes != 0 &&
        need_bytes(intake, vertices, vertices, triangles) > intake->ram_bytes) {
        give_up_keeping(intake);
        return true;
    }
    intake->triangles_capacity = triangles;
    if (!take(intake, (void **)&intake->corner, triangles, 3 * sizeof(uint32_t)))
        return false;
    if (intake->soup)
        return true;
    if (!mni_weld_reserve(&intake->weld, vertices))
        return no_memory(intake);
    if (intake->apart)
        return true;
    intake->pushed_capacity = vertices;
    return take(intake, (void **)&intake->welded, vertices, sizeof(uint32_t));
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

bool mni_intake_vertex(mni_intake *intake, const double position[3]) {
    return mni_intake_vertex_color(intake, position, MNI_WHITE);
}

bool mni_intake_vertex_color(mni_intake *intake, const double position[3], uint32_t rgba) {
    MN_ASSERT(!intake->soup);
    if (intake->pushed >= MNI_VERTICES_MAX)
        return too_many(intake, intake->pushed + 1, MNI_VERTICES_MAX, "vertices");
    if (intake->external != NULL) {
        intake->pushed++;
        return mni_extintake_vertex(intake->external, position, rgba);
    }
    if (intake->pushed % CAP_CHECK_EVERY == 0)
        check_cap(intake);
    if (!intake->over && !intake->apart && intake->pushed == intake->pushed_capacity &&
        !grow(intake, (void **)&intake->welded, intake->pushed, &intake->pushed_capacity,
              sizeof(uint32_t)))
        return false;
    if (!mni_weld_add(&intake->weld, position, rgba, intake->pushed))
        return no_memory(intake);
    intake->pushed++;
    return true;
}

/* ---- triangles ------------------------------------------------------------------------------ */

/* Room for one more, and whether there may be one. */
static bool prepare_triangle(mni_intake *intake) {
    if (intake->triangles >= MNI_TRIANGLES_MAX)
        return too_many(intake, intake->triangles + 1, MNI_TRIANGLES_MAX, "triangles");
    if (intake->external != NULL)
        return true;
    if (intake->triangles % CAP_CHECK_EVERY == 0)
        check_cap(intake);
    return intake->over || intake->triangles < intake->triangles_capacity ||
           grow(intake, (void **)&intake->corner, intake->triangles, &intake->triangles_capacity,
                3 * sizeof(uint32_t));
}

bool mni_intake_triangle(mni_intake *intake, uint32_t a, uint32_t b, uint32_t c) {
    MN_ASSERT(!intake->soup);
    if (!prepare_triangle(intake))
        return false;
    if (intake->external != NULL) {
        intake->triangles++;
        return mni_extintake_triangle(intake->external, a, b, c);
    }
    if (!intake->over) {
        uint32_t *corner = intake->corner + 3 * intake->triangles;
        corner[0] = a;
        corner[1] = b;
        corner[2] = c;
    }
    intake->triangles++;
    return true;
}

/* Numbered as they come; corners are vertices. */
static bool push_corners(mni_intake *intake, double corner[3][3]) {
    for (uint32_t i = 0; i < 3; i++)
        if (!mni_extintake_vertex(intake->external, corner[i], MNI_WHITE))
            return false;
    intake->pushed += 3;
    intake->triangles++;
    return mni_extintake_triangle(intake->external, 0, 1, 2);
}

bool mni_intake_soup_triangle(mni_intake *intake, double corner[3][3]) {
    MN_ASSERT(intake->soup);
    if (!prepare_triangle(intake))
        return false;
    if (intake->external != NULL)
        return push_corners(intake, corner);
    if (!intake->over && intake->weld.vertices >= MNI_VERTICES_MAX)
        return too_many(intake, intake->weld.vertices + 1, MNI_VERTICES_MAX, "vertices");
    for (uint32_t i = 0; i < 3; i++)
        if (!mni_weld_add(&intake->weld, corner[i], MNI_WHITE, 3 * intake->triangles + i))
            return no_memory(intake);
    intake->pushed += 3;
    intake->triangles++;
    return true;
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
    return isnan(intake->weld.position[3 * (uint64_t)vertex]);
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
        if (intake->weld.nonfinite > 0 &&
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
    uint64_t vertices = mni_weld_vertices(&intake->weld);
    uint64_t need = reading_bytes(intake, intake->pushed, vertices, intake->triangles);
    uint64_t spare = UINT64_MAX, missing = 0;
    if (intake->ram_bytes != 0) /* tables for vertices like a globe's pole fit the slack */
        spare = SLACK_BYTES / 2 + (intake->ram_bytes > need ? intake->ram_bytes - need : 0);
    mn_code code = mni_faces_filter(intake->corner, &intake->triangles, vertices, spare, &missing,
                                    &intake->counts);
    if (code == MN_CAP_TOO_SMALL)
        return refuse(intake, largest(need, intake->ram_bytes) + missing);
    return code == MN_OK || no_memory(intake);
}

bool mni_intake_any_left(const mn_intake *counts, uint64_t vertices, uint64_t triangles,
                         const char *name, mn_status *st) {
    if (counts->input_faces == 0)
        mn_fail(st, MN_BAD_INPUT,
                "%s: has %llu vertices and no face: a mesh of triangles or polygons is wanted",
                name, (unsigned long long)vertices);
    else if (triangles == 0)
        mn_fail(st, MN_BAD_INPUT,
                "%s: no face is left of %llu: %llu degenerate, %llu with vertices that are not "
                "finite",
                name, (unsigned long long)counts->input_faces,
                (unsigned long long)counts->degenerate_faces,
                (unsigned long long)counts->nonfinite_faces);
    return triangles > 0;
}

/* Numbers the used vertices anew, in their order, and lets the others go. */
static bool drop_unused(mni_intake *intake) {
    mni_weld *weld = &intake->weld;
    uint32_t *number = NULL;
    if (!take(intake, (void **)&number, weld->vertices, sizeof *number))
        return false;
    memset(number, 0, weld->vertices * sizeof *number);
    for (uint64_t i = 0; i < 3 * intake->triangles; i++)
        number[intake->corner[i]] = 1;
    uint32_t used = 0;
    for (uint64_t v = 0; v < weld->vertices; v++) {
        if (number[v] == 0)
            continue;
        memmove(weld->position + 3 * (uint64_t)used, weld->position + 3 * v, 3 * sizeof(double));
        if (weld->color != NULL)
            weld->color[used] = weld->color[v];
        number[v] = used++;
    }
    for (uint64_t i = 0; i < 3 * intake->triangles; i++)
        intake->corner[i] = number[intake->corner[i]];
    free(number);
    intake->counts.unused_vertices = weld->vertices - used;
    weld->vertices = used;
    return true;
}

/* 0 where exact; else the middle of the box, on a grid of a 256th of its size or finer, so that a
 * mesh written and read again has the same. */
void mni_intake_origin(const double low[3], const double high[3], bool exact, double origin[3]) {
    double size = fmax(fmax(high[0] - low[0], high[1] - low[1]), high[2] - low[2]);
    for (int i = 0; i < 3; i++) {
        double middle = low[i] + (high[i] - low[i]) / 2;
        double grid = size > 0 ? ldexp(1, ilogb(size) - 8) : 0;
        origin[i] = exact ? 0 : grid > 0 ? nearbyint(middle / grid) * grid + 0.0 : middle;
    }
}

/* Whether floats hold every coordinate as it is. */
static bool choose_origin(const mni_intake *intake, double origin[3]) {
    double low[3] = {INFINITY, INFINITY, INFINITY};
    double high[3] = {-INFINITY, -INFINITY, -INFINITY};
    bool exact = true;
    for (uint64_t v = 0; v < intake->weld.vertices; v++) {
        for (int i = 0; i < 3; i++) {
            double x = intake->weld.position[3 * v + i];
            low[i] = x < low[i] ? x : low[i];
            high[i] = x > high[i] ? x : high[i];
            exact = exact && (double)(float)x == x;
        }
    }
    mni_intake_origin(low, high, exact, origin);
    return exact;
}

/* What the mesh keeps of a position; context: the origin. */
static void as_floats(const double position[3], const void *context, void *floats) {
    const double *origin = context;
    float p[3];
    for (int i = 0; i < 3; i++)
        p[i] = (float)(position[i] - origin[i]) + 0.0f;
    memcpy(floats, p, sizeof p);
}

static void as_doubles(const double position[3], const void *context, void *doubles) {
    (void)context;
    memcpy(doubles, position, 3 * sizeof *position);
}

/* Different positions that became the same. */
static bool count_merged(mni_intake *intake, const double origin[3]) {
    uint64_t apart = intake->weld.vertices, places;
    if (intake->apart &&
        !mni_weld_count_places(&intake->weld, as_doubles, NULL, 3 * sizeof(double), &apart))
        return no_memory(intake);
    if (!mni_weld_count_places(&intake->weld, as_floats, origin, 3 * sizeof(float), &places))
        return no_memory(intake);
    intake->counts.merged_positions = apart - places;
    return true;
}

/* Hands the arrays over, trimmed. */
static bool hand_over(mni_intake *intake, const double origin[3], mn_mesh *out) {
    mni_weld *weld = &intake->weld;
    float *position = NULL;
    if (!take(intake, (void **)&position, weld->vertices, 3 * sizeof(float)))
        return false;
    for (uint64_t v = 0; v < weld->vertices; v++)
        as_floats(weld->position + 3 * v, origin, position + 3 * v);
    uint32_t *corner = realloc(intake->corner, 3 * intake->triangles * sizeof(uint32_t));
    if (corner != NULL)
        intake->corner = corner;
    if (weld->color != NULL) {
        uint32_t *color = realloc(weld->color, weld->vertices * sizeof(uint32_t));
        if (color != NULL)
            weld->color = color;
    }
    *out = (mn_mesh){.vertices = (uint32_t)weld->vertices,
                     .triangles = (uint32_t)intake->triangles,
                     .position = position,
                     .color = weld->color,
                     .corner = intake->corner,
                     .origin = {origin[0], origin[1], origin[2]},
                     .intake = intake->counts};
    weld->color = NULL;
    intake->corner = NULL;
    return true;
}

bool mni_intake_finish(mni_intake *intake, mn_mesh *out) {
    if (!intake->over && !mni_weld_flush(&intake->weld))
        return no_memory(intake);
    check_cap(intake);
    if (intake->over)
        return refuse(intake, need_bytes(intake, intake->pushed, mni_weld_vertices(&intake->weld),
                                         intake->triangles + CAP_CHECK_EVERY));
    mn_intake *counts = &intake->counts;
    counts->input_faces = intake->triangles;
    counts->welded_vertices = intake->pushed - mni_weld_vertices(&intake->weld);
    mni_weld_close_table(&intake->weld);
    reject_single_faces(intake);
    free(intake->welded);
    intake->welded = NULL;
    if (!mni_intake_any_left(counts, intake->pushed, intake->triangles, intake->name, intake->st) ||
        !reject_duplicates(intake) || !drop_unused(intake))
        return false;
    double origin[3];
    bool exact = choose_origin(intake, origin);
    if (!exact && !count_merged(intake, origin))
        return false;
    MN_ASSERT(counts->input_faces == intake->triangles + counts->duplicate_faces +
                                         counts->degenerate_faces + counts->nonfinite_faces);
    return hand_over(intake, origin, out);
}
