/* Stores `resident` and `mapped`: the whole file as one range of memory.
 *
 * Secret: a block's address is its offset. `resident` reads the file at start, unpacks what is
 * compressed, and checks every block that the roots reach: a damaged inner block is absent for
 * ever. `mapped` maps it and leaves
 * it to the operating system (the paper's Virt., with MADV_RANDOM so that only what is touched is
 * read); a block is checked when it comes into use, since the page cache may have let go of it in
 * between, and a damaged one is tried again after 1, 2, 4 … 64 frames. Nothing is ever refused.
 *
 * A file that is cut short while it is mapped would raise SIGBUS: its size is looked at each time a
 * block comes into use, which leaves a moment open and no more can be done. Nor is there a defence
 * against bytes that somebody else overwrites in place after they were checked. Files here are
 * written under another name and renamed, never shortened nor overwritten; where that cannot be
 * relied on, use `paged`, which checks a copy of its own.
 *
 * Navigate only. Memory: `resident` takes the file's size from the arena and 4 bytes a block for
 * the walk at start; both take a byte a page, or the table of failures. */
#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include "mn_assert.h"
#include "extents.h"
#include "failures.h"
#include "file.h"
#include "frame.h"
#include "store_kind.h"

enum {
    READ_BYTES = 1 << 20, /* at start: large enough for any disk, small enough to bisect errors */
    WARNINGS_MAX = 8,     /* lines on damaged blocks; after that they are only counted */
};

typedef struct flat {
    /* const after open */
    mni_store_desc desc;
    const mn_header *header;
    mni_in file;
    const unsigned char *base; /* the file's first byte */
    bool mapped;
    unsigned char *sound; /* resident: a byte a page: 1 where a sound block begins */
    /* Navigate only */
    mni_failures failures; /* mapped */
    uint64_t frame;
    uint32_t warnings;
    mn_session_stats stats;
} flat;

static uint64_t pages_of(const mn_header *header) {
    return header->file_bytes / MN_PAGE_BYTES;
}

static const void *bytes_at(const flat *f, mn_block_ref ref) {
    return f->base + (uint64_t)ref.id * MN_PAGE_BYTES;
}

/* ---- damage --------------------------------------------------------------------------------- */

static const char *fault_of(const flat *f, mn_block_ref ref, uint32_t parent_id, bool overflow) {
    const void *bytes = bytes_at(f, ref);
    mni_frame_fault fault = mni_frame_check(bytes, ref, f->header->build_id, f->header->file_bytes);
    if (fault != MNI_FRAME_OK)
        return mni_frame_fault_text(fault);
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    if ((frame.kind == MNI_FRAME_OVERFLOW) != overflow ||
        (!overflow && frame.parent_id != parent_id))
        return "it is not what its parent says it is";
    if (f->desc.check != NULL &&
        !f->desc.check(f->desc.check_context, bytes, ref.pages * MN_PAGE_BYTES))
        return "its contents contradict themselves";
    return NULL;
}

static void report(flat *f, uint32_t block_id, const char *why) {
    f->stats.checksum_failures++;
    if (f->desc.warn == NULL || f->warnings > WARNINGS_MAX)
        return;
    mn_status line = {0};
    if (f->warnings++ < WARNINGS_MAX)
        mn_fail(&line, MN_BAD_INPUT, "%s: block %u: %s; shown with less detail there", f->desc.path,
                block_id, why);
    else
        mn_fail(&line, MN_BAD_INPUT, "%s: further damaged blocks are counted and not named",
                f->desc.path);
    f->desc.warn(f->desc.warn_context, line.text);
}

/* ---- open ----------------------------------------------------------------------------------- */

static mn_code open_file(flat *f, const mni_store_desc *desc, bool mapped, mn_status *st) {
    f->desc = *desc;
    f->header = desc->header;
    f->mapped = mapped;
    mn_code code = mni_in_open(&f->file, desc->path, st);
    if (code != MN_OK)
        return code;
    if (f->file.size_bytes < mni_stored_bytes(f->header)) {
        mni_in_close(&f->file);
        return mn_fail(st, MN_BAD_INPUT, "%s: has %llu bytes of %llu; copy or build it again",
                       desc->path, (unsigned long long)f->file.size_bytes,
                       (unsigned long long)mni_stored_bytes(f->header));
    }
    return MN_OK;
}

static mn_code root_damaged(const flat *f, uint32_t r, const char *why, mn_status *st) {
    return mn_fail(st, MN_BAD_INPUT, "%s: root block %u: %s; copy or build the file again",
                   f->desc.path, f->header->root[r].block.id, why);
}

static void flat_close(void *self) {
    flat *f = self;
    if (f->mapped)
        munmap((void *)(uintptr_t)f->base, f->header->file_bytes);
    mni_in_close(&f->file);
}

static size_t mapped_need_bytes(const mn_header *header, uint32_t k) {
    (void)header, (void)k;
    return mni_arena_need(1, sizeof(flat), _Alignof(flat)) + mni_failures_need();
}

static mn_code mapped_open(const mni_store_desc *desc, mni_arena *arena, void **out,
                           mn_status *st) {
    flat *f = mni_arena_take(arena, 1, sizeof *f, _Alignof(flat));
    mni_failures_open(&f->failures, arena);
    MN_ASSERT(desc->header->zstd_level == 0); /* mni_store_can */
    mn_code code = open_file(f, desc, true, st);
    if (code != MN_OK)
        return code;
    void *base = mmap(NULL, f->header->file_bytes, PROT_READ, MAP_SHARED, f->file.fd, 0);
    if (base == MAP_FAILED) {
        mni_in_close(&f->file);
        return mn_fail(st, MN_FAILED, "%s: cannot map: %s; try another --store", desc->path,
                       strerror(errno));
    }
    f->base = base;
    (void)madvise(base, f->header->file_bytes, MADV_RANDOM); /* advice; refused it is only slower */
    for (uint32_t r = 0; r < f->header->roots && code == MN_OK; r++) {
        const char *why = fault_of(f, f->header->root[r].block, 0, false);
        if (why != NULL)
            code = root_damaged(f, r, why, st);
    }
    if (code != MN_OK)
        flat_close(f);
    else
        *out = f;
    return code;
}

static size_t resident_need_bytes(const mn_header *header, uint32_t k) {
    (void)k;
    return mni_arena_need(1, sizeof(flat), _Alignof(flat)) +
           mni_arena_need(header->file_bytes, 1, MN_PAGE_BYTES) +
           mni_arena_need(pages_of(header), 1, 1) +
           mni_arena_need(header->blocks, sizeof(mn_block_ref), _Alignof(mn_block_ref)) +
           mni_extents_need(header, 1);
}

/* Pages that cannot be read stay zero: no block begins like that. */
static void read_range(flat *f, unsigned char *base, uint64_t from, uint64_t count) {
    int64_t got = mni_in_read(&f->file, from, base + from, count);
    if (got >= 0) {
        f->stats.reads++;
        f->stats.read_bytes += (uint64_t)got;
        return;
    }
    f->stats.io_errors++;
    memset(base + from, 0, count);
    for (uint64_t page = 0; count > MN_PAGE_BYTES && page < count; page += MN_PAGE_BYTES)
        if (mni_in_read(&f->file, from + page, base + from + page, MN_PAGE_BYTES) < 0)
            memset(base + from + page, 0, MN_PAGE_BYTES);
}

/* The file as it would be if nothing were compressed. What cannot be read or unpacked stays zero.
 */
static mn_code unpack_all(flat *f, unsigned char *base, mni_arena *arena, mn_status *st) {
    mni_extents extents;
    mn_code code = mni_extents_open(&extents, f->desc.path, f->header, 1, arena, st);
    mn_block_ref ref = {0};
    while (code == MN_OK && (ref = mni_extents_next(&extents, ref.id + ref.pages)).pages > 0) {
        unsigned char *bytes = base + (uint64_t)ref.id * MN_PAGE_BYTES;
        const int64_t got = mni_extents_read(&extents, &f->file, ref, bytes, &f->stats.read_bytes);
        f->stats.reads++;
        f->stats.io_errors += got < 0 && got != -EBADMSG;
        if (got < 0)
            memset(bytes, 0, (size_t)ref.pages * MN_PAGE_BYTES);
    }
    return code;
}

/* Walks the blocks from the roots and marks the sound ones. A file that has more blocks than its
 * header says, or refers to one twice, loses those that come last. */
static mn_code mark_sound(flat *f, mn_block_ref *queue, mn_status *st) {
    uint32_t count = 0;
    for (uint32_t r = 0; r < f->header->roots; r++) {
        mn_block_ref ref = f->header->root[r].block;
        const char *why = f->sound[ref.id] ? NULL : fault_of(f, ref, 0, false);
        if (why != NULL)
            return root_damaged(f, r, why, st);
        if (!f->sound[ref.id] && count < f->header->blocks)
            queue[count++] = ref;
        f->sound[ref.id] = 1;
    }
    for (uint32_t at = 0; at < count; at++) {
        const void *bytes = bytes_at(f, queue[at]);
        mni_frame frame;
        mni_frame_get(bytes, &frame);
        for (uint32_t i = 0; i < frame.refs && count < f->header->blocks; i++) {
            mn_block_ref ref = mni_frame_ref(bytes, i);
            if (f->sound[ref.id] ||
                ref.pages * (uint64_t)MN_PAGE_BYTES > f->header->block_bytes_max)
                continue;
            const char *as_block = fault_of(f, ref, queue[at].id, false);
            if (as_block != NULL && fault_of(f, ref, queue[at].id, true) != NULL) {
                report(f, ref.id, as_block);
                continue;
            }
            f->sound[ref.id] = 1;
            queue[count++] = ref;
        }
    }
    return MN_OK;
}

static mn_code resident_open(const mni_store_desc *desc, mni_arena *arena, void **out,
                             mn_status *st) {
    flat *f = mni_arena_take(arena, 1, sizeof *f, _Alignof(flat));
    const mn_header *header = desc->header;
    unsigned char *base = mni_arena_take(arena, header->file_bytes, 1, MN_PAGE_BYTES);
    f->sound = mni_arena_take(arena, pages_of(header), 1, 1);
    mn_block_ref *queue =
        mni_arena_take(arena, header->blocks, sizeof *queue, _Alignof(mn_block_ref));
    mn_code code = open_file(f, desc, false, st);
    if (code != MN_OK)
        return code;
    if (header->zstd_level > 0)
        code = unpack_all(f, base, arena, st);
    for (uint64_t from = 0; header->zstd_level == 0 && from < header->file_bytes;
         from += READ_BYTES) {
        uint64_t left = header->file_bytes - from;
        read_range(f, base, from, left < READ_BYTES ? left : READ_BYTES);
    }
    f->base = base;
    if (code == MN_OK)
        code = mark_sound(f, queue, st);
    if (code != MN_OK)
        flat_close(f);
    else
        *out = f;
    return code;
}

/* ---- into use ------------------------------------------------------------------------------- */

static bool size_still_holds(const flat *f) {
    struct stat info;
    return fstat(f->file.fd, &info) == 0 && (uint64_t)info.st_size >= f->header->file_bytes;
}

static bool is_sound(flat *f, const mni_wish *wish) {
    bool overflow = wish->way == MNI_WAY_OVERFLOW;
    uint32_t id = wish->ref.id;
    if (!f->mapped) {
        mni_frame frame;
        if (!f->sound[id])
            return false;
        mni_frame_get(bytes_at(f, wish->ref), &frame);
        return (frame.kind == MNI_FRAME_OVERFLOW) == overflow &&
               (overflow || frame.parent_id == wish->parent.id);
    }
    if (!mni_failures_due(&f->failures, id, f->frame))
        return false;
    const char *why = size_still_holds(f) ? fault_of(f, wish->ref, wish->parent.id, overflow)
                                          : "the file has been cut short";
    if (why == NULL) {
        mni_failures_forget(&f->failures, id);
        return true;
    }
    if (mni_failures_add(&f->failures, id, f->frame))
        report(f, id, why);
    else
        f->stats.checksum_failures++;
    return false;
}

static mni_answer flat_enter(void *self, const mni_wish *wish, const void **bytes) {
    flat *f = self;
    if (!is_sound(f, wish))
        return MNI_ABSENT;
    *bytes = bytes_at(f, wish->ref);
    return MNI_GRANTED;
}

static void flat_leave(void *self, uint32_t block_id, bool gone) {
    (void)self, (void)block_id, (void)gone;
}

static void flat_frame_begin(void *self) {
    ((flat *)self)->frame++;
}

static void flat_frame_end(void *self, double frame_s) {
    (void)self, (void)frame_s;
}

static void flat_drain(void *self) {
    (void)self;
}

static uint32_t flat_pending(void *self) {
    (void)self;
    return 0;
}

static uint64_t flat_epoch(const void *self) {
    (void)self;
    return 0; /* nothing is ever refused */
}

static uint32_t flat_resident(void *self, uint32_t in_use) {
    flat *f = self;
    return f->mapped ? in_use : f->header->blocks;
}

static void flat_stats(void *self, mn_session_stats *out) {
    const mn_session_stats *own = &((flat *)self)->stats;
    out->reads = own->reads;
    out->read_bytes = own->read_bytes;
    out->checksum_failures = own->checksum_failures;
    out->io_errors = own->io_errors;
}

static void flat_check(void *self, mni_usage_of usage_of, const void *context) {
    (void)self, (void)usage_of, (void)context;
}

static uint32_t flat_entries_max(const mn_header *header, uint32_t k) {
    (void)k;
    return header->blocks;
}

/* They differ in how they open, and in what that takes. */
#define FLAT_KIND(need, opened)                                                                    \
    {                                                                                              \
        .need_bytes = need, .entries_max = flat_entries_max, .open = opened, .close = flat_close,  \
        .enter = flat_enter, .leave = flat_leave, .overflow = flat_enter,                          \
        .frame_begin = flat_frame_begin, .frame_end = flat_frame_end, .drain = flat_drain,         \
        .pending = flat_pending, .epoch = flat_epoch, .resident = flat_resident,                   \
        .stats = flat_stats, .check = flat_check,                                                  \
    }
const mni_store_kind mni_store_mapped = FLAT_KIND(mapped_need_bytes, mapped_open);
const mni_store_kind mni_store_resident = FLAT_KIND(resident_need_bytes, resident_open);
