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
    enum { SAMPLES = 256, SEED, WELD, JSON };
    static const struct option options[] = {{"samples", required_argument, NULL, SAMPLES},
                                            {"seed", required_argument, NULL, SEED},
                                            {"weld", required_argument, NULL, WELD},
                                            {"json", no_argument, NULL, JSON},
                                            {"help", no_argument, NULL, 'h'},
                                            {0}};
    static const char *const on_off[] = {"on", "off", NULL};
    uint64_t samples = 1000000, seed = 0;
    cli_meter meter = {0};
    mn_read_desc read = {.progress = cli_progress, .progress_context = &meter};
    bool as_json = false;
    int option, weld;
    while ((option = cli_option(argc, argv, "h", options)) != -1) {
        switch (option) {
        case SAMPLES:
            if (!cli_u64(optarg, 1, UINT64_C(1) << 40, &samples))
                return cli_error(MN_USAGE, "compare: --samples '%s' is no number from 1 to 2^40",
                                 optarg);
            break;
        case SEED:
            if (!cli_u64(optarg, 0, UINT64_MAX, &seed))
                return cli_error(MN_USAGE, "compare: --seed '%s' is no whole number", optarg);
            break;
        case WELD:
            if ((weld = cli_choice(optarg, on_off)) < 0)
                return cli_error(MN_USAGE, "compare: --weld '%s' is neither on nor off", optarg);
            read.weld = (mn_weld)weld;
            break;
        case JSON:
            as_json = true;
            break;
        case 'h':
            fputs(help, stdout);
            return MN_OK;
        default:
            return MN_USAGE;
        }
    }
    if (argc - optind != 2)
        return cli_error(MN_USAGE, "compare: give two meshes; see metanode compare --help");
    return compare_meshes(argv + optind, &read, samples, seed, as_json);
}
