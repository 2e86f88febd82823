/* read and write: mesh files through OpenMesh's own readers and writers.
 *
 * OpenMesh's usual importer puts faces into a half-edge mesh, which cannot hold non-manifold
 * input: it doubles the vertices of the faces that do not fit and so tears the surface open. The
 * importer here takes faces as they come, into a soup, and nothing is lost. An .om of version 2
 * gives its faces as loops of half-edges: those are followed at the end, every link checked. */
#include "mesh.h"
#include "stream.h"

#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/IO/importer/BaseImporter.hh>
#include <OpenMesh/Core/IO/reader/OBJReader.hh>
#include <OpenMesh/Core/IO/reader/OFFReader.hh>
#include <OpenMesh/Core/IO/reader/OMReader.hh>
#include <OpenMesh/Core/IO/reader/PLYReader.hh>
#include <OpenMesh/Core/IO/reader/STLReader.hh>
#include <cstring>
#include <fstream>

using namespace OpenMesh;

/* Most faces, vertices and half-edges: OpenMesh's handles are ints. */
static const size_t elements_max = INT32_MAX;

class soup_importer : public IO::BaseImporter {
  public:
    using IO::BaseImporter::add_face_texcoords;
    using IO::BaseImporter::set_color;

    /* ---- what makes the mesh ---- */
    VertexHandle add_vertex(const Vec3f &p) override {
        return add_vertex(Vec3d(p));
    }
    VertexHandle add_vertex(const Vec3d &p) override {
        VertexHandle v = add_vertex();
        put(v, p);
        return v;
    }
    VertexHandle add_vertex() override {
        if (mesh.vertices() >= elements_max)
            throw trouble("more vertices than OpenMesh can number");
        mesh.position.insert(mesh.position.end(), 3, 0.0);
        return VertexHandle((int)mesh.vertices() - 1);
    }
    void set_point(VertexHandle v, const Vec3f &p) override {
        put(v, Vec3d(p));
    }
    FaceHandle add_face(const VHandles &corners) override {
        if (corners.size() < 3)
            throw trouble("face " + std::to_string(faces) + " has " +
                          std::to_string(corners.size()) + " corners");
        for (size_t i = 2; i < corners.size(); i++) {
            add_corner(corners[0]);
            add_corner(corners[i - 1]);
            add_corner(corners[i]);
        }
        return FaceHandle((int)faces++);
    }
    HalfedgeHandle add_edge(VertexHandle from, VertexHandle to) override {
        if (halfedges.size() >= elements_max)
            throw trouble("more edges than OpenMesh can number");
        halfedges.push_back({to, HalfedgeHandle()});
        halfedges.push_back({from, HalfedgeHandle()});
        return HalfedgeHandle((int)halfedges.size() - 2);
    }
    FaceHandle add_face(HalfedgeHandle h) override {
        loops.push_back(h);
        return FaceHandle((int)loops.size() - 1);
    }
    void set_next(HalfedgeHandle h, HalfedgeHandle next) override {
        at(h).next = next;
    }

    void set_color(VertexHandle v, const Vec4uc &c) override {
        if (!v.is_valid() || (size_t)v.idx() >= mesh.vertices())
            throw trouble("a colour for vertex " + std::to_string(v.idx()) + " of " +
                          std::to_string(mesh.vertices()));
        mesh.color.resize(mesh.vertices(), 0xffffffffu);
        mesh.color[(size_t)v.idx()] =
            c[0] | (uint32_t)c[1] << 8 | (uint32_t)c[2] << 16 | (uint32_t)c[3] << 24;
    }
    void set_color(VertexHandle v, const Vec3uc &c) override {
        set_color(v, Vec4uc(c[0], c[1], c[2], 255));
    }
    void set_color(VertexHandle v, const Vec3f &c) override {
        set_color(v, color_cast<Vec4uc>(c));
    }
    void set_color(VertexHandle v, const Vec4f &c) override {
        set_color(v, color_cast<Vec4uc>(c));
    }

    /* Follows the loops of half-edges, if any. OpenMesh reads on past the end of a cut file, so
     * that a face may come twice: but a half-edge is in one loop at most. */
    soup take() {
        std::vector<bool> used(halfedges.size());
        for (HalfedgeHandle first : loops) {
            VHandles corners;
            HalfedgeHandle h = first;
            do {
                halfedge &edge = at(h);
                if (used[(size_t)h.idx()])
                    throw trouble("face " + std::to_string(faces) +
                                  ": an edge of it is another face's");
                used[(size_t)h.idx()] = true;
                corners.push_back(edge.to);
                h = edge.next;
            } while (h != first);
            add_face(corners);
        }
        if (!mesh.color.empty())
            mesh.color.resize(mesh.vertices(), 0xffffffffu);
        return std::move(mesh);
    }

    /* ---- what a mesh does not need ---- */
    void add_face_texcoords(FaceHandle, VertexHandle, const std::vector<Vec2f> &) override {}
    void add_face_texcoords(FaceHandle, VertexHandle, const std::vector<Vec3f> &) override {}
    void set_face_texindex(FaceHandle, int) override {}
    void set_halfedge(VertexHandle, HalfedgeHandle) override {}
    void set_normal(VertexHandle, const Vec3f &) override {}
    void set_normal(VertexHandle, const Vec3d &) override {}
    void set_texcoord(VertexHandle, const Vec2f &) override {}
    void set_status(VertexHandle, const Attributes::StatusInfo &) override {}
    void set_face(HalfedgeHandle, FaceHandle) override {}
    void request_face_texcoords2D() override {}
    void set_texcoord(HalfedgeHandle, const Vec2f &) override {}
    void set_texcoord(VertexHandle, const Vec3f &) override {}
    void set_texcoord(HalfedgeHandle, const Vec3f &) override {}
    void set_status(HalfedgeHandle, const Attributes::StatusInfo &) override {}
    void set_color(EdgeHandle, const Vec3uc &) override {}
    void set_color(EdgeHandle, const Vec4uc &) override {}
    void set_color(EdgeHandle, const Vec3f &) override {}
    void set_color(EdgeHandle, const Vec4f &) override {}
    void set_status(EdgeHandle, const Attributes::StatusInfo &) override {}
    void set_normal(FaceHandle, const Vec3f &) override {}
    void set_normal(FaceHandle, const Vec3d &) override {}
    void set_color(FaceHandle, const Vec3uc &) override {}
    void set_color(FaceHandle, const Vec4uc &) override {}
    void set_color(FaceHandle, const Vec3f &) override {}
    void set_color(FaceHandle, const Vec4f &) override {}
    void set_status(FaceHandle, const Attributes::StatusInfo &) override {}
    void add_texture_information(int, std::string) override {}
    BaseKernel *kernel() override {
        return &no_properties;
    }
    size_t n_vertices() const override {
        return mesh.vertices();
    }
    size_t n_faces() const override {
        return faces + loops.size();
    }
    size_t n_edges() const override {
        return halfedges.size() / 2;
    }

  private:
    struct halfedge {
        VertexHandle to;
        HalfedgeHandle next;
    };

    soup mesh;
    size_t faces = 0;
    std::vector<halfedge> halfedges;
    std::vector<HalfedgeHandle> loops; /* a half-edge of each face */
    BaseKernel no_properties;

    halfedge &at(HalfedgeHandle h) {
        if (!h.is_valid() || (size_t)h.idx() >= halfedges.size())
            throw trouble("half-edge " + std::to_string(h.idx()) + " of " +
                          std::to_string(halfedges.size()));
        return halfedges[(size_t)h.idx()];
    }
    void put(VertexHandle v, const Vec3d &p) {
        if (!v.is_valid() || (size_t)v.idx() >= mesh.vertices())
            throw trouble("a position for vertex " + std::to_string(v.idx()) + " of " +
                          std::to_string(mesh.vertices()));
        for (size_t i = 0; i < 3; i++)
            mesh.position[3 * (size_t)v.idx() + i] = p[i];
    }
    void add_corner(VertexHandle v) {
        if (!v.is_valid() || (size_t)v.idx() >= mesh.vertices())
            throw trouble("face " + std::to_string(faces) + ": vertex " + std::to_string(v.idx()) +
                          " of " + std::to_string(mesh.vertices()));
        mesh.corner.push_back((uint32_t)v.idx());
    }
};

static IO::BaseReader &reader_of(const std::string &format) {
    if (format == "om")
        return IO::OMReader();
    if (format == "ply")
        return IO::PLYReader();
    if (format == "obj")
        return IO::OBJReader();
    if (format == "off")
        return IO::OFFReader();
    if (format == "stl")
        return IO::STLReader();
    throw trouble("--as takes om, ply, obj, off or stl");
}

/* OpenMesh asks the file's name; the bytes know better: a binary STL's length follows from its
 * count. */
static bool is_binary_stl(std::istream &in) {
    char head[84];
    uint32_t count = 0;
    in.seekg(0, std::ios::end);
    uint64_t bytes = (uint64_t)in.tellg();
    in.seekg(0);
    bool whole = (bool)in.read(head, sizeof head);
    in.clear();
    in.seekg(0);
    memcpy(&count, head + 80, 4);
    return whole && bytes == 84 + 50 * (uint64_t)count;
}

/* OpenMesh takes a cut .om for whole; its head says what should be there: "OM", the kind and the
 * version, then the numbers of vertices, faces and edges. */
static void check_om(std::istream &in, const soup_importer &found) {
    unsigned char head[16];
    in.clear();
    in.seekg(0);
    if (!in.read((char *)head, sizeof head))
        throw trouble("its header is cut short");
    uint32_t vertices, faces;
    memcpy(&vertices, head + 4, 4);
    memcpy(&faces, head + 8, 4);
    if (found.n_vertices() != vertices || found.n_faces() != faces)
        throw trouble("it promises " + std::to_string(vertices) + " vertices and " +
                      std::to_string(faces) + " faces and holds " +
                      std::to_string(found.n_vertices()) + " and " +
                      std::to_string(found.n_faces()));
}

void run_read(const arguments &given) {
    arguments args = given;
    std::string format = take_option(args, "--as");
    if (args.size() != 1)
        throw trouble("usage: read FILE --as FORMAT");
    std::ifstream in(args[0], std::ios::binary);
    if (!in)
        throw trouble("cannot open it");
    IO::BaseReader &reader = reader_of(format);
    IO::Options options = IO::Options::VertexColor;
    options += IO::Options::ColorAlpha;
    if (format == "om" || (format == "stl" && is_binary_stl(in)))
        options += IO::Options::Binary;
    soup_importer importer;
    if (!reader.read(in, importer, options))
        throw trouble("OpenMesh cannot read it as " + format);
    if (format == "om")
        check_om(in, importer);
    soup mesh = importer.take();
    if (mesh.triangles() == 0)
        throw trouble("OpenMesh finds no face in it");
    stream_write(mesh);
}

void run_write(const arguments &given) {
    arguments args = given;
    std::string format = take_option(args, "--as");
    if (args.size() != 1)
        throw trouble("usage: write FILE --as FORMAT");
    halfedge_mesh mesh;
    fill(mesh, stream_read());
    IO::Options options;
    if (format == "om" || format == "ply" || format == "stl")
        options += IO::Options::Binary;
    if (mesh.has_vertex_colors() && (format == "om" || format == "ply")) {
        options += IO::Options::VertexColor;
        options += IO::Options::ColorAlpha;
    }
    std::ofstream out(args[0], std::ios::binary);
    if (!out || !IO::write_mesh(mesh, out, "." + format, options, 17))
        throw trouble("OpenMesh cannot write it as " + format);
}
