/* See witness.h. Hidden here: which points are witnesses (of too many, thin.c).
 *
 * All coordinates of a measurement are relative to k, where the star's triangles meet. Which of
 * the points are nearest cannot be predicted, so nothing here branches on it. */
#include "witness.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mem.h"
#include "mn_assert.h"
#include "star.h"
#include "thin.h"

enum { LEAF_TRIANGLES_MAX = 24 };
_Static_assert(2 * (1 + LEAF_TRIANGLES_MAX) <= MNI_POINTS, "two leaves fit");
_Static_assert((int)MNI_WITNESSES == (int)MNI_LANES, "a set is one row of lanes");
_Static_assert((int)MNI_WITNESSES == (int)MNI_THIN_LEFT, "a set is what thinning leaves");
_Static_assert(1 + LEAF_TRIANGLES_MAX + MNI_WITNESSES <= MNI_POINTS, "a leaf and a node fit");

/* The scratch of one collapse. */
typedef struct mni_bench {
    mni_star star;
    mni_points witness; /* and behind them middles */
    mni_points more;    /* middles for which there was no room */
    uint32_t witnesses; /* points of `witness` that are no middles */
    uint32_t next;      /* of the ring, the first without a middle there */
    float slack[MNI_POINTS];
    uint32_t neighbour[MNI_POINTS]; /* of a middle: the ring vertex that it leads to */
    uint32_t home[MNI_POINTS];      /* of a witness, where k is a hub */
    mni_points one;
    mni_thin *thin;
} mni_bench;

/* Chosen by trial on armadillo and nefertiti, and the first raised since collapses are chosen by
 * what is measured here: who is chosen for a small sample has more behind it. docs/design.md has
 * what `metanode bench error` says. */
#define SAMPLE_FACTOR 1.6f
#define NEIGHBOUR_FACTOR 2.0f

mn_code mni_witness_room(mni_witness_book *book, uint32_t vertices, uint32_t sets, uint32_t points,
                         mn_status *st) {
    *book = (mni_witness_book){.sets_room = sets};
    book->sets = mni_mem_take(((size_t)sets + 1) * sizeof *book->sets, 0);
    book->own_start = mni_mem_take_zeroed(((size_t)vertices + 1) * sizeof *book->own_start);
    book->own = mni_mem_take(((size_t)points + 1) * sizeof *book->own, points * sizeof *book->own);
    book->bench = mni_mem_take_zeroed(sizeof *book->bench);
    if (book->sets == NULL || book->bench == NULL || book->own_start == NULL || book->own == NULL) {
        mni_witness_close(book);
        return mn_fail(st, MN_FAILED, "out of memory while simplifying %u vertices", vertices);
    }
    mni_star_open(&book->bench->star);
    book->bench->thin = mni_thin_best();
    return MN_OK;
}

mn_code mni_witness_open(mni_witness_book *book, const mni_surface *s, mn_status *st) {
    mn_code code = mni_witness_room(book, s->vertices, s->vertices / 2, s->triangles, st);
    if (code == MN_OK)
        mni_witness_fill(book, s);
    return code;
}

void mni_witness_fill(mni_witness_book *book, const mni_surface *s) {
    for (uint32_t t = 0; t < s->triangles; t++)
        book->own_start[s->simplex[t].v[0]]++;
    for (uint32_t v = 0; v < s->vertices; v++)
        book->own_start[v + 1] += book->own_start[v];
    for (uint32_t t = s->triangles; t-- > 0;) {
        const uint32_t *c = s->simplex[t].v;
        const float *p = s->vertex[c[0]].p, *a = s->vertex[c[1]].p, *b = s->vertex[c[2]].p;
        float *centre = book->own[--book->own_start[c[0]]];
        for (int x = 0; x < 3; x++)
            centre[x] = (p[x] + a[x] + b[x]) / 3;
    }
}

void mni_witness_close(mni_witness_book *book) {
    if (book->bench != NULL)
        mni_star_close(&book->bench->star);
    mni_mem_give(book->bench);
    mni_mem_give(book->sets);
    mni_mem_give(book->own_start);
    mni_mem_give(book->own);
    memset(book, 0, sizeof *book);
}

/* ---- taking the witnesses of both ---- */

static void add_leaf_point(mni_bench *b, const float *k, const float *p) {
    uint32_t n = b->witness.count++;
    b->witness.x[n] = p[0] - k[0];
    b->witness.y[n] = p[1] - k[1];
    b->witness.z[n] = p[2] - k[2];
    b->slack[n] = 0;
}

static void gather_leaf(mni_witness_book *book, const mni_vertex *vertex, uint32_t v,
                        const float *k) {
    add_leaf_point(book->bench, k, vertex[v].p);
    uint32_t start = book->own_start[v], end = book->own_start[v + 1];
    if (end - start > LEAF_TRIANGLES_MAX)
        end = start + LEAF_TRIANGLES_MAX;
    for (uint32_t i = start; i < end; i++)
        add_leaf_point(book->bench, k, book->own[i]);
}

static void gather(mni_witness_book *book, const mni_vertex *vertex, uint32_t v, const float *k) {
    mni_bench *b = book->bench;
    if (vertex[v].set == MN_NONE) {
        gather_leaf(book, vertex, v, k);
        return;
    }
    const mni_witnesses *set = &book->sets[vertex[v].set];
    uint32_t n = b->witness.count, count = 0;
    for (uint32_t i = 0; i < MNI_WITNESSES; i++) { /* those that are not there are overwritten */
        b->witness.x[n + i] = set->x[i] - k[0];
        b->witness.y[n + i] = set->y[i] - k[1];
        b->witness.z[n + i] = set->z[i] - k[2];
        b->slack[n + i] = set->slack[i];
        count += set->slack[i] >= 0;
    }
    b->witness.count += count;
}

static void thin(mni_bench *b) {
    b->thin(&(mni_thin_set){&b->witness, b->slack, b->home});
}

/* What is left is k's set. */
static void keep(mni_witness_book *book, const mni_vertex *r, mni_vertex *k) {
    const mni_bench *b = book->bench;
    if (k->set == MN_NONE)
        k->set = r->set != MN_NONE ? r->set : book->sets_count++;
    MN_ASSERT(b->witness.count <= MNI_WITNESSES && book->sets_count <= book->sets_room);
    mni_witnesses *set = &book->sets[k->set];
    for (uint32_t i = 0; i < MNI_WITNESSES; i++) {
        set->x[i] = b->witness.x[i] + k->p[0];
        set->y[i] = b->witness.y[i] + k->p[1];
        set->z[i] = b->witness.z[i] + k->p[2];
        set->slack[i] = i < b->witness.count ? b->slack[i] : -1;
    }
}

/* ---- a collapse ---- */

static inline float max_of(float a, float b) {
    return a > b ? a : b;
}

/* Adds the middles of the edges r–n to the points, from ring[from] on, while there is room. Returns
 * where to go on. */
static uint32_t add_middles(mni_bench *b, mni_points *points, const mni_vertex *vertex,
                            const uint32_t *ring, uint32_t from, uint32_t ring_count, uint32_t r,
                            uint32_t k) {
    const float *at_k = vertex[k].p, *at_r = vertex[r].p;
    for (; from < ring_count && points->count < MNI_POINTS; from++) {
        if (ring[from] == k)
            continue;
        const float *at_n = vertex[ring[from]].p;
        uint32_t n = points->count++;
        b->neighbour[n] = ring[from];
        points->x[n] = 0.5f * (at_n[0] + at_r[0]) - at_k[0];
        points->y[n] = 0.5f * (at_n[1] + at_r[1]) - at_k[1];
        points->z[n] = 0.5f * (at_n[2] + at_r[2]) - at_k[2];
    }
    return from;
}

/* Raises the values of the neighbours that points[first …) lead to. Returns the largest distance.
 */
static float raise_neighbours(const mni_bench *b, const mni_points *points, uint32_t first,
                              mni_vertex *vertex) {
    float largest = 0;
    for (uint32_t i = first; i < points->count; i++) {
        mni_vertex *v = &vertex[b->neighbour[i]];
        largest = max_of(largest, points->distance[i]);
        if (v->set != MN_NONE)
            v->value = max_of(v->value, NEIGHBOUR_FACTOR * points->distance[i]);
    }
    return largest;
}

/* Witnesses of both and middles of the edges of r's ring, measured in one go: rows of lanes come
 * out fuller. The star has been taken. Returns where the ring is to go on. */
static uint32_t measure_points(mni_witness_book *book, const mni_vertex *vertex,
                               const uint32_t *ring, uint32_t ring_count, uint32_t r, uint32_t k) {
    mni_bench *b = book->bench;
    b->witness.count = 0;
    gather(book, vertex, k, vertex[k].p);
    gather(book, vertex, r, vertex[k].p);
    b->witnesses = b->witness.count;
    uint32_t next = add_middles(b, &b->witness, vertex, ring, 0, ring_count, r, k);
    mni_star_measure(&b->star, &b->witness);
    return next;
}

static float largest_of_witnesses(const mni_bench *b) {
    float largest = 0;
    for (uint32_t i = 0; i < b->witnesses; i++)
        largest = max_of(largest, b->witness.distance[i] + b->slack[i]);
    return largest;
}

float mni_witness_try(mni_witness_book *book, mni_surface *s, const mni_about *a) {
    mni_bench *b = book->bench;
    const uint32_t r = a->r, k = a->k;
    book->tried_r = book->tried_k = MN_NONE;
    bool taken = a->of_r != NULL ? mni_star_take_of_wheels(&b->star, s, a->of_r, a->of_k, r, k)
                                 : mni_star_take_of_both(&b->star, s, r, k);
    if (!taken) {
        book->no_memory = true;
        return 0;
    }
    b->next = measure_points(book, s->vertex, a->ring, a->ring_count, r, k);
    float largest = largest_of_witnesses(b);
    for (uint32_t i = b->witnesses; i < b->witness.count; i++)
        largest = max_of(largest, b->witness.distance[i]);
    book->tried_r = r;
    book->tried_k = k;
    return SAMPLE_FACTOR * largest;
}

void mni_witness_collapse(mni_witness_book *book, mni_surface *s, const uint32_t *ring,
                          uint32_t ring_count, uint32_t r, uint32_t k) {
    mni_bench *b = book->bench;
    mni_vertex *vertex = s->vertex;
    if (book->tried_r != r || book->tried_k != k) {
        if (!mni_star_take(&b->star, s, k)) {
            book->no_memory = true;
            return;
        }
        b->next = measure_points(book, vertex, ring, ring_count, r, k);
    }
    book->tried_r = book->tried_k = MN_NONE;
    uint32_t next = b->next;
    float value = max_of(vertex[k].value, vertex[r].value);
    value = max_of(value, SAMPLE_FACTOR * largest_of_witnesses(b));
    float largest = raise_neighbours(b, &b->witness, b->witnesses, vertex);
    b->witness.count = b->witnesses;
    while (next < ring_count) { /* a pole's, or an edge's with many faces */
        b->more.count = 0;
        next = add_middles(b, &b->more, vertex, ring, next, ring_count, r, k);
        mni_star_measure(&b->star, &b->more);
        largest = max_of(largest, raise_neighbours(b, &b->more, 0, vertex));
    }
    vertex[k].value = max_of(value, SAMPLE_FACTOR * largest);
    thin(b);
    keep(book, &vertex[r], &vertex[k]);
}

/* ---- a hub ---- */

static inline float length2(float x, float y, float z) {
    return x * x + y * y + z * z;
}

/* The neighbour of k to which the edge comes nearest to point i; of all, or of some here and there.
 */
static uint32_t nearest_spoke(mni_surface *s, const mni_points *points, uint32_t i, uint32_t k,
                              bool of_all) {
    enum { SOME = 256 };
    uint32_t count = s->vertex[k].fan.count, nearest = MN_NONE;
    const uint32_t *fan = of_all ? mni_surface_fan(s, k, &count) : &s->pool[s->vertex[k].fan.first];
    const uint32_t looks = of_all || count < SOME ? count : SOME;
    const float *at_k = s->vertex[k].p;
    float px = points->x[i], py = points->y[i], pz = points->z[i], least = INFINITY;
    for (uint32_t look = 0; look < looks; look++) {
        const mni_simplex *x = &s->simplex[fan[(uint64_t)look * count / looks]];
        if (x->v[2] == MN_NONE || x->killed != MN_NONE)
            continue;
        mni_corner c = mni_simplex_corner(x, k);
        uint32_t n = s->vertex[c.next].hub ? c.previous : c.next;
        const float *at_n = s->vertex[n].p;
        float ex = at_n[0] - at_k[0], ey = at_n[1] - at_k[1], ez = at_n[2] - at_k[2];
        float ee = length2(ex, ey, ez), along = ee > 0 ? (px * ex + py * ey + pz * ez) / ee : 0;
        along = along < 0 ? 0 : along > 1 ? 1 : along;
        float apart = length2(px - along * ex, py - along * ey, pz - along * ez);
        if (apart < least) {
            least = apart;
            nearest = n;
        }
    }
    return nearest;
}

/* From point i to k's triangles at n; INFINITY: there is none, or no memory. */
static float measure_spoke(mni_witness_book *book, mni_surface *s, const mni_points *points,
                           uint32_t i, uint32_t k, uint32_t n, uint32_t ends[2]) {
    mni_bench *b = book->bench;
    if (!mni_star_take_spoke(&b->star, s, k, n, ends)) {
        book->no_memory = true;
        return INFINITY;
    }
    if (b->star.count == 0)
        return INFINITY;
    b->one.count = 1;
    b->one.x[0] = points->x[i];
    b->one.y[0] = points->y[i];
    b->one.z[0] = points->z[i];
    mni_star_measure(&b->star, &b->one);
    return b->one.distance[0];
}

/* Round k from *home on, as long as it becomes nearer. Without a home to begin with, k itself is
 * what is known to be there. */
static float measure_from(mni_witness_book *book, mni_surface *s, const mni_points *points,
                          uint32_t i, uint32_t k, uint32_t *home, uint64_t *credit) {
    enum { STEPS_MAX = 32 };
    uint32_t ends[2], further[2];
    float best = *home == MN_NONE ? INFINITY : measure_spoke(book, s, points, i, k, *home, ends);
    if (best == INFINITY) {
        bool of_all = *credit >= s->vertex[k].fan.count;
        *credit -= of_all ? s->vertex[k].fan.count : 0;
        *home = nearest_spoke(s, points, i, k, of_all);
        if (*home != MN_NONE)
            best = measure_spoke(book, s, points, i, k, *home, ends);
    }
    if (best == INFINITY) {
        *home = MN_NONE;
        return sqrtf(length2(points->x[i], points->y[i], points->z[i]));
    }
    for (int step = 0, nearer = 1; step < STEPS_MAX && nearer && best > 0; step++) {
        uint32_t way[2] = {ends[0], ends[1]};
        nearer = 0;
        for (int e = 0; e < 2; e++) {
            float there = way[e] == MN_NONE ? INFINITY
                                            : measure_spoke(book, s, points, i, k, way[e], further);
            if (there < best) {
                best = there;
                *home = way[e];
                memcpy(ends, further, sizeof ends);
                nearer = 1;
            }
        }
    }
    return best;
}

/* The ring vertex nearest to point i, as a place to begin at. */
static uint32_t nearest_of_ring(const mni_vertex *vertex, const mni_points *points, uint32_t i,
                                const uint32_t *ring, uint32_t ring_count, uint32_t k) {
    uint32_t nearest = MN_NONE;
    float least = INFINITY;
    for (uint32_t n = 0; n < ring_count; n++) {
        const float *p = vertex[ring[n]].p, *o = vertex[k].p;
        float apart = length2(p[0] - o[0] - points->x[i], p[1] - o[1] - points->y[i],
                              p[2] - o[2] - points->z[i]);
        if (ring[n] != k && apart < least) {
            least = apart;
            nearest = ring[n];
        }
    }
    return nearest;
}

/* The witnesses of both; those of k have homes. */
static void measure_hub_witnesses(mni_witness_book *book, mni_surface *s, const uint32_t *ring,
                                  uint32_t ring_count, uint32_t r, uint32_t k, mni_homes *homes) {
    mni_bench *b = book->bench;
    b->witness.count = 0;
    gather(book, s->vertex, k, s->vertex[k].p);
    uint32_t of_k = b->witness.count;
    gather(book, s->vertex, r, s->vertex[k].p);
    b->witnesses = b->witness.count;
    for (uint32_t i = 0; i < b->witnesses; i++) {
        b->home[i] =
            i < of_k && i < MNI_WITNESSES && s->vertex[k].set != MN_NONE ? homes->at[i] : MN_NONE;
        if (i >= of_k || b->home[i] == r)
            b->home[i] = nearest_of_ring(s->vertex, &b->witness, i, ring, ring_count, k);
        b->witness.distance[i] =
            measure_from(book, s, &b->witness, i, k, &b->home[i], &homes->credit);
    }
}

void mni_witness_collapse_hub(mni_witness_book *book, mni_surface *s, const uint32_t *ring,
                              uint32_t ring_count, uint32_t r, uint32_t k, mni_homes *homes) {
    enum { CREDIT = 64 };
    mni_bench *b = book->bench;
    mni_vertex *vertex = s->vertex;
    book->tried_r = book->tried_k = MN_NONE;
    homes->credit += CREDIT;
    measure_hub_witnesses(book, s, ring, ring_count, r, k, homes);
    float value = max_of(vertex[k].value, vertex[r].value);
    float largest = largest_of_witnesses(b);
    for (uint32_t next = 0; next < ring_count;) {
        b->more.count = 0;
        next = add_middles(b, &b->more, vertex, ring, next, ring_count, r, k);
        for (uint32_t i = 0; i < b->more.count; i++) {
            uint32_t home = b->neighbour[i];
            b->more.distance[i] = measure_from(book, s, &b->more, i, k, &home, &homes->credit);
        }
        largest = max_of(largest, raise_neighbours(b, &b->more, 0, vertex));
    }
    vertex[k].value = max_of(value, SAMPLE_FACTOR * largest);
    thin(b);
    keep(book, &vertex[r], &vertex[k]);
    for (uint32_t i = 0; i < b->witness.count; i++)
        homes->at[i] = b->home[i];
}
