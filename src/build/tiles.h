/* What a round leaves, dealt to the cells of the next one before these are known.
 *
 * The next round's curve is cut into tiles, several to a cell, before the round begins, by samples
 * of the vertices that there are. A cell that is done puts what is left of it into parcels, one
 * for each tile that it has something in; when all are done, tiles that follow each other are made
 * cells, by what is really in them:
 *
 *     curve    ├──┼──┼──┼──┼──┼──┼──┼──┼──┼──┼──┼──┼──┼──┼──┤     tiles
 *     file     [2 of cell 0][3 of cell 0][7 of cell 0][2 of cell 1]…      parcels, as they come
 *     cells    └─────── 0 ───────┘└────── 1 ──────┘└──────┘
 *
 * A parcel is told where the one before of the same tile lies. So each byte is written once and
 * read once, in pieces of some kilobytes that are near each other, and nothing is sorted. What
 * fits the buffer stays in memory.
 *
 *   open ── put … ── finish ── take each cell, once ── close
 *                            └ shed: cells without simplices ┘
 *
 * Puts and takes may come from any thread, and may block on the disk. Which tile, which cell: from
 * samples and counts alone. Memory: the buffer, and 48 bytes a tile. */
#ifndef MNI_TILES_H
#define MNI_TILES_H

#include <pthread.h>

#include "extsort.h"
#include "spill.h"

/* On the curve: by key, then by id, so that vertices in one place can be told apart. */
typedef struct mni_tile_sample {
    uint64_t key;
    uint32_t zero, id;
} mni_tile_sample;

/* What a parcel holds; its sections follow each other behind the head. */
typedef struct mni_parcel {
    uint64_t before; /* the tile's parcel before: where it lies, and how long it is; 0: none */
    uint32_t before_bytes;
    uint32_t tile, source;                               /* the cell that it comes from */
    uint32_t vertices, nodes, points, simplices, sights; /* points: leaves' witnesses */
    uint32_t ids_bytes, vertices_bytes, simplices_bytes, sights_bytes;
} mni_parcel;

typedef struct mni_tile {
    uint64_t last; /* parcel */
    uint32_t last_bytes, parcels, vertices, simplices;
    uint64_t bytes;
} mni_tile;

typedef struct mni_tiles {
    /* const after open */
    mni_tile_sample *cut; /* where each tile but the first begins */
    uint32_t tiles;
    /* guarded by lock */
    pthread_mutex_t lock;
    mni_tile *tile;
    mni_spill spill;
    unsigned char *buffer; /* what follows the spill's bytes */
    size_t buffer_bytes, used_bytes;
    /* const after finish */
    uint32_t *first; /* a cell's tile; cells + 1 of them */
    uint32_t cells;
    uint64_t vertices, simplices;
    bool shed; /* parcels are read without simplices */
} mni_tiles;

#define MNI_TILES_CLOSED                                                                           \
    (mni_tiles) {                                                                                  \
        .spill = {.fd = -1 }                                                                       \
    }

/* Cuts so that each tile has as many samples (all of those in the sort, which has been finished;
 * NULL: none). temp_dir outlives it. On failure it is closed. */
mn_code mni_tiles_open(mni_tiles *t, uint32_t tiles, mni_sort *samples, size_t buffer_bytes,
                       const char *temp_dir, mn_status *st);
void mni_tiles_close(mni_tiles *t); /* harmless on a closed one */
uint32_t mni_tiles_find(const mni_tiles *t, uint64_t key, uint32_t id);
/* Behind the parcel's head come its sections; the head's before is filled in. Failures are told by
 * finish. */
void mni_tiles_put(mni_tiles *t, mni_parcel *head, unsigned char *parcel);
/* What is in memory goes to the file, and its buffer: when all has been put. */
mn_code mni_tiles_empty(mni_tiles *t, mn_status *st);
/* Cells of about so many vertices, or of as many simplices as a surface of these has; one, if all
 * fits. */
mn_code mni_tiles_finish(mni_tiles *t, uint32_t cell_vertices, mn_status *st);
/* Calls with the simplices of all parcels, by tile, then by source: from then on there are none,
 * and no sights. Before any is taken. Memory: those of one parcel, 72 bytes for each of a tile. */
mn_code mni_tiles_shed(mni_tiles *t,
                       mn_code (*take)(void *context, const mni_parcel *head,
                                       const unsigned char *simplices, mn_status *st),
                       void *context, mn_status *st);

/* What is in a cell's tiles. */
typedef struct mni_crate {
    uint32_t first_tile, end_tile;
    uint32_t vertices, nodes, points, simplices; /* nodes and points: when it has been taken */
    uint32_t parcels;
    uint64_t bytes; /* of the parcels */
    /* of a taken one: by tile, then by source */
    unsigned char *content;
    const unsigned char **parcel;
} mni_crate;

/* How much, before anything is taken. */
mni_crate mni_tiles_cell(const mni_tiles *t, uint32_t cell);
/* The crate is as mni_tiles_cell gave it, and has to be freed, whatever is returned. */
mn_code mni_tiles_take(mni_tiles *t, mni_crate *crate, mn_status *st);
void mni_crate_free(mni_crate *crate); /* of what was taken */

#endif
