/* Goal: mn_simplify makes exactly the collapses and hinges that design.md §3.2 and §2 say.
 * Method: a naive simplifier, written from the text alone, on small seeded meshes of awkward kinds.
 * By quadrics alone, and by length, it must come to the same collapses. Where errors are measured
 * as well it follows: each collapse must be one that is allowed then, and no stage end too early.
 */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "metanode/build.h"
#include "simplify.h"
#include "suite.h"
#include "tree_fixture.h"

enum { VERTICES_MAX = 64, SIMPLICES_MAX = 1024 };

/* ---- meshes ---- */

typedef struct small_mesh {
    mn_mesh mesh;
    float position[3 * VERTICES_MAX];
    uint32_t color[VERTICES_MAX];
    uint32_t corner[3 * SIMPLICES_MAX];
} small_mesh;

static uint64_t random_state;

static uint32_t draw(uint32_t below) {
    return fixture_random(&random_state) % below;
}

static float draw_unit(void) {
    return (float)draw(1 << 20) / (1 << 20);
}

static uint32_t add_vertex(small_mesh *m, float x, float y, float z) {
    ck_assert_uint_lt(m->mesh.vertices, VERTICES_MAX);
    float p[3] = {x, y, z};
    memcpy(&m->position[3 * m->mesh.vertices], p, sizeof p);
    return m->mesh.vertices++;
}

static void add_triangle(small_mesh *m, uint32_t a, uint32_t b, uint32_t c) {
    ck_assert_uint_lt(m->mesh.triangles, SIMPLICES_MAX / 2);
    uint32_t t[3] = {a, b, c};
    memcpy(&m->corner[3 * m->mesh.triangles++], t, sizeof t);
}

static void sheet(small_mesh *m) {
    uint32_t w = 2 + draw(5), h = 2 + draw(5);
    for (uint32_t v = 0; v < w * h; v++)
        add_vertex(m, (float)(v % w) + 0.4f * draw_unit(), (float)(v / w), draw_unit());
    for (uint32_t y = 0; y + 1 < h; y++)
        for (uint32_t x = 0; x + 1 < w; x++) {
            uint32_t v = y * w + x;
            if (draw(8) == 0) /* a hole */
                continue;
            add_triangle(m, v, v + 1, v + w + 1);
            add_triangle(m, v, v + w + 1, v + w);
        }
}

static void torus(small_mesh *m) {
    uint32_t nu = 3 + draw(5), nv = 3 + draw(3), base = m->mesh.vertices;
    float at = 7.0f * draw_unit();
    for (uint32_t v = 0; v < nu * nv; v++) {
        double a = 2 * M_PI * (v / nv) / nu, b = 2 * M_PI * (v % nv) / nv;
        add_vertex(m, at + (float)((3 + cos(b)) * cos(a)), (float)((3 + cos(b)) * sin(a)),
                   (float)sin(b) + 0.1f * draw_unit());
    }
    for (uint32_t u = 0; u < nu; u++)
        for (uint32_t v = 0; v < nv; v++) {
            uint32_t p = base + u * nv + v, q = base + u * nv + (v + 1) % nv;
            uint32_t r = base + (u + 1) % nu * nv + v, s = base + (u + 1) % nu * nv + (v + 1) % nv;
            add_triangle(m, p, r, s);
            add_triangle(m, p, s, q);
        }
}

static void add_globe(small_mesh *m, uint32_t around, uint32_t rows, float x) {
    uint32_t base = m->mesh.vertices, last = base + (rows - 1) * around;
    for (uint32_t v = 0; v < rows * around; v++) {
        double lat = M_PI * (v / around + 1) / (rows + 1), lon = 2 * M_PI * (v % around) / around;
        add_vertex(m, x + (float)(sin(lat) * cos(lon)), (float)(sin(lat) * sin(lon)),
                   (float)cos(lat));
    }
    uint32_t north = add_vertex(m, x, 0, 1), south = add_vertex(m, x, 0, -1);
    for (uint32_t a = 0; a < around; a++) {
        uint32_t b = (a + 1) % around;
        add_triangle(m, north, base + a, base + b);
        add_triangle(m, south, last + b, last + a);
        for (uint32_t p = base; p < last; p += around) {
            add_triangle(m, p + a, p + around + a, p + around + b);
            add_triangle(m, p + a, p + around + b, p + b);
        }
    }
}

static void globes(small_mesh *m) {
    uint32_t parts = 1 + draw(3);
    for (uint32_t i = 0; i < parts; i++)
        add_globe(m, 3 + draw(5), 1 + draw(2), 1.7f * (float)i + draw_unit());
}

/* Fins on some edges: three and more triangles there. */
static void fins(small_mesh *m) {
    torus(m);
    for (uint32_t i = 0, triangles = m->mesh.triangles; i < 12; i++) {
        const uint32_t *c = &m->corner[3 * draw(triangles)];
        const float *p = &m->position[3 * c[0]];
        add_triangle(m, c[0], c[1],
                     add_vertex(m, p[0] + draw_unit(), p[1] + draw_unit(), p[2] + draw_unit()));
    }
}

/* Strips of several triangles wide that meet along a spine of three edges. */
static void book(small_mesh *m) {
    enum { SPINE = 4 };
    uint32_t pages = 2 + draw(5);
    for (uint32_t i = 0; i < SPINE; i++)
        add_vertex(m, 0, 0.3f * draw_unit(), (float)i);
    for (uint32_t p = 0; p < pages; p++) {
        uint32_t base = m->mesh.vertices;
        for (uint32_t i = 0; i < SPINE; i++)
            add_vertex(m, (float)cos(p), (float)sin(p), (float)i + 0.3f * draw_unit());
        for (uint32_t i = 0; i + 1 < SPINE; i++) {
            add_triangle(m, i, base + i, i + 1);
            if (draw(4) > 0)
                add_triangle(m, base + i, base + i + 1, i + 1);
        }
    }
}

static void soup(small_mesh *m) {
    for (uint32_t i = 0, parts = 1 + draw(15); i < parts; i++) {
        uint32_t v[3];
        float x = 5 * draw_unit(), y = 5 * draw_unit(), z = 5 * draw_unit();
        for (int c = 0; c < 3; c++)
            v[c] = add_vertex(m, x + draw_unit(), y + draw_unit(), z + draw_unit());
        add_triangle(m, v[0], v[1], v[2]);
        if (draw(3) == 0) /* an ear */
            add_triangle(m, v[1], v[0], add_vertex(m, x + draw_unit(), y, z));
    }
}

/* Globes that share a vertex, and tetrahedra hung on one of their triangles. */
static void bow_ties(small_mesh *m) {
    add_globe(m, 3 + draw(3), 1 + draw(2), 0);
    uint32_t first = m->mesh.vertices, triangles = m->mesh.triangles;
    add_globe(m, 3 + draw(3), 1 + draw(2), 1.5f);
    uint32_t gone = m->mesh.vertices - 1, tip = draw(first);
    for (uint32_t c = 3 * triangles; c < 3 * m->mesh.triangles; c++)
        if (m->corner[c] == gone)
            m->corner[c] = tip;
    m->mesh.vertices--;
    for (int i = 0; i < 2; i++) {
        uint32_t t[3], apex = add_vertex(m, draw_unit(), draw_unit(), 2 * draw_unit());
        memcpy(t, &m->corner[3 * draw(m->mesh.triangles)], sizeof t);
        for (int c = 0; c < 3; c++)
            add_triangle(m, t[c], t[(c + 1) % 3], apex);
    }
}

static bool has_triangle(const small_mesh *m, const uint32_t *c, bool oriented) {
    for (uint32_t t = 0; t < m->mesh.triangles; t++) {
        const uint32_t *o = &m->corner[3 * t];
        bool same = true, turned = false;
        for (int i = 0; i < 3; i++) {
            same &= o[i] == c[0] || o[i] == c[1] || o[i] == c[2];
            turned |= o[i] == c[0] && o[(i + 1) % 3] == c[1];
        }
        if (same && (turned || !oriented))
            return true;
    }
    return false;
}

/* Any triangles over few vertices; on a lattice costs and normals tie and vanish. */
static void add_random(small_mesh *m, bool lattice, bool both_ways) {
    uint32_t n = 4 + draw(16), triangles = 1 + draw(3 * n), used[VERTICES_MAX];
    uint32_t base = m->mesh.vertices;
    memset(used, 0xff, sizeof used);
    for (uint32_t t = 0; t < triangles; t++) {
        uint32_t c[3];
        for (int i = 0; i < 3; i++) {
            uint32_t v = draw(n);
            if (used[v] == MN_NONE)
                used[v] = lattice ? add_vertex(m, (float)draw(3), (float)draw(3), (float)draw(2))
                                  : add_vertex(m, draw_unit(), draw_unit(), draw_unit());
            c[i] = used[v];
        }
        if (c[0] != c[1] && c[1] != c[2] && c[2] != c[0] && !has_triangle(m, c, both_ways))
            add_triangle(m, c[0], c[1], c[2]);
    }
    for (uint32_t v = base; v < m->mesh.vertices; v++) { /* every vertex is used */
        bool held = false;
        for (uint32_t c = 0; c < 3 * m->mesh.triangles; c++)
            held |= m->corner[c] == v;
        if (!held)
            add_triangle(m, v, add_vertex(m, draw_unit(), 0, 0), add_vertex(m, 0, draw_unit(), 0));
    }
}

static void random_sets(small_mesh *m) {
    add_random(m, false, false);
}

static void random_lattice(small_mesh *m) {
    add_random(m, true, false);
}

static void random_both_ways(small_mesh *m) {
    add_random(m, draw(2) == 0, true);
}

/* A flat grid: every quadric is 0, every collapse ties. */
static void flat(small_mesh *m) {
    sheet(m);
    for (uint32_t v = 0; v < m->mesh.vertices; v++) {
        m->position[3 * v] = floorf(m->position[3 * v]);
        m->position[3 * v + 2] = 0;
    }
}

/* Some of a mesh's triangles turned over. */
static void turned(small_mesh *m) {
    draw(2) == 0 ? sheet(m) : torus(m);
    for (uint32_t t = 0; t < m->mesh.triangles; t++)
        if (draw(3) == 0) {
            uint32_t keep = m->corner[3 * t];
            m->corner[3 * t] = m->corner[3 * t + 1];
            m->corner[3 * t + 1] = keep;
        }
}

static void (*const kinds[])(small_mesh *) = {
    sheet,       torus,          globes,           fins,  book, soup, bow_ties, flat,
    random_sets, random_lattice, random_both_ways, turned};
enum { KINDS = sizeof kinds / sizeof kinds[0] };

/* Vertices that nothing uses go, as intake drops them, and numbers are shuffled. */
static void tidy(small_mesh *m) {
    uint32_t name[VERTICES_MAX], count = 0;
    float position[3 * VERTICES_MAX];
    memset(name, 0xff, sizeof name);
    for (uint32_t t = m->mesh.triangles; t > 1; t--) {
        uint32_t other = draw(t), keep[3];
        memcpy(keep, &m->corner[3 * (t - 1)], sizeof keep);
        memcpy(&m->corner[3 * (t - 1)], &m->corner[3 * other], sizeof keep);
        memcpy(&m->corner[3 * other], keep, sizeof keep);
    }
    for (uint32_t c = 0; c < 3 * m->mesh.triangles; c++) {
        uint32_t v = m->corner[c];
        if (name[v] == MN_NONE) {
            memcpy(&position[3 * count], &m->position[3 * v], 3 * sizeof(float));
            name[v] = count++;
        }
        m->corner[c] = name[v];
    }
    m->mesh.vertices = count;
    memcpy(m->position, position, sizeof position);
    m->mesh.position = m->position;
    m->mesh.corner = m->corner;
    m->mesh.color = m->color;
    for (uint32_t v = 0; v < count; v++)
        m->color[v] = v;
}

/* ---- the naive simplifier ---- */

typedef struct simplex {
    uint32_t v[3], origin[3]; /* a hinge's third is MN_NONE */
    uint32_t killed;          /* MN_NONE: alive */
} simplex;

typedef struct naive {
    const mn_mesh *mesh;
    mn_metric metric;
    mni_vertex *quadric; /* the vertices' quadrics and places */
    simplex x[SIMPLICES_MAX];
    uint32_t simplices;
    uint32_t node[VERTICES_MAX]; /* MN_NONE: gone */
    uint32_t left[VERTICES_MAX], right[VERTICES_MAX], made;
    uint32_t by_stage[4], legal_last;
} naive;

static bool alive(const simplex *x) {
    return x->killed == MN_NONE;
}

static bool is_hinge(const simplex *x) {
    return x->v[2] == MN_NONE;
}

static bool holds(const simplex *x, uint32_t v) {
    return alive(x) && (x->v[0] == v || x->v[1] == v || x->v[2] == v);
}

static bool joined(const naive *s, uint32_t a, uint32_t b) {
    for (uint32_t i = 0; i < s->simplices; i++)
        if (holds(&s->x[i], a) && holds(&s->x[i], b))
            return true;
    return false;
}

static uint32_t triangles_of_three(const naive *s, uint32_t a, uint32_t b, uint32_t c) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < s->simplices; i++)
        count += holds(&s->x[i], a) && holds(&s->x[i], b) && holds(&s->x[i], c);
    return count;
}

typedef struct edge {
    uint32_t triangles, forth, hinges; /* forth: triangles that run from a to b */
} edge;

static edge edge_between(const naive *s, uint32_t a, uint32_t b) {
    edge e = {0};
    for (uint32_t i = 0; i < s->simplices; i++) {
        const simplex *x = &s->x[i];
        if (!holds(x, a) || !holds(x, b))
            continue;
        e.hinges += is_hinge(x);
        e.triangles += !is_hinge(x);
        for (int c = 0; c < 3 && !is_hinge(x); c++)
            e.forth += x->v[c] == a && x->v[(c + 1) % 3] == b;
    }
    return e;
}

/* "An edge is singular if it has not exactly two triangles, or if these are not oppositely
 * directed; a hinge is singular." */
static bool singular_edge(const naive *s, uint32_t a, uint32_t b) {
    edge e = edge_between(s, a, b);
    return e.hinges > 0 || e.triangles != 2 || e.forth != 1;
}

/* Fans of v: its triangles, joined where they share a regular edge of v (and, if asked for, a
 * singular one). */
static uint32_t fans(const naive *s, uint32_t v, bool over_singular) {
    uint32_t fan[SIMPLICES_MAX], count = 0;
    for (uint32_t i = 0; i < s->simplices; i++)
        fan[i] = i;
    for (bool changed = true; changed;) {
        changed = false;
        for (uint32_t w = 0; w < s->mesh->vertices; w++) {
            uint32_t least = MN_NONE;
            if (w == v || !joined(s, v, w) || (!over_singular && singular_edge(s, v, w)))
                continue;
            for (uint32_t i = 0; i < s->simplices; i++)
                if (holds(&s->x[i], v) && holds(&s->x[i], w) && fan[i] < least)
                    least = fan[i];
            for (uint32_t i = 0; i < s->simplices; i++)
                if (holds(&s->x[i], v) && holds(&s->x[i], w) && fan[i] != least) {
                    fan[i] = least;
                    changed = true;
                }
        }
    }
    for (uint32_t i = 0; i < s->simplices; i++)
        count += holds(&s->x[i], v) && !is_hinge(&s->x[i]) && fan[i] == i;
    return count;
}

/* "A vertex is singular if it is on a singular edge or its triangles form more than one fan." */
static bool singular_vertex(const naive *s, uint32_t v) {
    for (uint32_t w = 0; w < s->mesh->vertices; w++)
        if (w != v && joined(s, v, w) && singular_edge(s, v, w))
            return true;
    return fans(s, v, false) > 1;
}

/* "the common neighbours of k and r are exactly the apexes of the triangles at kr, each once", and
 * "a closed tetrahedron stays". */
static bool link_holds(const naive *s, uint32_t r, uint32_t k) {
    uint32_t n = s->mesh->vertices;
    for (uint32_t w = 0; w < n; w++) {
        if (w == r || w == k)
            continue;
        bool common = joined(s, r, w) && joined(s, k, w);
        if (triangles_of_three(s, k, r, w) != (common ? 1 : 0))
            return false;
        for (uint32_t u = 0; u < w; u++)
            if (u != r && u != k && triangles_of_three(s, k, r, u) && common &&
                triangles_of_three(s, r, u, w) > 0 && triangles_of_three(s, k, u, w) > 0)
                return false;
    }
    return true;
}

static bool legal_without_folds(const naive *s, uint32_t r, uint32_t k) {
    uint32_t of_r = 0, singular[VERTICES_MAX], count = 0;
    for (uint32_t i = 0; i < s->simplices; i++)
        of_r += holds(&s->x[i], r);
    if (edge_between(s, r, k).triangles == 0) /* a hinge: only when r is held by it alone */
        return of_r == 1;
    if (!link_holds(s, r, k))
        return false;
    if (!singular_vertex(s, r))
        return true;
    for (uint32_t w = 0; w < s->mesh->vertices; w++)
        if (w != r && joined(s, r, w) && singular_edge(s, r, w))
            singular[count++] = w;
    return singular_edge(s, k, r) && count == 2 &&
           edge_between(s, r, singular[0]).triangles == edge_between(s, r, singular[1]).triangles &&
           fans(s, r, true) == 1;
}

static void normal_of(const mn_mesh *mesh, const uint32_t v[3], double n[3]) {
    double e[2][3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 2; j++)
            e[j][i] = (double)mesh->position[3 * v[j + 1] + (uint32_t)i] -
                      mesh->position[3 * v[0] + (uint32_t)i];
    for (int i = 0; i < 3; i++)
        n[i] = e[0][(i + 1) % 3] * e[1][(i + 2) % 3] - e[0][(i + 2) % 3] * e[1][(i + 1) % 3];
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* "each triangle that changes keeps a positive dot product with its normal before and with the
 * normal of its own input triangle (zero-area ones are not asked), and gets no zero area" */
static bool folds(const naive *s, uint32_t r, uint32_t k) {
    for (uint32_t i = 0; i < s->simplices; i++) {
        const simplex *x = &s->x[i];
        if (!holds(x, r) || holds(x, k) || is_hinge(x))
            continue;
        uint32_t at_r = x->v[0] == r ? 0 : x->v[1] == r ? 1 : 2;
        uint32_t a = x->v[(at_r + 1) % 3], b = x->v[(at_r + 2) % 3];
        double input[3], before[3], after[3];
        normal_of(s->mesh, x->origin, input);
        normal_of(s->mesh, (uint32_t[]){r, a, b}, before); /* a right angle's rounding is */
        normal_of(s->mesh, (uint32_t[]){k, a, b}, after);  /* the same from the same corner */
        if (dot(after, after) <= 0 || (dot(before, before) > 0 && dot(before, after) <= 0) ||
            (dot(input, input) > 0 && dot(input, after) <= 0))
            return true;
    }
    return false;
}

static bool allowed(const naive *s, uint32_t r, uint32_t k, int stage) {
    return stage == 3 || (legal_without_folds(s, r, k) && (stage == 2 || !folds(s, r, k)));
}

static void record(naive *s, uint32_t r, uint32_t k, int stage) {
    s->left[s->made] = s->node[k];
    s->right[s->made] = s->node[r];
    s->node[r] = MN_NONE;
    s->node[k] = s->mesh->vertices + s->made++;
    s->by_stage[stage - 1]++;
    if (stage == 1)
        s->legal_last = s->node[k];
}

/* design.md §2: of the triangles (k, r, w) that die the first lends its ends to a hinge, where
 * nothing that survives joins k and w. */
static void collapse(naive *s, uint32_t r, uint32_t k, int stage) {
    bool died[SIMPLICES_MAX] = {false};
    uint32_t before = s->simplices;
    for (uint32_t i = 0; i < before; i++) {
        simplex *x = &s->x[i];
        died[i] = holds(x, r) && holds(x, k);
        if (died[i])
            x->killed = s->made;
    }
    for (uint32_t i = 0; i < before; i++)
        for (int c = 0; c < 3; c++)
            if (alive(&s->x[i]) && s->x[i].v[c] == r)
                s->x[i].v[c] = k;
    for (uint32_t i = 0; i < before; i++) {
        const simplex *x = &s->x[i];
        if (!died[i] || is_hinge(x))
            continue;
        int at_k = 0, at_w = 0;
        for (int c = 0; c < 3; c++) {
            at_k = x->v[c] == k ? c : at_k;
            at_w = x->v[c] != k && x->v[c] != r ? c : at_w;
        }
        if (joined(s, k, x->v[at_w]))
            continue;
        ck_assert_uint_lt(s->simplices, SIMPLICES_MAX);
        s->x[s->simplices++] = (simplex){
            {k, x->v[at_w], MN_NONE}, {x->origin[at_k], x->origin[at_w], MN_NONE}, MN_NONE};
    }
    if (s->metric == MN_METRIC_QEM)
        mni_quadric_add(&s->quadric[k], &s->quadric[r]);
    record(s, r, k, stage);
}

typedef struct candidate {
    float cost;
    uint32_t kept, removed;
} candidate;

static int by_cost(const void *a, const void *b) {
    const candidate *x = a, *y = b;
    if (x->cost != y->cost)
        return x->cost < y->cost ? -1 : 1;
    if (x->kept != y->kept)
        return x->kept < y->kept ? -1 : 1;
    return x->removed < y->removed ? -1 : x->removed > y->removed;
}

static bool step(naive *s, int stage) {
    static candidate list[VERTICES_MAX * VERTICES_MAX];
    uint32_t n = s->mesh->vertices, count = 0;
    for (uint32_t r = 0; r < n; r++)
        for (uint32_t k = 0; k < n; k++) {
            if (r == k || s->node[r] == MN_NONE || s->node[k] == MN_NONE)
                continue;
            const float *a = &s->mesh->position[3 * r], *b = &s->mesh->position[3 * k];
            float apart = (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                          (a[2] - b[2]) * (a[2] - b[2]);
            if (stage == 4)
                list[count++] = (candidate){apart, k, r};
            else if (joined(s, r, k))
                list[count++] =
                    (candidate){mni_collapse_cost(&s->quadric[r], &s->quadric[k], s->metric), k, r};
        }
    qsort(list, count, sizeof *list, by_cost);
    for (uint32_t i = 0; i < count; i++) {
        if (stage == 4) {
            record(s, list[i].removed, list[i].kept, 4);
            return true;
        }
        if (allowed(s, list[i].removed, list[i].kept, stage)) {
            collapse(s, list[i].removed, list[i].kept, stage);
            return true;
        }
    }
    return false;
}

/* The quadrics are the simplifier's own, walls added in its order: sums must not differ in a bit.
 */
static void fill_quadrics(mni_surface *surface, const mn_mesh *mesh) {
    mn_status st = {0};
    mni_judge judge;
    mni_quadrics_fill(surface);
    ck_assert_int_eq(mni_judge_open(&judge, surface, &st), MN_OK);
    for (uint32_t v = 0; v < mesh->vertices; v++) {
        mni_judge_ring(&judge, surface, v);
        for (uint32_t i = 0; i < judge.ring_count; i++)
            if (judge.around[i] > v && judge.ring[i].triangles == 1) {
                mni_quadric_wall(surface, v, judge.around[i]);
                mni_quadric_wall(surface, judge.around[i], v);
            }
    }
    mni_judge_close(&judge);
}

static bool any_allowed(const naive *s, int stage) {
    for (uint32_t r = 0; r < s->mesh->vertices; r++)
        for (uint32_t k = 0; k < s->mesh->vertices; k++)
            if (r != k && s->node[r] != MN_NONE && s->node[k] != MN_NONE && joined(s, r, k) &&
                allowed(s, r, k, stage))
                return true;
    return false;
}

static uint32_t vertex_of(const naive *s, uint32_t node) {
    for (uint32_t v = 0; v < s->mesh->vertices; v++)
        if (s->node[v] == node)
            return v;
    ck_abort_msg("node %u is not there", node);
}

static void start(naive *s, const mn_mesh *mesh, mn_metric metric) {
    memset(s, 0, sizeof *s);
    s->mesh = mesh;
    s->metric = metric;
    s->simplices = mesh->triangles;
    s->legal_last = mesh->vertices - 1;
    for (uint32_t t = 0; t < mesh->triangles; t++) {
        memcpy(s->x[t].v, &mesh->corner[3 * t], sizeof s->x[t].v);
        memcpy(s->x[t].origin, &mesh->corner[3 * t], sizeof s->x[t].origin);
        s->x[t].killed = MN_NONE;
    }
    for (uint32_t v = 0; v < mesh->vertices; v++)
        s->node[v] = v;
}

static void run_naive(naive *s, const mn_mesh *mesh, mn_metric metric) {
    mn_status st = {0};
    mni_surface surface;
    start(s, mesh, metric);
    ck_assert_int_eq(mni_surface_open(&surface, mesh, &st), MN_OK);
    if (metric == MN_METRIC_QEM)
        fill_quadrics(&surface, mesh);
    s->quadric = surface.vertex;
    for (int stage = 1; stage <= 4; stage++)
        while (step(s, stage)) {
        }
    mni_surface_close(&surface);
}

/* Makes the tree's collapses. */
static void follow(naive *s, const mn_mesh *mesh, const mn_tree *t) {
    uint32_t n = mesh->vertices;
    int stage = 1;
    start(s, mesh, MN_METRIC_LENGTH); /* costs are not asked for */
    for (uint32_t i = 0; i < t->inner; i++) {
        uint32_t k = vertex_of(s, t->left[i] < n ? t->leaf_color[t->left[i]] : t->left[i]);
        uint32_t r = vertex_of(s, t->right[i] < n ? t->leaf_color[t->right[i]] : t->right[i]);
        for (; s->by_stage[stage - 1] == t->counts.collapses_by_stage[stage - 1]; stage++)
            ck_assert(!any_allowed(s, stage));
        if (stage == 4) {
            record(s, r, k, 4);
            continue;
        }
        ck_assert_msg(joined(s, r, k) && allowed(s, r, k, stage), "collapse %u", i);
        collapse(s, r, k, stage);
    }
}

/* ---- comparing ---- */

/* Triangles of a kill node in the input's order, hinges in any. */
static void check_simplices(const naive *s, const mn_tree *t, const uint32_t *leaf_of) {
    ck_assert_uint_eq(t->simplices, s->simplices);
    for (uint32_t i = 0; i < t->inner; i++) {
        uint32_t at = t->simplex_start[i], end = t->simplex_start[i + 1];
        for (uint32_t x = 0; x < s->simplices; x++) {
            const simplex *mine = &s->x[x];
            if (mine->killed != i)
                continue;
            uint32_t want[3], found = at;
            for (int c = 0; c < 3; c++)
                want[c] = mine->origin[c] == MN_NONE ? MN_NONE : leaf_of[mine->origin[c]];
            if (is_hinge(mine)) /* its two ends may stand either way round */
                for (; found < end; found++) {
                    const uint32_t *c = &t->corner[3 * found];
                    if (c[2] == MN_NONE && ((c[0] == want[0] && c[1] == want[1]) ||
                                            (c[0] == want[1] && c[1] == want[0])))
                        break;
                }
            else
                ck_assert_mem_eq(&t->corner[3 * at++], want, sizeof want);
            ck_assert_msg(found < end, "collapse %u: hinge %u–%u", i, mine->origin[0],
                          mine->origin[1]);
        }
    }
}

static void check_same(const naive *s, const mn_tree *t) {
    uint32_t n = t->leaves, leaf_of[VERTICES_MAX];
    ck_assert_uint_eq(t->inner, s->made);
    ck_assert_uint_eq(t->roots, 1);
    for (uint32_t leaf = 0; leaf < n; leaf++) /* a vertex's colour is its number */
        leaf_of[t->leaf_color[leaf]] = leaf;
    for (uint32_t i = 0; i < t->inner; i++) {
        uint32_t left = t->left[i] < n ? t->leaf_color[t->left[i]] : t->left[i];
        uint32_t right = t->right[i] < n ? t->leaf_color[t->right[i]] : t->right[i];
        ck_assert_msg(left == s->left[i] && right == s->right[i],
                      "collapse %u of %u: %u and %u, naively %u and %u (stages %u, %u, %u, %u)", i,
                      t->inner, left, right, s->left[i], s->right[i], s->by_stage[0],
                      s->by_stage[1], s->by_stage[2], s->by_stage[3]);
    }
    ck_assert_uint_eq(t->legal_last, s->legal_last);
    for (int stage = 0; stage < 4; stage++)
        ck_assert_uint_eq(t->counts.collapses_by_stage[stage], s->by_stage[stage]);
    check_simplices(s, t, leaf_of);
}

static void check_kind(uint32_t kind, uint64_t seed) {
    static small_mesh m;
    static naive s;
    random_state = seed;
    memset(&m, 0, sizeof m);
    kinds[kind](&m);
    tidy(&m);
    if (m.mesh.triangles == 0)
        return;
    static const mn_simplify_desc descs[] = {
        {.metric = MN_METRIC_LENGTH}, {.quadrics_alone = true}, {.metric = MN_METRIC_QEM}};
    for (int i = 0; i < 3; i++) {
        const mn_simplify_desc desc = descs[i];
        mn_tree tree;
        mn_status st = {0};
        ck_assert_msg(mn_simplify(&m.mesh, &desc, &tree, &st) == MN_OK, "%s", st.text);
        if (i < 2)
            run_naive(&s, &m.mesh, desc.metric);
        else
            follow(&s, &m.mesh, &tree);
        ck_assert_msg(mn_tree_check(&tree, &st) == MN_OK, "%s", st.text);
        ck_assert_uint_eq(tree.counts.order_violations, 0);
        check_same(&s, &tree);
        mn_tree_free(&tree);
    }
}

START_TEST(same_as_naive) {
    uint64_t seed = fixture_seed(7);
    uint32_t rounds = getenv("MN_ROUNDS") != NULL ? (uint32_t)atoi(getenv("MN_ROUNDS")) : 60;
    for (uint32_t i = 0; i < rounds; i++) {
        printf("kind %d, MN_SEED=%llu\n", _i, (unsigned long long)(seed + i));
        fflush(stdout);
        check_kind((uint32_t)_i, seed + i);
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("simplify_naive");
    TCase *tc = tcase_create("naive");
    tcase_set_timeout(tc, 300);
    tcase_add_loop_test(tc, same_as_naive, 0, KINDS);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
