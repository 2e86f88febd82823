/* See wait.h. Hidden here: how far what is closed reaches. */
#include "wait.h"

/* Hubs that take what there is for them do not wait: nobody knows what there is in other cells. */
static void close_vertex(mni_simplifier *s, uint32_t v, mni_heap_key from) {
    bool takes = s->part.carries && s->surface.vertex[v].hub && mni_hubs_of(&s->hubs, v)->frozen;
    if (from < s->part.closed[v] && !takes)
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
    float cost = mni_wait_from(&s->part, mni_heap_key_cost(key));
    close_vertex(s, r, mni_wait_key(cost, mni_heap_key_kept(key)));
    close_vertex(s, k, mni_wait_key(cost, mni_heap_key_kept(key)));
    if (here && s->part.rings) {
        close_ring(s, r, MNI_WAIT_RING * cost);
        close_ring(s, k, MNI_WAIT_RING * cost);
    }
}

/* n, beside v. */
static bool waits_beside(const mni_simplifier *s, uint32_t v, uint32_t n) {
    const mni_part *p = &s->part;
    return s->surface.vertex[v].hub || s->surface.vertex[n].hub || p->ring[v] == INFINITY ||
           p->closed[n] <= mni_wait_key(p->ring[v], 0);
}

bool mni_wait_rings_hold(const mni_simplifier *s) {
    bool hold = true;
    for (uint32_t x = 0; x < s->surface.simplices && hold; x++) {
        const mni_simplex *simplex = &s->surface.simplex[x];
        if (simplex->killed != MN_NONE)
            continue;
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                if (a != b && simplex->v[a] != MN_NONE && simplex->v[b] != MN_NONE)
                    hold &= waits_beside(s, simplex->v[a], simplex->v[b]);
    }
    return hold;
}

double mni_wait_ratio(const mni_part *p, uint32_t r, uint32_t k, mni_heap_key key) {
    mni_heap_key from = p->closed[r] < p->closed[k] ? p->closed[r] : p->closed[k];
    if (from == MNI_HEAP_KEY_NONE)
        return 0;
    double cost = fmin((double)mni_heap_key_cost(from), FLT_MAX) / p->slack;
    return (double)mni_heap_key_cost(key) / fmax(cost, (double)MNI_WAIT_LEAST);
}

int mni_wait_level(double ratio) {
    int level = 0;
    while (level + 1 < MNI_LEVELS && ratio > ldexp(1, mni_wait_log2(level)))
        level++;
    return level;
}

double mni_wait_count(mni_part *p, uint32_t r, uint32_t k, mni_heap_key key) {
    double ratio = p->slack > 1 ? mni_wait_ratio(p, r, k, key) : 0;
    p->could_go[mni_wait_level(ratio)]++;
    return ratio;
}
