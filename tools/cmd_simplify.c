/* metanode simplify: a mesh file into a .vdt, the first half of build. */
#include "build_steps.h"

static const char help[] =
    "usage: metanode simplify IN -o OUT.vdt [OPTION …]\n\n"
    "The first half of build: the tree of collapses, to be cut by metanode block, in one way or\n"
    "another, without simplifying again.\n\n"
    "  -o FILE               the .vdt; what stood there stays until the new one is whole\n"
    "  --ram SIZE            cap for the whole process; default: half of the memory, or of\n"
    "                        what the cgroup allows\n"
    "  --metric qem|length   what a collapse costs: quadric error (default) or edge length\n"
    "  --position-bits N     the longest side has at most 2^N steps: 8 … 23, default 16\n"
    "  --weld on|off         vertices at equal positions become one (default), or not\n"
    "  --reader own|openmesh\n"
    "  -j N                  threads of a simplification in rounds, which is what is done when\n"
    "                        --ram is too little for all at once; default: as many as\n"
    "                        processors are allowed\n"
    "  --temp-dir DIR        where it keeps its files (default: beside the output)\n"
    "  --json                figures as one JSON object\n";

int cmd_simplify(int argc, char **argv) {
    build_steps b;
    bool done;
    mn_code code = build_options(&b, argc, argv, BUILD_SIMPLIFIES, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (build_simplify(&b) == MN_OK && mn_tree_write(b.out, &b.tree, &b.st) == MN_OK)
        b.blocked.bytes_written = cli_file_bytes(b.out);
    return build_report(&b);
}
