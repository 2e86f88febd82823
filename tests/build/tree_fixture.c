/* See tree_fixture.h. */
#include "tree_fixture.h"

#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "block.h"

uint64_t fixture_seed(uint64_t usual) {
    const char *given = getenv("MN_SEED");
    uint64_t seed = given != NULL ? strtoull(given, NULL, 10) : usual;
    printf("seed %llu\n", (unsigned long long)seed);
    return seed;
}

uint32_t fixture_random(uint64_t *state) { /* splitmix64 */
    uint64_t z = *state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return (uint32_t)((z ^ z >> 31) >> 32);
}

static void take_mesh(uint32_t vertices, uint32_t triangles, bool colors, mn_mesh *out) {
    memset(out, 0, sizeof *out);
    out->vertices = vertices;
    out->triangles = triangles;
    out->position = malloc(3 * sizeof(float) * vertices);
    out->color = colors ? malloc(sizeof(uint32_t) * vertices) : NULL;
    out->corner = malloc(3 * sizeof(uint32_t) * triangles);
    ck_assert(out->position != NULL && out->corner != NULL);
    out->intake.input_faces = triangles;
}

static void onto_grid(mn_mesh *mesh) {
    mn_status st = {0};
    ck_assert_msg(mn_mesh_quantise(mesh, 0, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(mesh->intake.merged_positions, 0);
}

void fixture_sheet(uint32_t n, uint64_t seed, bool colors, mn_mesh *out) {
    take_mesh(n * n, 2 * (n - 1) * (n - 1), colors, out);
    for (uint32_t v = 0; v < n * n; v++) {
        float x = (float)(v % n), z = (float)(v / n);
        out->position[3 * v] = x + 0.3f * (float)(fixture_random(&seed) % 1000) / 1000;
        out->position[3 * v + 1] = 3 * sinf(0.3f * x) * cosf(0.2f * z) +
                                   0.2f * (float)(fixture_random(&seed) % 1000) / 1000;
        out->position[3 * v + 2] = z;
        if (colors)
            out->color[v] = fixture_random(&seed);
    }
    uint32_t *c = out->corner;
    for (uint32_t y = 0; y + 1 < n; y++)
        for (uint32_t x = 0; x + 1 < n; x++) {
            uint32_t v = y * n + x;
            uint32_t quad[6] = {v, v + n, v + 1, v + 1, v + n, v + n + 1};
            memcpy(c, quad, sizeof quad);
            c += 6;
        }
    onto_grid(out);
}

void fixture_book(uint32_t pages, mn_mesh *out) {
    take_mesh(pages + 2, pages, false, out);
    for (uint32_t v = 0; v < pages + 2; v++) {
        float turn = (float)v * 6.28f / (float)pages;
        out->position[3 * v] = v < 2 ? 0 : 5 * cosf(turn);
        out->position[3 * v + 1] = v == 0 ? -0.01f : v == 1 ? 0.01f : 0;
        out->position[3 * v + 2] = v < 2 ? 0 : 5 * sinf(turn);
    }
    for (uint32_t t = 0; t < pages; t++) {
        uint32_t page[3] = {t % 2, 1 - t % 2, t + 2};
        memcpy(out->corner + 3 * t, page, sizeof page);
    }
    onto_grid(out);
}

void fixture_tree(const mn_mesh *mesh, mn_tree *out) {
    mn_status st = {0};
    ck_assert_msg(mn_simplify(mesh, &(mn_simplify_desc){0}, out, &st) == MN_OK, "%s", st.text);
}

/* ---- trees drawn by lot ---------------------------------------------------------------------- */

typedef struct lot {
    const mn_mesh *mesh;
    mn_tree *tree;
    uint32_t *left, *right; /* collapses: node ids, vertices first */
    uint32_t *leaf_of;      /* vertex: leaf id */
    uint32_t *parent;       /* node */
} lot;

static uint32_t number(lot *l, uint32_t node, uint32_t next) {
    uint32_t n = l->mesh->vertices;
    if (node < n) {
        l->leaf_of[node] = next;
        return next + 1;
    }
    return number(l, l->right[node - n], number(l, l->left[node - n], next));
}

static uint32_t common(const lot *l, uint32_t a, uint32_t b) {
    while (a != b) {
        if (a < b) /* a parent's id exceeds its child's */
            a = l->parent[a];
        else
            b = l->parent[b];
    }
    return a;
}

static double distance(const float *a, const float *b) {
    double d[3] = {(double)a[0] - b[0], (double)a[1] - b[1], (double)a[2] - b[2]};
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

static void fill_nodes(lot *l, uint64_t *seed) {
    mn_tree *t = l->tree;
    uint32_t n = t->leaves;
    for (uint32_t i = 0; i < t->inner; i++) {
        uint32_t child[2] = {l->left[i], l->right[i]};
        double radius = 0;
        float value = (float)(fixture_random(seed) % 1000) / 1e4f;
        mn_cone cone = mn_cone_make((float[3]){0, 1, 0}, (float)(fixture_random(seed) % 100) / 70);
        for (int k = 0; k < 2; k++) {
            uint32_t order = child[k] < n ? l->leaf_of[child[k]] : child[k];
            uint32_t lo = order < n ? order : t->leaf_lo[order - n];
            uint32_t hi = order < n ? order + 1 : t->leaf_hi[order - n];
            *(k == 0 ? &t->left[i] : &t->right[i]) = order;
            *(k == 0 ? &t->leaf_lo[i] : &t->leaf_mid[i]) = lo;
            t->leaf_hi[i] = hi;
            double own = distance(t->leaf_position + 3 * (size_t)t->leaf_lo[i],
                                  t->leaf_position + 3 * (size_t)lo);
            if (order >= n) {
                own += t->radius[order - n];
                value += t->switch_value[order - n];
                cone = mn_cone_merge(cone, t->cone[order - n]);
            }
            radius = own > radius ? own : radius;
        }
        t->radius[i] = mni_radius_up((float)(radius * 1.000001));
        t->switch_value[i] = mni_switch_up(value);
        t->cone[i] = cone;
    }
}

static void fill_simplices(lot *l) {
    const mn_mesh *m = l->mesh;
    mn_tree *t = l->tree;
    uint32_t *kill = malloc(sizeof *kill * m->triangles), *at = calloc(t->inner, sizeof *at);
    for (uint32_t s = 0; s < m->triangles; s++) {
        const uint32_t *c = m->corner + 3 * (size_t)s;
        uint32_t pair[3] = {common(l, c[0], c[1]), common(l, c[1], c[2]), common(l, c[2], c[0])};
        kill[s] = pair[0] < pair[1] ? pair[0] : pair[1];
        kill[s] = (kill[s] < pair[2] ? kill[s] : pair[2]) - t->leaves;
        t->simplex_start[kill[s] + 1]++;
    }
    for (uint32_t i = 0; i < t->inner; i++) {
        t->simplex_start[i + 1] += t->simplex_start[i];
        at[i] = t->simplex_start[i];
    }
    for (uint32_t s = 0; s < m->triangles; s++) {
        uint32_t *to = t->corner + 3 * (size_t)at[kill[s]]++;
        for (int k = 0; k < 3; k++)
            to[k] = l->leaf_of[m->corner[3 * (size_t)s + (uint32_t)k]];
    }
    free(kill);
    free(at);
}

void fixture_random_tree(const mn_mesh *mesh, uint64_t seed, mn_tree *t) {
    uint32_t n = mesh->vertices, inner = n - 1, tops = n;
    memset(t, 0, sizeof *t);
    t->leaves = n;
    t->inner = inner;
    t->roots = 1;
    t->simplices = t->triangles = mesh->triangles;
    t->legal_last = n - 1;
    t->grid_step = mesh->grid_step;
    memcpy(t->origin, mesh->origin, sizeof t->origin);
    t->leaf_position = malloc(3 * sizeof(float) * n);
    t->leaf_color = mesh->color != NULL ? malloc(sizeof(uint32_t) * n) : NULL;
    t->left = malloc(sizeof(uint32_t) * inner);
    t->right = malloc(sizeof(uint32_t) * inner);
    t->leaf_lo = malloc(sizeof(uint32_t) * inner);
    t->leaf_mid = malloc(sizeof(uint32_t) * inner);
    t->leaf_hi = malloc(sizeof(uint32_t) * inner);
    t->switch_value = malloc(sizeof(float) * inner);
    t->radius = malloc(sizeof(float) * inner);
    t->cone = malloc(sizeof(mn_cone) * inner);
    t->root = malloc(sizeof(uint32_t));
    t->simplex_start = calloc(inner + 1, sizeof(uint32_t));
    t->corner = malloc(3 * sizeof(uint32_t) * mesh->triangles);
    lot l = {.mesh = mesh, .tree = t};
    l.left = malloc(sizeof(uint32_t) * inner);
    l.right = malloc(sizeof(uint32_t) * inner);
    l.leaf_of = malloc(sizeof(uint32_t) * n);
    l.parent = malloc(sizeof(uint32_t) * (n + inner));
    uint32_t *top = malloc(sizeof *top * n);
    for (uint32_t v = 0; v < n; v++)
        top[v] = v;
    for (uint32_t i = 0; i < inner; i++) { /* the newest is often taken again: long chains */
        uint32_t a = fixture_random(&seed) % 3 == 0 ? tops - 1 : fixture_random(&seed) % tops;
        uint32_t left = top[a];
        top[a] = top[--tops];
        uint32_t b = fixture_random(&seed) % tops, right = top[b];
        top[b] = top[--tops];
        l.left[i] = left;
        l.right[i] = right;
        l.parent[left] = l.parent[right] = n + i;
        top[tops++] = n + i;
    }
    number(&l, n + inner - 1, 0);
    for (uint32_t v = 0; v < n; v++) {
        memcpy(t->leaf_position + 3 * (size_t)l.leaf_of[v], mesh->position + 3 * (size_t)v,
               3 * sizeof(float));
        if (mesh->color != NULL)
            t->leaf_color[l.leaf_of[v]] = mesh->color[v];
    }
    t->root[0] = n + inner - 1;
    fill_nodes(&l, &seed);
    fill_simplices(&l);
    uint32_t *depth = calloc(n + inner, sizeof *depth); /* from the root down: parents come last */
    t->depth_max = 1;
    depth[n + inner - 1] = 1;
    for (uint32_t node = n + inner - 1; node-- > 0;) {
        depth[node] = depth[l.parent[node]] + 1;
        t->depth_max = depth[node] > t->depth_max ? depth[node] : t->depth_max;
    }
    free(depth);
    free(top);
    free(l.left);
    free(l.right);
    free(l.leaf_of);
    free(l.parent);
}

/* ---- comparing --------------------------------------------------------------------------------
 */

#define SAME_ARRAY(field, count)                                                                   \
    ck_assert_msg(memcmp(a->field, b->field, (count) * sizeof *a->field) == 0, #field " differs")

static bool turned(const uint32_t *a, const uint32_t *b) {
    if (a[2] == MN_NONE || b[2] == MN_NONE)
        return memcmp(a, b, 3 * sizeof *a) == 0;
    for (int k = 0; k < 3; k++)
        if (a[0] == b[k] && a[1] == b[(k + 1) % 3] && a[2] == b[(k + 2) % 3])
            return true;
    return false;
}

void fixture_same(const mn_tree *a, const mn_tree *b) {
    ck_assert_uint_eq(a->leaves, b->leaves);
    ck_assert_uint_eq(a->inner, b->inner);
    ck_assert_uint_eq(a->roots, b->roots);
    ck_assert_uint_eq(a->simplices, b->simplices);
    ck_assert_uint_eq(a->triangles, b->triangles);
    ck_assert_uint_eq(a->legal_last, b->legal_last);
    ck_assert_uint_eq(a->depth_max, b->depth_max);
    ck_assert_uint_eq(a->metric, b->metric);
    ck_assert(memcmp(a->origin, b->origin, sizeof a->origin) == 0);
    ck_assert_float_eq(a->grid_step, b->grid_step);
    SAME_ARRAY(leaf_position, 3 * (size_t)a->leaves);
    ck_assert((a->leaf_color == NULL) == (b->leaf_color == NULL));
    if (a->leaf_color != NULL)
        SAME_ARRAY(leaf_color, (size_t)a->leaves);
    SAME_ARRAY(left, (size_t)a->inner);
    SAME_ARRAY(right, (size_t)a->inner);
    SAME_ARRAY(leaf_lo, (size_t)a->inner);
    SAME_ARRAY(leaf_mid, (size_t)a->inner);
    SAME_ARRAY(leaf_hi, (size_t)a->inner);
    SAME_ARRAY(switch_value, (size_t)a->inner);
    SAME_ARRAY(radius, (size_t)a->inner);
    SAME_ARRAY(cone, (size_t)a->inner);
    SAME_ARRAY(root, (size_t)a->roots);
    SAME_ARRAY(simplex_start, (size_t)a->inner + 1);
    for (uint32_t s = 0; s < a->simplices; s++)
        ck_assert_msg(turned(a->corner + 3 * (size_t)s, b->corner + 3 * (size_t)s),
                      "simplex %u differs", s);
}

static char folder[64];
static pid_t folder_owner; /* tests are children of who may have made it in a fixture */
static void remove_folder(void) {
    char command[96];
    if (getpid() != folder_owner)
        return;
    snprintf(command, sizeof command, "rm -rf %s", folder);
    if (system(command) != 0)
        fprintf(stderr, "could not remove %s\n", folder);
}

const char *fixture_path(const char *name) {
    static char path[4][128];
    static int turn;
    if (folder[0] == 0) {
        snprintf(folder, sizeof folder, "/tmp/metanode-test-XXXXXX");
        ck_assert(mkdtemp(folder) != NULL);
        folder_owner = getpid();
        atexit(remove_folder);
    }
    turn = (turn + 1) % 4;
    snprintf(path[turn], sizeof path[turn], "%s/%s", folder, name);
    return path[turn];
}
