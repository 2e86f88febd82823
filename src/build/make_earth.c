/* The Earth, from a grid of heights over latitude and longitude: a closed globe of radius 1, north
 * along +y, its relief exaggerated so that it shows at all.
 *
 *             N            one vertex a pole, the mean of the heights about it
 *        ╱  ╱ │ ╲  ╲       a fan, as many triangles as columns
 *       r───r─┼──r──r      rows, south to north; the last column is joined to the first
 *       │ ╱ │╱│╲ │╲ │
 *       r───r─┼──r──r      numbers: south 0, row by row from 1, north last
 *
 * A grid with rows at ±90° repeats one height in them: each becomes its pole. Other grids end half
 * a step before; their poles are put where they belong.
 *
 * The heights come from metanode-netcdf, row by row (src/build/netcdf/main.c has the stream's
 * form). Secret: the numbering and the colours. One thread. Memory: a row. */
#define _GNU_SOURCE /* realpath */
#include "make.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "helper.h"
#include "noise.h"

#define RADIUS_M 6371000.0 /* of the Earth, mean */
#define EXAGGERATION 20.0  /* the Himalayas rise by a fortieth of the radius */
#define LOW (-0.9)         /* exaggerated heights beyond these, in radii, are no relief */
#define HIGH 9.0
#define POLE_REACH 1e-6 /* degrees: a row this near to ±90° is the pole */
#define COLUMNS_MAX (UINT64_C(1) << 20)
#define ROWS_MAX (UINT64_C(1) << 20)
#define VERTICES_MAX ((UINT64_C(1) << 31) - 1) /* as readers have it */

typedef struct globe {
    const char *name; /* of the file, for messages */
    mni_helper helper;
    uint64_t columns, rows; /* of the stream */
    bool pole[2];           /* its first and last row are the south and the north pole */
    double scale;           /* exaggeration / RADIUS_M */
    double *sine, *cosine;  /* of the columns' longitudes */
    double *north;          /* degrees of the rows */
    float *height;          /* of one row, metres */
} globe;

/* Rows that are not poles. */
static uint64_t rings(const globe *g) {
    return g->rows - g->pole[0] - g->pole[1];
}

/* Of work: rows of heights, and bands of faces between rings and poles. */
static uint64_t steps(const globe *g) {
    return g->rows + rings(g) + 1;
}

static double clamped(double x, double low, double high) {
    return x < low ? low : x > high ? high : x;
}

/* Sea by depth, land by height, snow above a line that falls towards the poles. */
static uint32_t color(double metres, double sine_north) {
    static const mni_rgb abyss = {0.03, 0.07, 0.20}, ocean = {0.07, 0.22, 0.45},
                         shelf = {0.36, 0.62, 0.73}, plain = {0.30, 0.44, 0.20},
                         upland = {0.67, 0.58, 0.36}, rock = {0.47, 0.37, 0.29},
                         snow = {0.95, 0.96, 0.98};
    if (metres < 0) {
        mni_rgb deep = mni_rgb_mix(ocean, abyss, mni_make_step(2500, 6500, -metres));
        return mni_rgb_pack(mni_rgb_mix(shelf, deep, mni_make_step(0, 2500, -metres)));
    }
    mni_rgb land = mni_rgb_mix(plain, upland, mni_make_step(150, 1200, metres));
    land = mni_rgb_mix(land, rock, mni_make_step(1500, 4000, metres));
    double line = 5300 * (1 - sine_north * sine_north / 0.87); /* 0 at 69° */
    return mni_rgb_pack(mni_rgb_mix(land, snow, mni_make_step(line - 300, line + 700, metres)));
}

/* ---- the stream of heights ----------------------------------------------------------------- */

static mn_code fall_short(const globe *g, mn_status *st) {
    return mn_fail(st, MN_BAD_INPUT, "%s: its heights end too early", g->name);
}

static mn_code take_counts(globe *g, mn_status *st) {
    struct {
        char magic[8];
        uint64_t columns, rows;
    } head;
    if (!mni_helper_read(&g->helper, &head, sizeof head))
        return fall_short(g, st);
    if (memcmp(head.magic, "MNHEIGHT", sizeof head.magic) != 0 || head.columns > COLUMNS_MAX ||
        head.rows > ROWS_MAX)
        return mn_fail(st, MN_FAILED, "%s is of another version", g->helper.program->name);
    g->columns = head.columns;
    g->rows = head.rows;
    g->sine = malloc((2 * head.columns + head.rows) * sizeof *g->sine + 1);
    g->height = malloc(head.columns * sizeof *g->height + 1);
    if (g->sine == NULL || g->height == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a row of %" PRIu64 " heights", g->columns);
    g->cosine = g->sine + g->columns;
    g->north = g->cosine + g->columns;
    return MN_OK;
}

static mn_code take_axes(globe *g, mn_status *st) {
    if (!mni_helper_read(&g->helper, g->sine, g->columns * sizeof *g->sine) ||
        !mni_helper_read(&g->helper, g->north, g->rows * sizeof *g->north))
        return fall_short(g, st);
    for (uint64_t c = 0; c < g->columns; c++) {
        double turn = g->sine[c] / 360;
        g->sine[c] = mni_make_sine(turn);
        g->cosine[c] = mni_make_sine(turn + 0.25);
    }
    g->pole[0] = g->rows > 0 && g->north[0] < -90 + POLE_REACH;
    g->pole[1] = g->rows > 1 && g->north[g->rows - 1] > 90 - POLE_REACH;
    if (g->columns < 3 || rings(g) < 1)
        return mn_fail(st, MN_USAGE,
                       "%s: %" PRIu64 " columns and %" PRIu64
                       " rows between the poles are too few for a globe; lower --stride",
                       g->name, g->columns, rings(g));
    if (g->columns * rings(g) > VERTICES_MAX - 2)
        return mn_fail(st, MN_USAGE,
                       "%s: a globe of %" PRIu64 " × %" PRIu64
                       " vertices is too large; give --stride",
                       g->name, g->columns, rings(g));
    return MN_OK;
}

/* *mean: of its heights. */
static mn_code take_row(globe *g, double *mean, mn_status *st) {
    double sum = 0;
    if (!mni_helper_read(&g->helper, g->height, g->columns * sizeof *g->height))
        return fall_short(g, st);
    for (uint64_t c = 0; c < g->columns; c++) {
        double h = (double)g->height[c] * g->scale;
        if (!(h > LOW && h < HIGH))
            return mn_fail(st, MN_BAD_INPUT,
                           "%s: a height of %g m is no relief of the Earth; lower --exaggeration, "
                           "or give another grid",
                           g->name, (double)g->height[c]);
        sum += (double)g->height[c];
    }
    *mean = sum / (double)g->columns;
    return MN_OK;
}

/* ---- vertices and faces -------------------------------------------------------------------- */

static void write_pole(const globe *g, int side, double metres, mni_make_ply *ply) {
    const double p[3] = {0, side * (1 + metres * g->scale), 0};
    mni_make_ply_vertex(ply, p, color(metres, side));
}

static void write_ring(const globe *g, double degrees, mni_make_ply *ply) {
    double sine = mni_make_sine(degrees / 360), cosine = mni_make_sine(degrees / 360 + 0.25);
    for (uint64_t c = 0; c < g->columns; c++) {
        double r = 1 + (double)g->height[c] * g->scale;
        const double p[3] = {r * cosine * g->cosine[c], r * sine, -r * cosine * g->sine[c]};
        mni_make_ply_vertex(ply, p, color((double)g->height[c], sine));
    }
}

static mn_code write_vertices(const mn_make_desc *desc, globe *g, mni_make_ply *ply,
                              mn_status *st) {
    double mean = 0;
    for (uint64_t r = 0; r < g->rows; r++) {
        bool last = r + 1 == g->rows;
        mn_code code = take_row(g, &mean, st);
        if (code == MN_OK)
            code = mni_make_progress(desc, ply, r, steps(g), st);
        if (code != MN_OK)
            return code;
        if (r == 0)
            write_pole(g, -1, mean, ply);
        if (!(r == 0 && g->pole[0]) && !(last && g->pole[1]))
            write_ring(g, clamped(g->north[r], -90, 90), ply);
    }
    write_pole(g, 1, mean, ply);
    return MN_OK;
}

/* Two rings, or a ring and a pole; where the diagonals go is left to chance. */
static mn_code write_faces(const mn_make_desc *desc, const globe *g, mni_make_ply *ply,
                           mn_status *st) {
    uint64_t n = g->columns, bands = rings(g) + 1;
    uint32_t north_pole = (uint32_t)(1 + rings(g) * n);
    for (uint64_t band = 0; band < bands; band++) {
        uint32_t low = (uint32_t)(1 + (band - 1) * n), high = (uint32_t)(1 + band * n);
        for (uint32_t w = 0; w < n; w++) {
            uint32_t e = w + 1 < n ? w + 1 : 0;
            if (band == 0) {
                mni_make_ply_face(ply, 0, high + e, high + w);
            } else if (band + 1 == bands) {
                mni_make_ply_face(ply, low + w, low + e, north_pole);
            } else if (mni_noise_mix(desc->seed + low + w) & 1) {
                mni_make_ply_face(ply, low + w, low + e, high + e);
                mni_make_ply_face(ply, low + w, high + e, high + w);
            } else {
                mni_make_ply_face(ply, low + w, low + e, high + w);
                mni_make_ply_face(ply, low + e, high + e, high + w);
            }
        }
        mn_code code = mni_make_progress(desc, ply, g->rows + band, steps(g), st);
        if (code != MN_OK)
            return code;
    }
    return MN_OK;
}

/* ---- the whole ----------------------------------------------------------------------------- */

static mn_code receive(const mn_make_desc *desc, globe *g, mni_make_ply *ply, mn_status *st) {
    mn_code code = take_counts(g, st);
    if (code == MN_OK)
        code = take_axes(g, st);
    if (code != MN_OK)
        return code;
    uint64_t vertices = g->columns * rings(g) + 2;
    code = mni_make_ply_begin(ply, vertices, 2 * (vertices - 2), st);
    return code == MN_OK ? write_vertices(desc, g, ply, st) : code;
}

/* A regular file, by a name that libnetcdf takes for no address of a server. */
static mn_code whole_path(const char *given, char **path, mn_status *st) {
    mni_in in;
    if (given == NULL)
        return mn_fail(st, MN_USAGE, "the earth needs a grid of heights: --etopo FILE");
    mn_code code = mni_in_open(&in, given, st);
    if (code != MN_OK)
        return code;
    mni_in_close(&in);
    *path = realpath(given, NULL);
    return *path != NULL ? MN_OK
                         : mn_fail(st, MN_FAILED, "%s: cannot find it: %s", given, strerror(errno));
}

mn_code mni_make_earth(const mn_make_desc *desc, mni_make_ply *ply, mn_status *st) {
    char *path = NULL, stride[16];
    globe g = {.name = desc->etopo};
    g.scale = (desc->exaggeration != 0 ? desc->exaggeration : EXAGGERATION) / RADIUS_M;
    mn_code code = whole_path(desc->etopo, &path, st);
    if (code != MN_OK)
        return code;
    snprintf(stride, sizeof stride, "%" PRIu32, desc->stride != 0 ? desc->stride : 1);
    const char *const args[] = {path, stride, NULL};
    code = mni_helper_open(&g.helper, desc->helper_dir, &mni_helper_netcdf, args, st);
    if (code == MN_OK) {
        mn_status own = {0}, its = {0};
        g.helper.watch = (mn_watch){desc->progress, desc->progress_context};
        code = receive(desc, &g, ply, &own);
        bool cut = g.helper.cut;
        mni_helper_close(&g.helper, g.name, NULL, &its);
        if (its.code != MN_OK && (cut || code == MN_OK)) { /* a cut is best told by who cut it */
            own = its;
            code = its.code;
        }
        if (own.code != MN_OK)
            mn_fail(st, own.code, "%s", own.text);
    }
    if (code == MN_OK)
        code = write_faces(desc, &g, ply, st);
    free(g.sine);
    free(g.height);
    free(path);
    return code;
}
