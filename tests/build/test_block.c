/* Goal: what a tree says survives being cut into blocks, whatever the policy.
 * Method: trees by mn_simplify and trees drawn by lot, written, loaded back, compared whole. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "header.h"
#include "tree_fixture.h"

static void round_trip(const mn_tree *tree, const mn_block_desc *desc, mn_header *h) {
    const char *path = fixture_path("round.mnt");
    mn_status st = {0};
    mn_header read;
    mn_block_counts counts;
    mn_tree back;
    ck_assert_msg(mn_block_write(path, tree, desc, h, &counts, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_header_read(path, &read, &st) == MN_OK, "%s", st.text);
    ck_assert(memcmp(h, &read, sizeof read) == 0);
    ck_assert_uint_eq(counts.bytes_written, h->file_bytes);
    ck_assert_msg(mn_tree_load(path, &back, &st) == MN_OK, "%s", st.text);
    fixture_same(tree, &back);
    mn_tree_free(&back);
}

START_TEST(levels_keep_the_tree) {
    mn_mesh mesh;
    mn_tree tree;
    mn_header h;
    fixture_sheet(30, 1, _i % 2 == 1, &mesh);
    if (_i < 2)
        fixture_tree(&mesh, &tree);
    else
        fixture_random_tree(&mesh, fixture_seed(7), &tree);
    for (uint32_t l = 1; l <= 8; l++) {
        round_trip(&tree, &(mn_block_desc){.blocking = MN_BLOCKING_LEVELS, .l = l}, &h);
        ck_assert_uint_eq(h.l, l);
        ck_assert_uint_eq(h.block_depth, (tree.depth_max - 1 + l - 1) / l);
        ck_assert_uint_le(h.nodes_per_block_max, (1u << l) - 1);
        if (l == 1)
            ck_assert_uint_eq(h.blocks, tree.inner);
    }
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(packed_keeps_the_tree) {
    mn_mesh mesh;
    mn_tree tree;
    mn_header h;
    fixture_sheet(60, 1, _i % 2 == 1, &mesh);
    if (_i < 2)
        fixture_tree(&mesh, &tree);
    else
        fixture_random_tree(&mesh, fixture_seed(7), &tree);
    for (uint32_t bytes = 4096; bytes <= 65536; bytes *= 2) {
        round_trip(&tree, &(mn_block_desc){.block_bytes = bytes}, &h);
        ck_assert_uint_eq(h.block_bytes, bytes);
        ck_assert_uint_le(h.block_bytes_max, bytes);
        printf("%u bytes: %u blocks, fill %.3f, depth %u\n", bytes, h.blocks, h.fill_mean,
               h.block_depth);
    }
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(a_thick_edge_overflows) {
    mn_mesh mesh;
    mn_tree tree;
    mn_header h;
    fixture_book(20000, &mesh);
    fixture_random_tree(&mesh, fixture_seed(3), &tree);
    round_trip(&tree, &(mn_block_desc){.blocking = MN_BLOCKING_LEVELS, .l = 3}, &h);
    ck_assert_uint_ge(h.overflow_max, 1);
    round_trip(&tree, &(mn_block_desc){.block_bytes = 4096}, &h);
    ck_assert_uint_ge(h.overflow_max, 2);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* The pages of a book collapse one after the other: a subtree small enough for a block, but deeper
 * than a block may be. */
START_TEST(a_chain_is_cut_by_its_depth) {
    mn_mesh mesh;
    mn_tree tree;
    mn_header h;
    fixture_book(700, &mesh);
    fixture_tree(&mesh, &tree);
    ck_assert_uint_gt(tree.depth_max, 256);
    round_trip(&tree, &(mn_block_desc){.block_bytes = 1 << 20}, &h);
    ck_assert_uint_ge(h.block_depth, 2);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

int main(void) {
    Suite *s = suite_create("block");
    TCase *t = tcase_create("policies");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, levels_keep_the_tree, 0, 4);
    tcase_add_loop_test(t, packed_keeps_the_tree, 0, 4);
    tcase_add_test(t, a_thick_edge_overflows);
    tcase_add_test(t, a_chain_is_cut_by_its_depth);
    suite_add_tcase(s, t);
    SRunner *r = srunner_create(s);
    srunner_run_all(r, CK_NORMAL);
    int failed = srunner_ntests_failed(r);
    srunner_free(r);
    return failed != 0;
}
