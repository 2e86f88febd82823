/* metanode block: a .vdt into a .mnt, the second half of build. */
#include "build_steps.h"

static const char help[] =
    "usage: metanode block IN.vdt -o OUT.mnt [OPTION …]\n\n"
    "The second half of build: cuts a tree that metanode simplify has made (or that a .mnt holds)\n"
    "into blocks.\n\n"
    "  -o FILE               the .mnt; what stood there stays until the new one is whole\n"
    "  --blocking packed|levels   blocks of fixed bytes, filled (default), or of L levels\n"
    "  --block-bytes SIZE    packed: a multiple of 4096 up to 1M; default 8K\n"
    "  -L N                  levels: 1 … 16, default 5\n"
    "  --json                figures as one JSON object\n";

int cmd_block(int argc, char **argv) {
    build_steps b;
    bool done;
    mn_code code = build_options(&b, argc, argv, BUILD_BLOCKS, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (mn_tree_load(b.in, CLI_WATCH(&b.meter), &b.tree, &b.st) == MN_OK) {
        b.bytes_read = cli_file_bytes(b.in);
        build_block(&b);
    }
    return build_report(&b);
}
