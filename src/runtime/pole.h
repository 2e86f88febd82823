/* Poles: nodes of so many corners that nothing may look through them all. See pole.c. */
#ifndef MNI_POLE_H
#define MNI_POLE_H

#include "front.h"

enum {
    MNI_POLE_CHUNKS = 32, /* of a list that becomes a pole: 232 corners. Scans have none */
    MNI_POLES = 32,       /* at a time: their numbers are the bits of a word */
};

/* All of these, but for make: of a pole. */
/* A list becomes a pole if there are chunks to spare, and a number. */
void mni_pole_make(mni_front *front, uint32_t slot);
/* It becomes a list again, however long. */
void mni_pole_unmake(mni_front *front, uint32_t slot);
/* One of them does, since no chunk is left. */
void mni_poles_give_way(mni_front *front);
/* The corner stands in its simplex. After each of these it may be a pole no longer. */
void mni_pole_push(mni_front *front, uint32_t slot, uint32_t corner);
void mni_pole_remove(mni_front *front, uint32_t slot, uint32_t corner);
/* Takes out a corner of a leaf from mid on; 0: there is none. */
uint32_t mni_pole_pop(mni_front *front, uint32_t slot, uint32_t mid);

/* Neighbours, as far as room goes, whose order id is above that, or whose parent's is below: 0 asks
 * for none. Returns how many. */
uint32_t mni_pole_seek(mni_front *front, uint32_t slot, uint32_t order, uint32_t above,
                       mni_front_ref *out, uint32_t room);
/* A pole next to this one that holds the leaf; MN_NONE: none. */
uint32_t mni_pole_find(const mni_front *front, uint32_t slot, uint32_t leaf);
/* Order ids of a node, or of its parent, are new: poles next to it are told. Any node. */
void mni_poles_tell(mni_front *front, uint32_t slot);

/* Asserts the equations of a pole, and of those that it is next to. Returns how many corners. */
uint64_t mni_pole_check(const mni_front *front, uint32_t slot);

#endif
