/* Small built models for the run time's tests: a mesh made here, its tree, and its .mnt. */
#ifndef TESTS_RUNTIME_MODEL_H
#define TESTS_RUNTIME_MODEL_H

#include "metanode/build.h"
#include "metanode/runtime.h"

typedef enum model_shape {
    MODEL_GLOBE = 0, /* closed, with two poles of many neighbours */
    MODEL_TORUS,     /* closed, bumpy */
    MODEL_TERRAIN,   /* open, rough, coloured */
    MODEL_HEAP,      /* lone triangles */
    MODEL_FINS,      /* a torus with fins on its edges: non-manifold */
    MODEL_SHAPES,
    MODEL_PENCIL = MODEL_SHAPES, /* all triangles at one edge, whose ends are poles */
    MODEL_LOOSE,                 /* all at one vertex, and nothing else shared */
    MODEL_PAIR,                  /* half of them so, half at another, and one at both */
    MODEL_FAN,                   /* flat, all around one vertex */
} model_shape;

typedef struct model {
    char path[64];
    mn_tree tree;
    mn_header header;
    bool closed; /* and consistently oriented */
} model;

/* About `triangles` of them. Asserts on any failure. Freed, and its file removed, by model_free. */
void model_make(model *out, model_shape shape, uint32_t triangles, const mn_block_desc *blocks);
void model_free(model *m);

/* A session's desc for the model: resident, no cap, small picture. */
mn_session_desc model_desc(const model *m);
mn_session *model_open(const mn_session_desc *desc);
/* A camera at `distance` radii from the box's centre, `turn` of a full turn round it. */
mn_camera model_camera(const model *m, double turn, double distance);

/* Settles at `cameras` cameras and then at the roots, checking; hash: the settled fronts'. Returns
 * the active nodes that it has seen. */
uint64_t model_walk(const mn_session_desc *desc, const model *m, uint64_t *hash, int cameras);

uint64_t model_random(void); /* a stream of its own, from MN_SEED, printed once */
double model_uniform(double lo, double hi);

#endif
