/* See stream.h. */
#include "stream.h"

#include <cstdio>
#include <cstring>

static const char magic[8] = {'M', 'N', 'O', 'M', 'S', 'T', 'R', 'M'};

struct stream_header {
    char magic[8];
    uint64_t vertices, triangles;
    uint32_t has_colors, zero;
};
static_assert(sizeof(stream_header) == 32, "the header has no padding");
static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the stream is the host's order");

template <class T> static void take(std::vector<T> &out, size_t count) {
    out.resize(count);
    if (count > 0 && fread(out.data(), sizeof(T), count, stdin) != count)
        throw trouble("the mesh on standard input is cut short");
}

template <class T> static void put(const T *values, size_t count) {
    if (count > 0 && fwrite(values, sizeof(T), count, stdout) != count)
        throw trouble("cannot write the mesh to standard output");
}

soup stream_read() {
    stream_header h;
    if (fread(&h, sizeof h, 1, stdin) != 1 || memcmp(h.magic, magic, sizeof magic) != 0)
        throw trouble("standard input is not a mesh stream");
    if (h.vertices > INT32_MAX || h.triangles > INT32_MAX)
        throw trouble("the mesh has more vertices or triangles than OpenMesh can number");
    soup mesh;
    take(mesh.position, 3 * h.vertices);
    if (h.has_colors != 0)
        take(mesh.color, h.vertices);
    take(mesh.corner, 3 * h.triangles);
    for (uint32_t v : mesh.corner)
        if (v >= h.vertices)
            throw trouble("a corner is out of range in the mesh on standard input");
    return mesh;
}

void stream_write(const soup &mesh) {
    stream_header h = {};
    memcpy(h.magic, magic, sizeof magic);
    h.vertices = mesh.vertices();
    h.triangles = mesh.triangles();
    h.has_colors = !mesh.color.empty();
    put(&h, 1);
    put(mesh.position.data(), mesh.position.size());
    put(mesh.color.data(), mesh.color.size());
    put(mesh.corner.data(), mesh.corner.size());
    if (fflush(stdout) != 0)
        throw trouble("cannot write the mesh to standard output");
}
