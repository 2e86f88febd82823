/* Goal: verify says yes to the input however it is numbered, and names the first difference.
 * Method: files of small meshes, compared with copies that were shuffled, moved, turned or changed
 * in one place. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "against.h"
#include "suite.h"
#include "tree_fixture.h"

/* The mesh goes through a file, as --against has it; with as little memory as that takes. */
static mn_code check(const char *path, const mn_mesh *against, mn_verify_result *r, mn_status *st) {
    static char input[160]; /* fixture_path has few names at a time */
    const mn_verify_desc desc = {.against = against != NULL ? input : NULL,
                                 .either_weld = true,
                                 .ram_bytes = 7 << 20,
                                 .temp_dir = "/tmp"};
    memset(st, 0, sizeof *st);
    if (input[0] == 0)
        snprintf(input, sizeof input, "%s", fixture_path("against.ply"));
    if (against != NULL)
        ck_assert_msg(mn_mesh_write_ply(input, against, st) == MN_OK, "%s", st->text);
    return mn_verify(path, &desc, r, st);
}

/* A .mnt and a .vdt of the mesh's tree. */
static void write_both(const mn_mesh *mesh, mn_tree *tree) {
    mn_status st = {0};
    fixture_tree(mesh, tree);
    ck_assert(mn_tree_write(fixture_path("v.vdt"), tree, &st) == MN_OK);
    ck_assert(mn_block_write(fixture_path("v.mnt"), tree, NULL, NULL, NULL, &st) == MN_OK);
}

static void shuffle(mn_mesh *m, uint64_t *seed) {
    uint32_t *to = malloc(sizeof *to * m->vertices);
    float *position = malloc(3 * sizeof *position * m->vertices);
    for (uint32_t v = 0; v < m->vertices; v++)
        to[v] = v;
    for (uint32_t v = m->vertices; v > 1; v--) {
        uint32_t other = fixture_random(seed) % v, swap = to[v - 1];
        to[v - 1] = to[other];
        to[other] = swap;
    }
    for (uint32_t v = 0; v < m->vertices; v++)
        memcpy(position + 3 * (size_t)to[v], m->position + 3 * (size_t)v, 12);
    memcpy(m->position, position, 12 * (size_t)m->vertices);
    for (uint32_t f = m->triangles; f-- > 0;) {
        uint32_t a[3], *here = m->corner + 3 * (size_t)f;
        uint32_t *there = m->corner + 3 * (size_t)(fixture_random(seed) % (f + 1));
        uint32_t turn = fixture_random(seed) % 3;
        memcpy(a, there, sizeof a);
        memcpy(there, here, sizeof a);
        for (uint32_t k = 0; k < 3; k++)
            here[k] = a[(k + turn) % 3];
    }
    for (uint32_t c = 0; c < 3 * m->triangles; c++)
        m->corner[c] = to[m->corner[c]];
    free(to);
    free(position);
}

START_TEST(the_input_is_known_in_any_order) {
    mn_mesh mesh;
    mn_tree tree;
    mn_verify_result r;
    mn_status st;
    uint64_t seed = fixture_seed(29);
    fixture_sheet(20, 1, false, &mesh);
    write_both(&mesh, &tree);
    shuffle(&mesh, &seed);
    const char *names[] = {"v.mnt", "v.vdt"};
    for (int i = 0; i < 2; i++) {
        ck_assert_msg(check(fixture_path(names[i]), &mesh, &r, &st) == MN_OK, "%s", st.text);
        ck_assert_uint_eq(r.matched_triangles, mesh.triangles);
        ck_assert_uint_eq(r.triangles, mesh.triangles);
        ck_assert_uint_eq(r.hinges, tree.simplices - tree.triangles);
        ck_assert_uint_eq(r.nodes, (uint64_t)tree.leaves + tree.inner);
        ck_assert((r.blocks > 0) == (i == 0));
    }
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(one_change_is_named) {
    mn_mesh mesh;
    mn_tree tree;
    mn_verify_result r;
    mn_status st;
    fixture_sheet(12, 1, false, &mesh);
    write_both(&mesh, &tree);
    const char *path = fixture_path("v.mnt");

    uint32_t *c = mesh.corner + 3 * 17, swap = c[0];
    char where[80];
    const float *p = mesh.position + 3 * (size_t)c[2];
    snprintf(where, sizeof where, "(%.9g %.9g %.9g)", p[0], p[1], p[2]);
    c[0] = c[1]; /* turned over */
    c[1] = swap;
    ck_assert_int_eq(check(path, &mesh, &r, &st), MN_BAD_INPUT);
    ck_assert_msg(strstr(st.text, where) != NULL, "%s", st.text);
    ck_assert_uint_eq(r.matched_triangles, mesh.triangles - 1);
    c[1] = c[0];
    c[0] = swap;
    ck_assert_int_eq(check(path, &mesh, &r, &st), MN_OK);

    mesh.position[3 * 5 + 1] += 1e-3f; /* moved */
    ck_assert_int_eq(check(path, &mesh, &r, &st), MN_BAD_INPUT);
    ck_assert_msg(strstr(st.text, "is no vertex of the input") != NULL, "%s", st.text);
    mesh.position[3 * 5 + 1] -= 1e-3f;

    mesh.triangles--; /* one fewer */
    ck_assert_int_eq(check(path, &mesh, &r, &st), MN_BAD_INPUT);
    mesh.triangles++;

    memcpy(c, c + 3, 3 * sizeof *c); /* one twice instead of another */
    ck_assert_int_eq(check(path, &mesh, &r, &st), MN_BAD_INPUT);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* Vertices at equal positions, as --weld off leaves them, or as positions that fell together. */
START_TEST(equal_positions_do_not_confuse) {
    mn_mesh mesh;
    mn_tree tree;
    mn_verify_result r;
    mn_status st;
    uint64_t seed = fixture_seed(31);
    fixture_sheet(12, 1, false, &mesh);
    for (uint32_t v = 40; v < 60; v++)
        memcpy(mesh.position + 3 * (size_t)v, mesh.position + 3 * (size_t)(v + 12), 12);
    mesh.position[0] = -0.0f;
    write_both(&mesh, &tree);
    shuffle(&mesh, &seed);
    for (uint32_t i = 0; i < 3 * mesh.vertices; i++)
        mesh.position[i] = mesh.position[i] == 0 ? 0.0f : mesh.position[i];
    ck_assert_msg(check(fixture_path("v.mnt"), &mesh, &r, &st) == MN_OK, "%s", st.text);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* The input may be off by half a step, not by more; what falls together is counted. */
START_TEST(half_a_step_is_let_pass) {
    mn_mesh mesh;
    mn_tree tree;
    mn_verify_result r;
    mn_status st;
    uint64_t seed = fixture_seed(37);
    fixture_sheet(12, 1, false, &mesh);
    memcpy(mesh.position + 3 * 70, mesh.position + 3 * 71, 12);
    write_both(&mesh, &tree);
    const float half = mesh.grid_step / 2;
    for (uint32_t i = 0; i < 3 * mesh.vertices; i++)
        mesh.position[i] += half * ((float)(fixture_random(&seed) % 1999) / 1000 - 0.999f);
    const char *names[] = {"v.mnt", "v.vdt"};
    for (int i = 0; i < 2; i++) {
        ck_assert_msg(check(fixture_path(names[i]), &mesh, &r, &st) == MN_OK, "%s", st.text);
        ck_assert_uint_eq(r.matched_triangles, mesh.triangles);
        ck_assert_uint_eq(r.merged_positions, 1);
    }
    mesh.position[3 * 30] = roundf(mesh.position[3 * 30] / (2 * half)) * 2 * half + 1.2f * half;
    ck_assert_int_eq(check(fixture_path("v.mnt"), &mesh, &r, &st), MN_BAD_INPUT);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(another_origin_is_heeded) {
    mn_mesh mesh;
    mn_tree tree;
    mn_verify_result r;
    mn_status st;
    fixture_sheet(12, 1, false, &mesh);
    for (uint32_t i = 0; i < 3 * mesh.vertices; i++)
        mesh.position[i] = (float)(int)(mesh.position[i] * 256) / 256; /* exact under the shift */
    write_both(&mesh, &tree);
    for (uint32_t i = 0; i < 3 * mesh.vertices; i++)
        mesh.position[i] -= 8;
    ck_assert_int_eq(check(fixture_path("v.mnt"), &mesh, &r, &st), MN_BAD_INPUT);
    for (int i = 0; i < 3; i++)
        mesh.origin[i] = 8;
    ck_assert_msg(check(fixture_path("v.mnt"), &mesh, &r, &st) == MN_OK, "%s", st.text);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(a_hinge_must_be_an_edge) {
    mn_mesh mesh;
    mn_tree tree;
    mn_verify_result r;
    mn_status st = {0};
    fixture_sheet(12, 1, false, &mesh);
    fixture_tree(&mesh, &tree);
    uint32_t found = MN_NONE, node = 0;
    for (uint32_t i = 0; i < tree.inner; i++)
        for (uint32_t s = tree.simplex_start[i]; s < tree.simplex_start[i + 1]; s++)
            if (tree.corner[3 * (size_t)s + 2] == MN_NONE &&
                tree.leaf_mid[i] - tree.leaf_lo[i] > 20) {
                found = s;
                node = i;
            }
    ck_assert_msg(found != MN_NONE, "this sheet makes a hinge at the top");
    uint32_t *hinge = tree.corner + 3 * (size_t)found, lies = 0;
    bool left_first = hinge[0] < tree.leaf_mid[node];
    for (uint32_t v = tree.leaf_lo[node]; v < tree.leaf_mid[node]; v++) {
        hinge[left_first ? 0 : 1] = v; /* of 20 leaves most share no edge with the other end */
        ck_assert(mn_block_write(fixture_path("h.mnt"), &tree, NULL, NULL, NULL, &st) == MN_OK);
        mn_status why;
        if (check(fixture_path("h.mnt"), &mesh, &r, &why) != MN_OK) {
            ck_assert_msg(strstr(why.text, "is no edge of the input") != NULL, "%s", why.text);
            lies++;
        }
    }
    ck_assert_uint_gt(lies, 10);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* The simplices come from another walk than the counts: in between the file may have been changed.
 */
START_TEST(a_hinge_where_there_are_to_be_none_is_said) {
    char input[160];
    mn_mesh mesh;
    mn_status st = {0};
    mni_against *a;
    snprintf(input, sizeof input, "%s", fixture_path("none.ply"));
    fixture_sheet(4, 1, false, &mesh);
    ck_assert(mn_mesh_write_ply(input, &mesh, &st) == MN_OK);
    const mni_against_desc desc = {.name = "none.mnt",
                                   .input = input,
                                   .work_bytes = MNI_AGAINST_WORK_MIN,
                                   .temp_dir = "/tmp",
                                   .leaves = mesh.vertices,
                                   .triangles = mesh.triangles};
    ck_assert_msg(mni_against_open(&a, &desc, &st) == MN_OK, "%s", st.text);
    for (uint32_t v = 0; v < mesh.vertices; v++)
        ck_assert(mni_against_leaf(a, v, mesh.position + 3 * (size_t)v) == MN_OK);
    ck_assert_msg(mni_against_match(a) == MN_OK, "%s", st.text);
    const uint32_t hinge[3] = {0, 1, MN_NONE};
    ck_assert_int_eq(mni_against_simplex(a, hinge), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "a hinge (leaves 0 1)"));
    mni_against_close(a);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(what_is_no_file_of_ours_is_said) {
    mn_verify_result r;
    mn_status st;
    const char *path = fixture_path("text.mnt");
    FILE *f = fopen(path, "w");
    for (int i = 0; i < 1000; i++)
        fputs("not a tree\n", f);
    fclose(f);
    ck_assert_int_eq(check(path, NULL, &r, &st), MN_BAD_INPUT);
    ck_assert(strstr(st.text, "magic") != NULL);
    ck_assert_int_eq(check("/tmp", NULL, &r, &st), MN_BAD_INPUT);
    ck_assert_int_eq(check(fixture_path("absent.mnt"), NULL, &r, &st), MN_BAD_INPUT);
    f = fopen(path, "w");
    fclose(f);
    ck_assert_int_eq(check(path, NULL, &r, &st), MN_BAD_INPUT);
}
END_TEST

START_TEST(a_vdt_keeps_the_tree) {
    mn_mesh mesh;
    mn_tree tree, back;
    mn_status st = {0};
    const char *path = fixture_path("keep.vdt");
    fixture_sheet(15, 2, _i == 1, &mesh);
    fixture_tree(&mesh, &tree);
    tree.intake = (mn_intake){1, 2, 3, 4, 5, 6, 7, 8};
    ck_assert(mn_tree_write(path, &tree, &st) == MN_OK);
    ck_assert_msg(mn_tree_read(path, &back, &st) == MN_OK, "%s", st.text);
    fixture_same(&tree, &back);
    ck_assert(memcmp(&tree.intake, &back.intake, sizeof tree.intake) == 0);
    tree.counts.seconds_simplify = 0; /* times are not kept */
    ck_assert(memcmp(&tree.counts, &back.counts, sizeof tree.counts) == 0);
    mn_tree_free(&tree);
    mn_tree_free(&back);
    mn_mesh_free(&mesh);
}
END_TEST

int main(void) {
    Suite *s = suite_create("verify");
    TCase *t = tcase_create("verify");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, the_input_is_known_in_any_order);
    tcase_add_test(t, one_change_is_named);
    tcase_add_test(t, equal_positions_do_not_confuse);
    tcase_add_test(t, half_a_step_is_let_pass);
    tcase_add_test(t, another_origin_is_heeded);
    tcase_add_test(t, a_hinge_must_be_an_edge);
    tcase_add_test(t, a_hinge_where_there_are_to_be_none_is_said);
    tcase_add_test(t, what_is_no_file_of_ours_is_said);
    tcase_add_loop_test(t, a_vdt_keeps_the_tree, 0, 2);
    suite_add_tcase(s, t);
    return suite_run(s);
}
