/* metanode tune: what its files share. Main thread only.
 *
 *   options ── folder ── tree ── layouts ── cells ── settings, the best ── table, plots, report
 *
 * A *layout* is the tree cut one way: a policy and a block size or a number of levels. A *cell* is
 * one replay of one layout: a path, a cap, a number of place holders, a prefetch rule. A *setting*
 * is what a user can choose, so all cells that differ in the path alone. */
#ifndef METANODE_TUNE_H
#define METANODE_TUNE_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "metanode/runtime.h"

enum {
    TUNE_LIST_MAX = 16, /* values of one option */
    TUNE_LAYOUTS_MAX = 2 * TUNE_LIST_MAX,
    TUNE_CELLS_MAX = 4096,
    TUNE_PREFETCHES = 3,
    TUNE_NAME_MAX = 64,
};

/* ---- options (tune_options.c) ---------------------------------------------------------------- */

typedef enum tune_places_kind {
    TUNE_SHARE, /* as many as hold that share of the smallest layout's blocks */
    TUNE_COUNT,
    TUNE_LEAST,
    TUNE_FROM_CAP,
    TUNE_RESIDENT, /* everything is read at the start: what the others are compared with */
} tune_places_kind;
typedef struct tune_places {
    tune_places_kind kind;
    double value;
    char text[16]; /* as it was asked for: "1/6", "min" */
} tune_places;

typedef struct tune_path {
    char name[PATH_MAX];     /* as replay takes it */
    char key[TUNE_NAME_MAX]; /* its name in the results: a file's has a hash of what stands in it */
    const char *label;       /* its name for readers: the end of that */
    uint32_t frames;         /* 0: until the first layout is there */
} tune_path;

typedef enum tune_objective {
    TUNE_ERROR = 0,
    TUNE_MISSES,
    TUNE_P99,
    TUNE_RAM,
} tune_objective;
/* What the best setting must keep to; INFINITY: no matter. */
typedef struct tune_want {
    double p99_ms, error_px, miss_rate, ram_bytes;
    tune_objective objective;
    bool cpu; /* times are the processor's, not the clock's */
} tune_want;
typedef enum tune_clock {
    TUNE_CLOCK_AUTO = 0, /* the clock's, unless others had the processors */
    TUNE_CLOCK_WALL,
    TUNE_CLOCK_CPU,
} tune_clock;

typedef struct tune_options {
    const char *in, *folder;
    mn_blocking policy[2];
    uint32_t policies;
    uint32_t block_bytes[TUNE_LIST_MAX], block_bytes_count;
    uint32_t levels[TUNE_LIST_MAX], levels_count;
    tune_places places[TUNE_LIST_MAX];
    uint32_t places_count;
    uint64_t cap[TUNE_LIST_MAX]; /* bytes; 0: none */
    uint32_t caps;
    bool caps_given; /* by --caps, not --ram */
    tune_path path[TUNE_LIST_MAX];
    uint32_t paths;
    mn_prefetch prefetch[TUNE_PREFETCHES];
    uint32_t prefetches;
    bool cross; /* every prefetch rule everywhere, not at the best setting alone */
    uint32_t frames;
    bool frames_given;
    const char *fps, *size, *tolerance, *degrade, *open; /* handed on as they are */
    double seconds_a_frame;
    uint64_t limit_s;               /* that one replay may take */
    uint64_t build_ram_bytes, jobs; /* 0: as build has it; as many as processors */
    tune_want want;
    tune_clock clock;
    bool fresh, json;
    int argc; /* the whole command, for the report */
    char **argv;
} tune_options;

/* *done: nothing is left to do; a code other than MN_OK has been said. Texts are the command
 * line's. */
mn_code tune_options_read(tune_options *o, int argc, char **argv, bool *done);
/* "3,5,8" and the like, each taken by `take`; NULL, or where the first stands that is not taken: at
 * most TUNE_LIST_MAX are. */
const char *tune_list(const char *text, bool (*take)(void *context, const char *word),
                      void *context);
/* "p99 under 4 ms, misses under 1 % at 24 MB", onto bounds that are INFINITY still; NULL, or where
 * the first stands that is not taken. */
const char *tune_want_take(tune_want *want, const char *text);
bool tune_places_parse(const char *word, tune_places *out);
const char *tune_prefetch_name(mn_prefetch prefetch);
const char *tune_objective_name(tune_objective objective);

/* ---- cells (tune_sweep.c) -------------------------------------------------------------------- */

/* What a replay says of itself, in the order of the results' columns; the last two are ours. */
typedef enum tune_figure {
    TUNE_K,
    TUNE_BLOCK_BYTES,
    TUNE_FRAMES,
    TUNE_MISS_RATE,
    TUNE_MISS_RATE_MEAN,
    TUNE_MISSES_COUNT,
    TUNE_ERROR_P50,
    TUNE_ERROR_P95,
    TUNE_ERROR_MAX,
    TUNE_NAV_P50,
    TUNE_NAV_P99,
    TUNE_NAV_MAX,
    TUNE_CPU_P50,
    TUNE_CPU_P99,
    TUNE_CPU_MAX,
    TUNE_TRIANGLES,
    TUNE_ADAPT,
    TUNE_REFUSED_POOL,
    TUNE_REFUSED_FRONT,
    TUNE_READS,
    TUNE_READ_BYTES,
    TUNE_PREFETCHED,
    TUNE_PREFETCHED_USED,
    TUNE_NEED, /* most blocks that a frame has in use, with their ancestors */
    TUNE_LOCK_US,
    TUNE_RSS_BYTES,
    TUNE_PLANNED_BYTES,
    TUNE_SECONDS,
    TUNE_OTHERS, /* share of the processors that others took meanwhile */
    TUNE_FIGURES,
} tune_figure;
extern const char *const tune_figure_names[TUNE_FIGURES];

typedef struct tune_layout {
    mn_blocking blocking;
    uint32_t size; /* levels, or bytes of a block */
    char name[TUNE_NAME_MAX];
    char file[PATH_MAX];
    mn_code code; /* why there is none, with says */
    char says[200];
    mn_header header; /* MN_OK only */
} tune_layout;

typedef enum tune_state { TUNE_MISSING = 0, TUNE_MEASURED, TUNE_REFUSED } tune_state;
typedef struct tune_cell {
    uint32_t layout, places, cap, path; /* in the options' lists; of the layouts */
    mn_prefetch prefetch;
    bool resident;
    uint32_t k; /* place holders asked for; 0: as places say */
    tune_state state;
    int code; /* TUNE_REFUSED: replay's exit code, and what it said */
    char says[200];
    double figure[TUNE_FIGURES]; /* NAN: it has none. An error without bound is INFINITY */
} tune_cell;

typedef struct tune {
    tune_options o;
    /* the folder */
    char tree[PATH_MAX]; /* the .vdt, or .mnt, that is cut */
    bool is_new;         /* the folder is of this run … */
    bool is_forgotten;   /* … and, or, nothing of it is left there */
    int stamp_fd, results_fd;
    char program[64], machine[200];
    /* the sweep */
    tune_layout layout[TUNE_LAYOUTS_MAX];
    uint32_t layouts;
    uint32_t smallest;       /* layout, that is */
    uint64_t smallest_bytes; /* of its blocks */
    tune_cell *cell;         /* cells that differ in the path alone stand side by side, by path;
                                those of `resident` come first */
    size_t cells, cells_room;
    double measured_s,
        thought_s; /* spent on the cells of this run; by how much was reckoned with */
} tune;

/* The tree, and its layouts: those that are not there yet are made, two at a time. */
mn_code tune_build(tune *t, mn_status *st);
/* MN_CAP_TOO_SMALL where no layout can be flown under any of the caps. */
mn_code tune_caps_will_do(const tune *t, mn_status *st);
/* Cells of what the options ask for; then of the other prefetch rules at a setting. */
mn_code tune_enumerate(tune *t, mn_status *st);
mn_code tune_enumerate_rules(tune *t, const tune_cell *at, mn_status *st);
/* In a text of replay's: the cap is called what it is called here. */
void tune_name_cap(const tune *t, char *says, size_t room);
size_t tune_missing(const tune *t);
/* For those that are missing; by how long those before them took. */
double tune_seconds_needed(const tune *t);
/* Measures those that are missing, one at a time, and keeps each. MN_FAILED "interrupted": the rest
 * is missing yet. */
mn_code tune_measure(tune *t, mn_status *st);
double tune_p50_ms(const tune_cell *cell, bool cpu);
double tune_p99_ms(const tune_cell *cell, bool cpu);

/* ---- the folder (tune_folder.c) -------------------------------------------------------------- */

/* Makes it, or takes up what stands in it, if it is of the same input, program, machine and
 * options; alone. MN_USAGE: of others. */
mn_code tune_folder_open(tune *t, mn_status *st);
/* An input that cannot be read: what was made for it goes, unless something was measured. */
void tune_folder_forget(tune *t);
void tune_folder_close(tune *t);
/* Cells that stand in the results are measured. MN_BAD_INPUT: a line that is none of ours. */
mn_code tune_results_load(tune *t, mn_status *st);
/* The line of a cell is in the file whole, or not at all. */
mn_code tune_results_add(tune *t, const tune_cell *cell, mn_status *st);
/* Where a line lies of a cell's results: its first columns. */
void tune_cell_key(const tune *t, const tune_cell *cell, char *key, size_t room);
/* A line of the results, with its newline; and one read again. false: it is none, or does not fit.
 */
bool tune_line_write(const tune *t, const tune_cell *cell, char *line, size_t room);
bool tune_line_read(const char *line, tune_cell *cell);
int tune_file_name(const tune *t, const char *name, char *path, size_t room); /* in the folder */

/* ---- the best (tune_choose.c) ---------------------------------------------------------------- */

/* A setting: its worst figures over the paths. */
typedef struct tune_setting {
    const tune_cell *cell; /* of its first path */
    bool whole;            /* measured on all paths */
    double error_px, miss_rate, p99_ms, ram_bytes, pool_bytes;
} tune_setting;

/* Of cells that stand by path, `paths` each; `resident` ones are none. At most room; returns how
 * many. */
size_t tune_settings(const tune_cell *cells, size_t count, uint32_t paths, bool cpu,
                     tune_setting *out, size_t room);
bool tune_keeps_to(const tune_setting *s, const tune_want *want);
/* The setting with the least of what is to be small; of those that are within 2 % of it, the one
 * with the smallest array of place holders, then the fewest milliseconds. NULL: none keeps to it.
 */
const tune_setting *tune_choose(const tune_setting *settings, size_t count, const tune_want *want);

/* ---- what is told (tune_table.c) ------------------------------------------------------------- */

typedef struct tune_findings {
    tune_setting *setting;
    size_t settings;
    const tune_setting *best; /* NULL: none keeps to what is wanted */
} tune_findings;
mn_code tune_find(const tune *t, tune_findings *f, mn_status *st);
void tune_findings_free(tune_findings *f);
/* Columns of the two tables, as readers want figures. */
enum { TUNE_COLUMNS = 15, TUNE_LAYOUT_COLUMNS = 7, TUNE_TEXT_MAX = 24 };
typedef struct tune_column {
    const char *head;
    int width;         /* in characters; below 0: flush left */
    const char *means; /* for who does not know */
} tune_column;
extern const tune_column tune_columns[TUNE_COLUMNS], tune_layout_columns[TUNE_LAYOUT_COLUMNS];
typedef char tune_text[TUNE_TEXT_MAX];
/* Errors on the screen of what the eye passes through are of any size; none: no bound. */
void tune_pixels(double px, tune_text text);
/* How many columns the texts fill: the rest is c->says, or l->says. */
int tune_cell_texts(const tune *t, const tune_cell *c, tune_text *text);
int tune_layout_texts(const tune_layout *l, tune_text *text);
/* Is the cell one of the table of that path and rule? */
bool tune_cell_is_of(const tune_cell *c, uint32_t path, mn_prefetch rule);
/* "p99 up to 4 ms, least error" */
void tune_want_words(const tune_want *w, char *text, size_t room);
/* With TUNE_CLOCK_AUTO: whose times want.cpu takes, by what others had in the cells so far. */
void tune_clock_choose(tune *t);
/* Others had the processors, and whose times that leaves. false: there is nothing to say. */
bool tune_others_words(const tune *t, char *text, size_t room);
/* The best setting of those with such a cap and number of place holders. */
const tune_setting *tune_best_of(const tune *t, const tune_findings *f, uint32_t cap,
                                 uint32_t places);
void tune_table(const tune *t, const tune_findings *f, FILE *out);
void tune_json(const tune *t, const tune_findings *f, FILE *out);
/* "error 2.1 px, misses 0.10 %, …" */
void tune_setting_words(const tune *t, const tune_setting *s, char *text, size_t room);

/* ---- plots (tune_plots.c) and the page (tune_report.c) --------------------------------------- */

enum { TUNE_PLOTS_MAX = 256 };
typedef struct tune_plot {
    char name[TUNE_NAME_MAX];
    uint32_t width, height; /* pixels */
    char *svg;
    size_t svg_bytes;
} tune_plot;
typedef struct tune_plots {
    tune_plot plot[TUNE_PLOTS_MAX];
    uint32_t count;
    bool off[2];    /* SVGs, PNGs: gnuplot does not make them */
    char says[300]; /* why some are missing; empty: none is */
} tune_plots;
/* Scripts, SVGs and PNGs in DIR/plots. That gnuplot is missing is no failure. */
mn_code tune_plots_make(const tune *t, const tune_findings *found, tune_plots *p, mn_status *st);
void tune_plots_free(tune_plots *p);
/* DIR/report.html: all of it in one file. */
mn_code tune_report(const tune *t, const tune_findings *found, const tune_plots *p, mn_status *st);

#endif
