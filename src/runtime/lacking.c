/* What the chains of a frame lack.
 *
 * Hundreds of wanted nodes may need the same split, which is not possible because a block is
 * absent; each of their chains would be found by hundreds of splits, as far as there, and undone.
 * What one of them has found stands for the frame: which nodes cannot be split for want of which
 * block, and which others could (sound), so that nobody splits them again only to see what else is
 * absent. A block that comes meanwhile is found in the next frame.
 *
 * In a pass of splits that stays true, but for one case: a chain may have split a node for the sake
 * of another, so that one of its children blocks a third, which the node itself did not (of a
 * strip, a component of two or three nodes). Who leaves that out waits for a block that it does not
 * need, until that has come. So what lacks a block that may never come, as its reads fail, is known
 * to its own chain alone (brief).
 *
 * Hides: a table by order id in sets of four, where what is worth least makes room: what is
 * forgotten, then what is sound, then what is oldest. What it has lost is searched for again:
 * nothing is wrong then, only slower; much slower, where thousands of nodes wait for one block and
 * a chain comes by them on many ways. So it has a record for each sixteenth node of the front. And
 * bits, eight a record, of what may be there: most questions are of nodes of which nothing is
 * known, and a record is seldom in a cache. Order ids of nodes that a chain had made and undone,
 * which are in no slot, do as well.
 *
 * Any order of calls after open. Threads: Navigate only. Memory: the arena's, fixed: a byte or two
 * a node of the front and a little, 1.1 MB at most. Paper: none. */
#include "lacking.h"

#include <string.h>

/* Sets, as a power of two. */
static int sets_log2(uint32_t nodes_max) {
    int log2 = 4;
    while (log2 < MNI_LACKING_SETS_LOG2 && (uint64_t)MNI_LACKING_WAYS << log2 < nodes_max &&
           (log2 < 8 || (16ull * MNI_LACKING_WAYS) << log2 < nodes_max))
        log2++;
    return log2;
}

static size_t entries(uint32_t nodes_max) {
    return (size_t)MNI_LACKING_WAYS << sets_log2(nodes_max);
}

size_t mni_lacking_need(uint32_t nodes_max) {
    return mni_arena_need(entries(nodes_max), sizeof(mni_lack), 64) +
           mni_arena_need(entries(nodes_max), 1, 64);
}

void mni_lacking_open(mni_lacking *lacking, uint32_t nodes_max, mni_arena *arena) {
    *lacking =
        (mni_lacking){.lack = mni_arena_take(arena, entries(nodes_max), sizeof(mni_lack), 64),
                      .maybe = mni_arena_take(arena, entries(nodes_max), 1, 64),
                      .entries = (uint32_t)entries(nodes_max),
                      .shift = 32 - sets_log2(nodes_max),
                      .first = 1};
}

void mni_lacking_forget(mni_lacking *lacking) {
    if (lacking->chain > UINT32_MAX / 2) { /* hours of chains: numbers begin again */
        for (uint32_t i = 0; i < lacking->entries; i++)
            lacking->lack[i] = (mni_lack){0};
        lacking->chain = 0;
    }
    if (lacking->marked)
        memset(lacking->maybe, 0, lacking->entries);
    lacking->first = lacking->chain + 1;
    lacking->marked = false;
    lacking->any = false;
}

/* What is in it, not the least worth knowing. */
static bool lacks(const mni_lacking *lacking, const mni_lack *at) {
    return at->chain >= lacking->first && !at->sound && !at->brief;
}

/* The node's record, or the one whose place it takes. */
static mni_lack *place(mni_lacking *lacking, uint32_t order) {
    mni_lack *set = mni_lacking_set(lacking, order), *least = set;
    uint64_t least_worth = UINT64_MAX;
    for (int i = 0; i < MNI_LACKING_WAYS; i++) {
        if (set[i].chain >= lacking->first && set[i].order == order)
            return &set[i];
        const uint64_t worth = ((uint64_t)lacks(lacking, &set[i]) << 32) + set[i].chain;
        if (worth < least_worth) {
            least_worth = worth;
            least = &set[i];
        }
    }
    return least;
}

static void mark(mni_lacking *lacking, uint32_t order) {
    uint64_t bit;
    *mni_lacking_word(lacking, order, &bit) |= bit;
    lacking->marked = true;
}

void mni_lacking_put(mni_lacking *lacking, uint32_t order, uint32_t block_id, bool brief) {
    mark(lacking, order);
    *place(lacking, order) =
        (mni_lack){.order = order, .chain = lacking->chain, .block_id = block_id, .brief = brief};
    lacking->any = true;
}

void mni_lacking_put_sound(mni_lacking *lacking, uint32_t order) {
    mni_lack *at = place(lacking, order);
    if (lacks(lacking, at)) /* that is worth more */
        return;
    mark(lacking, order);
    *at = (mni_lack){.order = order, .chain = lacking->chain, .sound = true};
}
