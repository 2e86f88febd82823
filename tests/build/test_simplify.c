/* Goal: a tree from any mesh: strict order, legal fronts, every split's third corner beside it; at
 * once or in rounds, in as many threads as one likes.
 * Method: small meshes of every awkward kind, each front of the build order recounted by force. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "legal.h"
#include "metanode/build.h"
#include "suite.h"

typedef struct model {
    mn_mesh mesh;
    uint32_t vertices_room, triangles_room;
    bool closed; /* a closed manifold, consistently oriented */
} model;

static uint32_t add_vertex(model *m, double x, double y, double z) {
    if (m->mesh.vertices == m->vertices_room) {
        m->vertices_room = 2 * m->vertices_room + 64;
        m->mesh.position = realloc(m->mesh.position, m->vertices_room * 3 * sizeof(float));
    }
    float *p = &m->mesh.position[3 * m->mesh.vertices];
    p[0] = (float)x + 0.0f; /* -0 would become 0 in the tree */
    p[1] = (float)y + 0.0f;
    p[2] = (float)z + 0.0f;
    return m->mesh.vertices++;
}

static void add_triangle(model *m, uint32_t a, uint32_t b, uint32_t c) {
    if (m->mesh.triangles == m->triangles_room) {
        m->triangles_room = 2 * m->triangles_room + 64;
        m->mesh.corner = realloc(m->mesh.corner, m->triangles_room * 3 * sizeof(uint32_t));
    }
    uint32_t *t = &m->mesh.corner[3 * m->mesh.triangles++];
    t[0] = a;
    t[1] = b;
    t[2] = c;
}

static void free_model(model *m) {
    free(m->mesh.position);
    free(m->mesh.corner);
}

static model sheet(uint32_t n) {
    model m = {0};
    for (uint32_t y = 0; y <= n; y++)
        for (uint32_t x = 0; x <= n; x++)
            add_vertex(&m, x, y, 0.3 * sin(0.9 * x) * cos(0.7 * y));
    for (uint32_t y = 0; y < n; y++)
        for (uint32_t x = 0; x < n; x++) {
            uint32_t v = y * (n + 1) + x;
            add_triangle(&m, v, v + 1, v + n + 2);
            add_triangle(&m, v, v + n + 2, v + n + 1);
        }
    return m;
}

static void add_torus(model *m, uint32_t nu, uint32_t nv, double at) {
    uint32_t base = m->mesh.vertices;
    for (uint32_t u = 0; u < nu; u++)
        for (uint32_t v = 0; v < nv; v++) {
            double a = 2 * M_PI * u / nu, b = 2 * M_PI * v / nv;
            add_vertex(m, at + (3 + cos(b)) * cos(a), (3 + cos(b)) * sin(a), sin(b));
        }
    for (uint32_t u = 0; u < nu; u++)
        for (uint32_t v = 0; v < nv; v++) {
            uint32_t p = base + u * nv + v, q = base + u * nv + (v + 1) % nv;
            uint32_t r = base + (u + 1) % nu * nv + v, s = base + (u + 1) % nu * nv + (v + 1) % nv;
            add_triangle(m, p, r, s);
            add_triangle(m, p, s, q);
        }
}

static model torus(void) {
    model m = {.closed = true};
    add_torus(&m, 12, 7, 0);
    return m;
}

/* A globe by latitude: its poles have `around` neighbours. */
static void add_globe(model *m, uint32_t around, uint32_t rows, double x, double radius) {
    uint32_t base = m->mesh.vertices;
    for (uint32_t r = 1; r < rows; r++)
        for (uint32_t a = 0; a < around; a++) {
            double lat = M_PI * r / rows, lon = 2 * M_PI * a / around;
            add_vertex(m, x + radius * sin(lat) * cos(lon), radius * sin(lat) * sin(lon),
                       radius * cos(lat));
        }
    uint32_t north = add_vertex(m, x, 0, radius), south = add_vertex(m, x, 0, -radius);
    uint32_t last = base + (rows - 2) * around;
    for (uint32_t a = 0; a < around; a++) {
        uint32_t b = (a + 1) % around;
        add_triangle(m, north, base + a, base + b);
        add_triangle(m, south, last + b, last + a);
        for (uint32_t r = 0; r + 2 < rows; r++) {
            uint32_t p = base + r * around, q = p + around;
            add_triangle(m, p + a, q + a, q + b);
            add_triangle(m, p + a, q + b, p + b);
        }
    }
}

static model globe(void) {
    model m = {.closed = true};
    add_globe(&m, 40, 6, 0, 1);
    return m;
}

static model tetrahedron(void) {
    model m = {.closed = true};
    uint32_t a = add_vertex(&m, 0, 0, 0), b = add_vertex(&m, 1, 0, 0);
    uint32_t c = add_vertex(&m, 0, 1, 0), d = add_vertex(&m, 0, 0, 1);
    add_triangle(&m, a, c, b);
    add_triangle(&m, a, b, d);
    add_triangle(&m, b, c, d);
    add_triangle(&m, c, a, d);
    return m;
}

static model lone_triangles(void) {
    model m = {0};
    for (uint32_t i = 0; i < 60; i++) {
        double x = (i * 37) % 61, y = (i * 17) % 23, z = (i * 5) % 11;
        uint32_t a = add_vertex(&m, x, y, z), b = add_vertex(&m, x + 0.4, y + 0.1, z);
        add_triangle(&m, a, b, add_vertex(&m, x, y + 0.5, z + 0.2));
    }
    return m;
}

static model one_triangle(void) {
    model m = {0};
    uint32_t a = add_vertex(&m, 0, 0, 0), b = add_vertex(&m, 1, 0, 0);
    add_triangle(&m, a, b, add_vertex(&m, 0, 1, 0));
    return m;
}

static model zero_area(void) {
    model m = {0};
    uint32_t a = add_vertex(&m, 0, 0, 0), b = add_vertex(&m, 1, 0, 0);
    uint32_t c = add_vertex(&m, 2, 0, 0), d = add_vertex(&m, 1, 1, 0);
    add_triangle(&m, a, b, c);
    add_triangle(&m, a, d, b);
    add_triangle(&m, b, d, c);
    return m;
}

/* A torus with a sheet of fins on a third of its edges: edges with three triangles. */
static model fins(void) {
    model m = {0};
    add_torus(&m, 10, 6, 0);
    uint32_t triangles = m.mesh.triangles;
    for (uint32_t t = 0; t < triangles; t += 3) {
        uint32_t a = m.mesh.corner[3 * t], b = m.mesh.corner[3 * t + 1];
        const float *p = &m.mesh.position[3 * a];
        uint32_t tip = add_vertex(&m, p[0] * 1.2, p[1] * 1.2, p[2] * 1.5 + 0.1 * t);
        add_triangle(&m, a, b, tip);
    }
    return m;
}

static model many_parts(void) {
    model m = {.closed = true};
    for (uint32_t i = 0; i < 9; i++)
        add_globe(&m, 8, 4, 3.0 * i, 1 + 0.1 * i);
    return m;
}

/* Two cones that meet in one vertex, and every triangle of one of them twice, turned over. */
static model bow_tie(void) {
    model m = {0};
    uint32_t tip = add_vertex(&m, 0, 0, 0);
    for (int side = -1; side <= 1; side += 2) {
        uint32_t base = m.mesh.vertices;
        for (int i = 0; i < 7; i++)
            add_vertex(&m, side, cos(i * 2 * M_PI / 7), sin(i * 2 * M_PI / 7));
        for (uint32_t i = 0; i < 7; i++) {
            add_triangle(&m, tip, base + i, base + (i + 1) % 7);
            if (side > 0)
                add_triangle(&m, tip, base + (i + 1) % 7, base + i);
        }
    }
    return m;
}

/* An edge with 50 triangles. */
static model book(void) {
    model m = {0};
    uint32_t a = add_vertex(&m, 0, 0, 0), b = add_vertex(&m, 0, 0, 1);
    for (int i = 0; i < 50; i++)
        add_triangle(&m, a, b, add_vertex(&m, cos(0.1 * i), sin(0.1 * i), 0.5 + 0.001 * i));
    return m;
}

/* ---- recounts ---- */

typedef struct front { /* the prefix front: active[leaf] = order id */
    const mn_tree *tree;
    uint32_t *active;
} front;

static uint32_t kill_of(const mn_tree *t, uint32_t simplex) {
    uint32_t lo = 0, hi = t->inner;
    while (hi - lo > 1) {
        uint32_t mid = (lo + hi) / 2;
        if (t->simplex_start[mid] <= simplex)
            lo = mid;
        else
            hi = mid;
    }
    return t->leaves + lo;
}

static int compare_edges(const void *a, const void *b) {
    return memcmp(a, b, 8);
}

/* Invariant 1 for a closed manifold: each edge once each way (legal), or as often each way. */
static void check_edges(const front *f, const uint32_t *kill, uint32_t above, bool legal) {
    const mn_tree *t = f->tree;
    uint32_t(*edge)[2] = malloc((size_t)t->simplices * 6 * sizeof *edge), count = 0;
    for (uint32_t x = 0; x < t->simplices; x++) {
        const uint32_t *c = &t->corner[3 * x];
        if (kill[x] < above || c[2] == MN_NONE)
            continue;
        for (int i = 0; i < 3; i++) {
            edge[count][0] = f->active[c[i]];
            edge[count++][1] = f->active[c[(i + 1) % 3]];
        }
    }
    qsort(edge, count, sizeof *edge, compare_edges);
    for (uint32_t i = 0; i < count;) {
        uint32_t same = i, back[2] = {edge[i][1], edge[i][0]}, backs = 0;
        while (same < count && compare_edges(edge[i], edge[same]) == 0)
            same++;
        for (uint32_t j = 0; j < count; j++)
            backs += compare_edges(edge[j], back) == 0;
        ck_assert_uint_eq(same - i, backs);
        if (legal)
            ck_assert_uint_eq(same - i, 1);
        i = same;
    }
    free(edge);
}

static bool beside(const front *f, const uint32_t *kill, uint32_t p, uint32_t w) {
    const mn_tree *t = f->tree;
    for (uint32_t x = 0; x < t->simplices; x++) {
        bool has_p = false, has_w = false;
        for (int c = 0; c < 3 && kill[x] > p; c++) {
            uint32_t leaf = t->corner[3 * x + c];
            has_p |= leaf != MN_NONE && f->active[leaf] == p;
            has_w |= leaf != MN_NONE && f->active[leaf] == w;
        }
        if (has_p && has_w)
            return true;
    }
    return false;
}

/* Undoes the build collapse by collapse and looks at each front. */
static void check_fronts(const mn_tree *t, bool closed) {
    front f = {t, malloc(t->leaves * sizeof(uint32_t))};
    uint32_t *kill = malloc(t->simplices * sizeof *kill);
    for (uint32_t x = 0; x < t->simplices; x++)
        kill[x] = kill_of(t, x);
    for (uint32_t leaf = 0; leaf < t->leaves; leaf++)
        f.active[leaf] = t->root[0];
    ck_assert_uint_eq(t->roots, 1);
    for (uint32_t i = t->inner; i-- > 0;) {
        uint32_t p = t->leaves + i;
        if (closed)
            check_edges(&f, kill, p + 1, p <= t->legal_last);
        for (uint32_t x = t->simplex_start[i]; x < t->simplex_start[i + 1]; x++)
            for (int c = 0; c < 3; c++) {
                uint32_t leaf = t->corner[3 * x + c];
                if (leaf != MN_NONE && f.active[leaf] != p)
                    ck_assert_msg(beside(&f, kill, p, f.active[leaf]), "split %u", p);
            }
        for (uint32_t leaf = t->leaf_lo[i]; leaf < t->leaf_hi[i]; leaf++) {
            ck_assert_uint_eq(f.active[leaf], p);
            f.active[leaf] = leaf < t->leaf_mid[i] ? t->left[i] : t->right[i];
        }
    }
    for (uint32_t leaf = 0; leaf < t->leaves; leaf++)
        ck_assert_uint_eq(f.active[leaf], leaf);
    free(kill);
    free(f.active);
}

static int compare_triangles(const void *a, const void *b) {
    return memcmp(a, b, 9 * sizeof(float));
}

/* Positions of the corners, turned so that the smallest comes first: the cyclic order stays. */
static void triangle_key(const float *position, const uint32_t *c, float key[9]) {
    int first = 0;
    for (int i = 1; i < 3; i++)
        if (memcmp(&position[3 * c[i]], &position[3 * c[first]], 12) < 0)
            first = i;
    for (int i = 0; i < 3; i++)
        memcpy(&key[3 * i], &position[3 * c[(first + i) % 3]], 12);
}

static void check_full(const mn_mesh *mesh, const mn_tree *t) {
    ck_assert_uint_eq(t->triangles, mesh->triangles);
    float(*in)[9] = malloc(mesh->triangles * sizeof *in);
    float(*out)[9] = malloc(mesh->triangles * sizeof *out);
    uint32_t count = 0;
    for (uint32_t i = 0; i < mesh->triangles; i++)
        triangle_key(mesh->position, &mesh->corner[3 * i], in[i]);
    for (uint32_t x = 0; x < t->simplices; x++)
        if (t->corner[3 * x + 2] != MN_NONE)
            triangle_key(t->leaf_position, &t->corner[3 * x], out[count++]);
    ck_assert_uint_eq(count, mesh->triangles);
    qsort(in, count, sizeof *in, compare_triangles);
    qsort(out, count, sizeof *out, compare_triangles);
    ck_assert_mem_eq(in, out, count * sizeof *in);
    free(in);
    free(out);
}

/* cells: 0: all at once. */
static void check_model(model m, mn_metric metric, uint32_t cells) {
    mn_status st = {0};
    mn_tree tree;
    mn_simplify_desc desc = {.metric = metric, .cell_vertices = cells};
    ck_assert_msg(mn_simplify(&m.mesh, &desc, &tree, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_tree_check(&tree, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(tree.inner, m.mesh.vertices - 1);
    if (cells == 0 || cells > 100) /* in tiny cells all is put off, and at last done all the same */
        ck_assert_uint_eq(tree.counts.order_violations, 0);
    check_full(&m.mesh, &tree);
    check_fronts(&tree, m.closed);
    mn_tree_free(&tree);
    free_model(&m);
}

static model (*const makers[])(void) = {tetrahedron,  torus,     globe,      lone_triangles,
                                        one_triangle, zero_area, many_parts, fins,
                                        bow_tie,      book};

static const uint32_t cells[] = {0, 1, 20, 1000};
enum { CELLS = sizeof cells / sizeof cells[0] };

START_TEST(every_kind_of_mesh) {
    for (int i = 0; i < CELLS; i++) {
        check_model(makers[_i](), MN_METRIC_QEM, cells[i]);
        check_model(makers[_i](), MN_METRIC_LENGTH, cells[i]);
    }
}
END_TEST

START_TEST(open_sheet) {
    for (int i = 0; i < CELLS; i++) {
        check_model(sheet(8), MN_METRIC_QEM, cells[i]);
        check_model(sheet(8), MN_METRIC_LENGTH, cells[i]);
    }
}
END_TEST

static void check_same(const mn_tree *a, const mn_tree *b) {
    ck_assert_uint_eq(a->inner, b->inner);
    ck_assert_uint_eq(a->simplices, b->simplices);
    ck_assert_uint_eq(a->legal_last, b->legal_last);
    ck_assert_mem_eq(a->leaf_position, b->leaf_position, a->leaves * 3 * sizeof(float));
    ck_assert_mem_eq(a->left, b->left, a->inner * sizeof *a->left);
    ck_assert_mem_eq(a->right, b->right, a->inner * sizeof *a->right);
    ck_assert_mem_eq(a->switch_value, b->switch_value, a->inner * sizeof *a->switch_value);
    ck_assert_mem_eq(a->radius, b->radius, a->inner * sizeof *a->radius);
    ck_assert_mem_eq(a->cone, b->cone, a->inner * sizeof *a->cone);
    ck_assert_mem_eq(a->corner, b->corner, a->simplices * 3 * sizeof *a->corner);
}

static void scale(float *x, size_t count, int exponent) {
    for (size_t i = 0; i < count; i++)
        x[i] = ldexpf(x[i], exponent);
}

/* The unit of length is nobody's business: the same tree in nanometres and in light years. */
START_TEST(a_model_in_any_unit) {
    static const int exponents[] = {-100, -60, -30, 20, 40, 55};
    model m = sheet(20);
    mn_tree first, other;
    mn_status st = {0};
    mn_simplify_desc desc = {.metric = (mn_metric)(_i % 2), .cell_vertices = _i < 2 ? 0 : 100};
    m.mesh.grid_step = 0x1p-23f;
    ck_assert_msg(mn_simplify(&m.mesh, &desc, &first, &st) == MN_OK, "%s", st.text);
    for (size_t i = 0; i < sizeof exponents / sizeof exponents[0]; i++) {
        model scaled = sheet(20);
        scale(scaled.mesh.position, 3 * (size_t)scaled.mesh.vertices, exponents[i]);
        scaled.mesh.grid_step = ldexpf(m.mesh.grid_step, exponents[i]);
        ck_assert_msg(mn_simplify(&scaled.mesh, &desc, &other, &st) == MN_OK, "%s", st.text);
        ck_assert_float_eq(other.grid_step, scaled.mesh.grid_step);
        scale(other.leaf_position, 3 * (size_t)other.leaves, -exponents[i]);
        scale(other.switch_value, other.inner, -exponents[i]);
        scale(other.radius, other.inner, -exponents[i]);
        check_same(&first, &other);
        mn_tree_free(&other);
        free_model(&scaled);
    }
    mn_tree_free(&first);
    free_model(&m);
}
END_TEST

/* The tree is the mesh's and the cells', not the threads' or the memory's. */
START_TEST(rounds_are_the_same_in_any_number_of_threads) {
    model m = _i == 0 ? sheet(60) : fins();
    mn_tree first, other;
    mn_status st = {0};
    mn_simplify_desc desc = {.cell_vertices = _i == 0 ? 200 : 9, .threads = 1};
    ck_assert_msg(mn_simplify(&m.mesh, &desc, &first, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_gt(first.counts.rounds, 3);
    for (desc.threads = 2; desc.threads <= 5; desc.threads++) {
        desc.ram_bytes = (uint64_t)desc.threads << 22;
        ck_assert_msg(mn_simplify(&m.mesh, &desc, &other, &st) == MN_OK, "%s", st.text);
        check_same(&first, &other);
        mn_tree_free(&other);
    }
    mn_tree_free(&first);
    free_model(&m);
}
END_TEST

static double distance_of(const mn_mesh *mesh, uint32_t cell_vertices, uint32_t triangles) {
    mn_simplify_desc desc = {.cell_vertices = cell_vertices};
    mn_extract_desc part = {.what = MN_EXTRACT_TRIANGLES, .triangles = triangles};
    mn_compare_result result;
    mn_status st = {0};
    mn_tree tree;
    mn_mesh out;
    ck_assert_msg(mn_simplify(mesh, &desc, &tree, &st) == MN_OK, "%s", st.text);
    ck_assert((tree.counts.rounds > 2) == (cell_vertices > 0));
    ck_assert_msg(mn_tree_extract(&tree, &part, &out, NULL, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_mesh_compare(mesh, &out, 20000, 1, NULL, &result, &st) == MN_OK, "%s",
                  st.text);
    mn_mesh_free(&out);
    mn_tree_free(&tree);
    return result.rms;
}

/* At 50 and 10 % of the triangles; of so few, 2 % would be by chance. */
START_TEST(rounds_are_as_near_to_the_input) {
    model m = sheet(70);
    for (uint32_t part = 2; part <= 10; part += 8) {
        double whole = distance_of(&m.mesh, 0, m.mesh.triangles / part);
        double cut = distance_of(&m.mesh, 600, m.mesh.triangles / part);
        ck_assert_msg(cut <= 1.05 * whole, "1/%u: %g times", part, cut / whole);
    }
    free_model(&m);
}
END_TEST

/* What the whole says of the input, cells say together. */
START_TEST(rounds_count_edges_once) {
    model m = makers[_i]();
    mn_tree whole, cut;
    mn_status st = {0};
    mn_simplify_desc desc = {0};
    ck_assert_msg(mn_simplify(&m.mesh, &desc, &whole, &st) == MN_OK, "%s", st.text);
    desc.cell_vertices = 5;
    ck_assert_msg(mn_simplify(&m.mesh, &desc, &cut, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(whole.counts.boundary_edges, cut.counts.boundary_edges);
    ck_assert_uint_eq(whole.counts.nonmanifold_edges, cut.counts.nonmanifold_edges);
    ck_assert_uint_eq(whole.counts.components, cut.counts.components);
    mn_tree_free(&whole);
    mn_tree_free(&cut);
    free_model(&m);
}
END_TEST

static bool stop_at_third(void *context, const char *phase, uint64_t done, uint64_t total) {
    int *calls = context;
    (void)phase, (void)done, (void)total;
    return ++*calls < 3;
}

START_TEST(rounds_end_when_they_must) {
    model m = sheet(40);
    mn_tree tree;
    mn_status st = {0};
    int calls = 0;
    mn_simplify_desc desc = {
        .cell_vertices = 100, .threads = 3, .progress = stop_at_third, .progress_context = &calls};
    ck_assert_int_eq(mn_simplify(&m.mesh, &desc, &tree, &st), MN_FAILED);
    ck_assert_str_eq(st.text, "interrupted");
    ck_assert_mem_eq(&tree, &(mn_tree){0}, sizeof tree);
    st = (mn_status){0};
    desc = (mn_simplify_desc){.cell_vertices = 100, .temp_dir = "/nowhere/at/all"};
    ck_assert_int_eq(mn_simplify(&m.mesh, &desc, &tree, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "/nowhere/at/all"));
    free_model(&m);
}
END_TEST

START_TEST(twice_the_same_tree) {
    model m = fins();
    mn_tree a, b;
    mn_status st = {0};
    mn_simplify_desc desc = {0};
    ck_assert_int_eq(mn_simplify(&m.mesh, &desc, &a, &st), MN_OK);
    ck_assert_int_eq(mn_simplify(&m.mesh, &desc, &b, &st), MN_OK);
    ck_assert_uint_eq(a.inner, b.inner);
    ck_assert_mem_eq(a.left, b.left, a.inner * sizeof *a.left);
    ck_assert_mem_eq(a.switch_value, b.switch_value, a.inner * sizeof *a.switch_value);
    ck_assert_mem_eq(a.corner, b.corner, a.simplices * 3 * sizeof *a.corner);
    mn_tree_free(&a);
    mn_tree_free(&b);
    free_model(&m);
}
END_TEST

START_TEST(components_are_counted) {
    model m = many_parts();
    mn_tree t;
    mn_status st = {0};
    mn_simplify_desc desc = {0};
    ck_assert_int_eq(mn_simplify(&m.mesh, &desc, &t, &st), MN_OK);
    ck_assert_uint_eq(t.counts.components, 9);
    ck_assert_uint_eq(t.counts.collapses_by_stage[3], 8);
    ck_assert_uint_eq(t.counts.boundary_edges, 0);
    ck_assert_uint_eq(t.counts.nonmanifold_edges, 0);
    mn_tree_free(&t);
    free_model(&m);
}
END_TEST

START_TEST(lone_triangles_get_hinges) {
    model m = lone_triangles();
    mn_tree t;
    mn_status st = {0};
    mn_simplify_desc desc = {0};
    ck_assert_int_eq(mn_simplify(&m.mesh, &desc, &t, &st), MN_OK);
    ck_assert_uint_eq(t.simplices - t.triangles, 60); /* one each: nothing else joins the apex */
    mn_tree_free(&t);
    free_model(&m);
}
END_TEST

START_TEST(too_small_a_cap_names_one_that_does) {
    model m = torus();
    mn_tree t;
    mn_status st = {0};
    mn_simplify_desc desc = {.ram_bytes = 4096};
    ck_assert_int_eq(mn_simplify(&m.mesh, &desc, &t, &st), MN_CAP_TOO_SMALL);
    unsigned megabytes;
    ck_assert_msg(sscanf(strstr(st.text, "--ram"), "--ram %uM", &megabytes) == 1, "%s", st.text);
    desc.ram_bytes = (uint64_t)megabytes << 20;
    st = (mn_status){0};
    ck_assert_int_eq(mn_simplify(&m.mesh, &desc, &t, &st), MN_OK);
    mn_tree_free(&t);
    free_model(&m);
}
END_TEST

START_TEST(too_large_to_measure) {
    static const float far_away[] = {1e18f, 2e18f, 3e37f, INFINITY, NAN};
    for (size_t i = 0; i < sizeof far_away / sizeof far_away[0]; i++) {
        model m = torus();
        mn_tree t;
        mn_status st = {0};
        mn_simplify_desc desc = {0};
        m.mesh.position[31] = far_away[i];
        mn_code code = mn_simplify(&m.mesh, &desc, &t, &st);
        ck_assert_int_eq(code, i == 0 ? MN_OK : MN_BAD_INPUT);
        if (i > 0)
            ck_assert_ptr_nonnull(strstr(st.text, "vertex 10 "));
        mn_tree_free(&t);
        free_model(&m);
    }
}
END_TEST

static bool legal(model *m, uint32_t r, uint32_t k) {
    mn_status st = {0};
    mni_surface s;
    mni_judge j;
    ck_assert_int_eq(mni_surface_open(&s, &m->mesh, &st), MN_OK);
    ck_assert_int_eq(mni_judge_open(&j, &s, &st), MN_OK);
    bool answer = mni_judge_link(&j, &s, r, k);
    mni_judge_close(&j);
    mni_surface_close(&s);
    return answer;
}

START_TEST(link_condition) {
    model m = tetrahedron();
    ck_assert(!legal(&m, 0, 1)); /* a closed tetrahedron stays */
    free_model(&m);
    m = one_triangle();
    ck_assert(legal(&m, 0, 1)); /* an ear: both edges singular, one triangle each */
    free_model(&m);
    m = sheet(3);
    ck_assert(legal(&m, 5, 6));  /* inside */
    ck_assert(legal(&m, 5, 1));  /* from inside to the boundary */
    ck_assert(!legal(&m, 1, 5)); /* not from the boundary inwards */
    ck_assert(legal(&m, 1, 2));  /* along the boundary */
    free_model(&m);
    m = bow_tie();
    ck_assert(!legal(&m, 0, 1)); /* the tip joins two fans */
    free_model(&m);
    m = book();
    ck_assert(!legal(&m, 0, 2)); /* the spine is on 51 singular edges */
    ck_assert(legal(&m, 2, 0));  /* a page's tip: two edges of one triangle each */
    free_model(&m);
}
END_TEST

/* Whether each alive simplex is on the list of each of its vertices once, and nothing else is. */
static bool lists_are_whole(mni_surface *s) {
    uint64_t listed = 0, corners = 0, wrong = 0;
    for (uint32_t v = 0; v < s->vertices; v++) {
        uint32_t count;
        const uint32_t *list = mni_surface_fan(s, v, &count);
        for (uint32_t i = 0; i < count; i++) {
            const uint32_t *c = s->simplex[list[i]].v;
            wrong += c[0] != v && c[1] != v && c[2] != v;
            for (uint32_t j = 0; j < i; j++)
                wrong += list[i] == list[j];
        }
        listed += count;
    }
    for (uint32_t x = 0; x < s->simplices; x++)
        if (s->simplex[x].killed == MN_NONE)
            corners += s->simplex[x].v[2] == MN_NONE ? 2 : 3;
    return wrong == 0 && listed == corners;
}

START_TEST(packing_at_any_moment) {
    for (uint32_t free_places = 0; free_places < 40; free_places++) {
        model m = makers[_i]();
        mn_status st = {0};
        mni_surface s;
        ck_assert_int_eq(mni_surface_open(&s, &m.mesh, &st), MN_OK);
        for (uint32_t made = 0, x = 0; x < s.simplices; x++) {
            if (s.simplex[x].killed != MN_NONE)
                continue;
            if (s.pool_used + free_places < s.pool_room)
                s.pool_room = s.pool_used + free_places; /* what is left fills up soon */
            if (!mni_surface_collapse(&s, s.simplex[x].v[1], s.simplex[x].v[0], made++) ||
                !lists_are_whole(&s))
                ck_abort_msg("collapse %u of %u in %u free places", made, x, free_places);
        }
        ck_assert_uint_eq(s.alive_triangles + s.alive_hinges, 0);
        mni_surface_close(&s);
        free_model(&m);
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("simplify");
    TCase *tc = tcase_create("simplify");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, every_kind_of_mesh, 0, (int)(sizeof makers / sizeof makers[0]));
    tcase_add_loop_test(tc, packing_at_any_moment, 0, (int)(sizeof makers / sizeof makers[0]));
    tcase_add_test(tc, open_sheet);
    tcase_add_loop_test(tc, a_model_in_any_unit, 0, 4);
    tcase_add_loop_test(tc, rounds_are_the_same_in_any_number_of_threads, 0, 2);
    tcase_add_loop_test(tc, rounds_count_edges_once, 0, (int)(sizeof makers / sizeof makers[0]));
    tcase_add_test(tc, rounds_are_as_near_to_the_input);
    tcase_add_test(tc, rounds_end_when_they_must);
    tcase_add_test(tc, twice_the_same_tree);
    tcase_add_test(tc, components_are_counted);
    tcase_add_test(tc, lone_triangles_get_hinges);
    tcase_add_test(tc, too_small_a_cap_names_one_that_does);
    tcase_add_test(tc, too_large_to_measure);
    tcase_add_test(tc, link_condition);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
