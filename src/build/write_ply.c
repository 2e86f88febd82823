/* A mesh as binary little-endian PLY: floats where the origin is 0, else doubles, so that reading
 * it again gives the same positions. The file is whole or not there (mni_out).
 *
 * Threads: any, each call on its own. Memory: mni_out's buffer. */
#include "write_ply.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "file.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files are little-endian");

static bool is_exact(const mn_mesh *mesh) {
    return mesh->origin[0] == 0 && mesh->origin[1] == 0 && mesh->origin[2] == 0;
}

size_t mni_ply_header(const mn_mesh *mesh, char text[MNI_PLY_HEADER_MAX]) {
    const char *real = is_exact(mesh) ? "float" : "double";
    int length = snprintf(
        text, MNI_PLY_HEADER_MAX,
        "ply\nformat binary_little_endian 1.0\ncomment metanode\n"
        "element vertex %" PRIu32 "\nproperty %s x\nproperty %s y\nproperty %s z\n%s"
        "element face %" PRIu32 "\nproperty list uchar int vertex_indices\nend_header\n",
        mesh->vertices, real, real, real,
        mesh->color != NULL ? "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                              "property uchar alpha\n"
                            : "",
        mesh->triangles);
    return (size_t)length;
}

size_t mni_ply_vertex(const mn_mesh *mesh, uint64_t vertex, unsigned char to[MNI_PLY_VERTEX_MAX]) {
    const float *p = mesh->position + 3 * vertex;
    const double place[3] = {mesh->origin[0] + (double)p[0], mesh->origin[1] + (double)p[1],
                             mesh->origin[2] + (double)p[2]};
    size_t length = is_exact(mesh) ? 3 * sizeof *p : sizeof place;
    memcpy(to, is_exact(mesh) ? (const void *)p : place, length);
    if (mesh->color == NULL)
        return length;
    memcpy(to + length, &mesh->color[vertex], sizeof *mesh->color);
    return length + sizeof *mesh->color;
}

void mni_ply_face(const uint32_t corner[3], unsigned char to[MNI_PLY_FACE_BYTES]) {
    to[0] = 3;
    memcpy(to + 1, corner, 3 * sizeof *corner);
}

static mn_code put_header(mni_out *out, const mn_mesh *mesh, mn_status *st) {
    char text[MNI_PLY_HEADER_MAX];
    return mni_out_write(out, text, mni_ply_header(mesh, text), st);
}

static mn_code put_vertex(mni_out *out, const mn_mesh *mesh, uint64_t v, mn_status *st) {
    unsigned char record[MNI_PLY_VERTEX_MAX];
    return mni_out_write(out, record, mni_ply_vertex(mesh, v, record), st);
}

static mn_code put_face(mni_out *out, const mn_mesh *mesh, uint64_t t, mn_status *st) {
    unsigned char record[MNI_PLY_FACE_BYTES];
    mni_ply_face(mesh->corner + 3 * t, record);
    return mni_out_write(out, record, sizeof record, st);
}

mn_code mn_mesh_write_ply(const char *path, const mn_mesh *mesh, mn_status *st) {
    mni_out out;
    mn_code code = mni_out_open(&out, path, st);
    if (code == MN_OK)
        code = put_header(&out, mesh, st);
    for (uint64_t v = 0; v < mesh->vertices && code == MN_OK; v++)
        code = put_vertex(&out, mesh, v, st);
    for (uint64_t t = 0; t < mesh->triangles && code == MN_OK; t++)
        code = put_face(&out, mesh, t, st);
    if (code == MN_OK)
        code = mni_out_commit(&out, st);
    mni_out_abort(&out);
    return code;
}
