/* The pass of collapses. See collapse.c. */
#ifndef MNI_COLLAPSE_H
#define MNI_COLLAPSE_H

#include "navigate.h"

/* Collapses what is wanted neither now nor in a moment, but for what is kept or blocked, and what a
 * budget has no operation left for; nav->work says what came of it. The agenda is used up. */
void mni_collapse_pass(mni_navigator *nav);

#endif
