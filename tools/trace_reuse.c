/* Stack distances (Mattson et al., 1970) of the blocks of a trace. See trace_reuse.h.
 *
 * A block in use is touched at all times, so the list of least recent use begins with the blocks in
 * use; behind them stand the others by when they went out of use. The distance of one that is
 * wanted again is its place on that list: the blocks in use, those that went after it, and itself.
 * A pool of K with that list alone, and nothing read ahead, has it if the distance is at most K.
 *
 *     went out of use:  1  2  3  4  5  6  7        Fenwick tree over these moments:
 *     who:              c  -  a  -  f  b  -        a is wanted: f and b went later
 *
 * So an access costs O(log n) in the number of blocks: moments that nobody stands at any more are
 * squeezed out whenever the tree is full, which is at most half full then. */
#include "trace_reuse.h"

#include <stdlib.h>
#include <string.h>

#include "trace_words.h"

enum { MOMENTS_MIN = 1 << 12 };

/* ---- the tree -------------------------------------------------------------------------------- */

static void tree_add(trace_reuse *r, uint32_t at, uint32_t by) {
    for (; at < r->tree_room; at += at & -at)
        r->tree[at] += by;
}

static uint32_t tree_up_to(const trace_reuse *r, uint32_t at) {
    uint32_t sum = 0;
    for (; at > 0; at -= at & -at)
        sum += r->tree[at];
    return sum;
}

/* Moments from 1 on again, for those that stand, in their order; twice as many as they take. */
static bool squeeze(trace_reuse *r) {
    uint32_t standing = 0;
    for (uint32_t at = 1; at <= r->now; at++)
        if (r->owner[at] != MN_NONE) {
            r->owner[++standing] = r->owner[at];
            r->block[r->owner[standing]].left_at = standing;
        }
    const uint64_t room = 2 * ((uint64_t)standing + MOMENTS_MIN);
    if (room > r->tree_room) {
        uint32_t *owner = room < UINT32_MAX ? realloc(r->owner, room * sizeof *owner) : NULL;
        if (owner == NULL)
            return false;
        r->owner = owner;
        uint32_t *tree = realloc(r->tree, room * sizeof *tree);
        if (tree == NULL)
            return false;
        r->tree = tree;
        r->tree_room = (uint32_t)room;
    }
    memset(r->tree, 0, r->tree_room * sizeof *r->tree);
    for (uint32_t at = 1; at <= standing; at++)
        tree_add(r, at, 1);
    r->now = standing;
    return true;
}

/* ---- blocks ---------------------------------------------------------------------------------- */

static trace_reuse_block *block_of(trace_reuse *r, uint32_t block) {
    r->failed |= !trace_grow((void **)&r->block, &r->block_room, block, sizeof *r->block);
    if (r->failed)
        return NULL;
    r->blocks = block >= r->blocks ? block + 1 : r->blocks;
    return &r->block[block];
}

static uint32_t distance_of(const trace_reuse *r, const trace_reuse_block *b) {
    if (!b->known)
        return 0;
    return r->in_use + tree_up_to(r, r->now) - tree_up_to(r, b->left_at) + 1;
}

static void count(trace_reuse *r, trace_reuse_block *b) {
    r->failed |=
        !trace_grow((void **)&r->accesses, &r->distances_room, b->distance, sizeof(uint64_t)) ||
        !trace_grow((void **)&r->misses, &r->misses_room, b->distance, sizeof(uint64_t));
    if (r->failed)
        return;
    r->accesses[b->distance]++;
    r->misses[b->distance] += b->misses;
    r->accesses_all++;
    r->misses_all += b->misses;
    b->asked = false;
    b->misses = 0;
}

static void ask(const trace_reuse *r, trace_reuse_block *b) {
    if (b->asked || b->in_use)
        return;
    b->asked = true;
    b->distance = distance_of(r, b);
}

void trace_reuse_use(trace_reuse *r, uint32_t block) {
    trace_reuse_block *b = block_of(r, block);
    if (b == NULL || b->in_use)
        return;
    ask(r, b);
    count(r, b);
    if (b->left_at > 0) {
        r->owner[b->left_at] = MN_NONE;
        tree_add(r, b->left_at, UINT32_MAX); /* minus one */
    }
    b->left_at = 0;
    b->known = b->in_use = true;
    r->in_use++;
}

void trace_reuse_leave(trace_reuse *r, uint32_t block) {
    trace_reuse_block *b = block_of(r, block);
    if (b == NULL || !b->in_use)
        return;
    b->in_use = false;
    r->in_use--;
    if (r->now + 1 >= r->tree_room && !squeeze(r)) {
        r->failed = true;
        return;
    }
    b->left_at = ++r->now;
    r->owner[b->left_at] = block;
    tree_add(r, b->left_at, 1);
}

void trace_reuse_absent(trace_reuse *r, uint32_t block) {
    trace_reuse_block *b = block_of(r, block);
    if (b != NULL)
        ask(r, b);
}

void trace_reuse_miss(trace_reuse *r, uint32_t block) {
    trace_reuse_block *b = block_of(r, block);
    if (b == NULL)
        return;
    ask(r, b);
    b->misses += b->asked;
}

void trace_reuse_end(trace_reuse *r) {
    for (uint32_t i = 0; i < r->blocks && !r->failed; i++)
        if (r->block[i].asked)
            count(r, &r->block[i]);
}

/* ---- answers --------------------------------------------------------------------------------- */

static uint64_t beyond(const uint64_t *by_distance, uint32_t room, uint32_t k) {
    uint64_t sum = room > 0 ? by_distance[0] : 0;
    for (uint64_t d = (uint64_t)k + 1; d < room; d++)
        sum += by_distance[d];
    return sum;
}

uint64_t trace_reuse_reads(const trace_reuse *r, uint32_t k) {
    return beyond(r->accesses, r->distances_room, k);
}

uint64_t trace_reuse_misses(const trace_reuse *r, uint32_t k) {
    return beyond(r->misses, r->misses_room, k);
}

uint32_t trace_reuse_farthest(const trace_reuse *r) {
    for (uint32_t d = r->distances_room; d-- > 1;)
        if (r->accesses[d] > 0)
            return d;
    return 0;
}

void trace_reuse_free(trace_reuse *r) {
    free(r->block);
    free(r->tree);
    free(r->owner);
    free(r->accesses);
    free(r->misses);
    *r = (trace_reuse){0};
}
