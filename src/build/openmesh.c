/* Subdivision and decimation by OpenMesh: sends a mesh to metanode-openmesh and takes the answer.
 * Hides the stream's form. Memory: the result, its caller's; the helper's own is not counted. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "helper.h"

enum { CHUNK = 4096 }; /* vertices converted at a time */

static bool send_mesh(mni_helper *helper, const mn_mesh *mesh) {
    mni_helper_head head = {.magic = {'M', 'N', 'O', 'M', 'S', 'T', 'R', 'M'},
                            .vertices = mesh->vertices,
                            .triangles = mesh->triangles};
    double chunk[3 * CHUNK];
    bool ok = mni_helper_write(helper, &head, sizeof head);
    for (uint64_t i = 0, end = 3 * (uint64_t)mesh->vertices; i < end && ok;) {
        size_t count = 0;
        while (count < 3 * CHUNK && i < end)
            chunk[count++] = mesh->position[i++];
        ok = mni_helper_write(helper, chunk, count * sizeof chunk[0]);
    }
    ok = ok && mni_helper_write(helper, mesh->corner,
                                3 * (size_t)mesh->triangles * sizeof mesh->corner[0]);
    mni_helper_write_end(helper);
    return ok;
}

/* false: out of memory, or the stream is cut or lies (close tells which). */
static bool receive_mesh(mni_helper *helper, mn_mesh *out) {
    mni_helper_head head;
    double chunk[3 * CHUNK];
    if (!mni_helper_read_head(helper, &head) || head.vertices > INT32_MAX ||
        head.triangles > INT32_MAX || head.has_colors != 0)
        return false;
    out->vertices = (uint32_t)head.vertices;
    out->triangles = (uint32_t)head.triangles;
    out->position = malloc(3 * head.vertices * sizeof out->position[0] + 1);
    out->corner = malloc(3 * head.triangles * sizeof out->corner[0] + 1);
    if (out->position == NULL || out->corner == NULL)
        return false;
    for (uint64_t i = 0, end = 3 * head.vertices; i < end;) {
        size_t count = end - i < 3 * CHUNK ? (size_t)(end - i) : 3 * CHUNK;
        if (!mni_helper_read(helper, chunk, count * sizeof chunk[0]))
            return false;
        for (size_t j = 0; j < count; j++)
            out->position[i++] = (float)chunk[j];
    }
    if (!mni_helper_read(helper, out->corner, 3 * head.triangles * sizeof out->corner[0]))
        return false;
    for (uint64_t i = 0; i < 3 * head.triangles; i++)
        if (out->corner[i] >= out->vertices)
            return false;
    return true;
}

/* Sends the mesh through the helper's command. */
static mn_code through(const mn_mesh *mesh, const char *const *args, const char *helper_dir,
                       mn_mesh *out, char line[MNI_HELPER_LINE_BYTES], mn_status *st) {
    mni_helper helper;
    *out = (mn_mesh){0};
    mn_code code = mni_helper_open(&helper, helper_dir, &mni_helper_openmesh, args, st);
    if (code != MN_OK)
        return code;
    bool whole = send_mesh(&helper, mesh) && receive_mesh(&helper, out);
    code = mni_helper_close(&helper, args[0], line, st);
    if (code == MN_OK && !whole)
        code = mn_fail(st, MN_FAILED, "no memory for the mesh that OpenMesh gives");
    if (code != MN_OK) {
        free(out->position);
        free(out->corner);
        *out = (mn_mesh){0};
        return code;
    }
    memcpy(out->origin, mesh->origin, sizeof out->origin);
    out->intake.input_faces = out->triangles;
    return MN_OK;
}

mn_code mn_openmesh_subdivide(const mn_mesh *mesh, uint32_t times, const char *helper_dir,
                              mn_mesh *out, mn_status *st) {
    char number[16];
    snprintf(number, sizeof number, "%" PRIu32, times);
    const char *const args[] = {"subdivide", "--times", number, NULL};
    return through(mesh, args, helper_dir, out, NULL, st);
}

mn_code mn_openmesh_decimate(const mn_mesh *mesh, uint32_t triangles, const char *helper_dir,
                             mn_mesh *out, mn_decimation *figures, mn_status *st) {
    char number[16], line[MNI_HELPER_LINE_BYTES];
    snprintf(number, sizeof number, "%" PRIu32, triangles);
    const char *const args[] = {"decimate", "--triangles", number, NULL};
    mn_code code = through(mesh, args, helper_dir, out, line, st);
    if (code != MN_OK)
        return code;
    if (sscanf(line, "decimate seconds=%lf collapses=%" SCNu64, &figures->seconds,
               &figures->collapses) == 2)
        return MN_OK;
    mn_mesh_free(out);
    return mn_fail(st, MN_FAILED, "metanode-openmesh says no figures but '%s'", line);
}
