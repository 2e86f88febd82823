/* A sponge of rock: a gyroid's labyrinth inside a ball, with a crust and noise of every size down
 * to the grid; closed, one piece but for crumbs, its genus in the hundreds. Radius about 1.
 *
 * The field is positive in the rock. Each cube of the grid is cut into the six tetrahedra along its
 * diagonal (Kuhn), and each of these is crossed by one triangle, two, or none, by the signs at its
 * corners alone: no ambiguous case, so the surface is a closed manifold whatever the field. An edge
 * of a tetrahedron belongs to its lower corner, and goes one of seven ways from there:
 *
 *        y   xy                z     xz  yz  xyz
 *        │ ╱                    in the slice above
 *        o ── x
 *
 * Crossings are numbered as they are first met; numbers of two slices are in memory.
 * Crossings keep away from the ends of their edges: no two vertices at one place, few slivers.
 * Of two slices it is kept which points are in the rock, a bit each, and where edges are crossed,
 * in hash tables: as many as the surface has crossings there, which grows with the slice's edge and
 * not with its area. What the field is at a crossing's ends is worked out once more when they are
 * wanted, unless a cache of fixed size still has it.
 *
 * Secret: field, grid and cases. One thread. Memory: two bits a point of a slice, 16 to 64 bytes a
 * crossing in it, and the cache: 10 MB for 100 million triangles. */
#include "make.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "noise.h"

enum {
    WAYS = 7,
    OCTAVES_MAX = 24,
    PROBE_STEPS = 64,
    PROBE_STEPS_MAX = 256,
    STEPS_MIN = 10,
    SEARCHES = 4,
    CROSSINGS_BITS = 10,
    CACHE_SLOTS = 1 << 17, /* points near the surface, in two slices of 100 million triangles */
};
#define END_MARGIN 0.03  /* of an edge, at both ends */
#define ROUGHNESS 0.20   /* weight of the largest octave, in periods of the gyroid */
#define GAIN 0.62        /* of an octave to the one twice its size */
#define REACH 0.6        /* most that an octave of weight 1 adds, but for a chance of 1e-4 */
#define PERIODS_MIN 1.25 /* of the gyroid along a radius */
#define PERIODS_MAX 4.0
#define FINEST 2.5 /* grid steps: the smallest features */
#define NEAR 1.5   /* grid steps: values of the field nearer to 0 are kept */
#define SEED_TINT 0x74696e74u

typedef struct value {
    uint64_t point; /* its number in the grid, from 1 */
    float field;
} value;

/* Vertex numbers by edge, open addressing; at most half full. */
typedef struct crossings {
    struct {
        uint32_t edge, number; /* point of the slice × WAYS + way; MN_NONE as number: free */
    } * slot;
    uint32_t bits, count; /* 2^bits slots */
} crossings;

typedef struct sponge {
    uint64_t seed;
    uint32_t points; /* of the grid along an edge */
    double low, step, periods, phase[3];
    uint32_t octaves;
    double weight[OCTAVES_MAX],
        rest[OCTAVES_MAX + 1]; /* of octave i; most that those from i on add */
    uint32_t row_words;        /* of 64 points */
    uint64_t *rock[2];         /* slices z and z + 1, at z mod 2: a bit a point */
    crossings crossed[2];      /* the same slices */
    value *cache;              /* CACHE_SLOTS; a point may be at one slot only */
    double *sine[3], *cosine[3];
    mni_make_ply *ply; /* NULL: only count */
    uint64_t vertices, triangles;
    bool no_memory;
} sponge;

static double smooth_min(double a, double b, double width) {
    double gap = a < b ? b - a : a - b, h = gap < width ? 1 - gap / width : 0;
    return (a < b ? a : b) - 0.25 * h * h * width;
}

static double coordinate(const sponge *s, uint32_t i) {
    return s->low + i * s->step;
}

/* Octave by octave, until what is left cannot change the sign, nor that of a neighbour. */
static double field_at(const sponge *s, uint32_t x, uint32_t y, uint32_t z) {
    double p[3] = {coordinate(s, x), coordinate(s, y), coordinate(s, z)};
    double r2 = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], outer = 1 + s->rest[0];
    uint32_t last = s->points - 1;
    if (r2 >= outer * outer || x == 0 || y == 0 || z == 0 || x == last || y == last || z == last)
        return -1;
    double gyroid = s->sine[0][x] * s->cosine[1][y] + s->sine[1][y] * s->cosine[2][z] +
                    s->sine[2][z] * s->cosine[0][x];
    /* a crust holds the labyrinth's cut ends together */
    double body =
        (gyroid + 0.1 + 0.4 * mni_make_step(0.45, 1, r2)) / (2 * MNI_PI * 1.3 * s->periods);
    double f = smooth_min(0.5 * (1 - r2), body, 0.2 / s->periods);
    double frequency = s->periods;
    for (uint32_t i = 0; i < s->octaves && (f < 0 ? -f : f) < s->rest[i] + s->step; i++) {
        double n =
            mni_noise3(s->seed + i, p[0] * frequency + i, p[1] * frequency, p[2] * frequency);
        f += s->weight[i] * (0.3 - 2 * (n < 0 ? -n : n)); /* ridges */
        frequency *= 2;
    }
    return f;
}

static value *cached(const sponge *s, uint32_t x, uint32_t y, uint32_t z, uint64_t *point) {
    *point = ((uint64_t)z * s->points + y) * s->points + x + 1;
    return &s->cache[mni_noise_mix(*point) % CACHE_SLOTS];
}

static float field_again(sponge *s, uint32_t x, uint32_t y, uint32_t z) {
    uint64_t point;
    value *v = cached(s, x, y, z, &point);
    if (v->point != point)
        *v = (value){point, (float)field_at(s, x, y, z)};
    return v->field;
}

static void fill_slice(sponge *s, uint32_t z) {
    uint64_t *rock = s->rock[z % 2], point;
    double near = NEAR * s->step;
    memset(rock, 0, (size_t)s->points * s->row_words * sizeof *rock);
    for (uint32_t y = 0; y < s->points; y++, rock += s->row_words)
        for (uint32_t x = 0; x < s->points; x++) {
            float f = (float)field_at(s, x, y, z);
            rock[x / 64] |= (uint64_t)(f > 0) << x % 64;
            if (s->ply != NULL && (double)f < near && (double)f > -near) {
                value *v = cached(s, x, y, z, &point);
                *v = (value){point, f};
            }
        }
    crossings *c = &s->crossed[z % 2];
    c->count = 0;
    memset(c->slot, 0xff, sizeof *c->slot << c->bits);
}

static uint32_t color(const sponge *s, const double p[3]) {
    static const mni_rgb deep = {0.30, 0.13, 0.09}, sand = {0.80, 0.62, 0.40},
                         lichen = {0.45, 0.50, 0.30};
    double r2 = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
    double tint = mni_noise3(s->seed ^ SEED_TINT, 2 * p[0], 2 * p[1], 2 * p[2]) +
                  0.5 * mni_noise3(s->seed ^ SEED_TINT, 13 * p[0], 13 * p[1], 13 * p[2]);
    mni_rgb c = mni_rgb_mix(deep, sand, mni_make_step(0.35, 1, r2 + 0.15 * tint));
    return mni_rgb_pack(
        mni_rgb_mix(c, lichen, mni_make_step(0.75, 1, r2) * mni_make_step(0.05, 0.45, tint)));
}

/* ---- one cell ------------------------------------------------------------------------------ */

typedef struct cell {
    uint32_t x, y, z;
    uint32_t rock; /* a bit a corner; bit 0 of a corner's number is x, bit 1 y, bit 2 z */
} cell;

static float field_of(sponge *s, const cell *c, uint32_t corner) {
    return field_again(s, c->x + (corner & 1), c->y + (corner >> 1 & 1), c->z + (corner >> 2));
}

static uint32_t new_vertex(sponge *s, const cell *c, uint32_t from, uint32_t to) {
    MN_ASSERT(s->vertices < MN_NONE);
    if (s->ply != NULL) {
        double a = field_of(s, c, from), t = a / (a - (double)field_of(s, c, to)), p[3];
        t = t < END_MARGIN ? END_MARGIN : t > 1 - END_MARGIN ? 1 - END_MARGIN : t;
        const uint32_t at[3] = {c->x, c->y, c->z};
        for (uint32_t i = 0; i < 3; i++)
            p[i] = s->low + s->step * ((double)(at[i] + (from >> i & 1)) +
                                       t * (double)((int)(to >> i & 1) - (int)(from >> i & 1)));
        mni_make_ply_vertex(s->ply, p, color(s, p));
    }
    return (uint32_t)s->vertices++;
}

/* Where the edge is, or belongs. */
static uint32_t slot_of(const crossings *c, uint32_t edge) {
    uint32_t at = (edge * UINT32_C(0x9e3779b1)) >> (32 - c->bits), last = (1u << c->bits) - 1;
    while (c->slot[at].number != MN_NONE && c->slot[at].edge != edge)
        at = (at + 1) & last;
    return at;
}

/* Twice as many slots. */
static void grow(sponge *s, crossings *c) {
    crossings more = {.slot = malloc(sizeof *c->slot << (c->bits + 1)), .bits = c->bits + 1};
    if (more.slot == NULL) {
        s->no_memory = true; /* the march ends with this slice */
        return;
    }
    memset(more.slot, 0xff, sizeof *more.slot << more.bits);
    for (uint32_t i = 0; i < 1u << c->bits; i++)
        if (c->slot[i].number != MN_NONE)
            more.slot[slot_of(&more, c->slot[i].edge)] = c->slot[i];
    more.count = c->count;
    free(c->slot);
    *c = more;
}

/* The vertex where the edge between two corners, low's bits among high's, is crossed. */
static uint32_t crossing(sponge *s, const cell *c, uint32_t a, uint32_t b) {
    uint32_t low = a < b ? a : b, high = a ^ b ^ low;
    uint32_t x = c->x + (low & 1), y = c->y + (low >> 1 & 1), z = c->z + (low >> 2);
    uint32_t edge = (y * s->points + x) * WAYS + (low ^ high) - 1;
    crossings *found = &s->crossed[z % 2];
    uint32_t at = slot_of(found, edge);
    if (found->slot[at].number == MN_NONE) {
        found->slot[at].edge = edge;
        found->slot[at].number = new_vertex(s, c, low, high);
        if (++found->count > 1u << (found->bits - 1) && !s->no_memory) {
            grow(s, found);
            at = slot_of(found, edge);
        }
    }
    return found->slot[at].number;
}

static void face(sponge *s, uint32_t a, uint32_t b, uint32_t c, bool turned) {
    if (s->ply != NULL)
        mni_make_ply_face(s->ply, a, turned ? c : b, turned ? b : c);
    s->triangles++;
}

/* A tetrahedron whose corners v, in this order, are positively oriented ((v1-v0) × (v2-v0) ·
 * (v3-v0) > 0) unless turned. Faces look from the rock, positive, to the air. */
static void cut(sponge *s, const cell *c, const uint32_t v[4], bool turned) {
    /* by the corners in the rock: those, then those in the air, an even permutation of 0 1 2 3 */
    static const uint8_t order[16][4] = {{0, 1, 2, 3}, {0, 1, 2, 3}, {1, 0, 3, 2}, {0, 1, 2, 3},
                                         {2, 0, 1, 3}, {0, 2, 3, 1}, {1, 2, 0, 3}, {0, 1, 2, 3},
                                         {3, 0, 2, 1}, {0, 3, 1, 2}, {1, 3, 2, 0}, {0, 3, 1, 2},
                                         {2, 3, 0, 1}, {0, 2, 3, 1}, {1, 3, 2, 0}, {0, 1, 2, 3}};
    uint32_t rock = 0, count = 0, w[4], e[4];
    for (uint32_t i = 0; i < 4; i++)
        rock |= (c->rock >> v[i] & 1) << i;
    for (uint32_t i = 0; i < 4; i++) {
        w[i] = v[order[rock][i]];
        count += rock >> i & 1;
    }
    switch (count) {
    case 1:
        for (uint32_t i = 0; i < 3; i++)
            e[i] = crossing(s, c, w[0], w[i + 1]);
        face(s, e[0], e[1], e[2], turned);
        break;
    case 2: /* 0 and 1 in the rock, 2 and 3 in the air */
        e[0] = crossing(s, c, w[0], w[2]);
        e[1] = crossing(s, c, w[0], w[3]);
        e[2] = crossing(s, c, w[1], w[3]);
        e[3] = crossing(s, c, w[1], w[2]);
        face(s, e[0], e[1], e[2], turned);
        face(s, e[0], e[2], e[3], turned);
        break;
    case 3:
        for (uint32_t i = 0; i < 3; i++)
            e[i] = crossing(s, c, w[i], w[3]);
        face(s, e[0], e[1], e[2], turned);
        break;
    default:
        break;
    }
}

static void cut_cell(sponge *s, cell *c) {
    /* the paths from corner 0 to corner 7, one axis at a time; the odd permutations are turned */
    static const uint32_t paths[6][4] = {{0, 1, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7},
                                         {0, 1, 5, 7}, {0, 2, 3, 7}, {0, 4, 6, 7}};
    for (int i = 0; i < 6; i++)
        cut(s, c, paths[i], i >= 3);
}

/* A row of cells, 64 at a time: most have all their corners in the rock, or none. */
static void cut_row(sponge *s, cell *c) {
    const uint64_t *rows[4];
    for (uint32_t i = 0; i < 4; i++)
        rows[i] = s->rock[(c->z + (i >> 1)) % 2] + (size_t)(c->y + (i & 1)) * s->row_words;
    for (uint32_t word = 0; word < s->row_words; word++) {
        uint64_t low[4], high[4], some = 0, all = UINT64_MAX; /* corners at x and x + 1 */
        for (uint32_t i = 0; i < 4; i++) {
            uint64_t next = word + 1 < s->row_words ? rows[i][word + 1] : 0;
            low[i] = rows[i][word];
            high[i] = low[i] >> 1 | next << 63;
            some |= low[i] | high[i];
            all &= low[i] & high[i];
        }
        for (uint64_t mixed = some & ~all; mixed != 0; mixed &= mixed - 1) {
            uint32_t bit = (uint32_t)__builtin_ctzll(mixed);
            c->x = 64 * word + bit;
            c->rock = 0;
            for (uint32_t i = 0; i < 4; i++)
                c->rock |= (uint32_t)((low[i] >> bit & 1) | (high[i] >> bit & 1) << 1) << 2 * i;
            cut_cell(s, c);
        }
    }
}

/* ---- the whole ----------------------------------------------------------------------------- */

static void close_grid(sponge *s) {
    free(s->rock[0]);
    free(s->crossed[0].slot);
    free(s->crossed[1].slot);
    free(s->cache);
    free(s->sine[0]);
}

static mn_code open_grid(sponge *s, uint32_t steps, mn_status *st) {
    double size = 1 / s->periods, weight = ROUGHNESS / s->periods;
    double finest = FINEST * 2 / steps;
    for (s->octaves = 0; s->octaves < OCTAVES_MAX && size > finest; s->octaves++) {
        /* the smallest octave fades in, so that the area grows evenly with the steps */
        double share = size / finest - 1;
        s->weight[s->octaves] = weight * (share < 1 ? share : 1);
        weight *= GAIN;
        size /= 2;
    }
    s->rest[s->octaves] = 0;
    for (uint32_t i = s->octaves; i-- > 0;)
        s->rest[i] = s->rest[i + 1] + REACH * s->weight[i];
    s->points = steps + 1;
    s->low = -(1 + s->rest[0]) * (1 + 2.5 / steps);
    s->step = -2 * s->low / steps;
    s->vertices = s->triangles = 0;
    MN_ASSERT((uint64_t)s->points * s->points < UINT32_MAX / WAYS);
    s->row_words = s->points / 64 + 1;
    size_t slice = (size_t)s->points * s->row_words;
    s->rock[0] = malloc(2 * slice * sizeof *s->rock[0]);
    s->cache = calloc(CACHE_SLOTS, sizeof *s->cache);
    s->sine[0] = malloc(6 * (size_t)s->points * sizeof(double));
    for (int i = 0; i < 2; i++)
        s->crossed[i] = (crossings){.slot = malloc(sizeof *s->crossed[i].slot << CROSSINGS_BITS),
                                    .bits = CROSSINGS_BITS};
    s->no_memory = s->rock[0] == NULL || s->cache == NULL || s->sine[0] == NULL ||
                   s->crossed[0].slot == NULL || s->crossed[1].slot == NULL;
    if (s->no_memory) {
        close_grid(s);
        return mn_fail(st, MN_FAILED, "no memory for two slices of %u × %u", s->points, s->points);
    }
    s->rock[1] = s->rock[0] + slice;
    for (uint32_t a = 0; a < 3; a++) {
        s->sine[a] = s->sine[0] + 2 * a * s->points;
        s->cosine[a] = s->sine[a] + s->points;
        for (uint32_t i = 0; i < s->points; i++) {
            double turn = s->periods * coordinate(s, i) + s->phase[a];
            s->sine[a][i] = mni_make_sine(turn);
            s->cosine[a][i] = mni_make_sine(turn + 0.25);
        }
    }
    return MN_OK;
}

static mn_code march(sponge *s, uint32_t steps, const mn_make_desc *desc, mn_status *st) {
    mn_code code = open_grid(s, steps, st);
    if (code != MN_OK)
        return code;
    fill_slice(s, 0);
    for (uint32_t z = 0; z < steps && code == MN_OK; z++) {
        fill_slice(s, z + 1);
        cell c = {.z = z};
        for (c.y = 0; c.y < steps; c.y++)
            cut_row(s, &c);
        if (s->no_memory)
            code = mn_fail(st, MN_FAILED, "no memory for the edges of a slice");
        else if (s->ply != NULL)
            code = mni_make_progress(desc, s->ply, z, steps, st);
    }
    close_grid(s);
    return code;
}

static mn_code count(sponge *s, uint32_t steps, mn_status *st) {
    s->ply = NULL;
    return march(s, steps, NULL, st);
}

/* Small models: counts until the steps fit. *steps and have: a first guess and its count. */
static mn_code search_steps(sponge *s, double wanted, double have, uint32_t *steps, mn_status *st) {
    double n = *steps, error = 1e300;
    mn_code code = MN_OK;
    for (int i = 0; i < SEARCHES && code == MN_OK; i++) {
        double off = have > wanted ? have - wanted : wanted - have;
        if (off < error) {
            error = off;
            *steps = (uint32_t)n;
        }
        n = (double)(uint32_t)(n * sqrt(wanted / have) + 0.5);
        n = n < STEPS_MIN ? STEPS_MIN : n;
        code = count(s, (uint32_t)n, st);
        have = (double)s->triangles;
    }
    return code;
}

/* Steps for that many triangles. Large models are foretold from coarser grids: twice the steps show
 * four times as many, and a bit more, since there is finer noise to see. */
static mn_code find_steps(sponge *s, double wanted, uint32_t *steps, mn_status *st) {
    mn_code code = count(s, PROBE_STEPS, st);
    double have = (double)s->triangles, growth = 4, trend = 1; /* a doubling; of growth itself */
    *steps = PROBE_STEPS;
    if (wanted < growth * have)
        return search_steps(s, wanted, have, steps, st);
    double n = PROBE_STEPS;
    for (; code == MN_OK && n < PROBE_STEPS_MAX && wanted > growth * have;) {
        double before = have;
        code = count(s, (uint32_t)(n *= 2), st);
        have = (double)s->triangles;
        trend = have / before / growth;
        growth = have / before;
    }
    for (; growth * trend * have < wanted; n *= 2)
        have *= growth *= trend;
    growth *= trend;
    double share = sqrt(wanted / have) - 1; /* of the last doubling, about */
    have *= 1 + (growth / 4 - 1) * share;
    *steps = (uint32_t)(n * sqrt(wanted / have) + 0.5);
    return code;
}

mn_code mni_make_isosurface(const mn_make_desc *desc, mni_make_ply *ply, mn_status *st) {
    sponge s = {.seed = mni_noise_mix(desc->seed + 3), .periods = PERIODS_MIN};
    double wanted = (double)desc->triangles;
    /* a period has a dozen grid steps at least, or noise and labyrinth are lost */
    while (s.periods < PERIODS_MAX && 20000 * s.periods * s.periods * s.periods < wanted)
        s.periods += 0.25;
    for (uint32_t a = 0; a < 3; a++)
        s.phase[a] = mni_noise_unit(s.seed, a);
    uint32_t steps = STEPS_MIN;
    mn_code code = find_steps(&s, wanted, &steps, st);
    if (code == MN_OK)
        code = mni_make_ply_begin(ply, MNI_MAKE_UNKNOWN, MNI_MAKE_UNKNOWN, st);
    s.ply = ply;
    return code == MN_OK ? march(&s, steps, desc, st) : code;
}
