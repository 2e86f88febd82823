/* The simulated disk: the real file's bytes, on virtual time, with every kind of trouble.
 *
 * Secret: what happens to a read is decided by the seed when it is submitted, so that a seed
 * replays a run exactly. Each fault is a chance in 1,000 a read:
 *
 *   delay      1 … delay_us_max, and completions in the order of submission, unless
 *   reorder    a read is held back up to 8 times as long while others pass it
 *   short      some of the bytes, 1 … length - 1
 *   eio, eagain
 *   corrupt    one bit turned over
 *   misplaced  the bytes of another place in the file
 *
 * One thread: whoever moves the clock. See method.h. */
#define _GNU_SOURCE
#include <errno.h>
#include <string.h>
#include <unistd.h>

#include "mn_assert.h"
#include "method.h"
#include "trace.h"

enum { DELAY_US_DEFAULT = 200, HELD_BACK_TIMES = 8, PER_MILLE = 1000 };

typedef struct sim_read {
    mni_read read;
    bool waiting;
    uint64_t due_ns, sequence;
    int error; /* 0, EIO, EAGAIN */
    bool is_short, corrupt, misplaced;
    uint64_t dice; /* decides the details of a fault */
} sim_read;

typedef struct sim_disk {
    int fd;
    uint64_t file_bytes;
    mn_sim_desc sim;
    bool faults;
    uint64_t state; /* of the random numbers */
    uint64_t now_ns, last_due_ns, sequence;
    sim_read read[MNI_DISK_DEPTH]; /* by tag */
} sim_disk;

static size_t need_bytes(void) {
    return mni_arena_need(1, sizeof(sim_disk), _Alignof(sim_disk));
}

static uint64_t dice(sim_disk *disk) { /* splitmix64 */
    uint64_t z = disk->state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

static bool chance(sim_disk *disk, uint32_t per_mille) {
    return disk->faults && dice(disk) % PER_MILLE < per_mille;
}

static mn_code open_sim(const mni_method_desc *desc, mni_arena *arena, void **out, mn_status *st) {
    (void)st;
    sim_disk *disk = mni_arena_take(arena, 1, sizeof *disk, _Alignof(sim_disk));
    *disk = (sim_disk){.fd = desc->fd,
                       .file_bytes = desc->file_bytes,
                       .sim = desc->sim,
                       .faults = true,
                       .state = desc->seed};
    if (disk->sim.delay_us_max == 0)
        disk->sim.delay_us_max = DELAY_US_DEFAULT;
    *out = disk;
    return MN_OK;
}

static void close_sim(void *self) {
    (void)self;
}

static bool submit(void *self, const mni_read *read) {
    sim_disk *disk = self;
    MN_ASSERT(read->tag < MNI_DISK_DEPTH && !disk->read[read->tag].waiting);
    sim_read *r = &disk->read[read->tag];
    *r = (sim_read){.read = *read, .waiting = true, .sequence = disk->sequence++};
    uint64_t delay_ns = (1 + dice(disk) % disk->sim.delay_us_max) * 1000;
    if (chance(disk, disk->sim.reorder)) {
        r->due_ns = disk->now_ns + delay_ns * (1 + dice(disk) % HELD_BACK_TIMES);
    } else {
        r->due_ns = disk->now_ns + delay_ns;
        if (r->due_ns < disk->last_due_ns)
            r->due_ns = disk->last_due_ns;
        disk->last_due_ns = r->due_ns;
    }
    if (chance(disk, disk->sim.eagain))
        r->error = EAGAIN;
    if (chance(disk, disk->sim.eio))
        r->error = EIO;
    r->is_short = chance(disk, disk->sim.short_read);
    r->corrupt = chance(disk, disk->sim.corrupt);
    r->misplaced = chance(disk, disk->sim.misplaced);
    r->dice = dice(disk);
    return true;
}

/* Bytes change only now, as with a real disk at any moment before the completion. */
static int32_t carry_out(sim_disk *disk, const sim_read *r) {
    const mni_read *read = &r->read;
    if (r->error != 0)
        return -r->error;
    uint64_t offset = read->offset;
    if (r->misplaced)
        offset = r->dice % (disk->file_bytes / MN_PAGE_BYTES) * MN_PAGE_BYTES;
    ssize_t got = pread(disk->fd, read->bytes, read->length_bytes, (off_t)offset);
    if (got < 0)
        return -errno;
    if (r->misplaced && got < (ssize_t)read->length_bytes)
        got = (ssize_t)read->length_bytes; /* what lay in the buffer before is wrong as well */
    if (r->corrupt && got > 0)
        ((unsigned char *)read->bytes)[r->dice % (uint64_t)got] ^=
            (unsigned char)(1u << (r->dice >> 61));
    if (r->is_short && got > 1) { /* and what is not told of is not there */
        ssize_t all = got;
        got = 1 + (ssize_t)(r->dice % (uint64_t)(all - 1));
        memset((unsigned char *)read->bytes + got, 0xa5, (size_t)(all - got));
    }
    return (int32_t)got;
}

/* The read that completes first, or NULL. */
static sim_read *earliest(sim_disk *disk) {
    sim_read *first = NULL;
    for (uint32_t tag = 0; tag < MNI_DISK_DEPTH; tag++) {
        sim_read *r = &disk->read[tag];
        if (r->waiting && (first == NULL || r->due_ns < first->due_ns ||
                           (r->due_ns == first->due_ns && r->sequence < first->sequence)))
            first = r;
    }
    return first;
}

static uint32_t collect(void *self, mni_done *out, uint32_t max, bool wait) {
    sim_disk *disk = self;
    uint32_t count = 0;
    (void)wait;
    for (sim_read *r; count < max && (r = earliest(disk)) != NULL && r->due_ns <= disk->now_ns;) {
        r->waiting = false;
        out[count++] = (mni_done){.tag = r->read.tag, .result = carry_out(disk, r)};
    }
    return count;
}

static bool chunk_sim(void *self, uint32_t chunk, bool used) {
    (void)self, (void)chunk, (void)used;
    return true;
}

static bool advance(void *self, uint64_t until_ns) {
    sim_disk *disk = self;
    const sim_read *next = earliest(disk);
    bool due = next != NULL && next->due_ns <= until_ns;
    uint64_t to_ns = due ? next->due_ns : until_ns;
    if (to_ns > disk->now_ns && to_ns != UINT64_MAX)
        disk->now_ns = to_ns;
    mni_trace_clock(disk->now_ns);
    return due;
}

static void faults(void *self, bool on) {
    ((sim_disk *)self)->faults = on;
}

const mni_method mni_method_sim = {
    .depth = MNI_DISK_DEPTH,
    .tags = MNI_DISK_DEPTH,
    .own_time = true,
    .need_bytes = need_bytes,
    .open = open_sim,
    .close = close_sim,
    .submit = submit,
    .collect = collect,
    .chunk = chunk_sim,
    .advance = advance,
    .faults = faults,
};
