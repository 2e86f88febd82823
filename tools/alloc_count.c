/* Counts every allocation of the process, its libraries' included, so that "nothing is allocated
 * after the seal" is measured and not promised. malloc and its kin are ours by name and hand over
 * to glibc's own; under a sanitizer the file is empty, since malloc is the sanitizer's there.
 *
 * A GL driver allocates as it likes, on the main thread and on threads of its own, while our I/O
 * thread runs. Whose an allocation is: of the main thread, by whether it is inside the module; of
 * another, by whether that was there before the module was. Any thread. */
#define _GNU_SOURCE /* gettid */
#include "cli.h"

#include <dirent.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdlib.h>
#include <unistd.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || !defined(__GLIBC__)
#define COUNT_ALLOCATIONS 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define COUNT_ALLOCATIONS 0
#endif
#endif
#ifndef COUNT_ALLOCATIONS
#define COUNT_ALLOCATIONS 1
#endif

typedef enum owner { OURS, THEIRS, OWNERS } owner;

enum {
    OWN_THREADS_MAX = 256
}; /* two or three, and the kernel's, of io_uring, which allocate nothing */

static _Atomic uint64_t allocations[OWNERS];
static uint64_t marked[OWNERS];
static pid_t own_thread[OWN_THREADS_MAX]; /* const once own_threads is above 0 */
static _Atomic uint32_t own_threads;      /* 0: there is no module, and all threads are ours */
static _Thread_local bool is_known, is_theirs;

#if COUNT_ALLOCATIONS
static void know_thread(uint32_t threads) {
    const pid_t self = gettid();
    is_known = is_theirs = true;
    for (uint32_t i = 0; i < threads && is_theirs; i++)
        is_theirs = own_thread[i] != self;
}

static void count_one(void) {
    const uint32_t threads = atomic_load_explicit(&own_threads, memory_order_acquire);
    if (!is_known && threads > 0)
        know_thread(threads);
    atomic_fetch_add_explicit(&allocations[is_theirs ? THEIRS : OURS], 1, memory_order_relaxed);
}

void *__libc_malloc(size_t bytes);
void *__libc_calloc(size_t count, size_t bytes);
void *__libc_realloc(void *old, size_t bytes);
void *__libc_memalign(size_t align, size_t bytes);

void *malloc(size_t bytes) {
    count_one();
    return __libc_malloc(bytes);
}

void *calloc(size_t count, size_t bytes) {
    count_one();
    return __libc_calloc(count, bytes);
}

void *realloc(void *old, size_t bytes) {
    count_one();
    return __libc_realloc(old, bytes);
}

void *memalign(size_t align, size_t bytes);
void *memalign(size_t align, size_t bytes) {
    count_one();
    return __libc_memalign(align, bytes);
}

void *aligned_alloc(size_t align, size_t bytes) {
    return memalign(align, bytes);
}

int posix_memalign(void **out, size_t align, size_t bytes);
int posix_memalign(void **out, size_t align, size_t bytes) {
    *out = memalign(align, bytes);
    return *out != NULL ? 0 : 12; /* ENOMEM */
}
#endif

void cli_alloc_threads_are_ours(void) {
    uint32_t threads = 0;
    if (atomic_load(&own_threads) > 0)
        return;
    DIR *list = opendir("/proc/self/task");
    const struct dirent *entry;
    while (list != NULL && threads < OWN_THREADS_MAX && (entry = readdir(list)) != NULL)
        if (entry->d_name[0] != '.')
            own_thread[threads++] = (pid_t)strtol(entry->d_name, NULL, 10);
    if (list != NULL)
        closedir(list);
    is_known = true;
    atomic_store_explicit(&own_threads, threads, memory_order_release);
}

void cli_alloc_theirs(bool inside) {
    is_theirs = inside;
}

void cli_alloc_mark(void) {
    for (int i = 0; i < OWNERS; i++)
        marked[i] = atomic_load(&allocations[i]);
}

uint64_t cli_alloc_since_mark(void) {
    return atomic_load(&allocations[OURS]) - marked[OURS];
}

uint64_t cli_alloc_theirs_since_mark(void) {
    return atomic_load(&allocations[THEIRS]) - marked[THEIRS];
}
