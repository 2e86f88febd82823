/* The pool: the protocol by which Navigate and I/O share K place holders (paper §3.3.2 to 3.3.4,
 * with the repairs of design.md §4).
 *
 * pool.c has what both sides need and what I/O does; pool_navigate.c has what Navigate does: the
 * rules, attempts, grants, the end of a frame. README.md has the life cycles and the lock order.
 *
 * Reference counts count neighbours whose in_use is set, which changes at the end of a frame: so a
 * block that comes into use and goes out of it many times in a frame has its references walked
 * once. During the frame `held` protects whatever was in use at any moment of it.
 *
 * Threads: every function takes pool.lock itself, but those named _locked. None waits for a disk,
 * and under the lock there is no I/O, no allocation and no callback. Memory:
 * from the arena, by K. */
#ifndef MNI_POOL_H
#define MNI_POOL_H

#include "board.h"
#include "failures.h"
#include "freelist.h"
#include "grants.h"
#include "holder.h"
#include "sought.h"
#include "store_kind.h"

enum {
    MNI_REPORTS_MAX = 8,  /* failures told by name between two frames; others are counted */
    MNI_AHEAD_MAX = 512,  /* blocks that a frame may foresee the use of; further ones are not */
    MNI_AHEAD_FRAMES = 4, /* what is foreseen is foreseen again within so many frames, or is not */
};

typedef struct mni_report {
    uint32_t block_id;
    const char *why; /* a literal */
} mni_report;

/* The asks between two leaves: does Navigate's attempt wait, or is it refused? */
typedef struct mni_attempt {
    bool over;       /* something was given back: the next ask begins another */
    bool absent;     /* a block of it is absent */
    bool refused;    /* the rules forbid a block of it */
    uint32_t number; /* from 1 */
    int64_t room;    /* when it began, but for what it had been granted before */
} mni_attempt;

typedef struct mni_pool {
    /* const after open */
    const mn_header *header;
    mni_board *board;
    mn_prefetch prefetch;
    uint32_t kept; /* free places that foresight leaves for what is asked for */
    /* Navigate only */
    uint32_t k_to_use; /* mni_store_k_to_use of those in service */

    mni_lock lock;
    /* guarded by lock */
    bool locked; /* so that functions can assert it */
    mni_holders holders;
    mni_hashmap by_id; /* block id -> slot */
    mni_freelist free;
    mni_grants grants;
    mni_failures failures;
    uint64_t frame;
    uint32_t loading_plain; /* place holders being read into for nobody's grant */
    uint32_t looked_at;     /* by I/O, with nothing else to hold it; MNI_NO_SLOT: none */
    uint32_t hand;          /* where the search for a victim goes on */
    mni_report report[MNI_REPORTS_MAX];
    uint32_t reports;
    mn_session_stats stats;

    /* Navigate only */
    uint32_t *touched; /* slots that came into use or went out of it in this frame */
    uint32_t touched_count;
    mni_attempt attempt;
    mni_refusal refusal;    /* the last one */
    int32_t need_alone;     /* what its block would need by itself */
    uint32_t early;         /* what is asked for is for in so many frames; otherwise 0 */
    bool waits_for_reads;   /* in this frame a switch waited for reads to end */
    uint64_t absent_serial; /* answers "absent" so far */
    uint64_t epoch;
    mni_batch batch;    /* what the end of a frame posts; urgent commands first */
    uint32_t batch_max; /* commands that it may have, besides the room behind */
    mni_command *ahead; /* MNI_AHEAD_MAX: what this frame foresees, each block once */
    uint32_t ahead_count;
    mni_hashmap ahead_by_id;
    bool there_only;       /* what is absent is sought, and not granted */
    mni_sought sought;     /* blocks that somebody was refused for */
    uint32_t sought_count; /* of what this frame foresees: those */
} mni_pool;

size_t mni_pool_need(const mn_header *header, uint32_t k);
/* Prefetches that the board should have room for: more than K at once find no place holder. */
uint32_t mni_pool_prefetches_max(uint32_t k);
void mni_pool_open(mni_pool *pool, const mni_store_desc *desc, mni_board *board, mni_arena *arena);
void mni_pool_close(mni_pool *pool);

/* ---- Navigate ------------------------------------------------------------------------------- */

mni_answer mni_pool_enter(mni_pool *pool, const mni_wish *wish, const void **bytes);
/* gone: the block has left the ancestor table as well. */
void mni_pool_leave(mni_pool *pool, uint32_t block_id, bool gone);
mni_answer mni_pool_overflow(mni_pool *pool, const mni_wish *wish, const void **bytes);
/* What has been asked for was one attempt; what leaves after it, is not given back by it. */
void mni_pool_attempt_over(mni_pool *pool);
/* A node has left a block that stays in use: what is asked for next is another attempt. */
void mni_pool_left(mni_pool *pool);
/* See mni_store_refuse. */
void mni_pool_refuse(mni_pool *pool, const mni_refusal *known, uint32_t table_count,
                     uint32_t in_use);
/* What the rules leave for blocks that are not in use; below 1: nothing; INT32_MAX: a place for
 * each. */
int64_t mni_pool_room(const mni_pool *pool, uint32_t table_count, uint32_t in_use);
/* See mni_store_has_place, of what is not in the ancestor table, and mni_store_no_room. */
bool mni_pool_has_place(const mni_pool *pool, uint32_t block_id);
void mni_pool_no_room(mni_pool *pool, const mni_wish *wish, uint32_t blocks);
/* See mni_store_fill. */
double mni_pool_fill(const mni_pool *pool, uint32_t table_count, uint32_t in_use);
/* Asks for a root block before the first frame; mni_pool_end_frame posts it. */
void mni_pool_ask_root(mni_pool *pool, mn_block_ref ref);
bool mni_pool_has(mni_pool *pool, uint32_t block_id);
/* Is it asked for, and has not failed? */
bool mni_pool_comes(mni_pool *pool, uint32_t block_id);
/* The block, whose parent's block is known, will be wanted in so many frames: it is kept, or
 * fetched when there is a place that nobody needs sooner. Says nothing where prefetches are not by
 * foresight. */
void mni_pool_ahead(mni_pool *pool, mn_block_ref ref, uint32_t parent_id, uint32_t frames);
/* See mni_store_there_only and mni_store_seek. */
bool mni_pool_there_only(mni_pool *pool, bool only);
bool mni_pool_seek(mni_pool *pool, uint32_t block_id);
void mni_pool_note(mni_pool *pool, uint32_t block_id, const mni_note *note);
/* See mni_store_early. */
void mni_pool_early(mni_pool *pool, uint32_t frames);
/* Starts a frame and hands out what failed since the last: at most MNI_REPORTS_MAX. */
uint32_t mni_pool_begin_frame(mni_pool *pool, mni_report report[MNI_REPORTS_MAX]);
/* Within a frame: posts what has been granted. */
void mni_pool_post(mni_pool *pool);
void mni_pool_end_frame(mni_pool *pool);
/* What was answered "absent" in this frame and may be there, or be asked for, in the next. */
uint32_t mni_pool_waiting(mni_pool *pool);
uint32_t mni_pool_resident(mni_pool *pool); /* blocks in real memory */
void mni_pool_stats(mni_pool *pool, mn_session_stats *out);
/* Takes one chunk out of service: false when every chunk holds a block in use, pinned or being
 * read, or when what is left would be too little. *chunk says which. Between frames. */
bool mni_pool_shrink(mni_pool *pool, uint32_t table_count, uint32_t *chunk);
bool mni_pool_retired(mni_pool *pool, uint32_t *chunk); /* finds one that is out of service */
void mni_pool_grow(mni_pool *pool, uint32_t chunk);     /* puts that one back into it */

/* ---- I/O ------------------------------------------------------------------------------------ */

typedef enum mni_begin {
    MNI_BEGIN_READ = 0, /* *load says where to */
    MNI_BEGIN_RESIDENT, /* *load says where, if I/O may look at it until mni_pool_looked */
    MNI_BEGIN_GIVE_UP,
    MNI_BEGIN_WAIT, /* urgent, and no place now: try again when a read has ended */
} mni_begin;
typedef struct mni_load {
    uint32_t slot, generation;
    mn_block_ref ref;
    uint32_t parent_id; /* that the block must name; MN_NONE: any */
    unsigned char *bytes;
    uint32_t chunk;
    bool last_empty;     /* no place that no block has been in was left */
    uint32_t read_bytes; /* so far, some of it perhaps twice; I/O counts */
} mni_load;
/* Is the block there, or on its way? Then it is kept. */
bool mni_pool_foresees(mni_pool *pool, uint32_t block_id);
/* Decides about a command: finds its block, or takes a place for it. Check and eviction are one
 * critical section. may_wait: reads are in flight, so that WAIT can end. */
mni_begin mni_pool_begin(mni_pool *pool, const mni_command *command, bool may_wait, mni_load *load);
/* What a look has led to is no longer looked at. */
void mni_pool_looked(mni_pool *pool);
void mni_pool_loaded(mni_pool *pool, const mni_command *command, const mni_load *load);
/* io: the disk's fault, otherwise the block's. why: a literal. */
void mni_pool_failed(mni_pool *pool, const mni_command *command, const mni_load *load, bool io,
                     const char *why);

/* ---- both ----------------------------------------------------------------------------------- */

void mni_pool_lock(mni_pool *pool);
void mni_pool_unlock(mni_pool *pool);
/* Unpins or pins what a grant is for. */
void mni_pool_pin_locked(mni_pool *pool, uint32_t slot, bool pinned);
/* From the free list to real memory, if that is where it is. */
void mni_pool_rescue_locked(mni_pool *pool, uint32_t slot);
/* To the end of the free list when nothing holds it any more. */
void mni_pool_release_locked(mni_pool *pool, uint32_t slot);
/* Its use is foreseen: of the free list it becomes the last. */
void mni_pool_foresee_locked(mni_pool *pool, uint32_t slot);
/* Throws a block out of a place holder that is being taken; it is on no list and in no table then.
 */
void mni_pool_forget_locked(mni_pool *pool, uint32_t slot);
/* All equations of the pool, by full recount; see store.h. */
void mni_pool_check(mni_pool *pool, mni_usage_of usage_of, const void *context);

#endif
