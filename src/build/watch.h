/* Telling whoever watches how far long work has come. Any thread. */
#ifndef MNI_WATCH_H
#define MNI_WATCH_H

#include "metanode/build.h"

/* MN_FAILED: the work is to stop. watch may be NULL. */
static inline mn_code mni_watch(const mn_watch *watch, const char *phase, uint64_t done,
                                uint64_t total, mn_status *st) {
    if (watch == NULL || watch->progress == NULL ||
        watch->progress(watch->context, phase, done, total))
        return MN_OK;
    return mn_fail(st, MN_FAILED, "interrupted");
}

/* The same where `done` goes up by ones: every 65,536th time. */
static inline mn_code mni_watch_each(const mn_watch *watch, const char *phase, uint64_t done,
                                     uint64_t total, mn_status *st) {
    return done % 65536 == 0 ? mni_watch(watch, phase, done, total, st) : MN_OK;
}

#endif
