/* What metanode tune has found, as text and JSON: see tune.h. Hidden here: the columns. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "json.h"
#include "tune.h"

/* Of the processors, in some cell: from then on the clock's times are not the program's. */
static const double OTHERS_MATTER = 0.2;

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

const tune_setting *tune_best_of(const tune *t, const tune_findings *f, uint32_t cap,
                                 uint32_t places) {
    tune_setting *some = calloc(f->settings + 1, sizeof *some);
    size_t count = 0;
    for (size_t i = 0; i < f->settings && some != NULL; i++)
        if (f->setting[i].cell->cap == cap && f->setting[i].cell->places == places)
            some[count++] = f->setting[i];
    const tune_setting *found = some != NULL ? tune_choose(some, count, &t->o.want) : NULL;
    const tune_cell *cell = found != NULL ? found->cell : NULL;
    free(some);
    for (size_t i = 0; i < f->settings && cell != NULL; i++)
        if (f->setting[i].cell == cell)
            return &f->setting[i];
    return NULL;
}

/* ---- texts ----------------------------------------------------------------------------------- */

const tune_column tune_layout_columns[TUNE_LAYOUT_COLUMNS] = {
    {"layout", -12, "levels: meta-nodes of L levels; packed: blocks of so many bytes, filled"},
    {"blocks", 9, "in the file"},
    {"block KB", 9, "the longest block: what a place holder takes"},
    {"fill %", 7, "payload of a block over what a place holder takes, mean over blocks"},
    {"file MB", 9, "size of the file"},
    {"bytes/vertex", 13, "the file over the vertices of the input"},
    {"depth", 6, "blocks on the longest way down"},
};
const tune_column tune_columns[TUNE_COLUMNS] = {
    {"layout", -12, "as above"},
    {"cap", 7, "--ram of the replay; -: none"},
    {"places", 7,
     "place holders as asked for: a number, or what part of the smallest file they hold"},
    {"K", 7, "place holders"},
    {"K MB", 8, "their memory"},
    {"missed %", 9, "misses over all that was wanted: blocks that were not there in time"},
    {"refused", 9,
     "switches a frame for which no place holder could be had: K is too small for them"},
    {"err p50", 9, "error on the screen, pixels: median of the frames"},
    {"err p95", 9, "the same, in 95 % of the frames; none: no bound"},
    {"ms p50", 8, "time of Navigate a frame: median"},
    {"ms p99", 8, "the same, in 99 % of the frames"},
    {"k tri", 8, "thousands of triangles, mean"},
    {"read MB", 8, "from the disk"},
    {"peak MB", 8, "peak of the process"},
    {"others %", 9,
     "of the processors, what other programs took meanwhile: times are not to be "
     "trusted where this is high"},
};

void tune_pixels(double px, tune_text text) {
    snprintf(text, TUNE_TEXT_MAX, isinf(px) ? "none" : px < 10000 ? "%.2f" : "%.1e", px);
}

int tune_layout_texts(const tune_layout *l, tune_text *text) {
    const mn_header *h = &l->header;
    snprintf(text[0], TUNE_TEXT_MAX, "%.20s", l->name);
    if (l->code != MN_OK)
        return 1;
    snprintf(text[1], TUNE_TEXT_MAX, "%u", h->blocks);
    snprintf(text[2], TUNE_TEXT_MAX, "%u", h->block_bytes_max >> 10);
    snprintf(text[3], TUNE_TEXT_MAX, "%.1f", 100 * h->fill_mean);
    snprintf(text[4], TUNE_TEXT_MAX, "%.2f", mega((double)h->file_bytes));
    snprintf(text[5], TUNE_TEXT_MAX, "%.1f", (double)h->file_bytes / h->leaves);
    snprintf(text[6], TUNE_TEXT_MAX, "%u", h->block_depth);
    return TUNE_LAYOUT_COLUMNS;
}

int tune_cell_texts(const tune *t, const tune_cell *c, tune_text *text) {
    const double *f = c->figure;
    const uint64_t cap = c->resident ? 0 : t->o.cap[c->cap];
    snprintf(text[0], TUNE_TEXT_MAX, "%.20s", t->layout[c->layout].name);
    snprintf(text[1], TUNE_TEXT_MAX, cap > 0 ? "%.4gM" : "-", mega((double)cap));
    snprintf(text[2], TUNE_TEXT_MAX, "%s", c->resident ? "all" : t->o.places[c->places].text);
    if (c->state != TUNE_MEASURED)
        return 3;
    snprintf(text[3], TUNE_TEXT_MAX, c->resident ? "-" : "%.0f", f[TUNE_K]);
    snprintf(text[4], TUNE_TEXT_MAX, c->resident ? "-" : "%.2f",
             mega(f[TUNE_K] * f[TUNE_BLOCK_BYTES]));
    snprintf(text[5], TUNE_TEXT_MAX, "%.3f", 100 * f[TUNE_MISS_RATE]);
    snprintf(text[6], TUNE_TEXT_MAX, "%.0f", f[TUNE_REFUSED_POOL] / f[TUNE_FRAMES]);
    tune_pixels(f[TUNE_ERROR_P50], text[7]);
    tune_pixels(f[TUNE_ERROR_P95], text[8]);
    snprintf(text[9], TUNE_TEXT_MAX, "%.3f", tune_p50_ms(c, t->o.want.cpu));
    snprintf(text[10], TUNE_TEXT_MAX, "%.3f", tune_p99_ms(c, t->o.want.cpu));
    snprintf(text[11], TUNE_TEXT_MAX, "%.1f", f[TUNE_TRIANGLES] / 1000);
    snprintf(text[12], TUNE_TEXT_MAX, "%.1f", mega(f[TUNE_READ_BYTES]));
    snprintf(text[13], TUNE_TEXT_MAX, "%.1f", mega(f[TUNE_RSS_BYTES]));
    snprintf(text[14], TUNE_TEXT_MAX, "%.0f", 100 * f[TUNE_OTHERS]);
    return TUNE_COLUMNS;
}

bool tune_cell_is_of(const tune_cell *c, uint32_t path, mn_prefetch rule) {
    return c->path == path && !c->resident && c->prefetch == rule;
}

void tune_want_words(const tune_want *w, char *text, size_t room) {
    const struct {
        const char *format;
        double bound;
    } bounds[] = {{"p99 up to %g ms, ", w->p99_ms},
                  {"error up to %g px, ", w->error_px},
                  {"misses up to %g %%, ", 100 * w->miss_rate},
                  {"peak up to %g MB, ", mega(w->ram_bytes)}};
    size_t length = 0;
    for (size_t i = 0; i < sizeof bounds / sizeof bounds[0] && length < room; i++)
        if (isfinite(bounds[i].bound))
            length +=
                (size_t)snprintf(text + length, room - length, bounds[i].format, bounds[i].bound);
    if (length < room)
        snprintf(text + length, room - length, "least %s", tune_objective_name(w->objective));
}

static bool others_matter(const tune *t, double *least, double *most) {
    *least = INFINITY;
    *most = 0;
    for (size_t i = 0; i < t->cells; i++)
        if (t->cell[i].state == TUNE_MEASURED) {
            *least = fmin(*least, t->cell[i].figure[TUNE_OTHERS]);
            *most = fmax(*most, t->cell[i].figure[TUNE_OTHERS]);
        }
    return *most >= OTHERS_MATTER;
}

void tune_clock_choose(tune *t) {
    double least, most;
    if (t->o.clock == TUNE_CLOCK_AUTO)
        t->o.want.cpu = others_matter(t, &least, &most);
}

bool tune_others_words(const tune *t, char *text, size_t room) {
    double least, most;
    if (!others_matter(t, &least, &most) || t->o.clock == TUNE_CLOCK_CPU)
        return false;
    snprintf(text, room, "others had %.0f to %.0f %% of the processors: times are %s", 100 * least,
             100 * most,
             t->o.want.cpu ? "Navigate's own of the processor, not the clock's (--clock wall)"
                           : "as much theirs; --clock cpu leaves them out");
    return true;
}

/* ---- the table ------------------------------------------------------------------------------- */

static void row(const tune_column *columns, tune_text *text, int count, const char *rest,
                FILE *out) {
    for (int i = 0; i < count; i++)
        fprintf(out, "%*s", columns[i].width, text[i]);
    fprintf(out, "%s%s\n", rest[0] != 0 ? "  " : "", rest);
}

static void heads(const tune_column *columns, int count, FILE *out) {
    for (int i = 0; i < count; i++)
        fprintf(out, "%*s", columns[i].width, columns[i].head);
    fputc('\n', out);
}

static void cell_row(const tune *t, const tune_cell *c, FILE *out) {
    tune_text text[TUNE_COLUMNS];
    const int count = tune_cell_texts(t, c, text);
    row(tune_columns, text, count, count < TUNE_COLUMNS ? c->says : "", out);
}

static void cells_table(const tune *t, uint32_t path, mn_prefetch rule, FILE *out) {
    size_t count = 0;
    for (size_t i = 0; i < t->cells; i++)
        count += tune_cell_is_of(&t->cell[i], path, rule);
    if (count == 0)
        return;
    fprintf(out, "\n%s, %u frame%s, prefetch %s, times of the %s\n", t->o.path[path].label,
            t->o.path[path].frames, cli_s(t->o.path[path].frames), tune_prefetch_name(rule),
            t->o.want.cpu ? "processor" : "clock");
    heads(tune_columns, TUNE_COLUMNS, out);
    for (size_t i = 0; i < t->cells; i++)
        if (tune_cell_is_of(&t->cell[i], path, rule) ||
            (t->cell[i].resident && t->cell[i].path == path))
            cell_row(t, &t->cell[i], out);
}

static void setting_row(const tune *t, const tune_setting *s, FILE *out) {
    char words[200];
    tune_text px;
    tune_setting_words(t, s, words, sizeof words);
    tune_pixels(s->error_px, px);
    fprintf(out, "  %-54s error %8s px, missed %6.3f %%, p99 %7.3f ms, peak %6.1f MB\n", words, px,
            100 * s->miss_rate, s->p99_ms, mega(s->ram_bytes));
}

/* With the same memory, which layout? Then the best of all. By their worst path. */
static void best_table(const tune *t, const tune_findings *f, FILE *out) {
    char words[200];
    fputc('\n', out);
    if (tune_others_words(t, words, sizeof words))
        fprintf(out, "%s\n", words);
    tune_want_words(&t->o.want, words, sizeof words);
    fprintf(out, "best (%s), by the worst path, with as many place holders\n", words);
    for (uint32_t cap = 0; cap < t->o.caps; cap++)
        for (uint32_t places = 0; places < t->o.places_count; places++) {
            const tune_setting *best = tune_best_of(t, f, cap, places);
            if (best != NULL)
                setting_row(t, best, out);
        }
    fputs("of all\n", out);
    if (f->best != NULL)
        setting_row(t, f->best, out);
    else
        fputs("  no setting keeps to that on all paths\n", out);
}

void tune_table(const tune *t, const tune_findings *f, FILE *out) {
    tune_text text[TUNE_LAYOUT_COLUMNS];
    fputc('\n', out);
    heads(tune_layout_columns, TUNE_LAYOUT_COLUMNS, out);
    for (uint32_t i = 0; i < t->layouts; i++)
        row(tune_layout_columns, text, tune_layout_texts(&t->layout[i], text), t->layout[i].says,
            out);
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
        json_cap(j, "ram_cap_bytes", t->o.cap[c->cap]);
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
    json_f64(j, keys[2], best->cell->figure[TUNE_K]);
    json_cap(j, keys[3], t->o.cap[best->cell->cap]);
    const double values[] = {best->error_px, best->miss_rate, best->p99_ms, best->ram_bytes};
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++)
        json_f64(j, keys[i + 4], values[i]);
}

void tune_json(const tune *t, const tune_findings *f, FILE *out) {
    json j;
    json_begin(&j, out);
    json_str(&j, "input", t->o.in);
    json_str(&j, "program", t->program);
    json_str(&j, "machine", t->machine);
    json_str(&j, "clock", t->o.want.cpu ? "cpu" : "wall");
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
