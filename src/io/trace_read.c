/* Traces, the reading half. See metanode/trace.h; the bytes: docs/trace.md.
 *
 * Secret: that the two threads' events stand in chunks one after the other, each in its own order.
 * Two cursors go through the file, one a thread, each past the other's chunks; the earlier of their
 * next events is the next one. So order is exact and memory constant: a chunk for each cursor.
 *
 * A first pass, at open, checks every byte; the second checks again, since a file may change.
 *
 * Order of calls: open; next and rewind; close. One thread at a time. Paper: none. */
#include "trace_layout.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "mn_assert.h"
#include "file.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files are little-endian");

typedef struct cursor {
    uint64_t at;          /* the next chunk, in the file */
    uint64_t events;      /* handed out, or jumped over */
    uint64_t dropped, ns; /* as the last chunk, the last event says */
    uint32_t next, count; /* of the events below */
    mni_trace_event event[MNI_TRACE_CHUNK_EVENTS];
} cursor;

struct mn_trace_file {
    mni_in in;
    char name[MN_TRACE_NAME_MAX];
    mn_trace_info info;
    uint64_t end; /* of what is read: the last chunk's place */
    bool cut;
    mni_trace_sum sum[MN_TRACE_THREADS];
    cursor cursor[MN_TRACE_THREADS];
};

/* ---- bytes ----------------------------------------------------------------------------------- */

/* MN_BAD_INPUT, its text with the place. */
static mn_code damaged(const mn_trace_file *file, uint64_t at, const char *what, mn_status *st) {
    return mn_fail(st, MN_BAD_INPUT, "%s: at byte %" PRIu64 ": %s; record it again", file->name, at,
                   what);
}

static mn_code read_at(const mn_trace_file *file, uint64_t at, void *bytes, size_t count,
                       mn_status *st) {
    const int64_t got = mni_in_read(&file->in, at, bytes, count);
    if (got < 0)
        return mn_fail(st, MN_FAILED, "%s: cannot be read: %s", file->name, strerror((int)-got));
    if (got == (int64_t)count)
        return MN_OK;
    return mn_fail(
        st, MN_BAD_INPUT,
        "%s: the trace ends before its end: the run was stopped, or its disk full; --cut "
        "reads what is there",
        file->name);
}

/* For aux_end: of kinds that may be marked as early; aux: without the mark. */
static uint32_t aux_end_marked(uint32_t kind, uint32_t aux) {
    switch ((mn_trace_kind)kind) {
    case MN_TRACE_MISS:
    case MN_TRACE_GRANT_OVER:
        return 2;
    case MN_TRACE_HOLDER:
        return (aux & 7) < MN_TRACE_PLACES ? 8 * MN_TRACE_PLACES : 0;
    case MN_TRACE_LOST:
        return (aux & 7) < MN_TRACE_PLACES ? 16 : 0;
    case MN_TRACE_LOCK_WAIT:
        return MN_TRACE_LOCKS;
    case MN_TRACE_SPLIT:
    case MN_TRACE_COLLAPSE:
    case MN_TRACE_ABSENT:
    case MN_TRACE_USE:
    case MN_TRACE_LEAVE:
    case MN_TRACE_GRANT:
    case MN_TRACE_SUBMIT:
    case MN_TRACE_PREFETCH_USED:
        return 1;
    default: /* no kind at all */
        return 0;
    }
}

/* One more than the largest value that may stand in aux; 0: none may. *value: what does. Only what
 * is done early is marked as such; elsewhere the mark is a value too large. */
static uint32_t aux_end(uint32_t kind, uint32_t aux, uint32_t *value) {
    *value = aux;
    switch ((mn_trace_kind)kind) {
    case MN_TRACE_FRAME_BEGIN:
    case MN_TRACE_FRAME_END:
        return MN_TRACE_ROUNDS;
    case MN_TRACE_PHASE:
        return MN_TRACE_PHASES;
    case MN_TRACE_COUNT:
        return MN_TRACE_COUNTERS;
    case MN_TRACE_REFUSED:
    case MN_TRACE_ARRIVED:
        return 2;
    case MN_TRACE_POST:
        return MN_TRACE_COMMANDS;
    case MN_TRACE_ENDED: /* two fields: both below their ends */
        return (aux & 3) < MN_TRACE_COMMANDS ? 4 * MN_TRACE_ENDS : 0;
    default:
        *value = aux & (MN_TRACE_EARLY - 1);
        return aux_end_marked(kind, *value);
    }
}

static bool events_are_sound(const mni_trace_event *event, uint32_t count, uint64_t ns) {
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t kind = event[i].what & 0xff, aux = event[i].what >> 8 & 0xff;
        uint32_t value;
        const uint32_t end = aux_end(kind, aux, &value);
        if (value >= end || event[i].what >> 16 < ns)
            return false;
        ns = event[i].what >> 16;
    }
    return true;
}

/* The chunk at c->at, into the cursor, when it is that thread's; otherwise the cursor goes past it.
 * any: whosever it is. */
static mn_code read_chunk(const mn_trace_file *file, cursor *c, uint32_t thread, bool any,
                          mni_trace_chunk *chunk, mn_status *st) {
    mn_code code = read_at(file, c->at, chunk, sizeof *chunk, st);
    if (code != MN_OK)
        return code;
    const bool ends = chunk->thread == MNI_TRACE_END;
    if (chunk->magic != MNI_TRACE_CHUNK_MAGIC || chunk->zero != 0 ||
        (chunk->thread >= MN_TRACE_THREADS && !ends) || chunk->count > MNI_TRACE_CHUNK_EVENTS ||
        (ends && chunk->count != MN_TRACE_THREADS))
        return damaged(file, c->at, "no chunk of events begins here", st);
    const uint64_t bytes = chunk->count * sizeof(mni_trace_event);
    c->count = c->next = 0;
    if (any || chunk->thread == thread) {
        code = read_at(file, c->at + sizeof *chunk, c->event, bytes, st);
        if (code != MN_OK)
            return code;
        if (mni_trace_chunk_checksum(chunk, c->event) != chunk->checksum)
            return damaged(file, c->at, "a chunk of events is not what was written", st);
        c->count = chunk->count;
    }
    c->at += sizeof *chunk + bytes;
    return MN_OK;
}

/* ---- open ------------------------------------------------------------------------------------ */

static mn_code read_head(mn_trace_file *file, mn_status *st) {
    mni_trace_head h;
    if (mni_in_read(&file->in, 0, &h, sizeof h) != (int64_t)sizeof h ||
        memcmp(h.magic, MNI_TRACE_MAGIC, sizeof h.magic) != 0)
        return mn_fail(st, MN_BAD_INPUT, "%s: not a trace; metanode replay --trace makes one",
                       file->name);
    if (h.version != MNI_TRACE_VERSION)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: a trace of version %" PRIu32 ", and this program reads %d; record it "
                       "again",
                       file->name, h.version, MNI_TRACE_VERSION);
    if (h.checksum != XXH3_64bits(&h, offsetof(mni_trace_head, checksum)) ||
        h.header_bytes != sizeof h || h.event_bytes != sizeof(mni_trace_event) ||
        h.clock > MN_TRACE_VIRTUAL || h.model[sizeof h.model - 1] != 0)
        return damaged(file, 0, "the trace's header is damaged", st);
    file->info = (mn_trace_info){
        .clock = h.clock,
        .build_id = h.build_id,
        .model_bytes = h.model_bytes,
        .triangles = h.triangles,
        .leaves = h.leaves,
        .blocks = h.blocks,
        .block_bytes_max = h.block_bytes_max,
        .block_depth = h.block_depth,
        .l = h.l,
        .k = h.k,
        .k_min = h.k_min,
        .front_max = h.front_max,
        .store = h.store,
        .io = h.io,
        .prefetch = h.prefetch,
        .io_serial = (h.flags & 1) != 0,
        .barrier = (h.flags & 2) != 0,
        .degrade_off = (h.flags & 4) != 0,
        .seed = h.seed,
        .ram_cap_bytes = h.ram_cap_bytes,
        .nav_ops = h.nav_ops,
        .tolerance_px = h.tolerance_px,
        .fps = h.fps,
        .width_px = h.width_px,
        .height_px = h.height_px,
        .ring_events = {h.ring_events[0], h.ring_events[1]},
    };
    for (size_t i = 0; h.model[i] != 0; i++) /* it will be printed */
        file->info.model[i] =
            (unsigned char)h.model[i] < ' ' || h.model[i] == 127 ? '?' : h.model[i];
    return MN_OK;
}

/* What the last chunk says must be what has been seen. */
static mn_code check_end(mn_trace_file *file, const cursor *c, mn_status *st) {
    mni_trace_sum sum[MN_TRACE_THREADS];
    memcpy(sum, c->event, sizeof sum);
    if (memcmp(sum, file->sum, sizeof sum) != 0)
        return damaged(file, file->end, "chunks of events are missing before here", st);
    if (c->at != file->in.size_bytes)
        return damaged(file, c->at, "something stands behind the trace's end", st);
    return MN_OK;
}

/* Goes through all chunks. */
static mn_code check_all(mn_trace_file *file, bool cut, mn_status *st) {
    cursor *c = &file->cursor[0];
    uint64_t ns[MN_TRACE_THREADS] = {0};
    c->at = sizeof(mni_trace_head);
    for (;;) {
        mni_trace_chunk chunk;
        mn_status why = {0};
        file->end = c->at;
        mn_code code = read_chunk(file, c, 0, true, &chunk, &why);
        if (code != MN_OK && cut && code == MN_BAD_INPUT) {
            file->cut = true;
            return MN_OK;
        }
        if (code != MN_OK)
            return mn_fail(st, code, "%s", why.text);
        if (chunk.thread == MNI_TRACE_END)
            return check_end(file, c, st);
        mni_trace_sum *sum = &file->sum[chunk.thread];
        if (!events_are_sound(c->event, c->count, ns[chunk.thread]) || chunk.dropped < sum->dropped)
            return damaged(file, file->end, "events that nothing writes", st);
        if (c->count > 0)
            ns[chunk.thread] = c->event[c->count - 1].what >> 16;
        sum->events += c->count;
        sum->dropped = chunk.dropped;
    }
}

mn_code mn_trace_open(const char *path, bool cut, mn_trace_file **out, mn_status *st) {
    *out = NULL;
    mn_trace_file *file = calloc(1, sizeof *file);
    if (file == NULL)
        return mn_fail(st, MN_FAILED, "no memory for reading a trace");
    strncpy(file->name, path, sizeof file->name - 1);
    mn_code code = mni_in_open(&file->in, path, st);
    if (code != MN_OK) {
        free(file);
        return code;
    }
    code = read_head(file, st);
    if (code == MN_OK)
        code = check_all(file, cut, st);
    if (code != MN_OK) {
        mn_trace_close(file);
        return code;
    }
    mn_trace_rewind(file);
    *out = file;
    return MN_OK;
}

void mn_trace_close(mn_trace_file *file) {
    if (file == NULL)
        return;
    mni_in_close(&file->in);
    free(file);
}

const mn_trace_info *mn_trace_info_of(const mn_trace_file *file) {
    return &file->info;
}

uint64_t mn_trace_events(const mn_trace_file *file, mn_trace_thread thread) {
    return file->sum[thread].events;
}

uint64_t mn_trace_dropped(const mn_trace_file *file, mn_trace_thread thread) {
    return file->sum[thread].dropped;
}

bool mn_trace_is_cut(const mn_trace_file *file) {
    return file->cut;
}

/* ---- events ---------------------------------------------------------------------------------- */

void mn_trace_rewind(mn_trace_file *file) {
    for (int i = 0; i < MN_TRACE_THREADS; i++) {
        cursor *c = &file->cursor[i];
        c->at = sizeof(mni_trace_head);
        c->next = c->count = 0;
        c->ns = 0;
    }
}

/* The cursor's thread's next event is at hand, or there is none. */
static mn_code refill(const mn_trace_file *file, uint32_t thread, cursor *c, mn_status *st) {
    while (c->next == c->count && c->at < file->end) {
        mni_trace_chunk chunk;
        mn_code code = read_chunk(file, c, thread, false, &chunk, st);
        if (code != MN_OK)
            return code;
        if (!events_are_sound(c->event, c->count, c->ns))
            return damaged(file, c->at, "the trace is being written over", st);
    }
    return MN_OK;
}

bool mn_trace_next(mn_trace_file *file, mn_trace_event *out, mn_code *code, mn_status *st) {
    int first = -1;
    *code = MN_OK;
    for (int i = 0; i < MN_TRACE_THREADS; i++) {
        cursor *c = &file->cursor[i];
        *code = refill(file, (uint32_t)i, c, st);
        if (*code != MN_OK)
            return false;
        if (c->next < c->count &&
            (first < 0 || c->event[c->next].what >> 16 <
                              file->cursor[first].event[file->cursor[first].next].what >> 16))
            first = i;
    }
    if (first < 0)
        return false;
    cursor *c = &file->cursor[first];
    const mni_trace_event *e = &c->event[c->next++];
    c->ns = e->what >> 16;
    *out = (mn_trace_event){.ns = e->what >> 16,
                            .a = e->a,
                            .b = e->b,
                            .kind = (uint8_t)e->what,
                            .aux = (uint8_t)(e->what >> 8),
                            .thread = (uint8_t)first};
    return true;
}
