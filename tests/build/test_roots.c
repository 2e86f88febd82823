/* Goal: stage 4 joins the two nearest roots each time, wherever they lie.
 * Method: seeded lone triangles without extent (points) in awkward places, against all pairs. */
#include <check.h>
#include <stdlib.h>
#include <string.h>

#include "metanode/build.h"
#include "suite.h"
#include "tree_fixture.h"

enum { POINTS_MAX = 300 };

static uint64_t random_state;

static float draw(uint32_t steps) {
    return (float)(fixture_random(&random_state) % steps);
}

/* The place of point i, by kind: spread, coincident, a line, a lattice plane, clusters far apart,
 * sizes over six decades, one far away, far out with few digits left. */
static void place(int kind, uint32_t i, float p[3]) {
    for (int c = 0; c < 3; c++) {
        float x = draw(1 << 20) / (1 << 20);
        float few = draw(3);
        switch (kind) {
        case 0:
            p[c] = x;
            break;
        case 1:
            p[c] = few;
            break;
        case 2:
            p[c] = c == 0 ? x : 0;
            break;
        case 3:
            p[c] = c == 2 ? 0 : draw(16);
            break;
        case 4:
            p[c] = x + 1e5f * (float)(i % 5 * (uint32_t)(c + 1) % 3);
            break;
        case 5:
            p[c] = x / (float)(1u << i % 20);
            break;
        case 6:
            p[c] = i == 7 ? 1e9f : x;
            break;
        case 7:
            p[c] = 1e6f + 4 * x;
            break;
        default:
            p[c] = 1;
            break;
        }
    }
}
enum { KINDS = 9 };

static float apart(const float *a, const float *b) {
    float sum = 0;
    for (int c = 0; c < 3; c++)
        sum += (a[c] - b[c]) * (a[c] - b[c]);
    return sum;
}

/* A vertex's colour is its number: those of the leftmost leaf of an order id. */
static uint32_t vertex_of(const mn_tree *t, uint32_t order) {
    return t->leaf_color[order < t->leaves ? order : t->leaf_lo[order - t->leaves]];
}

static void check_joins(const mn_tree *t, const float *position) {
    static uint32_t root[POINTS_MAX];
    uint32_t count = (uint32_t)t->counts.components, first = t->inner - (count - 1);
    ck_assert_uint_eq(t->counts.collapses_by_stage[3], count - 1);
    bool *gone = calloc(t->leaves, sizeof *gone);
    for (uint32_t i = 0; i < first; i++)
        gone[vertex_of(t, t->right[i])] = true;
    count = 0;
    for (uint32_t v = 0; v < t->leaves; v++)
        if (!gone[v])
            root[count++] = v;
    for (uint32_t i = first; i < t->inner; i++) {
        uint32_t a = 0, b = 1; /* root[] rises: the first least pair has the least numbers */
        for (uint32_t x = 0; x < count; x++)
            for (uint32_t y = x + 1; y < count; y++)
                if (apart(&position[3 * root[x]], &position[3 * root[y]]) <
                    apart(&position[3 * root[a]], &position[3 * root[b]])) {
                    a = x;
                    b = y;
                }
        ck_assert_uint_eq(vertex_of(t, t->left[i]), root[a]);
        ck_assert_uint_eq(vertex_of(t, t->right[i]), root[b]);
        memmove(&root[b], &root[b + 1], (--count - b) * sizeof *root);
    }
    free(gone);
}

static void check_points(int kind, uint32_t points) {
    mn_mesh mesh = {.vertices = 3 * points, .triangles = points};
    mesh.position = malloc(sizeof(float) * 9 * points);
    mesh.color = malloc(sizeof(uint32_t) * 3 * points);
    mesh.corner = malloc(sizeof(uint32_t) * 3 * points);
    for (uint32_t i = 0; i < points; i++) {
        place(kind, i, &mesh.position[9 * i]);
        for (uint32_t c = 0; c < 3; c++) {
            memmove(&mesh.position[9 * i + 3 * c], &mesh.position[9 * i], 3 * sizeof(float));
            mesh.corner[3 * i + c] = mesh.color[3 * i + c] = 3 * i + c;
        }
    }
    mn_tree tree;
    mn_status st = {0};
    mn_simplify_desc desc = {0};
    ck_assert_msg(mn_simplify(&mesh, &desc, &tree, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_tree_check(&tree, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(tree.counts.components, points);
    check_joins(&tree, mesh.position);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}

START_TEST(nearest_first) {
    static const uint32_t sizes[] = {2, 3, 7, 8, 9, 16, 17, 63, POINTS_MAX};
    random_state = fixture_seed(11) + (uint64_t)_i;
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        check_points(_i, sizes[i]);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("roots");
    TCase *tc = tcase_create("roots");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, nearest_first, 0, KINDS);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
