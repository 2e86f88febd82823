/* Gradient noise: each lattice point has a random slope, hashed from its integer coordinates and
 * the seed; between lattice points the slopes' planes are blended with a fade whose first and
 * second derivatives vanish at the ends, so that normals show no lattice. Secret: the hash and the
 * fade. Any thread; owns nothing. */
#include "noise.h"

/* Odd constants, far from each other: a lattice step adds one to the hash before it is mixed. */
#define STEP_X UINT64_C(0x9e3779b97f4a7c15)
#define STEP_Y UINT64_C(0xc2b2ae3d27d4eb4f)
#define STEP_Z UINT64_C(0x165667b19e3779f9)

static double fade(double t) {
    return t * t * t * (t * (t * 6 - 15) + 10);
}

static double fade_slope(double t) {
    return 30 * t * t * (t * (t - 2) + 1);
}

double mni_noise2(uint64_t seed, double x, double y, double gradient[2]) {
    int64_t ix = mni_noise_floor(x), iy = mni_noise_floor(y);
    double fx = x - (double)ix, fy = y - (double)iy;
    uint64_t base = seed + (uint64_t)ix * STEP_X + (uint64_t)iy * STEP_Y;
    double gx[4], gy[4], v[4];
    for (int i = 0; i < 4; i++) {
        uint64_t h = mni_noise_mix(base + (i & 1 ? STEP_X : 0) + (i & 2 ? STEP_Y : 0));
        gx[i] = (double)(int32_t)(uint32_t)h * 0x1p-31;
        gy[i] = (double)(int32_t)(uint32_t)(h >> 32) * 0x1p-31;
        v[i] = gx[i] * (fx - (i & 1)) + gy[i] * (fy - (i >> 1));
    }
    double u = fade(fx), w = fade(fy);
    double k1 = v[1] - v[0], k2 = v[2] - v[0], k3 = v[0] - v[1] - v[2] + v[3];
    gradient[0] = gx[0] + u * (gx[1] - gx[0]) + w * (gx[2] - gx[0]) +
                  u * w * (gx[0] - gx[1] - gx[2] + gx[3]) + fade_slope(fx) * (k1 + w * k3);
    gradient[1] = gy[0] + u * (gy[1] - gy[0]) + w * (gy[2] - gy[0]) +
                  u * w * (gy[0] - gy[1] - gy[2] + gy[3]) + fade_slope(fy) * (k2 + u * k3);
    return v[0] + u * k1 + w * k2 + u * w * k3;
}

/* Three slopes of 21 bits each from one hash, times the offset. */
static double corner3(uint64_t h, double x, double y, double z) {
    double gx = (double)(int32_t)((uint32_t)h << 11);
    double gy = (double)(int32_t)((uint32_t)(h >> 21) << 11);
    double gz = (double)(int32_t)((uint32_t)(h >> 42) << 11);
    return (gx * x + gy * y + gz * z) * 0x1p-31;
}

double mni_noise3(uint64_t seed, double x, double y, double z) {
    int64_t ix = mni_noise_floor(x), iy = mni_noise_floor(y), iz = mni_noise_floor(z);
    double fx = x - (double)ix, fy = y - (double)iy, fz = z - (double)iz;
    uint64_t base = seed + (uint64_t)ix * STEP_X + (uint64_t)iy * STEP_Y + (uint64_t)iz * STEP_Z;
    double u = fade(fx), v = fade(fy), layer[2];
    for (int i = 0; i < 2; i++) {
        uint64_t h = base + (i ? STEP_Z : 0);
        double dz = fz - i;
        double a = corner3(mni_noise_mix(h), fx, fy, dz);
        double b = corner3(mni_noise_mix(h + STEP_X), fx - 1, fy, dz);
        double c = corner3(mni_noise_mix(h + STEP_Y), fx, fy - 1, dz);
        double d = corner3(mni_noise_mix(h + STEP_X + STEP_Y), fx - 1, fy - 1, dz);
        double ab = a + u * (b - a), cd = c + u * (d - c);
        layer[i] = ab + v * (cd - ab);
    }
    return layer[0] + fade(fz) * (layer[1] - layer[0]);
}

double mni_noise_fractal3(uint64_t seed, const double p[3], double frequency, double gain,
                          uint32_t octaves) {
    double sum = 0, weight = 1;
    for (uint32_t i = 0; i < octaves; i++) {
        /* offsets, so that the octaves' lattices do not meet at the origin */
        double shift = 0.37 * (i + 1);
        sum += weight * mni_noise3(seed + i, p[0] * frequency + shift, p[1] * frequency + 2 * shift,
                                   p[2] * frequency + 3 * shift);
        weight *= gain;
        frequency *= 2;
    }
    return sum;
}
