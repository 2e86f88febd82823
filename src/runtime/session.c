/* A session: one open file, its plan, its store, its front.
 *
 * Hides: how these are put together, and what a frame's figures are made of.
 *
 * Order of calls: open; opening; then frame, settle, front, stats, check in any order; close.
 * Threads: all calls from one thread (Navigate); the I/O thread is the store's.
 * Memory: the session itself, and one arena of the size that the plan says, sealed at the end of
 * open. Nothing is allocated after that. Under a cap huge pages are refused: they would make memory
 * resident that nobody touched. Paper: §3.3. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "mn_assert.h"
#include "clock.h"
#include "lock.h"
#include "metanode/runtime.h"
#include "navigate.h"
#include "ram_plan.h"
#include "rate.h"
#include "trace.h"

enum {
    WIDTH_PX = 1280,
    HEIGHT_PX = 720,
    ROUNDS_MAX = 1 << 16, /* frames that one frame with a barrier may take */
};

/* Under a target of triangles no tolerance need be given: they go where errors are largest, and as
 * far down as nobody sees. */
#define TOLERANCE_LEAST_PX (1.0f / 1024)

struct mn_session {
    /* const after open */
    mn_session_desc desc; /* path and hooks are the caller's; the store uses them until close */
    mn_header header;
    mn_plan plan;
    mni_block_limits limits;
    mni_arena arena;
    mni_store *store;
    uint32_t *usage; /* recounts: one an entry */
    uint32_t entries_max;

    /* Navigate only */
    mni_trace *trace; /* NULL: none */
    mni_navigator nav;
    float tolerance_px;
    uint32_t frame;
    uint64_t hash, hash_version; /* of the front, and the version it was taken at */
    mn_session_stats total;
};

static double ms_of(clockid_t clock) {
    return 1e-6 * (double)mni_clock_ns(clock);
}

static double now_ms(void) {
    return ms_of(CLOCK_MONOTONIC);
}

static double cpu_ms(void) {
    return ms_of(CLOCK_THREAD_CPUTIME_ID);
}

/* ---- open ------------------------------------------------------------------------------------ */

static mni_trace_ring *ring_of(const mn_session *s, mn_trace_thread thread) {
    return s->trace != NULL ? mni_trace_ring_of(s->trace, thread) : NULL;
}

/* What a trace says of the session that it is of. */
static mn_code trace_open(mn_session *s, mn_status *st) {
    const mn_session_desc *d = &s->desc;
    const mn_header *h = &s->header;
    const bool simulated = d->store == MN_STORE_PAGED && d->io == MN_IO_SIM;
    const char *slash = strrchr(d->path, '/');
    mn_trace_info info = {.clock = simulated ? MN_TRACE_VIRTUAL : MN_TRACE_MONOTONIC,
                          .build_id = h->build_id,
                          .model_bytes = h->file_bytes,
                          .triangles = h->triangles,
                          .leaves = h->leaves,
                          .blocks = h->blocks,
                          .block_bytes_max = h->block_bytes_max,
                          .block_depth = h->block_depth,
                          .l = h->l,
                          .k = s->plan.k,
                          .k_min = s->plan.k_min,
                          .front_max = s->plan.front_max,
                          .store = d->store,
                          .io = d->io,
                          .prefetch = d->prefetch,
                          .io_serial = d->io_serial,
                          .barrier = d->barrier,
                          .degrade_off = d->degrade_off,
                          .seed = d->seed,
                          .ram_cap_bytes = d->ram_bytes,
                          .nav_ops = d->nav_ops,
                          .tolerance_px = s->tolerance_px,
                          .fps = d->fps,
                          .width_px = d->width_px,
                          .height_px = d->height_px};
    snprintf(info.model, sizeof info.model, "%.127s", slash != NULL ? slash + 1 : d->path);
    return d->trace_path == NULL ? MN_OK : mni_trace_open(d->trace_path, &info, &s->trace, st);
}

static double model_size(const mn_header *header) {
    double square = 0;
    for (int i = 0; i < 3; i++) {
        double side = (double)header->box_max[i] - (double)header->box_min[i];
        square += side * side;
    }
    return sqrt(square) / 2;
}

/* What the first frame's camera sees. */
static mni_look first_look(const mn_session *s, const mn_camera *camera) {
    const mn_session_desc *d = &s->desc;
    mni_look look = {.coordinate_max = mni_coordinate_max(&s->header)};
    mni_lens_make(&look.now, camera, d->width_px, d->height_px,
                  mni_lens_distance_min(model_size(&s->header)), s->tolerance_px, &d->weights);
    look.ahead = look.now;
    return look;
}

static mn_code store_open(mn_session *s, mn_status *st) {
    const mn_session_desc *d = &s->desc;
    mni_look look;
    mni_note note[MN_ROOTS_MAX];
    mni_store_desc store = {.path = d->path,
                            .header = &s->header,
                            .kind = d->store,
                            .k = s->plan.k,
                            .io = d->io,
                            .io_serial = d->io_serial,
                            .seed = d->seed,
                            .sim = d->sim,
                            .check = mni_front_block_check,
                            .check_context = &s->limits,
                            .prefetch = d->prefetch,
                            .rate = mni_rate_block,
                            .look_bytes = sizeof(mni_look),
                            .trace_io = ring_of(s, MN_TRACE_IO),
                            .warn = d->warn,
                            .warn_context = d->warn_context};
    if (d->first_camera != NULL) {
        look = first_look(s, d->first_camera);
        for (uint32_t r = 0; r < s->header.roots; r++)
            note[r] = mni_rate_note(s->header.root[r].subtree, s->header.root[r].position);
        store.first_look = &look;
        store.first_note = note;
    }
    return mni_store_open(&store, &s->arena, &s->store, st);
}

static mn_code parts_open(mn_session *s, mn_status *st) {
    mn_code code = mni_arena_open(
        &s->arena, mni_ram_plan_arena_bytes(&s->plan, &s->header, s->desc.store), st);
    if (code != MN_OK)
        return code;
    /* Advice: may fail. Without a cap huge pages save a third of a large front's time. */
    bool capped = s->desc.ram_bytes > 0;
    (void)madvise(s->arena.base, s->arena.size_bytes, capped ? MADV_NOHUGEPAGE : MADV_HUGEPAGE);
    s->entries_max = mni_store_entries_max(&s->header, s->desc.store, s->plan.k);
    s->usage = mni_arena_take(&s->arena, s->entries_max, sizeof *s->usage, 64);
    mni_trace_ring *before = mni_trace_swap(ring_of(s, MN_TRACE_NAVIGATE));
    code = store_open(s, st);
    (void)mni_trace_swap(before);
    if (code != MN_OK)
        return code;
    s->nav.ops_max = s->desc.nav_ops;
    s->nav.degrades = !s->desc.degrade_off;
    s->nav.looks_ahead = s->desc.store == MN_STORE_PAGED && s->desc.prefetch == MN_PREFETCH_AHEAD;
    s->nav.width_px = s->desc.width_px;
    s->nav.height_px = s->desc.height_px;
    s->nav.weights = s->desc.weights;
    s->nav.triangles_max = s->desc.triangles_max;
    s->nav.size = model_size(&s->header);
    return mni_navigator_open(&s->nav, s->store, &s->header, s->plan.front_max,
                              s->plan.simplices_max, &s->arena, st);
}

/* Who gives a cap is told what it is not about. */
static void say_beside_cap(const mn_session *s) {
    mn_status line = {0};
    if (s->desc.store != MN_STORE_RESIDENT || s->desc.ram_bytes == 0 || s->desc.warn == NULL)
        return;
    mn_fail(&line, MN_OK,
            "%s: --store resident has the whole file in memory, %.1f MB, beside the cap of %.1f: "
            "the plan is of the rest",
            s->desc.path, (double)s->header.file_bytes / 1048576,
            (double)s->desc.ram_bytes / 1048576);
    s->desc.warn(s->desc.warn_context, line.text);
}

mn_code mn_session_open(const mn_session_desc *desc, mn_session **out, mn_status *st) {
    *out = NULL;
    mn_session *s = calloc(1, sizeof *s);
    if (s == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a session");
    s->desc = *desc;
    s->desc.width_px = desc->width_px > 0 ? desc->width_px : WIDTH_PX;
    s->desc.height_px = desc->height_px > 0 ? desc->height_px : HEIGHT_PX;
    s->hash_version = UINT64_MAX;
    float tolerance_px = desc->triangles_max > 0 ? TOLERANCE_LEAST_PX : 1;
    mn_session_set_tolerance(s, desc->tolerance_px != 0 ? desc->tolerance_px : tolerance_px);
    if (desc->triangles_max > 0 && desc->degrade_off) {
        mn_session_close(s);
        return mn_fail(st, MN_USAGE,
                       "a target of triangles moves the tolerance, which is to stand "
                       "still (--degrade off)");
    }
    const uint64_t trace_bytes =
        desc->trace_path != NULL ? mni_trace_need_bytes(desc->ram_bytes > 0) : 0;
    mni_ram_plan_desc plan = {desc->ram_bytes, desc->base_bytes + trace_bytes, desc->k,
                              desc->front_max};
    mn_code code = mn_header_read(desc->path, &s->header, st);
    if (code == MN_OK)
        code = mni_store_can(&s->header, desc->store, desc->path, st);
    if (code == MN_OK)
        code = mni_ram_plan_make(&plan, &s->header, &s->plan, st);
    s->limits = mni_block_limits_of(&s->header);
#ifdef MN_SLOW_CHECKS
    if (code == MN_OK)
        s->desc.closed |= mni_front_input_is_closed(desc->path, &s->header);
#endif
    if (code == MN_OK)
        code = trace_open(s, st);
    if (code == MN_OK)
        code = parts_open(s, st);
    s->desc.first_camera = NULL; /* the caller's, until now */
    if (code != MN_OK) {
        mn_session_close(s);
        return code;
    }
    mni_arena_seal(&s->arena);
    say_beside_cap(s);
    *out = s;
    return MN_OK;
}

mn_code mn_session_end(mn_session *s, mn_status *st) {
    if (s == NULL)
        return MN_OK;
    if (s->store != NULL)
        mni_store_close(s->store);
    const mn_code code = mni_trace_close(s->trace, st);
    mni_arena_close(&s->arena);
    free(s);
    return code;
}

void mn_session_close(mn_session *s) {
    (void)mn_session_end(s, NULL);
}

bool mn_session_trace_has_failed(const mn_session *s) {
    return s->trace != NULL && mni_trace_has_failed(s->trace);
}

void mn_session_plan(const mn_session *s, mn_plan *out) {
    *out = s->plan;
}

const mn_header *mn_session_header(const mn_session *s) {
    return &s->header;
}

/* ---- frames ---------------------------------------------------------------------------------- */

static void trace_work(const mn_session *s) {
    const mni_work *work = &s->nav.work;
    MNI_TRACE_COUNT(MN_TRACE_N_SPLITS, work->splits);
    MNI_TRACE_COUNT(MN_TRACE_N_COLLAPSES, work->collapses);
    MNI_TRACE_COUNT(MN_TRACE_N_MISSES, work->misses);
    MNI_TRACE_COUNT(MN_TRACE_N_REFUSED_FRONT, work->refused_front);
    MNI_TRACE_COUNT(MN_TRACE_N_REFUSED_BUDGET, work->refused_budget);
    MNI_TRACE_COUNT(MN_TRACE_N_REFUSED_POOL, work->refused_pool);
    MNI_TRACE_COUNT(MN_TRACE_N_WAITS, work->waits_dependency);
    MNI_TRACE_COUNT(MN_TRACE_N_NODES, s->nav.front.active);
    MNI_TRACE_COUNT(MN_TRACE_N_TRIANGLES, s->nav.front.triangles);
    MNI_TRACE_COUNT(MN_TRACE_N_TOLERANCE, fmin(1e3 * s->nav.lens.tolerance_px, 1e18));
}

/* Waits until nothing is asked for and nothing is read. */
static void drain(mn_session *s) {
    mni_trace_ring *before = mni_trace_swap(ring_of(s, MN_TRACE_NAVIGATE));
    mni_store_drain(s->store);
    (void)mni_trace_swap(before);
    if (s->trace != NULL)
        mni_trace_drain(s->trace);
}

static uint32_t most(uint32_t a, uint32_t b) {
    return a > b ? a : b;
}

/* One round of Navigate. Adds to *stats; returns whether anything changed or is still to come. */
static bool navigate_once(mn_session *s, const mn_camera *camera, mn_frame_stats *stats) {
    double start_ms = now_ms(), start_cpu_ms = cpu_ms();
    (void)mni_lock_waits_since(); /* those outside of frames */
    mni_store_frame_begin(s->store);
    mni_navigator_frame(&s->nav, camera, s->tolerance_px);
    double waits_ms = now_ms();
    mni_store_frame_end(s->store, s->desc.fps > 0 ? 1.0 / (double)s->desc.fps : 0);
    waits_ms = s->desc.io_serial ? now_ms() - waits_ms : 0;
    uint32_t pending = mni_store_pending(s->store);
    mni_navigator_give_way(&s->nav, pending > 0);
    stats->nav_ms += now_ms() - start_ms - waits_ms;
    stats->nav_cpu_ms += cpu_ms() - start_cpu_ms;
    mni_lock_waits locks = mni_lock_waits_since();
    s->total.nav_lock_waits += locks.count;
    if (locks.max_ns > s->total.nav_lock_wait_ns_max)
        s->total.nav_lock_wait_ns_max = locks.max_ns;
    const mni_work *work = &s->nav.work;
    stats->splits += work->splits;
    stats->collapses += work->collapses;
    stats->adapt += work->splits + work->collapses;
    stats->splits_undone += work->undone;
    stats->triangles_made += work->triangles_made;
    stats->triangles_removed += work->triangles_removed;
    stats->misses += work->misses;
    stats->refused_front += work->refused_front;
    stats->refused_budget += work->refused_budget;
    stats->refused_pool += work->refused_pool;
    stats->waits_dependency += work->waits_dependency;
    stats->blocks_in_use = most(stats->blocks_in_use, mni_store_in_use(s->store));
    stats->blocks_with_ancestors =
        most(stats->blocks_with_ancestors, mni_store_with_ancestors(s->store));
#ifdef MN_SLOW_CHECKS
    mn_session_check(s);
#endif
    return work->splits + work->collapses > 0 || pending > 0 || !s->nav.level.settled;
}

static bool navigate(mn_session *s, const mn_camera *camera, mn_trace_round round,
                     mn_frame_stats *stats) {
    mni_trace_ring *before = mni_trace_swap(ring_of(s, MN_TRACE_NAVIGATE));
    MNI_TRACE(MN_TRACE_FRAME_BEGIN, round, s->frame, 0);
    const bool changed = navigate_once(s, camera, stats);
    if (mni_trace_on())
        trace_work(s);
    MNI_TRACE(MN_TRACE_FRAME_END, round, s->frame, 0);
    (void)mni_trace_swap(before);
    if (s->trace != NULL)
        mni_trace_drain(s->trace);
    return changed;
}

/* The front's hash; the agenda, idle between frames, is the scratch. */
static uint64_t front_hash(mn_session *s) {
    mni_front *front = &s->nav.front;
    if (s->hash_version != front->version) {
        s->hash = mni_front_hash(front, (uint32_t *)s->nav.agenda.item);
        s->hash_version = front->version;
    }
    return s->hash;
}

/* What a frame's figures need besides the counts of its rounds. before: the store's, then. */
static void stats_finish(mn_session *s, const mn_session_stats *before, mn_frame_stats *stats) {
    mn_session_stats after = {0};
    mni_store_stats(s->store, &after);
    stats->frame = s->frame;
    stats->active_nodes = s->nav.front.active;
    stats->triangles = s->nav.front.triangles;
    stats->tolerance_px = s->nav.lens.tolerance_px;
    stats->error_px = mni_navigator_error_px(&s->nav, &stats->error_inside_px);
    stats->front_over_wanted = NAN;
    if (s->desc.store == MN_STORE_RESIDENT && s->desc.wide_front_over_wanted)
        stats->front_over_wanted = mni_navigator_front_over_wanted(&s->nav);
    stats->reads = after.reads - before->reads;
    stats->read_bytes = after.read_bytes - before->read_bytes;
    stats->evictions = after.evictions - before->evictions;
    stats->second_chances = after.second_chances - before->second_chances;
    stats->prefetches = after.prefetches - before->prefetches;
    stats->front_hash = front_hash(s);
    stats->blocks_resident = mni_store_in_memory(s->store);
}

static void count_frame(mn_session *s, const mn_frame_stats *frame) {
    s->total.frames++;
    s->total.misses += frame->misses;
    s->total.adapt += frame->adapt;
    s->total.splits_undone += frame->splits_undone;
    s->total.triangles_made += frame->triangles_made;
    s->total.triangles_removed += frame->triangles_removed;
    s->total.active_nodes += s->nav.front.active;
    s->total.refused_front += frame->refused_front;
    s->total.refused_budget += frame->refused_budget;
    s->total.refused_pool += frame->refused_pool;
    s->total.waits_dependency += frame->waits_dependency;
}

void mn_session_frame(mn_session *s, const mn_camera *camera, mn_frame_stats *stats) {
    mn_frame_stats here = {0};
    mn_session_stats before = {0};
    if (stats != NULL)
        mni_store_stats(s->store, &before);
    here.changed = navigate(s, camera, MN_TRACE_FRAME, &here);
    if (s->desc.barrier) {
        for (int round = 1; here.changed && round < ROUNDS_MAX; round++) {
            drain(s);
            here.changed = navigate(s, camera, MN_TRACE_ROUND, &here);
        }
    }
    count_frame(s, &here);
    if (stats != NULL) {
        stats_finish(s, &before, &here);
        *stats = here;
    }
    s->frame++;
}

bool mn_session_opening(mn_session *s, const mn_camera *camera, mn_frame_stats *stats) {
    MN_ASSERT(s->frame == 0);
    mn_frame_stats here = {0};
    here.changed = navigate(s, camera, MN_TRACE_OPENING, &here);
    drain(s);
    if (stats != NULL)
        *stats = here;
    return here.changed;
}

uint32_t mn_session_settle(mn_session *s, const mn_camera *camera, uint32_t frames_max) {
    for (uint32_t frame = 1; frame <= frames_max; frame++) {
        mn_frame_stats here = {0};
        bool changed = navigate(s, camera, MN_TRACE_SETTLING, &here);
        count_frame(s, &here);
        s->frame++;
        if (!changed)
            return frame;
        drain(s);
    }
    return frames_max;
}

void mn_session_drain(mn_session *s) {
    drain(s);
}

/* The next frame's camera is another one: what has been found to fit or not is forgotten. */
static void counts_as_move(mn_session *s) {
    s->nav.camera = (mn_camera){0};
}

bool mn_session_shrink(mn_session *s) {
    mni_trace_ring *before = mni_trace_swap(ring_of(s, MN_TRACE_NAVIGATE));
    const bool done = mni_store_shrink(s->store);
    (void)mni_trace_swap(before);
    if (done)
        counts_as_move(s);
    return done;
}

bool mn_session_grow(mn_session *s) {
    mni_trace_ring *before = mni_trace_swap(ring_of(s, MN_TRACE_NAVIGATE));
    const bool done = mni_store_grow(s->store);
    (void)mni_trace_swap(before);
    if (done)
        counts_as_move(s);
    return done;
}

void mn_session_set_tolerance(mn_session *s, float tolerance_px) {
    MN_ASSERT(!isnan(tolerance_px));
    s->tolerance_px = tolerance_px;
}

void mn_session_set_size(mn_session *s, uint32_t width_px, uint32_t height_px) {
    MN_ASSERT(width_px > 0 && height_px > 0);
    s->nav.width_px = width_px;
    s->nav.height_px = height_px;
    counts_as_move(s);
}

void mn_session_set_weights(mn_session *s, const mn_weights *weights) {
    s->nav.weights = *weights;
    counts_as_move(s);
}

void mn_session_set_triangles_max(mn_session *s, uint64_t triangles_max) {
    s->nav.triangles_max = triangles_max;
    counts_as_move(s);
}

bool mn_session_at_roots(const mn_session *s) {
    return s->nav.front.active == s->header.roots;
}

void mn_session_stats_get(const mn_session *s, mn_session_stats *out) {
    *out = (mn_session_stats){0};
    mni_store_stats(s->store, out);
    out->checksum_failures += s->nav.front.bad; /* good checksums, lying contents */
    out->frames = s->total.frames;
    out->misses = s->total.misses;
    out->adapt = s->total.adapt;
    out->splits_undone = s->total.splits_undone;
    out->triangles_made = s->total.triangles_made;
    out->triangles_removed = s->total.triangles_removed;
    out->active_nodes = s->total.active_nodes;
    out->refused_front = s->total.refused_front;
    out->refused_budget = s->total.refused_budget;
    out->refused_pool = s->total.refused_pool;
    out->waits_dependency = s->total.waits_dependency;
    out->nav_lock_waits = s->total.nav_lock_waits;
    out->nav_lock_wait_ns_max = s->total.nav_lock_wait_ns_max;
}

void mn_session_front(const mn_session *s, mn_front *out) {
    const mni_front *front = &s->nav.front;
    *out = (mn_front){.node_slots = front->slots_high,
                      .position = front->position,
                      .color = front->color,
                      .switch_value = front->switch_value,
                      .simplex_slots = front->simplices_high - 1, /* simplex 0 is none */
                      .simplex_node = front->simplex_node + 3,
                      .simplex_leaf = front->simplex_leaf + 3,
                      .triangles = front->triangles,
                      .version = front->version,
                      .node_stamp = front->node_stamp,
                      .simplex_stamp = front->simplex_stamp};
}

/* ---- checks ---------------------------------------------------------------------------------- */

static uint32_t usage_of(void *context, mni_entry entry) {
    const mn_session *s = context;
    return s->usage[entry];
}

void mn_session_check(mn_session *s) {
    mni_navigator_check(&s->nav);
    MN_ASSERT(!s->desc.closed || mni_front_imbalance(&s->nav.front) == 0);
    memset(s->usage, 0, s->entries_max * sizeof *s->usage);
    mni_front_usage(&s->nav.front, s->usage);
    mni_store_check_all(s->store, usage_of, s);
}

static void normal_of(const float *const p[3], double out[3]) {
    double u[3], v[3];
    for (int i = 0; i < 3; i++) {
        u[i] = (double)p[1][i] - (double)p[0][i];
        v[i] = (double)p[2][i] - (double)p[0][i];
    }
    out[0] = u[1] * v[2] - u[2] * v[1];
    out[1] = u[2] * v[0] - u[0] * v[2];
    out[2] = u[0] * v[1] - u[1] * v[0];
}

uint64_t mn_session_foldovers(mn_session *s, uint64_t *legal) {
    MN_ASSERT(s->desc.store == MN_STORE_RESIDENT);
    mni_front *front = &s->nav.front;
    uint64_t count = 0, legal_count = 0;
    for (uint32_t simplex = 0; simplex < front->simplices_high; simplex++) {
        const uint32_t *node = &front->simplex_node[3 * (size_t)simplex];
        const uint32_t *leaf = &front->simplex_leaf[3 * (size_t)simplex];
        if (node[0] == MN_NONE || node[2] == MN_NONE)
            continue;
        float input[3][3];
        const float *now[3], *then[3] = {input[0], input[1], input[2]};
        bool there = true, all_legal = true;
        for (int k = 0; k < 3; k++) {
            now[k] = &front->position[3 * (size_t)node[k]];
            there = mni_front_leaf_position(front, node[k], leaf[k], input[k]) && there;
            all_legal = all_legal && front->node[node[k]].order <= s->header.legal_last;
        }
        double a[3], b[3];
        normal_of(now, a);
        normal_of(then, b);
        if (there && a[0] * b[0] + a[1] * b[1] + a[2] * b[2] < 0) {
            count++;
            legal_count += all_legal;
        }
    }
    if (legal != NULL)
        *legal = legal_count;
    return count;
}
