/* Points spread evenly over a surface, by area: stratified, in the order of the triangles, so that
 * neighbours in time are neighbours in space. One thread; reads the caller's arrays. */
#ifndef MNI_SAMPLER_H
#define MNI_SAMPLER_H

#include <stdbool.h>
#include <stdint.h>

typedef struct mni_sampler {
    const float *position;
    const uint32_t *corner;
    uint64_t triangles, samples, seed;
    double area;              /* of all triangles; 0: corners are taken in turn instead */
    uint64_t sample, current; /* next sample; triangle it may lie on */
    double before, here;      /* area of the triangles before the current one; of that */
} mni_sampler;

/* Same arguments, same samples. */
void mni_sampler_open(mni_sampler *sampler, const float *position, const uint32_t *corner,
                      uint64_t triangles, uint64_t samples, uint64_t seed);
/* false: `samples` of them have been handed out. weight: of the triangle's three corners. */
bool mni_sampler_next(mni_sampler *sampler, double point[3], uint64_t *triangle, double weight[3]);

#endif
