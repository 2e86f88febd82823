/* The command board. See board.h. */
#include "board.h"

#include <string.h>

#include "mn_assert.h"
#include "clock.h"
#include "trace.h"

/* I/O's naps while the camera moves, in shares of a frame. Frames below FRAME_NS_MIN are those of a
 * run that is not paced: what they post is not to wait, and I/O hardly sleeps. */
enum {
    LATE_SHARE = 16, /* after the next frame is expected to have ended; … */
    NAP_SHARE = 8,   /* … if it has not, so long again, … */
    NAPS_FRAMES = 4, /* … until so many frames are missing */
    WAIT_SHARE = 2,  /* what has been posted waits no longer, or I/O is woken */
    FRAME_NS_MIN = 2 * 1000 * 1000,
    FRAME_NS_MAX = 50 * 1000 * 1000,
};

size_t mni_board_need(uint32_t urgent_max, uint32_t prefetch_max, uint32_t look_bytes) {
    return mni_arena_need(urgent_max, sizeof(mni_command), _Alignof(mni_command)) +
           mni_arena_need(prefetch_max, sizeof(mni_command), _Alignof(mni_command)) +
           mni_arena_need(look_bytes, 1, 64);
}

static void ring_open(mni_command_ring *ring, uint32_t max, mni_arena *arena) {
    *ring = (mni_command_ring){
        .command = mni_arena_take(arena, max, sizeof(mni_command), _Alignof(mni_command)),
        .max = max};
}

void mni_board_open(mni_board *board, uint32_t urgent_max, uint32_t prefetch_max,
                    uint32_t look_bytes, mni_arena *arena) {
    *board =
        (mni_board){.look = mni_arena_take(arena, look_bytes, 1, 64), .look_bytes = look_bytes};
    ring_open(&board->urgent, urgent_max, arena);
    ring_open(&board->prefetch, prefetch_max, arena);
    mni_lock_open(&board->lock);
    board->lock.name = MN_TRACE_LOCK_BOARD;
    pthread_condattr_t monotonic;
    MN_ASSERT(pthread_condattr_init(&monotonic) == 0);
    MN_ASSERT(pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC) == 0);
    MN_ASSERT(pthread_cond_init(&board->work, &monotonic) == 0);
    pthread_condattr_destroy(&monotonic);
    MN_ASSERT(pthread_cond_init(&board->quiet, NULL) == 0);
}

void mni_board_close(mni_board *board) {
    pthread_cond_destroy(&board->quiet);
    pthread_cond_destroy(&board->work);
    mni_lock_close(&board->lock);
}

void mni_notes_add(mni_notes *notes, const mni_note *note) {
    for (uint32_t i = 0; i < notes->count; i++)
        if (memcmp(&notes->note[i], note, sizeof *note) == 0)
            return;
    if (notes->count < MNI_NOTES_MAX)
        notes->note[notes->count++] = *note;
}

/* ---- rings, under the lock ------------------------------------------------------------------- */

static bool ring_push(mni_command_ring *ring, const mni_command *command) {
    if (ring->count == ring->max)
        return false;
    ring->command[(ring->first + ring->count++) % ring->max] = *command;
    return true;
}

static bool ring_pop(mni_command_ring *ring, mni_command *out) {
    if (ring->count == 0)
        return false;
    *out = ring->command[ring->first];
    ring->first = (ring->first + 1) % ring->max;
    ring->count--;
    return true;
}

/* ---- commands -------------------------------------------------------------------------------- */

static bool is_nearer(const mni_command *a, const mni_command *b) {
    return a->due != b->due ? a->due < b->due : a->ref.id < b->ref.id;
}

_Static_assert((int)MNI_COMMAND_LOOK == (int)MN_TRACE_COMMANDS &&
                   (int)MNI_ENDS == (int)MN_TRACE_ENDS,
               "a trace says the same");

void mni_command_trace_end(const mni_command *command, mni_end end) {
    if (command->kind == MNI_COMMAND_LOOK)
        return;
    MNI_TRACE(MN_TRACE_ENDED, (uint32_t)command->kind | (uint32_t)end << 2, command->ref.id, 0);
}

/* By due, then by place in the file. Shell's sort: there are hundreds at most, and the C library's
 * may allocate. */
static void sort_nearest_first(mni_command *command, uint32_t count) {
    static const uint32_t gaps[] = {301, 132, 57, 23, 10, 4, 1};
    for (size_t g = 0; g < sizeof gaps / sizeof gaps[0]; g++)
        for (uint32_t i = gaps[g]; i < count; i++) {
            mni_command moving = command[i];
            uint32_t at = i;
            for (; at >= gaps[g] && is_nearer(&moving, &command[at - gaps[g]]); at -= gaps[g])
                command[at] = command[at - gaps[g]];
            command[at] = moving;
        }
}

/* Takes the prefetches that nobody has fetched off the ring, to the end of the batch, but for those
 * that are to be cancelled. */
static void take_back(mni_board *board, mni_batch *batch) {
    mni_command old;
    while (ring_pop(&board->prefetch, &old)) {
        board->open--;
        if (old.frame < batch->cancel_before) {
            board->counts.ended[old.kind][MNI_END_GIVEN_UP]++;
            mni_command_trace_end(&old, MNI_END_GIVEN_UP);
            continue;
        }
        board->counts.posted[old.kind]--; /* as it will be again */
        batch->command[batch->count++] = old;
    }
}

/* A frame has ended. One that was late is not expected to be so again. */
static void keep_pace(mni_board *board) {
    const uint64_t now_ns = mni_clock_ns(CLOCK_MONOTONIC);
    const uint64_t between_ns = now_ns - board->posted_ns;
    board->frame_ns = between_ns < board->between_ns ? between_ns : board->between_ns;
    board->between_ns = between_ns;
    board->posted_ns = now_ns;
    board->moves = board->looks != board->posted_looks;
    board->posted_looks = board->looks;
}

/* Does I/O, which naps, look here before long? Not if the camera has stopped, or frames come much
 * faster than they did. */
static bool sees_soon(const mni_board *board) {
    return board->moves && board->nap_until_ns > 0 &&
           board->nap_until_ns <= board->posted_ns + board->frame_ns / WAIT_SHARE;
}

uint32_t mni_board_post(mni_board *board, mni_batch *batch) {
    uint32_t rejected = 0, urgent = 0;
    mni_lock_take(&board->lock);
    if (!batch->goes_on)
        keep_pace(board);
    while (urgent < batch->count && mni_command_is_urgent(batch->command[urgent].kind))
        urgent++;
    for (uint32_t i = urgent; i < batch->count; i++)
        if (batch->command[i].kind == MNI_COMMAND_PREFETCH)
            MNI_TRACE(MN_TRACE_POST, MN_TRACE_PREFETCH, batch->command[i].ref.id,
                      batch->command[i].due);
    MN_ASSERT(!batch->goes_on || urgent == batch->count);
    if (batch->sorts && !batch->goes_on) {
        take_back(board, batch);
        sort_nearest_first(batch->command + urgent, batch->count - urgent);
    }
    for (uint32_t i = 0; i < batch->count; i++) {
        const mni_command *command = &batch->command[i];
        bool prefetch = !mni_command_is_urgent(command->kind);
        MN_ASSERT(prefetch == (i >= urgent));
        bool room = ring_push(prefetch ? &board->prefetch : &board->urgent, command);
        board->open += room;
        if (room || prefetch)
            board->counts.posted[command->kind]++;
        if (room && !prefetch)
            MNI_TRACE(MN_TRACE_POST, command->kind, command->ref.id, command->due);
        if (!room && prefetch) {
            board->counts.ended[command->kind][MNI_END_GIVEN_UP]++;
            mni_command_trace_end(command, MNI_END_GIVEN_UP);
        }
        if (!room && !prefetch)
            batch->command[rejected++] = *command;
    }
    MNI_TRACE_COUNT(MN_TRACE_N_COMMANDS, board->open);
    if (batch->count > rejected && (batch->goes_on || !sees_soon(board)))
        pthread_cond_signal(&board->work);
    mni_lock_give(&board->lock);
    return rejected;
}

uint32_t mni_board_fetch(mni_board *board, mni_command *out, uint32_t max) {
    uint32_t count = 0;
    mni_lock_take(&board->lock);
    while (count < max &&
           (ring_pop(&board->urgent, &out[count]) || ring_pop(&board->prefetch, &out[count])))
        count++;
    mni_lock_give(&board->lock);
    return count;
}

static bool has_work(const mni_board *board) {
    return board->urgent.count + board->prefetch.count > 0;
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

void mni_board_tell(mni_board *board, mni_board_news *news) {
    mni_lock_take(&board->lock);
    board->open += news->own;
    board->counts.posted[MNI_COMMAND_PREFETCH] += news->own;
    for (int kind = 0; kind < MNI_COMMANDS; kind++)
        for (int end = 0; end < MNI_ENDS; end++) {
            MN_ASSERT(board->open >= news->ended[kind][end]);
            board->open -= news->ended[kind][end];
            board->counts.ended[kind][end] += news->ended[kind][end];
        }
    board->counts.checked += news->checked;
    board->counts.busy_ns += news->busy_ns;
    board->counts.depth_ns += news->depth_ns;
    board->counts.full_ns += news->full_ns;
    board->counts.full_bytes += news->full_bytes;
    board->counts.cpu_ns += news->cpu_ns;
    MN_ASSERT(unended(board) == board->open);
    if (board->open == 0)
        pthread_cond_signal(&board->quiet);
    mni_lock_give(&board->lock);
    *news = (mni_board_news){0};
}

void mni_board_look(mni_board *board, const void *look) {
    mni_lock_take(&board->lock);
    memcpy(board->look, look, board->look_bytes);
    board->looks++;
    mni_lock_give(&board->lock);
}

bool mni_board_look_get(mni_board *board, void *out, uint64_t *looks) {
    mni_lock_take(&board->lock);
    bool fresh = *looks != board->looks;
    if (fresh)
        memcpy(out, board->look, board->look_bytes);
    *looks = board->looks;
    mni_lock_give(&board->lock);
    return fresh;
}

/* ---- waiting --------------------------------------------------------------------------------- */

/* Gives the lock away meanwhile: what is slept is nobody's hold. */
static void wait_for(mni_board *board, pthread_cond_t *what) {
    board->lock.since_ns = 0;
    pthread_cond_wait(what, &board->lock.mutex);
}

/* Until when I/O naps; 0: it sleeps until it is woken. */
static uint64_t nap_end_ns(const mni_board *board) {
    const uint64_t now_ns = mni_clock_ns(CLOCK_MONOTONIC), frame_ns = board->frame_ns;
    const uint64_t next_ns = board->posted_ns + frame_ns + frame_ns / LATE_SHARE;
    if (!board->moves || frame_ns < FRAME_NS_MIN || frame_ns > FRAME_NS_MAX ||
        now_ns - board->posted_ns > NAPS_FRAMES * frame_ns)
        return 0;
    return next_ns > now_ns ? next_ns : now_ns + frame_ns / NAP_SHARE;
}

static void nap(mni_board *board, uint64_t until_ns) {
    const struct timespec until = {.tv_sec = (time_t)(until_ns / 1000000000),
                                   .tv_nsec = (long)(until_ns % 1000000000)};
    board->lock.since_ns = 0;
    board->nap_until_ns = until_ns;
    pthread_cond_timedwait(&board->work, &board->lock.mutex, &until);
    board->nap_until_ns = 0;
}

bool mni_board_wait_work(mni_board *board) {
    mni_lock_take(&board->lock);
    while (!has_work(board) && !board->stop) {
        const uint64_t until_ns = nap_end_ns(board);
        if (until_ns > 0)
            nap(board, until_ns);
        else
            wait_for(board, &board->work);
    }
    bool go_on = !board->stop;
    mni_lock_give(&board->lock);
    return go_on;
}

void mni_board_wait_quiet(mni_board *board) {
    mni_lock_take(&board->lock);
    if (board->nap_until_ns > 0)
        pthread_cond_signal(&board->work);
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
