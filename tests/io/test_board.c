/* Goal: every command that is posted ends once, urgent ones go first, a full board loses nothing in
 * silence. Method: rings of a few places, wrapped around many times; then two threads. */
#include <check.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "board.h"
#include "clock.h"
#include "suite.h"

enum { LOOK_BYTES = 24, BATCH_MAX = 64 };

static mni_arena arena;
static mni_board board;

static void open_board(uint32_t urgent_max, uint32_t prefetch_max) {
    ck_assert_int_eq(
        mni_arena_open(&arena, mni_board_need(urgent_max, prefetch_max, LOOK_BYTES), NULL), MN_OK);
    mni_board_open(&board, urgent_max, prefetch_max, LOOK_BYTES, &arena);
}

static void close_board(void) {
    ck_assert_uint_eq(mni_board_open_commands(&board), 0);
    mni_board_close(&board);
    mni_arena_close(&arena);
}

static mni_command command(mni_command_kind kind, uint32_t id) {
    return (mni_command){.kind = kind, .ref = {.id = id, .pages = 1}};
}

/* A batch of one. */
static bool post(mni_command c) {
    mni_batch batch = {.command = &c, .count = 1};
    return mni_board_post(&board, &batch) == 0;
}

static bool fetch(mni_command *out) {
    return mni_board_fetch(&board, out, 1) == 1;
}

static void end(mni_command_kind kind, mni_end how) {
    mni_board_news news = {.own = 0};
    news.ended[kind][how] = 1;
    mni_board_tell(&board, &news);
    ck_assert_uint_eq(news.ended[kind][how], 0);
}

START_TEST(urgent_first_and_in_order) {
    open_board(3, 3);
    for (uint32_t round = 0; round < 50; round++) {
        for (uint32_t i = 0; i < 6; i++)
            ck_assert(post(command(i % 2 ? MNI_COMMAND_URGENT_UP : MNI_COMMAND_PREFETCH, 1 + i)));
        static const uint32_t order[] = {2, 4, 6, 1, 3, 5};
        for (uint32_t i = 0; i < 6; i++) {
            mni_command c;
            ck_assert(fetch(&c));
            ck_assert_uint_eq(c.ref.id, order[i]);
            end(c.kind, (mni_end)(i % MNI_ENDS));
        }
        mni_command none;
        ck_assert(!fetch(&none));
    }
    close_board();
}
END_TEST

/* In batches: urgent commands without room come back in front, prefetches without are given up. */
START_TEST(a_full_board_says_so) {
    open_board(2, 2);
    mni_command c[BATCH_MAX];
    for (uint32_t i = 0; i < 5; i++) {
        c[i] = command(MNI_COMMAND_URGENT_DOWN, 10 + i);
        c[5 + i] = command(MNI_COMMAND_PREFETCH, 1 + i);
    }
    mni_batch batch = {.command = c, .count = 10};
    ck_assert_uint_eq(mni_board_post(&board, &batch), 3);
    for (uint32_t i = 0; i < 3; i++)
        ck_assert_uint_eq(c[i].ref.id, 12 + i);
    mni_board_counts counts;
    mni_board_counts_get(&board, &counts);
    ck_assert_uint_eq(counts.posted[MNI_COMMAND_PREFETCH], 5); /* three ended at once */
    ck_assert_uint_eq(counts.ended[MNI_COMMAND_PREFETCH][MNI_END_GIVEN_UP], 3);
    ck_assert_uint_eq(counts.posted[MNI_COMMAND_URGENT_DOWN], 2); /* three were never posted */
    ck_assert_uint_eq(mni_board_open_commands(&board), 4);
    uint32_t count = mni_board_fetch(&board, c, 3);
    ck_assert_uint_eq(count, 3);
    count += mni_board_fetch(&board, c + count, BATCH_MAX - count);
    ck_assert_uint_eq(count, 4);
    while (count > 0)
        end(c[--count].kind, MNI_END_LOADED);
    close_board();
}
END_TEST

/* Prefetches that are sorted stand by due, whenever they came; those that nobody has posted lately
 * end, and the sums agree. */
START_TEST(nearest_first_and_cancelled) {
    enum { FRAMES = 200, PREFETCHES = 40 };
    open_board(2, PREFETCHES);
    uint64_t dice = 1;
    for (uint32_t frame = 1; frame < FRAMES; frame++) {
        mni_command c[BATCH_MAX + PREFETCHES], out[PREFETCHES];
        mni_batch batch = {.command = c, .sorts = true, .cancel_before = frame > 3 ? frame - 3 : 0};
        for (batch.count = 0; batch.count < frame % 30; batch.count++) {
            dice = dice * 6364136223846793005u + 1442695040888963407u;
            c[batch.count] = command(MNI_COMMAND_PREFETCH, 1 + (uint32_t)(dice >> 40));
            c[batch.count].due = frame + (uint32_t)(dice >> 33) % 12;
            c[batch.count].frame = frame;
        }
        ck_assert_uint_eq(mni_board_post(&board, &batch), 0);
        uint32_t count = mni_board_fetch(&board, out, frame % 17);
        for (uint32_t i = 0; i < count; i++) {
            ck_assert_uint_ge(out[i].frame + 3, frame);
            ck_assert(i == 0 || out[i - 1].due < out[i].due ||
                      (out[i - 1].due == out[i].due && out[i - 1].ref.id <= out[i].ref.id));
            end(MNI_COMMAND_PREFETCH, MNI_END_LOADED);
        }
    }
    mni_batch last = {
        .command = (mni_command[PREFETCHES]){{0}}, .sorts = true, .cancel_before = UINT32_MAX};
    ck_assert_uint_eq(mni_board_post(&board, &last), 0);
    ck_assert_uint_eq(mni_board_open_commands(&board), 0);
    mni_board_counts counts;
    mni_board_counts_get(&board, &counts);
    ck_assert_uint_gt(counts.ended[MNI_COMMAND_PREFETCH][MNI_END_GIVEN_UP], FRAMES);
    ck_assert_uint_gt(counts.ended[MNI_COMMAND_PREFETCH][MNI_END_LOADED], FRAMES);
    close_board();
}
END_TEST

/* I/O's own commands count before what has ended with them: the board is never quiet in between. */
START_TEST(own_commands_and_looks) {
    open_board(2, 2);
    mni_command c;
    char look[LOOK_BYTES], seen[LOOK_BYTES] = "nothing";
    uint64_t looks = 0;
    ck_assert(!mni_board_look_get(&board, seen, &looks));
    ck_assert(post(command(MNI_COMMAND_URGENT_UP, 1)) && fetch(&c));
    mni_board_news news = {.own = 2};
    news.ended[MNI_COMMAND_URGENT_UP][MNI_END_LOADED] = 1;
    mni_board_tell(&board, &news);
    ck_assert_uint_eq(mni_board_open_commands(&board), 2);
    end(MNI_COMMAND_PREFETCH, MNI_END_LOADED);
    end(MNI_COMMAND_PREFETCH, MNI_END_GIVEN_UP);
    for (int i = 0; i < 3; i++) {
        memset(look, 'a' + i, sizeof look);
        mni_board_look(&board, look);
        ck_assert(mni_board_look_get(&board, seen, &looks));
        ck_assert_mem_eq(look, seen, sizeof look);
        ck_assert(!mni_board_look_get(&board, seen, &looks));
    }
    close_board();
}
END_TEST

enum { COMMANDS = 20000 };

static void *serve(void *context) {
    uint32_t *served = context;
    mni_command c[3];
    while (mni_board_wait_work(&board))
        for (uint32_t count; (count = mni_board_fetch(&board, c, 3)) > 0; *served += count) {
            mni_board_news news = {.own = 0};
            for (uint32_t i = 0; i < count; i++)
                news.ended[c[i].kind][MNI_END_RESIDENT]++;
            mni_board_tell(&board, &news);
        }
    return NULL;
}

START_TEST(two_threads) {
    open_board(4, 4);
    uint32_t served = 0, posted = 0;
    pthread_t thread;
    ck_assert_int_eq(pthread_create(&thread, NULL, serve, &served), 0);
    for (uint32_t i = 0; i < COMMANDS; i++) {
        mni_command c = command((mni_command_kind)(i % MNI_COMMANDS), 1 + i);
        posted += post(c);
        if (i % 1000 == 0)
            mni_board_wait_quiet(&board);
    }
    mni_board_wait_quiet(&board);
    mni_board_stop(&board);
    pthread_join(thread, NULL);
    mni_board_counts counts;
    mni_board_counts_get(&board, &counts);
    ck_assert_uint_eq(served + counts.ended[MNI_COMMAND_PREFETCH][MNI_END_GIVEN_UP] +
                          counts.ended[MNI_COMMAND_LOOK][MNI_END_GIVEN_UP],
                      posted);
    ck_assert_uint_gt(served, 0);
    close_board();
}
END_TEST

/* Frames of a moving camera that come one like the other: I/O sees by itself what they post, and
 * what comes after the last of them wakes it. */
START_TEST(sees_what_frames_post) {
    enum { FRAMES = 12, FRAME_NS = 4000000 };
    const struct timespec frame = {.tv_nsec = FRAME_NS};
    const char look[LOOK_BYTES] = "moves";
    open_board(4, 4);
    uint32_t served = 0;
    pthread_t thread;
    ck_assert_int_eq(pthread_create(&thread, NULL, serve, &served), 0);
    for (uint32_t i = 0; i < FRAMES; i++) {
        mni_board_look(&board, look);
        ck_assert(post(command(MNI_COMMAND_URGENT_UP, 1 + i)));
        nanosleep(&frame, NULL);
        while (mni_board_open_commands(&board) > 0) /* nobody wakes it */
            nanosleep(&frame, NULL);
    }
    for (uint32_t i = 0; i < 2; i++) { /* it naps, then sleeps */
        mni_batch nothing = {0};
        ck_assert_uint_eq(mni_board_post(&board, &nothing), 0);
        ck_assert(post(command(MNI_COMMAND_URGENT_UP, 100 + i)));
        mni_board_wait_quiet(&board);
        for (uint32_t frames = 0; frames < 20; frames++)
            nanosleep(&frame, NULL);
    }
    mni_board_look(&board, look);
    ck_assert(post(command(MNI_COMMAND_URGENT_UP, 200)));
    mni_board_stop(&board); /* asleep or not, and with something to do */
    pthread_join(thread, NULL);
    for (mni_command c; fetch(&c); served++)
        end(c.kind, MNI_END_GIVEN_UP);
    ck_assert_uint_eq(served, FRAMES + 3);
    close_board();
}
END_TEST

static uint64_t nap_until_ns(void) {
    mni_lock_take(&board.lock);
    const uint64_t until_ns = board.nap_until_ns;
    mni_lock_give(&board.lock);
    return until_ns;
}

/* When the camera stops (0), or frames come faster all at once (1), what is posted does not wait
 * for the end of a nap that was meant for other frames. A busy machine may keep I/O from running
 * so long: one time of many will do. */
START_TEST(a_nap_is_cut_short) {
    enum { TRIES = 40, FRAME_NS = 40000000 };
    const struct timespec frame = {.tv_nsec = FRAME_NS}, moment = {.tv_nsec = 1000000};
    const char look[LOOK_BYTES] = "moves";
    open_board(4, 4);
    uint32_t served = 0, before_its_end = 0, tries = 0;
    pthread_t thread;
    ck_assert_int_eq(pthread_create(&thread, NULL, serve, &served), 0);
    for (; tries < TRIES && before_its_end == 0; tries++) {
        for (int i = 0; i < 4; i++) {
            if (i > 0)
                nanosleep(&frame, NULL);
            mni_board_look(&board, look);
            ck_assert(post(command(MNI_COMMAND_URGENT_UP, 1)));
        }
        nanosleep(&moment, NULL);
        const uint64_t until_ns = nap_until_ns();
        if (_i == 1)
            mni_board_look(&board, look);
        ck_assert(post(command(MNI_COMMAND_URGENT_UP, 2)));
        while (mni_board_open_commands(&board) > 0)
            nanosleep(&moment, NULL);
        before_its_end += mni_clock_ns(CLOCK_MONOTONIC) < until_ns;
    }
    mni_board_stop(&board);
    pthread_join(thread, NULL);
    ck_assert_uint_eq(before_its_end, 1);
    ck_assert_uint_eq(served, 5 * tries);
    close_board();
}
END_TEST

/* What is posted while a frame goes on does not wait for the end of a nap, nor does it take back
 * what stands there, or count as a frame. */
START_TEST(within_a_frame) {
    enum { FRAMES = 4, FRAME_NS = 40000000 };
    const char look[LOOK_BYTES] = "moves";
    mni_command c[2 + 4] = {command(MNI_COMMAND_PREFETCH, 1)};
    mni_batch ends = {.command = c, .count = 1, .sorts = true, .cancel_before = 5};
    open_board(4, 4);
    ck_assert_uint_eq(mni_board_post(&board, &ends), 0);
    mni_board_look(&board, look);
    const uint64_t posted_ns = board.posted_ns, between_ns = board.between_ns;
    c[0] = command(MNI_COMMAND_URGENT_DOWN, 2);
    mni_batch goes_on = {
        .command = c, .count = 1, .goes_on = true, .sorts = true, .cancel_before = 5};
    ck_assert_uint_eq(mni_board_post(&board, &goes_on), 0);
    ck_assert_uint_eq(board.posted_ns, posted_ns);
    ck_assert_uint_eq(board.between_ns, between_ns);
    for (uint32_t id = 2; id > 0; id--) { /* the prefetch, of frame 0, stands still */
        mni_command got;
        ck_assert(fetch(&got));
        ck_assert_uint_eq(got.ref.id, id);
        end(got.kind, MNI_END_LOADED);
    }
    uint32_t served = 0;
    pthread_t thread;
    ck_assert_int_eq(pthread_create(&thread, NULL, serve, &served), 0);
    const struct timespec frame = {.tv_nsec = FRAME_NS}, moment = {.tv_nsec = 1000000};
    for (int i = 0; i < FRAMES; i++) {
        mni_board_look(&board, look);
        ck_assert(post(command(MNI_COMMAND_URGENT_UP, 1)));
        nanosleep(&frame, NULL);
    }
    while (mni_board_open_commands(&board) > 0)
        nanosleep(&moment, NULL);
    c[0] = command(MNI_COMMAND_URGENT_DOWN, 2);
    goes_on.count = 1;
    ck_assert_uint_eq(mni_board_post(&board, &goes_on), 0);
    mni_board_wait_quiet(&board);
    mni_board_stop(&board);
    pthread_join(thread, NULL);
    ck_assert_uint_eq(served, FRAMES + 1);
    close_board();
}
END_TEST

int main(void) {
    Suite *suite = suite_create("board");
    TCase *tests = tcase_create("board");
    tcase_set_timeout(tests, 60);
    tcase_add_test(tests, sees_what_frames_post);
    tcase_add_loop_test(tests, a_nap_is_cut_short, 0, 2);
    tcase_add_test(tests, within_a_frame);
    tcase_add_test(tests, urgent_first_and_in_order);
    tcase_add_test(tests, a_full_board_says_so);
    tcase_add_test(tests, nearest_first_and_cancelled);
    tcase_add_test(tests, own_commands_and_looks);
    tcase_add_test(tests, two_threads);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
