/* See output.h. Hides how a file without a name is made and given one (src/io does the same for
 * what is not text). */
#define _GNU_SOURCE /* O_TMPFILE */
#include "output.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli.h"

enum { SELF_NAME_BYTES = 40, TEMP_EXTRA_BYTES = 32 };

static mn_code failed(const output *o, int error, mn_status *st) {
    return mn_fail(st, mn_code_of_write(error), "%s %s: cannot be written: %s; %s", o->what,
                   o->name, strerror(error), cli_write_advice(error));
}

/* A regular file, or nothing yet; and no name of something that is open, as /dev/stdout is. */
static bool is_plain(const char *name) {
    struct stat about;
    return strncmp(name, "/dev/", 5) != 0 && strncmp(name, "/proc/", 6) != 0 &&
           (stat(name, &about) != 0 || S_ISREG(about.st_mode));
}

/* -1: not here; o->path is then NULL. */
static int open_nameless(output *o) {
    char *path = access(o->name, F_OK) == 0 ? realpath(o->name, NULL) : strdup(o->name);
    char *folder = path != NULL ? strdup(path) : NULL;
    int fd = folder != NULL ? open(dirname(folder), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666) : -1;
    free(folder);
    if (fd >= 0)
        o->path = path;
    else
        free(path);
    return fd;
}

mn_code output_open(output *o, const char *what, const char *name, mn_status *st) {
    *o = (output){.what = what, .name = name};
    const int fd = is_plain(name) ? open_nameless(o) : -1;
    o->file = fd >= 0 ? fdopen(fd, "w") : fopen(name, "we");
    if (o->file != NULL)
        return MN_OK;
    const int error = errno;
    if (fd >= 0)
        close(fd);
    free(o->path);
    o->path = NULL;
    return mn_fail(st, MN_FAILED,
                   "%s %s: cannot be written: %s; name a file in a directory that is there, and "
                   "can be written",
                   what, name, strerror(error));
}

mn_code output_good(const output *o, mn_status *st) {
    return ferror(o->file) ? failed(o, errno, st) : MN_OK;
}

/* A link cannot take the place of what stands there: a name beside it can. */
static bool put_in_place(const output *o) {
    char self[SELF_NAME_BYTES];
    const size_t room = strlen(o->path) + TEMP_EXTRA_BYTES;
    char *temp = malloc(room);
    if (temp == NULL)
        return false;
    snprintf(self, sizeof self, "/proc/self/fd/%d", fileno(o->file));
    snprintf(temp, room, "%s.%ld.tmp", o->path, (long)getpid());
    bool done = linkat(AT_FDCWD, self, AT_FDCWD, temp, AT_SYMLINK_FOLLOW) == 0;
    if (done && rename(temp, o->path) != 0) {
        const int error = errno;
        unlink(temp);
        errno = error;
        done = false;
    }
    free(temp);
    return done;
}

mn_code output_close(output *o, bool keep, mn_status *st) {
    if (o->file == NULL)
        return MN_OK;
    mn_code code = MN_OK;
    const bool in_place = o->path == NULL;
    if (fflush(o->file) != 0)
        code = failed(o, errno, st);
    keep = keep && code == MN_OK;
    if (keep && !in_place && (fsync(fileno(o->file)) != 0 || !put_in_place(o)))
        code = failed(o, errno, st);
    if (fclose(o->file) != 0 && code == MN_OK)
        code = failed(o, errno, st);
    if (in_place && (!keep || code != MN_OK) && is_plain(o->name))
        unlink(o->name);
    free(o->path);
    *o = (output){0};
    return code;
}
