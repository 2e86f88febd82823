/* Goal: a build goes on from its last finished phase and from nothing else: not from a phase half
 * kept, not from bytes, options or a mesh that are others, not from a folder that is another's.
 * Method: phases of seeded bytes, kept, left by a process that is killed, damaged byte by byte. */
#define _GNU_SOURCE
#include <check.h>
#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "suite.h"
#include "work.h"

typedef struct facts {
    uint64_t count, phase;
} facts;

static char folder[] = "/tmp/mn-work-XXXXXX";
static char place[64], mesh[64];
static mn_read_desc read_desc;
static mn_simplify_desc simplify_desc;

static void write_mesh(const char *text) {
    FILE *f = fopen(mesh, "w");
    ck_assert_ptr_nonnull(f);
    fputs(text, f);
    fclose(f);
}

static bool clear(void) {
    char command[80];
    snprintf(command, sizeof command, "rm -rf %s/*", folder);
    return system(command) == 0;
}

static void setup(void) {
    ck_assert(clear());
    snprintf(place, sizeof place, "%s/out.work", folder);
    snprintf(mesh, sizeof mesh, "%s/mesh", folder);
    write_mesh("a mesh");
    read_desc = (mn_read_desc){0};
    simplify_desc = (mn_simplify_desc){0};
}

static int entries(const char *path) {
    int count = 0;
    DIR *d = opendir(path);
    if (d == NULL)
        return -1;
    while (readdir(d) != NULL)
        count++;
    closedir(d);
    return count - 2;
}

static mn_work *try_open(bool resume, mn_code code, const char *word) {
    const mn_work_desc desc = {.path = place,
                               .in = mesh,
                               .read = &read_desc,
                               .simplify = &simplify_desc,
                               .resume = resume};
    mn_work *work;
    mn_status st = {0};
    ck_assert_msg(mn_work_open(&work, &desc, &st) == code, "%d: %s", st.code, st.text);
    if (code != MN_OK) {
        ck_assert_msg(strstr(st.text, word) != NULL, "%s", st.text);
        ck_assert_ptr_null(work);
    }
    return work;
}

/* A kept spill with that many numbers from `first` on. */
static mni_spill numbers(uint64_t first, uint64_t count) {
    mni_spill s;
    mn_status st = {0};
    ck_assert_int_eq(mni_spill_open(&s, folder, &st), MN_OK);
    ck_assert_int_eq(mni_spill_keep(&s, &st), MN_OK);
    for (uint64_t i = first; i < first + count; i++)
        ck_assert_int_eq(mni_spill_append(&s, &i, sizeof i), MN_OK);
    return s;
}

static void has_numbers(mni_spill *s, uint64_t first, uint64_t count) {
    uint64_t buffer[16], wrong = 0, taken = 0;
    const uint64_t *at;
    mni_spill_reader r;
    ck_assert_uint_eq(s->size_bytes, count * sizeof *at);
    mni_spill_reader_open(&r, s, 0, s->size_bytes, buffer, sizeof buffer, true);
    for (; (at = mni_spill_take(&r, sizeof *at)) != NULL; taken++)
        wrong += *at != first + taken;
    ck_assert_uint_eq(taken, count);
    ck_assert_uint_eq(wrong, 0);
    mni_spill_close(s);
}

static void keep(mn_work *work, mn_phase phase, uint64_t count) {
    const facts f = {count, phase};
    mn_status st = {0};
    mni_spill a = numbers(phase, count), b = numbers(1000 * phase, 2 * count);
    mni_spill *const both[] = {&a, &b};
    ck_assert_msg(mni_work_keep(work, phase, &f, sizeof f, both, 2, &st) == MN_OK, "%s", st.text);
    has_numbers(&a, phase, count); /* they go on as they are */
    mni_spill_close(&b);
}

static void take(mn_work *work, mn_phase phase, uint64_t count) {
    facts f;
    mn_status st = {0};
    mni_spill a, b;
    mni_spill *const both[] = {&a, &b};
    ck_assert_int_eq(mn_work_done(work), phase);
    ck_assert_int_eq(mni_work_take(work, &f, sizeof f, both, 2, &st), MN_OK);
    ck_assert_uint_eq(f.count, count);
    ck_assert_uint_eq(f.phase, phase);
    has_numbers(&a, phase, count);
    has_numbers(&b, 1000 * phase, 2 * count);
}

/* A build in a process of its own that is killed when it has kept the phases up to `last`. */
static void killed_after(mn_phase last) {
    fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        mn_work *work = try_open(true, MN_OK, "");
        for (mn_phase p = MN_PHASE_READ; p <= last; p++)
            keep(work, p, 50 + p);
        raise(SIGKILL);
    }
    int status;
    ck_assert_int_eq(waitpid(child, &status, 0), child);
    ck_assert(WIFSIGNALED(status));
}

START_TEST(nothing_stays_of_a_build_that_ends) {
    mn_work *work = try_open(false, MN_OK, "");
    ck_assert_int_eq(mn_work_done(work), MN_PHASE_NONE);
    ck_assert_int_eq(entries(place), 0);
    keep(work, MN_PHASE_READ, 10);
    ck_assert_int_eq(entries(place), 3);
    keep(work, MN_PHASE_ORDER, 0); /* empty files; and the first phase's are gone */
    ck_assert_int_eq(entries(place), 3);
    mn_work_close(work);
    ck_assert_int_eq(entries(place), -1);
    ck_assert_int_eq(entries(folder), 1); /* the mesh */
    mn_work_close(NULL);
    ck_assert_int_eq(mn_work_done(NULL), MN_PHASE_NONE);
    ck_assert_int_eq(mni_work_keep(NULL, MN_PHASE_READ, NULL, 0, NULL, 0, NULL), MN_OK);
}
END_TEST

START_TEST(goes_on_after_each_phase) {
    for (mn_phase p = MN_PHASE_READ; p <= MN_PHASE_ORDER; p++) {
        killed_after(p);
        ck_assert_int_eq(entries(place), 3);
        mn_work *work = try_open(true, MN_OK, "");
        ck_assert_ptr_nonnull(strstr(mn_work_note(work), "goes on after"));
        take(work, p, 50 + p);
        if (p < MN_PHASE_ORDER)
            keep(work, p + 1, 7);
        ck_assert_int_eq(entries(place), 3);
        mn_work_close(work);
        ck_assert_int_eq(entries(place), -1);
    }
}
END_TEST

/* A file that goes through two phases, and one of a phase that was killed while it was kept. */
START_TEST(files_of_two_phases) {
    killed_after(MN_PHASE_READ);
    mn_work *work = try_open(true, MN_OK, "");
    facts f;
    mn_status st = {0};
    mni_spill a, b;
    mni_spill *const both[] = {&a, &b}, *const second[] = {&b};
    ck_assert_int_eq(mni_work_take(work, &f, sizeof f, both, 2, &st), MN_OK);
    ck_assert_int_eq(mni_work_keep(work, MN_PHASE_SIMPLIFY, &f, sizeof f, second, 1, &st), MN_OK);
    mni_spill_close(&a);
    has_numbers(&b, 1000, 2 * 51);
    ck_assert_int_eq(entries(place), 2);
    mn_work_close(work);

    char name[80];
    killed_after(MN_PHASE_SIMPLIFY);
    for (int i = 0; i < 3; i++) {
        static const char *const half[] = {"3-0", "state.new", "1-1"};
        snprintf(name, sizeof name, "%s/%s", place, half[i]);
        close(open(name, O_CREAT | O_WRONLY, 0600));
    }
    work = try_open(true, MN_OK, "");
    ck_assert_int_eq(entries(place), 3);
    take(work, MN_PHASE_SIMPLIFY, 52);
    keep(work, MN_PHASE_ORDER, 3);
    mn_work_close(work);
    ck_assert_int_eq(entries(place), -1);
}
END_TEST

START_TEST(begins_anew) {
    mn_work *work = try_open(true, MN_OK, ""); /* nothing there */
    ck_assert_ptr_nonnull(strstr(mn_work_note(work), "nothing to go on from; from the beginning"));
    ck_assert_int_eq(mn_work_done(work), MN_PHASE_NONE);
    mn_work_close(work);
    killed_after(MN_PHASE_NONE); /* in its first phase */
    work = try_open(true, MN_OK, "");
    ck_assert_int_eq(mn_work_done(work), MN_PHASE_NONE);
    mn_work_close(work);
    killed_after(MN_PHASE_READ); /* not asked to resume */
    work = try_open(false, MN_OK, "");
    ck_assert_int_eq(mn_work_done(work), MN_PHASE_NONE);
    ck_assert_int_eq(entries(place), 0);
    mn_work_close(work);
}
END_TEST

START_TEST(another_build) {
    killed_after(MN_PHASE_READ);
    simplify_desc.metric = MN_METRIC_LENGTH;
    try_open(true, MN_USAGE, "other options");
    simplify_desc.metric = MN_METRIC_QEM;
    read_desc.weld = MN_WELD_OFF;
    try_open(true, MN_USAGE, "other options");
    read_desc.weld = MN_WELD_ON;
    simplify_desc.position_bits = 12;
    try_open(true, MN_USAGE, "other options");
    simplify_desc.position_bits = 0;
    simplify_desc.threads = 7; /* the result does not depend on these */
    simplify_desc.ram_bytes = read_desc.ram_bytes = 1 << 24;
    mn_work *work = try_open(true, MN_OK, "");
    ck_assert_int_eq(mn_work_done(work), MN_PHASE_READ);
    try_open(true, MN_FAILED, "another build has it");
    try_open(false, MN_FAILED, "another build has it");
    mn_work_close(work);

    killed_after(MN_PHASE_READ);
    write_mesh("A mesh");
    try_open(true, MN_BAD_INPUT, "has changed");
    unlink(mesh);
    try_open(true, MN_BAD_INPUT, "cannot open");
    ck_assert_int_eq(entries(place), 3); /* whoever is refused changes nothing */
}
END_TEST

/* Whoever is killed has its lock a moment longer: it is waited for. */
START_TEST(killed_just_now) {
    int ready[2];
    char byte;
    ck_assert_int_eq(pipe(ready), 0);
    fflush(NULL);
    const pid_t child = fork();
    if (child == 0) {
        keep(try_open(true, MN_OK, ""), MN_PHASE_READ, 51);
        _exit(write(ready[1], "r", 1) == 1 &&
              nanosleep(&(struct timespec){.tv_nsec = 50000000}, NULL));
    }
    ck_assert_int_eq(read(ready[0], &byte, 1), 1);
    mn_work *work = try_open(true, MN_OK, ""); /* its lock is taken still */
    take(work, MN_PHASE_READ, 51);
    mn_work_close(work);
    ck_assert_int_eq(waitpid(child, NULL, 0), child);
    close(ready[0]);
    close(ready[1]);
}
END_TEST

START_TEST(folders_of_others) {
    char name[80];
    ck_assert_int_eq(mkdir(place, 0700), 0);
    snprintf(name, sizeof name, "%s/thesis.tex", place);
    close(open(name, O_CREAT | O_WRONLY, 0600));
    try_open(false, MN_FAILED, "thesis.tex");
    ck_assert_int_eq(entries(place), 1);
    unlink(name);
    ck_assert_int_eq(chmod(place, 0777), 0);
    try_open(true, MN_FAILED, "not a folder of yours alone");
    rmdir(place);
    ck_assert_int_eq(symlink(folder, place), 0);
    try_open(false, MN_FAILED, "not a folder of yours alone");
    unlink(place);
    close(open(place, O_CREAT | O_WRONLY, 0600));
    try_open(false, MN_FAILED, "not a folder of yours alone");
    unlink(place);
    snprintf(place, sizeof place, "%s/no/where", folder);
    try_open(false, MN_FAILED, "--temp-dir");
}
END_TEST

static long size_of(const char *path) {
    struct stat info;
    return stat(path, &info) == 0 ? (long)info.st_size : -1;
}

static void change_byte(const char *path, long at, unsigned char by) {
    unsigned char byte;
    int fd = open(path, O_RDWR);
    ck_assert_int_eq(pread(fd, &byte, 1, at), 1);
    byte ^= by;
    ck_assert_int_eq(pwrite(fd, &byte, 1, at), 1);
    close(fd);
}

/* No byte of what is there can change, nor the length: then work begins anew. */
START_TEST(damage) {
    static const char *const names[] = {"state", "2-0", "2-1"};
    char path[80];
    for (int i = 0; i < 3; i++) {
        killed_after(MN_PHASE_SIMPLIFY);
        snprintf(path, sizeof path, "%s/%s", place, names[i]);
        const long size = size_of(path);
        ck_assert_int_gt(size, 0);
        for (long at = 0; at <= size; at += 1 + at / 40) {
            const bool cut = at == size;
            if (cut)
                ck_assert_int_eq(truncate(path, size - 1), 0);
            else
                change_byte(path, at, (unsigned char)(1 + at % 255));
            fflush(NULL);
            pid_t child = fork();
            if (child == 0) {
                mn_work *work = try_open(true, MN_OK, "");
                ck_assert_int_eq(mn_work_done(work), MN_PHASE_NONE);
                ck_assert_ptr_nonnull(strstr(mn_work_note(work), "from the beginning"));
                ck_assert_int_eq(entries(place), 0);
                _exit(0);
            }
            int status;
            ck_assert_int_eq(waitpid(child, &status, 0), child);
            ck_assert_int_eq(status, 0);
            killed_after(MN_PHASE_SIMPLIFY);
        }
        mn_work_close(try_open(false, MN_OK, ""));
    }
}
END_TEST

START_TEST(other_numbers) {
    killed_after(MN_PHASE_READ);
    mn_work *work = try_open(true, MN_OK, "");
    unsigned char f[64];
    mn_status st = {0};
    mni_spill a, b;
    mni_spill *const both[] = {&a, &b};
    ck_assert_int_eq(mni_work_take(work, f, sizeof f, both, 2, &st), MN_BAD_INPUT);
    st = (mn_status){0};
    ck_assert_int_eq(mni_work_take(work, f, sizeof(facts), both, 1, &st), MN_BAD_INPUT);
    mn_work_close(work);
}
END_TEST

int main(void) {
    if (mkdtemp(folder) == NULL)
        return 1;
    Suite *suite = suite_create("work");
    TCase *tc = tcase_create("work");
    tcase_set_timeout(tc, 60);
    tcase_add_checked_fixture(tc, setup, NULL);
    tcase_add_test(tc, nothing_stays_of_a_build_that_ends);
    tcase_add_test(tc, goes_on_after_each_phase);
    tcase_add_test(tc, files_of_two_phases);
    tcase_add_test(tc, begins_anew);
    tcase_add_test(tc, another_build);
    tcase_add_test(tc, killed_just_now);
    tcase_add_test(tc, folders_of_others);
    tcase_add_test(tc, damage);
    tcase_add_test(tc, other_numbers);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    clear();
    rmdir(folder);
    return failed;
}
