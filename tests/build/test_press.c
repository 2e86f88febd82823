/* Goal: a compressed file holds what the plain one holds, is the same whenever it is made, and no
 * byte of it can be changed without being noticed. Method: trees of all blockings written both ways
 * and read back; bytes changed and files cut all over; caps. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "extents.h"
#include "suite.h"
#include "tree_fixture.h"

typedef struct bytes {
    unsigned char *at;
    size_t count;
} bytes;

static bytes read_all(const char *path) {
    FILE *f = fopen(path, "rb");
    ck_assert_ptr_nonnull(f);
    ck_assert_int_eq(fseek(f, 0, SEEK_END), 0);
    bytes b = {.count = (size_t)ftell(f)};
    b.at = malloc(b.count);
    rewind(f);
    ck_assert_uint_eq(fread(b.at, 1, b.count, f), b.count);
    fclose(f);
    return b;
}

static void write_all(const char *path, const unsigned char *at, size_t count) {
    FILE *f = fopen(path, "wb");
    ck_assert_ptr_nonnull(f);
    ck_assert_uint_eq(fwrite(at, 1, count, f), count);
    ck_assert_int_eq(fclose(f), 0);
}

static bool same_bytes(bytes a, bytes b) {
    return a.count == b.count && memcmp(a.at, b.at, a.count) == 0;
}

static void write_tree(const char *name, const mn_tree *tree, const mn_block_desc *desc,
                       mn_header *h, mn_block_counts *counts) {
    mn_status st = {0};
    ck_assert_msg(mn_block_write(name, tree, desc, h, counts, &st) == MN_OK, "%s", st.text);
}

/* Written plain, compressed (twice, by one thread and by two), and plain again from what that
 * holds. */
static void there_and_back(const mn_tree *tree, mn_block_desc desc) {
    char plain[200], pressed[200], again[200];
    strcpy(plain, fixture_path("plain.mnt"));
    strcpy(pressed, fixture_path("pressed.mnt"));
    strcpy(again, fixture_path("again.mnt"));
    mn_header p, z, read;
    mn_block_counts counts;
    mn_tree back;
    mn_status st = {0};
    mn_verify_result result;
    write_tree(plain, tree, &desc, &p, NULL);
    desc.zstd_level = desc.block_bytes == 4096 ? 19 : 3;
    write_tree(pressed, tree, &desc, &z, &counts);
    desc.threads = 2;
    write_tree(again, tree, &desc, &read, NULL);
    bytes one = read_all(pressed), two = read_all(again), whole = read_all(plain);
    ck_assert(same_bytes(one, two));
    ck_assert_uint_eq(p.zstd_level, 0);
    ck_assert_uint_eq(z.zstd_level, desc.zstd_level);
    ck_assert_uint_eq(z.build_id, p.build_id);
    ck_assert_uint_eq(z.file_bytes, p.file_bytes);
    ck_assert_uint_eq(z.stored_bytes, one.count);
    ck_assert_uint_eq(counts.bytes_written, z.stored_bytes + z.file_bytes);
    ck_assert_msg(mn_header_read(pressed, &read, &st) == MN_OK, "%s", st.text);
    ck_assert(memcmp(&read, &z, sizeof z) == 0);
    ck_assert_msg(mn_verify(pressed, NULL, &result, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(result.blocks, p.blocks);
    ck_assert_msg(fixture_load(pressed, &back, &st) == MN_OK, "%s", st.text);
    fixture_same(tree, &back);
    desc.zstd_level = 0;
    write_tree(again, &back, &desc, &read, NULL);
    bytes unpacked = read_all(again);
    ck_assert(same_bytes(whole, unpacked));
    mn_tree_free(&back);
    free(one.at);
    free(two.at);
    free(whole.at);
    free(unpacked.at);
}

START_TEST(every_layout) {
    mn_mesh mesh;
    mn_tree tree;
    if (_i == 2)
        fixture_book(9000, &mesh); /* overflows */
    else
        fixture_sheet(_i == 3 ? 4 : 45, 1, _i == 1, &mesh);
    if (_i == 4)
        fixture_random_tree(&mesh, fixture_seed(7), &tree);
    else
        fixture_tree(&mesh, &tree);
    for (uint32_t length = 4096; length <= 65536; length *= 4)
        there_and_back(&tree, (mn_block_desc){.block_bytes = length});
    for (uint32_t l = 1; l <= 9; l += 4)
        there_and_back(&tree, (mn_block_desc){.blocking = MN_BLOCKING_LEVELS, .l = l});
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* Header, table and extents up to the last are all covered by a check. */
START_TEST(no_byte_goes_unnoticed) {
    mn_mesh mesh;
    mn_tree tree;
    mn_header h;
    uint64_t state = fixture_seed(3);
    char path[200];
    strcpy(path, fixture_path("damaged.mnt"));
    fixture_sheet(60, 1, false, &mesh);
    fixture_tree(&mesh, &tree);
    write_tree(path, &tree, &(mn_block_desc){.block_bytes = 4096, .zstd_level = 3}, &h, NULL);
    bytes whole = read_all(path);
    size_t end = whole.count;
    while (whole.at[end - 1] == 0)
        end--;
    const size_t table_end = MN_PAGE_BYTES + 2 * (size_t)(h.file_bytes / MN_PAGE_BYTES);
    for (int i = 0; i < 200; i++) {
        size_t at = fixture_random(&state) % end;
        if (at >= table_end && at < mni_extents_begin(h.file_bytes / MN_PAGE_BYTES))
            continue; /* the rest of the table's last page */
        const unsigned char was = whole.at[at];
        whole.at[at] ^= (unsigned char)(1 << fixture_random(&state) % 8);
        write_all(path, whole.at, whole.count);
        mn_status st = {0};
        mn_verify_result result;
        mn_code code = mn_verify(path, NULL, &result, &st);
        /* a frame of zstd's may say the same in another way */
        mn_tree back;
        if (code == MN_OK && at >= table_end && fixture_load(path, &back, &st) == MN_OK) {
            fixture_same(&tree, &back);
            mn_tree_free(&back);
        } else {
            ck_assert_msg(code == MN_BAD_INPUT, "byte %zu: %d %s", at, code, st.text);
        }
        whole.at[at] = was;
    }
    for (int i = 0; i < 40; i++) { /* cut anywhere, and grown */
        size_t count = i == 0   ? whole.count - 1
                       : i == 1 ? whole.count - MN_PAGE_BYTES
                                : fixture_random(&state) % whole.count;
        write_all(path, whole.at, count);
        mn_status st = {0};
        mn_verify_result result;
        ck_assert_int_eq(mn_verify(path, NULL, &result, &st), MN_BAD_INPUT);
        ck_assert_ptr_nonnull(strstr(st.text, path));
    }
    free(whole.at);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(refusals) {
    mn_mesh mesh;
    mn_tree tree;
    mn_header h;
    mn_status st = {0};
    char path[200];
    strcpy(path, fixture_path("refused.mnt"));
    fixture_sheet(40, 1, false, &mesh);
    fixture_tree(&mesh, &tree);
    mn_block_desc desc = {.zstd_level = 23};
    ck_assert_int_eq(mn_block_write(path, &tree, &desc, &h, NULL, &st), MN_USAGE);
    desc = (mn_block_desc){.zstd_level = 22, .ram_bytes = 1 << 20};
    st = (mn_status){0};
    ck_assert_int_eq(mn_block_write(path, &tree, &desc, &h, NULL, &st), MN_CAP_TOO_SMALL);
    ck_assert_ptr_nonnull(strstr(st.text, "--ram"));
    FILE *f = fopen(path, "rb");
    ck_assert_ptr_null(f); /* nothing is left behind */
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("press");
    TCase *tc = tcase_create("press");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, every_layout, 0, 5);
    tcase_add_test(tc, no_byte_goes_unnoticed);
    tcase_add_test(tc, refusals);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
