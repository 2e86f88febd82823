/* Goal: reading a mesh through the disk keeps, rejects and counts what reading it in memory does,
 * in any budget, and leaves it in spatial order. Method: both readers on small texts for each rule,
 * on seeded random meshes, on real ones; what came out on disk is renumbered by the input's numbers
 * and must be the other mesh, bit for bit. A full disk, and a disk that fills at the Nth byte. */
#include "read_help.h"

#include <dirent.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>
#include <xxhash.h>

#include "disk_help.h"
#include "unit.h"

static char folder[] = "/tmp/mn-extmesh-XXXXXX";
static char path[64];
static uint64_t seed;

static const mn_read_desc apart = {.weld = MN_WELD_OFF};

static uint64_t random_u64(uint64_t *state) {
    uint64_t x = *state += UINT64_C(0x9e3779b97f4a7c15);
    x = (x ^ x >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ x >> 27) * UINT64_C(0x94d049bb133111eb);
    return x ^ x >> 31;
}

static void write_file(const void *bytes, size_t size) {
    FILE *f = fopen(path, "wb");
    ck_assert_uint_eq(fwrite(bytes, 1, size, f), size);
    fclose(f);
}

/* ---- both readers ------------------------------------------------------------------------------
 */

/* A triangle as it looks: places and colours of its corners, which tell it from all others where
 * vertices are welded. */
enum { LOOK_WORDS = 12 };
typedef struct look {
    uint32_t word[LOOK_WORDS];
} look;

static int by_words(const void *a, const void *b) {
    return memcmp(a, b, sizeof(look));
}

/* Turned so that it is the same whichever corner came first. */
static look look_of(uint32_t corner[3][4]) {
    look best, other;
    for (uint32_t turn = 0; turn < 3; turn++) {
        for (uint32_t c = 0; c < 3; c++)
            memcpy(other.word + 4 * c, corner[(turn + c) % 3], 16);
        if (turn == 0 || by_words(&other, &best) < 0)
            best = other;
    }
    return best;
}

static void take_corner(uint32_t to[4], const float position[3], uint32_t rgba) {
    memcpy(to, position, 12);
    to[3] = rgba;
}

static int by_place(const void *a, const void *b) {
    return memcmp(a, b, sizeof(mni_extvertex));
}

static void compare_vertices(const mn_mesh *mesh, const mni_extvertex *vertex, int unit) {
    const uint64_t bytes = mesh->vertices * sizeof *vertex;
    mni_extvertex *there = malloc(bytes), *here = malloc(bytes);
    memcpy(there, vertex, bytes);
    for (uint32_t i = 0; i < mesh->vertices; i++) {
        here[i].rgba = mesh->color != NULL ? mesh->color[i] : UINT32_MAX;
        for (int c = 0; c < 3; c++)
            here[i].position[c] = mni_unit_length(mesh->position[3 * (uint64_t)i + c], -unit);
    }
    qsort(there, mesh->vertices, sizeof *there, by_place);
    qsort(here, mesh->vertices, sizeof *here, by_place);
    ck_assert(memcmp(there, here, bytes) == 0);
    free(there);
    free(here);
}

static void compare_triangles(const mn_mesh *mesh, const mni_extvertex *vertex,
                              const mni_exttriangle *triangle, int unit) {
    look *there = malloc(mesh->triangles * sizeof *there),
         *here = malloc(mesh->triangles * sizeof *here);
    for (uint64_t t = 0; t < mesh->triangles; t++) {
        uint32_t corner[3][4];
        for (uint32_t c = 0; c < 3; c++) {
            const mni_extvertex *v = &vertex[triangle[t].corner[c]];
            take_corner(corner[c], v->position, v->rgba);
        }
        there[t] = look_of(corner);
        for (uint32_t c = 0; c < 3; c++) {
            const uint32_t v = mesh->corner[3 * t + c];
            const float *p = mesh->position + 3 * (uint64_t)v;
            take_corner(corner[c],
                        (float[3]){mni_unit_length(p[0], -unit), mni_unit_length(p[1], -unit),
                                   mni_unit_length(p[2], -unit)},
                        mesh->color != NULL ? mesh->color[v] : UINT32_MAX);
        }
        here[t] = look_of(corner);
    }
    qsort(there, mesh->triangles, sizeof *there, by_words);
    qsort(here, mesh->triangles, sizeof *here, by_words);
    ck_assert(memcmp(there, here, mesh->triangles * sizeof *there) == 0);
    free(there);
    free(here);
}

static int by_value(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

/* Edges with one triangle, and those with others than two that run against each other. */
static void compare_edges(const mn_mesh *mesh, const mni_extmesh *x) {
    uint64_t n = 3 * (uint64_t)mesh->triangles, *edge = malloc(8 * n), boundary = 0,
             nonmanifold = 0;
    for (uint64_t i = 0; i < n; i++) {
        uint64_t a = mesh->corner[i], b = mesh->corner[i / 3 * 3 + (i + 1) % 3];
        edge[i] = a < b ? a << 32 | b << 1 : b << 32 | a << 1 | 1;
    }
    qsort(edge, n, 8, by_value);
    for (uint64_t i = 0, uses, back; i < n; i += uses) {
        for (uses = back = 0; i + uses < n && edge[i + uses] >> 1 == edge[i] >> 1; uses++)
            back += edge[i + uses] & 1;
        boundary += uses == 1;
        nonmanifold += uses > 2 || (uses == 2 && back != 1);
    }
    free(edge);
    ck_assert_uint_eq(x->boundary_edges, boundary);
    ck_assert_uint_eq(x->nonmanifold_edges, nonmanifold);
}

static void compare(const mn_mesh *mesh, mni_extmesh *x) {
    compare_edges(mesh, x);
    ck_assert_mem_eq(&x->intake, &mesh->intake, sizeof mesh->intake);
    ck_assert_mem_eq(x->origin, mesh->origin, sizeof mesh->origin);
    ck_assert_uint_eq(x->vertices, mesh->vertices);
    ck_assert_uint_eq(x->triangles, mesh->triangles);
    ck_assert_int_eq(x->has_colors, mesh->color != NULL);
    ck_assert(x->grid_step == mesh->grid_step);
    ck_assert_uint_eq(x->vertex.size_bytes, x->vertices * sizeof(mni_extvertex));
    mni_extvertex *v = load_spill(&x->vertex);
    mni_exttriangle *t = load_triangles(x);
    for (uint64_t i = 1; i < x->triangles; i++) /* along the vertices' order */
        ck_assert_uint_ge(t[i].corner[0], t[i - 1].corner[0]);
    uint64_t crossings = 0;
    for (uint64_t i = 0; i < 3 * x->triangles;
         i++) { /* corners in thousands that no earlier is in */
        const uint32_t *c = t[i / 3].corner;
        crossings += i % 3 > 0 && c[i % 3] / 1024 != c[0] / 1024 &&
                     (i % 3 == 1 || c[2] / 1024 != c[1] / 1024);
    }
    ck_assert_uint_eq(x->crossings, crossings);
    compare_vertices(mesh, v, x->unit);
    compare_triangles(mesh, v, t, x->unit);
    free(v);
    free(t);
}

static mn_code read_external(const char *file, const mn_read_desc *read, uint32_t bits,
                             uint64_t work, mni_extmesh *x, mn_status *st) {
    static uint32_t turn;
    const mni_extmesh_desc desc = {
        .position_bits = bits, .work_bytes = work, .temp_dir = folder, .threads = 1 + turn++ % 2};
    *st = (mn_status){0};
    return mni_extmesh_read(file, read, &desc, x, st);
}

/* Both readers, all budgets: the same mesh on that grid (0: on none), or the same words. */
static void check_bits(const char *file, const mn_read_desc *read, uint32_t bits) {
    static const uint64_t works[] = {MNI_EXTMESH_WORK_MIN, 1 << 20, 64 << 20};
    mn_mesh mesh;
    mn_status st = {0}, own;
    mn_code code = mn_mesh_read(file, read, &mesh, &st);
    if (code == MN_OK && bits > 0)
        code = mn_mesh_quantise(&mesh, bits, &st);
    for (int i = 0; i < 3; i++) {
        mni_extmesh x;
        mn_code external = read_external(file, read, bits, works[i], &x, &own);
        ck_assert_msg(external == code, "%d instead of %d: %s", external, code, own.text);
        if (code == MN_OK)
            compare(&mesh, &x);
        else
            ck_assert_str_eq(own.text, st.text);
        mni_extmesh_close(&x);
        mni_extmesh_close(&x);
    }
    mn_mesh_free(&mesh);
}

static void check_file(const char *file, const mn_read_desc *read) {
    check_bits(file, read, 0);
    check_bits(file, read, 16);
}

static void check_text(const char *text) {
    write_file(text, strlen(text));
    static const uint32_t bits[] = {0, MN_POSITION_BITS_MIN, 16, 21, MN_POSITION_BITS_MAX};
    for (int i = 0; i < 5; i++) {
        check_bits(path, NULL, bits[i]);
        check_bits(path, &apart, bits[i]);
    }
}

/* ---- rules ---------------------------------------------------------------------------------- */

#define TRIANGLE "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"

START_TEST(every_rule) {
    static const char *const texts[] = {
        TRIANGLE,
        /* welded, -0, unused */
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv -0 0 -0.0\nv 1e0 0 0\nv 0 0 1\nv 7 7 7\nf 1 2 3\nf 4 5 6\n",
        /* duplicates in any order, and by welding */
        TRIANGLE "f 2 3 1\nf 3 2 1\nv 0 0 0\nf 4 2 3\nv 0 0 1\nf 1 2 5\n",
        /* degenerate, without area, too few corners */
        TRIANGLE "f 1 1 2\nf 1 2 2\nf 2 1 2\nv 1 0 0\nf 4 2 1\nv 2 0 0\nf 2 1 5\nf 1 2\nf 3\n",
        /* not finite */
        TRIANGLE "v nan 0 0\nv 0 inf 0\nv 0 0 -1e400\nv 0 1e39 0\nv NaN 0 0\n"
                 "f 1 2 4\nf 1 2 5\nf 1 2 6\nf 1 2 7\nf 4 4 8\nf 4 5 6\n",
        /* misoriented: once, twice at one edge, and one that is wrong at two */
        TRIANGLE "v 1 1 0\nv 0 0 1\nf 2 3 4\nf 3 2 5\nf 2 3 5\nv 0 0 2\nf 1 2 6\nf 2 3 6\n",
        /* nothing is left; nothing was there */
        "v 0 0 0\nv 1 0 0\nf 1 2 2\nv nan 0 0\nf 1 2 3\n", "v 0 0 0\nv 1 0 0\nv 1 1 0\n",
        /* doubles: an origin, and positions that fall together as floats */
        "v 1000000.1 2000000.2 3\nv 1000000.2 2000000.2 3\nv 1000000.1 2000000.9 3\n"
        "v 1000000.1000000001 2000000.2 3\nv 1000000.2 2000000.2 3\nv 5 5 0.1\nf 1 2 3\nf 4 3 5\n",
        /* from floats to doubles on the way; a double that no face uses */
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.1 1 0\nf 1 2 3\nf 2 3 4\n",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.1 1 0\nf 1 2 3\n",
        /* colours, of the first */
        "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nv 0 0 0 1 1 1\nv 0 0 1\nf 4 2 3\nf 1 2 5\n",
        /* all in one place but one */
        "v 0 0 0\nv 0 0 1e-30\nv 0 1e-30 0\nv 1e30 0 0\nf 1 2 3\nf 3 2 4\n",
        /* 2^21 steps along a side, from a place between two: the last one's number is past what
         * it has bits for, and neighbours at that end are two places still */
        "v 0.4 0.4 0\nv 3 2097151 0\nv 4 2097151 0\nv 7 7 7\nf 1 2 3\nf 1 2 4\n",
        /* some that fall together on coarse grids, some on none */
        "v 0 0 0\nv 1 1 1\nv 0.001 0 0\nv 0.002 0 0\nv 1 1 1\nv -0.001 0 0\nf 1 2 3\nf 4 5 6\n"
        "f 1 2 6\n",
        /* a face of a vertex that is not there: said by the reader */
        TRIANGLE "f 1 2 9\n", "v 1 2\n", ""};
    check_text(texts[_i]);
}
END_TEST

START_TEST(there_is_no_file) {
    mni_extmesh x;
    mn_status st;
    check_file("/nowhere/at/all.ply", NULL);
    ck_assert_int_eq(read_external(folder, NULL, 0, 1 << 20, &x, &st), MN_BAD_INPUT);
}
END_TEST

/* Denormal switch values and infinite radii are no tree: they would be found when it is done. */
START_TEST(sizes_that_floats_do_not_hold) {
    static const struct {
        const char *text;
        mn_code code;
    } sizes[] = {{"v 0 0 0\nv 2e-25 0 0\nv 0 2e-25 0\nf 1 2 3\n", MN_OK},
                 {"v 0 0 0\nv 2e-26 0 0\nv 0 2e-26 0\nf 1 2 3\n", MN_BAD_INPUT},
                 {"v 0 0 0\nv -1e30 0 0\nv 0 1 0\nf 1 2 3\n", MN_OK},
                 {"v 0 0 0\nv -1e31 0 0\nv 0 1 0\nf 1 2 3\n", MN_BAD_INPUT}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        mni_extmesh x;
        mn_status st;
        write_file(sizes[i].text, strlen(sizes[i].text));
        ck_assert_int_eq(read_external(path, NULL, 16, 1 << 20, &x, &st), sizes[i].code);
        ck_assert(sizes[i].code == MN_OK || strstr(st.text, "another unit of length") != NULL);
        mni_extmesh_close(&x);
    }
}
END_TEST

/* ---- random meshes ----------------------------------------------------------------------------
 */

/* Triangles among few or many places, with everything wrong that there can be. mixed: some come
 * before vertices. */
static void random_obj(uint64_t *state, bool doubles, bool mixed) {
    uint64_t vertices = 3 + random_u64(state) % 60000, faces = 1 + random_u64(state) % 20000;
    uint64_t grid = 2 + random_u64(state) % 40, near = 1 + random_u64(state) % vertices;
    FILE *f = fopen(path, "wb");
    for (uint64_t v = 0; v < vertices; v++) {
        uint64_t r = random_u64(state);
        if (r % 400 == 0)
            fprintf(f, "v nan 0 1\n");
        else
            fprintf(f, "v %.17g %.17g %.17g\n", (double)(r >> 8 & 255) / (double)grid,
                    doubles ? 1e6 + (double)(r >> 16 & 15) * 0.1 : (double)(r >> 16 & 15),
                    (double)(r >> 24) / (double)(1 << 20));
        if (mixed && v >= vertices / 2 && r % 1000 == 7)
            fprintf(f, "f 1 2 3\n");
    }
    for (uint64_t t = 0; t < faces; t++) {
        uint64_t at = random_u64(state) % vertices, c[3];
        for (int i = 0; i < 3; i++)
            c[i] = 1 + (at + random_u64(state) % near) % vertices;
        fprintf(f, "f %llu %llu %llu\n", (unsigned long long)c[0], (unsigned long long)c[1],
                (unsigned long long)c[2]);
        if (random_u64(state) % 9 == 0) /* again, turned or not */
            fprintf(f, "f %llu %llu %llu\n", (unsigned long long)c[1],
                    (unsigned long long)c[at % 2 ? 2 : 0], (unsigned long long)c[at % 2 ? 0 : 2]);
    }
    fclose(f);
}

START_TEST(random_meshes) {
    uint64_t state = seed + (uint64_t)_i;
    random_obj(&state, _i % 2, _i % 3 == 1);
    check_file(path, NULL);
    if (_i < 4)
        check_file(path, &apart);
}
END_TEST

/* A soup of facets on a grid, as binary STL: nearly all corners are welded. */
START_TEST(soups) {
    enum { FACETS = 30000, BYTES = 84 + 50 * FACETS };
    uint64_t state = seed;
    unsigned char *stl = calloc(1, BYTES);
    const uint32_t facets = FACETS;
    memcpy(stl + 80, &facets, 4);
    for (uint32_t t = 0; t < FACETS; t++) {
        float corner[9], x = (float)(random_u64(&state) % 70), y = (float)(random_u64(&state) % 70);
        for (int i = 0; i < 9; i++)
            corner[i] = i % 3 == 2 ? 0 : (i % 3 ? y : x) + (float)(random_u64(&state) % 2);
        if (random_u64(&state) % 500 == 0)
            corner[4] = NAN;
        memcpy(stl + 84 + 50 * t + 12, corner, sizeof corner);
    }
    write_file(stl, BYTES);
    free(stl);
    check_file(path, NULL);
    check_file(path, &apart); /* welded all the same */
}
END_TEST

/* ---- real and made ones ------------------------------------------------------------------------
 */

START_TEST(real_meshes) {
    static const char *const names[] = {"teapot.obj", "fandisk.obj", "bunny.obj", "beetle-alt.obj",
                                        "armadillo.obj"};
    const char *name = real_mesh(names[_i]);
    if (name != NULL)
        check_bits(name, NULL, 16);
}
END_TEST

/* Closed and manifold: no edge is anything else, and neighbours are near each other. */
START_TEST(made_models) {
    const mn_make_desc make = {.shape = (mn_shape)_i,
                               .triangles =
                                   80000}; /* the smallest budget holds the map of a few parts */
    mn_status st = {0};
    mni_extmesh x;
    ck_assert_int_eq(mn_make(path, &make, &st), MN_OK);
    check_bits(path, NULL, 16);
    ck_assert_int_eq(read_external(path, NULL, 16, 1 << 20, &x, &st), MN_OK);
    ck_assert_uint_eq(x.nonmanifold_edges, 0);
    ck_assert_int_eq(x.boundary_edges > 0, _i == MN_SHAPE_TERRAIN);
    mni_exttriangle *t = load_triangles(&x);
    uint64_t far = 0;
    for (uint64_t i = 0; i < x.triangles; i++)
        for (int c = 0; c < 3; c++) {
            int64_t step = (int64_t)t[i].corner[c] - (int64_t)t[i].corner[(c + 1) % 3];
            far += step > (int64_t)x.vertices / 20 || -step > (int64_t)x.vertices / 20;
        }
    ck_assert_uint_lt(far, 3 * x.triangles / 10);
    free(t);
    mni_extmesh_close(&x);
}
END_TEST

/* What is kept has the sum of its bytes, and is the mesh's alone when the intake has gone. */
START_TEST(kept_files_are_the_meshs) {
    const mni_extmesh_desc desc = {.work_bytes = 1 << 20, .temp_dir = folder, .keep = true};
    const mn_make_desc make = {.shape = MN_SHAPE_SPHERE, .triangles = 5000};
    mn_status st = {0};
    mni_extmesh x;
    ck_assert_int_eq(mn_make(path, &make, &st), MN_OK);
    ck_assert_msg(mni_extmesh_read(path, NULL, &desc, &x, &st) == MN_OK, "%s", st.text);
    for (int i = 0; i < 2; i++) {
        mni_spill *kept = i == 0 ? &x.vertex : &x.triangle;
        void *bytes = load_spill(kept);
        ck_assert_uint_eq(mni_spill_sum(kept), XXH3_64bits(bytes, kept->size_bytes));
        free(bytes);
    }
    mni_extmesh_close(&x);
}
END_TEST

/* ---- failures ------------------------------------------------------------------------------ */

static int entries(void) {
    int count = 0;
    DIR *d = opendir(folder);
    while (readdir(d) != NULL)
        count++;
    closedir(d);
    return count - 2;
}

/* Files that may not grow past so much stand for a disk that is full: at every step once. */
START_TEST(full_disks) {
    const mn_make_desc make = {.shape = MN_SHAPE_SPHERE, .triangles = 30000};
    mn_status st = {0};
    mni_extmesh x;
    struct rlimit old, small;
    uint64_t failed = 0;
    ck_assert_int_eq(mn_make(path, &make, &st), MN_OK);
    getrlimit(RLIMIT_FSIZE, &old);
    signal(SIGXFSZ, SIG_IGN);
    for (rlim_t limit = 1000;; limit += limit / 4, failed++) {
        small = (struct rlimit){.rlim_cur = limit, .rlim_max = old.rlim_max};
        setrlimit(RLIMIT_FSIZE, &small);
        mn_code code = read_external(path, NULL, 16, MNI_EXTMESH_WORK_MIN, &x, &st);
        setrlimit(RLIMIT_FSIZE, &old);
        if (code == MN_OK)
            break;
        ck_assert_int_eq(code, MN_NO_SPACE);
        ck_assert_ptr_nonnull(strstr(st.text, folder));
        ck_assert_int_eq(x.vertex.fd, -1);
        mni_extmesh_close(&x);
    }
    mni_extmesh_close(&x);
    ck_assert_uint_gt(failed, 10);
    ck_assert_int_eq(entries(), 1); /* the model */
}
END_TEST

/* Asks for an end at the n-th time that it is told how far the work is. */
typedef struct impatience {
    int left;
    char phases[64]; /* the first letter of each that told */
} impatience;

static bool ask(void *context, const char *phase, uint64_t done, uint64_t total) {
    impatience *i = context;
    const size_t length = strlen(i->phases);
    ck_assert_uint_le(done, total);
    if (length == 0 || i->phases[length - 1] != phase[0])
        i->phases[length] = phase[0];
    return i->left-- > 0;
}

START_TEST(interrupted) {
    const mn_make_desc make = {.shape = MN_SHAPE_SPHERE, .triangles = 140000};
    mn_status st = {0};
    mn_code code = MN_FAILED;
    int times = 0;
    ck_assert_int_eq(mn_make(path, &make, &st), MN_OK);
    for (; code != MN_OK; times += 1 + 4 * _i) {
        impatience i = {.left = times};
        const mni_extmesh_desc desc = {.position_bits = 16,
                                       .work_bytes = 1 << 20,
                                       .temp_dir = folder,
                                       .watch = {ask, &i},
                                       .threads = 1 + (uint32_t)_i};
        mni_extmesh x;
        st = (mn_status){0};
        code = mni_extmesh_read(path, NULL, &desc, &x, &st);
        if (code != MN_OK) {
            ck_assert_int_eq(code, MN_FAILED);
            ck_assert_str_eq(st.text, "interrupted");
        } else {
            ck_assert_str_eq(i.phases, _i == 0 ? "ncg" : "nc"); /* each tells, in its turn */
        }
        mni_extmesh_close(&x);
    }
    ck_assert_int_gt(times, 8);
}
END_TEST

START_TEST(no_folder) {
    const mni_extmesh_desc desc = {.work_bytes = 1 << 20, .temp_dir = "/nowhere/at/all"};
    mn_status st = {0};
    mni_extmesh x;
    write_file(TRIANGLE, sizeof TRIANGLE - 1);
    ck_assert_int_eq(mni_extmesh_read(path, NULL, &desc, &x, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "/nowhere/at/all"));
}
END_TEST

/* More vertices than bits for them, or than can be numbered: the number that is named is enough. */
START_TEST(too_little_memory) {
    const uint64_t vertices = _i == 0 ? 300000 : 6 * MNI_EXTMESH_WORK_MIN + 300000;
    mni_extmesh_desc desc = {
        .work_bytes = MNI_EXTMESH_WORK_MIN, .cap.beside_bytes = 3 << 20, .temp_dir = folder};
    mn_status st = {0};
    mni_extmesh x;
    FILE *f = fopen(path, "wb");
    ck_assert_ptr_nonnull(f);
    fprintf(f,
            "ply\nformat binary_little_endian 1.0\nelement vertex %llu\nproperty float x\n"
            "property float y\nproperty float z\nelement face 1\n"
            "property list uchar int vertex_indices\nend_header\n",
            (unsigned long long)vertices);
    for (uint64_t v = 0; v < vertices; v++) {
        const float at[3] = {(float)v, (float)(v % 7), 0};
        fwrite(at, sizeof at, 1, f);
    }
    const uint32_t face[3] = {0, 1, 9};
    fputc(3, f);
    fwrite(face, sizeof face, 1, f);
    fclose(f);
    ck_assert_int_eq(mni_extmesh_read(path, NULL, &desc, &x, &st), MN_CAP_TOO_SMALL);
    const char *named = strstr(st.text, "--ram ");
    ck_assert_msg(named != NULL, "%s", st.text);
    desc.work_bytes = (strtoull(named + 6, NULL, 10) << 20) - desc.cap.beside_bytes;
    ck_assert_uint_lt(desc.work_bytes, 2 * vertices + (1 << 20));
    st.code = MN_OK;
    ck_assert_msg(mni_extmesh_read(path, NULL, &desc, &x, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(x.vertices, 3);
    mni_extmesh_close(&x);
}
END_TEST

int main(void) {
    const char *given = getenv("MN_SEED");
    seed = given != NULL ? strtoull(given, NULL, 10) : (uint64_t)getpid();
    printf("MN_SEED=%llu\n", (unsigned long long)seed);
    if (mkdtemp(folder) == NULL)
        return 1;
    snprintf(path, sizeof path, "%s/mesh", folder);
    Suite *suite = suite_create("extmesh");
    TCase *tc = tcase_create("extmesh");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, every_rule, 0, 18);
    tcase_add_test(tc, there_is_no_file);
    tcase_add_test(tc, sizes_that_floats_do_not_hold);
    tcase_add_loop_test(tc, random_meshes, 0, 8);
    tcase_add_test(tc, soups);
    tcase_add_loop_test(tc, real_meshes, 0, 5);
    tcase_add_loop_test(tc, made_models, 0, 3);
    tcase_add_test(tc, kept_files_are_the_meshs);
    tcase_add_test(tc, full_disks);
    tcase_add_loop_test(tc, interrupted, 0, 2);
    tcase_add_test(tc, no_folder);
    tcase_add_loop_test(tc, too_little_memory, 0, 2);
    suite_add_tcase(suite, tc);
    const int failed = suite_run(suite);
    unlink(path);
    rmdir(folder);
    return failed;
}
