/* Goal: what a mesh file is expected to have is about what it has, in every format, however long
 * its lines are; a header that cannot be is refused as reading refuses it. Method: one grid of
 * squares written in each format; real models where they are there. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "read_help.h"

enum { SIDE = 150, POINTS = SIDE * SIDE, SQUARES = (SIDE - 1) * (SIDE - 1) };

static char path[] = "/tmp/mn-expect-XXXXXX";

static FILE *fresh(void) {
    FILE *f = fopen(path, "w");
    ck_assert_ptr_nonnull(f);
    return f;
}

static void write_points(FILE *f, const char *before) {
    for (int i = 0; i < POINTS; i++)
        fprintf(f, "%s%d %.*f %d.25\n", before, i % SIDE, i % 7, 0.1234567, i / SIDE);
}

/* Squares, or with `split` two triangles each; indices from `first` on. */
static void write_faces(FILE *f, const char *three, const char *four, int first, bool split) {
    for (int s = 0; s < SQUARES; s++) {
        int a = first + s / (SIDE - 1) * SIDE + s % (SIDE - 1), b = a + 1, c = b + SIDE, d = c - 1;
        if (split)
            fprintf(f, "%s%d %d %d\n%s%d %d %d\n", three, a, b, c, three, a, c, d);
        else
            fprintf(f, "%s%d %d %d %d\n", four, a, b, c, d);
    }
}

static void about(uint64_t found, double wanted, double part) {
    ck_assert_double_ge((double)found, wanted * (1 - part));
    ck_assert_double_le((double)found, wanted * (1 + part));
}

static void expect(double vertices, double triangles, double part) {
    uint64_t v, t;
    mn_status st = {0};
    ck_assert_msg(mn_mesh_expect(path, &v, &t, &st) == MN_OK, "%s", st.text);
    about(v, vertices, part);
    about(t, triangles, part);
}

START_TEST(counted_by_their_headers) {
    for (int split = 0; split < 2; split++) {
        FILE *f = fresh();
        fprintf(f,
                "ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
                "property float z\nelement face %d\nproperty list uchar int vertex_indices\n"
                "end_header\n",
                POINTS, SQUARES << split);
        write_points(f, "");
        write_faces(f, "3 ", "4 ", 0, split != 0);
        fclose(f);
        expect(POINTS, 2 * POINTS, 0);
        f = fresh();
        fprintf(f, "OFF\n%d %d 0\n", POINTS, SQUARES << split);
        write_points(f, "");
        write_faces(f, "3 ", "4 ", 0, split != 0);
        fclose(f);
        expect(POINTS, 2 * POINTS, 0);
    }
}
END_TEST

START_TEST(counted_by_samples) {
    for (int split = 0; split < 2; split++) {
        FILE *f = fresh();
        fprintf(f, "# a grid\nmtllib none\n");
        write_points(f, "v ");
        write_points(f, "vn ");
        write_faces(f, "f\t", "f ", 1, split != 0);
        fclose(f);
        expect(POINTS, 2 * POINTS, 0.05);
    }
    FILE *f = fresh(); /* shorter than a sample */
    fprintf(f, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 3\nf 1 2 3\nf 1 2 3\nf 1 2 3\nf 1 2 3\n"
               "f 1 2 3\n");
    fclose(f);
    expect(3, 7, 0.02);
}
END_TEST

START_TEST(soups) {
    FILE *f = fresh();
    fprintf(f, "solid grid\n");
    for (int s = 0; s < SQUARES; s++)
        fprintf(f,
                "  facet normal 0 0 1\n    outer loop\n      vertex %d 0 0.5\n      vertex 1 %d 0\n"
                "      vertex 2 2 %d.125\n    endloop\n  endfacet\n",
                s, s, s);
    fprintf(f, "endsolid grid\n");
    fclose(f);
    expect(3 * SQUARES, SQUARES, 0.05);
    f = fresh();
    const char head[80] = "solid, it says";
    const uint32_t count = SQUARES;
    fwrite(head, 1, sizeof head, f);
    fwrite(&count, 1, sizeof count, f);
    for (int s = 0; s < SQUARES; s++) {
        const char facet[50] = {(char)s};
        fwrite(facet, 1, sizeof facet, f);
    }
    fclose(f);
    expect(3 * SQUARES, SQUARES, 0);
}
END_TEST

static void refused(const char *text, const char *word) {
    uint64_t v, t;
    mn_status st = {0};
    FILE *f = fresh();
    fputs(text, f);
    fclose(f);
    ck_assert_int_eq(mn_mesh_expect(path, &v, &t, &st), MN_BAD_INPUT);
    ck_assert_msg(strstr(st.text, word) != NULL, "%s", st.text);
}

START_TEST(refusals) {
    refused("ply\nformat ascii 1.0\nelement vertex 99999999\nproperty float x\nproperty float y\n"
            "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
            "end_header\n",
            "cannot be");
    refused("OFF\n-1 2 3\n", "number of vertices");
    uint64_t v, t;
    mn_status st = {0};
    ck_assert_int_eq(mn_mesh_expect("/nowhere/mesh", &v, &t, &st), MN_BAD_INPUT);
    ck_assert_uint_eq(v + t, 0);
    FILE *f = fresh(); /* nothing of a mesh: reading will say so */
    fputs("nothing\n", f);
    fclose(f);
    expect(0, 0, 0);
}
END_TEST

START_TEST(real_ones) {
    static const char *const names[] = {"armadillo.obj", "igea-tristrips.ply", "nefertiti.obj"};
    for (int i = 0; i < 3; i++) {
        const char *file = real_mesh(names[i]);
        mn_mesh mesh;
        uint64_t v, t;
        mn_status st = {0};
        if (file == NULL)
            continue;
        ck_assert_msg(mn_mesh_read(file, NULL, &mesh, &st) == MN_OK, "%s", st.text);
        ck_assert_int_eq(mn_mesh_expect(file, &v, &t, &st), MN_OK);
        about(v, mesh.vertices, 0.1);
        about(t, mesh.triangles, 0.1);
        mn_mesh_free(&mesh);
    }
}
END_TEST

int main(void) {
    int fd = mkstemp(path);
    if (fd < 0)
        return 1;
    close(fd);
    Suite *suite = suite_create("expect");
    TCase *tc = tcase_create("expect");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, counted_by_their_headers);
    tcase_add_test(tc, counted_by_samples);
    tcase_add_test(tc, soups);
    tcase_add_test(tc, refusals);
    tcase_add_test(tc, real_ones);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    unlink(path);
    return failed;
}
