/* How honest and tight switch values are: mn_error_measure. Cuts a prefix front from the tree,
 * samples the input and measures exactly. One thread; memory: the front's triangles with their tree
 * of boxes, the input's, and 44 bytes a leaf, freed before it returns. (design.md §1, switch value)
 */
#include "metanode/build.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "distance.h"
#include "sampler.h"
#include "tree.h"
#include "watch.h"

#define SLACK 1e-7   /* of the diagonal: positions and switch values are floats */
#define VISIBLE 1e-6 /* of the diagonal: measured maxima below say nothing about tightness */
enum {
    NODE_SAMPLES_MIN = 100,
    SAMPLES_MIN = 1000000,
    SAMPLES_MAX = 16000000,
    SAMPLES_A_NODE = 120,
    WATCH_EVERY = 4096, /* samples */
};

/* What was measured at an active node. */
typedef struct found {
    double max;
    uint64_t samples;
} found;

typedef struct measure {
    const mn_tree *tree;
    uint32_t *owner;  /* leaf → active node's order id */
    uint32_t *corner; /* active triangles, then nodes without one as (v, v, v); leaf ids */
    uint64_t corners; /* triples in it */
    double diagonal;
    found *all, *near; /* a leaf: of the active node whose leaf_lo it is */
    mn_error_result *out;
} measure;

static uint32_t leaf_lo(const mn_tree *t, uint32_t node) {
    return node < t->leaves ? node : t->leaf_lo[node - t->leaves];
}

static double switch_value(const mn_tree *t, uint32_t node) {
    return node < t->leaves ? 0 : (double)t->switch_value[node - t->leaves];
}

/* Fills owner: the highest of the first `made` inner nodes above each leaf. In falling order, a
 * node's leaves that nobody has taken yet are its own. */
static void fill_owners(measure *m, uint32_t made) {
    const mn_tree *t = m->tree;
    for (uint32_t leaf = 0; leaf < t->leaves; leaf++)
        m->owner[leaf] = MN_NONE;
    for (uint32_t i = made; i-- > 0;) {
        if (m->owner[t->leaf_lo[i]] != MN_NONE)
            continue; /* below an active node */
        m->out->nodes++;
        for (uint32_t leaf = t->leaf_lo[i]; leaf < t->leaf_hi[i]; leaf++)
            m->owner[leaf] = t->leaves + i;
    }
    for (uint32_t leaf = 0; leaf < t->leaves; leaf++)
        if (m->owner[leaf] == MN_NONE) {
            m->owner[leaf] = leaf;
            m->out->nodes++;
        }
}

/* The front's triangles; all->samples marks the nodes that have one. */
static void fill_corners(measure *m, uint32_t made) {
    const mn_tree *t = m->tree;
    for (uint64_t s = t->simplex_start[made]; s < t->simplices; s++) {
        const uint32_t *from = t->corner + 3 * s;
        if (from[2] == MN_NONE)
            continue;
        uint32_t *to = m->corner + 3 * m->corners++;
        for (int i = 0; i < 3; i++) {
            to[i] = leaf_lo(t, m->owner[from[i]]);
            m->all[to[i]].samples = 1;
        }
        MN_ASSERT(to[0] != to[1] && to[1] != to[2] && to[2] != to[0]);
    }
    m->out->triangles = m->corners;
    for (uint32_t leaf = 0; leaf < t->leaves; leaf++) {
        if (leaf_lo(t, m->owner[leaf]) != leaf)
            continue;
        if (m->all[leaf].samples == 0) {
            uint32_t *to = m->corner + 3 * m->corners++;
            to[0] = to[1] = to[2] = leaf;
        }
        m->all[leaf].samples = 0;
    }
}

static double diagonal_of(const mn_tree *t) {
    double sum = 0;
    for (int a = 0; a < 3; a++) {
        float low = FLT_MAX, high = -FLT_MAX;
        for (uint32_t leaf = 0; leaf < t->leaves; leaf++) {
            float x = t->leaf_position[3 * (uint64_t)leaf + (uint64_t)a];
            low = x < low ? x : low;
            high = x > high ? x : high;
        }
        sum += ((double)high - low) * ((double)high - low);
    }
    return sqrt(sum);
}

static void count_at(const mn_tree *t, found *where, uint32_t node, double measured) {
    found *f = &where[leaf_lo(t, node)];
    f->max = measured > f->max ? measured : f->max;
    f->samples++;
}

/* One sample on input triangle `corner`. */
static void take_sample(measure *m, const uint32_t corner[3], const double weight[3],
                        double measured) {
    const mn_tree *t = m->tree;
    mn_error_result *r = m->out;
    double bound = 0;
    int nearest = 0;
    for (int i = 0; i < 3; i++) {
        uint32_t node = m->owner[corner[i]];
        double value = switch_value(t, node);
        bound = value > bound ? value : bound;
        nearest = weight[i] > weight[nearest] ? i : nearest;
        bool seen =
            (i > 0 && node == m->owner[corner[0]]) || (i > 1 && node == m->owner[corner[1]]);
        if (!seen)
            count_at(t, m->all, node, measured);
    }
    count_at(t, m->near, m->owner[corner[nearest]], measured);
    r->samples++;
    r->bound_mean += bound;
    r->measured_mean += measured;
    r->bound_max = bound > r->bound_max ? bound : r->bound_max;
    r->measured_max = measured > r->measured_max ? measured : r->measured_max;
    if (measured > bound + SLACK * m->diagonal) {
        r->dishonest++;
        r->excess_max = measured / bound > r->excess_max ? measured / bound : r->excess_max;
    }
}

static int compare_double(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

/* ratio: room for one a leaf. */
static mn_error_ratio sum_up(const measure *m, const found *where, double *ratio) {
    const mn_tree *t = m->tree;
    mn_error_ratio out = {.p10 = NAN, .median = NAN, .p90 = NAN};
    for (uint32_t leaf = 0; leaf < t->leaves; leaf++) {
        const found *f = &where[leaf];
        if (f->samples >= NODE_SAMPLES_MIN && f->max > VISIBLE * m->diagonal)
            ratio[out.nodes++] = switch_value(t, m->owner[leaf]) / f->max;
    }
    if (out.nodes > 0) {
        qsort(ratio, out.nodes, sizeof *ratio, compare_double);
        out.p10 = ratio[out.nodes / 10];
        out.median = ratio[out.nodes / 2];
        out.p90 = ratio[out.nodes - 1 - out.nodes / 10];
    }
    return out;
}

static uint64_t samples_for(uint64_t nodes) {
    uint64_t samples = SAMPLES_A_NODE * nodes;
    return samples < SAMPLES_MIN ? SAMPLES_MIN : samples > SAMPLES_MAX ? SAMPLES_MAX : samples;
}

/* The input's triangles, without the hinges. */
static void fill_input(const mn_tree *t, uint32_t *corner) {
    for (uint64_t s = 0; s < t->simplices; s++)
        if (t->corner[3 * s + 2] != MN_NONE) {
            memcpy(corner, t->corner + 3 * s, 3 * sizeof *corner);
            corner += 3;
        }
}

static mn_code take_samples(measure *m, uint64_t samples, uint64_t seed, const mn_watch *watch,
                            mn_status *st) {
    const mn_tree *t = m->tree;
    mni_distance *distance = NULL;
    mn_code code = mni_distance_open(t->leaf_position, m->corner, m->corners, &distance, st);
    if (code != MN_OK)
        return code;
    fill_input(t, m->corner); /* the front's are in the tree of boxes now */
    mni_sampler sampler;
    mni_sampler_open(&sampler, t->leaf_position, m->corner, t->triangles, samples, seed);
    double point[3], weight[3];
    uint64_t triangle;
    uint32_t hint = 0;
    while (code == MN_OK && mni_sampler_next(&sampler, point, &triangle, weight)) {
        if (m->out->samples % WATCH_EVERY == 0)
            code = mni_watch(watch, "measuring", m->out->samples, samples, st);
        double measured = mni_distance_nearest(distance, point, &hint);
        take_sample(m, m->corner + 3 * triangle, weight, measured);
    }
    mni_distance_close(distance);
    m->out->bound_mean /= (double)samples;
    m->out->measured_mean /= (double)samples;
    return code;
}

mn_code mn_error_measure(const mn_tree *t, uint64_t triangles, uint64_t samples, uint64_t seed,
                         const mn_watch *watch, mn_error_result *out, mn_status *st) {
    *out = (mn_error_result){0};
    measure m = {.tree = t, .out = out, .diagonal = diagonal_of(t)};
    uint64_t room = t->triangles + (uint64_t)t->leaves; /* active triangles and lone nodes */
    m.owner = malloc(t->leaves * sizeof *m.owner);
    m.corner = malloc(room * 3 * sizeof *m.corner);
    m.all = calloc(t->leaves, sizeof *m.all);
    m.near = calloc(t->leaves, sizeof *m.near);
    double *ratio = malloc(t->leaves * sizeof *ratio);
    mn_code code = MN_OK;
    if (!m.owner || !m.corner || !m.all || !m.near || !ratio)
        code = mn_fail(st, MN_FAILED, "no memory to measure a tree of %u leaves", t->leaves);
    if (code == MN_OK) {
        uint32_t made = mni_tree_prefix(t, triangles);
        fill_owners(&m, made);
        fill_corners(&m, made);
        out->diagonal = m.diagonal;
        code = take_samples(&m, samples > 0 ? samples : samples_for(out->nodes), seed, watch, st);
    }
    if (code == MN_OK) {
        out->ratio = sum_up(&m, m.all, ratio);
        out->near = sum_up(&m, m.near, ratio);
    }
    free(ratio);
    free(m.near);
    free(m.all);
    free(m.corner);
    free(m.owner);
    return code;
}
