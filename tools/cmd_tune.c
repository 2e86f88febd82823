/* metanode tune: which blocks, and how many of them in memory? See --help, docs/tune.md and tune.h.
 * Here is the order of things alone. */
#define _GNU_SOURCE /* sigabbrev_np */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "child.h"
#include "cli.h"
#include "tune.h"

/* Before a build that may take long. */
static void say_begin(const tune *t) {
    const tune_options *o = &t->o;
    uint32_t layouts = 0;
    for (uint32_t i = 0; i < o->policies; i++)
        layouts += o->policy[i] == MN_BLOCKING_LEVELS ? o->levels_count : o->block_bytes_count;
    const uint32_t settings = layouts * o->caps * o->places_count * (o->cross ? o->prefetches : 1);
    if (o->json)
        return;
    printf("%s: %u layout%s, %u setting%s, %u path%s: %u cell%s, each up to %g s\n", o->in, layouts,
           cli_s(layouts), settings, cli_s(settings), o->paths, cli_s(o->paths),
           (settings + 1) * o->paths, cli_s((settings + 1) * o->paths), (double)o->limit_s);
    fflush(stdout);
}

static void say_plan(const tune *t) {
    const size_t missing = tune_missing(t);
    const double seconds = tune_seconds_needed(t);
    if (t->o.json)
        return;
    printf("%zu cell%s, %zu of them known; about %.0f s", t->cells, cli_s(t->cells),
           t->cells - missing, seconds);
    printf("%s\n", t->o.cross || t->o.prefetches == 1
                       ? ""
                       : ", then the other prefetch rules at the best setting");
    fflush(stdout);
}

/* All cells; then the other prefetch rules where they matter. */
static mn_code sweep(tune *t, tune_findings *f, mn_status *st) {
    mn_code code = tune_caps_will_do(t, st);
    if (code == MN_OK)
        code = tune_enumerate(t, st);
    if (code == MN_OK)
        code = tune_results_load(t, st);
    if (code != MN_OK)
        return code;
    say_plan(t);
    code = tune_measure(t, st);
    tune_clock_choose(t);
    if (code == MN_OK)
        code = tune_find(t, f, st);
    if (code != MN_OK || f->best == NULL || t->o.cross || t->o.prefetches == 1)
        return code;
    const tune_cell at = *f->best->cell;
    tune_findings_free(f);
    code = tune_enumerate_rules(t, &at, st);
    if (code == MN_OK)
        code = tune_results_load(t, st);
    if (code == MN_OK)
        code = tune_measure(t, st);
    return code == MN_OK ? tune_find(t, f, st) : code;
}

/* Where no setting could be measured there is none to choose: the first says why. */
static mn_code any_measured(const tune *t, mn_status *st) {
    const tune_cell *first = NULL;
    for (size_t i = 0; i < t->cells; i++) {
        const tune_cell *c = &t->cell[i];
        if (c->state == TUNE_MEASURED && !c->resident)
            return MN_OK;
        first = first == NULL && !c->resident ? c : first;
    }
    const bool ours = first != NULL && first->code > MN_OK && first->code <= MN_NO_GRAPHICS;
    return mn_fail(st, ours ? (mn_code)first->code : MN_FAILED,
                   "tune: no setting could be measured: %s",
                   first != NULL ? first->says : "there is none");
}

static mn_code table_file(const tune *t, const tune_findings *f, mn_status *st) {
    char path[PATH_MAX];
    FILE *out = tune_file_name(t, "table.txt", path, sizeof path) == 0 ? fopen(path, "we") : NULL;
    if (out == NULL)
        return mn_fail(st, MN_FAILED, "%s/table.txt: cannot be written", t->o.folder);
    tune_table(t, f, out);
    return cli_written_all(out, "tune:", path, st);
}

static mn_code tell(const tune *t, const tune_findings *f, mn_status *st) {
    tune_plots *plots = calloc(1, sizeof *plots);
    if (plots == NULL)
        return mn_fail(st, MN_FAILED, "tune: no memory for plots");
    mn_code code = table_file(t, f, st);
    if (code == MN_OK)
        code = tune_plots_make(t, f, plots, st);
    if (code == MN_OK)
        code = tune_report(t, f, plots, st);
    if (code == MN_OK && plots->says[0] != 0)
        fprintf(stderr, "metanode: warning: %s\n", plots->says);
    if (code == MN_OK && t->o.json)
        tune_json(t, f, stdout);
    else if (code == MN_OK)
        tune_table(t, f, stdout);
    if (code == MN_OK && !t->o.json)
        printf("\n%s/report.html: all of it, with %u plot%s\n", t->o.folder, plots->count,
               cli_s(plots->count));
    tune_plots_free(plots);
    free(plots);
    return code;
}

static mn_code run(tune *t, mn_status *st) {
    tune_findings f = {0};
    mn_code code = tune_folder_open(t, st);
    if (code == MN_OK) {
        say_begin(t);
        code = tune_build(t, st);
        const bool no_tree = code != MN_OK && access(t->tree, F_OK) != 0;
        if (code == MN_BAD_INPUT || (no_tree && cli_interrupted() != 0))
            tune_folder_forget(t);
    }
    if (code == MN_OK)
        code = sweep(t, &f, st);
    if (code == MN_OK)
        code = any_measured(t, st);
    if (code == MN_OK)
        code = tell(t, &f, st);
    tune_findings_free(&f);
    tune_folder_close(t);
    return code;
}

int cmd_tune(int argc, char **argv) {
    mn_status st = {0};
    bool done = false;
    tune *t = calloc(1, sizeof *t);
    if (t == NULL)
        return cli_error(MN_FAILED, "tune: no memory");
    mn_code code = tune_options_read(&t->o, argc, argv, &done);
    if (code == MN_OK && !done) {
        cli_interrupts_catch();
        child_signals_hold();
        code = run(t, &st);
        if (code == MN_FAILED && cli_interrupted() != 0)
            cli_error(code, "interrupted by SIG%s; %s%s%s", sigabbrev_np(cli_interrupted()),
                      t->is_forgotten ? "nothing is left of " : "", t->o.folder,
                      t->is_forgotten ? ""
                                      : " keeps what was made and measured, and the same "
                                        "command goes on");
        else
            cli_status(&st);
    }
    free(t->cell);
    free(t);
    return (int)code;
}
