/* See legal.h. Hidden here: how a ring is read, once as a wheel where it can be, otherwise vertex
 * by vertex; both ways say the same. */
#include "legal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mem.h"
#include "mn_assert.h"

/* k's fan is walked whole for the link condition up to this length; a longer one (a pole) is asked
 * about each ring vertex instead, through that vertex's own, shorter list, unless those come to as
 * much as so many of k's: a hub or two in the ring are found soon. */
enum { SHORT_FAN = 48, LONG_LISTS = 16, RING_ROOM = 64 };
_Static_assert((int)RING_ROOM >= (int)MNI_WHEEL_MAX, "a wheel's ring fits");

static void cross(const float *o, const float *a, const float *b, double n[3]) {
    double ax = (double)a[0] - o[0], ay = (double)a[1] - o[1], az = (double)a[2] - o[2];
    double bx = (double)b[0] - o[0], by = (double)b[1] - o[1], bz = (double)b[2] - o[2];
    n[0] = ay * bz - az * by;
    n[1] = az * bx - ax * bz;
    n[2] = ax * by - ay * bx;
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

mn_code mni_judge_room(mni_judge *j, uint32_t vertices, uint32_t triangles, mn_status *st) {
    *j = (mni_judge){.ring_room = RING_ROOM, .wheel_of = MN_NONE, .kept_of = MN_NONE};
    const size_t normals_bytes = (size_t)triangles * 3 * sizeof *j->normal;
    j->normal = mni_mem_take(normals_bytes, normals_bytes);
    j->seen = mni_mem_take_zeroed(vertices * sizeof *j->seen);
    j->ring = malloc(j->ring_room * sizeof *j->ring);
    j->around = malloc(j->ring_room * sizeof *j->around);
    if (j->normal == NULL || j->seen == NULL || j->ring == NULL || j->around == NULL) {
        mni_judge_close(j);
        return mn_fail(st, MN_FAILED, "out of memory while simplifying %u triangles", triangles);
    }
    return MN_OK;
}

mn_code mni_judge_open(mni_judge *j, const mni_surface *s, mn_status *st) {
    mn_code code = mni_judge_room(j, s->vertices, s->triangles, st);
    if (code == MN_OK)
        mni_judge_fill(j, s);
    return code;
}

void mni_judge_fill(mni_judge *j, const mni_surface *s) {
    for (uint32_t t = 0; t < s->triangles; t++) {
        const uint32_t *c = s->simplex[t].v;
        double n[3];
        cross(s->vertex[c[0]].p, s->vertex[c[1]].p, s->vertex[c[2]].p, n);
        double length = sqrt(dot(n, n));
        for (int i = 0; i < 3; i++)
            j->normal[3 * (size_t)t + i] = length > 0 ? (float)(n[i] / length) : 0;
    }
}

void mni_judge_close(mni_judge *j) {
    mni_mem_give(j->normal);
    mni_mem_give(j->seen);
    free(j->ring);
    free(j->around);
    memset(j, 0, sizeof *j);
}

static bool ring_grow(mni_judge *j) {
    size_t room = 2 * (size_t)j->ring_room;
    mni_ring_vertex *ring = realloc(j->ring, room * sizeof *ring);
    if (ring == NULL)
        return false;
    j->ring = ring;
    uint32_t *around = realloc(j->around, room * sizeof *around);
    if (around == NULL)
        return false;
    j->around = around;
    j->ring_room = (uint32_t)room;
    return true;
}

/* The ring vertex of `vertex`, made if it is new. */
static uint32_t ring_at(mni_judge *j, uint32_t vertex) {
    uint64_t seen = j->seen[vertex];
    if (seen >> 32 == j->epoch)
        return (uint32_t)seen;
    if (j->ring_count == j->ring_room && !ring_grow(j)) {
        j->no_memory = true;
        return 0;
    }
    uint32_t at = j->ring_count++;
    j->around[at] = vertex;
    j->ring[at] = (mni_ring_vertex){.group = at};
    j->seen[vertex] = (uint64_t)j->epoch << 32 | at;
    return at;
}

static uint32_t group_of(mni_judge *j, uint32_t at) {
    while (j->ring[at].group != at) {
        j->ring[at].group = j->ring[j->ring[at].group].group;
        at = j->ring[at].group;
    }
    return at;
}

static void new_epoch(mni_judge *j, uint32_t vertices) {
    if (++j->epoch == 0) { /* after 2^32 rings */
        memset(j->seen, 0, vertices * sizeof *j->seen);
        j->epoch = 1;
    }
    j->ring_count = 0;
}

void mni_judge_ring(mni_judge *j, mni_surface *s, uint32_t v) {
    uint32_t count;
    const uint32_t *fan = mni_surface_fan(s, v, &count);
    new_epoch(j, s->vertices);
    j->round = false;
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex *x = &s->simplex[fan[i]];
        mni_corner c = mni_simplex_corner(x, v);
        if (x->v[2] == MN_NONE) {
            uint32_t at = ring_at(j, x->v[1 - c.at]);
            j->ring[at].hinges++;
            continue;
        }
        uint32_t a = ring_at(j, c.next);
        uint32_t b = ring_at(j, c.previous);
        j->ring[a].triangles++;
        j->ring[a].balance++;
        j->ring[b].triangles++;
        j->ring[b].balance--;
        uint32_t ga = group_of(j, a), gb = group_of(j, b);
        j->ring[ga].group = gb;
    }
}

/* Follows the wheel from `first`, triangle by triangle. It goes once round if it is back after as
 * many as there are, and not before: then no vertex came twice. */
static bool goes_round(mni_judge *j, uint32_t first) {
    const mni_wheel *w = &j->wheel;
    uint32_t at = first;
    if (w->count < 3)
        return false;
    for (uint32_t i = 0; i < w->count; i++) {
        uint32_t spoke = mni_wheel_find(w->next, w->count, at);
        if (spoke == MNI_WHEEL_MAX || (i > 0 && at == first))
            return false;
        j->around[i] = at;
        j->spoke[i] = spoke;
        at = w->previous[spoke];
    }
    return at == first;
}

bool mni_judge_wheel(mni_judge *j, mni_surface *s, uint32_t v) {
    if (j->wheel_of == v)
        return true;
    bool has = mni_surface_wheel(s, v, &j->wheel);
    j->wheel_of = has ? v : MN_NONE;
    return has;
}

void mni_judge_look(mni_judge *j, mni_surface *s, uint32_t r, uint32_t k) {
    j->round = mni_judge_wheel(j, s, r) && goes_round(j, k);
    if (j->round)
        j->ring_count = j->wheel.count;
    else
        mni_judge_ring(j, s, r);
}

bool mni_judge_regular(mni_judge *j, mni_surface *s, uint32_t v) {
    j->round = mni_judge_wheel(j, s, v) && goes_round(j, j->wheel.next[0]);
    j->ring_count = j->round ? j->wheel.count : 0;
    return j->round;
}

bool mni_ring_vertex_singular(const mni_ring_vertex *n) {
    return n->triangles != 2 || n->balance != 0 || n->hinges > 0;
}

static bool in_ring(const mni_judge *j, uint32_t vertex, uint32_t *at) {
    *at = (uint32_t)j->seen[vertex];
    return j->seen[vertex] >> 32 == j->epoch;
}

/* Whether k's fan is to be walked: on a rim of many hubs all lists are long. */
static bool fan_is_less(const mni_judge *j, const mni_surface *s, uint32_t k) {
    const uint64_t fan = s->vertex[k].fan.count;
    uint64_t lists = 0;
    if (fan <= SHORT_FAN)
        return true;
    for (uint32_t i = 0; i < j->ring_count && j->ring_count >= LONG_LISTS; i++) {
        const uint64_t list = s->vertex[j->around[i]].fan.count;
        lists += list < fan ? list : fan;
    }
    return lists >= LONG_LISTS * fan;
}

/* Whether k has a neighbour in r's ring that is no apex of a triangle at kr. */
static bool strays(mni_judge *j, mni_surface *s, uint32_t r, uint32_t k) {
    uint32_t count, at;
    if (!fan_is_less(j, s, k)) {
        for (uint32_t i = 0; i < j->ring_count; i++)
            if (j->around[i] != k && j->ring[i].apexes == 0 &&
                mni_surface_joined(s, j->around[i], k))
                return true;
        return false;
    }
    const uint32_t *fan = mni_surface_fan(s, k, &count);
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex *x = &s->simplex[fan[i]];
        for (int c = 0; c < 3; c++) {
            uint32_t y = x->v[c];
            if (y != MN_NONE && y != k && y != r && in_ring(j, y, &at) && j->ring[at].apexes == 0)
                return true;
        }
    }
    return false;
}

/* The first alive triangle in the shortest list that holds all three; MN_NONE. */
static uint32_t find_triangle(mni_surface *s, uint32_t a, uint32_t b, uint32_t k) {
    uint32_t count, shortest[3] = {a, b, k};
    for (int i = 1; i < 3; i++) /* to the front: one of them may be a pole */
        if (s->vertex[shortest[i]].fan.count < s->vertex[shortest[0]].fan.count) {
            uint32_t other = shortest[0];
            shortest[0] = shortest[i];
            shortest[i] = other;
        }
    a = shortest[0];
    b = shortest[1];
    k = shortest[2];
    const uint32_t *list = mni_surface_fan(s, a, &count);
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex *x = &s->simplex[list[i]];
        bool has_k = x->v[0] == k || x->v[1] == k || x->v[2] == k;
        bool has_b = x->v[0] == b || x->v[1] == b || x->v[2] == b;
        if (has_k && has_b)
            return list[i];
    }
    return MN_NONE;
}

static bool holds_all(const mni_simplex *x, const uint32_t v[3]) {
    for (int i = 0; i < 3; i++)
        if (x->v[0] != v[i] && x->v[1] != v[i] && x->v[2] != v[i])
            return false;
    return true;
}

/* The same for three hubs, whose lists are long: what was found out is kept. Those of a pencil are
 * asked about by each of its thousands. */
static bool trio_held(mni_judge *j, mni_surface *s, const uint32_t v[3]) {
    uint32_t hash = (v[0] * 31 + v[1]) * 31 + v[2];
    mni_trio *t = &j->trio[(hash * 0x9e3779b1u) >> 16 & (MNI_TRIOS - 1)];
    bool same = memcmp(t->v, v, sizeof t->v) == 0;
    if (same && t->triangle == MN_NONE && t->trios == s->trios)
        return false;
    if (same && t->triangle != MN_NONE && s->simplex[t->triangle].killed == MN_NONE &&
        holds_all(&s->simplex[t->triangle], v))
        return true;
    s->walked += s->vertex[v[0]].fan.count;
    *t = (mni_trio){{v[0], v[1], v[2]}, find_triangle(s, v[0], v[1], v[2]), s->trios};
    return t->triangle != MN_NONE;
}

/* Whether an alive triangle holds all three. */
static bool triangle_holds(mni_judge *j, mni_surface *s, uint32_t a, uint32_t b, uint32_t k) {
    uint32_t low = a < b ? a : b, high = a < b ? b : a;
    uint32_t v[3] = {k < low ? k : low, k < low ? low : k < high ? k : high, k > high ? k : high};
    if (s->vertex[a].hub && s->vertex[b].hub && s->vertex[k].hub)
        return trio_held(j, s, v);
    return find_triangle(s, a, b, k) != MN_NONE;
}

/* Whether a triangle of r comes to lie on one that k has already: the last step of a closed
 * tetrahedron. Both its other corners are then apexes. */
static bool doubles(mni_judge *j, mni_surface *s, uint32_t r, uint32_t k) {
    uint32_t count;
    const uint32_t *fan = mni_surface_fan(s, r, &count);
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex *x = &s->simplex[fan[i]];
        if (x->v[2] == MN_NONE)
            continue;
        mni_corner c = mni_simplex_corner(x, r);
        uint32_t a = c.next, b = c.previous, at_a, at_b;
        if (a == k || b == k || !in_ring(j, a, &at_a) || !in_ring(j, b, &at_b) ||
            j->ring[at_a].apexes == 0 || j->ring[at_b].apexes == 0)
            continue;
        if (triangle_holds(j, s, a, b, k))
            return true;
    }
    return false;
}

/* r is singular: kr must be too, r on exactly two singular edges with equal numbers of triangles,
 * and these must hold its triangles together. All but the first is r's own affair: an edge with
 * thousands of faces need not be asked about each of them. */
static bool singular_may_go(mni_judge *j, uint32_t k) {
    uint32_t singular = 0, triangles[2] = {0, 0}, group = MN_NONE;
    bool k_singular = false;
    j->stuck = true;
    for (uint32_t i = 0; i < j->ring_count; i++) {
        const mni_ring_vertex *n = &j->ring[i];
        if (group == MN_NONE)
            group = group_of(j, i);
        if (group_of(j, i) != group)
            return false;
        if (!mni_ring_vertex_singular(n))
            continue;
        if (singular == 2)
            return false;
        triangles[singular++] = n->triangles;
        k_singular |= j->around[i] == k;
    }
    if (singular != 2 || triangles[0] != triangles[1])
        return false;
    j->stuck = false;
    return k_singular;
}

static bool singular_vertex(mni_judge *j) {
    uint32_t group = j->ring_count > 0 ? group_of(j, 0) : 0;
    for (uint32_t i = 0; i < j->ring_count; i++)
        if (mni_ring_vertex_singular(&j->ring[i]) || group_of(j, i) != group)
            return true;
    return false;
}

/* Where r is regular: k has no neighbour in the ring but the two apexes, and these two and k are no
 * triangle's corners already (what a ring of three can come to). */
static bool round_link(mni_judge *j, mni_surface *s, uint32_t k) {
    const mni_wheel *of_k = &j->kept;
    uint32_t n = j->ring_count;
    for (uint32_t i = 0; i < n; i++) {
        __builtin_prefetch(&j->normal[3 * (size_t)j->wheel.simplex[i]]);
        mni_surface_fetch_vertex(s, j->around[i]);
    }
    if (n == 3)
        return !triangle_holds(j, s, j->around[1], j->around[2], k);
    bool short_k = j->kept_of == k || mni_surface_wheel(s, k, &j->kept);
    j->kept_of = short_k ? k : MN_NONE;
    for (uint32_t i = 2; i < n - 1; i++) {
        uint32_t v = j->around[i];
        if (short_k ? mni_wheel_find(of_k->next, of_k->count, v) != MNI_WHEEL_MAX ||
                          mni_wheel_find(of_k->previous, of_k->count, v) != MNI_WHEEL_MAX
                    : mni_surface_joined(s, v, k))
            return false;
    }
    return true;
}

static bool ring_link(mni_judge *j, mni_surface *s, uint32_t r, uint32_t k) {
    uint32_t count, at;
    bool kr = in_ring(j, k, &at);
    MN_ASSERT(kr);
    const mni_ring_vertex *edge = &j->ring[at];
    if (edge->triangles == 0) /* a hinge alone joins them: only a vertex that hangs by it goes */
        return j->ring_count == 1 && edge->hinges == 1;
    if (singular_vertex(j) && !singular_may_go(j, k))
        return false;
    const uint32_t *fan = mni_surface_fan(s, r, &count);
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex *x = &s->simplex[fan[i]];
        if (x->v[2] == MN_NONE || (x->v[0] != k && x->v[1] != k && x->v[2] != k))
            continue;
        for (int c = 0; c < 3; c++)
            if (x->v[c] != k && x->v[c] != r && in_ring(j, x->v[c], &at) &&
                ++j->ring[at].apexes > 1)
                return false;
    }
    return !strays(j, s, r, k) && !doubles(j, s, r, k);
}

bool mni_judge_link(mni_judge *j, mni_surface *s, uint32_t r, uint32_t k) {
    j->stuck = false;
    mni_judge_look(j, s, r, k);
    return j->round ? round_link(j, s, k) : ring_link(j, s, r, k);
}

/* The normal of t's input triangle, of any length. */
static void input_cross(const mni_surface *s, uint32_t t, double n[3]) {
    const uint32_t *o = &s->origin[3 * (size_t)t];
    cross(s->vertex[o[0]].p, s->vertex[o[1]].p, s->vertex[o[2]].p, n);
}

/* Whether triangle t = (r, a, b) may become (k, a, b). The unit normal is of floats: near a right
 * angle, where it does not tell the sign for certain, the input's triangle does. */
static bool keeps_side(const mni_judge *j, const mni_surface *s, uint32_t t, uint32_t r, uint32_t k,
                       uint32_t a, uint32_t b) {
    const float *at_a = s->vertex[a].p, *at_b = s->vertex[b].p;
    const float *first = &j->normal[3 * (size_t)t];
    double before[3], after[3], input[3] = {first[0], first[1], first[2]};
    cross(s->vertex[r].p, at_a, at_b, before);
    cross(s->vertex[k].p, at_a, at_b, after);
    double area2 = dot(after, after), turn = dot(input, after);
    if (turn * turn < 1e-12 * area2 && s->is_part && dot(input, input) > 0)
        return false; /* the input's triangle is not here */
    if (turn * turn < 1e-12 * area2 && !s->is_part) {
        input_cross(s, t, input);
        turn = dot(input, after);
    }
    return area2 > 0 && (dot(before, after) > 0 || !(dot(before, before) > 0)) &&
           (turn > 0 || !(dot(input, input) > 0));
}

bool mni_judge_fold(const mni_judge *j, mni_surface *s, uint32_t r, uint32_t k) {
    if (j->round) {
        for (uint32_t i = 1; i + 1 < j->ring_count; i++)
            if (!keeps_side(j, s, j->wheel.simplex[j->spoke[i]], r, k, j->around[i],
                            j->around[i + 1]))
                return false;
        return true;
    }
    uint32_t count;
    const uint32_t *fan = mni_surface_fan(s, r, &count);
    for (uint32_t i = 0; i < count; i++) {
        const mni_simplex *x = &s->simplex[fan[i]];
        mni_corner c = mni_simplex_corner(x, r);
        if (x->v[2] != MN_NONE && c.next != k && c.previous != k &&
            !keeps_side(j, s, fan[i], r, k, c.next, c.previous))
            return false;
    }
    return true;
}
