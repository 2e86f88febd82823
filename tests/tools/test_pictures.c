/* Goal: shoot, replay --images and view, as a user runs them: pictures that are whole and the same
 * whatever the store, and one clear line with the right exit where there can be none.
 * Method: the program itself on small models; PNGs read back. Skipped without EGL. */
#include <check.h>
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "model.h"
#include "suite.h"

static char dir[] = "test_pictures.XXXXXX";
static model globe;
static bool no_egl;

/* Exit status of `metanode ARGUMENTS`, output in dir/out. */
static int metanode(const char *arguments, const char *environment) {
    char command[600];
    snprintf(command, sizeof command, "cd %s && env %s '%s' %s >out 2>&1", dir, environment,
             getenv("METANODE"), arguments);
    const int status = system(command);
    ck_assert(WIFEXITED(status));
    return WEXITSTATUS(status);
}

static const char *output(void) {
    static char text[4096];
    char name[64];
    snprintf(name, sizeof name, "%s/out", dir);
    FILE *f = fopen(name, "r");
    ck_assert_ptr_nonnull(f);
    text[fread(text, 1, sizeof text - 1, f)] = 0;
    fclose(f);
    return text;
}

static void run(const char *arguments) {
    const int code = metanode(arguments, "LC_ALL=C");
    ck_assert_msg(code == 0, "%s: %d: %s", arguments, code, output());
}

/* RGB, top row first; freed by the caller. */
static uint8_t *picture(const char *name, uint32_t width, uint32_t height) {
    char path[96];
    png_image image = {.version = PNG_IMAGE_VERSION};
    snprintf(path, sizeof path, "%s/%s", dir, name);
    ck_assert_msg(png_image_begin_read_from_file(&image, path), "%s: %s", path, image.message);
    ck_assert_uint_eq(image.width, width);
    ck_assert_uint_eq(image.height, height);
    image.format = PNG_FORMAT_RGB;
    uint8_t *rgb = malloc(PNG_IMAGE_SIZE(image));
    ck_assert_ptr_nonnull(rgb);
    ck_assert(png_image_finish_read(&image, NULL, rgb, 0, NULL));
    return rgb;
}

/* The sky is the same along a row; a pixel that the mesh covers in part is not quite it. */
static bool is_sky(const uint8_t *p, const uint8_t *row) {
    return abs(p[0] - row[0]) + abs(p[1] - row[1]) + abs(p[2] - row[2]) <= 3;
}

/* Along each row the globe is one stretch: sky inside it would be a crack. */
static void check_globe(const uint8_t *rgb, uint32_t width, uint32_t height) {
    uint32_t rows = 0;
    for (uint32_t y = 0; y < height; y++) {
        uint32_t stretches = 0;
        bool sky = true;
        for (uint32_t x = 0; x < width; x++) {
            const bool here = is_sky(rgb + 3 * (width * y + x), rgb + 3 * width * y);
            stretches += sky && !here;
            sky = here;
        }
        ck_assert_msg(stretches <= 1, "row %u has a crack", y);
        rows += stretches;
    }
    ck_assert_uint_gt(rows, height / 3);
    ck_assert_uint_lt(rows, height);
}

START_TEST(shoots_the_same_from_every_store) {
    if (no_egl)
        return;
    run("shoot ../globe.mnt --path orbit --frame 70 --size 320x200 --store resident -o a.png "
        "--lod-colors");
    ck_assert_ptr_nonnull(strstr(output(), "a.png: "));
    ck_assert_ptr_nonnull(strstr(output(), " triangles, error "));
    run("shoot ../globe.mnt --path orbit --frame 70 --size 320x200 --store mapped -o b.png "
        "--lod-colors");
    run("shoot ../globe.mnt --path orbit --frame 70 --size 320x200 --store paged --ram 16M "
        "-o c.png --lod-colors");
    uint8_t *a = picture("a.png", 320, 200), *b = picture("b.png", 320, 200),
            *c = picture("c.png", 320, 200);
    check_globe(a, 320, 200);
    ck_assert_mem_eq(a, b, 3 * 320 * 200);
    ck_assert_mem_eq(a, c, 3 * 320 * 200);
    free(a);
    free(b);
    free(c);
}
END_TEST

START_TEST(looks_differ) {
    if (no_egl)
        return;
    static const char *const looks[] = {"", "--wireframe", "--lod-colors", "--flat"};
    uint8_t *rgb[4];
    char arguments[200];
    for (int i = 0; i < 4; i++) {
        snprintf(
            arguments, sizeof arguments,
            "shoot ../globe.mnt --frame 5 --size 64x48 --tolerance 4 --store resident -o l.png "
            "%s --json",
            looks[i]);
        run(arguments);
        ck_assert_ptr_nonnull(strstr(output(), "\"gl_rss_bytes\": "));
        ck_assert_ptr_nonnull(strstr(output(), "\"triangles\": "));
        rgb[i] = picture("l.png", 64, 48);
        for (int k = 0; k < i; k++)
            ck_assert_mem_ne(rgb[i], rgb[k], 3 * 64 * 48);
    }
    for (int i = 0; i < 4; i++)
        free(rgb[i]);
}
END_TEST

/* The rows of frames with a picture end in the bytes sent for it, others in nothing; together they
 * are the run's. */
static void check_sent_bytes(void) {
    char name[64], row[1024];
    unsigned long long sum = 0, total = 0;
    const char *key = strstr(output(), "\"gl_sent_bytes\": ");
    ck_assert_ptr_nonnull(key);
    ck_assert_int_eq(sscanf(key, "\"gl_sent_bytes\": %llu", &total), 1);
    snprintf(name, sizeof name, "%s/frames.csv", dir);
    FILE *f = fopen(name, "r");
    ck_assert_ptr_nonnull(f);
    ck_assert_ptr_nonnull(fgets(row, sizeof row, f));
    ck_assert_ptr_nonnull(strstr(row, ",gl_sent_bytes\n"));
    for (int frame = 0; frame < 7; frame++) {
        ck_assert_ptr_nonnull(fgets(row, sizeof row, f));
        const char *last = strrchr(row, ',') + 1;
        ck_assert((*last == '\n') == (frame % 3 != 0));
        sum += strtoull(last, NULL, 10);
    }
    fclose(f);
    ck_assert_uint_gt(total, 0);
    ck_assert_uint_eq(sum, total);
}

/* What a driver allocates after the start is told apart: none is ours. */
static void check_allocations(const char *option, const char *theirs) {
    char arguments[200];
    snprintf(arguments, sizeof arguments,
             "replay ../globe.mnt --path dive --frames 5 --size 64x48 --fps 0 --ram 16M --json "
             "--csv c.csv --trace t.trace %s",
             option);
    run(arguments);
    const char *const found = strstr(output(), theirs);
    ck_assert_msg(found != NULL, "%s: %s", option, output());
    ck_assert_msg(strstr(output(), "\"allocations_after_seal\": 0,") != NULL, "%s: %s", option,
                  output());
    ck_assert_msg((strncmp(found + strlen(theirs), "null", 4) != 0) || *option == 0, "%s", option);
}

START_TEST(replays_with_pictures) {
    if (no_egl)
        return;
    run("replay ../globe.mnt --path dive --frames 7 --images frames --images-every 3 "
        "--size 64x48 --store resident --json --csv frames.csv");
    ck_assert_ptr_nonnull(strstr(output(), "\"gl_fronts\": 3,"));
    ck_assert_ptr_nonnull(strstr(output(), "\"gl_sent_bytes\": "));
    check_sent_bytes();
    check_allocations("", "\"gl_allocations\": null,");
    check_allocations("--images others", "\"gl_allocations\": ");
    check_allocations("--reference", "\"gl_allocations\": ");
    static const int there[] = {0, 3, 6}, missing[] = {1, 2, 4, 5, 7};
    char name[96];
    for (int i = 0; i < 3; i++) {
        snprintf(name, sizeof name, "frames/frame-%06d.png", there[i]);
        free(picture(name, 64, 48));
    }
    for (int i = 0; i < 5; i++) {
        snprintf(name, sizeof name, "%s/frames/frame-%06d.png", dir, missing[i]);
        ck_assert_int_ne(access(name, F_OK), 0);
    }
}
END_TEST

static double json_value(const char *key) {
    char quoted[64];
    snprintf(quoted, sizeof quoted, "\"%s\": ", key);
    const char *at = strstr(output(), quoted);
    ck_assert_msg(at != NULL, "no %s: %s", key, output());
    return strncmp(at + strlen(quoted), "null", 4) == 0 ? (double)NAN : atof(at + strlen(quoted));
}

/* The columns psnr_db, ssim and difference_max of a row of frames.csv; false: they are empty. */
static bool csv_likeness(uint32_t frame, double out[3]) {
    char name[64], row[2048];
    snprintf(name, sizeof name, "%s/frames.csv", dir);
    FILE *f = fopen(name, "r");
    ck_assert_ptr_nonnull(f);
    int column = 0, wanted = -1;
    ck_assert_ptr_nonnull(fgets(row, sizeof row, f));
    for (char *at = row; at != NULL; at = strchr(at, ','), at += at != NULL, column++)
        if (strncmp(at, "psnr_db,ssim,difference_max,", 28) == 0)
            wanted = column;
    ck_assert_int_gt(wanted, 0);
    for (uint32_t i = 0; i <= frame; i++)
        ck_assert_ptr_nonnull(fgets(row, sizeof row, f));
    fclose(f);
    char *at = row;
    for (int i = 0; i < wanted; i++)
        at = strchr(at, ',') + 1;
    return sscanf(at, "%lf,%lf,%lf", &out[0], &out[1], &out[2]) == 3;
}

/* A run that has all it wants is the reference; what one says that has not is what compare says of
 * its pictures and those of shoot, and the sums are those of the rows. */
START_TEST(beside_the_reference) {
    if (no_egl)
        return;
    run("replay ../globe.mnt --path dive --frames 5 --size 64x48 --barrier --reference --json "
        "--images-every 2");
    ck_assert_double_eq(json_value("pictures_compared"), 3);
    ck_assert_double_eq(json_value("pictures_identical"), 3);
    ck_assert_double_eq(json_value("ssim_min"), 1);
    ck_assert(isnan(json_value("psnr_db_min")) && isnan(json_value("psnr_db_mean")));

    double row[3], least = INFINITY, squares = 0, ssim_sum = 0, largest = 0;
    run("replay ../globe.mnt --path orbit --frames 4 --size 64x48 --barrier --reference --json -K "
        "min "
        "--degrade off --tolerance 0.5 --ram 16M --images frames --csv frames.csv");
    ck_assert_double_eq(json_value("pictures_compared"), 4);
    ck_assert_double_eq(json_value("pictures_identical"), 0);
#ifndef __SANITIZE_ADDRESS__ /* which takes memory of its own */
    ck_assert_double_le(json_value("rss_peak_bytes"), 16 << 20);
#endif
    const double psnr_min = json_value("psnr_db_min"), psnr_mean = json_value("psnr_db_mean");
    const double ssim_mean = json_value("ssim_mean"), difference = json_value("difference_max");
    for (uint32_t frame = 0; frame < 4; frame++) {
        ck_assert(csv_likeness(frame, row));
        least = row[0] < least ? row[0] : least;
        squares += 65025 / pow(10, row[0] / 10) / 4;
        ssim_sum += row[1] / 4;
        largest = row[2] > largest ? row[2] : largest;
    }
    ck_assert_double_eq_tol(psnr_min, least, 1e-3);
    ck_assert_double_eq_tol(psnr_mean, 10 * log10(65025 / squares), 1e-3);
    ck_assert_double_eq_tol(ssim_mean, ssim_sum, 1e-6);
    ck_assert_double_eq(difference, largest);
    ck_assert_double_lt(row[1], 0.999);

    run("shoot ../globe.mnt --path orbit --frames 4 --frame 3 --size 64x48 --store resident "
        "--tolerance 0.5 -o all.png");
    run("compare frames/frame-000003.png all.png --json");
    ck_assert_double_eq_tol(json_value("psnr_db"), row[0], 1e-3);
    ck_assert_double_eq_tol(json_value("ssim"), row[1], 1e-6);
    ck_assert_double_eq(json_value("difference_max"), row[2]);
    run("compare all.png all.png");
    ck_assert_ptr_nonnull(strstr(output(), "64 x 48 pixels, the same\n"));

    run("replay ../globe.mnt --path orbit --frames 2 --size 64x48 --json --csv frames.csv --fps 0");
    ck_assert(isnan(json_value("ssim_mean")) && !csv_likeness(1, row));
}
END_TEST

/* The process that draws the reference is killed in the middle: one line, and an end. */
START_TEST(reference_goes) {
    if (no_egl)
        return;
    char command[800];
    snprintf(
        command, sizeof command,
        "cd %s && { '%s' replay ../globe.mnt --path orbit --frames 1000000 --size 64x48 --fps 0 "
        "--reference --json >out 2>&1 & } && for i in $(seq 300); do sleep 0.1; "
        "child=$(grep -lE \"^PPid:[[:space:]]$!$\" /proc/[0-9]*/status 2>/dev/null | head -n 1 | "
        "cut -d/ -f3); [ -z \"$child\" ] || break; done; "
        "kill -9 $child; wait $!",
        dir, getenv("METANODE"));
    const int status = system(command);
    ck_assert(WIFEXITED(status));
    ck_assert_int_eq(WEXITSTATUS(status), 1);
    ck_assert_msg(strstr(output(), "--reference: the process that draws it has gone") != NULL, "%s",
                  output());
}
END_TEST

/* Exit code and a word that the one line must have. */
START_TEST(says_what_is_wrong) {
    if (no_egl)
        return;
    static const struct {
        const char *arguments, *environment;
        int code;
        const char *word;
    } wrong[] = {
        {"shoot ../globe.mnt", "", 2, "-o"},
        {"shoot ../globe.mnt --store resident -o a.png --frame 600", "", 2, "0 to 599"},
        {"shoot ../globe.mnt -o a.png --frame -1", "", 2, "--frame"},
        {"shoot -o a.png", "", 2, "FILE"},
        {"shoot ../globe.mnt --store resident -o a.png --path nowhere", "", 2, "nowhere"},
        {"shoot nothing.mnt -o a.png", "", 3, "nothing.mnt"},
        {"shoot ../globe.mnt --store resident -o no/such/a.png --size 8x8", "", 1, "no/such/a.png"},
        {"shoot ../globe.mnt --store resident -o a.png --size 9999999x1", "", 2, "--size"},
        {"shoot ../globe.mnt --store resident -o a.png", "METANODE_HELPER_DIR=/nowhere", 6,
         "/nowhere/metanode-gl.so"},
        {"shoot ../globe.mnt --store resident -o a.png", "METANODE_EGL=no", 6, "METANODE_EGL"},
        {"replay ../globe.mnt --path orbit --frames 1 --store resident --images f",
         "METANODE_HELPER_DIR=/nowhere", 6, "/nowhere/metanode-gl.so"},
        {"replay ../globe.mnt --path orbit --frames 1 --reference", "METANODE_HELPER_DIR=/nowhere",
         6, "--reference: no graphics"},
        {"compare skip.png ../globe.mnt", "", 3, "give two meshes or two pictures"},
        {"compare skip.png large.png", "", 3, "skip.png has 8 x 8 pixels and large.png 9 x 8"},
        {"compare skip.png false.png", "", 3, "false.png: not a PNG"},
        {"compare skip.png none.png", "", 3, "none.png"},
        {"compare skip.png skip.png --samples 5", "", 2, "for meshes"},
        {"view ../globe.mnt --store resident", "-u DISPLAY -u WAYLAND_DISPLAY", 6,
         "metanode shoot"},
        {"view ../globe.mnt --store resident", "-u WAYLAND_DISPLAY DISPLAY=:987", 6,
         "metanode shoot"},
    };
    run("shoot ../globe.mnt --store resident --size 9x8 -o large.png");
    ck_assert_int_eq(metanode("info ../globe.mnt", ""), 0);
    char made[96], name[96];
    snprintf(made, sizeof made, "%s/out", dir);
    snprintf(name, sizeof name, "%s/false.png", dir);
    ck_assert_int_eq(rename(made, name), 0);
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        const int code = metanode(wrong[i].arguments, wrong[i].environment);
        const char *said = output();
        ck_assert_msg(code == wrong[i].code, "%s: %d, not %d: %s", wrong[i].arguments, code,
                      wrong[i].code, said);
        ck_assert_msg(strstr(said, wrong[i].word) != NULL, "%s: %s", wrong[i].arguments, said);
        ck_assert_msg(strchr(said, '\n') == said + strlen(said) - 1, "one line: %s", said);
    }
}
END_TEST

/* A figure of a JSON object printed; NAN: null. */
static double figure(const char *key) {
    double value = NAN;
    char text[64];
    snprintf(text, sizeof text, "\"%s\": ", key);
    const char *at = strstr(output(), text);
    ck_assert_msg(at != NULL, "no %s: %s", key, output());
    return sscanf(at + strlen(text), "%lf", &value) == 1 ? value : NAN;
}

/* Only with --pictures is anything drawn; what is sent is the same. */
START_TEST(bench_draws_when_asked) {
    if (no_egl)
        return;
    run("bench draw ../globe.mnt --frames 3 --size 64x48 --json");
    const double sent = figure("sent_bytes_mean");
    ck_assert_double_gt(sent, 0);
    ck_assert(isnan(figure("picture_ms_mean")) && isnan(figure("again_ms_mean")));
    run("bench draw ../globe.mnt --frames 3 --size 64x48 --json --pictures");
    ck_assert_double_eq(figure("sent_bytes_mean"), sent);
    ck_assert_double_gt(figure("picture_ms_mean"), 0);
    ck_assert_double_gt(figure("again_ms_mean"), 0);
    ck_assert_ptr_nonnull(strstr(output(), "\"gl_driver\": \""));
}
END_TEST

/* Unchecked fixtures: once, in the parent of all tests. */
static void set_up(void) {
    const mn_block_desc blocks = {.blocking = MN_BLOCKING_LEVELS, .l = 5};
    ck_assert_ptr_nonnull(mkdtemp(dir));
    model_make(&globe, MODEL_GLOBE, 6000, &blocks);
    ck_assert_int_eq(rename(globe.path, "globe.mnt"), 0);
    snprintf(globe.path, sizeof globe.path, "globe.mnt");
    no_egl = metanode("shoot ../globe.mnt --store resident --size 8x8 -o skip.png", "") == 6;
    if (no_egl)
        printf("skipped: %s", output());
}

static void tear_down(void) {
    char command[64];
    model_free(&globe);
    snprintf(command, sizeof command, "rm -r %s", dir);
    ck_assert_int_eq(system(command), 0);
}

int main(void) {
    Suite *suite = suite_create("pictures");
    TCase *tc = tcase_create("pictures");
    tcase_set_timeout(tc, 120);
    tcase_add_unchecked_fixture(tc, set_up, tear_down);
    tcase_add_test(tc, shoots_the_same_from_every_store);
    tcase_add_test(tc, looks_differ);
    tcase_add_test(tc, replays_with_pictures);
    tcase_add_test(tc, beside_the_reference);
    tcase_add_test(tc, reference_goes);
    tcase_add_test(tc, bench_draws_when_asked);
    tcase_add_test(tc, says_what_is_wrong);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    return no_egl ? 77 : failed; /* 77: meson's word for skipped */
}
