/* What stands in a trace, in words, and blocks by number. Main thread only. */
#ifndef METANODE_TRACE_WORDS_H
#define METANODE_TRACE_WORDS_H

#include <stddef.h>

#include "metanode/format.h"
#include "metanode/trace.h"

const char *trace_kind_name(const mn_trace_event *event);
/* Of what stands in aux, by kind; "" where nothing does. Until the next call. */
const char *trace_aux_name(const mn_trace_event *event);
extern const char *const trace_counter_names[MN_TRACE_COUNTERS];
extern const char *const trace_phase_names[MN_TRACE_PHASES];
extern const char *const trace_round_names[MN_TRACE_ROUNDS];
extern const char *const trace_thread_names[MN_TRACE_THREADS];
static inline uint64_t trace_value(const mn_trace_event *event) { /* of MN_TRACE_COUNT */
    return event->a | (uint64_t)event->b << 32;
}
static inline mn_trace_place trace_place_from(const mn_trace_event *event) {
    return (mn_trace_place)(event->aux & 7);
}
static inline mn_trace_place trace_place_to(const mn_trace_event *event) {
    return (mn_trace_place)(event->aux >> 3 & 7);
}

/* Blocks that have been seen, numbered from 0 in the order of their coming: for arrays beside it.
 */
typedef struct trace_map {
    uint32_t *place; /* hashed by id: number + 1; 0: none */
    uint32_t *id;    /* by number */
    uint32_t places, count, room;
} trace_map;
/* The number of a block; MN_NONE where there is no memory for another. */
uint32_t trace_map_number(trace_map *map, uint32_t block_id);
/* Makes room for an element with that number, zeroed: doubles what is too small. false: no memory.
 */
bool trace_grow(void **array, uint32_t *room, uint32_t number, size_t size);
void trace_map_free(trace_map *map);

#endif
