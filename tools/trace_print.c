/* The report of a trace, in words and as JSON. See trace_report.h. */
#include <inttypes.h>

#include "cli.h"
#include "json.h"
#include "trace_report.h"

static const char *const stores[] = {"paged", "mapped", "resident", "?"};
static const char *const prefetches[] = {"ahead", "neighbours", "off", "?"};
static const char *const span_names[REPORT_SPANS] = {"request_to_issue", "issue_to_loaded",
                                                     "loaded_to_use", "request_to_use"};

static const char *name_of(const char *const *names, uint32_t which) {
    return names[which < 3 ? which : 3];
}

static double ratio(double part, double all) {
    return all > 0 ? part / all : 0;
}

static double miss_rate(uint64_t misses, uint64_t adapt) {
    return ratio((double)misses, (double)(misses + adapt));
}

static uint64_t urgent_loads(const trace_report *r) {
    return r->ended[MN_TRACE_URGENT_UP][MN_TRACE_END_LOADED] +
           r->ended[MN_TRACE_URGENT_DOWN][MN_TRACE_END_LOADED];
}

/* Of what was fetched ahead, what was used; of what was fetched and used, what was fetched ahead.
 */
static double precision(const trace_report *r) {
    return ratio((double)r->prefetches_used,
                 (double)r->ended[MN_TRACE_PREFETCH][MN_TRACE_END_LOADED]);
}

static double recall(const trace_report *r) {
    return ratio((double)r->prefetches_used, (double)(r->prefetches_used + urgent_loads(r)));
}

static bool is_paged(const trace_report *r) {
    return r->info->store == MN_STORE_PAGED;
}

static double seconds(const trace_report *r) {
    return r->last_ns > r->first_ns ? 1e-9 * (double)(r->last_ns - r->first_ns) : 0;
}

/* ---- words ----------------------------------------------------------------------------------- */

static void text_pool(const trace_report *r, FILE *out) {
    fprintf(out,
            "disk       %" PRIu64 " read%s, %.1f MB; %" PRIu64 " second chance%s, %" PRIu64
            " eviction%s of prefetched blocks\n",
            r->reads, cli_s(r->reads), (double)r->arrived_bytes / 1048576, r->second_chances,
            cli_s(r->second_chances), r->evictions, cli_s(r->evictions));
    fprintf(out,
            "urgent     %" PRIu64 " posted, %" PRIu64 " loaded; %" PRIu64 " grants, %" PRIu64
            " refused\n",
            r->posted[MN_TRACE_URGENT_UP] + r->posted[MN_TRACE_URGENT_DOWN], urgent_loads(r),
            r->grants, r->refused_urgent);
    fprintf(out,
            "prefetch   %" PRIu64 " posted, %" PRIu64 " loaded, %" PRIu64 " used, %" PRIu64
            " lost unused: precision %.3f, recall %.3f\n",
            r->posted[MN_TRACE_PREFETCH], r->ended[MN_TRACE_PREFETCH][MN_TRACE_END_LOADED],
            r->prefetches_used, r->lost_unused, precision(r), recall(r));
    fprintf(out, "locks      Navigate waited %" PRIu64 " time%s, %.1f us at most\n",
            r->lock_waits[MN_TRACE_NAVIGATE], cli_s(r->lock_waits[MN_TRACE_NAVIGATE]),
            1e-3 * (double)r->lock_wait_ns_max[MN_TRACE_NAVIGATE]);
    fprintf(out,
            "in use     %" PRIu64 " blocks at most, %" PRIu64
            " with ancestors; %.0f different ones in %d frames, %" PRIu64 " at most\n",
            r->in_use_max, r->ancestors_max, ratio((double)r->window_sum, (double)r->windows),
            REPORT_WINDOW, r->window_max);
}

static void text_head(const trace_report *r, FILE *out) {
    const mn_trace_info *i = r->info;
    fprintf(out, "%s: %" PRIu32 " blocks of %" PRIu32 " bytes at most, ", i->model, i->blocks,
            i->block_bytes_max);
    if (is_paged(r))
        fprintf(out, "K %" PRIu32 ", prefetch %s\n", i->k, name_of(prefetches, i->prefetch));
    else
        fprintf(out, "%s\n", name_of(stores, i->store));
    const uint64_t dropped =
        mn_trace_dropped(r->file, MN_TRACE_NAVIGATE) + mn_trace_dropped(r->file, MN_TRACE_IO);
    fprintf(out, "trace      %" PRIu64 " events of Navigate, %" PRIu64 " of I/O",
            mn_trace_events(r->file, MN_TRACE_NAVIGATE), mn_trace_events(r->file, MN_TRACE_IO));
    if (dropped > 0)
        fprintf(out, "; %" PRIu64 " DID NOT FIT, so sums are too low", dropped);
    fputs(mn_trace_is_cut(r->file) ? "; it ends before its end\n" : "\n", out);
    fprintf(out, "run        %" PRIu64 " frame%s in %.3f s%s\n", r->frames, cli_s(r->frames),
            seconds(r), i->clock == MN_TRACE_VIRTUAL ? " of the simulated disk" : "");
    fprintf(out, "moves      %" PRIu64 " split%s, %" PRIu64 " collapse%s\n", r->splits,
            cli_s(r->splits), r->collapses, cli_s(r->collapses));
    fprintf(out, "misses     %" PRIu64 ", rate %.4f (mean of frames), %.4f (overall)\n", r->misses,
            ratio(r->miss_rate_sum, (double)r->frames),
            miss_rate(r->misses, r->splits + r->collapses));
    fprintf(out, "refused    %" PRIu64 " front, %" PRIu64 " budget, %" PRIu64 " pool\n",
            r->refused_front, r->refused_budget, r->refused_pool);
    if (is_paged(r))
        text_pool(r, out);
    if (r->counters_differ + r->moves_differ > 0)
        fprintf(out,
                "NOTE       %" PRIu64 " levels and %" PRIu64 " sums do not follow from events\n",
                r->counters_differ, r->moves_differ);
}

static void text_latency(const trace_report *r, FILE *out) {
    static const char *const who[2] = {"prefetched", "urgent"};
    static const char *const from_to[REPORT_SPANS] = {"request to issue", "issue to loaded",
                                                      "loaded to use", "request to use"};
    fputs("\nlatency, ms               blocks      p50      p99      max\n", out);
    for (int w = 1; w >= 0; w--)
        for (int i = 0; i < REPORT_SPANS; i++) {
            const spread *s = r->span[w][i];
            fprintf(out, "%-10s %-16s %5" PRIu64 " %8.3f %8.3f %8.3f\n", who[w], from_to[i],
                    s->count, spread_quantile(s, 0.5), spread_quantile(s, 0.99), s->max);
        }
}

static void text_time(const trace_report *r, FILE *out) {
    fputs("\nframes          moves   misses    rate   reads  evicted  in use  different blocks\n",
          out);
    for (int i = 0; i < REPORT_PERIODS; i++) {
        const report_period *p = &r->period[i];
        if (p->frames > 0)
            fprintf(out,
                    "%5" PRIu32 "-%-5" PRIu32 " %9" PRIu64 " %8" PRIu64 " %7.4f %7" PRIu64
                    " %8" PRIu64 " %7" PRIu64 " %17" PRIu64 "\n",
                    p->frame, p->frame + p->frames - 1, p->adapt, p->misses,
                    miss_rate(p->misses, p->adapt), p->reads, p->evictions, p->in_use, p->blocks);
    }
    fputs("\nlevel  blocks    splits collapses   misses    rate   reads      uses\n", out);
    for (uint32_t i = 0; i < r->levels; i++) {
        const report_level *l = &r->level[i];
        fprintf(out,
                "%5" PRIu32 " %7" PRIu64 " %9" PRIu64 " %9" PRIu64 " %8" PRIu64 " %7.4f %7" PRIu64
                " %9" PRIu64 "\n",
                i, l->blocks, l->splits, l->collapses, l->misses,
                miss_rate(l->misses, l->splits + l->collapses), l->reads, l->uses);
    }
    if (r->missed_count > 0)
        fputs("\nmissed most   block  level   misses   reads\n", out);
    for (uint32_t i = 0; i < r->missed_count; i++)
        fprintf(out, "%19" PRIu32 " %6" PRId32 " %8" PRIu64 " %7" PRIu64 "\n", r->missed_id[i],
                r->missed[i].level, r->missed[i].misses, r->missed[i].reads);
}

static void text_reuse(const trace_report *r, FILE *out) {
    fprintf(out,
            "\nWith another K, by reuse distances (least recently used, nothing read ahead):\n"
            "%" PRIu64 " uses began, %" PRIu64 " of them first ones\n"
            "       K     reads  of uses    misses     rate\n",
            r->reuse.accesses_all, r->reuse.distances_room > 0 ? r->reuse.accesses[0] : 0);
    for (uint32_t i = 0; i < r->sizes; i++) {
        const report_guess g = trace_report_guess(r, r->size[i]);
        fprintf(out, "%8" PRIu64 " %9" PRIu64 " %8.4f %9" PRIu64 " %8.4f%s\n", r->size[i], g.reads,
                ratio((double)g.reads, (double)r->reuse.accesses_all), g.misses, g.miss_rate,
                is_paged(r) && r->size[i] == r->info->k ? "  this K" : "");
    }
}

void trace_report_text(const trace_report *r, FILE *out) {
    text_head(r, out);
    text_latency(r, out);
    text_time(r, out);
    text_reuse(r, out);
}

/* ---- JSON ------------------------------------------------------------------------------------ */

/* Without a pool there is no such figure: the file is in memory, or the system reads it. */
static void paged_u64(json *j, const trace_report *r, const char *key, uint64_t value) {
    if (is_paged(r))
        json_u64(j, key, value);
    else
        json_null(j, key);
}

static void json_info(json *j, const trace_report *r) {
    const mn_trace_info *i = r->info;
    char build[20];
    snprintf(build, sizeof build, "%016" PRIx64, i->build_id);
    json_str(j, "model", i->model);
    json_str(j, "build_id", build);
    json_u64(j, "blocks", i->blocks);
    json_u64(j, "block_bytes_max", i->block_bytes_max);
    paged_u64(j, r, "k", i->k);
    paged_u64(j, r, "k_min", i->k_min);
    json_str(j, "store", name_of(stores, i->store));
    json_str(j, "prefetch", is_paged(r) ? name_of(prefetches, i->prefetch) : "off");
    json_str(j, "clock", i->clock == MN_TRACE_VIRTUAL ? "virtual" : "monotonic");
    json_u64(j, "seed", i->seed);
    json_u64(j, "events",
             mn_trace_events(r->file, MN_TRACE_NAVIGATE) + mn_trace_events(r->file, MN_TRACE_IO));
    json_u64(j, "dropped",
             mn_trace_dropped(r->file, MN_TRACE_NAVIGATE) + mn_trace_dropped(r->file, MN_TRACE_IO));
    json_bool(j, "cut", mn_trace_is_cut(r->file));
}

static void json_sums(json *j, const trace_report *r) {
    static const char *const commands[MN_TRACE_COMMANDS] = {"prefetches", "urgent_up",
                                                            "urgent_down"};
    static const char *const ends[MN_TRACE_ENDS] = {"commands_loaded", "commands_resident",
                                                    "commands_given_up", "commands_failed"};
    json_u64(j, "frames", r->frames);
    json_f64(j, "seconds", seconds(r));
    json_u64(j, "splits", r->splits);
    json_u64(j, "collapses", r->collapses);
    json_u64(j, "misses", r->misses);
    json_f64(j, "miss_rate_mean", ratio(r->miss_rate_sum, (double)r->frames));
    json_f64(j, "miss_rate_overall", miss_rate(r->misses, r->splits + r->collapses));
    json_u64(j, "refused_front", r->refused_front);
    json_u64(j, "refused_budget", r->refused_budget);
    json_u64(j, "refused_pool", r->refused_pool);
    paged_u64(j, r, "reads", r->reads);
    paged_u64(j, r, "read_bytes", r->arrived_bytes);
    json_u64(j, "second_chances", r->second_chances);
    json_u64(j, "evictions", r->evictions);
    for (int c = 0; c < MN_TRACE_COMMANDS; c++)
        json_u64(j, commands[c], r->posted[c]);
    for (int end = 0; end < MN_TRACE_ENDS; end++)
        json_u64(j, ends[end], r->ended[0][end] + r->ended[1][end] + r->ended[2][end]);
    json_u64(j, "urgent_down_refused", r->refused_urgent);
    json_u64(j, "grants", r->grants);
    json_u64(j, "prefetches_given_up", r->ended[MN_TRACE_PREFETCH][MN_TRACE_END_GIVEN_UP]);
    json_u64(j, "prefetches_loaded", r->ended[MN_TRACE_PREFETCH][MN_TRACE_END_LOADED]);
    json_u64(j, "prefetches_used", r->prefetches_used);
    json_u64(j, "prefetches_lost_unused", r->lost_unused);
    json_f64(j, "prefetch_precision", precision(r));
    json_f64(j, "prefetch_recall", recall(r));
    json_u64(j, "nav_lock_waits", r->lock_waits[MN_TRACE_NAVIGATE]);
    json_f64(j, "nav_lock_wait_us_max", 1e-3 * (double)r->lock_wait_ns_max[MN_TRACE_NAVIGATE]);
    json_u64(j, "blocks_in_use_max", r->in_use_max);
    json_u64(j, "blocks_with_ancestors_max", r->ancestors_max);
    json_f64(j, "window_blocks_mean", ratio((double)r->window_sum, (double)r->windows));
    json_u64(j, "window_blocks_max", r->window_max);
    json_u64(j, "levels_differ", r->counters_differ);
    json_u64(j, "moves_differ", r->moves_differ);
}

static void json_latency(json *j, const trace_report *r) {
    static const char *const who[2] = {"prefetched_ms", "urgent_ms"};
    for (int w = 0; w < 2; w++) {
        json_open(j, who[w], '{');
        for (int i = 0; i < REPORT_SPANS; i++) {
            const spread *s = r->span[w][i];
            json_open(j, span_names[i], '{');
            json_u64(j, "blocks", s->count);
            json_f64(j, "p50", spread_quantile(s, 0.5));
            json_f64(j, "p99", spread_quantile(s, 0.99));
            json_f64(j, "max", s->max);
            json_close(j, '}');
        }
        json_close(j, '}');
    }
}

static void json_periods(json *j, const trace_report *r) {
    json_open(j, "periods", '[');
    for (int i = 0; i < REPORT_PERIODS; i++) {
        const report_period *p = &r->period[i];
        if (p->frames == 0)
            continue;
        json_open(j, NULL, '{');
        json_u64(j, "frame", p->frame);
        json_u64(j, "frames", p->frames);
        json_u64(j, "adapt", p->adapt);
        json_u64(j, "misses", p->misses);
        json_f64(j, "miss_rate", miss_rate(p->misses, p->adapt));
        json_u64(j, "reads", p->reads);
        json_u64(j, "evictions", p->evictions);
        json_u64(j, "blocks_in_use_max", p->in_use);
        json_u64(j, "blocks_used", p->blocks);
        json_close(j, '}');
    }
    json_close(j, ']');
}

static void json_levels(json *j, const trace_report *r) {
    json_open(j, "levels", '[');
    for (uint32_t i = 0; i < r->levels; i++) {
        const report_level *l = &r->level[i];
        json_open(j, NULL, '{');
        json_u64(j, "level", i);
        json_u64(j, "blocks", l->blocks);
        json_u64(j, "splits", l->splits);
        json_u64(j, "collapses", l->collapses);
        json_u64(j, "misses", l->misses);
        json_f64(j, "miss_rate", miss_rate(l->misses, l->splits + l->collapses));
        json_u64(j, "reads", l->reads);
        json_u64(j, "uses", l->uses);
        json_close(j, '}');
    }
    json_close(j, ']');
    json_open(j, "missed_most", '[');
    for (uint32_t i = 0; i < r->missed_count; i++) {
        json_open(j, NULL, '{');
        json_u64(j, "block", r->missed_id[i]);
        json_u64(j, "misses", r->missed[i].misses);
        json_u64(j, "reads", r->missed[i].reads);
        json_close(j, '}');
    }
    json_close(j, ']');
}

static void json_reuse(json *j, const trace_report *r) {
    json_u64(j, "uses", r->reuse.accesses_all);
    json_open(j, "reuse", '[');
    for (uint32_t i = 0; i < r->sizes; i++) {
        const report_guess g = trace_report_guess(r, r->size[i]);
        json_open(j, NULL, '{');
        json_u64(j, "k", r->size[i]);
        json_u64(j, "reads", g.reads);
        json_u64(j, "misses", g.misses);
        json_f64(j, "miss_rate", g.miss_rate);
        json_close(j, '}');
    }
    json_close(j, ']');
}

void trace_report_json(const trace_report *r, FILE *out) {
    json j;
    json_begin(&j, out);
    json_info(&j, r);
    json_sums(&j, r);
    json_latency(&j, r);
    json_periods(&j, r);
    json_levels(&j, r);
    json_reuse(&j, r);
    json_end(&j);
}
