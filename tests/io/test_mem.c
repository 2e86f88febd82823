/* Goal: what is taken from a shelf is whole, apart from all else and still there when it grows,
 * and its pages go when they are to. Method: a thousand blocks taken, grown and given back by lot,
 * each filled with its number; then the edges: a shelf that is full, has none but small gaps, or
 * is none. */
#include <check.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mem.h"
#include "suite.h"

enum { SHELF_BYTES = 1 << 20, TAKEN_MAX = 80, TURNS = 1000, PAGE_BYTES = 4096 };

static uint64_t random_state;

static uint32_t uniform(uint32_t below) {
    random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (uint32_t)((random_state >> 33) % below);
}

typedef struct taken {
    unsigned char *memory;
    size_t bytes;
    unsigned char number;
} taken;

static void fill(taken *t, size_t from) {
    memset(t->memory + from, t->number, t->bytes - from);
}

static bool all_are(const taken *t, unsigned char value) {
    size_t i = 0;
    while (i < t->bytes && t->memory[i] == value)
        i++;
    return i == t->bytes;
}

static void check(const taken *t) {
    ck_assert(all_are(t, t->number));
}

static bool is_on(const mni_shelf *s, const void *memory) {
    return (uintptr_t)memory - (uintptr_t)s->base < s->size_bytes;
}

static taken take_any(unsigned char number) {
    taken t = {.bytes = uniform(40000), .number = number};
    if (uniform(3) == 0) {
        t.memory = mni_mem_take_zeroed(t.bytes);
        ck_assert(all_are(&t, 0));
    } else {
        t.memory = mni_mem_take(t.bytes, uniform((uint32_t)t.bytes + 1));
    }
    ck_assert_ptr_nonnull(t.memory);
    ck_assert_uint_eq((uintptr_t)t.memory % 64, 0);
    fill(&t, 0);
    return t;
}

static void grow(taken *t) {
    const size_t before = t->bytes;
    t->bytes += uniform(20000) + 1;
    t->memory = mni_mem_grow(t->memory, before, t->bytes);
    ck_assert_ptr_nonnull(t->memory);
    fill(t, before);
}

START_TEST(blocks_keep_what_is_theirs) {
    const char *seed = getenv("MN_SEED");
    random_state = seed != NULL ? strtoull(seed, NULL, 10) : 1;
    printf("MN_SEED=%llu\n", (unsigned long long)random_state);
    mni_shelf shelf;
    taken t[TAKEN_MAX];
    uint32_t count = 0, elsewhere = 0;
    mni_shelf_open(&shelf, SHELF_BYTES);
    for (uint32_t turn = 0; turn < TURNS; turn++) {
        const uint32_t which = count > 0 ? uniform(count) : 0, what = uniform(8);
        if (count < TAKEN_MAX && (count == 0 || what < 4)) {
            t[count] = take_any((unsigned char)turn);
            elsewhere += !is_on(&shelf, t[count++].memory);
        } else if (what == 4) {
            grow(&t[which]);
        } else {
            check(&t[which]);
            mni_mem_give(t[which].memory);
            t[which] = t[--count];
        }
        mni_shelf_trim(&shelf, uniform(SHELF_BYTES));
    }
    ck_assert_uint_gt(elsewhere, 0); /* 80 blocks are more than 64, and than a megabyte */
    while (count > 0) {
        check(&t[--count]);
        mni_mem_give(t[count].memory);
    }
    mni_shelf_close(&shelf);
}
END_TEST

/* The lowest gap that is wide enough is taken, so that what all blocks take does not creep up. */
START_TEST(gaps_are_used_again) {
    mni_shelf shelf;
    mni_shelf_open(&shelf, 64 * PAGE_BYTES);
    unsigned char *a = mni_mem_take(3 * PAGE_BYTES, 0), *b = mni_mem_take(PAGE_BYTES, 0),
                  *c = mni_mem_take(PAGE_BYTES, 0);
    ck_assert_ptr_eq(a, shelf.base);
    mni_mem_give(a);
    ck_assert_ptr_eq(mni_mem_take(2 * PAGE_BYTES, 0), a);
    ck_assert_ptr_eq(mni_mem_take(PAGE_BYTES, 0), a + 2 * PAGE_BYTES);
    ck_assert_ptr_eq(mni_mem_take(1, 0), c + PAGE_BYTES);
    mni_mem_give(b);
    ck_assert_ptr_eq(mni_mem_take(1, 0), b);
    mni_mem_give(b);
    mni_mem_give(c + PAGE_BYTES);
    mni_mem_give(c);
    mni_mem_give(a);
    mni_mem_give(a + 2 * PAGE_BYTES);
    mni_mem_give(NULL);
    ck_assert_ptr_eq(mni_mem_take(64 * PAGE_BYTES, 0), a);
    mni_mem_give(a);
    unsigned char *larger = mni_mem_take(65 * PAGE_BYTES, 0);
    ck_assert(!is_on(&shelf, larger));
    mni_mem_give(larger);
    mni_shelf_close(&shelf);
}
END_TEST

/* Pages behind the limit are the kernel's, which zeroes them; those below stay as they were. */
START_TEST(pages_stay_up_to_a_limit) {
    mni_shelf shelf;
    mni_shelf_open(&shelf, 16 * PAGE_BYTES);
    taken t = {mni_mem_take(16 * PAGE_BYTES, 0), 16 * PAGE_BYTES, 7};
    fill(&t, 0);
    mni_shelf_trim(&shelf, 0); /* what is taken stays */
    check(&t);
    mni_mem_give(t.memory);
    mni_shelf_trim(&shelf, 3 * PAGE_BYTES + 1);
    t.memory = mni_mem_take(t.bytes, t.bytes);
    ck_assert_uint_eq(t.memory[4 * PAGE_BYTES - 1], 7);
    ck_assert_uint_eq(t.memory[4 * PAGE_BYTES], 0);
    ck_assert_uint_eq(t.memory[16 * PAGE_BYTES - 1], 0);
    mni_mem_give(t.memory);
    mni_shelf_close(&shelf);
}
END_TEST

START_TEST(without_a_shelf_all_is_mallocs) {
    taken t = {mni_mem_take(5u << 20, 5u << 20), 5u << 20, 9};
    ck_assert_ptr_nonnull(t.memory);
    fill(&t, 0);
    t.memory = realloc(t.memory, t.bytes);
    ck_assert_ptr_nonnull(t.memory);
    check(&t);
    free(t.memory);
    mni_mem_give(mni_mem_take(0, 0));
}
END_TEST

int main(void) {
    Suite *s = suite_create("mem");
    TCase *c = tcase_create("shelf");
    tcase_add_test(c, blocks_keep_what_is_theirs);
    tcase_add_test(c, gaps_are_used_again);
    tcase_add_test(c, pages_stay_up_to_a_limit);
    tcase_add_test(c, without_a_shelf_all_is_mallocs);
    suite_add_tcase(s, c);
    return suite_run(s);
}
