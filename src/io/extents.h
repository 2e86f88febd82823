/* Blocks that are compressed, each by itself: where they stand in a file, and how one is read.
 *
 * In such a file a block's id is the place that it would have if none were compressed; so all that
 * refers to blocks is as it ever was, and only who reads them looks here:
 *
 *     page 0     header
 *     page 1 …   table: u16 a page of the uncompressed file: sectors of the extent of the block
 *                that begins there; 0: none does
 *     …          extents, each a whole number of sectors, in the order of their blocks, and zeroes
 *                to the end of the page
 *
 *     extent     of as many sectors as the block has: the block as it is
 *                of fewer: head | zstd frame | zeroes, fewer than a sector
 *     head    0  bytes of the frame    u32
 *             4  where rows begin      u32   in the block
 *             8  groups of 8 rows      u16   that are planes of bits in the frame (planes.h)
 *            10  bits of a row         u16   0 without groups
 *
 * A sector is what O_DIRECT asks for on most disks. Where it asks for pages, a read takes in the
 * pages around the extent.
 *
 * Threads: what is found may be asked by any; one unpacks at a time. Memory: from the arena, 2.125
 * bytes a page of the uncompressed file, slots for what is read, a block, and what zstd needs: it
 * is given all of it, and takes no other. Of a file that is not compressed: none. */
#ifndef MNI_EXTENTS_H
#define MNI_EXTENTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "file.h"
#include "mem.h"
#include "metanode/format.h"
#include "planes.h"

enum {
    MNI_SECTOR_BYTES = 512,
    MNI_EXTENT_HEAD_BYTES = 12,
    MNI_EXTENT_SECTORS_MAX = UINT16_MAX,
};

typedef struct mni_extent {
    uint64_t offset;
    uint32_t length_bytes; /* 0: no such block begins there */
} mni_extent;

typedef struct mni_extents {
    /* const after open */
    uint32_t pages;          /* of the uncompressed file */
    const uint16_t *sectors; /* by page; NULL: the file is not compressed */
    const uint64_t *before;  /* sectors of the file before the extents of pages 64 i … */
    unsigned char *slots;    /* page-aligned: for extents that are read, slot_bytes each */
    size_t slots_bytes;
    uint32_t slot_count, slot_bytes, extent_bytes_max;
    uint32_t align_bytes;     /* of reads: a sector, or a page */
    uint32_t block_bytes_max; /* of what is unpacked: a longer one is no block */
    /* who unpacks */
    unsigned char *room; /* a block whose rows are planes */
    void *context;       /* zstd's */
} mni_extents;

/* Length of the file as it is on the disk. */
static inline uint64_t mni_stored_bytes(const mn_header *header) {
    return header->zstd_level > 0 ? header->stored_bytes : header->file_bytes;
}
/* Where the extents of a file of so many pages begin. */
static inline uint64_t mni_extents_begin(uint64_t pages) {
    return (1 + (2 * pages + MN_PAGE_BYTES - 1) / MN_PAGE_BYTES) * MN_PAGE_BYTES;
}

/* What open takes; 0 of a file that is not compressed. slots: at least 1. */
size_t mni_extents_need(const mn_header *header, uint32_t slots);
/* Reads and checks the table. header: of this file, checked. MN_BAD_INPUT. */
mn_code mni_extents_open(mni_extents *extents, const char *path, const mn_header *header,
                         uint32_t slots, mni_arena *arena, mn_status *st);
/* Of a file that is not compressed: the block itself. */
mni_extent mni_extents_find(const mni_extents *extents, mn_block_ref ref);
/* After open, when it is known what the disk asks for: MNI_SECTOR_BYTES, which it is before, or a
 * page, for which there may be fewer slots. */
void mni_extents_align(mni_extents *extents, uint32_t align_bytes);
/* The first block at or after that page; pages 0: there is none. Of a compressed file. */
mn_block_ref mni_extents_next(const mni_extents *extents, uint32_t page);
/* Makes the block of its extent: both whole. Writes bytes [0, length_bytes) and no others, whatever
 * the extent says. false: it is no such block's; what stands in bytes then means nothing. */
bool mni_extents_unpack(mni_extents *extents, const void *extent, uint32_t extent_bytes,
                        void *bytes, uint32_t length_bytes);
/* Reads a block of either kind of file, by slot 0: bytes of it, as mni_in_read; -EBADMSG: the
 * extent is damaged, or there is none. Adds what was read of the file to *read_bytes. */
int64_t mni_extents_read(mni_extents *extents, const mni_in *in, mn_block_ref ref, void *bytes,
                         uint64_t *read_bytes);

/* A file of either kind, for those who read all of it: one thread, memory of its own. */
typedef struct mni_stored {
    mni_in in;
    mni_arena arena;
    mni_extents extents;
    uint64_t read_bytes; /* so far */
} mni_stored;
mn_code mni_stored_open(mni_stored *stored, const char *path, const mn_header *header,
                        mn_status *st);
static inline int64_t mni_stored_read(mni_stored *stored, mn_block_ref ref, void *bytes) {
    return mni_extents_read(&stored->extents, &stored->in, ref, bytes, &stored->read_bytes);
}
/* The block that begins at that page, or pages 0. Believes the block: nothing else says so. */
mn_block_ref mni_stored_block(const mni_stored *stored, uint32_t page);
void mni_stored_close(mni_stored *stored); /* harmless on a zeroed one but for in.fd -1 */

/* ---- making them: one thread ---------------------------------------------------------------- */

typedef struct mni_presser {
    uint32_t length_max;
    unsigned char *room, *out;
    void *memory; /* zstd's, all of it */
    void *context;
} mni_presser;

/* level: zstd's, 1 … 22. length_max: of a block. */
size_t mni_presser_bytes(uint32_t level, uint32_t length_max);
/* MN_FAILED: no memory. */
mn_code mni_presser_open(mni_presser *presser, uint32_t level, uint32_t length_max, mn_status *st);
/* The extent of a block: *extent holds so many bytes until the next call. */
uint32_t mni_presser_make(mni_presser *presser, const void *block, uint32_t length_bytes,
                          const mni_rows_place *rows, const void **extent);
void mni_presser_close(mni_presser *presser); /* harmless on a zeroed one */

#endif
