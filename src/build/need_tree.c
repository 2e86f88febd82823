/* How much memory it takes to have a tree in memory, and to do something with it: by what stands in
 * the header of its file, before anything is read. Sums of what tree.c, tree_load.c, extract.c,
 * tree_rows.c and verify.c allocate, one line each. Memory: none. */
#include <stdlib.h>

#include "file.h"
#include "header.h"
#include "need_block.h"
#include "simplify.h"
#include "vdt_header.h"

typedef struct size {
    uint64_t leaves, simplices, triangles;
    bool vdt, has_colors;
} size;

static mn_code size_of(const char *path, size *s, mn_status *st) {
    if (mn_tree_is_vdt(path)) {
        mni_vdt_header h;
        mn_tree facts;
        mni_in in;
        mn_code code = mni_in_open(&in, path, st);
        if (code != MN_OK)
            return code;
        code = mni_vdt_header_read(&in, path, &h, &facts, st);
        mni_in_close(&in);
        *s = (size){h.leaves, h.simplices, h.triangles, true, mni_vdt_header_has_colors(&h)};
        return code;
    }
    mn_header *h = malloc(sizeof *h);
    if (h == NULL)
        return mn_fail(st, MN_FAILED, "no memory");
    mn_code code = mn_header_read(path, h, st);
    if (code == MN_OK)
        *s = (size){h->leaves, h->triangles + h->hinges, h->triangles, false, h->has_colors};
    free(h);
    return code;
}

static uint64_t max_u64(uint64_t a, uint64_t b) {
    return a > b ? a : b;
}

static uint64_t tree_bytes(const size *s) {
    return s->leaves * (12 /* positions */ + (s->has_colors ? 4 : 0) + 5 * 4 /* links, leaves */ +
                        8 /* values, radii */ + sizeof(mn_cone) + 4 /* simplices begin */) +
           s->simplices * 12;
}

static uint64_t loading_bytes(const size *s) {
    return s->vdt ? s->leaves * (4 + 4) /* nodes by row; the check's */
                  : s->leaves * 8 /* the check's */ + s->leaves / 8 + (2 << 20) /* a walk's */;
}

static uint64_t mesh_bytes(const size *s) {
    return s->leaves * (12 + 4 /* colours */) + s->triangles * 12;
}

/* Beside the tree. */
static uint64_t using_bytes(const size *s) {
    const uint64_t extracting = s->leaves * (9 + 4 /* ids */) + mesh_bytes(s);
    /* seats, first and last of nodes, a stack */
    return max_u64(extracting, s->leaves * 9 + s->simplices * 24 + s->leaves * 24);
}

static uint64_t rows_bytes(const size *s) {
    return s->leaves * (sizeof(mni_row) + 4) + s->simplices * sizeof(mni_row_simplex);
}

uint64_t mni_tree_rows_bytes(uint64_t leaves, uint64_t simplices, bool has_colors) {
    const size s = {.leaves = leaves, .simplices = simplices, .has_colors = has_colors};
    return tree_bytes(&s) + rows_bytes(&s);
}

/* beside: the tree, while it is used. */
static mn_code check(const char *path, const size *s, uint64_t beside, uint64_t ram_bytes,
                     mn_status *st) {
    const uint64_t need = MNI_PROGRAM_BYTES + tree_bytes(s) + max_u64(loading_bytes(s), beside);
    if (ram_bytes == 0 || need <= ram_bytes)
        return MN_OK;
    return mn_fail(
        st, MN_CAP_TOO_SMALL,
        "%s: its %llu vertices are to be in memory, all at once: %llu MB, where the cap is "
        "%.1f MB; try --ram %lluM",
        path, (unsigned long long)s->leaves, (unsigned long long)(need >> 20) + 1,
        (double)ram_bytes / (1 << 20), (unsigned long long)(need >> 20) + 1);
}

mn_code mn_tree_fits(const char *path, uint64_t ram_bytes, mn_status *st) {
    size s;
    mn_code code = size_of(path, &s, st);
    return code == MN_OK ? check(path, &s, using_bytes(&s), ram_bytes, st) : code;
}

mn_code mn_tree_expect(const char *path, uint64_t *vertices, uint64_t *triangles, mn_status *st) {
    size s = {0};
    mn_code code = size_of(path, &s, st);
    *vertices = s.leaves;
    *triangles = s.triangles;
    return code;
}
