/* Gradient noise from hashes: the same bits on every machine (integers, and double arithmetic
 * without libm or fused operations). Pure; any thread. */
#ifndef MNI_NOISE_H
#define MNI_NOISE_H

#include <stdint.h>

/* A well mixed 64-bit hash. */
static inline uint64_t mni_noise_mix(uint64_t h) {
    h ^= h >> 32;
    h *= UINT64_C(0xd6e8feb86659fd93);
    h ^= h >> 29;
    h *= UINT64_C(0xa0761d6478bd642f);
    return h ^ (h >> 32);
}

/* Uniform in [0, 1), a function of seed and index. */
static inline double mni_noise_unit(uint64_t seed, uint64_t index) {
    return (double)(mni_noise_mix(seed + index * UINT64_C(0x9e3779b97f4a7c15)) >> 11) * 0x1p-53;
}

/* Rounds down; |x| < 2^62. (floor() is a call without SSE4.1.) */
static inline int64_t mni_noise_floor(double x) {
    int64_t i = (int64_t)x;
    return i - (x < (double)i);
}

/* Smooth, mean 0, features about 1 apart; root mean square about 0.25 in the plane and 0.2 in
 * space, rarely beyond three times that. */
double mni_noise2(uint64_t seed, double x, double y, double gradient[2]);
double mni_noise3(uint64_t seed, double x, double y, double z);

/* Sum of octaves of mni_noise3, each of half the size and `gain` times the weight of the last. */
double mni_noise_fractal3(uint64_t seed, const double p[3], double frequency, double gain,
                          uint32_t octaves);

#endif
