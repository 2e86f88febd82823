/* Goal: a .vdt says what the tree says, row by row, whatever the tree's shape.
 * Method: trees by lot, forests, chains and single vertices written and read back; rows compared
 * with what each node is by its definition. */
#include <check.h>
#include <float.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "block.h"
#include "disk_help.h"
#include "rounds.h"
#include "suite.h"
#include "tree.h"
#include "tree_fixture.h"
#include "vdt_header.h"
#include "walk.h"

/* A walk over the file: the rows and simplices of the tree, from `from` on all of those nodes. */
typedef struct walked {
    const mn_tree *tree;
    uint32_t next_row, nodes, simplices, node, from;
} walked;

static mn_code see_row(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    walked *w = context;
    const mn_tree *t = w->tree;
    ck_assert(w->from > 0 || at == w->next_row);
    ck_assert_uint_ge(at, w->next_row);
    w->next_row = at + 1;
    w->node = child == NULL ? MN_NONE : row->order - t->leaves;
    ck_assert(memcmp(t->leaf_position + 3 * (size_t)at, row->position, 12) == 0);
    if (child == NULL)
        return MN_OK;
    w->nodes += row->order >= w->from;
    ck_assert_uint_eq(t->leaf_mid[w->node], at);
    ck_assert_uint_eq(t->leaf_lo[w->node], row->leaf_lo);
    ck_assert_uint_eq(t->leaf_hi[w->node], row->leaf_hi);
    ck_assert_uint_eq(t->left[w->node], child[0]);
    ck_assert_uint_eq(t->right[w->node], child[1]);
    return MN_OK;
}

static mn_code see_simplex(void *context, const mni_row_simplex *simplex) {
    walked *w = context;
    (void)simplex;
    w->simplices += w->tree->leaves + w->node >= w->from;
    return MN_OK;
}

static bool is_late(const void *context, uint32_t order) {
    return order >= ((const walked *)context)->from;
}

static void walk_through(const char *path, const mn_tree *tree) {
    mni_walked file;
    mn_status st = {0};
    ck_assert_msg(mni_walked_open(&file, path, NULL, &st) == MN_OK, "%s", st.text);
    ck_assert(file.has_colors == (tree->leaf_color != NULL) && file.blocks == 0);
    for (uint32_t part = 0; part <= 16; part += 4) {
        const uint32_t made = part == 0 ? 0 : tree->inner - tree->inner / part;
        walked w = {.tree = tree, .from = part == 0 ? 0 : tree->leaves + made};
        const mni_walk_sink sink = {see_row, see_simplex, &w};
        const mni_walk_desc desc = {.wanted = part == 0 ? NULL : is_late};
        ck_assert_msg(mni_walk_file(&file, &desc, &sink, &st) == MN_OK, "%s", st.text);
        ck_assert_uint_eq(w.nodes, tree->inner - made);
        ck_assert_uint_eq(w.simplices, tree->simplices - tree->simplex_start[made]);
        ck_assert(part > 0 || w.next_row == tree->leaves);
    }
    mni_walked_close(&file);
}

static void round_trip(const mn_tree *tree) {
    const char *path = fixture_path("round.vdt");
    mn_status st = {0};
    mn_tree back;
    ck_assert_msg(mn_tree_write(path, tree, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_tree_read(path, &back, &st) == MN_OK, "%s", st.text);
    fixture_same(tree, &back);
    ck_assert(memcmp(&tree->intake, &back.intake, sizeof back.intake) == 0);
    ck_assert_uint_eq(tree->counts.components, back.counts.components);
    ck_assert_uint_eq(tree->counts.rounds, back.counts.rounds);
    mn_tree_free(&back);
    walk_through(path, tree);
}

/* What a header says of the order: the bound is never less, and hardly more. */
static void order_is_kept(const mn_tree *tree) {
    static const float bounds[] = {0, 1, 1.0625f, 3.1415927f, 255.99f, 1e30f, FLT_MAX};
    const char *path = fixture_path("order.vdt");
    for (size_t i = 0; i < sizeof bounds / sizeof bounds[0]; i++) {
        mn_status st = {0};
        mn_tree of = *tree, back;
        of.counts.order_violations = UINT32_MAX - i;
        of.counts.order_unknown = UINT32_MAX / 2 + i;
        of.counts.order_violation_bound = of.counts.order_violation_worst = bounds[i];
        ck_assert_msg(mn_tree_write(path, &of, &st) == MN_OK, "%s", st.text);
        ck_assert_msg(mn_tree_read(path, &back, &st) == MN_OK, "%s", st.text);
        ck_assert_uint_eq(back.counts.order_violations, of.counts.order_violations);
        ck_assert_uint_eq(back.counts.order_unknown, of.counts.order_unknown);
        ck_assert(back.counts.order_violation_worst == bounds[i]);
        ck_assert(back.counts.order_violation_bound >= bounds[i]);
        ck_assert((double)back.counts.order_violation_bound <= (double)bounds[i] * 1.01);
        mn_tree_free(&back);
    }
}

/* A forest by lot: so many roots, of which some are lone leaves; all in one place. */
typedef enum shape { BY_LOT = 0, TO_THE_RIGHT, TO_THE_LEFT } shape;
static void forest(uint32_t leaves, uint32_t roots, shape kind, uint64_t *state, mn_tree *t) {
    mn_status st = {0};
    uint32_t *node = malloc(leaves * sizeof *node);
    ck_assert(mni_tree_alloc(t, leaves, roots, 0, false, &st) == MN_OK);
    for (uint32_t i = 0; i < leaves; i++)
        node[i] = i;
    for (uint32_t left = leaves, i = 0; left > roots; left--, i++) { /* neighbours become one */
        uint32_t at = kind == TO_THE_RIGHT  ? left - 2
                      : kind == TO_THE_LEFT ? 0
                                            : fixture_random(state) % (left - 1);
        t->left[i] = node[at];
        t->right[i] = node[at + 1];
        t->switch_value[i] = 2048;
        t->cone[i].angle = MN_CONE_NO_BOUND;
        node[at] = leaves + i;
        memmove(node + at + 1, node + at + 2, (left - at - 2) * sizeof *node);
    }
    t->legal_last = leaves + t->inner - 1;
    free(node);
    ck_assert_msg(mni_tree_derive(t, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_tree_check(t, &st) == MN_OK, "%s", st.text);
}

START_TEST(any_shape_comes_back) {
    uint64_t state = fixture_seed(23);
    mn_mesh mesh;
    mn_tree tree;
    static const uint32_t size[][2] = {{1, 1},    {2, 2},    {2, 1},       {3, 2},     {5, 1},
                                       {1024, 1}, {1025, 7}, {3000, 2999}, {3000, 128}};
    for (size_t i = 0; i < sizeof size / sizeof *size; i++) {
        forest(size[i][0], size[i][1], BY_LOT, &state, &tree);
        round_trip(&tree);
        mn_tree_free(&tree);
    }
    for (shape s = TO_THE_RIGHT; s <= TO_THE_LEFT; s++) {
        forest(10000, 1, s, &state, &tree);
        ck_assert_uint_eq(tree.depth_max, 10000);
        round_trip(&tree);
        mn_tree_free(&tree);
    }
    for (int kind = 0; kind < 3; kind++) {
        if (kind < 2)
            fixture_sheet(40, 3, kind == 1, &mesh);
        else
            fixture_book(700, &mesh);
        fixture_random_tree(&mesh, fixture_random(&state), &tree);
        round_trip(&tree);
        mn_tree_free(&tree);
        fixture_tree(&mesh, &tree);
        round_trip(&tree);
        order_is_kept(&tree);
        mn_tree_free(&tree);
        mn_mesh_free(&mesh);
    }
}
END_TEST

/* The way down takes memory: a cap that has too little is refused with one that does. */
START_TEST(a_deep_file_is_walked_within_a_cap) {
    uint64_t state = 1;
    char path[128];
    mn_tree tree;
    mn_status st = {0};
    mn_verify_result result;
    mn_verify_desc desc = {.ram_bytes = 4 << 20};
    snprintf(path, sizeof path, "%s", fixture_path("deep.vdt"));
    forest(40000, 1, TO_THE_LEFT, &state, &tree);
    ck_assert(mn_tree_write(path, &tree, &st) == MN_OK);
    ck_assert_int_eq(mn_verify(path, &desc, &result, &st), MN_CAP_TOO_SMALL);
    const char *named = strstr(st.text, "--ram ");
    ck_assert_msg(named != NULL, "%s", st.text);
    desc.ram_bytes = strtoull(named + 6, NULL, 10) << 20;
    st = (mn_status){0};
    ck_assert_msg(mn_verify(path, &desc, &result, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(result.nodes, 79999);
    mn_tree_free(&tree);
}
END_TEST

/* ---- rows ------------------------------------------------------------------------------------ */

typedef struct image {
    mni_row *row;
    mni_row_simplex *simplex;
    uint32_t rows, simplices;
} image;

static mn_code keep(void *context, int section, const void *bytes, size_t count) {
    image *im = context;
    if (section == MNI_ROWS) {
        ck_assert_uint_eq(im->simplices, 0); /* rows come first */
        memcpy(im->row + im->rows, bytes, count);
        im->rows += (uint32_t)(count / sizeof *im->row);
    } else {
        memcpy(im->simplex + im->simplices, bytes, count);
        im->simplices += (uint32_t)(count / sizeof *im->simplex);
    }
    return MN_OK;
}

START_TEST(rows_say_what_nodes_are) {
    mn_mesh mesh;
    mn_tree t;
    mn_status st = {0};
    image im = {0};
    fixture_sheet(40, 3, true, &mesh);
    fixture_random_tree(&mesh, fixture_seed(29), &t);
    im.row = malloc(t.leaves * sizeof *im.row);
    im.simplex = malloc(t.simplices * sizeof *im.simplex);
    ck_assert(mni_tree_rows(&t, keep, &im, &st) == MN_OK);
    ck_assert_uint_eq(im.rows, t.leaves);
    ck_assert_uint_eq(im.simplices, t.simplices);
    ck_assert_uint_eq(im.row[0].order, 0);
    for (uint32_t i = 0; i < t.inner; i++) {
        uint32_t at = t.leaf_mid[i], first = t.simplex_start[i];
        const mni_row *row = &im.row[at];
        uint32_t end = at + 1 < t.leaves ? row[1].simplex_start : t.simplices;
        ck_assert_uint_eq(row->order, t.leaves + i);
        ck_assert_uint_eq(row->leaf_lo, t.leaf_lo[i]);
        ck_assert_uint_eq(row->leaf_hi, t.leaf_hi[i]);
        ck_assert_uint_eq(row->rgba, t.leaf_color[at]);
        ck_assert_mem_eq(row->position, t.leaf_position + 3 * (size_t)at, 12);
        ck_assert(row->switch_value == t.switch_value[i] && row->radius == t.radius[i]);
        ck_assert_mem_eq(&row->cone, &t.cone[i], sizeof row->cone);
        if (row->left == MN_NONE)
            ck_assert_uint_eq(t.left[i], row->leaf_lo);
        else
            ck_assert_uint_eq(im.row[row->left].order, t.left[i]);
        if (row->right == MN_NONE)
            ck_assert_uint_eq(t.right[i], at);
        else
            ck_assert_uint_eq(im.row[row->right].order, t.right[i]);
        ck_assert_uint_eq(end - row->simplex_start, t.simplex_start[i + 1] - first);
        for (uint32_t s = row->simplex_start; s < end; s++) {
            const uint32_t *c = im.simplex[s].corner, *of = t.corner + 3 * (size_t)first++;
            uint32_t turn = 0;
            while (turn < 3 && of[turn] != c[0])
                turn++;
            for (uint32_t k = 0; k < 3; k++)
                ck_assert_uint_eq(c[k], of[(turn + k) % 3]);
            ck_assert(c[2] < t.leaf_lo[i] || c[2] >= t.leaf_hi[i]);
        }
    }
    free(im.row);
    free(im.simplex);
    mn_tree_free(&t);
    mn_mesh_free(&mesh);
}
END_TEST

/* The same model turned in its triangles has the same bytes; another corner makes another id. */
START_TEST(the_build_id_is_of_the_content) {
    mn_mesh mesh;
    mn_tree t;
    mn_status st = {0};
    uint64_t id, turned, changed;
    fixture_sheet(20, 3, false, &mesh);
    fixture_tree(&mesh, &t);
    ck_assert(mni_tree_build_id(&t, NULL, &id, &st) == MN_OK);
    for (uint32_t s = 0; s < t.simplices; s++) {
        uint32_t *c = t.corner + 3 * (size_t)s, first = c[0];
        if (c[2] == MN_NONE)
            continue;
        c[0] = c[1], c[1] = c[2], c[2] = first;
    }
    ck_assert(mni_tree_build_id(&t, NULL, &turned, &st) == MN_OK);
    ck_assert_uint_eq(id, turned);
    t.grid_step /= 2;
    ck_assert(mni_tree_build_id(&t, NULL, &changed, &st) == MN_OK);
    ck_assert_uint_ne(id, changed);
    t.grid_step *= 2;
    t.leaf_position[7] += t.grid_step;
    ck_assert(mni_tree_build_id(&t, NULL, &changed, &st) == MN_OK);
    ck_assert_uint_ne(id, changed);
    mn_tree_free(&t);
    mn_mesh_free(&mesh);
}
END_TEST

/* ---- trees that stay on disk ----------------------------------------------------------------- */

static void same_files(const char *a, const char *b) {
    char command[300];
    snprintf(command, sizeof command, "cmp -s %s %s", a, b);
    ck_assert_msg(system(command) == 0, "%s and %s differ", a, b);
}

static void write_sheet(const char *path, uint32_t n, bool colors) {
    mn_mesh mesh;
    mn_status st = {0};
    fixture_sheet(n, 3, colors, &mesh);
    ck_assert_msg(mn_mesh_write_ply(path, &mesh, &st) == MN_OK, "%s", st.text);
    mn_mesh_free(&mesh);
}

START_TEST(made_written_opened_and_blocked) {
    char in[128], made[128], again[128], from_made[128], from_file[128];
    mn_status st = {0};
    mn_vdt *vdt = NULL, *file = NULL;
    mn_verify_result result;
    mn_header header;
    mn_block_counts counts;
    snprintf(in, sizeof in, "%s", fixture_path("in.ply"));
    snprintf(made, sizeof made, "%s", fixture_path("made.vdt"));
    snprintf(again, sizeof again, "%s", fixture_path("again.vdt"));
    snprintf(from_made, sizeof from_made, "%s", fixture_path("made.mnt"));
    snprintf(from_file, sizeof from_file, "%s", fixture_path("file.mnt"));
    write_sheet(in, 30, _i == 1);
    mn_simplify_desc desc = {.temp_dir = "."};
    ck_assert_msg(mn_vdt_make(in, NULL, &desc, NULL, &vdt, &st) == MN_OK, "%s", st.text);
    const mn_tree *head = mn_vdt_head(vdt);
    ck_assert_uint_eq(head->leaves, 900);
    ck_assert_uint_eq(head->triangles, 2 * 29 * 29);
    ck_assert_uint_eq(head->roots, 1);
    ck_assert(head->leaf_position == NULL && head->left == NULL && head->corner == NULL);
    ck_assert_uint_gt(mn_vdt_figures_of(vdt)->read.bytes_read, 0);
    ck_assert_msg(mn_vdt_write(vdt, made, NULL, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_vdt_block(vdt, from_made, NULL, &header, &counts, &st) == MN_OK, "%s",
                  st.text);
    ck_assert_uint_eq(counts.bytes_written, header.file_bytes);
    ck_assert_msg(mn_vdt_open(made, NULL, &file, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(mn_vdt_head(file)->depth_max, head->depth_max);
    ck_assert_uint_eq(mn_vdt_head(file)->legal_last, head->legal_last);
    ck_assert_msg(mn_vdt_block(file, from_file, NULL, NULL, NULL, &st) == MN_OK, "%s", st.text);
    same_files(from_made, from_file);
    ck_assert_msg(mn_vdt_write(file, again, NULL, &st) == MN_OK, "%s", st.text);
    same_files(made, again);
    ck_assert_msg(mn_verify(from_made, NULL, &result, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_verify(made, NULL, &result, &st) == MN_OK, "%s", st.text);
    mn_vdt_close(vdt);
    mn_vdt_close(file);
}
END_TEST

static void make_some_tree(int kind, mn_tree *tree) {
    mn_mesh mesh;
    if (kind == 2)
        fixture_book(700, &mesh); /* overflows */
    else
        fixture_sheet(40, 5, kind == 1, &mesh);
    if (kind == 0)
        fixture_tree(&mesh, tree);
    else
        fixture_random_tree(&mesh, 7, tree); /* deep in parts, and no roots joined */
    mn_mesh_free(&mesh);
}

/* From a .mnt the same blocks as from the tree, however it was cut; under a small cap too. */
START_TEST(a_mnt_is_cut_again) {
    static const mn_block_desc cuts[] = {
        {.block_bytes = 4096},
        {.blocking = MN_BLOCKING_LEVELS, .l = 3},
        {.block_bytes = 16384, .zstd_level = 3},
    };
    enum { CUTS = sizeof cuts / sizeof cuts[0] };
    const mn_open_desc desc = {.ram_bytes = 10 << 20, .temp_dir = "."};
    char first[128], again[128], wanted[128];
    mn_tree tree;
    mn_status st = {0};
    snprintf(first, sizeof first, "%s", fixture_path("first.mnt"));
    snprintf(again, sizeof again, "%s", fixture_path("again.mnt"));
    snprintf(wanted, sizeof wanted, "%s", fixture_path("wanted.mnt"));
    make_some_tree(_i, &tree);
    for (int from = 0; from < CUTS; from++) {
        mn_vdt *vdt = NULL;
        ck_assert_msg(mn_block_write(first, &tree, &cuts[from], NULL, NULL, &st) == MN_OK, "%s",
                      st.text);
        ck_assert_msg(mn_vdt_open(first, &desc, &vdt, &st) == MN_OK, "%s", st.text);
        ck_assert(mn_vdt_has_colors(vdt) == (tree.leaf_color != NULL));
        ck_assert_uint_eq(mn_vdt_head(vdt)->depth_max, tree.depth_max);
        for (int to = 0; to < CUTS; to++) {
            ck_assert(mn_block_write(wanted, &tree, &cuts[to], NULL, NULL, &st) == MN_OK);
            ck_assert_msg(mn_vdt_block(vdt, again, &cuts[to], NULL, NULL, &st) == MN_OK, "%s",
                          st.text);
            same_files(wanted, again);
        }
        mn_vdt_close(vdt);
    }
    mn_tree_free(&tree);
}
END_TEST

/* Any byte of a .mnt that is another: it is not opened, or has no bearing on the rows. */
START_TEST(a_damaged_mnt_is_refused) {
    const uint64_t seed = fixture_seed(11);
    uint64_t state = seed;
    char good[128], bad[128];
    mn_tree tree;
    mn_status st = {0};
    mn_vdt *vdt = NULL;
    snprintf(good, sizeof good, "%s", fixture_path("good.mnt"));
    snprintf(bad, sizeof bad, "%s", fixture_path("bad.mnt"));
    make_some_tree(_i, &tree);
    ck_assert(mn_block_write(good, &tree, NULL, NULL, NULL, &st) == MN_OK);
    FILE *f = fopen(good, "rb");
    unsigned char *bytes = malloc(1 << 22);
    const size_t size = fread(bytes, 1, 1 << 22, f);
    fclose(f);
    for (int i = 0; i < 200; i++) {
        const size_t at = fixture_random(&state) % size, most = i % 4 == 0 ? at : size;
        bytes[at] ^= 0x10;
        f = fopen(bad, "wb");
        ck_assert(fwrite(bytes, 1, most, f) == most && fclose(f) == 0);
        bytes[at] ^= 0x10;
        st = (mn_status){0};
        const mn_code code = mn_vdt_open(bad, NULL, &vdt, &st);
        ck_assert_msg(code == MN_BAD_INPUT || code == MN_OK, "%s", st.text);
        ck_assert((code == MN_OK) == (vdt != NULL));
        if (code == MN_OK && mn_vdt_block(vdt, bad, NULL, NULL, NULL, &st) == MN_OK)
            same_files(good, bad);
        mn_vdt_close(vdt);
    }
    free(bytes);
    mn_tree_free(&tree);
}
END_TEST

START_TEST(a_mnt_is_opened_within_a_cap_and_a_disk) {
    char path[128];
    mn_tree tree;
    mn_status st = {0};
    mn_vdt *vdt = NULL;
    snprintf(path, sizeof path, "%s", fixture_path("capped.mnt"));
    make_some_tree(1, &tree);
    ck_assert(mn_block_write(path, &tree, NULL, NULL, NULL, &st) == MN_OK);
    mn_open_desc desc = {.ram_bytes = 1 << 20, .temp_dir = "."};
    ck_assert_int_eq(mn_vdt_open(path, &desc, &vdt, &st), MN_CAP_TOO_SMALL);
    const char *named = strstr(st.text, "--ram ");
    ck_assert_msg(vdt == NULL && named != NULL, "%s", st.text);
    desc.ram_bytes = strtoull(named + 6, NULL, 10) << 20;
    st = (mn_status){0};
    ck_assert_msg(mn_vdt_open(path, &desc, &vdt, &st) == MN_OK, "%s", st.text);
    mn_vdt_close(vdt);
    signal(SIGXFSZ, SIG_IGN);
    limit_files(100);
    ck_assert_int_eq(mn_vdt_open(path, &desc, &vdt, &st), MN_NO_SPACE);
    ck_assert_ptr_null(vdt);
    limit_files(RLIM_INFINITY);
    desc.temp_dir = "no such folder";
    st = (mn_status){0};
    ck_assert_int_eq(mn_vdt_open(path, &desc, &vdt, &st), MN_FAILED);
    mn_tree_free(&tree);
}
END_TEST

START_TEST(memory_and_threads_change_nothing) {
    static const uint64_t ram[] = {0, 16 << 20, 20 << 20, 64 << 20};
    char in[128], first[128], other[128];
    mn_status st = {0};
    snprintf(in, sizeof in, "%s", fixture_path("ram.ply"));
    snprintf(first, sizeof first, "%s", fixture_path("first.vdt"));
    snprintf(other, sizeof other, "%s", fixture_path("other.vdt"));
    write_sheet(in, 150, true);
    for (int i = 0; i < 4; i++) {
        mn_vdt *vdt;
        mn_simplify_desc desc = {.temp_dir = ".", .ram_bytes = ram[i], .threads = 1 + i % 2};
        ck_assert_msg(mn_vdt_make(in, NULL, &desc, NULL, &vdt, &st) == MN_OK, "%s", st.text);
        ck_assert_msg(mn_vdt_write(vdt, i == 0 ? first : other, NULL, &st) == MN_OK, "%s", st.text);
        if (i > 0)
            same_files(first, other);
        const mn_vdt_figures *f = mn_vdt_figures_of(vdt);
        ck_assert_uint_gt(f->read.bytes_written, 0);
        ck_assert_uint_gt(f->simplify.bytes_written, 0);
        ck_assert_uint_gt(f->order.bytes_written, 0);
        mn_vdt_close(vdt);
    }
}
END_TEST

/* With less than cells of the usual size take they are smaller, and no tree depends on more. */
START_TEST(four_megabytes_to_work_in) {
    static const mn_simplify_desc as[] = {{.work_bytes = 4 << 20},
                                          {.work_bytes = 4 << 20, .threads = 2},
                                          {.cell_vertices = MNI_CELL_VERTICES / 4, .threads = 2}};
    char in[128], first[128], other[128];
    mn_status st = {0};
    snprintf(in, sizeof in, "%s", fixture_path("little.ply"));
    snprintf(first, sizeof first, "%s", fixture_path("little.vdt"));
    snprintf(other, sizeof other, "%s", fixture_path("little2.vdt"));
    write_sheet(in, 150, false);
    for (int i = 0; i < 3; i++) {
        mn_vdt *vdt;
        mn_simplify_desc desc = as[i];
        desc.temp_dir = ".";
        ck_assert_msg(mn_vdt_make(in, NULL, &desc, NULL, &vdt, &st) == MN_OK, "%s", st.text);
        ck_assert_uint_gt(mn_vdt_head(vdt)->counts.rounds, 1);
        ck_assert_uint_eq(mn_vdt_head(vdt)->counts.order_violations, 0);
        ck_assert_msg(mn_vdt_write(vdt, i == 0 ? first : other, NULL, &st) == MN_OK, "%s", st.text);
        if (i > 0)
            same_files(first, other);
        mn_vdt_close(vdt);
    }
}
END_TEST

typedef struct stop_place {
    const char *phase;
    uint64_t after;
} stop_place;

static bool stop_in(void *context, const char *phase, uint64_t done, uint64_t total) {
    const stop_place *s = context;
    (void)total;
    return s->phase == NULL || strcmp(phase, s->phase) != 0 || done < s->after;
}

/* Stopped in each phase, it goes on after the one before, and comes to the same. */
START_TEST(work_that_was_kept_is_gone_on_from) {
    static const struct {
        stop_place stop;
        mn_phase done;
    } at[] = {{{"read", 0}, MN_PHASE_NONE},
              {{"simplify", 5000}, MN_PHASE_READ},
              {{"order", 10000}, MN_PHASE_SIMPLIFY},
              {{NULL, 0}, MN_PHASE_ORDER}};
    char in[128], whole[128], folder[128], resumed[128];
    mn_status st = {0};
    mn_vdt *vdt;
    mn_work *work;
    snprintf(in, sizeof in, "%s", fixture_path("work.ply"));
    snprintf(whole, sizeof whole, "%s", fixture_path("whole.vdt"));
    snprintf(folder, sizeof folder, "%s", fixture_path("work.d"));
    snprintf(resumed, sizeof resumed, "%s", fixture_path("resumed.vdt"));
    write_sheet(in, 150, false);
    mn_simplify_desc simplify = {.temp_dir = ".", .ram_bytes = 16 << 20};
    mn_read_desc read = {0};
    ck_assert(mn_vdt_make(in, &read, &simplify, NULL, &vdt, &st) == MN_OK);
    ck_assert(mn_vdt_write(vdt, whole, NULL, &st) == MN_OK);
    mn_vdt_close(vdt);

    stop_place stop = at[_i].stop;
    mn_work_desc desc = {.path = folder, .in = in, .read = &read, .simplify = &simplify};
    simplify.progress = stop_in;
    simplify.progress_context = &stop;
    ck_assert_msg(mn_work_open(&work, &desc, &st) == MN_OK, "%s", st.text);
    mn_code code = mn_vdt_make(in, &read, &simplify, work, &vdt, &st);
    ck_assert_msg(code == (stop.phase != NULL ? MN_FAILED : MN_OK), "%s", st.text);
    mn_vdt_close(vdt);
    ck_assert_int_eq(mn_work_done(work), at[_i].done);
    /* another process finds what a kill would leave: a copy, for this one has the folder */
    char command[400], copy[136];
    snprintf(copy, sizeof copy, "%s.2", folder);
    snprintf(command, sizeof command, "cp -a %s %s", folder, copy);
    ck_assert_int_eq(system(command), 0);
    mn_work_close(work);

    desc.path = copy;
    desc.resume = true;
    st.code = MN_OK;
    stop.phase = NULL;
    ck_assert_msg(mn_work_open(&work, &desc, &st) == MN_OK, "%s", st.text);
    ck_assert_int_eq(mn_work_done(work), at[_i].done);
    ck_assert_msg(mn_vdt_make(in, &read, &simplify, work, &vdt, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_vdt_write(vdt, resumed, NULL, &st) == MN_OK, "%s", st.text);
    same_files(whole, resumed);
    mn_vdt_close(vdt);
    mn_work_close(work);
}
END_TEST

/* A mesh from a file, of which all lengths are made 2^exponent as long: its tree, in the lengths it
 * had. */
static void tree_in_unit(int exponent, mn_tree *t) {
    char in[128], out[128];
    mn_mesh mesh;
    mn_status st = {0};
    mn_vdt *vdt = NULL;
    const mn_simplify_desc desc = {.temp_dir = "."};
    snprintf(in, sizeof in, "%s", fixture_path("unit.ply"));
    snprintf(out, sizeof out, "%s", fixture_path("unit.vdt"));
    fixture_sheet(30, 3, false, &mesh);
    for (size_t i = 0; i < (size_t)mesh.vertices * 3; i++)
        mesh.position[i] = ldexpf(mesh.position[i], exponent);
    ck_assert_msg(mn_mesh_write_ply(in, &mesh, &st) == MN_OK, "%s", st.text);
    mn_mesh_free(&mesh);
    ck_assert_msg(mn_vdt_make(in, NULL, &desc, NULL, &vdt, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mn_vdt_write(vdt, out, NULL, &st) == MN_OK, "%s", st.text);
    mn_vdt_close(vdt);
    ck_assert_msg(mn_tree_read(out, t, &st) == MN_OK, "%s", st.text);
    t->grid_step = ldexpf(t->grid_step, -exponent);
    for (size_t i = 0; i < (size_t)t->leaves * 3; i++)
        t->leaf_position[i] = ldexpf(t->leaf_position[i], -exponent);
    for (uint32_t i = 0; i < t->inner; i++) {
        t->switch_value[i] = ldexpf(t->switch_value[i], -exponent);
        t->radius[i] = ldexpf(t->radius[i], -exponent);
    }
}

START_TEST(a_file_in_any_unit) {
    static const int exponents[] = {-80, -40, 20, 40, 60};
    mn_tree first, other;
    tree_in_unit(0, &first);
    for (size_t i = 0; i < sizeof exponents / sizeof *exponents; i++) {
        tree_in_unit(exponents[i], &other);
        fixture_same(&first, &other);
        mn_tree_free(&other);
    }
    mn_tree_free(&first);
}
END_TEST

START_TEST(what_cannot_be_made_is_refused) {
    mn_status st = {0};
    mn_vdt *vdt = NULL;
    ck_assert_int_eq(mn_vdt_make("no such file", NULL, NULL, NULL, &vdt, &st), MN_BAD_INPUT);
    ck_assert_ptr_null(vdt);
    st.code = MN_OK;
    ck_assert_int_eq(mn_vdt_open("no such file", NULL, &vdt, &st), MN_BAD_INPUT);
    ck_assert_ptr_null(vdt);
    write_sheet(fixture_path("small.ply"), 30, false);
    st.code = MN_OK;
    mn_simplify_desc desc = {.temp_dir = ".", .ram_bytes = 1000};
    ck_assert_int_eq(mn_vdt_make(fixture_path("small.ply"), NULL, &desc, NULL, &vdt, &st),
                     MN_CAP_TOO_SMALL);
    ck_assert_ptr_null(vdt);
    /* and what it names is enough */
    const char *named = strstr(st.text, "--ram ");
    ck_assert_msg(named != NULL, "%s", st.text);
    desc.ram_bytes = strtoull(named + 6, NULL, 10) << 20;
    st.code = MN_OK;
    ck_assert_msg(mn_vdt_make(fixture_path("small.ply"), NULL, &desc, NULL, &vdt, &st) == MN_OK,
                  "%s", st.text);
    mn_vdt_close(vdt);
}
END_TEST

int main(void) {
    Suite *s = suite_create("vdt");
    TCase *t = tcase_create("files");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, any_shape_comes_back);
    tcase_add_test(t, a_deep_file_is_walked_within_a_cap);
    tcase_add_test(t, rows_say_what_nodes_are);
    tcase_add_test(t, the_build_id_is_of_the_content);
    tcase_add_loop_test(t, made_written_opened_and_blocked, 0, 2);
    tcase_add_loop_test(t, a_mnt_is_cut_again, 0, 3);
    tcase_add_loop_test(t, a_damaged_mnt_is_refused, 0, 3);
    tcase_add_test(t, a_mnt_is_opened_within_a_cap_and_a_disk);
    tcase_add_test(t, memory_and_threads_change_nothing);
    tcase_add_test(t, four_megabytes_to_work_in);
    tcase_add_loop_test(t, work_that_was_kept_is_gone_on_from, 0, 4);
    tcase_add_test(t, a_file_in_any_unit);
    tcase_add_test(t, what_cannot_be_made_is_refused);
    suite_add_tcase(s, t);
    return suite_run(s);
}
