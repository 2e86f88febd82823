/* I/O's loop. See ioloop.h.
 *
 * Secret: what becomes of a read that was short, interrupted or refused. Completions are collected
 * first and acted on after. No function here takes two locks at once. */
#define _GNU_SOURCE
#include "ioloop.h"

#include <errno.h>
#include <string.h>

#include "mn_assert.h"
#include "clock.h"
#include "frame.h"
#include "trace.h"

enum {
    SEEN_TIMES = 8,
    SCOUTS_LEAVE = 4,       /* one read in so many, for what Navigate posts meanwhile */
    AHEAD = 4,              /* reads that go ahead of the others when the disk has none */
    ACTS = 8,               /* blocks looked at before the disk is given more to read */
    FRUITLESS_MAX = 32,     /* EAGAIN and the like in a row, before a read has failed */
    PAUSE_NS = 1000 * 1000, /* when the kernel has no room for any read */
    FIRST_READS_MAX = 512,  /* while the session is opened, of the top of the tree, or of what may
                               soon be wanted besides what is: 4 MB of 8 KiB blocks */
    THREAD_STACK_BYTES = 256 * 1024, /* checking a block's contents needs little */
};
static const char NOT_UNPACKED[] = "its extent is not that of a compressed block";
#define SCOUT_URGENCY 0.25f /* of a block that is read while there are empty places */

/* So many blocks for each place holder, or all there are: 64 bytes for 8 KiB. */
static uint32_t seen_max(const mn_header *header, uint32_t k) {
    return header->blocks / SEEN_TIMES < k ? header->blocks : SEEN_TIMES * k;
}

size_t mni_ioloop_need(const mn_header *header, uint32_t k, uint32_t look_bytes) {
    uint32_t refs_max = mni_frame_refs_max(header->block_bytes_max);
    return mni_scouts_need(k) + mni_arena_need(look_bytes, 1, 64) +
           mni_seen_need(seen_max(header, k)) +
           mni_arena_need(refs_max, sizeof(float), _Alignof(float)) +
           mni_arena_need(refs_max, sizeof(mni_notes), _Alignof(mni_notes));
}

void mni_ioloop_open(mni_ioloop *loop, uint32_t look_bytes, mni_arena *arena) {
    uint32_t k = loop->pool->holders.k;
    loop->first_reads = k / 2 < FIRST_READS_MAX ? k / 2 : FIRST_READS_MAX;
    loop->cpu_ns = UINT64_MAX;
    mni_scouts_open(&loop->scouts, k, arena);
    mni_seen_open(&loop->seen, seen_max(loop->header, k), arena);
    loop->look = mni_arena_take(arena, look_bytes, 1, 64);
    uint32_t refs_max = mni_frame_refs_max(loop->header->block_bytes_max);
    loop->urgency = mni_arena_take(arena, refs_max, sizeof(float), _Alignof(float));
    loop->below = mni_arena_take(arena, refs_max, sizeof(mni_notes), _Alignof(mni_notes));
}

/* ---- completing ------------------------------------------------------------------------------ */

static uint64_t now_ns(void) {
    return mni_clock_ns(CLOCK_MONOTONIC);
}

/* What has been under way until now. */
static void busy_count(mni_ioloop *loop) {
    const uint64_t at_ns = now_ns(), since_ns = at_ns - loop->busy_since_ns;
    if (loop->busy > 0) {
        loop->news.busy_ns += since_ns;
        loop->news.depth_ns += since_ns * loop->reading;
    }
    loop->busy_since_ns = at_ns;
}

static void request_free(mni_ioloop *loop, mni_request *request) {
    MN_ASSERT(request->state == MNI_REQUEST_COME || request->state == MNI_REQUEST_AGAIN);
    busy_count(loop);
    loop->reading -= request->state == MNI_REQUEST_AGAIN;
    request->state = MNI_REQUEST_FREE;
    loop->busy--;
    MN_ASSERT(loop->busy >= loop->reading);
}

static void request_again(mni_ioloop *loop, mni_request *request) {
    MN_ASSERT(request->state == MNI_REQUEST_COME && loop->busy > loop->reading);
    busy_count(loop);
    request->state = MNI_REQUEST_AGAIN;
    loop->reading++;
}

static void fail(mni_ioloop *loop, mni_request *request, bool io, const char *why) {
    mni_pool_failed(loop->pool, &request->command, &request->load, io, why);
    loop->news.ended[request->command.kind][MNI_END_FAILED]++;
    mni_command_trace_end(&request->command, MNI_END_FAILED);
    request_free(loop, request);
}

/* What is wrong with a block that has come, or NULL. The bytes are ours alone. What has been found
 * sound is so whenever it comes again, whoever asks for it: but for whose child it should be. */
static const char *fault_of(mni_ioloop *loop, const mni_load *load) {
    const uint64_t digest = mni_seen_digest(&loop->seen, load->ref, load->bytes);
    const bool seen = mni_seen_has(&loop->seen, load->ref, digest);
    mni_frame_fault fault = MNI_FRAME_OK;
    if (!seen)
        fault = mni_frame_check(load->bytes, load->ref, loop->header->build_id,
                                loop->header->file_bytes);
    if (fault != MNI_FRAME_OK)
        return mni_frame_fault_text(fault);
    mni_frame frame;
    mni_frame_get(load->bytes, &frame);
    if (frame.kind != MNI_FRAME_OVERFLOW && load->parent_id != frame.parent_id)
        return "it is not what its parent says it is";
    if (seen)
        return NULL;
    loop->news.checked++;
    if (loop->check != NULL &&
        !loop->check(loop->check_context, load->bytes, load->ref.pages * MN_PAGE_BYTES))
        return "its contents contradict themselves";
    mni_seen_add(&loop->seen, load->ref, digest);
    return NULL;
}

/* Where the block is read from, and to. length_bytes 0: it is nowhere. */
static mni_read place_of(const mni_ioloop *loop, const mni_load *load, uint32_t tag) {
    if (loop->extents == NULL)
        return (mni_read){.offset = (uint64_t)load->ref.id * MN_PAGE_BYTES,
                          .bytes = load->bytes,
                          .length_bytes = load->ref.pages * MN_PAGE_BYTES,
                          .chunk = load->chunk,
                          .tag = tag};
    const mni_extent extent = mni_extents_find(loop->extents, load->ref);
    const uint64_t align = loop->extents->align_bytes, first = extent.offset / align * align,
                   end = (extent.offset + extent.length_bytes + align - 1) / align * align;
    return (mni_read){.offset = first,
                      .bytes = loop->extents->slots + (size_t)tag * loop->extents->slot_bytes,
                      .length_bytes = extent.length_bytes > 0 ? (uint32_t)(end - first) : 0,
                      .tag = tag};
}

/* false: what has come is no extent of the block. */
static bool unpack(mni_ioloop *loop, const mni_request *request) {
    const mni_load *load = &request->load;
    if (loop->extents == NULL)
        return true;
    const mni_extent extent = mni_extents_find(loop->extents, load->ref);
    return mni_extents_unpack(loop->extents,
                              (const unsigned char *)request->read.bytes +
                                  (extent.offset - request->read.offset),
                              extent.length_bytes, load->bytes, load->ref.pages * MN_PAGE_BYTES);
}

/* Sends a scout to reference i of a block that has come. */
static void scout_send(mni_ioloop *loop, const mni_load *load, uint32_t i, mni_command command,
                       float urgency) {
    command.kind = MNI_COMMAND_PREFETCH;
    command.ref = mni_frame_ref(load->bytes, i);
    command.parent_id = load->ref.id;
    command.sponsor = MN_NONE;
    if ((uint64_t)command.ref.pages * MN_PAGE_BYTES > loop->header->block_bytes_max)
        return; /* a lying file */
    loop->news.own++;
    MNI_TRACE(MN_TRACE_POST, MN_TRACE_PREFETCH, command.ref.id, 0);
    if (!mni_scouts_push(&loop->scouts, &command, urgency))
        loop->news.ended[MNI_COMMAND_PREFETCH][MNI_END_GIVEN_UP]++;
}

/* To what the camera wants, and while there are empty places to what it may soon want, below a
 * block that has come and is still ours, or that is there and looked into. Before the first frame
 * in the end to all that is below it, level by level. */
static void scout_from(mni_ioloop *loop, const mni_load *load, const mni_command *from) {
    if (loop->rate == NULL)
        return;
    (void)mni_board_look_get(loop->board, loop->look, &loop->looks);
    const bool starts = loop->looks == 0;
    mni_frame frame;
    mni_frame_get(load->bytes, &frame);
    const float least = load->last_empty ? 1 : SCOUT_URGENCY;
    if (!starts)
        loop->rate(loop->rate_context, loop->look, load->bytes, &from->notes, least, loop->urgency,
                   loop->below);
    for (uint32_t i = 0; i < frame.refs; i++) {
        if (!starts && loop->urgency[i] >= least) {
            if (from->kind == MNI_COMMAND_LOOK &&
                mni_pool_foresees(loop->pool, mni_frame_ref(load->bytes, i).id))
                continue;
            mni_places places = loop->urgency[i] < 1 ? MNI_PLACES_EMPTY : MNI_PLACES_SPARE;
            scout_send(loop, load, i, (mni_command){.places = places, .notes = loop->below[i]},
                       loop->urgency[i]);
        } else if (loop->looks <= loop->first_looks) {
            scout_send(loop, load, i,
                       (mni_command){.places = MNI_PLACES_EMPTY, .due = from->due + 1},
                       SCOUT_URGENCY / (2.0f + (float)from->due));
        }
    }
}

static void complete(mni_ioloop *loop, mni_request *request) {
    const char *why = unpack(loop, request) ? fault_of(loop, &request->load) : NOT_UNPACKED;
    if (why != NULL) {
        fail(loop, request, false, why);
        return;
    }
    scout_from(loop, &request->load, &request->command);
    mni_pool_loaded(loop->pool, &request->command, &request->load);
    loop->news.ended[request->command.kind][MNI_END_LOADED]++;
    mni_command_trace_end(&request->command, MNI_END_LOADED);
    request_free(loop, request);
}

/* One completion of a read: done, more to come, once more, or failed. */
static void act(mni_ioloop *loop, const mni_done *done) {
    mni_request *request = &loop->request[done->tag];
    MN_ASSERT(request->state == MNI_REQUEST_COME);
    const uint32_t length_bytes = request->read.length_bytes;
    MNI_TRACE(MN_TRACE_ARRIVED, done->result < 0, request->load.ref.id,
              (uint32_t)(done->result < 0 ? -done->result : done->result));
    if (done->result < 0) {
        int error = -done->result;
        bool passing = error == EAGAIN || error == EINTR || error == EBUSY || error == ENOMEM;
        if (!passing || ++request->fruitless == FRUITLESS_MAX)
            fail(loop, request, true, "it cannot be read");
        else
            request_again(loop, request);
        return;
    }
    MN_ASSERT((uint32_t)done->result <= length_bytes - request->done_bytes);
    request->load.read_bytes += (uint32_t)done->result;
    if (done->result == 0) {
        fail(loop, request, true, "the file ends before it");
        return;
    }
    /* O_DIRECT goes on at whole pages only, or sectors. */
    uint32_t fresh_bytes = (uint32_t)done->result;
    if (request->done_bytes + fresh_bytes < length_bytes)
        fresh_bytes -=
            fresh_bytes % (loop->extents != NULL ? loop->extents->align_bytes : MN_PAGE_BYTES);
    request->done_bytes += fresh_bytes;
    request->fruitless = fresh_bytes > 0 ? 0 : request->fruitless + 1;
    if (request->done_bytes == length_bytes)
        complete(loop, request);
    else if (request->fruitless == FRUITLESS_MAX)
        fail(loop, request, true, "it comes in pieces too small to read");
    else
        request_again(loop, request);
}

/* ---- starting -------------------------------------------------------------------------------- */

static bool submit(mni_ioloop *loop, uint32_t tag) {
    mni_request *request = &loop->request[tag];
    MN_ASSERT(request->state == MNI_REQUEST_AGAIN);
    mni_read read = request->read;
    read.offset += request->done_bytes;
    read.bytes = (unsigned char *)read.bytes + request->done_bytes;
    read.length_bytes -= request->done_bytes;
    if (!loop->disk->method->submit(loop->disk->self, &read))
        return false;
    MNI_TRACE(MN_TRACE_SUBMIT, 0, request->load.ref.id, read.length_bytes);
    request->state = MNI_REQUEST_IN_FLIGHT;
    return true;
}

/* All that wait to be submitted, in the order of their places in the file: siblings stand side by
 * side there, and the kernel makes one request of neighbours that come one after the other. Returns
 * how many are in flight. */
static uint32_t submit_all(mni_ioloop *loop) {
    uint32_t in_flight = 0, count = 0, waiting[MNI_DISK_TAGS];
    for (uint32_t tag = 0; tag < MNI_DISK_TAGS && loop->reading > 0; tag++) {
        in_flight += loop->request[tag].state == MNI_REQUEST_IN_FLIGHT;
        if (loop->request[tag].state != MNI_REQUEST_AGAIN)
            continue;
        uint32_t at = count++;
        for (;
             at > 0 && loop->request[waiting[at - 1]].load.ref.id > loop->request[tag].load.ref.id;
             at--)
            waiting[at] = waiting[at - 1];
        waiting[at] = tag;
    }
    for (uint32_t i = 0; i < count; i++)
        in_flight += submit(loop, waiting[i]);
    return in_flight;
}

/* The most urgent scout. While the session is opened, what is not known to be wanted stops at
 * first_reads. */
static bool next_scout(mni_ioloop *loop, mni_command *out) {
    while (mni_scouts_pop(&loop->scouts, out)) {
        if (loop->looks > loop->first_looks || out->places != MNI_PLACES_EMPTY)
            return true;
        if (loop->first_reads > 0) {
            loop->first_reads--;
            return true;
        }
        loop->news.ended[out->kind][MNI_END_GIVEN_UP]++;
        mni_command_trace_end(out, MNI_END_GIVEN_UP);
    }
    return false;
}

/* What Navigate has posted, then what the scouts have found; these leave some of the room. */
static bool next_command(mni_ioloop *loop, uint32_t room, uint32_t leave, mni_command *out) {
    if (loop->next == loop->fetched_count) {
        loop->next = 0;
        loop->fetched_count = mni_board_fetch(loop->board, loop->fetched,
                                              room < MNI_DISK_DEPTH ? room : MNI_DISK_DEPTH);
    }
    if (loop->next < loop->fetched_count) {
        *out = loop->fetched[loop->next++];
        return true;
    }
    return room > leave && next_scout(loop, out);
}

/* Takes a command as far as a read, or ends it. false: it waits for a place. */
static bool begin(mni_ioloop *loop, const mni_command *command) {
    mni_load load = {0};
    switch (mni_pool_begin(loop->pool, command, loop->busy > 0, &load)) {
    case MNI_BEGIN_READ: {
        uint32_t tag = 0;
        while (loop->request[tag].state != MNI_REQUEST_FREE)
            tag++;
        MN_ASSERT(tag < MNI_DISK_TAGS);
        busy_count(loop);
        loop->request[tag] = (mni_request){.state = MNI_REQUEST_AGAIN,
                                           .command = *command,
                                           .load = load,
                                           .read = place_of(loop, &load, tag)};
        loop->busy++;
        loop->reading++;
        if (loop->request[tag].read.length_bytes == 0)
            fail(loop, &loop->request[tag], false, "no block begins there");
        return true;
    }
    case MNI_BEGIN_RESIDENT:
        if (load.bytes != NULL) {
            scout_from(loop, &load, command);
            mni_pool_looked(loop->pool);
        }
        loop->news.ended[command->kind][MNI_END_RESIDENT]++;
        mni_command_trace_end(command, MNI_END_RESIDENT);
        return true;
    case MNI_BEGIN_GIVE_UP:
        loop->news.ended[command->kind][MNI_END_GIVEN_UP]++;
        mni_command_trace_end(command, MNI_END_GIVEN_UP);
        return true;
    case MNI_BEGIN_WAIT:
        break;
    }
    MN_ASSERT(mni_command_is_urgent(command->kind) && loop->next > 0);
    loop->next--;
    return false;
}

/* As many as the disk has room for, and the extents. */
static uint32_t most_of(const mni_ioloop *loop, uint32_t of_method) {
    if (loop->serial)
        return 1;
    return loop->extents == NULL || of_method < loop->extents->slot_count
               ? of_method
               : loop->extents->slot_count;
}

/* How many more reads may begin: in flight, and with those that are to be looked at. */
static uint32_t room_of(const mni_ioloop *loop, uint32_t depth) {
    const uint32_t tags = most_of(loop, loop->disk->method->tags);
    const uint32_t flights = loop->reading < depth ? depth - loop->reading : 0;
    const uint32_t looks = loop->busy < tags ? tags - loop->busy : 0;
    return flights < looks ? flights : looks;
}

/* As many commands as the disk takes, and no more than `most`. */
static void begin_some(mni_ioloop *loop, uint32_t most) {
    const uint32_t depth = most_of(loop, loop->disk->method->depth), leave = depth / SCOUTS_LEAVE;
    mni_command command;
    for (uint32_t room; most-- > 0 && (room = room_of(loop, depth)) > 0;)
        if (!next_command(loop, room, leave, &command) || !begin(loop, &command))
            break;
}

static void fetch(const mni_ioloop *loop, const mni_done *done) {
    const mni_read *read = &loop->request[done->tag].read;
    for (uint32_t at = 0; at < read->length_bytes; at += 64)
        __builtin_prefetch((const unsigned char *)read->bytes + at);
}

/* So many at most are begun, submitted and started. */
static void start_some(mni_ioloop *loop, uint32_t most) {
    begin_some(loop, most);
    if (submit_all(loop) > 0)
        (void)loop->disk->method->collect(loop->disk->self, NULL, 0, false);
}

/* A disk that has nothing to do is given a few reads ahead of the others: it takes as long to
 * prepare 32 as to read five or six. */
static void hasten(mni_ioloop *loop) {
    if (loop->reading == 0 && loop->disk->method->tags > loop->disk->method->depth)
        start_some(loop, AHEAD);
}

/* What has come since the last, if the disk has had as much to read as it takes from then on; but
 * for as many as were under way before it had. */
static void full_count(mni_ioloop *loop, const mni_done *done, uint32_t count) {
    if (loop->full_since_ns == 0)
        return;
    loop->news.full_ns += loop->busy_since_ns - loop->full_since_ns;
    for (uint32_t i = 0; i < count; i++)
        if (loop->full_old > 0)
            loop->full_old--;
        else
            loop->news.full_bytes += done[i].result > 0 ? (uint32_t)done[i].result : 0;
}

/* The disk must not stand idle while blocks are looked at: so it is given as many more to read
 * before, and again and again, since what has come may have scouts, or places for those that wait.
 * What a disk has written is in no cache: while one block is looked at, the next one is fetched. */
static void act_all(mni_ioloop *loop, const mni_done *done, uint32_t count) {
    if (count == 0)
        return;
    busy_count(loop);
    full_count(loop, done, count);
    const uint64_t came_ns = loop->busy_since_ns;
    for (uint32_t i = 0; i < count; i++) {
        MN_ASSERT(loop->request[done[i].tag].state == MNI_REQUEST_IN_FLIGHT);
        loop->request[done[i].tag].state = MNI_REQUEST_COME;
    }
    MN_ASSERT(loop->reading >= count);
    loop->reading -= count;
    loop->full_old = loop->full_since_ns == 0 ? loop->reading : loop->full_old;
    hasten(loop);
    if (loop->disk->method->tags > loop->disk->method->depth)
        start_some(loop, UINT32_MAX);
    loop->full_since_ns = loop->reading == most_of(loop, loop->disk->method->depth) ? came_ns : 0;
    for (uint32_t i = 0; i < count; i++) {
        if (i + 1 < count)
            fetch(loop, &done[i + 1]);
        act(loop, &done[i]);
        if ((i + 1) % ACTS == 0 || i + 1 == count)
            start_some(loop, UINT32_MAX);
    }
}

static bool step(mni_ioloop *loop, bool wait) {
    hasten(loop);
    begin_some(loop, UINT32_MAX);
    uint32_t in_flight = submit_all(loop);
    if (wait && loop->busy > 0 && in_flight == 0) {
        struct timespec pause = {.tv_nsec = PAUSE_NS};
        (void)nanosleep(&pause, NULL);
    }
    mni_done done[MNI_DISK_DEPTH];
    uint32_t count =
        loop->disk->method->collect(loop->disk->self, done, MNI_DISK_DEPTH, wait && in_flight > 0);
    act_all(loop, done, count);
    if (loop->cpu_ns != UINT64_MAX) {
        uint64_t cpu_ns = mni_clock_ns(CLOCK_THREAD_CPUTIME_ID);
        loop->news.cpu_ns = cpu_ns - loop->cpu_ns;
        loop->cpu_ns = cpu_ns;
    }
    mni_board_tell(loop->board, &loop->news);
    return loop->busy > 0 || loop->next < loop->fetched_count || loop->scouts.count > 0;
}

bool mni_ioloop_step(mni_ioloop *loop, bool wait) {
    mni_trace_ring *before = mni_trace_swap(loop->trace);
    const bool goes_on = step(loop, wait);
    (void)mni_trace_swap(before);
    return goes_on;
}

/* ---- the thread ------------------------------------------------------------------------------ */

static void *run(void *context) {
    mni_ioloop *loop = context;
    (void)pthread_setname_np(pthread_self(), "metanode-io");
    mni_lock_time_holds();
    loop->cpu_ns = 0;
    do {
        while (mni_ioloop_step(loop, true)) {
        }
    } while (mni_board_wait_work(loop->board));
    loop->cpu_ns = UINT64_MAX; /* further steps are of the thread that ends the loop */
    return NULL;
}

mn_code mni_ioloop_start(mni_ioloop *loop, mn_status *st) {
    pthread_attr_t attributes;
    int error = pthread_attr_init(&attributes);
    if (error == 0) {
        (void)pthread_attr_setstacksize(&attributes, THREAD_STACK_BYTES);
        error = pthread_create(&loop->thread, &attributes, run, loop);
        pthread_attr_destroy(&attributes);
    }
    if (error != 0)
        return mn_fail(st, MN_FAILED, "cannot start the I/O thread: %s", strerror(error));
    loop->has_thread = true;
    return MN_OK;
}

void mni_ioloop_stop(mni_ioloop *loop) {
    mni_command command;
    mni_board_stop(loop->board);
    if (loop->has_thread)
        pthread_join(loop->thread, NULL);
    loop->has_thread = false;
    /* What nobody has begun is given up; a simulated disk still has reads in flight. */
    loop->rate = NULL;
    mni_trace_ring *before = mni_trace_swap(loop->trace);
    while (next_command(loop, UINT32_MAX, 0, &command)) {
        loop->news.ended[command.kind][MNI_END_GIVEN_UP]++;
        mni_command_trace_end(&command, MNI_END_GIVEN_UP);
    }
    (void)mni_trace_swap(before);
    mni_board_tell(loop->board, &loop->news);
    while (mni_ioloop_step(loop, false))
        if (loop->disk->method->own_time)
            (void)loop->disk->method->advance(loop->disk->self, UINT64_MAX);
}
