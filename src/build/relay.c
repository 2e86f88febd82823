/* See relay.h. Hidden here: the ring of batches.
 *
 *     done ──► [ in work | waits | is filled ] ◄── posted
 *
 * Threads: the caller's and one of its own, or the caller's alone. Memory: none. Paper: none. */
#include "relay.h"

#include "mn_assert.h"

static void *run_thread(void *context) {
    mni_relay *r = context;
    pthread_mutex_lock(&r->lock);
    for (;;) {
        while (r->done == r->posted && !r->stop)
            pthread_cond_wait(&r->change, &r->lock);
        if (r->done == r->posted)
            break;
        const uint32_t at = (uint32_t)(r->done % MNI_RELAY_BATCHES);
        pthread_mutex_unlock(&r->lock);
        r->work(r->context, r->batch[at], r->count[at]);
        pthread_mutex_lock(&r->lock);
        r->done++;
        pthread_cond_broadcast(&r->change);
    }
    pthread_mutex_unlock(&r->lock);
    return NULL;
}

void mni_relay_open(mni_relay *relay, mni_relay_work work, void *context, size_t record_bytes,
                    void *buffer, size_t buffer_bytes, uint32_t threads) {
    const size_t records = buffer_bytes / MNI_RELAY_BATCHES / record_bytes;
    MN_ASSERT(records > 0 && records <= UINT32_MAX);
    *relay = (mni_relay){.work = work,
                         .context = context,
                         .record_bytes = (uint32_t)record_bytes,
                         .batch_records = (uint32_t)records};
    for (uint32_t i = 0; i < MNI_RELAY_BATCHES; i++)
        relay->batch[i] = (unsigned char *)buffer + i * records * record_bytes;
    relay->filling = relay->batch[0];
    if (threads < 2)
        return;
    pthread_mutex_init(&relay->lock, NULL);
    pthread_cond_init(&relay->change, NULL);
    relay->threaded = pthread_create(&relay->thread, NULL, run_thread, relay) == 0; /* or without */
    if (relay->threaded)
        return;
    pthread_cond_destroy(&relay->change);
    pthread_mutex_destroy(&relay->lock);
}

void mni_relay_post(mni_relay *relay) {
    const uint32_t filled = relay->filled;
    relay->filled = 0;
    if (!relay->threaded) {
        relay->work(relay->context, relay->filling, filled);
        return;
    }
    pthread_mutex_lock(&relay->lock);
    relay->count[relay->posted++ % MNI_RELAY_BATCHES] = filled;
    pthread_cond_broadcast(&relay->change);
    while (relay->posted - relay->done == MNI_RELAY_BATCHES)
        pthread_cond_wait(&relay->change, &relay->lock);
    relay->filling = relay->batch[relay->posted % MNI_RELAY_BATCHES];
    pthread_mutex_unlock(&relay->lock);
}

void mni_relay_drain(mni_relay *relay) {
    if (relay->filled > 0)
        mni_relay_post(relay);
    if (!relay->threaded)
        return;
    pthread_mutex_lock(&relay->lock);
    while (relay->done < relay->posted)
        pthread_cond_wait(&relay->change, &relay->lock);
    pthread_mutex_unlock(&relay->lock);
}

void mni_relay_close(mni_relay *relay) {
    mni_relay_drain(relay);
    if (!relay->threaded)
        return;
    pthread_mutex_lock(&relay->lock);
    relay->stop = true;
    pthread_cond_broadcast(&relay->change);
    pthread_mutex_unlock(&relay->lock);
    pthread_join(relay->thread, NULL);
    pthread_cond_destroy(&relay->change);
    pthread_mutex_destroy(&relay->lock);
}
