/* Quadrics (Garland and Heckbert): the sum of squared distances to planes, weighted with area.
 * Along an edge with one triangle a wall stands on it, so that boundaries keep their shape. */
#include "simplify.h"

#include <math.h>

/* A plane through the quadric's own vertex, from where distances count: no linear part. */
static void add_plane(mni_vertex *q, const double n[3], double weight) {
    q->xx += weight * n[0] * n[0];
    q->xy += weight * n[0] * n[1];
    q->xz += weight * n[0] * n[2];
    q->yy += weight * n[1] * n[1];
    q->yz += weight * n[1] * n[2];
    q->zz += weight * n[2] * n[2];
}

static void edge_of(const float *from, const float *to, double e[3]) {
    for (int i = 0; i < 3; i++)
        e[i] = (double)to[i] - from[i];
}

static void cross(const double *a, const double *b, double n[3]) {
    n[0] = a[1] * b[2] - a[2] * b[1];
    n[1] = a[2] * b[0] - a[0] * b[2];
    n[2] = a[0] * b[1] - a[1] * b[0];
}

/* Makes n a unit vector and returns its length; 0: it has none. */
static double unit(double n[3]) {
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (length > 0)
        for (int i = 0; i < 3; i++)
            n[i] /= length;
    return length;
}

void mni_quadric_wall(mni_surface *surface, uint32_t v, uint32_t w) {
    uint32_t count;
    mni_vertex *vertex = surface->vertex;
    bool v_shorter = vertex[v].fan.count <= vertex[w].fan.count;
    const uint32_t *fan = mni_surface_fan(surface, v_shorter ? v : w, &count);
    const uint32_t other = v_shorter ? w : v;
    for (uint32_t f = 0; f < count; f++) {
        const uint32_t *c = surface->simplex[fan[f]].v;
        if (c[0] != other && c[1] != other && c[2] != other)
            continue;
        double e1[3], e2[3], normal[3], along[3], wall[3];
        edge_of(vertex[c[0]].p, vertex[c[1]].p, e1);
        edge_of(vertex[c[0]].p, vertex[c[2]].p, e2);
        cross(e1, e2, normal);
        edge_of(vertex[v].p, vertex[w].p, along);
        cross(along, normal, wall);
        double length2 = along[0] * along[0] + along[1] * along[1] + along[2] * along[2];
        if (unit(wall) > 0)
            add_plane(&vertex[v], wall, length2);
    }
}

/* Of a triangle: its unit normal; returns its area. */
static double plane_of(const mni_surface *surface, uint32_t t, double n[3]) {
    const mni_vertex *vertex = surface->vertex;
    const uint32_t *c = surface->simplex[t].v;
    double e1[3], e2[3];
    edge_of(vertex[c[0]].p, vertex[c[1]].p, e1);
    edge_of(vertex[c[0]].p, vertex[c[2]].p, e2);
    cross(e1, e2, n);
    return 0.5 * unit(n);
}

void mni_quadrics_fill(mni_surface *surface) {
    for (uint32_t t = 0; t < surface->triangles; t++) {
        double n[3], area = plane_of(surface, t, n);
        if (area > 0)
            for (int i = 0; i < 3; i++)
                add_plane(&surface->vertex[surface->simplex[t].v[i]], n, area);
    }
}

void mni_quadric_add_triangle(mni_surface *surface, uint32_t v, uint32_t t) {
    double n[3], area = plane_of(surface, t, n);
    if (area > 0)
        add_plane(&surface->vertex[v], n, area);
}
