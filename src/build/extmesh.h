/* A mesh that need not fit in memory: on disk, welded, checked, renumbered in spatial order.
 *
 *   read ── vertices, triangles: streams of the records below, as often as one likes ── close
 *
 * What is kept, rejected and counted is what mn_mesh_read keeps, rejects and counts; only the order
 * is another: vertices along a Z-order curve, triangles by their smallest vertex, so that
 * neighbours are near each other in the files. One thread calls, and may block on the disk. */
#ifndef MNI_EXTMESH_H
#define MNI_EXTMESH_H

#include <stdbool.h>
#include <stdint.h>

#include "metanode/build.h"
#include "cap.h"
#include "spill.h"

typedef struct mni_extvertex {
    float position[3]; /* relative to the origin */
    uint32_t rgba;     /* MNI_WHITE where the input has no colours */
} mni_extvertex;

typedef struct mni_exttriangle {
    uint32_t corner[3]; /* in the input's order, turned so that the smallest comes first */
} mni_exttriangle;

typedef struct mni_extmesh {
    mni_spill vertex;   /* all of its bytes are mni_extvertex */
    mni_spill triangle; /* packed: exttriangles.h */
    uint64_t vertices, triangles;
    double origin[3];
    bool has_colors;
    bool welded;     /* no two vertices in one place, but for merged_positions */
    float grid_step; /* as mn_mesh.grid_step */
    int unit;        /* positions, but not grid_step, count in 2^unit (unit.h) */
    mn_intake intake;
    uint64_t boundary_edges, nonmanifold_edges;
    uint64_t crossings; /* of triangles between thousands of vertices: mni_exttriangle_crossings */
    uint64_t bytes_read, bytes_written; /* of temporary files, on the way */
} mni_extmesh;

typedef struct mni_extmesh_desc {
    uint32_t position_bits; /* of the grid, as in mn_mesh_quantise: mni_grid_bits has looked at it;
                               0: positions stay where they are, in their own unit */
    uint64_t work_bytes;    /* at least MNI_EXTMESH_WORK_MIN: all that is taken, and of much no more
                               than the file can use; the reader's own buffers and 50 kB of structs
                               apart */
    mni_cap cap;            /* work_bytes is of it: for the number that a refusal names */
    const char *temp_dir;   /* outlives the mesh */
    mn_watch watch;         /* of what comes after reading; zero: nobody */
    bool keep;              /* both are kept spills */
    uint32_t threads;       /* 0: 1; of more than 2, 2 are used. The same for any */
} mni_extmesh_desc;

#define MNI_EXTMESH_WORK_MIN (UINT64_C(256) << 10)

/* As mn_mesh_read (read->ram_bytes is not asked), and mn_mesh_quantise. MN_NO_SPACE: temp_dir is
 * full; MN_CAP_TOO_SMALL, naming what would do: a bit a vertex does not fit an eighth of
 * work_bytes, or vertices are more than 6 × work_bytes. On failure *out is closed. */
mn_code mni_extmesh_read(const char *path, const mn_read_desc *read, const mni_extmesh_desc *desc,
                         mni_extmesh *out, mn_status *st);
/* A mesh in memory written out. vertex_of: of each id, its vertex there; the caller's. Memory: 24
 * bytes a vertex, 8 a triangle. On failure *out is closed. */
mn_code mni_extmesh_make(const mn_mesh *mesh, const char *temp_dir, uint32_t *vertex_of,
                         mni_extmesh *out, mn_status *st);
/* Harmless on a closed one. */
void mni_extmesh_close(mni_extmesh *mesh);

#endif
