/* Trees that need not fit in memory: made of a mesh, or opened, then written or cut into blocks.
 *
 * One thread a tree; calls block on the disk. Paper: §3. */
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "tree.h"
#include "vdt_header.h"

struct mn_vdt {
    mn_tree tree, head;
    mn_vdt_figures figures;
};

static double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static mn_code make_tree(const char *in, const mn_read_desc *read, const mn_simplify_desc *simplify,
                         mn_vdt *vdt, mn_status *st) {
    mn_mesh mesh;
    double start_s = now_s();
    mn_code code = mn_mesh_read(in, read, &mesh, st);
    if (code != MN_OK)
        return code;
    vdt->figures.read = (mn_phase_figures){now_s() - start_s, mesh.bytes_read, 0};
    code = mn_mesh_quantise(&mesh, simplify->position_bits, st);
    if (code == MN_OK)
        code = mn_simplify(&mesh, simplify, &vdt->tree, st);
    vdt->figures.simplify.seconds = vdt->tree.counts.seconds_simplify;
    mn_mesh_free(&mesh);
    return code;
}

static void fill_head(mn_vdt *vdt) {
    mn_tree *h = &vdt->head;
    *h = vdt->tree;
    h->leaf_position = NULL;
    h->leaf_color = h->left = h->right = h->leaf_lo = h->leaf_mid = h->leaf_hi = NULL;
    h->switch_value = h->radius = NULL;
    h->cone = NULL;
    h->root = h->simplex_start = h->corner = NULL;
}

static mn_code finish(mn_code code, mn_vdt *vdt, mn_vdt **out) {
    if (code == MN_OK) {
        fill_head(vdt);
        *out = vdt;
    } else {
        mn_vdt_close(vdt);
    }
    return code;
}

mn_code mn_vdt_make(const char *in, const mn_read_desc *read, const mn_simplify_desc *simplify,
                    mn_work *work, mn_vdt **out, mn_status *st) {
    mn_read_desc reading = read != NULL ? *read : (mn_read_desc){0};
    mn_simplify_desc simplifying = simplify != NULL ? *simplify : (mn_simplify_desc){0};
    mn_vdt *vdt = calloc(1, sizeof *vdt);
    (void)work; /* nothing is finished before all is */
    *out = NULL;
    if (vdt == NULL)
        return mn_fail(st, MN_FAILED, "no memory");
    if (reading.ram_bytes == 0)
        reading.ram_bytes = simplifying.ram_bytes;
    if (reading.then_need_bytes == NULL)
        reading.then_need_bytes = mn_simplify_need_bytes;
    return finish(make_tree(in, &reading, &simplifying, vdt, st), vdt, out);
}

mn_code mn_vdt_open(const char *path, const mn_watch *watch, mn_vdt **out, mn_status *st) {
    mn_vdt *vdt = calloc(1, sizeof *vdt);
    (void)watch;
    *out = NULL;
    if (vdt == NULL)
        return mn_fail(st, MN_FAILED, "no memory");
    return finish(mn_tree_read(path, &vdt->tree, st), vdt, out);
}

void mn_vdt_close(mn_vdt *vdt) {
    if (vdt == NULL)
        return;
    mn_tree_free(&vdt->tree);
    free(vdt);
}

const mn_tree *mn_vdt_head(const mn_vdt *vdt) {
    return &vdt->head;
}

const mn_vdt_figures *mn_vdt_figures_of(const mn_vdt *vdt) {
    return &vdt->figures;
}

mn_code mn_vdt_write(mn_vdt *vdt, const char *path, const mn_watch *watch, mn_status *st) {
    (void)watch;
    return mn_tree_write(path, &vdt->tree, st);
}

mn_code mn_vdt_block(mn_vdt *vdt, const char *path, const mn_block_desc *desc, mn_header *header,
                     mn_block_counts *counts, mn_status *st) {
    return mn_block_write(path, &vdt->tree, desc, header, counts, st);
}
