/* fixture_load (tree_fixture.h): two walks over the rows of a .mnt, nodes first, of which it is
 * known then how many simplices each has; and these. */
#include <string.h>

#include "mnt_rows.h"
#include "tree.h"
#include "tree_fixture.h"

typedef struct loader {
    const char *path;
    mn_tree *tree;
    uint32_t node, held; /* the one that came last, and its simplices so far */
    mn_status *st;
} loader;

static mn_code take_row(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    loader *l = context;
    mn_tree *t = l->tree;
    memcpy(t->leaf_position + 3 * (size_t)at, row->position, sizeof row->position);
    if (t->leaf_color != NULL)
        t->leaf_color[at] = row->rgba;
    if (child == NULL)
        return MN_OK;
    const uint32_t i = l->node = row->order - t->leaves;
    t->leaf_lo[i] = row->leaf_lo;
    t->leaf_mid[i] = at;
    t->leaf_hi[i] = row->leaf_hi;
    t->left[i] = child[0];
    t->right[i] = child[1];
    t->switch_value[i] = row->switch_value;
    t->radius[i] = row->radius;
    t->cone[i] = row->cone;
    return MN_OK;
}

static mn_code count_simplex(void *context, const mni_row_simplex *simplex) {
    loader *l = context;
    (void)simplex;
    l->tree->simplex_start[l->node + 1]++;
    return MN_OK;
}

static mn_code find_node(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    loader *l = context;
    (void)at;
    l->held = 0;
    if (child != NULL)
        l->node = row->order - l->tree->leaves;
    return MN_OK;
}

static mn_code take_simplex(void *context, const mni_row_simplex *simplex) {
    loader *l = context;
    mn_tree *t = l->tree;
    const uint32_t at = t->simplex_start[l->node] + l->held++;
    if (at >= t->simplex_start[l->node + 1])
        return mn_fail(l->st, MN_BAD_INPUT, "%s: was changed while it was read; try again",
                       l->path);
    memcpy(t->corner + 3 * (size_t)at, simplex->corner, sizeof simplex->corner);
    return MN_OK;
}

static mn_code load(loader *l, mni_mnt *mnt) {
    const mni_walk_desc desc = {.phase = "loading"};
    const mni_walk_sink rows = {take_row, count_simplex, l};
    const mni_walk_sink simplices = {find_node, take_simplex, l};
    const mn_header *h = &mnt->header;
    mn_tree *t = l->tree;
    mn_code code = mni_tree_alloc(t, h->leaves, h->roots, (uint32_t)h->triangles + h->hinges,
                                  h->has_colors, l->st);
    if (code != MN_OK)
        return code;
    t->triangles = (uint32_t)h->triangles;
    t->legal_last = h->legal_last;
    t->metric = h->metric;
    memcpy(t->origin, h->origin, sizeof t->origin);
    t->grid_step = h->grid_step;
    code = mni_mnt_walk(mnt, &desc, &rows, l->st);
    for (uint32_t i = 0; i < t->inner; i++)
        t->simplex_start[i + 1] += t->simplex_start[i];
    if (code == MN_OK)
        code = mni_mnt_walk(mnt, &desc, &simplices, l->st);
    if (code == MN_OK)
        code = mni_tree_derive(t, l->st);
    return code == MN_OK ? mn_tree_check(t, l->st) : code;
}

mn_code fixture_load(const char *path, mn_tree *out, mn_status *st) {
    mni_mnt mnt;
    loader l = {.path = path, .tree = out, .st = st};
    memset(out, 0, sizeof *out);
    mn_code code = mni_mnt_open(&mnt, path, l.st);
    if (code == MN_OK)
        code = load(&l, &mnt);
    mni_mnt_close(&mnt);
    if (code != MN_OK)
        mn_tree_free(out);
    return code;
}
