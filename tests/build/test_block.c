/* Goal: what a tree says survives being cut into blocks, whatever the policy.
 * Method: trees by mn_simplify and trees drawn by lot, written, loaded back, compared whole. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "header.h"
#include "suite.h"
#include "tree.h"
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
    ck_assert_msg(fixture_load(path, &back, &st) == MN_OK, "%s", st.text);
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
        if (_i < 2 && h.blocks >= 20) /* a real tree; a few blocks are no mean */
            ck_assert_double_ge(h.fill_mean, 0.9);
    }
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* A balanced tree without simplices: 16 levels of it are as many nodes as a block may have. */
static void balanced(uint32_t levels, mn_tree *tree) {
    uint32_t leaves = 1u << levels, made = 0, from = 0;
    mn_status st = {0};
    ck_assert(mni_tree_alloc(tree, leaves, 1, 0, false, &st) == MN_OK);
    for (uint32_t i = 0; i < 3 * leaves; i++)
        tree->leaf_position[i] = (float)(i % 100);
    for (uint32_t width = leaves / 2; width > 0; width /= 2)
        for (uint32_t i = 0; i < width; i++, from += 2) {
            tree->left[made] = from;
            tree->right[made] = from + 1;
            tree->switch_value[made] = tree->radius[made] = 1024.0f * (float)(leaves / width);
            tree->cone[made] = (mn_cone){{0, 0}, MN_CONE_NO_BOUND};
            made++;
        }
    tree->legal_last = leaves - 1;
    tree->grid_step = 1;
    ck_assert_msg(mni_tree_derive(tree, &st) == MN_OK, "%s", st.text);
}

START_TEST(a_block_may_have_65535_nodes) {
    mn_tree tree;
    mn_header h;
    balanced(16, &tree);
    round_trip(&tree, &(mn_block_desc){.blocking = MN_BLOCKING_LEVELS, .l = 16}, &h);
    ck_assert_uint_eq(h.blocks, 1);
    ck_assert_uint_eq(h.nodes_per_block_max, 65535);
    round_trip(&tree, &(mn_block_desc){.block_bytes = 1 << 20}, &h);
    ck_assert_uint_le(h.nodes_per_block_max, 65535);
    mn_tree_free(&tree);
}
END_TEST

START_TEST(the_smallest_tree_fits) {
    mn_tree tree;
    mn_header h;
    balanced(1, &tree);
    round_trip(&tree, &(mn_block_desc){0}, &h);
    ck_assert_uint_eq(h.blocks, 1);
    ck_assert_uint_eq(h.file_bytes, 2 * MN_PAGE_BYTES);
    round_trip(&tree, &(mn_block_desc){.blocking = MN_BLOCKING_LEVELS}, &h);
    ck_assert_uint_eq(h.l, 5);
    mn_tree_free(&tree);
}
END_TEST

/* The tree without its last collapses: a forest. */
static void cut_tops(mn_tree *tree, uint32_t collapses) {
    mn_status st = {0};
    tree->inner -= collapses;
    tree->roots += collapses;
    tree->simplices = tree->simplex_start[tree->inner];
    tree->triangles = 0;
    for (uint32_t s = 0; s < tree->simplices; s++)
        tree->triangles += tree->corner[3 * (size_t)s + 2] != MN_NONE;
    if (tree->legal_last >= tree->leaves + tree->inner)
        tree->legal_last = tree->leaves + tree->inner - 1;
    tree->root = realloc(tree->root, sizeof *tree->root * tree->roots);
    ck_assert_msg(mni_tree_derive(tree, &st) == MN_OK, "%s", st.text);
}

START_TEST(forests_have_their_roots_in_few_blocks) {
    mn_mesh mesh;
    mn_tree tree;
    mn_header h;
    mn_status st = {0};
    fixture_sheet(50, 1, false, &mesh);
    fixture_tree(&mesh, &tree);
    cut_tops(&tree, 19);
    ck_assert_uint_eq(tree.roots, 20);
    round_trip(&tree, &(mn_block_desc){.blocking = MN_BLOCKING_LEVELS, .l = 3}, &h);
    ck_assert_uint_eq(h.roots, 20);
    round_trip(&tree, &(mn_block_desc){.block_bytes = 16384}, &h);
    uint32_t places = 0;
    for (uint32_t r = 0; r < h.roots; r++) {
        uint32_t before = 0;
        while (before < r && h.root[before].block.id != h.root[r].block.id)
            before++;
        places += before == r;
    }
    ck_assert_uint_le(places, 6);
    cut_tops(&tree, 109);
    ck_assert_uint_eq(tree.roots, MN_ROOTS_MAX + 1);
    ck_assert_int_eq(mn_block_write(fixture_path("many.mnt"), &tree, NULL, NULL, NULL, &st),
                     MN_USAGE);
    ck_assert(strstr(st.text, "129 roots") != NULL);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(unsound_trees_are_not_written) {
    mn_mesh mesh;
    mn_tree tree;
    fixture_sheet(8, 1, false, &mesh);
    fixture_tree(&mesh, &tree);
    uint32_t top = tree.inner - 1;
    float *floats[] = {&tree.switch_value[top], &tree.radius[top], &tree.leaf_position[7],
                       &tree.grid_step};
    const float wrong[] = {-1, NAN, INFINITY, 0}; /* 0: a last bit */
    for (int f = 0; f < 4; f++)
        for (int w = f == 2; w < 4; w++) {
            mn_status st = {0};
            float saved = *floats[f];
            *floats[f] = wrong[w] != 0 ? wrong[w] : nextafterf(saved, INFINITY);
            ck_assert_int_eq(mn_block_write(fixture_path("un.mnt"), &tree, NULL, NULL, NULL, &st),
                             MN_BAD_INPUT);
            *floats[f] = saved;
        }
    uint32_t *words[] = {&tree.left[top], &tree.leaf_mid[top], &tree.simplex_start[top],
                         &tree.corner[1], &tree.root[0],       &tree.legal_last};
    for (int k = 0; k < 6; k++) {
        mn_status st = {0};
        uint32_t saved = *words[k];
        *words[k] = saved + 100000;
        ck_assert_int_eq(mn_tree_check(&tree, &st), MN_BAD_INPUT);
        *words[k] = saved;
    }
    mn_cone saved = tree.cone[top];
    tree.cone[top] = (mn_cone){{127, 0}, 1};
    mn_status st = {0};
    ck_assert_int_eq(mn_tree_check(&tree, &st), MN_BAD_INPUT);
    ck_assert(strstr(st.text, "cone") != NULL);
    tree.cone[top] = saved;
    ck_assert_int_eq(mn_tree_check(&tree, NULL), MN_OK);
    tree.grid_step /= 4096; /* too fine for differences to be exact */
    ck_assert_int_eq(mn_tree_check(&tree, &st), MN_BAD_INPUT);
    tree.grid_step = 0; /* sound, but what would its blocks count in? */
    ck_assert_int_eq(mn_tree_check(&tree, NULL), MN_OK);
    ck_assert_int_eq(mn_block_write(fixture_path("un.mnt"), &tree, NULL, NULL, NULL, &st),
                     MN_USAGE);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(the_same_tree_gives_the_same_bytes) {
    mn_mesh mesh;
    mn_tree tree;
    mn_header a, b;
    mn_status st = {0};
    fixture_sheet(20, 1, true, &mesh);
    fixture_tree(&mesh, &tree);
    ck_assert(mn_block_write(fixture_path("a.mnt"), &tree, NULL, &a, NULL, &st) == MN_OK);
    tree.counts.seconds_simplify += 1;
    ck_assert(mn_block_write(fixture_path("b.mnt"), &tree, NULL, &b, NULL, &st) == MN_OK);
    ck_assert_uint_eq(a.build_id, b.build_id);
    mn_block_desc other = {.block_bytes = 16384};
    ck_assert(mn_block_write(fixture_path("b.mnt"), &tree, &other, &b, NULL, &st) == MN_OK);
    ck_assert_uint_ne(a.build_id, b.build_id);
    tree.leaf_color[3] ^= 1;
    ck_assert(mn_block_write(fixture_path("b.mnt"), &tree, NULL, &b, NULL, &st) == MN_OK);
    ck_assert_uint_ne(a.build_id, b.build_id);
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
    tcase_add_test(t, a_block_may_have_65535_nodes);
    tcase_add_test(t, the_smallest_tree_fits);
    tcase_add_test(t, forests_have_their_roots_in_few_blocks);
    tcase_add_test(t, unsound_trees_are_not_written);
    tcase_add_test(t, the_same_tree_gives_the_same_bytes);
    tcase_add_test(t, a_chain_is_cut_by_its_depth);
    suite_add_tcase(s, t);
    return suite_run(s);
}
