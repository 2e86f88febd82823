/* What the tests of made models share: reads one back and checks that it is a surface. */
#ifndef TESTS_MADE_MODEL_H
#define TESTS_MADE_MODEL_H

#include <stdint.h>

typedef struct made_model {
    uint64_t vertices, triangles, hash;
    float *position;
    uint32_t *corner;
} made_model;

/* Of a PLY as mn_make writes it; fails the test otherwise. */
made_model made_load(const char *path);
void made_drop(made_model *m);
/* Each directed edge once: manifold edges, one orientation. Returns the edges without a partner. */
uint64_t made_check_edges(const made_model *m, uint64_t *edges);
/* Triangles about a vertex form one fan: as many fans as vertices. */
void made_check_fans(const made_model *m);
/* No two vertices at one place: a reader that welds changes nothing. */
void made_check_positions(const made_model *m);
double made_volume(const made_model *m);
/* In a folder, hidden ones too. */
int made_files(const char *folder);

#endif
