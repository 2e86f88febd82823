/* Mountains: a height field over a jittered square grid, 20 × 20 units, y up.
 *
 * Ridged noise whose octaves are pushed about by the slopes of those before them ("Swiss
 * turbulence", de Carpentier): ridges branch like eroded ones, valleys stay smooth at large and
 * rough at small. A slow mask makes ranges and plains, and octaves go down to two grid steps:
 * more triangles show the same mountains with more detail.
 *
 * Secret: the height function and its colours. One thread. Memory: four rows of the grid. */
#include "make.h"

#include <stdlib.h>

#include "noise.h"

#define EXTENT 20.0    /* side of the square, units (kilometres, if one likes) */
#define RANGE_SIZE 6.0 /* wavelength of the largest ridges */
#define HEIGHT 2.6     /* of the highest ridges, about */
#define JITTER 0.2     /* of a grid step; below 0.25 no quad can turn concave */
#define SEED_MASK 0x6d61736bu
#define SEED_SKIN 0x736b696eu
#define SEED_JITTER 0x6a697474u
#define SEED_TINT 0x74696e74u

typedef struct terrain {
    uint64_t columns, rows; /* vertices */
    uint64_t seed;
    double step_x, step_z;
    uint32_t octaves;
    double *ring[4]; /* rows r - 1, r, r + 1 (and a spare): 3 × columns each; row r at r mod 4 */
} terrain;

static double clamp01(double x) {
    return x < 0 ? 0 : x > 1 ? 1 : x;
}

/* Ridges in [0, 2) about. */
static double ridges(const terrain *t, double x, double z) {
    double frequency = 1 / RANGE_SIZE, weight = 1, sum = 0, push_x = 0, push_z = 0;
    for (uint32_t i = 0; i < t->octaves; i++) {
        double slope[2];
        double n = 1.8 * mni_noise2(t->seed + i, (x + push_x) * frequency + 0.31 * i,
                                    (z + push_z) * frequency + 0.71 * i, slope);
        double fold = n < 0 ? -n : n;
        sum += weight * (1 - fold);
        /* downhill from the crease, by a share of this octave's size */
        push_x -= 0.16 / frequency * weight * slope[0] * n;
        push_z -= 0.16 / frequency * weight * slope[1] * n;
        weight *= 0.6 * (0.5 + 0.5 * clamp01(0.75 * sum - 0.1));
        frequency *= 2;
    }
    return sum;
}

static double height(const terrain *t, double x, double z) {
    double none[2];
    double bend = 1.5 * mni_noise2(t->seed ^ SEED_SKIN, x / 9, z / 9, none);
    double plain = mni_noise2(t->seed ^ SEED_MASK, (x + bend) / 11, (z - bend) / 11, none);
    double mask = mni_make_step(-0.5, 0.1, plain);
    double r = ridges(t, x, z);
    return HEIGHT * (0.15 + 0.85 * mask) * r * r * 0.26;
}

static void fill_row(const terrain *t, uint64_t row) {
    double *p = t->ring[row % 4];
    for (uint64_t c = 0; c < t->columns; c++, p += 3) {
        uint64_t at = row * t->columns + c;
        /* border vertices stay on the border */
        double jx = c == 0 || c + 1 == t->columns
                        ? 0
                        : JITTER * (2 * mni_noise_unit(t->seed ^ SEED_JITTER, 2 * at) - 1);
        double jz = row == 0 || row + 1 == t->rows
                        ? 0
                        : JITTER * (2 * mni_noise_unit(t->seed ^ SEED_JITTER, 2 * at + 1) - 1);
        p[0] = ((double)c + jx) * t->step_x - EXTENT / 2;
        p[2] = ((double)row + jz) * t->step_z - EXTENT / 2;
        p[1] = height(t, p[0], p[2]);
    }
}

static uint32_t color(const terrain *t, uint64_t row, uint64_t c) {
    static const mni_rgb meadow = {0.42, 0.47, 0.20}, forest = {0.17, 0.28, 0.13},
                         rock = {0.42, 0.38, 0.34}, scree = {0.55, 0.50, 0.43},
                         snow = {0.95, 0.96, 0.98};
    uint64_t last = t->rows - 1;
    const double *p = t->ring[row % 4] + 3 * c;
    const double *n = t->ring[(row == 0 ? 0 : row - 1) % 4] + 3 * c;
    const double *s = t->ring[(row == last ? last : row + 1) % 4] + 3 * c;
    const double *w = c == 0 ? p : p - 3, *e = c + 1 == t->columns ? p : p + 3;
    double dx = (e[1] - w[1]) / (e[0] - w[0]), dz = (s[1] - n[1]) / (s[2] - n[2]);
    double steep = dx * dx + dz * dz; /* tan² of the slope */
    double none[2];
    double tint = mni_noise2(t->seed ^ SEED_TINT, 1.3 * p[0], 1.3 * p[2], none) +
                  0.5 * mni_noise2(t->seed ^ SEED_TINT, 9 * p[0], 9 * p[2], none);
    double level = p[1] + 0.35 * tint;
    mni_rgb ground = mni_rgb_mix(meadow, forest, mni_make_step(0.15, 0.5, level + 0.3 * tint));
    ground = mni_rgb_mix(ground, scree, mni_make_step(0.85, 1.25, level));
    ground = mni_rgb_mix(ground, rock, mni_make_step(0.4, 1.0, steep));
    ground = mni_rgb_mix(ground, snow,
                         mni_make_step(1.5, 1.95, level) * (1 - mni_make_step(1.6, 4.0, steep)));
    return mni_rgb_pack(ground);
}

static mn_code write_vertices(const mn_make_desc *desc, terrain *t, mni_make_ply *ply,
                              mn_status *st) {
    fill_row(t, 0);
    for (uint64_t r = 0; r < t->rows; r++) {
        if (r + 1 < t->rows)
            fill_row(t, r + 1);
        for (uint64_t c = 0; c < t->columns; c++)
            mni_make_ply_vertex(ply, t->ring[r % 4] + 3 * c, color(t, r, c));
        mn_code code = mni_make_progress(desc, ply, r * t->columns, t->rows * t->columns, st);
        if (code != MN_OK)
            return code;
    }
    return MN_OK;
}

/*   a ─ b      row r, x to the right
 *   │ ╱ │      the diagonal leans one way or the other by a hash
 *   d ─ e      row r + 1, z downwards: (a, d, b) faces up */
static void write_faces(const terrain *t, mni_make_ply *ply) {
    for (uint64_t r = 0; r + 1 < t->rows; r++) {
        for (uint64_t c = 0; c + 1 < t->columns; c++) {
            uint32_t a = (uint32_t)(r * t->columns + c), b = a + 1;
            uint32_t d = a + (uint32_t)t->columns, e = d + 1;
            if (mni_noise_mix(t->seed + a) & 1) {
                mni_make_ply_face(ply, a, d, b);
                mni_make_ply_face(ply, b, d, e);
            } else {
                mni_make_ply_face(ply, a, d, e);
                mni_make_ply_face(ply, a, e, b);
            }
        }
    }
}

mn_code mni_make_terrain(const mn_make_desc *desc, mni_make_ply *ply, mn_status *st) {
    uint64_t side = mni_make_sqrt((double)desc->triangles / 2);
    uint64_t rows = side < 1 ? 1 : side; /* of quads */
    uint64_t columns = (desc->triangles + rows) / (2 * rows);
    columns = columns < 1 ? 1 : columns;
    terrain t = {.columns = columns + 1, .rows = rows + 1, .seed = mni_noise_mix(desc->seed + 1)};
    t.step_x = EXTENT / (double)columns;
    t.step_z = EXTENT / (double)rows;
    for (double size = RANGE_SIZE; size > 2 * t.step_z; size /= 2)
        t.octaves++;
    double *memory = malloc(4 * 3 * t.columns * sizeof *memory);
    if (memory == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a row of %llu vertices",
                       (unsigned long long)t.columns);
    for (int i = 0; i < 4; i++)
        t.ring[i] = memory + (uint64_t)i * 3 * t.columns;
    mn_code code = mni_make_ply_begin(ply, t.columns * t.rows, 2 * rows * columns, st);
    if (code == MN_OK)
        code = write_vertices(desc, &t, ply, st);
    if (code == MN_OK)
        write_faces(&t, ply);
    free(memory);
    return code;
}
