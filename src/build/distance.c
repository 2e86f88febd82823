/* Exact nearest points: a binary tree of boxes, split at the median of the longest side, so that
 * its depth is bounded. Nodes stand in depth-first order, the left child right behind its parent:
 *
 *     0: all ─┬─ 1: left half ─┬─ 2 …          a leaf holds at most LEAF_MAX triangles,
 *             │                └─ …            consecutive in the reordered corners
 *             └─ node[0].next: right half
 *
 * Secret: tree, order and traversal. Boxes are floats, which hold the positions exactly; all else
 * is double. Owns its corners and nodes. */
#include "distance.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"

enum {
    LEAF_MAX = 4,
    DEPTH_MAX = 40, /* 2^32 triangles halve 31 times until a leaf's number is left */
};

typedef struct box_node {
    float low[3], high[3];
    uint32_t next;  /* inner: the right child; leaf: its first triangle */
    uint32_t count; /* triangles of a leaf; 0: inner */
} box_node;

struct mni_distance {
    const float *position;
    uint32_t *corner;
    box_node *node;
    uint32_t triangles, nodes;
};

/* ---- building ------------------------------------------------------------------------------ */

static const float *corner_of(const mni_distance *d, uint32_t triangle, int i) {
    return d->position + 3 * (size_t)d->corner[3 * (size_t)triangle + (size_t)i];
}

/* Three times the middle of a triangle, along an axis. */
static float middle(const mni_distance *d, uint32_t triangle, int axis) {
    return corner_of(d, triangle, 0)[axis] + corner_of(d, triangle, 1)[axis] +
           corner_of(d, triangle, 2)[axis];
}

static void swap(mni_distance *d, uint32_t a, uint32_t b) {
    uint32_t *x = d->corner + 3 * (size_t)a, *y = d->corner + 3 * (size_t)b, keep[3];
    memcpy(keep, x, sizeof keep);
    memmove(x, y, sizeof keep);
    memcpy(y, keep, sizeof keep);
}

/* Quickselect: the triangles of [low, mid) along the axis before those of [mid, high). */
static void part(mni_distance *d, uint32_t low, uint32_t mid, uint32_t high, int axis) {
    while (high - low > 1) {
        float a = middle(d, low, axis), b = middle(d, low + (high - low) / 2, axis),
              c = middle(d, high - 1, axis);
        float pivot = a < b ? (b < c ? b : a < c ? c : a) : (a < c ? a : b < c ? c : b);
        uint32_t i = low, j = high - 1;
        for (;;) { /* Hoare: equal ones go to both sides, so that many of them cost no more */
            while (middle(d, i, axis) < pivot)
                i++;
            while (middle(d, j, axis) > pivot)
                j--;
            if (i >= j)
                break;
            swap(d, i++, j--);
        }
        uint32_t cut = i > j ? i : i + 1; /* [low, cut) ≤ pivot ≤ [j, high) */
        if (mid < i)
            high = i;
        else if (mid >= cut)
            low = cut;
        else
            return;
    }
}

static void fit_box(const mni_distance *d, box_node *n, uint32_t low, uint32_t high) {
    for (int a = 0; a < 3; a++) {
        n->low[a] = FLT_MAX;
        n->high[a] = -FLT_MAX;
    }
    for (uint32_t t = low; t < high; t++)
        for (int i = 0; i < 3; i++) {
            const float *p = corner_of(d, t, i);
            for (int a = 0; a < 3; a++) {
                n->low[a] = p[a] < n->low[a] ? p[a] : n->low[a];
                n->high[a] = p[a] > n->high[a] ? p[a] : n->high[a];
            }
        }
}

/* Recursion: as deep as the tree, at most DEPTH_MAX. */
static void build(mni_distance *d, uint32_t low, uint32_t high) {
    box_node *n = &d->node[d->nodes++];
    fit_box(d, n, low, high);
    if (high - low <= LEAF_MAX) {
        n->next = low;
        n->count = high - low;
        return;
    }
    int axis = 0;
    for (int a = 1; a < 3; a++)
        if (n->high[a] - n->low[a] > n->high[axis] - n->low[axis])
            axis = a;
    uint32_t mid = low + (high - low) / 2;
    part(d, low, mid, high, axis);
    build(d, low, mid);
    n->next = d->nodes;
    n->count = 0;
    build(d, mid, high);
}

mn_code mni_distance_open(const float *position, const uint32_t *corner, uint64_t triangles,
                          mni_distance **out, mn_status *st) {
    MN_ASSERT(triangles > 0 && triangles < UINT32_MAX);
    mni_distance *d = calloc(1, sizeof *d);
    /* leaves hold at least LEAF_MAX / 2 triangles when there is more than one leaf */
    size_t nodes_max = 2 * ((size_t)triangles / (LEAF_MAX / 2) + 1);
    if (d != NULL) {
        *d = (mni_distance){.position = position, .triangles = (uint32_t)triangles};
        d->corner = malloc(triangles * 3 * sizeof *d->corner);
        d->node = malloc(nodes_max * sizeof *d->node);
    }
    if (d == NULL || d->corner == NULL || d->node == NULL) {
        mni_distance_close(d);
        return mn_fail(st, MN_FAILED, "no memory to measure distances to %llu triangles",
                       (unsigned long long)triangles);
    }
    memcpy(d->corner, corner, triangles * 3 * sizeof *corner);
    build(d, 0, (uint32_t)triangles);
    MN_ASSERT(d->nodes <= nodes_max);
    *out = d;
    return MN_OK;
}

void mni_distance_close(mni_distance *d) {
    if (d == NULL)
        return;
    free(d->corner);
    free(d->node);
    free(d);
}

/* ---- asking -------------------------------------------------------------------------------- */

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Squared, from the origin of p to the segment [0, e]. */
static double to_segment(const double p[3], const double e[3]) {
    double length2 = dot(e, e), along = dot(p, e);
    double t = along <= 0 || length2 == 0 ? 0 : along >= length2 ? 1 : along / length2;
    double r[3] = {p[0] - t * e[0], p[1] - t * e[1], p[2] - t * e[2]};
    return dot(r, r);
}

/* Squared. Above the triangle: to its plane. Beside it: to the edges that the point is beyond; to
 * all of them when the triangle is too thin to say which. */
static double to_triangle(const mni_distance *d, uint32_t triangle, const double point[3]) {
    const float *v[3];
    double p[3][3], e[3][3], normal[3];
    for (int i = 0; i < 3; i++)
        v[i] = corner_of(d, triangle, i);
    for (int i = 0; i < 3; i++)
        for (int a = 0; a < 3; a++) {
            p[i][a] = point[a] - (double)v[i][a];
            e[i][a] = (double)v[(i + 1) % 3][a] - (double)v[i][a];
        }
    cross(e[0], e[1], normal);
    double area2 = dot(normal, normal);
    bool thin = area2 <= 1e-12 * dot(e[0], e[0]) * dot(e[1], e[1]);
    bool above = !thin;
    double best = DBL_MAX;
    for (int i = 0; i < 3; i++) {
        double side[3];
        cross(e[i], p[i], side);
        if (!thin && dot(normal, side) >= 0)
            continue;
        above = false;
        double d2 = to_segment(p[i], e[i]);
        best = d2 < best ? d2 : best;
    }
    if (above) {
        double height = dot(normal, p[0]);
        best = height * height / area2;
    }
    return best;
}

static double to_box(const box_node *n, const double p[3]) {
    double d2 = 0;
    for (int a = 0; a < 3; a++) {
        double below = (double)n->low[a] - p[a], over = p[a] - (double)n->high[a];
        double out = below > over ? below : over;
        d2 += out > 0 ? out * out : 0;
    }
    return d2;
}

double mni_distance_nearest(const mni_distance *d, const double point[3], uint32_t *hint) {
    struct {
        uint32_t node;
        double d2;
    } stack[DEPTH_MAX];
    MN_ASSERT(*hint < d->triangles);
    double best = to_triangle(d, *hint, point);
    uint32_t depth = 0, at = 0;
    double at_d2 = to_box(&d->node[0], point);
    for (;;) {
        const box_node *n = &d->node[at];
        if (at_d2 < best && n->count == 0) {
            uint32_t near = at + 1, far = n->next;
            double near_d2 = to_box(&d->node[near], point), far_d2 = to_box(&d->node[far], point);
            bool turn = far_d2 < near_d2;
            MN_ASSERT(depth < DEPTH_MAX);
            stack[depth].node = turn ? near : far;
            stack[depth++].d2 = turn ? near_d2 : far_d2;
            at = turn ? far : near;
            at_d2 = turn ? far_d2 : near_d2;
            continue;
        }
        for (uint32_t i = 0; at_d2 < best && i < n->count; i++) {
            double d2 = to_triangle(d, n->next + i, point);
            if (d2 < best) {
                best = d2;
                *hint = n->next + i;
            }
        }
        if (depth == 0)
            return sqrt(best);
        at = stack[--depth].node;
        at_d2 = stack[depth].d2;
    }
}
