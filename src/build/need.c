/* How much disk a build takes: a pure function of what is to be built, and of memory.
 *
 *   read       vertices and corners as they came, sorted by place, then both as they are kept
 *   simplify   the mesh, what has been made of it, and two rounds' records, less what buffers hold
 *   order      what has been made, twice, as rows, and the output
 *
 * A vertex with its two triangles takes, at the peak, of what is kept for --resume too
 * (bench/build; a tmpfs asked every 2 ms):
 *
 *   with memory for all records    66 to 74 bytes (armadillo, igea, globes, terrain), sponges 88
 *   without any                   100 to 128,                                          sponges 157
 *
 * Where rounds can do little they leave more on the way, and what memory keeps off the disk is less
 * where more threads have cells: rough surfaces with poles 103 to 126 with memory, 169 without, a
 * flat grid 159. So memory counts for little.
 *
 * Where triangles join vertices all over the model, what crosses between cells is copied to each,
 * with the corners that it lacks, and goes on in long records: up to CROSSING_BYTES for each that
 * lies in one more thousand of vertices. Of a surface an eighth of the triangles do, at most a
 * quarter.
 *
 * Memory: none. */
#include "need_disk.h"

enum {
    READ_VERTEX_BYTES = 48, /* with coordinates that floats do not hold */
    READ_TRIANGLE_BYTES = 24,
    ALL_VERTEX_BYTES = 130, /* without memory */
    ALL_TRIANGLE_BYTES = 30,
    MEMORY_SAVES = 5, /* a part of that at most */
    CROSSING_BYTES = 120,
    SURFACE_CROSSES = 4, /* a part of its triangles */
    LEAST_BYTES = 1 << 16,
};

static uint64_t max_u64(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

/* What keeps off the disk of so much memory: cells have the first of it. */
static uint64_t buffer_bytes(uint64_t ram_bytes) {
    const uint64_t cells = 8 << 20;
    return ram_bytes > cells ? (ram_bytes - cells) / 10 : 0;
}

uint64_t mn_vdt_temp_bytes(uint64_t vertices, uint64_t triangles, uint64_t ram_bytes) {
    /* Corners that bring their own vertices (STL) are welded: two triangles have one. */
    const uint64_t half = triangles / 2 + triangles / 20,
                   welded = vertices < half ? vertices : half;
    const uint64_t read = READ_VERTEX_BYTES * vertices + READ_TRIANGLE_BYTES * triangles;
    const uint64_t all = ALL_VERTEX_BYTES * welded + ALL_TRIANGLE_BYTES * triangles;
    const uint64_t most = all / MEMORY_SAVES;
    const uint64_t buffers = ram_bytes == 0 ? most : buffer_bytes(ram_bytes);
    return LEAST_BYTES + max_u64(read, all - (buffers < most ? buffers : most));
}

uint64_t mni_vdt_temp_bytes_of(const mni_extmesh *mesh, uint64_t ram_bytes) {
    const uint64_t usual = mesh->triangles / SURFACE_CROSSES;
    const uint64_t more = mesh->crossings > usual ? mesh->crossings - usual : 0;
    return mn_vdt_temp_bytes(mesh->vertices, mesh->triangles, ram_bytes) + CROSSING_BYTES * more;
}
