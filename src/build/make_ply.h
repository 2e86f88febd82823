/* A binary little-endian PLY being written in a stream: vertices with colours, then triangles.
 *
 *   open ── begin ── vertex × n ── face × m ── close
 *
 * One thread. Memory: buffers, whatever the model. When the counts are known beforehand everything
 * goes straight to the file; when they are not, faces may come between vertices: they wait in a
 * second file beside it, and close puts the counts into the header. */
#ifndef MNI_MAKE_PLY_H
#define MNI_MAKE_PLY_H

#include <stdbool.h>
#include <stdint.h>

#include "file.h"
#include "metanode/status.h"

#define MNI_MAKE_UNKNOWN UINT64_MAX

typedef struct mni_make_ply {
    mni_out out;
    mni_out spool; /* faces, while vertices may still come; zeroed: none */
    bool spooled;
    mn_status trouble; /* the first failure of a write */
    uint64_t vertices_due, triangles_due, vertices, triangles;
} mni_make_ply;

mn_code mni_make_ply_open(mni_make_ply *ply, const char *path, mn_status *st);
/* Both counts, or both MNI_MAKE_UNKNOWN. */
mn_code mni_make_ply_begin(mni_make_ply *ply, uint64_t vertices, uint64_t triangles, mn_status *st);
/* Failures are kept and told by close; writing on is then without effect. color: 0xBBGGRR. */
void mni_make_ply_vertex(mni_make_ply *ply, const double position[3], uint32_t color);
void mni_make_ply_face(mni_make_ply *ply, uint32_t a, uint32_t b, uint32_t c);
/* Gives the file its name. Asserts that what was promised was written. On failure, or when it is
 * not to be kept, nothing is left behind. ply is closed either way. */
mn_code mni_make_ply_close(mni_make_ply *ply, bool keep, mn_status *st);

#endif
