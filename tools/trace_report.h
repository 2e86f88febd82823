/* What a trace comes to: rates over time and by level, latencies, prefetch, working set, reuse.
 * Gathered in two passes; memory by block. Main thread only. */
#ifndef METANODE_TRACE_REPORT_H
#define METANODE_TRACE_REPORT_H

#include <stdio.h>

#include "replay_figures.h"
#include "trace_reuse.h"
#include "trace_words.h"

enum {
    REPORT_PERIODS = 12, /* of the run, as even as can be */
    REPORT_LEVELS = 64,  /* of the block tree; deeper ones count as the last */
    REPORT_MISSED = 10,  /* blocks that are named */
    REPORT_WINDOW = 60,  /* frames of a working set */
    REPORT_SIZES = 24,   /* of pools that are told of */
};

typedef struct report_period {
    uint32_t frames, frame; /* how many; the first one */
    uint64_t adapt, misses, reads, evictions, in_use, blocks;
} report_period;

typedef struct report_level {
    uint64_t blocks, splits, collapses, misses, reads, uses;
} report_level;

typedef struct report_block {
    uint32_t parent;
    int32_t level; /* -1: not known */
    uint64_t misses, reads;
    uint64_t asked_ns, issued_ns, loaded_ns; /* 0: no */
    bool urgent;                             /* it came by an urgent command */
    uint32_t period, window;                 /* + 1: in which it was in use last */
} report_block;

/* From one moment of a block's life to the next, ms. */
typedef enum report_span { REPORT_ISSUE, REPORT_READ, REPORT_REST, REPORT_USE } report_span;
enum { REPORT_SPANS = 4 };

typedef struct trace_report {
    const mn_trace_file *file;
    const mn_trace_info *info;
    /* what replay --json says too; of the run: its frames, without what comes before or after */
    uint64_t frames, splits, collapses, misses, refused_front, refused_budget, refused_pool;
    double miss_rate_sum;
    /* of the whole file */
    uint64_t reads, evictions, second_chances, posted[MN_TRACE_COMMANDS];
    uint64_t ended[MN_TRACE_COMMANDS][MN_TRACE_ENDS];
    uint64_t prefetches_used, lost_unused, grants, refused_urgent, arrived_bytes, io_errors;
    uint64_t lock_waits[MN_TRACE_THREADS], lock_wait_ns_max[MN_TRACE_THREADS];
    uint64_t first_ns, last_ns; /* of the run */
    /* of the run again */
    report_period period[REPORT_PERIODS];
    report_level level[REPORT_LEVELS];
    uint32_t levels;
    report_block missed[REPORT_MISSED]; /* most missed first */
    uint32_t missed_id[REPORT_MISSED], missed_count;
    uint64_t in_use_max, ancestors_max;
    uint64_t windows, window_sum, window_max;
    spread *span[2][REPORT_SPANS]; /* prefetched, urgent; each may be empty */
    /* places by their states, followed event by event, and what stood beside them */
    uint32_t places[MN_TRACE_PLACES];
    uint64_t counters_differ, moves_differ;
    trace_reuse reuse;
    uint64_t size[REPORT_SIZES]; /* of pools, rising */
    uint32_t sizes;
    /* while it is gathered */
    trace_map blocks;
    report_block *block;
    uint32_t block_room;
    bool in_run, run_over, failed;
    uint64_t frame, frame_splits, frame_collapses, frame_misses, frame_adapt, window_now;
} trace_report;

/* sizes: that the caller asks for; more are added. *out is freed by trace_report_free also after a
 * failure. */
mn_code trace_report_make(mn_trace_file *file, const uint64_t *size, uint32_t sizes,
                          trace_report *out, mn_status *st);
/* What a pool of that size would have come to. */
typedef struct report_guess {
    uint64_t reads, misses;
    double miss_rate;
} report_guess;
report_guess trace_report_guess(const trace_report *report, uint64_t k);
void trace_report_text(const trace_report *report, FILE *out);
void trace_report_json(const trace_report *report, FILE *out);
void trace_report_free(trace_report *report);

#endif
