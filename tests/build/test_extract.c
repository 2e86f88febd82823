/* Goal: extract gives exactly the fronts that design.md §1 and §2 define.
 * Method: prefix fronts counted from the definition; settled fronts against a slow closure that
 * splits in an order drawn by lot and finds neighbours by looking at every simplex; files that were
 * extracted without the tree against those of the tree in memory; caps at their edge, files that
 * are damaged meanwhile, full disks and interrupts at calls that could tell of one. */
#include <check.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "disk_help.h"
#include "suite.h"
#include "tree.h"
#include "tree_fixture.h"

/* ---- the slow closure ------------------------------------------------------------------------ */

typedef struct slow {
    const mn_tree *t;
    uint32_t *owner; /* leaf: active node */
} slow;

static bool joined(const slow *w, uint32_t s, uint32_t node, uint32_t *highest) {
    const uint32_t *c = w->t->corner + 3 * (size_t)s;
    uint32_t n[3], seats = c[2] == MN_NONE ? 2 : 3;
    bool at = false;
    for (uint32_t k = 0; k < seats; k++)
        n[k] = w->owner[c[k]];
    for (uint32_t k = 0; k < seats; k++)
        for (uint32_t l = k + 1; l < seats; l++)
            if (n[k] == n[l])
                return false; /* killed */
    for (uint32_t k = 0; k < seats; k++) {
        at |= n[k] == node;
        *highest = n[k] > *highest ? n[k] : *highest;
    }
    return at;
}

static void split_slowly(slow *w, uint32_t node) {
    const mn_tree *t = w->t;
    for (;;) {
        uint32_t highest = node;
        for (uint32_t s = 0; s < t->simplices; s++) {
            uint32_t here = node;
            if (joined(w, s, node, &here) && here > highest)
                highest = here;
        }
        if (highest == node)
            break;
        split_slowly(w, highest);
    }
    uint32_t i = node - t->leaves;
    for (uint32_t v = t->leaf_lo[i]; v < t->leaf_hi[i]; v++)
        w->owner[v] = v < t->leaf_mid[i] ? t->left[i] : t->right[i];
}

static void close_slowly(slow *w, float error, uint64_t *seed) {
    const mn_tree *t = w->t;
    for (uint32_t r = 0; r < t->roots; r++) {
        uint32_t lo = t->leaf_lo[t->root[r] - t->leaves], hi = t->leaf_hi[t->root[r] - t->leaves];
        for (uint32_t v = lo; v < hi; v++)
            w->owner[v] = t->root[r];
    }
    for (;;) { /* any wanted active node, by lot */
        uint32_t start = fixture_random(seed) % t->leaves, chosen = MN_NONE;
        for (uint32_t k = 0; k < t->leaves && chosen == MN_NONE; k++) {
            uint32_t node = w->owner[(start + k) % t->leaves];
            if (node >= t->leaves && t->switch_value[node - t->leaves] > error)
                chosen = node;
        }
        if (chosen == MN_NONE)
            return;
        split_slowly(w, chosen);
    }
}

/* The mesh's vertices are the nodes of the front that have triangles. */
static void same_front(const slow *w, const mn_mesh *mesh, const uint32_t *active) {
    const mn_tree *t = w->t;
    unsigned char *has = calloc((size_t)t->leaves + t->inner, 1);
    uint32_t triangles = 0, vertices = 0;
    for (uint32_t s = 0; s < t->simplices; s++) {
        const uint32_t *c = t->corner + 3 * (size_t)s;
        if (c[2] == MN_NONE)
            continue;
        uint32_t n[3] = {w->owner[c[0]], w->owner[c[1]], w->owner[c[2]]};
        if (n[0] == n[1] || n[1] == n[2] || n[2] == n[0])
            continue;
        const uint32_t *m = mesh->corner + 3 * (size_t)triangles++;
        ck_assert_uint_le(triangles, mesh->triangles);
        for (int k = 0; k < 3; k++) {
            ck_assert_uint_eq(active[m[k]], n[k]);
            vertices += !has[n[k]];
            has[n[k]] = 1;
        }
    }
    ck_assert_uint_eq(triangles, mesh->triangles);
    ck_assert_uint_eq(vertices, mesh->vertices);
    for (uint32_t v = 0; v < mesh->vertices; v++) {
        uint32_t lo = active[v] < t->leaves ? active[v] : t->leaf_lo[active[v] - t->leaves];
        ck_assert(memcmp(mesh->position + 3 * (size_t)v, t->leaf_position + 3 * (size_t)lo, 12) ==
                  0);
        if (t->leaf_color != NULL)
            ck_assert_uint_eq(mesh->color[v], t->leaf_color[lo]);
    }
    free(has);
}

static void make(int kind, mn_mesh *mesh, mn_tree *tree) {
    if (kind == 2)
        fixture_book(40, mesh);
    else
        fixture_sheet(14, 5, kind == 1, mesh);
    fixture_tree(mesh, tree);
}

START_TEST(settled_fronts_are_the_least_closed_sets) {
    mn_mesh mesh, out;
    mn_tree tree;
    uint32_t *active;
    uint64_t seed = fixture_seed(23);
    make(_i, &mesh, &tree);
    slow w = {&tree, malloc(sizeof *w.owner * tree.leaves)};
    float top = tree.switch_value[tree.inner - 1];
    for (int step = 0; step < 12; step++) {
        mn_extract_desc desc = {.what = MN_EXTRACT_ERROR,
                                .error = step == 0 ? 0 : top * powf(0.5f, (float)(11 - step))};
        mn_status st = {0};
        float left = desc.error - mn_grid_error(tree.grid_step); /* beside the grid's share */
        close_slowly(&w, left > 0 ? left : 0, &seed);
        ck_assert(mn_tree_extract(&tree, &desc, &out, &active, &st) == MN_OK);
        same_front(&w, &out, active);
        free(active);
        mn_mesh_free(&out);
    }
    free(w.owner);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(prefix_fronts_have_the_most_triangles_allowed) {
    mn_mesh mesh, out;
    mn_tree tree;
    uint32_t *active;
    make(_i, &mesh, &tree);
    slow w = {&tree, malloc(sizeof *w.owner * tree.leaves)};
    /* from the whole mesh, collapse by collapse: every count that occurs, and those between */
    for (uint32_t v = 0; v < tree.leaves; v++)
        w.owner[v] = v;
    uint64_t before = UINT64_MAX;
    for (uint32_t made = 0; made <= tree.inner; made++) {
        uint64_t left = 0;
        if (made > 0)
            for (uint32_t v = tree.leaf_lo[made - 1]; v < tree.leaf_hi[made - 1]; v++)
                w.owner[v] = tree.leaves + made - 1;
        for (uint32_t s = 0; s < tree.simplices; s++) {
            const uint32_t *c = tree.corner + 3 * (size_t)s;
            if (c[2] == MN_NONE)
                continue;
            uint32_t n[3] = {w.owner[c[0]], w.owner[c[1]], w.owner[c[2]]};
            left += n[0] != n[1] && n[1] != n[2] && n[2] != n[0];
        }
        if (left == before)
            continue; /* the first with so many is meant */
        uint64_t asked[] = {left, before - 1};
        for (int k = 0; k < 2; k++) {
            mn_status st = {0};
            mn_extract_desc desc = {.what = MN_EXTRACT_TRIANGLES, .triangles = asked[k]};
            ck_assert(mn_tree_extract(&tree, &desc, &out, &active, &st) == MN_OK);
            ck_assert_uint_eq(out.triangles, left);
            same_front(&w, &out, active);
            free(active);
            mn_mesh_free(&out);
        }
        before = left;
    }
    free(w.owner);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(full_detail_and_nothing_at_all) {
    mn_mesh mesh, out;
    mn_tree tree;
    mn_status st = {0};
    fixture_sheet(9, 5, true, &mesh);
    fixture_tree(&mesh, &tree);
    ck_assert(mn_tree_extract(&tree, &(mn_extract_desc){0}, &out, NULL, &st) == MN_OK);
    ck_assert_uint_eq(out.vertices, mesh.vertices);
    ck_assert_uint_eq(out.triangles, mesh.triangles);
    mn_mesh_free(&out);
    mn_extract_desc none = {.what = MN_EXTRACT_ERROR, .error = INFINITY};
    ck_assert(mn_tree_extract(&tree, &none, &out, NULL, &st) == MN_OK);
    ck_assert_uint_eq(out.triangles, 0);
    ck_assert_uint_eq(out.vertices, 0);
    mn_mesh_free(&out);
    mn_extract_desc zero = {.what = MN_EXTRACT_TRIANGLES, .triangles = 0};
    ck_assert(mn_tree_extract(&tree, &zero, &out, NULL, &st) == MN_OK);
    ck_assert_uint_eq(out.triangles, 0);
    mn_mesh_free(&out);
    mn_extract_desc bad = {.what = MN_EXTRACT_ERROR, .error = NAN};
    ck_assert_int_eq(mn_tree_extract(&tree, &bad, &out, NULL, &st), MN_USAGE);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* ---- files ---------------------------------------------------------------------------------- */

static int by_bytes(const void *a, const void *b) {
    return memcmp(a, b, 13);
}

/* A PLY with its faces, 13 bytes each at its end, in the order of their bytes. */
static size_t load_sorted(const char *path, uint32_t faces, unsigned char **bytes) {
    FILE *f = fopen(path, "rb");
    ck_assert_ptr_nonnull(f);
    ck_assert(fseek(f, 0, SEEK_END) == 0);
    const size_t size = (size_t)ftell(f);
    rewind(f);
    *bytes = malloc(size);
    ck_assert_uint_eq(fread(*bytes, 1, size, f), size);
    fclose(f);
    qsort(*bytes + size - 13 * (size_t)faces, faces, 13, by_bytes);
    return size;
}

/* The same vertices, byte for byte, and the same triangles, as the tree in memory gives. */
static void same_file(const char *in, const mn_tree *tree, const mn_extract_desc *desc) {
    char path[2][160];
    unsigned char *bytes[2];
    size_t size[2];
    mn_mesh mesh;
    mn_extract_result result;
    mn_status st = {0};
    snprintf(path[0], sizeof path[0], "%s", fixture_path("memory.ply"));
    snprintf(path[1], sizeof path[1], "%s", fixture_path("walked.ply"));
    ck_assert(mn_tree_extract(tree, desc, &mesh, NULL, &st) == MN_OK);
    ck_assert(mn_mesh_write_ply(path[0], &mesh, &st) == MN_OK);
    ck_assert_msg(mn_extract_file(in, desc, NULL, path[1], &result, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(result.vertices, mesh.vertices);
    ck_assert_uint_eq(result.triangles, mesh.triangles);
    for (int i = 0; i < 2; i++)
        size[i] = load_sorted(path[i], mesh.triangles, &bytes[i]);
    ck_assert_uint_eq(size[0], size[1]);
    ck_assert(memcmp(bytes[0], bytes[1], size[0]) == 0);
    free(bytes[0]);
    free(bytes[1]);
    mn_mesh_free(&mesh);
}

START_TEST(files_hold_the_same_fronts) {
    char in[160], rows[160];
    mn_mesh mesh;
    mn_tree made, tree;
    mn_status st = {0};
    const mn_block_desc cut = {.block_bytes = 4096};
    snprintf(in, sizeof in, "%s", fixture_path("front.mnt"));
    snprintf(rows, sizeof rows, "%s", fixture_path("front.vdt"));
    if (_i == 2)
        fixture_book(700, &mesh); /* overflows, and vertices without triangles early on */
    else
        fixture_sheet(40, 5, _i == 1, &mesh);
    mesh.origin[1] = _i; /* then doubles are written */
    if (_i == 0)
        fixture_tree(&mesh, &made);
    else
        fixture_random_tree(&mesh, 7, &made);
    ck_assert(mn_block_write(in, &made, &cut, NULL, NULL, &st) == MN_OK);
    ck_assert_msg(fixture_load(in, &tree, &st) == MN_OK, "%s", st.text);
    ck_assert(mn_tree_write(rows, &made, &st) == MN_OK);
    mn_tree_free(&made);
    ck_assert(mn_tree_read(rows, &made, &st) == MN_OK); /* corners are turned in a file */
    same_file(in, &tree, &(mn_extract_desc){0});
    same_file(rows, &made, &(mn_extract_desc){0});
    for (uint64_t n = 0; n <= tree.triangles + 3; n = 2 * n + 1) {
        same_file(in, &tree, &(mn_extract_desc){MN_EXTRACT_TRIANGLES, .triangles = n});
        same_file(rows, &made, &(mn_extract_desc){MN_EXTRACT_TRIANGLES, .triangles = n});
    }
    for (float error = 0.001f; error < 1; error *= 3) {
        same_file(in, &tree, &(mn_extract_desc){MN_EXTRACT_ERROR, .error = error});
        same_file(rows, &made, &(mn_extract_desc){MN_EXTRACT_ERROR, .error = error});
    }
    mn_tree_free(&made);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* Writes a tree as .mnt and .vdt, and reads both back: corners are turned in files. */
static void store(const mn_tree *tree, const char *mnt, const char *vdt, mn_tree back[2]) {
    mn_status st = {0};
    const mn_block_desc cut = {.block_bytes = 4096};
    ck_assert(mn_block_write(mnt, tree, &cut, NULL, NULL, &st) == MN_OK);
    ck_assert_msg(fixture_load(mnt, &back[0], &st) == MN_OK, "%s", st.text);
    ck_assert(mn_tree_write(vdt, tree, &st) == MN_OK);
    ck_assert_msg(mn_tree_read(vdt, &back[1], &st) == MN_OK, "%s", st.text);
}

/* Small ones by the slow closure too, those of random trees with many roots and long waits. */
START_TEST(files_hold_the_same_settled_fronts) {
    char mnt[160], vdt[160];
    mn_mesh mesh;
    mn_tree tree, back[2];
    uint64_t seed = fixture_seed(29 + (uint64_t)_i);
    snprintf(mnt, sizeof mnt, "%s", fixture_path("settled.mnt"));
    snprintf(vdt, sizeof vdt, "%s", fixture_path("settled.vdt"));
    for (int round = 0; round < 6; round++) {
        const uint32_t size = 3 + fixture_random(&seed) % 12;
        if (_i == 2)
            fixture_book(5 * size, &mesh);
        else
            fixture_sheet(size, seed, round % 2 == 0, &mesh);
        if (_i == 1)
            fixture_random_tree(&mesh, seed, &tree);
        else
            fixture_tree(&mesh, &tree);
        store(&tree, mnt, vdt, back);
        slow w = {&back[0], malloc(sizeof *w.owner * tree.leaves)};
        for (int step = 0; step < 6; step++) {
            mn_extract_desc desc = {.what = MN_EXTRACT_ERROR};
            mn_status st = {0};
            mn_mesh out;
            uint32_t *active;
            if (step < 4) /* a node's own, or nothing: huge fronts and small ones */
                desc.error = step == 0 ? 0
                                       : back[0].switch_value[fixture_random(&seed) % tree.inner] +
                                             mn_grid_error(tree.grid_step);
            else
                desc.error = step == 4 ? INFINITY : 2 * back[0].switch_value[tree.inner - 1];
            close_slowly(&w, fmaxf(desc.error - mn_grid_error(tree.grid_step), 0), &seed);
            ck_assert(mn_tree_extract(&back[0], &desc, &out, &active, &st) == MN_OK);
            same_front(&w, &out, active);
            free(active);
            mn_mesh_free(&out);
            same_file(mnt, &back[0], &desc);
            same_file(vdt, &back[1], &desc);
        }
        free(w.owner);
        mn_tree_free(&back[0]);
        mn_tree_free(&back[1]);
        mn_tree_free(&tree);
        mn_mesh_free(&mesh);
    }
}
END_TEST

static bool stop(void *context, const char *phase, uint64_t done, uint64_t total) {
    uint32_t *left = context; /* calls before it stops */
    (void)phase;
    (void)done;
    (void)total;
    return (*left)-- > 0;
}

static bool stop_settling(void *context, const char *phase, uint64_t done, uint64_t total) {
    (void)context;
    (void)done;
    (void)total;
    return strcmp(phase, "settling") != 0;
}

/* The least cap with which a front begins to settle. */
static uint64_t least_cap(const char *in, mn_extract_desc desc, const char *out) {
    uint64_t low = 1 << 20, high = 64 << 20;
    while (high - low > 1) {
        mn_extract_result result;
        mn_status st = {0};
        desc.ram_bytes = low + (high - low) / 2;
        const mn_code code =
            mn_extract_file(in, &desc, &(mn_watch){stop_settling, NULL}, out, &result, &st);
        if (code == MN_CAP_TOO_SMALL) {
            ck_assert_ptr_nonnull(strstr(st.text, "try --ram "));
            low = desc.ram_bytes;
        } else {
            ck_assert_msg(code == MN_FAILED && strcmp(st.text, "interrupted") == 0, "%s", st.text);
            high = desc.ram_bytes;
        }
    }
    return high;
}

/* 72,900 leaves: their order ids do not fit the pages that the least cap has. */
static void make_large(mn_mesh *mesh, mn_tree *tree, const char *mnt, const char *vdt,
                       mn_tree back[2]) {
    fixture_sheet(270, 3, true, mesh);
    fixture_tree(mesh, tree);
    store(tree, mnt, vdt, back);
}

START_TEST(settled_fronts_need_no_more_than_the_least_cap) {
    char mnt[160], vdt[160], out[160];
    mn_mesh mesh;
    mn_tree tree, back[2];
    snprintf(mnt, sizeof mnt, "%s", fixture_path("edge.mnt"));
    snprintf(vdt, sizeof vdt, "%s", fixture_path("edge.vdt"));
    snprintf(out, sizeof out, "%s", fixture_path("edge.ply"));
    make_large(&mesh, &tree, mnt, vdt, back);
    for (int i = 0; i < 2; i++) {
        const char *in = i == 0 ? mnt : vdt;
        mn_extract_desc desc = {.what = MN_EXTRACT_ERROR, .temp_dir = fixture_path("")};
        desc.error = back[i].switch_value[tree.inner / 2] + mn_grid_error(tree.grid_step);
        desc.ram_bytes = least_cap(in, desc, out);
        printf("%s: %llu bytes\n", in, (unsigned long long)desc.ram_bytes);
        ck_assert_uint_lt(desc.ram_bytes, 6 << 20);
        same_file(in, &back[i], &desc);
    }
    mn_tree_free(&back[0]);
    mn_tree_free(&back[1]);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(settling_survives_full_disks_and_interrupts) {
    char mnt[160], vdt[160], out[160];
    mn_mesh mesh;
    mn_tree tree, back[2];
    mn_extract_result result;
    snprintf(mnt, sizeof mnt, "%s", fixture_path("full.mnt"));
    snprintf(vdt, sizeof vdt, "%s", fixture_path("full.vdt"));
    snprintf(out, sizeof out, "%s", fixture_path("full.ply"));
    make_large(&mesh, &tree, mnt, vdt, back);
    mn_extract_desc desc = {.what = MN_EXTRACT_ERROR, .temp_dir = fixture_path("")};
    desc.error = back[0].switch_value[tree.inner * 9 / 10] + mn_grid_error(tree.grid_step);
    desc.ram_bytes = least_cap(mnt, desc, out);
    mn_status st = {0};
    signal(SIGXFSZ, SIG_IGN);
    limit_files(64 << 10);
    ck_assert_int_eq(mn_extract_file(mnt, &desc, NULL, out, &result, &st), MN_NO_SPACE);
    ck_assert_ptr_nonnull(strstr(st.text, "--temp-dir"));
    limit_files(RLIM_INFINITY);
    desc.temp_dir = "/nowhere/at/all";
    st = (mn_status){0};
    ck_assert_int_eq(mn_extract_file(mnt, &desc, NULL, out, &result, &st), MN_FAILED);
    ck_assert_ptr_nonnull(strstr(st.text, "/nowhere/at/all"));
    desc.temp_dir = NULL;
    uint32_t calls = 0;
    for (mn_code code = MN_FAILED; code != MN_OK; calls += 1 + calls / 2) {
        uint32_t left = calls;
        st = (mn_status){0};
        code = mn_extract_file(mnt, &desc, &(mn_watch){stop, &left}, out, &result, &st);
        ck_assert_msg(code == MN_OK || (code == MN_FAILED && strcmp(st.text, "interrupted") == 0),
                      "%s", st.text);
        ck_assert_int_eq(access(out, F_OK) == 0, code == MN_OK);
    }
    ck_assert_uint_gt(calls, 3); /* in the first walk, and in later ones */
    mn_tree_free(&back[0]);
    mn_tree_free(&back[1]);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

START_TEST(a_small_cap_is_refused_with_one_that_does) {
    char in[160], out[160];
    mn_mesh mesh;
    mn_tree tree;
    mn_extract_result result;
    mn_status st = {0};
    mn_extract_desc desc = {.ram_bytes = 1 << 20};
    snprintf(in, sizeof in, "%s", fixture_path("cap.mnt"));
    snprintf(out, sizeof out, "%s", fixture_path("cap.ply"));
    fixture_sheet(30, 1, false, &mesh);
    fixture_tree(&mesh, &tree);
    ck_assert(mn_block_write(in, &tree, NULL, NULL, NULL, &st) == MN_OK);
    ck_assert_int_eq(mn_extract_file(in, &desc, NULL, out, &result, &st), MN_CAP_TOO_SMALL);
    const char *named = strstr(st.text, "try --ram ");
    ck_assert_ptr_nonnull(named);
    desc.ram_bytes = strtoull(named + 10, NULL, 10) << 20;
    st = (mn_status){0};
    ck_assert_msg(mn_extract_file(in, &desc, NULL, out, &result, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(result.triangles, mesh.triangles);
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

/* Takes the root's block away, once it has been read. */
static bool damage(void *context, const char *phase, uint64_t done, uint64_t total) {
    static const unsigned char zeros[MN_PAGE_BYTES];
    const char *path = context;
    mn_header h;
    mn_status st = {0};
    (void)phase;
    (void)done;
    (void)total;
    ck_assert_msg(mn_header_read(path, &h, &st) == MN_OK, "%s", st.text);
    FILE *f = fopen(path, "r+b");
    ck_assert(f != NULL && fseek(f, (long)h.root[0].block.id * MN_PAGE_BYTES, SEEK_SET) == 0);
    ck_assert_uint_eq(fwrite(zeros, 1, sizeof zeros, f), sizeof zeros);
    ck_assert_int_eq(fclose(f), 0);
    return true;
}

/* The second walk, which counts single nodes, comes to nothing; and there are more nodes than
 * counters. */
START_TEST(a_file_may_be_damaged_between_two_walks) {
    char in[160], out[160];
    mn_mesh mesh;
    mn_tree tree;
    mn_extract_result result;
    mn_status st = {0};
    const mn_watch watch = {damage, in};
    const mn_block_desc cut = {.block_bytes = 4096};
    snprintf(in, sizeof in, "%s", fixture_path("damaged.mnt"));
    snprintf(out, sizeof out, "%s", fixture_path("damaged.ply"));
    fixture_sheet(300, 1, false, &mesh);
    fixture_tree(&mesh, &tree);
    ck_assert_uint_gt(tree.inner, 80000);
    ck_assert(mn_block_write(in, &tree, &cut, NULL, NULL, &st) == MN_OK);
    const mn_extract_desc desc = {_i == 0 ? MN_EXTRACT_TRIANGLES : MN_EXTRACT_ERROR,
                                  .triangles = mesh.triangles - 1};
    ck_assert_int_eq(mn_extract_file(in, &desc, &watch, out, &result, &st), MN_BAD_INPUT);
    ck_assert_ptr_nonnull(strstr(st.text, "does not begin like a block"));
    mn_tree_free(&tree);
    mn_mesh_free(&mesh);
}
END_TEST

int main(void) {
    Suite *s = suite_create("extract");
    TCase *t = tcase_create("fronts");
    tcase_set_timeout(t, 60);
    tcase_add_loop_test(t, settled_fronts_are_the_least_closed_sets, 0, 3);
    tcase_add_loop_test(t, prefix_fronts_have_the_most_triangles_allowed, 0, 3);
    tcase_add_test(t, full_detail_and_nothing_at_all);
    tcase_add_loop_test(t, files_hold_the_same_fronts, 0, 3);
    tcase_add_loop_test(t, files_hold_the_same_settled_fronts, 0, 3);
    tcase_add_test(t, settled_fronts_need_no_more_than_the_least_cap);
    tcase_add_test(t, settling_survives_full_disks_and_interrupts);
    tcase_add_test(t, a_small_cap_is_refused_with_one_that_does);
    tcase_add_loop_test(t, a_file_may_be_damaged_between_two_walks, 0, 2);
    suite_add_tcase(s, t);
    return suite_run(s);
}
