/* Assertions: a failed one is a bug of ours, never of the input. */
#ifndef MNI_ASSERT_H
#define MNI_ASSERT_H

#include <stdio.h>
#include <stdlib.h>

/* Always on. */
#define MN_ASSERT(condition)                                                                       \
    do {                                                                                           \
        if (__builtin_expect(!(condition), 0)) {                                                   \
            fprintf(stderr, "metanode: bug: %s:%d: %s: %s\n", __FILE__, __LINE__, __func__,        \
                    #condition);                                                                   \
            abort();                                                                               \
        }                                                                                          \
    } while (0)

/* O(n) recounts: debug builds and tests (meson -Dslow_checks=true). */
#ifdef MN_SLOW_CHECKS
#define MN_ASSERT_SLOW(condition) MN_ASSERT(condition)
#else
#define MN_ASSERT_SLOW(condition) ((void)sizeof(condition))
#endif

#endif
