/* What build, simplify and block share: options, steps, figures. Main thread only. */
#ifndef METANODE_BUILD_STEPS_H
#define METANODE_BUILD_STEPS_H

#include "cli.h"
#include "json.h"
#include "metanode/build.h"

typedef struct build_steps {
    /* options */
    const char *command, *in, *out;
    uint64_t ram_bytes; /* 0: host_default_ram_bytes */
    mn_read_desc read;
    uint32_t position_bits; /* 0: default */
    mn_simplify_desc simplify;
    char temp_dir[4096]; /* the output's */
    mn_block_desc block;
    bool json;
    /* what was done */
    mn_tree tree;
    double seconds_read;
    uint64_t bytes_read;
    mn_header header; /* blocks 0: nothing was blocked */
    mn_block_counts blocked;
    cli_meter meter;
    mn_status st;
} build_steps;

enum { BUILD_SIMPLIFIES = 1, BUILD_BLOCKS = 2 };

/* Parses the options of a command that takes those steps. A code other than MN_OK, or *done: return
 * it, the user has been told. */
mn_code build_options(build_steps *b, int argc, char **argv, unsigned steps, const char *help,
                      bool *done);
/* Reads the mesh and simplifies it into b->tree. Errors are in b->st. */
mn_code build_simplify(build_steps *b);
/* Cuts b->tree into b->out. */
mn_code build_block(build_steps *b);
/* The figures, on standard output: JSON or a few lines. Frees the tree; returns the exit code. */
int build_report(build_steps *b);

/* What a tree holds and what the build met, as keys of an open object. */
void build_json_tree(json *j, const mn_tree *tree);
const char *build_metric_name(mn_metric metric);
const char *build_blocking_name(mn_blocking blocking);

#endif
