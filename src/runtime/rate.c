/* How much a camera wants the blocks below a block. See rate.h.
 *
 * Hides: how a block is walked so that the positions of its exits are known: each subtree from its
 * root, whose position is noted; a left child is where its parent is. Pure; no memory but the
 * stack's. Paper: none. */
#include "rate.h"

#include <string.h>

#include "block.h"
#include "frame.h"

typedef struct inner {
    uint32_t node;
    mni_place at;
} inner;

typedef struct walk {
    const mni_look *look;
    const mni_block *block;
    float least; /* what is further from being wanted is not looked below: that is even less so */
    float *urgency;
    mni_notes *below;
    inner stack[MNI_BLOCK_DEPTH_MAX + 2]; /* right children to come: one a level */
    uint32_t depth;
} walk;

mni_note mni_rate_note(uint32_t subtree, const float position[3]) {
    mni_note note = {.word = {subtree}};
    memcpy(&note.word[1], position, 3 * sizeof *position);
    return note;
}

static float urgency_of(const mni_look *look, const mni_facts *facts, const float position[3]) {
    const mni_bounds bounds = {position, facts->radius, facts->switch_value, facts->cone};
    double priority_px = mni_lens_priority(&look->now, &bounds);
    if (look->moves) {
        const double ahead_px = mni_lens_priority(&look->ahead, &bounds);
        priority_px = ahead_px > priority_px ? ahead_px : priority_px;
    }
    const double tolerance_px = look->now.tolerance_px;
    return tolerance_px > 0 ? (float)(priority_px / tolerance_px) : 1;
}

static void raise_to(float *urgency, float value) {
    *urgency = value > *urgency ? value : *urgency;
}

/* A child: an exit is rated, an inner node goes on the stack. */
static void child_take(walk *w, const mni_child *child, const mni_place *at) {
    if (child->kind == MNI_CHILD_SUBTREE) {
        const float urgency = urgency_of(w->look, &child->facts, at->position);
        const mni_note note = mni_rate_note(child->subtree, at->position);
        if (urgency < w->least)
            return;
        raise_to(&w->urgency[child->ref], urgency);
        mni_notes_add(&w->below[child->ref], &note);
    }
    if (child->kind == MNI_CHILD_INNER && w->depth < MNI_BLOCK_DEPTH_MAX + 2)
        w->stack[w->depth++] = (inner){child->node, *at};
}

static void node_rate(walk *w, const inner *from) {
    mni_node node;
    mni_block_node(w->block, from->node, &from->at, &node);
    if (urgency_of(w->look, &node.facts, from->at.position) < w->least)
        return;
    if (node.overflow_ref != MN_NONE)
        raise_to(&w->urgency[node.overflow_ref],
                 urgency_of(w->look, &node.facts, from->at.position));
    mni_place left = from->at, right = from->at;
    left.leaf_hi = right.leaf_lo = node.leaf_mid;
    memcpy(right.position, node.right_position, sizeof right.position);
    child_take(w, &node.right, &right);
    child_take(w, &node.left, &left); /* the next to be taken: so the stack stays short */
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

void mni_rate_block(const void *context, const void *look, const void *bytes,
                    const mni_notes *notes, float least, float *urgency, mni_notes *below) {
    (void)context;
    mni_frame frame;
    mni_frame_get(bytes, &frame);
    /* of an overflow block: the rest of what is on its way */
    for (uint32_t i = 0; i < frame.refs; i++) {
        urgency[i] = frame.kind == MNI_FRAME_METANODE ? 0 : 1;
        below[i].count = 0;
    }
    if (frame.kind != MNI_FRAME_METANODE)
        return;
    mni_block block;
    mni_block_reopen(&block, bytes);
    walk w = {.look = look, .block = &block, .least = least, .urgency = urgency, .below = below};
    for (uint32_t s = 0; s < block.subtrees && notes->count > 0; s++) {
        mni_subtree subtree;
        mni_block_subtree(&block, s, &subtree);
        inner root = {subtree.node, {subtree.leaf_lo, subtree.leaf_hi, {0}}};
        memcpy(root.at.position, &nearest(notes, s)->word[1], sizeof root.at.position);
        w.stack[w.depth++] = root;
        while (w.depth > 0) {
            const inner next = w.stack[--w.depth];
            node_rate(&w, &next);
        }
    }
}
