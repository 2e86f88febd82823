/* Goal: blocks of policy `packed` are full, and few of them are in use, whatever the front.
 * Method: plans of made models; fill against bounds; fronts (settled ones, and what an eye near the
 * surface wants) against bounds and against a packing of as many nodes a block in preorder. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "plan.h"
#include "suite.h"
#include "tree.h"
#include "tree_fixture.h"

enum { TRIANGLES = 200000 };
static mn_tree model[2]; /* terrain, sphere */
static uint32_t *above;  /* inner node of model[0]: its parent */

static void make_model(mn_shape shape, mn_tree *tree) {
    const char *path = fixture_path("model.ply");
    mn_status st = {0};
    mn_mesh mesh;
    mn_make_desc desc = {.shape = shape, .triangles = TRIANGLES};
    ck_assert_msg(mn_make(path, &desc, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_mesh_read(path, NULL, &mesh, &st) == MN_OK, "%s", st.text);
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
            if (mni_plan_child(t, i, side) != MN_NONE)
                above[mni_plan_child(t, i, side)] = i;
}

static void free_models(void) {
    mn_tree_free(&model[0]);
    mn_tree_free(&model[1]);
    free(above);
}

static void plan_packed(const mn_tree *tree, const mn_block_desc *desc, mni_plan *plan) {
    mn_status st = {0};
    ck_assert_msg(mni_plan_open(plan, tree, desc, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mni_plan_packed(plan, &st) == MN_OK, "%s", st.text);
}

/* A few blocks are no mean: the last below each run stays part empty. */
enum { BLOCKS_LEAST = 50, NODES_MANY = 255 };

START_TEST(blocks_are_full) {
    double many = 0, many_blocks = 0;
    for (uint32_t m = 0; m < 2; m++)
        for (uint32_t bytes = 4096; bytes <= 65536; bytes *= 2) {
            mn_block_desc desc = {.block_bytes = bytes};
            mni_plan plan;
            double payload = 0;
            plan_packed(&model[m], &desc, &plan);
            for (uint32_t b = 0; b < plan.blocks; b++)
                payload += plan.block[b].payload_bytes;
            double fill = payload / plan.blocks / bytes;
            printf("%u blocks of %u: fill %.3f\n", plan.blocks, bytes, fill);
            if (plan.blocks >= BLOCKS_LEAST)
                ck_assert_double_ge(fill, 0.92);
            if (plan.blocks >= BLOCKS_LEAST && model[m].inner / plan.blocks >= NODES_MANY) {
                many += payload / bytes;
                many_blocks += plan.blocks;
            }
            mni_plan_close(&plan);
        }
    ck_assert_double_ge(many_blocks, 2 * BLOCKS_LEAST);
    ck_assert_double_ge(many / many_blocks, 0.95);
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
            uint32_t child = mni_plan_child(t, i, side);
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
            if (mni_plan_child(t, node, side) != MN_NONE)
                stack[waiting++] = mni_plan_child(t, node, side);
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
static const double times_most[] = {7.0, 8.4, 10.2};

START_TEST(few_blocks_are_in_use) {
    enum { FRONTS = 8 };
    const mn_tree *t = &model[0];
    uint32_t *preorder = malloc(sizeof *preorder * t->inner);
    unsigned char *split = malloc(t->inner);
    ck_assert(preorder != NULL && split != NULL);
    mn_block_desc desc = {.block_bytes = 4096u << _i};
    mni_plan plan;
    plan_packed(t, &desc, &plan);
    uint32_t each = t->inner / plan.blocks + 1;
    cut_preorder(t, each, preorder);
    double times = 0, plain = 0;
    for (uint32_t f = 0; f < FRONTS; f++) {
        if (f < 4)
            settled(t, 0.001 * pow(2.5, f), split);
        else
            seen(t, t->leaves / 5 * (f - 3), 0.02, 0.008 * pow(1.5, f - 4), split);
        uint32_t nodes = 0, use = in_use(t, split, plan.block_of, plan.blocks);
        for (uint32_t i = 0; i < t->inner; i++)
            nodes += split[i];
        ck_assert_uint_gt(nodes, 100);
        times += (double)use * each / nodes / FRONTS;
        plain += (double)in_use(t, split, preorder, plan.blocks) * each / nodes / FRONTS;
    }
    printf("blocks of %u: %.2f times what is split, %.2f in preorder\n", desc.block_bytes, times,
           plain);
    ck_assert_double_le(4 * times, plain);
    ck_assert_double_le(times, times_most[_i]);
    mni_plan_close(&plan);
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
