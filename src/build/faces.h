/* What is wrong with triangles as a whole: duplicates, and wrongly oriented ones. */
#ifndef MNI_FACES_H
#define MNI_FACES_H

#include <stdint.h>

#include "metanode/build.h"

/* Removes from corner[3 × *triangles] those with the same three vertices as an earlier one, in
 * place and keeping the order, and counts them, and those that use a directed edge that an earlier
 * kept one used. All corners are below `vertices`, and a triangle's are different. Linear in time
 * whatever the mesh. spare_bytes: what mni_faces_bytes did not foresee, but may be taken for
 * vertices with very many triangles; MN_CAP_TOO_SMALL leaves the missing bytes in *missing_bytes.
 */
mn_code mni_faces_filter(uint32_t *corner, uint64_t *triangles, uint64_t vertices,
                         uint64_t spare_bytes, uint64_t *missing_bytes, mn_intake *counts);
/* Memory that it takes besides. */
uint64_t mni_faces_bytes(uint64_t vertices, uint64_t triangles);

#endif
