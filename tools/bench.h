/* What `metanode bench NAME` runs. argv[0] is the name; each reports on standard output. */
#ifndef METANODE_BENCH_H
#define METANODE_BENCH_H

int bench_error(int argc, char **argv);

#endif
