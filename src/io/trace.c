/* Traces, the writing half. See trace.h.
 *
 * Secret: when a ring is emptied, and by whom. With a real clock by a thread of the trace's own,
 * every tenth of a second or when a ring is half full; it alone waits for the disk. With the
 * virtual clock of a simulated disk by the thread that fills them, at the end of a frame or when
 * half a ring is full: nothing of it depends on how fast anything is, so that a run writes the same
 * bytes each time, and nothing is dropped.
 *
 * Order of calls: open; then rings are filled by their threads; close. Memory: one mapping for the
 * rings and this struct, and the thread's stack. Paper: none. */
#define _GNU_SOURCE
#include "trace_layout.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <string.h>
#include <sys/uio.h>
#include <unistd.h>
#include <xxhash.h>

#include "mn_assert.h"
#include "clock.h"
#include "mem.h"

enum {
    /* Half of it are some 5 ms of splits and nothing else: the writer has that long. */
    NAVIGATE_EVENTS = 1 << 15,
    IO_EVENTS = 1 << 13,
    ROOMY = 8, /* times that, where memory has no cap: 40 ms, so that a busy machine drops none */
    OFTEN = 64,
    FETCHED = 16, /* events: 4 lines of the cache */
    PAUSE_NS = 100 * 1000 * 1000,
    THREAD_STACK_BYTES = 64 * 1024, /* it calls the kernel and a checksum */
};

struct mni_trace {
    /* const after open */
    mni_arena arena;
    int fd;
    bool is_virtual;
    bool has_thread;
    pthread_t thread;
    sem_t work; /* half a ring is full, or stop */
    char path[600];
    uint64_t began_ns;
    /* any thread */
    _Atomic bool stop;
    _Atomic int error; /* errno of the first failed write; 0: none */
    /* Navigate, where the clock is virtual */
    uint64_t virtual_ns, last_ns;
    /* whoever empties the rings */
    uint64_t written[MN_TRACE_THREADS], told[MN_TRACE_THREADS];
    mni_trace_ring ring[MN_TRACE_THREADS];
};

_Thread_local mni_trace_ring *mni_trace_mine __attribute__((tls_model("initial-exec")));

/* ---- trace points ---------------------------------------------------------------------------- */

static void take_time(mni_trace_ring *ring) {
    mni_trace *t = ring->trace;
    if (t->is_virtual)
        ring->ns = t->last_ns = t->virtual_ns > t->last_ns ? t->virtual_ns : t->last_ns + 1;
    else
        ring->ns = mni_clock_ns(CLOCK_MONOTONIC) - t->began_ns;
}

static void half_full(mni_trace *t) {
    if (t->is_virtual)
        mni_trace_drain(t);
    else
        (void)sem_post(&t->work);
}

/* The ring is half full or more, as far as its producer knows. false: it is full. */
static bool has_room(mni_trace_ring *ring, uint64_t head) {
    ring->tail_seen = atomic_load_explicit(&ring->tail, memory_order_acquire);
    if (head - ring->tail_seen == ring->max) {
        const uint64_t dropped = atomic_load_explicit(&ring->dropped, memory_order_relaxed);
        atomic_store_explicit(&ring->dropped, dropped + 1, memory_order_release);
        return false;
    }
    if (head - ring->tail_seen >= ring->max / 2 && head % (ring->max / 4) == 0)
        half_full(ring->trace);
    return true;
}

static inline void store(mni_trace_ring *ring, uint64_t head, uint64_t what, uint32_t a,
                         uint32_t b) {
    ring->event[head & (ring->max - 1)] = (mni_trace_event){what | ring->ns << 16, a, b};
    /* The consumer has had the lines ahead: they come back while there is time. */
    __builtin_prefetch(&ring->event[(head + FETCHED) & (ring->max - 1)], 1);
    atomic_store_explicit(&ring->head, head + 1, memory_order_release);
}

static inline bool is_half_full(const mni_trace_ring *ring, uint64_t head) {
    return head - ring->tail_seen >= ring->max / 2;
}

static __attribute__((noinline)) void put_slow(mni_trace_ring *ring, uint64_t what, uint32_t a,
                                               uint32_t b) {
    const uint64_t head = atomic_load_explicit(&ring->head, memory_order_relaxed);
    take_time(ring);
    if (!is_half_full(ring, head) || has_room(ring, head))
        store(ring, head, what, a, b);
}

void mni_trace_put(mn_trace_kind kind, uint32_t aux, uint32_t a, uint32_t b) {
    mni_trace_ring *ring = mni_trace_mine;
    if (ring->early && kind != MN_TRACE_PHASE) {
        if (kind == MN_TRACE_ABSENT || kind == MN_TRACE_REFUSED)
            return;
        aux |= MN_TRACE_EARLY;
    }
    if (kind == MN_TRACE_ABSENT)
        ring->absent = a;
    put_slow(ring, (uint64_t)kind | (uint64_t)aux << 8, a, b);
}

void mni_trace_put_often(mn_trace_kind kind, uint32_t aux, uint32_t a, uint32_t b) {
    mni_trace_ring *ring = mni_trace_mine;
    const uint64_t head = atomic_load_explicit(&ring->head, memory_order_relaxed);
    if (__builtin_expect(head % OFTEN == 0 || is_half_full(ring, head), 0))
        put_slow(ring, kind | aux << 8, a, b);
    else
        store(ring, head, kind | aux << 8, a, b);
}

void mni_trace_put_miss(uint32_t aux, bool bad) {
    mni_trace_put(MN_TRACE_MISS, aux, bad ? 0 : mni_trace_mine->absent, 0);
}

void mni_trace_clock(uint64_t ns) {
    if (mni_trace_on())
        mni_trace_mine->trace->virtual_ns = ns;
}

/* ---- writing --------------------------------------------------------------------------------- */

uint64_t mni_trace_chunk_checksum(const mni_trace_chunk *chunk, const void *events) {
    const XXH64_hash_t seed = XXH3_64bits(chunk, offsetof(mni_trace_chunk, checksum));
    return XXH3_64bits_withSeed(events, chunk->count * sizeof(mni_trace_event), seed);
}

/* After a failure nothing more is written. A part may be empty. */
static void write_all(mni_trace *t, struct iovec *part, int parts) {
    while (parts > 0 && atomic_load_explicit(&t->error, memory_order_relaxed) == 0) {
        const ssize_t done = writev(t->fd, part, parts);
        size_t left = done > 0 ? (size_t)done : 0;
        if (done < 0 && errno != EINTR)
            atomic_store_explicit(&t->error, errno, memory_order_release);
        for (; parts > 0 && left >= part->iov_len; part++, parts--)
            left -= part->iov_len;
        if (left > 0) {
            part->iov_base = (unsigned char *)part->iov_base + left;
            part->iov_len -= left;
        }
    }
}

static void write_chunk(mni_trace *t, uint32_t thread, const void *events, uint32_t count,
                        uint64_t dropped) {
    mni_trace_chunk chunk = {
        .magic = MNI_TRACE_CHUNK_MAGIC, .thread = thread, .count = count, .dropped = dropped};
    chunk.checksum = mni_trace_chunk_checksum(&chunk, events);
    struct iovec part[] = {{&chunk, sizeof chunk},
                           {(void *)(uintptr_t)events, count * sizeof(mni_trace_event)}};
    write_all(t, part, 2);
}

static void empty(mni_trace *t, uint32_t thread) {
    mni_trace_ring *ring = &t->ring[thread];
    const uint64_t head = atomic_load_explicit(&ring->head, memory_order_acquire);
    const uint64_t dropped = atomic_load_explicit(&ring->dropped, memory_order_acquire);
    uint64_t tail = atomic_load_explicit(&ring->tail, memory_order_relaxed);
    while (tail < head || t->told[thread] < dropped) {
        uint64_t count = head - tail, to_end = ring->max - (tail & (ring->max - 1));
        count = count < to_end ? count : to_end;
        count = count < MNI_TRACE_CHUNK_EVENTS ? count : MNI_TRACE_CHUNK_EVENTS;
        write_chunk(t, thread, &ring->event[tail & (ring->max - 1)], (uint32_t)count, dropped);
        t->told[thread] = dropped;
        t->written[thread] += count;
        tail += count;
        atomic_store_explicit(&ring->tail, tail, memory_order_release);
    }
}

static void empty_all(mni_trace *t) {
    for (uint32_t thread = 0; thread < MN_TRACE_THREADS; thread++)
        empty(t, thread);
}

static void *run(void *context) {
    mni_trace *t = context;
    while (!atomic_load_explicit(&t->stop, memory_order_acquire)) {
        const uint64_t until_ns = mni_clock_ns(CLOCK_MONOTONIC) + PAUSE_NS;
        const struct timespec until = {.tv_sec = (time_t)(until_ns / 1000000000u),
                                       .tv_nsec = (long)(until_ns % 1000000000u)};
        (void)sem_clockwait(&t->work, CLOCK_MONOTONIC, &until);
        empty_all(t);
    }
    return NULL;
}

void mni_trace_drain(mni_trace *t) {
    if (t->is_virtual)
        empty_all(t);
}

/* ---- open and close -------------------------------------------------------------------------- */

static uint32_t events_max(mn_trace_thread thread, bool capped) {
    return (thread == MN_TRACE_NAVIGATE ? NAVIGATE_EVENTS : IO_EVENTS) * (capped ? 1 : ROOMY);
}

static size_t arena_bytes(bool capped) {
    size_t sum = mni_arena_need(1, sizeof(mni_trace), _Alignof(mni_trace));
    for (uint32_t i = 0; i < MN_TRACE_THREADS; i++)
        sum += mni_arena_need(events_max(i, capped), sizeof(mni_trace_event), 64);
    return sum;
}

size_t mni_trace_need_bytes(bool capped) {
    return arena_bytes(capped) + THREAD_STACK_BYTES;
}

static void write_head(mni_trace *t, const mn_trace_info *info) {
    mni_trace_head head = {
        .magic = MNI_TRACE_MAGIC,
        .version = MNI_TRACE_VERSION,
        .header_bytes = sizeof head,
        .event_bytes = sizeof(mni_trace_event),
        .clock = info->clock,
        .build_id = info->build_id,
        .model_bytes = info->model_bytes,
        .triangles = info->triangles,
        .leaves = info->leaves,
        .blocks = info->blocks,
        .block_bytes_max = info->block_bytes_max,
        .block_depth = info->block_depth,
        .l = info->l,
        .k = info->k,
        .k_min = info->k_min,
        .front_max = info->front_max,
        .store = info->store,
        .io = info->io,
        .prefetch = info->prefetch,
        .flags = info->io_serial | info->barrier << 1 | info->degrade_off << 2,
        .seed = info->seed,
        .ram_cap_bytes = info->ram_cap_bytes,
        .nav_ops = info->nav_ops,
        .tolerance_px = info->tolerance_px,
        .fps = info->fps,
        .width_px = info->width_px,
        .height_px = info->height_px,
        .ring_events = {t->ring[0].max, t->ring[1].max},
    };
    memcpy(head.model, info->model, sizeof head.model - 1);
    head.checksum = XXH3_64bits(&head, offsetof(mni_trace_head, checksum));
    struct iovec part = {&head, sizeof head};
    write_all(t, &part, 1);
}

static mn_code start(mni_trace *t, mn_status *st) {
    pthread_attr_t attributes;
    int error = pthread_attr_init(&attributes);
    if (error == 0) {
        (void)pthread_attr_setstacksize(&attributes, THREAD_STACK_BYTES);
        error = pthread_create(&t->thread, &attributes, run, t);
        pthread_attr_destroy(&attributes);
    }
    if (error != 0)
        return mn_fail(st, MN_FAILED, "cannot start the trace's thread: %s", strerror(error));
    t->has_thread = true;
    return MN_OK;
}

mn_code mni_trace_open(const char *path, const mn_trace_info *info, mni_trace **out,
                       mn_status *st) {
    const bool capped = info->ram_cap_bytes > 0;
    mni_arena arena;
    *out = NULL;
    mn_code code = mni_arena_open(&arena, arena_bytes(capped), st);
    if (code != MN_OK)
        return code;
    mni_trace *t = mni_arena_take(&arena, 1, sizeof *t, _Alignof(mni_trace));
    for (uint32_t i = 0; i < MN_TRACE_THREADS; i++) {
        t->ring[i].max = events_max(i, capped);
        t->ring[i].event = mni_arena_take(&arena, t->ring[i].max, sizeof(mni_trace_event), 64);
        t->ring[i].trace = t;
    }
    t->arena = arena;
    mni_arena_seal(&t->arena);
    t->is_virtual = info->clock == MN_TRACE_VIRTUAL;
    t->began_ns = mni_clock_ns(CLOCK_MONOTONIC);
    MN_ASSERT(sem_init(&t->work, 0, 0) == 0);
    strncpy(t->path, path, sizeof t->path - 1);
    t->fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (t->fd < 0)
        code = mn_fail(st, MN_FAILED,
                       "trace %s: cannot be written: %s; name a file in a directory that is there, "
                       "and can be written",
                       path, strerror(errno));
    if (code == MN_OK) {
        write_head(t, info);
        code = t->is_virtual ? MN_OK : start(t, st);
    }
    if (code == MN_OK)
        *out = t;
    else
        (void)mni_trace_close(t, NULL);
    return code;
}

mni_trace_ring *mni_trace_ring_of(mni_trace *t, mn_trace_thread thread) {
    return &t->ring[thread];
}

bool mni_trace_has_failed(mni_trace *t) {
    return atomic_load_explicit(&t->error, memory_order_relaxed) != 0;
}

mn_code mni_trace_close(mni_trace *t, mn_status *st) {
    if (t == NULL)
        return MN_OK;
    if (t->has_thread) {
        atomic_store_explicit(&t->stop, true, memory_order_release);
        (void)sem_post(&t->work);
        pthread_join(t->thread, NULL);
    }
    mn_code code = MN_OK;
    if (t->fd >= 0) {
        empty_all(t);
        mni_trace_sum sum[MN_TRACE_THREADS];
        for (int i = 0; i < MN_TRACE_THREADS; i++)
            sum[i] = (mni_trace_sum){t->written[i], t->told[i]};
        write_chunk(t, MNI_TRACE_END, sum, MN_TRACE_THREADS, 0);
        int error = atomic_load_explicit(&t->error, memory_order_acquire);
        if (close(t->fd) != 0 && error == 0)
            error = errno;
        if (error != 0)
            code = mn_fail(st, mn_code_of_write(error),
                           "trace %s: cannot be written whole: %s; make space on its disk, or name "
                           "another",
                           t->path, strerror(error));
    }
    sem_destroy(&t->work);
    mni_arena arena = t->arena;
    mni_arena_close(&arena);
    return code;
}
