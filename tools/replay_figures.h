/* The figures of a replay: gathered a frame at a time in constant memory, printed at the end. Main
 * thread only. */
#ifndef METANODE_REPLAY_FIGURES_H
#define METANODE_REPLAY_FIGURES_H

#include <stdio.h>

#include "metanode/gl.h"
#include "metanode/runtime.h"

/* A distribution of numbers ≥ 0: a bin for each float's upper 15 bits, so quantiles are within
 * 0.8 % and the memory does not grow with the frames. */
enum { FIGURES_BINS = 1 << 15 };
typedef struct spread {
    uint64_t count;
    double sum, max;
    uint32_t bin[FIGURES_BINS];
} spread;
void spread_add(spread *s, double value);
double spread_mean(const spread *s);
double spread_quantile(const spread *s, double q); /* 0 when empty */

typedef struct replay_figures {
    uint64_t frames, adapt, misses, refused_front, refused_budget, refused_pool, waits_dependency;
    uint64_t splits_undone;
    uint64_t triangles, triangles_max, active_nodes_max;
    double miss_rate, tolerance_px, front_over_wanted; /* sums over frames */
    spread nav_ms, nav_cpu_ms, error_px, error_inside_px;

    uint64_t gl_fronts,
        gl_sent_bytes; /* handed to the driver: by the command, a picture at a time */

    /* of pictures beside the reference's */
    uint64_t compared, identical;
    double mean_square_sum, mean_square_max, ssim_sum, ssim_min;
    uint32_t difference_max;

    /* filled by the command at the end */
    uint64_t opening_frames, opening_misses, opening_reads; /* before the first frame */
    double opening_seconds;
    uint64_t start_reads; /* while the session was opened */
    double start_seconds;
    uint64_t settle_frames, foldovers, foldovers_legal, front_hash;
    uint64_t rss_peak_bytes, gl_rss_bytes, allocations_after_seal, gl_allocations;
    uint64_t major_faults; /* in frames: pages that the kernel had to read */
    bool settled, back_at_roots, has_gl, has_foldovers;
    mn_store_kind store;
    mn_plan plan;
    mn_session_stats totals;
    uint32_t l, block_bytes_max;
    uint32_t blocks_in_use_max, blocks_resident_max, blocks_with_ancestors_max;
    mn_prefetch prefetch;
} replay_figures;

/* Of a frame's picture. */
typedef struct figures_picture {
    uint64_t sent_bytes; /* to the driver */
    bool compared;
    mn_likeness likeness; /* to the reference's */
} figures_picture;

void figures_frame(replay_figures *figures, const mn_frame_stats *frame);
void figures_compared(replay_figures *figures, const mn_likeness *likeness);
void figures_csv_header(FILE *csv);
/* picture: NULL: the frame has none. */
void figures_csv_row(FILE *csv, const mn_frame_stats *frame, const figures_picture *picture);
void figures_json(const replay_figures *figures, FILE *out);
/* What the cap was turned into: a line, for the start. */
void figures_plan(const mn_plan *plan, uint32_t block_bytes_max, FILE *out);
void figures_table(const replay_figures *figures, FILE *out);

#endif
