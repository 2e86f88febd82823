/* A history into a tree in memory.
 *
 * Hidden here: how collapses get the order in which they count. A collapse was made in some round,
 * in some cell; where it belongs is said by its stage and its key, the largest cost that it has
 * waited for. Nothing comes before what it has waited for: that has no larger key, and was made
 * earlier. Leaves are numbered downwards: a collapse's children were made before it, so one pass
 * from the last to the first does. (order.c does the same where the tree does not fit in memory.)
 * One thread; memory: the tree, 16 bytes a vertex, and a buffer. */
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "block.h"
#include "history.h"
#include "tree.h"

typedef struct standing {
    uint32_t key, number; /* floats that are not negative sort as their bits do */
} standing;

static int by_standing(const void *a, const void *b) {
    const standing *x = a, *y = b;
    if (x->key != y->key)
        return x->key < y->key ? -1 : 1;
    return x->number < y->number ? -1 : 1;
}

typedef struct grower {
    mni_history *history;
    const uint32_t *vertex_of;
    mn_tree *tree;
    mn_status *st;
    standing *standing;          /* collapses */
    uint32_t *rank;              /* a collapse: its place in the tree */
    uint32_t *low;               /* a collapse: its leaf_lo; then how many simplices it killed */
    uint32_t *leaf_of;           /* an id */
    mni_history_collapse *chunk; /* a group's */
    unsigned char *buffer;
} grower;

enum { BUFFER_BYTES = 64 << 10 };

/* Calls `what` with all collapses, a group at a time; backwards from the last to the first. */
static mn_code each_group(grower *g, bool backwards,
                          void (*what)(grower *g, uint32_t first, uint32_t count)) {
    uint32_t total = g->history->collapses;
    uint32_t groups = (total + MNI_HISTORY_GROUP - 1) / MNI_HISTORY_GROUP;
    for (uint32_t i = 0; i < groups; i++) {
        uint32_t group = backwards ? groups - 1 - i : i, first = group * MNI_HISTORY_GROUP;
        uint32_t count = total - first < MNI_HISTORY_GROUP ? total - first : MNI_HISTORY_GROUP;
        mni_history_reader r;
        mn_code code = mni_history_group(&r, g->history, group, g->buffer, BUFFER_BYTES, g->st);
        for (uint32_t k = 0; k < count && code == MN_OK; k++)
            if (!mni_history_next(&r, &g->chunk[k]))
                code = mn_fail(g->st, r.spill->trouble.code, "%s", r.spill->trouble.text);
        if (code != MN_OK)
            return code;
        what(g, first, count);
    }
    return MN_OK;
}

static void take_keys(grower *g, uint32_t first, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        g->standing[first + i].key = g->chunk[i].key;
        g->standing[first + i].number = first + i;
    }
}

/* Stages follow each other in the order of making. */
static void rank_collapses(grower *g) {
    uint32_t start = 0;
    for (int stage = 0; stage < 4; stage++) {
        uint32_t count = (uint32_t)g->history->counts.collapses_by_stage[stage];
        qsort(g->standing + start, count, sizeof *g->standing, by_standing);
        start += count;
    }
    MN_ASSERT(start == g->history->collapses);
    for (uint32_t i = 0; i < start; i++)
        g->rank[g->standing[i].number] = i;
}

static void lower(grower *g, uint32_t node, uint32_t low) {
    if (node >= MNI_COLLAPSE)
        g->low[node - MNI_COLLAPSE] = low;
    else
        g->leaf_of[node] = low;
}

static void number_leaves(grower *g, uint32_t first, uint32_t count) {
    for (uint32_t i = count; i-- > 0;) {
        const mni_history_collapse *c = &g->chunk[i];
        lower(g, c->left, g->low[first + i]);
        lower(g, c->right, g->low[first + i] + c->left_leaves);
    }
}

/* A child's order id; its value is the parent's to say. */
static uint32_t child(grower *g, uint32_t node, uint32_t value) {
    if (node < MNI_COLLAPSE)
        return g->leaf_of[node];
    uint32_t at = g->rank[node - MNI_COLLAPSE];
    g->tree->switch_value[at] = mni_facts_value_of(value);
    return g->tree->leaves + at;
}

static void fill_nodes(grower *g, uint32_t first, uint32_t count) {
    mn_tree *t = g->tree;
    for (uint32_t i = 0; i < count; i++) {
        const mni_history_collapse *c = &g->chunk[i];
        uint32_t at = g->rank[first + i];
        t->left[at] = child(g, c->left, mni_facts_left_value(c->facts));
        t->right[at] = child(g, c->right, mni_facts_right_value(c->facts));
        t->radius[at] = mni_facts_radius_of(mni_facts_bounds(c->facts));
        t->cone[at] = mni_facts_cone_of(mni_facts_bounds(c->facts));
        t->simplex_start[at] = c->simplices;
        g->low[first + i] = c->simplices;
    }
}

/* Simplices come as their collapses do. */
static mn_code fill_simplices(grower *g) {
    mn_tree *t = g->tree;
    mni_history_reader r;
    uint32_t sum = 0;
    for (uint32_t i = 0; i <= t->inner; i++) {
        uint32_t count = i < t->inner ? t->simplex_start[i] : 0;
        t->simplex_start[i] = sum;
        sum += count;
    }
    for (uint32_t i = 0; i < t->inner; i++) {
        uint32_t *to = &t->corner[3 * (size_t)t->simplex_start[g->rank[i]]];
        if (i % MNI_HISTORY_GROUP == 0) {
            mn_code code = mni_history_group_killed(&r, g->history, i / MNI_HISTORY_GROUP,
                                                    g->buffer, BUFFER_BYTES, g->st);
            if (code != MN_OK)
                return code;
        }
        for (uint32_t k = 0; k < g->low[i]; k++, to += 3) {
            uint32_t id[3];
            if (!mni_history_next_killed(&r, id))
                return mn_fail(g->st, r.spill->trouble.code, "%s", r.spill->trouble.text);
            for (int c = 0; c < 3; c++)
                to[c] = id[c] == MN_NONE ? MN_NONE : g->leaf_of[id[c]];
        }
    }
    return MN_OK;
}

static void place_leaves(grower *g, const mn_mesh *mesh) {
    mn_tree *t = g->tree;
    for (uint32_t id = 0; id < t->leaves; id++) {
        size_t leaf = g->leaf_of[id], v = g->vertex_of[id];
        for (size_t i = 0; i < 3; i++) /* -0 becomes 0: blocks hold differences */
            t->leaf_position[3 * leaf + i] = mesh->position[3 * v + i] + 0.0f;
        if (t->leaf_color != NULL)
            t->leaf_color[leaf] = mesh->color[v];
    }
}

static mn_code grow(grower *g, const mn_mesh *mesh) {
    mn_tree *t = g->tree;
    mn_code code = each_group(g, false, take_keys);
    if (code != MN_OK)
        return code;
    rank_collapses(g);
    free(g->standing);
    g->standing = NULL;
    lower(g, MNI_COLLAPSE + t->inner - 1, 0);
    code = each_group(g, true, number_leaves);
    if (code == MN_OK)
        code = each_group(g, false, fill_nodes);
    if (code == MN_OK)
        code = fill_simplices(g);
    if (code != MN_OK)
        return code;
    t->switch_value[g->rank[t->inner - 1]] = mni_switch_up(g->history->root_value);
    place_leaves(g, mesh);
    return mni_tree_derive(t, g->st);
}

mn_code mni_history_tree(mni_history *h, const mn_mesh *mesh, const uint32_t *vertex_of, mn_tree *t,
                         mn_status *st) {
    uint32_t n = mesh->vertices;
    MN_ASSERT(h->collapses == n - 1 && n > 1);
    mn_code code = mni_tree_alloc(t, n, 1, h->killed_count, mesh->color != NULL, st);
    if (code != MN_OK)
        return code;
    grower g = {.history = h,
                .vertex_of = vertex_of,
                .tree = t,
                .st = st,
                .standing = malloc((size_t)n * sizeof *g.standing),
                .rank = malloc((size_t)n * sizeof *g.rank),
                .low = malloc((size_t)n * sizeof *g.low),
                .leaf_of = malloc((size_t)n * sizeof *g.leaf_of),
                .chunk = malloc(MNI_HISTORY_GROUP * sizeof *g.chunk),
                .buffer = malloc(BUFFER_BYTES)};
    if (g.standing == NULL || g.rank == NULL || g.low == NULL || g.leaf_of == NULL ||
        g.chunk == NULL || g.buffer == NULL)
        code = mn_fail(st, MN_FAILED, "out of memory for a tree of %u leaves", n);
    if (code == MN_OK)
        code = grow(&g, mesh);
    free(g.rank);
    free(g.low);
    free(g.leaf_of);
    free(g.chunk);
    free(g.buffer);
    free(g.standing);
    if (code != MN_OK) {
        mn_tree_free(t);
        return code;
    }
    t->triangles = mesh->triangles;
    MN_ASSERT(t->depth_max == h->root_levels);
    t->legal_last = n - 1 + (uint32_t)h->counts.collapses_by_stage[0];
    t->grid_step = mesh->grid_step;
    t->intake = mesh->intake;
    t->counts = h->counts;
    memcpy(t->origin, mesh->origin, sizeof t->origin);
    return MN_OK;
}
