/* See node_bounds.h. Hidden here: what is added for rounding. */
#include "node_bounds.h"

#include <math.h>

#include "block.h"

/* acosf near 1 turns a last bit of the dot product into this much. */
#define NORMAL_ERROR_RAD 1e-3f

static double square_of_distance(const float *a, const float *b) {
    double sum = 0;
    for (int i = 0; i < 3; i++)
        sum += ((double)a[i] - b[i]) * ((double)a[i] - b[i]);
    return sum;
}

/* Rises with the square. */
static float length_of(double square) {
    return nextafterf((float)sqrt(square), INFINITY);
}

mni_node_bounds mni_leaf_bounds(const mni_surface *s, const float *normal, uint32_t v) {
    const mni_fan *f = &s->vertex[v].fan;
    const float *p = s->vertex[v].p;
    float axis[3] = {0, 0, 0}, least = 1;
    double farthest = 0;
    for (uint32_t i = 0; i < f->count; i++) {
        uint32_t t = s->pool[f->first + i];
        mni_corner c = mni_simplex_corner(&s->simplex[t], v);
        double a = square_of_distance(p, s->vertex[c.next].p),
               b = square_of_distance(p, s->vertex[c.previous].p);
        a = a > b ? a : b;
        farthest = a > farthest ? a : farthest;
        for (int j = 0; j < 3; j++)
            axis[j] += normal[3 * (size_t)t + j];
    }
    float length = sqrtf(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    for (int j = 0; j < 3; j++)
        axis[j] = length > 0 ? axis[j] / length : j == 2;
    for (uint32_t i = 0; i < f->count; i++) {
        const float *n = &normal[3 * (size_t)s->pool[f->first + i]];
        float cosine = axis[0] * n[0] + axis[1] * n[1] + axis[2] * n[2];
        if (n[0] == 0 && n[1] == 0 && n[2] == 0) /* no area, no normal, no bound */
            cosine = -1;
        least = cosine < least ? cosine : least;
    }
    float angle = least <= -1 ? (float)M_PI : acosf(least) + NORMAL_ERROR_RAD;
    const float radius = f->count > 0 ? length_of(farthest) : 0;
    return (mni_node_bounds){radius, mn_cone_make(axis, angle)};
}

mni_node_bounds mni_parent_bounds(const float left_p[3], mni_node_bounds left,
                                  const float right_p[3], mni_node_bounds right) {
    float reach =
        nextafterf(length_of(square_of_distance(left_p, right_p)) + right.radius, INFINITY);
    return (mni_node_bounds){mni_radius_up(left.radius > reach ? left.radius : reach),
                             mn_cone_merge(left.cone, right.cone)};
}
