/* Store `paged`: the pool, the board, the disk and the I/O loop, put together.
 *
 * Secret: whether I/O is a thread or steps on virtual time. With a disk of its own time (the
 * simulated one) there is no thread: the steps run inside frame_end and drain, in the caller's, so
 * that a seed replays a run exactly.
 *
 * Navigate only; the thread that it may start is its own. Only open, drain and, with io_serial,
 * frame_end wait for a disk. Memory: the arena's, by K. (Paper §3.3.2 to 3.3.4) */
#define _GNU_SOURCE
#include <stdio.h>
#include <sys/mman.h>

#include "mn_assert.h"
#include "frame.h"
#include "ioloop.h"

enum {
    ANCESTORS_TIMES = 4,         /* entries = 4 × (K + depth of the block tree): design.md §3.5 */
    ROOT_FRAMES_MAX = 256,       /* frames in which a root block that fails is tried: 8 times */
    WARNINGS_MAX = 8,            /* lines on bad blocks; after that they are only counted */
    NS_PER_FRAME_FREE = 1000000, /* virtual time of a frame when frames take none */
    SLOT_HOLDERS = 8,            /* place holders for each slot of a compressed file's, … */
    SLOTS_MIN = 4,               /* … so that its extents take a ninth of the room at most */
};

typedef struct paged {
    /* const after open */
    mni_store_desc desc;
    /* Navigate only */
    uint64_t clock_ns; /* virtual */
    uint64_t spent_ns; /* of the frame, by that clock */
    uint64_t frames;
    uint32_t warnings;
    /* each with its own rules */
    mni_disk disk;
    mni_board board;
    mni_pool pool;
    mni_ioloop loop;
    mni_extents extents; /* Navigate opens, I/O reads */
} paged;

static bool compressed(const mn_header *header) {
    return header->zstd_level > 0;
}

/* As many as the disk takes reads, or as are in proportion. */
static uint32_t slots_for(uint32_t k) {
    const uint32_t fit = k / SLOT_HOLDERS;
    return fit > MNI_DISK_DEPTH ? MNI_DISK_DEPTH : fit < SLOTS_MIN ? SLOTS_MIN : fit;
}

static size_t need_bytes(const mn_header *header, uint32_t k) {
    return mni_arena_need(1, sizeof(paged), _Alignof(paged)) + mni_pool_need(header, k) +
           mni_board_need(k, mni_pool_prefetches_max(k), MNI_LOOK_BYTES_MAX) +
           mni_ioloop_need(header, k, MNI_LOOK_BYTES_MAX) + mni_disk_need() +
           mni_extents_need(header, slots_for(k));
}

static uint32_t entries_max(const mn_header *header, uint32_t k) {
    uint64_t max = ANCESTORS_TIMES * ((uint64_t)k + header->block_depth);
    return max < header->blocks ? (uint32_t)max : header->blocks;
}

/* ---- warnings -------------------------------------------------------------------------------- */

static void report(paged *p, const mni_report *report) {
    char text[400];
    if (p->desc.warn == NULL || p->warnings > WARNINGS_MAX)
        return;
    if (p->warnings++ < WARNINGS_MAX)
        snprintf(text, sizeof text,
                 "%s: block %u: %s; shown with less detail there, and tried again", p->desc.path,
                 report->block_id, report->why);
    else
        snprintf(text, sizeof text, "%s: further bad blocks are counted and not named",
                 p->desc.path);
    p->desc.warn(p->desc.warn_context, text);
}

/* ---- frames ---------------------------------------------------------------------------------- */

/* Runs the steps of virtual time up to until_ns; UINT64_MAX: until all is quiet. */
static void run_until(paged *p, uint64_t until_ns) {
    const mni_method *method = p->disk.method;
    do
        (void)mni_ioloop_step(&p->loop, false);
    while (mni_board_open_commands(&p->board) > 0 && method->advance(p->disk.self, until_ns));
    if (until_ns != UINT64_MAX)
        (void)method->advance(p->disk.self, until_ns);
}

static void drain(void *self) {
    paged *p = self;
    if (!p->disk.method->own_time)
        mni_board_wait_quiet(&p->board);
    while (p->disk.method->own_time && mni_board_open_commands(&p->board) > 0)
        run_until(p, UINT64_MAX);
}

static void frame_begin(void *self) {
    paged *p = self;
    mni_report reports[MNI_REPORTS_MAX];
    uint32_t count = mni_pool_begin_frame(&p->pool, reports);
    for (uint32_t i = 0; i < count; i++)
        report(p, &reports[i]);
}

static uint64_t frame_length_ns(double frame_s) {
    return frame_s > 0 ? (uint64_t)(frame_s * 1e9) : NS_PER_FRAME_FREE;
}

static void post(void *self) {
    paged *p = self;
    mni_pool_post(&p->pool);
    if (p->desc.io_serial)
        drain(p);
}

static void meanwhile(void *self, double seconds) {
    paged *p = self;
    if (!p->disk.method->own_time)
        return;
    const uint64_t ns = (uint64_t)(seconds * 1e9);
    p->spent_ns += ns;
    p->clock_ns += ns;
    run_until(p, p->clock_ns);
}

static void frame_end(void *self, double frame_s) {
    paged *p = self;
    mni_pool_end_frame(&p->pool);
    p->frames++;
    if (p->disk.method->own_time) {
        if (p->desc.sim.fault_frames > 0)
            p->disk.method->faults(p->disk.self, p->frames < p->desc.sim.fault_frames);
        const uint64_t frame_ns = frame_length_ns(frame_s);
        p->clock_ns += frame_ns > p->spent_ns ? frame_ns - p->spent_ns : 0;
        p->spent_ns = 0;
        run_until(p, p->clock_ns);
    }
    if (p->desc.io_serial)
        drain(p);
}

/* ---- open and close -------------------------------------------------------------------------- */

static bool is_root(const paged *p, uint32_t block_id) {
    const mn_header *header = p->desc.header;
    for (uint32_t r = 0; r < header->roots; r++)
        if (header->root[r].block.id == block_id)
            return true;
    return false;
}

static bool roots_are_there(paged *p) {
    const mn_header *header = p->desc.header;
    bool all = true;
    for (uint32_t r = 0; r < header->roots; r++)
        all = all && mni_pool_has(&p->pool, header->root[r].block.id);
    return all;
}

/* The one wait: root blocks come, or are tried again as any other would be. Their grants keep them
 * until Navigate takes them. */
static mn_code load_roots(paged *p, mn_status *st) {
    const mn_header *header = p->desc.header;
    mni_report reports[MNI_REPORTS_MAX], last = {0};
    for (uint32_t frame = 0; frame < ROOT_FRAMES_MAX; frame++) {
        uint32_t count = mni_pool_begin_frame(&p->pool, reports);
        for (uint32_t i = 0; i < count; i++)
            if (is_root(p, reports[i].block_id))
                last = reports[i];
            else
                report(p, &reports[i]); /* of the top of the tree: the run goes on without */
        if (roots_are_there(p))
            return MN_OK;
        for (uint32_t r = 0; r < header->roots; r++) {
            mni_pool_ask_root(&p->pool, header->root[r].block);
            if (p->desc.first_note != NULL)
                mni_pool_note(&p->pool, header->root[r].block.id, &p->desc.first_note[r]);
        }
        mni_pool_end_frame(&p->pool);
        drain(p);
    }
    return mn_fail(st, MN_BAD_INPUT, "%s: root block %u: %s; copy or build the file again",
                   p->desc.path, last.block_id, last.why != NULL ? last.why : "it does not come");
}

static void close_paged(void *self) {
    paged *p = self;
    mni_ioloop_stop(&p->loop);
    MN_ASSERT(mni_board_open_commands(&p->board) == 0);
    mni_disk_close(&p->disk);
    mni_pool_close(&p->pool);
    mni_board_close(&p->board);
}

/* Place holders, or the slots for extents: what is read into is registered with the kernel. */
static mni_chunks read_into(const paged *p) {
    const mni_holders *holders = &p->pool.holders;
    const mni_extents *extents = &p->extents;
    if (compressed(p->desc.header)) {
        return (mni_chunks){extents->slots, extents->slots_bytes, extents->slots_bytes, 1};
    }
    return (mni_chunks){.base = holders->bytes,
                        .chunk_bytes = (size_t)holders->chunk_holders * holders->holder_bytes,
                        .all_bytes = (size_t)holders->k * holders->holder_bytes,
                        .count = holders->chunks};
}

static mn_code open_paged(const mni_store_desc *desc, mni_arena *arena, void **out, mn_status *st) {
    const mn_header *header = desc->header;
    uint32_t k_min = mni_store_k_min(header);
    if (desc->k < k_min)
        return mn_fail(st, MN_CAP_TOO_SMALL, "%s: -K %u is too small; the smallest is %u",
                       desc->path, desc->k, k_min);
    paged *p = mni_arena_take(arena, 1, sizeof *p, _Alignof(paged));
    p->desc = *desc;
    MN_ASSERT(desc->look_bytes <= MNI_LOOK_BYTES_MAX);
    mni_board_open(&p->board, desc->k, mni_pool_prefetches_max(desc->k), desc->look_bytes, arena);
    mni_pool_open(&p->pool, desc, &p->board, arena);
    mn_code code = mni_extents_open(&p->extents, desc->path, header, slots_for(desc->k), arena, st);
    mni_disk_desc disk = {.path = desc->path,
                          .kind = desc->io,
                          .file_bytes = mni_stored_bytes(header),
                          .chunks = read_into(p),
                          .seed = desc->seed,
                          .sim = desc->sim,
                          .warn = desc->warn,
                          .warn_context = desc->warn_context};
    if (code == MN_OK)
        code = mni_disk_open(&p->disk, &disk, arena, st);
    if (code == MN_OK && compressed(header))
        mni_extents_align(&p->extents, p->disk.align_bytes);
    if (code == MN_OK) {
        p->loop = (mni_ioloop){.pool = &p->pool,
                               .board = &p->board,
                               .disk = &p->disk,
                               .extents = compressed(header) ? &p->extents : NULL,
                               .header = header,
                               .check = desc->check,
                               .check_context = desc->check_context,
                               .trace = desc->trace_io,
                               .serial = desc->io_serial};
        if (desc->prefetch == MN_PREFETCH_AHEAD) {
            p->loop.rate = desc->rate;
            p->loop.rate_context = desc->rate_context;
        }
        mni_ioloop_open(&p->loop, desc->look_bytes, arena);
        if (desc->first_look != NULL) {
            mni_board_look(&p->board, desc->first_look);
            p->loop.first_looks = 1;
        }
        if (!p->disk.method->own_time)
            code = mni_ioloop_start(&p->loop, st);
        if (code == MN_OK)
            code = load_roots(p, st);
        if (code == MN_OK) {
            *out = p;
            return MN_OK;
        }
        close_paged(p);
        return code;
    }
    mni_pool_close(&p->pool);
    mni_board_close(&p->board);
    return code;
}

/* ---- into use -------------------------------------------------------------------------------- */

static mni_answer enter(void *self, const mni_wish *wish, const void **bytes) {
    return mni_pool_enter(&((paged *)self)->pool, wish, bytes);
}

static void leave(void *self, uint32_t block_id, bool gone) {
    mni_pool_leave(&((paged *)self)->pool, block_id, gone);
}

static mni_answer overflow(void *self, const mni_wish *wish, const void **bytes) {
    return mni_pool_overflow(&((paged *)self)->pool, wish, bytes);
}

static void left(void *self) {
    mni_pool_left(&((paged *)self)->pool);
}

static void attempt_over(void *self) {
    mni_pool_attempt_over(&((paged *)self)->pool);
}

static mni_refusal refusal(const void *self, bool alone) {
    const mni_pool *pool = &((const paged *)self)->pool;
    return (mni_refusal){.block_id = pool->refusal.block_id,
                         .need = alone ? pool->need_alone : pool->refusal.need};
}

static void refuse(void *self, const mni_refusal *known, uint32_t table_count, uint32_t in_use) {
    mni_pool_refuse(&((paged *)self)->pool, known, table_count, in_use);
}

static bool comes(void *self, uint32_t block_id) {
    return mni_pool_comes(&((paged *)self)->pool, block_id);
}

static int64_t room(const void *self, uint32_t table_count, uint32_t in_use) {
    return mni_pool_room(&((const paged *)self)->pool, table_count, in_use);
}

static bool has_place(const void *self, uint32_t block_id) {
    return mni_pool_has_place(&((const paged *)self)->pool, block_id);
}

static void no_room(void *self, const mni_wish *wish, uint32_t blocks) {
    mni_pool_no_room(&((paged *)self)->pool, wish, blocks);
}

static double fill(const void *self, uint32_t table_count, uint32_t in_use) {
    return mni_pool_fill(&((const paged *)self)->pool, table_count, in_use);
}

/* ---- foresight ------------------------------------------------------------------------------- */

static void look(void *self, const void *look) {
    mni_board_look(&((paged *)self)->board, look);
}

static void ahead(void *self, mn_block_ref ref, uint32_t parent_id, uint32_t frames) {
    mni_pool_ahead(&((paged *)self)->pool, ref, parent_id, frames);
}

static void note(void *self, uint32_t block_id, const mni_note *note) {
    mni_pool_note(&((paged *)self)->pool, block_id, note);
}

static void early(void *self, uint32_t frames) {
    mni_pool_early(&((paged *)self)->pool, frames);
}

static bool there_only(void *self, bool only) {
    return mni_pool_there_only(&((paged *)self)->pool, only);
}

static bool seek(void *self, uint32_t block_id) {
    return mni_pool_seek(&((paged *)self)->pool, block_id);
}

static bool has(void *self, uint32_t block_id) {
    return mni_pool_has(&((paged *)self)->pool, block_id);
}

/* ---- figures --------------------------------------------------------------------------------- */

static uint32_t pending(void *self) {
    paged *p = self;
    return mni_board_open_commands(&p->board) + mni_pool_waiting(&p->pool);
}

static uint64_t epoch(const void *self) {
    return ((const paged *)self)->pool.epoch;
}

static uint32_t resident(void *self, uint32_t in_use) {
    (void)in_use;
    return mni_pool_resident(&((paged *)self)->pool);
}

/* Memory that is registered with the kernel would stay: so the registration goes first. */
static bool shrink(void *self, uint32_t table_count) {
    paged *p = self;
    uint32_t chunk;
    if (!mni_pool_shrink(&p->pool, table_count, &chunk))
        return false;
    const mni_holders *holders = &p->pool.holders;
    size_t chunk_bytes = (size_t)holders->chunk_holders * holders->holder_bytes;
    size_t left = (size_t)holders->k * holders->holder_bytes - chunk * chunk_bytes;
    if (!compressed(p->desc.header))
        (void)p->disk.method->chunk(p->disk.self, chunk, false);
    (void)madvise(holders->bytes + chunk * chunk_bytes, left < chunk_bytes ? left : chunk_bytes,
                  MADV_DONTNEED);
    return true;
}

static bool grow(void *self) {
    paged *p = self;
    uint32_t chunk;
    if (!mni_pool_retired(&p->pool, &chunk))
        return false;
    if (!compressed(p->desc.header)) /* before anything is read into it */
        (void)p->disk.method->chunk(p->disk.self, chunk, true);
    mni_pool_grow(&p->pool, chunk);
    return true;
}

static uint64_t ended(const mni_board_counts *counts, mni_end end) {
    uint64_t sum = 0;
    for (int kind = 0; kind < MNI_COMMAND_LOOK; kind++)
        sum += counts->ended[kind][end];
    return sum;
}

static void stats(void *self, mn_session_stats *out) {
    paged *p = self;
    mn_session_stats pool;
    mni_board_counts counts;
    mni_pool_stats(&p->pool, &pool);
    mni_board_counts_get(&p->board, &counts);
    out->reads = pool.reads;
    out->read_bytes = pool.read_bytes;
    out->second_chances = pool.second_chances;
    out->prefetches_loaded = pool.prefetches_loaded;
    out->prefetches_used = pool.prefetches_used;
    out->evictions = pool.evictions;
    out->urgent_down_refused = pool.urgent_down_refused;
    out->checksum_failures = pool.checksum_failures;
    out->io_errors = pool.io_errors;
    out->io_lock_hold_ns_max = pool.io_lock_hold_ns_max;
    out->blocks_checked = counts.checked;
    out->io_cpu_ns = counts.cpu_ns;
    if (!p->disk.method->own_time) {
        out->io_busy_ns = counts.busy_ns;
        out->io_depth_ns = counts.depth_ns;
        out->io_full_ns = counts.full_ns;
        out->io_full_bytes = counts.full_bytes;
    }
    out->prefetches = counts.posted[MNI_COMMAND_PREFETCH];
    out->urgent_up = counts.posted[MNI_COMMAND_URGENT_UP];
    out->urgent_down = counts.posted[MNI_COMMAND_URGENT_DOWN];
    out->commands = out->prefetches + out->urgent_up + out->urgent_down;
    out->commands_loaded = ended(&counts, MNI_END_LOADED);
    out->commands_resident = ended(&counts, MNI_END_RESIDENT);
    out->commands_given_up = ended(&counts, MNI_END_GIVEN_UP);
    out->commands_failed = ended(&counts, MNI_END_FAILED);
    out->prefetches_given_up = counts.ended[MNI_COMMAND_PREFETCH][MNI_END_GIVEN_UP];
}

static void check(void *self, mni_usage_of usage_of, const void *context) {
    mni_pool_check(&((paged *)self)->pool, usage_of, context);
}

const mni_store_kind mni_store_paged = {
    .need_bytes = need_bytes,
    .entries_max = entries_max,
    .open = open_paged,
    .close = close_paged,
    .enter = enter,
    .leave = leave,
    .overflow = overflow,
    .left = left,
    .attempt_over = attempt_over,
    .refusal = refusal,
    .refuse = refuse,
    .room = room,
    .has_place = has_place,
    .no_room = no_room,
    .fill = fill,
    .comes = comes,
    .look = look,
    .ahead = ahead,
    .note = note,
    .early = early,
    .there_only = there_only,
    .seek = seek,
    .has = has,
    .frame_begin = frame_begin,
    .frame_end = frame_end,
    .post = post,
    .meanwhile = meanwhile,
    .drain = drain,
    .pending = pending,
    .epoch = epoch,
    .resident = resident,
    .shrink = shrink,
    .grow = grow,
    .stats = stats,
    .check = check,
};
