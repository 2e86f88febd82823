/* Blocks that I/O may read on its own account. See scout.h. */
#include "scout.h"

#include "mn_assert.h"

/* As many as there are places for what they find. */
static uint32_t most(uint32_t k) {
    return k < MNI_SCOUTS_LEAST ? MNI_SCOUTS_LEAST : k < MNI_SCOUTS_MAX ? k : MNI_SCOUTS_MAX;
}

size_t mni_scouts_need(uint32_t k) {
    return mni_arena_need(most(k), sizeof(mni_scout), _Alignof(mni_scout));
}

void mni_scouts_open(mni_scouts *scouts, uint32_t k, mni_arena *arena) {
    *scouts = (mni_scouts){
        .scout = mni_arena_take(arena, most(k), sizeof(mni_scout), _Alignof(mni_scout)),
        .max = most(k)};
}

static bool before(const mni_scout *a, const mni_scout *b) {
    if (a->urgency != b->urgency)
        return a->urgency > b->urgency;
    return a->command.ref.id < b->command.ref.id;
}

static void sift_up(mni_scout *heap, uint32_t at, mni_scout moving) {
    for (; at > 0 && before(&moving, &heap[(at - 1) / 2]); at = (at - 1) / 2)
        heap[at] = heap[(at - 1) / 2];
    heap[at] = moving;
}

static void sift_down(mni_scout *heap, uint32_t count, mni_scout moving) {
    uint32_t at = 0;
    for (uint32_t child; (child = 2 * at + 1) < count; at = child) {
        child += child + 1 < count && before(&heap[child + 1], &heap[child]);
        if (!before(&heap[child], &moving))
            break;
        heap[at] = heap[child];
    }
    heap[at] = moving;
}

/* The last of all is one without children. */
static uint32_t find_last(const mni_scouts *scouts) {
    uint32_t last = scouts->count / 2;
    for (uint32_t i = last + 1; i < scouts->count; i++)
        last = before(&scouts->scout[last], &scouts->scout[i]) ? i : last;
    return last;
}

bool mni_scouts_push(mni_scouts *scouts, const mni_command *command, float urgency) {
    mni_scout scout = {.command = *command, .urgency = urgency};
    bool room = scouts->count < scouts->max;
    uint32_t at = room ? scouts->count++ : find_last(scouts);
    const bool stays = room || before(&scout, &scouts->scout[at]);
    if (!room)
        mni_command_trace_end(stays ? &scouts->scout[at].command : command, MNI_END_GIVEN_UP);
    if (stays)
        sift_up(scouts->scout, at, scout);
    return room;
}

bool mni_scouts_pop(mni_scouts *scouts, mni_command *out) {
    if (scouts->count == 0)
        return false;
    *out = scouts->scout[0].command;
    scouts->count--;
    if (scouts->count > 0)
        sift_down(scouts->scout, scouts->count, scouts->scout[scouts->count]);
    return true;
}
