/* A tree's full detail beside a mesh on disk, both larger than memory.
 *
 * Hides: how two meshes are compared whose vertices are numbered differently. Positions go onto the
 * tree's grid and are sorted; equal ones get one number, and each side must have as many there.
 * Triangles become three such numbers with the least first, both sides are sorted, and gone through
 * side by side.
 *
 *   mesh  ─► vertices ─┐                  ┌─► number of each vertex ─► triangles, sorted ─┐
 *                      ├─ sorted by place ┤                                               ├─ equal?
 *   tree ──► leaves ───┘                  └─► number of each leaf ───► triangles, sorted ─┘
 *
 * Numbers are asked for through a few pages: triangles lie along a curve on one side, and leaf by
 * leaf on the other. Hinges, of which there are few, are sorted too; of the mesh's edges only those
 * that share a bit with a hinge in a small table are. One thread. Memory: work_bytes, of which half
 * is free while the tree tells. Paper: none. */
#include "against.h"

#include <stdlib.h>
#include <string.h>
#define XXH_INLINE_ALL
#include <xxhash.h>

#include "extsort.h"
#include "exttriangles.h"
#include "grid.h"
#include "mn_assert.h"
#include "pages.h"
#include "simplify.h"
#include "watch.h"

enum {
    BUFFER_BYTES = 32 << 10,
    PAGE_BYTES = 1 << 10, /* of a table of numbers */
    SHARES = 16,
};

/* A vertex or a leaf by its place: the bits of its coordinates on the grid, then which side it is
 * of, then a hash of where it was before. As words of the sort's key, low one first. */
typedef struct point {
    uint32_t y, x, side_and_hash, z;
    uint32_t id;
} point;
_Static_assert(sizeof(point) == 20, "no padding");
#define OF_TREE (UINT32_C(1) << 31)

/* Numbers of positions, the least first; index: which triangle it is. The key, low half last. */
typedef struct face {
    uint64_t a_b, c_index;
} face;

typedef struct hinge {
    uint64_t ends; /* numbers of positions, the lesser first, in the high half */
    uint32_t leaf[2];
} hinge;

typedef struct number { /* of a vertex or leaf: a record of a sort by id */
    uint64_t id_number;
} number;

struct mni_against {
    mni_against_desc desc;
    mn_status *st;
    mni_extmesh mesh;
    mni_sort *points, *faces_of_tree, *faces_of_mesh, *hinges, *edges;
    mni_spill vertex_numbers, leaf_numbers;
    mni_arena arena;      /* of the pages */
    mni_pages pages;      /* of the numbers that are asked for */
    uint64_t *filter;     /* a bit for a hash of each hinge's ends */
    uint32_t filter_bits; /* of the hash */
    uint64_t merged;
    uint32_t simplices;
    unsigned char buffer[BUFFER_BYTES];
};

static uint64_t share(const mni_against *a, uint32_t parts) {
    return a->desc.work_bytes / SHARES * parts;
}

static mn_code open_sort(mni_against *a, mni_sort **sort, uint32_t record_bytes, mni_sort_key key,
                         uint32_t parts, uint32_t parts_after) {
    const uint64_t least = MNI_SORT_BUDGET_MIN, after = share(a, parts_after);
    const uint64_t budget = share(a, parts);
    return mni_sort_open(sort,
                         &(mni_sort_desc){.record_bytes = record_bytes,
                                          .key = key,
                                          .budget_bytes = budget > least ? budget : least,
                                          .after_bytes = after > least ? after : least,
                                          .temp_dir = a->desc.temp_dir},
                         a->st);
}

static void close_sort(mni_sort **sort) {
    mni_sort_close(*sort);
    *sort = NULL;
}

static mn_code tell(const mni_against *a, uint64_t done, uint64_t total) {
    return mni_watch_each(&a->desc.watch, "comparing", done, total, a->st);
}

/* ---- open ----------------------------------------------------------------------------------- */

static mn_code read_mesh(mni_against *a, mn_weld weld, mni_extmesh *mesh) {
    const mni_extmesh_desc desc = {.work_bytes = a->desc.work_bytes,
                                   .cap = {.beside_bytes = MNI_PROGRAM_BYTES},
                                   .temp_dir = a->desc.temp_dir,
                                   .watch = a->desc.watch};
    mn_read_desc read = a->desc.read;
    read.weld = weld;
    return mni_extmesh_read(a->desc.input, &read, &desc, mesh, a->st);
}

/* Welded or not: whichever has as many vertices as the tree. */
static mn_code choose_mesh(mni_against *a) {
    mn_code code = read_mesh(a, a->desc.read.weld, &a->mesh);
    mni_extmesh apart = {.vertex.fd = -1, .triangle.fd = -1};
    if (code != MN_OK || !a->desc.either_weld || a->mesh.vertices == a->desc.leaves)
        return code;
    code = read_mesh(a, MN_WELD_OFF, &apart);
    if (code == MN_OK && apart.vertices == a->desc.leaves) {
        mni_extmesh_close(&a->mesh);
        a->mesh = apart;
        return MN_OK;
    }
    mni_extmesh_close(&apart);
    return code;
}

static void put_point(mni_against *a, const float at[3], uint32_t side_and_hash, uint32_t id) {
    point p = {.side_and_hash = side_and_hash, .id = id};
    memcpy(&p.x, &at[0], sizeof p.x);
    memcpy(&p.y, &at[1], sizeof p.y);
    memcpy(&p.z, &at[2], sizeof p.z);
    mni_sort_put(a->points, &p);
}

static mn_code put_vertices(mni_against *a) {
    mni_spill_reader r;
    const mni_extvertex *v;
    mn_code code = MN_OK;
    mni_spill_reader_open(&r, &a->mesh.vertex, 0, a->mesh.vertex.size_bytes, a->buffer,
                          sizeof a->buffer, false);
    for (uint32_t id = 0; code == MN_OK && (v = mni_spill_take(&r, sizeof *v)) != NULL; id++) {
        const uint32_t hash = (uint32_t)XXH3_64bits(v->position, sizeof v->position) & ~OF_TREE;
        float at[3];
        for (int i = 0; i < 3; i++) {
            const double from_origin = v->position[i] + (a->mesh.origin[i] - a->desc.origin[i]);
            const double step = a->desc.grid_step;
            at[i] = (float)(step > 0 ? rint(from_origin / step) * step : from_origin) + 0.0f;
        }
        put_point(a, at, hash, id);
        code = tell(a, id, a->mesh.vertices);
    }
    return code == MN_OK && a->mesh.vertex.trouble.code != MN_OK
               ? mn_fail(a->st, a->mesh.vertex.trouble.code, "%s", a->mesh.vertex.trouble.text)
               : code;
}

mn_code mni_against_open(mni_against **out, const mni_against_desc *desc, mn_status *st) {
    mni_against *a = calloc(1, sizeof *a);
    *out = a;
    if (a == NULL)
        return mn_fail(st, MN_FAILED, "no memory to compare");
    MN_ASSERT(desc->work_bytes >= MNI_AGAINST_WORK_MIN);
    a->desc = *desc;
    a->st = st;
    a->mesh.vertex.fd = a->mesh.triangle.fd = a->vertex_numbers.fd = a->leaf_numbers.fd = -1;
    mn_code code = choose_mesh(a);
    if (code == MN_OK && (a->mesh.vertices != desc->leaves || a->mesh.triangles != desc->triangles))
        code = mn_fail(st, MN_BAD_INPUT,
                       "%s: holds %u vertices and %u triangles, the input %llu and %llu",
                       desc->name, desc->leaves, desc->triangles,
                       (unsigned long long)a->mesh.vertices, (unsigned long long)a->mesh.triangles);
    if (code == MN_OK)
        code = open_sort(a, &a->points, sizeof(point), MNI_SORT_U128, 7, 2);
    return code == MN_OK ? put_vertices(a) : code;
}

void mni_against_close(mni_against *a) {
    if (a == NULL)
        return;
    mni_sort *const sorts[] = {a->points, a->faces_of_tree, a->faces_of_mesh, a->hinges, a->edges};
    for (size_t i = 0; i < sizeof sorts / sizeof *sorts; i++)
        mni_sort_close(sorts[i]);
    mni_extmesh_close(&a->mesh);
    mni_spill_close(&a->vertex_numbers);
    mni_spill_close(&a->leaf_numbers);
    mni_arena_close(&a->arena);
    free(a->filter);
    free(a);
}

/* ---- places --------------------------------------------------------------------------------- */

mn_code mni_against_leaf(mni_against *a, uint32_t leaf, const float position[3]) {
    const float at[3] = {position[0] + 0.0f, position[1] + 0.0f, position[2] + 0.0f};
    put_point(a, at, OF_TREE, leaf);
    return MN_OK;
}

static mn_code no_vertex(const mni_against *a, const point *p) {
    float at[3];
    memcpy(&at[0], &p->x, sizeof p->x);
    memcpy(&at[1], &p->y, sizeof p->y);
    memcpy(&at[2], &p->z, sizeof p->z);
    return mn_fail(a->st, MN_BAD_INPUT, "%s: leaf %u at (%.9g %.9g %.9g) is no vertex of the input",
                   a->desc.name, p->id, at[0], at[1], at[2]);
}

/* Numbers places in their order, and each vertex and leaf with that of its place. */
static mn_code number_places(mni_against *a, mni_sort *of_vertex, mni_sort *of_leaf) {
    const point *p;
    point last = {0};
    uint64_t places = 0, here = 0; /* here: vertices of this place, less its leaves */
    mn_code code = MN_OK;
    for (uint64_t done = 0; code == MN_OK && (p = mni_sort_next(a->points, a->st)) != NULL;
         done++) {
        const bool same = done > 0 && p->x == last.x && p->y == last.y && p->z == last.z;
        const bool is_leaf = (p->side_and_hash & OF_TREE) != 0;
        places += done > 0 && !same;
        here = same ? here : 0;
        a->merged += same && !is_leaf && p->side_and_hash != last.side_and_hash;
        last = *p;
        mni_sort_put(is_leaf ? of_leaf : of_vertex,
                     &(number){(uint64_t)p->id << 32 | (uint32_t)places});
        if (is_leaf && here-- == 0)
            return no_vertex(a, p);
        here += !is_leaf;
        code = tell(a, done, 2 * a->mesh.vertices);
    }
    return a->st->code;
}

/* Numbers by id, as a table in a file. */
static mn_code write_table(mni_against *a, mni_sort *numbers, mni_spill *to) {
    mni_spill_writer w;
    const number *n;
    mn_code code = mni_sort_finish(numbers, a->st);
    if (code == MN_OK)
        code = mni_spill_open(to, a->desc.temp_dir, a->st);
    if (code != MN_OK)
        return code;
    mni_spill_writer_open(&w, to, a->buffer, sizeof a->buffer);
    while ((n = mni_sort_next(numbers, a->st)) != NULL)
        mni_spill_put(&w, &(uint32_t){(uint32_t)n->id_number}, sizeof(uint32_t));
    code = mni_spill_end(&w);
    if (code != MN_OK)
        return mn_fail(a->st, code, "%s", to->trouble.text);
    return a->st->code;
}

static mn_code open_pages(mni_against *a, mni_spill *table, uint32_t parts) {
    const uint64_t wanted = share(a, parts);
    const uint64_t budget = wanted > MNI_PAGES_BUDGET_MIN ? wanted : MNI_PAGES_BUDGET_MIN;
    mni_arena_close(&a->arena);
    mn_code code = mni_arena_open(&a->arena, budget, a->st);
    if (code == MN_OK)
        mni_pages_open(&a->pages, table, sizeof(uint32_t), PAGE_BYTES, a->mesh.vertices, &a->arena,
                       budget);
    return code;
}

static mn_code open_filter(mni_against *a) {
    a->filter_bits = 12;
    while (a->filter_bits < 30 && UINT64_C(1) << a->filter_bits < 16 * (uint64_t)a->desc.hinges &&
           UINT64_C(2) << a->filter_bits <= 8 * share(a, 1) / 4)
        a->filter_bits++;
    a->filter = calloc((UINT64_C(1) << a->filter_bits) / 64, sizeof *a->filter);
    return a->filter != NULL ? MN_OK : mn_fail(a->st, MN_FAILED, "no memory to compare hinges");
}

mn_code mni_against_match(mni_against *a) {
    mni_sort *of_vertex = NULL, *of_leaf = NULL;
    mn_code code = mni_sort_finish(a->points, a->st);
    if (code == MN_OK)
        code = open_sort(a, &of_vertex, sizeof(number), MNI_SORT_U64, 5, 2);
    if (code == MN_OK)
        code = open_sort(a, &of_leaf, sizeof(number), MNI_SORT_U64, 5, 2);
    if (code == MN_OK)
        code = number_places(a, of_vertex, of_leaf);
    close_sort(&a->points);
    if (code == MN_OK)
        code = write_table(a, of_vertex, &a->vertex_numbers);
    if (code == MN_OK)
        code = write_table(a, of_leaf, &a->leaf_numbers);
    close_sort(&of_vertex);
    close_sort(&of_leaf);
    if (code == MN_OK)
        code = open_sort(a, &a->faces_of_tree, sizeof(face), MNI_SORT_U128, 4, 2);
    if (code == MN_OK && a->desc.hinges > 0)
        code = open_sort(a, &a->hinges, sizeof(hinge), MNI_SORT_U64, 1, 1);
    if (code == MN_OK && a->desc.hinges > 0)
        code = open_filter(a);
    return code == MN_OK ? open_pages(a, &a->leaf_numbers, 2) : code;
}

/* ---- triangles and hinges ------------------------------------------------------------------- */

/* false: the table cannot be read. */
static bool look_up(mni_against *a, const uint32_t *id, uint32_t count, uint32_t *found) {
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *at = mni_pages_at(&a->pages, id[i], false);
        if (at == NULL)
            return false;
        found[i] = *at;
    }
    return true;
}

static mn_code table_trouble(const mni_against *a) {
    return mn_fail(a->st, a->pages.spill->trouble.code, "%s", a->pages.spill->trouble.text);
}

/* Turned: the least first; of two least, the one before. */
static face face_of(const uint32_t n[3], uint32_t index) {
    int k = n[0] <= n[1] && n[0] <= n[2] ? 0 : n[1] <= n[2] ? 1 : 2;
    if (n[k] == n[(k + 2) % 3] && n[k] != n[(k + 1) % 3])
        k = (k + 2) % 3;
    return (face){(uint64_t)n[k] << 32 | n[(k + 1) % 3], (uint64_t)n[(k + 2) % 3] << 32 | index};
}

static uint64_t ends_of(uint32_t a, uint32_t b) {
    return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

static uint64_t filter_bit(const mni_against *a, uint64_t ends) {
    return XXH3_64bits(&ends, sizeof ends) >> (64 - a->filter_bits);
}

mn_code mni_against_simplex(mni_against *a, const uint32_t corner[3]) {
    const bool is_hinge = corner[2] == MN_NONE;
    uint32_t n[3];
    if (is_hinge && a->hinges == NULL)
        return mn_fail(a->st, MN_BAD_INPUT,
                       "%s: a hinge (leaves %u %u), and its header counts none", a->desc.name,
                       corner[0], corner[1]);
    if (!look_up(a, corner, is_hinge ? 2 : 3, n))
        return table_trouble(a);
    if (is_hinge) {
        const hinge h = {ends_of(n[0], n[1]), {corner[0], corner[1]}};
        const uint64_t bit = filter_bit(a, h.ends);
        a->filter[bit / 64] |= UINT64_C(1) << bit % 64;
        mni_sort_put(a->hinges, &h);
    } else {
        const face f = face_of(n, a->simplices);
        mni_sort_put(a->faces_of_tree, &f);
    }
    a->simplices++;
    return MN_OK;
}

/* The mesh's edges between those ends, as often as they come. */
static void put_edges(mni_against *a, const uint32_t n[3]) {
    for (int k = 0; k < 3; k++) {
        const uint64_t ends = ends_of(n[k], n[(k + 1) % 3]), bit = filter_bit(a, ends);
        if (a->filter[bit / 64] >> bit % 64 & 1)
            mni_sort_put(a->edges, &ends);
    }
}

static mn_code put_triangles(mni_against *a) {
    mni_exttriangles r;
    const mni_exttriangle *t;
    uint32_t index = 0, n[3];
    mn_code code = MN_OK;
    mni_exttriangles_open(&r, &a->mesh, a->buffer, sizeof a->buffer);
    for (; code == MN_OK && (t = mni_exttriangles_next(&r)) != NULL; index++) {
        if (!look_up(a, t->corner, 3, n))
            return table_trouble(a);
        const face f = face_of(n, index);
        mni_sort_put(a->faces_of_mesh, &f);
        if (a->desc.hinges > 0)
            put_edges(a, n);
        code = tell(a, index, a->mesh.triangles);
    }
    return code == MN_OK && index != a->mesh.triangles
               ? mn_fail(a->st, a->mesh.triangle.trouble.code, "%s", a->mesh.triangle.trouble.text)
               : code;
}

/* Names the mesh's triangle of that index, by where its corners are. */
static mn_code missing(mni_against *a, uint32_t index, uint64_t matched) {
    mni_exttriangles r;
    const mni_exttriangle *t = NULL;
    double at[3][3];
    mni_exttriangles_open(&r, &a->mesh, a->buffer, sizeof a->buffer);
    for (uint32_t i = 0; i <= index; i++)
        t = mni_exttriangles_next(&r);
    for (int k = 0; k < 3; k++) {
        mni_extvertex v = {0};
        if (t != NULL)
            mni_spill_read_at(&a->mesh.vertex, t->corner[k] * sizeof v, &v, sizeof v);
        for (int i = 0; i < 3; i++)
            at[k][i] = v.position[i] + a->mesh.origin[i];
    }
    return mn_fail(a->st, MN_BAD_INPUT,
                   "%s: a triangle of the input, (%.9g %.9g %.9g) (%.9g %.9g %.9g) (%.9g %.9g "
                   "%.9g), is not in full detail; %llu of %u are",
                   a->desc.name, at[0][0], at[0][1], at[0][2], at[1][0], at[1][1], at[1][2],
                   at[2][0], at[2][1], at[2][2], (unsigned long long)matched, a->desc.triangles);
}

/* -1, 0, 1: the first is less, equal, greater. */
static int compare_faces(const face *x, const face *y) {
    if (x->a_b != y->a_b)
        return x->a_b < y->a_b ? -1 : 1;
    const uint32_t c = (uint32_t)(x->c_index >> 32), d = (uint32_t)(y->c_index >> 32);
    return c < d ? -1 : c > d;
}

/* As many on both sides, so it is enough that each of the mesh's has its like. */
static mn_code compare_sides(mni_against *a, uint64_t *matched) {
    uint32_t first = MN_NONE; /* of the mesh's that have not */
    mn_code code = mni_sort_finish(a->faces_of_mesh, a->st);
    if (code != MN_OK)
        return code;
    const face *of_mesh = mni_sort_next(a->faces_of_mesh, a->st);
    const face *of_tree = mni_sort_next(a->faces_of_tree, a->st);
    for (uint64_t done = 0; of_mesh != NULL && code == MN_OK; done++) {
        while (of_tree != NULL && compare_faces(of_tree, of_mesh) < 0)
            of_tree = mni_sort_next(a->faces_of_tree, a->st);
        if (of_tree != NULL && compare_faces(of_tree, of_mesh) == 0) {
            of_tree = mni_sort_next(a->faces_of_tree, a->st);
            ++*matched;
        } else if ((uint32_t)of_mesh->c_index < first) {
            first = (uint32_t)of_mesh->c_index;
        }
        of_mesh = mni_sort_next(a->faces_of_mesh, a->st);
        code = tell(a, done, a->mesh.triangles);
    }
    if (a->st->code != MN_OK)
        return a->st->code;
    return first == MN_NONE ? MN_OK : missing(a, first, *matched);
}

static mn_code compare_hinges(mni_against *a) {
    mn_code code = mni_sort_finish(a->edges, a->st);
    if (code != MN_OK)
        return code;
    const uint64_t *edge = mni_sort_next(a->edges, a->st);
    const hinge *h;
    while ((h = mni_sort_next(a->hinges, a->st)) != NULL) {
        while (edge != NULL && *edge < h->ends)
            edge = mni_sort_next(a->edges, a->st);
        if (edge == NULL || *edge != h->ends)
            return a->st->code != MN_OK
                       ? a->st->code
                       : mn_fail(a->st, MN_BAD_INPUT,
                                 "%s: a hinge (leaves %u %u) is no edge of the input", a->desc.name,
                                 h->leaf[0], h->leaf[1]);
    }
    return a->st->code;
}

mn_code mni_against_end(mni_against *a, mn_verify_result *out) {
    const bool has_hinges = a->desc.hinges > 0;
    mn_code code = mni_sort_finish(a->faces_of_tree, a->st);
    if (code == MN_OK && has_hinges)
        code = mni_sort_finish(a->hinges, a->st);
    if (code == MN_OK)
        code = open_pages(a, &a->vertex_numbers, 3);
    if (code == MN_OK)
        code = open_sort(a, &a->faces_of_mesh, sizeof(face), MNI_SORT_U128, has_hinges ? 5 : 8, 2);
    if (code == MN_OK && has_hinges)
        code = open_sort(a, &a->edges, sizeof(uint64_t), MNI_SORT_U64, 3, 1);
    if (code == MN_OK)
        code = put_triangles(a);
    mni_arena_close(&a->arena);
    if (code == MN_OK)
        code = compare_sides(a, &out->matched_triangles);
    if (code == MN_OK && has_hinges)
        code = compare_hinges(a);
    out->merged_positions = a->merged;
    return code;
}
