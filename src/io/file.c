/* Files, whole: see file.h.
 *
 * Secret: files without names, the temporary name, the buffer, and the order of sync and naming
 * that makes a new file appear at once and complete. A mni_out owns its two names and a buffer of
 * TAIL_BYTES. Threads: each object one at a time. (design.md §3.5) */
#define _GNU_SOURCE /* O_TMPFILE */
#include "file.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mn_assert.h"

enum {
    TAIL_BYTES = 256 * 1024, /* appends of a few bytes become few, large writes */
    TEMP_TRIES_MAX = 1000,   /* names of this process in one directory */
    TEMP_NAME_BYTES = 64,
    SELF_NAME_BYTES = 32,
};

/* ---- reading ------------------------------------------------------------------------------- */

mn_code mni_in_open(mni_in *in, const char *path, mn_status *st) {
    *in = (mni_in){.fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK)};
    if (in->fd < 0)
        return mn_fail(st, MN_BAD_INPUT, "%s: cannot open: %s", path, strerror(errno));
    struct stat info;
    if (fstat(in->fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        mni_in_close(in);
        return mn_fail(st, MN_BAD_INPUT, "%s: not a file; give the name of a regular file", path);
    }
    in->size_bytes = (uint64_t)info.st_size;
    return MN_OK;
}

int64_t mni_in_read(const mni_in *in, uint64_t offset, void *bytes, size_t count) {
    size_t done = 0;
    while (done < count) {
        ssize_t got =
            pread(in->fd, (unsigned char *)bytes + done, count - done, (off_t)(offset + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return -errno;
        if (got == 0)
            break;
        done += (size_t)got;
    }
    return (int64_t)done;
}

void mni_in_close(mni_in *in) {
    if (in->fd >= 0)
        close(in->fd);
    in->fd = -1;
}

/* ---- writing ------------------------------------------------------------------------------- */

static mn_code write_failed(mni_out *out, int error, mn_status *st) {
    out->failed = mn_code_of_write(error);
    if (out->failed == MN_NO_SPACE)
        return mn_fail(st, MN_NO_SPACE, "%s: %s; make room, or write to another disk", out->path,
                       error == EFBIG ? "the file grows past what is allowed (ulimit -f)"
                                      : "no space left on the disk");
    return mn_fail(st, MN_FAILED, "%s: cannot write: %s; try another disk", out->path,
                   strerror(error));
}

static int write_whole(int fd, const unsigned char *bytes, size_t count, uint64_t offset) {
    while (count > 0) {
        ssize_t put = pwrite(fd, bytes, count, (off_t)offset);
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0)
            return put < 0 ? errno : EIO;
        bytes += put;
        count -= (size_t)put;
        offset += (uint64_t)put;
    }
    return 0;
}

static mn_code flush(mni_out *out, mn_status *st) {
    int error = write_whole(out->fd, out->tail, out->tail_bytes, out->offset);
    if (error != 0)
        return write_failed(out, error, st);
    out->offset += out->tail_bytes;
    out->tail_bytes = 0;
    return MN_OK;
}

/* Bytes of the directory's name in path, its last slash included; 0: the working directory. */
static size_t directory_length(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash == NULL ? 0 : (size_t)(slash - path) + 1;
}

/* A name that nothing has, beside the final one so that rename stays on one disk. */
static void temporary_name(mni_out *out, int number) {
    size_t directory = directory_length(out->path);
    snprintf(out->temp + directory, TEMP_NAME_BYTES, ".metanode-%ld-%d.tmp", (long)getpid(),
             number);
}

/* How a file without a name is found to be given one. */
static void self_name(int fd, char name[SELF_NAME_BYTES]) {
    snprintf(name, SELF_NAME_BYTES, "/proc/self/fd/%d", fd);
}

/* A file without a name goes with the process, however that ends. Not every file system has them,
 * and where /proc is not there it could not be given one. -1: not here. */
static int open_nameless(mni_out *out) {
    char self[SELF_NAME_BYTES];
    size_t directory = directory_length(out->path);
    memcpy(out->temp + directory, ".", 2); /* PATH/. or . */
    int fd = open(out->temp, O_RDWR | O_TMPFILE | O_CLOEXEC, 0666);
    if (fd < 0)
        return -1;
    self_name(fd, self);
    if (access(self, F_OK) == 0)
        return fd;
    close(fd);
    return -1;
}

static int open_temporary(mni_out *out) {
    size_t directory = directory_length(out->path);
    out->temp = malloc(directory + TEMP_NAME_BYTES);
    if (out->temp == NULL)
        return ENOMEM;
    memcpy(out->temp, out->path, directory);
    out->fd = open_nameless(out);
    out->named = out->fd < 0;
    for (int i = 0; out->fd < 0 && i < TEMP_TRIES_MAX; i++) {
        temporary_name(out, i);
        out->fd = open(out->temp, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (out->fd < 0 && errno != EEXIST)
            break;
    }
    if (out->fd >= 0)
        return 0;
    out->named = false; /* not ours to unlink */
    return errno;
}

/* Gives a nameless file its final name, where nothing has it: then there is no moment at which a
 * kill would leave a temporary name behind. */
static bool name_finally(mni_out *out) {
    char self[SELF_NAME_BYTES];
    self_name(out->fd, self);
    return !out->named && linkat(AT_FDCWD, self, AT_FDCWD, out->path, AT_SYMLINK_FOLLOW) == 0;
}

/* Gives a nameless file a temporary name: a link cannot take the place of what stands there. */
static int name_temporary(mni_out *out) {
    char self[SELF_NAME_BYTES];
    self_name(out->fd, self);
    for (int i = 0; !out->named && i < TEMP_TRIES_MAX; i++) {
        temporary_name(out, i);
        out->named = linkat(AT_FDCWD, self, AT_FDCWD, out->temp, AT_SYMLINK_FOLLOW) == 0;
        if (!out->named && errno != EEXIST)
            break;
    }
    return out->named ? 0 : errno;
}

mn_code mni_out_open(mni_out *out, const char *path, mn_status *st) {
    *out = (mni_out){.fd = -1};
    struct stat info;
    bool exists = stat(path, &info) == 0;
    if (exists && !S_ISREG(info.st_mode))
        return mn_fail(st, MN_FAILED, "%s: not a regular file; name another output", path);
    out->path = exists ? realpath(path, NULL) : strdup(path);
    out->tail = malloc(TAIL_BYTES);
    int error = out->path == NULL || out->tail == NULL ? ENOMEM : open_temporary(out);
    if (error != 0) {
        mni_out_abort(out);
        return mn_fail(st, mn_code_of_write(error),
                       "%s: cannot create: %s; name a directory that is there, can be written and "
                       "has room",
                       path, strerror(error));
    }
    return MN_OK;
}

mn_code mni_out_write(mni_out *out, const void *bytes, size_t count, mn_status *st) {
    const unsigned char *from = bytes;
    while (count > 0 && out->failed == MN_OK) {
        size_t part = TAIL_BYTES - out->tail_bytes;
        if (part > count)
            part = count;
        memcpy(out->tail + out->tail_bytes, from, part);
        out->tail_bytes += part;
        from += part;
        count -= part;
        if (out->tail_bytes == TAIL_BYTES)
            flush(out, st);
    }
    return out->failed;
}

mn_code mni_out_write_at(mni_out *out, uint64_t offset, const void *bytes, size_t count,
                         mn_status *st) {
    if (out->failed != MN_OK || flush(out, st) != MN_OK)
        return out->failed;
    int error = write_whole(out->fd, bytes, count, offset);
    return error == 0 ? MN_OK : write_failed(out, error, st);
}

int64_t mni_out_read(const mni_out *out, uint64_t offset, void *bytes, size_t count) {
    const mni_in in = {.fd = out->fd};
    return mni_in_read(&in, offset, bytes, count);
}

void mni_out_discard(mni_out *out, uint64_t from, uint64_t to) {
    (void)fallocate(out->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)from,
                    (off_t)(to - from));
}

uint64_t mni_out_at(const mni_out *out) {
    return out->offset + out->tail_bytes;
}

/* The new name is durable only when the directory is. File systems that cannot sync one are left
 * alone: the file itself is safe. */
static void sync_directory(const char *path) {
    size_t length = directory_length(path);
    char *name = length > 0 ? strndup(path, length) : strdup(".");
    int fd = name == NULL ? -1 : open(name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd >= 0) {
        (void)fsync(fd);
        close(fd);
    }
    free(name);
}

mn_code mni_out_commit(mni_out *out, mn_status *st) {
    MN_ASSERT(out->fd >= 0);
    if (out->failed == MN_OK)
        flush(out, st);
    if (out->failed == MN_OK &&
        (fsync(out->fd) != 0 ||
         (!name_finally(out) && (name_temporary(out) != 0 || rename(out->temp, out->path) != 0))))
        write_failed(out, errno, st);
    mn_code code = out->failed;
    if (code == MN_OK) {
        sync_directory(out->path);
        out->named = false; /* renamed: nothing to remove */
    }
    mni_out_abort(out);
    return code;
}

void mni_out_abort(mni_out *out) {
    if (out->path == NULL && out->tail == NULL)
        return; /* zeroed or closed before */
    if (out->fd >= 0)
        close(out->fd);
    if (out->named)
        unlink(out->temp);
    free(out->temp);
    free(out->path);
    free(out->tail);
    *out = (mni_out){.fd = -1};
}
