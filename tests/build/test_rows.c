/* Goal: rows are read as they stand, in any memory; blocks made of them are the same bytes wherever
 * they lie; rows that lie are found out, and trouble with disks is told.
 * Method: trees of all kinds in memory and in files, pages few and many; words of rows and
 * simplices changed by lot, and what is still taken for a tree read back whole; files cut after
 * each page, disks full at each block. */
#include <check.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>
#include <xxhash.h>

#include "block_rows.h"
#include "plan.h"
#include "suite.h"
#include "tree.h"
#include "tree_fixture.h"
#include "tree_rows.h"

/* A tree in rows, in memory and in one file, at odd offsets. */
typedef struct filed {
    mn_tree tree;
    unsigned char *section[MNI_SECTIONS];
    size_t size[MNI_SECTIONS];
    mni_rows_source memory, file;
} filed;
static const uint64_t at_rows = 44, gap = 100;

static mn_code put(void *context, int section, const void *bytes, size_t count) {
    filed *f = context;
    memcpy(f->section[section] + f->size[section], bytes, count);
    f->size[section] += count;
    return MN_OK;
}

static void write_section(const filed *f, int section) {
    uint64_t at = section == MNI_ROWS ? f->file.row_offset : f->file.simplex_offset;
    ck_assert(pwrite(f->file.row_fd, f->section[section], f->size[section], (off_t)at) ==
              (ssize_t)f->size[section]);
}

static void file_tree(filed *f) {
    mn_status st = {0};
    const mn_tree *t = &f->tree;
    f->section[MNI_ROWS] = malloc(sizeof(mni_row) * t->leaves);
    f->section[MNI_SIMPLICES] = malloc(sizeof(mni_row_simplex) * (t->simplices + 1));
    ck_assert(f->section[MNI_ROWS] != NULL && f->section[MNI_SIMPLICES] != NULL);
    f->size[MNI_ROWS] = f->size[MNI_SIMPLICES] = 0;
    ck_assert(mni_tree_rows(t, put, f, &st) == MN_OK);
    f->memory =
        (mni_rows_source){.rows = t->leaves,
                          .simplices = t->simplices,
                          .has_colors = t->leaf_color != NULL,
                          .row = (const mni_row *)(void *)f->section[MNI_ROWS],
                          .simplex = (const mni_row_simplex *)(void *)f->section[MNI_SIMPLICES]};
    f->file = f->memory;
    f->file.row = NULL;
    f->file.simplex = NULL;
    f->file.name = "rows";
    f->file.row_fd = f->file.simplex_fd =
        open(fixture_path("rows"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    f->file.row_offset = at_rows;
    f->file.simplex_offset = at_rows + f->size[MNI_ROWS] + gap;
    ck_assert_int_ge(f->file.row_fd, 0);
    write_section(f, MNI_ROWS);
    write_section(f, MNI_SIMPLICES);
}

static void close_filed(filed *f) {
    close(f->file.row_fd);
    free(f->section[MNI_ROWS]);
    free(f->section[MNI_SIMPLICES]);
    mn_tree_free(&f->tree);
}

enum { KINDS = 4 };

static void make_filed(int kind, uint32_t size, filed *f) {
    mn_mesh mesh;
    if (kind == 3)
        fixture_book(size * size, &mesh);
    else
        fixture_sheet(size, 1, kind == 1, &mesh);
    if (kind < 2)
        fixture_tree(&mesh, &f->tree);
    else
        fixture_random_tree(&mesh, fixture_seed(5), &f->tree);
    mn_mesh_free(&mesh);
    file_tree(f);
}

static uint64_t id_of(const filed *f, const mn_block_desc *desc) {
    uint64_t sum[MNI_SECTIONS];
    for (int i = 0; i < MNI_SECTIONS; i++)
        sum[i] = XXH3_64bits(f->section[i], f->size[i]);
    mn_block_desc full = *desc;
    full.block_bytes = full.block_bytes == 0 ? 8192 : full.block_bytes;
    full.l = full.l == 0 ? 5 : full.l;
    return mni_build_id(&f->tree, f->memory.has_colors, sum, &full);
}

static mn_code block(const filed *f, const mni_rows_source *source, const char *name,
                     const mn_block_desc *desc, mn_header *h, mn_block_counts *counts,
                     mn_status *st) {
    return mni_block_rows(fixture_path(name), &f->tree, source, id_of(f, desc), desc, h, counts,
                          st);
}

/* ---- the accessor --------------------------------------------------------------------------- */

START_TEST(rows_are_read_as_they_stand) {
    filed f;
    mni_rows rows;
    mni_rows_run run = {0};
    mn_status st = {0};
    uint64_t state = fixture_seed(11);
    make_filed(1, 60, &f);
    const mni_row *row = f.memory.row;
    const mni_row_simplex *simplex = f.memory.simplex;
    const uint64_t budget[] = {0, 1 << 17, 1 << 24};
    ck_assert(mni_rows_open(&rows, _i < 3 ? &f.file : &f.memory, budget[_i % 3], &st) == MN_OK);
    for (uint32_t i = 0; i < 20000; i++) {
        uint32_t at = fixture_random(&state) % f.memory.rows, end;
        uint32_t next = at + 1 + fixture_random(&state) % (f.memory.rows - at);
        next = next - at > 300 && i % 64 != 0 ? at + 300 : next;
        mni_row got;
        mni_row_simplex room[400];
        ck_assert(mni_rows_get(&rows, at, &got, &end));
        ck_assert(memcmp(&got, &row[at], sizeof got) == 0);
        uint32_t count = end - got.simplex_start;
        ck_assert_uint_eq(end,
                          at + 1 < f.memory.rows ? row[at + 1].simplex_start : f.memory.simplices);
        const mni_row_simplex *s = mni_rows_simplices(&rows, got.simplex_start, count, room);
        ck_assert(s != NULL && memcmp(s, simplex + got.simplex_start, count * sizeof *s) == 0);
        uint32_t most = i % 3 == 0 ? 100 : UINT32_MAX;
        ck_assert(mni_rows_fill_run(&rows, at, next, most, &run));
        ck_assert(memcmp(run.row, &row[at], (next - at) * sizeof got) == 0);
        count = run.simplex_end - run.simplex_first;
        ck_assert((run.simplex != NULL) == (count <= most));
        if (run.simplex != NULL)
            ck_assert(memcmp(run.simplex, simplex + run.simplex_first, count * sizeof *s) == 0);
    }
    ck_assert(mni_rows_simplices(&rows, f.memory.simplices, 1, NULL) == NULL);
    ck_assert(mni_rows_simplices(&rows, MN_NONE, MN_NONE, NULL) == NULL);
    ck_assert(mni_rows_trouble(&rows, &st) == MN_OK);
    if (_i == 2) /* room for all: nothing is read twice */
        ck_assert_uint_eq(rows.bytes_read, f.size[MNI_ROWS] + f.size[MNI_SIMPLICES]);
    else if (_i < 2)
        ck_assert_uint_gt(rows.bytes_read, f.size[MNI_ROWS]);
    mni_rows_run_free(&run);
    mni_rows_close(&rows);
    close_filed(&f);
}
END_TEST

/* ---- blocks --------------------------------------------------------------------------------- */

static bool same_files(const char *a, const char *b) {
    char path[512];
    snprintf(path, sizeof path, "cmp -s %s %s", fixture_path(a), fixture_path(b));
    return system(path) == 0;
}

START_TEST(the_same_bytes_in_any_memory) {
    static const uint32_t block_bytes[] = {4096, 8192, 65536};
    filed f;
    make_filed(_i, 60, &f);
    for (uint32_t k = 0; k < 5; k++) {
        mn_block_desc desc = {.block_bytes = k < 3 ? block_bytes[k] : 0,
                              .blocking = k < 3 ? MN_BLOCKING_PACKED : MN_BLOCKING_LEVELS,
                              .l = k < 3 ? 0 : 3 * k - 6};
        mn_header a, b;
        mn_status st = {0};
        mn_tree back;
        ck_assert_msg(block(&f, &f.memory, "a.mnt", &desc, &a, NULL, &st) == MN_OK, "%s", st.text);
        ck_assert_msg(mn_tree_load(fixture_path("a.mnt"), NULL, &back, &st) == MN_OK, "%s",
                      st.text);
        fixture_same(&f.tree, &back);
        mn_tree_free(&back);
        for (uint32_t m = 0; m < 3; m++) {
            mn_block_counts counts;
            desc.ram_bytes = m == 0 ? 1 : m == 1 ? (8 << 20) + (1 << 18) : 0;
            desc.threads = m;
            ck_assert_msg(block(&f, &f.file, "b.mnt", &desc, &b, &counts, &st) == MN_OK, "%s",
                          st.text);
            ck_assert(memcmp(&a, &b, sizeof a) == 0);
            ck_assert(same_files("a.mnt", "b.mnt"));
            ck_assert_uint_ge(counts.bytes_read, f.size[MNI_ROWS] + f.size[MNI_SIMPLICES]);
            ck_assert_uint_eq(counts.bytes_written, b.file_bytes);
        }
    }
    close_filed(&f);
}
END_TEST

/* ---- lies ----------------------------------------------------------------------------------- */

/* A word of a section, changed: a little, a bit, or into anything. */
static void lie(filed *f, uint64_t *state, int section, size_t *at, uint32_t *was) {
    uint32_t word;
    *at = fixture_random(state) % (f->size[section] / 4) * 4;
    memcpy(&word, f->section[section] + *at, sizeof word);
    *was = word;
    switch (fixture_random(state) % 5) {
    case 0:
        word += 1 - 2 * (fixture_random(state) % 2);
        break;
    case 1:
        word ^= 1u << fixture_random(state) % 32;
        break;
    case 2:
        word = fixture_random(state) % f->tree.leaves;
        break;
    case 3:
        word = fixture_random(state);
        break;
    default: /* what stands elsewhere in the same column */
        if (section == MNI_ROWS)
            memcpy(&word,
                   f->section[section] + *at % sizeof(mni_row) +
                       fixture_random(state) % f->tree.leaves * sizeof(mni_row),
                   sizeof word);
        else
            word = MN_NONE;
    }
    memcpy(f->section[section] + *at, &word, sizeof word);
}

START_TEST(lies_are_found_out) {
    enum { LIES = 1500 };
    filed f;
    uint64_t state = fixture_seed(17 + (uint64_t)_i);
    uint32_t found = 0;
    make_filed(_i, 12, &f);
    for (uint32_t i = 0; i < LIES; i++) {
        uint32_t lies = 1 + (i % 7 == 0), was[2];
        int section[2];
        size_t at[2];
        mn_block_desc desc = {.blocking = i % 4 == 0 ? MN_BLOCKING_LEVELS : MN_BLOCKING_PACKED,
                              .l = 1 + i % 5,
                              .block_bytes = 4096u << i % 3,
                              .threads = 1 + i % 2,
                              .ram_bytes = 1};
        mn_status st = {0};
        mn_header h;
        for (uint32_t k = 0; k < lies; k++) {
            section[k] = fixture_random(&state) % 4 == 0 ? MNI_SIMPLICES : MNI_ROWS;
            lie(&f, &state, section[k], &at[k], &was[k]);
        }
        if (i % 8 == 0) {
            write_section(&f, MNI_ROWS);
            write_section(&f, MNI_SIMPLICES);
        }
        mn_code code = block(&f, i % 8 == 0 ? &f.file : &f.memory, "lie.mnt", &desc, &h, NULL, &st);
        if (code == MN_OK) { /* then it is a tree: what is read back says so too */
            mn_tree back;
            ck_assert_msg(mn_tree_load(fixture_path("lie.mnt"), NULL, &back, &st) == MN_OK,
                          "lie %u, word %zu of section %d, was %x: %s", i, at[0] / 4, section[0],
                          was[0], st.text);
            mn_tree_free(&back);
        } else {
            ck_assert_msg(code == MN_BAD_INPUT || code == MN_USAGE, "lie %u: %s", i, st.text);
            ck_assert(st.text[0] != 0 && strchr(st.text, '\n') == NULL);
            ck_assert(i % 8 != 0 || strncmp(st.text, "rows: ", 6) == 0 || code == MN_USAGE);
            found++;
        }
        for (uint32_t k = lies; k-- > 0;)
            memcpy(f.section[section[k]] + at[k], &was[k], sizeof was[k]);
    }
    printf("%u of %u lies found out\n", found, LIES);
    ck_assert_uint_ge(found, LIES / 2);
    close_filed(&f);
}
END_TEST

/* The normal at the dive point is summed when all blocks are written, and the file read for it once
 * more: a corner that was none by then ended the program. */
START_TEST(a_tree_that_changes_is_told) {
    filed f;
    mni_rows rows;
    mn_status st = {0};
    mn_header h;
    make_filed(0, 12, &f);
    mni_row_simplex *simplex = (mni_row_simplex *)(void *)f.section[MNI_SIMPLICES];
    const mni_found found = {.top = simplex[0].corner[0]};
    ck_assert(simplex[0].corner[2] != MN_NONE);
    ck_assert(mni_rows_open(&rows, &f.memory, 0, &st) == MN_OK);
    ck_assert(mni_found_shape(&found, &rows, &h, &st) == MN_OK);
    simplex[0].corner[2] = f.tree.leaves;
    ck_assert_int_eq(mni_found_shape(&found, &rows, &h, &st), MN_FAILED);
    ck_assert_str_eq(st.text, "the tree has changed while it was read");
    mni_rows_close(&rows);
    close_filed(&f);
}
END_TEST

/* What no block shows: rows that nobody refers to, counts that are others'. */
START_TEST(heads_that_do_not_fit_are_refused) {
    filed f;
    mn_block_desc desc = {0};
    make_filed(0, 12, &f);
    uint32_t *word[] = {&f.tree.triangles, &f.tree.depth_max,  &f.tree.legal_last,
                        &f.tree.roots,     &f.memory.rows,     &f.tree.inner,
                        &f.tree.simplices, &f.memory.simplices};
    for (uint32_t k = 0; k < sizeof word / sizeof word[0]; k++) {
        mn_status st = {0};
        uint32_t was = *word[k];
        *word[k] = k == 2 ? 0 : was - 1;
        ck_assert_int_eq(block(&f, &f.memory, "h.mnt", &desc, NULL, NULL, &st), MN_BAD_INPUT);
        *word[k] = was;
    }
    mn_status st = {0};
    ck_assert_msg(block(&f, &f.memory, "h.mnt", &desc, NULL, NULL, &st) == MN_OK, "%s", st.text);
    close_filed(&f);
}
END_TEST

/* ---- disks ---------------------------------------------------------------------------------- */

START_TEST(files_that_end_early_are_told) {
    filed f;
    mn_block_desc desc = {.ram_bytes = 1};
    make_filed(0, 20, &f);
    off_t whole = lseek(f.file.row_fd, 0, SEEK_END);
    for (off_t length = 0; length < whole; length += 1000) {
        mn_status st = {0};
        write_section(&f, MNI_ROWS);
        write_section(&f, MNI_SIMPLICES);
        ck_assert_int_eq(ftruncate(f.file.row_fd, length), 0);
        desc.threads = 1 + (length / 1000) % 2;
        ck_assert_int_eq(block(&f, &f.file, "e.mnt", &desc, NULL, NULL, &st), MN_FAILED);
        ck_assert_msg(strstr(st.text, "ends there") != NULL, "%s", st.text);
        ck_assert_int_ne(access(fixture_path("e.mnt"), F_OK), 0);
    }
    mn_status st = {0};
    int fd = f.file.row_fd;
    f.file.row_fd = f.file.simplex_fd = -1;
    ck_assert_int_eq(block(&f, &f.file, "e.mnt", &desc, NULL, NULL, &st), MN_FAILED);
    ck_assert(strstr(st.text, strerror(EBADF)) != NULL);
    f.file.row_fd = fd;
    close_filed(&f);
}
END_TEST

static bool stop_at(void *context, const char *phase, uint64_t done, uint64_t total) {
    uint32_t *calls = context;
    ck_assert_str_eq(phase, "blocking");
    ck_assert_uint_le(done, total);
    return (*calls)-- > 1;
}

START_TEST(nothing_is_lost_by_a_full_disk) {
    filed f;
    struct rlimit old;
    mn_header h;
    mn_status st = {0};
    mn_block_desc desc = {.block_bytes = 4096};
    signal(SIGXFSZ, SIG_IGN);
    make_filed(0, 60, &f);
    ck_assert(block(&f, &f.memory, "kept.mnt", &desc, &h, NULL, &st) == MN_OK);
    ck_assert(block(&f, &f.memory, "full.mnt", &desc, &h, NULL, &st) == MN_OK);
    ck_assert_uint_gt(h.blocks, 10);
    getrlimit(RLIMIT_FSIZE, &old);
    for (uint64_t room = 0; room < h.file_bytes; room += MN_PAGE_BYTES / 2) {
        struct rlimit small = {room, old.rlim_max};
        st = (mn_status){0};
        desc.threads = 1 + room / MN_PAGE_BYTES % 2;
        setrlimit(RLIMIT_FSIZE, &small);
        mn_code code = block(&f, &f.memory, "full.mnt", &desc, NULL, NULL, &st);
        setrlimit(RLIMIT_FSIZE, &old);
        ck_assert_msg(code == MN_NO_SPACE, "%s", st.text);
        ck_assert(same_files("kept.mnt", "full.mnt"));
    }
    uint32_t calls = 1;
    st = (mn_status){0};
    desc.progress = stop_at;
    desc.progress_context = &calls;
    ck_assert_int_eq(block(&f, &f.memory, "full.mnt", &desc, NULL, NULL, &st), MN_FAILED);
    ck_assert_str_eq(st.text, "interrupted");
    ck_assert(same_files("kept.mnt", "full.mnt"));
    close_filed(&f);
}
END_TEST

int main(void) {
    Suite *s = suite_create("rows");
    TCase *t = tcase_create("rows");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, rows_are_read_as_they_stand, 0, 4);
    tcase_add_loop_test(t, the_same_bytes_in_any_memory, 0, KINDS);
    tcase_add_loop_test(t, lies_are_found_out, 0, KINDS);
    tcase_add_test(t, a_tree_that_changes_is_told);
    tcase_add_test(t, heads_that_do_not_fit_are_refused);
    tcase_add_test(t, files_that_end_early_are_told);
    tcase_add_test(t, nothing_is_lost_by_a_full_disk);
    suite_add_tcase(s, t);
    return suite_run(s);
}
