/* Goal: what is compressed comes back as it was, and no extent or table, whatever stands in it,
 * does more harm than to be refused. Method: random rows and blocks there and back; every byte of
 * extents changed, in rooms with guards; tables that lie in each way there is; planes by their
 * definition. */
#include <check.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "extents.h"
#include "frame.h"
#include "suite.h"

enum { BLOCK_BYTES = 8192, GUARD_BYTES = 64, GUARD = 0x5a, BLOCKS = 200, SLOTS = 4 };

/* ---- planes --------------------------------------------------------------------------------- */

START_TEST(planes_there_and_back) {
    static const uint32_t widths[] = {1, 7, 8, 9, 63, 64, 65, 127, 128, 129, 191, 200, 511, 1024};
    for (size_t w = 0; w < sizeof widths / sizeof widths[0]; w++) {
        const uint32_t bits = widths[w];
        for (uint32_t groups = 1; groups < 40; groups += 1 + groups / 3) {
            const size_t bytes =
                (size_t)groups * bits; /* exact: a sanitizer sees what is past it */
            uint8_t *rows = malloc(bytes), *planes = malloc(bytes), *back = malloc(bytes);
            for (size_t i = 0; i < bytes; i++)
                rows[i] = (uint8_t)rand();
            mni_planes_of_rows(rows, groups, bits, planes);
            for (uint32_t row = 0; row < 8 * groups; row++)
                for (uint32_t j = 0; j < bits; j++) {
                    const size_t at = (size_t)row * bits + j;
                    ck_assert_int_eq(rows[at / 8] >> at % 8 & 1,
                                     planes[(size_t)j * groups + row / 8] >> row % 8 & 1);
                }
            mni_planes_to_rows(planes, groups, bits, back);
            ck_assert_mem_eq(rows, back, bytes);
            free(rows);
            free(planes);
            free(back);
        }
    }
}
END_TEST

/* ---- a file --------------------------------------------------------------------------------- */

typedef struct stage {
    char path[32];
    mn_header header;
    unsigned char block[BLOCKS][BLOCK_BYTES];
    mn_block_ref ref[BLOCKS];
    uint16_t *table;
    uint32_t raw; /* blocks that could not be made shorter */
    mni_arena arena;
    mni_extents extents;
    mn_status st;
} stage;

/* Of the kinds that there are: noise, zeroes, and rows that are alike in some of their bits. */
static mni_rows_place fill_block(unsigned char *block, uint32_t length_bytes) {
    const int kind = rand() % 3;
    mni_rows_place rows = {0};
    memset(block, 0, length_bytes);
    if (kind == 0)
        for (uint32_t i = 0; i < length_bytes; i++)
            block[i] = (unsigned char)rand();
    if (kind != 2)
        return rows;
    rows =
        (mni_rows_place){.at = 8 * (uint32_t)(rand() % 30), .bits = 1 + (uint32_t)(rand() % 300)};
    rows.groups = (length_bytes - rows.at) / rows.bits;
    for (uint32_t i = 0; i < rows.groups * rows.bits; i++)
        block[rows.at + i] = (unsigned char)(rand() & 0x11);
    return rows;
}

static void write_all(int fd, const void *bytes, size_t count, uint64_t at) {
    ck_assert_int_eq(pwrite(fd, bytes, count, (off_t)at), (ssize_t)count);
}

static void make_file(stage *s) {
    mni_presser presser;
    s->header = (mn_header){.zstd_level = 3, .blocks = BLOCKS};
    uint32_t pages = 1;
    for (uint32_t b = 0; b < BLOCKS; b++) {
        s->ref[b] = (mn_block_ref){pages, 1 + (uint32_t)(rand() % 2)};
        pages += s->ref[b].pages;
    }
    s->header.block_bytes_max = BLOCK_BYTES;
    s->header.file_bytes = (uint64_t)pages * MN_PAGE_BYTES;
    s->table = calloc(pages, sizeof *s->table);
    strcpy(s->path, "/tmp/extents.XXXXXX");
    int fd = mkstemp(s->path);
    ck_assert_int_ge(fd, 0);
    uint64_t at = mni_extents_begin(pages);
    ck_assert_int_eq(mni_presser_open(&presser, 3, BLOCK_BYTES, &s->st), MN_OK);
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const uint32_t length_bytes = s->ref[b].pages * MN_PAGE_BYTES;
        const void *extent;
        mni_rows_place rows = fill_block(s->block[b], length_bytes);
        uint32_t bytes = mni_presser_make(&presser, s->block[b], length_bytes, &rows, &extent);
        ck_assert_uint_le(bytes, length_bytes);
        ck_assert_uint_eq(bytes % MNI_SECTOR_BYTES, 0);
        s->raw += bytes == length_bytes;
        write_all(fd, extent, bytes, at);
        s->table[s->ref[b].id] = (uint16_t)(bytes / MNI_SECTOR_BYTES);
        at += bytes;
        if (bytes > s->header.extent_bytes_max)
            s->header.extent_bytes_max = bytes;
    }
    mni_presser_close(&presser);
    write_all(fd, s->table, (size_t)2 * pages, MN_PAGE_BYTES);
    s->header.stored_bytes = (at + MN_PAGE_BYTES - 1) / MN_PAGE_BYTES * MN_PAGE_BYTES;
    s->header.extents_checksum = XXH3_64bits(s->table, (size_t)2 * pages);
    ck_assert_int_eq(ftruncate(fd, (off_t)s->header.stored_bytes), 0);
    close(fd);
    ck_assert_uint_gt(s->raw, 0);
    ck_assert_uint_lt(s->raw, BLOCKS);
}

static mn_code open_extents(stage *s) {
    ck_assert_int_eq(mni_arena_open(&s->arena, mni_extents_need(&s->header, SLOTS), NULL), MN_OK);
    s->st = (mn_status){0};
    mn_code code = mni_extents_open(&s->extents, s->path, &s->header, SLOTS, &s->arena, &s->st);
    mni_arena_seal(&s->arena);
    return code;
}

static void set_up(stage *s) {
    memset(s, 0, sizeof *s);
    make_file(s);
    ck_assert_msg(open_extents(s) == MN_OK, "%s", s->st.text);
}

static void tear_down(stage *s) {
    mni_arena_close(&s->arena);
    free(s->table);
    unlink(s->path);
}

static stage stage_of;

START_TEST(blocks_come_back) {
    stage *s = &stage_of;
    mni_in in;
    unsigned char bytes[BLOCK_BYTES];
    uint64_t read_bytes = 0, expected = 0;
    set_up(s);
    ck_assert_int_eq(mni_in_open(&in, s->path, &s->st), MN_OK);
    mn_block_ref next = {0};
    for (uint32_t b = 0; b < BLOCKS; b++) {
        next = mni_extents_next(&s->extents, next.id + next.pages);
        ck_assert_uint_eq(next.id, s->ref[b].id);
        if (b + 1 < BLOCKS)
            ck_assert_uint_eq(next.pages, s->ref[b].pages);
        ck_assert_int_eq(mni_extents_read(&s->extents, &in, s->ref[b], bytes, &read_bytes),
                         s->ref[b].pages * MN_PAGE_BYTES);
        ck_assert_mem_eq(bytes, s->block[b], s->ref[b].pages * MN_PAGE_BYTES);
        expected += (uint64_t)s->table[s->ref[b].id] * MNI_SECTOR_BYTES;
        /* what is not there, and what has another length than somebody says */
        mn_block_ref none = {s->ref[b].id + 1, 1}, other = {s->ref[b].id, 3 - s->ref[b].pages};
        if (s->ref[b].pages == 2) {
            ck_assert_uint_eq(mni_extents_find(&s->extents, none).length_bytes, 0);
            ck_assert_int_eq(mni_extents_read(&s->extents, &in, none, bytes, &read_bytes),
                             -EBADMSG);
        }
        uint64_t ignored = 0;
        ck_assert_int_eq(mni_extents_read(&s->extents, &in, other, bytes, &ignored), -EBADMSG);
    }
    ck_assert_uint_eq(read_bytes, expected);
    const uint32_t past[] = {0, s->extents.pages, s->extents.pages + 1, UINT32_MAX};
    for (int i = 0; i < 4; i++)
        ck_assert_uint_eq(mni_extents_find(&s->extents, (mn_block_ref){past[i], 1}).length_bytes,
                          0);
    mni_in_close(&in);
    tear_down(s);
}
END_TEST

/* Where only pages can be read there are fewer slots; what is around an extent fits in one. */
START_TEST(slots) {
    stage *s = &stage_of;
    set_up(s);
    ck_assert_uint_eq(s->extents.slot_count, SLOTS);
    ck_assert_uint_eq(s->extents.slot_bytes, s->header.extent_bytes_max);
    mni_extents_align(&s->extents, MN_PAGE_BYTES);
    ck_assert_uint_ge(s->extents.slot_count, 1);
    ck_assert_uint_le((uint64_t)s->extents.slot_count * s->extents.slot_bytes,
                      s->extents.slots_bytes);
    for (uint32_t b = 0; b < BLOCKS; b++) {
        mni_extent e = mni_extents_find(&s->extents, s->ref[b]);
        uint64_t from = e.offset / MN_PAGE_BYTES * MN_PAGE_BYTES;
        uint64_t to =
            (e.offset + e.length_bytes + MN_PAGE_BYTES - 1) / MN_PAGE_BYTES * MN_PAGE_BYTES;
        ck_assert_uint_le(to - from, s->extents.slot_bytes);
        ck_assert_uint_le(to, s->header.stored_bytes);
    }
    tear_down(s);
}
END_TEST

/* ---- hostile bytes -------------------------------------------------------------------------- */

/* Unpacks into a room with guards; the extent lies in memory of just its length. */
static bool unpack_guarded(stage *s, const unsigned char *extent, uint32_t extent_bytes,
                           uint32_t length_bytes, unsigned char *out) {
    unsigned char *exact = malloc(extent_bytes);
    unsigned char *room = malloc(length_bytes + 2 * GUARD_BYTES);
    memcpy(exact, extent, extent_bytes);
    memset(room, GUARD, length_bytes + 2 * GUARD_BYTES);
    bool good =
        mni_extents_unpack(&s->extents, exact, extent_bytes, room + GUARD_BYTES, length_bytes);
    for (uint32_t i = 0; i < GUARD_BYTES; i++) {
        ck_assert_int_eq(room[i], GUARD);
        ck_assert_int_eq(room[GUARD_BYTES + length_bytes + i], GUARD);
    }
    memcpy(out, room + GUARD_BYTES, length_bytes);
    free(exact);
    free(room);
    return good;
}

START_TEST(damage_is_refused_or_harmless) {
    stage *s = &stage_of;
    mni_in in;
    unsigned char extent[BLOCK_BYTES], out[BLOCK_BYTES];
    uint32_t refused = 0, tried = 0;
    set_up(s);
    ck_assert_int_eq(mni_in_open(&in, s->path, &s->st), MN_OK);
    for (uint32_t b = 0; b < BLOCKS; b++) {
        const mni_extent e = mni_extents_find(&s->extents, s->ref[b]);
        const uint32_t length_bytes = s->ref[b].pages * MN_PAGE_BYTES;
        if (e.length_bytes == length_bytes)
            continue;
        ck_assert_int_eq(mni_in_read(&in, e.offset, extent, e.length_bytes), e.length_bytes);
        for (uint32_t i = 0; i < e.length_bytes; i += i < 64 ? 1 : 37) {
            const unsigned char was = extent[i];
            extent[i] ^= (unsigned char)(1 + rand() % 255);
            tried++;
            refused += !unpack_guarded(s, extent, e.length_bytes, length_bytes, out);
            extent[i] = was;
        }
        for (int i = 0; i < 30; i++) { /* a head of any numbers */
            unsigned char head[MNI_EXTENT_HEAD_BYTES];
            memcpy(head, extent, sizeof head);
            for (size_t k = 0; k < sizeof head; k++)
                if (rand() % 3 == 0)
                    extent[k] = (unsigned char)rand();
            (void)unpack_guarded(s, extent, e.length_bytes, length_bytes, out);
            memcpy(extent, head, sizeof head);
        }
        ck_assert(unpack_guarded(s, extent, e.length_bytes, length_bytes, out));
        ck_assert_mem_eq(out, s->block[b], length_bytes);
        /* cut, and of another length */
        for (uint32_t cut = MNI_SECTOR_BYTES; cut < e.length_bytes; cut += MNI_SECTOR_BYTES)
            ck_assert(!unpack_guarded(s, extent, cut, length_bytes, out));
    }
    ck_assert_uint_gt(refused, tried / 4); /* what is not is for the block's own checksum to find */
    mni_in_close(&in);
    tear_down(s);
}
END_TEST

/* A table may say that a block is longer than any, and its frame be so: who reads whole files takes
 * its word. The room for planes is as long as the header's longest. */
START_TEST(longer_than_any_block) {
    stage *s = &stage_of;
    mni_in in;
    unsigned char out[BLOCK_BYTES];
    uint64_t read_bytes = 0;
    set_up(s);
    ck_assert_int_eq(mni_in_open(&in, s->path, &s->st), MN_OK);
    for (uint32_t b = 0; b < BLOCKS; b++) { /* 2³² bytes more */
        const mn_block_ref longer = {s->ref[b].id, s->ref[b].pages + (1u << 20)};
        ck_assert_int_eq(mni_extents_read(&s->extents, &in, longer, out, &read_bytes), -EBADMSG);
    }
    s->header.block_bytes_max = MN_PAGE_BYTES;
    mni_arena_close(&s->arena);
    ck_assert_int_eq(open_extents(s), MN_OK);
    for (uint32_t b = 0; b < BLOCKS; b++)
        ck_assert_int_eq(mni_extents_read(&s->extents, &in, s->ref[b], out, &read_bytes),
                         s->ref[b].pages == 1 ? MN_PAGE_BYTES : -EBADMSG);
    mni_in_close(&in);
    tear_down(s);
}
END_TEST

/* ---- tables that lie ------------------------------------------------------------------------ */

static void rewrite_table(stage *s) {
    FILE *f = fopen(s->path, "r+b");
    ck_assert_ptr_nonnull(f);
    const size_t pages = s->header.file_bytes / MN_PAGE_BYTES;
    ck_assert_int_eq(fseek(f, MN_PAGE_BYTES, SEEK_SET), 0);
    ck_assert_uint_eq(fwrite(s->table, sizeof *s->table, pages, f), pages);
    ck_assert_int_eq(fclose(f), 0);
    s->header.extents_checksum = XXH3_64bits(s->table, 2 * pages);
}

static void expect_bad(stage *s, const char *word) {
    mni_arena_close(&s->arena);
    ck_assert_int_eq(open_extents(s), MN_BAD_INPUT);
    ck_assert_msg(strstr(s->st.text, word) != NULL, "%s", s->st.text);
}

START_TEST(tables_that_lie) {
    stage *s = &stage_of;
    set_up(s);
    const uint32_t first = s->ref[0].id, last = s->ref[BLOCKS - 1].id;
    s->header.extents_checksum ^= 1;
    expect_bad(s, "checksum");
    s->table[0] = 1; /* a block where the header is */
    rewrite_table(s);
    expect_bad(s, "counts");
    s->table[0] = 0;
    const uint16_t was = s->table[last];
    s->table[last] = 0; /* one fewer */
    rewrite_table(s);
    expect_bad(s, "counts");
    s->table[last] = UINT16_MAX; /* longer than what is read into */
    rewrite_table(s);
    expect_bad(s, "longest");
    s->table[last] = was;
    s->table[first]--; /* an end that is not the file's */
    s->header.stored_bytes += MN_PAGE_BYTES;
    rewrite_table(s);
    expect_bad(s, s->table[first] == 0 ? "counts" : "end");
    s->table[first]++;
    s->header.stored_bytes -= MN_PAGE_BYTES;
    rewrite_table(s);
    mni_arena_close(&s->arena);
    ck_assert_int_eq(open_extents(s), MN_OK);
    /* the file ends in the table */
    ck_assert_int_eq(truncate(s->path, MN_PAGE_BYTES + 10), 0);
    expect_bad(s, "ends");
    ck_assert_int_eq(unlink(s->path), 0);
    expect_bad(s, s->path);
    tear_down(s);
}
END_TEST

/* Of a file that is not compressed nothing is taken, and blocks are where their ids say. */
START_TEST(plain_files) {
    mn_header header = {.file_bytes = 10 * MN_PAGE_BYTES, .block_bytes_max = MN_PAGE_BYTES};
    mni_extents extents;
    ck_assert_uint_eq(mni_extents_need(&header, SLOTS), 0);
    ck_assert_uint_eq(mni_stored_bytes(&header), header.file_bytes);
    ck_assert_int_eq(mni_extents_open(&extents, "/nowhere", &header, SLOTS, NULL, NULL), MN_OK);
    mni_extent e = mni_extents_find(&extents, (mn_block_ref){3, 2});
    ck_assert_uint_eq(e.offset, 3 * MN_PAGE_BYTES);
    ck_assert_uint_eq(e.length_bytes, 2 * MN_PAGE_BYTES);
}
END_TEST

int main(void) {
    const char *given = getenv("MN_SEED");
    const unsigned seed = given != NULL ? (unsigned)strtoul(given, NULL, 0) : 1;
    printf("MN_SEED=%u\n", seed);
    srand(seed);
    Suite *suite = suite_create("extents");
    TCase *tc = tcase_create("extents");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, planes_there_and_back);
    tcase_add_test(tc, blocks_come_back);
    tcase_add_test(tc, slots);
    tcase_add_test(tc, damage_is_refused_or_harmless);
    tcase_add_test(tc, longer_than_any_block);
    tcase_add_test(tc, tables_that_lie);
    tcase_add_test(tc, plain_files);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
