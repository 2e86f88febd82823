/* Sphere and cone of a node: what holds all input triangles at its leaves.
 *
 * A sphere is about the node's position, which is its left child's. Both nest as decoded. No
 * memory, any thread. */
#ifndef MNI_NODE_BOUNDS_H
#define MNI_NODE_BOUNDS_H

#include "surface.h"

typedef struct mni_node_bounds {
    float radius;
    mn_cone cone;
} mni_node_bounds;

/* Of a leaf, from a surface of which nothing has been collapsed; normal: 3 × triangles, unit or 0.
 * The cone is about the mean normal, as wide as the normal farthest from it. */
mni_node_bounds mni_leaf_bounds(const mni_surface *surface, const float *normal, uint32_t v);
/* Of the parent of two nodes that are at those places, rounded up to what files hold. */
mni_node_bounds mni_parent_bounds(const float left_p[3], mni_node_bounds left,
                                  const float right_p[3], mni_node_bounds right);

#endif
