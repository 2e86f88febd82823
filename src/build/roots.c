/* Stage 4: the roots of the components become one tree, by virtual edges between nearest roots.
 *
 * The shortest distance between any two roots goes first (ties by vertex numbers, kept then
 * removed). Each root knows its nearest other root; a heap holds these, and a root whose nearest
 * has gone looks for another when it comes to the top: distances to what is left only rise.
 *
 * Hidden here: how the nearest is found. Boxes in a binary tree over the roots, cut at the median
 * of the widest side, so that lines, sheets and clusters far apart cost no more than roots spread
 * evenly, as a grid of equal cells would:
 *
 *              box 1
 *             /     \             box i has the children 2i and 2i + 1
 *         box 2     box 3         leaves hold 4 to 8 roots
 *         /   \     /   \
 *
 * A box holds its roots' bounds and their least number: with many roots in one place the least is
 * found without looking at all of them. A root that goes is taken out, and the boxes above shrink.
 *
 * The work is n log n. Paper: §2.1.1 (virtual edges; there the neighbours come from a Voronoi
 * diagram). One thread; memory: 4 bytes a vertex, 4 to 18 more a root. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "simplify.h"

enum {
    BUCKET_MAX = 8,
    LEVELS_MAX = 32, /* of fewer than 2^32 roots */
};

typedef struct box {
    float low[3], high[3];
    uint32_t least; /* the least root inside; MN_NONE: empty */
} box;

typedef struct root_boxes {
    const mni_vertex *vertex;
    uint32_t *root;   /* vertices, sorted into buckets; MN_NONE: gone */
    uint32_t *bucket; /* a root: which */
    uint32_t count;
    uint32_t buckets; /* a power of two; bucket b has box buckets + b */
    box *boxes;
} root_boxes;

static uint32_t bucket_start(const root_boxes *g, uint64_t b) {
    return (uint32_t)(b * g->count / g->buckets);
}

static const box nothing = {
    {INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, MN_NONE};

static void widen(box *b, const float *low, const float *high, uint32_t least) {
    for (int i = 0; i < 3; i++) {
        b->low[i] = low[i] < b->low[i] ? low[i] : b->low[i];
        b->high[i] = high[i] > b->high[i] ? high[i] : b->high[i];
    }
    b->least = least < b->least ? least : b->least;
}

/* The bounds of root[from … to). */
static box bounds_of(const root_boxes *g, uint32_t from, uint32_t to) {
    box b = nothing;
    for (uint32_t i = from; i < to; i++)
        if (g->root[i] != MN_NONE) {
            const float *p = g->vertex[g->root[i]].p;
            widen(&b, p, p, g->root[i]);
        }
    return b;
}

/* Box i from what is below it. */
static void fit(root_boxes *g, uint32_t i) {
    if (i >= g->buckets) {
        uint32_t b = i - g->buckets;
        g->boxes[i] = bounds_of(g, bucket_start(g, b), bucket_start(g, (uint64_t)b + 1));
        return;
    }
    const box *left = &g->boxes[2 * i], *right = &g->boxes[2 * i + 1];
    box b = *left;
    widen(&b, right->low, right->high, right->least);
    g->boxes[i] = b;
}

static bool before(const root_boxes *g, int side, uint32_t a, uint32_t b) {
    float x = g->vertex[a].p[side], y = g->vertex[b].p[side];
    return x != y ? x < y : a < b; /* never equal: halves come out as large as asked for */
}

/* Hoare's selection: root[from … middle) come before root[middle … to) along that side. */
static void part(root_boxes *g, int side, uint32_t from, uint32_t middle, uint32_t to) {
    uint32_t *root = g->root;
    while (to - from > 1) {
        uint32_t low = from, high = to - 1,
                 pivot = root[low + (high - low) / 2]; /* never the last */
        for (;;) {
            while (before(g, side, root[low], pivot))
                low++;
            while (before(g, side, pivot, root[high]))
                high--;
            if (low >= high)
                break;
            uint32_t swapped = root[low];
            root[low++] = root[high];
            root[high--] = swapped;
        }
        uint32_t cut = high + 1; /* root[from … cut) ≤ pivot ≤ root[cut … to) */
        if (middle == cut)
            return;
        if (middle < cut)
            to = cut;
        else
            from = cut;
    }
}

/* Sorts the roots into buckets, level by level from the top, and fits the boxes. */
static void lay(root_boxes *g) {
    for (uint32_t row = 1; row < g->buckets; row *= 2)
        for (uint32_t i = 0; i < row; i++) {
            uint64_t span = g->buckets / row, first = i * span;
            uint32_t from = bucket_start(g, first), to = bucket_start(g, first + span);
            box b = bounds_of(g, from, to);
            int widest = 0;
            for (int side = 1; side < 3; side++)
                if (b.high[side] - b.low[side] > b.high[widest] - b.low[widest])
                    widest = side;
            part(g, widest, from, bucket_start(g, first + span / 2), to);
        }
    for (uint32_t b = 0; b < g->buckets; b++)
        for (uint32_t i = bucket_start(g, b); i < bucket_start(g, (uint64_t)b + 1); i++)
            g->bucket[g->root[i]] = b;
    for (uint32_t i = 2 * g->buckets; i-- > 1;)
        fit(g, i);
}

static void take_out(root_boxes *g, uint32_t v) {
    uint32_t b = g->bucket[v], i = bucket_start(g, b);
    while (g->root[i] != v)
        i++;
    g->root[i] = MN_NONE;
    for (uint32_t up = g->buckets + b; up > 0; up /= 2)
        fit(g, up);
}

/* From p to the nearest place of a box; rounded as the distance to a root is, so that no root
 * inside is nearer. */
static float distance2(const float *p, const float *low, const float *high) {
    float sum = 0;
    for (int i = 0; i < 3; i++) {
        float d = p[i] < low[i] ? low[i] - p[i] : p[i] > high[i] ? p[i] - high[i] : 0;
        sum += d * d;
    }
    return sum;
}

/* What a box may hold at best, as a key. */
static mni_heap_key promise(const root_boxes *g, uint32_t i, const float *p) {
    const box *b = &g->boxes[i];
    if (b->least == MN_NONE)
        return MNI_HEAP_KEY_NONE;
    return mni_heap_key_make(distance2(p, b->low, b->high), b->least);
}

/* r's nearest other root. */
static mni_heap_key nearest(const root_boxes *g, uint32_t r) {
    const float *p = g->vertex[r].p;
    mni_heap_key best = MNI_HEAP_KEY_NONE;
    struct {
        mni_heap_key key;
        uint32_t at;
    } stack[LEVELS_MAX + 1];
    uint32_t depth = 0;
    stack[depth].key = promise(g, 1, p);
    stack[depth++].at = 1;
    while (depth > 0) {
        mni_heap_key key = stack[--depth].key;
        uint32_t at = stack[depth].at;
        if (key >= best)
            continue;
        if (at < g->buckets) { /* the better half on top */
            mni_heap_key left = promise(g, 2 * at, p), right = promise(g, 2 * at + 1, p);
            bool left_first = left < right;
            MN_ASSERT(depth + 2 <= LEVELS_MAX + 1);
            stack[depth].key = left_first ? right : left;
            stack[depth++].at = 2 * at + left_first;
            stack[depth].key = left_first ? left : right;
            stack[depth++].at = 2 * at + !left_first;
            continue;
        }
        uint32_t b = at - g->buckets, end = bucket_start(g, (uint64_t)b + 1);
        for (uint32_t i = bucket_start(g, b); i < end; i++) {
            uint32_t v = g->root[i];
            if (v == MN_NONE || v == r)
                continue;
            const float *q = g->vertex[v].p;
            mni_heap_key found = mni_heap_key_make(distance2(p, q, q), v);
            best = found < best ? found : best;
        }
    }
    return best;
}

static mn_code join(mni_simplifier *s, root_boxes *g, uint32_t least) {
    for (uint32_t v = 0; v < s->surface.vertices; v++)
        if (s->surface.vertex[v].node != MN_NONE)
            mni_heap_set(&s->heap, v, nearest(g, v));
    for (uint32_t left = g->count; left > least;) {
        uint32_t r = mni_heap_top(&s->heap);
        uint32_t k = mni_heap_key_kept(mni_heap_key_of(&s->heap, r));
        if (s->surface.vertex[k].node == MN_NONE) { /* its nearest has gone: find another */
            mni_heap_set(&s->heap, r, nearest(g, r));
            continue;
        }
        float cost = mni_heap_key_cost(mni_heap_key_of(&s->heap, r));
        mni_heap_remove(&s->heap, r);
        take_out(g, r);
        left--;
        mn_code code = mni_simplify_record(s, r, k, cost);
        if (code != MN_OK)
            return code;
    }
    return MN_OK;
}

mn_code mni_simplify_roots(mni_simplifier *s, uint32_t least) {
    uint32_t roots = s->surface.vertices - s->made.count;
    s->stage = 4;
    s->judge.ring_count = 0; /* virtual edges have no ring */
    if (roots <= least)
        return MN_OK;
    root_boxes g = {.vertex = s->surface.vertex,
                    .root = malloc(roots * sizeof *g.root),
                    .bucket = malloc((size_t)s->surface.vertices * sizeof *g.bucket),
                    .buckets = 1};
    while (roots / g.buckets >= BUCKET_MAX)
        g.buckets *= 2;
    g.boxes = malloc(2 * (size_t)g.buckets * sizeof *g.boxes);
    mn_code code = MN_OK;
    if (g.root == NULL || g.bucket == NULL || g.boxes == NULL) {
        code = mn_fail(s->st, MN_FAILED, "out of memory while joining %u components", roots);
    } else {
        for (uint32_t v = 0; v < s->surface.vertices; v++)
            if (s->surface.vertex[v].node != MN_NONE)
                g.root[g.count++] = v;
        MN_ASSERT(g.count == roots);
        lay(&g);
        code = join(s, &g, least);
    }
    free(g.root);
    free(g.bucket);
    free(g.boxes);
    return code;
}
