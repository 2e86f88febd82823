/* Reading with io_uring: many reads in flight, into registered buffers where that is allowed.
 *
 * Secret: everything about liburing. A chunk of place holders is one registered buffer; where the
 * limit on locked memory (RLIMIT_MEMLOCK, 8 MB for an ordinary user) refuses one, that chunk and
 * those after it are read into without, with one warning. Submissions wait in the ring until
 * collect starts them together. See method.h for threads and memory. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <liburing.h>
#include <stdio.h>
#include <string.h>

#include "mn_assert.h"
#include "method.h"

enum { CHUNKS_REGISTERED_MAX = 16384 }; /* the kernel's IORING_MAX_REG_BUFFERS; others do without */

typedef struct uring_disk {
    /* const after open */
    int fd;
    bool direct;
    mni_chunks chunks;
    bool sparse; /* the kernel has a table of buffers that can be filled in one by one */
    /* I/O only */
    struct io_uring ring;
    mni_read read[MNI_DISK_TAGS]; /* by tag */
    uint32_t in_flight;
    /* written between frames while no read uses the chunk */
    uint32_t registered; /* chunks [0, registered) have been registered at open */
} uring_disk;

static size_t need_bytes(void) {
    return mni_arena_need(1, sizeof(uring_disk), _Alignof(uring_disk));
}

static bool set_buffer(uring_disk *disk, uint32_t chunk, bool used) {
    size_t from = chunk * disk->chunks.chunk_bytes;
    size_t left = disk->chunks.all_bytes - from;
    struct iovec buffer = {0};
    __u64 tag = 0;
    if (used)
        buffer = (struct iovec){
            .iov_base = disk->chunks.base + from,
            .iov_len = left < disk->chunks.chunk_bytes ? left : disk->chunks.chunk_bytes};
    return io_uring_register_buffers_update_tag(&disk->ring, chunk, &buffer, &tag, 1) == 1;
}

static void register_chunks(uring_disk *disk, const mni_method_desc *desc) {
    uint32_t count =
        disk->chunks.count < CHUNKS_REGISTERED_MAX ? disk->chunks.count : CHUNKS_REGISTERED_MAX;
    disk->sparse = io_uring_register_buffers_sparse(&disk->ring, count) == 0;
    while (disk->sparse && disk->registered < count && set_buffer(disk, disk->registered, true))
        disk->registered++;
    if (disk->registered == disk->chunks.count || desc->warn == NULL)
        return;
    char text[200];
    snprintf(text, sizeof text,
             "%u of %u parts of the place holders are fixed buffers: the rest is refused; reads go "
             "on without (see ulimit -l)",
             disk->registered, disk->chunks.count);
    desc->warn(desc->warn_context, text);
}

static mn_code open_uring(const mni_method_desc *desc, mni_arena *arena, void **out,
                          mn_status *st) {
    uring_disk *disk = mni_arena_take(arena, 1, sizeof *disk, _Alignof(uring_disk));
    *disk = (uring_disk){.fd = desc->fd, .direct = desc->direct, .chunks = desc->chunks};
    int error = io_uring_queue_init(MNI_DISK_DEPTH, &disk->ring, 0);
    if (error != 0)
        return mn_fail(st, MN_FAILED, "io_uring is refused: %s", strerror(-error));
    register_chunks(disk, desc);
    *out = disk;
    return MN_OK;
}

static void close_uring(void *self) {
    uring_disk *disk = self;
    MN_ASSERT(disk->in_flight == 0);
    io_uring_queue_exit(&disk->ring);
}

static bool submit(void *self, const mni_read *read) {
    uring_disk *disk = self;
    MN_ASSERT(read->tag < MNI_DISK_TAGS);
    struct io_uring_sqe *sqe = io_uring_get_sqe(&disk->ring);
    if (sqe == NULL)
        return false;
    disk->read[read->tag] = *read;
    if (read->chunk < disk->registered)
        io_uring_prep_read_fixed(sqe, disk->fd, read->bytes, read->length_bytes, read->offset,
                                 (int)read->chunk);
    else
        io_uring_prep_read(sqe, disk->fd, read->bytes, read->length_bytes, read->offset);
    io_uring_sqe_set_data64(sqe, read->tag);
    disk->in_flight++;
    return true;
}

static uint32_t collect(void *self, mni_done *out, uint32_t max, bool wait) {
    uring_disk *disk = self;
    struct io_uring_cqe *cqe = NULL;
    /* EINTR, EAGAIN, EBUSY: what is left in the ring goes with the next call. */
    (void)io_uring_submit(&disk->ring);
    if (wait && disk->in_flight > 0) {
        struct __kernel_timespec limit = {.tv_nsec = MNI_COLLECT_WAIT_US * 1000};
        (void)io_uring_wait_cqe_timeout(&disk->ring, &cqe, &limit);
    }
    uint32_t count = 0;
    while (count < max && io_uring_peek_cqe(&disk->ring, &cqe) == 0) {
        uint32_t tag = (uint32_t)io_uring_cqe_get_data64(cqe);
        MN_ASSERT(tag < MNI_DISK_TAGS && disk->in_flight > 0);
        out[count++] = (mni_done){.tag = tag, .result = cqe->res};
        io_uring_cqe_seen(&disk->ring, cqe);
        disk->in_flight--;
        const mni_read *read = &disk->read[tag];
        if (!disk->direct && out[count - 1].result > 0)
            (void)posix_fadvise(disk->fd, (off_t)read->offset, read->length_bytes,
                                POSIX_FADV_DONTNEED);
    }
    return count;
}

static bool chunk_uring(void *self, uint32_t chunk, bool used) {
    uring_disk *disk = self;
    return chunk >= disk->registered || set_buffer(disk, chunk, used);
}

const mni_method mni_method_uring = {
    .depth = MNI_DISK_DEPTH,
    .tags = MNI_DISK_TAGS,
    .need_bytes = need_bytes,
    .open = open_uring,
    .close = close_uring,
    .submit = submit,
    .collect = collect,
    .chunk = chunk_uring,
};
