/* What our readers do not read (.om), and what --reader openmesh asks for: through OpenMesh in a
 * helper process, whose memory and processor time are limited by the size of the file. What comes
 * back goes through the intake like any other file.
 *
 * Order: one call; the helper has ended when it returns. Memory: a chunk. */
#include "reader.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cap.h"
#include "helper.h"

enum {
    CHUNK = 2048,             /* vertices or triangles taken at a time */
    SECONDS_MIN = 2,          /* of processor time, */
    BYTES_A_SECOND = 1 << 20, /* and what even its slowest reader does in one */
    BYTES_A_BYTE = 64,        /* memory that its meshes take for a byte of their file, at most */
};
#define RAM_MIN_BYTES (UINT64_C(256) << 20) /* address space before the first vertex */

/* What it keeps in memory while we read from it: measured 84 bytes a vertex of globes and scans,
 * with two triangles each, and 4 MB; and what we take then, at the least. */
enum { VERTEX_BYTES = 26, TRIANGLE_BYTES = 34, HELPER_BYTES = 5 << 20, OWN_BYTES = 8 << 20 };

typedef struct stream {
    mni_helper *helper;
    mni_intake *intake;
    mni_helper_head head;
} stream;

/* A path that is no option. */
static bool make_operand(const char *path, char **operand, mn_status *st) {
    size_t room = strlen(path) + 3;
    *operand = malloc(room);
    if (*operand != NULL)
        snprintf(*operand, room, "%s%s", path[0] == '-' ? "./" : "", path);
    else
        mn_fail(st, MN_FAILED, "no memory");
    return *operand != NULL;
}

/* Positions, all of them, and then colours come before the triangles; vertices with colours are
 * pushed when both are known, so positions wait in memory where there are colours. */
static bool take_vertices(stream *s) {
    double place[3 * CHUNK];
    uint32_t rgba[CHUNK];
    double *all = NULL;
    bool ok = true;
    uint64_t vertices = s->head.vertices;
    if (s->head.has_colors != 0) {
        all = malloc(3 * vertices * sizeof *all + 1);
        ok = all != NULL && mni_helper_read(s->helper, all, 3 * vertices * sizeof *all);
    }
    for (uint64_t v = 0; ok && v < vertices; v += CHUNK) {
        size_t count = vertices - v < CHUNK ? (size_t)(vertices - v) : CHUNK;
        const double *p = all != NULL ? all + 3 * v : place;
        ok = all != NULL ? mni_helper_read(s->helper, rgba, count * sizeof *rgba)
                         : mni_helper_read(s->helper, place, 3 * count * sizeof *place);
        for (size_t i = 0; ok && i < count; i++)
            ok = mni_intake_vertex_color(s->intake, p + 3 * i, all != NULL ? rgba[i] : MNI_WHITE);
    }
    free(all);
    return ok;
}

static bool take_triangles(stream *s) {
    uint32_t corner[3 * CHUNK];
    uint64_t triangles = s->head.triangles;
    for (uint64_t t = 0; t < triangles; t += CHUNK) {
        size_t count = triangles - t < CHUNK ? (size_t)(triangles - t) : CHUNK;
        if (!mni_helper_read(s->helper, corner, 3 * count * sizeof *corner))
            return false;
        for (size_t i = 0; i < 3 * count; i += 3) {
            const uint32_t *c = corner + i;
            if (c[0] >= s->head.vertices || c[1] >= s->head.vertices || c[2] >= s->head.vertices)
                return false;
            if (!mni_intake_triangle(s->intake, c[0], c[1], c[2]))
                return false;
        }
    }
    return true;
}

uint64_t mni_openmesh_bytes(const char *path) {
    uint64_t vertices, triangles;
    mn_status ignored = {0}; /* whatever is wrong with it is said when it is read */
    if (mn_mesh_expect(path, &vertices, &triangles, &ignored) != MN_OK)
        return HELPER_BYTES;
    return HELPER_BYTES + vertices * VERTEX_BYTES + triangles * TRIANGLE_BYTES;
}

/* Two processes share the cap. False, and said: they cannot. */
static bool fits(const char *path, const mn_read_desc *desc, mni_source *source) {
    const uint64_t need = OWN_BYTES + mni_openmesh_bytes(path);
    if (desc->ram_bytes == 0 || need <= desc->ram_bytes)
        return true;
    mn_fail(source->st, MN_CAP_TOO_SMALL,
            "%s: OpenMesh holds the whole mesh in memory, about %llu MB with what reads "
            "from it, where the cap is %.1f MB; try --ram %lluM",
            source->name, mni_megabytes(need), (double)desc->ram_bytes / (1 << 20),
            mni_megabytes(need));
    return false;
}

bool mni_read_openmesh(const char *path, const char *as, const mn_read_desc *desc,
                       mni_source *source, mni_intake *intake) {
    char ram[24], seconds[24];
    const uint64_t ram_bytes = RAM_MIN_BYTES + BYTES_A_BYTE * source->size;
    char *operand;
    if (!fits(path, desc, source))
        return false;
    snprintf(ram, sizeof ram, "%" PRIu64, ram_bytes);
    snprintf(seconds, sizeof seconds, "%" PRIu64, SECONDS_MIN + source->size / BYTES_A_SECOND);
    if (!make_operand(path, &operand, source->st))
        return false;
    const char *args[] = {"read", operand, "--as", as, "--ram", ram, "--seconds", seconds, NULL};
    mni_helper helper;
    mn_code code =
        mni_helper_open(&helper, desc->helper_dir, &mni_helper_openmesh, args, source->st);
    free(operand);
    if (code != MN_OK)
        return false;
    helper.watch = (mn_watch){source->progress, source->progress_context};
    stream s = {.helper = &helper, .intake = intake};
    bool whole = mni_helper_read_head(&helper, &s.head) &&
                 mni_intake_expect(intake, s.head.vertices, s.head.triangles) &&
                 take_vertices(&s) && take_triangles(&s);
    code = mni_helper_close(&helper, source->name, NULL, source->st);
    if (code == MN_OK && !whole)
        mn_fail(source->st, MN_BAD_INPUT, "%s: OpenMesh makes no mesh of it", source->name);
    return whole && code == MN_OK;
}
