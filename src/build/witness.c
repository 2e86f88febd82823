/* See witness.h. Hidden here: which points are witnesses and how the nearest point of a star is
 * found.
 *
 * All coordinates of a measurement are relative to k, where the star's triangles meet, so that
 * floats keep the digits that matter. */
#include "witness.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"

/* The star, prepared: for triangle (k, a, b) the edges from k and what projecting on them needs. */
typedef struct star_triangle {
    float a[3], b[3], ab[3];
    float aa, bb, ab_ab; /* squared lengths; the inverse below is 0 for an edge without length */
    float aa_inverse, bb_inverse, ab_inverse;
    float a_dot_b, area_inverse; /* 1 / (aa·bb − (a·b)²); 0: a triangle without area */
} star_triangle;

typedef struct mni_star {
    star_triangle *triangle;
    uint32_t count, room;
    float point[2 * MNI_WITNESSES + 64][3];
    float slack[2 * MNI_WITNESSES + 64];
    float distance[2 * MNI_WITNESSES + 64];
} mni_star;

/* Measured on scans (armadillo, nefertiti at 50, 10, 1 %): with 1.5 and 2 at least 99.97 % of
 * samples are within the bound, and the median of bound / largest distance in a node is 1.5 to 2.7.
 * With 1 and 1: 97.6 % and 0.9 to 1.7. */
#define SAMPLE_FACTOR 1.5f
#define NEIGHBOUR_FACTOR 2.0f

enum { LEAF_TRIANGLES_MAX = 24, GATHER_MAX = 2 * MNI_WITNESSES + 64 };
_Static_assert(2 * (1 + LEAF_TRIANGLES_MAX) <= GATHER_MAX, "two leaves fit");
_Static_assert(MNI_WITNESSES + 1 + LEAF_TRIANGLES_MAX <= GATHER_MAX, "a leaf and a node fit");

static bool own_triangles(mni_witness_book *book) {
    const mn_mesh *mesh = book->mesh;
    book->own_start = calloc((size_t)mesh->vertices + 1, sizeof *book->own_start);
    book->own = malloc(((size_t)mesh->triangles + 1) * sizeof *book->own);
    if (book->own_start == NULL || book->own == NULL)
        return false;
    for (uint32_t t = 0; t < mesh->triangles; t++)
        book->own_start[mesh->corner[3 * (size_t)t]]++;
    for (uint32_t v = 0; v < mesh->vertices; v++)
        book->own_start[v + 1] += book->own_start[v];
    for (uint32_t t = mesh->triangles; t-- > 0;)
        book->own[--book->own_start[mesh->corner[3 * (size_t)t]]] = t;
    return true;
}

mn_code mni_witness_open(mni_witness_book *book, const mn_mesh *mesh, mn_status *st) {
    *book = (mni_witness_book){.mesh = mesh, .free_set = MN_NONE};
    book->sets_room = 1024;
    book->set = malloc((size_t)mesh->vertices * sizeof *book->set);
    book->value = calloc(mesh->vertices, sizeof *book->value);
    book->sets = malloc(book->sets_room * sizeof *book->sets);
    book->star = calloc(1, sizeof *book->star);
    if (book->set == NULL || book->value == NULL || book->sets == NULL || book->star == NULL ||
        !own_triangles(book)) {
        mni_witness_close(book);
        return mn_fail(st, MN_FAILED, "out of memory while simplifying %u triangles",
                       mesh->triangles);
    }
    memset(book->set, 0xff, (size_t)mesh->vertices * sizeof *book->set);
    return MN_OK;
}

void mni_witness_close(mni_witness_book *book) {
    if (book->star != NULL)
        free(book->star->triangle);
    free(book->star);
    free(book->set);
    free(book->value);
    free(book->sets);
    free(book->own_start);
    free(book->own);
    memset(book, 0, sizeof *book);
}

static float dot3(const float *a, const float *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static float inverse(float x) {
    return x > FLT_MIN ? 1 / x : 0;
}

static void prepare(star_triangle *t, const float *k, const float *a, const float *b) {
    for (int i = 0; i < 3; i++) {
        t->a[i] = a[i] - k[i];
        t->b[i] = b[i] - k[i];
        t->ab[i] = b[i] - a[i];
    }
    t->aa = dot3(t->a, t->a);
    t->bb = dot3(t->b, t->b);
    t->ab_ab = dot3(t->ab, t->ab);
    t->a_dot_b = dot3(t->a, t->b);
    t->aa_inverse = inverse(t->aa);
    t->bb_inverse = inverse(t->bb);
    t->ab_inverse = inverse(t->ab_ab);
    float area = t->aa * t->bb - t->a_dot_b * t->a_dot_b;
    t->area_inverse = area > 1e-10f * t->aa * t->bb ? 1 / area : 0;
}

static bool prepare_star(mni_star *star, mni_surface *s, uint32_t k) {
    uint32_t count;
    const uint32_t *fan = mni_surface_fan(s, k, &count);
    if (count > star->room) {
        star_triangle *more = realloc(star->triangle, 2 * (size_t)count * sizeof *more);
        if (more == NULL)
            return false;
        star->triangle = more;
        star->room = 2 * count;
    }
    star->count = 0;
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex *x = &s->simplex[fan[i]];
        if (x->v[2] == MN_NONE)
            continue;
        int c = x->v[0] == k ? 0 : x->v[1] == k ? 1 : 2;
        prepare(&star->triangle[star->count++], &s->position[3 * (size_t)k],
                &s->position[3 * (size_t)x->v[c == 2 ? 0 : c + 1]],
                &s->position[3 * (size_t)x->v[c == 0 ? 2 : c - 1]]);
    }
    return true;
}

static float clamp01(float t) {
    return t < 0 ? 0 : t > 1 ? 1 : t;
}

/* Squared distance from p (relative to k) to a triangle of the star. */
static inline float triangle_distance2(const star_triangle *t, const float *p) {
    float pa = dot3(p, t->a), pb = dot3(p, t->b), pp = dot3(p, p);
    float u = (t->bb * pa - t->a_dot_b * pb) * t->area_inverse;
    float v = (t->aa * pb - t->a_dot_b * pa) * t->area_inverse;
    float q[3] = {p[0] - t->a[0], p[1] - t->a[1], p[2] - t->a[2]};
    if (u >= 0 && v >= 0 && u + v <= 1 && t->area_inverse > 0) {
        float r[3];
        for (int i = 0; i < 3; i++)
            r[i] = p[i] - u * t->a[i] - v * t->b[i];
        return dot3(r, r);
    }
    float on_a = clamp01(pa * t->aa_inverse);
    float on_b = clamp01(pb * t->bb_inverse);
    float qab = dot3(q, t->ab);
    float on_ab = clamp01(qab * t->ab_inverse);
    float to_a = pp - on_a * (2 * pa - on_a * t->aa);
    float to_b = pp - on_b * (2 * pb - on_b * t->bb);
    float to_ab = dot3(q, q) - on_ab * (2 * qab - on_ab * t->ab_ab);
    float best = to_a < to_b ? to_a : to_b;
    best = to_ab < best ? to_ab : best;
    return best > 0 ? best : 0;
}

static float star_distance(const mni_star *star, const float *p) {
    float best = star->count == 0 ? dot3(p, p) : INFINITY;
    for (uint32_t i = 0; i < star->count; i++) {
        float d = triangle_distance2(&star->triangle[i], p);
        best = d < best ? d : best;
    }
    return sqrtf(best);
}

static uint32_t gather_point(mni_star *star, uint32_t n, const float *k, const float *p,
                             float slack) {
    for (int i = 0; i < 3; i++)
        star->point[n][i] = p[i] - k[i];
    star->slack[n] = slack;
    return n + 1;
}

static uint32_t gather(mni_witness_book *book, uint32_t v, const float *k, uint32_t n) {
    mni_star *star = book->star;
    const mn_mesh *mesh = book->mesh;
    if (book->set[v] != MN_NONE) {
        const mni_witnesses *set = &book->sets[book->set[v]];
        for (uint32_t i = 0; i < set->count; i++)
            n = gather_point(star, n, k, set->point[i], set->slack[i]);
        return n;
    }
    n = gather_point(star, n, k, &mesh->position[3 * (size_t)v], 0);
    uint32_t end = book->own_start[v + 1];
    for (uint32_t i = book->own_start[v]; i < end && i < book->own_start[v] + LEAF_TRIANGLES_MAX;
         i++) {
        const uint32_t *c = &mesh->corner[3 * (size_t)book->own[i]];
        float centre[3];
        for (int x = 0; x < 3; x++)
            centre[x] =
                (mesh->position[3 * (size_t)c[0] + x] + mesh->position[3 * (size_t)c[1] + x] +
                 mesh->position[3 * (size_t)c[2] + x]) /
                3;
        n = gather_point(star, n, k, centre, 0);
    }
    return n;
}

/* Drops witness `gone`; the one at `heir` answers for it. */
static void drop(mni_star *star, uint32_t gone, uint32_t heir, uint32_t last) {
    float beyond = star->distance[gone] + star->slack[gone] - star->distance[heir];
    if (beyond > star->slack[heir])
        star->slack[heir] = beyond;
    memcpy(star->point[gone], star->point[last], sizeof star->point[gone]);
    star->slack[gone] = star->slack[last];
    star->distance[gone] = star->distance[last];
}

/* Of the closest pair the one nearer to the surface goes, until few enough are left. */
static uint32_t thin(mni_star *star, uint32_t n) {
    while (n > MNI_WITNESSES) {
        uint32_t first = 0, second = 1;
        float closest = INFINITY;
        for (uint32_t i = 1; i < n; i++)
            for (uint32_t j = 0; j < i; j++) {
                float dx = star->point[i][0] - star->point[j][0];
                float dy = star->point[i][1] - star->point[j][1];
                float dz = star->point[i][2] - star->point[j][2];
                float d = dx * dx + dy * dy + dz * dz;
                if (d < closest) {
                    closest = d;
                    first = j;
                    second = i;
                }
            }
        bool first_nearer = star->distance[first] + star->slack[first] <
                            star->distance[second] + star->slack[second];
        drop(star, first_nearer ? first : second, first_nearer ? second : first, n - 1);
        n--;
    }
    return n;
}

static uint32_t set_take(mni_witness_book *book) {
    uint32_t at = book->free_set;
    if (at != MN_NONE) {
        book->free_set = book->sets[at].next_free;
        return at;
    }
    if (book->sets_count == book->sets_room) {
        mni_witnesses *more = realloc(book->sets, 2 * (size_t)book->sets_room * sizeof *more);
        if (more == NULL)
            return MN_NONE;
        book->sets = more;
        book->sets_room *= 2;
    }
    return book->sets_count++;
}

static bool keep(mni_witness_book *book, uint32_t r, uint32_t k, uint32_t n, const float *origin) {
    if (book->set[r] != MN_NONE) {
        book->sets[book->set[r]].next_free = book->free_set;
        book->free_set = book->set[r];
    }
    if (book->set[k] == MN_NONE)
        book->set[k] = set_take(book);
    if (book->set[k] == MN_NONE)
        return false;
    mni_witnesses *set = &book->sets[book->set[k]];
    set->count = n;
    for (uint32_t i = 0; i < n; i++) {
        for (int x = 0; x < 3; x++)
            set->point[i][x] = book->star->point[i][x] + origin[x];
        set->slack[i] = book->star->slack[i];
    }
    return true;
}

static float max_of(float a, float b) {
    return a > b ? a : b;
}

void mni_witness_collapse(mni_witness_book *book, mni_surface *s, const mni_ring_vertex *ring,
                          uint32_t ring_count, uint32_t r, uint32_t k) {
    mni_star *star = book->star;
    const float *at_k = &s->position[3 * (size_t)k], *at_r = &s->position[3 * (size_t)r];
    if (!prepare_star(star, s, k)) {
        book->no_memory = true;
        return;
    }
    uint32_t n = gather(book, k, at_k, 0);
    n = gather(book, r, at_k, n);
    float value = max_of(book->value[k], book->value[r]);
    for (uint32_t i = 0; i < n; i++) {
        star->distance[i] = star_distance(star, star->point[i]);
        value = max_of(value, SAMPLE_FACTOR * (star->distance[i] + star->slack[i]));
    }
    for (uint32_t i = 0; i < ring_count; i++) {
        uint32_t v = ring[i].vertex;
        if (v == k)
            continue;
        const float *at_v = &s->position[3 * (size_t)v];
        float middle[3];
        for (int x = 0; x < 3; x++)
            middle[x] = 0.5f * (at_v[x] + at_r[x]) - at_k[x];
        float moved = star_distance(star, middle);
        value = max_of(value, SAMPLE_FACTOR * moved);
        if (book->set[v] != MN_NONE)
            book->value[v] = max_of(book->value[v], NEIGHBOUR_FACTOR * moved);
    }
    n = thin(star, n);
    if (!keep(book, r, k, n, at_k))
        book->no_memory = true;
    book->value[k] = value;
}
