/* Traces: what happened in a session, event by event. docs/trace.md specifies the bytes and says
 * what every event means.
 *
 * A session writes one (mn_session_desc.trace_path); this is what stands in it, and how it is read.
 * Reading: any thread, one at a time for each open file; it blocks on the disk and takes constant
 * memory. What a file says is not trusted: see mn_trace_next. */
#ifndef METANODE_TRACE_H
#define METANODE_TRACE_H

#include <stdbool.h>
#include <stdint.h>

#include "metanode/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Who an event is of. With a simulated disk both are one thread. */
typedef enum mn_trace_thread {
    MN_TRACE_NAVIGATE = 0,
    MN_TRACE_IO,
    MN_TRACE_THREADS
} mn_trace_thread;

/* a is a block's id (0: none) where nothing else is said. */
typedef enum mn_trace_kind {
    MN_TRACE_FRAME_BEGIN = 0, /* aux: mn_trace_round; a: the frame's number */
    MN_TRACE_FRAME_END,       /* the same */
    MN_TRACE_PHASE,           /* aux: mn_trace_phase, which begins */
    MN_TRACE_COUNT,           /* aux: mn_trace_counter; a, b: low and high half of its value */
    MN_TRACE_SPLIT,           /* a: that its node's record is in */
    MN_TRACE_COLLAPSE,        /* a: that the parent counts in */
    MN_TRACE_MISS,            /* aux: 0 of a split, 1 of a collapse; a: that is absent */
    MN_TRACE_ABSENT,          /* asked for and not there; b: its parent's block */
    MN_TRACE_REFUSED,         /* aux: 1: not there, and may not be fetched; 0: there, yet refused */
    MN_TRACE_USE,             /* comes into use; b: its parent's block */
    MN_TRACE_LEAVE,           /* goes out of use */
    MN_TRACE_GRANT,           /* an urgent prefetch is allowed, or what is there is kept for one */
    MN_TRACE_GRANT_OVER,      /* aux: 1: used; 0: dropped */
    MN_TRACE_POST,            /* aux: mn_trace_command; b: frame in which it is due, or 0 */
    MN_TRACE_ENDED,           /* aux: mn_trace_command + 4 × mn_trace_end */
    MN_TRACE_SUBMIT,          /* to the disk, once or more a read; b: bytes */
    MN_TRACE_ARRIVED,         /* from the disk; aux: 1: an error; b: bytes, or errno */
    MN_TRACE_HOLDER,          /* aux: mn_trace_place, old + 8 × new; b: which place holder */
    MN_TRACE_LOST, /* a place holder's block goes; aux: mn_trace_place + 8: was fetched ahead and
                      never used; b: which place holder */
    MN_TRACE_PREFETCH_USED, /* the first use of a block that was fetched ahead */
    MN_TRACE_LOCK_WAIT,     /* over; aux: mn_trace_lock; a: ns; b: more than 4 s */
    MN_TRACE_KINDS
} mn_trace_kind;
enum { MN_TRACE_EARLY = 0x80 }; /* in aux: for what is wanted in a moment, and not yet */

typedef enum mn_trace_round {
    MN_TRACE_FRAME = 0, /* of the run */
    MN_TRACE_ROUND,     /* a further one of a frame with a barrier */
    MN_TRACE_OPENING,   /* before the first frame */
    MN_TRACE_SETTLING,  /* the camera stands */
    MN_TRACE_ROUNDS
} mn_trace_round;

typedef enum mn_trace_phase {
    MN_TRACE_COLLAPSES = 0,
    MN_TRACE_SPLITS,
    MN_TRACE_FORESIGHT,
    MN_TRACE_EARLY_SPLITS,
    MN_TRACE_STORE, /* the store's end of a frame: grants, references, commands */
    MN_TRACE_PHASES
} mn_trace_phase;

/* What stands at the end of a frame. Numbers of this frame, or levels. */
typedef enum mn_trace_counter {
    MN_TRACE_N_SPLITS = 0,
    MN_TRACE_N_COLLAPSES,
    MN_TRACE_N_MISSES,
    MN_TRACE_N_REFUSED_FRONT,
    MN_TRACE_N_REFUSED_BUDGET,
    MN_TRACE_N_REFUSED_POOL,
    MN_TRACE_N_WAITS,
    MN_TRACE_N_NODES,     /* active */
    MN_TRACE_N_TRIANGLES, /* active */
    MN_TRACE_N_TOLERANCE, /* in 1/1000 pixel */
    MN_TRACE_N_IN_USE,    /* blocks */
    MN_TRACE_N_ANCESTORS, /* blocks in use and all their ancestors */
    MN_TRACE_N_FREE,      /* place holders on the free list … */
    MN_TRACE_N_EMPTY,     /* … and those of them without a block */
    MN_TRACE_N_LOADING,
    MN_TRACE_N_LOADED,
    MN_TRACE_N_COMMANDS, /* open: posted and not ended */
    MN_TRACE_COUNTERS
} mn_trace_counter;

typedef enum mn_trace_command {
    MN_TRACE_PREFETCH = 0,
    MN_TRACE_URGENT_UP,
    MN_TRACE_URGENT_DOWN,
    MN_TRACE_COMMANDS
} mn_trace_command;

typedef enum mn_trace_end {
    MN_TRACE_END_LOADED = 0,
    MN_TRACE_END_RESIDENT,
    MN_TRACE_END_GIVEN_UP,
    MN_TRACE_END_FAILED,
    MN_TRACE_ENDS
} mn_trace_end;

/* States of a place holder. */
typedef enum mn_trace_place {
    MN_TRACE_EMPTY = 0,
    MN_TRACE_LOADING,
    MN_TRACE_LOADED,
    MN_TRACE_FREED,
    MN_TRACE_RETIRED,
    MN_TRACE_PLACES
} mn_trace_place;

typedef enum mn_trace_lock {
    MN_TRACE_LOCK_POOL = 0,
    MN_TRACE_LOCK_BOARD,
    MN_TRACE_LOCKS
} mn_trace_lock;

typedef enum mn_trace_clock {
    MN_TRACE_MONOTONIC = 0, /* ns since the trace began */
    MN_TRACE_VIRTUAL, /* ns of the simulated disk; each event is at least one later than the last */
} mn_trace_clock;

typedef struct mn_trace_event {
    uint64_t ns;
    uint32_t a, b;
    uint8_t kind, aux, thread;
} mn_trace_event;

enum { MN_TRACE_NAME_MAX = 128 };
/* What is known of the session when it starts: the file's header. */
typedef struct mn_trace_info {
    uint32_t clock;    /* mn_trace_clock */
    uint64_t build_id; /* of the model */
    uint64_t model_bytes, triangles;
    uint32_t leaves, blocks, block_bytes_max, block_depth, l;
    uint32_t k, k_min, front_max;
    uint32_t store, io, prefetch; /* mn_store_kind, mn_io_kind, mn_prefetch */
    bool io_serial, barrier, degrade_off;
    uint64_t seed, ram_cap_bytes, nav_ops;
    float tolerance_px, fps;
    uint32_t width_px, height_px;
    uint32_t ring_events[MN_TRACE_THREADS]; /* room between what happens and the file */
    char model[MN_TRACE_NAME_MAX];          /* the file's name, without its folder */
} mn_trace_info;

typedef struct mn_trace_file mn_trace_file;

/* Opens a trace and goes through all of it once. MN_BAD_INPUT: it is none, or damaged, or it ends
 * before its end and `cut` is not given: then what is there is read. Freed by mn_trace_close. */
mn_code mn_trace_open(const char *path, bool cut, mn_trace_file **out, mn_status *st);
const mn_trace_info *mn_trace_info_of(const mn_trace_file *file);
/* Events of a thread that the file holds, and those that did not fit into its ring. */
uint64_t mn_trace_events(const mn_trace_file *file, mn_trace_thread thread);
uint64_t mn_trace_dropped(const mn_trace_file *file, mn_trace_thread thread);
/* Does the file end before its end? */
bool mn_trace_is_cut(const mn_trace_file *file);
void mn_trace_rewind(mn_trace_file *file);
/* The next event of both threads by time; false: there are no more, or *code says what is wrong.
 * Kinds are below MN_TRACE_KINDS, what stands in aux below its enum's end, and times do not fall;
 * blocks, places and numbers are anybody's. */
bool mn_trace_next(mn_trace_file *file, mn_trace_event *out, mn_code *code, mn_status *st);
void mn_trace_close(mn_trace_file *file); /* file may be NULL */

#ifdef __cplusplus
}
#endif
#endif
