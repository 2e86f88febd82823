/* Reading with pread, in the thread that asks: the way that always works.
 *
 * Secret: a read is done when it is submitted. One at a time, so that an urgent command does not
 * stand behind a queue. See method.h for threads and memory. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

#include "mn_assert.h"
#include "method.h"

typedef struct pread_disk {
    int fd;
    bool direct;
    bool has_done;
    mni_done done;
} pread_disk;

static size_t need_bytes(void) {
    return mni_arena_need(1, sizeof(pread_disk), _Alignof(pread_disk));
}

static mn_code open_pread(const mni_method_desc *desc, mni_arena *arena, void **out,
                          mn_status *st) {
    (void)st;
    pread_disk *disk = mni_arena_take(arena, 1, sizeof *disk, _Alignof(pread_disk));
    *disk = (pread_disk){.fd = desc->fd, .direct = desc->direct};
    *out = disk;
    return MN_OK;
}

static void close_pread(void *self) {
    (void)self; /* the descriptor is the caller's */
}

static bool submit(void *self, const mni_read *read) {
    pread_disk *disk = self;
    if (disk->has_done)
        return false;
    ssize_t got = pread(disk->fd, read->bytes, read->length_bytes, (off_t)read->offset);
    disk->done = (mni_done){.tag = read->tag, .result = got < 0 ? -errno : (int32_t)got};
    disk->has_done = true;
    if (!disk->direct && got > 0) /* the page cache is no way round the cap */
        (void)posix_fadvise(disk->fd, (off_t)read->offset, got, POSIX_FADV_DONTNEED);
    return true;
}

static uint32_t collect(void *self, mni_done *out, uint32_t max, bool wait) {
    pread_disk *disk = self;
    (void)wait;
    if (!disk->has_done || max == 0)
        return 0;
    out[0] = disk->done;
    disk->has_done = false;
    return 1;
}

static bool chunk_pread(void *self, uint32_t chunk, bool used) {
    (void)self, (void)chunk, (void)used;
    return true;
}

const mni_method mni_method_pread = {
    .depth = 1,
    .tags = 1,
    .need_bytes = need_bytes,
    .open = open_pread,
    .close = close_pread,
    .submit = submit,
    .collect = collect,
    .chunk = chunk_pread,
};
