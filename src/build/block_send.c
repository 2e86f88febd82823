/* From jobs to bytes in the file, beside the packing of the next blocks.
 *
 * Hides: the thread, and what it needs copies of. Jobs stand in a ring; the caller waits for room,
 * the thread for work:
 *
 *     done ──► [ in work | waits | waits ] ◄── posted        at most MNI_JOBS
 *
 * After a failure the jobs that follow are passed over, so what is told is the first failure in the
 * order of the jobs, however the threads ran.
 * Order: open, post and drain, close. Threads: the caller's and one of its own. Memory: three
 * drafts of a block, a few roots, a block, a subtree's rows. Paper: none. */
#include "block_send.h"

#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"

/* ---- sending -------------------------------------------------------------------------------- */

static mn_code need_bytes(mni_sender *s, uint32_t length) {
    if (!mni_plan_room((void **)&s->bytes, length, &s->bytes_capacity, 1))
        return mn_fail(s->plan.st, MN_FAILED, "no memory for a block of %u bytes", length);
    return MN_OK;
}

/* Seals the encoded block, checks it, writes it. */
static mn_code write_block(mni_sender *s, const mni_job *job, mni_frame_kind kind) {
    const uint32_t length = job->place.pages * MN_PAGE_BYTES;
    const mni_frame frame = {.kind = kind,
                             .refs = job->refs,
                             .payload_bytes = job->payload_bytes,
                             .parent_id = job->parent_id};
    for (uint32_t r = 0; r < job->refs; r++)
        mni_frame_set_ref(s->bytes, r, job->ref[r]);
    mni_frame_seal(s->bytes, &frame, job->place, s->build_id);
    mni_block_limits limits = s->limits;
    limits.file_bytes = job->file_bytes;
    char why[160] = "its frame is wrong";
    mni_block view;
    mni_overflow overflow;
    bool sound =
        mni_frame_check(s->bytes, job->place, s->build_id, limits.file_bytes) == MNI_FRAME_OK &&
        (kind == MNI_FRAME_OVERFLOW
             ? mni_overflow_open(&overflow, s->bytes, length, &limits, why, sizeof why)
             : mni_block_open(&view, s->bytes, length, &limits, why, sizeof why));
    if (!sound)
        return mn_fail(s->plan.st, MN_FAILED, "bug: block %u would not be readable: %s",
                       job->place.id, why);
    return mni_out_write_at(s->out, (uint64_t)job->place.id * MN_PAGE_BYTES, s->bytes, length,
                            s->plan.st);
}

static mn_code send(mni_sender *s, const mni_job *job) {
    const uint32_t length = job->place.pages * MN_PAGE_BYTES;
    mn_code code = need_bytes(s, length);
    if (code != MN_OK)
        return code;
    code = job->exit != NULL ? mni_whole_encode(&s->plan, job->exit, job->exits, &job->tally,
                                                &s->run, s->bytes, length)
                             : mni_draft_encode(&s->plan, job->draft, &job->tally, job->refs,
                                                job->first_overflow, s->bytes, length);
    return code == MN_OK ? write_block(s, job, MNI_FRAME_METANODE) : code;
}

mn_code mni_sender_overflow(mni_sender *s, const mni_job *job, const mni_known *node,
                            const mni_piece *piece, mni_row_simplex *room) {
    const uint32_t length = job->place.pages * MN_PAGE_BYTES;
    mn_code code = need_bytes(s, length);
    if (code == MN_OK)
        code = mni_piece_encode(&s->plan, node, piece, room, s->bytes, length);
    return code == MN_OK ? write_block(s, job, MNI_FRAME_OVERFLOW) : code;
}

/* ---- the ring ------------------------------------------------------------------------------- */

/* draft: for the job's, where it has one. */
static bool keep(const mni_job *job, mni_kept_job *kept, mni_draft *draft) {
    kept->job = *job;
    if (!mni_plan_room((void **)&kept->ref, job->refs, &kept->refs_capacity, sizeof *kept->ref))
        return false;
    if (job->refs > 0)
        memcpy(kept->ref, job->ref, sizeof *kept->ref * job->refs);
    kept->job.ref = kept->ref;
    if (job->exit == NULL) {
        kept->job.draft = draft;
        return mni_draft_copy_block(job->draft, draft);
    }
    if (!mni_plan_room((void **)&kept->exit, job->exits, &kept->exits_capacity, sizeof *kept->exit))
        return false;
    memcpy(kept->exit, job->exit, sizeof *kept->exit * job->exits);
    kept->job.exit = kept->exit;
    return true;
}

static void *run_thread(void *context) {
    mni_sender *s = context;
    pthread_mutex_lock(&s->lock);
    for (;;) {
        while (s->done == s->posted && !s->stop)
            pthread_cond_wait(&s->change, &s->lock);
        if (s->done == s->posted)
            break;
        const mni_kept_job *kept = &s->kept[s->done % MNI_JOBS];
        bool passed_over = s->failed;
        pthread_mutex_unlock(&s->lock);
        mn_code code = passed_over ? MN_OK : send(s, &kept->job);
        pthread_mutex_lock(&s->lock);
        s->failed |= code != MN_OK;
        s->done++;
        pthread_cond_broadcast(&s->change);
    }
    pthread_mutex_unlock(&s->lock);
    return NULL;
}

bool mni_sender_post(mni_sender *s, const mni_job *job) {
    if (!s->threaded) {
        s->failed = s->failed || send(s, job) != MN_OK;
        return !s->failed;
    }
    const uint32_t d = s->drafts % MNI_JOBS_DRAFTS;
    const uint64_t free_at = job->exit == NULL ? s->draft_free[d] : 0;
    pthread_mutex_lock(&s->lock);
    while (s->posted - s->done == MNI_JOBS || s->done < free_at)
        pthread_cond_wait(&s->change, &s->lock);
    bool failed = s->failed;
    pthread_mutex_unlock(&s->lock);
    if (failed)
        return false;
    bool kept = keep(job, &s->kept[s->posted % MNI_JOBS], &s->draft[d]); /* posted: changed here */
    pthread_mutex_lock(&s->lock);
    if (kept)
        s->posted++;
    pthread_cond_broadcast(&s->change);
    pthread_mutex_unlock(&s->lock);
    if (kept && job->exit == NULL) {
        s->draft_free[d] = s->posted;
        s->drafts++;
    }
    return kept;
}

mn_code mni_sender_drain(mni_sender *s, mn_status *st) {
    if (s->threaded) {
        pthread_mutex_lock(&s->lock);
        while (s->done < s->posted)
            pthread_cond_wait(&s->change, &s->lock);
        pthread_mutex_unlock(&s->lock);
    }
    return s->trouble.code == MN_OK ? MN_OK : mn_fail(st, s->trouble.code, "%s", s->trouble.text);
}

/* ---- open and close ------------------------------------------------------------------------- */

mn_code mni_sender_open(mni_sender *s, const mni_plan *like, mni_out *out, const mn_header *header,
                        uint32_t threads, mn_status *st) {
    *s = (mni_sender){
        .out = out, .build_id = header->build_id, .limits = mni_block_limits_of(header)};
    mn_code code = mni_plan_open(&s->plan, like->head, like->rows, like->desc, st);
    s->plan.st = &s->trouble;
    if (code != MN_OK || threads < 2)
        return code;
    pthread_mutex_init(&s->lock, NULL);
    pthread_cond_init(&s->change, NULL);
    s->threaded = pthread_create(&s->thread, NULL, run_thread, s) == 0; /* or without */
    return MN_OK;
}

void mni_sender_close(mni_sender *s) {
    if (s->threaded) {
        pthread_mutex_lock(&s->lock);
        s->stop = true;
        pthread_cond_broadcast(&s->change);
        pthread_mutex_unlock(&s->lock);
        pthread_join(s->thread, NULL);
        pthread_cond_destroy(&s->change);
        pthread_mutex_destroy(&s->lock);
    }
    for (uint32_t k = 0; k < MNI_JOBS; k++) {
        free(s->kept[k].exit);
        free(s->kept[k].ref);
    }
    for (uint32_t d = 0; d < MNI_JOBS_DRAFTS; d++)
        mni_draft_free(&s->draft[d]);
    free(s->bytes);
    mni_rows_run_free(&s->run);
    mni_plan_close(&s->plan);
    s->threaded = false;
}
