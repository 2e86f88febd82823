/* A camera that a hand moves: round a point, nearer, aside. Pure; any thread. */
#ifndef METANODE_ORBIT_H
#define METANODE_ORBIT_H

#include <stdbool.h>

#include "metanode/runtime.h"

typedef struct orbit {
    float target[3];
    float distance;   /* from target to eye */
    float turn, tilt; /* radians: about +y, and above the horizon */
    float distance_min, distance_max;
    float fov_y_deg;
} orbit;

/* Where a camera stands, with limits for a model of that radius. */
orbit orbit_from(const mn_camera *camera, float radius);
mn_camera orbit_camera(const orbit *o);
/* Drags in fractions of the window's height; a quarter turn for half a window. */
void orbit_turn(orbit *o, float right, float down);
/* So that what lies at the target's distance follows the pointer. */
void orbit_pan(orbit *o, float right, float down);
/* Notches: each takes an eighth of the distance; positive is nearer. */
void orbit_zoom(orbit *o, float notches);
/* Puts the target on the first triangle of the front that the view's axis meets, so that turning
 * and zooming go about what is looked at. Stays where it is if there is none. O(triangles). */
void orbit_aim(orbit *o, const mn_front *front);

#endif
