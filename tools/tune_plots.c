/* The plots of metanode tune: see tune.h. Hidden here: gnuplot. Each plot is a script that holds
 * its own data, kept in DIR/plots beside what gnuplot makes of it: `gnuplot NAME.gp` alone draws it
 * on the terminal of one's choice. Memory: the SVGs, until tune_plots_free. */
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "child.h"
#include "cli.h"
#include "tune.h"

/* Levels are warm and dashed, packed cold and whole; darker: more levels, more bytes. */
static const char *const warm[] = {"#fdb863", "#e08214", "#b2182b", "#762a83",
                                   "#d6604d", "#8c510a", "#bf812d", "#67001f"};
static const char *const cold[] = {"#66c2a5", "#1b9e77", "#2166ac", "#00b4d8",
                                   "#053061", "#5aae61", "#00441b", "#35978f"};
static const double ERROR_SHOWN_PX = 1000; /* what is larger is drawn there */

enum { COLORS = sizeof warm / sizeof warm[0], HEAT_COLUMN_PX = 62, PANEL_PX = 520 };

typedef struct quantity {
    const char *name, *title, *axis;
    const char *scale; /* of the axis: gnuplot's */
} quantity;
enum { MISSES, ERROR, TIME, CURVES, TRIANGLES = CURVES, QUANTITIES }; /* curves of the first */

/* Logarithms; but what may be 0 has a scale of roots, whose tics must be named. */
#define LOGARITHMS "set logscale y 10"
#define ROOTS                                                                                      \
    "set nonlinear y via sqrt(y) inverse y*y\nset yrange [0:1<*]\n"                                \
    "set ytics (0, 0.5, 2, 5, 10, 20, 50, 100)"
static const quantity quantities[QUANTITIES] = {
    {"misses", "misses of all that was wanted", "missed, %", ROOTS},
    {"error", "error on the screen, 95 % of the frames", "error, pixels", LOGARITHMS},
    {"time", "Navigate, 99 % of the frames", "ms a frame", LOGARITHMS},
    {"triangles", "triangles that are drawn", "thousands of triangles, mean", LOGARITHMS},
};

static double value_of(const tune *t, const tune_cell *c, int which) {
    if (c->state != TUNE_MEASURED)
        return NAN;
    switch (which) {
    case MISSES:
        return 100 * c->figure[TUNE_MISS_RATE];
    case ERROR:
        return fmin(c->figure[TUNE_ERROR_P95], ERROR_SHOWN_PX);
    case TIME:
        return tune_p99_ms(c, t->o.want.cpu);
    default:
        return c->figure[TUNE_TRIANGLES] / 1000;
    }
}

/* ---- scripts --------------------------------------------------------------------------------- */

/* A text between gnuplot's single quotes. */
static void quote(FILE *f, const char *text) {
    fputc('\'', f);
    for (; *text != 0; text++)
        fprintf(f, *text == '\'' ? "''" : "%c", *text);
    fputc('\'', f);
}

static void number(FILE *f, double value) {
    if (isfinite(value))
        fprintf(f, " %.6g", value);
    else
        fputs(" NaN", f);
}

static void open_script(FILE *f, const char *title, int rows, int columns) {
    fputs("set termoption noenhanced\nset encoding utf8\n"
          "set tics nomirror\nset border 3 lw 0.7 lc rgb '#555555'\nset tics textcolor rgb "
          "'#222222'\n"
          "set grid lc rgb '#dddddd' lw 0.6\n",
          f);
    fprintf(f, "set multiplot layout %d,%d title ", rows, columns);
    quote(f, title);
    fputs(" font ',14'\n", f);
}

static const char *color_of(const tune *t, uint32_t layout) {
    uint32_t rank = 0;
    for (uint32_t i = 0; i < layout; i++)
        rank += t->layout[i].blocking == t->layout[layout].blocking;
    return (t->layout[layout].blocking == MN_BLOCKING_LEVELS ? warm : cold)[rank % COLORS];
}

static void name_of(const tune_layout *l, char *name, size_t room) {
    if (l->blocking == MN_BLOCKING_LEVELS)
        snprintf(name, room, "L = %u", l->size);
    else
        snprintf(name, room, "packed %uK", l->size >> 10);
}

/* ---- curves: a quantity against K, and against the memory that K takes ----------------------- */

/* Points of one layout and cap, by K. */
static int by_k(const void *a, const void *b) {
    const tune_cell *const *x = a, *const *y = b;
    const double dx = (*x)->figure[TUNE_K], dy = (*y)->figure[TUNE_K];
    return (dx > dy) - (dx < dy);
}

static size_t points_of(const tune *t, uint32_t layout, uint32_t cap, uint32_t path,
                        mn_prefetch rule, const tune_cell **out) {
    size_t n = 0;
    for (size_t i = 0; i < t->cells; i++) {
        const tune_cell *c = &t->cell[i];
        if (!c->resident && c->layout == layout && c->cap == cap && c->path == path &&
            c->prefetch == rule && c->state == TUNE_MEASURED)
            out[n++] = c;
    }
    qsort(out, n, sizeof *out, by_k);
    size_t kept = 0; /* min may be as many as a share */
    for (size_t i = 0; i < n; i++)
        if (kept == 0 || by_k(&out[kept - 1], &out[i]) != 0)
            out[kept++] = out[i];
    return kept;
}

static double resident_value(const tune *t, uint32_t path, int which) {
    for (size_t i = 0; i < t->cells; i++)
        if (t->cell[i].resident && t->cell[i].path == path)
            return value_of(t, &t->cell[i], which);
    return NAN;
}

static double pool_bytes(const tune_cell *c) {
    return c->figure[TUNE_K] * c->figure[TUNE_BLOCK_BYTES];
}

/* In which memory is told: what keeps the numbers small. */
static double unit_of(const tune *t) {
    double most = 0;
    for (size_t i = 0; i < t->cells; i++)
        if (!t->cell[i].resident && t->cell[i].state == TUNE_MEASURED)
            most = fmax(most, pool_bytes(&t->cell[i]));
    return most < 4 * 1048576 ? 1024 : 1048576;
}

/* The data of all series; sets which there are. Returns how many. */
static int series_data(const tune *t, uint32_t path, mn_prefetch rule, int which, double unit_bytes,
                       bool there[TUNE_LAYOUTS_MAX][TUNE_LIST_MAX], FILE *f) {
    const tune_cell **points = calloc(t->cells + 1, sizeof *points);
    int series = 0;
    for (uint32_t l = 0; l < t->layouts && points != NULL; l++)
        for (uint32_t cap = 0; cap < t->o.caps; cap++) {
            const size_t n = points_of(t, l, cap, path, rule, points);
            there[l][cap] = n > 0;
            series += n > 0;
            if (n == 0)
                continue;
            fprintf(f, "$l%uc%u << END\n", l, cap);
            for (size_t i = 0; i < n; i++) {
                number(f, points[i]->figure[TUNE_K]);
                number(f, pool_bytes(points[i]) / unit_bytes);
                number(f, value_of(t, points[i], which));
                fputc('\n', f);
            }
            fputs("END\n", f);
        }
    free(points);
    return series;
}

static void panel(const tune *t, bool there[TUNE_LAYOUTS_MAX][TUNE_LIST_MAX], int column,
                  double resident, FILE *f) {
    const char *lead = "plot ";
    for (uint32_t l = 0; l < t->layouts; l++)
        for (uint32_t cap = 0; cap < t->o.caps; cap++) {
            char name[TUNE_NAME_MAX], at[32] = "";
            if (!there[l][cap])
                continue;
            name_of(&t->layout[l], name, sizeof name);
            if (t->o.caps > 1)
                snprintf(at, sizeof at, ", %.4g MB", (double)t->o.cap[cap] / 1048576);
            fprintf(f,
                    "%s$l%uc%u using %d:3 with linespoints lw 2 ps 0.7 pt %u dt %d lc rgb '%s' "
                    "title '%s%s'",
                    lead, l, cap, column, 5 + 2 * (cap % 5),
                    t->layout[l].blocking == MN_BLOCKING_LEVELS ? 2 : 1, color_of(t, l), name, at);
            lead = ", \\\n     ";
        }
    if (isfinite(resident))
        fprintf(f, ", \\\n     %.6g with lines lw 1.5 dt 3 lc rgb 'black' title 'all in memory'",
                resident);
    fputc('\n', f);
}

/* false: nothing to draw. */
static bool curves(const tune *t, uint32_t path, mn_prefetch rule, int which, FILE *f) {
    bool there[TUNE_LAYOUTS_MAX][TUNE_LIST_MAX] = {{false}};
    const quantity *q = &quantities[which];
    const double resident = which == MISSES ? NAN : resident_value(t, path, which);
    const double unit_bytes = unit_of(t);
    if (series_data(t, path, rule, which, unit_bytes, there, f) == 0)
        return false;
    char title[300];
    snprintf(title, sizeof title, "%s: %s (prefetch %s%s)", t->o.path[path].label, q->title,
             tune_prefetch_name(rule),
             which != TIME   ? ""
             : t->o.want.cpu ? ", of the processor"
                             : ", by the clock");
    open_script(f, title, 1, 2);
    fprintf(f,
            "set logscale x 2\nset format x '%%g'\nset xtics rotate by -35\n"
            "set offsets graph 0.04, graph 0.04, 0, 0\nset ylabel '%s%s'\n%s\n"
            "set tmargin at screen 0.88\nset bmargin at screen 0.19\n",
            q->axis, which == ERROR ? " (1000: that, or more)" : "", q->scale);
    fprintf(f,
            "unset key\nset lmargin at screen 0.07\nset rmargin at screen 0.42\n"
            "set xlabel 'memory of the place holders, %s'\n",
            unit_bytes > 1024 ? "MB" : "KB");
    panel(t, there, 2, resident, f);
    fputs("set key outside right center samplen 2.5 spacing 1.15\n"
          "set lmargin at screen 0.495\nset rmargin at screen 0.845\n"
          "set xlabel 'K, place holders'\n",
          f);
    panel(t, there, 1, resident, f);
    fputs("unset multiplot\n", f);
    return true;
}

/* ---- heat maps: layouts by numbers of place holders ------------------------------------------ */

static const tune_cell *cell_at(const tune *t, uint32_t layout, uint32_t cap, uint32_t places,
                                uint32_t path, mn_prefetch rule) {
    for (size_t i = 0; i < t->cells; i++) {
        const tune_cell *c = &t->cell[i];
        if (!c->resident && c->layout == layout && c->cap == cap && c->places == places &&
            c->path == path && c->prefetch == rule)
            return c;
    }
    return NULL;
}

/* Text of a square. */
static void square(double value, int which, char *text, size_t room) {
    if (isnan(value))
        snprintf(text, room, "failed");
    else if (which == ERROR && value >= ERROR_SHOWN_PX)
        snprintf(text, room, "≥1000");
    else
        snprintf(text, room,
                 value <= 0      ? "0"
                 : value < 0.005 ? "<0.01"
                 : value < 10    ? "%.2f"
                 : value < 100   ? "%.1f"
                                 : "%.0f",
                 value);
}

/* Columns are caps, and places within them. */
static void heat_data(const tune *t, uint32_t path, mn_prefetch rule, int which, FILE *f) {
    fprintf(f, "$%s << END\n", quantities[which].name);
    for (uint32_t l = 0; l < t->layouts; l++)
        for (uint32_t cap = 0; cap < t->o.caps; cap++)
            for (uint32_t p = 0; p < t->o.places_count; p++) {
                const tune_cell *c = cell_at(t, l, cap, p, path, rule);
                const double value = c == NULL ? NAN : value_of(t, c, which);
                char text[16];
                square(value, which, text, sizeof text);
                fprintf(f, "%u %u", cap * t->o.places_count + p, l);
                number(f, which == ERROR && !isnan(value) ? log10(fmax(value, 0.1)) : value);
                fprintf(f, " %s\n", text);
            }
    fputs("END\n", f);
}

static void heat_axes(const tune *t, FILE *f) {
    const char *comma = "";
    char name[TUNE_NAME_MAX];
    fputs("set ytics (", f);
    for (uint32_t l = 0; l < t->layouts; l++, comma = ", ") {
        name_of(&t->layout[l], name, sizeof name);
        fprintf(f, "%s'%s' %u", comma, name, l);
    }
    fputs(")\nset xtics (", f);
    comma = "";
    for (uint32_t cap = 0; cap < t->o.caps; cap++)
        for (uint32_t p = 0; p < t->o.places_count; p++, comma = ", ") {
            if (t->o.places[p].kind == TUNE_FROM_CAP)
                snprintf(name, sizeof name, "%.4gM", (double)t->o.cap[cap] / 1048576);
            else if (t->o.caps == 1)
                snprintf(name, sizeof name, "%s", t->o.places[p].text);
            else
                snprintf(name, sizeof name, "%s\\n%.4gM", t->o.places[p].text,
                         (double)t->o.cap[cap] / 1048576);
            fprintf(f, "%s\"%s\" %u", comma, name, cap * t->o.places_count + p);
        }
    fprintf(f, ")\nset xrange [-0.5:%g]\nset yrange [%g:-0.5]\n",
            t->o.caps * t->o.places_count - 0.5, t->layouts - 0.5);
}

static bool heat(const tune *t, uint32_t path, mn_prefetch rule, FILE *f) {
    char title[300];
    if (t->layouts < 2 || t->o.caps * t->o.places_count < 2)
        return false;
    for (int which = 0; which < QUANTITIES; which++)
        heat_data(t, path, rule, which, f);
    char cap[40] = "";
    if (t->o.caps == 1 && t->o.cap[0] > 0)
        snprintf(cap, sizeof cap, ", under %.4g MB", (double)t->o.cap[0] / 1048576);
    snprintf(title, sizeof title, "%s: layouts and place holders (prefetch %s%s)",
             t->o.path[path].label, tune_prefetch_name(rule), cap);
    open_script(f, title, 2, QUANTITIES / 2);
    fputs("unset grid\nunset key\nunset colorbox\nset tics scale 0\n"
          "set palette defined (0 '#f7fbff', 0.5 '#c6dbef', 1 '#6baed6')\n",
          f);
    heat_axes(t, f);
    fprintf(f, "set xlabel '%s' offset 0,%g\n",
            t->o.places[0].kind == TUNE_FROM_CAP
                ? "cap"
                : "place holders: a share of the smallest file, or their number",
            t->o.caps > 1 ? -0.7 : 0.0);
    for (int which = 0; which < QUANTITIES; which++)
        fprintf(f,
                "set title '%s%s'\nplot $%s using 1:2:3 with image pixels, '' using 1:2:4 with "
                "labels font "
                "',10'\n",
                quantities[which].axis,
                which == TIME    ? ", 99 %"
                : which == ERROR ? ", 95 %"
                                 : "",
                quantities[which].name);
    fputs("unset multiplot\n", f);
    return true;
}

/* ---- files, and prefetch rules --------------------------------------------------------------- */

/* What stands on a bar, or beside it: three digits. */
static void bar(FILE *f, unsigned at, double value, const char *color, const char *name) {
    char text[16] = "";
    if (isfinite(value))
        snprintf(text, sizeof text, value >= 100 ? "%.0f" : "%.3g", value);
    fprintf(f, "%u", at);
    number(f, value);
    fprintf(f, " %lu \"%s\" \"%s\"\n", strtoul(color + 1, NULL, 16), name, text);
}

/* Of such data. */
static void bars(FILE *f, const char *data, const char *title, bool logarithmic) {
    fprintf(f, "set title '%s'\n%s\n", title,
            logarithmic
                ? "set logscale y 10\nset yrange [*:*]\nset offsets 0.6, 0.6, graph 0.15, 0"
                : "unset logscale y\nset yrange [0:*]\nset offsets 0.6, 0.6, graph 0.12, 0");
    fprintf(f,
            "plot %s using 1:2:3:xtic(4) with boxes lc rgb variable, '' using 1:2:5 with labels "
            "offset 0,0.7 font ',9'\n",
            data);
}

static bool files(const tune *t, FILE *f) {
    const char *const names[] = {"$size", "$fill"};
    char name[TUNE_NAME_MAX];
    for (int which = 0; which < 2; which++) {
        fprintf(f, "%s << END\n", names[which]);
        for (uint32_t i = 0; i < t->layouts; i++) {
            const tune_layout *l = &t->layout[i];
            if (l->code != MN_OK)
                continue;
            name_of(l, name, sizeof name);
            bar(f, i,
                which == 0 ? (double)l->header.file_bytes / 1048576 : 100 * l->header.fill_mean,
                color_of(t, i), name);
        }
        fputs("END\n", f);
    }
    open_script(f, "what the layouts take", 1, 2);
    fputs("unset key\nset boxwidth 0.7\nset style fill solid 0.85 border lc rgb '#555555'\n"
          "set xtics rotate by -35\nset ylabel 'MB'\n",
          f);
    bars(f, names[0], "size of the file, MB", true);
    fputs("set ylabel '%'\n", f);
    bars(f, names[1], "fill: payload of a place holder, %", false);
    fputs("unset multiplot\n", f);
    return true;
}

/* The best setting under each prefetch rule. */
static bool rules(const tune *t, const tune_findings *found, FILE *f) {
    static const char *const colors[] = {"#2166ac", "#e08214", "#999999"}; /* by mn_prefetch */
    if (found->best == NULL || t->o.prefetches < 2)
        return false;
    const tune_cell *best = found->best->cell;
    for (int which = 0; which < CURVES; which++) {
        unsigned at = 0;
        fprintf(f, "$%s << END\n", quantities[which].name);
        for (uint32_t path = 0; path < t->o.paths; path++, at++)
            for (uint32_t r = 0; r < t->o.prefetches; r++, at++) {
                const mn_prefetch rule = t->o.prefetch[r];
                const tune_cell *c = cell_at(t, best->layout, best->cap, best->places, path, rule);
                char name[PATH_MAX + 16];
                snprintf(name, sizeof name, "%s, %s", t->o.path[path].label,
                         tune_prefetch_name(rule));
                bar(f, at, c == NULL ? NAN : value_of(t, c, which), colors[rule], name);
            }
        fputs("END\n", f);
    }
    char words[200], title[300], name[32];
    tune_setting_words(t, found->best, words, sizeof words);
    snprintf(title, sizeof title, "prefetch rules at %.*s",
             (int)(strstr(words, ", prefetch") - words), words);
    open_script(f, title, 1, CURVES);
    fputs("unset key\nset boxwidth 0.8\nset style fill solid 0.85 border lc rgb '#555555'\n"
          "set xtics rotate by -40\n",
          f);
    for (int which = 0; which < CURVES; which++) {
        snprintf(name, sizeof name, "$%s", quantities[which].name);
        bars(f, name, quantities[which].axis, false);
    }
    fputs("unset multiplot\n", f);
    return true;
}

/* ---- gnuplot --------------------------------------------------------------------------------- */

static mn_code keep(const tune *t, const char *name, const char *bytes, size_t count,
                    mn_status *st) {
    char path[PATH_MAX];
    FILE *f = tune_file_name(t, name, path, sizeof path) == 0 ? fopen(path, "we") : NULL;
    if (f == NULL)
        return mn_fail(st, mn_code_of_write(errno), "%s/%s: cannot be written: %s; %s", t->o.folder,
                       name, strerror(errno), cli_write_advice(errno));
    fwrite(bytes, 1, count, f);
    return cli_written_all(f, "tune:", path, st);
}

/* Runs the script on a terminal; what comes out stands in a file too. */
static mn_code draw(const tune *t, tune_plots *p, tune_plot *plot, bool png, mn_status *st) {
    char script[PATH_MAX], file[TUNE_NAME_MAX + 16], terminal[200];
    snprintf(file, sizeof file, "plots/%s.gp", plot->name);
    if (tune_file_name(t, file, script, sizeof script) < 0)
        return mn_fail(st, MN_USAGE, "%.80s…: too long a name", t->o.folder);
    snprintf(terminal, sizeof terminal,
             "set terminal %s size %u,%u font 'sans,%s' background '#ffffff'",
             png ? "pngcairo" : "svg noenhanced", plot->width, plot->height, "11");
    const char *const words[] = {"gnuplot", "-e", terminal, script, NULL};
    child run;
    child_end end;
    int which;
    mn_code code = child_start(&run, words, true, st);
    if (code == MN_OK)
        code = child_wait(&run, 1, &which, &end, st);
    if (code != MN_OK)
        return code;
    snprintf(file, sizeof file, "plots/%s.%s", plot->name, png ? "png" : "svg");
    p->off[png] = end.code != 0 || end.out_bytes == 0;
    if (cli_interrupted() != 0)
        code = mn_fail(st, MN_FAILED, "interrupted");
    else if (end.code == 127)
        snprintf(p->says, sizeof p->says,
                 "no plots but their scripts: gnuplot is not there; install gnuplot-nox, and the "
                 "same command draws them");
    else if (p->off[png])
        snprintf(p->says, sizeof p->says, "no %s of plots: gnuplot: %.200s", png ? "PNG" : "SVG",
                 end.says);
    else
        code = keep(t, file, end.out, end.out_bytes, st);
    if (code == MN_OK && !p->off[png] && !png) {
        plot->svg = end.out;
        plot->svg_bytes = end.out_bytes;
        return MN_OK;
    }
    child_end_free(&end);
    return code;
}

/* For the first plot: where there is none, there is no folder. */
static mn_code make_folder(const tune *t, mn_status *st) {
    char folder[PATH_MAX];
    if (tune_file_name(t, "plots", folder, sizeof folder) >= 0 &&
        (mkdir(folder, 0777) == 0 || errno == EEXIST))
        return MN_OK;
    return mn_fail(st, mn_code_of_write(errno), "%s/plots: cannot be made: %s; %s", t->o.folder,
                   strerror(errno), cli_write_advice(errno));
}

/* A plot of that name; its script was written whole into `script`. */
static mn_code add_plot(const tune *t, tune_plots *p, tune_plot plot, const char *script,
                        mn_status *st) {
    char file[TUNE_NAME_MAX + 16];
    snprintf(file, sizeof file, "plots/%s.gp", plot.name);
    mn_code code = make_folder(t, st);
    if (code == MN_OK)
        code = keep(t, file, script, strlen(script), st);
    if (p->count == TUNE_PLOTS_MAX)
        return code;
    tune_plot *added = &p->plot[p->count];
    *added = plot;
    for (int png = 0; png < 2; png++)
        if (code == MN_OK && !p->off[png])
            code = draw(t, p, added, png == 1, st);
    p->count += added->svg != NULL;
    return code;
}

/* Names of files: letters and digits; path files by their number. */
static void file_name(const tune *t, uint32_t path, mn_prefetch rule, const char *what,
                      char *name) {
    const tune_path *p = &t->o.path[path];
    if (strcmp(p->name, p->key) == 0)
        snprintf(name, TUNE_NAME_MAX, "%s-%s-%s", what, p->name, tune_prefetch_name(rule));
    else
        snprintf(name, TUNE_NAME_MAX, "%s-path%u-%s", what, path + 1, tune_prefetch_name(rule));
}

/* One plot: number `which` of a path and rule; the one after the curves is the heat map. */
static mn_code of_path(const tune *t, tune_plots *p, uint32_t path, mn_prefetch rule, int which,
                       mn_status *st) {
    char *script = NULL;
    size_t bytes = 0;
    FILE *f = open_memstream(&script, &bytes);
    if (f == NULL)
        return mn_fail(st, MN_FAILED, "tune: no memory for a plot");
    tune_plot plot = {.width = 2 * PANEL_PX + 160, .height = 400};
    const bool drawn = which < CURVES ? curves(t, path, rule, which, f) : heat(t, path, rule, f);
    if (which == CURVES) {
        const uint32_t columns = t->o.caps * t->o.places_count;
        const uint32_t width = QUANTITIES / 2 * (110 + HEAT_COLUMN_PX * columns);
        plot.width = width > plot.width ? width : plot.width;
        plot.height = 220 + 60 * t->layouts;
    }
    fclose(f);
    file_name(t, path, rule, which < CURVES ? quantities[which].name : "heat", plot.name);
    const mn_code code = drawn ? add_plot(t, p, plot, script, st) : MN_OK;
    free(script);
    return code;
}

static mn_code of_all(const tune *t, tune_plots *p, const tune_findings *found, bool of_files,
                      mn_status *st) {
    char *script = NULL;
    size_t bytes = 0;
    FILE *f = open_memstream(&script, &bytes);
    if (f == NULL)
        return mn_fail(st, MN_FAILED, "tune: no memory for a plot");
    tune_plot plot = {.width = 2 * PANEL_PX + (of_files ? 160 : 360), .height = 400};
    const bool drawn = of_files ? files(t, f) : rules(t, found, f);
    fclose(f);
    snprintf(plot.name, sizeof plot.name, "%s", of_files ? "files" : "rules");
    const mn_code code = drawn ? add_plot(t, p, plot, script, st) : MN_OK;
    free(script);
    return code;
}

mn_code tune_plots_make(const tune *t, const tune_findings *found, tune_plots *p, mn_status *st) {
    const uint32_t rules_drawn = t->o.cross ? t->o.prefetches : 1;
    mn_code code = of_all(t, p, found, true, st);
    for (uint32_t path = 0; path < t->o.paths; path++)
        for (uint32_t r = 0; r < rules_drawn; r++)
            for (int which = 0; which <= CURVES && code == MN_OK; which++)
                code = of_path(t, p, path, t->o.prefetch[r], which, st);
    if (code == MN_OK)
        code = of_all(t, p, found, false, st);
    return code;
}

void tune_plots_free(tune_plots *p) {
    for (uint32_t i = 0; i < p->count; i++)
        free(p->plot[i].svg);
    p->count = 0;
}
