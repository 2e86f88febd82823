/* Blocks that could not be read or were damaged: reported once, absent, tried again after 1, 2, 4,
 * … 64 frames without end (design.md §4).
 *
 * Secret: how many are remembered. When more than MNI_FAILURES_MAX blocks are bad the one that is
 * known longest is forgotten: it is tried again at once and reported again. Guarded by the owner's
 * lock; memory from the arena. */
#ifndef MNI_FAILURES_H
#define MNI_FAILURES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "hashmap.h"

enum { MNI_FAILURES_MAX = 1024, MNI_RETRY_FRAMES_MAX = 64 };

typedef struct mni_failure {
    uint32_t block_id; /* 0: unused */
    uint32_t times;
    uint64_t retry_frame; /* not tried before */
} mni_failure;

typedef struct mni_failures {
    mni_failure *record; /* ring */
    mni_hashmap by_id;
    uint32_t oldest; /* next to be reused when all are */
} mni_failures;

size_t mni_failures_need(void);
void mni_failures_open(mni_failures *failures, mni_arena *arena);
/* Notes a failure in `frame`; true when the block was not known to be bad: report it. */
bool mni_failures_add(mni_failures *failures, uint32_t block_id, uint64_t frame);
/* May the block be tried in `frame`? */
bool mni_failures_due(const mni_failures *failures, uint32_t block_id, uint64_t frame);
/* Is it known to be bad? */
bool mni_failures_has(const mni_failures *failures, uint32_t block_id);
/* The block has been read and is sound. */
void mni_failures_forget(mni_failures *failures, uint32_t block_id);

#endif
