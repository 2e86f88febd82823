/* Goal: a trace says what the session's own figures say, whatever the store, the disk, the prefetch
 * and the number of place holders; and with a seed it is the same bytes. Method: small models flown
 * with and without faults; every event counted and compared. */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "metanode/trace.h"
#include "model.h"
#include "suite.h"

enum { FRAMES = 90 };

static const mn_block_desc small_blocks = {.blocking = MN_BLOCKING_PACKED, .block_bytes = 4096};

/* What a run came to, by the session's word. */
typedef struct figures {
    uint64_t splits, collapses, misses, refused_pool, opening_misses;
    mn_session_stats totals;
    mn_plan plan;
    uint32_t free_last;
} figures;

typedef struct traced {
    uint64_t kind[MN_TRACE_KINDS], splits, collapses, misses, evictions, reads, second_chances;
    uint64_t posted[MN_TRACE_COMMANDS], ended[MN_TRACE_COMMANDS][MN_TRACE_ENDS];
    uint64_t refused, frames, sums[MN_TRACE_COUNTERS], used, dropped;
    uint32_t in_use;
} traced;

static void fly(const mn_session_desc *desc, const model *m, figures *f) {
    mn_session *s = model_open(desc);
    mn_frame_stats frame;
    *f = (figures){0};
    mn_camera camera = model_camera(m, 0, 4);
    for (int i = 0; i < 3; i++) {
        (void)mn_session_opening(s, &camera, &frame);
        f->opening_misses += frame.misses;
    }
    for (int i = 0; i < FRAMES; i++) {
        camera = model_camera(m, i / 40.0, 1.2 + 2.5 * fabs(sin(i / 15.0)));
        mn_session_frame(s, &camera, &frame);
        f->splits += frame.splits;
        f->collapses += frame.collapses;
        f->misses += frame.misses;
        f->refused_pool += frame.refused_pool;
    }
    mn_session_settle(s, &camera, 1000);
    mn_session_drain(s);
    mn_session_check(s);
    mn_session_stats_get(s, &f->totals);
    mn_session_plan(s, &f->plan);
    mn_status st = {0};
    ck_assert_msg(mn_session_end(s, &st) == MN_OK, "%s", st.text);
}

static void take(traced *t, const mn_trace_event *e, mn_trace_round round) {
    const bool run = round == MN_TRACE_FRAME || round == MN_TRACE_ROUND;
    t->kind[e->kind]++;
    switch ((mn_trace_kind)e->kind) {
    case MN_TRACE_SPLIT:
        t->splits += run;
        break;
    case MN_TRACE_COLLAPSE:
        t->collapses += run;
        break;
    case MN_TRACE_MISS:
        t->misses += run;
        break;
    case MN_TRACE_COUNT:
        t->sums[e->aux] += run ? e->a : 0;
        if (e->aux == MN_TRACE_N_IN_USE)
            ck_assert_uint_eq(e->a, t->in_use);
        break;
    case MN_TRACE_USE:
        t->in_use++;
        break;
    case MN_TRACE_LEAVE:
        t->in_use--;
        break;
    case MN_TRACE_HOLDER:
        t->reads += (e->aux >> 3 & 7) == MN_TRACE_LOADING;
        t->second_chances +=
            (e->aux & (MN_TRACE_EARLY - 1)) == (MN_TRACE_FREED | MN_TRACE_LOADED << 3);
        break;
    case MN_TRACE_LOST:
        t->evictions += (e->aux & 7) == MN_TRACE_LOADED;
        break;
    case MN_TRACE_POST:
        t->posted[e->aux]++;
        break;
    case MN_TRACE_ENDED:
        t->ended[e->aux & 3][e->aux >> 2]++;
        break;
    case MN_TRACE_REFUSED:
        t->refused += e->aux;
        break;
    case MN_TRACE_PREFETCH_USED:
        t->used++;
        break;
    default:
        break;
    }
}

static void read_back(const char *path, traced *t) {
    mn_trace_file *file;
    mn_trace_event e;
    mn_status st = {0};
    mn_code code = mn_trace_open(path, false, &file, &st);
    mn_trace_round round = MN_TRACE_ROUNDS; /* outside of frames */
    ck_assert_msg(code == MN_OK, "%s", st.text);
    *t = (traced){0};
    while (mn_trace_next(file, &e, &code, &st)) {
        if (e.kind == MN_TRACE_FRAME_BEGIN)
            round = (mn_trace_round)e.aux;
        t->frames += e.kind == MN_TRACE_FRAME_BEGIN && e.aux == MN_TRACE_FRAME;
        take(t, &e, round);
    }
    ck_assert_msg(code == MN_OK, "%s", st.text);
    t->dropped = mn_trace_dropped(file, MN_TRACE_NAVIGATE) + mn_trace_dropped(file, MN_TRACE_IO);
    mn_trace_close(file);
}

static uint64_t ended(const traced *t, mn_trace_end end) {
    return t->ended[0][end] + t->ended[1][end] + t->ended[2][end];
}

static void compare(const traced *t, const figures *f) {
    const mn_session_stats *s = &f->totals;
    ck_assert_uint_eq(t->dropped, 0);
    ck_assert_uint_eq(t->frames, FRAMES);
    ck_assert_uint_eq(t->kind[MN_TRACE_FRAME_BEGIN], t->kind[MN_TRACE_FRAME_END]);
    ck_assert_uint_eq(t->splits, f->splits);
    ck_assert_uint_eq(t->collapses, f->collapses);
    ck_assert_uint_eq(t->misses, f->misses);
    ck_assert_uint_eq(t->sums[MN_TRACE_N_SPLITS], f->splits);
    ck_assert_uint_eq(t->sums[MN_TRACE_N_COLLAPSES], f->collapses);
    ck_assert_uint_eq(t->sums[MN_TRACE_N_MISSES], f->misses);
    ck_assert_uint_eq(t->sums[MN_TRACE_N_REFUSED_POOL], f->refused_pool);
    ck_assert_uint_eq(t->reads, s->reads);
    ck_assert_uint_eq(t->evictions, s->evictions);
    ck_assert_uint_eq(t->second_chances, s->second_chances);
    ck_assert_uint_eq(t->posted[MN_TRACE_PREFETCH], s->prefetches);
    ck_assert_uint_eq(t->posted[MN_TRACE_URGENT_UP], s->urgent_up);
    ck_assert_uint_eq(t->posted[MN_TRACE_URGENT_DOWN], s->urgent_down);
    ck_assert_uint_eq(t->refused, s->urgent_down_refused);
    ck_assert_uint_eq(ended(t, MN_TRACE_END_LOADED), s->commands_loaded);
    ck_assert_uint_eq(ended(t, MN_TRACE_END_RESIDENT), s->commands_resident);
    ck_assert_uint_eq(ended(t, MN_TRACE_END_GIVEN_UP), s->commands_given_up);
    ck_assert_uint_eq(ended(t, MN_TRACE_END_FAILED), s->commands_failed);
    ck_assert_uint_eq(t->ended[MN_TRACE_PREFETCH][MN_TRACE_END_LOADED], s->prefetches_loaded);
    ck_assert_uint_eq(t->used, s->prefetches_used);
    ck_assert_uint_eq(t->kind[MN_TRACE_GRANT], t->kind[MN_TRACE_GRANT_OVER]);
}

static void trace_path(char name[64]) {
    strcpy(name, "/tmp/mn-traced-XXXXXX");
    int fd = mkstemp(name);
    ck_assert_int_ge(fd, 0);
    close(fd);
}

static mn_session_desc paged(const model *m) {
    mn_session_desc desc = model_desc(m);
    desc.store = MN_STORE_PAGED;
    desc.fps = 60;
    return desc;
}

static int64_t k_min_times(const mn_session_desc *desc, int factor) {
    mn_session_desc least = *desc;
    mn_plan plan;
    least.k = MN_K_MIN;
    mn_session *s = model_open(&least);
    mn_session_plan(s, &plan);
    mn_session_close(s);
    return (int64_t)plan.k_min * factor;
}

static bool same_files(const char *a, const char *b) {
    FILE *one = fopen(a, "rb"), *other = fopen(b, "rb");
    int x, y;
    ck_assert(one != NULL && other != NULL);
    do {
        x = getc(one);
        y = getc(other);
    } while (x == y && x != EOF);
    fclose(one);
    fclose(other);
    return x == y;
}

/* The simulated disk, without faults and with, each prefetch, K from the least up, with and without
 * a barrier: the figures are the session's, and a second run is the same file. */
START_TEST(figures_and_bytes_are_the_runs) {
    char name[2][64];
    model m;
    model_make(&m, MODEL_GLOBE, 6000, &small_blocks);
    trace_path(name[0]);
    trace_path(name[1]);
    for (int factor = 1; factor <= 3; factor++)
        for (int faults = 0; faults < 2; faults++) {
            mn_session_desc desc = paged(&m);
            figures f;
            traced t;
            desc.io = MN_IO_SIM;
            desc.prefetch = (mn_prefetch)_i;
            desc.seed = (uint64_t)(7 + _i);
            desc.k = k_min_times(&desc, factor);
            desc.io_serial = factor == 2;
            desc.barrier = factor == 3 && faults == 0;
            if (faults)
                desc.sim = (mn_sim_desc){.reorder = 200,
                                         .short_read = 100,
                                         .eio = 20,
                                         .eagain = 100,
                                         .corrupt = 20,
                                         .fault_frames = 60};
            for (int run = 0; run < 2; run++) {
                desc.trace_path = name[run];
                fly(&desc, &m, &f);
            }
            ck_assert(same_files(name[0], name[1]));
            read_back(name[0], &t);
            compare(&t, &f);
            ck_assert_uint_gt(t.reads, 0);
        }
    unlink(name[0]);
    unlink(name[1]);
    model_free(&m);
}
END_TEST

/* Two threads and the clock. */
START_TEST(figures_are_the_runs_with_threads) {
    static const mn_io_kind ios[] = {MN_IO_URING, MN_IO_PREAD};
    char name[64];
    model m;
    model_make(&m, MODEL_TERRAIN, 6000, &small_blocks);
    trace_path(name);
    mn_session_desc desc = paged(&m);
    figures f;
    traced t;
    desc.io = ios[_i];
    desc.k = k_min_times(&desc, 2);
    desc.trace_path = name;
    fly(&desc, &m, &f);
    read_back(name, &t);
    compare(&t, &f);
    unlink(name);
    model_free(&m);
}
END_TEST

/* Without a pool there are moves and uses. */
START_TEST(other_stores) {
    char name[64];
    model m;
    model_make(&m, MODEL_GLOBE, 3000, &small_blocks);
    trace_path(name);
    mn_session_desc desc = model_desc(&m);
    figures f;
    traced t;
    desc.store = _i == 0 ? MN_STORE_RESIDENT : MN_STORE_MAPPED;
    desc.trace_path = name;
    fly(&desc, &m, &f);
    read_back(name, &t);
    ck_assert_uint_eq(t.splits, f.splits);
    ck_assert_uint_eq(t.collapses, f.collapses);
    ck_assert_uint_eq(t.misses, 0);
    ck_assert_uint_gt(t.kind[MN_TRACE_USE], 0);
    ck_assert_uint_eq(t.kind[MN_TRACE_HOLDER], 0);
    unlink(name);
    model_free(&m);
}
END_TEST

/* The plan counts the rings, and a trace changes nothing but the place holders that they cost: with
 * a K of its own the same fronts come. */
START_TEST(a_trace_changes_nothing) {
    char name[64];
    model m;
    mn_plan plan[2];
    figures f[2];
    model_make(&m, MODEL_GLOBE, 6000, &small_blocks);
    trace_path(name);
    mn_session_desc desc = paged(&m);
    desc.io = MN_IO_SIM;
    desc.k = k_min_times(&desc, 2);
    for (int run = 0; run < 2; run++) {
        desc.trace_path = run == 0 ? NULL : name;
        fly(&desc, &m, &f[run]);
        plan[run] = f[run].plan;
    }
    ck_assert_uint_ge(plan[1].base_bytes, plan[0].base_bytes + (40 << 10) * 16);
    ck_assert_uint_eq(f[0].splits, f[1].splits);
    ck_assert_uint_eq(f[0].collapses, f[1].collapses);
    ck_assert_uint_eq(f[0].misses, f[1].misses);
    ck_assert_uint_eq(f[0].totals.reads, f[1].totals.reads);
    ck_assert_uint_eq(f[0].totals.prefetches, f[1].totals.prefetches);
    unlink(name);
    model_free(&m);
}
END_TEST

/* Of many chains that need the same absent block one asks for it: from the roots there are more
 * misses than answers "absent", where each chain by itself has one at least. */
START_TEST(chains_share_what_they_lack) {
    char name[64];
    model m;
    model_make(&m, _i == 0 ? MODEL_GLOBE : MODEL_TERRAIN, 20000, &small_blocks);
    trace_path(name);
    mn_session_desc desc = paged(&m);
    traced t;
    mn_frame_stats frame;
    desc.io = MN_IO_SIM;
    desc.k = k_min_times(&desc, 4);
    desc.prefetch = MN_PREFETCH_OFF;
    desc.trace_path = name;
    mn_session *s = model_open(&desc);
    mn_camera camera = model_camera(&m, 0, 1.5);
    uint64_t misses = 0;
    for (int i = 0; i < 12; i++) {
        mn_session_frame(s, &camera, &frame);
        misses += frame.misses;
    }
    mn_session_check(s);
    mn_session_drain(s);
    mn_session_close(s);
    read_back(name, &t);
    ck_assert_uint_eq(t.misses, misses);
    ck_assert_uint_gt(misses, 0);
    ck_assert_uint_gt(t.kind[MN_TRACE_ABSENT], 0);
    ck_assert_uint_lt(t.kind[MN_TRACE_ABSENT], misses);
    unlink(name);
    model_free(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("traced");
    TCase *tc = tcase_create("traced");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, figures_and_bytes_are_the_runs, 0, 3);
    tcase_add_loop_test(tc, figures_are_the_runs_with_threads, 0, 2);
    tcase_add_loop_test(tc, other_stores, 0, 2);
    tcase_add_test(tc, a_trace_changes_nothing);
    tcase_add_loop_test(tc, chains_share_what_they_lack, 0, 2);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
