/* See mesh.h. */
#include "mesh.h"

typedef halfedge_mesh::VertexHandle vertex;

void fill(halfedge_mesh &mesh, const soup &from) {
    mesh.reserve(from.vertices(), 3 * from.triangles() / 2, from.triangles());
    if (!from.color.empty())
        mesh.request_vertex_colors();
    for (size_t v = 0; v < from.vertices(); v++) {
        const double *p = &from.position[3 * v];
        vertex added = mesh.add_vertex(halfedge_mesh::Point((float)p[0], (float)p[1], (float)p[2]));
        if (!from.color.empty()) {
            uint32_t c = from.color[v];
            mesh.set_color(added,
                           {(uint8_t)c, (uint8_t)(c >> 8), (uint8_t)(c >> 16), (uint8_t)(c >> 24)});
        }
    }
    size_t lost = 0, first = 0;
    for (size_t t = 0; t < from.triangles(); t++) {
        const uint32_t *c = &from.corner[3 * t];
        if (c[0] == c[1] || c[1] == c[2] || c[2] == c[0] ||
            !mesh.add_face(vertex((int)c[0]), vertex((int)c[1]), vertex((int)c[2])).is_valid())
            first = lost++ == 0 ? t : first;
    }
    if (lost > 0)
        throw trouble("not a manifold: " + std::to_string(lost) + " of " +
                      std::to_string(from.triangles()) +
                      " triangles do not fit (the first: " + std::to_string(first) + ")");
}

soup gather(halfedge_mesh &mesh) {
    mesh.garbage_collection();
    soup out;
    out.position.reserve(3 * mesh.n_vertices());
    out.corner.reserve(3 * mesh.n_faces());
    for (vertex v : mesh.vertices()) {
        const halfedge_mesh::Point &p = mesh.point(v);
        out.position.insert(out.position.end(), {p[0], p[1], p[2]});
        if (mesh.has_vertex_colors()) {
            const halfedge_mesh::Color &c = mesh.color(v);
            out.color.push_back(c[0] | (uint32_t)c[1] << 8 | (uint32_t)c[2] << 16 |
                                (uint32_t)c[3] << 24);
        }
    }
    for (halfedge_mesh::FaceHandle f : mesh.faces())
        for (auto v = mesh.cfv_iter(f); v.is_valid(); ++v)
            out.corner.push_back((uint32_t)v->idx());
    return out;
}
