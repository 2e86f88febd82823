/* What a camera wants, for many nodes at once and only where it is clear. See sieve.c. */
#ifndef MNI_SIEVE_H
#define MNI_SIEVE_H

#include "wanted.h"

enum { MNI_SIEVE_BATCH = 64 };

typedef enum mni_verdict {
    MNI_UNSURE = 0, /* ask mni_lens_wants */
    MNI_WANTED,
    MNI_UNWANTED,
} mni_verdict;

/* A lens in single precision, with what it may be wrong by. Plain data. */
typedef struct mni_sieve {
    float eye[3], plane[5][3];
    float reach;      /* × switch value: where it has the size of the tolerance; NaN: no telling */
    float reach_most; /* and with the largest weight */
    float outside, away;                    /* weights there */
    float silhouette, light, light_from[3]; /* as the lens has them */
    bool tightens;                          /* silhouettes or light count */
    float distance_min;                     /* the lens's, rounded up */
    float slack;                            /* absolute error of a difference of coordinates */
} mni_sieve;

/* What a camera sees, both ways. */
typedef struct mni_view {
    mni_lens lens;
    mni_sieve sieve;
} mni_view;

/* Nodes' bounds, column by column. */
typedef struct mni_sieve_batch {
    float x[MNI_SIEVE_BATCH], y[MNI_SIEVE_BATCH], z[MNI_SIEVE_BATCH];
    float radius[MNI_SIEVE_BATCH], switch_value[MNI_SIEVE_BATCH];
    float axis[2][MNI_SIEVE_BATCH], angle[MNI_SIEVE_BATCH]; /* a cone's numbers as they are */
} mni_sieve_batch;

/* size: no coordinate of a node is larger. */
void mni_sieve_make(mni_sieve *sieve, const mni_lens *lens, float size);
static inline void mni_sieve_put(mni_sieve_batch *batch, int i, const float position[3],
                                 float radius, float switch_value, mn_cone cone) {
    batch->x[i] = position[0];
    batch->y[i] = position[1];
    batch->z[i] = position[2];
    batch->radius[i] = radius;
    batch->switch_value[i] = switch_value;
    batch->axis[0][i] = cone.axis[0];
    batch->axis[1][i] = cone.axis[1];
    batch->angle[i] = cone.angle;
}
/* mni_lens_wants of one node, and, of those that are wanted, mni_lens_priority, to the last bit. */
bool mni_sieve_wants(const mni_sieve *sieve, const mni_lens *lens, const mni_bounds *node,
                     double *priority_px);
/* How much a camera's motion can change any verdict by, at most, in lengths of the model: INFINITY
 * where more than eye and planes has changed. size: no coordinate of a node is larger. Motions add
 * up. */
double mni_sieve_motion(const mni_lens *from, const mni_lens *to, double size);
/* Nodes that are unwanted wherever the camera looks, as most of a front are: said from their
 * distance alone, of MNI_SIEVE_BATCH nodes whose bounds lie one after the other. Above 0: so it is,
 * and stays so for that much motion; 0: judge it. soon: for that camera too; or NULL. */
void mni_sieve_far(const mni_sieve *sieve, const mni_sieve *soon, const float *position,
                   const float *radius, const float *switch_value, float margin[MNI_SIEVE_BATCH]);
#define MNI_DUE_NOW (-1.0f) /* the clock of motion begins at 0 */
/* Bit i: due[i] is not above the clock. */
uint64_t mni_sieve_late(const float due[MNI_SIEVE_BATCH], float clock);
/* Of all of a batch; whoever has filled less looks at so many. margin: the verdict, if there is
 * one, stays for motions of less. */
void mni_sieve_judge(const mni_sieve *sieve, const mni_sieve_batch *batch,
                     uint8_t verdict[MNI_SIEVE_BATCH], float margin[MNI_SIEVE_BATCH]);

#endif
