/* Goal: extract gives exactly the fronts that design.md §1 and §2 define.
 * Method: prefix fronts counted from the definition; settled fronts against a slow closure that
 * splits in an order drawn by lot and finds neighbours by looking at every simplex. */
#include <check.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "suite.h"
#include "tree.h"
#include "tree_fixture.h"

/* ---- the slow closure ------------------------------------------------------------------------ */

typedef struct slow {
    const mn_tree *t;
    uint32_t *owner; /* leaf: active node */
} slow;

static bool joined(const slow *w, uint32_t s, uint32_t node, uint32_t *highest) {
    const uint32_t *c = w->t->corner + 3 * (size_t)s;
    uint32_t n[3], seats = c[2] == MN_NONE ? 2 : 3;
    bool at = false;
    for (uint32_t k = 0; k < seats; k++)
        n[k] = w->owner[c[k]];
    for (uint32_t k = 0; k < seats; k++)
        for (uint32_t l = k + 1; l < seats; l++)
            if (n[k] == n[l])
                return false; /* killed */
    for (uint32_t k = 0; k < seats; k++) {
        at |= n[k] == node;
        *highest = n[k] > *highest ? n[k] : *highest;
    }
    return at;
}

static void split_slowly(slow *w, uint32_t node) {
    const mn_tree *t = w->t;
    for (;;) {
        uint32_t highest = node;
        for (uint32_t s = 0; s < t->simplices; s++) {
            uint32_t here = node;
            if (joined(w, s, node, &here) && here > highest)
                highest = here;
        }
        if (highest == node)
            break;
        split_slowly(w, highest);
    }
    uint32_t i = node - t->leaves;
    for (uint32_t v = t->leaf_lo[i]; v < t->leaf_hi[i]; v++)
        w->owner[v] = v < t->leaf_mid[i] ? t->left[i] : t->right[i];
}

static void close_slowly(slow *w, float error, uint64_t *seed) {
    const mn_tree *t = w->t;
    for (uint32_t r = 0; r < t->roots; r++) {
        uint32_t lo = t->leaf_lo[t->root[r] - t->leaves], hi = t->leaf_hi[t->root[r] - t->leaves];
        for (uint32_t v = lo; v < hi; v++)
            w->owner[v] = t->root[r];
    }
    for (;;) { /* any wanted active node, by lot */
        uint32_t start = fixture_random(seed) % t->leaves, chosen = MN_NONE;
        for (uint32_t k = 0; k < t->leaves && chosen == MN_NONE; k++) {
            uint32_t node = w->owner[(start + k) % t->leaves];
            if (node >= t->leaves && t->switch_value[node - t->leaves] > error)
                chosen = node;
        }
        if (chosen == MN_NONE)
            return;
        split_slowly(w, chosen);
    }
}

/* The mesh's vertices are the nodes of the front that have triangles. */
static void same_front(const slow *w, const mn_mesh *mesh, const uint32_t *active) {
    const mn_tree *t = w->t;
    unsigned char *has = calloc((size_t)t->leaves + t->inner, 1);
    uint32_t triangles = 0, vertices = 0;
    for (uint32_t s = 0; s < t->simplices; s++) {
        const uint32_t *c = t->corner + 3 * (size_t)s;
        if (c[2] == MN_NONE)
            continue;
        uint32_t n[3] = {w->owner[c[0]], w->owner[c[1]], w->owner[c[2]]};
        if (n[0] == n[1] || n[1] == n[2] || n[2] == n[0])
            continue;
        const uint32_t *m = mesh->corner + 3 * (size_t)triangles++;
        ck_assert_uint_le(triangles, mesh->triangles);
        for (int k = 0; k < 3; k++) {
            ck_assert_uint_eq(active[m[k]], n[k]);
            vertices += !has[n[k]];
            has[n[k]] = 1;
        }
    }
    ck_assert_uint_eq(triangles, mesh->triangles);
    ck_assert_uint_eq(vertices, mesh->vertices);
    for (uint32_t v = 0; v < mesh->vertices; v++) {
        uint32_t lo = active[v] < t->leaves ? active[v] : t->leaf_lo[active[v] - t->leaves];
        ck_assert(memcmp(mesh->position + 3 * (size_t)v, t->leaf_position + 3 * (size_t)lo, 12) ==
                  0);
        if (t->leaf_color != NULL)
            ck_assert_uint_eq(mesh->color[v], t->leaf_color[lo]);
    }
    free(has);
}

static void make(int kind, mn_mesh *mesh, mn_tree *tree) {
    if (kind == 2)
        fixture_book(40, mesh);
    else
        fixture_sheet(14, 5, kind == 1, mesh);
    fixture_tree(mesh, tree);
}

START_TEST(settled_fronts_are_the_least_closed_sets) {
    mn_mesh mesh, out;
    mn_tree tree;
    uint32_t *active;
    uint64_t seed = fixture_seed(23);
    make(_i, &mesh, &tree);
    slow w = {&tree, malloc(sizeof *w.owner * tree.leaves)};
    float top = tree.switch_value[tree.inner - 1];
    for (int step = 0; step < 12; step++) {
        mn_extract_desc desc = {.what = MN_EXTRACT_ERROR,
                                .error = step == 0 ? 0 : top * powf(0.5f, (float)(11 - step))};
        mn_status st = {0};
        float left = desc.error - mn_grid_error(tree.grid_step); /* beside the grid's share */
        close_slowly(&w, left > 0 ? left : 0, &seed);
        ck_assert(mn_tree_extract(&tree, &desc, &out, &active, &st) == MN_OK);
        same_front(&w, &out, active);
        free(active);
        mn_mesh_free(&out);
    }
    free(w.owner);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(prefix_fronts_have_the_most_triangles_allowed) {
    mn_mesh mesh, out;
    mn_tree tree;
    uint32_t *active;
    make(_i, &mesh, &tree);
    slow w = {&tree, malloc(sizeof *w.owner * tree.leaves)};
    /* from the whole mesh, collapse by collapse: every count that occurs, and those between */
    for (uint32_t v = 0; v < tree.leaves; v++)
        w.owner[v] = v;
    uint64_t before = UINT64_MAX;
    for (uint32_t made = 0; made <= tree.inner; made++) {
        uint64_t left = 0;
        if (made > 0)
            for (uint32_t v = tree.leaf_lo[made - 1]; v < tree.leaf_hi[made - 1]; v++)
                w.owner[v] = tree.leaves + made - 1;
        for (uint32_t s = 0; s < tree.simplices; s++) {
            const uint32_t *c = tree.corner + 3 * (size_t)s;
            if (c[2] == MN_NONE)
                continue;
            uint32_t n[3] = {w.owner[c[0]], w.owner[c[1]], w.owner[c[2]]};
            left += n[0] != n[1] && n[1] != n[2] && n[2] != n[0];
        }
        if (left == before)
            continue; /* the first with so many is meant */
        uint64_t asked[] = {left, before - 1};
        for (int k = 0; k < 2; k++) {
            mn_status st = {0};
            mn_extract_desc desc = {.what = MN_EXTRACT_TRIANGLES, .triangles = asked[k]};
            ck_assert(mn_tree_extract(&tree, &desc, &out, &active, &st) == MN_OK);
            ck_assert_uint_eq(out.triangles, left);
            same_front(&w, &out, active);
            free(active);
            mn_mesh_free(&out);
        }
        before = left;
    }
    free(w.owner);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(full_detail_and_nothing_at_all) {
    mn_mesh mesh, out;
    mn_tree tree;
    mn_status st = {0};
    fixture_sheet(9, 5, true, &mesh);
    fixture_tree(&mesh, &tree);
    ck_assert(mn_tree_extract(&tree, &(mn_extract_desc){0}, &out, NULL, &st) == MN_OK);
    ck_assert_uint_eq(out.vertices, mesh.vertices);
    ck_assert_uint_eq(out.triangles, mesh.triangles);
    mn_mesh_free(&out);
    mn_extract_desc none = {.what = MN_EXTRACT_ERROR, .error = INFINITY};
    ck_assert(mn_tree_extract(&tree, &none, &out, NULL, &st) == MN_OK);
    ck_assert_uint_eq(out.triangles, 0);
    ck_assert_uint_eq(out.vertices, 0);
    mn_mesh_free(&out);
    mn_extract_desc zero = {.what = MN_EXTRACT_TRIANGLES, .triangles = 0};
    ck_assert(mn_tree_extract(&tree, &zero, &out, NULL, &st) == MN_OK);
    ck_assert_uint_eq(out.triangles, 0);
    mn_mesh_free(&out);
    mn_extract_desc bad = {.what = MN_EXTRACT_ERROR, .error = NAN};
    ck_assert_int_eq(mn_tree_extract(&tree, &bad, &out, NULL, &st), MN_USAGE);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

int main(void) {
    Suite *s = suite_create("extract");
    TCase *t = tcase_create("fronts");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, settled_fronts_are_the_least_closed_sets, 0, 3);
    tcase_add_loop_test(t, prefix_fronts_have_the_most_triangles_allowed, 0, 3);
    tcase_add_test(t, full_detail_and_nothing_at_all);
    suite_add_tcase(s, t);
    return suite_run(s);
}
