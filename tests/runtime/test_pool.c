/* Goal: the rules of the pool and the three repairs, each by itself.
 * Method: made files in which one knows every block; few place holders; the simulated disk without
 * faults, serial, so that a frame's commands are done when it ends. */
#include <check.h>
#include <stdlib.h>
#include <string.h>

#include "holder.h"
#include "suite.h"
#include "walk.h"

static made_file file;
static mni_arena arena;
static mni_store *store;
static mni_entry root;

/* What happened to place holders, from the trace: the disk is simulated, so all of it stands in the
 * rings until half of one is full. */
static struct {
    mni_trace *trace;
    uint64_t seen[MN_TRACE_THREADS];
    uint32_t slot_block[512]; /* a slot: its block, once loading */
    uint8_t loading[4096];    /* a block id: reads under way */
    uint32_t loads;
} traced;

static void take_event(const mni_trace_event *e) {
    const uint32_t kind = e->what & 0xff, from = e->what >> 8 & 7, to = e->what >> 11 & 7;
    if (kind != MN_TRACE_HOLDER)
        return;
    if (to == MN_TRACE_LOADING) {
        traced.slot_block[e->b] = e->a;
        ck_assert_uint_eq(traced.loading[e->a]++, 0); /* never two reads for one block */
        traced.loads++;
    } else if (from == MN_TRACE_LOADING && to != MN_TRACE_EMPTY) {
        ck_assert_uint_eq(traced.loading[e->a]--, 1);
    }
    ck_assert(to == MN_TRACE_EMPTY || e->a == traced.slot_block[e->b]);
}

/* The next event of a thread, or NULL. */
static const mni_trace_event *next_of(mn_trace_thread thread) {
    const mni_trace_ring *ring = mni_trace_ring_of(traced.trace, thread);
    ck_assert_uint_eq(atomic_load(&ring->tail), 0);
    return traced.seen[thread] < atomic_load(&ring->head) ? &ring->event[traced.seen[thread]]
                                                          : NULL;
}

static uint32_t loads(void) {
    for (;;) {
        const mni_trace_event *n = next_of(MN_TRACE_NAVIGATE), *io = next_of(MN_TRACE_IO);
        if (n == NULL && io == NULL)
            return traced.loads;
        const bool first = io == NULL || (n != NULL && n->what >> 16 < io->what >> 16);
        traced.seen[first ? MN_TRACE_NAVIGATE : MN_TRACE_IO]++;
        take_event(first ? n : io);
    }
}

static void open_made(const made_desc *made, uint32_t k) {
    memset(&traced, 0, sizeof traced);
    const mn_trace_info info = {.clock = MN_TRACE_VIRTUAL};
    ck_assert_int_eq(mni_trace_open("/dev/null", &info, &traced.trace, NULL), MN_OK);
    (void)mni_trace_swap(mni_trace_ring_of(traced.trace, MN_TRACE_NAVIGATE));
    made_file_make(&file, made);
    mni_store_desc desc = {.path = file.path,
                           .header = &file.header,
                           .kind = MN_STORE_PAGED,
                           .k = k > 0 ? k : mni_store_k_min(&file.header),
                           .io = MN_IO_SIM,
                           .io_serial = true,
                           .prefetch = MN_PREFETCH_NEIGHBOURS,
                           .check = made_check,
                           .trace_io = mni_trace_ring_of(traced.trace, MN_TRACE_IO)};
    ck_assert_int_eq(
        mni_arena_open(&arena, mni_store_need_bytes(&file.header, desc.kind, desc.k), NULL), MN_OK);
    ck_assert_int_eq(mni_store_open(&desc, &arena, &store, NULL), MN_OK);
    root = mni_store_root(store, 0);
}

/* Root block 0 with children 1 … fanout, each with fanout children, and so on. */
static void open_store(mn_blocking blocking, uint32_t fanout, uint32_t blocks, uint32_t k) {
    open_made(&(made_desc){.seed = 1,
                           .blocks = blocks,
                           .depth_max = 4,
                           .fanout_max = fanout,
                           .pages_max = 1,
                           .blocking = blocking,
                           .regular = true},
              k);
}

static void close_store(void) {
    mni_store_close(store);
    (void)loads();
    (void)mni_trace_swap(NULL);
    ck_assert_int_eq(mni_trace_close(traced.trace, NULL), MN_OK);
    mni_arena_close(&arena);
    made_file_free(&file);
}

static void next_frame(void) {
    mni_store_frame_end(store, 0.01);
    mni_store_check_all(store, NULL, NULL);
    (void)loads();
    mni_store_frame_begin(store);
}

static mn_block_ref child_of(uint32_t block, uint32_t index) {
    for (uint32_t b = 0; b < file.blocks; b++)
        if (file.block[b].parent == block && index-- == 0)
            return file.block[b].ref;
    ck_abort_msg("block %u has no such child", block);
    return (mn_block_ref){0};
}

static uint32_t block_of(mn_block_ref ref) {
    for (uint32_t b = 0; b < file.blocks; b++)
        if (file.block[b].ref.id == ref.id)
            return b;
    return MN_NONE;
}

static mn_session_stats stats(void) {
    mn_session_stats s = {0};
    mni_store_stats(store, &s);
    return s;
}

/* Takes a block into use, over as many frames as its fetching takes. */
static mni_entry take(mni_entry parent, mn_block_ref ref) {
    mni_entry entry;
    mni_answer answer = mni_store_down(store, parent, ref, &entry);
    for (int frame = 0; answer == MNI_ABSENT && frame < 5; frame++) {
        next_frame();
        answer = mni_store_down(store, parent, ref, &entry);
    }
    ck_assert_int_eq(answer, MNI_GRANTED);
    return entry;
}

/* The same on the way up, which is never refused. */
static void take_up(mni_entry entry) {
    mni_answer answer = mni_store_up(store, entry);
    for (int frame = 0; answer == MNI_ABSENT && frame < 5; frame++) {
        next_frame();
        answer = mni_store_up(store, entry);
    }
    ck_assert_int_eq(answer, MNI_GRANTED);
}

/* A block in use has its parent and children fetched; unused, a second chance costs no read. */
START_TEST(prefetch_and_second_chance) {
    open_store(MN_BLOCKING_LEVELS, 3, 40, 30);
    next_frame();
    ck_assert_uint_eq(loads(), 4); /* root and its three */
    mni_entry child = take(root, child_of(0, 0));
    next_frame();
    ck_assert_uint_eq(loads(), 7);
    mni_store_sub(store, child);
    next_frame(); /* its children go to the free list, it stays: the root refers to it */
    ck_assert_uint_eq(mni_store_in_use(store), 1);
    ck_assert_uint_eq(mni_store_in_memory(store), 4);
    child = take(root, child_of(0, 0));
    next_frame();
    ck_assert_uint_eq(mni_store_in_memory(store), 7);
    ck_assert_uint_eq(loads(), 7);
    ck_assert_uint_eq(stats().second_chances, 3);
    mni_store_sub(store, child);
    close_store();
}
END_TEST

/* The free list is first in, first out: what was freed first is reused first. */
START_TEST(first_freed_goes_first) {
    open_store(MN_BLOCKING_LEVELS, 3, 40, 10);
    next_frame();
    mni_entry a = take(root, child_of(0, 0)), b;
    next_frame(); /* 4 + 3 of 10 */
    mni_store_sub(store, a);
    b = take(root, child_of(0, 1)); /* 3 more fill the rest */
    next_frame();
    mni_store_sub(store, b);
    next_frame(); /* free, in this order: children of a, children of b */
    ck_assert_uint_eq(loads(), 10);
    mni_entry c = take(root, child_of(0, 2)); /* its three take the places of a's */
    next_frame();
    ck_assert_uint_eq(loads(), 13);
    mni_store_sub(store, c);
    b = take(root, child_of(0, 1)); /* b's are still there */
    next_frame();
    ck_assert_uint_eq(loads(), 13);
    mni_store_sub(store, b);
    close_store();
}
END_TEST

/* Repair (a): with K = 5, ordinary switches to blocks that are all there would fill every place
 * with blocks in use. The last is refused, until another goes; and the way up is open. */
START_TEST(levels_leave_a_place) {
    open_store(MN_BLOCKING_LEVELS, 2, 15, 5);
    next_frame();
    mni_entry c = take(root, child_of(0, 0)), d[2], other;
    next_frame();
    ck_assert_uint_eq(loads(), 5); /* root, its two children, two of a child's */
    for (uint32_t i = 0; i < 2; i++)
        d[i] = take(c, child_of(block_of(child_of(0, 0)), i));
    mni_answer answer = mni_store_down(store, root, child_of(0, 1), &other);
    ck_assert_int_eq(answer, MNI_REFUSED);
    next_frame();
    ck_assert_int_eq(mni_store_down(store, root, child_of(0, 1), &other), MNI_REFUSED);
    mni_store_sub(store, c); /* an ancestor only, but a place the more */
    other = take(root, child_of(0, 1));
    mni_store_sub(store, root);
    next_frame();
    ck_assert_uint_eq(mni_store_in_use(store), 3);
    for (uint32_t i = 0; i < 2; i++) { /* both ways up */
        answer = MNI_ABSENT;
        for (int frame = 0; frame < 5 && answer == MNI_ABSENT; frame++, next_frame())
            answer = mni_store_up(store, i == 0 ? c : root);
        ck_assert_int_eq(answer, MNI_GRANTED);
        mni_store_sub(store, d[i]);
    }
    close_store();
}
END_TEST

/* The paper's rule for levels, and repair (a) net of grants: with K = 5, two blocks in use and one
 * granted, a second urgent prefetch would leave less than three; and of the blocks that are there
 * one may come into use, not two. */
START_TEST(levels_count_grants) {
    open_store(MN_BLOCKING_LEVELS, 4, 85, 5);
    next_frame(); /* all four others hold children of the root, only prefetched */
    mn_block_ref upper = child_of(0, 0);
    mni_entry c = take(root, upper), d;
    next_frame();
    ck_assert_int_eq(mni_store_down(store, c, child_of(block_of(upper), 0), &d), MNI_ABSENT);
    mni_store_attempt_over(store);
    ck_assert_int_eq(mni_store_down(store, c, child_of(block_of(upper), 1), &d), MNI_REFUSED);
    mni_store_attempt_over(store);
    next_frame(); /* the first has thrown out one of the root's children */
    ck_assert_uint_eq(stats().evictions, 1);
    ck_assert_uint_eq(stats().urgent_down, 2); /* and the root */
    uint32_t granted = 0;
    for (uint32_t i = 1; i < 4; i++) {
        granted += mni_store_down(store, root, child_of(0, i), &d) == MNI_GRANTED;
        mni_store_attempt_over(store);
    }
    ck_assert_uint_eq(granted, 1);
    close_store();
}
END_TEST

/* Repair (b): packed grants while the blocks in use and their ancestors fit, and no further. */
START_TEST(packed_counts_ancestors) {
    open_store(MN_BLOCKING_PACKED, 3, 40, 0);
    uint32_t k = mni_store_k_min(&file.header);
    next_frame();
    mni_entry entry[64] = {root};
    uint32_t block[64] = {0}, count = 1;
    bool refused = false;
    for (uint32_t i = 0; i < count && count < 60 && !refused; i++)
        for (uint32_t c = 0; c < 3 && !refused && file.block[block[i]].depth < 4; c++) {
            mn_block_ref ref = child_of(block[i], c);
            mni_answer answer = MNI_ABSENT;
            for (int frame = 0; frame < 5 && answer == MNI_ABSENT; frame++, next_frame())
                answer = mni_store_down(store, entry[i], ref, &entry[count]);
            refused = answer == MNI_REFUSED;
            block[count] = block_of(ref);
            count += answer == MNI_GRANTED;
        }
    ck_assert(refused);
    ck_assert_uint_eq(count, k);    /* |A| = K: all are in use here */
    mni_store_sub(store, entry[1]); /* not in use, an ancestor still: |A| is the same */
    next_frame();
    mni_answer other = MNI_ABSENT;
    for (int frame = 0; frame < 5 && other == MNI_ABSENT; frame++, next_frame())
        other = mni_store_down(store, entry[2], child_of(block[2], 0), &entry[count]);
    ck_assert_int_eq(other, MNI_REFUSED);
    uint64_t epoch = mni_store_epoch(store);
    mni_store_sub(store, entry[--count]);
    next_frame();
    ck_assert_uint_gt(mni_store_epoch(store), epoch);
    close_store();
}
END_TEST

/* Whoever comes to a block that was refused is refused as if he had asked for it: what he has taken
 * on his way there is in what he needs, or it would do to begin again when that has gone. */
START_TEST(refused_as_before) {
    open_store(MN_BLOCKING_PACKED, 3, 40, 0);
    const uint32_t k = mni_store_k_min(&file.header);
    next_frame();
    mni_entry entry[64] = {root};
    uint32_t block[64] = {0}, count = 1;
    mni_refusal known = {0}, needs;
    for (uint32_t i = 0; i < count && known.block_id == 0; i++)
        for (uint32_t c = 0; c < 3 && known.block_id == 0 && file.block[block[i]].depth < 4; c++) {
            mn_block_ref ref = child_of(block[i], c);
            mni_answer answer = MNI_ABSENT;
            for (int frame = 0; frame < 5 && answer == MNI_ABSENT; frame++, next_frame())
                answer = mni_store_down(store, entry[i], ref, &entry[count]);
            if (answer == MNI_REFUSED)
                known = mni_store_refusal(store, true);
            block[count] = block_of(ref);
            count += answer == MNI_GRANTED;
        }
    ck_assert_uint_eq(count, k);
    ck_assert_int_eq(known.need, 1);
    ck_assert(!mni_store_allows(store, &known, false));
    const uint32_t last = count - 1, above = file.block[block[last]].parent;
    uint32_t at = 0;
    while (block[at] != above)
        at++;
    mni_store_sub(store, entry[last]); /* makes room for one */
    ck_assert(mni_store_allows(store, &known, false));
    mn_block_ref again = {.id = 0};
    for (uint32_t c = 0; c < 3; c++)
        if (block_of(child_of(above, c)) == block[last])
            again = child_of(above, c);
    ck_assert_int_eq(mni_store_down(store, entry[at], again, &entry[last]), MNI_GRANTED);
    ck_assert(!mni_store_allows(store, &known, false));
    mni_store_refuse(store, &known);
    needs = mni_store_refusal(store, false);
    ck_assert_uint_eq(needs.block_id, known.block_id);
    ck_assert_int_eq(needs.need, 2);
    ck_assert_int_eq(mni_store_refusal(store, true).need, 1);
    mni_store_sub(store, entry[last]);
    ck_assert(!mni_store_allows(store, &needs, false));
    close_store();
}
END_TEST

/* Repair (c), and attempts: the block that a waiting chain has given back is not thrown out by the
 * one that it waits for, wherever the search for a victim stands. */
START_TEST(a_chain_keeps_its_blocks) {
    open_store(MN_BLOCKING_LEVELS, 4, 85, 5);
    next_frame(); /* all four others hold children of the root, only prefetched */
    mn_block_ref upper = child_of(0, (uint32_t)_i);
    mn_block_ref lower = child_of(block_of(upper), 1);
    mni_entry c, d;
    ck_assert_int_eq(mni_store_down(store, root, upper, &c), MNI_GRANTED);
    ck_assert_int_eq(mni_store_down(store, c, lower, &d), MNI_ABSENT);
    mni_store_sub(store, c);
    ck_assert_uint_gt(mni_store_pending(store), 0);
    next_frame();
    ck_assert_int_eq(mni_store_down(store, root, upper, &c), MNI_GRANTED);
    ck_assert_int_eq(mni_store_down(store, c, lower, &d), MNI_GRANTED);
    mni_store_sub(store, d);
    mni_store_sub(store, c);
    next_frame();
    next_frame();
    ck_assert_uint_eq(mni_store_pending(store), 0);
    close_store();
}
END_TEST

/* A grant that nobody asks for again is dropped: its block can be thrown out. */
START_TEST(what_is_not_asked_for_is_dropped) {
    open_store(MN_BLOCKING_LEVELS, 4, 85, 5);
    next_frame();
    mn_block_ref upper = child_of(0, 0);
    mni_entry c = take(root, upper), d;
    next_frame();
    for (uint32_t i = 0; i < 4; i++) { /* each in turn, never again */
        ck_assert_int_ne(mni_store_down(store, c, child_of(block_of(upper), i), &d), MNI_REFUSED);
        next_frame();
        next_frame();
    }
    mn_session_stats s = stats();
    ck_assert_uint_ge(s.evictions, 2);
    ck_assert_uint_eq(s.commands, s.commands_loaded + s.commands_resident + s.commands_given_up);
    mni_store_sub(store, c);
    close_store();
}
END_TEST

/* A reference to nowhere, or to a block that names another parent, is absent, and nothing is read.
 */
START_TEST(lying_references_are_absent) {
    open_store(MN_BLOCKING_LEVELS, 3, 40, 20);
    next_frame();
    mni_entry c = take(root, child_of(0, 0)), d;
    next_frame();
    uint32_t before = loads();
    mn_block_ref nowhere = {.id = 100000, .pages = 1}, long_one = child_of(0, 1);
    long_one.pages = 2;
    ck_assert_int_eq(mni_store_down(store, c, nowhere, &d), MNI_ABSENT);
    ck_assert_int_eq(mni_store_down(store, root, long_one, &d), MNI_ABSENT);
    ck_assert_int_eq(mni_store_down(store, c, child_of(0, 1), &d), MNI_ABSENT);
    ck_assert_int_eq(mni_store_down(store, c, file.block[0].ref, &d), MNI_ABSENT);
    next_frame();
    ck_assert_uint_eq(loads(), before);
    mn_block_ref cousin =
        child_of(block_of(child_of(0, 1)), 0); /* read, and seen to be another's */
    ck_assert_int_eq(mni_store_down(store, c, cousin, &d), MNI_ABSENT);
    next_frame();
    ck_assert_uint_eq(loads(), before + 1);
    ck_assert_uint_eq(stats().checksum_failures, 1);
    mni_store_sub(store, c);
    close_store();
}
END_TEST

/* The ancestor table holds 4 × (K + depth) entries and not one more: a switch down that would
 * overflow it is refused and changes nothing, every way up goes on, and what goes makes room. Roots
 * whose blocks are chains: few blocks in use, and many ancestors. */
START_TEST(a_full_ancestor_table_refuses) {
    enum { ROOTS = 20, DEPTH = 12, K = ROOTS + 4, ENTRIES = 4 * (K + DEPTH) };
    open_made(&(made_desc){.seed = 1,
                           .blocks = ROOTS * DEPTH,
                           .depth_max = DEPTH,
                           .fanout_max = 1,
                           .pages_max = 1,
                           .roots = ROOTS,
                           .blocking = MN_BLOCKING_LEVELS,
                           .regular = true},
              K);
    ck_assert_uint_eq(mni_store_entries_max(&file.header, MN_STORE_PAGED, K), ENTRIES);
    mni_entry chain[ROOTS][DEPTH];
    uint32_t block[ROOTS], depth[ROOTS], entries = ROOTS, full_at = MN_NONE, block_at_3 = 0;
    for (uint32_t r = 0; r < ROOTS; r++) {
        chain[r][0] = r > 0 ? mni_store_root(store, r) : root;
        block[r] = r;
        depth[r] = 1;
    }
    next_frame();
    for (uint32_t r = 0; r < ROOTS && full_at == MN_NONE; r++)
        while (depth[r] < DEPTH && full_at == MN_NONE) {
            mn_block_ref below = child_of(block[r], 0);
            mni_entry top = chain[r][depth[r] - 1];
            if (entries < ENTRIES) {
                chain[r][depth[r]++] = take(top, below);
                mni_store_sub(store, top);
                block[r] = block_of(below);
                if (r == 0 && depth[r] == 4)
                    block_at_3 = block[r];
                entries++;
                continue;
            }
            full_at = r;
            mni_entry none;
            next_frame(); /* and its prefetch is there: it is the table that refuses */
            uint32_t before = loads();
            ck_assert_int_eq(mni_store_down(store, top, below, &none), MNI_REFUSED);
            ck_assert_uint_eq(none, MNI_NO_ENTRY);
            ck_assert_uint_eq(mni_store_usage(store, top), 1);
            next_frame();
            ck_assert_uint_eq(loads(), before);
        }
    ck_assert(full_at != MN_NONE && full_at > 0);
    take_up(chain[0][3]); /* what has an entry already takes none */
    ck_assert_uint_eq(take(chain[0][3], child_of(block_at_3, 0)), chain[0][4]);
    mni_store_sub(store, chain[0][4]);
    mni_store_sub(store, chain[0][3]);
    for (uint32_t r = 0; r < ROOTS; r++)
        for (; depth[r] > 1 && r != full_at; depth[r]--) {
            take_up(chain[r][depth[r] - 2]);
            mni_store_sub(store, chain[r][depth[r] - 1]);
        }
    next_frame();
    mni_entry top = chain[full_at][depth[full_at] - 1];
    mni_store_sub(store, take(top, child_of(block[full_at], 0))); /* there is room again */
    close_store();
}
END_TEST

/* Chunks retire and return; the walk goes on. */
START_TEST(chunks_retire_and_return) {
    made_desc made = {.seed = 4, .blocks = 1500, .depth_max = 6, .fanout_max = 5, .pages_max = 1};
    made_file_make(&file, &made);
    walker w;
    mni_store_desc desc = {
        .kind = MN_STORE_PAGED, .io = (mn_io_kind)_i, .k = 1300, .io_serial = true};
    ck_assert(walker_open(&w, &file, desc)); /* three chunks: 512, 512, 276 */
    ck_assert(!mni_store_grow(w.store));
    for (uint64_t camera = 1; camera < 8; camera++)
        walker_settle(&w, camera * 31, 50);
    walker_settle(&w, 0, 100);
    uint32_t shrunk = 0, grown = 0;
    for (; mni_store_shrink(w.store); shrunk++)
        walker_check(&w);
    ck_assert_uint_ge(shrunk, 1);
    ck_assert_uint_le(shrunk, 2);
    for (uint64_t camera = 8; camera < 16; camera++)
        walker_settle(&w, camera * 31, 50);
    for (; mni_store_grow(w.store); grown++)
        walker_check(&w);
    ck_assert_uint_eq(shrunk, grown);
    for (uint64_t camera = 16; camera < 24; camera++)
        walker_settle(&w, camera * 31, 50);
    ck_assert_uint_lt(walker_settle(&w, 0, 100), 100);
    ck_assert(walker_at_roots(&w));
    walker_close(&w);
    made_file_free(&file);
}
END_TEST

/* 1,365 blocks, each with four below it, and so many places. */
static void walker_on_many(walker *w, mn_blocking blocking, uint32_t k) {
    const made_desc made = {.seed = 5,
                            .blocks = 1365,
                            .depth_max = 6,
                            .fanout_max = 4,
                            .pages_max = 1,
                            .regular = true,
                            .blocking = blocking};
    const mni_store_desc desc = {
        .kind = MN_STORE_PAGED, .io = MN_IO_SIM, .k = k, .io_serial = true};
    made_file_make(&file, &made);
    ck_assert(walker_open(w, &file, desc));
}

/* How full it is, is of the places in service: the same root takes a larger share of fewer. */
START_TEST(fewer_places_fill_sooner) {
    walker w;
    walker_on_many(&w, (mn_blocking)_i, 1300);
    ck_assert_uint_gt(file.header.blocks, 1300);
    walker_settle(&w, 0, 100);
    const double fill = mni_store_fill(w.store);
    ck_assert(fill > 0 && fill < 0.01);
    ck_assert(mni_store_shrink(w.store));
    ck_assert_double_gt(mni_store_fill(w.store), 1.2 * fill);
    ck_assert(mni_store_grow(w.store));
    ck_assert_double_eq(mni_store_fill(w.store), fill);
    walker_close(&w);
    made_file_free(&file);
}
END_TEST

/* As many places as blocks: there is room for whatever was refused while there were fewer. (A chain
 * that had needed more than the places that were left stood refused.) */
START_TEST(a_place_for_each_is_room_for_all) {
    walker w;
    walker_on_many(&w, (mn_blocking)_i, 1400);
    ck_assert_uint_lt(file.header.blocks, 1400);
    walker_settle(&w, 31, 100);
    ck_assert_int_gt(mni_store_room(w.store), 1400);
    walker_settle(&w, 0, 100);
    ck_assert(mni_store_shrink(w.store));
    ck_assert_int_lt(mni_store_room(w.store), 1400);
    ck_assert(mni_store_grow(w.store));
    ck_assert_int_gt(mni_store_room(w.store), 1400);
    walker_close(&w);
    made_file_free(&file);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("pool");
    TCase *tests = tcase_create("pool");
    tcase_set_timeout(tests, 60);
    tcase_add_test(tests, prefetch_and_second_chance);
    tcase_add_test(tests, first_freed_goes_first);
    tcase_add_test(tests, levels_leave_a_place);
    tcase_add_test(tests, levels_count_grants);
    tcase_add_test(tests, packed_counts_ancestors);
    tcase_add_test(tests, refused_as_before);
    tcase_add_loop_test(tests, a_chain_keeps_its_blocks, 0, 4);
    tcase_add_test(tests, what_is_not_asked_for_is_dropped);
    tcase_add_test(tests, lying_references_are_absent);
    tcase_add_test(tests, a_full_ancestor_table_refuses);
    tcase_add_loop_test(tests, chunks_retire_and_return, MN_IO_URING, MN_IO_SIM + 1);
    tcase_add_loop_test(tests, fewer_places_fill_sooner, MN_BLOCKING_PACKED,
                        MN_BLOCKING_LEVELS + 1);
    tcase_add_loop_test(tests, a_place_for_each_is_room_for_all, MN_BLOCKING_PACKED,
                        MN_BLOCKING_LEVELS + 1);
    suite_add_tcase(suite, tests);
    return suite_run(suite);
}
