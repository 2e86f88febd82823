/* Temporary files for work that does not fit in memory: written from front to back, read in pieces,
 * gone with the process however that ends.
 *
 *   open ── writer: open, put …, end ── (another writer …) ── readers: open, take … ── close
 *
 * Buffers belong to the caller, who has a budget; here nothing is allocated. A second buffer each
 * way is the page cache's: what was written goes to the disk behind our back, and a reader asks for
 * its next bufferful while it hands out this one. So work and disk overlap in one thread. A
 * reader that discards gives its bytes back to the disk (and to the page cache, unwritten where
 * they have not been written yet) about as fast as it is read.
 *
 * A spill that is kept can be given a name, and outlives the process under it; another process
 * takes it up, if the bytes are still those that were written:
 *
 *   open, keep ── writers … ── name ┆ (a kill, or the end) ┆ resume ── readers … ── close
 *
 * The first failure is kept in the spill: writes after it do nothing, reads find nothing.
 * MN_NO_SPACE for a full disk. Threads: one at a time a spill; calls may block on the disk. */
#ifndef MNI_SPILL_H
#define MNI_SPILL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "metanode/status.h"

typedef struct mni_spill {
    int fd;                             /* -1: closed */
    const char *dir;                    /* the caller's; must outlive the spill */
    uint64_t size_bytes;                /* written so far: where the next writer begins */
    uint64_t bytes_read, bytes_written; /* moved between us and the file */
    mn_status trouble;                  /* the first failure */
    void *sum;                          /* of a kept one: XXH3 of what was written, so far */
} mni_spill;

/* A file without a name in dir. MN_FAILED, MN_NO_SPACE: it cannot be made there. */
mn_code mni_spill_open(mni_spill *spill, const char *dir, mn_status *st);
/* Harmless on a closed one, on {.fd = -1}, and on one whose copy is used instead and whose fd has
 * been set to -1. */
void mni_spill_close(mni_spill *spill);
/* Appends as it is, without a buffer. */
mn_code mni_spill_append(mni_spill *spill, const void *bytes, size_t count);

/* ---- at any place: of what is used as a table ------------------------------------------------ */

/* All of the bytes, or the spill's failure. */
mn_code mni_spill_read_at(mni_spill *spill, uint64_t offset, void *bytes, size_t count);
/* Those that nobody has written are zero, as they are past the end. */
mn_code mni_spill_read_some(mni_spill *spill, uint64_t offset, void *bytes, size_t count);
/* Over what stands there, or past the end; size_bytes stays. Not of a kept spill. */
mn_code mni_spill_write_at(mni_spill *spill, uint64_t offset, const void *bytes, size_t count);
/* These are going to be read: a hint. */
void mni_spill_ask(const mni_spill *spill, uint64_t offset, size_t count);

/* ---- keeping ------------------------------------------------------------------------------- */

/* Of an open spill in which nothing is yet: it may be named later, and no reader discards of it.
 * Costs a small allocation and a checksum of what is written. MN_FAILED: no memory. */
mn_code mni_spill_keep(mni_spill *spill, mn_status *st);
/* Open, and keep if so. */
mn_code mni_spill_open_kept(mni_spill *spill, const char *dir, bool keep, mn_status *st);
/* XXH3 of all that was written; of a kept spill. */
uint64_t mni_spill_sum(const mni_spill *spill);
/* Gives a kept spill a name in the folder (on the same disk), which must be free there. The spill
 * goes on as it is. It is copied where the file system has no files without names. */
mn_code mni_spill_name(mni_spill *spill, int folder, const char *name, mn_status *st);
/* Takes up what was named so, as a kept spill without room for more; dir as in open. MN_BAD_INPUT:
 * it is not there, or not those bytes: which takes reading them. */
mn_code mni_spill_resume(mni_spill *spill, const char *dir, int folder, const char *name,
                         uint64_t size_bytes, uint64_t sum, mn_status *st);

/* ---- writing: one writer at a time --------------------------------------------------------- */

typedef struct mni_spill_writer {
    mni_spill *spill;
    unsigned char *buffer;
    size_t buffer_bytes, used_bytes;
} mni_spill_writer;

static inline void mni_spill_writer_open(mni_spill_writer *w, mni_spill *spill, void *buffer,
                                         size_t buffer_bytes) {
    *w = (mni_spill_writer){.spill = spill, .buffer = buffer, .buffer_bytes = buffer_bytes};
}
void mni_spill_put_slow(mni_spill_writer *w, const void *bytes, size_t count);
/* Any number of bytes; failures are told by end. */
static inline void mni_spill_put(mni_spill_writer *w, const void *bytes, size_t count) {
    if (count <= w->buffer_bytes - w->used_bytes) {
        memcpy(w->buffer + w->used_bytes, bytes, count);
        w->used_bytes += count;
    } else {
        mni_spill_put_slow(w, bytes, count);
    }
}
/* Writes what is buffered; the spill's first failure, if there is one. */
mn_code mni_spill_end(mni_spill_writer *w);

/* ---- reading: any number of readers -------------------------------------------------------- */

typedef struct mni_spill_reader {
    mni_spill *spill;
    uint64_t next, end; /* of the file: what is not in the buffer yet */
    uint64_t discarded; /* up to here; UINT64_MAX: nothing is */
    unsigned char *buffer;
    size_t buffer_bytes, filled_bytes, taken_bytes;
} mni_spill_reader;

/* Bytes [from, to) of what writers have ended. discard: each byte is read once (a kept spill stays
 * whole all the same). */
void mni_spill_reader_open(mni_spill_reader *r, mni_spill *spill, uint64_t from, uint64_t to,
                           void *buffer, size_t buffer_bytes, bool discard);
/* What has not been taken goes to the front, and more behind it. false: there is nothing. */
bool mni_spill_refill(mni_spill_reader *r);
/* The next `count` bytes, which stay where they are until the next call; count, the same in each
 * call, divides buffer_bytes and to - from. NULL: that was all, or the spill has failed. */
static inline const void *mni_spill_take(mni_spill_reader *r, size_t count) {
    if (r->taken_bytes == r->filled_bytes && !mni_spill_refill(r))
        return NULL;
    const void *at = r->buffer + r->taken_bytes;
    r->taken_bytes += count;
    return at;
}
/* Pieces of different lengths: where the next one begins, whole if it is at most `most` bytes, half
 * a buffer at most; who has looked at it skips it. NULL as above. */
static inline const unsigned char *mni_spill_peek(mni_spill_reader *r, size_t most) {
    if (r->filled_bytes - r->taken_bytes < most && !mni_spill_refill(r))
        return NULL;
    return r->buffer + r->taken_bytes;
}
static inline void mni_spill_skip(mni_spill_reader *r, const unsigned char *to) {
    r->taken_bytes = (size_t)(to - r->buffer);
}

#endif
