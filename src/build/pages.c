/* See pages.h. Secret: which page goes. */
#include "pages.h"

#include "mn_assert.h"

enum { WAYS = 8, ALIGN = 16 };
#define NO_PAGE UINT64_MAX

void mni_pages_open(mni_pages *p, mni_spill *spill, uint32_t record_bytes, uint32_t page_bytes,
                    uint64_t records, mni_arena *arena, uint64_t budget) {
    uint64_t per_page = page_bytes / record_bytes, pages = (records + per_page - 1) / per_page;
    size_t each = per_page * record_bytes + sizeof(mni_pages_slot);
    uint64_t sets = (budget - 2 * ALIGN) / each / WAYS, enough = (pages + WAYS - 1) / WAYS;
    *p = (mni_pages){.spill = spill,
                     .record_bytes = record_bytes,
                     .records = (uint32_t)per_page,
                     .sets = (uint32_t)(sets < enough ? sets : enough),
                     .last = NO_PAGE};
    MN_ASSERT(p->sets > 0 && p->records > 0);
    p->slot = mni_arena_take(arena, (size_t)p->sets * WAYS, sizeof *p->slot, ALIGN);
    p->bytes = mni_arena_take(arena, (size_t)p->sets * WAYS, per_page * record_bytes, ALIGN);
    for (uint32_t i = 0; i < p->sets * WAYS; i++)
        p->slot[i].page = NO_PAGE;
}

/* The slot of the set that is free, or was asked for before all others. */
static uint32_t oldest(const mni_pages *p, uint32_t first) {
    uint32_t best = first;
    for (uint32_t i = first; i < first + WAYS; i++) {
        if (p->slot[i].page == NO_PAGE)
            return i;
        if (p->now - p->slot[i].asked > p->now - p->slot[best].asked)
            best = i;
    }
    return best;
}

void *mni_pages_find(mni_pages *p, uint64_t page, bool change) {
    size_t bytes = (size_t)p->records * p->record_bytes;
    uint32_t first = (uint32_t)(page % p->sets) * WAYS, at = first;
    while (at < first + WAYS && p->slot[at].page != page)
        at++;
    if (at == first + WAYS) {
        at = oldest(p, first);
        mni_pages_slot *s = &p->slot[at];
        unsigned char *to = p->bytes + at * bytes;
        p->last = NO_PAGE;
        if (s->page != NO_PAGE && s->changed &&
            mni_spill_write_at(p->spill, s->page * bytes, to, bytes) != MN_OK)
            return NULL;
        *s = (mni_pages_slot){.page = NO_PAGE};
        if (mni_spill_read_some(p->spill, page * bytes, to, bytes) != MN_OK)
            return NULL;
        s->page = page;
    }
    p->slot[at].asked = ++p->now;
    p->slot[at].changed |= change;
    p->last = page;
    p->last_changed = p->slot[at].changed;
    p->last_bytes = p->bytes + at * bytes;
    return p->last_bytes;
}
