/* Goal: records come out in order, ties as they were put, whatever the budget, and within it;
 * trouble with the disk is told. Method: seeded random records of all sizes and keys, sorted by
 * mergesort here, with budgets from the smallest to more than enough; a disk that is full, cut, or
 * not to be read. */
#define _GNU_SOURCE
#include <check.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "extsort.h"
#include "suite.h"
#include "varint.h"

static char folder[] = "/tmp/mn-extsort-XXXXXX";
static uint64_t seed;

static uint64_t random_u64(uint64_t *state) {
    uint64_t x = *state += UINT64_C(0x9e3779b97f4a7c15);
    x = (x ^ x >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ x >> 27) * UINT64_C(0x94d049bb133111eb);
    return x ^ x >> 31;
}

/* ---- inputs -------------------------------------------------------------------------------- */

typedef enum shape {
    RANDOM,
    FEW_KEYS,
    ALL_EQUAL,
    RISING,
    FALLING,
    RISING_LOADS,
    HIGH_BITS,
    SHAPES
} shape;
static const uint32_t key_bytes[] = {4, 8, 16};

typedef struct input {
    mni_sort_key key;
    uint32_t bytes;
    uint64_t count;
    unsigned char *records;
} input;

/* Keys of a shape; what is left of a record is random, so that it tells ties apart. */
static input make_input(shape kind, mni_sort_key key, uint32_t bytes, uint64_t count) {
    input in = {key, bytes, count, malloc(count * bytes + 1)};
    uint64_t state = seed + kind * 1000 + bytes, words[MNI_SORT_RECORD_MAX / 8 + 1];
    for (uint64_t i = 0; i < count; i++) {
        for (uint32_t w = 0; w < bytes / 8 + 1; w++)
            words[w] = random_u64(&state);
        uint64_t high = words[0], low = words[1];
        switch (kind) {
        case FEW_KEYS:
            high = high % 7 * UINT64_C(0x100010001);
            low %= 3;
            break;
        case ALL_EQUAL:
            high = low = UINT64_MAX; /* what an exhausted run says, too */
            break;
        case RISING:
        case FALLING:
            high = low = kind == RISING ? i / 3 : (count - i) / 3;
            break;
        case RISING_LOADS: /* in order but for neighbours */
            high = low = i ^ 1;
            break;
        case HIGH_BITS:
            high = high << 40;
            low = 0;
            break;
        default:
            break;
        }
        if (key == MNI_SORT_U32)
            words[0] = (words[0] & ~(uint64_t)UINT32_MAX) | (uint32_t)(high ^ high >> 32);
        else
            words[0] = high;
        if (key == MNI_SORT_U128)
            words[1] = low;
        memcpy(in.records + i * bytes, words, bytes);
    }
    return in;
}

static int compare_keys(const input *in, const unsigned char *a, const unsigned char *b) {
    for (uint32_t w = 0; w < key_bytes[in->key]; w += 8)
        for (uint32_t i = key_bytes[in->key] - w < 8 ? key_bytes[in->key] : 8; i-- > 0;)
            if (a[w + i] != b[w + i])
                return a[w + i] < b[w + i] ? -1 : 1;
    return 0;
}

/* Stable, top-down, by definition. */
static void merge_sort(const input *in, unsigned char *a, unsigned char *spare, uint64_t count) {
    if (count < 2)
        return;
    uint64_t half = count / 2, l = 0, r = half;
    merge_sort(in, a, spare, half);
    merge_sort(in, a + half * in->bytes, spare, count - half);
    for (uint64_t i = 0; i < count; i++) {
        bool left =
            r == count || (l < half && compare_keys(in, a + l * in->bytes, a + r * in->bytes) <= 0);
        memcpy(spare + i * in->bytes, a + (left ? l++ : r++) * in->bytes, in->bytes);
    }
    memcpy(a, spare, count * in->bytes);
}

static unsigned char *sorted(const input *in) {
    unsigned char *a = malloc(in->count * in->bytes + 1),
                  *spare = malloc(in->count * in->bytes + 1);
    memcpy(a, in->records, in->count * in->bytes);
    merge_sort(in, a, spare, in->count);
    free(spare);
    return a;
}

/* ---- the sort ------------------------------------------------------------------------------ */

static mni_sort_desc desc_of(const input *in, uint64_t budget) {
    return (mni_sort_desc){
        .record_bytes = in->bytes, .key = in->key, .budget_bytes = budget, .temp_dir = folder};
}

static mni_sort *open_sort(const input *in, uint64_t budget) {
    mni_sort_desc desc = desc_of(in, budget);
    mni_sort *sort;
    mn_status st = {0};
    ck_assert_msg(mni_sort_open(&sort, &desc, &st) == MN_OK, "%s", st.text);
    return sort;
}

/* Packed: each word's difference; context: the input. */
static unsigned char *pack(const void *context, unsigned char *to, const void *record,
                           const void *before) {
    const input *in = context;
    const uint32_t *now = record, *then = before;
    for (uint32_t w = 0; w < in->bytes / 4; w++)
        to = mni_varint_put(to, mni_fold(now[w], then[w]));
    return to;
}

static const unsigned char *unpack(const void *context, const unsigned char *from, void *record) {
    const input *in = context;
    uint32_t *word = record;
    for (uint32_t w = 0; w < in->bytes / 4; w++)
        word[w] = mni_unfold(mni_varint_get(&from), word[w]);
    return from;
}

static void put_all(mni_sort *sort, const input *in) {
    for (uint64_t i = 0; i < in->count; i++)
        mni_sort_put(sort, in->records + i * in->bytes);
}

static mni_sort_figures check_desc(const input *in, const unsigned char *want,
                                   const mni_sort_desc *desc) {
    mni_sort *sort;
    mn_status st = {0};
    uint64_t budget = desc->budget_bytes, room = mni_sort_room(desc);
    ck_assert_msg(mni_sort_open(&sort, desc, &st) == MN_OK, "%s", st.text);
    put_all(sort, in);
    ck_assert_msg(mni_sort_finish(sort, &st) == MN_OK, "%s", st.text);
    const unsigned char *record;
    uint64_t i = 0;
    for (; (record = mni_sort_next(sort, &st)) != NULL; i++) {
        if (i >= in->count || memcmp(record, want + i * in->bytes, in->bytes) != 0)
            ck_abort_msg("record %llu of %llu, budget %llu, seed %llu", (unsigned long long)i,
                         (unsigned long long)in->count, (unsigned long long)budget,
                         (unsigned long long)seed);
    }
    ck_assert_int_eq(st.code, MN_OK);
    ck_assert_uint_eq(i, in->count);
    ck_assert_ptr_null(mni_sort_next(sort, &st)); /* and stays at the end */
    mni_sort_figures f = mni_sort_figures_get(sort);
    if (desc->after_bytes > 0 && desc->after_bytes / in->bytes < room)
        room = desc->after_bytes / in->bytes;
    ck_assert_uint_eq(f.records, in->count);
    if (desc->after_bytes == 0 || in->count > room) /* what is kept is less a table */
        ck_assert_int_eq(f.bytes_written > 0, in->count > room);
    mni_sort_close(sort);
    return f;
}

static mni_sort_figures check_sort(const input *in, const unsigned char *want, uint64_t budget) {
    const mni_sort_desc desc = desc_of(in, budget);
    return check_desc(in, want, &desc);
}

/* The same, with runs that are packed, and with less memory from finish on. */
static void check_otherwise(const input *in, const unsigned char *want, uint64_t budget) {
    const mni_sort_packing packing = {in->bytes / 4 * MNI_VARINT32_MAX, pack, unpack, in};
    mni_sort_desc desc = desc_of(in, budget);
    desc.packing = &packing;
    check_desc(in, want, &desc);
    desc.after_bytes = budget / 3 < MNI_SORT_BUDGET_MIN ? MNI_SORT_BUDGET_MIN : budget / 3;
    check_desc(in, want, &desc);
    desc.packing = NULL;
    check_desc(in, want, &desc);
}

static void check_input(input in) {
    static const uint64_t budgets[] = {
        MNI_SORT_BUDGET_MIN, MNI_SORT_BUDGET_MIN + 4096, 50000, 100000, 300000, 1 << 20, 8 << 20};
    unsigned char *want = sorted(&in);
    for (uint32_t b = 0; b < sizeof budgets / sizeof budgets[0]; b++)
        check_sort(&in, want, budgets[b]);
    for (uint32_t b = 0; b < sizeof budgets / sizeof budgets[0]; b += 2)
        check_otherwise(&in, want, budgets[b]);
    free(want);
    free(in.records);
}

START_TEST(every_shape_every_budget) {
    for (int key = MNI_SORT_U32; key <= MNI_SORT_U128; key++)
        check_input(make_input((shape)_i, (mni_sort_key)key, 16, 30000));
}
END_TEST

START_TEST(every_size) {
    static const uint32_t sizes[] = {4, 8, 12, 16, 20, 24, 32, 40, 100, 256};
    uint32_t bytes = sizes[_i];
    for (int key = MNI_SORT_U32; key <= MNI_SORT_U128; key++)
        if (key_bytes[key] <= bytes) {
            check_input(make_input(RANDOM, (mni_sort_key)key, bytes, 300000 / bytes));
            check_input(make_input(FEW_KEYS, (mni_sort_key)key, bytes, 300000 / bytes));
        }
}
END_TEST

/* None, one, as many as fit, one more; the first three touch no disk. Keys fall: of random ones the
 * one record of a load may be the largest yet, and goes on with the run before. */
START_TEST(counts_at_the_edges) {
    for (uint32_t bytes = 8; bytes <= 64; bytes *= 2) {
        input in = make_input(FALLING, MNI_SORT_U64, bytes, 60000);
        mni_sort_desc desc = desc_of(&in, 100000);
        uint64_t room = mni_sort_room(&desc);
        const uint64_t counts[] = {0, 1, 2, room - 1, room, room + 1, 2 * room, 2 * room + 1};
        ck_assert_uint_gt(room * bytes, 40000); /* of the budget, nearly half */
        for (uint32_t i = 0; i < 8; i++) {
            in.count = counts[i];
            unsigned char *want = sorted(&in);
            mni_sort_figures f = check_sort(&in, want, desc.budget_bytes);
            ck_assert_uint_eq(f.runs, counts[i] <= room ? 0 : (counts[i] + room - 1) / room);
            free(want);
        }
        free(in.records);
    }
}
END_TEST

/* One merge: each byte is written once and read once. Sorted input is one run. A few runs too many
 * cost a few runs more. */
START_TEST(bytes_moved_are_as_few_as_can_be) {
    input in = make_input(RANDOM, MNI_SORT_U64, 16, 400000);
    uint64_t size = in.count * in.bytes, budget = 1 << 20;
    unsigned char *want = sorted(&in);
    mni_sort_figures f = check_sort(&in, want, budget);
    ck_assert_uint_le(f.runs, f.ways_max);
    ck_assert_uint_gt(f.runs, 1);
    ck_assert_uint_eq(f.merges, 0);
    ck_assert_uint_eq(f.bytes_written, size);
    ck_assert_uint_eq(f.bytes_read, size);
    free(in.records);
    in.records = want;
    f = check_sort(&in, want, budget); /* in order already */
    ck_assert_uint_eq(f.runs, 1);
    ck_assert_uint_eq(f.bytes_written, size);
    free(in.records);

    in = make_input(RANDOM, MNI_SORT_U64, 16, 400000);
    want = sorted(&in);
    for (budget = 200000; budget < 800000; budget += 20000) {
        mni_sort_desc desc = desc_of(&in, budget);
        f = check_sort(&in, want, budget);
        uint64_t run = mni_sort_room(&desc) * in.bytes;
        if (f.runs <= f.ways_max)
            ck_assert_uint_eq(f.bytes_written, size);
        else if (f.runs < 2 * f.ways_max) /* too many by R - K: one merge of one more than these */
            ck_assert_uint_le(f.bytes_written, size + (f.runs - f.ways_max + 1) * run);
        ck_assert_uint_eq(f.bytes_read, f.bytes_written);
    }
    free(want);
    free(in.records);
}
END_TEST

/* One run too many, and the first of them long: two of the others are merged. */
START_TEST(the_cheapest_are_merged) {
    input in = {.key = MNI_SORT_U64, .bytes = 16};
    mni_sort_desc desc = desc_of(&in, 100000);
    const uint64_t room = mni_sort_room(&desc);
    mni_sort *sort = open_sort(&in, desc.budget_bytes);
    const uint32_t ways = mni_sort_figures_get(sort).ways_max;
    mni_sort_close(sort);
    in = make_input(RANDOM, MNI_SORT_U64, 16, (20 + ways) * room);
    for (uint64_t i = 0; i < 20 * room; i++) { /* in order, so one run; no other goes on with it */
        const uint64_t key = UINT64_MAX - 20 * room + i;
        memcpy(in.records + i * in.bytes, &key, sizeof key);
    }
    unsigned char *want = sorted(&in);
    mni_sort_figures f = check_sort(&in, want, desc.budget_bytes);
    ck_assert_uint_eq(f.runs, ways + 1);
    ck_assert_uint_eq(f.merges, 1);
    ck_assert_uint_eq(f.bytes_written, (in.count + 2 * room) * in.bytes);
    free(want);
    free(in.records);
}
END_TEST

/* Random sizes, shapes, keys and budgets. */
START_TEST(random_sorts) {
    uint64_t state = seed;
    for (int i = 0; i < 150; i++) {
        uint32_t bytes = 4 * (1 + (uint32_t)(random_u64(&state) % 16));
        mni_sort_key key = (mni_sort_key)(random_u64(&state) % 3);
        while (key_bytes[key] > bytes)
            key--;
        input in = make_input((shape)(random_u64(&state) % SHAPES), key, bytes,
                              random_u64(&state) % (500000 / bytes));
        unsigned char *want = sorted(&in);
        uint64_t budget =
            MNI_SORT_BUDGET_MIN + random_u64(&state) % (random_u64(&state) % 2 ? 20000 : 400000);
        mni_sort_figures f = check_sort(&in, want, budget);
        ck_assert_uint_eq(f.bytes_read, f.bytes_written);
        free(want);
        free(in.records);
    }
}
END_TEST

/* ---- the budget ---------------------------------------------------------------------------- */

static uint64_t mapped_bytes(void) {
    unsigned long long pages = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    ck_assert_int_eq(fscanf(f, "%llu", &pages), 1);
    fclose(f);
    return pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

/* The process grows by the budget when the sort is opened, and by nothing else after it. */
START_TEST(memory_is_the_budget) {
    input in = make_input(RANDOM, MNI_SORT_U64, 16, 200000);
    uint64_t budget = 200000, before = mapped_bytes();
    mni_sort *sort = open_sort(&in, budget);
    mn_status st = {0};
    ck_assert_uint_le(mapped_bytes(), before + budget);
    put_all(sort, &in);
    ck_assert_int_eq(mni_sort_finish(sort, &st), MN_OK);
    while (mni_sort_next(sort, &st) != NULL) {
    }
    ck_assert_uint_le(mapped_bytes(), before + budget);
    mni_sort_close(sort);
    ck_assert_uint_le(mapped_bytes(), before);
    mni_sort_close(NULL);
    free(in.records);
}
END_TEST

/* ---- failures ------------------------------------------------------------------------------ */

/* The only file that lies in our folder, which has no name there. */
static int spill_fd(void) {
    for (int fd = 3; fd < 256; fd++) {
        char link[64], target[256];
        snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
        ssize_t n = readlink(link, target, sizeof target - 1);
        if (n > 0 && strncmp(target, folder, strlen(folder)) == 0)
            return fd;
    }
    ck_abort_msg("no temporary file");
}

/* From now on the sort's file is another. */
static void replace_spill(const char *path, int flags) {
    int fd = open(path, flags), own = spill_fd();
    ck_assert_int_ge(fd, 0);
    ck_assert_int_eq(dup2(fd, own), own);
    close(fd);
}

static void finish_fails(mni_sort *sort, mn_code code, const char *word) {
    mn_status st = {0};
    ck_assert_msg(mni_sort_finish(sort, &st) == code, "%d: %s", st.code, st.text);
    ck_assert_ptr_nonnull(strstr(st.text, folder));
    ck_assert_ptr_nonnull(strstr(st.text, word));
    ck_assert_ptr_null(mni_sort_next(sort, &st));
    mni_sort_close(sort);
}

START_TEST(full_disks) {
    input in = make_input(RANDOM, MNI_SORT_U64, 16, 20000);
    mni_sort *sort = open_sort(&in, 100000);
    put_all(sort, &in);
    replace_spill("/dev/full", O_RDWR);
    put_all(sort, &in); /* goes on without a word */
    finish_fails(sort, MN_NO_SPACE, "no space left");

    struct rlimit old, small;
    getrlimit(RLIMIT_FSIZE, &old);
    small = (struct rlimit){.rlim_cur = 150000, .rlim_max = old.rlim_max};
    signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &small);
    sort = open_sort(&in, 100000);
    put_all(sort, &in);
    finish_fails(sort, MN_NO_SPACE, "ulimit");
    /* runs fit, the merge of the first of them does not */
    in.count = 9000;
    sort = open_sort(&in, MNI_SORT_BUDGET_MIN);
    put_all(sort, &in);
    finish_fails(sort, MN_NO_SPACE, "ulimit");
    setrlimit(RLIMIT_FSIZE, &old);
    free(in.records);
}
END_TEST

START_TEST(no_folder) {
    input in = make_input(RANDOM, MNI_SORT_U64, 16, 20000);
    mni_sort_desc desc = {.record_bytes = 16,
                          .key = MNI_SORT_U64,
                          .budget_bytes = 100000,
                          .temp_dir = "/nowhere/at/all"};
    mni_sort *sort;
    mn_status st = {0};
    ck_assert_int_eq(mni_sort_open(&sort, &desc, &st), MN_OK); /* perhaps it needs none */
    put_all(sort, &in);
    ck_assert_int_eq(mni_sort_finish(sort, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "/nowhere/at/all"));
    ck_assert_ptr_nonnull(strstr(st.text, "--temp-dir"));
    mni_sort_close(sort);
    free(in.records);
}
END_TEST

/* The Nth byte of the file is the last there is: told, and no record is out of order before. */
START_TEST(files_cut_and_unreadable) {
    input in = make_input(RANDOM, MNI_SORT_U64, 16, 40000);
    unsigned char *want = sorted(&in);
    for (off_t left = 0; left < 600000; left += 29000) { /* no run is all in its buffer */
        mni_sort *sort = open_sort(&in, 300000);
        mn_status st = {0};
        put_all(sort, &in);
        if (left > 0) {
            ck_assert_int_eq(mni_sort_finish(sort, &st), MN_OK);
            ck_assert_int_eq(ftruncate(spill_fd(), left), 0);
        } else {
            replace_spill("/dev/null", O_WRONLY); /* EBADF */
            ck_assert_int_eq(mni_sort_finish(sort, &st), MN_FAILED);
        }
        const void *record;
        uint64_t i = 0;
        while ((record = mni_sort_next(sort, &st)) != NULL)
            if (memcmp(record, want + i++ * in.bytes, in.bytes) != 0)
                ck_abort_msg("record %llu", (unsigned long long)i);
        ck_assert_int_eq(st.code, MN_FAILED);
        ck_assert_ptr_nonnull(strstr(st.text, "temporary file"));
        ck_assert_uint_lt(i, in.count);
        mni_sort_close(sort);
    }
    free(want);
    free(in.records);
}
END_TEST

START_TEST(given_up_at_any_time) {
    input in = make_input(RANDOM, MNI_SORT_U64, 16, 20000);
    mn_status st = {0};
    for (int when = 0; when < 4; when++) {
        mni_sort *sort = open_sort(&in, 100000);
        if (when > 0)
            put_all(sort, &in);
        if (when > 1)
            ck_assert_int_eq(mni_sort_finish(sort, &st), MN_OK);
        if (when > 2)
            ck_assert_ptr_nonnull(mni_sort_next(sort, &st));
        mni_sort_close(sort);
    }
    DIR *d = opendir(folder);
    int entries = 0;
    while (readdir(d) != NULL)
        entries++;
    closedir(d);
    ck_assert_int_eq(entries, 2); /* . and .. */
    free(in.records);
}
END_TEST

int main(void) {
    const char *given = getenv("MN_SEED");
    seed = given != NULL ? strtoull(given, NULL, 10) : (uint64_t)getpid();
    printf("MN_SEED=%llu\n", (unsigned long long)seed);
    if (mkdtemp(folder) == NULL)
        return 1;
    Suite *suite = suite_create("extsort");
    TCase *tc = tcase_create("extsort");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, counts_at_the_edges);
    tcase_add_loop_test(tc, every_shape_every_budget, 0, SHAPES);
    tcase_add_loop_test(tc, every_size, 0, 10);
    tcase_add_test(tc, bytes_moved_are_as_few_as_can_be);
    tcase_add_test(tc, the_cheapest_are_merged);
    tcase_add_test(tc, random_sorts);
    tcase_add_test(tc, memory_is_the_budget);
    tcase_add_test(tc, full_disks);
    tcase_add_test(tc, no_folder);
    tcase_add_test(tc, files_cut_and_unreadable);
    tcase_add_test(tc, given_up_at_any_time);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    rmdir(folder);
    return failed;
}
