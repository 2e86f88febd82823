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
#include "rowpack.h"
#include "tree.h"
#include "tree_fixture.h"
#include "tree_rows.h"

/* A tree in rows, in memory and in one file, at odd offsets. */
typedef struct filed {
    mn_tree tree;
    unsigned char *section[MNI_SECTIONS];
    size_t size[MNI_SECTIONS];
    mni_rows_source memory, file, packed;
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
    ck_assert(pwrite(f->file.fd, f->section[section], f->size[section], (off_t)at) ==
              (ssize_t)f->size[section]);
}

/* The same, packed, in a file of its own. */
static void pack_tree(filed *f) {
    const mni_rows_source *m = &f->memory;
    const uint32_t places = (uint32_t)mni_rowpack_places(m->rows, m->simplices);
    unsigned char bytes[MNI_PAGE_PACKED_MAX];
    uint64_t *place = calloc(places, sizeof *place), at = at_rows;
    uint32_t page = 0;
    f->packed = f->file;
    f->packed.grid_step = f->tree.grid_step;
    f->packed.fd = open(fixture_path("packed"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    for (uint32_t i = 0; i < m->rows + m->simplices;) {
        const bool rows = i < m->rows;
        const uint32_t first = rows ? i : i - m->rows,
                       left = (rows ? m->rows : m->simplices) - first,
                       most = rows ? MNI_ROWS_PAGE : MNI_SIMPLICES_PAGE,
                       count = left < most ? left : most;
        const size_t size =
            rows ? mni_rows_pack(bytes, m->row + first, first, count, f->packed.grid_step)
                 : mni_simplices_pack(bytes, m->simplex + first, count);
        ck_assert_uint_le(size, sizeof bytes);
        ck_assert(pwrite(f->packed.fd, bytes, size, (off_t)at) == (ssize_t)size);
        place[page++] = at;
        at += size;
        i += count;
    }
    ck_assert_uint_eq(page + 1, places);
    place[page] = f->packed.places_offset = at;
    ck_assert(pwrite(f->packed.fd, place, 8 * places, (off_t)at) == 8 * (ssize_t)places);
    ck_assert_uint_lt(at, (f->size[MNI_ROWS] + f->size[MNI_SIMPLICES]) * 3 / 5);
    free(place);
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
    f->file.fd = open(fixture_path("rows"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    f->file.row_offset = at_rows;
    f->file.simplex_offset = at_rows + f->size[MNI_ROWS] + gap;
    ck_assert_int_ge(f->file.fd, 0);
    write_section(f, MNI_ROWS);
    write_section(f, MNI_SIMPLICES);
    pack_tree(f);
}

static void close_filed(filed *f) {
    close(f->file.fd);
    close(f->packed.fd);
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
    mni_rows_near near;
    mni_rows_run run = {0};
    mn_status st = {0};
    uint64_t state = fixture_seed(11);
    make_filed(1, 60, &f);
    const mni_row *row = f.memory.row;
    const mni_row_simplex *simplex = f.memory.simplex;
    const uint64_t budget[] = {0, 1 << 17, 1 << 24};
    const mni_rows_source *source = _i < 3 ? &f.file : _i < 6 ? &f.packed : &f.memory;
    ck_assert(mni_rows_open(&rows, source, budget[_i % 3], &st) == MN_OK);
    ck_assert(mni_rows_near_open(&near, &rows));
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
        ck_assert(mni_rows_near_get(&near, at, &got, &end));
        ck_assert(memcmp(&got, &row[at], sizeof got) == 0);
        ck_assert_uint_eq(end, got.simplex_start + count);
        s = mni_rows_near_simplices(&near, got.simplex_start, count, room);
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
    ck_assert(mni_rows_near_simplices(&near, f.memory.simplices, 1, NULL) == NULL);
    ck_assert(mni_rows_near_simplices(&near, MN_NONE, MN_NONE, NULL) == NULL);
    ck_assert(mni_rows_trouble(&rows, &st) == MN_OK);
    if (_i == 2) /* room for all: nothing is read twice */
        ck_assert_uint_eq(rows.bytes_read, f.size[MNI_ROWS] + f.size[MNI_SIMPLICES]);
    else if (_i < 2)
        ck_assert_uint_gt(rows.bytes_read, f.size[MNI_ROWS]);
    mni_rows_near_close(&near);
    mni_rows_run_free(&run);
    mni_rows_close(&rows);
    close_filed(&f);
}
END_TEST

/* Any rows and simplices, sound or not: numbers from all over what a word holds, floats on a grid,
 * far out on it, and on none. */
START_TEST(what_is_packed_comes_back) {
    uint64_t state = fixture_seed(13);
    for (uint32_t round = 0; round < 2000; round++) {
        mni_row row[MNI_ROWS_PAGE], back[MNI_ROWS_PAGE];
        mni_row_simplex simplex[MNI_SIMPLICES_PAGE], again[MNI_SIMPLICES_PAGE];
        unsigned char bytes[MNI_PAGE_PACKED_MAX];
        const uint32_t count = 1 + fixture_random(&state) % MNI_ROWS_PAGE, small = round % 31,
                       first = fixture_random(&state) >> (1 + small), kind = round % 3;
        const float step = kind == 2 ? 0.3f : 0x1p-10f;
        uint32_t start = 0;
        for (uint32_t i = 0; i < count; i++) {
            mni_row *r = &row[i];
            *r = (mni_row){.left = MN_NONE, .right = MN_NONE};
            for (int c = 0; c < 3; c++)
                r->position[c] = kind == 1 ? (float)fixture_random(&state) * 0x1p20f
                                           : (float)(int32_t)(fixture_random(&state) >> small) *
                                                 (kind == 0 ? step : 0x1p-140f);
            r->rgba = fixture_random(&state);
            r->simplex_start = start += fixture_random(&state) >> (8 + small / 2);
            r->order = first + i == 0 ? 0 : fixture_random(&state) >> small;
            if (r->order == 0)
                continue;
            const uint32_t at = first + i;
            r->leaf_lo = at - fixture_random(&state) % (at + 1);
            r->leaf_hi = at + (fixture_random(&state) >> small);
            r->left = at == 0 || i % 3 == 0 ? MN_NONE : fixture_random(&state) % at;
            r->right = i % 5 == 0 ? MN_NONE : at + 1 + (fixture_random(&state) >> 2);
            r->switch_value = (float)fixture_random(&state) * (i % 2 ? 1 : 0x1p-149f);
            r->radius = (float)(fixture_random(&state) >> small);
            memset(&r->cone, (int)(fixture_random(&state) & 0xff), sizeof r->cone);
        }
        ck_assert_uint_le(mni_rows_pack(bytes, row, first, count, step), sizeof bytes);
        mni_rows_unpack(bytes, back, first, count, step);
        ck_assert(memcmp(row, back, count * sizeof *row) == 0);
        for (uint32_t i = 0; i < MNI_SIMPLICES_PAGE; i++)
            for (int c = 0; c < 3; c++)
                simplex[i].corner[c] =
                    c == 2 && i % 9 == 0 ? MN_NONE : fixture_random(&state) >> small;
        ck_assert_uint_le(mni_simplices_pack(bytes, simplex, MNI_SIMPLICES_PAGE), sizeof bytes);
        mni_simplices_unpack(bytes, again, MNI_SIMPLICES_PAGE);
        ck_assert(memcmp(simplex, again, sizeof simplex) == 0);
    }
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
        ck_assert_msg(fixture_load(fixture_path("a.mnt"), &back, &st) == MN_OK, "%s", st.text);
        fixture_same(&f.tree, &back);
        mn_tree_free(&back);
        for (uint32_t m = 0; m < 3; m++) {
            mn_block_counts counts;
            desc.ram_bytes = m == 0 ? 9 << 20 : m == 1 ? (9 << 20) + (1 << 18) : 0;
            desc.threads = m;
            ck_assert_msg(block(&f, &f.file, "b.mnt", &desc, &b, &counts, &st) == MN_OK, "%s",
                          st.text);
            ck_assert(memcmp(&a, &b, sizeof a) == 0);
            ck_assert(same_files("a.mnt", "b.mnt"));
            ck_assert_uint_ge(counts.bytes_read, f.size[MNI_ROWS] + f.size[MNI_SIMPLICES]);
            ck_assert_uint_eq(counts.bytes_written, b.file_bytes);
            ck_assert_msg(block(&f, &f.packed, "b.mnt", &desc, &b, NULL, &st) == MN_OK, "%s",
                          st.text);
            ck_assert(same_files("a.mnt", "b.mnt"));
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
                              .ram_bytes = 8 << 20};
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
            ck_assert_msg(fixture_load(fixture_path("lie.mnt"), &back, &st) == MN_OK,
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
    ck_assert(mni_found_shape(&found, &rows, NULL, &h, &st) == MN_OK);
    simplex[0].corner[2] = f.tree.leaves;
    ck_assert_int_eq(mni_found_shape(&found, &rows, NULL, &h, &st), MN_FAILED);
    ck_assert_str_eq(st.text, "the tree has changed while it was read");
    mni_rows_close(&rows);
    close_filed(&f);
}
END_TEST

/* Writes over all rows, until the file's clock says so. */
static bool write_over(void *context, const char *phase, uint64_t done, uint64_t total) {
    const filed *f = context;
    unsigned char noise[4096];
    (void)phase, (void)done, (void)total;
    memset(noise, 0xa5, sizeof noise);
    do
        for (size_t at = 0; at + sizeof noise <= f->size[MNI_ROWS]; at += sizeof noise)
            ck_assert(pwrite(f->file.fd, noise, sizeof noise, (off_t)(at_rows + at)) ==
                      (ssize_t)sizeof noise);
    while (mni_rows_stamp(f->file.fd) == f->file.stamp);
    return true;
}

/* Rows that were checked are trusted when they are read again: another's by then ended the program.
 */
START_TEST(a_file_that_is_written_to_is_told) {
    filed f;
    make_filed(0, 150, &f);
    f.file.stamp = mni_rows_stamp(f.file.fd);
    for (uint32_t threads = 1; threads <= 2; threads++) {
        mn_status st = {0};
        const mn_block_desc desc = {.ram_bytes = 8 << 20,
                                    .threads = threads,
                                    .progress = write_over,
                                    .progress_context = &f};
        write_section(&f, MNI_ROWS);
        f.file.stamp = mni_rows_stamp(f.file.fd);
        ck_assert_int_eq(block(&f, &f.file, "w.mnt", &desc, NULL, NULL, &st), MN_BAD_INPUT);
        ck_assert_msg(strstr(st.text, "changed while it was read") != NULL, "%s", st.text);
    }
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
    mn_block_desc desc = {.ram_bytes = 8 << 20};
    make_filed(0, 20, &f);
    off_t whole = lseek(f.file.fd, 0, SEEK_END);
    for (off_t length = 0; length < whole; length += 1000) {
        mn_status st = {0};
        write_section(&f, MNI_ROWS);
        write_section(&f, MNI_SIMPLICES);
        ck_assert_int_eq(ftruncate(f.file.fd, length), 0);
        desc.threads = 1 + (length / 1000) % 2;
        ck_assert_int_eq(block(&f, &f.file, "e.mnt", &desc, NULL, NULL, &st), MN_FAILED);
        ck_assert_msg(strstr(st.text, "ends there") != NULL, "%s", st.text);
        ck_assert_int_ne(access(fixture_path("e.mnt"), F_OK), 0);
    }
    mn_status st = {0};
    int fd = f.file.fd;
    f.file.fd = -1;
    ck_assert_int_eq(block(&f, &f.file, "e.mnt", &desc, NULL, NULL, &st), MN_FAILED);
    ck_assert(strstr(st.text, strerror(EBADF)) != NULL);
    f.file.fd = fd;
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
    tcase_add_loop_test(t, rows_are_read_as_they_stand, 0, 7);
    tcase_add_test(t, what_is_packed_comes_back);
    tcase_add_loop_test(t, the_same_bytes_in_any_memory, 0, KINDS);
    tcase_add_loop_test(t, lies_are_found_out, 0, KINDS);
    tcase_add_test(t, a_tree_that_changes_is_told);
    tcase_add_test(t, a_file_that_is_written_to_is_told);
    tcase_add_test(t, heads_that_do_not_fit_are_refused);
    tcase_add_test(t, files_that_end_early_are_told);
    tcase_add_test(t, nothing_is_lost_by_a_full_disk);
    suite_add_tcase(s, t);
    return suite_run(s);
}
