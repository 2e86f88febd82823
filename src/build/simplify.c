/* Simplification in memory: every collapse, cheapest first, recorded as a view-dependence tree.
 *
 * Each vertex r offers its cheapest candidate r → k to the heap. Costs of qem only rise while a
 * vertex's own ring stands (the quadric of k grows), so what the heap holds is a lower bound: a key
 * is made exact when it comes to the top, and goes back if it was too low. A candidate that is
 * illegal gives way to the vertex's next one; all are tried again when the vertex's ring changes.
 * Only the ring of r and k itself can come to have a legal candidate by a collapse r → k, so only
 * these are touched. A vertex with thousands of neighbours (hub.h) looks at its candidates after
 * many such changes only.
 *
 * Stages (design.md §3.2): 1 legal, 2 folding allowed, 3 link condition waived until no simplex is
 * left, 4 virtual edges between roots (roots.c). Here are the first three; the run that they are
 * parts of is simplify_run.c's, and the memory. One thread; blocks on nothing. Paper: §2.1.1. */
#include "simplify.h"

#include <float.h>
#include <math.h>

#include "clock.h"
#include "freeze.h"
#include "mn_assert.h"
#include "wait.h"

/* What k's own candidates cost rises with its quadric, but for rounding: so much below the old
 * bound is a bound still. */
#define FLOOR_MARGIN 0.99999f

/* Quadrics know planes and sums; the largest distance, by which a front is chosen, they do not.
 * Collapses that are cheap and yet make a large error come early, with a large switch value: then
 * all that is collapsed around them later must be split for their sake. So the error is measured
 * before the collapse, and counts. By trial: docs/error.md. */
static const double MEASURED_SHARE = 0.22;

/* By this factor a collapse into a hub may cost more than its place in the order says. */
#define HUB_RISE 1.0625f

/* How often it is asked whether to go on: a signal is to be heard within 0.2 s. */
static const double POLL_S = 0.05;

enum {
    PROGRESS_EVERY = 1 << 14,
    POLL_EVERY = 16,
    NEXT_FAN_MIN = 48,      /* simplices at a vertex: candidates are looked for many at a time */
    MEASURED_FAN_MAX = 128, /* simplices at a vertex: of poles nothing is measured in advance */
#ifdef MN_SLOW_CHECKS
    ORDER_SAMPLE = 1,
    ORDER_FAN_MAX = 256,
#else
    ORDER_SAMPLE = 64,
    ORDER_FAN_MAX = 64,
#endif
};

/* ---- candidates ---- */

static mni_heap_key key_of(const mni_simplifier *s, uint32_t r, uint32_t k) {
    const mni_vertex *vertex = s->surface.vertex;
    return mni_heap_key_make(mni_collapse_cost(&vertex[r], &vertex[k], s->desc.metric), k);
}

/* Candidates of a vertex: the least of all, and the least that is to be offered, which is not below
 * `from` and, where there is a part, not idle (wait.h). MNI_HEAP_KEY_NONE: there is none. */
typedef struct choice {
    uint32_t r;
    const mni_part *part;
    mni_heap_key from, least, best;
} choice;

static inline bool is_idle(const choice *c, mni_heap_key key) {
    return c->part != NULL && mni_wait_is_idle(c->part, c->r, mni_heap_key_kept(key), key);
}

static inline void consider(choice *c, mni_heap_key key) {
    c->least = key < c->least ? key : c->least;
    key = key < c->from ? MNI_HEAP_KEY_NONE : key;
    if (key < c->best && !is_idle(c, key))
        c->best = key;
}

static void consider_slow(mni_simplifier *s, choice *of) {
    uint32_t count, r = of->r;
    const uint32_t *fan = mni_surface_fan(&s->surface, r, &count);
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            uint32_t k = s->surface.simplex[fan[i]].v[c];
            if (k != r && k != MN_NONE)
                consider(of, key_of(s, r, k));
        }
}

/* Looks at r's candidates, unless it is the one that was looked at last. False: it has no wheel. */
static bool look_at(mni_simplifier *s, uint32_t r) {
    mni_look *look = &s->look;
    const mni_wheel *wheel = &s->judge.wheel;
    uint32_t kept[MNI_KEYS_MAX];
    if (look->vertex == r)
        return true;
    if (!mni_judge_wheel(&s->judge, &s->surface, r))
        return false;
    uint32_t count = wheel->count;
    memcpy(kept, wheel->next, sizeof wheel->next);
    for (uint32_t left = mni_wheel_ends(wheel); left != 0; left &= left - 1)
        kept[count++] = wheel->previous[__builtin_ctz(left)];
    for (uint32_t i = 0; i < MNI_KEYS_ROW; i++)
        kept[count + i] = r;
    if (s->desc.metric == MN_METRIC_QEM)
        s->keys(s->surface.vertex, r, kept, count, look->key);
    for (uint32_t i = 0; i < count && s->desc.metric != MN_METRIC_QEM; i++)
        look->key[i] = key_of(s, r, kept[i]);
    for (uint32_t i = 0; i < MNI_KEYS_ROW; i++)
        look->key[count + i] = MNI_HEAP_KEY_NONE;
    look->vertex = r;
    look->count = count;
    return true;
}

/* The least of a row of keys that is not below `from`: which is it cannot be predicted, so there is
 * no branch; how many rows there are nearly always can. */
static inline mni_heap_key least_from(const mni_look *look, mni_heap_key from) {
    mni_heap_key best = MNI_HEAP_KEY_NONE;
    for (uint32_t i = 0; i < look->count; i += MNI_KEYS_ROW)
        for (uint32_t l = i; l < i + MNI_KEYS_ROW; l++) {
            mni_heap_key key = look->key[l] < from ? MNI_HEAP_KEY_NONE : look->key[l];
            best = key < best ? key : best;
        }
    return best;
}

static void consider_all(mni_simplifier *s, choice *c) {
    c->least = c->best = MNI_HEAP_KEY_NONE;
    if (!look_at(s, c->r)) {
        consider_slow(s, c);
        return;
    }
    c->least = least_from(&s->look, 0);
    c->best = c->from <= c->least ? c->least : least_from(&s->look, c->from);
    while (c->best != MNI_HEAP_KEY_NONE && is_idle(c, c->best))
        c->best = least_from(&s->look, c->best + 1);
}

/* The cheapest candidate of r that is not below `from`. */
static mni_heap_key best_candidate(mni_simplifier *s, uint32_t r, mni_heap_key from) {
    choice c = {.r = r, .from = from};
    consider_all(s, &c);
    return c.best;
}

/* The same, of those that are to be offered: begun, and done. */
static choice begin_offer(const mni_simplifier *s, uint32_t r, mni_heap_key from) {
    const mni_part *p = &s->part;
    bool waits = p->closed != NULL && p->closed[r] < MNI_HEAP_KEY_NONE;
    return (choice){.r = r, .from = from, .part = waits ? p : NULL, .best = MNI_HEAP_KEY_NONE};
}

static choice choose_offer(mni_simplifier *s, uint32_t r, mni_heap_key from) {
    choice c = begin_offer(s, r, from);
    consider_all(s, &c);
    return c;
}

/* Where a vertex of n neighbours may go to none of them, each in turn is refused: with a look at
 * all for each that would be n². So one look serves for many. */

static mni_next *next_of(mni_simplifier *s, uint32_t r) {
    return &s->next[r % MNI_NEXTS];
}

/* Puts it among the least, which are in order, each once. */
static void keep_least(mni_next *n, mni_heap_key key) {
    uint32_t at = n->count;
    if (at == MNI_NEXT_MAX && key >= n->key[at - 1])
        return;
    while (at > 0 && n->key[at - 1] > key)
        at--;
    if (at > 0 && n->key[at - 1] == key)
        return;
    n->count += n->count < MNI_NEXT_MAX;
    memmove(&n->key[at + 1], &n->key[at], (n->count - 1 - at) * sizeof n->key[0]);
    n->key[at] = key;
}

static void look_for_next(mni_simplifier *s, mni_next *n, const choice *of) {
    uint32_t count;
    const uint32_t *fan = mni_surface_fan(&s->surface, of->r, &count);
    *n = (mni_next){.vertex = of->r};
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            uint32_t k = s->surface.simplex[fan[i]].v[c];
            if (k == of->r || k == MN_NONE)
                continue;
            mni_heap_key key = key_of(s, of->r, k);
            if (key >= of->from && !is_idle(of, key))
                keep_least(n, key);
        }
}

/* The cheapest candidate of r that is not below `from` and is to be offered; r's ring is what it
 * was when it was asked for last, but that what goes into a hub may have become dearer. */
static mni_heap_key next_offer(mni_simplifier *s, uint32_t r, mni_heap_key from) {
    if (s->surface.vertex[r].fan.count < NEXT_FAN_MIN)
        return choose_offer(s, r, from).best;
    const choice of = begin_offer(s, r, from);
    mni_next *n = next_of(s, r);
    for (;;) {
        if (n->vertex != r || n->at == MNI_NEXT_MAX)
            look_for_next(s, n, &of);
        if (n->at == n->count)
            return MNI_HEAP_KEY_NONE;
        mni_heap_key key = n->key[n->at++];
        uint32_t k = mni_heap_key_kept(key);
        if (key_of(s, r, k) != key)
            n->vertex = MN_NONE;
        else if (key >= from && !is_idle(&of, key))
            return key;
    }
}

/* ---- hubs ---- */

/* Of the keys of v and its neighbours. */
static float largest_key(mni_simplifier *s, uint32_t v) {
    const float *of = s->part.key;
    const mni_wheel *wheel = &s->judge.wheel;
    float key = of[v];
    uint32_t count;
    if (mni_judge_wheel(&s->judge, &s->surface, v)) {
        for (uint32_t i = 0; i < wheel->count; i++) {
            float next = of[wheel->next[i]], previous = of[wheel->previous[i]];
            next = next > previous ? next : previous;
            key = key > next ? key : next;
        }
        return key;
    }
    const uint32_t *fan = mni_surface_fan(&s->surface, v, &count);
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            uint32_t n = s->surface.simplex[fan[i]].v[c];
            if (n != MN_NONE && of[n] > key)
                key = of[n];
        }
    return key;
}

/* Whether r is one; makes it one, or lets it be one no more. */
static bool is_hub(mni_simplifier *s, uint32_t r) {
    mni_vertex *v = &s->surface.vertex[r];
    uint32_t count;
    if (!v->hub && v->fan.count <= MNI_HUB_FAN)
        return false;
    if (v->hub && mni_hubs_of(&s->hubs, r)->touched < mni_hubs_of(&s->hubs, r)->patience)
        return true;
    mni_surface_fan(&s->surface, r, &count);
    if (v->hub || count <= MNI_HUB_FAN)
        return v->hub &= count > MNI_HUB_FAN / 2;
    mni_hub *h = mni_hubs_add(&s->hubs, &s->surface, r);
    if (h == NULL) {
        s->judge.no_memory = true;
        return false;
    }
    h->touched = h->patience = count / MNI_HUB_PART;
    h->homes.credit = (uint64_t)MNI_HUB_CREDIT * count;
    if (s->part.key != NULL)
        h->key = largest_key(s, r);
    v->hub = true;
    s->surface.trios++;
    return true;
}

/* Puts it among a hub's choices if it is cheaper than one of them, or there is room. */
static void choose(mni_hub *h, mni_heap_key key) {
    uint32_t dearest = 0;
    for (uint32_t i = 0; i < h->choices; i++) {
        if (h->choice[i] == key)
            return;
        dearest = h->choice[i] > h->choice[dearest] ? i : dearest;
    }
    if (h->choices < MNI_HUB_CHOICES)
        h->choice[h->choices++] = key;
    else if (key < h->choice[dearest])
        h->choice[dearest] = key;
}

/* Looks at all that a hub is joined to. */
static void look_at_hub(mni_simplifier *s, mni_hub *h) {
    uint32_t count, r = h->vertex;
    const uint32_t *fan = mni_surface_fan(&s->surface, r, &count);
    h->touched = h->choices = 0;
    h->patience = count / MNI_HUB_PART;
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            uint32_t k = s->surface.simplex[fan[i]].v[c];
            if (k != r && k != MN_NONE)
                choose(h, key_of(s, r, k));
        }
}

/* The least of the choices that are there yet; NULL: none. */
static mni_heap_key *least_choice(mni_simplifier *s, mni_hub *h) {
    mni_heap_key *least = NULL;
    for (uint32_t i = 0; i < h->choices;) {
        uint32_t k = mni_heap_key_kept(h->choice[i]);
        if (!mni_surface_joined(&s->surface, h->vertex, k)) {
            h->choice[i] = h->choice[--h->choices];
            continue;
        }
        h->choice[i] = key_of(s, h->vertex, k);
        least = least == NULL || h->choice[i] < *least ? &h->choice[i] : least;
        i++;
    }
    return least;
}

/* Offers a hub's best choice, or lets it rest until enough has changed. */
static void offer_hub(mni_simplifier *s, uint32_t r) {
    mni_hub *h = mni_hubs_of(&s->hubs, r);
    mni_vertex *v = &s->surface.vertex[r];
    if (h->touched >= h->patience)
        look_at_hub(s, h);
    mni_heap_key *best = least_choice(s, h);
    v->stale = v->measured = false;
    v->tried = best == NULL;
    if (best == NULL) {
        mni_heap_remove(&s->heap, r);
        return;
    }
    v->floor = *best;
    mni_heap_set(&s->heap, r, *best);
}

/* Its choice is no good: the next one. */
static void offer_next_of_hub(mni_simplifier *s, uint32_t r) {
    mni_hub *h = mni_hubs_of(&s->hubs, r);
    mni_heap_key *tried = least_choice(s, h);
    if (tried != NULL)
        *tried = h->choice[--h->choices];
    offer_hub(s, r);
}

/* Something has changed around a hub: whether it is time to look at it again. */
static bool touch_hub(mni_simplifier *s, uint32_t v, uint32_t removed, uint32_t kept) {
    mni_hub *h = mni_hubs_of(&s->hubs, v);
    for (int i = 0; i < MNI_WITNESSES; i++)
        if (h->homes.at[i] == removed)
            h->homes.at[i] = kept;
    h->touched++;
    return h->touched >= h->patience || !s->surface.vertex[v].tried;
}

/* Offers r's cheapest candidate afresh. */
static void offer(mni_simplifier *s, uint32_t r) {
    mni_vertex *v = &s->surface.vertex[r];
    if (is_hub(s, r)) {
        offer_hub(s, r);
        return;
    }
    choice c = choose_offer(s, r, 0);
    if (next_of(s, r)->vertex == r)
        next_of(s, r)->vertex = MN_NONE;
    v->stale = v->measured = false;
    v->tried = c.best == MNI_HEAP_KEY_NONE || c.least < c.best;
    if (c.least < MNI_HEAP_KEY_NONE)
        v->floor = c.least;
    if (c.best < MNI_HEAP_KEY_NONE)
        mni_heap_set(&s->heap, r, c.best);
    else
        mni_heap_remove(&s->heap, r);
}

/* Nobody else has a candidate. Hubs around which something has changed look once more: once a
 * stage, for there might be little that comes of it, and much to look at; in the last one, until
 * nothing is left. */
static bool call_hubs(mni_simplifier *s) {
    for (uint32_t i = 0; i < s->hubs.room; i++) {
        mni_hub *h = &s->hubs.hub[i];
        if (h->vertex == MN_NONE || h->frozen || !s->surface.vertex[h->vertex].hub ||
            h->touched == 0 || (h->called && s->stage < 3))
            continue;
        h->called = true;
        h->touched = h->patience;
        offer(s, h->vertex);
    }
    return s->heap.count > 0;
}

/* Until its ring changes. */
static void withdraw(mni_simplifier *s, uint32_t r) {
    s->surface.vertex[r].tried = true;
    if (s->surface.vertex[r].hub)
        mni_hubs_of(&s->hubs, r)->choices = 0;
    mni_heap_remove(&s->heap, r);
}

/* r's candidate is no good: its next one. */
static void offer_next(mni_simplifier *s, uint32_t r) {
    if (s->surface.vertex[r].hub) {
        offer_next_of_hub(s, r);
        return;
    }
    mni_heap_key best = next_offer(s, r, mni_heap_key_of(&s->heap, r) + 1);
    s->surface.vertex[r].tried = true;
    if (best == MNI_HEAP_KEY_NONE)
        mni_heap_remove(&s->heap, r);
    else
        mni_heap_set(&s->heap, r, best);
}

/* k has come into r's ring, or become cheaper to reach. Returns the key of r → k. */
static mni_heap_key lower_floor(mni_simplifier *s, uint32_t r, uint32_t k) {
    mni_vertex *v = &s->surface.vertex[r];
    mni_heap_key key = key_of(s, r, k);
    v->floor = key < v->floor ? key : v->floor;
    return key;
}

/* Whether what r offers is the least of its candidates, as all were looked at, and is one still
 * when `removed` has left its ring. What others cost has only risen. */
static bool offers_least(const mni_simplifier *s, uint32_t r, uint32_t removed) {
    const mni_vertex *v = &s->surface.vertex[r];
    if ((v->stale | v->tried | v->measured | v->hub) || !mni_heap_has(&s->heap, r))
        return false;
    uint32_t kept = mni_heap_key_kept(mni_heap_key_of(&s->heap, r));
    return kept != removed && (s->hubs.taken == 0 || !s->surface.vertex[kept].hub);
}

/* r's ring has changed, `removed` having gone into k in it: whatever was tried may be tried again.
 */
static void touch(mni_simplifier *s, uint32_t r, uint32_t removed, uint32_t k) {
    mni_vertex *v = &s->surface.vertex[r];
    if (v->hub && !touch_hub(s, r, removed, k)) {
        lower_floor(s, r, k);
        return;
    }
    mni_heap_key floor = v->floor, key = lower_floor(s, r, k);
    if (offers_least(s, r, removed)) {
        if (key < mni_heap_key_of(&s->heap, r))
            mni_heap_set(&s->heap, r, key);
        return;
    }
    v->stale = true;
    if (key < floor || v->tried)
        mni_heap_set(&s->heap, r, v->floor);
    v->tried = false;
}

static bool allowed(mni_simplifier *s, uint32_t r, uint32_t k) {
    if (s->stage == 3)
        return true;
    mni_surface_fetch_list(&s->surface, k);
    mni_witness_fetch(&s->witness, &s->surface, r);
    mni_witness_fetch(&s->witness, &s->surface, k);
    return mni_judge_link(&s->judge, &s->surface, r, k) &&
           (s->stage == 2 || mni_judge_fold(&s->judge, &s->surface, r, k));
}

/* What r → k is worth when the error that it would make, measured on the surface, is looked at
 * too: MEASURED_SHARE of its square, weighted as the cost is. The ring is that of the legality
 * test.
 */
static mni_heap_key measured_key(mni_simplifier *s, uint32_t r, uint32_t k, mni_heap_key key) {
    const mni_vertex *vr = &s->surface.vertex[r], *vk = &s->surface.vertex[k];
    const mni_judge *j = &s->judge;
    const bool wheels = j->wheel_of == r && j->kept_of == k;
    const mni_about about = {.r = r,
                             .k = k,
                             .ring = j->around,
                             .ring_count = j->ring_count,
                             .of_r = wheels ? &j->wheel : NULL,
                             .of_k = wheels ? &j->kept : NULL};
    double error = (double)mni_witness_try(&s->witness, &s->surface, &about);
    float cost = (float)(MEASURED_SHARE * error * error * mni_collapse_weight(vr, vk));
    return cost > mni_heap_key_cost(key) ? mni_heap_key_make(cost, k) : key;
}

/* Whose collapses are not measured in advance. */
static bool is_pole(const mni_simplifier *s, uint32_t v) {
    return s->surface.vertex[v].fan.count > MEASURED_FAN_MAX || s->surface.vertex[v].hub;
}

/* r → k, legal and cheapest by its quadrics: is it so with what is measured? Otherwise r is put
 * back with the least key of its candidates: those that are cheaper by their quadrics are measured.
 */
static bool is_least(mni_simplifier *s, uint32_t r, mni_heap_key key) {
    uint32_t k = mni_heap_key_kept(key);
    mni_vertex *v = &s->surface.vertex[r];
    if (s->stage > 1 || s->desc.metric != MN_METRIC_QEM || s->desc.quadrics_alone ||
        v->fan.count > MEASURED_FAN_MAX)
        return true;
    mni_heap_key best = MNI_HEAP_KEY_NONE;
    if (v->measured) { /* some time ago: the surface may have changed around k */
        if (is_pole(s, k) || measured_key(s, r, k, key) == key)
            return true;
        key = best_candidate(s, r, 0);
    }
    for (mni_heap_key at = key; at < best;) {
        uint32_t to = mni_heap_key_kept(at);
        if ((at == key && !v->measured) || allowed(s, r, to)) {
            mni_heap_key measured = is_pole(s, to) ? at : measured_key(s, r, to, at);
            best = measured < best ? measured : best;
        }
        at = at < best ? best_candidate(s, r, at + 1) : best;
    }
    if (best == key && !v->measured)
        return true;
    v->measured = v->tried = true;
    mni_heap_set(&s->heap, r, best);
    return false;
}

/* ---- collapses ---- */

/* Hubs are told what their neighbours' keys have come to; where k is one itself it cannot ask who
 * its neighbours are, and tells all. */
static void tell_hubs(mni_simplifier *s, uint32_t k, float key) {
    uint32_t count;
    const uint32_t *fan;
    if (s->hubs.taken == 0)
        return;
    if (s->surface.vertex[k].hub) {
        for (uint32_t i = 0; i < s->hubs.room; i++)
            if (s->hubs.hub[i].vertex != MN_NONE && s->hubs.hub[i].key < key)
                s->hubs.hub[i].key = key;
        return;
    }
    fan = mni_surface_fan(&s->surface, k, &count);
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            uint32_t v = s->surface.simplex[fan[i]].v[c];
            if (v != MN_NONE && s->surface.vertex[v].hub && mni_hubs_of(&s->hubs, v)->key < key)
                mni_hubs_of(&s->hubs, v)->key = key;
        }
}

/* The collapse, and what it has waited for: its children and their neighbours, which must have come
 * before it. */
static void keep_key(mni_simplifier *s, uint32_t r, uint32_t k, float cost) {
    float *of = s->part.key, key = cost > of[r] ? cost : of[r];
    float around = s->surface.vertex[k].hub ? mni_hubs_of(&s->hubs, k)->key : largest_key(s, k);
    key = around > key ? around : key;
    for (uint32_t i = 0; i < s->judge.ring_count && s->surface.vertex[k].hub; i++)
        key = of[s->judge.around[i]] > key ? of[s->judge.around[i]] : key;
    s->made.key[s->made.count] = of[k] = key;
    tell_hubs(s, k, key);
}

mn_code mni_simplify_record(mni_simplifier *s, uint32_t r, uint32_t k, float cost) {
    if (s->made.key != NULL)
        keep_key(s, r, k, cost);
    uint32_t at = s->made.count++;
    mni_vertex *kept = &s->surface.vertex[k], *removed = &s->surface.vertex[r];
    s->made.left[at] = kept->node;
    s->made.right[at] = removed->node;
    s->made.value[kept->node] = kept->value; /* what it has risen to */
    s->made.value[removed->node] = removed->value;
    if (kept->hub)
        mni_witness_collapse_hub(&s->witness, &s->surface, s->judge.around, s->judge.ring_count, r,
                                 k, &mni_hubs_of(&s->hubs, k)->homes);
    else
        mni_witness_collapse(&s->witness, &s->surface, s->judge.around, s->judge.ring_count, r, k);
    kept->node = s->surface.vertices + at;
    removed->node = MN_NONE;
    s->counts.collapses_by_stage[s->stage - 1]++;
    if (s->stage == 1)
        s->legal_last = s->surface.vertices + at;
    if (s->witness.no_memory || s->judge.no_memory)
        return mn_fail(s->st, MN_FAILED, "out of memory while simplifying");
    if (s->desc.progress != NULL && at % PROGRESS_EVERY == 0 &&
        !s->desc.progress(s->desc.progress_context, "simplify", at, s->surface.vertices))
        return mn_fail(s->st, MN_FAILED, "interrupted");
    return MN_OK;
}

/* Are v's candidates known to be worth more than their quadrics say? The heap has its least then.
 */
static bool is_dearer(const mni_simplifier *s, uint32_t v) {
    return s->surface.vertex[v].measured && !s->surface.vertex[v].stale;
}

/* The least key of the legal edges at v, both ways; MNI_HEAP_KEY_NONE: none comes before `key` of
 * r.
 */
static mni_heap_key overtaken(mni_simplifier *s, uint32_t v, mni_heap_key key, uint32_t r) {
    mni_heap_key least = MNI_HEAP_KEY_NONE;
    uint32_t count;
    mni_surface_fan(&s->surface, v, &count);
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex x =
            s->surface.simplex[s->surface.pool[s->surface.vertex[v].fan.first + i]];
        for (int c = 0; c < 3; c++) {
            uint32_t w = x.v[c];
            if (w == v || w == MN_NONE)
                continue;
            mni_heap_key out = key_of(s, v, w), in = key_of(s, w, v);
            bool v_first = out < least && !is_dearer(s, v) && mni_heap_key_less(out, v, key, r);
            if (v_first && allowed(s, v, w))
                least = out;
            bool w_first = in < least && !s->surface.vertex[w].hub && !is_dearer(s, w) &&
                           mni_heap_key_less(in, w, key, r);
            if (w_first && allowed(s, w, v))
                least = in;
        }
    }
    return least;
}

/* order_violations, looked for at one collapse in ORDER_SAMPLE, or at all where they may be, and
 * not at poles: it tries every candidate of every vertex around, with the square of what their fans
 * are long. */
static void check_order(mni_simplifier *s, uint32_t r, mni_heap_key key) {
    mni_heap_key of_r = overtaken(s, r, key, r);
    mni_heap_key of_k = overtaken(s, mni_heap_key_kept(key), key, r);
    mni_heap_key least = of_r < of_k ? of_r : of_k;
    if (least == MNI_HEAP_KEY_NONE)
        return;
    float by = mni_heap_key_cost(key) / fmaxf(mni_heap_key_cost(least), MNI_WAIT_LEAST);
    by = by < FLT_MAX ? by : FLT_MAX;
    s->counts.order_violations++;
    if (by > s->counts.order_violation_worst)
        s->counts.order_violation_worst = by;
}

static bool order_is_checked(const mni_simplifier *s, uint32_t r, uint32_t k) {
    bool loose = s->part.closed != NULL && s->part.slack > 1;
    return (loose || s->made.count % ORDER_SAMPLE == 0) &&
           s->surface.vertex[r].fan.count <= ORDER_FAN_MAX &&
           s->surface.vertex[k].fan.count <= ORDER_FAN_MAX && !s->surface.vertex[k].hub;
}

/* Whether k, which has become another, looks at its candidates at once: all that it asks about has
 * just been read. Who has many waits until its turn shows that they matter. */
static bool looks_at_once(const mni_vertex *k) {
    return !k->hub && k->fan.count <= MNI_WHEEL_MAX;
}

/* k has become another, and perhaps a hub, which rests at first: or one that goes from neighbour to
 * neighbour would move all of its simplices each time. */
static void wake_kept(mni_simplifier *s, uint32_t k) {
    mni_vertex *v = &s->surface.vertex[k];
    if (looks_at_once(v)) {
        offer(s, k);
        return;
    }
    if (v->hub) {
        if (!touch_hub(s, k, MN_NONE, MN_NONE))
            return;
    } else if (is_hub(s, k)) {
        mni_hubs_of(&s->hubs, k)->touched = 1;
        v->tried = true;
        mni_heap_remove(&s->heap, k);
        return;
    }
    v->stale = true; /* and perhaps without a candidate: its turn will show */
    v->tried = false;
    mni_heap_set(&s->heap, k, v->floor);
}

static bool is_joined_to_hub(mni_simplifier *s, uint32_t v) {
    uint32_t count;
    const uint32_t *fan = mni_surface_fan(&s->surface, v, &count);
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            uint32_t n = s->surface.simplex[fan[i]].v[c];
            if (n != MN_NONE && s->surface.vertex[n].hub)
                return true;
        }
    return false;
}

/* What is known of the order of r → k, which is about to be made: by which factor it may cost more
 * than a legal one beside it; or nothing, since hubs rest, or their other neighbours are not here.
 */
static void count_order(mni_simplifier *s, uint32_t r, uint32_t k, mni_heap_key key) {
    const mni_vertex *vertex = s->surface.vertex;
    double ratio = mni_wait_count(&s->part, r, k, key);
    if (vertex[k].hub && key_of(s, r, k) > key)
        ratio = fmax(ratio, 1) * mni_heap_key_cost(key_of(s, r, k)) / mni_heap_key_cost(key);
    if (ratio >= 1 && ratio > s->counts.order_violation_bound)
        s->counts.order_violation_bound = (float)fmin(ratio * (1 + DBL_EPSILON), FLT_MAX);
    bool at_hub = s->part.carries && (is_joined_to_hub(s, r) || is_joined_to_hub(s, k));
    s->counts.order_unknown += at_hub || vertex[r].hub;
}

static mn_code collapse(mni_simplifier *s, uint32_t r, uint32_t k) {
    mni_judge *j = &s->judge;
    mni_vertex *vertex = s->surface.vertex;
    bool checked = order_is_checked(s, r, k);
    mni_heap_key key = mni_heap_key_of(&s->heap, r);
    mni_witness_fetch_more(&s->witness, &s->surface, r);
    mni_witness_fetch_more(&s->witness, &s->surface, k);
    if (checked)
        check_order(s, r, key);
    if (checked || s->stage == 3) /* otherwise the ring is still that of the legality test */
        mni_judge_look(j, &s->surface, r, k);
    if (s->part.closed != NULL || s->hubs.taken > 0)
        count_order(s, r, k, key);
    if (!(j->round ? mni_surface_collapse_round(&s->surface, &j->wheel, r, k, s->made.count)
                   : mni_surface_collapse(&s->surface, r, k, s->made.count)))
        return mn_fail(s->st, MN_FAILED, "out of memory while simplifying");
    mni_judge_forget(j);
    s->look.vertex = MN_NONE;
    mni_heap_remove(&s->heap, r);
    if (s->desc.metric == MN_METRIC_QEM) {
        mni_quadric_add(&vertex[k], &vertex[r]);
        float floor = mni_heap_key_cost(vertex[k].floor) * FLOOR_MARGIN;
        vertex[k].floor = mni_heap_key_make(floor, mni_heap_key_kept(vertex[k].floor));
    }
    const bool looks = looks_at_once(&vertex[k]);
    for (uint32_t i = 0; i < j->ring_count; i++) {
        uint32_t n = j->around[i];
        if (n != k) {
            touch(s, n, r, k);
            if (!looks)
                lower_floor(s, k, n);
            if (s->part.closed != NULL) {
                mni_wait_meet(&s->part, n, k);
                mni_wait_meet(&s->part, k, n);
            }
        }
    }
    vertex[r].hub = false;
    wake_kept(s, k);
    if (s->heap.count > 0)
        mni_surface_fetch_neighbours(&s->surface, mni_heap_top(&s->heap));
    return mni_simplify_record(s, r, k, mni_heap_key_cost(key));
}

/* The collapses are all over the mesh, so whatever comes to the top has to be fetched. While one is
 * made the next ones' data are on their way. */
static void look_ahead(const mni_simplifier *s) {
    const mni_surface *surface = &s->surface;
    const mni_heap *heap = &s->heap;
    if (heap->count < MNI_HEAP_FORECAST)
        return;
    uint32_t second = mni_heap_second(heap);
    for (uint32_t i = 0; i < 4; i++) {
        mni_surface_fetch_vertex(surface, heap->item[mni_heap_below(second) + i].vertex);
        mni_surface_fetch_list(surface, heap->item[mni_heap_below(0) + i].vertex);
    }
    mni_surface_fetch_simplices(surface, heap->item[second].vertex);
    mni_surface_fetch_vertex(surface, mni_heap_key_kept(heap->item[second].key));
}

/* Whether r → k may be legal, though an end may be at the border. All is asked of r's own ring and
 * of edges between that and k, so what is found against it is against it, whatever else there is.
 * Of an r at the border only triangles that fold are known. */
static bool may_be_allowed(mni_simplifier *s, uint32_t r, uint32_t k) {
    if (s->part.closed[r] > 0)
        return allowed(s, r, k);
    if (s->stage > 1)
        return true;
    mni_judge_look(&s->judge, &s->surface, r, k);
    return mni_judge_fold(&s->judge, &s->surface, r, k);
}

/* Whether r → k, the least that is left, is not to be made: then it may hold up others. */
static bool put_off(mni_simplifier *s, uint32_t r, uint32_t k, mni_heap_key key) {
    const mni_heap_key *closed = s->part.closed;
    if (closed == NULL)
        return false;
    bool unseen = closed[k] > 0 && s->surface.vertex[k].hub && !mni_freeze_sees(s, r, k);
    if (!unseen && !mni_wait_closed(&s->part, r, k, key))
        return false;
    if (mni_wait_would_close(&s->part, r, k, key) && may_be_allowed(s, r, k))
        mni_wait_close(s, r, k, key);
    return true;
}

/* Whether r → k costs more by now than its key says. What goes into a hub makes all that goes there
 * dearer: a part of that is let pass, or each would wait for all the others to be put back. */
static bool has_risen(const mni_simplifier *s, uint32_t r, uint32_t k, mni_heap_key key) {
    mni_heap_key now = key_of(s, r, k);
    return now > key && (!s->surface.vertex[k].hub ||
                         mni_heap_key_cost(now) > HUB_RISE * mni_heap_key_cost(key));
}

/* By which factor v's cheapest that waits costs more than what it waits for; INFINITY: none does.
 */
static double waits_by(mni_simplifier *s, uint32_t v) {
    double least = INFINITY;
    uint32_t count;
    mni_surface_fan(&s->surface, v, &count);
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex x =
            s->surface.simplex[s->surface.pool[s->surface.vertex[v].fan.first + i]];
        for (int c = 0; c < 3; c++) {
            uint32_t k = x.v[c];
            if (k == v || k == MN_NONE || s->part.closed[k] == 0)
                continue;
            mni_heap_key key = key_of(s, v, k);
            double ratio = mni_wait_ratio(&s->part, v, k, key);
            if (mni_wait_closed(&s->part, v, k, key) && ratio < least && allowed(s, v, k))
                least = ratio;
        }
    }
    return least;
}

void mni_simplify_count_waiting(mni_simplifier *s) {
    for (uint32_t v = 0; v < s->surface.vertices; v++) {
        const mni_vertex *of = &s->surface.vertex[v];
        double ratio =
            of->node != MN_NONE && s->part.closed[v] > 0 && !of->hub ? waits_by(s, v) : INFINITY;
        if (ratio < INFINITY)
            s->part.could_go[mni_wait_level(ratio)]++;
    }
}

static mn_code no_memory(const mni_simplifier *s) {
    return mn_fail(s->st, MN_FAILED, "out of memory while simplifying");
}

/* A turn may take a hub's whole fan, so it is time that counts, not turns. */
static bool go_on(mni_simplifier *s) {
    double now = mni_now_s();
    if (s->poll.go_on == NULL || now - s->polled_s < POLL_S)
        return true;
    s->polled_s = now;
    return s->poll.go_on(s->poll.context);
}

static void begin(mni_simplifier *s, int stage) {
    s->stage = stage;
    for (uint32_t i = 0; i < s->hubs.room; i++) {
        mni_hub *h = &s->hubs.hub[i];
        if (h->vertex == MN_NONE)
            continue;
        h->touched = h->frozen ? 0 : h->patience;
        h->called = false;
    }
    for (uint32_t v = 0; v < s->surface.vertices; v++)
        if (s->surface.vertex[v].node != MN_NONE)
            offer(s, v);
}

mn_code mni_simplify_stage(mni_simplifier *s, int stage) {
    begin(s, stage);
    for (;; s->turns++) {
        uint32_t r = mni_heap_top(&s->heap);
        if (r == UINT32_MAX && call_hubs(s))
            continue;
        if (r == UINT32_MAX) {
            MN_ASSERT_SLOW(s->part.closed == NULL || mni_wait_rings_hold(s));
            return s->judge.no_memory ? no_memory(s) : MN_OK;
        }
        if (s->turns % POLL_EVERY == 0 && !go_on(s))
            return mn_fail(s->st, MN_FAILED, "interrupted");
        if (s->desc.stop_triangles > 0 && s->surface.alive_triangles <= s->desc.stop_triangles) {
            s->stopped = true;
            return MN_OK;
        }
        mni_heap_key key = mni_heap_key_of(&s->heap, r);
        uint32_t k = mni_heap_key_kept(key);
        look_ahead(s);
        if (s->surface.vertex[r].stale || has_risen(s, r, k, key)) {
            offer(s, r);
        } else if (put_off(s, r, k, key)) {
            if (s->surface.vertex[r].measured) /* its others are no cheaper: off with them all */
                withdraw(s, r);
            else
                offer_next(s, r);
        } else if (!allowed(s, r, k)) {
            if (s->judge.stuck)
                withdraw(s, r);
            else if (s->surface.vertex[r].measured)
                offer(s, r);
            else
                offer_next(s, r);
        } else if (is_least(s, r, key)) {
            mn_code code = collapse(s, r, k);
            if (code != MN_OK)
                return code;
        }
    }
}
