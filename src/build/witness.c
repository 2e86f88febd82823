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

/* Four triangles of the star side by side: (k, a, b) as the edges from k, and what projecting on
 * them needs. Plain vector arithmetic, no fused operations: the same bits on every machine. */
enum { LANES = 4 }; /* what plain SSE2 holds in a register; 8 was slower without AVX */
typedef float lanes __attribute__((vector_size(4 * LANES)));
typedef int32_t masks __attribute__((vector_size(4 * LANES)));

typedef struct star_group {
    lanes a[3], b[3], ab[3];
    lanes aa, bb, a_dot_b;
    lanes aa_inverse, ab_inverse; /* of squared lengths; 0: an edge without length */
    lanes area_inverse;           /* 1 / (aa·bb − (a·b)²); 0: a triangle without area */
} star_group;

typedef struct mni_star {
    star_group *group;           /* the last one is filled up with copies of its last triangle */
    uint32_t count, groups_room; /* triangles; groups */
    float point[2 * MNI_WITNESSES + 64][3];
    float slack[2 * MNI_WITNESSES + 64];
    float distance[2 * MNI_WITNESSES + 64];
    float mate_apart[2 * MNI_WITNESSES + 64]; /* squared distance to the nearest point before it */
    uint32_t mate[2 * MNI_WITNESSES + 64];
} mni_star;

/* Chosen by trial on armadillo and nefertiti. `metanode bench error` then says, at 50, 10 and 1 %
 * of these and of igea, which was not used to choose: at least 99.93 % of samples within the bound,
 * and a median of bound / largest distance in a node of 1.2 to 2.1. */
#define SAMPLE_FACTOR 1.4f
#define NEIGHBOUR_FACTOR 2.0f

/* Ends are counted as hashes: a fan whose ends differ passes for closed with a chance of 2^-32, and
 * then a distance to one edge is too large, never too small. */
#define SCATTER 0x9e3779b1u

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
        free(book->star->group);
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

static void prepare(star_group *g, int lane, const float *k, const float *a, const float *b) {
    float ka[3], kb[3], ab[3];
    for (int i = 0; i < 3; i++) {
        ka[i] = a[i] - k[i];
        kb[i] = b[i] - k[i];
        ab[i] = b[i] - a[i];
        g->a[i][lane] = ka[i];
        g->b[i][lane] = kb[i];
        g->ab[i][lane] = ab[i];
    }
    float aa = dot3(ka, ka), bb = dot3(kb, kb), a_dot_b = dot3(ka, kb);
    float area = aa * bb - a_dot_b * a_dot_b;
    g->aa[lane] = aa;
    g->bb[lane] = bb;
    g->a_dot_b[lane] = a_dot_b;
    g->aa_inverse[lane] = inverse(aa);
    g->ab_inverse[lane] = inverse(dot3(ab, ab));
    g->area_inverse[lane] = area > 1e-10f * aa * bb ? 1 / area : 0;
}

/* A triangle's distance looks at its edges k–a and a–b. In a closed, oriented fan its k–b is the
 * next one's k–a; in others every k–b is added as a triangle without area. */
static bool prepare_star(mni_star *star, mni_surface *s, uint32_t k) {
    uint32_t count, unpaired = 0;
    const uint32_t *fan = mni_surface_fan(s, k, &count);
    if (2 * count > star->groups_room * LANES) {
        uint32_t groups = 4 * (count / LANES + 1);
        free(star->group);
        star->group = aligned_alloc(sizeof(lanes), groups * sizeof *star->group);
        star->groups_room = star->group != NULL ? groups : 0;
        if (star->group == NULL)
            return false;
    }
    const float *at_k = &s->position[3 * (size_t)k], *a = at_k, *b = at_k;
    uint32_t n = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (uint32_t i = 0; i < count; i++) {
            const mni_simplex *x = &s->simplex[fan[i]];
            if (x->v[2] == MN_NONE)
                continue;
            int c = x->v[0] == k ? 0 : x->v[1] == k ? 1 : 2;
            uint32_t to = x->v[c == 2 ? 0 : c + 1], from = x->v[c == 0 ? 2 : c - 1];
            unpaired += (to * SCATTER) ^ (to * SCATTER >> 15);
            unpaired -= (from * SCATTER) ^ (from * SCATTER >> 15);
            b = &s->position[3 * (size_t)from];
            a = pass == 0 ? &s->position[3 * (size_t)to] : b;
            prepare(&star->group[n / LANES], (int)(n % LANES), at_k, a, b);
            n++;
        }
        if (unpaired == 0)
            break;
    }
    star->count = n;
    for (; n % LANES != 0; n++)
        prepare(&star->group[n / LANES], (int)(n % LANES), at_k, a, b);
    return true;
}

static inline lanes pick(masks which, lanes yes, lanes no) {
    return (lanes)((which & (masks)yes) | (~which & (masks)no));
}

static inline lanes least(lanes a, lanes b) {
    return pick(a < b, a, b);
}

static inline lanes clamp01(lanes t) {
    lanes zero = {0}, one = zero + 1;
    return pick(t < zero, zero, pick(t > one, one, t));
}

static inline lanes square(lanes x, lanes y, lanes z) {
    return x * x + y * y + z * z;
}

/* Squared distances from p (relative to k) to four triangles: to the plane where p lies above the
 * triangle, otherwise to the nearest edge. Remainders are formed before they are squared: the other
 * way round loses half of the digits. */
static inline lanes group_distance2(const star_group *g, const float *p) {
    lanes pa = p[0] * g->a[0] + p[1] * g->a[1] + p[2] * g->a[2];
    lanes pb = p[0] * g->b[0] + p[1] * g->b[1] + p[2] * g->b[2];
    lanes u = (g->bb * pa - g->a_dot_b * pb) * g->area_inverse;
    lanes v = (g->aa * pb - g->a_dot_b * pa) * g->area_inverse;
    lanes zero = {0};
    masks above = (u >= zero) & (v >= zero) & (u + v <= zero + 1) & (g->area_inverse > zero);
    lanes plane = square(p[0] - u * g->a[0] - v * g->b[0], p[1] - u * g->a[1] - v * g->b[1],
                         p[2] - u * g->a[2] - v * g->b[2]);
    lanes on_a = clamp01(pa * g->aa_inverse);
    lanes qx = p[0] - g->a[0], qy = p[1] - g->a[1], qz = p[2] - g->a[2];
    lanes on_ab = clamp01((qx * g->ab[0] + qy * g->ab[1] + qz * g->ab[2]) * g->ab_inverse);
    lanes edge = square(p[0] - on_a * g->a[0], p[1] - on_a * g->a[1], p[2] - on_a * g->a[2]);
    edge = least(edge, square(qx - on_ab * g->ab[0], qy - on_ab * g->ab[1], qz - on_ab * g->ab[2]));
    return pick(above, plane, edge);
}

static float star_distance(const mni_star *star, const float *p) {
    if (star->count == 0)
        return sqrtf(dot3(p, p));
    lanes best = group_distance2(&star->group[0], p);
    for (uint32_t i = 1; i * LANES < star->count; i++)
        best = least(best, group_distance2(&star->group[i], p));
    float least_of = best[0];
    for (int i = 1; i < LANES; i++)
        least_of = best[i] < least_of ? best[i] : least_of;
    return sqrtf(least_of);
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

static float apart2(const mni_star *star, uint32_t i, uint32_t j) {
    float x = star->point[i][0] - star->point[j][0];
    float y = star->point[i][1] - star->point[j][1];
    float z = star->point[i][2] - star->point[j][2];
    return x * x + y * y + z * z;
}

/* Finds i's nearest among the n points before it. */
static void find_mate(mni_star *star, uint32_t i) {
    star->mate_apart[i] = INFINITY;
    star->mate[i] = 0;
    for (uint32_t j = 0; j < i; j++) {
        float d = apart2(star, i, j);
        if (d < star->mate_apart[i]) {
            star->mate_apart[i] = d;
            star->mate[i] = j;
        }
    }
}

/* Of the closest pair the one nearer to the surface goes, until few enough are left. */
static uint32_t thin(mni_star *star, uint32_t n) {
    for (uint32_t i = 0; n > MNI_WITNESSES && i < n; i++)
        find_mate(star, i);
    while (n > MNI_WITNESSES) {
        uint32_t second = 1;
        for (uint32_t i = 2; i < n; i++)
            if (star->mate_apart[i] < star->mate_apart[second])
                second = i;
        uint32_t first = star->mate[second], last = n - 1;
        bool first_nearer = star->distance[first] + star->slack[first] <
                            star->distance[second] + star->slack[second];
        uint32_t gone = first_nearer ? first : second;
        drop(star, gone, first_nearer ? second : first, last);
        n--;
        /* Whoever was mated with the one that went, or stands behind where the last one moved to.
         */
        for (uint32_t i = gone; i < n; i++)
            if (i == gone || star->mate[i] == gone)
                find_mate(star, i);
            else if (apart2(star, i, gone) < star->mate_apart[i]) {
                star->mate_apart[i] = apart2(star, i, gone);
                star->mate[i] = gone;
            }
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
