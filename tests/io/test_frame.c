/* Goal: a frame that was sealed passes; one that is damaged, misplaced, stale or lying does not.
 * Method: each bit of a small block turned over; each field bent with a good checksum. */
#include <check.h>
#include <stdlib.h>
#include <string.h>

#include "frame.h"
#include "suite.h"

enum { PAGES = 2, LENGTH = PAGES * MN_PAGE_BYTES, FILE_PAGES = 100 };
static const mn_block_ref SELF = {.id = 7, .pages = PAGES};
static const uint64_t BUILD = 0x1234567890abcdef, FILE_BYTES = FILE_PAGES * MN_PAGE_BYTES;

static void make(unsigned char *bytes) {
    mni_frame frame = {.kind = MNI_FRAME_METANODE, .refs = 2, .payload_bytes = 700, .parent_id = 3};
    for (int i = 0; i < LENGTH; i++)
        bytes[i] = (unsigned char)(i * 31);
    mni_frame_set_ref(bytes, 0, (mn_block_ref){.id = 20, .pages = 1});
    mni_frame_set_ref(bytes, 1, (mn_block_ref){.id = 98, .pages = 2});
    mni_frame_seal(bytes, &frame, SELF, BUILD);
}

START_TEST(sealed_is_sound) {
    unsigned char bytes[LENGTH];
    make(bytes);
    ck_assert_int_eq(mni_frame_check(bytes, SELF, BUILD, FILE_BYTES), MNI_FRAME_OK);
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    ck_assert_uint_eq(frame.kind, MNI_FRAME_METANODE);
    ck_assert_uint_eq(frame.refs, 2);
    ck_assert_uint_eq(frame.payload_bytes, 700);
    ck_assert_uint_eq(frame.parent_id, 3);
    ck_assert_uint_eq(mni_frame_ref(bytes, 1).id, 98);
    ck_assert_uint_eq(mni_frame_ref(bytes, 1).pages, 2);
    ck_assert_uint_eq(mni_frame_payload_at(2) % 8, 0);
    ck_assert_uint_eq(bytes[mni_frame_payload_at(2)],
                      (unsigned char)(mni_frame_payload_at(2) * 31));
}
END_TEST

START_TEST(every_bit_counts) {
    unsigned char bytes[LENGTH];
    make(bytes);
    for (int bit = 0; bit < 8 * LENGTH; bit++) {
        bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
        ck_assert_int_ne(mni_frame_check(bytes, SELF, BUILD, FILE_BYTES), MNI_FRAME_OK);
        bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
    }
    ck_assert_int_eq(mni_frame_check(bytes, SELF, BUILD, FILE_BYTES), MNI_FRAME_OK);
}
END_TEST

START_TEST(misplaced_stale_foreign) {
    unsigned char bytes[LENGTH];
    mn_block_ref elsewhere = {.id = 8, .pages = PAGES}, shorter = {.id = 7, .pages = 1};
    make(bytes);
    ck_assert_int_eq(mni_frame_check(bytes, elsewhere, BUILD, FILE_BYTES), MNI_FRAME_WRONG_PLACE);
    ck_assert_int_eq(mni_frame_check(bytes, SELF, BUILD + 1, FILE_BYTES), MNI_FRAME_WRONG_BUILD);
    ck_assert_int_eq(mni_frame_check(bytes, shorter, BUILD, FILE_BYTES), MNI_FRAME_BAD_CHECKSUM);
    memset(bytes, 0, sizeof bytes);
    ck_assert_int_eq(mni_frame_check(bytes, SELF, BUILD, FILE_BYTES), MNI_FRAME_BAD_MAGIC);
    for (int fault = MNI_FRAME_OK; fault <= MNI_FRAME_BAD_TABLE; fault++)
        ck_assert_uint_gt(strlen(mni_frame_fault_text((mni_frame_fault)fault)), 3);
}
END_TEST

/* Good checksums, lying contents: sealed with what seal would never be given. */
START_TEST(lying_tables) {
    static const mn_block_ref bad[] = {{0, 1}, {5, 0}, {FILE_PAGES, 1}, {99, 2}, {1, UINT32_MAX}};
    unsigned char bytes[LENGTH];
    mni_frame frame = {.kind = 1, .refs = 2, .payload_bytes = 700, .parent_id = 3};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        make(bytes);
        mni_frame_set_ref(bytes, 1, bad[i]);
        mni_frame_seal(bytes, &frame, SELF, BUILD);
        ck_assert_int_eq(mni_frame_check(bytes, SELF, BUILD, FILE_BYTES), MNI_FRAME_BAD_TABLE);
    }
    make(bytes);
    frame.parent_id = FILE_PAGES;
    mni_frame_seal(bytes, &frame, SELF, BUILD);
    ck_assert_int_eq(mni_frame_check(bytes, SELF, BUILD, FILE_BYTES), MNI_FRAME_BAD_TABLE);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("frame");
    TCase *tests = tcase_create("frame");
    tcase_set_timeout(tests, 60);
    tcase_add_test(tests, sealed_is_sound);
    tcase_add_test(tests, every_bit_counts);
    tcase_add_test(tests, misplaced_stale_foreign);
    tcase_add_test(tests, lying_tables);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
