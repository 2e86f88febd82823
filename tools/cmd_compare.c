/* metanode compare: the distance between two meshes, or between two pictures. Thin over
 * mn_mesh_compare, and the module of pictures, which is loaded for them alone. */
#include "cli.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "gl_load.h"
#include "json.h"
#include "metanode/build.h"

static const char help[] =
    "usage: metanode compare A B [OPTION …]\n\n"
    "Of two meshes: distances in model units; points spread evenly by area over each, and the\n"
    "nearest point of the other.\n\n"
    "  --samples N   on each mesh; default 1000000\n"
    "  --seed S      other points; default 0\n"
    "  --weld W      join vertices at equal positions while reading; default on\n"
    "  --json        mean_ab, mean_ba, rms, max, samples, diagonal (of A's bounding box)\n\n"
    "Of two PNG pictures of one size: PSNR of red, green and blue, and SSIM of the luminance "
    "(Wang\n"
    "and others 2004: windows of 11 x 11, sigma 1.5).\n\n"
    "  --json        psnr_db (null: the same picture), ssim (null: under 11 pixels wide or high),\n"
    "                mean_square, difference_max (of 255), identical, width, height\n";

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
    printf("%" PRIu64 " sample%s on each; diagonal of A %.6g\n", r->samples, cli_s(r->samples),
           diagonal);
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

/* ---- pictures -------------------------------------------------------------------------------- */

/* By its first bytes, or by its name: a damaged one should be told as such. */
static bool is_picture(const char *path) {
    static const char signature[] = "\x89PNG\r\n\x1a\n";
    char head[sizeof signature - 1];
    const char *dot = strrchr(path, '.');
    struct stat info;
    if (dot != NULL && strcasecmp(dot, ".png") == 0)
        return true;
    if (stat(path, &info) != 0 || !S_ISREG(info.st_mode)) /* a fifo would be waited for */
        return false;
    FILE *f = fopen(path, "re");
    if (f == NULL)
        return false;
    const bool is =
        fread(head, 1, sizeof head, f) == sizeof head && memcmp(head, signature, sizeof head) == 0;
    fclose(f);
    return is;
}

static void report_pictures(const mn_likeness *l, uint32_t width, uint32_t height, bool as_json) {
    if (as_json) {
        json j;
        json_begin(&j, stdout);
        json_f64(&j, "psnr_db", l->psnr_db);
        json_f64(&j, "ssim", l->ssim);
        json_f64(&j, "mean_square", l->mean_square);
        json_u64(&j, "difference_max", l->difference_max);
        json_bool(&j, "identical", l->difference_max == 0);
        json_u64(&j, "width", width);
        json_u64(&j, "height", height);
        json_end(&j);
        return;
    }
    printf("%u x %u pixels%s\n", width, height, l->difference_max == 0 ? ", the same" : "");
    if (l->difference_max > 0)
        printf("PSNR         %.2f dB\n", l->psnr_db);
    if (!isnan(l->ssim))
        printf("SSIM         %.5f\n", l->ssim);
    printf("difference   %u of 255 at most\n", l->difference_max);
}

static int compare_pictures(char **file, bool as_json) {
    mn_status st = {0};
    gl_load load = {0};
    uint8_t *rgb[2] = {NULL, NULL};
    uint32_t width[2], height[2];
    mn_likeness likeness;
    mn_code code = gl_load_module(&load, &st);
    for (int i = 0; i < 2 && code == MN_OK; i++)
        code = load.api->png_read(file[i], &rgb[i], &width[i], &height[i], &st);
    if (code == MN_OK && (width[0] != width[1] || height[0] != height[1]))
        code = mn_fail(&st, MN_BAD_INPUT,
                       "compare: %s has %u x %u pixels and %s %u x %u: give pictures of one size",
                       file[0], width[0], height[0], file[1], width[1], height[1]);
    if (code == MN_OK)
        code = load.api->likeness(rgb[0], rgb[1], width[0], height[0], &likeness, &st);
    if (code == MN_OK)
        report_pictures(&likeness, width[0], height[0], as_json);
    free(rgb[1]);
    free(rgb[0]);
    return cli_status(&st);
}

int cmd_compare(int argc, char **argv) {
    uint64_t samples = 1000000, seed = 0;
    int weld = MN_WELD_ON;
    int of_meshes = 0; /* options given that pictures have no use for */
    bool as_json = false, done;
    cli_flag flags[] = {
        CLI_WHOLE("samples", &samples, 1, UINT64_C(1) << 40, "a number from 1 to 2^40"),
        CLI_WHOLE("seed", &seed, 0, UINT64_MAX, "a whole number"),
        CLI_CHOICE("weld", &weld, cli_on_off, "on or off"),
        CLI_SWITCH("json", &as_json),
        {0},
    };
    for (int i = 0; i < 3; i++)
        flags[i].given = &of_meshes;
    const mn_code code = cli_flags(argc, argv, flags, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (argc - optind != 2)
        return cli_error(MN_USAGE,
                         "compare: give two meshes or two pictures; see metanode compare --help");
    const bool picture[2] = {is_picture(argv[optind]), is_picture(argv[optind + 1])};
    if (picture[0] != picture[1])
        return cli_error(MN_BAD_INPUT,
                         "compare: %s is a picture and %s is none: give two meshes or two pictures",
                         argv[optind + picture[1]], argv[optind + picture[0]]);
    if (picture[0] && of_meshes > 0)
        return cli_error(MN_USAGE, "compare: --samples, --seed and --weld are for meshes");
    if (picture[0])
        return compare_pictures(argv + optind, as_json);
    cli_meter meter = {0};
    const mn_read_desc read = {
        .weld = (mn_weld)weld, .progress = cli_progress, .progress_context = &meter};
    return compare_meshes(argv + optind, &read, samples, seed, as_json);
}
