/* .vdt files, written from and read into a tree in memory. (vdt.c has trees that stay on disk.)
 *
 * Hides: how rows become a tree by order ids again. What stands twice in them (intervals, rows of
 * children) must agree, so that whoever reads rows one by one may rely on what a whole reading
 * accepts. Times are not in the file: the same input gives the same bytes. Order: each call alone.
 * One thread; blocks on the disk. Memory: the tree, 4 bytes a leaf. Paper: none. */
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "tree.h"
#include "vdt_header.h"

/* ---- writing -------------------------------------------------------------------------------- */

typedef struct writer {
    mni_out out;
    mn_status *st;
} writer;

static mn_code put(void *context, int section, const void *bytes, size_t count) {
    writer *w = context;
    (void)section; /* they follow each other */
    return mni_out_write(&w->out, bytes, count, w->st);
}

mn_code mn_tree_write(const char *path, const mn_tree *tree, mn_status *st) {
    writer w = {.out = {.fd = -1}, .st = st};
    mni_vdt_header h;
    uint64_t sum[MNI_SECTIONS];
    mn_code code = mn_tree_check(tree, st);
    if (code == MN_OK)
        code = mni_tree_rows_sums(tree, sum, st);
    if (code == MN_OK)
        code = mni_out_open(&w.out, path, st);
    if (code == MN_OK) {
        mni_vdt_header_make(&h, tree, tree->leaf_color != NULL, sum);
        code = mni_out_write(&w.out, &h, sizeof h, st);
    }
    if (code == MN_OK)
        code = mni_tree_rows(tree, put, &w, st);
    if (code == MN_OK)
        code = mni_out_commit(&w.out, st);
    mni_out_abort(&w.out);
    return code;
}

/* ---- reading -------------------------------------------------------------------------------- */

enum { BATCH = 1024 }; /* records read at once */
_Static_assert(sizeof(mni_row) >= sizeof(mni_row_simplex), "a batch of either fits");

typedef struct reader {
    mni_in in;
    const char *path;
    mni_vdt_header header;
    mn_tree *tree;
    uint32_t *node_at; /* a row: its inner node, or MN_NONE */
    mni_row *batch;
    uint32_t row, start, taken; /* at which simplices are: its first, and how many of it came */
    mn_status *st;
} reader;

static mn_code lies(const reader *r, uint64_t row, const char *what) {
    return mn_fail(r->st, MN_BAD_INPUT, "%s: row %llu: %s; the file is damaged: simplify again",
                   r->path, (unsigned long long)row, what);
}

/* Calls `take` with all records of a section, up to BATCH at a time, and compares its checksum. */
static mn_code each_batch(reader *r, int section, uint64_t records, size_t record_bytes,
                          mn_code (*take)(reader *r, uint64_t first, uint32_t count)) {
    static const char *const name[MNI_SECTIONS] = {"rows", "simplices"};
    XXH3_state_t *state = XXH3_createState();
    if (state == NULL)
        return mn_fail(r->st, MN_FAILED, "no memory to read %s", r->path);
    XXH3_64bits_reset(state);
    mn_code code = MN_OK;
    uint64_t offset = r->header.section[section].offset;
    for (uint64_t first = 0; first < records && code == MN_OK; first += BATCH) {
        uint32_t count = records - first < BATCH ? (uint32_t)(records - first) : BATCH;
        size_t bytes = count * record_bytes;
        code = mni_vdt_read(&r->in, r->path, offset + first * record_bytes, r->batch, bytes,
                            name[section], r->st);
        if (code == MN_OK) {
            XXH3_64bits_update(state, r->batch, bytes);
            code = take(r, first, count);
        }
    }
    if (code == MN_OK && XXH3_64bits_digest(state) != r->header.section[section].checksum)
        code = mn_fail(r->st, MN_BAD_INPUT,
                       "%s: %s (at byte %llu): checksum does not match; simplify again", r->path,
                       name[section], (unsigned long long)offset);
    XXH3_freeState(state);
    return code;
}

/* Is the child at row `child` inside, or a leaf where there is room for one only? */
static bool child_fits(uint32_t child, uint32_t lo, uint32_t hi) {
    return hi - lo == 1 ? child == MN_NONE : child > lo && child < hi;
}

static bool is_blank(const mni_row *row) {
    mni_row blank = *row;
    blank.order = blank.leaf_lo = blank.leaf_hi = 0;
    blank.left = blank.right = MN_NONE;
    blank.switch_value = blank.radius = 0;
    blank.cone = (mn_cone){{0, 0}, 0};
    return memcmp(&blank, row, sizeof blank) == 0;
}

/* The simplices of row r->row end where those of the next begin. */
static mn_code end_simplices(reader *r, uint32_t next_start) {
    uint32_t node = r->node_at[r->row];
    if (next_start < r->start || next_start > r->tree->simplices)
        return lies(r, r->row, "its simplices end before they begin");
    if (node == MN_NONE && next_start != r->start)
        return lies(r, r->row, "no inner node, and yet simplices of one");
    if (node != MN_NONE)
        r->tree->simplex_start[node + 1] = next_start - r->start; /* a count, until all are known */
    r->start = next_start;
    return MN_OK;
}

static mn_code take_node(reader *r, uint64_t at, const mni_row *row) {
    mn_tree *t = r->tree;
    uint64_t node = (uint64_t)row->order - t->leaves;
    if (row->order < t->leaves || node >= t->inner || t->leaf_hi[node] != 0)
        return lies(r, at, "its order id cannot be");
    if (row->leaf_lo >= at || row->leaf_hi <= at || row->leaf_hi > t->leaves ||
        !child_fits(row->left, row->leaf_lo, (uint32_t)at) ||
        !child_fits(row->right, (uint32_t)at, row->leaf_hi))
        return lies(r, at, "its leaves or its children cannot be");
    r->node_at[at] = (uint32_t)node;
    t->leaf_lo[node] = row->leaf_lo;
    t->leaf_mid[node] = (uint32_t)at;
    t->leaf_hi[node] = row->leaf_hi;
    t->left[node] = row->left; /* rows, until all nodes are known */
    t->right[node] = row->right;
    t->switch_value[node] = row->switch_value;
    t->radius[node] = row->radius;
    t->cone[node] = row->cone;
    return MN_OK;
}

static mn_code take_rows(reader *r, uint64_t first, uint32_t count) {
    mn_tree *t = r->tree;
    mn_code code = MN_OK;
    for (uint32_t i = 0; i < count && code == MN_OK; i++) {
        const mni_row *row = &r->batch[i];
        uint64_t at = first + i;
        if (at > 0)
            code = end_simplices(r, row->simplex_start);
        else if (row->simplex_start != 0)
            code = lies(r, at, "its simplices are not the first");
        if (code != MN_OK)
            return code;
        if (row->zero != 0 || (t->leaf_color == NULL && row->rgba != UINT32_MAX))
            return lies(r, at, "what is not there is not left empty");
        memcpy(t->leaf_position + 3 * at, row->position, sizeof row->position);
        if (t->leaf_color != NULL)
            t->leaf_color[at] = row->rgba;
        r->row = (uint32_t)at;
        r->node_at[at] = MN_NONE;
        if (row->order != 0)
            code = take_node(r, at, row);
        else if (!is_blank(row))
            code = lies(r, at, "no inner node, and yet facts of one");
    }
    return code;
}

/* The order id of a child that covers [lo, hi), as its own row must say. MN_NONE: it does not. */
static uint32_t child_order(const reader *r, uint32_t row, uint32_t lo, uint32_t hi) {
    const mn_tree *t = r->tree;
    if (row == MN_NONE)
        return lo;
    uint32_t node = r->node_at[row];
    if (node == MN_NONE || t->leaf_lo[node] != lo || t->leaf_hi[node] != hi)
        return MN_NONE;
    return t->leaves + node;
}

static mn_code join_nodes(reader *r) {
    mn_tree *t = r->tree;
    for (uint32_t i = 0; i < t->inner; i++) {
        if (t->leaf_hi[i] == 0)
            return mn_fail(r->st, MN_BAD_INPUT, "%s: order id %u is missing; the file is damaged",
                           r->path, t->leaves + i);
        t->left[i] = child_order(r, t->left[i], t->leaf_lo[i], t->leaf_mid[i]);
        t->right[i] = child_order(r, t->right[i], t->leaf_mid[i], t->leaf_hi[i]);
        if (t->left[i] == MN_NONE || t->right[i] == MN_NONE)
            return lies(r, t->leaf_mid[i], "its leaves are not those of its children");
        t->simplex_start[i + 1] += t->simplex_start[i];
    }
    return MN_OK;
}

static mn_code take_simplices(reader *r, uint64_t first, uint32_t count) {
    mn_tree *t = r->tree;
    const mni_row_simplex *from = (const mni_row_simplex *)r->batch;
    (void)first;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t node, last = from[i].corner[2];
        while ((node = r->node_at[r->row]) == MN_NONE ||
               t->simplex_start[node] + r->taken == t->simplex_start[node + 1]) {
            r->row++; /* some row has room: their counts sum up to as many as there are */
            r->taken = 0;
        }
        if (last >= t->leaf_lo[node] && last < t->leaf_hi[node])
            return lies(r, r->row, "the last corner of a simplex is below its node");
        memcpy(t->corner + 3 * ((size_t)t->simplex_start[node] + r->taken++), &from[i],
               sizeof from[i]);
    }
    return MN_OK;
}

static mn_code read_tree(reader *r) {
    mn_tree facts, *t = r->tree;
    mni_vdt_header *h = &r->header;
    mn_code code = mni_vdt_header_read(&r->in, r->path, h, &facts, r->st);
    if (code == MN_OK)
        code = mni_tree_alloc(t, h->leaves, h->roots, h->simplices, mni_vdt_header_has_colors(h),
                              r->st);
    if (code != MN_OK)
        return code;
    t->triangles = facts.triangles;
    t->legal_last = facts.legal_last;
    t->metric = facts.metric;
    t->grid_step = facts.grid_step;
    t->intake = facts.intake;
    t->counts = facts.counts;
    memcpy(t->origin, facts.origin, sizeof t->origin);
    r->node_at = malloc(sizeof *r->node_at * t->leaves);
    r->batch = malloc(sizeof *r->batch * BATCH);
    if (r->node_at == NULL || r->batch == NULL)
        return mn_fail(r->st, MN_FAILED, "no memory to read a tree of %u vertices", t->leaves);
    code = each_batch(r, MNI_ROWS, t->leaves, sizeof(mni_row), take_rows);
    if (code == MN_OK)
        code = end_simplices(r, t->simplices);
    if (code == MN_OK)
        code = join_nodes(r);
    r->row = 0;
    if (code == MN_OK)
        code = each_batch(r, MNI_SIMPLICES, t->simplices, sizeof(mni_row_simplex), take_simplices);
    mn_status why = {0};
    if (code == MN_OK && (mni_tree_derive(t, &why) != MN_OK || mn_tree_check(t, &why) != MN_OK))
        code = mn_fail(r->st, why.code, "%s: %s; the file is damaged: simplify again", r->path,
                       why.text);
    if (code == MN_OK && t->depth_max != h->depth_max)
        code = mn_fail(r->st, MN_BAD_INPUT, "%s: header: depth_max is %u, of the tree it is %u",
                       r->path, h->depth_max, t->depth_max);
    return code;
}

mn_code mn_tree_read(const char *path, mn_tree *out, mn_status *st) {
    mn_status own = {0};
    reader r = {.path = path, .tree = out, .st = st != NULL ? st : &own};
    memset(out, 0, sizeof *out);
    mn_code code = mni_in_open(&r.in, path, r.st);
    if (code != MN_OK)
        return code;
    code = read_tree(&r);
    mni_in_close(&r.in);
    free(r.node_at);
    free(r.batch);
    if (code != MN_OK)
        mn_tree_free(out);
    return code;
}

mn_code mn_tree_expect(const char *path, uint64_t *vertices, uint64_t *triangles, mn_status *st) {
    mn_code code;
    *vertices = *triangles = 0;
    if (mn_tree_is_vdt(path)) {
        mni_vdt_header h;
        mn_tree facts;
        mni_in in;
        code = mni_in_open(&in, path, st);
        if (code != MN_OK)
            return code;
        code = mni_vdt_header_read(&in, path, &h, &facts, st);
        mni_in_close(&in);
        if (code == MN_OK) {
            *vertices = h.leaves;
            *triangles = h.triangles;
        }
        return code;
    }
    mn_header *h = malloc(sizeof *h);
    if (h == NULL)
        return mn_fail(st, MN_FAILED, "%s: no memory to read it", path);
    code = mn_header_read(path, h, st);
    if (code == MN_OK) {
        *vertices = h->leaves;
        *triangles = h->triangles;
    }
    free(h);
    return code;
}
