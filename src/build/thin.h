/* Too many witnesses: of the closest pair the one nearer to the surface goes, until few enough are
 * left (witness.h). The same ones on every machine. One thread; no memory. */
#ifndef MNI_THIN_H
#define MNI_THIN_H

#include "star.h"

enum { MNI_THIN_LEFT = MNI_LANES /* so many stay */ };

/* Points with their distances, of each what dropped ones add to that, and where a hub's are near,
 * which goes with them. The first points->count of all of these. */
typedef struct mni_thin_set {
    mni_points *points;
    float *slack;
    uint32_t *home;
} mni_thin_set;

typedef void mni_thin(const mni_thin_set *set);
/* The same result, as wide as this machine can, and of any number of points as all can. */
mni_thin *mni_thin_best(void);
mni_thin mni_thin_narrow;

#endif
