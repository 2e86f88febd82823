/* metanode bench error: switch values against measured distances, at prefix fronts of the tree.
 * Thin over mn_simplify and mn_error_measure. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench.h"
#include "cli.h"
#include "json.h"
#include "metanode/build.h"

enum { FRONTS_MAX = 16 };

static const char help[] =
    "usage: metanode bench error FILE … [--fronts 50,10,1] [--samples N] [--seed S]\n"
    "                                   [--metric qem|length] [--json]\n\n"
    "Simplifies each mesh on the grid that build uses, and measures, at the fronts of a prefix of\n"
    "the order ids with so many percent of the triangles, how far the front is from points spread\n"
    "evenly over the input.\n\n"
    "honest   share of samples that are no further than their bound, the largest switch value of\n"
    "         the active nodes of their triangle's three leaves, + 1e-7 of the diagonal "
    "(positions\n"
    "         are floats); a node without triangles counts as its point. Wanted: 99.9 %\n"
    "excess   the largest measured / bound of the others\n"
    "ratio    of active nodes with 100 samples and a measured maximum above 1e-6 of the diagonal:\n"
    "         switch value / that maximum, as 10th percentile, median, 90th. A sample counts for\n"
    "         the active nodes of all three leaves (ratio), or of its nearest corner's alone "
    "(near).\n"
    "         Wanted: a median of at most 3\n\n"
    "  --samples N   on each mesh; default 1000000, or 120 an active node when that is more\n";

typedef struct options {
    double percent[FRONTS_MAX];
    int fronts;
    uint64_t samples, seed;
    mn_metric metric;
    bool as_json;
} options;

static void report_ratio(json *j, const char *key, const mn_error_ratio *r) {
    json_open(j, key, '{');
    json_u64(j, "nodes", r->nodes);
    json_f64(j, "p10", r->p10);
    json_f64(j, "median", r->median);
    json_f64(j, "p90", r->p90);
    json_close(j, '}');
}

static void print_ratio(const mn_error_ratio *r) {
    char text[3][32];
    printf("  %s %s %s of %-6" PRIu64, bench_number(r->p10, 5, 2, text[0]),
           bench_number(r->median, 5, 2, text[1]), bench_number(r->p90, 5, 2, text[2]), r->nodes);
}

static void report(json *j, double percent, const mn_error_result *r, const options *o) {
    double honest = 1 - (double)r->dishonest / (double)r->samples, d = r->diagonal;
    if (!o->as_json) {
        printf("%5g %% %9" PRIu64 " %9.4f %% %7.3g", percent, r->triangles, 100 * honest,
               r->excess_max);
        print_ratio(&r->ratio);
        print_ratio(&r->near);
        printf("  %9.3g %9.3g %9.3g %9.3g\n", r->bound_mean / d, r->bound_max / d,
               r->measured_mean / d, r->measured_max / d);
        return;
    }
    json_open(j, NULL, '{');
    json_f64(j, "percent", percent);
    json_u64(j, "triangles", r->triangles);
    json_u64(j, "active_nodes", r->nodes);
    json_u64(j, "samples", r->samples);
    json_u64(j, "dishonest_samples", r->dishonest);
    json_f64(j, "honest_share", honest);
    json_f64(j, "excess_max", r->excess_max);
    report_ratio(j, "ratio", &r->ratio);
    report_ratio(j, "near", &r->near);
    json_f64(j, "bound_mean", r->bound_mean);
    json_f64(j, "bound_max", r->bound_max);
    json_f64(j, "measured_mean", r->measured_mean);
    json_f64(j, "measured_max", r->measured_max);
    json_f64(j, "diagonal", r->diagonal);
    json_close(j, '}');
}

static mn_code bench_tree(const mn_tree *tree, const options *o, json *j, cli_meter *meter,
                          mn_status *st) {
    mn_code code = MN_OK;
    for (int i = 0; i < o->fronts && code == MN_OK; i++) {
        mn_error_result result;
        uint64_t triangles = (uint64_t)(o->percent[i] / 100 * tree->triangles + 0.5);
        code =
            mn_error_measure(tree, triangles, o->samples, o->seed, CLI_WATCH(meter), &result, st);
        cli_progress_end(meter);
        if (code == MN_OK)
            report(j, o->percent[i], &result, o);
    }
    return code;
}

static mn_code bench_file(const char *path, const options *o, json *j, mn_status *st) {
    cli_meter meter = {0};
    mn_mesh mesh;
    mn_tree tree;
    mn_read_desc read = {.progress = cli_progress, .progress_context = &meter};
    mn_simplify_desc simplify = {
        .metric = o->metric, .progress = cli_progress, .progress_context = &meter};
    if (mn_mesh_read(path, &read, &mesh, st) != MN_OK)
        return st->code;
    mn_code code = mn_mesh_quantise(&mesh, 0, st); /* as build does */
    if (code == MN_OK)
        code = mn_simplify(&mesh, &simplify, &tree, st);
    mn_mesh_free(&mesh);
    cli_progress_end(&meter);
    if (code != MN_OK)
        return code;
    if (o->as_json) {
        json_open(j, NULL, '{');
        json_str(j, "file", path);
        json_u64(j, "triangles", tree.triangles);
        json_u64(j, "vertices", tree.leaves);
        json_f64(j, "seconds_simplify", tree.counts.seconds_simplify);
        json_f64(j, "grid_error", (double)mn_grid_error(tree.grid_step));
        json_open(j, "fronts", '[');
    } else {
        printf("%s: %u triangle%s, on a grid of %g: the input as it was is off by up to %g more\n"
               "  distances in diagonals\n"
               "  front triangles      honest  excess    ratio: p10, median, p90       "
               "near: p10, median, p90     bound mean       max  measured       max\n",
               path, tree.triangles, cli_s(tree.triangles), (double)tree.grid_step,
               (double)mn_grid_error(tree.grid_step));
    }
    code = bench_tree(&tree, o, j, &meter, st);
    if (o->as_json) {
        json_close(j, ']');
        json_close(j, '}');
    }
    mn_tree_free(&tree);
    return code;
}

static bool parse_fronts(const char *text, options *o) {
    char *end = NULL;
    for (o->fronts = 0; o->fronts < FRONTS_MAX; text = end + 1) {
        double percent = strtod(text, &end);
        if (end == text || !(percent >= 0 && percent <= 100))
            return false;
        o->percent[o->fronts++] = percent;
        if (*end == 0)
            return true;
        if (*end != ',')
            return false;
    }
    return false;
}

/* -1: help was printed. */
static int parse(int argc, char **argv, options *o) {
    static const char *const metrics[] = {"qem", "length", NULL};
    const char *fronts = NULL;
    int metric = 0;
    bool done;
    const cli_flag flags[] = {
        CLI_TEXT("fronts", &fronts),
        CLI_WHOLE("samples", &o->samples, 1, UINT64_C(1) << 40, "a number from 1 to 2^40"),
        CLI_WHOLE("seed", &o->seed, 0, UINT64_MAX, "a whole number"),
        CLI_CHOICE("metric", &metric, metrics, "qem or length"),
        CLI_SWITCH("json", &o->as_json),
        {0},
    };
    const mn_code code = cli_flags(argc, argv, flags, help, &done);
    if (code != MN_OK || done)
        return done ? -1 : (int)code;
    o->metric = (mn_metric)metric;
    if (fronts != NULL && !parse_fronts(fronts, o))
        return cli_error(MN_USAGE, "bench error: --fronts '%s' is not a list like 50,10,1", fronts);
    if (optind == argc)
        return cli_error(MN_USAGE, "bench error: which FILE? see metanode bench error --help");
    return MN_OK;
}

int bench_error(int argc, char **argv) {
    options o = {.percent = {50, 10, 1}, .fronts = 3};
    int code = parse(argc, argv, &o);
    if (code != MN_OK)
        return code < 0 ? MN_OK : code;
    json j;
    mn_status st = {0};
    if (bench_meshes_are_there(argv + optind, argc - optind, &st) != MN_OK)
        return cli_status(&st);
    if (o.as_json) {
        json_begin(&j, stdout);
        json_open(&j, "files", '[');
    }
    for (int i = optind; i < argc && st.code == MN_OK; i++)
        bench_file(argv[i], &o, &j, &st);
    if (o.as_json) {
        json_close(&j, ']');
        json_end(&j);
    }
    return cli_status(&st);
}
