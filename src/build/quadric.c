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

typedef double lanes __attribute__((vector_size(32)));
typedef uint64_t bits __attribute__((vector_size(32)));
typedef float halves __attribute__((vector_size(16)));
enum { LANES = 4 };

/* Of rows a and b: a0 b0 a2 b2; a1 b1 a3 b3; a0 a1 b0 b1; a2 a3 b2 b3. */
#define EVEN(a, b) __builtin_shufflevector(a, b, 0, 4, 2, 6)
#define ODD(a, b) __builtin_shufflevector(a, b, 1, 5, 3, 7)
#define LOW(a, b) __builtin_shufflevector(a, b, 0, 1, 4, 5)
#define HIGH(a, b) __builtin_shufflevector(a, b, 2, 3, 6, 7)

_Static_assert(offsetof(mni_vertex, zz) == offsetof(mni_vertex, c) + 3 * sizeof(double) &&
                   offsetof(mni_vertex, value) == 3 * sizeof(float),
               "a place and a half of the quadric are a load each");

/* As mni_collapse_cost has it, operation by operation. What is asked of neighbours comes in as rows
 * and is turned into columns: to put it together number by number takes longer than what is done
 * with it. */
static inline __attribute__((always_inline)) void four_keys(const mni_vertex *r,
                                                            const mni_vertex *const k[LANES],
                                                            const uint32_t kept[LANES],
                                                            mni_heap_key key[LANES]) {
    halves p[LANES];
    lanes q[LANES];
    for (int l = 0; l < LANES; l++) {
        memcpy(&p[l], k[l]->p, sizeof k[l]->p + sizeof k[l]->value);
        memcpy(&q[l], &k[l]->c, sizeof q[l]);
    }
    halves xz0 = EVEN(p[0], p[1]), xz1 = EVEN(p[2], p[3]);
    halves y0 = ODD(p[0], p[1]), y1 = ODD(p[2], p[3]);
    lanes x = __builtin_convertvector(LOW(xz0, xz1), lanes) - (double)r->p[0];
    lanes y = __builtin_convertvector(LOW(y0, y1), lanes) - (double)r->p[1];
    lanes z = __builtin_convertvector(HIGH(xz0, xz1), lanes) - (double)r->p[2];
    lanes a = EVEN(q[0], q[1]), b = EVEN(q[2], q[3]);
    lanes c = ODD(q[0], q[1]), d = ODD(q[2], q[3]);
    lanes of_k = LOW(a, b), xx = LOW(c, d), yy = HIGH(a, b), zz = HIGH(c, d);
    lanes length2 = x * x + y * y + z * z;
    lanes share = MNI_LENGTH_SHARE * ((r->xx + r->yy + r->zz) + (xx + yy + zz));
    lanes value =
        r->xx * x * x + r->yy * y * y + r->zz * z * z +
        2 * (r->xy * x * y + r->xz * x * z + r->yz * y * z + r->x * x + r->y * y + r->z * z) + r->c;
    value = (lanes)((bits)value & (bits)(value > 0));
    halves cost = __builtin_convertvector(value + of_k + share * length2, halves);
    mni_four of, cost_bits;
    memcpy(&of, kept, sizeof of);
    memcpy(&cost_bits, &cost, sizeof cost_bits);
    bits keys = __builtin_convertvector(cost_bits, bits) << 32 | __builtin_convertvector(of, bits);
    memcpy(key, &keys, sizeof keys);
}

static inline __attribute__((always_inline)) void keys_of(const mni_vertex *vertex, uint32_t r,
                                                          const uint32_t *kept, uint32_t count,
                                                          mni_heap_key *key) {
    for (uint32_t i = 0; i < count; i += LANES) {
        const mni_vertex *k[LANES];
        for (uint32_t l = 0; l < LANES; l++)
            k[l] = &vertex[kept[i + l]];
        four_keys(&vertex[r], k, &kept[i], &key[i]);
    }
}

void mni_collapse_keys_narrow(const mni_vertex *vertex, uint32_t r, const uint32_t *kept,
                              uint32_t count, mni_heap_key *key) {
    keys_of(vertex, r, kept, count, key);
}

#ifdef __x86_64__
__attribute__((target("avx2"))) static void keys_wide(const mni_vertex *vertex, uint32_t r,
                                                      const uint32_t *kept, uint32_t count,
                                                      mni_heap_key *key) {
    keys_of(vertex, r, kept, count, key);
}
#endif

mni_collapse_keys *mni_collapse_keys_best(void) {
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2"))
        return keys_wide;
#endif
    return mni_collapse_keys_narrow;
}
