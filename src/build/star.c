/* See star.h. Hidden here: how the nearest place of a triangle is found, and on how many points at
 * a time. */
#include "star.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* (k, a, b) as the edges from k, and what projecting on them needs. */
struct mni_star_triangle {
    float a[3], b[3], ab[3];
    float aa, bb, a_dot_b;
    float aa_inverse, ab_inverse; /* of squared lengths; 0: an edge without length */
    float area_inverse;           /* 1 / (aa·bb − (a·b)²); 0: a triangle without area */
};

/* Ends are counted as hashes: a fan whose ends differ passes for closed with a chance of 2^-32, and
 * then a distance to one edge is too large, never too small. */
#define SCATTER 0x9e3779b1u

enum { SPOKE_FAN_MAX = 256 }; /* a neighbour with more simplices is passed over */

static inline float clamp01(float t) {
    t = t > 0 ? t : 0; /* as minps and maxps have it */
    return t < 1 ? t : 1;
}

static inline float square(float x, float y, float z) {
    return x * x + y * y + z * z;
}

/* To the plane where a point lies above the triangle, otherwise to the nearest edge. Remainders are
 * formed before they are squared: the other way round loses half of the digits. Loops over lanes
 * are written for the compiler to make vectors of; on_a and on_ab are kept in between, or it takes
 * apart all that is made of them into cases. */
static inline __attribute__((always_inline)) void measure(const mni_star_triangle *triangle,
                                                          uint32_t count, mni_points *points) {
    for (uint32_t at = 0; at < points->count; at += MNI_LANES) {
        const float *x = &points->x[at], *y = &points->y[at], *z = &points->z[at];
        float least[MNI_LANES], on_a[MNI_LANES], on_ab[MNI_LANES];
        for (int l = 0; l < MNI_LANES; l++)
            least[l] = INFINITY;
        for (const mni_star_triangle *t = triangle; t < triangle + count; t++) {
            for (int l = 0; l < MNI_LANES; l++) {
                float pa = x[l] * t->a[0] + y[l] * t->a[1] + z[l] * t->a[2];
                float qx = x[l] - t->a[0], qy = y[l] - t->a[1], qz = z[l] - t->a[2];
                float q_ab = qx * t->ab[0] + qy * t->ab[1] + qz * t->ab[2];
                on_a[l] = clamp01(pa * t->aa_inverse);
                on_ab[l] = clamp01(q_ab * t->ab_inverse);
            }
            for (int l = 0; l < MNI_LANES; l++) {
                float pa = x[l] * t->a[0] + y[l] * t->a[1] + z[l] * t->a[2];
                float pb = x[l] * t->b[0] + y[l] * t->b[1] + z[l] * t->b[2];
                float u = (t->bb * pa - t->a_dot_b * pb) * t->area_inverse;
                float v = (t->aa * pb - t->a_dot_b * pa) * t->area_inverse;
                bool above = (u >= 0) & (v >= 0) & (u + v <= 1) & (t->area_inverse > 0);
                float plane =
                    square(x[l] - u * t->a[0] - v * t->b[0], y[l] - u * t->a[1] - v * t->b[1],
                           z[l] - u * t->a[2] - v * t->b[2]);
                float edge_a = square(x[l] - on_a[l] * t->a[0], y[l] - on_a[l] * t->a[1],
                                      z[l] - on_a[l] * t->a[2]);
                float edge_ab = square(x[l] - t->a[0] - on_ab[l] * t->ab[0],
                                       y[l] - t->a[1] - on_ab[l] * t->ab[1],
                                       z[l] - t->a[2] - on_ab[l] * t->ab[2]);
                float edge = edge_a < edge_ab ? edge_a : edge_ab;
                float distance2 = above ? plane : edge;
                least[l] = least[l] < distance2 ? least[l] : distance2;
            }
        }
        for (int l = 0; l < MNI_LANES; l++)
            points->distance[at + l] = sqrtf(least[l]);
    }
}

static void measure_narrow(const mni_star_triangle *triangle, uint32_t count, mni_points *points) {
    measure(triangle, count, points);
}

#ifdef __x86_64__
__attribute__((target("avx2"))) static void measure_wide(const mni_star_triangle *triangle,
                                                         uint32_t count, mni_points *points) {
    measure(triangle, count, points);
}
#endif

void mni_star_open(mni_star *star) {
    *star = (mni_star){.measure = measure_narrow};
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2"))
        star->measure = measure_wide;
#endif
}

void mni_star_narrow(mni_star *star) {
    star->measure = measure_narrow;
}

void mni_star_close(mni_star *star) {
    free(star->triangle);
    memset(star, 0, sizeof *star);
}

static inline float dot3(const float *a, const float *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline float inverse(float x) {
    return x > FLT_MIN ? 1 / x : 0;
}

static void prepare(mni_star_triangle *t, const float *k, const float *a, const float *b) {
    for (int i = 0; i < 3; i++) {
        t->a[i] = a[i] - k[i];
        t->b[i] = b[i] - k[i];
        t->ab[i] = b[i] - a[i];
    }
    t->aa = dot3(t->a, t->a);
    t->bb = dot3(t->b, t->b);
    t->a_dot_b = dot3(t->a, t->b);
    float area = t->aa * t->bb - t->a_dot_b * t->a_dot_b;
    t->aa_inverse = inverse(t->aa);
    t->ab_inverse = inverse(dot3(t->ab, t->ab));
    t->area_inverse = area > 1e-10f * t->aa * t->bb ? 1 / area : 0;
}

static uint32_t scatter(uint32_t v) {
    return (v * SCATTER) ^ (v * SCATTER >> 15);
}

static bool make_room(mni_star *star, uint32_t triangles) {
    star->count = 0;
    if (triangles <= star->room)
        return true;
    free(star->triangle);
    star->triangle = malloc(2 * (size_t)triangles * sizeof *star->triangle);
    star->room = star->triangle != NULL ? 2 * triangles : 0;
    return star->triangle != NULL;
}

/* A triangle's distance looks at its edges k–a and a–b. In a closed, oriented fan its k–b is the
 * next one's k–a; in others every k–b is added as a triangle without area. What add() returns sums
 * up to 0 over a closed fan. */
static uint32_t add(mni_star *star, const mni_vertex *vertex, uint32_t k, uint32_t next,
                    uint32_t previous) {
    prepare(&star->triangle[star->count++], vertex[k].p, vertex[next].p, vertex[previous].p);
    return scatter(next) - scatter(previous);
}

static bool take_slow(mni_star *star, mni_surface *s, uint32_t k) {
    uint32_t count, unpaired = 0;
    const uint32_t *fan = mni_surface_fan(s, k, &count);
    if (!make_room(star, 2 * count))
        return false;
    for (int pass = 0; pass == 0 || (pass == 1 && unpaired != 0); pass++)
        for (uint32_t i = 0; i < count; i++) {
            mni_corner c = mni_simplex_corner(&s->simplex[fan[i]], k);
            if (s->simplex[fan[i]].v[2] == MN_NONE)
                continue;
            if (pass == 0)
                unpaired += add(star, s->vertex, k, c.next, c.previous);
            else
                add(star, s->vertex, k, c.previous, c.previous);
        }
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
        unpaired += add(star, s->vertex, k, wheel.next[i], wheel.previous[i]);
    for (uint32_t i = 0; i < wheel.count && unpaired != 0; i++)
        add(star, s->vertex, k, wheel.previous[i], wheel.previous[i]);
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
    for (int pass = 0; pass == 0 || (pass == 1 && unpaired != 0); pass++)
        for (int e = 0; e < 2; e++)
            for (uint32_t i = 0; i < count[e]; i++) {
                const mni_simplex *x = &s->simplex[fan[e][i]];
                mni_corner c = mni_simplex_corner(x, ends[e]);
                if (x->v[2] == MN_NONE || c.next == ends[1 - e] || c.previous == ends[1 - e])
                    continue;
                if (pass == 0)
                    unpaired += add(star, s->vertex, k, c.next, c.previous);
                else
                    add(star, s->vertex, k, c.previous, c.previous);
            }
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
        add(star, s->vertex, k, c.next, c.previous);
        add(star, s->vertex, k, c.previous, c.previous); /* this is no closed fan */
        if (found < 2)
            ends[found] = c.next == n ? c.previous : c.next;
        found++;
    }
    return true;
}

void mni_star_measure(const mni_star *star, mni_points *points) {
    uint32_t n = points->count;
    if (star->count > 0) {
        for (uint32_t i = n; i % MNI_LANES != 0; i++)
            points->x[i] = points->y[i] = points->z[i] = 0;
        star->measure(star->triangle, star->count, points);
        return;
    }
    for (uint32_t i = 0; i < n; i++)
        points->distance[i] = sqrtf(points->x[i] * points->x[i] + points->y[i] * points->y[i] +
                                    points->z[i] * points->z[i]);
}
