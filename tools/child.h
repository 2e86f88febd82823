/* Programs that we start and wait for: this one itself, or another. Their output is caught whole.
 * Main thread only.
 *
 *     child_signals_hold();
 *     child_start(&c, argv, …) … child_wait(&c, 1, &which, &end, &st) … child_end_free(&end) */
#ifndef METANODE_CHILD_H
#define METANODE_CHILD_H

#include <stdbool.h>
#include <sys/types.h>

#include "metanode/status.h"

enum { CHILD_LATE = 124 };

typedef struct child {
    pid_t pid; /* 0: none */
    int pid_fd, out_fd, err_fd;
    double started_s, limit_s; /* limit_s 0: none */
    bool late;                 /* past its limit, and killed */
} child;

typedef struct child_end {
    int code;           /* its exit code; 128 + signal: killed by it; CHILD_LATE */
    double seconds;     /* from start to end, by the clock */
    double cpu_seconds; /* of the processor, what it has waited for included */
    char *out;          /* what it printed on standard output, out_bytes and a 0 */
    size_t out_bytes;
    char says[400]; /* the last line of its errors, or of its output where they are not caught,
                       without "metanode: "; or how it ended */
} child_end;

/* From now on SIGINT, SIGTERM and SIGHUP come in child_wait only, so that none falls between a look
 * and a sleep. After cli_interrupts_catch. */
void child_signals_hold(void);
/* argv[0] is the program, looked for in PATH; NULL there: this program. own_errors: its standard
 * error is caught too, not ours. It is ended when we are. c->limit_s may then be set: seconds after
 * which child_wait kills it. */
mn_code child_start(child *c, const char *const *argv, bool own_errors, mn_status *st);
/* Sleeps until one of those that run has ended. An interrupt is passed on to all of them, once;
 * they are waited for nevertheless. */
mn_code child_wait(child *children, int count, int *which, child_end *end, mn_status *st);
void child_end_free(child_end *end);

#endif
