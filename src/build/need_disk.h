/* How much disk a build takes, by what has been read (need.c). Pure; any thread. */
#ifndef MNI_NEED_DISK_H
#define MNI_NEED_DISK_H

#include "extmesh.h"

/* mn_vdt_temp_bytes, of a mesh that is there: with what its triangles take that cross the model. */
uint64_t mni_vdt_temp_bytes_of(const mni_extmesh *mesh, uint64_t ram_bytes);

#endif
