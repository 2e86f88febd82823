/* Cameras that nobody would steer: walks, teleports, zooms in and out, ways back, rests.
 *
 * A function of the seed and of how often it was asked. One thread, no memory of its own. */
#ifndef METANODE_STRESS_MOTION_H
#define METANODE_STRESS_MOTION_H

#include "metanode/runtime.h"

typedef enum motion_step {
    MOTION_AS_IT_IS = 0,
    MOTION_TO_ROOTS, /* with an infinite tolerance */
    MOTION_CLOSER,   /* with an eighth of it */
} motion_step;

enum { MOTION_PAST = 64 };

/* Where the camera is: about the middle of the model, or a point of its box. */
typedef struct motion_place {
    double yaw, pitch, distance; /* radii, from the target */
    double target[3];            /* of the box, -1 … 1 */
} motion_place;

typedef struct motion {
    float middle[3], half[3];
    double radius;
    uint64_t dice;
    int kind; /* of this stretch */
    uint32_t left, steps;
    motion_place at, speed;
    motion_place past[MOTION_PAST]; /* a ring */
    uint32_t passed;
    mn_camera camera; /* the last one */
} motion;

void motion_begin(motion *motion, const mn_header *header, uint64_t seed);
motion_step motion_next(motion *motion, mn_camera *out);
/* splitmix64: 32 bits of it. */
uint32_t motion_dice(uint64_t *state);

#endif
