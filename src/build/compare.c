/* Distance between two meshes: samples on each, nearest points on the other. One thread; memory: a
 * tree of boxes over one mesh at a time. */
#include "metanode/build.h"

#include <math.h>
#include <stdlib.h>

#include "distance.h"
#include "sampler.h"
#include "watch.h"

#define SAMPLES_MAX (UINT64_C(1) << 40)
enum { WATCH_EVERY = 4096 }; /* samples */

typedef struct sums {
    double sum, sum_squares, max;
} sums;

/* From samples on `from` to the surface `to`. done: samples before these, of twice as many. */
static mn_code one_way(const mn_mesh *from, const mn_mesh *to, uint64_t samples, uint64_t seed,
                       const mn_watch *watch, uint64_t done, sums *out, mn_status *st) {
    double shift[3]; /* from's origin, seen from to's */
    for (int a = 0; a < 3; a++)
        shift[a] = from->origin[a] - to->origin[a];
    mni_distance *distance = NULL;
    mn_code code = mni_distance_open(to->position, to->corner, to->triangles, &distance, st);
    if (code != MN_OK)
        return code;
    mni_sampler sampler;
    mni_sampler_open(&sampler, from->position, from->corner, from->triangles, samples, seed);
    double point[3], weight[3];
    uint64_t triangle;
    uint32_t hint = 0;
    *out = (sums){0};
    while (code == MN_OK && mni_sampler_next(&sampler, point, &triangle, weight)) {
        if (done++ % WATCH_EVERY == 0)
            code = mni_watch(watch, "measuring", done - 1, 2 * samples, st);
        for (int a = 0; a < 3; a++)
            point[a] += shift[a];
        double d = mni_distance_nearest(distance, point, &hint);
        out->sum += d;
        out->sum_squares += d * d;
        out->max = d > out->max ? d : out->max;
    }
    mni_distance_close(distance);
    return code;
}

mn_code mn_mesh_compare(const mn_mesh *a, const mn_mesh *b, uint64_t samples, uint64_t seed,
                        const mn_watch *watch, mn_compare_result *out, mn_status *st) {
    *out = (mn_compare_result){0};
    if (a->triangles == 0 || b->triangles == 0)
        return mn_fail(st, MN_BAD_INPUT, "a mesh without triangles has no distance");
    if (samples == 0 || samples > SAMPLES_MAX)
        return mn_fail(st, MN_USAGE, "%llu samples: give a number from 1 to 2^40",
                       (unsigned long long)samples);
    sums ab, ba;
    mn_code code = one_way(a, b, samples, 2 * seed, watch, 0, &ab, st);
    if (code == MN_OK)
        code = one_way(b, a, samples, 2 * seed + 1, watch, samples, &ba, st);
    if (code != MN_OK)
        return code;
    double n = (double)samples;
    out->mean_ab = ab.sum / n;
    out->mean_ba = ba.sum / n;
    out->rms = sqrt((ab.sum_squares + ba.sum_squares) / (2 * n));
    out->max = ab.max > ba.max ? ab.max : ba.max;
    out->samples = samples;
    return MN_OK;
}
