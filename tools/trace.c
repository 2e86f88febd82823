/* See trace.h. Hides the ring and the text. */
#include "trace.h"

#include "cli.h"

#include <errno.h>
#include <inttypes.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

enum { RING_EVENTS = 1 << 15, STDIO_BYTES = 1 << 14 };

typedef struct trace_event {
    uint32_t event, block_id, slot, generation, value;
} trace_event;

struct trace {
    FILE *file;            /* main thread */
    const char *path;      /* the caller's */
    uint64_t told;         /* main thread: dropped events that the file tells of */
    _Atomic uint64_t head; /* writer (under the pool's lock) releases, main thread acquires */
    _Atomic uint64_t tail; /* main thread releases, writer acquires */
    _Atomic uint64_t dropped;
    trace_event ring[RING_EVENTS];
    char buffer[STDIO_BYTES];
};

uint64_t trace_bytes(void) {
    return sizeof(trace);
}

mn_code trace_open(const char *path, trace **out, mn_status *st) {
    *out = NULL;
    trace *t = calloc(1, sizeof *t);
    if (t == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a trace");
    t->file = fopen(path, "we");
    if (t->file == NULL) {
        free(t);
        return mn_fail(st, MN_FAILED, "--trace %s: cannot be written: %s", path, strerror(errno));
    }
    setvbuf(t->file, t->buffer, _IOFBF, sizeof t->buffer);
    t->path = path;
    fputs("frame,event,block,slot,generation,value\n", t->file);
    *out = t;
    return MN_OK;
}

void trace_hook(void *context, uint32_t event, uint32_t block_id, uint32_t slot,
                uint32_t generation, uint32_t value) {
    trace *t = context;
    uint64_t head = atomic_load_explicit(&t->head, memory_order_relaxed);
    if (head - atomic_load_explicit(&t->tail, memory_order_acquire) == RING_EVENTS) {
        atomic_fetch_add_explicit(&t->dropped, 1, memory_order_relaxed);
        return;
    }
    t->ring[head % RING_EVENTS] = (trace_event){event, block_id, slot, generation, value};
    atomic_store_explicit(&t->head, head + 1, memory_order_release);
}

mn_code trace_flush(trace *t, uint32_t frame, mn_status *st) {
    uint64_t head = atomic_load_explicit(&t->head, memory_order_acquire);
    uint64_t tail = atomic_load_explicit(&t->tail, memory_order_relaxed);
    for (; tail < head; tail++) {
        const trace_event *e = &t->ring[tail % RING_EVENTS];
        fprintf(t->file,
                "%" PRIu32 ",%" PRIu32 ",%" PRIu32 ",%" PRIu32 ",%" PRIu32 ",%" PRIu32 "\n", frame,
                e->event, e->block_id, e->slot, e->generation, e->value);
    }
    atomic_store_explicit(&t->tail, tail, memory_order_release);
    uint64_t dropped = atomic_load_explicit(&t->dropped, memory_order_relaxed);
    if (dropped != t->told)
        fprintf(t->file, "# %" PRIu64 " events did not fit\n", dropped - t->told);
    t->told = dropped;
    return cli_written(t->file, "--trace", t->path, st);
}

mn_code trace_close(trace *t, mn_status *st) {
    if (t == NULL)
        return MN_OK;
    mn_code code = cli_written_all(t->file, "--trace", t->path, st);
    free(t);
    return code;
}
