/* Goal: welding, rejection, counting, origin and cap are as the design says, in every format.
 * Method: small OBJ texts for each rule, random meshes against a quadratic count, caps that are
 * refused and then work with the number that the refusal names. */
#include "read_help.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const mn_read_desc apart = {.weld = MN_WELD_OFF};

#define TRIANGLE "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"

/* ---- rules ---------------------------------------------------------------------------------- */

START_TEST(welding) {
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv -0 0 -0.0\nv 1e0 0 0\nv 0 0 1\n"
                               "f 1 2 3\nf 4 5 6\n";
    mn_mesh mesh = read_text(text, NULL);
    ck_assert_uint_eq(mesh.vertices, 4);
    ck_assert_uint_eq(mesh.intake.welded_vertices, 2);
    ck_assert_uint_eq(mesh.intake.unused_vertices, 0);
    const uint32_t corner[6] = {0, 1, 2, 0, 1, 3}; /* first come, first numbered */
    ck_assert_mem_eq(mesh.corner, corner, sizeof corner);
    mn_mesh_free(&mesh);
    mesh = read_text(text, &apart);
    ck_assert_uint_eq(mesh.vertices, 6);
    ck_assert_uint_eq(mesh.intake.welded_vertices, 0);
    ck_assert_uint_eq(mesh.intake.merged_positions, 0);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(duplicates) {
    static const char text[] = TRIANGLE "f 2 3 1\nf 3 2 1\nv 0 0 0\nf 4 2 3\nv 0 0 1\nf 1 2 5\n";
    mn_mesh mesh = read_text(text, NULL);
    ck_assert_uint_eq(mesh.intake.input_faces, 5);
    ck_assert_uint_eq(mesh.intake.duplicate_faces, 3); /* any order, and after welding */
    ck_assert_uint_eq(mesh.triangles, 2);
    ck_assert_uint_eq(mesh.intake.misoriented_faces, 1); /* 1 2 again; rejected ones do not count */
    mn_mesh_free(&mesh);
    mesh = read_text(text, &apart);
    ck_assert_uint_eq(mesh.intake.duplicate_faces, 2);
    ck_assert_uint_eq(mesh.triangles, 3);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(degenerate_and_zero_area) {
    mn_mesh mesh = read_text(TRIANGLE "f 1 1 2\nf 1 2 2\nf 2 1 2\nv 1 0 0\nf 4 2 1\n"
                                      "v 2 0 0\nf 2 1 5\n",
                             NULL);
    ck_assert_uint_eq(mesh.intake.degenerate_faces, 4);
    ck_assert_uint_eq(mesh.triangles, 2); /* the last has no area, but three vertices: kept */
    ck_assert_uint_eq(mesh.intake.input_faces, 6);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(nonfinite) {
    mn_mesh mesh = read_text(TRIANGLE "v nan 0 0\nv 0 inf 0\nv 0 0 -1e400\nv 0 1e39 0\nv NaN 0 0\n"
                                      "f 1 2 4\nf 1 2 5\nf 1 2 6\nf 1 2 7\nf 4 4 8\nf 4 5 6\n",
                             NULL);
    ck_assert_uint_eq(mesh.intake.nonfinite_faces, 6); /* 1e39 is past what floats hold */
    ck_assert_uint_eq(mesh.intake.degenerate_faces, 0);
    ck_assert_uint_eq(mesh.intake.welded_vertices, 0); /* a NaN equals nothing */
    ck_assert_uint_eq(mesh.intake.unused_vertices, 5);
    ck_assert_uint_eq(mesh.triangles, 1);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(misoriented_faces) {
    /* Two that run along an edge the same way; a third one at that edge the other way. */
    mn_mesh mesh = read_text(TRIANGLE "v 1 1 0\nv 0 0 1\nf 2 3 4\nf 3 2 5\n", NULL);
    ck_assert_uint_eq(mesh.triangles, 3);
    ck_assert_uint_eq(mesh.intake.misoriented_faces, 1);
    mn_mesh_free(&mesh);
    mesh = read_text(TRIANGLE "v 1 1 0\nf 3 2 4\n", NULL);
    ck_assert_uint_eq(mesh.intake.misoriented_faces, 0);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(unused_vertices) {
    mn_mesh mesh = read_text("v 9 9 9\nv 0 0 0 1 0 0\nv 8 8 8\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\n"
                             "v 7 7 7\nf 5 2 4\nf 3 3 1\n",
                             NULL);
    const uint32_t corner[3] = {2, 0, 1}, color[3] = {0xff0000ff, 0xff00ff00, 0xffff0000};
    ck_assert_uint_eq(mesh.intake.unused_vertices, 3);
    ck_assert_mem_eq(mesh.corner, corner, sizeof corner);
    ck_assert_mem_eq(mesh.color, color, sizeof color);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(origin) {
    mn_mesh mesh = read_text("v 100 0 0\nv 101.5 0 0\nv 100 1 0\nf 1 2 3\n", NULL);
    ck_assert(mesh.origin[0] == 0 && mesh.origin[1] == 0 && mesh.origin[2] == 0);
    ck_assert(mesh.position[0] == 100 && mesh.position[3] == 101.5f);
    mn_mesh_free(&mesh);
    mesh = read_text("v 4000000.001 5e6 0\nv 4000000.002 5e6 0\nv 4000000.001 5000000.001 0\n"
                     "f 1 2 3\n",
                     NULL); /* floats alone could not tell them apart */
    ck_assert_uint_eq(mesh.intake.merged_positions, 0);
    for (int i = 0; i < 9; i++)
        ck_assert_float_lt(fabsf(mesh.position[i]), 0.002f);
    ck_assert_double_eq_tol(mesh.origin[0] + (double)mesh.position[0], 4000000.001, 1e-9);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(merged_positions) {
    static const char text[] = "v 0.1 0 0\nv 1000 0 0\nv 1000.0000001 0 0\nv 1000.0000002 0 0\n"
                               "v 1000 0 0\nv 0 1000 0\nf 1 2 6\nf 1 3 6\nf 1 4 6\nf 1 5 6\n";
    mn_mesh mesh = read_text(text, NULL);
    ck_assert_uint_eq(mesh.vertices, 5); /* they stay apart */
    ck_assert_uint_eq(mesh.intake.welded_vertices, 1);
    ck_assert_uint_eq(mesh.intake.merged_positions, 2);
    mn_mesh_free(&mesh);
    mesh = read_text(text, &apart);
    ck_assert_uint_eq(mesh.vertices, 6);
    ck_assert_uint_eq(mesh.intake.merged_positions, 2); /* equal ones do not count */
    mn_mesh_free(&mesh);
}
END_TEST

/* ---- against a count of all pairs ----------------------------------------------------------- */

static bool same_face(const uint32_t *a, const uint32_t *b) {
    for (int i = 0; i < 3; i++)
        if (a[i] != b[0] && a[i] != b[1] && a[i] != b[2])
            return false;
    return true;
}

static bool shares_edge(const uint32_t *a, const uint32_t *b) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (a[i] == b[j] && a[(i + 1) % 3] == b[(j + 1) % 3])
                return true;
    return false;
}

enum { FACES_MAX = 300, VERTICES_MAX = 60 };

static uint32_t random_below(uint64_t *seed, uint32_t below) {
    *seed = *seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((*seed >> 33) % below);
}

/* One random mesh with few vertices, so that stars are large and doubles many. */
static void compare_random(uint64_t *seed) {
    static char text[FACES_MAX * 20 + VERTICES_MAX * 20];
    uint32_t kept[FACES_MAX][3], faces = 1 + random_below(seed, FACES_MAX - 1), triangles = 0;
    uint32_t vertices = 4 + random_below(seed, VERTICES_MAX - 4), at = 0;
    mn_intake c = {.input_faces = faces};
    for (uint32_t v = 0; v < vertices; v++) /* vertex v lies where v / 2 * 2 does, now and then */
        at += (uint32_t)sprintf(text + at, "v %u 0 0\n", v % 5 == 1 ? v - 1 : v);
    for (uint32_t f = 0; f < faces; f++) {
        uint32_t face[3];
        for (int i = 0; i < 3; i++) {
            face[i] = random_below(seed, random_below(seed, 2) ? vertices : 3);
            at += (uint32_t)sprintf(text + at, "%s%u%s", i == 0 ? "f " : " ", face[i] + 1,
                                    i == 2 ? "\n" : "");
            face[i] = face[i] % 5 == 1 ? face[i] - 1 : face[i];
        }
        bool duplicate = false, misoriented = false;
        if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0]) {
            c.degenerate_faces++;
            continue;
        }
        for (uint32_t k = 0; k < triangles; k++) {
            duplicate = duplicate || same_face(face, kept[k]);
            misoriented = misoriented || shares_edge(face, kept[k]);
        }
        c.duplicate_faces += duplicate;
        c.misoriented_faces += !duplicate && misoriented;
        if (!duplicate)
            memcpy(kept[triangles++], face, sizeof face);
    }
    mn_mesh mesh;
    mn_status st = {0};
    mn_code code = read_bytes(text, at, NULL, &mesh, &st);
    ck_assert_int_eq(code, triangles > 0 ? MN_OK : MN_BAD_INPUT);
    if (code != MN_OK)
        return;
    check_mesh(&mesh);
    ck_assert_uint_eq(mesh.triangles, triangles);
    ck_assert_uint_eq(mesh.intake.degenerate_faces, c.degenerate_faces);
    ck_assert_uint_eq(mesh.intake.duplicate_faces, c.duplicate_faces);
    ck_assert_uint_eq(mesh.intake.misoriented_faces, c.misoriented_faces);
    ck_assert_uint_eq(mesh.vertices + mesh.intake.unused_vertices + mesh.intake.welded_vertices,
                      vertices);
    for (uint32_t t = 0; t < triangles; t++)
        for (int i = 0; i < 3; i++)
            ck_assert(mesh.position[3 * mesh.corner[3 * t + i]] == (float)kept[t][i]);
    mn_mesh_free(&mesh);
}

START_TEST(random_meshes) {
    const char *text = getenv("MN_SEED");
    uint64_t seed = text != NULL ? strtoull(text, NULL, 0) : 20260101;
    printf("MN_SEED=%llu\n", (unsigned long long)seed);
    for (int i = 0; i < 400; i++)
        compare_random(&seed);
}
END_TEST

/* A vertex in thousands of triangles, each of them twice. */
START_TEST(large_star) {
    enum { RIM = 4000 };
    char *text = malloc(RIM * 80);
    size_t at = (size_t)sprintf(text, "v 0 0 0\n");
    for (int i = 0; i < RIM; i++)
        at += (size_t)sprintf(text + at, "v %d %d 1\n", i % 64, i / 64);
    for (int i = 0; i < RIM; i++)
        at += (size_t)sprintf(text + at, "f 1 %d %d\nf %d 1 %d\n", i + 2, (i + 1) % RIM + 2, i + 2,
                              (i + 1) % RIM + 2);
    mn_mesh mesh = read_text(text, NULL);
    ck_assert_uint_eq(mesh.triangles, RIM);
    ck_assert_uint_eq(mesh.intake.duplicate_faces, RIM);
    ck_assert_uint_eq(mesh.intake.misoriented_faces, 0);
    mn_mesh_free(&mesh);
    free(text);
}
END_TEST

/* ---- the cap -------------------------------------------------------------------------------- */

enum { GRID = 150, GRID_TRIANGLES = 2 * (GRID - 1) * (GRID - 1) };
typedef enum grid_format { GRID_OBJ, GRID_OFF, GRID_STL, GRID_FORMATS } grid_format;

static size_t put_grid_facet(char *bytes, const int corner[3]) {
    float place[12] = {0};
    for (int i = 0; i < 3; i++) {
        place[3 + 3 * i] = (float)(corner[i] % GRID);
        place[4 + 3 * i] = (float)(corner[i] / GRID);
    }
    memcpy(bytes, place, 48);
    memset(bytes + 48, 0, 2);
    return 50;
}

/* A flat grid of GRID × GRID vertices. The caller frees. */
static char *make_grid(grid_format format, size_t *size) {
    static const char *const head[] = {"", "OFF\n%d %d 0\n", ""};
    char *bytes = malloc(GRID_TRIANGLES * 100);
    const uint32_t facets = GRID_TRIANGLES;
    size_t at = 0;
    if (format == GRID_STL) {
        memset(bytes, 0, 80);
        memcpy(bytes + 80, &facets, 4);
        at = 84;
    } else if (format == GRID_OFF) {
        at = (size_t)sprintf(bytes, head[1], GRID * GRID, GRID_TRIANGLES);
    }
    for (int v = 0; v < GRID * GRID && format != GRID_STL; v++)
        at += (size_t)sprintf(bytes + at, format == GRID_OFF ? "%d %d 0\n" : "v %d %d 0\n",
                              v % GRID, v / GRID);
    for (int t = 0; t < GRID_TRIANGLES; t++) {
        int a = t / 2 / (GRID - 1) * GRID + t / 2 % (GRID - 1);
        int corner[3] = {t % 2 ? a + 1 : a, t % 2 ? a + GRID + 1 : a + 1, a + GRID};
        if (format == GRID_STL)
            at += put_grid_facet(bytes + at, corner);
        else if (format == GRID_OFF)
            at += (size_t)sprintf(bytes + at, "3 %d %d %d\n", corner[0], corner[1], corner[2]);
        else
            at += (size_t)sprintf(bytes + at, "f %d %d %d\n", corner[0] + 1, corner[1] + 1,
                                  corner[2] + 1);
    }
    *size = at;
    return bytes;
}

START_TEST(cap_names_a_number_that_works) {
    size_t size;
    char *bytes = make_grid((grid_format)_i, &size);
    mn_mesh mesh;
    mn_read_desc desc = {.ram_bytes = 1 << 20};
    for (int round = 0; round < 2; round++) { /* 1 MB, and just below what works */
        mn_status st = {0};
        ck_assert_int_eq(read_bytes(bytes, size, &desc, &mesh, &st), MN_CAP_TOO_SMALL);
        ck_assert_ptr_null(mesh.corner);
        const char *number = strstr(st.text, "--ram ");
        ck_assert_ptr_nonnull(number);
        desc.ram_bytes = strtoull(number + 6, NULL, 10) << 20;
        if (round == 0 && _i != GRID_STL) /* a soup's need is known only after welding */
            desc.ram_bytes =
                (uint64_t)(strtod(strstr(st.text, "take ") + 5, NULL) * (1 << 20)) - (1 << 18);
        else if (round == 0)
            desc.ram_bytes = 2 << 20;
    }
    mn_status st = {0};
    ck_assert_msg(read_bytes(bytes, size, &desc, &mesh, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(mesh.vertices, GRID * GRID);
    ck_assert_uint_eq(mesh.triangles, GRID_TRIANGLES);
    mn_mesh_free(&mesh);
    free(bytes);
}
END_TEST

/* A soup's refusal does not count each corner as a vertex: it names hardly more than another's. */
START_TEST(cap_of_a_soup_is_tight) {
    unsigned long long take[GRID_FORMATS];
    for (int format = 0; format < GRID_FORMATS; format++) {
        size_t size;
        char *bytes = make_grid((grid_format)format, &size);
        mn_mesh mesh;
        mn_status st = {0};
        const mn_read_desc desc = {.ram_bytes = 1 << 20};
        ck_assert_int_eq(read_bytes(bytes, size, &desc, &mesh, &st), MN_CAP_TOO_SMALL);
        take[format] = strtoull(strstr(st.text, "take ") + 5, NULL, 10);
        free(bytes);
    }
    ck_assert_uint_le(take[GRID_STL], take[GRID_OFF] + take[GRID_OFF] / 10);
}
END_TEST

static uint64_t then_need(uint64_t vertices, uint64_t triangles) {
    ck_assert_uint_le(vertices, GRID * GRID + GRID * GRID / 10);
    return 1000 * vertices + triangles;
}

START_TEST(cap_counts_what_comes_then) {
    size_t size;
    char *bytes = make_grid((grid_format)_i, &size);
    mn_mesh mesh;
    mn_status st = {0};
    mn_read_desc desc = {.ram_bytes = 1000 * GRID * GRID, .then_need_bytes = then_need};
    ck_assert_int_eq(read_bytes(bytes, size, &desc, &mesh, &st), MN_CAP_TOO_SMALL);
    desc.ram_bytes = strtoull(strstr(st.text, "--ram ") + 6, NULL, 10) << 20;
    ck_assert_uint_ge(desc.ram_bytes, then_need(GRID * GRID, GRID_TRIANGLES));
    st = (mn_status){0};
    ck_assert_msg(read_bytes(bytes, size, &desc, &mesh, &st) == MN_OK, "%s", st.text);
    mn_mesh_free(&mesh);
    free(bytes);
}
END_TEST

/* ---- files ---------------------------------------------------------------------------------- */

static void expect_path_refused(const char *path, const char *phrase) {
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_int_eq(mn_mesh_read(path, NULL, &mesh, &st), MN_BAD_INPUT);
    ck_assert_msg(strstr(st.text, phrase) != NULL, "'%s' does not say '%s'", st.text, phrase);
    ck_assert_ptr_null(strchr(st.text, '\n'));
}

START_TEST(what_is_no_file) {
    char folder[] = "/tmp/metanode-test-XXXXXX", path[600];
    ck_assert_ptr_nonnull(mkdtemp(folder));
    expect_path_refused(folder, "is a directory");
    snprintf(path, sizeof path, "%s/fifo", folder);
    ck_assert_int_eq(mkfifo(path, 0600), 0);
    expect_path_refused(path, "is a pipe or a device"); /* and does not wait for a writer */
    unlink(path);
    expect_path_refused(path, "cannot be opened: No such file or directory");
    snprintf(path, sizeof path, "%s/%0400d\nb", folder, 1);
    expect_path_refused(path, "cannot be opened: File name too long");
    expect_path_refused("/dev/null", "is a pipe or a device");
    expect_path_refused("", "cannot be opened");
    rmdir(folder);
    expect_refusal("", 0, "is empty");
}
END_TEST

static bool stop(void *context, const char *phase, uint64_t done, uint64_t total) {
    (void)context, (void)phase;
    ck_assert_uint_le(done, total);
    return false;
}

START_TEST(interruption) {
    mn_mesh mesh;
    mn_status st = {0};
    const mn_read_desc desc = {.progress = stop};
    ck_assert_int_eq(read_bytes(TRIANGLE, strlen(TRIANGLE), &desc, &mesh, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "interrupted"));
}
END_TEST

/* Somebody writes to the file while it is read. */
static bool touch(void *context, const char *phase, uint64_t done, uint64_t total) {
    const struct timespec times[2] = {{.tv_nsec = UTIME_OMIT}, {.tv_sec = 7}};
    (void)phase, (void)done, (void)total;
    ck_assert_int_eq(utimensat(AT_FDCWD, context, times, 0), 0);
    return true;
}

START_TEST(changed_meanwhile) {
    char path[] = "/tmp/metanode-test-XXXXXX";
    const int fd = mkstemp(path);
    const mn_read_desc desc = {.progress = touch, .progress_context = path};
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_int_eq(write(fd, TRIANGLE, strlen(TRIANGLE)), (ssize_t)strlen(TRIANGLE));
    close(fd);
    ck_assert_int_eq(mn_mesh_read(path, &desc, &mesh, &st), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, path));
    ck_assert_ptr_nonnull(strstr(st.text, "changed while it was read"));
    ck_assert_ptr_null(mesh.corner);
    st = (mn_status){0};
    ck_assert_int_eq(mn_mesh_read(path, NULL, &mesh, &st), MN_OK);
    mn_mesh_free(&mesh);
    unlink(path);
}
END_TEST

/* What is written is read back: positions, colours, corners, and an origin that is not 0. */
START_TEST(written_and_read_again) {
    static const char *const texts[] = {
        TRIANGLE "v 1 1 0\nf 3 2 4\n",
        "v 0.1 0 0 1 0 0\nv 1 0.7 0 0 1 0\nv 0 1.3 0 0 0 1\nv 3 3 3.3 1 1 0\nf 1 2 3\nf 3 2 4\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        char folder[] = "/tmp/metanode-test-XXXXXX", path[100];
        ck_assert_ptr_nonnull(mkdtemp(folder));
        snprintf(path, sizeof path, "%s/a.ply", folder);
        mn_mesh mesh = read_text(texts[i], NULL), again;
        mn_status st = {0};
        ck_assert_msg(mn_mesh_write_ply(path, &mesh, &st) == MN_OK, "%s", st.text);
        ck_assert_msg(mn_mesh_write_ply(path, &mesh, &st) == MN_OK, "%s", st.text); /* over it */
        ck_assert_msg(mn_mesh_read(path, NULL, &again, &st) == MN_OK, "%s", st.text);
        ck_assert_uint_eq(again.vertices, mesh.vertices);
        ck_assert_mem_eq(again.origin, mesh.origin, sizeof mesh.origin);
        ck_assert_mem_eq(again.position, mesh.position, 12 * mesh.vertices);
        ck_assert_mem_eq(again.corner, mesh.corner, 12 * mesh.triangles);
        ck_assert_int_eq(again.color != NULL, mesh.color != NULL);
        if (mesh.color != NULL)
            ck_assert_mem_eq(again.color, mesh.color, 4 * mesh.vertices);
        mn_mesh_free(&again);
        unlink(path);
        ck_assert_int_eq(rmdir(folder), 0); /* nothing temporary stays */
        ck_assert_int_eq(mn_mesh_write_ply(path, &mesh, &st), MN_FAILED);
        st = (mn_status){0};
        ck_assert_int_eq(mn_mesh_write_ply("/dev/full", &mesh, &st), MN_FAILED);
        ck_assert_ptr_nonnull(strstr(st.text, "not a regular file"));
        mn_mesh_free(&mesh);
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("intake");
    TCase *rules = tcase_create("rules");
    tcase_add_test(rules, welding);
    tcase_add_test(rules, duplicates);
    tcase_add_test(rules, degenerate_and_zero_area);
    tcase_add_test(rules, nonfinite);
    tcase_add_test(rules, misoriented_faces);
    tcase_add_test(rules, unused_vertices);
    tcase_add_test(rules, origin);
    tcase_add_test(rules, merged_positions);
    suite_add_tcase(suite, rules);
    TCase *limits = tcase_create("limits");
    tcase_set_timeout(limits, 60);
    tcase_add_test(limits, random_meshes);
    tcase_add_test(limits, large_star);
    tcase_add_loop_test(limits, cap_names_a_number_that_works, 0, GRID_FORMATS);
    tcase_add_test(limits, cap_of_a_soup_is_tight);
    tcase_add_loop_test(limits, cap_counts_what_comes_then, 0, GRID_FORMATS);
    suite_add_tcase(suite, limits);
    TCase *files = tcase_create("files");
    tcase_add_test(files, what_is_no_file);
    tcase_add_test(files, interruption);
    tcase_add_test(files, changed_meanwhile);
    tcase_add_test(files, written_and_read_again);
    suite_add_tcase(suite, files);
    return suite_run(suite);
}
