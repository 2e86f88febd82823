/* From a tree in memory to rows, and what hashes them.
 *
 * Hides: the order of rows, which is that of leaves, while a tree's nodes stand by order id. One
 * thread a tree; memory: 4 bytes a leaf for the time of a call. Paper: none. */
#include "tree_rows.h"

#include <stdlib.h>
#include <string.h>
#define XXH_STATIC_LINKING_ONLY /* the state's size */
#include <xxhash.h>

#include "mn_assert.h"
#include "tree.h"

enum { BATCH = 256 }; /* records handed over at once */

typedef struct giver {
    const mn_tree *tree;
    uint32_t *node_at; /* a row: its inner node, or MN_NONE */
    mni_rows_put put;
    void *context;
} giver;

static uint32_t row_of(const mn_tree *t, uint32_t order) {
    return order < t->leaves ? MN_NONE : t->leaf_mid[order - t->leaves];
}

static uint32_t simplices_of(const mn_tree *t, uint32_t node) {
    return node == MN_NONE ? 0 : t->simplex_start[node + 1] - t->simplex_start[node];
}

static mni_row make_row(const mn_tree *t, uint32_t leaf, uint32_t node, uint32_t simplex_start) {
    mni_row row = {.rgba = t->leaf_color != NULL ? t->leaf_color[leaf] : UINT32_MAX,
                   .left = MN_NONE,
                   .right = MN_NONE,
                   .simplex_start = simplex_start};
    memcpy(row.position, t->leaf_position + 3 * (size_t)leaf, sizeof row.position);
    if (node == MN_NONE)
        return row;
    row.order = t->leaves + node;
    row.leaf_lo = t->leaf_lo[node];
    row.leaf_hi = t->leaf_hi[node];
    row.left = row_of(t, t->left[node]);
    row.right = row_of(t, t->right[node]);
    row.switch_value = t->switch_value[node];
    row.radius = t->radius[node];
    row.cone = t->cone[node];
    return row;
}

static mn_code give_rows(const giver *g) {
    const mn_tree *t = g->tree;
    mni_row batch[BATCH];
    uint32_t held = 0, simplices = 0;
    mn_code code = MN_OK;
    for (uint32_t i = 0; i < t->leaves && code == MN_OK; i++) {
        batch[held++] = make_row(t, i, g->node_at[i], simplices);
        simplices += simplices_of(t, g->node_at[i]);
        if (held == BATCH || i + 1 == t->leaves) {
            code = g->put(g->context, MNI_ROWS, batch, held * sizeof *batch);
            held = 0;
        }
    }
    return code;
}

/* The corner outside the node comes last. */
static mni_row_simplex turned(const uint32_t *c, uint32_t lo, uint32_t hi) {
    uint32_t last = 2;
    for (uint32_t k = 0; k < 2 && c[2] != MN_NONE; k++)
        if (c[k] < lo || c[k] >= hi)
            last = k;
    return (mni_row_simplex){{c[(last + 1) % 3], c[(last + 2) % 3], c[last]}};
}

static mn_code give_simplices(const giver *g) {
    const mn_tree *t = g->tree;
    mni_row_simplex batch[BATCH];
    uint32_t held = 0;
    mn_code code = MN_OK;
    for (uint32_t i = 0; i < t->leaves && code == MN_OK; i++) {
        uint32_t node = g->node_at[i], count = simplices_of(t, node);
        for (uint32_t s = 0; s < count && code == MN_OK; s++) {
            batch[held++] = turned(t->corner + 3 * ((size_t)t->simplex_start[node] + s),
                                   t->leaf_lo[node], t->leaf_hi[node]);
            if (held == BATCH) {
                code = g->put(g->context, MNI_SIMPLICES, batch, held * sizeof *batch);
                held = 0;
            }
        }
    }
    return held > 0 && code == MN_OK
               ? g->put(g->context, MNI_SIMPLICES, batch, held * sizeof *batch)
               : code;
}

mn_code mni_tree_rows(const mn_tree *tree, mni_rows_put put, void *context, mn_status *st) {
    giver g = {tree, malloc(sizeof *g.node_at * tree->leaves), put, context};
    if (g.node_at == NULL)
        return mn_fail(st, MN_FAILED, "no memory for the rows of %u vertices", tree->leaves);
    memset(g.node_at, 0xff, sizeof *g.node_at * tree->leaves);
    for (uint32_t i = 0; i < tree->inner; i++) {
        MN_ASSERT(g.node_at[tree->leaf_mid[i]] == MN_NONE);
        g.node_at[tree->leaf_mid[i]] = i;
    }
    mn_code code = give_rows(&g);
    if (code == MN_OK)
        code = give_simplices(&g);
    free(g.node_at);
    return code;
}

/* ---- hashes --------------------------------------------------------------------------------- */

static mn_code add_to_sum(void *context, int section, const void *bytes, size_t count) {
    XXH3_64bits_update((XXH3_state_t *)context + section, bytes, count);
    return MN_OK;
}

mn_code mni_tree_rows_sums(const mn_tree *tree, uint64_t sum[MNI_SECTIONS], mn_status *st) {
    XXH3_state_t state[MNI_SECTIONS]; /* on the stack: no allocation that could fail */
    for (int i = 0; i < MNI_SECTIONS; i++)
        XXH3_64bits_reset(&state[i]);
    mn_code code = mni_tree_rows(tree, add_to_sum, state, st);
    for (int i = 0; i < MNI_SECTIONS; i++)
        sum[i] = XXH3_64bits_digest(&state[i]);
    return code;
}

uint64_t mni_build_id(const mn_tree *t, bool has_colors, const uint64_t sum[MNI_SECTIONS],
                      const mn_block_desc *desc) {
    bool packed = desc != NULL && desc->blocking == MN_BLOCKING_PACKED;
    struct {
        uint32_t head[10];
        double origin[3];
        float grid_step;
        uint32_t zero;
        uint64_t sum[MNI_SECTIONS];
    } said = {.head = {t->leaves, t->inner, t->simplices, t->triangles, t->legal_last, t->metric,
                       has_colors, desc != NULL, desc != NULL ? (uint32_t)desc->blocking : 0,
                       desc == NULL ? 0
                       : packed     ? desc->block_bytes
                                    : desc->l},
              .grid_step = t->grid_step};
    _Static_assert(sizeof said == 88, "no padding");
    memcpy(said.origin, t->origin, sizeof said.origin);
    memcpy(said.sum, sum, sizeof said.sum);
    return XXH3_64bits(&said, sizeof said);
}

mn_code mni_tree_build_id(const mn_tree *t, const mn_block_desc *desc, uint64_t *id,
                          mn_status *st) {
    uint64_t sum[MNI_SECTIONS];
    mn_code code = mni_tree_rows_sums(t, sum, st);
    *id = mni_build_id(t, t->leaf_color != NULL, sum, desc);
    return code;
}
