/* Where the camera is going, and which blocks it will want there.
 *
 * The camera a moment ahead is extrapolated from its last two places; what it will want is the same
 * function as what it wants now (wanted.h), asked of the nodes of the front that would need another
 * block: exits, which will split, and forks at exits, which will collapse. A part of the front has
 * its turn in each frame. */
#ifndef MNI_AHEAD_H
#define MNI_AHEAD_H

#include "barred.h"
#include "front.h"
#include "rate.h"
#include "sieve.h"

enum {
    MNI_AHEAD_HORIZON = 12, /* frames that the camera is looked ahead */
    MNI_AHEAD_NEAR = 6,     /* and in every other round of the front */
    MNI_AHEAD_SOON = 3,     /* and for what is split early */
    MNI_AHEAD_TURNS = 4,    /* frames in which the whole front has its turn; so much less is told */
    MNI_AHEAD_UP_TURNS =
        32, /* in which its forks have: the way up is in memory for the most part */
};

typedef struct mni_ahead {
    /* Navigate only */
    mn_camera last, before; /* of the frame before, and of the one before that */
    float step[3];          /* of the eye, then */
    bool has_last, has_before;
    mni_look look;
    bool near;       /* in this round of the front */
    uint32_t frames; /* that it looks ahead */
    mni_lens there;  /* the camera then */
    mni_sieve sieve; /* of there */
    mni_sieve_batch batch;
    mni_view soon;         /* the camera in MNI_AHEAD_SOON frames, while look.moves … */
    double soon_motion;    /* … and its motion since it last was (mni_sieve_motion) */
    uint32_t slot, branch; /* whose turn it is */
} mni_ahead;

/* The camera in so many frames, if it goes on as it came. false: it stands, or has jumped. */
bool mni_ahead_extrapolate(mni_ahead *ahead, const mn_camera *camera, float frames, mn_camera *out);
/* Takes in the frame's camera, as the lens has it; the rest as mni_lens_make and mni_sieve_make.
 * After it look is what the store is to know. */
void mni_ahead_begin(mni_ahead *ahead, const mn_camera *camera, const mni_lens *now,
                     uint32_t width_px, uint32_t height_px, double size, const mn_weights *weights,
                     float coordinate_max);
/* Tells the store what a part of the front will want; but for those who are barred: they want it
 * now. Not looked at is whose verdict (barred->due) stands until the clock of motion has gone as
 * far as the camera will. */
void mni_ahead_scan(mni_ahead *ahead, mni_front *front, const mni_barred *barred, float clock);

#endif
