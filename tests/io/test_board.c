/* Goal: every command that is posted ends once, urgent ones go first, a full board loses nothing in
 * silence. Method: rings of a few places, wrapped around many times; then two threads. */
#include <check.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"
#include "suite.h"

static mni_arena arena;
static mni_board board;

static void open_board(uint32_t urgent_max, uint32_t prefetch_max) {
    ck_assert_int_eq(mni_arena_open(&arena, mni_board_need(urgent_max, prefetch_max), NULL), MN_OK);
    mni_board_open(&board, urgent_max, prefetch_max, &arena);
}

static void close_board(void) {
    ck_assert_uint_eq(mni_board_open_commands(&board), 0);
    mni_board_close(&board);
    mni_arena_close(&arena);
}

static mni_command command(mni_command_kind kind, uint32_t id) {
    return (mni_command){.kind = kind, .ref = {.id = id, .pages = 1}};
}

START_TEST(urgent_first_and_in_order) {
    open_board(3, 3);
    for (uint32_t round = 0; round < 50; round++) {
        for (uint32_t i = 0; i < 6; i++) {
            mni_command c = command(i % 2 ? MNI_COMMAND_URGENT_UP : MNI_COMMAND_PREFETCH, 1 + i);
            ck_assert(mni_board_post(&board, &c));
        }
        static const uint32_t order[] = {2, 4, 6, 1, 3, 5};
        for (uint32_t i = 0; i < 6; i++) {
            mni_command c;
            ck_assert(mni_board_fetch(&board, &c));
            ck_assert_uint_eq(c.ref.id, order[i]);
            mni_board_end(&board, c.kind, (mni_end)(i % MNI_ENDS));
        }
        mni_command none;
        ck_assert(!mni_board_fetch(&board, &none));
    }
    close_board();
}
END_TEST

START_TEST(a_held_board_shows_nothing) {
    open_board(2, 2);
    mni_command c = command(MNI_COMMAND_URGENT_UP, 1), out;
    mni_board_hold(&board, true);
    ck_assert(mni_board_post(&board, &c));
    ck_assert(!mni_board_fetch(&board, &out));
    mni_board_hold(&board, false);
    ck_assert(mni_board_fetch(&board, &out));
    mni_board_end(&board, out.kind, MNI_END_GIVEN_UP);
    close_board();
}
END_TEST

START_TEST(a_full_board_says_so) {
    open_board(2, 2);
    mni_command c;
    for (uint32_t i = 0; i < 5; i++) {
        c = command(MNI_COMMAND_PREFETCH, 1 + i);
        ck_assert_int_eq(mni_board_post(&board, &c), i < 2);
        c = command(MNI_COMMAND_URGENT_DOWN, 10 + i);
        ck_assert_int_eq(mni_board_post(&board, &c), i < 2);
    }
    mni_board_counts counts;
    mni_board_counts_get(&board, &counts);
    ck_assert_uint_eq(counts.posted[MNI_COMMAND_PREFETCH], 5); /* three ended at once */
    ck_assert_uint_eq(counts.ended[MNI_COMMAND_PREFETCH][MNI_END_GIVEN_UP], 3);
    ck_assert_uint_eq(counts.posted[MNI_COMMAND_URGENT_DOWN], 2); /* three were never posted */
    ck_assert_uint_eq(mni_board_open_commands(&board), 4);
    while (mni_board_fetch(&board, &c))
        mni_board_end(&board, c.kind, MNI_END_LOADED);
    close_board();
}
END_TEST

enum { COMMANDS = 20000 };

static void *serve(void *context) {
    uint32_t *served = context;
    mni_command c;
    while (mni_board_wait_work(&board))
        while (mni_board_fetch(&board, &c)) {
            ++*served;
            mni_board_end(&board, c.kind, MNI_END_RESIDENT);
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
        posted += mni_board_post(&board, &c);
        if (i % 1000 == 0)
            mni_board_wait_quiet(&board);
    }
    mni_board_wait_quiet(&board);
    mni_board_stop(&board);
    pthread_join(thread, NULL);
    ck_assert_uint_eq(served, posted);
    ck_assert_uint_gt(posted, 0);
    close_board();
}
END_TEST

int main(void) {
    Suite *suite = suite_create("board");
    TCase *tests = tcase_create("board");
    tcase_set_timeout(tests, 60);
    tcase_add_test(tests, urgent_first_and_in_order);
    tcase_add_test(tests, a_held_board_shows_nothing);
    tcase_add_test(tests, a_full_board_says_so);
    tcase_add_test(tests, two_threads);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
