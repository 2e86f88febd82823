/* A table in a temporary file, some pages of which are in memory: for who asks for records near
 * those that were asked for lately.
 *
 *   open ── at × n (all reading, or some writing) ── close
 *
 * Sets of a few pages; in each the one goes that has not been asked for the longest. What was
 * changed is written when it goes, never otherwise: a table that fits stays off the disk. Memory:
 * the caller's arena. One thread; calls may block on the disk. */
#ifndef MNI_PAGES_H
#define MNI_PAGES_H

#include "mem.h"
#include "spill.h"

typedef struct mni_pages_slot {
    uint64_t page; /* UINT64_MAX: none */
    uint32_t asked;
    bool changed;
} mni_pages_slot;

typedef struct mni_pages {
    mni_spill *spill;
    uint32_t record_bytes, records; /* a page's */
    uint32_t sets, now;
    mni_pages_slot *slot;
    unsigned char *bytes;
    uint64_t last; /* page asked for last */
    bool last_changed;
    unsigned char *last_bytes;
} mni_pages;

/* Takes all but a little of `budget` from the arena, and never more. */
void mni_pages_open(mni_pages *p, mni_spill *spill, uint32_t record_bytes, uint32_t page_bytes,
                    uint64_t records, mni_arena *arena, uint64_t budget);
enum { MNI_PAGES_BUDGET_MIN = 64 << 10 };

void *mni_pages_find(mni_pages *p, uint64_t page, bool change);
/* Record `index`, where it stays until the next call; zero where nothing was written. NULL: the
 * spill has failed. change: it is going to be written to. */
static inline void *mni_pages_at(mni_pages *p, uint64_t index, bool change) {
    uint64_t page = index / p->records;
    bool is_last = page == p->last && (!change || p->last_changed);
    unsigned char *bytes = is_last ? p->last_bytes : mni_pages_find(p, page, change);
    return bytes == NULL ? NULL : bytes + (index - page * p->records) * p->record_bytes;
}

#endif
