/* Goal: a walk over a .mnt hands out the rows and simplices of its tree, byte for byte and in their
 * order, however it is cut; and takes no more memory than it may. Method: trees of meshes and
 * random ones, cut in several ways and walked; beside them what the tree in memory gives. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "frame.h"
#include "mnt_rows.h"
#include "simplify.h"
#include "suite.h"
#include "tree.h"
#include "tree_fixture.h"
#include "tree_rows.h"

typedef struct stream {
    unsigned char *bytes[MNI_SECTIONS];
    size_t used[MNI_SECTIONS];
} stream;

static mn_code put(void *context, int section, const void *bytes, size_t count) {
    stream *s = context;
    s->bytes[section] = realloc(s->bytes[section], s->used[section] + count);
    memcpy(s->bytes[section] + s->used[section], bytes, count);
    s->used[section] += count;
    return MN_OK;
}

static mn_code put_row(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    stream *s = context;
    ck_assert_uint_eq(at, s->used[MNI_ROWS] / sizeof *row);
    ck_assert((child == NULL) == (row->order == 0));
    return put(context, MNI_ROWS, row, sizeof *row);
}

static mn_code put_simplex(void *context, const mni_row_simplex *simplex) {
    return put(context, MNI_SIMPLICES, simplex, sizeof *simplex);
}

static void free_stream(stream *s) {
    for (int i = 0; i < MNI_SECTIONS; i++)
        free(s->bytes[i]);
    memset(s, 0, sizeof *s);
}

static void open_cut(const mn_tree *tree, const mn_block_desc *cut, mni_mnt *mnt) {
    const char *path = fixture_path("walk.mnt");
    mn_status st = {0};
    ck_assert_msg(mn_block_write(path, tree, cut, NULL, NULL, &st) == MN_OK, "%s", st.text);
    ck_assert_msg(mni_mnt_open(mnt, path, &st) == MN_OK, "%s", st.text);
}

static void make_tree(int kind, mn_tree *tree) {
    mn_mesh mesh;
    if (kind == 2)
        fixture_book(700, &mesh); /* overflows */
    else
        fixture_sheet(60, 5, kind == 1, &mesh);
    if (kind == 0)
        fixture_tree(&mesh, tree);
    else
        fixture_random_tree(&mesh, 7, tree); /* deep in parts */
    mn_mesh_free(&mesh);
}

static const mn_block_desc cuts[] = {
    {.block_bytes = 4096},
    {.block_bytes = 65536},
    {.blocking = MN_BLOCKING_LEVELS, .l = 1},
    {.blocking = MN_BLOCKING_LEVELS, .l = 5},
};
enum { CUTS = sizeof cuts / sizeof cuts[0] };

START_TEST(rows_are_those_of_the_tree) {
    mn_tree tree;
    stream wanted = {0};
    mn_status st = {0};
    make_tree(_i, &tree);
    ck_assert(mni_tree_rows(&tree, put, &wanted, &st) == MN_OK);
    for (int c = 0; c < CUTS; c++) {
        mni_mnt mnt;
        stream got = {0};
        const mni_walk_sink sink = {put_row, put_simplex, &got};
        open_cut(&tree, &cuts[c], &mnt);
        ck_assert_msg(mni_mnt_walk(&mnt, &(mni_walk_desc){0}, &sink, &st) == MN_OK, "%s", st.text);
        for (int i = 0; i < MNI_SECTIONS; i++) {
            ck_assert_uint_eq(got.used[i], wanted.used[i]);
            ck_assert(memcmp(got.bytes[i], wanted.bytes[i], wanted.used[i]) == 0);
        }
        mni_mnt_close(&mnt);
        free_stream(&got);
    }
    free_stream(&wanted);
    mn_tree_free(&tree);
}
END_TEST

typedef struct top {
    const mn_tree *tree;
    uint32_t from, found, simplices, node;
} top;

static mn_code see_row(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    top *t = context;
    const uint32_t i = row->order - t->tree->leaves;
    t->node = child == NULL ? MN_NONE : i;
    if (child == NULL || row->order < t->from)
        return MN_OK;
    t->found++;
    ck_assert_uint_eq(t->tree->leaf_mid[i], at);
    ck_assert_uint_eq(t->tree->leaf_lo[i], row->leaf_lo);
    ck_assert_uint_eq(t->tree->leaf_hi[i], row->leaf_hi);
    ck_assert(memcmp(t->tree->leaf_position + 3 * (size_t)at, row->position, 12) == 0);
    return MN_OK;
}

static mn_code see_simplex(void *context, const mni_row_simplex *simplex) {
    top *t = context;
    (void)simplex;
    t->simplices += t->tree->leaves + t->node >= t->from;
    return MN_OK;
}

static bool is_top(const void *context, uint32_t order) {
    return order >= ((const top *)context)->from;
}

START_TEST(the_top_of_a_tree_comes_alone) {
    mn_tree tree;
    mn_status st = {0};
    make_tree(_i, &tree);
    for (uint32_t part = 1; part <= 64; part *= 4) {
        const uint32_t made = tree.inner - tree.inner / part;
        for (int c = 0; c < CUTS; c++) {
            mni_mnt mnt;
            top t = {.tree = &tree, .from = tree.leaves + made};
            const mni_walk_sink sink = {see_row, see_simplex, &t};
            const mni_walk_desc desc = {.wanted = is_top};
            open_cut(&tree, &cuts[c], &mnt);
            ck_assert_msg(mni_mnt_walk(&mnt, &desc, &sink, &st) == MN_OK, "%s", st.text);
            ck_assert_uint_eq(t.found, tree.inner - made);
            ck_assert_uint_eq(t.simplices, tree.simplices - tree.simplex_start[made]);
            mni_mnt_close(&mnt);
        }
    }
    mn_tree_free(&tree);
}
END_TEST

/* The least that is taken for a number of --ram, and one byte less: a cap is refused with a number
 * that does, and with that one marks need several walks. */
START_TEST(a_cap_is_kept_or_refused) {
    mn_tree tree;
    mni_mnt mnt;
    const mni_walk_sink nobody = {0};
    make_tree(1, &tree);
    for (int c = 0; c < CUTS; c++) {
        bool refused = false, taken = false;
        open_cut(&tree, &cuts[c], &mnt);
        for (uint64_t room = 1 << 10; room <= 32 << 20; room *= 2) {
            mn_status st = {0};
            const mni_walk_desc desc = {.ram_bytes = MNI_PROGRAM_BYTES + room};
            mn_code code = mni_mnt_walk(&mnt, &desc, &nobody, &st);
            ck_assert_msg(code == MN_OK || code == MN_CAP_TOO_SMALL, "%s", st.text);
            refused |= code == MN_CAP_TOO_SMALL;
            taken |= code == MN_OK;
            ck_assert_msg(code == MN_OK || !taken, "%s", st.text); /* more is never too little */
            if (code == MN_OK)
                continue;
            const char *try = strstr(st.text, "try --ram ");
            ck_assert_ptr_nonnull(try);
            const mni_walk_desc named = {.ram_bytes = strtoull(try + 10, NULL, 10) << 20};
            st = (mn_status){0};
            ck_assert_msg(mni_mnt_walk(&mnt, &named, &nobody, &st) == MN_OK, "%s", st.text);
        }
        ck_assert(refused && taken);
        mni_mnt_close(&mnt);
    }
    mn_tree_free(&tree);
}
END_TEST

/* More nodes than there is room for marks: a balanced tree without simplices. */
START_TEST(order_ids_are_looked_at_in_parts) {
    enum { LEAVES = 1 << 20, ROOM = 250 << 10 };
    mn_tree tree;
    mni_mnt mnt;
    mn_status st = {0};
    const mni_walk_sink nobody = {0};
    const mni_walk_desc desc = {.ram_bytes = MNI_PROGRAM_BYTES + ROOM};
    ck_assert(mni_tree_alloc(&tree, LEAVES, 1, 0, false, &st) == MN_OK);
    for (uint32_t i = 0, from = 0; i < tree.inner; i++, from += 2) {
        tree.left[i] = from;
        tree.right[i] = from + 1;
        tree.cone[i] = (mn_cone){{0, 0}, MN_CONE_NO_BOUND};
    }
    tree.legal_last = LEAVES - 1;
    tree.grid_step = 1;
    ck_assert_msg(mni_tree_derive(&tree, &st) == MN_OK, "%s", st.text);
    open_cut(&tree, &(mn_block_desc){.blocking = MN_BLOCKING_LEVELS, .l = 8}, &mnt);
    ck_assert_uint_gt(tree.inner, 8 * ROOM / 2);
    ck_assert_msg(mni_mnt_walk(&mnt, &desc, &nobody, &st) == MN_OK, "%s", st.text);
    mni_mnt_close(&mnt);
    mn_tree_free(&tree);
}
END_TEST

/* The walk over the file, with bytes [at, at + count) as they are in memory. */
static mn_code walk_with(const mni_mnt *mnt, const unsigned char *bytes, uint64_t at,
                         uint32_t count, mn_status *st) {
    const mni_walk_sink nobody = {0};
    mni_mnt again;
    FILE *f = fopen(mnt->path, "r+b");
    ck_assert(f != NULL && fseek(f, (long)at, SEEK_SET) == 0);
    ck_assert_uint_eq(fwrite(bytes, 1, count, f), count);
    ck_assert_int_eq(fclose(f), 0);
    *st = (mn_status){0};
    mn_code code = mni_mnt_open(&again, mnt->path, st);
    if (code == MN_OK)
        code = mni_mnt_walk(&again, &(mni_walk_desc){0}, &nobody, st);
    mni_mnt_close(&again);
    return code;
}

/* A reference that leads where its neighbour does: what the block knows of one child's subtrees is
 * then asked of another, which may have fewer of them. */
START_TEST(a_child_that_two_references_lead_to_is_refused) {
    enum { TRIES = 100 };
    mn_tree tree;
    mni_mnt mnt;
    mn_status st = {0};
    uint32_t tried = 0;
    make_tree(0, &tree);
    open_cut(&tree, &cuts[_i == 0 ? 0 : CUTS - 1], &mnt);
    unsigned char *block = malloc(mnt.header.block_bytes_max);
    FILE *f = fopen(mnt.path, "rb");
    ck_assert(block != NULL && f != NULL);
    for (uint64_t at = MN_PAGE_BYTES; at < mnt.header.file_bytes && tried < TRIES;) {
        ck_assert(fseek(f, (long)at, SEEK_SET) == 0);
        ck_assert_uint_eq(fread(block, 1, MN_PAGE_BYTES, f), MN_PAGE_BYTES);
        const mn_block_ref self = {(uint32_t)(at / MN_PAGE_BYTES), mni_frame_pages(block)};
        const uint32_t length = self.pages * MN_PAGE_BYTES;
        ck_assert_uint_eq(fread(block + MN_PAGE_BYTES, 1, length - MN_PAGE_BYTES, f),
                          length - MN_PAGE_BYTES);
        mni_frame frame;
        mni_frame_get(block, &frame);
        for (uint32_t r = 1; r < frame.refs; r++, tried++) {
            const mn_block_ref was = mni_frame_ref(block, r);
            mni_frame_set_ref(block, r, mni_frame_ref(block, r - 1));
            mni_frame_seal(block, &frame, self, mnt.header.build_id);
            ck_assert_int_eq(walk_with(&mnt, block, at, length, &st), MN_BAD_INPUT);
            ck_assert_msg(strstr(st.text, "is not what its parent says") != NULL ||
                              strstr(st.text, "where its parent knows of") != NULL,
                          "%s", st.text);
            mni_frame_set_ref(block, r, was);
            mni_frame_seal(block, &frame, self, mnt.header.build_id);
        }
        ck_assert_msg(walk_with(&mnt, block, at, length, &st) == MN_OK, "%s", st.text);
        at += length;
    }
    ck_assert_uint_gt(tried, 0);
    fclose(f);
    free(block);
    mni_mnt_close(&mnt);
    mn_tree_free(&tree);
}
END_TEST

static mn_code stop_row(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    (void)row;
    (void)child;
    return at == 100 ? mn_fail(context, MN_NO_SPACE, "no more, please") : MN_OK;
}

START_TEST(who_takes_may_end_it) {
    mn_tree tree;
    mni_mnt mnt;
    mn_status st = {0}, own = {0};
    make_tree(0, &tree);
    open_cut(&tree, &cuts[0], &mnt);
    const mni_walk_sink sink = {.row = stop_row, .context = &own};
    ck_assert_int_eq(mni_mnt_walk(&mnt, &(mni_walk_desc){0}, &sink, &st), MN_NO_SPACE);
    ck_assert_str_eq(own.text, "no more, please");
    mni_mnt_close(&mnt);
    mn_tree_free(&tree);
}
END_TEST

int main(void) {
    Suite *s = suite_create("rows of a .mnt");
    TCase *t = tcase_create("mnt_rows");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, rows_are_those_of_the_tree, 0, 3);
    tcase_add_loop_test(t, the_top_of_a_tree_comes_alone, 0, 3);
    tcase_add_test(t, a_cap_is_kept_or_refused);
    tcase_add_test(t, order_ids_are_looked_at_in_parts);
    tcase_add_loop_test(t, a_child_that_two_references_lead_to_is_refused, 0, 2);
    tcase_add_test(t, who_takes_may_end_it);
    suite_add_tcase(s, t);
    return suite_run(s);
}
