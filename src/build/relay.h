/* Records handed to a thread beside the caller's, which works on them in their order.
 *
 *   open ── put × n ── drain ── (put × n ── drain ─ …) close
 *
 * What comes of it is the same with a thread and without one: batches follow each other, and one
 * call works on one batch. The worker must not touch what the caller does meanwhile, nor hand on
 * failures before the caller has drained. Memory: the caller's buffer, and a thread's stack. */
#ifndef MNI_RELAY_H
#define MNI_RELAY_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { MNI_RELAY_BATCHES = 3 }; /* one is filled, one in work, one between them */

/* context: as given to open; so many records, which may be changed. */
typedef void (*mni_relay_work)(void *context, void *records, uint32_t count);

typedef struct mni_relay {
    /* const after open */
    mni_relay_work work;
    void *context;
    unsigned char *batch[MNI_RELAY_BATCHES];
    uint32_t record_bytes, batch_records;
    bool threaded;
    pthread_t thread;
    /* the caller's */
    unsigned char *filling;
    uint32_t filled;
    /* batches that are posted and not done are the thread's, the others the caller's */
    uint32_t count[MNI_RELAY_BATCHES];
    pthread_mutex_t lock;
    pthread_cond_t change;
    /* guarded by lock */
    uint64_t posted, done;
    bool stop;
} mni_relay;

/* buffer: room for MNI_RELAY_BATCHES records at least, aligned as these are; until close. threads:
 * 1, or more for one beside the caller's; where there can be none, the caller does it all. */
void mni_relay_open(mni_relay *relay, mni_relay_work work, void *context, size_t record_bytes,
                    void *buffer, size_t buffer_bytes, uint32_t threads);
/* Hands over the batch that has been filled. */
void mni_relay_post(mni_relay *relay);
/* Copies the record. May wait for the worker. */
static inline void mni_relay_put(mni_relay *relay, const void *record) {
    memcpy(relay->filling + (size_t)relay->filled * relay->record_bytes, record,
           relay->record_bytes);
    if (++relay->filled == relay->batch_records)
        mni_relay_post(relay);
}
/* Until all is done: from then on the caller may look at what the worker has done. */
void mni_relay_drain(mni_relay *relay);
/* Drains first. */
void mni_relay_close(mni_relay *relay);

#endif
