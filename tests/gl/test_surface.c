/* Goal: the mirror holds the front's triangles and normals, what is new is found and nothing else,
 * and pictures reach the disk. Method: fronts made by hand, numbers worked out by hand; a mirror
 * with a history against a new one; PNGs read back with libpng. No GL. */
#define _GNU_SOURCE /* O_TMPFILE */
#include <check.h>
#include <errno.h>
#include <fcntl.h>
#include <png.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "fake.h"
#include "parts.h"
#include "suite.h"

static int field(uint32_t packed, int shift) {
    const int v = (int)(packed >> shift & 1023);
    return v >= 512 ? v - 1024 : v;
}

/* The mirror of a front, sent. */
static void mirror(mni_surface *s, const mn_front *front) {
    ck_assert(mni_surface_open(s, front->node_slots, front->simplex_slots, front->color != NULL));
    mni_surface_update(s, front);
    mni_surface_sent(s);
}

static uint32_t bits(const uint64_t *words, uint32_t limit) {
    uint32_t count = 0, at = 0, end = 0;
    for (; mni_surface_run(words, limit, 0, &at, &end); at = end)
        count += end - at;
    return count;
}

START_TEST(empty_slots_and_hinges_are_no_triangles) {
    fake f = fake_sheet(3, 1, 1);
    mni_surface s;
    ck_assert_uint_eq(f.front.simplex_slots, 20);
    mirror(&s, &f.front);
    ck_assert_uint_eq(s.triangles, 18);
    ck_assert_uint_eq(f.front.triangles, 18);
    ck_assert_uint_eq(s.simplex_high, 20);
    for (uint32_t i = 0; i < 20; i++) {
        if (i == 0 || i == 19)
            ck_assert(s.index[i][0] == s.index[i][1] && s.index[i][1] == s.index[i][2]);
        else
            ck_assert_mem_eq(s.index[i], f.node + 3 * i, sizeof s.index[i]);
        ck_assert(s.index[i][0] < 16 && s.index[i][1] < 16 && s.index[i][2] < 16);
    }
    mni_surface_close(&s);
    fake_free(&f);
}
END_TEST

START_TEST(normals_are_weighted_by_angle) {
    /* At the origin a right angle in z = 0, and one in x = 0, four times as large and cut in two:
     * their areas do not matter, nor how many they are. */
    const float position[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 2, 0, 0, 2, 2, 0, 0, 2};
    const float switch_value[6] = {0};
    const uint32_t node[9] = {0, 1, 2, 0, 3, 4, 0, 4, 5};
    const mn_front front = {.node_slots = 6,
                            .position = position,
                            .switch_value = switch_value,
                            .simplex_slots = 3,
                            .simplex_node = node,
                            .triangles = 3};
    const uint32_t both[3] = {7, 0, 7}, x[3] = {1, 0, 0}, z[3] = {0, 0, 1};
    mni_surface s;
    mirror(&s, &front);
    ck_assert_uint_eq(s.triangles, 3);
    ck_assert_uint_eq(s.normal[0], mni_surface_pack(both));
    ck_assert_uint_eq(s.normal[1], mni_surface_pack(z));
    ck_assert_uint_eq(s.normal[4], mni_surface_pack(x));
    const int halves = abs((int)s.sum[4][0] - (int)s.sum[0][0]); /* 45 + 45 degrees, 90 */
    ck_assert_int_lt(halves, 40);
    ck_assert_uint_gt(s.sum[0][0], 400000);
    mni_surface_close(&s);
}
END_TEST

/* A sliver folded over an edge has an angle of nearly half a turn at its middle, and tilts the
 * normal there by less than a degree. */
START_TEST(slivers_hardly_count) {
    const float position[15] = {0, 0, 0, 1, 0, 0, 0, 1, 0, -1, -1e-3f, 0, 0, -1, 0};
    float folded[15];
    const float switch_value[5] = {0};
    const uint32_t node[12] = {0, 1, 2, 0, 2, 3, 0, 4, 1, 3, 1, 0};
    mn_front front = {.node_slots = 5,
                      .position = position,
                      .switch_value = switch_value,
                      .simplex_slots = 3,
                      .simplex_node = node,
                      .triangles = 3};
    mni_surface s;
    mirror(&s, &front);
    ck_assert_int_eq(field(s.normal[0], 20), 511);
    mni_surface_close(&s);
    front.simplex_slots = 4;
    memcpy(folded, position, sizeof folded);
    folded[3 * 3 + 2] = -1e-3f; /* the sliver's normal is far off the others' */
    front.position = folded;
    mirror(&s, &front);
    ck_assert_int_le(abs(field(s.normal[0], 0)), 8);
    ck_assert_int_le(abs(field(s.normal[0], 10)), 8);
    mni_surface_close(&s);
}
END_TEST

/* Slivers, needles without area, and models of any size: no direction is invented. */
START_TEST(normals_of_any_size) {
    static const float sizes[] = {1e-18f, 1e-6f, 1, 1e6f, 1e18f};
    for (int i = 0; i < 5; i++) {
        const float a = sizes[i];
        const float position[15] = {0, 0, 0, a, 0, 0, a, a, 0, 2 * a, 0, 0, 0, 0, 0};
        const float switch_value[5] = {0};
        const uint32_t node[9] = {0, 2, 1, 0, 1, 3, 0, 4, 1}; /* the 2nd and 3rd have no area */
        const mn_front front = {.node_slots = 5,
                                .position = position,
                                .switch_value = switch_value,
                                .simplex_slots = 3,
                                .simplex_node = node,
                                .triangles = 3};
        const uint32_t down[3] = {0, 0, UINT32_MAX};
        mni_surface s;
        mirror(&s, &front);
        for (int k = 0; k < 3; k++)
            ck_assert_uint_eq(s.normal[k], mni_surface_pack(down));
        ck_assert_uint_eq(s.normal[3], 0);
        ck_assert_uint_eq(s.normal[4], 0);
        mni_surface_close(&s);
    }
}
END_TEST

START_TEST(nothing_active) {
    const uint32_t node[3] = {MN_NONE, MN_NONE, MN_NONE};
    const mn_front front = {.node_slots = 0, .simplex_slots = 1, .simplex_node = node};
    mni_surface s;
    mirror(&s, &front);
    ck_assert_uint_eq(s.triangles, 0);
    mni_surface_close(&s);
}
END_TEST

/* One triangle goes: its slot and its corners' normals are new, nothing else; the same front again
 * is nothing. */
START_TEST(only_what_changed_is_new) {
    fake f = fake_sheet(8, 1, 1);
    mni_surface s;
    f.front.color = f.color;
    mirror(&s, &f.front);
    mni_surface_update(&s, &f.front);
    ck_assert_uint_eq(bits(s.vertex_new, s.node_high) + bits(s.normal_new, s.node_high) +
                          bits(s.index_new, s.simplex_high),
                      0);
    mni_surface_sent(&s);
    const uint32_t gone = 40;
    f.position[3 * f.node[3 * gone] + 2] = 0.25f; /* no node of the sheet's rim */
    f.node[3 * gone] = MN_NONE;
    mni_surface_update(&s, &f.front);
    ck_assert_uint_eq(bits(s.vertex_new, s.node_high), 1);
    ck_assert_uint_eq(bits(s.index_new, s.simplex_high), 6); /* the node's other triangles, too */
    ck_assert_uint_ge(bits(s.normal_new, s.node_high), 6);
    ck_assert_uint_le(bits(s.normal_new, s.node_high), 7);
    ck_assert_uint_eq(s.triangles, 127);
    mni_surface_sent(&s);
    f.color[7] ^= 1;
    mni_surface_update(&s, &f.front);
    ck_assert_uint_eq(bits(s.vertex_new, s.node_high), 1);
    ck_assert_uint_eq(s.color[7], f.color[7]);
    mni_surface_sent(&s);
    mni_surface_close(&s);
    fake_free(&f);
}
END_TEST

/* Pages that are not stamped are not looked at, unless it is another front. */
START_TEST(stamps_are_believed) {
    fake f = fake_sheet(16, 1, 1);
    uint32_t node_stamp[5] = {0}, simplex_stamp[9] = {0};
    mni_surface s;
    f.front.node_stamp = node_stamp;
    f.front.simplex_stamp = simplex_stamp;
    f.front.version = 7;
    mirror(&s, &f.front);
    f.switch_value[70] = f.switch_value[200] = 1; /* pages 1 and 3 */
    node_stamp[3] = 7;
    f.front.version = 8;
    mni_surface_update(&s, &f.front);
    ck_assert_uint_eq(bits(s.vertex_new, s.node_high), 1);
    ck_assert_float_eq(s.vertex[200][3], 1);
    mni_surface_sent(&s);
    f.front.version = 3; /* time does not go back: something else */
    mni_surface_update(&s, &f.front);
    ck_assert_uint_eq(bits(s.vertex_new, s.node_high), 1);
    ck_assert_float_eq(s.vertex[70][3], 1);
    mni_surface_sent(&s);
    f.switch_value[71] = 1;
    f.front.version = UINT64_C(3) << 31; /* too long ago for stamps */
    mni_surface_update(&s, &f.front);
    ck_assert_uint_eq(bits(s.vertex_new, s.node_high), 1);
    mni_surface_sent(&s);
    mni_surface_close(&s);
    fake_free(&f);
}
END_TEST

/* Nodes and triangles come, go and come back elsewhere, seeded: after each change the mirror is
 * what a new one would be, to the bit, and so is what a driver holds that got only what was new. */
START_TEST(the_way_leaves_no_trace) {
    enum { N = 12, NODES = (N + 1) * (N + 1), SLOTS = 2 * N * N + 2 };
    const char *seed_text = getenv("MN_SEED");
    unsigned seed = seed_text != NULL ? (unsigned)strtoul(seed_text, NULL, 0) : 20261122;
    printf("MN_SEED=%u\n", seed);
    srand(seed);
    static uint32_t normal[NODES], index[SLOTS][3];
    fake f = fake_sphere(N, 1, 1);
    mni_surface s, fresh;
    ck_assert_uint_eq(f.front.simplex_slots, SLOTS);
    ck_assert(mni_surface_open(&s, NODES, SLOTS, false));
    for (int round = 0; round < 300; round++) {
        for (int i = rand() % 20; i > 0; i--) {
            uint32_t *v = f.node + 3 * (rand() % SLOTS), slot = (uint32_t)rand() % NODES;
            if (rand() % 3 == 0)
                v[0] = MN_NONE;
            else
                for (uint32_t k = 0, at = slot; k < 3; k++, at = (at + 1 + k) % NODES)
                    v[k] = at;
            if (rand() % 4 == 0)
                f.position[3 * slot + (uint32_t)rand() % 3] =
                    (float)rand() / (float)RAND_MAX - 0.5f;
        }
        f.front.simplex_slots = (uint32_t)(SLOTS - rand() % 40);
        mni_surface_update(&s, &f.front);
        for (uint32_t i = 0, end = 0; mni_surface_run(s.normal_new, s.node_high, 5, &i, &end);
             i = end)
            memcpy(&normal[i], &s.normal[i], (end - i) * sizeof *normal);
        for (uint32_t i = 0, end = 0; mni_surface_run(s.index_new, s.simplex_high, 2, &i, &end);
             i = end)
            memcpy(&index[i], &s.index[i], (end - i) * sizeof *index);
        mni_surface_sent(&s);
        mirror(&fresh, &f.front);
        ck_assert_uint_eq(s.triangles, fresh.triangles);
        ck_assert_mem_eq(s.vertex, fresh.vertex, NODES * sizeof *s.vertex);
        ck_assert_mem_eq(s.normal, fresh.normal, NODES * sizeof *s.normal);
        ck_assert_mem_eq(s.sum, fresh.sum, NODES * sizeof *s.sum);
        ck_assert_mem_eq(s.index, fresh.index, fresh.simplex_high * sizeof *s.index);
        for (uint32_t i = fresh.simplex_high; i < s.simplex_high; i++)
            ck_assert_uint_eq(s.index[i][0], s.index[i][1]);
        ck_assert_mem_eq(normal, s.normal, sizeof normal);
        ck_assert_mem_eq(index, s.index, s.simplex_high * sizeof *index);
        mni_surface_close(&fresh);
    }
    mni_surface_close(&s);
    fake_free(&f);
}
END_TEST

/* Against a walk bit by bit, over words' ends and gaps. */
START_TEST(runs) {
    uint64_t words[4] = {0};
    static const uint32_t set[] = {0, 1, 5, 62, 63, 64, 65, 127, 128, 140, 199};
    for (size_t i = 0; i < sizeof set / sizeof set[0]; i++)
        words[set[i] / 64] |= UINT64_C(1) << set[i] % 64;
    static const uint32_t apart[][2] = {{0, 2},     {5, 6},     {62, 66},
                                        {127, 129}, {140, 141}, {199, 200}};
    static const uint32_t merged[][2] = {{0, 6}, {62, 66}, {127, 141}, {199, 200}};
    uint32_t at = 0, end = 0;
    for (size_t i = 0; i < 6; i++, at = end) {
        ck_assert(mni_surface_run(words, 256, 0, &at, &end));
        ck_assert(at == apart[i][0] && end == apart[i][1]);
    }
    ck_assert(!mni_surface_run(words, 256, 0, &at, &end));
    at = 0;
    for (size_t i = 0; i < 4; i++, at = end) {
        ck_assert(mni_surface_run(words, 256, 11, &at, &end));
        ck_assert(at == merged[i][0] && end == merged[i][1]);
    }
    at = 63; /* the limit cuts a run, and hides what is behind it */
    ck_assert(mni_surface_run(words, 65, 100, &at, &end));
    ck_assert(at == 63 && end == 65);
    at = 65;
    ck_assert(!mni_surface_run(words, 65, 0, &at, &end));
    memset(words, 0, sizeof words);
    mni_surface_all(words, 70);
    ck_assert_uint_eq(bits(words, 256), 70);
    mni_surface_all(words, 0);
    mni_surface_all(words, 128);
    ck_assert_uint_eq(bits(words, 256), 128);
}
END_TEST

START_TEST(packs_any_length) {
    static const uint32_t lengths[] = {1, 1000, 1u << 30, INT32_MAX};
    for (int i = 0; i < 4; i++) {
        const uint32_t n[3] = {0u - lengths[i], 0, 0};
        const uint32_t packed = mni_surface_pack(n);
        ck_assert_int_eq(field(packed, 0), -511);
        ck_assert_int_eq(field(packed, 10), 0);
        ck_assert_int_eq(field(packed, 20), 0);
    }
    const uint32_t zero[3] = {0, 0, 0}, slanted[3] = {3, 0u - 4, 12};
    ck_assert_uint_eq(mni_surface_pack(zero), 0);
    ck_assert_int_eq(field(mni_surface_pack(slanted), 0), 118);
    ck_assert_int_eq(field(mni_surface_pack(slanted), 10), -157);
    ck_assert_int_eq(field(mni_surface_pack(slanted), 20), 472);
}
END_TEST

START_TEST(png_is_read_back) {
    enum { W = 3, H = 2 };
    uint8_t rgba[4 * W * H], read[3 * W * H];
    char path[] = "test_surface.XXXXXX.png";
    mn_status st = {0};
    for (int i = 0; i < 4 * W * H; i++)
        rgba[i] = (uint8_t)(7 * i);
    const int fd = mkstemps(path, 4);
    ck_assert_int_ge(fd, 0);
    close(fd);
    ck_assert_msg(mni_png_write(path, W, H, rgba, &st) == MN_OK, "%s", st.text);
    png_image image = {.version = PNG_IMAGE_VERSION};
    ck_assert(png_image_begin_read_from_file(&image, path));
    ck_assert_uint_eq(image.width, W);
    ck_assert_uint_eq(image.height, H);
    ck_assert_uint_eq(image.format & PNG_FORMAT_FLAG_ALPHA, 0);
    image.format = PNG_FORMAT_RGB;
    ck_assert(png_image_finish_read(&image, NULL, read, 0, NULL));
    for (int y = 0; y < H; y++) /* rgba has its bottom row first */
        for (int x = 0; x < W; x++)
            for (int c = 0; c < 3; c++)
                ck_assert_uint_eq(read[3 * (W * y + x) + c], rgba[4 * (W * (H - 1 - y) + x) + c]);
    unlink(path);
}
END_TEST

START_TEST(png_failures_leave_nothing) {
    const uint8_t rgba[4] = {1, 2, 3, 4};
    mn_status st = {0};
    ck_assert_int_eq(mni_png_write("no/such/directory/a.png", 1, 1, rgba, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "no/such/directory/a.png"));
    /* The name is a directory: it stays, and no temporary file. */
    char dir[] = "test_surface.XXXXXX", name[64];
    ck_assert_ptr_nonnull(mkdtemp(dir));
    snprintf(name, sizeof name, "%s/a", dir);
    ck_assert_int_eq(mkdir(name, 0700), 0);
    st = (mn_status){0};
    ck_assert_int_eq(mni_png_write(name, 1, 1, rgba, &st), MN_FAILED);
    ck_assert_int_eq(rmdir(name), 0);
    ck_assert_int_eq(rmdir(dir), 0); /* empty */
    st = (mn_status){0};             /* a size that PNG does not have */
    ck_assert_int_eq(mni_png_write("test_surface.empty.png", 0, 0, rgba, &st), MN_FAILED);
    ck_assert_int_ne(access("test_surface.empty.png", F_OK), 0);
}
END_TEST

/* A picture had a temporary name while it was made, which a kill or an interrupt left behind. */
START_TEST(png_killed_leaves_nothing) {
    enum { SIDE = 512 };
    char dir[] = "test_surface.XXXXXX", name[64];
    ck_assert_ptr_nonnull(mkdtemp(dir));
    snprintf(name, sizeof name, "%s/a.png", dir);
    const int nameless = open(dir, O_RDWR | O_TMPFILE, 0600);
    const pid_t child = nameless >= 0 ? fork() : 0;
    if (nameless < 0) {
        printf("skipped: no files without names here\n");
    } else if (child == 0) { /* dies of its first write past 4 KiB */
        uint8_t *noise = malloc(4 * SIDE * SIDE);
        uint32_t dice = 1;
        for (int i = 0; i < 4 * SIDE * SIDE; i++)
            noise[i] = (uint8_t)((dice = 1664525 * dice + 1013904223) >> 24);
        setrlimit(RLIMIT_CORE, &(struct rlimit){0, 0});
        setrlimit(RLIMIT_FSIZE, &(struct rlimit){4096, 4096});
        signal(SIGXFSZ, SIG_DFL);
        _exit(mni_png_write(name, SIDE, SIDE, noise, NULL));
    } else {
        int status = 0;
        ck_assert_int_eq(waitpid(child, &status, 0), child);
        ck_assert(WIFSIGNALED(status) && WTERMSIG(status) == SIGXFSZ);
        close(nameless);
    }
    ck_assert_int_eq(rmdir(dir), 0); /* empty */
}
END_TEST

/* shoot -o /dev/full, as root, had put a picture in the device's place; a link went likewise. */
START_TEST(png_takes_no_devices_place) {
    const uint8_t rgba[4] = {1, 2, 3, 4};
    char dir[] = "test_surface.XXXXXX", fifo[64], link[64], picture[64];
    struct stat info;
    mn_status st = {0};
    ck_assert_ptr_nonnull(mkdtemp(dir));
    snprintf(fifo, sizeof fifo, "%s/fifo", dir);
    snprintf(link, sizeof link, "%s/link", dir);
    snprintf(picture, sizeof picture, "%s/picture", dir);
    ck_assert_int_eq(mkfifo(fifo, 0600), 0);
    ck_assert_int_eq(mni_png_write(fifo, 1, 1, rgba, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, fifo));
    ck_assert(lstat(fifo, &info) == 0 && S_ISFIFO(info.st_mode));
    ck_assert_int_eq(close(open(picture, O_WRONLY | O_CREAT, 0600)), 0);
    ck_assert_int_eq(symlink("picture", link), 0);
    ck_assert_int_eq(mni_png_write(link, 1, 1, rgba, &st), MN_OK);
    ck_assert(lstat(link, &info) == 0 && S_ISLNK(info.st_mode));
    ck_assert(stat(picture, &info) == 0 && info.st_size > 0);
    unlink(fifo);
    unlink(link);
    unlink(picture);
    ck_assert_int_eq(rmdir(dir), 0); /* nothing else was left there */
}
END_TEST

int main(void) {
    Suite *suite = suite_create("surface");
    TCase *tc = tcase_create("surface");
    tcase_add_test(tc, empty_slots_and_hinges_are_no_triangles);
    tcase_add_test(tc, normals_are_weighted_by_angle);
    tcase_add_test(tc, slivers_hardly_count);
    tcase_add_test(tc, normals_of_any_size);
    tcase_add_test(tc, nothing_active);
    tcase_add_test(tc, only_what_changed_is_new);
    tcase_add_test(tc, stamps_are_believed);
    tcase_add_test(tc, the_way_leaves_no_trace);
    tcase_add_test(tc, runs);
    tcase_add_test(tc, packs_any_length);
    tcase_add_test(tc, png_is_read_back);
    tcase_add_test(tc, png_failures_leave_nothing);
    tcase_add_test(tc, png_killed_leaves_nothing);
    tcase_add_test(tc, png_takes_no_devices_place);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
