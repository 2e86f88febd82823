/* Goal: index lists and normals are those of the front's triangles, and pictures reach the disk.
 * Method: fronts made by hand, numbers worked out by hand; PNGs read back with libpng. No GL. */
#include <check.h>
#include <errno.h>
#include <png.h>
#include <sys/stat.h>
#include <unistd.h>

#include "fake.h"
#include "parts.h"

static int field(uint32_t packed, int shift) {
    const int v = (int)(packed >> shift & 1023);
    return v >= 512 ? v - 1024 : v;
}

START_TEST(skips_empty_slots_and_hinges) {
    fake f = fake_sheet(3, 1, 1);
    uint32_t index[3 * 20];
    float normal[3 * 16];
    ck_assert_uint_eq(f.front.simplex_slots, 20);
    ck_assert_uint_eq(mni_surface_gather(&f.front, index, normal), 18);
    ck_assert_uint_eq(f.front.triangles, 18);
    for (int i = 0; i < 3 * 18; i++)
        ck_assert_uint_lt(index[i], 16);
    fake_free(&f);
}
END_TEST

START_TEST(normals_are_weighted_by_area) {
    /* A small triangle in z = 0 and one of four times its area in x = 0, sharing the origin. */
    const float position[15] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 2, 0, 0, 0, 2};
    const uint32_t node[6] = {0, 1, 2, 0, 3, 4};
    const mn_front front = {.node_slots = 5,
                            .position = position,
                            .simplex_slots = 2,
                            .simplex_node = node,
                            .triangles = 2};
    uint32_t index[6];
    float normal[15];
    ck_assert_uint_eq(mni_surface_gather(&front, index, normal), 2);
    ck_assert_float_eq(normal[0], 4);
    ck_assert_float_eq(normal[1], 0);
    ck_assert_float_eq(normal[2], 1);
    ck_assert_float_eq(normal[3 * 1 + 2], 1);
    ck_assert_float_eq(normal[3 * 4 + 0], 4);
}
END_TEST

START_TEST(nothing_active) {
    const uint32_t node[3] = {MN_NONE, MN_NONE, MN_NONE};
    const mn_front front = {.node_slots = 0, .simplex_slots = 1, .simplex_node = node};
    uint32_t index[3];
    float normal[3];
    ck_assert_uint_eq(mni_surface_gather(&front, index, normal), 0);
}
END_TEST

START_TEST(packs_any_length) {
    static const float lengths[] = {1e-30f, 1e-10f, 1, 1e10f, 1e30f};
    for (int i = 0; i < 5; i++) {
        const float n[3] = {-lengths[i], 0, 0};
        const uint32_t packed = mni_surface_pack(n);
        ck_assert_int_eq(field(packed, 0), -511);
        ck_assert_int_eq(field(packed, 10), 0);
        ck_assert_int_eq(field(packed, 20), 0);
    }
    const float zero[3] = {0, 0, 0}, bad[3] = {NAN, 0, 1}, far[3] = {INFINITY, 0, 1};
    ck_assert_uint_eq(mni_surface_pack(zero), 0);
    ck_assert_uint_eq(mni_surface_pack(bad), 0);
    ck_assert_uint_eq(mni_surface_pack(far), 0);
    const float slanted[3] = {3, -4, 12};
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
    /* The name is a directory: the rename fails, the temporary file must go. */
    char dir[] = "test_surface.XXXXXX", temporary[64];
    ck_assert_ptr_nonnull(mkdtemp(dir));
    st = (mn_status){0};
    ck_assert_int_eq(mni_png_write(dir, 1, 1, rgba, &st), MN_FAILED);
    snprintf(temporary, sizeof temporary, "%s.%ld.tmp", dir, (long)getpid());
    ck_assert_int_ne(access(temporary, F_OK), 0);
    rmdir(dir);
    st = (mn_status){0}; /* a size that PNG does not have */
    ck_assert_int_eq(mni_png_write("test_surface.empty.png", 0, 0, rgba, &st), MN_FAILED);
    ck_assert_int_ne(access("test_surface.empty.png", F_OK), 0);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("surface");
    TCase *tc = tcase_create("surface");
    tcase_add_test(tc, skips_empty_slots_and_hinges);
    tcase_add_test(tc, normals_are_weighted_by_area);
    tcase_add_test(tc, nothing_active);
    tcase_add_test(tc, packs_any_length);
    tcase_add_test(tc, png_is_read_back);
    tcase_add_test(tc, png_failures_leave_nothing);
    suite_add_tcase(suite, tc);
    SRunner *runner = srunner_create(suite);
    srunner_run_all(runner, CK_ENV);
    const int failed = srunner_ntests_failed(runner);
    srunner_free(runner);
    return failed == 0 ? 0 : 1;
}
