/* A mesh as binary little-endian PLY: floats where the origin is 0, else doubles, so that reading
 * it again gives the same positions. Temporary name, sync, rename: the file is whole or not there.
 *
 * Threads: any, each call on its own. Memory: stdio's buffer. */
#include "metanode/build.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files are little-endian");

static bool is_exact(const mn_mesh *mesh) {
    return mesh->origin[0] == 0 && mesh->origin[1] == 0 && mesh->origin[2] == 0;
}

static void put_header(FILE *file, const mn_mesh *mesh) {
    const char *real = is_exact(mesh) ? "float" : "double";
    fprintf(file, "ply\nformat binary_little_endian 1.0\ncomment metanode\n");
    fprintf(file, "element vertex %" PRIu32 "\n", mesh->vertices);
    fprintf(file, "property %s x\nproperty %s y\nproperty %s z\n", real, real, real);
    if (mesh->color != NULL)
        fprintf(file, "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                      "property uchar alpha\n");
    fprintf(file, "element face %" PRIu32 "\nproperty list uchar int vertex_indices\nend_header\n",
            mesh->triangles);
}

static void put_mesh(FILE *file, const mn_mesh *mesh) {
    bool exact = is_exact(mesh);
    put_header(file, mesh);
    for (uint64_t v = 0; v < mesh->vertices && !ferror(file); v++) {
        const float *p = mesh->position + 3 * v;
        double place[3] = {mesh->origin[0] + (double)p[0], mesh->origin[1] + (double)p[1],
                           mesh->origin[2] + (double)p[2]};
        if (exact)
            fwrite(p, sizeof *p, 3, file);
        else
            fwrite(place, sizeof *place, 3, file);
        if (mesh->color != NULL)
            fwrite(&mesh->color[v], sizeof mesh->color[v], 1, file);
    }
    for (uint64_t t = 0; t < mesh->triangles && !ferror(file); t++) {
        fputc(3, file);
        fwrite(mesh->corner + 3 * t, sizeof *mesh->corner, 3, file);
    }
}

static mn_code cannot(const char *path, int error, mn_status *st) {
    return mn_fail(st, error == ENOSPC || error == EDQUOT ? MN_NO_SPACE : MN_FAILED,
                   "%s: cannot be written: %s", path, strerror(error));
}

mn_code mn_mesh_write_ply(const char *path, const mn_mesh *mesh, mn_status *st) {
    struct stat about;
    if (stat(path, &about) == 0 && !S_ISREG(about.st_mode))
        return mn_fail(st, MN_FAILED, "%s: exists and is no regular file: name another", path);
    size_t room = strlen(path) + 32;
    char *temporary = malloc(room);
    if (temporary == NULL)
        return mn_fail(st, MN_FAILED, "%s: no memory", path);
    snprintf(temporary, room, "%s.%ld.tmp", path, (long)getpid());
    FILE *file = fopen(temporary, "wbxe");
    int error = file == NULL ? errno : 0;
    if (file != NULL) {
        put_mesh(file, mesh);
        if (fflush(file) != 0 || ferror(file) || fsync(fileno(file)) != 0)
            error = errno != 0 ? errno : EIO;
        if (fclose(file) != 0 && error == 0)
            error = errno;
        if (error == 0 && rename(temporary, path) != 0)
            error = errno;
        if (error != 0)
            unlink(temporary);
    }
    free(temporary);
    return error == 0 ? MN_OK : cannot(path, error, st);
}
