/* Records dealt to buckets, more of them than memory holds: a sort that knows in advance where
 * everything belongs.
 *
 *   open ── put, put_end × n ── read each bucket, once or more ── close
 *
 * A bucket is a chain of chunks of one size. The one that is being filled is in memory, the others
 * in one file, each with the place of the one before:
 *
 *     memory    [bucket 0: …]  [bucket 1: …]  [bucket 2:   ]
 *                    │              │
 *     file      ┌ 0:0 ◄─┐  1:0 ◄── 1:1   0:1 ◄─ …
 *
 * So each byte is written once and read once, whatever the number of records, and what fits the
 * chunks never leaves memory. Records are read in another order than they were put in: chunks from
 * the last to the first. Memory: buckets × chunk, from the arena, and a chunk's room of the
 * caller's to read. One thread at a time; calls may block on the disk. */
#ifndef MNI_BUCKETS_H
#define MNI_BUCKETS_H

#include "mem.h"
#include "spill.h"

enum { MNI_BUCKET_RECORD_MAX = 48, MNI_BUCKET_CHUNK_MIN = 128 };

typedef struct mni_bucket {
    uint32_t used_bytes; /* of its chunk in memory */
    uint32_t before;     /* its last chunk in the file; UINT32_MAX: none */
    uint32_t last;       /* the caller's, 0 where a chunk begins: what was put last */
} mni_bucket;

typedef struct mni_buckets {
    mni_spill spill;
    uint32_t buckets, chunk_bytes;
    mni_bucket *bucket;
    unsigned char *chunk;
} mni_buckets;

/* Of the arena; chunk_bytes is a multiple of 8. */
size_t mni_buckets_need(uint32_t buckets, uint32_t chunk_bytes);
/* temp_dir outlives them. No file is made before it is needed. */
void mni_buckets_open(mni_buckets *b, uint32_t buckets, uint32_t chunk_bytes, mni_arena *arena,
                      const char *temp_dir);
void mni_buckets_close(mni_buckets *b); /* the file; harmless on zeroed ones */

/* Writes the bucket's chunk out. Failures stay in the spill: the bucket is then empty. */
void mni_bucket_spill(mni_buckets *b, uint32_t bucket);

/* Where the next record of the bucket goes, with room for MNI_BUCKET_RECORD_MAX bytes; put_end
 * tells how far it went. */
static inline unsigned char *mni_bucket_put(mni_buckets *b, uint32_t bucket) {
    if (b->bucket[bucket].used_bytes > b->chunk_bytes - MNI_BUCKET_RECORD_MAX)
        mni_bucket_spill(b, bucket);
    return b->chunk + (size_t)bucket * b->chunk_bytes + b->bucket[bucket].used_bytes;
}
static inline void mni_bucket_put_end(mni_buckets *b, uint32_t bucket, const unsigned char *end) {
    b->bucket[bucket].used_bytes = (uint32_t)(end - (b->chunk + (size_t)bucket * b->chunk_bytes));
}

/* For differences within a chunk: of the bucket that put was called for. */
static inline uint32_t *mni_bucket_last(mni_buckets *b, uint32_t bucket) {
    return &b->bucket[bucket].last;
}

/* Whole records of a bucket, a chunk's worth at a time. */
typedef struct mni_bucket_reader {
    const unsigned char *at, *end; /* the records */
    uint32_t before;
    uint32_t last; /* as the bucket's */
    unsigned char *room;
} mni_bucket_reader;
/* room: chunk_bytes, the caller's. Nothing is put meanwhile. */
void mni_bucket_read(mni_bucket_reader *r, mni_buckets *b, uint32_t bucket, void *room);
/* The next chunk's, once those in at … end have been used. false: that was all, or the spill has
 * failed. */
bool mni_bucket_more(mni_bucket_reader *r, mni_buckets *b);

#endif
