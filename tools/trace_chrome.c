/* A trace as JSON for Chrome's tracing and for Perfetto. See trace_chrome.h; what is drawn how:
 * docs/trace.md.
 *
 * Hides: which events become what. Two threads; a frame is a slice with its phases in it; a read is
 * an asynchronous slice from the place holder that is taken for it to what becomes of it; a flow
 * goes from the command that asks for a block over its read and its check to its first use, or to
 * the loss of it. Each point of a flow has a slice of its own to stand on, of a nanosecond, since
 * viewers join what lies inside a slice; and the unit is the nanosecond, or Chrome's viewer nests
 * slices that are less than a microsecond apart into each other, and loses the flows between them.
 *
 * Splits and collapses are told by the frame, as counters: one by one they would be most of the
 * file. Written as it is read, memory by block. */
#include "trace_chrome.h"

#include <inttypes.h>
#include <stdlib.h>

#include "trace_words.h"

typedef struct flow {
    uint32_t id; /* 0: none is open */
    bool read;   /* an asynchronous slice is open */
    bool loaded; /* its block has come */
    uint64_t arrived_ns;
} flow;

typedef struct chrome {
    FILE *out;
    uint32_t from, to;
    bool inside;   /* of the frames that are wanted */
    bool in_frame; /* slices of a frame and of a phase are open */
    bool in_phase;
    mn_trace_event frame, phase; /* that began them */
    bool first;
    bool failed;    /* no memory for another block */
    uint32_t flows; /* ids given out */
    uint64_t ns;    /* of the last event */
    uint64_t count[MN_TRACE_COUNTERS];
    trace_map blocks;
    flow *flow; /* by number of block */
    uint32_t flow_room;
} chrome;

enum { PROCESS = 1 };

/* ---- JSON ------------------------------------------------------------------------------------ */

/* An event up to its arguments; the caller writes the rest and the closing brace. */
static void begin(chrome *c, const char *phase, uint32_t thread, uint64_t ns) {
    fprintf(c->out, "%s\n{\"ph\":\"%s\",\"pid\":%d,\"tid\":%" PRIu32 ",\"ts\":%" PRIu64 ".%03u",
            c->first ? "" : ",", phase, PROCESS, thread + 1, ns / 1000, (unsigned)(ns % 1000));
    c->first = false;
}

static void slice(chrome *c, const mn_trace_event *e, const char *name) {
    begin(c, "X", e->thread, e->ns);
    fprintf(c->out, ",\"dur\":0.001,\"name\":\"%s\",\"args\":{\"block\":%" PRIu32 "}}", name, e->a);
}

static void instant(chrome *c, const mn_trace_event *e, const char *name) {
    begin(c, "i", e->thread, e->ns);
    fprintf(c->out, ",\"s\":\"t\",\"name\":\"%s\",\"args\":{\"block\":%" PRIu32 "}}", name, e->a);
}

/* s, t or f: a point of the block's flow. */
static void flow_point(chrome *c, const char *phase, const mn_trace_event *e, uint32_t id) {
    begin(c, phase, e->thread, e->ns);
    fprintf(c->out, ",\"cat\":\"block\",\"name\":\"block\",\"id\":%" PRIu32 "%s}", id,
            phase[0] != 's' ? ",\"bp\":\"e\"" : "");
}

static void counter(chrome *c, const char *name, uint64_t ns, int values,
                    const mn_trace_counter *which) {
    begin(c, "C", MN_TRACE_NAVIGATE, ns);
    fprintf(c->out, ",\"name\":\"%s\",\"args\":{", name);
    for (int i = 0; i < values; i++)
        fprintf(c->out, "%s\"%s\":%" PRIu64, i > 0 ? "," : "", trace_counter_names[which[i]],
                c->count[which[i]]);
    fputs("}}", c->out);
}

/* ---- frames ---------------------------------------------------------------------------------- */

/* B or E; some viewers join them by their names. */
static void frame_edge(chrome *c, const char *phase, uint64_t ns) {
    begin(c, phase, MN_TRACE_NAVIGATE, ns);
    fprintf(c->out, ",\"name\":\"%s %" PRIu32 "\"}", trace_round_names[c->frame.aux], c->frame.a);
    c->in_frame = phase[0] == 'B';
}

static void phase_edge(chrome *c, const char *phase, uint64_t ns) {
    begin(c, phase, MN_TRACE_NAVIGATE, ns);
    fprintf(c->out, ",\"name\":\"%s\"}", trace_phase_names[c->phase.aux]);
    c->in_phase = phase[0] == 'B';
}

/* Of both, as far as they are open. */
static void edges_end(chrome *c, uint64_t ns) {
    if (c->in_phase)
        phase_edge(c, "E", ns);
    if (c->in_frame)
        frame_edge(c, "E", ns);
}

static void frame_begin(chrome *c, const mn_trace_event *e) {
    edges_end(c, e->ns); /* what ended it did not fit */
    c->frame = *e;
    frame_edge(c, "B", e->ns);
}

static void phase_begin(chrome *c, const mn_trace_event *e) {
    if (!c->in_frame)
        return;
    if (c->in_phase)
        phase_edge(c, "E", e->ns);
    c->phase = *e;
    phase_edge(c, "B", e->ns);
}

static void frame_end(chrome *c, const mn_trace_event *e) {
    static const mn_trace_counter moves[] = {MN_TRACE_N_SPLITS, MN_TRACE_N_COLLAPSES},
                                  misses[] = {MN_TRACE_N_MISSES, MN_TRACE_N_REFUSED_POOL,
                                              MN_TRACE_N_REFUSED_FRONT, MN_TRACE_N_REFUSED_BUDGET},
                                  front[] = {MN_TRACE_N_TRIANGLES, MN_TRACE_N_NODES},
                                  places[] = {MN_TRACE_N_FREE, MN_TRACE_N_EMPTY, MN_TRACE_N_LOADING,
                                              MN_TRACE_N_LOADED},
                                  in_use[] = {MN_TRACE_N_IN_USE, MN_TRACE_N_ANCESTORS},
                                  commands[] = {MN_TRACE_N_COMMANDS},
                                  tolerance[] = {MN_TRACE_N_TOLERANCE};
    if (!c->in_frame)
        return;
    edges_end(c, e->ns);
    counter(c, "moves", e->ns, 2, moves);
    counter(c, "misses", e->ns, 4, misses);
    counter(c, "front", e->ns, 2, front);
    counter(c, "place holders", e->ns, 4, places);
    counter(c, "blocks in use", e->ns, 2, in_use);
    counter(c, "commands", e->ns, 1, commands);
    counter(c, "tolerance", e->ns, 1, tolerance);
}

/* ---- blocks ---------------------------------------------------------------------------------- */

/* The block's flow; NULL: no memory for one, so that all has failed. */
static flow *flow_of(chrome *c, uint32_t block_id) {
    const uint32_t number = trace_map_number(&c->blocks, block_id);
    c->failed |=
        number == MN_NONE || !trace_grow((void **)&c->flow, &c->flow_room, number, sizeof *c->flow);
    return c->failed ? NULL : &c->flow[number];
}

/* A point of the block's flow, which begins with it if none is open. */
static void flow_on(chrome *c, flow *f, const mn_trace_event *e, const char *name) {
    slice(c, e, name);
    const bool opens = f->id == 0;
    if (opens)
        f->id = ++c->flows;
    flow_point(c, opens ? "s" : "t", e, f->id);
}

static void flow_end(chrome *c, flow *f, const mn_trace_event *e, const char *name) {
    if (f->id == 0)
        return;
    slice(c, e, name);
    flow_point(c, "f", e, f->id);
    f->id = 0;
    f->loaded = false;
}

static void read_edge(chrome *c, flow *f, const mn_trace_event *e, bool begins) {
    if (f->read == begins)
        return;
    begin(c, begins ? "b" : "e", MN_TRACE_IO, e->ns);
    fprintf(c->out,
            ",\"cat\":\"read\",\"name\":\"read\",\"id\":%" PRIu32 ",\"args\":{\"block\":%" PRIu32
            ",\"place\":%" PRIu32 "}}",
            e->a, e->a, e->b);
    f->read = begins;
}

static void holder(chrome *c, flow *f, const mn_trace_event *e) {
    const mn_trace_place from = trace_place_from(e), to = trace_place_to(e);
    if (to == MN_TRACE_LOADING) {
        flow_on(c, f, e, "issue");
        read_edge(c, f, e, true);
    } else if (from == MN_TRACE_LOADING) {
        read_edge(c, f, e, false);
    } else if (from == MN_TRACE_FREED && to == MN_TRACE_LOADED) {
        instant(c, e, "second chance");
    }
}

static void command_ended(chrome *c, flow *f, const mn_trace_event *e) {
    const mn_trace_end end = (mn_trace_end)(e->aux >> 2 & 3);
    if (end != MN_TRACE_END_LOADED) {
        if (!f->loaded && !f->read) /* of what is being read another command tells */
            flow_end(c, f, e, end == MN_TRACE_END_FAILED ? "failed" : "no read");
        return;
    }
    if (f->arrived_ns > 0) {
        begin(c, "X", e->thread, f->arrived_ns);
        const uint64_t ns = e->ns + 2 - f->arrived_ns; /* the point "loaded" lies inside */
        fprintf(c->out,
                ",\"dur\":%" PRIu64 ".%03u,\"name\":\"check\",\"args\":{\"block\":%" PRIu32 "}}",
                ns / 1000, (unsigned)(ns % 1000), e->a);
    }
    f->arrived_ns = 0;
    flow_on(c, f, e, "loaded");
    f->loaded = true;
}

static void block_event(chrome *c, const mn_trace_event *e) {
    flow *f = flow_of(c, e->a);
    if (f == NULL)
        return;
    switch ((mn_trace_kind)e->kind) {
    case MN_TRACE_POST:
        if (f->id == 0)
            flow_on(c, f, e, trace_aux_name(e));
        break;
    case MN_TRACE_HOLDER:
        holder(c, f, e);
        break;
    case MN_TRACE_ARRIVED:
        f->arrived_ns = e->ns;
        break;
    case MN_TRACE_ENDED:
        command_ended(c, f, e);
        break;
    case MN_TRACE_USE:
        if (f->loaded)
            flow_end(c, f, e, "use");
        break;
    case MN_TRACE_LOST:
        flow_end(c, f, e, "lost unused");
        if (trace_place_from(e) == MN_TRACE_LOADED)
            instant(c, e, "eviction");
        break;
    case MN_TRACE_MISS:
        instant(c, e, "miss");
        break;
    case MN_TRACE_REFUSED:
        instant(c, e, "refused");
        break;
    case MN_TRACE_GRANT:
        instant(c, e, "grant");
        break;
    case MN_TRACE_GRANT_OVER:
        instant(c, e, "grant over");
        break;
    default:
        break;
    }
}

static void lock_wait(chrome *c, const mn_trace_event *e) {
    const uint64_t waited_ns = trace_value(e);
    const uint64_t from_ns = e->ns > waited_ns ? e->ns - waited_ns : 0;
    begin(c, "X", e->thread, from_ns);
    fprintf(c->out, ",\"dur\":%" PRIu64 ".%03u,\"name\":\"waits for %s.lock\"}",
            (e->ns - from_ns) / 1000, (unsigned)((e->ns - from_ns) % 1000), trace_aux_name(e));
}

/* ---- all of it ------------------------------------------------------------------------------- */

static void event(chrome *c, const mn_trace_event *e) {
    switch ((mn_trace_kind)e->kind) {
    case MN_TRACE_FRAME_BEGIN:
        frame_begin(c, e);
        break;
    case MN_TRACE_FRAME_END:
        frame_end(c, e);
        break;
    case MN_TRACE_PHASE:
        phase_begin(c, e);
        break;
    case MN_TRACE_COUNT:
        c->count[e->aux & (MN_TRACE_EARLY - 1)] = trace_value(e);
        break;
    case MN_TRACE_LOCK_WAIT:
        lock_wait(c, e);
        break;
    default:
        block_event(c, e);
        break;
    }
}

/* What is still open ends with the last event. */
static void close_open(chrome *c) {
    mn_trace_event e = {.ns = c->ns, .thread = MN_TRACE_IO};
    edges_end(c, c->ns);
    for (uint32_t i = 0; i < c->blocks.count && i < c->flow_room; i++) {
        e.a = c->blocks.id[i];
        read_edge(c, &c->flow[i], &e, false);
        flow_end(c, &c->flow[i], &e, "not used yet");
        e.ns += 2; /* one after the other, or viewers pile them up */
    }
}

static void head(chrome *c, const mn_trace_file *file) {
    const mn_trace_info *info = mn_trace_info_of(file);
    fprintf(c->out,
            "{\"displayTimeUnit\":\"ns\",\n\"otherData\":{\"build_id\":\"%016" PRIx64
            "\",\"k\":%" PRIu32 ",\"blocks\":%" PRIu32 ",\"seed\":%" PRIu64
            ",\"clock\":\"%s\",\"dropped\":%" PRIu64 "},\n\"traceEvents\":[",
            info->build_id, info->k, info->blocks, info->seed,
            info->clock == MN_TRACE_VIRTUAL ? "virtual" : "monotonic",
            mn_trace_dropped(file, MN_TRACE_NAVIGATE) + mn_trace_dropped(file, MN_TRACE_IO));
    c->first = true;
    for (uint32_t thread = 0; thread < MN_TRACE_THREADS; thread++) {
        begin(c, "M", thread, 0);
        fprintf(c->out, ",\"name\":\"thread_name\",\"args\":{\"name\":\"%s\"}}",
                trace_thread_names[thread]);
    }
    begin(c, "M", 0, 0);
    fputs(",\"name\":\"process_name\",\"args\":{\"name\":\"metanode\"}}", c->out);
}

mn_code trace_chrome(mn_trace_file *file, uint32_t from, uint32_t to, FILE *out, mn_status *st) {
    chrome c = {.out = out, .inside = from == 0};
    mn_trace_event e;
    mn_code code;
    head(&c, file);
    mn_trace_rewind(file);
    while (!c.failed && mn_trace_next(file, &e, &code, st) && !ferror(out)) {
        if (e.kind == MN_TRACE_FRAME_BEGIN && e.a >= from)
            c.inside = true;
        if (e.kind == MN_TRACE_FRAME_BEGIN && e.a > to)
            break;
        if (c.inside)
            event(&c, &e);
        c.ns = e.ns;
    }
    close_open(&c);
    fputs("\n]}\n", out);
    free(c.flow);
    trace_map_free(&c.blocks);
    return c.failed ? mn_fail(st, MN_FAILED, "no memory for so many blocks") : code;
}
