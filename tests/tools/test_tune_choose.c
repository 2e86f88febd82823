/* Goal: the best setting is the one that was asked for, and a line of the results says what was
 * measured or is refused. Method: settings and cells made by hand, and every prefix of a line. */
#include <check.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "suite.h"
#include "tune.h"

static const tune_want anything = {INFINITY, INFINITY, INFINITY, INFINITY, TUNE_ERROR, false};

/* A setting of one path, as a cell. */
static tune_cell cell_of(double error, double misses, double ms, double k) {
    tune_cell c = {.state = TUNE_MEASURED, .k = (uint32_t)k};
    for (int i = 0; i < TUNE_FIGURES; i++)
        c.figure[i] = 0;
    c.figure[TUNE_ERROR_P95] = error;
    c.figure[TUNE_MISS_RATE] = misses;
    c.figure[TUNE_NAV_P99] = ms;
    c.figure[TUNE_CPU_P99] = ms / 2;
    c.figure[TUNE_K] = k;
    c.figure[TUNE_BLOCK_BYTES] = 8192;
    c.figure[TUNE_RSS_BYTES] = k * 8192 + 4e6;
    return c;
}

/* Index of the chosen one; -1: none. */
static int choose(const tune_cell *cells, size_t count, uint32_t paths, tune_want want) {
    tune_setting settings[32];
    const size_t n = tune_settings(cells, count, paths, want.cpu, settings, 32);
    const tune_setting *best = tune_choose(settings, n, &want);
    return best == NULL ? -1 : (int)(best->cell - cells);
}

START_TEST(settings_of_paths) {
    tune_cell cells[] = {cell_of(9, 0, 9, 9),   cell_of(9, 0, 9, 9), cell_of(1, 0.1, 2, 8),
                         cell_of(3, 0.0, 1, 8), cell_of(5, 0, 5, 5), cell_of(5, 0, 5, 5)};
    tune_setting s[3];
    cells[0].resident = cells[1].resident = true;
    cells[5].state = TUNE_REFUSED;
    for (int i = 0; i < TUNE_FIGURES; i++)
        cells[5].figure[i] = NAN;
    ck_assert_uint_eq(tune_settings(cells, 6, 2, false, s, 3), 2);
    ck_assert_ptr_eq(s[0].cell, &cells[2]);
    ck_assert(s[0].whole && s[0].error_px == 3 && s[0].miss_rate == 0.1 && s[0].p99_ms == 2);
    ck_assert(!s[1].whole);
    ck_assert_uint_eq(tune_settings(cells, 6, 2, true, s, 1), 1); /* no more than there is room */
    ck_assert(s[0].p99_ms == 1);
    ck_assert_uint_eq(tune_settings(cells, 0, 2, true, s, 3), 0);
    ck_assert(!tune_keeps_to(&(tune_setting){.whole = false}, &anything));
}
END_TEST

START_TEST(in_words) {
    static const char *const good[] = {"p99 under 4 ms at 24 MB", "at 24 MB, p99 under 4 ms",
                                       "p99 under 4ms and at 24MB",
                                       "at 24 MB and p99 under 4.0 ms"};
    static const char *const bad[][2] = {{"", ""},
                                         {"p99", "p99"},
                                         {"p99 under 4", "p99 under 4"},
                                         {"p99 under 4 s", "p99 under 4 s"},
                                         {"p99 under -1 ms", "p99 under -1 ms"},
                                         {"p99 under nan ms", "p99 under nan ms"},
                                         {"at 24 ms", "at 24 ms"},
                                         {"at 1e30 GB", "at 1e30 GB"},
                                         {"p50 under 4 ms", "p50 under 4 ms"},
                                         {"at 24 MB please", "please"},
                                         {"at 24 MB and at 16 MB", "at 16 MB"},
                                         {"at 0 MB", "at 0 MB"}, /* no cap at all, to replay */
                                         {"misses under 101 %", "misses under 101 %"}};
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++) {
        tune_want want = anything;
        ck_assert_msg(tune_want_take(&want, good[i]) == NULL, "%s", good[i]);
        ck_assert(want.p99_ms == 4 && want.ram_bytes == 24 << 20);
        ck_assert(isinf(want.error_px) && isinf(want.miss_rate));
    }
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        tune_want want = anything;
        const char *at = tune_want_take(&want, bad[i][0]);
        ck_assert_msg(at != NULL, "%s", bad[i][0]);
        ck_assert_str_eq(at, bad[i][1]);
    }
    tune_want want = anything;
    ck_assert_ptr_null(tune_want_take(&want, "error under 3 px, misses under 1 %, at 1.5 GB"));
    ck_assert(want.error_px == 3 && want.miss_rate == 0.01 && want.ram_bytes == 1.5 * (1 << 30));
}
END_TEST

START_TEST(least) {
    const tune_cell cells[] = {cell_of(4, 0.00, 9, 100), cell_of(8, 0.01, 5, 50),
                               cell_of(16, 0.02, 3, 25), cell_of(INFINITY, 0.5, 1, 7)};
    tune_want want = anything;
    ck_assert_int_eq(choose(cells, 4, 1, want), 0);
    want.objective = TUNE_MISSES;
    ck_assert_int_eq(choose(cells, 4, 1, want), 0);
    want.objective = TUNE_P99;
    ck_assert_int_eq(choose(cells, 4, 1, want), 3);
    want.objective = TUNE_RAM;
    ck_assert_int_eq(choose(cells, 4, 1, want), 3);
    ck_assert_int_eq(choose(cells, 0, 1, want), -1);
}
END_TEST

START_TEST(bounds) {
    const tune_cell cells[] = {cell_of(4, 0.00, 9, 100), cell_of(8, 0.01, 5, 50),
                               cell_of(16, 0.02, 3, 25), cell_of(INFINITY, 0.5, 1, 7)};
    tune_want want = anything;
    want.p99_ms = 5; /* a bound may be reached */
    ck_assert_int_eq(choose(cells, 4, 1, want), 1);
    want.p99_ms = 4.999;
    ck_assert_int_eq(choose(cells, 4, 1, want), 2);
    want.cpu = true;
    ck_assert_int_eq(choose(cells, 4, 1, want), 0);
    want = anything;
    want.ram_bytes = 25 * 8192 + 4e6;
    ck_assert_int_eq(choose(cells, 4, 1, want), 2);
    want.error_px = 15;
    ck_assert_int_eq(choose(cells, 4, 1, want), -1);
    want = anything;
    want.objective = TUNE_RAM;
    want.miss_rate = 0.015;
    ck_assert_int_eq(choose(cells, 4, 1, want), 1);
    want.error_px = 0;
    ck_assert_int_eq(choose(cells, 4, 1, want), -1);
}
END_TEST

/* Within 2 % is equal: then memory, then time. */
START_TEST(alike) {
    tune_cell cells[] = {cell_of(1.00, 0, 2, 100), cell_of(1.019, 0, 2, 50),
                         cell_of(1.03, 0, 1, 10), cell_of(1.015, 0, 1, 50)};
    ck_assert_int_eq(choose(cells, 4, 1, anything), 3);
    cells[3] = cell_of(1.0, 0, 3, 50);
    ck_assert_int_eq(choose(cells, 4, 1, anything), 1);
    for (int i = 0; i < 4; i++)
        cells[i].figure[TUNE_ERROR_P95] = INFINITY; /* all alike */
    ck_assert_int_eq(choose(cells, 4, 1, anything), 2);
    cells[2].state = TUNE_MISSING;
    ck_assert_int_eq(choose(cells, 4, 1, anything), 1);
    for (int i = 0; i < 4; i++)
        cells[i].figure[TUNE_ERROR_P95] = 0;
    ck_assert_int_eq(choose(cells, 4, 1, anything), 1);
}
END_TEST

static bool count_word(void *context, const char *word) {
    ++*(int *)context;
    return strcmp(word, "bad") != 0;
}

START_TEST(lists) {
    int count = 0;
    tune_places p;
    const char *text = "a,b,bad,c";
    ck_assert_ptr_null(tune_list("a,b,c", count_word, &count));
    ck_assert_int_eq(count, 3);
    ck_assert_ptr_eq(tune_list(text, count_word, &count), text + 4);
    const char *const empty[] = {"", ",", "a,", "a,,b"};
    for (int i = 0; i < 4; i++)
        ck_assert_ptr_nonnull(tune_list(empty[i], count_word, &count));
    ck_assert_ptr_null(tune_list("1,2,3,4,5,6,7,8,9,0,1,2,3,4,5,6", count_word, &count));
    ck_assert_ptr_nonnull(tune_list("1,2,3,4,5,6,7,8,9,0,1,2,3,4,5,6,7", count_word, &count));
    ck_assert(tune_places_parse("1/6", &p) && p.kind == TUNE_SHARE && p.value == 1.0 / 6);
    ck_assert(tune_places_parse("27/1", &p) && p.kind == TUNE_SHARE && p.value == 27);
    ck_assert(tune_places_parse("12", &p) && p.kind == TUNE_COUNT && p.value == 12);
    ck_assert(tune_places_parse("min", &p) && p.kind == TUNE_LEAST);
    const char *const bad[] = {"0",  "-1",   "1/0", "0/3", "1/",
                               "/3", "1/3x", "max", "0.5", "123456789012345678"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        ck_assert_msg(!tune_places_parse(bad[i], &p), "%s", bad[i]);
}
END_TEST

static tune *one_layout(void) {
    tune *t = calloc(1, sizeof *t);
    snprintf(t->layout[0].name, sizeof t->layout[0].name, "packed-8K");
    snprintf(t->o.path[0].key, sizeof t->o.path[0].key, "orbit");
    t->o.path[0].frames = 100;
    t->o.places[0].kind = TUNE_COUNT;
    t->layouts = 1;
    t->o.paths = t->o.places_count = t->o.caps = 1;
    return t;
}

START_TEST(lines) {
    tune *t = one_layout();
    tune_cell c = cell_of(1.0 / 3, 0.25, 1e-7, 12), read = {0};
    char line[2048], cut[2050], key[256];
    c.figure[TUNE_ERROR_MAX] = INFINITY;
    c.figure[TUNE_LOCK_US] = NAN;
    ck_assert(tune_line_write(t, &c, line, sizeof line));
    tune_cell_key(t, &c, key, sizeof key);
    ck_assert_str_eq(key, "packed-8K,0,12,orbit:100,ahead,");
    ck_assert_int_eq(strncmp(line, key, strlen(key)), 0);
    ck_assert(tune_line_read(line, &read));
    ck_assert_int_eq(read.state, TUNE_MEASURED);
    for (int i = 0; i < TUNE_FIGURES; i++)
        ck_assert_msg(isnan(c.figure[i])
                          ? isnan(read.figure[i])
                          : fabs(read.figure[i] - c.figure[i]) <= 1e-8 * c.figure[i] ||
                                read.figure[i] == c.figure[i],
                      "%s: %g, read as %g", tune_figure_names[i], c.figure[i], read.figure[i]);
    for (size_t n = 0; n < strlen(line); n++) { /* torn anywhere it is no line */
        memcpy(cut, line, n);
        cut[n] = 0;
        ck_assert_msg(!tune_line_read(cut, &read), "cut at %zu: %s", n, cut);
    }
    snprintf(cut, sizeof cut, "%s,", line);
    ck_assert(!tune_line_read(cut, &read));
    ck_assert(!tune_line_write(t, &c, line, 40)); /* no room */
    c.state = TUNE_REFUSED;
    c.code = 5;
    snprintf(c.says, sizeof c.says, "-K 2: \"too\" small,\nso");
    ck_assert(tune_line_write(t, &c, line, sizeof line));
    ck_assert(tune_line_read(line, &read));
    ck_assert_int_eq(read.state, TUNE_REFUSED);
    ck_assert_int_eq(read.code, 5);
    ck_assert_str_eq(read.says, "-K 2: 'too' small,'so");
    free(t);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("tune");
    TCase *tests = tcase_create("choose");
    tcase_add_test(tests, in_words);
    tcase_add_test(tests, settings_of_paths);
    tcase_add_test(tests, least);
    tcase_add_test(tests, bounds);
    tcase_add_test(tests, alike);
    tcase_add_test(tests, lists);
    tcase_add_test(tests, lines);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
