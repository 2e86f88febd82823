/* Lists of corners: of each node, those of its simplices.
 *
 * Hides: what becomes of a list that is longer than a record, and where chunks come from. Eight
 * corners stand in the record; what more there are in chunks, packed. A list of MNI_POLE_CHUNKS
 * chunks becomes a pole (pole.c), as long as there are chunks to spare; when none is left poles
 * become lists again, for which there are always enough.
 *
 *      record ─┬─ up to 8 corners
 *              └─ more ──> chunk, 1 to 7 corners ──> 7 corners ──> 7 corners     as they came last
 *
 * Any order of calls. Threads: Navigate only. Memory: the front's chunks, 3 × simplices / 7 at
 * most. Paper: none. */
#include "corners.h"

/* ---- chunks ---------------------------------------------------------------------------------- */

uint32_t mni_chunk_new(mni_front *f) {
    if (mni_chunks_left(f) == 0)
        mni_poles_give_way(f);
    uint32_t i = f->chunk_free;
    if (i != MN_NONE) {
        f->chunk_free = f->chunk[i].next;
    } else {
        MN_ASSERT(f->chunks_high < f->chunks_max);
        i = f->chunks_high++;
    }
    f->chunks_used++;
    memset(f->chunk[i].corner, 0, sizeof f->chunk[i].corner);
    return i;
}

void mni_chunk_free(mni_front *f, uint32_t i) {
    f->chunk[i].next = f->chunk_free;
    f->chunk_free = i;
    f->chunks_used--;
}

uint32_t mni_chunk_corners(const mni_front_chunk *chunk) {
    uint32_t count = 0;
    while (count < MNI_FRONT_CHUNK && chunk->corner[count] != 0)
        count++;
    return count;
}

uint32_t mni_packed_chunks(const mni_front *f, uint32_t first) {
    if (first == MN_NONE)
        return 0;
    const uint32_t next = f->chunk[first].next;
    return 1 + (next == MN_NONE ? 0 : f->chunk[next].chunks);
}

void mni_packed_push(mni_front *f, uint32_t *first, uint32_t c) {
    uint32_t count = *first == MN_NONE ? MNI_FRONT_CHUNK : mni_chunk_corners(&f->chunk[*first]);
    if (count == MNI_FRONT_CHUNK) {
        const uint32_t i = mni_chunk_new(f);
        f->chunk[i].next = *first;
        f->chunk[i].witness_order = 0;
        if (*first != MN_NONE) {
            const uint32_t chunks = mni_packed_chunks(f, *first);
            f->chunk[i].witness_order = f->chunk[*first].witness_order;
            f->chunk[*first].chunks = chunks;
        }
        *first = i;
        count = 0;
    }
    f->chunk[*first].corner[count] = c;
}

void mni_packed_remove(mni_front *f, uint32_t *first, uint32_t *hole) {
    mni_front_chunk *chunk = &f->chunk[*first];
    uint32_t *last = &chunk->corner[mni_chunk_corners(chunk) - 1];
    *hole = *last;
    *last = 0;
    if (last == chunk->corner) {
        const uint32_t empty = *first;
        *first = chunk->next;
        if (*first != MN_NONE)
            f->chunk[*first].witness_order = chunk->witness_order;
        mni_chunk_free(f, empty);
    }
}

/* ---- nodes ----------------------------------------------------------------------------------- */

bool mni_corners_push_chunk(mni_front *f, uint32_t slot, uint32_t c) {
    mni_front_node *n = &f->node[slot];
    uint32_t first = n->more;
    if (!mni_front_is_long(n)) {
        first = MN_NONE;
        n->witness = MN_NONE;
    }
    const uint32_t was = first;
    mni_packed_push(f, &first, c);
    n->more = first;
    return first != was;
}

/* Onto a list whose record is full. */
void mni_corners_push_far(mni_front *f, uint32_t slot, uint32_t c) {
    if (mni_front_is_pole(&f->node[slot]))
        mni_pole_push(f, slot, c);
    else if (mni_corners_push_chunk(f, slot, c) &&
             mni_packed_chunks(f, f->node[slot].more) % MNI_POLE_CHUNKS == 0)
        mni_pole_make(f, slot);
}

void mni_corners_remove_far(mni_front *f, uint32_t slot, uint32_t c) {
    mni_front_node *n = &f->node[slot];
    if (mni_front_is_pole(n)) {
        mni_pole_remove(f, slot, c);
        return;
    }
    uint32_t *hole = NULL;
    for (mni_run r = mni_run_first(f, slot); hole == NULL; r = mni_run_next(f, r)) {
        MN_ASSERT(r.corner != NULL);
        for (uint32_t i = 0; i < r.room && hole == NULL; i++, mni_front_looks(f, 1))
            if (r.corner[i] == c)
                hole = &r.corner[i];
    }
    uint32_t first = n->more;
    mni_packed_remove(f, &first, hole);
    n->more = first == MN_NONE ? MNI_FRONT_SHORT + MNI_FRONT_CORNERS : first;
}

mni_loose mni_corners_take(mni_front *f, uint32_t slot) {
    if (mni_front_is_pole(&f->node[slot]))
        mni_pole_unmake(f, slot);
    mni_front_node *n = &f->node[slot];
    mni_loose list = {.more = mni_front_is_long(n) ? n->more : MN_NONE};
    memcpy(list.corner, n->corner, sizeof n->corner);
    mni_corners_clear(f, slot);
    return list;
}

bool mni_corners_next(mni_front *f, mni_loose *list) {
    const uint32_t i = list->more;
    if (i == MN_NONE)
        return false;
    mni_front_looks(f, MNI_FRONT_CHUNK);
    memcpy(list->corner, f->chunk[i].corner, sizeof f->chunk[i].corner);
    list->corner[MNI_FRONT_CHUNK] = 0;
    list->more = f->chunk[i].next;
    mni_chunk_free(f, i);
    return true;
}
