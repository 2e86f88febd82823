/* Numbers of slots, of simplices: who comes gets one near its kin. See vacancy.c. */
#ifndef MNI_VACANCY_H
#define MNI_VACANCY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "mem.h"

enum { MNI_VACANCY_PAGE = 64 }; /* numbers: the bits of a word */

typedef struct mni_vacancy {
    uint32_t max;   /* numbers are below that; const after open */
    uint32_t pages; /* opened: their numbers are given out or free; others have never been */
    uint32_t spill; /* page for those whose own page is full */
    uint64_t *free; /* a bit a number, a word a page */
    uint8_t *count; /* of free numbers of a page */
} mni_vacancy;

size_t mni_vacancy_need(uint32_t max);
/* Nobody is there, and no page is open. max: at least 1. */
void mni_vacancy_open(mni_vacancy *v, uint32_t max, mni_arena *arena);

/* A bound of the numbers that there may be: all of the pages opened. */
static inline uint32_t mni_vacancy_high(const mni_vacancy *v) {
    const uint64_t high = (uint64_t)v->pages * MNI_VACANCY_PAGE;
    return high < v->max ? (uint32_t)high : v->max;
}
static inline bool mni_vacancy_is_free(const mni_vacancy *v, uint32_t number) {
    return (v->free[number / 64] >> (number % 64) & 1) != 0;
}

/* Takes a number. near: one below max; the next free one of its page, if there is one. The caller
 * counts: one is free. */
uint32_t mni_vacancy_spill(mni_vacancy *v);
static inline uint32_t mni_vacancy_take(mni_vacancy *v, uint32_t near) {
    const uint32_t page = near / 64, at = near % 64;
    const uint64_t free = v->free[page];
    if (free == 0)
        return mni_vacancy_spill(v);
    const uint64_t from_there = free >> at | free << (-at % 64);
    const uint32_t bit = (at + (uint32_t)__builtin_ctzll(from_there)) % 64;
    v->free[page] = free & ~(UINT64_C(1) << bit);
    v->count[page]--;
    return page * MNI_VACANCY_PAGE + bit;
}
static inline void mni_vacancy_give(mni_vacancy *v, uint32_t number) {
    v->free[number / 64] |= UINT64_C(1) << (number % 64);
    v->count[number / 64]++;
}

/* Bits and counts agree, and as many are taken. Asserts. */
void mni_vacancy_check(const mni_vacancy *v, uint32_t taken);

#endif
