/* Hubs: vertices of so many simplices that nothing may walk round them each time something changes
 * there. The rim of a fan of n triangles changes n times, so a walk a change would be n².
 *
 * What a hub is asked about is kept here, brought up to date by what changes:
 *
 *   choice    its cheapest candidates, as they were when all were looked at. It looks again after
 *             a MNI_HUB_PART of its fan has changed; until then, when they are used up, it rests
 *   key       the largest of its neighbours' (mni_part.key): these only rise
 *   homes.at  of each of its witnesses, a neighbour: the triangle that is nearest to the witness is
 *             looked for from there on (witness.c)
 *
 * So a change costs a hub what is bounded, and MNI_HUB_PART / MNI_HUB_CHOICES looks a change. The
 * order is that of the paper but for the hub itself: its own collapses may come late. A hub ceases
 * to be one when half of what makes one is left.
 *
 * One thread. Memory: 104 bytes a place, and up to eight places a hub; of hubs there are at most
 * simplices × 3 / MNI_HUB_FAN at a time. */
#ifndef MNI_HUB_H
#define MNI_HUB_H

#include "heap.h"
#include "witness.h"

enum {
    MNI_HUB_FAN = 1024, /* more simplices make one; the Earth at a quarter of a degree has none */
    MNI_HUB_PART = 16,
    MNI_HUB_CHOICES = 4,
    MNI_HUB_CREDIT = 32, /* witnesses that are looked for all round one that has just become one */
};

typedef struct mni_hub {
    uint32_t vertex;
    uint32_t touched, patience; /* changes since it looked, and so many make it look again */
    uint32_t choices;
    mni_heap_key choice[MNI_HUB_CHOICES]; /* in no order */
    float key;                            /* 0: part.key is not kept */
    float closed;                         /* its ring is closed from this cost on (mni_part) */
    bool called; /* it was woken in this stage, since nobody else was left */
    bool frozen; /* it looks at nothing: see frozen.h */
    mni_homes homes;
} mni_hub;

/* Hubs by vertex, hashed; what is no hub any more stays until the table grows. */
typedef struct mni_hubs {
    mni_hub *hub; /* vertex MN_NONE: free */
    uint32_t taken, room;
} mni_hubs;

void mni_hubs_close(mni_hubs *hubs);
/* NULL: no memory. Others move. */
mni_hub *mni_hubs_add(mni_hubs *hubs, const mni_surface *surface, uint32_t v);
/* That of a vertex that is one. */
mni_hub *mni_hubs_of(const mni_hubs *hubs, uint32_t v);

#endif
