/* From a file of blocks to one of compressed blocks.
 *
 * Hides: the order in which such a file is made. Blocks are written in the order of the packing and
 * come to stand in that of their ids, so where an extent stands is known only when all before it
 * are compressed: hence the plain file is written first, and read once, from its front to its end:
 *
 *     plain      | header | block | block | block …          what has been read is given back
 *     compressed | header | table … | extent | extent …       the table by pages that are full
 *
 * Order: one call, after the plain file is whole. One thread; blocks on the disk. Memory: a block,
 * a page of the table, and what zstd takes for the level, which the cap must have room for. The
 * same bytes for the same blocks, level and version of libzstd. Paper: none. */
#include "block_press.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "mn_assert.h"
#include "block.h"
#include "cap.h"
#include "extents.h"
#include "frame.h"
#include "header.h"
#include "simplify.h"

enum {
    ENTRIES = MN_PAGE_BYTES / 2,
    DISCARD_BYTES = 8 << 20, /* at once */
    WATCH_EVERY = 64,        /* blocks */
};

typedef struct press {
    const mn_block_desc *desc;
    mn_header *header;
    mn_status *st;
    mni_out *plain, out;
    mni_presser presser;
    unsigned char *block;
    XXH3_state_t *sum;       /* of the table */
    uint16_t entry[ENTRIES]; /* of the table's page in the making */
    uint64_t pages;          /* of the plain file, that the table has */
    uint64_t discarded;
} press;

/* ---- the table ------------------------------------------------------------------------------ */

static mn_code flush_table(press *p) {
    const size_t entries = (p->pages - 1) % ENTRIES + 1;
    const uint64_t at = MN_PAGE_BYTES + 2 * (p->pages - entries);
    XXH3_64bits_update(p->sum, p->entry, 2 * entries);
    mn_code code = mni_out_write_at(&p->out, at, p->entry, 2 * entries, p->st);
    memset(p->entry, 0, sizeof p->entry);
    return code;
}

/* The next pages: of a block, or the header page, whose extent has so many sectors. */
static mn_code add_entries(press *p, uint32_t pages, uint32_t sectors) {
    mn_code code = MN_OK;
    for (uint32_t i = 0; i < pages && code == MN_OK; i++) {
        p->entry[p->pages++ % ENTRIES] = i == 0 ? (uint16_t)sectors : 0;
        if (p->pages % ENTRIES == 0)
            code = flush_table(p);
    }
    return code;
}

/* ---- blocks --------------------------------------------------------------------------------- */

static mn_code write_zeroes(press *p, uint64_t count) {
    static const unsigned char zeroes[MN_PAGE_BYTES];
    mn_code code = MN_OK;
    for (uint64_t done = 0; done < count && code == MN_OK; done += sizeof zeroes)
        code = mni_out_write(&p->out, zeroes,
                             count - done < sizeof zeroes ? (size_t)(count - done) : sizeof zeroes,
                             p->st);
    return code;
}

static mn_code not_there(press *p) {
    return mn_fail(p->st, MN_FAILED,
                   "what was written is not what is read again: is the disk sound?");
}

static mn_code press_block(press *p) {
    const mn_header *h = p->header;
    const uint64_t at = p->pages * MN_PAGE_BYTES;
    mn_block_ref ref = {.id = (uint32_t)p->pages};
    if (mni_out_read(p->plain, at, p->block, MNI_FRAME_BYTES) != MNI_FRAME_BYTES)
        return not_there(p);
    ref.pages = mni_frame_pages(p->block);
    const uint64_t length = (uint64_t)ref.pages * MN_PAGE_BYTES;
    if (length == 0 || length > h->block_bytes_max ||
        mni_out_read(p->plain, at, p->block, length) != (int64_t)length ||
        mni_frame_check(p->block, ref, h->build_id, h->file_bytes) != MNI_FRAME_OK)
        return not_there(p);
    const mni_rows_place rows = mni_block_rows_place(p->block);
    const void *extent;
    const uint32_t bytes =
        mni_presser_make(&p->presser, p->block, (uint32_t)length, &rows, &extent);
    const uint32_t sectors = bytes / MNI_SECTOR_BYTES;
    if (sectors > MNI_EXTENT_SECTORS_MAX)
        return mn_fail(p->st, MN_FAILED, "blocks of %llu bytes are too long to be compressed",
                       (unsigned long long)length);
    if (bytes > p->header->extent_bytes_max)
        p->header->extent_bytes_max = bytes;
    mn_code code = mni_out_write(&p->out, extent, bytes, p->st);
    return code == MN_OK ? add_entries(p, ref.pages, sectors) : code;
}

static mn_code say_progress(const press *p) {
    const mn_block_desc *desc = p->desc;
    if (desc->progress != NULL && !desc->progress(desc->progress_context, "compressing",
                                                  p->pages * MN_PAGE_BYTES, p->header->file_bytes))
        return mn_fail(p->st, MN_FAILED, "interrupted");
    return MN_OK;
}

static mn_code press_blocks(press *p) {
    const uint64_t pages = p->header->file_bytes / MN_PAGE_BYTES;
    mn_code code = write_zeroes(p, mni_extents_begin(pages));
    if (code == MN_OK)
        code = add_entries(p, 1, 0);
    for (uint32_t done = 0; p->pages < pages && code == MN_OK; done++) {
        code = press_block(p);
        const uint64_t read = p->pages * MN_PAGE_BYTES;
        if (read - p->discarded >= DISCARD_BYTES) {
            mni_out_discard(p->plain, p->discarded, read);
            p->discarded = read;
        }
        if (code == MN_OK && done % WATCH_EVERY == 0)
            code = say_progress(p);
    }
    if (code == MN_OK && p->pages % ENTRIES != 0)
        code = flush_table(p);
    if (code != MN_OK)
        return code;
    MN_ASSERT(p->pages == pages);
    return write_zeroes(p, (MN_PAGE_BYTES - mni_out_at(&p->out) % MN_PAGE_BYTES) % MN_PAGE_BYTES);
}

static mn_code write_header(press *p, const char *path) {
    mn_header *h = p->header;
    unsigned char page[MN_PAGE_BYTES];
    h->zstd_level = p->desc->zstd_level;
    h->stored_bytes = mni_out_at(&p->out);
    h->extents_checksum = XXH3_64bits_digest(p->sum);
    mn_code code = mni_header_check(h, h->stored_bytes, path, p->st);
    if (code != MN_OK)
        return code;
    mni_header_encode(h, page);
    return mni_out_write_at(&p->out, 0, page, sizeof page, p->st);
}

/* ---- the whole ------------------------------------------------------------------------------ */

uint64_t mni_block_press_bytes(const mn_block_desc *desc, uint32_t length_max) {
    return MNI_PROGRAM_BYTES + length_max + mni_presser_bytes(desc->zstd_level, length_max);
}

mn_code mni_block_press_fits(const char *path, const mn_block_desc *desc, uint32_t length_max,
                             uint64_t least_bytes, mn_status *st) {
    uint64_t need = mni_block_press_bytes(desc, length_max);
    if (desc->ram_bytes == 0 || need <= desc->ram_bytes)
        return MN_OK;
    need = need > least_bytes ? need : least_bytes;
    return mn_fail(
        st, MN_CAP_TOO_SMALL,
        "%s: blocks of %u bytes at zstd's level %u need --ram %lluM; or try a lower level", path,
        length_max, desc->zstd_level, mni_megabytes(need));
}

mn_code mni_block_press(mni_out *out, const char *path, const mn_block_desc *desc,
                        mn_header *header, mn_block_counts *counts, mn_status *st) {
    press p = {.desc = desc, .header = header, .st = st, .plain = out, .out = {.fd = -1}};
    mn_code code = mni_block_press_fits(path, desc, header->block_bytes_max, 0, st);
    if (code != MN_OK)
        return code;
    p.block = malloc(header->block_bytes_max);
    p.sum = XXH3_createState();
    if (p.block == NULL || p.sum == NULL)
        code = mn_fail(st, MN_FAILED, "no memory for a block of %u bytes", header->block_bytes_max);
    else
        XXH3_64bits_reset(p.sum);
    if (code == MN_OK)
        code = mni_presser_open(&p.presser, desc->zstd_level, header->block_bytes_max, st);
    if (code == MN_OK)
        code = mni_out_open(&p.out, path, st);
    if (code == MN_OK)
        code = press_blocks(&p);
    if (code == MN_OK)
        code = write_header(&p, path);
    if (code == MN_OK) {
        counts->bytes_read += header->file_bytes;
        counts->bytes_written += header->stored_bytes;
        mni_out_abort(out);
        *out = p.out;
        p.out = (mni_out){.fd = -1};
    }
    mni_out_abort(&p.out);
    mni_presser_close(&p.presser);
    XXH3_freeState(p.sum);
    free(p.block);
    return code;
}
