/* Goal: from a history on disk come the rows that the same tree has in memory, byte for byte,
 * whatever the memory and the threads.
 * Method: histories by lot (random trees, chains, stages, nodes with very many simplices), ordered
 * within several budgets, compared with mni_history_tree; writes that fail, one after the other. */
#include <check.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "block.h"
#include "order.h"
#include "rowpack.h"
#include "suite.h"
#include "tree.h"
#include "tree_fixture.h"

typedef struct model {
    mn_mesh mesh;
    mni_extmesh external;
    mni_history history;
    uint32_t *vertex_of;
} model;

typedef enum shape { RANDOM, CHAIN, BALANCED, STAR } shape;

/* ---- histories by lot ------------------------------------------------------------------------ */

typedef struct node {
    uint32_t node, leaves, split, levels, leaf; /* some leaf below it */
    float value, key;
} node;

static node *make_leaves(uint32_t count, bool shuffled, uint64_t *state) {
    node *n = malloc(count * sizeof *n);
    for (uint32_t i = 0; i < count; i++)
        n[i] = (node){.node = i, .leaves = 1, .levels = 1, .leaf = i};
    for (uint32_t i = count; shuffled && i > 1; i--) {
        uint32_t other = fixture_random(state) % i;
        node swap = n[i - 1];
        n[i - 1] = n[other];
        n[other] = swap;
    }
    return n;
}

static mni_cell_collapse join(node *a, node b, uint32_t number, uint32_t simplices,
                              uint64_t *state) {
    float least = a->key > b.key ? a->key : b.key;
    /* few different keys, so that ties are many */
    float key = least + (float)(fixture_random(state) % 4) / 4;
    mni_cell_collapse c = {.left = a->node,
                           .right = b.node,
                           .left_value = a->value,
                           .right_value = b.value,
                           .key = key,
                           .left_leaves = a->leaves,
                           .right_leaves = b.leaves,
                           .left_split = a->split,
                           .right_split = b.split,
                           .simplices = simplices};
    c.bounds.radius = mni_radius_up((float)(fixture_random(state) % 1000));
    c.bounds.cone.axis[0] = (int8_t)fixture_random(state);
    c.bounds.cone.angle = (uint8_t)fixture_random(state);
    *a = (node){.node = MNI_COLLAPSE + number,
                .leaves = a->leaves + b.leaves,
                .split = a->leaves,
                .levels = 1 + (a->levels > b.levels ? a->levels : b.levels),
                .leaf = fixture_random(state) % 2 ? a->leaf : b.leaf,
                .value = (a->value > b.value ? a->value : b.value) + (float)(number % 3) / 7,
                .key = key};
    return c;
}

/* Of left, right and outside one leaf each; the third outside, or none. */
static void end_simplex(uint32_t (*killed)[3], node left, node right, uint32_t outside,
                        uint64_t *state) {
    uint32_t first = fixture_random(state) % 3, c[3] = {left.leaf, right.leaf, outside};
    if (fixture_random(state) % 2)
        c[0] = right.leaf, c[1] = left.leaf;
    for (uint32_t k = 0; k < 3; k++)
        (*killed)[outside == MN_NONE ? k : (first + k) % 3] = c[k];
}

/* Which two become one next. */
static void choose(shape s, uint32_t left, uint64_t *state, uint32_t *a, uint32_t *b) {
    *a = 0;
    *b = left - 1;
    if (s == RANDOM) {
        *a = fixture_random(state) % left;
        *b = (*a + 1 + fixture_random(state) % (left - 1)) % left;
    } else if (s == BALANCED) { /* those that have waited longest; a queue turned by the caller */
        *b = 1;
    }
}

static void make_history(model *m, shape s, uint32_t leaves, uint32_t many, uint64_t *state) {
    mn_status st = {0};
    node *n = make_leaves(leaves, s != CHAIN, state);
    mni_cell_collapse *c = calloc(leaves, sizeof *c);
    uint32_t(*killed)[3] = malloc((4 * (size_t)leaves + many) * sizeof *killed), count = 0;
    for (uint32_t left = leaves, i = 0; left > 1; left--, i++) {
        uint32_t a, b, here = fixture_random(state) % 4;
        choose(s, left, state, &a, &b);
        if (s == STAR && fixture_random(state) % 2) { /* b kept, a gone */
            node swap = n[a];
            n[a] = n[b];
            n[b] = swap;
        }
        node x = n[a], y = n[b];
        if (i == leaves / 2)
            here += many;
        for (uint32_t k = 0; k < here; k++) {
            uint32_t other = fixture_random(state) % left;
            bool hinge = other == a || other == b || left < 3;
            end_simplex(&killed[count++], x, y, hinge ? MN_NONE : n[other].leaf, state);
        }
        c[i] = join(&n[a], y, i, here, state);
        n[b] = n[left - 1];
        if (s == BALANCED && left > 2) { /* to the queue's end */
            node made = n[0];
            memmove(n, n + 1, (left - 2) * sizeof *n);
            n[left - 2] = made;
        }
    }
    ck_assert(mni_history_open(&m->history, ".", false, &st) == MN_OK);
    mni_cell cell = {
        .collapse = c, .collapses = leaves - 1, .killed = killed, .killed_count = count};
    uint32_t rest = leaves - 1;
    for (int stage = 0; stage < 3; stage++) {
        uint32_t part = stage == 1 ? 0 : rest / 2; /* one has none */
        cell.s.counts.collapses_by_stage[stage] = part;
        rest -= part;
    }
    cell.s.counts.collapses_by_stage[3] = rest;
    ck_assert(mni_history_add(&m->history, &cell, &st) == MN_OK);
    ck_assert(mni_history_end(&m->history, &st) == MN_OK);
    m->history.root_value = n[0].value;
    m->history.root_levels = n[0].levels;
    free(n);
    free(c);
    free(killed);
}

/* Stages are by number, and keys of a later one may be lower: nothing is lost by that, for a later
 * stage comes later. */
static void make_model(model *m, shape s, uint32_t leaves, uint32_t many, bool colors,
                       uint64_t *state) {
    memset(m, 0, sizeof *m);
    mn_mesh *mesh = &m->mesh;
    *mesh = (mn_mesh){.vertices = leaves, .grid_step = 1};
    mesh->position = malloc(3 * sizeof(float) * leaves);
    mesh->color = colors ? malloc(sizeof(uint32_t) * leaves) : NULL;
    m->vertex_of = malloc(sizeof(uint32_t) * leaves);
    m->external = (mni_extmesh){.vertex.fd = -1,
                                .triangle.fd = -1,
                                .vertices = leaves,
                                .grid_step = 1,
                                .has_colors = colors};
    mn_status st = {0};
    ck_assert(mni_spill_open(&m->external.vertex, ".", &st) == MN_OK);
    for (uint32_t v = 0; v < leaves; v++) {
        mni_extvertex record = {.rgba = fixture_random(state)};
        for (int i = 0; i < 3; i++)
            mesh->position[3 * (size_t)v + i] = record.position[i] =
                v % 100 == 0 ? -0.0f : (float)(fixture_random(state) % 1000);
        if (colors)
            mesh->color[v] = record.rgba;
        m->vertex_of[v] = v;
        mni_spill_append(&m->external.vertex, &record, sizeof record);
    }
    make_history(m, s, leaves, many, state);
}

static void drop(model *m) {
    mn_mesh_free(&m->mesh);
    mni_spill_close(&m->external.vertex);
    mni_history_close(&m->history);
    free(m->vertex_of);
}

/* ---- comparing ------------------------------------------------------------------------------- */

typedef struct comparison {
    mni_rows *rows;
    uint32_t at[MNI_SECTIONS];
} comparison;

static mn_code compare(void *context, int section, const void *bytes, size_t count) {
    comparison *c = context;
    const size_t each = section == MNI_ROWS ? sizeof(mni_row) : sizeof(mni_row_simplex);
    const uint32_t from = c->at[section], to = from + (uint32_t)(count / each);
    unsigned char *there = malloc(count);
    ck_assert(mni_rows_copy(c->rows, section == MNI_SIMPLICES, from, to, there));
    ck_assert_msg(memcmp(there, bytes, count) == 0, "section %d differs behind item %u", section,
                  from);
    c->at[section] = to;
    free(there);
    return MN_OK;
}

static void check_ordered(model *m, const mn_tree *tree, uint64_t work_bytes, uint32_t threads) {
    mn_status st = {0};
    mni_ordered ordered;
    uint64_t sum[MNI_SECTIONS];
    mni_order_desc desc = {.work_bytes = work_bytes, .temp_dir = ".", .threads = threads};
    ck_assert_msg(mni_order(&m->history, &m->external, &desc, &ordered, &st) == MN_OK, "%s",
                  st.text);
    ck_assert(mni_tree_rows_sums(tree, sum, &st) == MN_OK);
    mni_rows_source source = {.rows = tree->leaves,
                              .simplices = tree->simplices,
                              .fd = ordered.file.fd,
                              .grid_step = m->mesh.grid_step};
    source.places_offset =
        ordered.file.size_bytes - 8 * mni_rowpack_places(source.rows, source.simplices);
    mni_rows rows;
    ck_assert(mni_rows_open(&rows, &source, 1 << 20, &st) == MN_OK);
    comparison c = {.rows = &rows};
    ck_assert(mni_tree_rows(tree, compare, &c, &st) == MN_OK);
    ck_assert_uint_eq(c.at[MNI_ROWS], tree->leaves);
    ck_assert_uint_eq(c.at[MNI_SIMPLICES], tree->simplices);
    mni_rows_close(&rows);
    ck_assert_mem_eq(sum, ordered.sum, sizeof sum);
    ck_assert_uint_ge(ordered.bytes_written, ordered.file.size_bytes);
    if (work_bytes == 0) /* nothing but the history, the vertices and the result is on disk */
        ck_assert_uint_le(ordered.bytes_written, ordered.file.size_bytes + 3 * tree->leaves + 64);
    mni_spill_close(&ordered.file);
}

static void check_model(model *m) {
    mn_status st = {0};
    mn_tree tree;
    ck_assert_msg(mni_history_tree(&m->history, &m->mesh, m->vertex_of, &tree, &st) == MN_OK, "%s",
                  st.text);
    uint64_t least = mni_order_work_min(m->mesh.vertices);
    for (uint32_t threads = 1; threads <= 2; threads++) { /* two where there is room */
        check_ordered(m, &tree, 0, threads);
        check_ordered(m, &tree, least, threads);
        check_ordered(m, &tree, least + least / 3, threads);
        check_ordered(m, &tree, 4 * least, threads);
    }
    mn_tree_free(&tree);
}

START_TEST(rows_are_those_of_the_tree_in_memory) {
    static const struct {
        shape shape;
        uint32_t leaves, many;
        bool colors;
    } kind[] = {
        {RANDOM, 2, 0, false},      {RANDOM, 3, 0, true},      {RANDOM, 4096, 0, false},
        {RANDOM, 4097, 0, false},   {RANDOM, 4098, 700, true}, {CHAIN, 10000, 0, false},
        {BALANCED, 16384, 0, true}, {STAR, 30000, 0, false},   {RANDOM, 60000, 40000, false}};
    uint64_t state = fixture_seed(31 + (uint64_t)_i);
    model m;
    make_model(&m, kind[_i].shape, kind[_i].leaves, kind[_i].many, kind[_i].colors, &state);
    check_model(&m);
    drop(&m);
}
END_TEST

/* ---- trouble --------------------------------------------------------------------------------- */

START_TEST(a_disk_that_fills) {
    uint64_t state = fixture_seed(41);
    model m;
    mni_ordered ordered;
    struct rlimit limit;
    uint32_t failures = 0;
    mn_code code = MN_NO_SPACE;
    make_model(&m, RANDOM, 30000, 0, false, &state);
    signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &limit);
    mni_order_desc desc = {.work_bytes = 2 * mni_order_work_min(30000) * (uint64_t)_i +
                                         mni_order_work_min(30000),
                           .temp_dir = ".",
                           .threads = 1 + (uint32_t)_i};
    for (rlim_t bytes = 0; code != MN_OK; bytes += 40000, failures++) {
        mn_status st = {0};
        limit.rlim_cur = bytes;
        setrlimit(RLIMIT_FSIZE, &limit);
        code = mni_order(&m.history, &m.external, &desc, &ordered, &st);
        limit.rlim_cur = RLIM_INFINITY;
        setrlimit(RLIMIT_FSIZE, &limit);
        ck_assert_msg(code == MN_OK || code == MN_NO_SPACE, "%d: %s", code, st.text);
        ck_assert(code == MN_OK || strstr(st.text, "--temp-dir") != NULL);
        ck_assert(code == MN_OK || ordered.file.fd == -1);
    }
    ck_assert_uint_gt(failures, _i == 0 ? 20 : 10);
    mni_spill_close(&ordered.file);
    drop(&m);
}
END_TEST

static bool stop_at(void *context, const char *phase, uint64_t done, uint64_t total) {
    uint32_t *left = context;
    ck_assert_str_eq(phase, "order");
    ck_assert_uint_le(done, total);
    return (*left)-- > 0;
}

START_TEST(it_stops_when_asked_to) {
    uint64_t state = fixture_seed(43);
    model m;
    mni_ordered ordered;
    make_model(&m, RANDOM, 30000, 0, false, &state);
    mn_code code = MN_FAILED;
    for (uint32_t after = 0; code != MN_OK; after++) {
        uint32_t left = after;
        mn_status st = {0};
        mn_watch watch = {stop_at, &left};
        mni_order_desc desc = {
            .work_bytes = 2 << 20, .temp_dir = ".", .threads = 1 + (uint32_t)_i, .watch = &watch};
        code = mni_order(&m.history, &m.external, &desc, &ordered, &st);
        ck_assert(code == MN_OK || strstr(st.text, "interrupted") != NULL);
        ck_assert(code != MN_OK || after > 5);
    }
    mni_spill_close(&ordered.file);
    drop(&m);
}
END_TEST

START_TEST(memory_grows_as_the_square_root) {
    uint64_t before = mni_order_work_min(2);
    for (uint64_t n = 1000; n < UINT64_C(1) << 31; n *= 4) {
        uint64_t need = mni_order_work_min(n);
        ck_assert_uint_ge(need, before);
        ck_assert_uint_le(need, 3 * before);
        before = need;
    }
    ck_assert_uint_le(mni_order_work_min(10000000), 4 << 20);
    ck_assert_uint_le(mni_order_work_min(UINT64_C(1) << 31), 96 << 20);
}
END_TEST

int main(void) {
    Suite *s = suite_create("order");
    TCase *t = tcase_create("order");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, rows_are_those_of_the_tree_in_memory, 0, 9);
    tcase_add_loop_test(t, a_disk_that_fills, 0, 2); /* threads, less one */
    tcase_add_loop_test(t, it_stops_when_asked_to, 0, 2);
    tcase_add_test(t, memory_grows_as_the_square_root);
    suite_add_tcase(s, t);
    return suite_run(s);
}
