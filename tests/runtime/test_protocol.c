/* Goal: what threads do to each other only now and then: a command that is overtaken, stale, or
 * answered while a read is under way.
 * Method: a pool without I/O; its steps are made here by hand, in the order that hurts. */
#include <check.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#include "pool.h"
#include "suite.h"
#include "walk.h"

static made_file file;
static mni_arena arena;
static mni_board board;
static mni_pool pool;
static uint32_t in_use;

static mn_block_ref ref_of(uint32_t block) {
    return file.block[block].ref;
}

static void end(mni_command_kind kind, mni_end how) {
    mni_board_news news = {.own = 0};
    news.ended[kind][how] = 1;
    mni_board_tell(&board, &news);
}

static void step(const mni_command *command, mni_begin expected, mni_load *load) {
    mni_begin begin = mni_pool_begin(&pool, command, false, load);
    ck_assert_int_eq(begin, expected);
    if (begin != MNI_BEGIN_READ)
        end(command->kind, begin == MNI_BEGIN_RESIDENT ? MNI_END_RESIDENT : MNI_END_GIVEN_UP);
}

static void finish(const mni_command *command, const mni_load *load) {
    int fd = open(file.path, O_RDONLY | O_CLOEXEC);
    ssize_t length = (ssize_t)load->ref.pages * MN_PAGE_BYTES;
    ck_assert_int_eq(pread(fd, load->bytes, (size_t)length, (off_t)load->ref.id * MN_PAGE_BYTES),
                     length);
    close(fd);
    mni_pool_loaded(&pool, command, load);
    end(command->kind, MNI_END_LOADED);
}

static mni_command fetch(uint32_t block) {
    mni_command command;
    ck_assert(mni_board_fetch(&board, &command, 1) == 1);
    ck_assert_uint_eq(command.ref.id, ref_of(block).id);
    return command;
}

static void next_frame(void) {
    mni_report reports[MNI_REPORTS_MAX];
    mni_pool_end_frame(&pool);
    mni_pool_begin_frame(&pool, reports);
}

/* Child block of the root, or, with block 0, the root. */
static mni_answer enter(uint32_t block) {
    const void *bytes = NULL;
    mni_wish wish = {.way = MNI_WAY_DOWN,
                     .ref = ref_of(block),
                     .parent = block == 0 ? (mn_block_ref){0} : ref_of(0),
                     .adds = true,
                     .table_count = in_use,
                     .in_use = in_use};
    mni_answer answer = mni_pool_enter(&pool, &wish, &bytes);
    in_use += answer == MNI_GRANTED;
    return answer;
}

/* A root block, two below it, two below each of those; the root is in use, and the prefetches of
 * its children stand on the board. */
static void open_pool_as(mn_blocking blocking, uint32_t blocks, mn_prefetch prefetch, uint32_t k) {
    made_desc made = {.seed = 1,
                      .blocks = blocks,
                      .depth_max = 8,
                      .fanout_max = 2,
                      .pages_max = 1,
                      .blocking = blocking,
                      .regular = true};
    made_file_make(&file, &made);
    mni_store_desc desc = {.header = &file.header, .k = k, .prefetch = prefetch};
    size_t need = mni_pool_need(&file.header, k) + mni_board_need(k, 64, 0);
    ck_assert_int_eq(mni_arena_open(&arena, need, NULL), MN_OK);
    mni_board_open(&board, k, 64, 0, &arena);
    mni_pool_open(&pool, &desc, &board, &arena);
    in_use = 0;
    mni_load load;
    mni_report reports[MNI_REPORTS_MAX];
    mni_pool_begin_frame(&pool, reports);
    mni_pool_ask_root(&pool, ref_of(0));
    next_frame();
    mni_command command = fetch(0);
    step(&command, MNI_BEGIN_READ, &load);
    finish(&command, &load);
    ck_assert_int_eq(enter(0), MNI_GRANTED);
    next_frame();
}

static void open_pool_of(uint32_t k) {
    open_pool_as(MN_BLOCKING_LEVELS, 15, MN_PREFETCH_NEIGHBOURS, k);
}

static void open_pool(void) {
    open_pool_of(5);
}

static void close_pool(void) {
    mni_command command;
    while (mni_board_fetch(&board, &command, 1) == 1)
        end(command.kind, MNI_END_GIVEN_UP);
    ck_assert_uint_eq(mni_board_open_commands(&board), 0);
    mni_pool_close(&pool);
    mni_board_close(&board);
    mni_arena_close(&arena);
    made_file_free(&file);
}

/* A block is granted while a prefetch for it has been fetched and not begun: the urgent command
 * finds it there, and pins it. */
START_TEST(a_prefetch_overtakes) {
    open_pool();
    mni_load load;
    mni_command prefetch = fetch(1);
    ck_assert_int_eq(enter(1), MNI_ABSENT);
    next_frame();
    step(&prefetch, MNI_BEGIN_READ, &load);
    mni_command urgent = fetch(1);
    ck_assert_int_eq(urgent.kind, MNI_COMMAND_URGENT_DOWN);
    if (_i == 0) /* while it is being read, or after */
        step(&urgent, MNI_BEGIN_RESIDENT, NULL);
    finish(&prefetch, &load);
    if (_i == 1)
        step(&urgent, MNI_BEGIN_RESIDENT, NULL);
    const mni_holder *holder = &pool.holders.holder[load.slot];
    ck_assert(holder->pinned && !mni_holder_is_evictable(holder));
    ck_assert_int_eq(enter(1), MNI_GRANTED);
    next_frame();
    ck_assert(!holder->pinned); /* used: the grant is over */
    close_pool();
}
END_TEST

/* The place of the block that asked holds another, or another load of the same, or is not in use:
 * nobody wants the prefetch. */
START_TEST(a_prefetch_of_the_past_is_given_up) {
    open_pool();
    mni_load load;
    mni_command prefetch = fetch(1);
    prefetch.sponsor_generation--;
    step(&prefetch, MNI_BEGIN_GIVE_UP, &load);
    close_pool();
}
END_TEST

/* The first read failed and its place is read into again, for the same block: its completion,
 * coming once more, is a bug that is seen. */
START_TEST(a_completion_of_the_past_is_a_bug) {
    open_pool();
    mni_load first, second;
    mni_command prefetch = fetch(1);
    step(&prefetch, MNI_BEGIN_READ, &first);
    mni_pool_failed(&pool, &prefetch, &first, true, "for the test");
    end(prefetch.kind, MNI_END_FAILED);
    for (int frame = 0; frame < 2; frame++)
        next_frame();
    ck_assert_int_eq(enter(1), MNI_ABSENT);
    next_frame();
    mni_command urgent;
    ck_assert(mni_board_fetch(&board, &urgent, 1) == 1);
    step(&urgent, MNI_BEGIN_READ, &second);
    ck_assert_uint_eq(first.slot, second.slot);
    ck_assert_uint_gt(second.generation, first.generation);
    mni_pool_loaded(&pool, &urgent, &first); /* aborts */
}
END_TEST

/* The rules forbid the second block of a chain: the pin of the first goes with the frame. */
START_TEST(a_refused_chain_lets_go) {
    open_pool();
    mni_load load;
    mni_command command = fetch(1);
    ck_assert_int_eq(enter(1), MNI_ABSENT);
    next_frame();
    step(&command, MNI_BEGIN_READ, &load);
    finish(&command, &load);
    const mni_holder *holder = &pool.holders.holder[load.slot];
    command = fetch(1);
    step(&command, MNI_BEGIN_RESIDENT, NULL);
    ck_assert(holder->pinned);
    ck_assert_int_eq(enter(1), MNI_GRANTED);
    in_use = 3; /* of the five: an urgent prefetch needs three that are not */
    ck_assert_int_eq(enter(2), MNI_REFUSED);
    mni_pool_leave(&pool, ref_of(1).id, true);
    next_frame();
    ck_assert(!holder->pinned);
    close_pool();
}
END_TEST

/* Nor is it tried again: what is granted to an attempt takes room that is free once it is refused.
 * Counted as room that others held, it allowed two chains to begin anew and to throw out each
 * other's first block, for ever, under a camera that stood (stress: the Earth, 15 place holders).
 */
START_TEST(a_refused_chain_is_not_allowed_by_its_own_grants) {
    open_pool();
    mni_load load;
    mni_command command = fetch(1);
    ck_assert_int_eq(enter(1), MNI_ABSENT);
    mni_pool_attempt_over(&pool);
    next_frame();
    step(&command, MNI_BEGIN_READ, &load);
    finish(&command, &load);
    command = fetch(1);
    step(&command, MNI_BEGIN_RESIDENT, NULL);
    in_use = 2; /* another block is */
    ck_assert_int_eq(enter(1), MNI_GRANTED);
    ck_assert_int_eq(enter(2), MNI_REFUSED);
    mni_pool_leave(&pool, ref_of(1).id, true);
    next_frame();
    ck_assert_int_eq(mni_pool_room(&pool, 2, 2), 3);
    ck_assert_int_eq(pool.refusal.need, 4);
    close_pool();
}
END_TEST

/* A block that has failed and then come is not known to be bad any more: if it fails again, that is
 * reported, and the waits begin anew. */
START_TEST(a_block_that_comes_is_forgiven) {
    open_pool();
    mni_load load;
    mni_command command = fetch(1);
    step(&command, MNI_BEGIN_READ, &load);
    mni_pool_failed(&pool, &command, &load, true, "for the test");
    end(command.kind, MNI_END_FAILED);
    ck_assert(!mni_failures_due(&pool.failures, ref_of(1).id, pool.frame));
    for (int frame = 0; frame < 2; frame++)
        next_frame();
    ck_assert_int_eq(enter(1), MNI_ABSENT);
    next_frame();
    command = fetch(1);
    step(&command, MNI_BEGIN_READ, &load);
    finish(&command, &load);
    ck_assert(mni_failures_add(&pool.failures, ref_of(1).id, pool.frame));
    close_pool();
}
END_TEST

/* Chunks go while what is left holds what has been granted, and no longer. */
START_TEST(what_is_granted_keeps_its_room) {
    open_pool_of(1030); /* chunks of 512, 512 and 6 */
    uint32_t chunk = 0;
    ck_assert(mni_pool_shrink(&pool, 1000, &chunk));
    ck_assert_uint_eq(chunk, 2);
    ck_assert(!mni_pool_shrink(&pool, 1000, &chunk));
    ck_assert(mni_pool_shrink(&pool, 500, &chunk));
    ck_assert_uint_eq(chunk, 1);
    close_pool();
}
END_TEST

/* In a full pool as many blocks of refused chains are fetched as places are left for what is to
 * come, wherever there is a place, and each once. */
START_TEST(what_is_refused_is_sought) {
    enum { BLOCKS = 127, TO_COME = 2 };
    open_pool_as(MN_BLOCKING_PACKED, BLOCKS, MN_PREFETCH_AHEAD, 16 * TO_COME + 20);
    const uint32_t k = pool.holders.k;
    ck_assert_uint_eq(k - mni_store_k_to_use(&file.header, k, MN_PREFETCH_AHEAD), TO_COME);
    in_use = k - TO_COME;
    mni_refusal refusal[3];
    for (uint32_t i = 0; i < 3; i++) {
        ck_assert_int_eq(enter(1 + i), MNI_REFUSED);
        mni_pool_attempt_over(&pool);
        refusal[i] = pool.refusal;
        ck_assert_uint_eq(refusal[i].block_id, ref_of(1 + i).id);
        ck_assert(mni_pool_seek(&pool, refusal[i].block_id) == (i < TO_COME));
        ck_assert(mni_pool_seek(&pool, refusal[0].block_id) == (i < TO_COME - 1));
    }
    next_frame();
    for (uint32_t i = 0; i < TO_COME; i++) {
        mni_load load;
        mni_command command = fetch(1 + i);
        ck_assert_int_eq(command.kind, MNI_COMMAND_PREFETCH);
        ck_assert_int_eq(command.places, MNI_PLACES_ANY);
        step(&command, MNI_BEGIN_READ, &load);
        finish(&command, &load);
    }
    ck_assert(mni_pool_has(&pool, refusal[0].block_id));
    ck_assert(!mni_pool_has(&pool, refusal[2].block_id));
    in_use = 3;
    ck_assert_int_eq(enter(1), MNI_GRANTED); /* as soon as there is room, without a miss */
    mni_pool_leave(&pool, ref_of(1).id, true);
    close_pool();
}
END_TEST

/* As long as places are plenty, what stands beside an absent block is fetched after it. */
START_TEST(what_stands_beside_is_foreseen) {
    open_pool_as(MN_BLOCKING_PACKED, 127, MN_PREFETCH_AHEAD, 60);
    ck_assert_int_eq(enter(1), MNI_ABSENT);
    next_frame();
    mni_command command = fetch(1);
    ck_assert_int_eq(command.kind, MNI_COMMAND_URGENT_DOWN);
    end(command.kind, MNI_END_GIVEN_UP);
    command = fetch(2);
    ck_assert_int_eq(command.kind, MNI_COMMAND_PREFETCH);
    ck_assert_int_eq(command.places, MNI_PLACES_SPARE);
    end(command.kind, MNI_END_GIVEN_UP);
    close_pool();
}
END_TEST

/* While only what is there has its turn, what is absent is fetched and takes no room; then it is
 * granted as ever. */
START_TEST(what_is_absent_comes_after) {
    open_pool_as(MN_BLOCKING_PACKED, 127, MN_PREFETCH_AHEAD, 60);
    ck_assert(mni_pool_there_only(&pool, true));
    ck_assert_int_eq(enter(1), MNI_ABSENT);
    ck_assert_uint_eq(pool.grants.idle, 0);
    ck_assert(mni_pool_comes(&pool, ref_of(1).id));
    ck_assert(mni_pool_there_only(&pool, false));
    ck_assert(!mni_pool_comes(&pool, ref_of(1).id));
    ck_assert_int_eq(enter(2), MNI_ABSENT);
    ck_assert_uint_eq(pool.grants.idle, 1);
    next_frame();
    mni_command command = fetch(2);
    ck_assert_int_eq(command.kind, MNI_COMMAND_URGENT_DOWN);
    end(command.kind, MNI_END_GIVEN_UP);
    command = fetch(1);
    ck_assert_int_eq(command.kind, MNI_COMMAND_PREFETCH);
    end(command.kind, MNI_END_GIVEN_UP);
    close_pool();
}
END_TEST

/* levels: a switch down counts reads under way as if they had filled their places; it waits, and is
 * not refused, since they will end. */
START_TEST(reads_count_as_taken) {
    open_pool();
    mni_load load[4];
    mni_command command[4];
    for (uint32_t b = 1; b <= 2; b++) {
        command[0] = fetch(b);
        step(&command[0], MNI_BEGIN_READ, &load[0]);
        finish(&command[0], &load[0]);
    }
    ck_assert_int_eq(enter(1), MNI_GRANTED);
    next_frame(); /* its children are asked for, and take the last two places */
    for (int i = 0; i < 2; i++) {
        ck_assert(mni_board_fetch(&board, &command[i], 1) == 1);
        step(&command[i], MNI_BEGIN_READ, &load[i]);
    }
    ck_assert_int_eq(enter(2), MNI_ABSENT);
    ck_assert_uint_gt(mni_pool_waiting(&pool), 0);
    mni_pool_attempt_over(&pool);
    for (int i = 0; i < 2; i++)
        finish(&command[i], &load[i]);
    ck_assert_int_eq(enter(2), MNI_GRANTED);
    close_pool();
}
END_TEST

int main(void) {
    Suite *suite = suite_create("protocol");
    TCase *tests = tcase_create("protocol");
    tcase_add_loop_test(tests, a_prefetch_overtakes, 0, 2);
    tcase_add_test(tests, a_prefetch_of_the_past_is_given_up);
    tcase_add_test_raise_signal(tests, a_completion_of_the_past_is_a_bug, SIGABRT);
    tcase_add_test(tests, a_refused_chain_lets_go);
    tcase_add_test(tests, a_refused_chain_is_not_allowed_by_its_own_grants);
    tcase_add_test(tests, reads_count_as_taken);
    tcase_add_test(tests, a_block_that_comes_is_forgiven);
    tcase_add_test(tests, what_is_granted_keeps_its_room);
    tcase_add_test(tests, what_is_refused_is_sought);
    tcase_add_test(tests, what_stands_beside_is_foreseen);
    tcase_add_test(tests, what_is_absent_comes_after);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
