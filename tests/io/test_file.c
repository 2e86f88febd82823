/* Goal: a written file appears whole or not at all, and trouble is said in the right class.
 * Method: files in a directory of our own; a full disk is played by /dev/full's kin, RLIMIT_FSIZE;
 * a poorer file system by a filter on system calls. */
#define _GNU_SOURCE /* O_TMPFILE */
#include <check.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "file.h"
#include "refuse.h"
#include "suite.h"

static char directory[64];

static void setup(void) {
    strcpy(directory, "/tmp/mn-file-XXXXXX");
    ck_assert_ptr_nonnull(mkdtemp(directory));
    ck_assert_int_eq(chdir(directory), 0);
}

static uint32_t entries(void) {
    uint32_t count = 0;
    DIR *dir = opendir(directory);
    for (const struct dirent *entry; (entry = readdir(dir)) != NULL;)
        count += strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
    closedir(dir);
    return count;
}

static void teardown(void) {
    unlink("out");
    unlink("link");
    unlink("big");
    rmdir("dir");
    ck_assert_uint_eq(entries(), 0); /* nothing temporary is left */
    ck_assert_int_eq(rmdir(directory), 0);
}

static void write_all(const char *path, size_t count, mn_code expect) {
    unsigned char *bytes = malloc(count);
    mn_status st = {0};
    mni_out out;
    for (size_t i = 0; i < count; i++)
        bytes[i] = (unsigned char)(i * 7 + i / 256);
    ck_assert_int_eq(mni_out_open(&out, path, &st), MN_OK);
    for (size_t at = 0, step = 1; at < count; at += step, step = 1 + (step * 3) % 70000)
        (void)mni_out_write(&out, bytes + at, at + step < count ? step : count - at, &st);
    ck_assert_uint_eq(expect == MN_OK ? mni_out_at(&out) : count, count);
    (void)mni_out_write_at(&out, 0, "head", 4, &st);
    ck_assert_int_eq(mni_out_commit(&out, &st), expect);
    ck_assert_int_eq(st.code, expect);
    mni_out_abort(&out); /* harmless */
    free(bytes);
}

START_TEST(appears_whole) {
    enum { COUNT = 1000000 };
    write_all("out", COUNT, MN_OK);
    write_all("out", COUNT, MN_OK); /* over the old one */
    mni_in in;
    mn_status st = {0};
    unsigned char *bytes = malloc(COUNT + 10);
    ck_assert_int_eq(mni_in_open(&in, "out", &st), MN_OK);
    ck_assert_uint_eq(in.size_bytes, COUNT);
    ck_assert_int_eq(mni_in_read(&in, 0, bytes, COUNT + 10), COUNT);
    ck_assert_mem_eq(bytes, "head", 4);
    for (int i = 4; i < COUNT; i++)
        ck_assert_uint_eq(bytes[i], (unsigned char)(i * 7 + i / 256));
    ck_assert_int_eq(mni_in_read(&in, COUNT - 5, bytes, 10), 5);
    ck_assert_int_eq(mni_in_read(&in, COUNT + 5, bytes, 10), 0);
    mni_in_close(&in);
    free(bytes);
}
END_TEST

START_TEST(abort_leaves_the_old_one) {
    write_all("out", 100, MN_OK);
    mni_out out;
    ck_assert_int_eq(mni_out_open(&out, "out", NULL), MN_OK);
    ck_assert_int_eq(mni_out_write(&out, "x", 1, NULL), MN_OK);
    mni_out_abort(&out);
    struct stat info;
    ck_assert_int_eq(stat("out", &info), 0);
    ck_assert_int_eq(info.st_size, 100);
    memset(&out, 0, sizeof out);
    mni_out_abort(&out);
}
END_TEST

START_TEST(follows_links) {
    write_all("out", 10, MN_OK);
    ck_assert_int_eq(symlink("out", "link"), 0);
    write_all("link", 20, MN_OK);
    struct stat info;
    ck_assert_int_eq(lstat("link", &info), 0);
    ck_assert(S_ISLNK(info.st_mode));
    ck_assert_int_eq(stat("out", &info), 0);
    ck_assert_int_eq(info.st_size, 20);
}
END_TEST

START_TEST(refuses_what_is_no_file) {
    mni_out out;
    mni_in in;
    mn_status st = {0};
    ck_assert_int_eq(mkdir("dir", 0777), 0);
    ck_assert_int_eq(mni_out_open(&out, "dir", &st), MN_FAILED);
    st.code = MN_OK;
    ck_assert_int_eq(mni_out_open(&out, "/dev/null", &st), MN_FAILED);
    st.code = MN_OK;
    ck_assert_int_eq(mni_out_open(&out, "nowhere/out", &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "nowhere/out"));
    st.code = MN_OK;
    ck_assert_int_eq(mni_in_open(&in, "dir", &st), MN_BAD_INPUT);
    st.code = MN_OK;
    ck_assert_int_eq(mni_in_open(&in, "none", &st), MN_BAD_INPUT);
    st.code = MN_OK;
    ck_assert_int_eq(mni_in_open(&in, "/dev/zero", &st), MN_BAD_INPUT);
}
END_TEST

/* Killed in the middle: the old one stands and nothing else does. */
START_TEST(a_kill_leaves_the_old_one) {
    write_all("out", 10, MN_OK);
    pid_t child = fork();
    if (child == 0) {
        mni_out out;
        static const unsigned char bytes[400000];
        mn_status st = {0};
        if (mni_out_open(&out, "out", &st) != MN_OK ||
            mni_out_write(&out, bytes, sizeof bytes, &st) != MN_OK)
            _exit(1);
        raise(SIGKILL);
    }
    int status;
    struct stat info;
    ck_assert_int_eq(waitpid(child, &status, 0), child);
    ck_assert(WIFSIGNALED(status));
    ck_assert_uint_eq(entries(), 1);
    ck_assert_int_eq(stat("out", &info), 0);
    ck_assert_int_eq(info.st_size, 10);
}
END_TEST

#ifndef SYS_rename /* newer machines have one call less */
#define SYS_rename SYS_renameat
#endif

/* Killed on the way to its name: where nothing stood, there is no temporary name that would stay.
 */
START_TEST(a_new_one_takes_one_step) {
    if (!refuse_call(SYS_rename, 0, 0, 0, EIO)) {
        printf("skipped: no filters of system calls here\n");
        return;
    }
    write_all("out", 1000, MN_OK);
    ck_assert_uint_eq(entries(), 1);
}
END_TEST

/* A file system without nameless files (many network ones): the same, but for the kill. */
START_TEST(without_nameless_files) {
    if (!refuse_call(SYS_openat, 2, O_TMPFILE, O_TMPFILE, EOPNOTSUPP)) {
        printf("skipped: no filters of system calls here\n");
        return;
    }
    mni_out out;
    ck_assert_int_eq(mni_out_open(&out, "out", NULL), MN_OK);
    ck_assert_uint_eq(entries(), 1); /* the temporary one */
    mni_out_abort(&out);
    ck_assert_uint_eq(entries(), 0);
    write_all("out", 1000000, MN_OK);
    ck_assert_uint_eq(entries(), 1);
    struct rlimit limit = {300000, 300000};
    signal(SIGXFSZ, SIG_IGN);
    ck_assert_int_eq(setrlimit(RLIMIT_FSIZE, &limit), 0);
    write_all("big", 1000000, MN_NO_SPACE);
    ck_assert_uint_eq(entries(), 1);
}
END_TEST

/* Names that another process of this number has left are not taken, and not touched. */
START_TEST(names_taken_are_left_alone) {
    char name[64];
    snprintf(name, sizeof name, ".metanode-%ld-0.tmp", (long)getpid());
    if (_i == 1 && !refuse_call(SYS_openat, 2, O_TMPFILE, O_TMPFILE, EOPNOTSUPP))
        return;
    write_all("out", 500, MN_OK);
    ck_assert_int_eq(mkdir(name, 0777), 0);
    write_all("out", 1000, MN_OK); /* over what stands there */
    ck_assert_uint_eq(entries(), 2);
    ck_assert_int_eq(rmdir(name), 0);
}
END_TEST

/* A write that fails: nothing is left, the status says so, and later calls are harmless. */
START_TEST(a_failed_write_leaves_nothing) {
    struct rlimit limit = {300000, 300000};
    signal(SIGXFSZ, SIG_IGN);
    ck_assert_int_eq(setrlimit(RLIMIT_FSIZE, &limit), 0);
    write_all("big", 1000000, MN_NO_SPACE);
    ck_assert_uint_eq(entries(), 0);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("file");
    TCase *tests = tcase_create("file");
    tcase_add_checked_fixture(tests, setup, teardown);
    tcase_add_test(tests, appears_whole);
    tcase_add_test(tests, abort_leaves_the_old_one);
    tcase_add_test(tests, follows_links);
    tcase_add_test(tests, refuses_what_is_no_file);
    tcase_add_test(tests, a_failed_write_leaves_nothing);
    tcase_add_test(tests, a_kill_leaves_the_old_one);
    tcase_add_test(tests, a_new_one_takes_one_step);
    tcase_add_test(tests, without_nameless_files);
    tcase_add_loop_test(tests, names_taken_are_left_alone, 0, 2);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
