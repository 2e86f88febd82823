/* What a trace comes to. See trace_report.h.
 *
 * Hides: what an event counts for. A first pass finds how many frames the run has, so that the
 * second can part it into periods. The run is the frames of the path: what comes before the first
 * (roots, an opening) or after the last (settling) counts for reads and commands alone, as in the
 * keys of replay --json. */
#include "trace_report.h"

#include <stdlib.h>
#include <string.h>

enum { GUESSES = 10 }; /* sizes of pools that nobody has asked for */

/* ---- blocks ---------------------------------------------------------------------------------- */

static report_block *block_of(trace_report *r, uint32_t id, uint32_t *number) {
    const uint32_t before = r->blocks.count;
    *number = trace_map_number(&r->blocks, id);
    r->failed |= *number == MN_NONE ||
                 !trace_grow((void **)&r->block, &r->block_room, *number, sizeof *r->block);
    if (r->failed)
        return NULL;
    if (r->blocks.count > before)
        r->block[*number].level = -1;
    return &r->block[*number];
}

static uint32_t level_of(int32_t level) {
    return level < 0 ? 0 : level < REPORT_LEVELS ? (uint32_t)level : REPORT_LEVELS - 1;
}

/* NULL: its place in the tree is not known. */
static report_level *level_at(trace_report *r, uint32_t id) {
    uint32_t number;
    const report_block *b = id != 0 ? block_of(r, id, &number) : NULL;
    return b != NULL && b->level >= 0 ? &r->level[level_of(b->level)] : NULL;
}

/* A block is named with its parent, which has been named before: its level is one more. */
static void place_in_tree(trace_report *r, uint32_t number, uint32_t parent_id) {
    uint32_t parent = 0;
    int32_t level = 0;
    if (r->block[number].level >= 0)
        return;
    if (parent_id != 0) {
        const report_block *p = block_of(r, parent_id, &parent);
        if (p == NULL || p->level < 0)
            return;
        level = p->level + 1;
    }
    r->block[number].level = level;
    r->block[number].parent = parent_id;
    report_level *l = &r->level[level_of(level)];
    l->blocks++;
    l->reads += r->block[number].reads;
    r->levels = level_of(level) >= r->levels ? level_of(level) + 1 : r->levels;
}

static uint32_t period_of(const trace_report *r, uint64_t frame) {
    return r->frames > 0 ? (uint32_t)(frame * REPORT_PERIODS / r->frames) : 0;
}

static report_period *period_now(trace_report *r) {
    return r->in_run && r->frame < r->frames ? &r->period[period_of(r, r->frame)] : NULL;
}

/* In use, at this moment of the run. */
static void seen_in_use(trace_report *r, report_block *b) {
    report_period *period = period_now(r);
    if (period == NULL)
        return;
    const uint32_t at = period_of(r, r->frame) + 1,
                   window = (uint32_t)(r->frame / REPORT_WINDOW) + 1;
    period->blocks += b->period != at;
    b->period = at;
    r->window_now += b->window != window;
    b->window = window;
}

/* ---- a block's life -------------------------------------------------------------------------- */

static void span_add(trace_report *r, const report_block *b, report_span span, uint64_t from_ns,
                     uint64_t to_ns) {
    if (from_ns > 0 && to_ns >= from_ns)
        spread_add(r->span[b->urgent][span], 1e-6 * (double)(to_ns - from_ns));
}

static void used(trace_report *r, report_block *b, uint64_t ns) {
    if (b->loaded_ns > 0) {
        span_add(r, b, REPORT_ISSUE, b->asked_ns, b->issued_ns);
        span_add(r, b, REPORT_READ, b->issued_ns, b->loaded_ns);
        span_add(r, b, REPORT_REST, b->loaded_ns, ns);
        span_add(r, b, REPORT_USE, b->asked_ns, ns);
    }
    b->asked_ns = b->issued_ns = b->loaded_ns = 0;
}

static void holder(trace_report *r, report_block *b, const mn_trace_event *e) {
    const mn_trace_place from = trace_place_from(e), to = trace_place_to(e);
    r->places[from]--;
    r->places[to]++;
    r->second_chances += from == MN_TRACE_FREED && to == MN_TRACE_LOADED;
    if (to != MN_TRACE_LOADING)
        return;
    r->reads++;
    b->reads++;
    b->issued_ns = e->ns;
    b->loaded_ns = 0;
    if (b->level >= 0)
        r->level[level_of(b->level)].reads++;
    report_period *period = period_now(r);
    if (period != NULL)
        period->reads++;
}

static void lost(trace_report *r, report_block *b, const mn_trace_event *e) {
    const mn_trace_place from = trace_place_from(e);
    report_period *period = period_now(r);
    if (from == MN_TRACE_LOADED) {
        r->evictions++;
        if (period != NULL)
            period->evictions++;
    }
    r->lost_unused += from != MN_TRACE_LOADING && (e->aux & 8) != 0;
    b->asked_ns = b->issued_ns = b->loaded_ns = 0;
}

static void ended(trace_report *r, report_block *b, const mn_trace_event *e) {
    const uint32_t command = e->aux & 3, end = e->aux >> 2 & 3;
    r->ended[command][end]++;
    if (end == MN_TRACE_END_LOADED) {
        b->loaded_ns = e->ns;
        b->urgent = command != MN_TRACE_PREFETCH;
    } else if (b->issued_ns == 0) {
        b->asked_ns = 0;
    }
}

static void miss(trace_report *r, uint32_t id) {
    uint32_t number;
    report_period *period = period_now(r);
    if (!r->in_run)
        return;
    r->misses++;
    r->frame_misses++;
    if (period != NULL)
        period->misses++;
    report_block *b = id != 0 ? block_of(r, id, &number) : NULL;
    if (b == NULL)
        return;
    b->misses++;
    trace_reuse_miss(&r->reuse, number);
    if (b->level >= 0)
        r->level[level_of(b->level)].misses++;
}

static void block_event(trace_report *r, const mn_trace_event *e) {
    uint32_t number;
    report_block *b = e->a != 0 ? block_of(r, e->a, &number) : NULL;
    if (b == NULL && e->kind != MN_TRACE_HOLDER)
        return;
    switch ((mn_trace_kind)e->kind) {
    case MN_TRACE_ABSENT:
        place_in_tree(r, number, e->b);
        trace_reuse_absent(&r->reuse, number);
        break;
    case MN_TRACE_USE:
        place_in_tree(r, number, e->b);
        b = &r->block[number]; /* it may have moved */
        r->level[level_of(b->level)].uses += b->level >= 0;
        trace_reuse_use(&r->reuse, number);
        seen_in_use(r, b);
        used(r, b, e->ns);
        break;
    case MN_TRACE_LEAVE:
        trace_reuse_leave(&r->reuse, number);
        seen_in_use(r, b);
        break;
    case MN_TRACE_POST:
        r->posted[e->aux]++;
        b->asked_ns = b->asked_ns > 0 ? b->asked_ns : e->ns;
        break;
    case MN_TRACE_ENDED:
        ended(r, b, e);
        break;
    case MN_TRACE_HOLDER:
        if (b != NULL) {
            holder(r, b, e);
        } else { /* a place without a block: retired, or back in service */
            r->places[trace_place_from(e)]--;
            r->places[trace_place_to(e)]++;
        }
        break;
    case MN_TRACE_LOST:
        lost(r, b, e);
        break;
    default:
        break;
    }
}

/* ---- frames ---------------------------------------------------------------------------------- */

/* Blocks in use all the time have no event in most periods. */
static void standing_blocks(trace_report *r) {
    for (uint32_t i = 0; i < r->blocks.count; i++)
        if (i < r->reuse.blocks && r->reuse.block[i].in_use)
            seen_in_use(r, &r->block[i]);
}

static void window_end(trace_report *r) {
    r->windows += r->window_now > 0;
    r->window_sum += r->window_now;
    r->window_max = r->window_now > r->window_max ? r->window_now : r->window_max;
    r->window_now = 0;
}

/* The frame before, rounds included, is over. */
static void frame_over(trace_report *r) {
    if (r->frame_misses > 0)
        r->miss_rate_sum += (double)r->frame_misses / (double)(r->frame_misses + r->frame_adapt);
    r->frame_misses = r->frame_adapt = 0;
}

static void frame_begin(trace_report *r, const mn_trace_event *e) {
    r->run_over |= e->aux == MN_TRACE_SETTLING && r->in_run;
    if (r->run_over || (e->aux != MN_TRACE_FRAME && e->aux != MN_TRACE_ROUND)) {
        r->in_run = false;
        return;
    }
    if (!r->in_run)
        r->first_ns = e->ns;
    r->in_run = true;
    r->frame_splits = r->frame_collapses = 0;
    if (e->aux == MN_TRACE_ROUND)
        return;
    frame_over(r);
    r->frame = e->a;
    report_period *period = period_now(r);
    if (period == NULL)
        return;
    if (period->frames++ == 0)
        period->frame = e->a;
    if (r->frame % REPORT_WINDOW == 0)
        window_end(r);
    if (r->frame % REPORT_WINDOW == 0 || period->frames == 1)
        standing_blocks(r);
}

static void frame_end(trace_report *r, const mn_trace_event *e) {
    if (!r->in_run)
        return;
    r->last_ns = e->ns;
    r->frame_adapt += r->frame_splits + r->frame_collapses;
    r->splits += r->frame_splits;
    r->collapses += r->frame_collapses;
    report_period *period = period_now(r);
    if (period != NULL)
        period->adapt += r->frame_splits + r->frame_collapses;
}

static void count(trace_report *r, const mn_trace_event *e) {
    const uint64_t value = trace_value(e);
    report_period *period = period_now(r);
    switch ((mn_trace_counter)(e->aux & (MN_TRACE_EARLY - 1))) {
    case MN_TRACE_N_SPLITS:
        r->moves_differ += r->in_run && value != r->frame_splits;
        break;
    case MN_TRACE_N_COLLAPSES:
        r->moves_differ += r->in_run && value != r->frame_collapses;
        break;
    case MN_TRACE_N_REFUSED_FRONT:
        r->refused_front += r->in_run ? value : 0;
        break;
    case MN_TRACE_N_REFUSED_BUDGET:
        r->refused_budget += r->in_run ? value : 0;
        break;
    case MN_TRACE_N_REFUSED_POOL:
        r->refused_pool += r->in_run ? value : 0;
        break;
    case MN_TRACE_N_IN_USE:
        r->in_use_max = r->in_run && value > r->in_use_max ? value : r->in_use_max;
        if (period != NULL)
            period->in_use = value > period->in_use ? value : period->in_use;
        break;
    case MN_TRACE_N_ANCESTORS:
        r->ancestors_max = r->in_run && value > r->ancestors_max ? value : r->ancestors_max;
        break;
    case MN_TRACE_N_FREE:
        r->counters_differ += value != r->places[MN_TRACE_EMPTY] + r->places[MN_TRACE_FREED];
        break;
    case MN_TRACE_N_LOADING:
        r->counters_differ += value != r->places[MN_TRACE_LOADING];
        break;
    case MN_TRACE_N_LOADED:
        r->counters_differ += value != r->places[MN_TRACE_LOADED];
        break;
    default:
        break;
    }
}

static void move(trace_report *r, const mn_trace_event *e) {
    const bool split = e->kind == MN_TRACE_SPLIT;
    if (!r->in_run)
        return;
    r->frame_splits += split;
    r->frame_collapses += !split;
    report_level *level = level_at(r, e->a);
    if (level != NULL) {
        level->splits += split;
        level->collapses += !split;
    }
}

static void event(trace_report *r, const mn_trace_event *e) {
    uint64_t waited_ns;
    switch ((mn_trace_kind)e->kind) {
    case MN_TRACE_FRAME_BEGIN:
        frame_begin(r, e);
        break;
    case MN_TRACE_FRAME_END:
        frame_end(r, e);
        break;
    case MN_TRACE_COUNT:
        count(r, e);
        break;
    case MN_TRACE_SPLIT:
    case MN_TRACE_COLLAPSE:
        move(r, e);
        break;
    case MN_TRACE_MISS:
        miss(r, e->a);
        break;
    case MN_TRACE_GRANT:
        r->grants++;
        break;
    case MN_TRACE_REFUSED:
        r->refused_urgent += e->aux;
        break;
    case MN_TRACE_PREFETCH_USED:
        r->prefetches_used++;
        break;
    case MN_TRACE_ARRIVED:
        r->io_errors += e->aux;
        r->arrived_bytes += e->aux == 0 ? e->b : 0;
        break;
    case MN_TRACE_LOCK_WAIT:
        waited_ns = trace_value(e);
        r->lock_waits[e->thread]++;
        if (waited_ns > r->lock_wait_ns_max[e->thread])
            r->lock_wait_ns_max[e->thread] = waited_ns;
        break;
    default:
        block_event(r, e);
        break;
    }
}

/* ---- all of it ------------------------------------------------------------------------------- */

/* The frames of the run, by their numbers. */
static mn_code count_frames(mn_trace_file *file, uint64_t *frames, mn_status *st) {
    mn_trace_event e;
    mn_code code;
    *frames = 0;
    mn_trace_rewind(file);
    while (mn_trace_next(file, &e, &code, st)) {
        if (e.kind != MN_TRACE_FRAME_BEGIN)
            continue;
        if (e.aux == MN_TRACE_SETTLING && *frames > 0)
            break;
        if (e.aux == MN_TRACE_FRAME)
            *frames = (uint64_t)e.a + 1;
    }
    return code;
}

static void most_missed(trace_report *r) {
    for (uint32_t i = 0; i < r->blocks.count; i++) {
        const report_block *b = &r->block[i];
        uint32_t at = r->missed_count;
        for (; at > 0 && r->missed[at - 1].misses < b->misses; at--)
            if (at < REPORT_MISSED) {
                r->missed[at] = r->missed[at - 1];
                r->missed_id[at] = r->missed_id[at - 1];
            }
        if (at == REPORT_MISSED || b->misses == 0)
            continue;
        r->missed[at] = *b;
        r->missed_id[at] = r->blocks.id[i];
        r->missed_count += r->missed_count < REPORT_MISSED;
    }
}

static void add_size(trace_report *r, uint64_t k) {
    uint32_t at = r->sizes;
    for (uint32_t i = 0; i < r->sizes; i++)
        if (r->size[i] == k)
            return;
    if (r->sizes == REPORT_SIZES || k == 0)
        return;
    for (; at > 0 && r->size[at - 1] > k; at--)
        r->size[at] = r->size[at - 1];
    r->size[at] = k;
    r->sizes++;
}

/* From what was in use at once, without which nothing goes, to the farthest distance, and the run's
 * own. */
static void choose_sizes(trace_report *r, const uint64_t *size, uint32_t sizes) {
    const uint64_t farthest = trace_reuse_farthest(&r->reuse);
    for (uint32_t i = 0; i < sizes; i++)
        add_size(r, size[i]);
    if (r->info->store == MN_STORE_PAGED)
        add_size(r, r->info->k);
    if (sizes > 0 || farthest == 0)
        return;
    add_size(r, farthest);
    for (uint64_t i = 0, least = r->in_use_max; least < farthest && i < GUESSES; i++)
        add_size(r, least + i * (farthest - least) / GUESSES);
}

mn_code trace_report_make(mn_trace_file *file, const uint64_t *size, uint32_t sizes,
                          trace_report *out, mn_status *st) {
    mn_trace_event e;
    trace_report *r = out;
    *r = (trace_report){.file = file, .info = mn_trace_info_of(file)};
    for (int i = 0; i < 2 * REPORT_SPANS; i++) {
        r->span[i / REPORT_SPANS][i % REPORT_SPANS] = calloc(1, sizeof(spread));
        r->failed |= r->span[i / REPORT_SPANS][i % REPORT_SPANS] == NULL;
    }
    r->places[MN_TRACE_EMPTY] = r->info->k;
    mn_code code = count_frames(file, &r->frames, st);
    mn_trace_rewind(file);
    while (code == MN_OK && !r->failed && !r->reuse.failed && mn_trace_next(file, &e, &code, st))
        event(r, &e);
    if (r->failed || r->reuse.failed)
        return mn_fail(st, MN_FAILED, "no memory for so many blocks");
    frame_over(r);
    window_end(r);
    trace_reuse_end(&r->reuse);
    most_missed(r);
    choose_sizes(r, size, sizes);
    return code;
}

/* Below the run's own K a miss in the run tells nothing of uses that it had in time: those are
 * taken to cost as many misses each as the others did. */
report_guess trace_report_guess(const trace_report *r, uint64_t k) {
    const uint32_t at = k < UINT32_MAX ? (uint32_t)k : UINT32_MAX - 1;
    const bool paged = r->info->store == MN_STORE_PAGED;
    const uint64_t reads_own = trace_reuse_reads(&r->reuse, r->info->k);
    report_guess g = {.reads = trace_reuse_reads(&r->reuse, at),
                      .misses = trace_reuse_misses(&r->reuse, at)};
    if (paged && k < r->info->k && reads_own > 0) {
        const uint64_t misses_own = trace_reuse_misses(&r->reuse, r->info->k);
        const double each = (double)misses_own / (double)reads_own;
        g.misses = misses_own + (uint64_t)(each * (double)(g.reads - reads_own) + 0.5);
    }
    const double adapt = (double)(r->splits + r->collapses);
    g.miss_rate = g.misses > 0 ? (double)g.misses / ((double)g.misses + adapt) : 0;
    return g;
}

void trace_report_free(trace_report *r) {
    for (int i = 0; i < 2 * REPORT_SPANS; i++)
        free(r->span[i / REPORT_SPANS][i % REPORT_SPANS]);
    free(r->block);
    trace_map_free(&r->blocks);
    trace_reuse_free(&r->reuse);
}
