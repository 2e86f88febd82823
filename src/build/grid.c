/* Positions onto one grid of the whole model.
 *
 * Hides: how the step is chosen, and how positions that fall together are counted. The step is a
 * power of two and the grid goes through the origin: so a position, a multiple of the step, is
 * exact as a float, and so are differences of positions, which is what blocks hold. One grid for
 * all: what meets still meets, no cracks. Order: none. One thread a mesh. Memory: a table of 8
 * bytes a vertex while it counts. Paper: none. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "grid.h"
#include "metanode/build.h"

mn_code mni_grid_bits(uint32_t *bits, mn_status *st) {
    if (*bits == 0)
        *bits = MN_POSITION_BITS;
    if (*bits >= MN_POSITION_BITS_MIN && *bits <= MN_POSITION_BITS_MAX)
        return MN_OK;
    return mn_fail(st, MN_USAGE, "%u bits a position: %d to %d", *bits, MN_POSITION_BITS_MIN,
                   MN_POSITION_BITS_MAX);
}

float mni_grid_step(const float low[3], const float high[3], uint32_t bits) {
    double longest = 0, farthest = 0;
    for (int i = 0; i < 3; i++) {
        longest = fmax(longest, (double)high[i] - low[i]);
        farthest = fmax(farthest, fmax(fabs((double)high[i]), fabs((double)low[i])));
    }
    if (longest == 0) /* a point: the grid of its floats */
        longest = farthest > 0 ? farthest * 0x1p-23 : 1;
    int exponent = 0;
    double mantissa = frexp(longest, &exponent);
    exponent -= (mantissa == 0.5) + (int)bits;
    return ldexpf(1, exponent < -149 ? -149 : exponent); /* the least float there is */
}

static float step_of(const mn_mesh *m, uint32_t bits) {
    float low[3], high[3];
    for (int i = 0; i < 3; i++) {
        low[i] = high[i] = m->position[i];
        for (uint32_t v = 1; v < m->vertices; v++) {
            float at = m->position[3 * (size_t)v + (size_t)i];
            low[i] = at < low[i] ? at : low[i];
            high[i] = at > high[i] ? at : high[i];
        }
    }
    return mni_grid_step(low, high, bits);
}

/* How many different positions there are. */
static bool count_places(const mn_mesh *m, uint64_t *places) {
    uint64_t slots = 64;
    while (slots < 2 * (uint64_t)m->vertices)
        slots *= 2;
    uint32_t *table = malloc(slots * sizeof *table);
    if (table == NULL)
        return false;
    memset(table, 0xff, slots * sizeof *table);
    *places = 0;
    for (uint32_t v = 0; v < m->vertices; v++) {
        const float *p = m->position + 3 * (size_t)v;
        float at[3] = {p[0] + 0.0f, p[1] + 0.0f, p[2] + 0.0f}; /* -0 becomes 0 */
        uint64_t slot = XXH3_64bits(at, sizeof at) & (slots - 1);
        while (table[slot] != MN_NONE) {
            const float *q = m->position + 3 * (size_t)table[slot];
            if (q[0] == p[0] && q[1] == p[1] && q[2] == p[2])
                break;
            slot = (slot + 1) & (slots - 1);
        }
        if (table[slot] == MN_NONE) {
            table[slot] = v;
            ++*places;
        }
    }
    free(table);
    return true;
}

mn_code mn_mesh_quantise(mn_mesh *m, uint32_t bits, mn_status *st) {
    uint64_t before = 0, after = 0;
    if (mni_grid_bits(&bits, st) != MN_OK)
        return MN_USAGE;
    if (!count_places(m, &before))
        return mn_fail(st, MN_FAILED, "no memory to look for equal ones of %u positions",
                       m->vertices);
    m->grid_step = step_of(m, bits);
    for (size_t i = 0; i < 3 * (size_t)m->vertices; i++)
        m->position[i] = mni_grid_round(m->position[i], m->grid_step);
    if (!count_places(m, &after))
        return mn_fail(st, MN_FAILED, "no memory to look for equal ones of %u positions",
                       m->vertices);
    m->intake.merged_positions += before - after;
    return MN_OK;
}
