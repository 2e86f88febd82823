/* Distances from points to the star of a vertex: its triangles, now.
 *
 * The star is taken once, then measured from many points, so lanes are points and triangles come
 * one after another. All coordinates are relative to the vertex, so that floats keep the digits
 * that matter. The same bits on every machine and at every width: no fused operations, and the
 * least of the distances is the least in any order. One thread; memory: the largest star met. */
#ifndef MNI_STAR_H
#define MNI_STAR_H

#include "surface.h"

enum {
    MNI_LANES = 8,   /* a register of AVX2, two of SSE2 */
    MNI_POINTS = 80, /* two leaves' points, or a ring's worth */
};

typedef struct mni_points {
    float x[MNI_POINTS], y[MNI_POINTS], z[MNI_POINTS];
    float distance[MNI_POINTS];
    uint32_t count;
} mni_points;

typedef struct mni_star_triangles mni_star_triangles;

/* A star as it is taken: triangles (k, next, previous), and behind them a row of any vertices. */
typedef struct mni_star_corners {
    const mni_vertex *vertex;
    uint32_t k;
    const uint32_t *next, *previous;
    uint32_t count;
} mni_star_corners;

typedef struct mni_star {
    mni_star_triangles *triangles;
    uint32_t *next, *previous; /* their corners; one array */
    uint32_t count, room;
    void (*prepare)(mni_star_triangles *triangles, const mni_star_corners *corners);
    void (*measure)(const mni_star_triangles *triangles, uint32_t count, mni_points *points);
} mni_star;

void mni_star_open(mni_star *star);
void mni_star_close(mni_star *star);
/* Keeps to what every machine has. */
void mni_star_narrow(mni_star *star);
/* k's triangles, and their edges. False: no memory. */
bool mni_star_take(mni_star *star, mni_surface *surface, uint32_t k);
/* The same as k's will be when r has collapsed into it; both have triangles at other vertices. */
bool mni_star_take_of_both(mni_star *star, mni_surface *surface, uint32_t r, uint32_t k);
/* The same, of wheels of both that are known. */
bool mni_star_take_of_wheels(mni_star *star, const mni_surface *surface, const mni_wheel *of_r,
                             const mni_wheel *of_k, uint32_t r, uint32_t k);
/* k's triangles at its neighbour n alone; ends: their other corners, MN_NONE behind the last. */
bool mni_star_take_spoke(mni_star *star, mni_surface *surface, uint32_t k, uint32_t n,
                         uint32_t ends[2]);
/* Fills distance[0 … count): to the nearest place of the star, or to k where it has no triangle. */
void mni_star_measure(const mni_star *star, mni_points *points);

#endif
