/* Goal: whatever is added, pushed and dropped, items come out smallest first, or, of a queue, first
 * come first. Method: random work against a list of what must be there, in agendas of every size
 * from one item on. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "agenda.h"
#include "dice.h"
#include "suite.h"

enum { MAX = 3000 };

static mni_arena open_agenda(mni_agenda *agenda, uint32_t max) {
    mni_arena arena;
    mn_status st = {0};
    ck_assert_int_eq(mni_arena_open(&arena, mni_agenda_need(max), &st), MN_OK);
    mni_agenda_open(agenda, max, &arena);
    return arena;
}

static bool before(mni_agenda_item a, mni_agenda_item b) {
    return a.key != b.key ? a.key < b.key : a.order < b.order;
}

/* What must come next of the model, an unsorted list. */
static uint32_t least(const mni_agenda_item *item, uint32_t count) {
    uint32_t at = 0;
    for (uint32_t i = 1; i < count; i++)
        if (before(item[i], item[at]))
            at = i;
    return at;
}

static bool is_odd(const void *context, mni_agenda_item item) {
    return context == NULL && item.what % 2 == 1;
}

static int by_rank(const void *a, const void *b) {
    return before(*(const mni_agenda_item *)a, *(const mni_agenda_item *)b) ? -1 : 1;
}

static mni_agenda_item new_item(uint32_t serial, uint32_t keys) {
    return (mni_agenda_item){.key = keys > 0 ? uniform(keys) << uniform(20) : uniform(UINT32_MAX),
                             .order = serial,
                             .what = uniform(1000)};
}

/* keys: few make ties, 0 uses all 32 bits. */
static void exercise(uint32_t max, uint32_t added, uint32_t keys) {
    static mni_agenda_item model[MAX];
    mni_agenda agenda;
    mni_arena arena = open_agenda(&agenda, max);
    mni_agenda_item item;
    uint32_t count = 0, serial = 0;
    ck_assert(!mni_agenda_pop(&agenda, &item));
    for (; count < added; count++) {
        model[count] = new_item(serial++, keys);
        mni_agenda_add(&agenda, model[count]);
    }
    mni_agenda_begin(&agenda);
    for (uint32_t step = 0; step < 4 * max; step++) {
        uint32_t what = uniform(100);
        if (what < 40 && count < max && !mni_agenda_is_full(&agenda)) {
            model[count] = new_item(serial++, keys);
            mni_agenda_push(&agenda, model[count++]);
        } else if (what == 99) {
            uint32_t kept = 0;
            mni_agenda_keep(&agenda, is_odd, NULL);
            for (uint32_t i = 0; i < count; i++)
                if (model[i].what % 2 == 1)
                    model[kept++] = model[i];
            count = kept;
        } else if (mni_agenda_pop(&agenda, &item)) {
            uint32_t at = least(model, count);
            ck_assert_uint_gt(count, 0);
            ck_assert(item.key == model[at].key && item.order == model[at].order &&
                      item.what == model[at].what);
            model[at] = model[--count];
        } else {
            ck_assert_uint_eq(count, 0);
        }
        /* room that was used up is there again once the sorted items are gone */
        ck_assert(!mni_agenda_is_full(&agenda) || count == max || agenda.next < agenda.max);
    }
    mni_arena_close(&arena);
}

START_TEST(smallest_first) {
    static const uint32_t sizes[] = {1, 2, 3, 255, 256, 600, MAX};
    uint32_t max = sizes[_i % 7], keys[] = {1, 5, 0};
    for (int k = 0; k < 3; k++) {
        exercise(max, 0, keys[k]);
        exercise(max, max / 2, keys[k]); /* the most that a radix sort has room for */
        exercise(max, max, keys[k]);
    }
}
END_TEST

/* A queue: what is pushed, in that order, before what was added, in the order of keys; few, or more
 * than there is room to sort, have that of adding. The room of what was taken is there again. */
static void exercise_queue(uint32_t max, uint32_t added) {
    static mni_agenda_item first[MAX], later[5 * MAX];
    mni_agenda agenda;
    mni_arena arena = open_agenda(&agenda, max);
    mni_agenda_item item;
    uint32_t next = 0, head = 0, tail = 0;
    for (uint32_t i = 0; i < added; i++) {
        first[i] = (mni_agenda_item){.key = uniform(50), .order = i, .what = i};
        mni_agenda_add(&agenda, first[i]);
    }
    mni_agenda_begin_queue(&agenda);
    if (agenda.next < max)
        qsort(first, added, sizeof *first, by_rank);
    else
        for (; next < added; next++)
            later[tail++] = first[next];
    for (uint32_t step = 0; step < 4 * max; step++) {
        const bool there = head < tail || next < added;
        if (uniform(2) == 0 && tail - head + added - next < max) {
            later[tail] = (mni_agenda_item){.key = uniform(50), .order = MAX + step, .what = step};
            mni_agenda_push(&agenda, later[tail++]);
        } else {
            ck_assert(mni_agenda_pop(&agenda, &item) == there);
            if (!there)
                continue;
            const mni_agenda_item *is = head < tail ? &later[head++] : &first[next++];
            ck_assert(item.key == is->key && item.order == is->order && item.what == is->what);
        }
    }
    mni_arena_close(&arena);
}

START_TEST(queue_goes_first) {
    static const uint32_t sizes[] = {1, 2, 3, 255, 256, 600, MAX};
    const uint32_t max = sizes[_i % 7];
    exercise_queue(max, 0);
    exercise_queue(max, max / 2);
    exercise_queue(max, max);
}
END_TEST

/* So many equal keys, the latest first, that no insertion should sort them. */
START_TEST(many_ties) {
    enum { TIES = 1 << 17 };
    mni_agenda agenda;
    mni_arena arena = open_agenda(&agenda, 2 * TIES);
    mni_agenda_item item;
    for (uint32_t i = TIES; i-- > 0;)
        mni_agenda_add(&agenda, (mni_agenda_item){.key = 7, .order = i, .what = i});
    mni_agenda_begin(&agenda);
    for (uint32_t i = 0; i < TIES; i++)
        ck_assert(mni_agenda_pop(&agenda, &item) && item.order == i && item.what == i);
    ck_assert(!mni_agenda_pop(&agenda, &item));
    mni_arena_close(&arena);
}
END_TEST

/* What is put off by a bit above all keys comes after the others, and in its old place when that is
 * taken off. */
START_TEST(put_off_and_back) {
    enum { ITEMS = 900 };
    const uint32_t bit = 1u << 31;
    mni_agenda agenda;
    mni_arena arena = open_agenda(&agenda, 2 * ITEMS);
    mni_agenda_item item, last = {0};
    for (uint32_t i = 0; i < ITEMS; i++)
        mni_agenda_add(&agenda, (mni_agenda_item){.key = uniform(bit), .order = i, .what = i});
    mni_agenda_begin(&agenda);
    for (uint32_t i = 0; i < ITEMS / 2; i++) { /* of the first half every third stays */
        ck_assert(mni_agenda_pop(&agenda, &item) && (item.key & bit) == 0);
        item.key |= bit;
        if (i % 3 == 0)
            mni_agenda_push(&agenda, item);
    }
    ck_assert(mni_agenda_pop(&agenda, &last) && (last.key & bit) == 0);
    mni_agenda_unmark(&agenda, bit);
    uint32_t left = 0;
    for (item = (mni_agenda_item){0}; mni_agenda_pop(&agenda, &item); left++) {
        ck_assert((item.key & bit) == 0);
        ck_assert(before(item, last) == (left < ITEMS / 6));
    }
    ck_assert_uint_eq(left, ITEMS / 6 + ITEMS / 2 - 1);
    mni_arena_close(&arena);
}
END_TEST

int main(void) {
    const char *seed = getenv("MN_SEED");
    random_state = seed != NULL ? strtoull(seed, NULL, 10) : 20261122;
    printf("MN_SEED=%llu\n", (unsigned long long)random_state);
    Suite *suite = suite_create("agenda");
    TCase *tc = tcase_create("agenda");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, smallest_first, 0, 7);
    tcase_add_loop_test(tc, queue_goes_first, 0, 7);
    tcase_add_test(tc, many_ties);
    tcase_add_test(tc, put_off_and_back);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
