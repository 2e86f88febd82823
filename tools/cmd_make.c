/* metanode make: models of any size. Thin over mn_make. */
#include "cli.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "metanode/build.h"

/* Where Debian's ferret-datasets has it: every 5 minutes of arc. */
#define ETOPO "/usr/share/ferret-vis/data/etopo5.cdf"

static const char help[] =
    "usage: metanode make SHAPE -o OUT.ply [--triangles N] [--seed S]\n"
    "       metanode make earth -o OUT.ply [--etopo FILE.cdf] [--stride N] [--exaggeration X]\n"
    "       metanode make subdivide IN --times N -o OUT.ply\n\n"
    "  sphere      a rocky planetoid: closed, genus 0, craters and ridges of every size\n"
    "  terrain     mountains: an open height field, about square\n"
    "  isosurface  a sponge of rock: closed, some crumbs, genus from 20 to above 1000\n"
    "  earth       the globe with its relief, closed, from a netCDF grid of heights; with that of\n"
    "              Debian's ferret-datasets 18,653,760 triangles\n"
    "  subdivide   of a manifold mesh IN: Loop's scheme, four triangles for one, N times\n"
    "\n"
    "  -o FILE         the model, binary PLY with colours; streamed, whatever its size\n"
    "  --triangles N   about so many (5000000 or 5M): sphere within 4 × √N, terrain within √N,\n"
    "                  isosurface within 5 % from 10,000 on, and no fewer than 2,000; default "
    "100000\n"
    "  --seed S        another model of the same kind; default 0. Same options, same bytes\n"
    "  --etopo FILE    earth: heights in metres over latitude and longitude, from pole to pole;\n"
    "                  default " ETOPO "\n"
    "  --stride N      earth: every Nth row and column; default 1\n"
    "  --exaggeration X   earth: of the heights; default 20\n";

/* By mn_shape. */
static const char *const shape_names[] = {"sphere", "terrain", "isosurface", "earth", NULL};

static int make_subdivide(int argc, char **argv, uint64_t times, const char *out) {
    mn_mesh in, fine;
    mn_read_desc read = {0};
    mn_status st = {0};
    if (argc != 2)
        return cli_error(MN_USAGE, "make subdivide: give one mesh file to subdivide");
    if (times == 0)
        return cli_error(MN_USAGE, "make subdivide: how often? give --times N");
    if (cli_output("make subdivide", out, argv[1]) != MN_OK)
        return MN_USAGE;
    if (mn_mesh_read(argv[1], &read, &in, &st) != MN_OK)
        return cli_status(&st);
    mn_code code = mn_openmesh_subdivide(&in, (uint32_t)times, NULL, &fine, &st);
    mn_mesh_free(&in);
    if (code != MN_OK)
        return cli_error(code, "%s: %s", argv[1], st.text);
    mn_mesh_write_ply(out, &fine, &st);
    mn_mesh_free(&fine);
    return cli_status(&st);
}

/* Options that one shape has and another has not. */
static mn_code check_shape(mn_make_desc *desc, const char *out) {
    bool earth = desc->shape == MN_SHAPE_EARTH;
    const char *name = shape_names[desc->shape];
    if (!earth && (desc->etopo != NULL || desc->stride != 0 || desc->exaggeration != 0))
        return (mn_code)cli_error(
            MN_USAGE, "make %s: --etopo, --stride and --exaggeration are for the earth", name);
    if (earth && (desc->triangles != 0 || desc->seed != 0))
        return (mn_code)cli_error(MN_USAGE,
                                  "make earth: --stride says how many triangles; it takes no %s",
                                  desc->triangles != 0 ? "--triangles" : "--seed");
    if (earth && desc->etopo == NULL) {
        if (access(ETOPO, R_OK) != 0)
            return (mn_code)cli_error(
                MN_USAGE,
                "make earth: which heights? give --etopo FILE, or install ferret-datasets (%s)",
                ETOPO);
        fprintf(stderr, "metanode: make earth: heights of %s\n", ETOPO);
        desc->etopo = ETOPO;
    }
    return cli_output("make", out, earth ? desc->etopo : NULL);
}

static int make_shape(int argc, char **argv, const mn_make_desc *desc_in, const char *out) {
    mn_make_desc desc = *desc_in;
    mn_status st = {0};
    cli_meter meter = {0};
    if (argc > 1)
        return cli_error(MN_USAGE, "make: '%s' is one argument too many", argv[1]);
    desc.shape = (mn_shape)cli_choice(argv[0], shape_names); /* one of them: cmd_make */
    desc.progress = cli_progress;
    desc.progress_context = &meter;
    if (check_shape(&desc, out) != MN_OK)
        return MN_USAGE;
    cli_interrupts_catch();
    mn_make(out, &desc, &st);
    cli_progress_end(&meter);
    return cli_status(&st);
}

int cmd_make(int argc, char **argv) {
    mn_make_desc desc = {0};
    const char *out = NULL;
    uint64_t times = 0, stride = 0;
    float exaggeration = 0;
    int exaggerated = 0;
    bool done;
    const cli_flag flags[] = {
        CLI_OUTPUT(&out),
        CLI_WHOLE("triangles", &desc.triangles, 1, UINT64_MAX,
                  "a number above 0, such as 5000, 20k or 5M"),
        CLI_WHOLE("seed", &desc.seed, 0, UINT64_MAX, "a whole number"),
        CLI_WHOLE("times", &times, 1, 15, "in 1 … 15"),
        CLI_TEXT("etopo", &desc.etopo),
        CLI_WHOLE("stride", &stride, 1, 1000000, "in 1 … 1000000"),
        {.name = "exaggeration",
         .kind = CLI_IS_LENGTH,
         .to = &exaggeration,
         .wants = "a factor above 0",
         .given = &exaggerated},
        {0},
    };
    const mn_code code = cli_flags(argc, argv, flags, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (optind >= argc)
        return cli_error(MN_USAGE, "make: which shape? metanode make --help lists them");
    const bool subdivide = strcmp(argv[optind], "subdivide") == 0;
    if (!subdivide && cli_choice(argv[optind], shape_names) < 0)
        return cli_error(MN_USAGE, "make: no shape '%s'; metanode make --help lists them",
                         argv[optind]);
    if (out == NULL)
        return cli_error(MN_USAGE, "make: where to? give -o OUT.ply");
    if (cli_output_kind("make", out, ".ply") != MN_OK)
        return MN_USAGE;
    if (exaggerated > 0 && exaggeration <= 0)
        return cli_error(MN_USAGE, "make: --exaggeration '0' is not a factor above 0");
    desc.stride = (uint32_t)stride;
    desc.exaggeration = exaggeration;
    if (!subdivide && times != 0)
        return cli_error(MN_USAGE, "make %s: --times is for subdivide", argv[optind]);
    if (subdivide && (desc.triangles != 0 || desc.seed != 0 || desc.etopo != NULL || stride != 0 ||
                      exaggeration != 0))
        return cli_error(MN_USAGE, "make subdivide: it takes --times and -o alone");
    if (subdivide)
        return make_subdivide(argc - optind, argv + optind, times, out);
    return make_shape(argc - optind, argv + optind, &desc, out);
}
