/* Goal: the helper program and our end of it: meshes pass unharmed, trouble comes back as one line.
 * Method: small meshes through every subcommand, files written by OpenMesh itself, then cut. */
#include <check.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "helper.h"
#include "suite.h"

static const char *dir(void) {
    const char *given = getenv("METANODE_HELPER_DIR");
    ck_assert_ptr_nonnull(given);
    return given;
}

/* An octahedron about (10, 20, 30), closed and manifold. */
static float position[18] = {1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1};
static uint32_t corner[24] = {0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4,
                              2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5};
static uint32_t color[6] = {0xff0000ffu, 0xff00ff00u, 0xffff0000u,
                            0xffffffffu, 0xff123456u, 0xff000001u};
static const mn_mesh octahedron = {.vertices = 6,
                                   .triangles = 8,
                                   .position = position,
                                   .corner = corner,
                                   .color = color,
                                   .origin = {10, 20, 30}};

/* Runs `read` or `write` on a file; whole is what a healthy helper would do. */
static mn_code run_file(const char *command, const char *path, const char *as, const void *in,
                        size_t in_bytes, void *out, size_t out_bytes, mn_status *st) {
    mni_helper helper;
    const char *const args[] = {command, path, "--as", as, "--seconds", "2", NULL};
    *st = (mn_status){0};
    ck_assert_int_eq(mni_helper_open(&helper, dir(), &mni_helper_openmesh, args, st), MN_OK);
    if (in != NULL)
        mni_helper_write(&helper, in, in_bytes);
    mni_helper_write_end(&helper);
    if (out != NULL)
        mni_helper_read(&helper, out, out_bytes);
    return mni_helper_close(&helper, path, NULL, st);
}

/* The octahedron as a stream, with colours. */
static size_t stream(unsigned char *bytes) {
    mni_helper_head head = {.magic = {'M', 'N', 'O', 'M', 'S', 'T', 'R', 'M'},
                            .vertices = 6,
                            .triangles = 8,
                            .has_colors = 1};
    size_t at = 0;
    memcpy(bytes, &head, sizeof head);
    at += sizeof head;
    for (int i = 0; i < 18; i++, at += 8) {
        double value = position[i];
        memcpy(bytes + at, &value, 8);
    }
    memcpy(bytes + at, color, sizeof color);
    memcpy(bytes + at + sizeof color, corner, sizeof corner);
    return at + sizeof color + sizeof corner;
}

START_TEST(subdivided_four_for_one) {
    mn_mesh out;
    mn_status st = {0};
    ck_assert_int_eq(mn_openmesh_subdivide(&octahedron, 2, dir(), &out, &st), MN_OK);
    ck_assert_uint_eq(out.triangles, 8 * 16);
    ck_assert_uint_eq(out.vertices, 8 * 16 / 2 + 2); /* Euler: closed, genus 0 */
    ck_assert_double_eq(out.origin[2], 30);
    for (uint32_t i = 0; i < 3 * out.vertices; i++)
        ck_assert(out.position[i] >= -1 && out.position[i] <= 1);
    free(out.position);
    free(out.corner);
}
END_TEST

START_TEST(decimated_to_the_number) {
    mn_mesh fine, coarse;
    mn_decimation figures;
    mn_status st = {0};
    ck_assert_int_eq(mn_openmesh_subdivide(&octahedron, 3, dir(), &fine, &st), MN_OK);
    ck_assert_int_eq(mn_openmesh_decimate(&fine, 100, dir(), &coarse, &figures, &st), MN_OK);
    ck_assert_uint_le(coarse.triangles, 100);
    ck_assert_uint_ge(coarse.triangles, 98);
    ck_assert_uint_eq(coarse.triangles, 2 * (uint64_t)coarse.vertices - 4);
    ck_assert_uint_eq(figures.collapses, fine.vertices - coarse.vertices);
    ck_assert(figures.seconds > 0);
    free(fine.position);
    free(fine.corner);
    free(coarse.position);
    free(coarse.corner);
}
END_TEST

START_TEST(a_fin_is_refused_with_its_number) {
    uint32_t fin[27];
    mn_mesh mesh = octahedron, out;
    mn_status st = {0};
    memcpy(fin, corner, sizeof corner);
    memcpy(fin + 24, (const uint32_t[3]){0, 2, 3}, 12); /* a third triangle at the edge 0 2 */
    mesh.corner = fin;
    mesh.triangles = 9;
    ck_assert_int_eq(mn_openmesh_subdivide(&mesh, 1, dir(), &out, &st), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "1 of 9"));
    ck_assert_ptr_null(out.position);
}
END_TEST

START_TEST(files_of_every_format_pass) {
    static const char *const formats[] = {"om", "ply", "obj", "off", "stl"};
    const char *as = formats[_i];
    bool colored = _i < 2; /* the others are written without */
    bool reordered = strcmp(as, "stl") == 0;
    unsigned char in[1024], out[1024] = {0};
    char path[] = "/tmp/mn-openmesh-XXXXXX";
    mn_status st;
    size_t bytes = stream(in);
    close(mkstemp(path));
    ck_assert_msg(run_file("write", path, as, in, bytes, NULL, 0, &st) == MN_OK, "%s", st.text);
    size_t expected = colored ? bytes : bytes - sizeof color;
    ck_assert_msg(run_file("read", path, as, NULL, 0, out, expected, &st) == MN_OK, "%s", st.text);
    ck_assert_int_eq(memcmp(in, out, 24), 0);
    ck_assert_int_eq(out[24], colored);
    if (colored)
        ck_assert_int_eq(memcmp(in, out, bytes), 0);
    else if (!reordered)
        ck_assert_int_eq(
            memcmp(in + bytes - sizeof corner, out + expected - sizeof corner, sizeof corner), 0);
    unlink(path);
}
END_TEST

/* Every length of a cut .om ends with a word: no crash, no endless loop, no mesh. */
START_TEST(a_cut_om_is_noticed) {
    unsigned char in[1024];
    char path[] = "/tmp/mn-openmesh-XXXXXX";
    mn_status st;
    close(mkstemp(path));
    ck_assert_int_eq(run_file("write", path, "om", in, stream(in), NULL, 0, &st), MN_OK);
    FILE *f = fopen(path, "rb");
    static unsigned char whole[65536];
    long length = (long)fread(whole, 1, sizeof whole, f);
    fclose(f);
    for (long cut = 0; cut < length; cut += 1 + length / 23) {
        ck_assert_int_eq(truncate(path, 0), 0);
        f = fopen(path, "wb");
        ck_assert_uint_eq(fwrite(whole, 1, (size_t)cut, f), (size_t)cut);
        fclose(f);
        ck_assert_int_eq(run_file("read", path, "om", NULL, 0, in, 32, &st), MN_BAD_INPUT);
        ck_assert_int_eq(strncmp(st.text, path, strlen(path)), 0);
        ck_assert_ptr_null(strchr(st.text, '\n'));
    }
    unlink(path);
}
END_TEST

/* Debian's OpenMesh 9.0 never ends with it: the limit of time does. */
START_TEST(a_cut_ply_header_ends) {
    char path[] = "/tmp/mn-openmesh-XXXXXX";
    unsigned char out[32];
    mn_status st;
    FILE *f = fdopen(mkstemp(path), "wb");
    fputs("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty fl", f);
    fclose(f);
    ck_assert_int_eq(run_file("read", path, "ply", NULL, 0, out, 32, &st), MN_BAD_INPUT);
    unlink(path);
}
END_TEST

START_TEST(no_helper_is_said) {
    mn_mesh out;
    mn_status st = {0};
    ck_assert_int_eq(mn_openmesh_subdivide(&octahedron, 1, "/nowhere", &out, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "/nowhere/metanode-openmesh"));
}
END_TEST

int main(void) {
    Suite *suite = suite_create("openmesh");
    TCase *tc = tcase_create("helper");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, subdivided_four_for_one);
    tcase_add_test(tc, decimated_to_the_number);
    tcase_add_test(tc, a_fin_is_refused_with_its_number);
    tcase_add_loop_test(tc, files_of_every_format_pass, 0, 5);
    tcase_add_test(tc, a_cut_om_is_noticed);
    tcase_add_test(tc, a_cut_ply_header_ends);
    tcase_add_test(tc, no_helper_is_said);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
