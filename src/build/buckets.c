/* See buckets.h. Secret: the chain. A chunk begins with the number of the one before and the bytes
 * that are used; chunk i of the file is at i × chunk_bytes. */
#include "buckets.h"

#include "mn_assert.h"

enum { HEAD_BYTES = 8, ALIGN = 16 };
#define NONE UINT32_MAX

size_t mni_buckets_need(uint32_t buckets, uint32_t chunk_bytes) {
    return mni_arena_need(buckets, sizeof(mni_bucket), ALIGN) +
           mni_arena_need(buckets, chunk_bytes, ALIGN);
}

void mni_buckets_open(mni_buckets *b, uint32_t buckets, uint32_t chunk_bytes, mni_arena *arena,
                      const char *temp_dir) {
    MN_ASSERT(chunk_bytes >= MNI_BUCKET_CHUNK_MIN && chunk_bytes % 8 == 0);
    *b = (mni_buckets){.spill = {.fd = -1, .dir = temp_dir},
                       .buckets = buckets,
                       .chunk_bytes = chunk_bytes,
                       .bucket = mni_arena_take(arena, buckets, sizeof *b->bucket, ALIGN),
                       .chunk = mni_arena_take(arena, buckets, chunk_bytes, ALIGN)};
    for (uint32_t i = 0; i < buckets; i++)
        b->bucket[i] = (mni_bucket){HEAD_BYTES, NONE, 0};
}

void mni_buckets_close(mni_buckets *b) {
    if (b->bucket != NULL)
        mni_spill_close(&b->spill);
    b->bucket = NULL;
}

void mni_bucket_spill(mni_buckets *b, uint32_t bucket) {
    mni_bucket *k = &b->bucket[bucket];
    unsigned char *chunk = b->chunk + (size_t)bucket * b->chunk_bytes;
    const uint32_t head[2] = {k->before, k->used_bytes};
    memcpy(chunk, head, sizeof head);
    if (b->spill.fd < 0 && b->spill.trouble.code == MN_OK) {
        mn_status st = {0};
        if (mni_spill_open(&b->spill, b->spill.dir, &st) != MN_OK)
            b->spill.trouble = st;
    }
    uint64_t number = b->spill.size_bytes / b->chunk_bytes;
    MN_ASSERT(number < NONE);
    if (mni_spill_append(&b->spill, chunk, b->chunk_bytes) == MN_OK)
        k->before = (uint32_t)number;
    k->used_bytes = HEAD_BYTES;
    k->last = 0;
}

void mni_bucket_read(mni_bucket_reader *r, mni_buckets *b, uint32_t bucket, void *room) {
    unsigned char *chunk = b->chunk + (size_t)bucket * b->chunk_bytes;
    *r = (mni_bucket_reader){.at = chunk + HEAD_BYTES,
                             .end = chunk + b->bucket[bucket].used_bytes,
                             .before = b->bucket[bucket].before,
                             .room = room};
    if (r->before != NONE)
        mni_spill_ask(&b->spill, (uint64_t)r->before * b->chunk_bytes, b->chunk_bytes);
}

bool mni_bucket_more(mni_bucket_reader *r, mni_buckets *b) {
    uint32_t head[2];
    if (r->before == NONE || mni_spill_read_at(&b->spill, (uint64_t)r->before * b->chunk_bytes,
                                               r->room, b->chunk_bytes) != MN_OK)
        return false;
    memcpy(head, r->room, sizeof head);
    r->before = head[0];
    r->last = 0;
    r->at = r->room + HEAD_BYTES;
    r->end = r->room + head[1];
    if (r->before != NONE)
        mni_spill_ask(&b->spill, (uint64_t)r->before * b->chunk_bytes, b->chunk_bytes);
    return true;
}
