/* Nodes that are wanted and stand refused by the pool.
 *
 * Where a pool is too small by half, thousands of nodes are wanted in each frame that were refused
 * and would be again: three times as many as are split and collapsed. Whether they would is known
 * from the room that each needs, and from whether its block has come into use. So that is all that
 * is asked of them. Who is in the list is not judged and has no item on the agenda; a pass of
 * splits goes through list and agenda as through one, by falling error, and whoever has room in his
 * turn is tried as all others are.
 *
 *     barred   8.1  7.5       7.4  6.0       5.9  3.1  …  as they were in the pass before
 *     agenda             7.45           5.95           …  new, or looked at again
 *
 * Everybody in the list is wanted: he is looked at again when his verdict is due (sieve.h), and in
 * one frame of MNI_BARRED_FRAMES in any case, the first of the list in each. So the largest error
 * is that of this camera, and the order of the others a few frames old at most. Who goes, or is
 * split for another, loses his bit; his place is found empty in his turn.
 *
 * Hides: that one array is the list of this pass, which grows, and that of the last one, which is
 * used up. Where it is full, nodes are looked at in each frame, as they would be without it.
 *
 * Order of calls: open; then a pass is begin, mark of what is put on the agenda, and next, keep,
 * add in the order of ranks; drop at any time. Threads: Navigate only. Memory: the arena's, a place
 * for a sixteenth of the front's nodes and 256 more, and a bit a slot. Paper: none. */
#include "barred.h"

#include <string.h>

#include "mn_assert.h"
#include "sieve.h"

static uint32_t places(uint32_t nodes_max) {
    return nodes_max / MNI_BARRED_SHARE + MNI_BARRED_FIRST;
}

static uint32_t words(uint32_t nodes_max) {
    return (nodes_max + 63) / 64;
}

size_t mni_barred_need(uint32_t nodes_max) {
    return mni_arena_need(places(nodes_max), sizeof(mni_barred_node), 64) +
           mni_arena_need(words(nodes_max), sizeof(uint64_t), 64);
}

void mni_barred_open(mni_barred *b, uint32_t nodes_max, float *due, mni_arena *arena) {
    *b = (mni_barred){.due = due, .slots_max = nodes_max, .max = places(nodes_max)};
    b->node = mni_arena_take(arena, b->max, sizeof *b->node, 64);
    b->bit = mni_arena_take(arena, words(nodes_max), sizeof *b->bit, 64);
    mni_barred_clear(b);
}

void mni_barred_mark(mni_barred *b, uint32_t slot, float due) {
    MN_ASSERT(slot < b->slots_max && !mni_barred_has(b, slot));
    b->bit[slot / 64] |= UINT64_C(1) << (slot % 64);
    b->due[slot] = due;
}

void mni_barred_drop_slow(mni_barred *b, uint32_t slot) {
    b->bit[slot / 64] &= ~(UINT64_C(1) << (slot % 64));
    b->due[slot] = MNI_DUE_NOW;
}

void mni_barred_clear(mni_barred *b) {
    memset(b->bit, 0, words(b->slots_max) * sizeof *b->bit);
    b->count = 0;
    b->next = b->max;
}

/* From the last to the first, to the end of the array. */
void mni_barred_begin(mni_barred *b, float clock, uint32_t frame) {
    uint32_t to = b->max;
    for (uint32_t i = b->count; i-- > 0;) {
        const mni_barred_node node = b->node[i];
        const bool due = i < MNI_BARRED_FIRST || node.due <= clock ||
                         node.item.order % MNI_BARRED_FRAMES == frame % MNI_BARRED_FRAMES;
        if (due)
            mni_barred_drop(b, node.item.what);
        else if (mni_barred_has(b, node.item.what))
            b->node[--to] = node;
    }
    b->count = 0;
    b->next = to;
}

const mni_barred_node *mni_barred_next(mni_barred *b, uint64_t rank) {
    for (; b->next < b->max && mni_agenda_rank(&b->node[b->next].item) < rank; b->next++)
        if (mni_barred_has(b, b->node[b->next].item.what))
            return &b->node[b->next++];
    return NULL;
}

void mni_barred_keep(mni_barred *b, const mni_barred_node *next) {
    MN_ASSERT(b->count < b->next && next == &b->node[b->next - 1]);
    b->node[b->count++] = *next;
}

void mni_barred_add(mni_barred *b, mni_agenda_item item, mni_refusal refusal) {
    MN_ASSERT(mni_barred_has(b, item.what));
    if (b->count < b->next)
        b->node[b->count++] = (mni_barred_node){item, b->due[item.what], refusal};
    else
        mni_barred_drop(b, item.what);
}

void mni_barred_check(const mni_barred *b) {
    uint32_t bits = 0, there = 0;
    for (uint32_t w = 0; w < words(b->slots_max); w++)
        bits += (uint32_t)__builtin_popcountll(b->bit[w]);
    for (uint32_t i = 0; i < b->count; i++) {
        const mni_barred_node *node = &b->node[i];
        MN_ASSERT(i == 0 || mni_agenda_rank(&node[-1].item) < mni_agenda_rank(&node->item));
        MN_ASSERT(node->refusal.block_id != 0 && node->item.what < b->slots_max);
        there += mni_barred_has(b, node->item.what) && b->due[node->item.what] == node->due;
    }
    MN_ASSERT(bits <= there && b->next == b->max);
}
