/* The mesh of a front of the tree.
 *
 * Hides: how a front is found. A prefix front needs the order ids alone. A settled front is found
 * as the navigator finds it: from the roots, splitting what is wanted and first, whole, what a
 * split waits for (design.md §2). Order: mn_tree_extract alone. One thread. Memory: 4 bytes a leaf,
 * and for a settled front 24 bytes a simplex and 9 a node, freed before it returns. Paper: §2.2
 * (implicit dependencies). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "tree.h"

/* ---- settled fronts ------------------------------------------------------------------------- */

/* Corner c of simplex s is at 3s + c: the "seat" of an active node there. The seats at one node are
 * on a list that only grows until the node splits, at its end: who walks it misses nothing. */
typedef struct front {
    const mn_tree *tree;
    uint32_t *node;         /* seat: active node there */
    uint32_t *next;         /* seat */
    uint32_t *first, *last; /* node: its list; MN_NONE: empty */
    unsigned char *split;   /* inner: has been split */
    struct waiting {
        uint32_t node, seat;
    } * stack; /* splits that wait for others: rising order ids */
} front;

static uint32_t leaf_lo(const mn_tree *t, uint32_t order) {
    return order < t->leaves ? order : t->leaf_lo[order - t->leaves];
}

static void append(front *f, uint32_t node, uint32_t seat) {
    f->node[seat] = node;
    f->next[seat] = MN_NONE;
    if (f->first[node] == MN_NONE)
        f->first[node] = seat;
    else
        f->next[f->last[node]] = seat;
    f->last[node] = seat;
}

static uint32_t root_of(const mn_tree *t, uint32_t leaf) {
    uint32_t lo = 0, hi = t->roots - 1;
    while (lo < hi) {
        uint32_t middle = (lo + hi + 1) / 2;
        if (leaf_lo(t, t->root[middle]) <= leaf)
            lo = middle;
        else
            hi = middle - 1;
    }
    return t->root[lo];
}

static uint32_t active_at(const front *f, uint32_t leaf) {
    const mn_tree *t = f->tree;
    uint32_t node = root_of(t, leaf);
    while (node >= t->leaves && f->split[node - t->leaves]) {
        uint32_t i = node - t->leaves;
        node = leaf < t->leaf_mid[i] ? t->left[i] : t->right[i];
    }
    return node;
}

static void split_now(front *f, uint32_t i) {
    const mn_tree *t = f->tree;
    uint32_t node = t->leaves + i;
    f->split[i] = 1;
    for (uint32_t seat = f->first[node], next; seat != MN_NONE; seat = next) {
        next = f->next[seat];
        append(f, t->corner[seat] < t->leaf_mid[i] ? t->left[i] : t->right[i], seat);
    }
    for (uint32_t s = t->simplex_start[i]; s < t->simplex_start[i + 1]; s++)
        for (uint32_t c = 0; c < 3; c++) {
            uint32_t seat = 3 * s + c, leaf = t->corner[seat];
            if (leaf != MN_NONE)
                append(f, active_at(f, leaf), seat);
        }
}

/* The first node from that seat on, on the way round its list, that node must wait for; the seat
 * where it was met is where to go on from. */
static uint32_t blocker(const front *f, uint32_t node, uint32_t *seat) {
    for (; *seat != MN_NONE; *seat = f->next[*seat]) {
        uint32_t s = *seat / 3;
        for (uint32_t c = 0; c < 3; c++)
            if (f->tree->corner[3 * s + c] != MN_NONE && f->node[3 * s + c] > node)
                return f->node[3 * s + c];
    }
    return MN_NONE;
}

static void split_forced(front *f, uint32_t i) {
    uint32_t depth = 0, node = f->tree->leaves + i;
    f->stack[depth++] = (struct waiting){node, f->first[node]};
    while (depth > 0) {
        struct waiting *top = &f->stack[depth - 1];
        uint32_t waits_for = blocker(f, top->node, &top->seat);
        if (waits_for == MN_NONE) {
            split_now(f, top->node - f->tree->leaves);
            depth--;
        } else {
            MN_ASSERT(depth < f->tree->inner); /* order ids rise along the stack */
            f->stack[depth++] = (struct waiting){waits_for, f->first[waits_for]};
        }
    }
}

static mn_code settle(const mn_tree *t, float error, unsigned char *split, mn_status *st) {
    size_t seats = 3 * (size_t)t->simplices + 1, nodes = (size_t)t->leaves + t->inner;
    front f = {.tree = t, .split = split};
    f.node = malloc(sizeof *f.node * seats);
    f.next = malloc(sizeof *f.next * seats);
    f.first = malloc(sizeof *f.first * nodes);
    f.last = malloc(sizeof *f.last * nodes);
    f.stack = malloc(sizeof *f.stack * ((size_t)t->inner + 1));
    mn_code code = MN_OK;
    if (f.node == NULL || f.next == NULL || f.first == NULL || f.last == NULL || f.stack == NULL) {
        code = mn_fail(st, MN_FAILED, "no memory for a front of %u simplices", t->simplices);
    } else {
        memset(f.first, 0xff, sizeof *f.first * nodes);
        /* parents come before children: they have higher order ids, and are wanted too */
        for (uint32_t i = t->inner; i-- > 0;)
            if (t->switch_value[i] > error && !split[i])
                split_forced(&f, i);
    }
    free(f.node);
    free(f.next);
    free(f.first);
    free(f.last);
    free(f.stack);
    return code;
}

/* ---- prefix fronts -------------------------------------------------------------------------- */

uint32_t mni_tree_prefix(const mn_tree *t, uint64_t triangles) {
    uint64_t left = t->triangles;
    uint32_t made = 0;
    for (; made < t->inner && left > triangles; made++)
        for (uint32_t s = t->simplex_start[made]; s < t->simplex_start[made + 1]; s++)
            left -= t->corner[3 * (size_t)s + 2] != MN_NONE;
    return made;
}

/* ---- from a front to a mesh ----------------------------------------------------------------- */

/* leaf → active node. Nodes from the top down: the first that covers a leaf and is not split. */
static void fill_owners(const mn_tree *t, const unsigned char *split, uint32_t *owner) {
    memset(owner, 0xff, sizeof *owner * t->leaves);
    for (uint32_t i = t->inner; i-- > 0;)
        if (!split[i] && owner[t->leaf_lo[i]] == MN_NONE)
            for (uint32_t v = t->leaf_lo[i]; v < t->leaf_hi[i]; v++)
                owner[v] = t->leaves + i;
    for (uint32_t v = 0; v < t->leaves; v++)
        if (owner[v] == MN_NONE)
            owner[v] = v;
}

/* The triangle's active nodes; false: a hinge, or two are one. */
static bool image(const mn_tree *t, const uint32_t *owner, uint32_t s, uint32_t node[3]) {
    const uint32_t *c = t->corner + 3 * (size_t)s;
    if (c[2] == MN_NONE)
        return false;
    for (int k = 0; k < 3; k++)
        node[k] = owner[c[k]];
    return node[0] != node[1] && node[1] != node[2] && node[2] != node[0];
}

/* Numbers the nodes that have triangles, by leaf_lo: number[leaf_lo] = vertex, MN_NONE elsewhere.
 */
static void count_mesh(const mn_tree *t, const uint32_t *owner, uint32_t *number, mn_mesh *out) {
    memset(number, 0xff, sizeof *number * t->leaves);
    for (uint32_t s = 0; s < t->simplices; s++) {
        uint32_t node[3];
        if (!image(t, owner, s, node))
            continue;
        out->triangles++;
        for (int k = 0; k < 3; k++)
            number[leaf_lo(t, node[k])] = 0;
    }
    for (uint32_t v = 0; v < t->leaves; v++)
        if (number[v] != MN_NONE)
            number[v] = out->vertices++;
}

static void *room(size_t count, size_t size) {
    return malloc(count > 0 ? count * size : 1);
}

static mn_code make_mesh(const mn_tree *t, const uint32_t *owner, uint32_t *number, mn_mesh *out,
                         uint32_t **active, mn_status *st) {
    count_mesh(t, owner, number, out);
    out->grid_step = t->grid_step;
    memcpy(out->origin, t->origin, sizeof out->origin);
    out->intake.input_faces = out->triangles;
    out->position = room(3 * (size_t)out->vertices, sizeof *out->position);
    out->color = t->leaf_color != NULL ? room(out->vertices, sizeof *out->color) : NULL;
    out->corner = room(3 * (size_t)out->triangles, sizeof *out->corner);
    uint32_t *ids = room(out->vertices, sizeof *ids);
    if (out->position == NULL || out->corner == NULL || ids == NULL ||
        (t->leaf_color != NULL && out->color == NULL)) {
        free(ids);
        return mn_fail(st, MN_FAILED, "no memory for a mesh of %u triangles", out->triangles);
    }
    for (uint32_t v = 0; v < t->leaves; v++) {
        uint32_t to = number[v];
        if (to == MN_NONE)
            continue;
        memcpy(out->position + 3 * (size_t)to, t->leaf_position + 3 * (size_t)v,
               3 * sizeof *out->position);
        if (out->color != NULL)
            out->color[to] = t->leaf_color[v];
        ids[to] = owner[v];
    }
    uint32_t *corner = out->corner;
    for (uint32_t s = 0; s < t->simplices; s++) {
        uint32_t node[3];
        if (image(t, owner, s, node))
            for (int k = 0; k < 3; k++)
                *corner++ = number[leaf_lo(t, node[k])];
    }
    if (active != NULL)
        *active = ids;
    else
        free(ids);
    return MN_OK;
}

mn_code mn_tree_extract(const mn_tree *t, const mn_extract_desc *desc, mn_mesh *out,
                        uint32_t **owner, mn_status *st) {
    memset(out, 0, sizeof *out);
    if (owner != NULL)
        *owner = NULL;
    if (desc->what == MN_EXTRACT_ERROR && !(desc->error >= 0))
        return mn_fail(st, MN_USAGE, "an error of %g: it is a length, 0 or more", desc->error);
    unsigned char *split = calloc((size_t)t->inner + 1, 1);
    uint32_t *of_leaf = malloc(sizeof *of_leaf * t->leaves);
    uint32_t *number = malloc(sizeof *number * t->leaves);
    mn_code code = MN_OK;
    if (split == NULL || of_leaf == NULL || number == NULL) {
        code = mn_fail(st, MN_FAILED, "no memory for a front of %u vertices", t->leaves);
    } else if (desc->what == MN_EXTRACT_ERROR) {
        /* the grid has its share; less than that no front has */
        code = settle(t, fmaxf(desc->error - mn_grid_error(t->grid_step), 0), split, st);
    } else {
        uint32_t made = desc->what == MN_EXTRACT_FULL ? 0 : mni_tree_prefix(t, desc->triangles);
        memset(split + made, 1, t->inner - made);
    }
    if (code == MN_OK) {
        fill_owners(t, split, of_leaf);
        code = make_mesh(t, of_leaf, number, out, owner, st);
    }
    free(split);
    free(of_leaf);
    free(number);
    if (code != MN_OK)
        mn_mesh_free(out);
    return code;
}
