/* What the driver holds of a front, kept here too, so that only what has changed is sent.
 *
 * Hides how a front's slots become what a renderer draws: a vertex and a normal a node slot, three
 * indices a simplex slot, three times the same where there is no triangle (empty slots, hinges).
 *
 *   front ── pages written since ──> compared with the mirror ──> mirror, and a bit for each
 *                                                                 vertex, normal and triangle to
 * send
 *
 * Normals are made of the active triangles: what is stored with a node describes the input beneath
 * it, not the surface that is drawn, and leaves have nothing. Weights are the angles
 * at the corners, and slivers count for less. Sums are integers: what a triangle has added is taken
 * away again to the bit when it goes, and a sum does not depend on the way to it. So pictures do
 * not, either.
 *
 * Order: open; then update and take, in turn; close. Any one thread. Memory: from malloc at open,
 * touched as slots are: 32 bytes a node slot (with colours 36), 12 a simplex slot, and bits. An
 * update is O(written pages × 64 + changes). */
#include "parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"

/* A sum's unit, in radians: 8,192 of them fit, more than the corners of a pole with thousands of
 * neighbours have. */
static const double units_per_radian = 1 << 18;
/* Height over longest side below which a triangle is a sliver and counts for less: scans have flat
 * ones that stand askew, and the angle at the middle of one is half a turn. */
static const double full_shape = 0.25;

static inline bool bit_get(const uint64_t *bits, uint32_t i) {
    return bits[i / 64] >> (i % 64) & 1;
}

static inline void bit_set(uint64_t *bits, uint32_t i) {
    bits[i / 64] |= UINT64_C(1) << (i % 64);
}

static inline bool is_triangle(const uint32_t *v) {
    return v[0] != v[1];
}

/* ---- open and close -------------------------------------------------------------------------- */

static void *zeroed(size_t count, size_t size) {
    return calloc(count + 1, size); /* never 0 bytes */
}

bool mni_surface_open(mni_surface *s, uint32_t node_slots_max, uint32_t simplex_slots_max,
                      bool has_colors) {
    const size_t nodes = node_slots_max, simplices = simplex_slots_max;
    *s = (mni_surface){.node_slots_max = node_slots_max, .simplex_slots_max = simplex_slots_max};
    s->vertex = zeroed(nodes, sizeof *s->vertex);
    s->color = has_colors ? zeroed(nodes, sizeof *s->color) : NULL;
    s->normal = zeroed(nodes, sizeof *s->normal);
    s->sum = zeroed(nodes, sizeof *s->sum);
    s->index = zeroed(simplices, sizeof *s->index);
    s->vertex_new = zeroed(nodes / 64 + 1, sizeof *s->vertex_new);
    s->normal_new = zeroed(nodes / 64 + 1, sizeof *s->normal_new);
    s->index_new = zeroed(simplices / 64 + 1, sizeof *s->index_new);
    if (s->vertex != NULL && (s->color != NULL || !has_colors) && s->normal != NULL &&
        s->sum != NULL && s->index != NULL && s->vertex_new != NULL && s->normal_new != NULL &&
        s->index_new != NULL)
        return true;
    mni_surface_close(s);
    return false;
}

void mni_surface_close(mni_surface *s) {
    free(s->vertex);
    free(s->color);
    free(s->normal);
    free(s->sum);
    free(s->index);
    free(s->vertex_new);
    free(s->normal_new);
    free(s->index_new);
    *s = (mni_surface){0};
}

/* ---- normals --------------------------------------------------------------------------------- */

/* The angle whose cosine is x, to 7e-5 (Abramowitz and Stegun, 4.4.45): a weight need not be
 * better, and it is a quarter of the work of acos. */
static double angle(double x) {
    const double c = fabs(x) < 1 ? fabs(x) : 1;
    const double a = sqrt(1 - c) * (1.5707288 + c * (-0.2121144 + c * (0.0742610 - c * 0.0187293)));
    return x < 0 ? 3.14159265 - a : a;
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* What a triangle adds at its corners; all 0 where it has no area. */
static void corner_normals(const float *const p[3], uint32_t out[3][3]) {
    double e[3][3], n[3], length[3]; /* e[k] runs from corner k to the next one */
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++)
            e[k][i] = (double)p[(k + 1) % 3][i] - (double)p[k][i];
    for (int i = 0; i < 3; i++)
        n[i] = e[0][(i + 1) % 3] * e[1][(i + 2) % 3] - e[0][(i + 2) % 3] * e[1][(i + 1) % 3];
    const double twice_area = sqrt(dot(n, n));
    if (!(twice_area > 0)) {
        memset(out, 0, 9 * sizeof out[0][0]);
        return;
    }
    for (int k = 0; k < 3; k++)
        length[k] = sqrt(dot(e[k], e[k]));
    double longest = length[0] > length[1] ? length[0] : length[1];
    longest = longest > length[2] ? longest : length[2];
    const double shape = twice_area / (longest * longest),
                 full = shape < full_shape ? shape / full_shape : 1;
    const double unit = units_per_radian * full / twice_area;
    for (int k = 0; k < 3; k++) {
        const int before = (k + 2) % 3;
        const double weight = unit * angle(-dot(e[k], e[before]) / (length[k] * length[before]));
        for (int i = 0; i < 3; i++)
            out[k][i] = (uint32_t)lrint(n[i] * weight);
    }
}

static void add(mni_surface *s, uint32_t slot, const uint32_t normal[3]) {
    for (int i = 0; i < 3; i++) /* round and round: only shading is at stake */
        s->sum[slot][i] += normal[i];
    bit_set(s->normal_new, slot);
}

static void take_away(mni_surface *s, uint32_t slot, const uint32_t normal[3]) {
    for (int i = 0; i < 3; i++)
        s->sum[slot][i] -= normal[i];
    bit_set(s->normal_new, slot);
}

uint32_t mni_surface_pack(const uint32_t sum[3]) {
    const double x = (int32_t)sum[0], y = (int32_t)sum[1], z = (int32_t)sum[2];
    const double length = sqrt(x * x + y * y + z * z);
    if (!(length > 0))
        return 0;
    const double scale = 511 / length;
    return ((uint32_t)lrint(x * scale) & 1023) | ((uint32_t)lrint(y * scale) & 1023) << 10 |
           ((uint32_t)lrint(z * scale) & 1023) << 20;
}

/* ---- update ---------------------------------------------------------------------------------- */

/* What is not stamped is as the mirror has it only if the mirror is of this front. */
static bool must_look(const mni_surface *s, const mn_front *front, const uint32_t *stamp,
                      uint32_t page) {
    return stamp == NULL || front->position != s->source || front->version < s->version ||
           front->version - s->version >= UINT32_C(1) << 31 ||
           mn_front_written(stamp[page], s->version);
}

static bool vertex_differs(const mni_surface *s, const mn_front *front, uint32_t slot) {
    const float *p = front->position + 3 * (size_t)slot, *have = s->vertex[slot];
    return memcmp(p, have, 3 * sizeof *p) != 0 ||
           memcmp(&front->switch_value[slot], &have[3], sizeof *have) != 0 ||
           (s->color != NULL && front->color != NULL && front->color[slot] != s->color[slot]);
}

static void find_vertices(mni_surface *s, const mn_front *front) {
    for (uint32_t slot = 0; slot < front->node_slots; slot++) {
        if (slot % MN_FRONT_PAGE == 0 &&
            !must_look(s, front, front->node_stamp, slot / MN_FRONT_PAGE))
            slot += MN_FRONT_PAGE - 1;
        else if (vertex_differs(s, front, slot))
            bit_set(s->vertex_new, slot);
    }
}

static void wanted(const mn_front *front, uint32_t simplex, uint32_t v[3]) {
    const uint32_t *node = front->simplex_node + 3 * (size_t)simplex;
    if (simplex >= front->simplex_slots || node[0] == MN_NONE || node[2] == MN_NONE)
        v[0] = v[1] = v[2] = 0;
    else
        memcpy(v, node, 3 * sizeof *v);
}

/* The triangle of a slot goes, and what it has added. Most often it comes back as it lies, with a
 * corner at the child or the parent of the node that it was at: then it is in its new place at
 * once. */
static void let_go(mni_surface *s, const mn_front *front, uint32_t simplex, const uint32_t v[3]) {
    uint32_t *had = s->index[simplex], normal[3][3];
    const float *p[3];
    bool stays = is_triangle(v);
    for (int k = 0; k < 3; k++) {
        p[k] = s->vertex[had[k]];
        stays = stays && memcmp(p[k], front->position + 3 * (size_t)v[k], 3 * sizeof *p[k]) == 0;
    }
    corner_normals(p, normal);
    for (int k = 0; k < 3; k++) {
        if (stays && had[k] == v[k])
            continue;
        take_away(s, had[k], normal[k]);
        if (stays)
            add(s, v[k], normal[k]);
        had[k] = stays ? v[k] : 0;
    }
    s->triangles -= !stays;
}

static void come(mni_surface *s, uint32_t simplex, const uint32_t v[3]) {
    const float *const p[3] = {s->vertex[v[0]], s->vertex[v[1]], s->vertex[v[2]]};
    uint32_t normal[3][3];
    for (int k = 0; k < 3; k++)
        __builtin_prefetch(s->sum[v[k]], 1);
    memcpy(s->index[simplex], v, sizeof s->index[simplex]);
    if (!is_triangle(v))
        return;
    corner_normals(p, normal);
    for (int k = 0; k < 3; k++)
        add(s, v[k], normal[k]);
    s->triangles++;
}

static bool triangle_differs(const mni_surface *s, uint32_t simplex, const uint32_t v[3]) {
    return memcmp(v, s->index[simplex], 3 * sizeof *v) != 0 ||
           (is_triangle(v) && (bit_get(s->vertex_new, v[0]) || bit_get(s->vertex_new, v[1]) ||
                               bit_get(s->vertex_new, v[2])));
}

/* A page of triangles. Those that differ lie with corners all over the mirror: these are fetched
 * while the rest of the page is looked at. */
static void find_in_page(mni_surface *s, const mn_front *front, uint32_t at, uint32_t end) {
    uint32_t found[MN_FRONT_PAGE], v[MN_FRONT_PAGE][3], count = 0;
    for (; at < end; at++) {
        wanted(front, at, v[count]);
        if (!triangle_differs(s, at, v[count]))
            continue;
        bit_set(s->index_new, at);
        if (!is_triangle(s->index[at]))
            continue;
        for (int k = 0; k < 3; k++) {
            __builtin_prefetch(s->vertex[s->index[at][k]]);
            __builtin_prefetch(s->sum[s->index[at][k]], 1);
            __builtin_prefetch(front->position + 3 * (size_t)v[count][k]);
        }
        found[count++] = at;
    }
    for (uint32_t i = 0; i < count; i++)
        let_go(s, front, found[i], v[i]);
}

/* Lets go while the mirror still has the old corners. What is then not as it is wanted has to come,
 * when it has the new ones. */
static void find_triangles(mni_surface *s, const mn_front *front) {
    for (uint32_t at = 0, end; at < s->simplex_high; at = end) {
        end = at + MN_FRONT_PAGE < s->simplex_high ? at + MN_FRONT_PAGE : s->simplex_high;
        if (end > front->simplex_slots ||
            must_look(s, front, front->simplex_stamp, at / MN_FRONT_PAGE))
            find_in_page(s, front, at, end);
    }
}

static void take_vertex(mni_surface *s, const mn_front *front, uint32_t slot) {
    memcpy(s->vertex[slot], front->position + 3 * (size_t)slot, 3 * sizeof(float));
    s->vertex[slot][3] = front->switch_value[slot];
    if (s->color != NULL && front->color != NULL)
        s->color[slot] = front->color[slot];
}

/* What the driver has never been sent is not what the mirror begins with. */
static void grow(mni_surface *s, const mn_front *front) {
    s->node_fresh = s->node_high;
    for (; s->node_high < front->node_slots; s->node_high++) {
        bit_set(s->vertex_new, s->node_high);
        bit_set(s->normal_new, s->node_high);
    }
    for (; s->simplex_high < front->simplex_slots; s->simplex_high++)
        bit_set(s->index_new, s->simplex_high);
}

static void make_normal(mni_surface *s, uint32_t slot) {
    const uint32_t normal = mni_surface_pack(s->sum[slot]);
    if (normal == s->normal[slot] && slot < s->node_fresh)
        s->normal_new[slot / 64] &= ~(UINT64_C(1) << (slot % 64));
    s->normal[slot] = normal;
}

void mni_surface_update(mni_surface *s, const mn_front *front) {
    MN_ASSERT(front->node_slots <= s->node_slots_max);
    MN_ASSERT(front->simplex_slots <= s->simplex_slots_max);
    MN_ASSERT(!s->pending);
    uint32_t at = 0, end;
    grow(s, front);
    find_vertices(s, front);
    find_triangles(s, front);
    for (; mni_surface_run(s->vertex_new, s->node_high, 0, &at, &end);)
        for (; at < end; at++)
            take_vertex(s, front, at);
    for (at = 0; mni_surface_run(s->index_new, s->simplex_high, 0, &at, &end);)
        for (; at < end; at++) {
            uint32_t v[3];
            wanted(front, at, v);
            if (memcmp(v, s->index[at], sizeof v) != 0)
                come(s, at, v);
        }
    for (at = 0; mni_surface_run(s->normal_new, s->node_high, 0, &at, &end);)
        for (; at < end; at++)
            make_normal(s, at);
    s->source = front->position;
    s->version = front->version;
    s->pending = true;
}

void mni_surface_sent(mni_surface *s) {
    memset(s->vertex_new, 0, (s->node_high / 64 + 1) * sizeof *s->vertex_new);
    memset(s->normal_new, 0, (s->node_high / 64 + 1) * sizeof *s->normal_new);
    memset(s->index_new, 0, (s->simplex_high / 64 + 1) * sizeof *s->index_new);
    s->pending = false;
}

/* ---- runs of bits ---------------------------------------------------------------------------- */

/* The first bit at or after `from` that is set (flip 0) or clear (flip all ones); limit if none. */
static uint32_t next(const uint64_t *bits, uint64_t flip, uint32_t from, uint32_t limit) {
    if (from >= limit)
        return limit;
    uint32_t word = from / 64;
    uint64_t found = (bits[word] ^ flip) & UINT64_MAX << (from % 64);
    while (found == 0 && ++word <= (limit - 1) / 64)
        found = bits[word] ^ flip;
    const uint32_t at = found != 0 ? 64 * word + (uint32_t)__builtin_ctzll(found) : limit;
    return at < limit ? at : limit;
}

bool mni_surface_run(const uint64_t *bits, uint32_t limit, uint32_t gap, uint32_t *first,
                     uint32_t *end) {
    *first = next(bits, 0, *first, limit);
    if (*first == limit)
        return false;
    *end = next(bits, UINT64_MAX, *first, limit);
    for (uint32_t more; (more = next(bits, 0, *end, limit)) < limit && more - *end <= gap;)
        *end = next(bits, UINT64_MAX, more, limit);
    return true;
}

void mni_surface_all(uint64_t *bits, uint32_t limit) {
    memset(bits, 0xff, limit / 64 * sizeof *bits);
    if (limit % 64 != 0)
        bits[limit / 64] |= UINT64_MAX >> (64 - limit % 64);
}
