/* Records of a binary PLY: for whoever has not all of a mesh at once. Any thread. */
#ifndef MNI_WRITE_PLY_H
#define MNI_WRITE_PLY_H

#include <stddef.h>

#include "metanode/build.h"

enum { MNI_PLY_HEADER_MAX = 512, MNI_PLY_VERTEX_MAX = 28, MNI_PLY_FACE_BYTES = 13 };

/* Of a mesh whose counts, origin and having of colours are known. Bytes written. */
size_t mni_ply_header(const mn_mesh *mesh, char text[MNI_PLY_HEADER_MAX]);
/* The same length for each vertex of a mesh. */
size_t mni_ply_vertex(const mn_mesh *mesh, uint64_t vertex, unsigned char to[MNI_PLY_VERTEX_MAX]);
void mni_ply_face(const uint32_t corner[3], unsigned char to[MNI_PLY_FACE_BYTES]);

#endif
