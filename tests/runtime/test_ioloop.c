/* Goal: whatever one read does, its command ends once, its place holder comes back, and the block
 * can be had later; an undisturbed run is the same afterwards.
 * What has been checked is not checked again while its bytes stay; while blocks are looked at the
 * disk reads on, as deep as it goes.
 * Method: pool, board and loop by hand on a scripted disk; the Nth completion is bent in each way,
 * for N = 1, 2, … until N is never reached; blocks read again and again, and changed in between. */
#include <check.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "ioloop.h"
#include "suite.h"
#include "walk.h"

/* ---- a disk that does as it is told ---------------------------------------------------------- */

typedef enum bend {
    BEND_EIO,
    BEND_EAGAIN,
    BEND_EINTR,
    BEND_SHORT_ODD,  /* not whole pages */
    BEND_SHORT_PAGE, /* one page */
    BEND_END,        /* the file ends */
    BEND_FLIP,       /* one bit */
    BEND_FULL,       /* submit finds no room */
    BENDS
} bend;

typedef struct scripted {
    int fd;
    bend how;
    uint32_t nth, count; /* completions, or submissions for BEND_FULL */
    mni_read waiting[MNI_DISK_DEPTH];
    uint32_t waits;
} scripted;

static bool scripted_submit(void *self, const mni_read *read) {
    scripted *s = self;
    if (s->how == BEND_FULL && ++s->count == s->nth)
        return false;
    ck_assert_uint_lt(s->waits, MNI_DISK_DEPTH);
    s->waiting[s->waits++] = *read;
    return true;
}

/* What a short read does not say it brought is not there. */
static int32_t cut(const mni_read *read, int32_t got, int32_t to) {
    memset((unsigned char *)read->bytes + to, 0xa5, (size_t)(got - to));
    return to;
}

static int32_t bent(scripted *s, const mni_read *read) {
    ck_assert_uint_eq(read->offset % MN_PAGE_BYTES, 0); /* as O_DIRECT needs it */
    ck_assert_uint_eq((uintptr_t)read->bytes % MN_PAGE_BYTES, 0);
    int32_t got = (int32_t)pread(s->fd, read->bytes, read->length_bytes, (off_t)read->offset);
    if (s->how == BEND_FULL || ++s->count != s->nth)
        return got;
    switch (s->how) {
    case BEND_EIO:
        return -EIO;
    case BEND_EAGAIN:
        return -EAGAIN;
    case BEND_EINTR:
        return -EINTR;
    case BEND_SHORT_ODD:
        return cut(read, got, got - 100);
    case BEND_SHORT_PAGE:
        return cut(read, got, got > MN_PAGE_BYTES ? MN_PAGE_BYTES : got);
    case BEND_END:
        return 0;
    case BEND_FLIP:
        ((unsigned char *)read->bytes)[got / 2] ^= 1;
        return got;
    case BEND_FULL:
    case BENDS:
        break;
    }
    return got;
}

static uint32_t scripted_collect(void *self, mni_done *out, uint32_t max, bool wait) {
    scripted *s = self;
    uint32_t count = 0;
    (void)wait;
    while (count < max && s->waits > 0) { /* last in, first out: never in order */
        const mni_read *read = &s->waiting[--s->waits];
        out[count].tag = read->tag;
        out[count++].result = bent(s, read);
    }
    return count;
}

static bool scripted_advance(void *self, uint64_t until_ns) {
    (void)until_ns;
    return ((scripted *)self)->waits > 0;
}

static const mni_method METHOD = {.depth = 4,
                                  .tags = 6,
                                  .own_time = true,
                                  .submit = scripted_submit,
                                  .collect = scripted_collect,
                                  .advance = scripted_advance};

/* ---- pool, board and loop -------------------------------------------------------------------- */

typedef struct machine {
    made_file file;
    mni_arena arena;
    mni_board board;
    mni_pool pool;
    mni_disk disk;
    mni_ioloop loop;
    scripted script;
} machine;

static uint32_t checks; /* so far */

static bool counted_check(const void *context, const void *bytes, uint32_t length_bytes) {
    checks++;
    return made_check(context, bytes, length_bytes);
}

/* k 0: a place holder a block. */
static void machine_open(machine *m, bend how, uint32_t nth, uint32_t k) {
    memset(m, 0, sizeof *m);
    made_desc made = {.seed = 3,
                      .blocks = 12,
                      .depth_max = 3,
                      .fanout_max = 6,
                      .pages_max = 4,
                      .blocking = MN_BLOCKING_LEVELS};
    made_file_make(&m->file, &made);
    mni_store_desc desc = {.header = &m->file.header,
                           .k = k > 0 ? k : m->file.blocks,
                           .prefetch = MN_PREFETCH_NEIGHBOURS};
    ck_assert_int_eq(mni_arena_open(&m->arena,
                                    mni_pool_need(&m->file.header, desc.k) +
                                        mni_board_need(desc.k, 64, 0) +
                                        mni_ioloop_need(&m->file.header, desc.k, 0),
                                    NULL),
                     MN_OK);
    mni_board_open(&m->board, desc.k, 64, 0, &m->arena);
    mni_pool_open(&m->pool, &desc, &m->board, &m->arena);
    m->script = (scripted){.fd = open(m->file.path, O_RDONLY), .how = how, .nth = nth};
    m->disk = (mni_disk){.fd = -1, .method = &METHOD, .self = &m->script};
    m->loop = (mni_ioloop){.pool = &m->pool,
                           .board = &m->board,
                           .disk = &m->disk,
                           .header = &m->file.header,
                           .check = counted_check};
    mni_ioloop_open(&m->loop, 0, &m->arena);
}

static void machine_close(machine *m) {
    mni_ioloop_stop(&m->loop);
    mni_pool_close(&m->pool);
    mni_board_close(&m->board);
    mni_arena_close(&m->arena);
    close(m->script.fd);
    made_file_free(&m->file);
}

static uint32_t no_usage(const void *context, uint32_t block_id) {
    (void)context, (void)block_id;
    return 0;
}

static bool root_is_there(machine *m) {
    return mni_pool_has(&m->pool, m->file.header.root[0].block.id);
}

/* Asks for the root until it is there, takes it into use for a frame (so that its children are
 * prefetched) and gives it back. Returns the frames that the root took. */
static uint32_t run(machine *m) {
    mni_report reports[MNI_REPORTS_MAX];
    uint32_t frames = 0;
    for (; !root_is_there(m); frames++) {
        ck_assert_uint_lt(frames, 10);
        mni_pool_begin_frame(&m->pool, reports);
        mni_pool_ask_root(&m->pool, m->file.header.root[0].block);
        mni_pool_end_frame(&m->pool);
        while (mni_ioloop_step(&m->loop, false)) {
        }
        mni_pool_check(&m->pool, no_usage, NULL);
    }
    mni_wish wish = {.way = MNI_WAY_DOWN, .ref = m->file.header.root[0].block, .adds = true};
    const void *bytes;
    mni_pool_begin_frame(&m->pool, reports);
    ck_assert_int_eq(mni_pool_enter(&m->pool, &wish, &bytes), MNI_GRANTED);
    mni_pool_end_frame(&m->pool);
    while (mni_ioloop_step(&m->loop, false)) {
    }
    ck_assert_uint_eq(mni_board_open_commands(&m->board), 0);
    mni_pool_leave(&m->pool, wish.ref.id, true);
    mni_pool_end_frame(&m->pool);
    mni_pool_check(&m->pool, no_usage, NULL);
    return frames;
}

static uint32_t children_of_root(const machine *m) {
    uint32_t count = 0;
    for (uint32_t b = 0; b < m->file.blocks; b++)
        count += m->file.block[b].parent == 0;
    return count;
}

START_TEST(one_read_goes_wrong) {
    bend how = (bend)_i;
    bool reached = true;
    for (uint32_t nth = 1; reached; nth++) {
        machine m;
        machine_open(&m, how, nth, 0);
        uint32_t children = children_of_root(&m);
        ck_assert_uint_ge(children, 2);
        uint32_t frames = run(&m);
        reached = m.script.count >= nth;
        bool fails = how == BEND_EIO || how == BEND_END || how == BEND_FLIP;
        mni_board_counts counts;
        mni_board_counts_get(&m.board, &counts);
        uint64_t failed = counts.ended[MNI_COMMAND_PREFETCH][MNI_END_FAILED] +
                          counts.ended[MNI_COMMAND_URGENT_DOWN][MNI_END_FAILED];
        ck_assert_uint_eq(failed, fails && reached);
        mn_session_stats stats = {0};
        mni_pool_stats(&m.pool, &stats);
        ck_assert_uint_eq(stats.io_errors, how != BEND_FLIP ? failed : 0);
        ck_assert_uint_eq(stats.checksum_failures, how == BEND_FLIP ? failed : 0);
        ck_assert_uint_eq(frames, fails && nth == 1 ? 2 : 1);
        ck_assert_uint_eq(counts.ended[MNI_COMMAND_PREFETCH][MNI_END_LOADED],
                          children - (failed && nth > 1));
        ck_assert_uint_lt(nth, 50);
        machine_close(&m);
    }
}
END_TEST

/* EAGAIN without end: the read fails in the end instead of spinning. */
static uint32_t collect_eagain(void *self, mni_done *out, uint32_t max, bool wait) {
    uint32_t count = scripted_collect(self, out, max, wait);
    for (uint32_t i = 0; i < count; i++)
        out[i].result = -EAGAIN;
    return count;
}

START_TEST(endless_eagain_fails) {
    mni_method method = METHOD;
    machine m;
    machine_open(&m, BEND_EIO, 0, 0);
    method.collect = collect_eagain;
    m.disk.method = &method;
    mni_report reports[MNI_REPORTS_MAX];
    mni_pool_begin_frame(&m.pool, reports);
    mni_pool_ask_root(&m.pool, m.file.header.root[0].block);
    mni_pool_end_frame(&m.pool);
    while (mni_ioloop_step(&m.loop, false)) {
    }
    ck_assert(!root_is_there(&m));
    ck_assert_uint_eq(mni_pool_begin_frame(&m.pool, reports), 1);
    ck_assert_uint_eq(reports[0].block_id, 1);
    machine_close(&m);
}
END_TEST

/* Has each block read, one after the other; returns how many came. */
static uint64_t read_all(machine *m) {
    mni_board_counts before, after;
    mni_command command[1 + 64]; /* and room for those of the ring */
    mni_board_counts_get(&m->board, &before);
    for (uint32_t b = 0; b < m->file.blocks; b++) {
        const made_block *block = &m->file.block[b];
        const uint32_t parent = block->parent == MN_NONE ? 0 : m->file.block[block->parent].ref.id;
        mni_batch batch = {.command = command, .count = 1};
        command[0] = (mni_command){.ref = block->ref, .parent_id = parent, .sponsor = MN_NONE};
        ck_assert_uint_eq(mni_board_post(&m->board, &batch), 0);
        while (mni_ioloop_step(&m->loop, false)) {
        }
    }
    mni_board_counts_get(&m->board, &after);
    ck_assert_uint_eq(after.checked, checks);
    return after.ended[MNI_COMMAND_PREFETCH][MNI_END_LOADED] -
           before.ended[MNI_COMMAND_PREFETCH][MNI_END_LOADED];
}

/* Turns over the last bit of a block's bytes, and seals it again: only its contents are wrong. */
static void make_lie(const machine *m, uint32_t block) {
    const made_block *b = &m->file.block[block];
    unsigned char bytes[4 * MN_PAGE_BYTES];
    const size_t length = (size_t)b->ref.pages * MN_PAGE_BYTES;
    const off_t at = (off_t)b->ref.id * MN_PAGE_BYTES;
    mni_frame frame;
    int fd = open(m->file.path, O_RDWR);
    ck_assert_int_eq(pread(fd, bytes, length, at), (ssize_t)length);
    mni_frame_get(bytes, &frame);
    bytes[length - 1] ^= 1;
    mni_frame_seal(bytes, &frame, b->ref, m->file.header.build_id);
    ck_assert_int_eq(pwrite(fd, bytes, length, at), (ssize_t)length);
    close(fd);
}

START_TEST(seen_blocks_are_checked_once) {
    enum { K = 5 };
    machine m;
    mn_session_stats stats = {0};
    machine_open(&m, BEND_EIO, 0, K);
    const uint32_t blocks = m.file.blocks;
    ck_assert_uint_gt(blocks, 2 * K); /* so each has gone when it is its turn again */
    checks = 0;
    ck_assert_uint_eq(read_all(&m), blocks);
    ck_assert_uint_eq(checks, blocks);
    for (int lap = 0; lap < 3; lap++)
        ck_assert_uint_eq(read_all(&m), blocks);
    ck_assert_uint_lt(checks, 3 * blocks); /* few share an entry with another */
    make_lie(&m, blocks - 1);
    made_file_damage(&m.file, blocks - 2);
    ck_assert_uint_eq(read_all(&m), blocks - 2);
    mni_pool_stats(&m.pool, &stats);
    ck_assert_uint_eq(stats.checksum_failures, 2);
    machine_close(&m);
}
END_TEST

/* How many reads are in flight while each block is looked at. */
typedef struct watch {
    const machine *m;
    uint32_t looked_at, in_flight[64];
} watch;

static bool watched_check(const void *context, const void *bytes, uint32_t length_bytes) {
    watch *const *at = context;
    watch *w = *at;
    const mni_ioloop *loop = &w->m->loop;
    ck_assert_uint_eq(loop->reading, w->m->script.waits);
    ck_assert_uint_le(loop->reading, METHOD.depth);
    ck_assert_uint_lt(loop->reading, loop->busy); /* the one looked at */
    ck_assert_uint_le(loop->busy, METHOD.tags);
    w->in_flight[w->looked_at++] = loop->reading;
    return made_check(NULL, bytes, length_bytes);
}

START_TEST(disk_reads_on_meanwhile) {
    machine m;
    watch w = {.m = &m};
    watch *const at = &w;
    mni_command command[64 + 64]; /* and room for those of the ring */
    mni_batch batch = {.command = command};
    machine_open(&m, BEND_EIO, 0, 0);
    m.loop.check = watched_check;
    m.loop.check_context = &at;
    m.loop.serial = _i == 1;
    for (uint32_t b = 0; b < m.file.blocks; b++) {
        const made_block *block = &m.file.block[b];
        const uint32_t parent = block->parent == MN_NONE ? 0 : m.file.block[block->parent].ref.id;
        command[batch.count++] =
            (mni_command){.ref = block->ref, .parent_id = parent, .sponsor = MN_NONE};
    }
    ck_assert_uint_eq(mni_board_post(&m.board, &batch), 0);
    while (mni_ioloop_step(&m.loop, false)) {
    }
    ck_assert_uint_eq(w.looked_at, m.file.blocks);
    for (uint32_t i = 0; i < METHOD.depth; i++) /* those that the disk is given at first */
        ck_assert_uint_eq(w.in_flight[i], _i == 1 ? 0 : METHOD.tags - METHOD.depth);
    ck_assert_uint_eq(w.in_flight[w.looked_at - 1], 0);
    machine_close(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("ioloop");
    TCase *tests = tcase_create("ioloop");
    tcase_add_loop_test(tests, one_read_goes_wrong, 0, BENDS);
    tcase_add_test(tests, endless_eagain_fails);
    tcase_add_test(tests, seen_blocks_are_checked_once);
    tcase_add_loop_test(tests, disk_reads_on_meanwhile, 0, 2);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
