/* Goal: made models are what --help says: so many triangles, manifold, oriented, the same bytes for
 * the same options. Method: models of several sizes, read back here, their directed edges sorted.
 */
#include <check.h>
#include <dirent.h>
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>
#include <xxhash.h>

#include "metanode/build.h"
#include "noise.h"
#include "suite.h"

static char folder[] = "/tmp/mn-make-XXXXXX";
static char path[64];

typedef struct model {
    uint64_t vertices, triangles, hash;
    float *position;
    uint32_t *corner;
} model;

static void make(mn_shape shape, uint64_t triangles, uint64_t seed) {
    mn_make_desc desc = {.shape = shape, .triangles = triangles, .seed = seed};
    mn_status st = {0};
    ck_assert_msg(mn_make(path, &desc, &st) == MN_OK, "%s", st.text);
}

static model load(void) {
    FILE *f = fopen(path, "rb");
    ck_assert_ptr_nonnull(f);
    model m = {0};
    char line[512];
    do {
        ck_assert_ptr_nonnull(fgets(line, sizeof line, f));
        unsigned long long n;
        if (sscanf(line, "element vertex %llu", &n) == 1)
            m.vertices = n;
        if (sscanf(line, "element face %llu", &n) == 1)
            m.triangles = n;
    } while (strcmp(line, "end_header\n") != 0);
    m.position = malloc(12 * m.vertices);
    m.corner = malloc(12 * m.triangles);
    XXH3_state_t *hash = XXH3_createState();
    XXH3_64bits_reset(hash);
    unsigned char record[15];
    for (uint64_t v = 0; v < m.vertices; v++) {
        ck_assert_uint_eq(fread(record, 15, 1, f), 1);
        memcpy(m.position + 3 * v, record, 12);
        XXH3_64bits_update(hash, record, 15);
    }
    for (uint64_t t = 0; t < m.triangles; t++) {
        ck_assert_uint_eq(fread(record, 13, 1, f), 1);
        ck_assert_uint_eq(record[0], 3);
        memcpy(m.corner + 3 * t, record + 1, 12);
        XXH3_64bits_update(hash, record, 13);
    }
    ck_assert_int_eq(fgetc(f), EOF);
    fclose(f);
    m.hash = XXH3_64bits_digest(hash);
    XXH3_freeState(hash);
    return m;
}

static void drop(model *m) {
    free(m->position);
    free(m->corner);
}

static int compare_u64(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

/* Each directed edge once: manifold edges, one orientation. Returns the edges without a partner. */
static uint64_t check_edges(const model *m, uint64_t *edges) {
    uint64_t n = 3 * m->triangles, *key = malloc(8 * n), alone = 0;
    for (uint64_t t = 0; t < m->triangles; t++)
        for (int i = 0; i < 3; i++) {
            uint64_t a = m->corner[3 * t + i], b = m->corner[3 * t + (i + 1) % 3];
            ck_assert(a != b && a < m->vertices);
            key[3 * t + i] = a << 32 | b;
        }
    qsort(key, n, 8, compare_u64);
    for (uint64_t i = 0; i < n; i++) {
        ck_assert_msg(i == 0 || key[i] != key[i - 1], "a directed edge twice");
        uint64_t back = key[i] << 32 | key[i] >> 32;
        alone += bsearch(&back, key, n, 8, compare_u64) == NULL;
    }
    free(key);
    *edges = (n + alone) / 2;
    return alone;
}

/* Triangles about a vertex form one fan: as many fans as vertices. */
static void check_fans(const model *m) {
    uint32_t *parent = malloc(12 * m->triangles), *count = calloc(m->vertices, 4);
    uint64_t n = 3 * m->triangles, *key = malloc(16 * n); /* (edge, corner slot) at both its ends */
    for (uint64_t i = 0; i < n; i++) {
        parent[i] = (uint32_t)i;
        count[m->corner[i]]++;
    }
    /* the triangle on the other side shares both ends: join the slots at each end */
    for (uint64_t i = 0; i < n; i++) {
        uint64_t next = i / 3 * 3 + (i + 1) % 3;
        uint64_t a = m->corner[i], b = m->corner[next];
        key[2 * i] = a < b ? a << 32 | b : b << 32 | a;
        key[2 * i + 1] = i;
    }
    qsort(key, n, 16, compare_u64);
    uint64_t fans = n;
    for (uint64_t i = 1; i < n; i++) {
        if (key[2 * i] != key[2 * i - 2])
            continue;
        for (int end = 0; end < 2; end++) {
            uint64_t slot[2];
            for (int k = 0; k < 2; k++) {
                uint64_t e = key[2 * (i - (uint64_t)k) + 1], next = e / 3 * 3 + (e + 1) % 3;
                uint32_t want = (uint32_t)(end ? key[2 * i] >> 32 : key[2 * i]);
                slot[k] = m->corner[e] == want ? e : next;
                while (parent[slot[k]] != slot[k])
                    slot[k] = parent[slot[k]] = parent[parent[slot[k]]];
            }
            fans -= slot[0] != slot[1];
            parent[slot[0]] = (uint32_t)slot[1];
        }
    }
    for (uint64_t v = 0; v < m->vertices; v++)
        ck_assert_msg(count[v] > 0, "vertex %llu is unused", (unsigned long long)v);
    ck_assert_uint_eq(fans, m->vertices);
    free(parent);
    free(count);
    free(key);
}

static int compare_point(const void *a, const void *b) {
    return memcmp(a, b, 12);
}

/* No two vertices at one place: a reader that welds changes nothing. */
static void check_positions(const model *m) {
    for (uint64_t i = 0; i < 3 * m->vertices; i++) {
        ck_assert(isfinite(m->position[i]));
        m->position[i] += 0.0f; /* -0 */
    }
    float *sorted = malloc(12 * m->vertices);
    memcpy(sorted, m->position, 12 * m->vertices);
    qsort(sorted, m->vertices, 12, compare_point);
    for (uint64_t v = 1; v < m->vertices; v++)
        ck_assert_int_ne(memcmp(sorted + 3 * v - 3, sorted + 3 * v, 12), 0);
    free(sorted);
}

static double volume(const model *m) {
    double sum = 0;
    for (uint64_t t = 0; t < m->triangles; t++) {
        const float *a = m->position + 3 * m->corner[3 * t];
        const float *b = m->position + 3 * m->corner[3 * t + 1];
        const float *c = m->position + 3 * m->corner[3 * t + 2];
        sum += a[0] * ((double)b[1] * c[2] - (double)b[2] * c[1]) +
               a[1] * ((double)b[2] * c[0] - (double)b[0] * c[2]) +
               a[2] * ((double)b[0] * c[1] - (double)b[1] * c[0]);
    }
    return sum / 6;
}

static const uint64_t sizes[] = {1, 2, 12, 50, 1000, 30000};

START_TEST(sphere_is_a_closed_sphere) {
    uint64_t asked = sizes[_i], edges;
    make(MN_SHAPE_SPHERE, asked, 7);
    model m = load();
    ck_assert(fabs((double)m.triangles - (double)asked) <= 4 * sqrt((double)asked) + 12);
    ck_assert_uint_eq(check_edges(&m, &edges), 0);
    ck_assert_int_eq((int64_t)(m.vertices + m.triangles) - (int64_t)edges, 2);
    check_fans(&m);
    check_positions(&m);
    ck_assert(asked < 12 || (volume(&m) > 0.5 && volume(&m) < 16));
    drop(&m);
}
END_TEST

START_TEST(terrain_is_a_sheet_that_faces_up) {
    uint64_t asked = sizes[_i], edges;
    make(MN_SHAPE_TERRAIN, asked, 7);
    model m = load();
    ck_assert(fabs((double)m.triangles - (double)asked) <= sqrt((double)asked) + 1);
    ck_assert_uint_gt(check_edges(&m, &edges), 0);
    ck_assert_int_eq((int64_t)(m.vertices + m.triangles) - (int64_t)edges, 1);
    check_fans(&m);
    check_positions(&m);
    for (uint64_t t = 0; t < m.triangles; t++) {
        const float *a = m.position + 3 * m.corner[3 * t];
        const float *b = m.position + 3 * m.corner[3 * t + 1];
        const float *c = m.position + 3 * m.corner[3 * t + 2];
        double up = (double)(b[2] - a[2]) * (c[0] - a[0]) - (double)(b[0] - a[0]) * (c[2] - a[2]);
        ck_assert(up > 0);
    }
    drop(&m);
}
END_TEST

/* Closed, manifold and oriented at every size, whatever the noise does; genus far above 0. */
START_TEST(isosurface_is_closed) {
    static const uint64_t asked[] = {1, 3000, 12000, 60000};
    uint64_t edges;
    make(MN_SHAPE_ISOSURFACE, asked[_i], 11);
    model m = load();
    if (asked[_i] >= 10000)
        ck_assert(fabs((double)m.triangles / (double)asked[_i] - 1) < 0.05);
    else
        ck_assert(m.triangles < 5000);
    ck_assert_uint_eq(check_edges(&m, &edges), 0);
    int64_t euler = (int64_t)(m.vertices + m.triangles) - (int64_t)edges;
    ck_assert(euler % 2 == 0 && euler < -12);
    check_fans(&m);
    check_positions(&m);
    ck_assert(volume(&m) > 1 && volume(&m) < 4.2);
    drop(&m);
}
END_TEST

/* The bytes themselves: a compiler or machine that rounds otherwise shows here. */
START_TEST(same_options_same_bytes) {
    static const uint64_t golden[] = {0xbf20b5ff2145ca00, 0xc6edba1beb040fa9, 0xe567685c5eb0a6dc};
    mn_shape shape = (mn_shape)_i;
    make(shape, 5000, 1);
    model a = load();
    make(shape, 5000, 1);
    model b = load();
    make(shape, 5000, 2);
    model c = load();
    ck_assert_uint_eq(a.hash, b.hash);
    ck_assert_uint_ne(a.hash, c.hash);
    ck_assert_msg(a.hash == golden[_i], "shape %d is 0x%016llx now", _i,
                  (unsigned long long)a.hash);
    drop(&a);
    drop(&b);
    drop(&c);
}
END_TEST

/* Detail down to the grid: the second differences of neighbours do not vanish, as they would on a
 * smooth surface, when the grid is refined. */
START_TEST(terrain_is_rough_at_every_scale) {
    double rough[3];
    for (int i = 0; i < 3; i++) {
        uint64_t side = UINT64_C(64) << i;
        make(MN_SHAPE_TERRAIN, 2 * side * side, 3);
        model m = load();
        double sum = 0, step = 20.0 / (double)side;
        for (uint64_t r = 0; r <= side; r++)
            for (uint64_t c = 1; c < side; c++) {
                const float *p = m.position + 3 * (r * (side + 1) + c);
                sum += fabs(p[-2] - 2.0 * p[1] + p[4]) / step;
            }
        rough[i] = sum / (double)(side * side);
        drop(&m);
    }
    ck_assert_msg(rough[1] > 0.6 * rough[0] && rough[2] > 0.6 * rough[1], "%g %g %g", rough[0],
                  rough[1], rough[2]);
}
END_TEST

/* What the readers make of a model: nothing to weld, reject or notice. */
START_TEST(readers_have_nothing_to_say) {
    make((mn_shape)_i, 20000, 5);
    mn_mesh mesh;
    mn_status st = {0};
    ck_assert_msg(mn_mesh_read(path, &(mn_read_desc){0}, &mesh, &st) == MN_OK, "%s", st.text);
    const mn_intake none = {.input_faces = mesh.triangles};
    ck_assert_mem_eq(&mesh.intake, &none, sizeof none);
    ck_assert_ptr_nonnull(mesh.color);
    mn_mesh_free(&mesh);
}
END_TEST

static bool stop_halfway(void *context, const char *phase, uint64_t done, uint64_t total) {
    (void)phase;
    ck_assert_uint_le(done, total);
    return ++*(int *)context < 20;
}

static int files_in_folder(void) {
    DIR *d = opendir(folder);
    int count = 0;
    for (struct dirent *e; (e = readdir(d)) != NULL;)
        count += e->d_name[0] != '.' || strlen(e->d_name) > 2;
    closedir(d);
    return count;
}

START_TEST(failures_leave_nothing_behind) {
    unlink(path);
    int calls = 0;
    mn_make_desc desc = {.shape = (mn_shape)_i,
                         .triangles = 100000,
                         .progress = stop_halfway,
                         .progress_context = &calls};
    mn_status st = {0};
    ck_assert_int_eq(mn_make(path, &desc, &st), MN_FAILED);
    ck_assert_str_eq(st.text, "interrupted");
    ck_assert_int_eq(files_in_folder(), 0);

    /* a file that may not grow stands for a disk that is full */
    struct rlimit old, small = {.rlim_cur = 400000, .rlim_max = RLIM_INFINITY};
    getrlimit(RLIMIT_FSIZE, &old);
    small.rlim_max = old.rlim_max;
    signal(SIGXFSZ, SIG_IGN);
    setrlimit(RLIMIT_FSIZE, &small);
    desc.progress = NULL;
    st = (mn_status){0};
    mn_code code = mn_make(path, &desc, &st);
    setrlimit(RLIMIT_FSIZE, &old);
    ck_assert_int_eq(code, MN_NO_SPACE);
    ck_assert_ptr_nonnull(strstr(st.text, path));
    ck_assert_int_eq(files_in_folder(), 0);

    desc.triangles = UINT64_MAX;
    st = (mn_status){0};
    ck_assert_int_eq(mn_make(path, &desc, &st), MN_USAGE);
    st = (mn_status){0};
    desc.triangles = 100;
    ck_assert_int_eq(mn_make("/nowhere/at/all.ply", &desc, &st), MN_FAILED);
}
END_TEST

/* The slope that mni_noise2 hands back is the slope of what it returns, across lattice lines too.
 */
START_TEST(noise_slopes_are_slopes) {
    double none[2], slope[2], h = 1e-6, low = 0, high = 0;
    for (int i = 0; i < 2000; i++) {
        double x = 40 * mni_noise_unit(1, 2 * (uint64_t)i) - 20;
        double y = 40 * mni_noise_unit(1, 2 * (uint64_t)i + 1) - 20;
        double v = mni_noise2(5, x, y, slope);
        double dx = (mni_noise2(5, x + h, y, none) - mni_noise2(5, x - h, y, none)) / (2 * h);
        double dy = (mni_noise2(5, x, y + h, none) - mni_noise2(5, x, y - h, none)) / (2 * h);
        ck_assert(fabs(dx - slope[0]) < 1e-5 && fabs(dy - slope[1]) < 1e-5);
        double w = mni_noise3(5, x, y, 0.5 * x - y);
        ck_assert(fabs(v) <= 1 && fabs(w) <= 1);
        low = fmin(low, fmin(v, w));
        high = fmax(high, fmax(v, w));
    }
    ck_assert(low < -0.4 && high > 0.4);
    ck_assert_int_eq(mni_noise_floor(-0.5), -1);
    ck_assert_int_eq(mni_noise_floor(-2), -2);
    ck_assert_int_eq(mni_noise_floor(2.9), 2);
}
END_TEST

int main(void) {
    if (mkdtemp(folder) == NULL)
        return 1;
    snprintf(path, sizeof path, "%s/model.ply", folder);
    Suite *suite = suite_create("make");
    TCase *tc = tcase_create("make");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, noise_slopes_are_slopes);
    tcase_add_loop_test(tc, sphere_is_a_closed_sphere, 0, 6);
    tcase_add_loop_test(tc, terrain_is_a_sheet_that_faces_up, 0, 6);
    tcase_add_loop_test(tc, isosurface_is_closed, 0, 4);
    tcase_add_loop_test(tc, same_options_same_bytes, 0, 3);
    tcase_add_loop_test(tc, readers_have_nothing_to_say, 0, 3);
    tcase_add_test(tc, terrain_is_rough_at_every_scale);
    tcase_add_loop_test(tc, failures_leave_nothing_behind, 0, 3);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    unlink(path);
    rmdir(folder);
    return failed;
}
