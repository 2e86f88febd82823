/* What a camera wants: a pure function of camera and node. See wanted.c. */
#ifndef MNI_WANTED_H
#define MNI_WANTED_H

#include <stdbool.h>

#include "metanode/runtime.h"

/* Where the tolerance grows when mn_weights does not say: what nobody sees may be so many times
 * coarser. */
enum { MNI_WANTED_OUTSIDE = 16, MNI_WANTED_AWAY = 8 };

/* A camera, prepared. Plain data: copy at will. */
typedef struct mni_lens {
    double eye[3];
    double plane[5][3];  /* inward unit normals through the eye: left, right, bottom, top, front */
    double scale_px;     /* pixels that a length of 1 covers at distance 1 */
    double distance_min; /* nearer is taken for this near: errors stay finite */
    double tolerance_px; /* below 0: everything is wanted, INFINITY: nothing */
    double outside, away, silhouette, light; /* mn_weights, none below 1 */
    double light_from[3];                    /* a unit vector of the model's space */
    double most;                             /* the largest weight there is */
} mni_lens;

/* The bounds that a node decides by. */
typedef struct mni_bounds {
    const float *position; /* centre of the sphere */
    float radius, switch_value;
    mn_cone cone;
} mni_bounds;

/* The least distance that anything is taken to have, of a model of that size, its radius. */
static inline double mni_lens_distance_min(double size) {
    return size > 0 ? size * 1e-6 : 1e-30;
}
/* distance_min: that, or more where the tolerance has given way (mni_level_reach). weights: NULL:
 * the defaults. */
void mni_lens_make(mni_lens *lens, const mn_camera *camera, uint32_t width_px, uint32_t height_px,
                   double distance_min, double tolerance_px, const mn_weights *weights);
/* Does anything weigh more than 1? Then decisions take longer. */
static inline bool mni_lens_tightens(const mni_lens *lens) {
    return lens->most > 1;
}
/* From the eye to the sphere; 0 and less: it holds the eye. */
double mni_lens_to_sphere(const mni_lens *lens, const mni_bounds *node);
/* The same, distance_min at least. */
double mni_lens_nearest(const mni_lens *lens, const mni_bounds *node);
/* The switch value in pixels, at the nearest point of the sphere. */
double mni_lens_error_px(const mni_lens *lens, const mni_bounds *node);
/* Does the sphere touch the frustum? */
bool mni_lens_inside(const mni_lens *lens, const mni_bounds *node);
/* Does every normal of the cone, anywhere in the sphere, face away from the eye? */
bool mni_lens_away(const mni_lens *lens, const mni_bounds *node);
/* The largest sine of an angle below 90 degrees between a normal of the cone and a direction to the
 * eye, over the sphere: 1 where a silhouette may lie. Of nodes that are not away. */
double mni_lens_grazing(const mni_lens *lens, const mni_bounds *node);
/* The difference, 0 to 1, between the most and the least light (a cosine) on normals of the cone.
 */
double mni_lens_contrast(const mni_lens *lens, const mni_bounds *node);
/* The error as the tolerance sees it: times the node's weight. Rises from child to parent. */
double mni_lens_priority(const mni_lens *lens, const mni_bounds *node);
/* Is an inner node wanted split? (Leaves never are; the caller knows them.) */
bool mni_lens_wants(const mni_lens *lens, const mni_bounds *node);

#endif
