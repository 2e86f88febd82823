/* Exact distances from points to a surface.
 *
 * A tree of boxes over triangles; a triangle with two or three equal corners is a segment or a
 * point, so that a lone vertex v can be had as (v, v, v). Memory: at most 44 bytes a triangle.
 * Building belongs to one thread; queries only read, and any number of threads may ask. */
#ifndef MNI_DISTANCE_H
#define MNI_DISTANCE_H

#include <stdint.h>

#include "metanode/status.h"

typedef struct mni_distance mni_distance;

/* position: 3 floats a vertex, kept by the caller until close. corner: 3 a triangle, copied. At
 * least one triangle, fewer than 2^32. MN_FAILED: no memory. */
mn_code mni_distance_open(const float *position, const uint32_t *corner, uint64_t triangles,
                          mni_distance **out, mn_status *st);
/* To the nearest point of the surface, in the positions' units. *hint: where the last query of a
 * neighbouring point ended, 0 at first; it saves time and changes nothing else. */
double mni_distance_nearest(const mni_distance *distance, const double point[3], uint32_t *hint);
void mni_distance_close(mni_distance *distance);

#endif
