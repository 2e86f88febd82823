/* Goal: what is put comes to the worker, each record once and in its order, and is done when drain
 * returns; with a thread and without one. Method: numbers through batches of one record and of
 * many, drained after every so many; the worker sums up what an order shows. */
#include <check.h>
#include <stdint.h>
#include <stdlib.h>

#include "relay.h"
#include "suite.h"

enum { RECORDS = 20000 };

typedef struct record {
    uint32_t number, more[3];
} record;

typedef struct heard {
    uint32_t count, batches, largest, out_of_order;
} heard;

static void hear(void *context, void *records, uint32_t count) {
    heard *h = context;
    record *r = records;
    ck_assert_uint_gt(count, 0);
    h->batches++;
    h->largest = count > h->largest ? count : h->largest;
    for (uint32_t i = 0; i < count; i++) {
        h->out_of_order += r[i].number != h->count || r[i].more[2] != ~r[i].number;
        h->count++;
        r[i] = (record){0}; /* the worker's own */
    }
}

/* drain_every: 0: never. */
static heard run(uint32_t threads, size_t buffer_bytes, uint32_t drain_every) {
    mni_relay relay;
    heard h = {0};
    void *buffer = malloc(buffer_bytes);
    ck_assert_ptr_nonnull(buffer);
    mni_relay_open(&relay, hear, &h, sizeof(record), buffer, buffer_bytes, threads);
    for (uint32_t i = 0; i < RECORDS; i++) {
        mni_relay_put(&relay, &(record){i, {0, 0, ~i}});
        if (drain_every == 0 || (i + 1) % drain_every != 0)
            continue;
        mni_relay_drain(&relay);
        ck_assert_uint_eq(h.count, i + 1);
    }
    mni_relay_close(&relay);
    free(buffer);
    ck_assert_uint_eq(h.count, RECORDS);
    ck_assert_uint_eq(h.out_of_order, 0);
    return h;
}

START_TEST(records_keep_their_order) {
    const uint32_t threads = (uint32_t)_i + 1;
    heard h = run(threads, MNI_RELAY_BATCHES * sizeof(record), 0);
    ck_assert_uint_eq(h.batches, RECORDS);
    h = run(threads, MNI_RELAY_BATCHES * sizeof(record) + 15, 7);
    ck_assert_uint_eq(h.largest, 1);
    h = run(threads, MNI_RELAY_BATCHES * 1000 * sizeof(record), 0);
    ck_assert_uint_eq(h.batches, RECORDS / 1000);
    h = run(threads, MNI_RELAY_BATCHES * 1000 * sizeof(record), 1500); /* 1000, 500, 1000, … */
    ck_assert_uint_eq(h.batches, RECORDS / 1500 * 2 + 1);
    h = run(threads, MNI_RELAY_BATCHES * 2 * RECORDS * sizeof(record), 0); /* on close alone */
    ck_assert_uint_eq(h.batches, 1);
}
END_TEST

START_TEST(nothing_is_put) {
    mni_relay relay;
    heard h = {0};
    record buffer[MNI_RELAY_BATCHES];
    mni_relay_open(&relay, hear, &h, sizeof(record), buffer, sizeof buffer, (uint32_t)_i + 1);
    mni_relay_drain(&relay);
    mni_relay_drain(&relay);
    mni_relay_close(&relay);
    ck_assert_uint_eq(h.batches, 0);
}
END_TEST

int main(void) {
    Suite *s = suite_create("relay");
    TCase *c = tcase_create("relay");
    tcase_add_loop_test(c, records_keep_their_order, 0, 2);
    tcase_add_loop_test(c, nothing_is_put, 0, 2);
    suite_add_tcase(s, c);
    return suite_run(s);
}
