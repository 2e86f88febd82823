/* What a clock says, in one number. Any thread; never blocks. Source: none. */
#ifndef MNI_CLOCK_H
#define MNI_CLOCK_H

#include <stdint.h>
#include <time.h>

/* Nanoseconds of CLOCK_MONOTONIC, CLOCK_THREAD_CPUTIME_ID or another clock. */
static inline uint64_t mni_clock_ns(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

/* Seconds of the monotonic clock. */
static inline double mni_now_s(void) {
    return 1e-9 * (double)mni_clock_ns(CLOCK_MONOTONIC);
}

/* Seconds of processors that the process has taken, all threads together. */
static inline double mni_cpu_s(void) {
    return 1e-9 * (double)mni_clock_ns(CLOCK_PROCESS_CPUTIME_ID);
}

#endif
