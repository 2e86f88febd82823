/* The command board. See board.h. */
#include "board.h"

#include "assert.h"

size_t mni_board_need(uint32_t urgent_max, uint32_t prefetch_max) {
    return mni_arena_need(urgent_max, sizeof(mni_command), _Alignof(mni_command)) +
           mni_arena_need(prefetch_max, sizeof(mni_command), _Alignof(mni_command));
}

static void ring_open(mni_ring *ring, uint32_t max, mni_arena *arena) {
    *ring = (mni_ring){.command =
                           mni_arena_take(arena, max, sizeof(mni_command), _Alignof(mni_command)),
                       .max = max};
}

void mni_board_open(mni_board *board, uint32_t urgent_max, uint32_t prefetch_max,
                    mni_arena *arena) {
    *board = (mni_board){.open = 0};
    ring_open(&board->urgent, urgent_max, arena);
    ring_open(&board->prefetch, prefetch_max, arena);
    mni_lock_open(&board->lock);
    MN_ASSERT(pthread_cond_init(&board->work, NULL) == 0);
    MN_ASSERT(pthread_cond_init(&board->quiet, NULL) == 0);
}

void mni_board_close(mni_board *board) {
    pthread_cond_destroy(&board->quiet);
    pthread_cond_destroy(&board->work);
    mni_lock_close(&board->lock);
}

/* ---- rings, under the lock ------------------------------------------------------------------- */

static bool ring_push(mni_ring *ring, const mni_command *command) {
    if (ring->count == ring->max)
        return false;
    ring->command[(ring->first + ring->count++) % ring->max] = *command;
    return true;
}

static bool ring_pop(mni_ring *ring, mni_command *out) {
    if (ring->count == 0)
        return false;
    *out = ring->command[ring->first];
    ring->first = (ring->first + 1) % ring->max;
    ring->count--;
    return true;
}

/* ---- commands -------------------------------------------------------------------------------- */

bool mni_board_post(mni_board *board, const mni_command *command) {
    bool prefetch = command->kind == MNI_COMMAND_PREFETCH;
    mni_lock_take(&board->lock);
    bool room = ring_push(prefetch ? &board->prefetch : &board->urgent, command);
    if (room || prefetch)
        board->counts.posted[command->kind]++;
    if (room && !board->held && board->urgent.count + board->prefetch.count == 1)
        pthread_cond_signal(&board->work);
    if (room)
        board->open++;
    else if (prefetch)
        board->counts.ended[command->kind][MNI_END_GIVEN_UP]++;
    mni_lock_give(&board->lock);
    return room;
}

bool mni_board_fetch(mni_board *board, mni_command *out) {
    mni_lock_take(&board->lock);
    bool found = !board->held && (ring_pop(&board->urgent, out) || ring_pop(&board->prefetch, out));
    mni_lock_give(&board->lock);
    return found;
}

static bool has_work(const mni_board *board) {
    return !board->held && board->urgent.count + board->prefetch.count > 0;
}

void mni_board_hold(mni_board *board, bool held) {
    mni_lock_take(&board->lock);
    board->held = held;
    if (has_work(board))
        pthread_cond_signal(&board->work);
    mni_lock_give(&board->lock);
}

static uint64_t unended(const mni_board *board) {
    uint64_t count = 0;
    for (int kind = 0; kind < MNI_COMMANDS; kind++) {
        count += board->counts.posted[kind];
        for (int end = 0; end < MNI_ENDS; end++)
            count -= board->counts.ended[kind][end];
    }
    return count;
}

void mni_board_end(mni_board *board, mni_command_kind kind, mni_end end) {
    MN_ASSERT(kind < MNI_COMMANDS && end < MNI_ENDS);
    mni_lock_take(&board->lock);
    MN_ASSERT(board->open > 0);
    board->open--;
    board->counts.ended[kind][end]++;
    MN_ASSERT(unended(board) == board->open);
    if (board->open == 0)
        pthread_cond_signal(&board->quiet);
    mni_lock_give(&board->lock);
}

/* ---- waiting --------------------------------------------------------------------------------- */

/* Gives the lock away meanwhile: what is slept is nobody's hold. */
static void wait_for(mni_board *board, pthread_cond_t *what) {
    board->lock.since_ns = 0;
    pthread_cond_wait(what, &board->lock.mutex);
}

bool mni_board_wait_work(mni_board *board) {
    mni_lock_take(&board->lock);
    while (!has_work(board) && !board->stop)
        wait_for(board, &board->work);
    bool go_on = !board->stop;
    mni_lock_give(&board->lock);
    return go_on;
}

void mni_board_wait_quiet(mni_board *board) {
    mni_lock_take(&board->lock);
    while (board->open > 0)
        wait_for(board, &board->quiet);
    mni_lock_give(&board->lock);
}

void mni_board_stop(mni_board *board) {
    mni_lock_take(&board->lock);
    board->stop = true;
    pthread_cond_signal(&board->work);
    mni_lock_give(&board->lock);
}

uint32_t mni_board_open_commands(mni_board *board) {
    mni_lock_take(&board->lock);
    uint32_t open = board->open;
    mni_lock_give(&board->lock);
    return open;
}

void mni_board_counts_get(mni_board *board, mni_board_counts *out) {
    mni_lock_take(&board->lock);
    *out = board->counts;
    mni_lock_give(&board->lock);
}
