/* Goal: what goes into a ring comes out of the file, in order, or is counted; a file that was cut
 * or damaged anywhere is refused. Method: rings filled here, by one thread and by two; each length
 * and each byte of a small file; chunks of sound checksums and lying contents. */
#include <check.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "suite.h"
#include "trace_layout.h"

static char path[64];
static unsigned char *bytes; /* of the file */
static size_t size;

static void read_file(void) {
    FILE *file = fopen(path, "rb");
    ck_assert_ptr_nonnull(file);
    bytes = realloc(bytes, 1 << 24);
    size = fread(bytes, 1, 1 << 24, file);
    fclose(file);
}

static void write_file(size_t count) {
    const int fd = open(path, O_WRONLY);
    ck_assert_int_ge(fd, 0);
    ck_assert_int_eq(pwrite(fd, bytes, count, 0), (ssize_t)count);
    ck_assert_int_eq(ftruncate(fd, (off_t)count), 0);
    ck_assert_int_eq(close(fd), 0);
}

static void setup(void) {
    strcpy(path, "/tmp/mn-trace-XXXXXX");
    int fd = mkstemp(path);
    ck_assert_int_ge(fd, 0);
    close(fd);
}

static void teardown(void) {
    unlink(path);
    free(bytes);
    bytes = NULL;
}

static mni_trace *begin(mn_trace_clock clock) {
    const mn_trace_info info = {.clock = clock, .k = 7, .seed = 9, .model = "ball.mnt"};
    mni_trace *t;
    ck_assert_int_eq(mni_trace_open(path, &info, &t, NULL), MN_OK);
    return t;
}

static mn_trace_file *reopen(bool cut) {
    mn_trace_file *file;
    mn_status st = {0};
    ck_assert_msg(mn_trace_open(path, cut, &file, &st) == MN_OK, "%s", st.text);
    return file;
}

/* A small trace of both threads, in virtual time: navigate 0, io 1, navigate 2, … of 100. */
static void write_small(void) {
    mni_trace *t = begin(MN_TRACE_VIRTUAL);
    for (uint32_t i = 0; i < 100; i++) {
        (void)mni_trace_swap(mni_trace_ring_of(t, (mn_trace_thread)(i % 2)));
        mni_trace_clock(1000 * (i / 10));
        MNI_TRACE(MN_TRACE_USE, 0, i, 3 * i);
        if (i % 20 == 0)
            mni_trace_drain(t);
    }
    (void)mni_trace_swap(NULL);
    ck_assert_int_eq(mni_trace_close(t, NULL), MN_OK);
}

START_TEST(both_threads_come_back_in_order) {
    write_small();
    mn_trace_file *file = reopen(false);
    const mn_trace_info *info = mn_trace_info_of(file);
    ck_assert_uint_eq(info->k, 7);
    ck_assert_uint_eq(info->seed, 9);
    ck_assert_str_eq(info->model, "ball.mnt");
    ck_assert_uint_eq(mn_trace_events(file, MN_TRACE_IO), 50);
    for (int pass = 0; pass < 2; pass++) {
        mn_trace_event e;
        mn_code code;
        uint32_t count = 0;
        uint64_t ns = 0;
        for (; mn_trace_next(file, &e, &code, NULL); count++) {
            ck_assert_uint_eq(e.a, count);
            ck_assert_uint_eq(e.b, 3 * count);
            ck_assert_uint_eq(e.thread, count % 2);
            ck_assert_uint_gt(e.ns, ns);
            ck_assert_uint_eq(e.ns / 1000, count / 10);
            ns = e.ns;
        }
        ck_assert_int_eq(code, MN_OK);
        ck_assert_uint_eq(count, 100);
        mn_trace_rewind(file);
    }
    mn_trace_close(file);
}
END_TEST

START_TEST(the_same_bytes_twice) {
    write_small();
    read_file();
    unsigned char *first = bytes;
    const size_t first_size = size;
    bytes = NULL;
    write_small();
    read_file();
    ck_assert_uint_eq(size, first_size);
    ck_assert_mem_eq(bytes, first, size);
    free(first);
}
END_TEST

/* With a simulated disk there is no hurry: nothing is dropped, however much comes at once. */
START_TEST(virtual_time_drops_nothing) {
    enum { MANY = 200000 };
    mni_trace *t = begin(MN_TRACE_VIRTUAL);
    (void)mni_trace_swap(mni_trace_ring_of(t, MN_TRACE_IO));
    for (uint32_t i = 0; i < MANY; i++)
        MNI_TRACE(MN_TRACE_SUBMIT, 0, i, 0);
    (void)mni_trace_swap(NULL);
    ck_assert_int_eq(mni_trace_close(t, NULL), MN_OK);
    mn_trace_file *file = reopen(false);
    ck_assert_uint_eq(mn_trace_events(file, MN_TRACE_IO), MANY);
    ck_assert_uint_eq(mn_trace_dropped(file, MN_TRACE_IO), 0);
    mn_trace_close(file);
}
END_TEST

/* ---- two threads and a writer ------------------------------------------------------------------
 */

enum { EACH = 300000 };

static void *produce(void *ring) {
    (void)mni_trace_swap(ring);
    for (uint32_t i = 0; i < EACH; i++)
        MNI_TRACE(MN_TRACE_LEAVE, 0, i, 0);
    (void)mni_trace_swap(NULL);
    return NULL;
}

/* As fast as can be: what does not fit is counted, and what comes is in order. */
START_TEST(nothing_is_lost_in_silence) {
    mni_trace *t = begin(MN_TRACE_MONOTONIC);
    pthread_t io;
    ck_assert_int_eq(pthread_create(&io, NULL, produce, mni_trace_ring_of(t, MN_TRACE_IO)), 0);
    produce(mni_trace_ring_of(t, MN_TRACE_NAVIGATE));
    pthread_join(io, NULL);
    ck_assert_int_eq(mni_trace_close(t, NULL), MN_OK);
    mn_trace_file *file = reopen(false);
    uint32_t next[MN_TRACE_THREADS] = {0};
    uint64_t count[MN_TRACE_THREADS] = {0}, ns = 0;
    mn_trace_event e;
    mn_code code;
    while (mn_trace_next(file, &e, &code, NULL)) {
        ck_assert_uint_ge(e.a, next[e.thread]);
        ck_assert_uint_ge(e.ns, ns);
        next[e.thread] = e.a + 1;
        count[e.thread]++;
        ns = e.ns;
    }
    for (int thread = 0; thread < MN_TRACE_THREADS; thread++) {
        ck_assert_uint_eq(mn_trace_events(file, (mn_trace_thread)thread), count[thread]);
        ck_assert_uint_eq(count[thread] + mn_trace_dropped(file, (mn_trace_thread)thread), EACH);
    }
    mn_trace_close(file);
}
END_TEST

/* A writer that comes between the last event that found no room and the next that does finds
 * something to tell and nothing to write. (It wrote nothing for ever.) */
START_TEST(what_was_dropped_is_told_alone) {
    mni_trace *t = begin(MN_TRACE_MONOTONIC);
    mni_trace_ring *ring = mni_trace_ring_of(t, MN_TRACE_IO);
    atomic_store(&ring->dropped, 3);
    ck_assert_int_eq(mni_trace_close(t, NULL), MN_OK);
    mn_trace_file *file = reopen(false);
    ck_assert_uint_eq(mn_trace_events(file, MN_TRACE_IO), 0);
    ck_assert_uint_eq(mn_trace_dropped(file, MN_TRACE_IO), 3);
    mn_trace_close(file);
}
END_TEST

/* A full disk: whoever has the rings goes on, and the end says why. */
START_TEST(a_full_disk_is_told_at_the_end) {
    mni_trace *t;
    const mn_trace_info info = {.clock = _i == 0 ? MN_TRACE_VIRTUAL : MN_TRACE_MONOTONIC};
    mn_status st = {0};
    if (access("/dev/full", W_OK) != 0)
        return;
    ck_assert_int_eq(mni_trace_open("/dev/full", &info, &t, NULL), MN_OK);
    produce(mni_trace_ring_of(t, MN_TRACE_NAVIGATE));
    ck_assert(mni_trace_has_failed(t));
    ck_assert_int_eq(mni_trace_close(t, &st), MN_NO_SPACE);
    ck_assert_ptr_nonnull(strstr(st.text, "/dev/full"));
    st = (mn_status){0};
    ck_assert_int_eq(mni_trace_open("/nowhere/at/all", &info, &t, &st), MN_FAILED);
    ck_assert_ptr_null(t);
}
END_TEST

/* What is done for what is not wanted yet is marked, and what it lacks is not told. */
START_TEST(early_is_marked) {
    mni_trace *t = begin(MN_TRACE_VIRTUAL);
    (void)mni_trace_swap(mni_trace_ring_of(t, MN_TRACE_NAVIGATE));
    mni_trace_early(true);
    MNI_TRACE(MN_TRACE_ABSENT, 0, 5, 0);
    MNI_TRACE(MN_TRACE_HOLDER, MN_TRACE_FREED | MN_TRACE_LOADED << 3, 6, 0);
    mni_trace_early(false);
    MNI_TRACE(MN_TRACE_ABSENT, 0, 7, 0);
    MNI_TRACE_MISS(1, false);
    MNI_TRACE_MISS(0, true);
    (void)mni_trace_swap(NULL);
    ck_assert_int_eq(mni_trace_close(t, NULL), MN_OK);
    static const mn_trace_event want[] = {
        {.kind = MN_TRACE_HOLDER,
         .aux = MN_TRACE_FREED | MN_TRACE_LOADED << 3 | MN_TRACE_EARLY,
         .a = 6},
        {.kind = MN_TRACE_ABSENT, .a = 7},
        {.kind = MN_TRACE_MISS, .aux = 1, .a = 7},
        {.kind = MN_TRACE_MISS, .a = 0}};
    mn_trace_file *file = reopen(false);
    mn_trace_event e;
    mn_code code;
    int count = 0;
    for (; mn_trace_next(file, &e, &code, NULL); count++) {
        ck_assert_int_lt(count, 4);
        ck_assert_uint_eq(e.kind, want[count].kind);
        ck_assert_uint_eq(e.aux, want[count].aux);
        ck_assert_uint_eq(e.a, want[count].a);
    }
    ck_assert_int_eq(count, 4);
    mn_trace_close(file);
}
END_TEST

/* ---- hostile files -----------------------------------------------------------------------------
 */

static mn_code try_open(bool cut) {
    mn_trace_file *file;
    mn_status st = {0};
    const mn_code code = mn_trace_open(path, cut, &file, &st);
    if (code != MN_OK) {
        ck_assert_ptr_null(file);
        ck_assert_int_eq(st.code, code);
        ck_assert_ptr_null(strchr(st.text, '\n'));
        ck_assert_ptr_nonnull(strstr(st.text, path));
        return code;
    }
    mn_trace_event e;
    mn_code next;
    uint64_t count = 0;
    while (mn_trace_next(file, &e, &next, NULL))
        count++;
    ck_assert_int_eq(next, MN_OK);
    ck_assert_uint_eq(count, mn_trace_events(file, MN_TRACE_NAVIGATE) +
                                 mn_trace_events(file, MN_TRACE_IO));
    mn_trace_close(file);
    return MN_OK;
}

START_TEST(every_length) {
    write_small();
    read_file();
    for (size_t length = size; length-- > 0;) {
        write_file(length);
        ck_assert_int_eq(try_open(false), MN_BAD_INPUT);
        ck_assert_int_eq(try_open(true), length < sizeof(mni_trace_head) ? MN_BAD_INPUT : MN_OK);
    }
    write_file(size);
    ck_assert_int_eq(try_open(false), MN_OK);
    bytes[size] = 0; /* and one byte too many */
    write_file(size + 1);
    ck_assert_int_eq(try_open(false), MN_BAD_INPUT);
}
END_TEST

START_TEST(every_byte) {
    write_small();
    read_file();
    for (size_t at = 0; at < size; at++) {
        bytes[at] ^= (unsigned char)(1u << at % 8);
        write_file(size);
        ck_assert_msg(try_open(false) == MN_BAD_INPUT, "byte %zu may be anything", at);
        bytes[at] ^= (unsigned char)(1u << at % 8);
    }
}
END_TEST

/* The first chunk, and its checksum made good again after a lie. */
static mni_trace_chunk *first_chunk(mni_trace_event **event) {
    write_small();
    read_file();
    mni_trace_chunk *chunk = (mni_trace_chunk *)(void *)(bytes + sizeof(mni_trace_head));
    *event = (mni_trace_event *)(void *)(chunk + 1);
    return chunk;
}

static void expect_refused(mni_trace_chunk *chunk) {
    chunk->checksum = mni_trace_chunk_checksum(chunk, chunk + 1);
    write_file(size);
    ck_assert_int_eq(try_open(false), MN_BAD_INPUT);
}

START_TEST(lies_with_good_checksums) {
    mni_trace_event *event;
    mni_trace_chunk *chunk = first_chunk(&event);
    event->what |= 0xff; /* no such kind */
    expect_refused(chunk);
    chunk = first_chunk(&event);
    event->what |= 0x7f00; /* nothing that stands beside a use */
    expect_refused(chunk);
    chunk = first_chunk(&event);
    event->what |= UINT64_MAX << 32; /* later than the next */
    expect_refused(chunk);
    chunk = first_chunk(&event);
    chunk->thread = 2;
    expect_refused(chunk);
    chunk = first_chunk(&event);
    chunk->thread = MNI_TRACE_END; /* of more than two */
    expect_refused(chunk);
    chunk = first_chunk(&event);
    chunk->dropped = 1; /* and the end says none */
    expect_refused(chunk);
    chunk = first_chunk(&event);
    chunk->count = MNI_TRACE_CHUNK_EVENTS + 1;
    write_file(size);
    ck_assert_int_eq(try_open(false), MN_BAD_INPUT);
}
END_TEST

START_TEST(other_files) {
    static const char *const contents[] = {"", "mntrace\n", "ply\nformat ascii 1.0\n"};
    mn_trace_file *file;
    bytes = malloc(8192);
    for (int i = 0; i < 3; i++) {
        memset(bytes, ' ', 8192);
        memcpy(bytes, contents[i], strlen(contents[i]));
        write_file(i == 0 ? 0 : 8192);
        ck_assert_int_eq(try_open(false), MN_BAD_INPUT);
    }
    ck_assert_int_eq(mn_trace_open("/tmp", false, &file, NULL), MN_BAD_INPUT);
    ck_assert_int_eq(mn_trace_open("/nowhere/at/all", false, &file, NULL), MN_BAD_INPUT);
    free(bytes);
    bytes = NULL;
    write_small();
    read_file();
    mni_trace_head *head = (mni_trace_head *)(void *)bytes;
    head->version++; /* of another version, and sound */
    head->checksum = XXH3_64bits(head, offsetof(mni_trace_head, checksum));
    write_file(size);
    ck_assert_int_eq(try_open(false), MN_BAD_INPUT);
}
END_TEST

/* The mark of what is early stands only where one can be: nobody else takes it off before he looks
 * a name up, or a count. */
START_TEST(marks_only_where_they_may_be) {
    const bool may[MN_TRACE_KINDS] = {
        [MN_TRACE_SPLIT] = true,    [MN_TRACE_COLLAPSE] = true,   [MN_TRACE_MISS] = true,
        [MN_TRACE_ABSENT] = true,   [MN_TRACE_USE] = true,        [MN_TRACE_LEAVE] = true,
        [MN_TRACE_GRANT] = true,    [MN_TRACE_GRANT_OVER] = true, [MN_TRACE_SUBMIT] = true,
        [MN_TRACE_HOLDER] = true,   [MN_TRACE_LOST] = true,       [MN_TRACE_PREFETCH_USED] = true,
        [MN_TRACE_LOCK_WAIT] = true};
    for (int kind = 0; kind < MN_TRACE_KINDS; kind++)
        for (int marked = 0; marked < 2; marked++) {
            mni_trace *t = begin(MN_TRACE_VIRTUAL);
            (void)mni_trace_swap(mni_trace_ring_of(t, MN_TRACE_NAVIGATE));
            mni_trace_put((mn_trace_kind)kind, marked ? MN_TRACE_EARLY : 0, 5, 0);
            (void)mni_trace_swap(NULL);
            ck_assert_int_eq(mni_trace_close(t, NULL), MN_OK);
            ck_assert_msg(try_open(false) == (marked && !may[kind] ? MN_BAD_INPUT : MN_OK),
                          "kind %d, marked %d", kind, marked);
        }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("trace");
    TCase *tc = tcase_create("trace");
    tcase_set_timeout(tc, 60);
    tcase_add_checked_fixture(tc, setup, teardown);
    tcase_add_test(tc, both_threads_come_back_in_order);
    tcase_add_test(tc, the_same_bytes_twice);
    tcase_add_test(tc, virtual_time_drops_nothing);
    tcase_add_test(tc, nothing_is_lost_in_silence);
    tcase_add_test(tc, what_was_dropped_is_told_alone);
    tcase_add_loop_test(tc, a_full_disk_is_told_at_the_end, 0, 2);
    tcase_add_test(tc, early_is_marked);
    tcase_add_test(tc, every_length);
    tcase_add_test(tc, every_byte);
    tcase_add_test(tc, lies_with_good_checksums);
    tcase_add_test(tc, other_files);
    tcase_add_test(tc, marks_only_where_they_may_be);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
