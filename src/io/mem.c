/* The arena: one anonymous mapping, carved and then sealed. The shelf: another, whose pages stay
 * with a thread. See mem.h.
 *
 * Hides: whose a block is, by its address, and which pages are there. Any thread; a shelf is its
 * thread's. */
#include "mem.h"

#include <errno.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "mn_assert.h"

enum { PAGE_BYTES = 4096 };
#ifndef MADV_POPULATE_WRITE /* Linux 5.14 */
#define MADV_POPULATE_WRITE 23
#endif

mn_code mni_arena_open(mni_arena *arena, size_t size_bytes, mn_status *st) {
    size_t size = (size_bytes + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
    void *base = mmap(NULL, size > 0 ? size : PAGE_BYTES, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (base == MAP_FAILED)
        return mn_fail(st, MN_FAILED, "cannot get %zu bytes of memory: %s; lower --ram or -K", size,
                       strerror(errno));
    *arena = (mni_arena){.base = base, .size_bytes = size};
    return MN_OK;
}

size_t mni_arena_need(size_t count, size_t size, size_t align) {
    return count * size + align - 1;
}

void *mni_arena_take(mni_arena *arena, size_t count, size_t size, size_t align) {
    MN_ASSERT(!arena->sealed);
    MN_ASSERT(align > 0 && (align & (align - 1)) == 0 && align <= PAGE_BYTES);
    size_t at = (arena->used_bytes + align - 1) & ~(align - 1);
    MN_ASSERT(size == 0 || count <= (arena->size_bytes - at) / size);
    arena->used_bytes = at + count * size;
    MN_ASSERT(arena->used_bytes <= arena->size_bytes);
    return arena->base + at;
}

void mni_arena_seal(mni_arena *arena) {
    MN_ASSERT(!arena->sealed);
    arena->sealed = true;
}

void mni_arena_close(mni_arena *arena) {
    if (arena->base != NULL)
        munmap(arena->base, arena->size_bytes);
    memset(arena, 0, sizeof *arena);
}

/* ---- a shelf -------------------------------------------------------------------------------- */

enum { LINE_BYTES = 64, HUGE_BYTES = 2 << 20 };

static _Thread_local mni_shelf *shelf_in_use;

void mni_shelf_open(mni_shelf *shelf, size_t size_bytes) {
    const size_t size = (size_bytes + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
    void *base = mmap(NULL, size, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
    *shelf = (mni_shelf){0};
    if (base != MAP_FAILED)
        *shelf = (mni_shelf){.base = base, .size_bytes = size};
    shelf_in_use = shelf;
}

void mni_shelf_close(mni_shelf *shelf) {
    MN_ASSERT(shelf->count == 0 && shelf_in_use == shelf);
    if (shelf->base != NULL)
        munmap(shelf->base, shelf->size_bytes);
    *shelf = (mni_shelf){0};
    shelf_in_use = NULL;
}

void mni_shelf_trim(mni_shelf *shelf, size_t bytes) {
    const size_t taken = shelf->count > 0 ? shelf->block[shelf->count - 1].to : 0;
    const size_t least = taken > bytes ? taken : bytes;
    const size_t from = (least + PAGE_BYTES - 1) / PAGE_BYTES * PAGE_BYTES;
    if (shelf->there_bytes <= from)
        return;
    (void)madvise(shelf->base + from, shelf->there_bytes - from, MADV_DONTNEED);
    shelf->there_bytes = from;
}

static void populate(unsigned char *p, size_t bytes) {
    const size_t before = (PAGE_BYTES - (uintptr_t)p % PAGE_BYTES) % PAGE_BYTES;
    if (bytes >= before + PAGE_BYTES)
        madvise(p + before, (bytes - before) / PAGE_BYTES * PAGE_BYTES, MADV_POPULATE_WRITE);
}

/* The first gap that is wide enough: before block *at. */
static bool find_gap(const mni_shelf *s, size_t bytes, uint32_t *at, size_t *from) {
    *from = 0;
    for (*at = 0; *at < s->count && s->block[*at].from - *from < bytes; ++*at)
        *from = s->block[*at].to;
    return s->count < MNI_SHELF_BLOCKS && bytes <= s->size_bytes - *from;
}

static void *take_off(mni_shelf *s, size_t bytes, size_t filled_bytes) {
    uint32_t at;
    size_t from;
    if (!find_gap(s, bytes, &at, &from))
        return NULL;
    memmove(&s->block[at + 1], &s->block[at], (s->count - at) * sizeof s->block[0]);
    s->block[at].from = from;
    s->block[at].to = from + bytes;
    s->count++;
    if (from + filled_bytes > s->there_bytes) {
        const size_t there = s->there_bytes > from ? s->there_bytes : from;
        populate(s->base + there, from + filled_bytes - there);
    }
    s->there_bytes = from + bytes > s->there_bytes ? from + bytes : s->there_bytes;
    return s->base + from;
}

/* Where collapses go all over a mesh, each access is a walk through page tables too if pages are
 * small: so what is long asks for huge ones inside it. */
static void *take_elsewhere(size_t bytes, size_t filled_bytes) {
    unsigned char *p = aligned_alloc(LINE_BYTES, bytes);
    if (p == NULL)
        return NULL;
    unsigned char *from = p + (HUGE_BYTES - (uintptr_t)p % HUGE_BYTES) % HUGE_BYTES;
    if (from + HUGE_BYTES <= p + filled_bytes)
        madvise(from, (size_t)(p + filled_bytes - from) / HUGE_BYTES * HUGE_BYTES, MADV_HUGEPAGE);
    populate(p, filled_bytes);
    return p;
}

void *mni_mem_take(size_t bytes, size_t filled_bytes) {
    const size_t whole =
        bytes > 0 ? (bytes + LINE_BYTES - 1) / LINE_BYTES * LINE_BYTES : LINE_BYTES;
    void *memory = shelf_in_use != NULL ? take_off(shelf_in_use, whole, filled_bytes) : NULL;
    return memory != NULL ? memory : take_elsewhere(whole, filled_bytes);
}

void *mni_mem_take_zeroed(size_t bytes) {
    void *memory = mni_mem_take(bytes, bytes);
    return memory != NULL ? memset(memory, 0, bytes) : NULL;
}

static bool is_on_shelf(const mni_shelf *s, const void *memory) {
    return s != NULL && (uintptr_t)memory - (uintptr_t)s->base < s->size_bytes;
}

void *mni_mem_grow(void *memory, size_t held_bytes, size_t bytes) {
    if (!is_on_shelf(shelf_in_use, memory))
        return realloc(memory, bytes);
    void *more = mni_mem_take(bytes, 0);
    if (more == NULL)
        return NULL;
    memcpy(more, memory, held_bytes);
    mni_mem_give(memory);
    return more;
}

void mni_mem_give(void *memory) {
    mni_shelf *s = shelf_in_use;
    if (!is_on_shelf(s, memory)) {
        free(memory);
        return;
    }
    const size_t from = (size_t)((unsigned char *)memory - s->base);
    uint32_t at = 0;
    while (at < s->count && s->block[at].from != from)
        at++;
    MN_ASSERT(at < s->count);
    memmove(&s->block[at], &s->block[at + 1], (--s->count - at) * sizeof s->block[0]);
}
