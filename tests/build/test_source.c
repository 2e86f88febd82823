/* Goal: numbers are what strtod makes of them, bit for bit, wherever a buffer ends.
 * Method: random numbers of many shapes in one long text, read word by word beside strtod. */
#include "read_help.h"
#include "source.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static uint64_t seed;

static uint64_t random_bits(void) {
    seed ^= seed << 13;
    seed ^= seed >> 7;
    return seed ^= seed << 17;
}

static int random_digits(char *text, int count) {
    for (int i = 0; i < count; i++)
        text[i] = (char)('0' + random_bits() % 10);
    return count;
}

/* A decimal number in one of the ways that programs write them. */
static void random_number(char text[64]) {
    static const char *const formats[] = {"%.17g", "%.16g", "%.9g", "%f", "%.3e", "%.18e", "%.20g"};
    uint64_t bits = random_bits();
    double value;
    memcpy(&value, &bits, sizeof value);
    if (bits % 3 != 0 || value != value || value - value != 0)
        value = (double)(int64_t)random_bits() / 9.2e18 * (bits % 5 == 0 ? 1e5 : 1);
    size_t shape = bits / 3 % 9;
    if (shape < 7 && !(shape == 3 && (value > 1e30 || value < -1e30))) {
        snprintf(text, 64, formats[shape], value);
        return;
    }
    int at = 0; /* any digits, any exponent near those that are exact */
    if (bits % 2 != 0)
        text[at++] = '-';
    at += random_digits(text + at, 1 + (int)(random_bits() % 20));
    text[at++] = '.';
    at += random_digits(text + at, (int)(random_bits() % 8));
    snprintf(text + at, 16, "e%d", (int)(random_bits() % 60) - 40);
}

static void open_text(mni_source *source, const char *text, size_t size, mn_status *st) {
    char path[] = "/tmp/metanode-test-XXXXXX";
    int fd = mkstemp(path);
    ck_assert_int_ge(fd, 0);
    ck_assert_int_eq(write(fd, text, size), (ssize_t)size);
    close(fd);
    const mn_read_desc desc = {0};
    ck_assert(mni_source_open(source, path, &desc, st));
    unlink(path);
    source->text = true;
}

START_TEST(numbers_are_exact) {
    enum { NUMBERS = 200000 };
    const char *text = getenv("MN_SEED");
    seed = text != NULL ? strtoull(text, NULL, 0) : 20260101;
    printf("MN_SEED=%llu\n", (unsigned long long)seed);
    char *numbers = malloc((size_t)NUMBERS * 64);
    size_t at = 0;
    for (int i = 0; i < NUMBERS; i++) {
        random_number(numbers + at);
        at += strlen(numbers + at);
        numbers[at++] = i % 3 == 2 ? '\n' : ' ';
    }
    numbers[at] = 0;
    mni_source source;
    mn_status st = {0};
    open_text(&source, numbers, at, &st);
    char *here = numbers;
    for (int i = 0; i < NUMBERS; i++) {
        double value = 0, wanted = strtod(here, &here);
        ck_assert(mni_text_next_anywhere(&source, 0));
        ck_assert_msg(mni_text_double(&source, &value, "a number"), "%s", st.text);
        ck_assert_msg(memcmp(&value, &wanted, sizeof value) == 0, "%.20g for %.20g", value, wanted);
        ck_assert_uint_eq(source.line, (uint64_t)i / 3 + 1);
    }
    ck_assert(!mni_text_next_anywhere(&source, 0));
    mni_source_close(&source);
    free(numbers);
}
END_TEST

/* Halfway between two doubles, and a hair beside it: where rounding twice goes wrong. */
START_TEST(hard_numbers) {
    static const char *const hard[] = {"9007199254740993",
                                       "9007199254740993.0001",
                                       "9007199254740992.9999",
                                       "1.00000000000000011102230246251565404",
                                       "1.0000000000000001110",
                                       "2.2250738585072011e-308",
                                       "4.9e-324",
                                       "1.7976931348623157e308",
                                       "1e23",
                                       "8.5e22",
                                       "0.1",
                                       "-0",
                                       "179769313486231580793728971405301e276",
                                       "5e-324",
                                       "123456789012345678e-27",
                                       "9223372036854775807e5",
                                       "18446744073709551615",
                                       "6.02214076e23",
                                       "0.000001e-5"};
    for (size_t i = 0; i < sizeof hard / sizeof *hard; i++) {
        mni_source source;
        mn_status st = {0};
        double value = 0, wanted = strtod(hard[i], NULL);
        open_text(&source, hard[i], strlen(hard[i]), &st);
        ck_assert(mni_text_next(&source, false));
        ck_assert_msg(mni_text_double(&source, &value, "a number"), "%s", st.text);
        ck_assert_msg(memcmp(&value, &wanted, sizeof value) == 0, "%s", hard[i]);
        mni_source_close(&source);
    }
}
END_TEST

START_TEST(integers) {
    mni_source source;
    mn_status st = {0};
    int64_t value = 0;
    static const char text[] = "0 -1 +7 9223372036854775807 -9223372036854775807\n12x\n";
    open_text(&source, text, sizeof text - 1, &st);
    const int64_t wanted[] = {0, -1, 7, INT64_MAX, -INT64_MAX};
    for (int i = 0; i < 5; i++) {
        ck_assert(mni_text_next(&source, false));
        ck_assert(mni_text_integer(&source, &value, "a number"));
        ck_assert_int_eq(value, wanted[i]);
    }
    ck_assert(!mni_text_next(&source, false));
    ck_assert(mni_text_next_anywhere(&source, 0));
    ck_assert(!mni_text_integer(&source, &value, "it"));
    ck_assert_ptr_nonnull(strstr(st.text, "line 2: it is '12x': an integer is wanted"));
    mni_source_close(&source);
}
END_TEST

START_TEST(windows) {
    enum { SIZE = 3 * MNI_SOURCE_BUFFER_BYTES + 17 };
    char *bytes = malloc(SIZE);
    for (uint32_t i = 0; i < SIZE; i++)
        bytes[i] = (char)(i * 2654435761u >> 24);
    mni_source source;
    mn_status st = {0};
    open_text(&source, bytes, SIZE, &st);
    uint64_t at = 0;
    for (uint32_t step = 1; at + step <= SIZE; at += step, step = step * 3 % 100003) {
        ck_assert_uint_eq(mni_source_offset(&source), at);
        ck_assert_uint_eq(mni_source_left(&source), SIZE - at);
        ck_assert(mni_source_have(&source, step));
        ck_assert_mem_eq(source.at, bytes + at, step);
        ck_assert(mni_source_skip(&source, step));
    }
    ck_assert(!mni_source_skip(&source, SIZE - at + 1));
    ck_assert(mni_source_skip(&source, SIZE - at));
    ck_assert(!mni_source_have(&source, 1));
    mni_source_rewind(&source, 5);
    ck_assert(mni_source_have(&source, MNI_SOURCE_BUFFER_BYTES));
    ck_assert_mem_eq(source.at, bytes + 5, MNI_SOURCE_BUFFER_BYTES);
    mni_source_close(&source);
    free(bytes);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("source");
    TCase *tests = tcase_create("source");
    tcase_set_timeout(tests, 60);
    tcase_add_test(tests, numbers_are_exact);
    tcase_add_test(tests, hard_numbers);
    tcase_add_test(tests, integers);
    tcase_add_test(tests, windows);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
