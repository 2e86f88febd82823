/* Quadrics (Garland and Heckbert): the sum of squared distances to planes, weighted with area.
 * Along an edge with one triangle a wall stands on it, so that boundaries keep their shape. */
#include "simplify.h"

#include <math.h>
#include <string.h>

/* A plane through the quadric's own vertex, from where distances count: no linear part. */
static void add_plane(mni_vertex *q, const double n[3], double weight) {
    q->xx += weight * n[0] * n[0];
    q->xy += weight * n[0] * n[1];
    q->xz += weight * n[0] * n[2];
    q->yy += weight * n[1] * n[1];
    q->yz += weight * n[1] * n[2];
    q->zz += weight * n[2] * n[2];
}

static void edge_of(const float *from, const float *to, double e[3]) {
    for (int i = 0; i < 3; i++)
        e[i] = (double)to[i] - from[i];
}

static void cross(const double *a, const double *b, double n[3]) {
    n[0] = a[1] * b[2] - a[2] * b[1];
    n[1] = a[2] * b[0] - a[0] * b[2];
    n[2] = a[0] * b[1] - a[1] * b[0];
}

/* Makes n a unit vector and returns its length; 0: it has none. */
static double unit(double n[3]) {
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (length > 0)
        for (int i = 0; i < 3; i++)
            n[i] /= length;
    return length;
}

void mni_quadric_wall(mni_surface *surface, uint32_t v, uint32_t w) {
    uint32_t count;
    mni_vertex *vertex = surface->vertex;
    bool v_shorter = vertex[v].fan.count <= vertex[w].fan.count;
    const uint32_t *fan = mni_surface_fan(surface, v_shorter ? v : w, &count);
    const uint32_t other = v_shorter ? w : v;
    for (uint32_t f = 0; f < count; f++) {
        const uint32_t *c = surface->simplex[fan[f]].v;
        if (c[0] != other && c[1] != other && c[2] != other)
            continue;
        double e1[3], e2[3], normal[3], along[3], wall[3];
        edge_of(vertex[c[0]].p, vertex[c[1]].p, e1);
        edge_of(vertex[c[0]].p, vertex[c[2]].p, e2);
        cross(e1, e2, normal);
        edge_of(vertex[v].p, vertex[w].p, along);
        cross(along, normal, wall);
        double length2 = along[0] * along[0] + along[1] * along[1] + along[2] * along[2];
        if (unit(wall) > 0)
            add_plane(&vertex[v], wall, length2);
    }
}

/* Of a triangle: its unit normal; returns its area. */
static double plane_of(const mni_surface *surface, uint32_t t, double n[3]) {
    const mni_vertex *vertex = surface->vertex;
    const uint32_t *c = surface->simplex[t].v;
    double e1[3], e2[3];
    edge_of(vertex[c[0]].p, vertex[c[1]].p, e1);
    edge_of(vertex[c[0]].p, vertex[c[2]].p, e2);
    cross(e1, e2, n);
    return 0.5 * unit(n);
}

void mni_quadrics_fill(mni_surface *surface) {
    for (uint32_t t = 0; t < surface->triangles; t++) {
        double n[3], area = plane_of(surface, t, n);
        if (area > 0)
            for (int i = 0; i < 3; i++)
                add_plane(&surface->vertex[surface->simplex[t].v[i]], n, area);
    }
}

void mni_quadric_add_triangle(mni_surface *surface, uint32_t v, uint32_t t) {
    double n[3], area = plane_of(surface, t, n);
    if (area > 0)
        add_plane(&surface->vertex[v], n, area);
}

/* ---- costs of a ring's candidates, side by side ---------------------------------------------- */

/* Two widths of the same. Of rows a and b, in each half of a row of eight: a0 b0 a2 b2; a1 b1 a3
 * b3; a0 a1 b0 b1; a2 a3 b2 b3. */
enum { FOUR = 4, EIGHT = 8 };
#define EVEN(a, b) __builtin_shufflevector(a, b, 0, 4, 2, 6)
#define ODD(a, b) __builtin_shufflevector(a, b, 1, 5, 3, 7)
#define LOW(a, b) __builtin_shufflevector(a, b, 0, 1, 4, 5)
#define HIGH(a, b) __builtin_shufflevector(a, b, 2, 3, 6, 7)
#define EVENS(a, b) __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14)
#define ODDS(a, b) __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15)
#define LOWS(a, b) __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13)
#define HIGHS(a, b) __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15)
#define BOTH(a, b) __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7)

_Static_assert(offsetof(mni_vertex, zz) == offsetof(mni_vertex, c) + 3 * sizeof(double) &&
                   offsetof(mni_vertex, value) == 3 * sizeof(float),
               "a place and a half of the quadric are a load each");

/* What is asked of some neighbours, and their keys: as mni_collapse_cost has it, operation by
 * operation. */
#define COSTS(LANES, lanes, bits, halves, half_bits, columns, costs_of)                            \
    typedef double lanes __attribute__((vector_size(8 * LANES)));                                  \
    typedef uint64_t bits __attribute__((vector_size(8 * LANES)));                                 \
    typedef float halves __attribute__((vector_size(4 * LANES)));                                  \
    typedef uint32_t half_bits __attribute__((vector_size(4 * LANES)));                            \
    typedef struct columns {                                                                       \
        halves px, py, pz;                                                                         \
        lanes c, xx, yy, zz;                                                                       \
    } columns;                                                                                     \
    static inline __attribute__((always_inline)) void costs_of(                                    \
        const mni_vertex *r, const columns *k, const uint32_t *kept, mni_heap_key *key) {          \
        lanes x = __builtin_convertvector(k->px, lanes) - (double)r->p[0];                         \
        lanes y = __builtin_convertvector(k->py, lanes) - (double)r->p[1];                         \
        lanes z = __builtin_convertvector(k->pz, lanes) - (double)r->p[2];                         \
        lanes length2 = x * x + y * y + z * z;                                                     \
        lanes share = MNI_LENGTH_SHARE * ((r->xx + r->yy + r->zz) + (k->xx + k->yy + k->zz));      \
        lanes value =                                                                              \
            r->xx * x * x + r->yy * y * y + r->zz * z * z +                                        \
            2 * (r->xy * x * y + r->xz * x * z + r->yz * y * z + r->x * x + r->y * y + r->z * z) + \
            r->c;                                                                                  \
        value = (lanes)((bits)value & (bits)(value > 0));                                          \
        halves cost = __builtin_convertvector(value + k->c + share * length2, halves);             \
        half_bits of;                                                                              \
        memcpy(&of, kept, sizeof of);                                                              \
        bits keys = __builtin_convertvector((half_bits)cost, bits) << 32 |                         \
                    __builtin_convertvector(of, bits);                                             \
        memcpy(key, &keys, sizeof keys);                                                           \
    }

COSTS(FOUR, lanes_4, bits_4, halves_4, half_bits_4, columns_4, costs_of_four)

/* What is asked of neighbours comes in as rows and is turned into columns: to put it together
 * number by number takes longer than what is done with it. */
static inline __attribute__((always_inline)) void
four_keys(const mni_vertex *vertex, uint32_t r, const uint32_t *kept, mni_heap_key *key) {
    halves_4 p[FOUR];
    lanes_4 q[FOUR];
    for (int l = 0; l < FOUR; l++) {
        memcpy(&p[l], vertex[kept[l]].p, sizeof p[l]);
        memcpy(&q[l], &vertex[kept[l]].c, sizeof q[l]);
    }
    halves_4 xz0 = EVEN(p[0], p[1]), xz1 = EVEN(p[2], p[3]);
    halves_4 y0 = ODD(p[0], p[1]), y1 = ODD(p[2], p[3]);
    lanes_4 a = EVEN(q[0], q[1]), b = EVEN(q[2], q[3]), c = ODD(q[0], q[1]), d = ODD(q[2], q[3]);
    columns_4 k = {.px = LOW(xz0, xz1),
                   .py = LOW(y0, y1),
                   .pz = HIGH(xz0, xz1),
                   .c = LOW(a, b),
                   .xx = LOW(c, d),
                   .yy = HIGH(a, b),
                   .zz = HIGH(c, d)};
    costs_of_four(&vertex[r], &k, kept, key);
}

void mni_collapse_keys_narrow(const mni_vertex *vertex, uint32_t r, const uint32_t *kept,
                              uint32_t count, mni_heap_key *key) {
    for (uint32_t i = 0; i < count; i += FOUR)
        four_keys(vertex, r, &kept[i], &key[i]);
}

#ifdef __x86_64__
__attribute__((target("avx2"))) static void keys_wide(const mni_vertex *vertex, uint32_t r,
                                                      const uint32_t *kept, uint32_t count,
                                                      mni_heap_key *key) {
    for (uint32_t i = 0; i < count; i += FOUR)
        four_keys(vertex, r, &kept[i], &key[i]);
}

COSTS(EIGHT, lanes_8, bits_8, halves_8, half_bits_8, columns_8, costs_of_eight)

__attribute__((target("avx512f,avx512bw,avx512vl,avx512dq"))) static void
keys_widest(const mni_vertex *vertex, uint32_t r, const uint32_t *kept, uint32_t count,
            mni_heap_key *key) {
    for (uint32_t i = 0; i < count; i += EIGHT) {
        halves_4 p[EIGHT];
        lanes_4 q[EIGHT];
        for (int l = 0; l < EIGHT; l++) {
            memcpy(&p[l], vertex[kept[i + l]].p, sizeof p[l]);
            memcpy(&q[l], &vertex[kept[i + l]].c, sizeof q[l]);
        }
        halves_8 p0 = BOTH(p[0], p[4]), p1 = BOTH(p[1], p[5]);
        halves_8 p2 = BOTH(p[2], p[6]), p3 = BOTH(p[3], p[7]);
        lanes_8 q0 = BOTH(q[0], q[4]), q1 = BOTH(q[1], q[5]);
        lanes_8 q2 = BOTH(q[2], q[6]), q3 = BOTH(q[3], q[7]);
        halves_8 xz0 = EVENS(p0, p1), xz1 = EVENS(p2, p3), y0 = ODDS(p0, p1), y1 = ODDS(p2, p3);
        lanes_8 a = EVENS(q0, q1), b = EVENS(q2, q3), c = ODDS(q0, q1), d = ODDS(q2, q3);
        columns_8 k = {.px = LOWS(xz0, xz1),
                       .py = LOWS(y0, y1),
                       .pz = HIGHS(xz0, xz1),
                       .c = LOWS(a, b),
                       .xx = LOWS(c, d),
                       .yy = HIGHS(a, b),
                       .zz = HIGHS(c, d)};
        costs_of_eight(&vertex[r], &k, &kept[i], &key[i]);
    }
}
#endif

mni_collapse_keys *mni_collapse_keys_best(void) {
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq"))
        return keys_widest;
    if (__builtin_cpu_supports("avx2"))
        return keys_wide;
#endif
    return mni_collapse_keys_narrow;
}
