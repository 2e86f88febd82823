/* metanode bench: the measurements that the documents quote, by name. */
#include <stdio.h>
#include <string.h>

#include "bench.h"
#include "cli.h"

/* A bench adds itself here, to bench.h and to meson.build. */
static const struct {
    const char *name;
    int (*run)(int argc, char **argv);
    const char *does;
} benches[] = {
    {"error", bench_error, "how honest and tight the switch values of a model's tree are"},
};
enum { BENCHES = sizeof benches / sizeof benches[0] };

static void usage(FILE *out) {
    fputs("usage: metanode bench NAME [OPTION …]     metanode bench NAME --help\n\n", out);
    for (int i = 0; i < BENCHES; i++)
        fprintf(out, "  %-10s %s\n", benches[i].name, benches[i].does);
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
    for (int i = 0; i < BENCHES; i++)
        if (strcmp(argv[1], benches[i].name) == 0)
            return benches[i].run(argc - 1, argv + 1);
    return cli_error(MN_USAGE, "no bench '%s'; metanode bench --help lists them", argv[1]);
}
