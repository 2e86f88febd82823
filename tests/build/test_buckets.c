/* Goal: records dealt to buckets are all there again, and a table of pages says what was written to
 * it, however little memory there is.
 * Method: records and writes by lot, compared with arrays in memory; disks that fill and files that
 * are cut. */
#include <check.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "buckets.h"
#include "pages.h"
#include "disk_help.h"
#include "suite.h"
#include "tree_fixture.h"

/* ---- buckets --------------------------------------------------------------------------------- */

enum { BUCKETS = 7 };

typedef struct dealt {
    mni_arena arena;
    mni_buckets buckets;
    uint64_t count[BUCKETS], sum[BUCKETS];
    unsigned char *room;
} dealt;

static void open_dealt(dealt *d, uint32_t chunk_bytes) {
    mn_status st = {0};
    memset(d, 0, sizeof *d);
    ck_assert(mni_arena_open(&d->arena, mni_buckets_need(BUCKETS, chunk_bytes), &st) == MN_OK);
    mni_buckets_open(&d->buckets, BUCKETS, chunk_bytes, &d->arena, ".");
    d->room = malloc(chunk_bytes);
}

static void close_dealt(dealt *d) {
    mni_buckets_close(&d->buckets);
    mni_buckets_close(&d->buckets);
    mni_arena_close(&d->arena);
    free(d->room);
}

/* A record: its length, a number, and as many bytes as the length says that follow from it. */
static void deal(dealt *d, uint64_t *state) {
    uint32_t bucket = fixture_random(state) % 3 == 0 ? fixture_random(state) % (BUCKETS - 1) : 2;
    uint32_t number = fixture_random(state);
    unsigned char length = (unsigned char)(fixture_random(state) % (MNI_BUCKET_RECORD_MAX - 4));
    unsigned char *to = mni_bucket_put(&d->buckets, bucket);
    *to++ = length;
    memcpy(to, &number, sizeof number - 1);
    to += sizeof number - 1;
    for (unsigned i = 0; i < length; i++)
        *to++ = (unsigned char)(number * i);
    mni_bucket_put_end(&d->buckets, bucket, to);
    d->count[bucket]++;
    d->sum[bucket] += number & 0xffffff;
}

static void check_dealt(dealt *d) {
    for (uint32_t b = 0; b < BUCKETS; b++) {
        uint64_t count = 0, sum = 0;
        mni_bucket_reader r;
        mni_bucket_read(&r, &d->buckets, b, d->room);
        do {
            while (r.at < r.end) {
                uint32_t number = 0;
                unsigned char length = *r.at++;
                memcpy(&number, r.at, sizeof number - 1);
                r.at += sizeof number - 1;
                for (unsigned i = 0; i < length; i++)
                    ck_assert_uint_eq(*r.at++, (unsigned char)(number * i));
                count++;
                sum += number;
            }
            ck_assert_ptr_eq(r.at, r.end);
        } while (mni_bucket_more(&r, &d->buckets));
        ck_assert_uint_eq(count, d->count[b]);
        ck_assert_uint_eq(sum, d->sum[b]);
    }
    ck_assert_int_eq(d->buckets.spill.trouble.code, MN_OK);
}

START_TEST(all_records_are_there_again) {
    static const uint32_t chunk[] = {MNI_BUCKET_CHUNK_MIN, 136, 4096, 1 << 20};
    uint64_t state = fixture_seed(3);
    for (size_t i = 0; i < sizeof chunk / sizeof *chunk; i++) {
        dealt d;
        open_dealt(&d, chunk[i]);
        check_dealt(&d); /* nothing yet */
        for (int n = 0; n < 20000; n++)
            deal(&d, &state);
        check_dealt(&d);
        check_dealt(&d); /* as often as one likes */
        ck_assert_uint_eq(d.buckets.spill.bytes_written, d.buckets.spill.size_bytes);
        ck_assert((chunk[i] == 1 << 20) == (d.buckets.spill.size_bytes == 0));
        ck_assert_uint_eq(d.count[BUCKETS - 1], 0);
        close_dealt(&d);
    }
}
END_TEST

START_TEST(a_disk_that_fills_is_told) {
    uint64_t state = fixture_seed(5);
    signal(SIGXFSZ, SIG_IGN);
    for (rlim_t bytes = 0; bytes < 100000; bytes += 9999) {
        dealt d;
        open_dealt(&d, 256);
        limit_files(bytes);
        for (int n = 0; n < 20000; n++)
            deal(&d, &state);
        limit_files(RLIM_INFINITY);
        ck_assert_int_eq(d.buckets.spill.trouble.code, MN_NO_SPACE);
        mni_bucket_reader r; /* ends, whatever it finds */
        mni_bucket_read(&r, &d.buckets, 2, d.room);
        while (mni_bucket_more(&r, &d.buckets))
            ck_assert(r.at <= r.end);
        close_dealt(&d);
    }
}
END_TEST

/* ---- pages ----------------------------------------------------------------------------------- */

enum { RECORDS = 100003 };

static void open_pages(mni_pages *p, mni_arena *arena, mni_spill *spill, uint32_t page_bytes,
                       uint64_t budget) {
    mn_status st = {0};
    ck_assert(mni_spill_open(spill, ".", &st) == MN_OK);
    ck_assert(mni_arena_open(arena, budget, &st) == MN_OK);
    mni_pages_open(p, spill, sizeof(uint32_t), page_bytes, RECORDS, arena, budget);
}

START_TEST(a_table_says_what_was_written) {
    uint64_t state = fixture_seed(7), budget = MNI_PAGES_BUDGET_MIN << 2 * _i;
    uint32_t *is = calloc(RECORDS, sizeof *is);
    mni_pages p;
    mni_arena arena;
    mni_spill spill;
    open_pages(&p, &arena, &spill, _i % 2 ? 1024 : 256, budget);
    for (uint32_t n = 0, near = 0; n < 400000; n++) {
        if (fixture_random(&state) % 100 == 0)
            near = fixture_random(&state) % RECORDS;
        uint32_t at = (near + fixture_random(&state) % 2000) % RECORDS;
        bool change = fixture_random(&state) % 2;
        uint32_t *record = mni_pages_at(&p, at, change);
        ck_assert_ptr_nonnull(record);
        ck_assert_uint_eq(*record, is[at]);
        if (change)
            *record = is[at] = fixture_random(&state);
    }
    for (uint32_t at = 0; at < RECORDS; at++)
        ck_assert_uint_eq(*(uint32_t *)mni_pages_at(&p, at, false), is[at]);
    ck_assert((spill.bytes_written == 0) == (budget > 2 * RECORDS * sizeof *is));
    ck_assert_uint_eq(spill.trouble.code, MN_OK);
    mni_spill_close(&spill);
    mni_arena_close(&arena);
    free(is);
}
END_TEST

START_TEST(what_cannot_be_written_or_read_is_told) {
    mni_pages p;
    mni_arena arena;
    mni_spill spill;
    uint32_t failed = 0;
    signal(SIGXFSZ, SIG_IGN);
    open_pages(&p, &arena, &spill, 1024, MNI_PAGES_BUDGET_MIN);
    limit_files(50000);
    for (uint32_t at = 0; at < RECORDS; at += 100)
        failed += mni_pages_at(&p, at, true) == NULL;
    limit_files(RLIM_INFINITY);
    ck_assert_uint_gt(failed, 0);
    ck_assert_int_eq(spill.trouble.code, MN_NO_SPACE);
    mni_spill_close(&spill);
    mni_arena_close(&arena);

    open_pages(&p, &arena, &spill, 1024, MNI_PAGES_BUDGET_MIN);
    ck_assert_ptr_nonnull(mni_pages_at(&p, 5, false));
    close(spill.fd);
    spill.fd = open("/dev/null", O_WRONLY | O_CLOEXEC); /* cannot be read */
    ck_assert_ptr_nonnull(mni_pages_at(&p, 6, false));  /* is there */
    ck_assert_ptr_null(mni_pages_at(&p, 50000, false));
    ck_assert_int_eq(spill.trouble.code, MN_FAILED);
    mni_spill_close(&spill);
    mni_arena_close(&arena);
}
END_TEST

int main(void) {
    Suite *s = suite_create("buckets");
    TCase *t = tcase_create("buckets");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, all_records_are_there_again);
    tcase_add_test(t, a_disk_that_fills_is_told);
    tcase_add_loop_test(t, a_table_says_what_was_written, 0, 4);
    tcase_add_test(t, what_cannot_be_written_or_read_is_told);
    suite_add_tcase(s, t);
    return suite_run(s);
}
