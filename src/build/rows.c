/* Rows of a tree, in memory or through a cache of pages.
 *
 * Hides: pages. A page is so many rows or simplices, so that none lies across two; or so many
 * places of packed ones. All kinds share the slots, and a clock gives up the first page that has
 * not been asked for since it last came by. Pages are small: what is read of the upper parts of a
 * tree lies far apart, a row here and there.
 *
 *     slot   0   1   2   3  …            bucket of a page ──► slot ──► slot (mni_rows_slot.next)
 *           └ recent? keep it once more ─┘ hand ──►
 *
 * Order: open, any reads, close. Any thread: pages are copied from under the lock, reads of the
 * disk included, for they are rare. Who asks for row after row keeps copies of some pages, each in
 * the one place that its number gives it, and needs no lock for these. Memory: cache_bytes; 210 kB
 * for copies. */
#include "rows.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "mn_assert.h"
#include "rowpack.h"

enum {
    PAGE_BYTES = MNI_ROWS_PAGE * sizeof(mni_row), /* a slot's */
    PLACES_PAGE = PAGE_BYTES / sizeof(uint64_t),
    SLOTS_LEAST = 16,
    SLOTS_MOST = 1 << 24,
};
_Static_assert(MNI_SIMPLICES_PAGE * sizeof(mni_row_simplex) <= PAGE_BYTES, "all fit a slot");

typedef enum page_kind { PAGE_OF_ROWS = 0, PAGE_OF_SIMPLICES, PAGE_OF_PLACES } page_kind;

/* ---- open and close ------------------------------------------------------------------------- */

mn_code mni_rows_open(mni_rows *rows, const mni_rows_source *source, uint64_t cache_bytes,
                      mn_status *st) {
    *rows = (mni_rows){.source = *source};
    if (source->row != NULL)
        return MN_OK;
    /* a bucket a slot, or up to two */
    uint64_t slots = cache_bytes / (PAGE_BYTES + sizeof *rows->slot + 2 * sizeof *rows->bucket);
    uint64_t pages = mni_rows_pages(source->rows) + mni_simplices_pages(source->simplices);
    pages += pages / PLACES_PAGE + 1;
    slots = slots > pages ? pages : slots;
    slots = slots < SLOTS_LEAST ? SLOTS_LEAST : slots > SLOTS_MOST ? SLOTS_MOST : slots;
    rows->slots = (uint32_t)slots;
    rows->buckets = 2;
    while (rows->buckets < rows->slots)
        rows->buckets *= 2;
    rows->slot = malloc(sizeof *rows->slot * rows->slots);
    rows->bytes = malloc((size_t)PAGE_BYTES * rows->slots);
    rows->bucket = malloc(sizeof *rows->bucket * rows->buckets);
    mni_lock_open(&rows->lock);
    if (rows->slot == NULL || rows->bytes == NULL || rows->bucket == NULL) {
        mni_rows_close(rows);
        return mn_fail(st, MN_FAILED, "no memory to keep %llu bytes of a tree",
                       (unsigned long long)(slots * PAGE_BYTES));
    }
    memset(rows->bucket, 0xff, sizeof *rows->bucket * rows->buckets);
    return MN_OK;
}

void mni_rows_close(mni_rows *rows) {
    if (rows->buckets > 0)
        mni_lock_close(&rows->lock);
    free(rows->slot);
    free(rows->bytes);
    free(rows->bucket);
    memset(rows, 0, sizeof *rows);
}

mn_code mni_rows_trouble(mni_rows *rows, mn_status *st) {
    if (rows->buckets == 0)
        return MN_OK;
    mni_lock_take(&rows->lock);
    mn_status trouble = rows->trouble;
    mni_lock_give(&rows->lock);
    return trouble.code == MN_OK ? MN_OK : mn_fail(st, trouble.code, "%s", trouble.text);
}

uint64_t mni_rows_stamp(int fd) {
    struct stat info;
    if (fstat(fd, &info) != 0)
        return 1;
    return ((uint64_t)info.st_ctim.tv_sec * 1000000000u + (uint64_t)info.st_ctim.tv_nsec) | 1;
}

/* ---- pages: under the lock ------------------------------------------------------------------- */

static bool read_bytes(mni_rows *rows, uint64_t offset, unsigned char *to, size_t wanted) {
    const mni_rows_source *s = &rows->source;
    while (wanted > 0) {
        ssize_t got = pread(s->fd, to, wanted, (off_t)offset);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0) {
            mn_fail(&rows->trouble, MN_FAILED, "%s: cannot read the tree at byte %llu: %s",
                    s->name != NULL ? s->name : "temporary file", (unsigned long long)offset,
                    got < 0 ? strerror(errno) : "the file ends there");
            return false;
        }
        to += got;
        offset += (uint64_t)got;
        wanted -= (size_t)got;
        rows->bytes_read += (uint64_t)got;
    }
    /* what was checked when it was first looked at is trusted from then on */
    if (s->stamp != 0 && s->stamp != mni_rows_stamp(s->fd)) {
        mn_fail(&rows->trouble, MN_BAD_INPUT, "%s: was changed while it was read; try again",
                s->name != NULL ? s->name : "temporary file");
        return false;
    }
    return true;
}

static uint32_t items_of_page(page_kind kind) {
    return kind == PAGE_OF_ROWS        ? MNI_ROWS_PAGE
           : kind == PAGE_OF_SIMPLICES ? MNI_SIMPLICES_PAGE
                                       : PLACES_PAGE;
}

static size_t bytes_of_item(page_kind kind) {
    return kind == PAGE_OF_ROWS        ? sizeof(mni_row)
           : kind == PAGE_OF_SIMPLICES ? sizeof(mni_row_simplex)
                                       : sizeof(uint64_t);
}

static uint64_t items_of(const mni_rows_source *s, page_kind kind) {
    return kind == PAGE_OF_ROWS        ? s->rows
           : kind == PAGE_OF_SIMPLICES ? s->simplices
                                       : mni_rowpack_places(s->rows, s->simplices);
}

static uint64_t offset_of(const mni_rows_source *s, page_kind kind) {
    return kind == PAGE_OF_ROWS        ? s->row_offset
           : kind == PAGE_OF_SIMPLICES ? s->simplex_offset
                                       : s->places_offset;
}

/* Where a packed page begins and ends. */
typedef struct place {
    uint64_t from, to;
} place;

/* packed: NULL where pages are as they are. */
static bool read_page(mni_rows *rows, page_kind kind, uint32_t page, const place *packed,
                      unsigned char *to) {
    const mni_rows_source *s = &rows->source;
    const uint64_t each = items_of_page(kind), all = items_of(s, kind), first = page * each;
    const uint32_t count = (uint32_t)(all - first < each ? all - first : each);
    unsigned char bytes[MNI_PAGE_PACKED_MAX];
    MN_ASSERT(first < all);
    if (packed == NULL)
        return read_bytes(rows, offset_of(s, kind) + first * bytes_of_item(kind), to,
                          count * bytes_of_item(kind));
    MN_ASSERT(packed->to - packed->from <= sizeof bytes); /* our own file */
    if (!read_bytes(rows, packed->from, bytes, (size_t)(packed->to - packed->from)))
        return false;
    if (kind == PAGE_OF_ROWS)
        mni_rows_unpack(bytes, (mni_row *)(void *)to, (uint32_t)first, count, s->grid_step);
    else
        mni_simplices_unpack(bytes, (mni_row_simplex *)(void *)to, count);
    return true;
}

static uint32_t *bucket_of(mni_rows *rows, uint64_t page) {
    return &rows->bucket[(page * UINT64_C(0x9e3779b97f4a7c15) >> 32) & (rows->buckets - 1)];
}

static void unlink_slot(mni_rows *rows, uint32_t at) {
    uint32_t *link = bucket_of(rows, rows->slot[at].page);
    while (*link != at) {
        MN_ASSERT(*link != MN_NONE);
        link = &rows->slot[*link].next;
    }
    *link = rows->slot[at].next;
}

/* A slot for another page; in no bucket. */
static uint32_t free_slot(mni_rows *rows) {
    if (rows->used < rows->slots)
        return rows->used++;
    for (;; rows->hand = (rows->hand + 1) % rows->slots) {
        mni_rows_slot *s = &rows->slot[rows->hand];
        if (!s->recent)
            break;
        s->recent = false;
    }
    uint32_t at = rows->hand;
    rows->hand = (rows->hand + 1) % rows->slots;
    unlink_slot(rows, at);
    return at;
}

static bool find_place(mni_rows *rows, page_kind kind, uint32_t number, place *at);

/* Its bytes stay until the lock is given back or another page is asked for. NULL: trouble. */
static const unsigned char *page_at(mni_rows *rows, page_kind kind, uint32_t number) {
    const bool is_packed = rows->source.places_offset > 0 && kind != PAGE_OF_PLACES;
    place packed;
    uint64_t page = (uint64_t)kind << 32 | number;
    uint32_t *bucket = bucket_of(rows, page);
    for (uint32_t at = *bucket; at != MN_NONE; at = rows->slot[at].next)
        if (rows->slot[at].page == page) {
            rows->slot[at].recent = true;
            return rows->bytes + (size_t)at * PAGE_BYTES;
        }
    if (rows->trouble.code != MN_OK || (is_packed && !find_place(rows, kind, number, &packed)))
        return NULL;
    uint32_t at = free_slot(rows);
    unsigned char *bytes = rows->bytes + (size_t)at * PAGE_BYTES;
    /* a page that could not be read is nobody's, and there will be no other */
    bool done = read_page(rows, kind, number, is_packed ? &packed : NULL, bytes);
    rows->slot[at] = (mni_rows_slot){done ? page : UINT64_MAX, MN_NONE, true};
    bucket = bucket_of(rows, rows->slot[at].page);
    rows->slot[at].next = *bucket;
    *bucket = at;
    return done ? bytes : NULL;
}

static bool find_place(mni_rows *rows, page_kind kind, uint32_t number, place *at) {
    uint64_t index = number, found[2];
    if (kind == PAGE_OF_SIMPLICES)
        index += mni_rows_pages(rows->source.rows);
    for (int i = 0; i < 2; i++) {
        const unsigned char *page =
            page_at(rows, PAGE_OF_PLACES, (uint32_t)((index + (uint64_t)i) / PLACES_PAGE));
        if (page == NULL)
            return false;
        memcpy(&found[i], page + (index + (uint64_t)i) % PLACES_PAGE * sizeof *found,
               sizeof *found);
    }
    *at = (place){found[0], found[1]};
    return true;
}

/* Copies items [first, end) of a kind. */
static bool copy(mni_rows *rows, page_kind kind, uint32_t first, uint32_t end, void *out) {
    const uint32_t each = items_of_page(kind);
    const size_t size = bytes_of_item(kind);
    unsigned char *to = out;
    for (uint32_t at = first; at < end;) {
        uint32_t here = each - at % each;
        if (here > end - at)
            here = end - at;
        const unsigned char *page = page_at(rows, kind, at / each);
        if (page == NULL)
            return false;
        memcpy(to, page + at % each * size, here * size);
        to += here * size;
        at += here;
    }
    return true;
}

/* Where the simplices of the rows before `end` end. */
static bool simplices_end(mni_rows *rows, uint32_t end, uint32_t *simplex_end) {
    *simplex_end = rows->source.simplices;
    if (end == rows->source.rows)
        return true;
    const unsigned char *page = page_at(rows, PAGE_OF_ROWS, end / MNI_ROWS_PAGE);
    if (page == NULL)
        return false;
    const mni_row *row = (const mni_row *)(const void *)page + end % MNI_ROWS_PAGE;
    *simplex_end = row->simplex_start;
    return true;
}

/* ---- what callers see ----------------------------------------------------------------------- */

bool mni_rows_get(mni_rows *rows, uint32_t at, mni_row *row, uint32_t *simplex_end) {
    const mni_rows_source *s = &rows->source;
    MN_ASSERT(at < s->rows);
    if (s->row != NULL) {
        *row = s->row[at];
        *simplex_end = at + 1 < s->rows ? s->row[at + 1].simplex_start : s->simplices;
        return true;
    }
    mni_lock_take(&rows->lock);
    bool done =
        copy(rows, PAGE_OF_ROWS, at, at + 1, row) && simplices_end(rows, at + 1, simplex_end);
    mni_lock_give(&rows->lock);
    return done;
}

bool mni_rows_copy(mni_rows *rows, bool simplices, uint32_t first, uint32_t end, void *out) {
    MN_ASSERT(rows->source.row == NULL && first <= end);
    mni_lock_take(&rows->lock);
    bool done = copy(rows, simplices ? PAGE_OF_SIMPLICES : PAGE_OF_ROWS, first, end, out);
    mni_lock_give(&rows->lock);
    return done;
}

const mni_row_simplex *mni_rows_simplices(mni_rows *rows, uint32_t first, uint32_t count,
                                          mni_row_simplex *room) {
    const mni_rows_source *s = &rows->source;
    if (first > s->simplices || count > s->simplices - first)
        return NULL;
    if (s->row != NULL)
        return s->simplex + first;
    mni_lock_take(&rows->lock);
    bool done = copy(rows, PAGE_OF_SIMPLICES, first, first + count, room);
    mni_lock_give(&rows->lock);
    return done ? room : NULL;
}

static bool room_for(void **room, uint32_t needed, uint32_t *capacity, size_t size) {
    if (needed <= *capacity && *room != NULL)
        return true;
    free(*room);
    *capacity = needed + needed / 4 + 16;
    *room = malloc(*capacity * size);
    if (*room == NULL)
        *capacity = 0;
    return *room != NULL;
}

static bool copy_run(mni_rows *rows, mni_rows_run *run, uint32_t simplices_max) {
    uint32_t count = run->end - run->first;
    if (!room_for((void **)&run->row_room, count, &run->row_capacity, sizeof *run->row_room) ||
        !copy(rows, PAGE_OF_ROWS, run->first, run->end, run->row_room) ||
        !simplices_end(rows, run->end, &run->simplex_end))
        return false;
    run->row = run->row_room;
    run->simplex_first = run->row[0].simplex_start;
    count = run->simplex_end - run->simplex_first;
    if (run->simplex_end > rows->source.simplices || run->simplex_first > run->simplex_end ||
        count > simplices_max)
        return true;
    if (!room_for((void **)&run->simplex_room, count, &run->simplex_capacity,
                  sizeof *run->simplex_room) ||
        !copy(rows, PAGE_OF_SIMPLICES, run->simplex_first, run->simplex_end, run->simplex_room))
        return false;
    run->simplex = run->simplex_room;
    return true;
}

bool mni_rows_fill_run(mni_rows *rows, uint32_t first, uint32_t end, uint32_t simplices_max,
                       mni_rows_run *run) {
    const mni_rows_source *s = &rows->source;
    MN_ASSERT(first < end && end <= s->rows);
    run->first = first;
    run->end = end;
    run->simplex = NULL;
    if (s->row != NULL) {
        run->row = s->row + first;
        run->simplex_first = run->row[0].simplex_start;
        run->simplex_end = end < s->rows ? s->row[end].simplex_start : s->simplices;
        if (run->simplex_end <= s->simplices && run->simplex_first <= run->simplex_end &&
            run->simplex_end - run->simplex_first <= simplices_max)
            run->simplex = s->simplex + run->simplex_first;
        return true;
    }
    mni_lock_take(&rows->lock);
    bool done = copy_run(rows, run, simplices_max);
    if (!done && rows->trouble.code == MN_OK)
        mn_fail(&rows->trouble, MN_FAILED, "no memory for %u rows of a tree", end - first);
    mni_lock_give(&rows->lock);
    return done;
}

void mni_rows_run_free(mni_rows_run *run) {
    free(run->row_room);
    free(run->simplex_room);
    memset(run, 0, sizeof *run);
}

/* ---- a thread's own pages -------------------------------------------------------------------- */

bool mni_rows_near_open(mni_rows_near *near, mni_rows *rows) {
    *near = (mni_rows_near){.rows = rows};
    memset(near->page, 0xff, sizeof near->page);
    if (rows->source.row != NULL)
        return true;
    near->bytes = malloc((size_t)MNI_ROWS_NEAR_KINDS * MNI_ROWS_NEAR_PAGES * PAGE_BYTES);
    return near->bytes != NULL;
}

void mni_rows_near_close(mni_rows_near *near) {
    free(near->bytes);
    *near = (mni_rows_near){0};
}

/* As page_at, without the lock; the bytes stay until another page takes their place. */
static const unsigned char *near_page(mni_rows_near *near, page_kind kind, uint32_t number) {
    const uint32_t at = number % MNI_ROWS_NEAR_PAGES;
    unsigned char *bytes = near->bytes + ((size_t)kind * MNI_ROWS_NEAR_PAGES + at) * PAGE_BYTES;
    if (near->page[kind][at] == number)
        return bytes;
    mni_lock_take(&near->rows->lock);
    const unsigned char *page = page_at(near->rows, kind, number);
    if (page != NULL)
        memcpy(bytes, page, PAGE_BYTES);
    mni_lock_give(&near->rows->lock);
    near->page[kind][at] = page != NULL ? number : MN_NONE;
    return page != NULL ? bytes : NULL;
}

bool mni_rows_near_get(mni_rows_near *near, uint32_t at, mni_row *row, uint32_t *simplex_end) {
    const mni_rows_source *s = &near->rows->source;
    MN_ASSERT(at < s->rows);
    if (s->row != NULL)
        return mni_rows_get(near->rows, at, row, simplex_end);
    const mni_row *page = (const void *)near_page(near, PAGE_OF_ROWS, at / MNI_ROWS_PAGE);
    if (page == NULL)
        return false;
    *row = page[at % MNI_ROWS_PAGE];
    *simplex_end = s->simplices;
    if (at + 1 == s->rows)
        return true;
    page = (const void *)near_page(near, PAGE_OF_ROWS, (at + 1) / MNI_ROWS_PAGE);
    if (page != NULL)
        *simplex_end = page[(at + 1) % MNI_ROWS_PAGE].simplex_start;
    return page != NULL;
}

const mni_row_simplex *mni_rows_near_simplices(mni_rows_near *near, uint32_t first, uint32_t count,
                                               mni_row_simplex *room) {
    const mni_rows_source *s = &near->rows->source;
    const uint32_t start = first % MNI_SIMPLICES_PAGE;
    if (s->row != NULL || first >= s->simplices || count > s->simplices - first ||
        start + count > MNI_SIMPLICES_PAGE)
        return mni_rows_simplices(near->rows, first, count, room);
    const mni_row_simplex *page =
        (const void *)near_page(near, PAGE_OF_SIMPLICES, first / MNI_SIMPLICES_PAGE);
    return page != NULL ? page + start : NULL;
}
