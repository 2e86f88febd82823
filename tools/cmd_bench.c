/* metanode bench: the table of measurements, and what they share. */
#define _GNU_SOURCE
#include "bench.h"

#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "metanode/build.h"
#include "metanode/format.h"

/* In the order of --help. A measurement adds itself here and to meson.build. */
static const cli_command benches[] = {
    {"adapt", bench_adapt, "triangles that one core makes and removes a second, all resident"},
    {"draw", bench_draw, "bytes and time to hand fronts to the driver, along a path"},
    {"error", bench_error, "how honest and tight the switch values of a model's tree are"},
    {"simplify", bench_simplify, "collapses a second and quality, against OpenMesh"},
    {NULL, NULL, NULL},
};

mn_code bench_trees_are_there(char **files, int count, mn_status *st) {
    mn_header header;
    for (int i = 0; i < count && st->code == MN_OK; i++)
        mn_header_read(files[i], &header, st);
    return st->code;
}

mn_code bench_meshes_are_there(char **files, int count, mn_status *st) {
    uint64_t vertices, triangles;
    for (int i = 0; i < count && st->code == MN_OK; i++)
        mn_mesh_expect(files[i], &vertices, &triangles, st);
    return st->code;
}

const char *bench_number(double value, int width, int digits, char text[32]) {
    if (isfinite(value))
        snprintf(text, 32, "%*.*f", width, digits, value);
    else
        snprintf(text, 32, "%*s", width, "-");
    return text;
}

void bench_one_core(void) {
    cpu_set_t here;
    int cpu = sched_getcpu();
    CPU_ZERO(&here);
    CPU_SET((size_t)(cpu < 0 ? 0 : cpu), &here);
    if (sched_setaffinity(0, sizeof here, &here) != 0)
        fputs("metanode: bench: cannot bind to one core; timings vary more\n", stderr);
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double bench_median(double *values, size_t count) {
    qsort(values, count, sizeof values[0], by_value);
    return count % 2 == 1 ? values[count / 2] : (values[count / 2 - 1] + values[count / 2]) / 2;
}

static void usage(FILE *out) {
    fputs("usage: metanode bench NAME [OPTION …]     metanode bench NAME --help\n\n", out);
    for (const cli_command *b = benches; b->name != NULL; b++)
        fprintf(out, "  %-10s %s\n", b->name, b->does);
}

int cmd_bench(int argc, char **argv) {
    if (argc < 2) {
        usage(stderr);
        return MN_USAGE;
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        usage(stdout);
        return MN_OK;
    }
    static char name[32]; /* as it is typed, in the lines that name a --help */
    for (const cli_command *b = benches; b->name != NULL; b++)
        if (strcmp(argv[1], b->name) == 0) {
            snprintf(name, sizeof name, "bench %s", b->name);
            argv[1] = name;
            return b->run(argc - 1, argv + 1);
        }
    return cli_error(MN_USAGE, "no bench '%s'; metanode bench --help lists them", argv[1]);
}
