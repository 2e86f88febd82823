/* A rocky planetoid: the surface of a cube's lattice blown up to a sphere (closed, genus 0, no
 * poles), pushed in and out along its radius by lumps, ridges and craters of every size down to
 * the lattice's step. Mean radius 1.
 *
 *        ┌──────┐ layer n:  (n+1)² points       Points are numbered layer by layer in k, and their
 *       ╱      ╱│ layer k:  4n points, a ring   number is a formula: nothing is kept in memory.
 *      ┌──────┐ │
 *      │      │╱
 *      └──────┘   layer 0:  (n+1)² points
 *
 * Secret: the numbering and the relief. One thread. */
#include "make.h"

#include <math.h>

#include "noise.h"

#define JITTER 0.2 /* of a lattice step */
#define SEED_JITTER 0x6a697474u
#define SEED_RIDGE 0x72696467u
#define SEED_CRATER 0x63726174u
#define SEED_TINT 0x74696e74u

typedef struct planetoid {
    uint64_t n; /* lattice steps along a cube's edge */
    uint64_t seed;
    uint32_t octaves; /* of size 1, 1/2, … down to two lattice steps */
} planetoid;

/* The place of a border point of an (n+1)² square on its ring, counter-clockwise from (0, 0). */
static uint64_t ring_place(uint64_t n, uint64_t i, uint64_t j) {
    if (j == 0)
        return i;
    if (i == n)
        return n + j;
    if (j == n)
        return 3 * n - i;
    return 4 * n - j;
}

static void ring_point(uint64_t n, uint64_t place, uint64_t *i, uint64_t *j) {
    uint64_t side = place / n, along = place % n;
    *i = side == 0 ? along : side == 1 ? n : side == 2 ? n - along : 0;
    *j = side == 0 ? 0 : side == 1 ? along : side == 2 ? n : n - along;
}

static uint32_t number(uint64_t n, uint64_t i, uint64_t j, uint64_t k) {
    uint64_t cap = (n + 1) * (n + 1);
    if (k == 0)
        return (uint32_t)(j * (n + 1) + i);
    if (k == n)
        return (uint32_t)(cap + (n - 1) * 4 * n + j * (n + 1) + i);
    return (uint32_t)(cap + (k - 1) * 4 * n + ring_place(n, i, j));
}

/* From the lattice to the unit sphere, with cells of nearly one size (Nowell's map: no
 * trigonometry, so the same bits everywhere). Coordinates at the cube's faces stay there, the
 * others move a bit. */
static void direction(const planetoid *s, const uint64_t lattice[3], double d[3]) {
    uint64_t at = number(s->n, lattice[0], lattice[1], lattice[2]);
    double u[3], q[3];
    for (uint64_t i = 0; i < 3; i++) {
        double x = (double)lattice[i];
        if (lattice[i] > 0 && lattice[i] < s->n)
            x += JITTER * (2 * mni_noise_unit(s->seed ^ SEED_JITTER, 3 * at + i) - 1);
        u[i] = 2 * x / (double)s->n - 1;
        q[i] = u[i] * u[i];
    }
    d[0] = u[0] * sqrt(1 - q[1] / 2 - q[2] / 2 + q[1] * q[2] / 3);
    d[1] = u[1] * sqrt(1 - q[2] / 2 - q[0] / 2 + q[2] * q[0] / 3);
    d[2] = u[2] * sqrt(1 - q[0] / 2 - q[1] / 2 + q[0] * q[1] / 3);
}

/* Of one crater, by the distance from its middle in crater radii: a bowl, a rim, nothing. In units
 * of the radius. */
static double bowl(double t2) {
    if (t2 >= 2.25)
        return 0;
    double t = sqrt(t2);
    if (t < 1)
        return 0.30 * (t2 * 1.25 - 1);
    double fall = (1.5 - t) * 2; /* 1 at the rim, 0 outside */
    return 0.075 * fall * fall * (3 - 2 * fall) * fall;
}

/* Craters of one size: each cell of a lattice has at most one, small enough that only the eight
 * cells about a point can reach it. */
static double craters(uint64_t seed, const double p[3], double frequency, double density) {
    double x[3], sum = 0;
    int64_t corner[3];
    for (int i = 0; i < 3; i++) {
        x[i] = p[i] * frequency + 0.123;
        corner[i] = mni_noise_floor(x[i] - 0.5);
    }
    for (int cell = 0; cell < 8; cell++) {
        int64_t c[3];
        for (int i = 0; i < 3; i++)
            c[i] = corner[i] + (cell >> i & 1);
        uint64_t h = mni_noise_mix(seed + (uint64_t)c[0] * UINT64_C(0x9e3779b97f4a7c15) +
                                   (uint64_t)c[1] * UINT64_C(0xc2b2ae3d27d4eb4f) +
                                   (uint64_t)c[2] * UINT64_C(0x165667b19e3779f9));
        if ((double)(h & 0xffff) * 0x1p-16 >= density)
            continue;
        /* reach 1.5 × 0.45 and a middle within 0.3 of the cell's: below 1, so eight cells do */
        double radius = 0.15 + 0.30 * (double)(h >> 16 & 0xff) * 0x1p-8, t2 = 0;
        for (int i = 0; i < 3; i++) {
            double off = 0.6 * ((double)(h >> (24 + 12 * i) & 0xfff) * 0x1p-12 - 0.5);
            double middle = (double)c[i] + 0.5 + off;
            t2 += (x[i] - middle) * (x[i] - middle);
        }
        sum += radius * bowl(t2 / (radius * radius));
    }
    return sum / frequency;
}

static double relief(const planetoid *s, const double d[3]) {
    double lumps = mni_noise_fractal3(s->seed, d, 0.9, 0.5, 3);
    double push = 0.25 * mni_noise3(s->seed ^ SEED_RIDGE, 1.7 * d[0], 1.7 * d[1], 1.7 * d[2]);
    double p[3] = {d[0] + push, d[1] - push, d[2] + push};
    double frequency = 2, weight = 1, ridge = 0, pits = 0;
    for (uint32_t i = 0; i < s->octaves; i++) {
        double n = 1.7 * mni_noise3((s->seed ^ SEED_RIDGE) + i, p[0] * frequency, p[1] * frequency,
                                    p[2] * frequency);
        ridge += weight * (0.5 - (n < 0 ? -n : n));
        pits += craters((s->seed ^ SEED_CRATER) + i, p, 1.5 * frequency, 0.55);
        weight *= 0.47;
        frequency *= 2;
    }
    return 0.42 * lumps + 0.05 * ridge + 0.9 * pits;
}

static void write_vertex(const planetoid *s, uint64_t i, uint64_t j, uint64_t k,
                         mni_make_ply *ply) {
    static const mni_rgb dust = {0.56, 0.50, 0.44}, dark = {0.27, 0.24, 0.23},
                         rust = {0.55, 0.38, 0.28};
    const uint64_t lattice[3] = {i, j, k};
    double d[3], p[3];
    direction(s, lattice, d);
    double r = 1 + relief(s, d);
    for (int a = 0; a < 3; a++)
        p[a] = r * d[a];
    double tint = mni_noise_fractal3(s->seed ^ SEED_TINT, d, 2.2, 0.6, 5);
    mni_rgb ground = mni_rgb_mix(dark, dust, mni_make_step(0.75, 1.1, r + 0.25 * tint));
    ground = mni_rgb_mix(ground, rust, mni_make_step(0.1, 0.6, tint));
    mni_make_ply_vertex(ply, p, mni_rgb_pack(ground));
}

static mn_code write_vertices(const mn_make_desc *desc, const planetoid *s, mni_make_ply *ply,
                              mn_status *st) {
    uint64_t n = s->n;
    for (uint64_t k = 0; k <= n; k++) {
        bool cap = k == 0 || k == n;
        for (uint64_t j = 0; cap && j <= n; j++) {
            for (uint64_t i = 0; i <= n; i++)
                write_vertex(s, i, j, k, ply);
            mn_code code = mni_make_progress(desc, ply, j + (k == n ? 5 * n : 0), 6 * n, st);
            if (code != MN_OK)
                return code;
        }
        for (uint64_t place = 0; !cap && place < 4 * n; place++) {
            uint64_t i, j;
            ring_point(n, place, &i, &j);
            write_vertex(s, i, j, k, ply);
        }
        mn_code code = mni_make_progress(desc, ply, n + 4 * k, 6 * n, st);
        if (code != MN_OK)
            return code;
    }
    return MN_OK;
}

/* a, b, c, d: a square counter-clockwise seen from outside. */
static void write_square(const planetoid *s, mni_make_ply *ply, uint32_t a, uint32_t b, uint32_t c,
                         uint32_t d) {
    if (mni_noise_mix(s->seed + a) & 1) {
        mni_make_ply_face(ply, a, b, c);
        mni_make_ply_face(ply, a, c, d);
    } else {
        mni_make_ply_face(ply, a, b, d);
        mni_make_ply_face(ply, b, c, d);
    }
}

static void write_faces(const planetoid *s, mni_make_ply *ply) {
    uint64_t n = s->n;
    for (uint64_t j = 0; j < n; j++) /* layer 0 looks down: clockwise in (i, j) */
        for (uint64_t i = 0; i < n; i++)
            write_square(s, ply, number(n, i, j, 0), number(n, i, j + 1, 0),
                         number(n, i + 1, j + 1, 0), number(n, i + 1, j, 0));
    for (uint64_t k = 0; k < n; k++)
        for (uint64_t place = 0; place < 4 * n; place++) {
            uint64_t i, j, i2, j2;
            ring_point(n, place, &i, &j);
            ring_point(n, (place + 1) % (4 * n), &i2, &j2);
            write_square(s, ply, number(n, i, j, k), number(n, i2, j2, k), number(n, i2, j2, k + 1),
                         number(n, i, j, k + 1));
        }
    for (uint64_t j = 0; j < n; j++)
        for (uint64_t i = 0; i < n; i++)
            write_square(s, ply, number(n, i, j, n), number(n, i + 1, j, n),
                         number(n, i + 1, j + 1, n), number(n, i, j + 1, n));
}

mn_code mni_make_sphere(const mn_make_desc *desc, mni_make_ply *ply, mn_status *st) {
    uint64_t n = mni_make_sqrt((double)desc->triangles / 12);
    planetoid s = {.n = n < 1 ? 1 : n, .seed = mni_noise_mix(desc->seed + 2)};
    for (double size = 0.5; size > 4.0 / (double)s.n; size /= 2) /* step: about 2 / n */
        s.octaves++;
    mn_code code = mni_make_ply_begin(ply, 6 * s.n * s.n + 2, 12 * s.n * s.n, st);
    if (code == MN_OK)
        code = write_vertices(desc, &s, ply, st);
    if (code == MN_OK)
        write_faces(&s, ply);
    return code;
}
