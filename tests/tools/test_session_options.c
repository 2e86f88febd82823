/* Goal: the shared options mean what they say, and every bad value is refused and named.
 * Method: each option's texts, good and bad, through getopt as the commands do it. */
#include <check.h>
#include <stdio.h>
#include <string.h>

#include "session_options.h"
#include "suite.h"

static session_options o;

/* argv[0] and a NULL end are added. */
static int parse(int count, const char *const *arguments) {
    static const struct option options[] = {SESSION_OPTIONS, {0, 0, 0, 0}};
    char *argv[16] = {"test"};
    int found, code = MN_OK;
    for (int i = 0; i < count; i++)
        argv[i + 1] = (char *)arguments[i];
    session_options_init(&o);
    optind = 0; /* getopt starts anew */
    while ((found = cli_option(count + 1, argv, SESSION_OPTIONS_SHORT, options)) != -1)
        if (!session_options_take(&o, "test", found, optarg, &code) || code != MN_OK)
            return MN_USAGE;
    return session_options_file(&o, count + 1, argv);
}

static int parse_one(const char *option, const char *value) {
    const char *const arguments[] = {option, value, "a.mnt"};
    return parse(3, arguments);
}

START_TEST(defaults) {
    const char *const arguments[] = {"a.mnt"};
    ck_assert_int_eq(parse(1, arguments), MN_OK);
    ck_assert_str_eq(o.desc.path, "a.mnt");
    ck_assert_ptr_null(o.path_name);
    ck_assert_uint_eq(o.desc.ram_bytes, 0);
    ck_assert_int_eq(o.desc.k, MN_K_FROM_RAM);
    ck_assert_uint_eq(o.desc.width_px, 1280);
    ck_assert_uint_eq(o.desc.height_px, 720);
    ck_assert_float_eq(o.fov_y_deg, 45);
    ck_assert_float_eq(o.desc.fps, 60);
    ck_assert_uint_eq(o.frames, 600);
    ck_assert(!o.frames_given && !o.json && !o.desc.degrade_off);
}
END_TEST

START_TEST(all_at_once) {
    const char *const arguments[] = {
        "--ram",        "16M",       "a.mnt", "-K",       "min",    "--store",   "mapped",
        "--size=64x48", "--degrade", "off",   "--io=sim", "--json", "--barrier", "--front-max=900"};
    ck_assert_int_eq(parse(14, arguments), MN_OK);
    ck_assert_uint_eq(o.desc.front_max, 900);
    ck_assert_uint_eq(o.desc.ram_bytes, 16u << 20);
    ck_assert_int_eq(o.desc.k, MN_K_MIN);
    ck_assert_int_eq(o.desc.store, MN_STORE_MAPPED);
    ck_assert_int_eq(o.desc.io, MN_IO_SIM);
    ck_assert_uint_eq(o.desc.width_px, 64);
    ck_assert_uint_eq(o.desc.height_px, 48);
    ck_assert(o.desc.degrade_off && o.json && o.desc.barrier && !o.desc.io_serial);
}
END_TEST

START_TEST(limits) {
    static const char *const good[][2] = {
        {"--fps", "0"},        {"--nav-ops", "0"},      {"--fov", "170"},
        {"--size", "16384x1"}, {"--tolerance", "0.25"}, {"--frames", "1"},
        {"-K", "5"},           {"--ram", "1.5G"},       {"--seed", "18446744073709551615"},
        {"--front-max", "1"}};
    static const char *const bad[][2] = {{"--fps", "-1"},
                                         {"--nav-ops", "-1"},
                                         {"--fov", "0"},
                                         {"--fov", "171"},
                                         {"--size", "16385x1"},
                                         {"--size", "0x10"},
                                         {"--size", "10"},
                                         {"--size", "10x10x"},
                                         {"--size", "10x-1"},
                                         {"--tolerance", "0"},
                                         {"--frames", "0"},
                                         {"-K", "0"},
                                         {"-K", "few"},
                                         {"--ram", "0"},
                                         {"--ram", "16Q"},
                                         {"--store", "disk"},
                                         {"--io", "aio"},
                                         {"--degrade", "yes"},
                                         {"--seed", "0x10"},
                                         {"--frames", "1e3"},
                                         {"--tolerance", "nan"},
                                         {"--fps", "infinity"},
                                         {"--nonsense", "1"},
                                         {"--front-max", "0"},
                                         {"--front-max", "4294967296"}};
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++)
        ck_assert_msg(parse_one(good[i][0], good[i][1]) == MN_OK, "%s %s", good[i][0], good[i][1]);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        ck_assert_msg(parse_one(bad[i][0], bad[i][1]) == MN_USAGE, "%s %s", bad[i][0], bad[i][1]);
}
END_TEST

START_TEST(weights) {
    const char *const arguments[] = {"--frustum=off", "--cones",  "3",
                                     "--silhouettes", "on",       "--light-factor=4",
                                     "--light",       "-1,0.5,2", "a.mnt"};
    const char *const none[] = {"a.mnt", "--light-factor", "4"};
    const mn_weights *w = &o.desc.weights;
    ck_assert_int_eq(parse(3, none), MN_OK);
    ck_assert(w->outside == 0 && w->away == 0 && w->silhouette == 0 && w->light == 1);
    ck_assert_int_eq(parse(9, arguments), MN_OK);
    ck_assert(w->outside == 1 && w->away == 3 && w->silhouette == 2 && w->light == 4);
    ck_assert(w->light_from[0] == -1 && w->light_from[1] == 0.5f && w->light_from[2] == 2);
    ck_assert_int_eq(parse_one("--light", "on"), MN_OK);
    ck_assert(w->light == 2 && w->light_from[0] == 0);
}
END_TEST

START_TEST(one_file) {
    const char *const two[] = {"a.mnt", "b.mnt"};
    const char *const option[] = {"a.mnt", "--ram"};
    ck_assert_int_eq(parse(0, two), MN_USAGE);
    ck_assert_int_eq(parse(2, two), MN_USAGE);
    ck_assert_int_eq(parse(2, option), MN_USAGE);
}
END_TEST

/* --help must not forget an option. */
START_TEST(help_names_all) {
    static const struct option options[] = {SESSION_OPTIONS, {0, 0, 0, 0}};
    char name[32];
    for (int i = 0; options[i].name != NULL; i++) {
        snprintf(name, sizeof name, "--%s ", options[i].name);
        ck_assert_msg(strstr(session_options_help, name) != NULL ||
                          strstr(session_options_json_help, name) != NULL,
                      "%s", name);
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("session_options");
    TCase *tc = tcase_create("session_options");
    tcase_add_test(tc, defaults);
    tcase_add_test(tc, all_at_once);
    tcase_add_test(tc, limits);
    tcase_add_test(tc, weights);
    tcase_add_test(tc, one_file);
    tcase_add_test(tc, help_names_all);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
