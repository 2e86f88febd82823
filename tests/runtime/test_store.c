/* Goal: the three stores give the same blocks, survive damage, and keep their books.
 * Method: a walker like Navigate over made files; full recounts after every switch and frame. */
#include <check.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "suite.h"
#include "walk.h"

static const made_desc SMALL = {
    .seed = 11, .blocks = 60, .depth_max = 5, .fanout_max = 4, .pages_max = 3, .overflow_max = 2};

static void warn_count(void *context, const char *text) {
    (void)text;
    ++*(uint32_t *)context;
}

static void assert_same_front(const walker *a, const walker *b) {
    ck_assert_mem_eq(a->state, b->state, a->file->subtrees);
}

/* The same fronts along a path, whatever the store: paged has room for everything. */
START_TEST(all_stores_agree) {
    made_file file;
    made_desc desc = SMALL;
    desc.blocking = _i % 2 ? MN_BLOCKING_LEVELS : MN_BLOCKING_PACKED;
    made_file_make(&file, &desc);
    walker w[4];
    mni_store_desc kinds[4] = {{.kind = MN_STORE_RESIDENT},
                               {.kind = MN_STORE_MAPPED},
                               {.kind = MN_STORE_PAGED, .io = MN_IO_SIM, .k = file.blocks},
                               {.kind = MN_STORE_PAGED, .io = MN_IO_PREAD, .k = file.blocks}};
    for (int i = 0; i < 4; i++) {
        ck_assert_msg(walker_open(&w[i], &file, kinds[i]), "%s", w[i].status.text);
        w[i].check_each_step = true;
    }
    for (uint64_t camera = 1; camera < 12; camera++)
        for (int i = 0; i < 4; i++) {
            ck_assert_uint_lt(walker_settle(&w[i], camera * 7919, 500), 500);
            ck_assert(walker_has_all(&w[i]));
            assert_same_front(&w[0], &w[i]);
        }
    for (int i = 0; i < 4; i++) {
        ck_assert_uint_lt(walker_settle(&w[i], 0, 500), 500);
        ck_assert(walker_at_roots(&w[i]));
        walker_close(&w[i]);
    }
    made_file_free(&file);
}
END_TEST

/* A damaged inner block is absent and counted; the rest of the front is there; the way back works.
 */
START_TEST(damaged_inner_block_is_absent) {
    made_file file;
    made_file_make(&file, &SMALL);
    made_file_damage(&file, 1);
    uint32_t warnings = 0;
    mni_store_desc desc = {.kind = (mn_store_kind)_i,
                           .io = MN_IO_SIM,
                           .k = file.blocks,
                           .warn = warn_count,
                           .warn_context = &warnings};
    walker w;
    ck_assert(walker_open(&w, &file, desc));
    for (int frame = 0; frame < 300; frame++)
        walker_frame(&w, 74, 0.016); /* wants nearly everything */
    ck_assert(!walker_has_all(&w));
    for (uint32_t s = 0; s < file.subtrees; s++)
        if (file.subtree[s].block == 1)
            ck_assert_uint_eq(w.state[s], 0);
    mn_session_stats stats = {0};
    mni_store_stats(w.store, &stats);
    ck_assert_uint_eq(warnings, 1);
    ck_assert_uint_ge(stats.checksum_failures, 1);
    if (desc.kind != MN_STORE_RESIDENT) /* tried after 1, 2, 4 … 64, 64 frames */
        ck_assert_uint_le(stats.checksum_failures, 7 + 300 / 64 + 1);
    ck_assert_uint_lt(walker_settle(&w, 0, 500), 500);
    ck_assert(walker_at_roots(&w));
    walker_close(&w);
    made_file_free(&file);
}
END_TEST

/* mapped and paged look again: a block that is repaired comes back without reopening. */
START_TEST(repaired_block_comes_back) {
    made_file file;
    made_file_make(&file, &SMALL);
    made_file_damage(&file, 1);
    mni_store_desc desc = {.kind = (mn_store_kind)_i, .io = MN_IO_SIM, .k = file.blocks};
    walker w;
    ck_assert(walker_open(&w, &file, desc));
    for (int frame = 0; frame < 40; frame++)
        walker_frame(&w, 74, 0.016);
    ck_assert(!walker_has_all(&w));
    made_file_damage(&file, 1); /* turns the bit back */
    for (int frame = 0; frame < 140; frame++)
        walker_frame(&w, 74, 0.016);
    ck_assert(walker_has_all(&w));
    walker_close(&w);
    made_file_free(&file);
}
END_TEST

START_TEST(damaged_root_is_bad_input) {
    made_file file;
    made_file_make(&file, &SMALL);
    made_file_damage(&file, 0);
    mni_store_desc desc = {.kind = (mn_store_kind)_i, .io = MN_IO_PREAD, .k = file.blocks};
    walker w;
    ck_assert(!walker_open(&w, &file, desc));
    ck_assert_int_eq(w.status.code, MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(w.status.text, "root block 1"));
    made_file_free(&file);
}
END_TEST

static void refused_roots(const made_file *file, mn_store_kind kind) {
    made_file lying = *file;
    mni_store_desc desc = {.kind = kind, .io = MN_IO_PREAD, .k = file->blocks};
    walker w;
    ck_assert(!walker_open(&w, &lying, desc));
    ck_assert_int_eq(w.status.code, MN_BAD_INPUT);
}

/* A header with a good checksum may name any sound block as a root's: one that is no meta-node, one
 * that has a parent, one of another length than it has. */
START_TEST(a_root_that_is_none_is_bad_input) {
    made_file file;
    made_desc made = SMALL;
    made.roots = 2;
    made_file_make(&file, &made);
    const mn_block_ref root = file.header.root[0].block;
    for (uint32_t b = 0; b < file.blocks; b++) {
        file.header.root[1].block = file.block[b].ref;
        if (file.block[b].parent != MN_NONE)
            refused_roots(&file, (mn_store_kind)_i);
    }
    for (uint32_t pages = 1; pages <= made.pages_max; pages++) {
        file.header.root[1].block = (mn_block_ref){root.id, pages};
        if (pages != root.pages)
            refused_roots(&file, (mn_store_kind)_i);
    }
    made_file_free(&file);
}
END_TEST

START_TEST(cut_file_is_bad_input) {
    made_file file;
    made_file_make(&file, &SMALL);
    ck_assert_int_eq(truncate(file.path, (off_t)file.header.file_bytes - 1), 0);
    mni_store_desc desc = {.kind = (mn_store_kind)_i, .io = MN_IO_PREAD, .k = file.blocks};
    walker w;
    ck_assert(!walker_open(&w, &file, desc));
    ck_assert_int_eq(w.status.code, MN_BAD_INPUT);
    unlink(file.path);
    memset(&w, 0, sizeof w);
    ck_assert(!walker_open(&w, &file, desc));
    ck_assert_int_eq(w.status.code, MN_BAD_INPUT);
    made_file_free(&file);
}
END_TEST

/* What is left for what is to come: nothing of the fewest, nothing where nobody looks ahead or the
 * blocks are of levels; each place more is one more in use, or one more left. */
START_TEST(places_to_come) {
    mn_header header = {.blocking = MN_BLOCKING_PACKED, .block_depth = 7, .roots = 1};
    const uint32_t k_min = mni_store_k_min(&header);
    uint32_t before = k_min;
    for (uint32_t k = k_min; k < k_min + 1000; k++) {
        const uint32_t to_use = mni_store_k_to_use(&header, k, MN_PREFETCH_AHEAD);
        ck_assert_uint_eq(to_use, k - (k - k_min) / 16);
        ck_assert(to_use == before || to_use == before + 1);
        ck_assert_uint_eq(mni_store_k_to_use(&header, k, MN_PREFETCH_NEIGHBOURS), k);
        ck_assert_uint_eq(mni_store_k_to_use(&header, k, MN_PREFETCH_OFF), k);
        before = to_use;
    }
    header.blocking = MN_BLOCKING_LEVELS;
    ck_assert_uint_eq(mni_store_k_to_use(&header, 500, MN_PREFETCH_AHEAD), 500);
}
END_TEST

START_TEST(too_few_place_holders) {
    made_file file;
    made_file_make(&file, &SMALL);
    mni_store_desc desc = {
        .kind = MN_STORE_PAGED, .io = MN_IO_SIM, .k = mni_store_k_min(&file.header) - 1};
    walker w;
    ck_assert(!walker_open(&w, &file, desc));
    ck_assert_int_eq(w.status.code, MN_CAP_TOO_SMALL);
    made_file_free(&file);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("store");
    TCase *tests = tcase_create("store");
    tcase_set_timeout(tests, 60);
    tcase_add_loop_test(tests, all_stores_agree, 0, 2);
    tcase_add_loop_test(tests, damaged_inner_block_is_absent, MN_STORE_PAGED,
                        MN_STORE_RESIDENT + 1);
    tcase_add_loop_test(tests, repaired_block_comes_back, MN_STORE_PAGED, MN_STORE_MAPPED + 1);
    tcase_add_loop_test(tests, damaged_root_is_bad_input, MN_STORE_PAGED, MN_STORE_RESIDENT + 1);
    tcase_add_loop_test(tests, a_root_that_is_none_is_bad_input, MN_STORE_PAGED,
                        MN_STORE_RESIDENT + 1);
    tcase_add_loop_test(tests, cut_file_is_bad_input, MN_STORE_PAGED, MN_STORE_RESIDENT + 1);
    tcase_add_test(tests, places_to_come);
    tcase_add_test(tests, too_few_place_holders);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
