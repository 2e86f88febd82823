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
 * Hides: a table by order id in which a newer node takes an older one's place. What is forgotten is
 * searched for again: nothing is wrong then, only slower. So order ids of nodes that a chain had
 * made and undone, which are in no slot, do as well.
 *
 * Any order of calls after open. Threads: Navigate only. Memory: the arena's, fixed. Paper: none.
 */
#include "lacking.h"

static uint32_t entries(uint32_t nodes_max) {
    uint32_t count = 64;
    while (count < nodes_max && count < MNI_LACKING_MAX)
        count *= 2;
    return count;
}

size_t mni_lacking_need(uint32_t nodes_max) {
    return mni_arena_need(entries(nodes_max), sizeof(mni_lack), 64);
}

void mni_lacking_open(mni_lacking *lacking, uint32_t nodes_max, mni_arena *arena) {
    uint32_t count = entries(nodes_max);
    *lacking = (mni_lacking){
        .lack = mni_arena_take(arena, count, sizeof(mni_lack), 64), .mask = count - 1, .first = 1};
}

void mni_lacking_forget(mni_lacking *lacking) {
    if (lacking->chain > UINT32_MAX / 2) { /* hours of chains: numbers begin again */
        for (uint32_t i = 0; i <= lacking->mask; i++)
            lacking->lack[i] = (mni_lack){0};
        lacking->chain = 0;
    }
    lacking->first = lacking->chain + 1;
    lacking->any = false;
}

static mni_lack *place(mni_lacking *lacking, uint32_t order) {
    return &lacking->lack[order * 0x9e3779b1u >> 16 & lacking->mask];
}

void mni_lacking_put(mni_lacking *lacking, uint32_t order, uint32_t block_id, bool brief) {
    *place(lacking, order) =
        (mni_lack){.order = order, .chain = lacking->chain, .block_id = block_id, .brief = brief};
    lacking->any = true;
}

void mni_lacking_put_sound(mni_lacking *lacking, uint32_t order) {
    mni_lack *at = place(lacking, order);
    if (at->chain < lacking->first || at->sound ||
        at->brief) /* what lacks something is worth more */
        *at = (mni_lack){.order = order, .chain = lacking->chain, .sound = true};
}
