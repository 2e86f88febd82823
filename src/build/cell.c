/* See cell.h. Hidden here: how records become a surface, and back. */
#include "cell.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "freeze.h"
#include "mem.h"
#include "mn_assert.h"

static const mni_frozen_table no_hubs;

/* Fewer simplices among hubs alone go on with the others, and are measured as they are. */
enum { ASIDE_LEAST = 2048 };

/* ---- opening -------------------------------------------------------------------------------- */

static mn_code no_memory(uint32_t vertices, mn_status *st) {
    return mn_fail(st, MN_FAILED, "out of memory for a cell of %u vertices", vertices);
}

static mni_cell_desc with_hubs(const mni_cell_desc *desc) {
    mni_cell_desc with = *desc;
    with.frozen = desc->frozen != NULL ? desc->frozen : &no_hubs;
    return with;
}

/* Room for all but the witnesses' points. */
static mn_code take_room(mni_cell *cell, uint32_t vertices, uint32_t triangles, uint32_t hinges,
                         mn_status *st) {
    mni_simplifier *s = &cell->s;
    cell->vertices = vertices;
    MN_ASSERT(cell->first_hub <= vertices);
    cell->triangles = triangles;
    cell->simplices = triangles + hinges;
    s->desc.metric = cell->desc.metric;
    s->st = st;
    cell->node = mni_mem_take_zeroed(vertices * sizeof *cell->node);
    mn_code code = mni_surface_room(&s->surface, vertices, triangles, hinges, st);
    if (code == MN_OK)
        code = mni_judge_room(&s->judge, vertices, triangles, st);
    if (code != MN_OK)
        return code;
    s->surface.is_part = true;
    s->part.slack = cell->desc.slack;
    s->part.rings = cell->desc.rings;
    s->part.carries = cell->desc.carries;
    s->part.closed = mni_mem_take(vertices * sizeof *s->part.closed, 0);
    s->part.ring = mni_mem_take(vertices * sizeof *s->part.ring, 0);
    s->part.key = mni_mem_take_zeroed(vertices * sizeof *s->part.key);
    s->part.id = mni_mem_take(vertices * sizeof *s->part.id, 0);
    if (cell->node == NULL || s->part.closed == NULL || s->part.ring == NULL ||
        s->part.id == NULL || s->part.key == NULL)
        return no_memory(vertices, st);
    return MN_OK;
}

/* A vertex before anything is known of it. */
static void place_vertex(mni_cell *cell, uint32_t v, uint32_t id, const float p[3]) {
    cell->node[v] = (mni_cell_node){.id = id, .node = id, .leaves = 1, .levels = 1};
    cell->s.surface.vertex[v] =
        (mni_vertex){.p = {p[0], p[1], p[2]}, .set = MN_NONE, .node = v < cell->own ? v : MN_NONE};
    cell->s.part.closed[v] = v < cell->own ? MNI_HEAP_KEY_NONE : 0;
    cell->s.part.ring[v] = INFINITY;
    cell->s.part.id[v] = id;
}

static void place_simplex(mni_cell *cell, uint32_t x, const uint32_t v[3],
                          const uint32_t origin[3]) {
    cell->s.surface.simplex[x] = (mni_simplex){{v[0], v[1], v[2]}, MN_NONE};
    memcpy(&cell->s.surface.origin[3 * (size_t)x], origin, 3 * sizeof *origin);
}

/* ---- as dealt ------------------------------------------------------------------------------- */

/* The cell's own vertices first, then ghosts, then hubs. */
static uint32_t stand_in_hand(const mni_cell *cell, const mni_hand *h, uint32_t id) {
    uint32_t hub = mni_frozen_find(cell->desc.frozen, id);
    if (hub != MN_NONE)
        return cell->first_hub + hub;
    if (id - h->first < h->vertices)
        return id - h->first;
    uint32_t low = 0, high = h->ghosts;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if (h->ghost[middle].id <= id)
            low = middle;
        else
            high = middle;
    }
    MN_ASSERT(low < h->ghosts && h->ghost[low].id == id);
    return h->vertices + low;
}

/* A hub's own place among the vertices stays empty. */
static void place_hubs(mni_cell *cell, const mni_hand *h) {
    for (uint32_t i = 0; i < cell->desc.frozen->count; i++) {
        const mni_wire_vertex *hub = &cell->desc.frozen->hub[i].is;
        place_vertex(cell, cell->first_hub + i, hub->id, hub->p);
        if (hub->id - h->first < h->vertices) {
            cell->s.surface.vertex[hub->id - h->first].node = MN_NONE;
            cell->s.part.closed[hub->id - h->first] = 0;
        }
    }
}

static void count_inside(mni_cell *cell, uint32_t vertices) {
    for (uint32_t v = 0; v < vertices; v++)
        cell->inside += cell->s.part.closed[v] != 0;
}

static void load_hand(mni_cell *cell, const mni_hand *h) {
    for (uint32_t v = 0; v < h->vertices; v++)
        place_vertex(cell, v, h->first + v, h->position[v]);
    for (uint32_t g = 0; g < h->ghosts; g++)
        place_vertex(cell, h->vertices + g, h->ghost[g].id, h->ghost[g].position);
    place_hubs(cell, h);
    for (uint32_t t = 0; t < h->triangles; t++) {
        uint32_t v[3];
        bool crosses = false;
        for (int c = 0; c < 3; c++) {
            v[c] = stand_in_hand(cell, h, h->triangle[t].corner[c]);
            crosses |= v[c] >= h->vertices && v[c] < cell->first_hub;
        }
        for (int c = 0; c < 3 && crosses; c++)
            cell->s.part.closed[v[c]] = 0;
        place_simplex(cell, t, v, h->triangle[t].corner);
    }
    count_inside(cell, h->vertices);
}

/* Whether a simplex at these vertices is the cell's. */
static bool belongs(const mni_cell *cell, const uint32_t v[3]) {
    uint32_t least = MN_NONE;
    for (uint32_t c = 0; c < 3 && v[c] != MN_NONE; c++)
        if (v[c] < cell->first_hub &&
            (least == MN_NONE || cell->s.part.id[v[c]] < cell->s.part.id[least]))
            least = v[c];
    return least == MN_NONE || least < cell->own;
}

/* Of hub h's triangles, those that are the cell's; of its edges, those to the cell's vertices. */
static void sum_up_hub(mni_cell *cell, uint32_t h, mni_wire_vertex *leaf) {
    mni_surface *s = &cell->s.surface;
    mni_vertex *vertex = &s->vertex[h];
    uint32_t count, points = 0;
    bool qem = cell->desc.metric == MN_METRIC_QEM;
    const uint32_t *fan = mni_surface_fan(s, h, &count);
    vertex->xx = vertex->xy = vertex->xz = vertex->yy = vertex->yz = vertex->zz = 0;
    *leaf = (mni_wire_vertex){.id = cell->node[h].id, .leaves = count};
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *c = s->simplex[fan[i]].v;
        if (!belongs(cell, c))
            continue;
        if (qem)
            mni_quadric_add_triangle(s, h, fan[i]);
        for (int x = 0; c[0] == h && points < MNI_WITNESSES && x < 3; x++) {
            float *to = x == 0 ? leaf->points.x : x == 1 ? leaf->points.y : leaf->points.z;
            to[points] = (s->vertex[c[0]].p[x] + s->vertex[c[1]].p[x] + s->vertex[c[2]].p[x]) / 3;
        }
        points += c[0] == h && points < MNI_WITNESSES;
    }
    for (uint32_t i = points; i < MNI_WITNESSES; i++)
        leaf->points.slack[i] = -1;
    mni_judge_ring(&cell->s.judge, s, h);
    for (uint32_t i = 0; i < cell->s.judge.ring_count && qem; i++)
        if (cell->s.judge.around[i] < cell->own && cell->s.judge.ring[i].triangles == 1)
            mni_quadric_wall(s, h, cell->s.judge.around[i]);
    const double quadric[] = {0,          vertex->xx, vertex->yy, vertex->zz, vertex->xy,
                              vertex->xz, vertex->yz, 0,          0,          0};
    memcpy(leaf->quadric, quadric, sizeof leaf->quadric);
    leaf->bounds = mni_leaf_bounds(s, cell->s.judge.normal, h);
}

static mn_code freeze_hubs(mni_cell *cell, mn_status *st) {
    for (uint32_t v = cell->first_hub; v < cell->vertices; v++)
        if (!mni_freeze(&cell->s, v, cell->desc.frozen->hub[v - cell->first_hub].around))
            return no_memory(cell->vertices, st);
    return MN_OK;
}

static mn_code sum_up_hubs(mni_cell *cell, mn_status *st) {
    uint32_t hubs = cell->vertices - cell->first_hub;
    cell->hub_leaf = mni_mem_take(((size_t)hubs + 1) * sizeof *cell->hub_leaf, 0);
    if (cell->hub_leaf == NULL)
        return no_memory(cell->vertices, st);
    for (uint32_t i = 0; i < hubs; i++)
        sum_up_hub(cell, cell->first_hub + i, &cell->hub_leaf[i]);
    return MN_OK;
}

mn_code mni_cell_open_dealt(mni_cell *cell, const mni_cell_desc *desc, const mni_hand *h,
                            mn_status *st) {
    *cell = (mni_cell){.desc = with_hubs(desc), .own = h->vertices};
    uint32_t vertices = h->vertices + h->ghosts + cell->desc.frozen->count;
    cell->first_hub = h->vertices + h->ghosts;
    mn_code code = take_room(cell, vertices, h->triangles, 0, st);
    if (code == MN_OK)
        code = mni_witness_room(&cell->s.witness, vertices, vertices / 2, h->triangles, st);
    if (code != MN_OK)
        return code;
    load_hand(cell, h);
    mni_surface_index(&cell->s.surface);
    mni_judge_fill(&cell->s.judge, &cell->s.surface);
    mni_witness_fill(&cell->s.witness, &cell->s.surface);
    for (uint32_t v = 0; v < cell->own; v++)
        cell->node[v].bounds = mni_leaf_bounds(&cell->s.surface, cell->s.judge.normal, v);
    code = freeze_hubs(cell, st);
    if (code != MN_OK)
        return code;
    mni_simplify_look(&cell->s);
    return sum_up_hubs(cell, st);
}

/* ---- as taken ------------------------------------------------------------------------------- */

/* Ids of a cell's vertices, hashed: open addresses, half of them free. */
typedef struct places {
    uint32_t *id; /* by vertex */
    uint32_t *at; /* index; MN_NONE: free */
    uint32_t mask, count;
    const mni_frozen_table *frozen;
} places;

static uint32_t place_hash(uint32_t id) {
    uint32_t i = id * 0x9e3779b1u;
    return i ^ i >> 15;
}

static uint32_t place_of(const places *p, uint32_t id) {
    for (uint32_t i = place_hash(id);; i++) {
        uint32_t at = p->at[i & p->mask];
        if (at == MN_NONE || p->id[at] == id)
            return at;
    }
}

/* The same, of a vertex or a hub. */
static uint32_t place_of_corner(const places *p, uint32_t id) {
    uint32_t at = place_of(p, id), hub = at == MN_NONE ? mni_frozen_find(p->frozen, id) : MN_NONE;
    return hub == MN_NONE ? at : p->count + hub;
}

static void places_close(places *p) {
    mni_mem_give(p->id);
    mni_mem_give(p->at);
}

static bool places_open(places *p, uint32_t count, const mni_frozen_table *frozen) {
    uint32_t room = 64;
    while (room < 2 * count)
        room *= 2;
    *p = (places){.id = mni_mem_take(((size_t)count + 1) * sizeof *p->id, 0),
                  .at = mni_mem_take(room * sizeof *p->at, 0),
                  .mask = room - 1,
                  .count = count,
                  .frozen = frozen};
    if (p->id == NULL || p->at == NULL)
        return false;
    memset(p->at, 0xff, room * sizeof *p->at);
    return true;
}

static void places_put(places *p, uint32_t v, uint32_t id) {
    uint32_t i = place_hash(id);
    while (p->at[i & p->mask] != MN_NONE)
        i++;
    p->at[i & p->mask] = v;
    p->id[v] = id;
}

/* A parcel that is being read. */
typedef struct opened {
    mni_parcel head;
    const unsigned char *ids, *vertices, *simplices, *sights;
    float step;
} opened;

static opened open_parcel(const unsigned char *parcel, float step) {
    opened o = {.step = step};
    memcpy(&o.head, parcel, sizeof o.head);
    o.ids = parcel + sizeof o.head;
    o.vertices = o.ids + o.head.ids_bytes;
    o.simplices = o.vertices + o.head.vertices_bytes;
    o.sights = o.simplices + o.head.simplices_bytes;
    return o;
}

static mni_wire_pen pen_of(const opened *o) {
    return mni_wire_pen_open(o->head.tile, o->step);
}

static void load_ids(places *p, const mni_crate *crate) {
    uint32_t v = 0;
    for (uint32_t i = 0; i < crate->parcels; i++) {
        opened o = open_parcel(crate->parcel[i], 0);
        mni_wire_pen pen = pen_of(&o);
        for (uint32_t n = 0; n < o.head.vertices; n++)
            places_put(p, v++, mni_wire_get_id(&pen, &o.ids));
    }
    MN_ASSERT(v == crate->vertices);
}

typedef enum kind { TRIANGLE, HINGE, PASSING, KINDS } kind;

/* Where its corners stand in the cell. */
static kind stand(const places *p, const mni_wire_simplex *x, uint32_t v[3]) {
    bool inside = true, hinge = x->v[2] == MN_NONE;
    for (int c = 0; c < 3; c++) {
        v[c] = x->v[c] == MN_NONE ? MN_NONE : place_of_corner(p, x->v[c]);
        inside &= v[c] != MN_NONE || (hinge && c == 2);
    }
    return !inside ? PASSING : hinge ? HINGE : TRIANGLE;
}

/* Calls with each simplex, and where it stands. */
static void each_simplex(mni_cell *cell, const mni_crate *crate, const places *p, float step,
                         uint32_t at[KINDS],
                         void (*what)(mni_cell *cell, uint32_t at, const mni_wire_simplex *x,
                                      const uint32_t v[3], kind k)) {
    for (uint32_t i = 0; i < crate->parcels; i++) {
        opened o = open_parcel(crate->parcel[i], step);
        mni_wire_pen pen = pen_of(&o);
        for (uint32_t n = 0; n < o.head.simplices; n++) {
            mni_wire_simplex x;
            uint32_t v[3];
            mni_wire_get_simplex(&pen, &o.simplices, &x);
            kind k = stand(p, &x, v);
            if (what != NULL)
                what(cell, at[k], &x, v, k);
            at[k]++;
        }
    }
}

static void load_simplex(mni_cell *cell, uint32_t at, const mni_wire_simplex *x,
                         const uint32_t v[3], kind k) {
    if (k == PASSING) {
        cell->passing[at] = (mni_cell_passing){*x, {v[0], v[1], v[2]}};
        return;
    }
    place_simplex(cell, at, v, x->origin);
    if (k == TRIANGLE)
        memcpy(&cell->s.judge.normal[3 * (size_t)at], x->normal, sizeof x->normal);
}

/* Witnesses of a leaf are points of its own, those of a node a set. */
static void load_witnesses(mni_cell *cell, const mni_wire_vertex *from, uint32_t v) {
    mni_witness_book *book = &cell->s.witness;
    book->own_start[v + 1] = book->own_start[v];
    if (from->node >= MNI_COLLAPSE) {
        cell->s.surface.vertex[v].set = book->sets_count;
        book->sets[book->sets_count++] = from->points;
        return;
    }
    for (uint32_t i = 0; i < MNI_WITNESSES && from->points.slack[i] >= 0; i++) {
        float *to = book->own[book->own_start[v + 1]++];
        to[0] = from->points.x[i];
        to[1] = from->points.y[i];
        to[2] = from->points.z[i];
    }
}

static void load_vertex(mni_cell *cell, uint32_t v, const mni_wire_vertex *from) {
    mni_vertex *to = &cell->s.surface.vertex[v];
    const double *q = from->quadric;
    place_vertex(cell, v, from->id, from->p);
    cell->node[v] = (mni_cell_node){.id = from->id,
                                    .node = from->node,
                                    .leaves = from->leaves,
                                    .split = from->split,
                                    .levels = from->levels,
                                    .bounds = from->bounds};
    to->value = from->value;
    to->c = q[0], to->xx = q[1], to->yy = q[2], to->zz = q[3];
    to->xy = q[4], to->xz = q[5], to->yz = q[6];
    to->x = q[7], to->y = q[8], to->z = q[9];
    cell->s.part.key[v] = from->key;
    load_witnesses(cell, from, v);
}

static void see(mni_cell *cell, const mni_crate *crate, uint32_t v, mni_wire_reach reach) {
    if (reach.low < crate->first_tile || reach.high >= crate->end_tile)
        cell->s.part.closed[v] = 0;
}

/* Those that see another cell are closed. */
static void load_vertices(mni_cell *cell, const mni_crate *crate, const places *p, float step) {
    uint32_t v = 0;
    for (uint32_t i = 0; i < crate->parcels; i++) {
        opened o = open_parcel(crate->parcel[i], step);
        mni_wire_pen pen = pen_of(&o);
        for (uint32_t n = 0; n < o.head.vertices; n++, v++) {
            mni_wire_vertex from;
            mni_wire_get_vertex(&pen, &o.vertices, p->id[v], &from);
            load_vertex(cell, v, &from);
            see(cell, crate, v, from.reach);
        }
    }
    for (uint32_t i = 0; i < crate->parcels; i++) {
        opened o = open_parcel(crate->parcel[i], step);
        mni_wire_pen pen = pen_of(&o);
        for (uint32_t n = 0; n < o.head.sights; n++) {
            mni_wire_sight s;
            mni_wire_get_sight(&pen, &o.sights, &s);
            see(cell, crate, place_of(p, s.id), s.reach);
        }
    }
}

/* Behind all others. Where they are carried they are as open as any, but nobody's. */
static void load_hubs(mni_cell *cell) {
    uint32_t hubs = cell->desc.frozen->count;
    for (uint32_t i = 0; i < hubs; i++) {
        uint32_t v = cell->vertices - hubs + i;
        load_vertex(cell, v, &cell->desc.frozen->hub[i].is);
        cell->s.surface.vertex[v].node = v;
        if (cell->desc.carries)
            cell->s.part.closed[v] = MNI_HEAP_KEY_NONE;
    }
}

static mn_code load_crate(mni_cell *cell, const mni_crate *crate, places *p, float step,
                          mn_status *st) {
    uint32_t count[KINDS] = {0, 0, 0}, hubs = cell->desc.frozen->count;
    uint32_t n = crate->vertices + hubs, leaves = crate->vertices - crate->nodes;
    uint32_t points = crate->points + MNI_WITNESSES * hubs;
    load_ids(p, crate);
    each_simplex(cell, crate, p, step, count, NULL);
    cell->passing_count = count[PASSING];
    cell->passing = mni_mem_take(((size_t)count[PASSING] + 1) * sizeof *cell->passing, 0);
    mn_code code = cell->passing != NULL ? take_room(cell, n, count[TRIANGLE], count[HINGE], st)
                                         : no_memory(n, st);
    if (code == MN_OK)
        code = mni_witness_room(&cell->s.witness, n, n - leaves + leaves / 2, points, st);
    if (code != MN_OK)
        return code;
    uint32_t at[KINDS] = {0, cell->triangles, 0};
    load_vertices(cell, crate, p, step);
    load_hubs(cell);
    each_simplex(cell, crate, p, step, at, load_simplex);
    mni_surface_index(&cell->s.surface);
    count_inside(cell, crate->vertices);
    return freeze_hubs(cell, st);
}

mn_code mni_cell_open_taken(mni_cell *cell, const mni_cell_desc *desc, const mni_crate *crate,
                            float step, mn_status *st) {
    places p;
    uint32_t n = crate->vertices;
    *cell = (mni_cell){.desc = with_hubs(desc)};
    cell->own = cell->first_hub = n + (desc->whole ? cell->desc.frozen->count : 0);
    mn_code code = places_open(&p, n, cell->desc.frozen) ? load_crate(cell, crate, &p, step, st)
                                                         : no_memory(n, st);
    places_close(&p);
    return code;
}

/* ---- what has been made --------------------------------------------------------------------- */

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
        const mni_cell_node *v = &cell->node[n];
        return (node){n, v->leaves, v->split, v->levels, v->bounds};
    }
    const mni_cell_collapse *c = &cell->collapse[n - cell->vertices];
    const made_node *m = &made[n - cell->vertices];
    return (node){m->vertex, c->left_leaves + c->right_leaves, c->left_leaves, m->levels,
                  c->bounds};
}

/* Numbers of collapses count from 0 here until the cell has been given its own. */
static mn_code keep_collapses(mni_cell *cell, mn_status *st) {
    const mni_collapses *made = &cell->s.made;
    const mni_vertex *vertex = cell->s.surface.vertex;
    uint32_t m = cell->vertices;
    bool endless = false; /* radii are rounded up at each level */
    cell->collapse = mni_mem_take_zeroed(((size_t)made->count + 1) * sizeof *cell->collapse);
    made_node *of = mni_mem_take(((size_t)made->count + 1) * sizeof *of, made->count * sizeof *of);
    if (cell->collapse == NULL || of == NULL) {
        mni_mem_give(of);
        return mn_fail(st, MN_FAILED, "out of memory for %u collapses", made->count);
    }
    cell->collapses = made->count;
    for (uint32_t i = 0; i < made->count; i++) {
        uint32_t left = made->left[i], right = made->right[i];
        node a = node_of(cell, of, left), b = node_of(cell, of, right);
        mni_cell_collapse *c = &cell->collapse[i];
        of[i] = (made_node){a.vertex, 1 + (a.levels > b.levels ? a.levels : b.levels)};
        *c = (mni_cell_collapse){.left = left, /* of the surface, until it has been numbered */
                                 .right = right,
                                 .left_value = made->value[left],
                                 .right_value = made->value[right],
                                 .left_leaves = a.leaves,
                                 .right_leaves = b.leaves,
                                 .left_split = a.split,
                                 .right_split = b.split,
                                 .key = made->key[i],
                                 .bounds = mni_parent_bounds(vertex[a.vertex].p, a.bounds,
                                                             vertex[b.vertex].p, b.bounds)};
        if (cell->desc.points) {
            c->left_value = fmaxf(c->left_value, a.bounds.radius);
            c->right_value = fmaxf(c->right_value, b.bounds.radius);
        }
        endless |= isinf(c->bounds.radius);
    }
    /* A vertex's node from now on. */
    for (uint32_t v = 0; v < cell->vertices; v++) {
        uint32_t n = vertex[v].node;
        if (n == MN_NONE || n < m)
            continue;
        const mni_cell_collapse *c = &cell->collapse[n - m];
        mni_cell_node *to = &cell->node[v];
        to->leaves = c->left_leaves + c->right_leaves;
        to->split = c->left_leaves;
        to->levels = of[n - m].levels;
        to->bounds = c->bounds;
    }
    mni_mem_give(of);
    return !endless ? MN_OK
                    : mn_fail(st, MN_BAD_INPUT,
                              "thousands of triangles without area follow each other: a tree of "
                              "them is too deep; leave them out, or, where the grid has "
                              "flattened them, try --position-bits 23");
}

/* By collapse, in each as they stand. */
static mn_code keep_killed(mni_cell *cell, mn_status *st) {
    const mni_surface *s = &cell->s.surface;
    for (uint32_t x = 0; x < s->simplices; x++)
        if (s->simplex[x].killed != MN_NONE) {
            cell->collapse[s->simplex[x].killed].simplices++;
            cell->killed_count++;
        }
    uint32_t *start = mni_mem_take(((size_t)cell->collapses + 1) * sizeof *start, 0);
    cell->killed = mni_mem_take(((size_t)cell->killed_count + 1) * sizeof *cell->killed, 0);
    if (start == NULL || cell->killed == NULL) {
        mni_mem_give(start);
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
    mni_mem_give(start);
    return MN_OK;
}

/* ---- the run -------------------------------------------------------------------------------- */

static mn_code work(mni_cell *cell) {
    mn_code code = MN_OK;
    const mni_cell_desc *desc = &cell->desc;
    int last = desc->whole ? 4 : desc->stage;
    for (int stage = desc->stage; stage <= last && stage <= 3 && code == MN_OK; stage++)
        code = mni_simplify_stage(&cell->s, stage);
    if (last < 4 || code != MN_OK)
        return code;
    uint32_t roots = cell->own - cell->s.made.count;
    if (desc->stage < 4)
        cell->s.counts.components = roots;
    return mni_simplify_roots(&cell->s, desc->whole ? 1 : 1 + roots / 4);
}

mn_code mni_cell_run(mni_cell *cell, mn_status *st) {
    mni_simplifier *s = &cell->s;
    s->st = st;
    s->poll = cell->desc.poll;
    mn_code code = mni_simplify_room(s, cell->vertices);
    s->made.key = mni_mem_take((size_t)cell->vertices * sizeof *s->made.key, 0);
    if (code == MN_OK && s->made.key == NULL)
        code = no_memory(cell->vertices, st);
    if (code == MN_OK)
        code = work(cell);
    if (code != MN_OK)
        return code;
    if (!cell->desc.rings && !cell->desc.whole && cell->desc.stage < 4)
        mni_simplify_count_waiting(s);
    memcpy(cell->could_go, s->part.could_go, sizeof cell->could_go);
    mni_simplify_settle(s);
    mni_heap_close(&s->heap); /* its room is wanted for what was made */
    cell->hinges = s->surface.simplices - cell->simplices;
    code = keep_collapses(cell, st);
    return code == MN_OK ? keep_killed(cell, st) : code;
}

/* A simplex that is the cell's own, is there still, and is joined to hubs alone. */
static bool is_hubs_own(const mni_cell *cell, uint32_t x) {
    const mni_simplex *is = &cell->s.surface.simplex[x];
    for (int c = 0; c < 3; c++)
        if (is->v[c] < cell->first_hub)
            return false;
    return is->killed == MN_NONE;
}

mn_code mni_cell_set_aside(mni_cell *cell, mn_status *st) {
    mni_surface *s = &cell->s.surface;
    uint32_t count = 0;
    for (uint32_t x = 0; x < s->simplices && !cell->desc.whole; x++)
        count += is_hubs_own(cell, x);
    if (count < ASIDE_LEAST)
        return MN_OK;
    cell->aside = mni_mem_take((size_t)count * sizeof *cell->aside, 0);
    if (cell->aside == NULL)
        return no_memory(cell->vertices, st);
    for (uint32_t x = 0; x < s->simplices; x++) {
        mni_aside_simplex *to = &cell->aside[cell->aside_count];
        if (!is_hubs_own(cell, x))
            continue;
        for (int c = 0; c < 3; c++) {
            uint32_t v = s->simplex[x].v[c];
            to->v[c] = v == MN_NONE ? MN_NONE : cell->node[v].id;
            to->origin[c] = s->origin[3 * (size_t)x + c];
        }
        s->simplex[x].killed = 0;
        cell->aside_count++;
    }
    return MN_OK;
}

void mni_cell_number(mni_cell *cell, uint32_t collapses) {
    cell->collapses_before = collapses;
    for (uint32_t i = 0; i < cell->collapses; i++) {
        uint32_t *of[2] = {&cell->collapse[i].left, &cell->collapse[i].right};
        for (int side = 0; side < 2; side++)
            *of[side] = *of[side] < cell->vertices
                            ? cell->node[*of[side]].node
                            : MNI_COLLAPSE + collapses + *of[side] - cell->vertices;
    }
}

void mni_cell_forget(mni_cell *cell) {
    mni_mem_give(cell->collapse);
    mni_mem_give(cell->killed);
    cell->collapse = NULL;
    cell->killed = NULL;
}

/* ---- what is left --------------------------------------------------------------------------- */

/* A pole's others are let go. */
static void leaf_points(const mni_witness_book *book, uint32_t v, mni_witnesses *to) {
    uint32_t start = book->own_start[v], count = book->own_start[v + 1] - start;
    for (uint32_t i = 0; i < MNI_WITNESSES; i++) {
        bool is = i < count;
        to->x[i] = is ? book->own[start + i][0] : 0;
        to->y[i] = is ? book->own[start + i][1] : 0;
        to->z[i] = is ? book->own[start + i][2] : 0;
        to->slack[i] = is ? 0 : -1;
    }
}

static void record_of(const mni_cell *cell, uint32_t v, mni_wire_vertex *out) {
    const mni_vertex *from = &cell->s.surface.vertex[v];
    const mni_cell_node *n = &cell->node[v];
    *out = (mni_wire_vertex){.id = n->id,
                             .node = from->node < cell->vertices
                                         ? n->node
                                         : MNI_COLLAPSE + cell->collapses_before + from->node -
                                               cell->vertices,
                             .p = {from->p[0], from->p[1], from->p[2]},
                             .value = from->value,
                             .key = cell->s.part.key[v],
                             .bounds = n->bounds,
                             .leaves = n->leaves,
                             .split = n->split,
                             .levels = n->levels,
                             .quadric = {from->c, from->xx, from->yy, from->zz, from->xy, from->xz,
                                         from->yz, from->x, from->y, from->z}};
    if (cell->desc.points)
        out->value = fmaxf(out->value, n->bounds.radius);
    if (from->set == MN_NONE)
        leaf_points(&cell->s.witness, v, &out->points);
    else
        out->points = cell->s.witness.sets[from->set];
}

bool mni_cell_vertex(const mni_cell *cell, uint32_t v, mni_wire_vertex *out) {
    if (v >= cell->own || cell->s.surface.vertex[v].node == MN_NONE)
        return false;
    record_of(cell, v, out);
    return true;
}

void mni_cell_tell_hubs(const mni_cell *cell, mni_frozen_table *to) {
    for (uint32_t v = cell->first_hub, i = 0; v < cell->vertices; v++, i++) {
        if (cell->hub_leaf != NULL && cell->hub_leaf[i].leaves > 0)
            mni_frozen_add(&to->hub[i], &cell->hub_leaf[i]);
        if (cell->desc.carries)
            record_of(cell, v, &to->hub[i].is);
        mni_frozen_raise(&to->hub[i], cell->s.surface.vertex[v].value,
                         mni_hubs_of(&cell->s.hubs, v)->key);
    }
    for (uint32_t i = 0; i < cell->aside_count; i++)
        for (int c = 0; c < 3 && cell->aside[i].v[c] != MN_NONE; c++)
            to->hub[mni_frozen_find(to, cell->aside[i].v[c])].aside = true;
}

bool mni_cell_has_simplex(const mni_cell *cell, uint32_t x) {
    return belongs(cell, cell->s.surface.simplex[x].v);
}

void mni_cell_simplex(const mni_cell *cell, uint32_t x, mni_wire_reach reach,
                      mni_wire_simplex *out) {
    const mni_surface *s = &cell->s.surface;
    const uint32_t *v = s->simplex[x].v;
    *out = (mni_wire_simplex){.reach = reach, .v[2] = MN_NONE};
    for (uint32_t c = 0; c < 3 && v[c] != MN_NONE; c++) {
        out->v[c] = cell->s.part.id[v[c]];
        if (reach.low < reach.high)
            memcpy(out->p[c], s->vertex[v[c]].p, sizeof out->p[c]);
    }
    memcpy(out->origin, &s->origin[3 * (size_t)x], sizeof out->origin);
    if (x < cell->triangles)
        memcpy(out->normal, &cell->s.judge.normal[3 * (size_t)x], sizeof out->normal);
}

enum { SMALL_BYTES = 192 << 10 }; /* scratch, and what is lost in pages that are not full */

/* sets: room for witnesses, of nodes and of those that leaves may become. read: what it is opened
 * from, with the ids' places; when that is gone, heap and collapses come, and when the heap is gone
 * what is told of collapses, and killed simplices. */
static uint64_t peak_bytes(uint64_t vertices, uint64_t simplices, uint64_t sets, uint64_t read) {
    uint64_t a_vertex =
        sizeof(mni_vertex) + sizeof(mni_cell_node) + 20 /* part */ + 8 /* seen */ + 16 /* pool */;
    uint64_t a_simplex = sizeof(mni_simplex) + 12 /* origin */ + 16 /* pool */ + 12 /* normal */;
    uint64_t made =
        vertices * (20 + sizeof(mni_cell_collapse) + 8 /* places */) + simplices * 12 /* killed */;
    return SMALL_BYTES + vertices * a_vertex + simplices * a_simplex +
           sets * sizeof(mni_witnesses) + (read > made ? read : made);
}

uint64_t mni_cell_bytes(uint64_t vertices, uint64_t simplices, uint64_t parcels) {
    return peak_bytes(vertices, simplices, vertices, parcels + vertices * (4 + 16));
}

uint64_t mni_cell_dealt_bytes(uint64_t vertices, uint64_t triangles) {
    uint64_t hand = vertices * sizeof(mni_ghost) + triangles * sizeof(mni_dealt_triangle) * 5 / 4;
    return peak_bytes(vertices, triangles, vertices / 2, hand) + triangles * 12 /* points */;
}

void mni_cell_close(mni_cell *cell) {
    mni_simplify_close(&cell->s);
    mni_mem_give(cell->node);
    mni_mem_give(cell->passing);
    mni_mem_give(cell->hub_leaf);
    mni_mem_give(cell->aside);
    mni_cell_forget(cell);
    *cell = (mni_cell){0};
}
