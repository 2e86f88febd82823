/* Mutexes that say how long they were waited for and held.
 *
 * A free lock costs nothing more; a wait reads the clock twice and is the waiting thread's own
 * figure. How long locks are held is measured for threads that ask for it: I/O's, for whose holds
 * Navigate waits. Any thread. */
#ifndef MNI_LOCK_H
#define MNI_LOCK_H

#include <pthread.h>
#include <stdint.h>

#include "metanode/trace.h"

typedef struct mni_lock {
    pthread_mutex_t mutex;
    mn_trace_lock name; /* const; set by its owner after open */
    /* guarded by mutex */
    uint64_t since_ns;    /* taken by a thread that times its holds; 0: by another */
    uint64_t held_ns_max; /* by such threads */
} mni_lock;

typedef struct mni_lock_waits {
    uint64_t count, max_ns;
} mni_lock_waits;

void mni_lock_open(mni_lock *lock);
void mni_lock_close(mni_lock *lock);
void mni_lock_take(mni_lock *lock);
void mni_lock_give(mni_lock *lock);
/* The holds of the calling thread are timed from now on. */
void mni_lock_time_holds(void);
/* The waits of the calling thread, for all locks, since its last call. */
mni_lock_waits mni_lock_waits_since(void);

#endif
