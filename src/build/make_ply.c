/* The PLY that models are streamed to: see make_ply.h. Secret: the file's layout, and the header
 * that is as long with the counts as without (blanks take up the slack), so that they can be filled
 * in at the end. Memory: the two files' buffers, freed by close. */
#include "make_ply.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "mn_assert.h"

enum {
    VERTEX_BYTES = 15, /* three floats, three bytes of colour */
    FACE_BYTES = 13,   /* a count and three indices */
    HEADER_BYTES = 384,
    COPY_BYTES = 1 << 16,
};
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "positions are copied as they are");

mn_code mni_make_ply_open(mni_make_ply *ply, const char *path, mn_status *st) {
    *ply = (mni_make_ply){0};
    return mni_out_open(&ply->out, path, st);
}

/* The same length for any counts. */
static void format_header(char text[HEADER_BYTES], uint64_t vertices, uint64_t triangles) {
    static const char head[] = "ply\nformat binary_little_endian 1.0\ncomment metanode make";
    char rest[HEADER_BYTES];
    int length = snprintf(rest, sizeof rest,
                          "\nelement vertex %" PRIu64 "\n"
                          "property float x\nproperty float y\nproperty float z\n"
                          "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                          "element face %" PRIu64 "\n"
                          "property list uchar uint vertex_indices\nend_header\n",
                          vertices, triangles);
    MN_ASSERT(length > 0 && sizeof head - 1 + (size_t)length <= HEADER_BYTES);
    memset(text, ' ', HEADER_BYTES);
    memcpy(text, head, sizeof head - 1);
    memcpy(text + HEADER_BYTES - length, rest, (size_t)length);
}

mn_code mni_make_ply_begin(mni_make_ply *ply, uint64_t vertices, uint64_t triangles,
                           mn_status *st) {
    MN_ASSERT((vertices == MNI_MAKE_UNKNOWN) == (triangles == MNI_MAKE_UNKNOWN));
    MN_ASSERT(mni_out_at(&ply->out) == 0);
    ply->vertices_due = vertices;
    ply->triangles_due = triangles;
    ply->spooled = vertices == MNI_MAKE_UNKNOWN;
    mn_code code = ply->spooled ? mni_out_open(&ply->spool, ply->out.path, st) : MN_OK;
    if (code != MN_OK)
        return code;
    char header[HEADER_BYTES];
    format_header(header, vertices, triangles);
    return mni_out_write(&ply->out, header, HEADER_BYTES, st);
}

void mni_make_ply_vertex(mni_make_ply *ply, const double position[3], uint32_t color) {
    MN_ASSERT(ply->spooled || ply->triangles == 0);
    float p[3] = {(float)position[0], (float)position[1], (float)position[2]};
    unsigned char record[VERTEX_BYTES];
    memcpy(record, p, 12);
    memcpy(record + 12, &color, 3);
    mni_out_write(&ply->out, record, VERTEX_BYTES, &ply->trouble);
    ply->vertices++;
}

void mni_make_ply_face(mni_make_ply *ply, uint32_t a, uint32_t b, uint32_t c) {
    const uint32_t corner[3] = {a, b, c};
    unsigned char record[FACE_BYTES] = {3};
    memcpy(record + 1, corner, 12);
    mni_out_write(ply->spooled ? &ply->spool : &ply->out, record, FACE_BYTES, &ply->trouble);
    ply->triangles++;
}

/* The waiting faces, behind the vertices. */
static void append_spool(mni_make_ply *ply) {
    unsigned char bytes[COPY_BYTES];
    uint64_t offset = 0, size = mni_out_at(&ply->spool);
    mni_out_write_at(&ply->spool, 0, bytes, 0, &ply->trouble); /* writes what is buffered */
    while (ply->trouble.code == MN_OK && offset < size) {
        ssize_t got = pread(ply->spool.fd, bytes, COPY_BYTES, (off_t)offset);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0) {
            mn_fail(&ply->trouble, MN_FAILED, "%s: cannot read its faces back: %s", ply->out.path,
                    strerror(got < 0 ? errno : EIO));
            break;
        }
        mni_out_write(&ply->out, bytes, (size_t)got, &ply->trouble);
        offset += (uint64_t)got;
    }
}

/* Faces behind vertices, and the counts into the header. */
static void finish_spooled(mni_make_ply *ply) {
    append_spool(ply);
    char header[HEADER_BYTES];
    format_header(header, ply->vertices, ply->triangles);
    if (ply->trouble.code == MN_OK)
        mni_out_write_at(&ply->out, 0, header, HEADER_BYTES, &ply->trouble);
}

mn_code mni_make_ply_close(mni_make_ply *ply, bool keep, mn_status *st) {
    if (keep && ply->spooled)
        finish_spooled(ply);
    else if (keep)
        MN_ASSERT(ply->vertices == ply->vertices_due && ply->triangles == ply->triangles_due);
    if (keep && ply->trouble.code == MN_OK)
        mni_out_commit(&ply->out, &ply->trouble);
    mni_out_abort(&ply->out);
    mni_out_abort(&ply->spool);
    if (ply->trouble.code != MN_OK)
        mn_fail(st, ply->trouble.code, "%s", ply->trouble.text);
    return ply->trouble.code;
}
