/* The cells of metanode tune: see tune.h. Hidden here: their order, and that each is a process of
 * its own, under its own cap, whose figures are its --json.
 *
 * One replay runs at a time, and nothing else of ours: Navigate has one processor, the I/O thread
 * another, and this process sleeps until both are done. What others took of the processors
 * meanwhile is asked of the kernel and told with the figures. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "child.h"
#include "cli.h"
#include "host.h"
#include "tune.h"

enum { WORDS_MAX = 40 };
static const double SECONDS_A_CELL = 0.15; /* beside its frames: start, opening, end */

/* Keys of replay --json; those after TUNE_PLANNED_BYTES are ours. */
const char *const tune_figure_names[TUNE_FIGURES] = {
    [TUNE_K] = "k",
    [TUNE_BLOCK_BYTES] = "block_bytes_max",
    [TUNE_FRAMES] = "frames",
    [TUNE_MISS_RATE] = "miss_rate_overall",
    [TUNE_MISS_RATE_MEAN] = "miss_rate_mean",
    [TUNE_MISSES_COUNT] = "misses",
    [TUNE_ERROR_P50] = "error_px_p50",
    [TUNE_ERROR_P95] = "error_px_p95",
    [TUNE_ERROR_MAX] = "error_px_max",
    [TUNE_NAV_P50] = "nav_ms_p50",
    [TUNE_NAV_P99] = "nav_ms_p99",
    [TUNE_NAV_MAX] = "nav_ms_max",
    [TUNE_CPU_P50] = "nav_cpu_ms_p50",
    [TUNE_CPU_P99] = "nav_cpu_ms_p99",
    [TUNE_CPU_MAX] = "nav_cpu_ms_max",
    [TUNE_TRIANGLES] = "triangles_mean",
    [TUNE_ADAPT] = "adapt_mean",
    [TUNE_REFUSED_POOL] = "refused_pool",
    [TUNE_REFUSED_FRONT] = "refused_front",
    [TUNE_READS] = "reads",
    [TUNE_READ_BYTES] = "read_bytes",
    [TUNE_PREFETCHED] = "prefetches_loaded",
    [TUNE_PREFETCHED_USED] = "prefetches_used_share",
    [TUNE_NEED] = "blocks_with_ancestors_max",
    [TUNE_LOCK_US] = "nav_lock_wait_us_max",
    [TUNE_RSS_BYTES] = "rss_peak_bytes",
    [TUNE_PLANNED_BYTES] = "ram_planned_bytes",
    [TUNE_SECONDS] = "seconds",
    [TUNE_OTHERS] = "others_share",
};

double tune_p50_ms(const tune_cell *c, bool cpu) {
    return c->figure[cpu ? TUNE_CPU_P50 : TUNE_NAV_P50];
}

double tune_p99_ms(const tune_cell *c, bool cpu) {
    return c->figure[cpu ? TUNE_CPU_P99 : TUNE_NAV_P99];
}

/* ---- which there are ------------------------------------------------------------------------- */

/* Place holders to ask replay for; 0: as the words say. */
static uint32_t places_of(const tune *t, const tune_layout *l, const tune_places *p) {
    if (p->kind == TUNE_COUNT)
        return (uint32_t)p->value;
    if (p->kind != TUNE_SHARE)
        return 0;
    const double k = p->value * (double)t->smallest_bytes / l->header.block_bytes_max;
    return k >= 1 ? (uint32_t)fmin(k, UINT32_MAX) : 1;
}

/* One cell a path, side by side. */
static mn_code add_paths(tune *t, tune_cell cell, mn_status *st) {
    const tune_layout *l = &t->layout[cell.layout];
    if (t->cells + t->o.paths > TUNE_CELLS_MAX)
        return mn_fail(st, MN_USAGE, "tune: more than %d cells; ask for less at a time",
                       TUNE_CELLS_MAX);
    if (t->cell == NULL)
        t->cell = calloc(TUNE_CELLS_MAX, sizeof *t->cell);
    if (t->cell == NULL)
        return mn_fail(st, MN_FAILED, "tune: no memory for cells");
    if (!cell.resident)
        cell.k = places_of(t, l, &t->o.places[cell.places]);
    for (int i = 0; i < TUNE_FIGURES; i++)
        cell.figure[i] = NAN;
    if (l->code != MN_OK) {
        cell.state = TUNE_REFUSED;
        cell.code = (int)l->code;
        memcpy(cell.says, l->says, sizeof cell.says);
    }
    for (cell.path = 0; cell.path < t->o.paths; cell.path++)
        t->cell[t->cells++] = cell;
    return MN_OK;
}

static mn_code add_places(tune *t, tune_cell cell, mn_status *st) {
    mn_code code = MN_OK;
    for (cell.cap = 0; cell.cap < t->o.caps; cell.cap++)
        for (cell.places = 0; cell.places < t->o.places_count && code == MN_OK; cell.places++)
            code = add_paths(t, cell, st);
    return code;
}

mn_code tune_enumerate(tune *t, mn_status *st) {
    const uint32_t rules = t->o.cross ? t->o.prefetches : 1;
    tune_cell all = {.resident = true};
    all.layout = t->smallest;
    mn_code code = add_paths(t, all, st);
    for (uint32_t i = 0; i < t->layouts && code == MN_OK; i++)
        for (uint32_t r = 0; r < rules && code == MN_OK; r++)
            code = add_places(t, (tune_cell){.layout = i, .prefetch = t->o.prefetch[r]}, st);
    return code;
}

mn_code tune_enumerate_rules(tune *t, const tune_cell *at, mn_status *st) {
    tune_cell cell = {.layout = at->layout, .places = at->places, .cap = at->cap};
    mn_code code = MN_OK;
    for (uint32_t r = 1; r < t->o.prefetches && !t->o.cross && code == MN_OK; r++) {
        cell.prefetch = t->o.prefetch[r];
        code = add_paths(t, cell, st);
    }
    return code;
}

size_t tune_missing(const tune *t) {
    size_t missing = 0;
    for (size_t i = 0; i < t->cells; i++)
        missing += t->cell[i].state == TUNE_MISSING;
    return missing;
}

static double seconds_of(const tune *t, const tune_cell *c) {
    return SECONDS_A_CELL + t->o.path[c->path].frames * t->o.seconds_a_frame;
}

double tune_seconds_needed(const tune *t) {
    const double slower = t->thought_s > 0 ? fmax(1, t->measured_s / t->thought_s) : 1;
    double seconds = 0;
    for (size_t i = 0; i < t->cells; i++)
        if (t->cell[i].state == TUNE_MISSING)
            seconds += seconds_of(t, &t->cell[i]);
    return slower * seconds;
}

/* ---- one of them ----------------------------------------------------------------------------- */

/* Seconds that all processors together have been busy. */
static double busy_s(void) {
    unsigned long long user = 0, nice = 0, system = 0, irq = 0, soft = 0, stolen = 0;
    FILE *f = fopen("/proc/stat", "re");
    if (f != NULL) {
        if (fscanf(f, "cpu %llu %llu %llu %*u %*u %llu %llu %llu", &user, &nice, &system, &irq,
                   &soft, &stolen) != 6)
            user = 0;
        fclose(f);
    }
    return (double)(user + nice + system + irq + soft + stolen) / (double)sysconf(_SC_CLK_TCK);
}

/* A key's value in what figures_json has printed: a line of its own. INFINITY: null of an error,
 * which says that there is no bound; NAN: another null. false: no such line. */
static bool value_of(const char *json, const char *key, double *value) {
    char line[64];
    char *end = NULL;
    const int length = snprintf(line, sizeof line, "\n  \"%s\": ", key);
    const char *at = strstr(json, line);
    if (at == NULL)
        return false;
    at += length;
    if (strncmp(at, "null", 4) == 0) {
        *value = strncmp(key, "error_px", 8) == 0 ? INFINITY : NAN;
        return true;
    }
    *value = strtod(at, &end);
    return end != at && (*end == ',' || *end == '\n') && *value >= 0;
}

void tune_name_cap(const tune *t, char *says, size_t room) {
    char text[sizeof((mn_status *)0)->text];
    size_t length = 0;
    if (!t->o.caps_given)
        return;
    for (const char *at = says; *at != 0 && length + 8 < sizeof text;) {
        const bool is_cap = strncmp(at, "--ram ", 6) == 0;
        length +=
            (size_t)snprintf(text + length, sizeof text - length, is_cap ? "--caps " : "%c", *at);
        at += is_cap ? 6 : 1;
    }
    snprintf(says, room, "%.*s", (int)length, text);
}

/* Of a replay that has ended. */
static void take_figures(const tune *t, tune_cell *c, const child_end *end, double busy) {
    c->code = end->code;
    snprintf(c->says, sizeof c->says, "%.*s", (int)sizeof c->says - 1,
             end->code != 0 ? end->says : "");
    tune_name_cap(t, c->says, sizeof c->says);
    for (int i = 0; i < TUNE_SECONDS && c->code == 0; i++)
        if (!value_of(end->out, tune_figure_names[i], &c->figure[i])) {
            c->code = MN_FAILED;
            snprintf(c->says, sizeof c->says, "replay does not say %s", tune_figure_names[i]);
        }
    for (int i = 0; i < TUNE_SECONDS && c->code != 0; i++)
        c->figure[i] = NAN;
    const double others = (busy - end->cpu_seconds) / (end->seconds * (double)host_cpus(""));
    c->figure[TUNE_SECONDS] = end->seconds;
    c->figure[TUNE_OTHERS] = fmin(1, fmax(0, others)); /* the kernel's clock goes in steps */
    c->state = c->code == 0 ? TUNE_MEASURED : TUNE_REFUSED;
}

/* One replay, from start to end. */
static mn_code measure(tune *t, tune_cell *c, mn_status *st) {
    const tune_path *path = &t->o.path[c->path];
    const uint64_t cap_bytes = t->o.cap[c->cap];
    char frames[32], cap[32], k[32];
    const char *words[WORDS_MAX] = {NULL,          "metanode",
                                    "replay",      t->layout[c->layout].file,
                                    "--path",      path->name,
                                    "--frames",    frames,
                                    "--fps",       t->o.fps,
                                    "--size",      t->o.size,
                                    "--degrade",   t->o.degrade,
                                    "--tolerance", t->o.tolerance,
                                    "--open",      t->o.open,
                                    "--paced",     "--json",
                                    "--store",     c->resident ? "resident" : "paged",
                                    "--prefetch",  tune_prefetch_name(c->prefetch)};
    int n = 24, which;
    snprintf(frames, sizeof frames, "%u", path->frames);
    snprintf(cap, sizeof cap, "%llu", (unsigned long long)cap_bytes);
    snprintf(k, sizeof k, "%u", c->k);
    if (!c->resident && cap_bytes > 0) {
        words[n++] = "--ram";
        words[n++] = cap;
    }
    if (!c->resident && t->o.places[c->places].kind != TUNE_FROM_CAP) {
        words[n++] = "-K";
        words[n++] = c->k > 0 ? k : "min";
    }
    child run;
    child_end end;
    const double busy = busy_s();
    mn_code code = child_start(&run, words, true, st);
    run.limit_s = (double)t->o.limit_s;
    if (code == MN_OK)
        code = child_wait(&run, 1, &which, &end, st);
    if (code != MN_OK)
        return code;
    if (cli_interrupted() != 0)
        code = mn_fail(st, MN_FAILED, "interrupted");
    else
        take_figures(t, c, &end, busy_s() - busy);
    t->measured_s += end.seconds;
    t->thought_s += seconds_of(t, c);
    child_end_free(&end);
    return code;
}

static void progress(const tune *t, const tune_cell *c, size_t done, size_t all) {
    if (!isatty(STDERR_FILENO))
        return;
    const double ahead = tune_seconds_needed(t);
    fprintf(stderr, "\r%zu of %zu  %s %s %s %s  %.0f s left \033[K", done + 1, all,
            t->layout[c->layout].name, c->resident ? "resident" : t->o.places[c->places].text,
            t->o.path[c->path].label, c->resident ? "" : tune_prefetch_name(c->prefetch), ahead);
}

mn_code tune_measure(tune *t, mn_status *st) {
    const size_t all = tune_missing(t);
    size_t done = 0;
    mn_code code = MN_OK;
    for (size_t i = 0; i < t->cells && code == MN_OK; i++) {
        tune_cell *c = &t->cell[i];
        if (c->state != TUNE_MISSING)
            continue;
        progress(t, c, done++, all);
        code = measure(t, c, st);
        if (code == MN_OK)
            code = tune_results_add(t, c, st);
    }
    if (all > 0 && isatty(STDERR_FILENO))
        fputs("\r\033[K", stderr);
    return code;
}
