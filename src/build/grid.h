/* The grid on which all positions of a model lie: its step, and the place nearest to a coordinate.
 * No memory, any thread. */
#ifndef MNI_GRID_H
#define MNI_GRID_H

#include <math.h>
#include <stdint.h>

#include "metanode/status.h"

/* 0 becomes the default; MN_USAGE: there is no such grid. */
mn_code mni_grid_bits(uint32_t *bits, mn_status *st);
/* Of a box of finite floats. */
float mni_grid_step(const float low[3], const float high[3], uint32_t bits);

/* -0 becomes 0. */
static inline float mni_grid_round(float at, float step) {
    return (float)(rint((double)at / (double)step) * (double)step) + 0.0f;
}

#endif
