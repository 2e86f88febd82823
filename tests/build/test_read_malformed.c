/* Goal: no bytes make a reader crash, hang, take much memory or hand on a broken mesh.
 * Method: good files of every kind, cut at every byte and with random bytes changed: each is either
 * read to a sound mesh or refused in one line. */
#include "read_help.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define XYZ "property float x\nproperty float y\nproperty float z\n"
#define FACES "property list uchar int vertex_indices\n"

typedef struct sample {
    const char *name, *bytes;
    size_t size;
    uint32_t triangles;
    bool exact; /* cut, it is never readable with fewer triangles */
} sample;

#define TEXT(name, text, triangles, exact)                                                         \
    { name, text, sizeof text - 1, triangles, exact }
#define F0 "\0\0\0\0"
#define F1 "\0\0\200\77"
#define B1 "\77\200\0\0"
#define I(n) n "\0\0\0"
#define J(n) "\0\0\0" n

static const sample samples[] = {
    TEXT("ascii PLY",
         "ply\nformat ascii 1.0\ncomment c\nelement vertex 4\n" XYZ
         "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 3\n" FACES
         "property list int float extra\nelement tristrips 1\n" FACES "end_header\n"
         "0 0 0 1 2 3\n1 0 0 4 5 6\n0 1 0 7 8 9\n0 0 1 10 11 12\n3 0 1 2 0\n4 3 2 1 0 2 1.5 -2e3\n"
         "3 0 0 1 0\n6 0 2 3 -1 2 3\n",
         4, true),
    TEXT("little-endian PLY",
         "ply\nformat binary_little_endian 1.0\nelement vertex 4\n" XYZ
         "element note 2\nproperty list ushort uchar letters\nelement face 2\n" FACES
         "end_header\n" F0 F0 F0 F1 F0 F0 F0 F1 F0 F0 F0 F1 "\2\0ab\0\0"
         "\3" I("\0") I("\1") I("\2") "\4" I("\3") I("\2") I("\1") I("\0"),
         3, true),
    TEXT("big-endian PLY",
         "ply\nformat binary_big_endian 1.0\nelement face 2\n" FACES "element vertex 4\n" XYZ
         "end_header\n"
         "\3" J("\0") J("\1") J("\2") "\4" J("\3") J("\2") J("\1") J("\0")
             F0 F0 F0 B1 F0 F0 F0 B1 F0 F0 F0 B1,
         3, true),
    TEXT("strips",
         "ply\nformat binary_little_endian 1.0\nelement vertex 4\n" XYZ
         "element tristrips 1\nproperty list int int vertex_indices\nend_header\n" F0 F0 F0 F1 F0 F0
             F0 F1 F0 F0 F0 F1 I("\7") I("\0") I("\1") I("\2") "\377\377\377\377" I("\1") I("\2")
                 I("\3"),
         2, true),
    TEXT("OBJ",
         "# c\nmtllib a\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1e0 0\nv 0 \\\n0 1.0 1\nvn 0 0 1\ng a\n"
         "f 1 2 3\nf 4//1 3/1/1 -3/2 -4\nl 1 2\nf 1 2 4 \\\n 3\n",
         4, false),
    TEXT("OFF",
         "# c\nOFF\n4 3 0\n0 0 0\n1 0 0 # d\n0 1 0\n0 0 1\n3 0 1 2\n4 3 2 1 0 0.5 1 1\n2 0 1\n", 3,
         true),
    TEXT("COFF",
         "STCNOFF 3 1 0\n0 0 0 0 0 1 255 0 0 255 1 1\n1 0 0 0 0 1 1 2 3 1 1\n"
         "0 1 0 0 0 1 1 2 3 4 5 6\n3 0 1 2\n",
         1, true),
    TEXT("ascii STL",
         "solid a\nfacet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n"
         "  vertex 0 1 0\n endloop\nendfacet\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\n"
         "vertex 0 1e0 0\nvertex 0 0 1\nendloop\nendfacet\nendsolid a\n",
         2, true),
    TEXT("binary STL",
         "solid xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"
         "\2\0\0\0" F0 F0 F0 F0 F0 F0 F1 F0 F0 F0 F1 F0 "\0\0" F0 F0 F0 F0 F0 F0 F0 F1 F0 F0 F0 F1
         "\0\0",
         2, true),
};
enum { SAMPLES = sizeof samples / sizeof *samples };

/* Reads bytes that may be anything. */
static mn_code read_hostile(const char *bytes, size_t size, uint32_t *triangles) {
    mn_mesh mesh;
    mn_status st = {0};
    const mn_read_desc desc = {.ram_bytes = 64 << 20};
    mn_code code = read_bytes(bytes, size, &desc, &mesh, &st);
    ck_assert_msg(code == MN_OK || code == MN_BAD_INPUT, "%d: %s", (int)code, st.text);
    *triangles = mesh.triangles;
    if (code == MN_OK) {
        check_mesh(&mesh);
    } else {
        ck_assert_uint_gt(strlen(st.text), 20);
        for (const char *c = st.text; *c != 0; c++)
            ck_assert_msg((unsigned char)*c >= ' ', "not one printable line: %s", st.text);
        ck_assert_uint_eq(mesh.triangles, 0);
    }
    mn_mesh_free(&mesh);
    return code;
}

START_TEST(good_ones) {
    uint32_t triangles;
    ck_assert_int_eq(read_hostile(samples[_i].bytes, samples[_i].size, &triangles), MN_OK);
    ck_assert_uint_eq(triangles, samples[_i].triangles);
}
END_TEST

START_TEST(cut_at_every_byte) {
    const sample *s = &samples[_i];
    for (size_t size = 0; size < s->size; size++) {
        uint32_t triangles;
        mn_code code = read_hostile(s->bytes, size, &triangles);
        ck_assert_msg(code != MN_OK || triangles <= s->triangles, "%s cut at %zu", s->name, size);
        ck_assert_msg(code != MN_OK || !s->exact || triangles == s->triangles, "%s cut at %zu",
                      s->name, size);
    }
}
END_TEST

static uint32_t random_below(uint64_t *seed, uint32_t below) {
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((*seed >> 33) % below);
}

START_TEST(random_damage) {
    static const char likely[] = "0123456789-+.eE \n\t\r#/\\vfx\377\200\177\1";
    const char *text = getenv("MN_SEED");
    uint64_t seed = (text != NULL ? strtoull(text, NULL, 0) : 20260101) + (uint64_t)_i;
    const sample *s = &samples[_i];
    char *bytes = malloc(s->size + 8);
    uint32_t read = 0;
    printf("MN_SEED=%llu\n", (unsigned long long)(seed - (uint64_t)_i));
    for (int round = 0; round < 1500; round++) {
        size_t size = s->size;
        memcpy(bytes, s->bytes, size);
        for (uint32_t hits = 1 + random_below(&seed, 3); hits > 0; hits--) {
            size_t at = random_below(&seed, (uint32_t)size);
            switch (random_below(&seed, 4)) {
            case 0: /* a byte less */
                memmove(bytes + at, bytes + at + 1, --size - at);
                break;
            case 1:
                bytes[at] = (char)random_below(&seed, 256);
                break;
            default:
                bytes[at] = likely[random_below(&seed, sizeof likely)];
            }
        }
        uint32_t triangles;
        read += read_hostile(bytes, size, &triangles) == MN_OK;
    }
    ck_assert_uint_gt(read, 0);    /* some damage does no harm, */
    ck_assert_uint_lt(read, 1500); /* and some does */
    free(bytes);
}
END_TEST

/* ---- one by one ----------------------------------------------------------------------------- */

#define HEAD "ply\nformat binary_little_endian 1.0\n"
#define CAT(name, text, phrase)                                                                    \
    { name, text, sizeof text - 1, phrase }

static const struct {
    const char *name, *bytes;
    size_t size;
    const char *phrase;
} odd[] = {
    CAT("one byte", "p", "not a mesh file that is known"),
    CAT("zeros", "\0\0\0\0\0\0\0\0", "not a mesh file that is known"),
    CAT("an ELF program", "\177ELF\2\1\1\0\0\0\0\0", "not a mesh file that is known"),
    CAT("a PNG", "\211PNG\r\n\32\n\0\0\0\rIHDR", "not a mesh file that is known"),
    CAT("UTF-16",
        "\377\376v\0 \0"
        "0\0 \0",
        "not a mesh file that is known"),
    CAT("prose", "The cat sat on the mat.\nIt was flat.\n", "not a mesh file that is known"),
    CAT("only blanks", "  \n\n \t \r\n", "not a mesh file that is known"),
    CAT("only a byte-order mark", "\357\273\277", "not a mesh file that is known"),
    CAT("magic of PLY alone", "ply", "not a mesh file that is known"),
    CAT("PLY and nothing", "ply\n", "the file ends before end_header"),
    CAT("PLY of one line", "ply format ascii 1.0 end_header", "the file ends before end_header"),
    CAT("binary header without its line end",
        HEAD "element vertex 0\n" XYZ "element face 0\n" FACES "end_header",
        "the file ends with its header"),
    CAT("no items", HEAD "element vertex 0\n" XYZ "element face 0\n" FACES "end_header\n",
        "0 vertices and no face"),
    CAT("a face of no vertices",
        HEAD "element vertex 0\n" XYZ "element face 1\n" FACES
             "end_header\n\3\0\0\0\0\0\0\0\0\0\0\0\0",
        "face 1: vertex 0 of 0"),
    CAT("2^63 vertices",
        HEAD "element vertex 9223372036854775808\n" XYZ "element face 1\n" FACES "end_header\n",
        "the element's count is '9223372036854775808'"),
    CAT("sums past 2^64",
        HEAD "element vertex 768614336404564650\n" XYZ "element face 9223372036854775807\n" FACES
             "end_header\n",
        "cannot be: 0 bytes are left"),
    CAT("10^15 of something else",
        HEAD "element vertex 0\n" XYZ "element face 0\n" FACES
             "element x 1000000000000000\nproperty int y\nend_header\n",
        "of element x cannot be"),
    CAT("a list longer than the file",
        HEAD "element vertex 0\n" XYZ "element face 1\nproperty list uint int "
             "vertex_indices\nend_header\n\377\377\377\377\0\0\0\0",
        "a list of 4294967295 cannot be: 4 bytes are left"),
    CAT("a negative list",
        HEAD
        "element vertex 0\n" XYZ
        "element face 1\nproperty list char int vertex_indices\nend_header\n\377\0\0\0\0\0\0\0",
        "a list of -1 cannot be"),
    CAT("a list to skip that is too long",
        HEAD "element vertex 1\n" XYZ "property list uchar double w\nelement face 0\n" FACES
             "end_header\n"
             "\0\0\0\0\0\0\0\0\0\0\0\0\2\0\0\0\0\0\0\0\0",
        "vertex 1: a list of 2 cannot be"),
    CAT("more than its counts",
        HEAD "element vertex 0\n" XYZ "element face 0\n" FACES "end_header\n\0",
        "the file goes on after all that its header counts"),
    CAT("an infinite exponent", "v 1e99999999999999999999 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "no face is left of 1"),
    CAT("an exponent of nothing", "v 1e 0 0\n", "line 1: a coordinate is '1e'"),
    CAT("two points", "v 1.2.3 0 0\n", "line 1: a coordinate is '1.2.3'"),
    CAT("a sign alone", "v - 0 0\n", "line 1: a coordinate is '-'"),
    CAT("a decimal comma", "v 1,5 0 0\n", "line 1: a coordinate is '1,5'"),
    CAT("a NUL in a number", "v 1\0002 0 0\n", "not a mesh file that is known"),
    CAT("escape codes", "v \33[31m 0 0\n", "line 1: a coordinate is '?[31m'"),
    CAT("a vertex below the first", "v 0 0 0\nf -1 -1 -2\n", "line 2: face 1: vertex -2 of 1"),
    CAT("the least integer", "v 0 0 0\nf 1 1 -9223372036854775808\n", "line 2: face 1:"),
    CAT("faces alone", "f 1 2 3\n", "line 1: face 1: vertex 3 of 0"),
    CAT("slashes alone", "v 0 0 0\nf //1 1 1\n", "line 2: face 1: '//1'"),
    CAT("OFF in small letters", "off\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "not a mesh file that is known"),
    CAT("OFF of no numbers", "OFF OFF\n", "the number of vertices is 'OFF'"),
    CAT("solid of nothing", "solid", "before 'endsolid'"),
};

START_TEST(odd_files) {
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) {
        mn_mesh mesh;
        mn_status st = {0};
        mn_code code = read_bytes(odd[i].bytes, odd[i].size, NULL, &mesh, &st);
        ck_assert_msg(code == MN_BAD_INPUT, "%s: code %d", odd[i].name, (int)code);
        ck_assert_msg(strstr(st.text, odd[i].phrase) != NULL, "%s: '%s' does not say '%s'",
                      odd[i].name, st.text, odd[i].phrase);
    }
}
END_TEST

/* ---- things longer than any buffer ---------------------------------------------------------- */

enum { LONG = 1 << 20 };

START_TEST(long_lines) {
    char *text = malloc(8 * LONG);
    ck_assert_ptr_nonnull(text);
    size_t at = (size_t)sprintf(text, "#");
    memset(text + at, 'x', LONG);
    at += LONG;
    at += (size_t)sprintf(text + at, "\nv 0 0 0\nv 1 0 0\nv 0 ");
    memset(text + at, ' ', LONG);
    at += LONG;
    at += (size_t)sprintf(text + at, "1 0\nf 1");
    for (int i = 0; i < LONG / 4; i++) /* one polygon in one line */
        at += (size_t)sprintf(text + at, " %d", i % 2 + 2);
    text[at] = 0;
    mn_mesh mesh = read_text(text, NULL);
    ck_assert_uint_eq(mesh.intake.input_faces, LONG / 4 - 1);
    ck_assert_uint_eq(mesh.intake.duplicate_faces, LONG / 4 - 2);
    ck_assert_uint_eq(mesh.triangles, 1);
    mn_mesh_free(&mesh);
    at = (size_t)sprintf(text, "v 0");
    memset(text + at, '0', LONG); /* a number without end */
    expect_refusal(text, at + LONG, "line 1: a coordinate is '00000");
    at = (size_t)sprintf(text, "ply\nformat ascii 1.0\n");
    for (int i = 0; i < 600; i++)
        at +=
            (size_t)sprintf(text + at, i % 100 == 0 ? "element e%d 1\n" : "property int e%d\n", i);
    expect_refusal(text, at, "more than 512 properties");
    free(text);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("read_malformed");
    TCase *tests = tcase_create("malformed");
    tcase_set_timeout(tests, 60);
    tcase_add_loop_test(tests, good_ones, 0, SAMPLES);
    tcase_add_loop_test(tests, cut_at_every_byte, 0, SAMPLES);
    tcase_add_loop_test(tests, random_damage, 0, SAMPLES);
    tcase_add_test(tests, odd_files);
    tcase_add_test(tests, long_lines);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
