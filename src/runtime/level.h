/* How far the tolerance gives way where the wanted mesh does not fit. See level.c. */
#ifndef MNI_LEVEL_H
#define MNI_LEVEL_H

#include <stdbool.h>

enum {
    MNI_LEVELS_A_DOUBLING = 64,                   /* 1.1 % a level */
    MNI_LEVEL_MAX = 40 * MNI_LEVELS_A_DOUBLING,   /* tolerance × 2^40 */
    MNI_LEVEL_STRIDE = MNI_LEVELS_A_DOUBLING / 4, /* at most so many a frame, in motion */
    MNI_LEVEL_HOLD_FRAMES = 8, /* after a step up, while the camera moves, no step down */
};

typedef struct mni_level {
    int level;    /* the tolerance's: × 2^(level / 64) */
    int too_low;  /* the highest that did not fit since the camera moved; -1: none */
    int enough;   /* the lowest that would do; MNI_LEVEL_MAX + 1: none is known */
    int stride;   /* the last one, up above 0, down below; the next one that way is twice as long */
    int hold;     /* frames */
    double fill;  /* before the last step down */
    bool settled; /* it would not change if the camera stood */
} mni_level;

/* A node that is wanted and found no room. */
typedef struct mni_level_refused {
    double px;   /* its error; 0: there is none */
    double away; /* how far it was taken to be, in least distances: mni_level_reach, or more */
} mni_level_refused;

/* What a frame showed. */
typedef struct mni_level_signs {
    bool moved;        /* the camera, the tolerance or the room is not the last frame's */
    bool full;         /* something wanted found no room */
    bool stale;        /* something that is not wanted may have taken it */
    bool busy;         /* not all that is wanted is there yet: it is unknown whether it fits */
    bool from_scratch; /* most of the front was made in this frame */
    mni_level_refused refused; /* with the largest error */
    mni_level_refused crowd;   /* with such an error that those with larger ones are too many */
    double box_away;           /* as mni_level_reach has it */
    double fill; /* share of the room that is taken, of the scarcest; 0: nobody knows */
} mni_level_signs;

void mni_level_open(mni_level *level);
/* The tolerance at the level. */
double mni_level_tolerance(const mni_level *level, double tolerance_px);
/* Another tolerance is asked for: where it has given way what is used stays, or is the new one if
 * that is more. If either is none (below 0, infinite), nothing has given way yet. */
void mni_level_asked(mni_level *level, double before_px, double now_px);
/* By how much farther, at the level, a node is taken to be whose sphere holds the eye: 1 and more.
 * box_away: how far the eye is from the model's box, likewise in least distances, 1 and more. */
double mni_level_reach(const mni_level *level, double tolerance_px, double box_away);
/* The level for the next frame, after one at tolerance_px (as asked for). */
void mni_level_next(mni_level *level, double tolerance_px, const mni_level_signs *signs);

#endif
