/* Goal: PSNR and SSIM are those of the literature, and a PNG is read as what it shows or refused.
 * Method: values that scikit-image 0.19.3 gives (structural_similarity with gaussian_weights, sigma
 * 1.5, use_sample_covariance off, data_range 255, of 0.299 R + 0.587 G + 0.114 B), the definition
 * written out window by window, and pictures whose likeness is known; PNGs written by libpng and
 * damaged here. */
#include <check.h>
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "parts.h"
#include "suite.h"

enum { SIDE = 64 };
static uint8_t a[3 * SIDE * SIDE], b[3 * SIDE * SIDE];

static mn_likeness likeness(uint32_t width, uint32_t height) {
    mn_likeness l;
    mn_status st = {0};
    ck_assert_int_eq(mni_likeness(a, b, width, height, &l, &st), MN_OK);
    return l;
}

/* Gradients that wrap, and some noise. */
static void make(uint32_t width, uint32_t height) {
    for (uint32_t y = 0; y < height; y++)
        for (uint32_t x = 0; x < width; x++)
            for (uint32_t c = 0; c < 3; c++) {
                const size_t at = 3 * ((size_t)width * y + x) + c;
                const int p = (int)((x * x * (c + 2) + 3 * x * y + 5 * y * (7 - c)) % 256);
                const int q = p + (int)((x * 7919 + y * 104729 + c * 1299709) % 41) - 20;
                a[at] = (uint8_t)p;
                b[at] = (uint8_t)(q < 0 ? 0 : q > 255 ? 255 : q);
            }
}

START_TEST(values_of_scikit_image) {
    static const struct {
        uint32_t width, height;
        double psnr_db, ssim;
    } known[] = {{37, 23, 26.868142340360, 0.989291439043},
                 {11, 11, 26.893906693677, 0.994631671220},
                 {64, 12, 26.857069686301, 0.988217333911}};
    for (int i = 0; i < 3; i++) {
        make(known[i].width, known[i].height);
        const mn_likeness l = likeness(known[i].width, known[i].height);
        ck_assert_double_eq_tol(l.psnr_db, known[i].psnr_db, 1e-10);
        ck_assert_double_eq_tol(l.ssim, known[i].ssim, 1e-10);
        ck_assert_uint_eq(l.difference_max, 20);
    }
}
END_TEST

static double luminance_at(const uint8_t *rgb, size_t pixel) {
    return 0.299 * rgb[3 * pixel] + 0.587 * rgb[3 * pixel + 1] + 0.114 * rgb[3 * pixel + 2];
}

/* The definition: for each window, its means, then its deviations from them. */
static double naive_ssim(uint32_t width, uint32_t height) {
    double weight[11][11], total = 0, sum = 0;
    for (int i = 0; i < 11; i++)
        for (int k = 0; k < 11; k++)
            total += weight[i][k] = exp(-((i - 5) * (i - 5) + (k - 5) * (k - 5)) / 4.5);
    for (uint32_t y = 0; y + 11 <= height; y++)
        for (uint32_t x = 0; x + 11 <= width; x++) {
            double mean_a = 0, mean_b = 0, var_a = 0, var_b = 0, both = 0;
            for (int pass = 0; pass < 2; pass++)
                for (uint32_t i = 0; i < 11; i++)
                    for (uint32_t k = 0; k < 11; k++) {
                        const size_t at = (size_t)width * (y + i) + x + k;
                        const double w = weight[i][k] / total;
                        const double p = luminance_at(a, at), q = luminance_at(b, at);
                        if (pass == 0) {
                            mean_a += w * p;
                            mean_b += w * q;
                        } else {
                            var_a += w * (p - mean_a) * (p - mean_a);
                            var_b += w * (q - mean_b) * (q - mean_b);
                            both += w * (p - mean_a) * (q - mean_b);
                        }
                    }
            sum += (2 * mean_a * mean_b + 6.5025) * (2 * both + 58.5225) /
                   ((mean_a * mean_a + mean_b * mean_b + 6.5025) * (var_a + var_b + 58.5225));
        }
    return sum / ((width - 10.0) * (height - 10.0));
}

START_TEST(the_definition) {
    const char *seed = getenv("MN_SEED");
    uint64_t state = seed != NULL ? strtoull(seed, NULL, 10) : (uint64_t)getpid();
    printf("MN_SEED=%llu\n", (unsigned long long)state);
    for (int round = 0; round < 12; round++) {
        state = state * 6364136223846793005u + 1442695040888963407u;
        const uint32_t width = 11 + (state >> 33) % 40, height = 11 + (state >> 43) % 40;
        const uint32_t noise = 1 + (state >> 55) % 255;
        for (size_t i = 0; i < 3 * (size_t)width * height; i++) {
            state = state * 6364136223846793005u + 1442695040888963407u;
            a[i] = (uint8_t)(state >> 40);
            b[i] = (uint8_t)(a[i] + (state >> 50) % noise);
        }
        ck_assert_double_eq_tol(likeness(width, height).ssim, naive_ssim(width, height), 1e-9);
    }
}
END_TEST

START_TEST(known_pictures) {
    memset(a, 100, sizeof a);
    memset(b, 100, sizeof b);
    mn_likeness l = likeness(SIDE, SIDE);
    ck_assert(isinf(l.psnr_db) && l.mean_square == 0 && l.difference_max == 0);
    ck_assert_double_eq_tol(l.ssim, 1, 1e-12);
    memset(b, 110, sizeof b); /* without structure only the means count */
    l = likeness(SIDE, SIDE);
    ck_assert_double_eq_tol(l.psnr_db, 10 * log10(65025.0 / 100), 1e-12);
    ck_assert_double_eq_tol(l.ssim, (22000 + 6.5025) / (10000 + 12100 + 6.5025), 1e-9);
    memset(a, 0, sizeof a); /* the worst there is */
    memset(b, 255, sizeof b);
    l = likeness(SIDE, SIDE);
    ck_assert_double_eq_tol(l.psnr_db, 0, 1e-12);
    ck_assert_double_eq_tol(l.ssim, 6.5025 / (65025 + 6.5025), 1e-9);
    ck_assert_uint_eq(l.difference_max, 255);
    for (int i = 0; i < 2; i++) { /* windows do not fit */
        l = likeness(i == 0 ? 10 : SIDE, i == 0 ? SIDE : 10);
        ck_assert(isnan(l.ssim) && l.psnr_db == 0);
    }
    ck_assert_double_eq_tol(likeness(1, 1).psnr_db, 0, 1e-12);
}
END_TEST

/* ---- PNG ------------------------------------------------------------------------------------- */

static const char name[] = "test_likeness.png";
static uint8_t *rgb;
static uint32_t width, height;

static mn_code read_png(mn_status *st) {
    free(rgb);
    return mni_png_read(name, &rgb, &width, &height, st);
}

static void tear_down(void) {
    free(rgb);
    rgb = NULL;
    unlink(name);
}

START_TEST(written_and_read) {
    uint8_t rgba[4 * 5 * 3];
    for (size_t i = 0; i < sizeof rgba; i++)
        rgba[i] = (uint8_t)(37 * i);
    mn_status st = {0};
    ck_assert_int_eq(mni_png_write(name, 5, 3, rgba, &st), MN_OK);
    ck_assert_msg(read_png(&st) == MN_OK, "%s", st.text);
    ck_assert(width == 5 && height == 3);
    for (uint32_t y = 0; y < 3; y++) /* written from the bottom row on, and opaque */
        for (uint32_t x = 0; x < 5; x++)
            ck_assert_mem_eq(rgb + 3 * (5 * y + x), rgba + 4 * (5 * (2 - y) + x), 3);
}
END_TEST

static void write_as(png_uint_32 format, const void *pixels) {
    png_image image = {.version = PNG_IMAGE_VERSION, .width = 2, .height = 1, .format = format};
    ck_assert(png_image_write_to_file(&image, name, 0, pixels, 0, NULL));
}

START_TEST(other_kinds) {
    mn_status st = {0};
    write_as(PNG_FORMAT_GRAY, (const uint8_t[]){7, 200});
    ck_assert_int_eq(read_png(&st), MN_OK);
    ck_assert_mem_eq(rgb, ((const uint8_t[]){7, 7, 7, 200, 200, 200}), 6);
    write_as(PNG_FORMAT_RGBA, (const uint8_t[]){255, 0, 9, 255, 255, 255, 255, 0});
    ck_assert_int_eq(read_png(&st), MN_OK); /* on black */
    ck_assert_mem_eq(rgb, ((const uint8_t[]){255, 0, 9, 0, 0, 0}), 6);
    write_as(PNG_FORMAT_LINEAR_Y, (const uint16_t[]){0, 65535});
    ck_assert_int_eq(read_png(&st), MN_OK);
    ck_assert_mem_eq(rgb, ((const uint8_t[]){0, 0, 0, 255, 255, 255}), 6);
}
END_TEST

static void write_bytes(const uint8_t *bytes, size_t count) {
    FILE *f = fopen(name, "wb");
    ck_assert_ptr_nonnull(f);
    ck_assert_uint_eq(fwrite(bytes, 1, count, f), count);
    ck_assert_int_eq(fclose(f), 0);
}

START_TEST(damaged) {
    uint8_t bytes[4096], rgba[4 * 16 * 16];
    for (size_t i = 0; i < sizeof rgba; i++)
        rgba[i] = (uint8_t)(i * i >> 3);
    mn_status st = {0};
    ck_assert_int_eq(mni_png_write(name, 16, 16, rgba, &st), MN_OK);
    FILE *f = fopen(name, "rb");
    ck_assert_ptr_nonnull(f);
    const size_t count = fread(bytes, 1, sizeof bytes, f);
    fclose(f);
    ck_assert(count > 100 && count < sizeof bytes);
    for (size_t n = 0; n + 16 < count; n++) { /* cut anywhere before the end's chunk */
        st = (mn_status){0};
        write_bytes(bytes, n);
        ck_assert_msg(read_png(&st) == MN_BAD_INPUT && rgb == NULL, "cut at %zu of %zu", n, count);
        ck_assert_ptr_nonnull(strstr(st.text, name));
    }
    for (size_t i = 0; i < count; i++) { /* a byte turned over: refused, or of no consequence */
        st = (mn_status){0};
        bytes[i] ^= 0xff;
        write_bytes(bytes, count);
        const mn_code code = read_png(&st);
        ck_assert(code == MN_BAD_INPUT || (code == MN_OK && width == 16 && height == 16));
        ck_assert_msg(i >= 24 || code == MN_BAD_INPUT, "byte %zu", i);
        bytes[i] ^= 0xff;
    }
    st = (mn_status){0};
    unlink(name);
    ck_assert_int_eq(read_png(&st), MN_BAD_INPUT);
    st = (mn_status){0};
    ck_assert_int_eq(mni_png_read("/", &rgb, &width, &height, &st), MN_BAD_INPUT);
}
END_TEST

/* A header that claims more than any picture has: refused before memory is asked for. */
START_TEST(huge) {
    static uint8_t row[16385];
    png_image image = {
        .version = PNG_IMAGE_VERSION, .width = 16385, .height = 1, .format = PNG_FORMAT_GRAY};
    ck_assert(png_image_write_to_file(&image, name, 0, row, 0, NULL));
    mn_status st = {0};
    ck_assert_int_eq(read_png(&st), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "16385 x 1"));
}
END_TEST

int main(void) {
    Suite *suite = suite_create("likeness");
    TCase *tc = tcase_create("likeness");
    tcase_set_timeout(tc, 60);
    tcase_add_checked_fixture(tc, NULL, tear_down);
    tcase_add_test(tc, values_of_scikit_image);
    tcase_add_test(tc, the_definition);
    tcase_add_test(tc, known_pictures);
    tcase_add_test(tc, written_and_read);
    tcase_add_test(tc, other_kinds);
    tcase_add_test(tc, damaged);
    tcase_add_test(tc, huge);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
