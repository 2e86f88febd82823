/* Goal: a recording is a path file that moves when the camera moved and stands where it stood, and
 * a path written out is the path. Method: cameras recorded here, and read back through
 * mn_path_open. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "path_record.h"
#include "suite.h"

static const char name[] = "test_path_record.path";
static const mn_header header = {.box_min = {-1, -1, -1}, .box_max = {1, 1, 1}};
static path_record record;
static mn_path *path;

static mn_camera at(float x) {
    return (mn_camera){.eye = {x, 0, 5}, .up = {0, 1, 0}, .fov_y_deg = 40};
}

static void see(uint32_t frame, float x) {
    const mn_camera camera = at(x);
    path_record_camera(&record, frame, &camera);
}

static void end(uint32_t frame, float x) {
    const mn_camera camera = at(x);
    mn_status st = {0};
    path_record_end(&record, frame, &camera);
    ck_assert_int_eq(fclose(record.file), 0);
    ck_assert_msg(mn_path_open(name, &header, 45, &path, &st) == MN_OK, "%s", st.text);
}

static float x_of(uint32_t frame) {
    mn_camera camera;
    mn_path_camera(path, frame, mn_path_frames(path), &camera);
    return camera.eye[0];
}

static void set_up(void) {
    record = (path_record){.file = fopen(name, "w")};
    ck_assert_ptr_nonnull(record.file);
    path = NULL;
}

static void tear_down(void) {
    mn_path_close(path);
    unlink(name);
}

START_TEST(moves_and_stands) {
    see(3, 0); /* the first is frame 0, whenever it comes */
    see(40, 0);
    see(41, 1); /* a slow machine: no picture for three frames */
    see(44, 2);
    see(44, 2.5f); /* two pictures in a frame: the first counts */
    see(45, 3);
    see(90, 3);
    end(100, 3);
    ck_assert_uint_eq(mn_path_frames(path), 101);
    for (uint32_t f = 0; f <= 40; f++)
        ck_assert_float_eq(x_of(f), 0);
    ck_assert_float_eq(x_of(41), 1);
    ck_assert(x_of(42) > 1 && x_of(43) > x_of(42) && x_of(43) < 2);
    ck_assert_float_eq(x_of(44), 2);
    for (uint32_t f = 45; f <= 100; f++)
        ck_assert_float_eq(x_of(f), 3);
}
END_TEST

/* It stood, was seen standing, and moved in the same frame. */
START_TEST(leaves_in_the_frame_it_stood) {
    see(0, 0);
    see(20, 0);
    see(20, 1);
    end(20, 1);
    ck_assert_uint_eq(mn_path_frames(path), 21);
    ck_assert_float_eq(x_of(19), 0);
    ck_assert_float_eq(x_of(20), 1);
}
END_TEST

START_TEST(shortest) {
    see(0, 1);
    end(0, 1);
    ck_assert_uint_eq(mn_path_frames(path), 1);
    ck_assert_float_eq(x_of(0), 1);
}
END_TEST

START_TEST(never_seen) {
    end(7, 1);
    ck_assert_uint_eq(mn_path_frames(path), 1);
}
END_TEST

START_TEST(last_camera_is_kept) {
    see(0, 0);
    see(0, 1);
    end(0, 2);
    ck_assert_uint_eq(mn_path_frames(path), 2);
    ck_assert_float_eq(x_of(0), 0);
    ck_assert_float_eq(x_of(1), 2);
}
END_TEST

/* Sparse keys: exact at the keys and at the end, near in between. */
START_TEST(all_of_a_path) {
    enum { FRAMES = 200 };
    static const uint64_t every[] = {1, 7, 199, 1000};
    static const double off_max[] = {0, 0.02, 1e9, 1e9};
    mn_path *orbit;
    mn_status st = {0};
    fclose(record.file);
    ck_assert_int_eq(mn_path_open("orbit", &header, 40, &orbit, &st), MN_OK);
    for (int i = 0; i < 4; i++) {
        ck_assert_int_eq(path_record_all(orbit, FRAMES, every[i], name, &st), MN_OK);
        ck_assert_msg(mn_path_open(name, &header, 45, &path, &st) == MN_OK, "%s", st.text);
        ck_assert_uint_eq(mn_path_frames(path), FRAMES);
        for (uint32_t f = 0; f < FRAMES; f++) {
            mn_camera a, b;
            mn_path_camera(orbit, f, FRAMES, &a);
            mn_path_camera(path, f, FRAMES, &b);
            if (f % every[i] == 0 || f == FRAMES - 1)
                ck_assert_mem_eq(&a, &b, sizeof a);
            for (int k = 0; k < 3; k++)
                ck_assert(fabsf(a.eye[k] - b.eye[k]) <= (float)off_max[i]);
        }
        mn_path_close(path);
    }
    path = NULL;
    ck_assert_int_eq(path_record_all(orbit, 1, 1, name, &st), MN_OK);
    ck_assert_int_eq(path_record_all(orbit, 5, 1, "/no/such/folder/a.path", &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "--write-path /no/such/folder/a.path"));
    unlink(name);
    static const uint32_t too_many[][2] = {{MN_PATH_KEYS_MAX + 1, 1}, {3 * MN_PATH_KEYS_MAX, 2}};
    for (int i = 0; i < 2; i++) {
        st = (mn_status){0};
        ck_assert_int_eq(path_record_all(orbit, too_many[i][0], too_many[i][1], name, &st),
                         MN_USAGE);
        ck_assert_ptr_nonnull(strstr(st.text, i == 0 ? "try --key-every 2" : "--key-every 4"));
        ck_assert_int_ne(access(name, F_OK), 0);
    }
    if (access("/dev/full", W_OK) == 0) {
        st = (mn_status){0};
        ck_assert_int_eq(path_record_all(orbit, 5, 1, "/dev/full", &st), MN_NO_SPACE);
    }
    mn_path_close(orbit);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("path_record");
    TCase *tc = tcase_create("path_record");
    tcase_add_checked_fixture(tc, set_up, tear_down);
    tcase_add_test(tc, moves_and_stands);
    tcase_add_test(tc, leaves_in_the_frame_it_stood);
    tcase_add_test(tc, shortest);
    tcase_add_test(tc, never_seen);
    tcase_add_test(tc, last_camera_is_kept);
    tcase_add_test(tc, all_of_a_path);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
