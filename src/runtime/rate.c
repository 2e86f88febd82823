/* How much a camera wants the blocks below a block. See rate.h.
 *
 * Hides: how a block is walked so that the positions of its exits are known: each subtree from its
 * root, whose position is noted; a left child is where its parent is. What is looked at is what may
 * still tell something: nothing below a node that is wanted too little, no further exits to a block
 * that is known to be wanted. Pure; no memory but the stack's. Paper: none. */
#include "rate.h"

#include <string.h>

#include "block.h"
#include "frame.h"
#include "sieve.h"

typedef struct inner {
    uint32_t node;
    uint32_t trusted; /* so many levels down nobody is asked whether it is wanted */
    mni_place at;
} inner;

/* A camera to which what is asked for is just wanted. */
typedef struct eye {
    mni_lens lens;
    mni_sieve sieve;
} eye;

typedef struct walk {
    const mni_block *block;
    eye eye[2]; /* now, and in a moment where that differs */
    uint32_t eyes;
    bool all; /* whatever there is is wanted */
    float tolerance_px, least;
    float *urgency;
    mni_notes *below;
    uint32_t open;                        /* references of which more may be said */
    inner stack[MNI_BLOCK_DEPTH_MAX + 2]; /* right children to come: one a level */
    uint32_t depth;
} walk;

mni_note mni_rate_note(uint32_t subtree, const float position[3]) {
    mni_note note = {.word = {subtree}};
    memcpy(&note.word[1], position, 3 * sizeof *position);
    return note;
}

static void eye_make(eye *e, const mni_look *look, const mni_lens *lens, float least) {
    e->lens = *lens;
    e->lens.tolerance_px *= (double)least;
    mni_sieve_make(&e->sieve, &e->lens, look->coordinate_max);
}

/* 0: less than asked for. What is wanted now is rated as it is now. */
static float urgency_of(const walk *w, const mni_facts *facts, const float position[3]) {
    const mni_bounds bounds = {position, facts->radius, facts->switch_value, facts->cone};
    float most = w->all ? 1 : 0;
    for (uint32_t i = 0; i < w->eyes && most < 1; i++) {
        double px;
        if (!mni_sieve_wants(&w->eye[i].sieve, &w->eye[i].lens, &bounds, &px))
            continue;
        const float urgency = (float)px / w->tolerance_px;
        most = urgency > most ? urgency : most;
    }
    return most;
}

static bool is_open(const walk *w, uint32_t ref) {
    return w->urgency[ref] < 1 || w->below[ref].count < MNI_NOTES_MAX;
}

static void raise_to(walk *w, uint32_t ref, float value, const mni_note *note) {
    const bool was_open = is_open(w, ref);
    w->urgency[ref] = value > w->urgency[ref] ? value : w->urgency[ref];
    if (note != NULL)
        mni_notes_add(&w->below[ref], note);
    w->open -= was_open && !is_open(w, ref);
}

/* Errors fall by half from a node to its children, or less: what has four times what is asked for
 * has children that are likely to have it, and to look at them costs little. */
static uint32_t levels_of(const walk *w, float urgency) {
    return (urgency >= 4 * w->least) + (urgency >= 16 * w->least);
}

/* A child: an exit is rated, an inner node goes on the stack. */
static void child_take(walk *w, mni_child *child, const mni_place *at, uint32_t trusted) {
    if (child->kind == MNI_CHILD_SUBTREE) {
        mni_block_way(w->block, child);
        const float urgency =
            is_open(w, child->ref) ? urgency_of(w, &child->facts, at->position) : 0;
        const mni_note note = mni_rate_note(child->subtree, at->position);
        if (urgency > 0)
            raise_to(w, child->ref, urgency, &note);
    } else if (child->kind == MNI_CHILD_INNER && w->depth < MNI_BLOCK_DEPTH_MAX + 2) {
        if (trusted == 0) {
            const float urgency = urgency_of(w, &child->facts, at->position);
            if (!(urgency > 0))
                return;
            trusted = 1 + levels_of(w, urgency);
        }
        w->stack[w->depth++] = (inner){child->node, trusted - 1, *at};
    }
}

static void node_rate(walk *w, const inner *from) {
    mni_node node;
    mni_block_split(w->block, from->node, &from->at, &node);
    mni_block_children(w->block, &node);
    if (node.overflow_ref != MN_NONE) {
        mni_block_facts(w->block, from->node, &node.facts);
        raise_to(w, node.overflow_ref, urgency_of(w, &node.facts, from->at.position), NULL);
    }
    mni_place left = from->at, right = from->at;
    left.leaf_hi = right.leaf_lo = node.leaf_mid;
    memcpy(right.position, node.right_position, sizeof right.position);
    child_take(w, &node.right, &right, from->trusted);
    child_take(w, &node.left, &left,
               from->trusted); /* the next to be taken: so the stack stays short */
}

/* All of a subtree. */
static void subtree_rate(walk *w, uint32_t index, const mni_note *note) {
    mni_subtree subtree;
    mni_facts facts;
    mni_block_subtree(w->block, index, &subtree);
    mni_block_facts(w->block, subtree.node, &facts);
    inner next = {subtree.node, 0, {subtree.leaf_lo, subtree.leaf_hi, {0}}};
    memcpy(next.at.position, &note->word[1], sizeof next.at.position);
    const float urgency = urgency_of(w, &facts, next.at.position);
    if (!(urgency > 0))
        return;
    next.trusted = levels_of(w, urgency);
    w->stack[w->depth++] = next;
    while (w->depth > 0 && w->open > 0) {
        next = w->stack[--w->depth];
        node_rate(w, &next);
    }
    w->depth = 0;
}

/* Subtrees that stand side by side in a block do so on the surface: the place of one will do for
 * another, of which nothing has been noted. */
static const mni_note *nearest(const mni_notes *notes, uint32_t subtree) {
    const mni_note *best = &notes->note[0];
    uint32_t least = UINT32_MAX;
    for (uint32_t i = 0; i < notes->count; i++) {
        const uint32_t at = notes->note[i].word[0];
        const uint32_t distance = at > subtree ? at - subtree : subtree - at;
        best = distance < least ? &notes->note[i] : best;
        least = distance < least ? distance : least;
    }
    return best;
}

void mni_rate_block(const void *context, const void *look_bytes, const void *bytes,
                    const mni_notes *notes, float least, float *urgency, mni_notes *below) {
    (void)context;
    const mni_look *look = look_bytes;
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    /* of an overflow block: the rest of what is on its way */
    for (uint32_t i = 0; i < frame.refs; i++) {
        urgency[i] = frame.kind == MNI_FRAME_METANODE ? 0 : 1;
        below[i].count = 0;
    }
    if (frame.kind != MNI_FRAME_METANODE)
        return;
    if (notes->count == 0)
        return;
    mni_block block;
    mni_block_reopen(&block, bytes);
    walk w;
    w.block = &block;
    w.eyes = look->moves ? 2 : 1;
    w.all = !(look->now.tolerance_px > 0) || !(least > 0);
    w.tolerance_px = (float)look->now.tolerance_px;
    w.least = least;
    w.urgency = urgency;
    w.below = below;
    w.open = frame.refs;
    w.depth = 0;
    if (!w.all) {
        eye_make(&w.eye[0], look, &look->now, least);
        if (look->moves)
            eye_make(&w.eye[1], look, &look->ahead, least);
    }
    for (uint32_t s = 0; s < block.subtrees && w.open > 0; s++)
        subtree_rate(&w, s, nearest(notes, s));
}
