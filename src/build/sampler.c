/* Area-uniform samples: sample i lies at a random place in the i-th of `samples` equal shares of
 * the area. Secret: how. */
#include "sampler.h"

#include <math.h>

#include "noise.h"

static double triangle_area(const mni_sampler *s, uint64_t triangle) {
    const float *v[3];
    double a[3], b[3];
    for (int i = 0; i < 3; i++)
        v[i] = s->position + 3 * (uint64_t)s->corner[3 * triangle + (uint64_t)i];
    for (int i = 0; i < 3; i++) {
        a[i] = (double)v[1][i] - (double)v[0][i];
        b[i] = (double)v[2][i] - (double)v[0][i];
    }
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2],
           z = a[0] * b[1] - a[1] * b[0];
    return 0.5 * sqrt(x * x + y * y + z * z);
}

void mni_sampler_open(mni_sampler *s, const float *position, const uint32_t *corner,
                      uint64_t triangles, uint64_t samples, uint64_t seed) {
    *s = (mni_sampler){.position = position,
                       .corner = corner,
                       .triangles = triangles,
                       .samples = samples,
                       .seed = mni_noise_mix(seed)};
    for (uint64_t t = 0; t < triangles; t++)
        s->area += triangle_area(s, t);
    s->here = triangles > 0 ? triangle_area(s, 0) : 0;
}

bool mni_sampler_next(mni_sampler *s, double point[3], uint64_t *triangle, double weight[3]) {
    if (s->sample == s->samples || s->triangles == 0)
        return false;
    double u = mni_noise_unit(s->seed, 3 * s->sample);
    double v = mni_noise_unit(s->seed, 3 * s->sample + 1);
    if (s->area > 0) {
        double stratum = (double)s->sample + mni_noise_unit(s->seed, 3 * s->sample + 2);
        double target = s->area * (stratum / (double)s->samples);
        while (s->before + s->here <= target && s->current + 1 < s->triangles) {
            s->before += s->here;
            s->here = triangle_area(s, ++s->current);
        }
    } else {
        s->current = s->sample / 3 % s->triangles;
        u = s->sample % 3 == 1;
        v = s->sample % 3 == 2;
    }
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    s->sample++;
    weight[0] = 1 - u - v;
    weight[1] = u;
    weight[2] = v;
    const uint32_t *c = s->corner + 3 * s->current;
    for (int a = 0; a < 3; a++)
        point[a] = weight[0] * s->position[3 * (uint64_t)c[0] + (uint64_t)a] +
                   weight[1] * s->position[3 * (uint64_t)c[1] + (uint64_t)a] +
                   weight[2] * s->position[3 * (uint64_t)c[2] + (uint64_t)a];
    *triangle = s->current;
    return true;
}
