/* A run of the simplifier: what it needs is taken, its stages follow each other, and what they made
 * becomes a tree. simplify.c has the stages, and their order of collapses.
 *
 * Hides: which meshes are simplified in one piece and which in rounds, through files, and in what
 * unit (unit.h). Order of calls, of whoever runs stages by himself, as a cell does (cell.c): room,
 * look, stages, settle, close. One thread. Memory: the sum in mn_simplify_need_bytes
 * (need_simplify.c), taken at the start but for hinges and packing. Paper: §2.1.1 and §3.1. */
#include "simplify.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "mem.h"
#include "mn_assert.h"
#include "rounds.h"
#include "unit.h"

/* So that squares of distances fit in a float, in which switch values are measured. */
#define COORDINATE_MAX 1e18f

/* An edge between two parts is counted by that of its lesser end; one at a frozen hub by that of
 * the other. */
static bool counts_edge(const mni_simplifier *s, uint32_t v, uint32_t w) {
    const uint32_t *id = s->part.id;
    const mni_vertex *vertex = s->surface.vertex;
    if (vertex[v].hub || vertex[w].hub)
        return vertex[vertex[v].hub ? w : v].node != MN_NONE;
    return id == NULL || s->surface.vertex[id[v] < id[w] ? v : w].node != MN_NONE;
}

/* One look at every ring: the input's edges are counted, and boundaries get their walls. */
void mni_simplify_look(mni_simplifier *s) {
    if (s->desc.metric == MN_METRIC_QEM)
        mni_quadrics_fill(&s->surface);
    for (uint32_t v = 0; v < s->surface.vertices; v++) {
        if (mni_judge_regular(&s->judge, &s->surface, v))
            continue;
        mni_judge_ring(&s->judge, &s->surface, v);
        for (uint32_t i = 0; i < s->judge.ring_count; i++) {
            const mni_ring_vertex *n = &s->judge.ring[i];
            if (s->judge.around[i] < v)
                continue;
            if (counts_edge(s, v, s->judge.around[i])) {
                s->counts.boundary_edges += n->triangles == 1;
                s->counts.nonmanifold_edges +=
                    n->triangles > 2 || (n->triangles == 2 && n->balance != 0);
            }
            if (n->triangles == 1 && s->desc.metric == MN_METRIC_QEM) {
                mni_quadric_wall(&s->surface, v, s->judge.around[i]);
                mni_quadric_wall(&s->surface, s->judge.around[i], v);
            }
        }
    }
}

mn_code mni_simplify_room(mni_simplifier *s, uint32_t n) {
    s->made.left = mni_mem_take((size_t)n * sizeof *s->made.left, 0);
    s->made.right = mni_mem_take((size_t)n * sizeof *s->made.right, 0);
    s->made.value = mni_mem_take(2 * (size_t)n * sizeof *s->made.value, 0);
    s->leaf_bounds = mni_mem_take((size_t)n * sizeof *s->leaf_bounds, 0);
    if (!mni_heap_open(&s->heap, n) || s->made.left == NULL || s->made.right == NULL ||
        s->made.value == NULL || s->leaf_bounds == NULL)
        return mn_fail(s->st, MN_FAILED, "out of memory for %u vertices", n);
    s->keys = mni_collapse_keys_best();
    s->look.vertex = MN_NONE;
    for (uint32_t i = 0; i < MNI_NEXTS; i++)
        s->next[i].vertex = MN_NONE;
    s->legal_last = n - 1;
    return MN_OK;
}

static mn_code open_run(mni_simplifier *s) {
    mn_code code = mni_surface_open(&s->surface, s->mesh, s->st);
    if (code == MN_OK)
        code = mni_judge_open(&s->judge, &s->surface, s->st);
    if (code == MN_OK)
        code = mni_witness_open(&s->witness, &s->surface, s->st);
    if (code == MN_OK)
        code = mni_simplify_room(s, s->mesh->vertices);
    if (code != MN_OK)
        return code;
    for (uint32_t v = 0; v < s->mesh->vertices; v++)
        s->leaf_bounds[v] = mni_leaf_bounds(&s->surface, s->judge.normal, v);
    mni_simplify_look(s);
    return MN_OK;
}

void mni_simplify_close(mni_simplifier *s) {
    mni_surface_close(&s->surface);
    mni_judge_close(&s->judge);
    mni_witness_close(&s->witness);
    mni_heap_close(&s->heap);
    mni_hubs_close(&s->hubs);
    mni_mem_give(s->made.left);
    mni_mem_give(s->made.right);
    mni_mem_give(s->made.value);
    mni_mem_give(s->made.key);
    mni_mem_give(s->leaf_bounds);
    mni_mem_give(s->part.closed);
    mni_mem_give(s->part.ring);
    mni_mem_give(s->part.key);
    mni_mem_give(s->part.id);
}

void mni_simplify_settle(mni_simplifier *s) {
    for (uint32_t v = 0; v < s->surface.vertices; v++)
        if (s->surface.vertex[v].node != MN_NONE)
            s->made.value[s->surface.vertex[v].node] = s->surface.vertex[v].value;
}

static mn_code run(mni_simplifier *s) {
    mn_code code = open_run(s);
    for (int stage = 1; stage <= 3 && code == MN_OK && !s->stopped; stage++)
        code = mni_simplify_stage(s, stage);
    if (code != MN_OK || s->stopped)
        return code;
    MN_ASSERT(s->surface.alive_triangles == 0 && s->surface.alive_hinges == 0);
    s->counts.components = s->surface.vertices - s->made.count;
    code = mni_simplify_roots(s, 1);
    mni_simplify_settle(s);
    return code;
}

static mn_code simplify_whole(const mn_mesh *mesh, const mn_simplify_desc *desc, mn_tree *out,
                              mn_status *st) {
    mni_simplifier s = {.mesh = mesh, .desc = *desc, .st = st};
    mn_code code = run(&s);
    s.counts.rounds = 1;
    if (code == MN_OK && !s.stopped)
        code = mni_tree_make(&s, out);
    if (code == MN_OK) {
        out->counts = s.counts;
        out->intake = mesh->intake;
        out->metric = desc->metric;
        out->legal_last = s.legal_last;
        memcpy(out->origin, mesh->origin, sizeof out->origin);
    }
    mni_simplify_close(&s);
    return code;
}

/* Through files, as what does not fit in memory is. */
static mn_code simplify_in_rounds(const mn_mesh *mesh, const mn_simplify_desc *desc, mn_tree *out,
                                  mn_status *st) {
    uint64_t taken = mni_rounds_beside_bytes(mesh->vertices, mesh->triangles);
    mni_rounds_desc rounds = {.metric = desc->metric,
                              .cell_vertices = desc->cell_vertices,
                              .threads = desc->threads,
                              .cap.beside_bytes = taken,
                              .temp_dir = desc->temp_dir != NULL ? desc->temp_dir : ".",
                              .progress = desc->progress,
                              .progress_context = desc->progress_context};
    if (desc->ram_bytes > 0)
        rounds.work_bytes = desc->ram_bytes > taken ? desc->ram_bytes - taken : 1;
    mni_extmesh external = {.vertex.fd = -1, .triangle.fd = -1};
    mni_history history = MNI_HISTORY_CLOSED;
    uint32_t *vertex_of = malloc((size_t)mesh->vertices * sizeof *vertex_of);
    mn_code code = MN_OK;
    if (vertex_of == NULL)
        code = mn_fail(st, MN_FAILED, "out of memory for %u vertices", mesh->vertices);
    if (code == MN_OK)
        code = mni_extmesh_make(mesh, rounds.temp_dir, vertex_of, &external, st);
    if (code == MN_OK)
        code = mni_rounds(&external, &rounds, &history, st);
    if (code == MN_OK)
        code = mni_history_tree(&history, mesh, vertex_of, out, st);
    if (code == MN_OK)
        out->metric = desc->metric;
    mni_history_close(&history);
    mni_extmesh_close(&external);
    free(vertex_of);
    return code;
}

mn_code mn_simplify(const mn_mesh *mesh, const mn_simplify_desc *desc, mn_tree *out,
                    mn_status *st) {
    memset(out, 0, sizeof *out);
    mn_mesh own = *mesh;
    const int unit = mni_unit_of(mesh);
    const uint64_t copy_bytes = unit != 0 ? (uint64_t)mesh->vertices * 12 : 0;
    uint64_t need = mn_simplify_need_bytes(mesh->vertices, mesh->triangles) + copy_bytes;
    if (desc->ram_bytes > 0 && need > desc->ram_bytes)
        return mn_fail(st, MN_CAP_TOO_SMALL,
                       "simplifying %u vertices and %u triangles needs --ram %lluM", mesh->vertices,
                       mesh->triangles, (unsigned long long)((need + (1u << 20) - 1) >> 20));
    if (mesh->vertices == 0 || mesh->triangles == 0)
        return mn_fail(st, MN_BAD_INPUT, "the mesh has no triangles");
    for (size_t i = 0; i < (size_t)mesh->vertices * 3; i++)
        if (!(fabsf(mesh->position[i]) <= COORDINATE_MAX))
            return mn_fail(st, MN_BAD_INPUT,
                           "vertex %zu lies %g from the origin; past %g scale the model down",
                           i / 3, (double)mesh->position[i], (double)COORDINATE_MAX);
    if (unit != 0 && !mni_unit_apply(mesh, unit, &own))
        return mn_fail(st, MN_FAILED, "out of memory for %u vertices", mesh->vertices);
    double started_s = mni_now_s();
    mn_simplify_desc left = *desc;
    left.ram_bytes -= desc->ram_bytes > 0 ? copy_bytes : 0;
    bool whole =
        left.ram_bytes == 0 || mni_whole_bytes(mesh->vertices, mesh->triangles) <= left.ram_bytes;
    mn_code code = desc->cell_vertices > 0 || !whole ? simplify_in_rounds(&own, &left, out, st)
                                                     : simplify_whole(&own, &left, out, st);
    if (unit != 0) {
        mni_unit_undo(out, unit);
        free(own.position);
    }
    if (code == MN_OK)
        out->counts.seconds_simplify = mni_now_s() - started_s;
    return code;
}
