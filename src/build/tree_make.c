/* From collapses in input vertices to an mn_tree: leaves renumbered depth-first, intervals, spheres
 * and cones bottom-up, simplices sorted by kill node.
 *
 * Hidden here: the order of the leaves, and what encloses what, rounded up to what files hold. The
 * steps follow each other in mni_tree_make, each once. One thread; memory: the tree, and 16 bytes a
 * vertex for a while. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "block.h"
#include "simplify.h"

typedef struct maker {
    mni_simplifier *s;
    mn_tree *tree;
    uint32_t *leaf_of;   /* input vertex → leaf id */
    uint32_t *vertex_of; /* leaf id → input vertex */
    uint32_t *stack;
} maker;

static bool take_arrays(mn_tree *t, const mn_mesh *mesh) {
    size_t leaves = t->leaves, inner = t->inner, some = inner > 0 ? inner : 1;
    t->leaf_position = malloc(leaves * 3 * sizeof(float));
    t->leaf_color = mesh->color != NULL ? malloc(leaves * sizeof(uint32_t)) : NULL;
    t->left = malloc(some * sizeof(uint32_t));
    t->right = malloc(some * sizeof(uint32_t));
    t->leaf_lo = malloc(some * sizeof(uint32_t));
    t->leaf_mid = malloc(some * sizeof(uint32_t));
    t->leaf_hi = malloc(some * sizeof(uint32_t));
    t->switch_value = malloc(some * sizeof(float));
    t->radius = malloc(some * sizeof(float));
    t->cone = malloc(some * sizeof(mn_cone));
    t->root = malloc(t->roots * sizeof(uint32_t));
    t->simplex_start = calloc(inner + 1, sizeof(uint32_t));
    t->corner = malloc((size_t)t->simplices * 3 * sizeof(uint32_t));
    return t->leaf_position != NULL && (mesh->color == NULL || t->leaf_color != NULL) &&
           t->left != NULL && t->right != NULL && t->leaf_lo != NULL && t->leaf_mid != NULL &&
           t->leaf_hi != NULL && t->switch_value != NULL && t->radius != NULL && t->cone != NULL &&
           t->root != NULL && t->simplex_start != NULL && t->corner != NULL;
}

/* Numbers the leaves below `root`, left first, from `next` on. The stack holds nodes to visit; a
 * tree may be as deep as it has nodes. */
static uint32_t number_leaves(maker *m, uint32_t root, uint32_t next) {
    uint32_t n = m->tree->leaves, depth = 0;
    m->stack[depth++] = root;
    while (depth > 0) {
        uint32_t node = m->stack[--depth];
        if (node >= n) {
            m->stack[depth++] = m->s->made.right[node - n];
            m->stack[depth++] = m->s->made.left[node - n];
            continue;
        }
        m->leaf_of[node] = next;
        m->vertex_of[next++] = node;
    }
    return next;
}

static void place_leaves(maker *m) {
    mn_tree *t = m->tree;
    const mn_mesh *mesh = m->s->mesh;
    uint32_t next = 0, roots = 0;
    for (uint32_t v = 0; v < t->leaves; v++)
        if (m->s->surface.vertex[v].node != MN_NONE) {
            t->root[roots++] = m->s->surface.vertex[v].node;
            next = number_leaves(m, m->s->surface.vertex[v].node, next);
        }
    MN_ASSERT(next == t->leaves && roots == t->roots);
    for (uint32_t r = 0; r < roots; r++)
        if (t->root[r] < t->leaves)
            t->root[r] = m->leaf_of[t->root[r]];
    for (uint32_t leaf = 0; leaf < t->leaves; leaf++) {
        for (uint32_t i = 0; i < 3; i++) /* -0 becomes 0: blocks hold differences */
            t->leaf_position[3 * (size_t)leaf + i] =
                mesh->position[3 * (size_t)m->vertex_of[leaf] + i] + 0.0f;
        if (t->leaf_color != NULL)
            t->leaf_color[leaf] = mesh->color[m->vertex_of[leaf]];
    }
}

typedef struct bounds {
    uint32_t lo, hi;
    float switch_value;
    mni_node_bounds of;
} bounds;

static bounds bounds_of(const maker *m, uint32_t node) {
    const mn_tree *t = m->tree;
    if (node < t->leaves)
        return (bounds){node, node + 1, 0, m->s->leaf_bounds[m->vertex_of[node]]};
    uint32_t i = node - t->leaves;
    return (bounds){t->leaf_lo[i], t->leaf_hi[i], t->switch_value[i], {t->radius[i], t->cone[i]}};
}

/* Children have smaller order ids, so one pass upwards does. depth[] is taken from the stack's
 * memory, which is free again. */
static void fill_inner(maker *m) {
    mn_tree *t = m->tree;
    uint32_t n = t->leaves, *depth = m->stack;
    memset(depth, 0, (size_t)(n + t->inner) * sizeof *depth);
    for (uint32_t i = 0; i < t->inner; i++) {
        uint32_t l = m->s->made.left[i], r = m->s->made.right[i];
        t->left[i] = l < n ? m->leaf_of[l] : l;
        t->right[i] = r < n ? m->leaf_of[r] : r;
        bounds a = bounds_of(m, t->left[i]), b = bounds_of(m, t->right[i]);
        MN_ASSERT(a.hi == b.lo);
        t->leaf_lo[i] = a.lo;
        t->leaf_mid[i] = a.hi;
        t->leaf_hi[i] = b.hi;
        t->switch_value[i] = mni_switch_up(m->s->made.value[n + i]);
        MN_ASSERT(t->switch_value[i] >= a.switch_value && t->switch_value[i] >= b.switch_value);
        mni_node_bounds both = mni_parent_bounds(&t->leaf_position[3 * (size_t)a.lo], a.of,
                                                 &t->leaf_position[3 * (size_t)b.lo], b.of);
        t->radius[i] = both.radius;
        t->cone[i] = both.cone;
        uint32_t deeper =
            depth[t->left[i]] > depth[t->right[i]] ? depth[t->left[i]] : depth[t->right[i]];
        depth[n + i] = deeper + 1;
        if (depth[n + i] + 1 > t->depth_max)
            t->depth_max = depth[n + i] + 1;
    }
    if (t->depth_max == 0)
        t->depth_max = 1;
}

/* A counting sort by kill node: inside each the input's order stays, hinges behind triangles. */
static void sort_simplices(maker *m) {
    mn_tree *t = m->tree;
    const mni_surface *surface = &m->s->surface;
    for (uint32_t x = 0; x < t->simplices; x++)
        t->simplex_start[surface->simplex[x].killed]++;
    uint32_t at = 0;
    for (uint32_t i = 0; i <= t->inner; i++) {
        uint32_t count = i < t->inner ? t->simplex_start[i] : 0;
        t->simplex_start[i] = at;
        at += count;
    }
    uint32_t *next = m->stack;
    memcpy(next, t->simplex_start, (size_t)t->inner * sizeof *next);
    for (uint32_t x = 0; x < t->simplices; x++) {
        uint32_t to = next[surface->simplex[x].killed]++;
        for (int c = 0; c < 3; c++) {
            uint32_t v = surface->origin[3 * (size_t)x + c];
            t->corner[3 * (size_t)to + c] = v == MN_NONE ? MN_NONE : m->leaf_of[v];
        }
    }
}

mn_code mni_tree_make(mni_simplifier *s, mn_tree *t) {
    uint32_t leaves = s->mesh->vertices;
    *t = (mn_tree){.leaves = leaves,
                   .inner = s->made.count,
                   .simplices = s->surface.simplices,
                   .triangles = s->surface.triangles,
                   .roots = leaves - s->made.count,
                   .grid_step = s->mesh->grid_step};
    maker m = {.s = s,
               .tree = t,
               .leaf_of = malloc(leaves * sizeof(uint32_t)),
               .vertex_of = malloc(leaves * sizeof(uint32_t)),
               .stack = malloc(((size_t)leaves * 2 + 2) * sizeof(uint32_t))};
    mn_code code = MN_OK;
    if (!take_arrays(t, s->mesh) || m.leaf_of == NULL || m.vertex_of == NULL || m.stack == NULL) {
        mn_tree_free(t);
        code = mn_fail(s->st, MN_FAILED, "out of memory for a tree of %u leaves", leaves);
    } else {
        place_leaves(&m);
        fill_inner(&m);
        sort_simplices(&m);
    }
    free(m.leaf_of);
    free(m.vertex_of);
    free(m.stack);
    return code;
}
