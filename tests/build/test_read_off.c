/* Goal: OFF and its kin are understood, and lying counts are refused.
 * Method: small texts of every kind. */
#include "read_help.h"

#include <stdlib.h>
#include <string.h>

static const double xyz[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

START_TEST(layouts) {
    static const char *const texts[] = {
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2",
        "OFF\r\n3 1\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n",
        "# a\n OFF # b\n\n# c\n3 1 3 # d\n\n0 0 0 # e\n1 0 0\n# f\n0 1 0\n3 0 1 2 # g\n# h",
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n",
        "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 0.5 0.5 0.5 1.0\n",
        "NOFF\n3 1 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n",
        "STOFF\n3 1 0\n0 0 0 7 7\n1 0 0 7 7\n0 1 0 7 7\n3 0 1 2\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        mn_mesh mesh = read_text(texts[i], NULL);
        ck_assert_uint_eq(mesh.triangles, 1);
        ck_assert(has_triangle(&mesh, 0, xyz));
        ck_assert_ptr_null(mesh.color);
        mn_mesh_free(&mesh);
    }
    mn_mesh mesh = read_text("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n4 0 1 2 3\n2 0 1\n", NULL);
    ck_assert_uint_eq(mesh.triangles, 2);
    ck_assert_uint_eq(mesh.intake.degenerate_faces, 1);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(colors) {
    static const char *const texts[] = {
        "COFF\n3 1 0\n0 0 0 255 0 0 255\n1 0 0 0 255 0 128\n0 1 0 0 0 255 255\n3 0 1 2\n",
        "COFF\n3 1 0\n0 0 0 1.0 0 0 1\n1 0 0 0 1.0 0 .502\n0 1 0 0 0 1 1\n3 0 1 2\n",
        ("CNOFF\n3 1 0\n0 0 0 8 8 8 1 0 0 1\n1 0 0 8 8 8 0 1 0 0.502\n0 1 0 8 8 8 0 0 1 1\n3 0 1 "
         "2\n"),
        "STCOFF\n3 1 0\n0 0 0 1 0 0 1 7 7\n1 0 0 0 1 0 0.502 7 7\n0 1 0 0 0 1 1 7 7\n3 0 1 2\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        mn_mesh mesh = read_text(texts[i], NULL);
        ck_assert_ptr_nonnull(mesh.color);
        ck_assert_uint_eq(mesh.color[0], 0xff0000ffu);
        ck_assert_uint_eq(mesh.color[1], 0x8000ff00u);
        ck_assert_uint_eq(mesh.color[2], 0xffff0000u);
        mn_mesh_free(&mesh);
    }
}
END_TEST

START_TEST(refusals) {
    static const char *const bad[][2] = {
        {"OFF\n", "the file ends where its counts should stand"},
        {"OFF\n3\n", "line 2: the line ends where the number of faces"},
        {"OFF\n3 x 0\n", "line 2: the number of faces is 'x'"},
        {"OFF\n-3 1 0\n", "the number of vertices is -3"},
        {"OFF BINARY\n3 1 0\n", "binary OFF is not read"},
        {"4OFF\n3 1 0\n", "4OFF has vertices of other than three dimensions"},
        {"nOFF\n3\n3 1 0\n", "nOFF has vertices of other than three dimensions"},
        {"OFF\n1000000000000000 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
         "1000000000000000 vertices and 1 faces cannot be"},
        {"OFF\n3 9223372036854775807 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "cannot be"},
        {"OFF\n4 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "the file ends before face 1 of 1"},
        {"OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "the file ends before face 2 of 2"},
        {"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 2\n", "line 7: the file goes on"},
        {"OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "line 4: the line ends where a coordinate"},
        {"OFF\n3 1 0\n0 0 0\n1 0 z\n0 1 0\n3 0 1 2\n", "line 4: a coordinate is 'z'"},
        {"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "line 6: face 1: vertex 3 of 3"},
        {"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "line 6: face 1: vertex -1 of 3"},
        {"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", "line 6: the line ends where a corner"},
        {"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n-1 0 1\n", "the number of corners is -1"},
        {"COFF\n3 1 0\n0 0 0 1 1\n1 0 0\n0 1 0\n3 0 1 2\n", "line 3: vertex 1 has no colour"},
        {"OFF\n0 0 0\n", "0 vertices and no face"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        expect_refusal(bad[i][0], strlen(bad[i][0]), bad[i][1]);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("read_off");
    TCase *tests = tcase_create("off");
    tcase_add_test(tests, layouts);
    tcase_add_test(tests, colors);
    tcase_add_test(tests, refusals);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
