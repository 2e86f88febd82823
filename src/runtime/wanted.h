/* What a camera wants: a pure function of camera and node. See wanted.c. */
#ifndef MNI_WANTED_H
#define MNI_WANTED_H

#include <stdbool.h>

#include "metanode/runtime.h"

/* Where the tolerance grows: what nobody sees may be so many times coarser. */
enum { MNI_WANTED_OUTSIDE = 16, MNI_WANTED_AWAY = 8 };

/* A camera, prepared. Plain data: copy at will. */
typedef struct mni_lens {
    double eye[3];
    double plane[5][3];  /* inward unit normals through the eye: left, right, bottom, top, front */
    double scale_px;     /* pixels that a length of 1 covers at distance 1 */
    double distance_min; /* nearer is taken for this near: errors stay finite */
    double tolerance_px; /* below 0: everything is wanted, INFINITY: nothing */
} mni_lens;

/* The bounds that a node decides by. */
typedef struct mni_bounds {
    const float *position; /* centre of the sphere */
    float radius, switch_value;
    mn_cone cone;
} mni_bounds;

/* size: a length of the model (its radius), from which distance_min is taken. */
void mni_lens_make(mni_lens *lens, const mn_camera *camera, uint32_t width_px, uint32_t height_px,
                   double size, double tolerance_px);
/* The switch value in pixels, at the nearest point of the sphere. */
double mni_lens_error_px(const mni_lens *lens, const mni_bounds *node);
/* Does the sphere touch the frustum? */
bool mni_lens_inside(const mni_lens *lens, const mni_bounds *node);
/* Does every normal of the cone, anywhere in the sphere, face away from the eye? */
bool mni_lens_away(const mni_lens *lens, const mni_bounds *node);
/* The error as the tolerance sees it: divided by what the tolerance grows by where nobody looks.
 * Rises from child to parent. */
double mni_lens_priority(const mni_lens *lens, const mni_bounds *node);
/* Is an inner node wanted split? (Leaves never are; the caller knows them.) */
bool mni_lens_wants(const mni_lens *lens, const mni_bounds *node);

#endif
