/* Goal: temporary files go where they should, what they hold of the disk is what they hold and
 * nothing else, and a disk without room is refused in one line. Method: files of each kind, of
 * known size. */
#define _GNU_SOURCE /* O_TMPFILE */
#include <check.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "suite.h"
#include "temp.h"

static char folder[] = "/tmp/mn-temp-XXXXXX";
static temp_files files;

static void place(const char *out, const char *temp_dir) {
    mn_status st = {0};
    ck_assert_msg(temp_place(&files, out, temp_dir, false, &st) == MN_OK, "%s", st.text);
}

START_TEST(places) {
    char first[PATH_MAX];
    place("out.mnt", NULL);
    ck_assert_str_eq(files.folder, ".");
    ck_assert_str_eq(files.work, "out.mnt.work");
    place("/tmp/out.mnt", NULL);
    ck_assert_str_eq(files.folder, "/tmp");
    ck_assert_str_eq(files.work, "/tmp/out.mnt.work");
    place("/out.mnt", NULL);
    ck_assert_str_eq(files.folder, "/");
    place("/tmp/out.mnt", "/var/tmp");
    ck_assert_str_eq(files.folder, "/var/tmp");
    ck_assert_int_eq(strncmp(files.work, "/var/tmp/out.mnt-", 17), 0);
    memcpy(first, files.work, sizeof first);
    place("/out.mnt", "/var/tmp"); /* of that name, elsewhere */
    ck_assert_str_ne(files.work, first);
    place("/tmp/../tmp/./out.mnt", "/var/tmp"); /* the same place */
    ck_assert_str_eq(files.work, first);
    char *much = malloc(2 * PATH_MAX);
    mn_status st = {0};
    memset(much, 'x', 2 * PATH_MAX - 1);
    much[2 * PATH_MAX - 1] = 0;
    ck_assert_int_eq(temp_place(&files, much, NULL, false, &st), MN_FAILED);
    st = (mn_status){0};
    ck_assert_int_eq(temp_place(&files, "out.mnt", much, false, &st), MN_FAILED);
    free(much);
}
END_TEST

/* An open file of so many bytes; name NULL: none. */
static int file_of(const char *name, size_t bytes) {
    char path[PATH_MAX];
    char *data = calloc(1, bytes);
    memset(data, 1, bytes);
    snprintf(path, sizeof path, "%s/%s", folder, name != NULL ? name : "");
    int fd =
        name != NULL ? open(path, O_RDWR | O_CREAT, 0600) : open(folder, O_RDWR | O_TMPFILE, 0600);
    ck_assert_int_ge(fd, 0);
    ck_assert_int_eq(write(fd, data, bytes), bytes);
    fsync(fd);
    free(data);
    return fd;
}

/* What is held now; looks are 50 ms apart. */
static uint64_t held(void) {
    nanosleep(&(struct timespec){.tv_nsec = 60000000}, NULL);
    temp_look(&files);
    return files.held_bytes;
}

START_TEST(what_is_held) {
    enum { MEGABYTE = 1 << 20 };
    char out[64], path[80];
    snprintf(out, sizeof out, "%s/out", folder);
    place(out, NULL);
    const uint64_t before = held(); /* whatever the harness has open */
    int nameless = file_of(NULL, 2 * MEGABYTE), other = file_of("mesh", 8 * MEGABYTE);
    ck_assert_uint_eq(held(), before + 2 * MEGABYTE);
    ck_assert_int_eq(mkdir(files.work, 0700), 0);
    int kept = file_of("out.work/1-0", MEGABYTE), beside = file_of("out.worked", MEGABYTE);
    ck_assert_uint_eq(held(), before + 3 * MEGABYTE);
    close(nameless);
    ck_assert_uint_eq(held(), before + MEGABYTE);
    ck_assert_uint_eq(files.peak_bytes, before + 3 * MEGABYTE);
    close(other);
    close(kept);
    close(beside);
    static const char *const names[] = {"out.work/1-0", "out.worked", "mesh"};
    for (int i = 0; i < 3; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        unlink(path);
    }
    rmdir(files.work);
}
END_TEST

/* Who asks at every step does not go through /proc each time. A disk that is slow to take the file
 * is no fault: then it is tried again. */
START_TEST(looks_are_apart) {
    char out[64];
    snprintf(out, sizeof out, "%s/out", folder);
    place(out, NULL);
    const uint64_t before = held();
    struct timespec from, to;
    double ms;
    do {
        (void)held();
        clock_gettime(CLOCK_MONOTONIC, &from);
        int nameless = file_of(NULL, 4096);
        temp_look(&files);
        clock_gettime(CLOCK_MONOTONIC, &to);
        ms = 1e3 * (double)(to.tv_sec - from.tv_sec) + 1e-6 * (double)(to.tv_nsec - from.tv_nsec);
        if (ms < 40)
            ck_assert_uint_eq(files.held_bytes, before);
        ck_assert_uint_eq(held(), before + 4096);
        close(nameless);
    } while (ms >= 40);
}
END_TEST

/* A build that goes on after a kill needs no room for what it has already, nor does one that clears
 * it: both were refused on a disk that was fuller than the plan. */
/* Some stay open for a while, as a build's do. */
static void *opens_and_closes(void *until) {
    enum { OPEN = 32 };
    int fd[OPEN];
    while (!atomic_load_explicit((atomic_bool *)until, memory_order_relaxed)) {
        for (int i = 0; i < OPEN; i++)
            fd[i] = open(folder, O_TMPFILE | O_WRONLY, 0600);
        for (int i = 0; i < OPEN; i++)
            close(fd[i]);
    }
    return NULL;
}

/* Whoever looks has no part in what other threads open: the thread sanitizer says so. */
START_TEST(others_open_files_meanwhile) {
    pthread_t other;
    atomic_bool enough = false;
    place("/tmp/out.mnt", NULL);
    const uint64_t before = held();
    ck_assert_int_eq(pthread_create(&other, NULL, opens_and_closes, &enough), 0);
    for (int i = 0; i < 200; i++) {
        files.looked_s = 0;
        temp_look(&files);
        ck_assert_uint_le(files.held_bytes, before + (1 << 20)); /* theirs are empty */
    }
    atomic_store(&enough, true);
    pthread_join(other, NULL);
}
END_TEST

START_TEST(what_is_kept_is_room) {
    enum { KEPT_BYTES = 64 << 20 };
    mn_status st = {0};
    struct statvfs disk;
    char out[64], path[PATH_MAX + 8];
    snprintf(out, sizeof out, "%s/out", folder);
    place(out, NULL);
    ck_assert_int_eq(mkdir(files.work, 0700), 0);
    int kept = file_of("out.work/2-0", 1);
    ck_assert_int_eq(posix_fallocate(kept, 0, KEPT_BYTES), 0);
    ck_assert_int_eq(statvfs(folder, &disk), 0);
    files.planned_bytes = disk.f_bavail * disk.f_frsize + KEPT_BYTES / 2;
    ck_assert_msg(temp_check(&files, out, &st) == MN_OK, "%s", st.text);
    close(kept);
    snprintf(path, sizeof path, "%s/2-0", files.work);
    unlink(path);
    rmdir(files.work);
}
END_TEST

/* Only a build that has got as far as its folder takes the link away that --resume would follow;
 * what the link leads to is not in its folder. */
START_TEST(links_stay_until_taken) {
    char out[64], kept[64], link[80], to[PATH_MAX];
    snprintf(out, sizeof out, "%s/out", folder);
    snprintf(kept, sizeof kept, "%s/kept", folder);
    snprintf(link, sizeof link, "%s.work", out);
    ck_assert_int_eq(mkdir(kept, 0700), 0);
    ck_assert_int_eq(symlink(kept, link), 0);
    close(file_of("kept/1-0", 4096));
    place("elsewhere", NULL);
    const uint64_t before = held(); /* whatever the harness has open */
    place(out, NULL);
    ck_assert_uint_eq(held(), before);
    temp_end(&files); /* refused before it began */
    ck_assert_int_eq(readlink(link, to, sizeof to), strlen(kept));
    temp_take(&files);
    ck_assert_int_eq(readlink(link, to, sizeof to), -1);
    ck_assert_str_eq(temp_left(&files), kept);
    temp_end(&files);
    snprintf(link, sizeof link, "%s/1-0", kept);
    unlink(link);
    rmdir(kept);
}
END_TEST

START_TEST(room) {
    mn_status st = {0};
    char out[64];
    snprintf(out, sizeof out, "%s/out", folder);
    place(out, NULL);
    files.planned_bytes = 1;
    ck_assert_int_eq(temp_check(&files, out, &st), MN_OK);
    files.planned_bytes = UINT64_MAX / 2;
    ck_assert_int_eq(temp_check(&files, out, &st), MN_NO_SPACE);
    ck_assert_ptr_nonnull(strstr(st.text, "8796093022208.0 MB are needed"));
    ck_assert_ptr_nonnull(strstr(st.text, "--temp-dir"));
    ck_assert_ptr_null(strchr(st.text, '\n'));
    st = (mn_status){0};
    place(out, "/nowhere");
    ck_assert_int_eq(temp_check(&files, out, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "/nowhere"));
}
END_TEST

int main(void) {
    if (mkdtemp(folder) == NULL)
        return 1;
    Suite *suite = suite_create("temp");
    TCase *tc = tcase_create("temp");
    tcase_add_test(tc, places);
    tcase_add_test(tc, what_is_held);
    tcase_add_test(tc, looks_are_apart);
    tcase_add_test(tc, others_open_files_meanwhile);
    tcase_add_test(tc, what_is_kept_is_room);
    tcase_add_test(tc, links_stay_until_taken);
    tcase_add_test(tc, room);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    rmdir(folder);
    return failed;
}
