/* See cli.h. */
#define _GNU_SOURCE /* sigabbrev_np, O_TMPFILE, mkostemp */
#include "cli.h"

#include <errno.h>
#include <fcntl.h>
#include <float.h>
#include <libgen.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

int cli_error(mn_code code, const char *format, ...) {
    char line[8192];
    va_list args;
    va_start(args, format);
    vsnprintf(line, sizeof line, format, args);
    va_end(args);
    for (char *c = line; *c != '\0'; c++) /* one line, whatever a file is called */
        *c = (unsigned char)*c < ' ' || *c == 127 ? '?' : *c;
    fprintf(getenv(CLI_ERRORS_APART) != NULL ? stdout : stderr, "metanode: %s\n", line);
    return (int)code;
}

static volatile sig_atomic_t interrupted; /* by which signal; 0: by none */

int cli_status(const mn_status *st) {
    return cli_status_with(st, "");
}

int cli_status_with(const mn_status *st, const char *when_interrupted) {
    if (st->code == MN_FAILED && interrupted != 0 && strstr(st->text, "interrupted") != NULL)
        cli_error(st->code, "interrupted by SIG%s; no output was changed%s",
                  sigabbrev_np(interrupted), when_interrupted);
    else if (st->code != MN_OK)
        cli_error(st->code, "%s", st->text);
    return (int)st->code;
}

int cli_option(int argc, char **argv, const char *short_options, const struct option *options) {
    char quiet[64];
    snprintf(quiet, sizeof quiet, ":%s", short_options);
    opterr = 0;
    int index = -1;
    int found = getopt_long(argc, argv, quiet, options, &index);
    const char *name = argv[optind - 1];
    if (found != '?' && optarg != NULL && *optarg == '\0') { /* -o "$unset" */
        found = ':';
        name = *name != '\0' ? name : argv[optind - 2];
    }
    if (found == ':')
        cli_error(MN_USAGE, "%s: option %s needs a value; see metanode %s --help", argv[0], name,
                  argv[0]);
    else if (found == '?')
        cli_error(MN_USAGE, "%s: unknown option %s; see metanode %s --help", argv[0], name,
                  argv[0]);
    return found == ':' ? '?' : found;
}

const char *const cli_on_off[] = {"on", "off", NULL};

static bool take_value(const cli_flag *flag) {
    double length = 0;
    uint64_t size = 0;
    int choice = 0;
    bool good = true;
    switch (flag->kind) {
    case CLI_IS_SWITCH:
        *(bool *)flag->to = true;
        break;
    case CLI_IS_TEXT:
        *(const char **)flag->to = optarg;
        break;
    case CLI_IS_WHOLE:
        if (optarg == NULL)
            *(uint64_t *)flag->to = flag->bare;
        else
            good = cli_u64(optarg, flag->min, flag->max, flag->to);
        break;
    case CLI_IS_SIZE:
        good = cli_size(optarg, &size) && size >= flag->min && size <= flag->max;
        *(uint64_t *)flag->to = size;
        break;
    case CLI_IS_LENGTH:
        good = cli_double(optarg, 0, FLT_MAX, &length);
        *(float *)flag->to = (float)length;
        break;
    case CLI_IS_CHOICE:
        choice = cli_choice(optarg, flag->names);
        good = choice >= 0;
        *(int *)flag->to = choice;
        break;
    }
    return good;
}

mn_code cli_flags(int argc, char **argv, const cli_flag *flags, const char *help, bool *done) {
    enum { HELP = 'h', FIRST = 256 };
    struct option options[CLI_FLAGS_MAX + 2] = {0};
    char letters[2 * CLI_FLAGS_MAX + 2];
    int count = 0, found, length = snprintf(letters, sizeof letters, "%c", HELP);
    for (; flags[count].name != NULL; count++) {
        const cli_flag *flag = &flags[count];
        const int argument = flag->kind == CLI_IS_SWITCH ? no_argument
                             : flag->bare != 0           ? optional_argument
                                                         : required_argument;
        options[count] = (struct option){flag->name, argument, NULL, FIRST + count};
        if (flag->letter != 0)
            length += snprintf(letters + length, sizeof letters - (size_t)length, "%c%s",
                               flag->letter, argument == no_argument ? "" : ":");
    }
    options[count] = (struct option){"help", no_argument, NULL, HELP};
    *done = false;
    while ((found = cli_option(argc, argv, letters, options)) != -1) {
        int at = found - FIRST;
        for (int i = 0; i < count && found < FIRST; i++)
            at = flags[i].letter == found ? i : at;
        if (found == HELP) {
            fputs(help, stdout);
            *done = true;
            return MN_OK;
        }
        if (at < 0)
            return MN_USAGE;
        const char letter[] = {'-', flags[at].letter, 0}; /* what help has */
        if (!take_value(&flags[at]))
            return (mn_code)cli_error(
                MN_USAGE, "%s: %s%s '%s' is not %s", argv[0], flags[at].letter != 0 ? "" : "--",
                flags[at].letter != 0 ? letter : flags[at].name, optarg, flags[at].wants);
        if (flags[at].given != NULL)
            ++*flags[at].given;
    }
    return MN_OK;
}

bool cli_double(const char *text, double min, double max, double *value) {
    char *end = NULL;
    errno = 0;
    double v = strtod(text, &end);
    if (end == text || *end != 0 || errno != 0 || !(v >= min && v <= max))
        return false;
    *value = v;
    return true;
}

bool cli_u64(const char *text, uint64_t min, uint64_t max, uint64_t *value) {
    char *end = NULL;
    errno = 0;
    if (text[0] < '0' || text[0] > '9')
        return false;
    unsigned long long v = strtoull(text, &end, 10), unit = 1;
    static const char units[] = "kMG";
    const char *found = *end != 0 ? strchr(units, *end == 'K' ? 'k' : *end) : NULL;
    for (long i = 0; found != NULL && i <= found - units; i++)
        unit *= 1000;
    if (end[found != NULL] != 0 || errno != 0 || v > max / unit || v * unit < min)
        return false;
    *value = v * unit;
    return true;
}

bool cli_size(const char *text, uint64_t *bytes) {
    static const char units[] = "BKMGT";
    char *end = NULL;
    double v = strtod(text, &end);
    if (end == text || !isfinite(v) || v <= 0)
        return false;
    if (*end != 0) {
        char unit = *end >= 'a' && *end <= 'z' ? (char)(*end - 'a' + 'A') : *end;
        const char *found = strchr(units, unit);
        const char *rest = end + 1;
        if (found != units && (*rest == 'i' || *rest == 'I') && rest[1] != 0)
            rest++;
        if (found != units && (*rest == 'b' || *rest == 'B'))
            rest++;
        if (found == NULL || *rest != 0)
            return false;
        v = ldexp(v, 10 * (int)(found - units));
    }
    if (v < 1 || v > ldexp(1, 62))
        return false;
    *bytes = (uint64_t)v;
    return true;
}

int cli_choice(const char *text, const char *const *names) {
    for (int i = 0; names[i] != NULL; i++)
        if (strcmp(text, names[i]) == 0)
            return i;
    return -1;
}

double cli_seconds(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void interrupt(int signal_number) {
    interrupted = signal_number;
}

/* What is ignored stays ignored: nohup, and jobs in the background of a script. */
static void catch_unless_ignored(int signal_number) {
    const struct sigaction action = {.sa_handler = interrupt, .sa_flags = (int)SA_RESETHAND};
    struct sigaction now;
    if (sigaction(signal_number, NULL, &now) == 0 && now.sa_handler != SIG_IGN)
        sigaction(signal_number, &action, NULL);
}

int cli_interrupted(void) {
    return interrupted;
}

void cli_interrupts_catch(void) {
    catch_unless_ignored(SIGINT);
    catch_unless_ignored(SIGTERM);
    catch_unless_ignored(SIGHUP);
}

/* One file, by whatever name; of files that are not there yet: one name in one folder. */
static bool is_same_file(const char *a, const char *b) {
    struct stat of_a, of_b;
    const bool is_a = stat(a, &of_a) == 0, is_b = stat(b, &of_b) == 0;
    bool is_same = is_a && is_b;
    if (!is_a && !is_b) {
        char folder_a[PATH_MAX], folder_b[PATH_MAX], name_a[PATH_MAX], name_b[PATH_MAX];
        snprintf(folder_a, sizeof folder_a, "%s", a);
        snprintf(folder_b, sizeof folder_b, "%s", b);
        snprintf(name_a, sizeof name_a, "%s", a);
        snprintf(name_b, sizeof name_b, "%s", b);
        is_same = strcmp(basename(name_a), basename(name_b)) == 0 &&
                  stat(dirname(folder_a), &of_a) == 0 && stat(dirname(folder_b), &of_b) == 0;
    }
    return is_same && of_a.st_dev == of_b.st_dev && of_a.st_ino == of_b.st_ino;
}

mn_code cli_outputs_differ(const char *command, const char *option, const char *out,
                           const char *other_option, const char *other) {
    if (out == NULL || other == NULL || !is_same_file(out, other))
        return MN_OK;
    return (mn_code)cli_error(MN_USAGE, "%s: %s and %s are one file; name another", command, option,
                              other_option);
}

mn_code cli_output(const char *command, const char *out, const char *in) {
    struct stat to, from;
    if (out != NULL && strcmp(out, "-") == 0)
        return (mn_code)cli_error(
            MN_USAGE, "%s: - is no output: name a file (./- for one of that name)", command);
    if (out == NULL || in == NULL || stat(out, &to) != 0 || stat(in, &from) != 0 ||
        to.st_dev != from.st_dev || to.st_ino != from.st_ino)
        return MN_OK;
    return (mn_code)cli_error(MN_USAGE, "%s: %s would be written over what is read; name another",
                              command, out);
}

mn_code cli_output_kind(const char *command, const char *out, const char *ending) {
    static const char *const kinds[] = {".ply", ".stl", ".obj", ".off", ".om",  ".vdt",
                                        ".mnt", ".png", ".jpg", ".csv", ".json"};
    const char *dot = strrchr(out, '.');
    if (dot == NULL || strcasecmp(dot, ending) == 0)
        return MN_OK;
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (strcasecmp(dot, kinds[i]) == 0)
            return (mn_code)cli_error(MN_USAGE,
                                      "%s: %s: it writes %s, not %s; give it a name that ends so",
                                      command, out, ending, kinds[i]);
    return MN_OK;
}

const char *cli_write_advice(int error) {
    return error == EFBIG                           ? "allow larger files (ulimit -f)"
           : mn_code_of_write(error) == MN_NO_SPACE ? "make room, or write to another disk"
                                                    : "write to another place";
}

static mn_code not_written(const char *what, const char *path, mn_status *st) {
    return mn_fail(st, mn_code_of_write(errno), "%s %s: cannot be written: %s; %s", what, path,
                   strerror(errno), cli_write_advice(errno));
}

const char *cli_shell_word(const char *text, char *out, size_t size) {
    size_t at = 0;
    if (*text != 0 && text[strspn(text, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                        "0123456789_-+=.,:/@%")] == 0) {
        snprintf(out, size, "%s", text);
        return out;
    }
    out[at++] = '\'';
    for (; *text != 0 && at + 6 < size; text++) { /* one in quotes: out, the quote, and in again */
        if (*text == '\'')
            at += (size_t)snprintf(out + at, size - at, "'\\'");
        out[at++] = *text;
    }
    snprintf(out + at, size - at, "'");
    return out;
}

mn_code cli_written(FILE *file, const char *what, const char *path, mn_status *st) {
    return ferror(file) ? not_written(what, path, st) : MN_OK;
}

mn_code cli_written_all(FILE *file, const char *what, const char *path, mn_status *st) {
    mn_code code = fflush(file) != 0 ? not_written(what, path, st) : MN_OK;
    if (fclose(file) != 0 && code == MN_OK)
        code = not_written(what, path, st);
    return code;
}

/* By making one: there are directories which take none whatever their permissions are (/proc). */
static bool takes_files(const char *folder) {
    char name[PATH_MAX];
    int fd = open(folder, O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600);
    if (fd < 0 && (errno == EOPNOTSUPP || errno == EISDIR) && /* files without names */
        snprintf(name, sizeof name, "%s/.metanode-XXXXXX", folder) < (int)sizeof name) {
        fd = mkostemp(name, O_CLOEXEC);
        if (fd >= 0)
            unlink(name);
    }
    if (fd >= 0)
        close(fd);
    return fd >= 0;
}

mn_code cli_output_possible(const char *out) {
    struct stat about;
    const bool exists = stat(out, &about) == 0;
    if (exists && !S_ISREG(about.st_mode))
        return (mn_code)cli_error(MN_FAILED, "%s: not a regular file; name another output", out);
    char *path = exists ? realpath(out, NULL) : strdup(out); /* a link is followed */
    const bool possible = path != NULL && takes_files(dirname(path));
    const int error = errno;
    free(path);
    if (possible)
        return MN_OK;
    return (mn_code)cli_error(mn_code_of_write(error),
                              "%s: cannot create: %s; name a directory that is there, can be "
                              "written and has room",
                              out, strerror(error));
}

uint64_t cli_file_bytes(const char *path) {
    struct stat about;
    return stat(path, &about) == 0 ? (uint64_t)about.st_size : 0;
}

uint64_t cli_rss_bytes(void) {
    char text[128];
    int fd = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    ssize_t n = fd >= 0 ? read(fd, text, sizeof text - 1) : -1;
    unsigned long long pages = 0;
    if (fd >= 0)
        close(fd);
    text[n > 0 ? n : 0] = 0;
    return sscanf(text, "%*u %llu", &pages) == 1 ? pages * (uint64_t)sysconf(_SC_PAGESIZE) : 0;
}

bool cli_progress(void *context, const char *phase, uint64_t done, uint64_t total) {
    cli_meter *meter = context;
    if (interrupted)
        return false;
    if (!isatty(STDERR_FILENO))
        return true;
    double now = cli_seconds(CLOCK_MONOTONIC);
    if (meter->phase == NULL || strcmp(meter->phase, phase) != 0) {
        meter->phase = phase;
        meter->started_s = now;
        meter->shown_s = 0;
    }
    if (now - meter->shown_s < 0.2)
        return true;
    meter->shown_s = now;
    double spent = now - meter->started_s;
    double rate = spent > 0 ? (double)done / spent : 0;
    fprintf(stderr, "\r%s ", phase);
    if (total > 0)
        fprintf(stderr, "%3.0f %%", 100.0 * (double)done / (double)total);
    else
        fprintf(stderr, "%llu", (unsigned long long)done);
    if (rate > 0)
        fprintf(stderr, "  %.0f/s", rate);
    if (rate > 0 && total > 0)
        fprintf(stderr, "  %.0f s left", total > done ? (double)(total - done) / rate : 0);
    fprintf(stderr, "  %.1f MB \033[K", (double)cli_rss_bytes() / 1048576);
    return true;
}

void cli_progress_end(void *context) {
    cli_meter *meter = context;
    if (meter->shown_s > 0)
        fputs("\r\033[K", stderr);
    *meter = (cli_meter){0};
}

/* Not getrusage: what that says survives exec, and is the peak of whoever started us. Not stdio:
 * nothing may be allocated here. */
uint64_t cli_rss_peak_bytes(void) {
    char text[4096];
    int fd = open("/proc/self/status", O_RDONLY | O_CLOEXEC);
    ssize_t n = fd >= 0 ? read(fd, text, sizeof text - 1) : -1;
    if (fd >= 0)
        close(fd);
    text[n > 0 ? n : 0] = 0;
    const char *at = strstr(text, "VmHWM:");
    return at != NULL ? strtoull(at + 6, NULL, 10) * 1024 : 0;
}
