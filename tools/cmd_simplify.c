/* metanode simplify: a mesh file into a .vdt, the first half of build. */
#include "build_steps.h"

static const char help[] =
    "usage: metanode simplify IN -o OUT.vdt [OPTION …]\n\n"
    "The first half of build: the tree of collapses, to be cut by metanode block, in one way or\n"
    "another, without simplifying again.\n\n"
    "  -o FILE               the .vdt; what stood there stays until the new one is whole\n"
    "  --ram SIZE            cap for the whole process; default: half of the memory, or of\n"
    "                        what the cgroup allows\n"
    "  --temp-dir DIR        where temporary files go (default: beside the output)\n"
    "  --resume              go on behind the last phase that a run for this output, which was\n"
    "                        killed or filled the disk, had finished; --ram and -j may be others,\n"
    "                        --temp-dir is remembered\n"
    "  -j N                  threads; default: as many as processors are allowed\n"
    "  --metric qem|length   what a collapse costs: quadric error (default) or edge length\n"
    "  --position-bits N     the longest side has at most 2^N steps: 8 … 23, default 16\n"
    "  --weld on|off         vertices at equal positions become one (default), or not\n"
    "  --reader own|openmesh\n"
    "  --work-ram SIZE       what cells and sorts share of --ram, for tests of little memory;\n"
    "                        where it is less than a cell takes, cells are smaller, and the\n"
    "                        tree is another\n"
    "  --at-once             all of the mesh in memory, not in cells, however much that takes: "
    "the\n"
    "                        tree that trees made in cells are compared with\n"
    "  --json                figures as one JSON object\n";

int cmd_simplify(int argc, char **argv) {
    build_steps b;
    bool done;
    mn_code code = build_options(&b, argc, argv, BUILD_SIMPLIFIES, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (build_make(&b) == MN_OK)
        build_write(&b);
    return build_end(&b);
}
