/* Dealing a mesh to cells, as the first round wants it: one after another, from streams alone.
 *
 * A cell is a range of vertices, which stand along a curve, with all triangles at them. Most of
 * these follow each other in the file; one that crosses into other cells is copied to each of them,
 * and the corners that such a cell lacks come as ghosts, with their positions:
 *
 *     triangles ──► those that cross ──► copies, sorted by cell
 *                        └─► (vertex, cell that lacks it), sorted by vertex
 *     vertices  ──────────────┴─► ghosts, sorted by cell; samples
 *
 * That is one pass over both files before the first cell, and one with the cells; what is sorted is
 * what crosses, a few in a hundred. Vertices of too many triangles for a cell are found on the way
 * (heavy.h): they belong to no cell (frozen.h), and where there are any the first pass is done once
 * more without them; and again where cells have too many triangles, and are cut. One thread at a
 * time; calls may block on the disk. Memory: work_bytes, 12 bytes a cell, 16 bytes a hub, and while
 * it is opened up to 64 bytes for 512 triangles, 4 MB at most. */
#ifndef MNI_DEAL_H
#define MNI_DEAL_H

#include "extmesh.h"
#include "extsort.h"

#define MNI_DEAL_WORK_MIN (16 * MNI_SORT_BUDGET_MIN)

typedef struct mni_deal_desc {
    uint32_t cells;         /* of as many vertices each, at first */
    uint32_t triangles_max; /* cells with more are cut into several; 0: none is */
    uint32_t sample_every;  /* vertices, at least 1 */
    uint32_t hub_fan;       /* more triangles make a hub; 0: nothing does */
    uint32_t hubs_max;      /* the heaviest */
    uint64_t work_bytes;    /* at least MNI_DEAL_WORK_MIN */
    const char *temp_dir;
    mn_watch watch; /* while it is opened */
} mni_deal_desc;

/* A triangle, as a cell is given it. */
typedef struct mni_dealt_triangle {
    uint32_t corner[3];
} mni_dealt_triangle;

typedef struct mni_ghost {
    uint32_t id;
    float position[3];
} mni_ghost;

/* What a cell is made of. A hub is neither a vertex of it nor a ghost, though its id may be there.
 */
typedef struct mni_hand {
    uint32_t first, vertices; /* ids [first, first + vertices) */
    float (*position)[3];
    mni_ghost *ghost; /* by id */
    uint32_t ghosts, ghosts_room;
    mni_dealt_triangle *triangle; /* in the order of the file; copies first */
    uint32_t copies, triangles, triangles_room;
} mni_hand;

typedef struct mni_deal mni_deal;

/* Finds what crosses, the box of all vertices, and samples of them. mesh outlives it, and is read
 * alone. MN_FAILED: among others, who watches wants no more. On failure bytes may be asked for all
 * the same, and it is to be closed. */
mn_code mni_deal_open(mni_deal **deal, mni_extmesh *mesh, const mni_deal_desc *desc, mn_status *st);
void mni_deal_box(const mni_deal *deal, float low[3], float high[3]);
/* Of which all coordinates are multiples: the mesh's grid; 0: they are not. */
float mni_deal_step(const mni_deal *deal);
/* Hubs, by id; they stay until it is closed. */
const mni_ghost *mni_deal_hubs(const mni_deal *deal, uint32_t *count);
/* The next sample, NULL: that was all. Before the first hand, or never. */
const mni_ghost *mni_deal_sample(mni_deal *deal, mn_status *st);
/* How many there are. */
uint32_t mni_deal_cells(const mni_deal *deal);
/* What cell c will have, ghosts among the vertices. */
void mni_deal_counts(const mni_deal *deal, uint32_t c, uint32_t *vertices, uint32_t *triangles);
/* The next cell's; arrays of *hand are used again. */
mn_code mni_deal_next(mni_deal *deal, mni_hand *hand, mn_status *st);
/* Moved so far by the sorts. */
void mni_deal_bytes(const mni_deal *deal, uint64_t *read, uint64_t *written);
void mni_deal_close(mni_deal *deal); /* NULL is harmless */
void mni_hand_free(mni_hand *hand);

#endif
