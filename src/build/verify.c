/* Is a file sound, and is its full detail the mesh it was built from?
 *
 * Hides: how two meshes are compared whose vertices are numbered differently. Positions go onto the
 * file's grid and get numbers (equal ones the same), triangles become three such numbers with the
 * least first, both sides are sorted, and the first triangle of the input without its like is
 * named. Order: mn_verify alone. One thread; blocks on the disk. Memory: a walk's
 * (mnt_rows.h), and to compare the tree, and 40 bytes a vertex and 56 a triangle. Paper: none. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mnt_rows.h"
#include "tree.h"

typedef struct point {
    float at[3], given[3]; /* on the grid, and in the input */
    uint32_t vertex;
} point;

typedef struct face {
    uint32_t at[3]; /* numbers of positions, the least first; an edge: the third 0 */
    uint32_t index;
} face;

typedef struct comparison {
    const char *path;
    const mn_tree *tree;
    const mn_mesh *mesh;
    mn_status *st;
    point *point;          /* of the mesh, sorted */
    uint32_t *number;      /* leaf: of its position */
    uint32_t *of_vertex;   /* mesh vertex: of its position */
    uint32_t *vertices_at; /* number: mesh vertices there, less leaves there */
    face *of_mesh, *of_tree, *edge;
    uint64_t merged; /* positions that fall together on the grid */
} comparison;

static int by_position(const void *a, const void *b) {
    const point *x = a, *y = b;
    for (int i = 0; i < 3; i++)
        if (x->at[i] != y->at[i])
            return x->at[i] < y->at[i] ? -1 : 1;
    return 0;
}

static int by_corners(const void *a, const void *b) {
    const face *x = a, *y = b;
    for (int i = 0; i < 3; i++)
        if (x->at[i] != y->at[i])
            return x->at[i] < y->at[i] ? -1 : 1;
    return 0;
}

static int by_corners_and_index(const void *a, const void *b) {
    const face *x = a, *y = b;
    int order = by_corners(a, b);
    return order != 0 ? order : x->index < y->index ? -1 : x->index > y->index;
}

static face face_of(const uint32_t *number, const uint32_t *corner, uint32_t index) {
    uint32_t n[3] = {number[corner[0]], number[corner[1]], number[corner[2]]};
    int k = n[0] <= n[1] && n[0] <= n[2] ? 0 : n[1] <= n[2] ? 1 : 2;
    if (n[k] == n[(k + 2) % 3] && n[k] != n[(k + 1) % 3]) /* of two least, the one before */
        k = (k + 2) % 3;
    return (face){{n[k], n[(k + 1) % 3], n[(k + 2) % 3]}, index};
}

static face edge_of(uint32_t a, uint32_t b) {
    return (face){{a < b ? a : b, a < b ? b : a, 0}, 0};
}

/* ---- positions ------------------------------------------------------------------------------ */

/* Half a step away at most; and -0 becomes 0. */
static float on_grid(double at, double step) {
    return (float)(step > 0 ? rint(at / step) * step : at) + 0.0f;
}

static bool given_same(const point *a, const point *b) {
    return a->given[0] == b->given[0] && a->given[1] == b->given[1] && a->given[2] == b->given[2];
}

/* On the grid, and those that fall together there by where they were. */
static int by_place(const void *a, const void *b) {
    const point *x = a, *y = b;
    int order = by_position(a, b);
    for (int i = 0; i < 3 && order == 0; i++)
        order = x->given[i] < y->given[i] ? -1 : x->given[i] > y->given[i];
    return order;
}

/* Numbers positions, and takes every leaf for one of the mesh's vertices. */
static mn_code match_vertices(comparison *c) {
    const mn_mesh *m = c->mesh;
    const mn_tree *t = c->tree;
    if (m->vertices != t->leaves || m->triangles != t->triangles)
        return mn_fail(c->st, MN_BAD_INPUT,
                       "%s: holds %u vertices and %u triangles, the input %u and %u", c->path,
                       t->leaves, t->triangles, m->vertices, m->triangles);
    for (uint32_t v = 0; v < m->vertices; v++) {
        for (int i = 0; i < 3; i++) {
            float at = m->position[3 * (size_t)v + (size_t)i] + 0.0f;
            double from_origin = at + (m->origin[i] - t->origin[i]);
            c->point[v].at[i] = on_grid(from_origin, t->grid_step);
            c->point[v].given[i] = at;
        }
        c->point[v].vertex = v;
    }
    qsort(c->point, m->vertices, sizeof *c->point, by_place);
    for (uint32_t p = 0, first = 0; p < m->vertices; p++) {
        bool same = p > 0 && by_position(&c->point[p], &c->point[p - 1]) == 0;
        first = same ? first : p;
        c->merged += same && !given_same(&c->point[p], &c->point[p - 1]);
        c->of_vertex[c->point[p].vertex] = first;
        c->vertices_at[first]++;
    }
    for (uint32_t v = 0; v < t->leaves; v++) {
        point wanted = {0};
        for (int i = 0; i < 3; i++)
            wanted.at[i] = t->leaf_position[3 * (size_t)v + (size_t)i] + 0.0f;
        const point *found = bsearch(&wanted, c->point, m->vertices, sizeof *c->point, by_position);
        uint32_t number = found != NULL ? c->of_vertex[found->vertex] : MN_NONE;
        if (found == NULL || c->vertices_at[number]-- == 0)
            return mn_fail(c->st, MN_BAD_INPUT,
                           "%s: leaf %u at (%.9g %.9g %.9g) is no vertex of the input", c->path, v,
                           wanted.at[0], wanted.at[1], wanted.at[2]);
        c->number[v] = number;
    }
    return MN_OK;
}

/* ---- triangles and hinges ------------------------------------------------------------------- */

static mn_code match_triangles(comparison *c, uint64_t *matched) {
    const mn_mesh *m = c->mesh;
    const mn_tree *t = c->tree;
    uint32_t n = 0, missing = MN_NONE, at = 0;
    for (uint32_t s = 0; s < t->simplices; s++)
        if (t->corner[3 * (size_t)s + 2] != MN_NONE)
            c->of_tree[n++] = face_of(c->number, t->corner + 3 * (size_t)s, s);
    for (uint32_t f = 0; f < m->triangles; f++)
        c->of_mesh[f] = face_of(c->of_vertex, m->corner + 3 * (size_t)f, f);
    qsort(c->of_tree, n, sizeof *c->of_tree, by_corners);
    qsort(c->of_mesh, m->triangles, sizeof *c->of_mesh, by_corners_and_index);
    for (uint32_t f = 0; f < m->triangles; f++) {
        while (at < n && by_corners(&c->of_tree[at], &c->of_mesh[f]) < 0)
            at++;
        if (at < n && by_corners(&c->of_tree[at], &c->of_mesh[f]) == 0) {
            at++;
            ++*matched;
        } else if (c->of_mesh[f].index < missing) {
            missing = c->of_mesh[f].index;
        }
    }
    if (missing == MN_NONE)
        return MN_OK; /* as many on both sides, and each has its like */
    const uint32_t *corner = m->corner + 3 * (size_t)missing;
    const float *p = m->position + 3 * (size_t)corner[0];
    return mn_fail(
        c->st, MN_BAD_INPUT,
        "%s: triangle %u of the input (vertices %u %u %u, the first at %.9g %.9g %.9g) is "
        "not in full detail; %llu of %u are",
        c->path, missing, corner[0], corner[1], corner[2], p[0], p[1], p[2],
        (unsigned long long)*matched, m->triangles);
}

static mn_code match_hinges(comparison *c) {
    const mn_mesh *m = c->mesh;
    const mn_tree *t = c->tree;
    if (t->simplices == t->triangles)
        return MN_OK;
    size_t edges = 0;
    for (uint32_t f = 0; f < m->triangles; f++)
        for (uint32_t k = 0; k < 3; k++)
            c->edge[edges++] = edge_of(c->of_vertex[m->corner[3 * (size_t)f + k]],
                                       c->of_vertex[m->corner[3 * (size_t)f + (k + 1) % 3]]);
    qsort(c->edge, edges, sizeof *c->edge, by_corners);
    for (uint32_t s = 0; s < t->simplices; s++) {
        const uint32_t *corner = t->corner + 3 * (size_t)s;
        if (corner[2] != MN_NONE)
            continue;
        face hinge = edge_of(c->number[corner[0]], c->number[corner[1]]);
        if (bsearch(&hinge, c->edge, edges, sizeof *c->edge, by_corners) == NULL)
            return mn_fail(c->st, MN_BAD_INPUT,
                           "%s: hinge %u (leaves %u %u) is no edge of the input", c->path, s,
                           corner[0], corner[1]);
    }
    return MN_OK;
}

static mn_code compare(const char *path, const mn_tree *t, const mn_mesh *m, mn_verify_result *out,
                       mn_status *st) {
    comparison c = {.path = path, .tree = t, .mesh = m, .st = st};
    bool has_hinges = t->simplices > t->triangles;
    c.point = malloc(sizeof *c.point * ((size_t)m->vertices + 1));
    c.number = malloc(sizeof *c.number * ((size_t)t->leaves + 1));
    c.of_vertex = malloc(sizeof *c.of_vertex * ((size_t)m->vertices + 1));
    c.vertices_at = calloc((size_t)m->vertices + 1, sizeof *c.vertices_at);
    c.of_mesh = malloc(sizeof *c.of_mesh * ((size_t)m->triangles + 1));
    c.of_tree = malloc(sizeof *c.of_tree * ((size_t)t->triangles + 1));
    c.edge = malloc(sizeof *c.edge * ((has_hinges ? 3 * (size_t)m->triangles : 0) + 1));
    mn_code code = MN_OK;
    if (c.point == NULL || c.number == NULL || c.of_vertex == NULL || c.vertices_at == NULL ||
        c.of_mesh == NULL || c.of_tree == NULL || c.edge == NULL)
        code = mn_fail(st, MN_FAILED, "no memory to compare %u triangles", m->triangles);
    if (code == MN_OK)
        code = match_vertices(&c);
    if (code == MN_OK)
        code = match_triangles(&c, &out->matched_triangles);
    if (code == MN_OK)
        code = match_hinges(&c);
    out->merged_positions = c.merged;
    free(c.point);
    free(c.number);
    free(c.of_vertex);
    free(c.vertices_at);
    free(c.of_mesh);
    free(c.of_tree);
    free(c.edge);
    return code;
}

static void fill_result(mn_verify_result *out, uint64_t leaves, uint64_t inner, uint64_t simplices,
                        uint64_t triangles) {
    out->nodes = leaves + inner;
    out->simplices = simplices;
    out->triangles = triangles;
    out->hinges = simplices - triangles;
}

/* The tree in memory: of a .vdt, or to compare it. */
static mn_code verify_tree(const char *path, const mn_mesh *against, const mn_watch *watch,
                           mn_verify_result *out, mn_status *st) {
    mn_tree tree;
    mn_code code = mn_tree_load(path, watch, &tree, st);
    if (code != MN_OK)
        return code;
    fill_result(out, tree.leaves, tree.inner, tree.simplices, tree.triangles);
    if (against != NULL)
        code = compare(path, &tree, against, out, st);
    mn_tree_free(&tree);
    return code;
}

mn_code mn_verify(const char *path, const mn_mesh *against, uint64_t ram_bytes,
                  const mn_watch *watch, mn_verify_result *out, mn_status *st) {
    static const mni_mnt_sink nobody = {0};
    const mni_mnt_desc desc = {.ram_bytes = ram_bytes, .watch = watch, .phase = "checking"};
    mni_mnt mnt;
    memset(out, 0, sizeof *out);
    if (mn_tree_is_vdt(path))
        return verify_tree(path, against, watch, out, st);
    mn_code code = mni_mnt_open(&mnt, path, st);
    const mn_header *h = &mnt.header;
    if (code == MN_OK)
        code = against != NULL ? verify_tree(path, against, watch, out, st)
                               : mni_mnt_walk(&mnt, &desc, &nobody, st);
    mni_mnt_close(&mnt);
    if (code != MN_OK)
        return code;
    out->blocks = h->blocks;
    fill_result(out, h->leaves, h->nodes - h->leaves, h->triangles + h->hinges, h->triangles);
    return MN_OK;
}
