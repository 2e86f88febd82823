/* What build, simplify and block share: options, steps, figures. Main thread only.
 *
 *   build_options ── build_make, or build_open ── build_block, or build_write ── build_end */
#ifndef METANODE_BUILD_STEPS_H
#define METANODE_BUILD_STEPS_H

#include "cli.h"
#include "json.h"
#include "metanode/build.h"
#include "temp.h"

typedef struct build_steps {
    /* options */
    const char *command, *in, *out;
    uint64_t ram_bytes;
    mn_read_desc read;
    mn_simplify_desc simplify;
    mn_block_desc block;
    bool resume, json;
    bool blocks;  /* builds a .mnt */
    bool at_once; /* the tree in memory, not in cells */
    /* what was done */
    temp_files temp;
    mn_work *work;
    mn_vdt *vdt;
    mn_tree whole;       /* at_once: there is no vdt */
    const mn_tree *head; /* counts and facts; NULL: there is none yet */
    mn_header header;    /* blocks 0: nothing was blocked */
    mn_block_counts blocked;
    cli_meter meter;
    mn_status st;
} build_steps;

enum { BUILD_SIMPLIFIES = 1, BUILD_BLOCKS = 2 };

/* Parses the options of a command that takes those steps. A code other than MN_OK, or *done: return
 * it, the user has been told. b stays where it is from then on. */
mn_code build_options(build_steps *b, int argc, char **argv, unsigned steps, const char *help,
                      bool *done);
/* A tree of the mesh. Errors, of all steps, are in b->st. */
mn_code build_make(build_steps *b);
/* The tree that stands in a .vdt or .mnt. */
mn_code build_open(build_steps *b);
/* Cuts the tree into b->out, or writes it there as it is. */
mn_code build_block(build_steps *b);
mn_code build_write(build_steps *b);
/* The figures, on standard output: JSON or a few lines. Frees all; returns the exit code. */
int build_end(build_steps *b);

/* ---- figures (build_figures.c) -------------------------------------------------------------- */

void build_report(const build_steps *b);
/* What a tree holds and what the build met, as keys of an open object. */
void build_json_tree(json *j, const mn_tree *tree);
const char *build_metric_name(mn_metric metric);
const char *build_blocking_name(mn_blocking blocking);

#endif
