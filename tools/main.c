/* metanode: the subcommands and their names. */
#include "cli.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>

/* In the order of --help. A subcommand adds itself here and to meson.build. */
static const cli_command commands[] = {
    {"build", cmd_build, "a mesh file into a .mnt: simplify and block"},
    {"simplify", cmd_simplify, "a mesh file into a .vdt: the tree of collapses"},
    {"block", cmd_block, "a .vdt into a .mnt: blocks"},
    {"info", cmd_info, "what a .mnt or .vdt says of itself"},
    {"verify", cmd_verify, "is a file sound, and is it the mesh it was built from?"},
    {"extract", cmd_extract, "a mesh out of a .mnt or .vdt, as detailed as wanted"},
    {"make", cmd_make, "models of any size: sphere, terrain, isosurface, earth; subdivide"},
    {"compare", cmd_compare, "distance between two meshes, or two pictures"},
    {"replay", cmd_replay, "navigates along a path without a window, with figures"},
    {"view", cmd_view, "the window"},
    {"shoot", cmd_shoot, "one picture of a path, without a display"},
    {"stress", cmd_stress, "tiny memory, wild cameras, failing disks, everything checked"},
    {"trace", cmd_trace, "what happened in a run: a report, a table, a picture in time"},
    {"tune", cmd_tune, "sweeps L, block sizes and K: table, best setting, plots"},
    {"bench", cmd_bench, "measurements that the documents quote"},
    {NULL, NULL, NULL},
};

static void usage(FILE *out) {
    fputs("metanode: triangle meshes of any size, navigated under a RAM cap\n\n"
          "usage: metanode COMMAND [OPTION …]     metanode COMMAND --help\n\n",
          out);
    for (const cli_command *c = commands; c->name != NULL; c++)
        fprintf(out, "  %-10s %s\n", c->name, c->does);
    fputs("\nexit: 0 done, 1 failed, 2 wrong usage, 3 bad input, 4 out of space, 5 cap too small,\n"
          "      6 no graphics\n",
          out);
}

static int run(int argc, char **argv) {
    if (argc < 2) {
        usage(stderr);
        return MN_USAGE;
    }
    const bool help = strcmp(argv[1], "help") == 0;
    if (help && argc > 2)
        return run(3, (char *[]){argv[0], argv[2], "--help", NULL});
    if (help || strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        usage(stdout);
        return MN_OK;
    }
    if (strcmp(argv[1], "--version") == 0) {
        puts("metanode " METANODE_VERSION);
        return MN_OK;
    }
    for (const cli_command *c = commands; c->name != NULL; c++)
        if (strcmp(argv[1], c->name) == 0)
            return c->run(argc - 1, argv + 1);
    return cli_error(MN_USAGE, "no command '%s'; metanode --help lists them", argv[1]);
}

/* Where one of the three is closed, a file that we write could get its number, and our figures with
 * it: a place that cannot be written is put there instead. */
static void open_standard(void) {
    for (int fd = 0; fd <= 2; fd++)
        if (fcntl(fd, F_GETFD) < 0 && open("/dev/null", fd == 0 ? O_WRONLY : O_RDONLY) != fd)
            return;
}

/* Figures that did not reach their file are a failure, however well they were measured. */
static int close_output(int code) {
    errno = 0;
    if ((fflush(stdout) == 0 && !ferror(stdout)) || code != MN_OK)
        return code;
    return cli_error(mn_code_of_write(errno), "standard output could not be written whole: %s; %s",
                     errno != 0 ? strerror(errno) : "it has failed before",
                     cli_write_advice(errno));
}

int main(int argc, char **argv) {
    open_standard();
    signal(SIGXFSZ, SIG_IGN); /* a limit on files fails a write, as a full disk does */
    return close_output(run(argc, argv));
}
