/* What metanode tune has found, as text and JSON: see tune.h. Hidden here: the columns. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "json.h"
#include "tune.h"

static double mega(double bytes) {
    return bytes / 1048576;
}

/* ---- findings -------------------------------------------------------------------------------- */

mn_code tune_find(const tune *t, tune_findings *f, mn_status *st) {
    *f = (tune_findings){.setting = calloc(t->cells + 1, sizeof *f->setting)};
    if (f->setting == NULL)
        return mn_fail(st, MN_FAILED, "tune: no memory for settings");
    f->settings = tune_settings(t->cell, t->cells, t->o.paths, t->o.want.cpu, f->setting, t->cells);
    f->best = tune_choose(f->setting, f->settings, &t->o.want);
    return MN_OK;
}

void tune_findings_free(tune_findings *f) {
    free(f->setting);
    *f = (tune_findings){0};
}

void tune_setting_words(const tune *t, const tune_setting *s, char *text, size_t room) {
    const tune_cell *c = s->cell;
    char cap[32] = "";
    if (t->o.cap[c->cap] > 0)
        snprintf(cap, sizeof cap, " under %.4g MB", mega((double)t->o.cap[c->cap]));
    snprintf(text, room, "%s, K %.0f (%s)%s, prefetch %s", t->layout[c->layout].name,
             c->figure[TUNE_K], t->o.places[c->places].text, cap, tune_prefetch_name(c->prefetch));
}

/* ---- text ------------------------------------------------------------------------------------ */

static void layouts_table(const tune *t, FILE *out) {
    fprintf(out, "\n%-12s %9s %8s %6s %9s %12s %6s\n", "layout", "blocks", "block KB", "fill %",
            "file MB", "bytes/vertex", "depth");
    for (uint32_t i = 0; i < t->layouts; i++) {
        const tune_layout *l = &t->layout[i];
        const mn_header *h = &l->header;
        if (l->code != MN_OK)
            fprintf(out, "%-12s none: %s\n", l->name, l->says);
        else
            fprintf(out, "%-12s %9u %8.0f %6.1f %9.2f %12.1f %6u\n", l->name, h->blocks,
                    h->block_bytes_max / 1024.0, 100 * h->fill_mean, mega((double)h->file_bytes),
                    (double)h->file_bytes / h->leaves, h->block_depth);
    }
}

/* Errors on the screen of what the eye passes through are of any size. */
static const char *pixels(double px, char text[16]) {
    snprintf(text, 16, isinf(px) ? "none" : px < 10000 ? "%.2f" : "%.1e", px);
    return text;
}

static void cell_row(const tune *t, const tune_cell *c, FILE *out) {
    const double *f = c->figure;
    char cap[16] = "-";
    if (!c->resident && t->o.cap[c->cap] > 0)
        snprintf(cap, sizeof cap, "%.4gM", mega((double)t->o.cap[c->cap]));
    fprintf(out, "%-12s %6s %6s ", t->layout[c->layout].name, cap,
            c->resident ? "all" : t->o.places[c->places].text);
    if (c->state != TUNE_MEASURED) {
        fprintf(out, "%s\n", c->state == TUNE_MISSING ? "not measured" : c->says);
        return;
    }
    if (c->resident)
        fprintf(out, "%7s %7s ", "-", "-");
    else
        fprintf(out, "%7.0f %7.2f ", f[TUNE_K], mega(f[TUNE_K] * f[TUNE_BLOCK_BYTES]));
    char p50[16], p95[16];
    fprintf(out, "%8.3f %8.0f %8s %8s %7.3f %7.3f %8.1f %8.1f %7.1f %6.0f\n",
            100 * f[TUNE_MISS_RATE], f[TUNE_REFUSED_POOL] / f[TUNE_FRAMES],
            pixels(f[TUNE_ERROR_P50], p50), pixels(f[TUNE_ERROR_P95], p95),
            tune_p50_ms(c, t->o.want.cpu), tune_p99_ms(c, t->o.want.cpu), f[TUNE_TRIANGLES] / 1000,
            mega(f[TUNE_READ_BYTES]), mega(f[TUNE_RSS_BYTES]), 100 * f[TUNE_OTHERS]);
}

static void cells_table(const tune *t, uint32_t path, mn_prefetch rule, FILE *out) {
    bool first = true;
    for (size_t i = 0; i < t->cells; i++) {
        const tune_cell *c = &t->cell[i];
        if (c->path != path || (!c->resident && c->prefetch != rule))
            continue;
        if (first)
            fprintf(out,
                    "\n%s, %u frames, prefetch %s, times of the %s\n"
                    "%-12s %6s %6s %7s %7s %8s %8s %8s %8s %7s %7s %8s %8s %7s %6s\n",
                    t->o.path[path].label, t->o.path[path].frames, tune_prefetch_name(rule),
                    t->o.want.cpu ? "processor" : "clock", "layout", "cap", "places", "K", "K MB",
                    "missed %", "refused", "err p50", "err p95", "ms p50", "ms p99", "k tri",
                    "read MB", "peak MB", "others %");
        first = false;
        cell_row(t, c, out);
    }
}

static void wants(const tune_want *w, FILE *out) {
    const struct {
        const char *format;
        double bound;
    } bounds[] = {{"p99 up to %g ms, ", w->p99_ms},
                  {"error up to %g px, ", w->error_px},
                  {"misses up to %g %%, ", 100 * w->miss_rate},
                  {"peak up to %g MB, ", mega(w->ram_bytes)}};
    for (size_t i = 0; i < sizeof bounds / sizeof bounds[0]; i++)
        if (isfinite(bounds[i].bound))
            fprintf(out, bounds[i].format, bounds[i].bound);
    fprintf(out, "least %s", tune_objective_name(w->objective));
}

static void setting_row(const tune *t, const tune_setting *s, FILE *out) {
    char words[200], px[16];
    tune_setting_words(t, s, words, sizeof words);
    fprintf(out, "  %-54s error %8s px, missed %6.3f %%, p99 %7.3f ms, peak %6.1f MB\n", words,
            pixels(s->error_px, px), 100 * s->miss_rate, s->p99_ms, mega(s->ram_bytes));
}

/* With the same memory, which layout? For each cap and number of place holders. */
static void best_of_each(const tune *t, const tune_findings *f, FILE *out) {
    tune_setting *some = calloc(f->settings + 1, sizeof *some);
    for (uint32_t cap = 0; cap < t->o.caps && some != NULL; cap++)
        for (uint32_t places = 0; places < t->o.places_count; places++) {
            size_t count = 0;
            for (size_t i = 0; i < f->settings; i++)
                if (f->setting[i].cell->cap == cap && f->setting[i].cell->places == places)
                    some[count++] = f->setting[i];
            const tune_setting *best = tune_choose(some, count, &t->o.want);
            if (best != NULL)
                setting_row(t, best, out);
        }
    free(some);
}

/* The best of each number of place holders, then of all: by their worst path. */
static void best_table(const tune *t, const tune_findings *f, FILE *out) {
    fputs("\nbest (", out);
    wants(&t->o.want, out);
    fputs("), by the worst path: with as many place holders\n", out);
    best_of_each(t, f, out);
    fputs("of all\n", out);
    if (f->best != NULL)
        setting_row(t, f->best, out);
    else
        fputs("  no setting keeps to that on all paths\n", out);
}

void tune_table(const tune *t, const tune_findings *f, FILE *out) {
    layouts_table(t, out);
    for (uint32_t path = 0; path < t->o.paths; path++)
        for (uint32_t r = 0; r < t->o.prefetches; r++)
            cells_table(t, path, t->o.prefetch[r], out);
    best_table(t, f, out);
}

/* ---- JSON ------------------------------------------------------------------------------------ */

static void json_layout(json *j, const tune_layout *l) {
    json_open(j, NULL, '{');
    json_str(j, "layout", l->name);
    if (l->code != MN_OK) {
        json_str(j, "failed", l->says);
    } else {
        json_u64(j, "blocks", l->header.blocks);
        json_u64(j, "block_bytes_max", l->header.block_bytes_max);
        json_f64(j, "fill_mean", l->header.fill_mean);
        json_u64(j, "file_bytes", l->header.file_bytes);
        json_f64(j, "bytes_per_vertex", (double)l->header.file_bytes / l->header.leaves);
        json_u64(j, "block_depth", l->header.block_depth);
    }
    json_close(j, '}');
}

static void json_cell(json *j, const tune *t, const tune_cell *c) {
    json_open(j, NULL, '{');
    json_str(j, "layout", t->layout[c->layout].name);
    json_str(j, "store", c->resident ? "resident" : "paged");
    json_str(j, "path", t->o.path[c->path].name);
    if (!c->resident) {
        json_str(j, "places", t->o.places[c->places].text);
        json_str(j, "prefetch", tune_prefetch_name(c->prefetch));
        json_u64(j, "ram_cap_bytes", t->o.cap[c->cap]);
    }
    if (c->state == TUNE_REFUSED) {
        json_u64(j, "exit", (uint64_t)c->code);
        json_str(j, "failed", c->says);
    }
    for (int i = 0; i < TUNE_FIGURES && c->state == TUNE_MEASURED; i++)
        json_f64(j, tune_figure_names[i], c->figure[i]);
    json_close(j, '}');
}

static void json_best(json *j, const tune *t, const tune_setting *best) {
    static const char *const keys[] = {
        "best_layout",       "best_prefetch",          "best_k",          "best_ram_cap_bytes",
        "best_error_px_p95", "best_miss_rate_overall", "best_nav_ms_p99", "best_rss_peak_bytes"};
    for (size_t i = 0; i < sizeof keys / sizeof keys[0] && best == NULL; i++)
        json_null(j, keys[i]);
    if (best == NULL)
        return;
    json_str(j, keys[0], t->layout[best->cell->layout].name);
    json_str(j, keys[1], tune_prefetch_name(best->cell->prefetch));
    const double values[] = {best->cell->figure[TUNE_K],
                             (double)t->o.cap[best->cell->cap],
                             best->error_px,
                             best->miss_rate,
                             best->p99_ms,
                             best->ram_bytes};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++)
        json_f64(j, keys[i + 2], values[i]);
}

void tune_json(const tune *t, const tune_findings *f, FILE *out) {
    json j;
    json_begin(&j, out);
    json_str(&j, "input", t->o.in);
    json_str(&j, "program", t->program);
    json_str(&j, "machine", t->machine);
    json_open(&j, "layouts", '[');
    for (uint32_t i = 0; i < t->layouts; i++)
        json_layout(&j, &t->layout[i]);
    json_close(&j, ']');
    json_open(&j, "cells", '[');
    for (size_t i = 0; i < t->cells; i++)
        json_cell(&j, t, &t->cell[i]);
    json_close(&j, ']');
    json_best(&j, t, f->best);
    json_end(&j);
}
