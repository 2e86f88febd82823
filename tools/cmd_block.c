/* metanode block: a .vdt, or the tree of a .mnt, into a .mnt: the second half of build. */
#include "build_steps.h"

static const char help[] =
    "usage: metanode block IN -o OUT.mnt [OPTION …]\n\n"
    "The second half of build: cuts a tree that metanode simplify has made (a .vdt) into blocks,\n"
    "or one that a .mnt holds into others. Either may be larger than memory.\n\n"
    "  -o FILE               the .mnt; what stood there stays until the new one is whole\n"
    "  --ram SIZE            cap for the whole process; default: half of the memory, or of\n"
    "                        what the cgroup allows\n"
    "  --temp-dir DIR        of a .mnt: where temporary files go (default: beside the output)\n"
    "  -j N                  threads; default: as many as processors are allowed\n"
    "  --blocking packed|levels   blocks of fixed bytes, filled (default), or of L levels\n"
    "  --block-bytes SIZE    packed: a multiple of 4096 up to 1M; default 8K\n"
    "  -L N                  levels: 1 … 16, default 5\n"
    "  --zstd[=LEVEL]        compress each block by itself, 1 … 22 (3): the file and its reads\n"
    "                        are smaller, reading takes more of the processor; not for\n"
    "                        --store mapped\n"
    "  --json                figures as one JSON object\n";

int cmd_block(int argc, char **argv) {
    build_steps b;
    bool done;
    mn_code code = build_options(&b, argc, argv, BUILD_BLOCKS, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (build_open(&b) == MN_OK)
        build_block(&b);
    return build_end(&b);
}
