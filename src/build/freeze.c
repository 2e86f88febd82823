/* See freeze.h. Hidden here: what is known of the neighbours of a hub of which a part is here. */
#include "freeze.h"

bool mni_freeze(mni_simplifier *s, uint32_t v, float around) {
    mni_hub *h = mni_hubs_add(&s->hubs, &s->surface, v);
    if (h == NULL)
        return false;
    h->frozen = true;
    h->patience = UINT32_MAX;
    h->key = around;
    h->homes.credit = (uint64_t)MNI_HUB_CREDIT * s->surface.vertex[v].fan.count;
    s->surface.vertex[v].hub = s->surface.vertex[v].tried = true;
    s->surface.trios++;
    return true;
}

static bool is_frozen(const mni_simplifier *s, uint32_t v) {
    return s->surface.vertex[v].hub && mni_hubs_of(&s->hubs, v)->frozen;
}

/* Whether a triangle holds all three. */
static bool is_apex(mni_simplifier *s, uint32_t r, uint32_t k, uint32_t w) {
    uint32_t count;
    const uint32_t *fan = mni_surface_fan(&s->surface, r, &count);
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex *x = &s->surface.simplex[fan[i]];
        mni_corner c = mni_simplex_corner(x, r);
        if ((c.next == k && c.previous == w) || (c.next == w && c.previous == k))
            return true;
    }
    return false;
}

bool mni_freeze_sees(mni_simplifier *s, uint32_t r, uint32_t k) {
    if (!is_frozen(s, k))
        return true;
    mni_judge_ring(&s->judge, &s->surface, r);
    for (uint32_t i = 0; i < s->judge.ring_count; i++) {
        uint32_t w = s->judge.around[i];
        if (w == k)
            continue;
        bool frozen = is_frozen(s, w);
        if (!frozen && s->part.closed[w] == 0)
            return false;
        if (frozen && (s->stage < 3 || is_apex(s, r, k, w)) &&
            !mni_surface_joined_beside(&s->surface, k, w, r))
            return false;
    }
    return true;
}
