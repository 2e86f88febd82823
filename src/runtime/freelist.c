/* The free list. See freelist.h. */
#include "freelist.h"

#include "mn_assert.h"

static void link_between(mni_freelist *list, mni_holders *holders, uint32_t slot, uint32_t prev,
                         uint32_t next) {
    mni_holder *holder = &holders->holder[slot];
    holder->prev = prev;
    holder->next = next;
    if (prev == MNI_NO_SLOT)
        list->first = slot;
    else
        holders->holder[prev].next = slot;
    if (next == MNI_NO_SLOT)
        list->last = slot;
    else
        holders->holder[next].prev = slot;
    list->count++;
}

void mni_freelist_open(mni_freelist *list, mni_holders *holders) {
    *list = (mni_freelist){.first = MNI_NO_SLOT, .last = MNI_NO_SLOT};
    for (uint32_t slot = 0; slot < holders->k; slot++)
        mni_freelist_append(list, holders, slot);
}

void mni_freelist_append(mni_freelist *list, mni_holders *holders, uint32_t slot) {
    link_between(list, holders, slot, list->last, MNI_NO_SLOT);
}

void mni_freelist_prepend(mni_freelist *list, mni_holders *holders, uint32_t slot) {
    link_between(list, holders, slot, MNI_NO_SLOT, list->first);
}

void mni_freelist_unlink(mni_freelist *list, mni_holders *holders, uint32_t slot) {
    mni_holder *holder = &holders->holder[slot];
    MN_ASSERT(list->count > 0);
    if (holder->prev == MNI_NO_SLOT) {
        MN_ASSERT(list->first == slot);
        list->first = holder->next;
    } else {
        holders->holder[holder->prev].next = holder->next;
    }
    if (holder->next == MNI_NO_SLOT) {
        MN_ASSERT(list->last == slot);
        list->last = holder->prev;
    } else {
        holders->holder[holder->next].prev = holder->prev;
    }
    holder->next = holder->prev = MNI_NO_SLOT;
    list->count--;
}

uint32_t mni_freelist_take(mni_freelist *list, mni_holders *holders) {
    uint32_t slot = list->first;
    if (slot != MNI_NO_SLOT)
        mni_freelist_unlink(list, holders, slot);
    return slot;
}
