/* I/O: fetches commands, reads blocks, checks them, completes (paper §3.3.4).
 *
 * A machine with one step, so that it runs in a thread of its own or, with the simulated disk,
 * inside Navigate's frame on virtual time.
 *
 * Threads: step belongs to one thread: the one that mni_ioloop_start makes, or the caller. Order:
 * open; start, or steps; stop; close. Memory: fixed. */
#ifndef MNI_IOLOOP_H
#define MNI_IOLOOP_H

#include <pthread.h>

#include "disk.h"
#include "extents.h"
#include "pool.h"
#include "scout.h"
#include "seen.h"
#include "trace.h"

typedef enum mni_request_state {
    MNI_REQUEST_FREE = 0,  /* then AGAIN */
    MNI_REQUEST_IN_FLIGHT, /* the disk has it; exactly one completion; then COME */
    MNI_REQUEST_COME,      /* to be looked at; then FREE or AGAIN */
    MNI_REQUEST_AGAIN, /* to be submitted (again): short, EINTR, EAGAIN, no room; then IN_FLIGHT */
} mni_request_state;

typedef struct mni_request {
    mni_request_state state;
    mni_command command;
    mni_load load;
    mni_read read; /* all of it, as it began */
    uint32_t done_bytes;
    uint32_t fruitless; /* completions in a row that brought nothing */
} mni_request;

typedef struct mni_ioloop {
    /* const after open */
    mni_pool *pool;
    mni_board *board;
    mni_disk *disk;
    mni_extents *extents; /* blocks are compressed: read into a slot each, and unpacked; or NULL */
    const mn_header *header;
    mni_store_check check;
    const void *check_context;
    mni_store_rate rate; /* NULL: no scouts */
    const void *rate_context;
    mni_trace_ring *trace; /* NULL: none */
    bool serial;           /* one command at a time, in order */
    bool has_thread;
    pthread_t thread;
    /* I/O only */
    mni_request request[MNI_DISK_TAGS];  /* by tag */
    uint32_t busy;                       /* requests that are not FREE */
    uint32_t reading;                    /* those that are not COME either */
    mni_command fetched[MNI_DISK_DEPTH]; /* from the board, [next, fetched_count) not begun yet */
    uint32_t next, fetched_count;
    mni_board_news news;
    uint32_t full_old;      /* reads under way when it came to be so that have not come yet */
    uint64_t full_since_ns; /* the last came, and the disk has as many as it takes since; or 0 */
    uint64_t busy_since_ns; /* busy and reading have been what they are */
    uint64_t cpu_ns;        /* of this thread, told so far; UINT64_MAX: it has none of its own */
    mni_seen seen;          /* blocks that have been checked */
    mni_scouts scouts;
    uint32_t first_reads; /* that the scouts may still ask for before the first frame, besides
                             what its camera wants where that is known */
    uint32_t first_looks; /* posted before the first frame: 0 or 1 */
    unsigned char *look;  /* as last seen on the board */
    uint64_t looks;       /* 0: never */
    float *urgency;       /* of a block's references … */
    mni_notes *below;     /* … and what is known of them */
} mni_ioloop;

/* What open takes from the arena. */
size_t mni_ioloop_need(const mn_header *header, uint32_t k, uint32_t look_bytes);
void mni_ioloop_open(mni_ioloop *loop, uint32_t look_bytes, mni_arena *arena);

/* The fields above the line are filled in by the caller, before open. */
mn_code mni_ioloop_start(mni_ioloop *loop, mn_status *st);
/* One round: submits, collects, completes, fetches. wait: sleeps a little when reads are in flight
 * and none has ended. Returns whether anything is under way. */
bool mni_ioloop_step(mni_ioloop *loop, bool wait);
/* Ends the thread, if there is one, and every open command. The disk is quiet then. */
void mni_ioloop_stop(mni_ioloop *loop);

#endif
