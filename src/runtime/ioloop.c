/* I/O's loop. See ioloop.h.
 *
 * Secret: what becomes of a read that was short, interrupted or refused. Completions are collected
 * first and acted on after. No function here takes two locks at once. */
#define _GNU_SOURCE
#include "ioloop.h"

#include <errno.h>
#include <string.h>
#include <time.h>

#include "assert.h"
#include "frame.h"

enum {
    FRUITLESS_MAX = 32,              /* EAGAIN and the like in a row, before a read has failed */
    PAUSE_NS = 1000 * 1000,          /* when the kernel has no room for any read */
    THREAD_STACK_BYTES = 256 * 1024, /* checking a block's contents needs little */
};

/* ---- completing ------------------------------------------------------------------------------ */

static void request_free(mni_ioloop *loop, mni_request *request) {
    MN_ASSERT(request->state != MNI_REQUEST_FREE && loop->busy > 0);
    request->state = MNI_REQUEST_FREE;
    loop->busy--;
}

static void fail(mni_ioloop *loop, mni_request *request, bool io, const char *why) {
    mni_pool_failed(loop->pool, &request->command, &request->load, io, why);
    mni_board_end(loop->board, request->command.kind, MNI_END_FAILED);
    request_free(loop, request);
}

/* What is wrong with a block that has come, or NULL. The bytes are ours alone. */
static const char *fault_of(const mni_ioloop *loop, const mni_load *load) {
    mni_frame_fault fault =
        mni_frame_check(load->bytes, load->ref, loop->header->build_id, loop->header->file_bytes);
    if (fault != MNI_FRAME_OK)
        return mni_frame_fault_text(fault);
    mni_frame frame;
    mni_frame_get(load->bytes, &frame);
    if (frame.kind != MNI_FRAME_OVERFLOW && load->parent_id != frame.parent_id)
        return "it is not what its parent says it is";
    if (loop->check != NULL &&
        !loop->check(loop->check_context, load->bytes, load->ref.pages * MN_PAGE_BYTES))
        return "its contents contradict themselves";
    return NULL;
}

static void complete(mni_ioloop *loop, mni_request *request) {
    const char *why = fault_of(loop, &request->load);
    if (why != NULL) {
        fail(loop, request, false, why);
        return;
    }
    mni_pool_loaded(loop->pool, &request->command, &request->load);
    mni_board_end(loop->board, request->command.kind, MNI_END_LOADED);
    request_free(loop, request);
}

/* One completion of a read: done, more to come, once more, or failed. */
static void act(mni_ioloop *loop, const mni_done *done) {
    MN_ASSERT(done->tag < MNI_DISK_DEPTH);
    mni_request *request = &loop->request[done->tag];
    MN_ASSERT(request->state == MNI_REQUEST_IN_FLIGHT);
    uint32_t length_bytes = request->load.ref.pages * MN_PAGE_BYTES;
    request->state = MNI_REQUEST_AGAIN;
    if (done->result < 0) {
        int error = -done->result;
        bool passing = error == EAGAIN || error == EINTR || error == EBUSY || error == ENOMEM;
        if (!passing || ++request->fruitless == FRUITLESS_MAX)
            fail(loop, request, true, "it cannot be read");
        return;
    }
    MN_ASSERT((uint32_t)done->result <= length_bytes - request->done_bytes);
    mni_pool_count_read(loop->pool, (uint64_t)done->result);
    if (done->result == 0) {
        fail(loop, request, true, "the file ends before it");
        return;
    }
    /* O_DIRECT goes on at whole pages only. */
    uint32_t fresh_bytes = (uint32_t)done->result;
    if (request->done_bytes + fresh_bytes < length_bytes)
        fresh_bytes -= fresh_bytes % MN_PAGE_BYTES;
    request->done_bytes += fresh_bytes;
    request->fruitless = fresh_bytes > 0 ? 0 : request->fruitless + 1;
    if (request->done_bytes == length_bytes)
        complete(loop, request);
    else if (request->fruitless == FRUITLESS_MAX)
        fail(loop, request, true, "it comes in pieces too small to read");
}

/* ---- starting -------------------------------------------------------------------------------- */

static bool submit(mni_ioloop *loop, uint32_t tag) {
    mni_request *request = &loop->request[tag];
    MN_ASSERT(request->state == MNI_REQUEST_AGAIN);
    mni_read read = {.offset = (uint64_t)request->load.ref.id * MN_PAGE_BYTES + request->done_bytes,
                     .bytes = request->load.bytes + request->done_bytes,
                     .length_bytes = request->load.ref.pages * MN_PAGE_BYTES - request->done_bytes,
                     .chunk = request->load.chunk,
                     .tag = tag};
    if (!loop->disk->method->submit(loop->disk->self, &read))
        return false;
    request->state = MNI_REQUEST_IN_FLIGHT;
    return true;
}

static uint32_t submit_again(mni_ioloop *loop) {
    uint32_t in_flight = 0;
    for (uint32_t tag = 0; tag < MNI_DISK_DEPTH; tag++) {
        if (loop->request[tag].state == MNI_REQUEST_AGAIN)
            (void)submit(loop, tag);
        in_flight += loop->request[tag].state == MNI_REQUEST_IN_FLIGHT;
    }
    return in_flight;
}

static bool next_command(mni_ioloop *loop, mni_command *out) {
    if (!loop->stalled)
        return mni_board_fetch(loop->board, out);
    loop->stalled = false;
    *out = loop->stalled_command;
    return true;
}

/* Takes a command as far as a read, or ends it. false: it waits for a place. */
static bool begin(mni_ioloop *loop, const mni_command *command) {
    mni_load load;
    switch (mni_pool_begin(loop->pool, command, loop->busy > 0, &load)) {
    case MNI_BEGIN_READ: {
        uint32_t tag = 0;
        while (loop->request[tag].state != MNI_REQUEST_FREE)
            tag++;
        MN_ASSERT(tag < MNI_DISK_DEPTH);
        loop->request[tag] =
            (mni_request){.state = MNI_REQUEST_AGAIN, .command = *command, .load = load};
        loop->busy++;
        (void)submit(loop, tag); /* no room: with the next step */
        return true;
    }
    case MNI_BEGIN_RESIDENT:
        mni_board_end(loop->board, command->kind, MNI_END_RESIDENT);
        return true;
    case MNI_BEGIN_GIVE_UP:
        mni_board_end(loop->board, command->kind, MNI_END_GIVEN_UP);
        return true;
    case MNI_BEGIN_WAIT:
        break;
    }
    loop->stalled = true;
    loop->stalled_command = *command;
    return false;
}

bool mni_ioloop_step(mni_ioloop *loop, bool wait) {
    uint32_t depth = loop->serial ? 1 : loop->disk->method->depth;
    mni_command command;
    uint32_t in_flight = submit_again(loop);
    while (loop->busy < depth && next_command(loop, &command))
        if (!begin(loop, &command))
            break;
    in_flight = loop->busy > 0 ? submit_again(loop) : in_flight;
    if (wait && loop->busy > 0 && in_flight == 0) {
        struct timespec pause = {.tv_nsec = PAUSE_NS};
        (void)nanosleep(&pause, NULL);
    }
    mni_done done[MNI_DISK_DEPTH];
    uint32_t count =
        loop->disk->method->collect(loop->disk->self, done, MNI_DISK_DEPTH, wait && in_flight > 0);
    for (uint32_t i = 0; i < count; i++)
        act(loop, &done[i]);
    return loop->busy > 0 || loop->stalled;
}

/* ---- the thread ------------------------------------------------------------------------------ */

static void *run(void *context) {
    mni_ioloop *loop = context;
    mni_lock_time_holds();
    do {
        while (mni_ioloop_step(loop, true)) {
        }
    } while (mni_board_wait_work(loop->board));
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
    /* What nobody fetched is given up; a simulated disk still has reads in flight. */
    while (next_command(loop, &command))
        mni_board_end(loop->board, command.kind, MNI_END_GIVEN_UP);
    while (mni_ioloop_step(loop, false))
        if (loop->disk->method->own_time)
            (void)loop->disk->method->advance(loop->disk->self, UINT64_MAX);
}
