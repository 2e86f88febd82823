/* From rows on disk to rows handed out: what a .vdt says is checked on the way.
 *
 * Hides: how rows that may lie are gone through. The walk goes down from each root, left first, so
 * it comes by the rows in their order, and by each node after its parent, which says where it must
 * be (row_check.h). The way up is a stack of the nodes whose left side the walk is in; pages of
 * rows that lie on it are in the cache.
 *
 *     row        0   1   2   3   4   5       down to 2, down to 1: rows 0, 1, 2 come;
 *     node       –   a   R   c   b   d       then right, to 4, down to 3: rows 3, 4; right, to 5
 *
 * That every order id comes once is known by their hashes' sum (found.c). Order: see walk.h. One
 * thread. Memory: pages of rows, and 20 bytes for each turn to the left. Paper: §3.2. */
#include "vdt_rows.h"

#include <stdlib.h>
#include <string.h>

#include "cap.h"
#include "plan.h"
#include "simplify.h"
#include "watch.h"

enum {
    CACHE_LEAST = 256 << 10,
    CACHE_MOST = 2 << 20,
    SIMPLICES_AT_ONCE = 256,
    STACK_LEAST = 64, /* nodes */
};

/* A node that is to be gone to, or is on the stack. */
typedef struct node {
    uint32_t at; /* its row */
    uint32_t depth;
    float position[3];
} node;

typedef struct walk {
    const mni_walk_desc *desc;
    const mni_walk_sink *sink;
    const char *name; /* of the file */
    mn_tree head;
    mni_row_limits limits;
    mni_rows rows;
    mni_found found;
    node *stack;
    uint32_t inside, stack_room;
    uint64_t room; /* bytes of the stack, at most */
    mn_status why; /* what is wrong with a row, without the file's name */
    mn_status *st;
} walk;

/* ---- memory --------------------------------------------------------------------------------- */

/* Pages take half; the stack, old and new where it grows. */
uint64_t mni_vdt_walk_bytes(const mn_tree *head) {
    return CACHE_LEAST + 2 * 3 * ((uint64_t)head->depth_max + STACK_LEAST) * sizeof(node);
}

static mn_code too_small(walk *w) {
    const uint64_t need = MNI_PROGRAM_BYTES + w->desc->held_bytes + mni_vdt_walk_bytes(&w->head);
    return mn_fail(w->st, MN_CAP_TOO_SMALL,
                   "%s: %.1f MB of memory are too few to read it in: try --ram %lluM", w->name,
                   (double)w->desc->ram_bytes / (1 << 20), mni_megabytes(need));
}

static mn_code open_rows(walk *w, const mni_rows_source *source) {
    const uint64_t ram = w->desc->ram_bytes, beside = MNI_PROGRAM_BYTES + w->desc->held_bytes;
    uint64_t cache = CACHE_MOST;
    w->room = UINT64_MAX;
    if (ram > 0 && ram < beside + CACHE_LEAST)
        return too_small(w);
    if (ram > 0) {
        const uint64_t half = (ram - beside) / 2;
        cache = half < CACHE_LEAST ? CACHE_LEAST : half < CACHE_MOST ? half : CACHE_MOST;
        w->room = ram - beside - cache;
    }
    return mni_rows_open(&w->rows, source, cache, w->st);
}

static mn_code push(walk *w, const node *n) {
    if (w->inside == w->stack_room) {
        const uint64_t more = w->stack_room + w->stack_room / 2 + STACK_LEAST;
        if ((w->stack_room + more) * sizeof *w->stack > w->room)
            return too_small(w);
        node *stack = realloc(w->stack, more * sizeof *stack);
        if (stack == NULL)
            return mn_fail(w->st, MN_FAILED, "%s: no memory to read it", w->name);
        w->stack = stack;
        w->stack_room = (uint32_t)more;
    }
    w->stack[w->inside++] = *n;
    return MN_OK;
}

/* ---- rows ----------------------------------------------------------------------------------- */

static mn_code get(walk *w, uint32_t at, mni_row *row, uint32_t *simplex_end) {
    return mni_rows_get(&w->rows, at, row, simplex_end) ? MN_OK : mni_rows_trouble(&w->rows, w->st);
}

/* The child at that row, of leaves [lo, hi): is it what its parent says? */
static mn_code get_child(walk *w, const mni_row *parent, uint32_t at, const mni_place *place,
                         mni_row *row) {
    uint32_t simplex_end;
    mn_code code = get(w, at, row, &simplex_end);
    return code == MN_OK
               ? mni_row_safe(&w->limits, at, row, simplex_end, place, parent->order, &w->why)
               : code;
}

static mn_code give_simplices(walk *w, uint32_t at, const mni_row *row, uint32_t end) {
    mni_row_simplex room[SIMPLICES_AT_ONCE];
    for (uint32_t first = row->simplex_start; first < end;) {
        const uint32_t left = end - first;
        const uint32_t count = left < SIMPLICES_AT_ONCE ? left : SIMPLICES_AT_ONCE;
        const mni_row_simplex *s = mni_rows_simplices(&w->rows, first, count, room);
        if (s == NULL)
            return mni_rows_trouble(&w->rows, w->st);
        for (uint32_t i = 0; i < count; i++) {
            mn_code code = mni_row_check_simplex(&w->limits, at, row, &s[i], &w->why);
            if (code == MN_OK && w->sink->simplex != NULL)
                code = w->sink->simplex(w->sink->context, &s[i]);
            if (code != MN_OK)
                return code;
            *(s[i].corner[2] == MN_NONE ? &w->found.hinges : &w->found.triangles) += 1;
        }
        first += count;
    }
    return MN_OK;
}

static mn_code tell(walk *w, uint32_t at) {
    return mni_watch_each(w->desc->watch, w->desc->phase, at, w->head.leaves, w->st);
}

/* Checks a node wholly and hands it out. *right: its right child, if it has a row. */
static mn_code give_node(walk *w, const node *n, mni_row *row, mni_row *right) {
    mni_row left;
    uint32_t end, ignored;
    mn_code code = get(w, n->at, row, &end);
    if (code != MN_OK)
        return code;
    uint32_t child[2] = {row->leaf_lo, n->at};
    if (row->left != MN_NONE) {
        code = get(w, row->left, &left, &ignored);
        child[0] = left.order;
    }
    if (code == MN_OK && row->right != MN_NONE) {
        mni_place place = {n->at, row->leaf_hi, {0}};
        memcpy(place.position, row->position, sizeof place.position);
        code = get_child(w, row, row->right, &place, right);
        child[1] = right->order;
    }
    if (code == MN_OK)
        code =
            mni_row_check(&w->limits, n->at, row, n->position, row->left != MN_NONE ? &left : NULL,
                          row->right != MN_NONE ? right : NULL, &w->why);
    if (code == MN_OK)
        code = tell(w, n->at);
    if (code != MN_OK)
        return code;
    mni_found_leaf(&w->found, n->at, row->position);
    mni_found_node(&w->found, row->order, n->depth);
    if (w->sink->row != NULL)
        code = w->sink->row(w->sink->context, n->at, row, child);
    return code == MN_OK ? give_simplices(w, n->at, row, end) : code;
}

/* ---- the way -------------------------------------------------------------------------------- */

static bool is_wanted(const walk *w, uint32_t order) {
    return w->desc->wanted == NULL || w->desc->wanted(w->sink->context, order);
}

/* From a node, which is safe, down its left side. */
static mn_code go_down(walk *w, node n, mni_row row) {
    mn_code code = push(w, &n);
    while (code == MN_OK && row.left != MN_NONE) {
        const mni_row parent = row;
        mni_place place = {parent.leaf_lo, n.at, {0}};
        memcpy(place.position, n.position, sizeof place.position);
        n.at = parent.left;
        n.depth++;
        code = get_child(w, &parent, n.at, &place, &row);
        if (code != MN_OK || !is_wanted(w, row.order))
            return code;
        code = push(w, &n);
    }
    return code;
}

/* All that is below a root. */
static mn_code walk_root(walk *w, const mni_row_root *root, const float position[3]) {
    node n = {.at = root->row};
    mni_row row, right;
    mni_place place = {root->leaf_lo, root->leaf_hi, {0}};
    uint32_t simplex_end;
    memcpy(n.position, position, sizeof n.position);
    memcpy(place.position, position, sizeof place.position);
    mn_code code = get(w, n.at, &row, &simplex_end);
    if (code == MN_OK)
        code = mni_row_safe(&w->limits, n.at, &row, simplex_end, &place, w->limits.nodes, &w->why);
    if (code == MN_OK)
        code = mni_row_check_values(&row, &w->why);
    if (code == MN_OK)
        code = go_down(w, n, row);
    while (code == MN_OK && w->inside > 0) {
        n = w->stack[--w->inside];
        code = give_node(w, &n, &row, &right);
        if (code != MN_OK || row.right == MN_NONE || !is_wanted(w, right.order))
            continue;
        n.at = row.right;
        n.depth++;
        memcpy(n.position, row.position, sizeof n.position);
        code = go_down(w, n, right);
    }
    return code;
}

static mn_code walk_all(walk *w) {
    uint32_t roots = 0, simplex_end;
    mn_code code = MN_OK;
    for (uint32_t lo = 0; lo < w->head.leaves && code == MN_OK; roots++) {
        mni_row first;
        mni_row_root root;
        code = get(w, lo, &first, &simplex_end);
        if (code == MN_OK)
            code = mni_row_check_first(&w->limits, lo, &first, simplex_end, &w->why);
        if (code == MN_OK)
            code = mni_row_root_of(&w->rows, &w->limits, lo, &root, &w->why);
        if (code != MN_OK)
            break;
        mni_found_leaf(&w->found, lo, first.position);
        if (w->sink->row != NULL)
            code = w->sink->row(w->sink->context, lo, &first, NULL);
        if (code == MN_OK && root.row != MN_NONE)
            code = walk_root(w, &root, first.position);
        lo = root.leaf_hi;
    }
    if (code != MN_OK || w->desc->wanted != NULL)
        return code;
    if (roots != w->head.roots)
        return mn_fail(&w->why, MN_BAD_INPUT, "%u roots where %u were promised", roots,
                       w->head.roots);
    return mni_found_check(&w->found, &w->head, &w->why);
}

mn_code mni_vdt_walk(const mn_vdt *vdt, const mni_walk_desc *desc, const mni_walk_sink *sink,
                     mn_status *st) {
    mn_status own = {0};
    const mni_rows_source source = mni_vdt_source(vdt);
    walk w = {.desc = desc,
              .sink = sink,
              .name = source.name != NULL ? source.name : "temporary file",
              .head = *mn_vdt_head(vdt),
              .limits = mni_row_limits_of(mn_vdt_head(vdt), mn_vdt_has_colors(vdt)),
              .st = st != NULL ? st : &own};
    mni_found_none(&w.found);
    w.found.depth_max = 1; /* of a single vertex */
    mn_code code = open_rows(&w, &source);
    if (code == MN_OK)
        code = walk_all(&w);
    const mn_code reading = mni_rows_trouble(&w.rows, w.st);
    if (reading != MN_OK)
        code = reading;
    else if (w.why.code != MN_OK)
        code = mn_fail(w.st, w.why.code, "%s: %s; the file is damaged: simplify again", w.name,
                       w.why.text);
    mni_rows_close(&w.rows);
    free(w.stack);
    return code;
}
