/* Nodes that are wanted and stand refused by the pool: counted, and not looked at. See barred.c. */
#ifndef MNI_BARRED_H
#define MNI_BARRED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "agenda.h"
#include "store.h"

enum {
    MNI_BARRED_SHARE = 16,  /* of the front's nodes: so many have a place … */
    MNI_BARRED_FIRST = 256, /* … and so many besides. The first have a look in each frame … */
    MNI_BARRED_FRAMES = 4,  /* … all others in one of so many: their order is that old */
};

typedef struct mni_barred_node {
    mni_agenda_item item; /* as it was when it was looked at last */
    float due;            /* it is wanted until the clock of motion passes that */
    mni_refusal refusal;  /* of a block that is known */
} mni_barred_node;

/* node: | those of this pass, in their order … count | free | next … left of the last pass's | */
typedef struct mni_barred {
    mni_barred_node *node;
    uint64_t *bit; /* one a slot: its node is in the list, or marked on the agenda */
    float *due;    /* the navigator's, one a slot: of who has a bit, as in his place */
    uint32_t slots_max, max, count, next;
} mni_barred;

size_t mni_barred_need(uint32_t nodes_max);
/* due: of nodes_max slots. */
void mni_barred_open(mni_barred *barred, uint32_t nodes_max, float *due, mni_arena *arena);

static inline bool mni_barred_has(const mni_barred *barred, uint32_t slot) {
    return (barred->bit[slot / 64] >> (slot % 64) & 1) != 0;
}
/* Of 64 slots from that one on, a multiple of 64. */
static inline uint64_t mni_barred_bits(const mni_barred *barred, uint32_t first) {
    return barred->bit[first / 64];
}
/* The node in a slot, an item of the agenda, is wanted up to then. It has a place when it has had
 * its turn (add). */
void mni_barred_mark(mni_barred *barred, uint32_t slot, float due);
/* The node in a slot goes, or is to be looked at: if it has a bit, it has none now, and is due. */
void mni_barred_drop_slow(mni_barred *barred, uint32_t slot);
static inline void mni_barred_drop(mni_barred *barred, uint32_t slot) {
    if (mni_barred_has(barred, slot))
        mni_barred_drop_slow(barred, slot);
}
/* Nobody is in the list. What was due when is the caller's to set. */
void mni_barred_clear(mni_barred *barred);

/* A pass begins: those whose look is due are dropped, the others are to have their turn. */
void mni_barred_begin(mni_barred *barred, float clock, uint32_t frame);
/* The next one whose turn comes before that rank (mni_agenda_rank), for the caller to keep or drop;
 * NULL: there is none. */
const mni_barred_node *mni_barred_next(mni_barred *barred, uint64_t rank);
void mni_barred_keep(mni_barred *barred, const mni_barred_node *next);
/* A node that is marked has had its turn, and was refused. Where there is no place it is dropped.
 */
void mni_barred_add(mni_barred *barred, mni_agenda_item item, mni_refusal refusal);
/* Between passes: who has a bit has one place, and all are in their order. Asserts. */
void mni_barred_check(const mni_barred *barred);

#endif
