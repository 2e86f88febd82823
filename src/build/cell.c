/* See cell.h. Hidden here: how records become a surface, and back.
 *
 *   records ──► surface, judge, witnesses ──► a stage ──► collapses, killed simplices, records
 *
 * Order of a run: place, load, look (first round), work, give back. */
#include "cell.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "assert.h"

typedef struct run {
    mni_cell *cell;
    const mni_cell_desc *desc;
    mni_simplifier s;
    uint32_t triangles; /* of the cell's simplices; they stand first */
} run;

/* ---- loading ---- */

static uint32_t witnesses_of(const mni_cell_vertex *v) {
    uint32_t count = 0;
    while (count < MNI_WITNESSES && v->witness.slack[count] >= 0)
        count++;
    return count;
}

static bool is_leaf(const mni_cell_vertex *v) {
    return v->node < MNI_COLLAPSE;
}

static mn_code take_room(run *r, mn_status *st) {
    const mni_cell *cell = r->cell;
    uint32_t n = cell->vertices, leaves = 0, points = r->triangles;
    for (uint32_t v = 0; v < n; v++) {
        leaves += is_leaf(&cell->vertex[v]);
        points += r->desc->first ? 0 : witnesses_of(&cell->vertex[v]);
    }
    mn_code code =
        mni_surface_room(&r->s.surface, n, r->triangles, cell->simplices - r->triangles, st);
    if (code == MN_OK)
        code = mni_judge_room(&r->s.judge, n, r->triangles, st);
    if (code == MN_OK)
        code = mni_witness_room(&r->s.witness, n, n - leaves + leaves / 2, points, st);
    if (code == MN_OK)
        code = mni_simplify_room(&r->s, n);
    if (code != MN_OK)
        return code;
    r->s.part.closed = malloc(n * sizeof *r->s.part.closed);
    r->s.part.key = malloc(n * sizeof *r->s.part.key);
    r->s.part.id = malloc(n * sizeof *r->s.part.id);
    r->s.made.key = malloc(n * sizeof *r->s.made.key);
    if (r->s.part.closed == NULL || r->s.part.id == NULL || r->s.part.key == NULL ||
        r->s.made.key == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for %u vertices", n);
    return MN_OK;
}

static void load_simplices(run *r) {
    const mni_cell *cell = r->cell;
    r->s.surface.is_part = true;
    for (uint32_t x = 0; x < cell->simplices; x++) {
        const mni_cell_simplex *from = &cell->simplex[x];
        mni_simplex *to = &r->s.surface.simplex[x];
        for (int c = 0; c < 3; c++)
            to->v[c] = from->at[c];
        to->killed = MN_NONE;
        memcpy(&r->s.surface.origin[3 * (size_t)x], from->origin, sizeof from->origin);
        if (x < r->triangles)
            memcpy(&r->s.judge.normal[3 * (size_t)x], from->normal, sizeof from->normal);
    }
}

/* Witnesses of a leaf are points of its own, those of a node a set. */
static void load_witnesses(run *r, const mni_cell_vertex *from, uint32_t v) {
    mni_witness_book *book = &r->s.witness;
    book->own_start[v + 1] = book->own_start[v];
    if (!is_leaf(from)) {
        r->s.surface.vertex[v].set = book->sets_count;
        book->sets[book->sets_count++] = from->witness;
        return;
    }
    for (uint32_t i = 0; i < witnesses_of(from); i++) {
        float *to = book->own[book->own_start[v + 1]++];
        to[0] = from->witness.x[i];
        to[1] = from->witness.y[i];
        to[2] = from->witness.z[i];
    }
}

static void load_vertices(run *r) {
    const mni_cell *cell = r->cell;
    for (uint32_t v = 0; v < cell->vertices; v++) {
        const mni_cell_vertex *from = &cell->vertex[v];
        const double *q = from->quadric;
        r->s.surface.vertex[v] = (mni_vertex){.p = {from->p[0], from->p[1], from->p[2]},
                                              .value = from->value,
                                              .set = MN_NONE,
                                              .node = from->ghost ? MN_NONE : v};
        r->s.part.closed[v] = from->border || from->ghost ? 0 : MNI_HEAP_KEY_NONE;
        r->s.part.key[v] = from->key;
        r->s.part.id[v] = from->id;
        mni_vertex *to = &r->s.surface.vertex[v];
        if (r->desc->first)
            continue;
        to->c = q[0], to->xx = q[1], to->yy = q[2], to->zz = q[3];
        to->xy = q[4], to->xz = q[5], to->yz = q[6];
        to->x = q[7], to->y = q[8], to->z = q[9];
        load_witnesses(r, from, v);
    }
}

/* Of leaves all is found in their triangles. */
static void look_at_leaves(run *r) {
    mni_cell *cell = r->cell;
    mni_judge_fill(&r->s.judge, &r->s.surface);
    mni_witness_fill(&r->s.witness, &r->s.surface);
    for (uint32_t x = 0; x < r->triangles; x++)
        memcpy(cell->simplex[x].normal, &r->s.judge.normal[3 * (size_t)x],
               sizeof cell->simplex[x].normal);
    for (uint32_t v = 0; v < cell->vertices; v++) {
        cell->vertex[v].leaves = cell->vertex[v].levels = 1;
        if (!cell->vertex[v].ghost)
            cell->vertex[v].bounds = mni_leaf_bounds(&r->s.surface, r->s.judge.normal, v);
    }
    mni_simplify_look(&r->s);
}

/* ---- giving back ---- */

/* What is known of a node: where its vertex stands, what is below it, and its bounds. */
typedef struct node {
    uint32_t vertex, leaves, split, levels;
    mni_node_bounds bounds;
} node;

/* Of a collapse made here, what its record does not say. */
typedef struct made_node {
    uint32_t vertex, levels;
} made_node;

static node node_of(const mni_cell *cell, const made_node *made, uint32_t n) {
    if (n < cell->vertices) {
        const mni_cell_vertex *v = &cell->vertex[n];
        return (node){n, v->leaves, v->split, v->levels, v->bounds};
    }
    const mni_cell_collapse *c = &cell->collapse[n - cell->vertices];
    const made_node *m = &made[n - cell->vertices];
    return (node){m->vertex, c->left_leaves + c->right_leaves, c->left_leaves, m->levels,
                  c->bounds};
}

static mn_code give_collapses(run *r, mn_status *st) {
    mni_cell *cell = r->cell;
    const mni_collapses *made = &r->s.made;
    uint32_t m = cell->vertices;
    cell->collapse = calloc(made->count + 1, sizeof *cell->collapse);
    made_node *of = malloc((made->count + 1) * sizeof *of);
    if (cell->collapse == NULL || of == NULL) {
        free(of);
        return mn_fail(st, MN_FAILED, "out of memory for %u collapses", made->count);
    }
    cell->collapses = made->count;
    for (uint32_t i = 0; i < made->count; i++) {
        uint32_t left = made->left[i], right = made->right[i];
        node a = node_of(cell, of, left), b = node_of(cell, of, right);
        mni_cell_collapse *c = &cell->collapse[i];
        of[i] = (made_node){a.vertex, 1 + (a.levels > b.levels ? a.levels : b.levels)};
        *c = (mni_cell_collapse){
            .left = left < m ? cell->vertex[left].node : MNI_COLLAPSE + left - m,
            .right = right < m ? cell->vertex[right].node : MNI_COLLAPSE + right - m,
            .left_made = left >= m,
            .right_made = right >= m,
            .left_value = made->value[left],
            .right_value = made->value[right],
            .left_leaves = a.leaves,
            .right_leaves = b.leaves,
            .left_split = a.split,
            .right_split = b.split,
            .key = made->key[i],
            .bounds = mni_parent_bounds(r->s.surface.vertex[a.vertex].p, a.bounds,
                                        r->s.surface.vertex[b.vertex].p, b.bounds)};
    }
    /* A vertex's node from now on. */
    for (uint32_t v = 0; v < m; v++) {
        uint32_t n = r->s.surface.vertex[v].node;
        if (n == MN_NONE || n < m)
            continue;
        const mni_cell_collapse *c = &cell->collapse[n - m];
        mni_cell_vertex *to = &cell->vertex[v];
        to->node = MNI_COLLAPSE + n - m;
        to->made = true;
        to->leaves = c->left_leaves + c->right_leaves;
        to->split = c->left_leaves;
        to->levels = of[n - m].levels;
        to->bounds = c->bounds;
    }
    free(of);
    return MN_OK;
}

/* By collapse, in each as they stand. */
static mn_code give_killed(run *r, mn_status *st) {
    mni_cell *cell = r->cell;
    const mni_surface *s = &r->s.surface;
    for (uint32_t x = 0; x < s->simplices; x++)
        if (s->simplex[x].killed != MN_NONE) {
            cell->collapse[s->simplex[x].killed].simplices++;
            cell->killed_count++;
        }
    uint32_t *start = malloc((cell->collapses + 1) * sizeof *start);
    cell->killed = malloc((cell->killed_count + 1) * sizeof *cell->killed);
    if (start == NULL || cell->killed == NULL) {
        free(start);
        return mn_fail(st, MN_FAILED, "out of memory for %u simplices", cell->killed_count);
    }
    uint32_t at = 0;
    for (uint32_t i = 0; i < cell->collapses; i++) {
        start[i] = at;
        at += cell->collapse[i].simplices;
    }
    for (uint32_t x = 0; x < s->simplices; x++)
        if (s->simplex[x].killed != MN_NONE)
            memcpy(cell->killed[start[s->simplex[x].killed]++], &s->origin[3 * (size_t)x],
                   sizeof *cell->killed);
    free(start);
    return MN_OK;
}

static void store_points(const mni_witness_book *book, uint32_t v, mni_witnesses *to) {
    uint32_t start = book->own_start[v], count = book->own_start[v + 1] - start;
    for (uint32_t i = 0; i < MNI_WITNESSES; i++) {
        bool is = i < count; /* a pole's others are let go */
        to->x[i] = is ? book->own[start + i][0] : 0;
        to->y[i] = is ? book->own[start + i][1] : 0;
        to->z[i] = is ? book->own[start + i][2] : 0;
        to->slack[i] = is ? 0 : -1;
    }
}

static void give_vertex(run *r, uint32_t v, mni_cell_vertex *to) {
    const mni_vertex *from = &r->s.surface.vertex[v];
    const double q[10] = {from->c,  from->xx, from->yy, from->zz, from->xy,
                          from->xz, from->yz, from->x,  from->y,  from->z};
    *to = r->cell->vertex[v];
    to->value = from->value;
    to->key = r->s.part.key[v];
    to->border = false;
    memcpy(to->quadric, q, sizeof q);
    if (from->set != MN_NONE)
        to->witness = r->s.witness.sets[from->set];
    else if (r->desc->first)
        store_points(&r->s.witness, v, &to->witness);
}

/* Simplices that are left, with the ids of their vertices, and where these are. Those at a ghost
 * with a lesser id are its cell's affair. */
static mn_code give_simplices(run *r, mn_status *st) {
    mni_cell *cell = r->cell;
    const mni_surface *s = &r->s.surface;
    uint32_t *place = r->s.made.left; /* not needed any more: a vertex: where it will stand */
    uint32_t next = 0;
    for (uint32_t v = 0; v < cell->vertices; v++)
        place[v] = s->vertex[v].node != MN_NONE ? next++ : MN_NONE;
    if (s->simplices > cell->simplices_room) {
        mni_cell_simplex *more = realloc(cell->simplex, s->simplices * sizeof *more);
        if (more == NULL)
            return mn_fail(st, MN_FAILED, "out of memory for %u simplices", s->simplices);
        cell->simplex = more;
        cell->simplices_room = s->simplices;
    }
    uint32_t kept = 0, before = cell->simplices;
    for (uint32_t x = 0; x < s->simplices; x++) {
        const uint32_t *v = s->simplex[x].v;
        cell->hinges += x >= before;
        if (s->simplex[x].killed != MN_NONE)
            continue;
        uint32_t least = 0;
        for (uint32_t c = 1; c < 3; c++)
            if (v[c] != MN_NONE && cell->vertex[v[c]].id < cell->vertex[v[least]].id)
                least = c;
        if (cell->vertex[v[least]].ghost)
            continue;
        mni_cell_simplex *to = &cell->simplex[kept];
        if (x < before)
            *to = cell->simplex[x];
        else
            *to = (mni_cell_simplex){.id = MNI_COLLAPSE + x - before, .made = true};
        for (int c = 0; c < 3; c++) {
            bool is = v[c] != MN_NONE;
            to->v[c] = is ? cell->vertex[v[c]].id : MN_NONE;
            to->at[c] = is ? place[v[c]] : MN_NONE;
            if (is)
                memcpy(to->p[c], s->vertex[v[c]].p, sizeof to->p[c]);
        }
        memcpy(to->origin, &s->origin[3 * (size_t)x], sizeof to->origin);
        kept++;
    }
    cell->simplices = kept;
    return MN_OK;
}

static void give_vertices(run *r) {
    mni_cell *cell = r->cell;
    uint32_t kept = 0;
    for (uint32_t v = 0; v < cell->vertices; v++)
        if (r->s.surface.vertex[v].node != MN_NONE)
            give_vertex(r, v, &cell->vertex[kept++]);
    cell->vertices = kept;
}

/* ---- the run ---- */

static mn_code work(run *r) {
    mn_code code = MN_OK;
    int last = r->desc->whole ? 4 : r->desc->stage;
    for (int stage = r->desc->stage; stage <= last && stage <= 3 && code == MN_OK; stage++)
        code = mni_simplify_stage(&r->s, stage);
    if (last < 4 || code != MN_OK)
        return code;
    uint32_t roots = r->cell->vertices - r->s.made.count;
    if (r->desc->stage < 4)
        r->s.counts.components = roots;
    return mni_simplify_roots(&r->s, r->desc->whole ? 1 : 1 + roots / 4);
}

mn_code mni_cell_run(mni_cell *cell, const mni_cell_desc *desc, mn_status *st) {
    run r = {.cell = cell, .desc = desc, .s = {.desc = {.metric = desc->metric}, .st = st}};
    while (r.triangles < cell->simplices && cell->simplex[r.triangles].v[2] != MN_NONE)
        r.triangles++;
    mn_code code = take_room(&r, st);
    if (code == MN_OK) {
        load_vertices(&r);
        load_simplices(&r);
        mni_surface_index(&r.s.surface);
        if (desc->first)
            look_at_leaves(&r);
        if (!desc->whole && desc->stage == 1 && desc->share < 1)
            code = mni_simplify_limit(&r.s, desc->share);
    }
    if (code == MN_OK) {
        code = work(&r);
    }
    if (code == MN_OK) {
        mni_simplify_settle(&r.s);
        code = give_collapses(&r, st);
    }
    if (code == MN_OK)
        code = give_killed(&r, st);
    if (code == MN_OK)
        code = give_simplices(&r, st);
    if (code == MN_OK) {
        give_vertices(&r);
        cell->counts = r.s.counts;
    }
    mni_simplify_close(&r.s);
    return code;
}

static void number(uint32_t *what, bool made, uint32_t before) {
    if (made)
        *what += before;
}

void mni_cell_number(mni_cell *cell, uint32_t collapses, uint32_t hinges) {
    for (uint32_t i = 0; i < cell->collapses; i++) {
        number(&cell->collapse[i].left, cell->collapse[i].left_made, collapses);
        number(&cell->collapse[i].right, cell->collapse[i].right_made, collapses);
    }
    for (uint32_t v = 0; v < cell->vertices; v++) {
        number(&cell->vertex[v].node, cell->vertex[v].made, collapses);
        cell->vertex[v].made = false;
    }
    for (uint32_t x = 0; x < cell->simplices; x++) {
        number(&cell->simplex[x].id, cell->simplex[x].made, hinges);
        cell->simplex[x].made = false;
    }
}
