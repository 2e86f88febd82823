/* Goal: OBJ is understood as its grammar says, and what is wrong is said with its line.
 * Method: small texts in every form, and the real meshes' known counts. */
#include "read_help.h"

#include <stdlib.h>
#include <string.h>

static const double xyz[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

#define CORNERS "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"

static void expect_one_face(const char *text) {
    mn_mesh mesh = read_text(text, NULL);
    ck_assert_uint_eq(mesh.vertices, 3);
    ck_assert_uint_eq(mesh.triangles, 1);
    ck_assert(has_triangle(&mesh, 0, xyz));
    mn_mesh_free(&mesh);
}

START_TEST(corner_forms) {
    expect_one_face(CORNERS "f 1 2 3\n");
    expect_one_face(CORNERS "f 1 2 3"); /* no newline at the end */
    expect_one_face(CORNERS "f 1/7 2/8 3/9\n");
    expect_one_face(CORNERS "f 1//7 2//8 3//9\n");
    expect_one_face(CORNERS "f 1/7/7 2/8/8 3/9/9\n");
    expect_one_face(CORNERS "f -4 -3 -2\n");
    expect_one_face(CORNERS "f -4/-1/-1 -3//-2 -2/-3\n");
    expect_one_face(CORNERS "f 1/ 2/ 3/\n");
    expect_one_face("f 1 2 3\n" CORNERS); /* vertices that come later */
    expect_one_face("v 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\n");
    expect_one_face("\xef\xbb\xbf\n \tv 0 0 0 # first\n\nv\t1 0 0\nv 0 1 0\n  f  1\t2  3  \n");
    expect_one_face("v 0 \\\n 0 0\nv 1 0 0\nv 0 1 \\\r\n0\nf 1 2\\\n 3\n");
    expect_one_face("o a\ng v 1\nvn 0 0 1\nvt 0 0\nusemtl f\ns 1\nl 1 2\n# v 9 \\\n" CORNERS
                    "curv 0 1 \\\nv 7 7\nf 1 2 3\n");
    expect_one_face("v +0 -0 .0\nv 1. 0e5 0E-3\nv 0 100e-2 0.000000000000000000000\nf 1 2 3\n");
}
END_TEST

START_TEST(polygons_are_fanned) {
    mn_mesh mesh = read_text(CORNERS "f 1 2 3 4\n", NULL);
    const double second[3][3] = {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    ck_assert_uint_eq(mesh.triangles, 2);
    ck_assert(has_triangle(&mesh, 0, xyz));
    ck_assert(has_triangle(&mesh, 1, second));
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(refusals_name_the_line) {
    static const char *const bad[][2] = {
        {CORNERS "f 1 2 5\n", "line 5: face 1: vertex 5 of 4"},
        {CORNERS "f 1 2 3\nf 1 2 0\n", "line 6: face 2: vertex 0 of 4"},
        {CORNERS "f -5 2 3\n", "line 5: face 1: vertex -5 of 4"},
        {"v 0 0 0\nf -1 -2 -3\n" CORNERS, "line 2: face 1: vertex -2 of 1"},
        {"f 1 2 9\n" CORNERS "f 1 2 3\n", "line 1: face 1: vertex 9 of 4"},
        {CORNERS "f 1 2 99999999999\n", "vertex 99999999999 of 4"},
        {CORNERS "f 1 2 99999999999999999999999\n", "line 5: face 1: '9999999"},
        {CORNERS "f 1 2 x\n", "line 5: face 1: 'x'"},
        {CORNERS "f 1 2 3.5\n", "line 5: face 1: '.5'"},
        {CORNERS "f 1/2/3/4 2 3\n", "line 5: face 1: '/4'"},
        {"v 1 2\n", "line 1: vertex 1 has 2 coordinates"},
        {"v 1 2 3\nv\nv 4 5 6\n", "line 2: vertex 2 has 0 coordinates"},
        {"v 1 2 3\nv", "line 2: vertex 2 has 0 coordinates"},
        {"v 1 two 3\n", "line 1: a coordinate is 'two'"},
        {"v 1 0x10 3\n", "a coordinate is '0x10'"},
        {"v 1 2 3,\n", "a coordinate is '3,'"},
        {CORNERS, "4 vertices and no face"},
        {CORNERS "f 1 1 2\nf 3 3 3\nf 1 2\n", "no face is left of 3: 3 degenerate"},
        {"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "no face is left of 1: 0 degenerate, 1 with"},
        {"hello\nworld\n", "not a mesh file that is known here"},
        {"# nothing\n", "not a mesh file that is known here"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        expect_refusal(bad[i][0], strlen(bad[i][0]), bad[i][1]);
}
END_TEST

START_TEST(colors) {
    mn_mesh mesh = read_text("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0\nf 1 2 3\n", NULL);
    ck_assert_ptr_nonnull(mesh.color);
    ck_assert_uint_eq(mesh.color[0], 0xff0000ffu);
    ck_assert_uint_eq(mesh.color[1], 0xff00ff00u);
    ck_assert_uint_eq(mesh.color[2], 0xffffffffu);
    mn_mesh_free(&mesh);
    mesh = read_text("v 0 0 0 255 128 0\nv 1 0 0 1 1 1\nv 0 1 0 0 0 0 127.5\nf 1 2 3\n", NULL);
    ck_assert_uint_eq(mesh.color[0], 0xff0080ffu);
    ck_assert_uint_eq(mesh.color[1], 0xff010101u);
    ck_assert_uint_eq(mesh.color[2], 0x80000000u);
    mn_mesh_free(&mesh);
    mesh = read_text("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n", NULL); /* w */
    ck_assert_ptr_null(mesh.color);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(real_meshes) {
    static const struct {
        const char *name;
        uint32_t triangles, vertices, welded, unused;
    } known[] = {
        {"bunny.obj", 69451, 34834, 0, 1113},  {"armadillo.obj", 86482, 43243, 0, 0},
        {"nefertiti.obj", 99938, 49971, 0, 0}, {"fandisk.obj", 12946, 6475, 0, 0},
        {"teapot.obj", 6320, 3241, 403, 0},    {"beetle-alt.obj", 38656, 19885, 2, 0},
    };
    const char *path = real_mesh(known[_i].name);
    if (path == NULL)
        return;
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_msg(mn_mesh_read(path, NULL, &mesh, &st) == MN_OK, "%s", st.text);
    check_mesh(&mesh);
    ck_assert_uint_eq(mesh.triangles, known[_i].triangles);
    ck_assert_uint_eq(mesh.vertices, known[_i].vertices);
    ck_assert_uint_eq(mesh.intake.welded_vertices, known[_i].welded);
    ck_assert_uint_eq(mesh.intake.unused_vertices, known[_i].unused);
    ck_assert_uint_eq(mesh.intake.input_faces, known[_i].triangles);
    mn_mesh_free(&mesh);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("read_obj");
    TCase *tests = tcase_create("obj");
    tcase_add_test(tests, corner_forms);
    tcase_add_test(tests, polygons_are_fanned);
    tcase_add_test(tests, refusals_name_the_line);
    tcase_add_test(tests, colors);
    tcase_add_loop_test(tests, real_meshes, 0, 6);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
