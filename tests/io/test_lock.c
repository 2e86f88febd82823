/* Goal: a wait is counted where it was waited, a hold where it was timed, and neither without
 * cause. Method: one thread holds a lock for a while that the other must wait out; then many short
 * holds. */
#include <check.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <time.h>

#include "lock.h"
#include "suite.h"

enum { PAUSE_NS = 5000000, ROUNDS = 20000 };

static mni_lock lock;
static atomic_bool taken;
static uint32_t sum; /* guarded by lock */

static void *hold_a_while(void *timed) {
    if (*(const bool *)timed)
        mni_lock_time_holds();
    mni_lock_take(&lock);
    atomic_store(&taken, true);
    struct timespec pause = {.tv_nsec = PAUSE_NS};
    nanosleep(&pause, NULL);
    mni_lock_give(&lock);
    ck_assert_uint_eq(mni_lock_waits_since().count, 0);
    return NULL;
}

START_TEST(a_wait_and_a_hold_are_counted) {
    bool timed = _i == 1;
    pthread_t thread;
    mni_lock_open(&lock);
    atomic_store(&taken, false);
    (void)mni_lock_waits_since();
    ck_assert_int_eq(pthread_create(&thread, NULL, hold_a_while, &timed), 0);
    while (!atomic_load(&taken)) {
    }
    mni_lock_take(&lock); /* may come after the pause on a busy machine: then it did not wait */
    uint64_t held_ns = lock.held_ns_max;
    mni_lock_give(&lock);
    pthread_join(thread, NULL);
    mni_lock_waits waits = mni_lock_waits_since();
    ck_assert_uint_le(waits.count, 1);
    ck_assert(waits.count == 1 || waits.max_ns == 0);
    ck_assert(timed ? held_ns >= PAUSE_NS : held_ns == 0);
    waits = mni_lock_waits_since();
    ck_assert(waits.count == 0 && waits.max_ns == 0);
    mni_lock_close(&lock);
}
END_TEST

START_TEST(a_free_lock_is_not_waited_for) {
    mni_lock_open(&lock);
    (void)mni_lock_waits_since();
    for (uint32_t i = 0; i < ROUNDS; i++) {
        mni_lock_take(&lock);
        mni_lock_give(&lock);
    }
    ck_assert_uint_eq(mni_lock_waits_since().count, 0);
    ck_assert_uint_eq(lock.held_ns_max, 0);
    mni_lock_close(&lock);
}
END_TEST

static void *add_up(void *unused) {
    for (uint32_t i = 0; i < ROUNDS; i++) {
        mni_lock_take(&lock);
        sum++;
        mni_lock_give(&lock);
    }
    return unused;
}

START_TEST(it_excludes) {
    pthread_t thread;
    mni_lock_open(&lock);
    sum = 0;
    ck_assert_int_eq(pthread_create(&thread, NULL, add_up, NULL), 0);
    add_up(NULL);
    pthread_join(thread, NULL);
    ck_assert_uint_eq(sum, 2 * ROUNDS);
    mni_lock_close(&lock);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("lock");
    TCase *tests = tcase_create("lock");
    tcase_add_loop_test(tests, a_wait_and_a_hold_are_counted, 0, 2);
    tcase_add_test(tests, a_free_lock_is_not_waited_for);
    tcase_add_test(tests, it_excludes);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
