/* Collapses and killed simplices in few bytes each: see history.h.
 *
 * Hides: the packing. Numbers are varints (varint.h), and most are differences: a child that was
 * made shortly before, a leaf or a corner next to the last one, a key little above the last. Of
 * floats, what files will hold of them is kept. A collapse comes to about 20 bytes, of 52 in
 * memory, a triangle to 6 of 12; the disk sees them twice.
 *
 *   collapse: left, right      leaf: fold(id - last leaf) × 2; node: (number - its number) × 2 + 1
 *             facts            u64
 *             key              fold(bits - last key's)
 *             left, right      leaves - 1, and where there is more than one, split - 1
 *             simplices
 *   killed:   corners          fold(- last simplex's first), fold(- first) × 2, 0: hinge
 *
 * One thread at a time; memory: three pending pieces of what is written. */
#include "history.h"

#include <errno.h>
#include <stdlib.h>
#include <unistd.h>

#include "mn_assert.h"
#include "block.h"
#include "block_layout.h"
#include "varint.h"

enum {
    PENDING_BYTES = 16 << 10,
    RECORD_MAX = 64, /* 2 × 5 ids, 8 facts, 5 key, 4 × 5 leaves, 5 simplices: 48 */
};
enum { COLLAPSE, KILLED, GROUP };

typedef struct group_place {
    uint64_t collapse, killed; /* where it begins */
} group_place;

static mni_spill *spill_of(mni_history *h, int which) {
    return which == COLLAPSE ? &h->collapse : which == KILLED ? &h->killed : &h->group;
}

mn_code mni_history_open(mni_history *h, const char *temp_dir, bool keep, mn_status *st) {
    *h = MNI_HISTORY_CLOSED;
    h->pending[0] = malloc(3 * PENDING_BYTES);
    if (h->pending[0] == NULL)
        return mn_fail(st, MN_FAILED, "out of memory for a temporary file");
    mn_code code = MN_OK;
    for (int i = 0; i < 3 && code == MN_OK; i++) {
        h->pending[i] = h->pending[0] + (size_t)i * PENDING_BYTES;
        code = mni_spill_open_kept(spill_of(h, i), temp_dir, keep, st);
    }
    return code;
}

void mni_history_close(mni_history *h) {
    for (int i = 0; i < 3; i++)
        mni_spill_close(spill_of(h, i));
    free(h->pending[0]);
    h->pending[0] = NULL;
}

/* ---- facts ---------------------------------------------------------------------------------- */

_Static_assert(MNI_SWITCH_SHIFT == 18 && MNI_RADIUS_SHIFT == 19,
               "what is left fits 13 and 12 bits");

uint32_t mni_facts_value(float value) {
    MN_ASSERT(value >= 0);
    return mni_float_bits(mni_switch_up(value) + 0.0f) >> MNI_SWITCH_SHIFT;
}

float mni_facts_value_of(uint32_t bits) {
    return mni_float_of(bits << MNI_SWITCH_SHIFT);
}

float mni_facts_radius_of(uint64_t bounds) {
    return mni_float_of((uint32_t)(bounds & 0xfff) << MNI_RADIUS_SHIFT);
}

mn_cone mni_facts_cone_of(uint64_t bounds) {
    uint32_t cone = (uint32_t)(bounds >> 12);
    return (mn_cone){{(int8_t)(cone & 0xff), (int8_t)(cone >> 8 & 0xff)}, (uint8_t)(cone >> 16)};
}

static uint64_t facts_of(const mni_cell_collapse *c) {
    uint64_t radius = mni_float_bits(c->bounds.radius) >> MNI_RADIUS_SHIFT;
    mn_cone cone = c->bounds.cone;
    MN_ASSERT(mni_radius_up(c->bounds.radius) == c->bounds.radius && c->bounds.radius >= 0);
    uint64_t packed = (uint64_t)(uint8_t)cone.axis[0] | (uint64_t)(uint8_t)cone.axis[1] << 8 |
                      (uint64_t)cone.angle << 16;
    return mni_facts_value(c->left_value) | (uint64_t)mni_facts_value(c->right_value) << 13 |
           radius << 26 | packed << 38;
}

/* ---- writing -------------------------------------------------------------------------------- */

static void flush(mni_history *h, int which) {
    mni_spill_append(spill_of(h, which), h->pending[which], h->pending_bytes[which]);
    h->pending_bytes[which] = 0;
}

/* Room for a record; what is put there ends at what put_end is told. */
static unsigned char *put_begin(mni_history *h, int which) {
    if (h->pending_bytes[which] > PENDING_BYTES - RECORD_MAX)
        flush(h, which);
    return h->pending[which] + h->pending_bytes[which];
}

static void put_end(mni_history *h, int which, const unsigned char *end) {
    h->pending_bytes[which] = (uint32_t)(end - h->pending[which]);
}

void mni_history_begin(mni_history *h) {
    if (h->collapses % MNI_HISTORY_GROUP != 0)
        return;
    group_place place = {h->collapse.size_bytes + h->pending_bytes[COLLAPSE],
                         h->killed.size_bytes + h->pending_bytes[KILLED]};
    unsigned char *to = put_begin(h, GROUP);
    memcpy(to, &place, sizeof place);
    put_end(h, GROUP, to + sizeof place);
    h->last_leaf = h->last_key = h->last_corner = 0;
}

static unsigned char *put_node(unsigned char *to, uint32_t node, uint32_t number, uint32_t *last) {
    if (node >= MNI_COLLAPSE)
        return mni_varint_put(to, (uint64_t)(number - (node - MNI_COLLAPSE)) * 2 + 1);
    to = mni_varint_put(to, mni_fold(node, *last) * 2);
    *last = node;
    return to;
}

static unsigned char *put_leaves(unsigned char *to, uint32_t leaves, uint32_t split) {
    MN_ASSERT(leaves > split && (leaves > 1) == (split > 0));
    to = mni_varint_put(to, leaves - 1);
    return leaves > 1 ? mni_varint_put(to, split - 1) : to;
}

void mni_history_add_collapse(mni_history *h, const mni_cell_collapse *c) {
    uint64_t facts = facts_of(c);
    uint32_t key = mni_float_bits(c->key);
    unsigned char *to = put_begin(h, COLLAPSE);
    MN_ASSERT(c->key >= 0);
    to = put_node(to, c->left, h->collapses, &h->last_leaf);
    to = put_node(to, c->right, h->collapses, &h->last_leaf);
    memcpy(to, &facts, sizeof facts);
    to = mni_varint_put(to + sizeof facts, mni_fold(key, h->last_key));
    to = put_leaves(to, c->left_leaves, c->left_split);
    to = put_leaves(to, c->right_leaves, c->right_split);
    to = mni_varint_put(to, c->simplices);
    put_end(h, COLLAPSE, to);
    h->last_key = key;
    h->collapses++;
}

void mni_history_add_killed(mni_history *h, const uint32_t corner[3]) {
    unsigned char *to = put_begin(h, KILLED);
    to = mni_varint_put(to, mni_fold(corner[0], h->last_corner));
    to = mni_varint_put(to, mni_fold(corner[1], corner[0]));
    to = mni_varint_put(to, corner[2] == MN_NONE ? 0 : mni_fold(corner[2], corner[0]));
    put_end(h, KILLED, to);
    h->last_corner = corner[0];
}

static mn_code trouble_of(mni_history *h, mn_status *st) {
    for (int i = 0; i < 3; i++)
        if (spill_of(h, i)->trouble.code != MN_OK)
            return mn_fail(st, spill_of(h, i)->trouble.code, "%s", spill_of(h, i)->trouble.text);
    return MN_OK;
}

mn_code mni_history_add(mni_history *h, const mni_cell *cell, mn_status *st) {
    const uint32_t(*killed)[3] = (const uint32_t(*)[3])cell->killed;
    for (uint32_t i = 0; i < cell->collapses; i++) {
        mni_history_begin(h);
        mni_history_add_collapse(h, &cell->collapse[i]);
        for (uint32_t k = 0; k < cell->collapse[i].simplices; k++)
            mni_history_add_killed(h, *killed++);
    }
    MN_ASSERT(killed == (const uint32_t(*)[3])cell->killed + cell->killed_count);
    h->killed_count += cell->killed_count;
    h->hinges += cell->hinges;
    mni_history_count(h, cell);
    return trouble_of(h, st);
}

void mni_history_count(mni_history *h, const mni_cell *cell) {
    const mn_build_counts *c = &cell->s.counts;
    h->counts.boundary_edges += c->boundary_edges;
    h->counts.nonmanifold_edges += c->nonmanifold_edges;
    h->counts.order_violations += c->order_violations;
    if (c->order_violation_worst > h->counts.order_violation_worst)
        h->counts.order_violation_worst = c->order_violation_worst;
    MN_ASSERT_SLOW(c->order_violation_worst <= c->order_violation_bound);
    if (c->order_violation_bound > h->counts.order_violation_bound)
        h->counts.order_violation_bound = c->order_violation_bound;
    h->counts.order_unknown += cell->desc.points ? cell->collapses : c->order_unknown;
    h->counts.components += c->components;
    for (int i = 0; i < 4; i++)
        h->counts.collapses_by_stage[i] += c->collapses_by_stage[i];
}

mn_code mni_history_end(mni_history *h, mn_status *st) {
    for (int i = 0; i < 3; i++)
        flush(h, i);
    return trouble_of(h, st);
}

/* ---- reading -------------------------------------------------------------------------------- */

static mn_code read_at(mni_spill *spill, uint64_t offset, void *bytes, size_t count,
                       mn_status *st) {
    mni_spill_reader r;
    mni_spill_reader_open(&r, spill, offset, offset + count, bytes, count, false);
    if (mni_spill_take(&r, count) != NULL)
        return MN_OK;
    return mn_fail(st, spill->trouble.code, "%s", spill->trouble.text);
}

static mn_code open_group(mni_history_reader *r, mni_history *h, int which, uint32_t group,
                          void *buffer, size_t buffer_bytes, mn_status *st) {
    uint32_t groups = (h->collapses + MNI_HISTORY_GROUP - 1) / MNI_HISTORY_GROUP;
    group_place place[2] = {{0}, {h->collapse.size_bytes, h->killed.size_bytes}};
    MN_ASSERT(group < groups && buffer_bytes >= MNI_HISTORY_BUFFER_MIN);
    mn_code code = read_at(&h->group, group * sizeof *place, place,
                           (group + 1 < groups ? 2 : 1) * sizeof *place, st);
    *r = (mni_history_reader){.spill = spill_of(h, which),
                              .next = which == COLLAPSE ? place[0].collapse : place[0].killed,
                              .end = which == COLLAPSE ? place[1].collapse : place[1].killed,
                              .buffer = buffer,
                              .buffer_bytes = buffer_bytes,
                              .number = group * MNI_HISTORY_GROUP};
    r->at = r->limit = r->buffer + RECORD_MAX;
    return code;
}

mn_code mni_history_group(mni_history_reader *r, mni_history *h, uint32_t group, void *buffer,
                          size_t buffer_bytes, mn_status *st) {
    return open_group(r, h, COLLAPSE, group, buffer, buffer_bytes, st);
}

mn_code mni_history_group_killed(mni_history_reader *r, mni_history *h, uint32_t group,
                                 void *buffer, size_t buffer_bytes, mn_status *st) {
    return open_group(r, h, KILLED, group, buffer, buffer_bytes, st);
}

/* A whole record at r->at. What is left of the buffer, less than a record, goes before the rest. */
static bool refill(mni_history_reader *r) {
    size_t left = (size_t)(r->limit - r->at);
    unsigned char *to = r->buffer + RECORD_MAX;
    size_t room = r->buffer_bytes - RECORD_MAX;
    size_t want = r->end - r->next < room ? (size_t)(r->end - r->next) : room;
    memmove(to - left, r->at, left);
    r->at = to - left;
    mn_status st = {0};
    if (want > 0 && read_at(r->spill, r->next, to, want, &st) != MN_OK)
        return false;
    r->next += want;
    r->limit = to + want;
    return r->at < r->limit;
}

static inline bool has_record(mni_history_reader *r) {
    if (__builtin_expect((size_t)(r->limit - r->at) >= RECORD_MAX, 1))
        return true;
    if (r->next < r->end)
        return refill(r);
    return r->at < r->limit && r->spill->trouble.code == MN_OK;
}

static uint32_t take_node(mni_history_reader *r) {
    uint64_t code = mni_varint_get(&r->at);
    if (code & 1)
        return MNI_COLLAPSE + r->number - (uint32_t)(code / 2);
    return r->last_leaf = mni_unfold(code / 2, r->last_leaf);
}

static void take_leaves(mni_history_reader *r, uint32_t *leaves, uint32_t *split) {
    *leaves = (uint32_t)mni_varint_get(&r->at) + 1;
    *split = *leaves > 1 ? (uint32_t)mni_varint_get(&r->at) + 1 : 0;
}

bool mni_history_next(mni_history_reader *r, mni_history_collapse *out) {
    if (!has_record(r))
        return false;
    out->left = take_node(r);
    out->right = take_node(r);
    memcpy(&out->facts, r->at, sizeof out->facts);
    r->at += sizeof out->facts;
    out->key = r->last_key = mni_unfold(mni_varint_get(&r->at), r->last_key);
    take_leaves(r, &out->left_leaves, &out->left_split);
    take_leaves(r, &out->right_leaves, &out->right_split);
    out->simplices = (uint32_t)mni_varint_get(&r->at);
    r->number++;
    return true;
}

bool mni_history_next_killed(mni_history_reader *r, uint32_t corner[3]) {
    if (!has_record(r))
        return false;
    corner[0] = r->last_corner = mni_unfold(mni_varint_get(&r->at), r->last_corner);
    corner[1] = mni_unfold(mni_varint_get(&r->at), corner[0]);
    uint64_t third = mni_varint_get(&r->at);
    corner[2] = third == 0 ? MN_NONE : mni_unfold(third, corner[0]);
    return true;
}
