/* How much disk a build takes: a pure function of what is to be built. Memory: none. */
#include "metanode/build.h"

/* Measured at 16 MB, where nothing stays in memory. */
static const uint64_t BYTES_A_VERTEX = 500, BYTES_A_TRIANGLE = 100, BYTES_AT_LEAST = 1 << 16;

uint64_t mn_vdt_temp_bytes(uint64_t vertices, uint64_t triangles) {
    return BYTES_AT_LEAST + BYTES_A_VERTEX * vertices + BYTES_A_TRIANGLE * triangles;
}
