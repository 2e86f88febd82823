/* The blocks that Navigate uses: the ancestor table, and behind it one of three stores.
 *
 * Navigate splits and collapses; the store says which blocks may be touched, keeps them there while
 * they are, and fetches the others. It knows frames (frame.h: who a block refers to), never what is
 * inside a block. `paged` is the pool of the paper (§3.3.2 to 3.3.4) with the three repairs of
 * design.md §4; `mapped` leaves it to the operating system; `resident` reads all at start.
 *
 * Entries: the ancestor table holds every block in use and all its ancestors. An entry exists while
 * its usage (active nodes in the block) is above 0 or another entry has it as its parent. Its index
 * is stable while it exists. Bytes are valid while its usage is above 0.
 *
 *      root block ── entry 0, usage 0, 2 children       (an ancestor: bytes may be gone)
 *        ├─ entry 3, usage 2                             (in use: pinned)
 *        └─ entry 5, usage 0, 1 child
 *             └─ entry 9, usage 7                        (in use: pinned)
 *
 * Threads: everything here is Navigate's; the I/O thread is inside. Nothing waits for a disk but
 * open and mni_store_drain. Nothing allocates after open. */
#ifndef MNI_STORE_H
#define MNI_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board.h"
#include "mem.h"
#include "metanode/runtime.h"
#include "trace.h"

typedef struct mni_store mni_store;
typedef uint32_t mni_entry;
#define MNI_NO_ENTRY UINT32_MAX

typedef enum mni_answer {
    MNI_GRANTED = 0,
    MNI_ABSENT,  /* a miss: not in memory, and asked for (urgent prefetch), unless it has failed and
                    its next try is not due; or only reads under way stand in the way */
    MNI_REFUSED, /* the pool's rules or the table's size forbid it now: refused_pool. Worth another
                    try when mni_store_allows says so */
} mni_answer;

/* What an attempt was refused for. A block that it needs and that is in no entry: each of its nodes
 * will need that block until it has been split. */
typedef struct mni_refusal {
    uint32_t block_id; /* 0: not known; worth another try when mni_store_epoch has risen */
    int32_t need;      /* the room that it would have had to begin with, above 0 */
} mni_refusal;

/* Content check of a block that has come from a disk, called by the thread that reads (I/O); pure.
 */
typedef bool (*mni_store_check)(const void *context, const void *bytes, uint32_t length_bytes);

/* How much the camera wants each block that a block refers to, called by the thread that reads
 * (I/O); pure. look: as mni_store_look posted it last. notes: on the block, as mni_store_note or
 * this function took them. urgency, below: one a reference, and all of them are set; above 1:
 * wanted now; below 1: its share of what would make it wanted, or 0 where that is less than
 * `least`; notes on that block in turn. */
typedef void (*mni_store_rate)(const void *context, const void *look, const void *bytes,
                               const mni_notes *notes, float least, float *urgency,
                               mni_notes *below);

typedef struct mni_store_desc {
    const char *path;
    const mn_header *header;
    mn_store_kind kind;
    uint32_t k; /* paged: place holders, at least mni_store_k_min(header) */
    mn_io_kind io;
    bool io_serial;
    uint64_t seed;
    mn_sim_desc sim;
    mni_store_check check;
    const void *check_context;
    mn_prefetch prefetch;
    mni_store_rate rate; /* NULL: what lies below a block that has come is not rated */
    const void *rate_context;
    uint32_t look_bytes;
    /* What the first frame's camera sees, and a note on each root's block: what it wants is read at
     * open. NULL: nobody knows. Both are used at open only. */
    const void *first_look;
    const mni_note *first_note;
    mni_trace_ring *trace_io; /* for what I/O does; NULL: none */
    void (*warn)(void *context, const char *text);
    void *warn_context;
} mni_store_desc;

/* Can that kind be of such a file? MN_USAGE, with path, where it can not. */
mn_code mni_store_can(const mn_header *header, mn_store_kind kind, const char *path, mn_status *st);
/* levels: max(5, roots + 3). packed: depth of the block tree + 2 + longest overflow chain. */
uint32_t mni_store_k_min(const mn_header *header);
/* Of so many place holders (at least k_min), those that blocks in use and their ancestors may have.
 * packed, with MN_PREFETCH_AHEAD: a sixteenth of the rest is left for what is to come, or whatever
 * is new would have to be missed first where the pool is full. */
uint32_t mni_store_k_to_use(const mn_header *header, uint32_t k, mn_prefetch prefetch);
/* What open takes from the arena for that many place holders; for the plan. */
size_t mni_store_need_bytes(const mn_header *header, mn_store_kind kind, uint32_t k);
/* Of look_bytes, which it counts: what the longest look may have. */
enum { MNI_LOOK_BYTES_MAX = 1024 };
/* Entries that the table will have: for arrays beside it. */
uint32_t mni_store_entries_max(const mn_header *header, mn_store_kind kind, uint32_t k);

/* Opens the file, starts the I/O thread, loads the root blocks and, with MN_PREFETCH_AHEAD, what
 * the first camera wants or, where nobody knows it, the top of the tree (the one wait); otherwise
 * asks for the roots' children. The arena must have mni_store_need_bytes left. MN_BAD_INPUT: a root
 * block is damaged, or is none. */
mn_code mni_store_open(const mni_store_desc *desc, mni_arena *arena, mni_store **out,
                       mn_status *st);
void mni_store_close(mni_store *store);

/* The root block of root r, which counts the root from open on. */
mni_entry mni_store_root(const mni_store *store, uint32_t r);

/* Switch down: brings child block `ref` of the block at `parent` into use: finds it in physical
 * memory (second chance included), makes or finds its entry, usage + 1. parent has usage above 0.
 * On MNI_ABSENT and MNI_REFUSED nothing changes but the request.
 *
 * What is asked for between two calls of mni_store_sub is one attempt: when a block of it is
 * absent, those that it gives back stay in memory while it is tried again in every frame; when one
 * is refused, they do not. */
mni_answer mni_store_down(mni_store *store, mni_entry parent, mn_block_ref ref, mni_entry *out);
/* Switch up: one more active node in the block of an entry that may be a mere ancestor. */
mni_answer mni_store_up(mni_store *store, mni_entry entry);
/* One more or one fewer active node in a block that is in use. At 0 the block is given back: freed
 * to the tail of the free list when nothing references it. */
void mni_store_add(mni_store *store, mni_entry entry);
void mni_store_sub(mni_store *store, mni_entry entry);
/* What was asked for up to here was one attempt (a chain of splits, a collapse), and it is over:
 * what is asked for next has nothing to do with it. */
void mni_store_attempt_over(mni_store *store);
/* Id of the block that the last MNI_ABSENT was about (0: of none that is asked for). false: nobody
 * knows when it comes, since nothing is asked for or reading it has failed. */
bool mni_store_absent(const mni_store *store, uint32_t *block_id);
/* Of the last MNI_REFUSED, or mni_store_refuse: what the attempt would have needed or, alone, what
 * whoever comes to the same block will need at least. */
mni_refusal mni_store_refusal(const mni_store *store, bool alone);
/* The attempt comes to a node that was refused before, for a block that is known, and would be
 * again (mni_store_allows): it is given up as if it had asked for that block. */
void mni_store_refuse(mni_store *store, const mni_refusal *known);
/* Blocks that may come into use beside those that are, or are granted. INT64_MAX: all. */
int64_t mni_store_room(const mni_store *store);
/* Does a block need none of that room: is it in use, an ancestor, granted, absent for ever, or are
 * there no rules? */
bool mni_store_has_place(const mni_store *store, mn_block_ref ref);
/* The attempt comes to need `blocks` blocks, that child of the block at `parent` among them, and
 * there is room for fewer: it is given up as if it had asked for them, one after the other. */
void mni_store_no_room(mni_store *store, mni_entry parent, mn_block_ref ref, uint32_t blocks);
/* May what was refused be granted now? false: it would be refused again. lenient: another may have
 * brought some of its blocks in since, so that less room would do. */
bool mni_store_allows(const mni_store *store, const mni_refusal *refusal, bool lenient);
/* Bytes of a block in use; *fresh says that they have been mapped or loaded since the last call for
 * this entry, so that views onto them must be reopened. */
const void *mni_store_bytes(mni_store *store, mni_entry entry, bool *fresh);
uint32_t mni_store_usage(const mni_store *store, mni_entry entry);
uint32_t mni_store_block_id(const mni_store *store, mni_entry entry);

/* An overflow block that a split needs besides: resident now and pinned until end of frame, or
 * asked for. */
mni_answer mni_store_overflow(mni_store *store, mni_entry owner, mn_block_ref ref,
                              const void **bytes);

/* What the camera sees from now on, for mni_store_desc.rate: look_bytes, copied. */
void mni_store_look(mni_store *store, const void *look);
/* A block will be wanted in so many frames: a child of a block in use, or the block of an ancestor.
 * With MN_PREFETCH_AHEAD it is kept, or fetched. In a frame, before its end. */
void mni_store_ahead_down(mni_store *store, mni_entry parent, mn_block_ref ref, uint32_t frames);
void mni_store_ahead_up(mni_store *store, mni_entry entry, uint32_t frames);

/* What whoever rates the block must know of it, when it has been answered "absent", or told to be
 * wanted, in this frame. */
void mni_store_note(mni_store *store, mn_block_ref ref, const mni_note *note);
/* Until it ends, what is asked for will be wanted in so many frames only: a block that is there
 * comes into use; one that is not is fetched as by mni_store_ahead_down, and nothing is granted.
 * frames 0: it ends. */
void mni_store_early(mni_store *store, uint32_t frames);

/* Where places are scarce, from one call to the next: only what is in memory comes into use, and
 * what has been granted before. What is absent is answered so, but sought, not granted. false: none
 * of the places is left for what is to come, and nothing changes. */
bool mni_store_there_only(mni_store *store, bool only);
/* What was refused for want of room would be split next, if there were some: so its block is
 * sought, which is to be fetched into the places that are left for what is to come. In a frame,
 * before its end. false: so many are by now. */
bool mni_store_seek(mni_store *store, const mni_refusal *refusal);
/* Is the block in memory that it was refused for? */
bool mni_store_has(mni_store *store, const mni_refusal *refusal);

/* Between frames. begin: completions that have arrived are taken in. end: commands are posted, and
 * grants that Navigate did not ask for again in this frame are dropped (their pins go). The
 * simulated disk's clock advances by frame_s. */
void mni_store_frame_begin(mni_store *store);
void mni_store_frame_end(mni_store *store, double frame_s);
/* Within a frame: what has been asked for is posted, and may be there before the frame ends. */
void mni_store_post(mni_store *store);
/* So much of the frame has passed since: the simulated disk's clock advances. */
void mni_store_meanwhile(mni_store *store, double seconds);
/* Waits until nothing is asked for and nothing is read. */
void mni_store_drain(mni_store *store);
/* Reads in flight, commands not yet fetched, blocks that this frame missed and the next may find or
 * ask for: 0 when all is quiet. Blocks that have failed count only when their next try is due. */
uint32_t mni_store_pending(mni_store *store);
/* Rises when a frame ends with other blocks in use than the one before: what was refused may now be
 * granted. */
uint64_t mni_store_epoch(const mni_store *store);
/* Blocks in use; those with all their ancestors; and blocks in real memory. */
uint32_t mni_store_in_use(const mni_store *store);
uint32_t mni_store_with_ancestors(const mni_store *store);
uint32_t mni_store_in_memory(mni_store *store);
/* packed: blocks in use and their ancestors, levels: blocks in use, over the place holders in
 * service that the rules let them have: near 1 switches down are refused. 0: there is room for all
 * blocks. */
double mni_store_fill(const mni_store *store);

/* paged, between frames: takes one chunk of place holders out of service and gives its memory back,
 * or into service again. shrink: false when each chunk holds something in use, or what would be
 * left is too little for what has been granted; so it may work in a later frame. No allocation. */
bool mni_store_shrink(mni_store *store);
bool mni_store_grow(mni_store *store);

void mni_store_stats(mni_store *store, mn_session_stats *out); /* fills the store's own counters */
/* Invariants 3, 4, 5 of design.md §6 by full recount; usage_of(context, entry) is what the caller
 * counts. Asserts. */
void mni_store_check_all(mni_store *store, uint32_t (*usage_of)(void *context, mni_entry entry),
                         void *context);

#endif
