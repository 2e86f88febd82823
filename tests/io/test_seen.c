/* Goal: bytes that have been seen are known by their place, others never are.
 * Method: random blocks of all lengths; every bit of one turned over; places, lengths and sessions
 * exchanged; against both steps by their definition, on numbers of this test's own. */
#include <check.h>
#include <stdlib.h>
#include <string.h>

#include "seen.h"
#include "suite.h"

enum { PAGES_MAX = 16, BYTES_MAX = PAGES_MAX * MN_PAGE_BYTES, ENTRIES = 100 };

typedef struct stage {
    mni_arena arena;
    mni_seen seen;
    unsigned char bytes[BYTES_MAX];
} stage;

static void open_stage(stage *s) {
    mn_status st = {0};
    ck_assert_int_eq(mni_arena_open(&s->arena, mni_seen_need(ENTRIES), &st), MN_OK);
    mni_seen_open(&s->seen, ENTRIES, &s->arena);
    mni_arena_seal(&s->arena);
    ck_assert_uint_ne(s->seen.point, 0);
    for (size_t i = 0; i < BYTES_MAX; i++)
        s->bytes[i] = (unsigned char)rand();
}

__extension__ typedef unsigned __int128 wide;
static const uint64_t prime = (UINT64_C(1) << 61) - 1;

static uint64_t horner(uint64_t value, uint64_t point, uint64_t next) {
    return (uint64_t)(((wide)value * point + next) % prime);
}

/* NH with the key from `from` on. */
static uint64_t nh(const uint64_t *key, const unsigned char *bytes, size_t from) {
    uint64_t sum = 0;
    for (size_t i = 0; i < MNI_SEEN_PIECE; i++) {
        uint64_t half[2] = {key[i + from] & UINT32_MAX, key[i + from] >> 32};
        for (size_t b = 0; b < 8; b++)
            half[b / 4] += (uint64_t)bytes[8 * i + b] << 8 * (b % 4);
        sum += (half[0] & UINT32_MAX) * (half[1] & UINT32_MAX);
    }
    return sum;
}

/* Two sums a piece in three coefficients; then place and length. */
static uint64_t by_definition(const mni_seen *seen, mn_block_ref ref, const unsigned char *bytes) {
    const uint64_t point = seen->point, low = (UINT64_C(1) << 56) - 1;
    const size_t length = (size_t)ref.pages * MN_PAGE_BYTES;
    uint64_t value = 0;
    for (size_t at = 0; at < length; at += 8 * MNI_SEEN_PIECE) {
        const uint64_t first = nh(seen->key, bytes + at, 0), second = nh(seen->key, bytes + at, 1);
        value = horner(value, point, first & low);
        value = horner(value, point, second & low);
        value = horner(value, point, (first & ~low) >> 48 | second >> 56);
    }
    return horner(horner(value, point, ref.id), point, ref.pages) | UINT64_C(1) << 63;
}

START_TEST(digest_is_as_defined) {
    static stage s;
    open_stage(&s);
    const uint64_t points[] = {s.seen.point, 1, 2, prime - 1};
    for (int p = 0; p < 4; p++) {
        s.seen.point = points[p];
        for (uint32_t pages = 1; pages <= PAGES_MAX; pages++) {
            const mn_block_ref ref = {(uint32_t)rand(), pages};
            ck_assert_uint_eq(mni_seen_digest(&s.seen, ref, s.bytes),
                              by_definition(&s.seen, ref, s.bytes));
        }
        memset(s.bytes, p < 2 ? 0xff : 0, sizeof s.bytes); /* the largest, and all 0 */
        memset(s.seen.key, p < 2 ? 0 : 0xff, sizeof s.seen.key);
    }
    mni_arena_close(&s.arena);
}
END_TEST

START_TEST(every_bit_counts) {
    static stage s;
    const mn_block_ref self = {7, 1};
    open_stage(&s);
    const uint64_t digest = mni_seen_digest(&s.seen, self, s.bytes);
    ck_assert(!mni_seen_has(&s.seen, self, digest));
    mni_seen_add(&s.seen, self, digest);
    ck_assert(mni_seen_has(&s.seen, self, digest));
    for (int bit = 0; bit < 8 * MN_PAGE_BYTES; bit++) {
        s.bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
        ck_assert(!mni_seen_has(&s.seen, self, mni_seen_digest(&s.seen, self, s.bytes)));
        s.bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
    }
    ck_assert(mni_seen_has(&s.seen, self, mni_seen_digest(&s.seen, self, s.bytes)));
    mni_arena_close(&s.arena);
}
END_TEST

/* The same bytes elsewhere, or of another length, are others, in whichever entry they come. */
START_TEST(places_and_lengths) {
    static stage s;
    const mn_block_ref self = {7, 2};
    open_stage(&s);
    memset(s.bytes, 0, sizeof s.bytes);
    mni_seen_add(&s.seen, self, mni_seen_digest(&s.seen, self, s.bytes));
    for (uint32_t id = 0; id < 5000; id++)
        for (uint32_t pages = 1; pages < 4; pages++) {
            const mn_block_ref ref = {id, pages};
            const bool same = id == self.id && pages == self.pages;
            ck_assert(mni_seen_has(&s.seen, ref, mni_seen_digest(&s.seen, ref, s.bytes)) == same);
        }
    mni_arena_close(&s.arena);
}
END_TEST

/* More blocks than entries: some are forgotten, none is taken for another, the last one stays. */
START_TEST(entries_are_shared) {
    static stage s;
    uint32_t known = 0;
    open_stage(&s);
    for (uint32_t id = 1; id <= 1000; id++) {
        const mn_block_ref ref = {id, 1};
        const uint64_t digest = mni_seen_digest(&s.seen, ref, s.bytes + id);
        mni_seen_add(&s.seen, ref, digest);
        ck_assert(mni_seen_has(&s.seen, ref, digest));
    }
    for (uint32_t id = 1; id <= 1000; id++) {
        const mn_block_ref ref = {id, 1};
        known += mni_seen_has(&s.seen, ref, mni_seen_digest(&s.seen, ref, s.bytes + id));
        ck_assert(!mni_seen_has(&s.seen, ref, mni_seen_digest(&s.seen, ref, s.bytes + id + 1)));
    }
    ck_assert(known > ENTRIES / 2 && known <= 2 * ENTRIES);
    mni_arena_close(&s.arena);
}
END_TEST

START_TEST(sessions_differ) {
    static stage a, b;
    const mn_block_ref self = {7, 2};
    open_stage(&a);
    open_stage(&b);
    ck_assert_uint_ne(mni_seen_digest(&a.seen, self, a.bytes),
                      mni_seen_digest(&b.seen, self, a.bytes));
    mni_arena_close(&a.arena);
    mni_arena_close(&b.arena);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("seen");
    TCase *tc = tcase_create("seen");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, digest_is_as_defined);
    tcase_add_test(tc, every_bit_counts);
    tcase_add_test(tc, places_and_lengths);
    tcase_add_test(tc, entries_are_shared);
    tcase_add_test(tc, sessions_differ);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
