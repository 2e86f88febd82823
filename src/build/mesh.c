#include "metanode/build.h"
void mn_mesh_free(mn_mesh *m) {
    (void)m;
}
