/* Goal: blocks of policy `packed` are full, and few of them are in use, whatever the front.
 * Method: files of made models; fill against bounds; fronts (settled ones, and what an eye near the
 * surface wants) against bounds and against a packing of as many nodes a block in preorder. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "block.h"
#include "file.h"
#include "frame.h"
#include "header.h"
#include "suite.h"
#include "tree.h"
#include "tree_fixture.h"

enum { TRIANGLES = 200000 };
static mn_tree model[2]; /* terrain, sphere */
static uint32_t *above;  /* inner node of model[0]: its parent */

static uint32_t child_of(const mn_tree *t, uint32_t node, uint32_t side) {
    uint32_t order = side == 0 ? t->left[node] : t->right[node];
    return order < t->leaves ? MN_NONE : order - t->leaves;
}

static void make_model(mn_shape shape, mn_tree *tree) {
    const char *path = fixture_path("model.ply");
    mn_status st = {0};
    mn_mesh mesh;
    mn_make_desc desc = {.shape = shape, .triangles = TRIANGLES};
    ck_assert_msg(mn_make(path, &desc, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_mesh_read(path, NULL, &mesh, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_mesh_quantise(&mesh, 0, &st) == MN_OK, "%s", st.text);
    fixture_tree(&mesh, tree);
    mn_mesh_free(&mesh);
}

static void make_models(void) {
    make_model(MN_SHAPE_TERRAIN, &model[0]);
    make_model(MN_SHAPE_SPHERE, &model[1]);
    const mn_tree *t = &model[0];
    above = malloc(sizeof *above * t->inner);
    ck_assert(above != NULL);
    for (uint32_t i = 0; i < t->inner; i++)
        for (uint32_t side = 0; side < 2; side++)
            if (child_of(t, i, side) != MN_NONE)
                above[child_of(t, i, side)] = i;
}

static void free_models(void) {
    mn_tree_free(&model[0]);
    mn_tree_free(&model[1]);
    free(above);
}

static void pack(const mn_tree *tree, uint32_t block_bytes, mn_header *h) {
    mn_status st = {0};
    mn_block_desc desc = {.block_bytes = block_bytes};
    ck_assert_msg(mn_block_write(fixture_path("p.mnt"), tree, &desc, h, NULL, &st) == MN_OK, "%s",
                  st.text);
}

/* Which block, counted from 0, each inner node is in. */
static void blocks_of_nodes(const mn_header *h, uint32_t *block_of) {
    mn_status st = {0};
    mni_in in;
    ck_assert(mni_in_open(&in, fixture_path("p.mnt"), &st) == MN_OK);
    unsigned char *bytes = malloc(h->block_bytes_max);
    mn_block_ref *stack = malloc(sizeof *stack * h->blocks);
    uint32_t waiting = 0, blocks = 0;
    ck_assert(bytes != NULL && stack != NULL);
    ck_assert_uint_eq(h->roots, 1);
    stack[waiting++] = h->root[0].block;
    for (; waiting > 0; blocks++) {
        mn_block_ref place = stack[--waiting];
        const mni_block_limits limits = mni_block_limits_of(h);
        mni_block view;
        mni_frame frame;
        mni_walk walk;
        mni_node node;
        uint32_t length = place.pages * MN_PAGE_BYTES;
        ck_assert(mni_in_read(&in, (uint64_t)place.id * MN_PAGE_BYTES, bytes, length) == length);
        ck_assert(mni_block_open(&view, bytes, length, &limits, NULL, 0));
        mni_walk_begin(&walk, &view);
        for (uint32_t at; mni_walk_next(&walk, &at, &node);)
            block_of[node.facts.order - h->leaves] = blocks;
        mni_frame_get(bytes, &frame);
        for (uint32_t r = 0; r < frame.refs; r++)
            stack[waiting++] = mni_frame_ref(bytes, r);
    }
    ck_assert_uint_eq(blocks, h->blocks);
    free(stack);
    free(bytes);
    mni_in_close(&in);
}

/* Of fewer, one that stays part empty is more than a twentieth. */
enum { BLOCKS_LEAST = 20, NODES_MANY = 255 };

START_TEST(blocks_are_full) {
    double many = 0, many_blocks = 0;
    for (uint32_t m = 0; m < 2; m++)
        for (uint32_t bytes = 4096; bytes <= 131072; bytes *= 2) {
            mn_header h;
            pack(&model[m], bytes, &h);
            printf("%u blocks of %u: fill %.3f\n", h.blocks, bytes, h.fill_mean);
            if (h.blocks < BLOCKS_LEAST)
                continue;
            const bool is_many = model[m].inner / h.blocks >= NODES_MANY;
            ck_assert_double_ge(h.fill_mean, is_many ? 0.949 : 0.92);
            many += is_many ? h.fill_mean * h.blocks : 0;
            many_blocks += is_many ? h.blocks : 0;
        }
    ck_assert_double_ge(many_blocks, 500);
    ck_assert_double_ge(many / many_blocks, 0.96);
}
END_TEST

/* ---- blocks in use -------------------------------------------------------------------------- */

/* How many blocks have a node that is split and a child that is active. */
static uint32_t in_use(const mn_tree *t, const unsigned char *split, const uint32_t *block_of,
                       uint32_t blocks) {
    unsigned char *used = calloc(blocks, 1);
    uint32_t count = 0;
    ck_assert(used != NULL);
    for (uint32_t i = 0; i < t->inner; i++)
        for (uint32_t side = 0; side < 2 && split[i]; side++) {
            uint32_t child = child_of(t, i, side);
            if ((child == MN_NONE || !split[child]) && !used[block_of[i]]) {
                used[block_of[i]] = 1;
                count++;
            }
        }
    free(used);
    return count;
}

/* Blocks of as many nodes each, in preorder: subtrees, deep ones. */
static void cut_preorder(const mn_tree *t, uint32_t each, uint32_t *block_of) {
    uint32_t *stack = malloc(sizeof *stack * (t->depth_max + 1)), waiting = 0, taken = 0;
    ck_assert(stack != NULL);
    stack[waiting++] = t->root[0] - t->leaves;
    while (waiting > 0) {
        uint32_t node = stack[--waiting];
        block_of[node] = taken++ / each;
        for (uint32_t side = 2; side-- > 0;)
            if (child_of(t, node, side) != MN_NONE)
                stack[waiting++] = child_of(t, node, side);
    }
    free(stack);
}

static void settled(const mn_tree *t, double share, unsigned char *split) {
    mn_status st = {0};
    mn_mesh mesh;
    uint32_t *owner;
    float error = t->switch_value[(uint32_t)((1 - share) * t->inner)];
    mn_extract_desc desc = {.what = MN_EXTRACT_ERROR, .error = error};
    ck_assert_msg(mn_tree_extract(t, &desc, &mesh, &owner, &st) == MN_OK, "%s", st.text);
    memset(split, 0, t->inner);
    for (uint32_t v = 0; v < mesh.vertices; v++)
        for (uint32_t i = owner[v] < t->leaves ? MN_NONE : above[owner[v] - t->leaves];
             i != MN_NONE && !split[i]; i = i == t->root[0] - t->leaves ? MN_NONE : above[i])
            split[i] = 1;
    free(owner);
    mn_mesh_free(&mesh);
}

/* What an eye above that leaf wants. */
static void seen(const mn_tree *t, uint32_t leaf, double height, double tolerance,
                 unsigned char *split) {
    const float *below = t->leaf_position + 3 * (size_t)leaf;
    for (uint32_t i = t->inner; i-- > 0;) {
        const float *at = t->leaf_position + 3 * (size_t)t->leaf_lo[i];
        double distance =
            hypot(hypot(at[0] - below[0], at[1] - below[1] - height), at[2] - below[2]) -
            t->radius[i];
        split[i] = t->switch_value[i] > tolerance * fmax(distance, height / 100);
    }
}

/* Blocks in use × nodes in a block / nodes split: 1 where all of each block in use is split. Bounds
 * are a twentieth above what was measured. Packers that give blocks few deep subtrees, or exits of
 * like order from all over, or that take the deepest nodes first, or the highest, are above them.
 */
static const double times_most[] = {5.45, 6.15, 7.1};

START_TEST(few_blocks_are_in_use) {
    enum { FRONTS = 8 };
    const mn_tree *t = &model[0];
    uint32_t *preorder = malloc(sizeof *preorder * t->inner);
    uint32_t *block_of = malloc(sizeof *block_of * t->inner);
    unsigned char *split = malloc(t->inner);
    ck_assert(preorder != NULL && block_of != NULL && split != NULL);
    mn_header h;
    pack(t, 4096u << _i, &h);
    blocks_of_nodes(&h, block_of);
    uint32_t each = t->inner / h.blocks + 1;
    cut_preorder(t, each, preorder);
    double times = 0, plain = 0;
    for (uint32_t f = 0; f < FRONTS; f++) {
        if (f < 4)
            settled(t, 0.001 * pow(2.5, f), split);
        else
            seen(t, t->leaves / 5 * (f - 3), 0.02, 0.008 * pow(1.5, f - 4), split);
        uint32_t nodes = 0, use = in_use(t, split, block_of, h.blocks);
        for (uint32_t i = 0; i < t->inner; i++)
            nodes += split[i];
        ck_assert_uint_gt(nodes, 50);
        times += (double)use * each / nodes / FRONTS;
        plain += (double)in_use(t, split, preorder, h.blocks) * each / nodes / FRONTS;
    }
    printf("blocks of %u: %.2f times what is split, %.2f in preorder\n", h.block_bytes, times,
           plain);
    ck_assert_double_le(4 * times, plain);
    ck_assert_double_le(times, times_most[_i]);
    free(block_of);
    free(preorder);
    free(split);
}
END_TEST

int main(void) {
    Suite *s = suite_create("packed");
    TCase *t = tcase_create("packed");
    tcase_add_unchecked_fixture(t, make_models, free_models);
    tcase_set_timeout(t, 60);
    tcase_add_test(t, blocks_are_full);
    tcase_add_loop_test(t, few_blocks_are_in_use, 0, 3);
    suite_add_tcase(s, t);
    return suite_run(s);
}
