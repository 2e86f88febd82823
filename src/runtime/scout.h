/* Blocks that I/O may read on its own account: children of blocks that have just come, by how much
 * the camera wants them.
 *
 * What is in a block is known when it has been read; what lies below would be asked for a frame
 * later, and the block tree is many levels deep. So whoever knows blocks rates the references of
 * one that has come (mni_store_rate), and what is wanted is read at once, what may soon be wanted
 * while there are empty places.
 *
 * Secret: the order, and who goes when there are too many. I/O only; memory: the arena's, fixed.
 * Paper: none (§5 names prefetching by the viewer's motion as future work). */
#ifndef MNI_SCOUT_H
#define MNI_SCOUT_H

#include "board.h"

enum { MNI_SCOUTS_LEAST = 64, MNI_SCOUTS_MAX = 1024 };

typedef struct mni_scout {
    mni_command command;
    float urgency;
} mni_scout;

typedef struct mni_scouts {
    mni_scout *scout; /* a heap: the most urgent first, among equals the first in the file */
    uint32_t count, max;
} mni_scouts;

/* k: place holders. */
size_t mni_scouts_need(uint32_t k);
void mni_scouts_open(mni_scouts *scouts, uint32_t k, mni_arena *arena);
/* false: one had to go, this one or a less urgent one. */
bool mni_scouts_push(mni_scouts *scouts, const mni_command *command, float urgency);
bool mni_scouts_pop(mni_scouts *scouts, mni_command *out);

#endif
