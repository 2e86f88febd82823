/* The command board: where Navigate posts what it wants read, and I/O fetches it (paper §3.3.4).
 *
 *   post ──► urgent ring ───┐
 *        └─► prefetch ring ─┴─► fetch ──► … ──► end: loaded | resident | given up | failed
 *
 * Every command that is posted ends exactly once; the sums are asserted at each end. A prefetch for
 * which there is no room ends at once, given up. Urgent commands go first.
 *
 * The board does not know what a sponsor is: two numbers by which I/O can tell whether anybody
 * still wants the command.
 *
 * Threads: one posts and waits for quiet (Navigate), one fetches, ends and waits for work (I/O); or
 * one thread does both and waits for nothing. Memory: the rings, from the arena. */
#ifndef MNI_BOARD_H
#define MNI_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "lock.h"
#include "mem.h"
#include "metanode/format.h"

typedef enum mni_command_kind {
    MNI_COMMAND_PREFETCH = 0,
    MNI_COMMAND_URGENT_UP,
    MNI_COMMAND_URGENT_DOWN,
    MNI_COMMAND_LOOK, /* reads nothing: into a block that is there, for what will be wanted below
                         it; stands among prefetches, and is in no figure or trace */
    MNI_COMMANDS
} mni_command_kind;
static inline bool mni_command_is_urgent(mni_command_kind kind) {
    return kind == MNI_COMMAND_URGENT_UP || kind == MNI_COMMAND_URGENT_DOWN;
}

/* Which places a command may take, when its block is not there. */
typedef enum mni_places {
    MNI_PLACES_ANY = 0, /* a free one; urgent: also one that is only referred to */
    MNI_PLACES_SPARE,   /* free, and not kept for anybody */
    MNI_PLACES_EMPTY,   /* one that no block has been in */
} mni_places;

/* What is known of a block before it has come, for whoever looks into it then: opaque here. */
enum { MNI_NOTES_MAX = 3 }; /* different ones of a block; further ones are lost */
typedef struct mni_note {
    uint32_t word[4];
} mni_note;
typedef struct mni_notes {
    uint32_t count;
    mni_note note[MNI_NOTES_MAX];
} mni_notes;
void mni_notes_add(mni_notes *notes, const mni_note *note);

typedef struct mni_command {
    mni_command_kind kind;
    mni_places places;
    mn_block_ref ref;
    uint32_t parent_id;                   /* that the block must name; MN_NONE: any */
    uint32_t sponsor, sponsor_generation; /* who wants it; MN_NONE: whoever posts or cancels it */
    uint32_t due;                         /* frame in which it will be wanted: sorts prefetches */
    uint32_t frame;                       /* in which it was last posted */
    mni_notes notes;
} mni_command;

typedef enum mni_end {
    MNI_END_LOADED = 0, /* read, checked, there */
    MNI_END_RESIDENT,   /* was there, or on its way, already */
    MNI_END_GIVEN_UP,   /* no room, or nobody wants it any more */
    MNI_END_FAILED,     /* could not be read, or damaged */
    MNI_ENDS
} mni_end;

/* For a trace. */
void mni_command_trace_end(const mni_command *command, mni_end end);

typedef struct mni_board_counts {
    uint64_t posted[MNI_COMMANDS];
    uint64_t ended[MNI_COMMANDS][MNI_ENDS];
    uint64_t checked; /* blocks whose contents were looked at */
    uint64_t busy_ns, depth_ns, full_ns, full_bytes, cpu_ns;
} mni_board_counts;

/* What a frame posts, and what it takes back. */
typedef struct mni_batch {
    mni_command *command; /* with room for the prefetch ring behind `count` */
    uint32_t count;
    bool goes_on;           /* the frame does: urgent commands alone, which are not to wait */
    bool sorts;             /* prefetches stand by due, not in the order in which they came */
    uint32_t cancel_before; /* prefetches posted in an earlier frame end, given up; 0: none do */
} mni_batch;

/* What I/O has to say at the end of a step. */
typedef struct mni_board_news {
    uint32_t own; /* prefetches that it has posted to itself */
    uint32_t ended[MNI_COMMANDS][MNI_ENDS];
    uint32_t checked;             /* blocks whose contents were looked at */
    uint64_t busy_ns, depth_ns;   /* with reads in flight; and that times how many */
    uint64_t full_ns, full_bytes; /* from one coming to the next, the disk having as many as it
                                   * takes in between; and what came */
    uint64_t cpu_ns;              /* of the processor */
} mni_board_news;

typedef struct mni_command_ring {
    mni_command *command;
    uint32_t max, first, count;
} mni_command_ring;

typedef struct mni_board {
    mni_lock lock;        /* subject: everything below */
    pthread_cond_t work;  /* a ring is no longer empty, or stop */
    pthread_cond_t quiet; /* open has become 0 */
    mni_command_ring urgent, prefetch;
    uint32_t open; /* commands posted and not ended */
    bool stop;
    mni_board_counts counts;
    unsigned char *look; /* look_bytes; what the camera sees, for whoever can read it */
    uint32_t look_bytes;
    uint64_t looks; /* posted so far */
    /* what I/O sleeps by */
    uint64_t posted_ns;    /* when a batch was last posted … */
    uint64_t between_ns;   /* … how long after the one before … */
    uint64_t frame_ns;     /* … the shorter one of that and the time before … */
    uint64_t posted_looks; /* … looks, then … */
    bool moves;            /* … and whether there was a new one */
    uint64_t nap_until_ns; /* then I/O will see by itself what is posted; 0: it does not nap */
} mni_board;

size_t mni_board_need(uint32_t urgent_max, uint32_t prefetch_max, uint32_t look_bytes);
void mni_board_open(mni_board *board, uint32_t urgent_max, uint32_t prefetch_max,
                    uint32_t look_bytes, mni_arena *arena);
void mni_board_close(mni_board *board);

/* Posts a batch under one lock, so that what finds room does not depend on how fast I/O fetches. A
 * prefetch for which there is no room has been posted and has ended, given up. An urgent command
 * for which there is none has not been posted: those are moved to the front of the batch, in their
 * order; returns how many. */
uint32_t mni_board_post(mni_board *board, mni_batch *batch);
/* At most max, urgent ones first; returns how many. */
uint32_t mni_board_fetch(mni_board *board, mni_command *out, uint32_t max);
/* What I/O posts to itself counts before what has ended, so that there is no moment at which all
 * seems quiet. Sets *news to zero. */
void mni_board_tell(mni_board *board, mni_board_news *news);

/* What the camera sees now, when it is something else; look_bytes, copied. get: false, and *out as
 * it was, when nothing new has been posted since *looks, which it sets. */
void mni_board_look(mni_board *board, const void *look);
bool mni_board_look_get(mni_board *board, void *out, uint64_t *looks);

/* I/O: sleeps until there is something to fetch; false: told to stop. While the camera moves it
 * wakes by itself, a little after the next frame is expected to have ended: to wake it may cost
 * Navigate as much as all else in a frame. */
bool mni_board_wait_work(mni_board *board);
/* Navigate: sleeps until every command has ended. */
void mni_board_wait_quiet(mni_board *board);
void mni_board_stop(mni_board *board);
uint32_t mni_board_open_commands(mni_board *board);
void mni_board_counts_get(mni_board *board, mni_board_counts *out);

#endif
