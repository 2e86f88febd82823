/* Blocks that are compressed. See extents.h. Only here: libzstd.
 *
 * Secret: how extents are found, and what is done to a block before it is compressed. The table is
 * lengths, in the order of the file; a sum every 64 entries makes places of them. */
#define ZSTD_STATIC_LINKING_ONLY /* contexts in memory of our own */
#include "extents.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>
#include <zstd.h>

#include "mn_assert.h"
#include "frame.h"

enum { STRIDE = 64, ALIGN = 64 };

typedef struct head {
    uint32_t frame_bytes, rows_at;
    uint16_t groups, bits;
} head;
_Static_assert(sizeof(head) == MNI_EXTENT_HEAD_BYTES, "as it stands in the file");

/* ---- open ----------------------------------------------------------------------------------- */

static uint64_t round_up(uint64_t bytes, uint64_t unit) {
    return (bytes + unit - 1) / unit * unit;
}

static uint32_t pages_of(const mn_header *header) {
    return (uint32_t)(header->file_bytes / MN_PAGE_BYTES);
}

/* Of the longest extent, with what is read around it: it may begin with the last sector of a page.
 */
static uint32_t slot_bytes_for(uint32_t extent_bytes_max, uint32_t align_bytes) {
    return (uint32_t)round_up(extent_bytes_max + (uint64_t)align_bytes - MNI_SECTOR_BYTES,
                              align_bytes);
}

/* So many where sectors can be read; where only pages can, as many as fit, and at least one. */
static size_t slots_bytes_for(const mn_header *header, uint32_t slots) {
    const size_t one = slot_bytes_for(header->extent_bytes_max, MN_PAGE_BYTES);
    const size_t all = (size_t)slots * header->extent_bytes_max;
    return round_up(all > one ? all : one, MN_PAGE_BYTES);
}

void mni_extents_align(mni_extents *x, uint32_t align_bytes) {
    const uint32_t slots = (uint32_t)(x->slots_bytes / x->extent_bytes_max);
    MN_ASSERT(align_bytes == MNI_SECTOR_BYTES || align_bytes == MN_PAGE_BYTES);
    x->align_bytes = align_bytes;
    x->slot_bytes = slot_bytes_for(x->extent_bytes_max, align_bytes);
    x->slot_count = (uint32_t)(x->slots_bytes / x->slot_bytes);
    x->slot_count = x->slot_count < slots ? x->slot_count : slots;
    MN_ASSERT(x->slot_count > 0);
}

size_t mni_extents_need(const mn_header *header, uint32_t slots) {
    if (header->zstd_level == 0)
        return 0;
    const uint32_t pages = pages_of(header);
    return mni_arena_need(pages, sizeof(uint16_t), ALIGN) +
           mni_arena_need(pages / STRIDE + 1, sizeof(uint64_t), ALIGN) +
           mni_arena_need(slots_bytes_for(header, slots), 1, MN_PAGE_BYTES) +
           mni_arena_need(header->block_bytes_max, 1, ALIGN) +
           mni_arena_need(ZSTD_estimateDCtxSize(), 1, ALIGN);
}

static mn_code bad_table(const char *path, const char *why, mn_status *st) {
    return mn_fail(st, MN_BAD_INPUT,
                   "%s: table of extents: %s; the file is damaged: copy or build it again", path,
                   why);
}

static mn_code check_table(const mni_extents *x, uint64_t *before, const char *path,
                           const mn_header *header, mn_status *st) {
    if (XXH3_64bits(x->sectors, (size_t)2 * x->pages) != header->extents_checksum)
        return bad_table(path, "its checksum is wrong", st);
    uint64_t at = mni_extents_begin(x->pages) / MNI_SECTOR_BYTES;
    uint32_t blocks = 0, most = 0;
    for (uint32_t page = 0; page < x->pages; page++) {
        if (page % STRIDE == 0)
            before[page / STRIDE] = at;
        at += x->sectors[page];
        blocks += x->sectors[page] > 0;
        most = x->sectors[page] > most ? x->sectors[page] : most;
    }
    if (x->sectors[0] != 0 || blocks != header->blocks)
        return bad_table(path, "it has not the blocks that the header counts", st);
    if (most * (uint64_t)MNI_SECTOR_BYTES != header->extent_bytes_max)
        return bad_table(path, "the longest extent is not what the header says", st);
    if (round_up(at * MNI_SECTOR_BYTES, MN_PAGE_BYTES) != header->stored_bytes)
        return bad_table(path, "the extents do not end where the file does", st);
    return MN_OK;
}

mn_code mni_extents_open(mni_extents *x, const char *path, const mn_header *header, uint32_t slots,
                         mni_arena *arena, mn_status *st) {
    *x = (mni_extents){.pages = pages_of(header)};
    if (header->zstd_level == 0)
        return MN_OK;
    const size_t table_bytes = (size_t)x->pages * sizeof(uint16_t);
    uint16_t *sectors = mni_arena_take(arena, x->pages, sizeof *sectors, ALIGN);
    uint64_t *before = mni_arena_take(arena, x->pages / STRIDE + 1, sizeof *before, ALIGN);
    x->sectors = sectors;
    x->before = before;
    x->extent_bytes_max = header->extent_bytes_max;
    x->block_bytes_max = header->block_bytes_max;
    x->slots_bytes = slots_bytes_for(header, slots);
    x->slots = mni_arena_take(arena, x->slots_bytes, 1, MN_PAGE_BYTES);
    mni_extents_align(x, MNI_SECTOR_BYTES);
    x->room = mni_arena_take(arena, header->block_bytes_max, 1, ALIGN);
    void *context = mni_arena_take(arena, ZSTD_estimateDCtxSize(), 1, ALIGN);
    x->context = ZSTD_initStaticDCtx(context, ZSTD_estimateDCtxSize());
    MN_ASSERT(x->context != NULL);
    mni_in in;
    mn_code code = mni_in_open(&in, path, st);
    if (code != MN_OK)
        return code;
    int64_t got = mni_in_read(&in, MN_PAGE_BYTES, sectors, table_bytes);
    mni_in_close(&in);
    if (got < 0)
        return mn_fail(st, MN_FAILED, "%s: table of extents: cannot read: %s", path,
                       strerror((int)-got));
    if ((uint64_t)got < table_bytes)
        return bad_table(path, "the file ends before it does", st);
    return check_table(x, before, path, header, st);
}

/* ---- finding -------------------------------------------------------------------------------- */

mni_extent mni_extents_find(const mni_extents *x, mn_block_ref ref) {
    if (x->sectors == NULL)
        return (mni_extent){(uint64_t)ref.id * MN_PAGE_BYTES, ref.pages * MN_PAGE_BYTES};
    if (ref.id >= x->pages || x->sectors[ref.id] == 0)
        return (mni_extent){0};
    uint64_t at = x->before[ref.id / STRIDE];
    for (uint32_t page = ref.id / STRIDE * STRIDE; page < ref.id; page++)
        at += x->sectors[page];
    return (mni_extent){at * MNI_SECTOR_BYTES, (uint32_t)x->sectors[ref.id] * MNI_SECTOR_BYTES};
}

mn_block_ref mni_extents_next(const mni_extents *x, uint32_t page) {
    MN_ASSERT(x->sectors != NULL);
    while (page < x->pages && x->sectors[page] == 0)
        page++;
    uint32_t end = page + 1;
    while (end < x->pages && x->sectors[end] == 0)
        end++;
    return page < x->pages ? (mn_block_ref){page, end - page} : (mn_block_ref){0};
}

/* ---- unpacking ------------------------------------------------------------------------------ */

static bool is_zero(const unsigned char *bytes, uint32_t count) {
    for (uint32_t i = 0; i < count; i++)
        if (bytes[i] != 0)
            return false;
    return true;
}

static bool head_is_sound(const head *h, uint32_t extent_bytes, uint32_t length_bytes) {
    if (h->frame_bytes > extent_bytes - MNI_EXTENT_HEAD_BYTES ||
        round_up(MNI_EXTENT_HEAD_BYTES + (uint64_t)h->frame_bytes, MNI_SECTOR_BYTES) !=
            extent_bytes)
        return false;
    if (h->groups == 0)
        return h->rows_at == 0 && h->bits == 0;
    return h->bits > 0 && h->bits <= MNI_PLANES_BITS_MAX &&
           h->rows_at + (uint64_t)h->groups * h->bits <= length_bytes;
}

bool mni_extents_unpack(mni_extents *x, const void *extent, uint32_t extent_bytes, void *bytes,
                        uint32_t length_bytes) {
    const unsigned char *from = extent;
    unsigned char *to = bytes;
    head h;
    if (length_bytes > x->block_bytes_max)
        return false;
    if (extent_bytes >= length_bytes) {
        if (extent_bytes == length_bytes)
            memcpy(bytes, extent, length_bytes);
        return extent_bytes == length_bytes;
    }
    MN_ASSERT(extent_bytes >= MNI_SECTOR_BYTES);
    memcpy(&h, from, sizeof h);
    from += sizeof h;
    if (!head_is_sound(&h, extent_bytes, length_bytes) ||
        !is_zero(from + h.frame_bytes, extent_bytes - MNI_EXTENT_HEAD_BYTES - h.frame_bytes) ||
        ZSTD_findFrameCompressedSize(from, h.frame_bytes) != h.frame_bytes ||
        ZSTD_getFrameContentSize(from, h.frame_bytes) != length_bytes)
        return false;
    const size_t planes_bytes = (size_t)h.groups * h.bits;
    unsigned char *block = h.groups > 0 ? x->room : to;
    if (ZSTD_decompressDCtx(x->context, block, length_bytes, from, h.frame_bytes) != length_bytes)
        return false;
    if (h.groups > 0) {
        const size_t rest = h.rows_at + planes_bytes;
        memcpy(to, block, h.rows_at);
        mni_planes_to_rows(block + h.rows_at, h.groups, h.bits, to + h.rows_at);
        memcpy(to + rest, block + rest, length_bytes - rest);
    }
    return true;
}

int64_t mni_extents_read(mni_extents *x, const mni_in *in, mn_block_ref ref, void *bytes,
                         uint64_t *read_bytes) {
    const mni_extent extent = mni_extents_find(x, ref);
    const uint64_t length_bytes = (uint64_t)ref.pages * MN_PAGE_BYTES;
    void *to = x->sectors != NULL ? x->slots : bytes;
    if (extent.length_bytes == 0)
        return -EBADMSG;
    int64_t got = mni_in_read(in, extent.offset, to, extent.length_bytes);
    *read_bytes += got > 0 ? (uint64_t)got : 0;
    if (got < extent.length_bytes || x->sectors == NULL)
        return got;
    const bool sound =
        length_bytes <= x->block_bytes_max &&
        mni_extents_unpack(x, to, extent.length_bytes, bytes, (uint32_t)length_bytes);
    return sound ? (int64_t)length_bytes : -EBADMSG;
}

/* ---- whole files ---------------------------------------------------------------------------- */

mn_code mni_stored_open(mni_stored *s, const char *path, const mn_header *header, mn_status *st) {
    *s = (mni_stored){.in = {.fd = -1}};
    mn_code code = mni_in_open(&s->in, path, st);
    if (code == MN_OK && header->zstd_level > 0)
        code = mni_arena_open(&s->arena, mni_extents_need(header, 1), st);
    if (code == MN_OK)
        code = mni_extents_open(&s->extents, path, header, 1, &s->arena, st);
    if (code != MN_OK)
        mni_stored_close(s);
    return code;
}

mn_block_ref mni_stored_block(const mni_stored *s, uint32_t page) {
    unsigned char frame[MNI_FRAME_BYTES];
    mn_block_ref ref = {.id = page};
    if (s->extents.sectors != NULL) {
        ref = mni_extents_next(&s->extents, page);
        return ref.id == page ? ref : (mn_block_ref){0};
    }
    if (mni_in_read(&s->in, (uint64_t)page * MN_PAGE_BYTES, frame, sizeof frame) == sizeof frame)
        ref.pages = mni_frame_pages(frame);
    return ref;
}

void mni_stored_close(mni_stored *s) {
    mni_in_close(&s->in);
    mni_arena_close(&s->arena);
    *s = (mni_stored){.in = {.fd = -1}};
}

/* ---- making --------------------------------------------------------------------------------- */

static size_t context_bytes(uint32_t level, uint32_t length_max) {
    return ZSTD_estimateCCtxSize_usingCParams(ZSTD_getCParams((int)level, length_max, 0));
}

/* What the level means for such blocks, said once: shorter ones do not change it. */
static void set_level(ZSTD_CCtx *context, uint32_t level, uint32_t length_max) {
    const ZSTD_compressionParameters c = ZSTD_getCParams((int)level, length_max, 0);
    const struct {
        ZSTD_cParameter what;
        int value;
    } parameter[] = {
        {ZSTD_c_windowLog, (int)c.windowLog}, {ZSTD_c_chainLog, (int)c.chainLog},
        {ZSTD_c_hashLog, (int)c.hashLog},     {ZSTD_c_searchLog, (int)c.searchLog},
        {ZSTD_c_minMatch, (int)c.minMatch},   {ZSTD_c_targetLength, (int)c.targetLength},
        {ZSTD_c_strategy, (int)c.strategy}};
    /* A context in memory of our own begins without the usual defaults. */
    (void)ZSTD_CCtx_reset(context, ZSTD_reset_session_and_parameters);
    for (size_t i = 0; i < sizeof parameter / sizeof parameter[0]; i++) {
        size_t set = ZSTD_CCtx_setParameter(context, parameter[i].what, parameter[i].value);
        MN_ASSERT(!ZSTD_isError(set));
    }
}

size_t mni_presser_bytes(uint32_t level, uint32_t length_max) {
    return context_bytes(level, length_max) + (size_t)2 * length_max;
}

mn_code mni_presser_open(mni_presser *p, uint32_t level, uint32_t length_max, mn_status *st) {
    const size_t bytes = context_bytes(level, length_max);
    *p = (mni_presser){.length_max = length_max,
                       .room = malloc(length_max),
                       .out = malloc(length_max),
                       .memory = malloc(bytes)};
    if (p->room != NULL && p->out != NULL && p->memory != NULL) {
        p->context = ZSTD_initStaticCCtx(p->memory, bytes);
        MN_ASSERT(p->context != NULL);
        set_level(p->context, level, length_max);
        return MN_OK;
    }
    mni_presser_close(p);
    return mn_fail(st, MN_FAILED, "no memory to compress blocks of %u bytes", length_max);
}

uint32_t mni_presser_make(mni_presser *p, const void *block, uint32_t length_bytes,
                          const mni_rows_place *rows, const void **extent) {
    MN_ASSERT(length_bytes <= p->length_max && length_bytes % MNI_SECTOR_BYTES == 0);
    const unsigned char *from = block;
    head h = {0};
    if (rows->groups > 0) {
        const size_t planes_bytes = (size_t)rows->groups * rows->bits;
        MN_ASSERT(rows->at + planes_bytes <= length_bytes);
        memcpy(p->room, block, length_bytes);
        mni_planes_of_rows(from + rows->at, rows->groups, rows->bits, p->room + rows->at);
        h = (head){
            .rows_at = rows->at, .groups = (uint16_t)rows->groups, .bits = (uint16_t)rows->bits};
        from = p->room;
    }
    /* It must save a sector. */
    const size_t most = length_bytes - MNI_SECTOR_BYTES - MNI_EXTENT_HEAD_BYTES;
    size_t frame =
        ZSTD_compress2(p->context, p->out + MNI_EXTENT_HEAD_BYTES, most, from, length_bytes);
    if (ZSTD_isError(frame)) {
        *extent = block;
        return length_bytes;
    }
    h.frame_bytes = (uint32_t)frame;
    memcpy(p->out, &h, sizeof h);
    const uint32_t used = MNI_EXTENT_HEAD_BYTES + h.frame_bytes;
    const uint32_t extent_bytes = (uint32_t)round_up(used, MNI_SECTOR_BYTES);
    memset(p->out + used, 0, extent_bytes - used);
    *extent = p->out;
    return extent_bytes;
}

void mni_presser_close(mni_presser *p) {
    free(p->room);
    free(p->out);
    free(p->memory);
    memset(p, 0, sizeof *p);
}
