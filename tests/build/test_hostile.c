/* Goal: bytes of a .mnt or .vdt cannot crash, hang or mislead whoever reads them.
 * Method: every byte of small files flipped (the checksums must tell); then seeded lies under good
 * checksums: either they are found out, or what is read is the tree that was written. */
#include <check.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "block.h"
#include "frame.h"
#include "suite.h"
#include "tree_fixture.h"
#include "vdt_header.h"

enum { BLOCKS_MAX = 256 };

typedef struct image {
    unsigned char *bytes;
    size_t size;
    mn_header header;
    mn_tree tree; /* what it holds */
    mn_block_ref block[BLOCKS_MAX];
    uint32_t blocks;
} image;

static void load_bytes(const char *path, image *im) {
    FILE *f = fopen(path, "rb");
    ck_assert(f != NULL);
    fseek(f, 0, SEEK_END);
    im->size = (size_t)ftell(f);
    rewind(f);
    im->bytes = malloc(im->size);
    ck_assert(fread(im->bytes, 1, im->size, f) == im->size);
    fclose(f);
}

/* Over what stands there: some file systems sync a file that is emptied and written again. */
static void store_bytes(const char *path, const unsigned char *bytes, size_t size) {
    int fd = open(path, O_WRONLY | O_CREAT, 0600);
    ck_assert_int_ge(fd, 0);
    ck_assert_int_eq(pwrite(fd, bytes, size, 0), (ssize_t)size);
    if (lseek(fd, 0, SEEK_END) != (off_t)size)
        ck_assert_int_eq(ftruncate(fd, (off_t)size), 0);
    ck_assert_int_eq(close(fd), 0);
}

static void find_blocks(image *im) {
    for (uint32_t page = 1; page < im->size / MN_PAGE_BYTES;) {
        uint32_t pages;
        memcpy(&pages, im->bytes + (size_t)page * MN_PAGE_BYTES + 28, sizeof pages);
        ck_assert(im->blocks < BLOCKS_MAX && pages > 0);
        im->block[im->blocks++] = (mn_block_ref){page, pages};
        page += pages;
    }
    ck_assert_uint_eq(im->blocks, im->header.blocks);
}

/* A small .mnt: a sheet in packed blocks, or a book, whose spine overflows, in levels. */
static void make_mnt(int kind, image *im) {
    const char *path = fixture_path("hostile.mnt");
    mn_mesh mesh;
    mn_status st = {0};
    memset(im, 0, sizeof *im);
    if (kind == 0)
        fixture_sheet(12, 3, true, &mesh);
    else
        fixture_book(700, &mesh);
    fixture_random_tree(&mesh, 5, &im->tree);
    mn_block_desc desc = {.block_bytes = 4096};
    ck_assert_msg(mn_block_write(path, &im->tree, &desc, &im->header, NULL, &st) == MN_OK, "%s",
                  st.text);
    ck_assert(kind == 0 || im->header.overflow_max > 0);
    mn_mesh_free(&mesh);
    load_bytes(path, im);
    find_blocks(im);
}

static void free_image(image *im) {
    free(im->bytes);
    mn_tree_free(&im->tree);
}

static mn_code verify(const char *path, mn_status *st) {
    mn_verify_result result;
    memset(st, 0, sizeof *st);
    return mn_verify(path, NULL, &result, st);
}

START_TEST(every_flipped_byte_of_a_mnt_is_noticed) {
    image im;
    mn_status st;
    const char *path = fixture_path("flipped.mnt");
    make_mnt(_i, &im);
    store_bytes(path, im.bytes, im.size);
    ck_assert_msg(verify(path, &st) == MN_OK, "%s", st.text);
    int fd = open(path, O_WRONLY);
    ck_assert_int_ge(fd, 0);
    size_t step = im.size > 40000 ? 7 : 1; /* every one of a small file */
    for (size_t at = 0; at < im.size; at += step) {
        unsigned char flipped = im.bytes[at] ^ (unsigned char)(1u << at % 8);
        ck_assert_int_eq(pwrite(fd, &flipped, 1, (off_t)at), 1);
        ck_assert_msg(verify(path, &st) == MN_BAD_INPUT, "byte %zu", at);
        ck_assert_ptr_nonnull(strstr(st.text, "flipped.mnt"));
        ck_assert_int_eq(pwrite(fd, &im.bytes[at], 1, (off_t)at), 1);
    }
    close(fd);
    free_image(&im);
}
END_TEST

START_TEST(a_cut_mnt_is_refused) {
    image im;
    mn_status st;
    const char *path = fixture_path("cut.mnt");
    make_mnt(0, &im);
    for (size_t size = 0; size < im.size; size += size < 5000 ? 211 : 4096) {
        store_bytes(path, im.bytes, size);
        ck_assert_int_eq(verify(path, &st), MN_BAD_INPUT);
    }
    free_image(&im);
}
END_TEST

START_TEST(blocks_of_another_file_or_place_are_refused) {
    image im;
    mn_status st;
    const char *path = fixture_path("swapped.mnt");
    make_mnt(1, &im);
    ck_assert_uint_ge(im.blocks, 3);
    ck_assert(im.block[im.blocks - 1].pages == 1 && im.block[im.blocks - 2].pages == 1);
    size_t last = (size_t)im.block[im.blocks - 1].id * MN_PAGE_BYTES;
    size_t other = (size_t)im.block[im.blocks - 2].id * MN_PAGE_BYTES;
    memcpy(im.bytes + last, im.bytes + other, MN_PAGE_BYTES);
    store_bytes(path, im.bytes, im.size);
    ck_assert_int_eq(verify(path, &st), MN_BAD_INPUT);
    ck_assert_msg(strstr(st.text, "another place") != NULL, "%s", st.text);
    free_image(&im);
}
END_TEST

/* ---- lies under good checksums --------------------------------------------------------------- */

static void reseal_block(unsigned char *at, uint32_t pages) {
    uint64_t seed; /* magic and kind */
    memcpy(&seed, at, sizeof seed);
    uint64_t checksum = XXH3_64bits_withSeed(at + 16, (size_t)pages * MN_PAGE_BYTES - 16, seed);
    memcpy(at + 8, &checksum, sizeof checksum);
}

/* One lie somewhere in [from, to): a bit, a byte, or a word. */
static void lie(unsigned char *bytes, uint32_t from, uint32_t to, uint64_t *state) {
    uint32_t at = from + fixture_random(state) % (to - from), word;
    switch (fixture_random(state) % 5) {
    case 0:
        bytes[at] ^= (unsigned char)(1u << fixture_random(state) % 8);
        break;
    case 1:
        bytes[at] = (unsigned char)fixture_random(state);
        break;
    case 2:
        bytes[at] = fixture_random(state) % 2 ? 0 : 0xff;
        break;
    default:
        at = at / 4 * 4;
        memcpy(&word, bytes + at, sizeof word);
        word += fixture_random(state) % 2 ? fixture_random(state) % 5 - 2 : fixture_random(state);
        memcpy(bytes + at, &word, sizeof word);
    }
}

/* Reads all that a view that passed the checks gives. */
static void read_view(const unsigned char *bytes, uint32_t length, const mni_block_limits *limits) {
    mni_block view;
    mni_overflow overflow;
    uint32_t corner[3];
    if (mni_block_open(&view, bytes, length, limits, NULL, 0)) {
        mni_frame frame;
        mni_frame_get(bytes, &frame);
        for (uint32_t i = 0; i < view.subtrees; i++) {
            mni_subtree s;
            mni_block_subtree(&view, i, &s);
            ck_assert(s.node < view.nodes && s.leaf_lo < s.leaf_hi && s.leaf_hi <= limits->leaves);
        }
        ck_assert_uint_le(view.exits, MNI_BLOCK_EXITS_MAX);
        for (uint32_t i = 0; i < view.exits; i++) {
            mni_child c;
            mni_block_exit(&view, i, &c);
            ck_assert(c.facts.order >= limits->leaves && c.facts.order < limits->nodes);
            ck_assert(c.ref < frame.refs);
        }
        mni_walk walk;
        mni_node n;
        uint32_t i, next = 0;
        mni_walk_begin(&walk, &view);
        while (mni_walk_next(&walk, &i, &n)) {
            ck_assert_uint_eq(i, next++);
            ck_assert(n.facts.order >= limits->leaves && n.facts.order < limits->nodes);
            ck_assert(n.leaf_mid < limits->leaves);
            ck_assert(n.left.kind != MNI_CHILD_INNER || n.left.node < view.nodes);
            ck_assert(n.right.kind != MNI_CHILD_INNER || n.right.node < view.nodes);
            ck_assert(n.left.kind != MNI_CHILD_SUBTREE || n.left.ref < frame.refs);
            ck_assert(n.right.kind != MNI_CHILD_SUBTREE || n.right.ref < frame.refs);
            for (uint32_t s = 0; s < n.simplex_count; s++) {
                mni_block_simplex(&view, &n, s, corner);
                ck_assert(corner[0] < limits->leaves && corner[1] < limits->leaves &&
                          (corner[2] < limits->leaves || corner[2] == MN_NONE));
            }
        }
        ck_assert_uint_eq(next, view.nodes);
    }
    if (mni_overflow_open(&overflow, bytes, length, limits, NULL, 0))
        for (uint32_t s = 0; s < overflow.simplices; s++) {
            mni_overflow_simplex(&overflow, s, corner);
            ck_assert(corner[0] < limits->leaves && corner[1] < limits->leaves);
        }
}

START_TEST(lying_blocks_are_read_safely) {
    image im;
    uint64_t state = fixture_seed(11);
    make_mnt(_i, &im);
    const mni_block_limits limits = mni_block_limits_of(&im.header);
    for (int round = 0; round < 20000; round++) {
        mn_block_ref ref = im.block[fixture_random(&state) % im.blocks];
        uint32_t length = ref.pages * MN_PAGE_BYTES;
        unsigned char *bytes = malloc(length); /* of its own, so that a sanitizer sees its end */
        memcpy(bytes, im.bytes + (size_t)ref.id * MN_PAGE_BYTES, length);
        for (uint32_t lies = 1 + fixture_random(&state) % 3; lies > 0; lies--)
            lie(bytes, 24, fixture_random(&state) % 4 ? 400 : length, &state);
        reseal_block(bytes, ref.pages);
        if (mni_frame_check(bytes, ref, im.header.build_id, im.size) == MNI_FRAME_OK)
            read_view(bytes, length, &limits);
        free(bytes);
    }
    free_image(&im);
}
END_TEST

START_TEST(lying_files_are_found_out_or_harmless) {
    image im;
    uint64_t state = fixture_seed(13);
    const char *path = fixture_path("lying.mnt");
    uint32_t harmless = 0;
    make_mnt(_i, &im);
    unsigned char *bytes = malloc(im.size);
    for (int round = 0; round < 1500; round++) {
        mn_block_ref ref = im.block[fixture_random(&state) % im.blocks];
        unsigned char *at = bytes + (size_t)ref.id * MN_PAGE_BYTES;
        mn_status st = {0};
        mn_tree back;
        memcpy(bytes, im.bytes, im.size);
        uint32_t payload;
        memcpy(&payload, at + 36, sizeof payload);
        lie(at, 24, fixture_random(&state) % 4 ? 400 : payload, &state);
        reseal_block(at, ref.pages);
        store_bytes(path, bytes, im.size);
        mn_code code = fixture_load(path, &back, &st);
        if (code == MN_OK) { /* unused bits, or what nobody reads */
            fixture_same(&im.tree, &back);
            mn_tree_free(&back);
            harmless++;
        } else {
            ck_assert_msg(code == MN_BAD_INPUT, "%d: %s", code, st.text);
            ck_assert_ptr_null(back.left);
        }
    }
    printf("%u of 1500 lies were harmless\n", harmless);
    ck_assert_uint_lt(harmless, 600);
    free(bytes);
    free_image(&im);
}
END_TEST

/* Counts, order and shape in the header, under a good checksum. */
START_TEST(lying_headers_are_found_out) {
    image im;
    uint64_t state = fixture_seed(17);
    const char *path = fixture_path("header.mnt");
    make_mnt(_i, &im);
    for (int round = 0; round < 1000; round++) {
        unsigned char page[MN_PAGE_BYTES];
        mn_status st = {0};
        uint64_t checksum = 0;
        mn_tree back;
        memcpy(page, im.bytes, sizeof page);
        lie(page, 24, 212, &state);
        memcpy(page + 16, &checksum, sizeof checksum);
        checksum = XXH3_64bits(page, sizeof page);
        memcpy(page + 16, &checksum, sizeof checksum);
        memcpy(im.bytes + 16, page + 16, 8); /* so that an unchanged page stays sound */
        unsigned char saved[MN_PAGE_BYTES];
        memcpy(saved, im.bytes, sizeof saved);
        memcpy(im.bytes, page, sizeof page);
        store_bytes(path, im.bytes, im.size);
        memcpy(im.bytes, saved, sizeof saved);
        mn_code code = fixture_load(path, &back, &st);
        if (code == MN_OK) {
            fixture_same(&im.tree, &back);
            mn_tree_free(&back);
        } else {
            ck_assert_msg(code == MN_BAD_INPUT, "%d: %s", code, st.text);
        }
    }
    free_image(&im);
}
END_TEST

/* ---- .vdt -------------------------------------------------------------------------------------
 */

/* contents: of the sections too. A lie of the header alone is left to the build id to tell: some of
 * its facts (origin, metric) nothing else contradicts. */
static void reseal_vdt(unsigned char *bytes, bool contents) {
    mni_vdt_header h;
    uint64_t sum[MNI_SECTIONS];
    memcpy(&h, bytes, sizeof h);
    for (int i = 0; i < MNI_SECTIONS && contents; i++)
        sum[i] = h.section[i].checksum =
            XXH3_64bits(bytes + h.section[i].offset, h.section[i].bytes);
    mn_tree facts = {.leaves = h.leaves,
                     .inner = h.inner,
                     .simplices = h.simplices,
                     .triangles = h.triangles,
                     .legal_last = h.legal_last,
                     .metric = (mn_metric)h.metric,
                     .grid_step = h.grid_step};
    memcpy(facts.origin, h.origin, sizeof facts.origin);
    if (contents)
        h.build_id = mni_build_id(&facts, h.flags & 1, sum, NULL);
    h.checksum = 0;
    h.checksum = XXH3_64bits(&h, sizeof h);
    memcpy(bytes, &h, sizeof h);
}

/* Row by row, as they are verified and blocks are made of them: what was accepted whole is
 * accepted, what was not is refused, or harmless in blocks. */
static void block_lies(const char *path, const char *out, mn_code whole) {
    mn_vdt *vdt;
    mn_status st = {0};
    ck_assert_msg((verify(path, &st) == MN_OK) == (whole == MN_OK), "%d: %s", whole, st.text);
    ck_assert_msg(whole == MN_OK || (st.code == MN_BAD_INPUT && strstr(st.text, "lying.vdt")), "%s",
                  st.text);
    st = (mn_status){0};
    mn_block_desc desc = {.block_bytes = 4096, .ram_bytes = 8 << 20};
    mn_code code = mn_vdt_open(path, NULL, &vdt, &st);
    if (code == MN_OK) {
        code = mn_vdt_block(vdt, out, &desc, NULL, NULL, &st);
        mn_vdt_close(vdt);
    }
    ck_assert_msg(code == MN_OK || code == MN_BAD_INPUT, "%d: %s", code, st.text);
    ck_assert_msg(code != MN_BAD_INPUT || strstr(st.text, "lying.vdt") != NULL, "%s", st.text);
    ck_assert_msg(whole != MN_OK || code == MN_OK, "%s", st.text);
    if (code == MN_OK)
        ck_assert_msg(verify(out, &st) == MN_OK, "%s", st.text);
}

START_TEST(lying_vdt_files_are_found_out) {
    image im = {0};
    mn_mesh mesh;
    mn_status st = {0};
    uint64_t state = fixture_seed(19);
    const char *path = fixture_path("lying.vdt"), *out = fixture_path("lying_vdt.mnt");
    uint32_t sound = 0;
    fixture_sheet(10, 3, true, &mesh);
    fixture_random_tree(&mesh, 5, &im.tree);
    ck_assert(mn_tree_write(path, &im.tree, &st) == MN_OK);
    load_bytes(path, &im);
    unsigned char *bytes = malloc(im.size);
    for (int round = 0; round < 3000; round++) {
        mn_tree back;
        memset(&st, 0, sizeof st);
        memcpy(bytes, im.bytes, im.size);
        uint32_t from = fixture_random(&state) % 4 ? sizeof(mni_vdt_header) : 24;
        lie(bytes, from, from == 24 ? offsetof(mni_vdt_header, section) : (uint32_t)im.size,
            &state);
        reseal_vdt(bytes, from != 24);
        store_bytes(path, bytes, im.size);
        mn_code code = mn_tree_read(path, &back, &st);
        block_lies(path, out, code);
        if (code == MN_OK && from == 24)
            fixture_same(&im.tree, &back);
        if (code == MN_OK) { /* another sound tree: a corner, a colour, a place of the grid */
            ck_assert(mn_tree_check(&back, &st) == MN_OK);
            mn_tree_free(&back);
            sound++;
        } else {
            ck_assert_msg(code == MN_BAD_INPUT, "%d: %s", code, st.text);
        }
    }
    printf("%u of 3000 lies made sound trees\n", sound);
    ck_assert_uint_lt(sound, 1500);
    free(bytes);
    mn_mesh_free(&mesh);
    free_image(&im);
}
END_TEST

START_TEST(every_flipped_byte_of_a_vdt_is_noticed) {
    image im = {0};
    mn_mesh mesh;
    mn_status st = {0};
    const char *path = fixture_path("flipped.vdt");
    fixture_sheet(9, 3, true, &mesh);
    fixture_tree(&mesh, &im.tree);
    ck_assert(mn_tree_write(path, &im.tree, &st) == MN_OK);
    load_bytes(path, &im);
    uint32_t harmless = 0;
    for (size_t at = 0; at < im.size; at++) {
        mn_tree back;
        memset(&st, 0, sizeof st);
        im.bytes[at] ^= 4;
        store_bytes(path, im.bytes, im.size);
        im.bytes[at] ^= 4;
        if (mn_tree_read(path, &back, &st) == MN_OK) {
            mn_tree_free(&back);
            harmless++;
        } else {
            ck_assert_int_eq(st.code, MN_BAD_INPUT);
        }
        ck_assert_int_eq(verify(path, &st), MN_BAD_INPUT);
    }
    ck_assert_uint_eq(harmless, 0);
    mn_mesh_free(&mesh);
    free_image(&im);
}
END_TEST

int main(void) {
    Suite *s = suite_create("hostile files");
    TCase *t = tcase_create("hostile");
    tcase_set_timeout(t, 120);
    tcase_add_loop_test(t, every_flipped_byte_of_a_mnt_is_noticed, 0, 2);
    tcase_add_test(t, a_cut_mnt_is_refused);
    tcase_add_test(t, blocks_of_another_file_or_place_are_refused);
    tcase_add_loop_test(t, lying_blocks_are_read_safely, 0, 2);
    tcase_add_loop_test(t, lying_files_are_found_out_or_harmless, 0, 2);
    tcase_add_loop_test(t, lying_headers_are_found_out, 0, 2);
    tcase_add_test(t, lying_vdt_files_are_found_out);
    tcase_add_test(t, every_flipped_byte_of_a_vdt_is_noticed);
    suite_add_tcase(s, t);
    return suite_run(s);
}
