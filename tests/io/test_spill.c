/* Goal: what was written to a temporary file comes back, from any number of readers; it has no
 * name until it is given one, gives its room back as it is read, is taken up again only if it is
 * the same to the byte, and trouble is told in the right class. Method: seeded bytes in pieces and
 * buffers of many sizes; a full disk by /dev/full and RLIMIT_FSIZE; a cut file; a file system
 * without nameless files by a filter on system calls. */
#define _GNU_SOURCE /* O_TMPFILE, mincore */
#include <check.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "metanode/build.h"
#include "refuse.h"
#include "spill.h"
#include "suite.h"

static char folder[] = "/tmp/mn-spill-XXXXXX";

static int entries(void) {
    int count = 0;
    DIR *d = opendir(folder);
    while (readdir(d) != NULL)
        count++;
    closedir(d);
    return count - 2;
}

static mni_spill open_spill(void) {
    mni_spill s;
    mn_status st = {0};
    ck_assert_msg(mni_spill_open(&s, folder, &st) == MN_OK, "%s", st.text);
    ck_assert_int_eq(entries(), 0);
    return s;
}

/* Byte i of a spill. */
static unsigned char byte_at(uint64_t i) {
    return (unsigned char)(i * 31 + i / 251);
}

/* Appends through a buffer, in puts of changing sizes. */
static mn_code fill(mni_spill *s, uint64_t count, size_t buffer_bytes) {
    unsigned char piece[3000], *buffer = malloc(buffer_bytes);
    uint64_t at = s->size_bytes;
    mni_spill_writer w;
    mni_spill_writer_open(&w, s, buffer, buffer_bytes);
    for (uint64_t left = count, size = 1; left > 0; size = 1 + (size * 7 + 11) % sizeof piece) {
        size = size < left ? size : left;
        for (uint64_t i = 0; i < size; i++)
            piece[i] = byte_at(at + i);
        mni_spill_put(&w, piece, size);
        at += size;
        left -= size;
    }
    mn_code code = mni_spill_end(&w);
    free(buffer);
    return code;
}

/* Takes a piece to its end, `step` bytes at a time; how many came. */
static uint64_t drain(mni_spill_reader *r, uint64_t from, size_t step) {
    const unsigned char *at;
    uint64_t taken = 0, wrong = 0;
    for (; (at = mni_spill_take(r, step)) != NULL; taken += step)
        for (size_t i = 0; i < step; i++)
            wrong += at[i] != byte_at(from + taken + i);
    ck_assert_uint_eq(wrong, 0);
    return taken;
}

START_TEST(what_is_written_comes_back) {
    static const size_t buffers[] = {1, 16, 1000, 4096, 100000};
    mni_spill s = open_spill();
    mni_spill_reader r;
    unsigned char *buffer = malloc(100000);
    uint64_t size = 0;
    for (int i = 0; i < 5; i++) {
        uint64_t count = i == 0 ? 3000 : 250000;
        ck_assert_int_eq(fill(&s, count, buffers[i]), MN_OK);
        ck_assert_uint_eq(s.size_bytes, size += count);
    }
    ck_assert_uint_eq(s.bytes_written, size);
    for (int i = 0; i < 5; i++) {
        uint64_t from = i * 777;
        size_t step = i == 0 ? 1 : i == 1 ? 16 : i == 4 ? 50000 : buffers[i];
        uint64_t to = from + (size - from) / step * step;
        mni_spill_reader_open(&r, &s, from, to, buffer, buffers[i], false);
        ck_assert_uint_eq(drain(&r, from, step), to - from);
        ck_assert_ptr_null(mni_spill_take(&r, step)); /* and stays there */
    }
    mni_spill_reader_open(&r, &s, 500, 500, buffer, 16, true); /* an empty piece */
    ck_assert_ptr_null(mni_spill_take(&r, 16));
    ck_assert_int_eq(s.trouble.code, MN_OK);
    free(buffer);
    mni_spill_close(&s);
    mni_spill_close(&s);
    ck_assert_int_eq(entries(), 0);
}
END_TEST

/* Forty pieces, read in turns while the file grows. */
/* Without the system's read-ahead a small read brings no more than its own pages from the disk. */
START_TEST(nothing_is_read_ahead) {
    enum { BYTES = 1 << 20, PAGE = 4096, READ = 2 * PAGE };
    static unsigned char bytes[BYTES], resident[BYTES / PAGE];
    mn_readahead_off(); /* for the rest of this process, which is this test's own */
    mni_spill s = open_spill();
    ck_assert_int_eq(mni_spill_append(&s, bytes, BYTES), MN_OK);
    ck_assert_int_eq(fsync(s.fd), 0);
    ck_assert_int_eq(posix_fadvise(s.fd, 0, 0, POSIX_FADV_DONTNEED), 0);
    void *map = mmap(NULL, BYTES, PROT_READ, MAP_SHARED, s.fd, 0);
    ck_assert_ptr_ne(map, MAP_FAILED);
    ck_assert_int_eq(mincore(map, BYTES, resident), 0);
    bool let_go = (resident[0] & 1) == 0; /* a folder in memory has no disk to read from */
    ck_assert_int_eq(mni_spill_read_at(&s, 0, bytes, READ), MN_OK);
    ck_assert_int_eq(mincore(map, BYTES, resident), 0);
    size_t pages = 0;
    for (size_t i = 0; i < BYTES / PAGE; i++)
        pages += resident[i] & 1;
    if (let_go)
        ck_assert_uint_le(pages, READ / PAGE);
    munmap(map, BYTES);
    mni_spill_close(&s);
}
END_TEST

START_TEST(many_readers_and_a_writer) {
    enum { PIECES = 40, PIECE = 6400, BUFFER = 640, STEP = 32 };
    static unsigned char buffer[PIECES][BUFFER];
    mni_spill s = open_spill();
    mni_spill_reader r[PIECES];
    uint64_t wrong = 0;
    ck_assert_int_eq(fill(&s, PIECES * PIECE, 5000), MN_OK);
    for (uint64_t p = 0; p < PIECES; p++)
        mni_spill_reader_open(&r[p], &s, p * PIECE, (p + 1) * PIECE, buffer[p], BUFFER, p % 2);
    for (uint64_t taken = 0; taken < PIECE; taken += STEP) {
        for (uint64_t p = 0; p < PIECES; p++) {
            const unsigned char *at = mni_spill_take(&r[p], STEP);
            for (uint64_t i = 0; i < STEP; i++)
                wrong += at == NULL || at[i] != byte_at(p * PIECE + taken + i);
        }
        ck_assert_int_eq(fill(&s, 500, 500), MN_OK);
    }
    ck_assert_uint_eq(wrong, 0);
    ck_assert_uint_eq(s.bytes_read, PIECES * PIECE);
    mni_spill_close(&s);
}
END_TEST

START_TEST(room_is_given_back) {
    enum { BUFFER = 65536, SIZE = 8 << 20 };
    static unsigned char buffer[BUFFER];
    struct stat full, read;
    mni_spill s = open_spill();
    mni_spill_reader r;
    ck_assert_int_eq(fill(&s, SIZE, BUFFER), MN_OK);
    fsync(s.fd);
    ck_assert_int_eq(fstat(s.fd, &full), 0);
    /* the first and the last eighth stay, to the byte */
    mni_spill_reader_open(&r, &s, SIZE / 8 + 100, 7 * SIZE / 8 - 28, buffer, BUFFER, true);
    ck_assert_uint_eq(drain(&r, SIZE / 8 + 100, 128), 3 * SIZE / 4 - 128);
    ck_assert_int_eq(fstat(s.fd, &read), 0);
    mni_spill_reader_open(&r, &s, 0, SIZE / 8 + 100, buffer, BUFFER, false);
    ck_assert_uint_eq(drain(&r, 0, 4), SIZE / 8 + 100);
    mni_spill_reader_open(&r, &s, 7 * SIZE / 8 - 28, SIZE, buffer, BUFFER, false);
    ck_assert_uint_eq(drain(&r, 7 * SIZE / 8 - 28, 4), SIZE / 8 + 28);
    if (read.st_blocks == full.st_blocks)
        printf("skipped: this file system makes no holes\n");
    else
        ck_assert_int_le(read.st_blocks, full.st_blocks / 3);
    mni_spill_close(&s);
}
END_TEST

/* ---- keeping ------------------------------------------------------------------------------- */

/* A kept spill, full, named "kept" in the folder; its sum. */
static uint64_t keep_one(int at, uint64_t size) {
    static unsigned char buffer[65536];
    mni_spill s = open_spill();
    mni_spill_reader r;
    mn_status st = {0};
    ck_assert_int_eq(mni_spill_keep(&s, &st), MN_OK);
    ck_assert_int_eq(fill(&s, size, 5000), MN_OK);
    ck_assert_int_eq(entries(), 0);
    ck_assert_msg(mni_spill_name(&s, at, "kept", &st) == MN_OK, "%s", st.text);
    ck_assert_int_eq(entries(), 1);
    mni_spill_reader_open(&r, &s, 0, size, buffer, sizeof buffer, true); /* discards nothing */
    ck_assert_uint_eq(drain(&r, 0, 1), size);
    ck_assert_int_eq(mni_spill_name(&s, at, "kept", &st), MN_FAILED); /* it has that name already */
    uint64_t sum = mni_spill_sum(&s);
    mni_spill_close(&s);
    ck_assert_int_eq(entries(), 1);
    return sum;
}

static void is_not(int at, uint64_t size, uint64_t sum) {
    mni_spill s;
    mn_status st = {0};
    ck_assert_int_eq(mni_spill_resume(&s, folder, at, "kept", size, sum, &st), MN_BAD_INPUT);
    ck_assert_int_eq(s.fd, -1);
    ck_assert_ptr_nonnull(strstr(st.text, "kept"));
}

static void keep_and_resume(void) {
    enum { SIZE = 3 << 20 };
    static unsigned char buffer[65536];
    int at = open(folder, O_RDONLY | O_DIRECTORY);
    uint64_t sum = keep_one(at, SIZE);
    mni_spill s;
    mni_spill_reader r;
    mn_status st = {0};
    ck_assert_msg(mni_spill_resume(&s, folder, at, "kept", SIZE, sum, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(s.size_bytes, SIZE);
    ck_assert_uint_eq(s.bytes_read, SIZE); /* the check */
    ck_assert_uint_eq(mni_spill_sum(&s), sum);
    mni_spill_reader_open(&r, &s, 0, SIZE, buffer, sizeof buffer, true);
    ck_assert_uint_eq(drain(&r, 0, 1), SIZE);
    ck_assert_int_eq(mni_spill_name(&s, at, "again", &st), MN_OK); /* in the next phase's, too */
    mni_spill_close(&s);
    unlinkat(at, "again", 0);

    is_not(at, SIZE - 1, sum);
    is_not(at, SIZE, sum + 1);
    int fd = openat(at, "kept", O_RDWR);
    ck_assert_int_eq(pwrite(fd, "!", 1, SIZE / 2), 1);
    close(fd);
    is_not(at, SIZE, sum);
    unlinkat(at, "kept", 0);
    is_not(at, SIZE, sum);
    ck_assert_int_eq(mkdirat(at, "kept", 0700), 0);
    is_not(at, SIZE, sum);
    unlinkat(at, "kept", AT_REMOVEDIR);
    sum = keep_one(at, 0); /* an empty one */
    ck_assert_int_eq(mni_spill_resume(&s, folder, at, "kept", 0, sum, &st), MN_OK);
    mni_spill_close(&s);
    unlinkat(at, "kept", 0);
    close(at);
}

START_TEST(kept_under_a_name) {
    keep_and_resume();
}
END_TEST

START_TEST(kept_as_a_copy) {
    if (!refuse_call(SYS_openat, 2, O_TMPFILE, O_TMPFILE, EOPNOTSUPP)) {
        printf("skipped: no filters on system calls here\n");
        return;
    }
    keep_and_resume();
}
END_TEST

/* ---- failures ------------------------------------------------------------------------------ */

/* The class and a word of what went wrong; the folder is named. */
static void told(const mni_spill *s, mn_code code, const char *word) {
    ck_assert_int_eq(s->trouble.code, code);
    ck_assert_ptr_nonnull(strstr(s->trouble.text, folder));
    ck_assert_msg(strstr(s->trouble.text, word) != NULL, "%s", s->trouble.text);
}

START_TEST(full_disks) {
    mni_spill s = open_spill();
    int full = open("/dev/full", O_RDWR);
    ck_assert_int_eq(fill(&s, 1000, 100), MN_OK);
    ck_assert_int_eq(dup2(full, s.fd), s.fd);
    ck_assert_int_eq(fill(&s, 1000, 100), MN_NO_SPACE);
    told(&s, MN_NO_SPACE, "no space left");
    ck_assert_uint_eq(s.size_bytes, 1000);
    close(full);
    mni_spill_close(&s);

    struct rlimit old, small;
    getrlimit(RLIMIT_FSIZE, &old);
    small = (struct rlimit){.rlim_cur = 5000, .rlim_max = old.rlim_max};
    signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &small);
    s = open_spill();
    ck_assert_int_eq(fill(&s, 20000, 100), MN_NO_SPACE);
    told(&s, MN_NO_SPACE, "ulimit");
    ck_assert_uint_eq(s.size_bytes, 5000); /* as much as there was room for */
    mni_spill_close(&s);
    setrlimit(RLIMIT_FSIZE, &old);
}
END_TEST

START_TEST(files_cut_and_unreadable) {
    unsigned char buffer[512];
    mni_spill s = open_spill();
    mni_spill_reader r;
    ck_assert_int_eq(fill(&s, 4000, 100), MN_OK);
    ck_assert_int_eq(ftruncate(s.fd, 3000), 0);
    mni_spill_reader_open(&r, &s, 0, 4000, buffer, 500, false);
    ck_assert_uint_eq(drain(&r, 0, 10), 3000);
    told(&s, MN_FAILED, "shorter");
    mni_spill_reader_open(&r, &s, 0, 4000, buffer, 500, false);
    ck_assert_ptr_null(mni_spill_take(&r, 10)); /* no more of it after that */
    mni_spill_close(&s);

    s = open_spill();
    ck_assert_int_eq(fill(&s, 4000, 100), MN_OK);
    int deaf = open("/dev/null", O_WRONLY);
    ck_assert_int_eq(dup2(deaf, s.fd), s.fd);
    mni_spill_reader_open(&r, &s, 0, 4000, buffer, 500, true);
    ck_assert_uint_eq(drain(&r, 0, 10), 0);
    told(&s, MN_FAILED, strerror(EBADF));
    close(deaf);
    mni_spill_close(&s);
}
END_TEST

START_TEST(no_folder) {
    mni_spill s = {.fd = -1};
    mn_status st = {0};
    mni_spill_close(&s);
    ck_assert_int_eq(mni_spill_open(&s, "/nowhere/at/all", &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "/nowhere/at/all"));
    ck_assert_ptr_nonnull(strstr(st.text, "--temp-dir"));
    mni_spill_close(&s);
}
END_TEST

START_TEST(file_systems_without_nameless_files) {
    if (!refuse_call(SYS_openat, 2, O_TMPFILE, O_TMPFILE, EOPNOTSUPP)) {
        printf("skipped: no filters on system calls here\n");
        return;
    }
    mni_spill s = open_spill(); /* no name is left, either */
    ck_assert_int_eq(fill(&s, 4000, 100), MN_OK);
    mni_spill_close(&s);
}
END_TEST

int main(void) {
    if (mkdtemp(folder) == NULL)
        return 1;
    Suite *suite = suite_create("spill");
    TCase *tc = tcase_create("spill");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, what_is_written_comes_back);
    tcase_add_test(tc, nothing_is_read_ahead);
    tcase_add_test(tc, many_readers_and_a_writer);
    tcase_add_test(tc, room_is_given_back);
    tcase_add_test(tc, kept_under_a_name);
    tcase_add_test(tc, kept_as_a_copy);
    tcase_add_test(tc, full_disks);
    tcase_add_test(tc, files_cut_and_unreadable);
    tcase_add_test(tc, no_folder);
    tcase_add_test(tc, file_systems_without_nameless_files);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    rmdir(folder);
    return failed;
}
