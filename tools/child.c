/* See child.h. Hidden here: that output goes into files without names, in memory, so that nobody
 * has to read while the child runs: who measures one can sleep until it is over.
 *
 * Memory: what a child prints, until child_end_free. Each child has two descriptors of ours, closed
 * by child_wait. */
#define _GNU_SOURCE /* memfd_create, ppoll, wait4 */
#include "child.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/pidfd.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cli.h"

enum { CHILDREN_MAX = 8, OUTPUT_MAX = 1 << 24 };

static sigset_t interrupts(void) {
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    sigaddset(&set, SIGHUP);
    return set;
}

void child_signals_hold(void) {
    const sigset_t set = interrupts();
    sigprocmask(SIG_BLOCK, &set, NULL);
}

/* ---- start ----------------------------------------------------------------------------------- */

/* In the new process: does not return. */
static void become(const char *const *argv, int out_fd, int err_fd, pid_t parent) {
    const sigset_t set = interrupts();
    union {
        const char *const *ours;
        char *const *theirs;
    } words = {argv}; /* exec does not write to them */
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent || dup2(out_fd, STDOUT_FILENO) < 0 ||
        (err_fd >= 0 && dup2(err_fd, STDERR_FILENO) < 0))
        _exit(MN_FAILED);
    sigprocmask(SIG_UNBLOCK, &set, NULL);
    if (argv[0] == NULL)
        execv("/proc/self/exe", words.theirs + 1);
    else
        execvp(argv[0], words.theirs);
    _exit(127);
}

static void close_all(child *c) {
    const int fds[] = {c->pid_fd, c->out_fd, c->err_fd};
    for (int i = 0; i < 3; i++)
        if (fds[i] >= 0)
            close(fds[i]);
    *c = (child){.pid_fd = -1, .out_fd = -1, .err_fd = -1};
}

mn_code child_start(child *c, const char *const *argv, bool own_errors, mn_status *st) {
    const char *name = argv[0] != NULL ? argv[0] : "metanode";
    *c = (child){
        .pid_fd = -1, .out_fd = -1, .err_fd = -1, .started_s = cli_seconds(CLOCK_MONOTONIC)};
    c->out_fd = memfd_create("out", MFD_CLOEXEC);
    if (own_errors)
        c->err_fd = memfd_create("err", MFD_CLOEXEC);
    if (c->out_fd < 0 || (own_errors && c->err_fd < 0)) {
        mn_fail(st, MN_FAILED, "%s: no file for its output: %s", name, strerror(errno));
        close_all(c);
        return MN_FAILED;
    }
    const pid_t parent = getpid();
    c->pid = fork();
    if (c->pid == 0)
        become(argv, c->out_fd, c->err_fd, parent);
    c->pid_fd = c->pid > 0 ? pidfd_open(c->pid, 0) : -1;
    if (c->pid_fd >= 0)
        return MN_OK;
    mn_fail(st, MN_FAILED, "%s cannot be started: %s", name, strerror(errno));
    if (c->pid > 0) {
        kill(c->pid, SIGKILL);
        waitpid(c->pid, NULL, 0);
    }
    close_all(c);
    return MN_FAILED;
}

/* ---- end ------------------------------------------------------------------------------------- */

/* What stands in the file, and a 0 behind it; "" where it cannot be read. */
static char *text_of(int fd, size_t *length_bytes) {
    const off_t length = fd < 0 ? 0 : lseek(fd, 0, SEEK_END);
    const size_t bytes = length < 0 ? 0 : length > OUTPUT_MAX ? OUTPUT_MAX : (size_t)length;
    char *text = malloc(bytes + 1);
    ssize_t got = text != NULL && bytes > 0 ? pread(fd, text, bytes, 0) : 0;
    *length_bytes = got > 0 ? (size_t)got : 0;
    if (text != NULL)
        text[*length_bytes] = 0;
    return text;
}

static void take_last_line(char *errors, child_end *end) {
    static const char prefix[] = "metanode: ";
    size_t length = strlen(errors);
    while (length > 0 && errors[length - 1] == '\n')
        errors[--length] = 0;
    const char *line = strrchr(errors, '\n');
    line = line != NULL ? line + 1 : errors;
    if (strncmp(line, prefix, sizeof prefix - 1) == 0)
        line += sizeof prefix - 1;
    snprintf(end->says, sizeof end->says, "%s", line);
}

static mn_code take_end(child *c, int status, const struct rusage *usage, child_end *end,
                        mn_status *st) {
    *end = (child_end){.seconds = cli_seconds(CLOCK_MONOTONIC) - c->started_s};
    end->code = c->late             ? CHILD_LATE
                : WIFEXITED(status) ? WEXITSTATUS(status)
                                    : 128 + WTERMSIG(status);
    end->cpu_seconds = (double)(usage->ru_utime.tv_sec + usage->ru_stime.tv_sec) +
                       1e-6 * (double)(usage->ru_utime.tv_usec + usage->ru_stime.tv_usec);
    size_t error_bytes;
    end->out = text_of(c->out_fd, &end->out_bytes);
    char *errors = text_of(c->err_fd >= 0 ? c->err_fd : c->out_fd, &error_bytes);
    if (errors != NULL)
        take_last_line(errors, end);
    if (c->late)
        snprintf(end->says, sizeof end->says, "took more than %.0f s", c->limit_s);
    else if (WIFSIGNALED(status))
        snprintf(end->says, sizeof end->says, "killed by SIG%s", sigabbrev_np(WTERMSIG(status)));
    else if (end->says[0] == 0 && end->code != 0)
        snprintf(end->says, sizeof end->says, "exit %d", end->code);
    free(errors);
    close_all(c);
    return end->out != NULL ? MN_OK : mn_fail(st, MN_FAILED, "out of memory for a child's output");
}

static void interrupt_all(const child *children, int count) {
    for (int i = 0; i < count; i++)
        if (children[i].pid > 0)
            kill(children[i].pid, cli_interrupted());
}

/* Kills those that are late. Returns for how long the others may run, or NULL: for ever. */
static struct timespec *until_late(child *children, int count, struct timespec *left) {
    const double now = cli_seconds(CLOCK_MONOTONIC);
    double least = INFINITY;
    for (int i = 0; i < count; i++) {
        child *c = &children[i];
        if (c->pid <= 0 || c->limit_s <= 0 || c->late)
            continue;
        const double s = c->started_s + c->limit_s - now;
        c->late = s <= 0;
        if (c->late)
            kill(c->pid, SIGKILL);
        else
            least = fmin(least, s);
    }
    left->tv_sec = (time_t)fmin(least, 1e9);
    left->tv_nsec = (long)(1e9 * (fmin(least, 1e9) - (double)left->tv_sec));
    return isfinite(least) ? left : NULL;
}

mn_code child_wait(child *children, int count, int *which, child_end *end, mn_status *st) {
    struct pollfd polls[CHILDREN_MAX];
    sigset_t open;
    bool passed_on = cli_interrupted() != 0;
    *end = (child_end){0};
    sigprocmask(SIG_SETMASK, NULL, &open);
    sigdelset(&open, SIGINT);
    sigdelset(&open, SIGTERM);
    sigdelset(&open, SIGHUP);
    for (int i = 0; i < count; i++)
        polls[i] =
            (struct pollfd){.fd = children[i].pid > 0 ? children[i].pid_fd : -1, .events = POLLIN};
    for (;;) {
        struct timespec left;
        const int ready = ppoll(polls, (nfds_t)count, until_late(children, count, &left), &open);
        if (ready < 0 && errno != EINTR)
            return mn_fail(st, MN_FAILED, "cannot wait: %s", strerror(errno));
        if (cli_interrupted() != 0 && !passed_on) {
            passed_on = true;
            interrupt_all(children, count);
        }
        for (int i = 0; i < count && ready > 0; i++) {
            int status = 0;
            struct rusage usage;
            if (polls[i].revents == 0 || wait4(children[i].pid, &status, 0, &usage) < 0)
                continue;
            *which = i;
            return take_end(&children[i], status, &usage, end, st);
        }
    }
}

void child_end_free(child_end *end) {
    free(end->out);
    *end = (child_end){0};
}
