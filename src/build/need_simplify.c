/* How much memory simplifying a mesh takes, by how many vertices and triangles it has: sums of what
 * simplify.c, surface.c, rounds.c and tree_make.c allocate for all at once, and for rounds, of
 * which mn_simplify takes whichever the cap has room for. Memory: none. Paper: none. */
#include "rounds.h"
#include "simplify.h"

/* Hinges that there may be: a lone triangle leaves one, a book's pages one each, and a surface
 * hardly any. Its own twice the vertices are as many as the triangles; what is beyond is edge, or
 * parts. */
static uint64_t hinges_expected(uint64_t vertices, uint64_t triangles) {
    uint64_t beyond = 2 * vertices > triangles ? 2 * vertices - triangles : 0;
    return beyond < triangles ? beyond : triangles;
}

uint64_t mni_whole_bytes(uint64_t vertices, uint64_t triangles) {
    uint64_t mesh = vertices * (12 + 4 /* colour */) + triangles * 12;
    uint64_t a_vertex = sizeof(mni_vertex) + 8 /* seen */ + sizeof(mni_heap_item) + 4 /* heap */ +
                        16 /* collapses */ + 8 /* bounds */ + 4 /* own */ +
                        sizeof(mni_witnesses) / 2;
    uint64_t a_triangle = sizeof(mni_simplex) + 12 /* origin */ + 24 /* pool */ +
                          24 /* pool, packed */ + 12 /* normal */ + 12 /* own */;
    uint64_t a_hinge = (sizeof(mni_simplex) + 12) * 5 / 4 + 8 /* pool */ + 12 /* tree */ + 9;
    uint64_t tree = vertices * (12 + 4 + 4 * 5 + 8 + 6 + 4 + 4 + 12) + triangles * 12;
    return mesh + vertices * a_vertex + triangles * a_triangle +
           hinges_expected(vertices, triangles) * a_hinge + tree + MNI_PROGRAM_BYTES;
}

uint64_t mni_rounds_beside_bytes(uint64_t vertices, uint64_t triangles) {
    return vertices * (12 + 4 /* colour */ + 4) + triangles * 12 + MNI_PROGRAM_BYTES;
}

static uint64_t rounds_bytes(uint64_t vertices, uint64_t triangles) {
    uint64_t tree =
        vertices * (12 + 4 + 4 * 5 + 8 + 3 + 4 /* tree */ + 20 /* history.c */) + triangles * 12;
    uint64_t writing = vertices * 20 + triangles * 8, rounds = mni_rounds_work_min(0);
    uint64_t most = tree > writing ? tree : writing;
    return mni_rounds_beside_bytes(vertices, triangles) + (most > rounds ? most : rounds);
}

uint64_t mn_simplify_need_bytes(uint64_t vertices, uint64_t triangles) {
    uint64_t whole = mni_whole_bytes(vertices, triangles), rounds;
    if (vertices <= MNI_CELL_VERTICES)
        return whole;
    rounds = rounds_bytes(vertices, triangles);
    return whole < rounds ? whole : rounds;
}
