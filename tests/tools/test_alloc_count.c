/* Goal: an allocation is ours, or the GL module's, by the thread that makes it and, on the main
 * thread, by where that is; none is missed.
 * Method: a thread from before the module, one from after it, and the main thread in and out. */
#include <pthread.h>
#include <semaphore.h>
#include <stdlib.h>

#include "cli.h"
#include "suite.h"

#ifdef __SANITIZE_ADDRESS__
#define COUNTED 0
#elif defined(__SANITIZE_THREAD__)
#define COUNTED 0
#else
#define COUNTED 1
#endif

typedef struct worker {
    pthread_t thread;
    sem_t go;
    int calls;
} worker;

/* Through a pointer that may change: a pair of malloc and free is otherwise left out. */
static void *(*volatile take)(size_t) = malloc;

static void allocate(int calls) {
    for (int i = 0; i < calls; i++)
        free(take(16));
}

static void *work(void *context) {
    worker *w = context;
    while (sem_wait(&w->go) != 0)
        continue;
    allocate(w->calls);
    return NULL;
}

static void start(worker *w, int calls) {
    w->calls = calls;
    ck_assert_int_eq(sem_init(&w->go, 0, 0), 0);
    ck_assert_int_eq(pthread_create(&w->thread, NULL, work, w), 0);
}

/* Without an assertion, as those allocate: what is counted is compared when all is done. */
static int finish(worker *w) {
    const int error = sem_post(&w->go) != 0 ? -1 : pthread_join(w->thread, NULL);
    sem_destroy(&w->go);
    return error;
}

START_TEST(without_a_module_all_are_ours) {
    worker w;
    start(&w, 5);
    cli_alloc_mark();
    const int error = finish(&w);
    allocate(3);
    const uint64_t ours = cli_alloc_since_mark();
    ck_assert_int_eq(error, 0);
    ck_assert_uint_eq(ours, COUNTED * 8);
    ck_assert_uint_eq(cli_alloc_theirs_since_mark(), 0);
}
END_TEST

START_TEST(whose_it_is) {
    worker before, after;
    start(&before, 5);
    cli_alloc_threads_are_ours();
    cli_alloc_theirs(true);
    start(&after, 7);
    cli_alloc_theirs(false);
    cli_alloc_mark();
    int error = finish(&before);
    const uint64_t of_before = cli_alloc_since_mark();
    error |= finish(&after);
    const uint64_t of_after = cli_alloc_theirs_since_mark();
    cli_alloc_theirs(true);
    allocate(11);
    cli_alloc_theirs(false);
    allocate(3);
    const uint64_t ours = cli_alloc_since_mark();
    ck_assert_int_eq(error, 0);
    ck_assert_uint_eq(of_before, COUNTED * 5);
    ck_assert_uint_eq(of_after, COUNTED * 7);
    ck_assert_uint_eq(ours, COUNTED * 8);
    ck_assert_uint_eq(cli_alloc_theirs_since_mark(), COUNTED * 18);
}
END_TEST

START_TEST(every_way_to_allocate) {
    void *aligned = NULL;
    cli_alloc_mark();
    void *volatile p = realloc(calloc(1, 16), 32);
    void *volatile q = aligned_alloc(64, 64);
    const int error = posix_memalign(&aligned, 64, 64);
    const uint64_t ours = cli_alloc_since_mark();
    ck_assert_int_eq(error, 0);
    ck_assert_uint_eq(ours, COUNTED * 4);
    free(p);
    free(q);
    free(aligned);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("alloc_count");
    TCase *tests = tcase_create("owners");
    tcase_add_test(tests, without_a_module_all_are_ours);
    tcase_add_test(tests, whose_it_is);
    tcase_add_test(tests, every_way_to_allocate);
    suite_add_tcase(suite, tests);
    return suite_run_as(suite, CK_FORK); /* whose threads are is told once a process */
}
