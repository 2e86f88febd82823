/* Temporary files: see spill.h. Secret: how a file without a name is made, and given one, and what
 * the kernel is told of what comes next. Memory: the state of a kept one's checksum. Threads: each
 * object one at a time. */
#define _GNU_SOURCE /* O_TMPFILE, fallocate, copy_file_range */
#include "spill.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "mn_assert.h"
#include "readahead.h"

enum {
    /* A hole costs a file system tens of microseconds, as long as reading 100 kB takes. */
    DISCARD_BYTES = 1 << 20,
    PAGE_BYTES = 4096,
};

static mn_code not_made(const char *dir, mn_status *st) {
    return mn_fail(st, mn_code_of_write(errno),
                   "%s: cannot make a temporary file: %s; name another folder with --temp-dir", dir,
                   strerror(errno));
}

mn_code mni_spill_open(mni_spill *spill, const char *dir, mn_status *st) {
    *spill = (mni_spill){.dir = dir};
    spill->fd = open(dir, O_RDWR | O_TMPFILE | O_CLOEXEC, 0600);
    if (spill->fd >= 0) {
        mni_readahead(spill->fd);
        return MN_OK;
    }
    char name[PATH_MAX]; /* file systems that have no files without names */
    if (snprintf(name, sizeof name, "%s/.metanode-XXXXXX", dir) >= PATH_MAX) {
        errno = ENAMETOOLONG;
        return not_made(dir, st);
    }
    spill->fd = mkostemp(name, O_CLOEXEC);
    if (spill->fd < 0)
        return not_made(dir, st);
    unlink(name);
    mni_readahead(spill->fd);
    return MN_OK;
}

void mni_spill_close(mni_spill *spill) {
    if (spill->fd < 0)
        return; /* or moved to another, with its sum */
    close(spill->fd);
    spill->fd = -1;
    XXH3_freeState(spill->sum);
    spill->sum = NULL;
}

static mn_code write_failed(mni_spill *spill, int error) {
    mn_code code = mn_code_of_write(error);
    if (code == MN_NO_SPACE)
        return mn_fail(&spill->trouble, code,
                       "%s: %s (%llu bytes of temporary data there); make room, or name another "
                       "folder with --temp-dir",
                       spill->dir,
                       error == EFBIG ? "a temporary file grows past what is allowed (ulimit -f)"
                                      : "no space left for temporary files",
                       (unsigned long long)spill->size_bytes);
    return mn_fail(&spill->trouble, code,
                   "%s: cannot write a temporary file: %s; name another folder with --temp-dir",
                   spill->dir, strerror(error));
}

static mn_code write_all(mni_spill *spill, uint64_t offset, const void *bytes, size_t count) {
    const unsigned char *from = bytes;
    while (count > 0 && spill->trouble.code == MN_OK) {
        ssize_t put = pwrite(spill->fd, from, count, (off_t)offset);
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0)
            return write_failed(spill, put < 0 ? errno : EIO);
        from += put;
        count -= (size_t)put;
        offset += (uint64_t)put;
        spill->bytes_written += (uint64_t)put;
    }
    return spill->trouble.code;
}

mn_code mni_spill_append(mni_spill *spill, const void *bytes, size_t count) {
    if (write_all(spill, spill->size_bytes, bytes, count) != MN_OK)
        return spill->trouble.code;
    if (spill->sum != NULL)
        XXH3_64bits_update(spill->sum, bytes, count);
    spill->size_bytes += count;
    return MN_OK;
}

/* ---- at any place ---------------------------------------------------------------------------- */

mn_code mni_spill_write_at(mni_spill *spill, uint64_t offset, const void *bytes, size_t count) {
    MN_ASSERT(spill->sum == NULL);
    return write_all(spill, offset, bytes, count);
}

static mn_code read_failed(mni_spill *spill, ssize_t got) {
    return mn_fail(&spill->trouble, MN_FAILED, "%s: cannot read a temporary file back: %s",
                   spill->dir, got < 0 ? strerror(errno) : "it is shorter than what was written");
}

static mn_code read_all(mni_spill *spill, uint64_t offset, void *bytes, size_t count, bool some) {
    unsigned char *to = bytes;
    while (count > 0 && spill->trouble.code == MN_OK) {
        ssize_t got = pread(spill->fd, to, count, (off_t)offset);
        if (got < 0 && errno == EINTR)
            continue;
        if (got == 0 && some) {
            memset(to, 0, count);
            break;
        }
        if (got <= 0)
            return read_failed(spill, got);
        to += got;
        count -= (size_t)got;
        offset += (uint64_t)got;
        spill->bytes_read += (uint64_t)got;
    }
    return spill->trouble.code;
}

mn_code mni_spill_read_at(mni_spill *spill, uint64_t offset, void *bytes, size_t count) {
    return read_all(spill, offset, bytes, count, false);
}

mn_code mni_spill_read_some(mni_spill *spill, uint64_t offset, void *bytes, size_t count) {
    return read_all(spill, offset, bytes, count, true);
}

void mni_spill_ask(const mni_spill *spill, uint64_t offset, size_t count) {
    (void)posix_fadvise(spill->fd, (off_t)offset, (off_t)count, POSIX_FADV_WILLNEED);
}

/* ---- writing --------------------------------------------------------------------------------- */

void mni_spill_put_slow(mni_spill_writer *w, const void *bytes, size_t count) {
    const unsigned char *from = bytes;
    MN_ASSERT(w->buffer_bytes > 0);
    while (count > 0) {
        size_t part = w->buffer_bytes - w->used_bytes;
        if (part == 0) {
            mni_spill_append(w->spill, w->buffer, w->used_bytes);
            w->used_bytes = 0;
            continue;
        }
        if (part > count)
            part = count;
        memcpy(w->buffer + w->used_bytes, from, part);
        w->used_bytes += part;
        from += part;
        count -= part;
    }
}

mn_code mni_spill_end(mni_spill_writer *w) {
    mni_spill_append(w->spill, w->buffer, w->used_bytes);
    w->used_bytes = 0;
    return w->spill->trouble.code;
}

/* ---- keeping --------------------------------------------------------------------------------- */

mn_code mni_spill_keep(mni_spill *spill, mn_status *st) {
    MN_ASSERT(spill->fd >= 0 && spill->size_bytes == 0 && spill->sum == NULL);
    spill->sum = XXH3_createState();
    if (spill->sum == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for a temporary file");
    XXH3_64bits_reset(spill->sum);
    return MN_OK;
}

mn_code mni_spill_open_kept(mni_spill *spill, const char *dir, bool keep, mn_status *st) {
    mn_code code = mni_spill_open(spill, dir, st);
    if (code == MN_OK && keep && (code = mni_spill_keep(spill, st)) != MN_OK)
        mni_spill_close(spill);
    return code;
}

uint64_t mni_spill_sum(const mni_spill *spill) {
    MN_ASSERT(spill->sum != NULL);
    return XXH3_64bits_digest(spill->sum);
}

/* 0, or errno. */
static int copy_to_name(const mni_spill *spill, int folder, const char *name) {
    int to = openat(folder, name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600), error = 0;
    off_t from = 0;
    if (to < 0)
        return errno;
    while (error == 0 && (uint64_t)from < spill->size_bytes) {
        ssize_t put =
            copy_file_range(spill->fd, &from, to, NULL, spill->size_bytes - (uint64_t)from, 0);
        if (put == 0 || (put < 0 && errno != EINTR))
            error = put < 0 ? errno : EIO;
    }
    close(to);
    if (error != 0)
        unlinkat(folder, name, 0);
    return error;
}

mn_code mni_spill_name(mni_spill *spill, int folder, const char *name, mn_status *st) {
    char self[32];
    MN_ASSERT(spill->sum != NULL);
    if (spill->trouble.code != MN_OK)
        return mn_fail(st, spill->trouble.code, "%s", spill->trouble.text);
    snprintf(self, sizeof self, "/proc/self/fd/%d", spill->fd);
    if (linkat(AT_FDCWD, self, folder, name, AT_SYMLINK_FOLLOW) == 0)
        return MN_OK;
    int error = errno == EEXIST ? EEXIST : copy_to_name(spill, folder, name);
    if (error == 0)
        return MN_OK;
    return mn_fail(st, mn_code_of_write(error), "%s: cannot keep a temporary file as %s: %s",
                   spill->dir, name, strerror(error));
}

/* The bytes, read once from front to back. */
static mn_code check_sum(mni_spill *spill, uint64_t sum, mn_status *st) {
    enum { PIECE_BYTES = 64 << 10 };
    mni_spill_reader from;
    void *piece = malloc(PIECE_BYTES);
    if (piece == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for a temporary file");
    mni_spill_reader_open(&from, spill, 0, spill->size_bytes, piece, PIECE_BYTES, false);
    for (; mni_spill_refill(&from); from.taken_bytes = from.filled_bytes)
        XXH3_64bits_update(spill->sum, piece, from.filled_bytes);
    free(piece);
    if (spill->trouble.code != MN_OK)
        return mn_fail(st, spill->trouble.code, "%s", spill->trouble.text);
    return XXH3_64bits_digest(spill->sum) == sum ? MN_OK : MN_BAD_INPUT;
}

mn_code mni_spill_resume(mni_spill *spill, const char *dir, int folder, const char *name,
                         uint64_t size_bytes, uint64_t sum, mn_status *st) {
    struct stat info;
    *spill = (mni_spill){.dir = dir};
    spill->fd = openat(folder, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    mn_code code = MN_BAD_INPUT;
    if (spill->fd >= 0 && fstat(spill->fd, &info) == 0 && S_ISREG(info.st_mode) &&
        (uint64_t)info.st_size == size_bytes && (code = mni_spill_keep(spill, st)) == MN_OK) {
        spill->size_bytes = size_bytes;
        mni_readahead(spill->fd);
        code = check_sum(spill, sum, st);
    }
    if (code == MN_OK)
        return MN_OK;
    mni_spill_close(spill);
    return mn_fail(st, code, "%s: not the file that was kept as %s", dir, name);
}

/* ---- reading --------------------------------------------------------------------------------- */

static void ask_for(const mni_spill_reader *r) {
    uint64_t bytes = r->end - r->next;
    if (bytes > 0)
        mni_spill_ask(r->spill, r->next, bytes < r->buffer_bytes ? (size_t)bytes : r->buffer_bytes);
}

/* Whole pages that have been taken; the one in which another piece begins stays. */
static void discard(mni_spill_reader *r, bool all) {
    uint64_t from = (r->discarded + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
    uint64_t to = r->next / PAGE_BYTES * PAGE_BYTES;
    if (to <= from || (!all && to - from < DISCARD_BYTES))
        return;
    (void)fallocate(r->spill->fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)from,
                    (off_t)(to - from));
    r->discarded = to;
}

void mni_spill_reader_open(mni_spill_reader *r, mni_spill *spill, uint64_t from, uint64_t to,
                           void *buffer, size_t buffer_bytes, bool discards) {
    MN_ASSERT(from <= to && to <= spill->size_bytes && buffer_bytes > 0);
    *r = (mni_spill_reader){.spill = spill,
                            .next = from,
                            .end = to,
                            .discarded = discards && spill->sum == NULL ? from : UINT64_MAX,
                            .buffer = buffer,
                            .buffer_bytes = buffer_bytes};
    ask_for(r);
}

bool mni_spill_refill(mni_spill_reader *r) {
    mni_spill *spill = r->spill;
    size_t kept = r->filled_bytes - r->taken_bytes, room = r->buffer_bytes - kept;
    uint64_t left = r->end - r->next;
    size_t want = left < room ? (size_t)left : room;
    memmove(r->buffer, r->buffer + r->taken_bytes, kept);
    r->filled_bytes = kept;
    r->taken_bytes = 0;
    if (r->discarded != UINT64_MAX)
        discard(r, want == 0);
    if (want > 0 && mni_spill_read_at(spill, r->next, r->buffer + kept, want) == MN_OK) {
        r->filled_bytes += want;
        r->next += want;
    }
    if (spill->trouble.code != MN_OK)
        r->filled_bytes = 0;
    else
        ask_for(r);
    return r->filled_bytes > 0;
}
