/* Lists of corners: of each node, those of its simplices. See corners.c. */
#ifndef MNI_CORNERS_H
#define MNI_CORNERS_H

#include <string.h>

#include "mn_assert.h"
#include "pole.h"
#include "ring.h"

/* ---- packed lists: all chunks but the first are full ------------------------------------------
 */

uint32_t mni_chunk_new(mni_front *front);
void mni_chunk_free(mni_front *front, uint32_t chunk);
static inline uint32_t mni_chunks_left(const mni_front *f) {
    return f->chunks_max - f->chunks_used;
}
uint32_t mni_chunk_corners(const mni_front_chunk *chunk);
/* How many chunks it has. */
uint32_t mni_packed_chunks(const mni_front *front, uint32_t first);
/* first: MN_NONE where the list is empty. It may become so again, by remove. */
void mni_packed_push(mni_front *front, uint32_t *first, uint32_t corner);
/* The last corner of the first chunk takes the place of *hole. */
void mni_packed_remove(mni_front *front, uint32_t *first, uint32_t *hole);

/* ---- of any node ------------------------------------------------------------------------------
 */

static inline void mni_corners_clear(mni_front *f, uint32_t slot) {
    memset(f->node[slot].corner, 0, sizeof f->node[slot].corner);
    f->node[slot].more = MNI_FRONT_SHORT;
}

void mni_corners_push_far(mni_front *front, uint32_t slot, uint32_t corner);
/* Onto a list that is no pole, and whose record is full. Has it got another chunk? */
bool mni_corners_push_chunk(mni_front *front, uint32_t slot, uint32_t corner);
static inline void mni_corners_push(mni_front *f, uint32_t slot, uint32_t corner) {
    mni_front_node *n = &f->node[slot];
    uint32_t count = n->more - MNI_FRONT_SHORT;
    if (count < MNI_FRONT_CORNERS) {
        n->corner[count] = corner;
        n->more++;
    } else {
        mni_corners_push_far(f, slot, corner);
    }
}

static inline void mni_corners_note(mni_front *f, uint32_t corner) {
    f->simplex_stamp[mni_simplex_page(corner)] = (uint32_t)f->version;
}

/* Gives a corner to a slot: on its list, and in its simplex. */
static inline void mni_corners_give(mni_front *f, uint32_t slot, uint32_t corner) {
    f->simplex_node[mni_corner_at(corner)] = slot;
    mni_corners_note(f, corner);
    mni_corners_push(f, slot, corner);
}

void mni_corners_remove_far(mni_front *front, uint32_t slot, uint32_t corner);
/* The last corner of the record takes its place. */
static inline void mni_corners_remove(mni_front *f, uint32_t slot, uint32_t corner) {
    mni_front_node *n = &f->node[slot];
    if (mni_front_is_long(n)) {
        mni_corners_remove_far(f, slot, corner);
        return;
    }
    uint32_t at = mni_ring_place(f, slot, corner), last = --n->more - MNI_FRONT_SHORT;
    MN_ASSERT(at <= last && last < MNI_FRONT_CORNERS);
    n->corner[at] = n->corner[last];
    n->corner[last] = 0;
}

/* A list taken off its slot, to be handed out again; the record's corners first, so that there are
 * chunks enough at any time. Of a pole: as a list that is none's. */
typedef struct mni_loose {
    uint32_t corner[MNI_FRONT_CORNERS]; /* at hand: a record's, or a chunk's; then 0 */
    uint32_t more;
} mni_loose;
mni_loose mni_corners_take(mni_front *front, uint32_t slot);
/* The next ones to hand; false: there are no more. */
bool mni_corners_next(mni_front *front, mni_loose *list);

#endif
