/* Trace points, and the rings that they write to.
 *
 *     Navigate ──► ring 0 ──┐  a ring has one producer      ┌► the writer's thread, or
 *     I/O ───────► ring 1 ──┴─► and one consumer ───────────┴► with a simulated disk: the frame's
 *                                                              end, and whoever fills half a ring
 *
 * A trace point asks whether the thread has a ring: that is all that it costs without a trace. An
 * event is 16 bytes; a full ring drops events and counts them, so that nobody waits for a disk.
 *
 * Threads: a ring belongs to whoever has it from mni_trace_swap; open, drain and close to Navigate.
 * Points may stand under locks: they take none, allocate nothing and do not wait. Memory:
 * mni_trace_need_bytes, in a mapping of its own, all of it at open. */
#ifndef MNI_TRACE_H
#define MNI_TRACE_H

#include <stdatomic.h>
#include <stddef.h>

#include "metanode/trace.h"

typedef struct mni_trace mni_trace;

/* 16 bytes, in the ring as in the file. */
typedef struct mni_trace_event {
    uint64_t what; /* kind, aux × 2^8, ns × 2^16: 78 hours */
    uint32_t a, b;
} mni_trace_event;
_Static_assert(sizeof(mni_trace_event) == 16, "as in the file");

typedef struct mni_trace_ring {
    /* const after open */
    mni_trace *trace;
    mni_trace_event *event;
    uint32_t max; /* a power of two */
    /* producer only */
    uint64_t tail_seen; /* the tail is at least there */
    uint64_t ns;        /* of the last event whose time was taken */
    uint32_t absent;    /* block of the last MN_TRACE_ABSENT */
    bool early;
    _Alignas(64) _Atomic uint64_t head; /* producer releases, consumer acquires */
    _Atomic uint64_t dropped;           /* likewise */
    _Alignas(64) _Atomic uint64_t tail; /* consumer releases, producer acquires */
} mni_trace_ring;

/* The calling thread's ring; NULL: it has none. Of the program, not of what it loads: one look, and
 * no call that would find it. */
extern _Thread_local mni_trace_ring *mni_trace_mine __attribute__((tls_model("initial-exec")));

static inline bool mni_trace_on(void) {
    return __builtin_expect(mni_trace_mine != NULL, 0);
}

void mni_trace_put(mn_trace_kind kind, uint32_t aux, uint32_t a, uint32_t b);
/* For what happens every few hundred nanoseconds: takes the time of one event in 64, the others
 * have that one's. */
void mni_trace_put_often(mn_trace_kind kind, uint32_t aux, uint32_t a, uint32_t b);
/* A miss, for want of the block that was absent last or mni_trace_lacks names; bad: of one that
 * contradicts its parent. */
void mni_trace_put_miss(uint32_t aux, bool bad);

/* Arguments are evaluated only where there is a trace. */
#define MNI_TRACE(kind, aux, a, b)                                                                 \
    do {                                                                                           \
        if (mni_trace_on())                                                                        \
            mni_trace_put(kind, aux, a, b);                                                        \
    } while (0)
#define MNI_TRACE_OFTEN(kind, a)                                                                   \
    do {                                                                                           \
        if (mni_trace_on())                                                                        \
            mni_trace_put_often(kind, 0, a, 0);                                                    \
    } while (0)
/* value: uint64_t. At the time of the event before it. */
#define MNI_TRACE_COUNT(counter, value)                                                            \
    do {                                                                                           \
        if (mni_trace_on())                                                                        \
            mni_trace_put_often(MN_TRACE_COUNT, counter, (uint32_t)(value),                        \
                                (uint32_t)((uint64_t)(value) >> 32));                              \
    } while (0)
#define MNI_TRACE_MISS(aux, bad)                                                                   \
    do {                                                                                           \
        if (mni_trace_on())                                                                        \
            mni_trace_put_miss(aux, bad);                                                          \
    } while (0)

/* The next miss is for want of that block, whoever had asked for it. */
static inline void mni_trace_lacks(uint32_t block_id) {
    if (mni_trace_on())
        mni_trace_mine->absent = block_id;
}

static inline uint32_t mni_trace_absent(void) {
    return mni_trace_on() ? mni_trace_mine->absent : 0;
}

/* Until it ends, what is done is for what will be wanted in a moment only, and is marked; what is
 * absent or refused leaves no trace. */
static inline void mni_trace_early(bool early) {
    if (mni_trace_on())
        mni_trace_mine->early = early;
}

/* The ring becomes the calling thread's (NULL: none is); returns what it had before, which is to be
 * given back so. */
static inline mni_trace_ring *mni_trace_swap(mni_trace_ring *ring) {
    mni_trace_ring *before = mni_trace_mine;
    mni_trace_mine = ring;
    return before;
}

/* A simulated disk's clock has moved: that of the calling thread's trace is the same. */
void mni_trace_clock(uint64_t ns);

size_t mni_trace_need_bytes(bool capped); /* is memory bounded (info->ram_cap_bytes)? */
/* Makes the file, and the thread that writes it where the clock is real. info: copied, but for
 * ring_events, which open fills in. */
mn_code mni_trace_open(const char *path, const mn_trace_info *info, mni_trace **out, mn_status *st);
mni_trace_ring *mni_trace_ring_of(mni_trace *trace, mn_trace_thread thread);
/* With a virtual clock: what has happened is written. Otherwise the writer sees to it. */
void mni_trace_drain(mni_trace *trace);
/* Has writing failed? Then nothing more is written; mni_trace_close says why. */
bool mni_trace_has_failed(mni_trace *trace);
/* Writes what is left, and the end. Whoever had a ring has given it back. */
mn_code mni_trace_close(mni_trace *trace, mn_status *st);

#endif
