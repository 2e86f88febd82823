/* Goal: the front stays the image of the input under splits and collapses in any allowed order, and
 * unsplit undoes. Method: random moves on small models, the invariants after each; then fully
 * refined against the tree's simplices, triangle for triangle, and fully coarse. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "corners.h"
#include "frame.h"
#include "front_rig.h"
#include "suite.h"

static uint32_t usage_of(void *context, mni_entry entry) {
    return ((rig *)context)->usage[entry];
}

/* Invariant 1 from the tree alone: exactly the simplices whose leaves lie in different active nodes
 * are active. */
static void check_image(rig *r) {
    const mn_tree *tree = &r->m.tree;
    uint32_t triangles = 0, simplices = 0;
    for (uint32_t s = 0; s < tree->simplices; s++) {
        const uint32_t *leaf = &tree->corner[3 * s];
        uint32_t a = mni_front_find(&r->front, leaf[0]), b = mni_front_find(&r->front, leaf[1]);
        bool hinge = leaf[2] == MN_NONE;
        uint32_t c = hinge ? MN_NONE : mni_front_find(&r->front, leaf[2]);
        bool alive = a != b && b != c && c != a;
        simplices += alive;
        triangles += alive && !hinge;
    }
    ck_assert_uint_eq(simplices, r->front.simplices_used);
    ck_assert_uint_eq(triangles, r->front.triangles);
}

static int compare_u64(const void *a, const void *b) {
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

/* While all order ids are legal, each edge of a closed manifold has one triangle each way. */
static bool check_edges(const rig *r) {
    const mni_front *f = &r->front;
    static uint64_t edge[3 * 4000];
    size_t count = 0;
    for (uint32_t slot = 0; slot < f->slots_high; slot++)
        if (mni_front_is_active(f, slot) && f->node[slot].order > r->m.header.legal_last)
            return false;
    for (uint32_t s = 0; s < f->simplices_high; s++) {
        const uint32_t *node = &f->simplex_node[3 * s];
        if (node[0] == MN_NONE || node[2] == MN_NONE)
            continue;
        ck_assert(count + 3 <= sizeof edge / sizeof edge[0]);
        for (int k = 0; k < 3; k++)
            edge[count++] = (uint64_t)node[k] << 32 | node[(k + 1) % 3];
    }
    qsort(edge, count, sizeof *edge, compare_u64);
    for (size_t i = 0; i < count; i++) {
        uint64_t back = edge[i] << 32 | edge[i] >> 32;
        ck_assert(i == 0 || edge[i] != edge[i - 1]);
        ck_assert_ptr_nonnull(bsearch(&back, edge, count, sizeof *edge, compare_u64));
    }
    return true;
}

static void check(rig *r) {
    mni_front_check(&r->front);
    check_image(r);
    if (r->m.closed)
        ck_assert_uint_eq(mni_front_imbalance(&r->front), 0);
    memset(r->usage, 0,
           mni_store_entries_max(&r->m.header, MN_STORE_RESIDENT, 0) * sizeof *r->usage);
    mni_front_usage(&r->front, r->usage);
    mni_store_check_all(r->store, usage_of, r);
}

static bool can_split(rig *r, uint32_t slot) {
    return mni_front_is_active(&r->front, slot) && !mni_front_is_leaf(&r->front, slot) &&
           mni_front_split_blocker(&r->front, slot) == MN_NONE;
}

static bool can_collapse(rig *r, uint32_t fork) {
    return mni_front_is_fork(&r->front, fork) &&
           mni_front_collapse_blocker(&r->front, fork) == MN_NONE;
}

static void split(rig *r, uint32_t slot) {
    uint32_t branch;
    ck_assert_int_eq(mni_front_split(&r->front, slot, &branch), MNI_DONE);
    mni_front_release(&r->front, branch);
}

/* A branch at random, fork or not. MNI_FRONT_NO_PARENT: there is none. */
static uint32_t random_branch(const rig *r) {
    uint32_t high = r->front.slots_high;
    return high > 0 ? (uint32_t)(model_random() % high) : MNI_FRONT_NO_PARENT;
}

static bool collapse_some(rig *r) {
    uint32_t fork = random_branch(r);
    if (fork == MNI_FRONT_NO_PARENT || !can_collapse(r, fork))
        return false;
    ck_assert_int_eq(mni_front_collapse(&r->front, fork), MNI_DONE);
    return true;
}

static void refine_fully(rig *r) {
    for (bool any = true; any;) {
        any = false;
        for (uint32_t slot = 0; slot < r->front.slots_high; slot++)
            if (can_split(r, slot)) {
                split(r, slot);
                any = true;
            }
    }
}

static void coarsen_fully(rig *r) {
    for (bool any = true; any;) {
        any = false;
        for (uint32_t b = 0; b < r->front.slots_high; b++)
            if (can_collapse(r, b)) {
                ck_assert_int_eq(mni_front_collapse(&r->front, b), MNI_DONE);
                any = true;
            }
    }
}

/* The cyclic order is what counts, not where it begins. */
static void normalise(uint32_t (*triple)[3], uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        uint32_t *t = triple[i];
        bool hinge = t[2] == MN_NONE;
        while (t[0] > t[1] || (!hinge && t[0] > t[2])) {
            uint32_t first = t[0];
            t[0] = t[1];
            t[1] = hinge ? first : t[2];
            t[2] = hinge ? MN_NONE : first;
        }
    }
}

static int compare_triples(const void *a, const void *b) {
    return memcmp(a, b, 3 * sizeof(uint32_t));
}

/* All of the tree's simplices are active, each once, its corners at its own leaves. */
static void check_full_detail(rig *r) {
    const mni_front *f = &r->front;
    const mn_tree *tree = &r->m.tree;
    ck_assert_uint_eq(f->active, tree->leaves);
    ck_assert_uint_eq(f->simplices_used, tree->simplices);
    uint32_t(*have)[3] = calloc(tree->simplices, sizeof *have);
    uint32_t(*want)[3] = calloc(tree->simplices, sizeof *want);
    ck_assert(have != NULL && want != NULL);
    uint32_t count = 0;
    for (uint32_t s = 0; s < f->simplices_high; s++)
        if (f->simplex_node[3 * s] != MN_NONE)
            memcpy(have[count++], &f->simplex_leaf[3 * s], sizeof *have);
    memcpy(want, tree->corner, tree->simplices * sizeof *want);
    normalise(have, count);
    normalise(want, count);
    qsort(have, count, sizeof *have, compare_triples);
    qsort(want, count, sizeof *want, compare_triples);
    ck_assert_mem_eq(have, want, count * sizeof *have);
    for (uint32_t slot = 0; slot < f->slots_high; slot++) {
        if (!mni_front_is_active(f, slot))
            continue;
        uint32_t leaf = f->node[slot].leaf_lo;
        ck_assert_uint_eq(f->node[slot].leaf_hi, leaf + 1);
        ck_assert_mem_eq(&f->position[3 * slot], &tree->leaf_position[3 * leaf], 3 * sizeof(float));
        if (tree->leaf_color != NULL)
            ck_assert_uint_eq(f->color[slot], tree->leaf_color[leaf]);
    }
    free(have);
    free(want);
}

static const mn_block_desc levels_5 = {.blocking = MN_BLOCKING_LEVELS, .l = 5};
static const mn_block_desc levels_3 = {.blocking = MN_BLOCKING_LEVELS, .l = 3};

/* Node for node what the tree says, on every shape. */
START_TEST(full_and_back) {
    rig r;
    rig_open(&r, (model_shape)(_i / 2), 600, _i % 2 ? &levels_3 : &levels_5);
    ck_assert(mni_front_input_is_closed(r.m.path, &r.m.header) == r.m.closed);
    check(&r);
    refine_fully(&r);
    check(&r);
    check_full_detail(&r);
    coarsen_fully(&r);
    check(&r);
    ck_assert_uint_eq(r.front.active, r.m.header.roots);
    ck_assert_uint_eq(r.front.simplices_used, 0);
    if (_i / 2 != MODEL_GLOBE) /* its poles have more neighbours than are looked through */
        ck_assert_uint_eq(r.front.descents, 0);
    rig_close(&r);
}
END_TEST

/* Allowed moves in a random order never break an invariant, and never block the way to either end.
 */
START_TEST(random_moves) {
    rig r;
    uint32_t legal = 0;
    rig_open(&r, (model_shape)_i, 300, &levels_5);
    for (int phase = 0; phase < 8; phase++) {
        bool finer = phase % 2 == 0;
        for (int i = 0; i < 150; i++) {
            uint32_t slot = (uint32_t)(model_random() % (r.front.slots_high));
            if (model_uniform(0, 1) < (finer ? 0.8 : 0.2)) {
                if (can_split(&r, slot))
                    split(&r, slot);
            } else {
                collapse_some(&r);
            }
            check(&r);
            legal += r.m.closed && check_edges(&r);
        }
    }
    refine_fully(&r);
    check_full_detail(&r);
    for (int i = 0; i < 60; i++) { /* near full detail all order ids are legal */
        collapse_some(&r);
        check(&r);
        legal += r.m.closed && check_edges(&r);
    }
    ck_assert(legal > 10 || !r.m.closed);
    coarsen_fully(&r);
    ck_assert_uint_eq(r.front.active, r.m.header.roots);
    rig_close(&r);
}
END_TEST

/* Ten splits undone in reverse leave the front as it was, counts and all. */
START_TEST(unsplit_undoes) {
    rig r;
    uint32_t done[10], scratch[2 * 2000];
    rig_open(&r, (model_shape)_i, 400, &levels_3);
    for (int round = 0; round < 60; round++) {
        uint64_t version = r.front.version, hash = mni_front_hash(&r.front, scratch);
        uint32_t simplices = r.front.simplices_used, triangles = r.front.triangles;
        int count = 0;
        for (uint32_t slot = 0; slot < r.front.slots_high && count < 10; slot++)
            if (can_split(&r, slot)) {
                ck_assert_int_eq(mni_front_split(&r.front, slot, &done[count++]), MNI_DONE);
            }
        while (count > 0)
            mni_front_unsplit(&r.front, done[--count]);
        check(&r);
        ck_assert_uint_eq(mni_front_hash(&r.front, scratch), hash);
        ck_assert_uint_eq(r.front.version, version);
        ck_assert_uint_eq(r.front.simplices_used, simplices);
        ck_assert_uint_eq(r.front.triangles, triangles);
        for (uint32_t slot = 0; slot < r.front.slots_high; slot++)
            if (can_split(&r, slot)) { /* and on */
                split(&r, slot);
                break;
            }
    }
    rig_close(&r);
}
END_TEST

/* A witness answers as a scan would, through every change around it. */
START_TEST(witnesses) {
    rig r;
    rig_open(&r, MODEL_GLOBE, 700, &levels_5);
    for (int i = 0; i < 1500; i++) {
        uint32_t slot = (uint32_t)(model_random() % (r.front.slots_high));
        mni_front_ref found;
        if (mni_front_is_active(&r.front, slot)) {
            bool blocked = mni_front_split_blocker(&r.front, slot) != MN_NONE;
            ck_assert(blocked == (mni_front_split_blockers(&r.front, slot, &found, 1) == 1));
            ck_assert(!blocked || found.order > r.front.node[slot].order);
            if (!blocked && !mni_front_is_leaf(&r.front, slot) && i % 3)
                split(&r, slot);
        }
        uint32_t fork = random_branch(&r);
        if (fork != MNI_FRONT_NO_PARENT && mni_front_is_fork(&r.front, fork)) {
            const uint32_t *child = r.front.branch[fork].child;
            bool blocked = mni_front_collapse_blocker(&r.front, fork) != MN_NONE;
            r.front.node[child[0]].witness = r.front.node[child[1]].witness = MN_NONE;
            ck_assert(blocked == (mni_front_collapse_blocker(&r.front, fork) != MN_NONE));
            if (!blocked && i % 5 == 0)
                ck_assert_int_eq(mni_front_collapse(&r.front, fork), MNI_DONE);
        }
    }
    check(&r);
    rig_close(&r);
}
END_TEST

/* Leaves found by descent, and their input positions through the blocks, whatever the front. */
START_TEST(leaves) {
    rig r;
    rig_open(&r, MODEL_FINS, 500, &levels_3);
    for (int round = 0; round < 3; round++) {
        for (uint32_t leaf = 0; leaf < r.m.header.leaves; leaf++) {
            float at[3];
            const mni_front_node *n = &r.front.node[mni_front_find(&r.front, leaf)];
            ck_assert(n->leaf_lo <= leaf && leaf < n->leaf_hi && n->order != MN_NONE);
            ck_assert(mni_front_leaf_position(&r.front, mni_front_find(&r.front, leaf), leaf, at));
            ck_assert_mem_eq(at, &r.m.tree.leaf_position[3 * leaf], sizeof at);
        }
        check(&r); /* nothing is left in use */
        for (int i = 0; i < 60; i++) {
            uint32_t slot = (uint32_t)(model_random() % (r.front.slots_high));
            if (can_split(&r, slot))
                split(&r, slot);
        }
    }
    rig_close(&r);
}
END_TEST

typedef struct seen { /* a front as a renderer keeps it */
    uint64_t version;
    float position[3 * 4096];
    uint32_t simplex_node[3 * 4096];
} seen;

static void see(const mni_front *f, seen *s) {
    ck_assert(f->nodes_max <= 4096 && f->simplices_max < 4096);
    s->version = f->version;
    memcpy(s->position, f->position, 3 * f->nodes_max * sizeof *f->position);
    memcpy(s->simplex_node, f->simplex_node,
           3 * (f->simplices_max + 1) * sizeof *f->simplex_node); /* and simplex 0 */
}

/* What is not as it was seen lies in a page stamped since. Returns how many pages are stamped. */
static uint32_t check_stamps(const mni_front *f, const seen *s) {
    uint32_t written = 0;
    for (uint32_t slot = 0; slot < f->slots_high; slot++) {
        bool stamped = mn_front_written(f->node_stamp[slot / MN_FRONT_PAGE], s->version);
        written += stamped && slot % MN_FRONT_PAGE == 0;
        ck_assert(stamped || memcmp(&s->position[3 * slot], &f->position[3 * slot],
                                    3 * sizeof *f->position) == 0);
    }
    for (uint32_t i = 1; i < f->simplices_high; i++) {
        bool stamped = mn_front_written(f->simplex_stamp[(i - 1) / MN_FRONT_PAGE], s->version);
        written += stamped && i % MN_FRONT_PAGE == 1;
        ck_assert(stamped || memcmp(&s->simplex_node[3 * i], &f->simplex_node[3 * i],
                                    3 * sizeof *f->simplex_node) == 0);
    }
    return written;
}

/* Stamps find every page that moves, undone ones too, have written, also where the version's low
 * 32 bits wrap; and not every page. */
START_TEST(stamps) {
    static seen s;
    rig r;
    uint32_t pages = 0, written = 0;
    rig_open(&r, MODEL_GLOBE, 1500, &levels_5);
    refine_fully(&r);
    r.front.version += UINT32_MAX - r.front.version - 100;
    for (int round = 0; round < 600; round++) {
        see(&r.front, &s);
        for (int i = 0; i < 8; i++) {
            uint32_t slot = (uint32_t)(model_random() % (r.front.slots_high));
            if (can_split(&r, slot)) {
                uint32_t branch;
                ck_assert_int_eq(mni_front_split(&r.front, slot, &branch), MNI_DONE);
                if (i % 3 == 0)
                    mni_front_unsplit(&r.front, branch);
                else
                    mni_front_release(&r.front, branch);
            } else {
                collapse_some(&r);
            }
        }
        pages += (r.front.slots_high + r.front.simplices_high) / MN_FRONT_PAGE + 2;
        written += check_stamps(&r.front, &s);
    }
    ck_assert_uint_gt(r.front.version, UINT32_MAX);
    ck_assert_uint_lt(written, pages / 2);
    rig_close(&r);
}
END_TEST

/* With vectors and without, the same moves leave the same records, corner for corner. */
START_TEST(vectors_do_what_loops_do) {
    rig a, b;
    rig_open(&a, (model_shape)_i, 500, &levels_3);
    b = (rig){.m = a.m};
    rig_start(&b);
    b.front.vectors = false;
    for (int i = 0; i < 3000; i++) {
        bool finer = i % 600 < 400;
        uint32_t slot = (uint32_t)(model_random() % a.front.slots_high), fork = random_branch(&a);
        if (finer && mni_front_is_active(&a.front, slot)) {
            mni_front_ref x[3], y[3];
            uint32_t count = mni_front_split_blockers(&a.front, slot, x, 3);
            ck_assert_uint_eq(count, mni_front_split_blockers(&b.front, slot, y, 3));
            ck_assert_mem_eq(x, y, count * sizeof *x);
            if (count == 0 && !mni_front_is_leaf(&a.front, slot)) {
                split(&a, slot);
                split(&b, slot);
            }
        } else if (fork != MNI_FRONT_NO_PARENT && mni_front_is_fork(&a.front, fork)) {
            uint32_t blocker = mni_front_collapse_blocker(&a.front, fork);
            ck_assert_uint_eq(blocker, mni_front_collapse_blocker(&b.front, fork));
            if (blocker == MN_NONE) {
                ck_assert_int_eq(mni_front_collapse(&a.front, fork), MNI_DONE);
                ck_assert_int_eq(mni_front_collapse(&b.front, fork), MNI_DONE);
                ck_assert_uint_eq(a.front.lost_count, b.front.lost_count);
            }
        }
        ck_assert_uint_eq(a.front.slots_high, b.front.slots_high);
        ck_assert_mem_eq(a.front.node, b.front.node, a.front.slots_high * sizeof *a.front.node);
        ck_assert_mem_eq(a.front.simplex_node, b.front.simplex_node,
                         3 * a.front.simplices_high * sizeof *a.front.simplex_node);
    }
    check(&b);
    mni_store_close(b.store);
    mni_arena_close(&b.arena);
    free(b.usage);
    rig_close(&a);
}
END_TEST

/* Another node than the two in a slot's simplices is taken out of some. */
static void tear(mni_front *f, uint32_t slot, uint32_t other) {
    for (int i = 0; i < MNI_FRONT_CORNERS && f->node[slot].corner[i] != 0; i++)
        for (int k = 0; k < 2; k++) {
            const uint32_t c = f->node[slot].corner[i];
            const uint32_t next = k == 0 ? mni_corner_after(c) : mni_corner_before(c);
            if (mni_corner_slot(f, next) != other && model_random() % 2 == 0)
                f->simplex_node[mni_corner_at(next)] = MN_NONE;
        }
}

static bool is_next_to(const mni_front *f, const uint32_t *corner, uint32_t slot) {
    for (int i = 0; i < MNI_FRONT_CORNERS && corner[i] != 0; i++)
        if (mni_corner_slot(f, mni_corner_after(corner[i])) == slot ||
            mni_corner_slot(f, mni_corner_before(corner[i])) == slot)
            return true;
    return false;
}

/* Whoever a collapse parts from both of its nodes is told, and nobody else, in a front that does
 * not hold together as well: a lying file makes such. */
START_TEST(who_is_lost_is_told) {
    static mni_front_node node[2000];
    static uint32_t corner[3 * 8000];
    uint32_t lost = 0, found = 0;
    rig r;
    rig_open(&r, MODEL_GLOBE, 1500, &levels_5);
    refine_fully(&r);
    mni_front *f = &r.front;
    ck_assert(f->slots_high <= 2000 && f->simplices_high <= 8000);
    f->vectors = f->vectors && _i == 0;
    for (uint32_t b = 0; b < f->slots_high; b++) {
        const uint32_t left = f->branch[b].child[0], right = f->branch[b].child[1];
        if (!mni_front_is_fork(f, b) || mni_front_is_long(&f->node[left]) ||
            mni_front_is_long(&f->node[right]))
            continue;
        memcpy(node, f->node, f->slots_high * sizeof *node);
        memcpy(corner, f->simplex_node, 3 * f->simplices_high * sizeof *corner);
        tear(f, left, right);
        tear(f, right, left);
        mni_joined j;
        mni_ring_join(f, left, right, &j);
        for (uint32_t i = 0; i < j.died; i++) {
            const uint32_t slot = mni_corner_slot(f, j.third[i]);
            const bool stays = is_next_to(f, f->node[left].corner, slot) ||
                               (j.over_count > 0 && is_next_to(f, j.over, slot));
            ck_assert_uint_eq(j.lost >> i & 1, !stays);
            lost += !stays;
            found += stays;
        }
        memcpy(f->node, node, f->slots_high * sizeof *node);
        memcpy(f->simplex_node, corner, 3 * f->simplices_high * sizeof *corner);
    }
    ck_assert_msg(lost > 20 && found > 20, "%u lost, %u not", lost, found);
    rig_close(&r);
}
END_TEST

/* Too little room is refused, and changes nothing. */
START_TEST(room) {
    rig r;
    rig_open(&r, MODEL_TORUS, 200, &levels_5);
    uint32_t nodes_max = r.front.nodes_max, simplices_max = r.front.simplices_max, branch;
    r.front.nodes_max = r.front.active;
    ck_assert(can_split(&r, 0));
    ck_assert_int_eq(mni_front_split(&r.front, 0, &branch), MNI_REFUSED_FRONT);
    r.front.nodes_max = nodes_max;
    uint32_t refused = 0;
    for (int i = 0; i < 1500; i++) {
        uint32_t slot = (uint32_t)(model_random() % (r.front.slots_high));
        if (!can_split(&r, slot))
            continue;
        r.front.simplices_max = r.front.simplices_used;
        uint32_t active = r.front.active;
        mni_outcome outcome = mni_front_split(&r.front, slot, &branch);
        r.front.simplices_max = simplices_max;
        if (outcome == MNI_REFUSED_FRONT) {
            refused++;
            ck_assert_uint_eq(r.front.active, active);
            check(&r);
            split(&r, slot);
        } else { /* it brought no simplex */
            ck_assert_int_eq(outcome, MNI_DONE);
            mni_front_release(&r.front, branch);
        }
    }
    ck_assert_uint_gt(refused, 20);
    check(&r);
    rig_close(&r);
}
END_TEST

/* ---- blocks that are not their parents' -------------------------------------------------------
 */

enum { LIE_ORDER, LIE_VALUE, LIE_RADIUS, LIE_CONE, LIE_LO, LIE_HI, LIES };

static void tell(int lie, mni_subtree *subtree, mni_facts *facts) {
    switch (lie) {
    case LIE_ORDER:
        facts->order++;
        break;
    case LIE_VALUE:
        facts->switch_value = mni_switch_up(1.01f * facts->switch_value);
        break;
    case LIE_RADIUS:
        facts->radius = mni_radius_up(1.01f * facts->radius);
        break;
    case LIE_CONE:
        facts->cone.angle++;
        break;
    case LIE_LO:
        subtree->leaf_lo--;
        break;
    default:
        subtree->leaf_hi++;
    }
}

/* Writes a block of one node again, with a lie about that node, and seals it. Its order id;
 * MN_NONE: within itself the block would be wrong already, so it stays as it was. */
static uint32_t lie_in_block(unsigned char *bytes, uint32_t pages, const model *m, int lie) {
    unsigned char made[4 * MN_PAGE_BYTES] = {0};
    const uint32_t length = pages * MN_PAGE_BYTES;
    mni_frame frame;
    mni_block view;
    mni_subtree subtree;
    mni_node node;
    mni_tally tally;
    mni_encoder encoder;
    ck_assert_uint_le(length, sizeof made);
    mni_frame_get(bytes, &frame);
    mni_block_reopen(&view, bytes);
    ck_assert(view.nodes == 1 && view.subtrees == 1);
    mni_block_subtree(&view, 0, &subtree);
    mni_block_node(&view, 0, &(mni_place){subtree.leaf_lo, subtree.leaf_hi, {0}}, &node);
    const uint32_t order = node.facts.order;
    if (frame.parent_id == 0 || node.overflow_ref != MN_NONE)
        return MN_NONE;
    mni_node was = node;
    tell(lie, &subtree, &node.facts);
    node.at.leaf_lo = subtree.leaf_lo;
    node.at.leaf_hi = subtree.leaf_hi;
    mni_tally_init(&tally, view.has_colors, view.step);
    mni_tally_subtree(&tally, &subtree);
    mni_tally_node(&tally, &node);
    for (int pass = 0; pass < 2; pass++) {
        if (pass == 1) {
            mni_encoder_begin(&encoder, made, length, &tally, frame.refs);
            mni_encoder_subtree(&encoder, &subtree);
            mni_encoder_node(&encoder, &node);
        }
        for (uint32_t i = 0; i < was.simplex_count; i++) {
            uint32_t corner[3];
            mni_block_simplex(&view, &was, i, corner);
            if (pass == 0)
                mni_tally_simplex(&tally, corner);
            else
                mni_encoder_simplex(&encoder, corner);
        }
    }
    mni_encoder_end(&encoder);
    uint32_t self[2];
    memcpy(self, bytes + 24, sizeof self); /* frame.h: id, pages */
    for (uint32_t i = 0; i < frame.refs; i++)
        mni_frame_set_ref(made, i, mni_frame_ref(bytes, i));
    frame.payload_bytes = (uint32_t)mni_tally_bytes(&tally, frame.refs);
    mni_frame_seal(made, &frame, (mn_block_ref){self[0], self[1]}, m->header.build_id);
    const mni_block_limits limits = mni_block_limits_of(&m->header);
    if (!mni_front_block_check(&limits, made, length))
        return MN_NONE;
    memcpy(bytes, made, length);
    return order;
}

/* Lies in some block of the model's file that a child's is, the n-th that can bear it. */
static uint32_t lie_in_file(const model *m, int lie, uint64_t n) {
    size_t count = m->header.file_bytes;
    unsigned char *bytes = malloc(count);
    FILE *f = fopen(m->path, "r+b");
    ck_assert(bytes != NULL && f != NULL && fread(bytes, 1, count, f) == count);
    uint32_t order = MN_NONE, pages;
    for (size_t at = MN_PAGE_BYTES; at < count; at += (size_t)pages * MN_PAGE_BYTES) {
        memcpy(&pages, bytes + at + 28, sizeof pages);
        unsigned char before[4 * MN_PAGE_BYTES];
        memcpy(before, bytes + at, (size_t)pages * MN_PAGE_BYTES);
        order = lie_in_block(bytes + at, pages, m, lie);
        if (order != MN_NONE && n-- == 0)
            break;
        memcpy(bytes + at, before, (size_t)pages * MN_PAGE_BYTES);
        order = MN_NONE;
    }
    rewind(f);
    ck_assert_uint_eq(fwrite(bytes, 1, count, f), count);
    ck_assert_int_eq(fclose(f), 0);
    free(bytes);
    return order;
}

/* A block that is sound in itself but not the one its parent's speaks of (another file's, or one
 * that lies) is as absent, each thing that both say by itself; all else can be split. */
START_TEST(what_both_blocks_say_must_agree) {
    static const mn_block_desc levels_1 = {.blocking = MN_BLOCKING_LEVELS, .l = 1};
    for (int round = 0; round < 3; round++) {
        rig r = {0};
        model_make(&r.m, MODEL_TORUS, 200, &levels_1);
        uint32_t lying = lie_in_file(&r.m, _i, model_random() % 12);
        ck_assert_uint_ne(lying, MN_NONE);
        rig_start(&r);
        uint32_t found = MN_NONE;
        for (bool any = true; any;) {
            any = false;
            for (uint32_t slot = 0; slot < r.front.slots_high; slot++) {
                if (!can_split(&r, slot) || (r.front.node[slot].flags & MNI_NODE_BAD))
                    continue;
                any = true;
                if (r.front.node[slot].order != lying) {
                    split(&r, slot);
                    continue;
                }
                uint32_t branch;
                ck_assert_int_eq(mni_front_split(&r.front, slot, &branch), MNI_BAD);
                ck_assert(r.front.node[slot].flags & MNI_NODE_BAD);
                found = slot;
            }
        }
        ck_assert_uint_ne(found, MN_NONE);
        ck_assert_uint_eq(r.front.bad, 1);
        check(&r);
        coarsen_fully(&r);
        ck_assert_uint_eq(r.front.active, r.m.header.roots);
        rig_close(&r);
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("front");
    TCase *tc = tcase_create("front");
    tcase_set_timeout(tc, 60);
    tcase_add_loop_test(tc, full_and_back, 0, 2 * MODEL_SHAPES);
    tcase_add_loop_test(tc, random_moves, 0, MODEL_SHAPES);
    tcase_add_loop_test(tc, unsplit_undoes, 0, MODEL_SHAPES);
    tcase_add_test(tc, witnesses);
    tcase_add_test(tc, leaves);
    tcase_add_test(tc, stamps);
    tcase_add_loop_test(tc, vectors_do_what_loops_do, 0, MODEL_SHAPES);
    tcase_add_loop_test(tc, who_is_lost_is_told, 0, 2);
    tcase_add_test(tc, room);
    tcase_add_loop_test(tc, what_both_blocks_say_must_agree, 0, LIES);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
