/* How far apart in time the same block is wanted: what a pool of another size would have had. Main
 * thread only. */
#ifndef METANODE_TRACE_REUSE_H
#define METANODE_TRACE_REUSE_H

#include <stdbool.h>
#include <stdint.h>

typedef struct trace_reuse_block {
    uint32_t left_at; /* when it went out of use, among those; 0: it is in use, or was never */
    bool known, in_use;
    bool asked;        /* has been asked for since it went, and not been there */
    uint32_t distance; /* then; 0: never used before */
    uint32_t misses;   /* since then */
} trace_reuse_block;

typedef struct trace_reuse {
    trace_reuse_block *block; /* by number */
    uint32_t block_room, blocks;
    uint32_t in_use;
    uint32_t *tree; /* Fenwick: who stands at each left_at */
    uint32_t *owner;
    uint32_t tree_room, now;
    /* by distance; [0]: blocks that had never been used */
    uint64_t *accesses, *misses;
    uint32_t distances_room, misses_room;
    uint64_t accesses_all, misses_all;
    bool failed; /* no memory */
} trace_reuse;

/* block: its number (trace_words.h). */
void trace_reuse_use(trace_reuse *reuse, uint32_t block);
void trace_reuse_leave(trace_reuse *reuse, uint32_t block);
void trace_reuse_absent(trace_reuse *reuse, uint32_t block);
void trace_reuse_miss(trace_reuse *reuse, uint32_t block);
/* Takes in what was still asked for. */
void trace_reuse_end(trace_reuse *reuse);
/* Uses that a pool of so many place holders, all of them on one list by when they were last in use,
 * would have had to read for; and misses of those that were counted in the run. */
uint64_t trace_reuse_reads(const trace_reuse *reuse, uint32_t k);
uint64_t trace_reuse_misses(const trace_reuse *reuse, uint32_t k);
uint32_t
trace_reuse_farthest(const trace_reuse *reuse); /* with more place holders nothing changes */
void trace_reuse_free(trace_reuse *reuse);

#endif
