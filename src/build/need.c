/* How much disk a build takes: a pure function of what is to be built, and of memory.
 *
 *   read       vertices and corners as they came, sorted by place, then both as they are kept
 *   simplify   the mesh, what has been made of it, and two rounds' records, half of which are left
 *              after each; where these fit in memory only the mesh and what has been made of it
 *   order      what has been made, twice, as rows, and the output
 *
 * The factors are a third above what was measured (bench/build, columns disk and planned; sponges
 * of 1 to 3 million triangles take most). Memory: none. */
#include "metanode/build.h"

enum {
    READ_VERTEX_BYTES = 48, /* with coordinates that floats do not hold */
    READ_TRIANGLE_BYTES = 24,
    IN_MEMORY_BYTES = 1000, /* of memory, a vertex: what rounds' records and their sorts take */
    SIMPLIFY_VERTEX_BYTES = 200,
    SIMPLIFY_TRIANGLE_BYTES = 60,
    ORDER_VERTEX_BYTES = 160, /* in memory, simplifying takes less than that */
    LEAST_BYTES = 1 << 16,
};

static uint64_t max_u64(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

uint64_t mn_vdt_temp_bytes(uint64_t vertices, uint64_t triangles, uint64_t ram_bytes) {
    /* Corners that bring their own vertices (STL) are welded: two triangles have one. */
    const uint64_t half = triangles / 2 + triangles / 20,
                   welded = vertices < half ? vertices : half;
    const uint64_t read = READ_VERTEX_BYTES * vertices + READ_TRIANGLE_BYTES * triangles;
    const bool in_memory = ram_bytes == 0 || ram_bytes / IN_MEMORY_BYTES > welded;
    const uint64_t simplify =
        in_memory ? 0 : SIMPLIFY_VERTEX_BYTES * welded + SIMPLIFY_TRIANGLE_BYTES * triangles;
    return LEAST_BYTES + max_u64(read, max_u64(simplify, ORDER_VERTEX_BYTES * welded));
}
