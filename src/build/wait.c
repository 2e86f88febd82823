/* See wait.h. Hidden here: how far what is closed reaches. */
#include "wait.h"

static void close_vertex(mni_simplifier *s, uint32_t v, mni_heap_key from) {
    if (from < s->part.closed[v])
        s->part.closed[v] = from;
}

/* What is put off will change the rings of both: they wait too, with what would cost much more. */
static void close_ring(mni_simplifier *s, uint32_t v, float cost) {
    uint32_t count;
    if (s->surface.vertex[v].hub) { /* most of its ring is that of the last time */
        mni_hub *h = mni_hubs_of(&s->hubs, v);
        if (cost >= h->closed / 2)
            return;
        h->closed = cost;
    } else {
        if (cost >= s->part.ring[v])
            return;
        s->part.ring[v] = cost;
    }
    const uint32_t *fan = mni_surface_fan(&s->surface, v, &count);
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++)
            if (s->surface.simplex[fan[i]].v[c] != MN_NONE)
                close_vertex(s, s->surface.simplex[fan[i]].v[c], mni_wait_key(cost, 0));
}

void mni_wait_close(mni_simplifier *s, uint32_t r, uint32_t k, mni_heap_key key) {
    bool here = s->part.closed[r] > 0;
    float cost = mni_heap_key_cost(key) * s->part.slack;
    close_vertex(s, r, mni_wait_key(cost, mni_heap_key_kept(key)));
    close_vertex(s, k, mni_wait_key(cost, mni_heap_key_kept(key)));
    if (here && s->part.rings) {
        close_ring(s, r, MNI_WAIT_RING * cost);
        close_ring(s, k, MNI_WAIT_RING * cost);
    }
}
