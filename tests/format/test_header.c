/* Goal: every field of the header page that can lie is named when it does.
 * Method: a sound page; each field damaged in turn, with the checksum made good and without. */
#include <check.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "header.h"
#include "suite.h"

enum { FILE_BYTES = 100 * MN_PAGE_BYTES };

static mn_header sound(void) {
    mn_header h = {.version = MNI_MNT_VERSION,
                   .build_id = 0x1234567890abcdef,
                   .file_bytes = FILE_BYTES,
                   .triangles = 1000,
                   .leaves = 500,
                   .nodes = 999,
                   .hinges = 3,
                   .legal_last = 900,
                   .has_colors = true,
                   .origin = {1, 2, 3},
                   .box_min = {-1, -1, -1},
                   .box_max = {1, 1, 1},
                   .dive_point = {0, 1, 0},
                   .dive_normal = {0, 1, 0},
                   .block_bytes = 16384,
                   .block_bytes_max = 16384,
                   .blocks = 20,
                   .block_depth = 3,
                   .depth_max = 12,
                   .children_max = 9,
                   .nodes_per_block_max = 300,
                   .fill_mean = 0.9,
                   .roots = 1,
                   .grid_step = 0.25f,
                   .root = {{{1, 4}, 0, 0xff102030, {0, 0, 0}}}};
    return h;
}

static void reseal(unsigned char *page) {
    uint64_t checksum = 0;
    memcpy(page + 16, &checksum, sizeof checksum);
    checksum = XXH3_64bits(page, MN_PAGE_BYTES);
    memcpy(page + 16, &checksum, sizeof checksum);
}

START_TEST(a_sound_header_comes_back) {
    mn_header h = sound(), back;
    unsigned char page[MN_PAGE_BYTES];
    mn_status st = {0};
    mni_header_encode(&h, page);
    ck_assert_msg(mni_header_decode(page, FILE_BYTES, "x.mnt", &back, &st) == MN_OK, "%s", st.text);
    ck_assert(memcmp(&h, &back, sizeof h) == 0);
}
END_TEST

typedef struct lie {
    const char *name;
    uint32_t offset, bytes;
    uint64_t value;
} lie;

#define NAN32 0x7fc00000u
#define HUGE32 0xfffffff0u
/* Offsets as docs/format.md gives them. */
static const lie lies[] = {
    {"magic", 0, 1, 'X'},
    {"version", 8, 4, 99},
    {"header_bytes", 12, 4, 512},
    {"checksum", 16, 8, 1},
    {"checksum", 24, 8, 1}, /* the build id: any would do, so the checksum tells */
    {"file_bytes", 32, 8, FILE_BYTES + 1},
    {"triangles", 40, 8, 1ull << 40},
    {"leaves", 48, 4, 1},
    {"leaves", 48, 4, HUGE32},
    {"nodes", 52, 4, 1000},
    {"hinges", 56, 4, HUGE32},
    {"legal_last", 60, 4, 999},
    {"legal_last", 60, 4, 3},
    {"flags", 64, 4, 8},
    {"metric", 68, 4, 7},
    {"blocking", 72, 4, 2},
    {"l", 76, 4, 5},
    {"block_bytes", 80, 4, 5000},
    {"block_bytes", 80, 4, 0},
    {"block_bytes_max", 84, 4, 4097},
    {"block_bytes_max", 84, 4, 1 << 20},
    {"blocks", 88, 4, 0},
    {"blocks", 88, 4, 100},
    {"block_depth", 92, 4, 0},
    {"block_depth", 92, 4, 21},
    {"overflow_max", 96, 4, 20},
    {"depth_max", 100, 4, 1},
    {"children_max", 104, 4, 20},
    {"nodes_per_block_max", 108, 4, 0},
    {"fill_mean", 112, 8, 0x7ff8000000000000u},
    {"fill_mean", 112, 8, 0x4000000000000000u},
    {"origin", 120, 8, 0x7ff8000000000000u},
    {"origin", 136, 8, 0x7ff8000000000000u},
    {"box_min", 144, 4, NAN32},
    {"box_max", 156, 4, NAN32},
    {"box_max", 160, 4, 0xc0000000u},
    {"dive_point", 168, 4, NAN32},
    {"dive_normal", 184, 4, 0x40000000u},
    {"roots", 192, 4, 0},
    {"roots", 192, 4, MN_ROOTS_MAX + 1},
    {"root.id", 200, 4, 0},
    {"root.id", 200, 4, 100},
    {"root.pages", 204, 4, 0},
    {"root.pages", 204, 4, 5},
    {"root.subtree", 208, 4, HUGE32},
    {"root.position", 216, 4, NAN32},
    {"root.position", 224, 4, 0x7f000000u}, /* 2^127: outside the box */
    {"grid_step", 196, 4, 0},
    {"grid_step", 196, 4, 0x40400000u}, /* 3 */
    {"grid_step", 196, 4, 0x7f800000u}, /* infinite */
};
enum { LIES = sizeof lies / sizeof lies[0] };

START_TEST(a_lying_field_is_named) {
    const lie *l = &lies[_i];
    for (int sealed = 0; sealed < 2; sealed++) {
        mn_header h = sound(), back;
        unsigned char page[MN_PAGE_BYTES];
        mn_status st = {0};
        mni_header_encode(&h, page);
        memcpy(page + l->offset, &l->value, l->bytes);
        bool is_checksum = strcmp(l->name, "checksum") == 0;
        if (sealed && !is_checksum)
            reseal(page);
        ck_assert_int_eq(mni_header_decode(page, FILE_BYTES, "x.mnt", &back, &st), MN_BAD_INPUT);
        ck_assert_msg(strstr(st.text, l->name) != NULL, "%s is not named: %s", l->name, st.text);
        ck_assert_msg(strncmp(st.text, "x.mnt: ", 7) == 0, "%s", st.text);
    }
}
END_TEST

START_TEST(every_byte_counts) {
    mn_header h = sound(), back;
    unsigned char page[MN_PAGE_BYTES];
    mni_header_encode(&h, page);
    for (uint32_t at = 0; at < sizeof page; at++) {
        mn_status st = {0};
        page[at] ^= 0x10;
        ck_assert_msg(mni_header_decode(page, FILE_BYTES, "x", &back, &st) == MN_BAD_INPUT,
                      "byte %u", at);
        page[at] ^= 0x10;
    }
}
END_TEST

START_TEST(a_file_of_another_size_is_refused) {
    mn_header h = sound(), back;
    unsigned char page[MN_PAGE_BYTES];
    mni_header_encode(&h, page);
    uint64_t sizes[] = {MN_PAGE_BYTES, FILE_BYTES - 1, FILE_BYTES + 4096, 1ull << 50};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        mn_status st = {0};
        ck_assert_int_eq(mni_header_decode(page, sizes[i], "x", &back, &st), MN_BAD_INPUT);
        ck_assert(strstr(st.text, "file_bytes") != NULL);
    }
}
END_TEST

START_TEST(levels_have_l_and_no_block_bytes) {
    mn_header h = sound(), back;
    unsigned char page[MN_PAGE_BYTES];
    h.blocking = MN_BLOCKING_LEVELS;
    for (uint32_t l = 0; l <= 17; l++)
        for (uint32_t bytes = 0; bytes <= 16384; bytes += 16384) {
            mn_status st = {0};
            h.l = l;
            h.block_bytes = bytes;
            mni_header_encode(&h, page);
            bool fine = l >= 1 && l <= 16 && bytes == 0;
            ck_assert_int_eq(mni_header_decode(page, FILE_BYTES, "x", &back, &st),
                             fine ? MN_OK : MN_BAD_INPUT);
        }
}
END_TEST

int main(void) {
    Suite *s = suite_create("header");
    TCase *t = tcase_create("header");
    tcase_add_test(t, a_sound_header_comes_back);
    tcase_add_loop_test(t, a_lying_field_is_named, 0, LIES);
    tcase_add_test(t, every_byte_counts);
    tcase_add_test(t, a_file_of_another_size_is_refused);
    tcase_add_test(t, levels_have_l_and_no_block_bytes);
    suite_add_tcase(s, t);
    return suite_run(s);
}
