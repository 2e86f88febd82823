/* metanode-netcdf: the only place that links libnetcdf, a process of its own because that library
 * costs 8 MB before main and reads files from anywhere.
 *
 *   metanode-netcdf FILE STRIDE
 *
 * Finds the file's heights, the first variable of two dimensions that both have coordinates, and
 * writes every STRIDE-th column and row of it, the last row always, to standard output:
 *
 *   8 bytes "MNHEIGHT", u64 columns, u64 rows, columns × f64 degrees east, rising,
 *   rows × f64 degrees north, rising, rows × columns × f32 metres
 *
 * little-endian, nothing after it: the grid goes all around the globe and from pole to pole, its
 * first column is not repeated at the end and no height is missing. Any trouble is one line on
 * standard error, without the file's name, and exit 3. Memory: coordinates and one row. */
#include <inttypes.h>
#include <math.h>
#include <netcdf.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "classic.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define LIMIT_ADDRESS_SPACE 0 /* a sanitizer's shadow takes terabytes of it */
#else
#define LIMIT_ADDRESS_SPACE 1
#endif
#define ADDRESS_SPACE_MAX (UINT64_C(1) << 30) /* headers that claim much end here */
#define POINTS_MAX (UINT64_C(1) << 20)        /* along an axis: a second of arc is 1,296,000 */
#define BAD_INPUT 3

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the stream is the host's order");

typedef struct grid {
    const char *path;
    uint64_t bytes; /* of the file */
    int file, variable;
    char name[NC_MAX_NAME + 1];
    size_t rows, columns; /* in the file */
    double *north, *east; /* their coordinates, as the file has them */
    double scale, offset; /* of packed heights: metres = packed × scale + offset */
    double missing[2];    /* packed values that are none; NAN: no such */
} grid;

static void trouble(const char *format, ...) __attribute__((format(printf, 1, 2), noreturn));
static void trouble(const char *format, ...) {
    va_list args;
    va_start(args, format);
    vfprintf(stderr, format, args);
    va_end(args);
    fputc('\n', stderr);
    exit(BAD_INPUT);
}

static void must(int code, const char *what) {
    if (code != NC_NOERR)
        trouble("%s: %s", what, nc_strerror(code));
}

static void *must_have(size_t count, size_t size) {
    void *memory = calloc(count, size);
    if (memory == NULL)
        trouble("no memory for a row of %zu heights", count);
    return memory;
}

static void put(const void *bytes, size_t size, size_t count) {
    if (fwrite(bytes, size, count, stdout) != count)
        trouble("cannot write the heights to standard output");
}

/* A number that belongs to the variable; `none` where it has no such one. */
static double attribute(const grid *g, const char *name, double none) {
    double value;
    size_t length;
    if (nc_inq_attlen(g->file, g->variable, name, &length) != NC_NOERR || length != 1)
        return none;
    return nc_get_att_double(g->file, g->variable, name, &value) == NC_NOERR ? value : none;
}

/* The variable of coordinates along a dimension has the dimension's name. */
static bool has_coordinates(int file, int dimension, int *variable) {
    char name[NC_MAX_NAME + 1];
    int dimensions, its;
    return nc_inq_dimname(file, dimension, name) == NC_NOERR &&
           nc_inq_varid(file, name, variable) == NC_NOERR &&
           nc_inq_varndims(file, *variable, &dimensions) == NC_NOERR && dimensions == 1 &&
           nc_inq_vardimid(file, *variable, &its) == NC_NOERR && its == dimension;
}

static void must_be_whole(const grid *g, int variable) {
    uint64_t end = classic_end(g->path, variable);
    if (end == UINT64_MAX)
        trouble("its variables grow by records, or its header is damaged; give another grid");
    if (end > g->bytes)
        trouble("cut short: %" PRIu64 " bytes, where its header says %" PRIu64 " at least",
                g->bytes, end);
}

static double *read_axis(const grid *g, int dimension, int variable, size_t *points) {
    char name[NC_MAX_NAME + 1];
    must_be_whole(g, variable);
    must(nc_inq_dim(g->file, dimension, name, points), g->name);
    if (*points < 2 || *points > POINTS_MAX)
        trouble("%s has %zu points along %s; 2 to %" PRIu64 " can be read", g->name, *points, name,
                POINTS_MAX);
    double *at = must_have(*points, sizeof *at);
    must(nc_get_var_double(g->file, variable, at), name);
    double sign = at[1] > at[0] ? 1 : -1;
    for (size_t i = 0; i < *points; i++)
        if (!isfinite(at[i]) || (i > 0 && !(sign * (at[i] - at[i - 1]) > 0)))
            trouble("%s: coordinate %zu (%g) does not go on from the one before it", name, i,
                    at[i]);
    return at;
}

static void find_heights(grid *g) {
    int variables = 0, dimensions, along[2], axis[2] = {0};
    must(nc_inq_nvars(g->file, &variables), "variables");
    for (g->variable = 0; g->variable < variables; g->variable++)
        if (nc_inq_varndims(g->file, g->variable, &dimensions) == NC_NOERR && dimensions == 2 &&
            nc_inq_vardimid(g->file, g->variable, along) == NC_NOERR &&
            has_coordinates(g->file, along[0], &axis[0]) &&
            has_coordinates(g->file, along[1], &axis[1]))
            break;
    if (g->variable == variables)
        trouble("no variable of heights over latitude and longitude in it; give a grid such as "
                "ferret-datasets' etopo5.cdf");
    must(nc_inq_varname(g->file, g->variable, g->name), "name");
    must_be_whole(g, g->variable);
    g->north = read_axis(g, along[0], axis[0], &g->rows);
    g->east = read_axis(g, along[1], axis[1], &g->columns);
    g->scale = attribute(g, "scale_factor", 1);
    g->offset = attribute(g, "add_offset", 0);
    g->missing[0] = attribute(g, "_FillValue", NAN);
    g->missing[1] = attribute(g, "missing_value", NAN);
}

/* All around and from pole to pole, but for a step and a half; drops a last column that is the
 * first once more. */
static void check_globe(grid *g) {
    double first = g->north[0], last = g->north[g->rows - 1];
    double south = first < last ? first : last, north = first < last ? last : first;
    double step = (north - south) / (double)(g->rows - 1);
    if (south < -90.001 || north > 90.001)
        trouble("%s: its rows go from %g to %g, which are no degrees north", g->name, first, last);
    if (south > -90 + 1.5 * step || north < 90 - 1.5 * step)
        trouble("%s: its rows go from %g to %g degrees north, not from pole to pole", g->name,
                first, last);
    first = g->east[0];
    last = g->east[g->columns - 1];
    step = (last - first) / (double)(g->columns - 1);
    double gap = 360 - (last - first);
    if (step <= 0 || gap < -0.5 * step || gap > 1.5 * step)
        trouble("%s: its columns go from %g to %g degrees east, not once around", g->name, first,
                last);
    g->columns -= gap < 0.5 * step;
}

/* The file's number of the row that comes i-th from the south. */
static size_t row_from_south(const grid *g, size_t i) {
    return g->north[0] < g->north[1] ? i : g->rows - 1 - i;
}

static void put_row(const grid *g, size_t row, size_t stride, float *heights) {
    const size_t start[2] = {row, 0}, count[2] = {1, g->columns};
    size_t kept = 0;
    must(nc_get_vara_float(g->file, g->variable, start, count, heights), g->name);
    for (size_t c = 0; c < g->columns; c += stride) {
        double packed = heights[c];
        if (!isfinite(packed) || packed == (float)g->missing[0] || packed == (float)g->missing[1])
            trouble("%s: no height at row %zu, column %zu", g->name, row, c);
        heights[kept++] = (float)(packed * g->scale + g->offset);
    }
    put(heights, sizeof *heights, kept);
}

static void put_grid(const grid *g, size_t stride) {
    size_t rows = (g->rows - 1 + stride - 1) / stride + 1;
    const uint64_t counts[2] = {(g->columns + stride - 1) / stride, rows};
    float *heights = must_have(g->columns, sizeof *heights);
    put("MNHEIGHT", 1, 8);
    put(counts, sizeof counts, 1);
    for (size_t c = 0; c < g->columns; c += stride)
        put(&g->east[c], sizeof *g->east, 1);
    for (int pass = 0; pass < 2; pass++) /* coordinates, then heights */
        for (size_t i = 0; i < rows; i++) {
            size_t row = row_from_south(g, i + 1 < rows ? i * stride : g->rows - 1);
            if (pass == 0)
                put(&g->north[row], sizeof *g->north, 1);
            else
                put_row(g, row, stride, heights);
        }
    free(heights);
    if (fflush(stdout) != 0)
        trouble("cannot write the heights to standard output");
}

static void limit(int resource, uint64_t bytes) {
    const struct rlimit r = {bytes, bytes};
    setrlimit(resource, &r);
}

int main(int argc, char **argv) {
    char *end = NULL;
    size_t stride = argc == 3 ? strtoull(argv[2], &end, 10) : 0;
    if (stride < 1 || stride > POINTS_MAX || *end != 0)
        trouble("usage: metanode-netcdf FILE STRIDE");
    limit(RLIMIT_CORE, 0);
    if (LIMIT_ADDRESS_SPACE)
        limit(RLIMIT_AS, ADDRESS_SPACE_MAX);
    struct stat info;
    grid g = {.path = argv[1]};
    if (stat(g.path, &info) == 0)
        g.bytes = (uint64_t)info.st_size;
    int code = nc_open(argv[1], NC_NOWRITE, &g.file);
    if (code != NC_NOERR)
        trouble("not a netCDF file that can be read: %s", nc_strerror(code));
    find_heights(&g);
    check_globe(&g);
    put_grid(&g, stride);
    free(g.north);
    free(g.east);
    nc_close(g.file);
    return 0;
}
