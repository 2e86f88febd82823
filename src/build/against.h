/* Is full detail the mesh that a tree was built from? Told leaf by leaf and simplex by simplex, in
 * memory that does not grow with them.
 *
 *   open ── leaf × n ── match ── simplex × m ── end ── close
 *
 * One thread; calls block on the mesh's file and on temporary ones. The first failure stays: calls
 * after it return it. */
#ifndef MNI_AGAINST_H
#define MNI_AGAINST_H

#include "metanode/build.h"

/* Of work_bytes, what is free for others while leaves and simplices are told. */
#define MNI_AGAINST_FREE_SHARE 2
#define MNI_AGAINST_WORK_MIN (UINT64_C(2) << 20)

typedef struct mni_against_desc {
    const char *name;    /* of the tree's file, for messages */
    const char *input;   /* the mesh's */
    mn_read_desc read;   /* how it is read */
    bool either_weld;    /* as the tree has as many vertices */
    uint64_t work_bytes; /* at least MNI_AGAINST_WORK_MIN */
    const char *temp_dir;
    mn_watch watch;
    uint32_t leaves, triangles, hinges; /* of the tree */
    double origin[3];
    float grid_step;
} mni_against_desc;

typedef struct mni_against mni_against;

/* Reads the mesh. What the desc points to outlives *out. MN_BAD_INPUT: it cannot be read, or holds
 * another number of vertices or triangles; MN_NO_SPACE, MN_CAP_TOO_SMALL as mni_extmesh_read. */
mn_code mni_against_open(mni_against **out, const mni_against_desc *desc, mn_status *st);
mn_code mni_against_leaf(mni_against *a, uint32_t leaf, const float position[3]);
/* All leaves have been told. MN_BAD_INPUT: one is no vertex of the mesh. */
mn_code mni_against_match(mni_against *a);
/* corner[2] is MN_NONE in a hinge. */
mn_code mni_against_simplex(mni_against *a, const uint32_t corner[3]);
/* All simplices have been told. Fills matched_triangles and merged_positions. MN_BAD_INPUT: a
 * triangle of the mesh is not there, or a hinge is no edge of it. */
mn_code mni_against_end(mni_against *a, mn_verify_result *out);
void mni_against_close(mni_against *a); /* NULL is harmless */

#endif
