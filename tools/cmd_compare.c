/* metanode compare: the distance between two meshes. Thin over mn_mesh_compare. */
#include "cli.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>

#include "json.h"
#include "metanode/build.h"

static const char help[] =
    "usage: metanode compare A B [--samples N] [--seed S] [--weld on|off] [--json]\n\n"
    "Distances between two meshes, in model units: points spread evenly by area over each, and "
    "the\n"
    "nearest point of the other.\n\n"
    "  --samples N   on each mesh; default 1000000\n"
    "  --seed S      other points; default 0\n"
    "  --weld W      join vertices at equal positions while reading; default on\n"
    "  --json        mean_ab, mean_ba, rms, max, samples, diagonal (of A's bounding box)\n";

static double diagonal_of(const mn_mesh *m) {
    double sum = 0;
    for (int a = 0; a < 3; a++) {
        float low = m->position[a], high = low;
        for (uint64_t v = 1; v < m->vertices; v++) {
            float x = m->position[3 * v + (uint64_t)a];
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
        sum += ((double)high - low) * ((double)high - low);
    }
    return sqrt(sum);
}

static void report(const mn_compare_result *r, double diagonal, bool as_json) {
    if (as_json) {
        json j;
        json_begin(&j, stdout);
        json_f64(&j, "mean_ab", r->mean_ab);
        json_f64(&j, "mean_ba", r->mean_ba);
        json_f64(&j, "rms", r->rms);
        json_f64(&j, "max", r->max);
        json_u64(&j, "samples", r->samples);
        json_f64(&j, "diagonal", diagonal);
        json_end(&j);
        return;
    }
    const struct {
        const char *name;
        double value;
    } row[] = {
        {"mean A to B", r->mean_ab}, {"mean B to A", r->mean_ba}, {"rms", r->rms}, {"max", r->max}};
    printf("%" PRIu64 " samples on each; diagonal of A %.6g\n", r->samples, diagonal);
    for (size_t i = 0; i < sizeof row / sizeof row[0]; i++)
        printf("%-12s %-12.6g %.4g %% of the diagonal\n", row[i].name, row[i].value,
               100 * row[i].value / diagonal);
}

static int compare_meshes(char **file, const mn_read_desc *read, uint64_t samples, uint64_t seed,
                          bool as_json) {
    mn_mesh mesh[2] = {0};
    mn_status st = {0};
    mn_compare_result result;
    mn_code code = mn_mesh_read(file[0], read, &mesh[0], &st);
    if (code == MN_OK)
        code = mn_mesh_read(file[1], read, &mesh[1], &st);
    if (code == MN_OK)
        code = mn_mesh_compare(&mesh[0], &mesh[1], samples, seed, CLI_WATCH(read->progress_context),
                               &result, &st);
    cli_progress_end(read->progress_context);
    if (code == MN_OK)
        report(&result, diagonal_of(&mesh[0]), as_json);
    mn_mesh_free(&mesh[1]);
    mn_mesh_free(&mesh[0]);
    return cli_status(&st);
}

int cmd_compare(int argc, char **argv) {
    uint64_t samples = 1000000, seed = 0;
    int weld = MN_WELD_ON;
    bool as_json = false, done;
    const cli_flag flags[] = {
        CLI_WHOLE("samples", &samples, 1, UINT64_C(1) << 40, "a number from 1 to 2^40"),
        CLI_WHOLE("seed", &seed, 0, UINT64_MAX, "a whole number"),
        CLI_CHOICE("weld", &weld, cli_on_off, "on or off"),
        CLI_SWITCH("json", &as_json),
        {0},
    };
    const mn_code code = cli_flags(argc, argv, flags, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (argc - optind != 2)
        return cli_error(MN_USAGE, "compare: give two meshes; see metanode compare --help");
    cli_meter meter = {0};
    const mn_read_desc read = {
        .weld = (mn_weld)weld, .progress = cli_progress, .progress_context = &meter};
    return compare_meshes(argv + optind, &read, samples, seed, as_json);
}
