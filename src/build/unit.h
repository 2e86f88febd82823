/* The unit of length in which a mesh is simplified: costs are fourth powers of lengths, in floats.
 * Any thread. */
#ifndef MNI_UNIT_H
#define MNI_UNIT_H

#include <math.h>
#include <stdbool.h>

#include "metanode/build.h"

/* The exponent of two of the unit that suits coordinates up to `most`; 0: their own. */
int mni_unit_of_most(float most);
/* A length in such a unit, in the unit that it came in; −unit: the other way. */
static inline float mni_unit_length(float length, int unit) {
    return unit == 0 ? length : ldexpf(length, unit);
}
/* Of a mesh. */
int mni_unit_of(const mn_mesh *mesh);
/* The mesh in that unit: *out has positions of its own, 12 bytes a vertex, to be freed by the
 * caller, and shares the rest. false: no memory. */
bool mni_unit_apply(const mn_mesh *mesh, int unit, mn_mesh *out);
/* A tree of that mesh, in the unit that the mesh came in. */
void mni_unit_undo(mn_tree *tree, int unit);

#endif
