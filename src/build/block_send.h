/* Blocks that have their places: encoded, sealed, checked as a reader does, and written.
 *
 *   open ── { job, fill it in, post } … ── drain ── close
 *
 * In the caller's thread, or in one beside it, which takes what is posted in its order; the bytes
 * are the same. The packer's thread makes the calls. */
#ifndef MNI_BLOCK_SEND_H
#define MNI_BLOCK_SEND_H

#include <pthread.h>

#include "file.h"
#include "frame.h"
#include "plan.h"

typedef struct mni_job {
    mn_block_ref place;
    uint32_t parent_id, payload_bytes;
    uint64_t file_bytes; /* of what has been given away so far */
    mni_tally tally;
    const mni_exit *exit; /* whole subtrees: their roots; NULL: draft's block */
    uint32_t exits;
    const mni_draft *draft;
    const mn_block_ref *ref; /* to its child blocks, then from first_overflow on to others */
    uint32_t refs, first_overflow;
} mni_job;

/* What a job that waits needs is copied. */
typedef struct mni_kept_job {
    mni_job job;
    mni_exit *exit;
    mn_block_ref *ref;
    uint32_t exits_capacity, refs_capacity;
} mni_kept_job;
enum {
    MNI_JOBS = 16,       /* that wait or are in work, at most */
    MNI_JOBS_DRAFTS = 3, /* of them with a draft, which are the largest */
};

typedef struct mni_sender {
    /* const after open */
    mni_out *out;
    uint64_t build_id;
    mni_block_limits limits;
    bool threaded;
    pthread_t thread;
    /* who sends: the thread; the caller where there is none, or after drain */
    mni_plan plan;
    mn_status trouble; /* of the plan */
    mni_rows_run run;
    unsigned char *bytes;
    uint32_t bytes_capacity;
    /* slots that are posted and not done belong to the thread, the others to the caller */
    mni_kept_job kept[MNI_JOBS];
    mni_draft draft[MNI_JOBS_DRAFTS]; /* in turn; with the last job that has it */
    /* the caller's */
    uint64_t draft_free[MNI_JOBS_DRAFTS]; /* when so many jobs are done */
    uint32_t drafts;
    pthread_mutex_t lock;
    pthread_cond_t change;
    /* guarded by lock */
    uint64_t posted, done;
    bool stop, failed;
} mni_sender;

/* like: the packer's plan. threads: 1, or more for one beside the caller's. */
mn_code mni_sender_open(mni_sender *sender, const mni_plan *like, mni_out *out,
                        const mn_header *header, uint32_t threads, mn_status *st);
/* Sends the block, or sees to it that it will be; waits for room. What it points to may change
 * after the call. false: that, or a block before it, has failed: drain tells. */
bool mni_sender_post(mni_sender *sender, const mni_job *job);
/* Waits until all is written. The first failure. */
mn_code mni_sender_drain(mni_sender *sender, mn_status *st);
/* Of a drained one: a piece of a node's overflow, in the caller's thread. next: where it goes on.
 */
mn_code mni_sender_overflow(mni_sender *sender, const mni_job *job, const mni_known *node,
                            const mni_piece *piece, mni_row_simplex *room);
/* What the blocks hold. After drain. */
static inline const mni_found *mni_sender_found(const mni_sender *sender) {
    return &sender->plan.found;
}
/* Harmless on a zeroed one. */
void mni_sender_close(mni_sender *sender);

#endif
