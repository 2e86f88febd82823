/* trace_dice SEED FILE: a trace, sound to the byte, of events that follow from nothing. For
 * test_trace.sh: whoever reads it must neither fall over nor draw a flow that does not join. */
#include <stdlib.h>

#include "trace.h"

static uint64_t state;
static uint32_t dice(uint32_t below) {
    state = state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (uint32_t)(state >> 33) % below;
}

static uint32_t dice_aux(mn_trace_kind kind) {
    switch (kind) {
    case MN_TRACE_FRAME_BEGIN:
    case MN_TRACE_FRAME_END:
        return dice(6) > 0 ? MN_TRACE_FRAME : dice(MN_TRACE_ROUNDS);
    case MN_TRACE_PHASE:
        return dice(MN_TRACE_PHASES);
    case MN_TRACE_COUNT:
        return dice(MN_TRACE_COUNTERS);
    case MN_TRACE_POST:
        return dice(MN_TRACE_COMMANDS);
    case MN_TRACE_ENDED:
        return dice(MN_TRACE_COMMANDS) + 4 * dice(MN_TRACE_ENDS);
    case MN_TRACE_HOLDER:
        return dice(MN_TRACE_PLACES) + 8 * dice(MN_TRACE_PLACES) +
               (dice(9) > 0 ? 0 : MN_TRACE_EARLY);
    case MN_TRACE_LOST:
        return dice(MN_TRACE_PLACES) + 8 * dice(2);
    case MN_TRACE_MISS:
    case MN_TRACE_REFUSED:
    case MN_TRACE_GRANT_OVER:
    case MN_TRACE_ARRIVED:
    case MN_TRACE_LOCK_WAIT:
        return dice(2);
    default:
        return 0;
    }
}

int main(int argc, char **argv) {
    mni_trace *trace;
    if (argc != 3)
        return 2;
    state = strtoull(argv[1], NULL, 10);
    const mn_trace_info info = {.clock = MN_TRACE_VIRTUAL,
                                .k = dice(5) > 0 ? dice(300) : UINT32_MAX,
                                .k_min = dice(100),
                                .store = dice(5),
                                .prefetch = dice(9),
                                .model = "a\x1b[31m\"b"};
    if (mni_trace_open(argv[2], &info, &trace, NULL) != MN_OK)
        return 1;
    const uint32_t events = dice(20000), blocks = dice(3) > 0 ? 50 : 1 << 30;
    for (uint32_t i = 0; i < events; i++) {
        const mn_trace_kind kind = (mn_trace_kind)dice(MN_TRACE_KINDS);
        const bool numbered = kind <= MN_TRACE_FRAME_END && dice(4) > 0;
        (void)mni_trace_swap(mni_trace_ring_of(trace, (mn_trace_thread)dice(MN_TRACE_THREADS)));
        if (dice(50) == 0)
            mni_trace_clock(i * UINT64_C(1000));
        mni_trace_put(kind, dice_aux(kind), numbered ? i / 50 : dice(blocks), dice(blocks));
    }
    (void)mni_trace_swap(NULL);
    return mni_trace_close(trace, NULL) == MN_OK ? 0 : 1;
}
