/* Goal: .om files are read through OpenMesh's helper, cut ones are refused, and on good files of
 * other formats OpenMesh and our readers agree. Method: an .om that OpenMesh itself writes, whole
 * and cut; the same small meshes and a real one through both readers, compared by positions. */
#include "read_help.h"
#include "helper.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static mn_read_desc through_openmesh(void) {
    mn_read_desc desc = {.reader = MN_READER_OPENMESH, .helper_dir = getenv("METANODE_HELPER_DIR")};
    ck_assert_ptr_nonnull(desc.helper_dir);
    return desc;
}

/* Two triangles as OpenMesh writes them. Returns the number of bytes. */
static size_t make_om(char *bytes, size_t room) {
    static const double position[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0.5};
    static const uint32_t corner[6] = {0, 1, 2, 2, 1, 3};
    char path[] = "/tmp/metanode-test-XXXXXX.om";
    int fd = mkstemps(path, 3);
    ck_assert_int_ge(fd, 0);
    const mni_helper_head head = {
        .magic = {'M', 'N', 'O', 'M', 'S', 'T', 'R', 'M'}, .vertices = 4, .triangles = 2};
    const char *const args[] = {"write", path, "--as", "om", NULL};
    mni_helper helper;
    mn_status st = {0};
    ck_assert_int_eq(
        mni_helper_open(&helper, getenv("METANODE_HELPER_DIR"), &mni_helper_openmesh, args, &st),
        MN_OK);
    mni_helper_write(&helper, &head, sizeof head);
    mni_helper_write(&helper, position, sizeof position);
    mni_helper_write(&helper, corner, sizeof corner);
    ck_assert_msg(mni_helper_close(&helper, path, NULL, &st) == MN_OK, "%s", st.text);
    ssize_t size = read(fd, bytes, room);
    ck_assert_int_gt(size, 0);
    close(fd);
    unlink(path);
    return (size_t)size;
}

START_TEST(om_whole) {
    char bytes[4096];
    size_t size = make_om(bytes, sizeof bytes);
    mn_read_desc desc = through_openmesh();
    desc.reader = MN_READER_OWN; /* content decides */
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_msg(read_bytes(bytes, size, &desc, &mesh, &st) == MN_OK, "%s", st.text);
    check_mesh(&mesh);
    const double first[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    ck_assert_uint_eq(mesh.triangles, 2);
    ck_assert(has_triangle(&mesh, 0, first));
    mn_mesh_free(&mesh);
    desc.ram_bytes = 1 << 20; /* not enough for OpenMesh itself */
    ck_assert_int_ne(read_bytes(bytes, size, &desc, &mesh, &st), MN_OK);
}
END_TEST

START_TEST(om_cut) {
    char bytes[4096];
    size_t size = make_om(bytes, sizeof bytes);
    mn_read_desc desc = through_openmesh();
    for (size_t cut = 4; cut < size; cut += 1 + size / 40) {
        mn_mesh mesh;
        mn_status st = {0};
        mn_code code = read_bytes(bytes, cut, &desc, &mesh, &st);
        ck_assert_msg(code == MN_BAD_INPUT || (code == MN_OK && mesh.triangles <= 2), "%d: %s",
                      (int)code, st.text);
        ck_assert_ptr_null(strchr(st.text, '\n'));
        mn_mesh_free(&mesh);
    }
}
END_TEST

START_TEST(no_helper) {
    mn_read_desc desc = {.reader = MN_READER_OPENMESH, .helper_dir = "/nowhere"};
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_int_eq(read_bytes("v 0 0 0\n", 8, &desc, &mesh, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "metanode-openmesh"));
}
END_TEST

/* Same triangles at the same places, in the same order? OpenMesh keeps floats. */
static void expect_same(const mn_mesh *a, const mn_mesh *b) {
    ck_assert_uint_eq(a->triangles, b->triangles);
    ck_assert_uint_eq(a->vertices, b->vertices);
    for (uint64_t i = 0; i < 3 * (uint64_t)a->triangles; i++) {
        for (int j = 0; j < 3; j++) {
            double x = a->origin[j] + (double)a->position[3 * (uint64_t)a->corner[i] + j];
            double y = b->origin[j] + (double)b->position[3 * (uint64_t)b->corner[i] + j];
            ck_assert_double_le(fabs(x - y), 1e-6 * (1 + fabs(x)));
        }
    }
}

START_TEST(both_readers_agree) {
    static const char *const texts[] = {
        "v 0 0 0\nv 1.25 0 0\nv 0 1 0\nv 1 1 3\nf 1 2 3\nf 3 2 4\n",
        "OFF\n4 2 0\n0 0 0\n1.25 0 0\n0 1 0\n1 1 3\n3 0 1 2\n3 2 1 3\n",
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1.25 0 0\n0 1 0\n1 1 3\n4 0 1 3 2\n",
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
        "endloop\nendfacet\nfacet normal 0 0 1\nouter loop\nvertex 0 1 0\nvertex 1 0 0\n"
        "vertex 1 1 0\nendloop\nendfacet\nendsolid a\n",
    };
    mn_read_desc desc = through_openmesh();
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        mn_mesh own = read_text(texts[i], NULL), other = read_text(texts[i], &desc);
        expect_same(&own, &other);
        mn_mesh_free(&own);
        mn_mesh_free(&other);
    }
}
END_TEST

START_TEST(both_agree_on_real_meshes) {
    static const char *const names[] = {"teapot.obj", "fandisk.obj", "bunny.obj"};
    const char *path = real_mesh(names[_i]);
    if (path == NULL)
        return;
    mn_read_desc desc = through_openmesh();
    mn_mesh own, other;
    mn_status st = {0};
    ck_assert_msg(mn_mesh_read(path, NULL, &own, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_mesh_read(path, &desc, &other, &st) == MN_OK, "%s", st.text);
    expect_same(&own, &other);
    mn_mesh_free(&own);
    mn_mesh_free(&other);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("read_openmesh");
    TCase *tests = tcase_create("openmesh");
    tcase_set_timeout(tests, 60);
    tcase_add_test(tests, om_whole);
    tcase_add_test(tests, om_cut);
    tcase_add_test(tests, no_helper);
    tcase_add_test(tests, both_readers_agree);
    tcase_add_loop_test(tests, both_agree_on_real_meshes, 0, 3);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
