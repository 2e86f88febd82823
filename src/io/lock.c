/* Mutexes that say how long they were waited for and held. See lock.h.
 *
 * Hides: where the figures are kept: of waits with the thread, of holds with the lock. Order: open,
 * then take and give in pairs, close. No memory but the lock's. Paper: none. */
#define _GNU_SOURCE
#include "lock.h"

#include <stdbool.h>

#include "mn_assert.h"
#include "clock.h"
#include "trace.h"

enum { SPIN_NS = 50 * 1000 };

static _Thread_local mni_lock_waits waits;
static _Thread_local bool times_holds;

void mni_lock_open(mni_lock *lock) {
    lock->name = 0;
    lock->since_ns = lock->held_ns_max = 0;
    MN_ASSERT(pthread_mutex_init(&lock->mutex, NULL) == 0);
}

void mni_lock_close(mni_lock *lock) {
    pthread_mutex_destroy(&lock->mutex);
}

static void pause_a_little(void) {
    for (int i = 0; i < 32; i++)
#if defined(__x86_64__)
        __builtin_ia32_pause();
#else
        __asm__ volatile("" ::: "memory");
#endif
}

/* Falling asleep and being woken takes longer than any hold does, an interrupt in the middle of it
 * included; who sleeps nevertheless waits for one that has been put aside. Returns for how long. */
static uint64_t wait_for(mni_lock *lock) {
    const uint64_t from_ns = mni_clock_ns(CLOCK_MONOTONIC);
    uint64_t waited_ns = 0;
    while (waited_ns < SPIN_NS && pthread_mutex_trylock(&lock->mutex) != 0) {
        pause_a_little();
        waited_ns = mni_clock_ns(CLOCK_MONOTONIC) - from_ns;
    }
    if (waited_ns < SPIN_NS)
        return waited_ns;
    pthread_mutex_lock(&lock->mutex);
    return mni_clock_ns(CLOCK_MONOTONIC) - from_ns;
}

void mni_lock_take(mni_lock *lock) {
    if (pthread_mutex_trylock(&lock->mutex) != 0) {
        const uint64_t waited_ns = wait_for(lock);
        waits.count++;
        waits.max_ns = waited_ns > waits.max_ns ? waited_ns : waits.max_ns;
        MNI_TRACE(MN_TRACE_LOCK_WAIT, lock->name, (uint32_t)waited_ns, (uint32_t)(waited_ns >> 32));
    }
    lock->since_ns = times_holds ? mni_clock_ns(CLOCK_MONOTONIC) : 0;
}

void mni_lock_give(mni_lock *lock) {
    if (lock->since_ns != 0) {
        uint64_t held_ns = mni_clock_ns(CLOCK_MONOTONIC) - lock->since_ns;
        lock->held_ns_max = held_ns > lock->held_ns_max ? held_ns : lock->held_ns_max;
        lock->since_ns = 0; /* who gets it from a condition has not come through take */
    }
    pthread_mutex_unlock(&lock->mutex);
}

void mni_lock_time_holds(void) {
    times_holds = true;
}

mni_lock_waits mni_lock_waits_since(void) {
    mni_lock_waits since = waits;
    waits = (mni_lock_waits){0, 0};
    return since;
}
