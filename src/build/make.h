/* Models of any size: what the shapes share. */
#ifndef MNI_MAKE_H
#define MNI_MAKE_H

#include "metanode/build.h"
#include "make_ply.h"

#define MNI_PI 3.14159265358979323846

/* Each writes the whole model: counts, vertices, faces. One file a shape. */
mn_code mni_make_sphere(const mn_make_desc *desc, mni_make_ply *ply, mn_status *st);
mn_code mni_make_terrain(const mn_make_desc *desc, mni_make_ply *ply, mn_status *st);
mn_code mni_make_isosurface(const mn_make_desc *desc, mni_make_ply *ply, mn_status *st);
mn_code mni_make_earth(const mn_make_desc *desc, mni_make_ply *ply, mn_status *st);

/* Calls desc->progress. Not MN_OK: stop, the user asked for it or the disk is full. */
mn_code mni_make_progress(const mn_make_desc *desc, const mni_make_ply *ply, uint64_t done,
                          uint64_t total, mn_status *st);

/* The nearest whole number to the square root of n. */
uint64_t mni_make_sqrt(double n);
/* sin(2 π t) to 1e-11, without libm: the same bits everywhere. */
double mni_make_sine(double t);

typedef struct mni_rgb {
    double r, g, b; /* [0, 1] */
} mni_rgb;
mni_rgb mni_rgb_mix(mni_rgb a, mni_rgb b, double t);     /* t clamped to [0, 1] */
uint32_t mni_rgb_pack(mni_rgb c);                        /* 0xBBGGRR, clamped */
double mni_make_step(double low, double high, double x); /* smooth, 0 up to low, 1 from high */

#endif
