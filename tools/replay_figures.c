/* See replay_figures.h. Hides which keys a replay prints (docs of the command line) and how they
 * are summed up. */
#include "replay_figures.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "cli.h"
#include "json.h"

/* ---- distributions --------------------------------------------------------------------------- */

static uint32_t bin_of(double value) {
    float v = (float)value;
    uint32_t bits;
    memcpy(&bits, &v, sizeof bits);
    return v > 0 ? bits >> 16 : 0;
}

/* The upper end of a bin. */
static double bin_end(uint32_t bin) {
    uint32_t bits = bin << 16 | 0xffff;
    float v;
    memcpy(&v, &bits, sizeof v);
    return v;
}

void spread_add(spread *s, double value) {
    s->count++;
    s->sum += value;
    s->max = value > s->max ? value : s->max;
    s->bin[bin_of(value)]++;
}

double spread_mean(const spread *s) {
    return s->count > 0 ? s->sum / (double)s->count : 0;
}

double spread_quantile(const spread *s, double q) {
    uint64_t seen = 0, rank = (uint64_t)ceil(q * (double)s->count);
    for (uint32_t bin = 0; bin < FIGURES_BINS && s->count > 0; bin++) {
        seen += s->bin[bin];
        if (seen >= rank && seen > 0)
            return bin == 0 ? 0 : fmin(bin_end(bin), s->max);
    }
    return 0;
}

/* ---- frames ---------------------------------------------------------------------------------- */

static double miss_rate(uint64_t misses, uint64_t adapt) {
    return misses + adapt > 0 ? (double)misses / (double)(misses + adapt) : 0;
}

static uint32_t max_of(uint32_t a, uint32_t b) {
    return a > b ? a : b;
}

void figures_frame(replay_figures *f, const mn_frame_stats *frame) {
    f->frames++;
    f->adapt += frame->adapt;
    f->splits_undone += frame->splits_undone;
    f->misses += frame->misses;
    f->refused_front += frame->refused_front;
    f->refused_budget += frame->refused_budget;
    f->refused_pool += frame->refused_pool;
    f->waits_dependency += frame->waits_dependency;
    f->triangles += frame->triangles;
    f->triangles_max = frame->triangles > f->triangles_max ? frame->triangles : f->triangles_max;
    f->active_nodes_max =
        frame->active_nodes > f->active_nodes_max ? frame->active_nodes : f->active_nodes_max;
    f->miss_rate += miss_rate(frame->misses, frame->adapt);
    f->tolerance_px += frame->tolerance_px;
    f->front_over_wanted += frame->front_over_wanted;
    f->front_hash = frame->front_hash;
    f->blocks_in_use_max = max_of(f->blocks_in_use_max, frame->blocks_in_use);
    f->blocks_resident_max = max_of(f->blocks_resident_max, frame->blocks_resident);
    f->blocks_with_ancestors_max =
        max_of(f->blocks_with_ancestors_max, frame->blocks_with_ancestors);
    spread_add(&f->nav_ms, frame->nav_ms);
    spread_add(&f->nav_cpu_ms, frame->nav_cpu_ms);
    spread_add(&f->error_px, frame->error_px);
    spread_add(&f->error_inside_px, frame->error_inside_px);
}

void figures_compared(replay_figures *f, const mn_likeness *l) {
    f->ssim_min = f->compared == 0 ? l->ssim : fmin(f->ssim_min, l->ssim);
    f->compared++;
    f->identical += l->difference_max == 0;
    f->mean_square_sum += l->mean_square;
    f->mean_square_max = fmax(f->mean_square_max, l->mean_square);
    f->ssim_sum += l->ssim;
    f->difference_max = max_of(f->difference_max, l->difference_max);
}

void figures_csv_header(FILE *csv) {
    fputs("frame,adapt,splits,collapses,active_nodes,triangles,front_over_wanted,tolerance_px,"
          "error_px,misses,miss_rate,refused_front,refused_budget,refused_pool,waits_dependency,"
          "reads,read_bytes,second_chances,prefetches,evictions,blocks_in_use,blocks_resident,"
          "nav_ms,front_hash,psnr_db,ssim,difference_max,gl_sent_bytes\n",
          csv);
}

void figures_csv_row(FILE *csv, const mn_frame_stats *f, const figures_picture *picture) {
    fprintf(csv, "%" PRIu32, f->frame);
    const uint64_t counts[] = {f->adapt, f->splits, f->collapses, f->active_nodes, f->triangles};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++)
        fprintf(csv, ",%" PRIu64, counts[i]);
    if (isnan(f->front_over_wanted))
        fputc(',', csv);
    else
        fprintf(csv, ",%.6g", f->front_over_wanted);
    fprintf(csv, ",%.6g,%.6g,%" PRIu64 ",%.6g", f->tolerance_px, f->error_px, f->misses,
            miss_rate(f->misses, f->adapt));
    const uint64_t more[] = {f->refused_front,    f->refused_budget, f->refused_pool,
                             f->waits_dependency, f->reads,          f->read_bytes,
                             f->second_chances,   f->prefetches,     f->evictions,
                             f->blocks_in_use,    f->blocks_resident};
    for (size_t i = 0; i < sizeof more / sizeof more[0]; i++)
        fprintf(csv, ",%" PRIu64, more[i]);
    fprintf(csv, ",%.4f,%016" PRIx64, f->nav_ms, f->front_hash);
    if (picture != NULL && picture->compared)
        fprintf(csv, ",%.6g,%.8g,%" PRIu32, picture->likeness.psnr_db, picture->likeness.ssim,
                picture->likeness.difference_max);
    else
        fputs(",,,", csv);
    fputc(',', csv);
    if (picture != NULL)
        fprintf(csv, "%" PRIu64, picture->sent_bytes);
    fputc('\n', csv);
}

/* ---- the end --------------------------------------------------------------------------------- */

static const char *store_name(mn_store_kind store) {
    static const char *const names[] = {"paged", "mapped", "resident"};
    return names[store];
}

static const char *prefetch_name(mn_store_kind store, mn_prefetch prefetch) {
    static const char *const names[] = {"ahead", "neighbours", "off"};
    return store == MN_STORE_PAGED ? names[prefetch] : "off";
}

static double mean_of(double sum, uint64_t frames) {
    return frames > 0 ? sum / (double)frames : 0;
}

static void json_frames(json *j, const replay_figures *f) {
    json_u64(j, "start_reads", f->start_reads);
    json_f64(j, "start_seconds", f->start_seconds);
    json_u64(j, "opening_frames", f->opening_frames);
    json_u64(j, "opening_misses", f->opening_misses);
    json_u64(j, "opening_reads", f->opening_reads);
    json_f64(j, "opening_seconds", f->opening_seconds);
    json_u64(j, "frames", f->frames);
    json_f64(j, "adapt_mean", mean_of((double)f->adapt, f->frames));
    json_f64(j, "triangles_mean", mean_of((double)f->triangles, f->frames));
    json_u64(j, "triangles_max", f->triangles_max);
    json_u64(j, "active_nodes_max", f->active_nodes_max);
    json_f64(j, "front_over_wanted", mean_of(f->front_over_wanted, f->frames));
    json_f64(j, "tolerance_px", mean_of(f->tolerance_px, f->frames));
    json_u64(j, "misses", f->misses);
    json_f64(j, "miss_rate_mean", mean_of(f->miss_rate, f->frames));
    json_f64(j, "miss_rate_overall", miss_rate(f->misses, f->adapt));
    json_u64(j, "refused_front", f->refused_front);
    json_u64(j, "refused_budget", f->refused_budget);
    json_u64(j, "refused_pool", f->refused_pool);
    json_u64(j, "waits_dependency", f->waits_dependency);
    json_u64(j, "splits_undone", f->splits_undone);
    if (f->settled) {
        json_u64(j, "settle_frames", f->settle_frames);
        json_bool(j, "back_at_roots", f->back_at_roots);
    } else {
        json_null(j, "settle_frames");
        json_null(j, "back_at_roots");
    }
    json_f64(j, "nav_ms_mean", spread_mean(&f->nav_ms));
    json_f64(j, "nav_ms_p50", spread_quantile(&f->nav_ms, 0.5));
    json_f64(j, "nav_ms_p99", spread_quantile(&f->nav_ms, 0.99));
    json_f64(j, "nav_ms_max", f->nav_ms.max);
    json_f64(j, "nav_cpu_ms_mean", spread_mean(&f->nav_cpu_ms));
    json_f64(j, "nav_cpu_ms_p50", spread_quantile(&f->nav_cpu_ms, 0.5));
    json_f64(j, "nav_cpu_ms_p99", spread_quantile(&f->nav_cpu_ms, 0.99));
    json_f64(j, "nav_cpu_ms_max", f->nav_cpu_ms.max);
    json_f64(j, "error_px_p50", spread_quantile(&f->error_px, 0.5));
    json_f64(j, "error_px_p95", spread_quantile(&f->error_px, 0.95));
    json_f64(j, "error_px_max", f->error_px.max);
    json_f64(j, "error_inside_px_p50", spread_quantile(&f->error_inside_px, 0.5));
    json_f64(j, "error_inside_px_p95", spread_quantile(&f->error_inside_px, 0.95));
    json_f64(j, "error_inside_px_max", f->error_inside_px.max);
}

static void json_totals(json *j, const mn_session_stats *t) {
    json_u64(j, "commands", t->commands);
    json_u64(j, "commands_loaded", t->commands_loaded);
    json_u64(j, "commands_resident", t->commands_resident);
    json_u64(j, "commands_given_up", t->commands_given_up);
    json_u64(j, "commands_failed", t->commands_failed);
    json_u64(j, "reads", t->reads);
    json_u64(j, "read_bytes", t->read_bytes);
    json_u64(j, "blocks_checked", t->blocks_checked);
    json_u64(j, "second_chances", t->second_chances);
    json_u64(j, "prefetches", t->prefetches);
    json_u64(j, "prefetches_given_up", t->prefetches_given_up);
    json_u64(j, "prefetches_loaded", t->prefetches_loaded);
    json_u64(j, "prefetches_used", t->prefetches_used);
    json_f64(j, "prefetches_used_share", mean_of((double)t->prefetches_used, t->prefetches_loaded));
    json_u64(j, "urgent_up", t->urgent_up);
    json_u64(j, "urgent_down", t->urgent_down);
    json_u64(j, "urgent_down_refused", t->urgent_down_refused);
    json_u64(j, "evictions", t->evictions);
    json_u64(j, "checksum_failures", t->checksum_failures);
    json_u64(j, "io_errors", t->io_errors);
    json_u64(j, "nav_lock_waits", t->nav_lock_waits);
    json_f64(j, "nav_lock_wait_us_max", 1e-3 * (double)t->nav_lock_wait_ns_max);
    json_f64(j, "io_busy_seconds", 1e-9 * (double)t->io_busy_ns);
    json_f64(j, "io_depth_mean", mean_of((double)t->io_depth_ns, t->io_busy_ns));
    json_f64(j, "io_full_seconds", 1e-9 * (double)t->io_full_ns);
    json_u64(j, "io_full_bytes", t->io_full_bytes);
    json_f64(j, "io_cpu_seconds", 1e-9 * (double)t->io_cpu_ns);
    json_f64(j, "io_lock_hold_us_max", 1e-3 * (double)t->io_lock_hold_ns_max);
}

/* Beside the reference's. The PSNR of all frames is that of their mean square. */
static void json_pictures(json *j, const replay_figures *f) {
    static const char *const keys[] = {"psnr_db_min", "psnr_db_mean", "ssim_min", "ssim_mean"};
    const double values[] = {mn_psnr_db(f->mean_square_max),
                             mn_psnr_db(mean_of(f->mean_square_sum, f->compared)), f->ssim_min,
                             mean_of(f->ssim_sum, f->compared)};
    for (int i = 0; i < 4; i++)
        json_f64(j, keys[i], f->compared > 0 ? values[i] : NAN);
    json_u64(j, "pictures_compared", f->compared);
    json_u64(j, "pictures_identical", f->identical);
    json_u64(j, "difference_max", f->difference_max);
}

void figures_json(const replay_figures *f, FILE *out) {
    json j;
    json_begin(&j, out);
    json_frames(&j, f);
    json_totals(&j, &f->totals);
    if (f->store == MN_STORE_PAGED)
        json_u64(&j, "k", f->plan.k);
    else
        json_null(&j, "k");
    json_str(&j, "prefetch", prefetch_name(f->store, f->prefetch));
    json_u64(&j, "blocks_in_use_max", f->blocks_in_use_max);
    json_u64(&j, "blocks_resident_max", f->blocks_resident_max);
    json_u64(&j, "blocks_with_ancestors_max", f->blocks_with_ancestors_max);
    json_u64(&j, "l", f->l);
    json_u64(&j, "block_bytes_max", f->block_bytes_max);
    json_cap(&j, "ram_cap_bytes", f->plan.ram_cap_bytes);
    json_u64(&j, "ram_planned_bytes", f->plan.planned_bytes);
    json_u64(&j, "ram_min_bytes", f->plan.ram_min_bytes);
    json_u64(&j, "ram_base_bytes", f->plan.base_bytes);
    json_u64(&j, "ram_front_bytes", f->plan.front_bytes);
    json_u64(&j, "ram_pool_bytes", f->plan.pool_bytes);
    json_u64(&j, "ram_tables_bytes", f->plan.tables_bytes);
    json_u64(&j, "front_max", f->plan.front_max);
    json_u64(&j, "rss_peak_bytes", f->rss_peak_bytes);
    json_u64(&j, "major_faults", f->major_faults);
    static const char *const gl_keys[] = {"gl_rss_bytes", "gl_allocations", "gl_fronts",
                                          "gl_sent_bytes"};
    const uint64_t gl_values[] = {f->gl_rss_bytes, f->gl_allocations, f->gl_fronts,
                                  f->gl_sent_bytes};
    for (int i = 0; i < 4; i++) {
        if (f->has_gl)
            json_u64(&j, gl_keys[i], gl_values[i]);
        else
            json_null(&j, gl_keys[i]);
    }
    json_pictures(&j, f);
    json_u64(&j, "allocations_after_seal", f->allocations_after_seal);
    json_str(&j, "store", store_name(f->store));
    if (f->has_foldovers) {
        json_u64(&j, "foldovers", f->foldovers);
        json_u64(&j, "foldovers_legal", f->foldovers_legal);
    } else {
        json_null(&j, "foldovers");
        json_null(&j, "foldovers_legal");
    }
    char hash[20];
    snprintf(hash, sizeof hash, "%016" PRIx64, f->front_hash);
    json_str(&j, "front_hash", hash);
    json_end(&j);
}

static double mega(uint64_t bytes) {
    return (double)bytes / 1048576;
}

void figures_plan(const mn_plan *plan, uint32_t block_bytes_max, FILE *out) {
    fprintf(out, "plan       %.2f MB", mega(plan->planned_bytes));
    if (plan->ram_cap_bytes > 0)
        fprintf(out, " of %.2f", mega(plan->ram_cap_bytes));
    fprintf(out,
            ": base %.2f, front %.2f (%" PRIu32 " nodes), pool %.2f (%" PRIu32 " × %" PRIu32
            "K), tables %.2f\n",
            mega(plan->base_bytes), mega(plan->front_bytes), plan->front_max,
            mega(plan->pool_bytes), plan->k, block_bytes_max >> 10, mega(plan->tables_bytes));
}

void figures_table(const replay_figures *f, FILE *out) {
    const mn_session_stats *t = &f->totals;
    fprintf(out, "start      %" PRIu64 " read%s, %.3f s\n", f->start_reads, cli_s(f->start_reads),
            f->start_seconds);
    if (f->opening_frames > 0)
        fprintf(out, "opening    %" PRIu64 " frame%s, %" PRIu64 " read%s, %.3f s\n",
                f->opening_frames, cli_s(f->opening_frames), f->opening_reads,
                cli_s(f->opening_reads), f->opening_seconds);
    fprintf(out, "%-10s %" PRIu64 " frame%s, %.1f splits and collapses each\n",
            store_name(f->store), f->frames, cli_s(f->frames),
            mean_of((double)f->adapt, f->frames));
    fprintf(out, "triangles  %.0f on average, %" PRIu64 " at most\n",
            mean_of((double)f->triangles, f->frames), f->triangles_max);
    fprintf(out, "error      %.2f px (median), %.2f (95 %%), tolerance %.2f\n",
            spread_quantile(&f->error_px, 0.5), spread_quantile(&f->error_px, 0.95),
            mean_of(f->tolerance_px, f->frames));
    fprintf(out, "misses     %" PRIu64 ", rate %.4f (mean of frames), %.4f (overall)\n", f->misses,
            mean_of(f->miss_rate, f->frames), miss_rate(f->misses, f->adapt));
    fprintf(out,
            "refused    %" PRIu64 " front, %" PRIu64 " budget, %" PRIu64 " pool; %" PRIu64
            " collapses waited for a neighbour\n",
            f->refused_front, f->refused_budget, f->refused_pool, f->waits_dependency);
    fprintf(out,
            "disk       %" PRIu64 " read%s, %.1f MB; %" PRIu64 " second chance%s, %" PRIu64
            " eviction%s of prefetched blocks\n",
            t->reads, cli_s(t->reads), mega(t->read_bytes), t->second_chances,
            cli_s(t->second_chances), t->evictions, cli_s(t->evictions));
    if (t->checksum_failures + t->io_errors > 0)
        fprintf(out, "faults     %" PRIu64 " checksum%s, %" PRIu64 " read%s\n",
                t->checksum_failures, cli_s(t->checksum_failures), t->io_errors,
                cli_s(t->io_errors));
    fprintf(out, "navigate   %.3f ms on average, %.3f (99 %%), %.3f at most\n",
            spread_mean(&f->nav_ms), spread_quantile(&f->nav_ms, 0.99), f->nav_ms.max);
    if (f->store == MN_STORE_PAGED)
        fprintf(out,
                "locks      %" PRIu64
                " wait%s, %.1f us at most; the I/O thread held the pool's for %.1f us at "
                "most\n",
                t->nav_lock_waits, cli_s(t->nav_lock_waits), 1e-3 * (double)t->nav_lock_wait_ns_max,
                1e-3 * (double)t->io_lock_hold_ns_max);
    if (f->compared > 0)
        fprintf(out,
                "pictures   %" PRIu64 " of %" PRIu64 " the same as with everything resident; PSNR "
                "%.2f dB at least, %.2f in all; SSIM %.5f at least, %.5f on average\n",
                f->identical, f->compared, mn_psnr_db(f->mean_square_max),
                mn_psnr_db(mean_of(f->mean_square_sum, f->compared)), f->ssim_min,
                mean_of(f->ssim_sum, f->compared));
    fprintf(out, "memory     %.2f MB at the peak; %" PRIu64 " allocation%s after the start\n",
            mega(f->rss_peak_bytes), f->allocations_after_seal, cli_s(f->allocations_after_seal));
    if (f->has_gl)
        fprintf(out, "GL, apart  %.2f MB, %" PRIu64 " allocation%s; %.1f kB sent a picture\n",
                mega(f->gl_rss_bytes), f->gl_allocations, cli_s(f->gl_allocations),
                mean_of((double)f->gl_sent_bytes / 1024, f->gl_fronts));
    if (f->has_foldovers)
        fprintf(out, "foldovers  %" PRIu64 ", %" PRIu64 " of them legal\n", f->foldovers,
                f->foldovers_legal);
    if (f->settled)
        fprintf(out, "settled    in %" PRIu64 " frame%s; %s\n", f->settle_frames,
                cli_s(f->settle_frames),
                f->back_at_roots ? "then back at the roots" : "then NOT back at the roots");
}
