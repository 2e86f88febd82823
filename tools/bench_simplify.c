/* metanode bench simplify: our simplification against OpenMesh's quadric decimater.
 *
 * Speed: from full detail to 1 % of the triangles, reading excluded, on one core, each system in a
 * run of its own, alternating; the figure is the median of the pairs' ratios of collapses a second
 * of the processor's time, which other programs on the machine disturb less than the clock's.
 * Quality: at 50, 10 and 1 % of the triangles, the mean of the mean distances both ways to the
 * input, for the prefix of our collapses and for OpenMesh's mesh with as many triangles. */
#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "cli.h"
#include "json.h"
#include "metanode/build.h"

enum { RUNS_MAX = 99, LEVELS = 3 };

static const double percents[LEVELS] = {50, 10, 1};
static const double speed_percent = 1;

static const char help[] =
    "usage: metanode bench simplify [IN …] [--globe N] [--runs 5] [--samples 1M] [--json]\n\n"
    "  --globe N      also a globe whose poles have N neighbours\n"
    "  --runs N       pairs of runs, ours and OpenMesh's in turn; 0: no timing\n"
    "  --samples N    points a side for the distances; 0: no distances\n"
    "  --metric M     of ours: qem (default) or length\n"
    "  --json         figures as one object\n";

typedef struct options {
    uint64_t runs, samples, globe;
    mn_metric metric;
    bool json;
    const char *name;  /* of the mesh at hand */
    const char *phase; /* what is measured; NULL: as the library calls what it does */
    cli_meter *meter;  /* on a terminal: how far it is */
} options;

typedef struct quality {
    uint32_t triangles, openmesh_triangles;
    double distance, openmesh_distance;
} quality;

typedef struct figures {
    const char *name;
    uint32_t vertices, triangles;
    double rate, openmesh_rate; /* collapses a second, medians */
    double ratio;               /* median of the pairs' ratios */
    double ratios[RUNS_MAX];
    quality level[LEVELS];
} figures;

/* An mn_progress: the same, by the name of what is measured. */
static bool progress(void *context, const char *phase, uint64_t done, uint64_t total) {
    const options *o = context;
    return cli_progress(o->meter, o->phase != NULL ? o->phase : phase, done, total);
}

static mn_code decimate(const mn_mesh *mesh, uint32_t triangles, const options *o, mn_mesh *out,
                        mn_decimation *d, mn_status *st) {
    mn_status own = {0};
    const mn_code code = mn_openmesh_decimate(mesh, triangles, NULL, out, d, &own);
    if (code == MN_BAD_INPUT)
        return mn_fail(st, code,
                       "%s: OpenMesh, which this compares with, does not take it: %s; give another "
                       "mesh",
                       o->name, own.text);
    return code == MN_OK ? MN_OK : mn_fail(st, code, "%s: %s", o->name, own.text);
}

/* ---- speed ---- */

static uint32_t share(const mn_mesh *mesh, double percent) {
    return (uint32_t)(mesh->triangles * percent / 100);
}

static mn_code our_rate(const mn_mesh *mesh, const options *o, double *rate, mn_status *st) {
    mn_tree tree;
    mn_simplify_desc desc = {.metric = o->metric,
                             .stop_triangles = share(mesh, speed_percent),
                             .progress = cli_progress,
                             .progress_context = o->meter};
    double start_s = cli_seconds(CLOCK_PROCESS_CPUTIME_ID);
    mn_code code = mn_simplify(mesh, &desc, &tree, st);
    double seconds = cli_seconds(CLOCK_PROCESS_CPUTIME_ID) - start_s;
    if (code != MN_OK)
        return code;
    uint64_t collapses = 0;
    for (int i = 0; i < 4; i++)
        collapses += tree.counts.collapses_by_stage[i];
    *rate = (double)collapses / seconds;
    mn_tree_free(&tree);
    return MN_OK;
}

static mn_code openmesh_rate(const mn_mesh *mesh, const options *o, double *rate, mn_status *st) {
    mn_mesh out;
    mn_decimation d;
    mn_code code = decimate(mesh, share(mesh, speed_percent), o, &out, &d, st);
    if (code != MN_OK)
        return code;
    *rate = (double)d.collapses / d.seconds;
    mn_mesh_free(&out);
    return MN_OK;
}

static mn_code measure_speed(const mn_mesh *mesh, const options *o, figures *f, mn_status *st) {
    double ours[RUNS_MAX], theirs[RUNS_MAX], ratios[RUNS_MAX];
    for (uint64_t i = 0; i < o->runs; i++) {
        mn_code code = our_rate(mesh, o, &ours[i], st);
        cli_progress(o->meter, "openmesh", i, o->runs);
        if (code == MN_OK)
            code = openmesh_rate(mesh, o, &theirs[i], st);
        if (code != MN_OK)
            return code;
        f->ratios[i] = ratios[i] = ours[i] / theirs[i];
    }
    if (o->runs > 0) {
        f->rate = bench_median(ours, o->runs);
        f->openmesh_rate = bench_median(theirs, o->runs);
        f->ratio = bench_median(ratios, o->runs);
    }
    return MN_OK;
}

/* ---- quality ---- */

static mn_code distance(const mn_mesh *mesh, const mn_mesh *coarse, options *o, const char *phase,
                        double *mean, mn_status *st) {
    mn_compare_result r;
    o->phase = phase;
    const mn_watch watch = {progress, o};
    mn_code code = mn_mesh_compare(mesh, coarse, o->samples, 1, &watch, &r, st);
    o->phase = NULL;
    *mean = code == MN_OK ? (r.mean_ab + r.mean_ba) / 2 : 0;
    return code;
}

/* Both at the number of triangles that OpenMesh stopped at. */
static mn_code measure_level(const mn_mesh *mesh, const mn_tree *tree, int level, options *o,
                             quality *q, mn_status *st) {
    static const char *const phases[LEVELS][2] = {{"OpenMesh at 50 %", "ours at 50 %"},
                                                  {"OpenMesh at 10 %", "ours at 10 %"},
                                                  {"OpenMesh at 1 %", "ours at 1 %"}};
    mn_mesh theirs, ours;
    mn_decimation d;
    mn_code code = decimate(mesh, share(mesh, percents[level]), o, &theirs, &d, st);
    if (code != MN_OK)
        return code;
    q->openmesh_triangles = theirs.triangles;
    code = distance(mesh, &theirs, o, phases[level][0], &q->openmesh_distance, st);
    mn_extract_desc desc = {.what = MN_EXTRACT_TRIANGLES, .triangles = theirs.triangles};
    mn_mesh_free(&theirs);
    if (code != MN_OK)
        return code;
    code = mn_tree_extract(tree, &desc, &ours, NULL, st);
    if (code != MN_OK)
        return code;
    q->triangles = ours.triangles;
    code = distance(mesh, &ours, o, phases[level][1], &q->distance, st);
    mn_mesh_free(&ours);
    return code;
}

static mn_code measure_quality(const mn_mesh *mesh, options *o, figures *f, mn_status *st) {
    mn_tree tree;
    mn_simplify_desc desc = {
        .metric = o->metric, .progress = cli_progress, .progress_context = o->meter};
    if (o->samples == 0)
        return MN_OK;
    mn_code code = mn_simplify(mesh, &desc, &tree, st);
    if (code != MN_OK)
        return code;
    for (int i = 0; i < LEVELS && code == MN_OK; i++)
        code = measure_level(mesh, &tree, i, o, &f->level[i], st);
    mn_tree_free(&tree);
    return code;
}

/* ---- the globe ---- */

/* A unit sphere of n meridians and n / 2 parallels, each pole one vertex with n neighbours, with
 * relief enough that no two candidates cost the same. */
static mn_code make_globe(uint32_t n, mn_mesh *out, mn_status *st) {
    uint32_t rows = n / 2, v = 2, c = 0;
    *out = (mn_mesh){.vertices = rows * n + 2, .triangles = 2 * rows * n};
    out->position = malloc((size_t)out->vertices * 3 * sizeof(float));
    out->corner = malloc((size_t)out->triangles * 3 * sizeof(uint32_t));
    if (out->position == NULL || out->corner == NULL) {
        mn_mesh_free(out);
        return mn_fail(st, MN_FAILED, "no memory for a globe with poles of %u neighbours", n);
    }
    memcpy(out->position, (const float[6]){0, 0, 1, 0, 0, -1}, 6 * sizeof(float));
    for (uint32_t row = 0; row < rows; row++)
        for (uint32_t i = 0; i < n; i++, v++) {
            double polar = M_PI * (row + 1) / (rows + 1), around = 2 * M_PI * i / n;
            double x = sin(polar) * cos(around), y = sin(polar) * sin(around), z = cos(polar);
            double r = 1 + 0.01 * sin(17 * x + 3) * sin(23 * y + 1) * sin(19 * z + 2);
            float *p = &out->position[3 * (size_t)v];
            p[0] = (float)(r * x), p[1] = (float)(r * y), p[2] = (float)(r * z);
        }
    for (uint32_t row = 0; row + 1 < rows; row++)
        for (uint32_t i = 0; i < n; i++) {
            uint32_t a = 2 + row * n + i, b = 2 + row * n + (i + 1) % n;
            const uint32_t two[6] = {a, a + n, b, b, a + n, b + n};
            memcpy(&out->corner[c], two, sizeof two);
            c += 6;
        }
    for (uint32_t i = 0, last = 2 + (rows - 1) * n; i < n; i++) {
        const uint32_t caps[6] = {0, 2 + i, 2 + (i + 1) % n, 1, last + (i + 1) % n, last + i};
        memcpy(&out->corner[c], caps, sizeof caps);
        c += 6;
    }
    return MN_OK;
}

/* ---- report ---- */

/* Of a mesh that OpenMesh leaves as it is there is none. */
static const char *ratio_text(double ratio, int digits, char text[32]) {
    snprintf(text, 32, isfinite(ratio) ? "%.*f" : "none", digits, ratio);
    return text;
}

static void print_table(const figures *f, const options *o) {
    char ratio[32];
    printf("%s: %u vertices, %u triangle%s\n", f->name, f->vertices, f->triangles,
           cli_s(f->triangles));
    if (o->runs > 0)
        printf(
            "  to 1 %%        %10.0f collapses/s   OpenMesh %10.0f   ratio %s (median of %llu)\n",
            f->rate, f->openmesh_rate, ratio_text(f->ratio, 2, ratio), (unsigned long long)o->runs);
    for (int i = 0; i < LEVELS && o->samples > 0; i++) {
        const quality *q = &f->level[i];
        printf("  at %4.0f %%     %10u triangles     OpenMesh %10u\n"
               "                %10.3g distance      OpenMesh %10.3g   ratio %s\n",
               percents[i], q->triangles, q->openmesh_triangles, q->distance, q->openmesh_distance,
               ratio_text(q->distance / q->openmesh_distance, 3, ratio));
    }
    fflush(stdout);
}

static void print_json(json *j, const figures *f, const options *o) {
    json_open(j, NULL, '{');
    json_str(j, "input", f->name);
    json_u64(j, "vertices", f->vertices);
    json_u64(j, "triangles", f->triangles);
    if (o->runs > 0) {
        json_f64(j, "collapses_per_second", f->rate);
        json_f64(j, "openmesh_collapses_per_second", f->openmesh_rate);
        json_f64(j, "ratio", f->ratio);
        json_open(j, "ratios", '[');
        for (uint64_t i = 0; i < o->runs; i++)
            json_f64(j, NULL, f->ratios[i]);
        json_close(j, ']');
    }
    json_open(j, "quality", '[');
    for (int i = 0; i < LEVELS && o->samples > 0; i++) {
        const quality *q = &f->level[i];
        json_open(j, NULL, '{');
        json_f64(j, "percent", percents[i]);
        json_u64(j, "triangles", q->triangles);
        json_u64(j, "openmesh_triangles", q->openmesh_triangles);
        json_f64(j, "distance", q->distance);
        json_f64(j, "openmesh_distance", q->openmesh_distance);
        json_f64(j, "ratio", q->distance / q->openmesh_distance);
        json_close(j, '}');
    }
    json_close(j, ']');
    json_close(j, '}');
}

static mn_code measure(const char *path, options *o, figures *f, mn_status *st) {
    mn_mesh mesh;
    o->name = path != NULL ? path : "globe";
    mn_read_desc read = {.progress = cli_progress, .progress_context = o->meter};
    mn_code code = path != NULL ? mn_mesh_read(path, &read, &mesh, st)
                                : make_globe((uint32_t)o->globe, &mesh, st);
    if (code != MN_OK) {
        cli_progress_end(o->meter);
        return code;
    }
    *f = (figures){.name = o->name, .vertices = mesh.vertices, .triangles = mesh.triangles};
    code = measure_speed(&mesh, o, f, st);
    if (code == MN_OK)
        code = measure_quality(&mesh, o, f, st);
    cli_progress_end(o->meter);
    mn_mesh_free(&mesh);
    return code;
}

/* paths end with NULL, which stands for the globe, if there is one. */
static int report(char **paths, int count, options *o) {
    json j;
    mn_status st = {0};
    if (bench_meshes_are_there(paths, count, &st) != MN_OK)
        return cli_status(&st);
    bench_one_core();
    if (o->json) {
        json_begin(&j, stdout);
        json_str(&j, "metric", o->metric == MN_METRIC_QEM ? "qem" : "length");
        json_u64(&j, "runs", o->runs);
        json_u64(&j, "samples", o->samples);
        json_open(&j, "inputs", '[');
    }
    for (int i = 0; i < count + (o->globe > 0) && st.code == MN_OK; i++) {
        figures f;
        if (measure(i < count ? paths[i] : NULL, o, &f, &st) != MN_OK)
            break;
        if (o->json)
            print_json(&j, &f, o);
        else
            print_table(&f, o);
    }
    if (o->json) {
        json_close(&j, ']');
        json_end(&j);
    }
    return cli_status(&st);
}

static mn_code read_options(options *o, int argc, char **argv, bool *done) {
    static const char *const metrics[] = {"qem", "length", NULL}; /* by mn_metric */
    const char *samples = NULL;
    int metric = 0;
    const cli_flag flags[] = {
        CLI_WHOLE("globe", &o->globe, 8, 20000, "in 8 … 20000"),
        CLI_WHOLE("runs", &o->runs, 0, RUNS_MAX, "in 0 … 99"),
        CLI_TEXT("samples", &samples),
        CLI_CHOICE("metric", &metric, metrics, "qem or length"),
        CLI_SWITCH("json", &o->json),
        {0},
    };
    const mn_code code = cli_flags(argc, argv, flags, help, done);
    if (code != MN_OK || *done)
        return code;
    o->metric = (mn_metric)metric;
    if (samples != NULL && strcmp(samples, "0") == 0)
        o->samples = 0;
    else if (samples != NULL && !cli_size(samples, &o->samples))
        return (mn_code)cli_error(
            MN_USAGE, "bench simplify: --samples '%s' is not a number like 1M", samples);
    if (optind >= argc && o->globe == 0)
        return (mn_code)cli_error(
            MN_USAGE,
            "bench simplify: which FILE? (or --globe N) see metanode bench simplify --help");
    if (o->runs == 0 && o->samples == 0)
        return (mn_code)cli_error(
            MN_USAGE, "bench simplify: --runs 0 and --samples 0: nothing is left to measure");
    return MN_OK;
}

int bench_simplify(int argc, char **argv) {
    options o = {.runs = 5, .samples = 1 << 20};
    cli_meter meter = {0};
    bool done = false;
    const mn_code code = read_options(&o, argc, argv, &done);
    if (code != MN_OK || done)
        return (int)code;
    o.meter = &meter;
    return report(argv + optind, argc - optind, &o);
}
