#include "read_help.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

mn_code read_bytes(const void *bytes, size_t size, const mn_read_desc *desc, mn_mesh *out,
                   mn_status *st) {
    char path[] = "/tmp/metanode-test-XXXXXX";
    int fd = mkstemp(path);
    ck_assert_int_ge(fd, 0);
    FILE *file = fdopen(fd, "wb");
    ck_assert_ptr_nonnull(file);
    ck_assert_uint_eq(fwrite(bytes, 1, size, file), size);
    ck_assert_int_eq(fclose(file), 0);
    mn_code code = mn_mesh_read(path, desc, out, st);
    unlink(path);
    return code;
}

mn_mesh read_text(const char *text, const mn_read_desc *desc) {
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_msg(read_bytes(text, strlen(text), desc, &mesh, &st) == MN_OK, "%s", st.text);
    check_mesh(&mesh);
    return mesh;
}

void expect_refusal(const void *bytes, size_t size, const char *phrase) {
    mn_mesh mesh;
    mn_status st = {0};
    mn_code code = read_bytes(bytes, size, NULL, &mesh, &st);
    ck_assert_msg(code == MN_BAD_INPUT, "code %d instead of bad input, wanted: %s", (int)code,
                  phrase);
    ck_assert_msg(strstr(st.text, phrase) != NULL, "'%s' does not say '%s'", st.text, phrase);
    for (const char *c = st.text; *c != 0; c++)
        ck_assert_msg((unsigned char)*c >= ' ', "not one printable line: %s", st.text);
    ck_assert_ptr_null(mesh.position);
    ck_assert_ptr_null(mesh.corner);
}

static bool at_place(const mn_mesh *mesh, uint32_t vertex, const double place[3]) {
    for (int i = 0; i < 3; i++)
        if (fabs(mesh->origin[i] + (double)mesh->position[3 * vertex + i] - place[i]) > 1e-6)
            return false;
    return true;
}

bool has_triangle(const mn_mesh *mesh, uint32_t t, const double place[3][3]) {
    const uint32_t *corner = mesh->corner + 3 * t;
    for (int turn = 0; turn < 3; turn++)
        if (at_place(mesh, corner[turn], place[0]) &&
            at_place(mesh, corner[(turn + 1) % 3], place[1]) &&
            at_place(mesh, corner[(turn + 2) % 3], place[2]))
            return true;
    return false;
}

const char *real_mesh(const char *name) {
    static char path[512];
    const char *folder = getenv("MN_MESHES");
    snprintf(path, sizeof path, "%s/%s", folder != NULL ? folder : MESHES_DEFAULT, name);
    if (access(path, R_OK) == 0)
        return path;
    printf("skipped: %s is not there\n", path);
    return NULL;
}

void check_mesh(const mn_mesh *mesh) {
    const mn_intake *c = &mesh->intake;
    ck_assert_uint_gt(mesh->triangles, 0);
    ck_assert_uint_eq(c->input_faces, mesh->triangles + c->duplicate_faces + c->degenerate_faces +
                                          c->nonfinite_faces);
    bool *used = calloc(mesh->vertices, sizeof *used);
    for (uint64_t i = 0; i < 3 * (uint64_t)mesh->triangles; i++) {
        ck_assert_uint_lt(mesh->corner[i], mesh->vertices);
        used[mesh->corner[i]] = true;
    }
    for (uint32_t t = 0; t < mesh->triangles; t++) {
        const uint32_t *corner = mesh->corner + 3 * (uint64_t)t;
        ck_assert(corner[0] != corner[1] && corner[1] != corner[2] && corner[2] != corner[0]);
    }
    for (uint32_t v = 0; v < mesh->vertices; v++) {
        ck_assert(used[v]);
        for (int i = 0; i < 3; i++)
            ck_assert(isfinite(mesh->position[3 * (uint64_t)v + i]));
    }
    free(used);
}
