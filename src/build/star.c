/* See star.h. Hidden here: how the nearest place of a triangle is found, and on how many points at
 * a time. */
#include "star.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

/* Triangles (k, a, b), side by side. */
enum { SIDE = 8 };
struct mni_star_triangles {
    float a[3][SIDE], b[3][SIDE]; /* places; prepared: from k */
    /* Prepared: what projecting on their edges needs. */
    float ab[3][SIDE];
    float aa[SIDE], bb[SIDE], a_dot_b[SIDE];
    float aa_inverse[SIDE], ab_inverse[SIDE]; /* of squared lengths; 0: an edge without length */
    float area_inverse[SIDE]; /* 1 / (aa·bb − (a·b)²); NAN: a triangle without area */
};

/* Ends are counted as hashes: a fan whose ends differ passes for closed with a chance of 2^-32, and
 * then a distance to one edge is too large, never too small. */
#define SCATTER 0x9e3779b1u

enum { LANES_MAX = 16 }; /* a register of AVX-512 */
_Static_assert(MNI_POINTS % LANES_MAX == 0, "whole registers of points");

enum { SPOKE_FAN_MAX = 256 }; /* a neighbour with more simplices is passed over */

static inline float clamp01(float t) {
    t = t > 0 ? t : 0; /* as minps and maxps have it */
    return t < 1 ? t : 1;
}

static inline float square(float x, float y, float z) {
    return x * x + y * y + z * z;
}

static inline float inverse(float x) {
    return x > FLT_MIN ? 1 / x : 0;
}

typedef float four_floats __attribute__((vector_size(16)));
typedef float eight_floats __attribute__((vector_size(32)));

_Static_assert(offsetof(mni_vertex, value) == 3 * sizeof(float), "a place is a load");

#define BOTH(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7)
/* In both halves of rows a and b: a0 b0 a1 b1; a2 b2 a3 b3; a0 a1 b0 b1; a2 a3 b2 b3. */
#define FIRST(a, b) __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13)
#define LAST(a, b) __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15)
#define LOW(a, b) __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13)
#define HIGH(a, b) __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15)

/* The places of eight vertices as columns. Rows are turned over in registers: what is written
 * number by number and read as a row waits for the memory. */
static inline __attribute__((always_inline)) void turn_over(const mni_vertex *vertex,
                                                            const uint32_t *of, float to[3][SIDE]) {
    four_floats p[SIDE];
    for (int l = 0; l < SIDE; l++)
        memcpy(&p[l], vertex[of[l]].p, sizeof p[l]);
    eight_floats a = BOTH(p[0], p[4]), b = BOTH(p[1], p[5]);
    eight_floats c = BOTH(p[2], p[6]), d = BOTH(p[3], p[7]);
    eight_floats ab = FIRST(a, b), cd = FIRST(c, d);
    eight_floats x = LOW(ab, cd), y = HIGH(ab, cd), z = LOW(LAST(a, b), LAST(c, d));
    memcpy(to[0], &x, sizeof x);
    memcpy(to[1], &y, sizeof y);
    memcpy(to[2], &z, sizeof z);
}

static inline __attribute__((always_inline)) void take_over(const mni_vertex *vertex,
                                                            const uint32_t *of, float to[3][SIDE]) {
    for (int l = 0; l < SIDE; l++)
        for (int i = 0; i < 3; i++)
            to[i][l] = vertex[of[l]].p[i];
}

static inline __attribute__((always_inline)) void prepare(mni_star_triangles *t,
                                                          const mni_star_corners *c, bool turns) {
    const float at_k[3] = {c->vertex[c->k].p[0], c->vertex[c->k].p[1], c->vertex[c->k].p[2]};
    for (uint32_t at = 0; at < c->count; at += SIDE, t++) {
        if (turns) {
            turn_over(c->vertex, &c->next[at], t->a);
            turn_over(c->vertex, &c->previous[at], t->b);
        } else {
            take_over(c->vertex, &c->next[at], t->a);
            take_over(c->vertex, &c->previous[at], t->b);
        }
        for (int i = 0; i < 3; i++)
            for (int l = 0; l < SIDE; l++) {
                t->ab[i][l] = t->b[i][l] - t->a[i][l];
                t->a[i][l] -= at_k[i];
                t->b[i][l] -= at_k[i];
            }
        for (int l = 0; l < SIDE; l++) {
            float aa = t->a[0][l] * t->a[0][l] + t->a[1][l] * t->a[1][l] + t->a[2][l] * t->a[2][l];
            float bb = t->b[0][l] * t->b[0][l] + t->b[1][l] * t->b[1][l] + t->b[2][l] * t->b[2][l];
            float ab = t->a[0][l] * t->b[0][l] + t->a[1][l] * t->b[1][l] + t->a[2][l] * t->b[2][l];
            float side = square(t->ab[0][l], t->ab[1][l], t->ab[2][l]);
            float area = aa * bb - ab * ab;
            t->aa[l] = aa;
            t->bb[l] = bb;
            t->a_dot_b[l] = ab;
            t->aa_inverse[l] = inverse(aa);
            t->ab_inverse[l] = inverse(side);
            t->area_inverse[l] = area > 1e-10f * aa * bb ? 1 / area : NAN;
        }
    }
}

/* To the plane where a point lies above the triangle, otherwise to the nearest edge. Remainders are
 * formed before they are squared: the other way round loses half of the digits. Loops over lanes
 * are written for the compiler to make vectors of; on_a and on_ab are kept in between, or it takes
 * apart all that is made of them into cases. */
static inline __attribute__((always_inline)) void measure(const mni_star_triangles *triangles,
                                                          uint32_t count, mni_points *points) {
    for (uint32_t at = 0; at < points->count; at += MNI_LANES) {
        const float *x = &points->x[at], *y = &points->y[at], *z = &points->z[at];
        float least[MNI_LANES], on_a[MNI_LANES], on_ab[MNI_LANES];
        for (int l = 0; l < MNI_LANES; l++)
            least[l] = INFINITY;
        for (uint32_t n = 0; n < count; n++) {
            const mni_star_triangles *t = &triangles[n / SIDE];
            const uint32_t i = n % SIDE;
            for (int l = 0; l < MNI_LANES; l++) {
                float pa = x[l] * t->a[0][i] + y[l] * t->a[1][i] + z[l] * t->a[2][i];
                float qx = x[l] - t->a[0][i], qy = y[l] - t->a[1][i], qz = z[l] - t->a[2][i];
                float q_ab = qx * t->ab[0][i] + qy * t->ab[1][i] + qz * t->ab[2][i];
                on_a[l] = clamp01(pa * t->aa_inverse[i]);
                on_ab[l] = clamp01(q_ab * t->ab_inverse[i]);
            }
            for (int l = 0; l < MNI_LANES; l++) {
                float pa = x[l] * t->a[0][i] + y[l] * t->a[1][i] + z[l] * t->a[2][i];
                float pb = x[l] * t->b[0][i] + y[l] * t->b[1][i] + z[l] * t->b[2][i];
                float u = (t->bb[i] * pa - t->a_dot_b[i] * pb) * t->area_inverse[i];
                float v = (t->aa[i] * pb - t->a_dot_b[i] * pa) * t->area_inverse[i];
                bool above = (u >= 0) & (v >= 0) & (u + v <= 1); /* never where there is no area */
                float plane = square(x[l] - u * t->a[0][i] - v * t->b[0][i],
                                     y[l] - u * t->a[1][i] - v * t->b[1][i],
                                     z[l] - u * t->a[2][i] - v * t->b[2][i]);
                float edge_a = square(x[l] - on_a[l] * t->a[0][i], y[l] - on_a[l] * t->a[1][i],
                                      z[l] - on_a[l] * t->a[2][i]);
                float edge_ab = square(x[l] - t->a[0][i] - on_ab[l] * t->ab[0][i],
                                       y[l] - t->a[1][i] - on_ab[l] * t->ab[1][i],
                                       z[l] - t->a[2][i] - on_ab[l] * t->ab[2][i]);
                float edge = edge_a < edge_ab ? edge_a : edge_ab;
                float distance2 = above ? plane : edge;
                least[l] = least[l] < distance2 ? least[l] : distance2;
            }
        }
        for (int l = 0; l < MNI_LANES; l++)
            points->distance[at + (uint32_t)l] = sqrtf(least[l]);
    }
}

static void prepare_narrow(mni_star_triangles *t, const mni_star_corners *c) {
    prepare(t, c, false);
}

static void measure_narrow(const mni_star_triangles *t, uint32_t count, mni_points *points) {
    measure(t, count, points);
}

#ifdef __x86_64__
#define WIDE __attribute__((target("avx2")))
#define WIDEST __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq")))

WIDE static void prepare_wide(mni_star_triangles *t, const mni_star_corners *c) {
    prepare(t, c, true);
}

WIDE static void measure_wide(const mni_star_triangles *t, uint32_t count, mni_points *points) {
    measure(t, count, points);
}

/* What is asked of a triangle, in every lane. */
#define ALL(x) _mm512_set1_ps(x)

typedef struct wide_place {
    __m512 x, y, z;
} wide_place;

WIDEST static inline __m512 wide_dot(wide_place p, const float of[3][SIDE], uint32_t i) {
    return p.x * ALL(of[0][i]) + p.y * ALL(of[1][i]) + p.z * ALL(of[2][i]);
}

/* p − by × of. */
WIDEST static inline wide_place wide_beyond(wide_place p, __m512 by, const float of[3][SIDE],
                                            uint32_t i) {
    return (wide_place){p.x - by * ALL(of[0][i]), p.y - by * ALL(of[1][i]),
                        p.z - by * ALL(of[2][i])};
}

WIDEST static inline __m512 wide_square(wide_place p) {
    return p.x * p.x + p.y * p.y + p.z * p.z;
}

WIDEST static inline __m512 wide_clamp(__m512 t) {
    return _mm512_min_ps(_mm512_max_ps(t, _mm512_setzero_ps()), ALL(1));
}

/* As measure(), operation by operation. Of that the compiler makes twice as many instructions here:
 * it has no use for minima and maxima. */
WIDEST static void measure_widest(const mni_star_triangles *triangles, uint32_t count,
                                  mni_points *points) {
    for (uint32_t at = 0; at < points->count; at += LANES_MAX) {
        const wide_place p = {_mm512_loadu_ps(&points->x[at]), _mm512_loadu_ps(&points->y[at]),
                              _mm512_loadu_ps(&points->z[at])};
        __m512 least = ALL(INFINITY);
        for (uint32_t n = 0; n < count; n++) {
            const mni_star_triangles *t = &triangles[n / SIDE];
            const uint32_t i = n % SIDE;
            const wide_place q = {p.x - ALL(t->a[0][i]), p.y - ALL(t->a[1][i]),
                                  p.z - ALL(t->a[2][i])};
            __m512 pa = wide_dot(p, t->a, i), pb = wide_dot(p, t->b, i);
            __m512 on_a = wide_clamp(pa * ALL(t->aa_inverse[i]));
            __m512 on_ab = wide_clamp(wide_dot(q, t->ab, i) * ALL(t->ab_inverse[i]));
            __m512 u = (ALL(t->bb[i]) * pa - ALL(t->a_dot_b[i]) * pb) * ALL(t->area_inverse[i]);
            __m512 v = (ALL(t->aa[i]) * pb - ALL(t->a_dot_b[i]) * pa) * ALL(t->area_inverse[i]);
            __mmask16 above = _mm512_cmp_ps_mask(u, _mm512_setzero_ps(), _CMP_GE_OQ);
            above = _mm512_mask_cmp_ps_mask(above, v, _mm512_setzero_ps(), _CMP_GE_OQ);
            above = _mm512_mask_cmp_ps_mask(above, u + v, ALL(1), _CMP_LE_OQ);
            __m512 plane = wide_square(wide_beyond(wide_beyond(p, u, t->a, i), v, t->b, i));
            __m512 edge_a = wide_square(wide_beyond(p, on_a, t->a, i));
            __m512 edge_ab = wide_square(wide_beyond(q, on_ab, t->ab, i));
            __m512 edge = _mm512_min_ps(edge_a, edge_ab);
            least = _mm512_min_ps(least, _mm512_mask_mov_ps(edge, above, plane));
        }
        _mm512_storeu_ps(&points->distance[at], _mm512_sqrt_ps(least));
    }
}
#endif

void mni_star_open(mni_star *star) {
    *star = (mni_star){.prepare = prepare_narrow, .measure = measure_narrow};
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2")) {
        star->prepare = prepare_wide;
        star->measure = measure_wide;
    }
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq"))
        star->measure = measure_widest;
#endif
}

void mni_star_narrow(mni_star *star) {
    star->prepare = prepare_narrow;
    star->measure = measure_narrow;
}

void mni_star_close(mni_star *star) {
    free(star->triangles);
    free(star->next);
    memset(star, 0, sizeof *star);
}

static uint32_t scatter(uint32_t v) {
    return (v * SCATTER) ^ (v * SCATTER >> 15);
}

/* For so many triangles, and a row of padding. */
static bool make_room(mni_star *star, uint32_t triangles) {
    star->count = 0;
    if (triangles + SIDE <= star->room)
        return true;
    free(star->triangles);
    free(star->next);
    uint32_t rows = (2 * triangles + SIDE - 1) / SIDE + 1;
    star->room = rows * SIDE;
    star->triangles = malloc((size_t)rows * sizeof *star->triangles);
    star->next = malloc(2 * (size_t)star->room * sizeof *star->next);
    if (star->triangles == NULL || star->next == NULL)
        star->room = 0;
    else
        star->previous = star->next + star->room;
    return star->room > 0;
}

/* A triangle's distance looks at its edges k–a and a–b. In a closed, oriented fan its k–b is the
 * next one's k–a; in others every k–b is added as a triangle without area. What add() returns sums
 * up to 0 over a closed fan. */
static inline uint32_t add(mni_star *star, uint32_t next, uint32_t previous) {
    star->next[star->count] = next;
    star->previous[star->count++] = previous;
    return scatter(next) - scatter(previous);
}

/* The same, or nothing; without a branch. */
static inline uint32_t add_if(mni_star *star, bool is, uint32_t next, uint32_t previous) {
    star->next[star->count] = next;
    star->previous[star->count] = previous;
    star->count += is;
    return (scatter(next) - scatter(previous)) & (0u - is);
}

/* Every k–b. */
static void add_ends(mni_star *star) {
    const uint32_t count = star->count;
    for (uint32_t i = 0; i < count; i++)
        add(star, star->previous[i], star->previous[i]);
}

/* Once all have been added: k is where they meet. */
static void end(mni_star *star, const mni_surface *s, uint32_t k) {
    for (uint32_t i = 0; i < SIDE; i++) /* or there might be anything */
        star->next[star->count + i] = star->previous[star->count + i] = k;
    star->prepare(star->triangles,
                  &(mni_star_corners){s->vertex, k, star->next, star->previous, star->count});
}

static bool take_slow(mni_star *star, mni_surface *s, uint32_t k) {
    uint32_t count, unpaired = 0;
    const uint32_t *fan = mni_surface_fan(s, k, &count);
    if (!make_room(star, 2 * count))
        return false;
    for (uint32_t i = 0; i < count; i++) {
        mni_corner c = mni_simplex_corner(&s->simplex[fan[i]], k);
        if (s->simplex[fan[i]].v[2] != MN_NONE)
            unpaired += add(star, c.next, c.previous);
    }
    if (unpaired != 0)
        add_ends(star);
    end(star, s, k);
    return true;
}

bool mni_star_take(mni_star *star, mni_surface *s, uint32_t k) {
    mni_wheel wheel;
    uint32_t unpaired = 0;
    if (!mni_surface_wheel(s, k, &wheel))
        return take_slow(star, s, k);
    if (!make_room(star, 2 * MNI_WHEEL_MAX))
        return false;
    for (uint32_t i = 0; i < wheel.count; i++)
        unpaired += add(star, wheel.next[i], wheel.previous[i]);
    if (unpaired != 0)
        add_ends(star);
    end(star, s, k);
    return true;
}

bool mni_star_take_of_both(mni_star *star, mni_surface *s, uint32_t r, uint32_t k) {
    const uint32_t ends[2] = {k, r};
    const uint32_t *fan[2];
    uint32_t count[2], unpaired = 0;
    for (int e = 0; e < 2; e++)
        fan[e] = mni_surface_fan(s, ends[e], &count[e]);
    if (!make_room(star, 2 * (count[0] + count[1])))
        return false;
    for (int e = 0; e < 2; e++)
        for (uint32_t i = 0; i < count[e]; i++) {
            const mni_simplex *x = &s->simplex[fan[e][i]];
            mni_corner c = mni_simplex_corner(x, ends[e]);
            if (x->v[2] != MN_NONE && c.next != ends[1 - e] && c.previous != ends[1 - e])
                unpaired += add(star, c.next, c.previous);
        }
    if (unpaired != 0)
        add_ends(star);
    end(star, s, k);
    return true;
}

bool mni_star_take_of_wheels(mni_star *star, const mni_surface *s, const mni_wheel *of_r,
                             const mni_wheel *of_k, uint32_t r, uint32_t k) {
    const mni_wheel *wheel[2] = {of_k, of_r};
    const uint32_t other[2] = {r, k};
    uint32_t unpaired = 0;
    if (!make_room(star, 4 * MNI_WHEEL_MAX))
        return false;
    for (int e = 0; e < 2; e++)
        for (uint32_t i = 0; i < wheel[e]->count; i++) {
            uint32_t next = wheel[e]->next[i], previous = wheel[e]->previous[i];
            bool stays = (next != other[e]) & (previous != other[e]);
            unpaired += add_if(star, stays, next, previous);
        }
    if (unpaired != 0)
        add_ends(star);
    end(star, s, k);
    return true;
}

bool mni_star_take_spoke(mni_star *star, mni_surface *s, uint32_t k, uint32_t n, uint32_t ends[2]) {
    uint32_t count, found = 0;
    ends[0] = ends[1] = MN_NONE;
    if (!make_room(star, 2 * MNI_WHEEL_MAX))
        return false;
    if (s->vertex[n].fan.count > SPOKE_FAN_MAX)
        return true;
    const uint32_t *fan = mni_surface_fan(s, n, &count);
    for (uint32_t i = 0; i < count && found < MNI_WHEEL_MAX; i++) {
        const mni_simplex *x = &s->simplex[fan[i]];
        if (x->v[2] == MN_NONE || (x->v[0] != k && x->v[1] != k && x->v[2] != k))
            continue;
        mni_corner c = mni_simplex_corner(x, k);
        add(star, c.next, c.previous);
        add(star, c.previous, c.previous); /* this is no closed fan */
        if (found < 2)
            ends[found] = c.next == n ? c.previous : c.next;
        found++;
    }
    end(star, s, k);
    return true;
}

void mni_star_measure(const mni_star *star, mni_points *points) {
    uint32_t n = points->count;
    if (star->count > 0) {
        for (uint32_t i = n; i % LANES_MAX != 0; i++)
            points->x[i] = points->y[i] = points->z[i] = 0;
        star->measure(star->triangles, star->count, points);
        return;
    }
    for (uint32_t i = 0; i < n; i++)
        points->distance[i] = sqrtf(points->x[i] * points->x[i] + points->y[i] * points->y[i] +
                                    points->z[i] * points->z[i]);
}
