/* Goal: path files are read whole or refused by their line, and the curve through their keys is the
 * one of docs/paths.md: through each key, smooth, within them.
 * Method: values of PCHIP computed elsewhere, difference quotients, and files damaged at random. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "path_keys.h"
#include "suite.h"

#define HEAD "metanode path 2\n"

static char file_name[64];
static mni_path_keys keys;
static uint64_t state;

static double random_unit(void) { /* xorshift */
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (double)(state >> 11) * 0x1p-53;
}

static void begin_random(void) {
    const char *seed = getenv("MN_SEED");
    state = seed != NULL ? strtoull(seed, NULL, 10) : (uint64_t)getpid() * 2654435761u;
    printf("MN_SEED=%llu\n", (unsigned long long)state);
    state = 2 * state + 1; /* never 0 */
}

static void set_up(void) {
    snprintf(file_name, sizeof file_name, "test_path_keys.%d.path", (int)getpid());
}

static void tear_down(void) {
    mni_path_keys_free(&keys);
    unlink(file_name);
}

static mn_code read_bytes(const char *text, size_t bytes, mn_status *st) {
    FILE *f = fopen(file_name, "w");
    ck_assert_ptr_nonnull(f);
    ck_assert_uint_eq(fwrite(text, 1, bytes, f), bytes);
    ck_assert_int_eq(fclose(f), 0);
    mni_path_keys_free(&keys);
    return mni_path_keys_read(file_name, 45, &keys, st);
}

static void read_text(const char *text) {
    mn_status st = {0};
    ck_assert_msg(read_bytes(text, strlen(text), &st) == MN_OK, "%s", st.text);
}

static void write_keys(const uint32_t *frame, const mn_camera *camera, uint32_t count) {
    FILE *f = fopen(file_name, "w");
    ck_assert_ptr_nonnull(f);
    fputs(mn_path_heading, f);
    for (uint32_t i = 0; i < count; i++) {
        char line[MN_PATH_LINE_BYTES];
        const int n = mn_path_line(line, frame[i], &camera[i]);
        ck_assert_int_lt(n, MN_PATH_LINE_BYTES);
        fputs(line, f);
    }
    ck_assert_int_eq(fclose(f), 0);
    mn_status st = {0};
    mni_path_keys_free(&keys);
    ck_assert_msg(mni_path_keys_read(file_name, 45, &keys, &st) == MN_OK, "%s", st.text);
}

/* ---- the curve ------------------------------------------------------------------------------- */

static float eye_x(double frame) {
    mn_camera c;
    mni_path_keys_at(&keys, frame, &c);
    return c.eye[0];
}

/* Uneven intervals, an extremum, a stretch that stands, ends that would overshoot. */
static void open_uneven(void) {
    read_text(HEAD "0   0 0 9  0 0 0  0 1 0  30\n10 10 0 9  0 0 0  0 1 0\n"
                   "30 20 0 9  0 0 0  0 1 0\n40 -4 0 9  0 0 0  0 1 0\n"
                   "60 -4 0 9  0 0 0  0 1 0\n61  8 0 9  0 0 0  0 1 0\n");
}

START_TEST(values_of_pchip) {
    static const struct {
        double frame, value;
    } known[] = {{3, 3.4388462}, {10, 10}, {17, 14.865},        {25, 19.086538},   {33, 14.816},
                 {39, -3.328},   {50, -4}, {60.25, -2.7142857}, {60.75, 4.3571429}};
    open_uneven();
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        ck_assert_float_eq_tol(eye_x(known[i].frame), (float)known[i].value, 2e-6f);
}
END_TEST

START_TEST(derivative_is_continuous) {
    static const uint32_t inner[] = {10, 30, 40, 60};
    open_uneven();
    for (int i = 0; i < 4; i++) {
        double gap[2]; /* between the slopes of both sides: falls with the step */
        for (int k = 0; k < 2; k++) {
            const double step = k == 0 ? 0.25 : 0.015625, at = inner[i];
            const double here = (double)eye_x(at);
            gap[k] = fabs(((double)eye_x(at + step) - here) / step -
                          (here - (double)eye_x(at - step)) / step);
        }
        ck_assert_msg(gap[1] <= 0.1 * gap[0] + 1e-3, "at %u: %g then %g", inner[i], gap[0], gap[1]);
    }
}
END_TEST

static mn_camera random_camera(void) {
    mn_camera c = {.fov_y_deg = (float)(1 + 169 * random_unit())};
    for (int i = 0; i < 3; i++) {
        c.eye[i] = (float)(20 * random_unit() - 10);
        c.target[i] = (float)(20 * random_unit() - 10);
        c.up[i] = (float)(2 * random_unit() - 1);
    }
    return c;
}

static bool within(float value, float a, float b) {
    return value >= fminf(a, b) && value <= fmaxf(a, b);
}

/* Whatever the keys: passed exactly, as written; never left; up a unit vector. */
START_TEST(random_keys) {
    enum { KEYS = 40 };
    begin_random();
    for (int round = 0; round < 20; round++) {
        uint32_t frame[KEYS];
        mn_camera camera[KEYS], c;
        for (uint32_t i = 0; i < KEYS; i++) {
            frame[i] = i == 0 ? 0 : frame[i - 1] + 1 + (uint32_t)(20 * random_unit());
            camera[i] = random_camera();
        }
        write_keys(frame, camera, KEYS);
        ck_assert_uint_eq(mni_path_keys_last(&keys), frame[KEYS - 1]);
        for (uint32_t i = 0; i + 1 < KEYS; i++) {
            mni_path_keys_at(&keys, frame[i], &c);
            ck_assert_mem_eq(c.eye, camera[i].eye, sizeof c.eye);
            ck_assert_mem_eq(c.target, camera[i].target, sizeof c.target);
            ck_assert_float_eq(c.fov_y_deg, camera[i].fov_y_deg);
            for (int part = 0; part < 9; part++) {
                mni_path_keys_at(&keys, frame[i] + (frame[i + 1] - frame[i]) * random_unit(), &c);
                for (int a = 0; a < 3; a++) {
                    ck_assert(within(c.eye[a], camera[i].eye[a], camera[i + 1].eye[a]));
                    ck_assert(within(c.target[a], camera[i].target[a], camera[i + 1].target[a]));
                }
                ck_assert(within(c.fov_y_deg, camera[i].fov_y_deg, camera[i + 1].fov_y_deg));
                ck_assert_float_eq_tol(c.up[0] * c.up[0] + c.up[1] * c.up[1] + c.up[2] * c.up[2], 1,
                                       1e-6f);
            }
        }
    }
}
END_TEST

START_TEST(up_turns_over) {
    mn_camera c;
    read_text(HEAD "0 0 0 1 0 0 0 0 1 0\n10 0 0 1 0 0 0 0 -1 0\n");
    for (uint32_t frame = 0; frame <= 10; frame++) {
        mni_path_keys_at(&keys, frame, &c);
        ck_assert_float_eq(fabsf(c.up[1]), 1);
        ck_assert_float_eq(c.up[1], frame <= 5 ? 1 : -1);
    }
}
END_TEST

START_TEST(few_keys) {
    mn_camera c;
    read_text(HEAD "0 1 2 3 0 0 0 0 1 0");
    ck_assert_uint_eq(mni_path_keys_last(&keys), 0);
    ck_assert_float_eq(eye_x(0), 1);
    read_text(HEAD "0 1 2 3 0 0 0 0 5 0 # up is made a unit\n8 3 2 3 0 0 0 0 5 0 60\n");
    for (int i = 0; i <= 16; i++) /* two keys: a straight line */
        ck_assert_float_eq(eye_x(0.5 * i), 1 + 0.125f * (float)i);
    mni_path_keys_at(&keys, 4, &c);
    ck_assert_float_eq(c.up[1], 1);
    ck_assert_float_eq(c.fov_y_deg, 52.5f);
}
END_TEST

/* ---- paths ----------------------------------------------------------------------------------- */

START_TEST(as_many_frames_as_wanted) {
    const mn_header header = {.box_max = {1, 1, 1}};
    mn_path *path;
    mn_camera c, key;
    mn_status st = {0};
    open_uneven();
    ck_assert_int_eq(mn_path_open(file_name, &header, 45, &path, &st), MN_OK);
    ck_assert_uint_eq(mn_path_frames(path), 62);
    ck_assert_uint_ge(mn_path_bytes(path), 6 * sizeof c);
    for (uint32_t frame = 0; frame < 62; frame++) { /* as recorded: exactly */
        mn_path_camera(path, frame, 62, &c);
        mni_path_keys_at(&keys, frame, &key);
        ck_assert_mem_eq(&c, &key, sizeof c);
        mn_path_camera(path, 3 * frame, 184, &c); /* three times as slow */
        ck_assert_mem_eq(&c, &key, sizeof c);
    }
    mn_path_camera(path, 0, 1, &c);
    ck_assert_float_eq(c.eye[0], 0);
    mn_path_camera(path, 1, 2, &c);
    ck_assert_float_eq(c.eye[0], 8);
    mn_path_camera(path, UINT32_MAX, 2, &c); /* past the end: the last */
    ck_assert_float_eq(c.eye[0], 8);
    mn_path_close(path);
}
END_TEST

/* Each standard path written out, a key a frame: the same cameras, to the bit. */
START_TEST(standard_paths_written) {
    static const char *const names[] = {"orbit", "dive", "flyover"};
    const mn_header header = {.box_min = {-3, -1, 2},
                              .box_max = {5, 1, 6},
                              .dive_point = {1, 1, 4},
                              .dive_normal = {0.6f, 0.8f, 0}};
    enum { FRAMES = 97 };
    for (int n = 0; n < 3; n++) {
        uint32_t frame[FRAMES];
        mn_camera camera[FRAMES], c;
        mn_path *path;
        ck_assert_int_eq(mn_path_open(names[n], &header, 60, &path, NULL), MN_OK);
        for (uint32_t f = 0; f < FRAMES; f++) {
            frame[f] = f;
            mn_path_camera(path, f, FRAMES, &camera[f]);
        }
        mn_path_close(path);
        write_keys(frame, camera, FRAMES);
        ck_assert_int_eq(mn_path_open(file_name, &header, 45, &path, NULL), MN_OK);
        for (uint32_t f = 0; f < FRAMES; f++) {
            mn_path_camera(path, f, FRAMES, &c);
            ck_assert_mem_eq(&c, &camera[f], sizeof c);
        }
        mn_path_close(path);
    }
}
END_TEST

/* ---- text ------------------------------------------------------------------------------------ */

START_TEST(first_version) {
    mn_camera c;
    read_text("metanode path 1\n# a comment\n\n0 0 1  0 0 0  0 1 0\n"
              "2 0 1  0 0 0  0 1 0  60 # wider\n 4 2 1  0 0 0  0 1 0\r\n");
    ck_assert_uint_eq(keys.count, 3);
    mni_path_keys_at(&keys, 1, &c);
    ck_assert_float_eq(c.eye[0], 2);
    ck_assert_float_eq(c.fov_y_deg, 60);
    mni_path_keys_at(&keys, 2, &c);
    ck_assert_float_eq(c.eye[0], 4);
    ck_assert_float_eq(c.fov_y_deg, 45);
}
END_TEST

START_TEST(bad_files) {
    static const struct {
        const char *text, *says;
    } cases[] = {
        {"", "empty"},
        {"metanode path 3\n", "line 1: not a path file"},
        {"metanode path 22\n", "line 1: not a path file"},
        {"\n" HEAD, "line 1: not a path file"},
        {HEAD, "holds no camera"},
        {HEAD "# only a comment\n", "holds no camera"},
        {HEAD "0 1 2 3 4 5 6 7 8\n", "line 2: fewer than 9"},
        {HEAD "\n0 0 0 1 0 0 0 0 1 0 45 9\n", "line 3: more numbers"},
        {HEAD "0 0 0 1 0 0 0 0 1 x\n", "line 2: not a finite"},
        {HEAD "0 0 0 1 0 0 0 0 1 nan\n", "line 2: not a finite"},
        {HEAD "0 0 0 1 0 0 0 0 1 -inf\n", "line 2: not a finite"},
        {HEAD "0 0 0 1 0 0 0 0 1 1e99\n", "line 2: not a finite"},
        {HEAD "0 0 0 1,0 0 0 0 1 0\n", "line 2: not a finite"},
        {HEAD "0 0 0 1-2 0 0 0 1 0\n", "line 2: not a finite"},
        {HEAD "0 0 0 1e16 0 0 0 0 1 0\n", "line 2: a number beyond"},
        {HEAD "0 0 0 1 0 0 1 0 1 0\n", "line 2: eye and target"},
        {HEAD "0 0 0 1 0 0 0 0 0 0\n", "line 2: up has no length"},
        {HEAD "0 0 0 1 0 0 0 0 0 -3\n", "line 2: up lies along"},
        {HEAD "0 0 0 1 0 0 0 0 1 0 180\n", "line 2: angle"},
        {HEAD "0 0 0 1 0 0 0 0 1 0 0\n", "line 2: angle"},
        {HEAD "-1 0 0 1 0 0 0 0 1 0\n", "line 2: it must begin with a frame"},
        {HEAD "0.5 0 0 1 0 0 0 0 1 0\n", "line 2: it must begin with a frame"},
        {HEAD "1000000000 0 0 1 0 0 0 0 1 0\n", "line 2: it must begin with a frame"},
        {HEAD "1 0 0 1 0 0 0 0 1 0\n", "line 2: the first key"},
        {HEAD "0 0 0 1 0 0 0 0 1 0\n#\n0 0 0 1 0 0 0 0 1 0\n", "line 4: its frame is not after"},
        {HEAD "0 0 0 1 0 0 0 0 1 0\n5 0 0 1 0 0 0 0 1 0\n4 0 0 1 0 0 0 0 1 0", "line 4: its frame"},
        {HEAD "0 0 0 1 \33[31m 0 0 0 0 1 0\n", "line 2: a control character"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        mn_status st = {0};
        ck_assert_msg(read_bytes(cases[i].text, strlen(cases[i].text), &st) == MN_BAD_INPUT,
                      "case %zu", i);
        ck_assert_msg(strstr(st.text, cases[i].says) != NULL, "case %zu: %s", i, st.text);
    }
    static const char zero[] = HEAD "0 0 0 1 0 0 0 0 1 0\n# \0 \n";
    mn_status st = {0};
    ck_assert_int_eq(read_bytes(zero, sizeof zero - 1, &st), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "line 3: a control character"));
    st = (mn_status){0};
    ck_assert_int_eq(mni_path_keys_read("/", 45, &keys, &st), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "not a file"));
}
END_TEST

START_TEST(limits) {
    char text[2000] = HEAD "0 0 0 1 0 0 0 0 1 0 #";
    const size_t head = sizeof HEAD - 1, used = strlen(text);
    memset(text + used, 'x', sizeof text - used);
    mn_status st = {0};
    ck_assert_int_eq(read_bytes(text, head + 1023, &st), MN_OK);
    ck_assert_int_eq(read_bytes(text, head + 1024, &st), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "line 2: longer than"));
    read_text(HEAD "0 0 0 1 0 0 0 0 1 0\n999999999 1 0 1 0 0 0 0 1 0\n");
    ck_assert_float_eq_tol(eye_x(499999999.5), 0.5f, 1e-7f);

    FILE *f = fopen(file_name, "w");
    ck_assert_ptr_nonnull(f);
    fputs("metanode path 1\n", f);
    for (int i = 0; i <= 1500000; i++)
        fputs("0 0 1 0 0 0 0 1 0\n", f);
    ck_assert_int_eq(fclose(f), 0);
    mni_path_keys_free(&keys);
    ck_assert_int_eq(mni_path_keys_read(file_name, 45, &keys, (st = (mn_status){0}, &st)),
                     MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "line 1500002: more than 1500000 keys"));
}
END_TEST

/* A good file with bytes changed, lost and repeated: read as something that keeps the rules, or
 * refused by a line. */
START_TEST(damaged) {
    static const char good[] =
        HEAD "# a comment\n0 1 2 3 0 0 0 0 1 0 45\n7 1.5 -2e1 3 0 0.25 0 0 1 0\n"
             "9 1 2 3 4 5 6 7 8 -9\t170 # there\r\n1000 -1 2 3 1e10 5 6 7 8 -9 1\n";
    static const char palette[] = "0123456789.-+eE #\t\n\rnaifx\0\377";
    begin_random();
    for (int round = 0; round < 4000; round++) {
        char text[sizeof good];
        size_t bytes = sizeof good - 1;
        memcpy(text, good, sizeof good);
        for (int n = 1 + (int)(3 * random_unit()); n > 0; n--) {
            const size_t at = (size_t)(random_unit() * (double)bytes);
            if (random_unit() < 0.2)
                memmove(text + at, text + at + 1, --bytes - at);
            else
                text[at] = palette[(size_t)(random_unit() * (sizeof palette - 1))];
        }
        mn_status st = {0};
        if (read_bytes(text, bytes, &st) != MN_OK) {
            ck_assert_int_eq(st.code, MN_BAD_INPUT);
            ck_assert_msg(strstr(st.text, ": line ") != NULL ||
                              strstr(st.text, "no camera") != NULL,
                          "%s", st.text);
            continue;
        }
        ck_assert(keys.count > 0 && keys.frame[0] == 0);
        for (uint32_t i = 0; i < keys.count; i++) {
            ck_assert(i == 0 || keys.frame[i] > keys.frame[i - 1]);
            ck_assert(keys.camera[i].fov_y_deg >= 1 && keys.camera[i].fov_y_deg <= 170);
            for (int a = 0; a < 3; a++)
                ck_assert(isfinite(keys.camera[i].eye[a]) && isfinite(keys.camera[i].target[a]));
        }
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("path_keys");
    TCase *tc = tcase_create("path_keys");
    tcase_set_timeout(tc, 60);
    tcase_add_checked_fixture(tc, set_up, tear_down);
    tcase_add_test(tc, values_of_pchip);
    tcase_add_test(tc, derivative_is_continuous);
    tcase_add_test(tc, random_keys);
    tcase_add_test(tc, up_turns_over);
    tcase_add_test(tc, few_keys);
    tcase_add_test(tc, as_many_frames_as_wanted);
    tcase_add_test(tc, standard_paths_written);
    tcase_add_test(tc, first_version);
    tcase_add_test(tc, bad_files);
    tcase_add_test(tc, limits);
    tcase_add_test(tc, damaged);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
