/* Goal: a globe from a grid of heights is closed, stands where longitude and latitude say, and
 * every grid that is none is refused with one line that says why. Method: netCDF files of the
 * classic format written here byte by byte, with and without poles, turned over, repeated, cut,
 * packed. */
#include <check.h>
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "made_model.h"
#include "metanode/build.h"
#include "suite.h"

static char folder[] = "/tmp/mn-earth-XXXXXX";
static char grid_path[64], path[64];

/* ---- netCDF, classic --------------------------------------------------------------------- */

enum { POINTS_MAX = 64, MISSING = -32768 };
typedef struct grid {
    int rows, columns;
    double north[POINTS_MAX], east[POINTS_MAX];
    int metres[POINTS_MAX][POINTS_MAX];
    bool packed;     /* 16-bit, metres = 2 × packed + 10, with MISSING */
    bool no_axes;    /* coordinates have other names than their dimensions */
    int cut_bytes;   /* from the end of the file */
    bool transposed; /* heights (longitude, latitude) */
} grid;

static void put_u32(FILE *f, uint32_t x) {
    const unsigned char b[4] = {(unsigned char)(x >> 24), (unsigned char)(x >> 16),
                                (unsigned char)(x >> 8), (unsigned char)x};
    fwrite(b, 4, 1, f);
}

static void put_f64(FILE *f, double x) {
    uint64_t bits;
    memcpy(&bits, &x, 8);
    put_u32(f, (uint32_t)(bits >> 32));
    put_u32(f, (uint32_t)bits);
}

static void put_f32(FILE *f, float x) {
    uint32_t bits;
    memcpy(&bits, &x, 4);
    put_u32(f, bits);
}

/* Padded with zeros to four bytes. */
static void put_text(FILE *f, const char *text) {
    size_t n = strlen(text);
    put_u32(f, (uint32_t)n);
    fwrite(text, 1, n, f);
    fwrite("\0\0\0", 1, (4 - n % 4) % 4, f);
}

enum { NC_TYPE_SHORT = 3, NC_TYPE_FLOAT = 5, NC_TYPE_DOUBLE = 6 };
enum { TAG_DIMENSION = 10, TAG_VARIABLE = 11, TAG_ATTRIBUTE = 12 };

static void put_variable(FILE *f, const char *name, int dimensions, const uint32_t *along,
                         bool packed, uint32_t type, uint32_t bytes, uint32_t begin) {
    put_text(f, name);
    put_u32(f, (uint32_t)dimensions);
    for (int i = 0; i < dimensions; i++)
        put_u32(f, along[i]);
    put_u32(f, packed ? TAG_ATTRIBUTE : 0);
    put_u32(f, packed ? 3 : 0);
    for (int i = 0; i < 2 && packed; i++) {
        put_text(f, i == 0 ? "scale_factor" : "add_offset");
        put_u32(f, NC_TYPE_FLOAT);
        put_u32(f, 1);
        put_f32(f, i == 0 ? 2.0f : 10.0f);
    }
    if (packed) {
        put_text(f, "_FillValue");
        put_u32(f, NC_TYPE_SHORT);
        put_u32(f, 1);
        put_u32(f, (uint32_t)(MISSING & 0xffff) << 16);
    }
    put_u32(f, type);
    put_u32(f, bytes);
    put_u32(f, begin);
}

static void put_heights(FILE *f, const grid *g) {
    for (int i = 0; i < g->rows * g->columns; i++) {
        int r = g->transposed ? i % g->rows : i / g->columns;
        int c = g->transposed ? i / g->rows : i % g->columns, m = g->metres[r][c];
        uint16_t packed = (uint16_t)(m == MISSING ? MISSING : (m - 10) / 2);
        const unsigned char b[2] = {(unsigned char)(packed >> 8), (unsigned char)packed};
        if (g->packed)
            fwrite(b, 2, 1, f);
        else
            put_f32(f, m == MISSING ? NAN : (float)m);
    }
}

static void write_grid(const char *to, const grid *g) {
    FILE *f = fopen(to, "wb");
    uint32_t begin = g->packed ? 400 : 300; /* a header is shorter */
    const uint32_t north = 0, east = 1, both[2] = {g->transposed, !g->transposed};
    uint32_t north_bytes = 8 * (uint32_t)g->rows, east_bytes = 8 * (uint32_t)g->columns;
    uint32_t bytes = (uint32_t)(g->rows * g->columns) * (g->packed ? 2 : 4);
    fwrite("CDF\1", 1, 4, f);
    put_u32(f, 0);
    put_u32(f, TAG_DIMENSION);
    put_u32(f, 2);
    put_text(f, "Y");
    put_u32(f, (uint32_t)g->rows);
    put_text(f, "X");
    put_u32(f, (uint32_t)g->columns);
    put_u32(f, 0);
    put_u32(f, 0);
    put_u32(f, TAG_VARIABLE);
    put_u32(f, 3);
    put_variable(f, g->no_axes ? "lat" : "Y", 1, &north, false, NC_TYPE_DOUBLE, north_bytes, begin);
    put_variable(f, g->no_axes ? "lon" : "X", 1, &east, false, NC_TYPE_DOUBLE, east_bytes,
                 begin + north_bytes);
    put_variable(f, "ROSE", 2, both, g->packed, g->packed ? NC_TYPE_SHORT : NC_TYPE_FLOAT,
                 (bytes + 3) / 4 * 4, begin + north_bytes + east_bytes);
    ck_assert_int_le(ftell(f), begin);
    while (ftell(f) < begin)
        fputc(0, f);
    for (int r = 0; r < g->rows; r++)
        put_f64(f, g->north[r]);
    for (int c = 0; c < g->columns; c++)
        put_f64(f, g->east[c]);
    put_heights(f, g);
    long end = (ftell(f) + 3) / 4 * 4 - g->cut_bytes;
    fclose(f);
    ck_assert_int_eq(truncate(to, end), 0);
}

/* Rows from pole to pole, heights of their own. */
static grid good_grid(int rows, int columns) {
    grid g = {.rows = rows, .columns = columns};
    for (int r = 0; r < rows; r++)
        g.north[r] = -90 + 180.0 * r / (rows - 1);
    for (int c = 0; c < columns; c++)
        g.east[c] = 360.0 * c / columns;
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < columns; c++)
            g.metres[r][c] = r == 0          ? 2800
                             : r == rows - 1 ? -4200
                                             : 100 * r - 90 * c + 700 * (c % 3);
    return g;
}

/* ---- making -------------------------------------------------------------------------------- */

static mn_make_desc desc_of(uint32_t stride) {
    return (mn_make_desc){.shape = MN_SHAPE_EARTH, .etopo = grid_path, .stride = stride};
}

static made_model make(const grid *g, uint32_t stride) {
    mn_make_desc desc = desc_of(stride);
    mn_status st = {0};
    write_grid(grid_path, g);
    ck_assert_msg(mn_make(path, &desc, &st) == MN_OK, "%s", st.text);
    return made_load(path);
}

static void check_globe(const made_model *m, uint64_t columns, uint64_t rings) {
    uint64_t edges;
    ck_assert_uint_eq(m->vertices, columns * rings + 2);
    ck_assert_uint_eq(m->triangles, 2 * columns * rings);
    ck_assert_uint_eq(made_check_edges(m, &edges), 0);
    ck_assert_int_eq((int64_t)(m->vertices + m->triangles) - (int64_t)edges, 2);
    made_check_fans(m);
    made_check_positions(m);
    ck_assert(made_volume(m) > 0); /* faces look out */
}

START_TEST(globes_are_closed) {
    static const struct {
        int rows, columns;
        uint32_t stride;
        uint64_t rings, kept;
    } cases[] = {{3, 3, 1, 1, 3},   {19, 36, 1, 17, 36}, {19, 36, 3, 5, 12},
                 {19, 36, 4, 4, 9}, {18, 35, 5, 3, 7},   {18, 36, 16, 1, 3}};
    const grid g = good_grid(cases[_i].rows, cases[_i].columns);
    made_model m = make(&g, cases[_i].stride);
    check_globe(&m, cases[_i].kept, cases[_i].rings);
    made_drop(&m);
}
END_TEST

static void check_place(const made_model *m, uint64_t vertex, double north, double east,
                        double metres) {
    double turn = acos(-1) / 180, r = 1 + metres * 20 / 6371000;
    const double p[3] = {r * cos(north * turn) * cos(east * turn), r * sin(north * turn),
                         -r * cos(north * turn) * sin(east * turn)};
    for (int i = 0; i < 3; i++)
        ck_assert_double_eq_tol(m->position[3 * vertex + i], p[i], 1e-6);
}

START_TEST(heights_stand_where_they_belong) {
    const grid g = good_grid(13, 24);
    made_model m = make(&g, 2);
    check_place(&m, 0, -90, 0, 2800);
    for (int r = 0; r < 5; r++)
        for (int c = 0; c < 12; c++)
            check_place(&m, (uint64_t)(1 + 12 * r + c), g.north[2 * r + 2], g.east[2 * c],
                        g.metres[2 * r + 2][2 * c]);
    check_place(&m, m.vertices - 1, 90, 0, -4200);
    made_drop(&m);
}
END_TEST

/* Turned over, with the first column once more at the end, or packed: the same globe, bit for bit.
 */
START_TEST(one_globe_in_many_forms) {
    const grid g = good_grid(13, 24);
    made_model one = make(&g, 1);
    grid turned = g, again = g, packed = g;
    for (int r = 0; r < g.rows; r++) {
        turned.north[r] = g.north[g.rows - 1 - r];
        memcpy(turned.metres[r], g.metres[g.rows - 1 - r], sizeof turned.metres[r]);
        again.metres[r][g.columns] = g.metres[r][0];
    }
    again.east[again.columns++] = 360;
    packed.packed = true;
    const grid *forms[] = {&turned, &again, &packed};
    for (int i = 0; i < 3; i++) {
        made_model m = make(forms[i], 1);
        ck_assert_uint_eq(m.hash, one.hash);
        made_drop(&m);
    }
    made_drop(&one);
}
END_TEST

/* Rows in the middle of cells: none is a pole, so each is kept and poles are added. */
START_TEST(grids_without_poles) {
    grid g = good_grid(18, 36);
    double south = 0;
    for (int r = 0; r < g.rows; r++)
        g.north[r] = -85 + 10 * r;
    for (int c = 0; c < g.columns; c++)
        south += (g.metres[0][c] = c);
    made_model m = make(&g, 1);
    check_globe(&m, 36, 18);
    check_place(&m, 0, -90, 0, south / g.columns);
    check_place(&m, 1, -85, 0, 0);
    made_drop(&m);
}
END_TEST

START_TEST(exaggeration_is_a_factor) {
    grid g = good_grid(5, 4);
    mn_make_desc desc = desc_of(1);
    mn_status st = {0};
    write_grid(grid_path, &g);
    desc.exaggeration = 100;
    ck_assert_int_eq(mn_make(path, &desc, &st), MN_OK);
    made_model m = made_load(path);
    ck_assert_float_eq_tol(m.position[1], (float)-(1 + 2800 * 100 / 6371000.0), 1e-6f);
    made_drop(&m);
    desc.exaggeration = 1e6;
    ck_assert_int_eq(mn_make(path, &desc, &st), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "--exaggeration"));
}
END_TEST

/* ---- refusals ------------------------------------------------------------------------------ */

/* Refused, with one line that names the file and holds the word; nothing is left behind. */
static void refused(const mn_make_desc *desc, mn_code code, const char *word) {
    mn_status st = {0};
    unlink(path);
    int files = made_files(folder);
    ck_assert_msg(mn_make(path, desc, &st) == code, "%d: %s", st.code, st.text);
    ck_assert_msg(strstr(st.text, word) != NULL && strchr(st.text, '\n') == NULL, "%s", st.text);
    ck_assert_int_eq(made_files(folder), files);
}

static void refused_grid(const grid *g, const char *word) {
    mn_make_desc desc = desc_of(1);
    write_grid(grid_path, g);
    refused(&desc, MN_BAD_INPUT, word);
    refused(&desc, MN_BAD_INPUT, grid_path);
}

START_TEST(grids_that_are_no_globe) {
    grid g = good_grid(9, 12);
    g.no_axes = true;
    refused_grid(&g, "no variable of heights");
    g = good_grid(9, 12);
    g.transposed = true;
    refused_grid(&g, "no degrees north");
    for (int c = 0; c < 12; c++)
        g.east[c] = 10 + c;
    g.transposed = false;
    refused_grid(&g, "10 to 21 degrees east");
    g = good_grid(9, 12);
    g.rows = 7;
    refused_grid(&g, "pole to pole");
    g = good_grid(9, 12);
    g.east[5] = g.east[4];
    refused_grid(&g, "does not go on");
    g.east[5] = NAN;
    refused_grid(&g, "does not go on");
    g = good_grid(9, 12);
    for (int c = 0; c < 12; c++)
        g.east[c] = -g.east[c];
    refused_grid(&g, "not once around");
    for (int packed = 0; packed < 2; packed++) {
        g = good_grid(9, 12);
        g.packed = packed;
        g.metres[3][7] = MISSING;
        refused_grid(&g, "no height at row 3, column 7");
    }
    g = good_grid(9, 12);
    g.metres[3][7] = 1 << 30;
    refused_grid(&g, "relief");
}
END_TEST

START_TEST(files_that_are_no_grid) {
    mn_make_desc desc = desc_of(1);
    desc.etopo = NULL;
    refused(&desc, MN_USAGE, "--etopo");
    desc.etopo = "/nowhere/at/all.cdf";
    refused(&desc, MN_BAD_INPUT, "/nowhere/at/all.cdf");
    desc.etopo = "http://localhost/etopo5.cdf"; /* never asked for: a name of no file */
    refused(&desc, MN_BAD_INPUT, "No such file");
    desc.etopo = folder;
    refused(&desc, MN_BAD_INPUT, "not a file");
    desc.etopo = grid_path;
    FILE *f = fopen(grid_path, "wb");
    fclose(f);
    refused(&desc, MN_BAD_INPUT, "not a netCDF file");
    f = fopen(grid_path, "wb");
    fprintf(f, "ply\nformat ascii 1.0\n");
    fclose(f);
    refused(&desc, MN_BAD_INPUT, "not a netCDF file");
}
END_TEST

/* Cut anywhere: refused, or what is left says the same. */
START_TEST(cut_files) {
    grid g = good_grid(9, 12);
    mn_make_desc desc = desc_of(1);
    struct stat info;
    write_grid(grid_path, &g);
    ck_assert_int_eq(stat(grid_path, &info), 0);
    for (int cut = 4; cut < info.st_size; cut += cut < 40 ? 4 : 61) {
        g.cut_bytes = cut;
        write_grid(grid_path, &g);
        refused(&desc, MN_BAD_INPUT, grid_path);
    }
}
END_TEST

START_TEST(strides_that_leave_too_little) {
    const grid g = good_grid(9, 12);
    write_grid(grid_path, &g);
    mn_make_desc desc = desc_of(6);
    refused(&desc, MN_USAGE, "--stride");
    desc.stride = 1000000;
    refused(&desc, MN_USAGE, "--stride");
}
END_TEST

static bool stop_late(void *context, const char *phase, uint64_t done, uint64_t total) {
    if (strcmp(phase, "making") != 0) /* the helper is waited for */
        return true;
    ck_assert_uint_lt(done, total);
    return ++*(int *)context < 40; /* 33 rows, 32 bands: in the faces */
}

/* While the helper is at work. */
static bool stop_waiting(void *context, const char *phase, uint64_t done, uint64_t total) {
    (void)done, (void)total;
    *(bool *)context |= strcmp(phase, "netCDF") == 0;
    return strcmp(phase, "netCDF") != 0;
}

START_TEST(interrupted_while_its_helper_works) {
    const grid g = good_grid(33, 60);
    bool asked = false;
    mn_make_desc desc = desc_of(1);
    write_grid(grid_path, &g);
    desc.progress = stop_waiting;
    desc.progress_context = &asked;
    refused(&desc, MN_FAILED, "interrupted");
    ck_assert(asked);
}
END_TEST

START_TEST(interrupted_or_out_of_space) {
    const grid g = good_grid(33, 60);
    int calls = 0;
    mn_make_desc desc = desc_of(1);
    write_grid(grid_path, &g);
    desc.progress = stop_late;
    desc.progress_context = &calls;
    refused(&desc, MN_FAILED, "interrupted");
    calls = 30;
    refused(&desc, MN_FAILED, "interrupted"); /* in the heights */
    desc.progress = NULL;
    struct rlimit old, small;
    getrlimit(RLIMIT_FSIZE, &old);
    small = (struct rlimit){.rlim_cur = 20000, .rlim_max = old.rlim_max};
    signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &small);
    refused(&desc, MN_NO_SPACE, path);
    setrlimit(RLIMIT_FSIZE, &old);
}
END_TEST

START_TEST(without_its_helper) {
    const grid g = good_grid(9, 12);
    write_grid(grid_path, &g);
    mn_make_desc desc = desc_of(1);
    desc.helper_dir = "/nowhere";
    refused(&desc, MN_FAILED, "/nowhere/metanode-netcdf");
    refused(&desc, MN_FAILED, "libnetcdf-dev");
}
END_TEST

int main(void) {
    char helper[4096];
    const char *dir = getenv("METANODE_HELPER_DIR");
    snprintf(helper, sizeof helper, "%s/metanode-netcdf", dir != NULL ? dir : ".");
    bool there = access(helper, X_OK) == 0;
    if (mkdtemp(folder) == NULL)
        return 1;
    snprintf(grid_path, sizeof grid_path, "%s/grid.cdf", folder);
    snprintf(path, sizeof path, "%s/earth.ply", folder);
    Suite *suite = suite_create("make_earth");
    TCase *tc = tcase_create("make_earth");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, without_its_helper);
    if (there) {
        tcase_add_loop_test(tc, globes_are_closed, 0, 6);
        tcase_add_test(tc, heights_stand_where_they_belong);
        tcase_add_test(tc, one_globe_in_many_forms);
        tcase_add_test(tc, grids_without_poles);
        tcase_add_test(tc, exaggeration_is_a_factor);
        tcase_add_test(tc, grids_that_are_no_globe);
        tcase_add_test(tc, files_that_are_no_grid);
        tcase_add_test(tc, cut_files);
        tcase_add_test(tc, strides_that_leave_too_little);
        tcase_add_test(tc, interrupted_while_its_helper_works);
        tcase_add_test(tc, interrupted_or_out_of_space);
    }
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    unlink(grid_path);
    unlink(path);
    rmdir(folder);
    if (!there)
        printf("skipped: %s was not built (libnetcdf-dev)\n", helper);
    return failed != 0 ? failed : there ? 0 : 77;
}
