/* OpenMesh's half-edge mesh, and the way from and to a soup. */
#ifndef METANODE_OPENMESH_MESH_H
#define METANODE_OPENMESH_MESH_H

/* MeshIO has to come before any mesh type. */
#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>

#include "stream.h"

/* Positions and normals as OpenMesh's users have them: floats. */
struct mesh_traits : OpenMesh::DefaultTraits {
    typedef OpenMesh::Vec4uc Color;
};
typedef OpenMesh::TriMesh_ArrayKernelT<mesh_traits> halfedge_mesh;

/* Throws trouble with the number of faces that a half-edge mesh cannot hold, if any. */
void fill(halfedge_mesh &mesh, const soup &from);
/* What is not deleted; colours are kept if the mesh has them. */
soup gather(halfedge_mesh &mesh);

#endif
