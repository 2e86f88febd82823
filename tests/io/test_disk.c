/* Goal: every method returns the file's bytes, each read once, whatever the kernel refuses; the
 * simulated disk does what its seed says, and nothing else. Method: a file of numbered pages, all
 * depths, all tags; filters on system calls. */
#define _GNU_SOURCE /* O_DIRECT */
#include <check.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "disk.h"
#include "refuse.h"
#include "suite.h"

enum { PAGES = 256, READ_PAGES = 2, READ_BYTES = READ_PAGES * MN_PAGE_BYTES, CHUNK_READS = 5 };

static char path[32];
static mni_arena arena;
static mni_disk disk;
static unsigned char *memory;
static char warned[4][300]; /* in their order */
static int warnings;

static void make_file(void) {
    strcpy(path, "/tmp/mn-disk-XXXXXX");
    int fd = mkstemp(path);
    unsigned char page[MN_PAGE_BYTES];
    for (int i = 0; i < PAGES; i++) {
        memset(page, i, sizeof page);
        ck_assert_int_eq(write(fd, page, sizeof page), sizeof page);
    }
    close(fd);
}

static void remove_file(void) {
    unlink(path);
}

static void warn(void *context, const char *text) {
    (void)context;
    ck_assert_int_lt(warnings, 4);
    snprintf(warned[warnings++], sizeof warned[0], "%s", text);
}

static mn_code open_disk(mn_io_kind kind, uint64_t file_bytes, mn_sim_desc sim, mn_status *st) {
    size_t all = (size_t)MNI_DISK_DEPTH * READ_BYTES;
    ck_assert_int_eq(mni_arena_open(&arena, mni_disk_need() + all + MN_PAGE_BYTES, NULL), MN_OK);
    memory = mni_arena_take(&arena, all, 1, MN_PAGE_BYTES);
    mni_disk_desc desc = {.path = path,
                          .kind = kind,
                          .file_bytes = file_bytes,
                          .chunks = {.base = memory,
                                     .chunk_bytes = CHUNK_READS * READ_BYTES,
                                     .all_bytes = all,
                                     .count = (MNI_DISK_DEPTH + CHUNK_READS - 1) / CHUNK_READS},
                          .seed = 5,
                          .sim = sim,
                          .warn = warn};
    return mni_disk_open(&disk, &desc, &arena, st);
}

static void close_disk(void) {
    mni_disk_close(&disk);
    mni_arena_close(&arena);
}

static bool submit(uint32_t tag, uint32_t page) {
    mni_read read = {.offset = (uint64_t)page * MN_PAGE_BYTES,
                     .bytes = memory + (size_t)tag * READ_BYTES,
                     .length_bytes = READ_BYTES,
                     .chunk = tag / CHUNK_READS,
                     .tag = tag};
    return disk.method->submit(disk.self, &read);
}

static uint32_t collect(mni_done *done) {
    if (disk.method->own_time)
        (void)disk.method->advance(disk.self, UINT64_MAX);
    return disk.method->collect(disk.self, done, MNI_DISK_DEPTH, true);
}

static void read_all_once(void) {
    for (uint32_t round = 0; round < 20; round++) {
        uint32_t sent = 0, back = 0;
        bool seen[MNI_DISK_DEPTH] = {false};
        while (sent < disk.method->depth && submit(sent, (round * 11 + sent * 3) % (PAGES - 1)))
            sent++;
        ck_assert_uint_eq(sent, disk.method->depth);
        while (back < sent) {
            mni_done done[MNI_DISK_DEPTH];
            uint32_t count = collect(done);
            for (uint32_t i = 0; i < count; i++, back++) {
                uint32_t tag = done[i].tag, page = (round * 11 + tag * 3) % (PAGES - 1);
                ck_assert_int_eq(done[i].result, READ_BYTES);
                ck_assert(!seen[tag]);
                seen[tag] = true;
                ck_assert_uint_eq(memory[(size_t)tag * READ_BYTES], page);
                ck_assert_uint_eq(memory[(size_t)(tag + 1) * READ_BYTES - 1], page + 1);
            }
        }
        mni_done none[MNI_DISK_DEPTH];
        ck_assert_uint_eq(disk.method->collect(disk.self, none, MNI_DISK_DEPTH, false), 0);
    }
}

START_TEST(every_read_comes_once) {
    ck_assert_int_eq(open_disk((mn_io_kind)_i, PAGES * MN_PAGE_BYTES, (mn_sim_desc){0}, NULL),
                     MN_OK);
    read_all_once();
    close_disk();
}
END_TEST

/* Containers refuse io_uring: one warning, and pread brings the same. */
START_TEST(io_uring_refused) {
    static const unsigned errors[] = {EPERM, ENOSYS};
    if (!refuse_call(SYS_io_uring_setup, 0, 0, 0, errors[_i])) {
        printf("skipped: no filters of system calls here\n");
        return;
    }
    ck_assert_int_eq(open_disk(MN_IO_URING, PAGES * MN_PAGE_BYTES, (mn_sim_desc){0}, NULL), MN_OK);
    ck_assert_ptr_eq(disk.method, &mni_method_pread);
    ck_assert_int_eq(warnings, 1);
    ck_assert_ptr_nonnull(strstr(warned[0], "io_uring is refused"));
    ck_assert_ptr_nonnull(strstr(warned[0], "pread"));
    read_all_once();
    close_disk();
}
END_TEST

/* Pages of the file in the page cache. */
static int pages_cached(void) {
    unsigned char there[PAGES];
    int fd = open(path, O_RDONLY), count = 0;
    void *map = mmap(NULL, PAGES * MN_PAGE_BYTES, PROT_READ, MAP_SHARED, fd, 0);
    ck_assert(map != MAP_FAILED && mincore(map, PAGES * MN_PAGE_BYTES, there) == 0);
    for (int i = 0; i < PAGES; i++)
        count += there[i] & 1;
    munmap(map, PAGES * MN_PAGE_BYTES);
    close(fd);
    return count;
}

/* false: the file lives in the page cache. */
static bool forget_pages(void) {
    int fd = open(path, O_RDONLY);
    ck_assert(fd >= 0 && fsync(fd) == 0);
    posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
    close(fd);
    return pages_cached() == 0;
}

/* One by one, each as long as the disk takes reads: of pages that are read in part the kernel would
 * forget none. */
static void read_least(void) {
    for (uint64_t at = 0; at < 8 * MN_PAGE_BYTES; at += disk.align_bytes) {
        mni_done done;
        const mni_read read = {.offset = at, .bytes = memory, .length_bytes = disk.align_bytes};
        ck_assert(disk.method->submit(disk.self, &read));
        while (disk.method->collect(disk.self, &done, 1, true) == 0) {
        }
        ck_assert_int_eq(done.result, disk.align_bytes);
        ck_assert_uint_eq(memory[0], at / MN_PAGE_BYTES);
    }
}

/* File systems refuse O_DIRECT when a file is opened, or only when it is read: one warning, and
 * both methods read without it, and tell the kernel to forget what it has read. */
START_TEST(o_direct_refused) {
    bool at_open = _i % 2 == 0, on_disk = forget_pages();
    int next =
        open("/dev/null", O_RDONLY); /* the number that a file gets; the next is the second's */
    close(next);
    if (!(at_open ? refuse_call(SYS_openat, 2, O_DIRECT, O_DIRECT, EINVAL)
                  : refuse_call(SYS_pread64, 0, UINT32_MAX, (unsigned)next + 1, EINVAL))) {
        printf("skipped: no filters of system calls here\n");
        return;
    }
    mn_io_kind kind = _i < 2 ? MN_IO_URING : MN_IO_PREAD;
    ck_assert_int_eq(open_disk(kind, PAGES * MN_PAGE_BYTES, (mn_sim_desc){0}, NULL), MN_OK);
    ck_assert_int_ge(warnings, 1); /* io_uring may be refused here as well */
    ck_assert_ptr_nonnull(strstr(warned[0], "refuses O_DIRECT"));
    ck_assert_ptr_nonnull(strstr(warned[0], path));
    ck_assert_int_eq(fcntl(disk.fd, F_GETFL) & O_DIRECT, 0);
    read_all_once();
    read_least();
    ck_assert(!on_disk || pages_cached() == 0);
    close_disk();
}
END_TEST

START_TEST(chunks_come_and_go) {
    ck_assert_int_eq(open_disk((mn_io_kind)_i, PAGES * MN_PAGE_BYTES, (mn_sim_desc){0}, NULL),
                     MN_OK);
    for (int round = 0; round < 10; round++) {
        ck_assert(disk.method->chunk(disk.self, 1, false));
        ck_assert(disk.method->chunk(disk.self, 1, true));
        mni_done done[MNI_DISK_DEPTH];
        uint32_t tag = disk.method->depth > CHUNK_READS ? CHUNK_READS : 0; /* first of chunk 1 */
        ck_assert(submit(tag, 7));
        while (collect(done) == 0) {
        }
        ck_assert_int_eq(done[0].result, READ_BYTES);
    }
    close_disk();
}
END_TEST

START_TEST(short_file_is_refused) {
    mn_status st = {0};
    ck_assert_int_eq(open_disk((mn_io_kind)_i, (PAGES + 1) * MN_PAGE_BYTES, (mn_sim_desc){0}, &st),
                     MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, path));
    mni_arena_close(&arena);
}
END_TEST

/* Each fault alone at certainty: it happens to every read; with faults off, to none. */
START_TEST(faults_as_told) {
    enum { EIO_, EAGAIN_, SHORT, CORRUPT, MISPLACED, FAULTS };
    for (int fault = 0; fault < FAULTS; fault++)
        for (int on = 0; on < 2; on++) {
            mn_sim_desc sim = {.eio = fault == EIO_ ? 1000 : 0,
                               .eagain = fault == EAGAIN_ ? 1000 : 0,
                               .short_read = fault == SHORT ? 1000 : 0,
                               .corrupt = fault == CORRUPT ? 1000 : 0,
                               .misplaced = fault == MISPLACED ? 1000 : 0};
            ck_assert_int_eq(open_disk(MN_IO_SIM, PAGES * MN_PAGE_BYTES, sim, NULL), MN_OK);
            disk.method->faults(disk.self, on == 1);
            mni_done done[MNI_DISK_DEPTH];
            ck_assert(submit(3, 100));
            ck_assert_uint_eq(collect(done), 1);
            bool right = done[0].result == READ_BYTES;
            for (int i = 0; right && i < READ_BYTES; i++)
                right = memory[3 * READ_BYTES + i] == 100 + i / MN_PAGE_BYTES;
            ck_assert_int_eq(right, on == 0);
            if (on == 1 && fault == EIO_)
                ck_assert_int_eq(done[0].result, -EIO);
            if (on == 1 && fault == EAGAIN_)
                ck_assert_int_eq(done[0].result, -EAGAIN);
            if (on == 1 && fault == SHORT)
                ck_assert(done[0].result > 0 && done[0].result < READ_BYTES);
            close_disk();
        }
}
END_TEST

/* In the order of submission without reorder; not with it; the same each time. */
START_TEST(order_is_the_seeds) {
    uint32_t order[3][MNI_DISK_DEPTH];
    for (int run = 0; run < 3; run++) {
        mn_sim_desc sim = {.delay_us_max = 1000, .reorder = run > 0 ? 500 : 0};
        ck_assert_int_eq(open_disk(MN_IO_SIM, PAGES * MN_PAGE_BYTES, sim, NULL), MN_OK);
        for (uint32_t tag = 0; tag < MNI_DISK_DEPTH; tag++)
            ck_assert(submit(tag, tag));
        for (uint32_t back = 0; back < MNI_DISK_DEPTH;) {
            mni_done done[MNI_DISK_DEPTH];
            uint32_t count = collect(done);
            for (uint32_t i = 0; i < count; i++)
                order[run][back++] = done[i].tag;
        }
        close_disk();
    }
    for (uint32_t i = 0; i < MNI_DISK_DEPTH; i++)
        ck_assert_uint_eq(order[0][i], i);
    ck_assert_mem_ne(order[0], order[1], sizeof order[0]);
    ck_assert_mem_eq(order[1], order[2], sizeof order[1]);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("disk");
    TCase *tests = tcase_create("disk");
    tcase_add_checked_fixture(tests, make_file, remove_file);
    tcase_add_loop_test(tests, every_read_comes_once, MN_IO_URING, MN_IO_SIM + 1);
    tcase_add_loop_test(tests, io_uring_refused, 0, 2);
    tcase_add_loop_test(tests, o_direct_refused, 0, 4);
    tcase_add_loop_test(tests, chunks_come_and_go, MN_IO_URING, MN_IO_SIM + 1);
    tcase_add_loop_test(tests, short_file_is_refused, MN_IO_URING, MN_IO_SIM + 1);
    tcase_add_test(tests, faults_as_told);
    tcase_add_test(tests, order_is_the_seeds);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
