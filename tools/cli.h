/* What all subcommands share: options, sizes, errors, progress. Main thread only. */
#ifndef METANODE_CLI_H
#define METANODE_CLI_H

#include <getopt.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <time.h>

#include "metanode/build.h"
#include "metanode/status.h"

/* A subcommand: argv[0] is its name. Returns the exit code. */
typedef struct cli_command {
    const char *name;
    int (*run)(int argc, char **argv);
    const char *does; /* one line for --help */
} cli_command;

int cmd_build(int argc, char **argv);
int cmd_simplify(int argc, char **argv);
int cmd_block(int argc, char **argv);
int cmd_info(int argc, char **argv);
int cmd_verify(int argc, char **argv);
int cmd_extract(int argc, char **argv);
int cmd_replay(int argc, char **argv);
int cmd_shoot(int argc, char **argv);
int cmd_view(int argc, char **argv);
int cmd_make(int argc, char **argv);
int cmd_compare(int argc, char **argv);
int cmd_stress(int argc, char **argv);
int cmd_trace(int argc, char **argv);
int cmd_tune(int argc, char **argv);
int cmd_bench(int argc, char **argv);

/* In the environment: errors go to standard output instead, to whoever has started this process and
 * reads that; progress goes to the terminal still. */
#define CLI_ERRORS_APART "METANODE_ERRORS_APART"
/* Prints "metanode: …" on standard error and returns the code. */
int cli_error(mn_code code, const char *format, ...) __attribute__((format(printf, 2, 3)));
int cli_status(const mn_status *st); /* the same of a status; MN_OK prints nothing */
int cli_status_with(const mn_status *st, const char *when_interrupted); /* adds that to the line */

/* getopt_long without its own messages: -1 at the end; '?' has been reported (exit MN_USAGE). */
int cli_option(int argc, char **argv, const char *short_options, const struct option *options);

/* An option as a row of a table, and where its value goes, which holds the default before. */
typedef enum cli_kind {
    CLI_IS_SWITCH, /* bool: given */
    CLI_IS_TEXT,   /* const char * */
    CLI_IS_WHOLE,  /* uint64_t in min … max */
    CLI_IS_SIZE,   /* the same, as 16M and the like */
    CLI_IS_LENGTH, /* float, 0 or more */
    CLI_IS_CHOICE, /* int: which of names, NULL at their end */
} cli_kind;
typedef struct cli_flag {
    const char *name; /* long; NULL ends the table */
    char letter;      /* 0: none */
    cli_kind kind;
    void *to;
    uint64_t min, max;
    const char *const *names;
    uint64_t bare;     /* CLI_IS_WHOLE: what it is without a value; 0: it must have one */
    const char *wants; /* what a bad value is not: "on or off" */
    int *given;        /* counts how often it is given; NULL: nobody asks */
} cli_flag;
#define CLI_SWITCH(name_, to_)                                                                     \
    { .name = name_, .kind = CLI_IS_SWITCH, .to = to_ }
#define CLI_TEXT(name_, to_)                                                                       \
    { .name = name_, .kind = CLI_IS_TEXT, .to = to_ }
#define CLI_OUTPUT(to_)                                                                            \
    { .name = "output", .letter = 'o', .kind = CLI_IS_TEXT, .to = to_ }
#define CLI_WHOLE(name_, to_, min_, max_, wants_)                                                  \
    { .name = name_, .kind = CLI_IS_WHOLE, .to = to_, .min = min_, .max = max_, .wants = wants_ }
#define CLI_SIZE(name_, to_, min_, max_, wants_)                                                   \
    { .name = name_, .kind = CLI_IS_SIZE, .to = to_, .min = min_, .max = max_, .wants = wants_ }
#define CLI_CHOICE(name_, to_, names_, wants_)                                                     \
    { .name = name_, .kind = CLI_IS_CHOICE, .to = to_, .names = names_, .wants = wants_ }
enum { CLI_FLAGS_MAX = 32 };
extern const char *const cli_on_off[]; /* names: 0 on, 1 off; as mn_weld */
/* Reads the options; optind is then at the first word that is none. MN_USAGE has been said. *done:
 * help was asked for, and printed. */
mn_code cli_flags(int argc, char **argv, const cli_flag *flags, const char *help, bool *done);

/* "16M", "16MB", "16MiB", "1.5G", "4096": powers of 1024. false: not a size, or 0, or above 2^62.
 */
bool cli_size(const char *text, uint64_t *bytes);
/* "100", "20k" or "20K", "5M": powers of 1000. */
bool cli_u64(const char *text, uint64_t min, uint64_t max, uint64_t *value);
bool cli_double(const char *text, double min, double max, double *value);
/* Which of names[] (NULL at the end) text is; -1: none. */
int cli_choice(const char *text, const char *const *names);

/* An mn_progress for a terminal: percent, rate, time left and memory on standard error; silent when
 * that is no terminal. Context: a zeroed cli_meter. */
typedef struct cli_meter {
    double started_s, shown_s;
    const char *phase;
} cli_meter;
#define CLI_WATCH(meter) (&(const mn_watch){cli_progress, meter})
bool cli_progress(void *context, const char *phase, uint64_t done, uint64_t total);
void cli_progress_end(void *context); /* clears the line, and the meter */
/* From now on the first SIGINT, SIGTERM or SIGHUP makes cli_progress ask for an end, so that work
 * stops in order and temporary files go; a second one kills. What is ignored stays so. */
void cli_interrupts_catch(void);
int cli_interrupted(void); /* by which signal; 0: by none */

/* MN_USAGE, and said, where the output is the input, by whatever name, or link; or "-", which means
 * standard output elsewhere. Either may be NULL. */
mn_code cli_output(const char *command, const char *out, const char *in);
/* MN_USAGE, and said, where the output's name promises another kind of file than `ending`, ".ply",
 * which is what is written: a mesh, a model, a picture or a table. Other names are anyone's own. */
mn_code cli_output_kind(const char *command, const char *out, const char *ending);
/* MN_USAGE, and said, where two options name one output. Either output may be NULL. */
mn_code cli_outputs_differ(const char *command, const char *option, const char *out,
                           const char *other_option, const char *other);
/* MN_FAILED or MN_NO_SPACE, and said, where the output could not be made: before an hour of work,
 * not after. A file is made in its directory for that, without a name where that can be. */
mn_code cli_output_possible(const char *out);
/* The text as one word of a shell's, quoted where it must be; cut where it does not fit. */
const char *cli_shell_word(const char *text, char *out, size_t size);
/* After a write has failed so: what to do. */
const char *cli_write_advice(int error);
/* Right after something was written to the file: MN_OK, or what went wrong. what: the option. */
mn_code cli_written(FILE *file, const char *what, const char *path, mn_status *st);
/* The same of what is still buffered; and closes it. */
mn_code cli_written_all(FILE *file, const char *what, const char *path, mn_status *st);
uint64_t cli_file_bytes(const char *path); /* 0: cannot be asked */
/* What a noun ends in after so many: "1 triangle", "2 triangles". */
static inline const char *cli_s(uint64_t count) {
    return count == 1 ? "" : "s";
}

/* What a clock says: CLOCK_MONOTONIC, CLOCK_THREAD_CPUTIME_ID, ... */
double cli_seconds(clockid_t clock);
/* Resident set of this process, bytes: now; at its peak. Nothing is allocated for it. */
uint64_t cli_rss_bytes(void);
uint64_t cli_rss_peak_bytes(void);

/* malloc and its kin, counted (alloc_count.c): how many calls since the last cli_alloc_mark by the
 * whole process, its libraries included. 0 always under a sanitizer, whose malloc is its own. */
void cli_alloc_mark(void);
uint64_t cli_alloc_since_mark(void);        /* without those below */
uint64_t cli_alloc_theirs_since_mark(void); /* of the GL module and of what it loads */
/* Main thread, before the module is loaded: threads that come later are the module's. Once told, it
 * is so. */
void cli_alloc_threads_are_ours(void);
/* Main thread: what it allocates from now on is the module's, or is not. */
void cli_alloc_theirs(bool inside);

#endif
