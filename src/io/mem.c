/* The arena: one anonymous mapping, carved and then sealed; and pages in advance. See mem.h. */
#include "mem.h"

#include <errno.h>
#include <stdint.h>
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

void mni_mem_populate(void *memory, size_t size_bytes) {
    char *p = memory;
    size_t before = (PAGE_BYTES - (uintptr_t)p % PAGE_BYTES) % PAGE_BYTES;
    if (p == NULL || size_bytes < before + PAGE_BYTES)
        return;
    madvise(p + before, (size_bytes - before) / PAGE_BYTES * PAGE_BYTES, MADV_POPULATE_WRITE);
}
