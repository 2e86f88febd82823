/* A front of its own over a small model, all of whose blocks are in memory. */
#ifndef TESTS_RUNTIME_FRONT_RIG_H
#define TESTS_RUNTIME_FRONT_RIG_H

#include "front.h"
#include "model.h"

typedef struct rig {
    model m;
    mni_block_limits limits;
    mni_arena arena;
    mni_store *store;
    mni_front front;
    uint32_t *usage;
} rig;

/* Over the model, whose file may have been changed since it was made. */
void rig_start(rig *r);
void rig_open(rig *r, model_shape shape, uint32_t triangles, const mn_block_desc *blocks);
void rig_close(rig *r);

#endif
