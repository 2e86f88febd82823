/* The bytes of a trace file: docs/trace.md. Little-endian, as the host is. */
#ifndef MNI_TRACE_LAYOUT_H
#define MNI_TRACE_LAYOUT_H

#include "metanode/trace.h"
#include "trace.h"

#define MNI_TRACE_MAGIC "mntrace\n"
enum {
    MNI_TRACE_VERSION = 1,
    MNI_TRACE_CHUNK_MAGIC = 0x6b686374, /* "tchk" */
    MNI_TRACE_CHUNK_EVENTS = 1 << 13,   /* at most */
    MNI_TRACE_END = 0xff,               /* in place of a chunk's thread: the file is whole */
};

typedef struct mni_trace_head {
    char magic[8];
    uint32_t version, header_bytes, event_bytes, clock;
    uint64_t build_id, model_bytes, triangles;
    uint32_t leaves, blocks, block_bytes_max, block_depth, l, k, k_min, front_max;
    uint32_t store, io, prefetch, flags; /* io_serial 1, barrier 2, degrade_off 4 */
    uint64_t seed, ram_cap_bytes, nav_ops;
    float tolerance_px, fps;
    uint32_t width_px, height_px, ring_events[MN_TRACE_THREADS];
    char model[MN_TRACE_NAME_MAX]; /* ends with 0 */
    unsigned char zero[232];
    uint64_t checksum; /* XXH3 of all before it */
} mni_trace_head;
_Static_assert(sizeof(mni_trace_head) == 512, "");

typedef struct mni_trace_chunk {
    uint32_t magic, thread, count, zero;
    uint64_t dropped;  /* events of this thread that did not fit, up to here */
    uint64_t checksum; /* XXH3 of the events, its seed that of what stands before here */
} mni_trace_chunk;
_Static_assert(sizeof(mni_trace_chunk) == 32, "");

/* In the last chunk, as its two events: of each thread. */
typedef struct mni_trace_sum {
    uint64_t events, dropped;
} mni_trace_sum;
_Static_assert(sizeof(mni_trace_sum) == sizeof(mni_trace_event), "");

uint64_t mni_trace_chunk_checksum(const mni_trace_chunk *chunk, const void *events);

#endif
