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
    MNI_COMMANDS
} mni_command_kind;

typedef struct mni_command {
    mni_command_kind kind;
    mn_block_ref ref;
    uint32_t parent_id;                   /* that the block must name; MN_NONE: any */
    uint32_t sponsor, sponsor_generation; /* who wants it */
} mni_command;

typedef enum mni_end {
    MNI_END_LOADED = 0, /* read, checked, there */
    MNI_END_RESIDENT,   /* was there, or on its way, already */
    MNI_END_GIVEN_UP,   /* no room, or nobody wants it any more */
    MNI_END_FAILED,     /* could not be read, or damaged */
    MNI_ENDS
} mni_end;

typedef struct mni_board_counts {
    uint64_t posted[MNI_COMMANDS];
    uint64_t ended[MNI_COMMANDS][MNI_ENDS];
} mni_board_counts;

typedef struct mni_ring {
    mni_command *command;
    uint32_t max, first, count;
} mni_ring;

typedef struct mni_board {
    mni_lock lock;        /* subject: everything below */
    pthread_cond_t work;  /* a ring is no longer empty, or stop */
    pthread_cond_t quiet; /* open has become 0 */
    mni_ring urgent, prefetch;
    uint32_t open; /* commands posted and not ended */
    bool held;     /* fetch finds nothing: Navigate is still posting */
    bool stop;
    mni_board_counts counts;
} mni_board;

size_t mni_board_need(uint32_t urgent_max, uint32_t prefetch_max);
void mni_board_open(mni_board *board, uint32_t urgent_max, uint32_t prefetch_max, mni_arena *arena);
void mni_board_close(mni_board *board);

/* false: no room. A prefetch has then been posted and has ended, given up; an urgent command has
 * not been posted: ask again. */
bool mni_board_post(mni_board *board, const mni_command *command);
bool mni_board_fetch(mni_board *board, mni_command *out); /* false: nothing there, or held */
/* Navigate, around its posting: with a serialised disk, what finds room on the board must not
 * depend on how fast I/O fetches. */
void mni_board_hold(mni_board *board, bool held);
void mni_board_end(mni_board *board, mni_command_kind kind, mni_end end);

/* I/O: sleeps until there is something to fetch; false: told to stop. */
bool mni_board_wait_work(mni_board *board);
/* Navigate: sleeps until every command has ended. */
void mni_board_wait_quiet(mni_board *board);
void mni_board_stop(mni_board *board);
uint32_t mni_board_open_commands(mni_board *board);
void mni_board_counts_get(mni_board *board, mni_board_counts *out);

#endif
