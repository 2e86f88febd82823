/* e2e_limits SECONDS MEGABYTES COMMAND …: runs a command and measures what it took, for the
 * end-to-end scripts.
 *
 * Exit: the command's; 128 + the signal that ended it; 124 more SECONDS of processor time than
 * allowed, or ten times as many of the clock (something waits for ever); 125 more memory (resident
 * at the peak). 0 is no limit. Time is the processor's, so that a busy machine fails nothing. */
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

enum { TOO_LONG = 124, TOO_BIG = 125, LOST = 126, PATIENCE = 10 };

static volatile sig_atomic_t late;
static pid_t child;

static void on_alarm(int sig) {
    (void)sig;
    late = 1;
    kill(child, SIGKILL);
}

static int judge(int status, const struct rusage *used, double seconds_max, long kib_max) {
    double seconds = (double)(used->ru_utime.tv_sec + used->ru_stime.tv_sec) +
                     1e-6 * (double)(used->ru_utime.tv_usec + used->ru_stime.tv_usec);
    if (late || (seconds_max > 0 && seconds > seconds_max)) {
        fprintf(stderr, "e2e_limits: %.2f s of the processor%s\n", seconds,
                late ? ", and no end in sight" : "");
        return TOO_LONG;
    }
    if (kib_max > 0 && used->ru_maxrss > kib_max) {
        fprintf(stderr, "e2e_limits: %ld KiB of memory\n", used->ru_maxrss);
        return TOO_BIG;
    }
    return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

int main(int argc, char **argv) {
    if (argc < 4)
        return LOST;
    double seconds = atof(argv[1]);
    struct sigaction action = {.sa_handler = on_alarm};
    sigaction(SIGALRM, &action, NULL);
    child = fork();
    if (child == 0) {
        execv(argv[3], argv + 3);
        fprintf(stderr, "e2e_limits: %s: %s\n", argv[3], strerror(errno));
        _exit(LOST);
    }
    if (child < 0)
        return LOST;
    alarm((unsigned)(seconds * PATIENCE));
    int status;
    struct rusage used;
    while (wait4(child, &status, 0, &used) < 0)
        if (errno != EINTR)
            return LOST;
    return judge(status, &used, seconds, atol(argv[2]) * 1024);
}
