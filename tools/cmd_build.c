/* metanode build: a mesh file into a .mnt. Thin over mn_vdt_make and mn_vdt_block. */
#include "build_steps.h"

static const char help[] =
    "usage: metanode build IN -o OUT.mnt [OPTION …]\n\n"
    "Simplifies a mesh (PLY, STL, OBJ, OFF, or .om) down to one vertex and writes the tree of its\n"
    "collapses in blocks, ready for replay, shoot and view. The mesh may be larger than memory.\n\n"
    "  -o FILE               the .mnt; what stood there stays until the new one is whole\n"
    "  --ram SIZE            cap for the whole process; default: half of the memory, or of\n"
    "                        what the cgroup allows\n"
    "  --temp-dir DIR        where temporary files go (default: beside the output)\n"
    "  --resume              go on behind the last phase that a build of this output, which was\n"
    "                        killed or filled the disk, had finished; --ram, -j and how to\n"
    "                        block may be others, --temp-dir is remembered\n"
    "  -j N                  threads; default: as many as processors are allowed\n"
    "  --metric qem|length   what a collapse costs: quadric error (default) or edge length\n"
    "  --blocking packed|levels   blocks of fixed bytes, filled (default), or of L levels\n"
    "  --block-bytes SIZE    packed: a multiple of 4096 up to 1M; default 8K\n"
    "  -L N                  levels: 1 … 16, default 5\n"
    "  --zstd[=LEVEL]        compress each block by itself, 1 … 22 (3): the file and its reads\n"
    "                        are smaller, reading takes more of the processor; not for\n"
    "                        --store mapped\n"
    "  --position-bits N     the longest side has at most 2^N steps: 8 … 23, default 16\n"
    "  --weld on|off         vertices at equal positions become one (default), or not\n"
    "  --reader own|openmesh\n"
    "  --work-ram SIZE       what cells and sorts share of --ram, for tests of little memory;\n"
    "                        where it is less than a cell takes, cells are smaller, and the\n"
    "                        tree is another\n"
    "  --json                figures as one JSON object\n";

int cmd_build(int argc, char **argv) {
    build_steps b;
    bool done;
    mn_code code = build_options(&b, argc, argv, BUILD_SIMPLIFIES | BUILD_BLOCKS, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (build_make(&b) == MN_OK)
        build_block(&b);
    return build_end(&b);
}
