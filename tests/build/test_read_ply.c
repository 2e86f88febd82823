/* Goal: PLY is understood in every encoding and with every type, and a lying header is refused.
 * Method: one mesh written in all combinations by a small writer here, odd headers as text, igea.
 */
#include "read_help.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static const double xyz[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};

/* ---- a writer of PLY in any encoding and type ------------------------------------------------ */

typedef enum encoding { ASCII, LITTLE, BIG } encoding;
static const char *const encoding_names[] = {"ascii", "binary_little_endian", "binary_big_endian"};

typedef struct writer {
    char bytes[4096];
    size_t size;
    encoding encoding;
} writer;

static void put_text(writer *w, const char *text) {
    memcpy(w->bytes + w->size, text, strlen(text));
    w->size += strlen(text);
}

static void put(writer *w, const char *type, double value) {
    char text[40];
    unsigned char raw[8];
    float single = (float)value;
    int64_t whole = (int64_t)value;
    size_t bytes = strchr("dfi", type[0]) != NULL ? 4 : 1;
    if (strstr(type, "64") != NULL || strcmp(type, "double") == 0)
        bytes = 8;
    else if (strstr(type, "short") != NULL || strstr(type, "16") != NULL)
        bytes = 2;
    else if (strstr(type, "8") != NULL || strstr(type, "char") != NULL)
        bytes = 1;
    else
        bytes = 4;
    if (w->encoding == ASCII) {
        snprintf(text, sizeof text, "%.17g ", value);
        put_text(w, text);
        return;
    }
    if (type[0] == 'd' || strcmp(type, "float64") == 0)
        memcpy(raw, &value, bytes);
    else if (type[0] == 'f')
        memcpy(raw, &single, bytes);
    else
        memcpy(raw, &whole, bytes);
    for (size_t i = 0; i < bytes; i++)
        w->bytes[w->size++] = (char)raw[w->encoding == LITTLE ? i : bytes - 1 - i];
}

static void end_item(writer *w) {
    if (w->encoding == ASCII)
        put_text(w, "\n");
}

/* The four corners and two faces, with things to pass over everywhere, faces first if asked. */
static void write_ply(writer *w, encoding order, const char *real, const char *index,
                      const char *list_name, bool faces_first) {
    char line[200];
    *w = (writer){.encoding = order};
    snprintf(line, sizeof line, "ply\nformat %s 1.0\ncomment x\nobj_info y\n",
             encoding_names[order]);
    put_text(w, line);
    for (int pass = 0; pass < 2; pass++) {
        if ((pass == 0) == faces_first) {
            put_text(w, "element face 2\nproperty uchar flags\n");
            snprintf(line, sizeof line,
                     "property list uchar double weights\nproperty list %s %s %s\n", index, index,
                     list_name);
            put_text(w, line);
            put_text(w, "property short group\nelement camera 2\nproperty float u\n"
                        "element note 1\nproperty list int short text\nelement none 3\n");
        } else {
            snprintf(line, sizeof line,
                     "element vertex 4\nproperty %s z\nproperty list uchar uchar skipped\n"
                     "property %s x\nproperty uint id\nproperty %s y\n",
                     real, real, real);
            put_text(w, line);
        }
    }
    put_text(w, "end_header\n");
    for (int pass = 0; pass < 2; pass++) {
        if ((pass == 0) != faces_first) {
            for (int v = 0; v < 4; v++) {
                put(w, real, xyz[v][2]);
                put(w, "uchar", v);
                for (int i = 0; i < v; i++)
                    put(w, "uchar", 200);
                put(w, real, xyz[v][0]);
                put(w, "uint", 4000000000.0);
                put(w, real, xyz[v][1]);
                end_item(w);
            }
            continue;
        }
        for (int f = 0; f < 2; f++) {
            put(w, "uchar", 7);
            put(w, "uchar", 1);
            put(w, "double", 0.5);
            put(w, index, 3);
            put(w, index, 0);
            put(w, index, 1 + f);
            put(w, index, 2 + f);
            put(w, "short", -1);
            end_item(w);
        }
        put(w, "float", 1);
        end_item(w);
        put(w, "float", 2);
        end_item(w);
        put(w, "int", 2);
        put(w, "short", 1);
        put(w, "short", 2);
        end_item(w);
    }
}

START_TEST(every_encoding_and_type) {
    static const char *const reals[] = {"float", "double", "float32", "float64", "char", "uchar",
                                        "short", "ushort", "int",     "uint",    "int8", "uint8",
                                        "int16", "uint16", "int32",   "uint32"};
    static const char *const names[] = {"vertex_index", "vertex_indices"};
    for (int order = ASCII; order <= BIG; order++) {
        for (size_t r = 0; r < 16; r++) {
            for (size_t i = 4; i < 16; i++) {
                writer w;
                mn_mesh mesh;
                mn_status st = {0};
                write_ply(&w, (encoding)order, reals[r], reals[i], names[i % 2], r % 2 != 0);
                ck_assert_msg(read_bytes(w.bytes, w.size, NULL, &mesh, &st) == MN_OK,
                              "%s %s %s: %s", encoding_names[order], reals[r], reals[i], st.text);
                check_mesh(&mesh);
                const double second[3][3] = {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}};
                ck_assert_uint_eq(mesh.triangles, 2);
                ck_assert(has_triangle(&mesh, 0, xyz) && has_triangle(&mesh, 1, second));
                mn_mesh_free(&mesh);
            }
        }
    }
}
END_TEST

/* ---- features ------------------------------------------------------------------------------- */

#define HEAD "ply\nformat ascii 1.0\n"
#define XYZ "property float x\nproperty float y\nproperty float z\n"
#define FACES "property list uchar int vertex_indices\n"
#define FOUR "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
#define MESH(faces)                                                                                \
    HEAD "element vertex 4\n" XYZ "element face " faces "\n" FACES "end_header\n" FOUR

START_TEST(polygons_and_layout) {
    mn_mesh mesh = read_text(MESH("2") "4 0 1 2 3\n3 3 2 1\n", NULL);
    const double fan[3][3] = {{0, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    ck_assert_uint_eq(mesh.triangles, 3);
    ck_assert(has_triangle(&mesh, 0, xyz) && has_triangle(&mesh, 1, fan));
    mn_mesh_free(&mesh);
    mesh = read_text(MESH("4") "\n\n3 0 1 2\n2 1 2\n0\n1 3", NULL); /* no newline at the end */
    ck_assert_uint_eq(mesh.triangles, 1);
    ck_assert_uint_eq(mesh.intake.degenerate_faces, 3);
    ck_assert_uint_eq(mesh.intake.unused_vertices, 1);
    mn_mesh_free(&mesh);
    mesh = read_text("ply\r\nformat ascii 1.0\r\nelement vertex 3\r\nproperty float x\r\n"
                     "property float y\r\nproperty float z\r\nelement face 1\r\n"
                     "property list uchar int vertex_index\r\nend_header\r\n0 0 0\r\n1 0 0\r\n"
                     "0 1 0\r\n3 0 1 2\r\n",
                     NULL);
    ck_assert(has_triangle(&mesh, 0, xyz));
    mn_mesh_free(&mesh);
}
END_TEST

#define STRIPS(n)                                                                                  \
    HEAD "element vertex 6\n" XYZ "element tristrips " n "\n" FACES "end_header\n"                 \
         "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 0\n"

static const double grid[6][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0, 2, 0}, {1, 2, 0}};

static void expect_corners(const mn_mesh *mesh, uint32_t t, int a, int b, int c) {
    double place[3][3];
    memcpy(place[0], grid[a], sizeof place[0]);
    memcpy(place[1], grid[b], sizeof place[1]);
    memcpy(place[2], grid[c], sizeof place[2]);
    ck_assert_msg(has_triangle(mesh, t, (const double(*)[3])place), "triangle %u", t);
}

START_TEST(strips) {
    mn_mesh mesh = read_text(STRIPS("1") "6 0 1 2 3 4 5\n", NULL);
    ck_assert_uint_eq(mesh.triangles, 4);
    ck_assert_uint_eq(mesh.intake.misoriented_faces, 0);
    expect_corners(&mesh, 0, 0, 1, 2);
    expect_corners(&mesh, 1, 2, 1, 3);
    expect_corners(&mesh, 2, 2, 3, 4);
    expect_corners(&mesh, 3, 4, 3, 5);
    mn_mesh_free(&mesh);
    mesh = read_text(STRIPS("2") "8 0 1 2 -1 1 3 2 -1\n3 2 3 4\n", NULL); /* -1 starts anew */
    ck_assert_uint_eq(mesh.triangles, 3);
    expect_corners(&mesh, 1, 1, 3, 2);
    expect_corners(&mesh, 2, 2, 3, 4);
    mn_mesh_free(&mesh);
    mesh = read_text(STRIPS("1") "8 0 1 2 2 4 4 3 5\n", NULL); /* stitching is no face */
    ck_assert_uint_eq(mesh.intake.input_faces, 2);
    ck_assert_uint_eq(mesh.intake.degenerate_faces, 0);
    expect_corners(&mesh, 0, 0, 1, 2);
    expect_corners(&mesh, 1, 3, 4, 5); /* the sixth of the strip: turned */
    mn_mesh_free(&mesh);
    mesh = read_text(STRIPS("3") "2 0 1\n0\n4 -1 0 1 2\n", NULL); /* too short ones */
    ck_assert_uint_eq(mesh.intake.input_faces, 1);
    mn_mesh_free(&mesh);
    mesh = read_text(HEAD "element tristrips 1\n" FACES "element face 1\n" FACES
                          "element vertex 4\n" XYZ "end_header\n3 0 1 2\n3 1 3 2\n" FOUR,
                     NULL);
    ck_assert_uint_eq(mesh.triangles, 2);
    mn_mesh_free(&mesh);
}
END_TEST

#define RGB(type)                                                                                  \
    HEAD "element vertex 3\n" XYZ "property " type " red\nproperty " type " green\nproperty " type \
         " blue\nproperty " type " alpha\nelement face 1\n" FACES "end_header\n"

static void expect_color(const char *text, uint32_t rgba) {
    mn_mesh mesh = read_text(text, NULL);
    ck_assert_ptr_nonnull(mesh.color);
    ck_assert_uint_eq(mesh.color[1], rgba);
    mn_mesh_free(&mesh);
}

START_TEST(colors) {
    expect_color(RGB("uchar") "0 0 0 1 2 3 4\n1 0 0 10 20 30 40\n0 1 0 0 0 0 0\n3 0 1 2\n",
                 0x281e140au);
    expect_color(RGB("ushort") "0 0 0 1 2 3 4\n1 0 0 65535 0 257 514\n0 1 0 0 0 0 0\n3 0 1 2\n",
                 0x020100ffu);
    expect_color(RGB("float") "0 0 0 1 1 1 1\n1 0 0 1 0 0.5 7\n0 1 0 -3 nan 0 0\n3 0 1 2\n",
                 0xff8000ffu);
    mn_mesh mesh =
        read_text(HEAD "element vertex 3\n" XYZ "property uchar red\nelement face 1\n" FACES
                       "end_header\n0 0 0 1\n1 0 0 1\n0 1 0 1\n3 0 1 2\n",
                  NULL); /* red alone is no colour */
    ck_assert_ptr_null(mesh.color);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(refusals) {
    static const char *const bad[][2] = {
        {"ply\n", "line 2: the file ends before end_header"},
        {"ply\nend_header\n", "line 2: the header names no format"},
        {"ply\nformat text 1.0\nend_header\n", "line 2: 'text' is no format"},
        {"ply\nformat ascii 2.0\nend_header\n", "version 2.0 of PLY"},
        {"ply\nformat\nend_header\n", "line 2: the line ends where a format should stand"},
        {"ply\nformat ascii 1.0\nelements\n", "line 3: 'elements' is no word of a PLY header"},
        {HEAD "property float x\nend_header\n", "line 3: a property before any element"},
        {HEAD "element vertex -3\n" XYZ "end_header\n", "vertex has a count of -3"},
        {HEAD "element vertex many\n" XYZ "end_header\n", "the element's count is 'many'"},
        {HEAD "element vertex\n" XYZ "end_header\n", "line 3: the line ends where the element's"},
        {HEAD "element vertex 1\nproperty real x\nend_header\n", "line 4: 'real' is no type"},
        {HEAD "element vertex 1\nproperty list float int x\nend_header\n", "counted by a float"},
        {HEAD "element vertex 1\nproperty list uchar float x\nend_header\n", "x is a list"},
        {HEAD "element vertex 1\nproperty float x\nproperty float x\nend_header\n",
         "two properties x"},
        {HEAD "element vertex 1\n" XYZ "element vertex 1\n" XYZ "end_header\n",
         "vertex comes twice"},
        {HEAD "element vertex 1\nproperty float x\nproperty float z\nend_header\n0 0\n",
         "vertex has no property y"},
        {HEAD "element face 1\n" FACES "end_header\n3 0 1 2\n", "has no element vertex"},
        {HEAD "element vertex 1\n" XYZ "end_header\n0 0 0\n", "has no element face"},
        {HEAD "element vertex 1\n" XYZ "element face 1\nproperty int a\nend_header\n0 0 0\n1\n",
         "face has no list vertex_indices"},
        {HEAD "element vertex 1\n" XYZ
              "element face 1\nproperty list uchar float vertex_indices\nend_header\n0 0 0\n1\n",
         "vertex_indices are floats"},
        {HEAD "element vertex 1000000000000000\n" XYZ "element face 1\n" FACES "end_header\n" FOUR
              "3 0 1 2\n",
         "1000000000000000 of element vertex cannot be: 32 bytes"},
        {HEAD "element vertex 9223372036854775807\n" XYZ "element face 9223372036854775807\n" FACES
              "end_header\n" FOUR,
         "of element vertex cannot be"},
        {MESH("1000000000000000") "3 0 1 2\n", "of element face cannot be"},
        {MESH("2") "3 0 1 2\n", "the file ends in face 2 of 2"},
        {MESH("1") "3 0 1 2\n3 0 1 3\n", "line 15: the file goes on"},
        {MESH("1") "3 0 1 4\n", "line 14: face 1: vertex 4 of 4"},
        {MESH("1") "3 0 1 -1\n", "line 14: face 1: vertex -1 of 4"},
        {MESH("1") "3 0 1 2.5\n", "vertex_indices is '2.5': an integer"},
        {MESH("1") "3 0 1\n", "line 14: the line ends where vertex_indices should stand"},
        {MESH("1") "3 0 1 2 3\n", "line 14: face 1 has more values"},
        {MESH("1") "-1 0 1 2\n", "face 1: a list of -1 cannot be"},
        {MESH("1") "4000000000 0 1 2\n", "a list of 4000000000 cannot be"},
        {MESH("1") "x\n", "vertex_indices is 'x'"},
        {HEAD "element vertex 3\n" XYZ "element face 1\n" FACES
              "end_header\n0 0 0\n1 0 zero\n0 1 0\n3 0 1 2\n",
         "line 11: z is 'zero': a number"},
        {STRIPS("1") "3 0 1 -2\n", "strip 1: vertex -2 of 6"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        expect_refusal(bad[i][0], strlen(bad[i][0]), bad[i][1]);
}
END_TEST

/* In binary the place is a byte. */
START_TEST(binary_refusals) {
    static const char head[] =
        "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
        "property uchar x\nproperty uchar y\nproperty uchar z\n"
        "element face 1\nproperty list uint uchar vertex_indices\nend_header\n";
    char bytes[sizeof head + 16];
    size_t size = sizeof head - 1;
    memcpy(bytes, head, size);
    memcpy(bytes + size, "\0\0\0\1\0\0\0\1\0\3\0\0\0\0\1\2", 16);
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_int_eq(read_bytes(bytes, size + 16, NULL, &mesh, &st), MN_OK);
    ck_assert(has_triangle(&mesh, 0, xyz));
    mn_mesh_free(&mesh);
    char place[60];
    bytes[size + 15] = 3;
    snprintf(place, sizeof place, "byte %zu: face 1: vertex 3 of 3", size + 16);
    expect_refusal(bytes, size + 16, place);
    bytes[size + 10] = 1; /* a list of 259 */
    snprintf(place, sizeof place, "byte %zu: face 1: a list of 259 cannot be: 3 bytes", size + 13);
    expect_refusal(bytes, size + 16, place);
    expect_refusal(bytes, size + 12, "1 of element face cannot be");
}
END_TEST

/* 2^31 vertices, one more than can be numbered: said at once, of a file that is long enough for
 * them (and takes no room on the disk). */
START_TEST(more_vertices_than_can_be) {
    char path[] = "/tmp/mn-ply-XXXXXX";
    const int fd = mkstemp(path);
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_int_gt(dprintf(fd, "ply\nformat binary_little_endian 1.0\nelement vertex 2147483648\n"
                                 "property uchar x\nproperty uchar y\nproperty uchar z\n"
                                 "element face 1\n"
                                 "property list uchar uchar vertex_indices\nend_header\n"),
                     0);
    if (ftruncate(fd, INT64_C(7) << 30) == 0) {
        ck_assert_int_eq(mn_mesh_read(path, NULL, &mesh, &st), MN_BAD_INPUT);
        ck_assert_ptr_nonnull(strstr(st.text, "2147483648 vertices, more than the 2147483647"));
    } else {
        printf("skipped: no file of 7 GB can be here\n");
    }
    close(fd);
    unlink(path);
}
END_TEST

START_TEST(igea) {
    const char *path = real_mesh("igea-tristrips.ply");
    if (path == NULL)
        return;
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_msg(mn_mesh_read(path, NULL, &mesh, &st) == MN_OK, "%s", st.text);
    check_mesh(&mesh);
    ck_assert_uint_eq(mesh.triangles, 268686);
    ck_assert_uint_eq(mesh.vertices, 134345);
    ck_assert_uint_eq(mesh.intake.input_faces, 268686);
    ck_assert_uint_eq(mesh.intake.misoriented_faces, 0);
    mn_mesh_free(&mesh);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("read_ply");
    TCase *tests = tcase_create("ply");
    tcase_set_timeout(tests, 60);
    tcase_add_test(tests, every_encoding_and_type);
    tcase_add_test(tests, polygons_and_layout);
    tcase_add_test(tests, strips);
    tcase_add_test(tests, colors);
    tcase_add_test(tests, refusals);
    tcase_add_test(tests, binary_refusals);
    tcase_add_test(tests, more_vertices_than_can_be);
    tcase_add_test(tests, igea);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
