/* Goal: both kinds of STL are told apart by their size and welded, and cut ones are refused.
 * Method: small files of both kinds, with misleading heads. */
#include "read_help.h"

#include <stdlib.h>
#include <string.h>

static const double xyz[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
static const float facets[2][12] = {{0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0},
                                    {9, 9, 9, 0, -0.0f, 0, 0, 1, 0, 0, 0, 1}};

enum { BINARY_BYTES = 84 + 2 * 50 };

static void make_binary(unsigned char bytes[BINARY_BYTES], const char *head) {
    memset(bytes, ' ', 80);
    memcpy(bytes, head, strlen(head));
    memcpy(bytes + 80, "\2\0\0\0", 4);
    for (int i = 0; i < 2; i++) {
        memcpy(bytes + 84 + 50 * i, facets[i], 48);
        memcpy(bytes + 84 + 50 * i + 48, "\xff\x7f", 2); /* what some take for a colour */
    }
}

static void check_two(const mn_mesh *mesh) {
    const double second[3][3] = {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    check_mesh(mesh);
    ck_assert_uint_eq(mesh->triangles, 2);
    ck_assert_uint_eq(mesh->vertices, 4);
    ck_assert_uint_eq(mesh->intake.welded_vertices, 2);
    ck_assert(has_triangle(mesh, 0, xyz) && has_triangle(mesh, 1, second));
}

START_TEST(binary) {
    static const char *const heads[] = {"", "solid a\nfacet normal", "plY", "OFF", "v 0 0 0\n"};
    const mn_read_desc apart = {.weld = MN_WELD_OFF}; /* is welded none the less */
    for (size_t i = 0; i < sizeof heads / sizeof *heads; i++) {
        unsigned char bytes[BINARY_BYTES];
        mn_mesh mesh;
        mn_status st = {0};
        make_binary(bytes, heads[i]);
        ck_assert_msg(read_bytes(bytes, sizeof bytes, i % 2 ? &apart : NULL, &mesh, &st) == MN_OK,
                      "%s", st.text);
        check_two(&mesh);
        mn_mesh_free(&mesh);
    }
}
END_TEST

#define FACET(a, b, c)                                                                             \
    " facet normal 0 0 0\n  outer loop\n   vertex " a "\n   vertex " b "\n   vertex " c            \
    "\n  endloop\n endfacet\n"
#define ONE FACET("0 0 0", "1 0 0", "0 1 0")
#define TWO FACET("0 0 0", "0 1 0", "0 0 1")

START_TEST(ascii) {
    static const char *const texts[] = {
        "solid a name\n" ONE TWO "endsolid a name\n",
        "solid\n" ONE TWO "endsolid",
        "\n  SOLID x\r\n" ONE "ENDSOLID\n\nsolid y\n" TWO "endsolid y\n\n",
        "solid\nFACET NORMAL nan nan nan\nOUTER LOOP\nVERTEX 0 0 -0\nvertex 1 0 0\nvertex 0 1e0 0\n"
        "ENDLOOP\nENDFACET\n" TWO "endsolid\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        mn_mesh mesh = read_text(texts[i], NULL);
        check_two(&mesh);
        mn_mesh_free(&mesh);
    }
}
END_TEST

START_TEST(refusals) {
    static const char *const bad[][2] = {
        {"solid\nendsolid\n", "no face"},
        {"solid\n", "the file ends after 0 facets, before 'endsolid'"},
        {"solid\n" ONE, "the file ends after 1 facets, before 'endsolid'"},
        {"solid\n" ONE "v 0 0 0\n", "line 9: 'v' where 'facet' or 'endsolid'"},
        {"solid\n" ONE "endsolid\nfacet\n", "line 10: 'facet' where 'solid' should stand"},
        {"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nendloop\n",
         "line 6: facet 1: 'endloop' where 'vertex'"},
        {"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0\nvertex 0 1 0\n",
         "line 4: the line ends where a coordinate"},
        {"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 O\n", "line 4: a coordinate is 'O'"},
        {"solid\nfacet normal 0 0 0\nouter\n", "facet 1, before 'loop'"},
        {"solid\n" FACET("0 0 0", "1 0 0", "0 0 0") "endsolid\n", "no face is left of 1"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        expect_refusal(bad[i][0], strlen(bad[i][0]), bad[i][1]);
    unsigned char bytes[BINARY_BYTES + 1] = {0};
    make_binary(bytes, "solid");
    const char *phrase = "as a binary STL of 2 facets it would have 184 bytes; it has 183";
    expect_refusal(bytes, BINARY_BYTES - 1, phrase);
    expect_refusal(bytes, BINARY_BYTES + 1, "it would have 184 bytes; it has 185");
    memset(bytes + 80, 0xff, 4);
    expect_refusal(bytes, BINARY_BYTES,
                   "STL of 4294967295 facets it would have 214748364834 bytes");
    memset(bytes + 80, 0, 4);
    expect_refusal(bytes, 84, "no face");
}
END_TEST

int main(void) {
    Suite *suite = suite_create("read_stl");
    TCase *tests = tcase_create("stl");
    tcase_add_test(tests, binary);
    tcase_add_test(tests, ascii);
    tcase_add_test(tests, refusals);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
