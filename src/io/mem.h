/* Memory that is counted, and that can be sealed; and memory that is taken again and again.
 *
 * A session allocates everything between open and seal (design.md §4): an arena of one mapping is
 * carved up front, by the plan's counts, and asking it for more after the seal is a bug.
 * Ownership: the arena owns all that it hands out; there is no free of single pieces.
 * Threads: one thread until the seal; after it nobody calls but mni_arena_close. */
#ifndef MNI_MEM_H
#define MNI_MEM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "metanode/status.h"

typedef struct mni_arena {
    unsigned char *base; /* page aligned, zeroed by the kernel */
    size_t size_bytes;   /* as reserved: the plan's sum */
    size_t used_bytes;
    bool sealed;
} mni_arena;

/* Maps size_bytes of zeroed memory (rounded up to pages). MN_FAILED when the kernel refuses. */
mn_code mni_arena_open(mni_arena *arena, size_t size_bytes, mn_status *st);
/* count × size bytes, zeroed, aligned to `align` (a power of two, at most 4096). Never NULL: the
 * plan has reserved it, so running out is a bug and asserts; so is a call after the seal. */
void *mni_arena_take(mni_arena *arena, size_t count, size_t size, size_t align);
void mni_arena_seal(mni_arena *arena);
void mni_arena_close(mni_arena *arena);
/* What mni_arena_take(count, size, align) uses at most; for the plan's sums. */
size_t mni_arena_need(size_t count, size_t size, size_t align);

/* ---- a shelf -------------------------------------------------------------------------------- */

/* Memory that one thread takes and gives back again and again: its pages stay, where the kernel
 * would take them away, bring others that are zeroed, and interrupt all other threads for it. What
 * is taken gets the first gap that is wide enough; when all has been given back there is one gap.
 * Zeroed: it has room for nothing. One thread's. */
enum { MNI_SHELF_BLOCKS = 64 };
typedef struct mni_shelf {
    unsigned char *base;
    size_t size_bytes;  /* address space; what does not fit is malloc's */
    size_t there_bytes; /* from base on: whose pages may be there */
    uint32_t count;
    struct {
        size_t from, to;
    } block[MNI_SHELF_BLOCKS]; /* by place */
} mni_shelf;

/* The calling thread's from now on. Without address space all is malloc's. */
void mni_shelf_open(mni_shelf *shelf, size_t size_bytes);
/* All has been given back; the thread has none any more. */
void mni_shelf_close(mni_shelf *shelf);
/* Gives the kernel the pages behind so many bytes and what is taken. */
void mni_shelf_trim(mni_shelf *shelf, size_t bytes);

/* Of whole cache lines, from the thread's shelf or from malloc. filled_bytes: so many will be
 * written to from end to end; if their pages are not there they come at once, and not by a fault
 * each. NULL: there is no memory. */
void *mni_mem_take(size_t bytes, size_t filled_bytes);
/* The same, all 0. */
void *mni_mem_take_zeroed(size_t bytes);
/* More of what was taken; held_bytes of it stay. NULL: there is none, and it is as it was. */
void *mni_mem_grow(void *memory, size_t held_bytes, size_t bytes);
/* By the thread that has taken it. NULL is harmless. */
void mni_mem_give(void *memory);

#endif
