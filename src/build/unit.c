/* See unit.h. Hidden here: which lengths suit floats.
 *
 * A cost is an area times a squared distance, and a share of 1e-9 of an edge's fourth power: with
 * edges of 2^-12 of the model 2^-78 of the fourth power of its size, and at the top up to 2^6 of
 * it. Floats hold 2^-126 … 2^127, so that models of 2^-8 … 2^24 keep their unit, and others, a
 * molecule in metres or a nebula in kilometres, get one in which they are about 1. Units are powers
 * of two: no bit of a tree depends on them. No order but undo after apply. Memory: the caller's. */
#include "unit.h"

#include <stdlib.h>

enum { LEAST = -8, MOST = 24 };

int mni_unit_of_most(float most) {
    int exponent = 0;
    (void)frexpf(most, &exponent);
    return exponent < LEAST || exponent > MOST ? exponent : 0;
}

int mni_unit_of(const mn_mesh *mesh) {
    float most = 0;
    for (size_t i = 0; i < (size_t)mesh->vertices * 3; i++)
        most = fmaxf(most, fabsf(mesh->position[i]));
    return mni_unit_of_most(most);
}

static void scale(float *length, size_t count, int exponent) {
    for (size_t i = 0; i < count; i++)
        length[i] = ldexpf(length[i], exponent);
}

bool mni_unit_apply(const mn_mesh *mesh, int unit, mn_mesh *out) {
    const size_t count = (size_t)mesh->vertices * 3;
    *out = *mesh;
    out->position = malloc(count * sizeof *out->position);
    if (out->position == NULL)
        return false;
    for (size_t i = 0; i < count; i++)
        out->position[i] = ldexpf(mesh->position[i], -unit);
    out->grid_step = ldexpf(mesh->grid_step, -unit);
    return true;
}

void mni_unit_undo(mn_tree *tree, int unit) {
    if (tree->leaf_position == NULL) /* stopped on the way */
        return;
    scale(tree->leaf_position, (size_t)tree->leaves * 3, unit);
    scale(tree->switch_value, tree->inner, unit);
    scale(tree->radius, tree->inner, unit);
    tree->grid_step = ldexpf(tree->grid_step, unit);
}
