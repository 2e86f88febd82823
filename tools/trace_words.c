/* See trace_words.h. */
#include "trace_words.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *const kinds[MN_TRACE_KINDS] = {
    [MN_TRACE_FRAME_BEGIN] = "frame_begin",
    [MN_TRACE_FRAME_END] = "frame_end",
    [MN_TRACE_PHASE] = "phase",
    [MN_TRACE_COUNT] = "count",
    [MN_TRACE_SPLIT] = "split",
    [MN_TRACE_COLLAPSE] = "collapse",
    [MN_TRACE_MISS] = "miss",
    [MN_TRACE_ABSENT] = "absent",
    [MN_TRACE_REFUSED] = "refused",
    [MN_TRACE_USE] = "use",
    [MN_TRACE_LEAVE] = "leave",
    [MN_TRACE_GRANT] = "grant",
    [MN_TRACE_GRANT_OVER] = "grant_over",
    [MN_TRACE_POST] = "post",
    [MN_TRACE_ENDED] = "ended",
    [MN_TRACE_SUBMIT] = "submit",
    [MN_TRACE_ARRIVED] = "arrived",
    [MN_TRACE_HOLDER] = "holder",
    [MN_TRACE_LOST] = "lost",
    [MN_TRACE_PREFETCH_USED] = "prefetch_used",
    [MN_TRACE_LOCK_WAIT] = "lock_wait",
};
const char *const trace_counter_names[MN_TRACE_COUNTERS] = {
    [MN_TRACE_N_SPLITS] = "splits",
    [MN_TRACE_N_COLLAPSES] = "collapses",
    [MN_TRACE_N_MISSES] = "misses",
    [MN_TRACE_N_REFUSED_FRONT] = "refused_front",
    [MN_TRACE_N_REFUSED_BUDGET] = "refused_budget",
    [MN_TRACE_N_REFUSED_POOL] = "refused_pool",
    [MN_TRACE_N_WAITS] = "waits_dependency",
    [MN_TRACE_N_NODES] = "active_nodes",
    [MN_TRACE_N_TRIANGLES] = "triangles",
    [MN_TRACE_N_TOLERANCE] = "tolerance_mpx",
    [MN_TRACE_N_IN_USE] = "blocks_in_use",
    [MN_TRACE_N_ANCESTORS] = "blocks_with_ancestors",
    [MN_TRACE_N_FREE] = "free",
    [MN_TRACE_N_EMPTY] = "empty",
    [MN_TRACE_N_LOADING] = "loading",
    [MN_TRACE_N_LOADED] = "loaded",
    [MN_TRACE_N_COMMANDS] = "commands_open",
};
const char *const trace_phase_names[MN_TRACE_PHASES] = {"collapses", "splits", "foresight",
                                                        "early splits", "store"};
const char *const trace_round_names[MN_TRACE_ROUNDS] = {"frame", "round", "opening", "settling"};
const char *const trace_thread_names[MN_TRACE_THREADS] = {"navigate", "io"};
static const char *const commands[] = {"prefetch", "urgent_up", "urgent_down", "?"};
static const char *const ends[] = {"loaded", "resident", "given_up", "failed"};
static const char *const states[] = {"empty",   "loading", "loaded", "freed",
                                     "retired", "?",       "?",      "?"};
static const char *const locks[MN_TRACE_LOCKS] = {"pool", "board"};

const char *trace_kind_name(const mn_trace_event *event) {
    return kinds[event->kind];
}

const char *trace_aux_name(const mn_trace_event *event) {
    static char text[40];
    const uint32_t aux = event->aux & (MN_TRACE_EARLY - 1);
    switch ((mn_trace_kind)event->kind) {
    case MN_TRACE_FRAME_BEGIN:
    case MN_TRACE_FRAME_END:
        return trace_round_names[aux];
    case MN_TRACE_PHASE:
        return trace_phase_names[aux];
    case MN_TRACE_COUNT:
        return trace_counter_names[aux];
    case MN_TRACE_MISS:
        return aux == 0 ? "split" : "collapse";
    case MN_TRACE_REFUSED:
        return aux == 0 ? "resident" : "absent";
    case MN_TRACE_GRANT_OVER:
        return aux == 0 ? "dropped" : "used";
    case MN_TRACE_ARRIVED:
        return aux == 0 ? "" : "error";
    case MN_TRACE_POST:
        return commands[aux & 3];
    case MN_TRACE_ENDED:
        snprintf(text, sizeof text, "%s:%s", commands[aux & 3], ends[aux >> 2 & 3]);
        return text;
    case MN_TRACE_HOLDER:
        snprintf(text, sizeof text, "%s:%s%s", states[aux & 7], states[aux >> 3 & 7],
                 (event->aux & MN_TRACE_EARLY) != 0 ? ":early" : "");
        return text;
    case MN_TRACE_LOST:
        snprintf(text, sizeof text, "%s%s", states[aux & 7], (aux & 8) != 0 ? ":unused" : "");
        return text;
    case MN_TRACE_LOCK_WAIT:
        return locks[aux];
    default:
        return "";
    }
}

/* ---- blocks ---------------------------------------------------------------------------------- */

static uint32_t place_of(const trace_map *map, uint32_t block_id) {
    uint32_t at = (block_id * UINT32_C(0x9e3779b1)) & (map->places - 1);
    while (map->place[at] != 0 && map->id[map->place[at] - 1] != block_id)
        at = (at + 1) & (map->places - 1);
    return at;
}

static bool rehash(trace_map *map) {
    const uint32_t places = map->places > 0 ? 2 * map->places : 1 << 10;
    uint32_t *place = places > map->places ? calloc(places, sizeof *place) : NULL;
    if (place == NULL)
        return false;
    free(map->place);
    map->place = place;
    map->places = places;
    for (uint32_t i = 0; i < map->count; i++)
        map->place[place_of(map, map->id[i])] = i + 1;
    return true;
}

uint32_t trace_map_number(trace_map *map, uint32_t block_id) {
    if (map->count >= map->places / 2 && !rehash(map))
        return MN_NONE;
    const uint32_t at = place_of(map, block_id);
    if (map->place[at] != 0)
        return map->place[at] - 1;
    if (!trace_grow((void **)&map->id, &map->room, map->count, sizeof *map->id))
        return MN_NONE;
    map->id[map->count] = block_id;
    map->place[at] = ++map->count;
    return map->count - 1;
}

bool trace_grow(void **array, uint32_t *room, uint32_t number, size_t size) {
    if (number < *room)
        return true;
    const uint64_t wish = (uint64_t)number + number / 2 + 256;
    void *more = wish < UINT32_MAX ? realloc(*array, wish * size) : NULL;
    if (more == NULL)
        return false;
    memset((unsigned char *)more + *room * size, 0, (wish - *room) * size);
    *array = more;
    *room = (uint32_t)wish;
    return true;
}

void trace_map_free(trace_map *map) {
    free(map->place);
    free(map->id);
    *map = (trace_map){0};
}
