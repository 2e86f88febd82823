/* See hub.h. Hidden here: how a hub is found. */
#include "hub.h"

#include <math.h>
#include <stdlib.h>

#include "mn_assert.h"

enum { ROOM_MIN = 16 };

static uint32_t place(const mni_hubs *hubs, uint32_t v) {
    uint32_t at = v * 0x9e3779b1u;
    at ^= at >> 15;
    for (;; at++) {
        const mni_hub *h = &hubs->hub[at & (hubs->room - 1)];
        if (h->vertex == v || h->vertex == MN_NONE)
            return at & (hubs->room - 1);
    }
}

void mni_hubs_close(mni_hubs *hubs) {
    free(hubs->hub);
    *hubs = (mni_hubs){0};
}

/* Those that are hubs yet move to a table that is at most half full. */
static bool grow(mni_hubs *hubs, const mni_surface *surface) {
    uint32_t alive = 0;
    for (uint32_t i = 0; i < hubs->room; i++)
        alive += hubs->hub[i].vertex != MN_NONE && surface->vertex[hubs->hub[i].vertex].hub;
    mni_hubs old = *hubs;
    hubs->taken = 0;
    for (hubs->room = ROOM_MIN; hubs->room < 4 * (alive + 1);)
        hubs->room *= 2;
    hubs->hub = malloc(hubs->room * sizeof *hubs->hub);
    if (hubs->hub == NULL) {
        *hubs = old;
        return false;
    }
    for (uint32_t i = 0; i < hubs->room; i++)
        hubs->hub[i].vertex = MN_NONE;
    for (uint32_t i = 0; i < old.room; i++)
        if (old.hub[i].vertex != MN_NONE && surface->vertex[old.hub[i].vertex].hub) {
            hubs->hub[place(hubs, old.hub[i].vertex)] = old.hub[i];
            hubs->taken++;
        }
    free(old.hub);
    return true;
}

mni_hub *mni_hubs_add(mni_hubs *hubs, const mni_surface *surface, uint32_t v) {
    if (2 * hubs->taken >= hubs->room && !grow(hubs, surface))
        return NULL;
    mni_hub *h = &hubs->hub[place(hubs, v)];
    hubs->taken += h->vertex != v;
    *h = (mni_hub){.vertex = v, .closed = INFINITY};
    for (int i = 0; i < MNI_WITNESSES; i++)
        h->homes.at[i] = MN_NONE;
    return h;
}

mni_hub *mni_hubs_of(const mni_hubs *hubs, uint32_t v) {
    MN_ASSERT(hubs->room > 0);
    mni_hub *h = &hubs->hub[place(hubs, v)];
    MN_ASSERT(h->vertex == v);
    return h;
}
