/* The measurements that the documents quote: one file each. Main thread only. */
#ifndef METANODE_BENCH_H
#define METANODE_BENCH_H

#include <stddef.h>

#include "metanode/status.h"

int bench_adapt(int argc, char **argv);
int bench_draw(int argc, char **argv);
int bench_error(int argc, char **argv);
int bench_simplify(int argc, char **argv);

/* Before any is measured: is each a .mnt that could be? */
mn_code bench_trees_are_there(char **files, int count, mn_status *st);
/* The same of meshes. */
mn_code bench_meshes_are_there(char **files, int count, mn_status *st);
/* A figure in so many places, or "-" where there is none. */
const char *bench_number(double value, int width, int digits, char text[32]);
/* Binds this process, and what it starts, to the processor it is on: timings then compare. */
void bench_one_core(void);
double bench_median(double *values, size_t count); /* sorts them */

#endif
