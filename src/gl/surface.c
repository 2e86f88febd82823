/* The triangles of a front, as an index list, and smooth normals.
 *
 * Hides how a front's slots become what a renderer draws. Normals are made anew of the active
 * triangles: what is stored with a node describes the input beneath it, not the surface that is
 * drawn. Weights are the areas, so that the slivers of a coarse front hardly count.
 * Pure: any thread, no memory of its own; O(slots). */
#include "parts.h"

#include <math.h>
#include <string.h>

uint32_t mni_surface_gather(const mn_front *front, uint32_t *index, float *normal) {
    uint32_t triangles = 0;
    memset(normal, 0, sizeof(float) * 3 * front->node_slots);
    for (uint32_t s = 0; s < front->simplex_slots; s++) {
        const uint32_t *v = front->simplex_node + 3 * (size_t)s;
        if (v[0] == MN_NONE || v[2] == MN_NONE)
            continue;
        memcpy(index + 3 * (size_t)triangles++, v, 3 * sizeof *v);
        const float *a = front->position + 3 * (size_t)v[0];
        const float *b = front->position + 3 * (size_t)v[1];
        const float *c = front->position + 3 * (size_t)v[2];
        float e[3], f[3];
        for (int i = 0; i < 3; i++) {
            e[i] = b[i] - a[i];
            f[i] = c[i] - a[i];
        }
        const float n[3] = {e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2],
                            e[0] * f[1] - e[1] * f[0]};
        for (int k = 0; k < 3; k++)
            for (int i = 0; i < 3; i++)
                normal[3 * (size_t)v[k] + (size_t)i] += n[i];
    }
    return triangles;
}

uint32_t mni_surface_pack(const float normal[3]) {
    /* Doubles: the cross products of a tiny model are below the smallest float when squared. */
    const double x = normal[0], y = normal[1], z = normal[2];
    const double length = sqrt(x * x + y * y + z * z);
    if (!(length > 0) || !isfinite(length))
        return 0;
    const double scale = 511 / length;
    return ((uint32_t)lrint(x * scale) & 1023) | ((uint32_t)lrint(y * scale) & 1023) << 10 |
           ((uint32_t)lrint(z * scale) & 1023) << 20;
}
