/* Memory that is counted, and that can be sealed.
 *
 * A session allocates everything between open and seal (design.md §4): an arena of one mapping is
 * carved up front, by the plan's counts, and asking it for more after the seal is a bug.
 * Ownership: the arena owns all that it hands out; there is no free of single pieces.
 * Threads: one thread until the seal; after it nobody calls but mni_arena_close. */
#ifndef MNI_MEM_H
#define MNI_MEM_H

#include <stdbool.h>
#include <stddef.h>

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
/* Memory that has just been taken and will be written to from end to end: its pages come at once,
 * where the kernel knows how, and not by a fault each. For haste alone. */
void mni_mem_populate(void *memory, size_t size_bytes);
/* What mni_arena_take(count, size, align) uses at most; for the plan's sums. */
size_t mni_arena_need(size_t count, size_t size, size_t align);

#endif
