/* Numbers of slots, of simplices: who comes gets one near its kin.
 *
 * A split's second child stands in the same page of 64 numbers as the first, its simplices in that
 * of the simplices around them; so what is small enough that several share a line of the cache
 * (distances, radii, corners of simplices) is shared by neighbours, who have their turns one after
 * the other. Hides: which free number somebody gets.
 *
 *   its own page ──full──> the spill page ──full──> a page that is nearly empty
 *                                          ──none──> a page that nobody has been in
 *                                          ──none──> any that is vacant
 *
 * Who spills in one pass goes to one page, and passes go by place: so a page that neighbours spill
 * to is their children's own. A stack of free numbers, as it was, deals out those of all places.
 *
 * Order of calls: open; then take, and give of what was taken. Threads: Navigate only. Memory: from
 * the arena, a bit a number and a byte a page. Paper: none. */
#include "vacancy.h"

#include <string.h>

#include "mn_assert.h"
#include "metanode/format.h"

enum {
    SEEK = 1024,       /* pages looked through for one that is nearly empty */
    NEARLY_EMPTY = 48, /* numbers free */
    AT_ONCE = 8,       /* counts looked at */
};

static uint32_t words(uint32_t max) {
    return (uint32_t)(((uint64_t)max + MNI_VACANCY_PAGE - 1) / MNI_VACANCY_PAGE);
}

/* Whole words of counts, the last ones 0: nobody is free there. */
static uint32_t counts(uint32_t max) {
    return (words(max) + AT_ONCE - 1) / AT_ONCE * AT_ONCE;
}

size_t mni_vacancy_need(uint32_t max) {
    return mni_arena_need(words(max), sizeof(uint64_t), 64) +
           mni_arena_need(counts(max), sizeof(uint8_t), 64);
}

void mni_vacancy_open(mni_vacancy *v, uint32_t max, mni_arena *arena) {
    *v = (mni_vacancy){.max = max};
    v->free = mni_arena_take(arena, words(max), sizeof *v->free, 64);
    v->count = mni_arena_take(arena, counts(max), sizeof *v->count, 64);
}

static uint32_t page_open(mni_vacancy *v) {
    const uint32_t page = v->pages++, left = v->max - page * MNI_VACANCY_PAGE;
    v->free[page] = left < 64 ? (UINT64_C(1) << left) - 1 : UINT64_MAX;
    v->count[page] = left < 64 ? (uint8_t)left : 64;
    return page;
}

/* Of the next pages after the spill page, round the end, the first with so many free; MN_NONE:
 * there is none. Counts are at most 64, so a sum's high bit tells. */
static uint32_t page_with(const mni_vacancy *v, uint32_t least, uint32_t seek) {
    const uint64_t bytes = UINT64_C(0x0101010101010101);
    const uint32_t groups = counts(v->pages * MNI_VACANCY_PAGE) / AT_ONCE;
    uint32_t group = v->spill / AT_ONCE;
    for (uint32_t i = 0; i < groups && i * AT_ONCE < seek; i++) {
        uint64_t count;
        group = group + 1 < groups ? group + 1 : 0;
        memcpy(&count, v->count + (size_t)AT_ONCE * group, sizeof count);
        const uint64_t enough = (count + (128 - least) * bytes) & (128 * bytes);
        if (enough != 0)
            return AT_ONCE * group + (uint32_t)__builtin_ctzll(enough) / 8;
    }
    return MN_NONE;
}

static uint32_t page_next(mni_vacancy *v) {
    uint32_t page = page_with(v, NEARLY_EMPTY, SEEK);
    if (page == MN_NONE && v->pages < words(v->max))
        page = page_open(v);
    if (page == MN_NONE)
        page = page_with(v, 1, UINT32_MAX);
    MN_ASSERT(page != MN_NONE);
    return page;
}

uint32_t mni_vacancy_spill(mni_vacancy *v) {
    if (v->pages == 0 || v->count[v->spill] == 0)
        v->spill = page_next(v);
    return mni_vacancy_take(v, v->spill * MNI_VACANCY_PAGE);
}

void mni_vacancy_check(const mni_vacancy *v, uint32_t taken) {
    uint32_t free = 0;
    for (uint32_t page = 0; page < words(v->max); page++) {
        MN_ASSERT(page < v->pages || v->count[page] == 0);
        MN_ASSERT(v->count[page] == __builtin_popcountll(v->free[page]));
        free += v->count[page];
    }
    MN_ASSERT(taken == mni_vacancy_high(v) - free);
}
