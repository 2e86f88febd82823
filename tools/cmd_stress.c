/* metanode stress: navigates with as little memory as works, as wildly as can be, on disks that
 * fail, and checks everything after every frame.
 *
 * A run is made of its seed alone: how many place holders, which disk with which faults, which
 * rules, where the camera goes. So the seed of a run that fails is all that is needed to see it
 * fail again (a real disk answers in its own time: with one, perhaps not at the same frame).
 *
 * Each run has a process of its own, so that one that breaks an invariant, which aborts it, or
 * never comes back, is a finding like any other and not the end:
 *
 *     parent ── fork ──► run of seed s ── verdict ──► pipe ──► sums, or "again: …"
 *
 * Hides: how a seed becomes a run. Thin over mn_session_…. One thread, and the sessions' own.
 * Memory: a session's. Paper: §3.3, at K near its minimum; design.md §6. */
#include <errno.h>
#include <limits.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "cli.h"
#include "json.h"
#include "metanode/runtime.h"
#include "stress_motion.h"

enum {
    SETTLE_FRAMES_MAX = 4000,
    RETRY_FRAMES = 70,     /* a block that failed is asked for again within 64 */
    ALL_BLOCKS_MAX = 4096, /* of a file that is sometimes given a place holder for each */
    FAULT_PER_MILLE_MAX = 250,
    RUN_SECONDS_MAX = 600, /* then it hangs */
    LOOK_MS = 50,          /* for an interrupt, and for the time */
};

static const char help[] =
    "usage: metanode stress FILE [OPTION …]\n"
    "Navigates FILE with tiny memory, wild cameras and failing disks, and checks every invariant\n"
    "after every frame. Ends with exit 1 and the command that repeats it when something is wrong.\n"
    "  --seconds S     go on for so long (10); the run at hand is then cut\n"
    "  --runs N        this many runs instead\n"
    "  --frames N      frames of a run (150)\n"
    "  --seed S        of the first run; each further one has the next (1)\n"
    "  -K N            place holders; min: as few as work; default: from there up, by lot\n"
    "  --io M          mix (default), sim: a simulated disk with faults, uring, pread\n"
    "  --json          figures as one JSON object\n";

/* What the user asked for. */
typedef struct options {
    const char *path;
    uint64_t seconds, runs, frames, seed, k;
    bool k_min, json;
    int io; /* 0: mix; otherwise an mn_io_kind and 1 */
} options;

/* What a run has to say: through the pipe, as it is. */
typedef struct verdict {
    char wrong[640]; /* empty: nothing */
    mn_code code;    /* of an open that was refused */
    uint32_t k, k_min, blocks, settle_frames;
    mn_io_kind io;
    bool faults, serial, all_blocks, uring_refused;
    bool cut; /* by an interrupt, or as the time is up: it says nothing, and does not count */
    uint64_t shrunk, grown;
    mn_session_stats totals;
} verdict;

/* Everything in which two runs of one seed must agree. */
typedef struct record {
    uint64_t fronts, triangles, misses, reads;
} record;

typedef struct run {
    const options *asked;
    const mn_header *header;
    motion motion;
    mn_session_desc desc;
    mn_session *session;
    bool resizes; /* place holders come and go */
    bool warned;  /* of a ring that was refused */
    uint64_t dice;
    record record;
    verdict v;
} run;

#define WRONG(r, ...)                                                                              \
    do {                                                                                           \
        if ((r)->v.wrong[0] == 0)                                                                  \
            snprintf((r)->v.wrong, sizeof(r)->v.wrong, __VA_ARGS__);                               \
    } while (0)

/* ---- what a seed says ------------------------------------------------------------------------ */

static uint32_t pick(run *r, uint32_t below) {
    return motion_dice(&r->dice) % below;
}

static float between(run *r, double low, double high) { /* evenly in the logarithm */
    return (float)(low * pow(high / low, pick(r, 1001) / 1000.0));
}

static void choose_disk(run *r) {
    mn_session_desc *d = &r->desc;
    static const mn_io_kind mix[] = {MN_IO_SIM, MN_IO_SIM, MN_IO_SIM, MN_IO_URING, MN_IO_PREAD};
    d->io = mix[pick(r, 5)];
    r->v.uring_refused = d->io == MN_IO_URING && r->dice % 3 == 0;
    if (r->asked->io > 0) {
        d->io = (mn_io_kind)(r->asked->io - 1);
        r->v.uring_refused = false;
    }
    d->io_serial = pick(r, 4) == 0;
    d->seed = r->dice;
    d->sim.delay_us_max = 1 + pick(r, 30000);
    uint32_t *fault[] = {&d->sim.reorder, &d->sim.short_read, &d->sim.eio,
                         &d->sim.eagain,  &d->sim.corrupt,    &d->sim.misplaced};
    for (int i = 0; i < 6; i++)
        if (pick(r, 2) == 0)
            *fault[i] = pick(r, FAULT_PER_MILLE_MAX);
    d->sim.fault_frames = (uint32_t)r->asked->frames;
    for (int i = 0; i < 6; i++)
        r->v.faults |= d->io == MN_IO_SIM && *fault[i] > 0;
}

static void choose_rules(run *r) {
    mn_session_desc *d = &r->desc;
    d->prefetch = (mn_prefetch)pick(r, 3);
    d->degrade_off = pick(r, 2) == 0;
    d->tolerance_px = between(r, 0.3, 30);
    d->nav_ops = pick(r, 3) == 0 ? 1 + pick(r, 2000) : 0;
    d->fps = pick(r, 2) == 0 ? 60 : 1000;
    if (!d->degrade_off && pick(r, 4) == 0)
        d->triangles_max = 100 + pick(r, 20000);
    if (pick(r, 3) == 0)
        d->weights = (mn_weights){.outside = between(r, 1, 64),
                                  .away = between(r, 1, 64),
                                  .silhouette = between(r, 1, 8),
                                  .light = between(r, 1, 4)};
    d->front_max = 2000 + pick(r, 60000);
    d->width_px = 64 + pick(r, 1900);
    d->height_px = 64 + pick(r, 1000);
}

/* The minimum is the plan's to say. */
static bool choose_k(run *r, mn_status *st) {
    mn_session_desc least = r->desc;
    mn_plan plan;
    least.k = MN_K_MIN;
    least.io = MN_IO_PREAD;
    r->v.code = mn_session_open(&least, &r->session, st);
    if (r->v.code != MN_OK)
        return false;
    mn_session_plan(r->session, &plan);
    mn_session_close(r->session);
    r->session = NULL;
    r->v.k_min = plan.k_min;
    r->v.all_blocks = pick(r, 6) == 0 && r->header->blocks <= ALL_BLOCKS_MAX;
    const uint32_t more[] = {0, 0, 1, 2, 3 + pick(r, 6), plan.k_min, pick(r, 1000)};
    uint32_t k = plan.k_min + more[pick(r, 7)];
    if (r->v.all_blocks && r->header->blocks > k)
        k = r->header->blocks;
    if (r->asked->k_min || r->asked->k > 0) {
        k = r->asked->k_min ? plan.k_min : (uint32_t)r->asked->k;
        r->v.all_blocks = k >= r->header->blocks;
    }
    r->desc.k = r->v.k = k;
    r->resizes = pick(r, 2) == 0;
    return true;
}

/* ---- a run ----------------------------------------------------------------------------------- */

static uint64_t fold(uint64_t sum, uint64_t x) {
    sum ^= x;
    return motion_dice(&sum);
}

static void take_frame(run *r) {
    mn_camera camera;
    mn_frame_stats s;
    motion_step step = motion_next(&r->motion, &camera);
    mn_session_set_tolerance(r->session, step == MOTION_TO_ROOTS ? INFINITY
                                         : step == MOTION_CLOSER ? r->desc.tolerance_px / 8
                                                                 : r->desc.tolerance_px);
    if (r->resizes && pick(r, 8) == 0) {
        r->v.shrunk += mn_session_shrink(r->session);
    } else if (r->resizes && pick(r, 8) == 0) {
        r->v.grown += mn_session_grow(r->session);
    }
    mn_session_frame(r->session, &camera, &s);
    mn_session_check(r->session);
    record *sum = &r->record;
    sum->fronts = fold(sum->fronts, s.front_hash);
    sum->triangles = fold(sum->triangles, s.triangles);
    sum->misses = fold(sum->misses, s.misses);
    sum->reads = fold(sum->reads, s.reads);
}

static void check_sums(run *r) {
    mn_session_drain(r->session);
    mn_session_stats_get(r->session, &r->v.totals);
    const mn_session_stats *s = &r->v.totals;
    if (s->commands !=
        s->commands_loaded + s->commands_resident + s->commands_given_up + s->commands_failed)
        WRONG(r, "%llu commands do not end in as many ways", (unsigned long long)s->commands);
    if (cli_alloc_since_mark() > 0)
        WRONG(r, "%llu allocations after the start", (unsigned long long)cli_alloc_since_mark());
}

/* The front at which everything comes to rest, without a disk. */
static uint64_t calm_front(run *r, const mn_camera *camera) {
    mn_session_desc desc = r->desc;
    mn_session *calm;
    mn_frame_stats s;
    mn_status st = {0};
    desc.store = MN_STORE_RESIDENT;
    if (mn_session_open(&desc, &calm, &st) != MN_OK) {
        WRONG(r, "resident: %s", st.text);
        return 0;
    }
    mn_session_settle(calm, camera, SETTLE_FRAMES_MAX);
    mn_session_frame(calm, camera, &s);
    mn_session_close(calm);
    return s.front_hash;
}

/* The faults are over: the camera stands until all is quiet, and then everything goes back. */
static void come_to_rest(run *r) {
    const mn_camera *camera = &r->motion.camera;
    mn_frame_stats s;
    mn_session_set_tolerance(r->session, r->desc.tolerance_px);
    while (r->resizes && mn_session_grow(r->session))
        continue;
    for (int i = 0; i < RETRY_FRAMES; i++)
        mn_session_frame(r->session, camera, &s);
    r->v.settle_frames = mn_session_settle(r->session, camera, SETTLE_FRAMES_MAX);
    if (r->v.settle_frames >= SETTLE_FRAMES_MAX)
        WRONG(r, "does not settle in %d frames", SETTLE_FRAMES_MAX);
    mn_session_frame(r->session, camera, &s);
    mn_session_check(r->session);
    const bool free = r->desc.degrade_off && r->desc.nav_ops == 0 && r->v.all_blocks;
    const uint64_t settled = s.front_hash, refused = s.refused_front + s.refused_pool;
    mn_session_set_tolerance(r->session, INFINITY);
    if (mn_session_settle(r->session, camera, SETTLE_FRAMES_MAX) >= SETTLE_FRAMES_MAX)
        WRONG(r, "does not settle on its way back");
    if (!mn_session_at_roots(r->session))
        WRONG(r, "does not get back to the roots");
    mn_session_check(r->session);
    check_sums(r);
    if (free && refused == 0 && calm_front(r, camera) != settled)
        WRONG(r, "its settled front is another than without a disk");
}

/* false: the session could not be opened. */
/* As where a container's rules or an old kernel do: for what is left of this process. */
static bool refuse_uring(void) {
    struct sock_filter rule[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_io_uring_setup, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    const struct sock_fprog all = {sizeof rule / sizeof *rule, rule};
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
           prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &all) == 0;
}

static void hear_warning(void *context, const char *text) {
    run *r = context;
    r->warned |= strstr(text, "io_uring is refused") != NULL;
}

static bool run_once(run *r, mn_status *st) {
    r->desc.warn = hear_warning;
    r->desc.warn_context = r;
    if (r->v.uring_refused && !refuse_uring())
        r->v.uring_refused = false; /* this kernel has no filters: an ordinary run */
    r->v.code = mn_session_open(&r->desc, &r->session, st);
    if (r->v.code != MN_OK)
        return false;
    if (r->v.uring_refused && !r->warned)
        WRONG(r, "io_uring was refused, and nothing said so");
    cli_alloc_mark();
    for (uint64_t frame = 0; frame < r->asked->frames; frame++)
        take_frame(r);
    come_to_rest(r);
    mn_session_close(r->session);
    return true;
}

/* A root block that failed eight times in a row on a disk of faults is told, not survived. */
static bool opens_not(run *r, const mn_status *st) {
    if (r->v.faults && r->v.code == MN_BAD_INPUT)
        r->v.code = MN_OK;
    else
        WRONG(r, "%s", st->text);
    return false;
}

static void run_seed(const options *asked, const mn_header *header, uint64_t seed, verdict *out) {
    run first = {.asked = asked, .header = header, .dice = seed};
    mn_status st = {0};
    first.desc.path = asked->path;
    motion_begin(&first.motion, header, seed);
    choose_disk(&first);
    choose_rules(&first);
    if (!choose_k(&first, &st)) {
        *out = first.v;
        snprintf(out->wrong, sizeof out->wrong, "%s", st.text);
        return;
    }
    first.v.io = first.desc.io;
    first.v.serial = first.desc.io_serial;
    first.v.blocks = header->blocks;
    run again = first;
    const bool twice = first.desc.io == MN_IO_SIM && first.desc.io_serial;
    bool opened = run_once(&first, &st) || opens_not(&first, &st);
    if (opened && twice &&
        (!run_once(&again, &st) || strcmp(first.v.wrong, again.v.wrong) != 0 ||
         memcmp(&first.record, &again.record, sizeof first.record) != 0))
        WRONG(&first, "two runs of one seed are not the same");
    *out = first.v;
}

/* ---- processes ------------------------------------------------------------------------------- */

static void child(const options *asked, const mn_header *header, uint64_t seed, int to) {
    static verdict v;
    const struct rlimit none = {0, 0};
    setrlimit(RLIMIT_CORE, &none);
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* who hears it is killed by a second interrupt */
    alarm(RUN_SECONDS_MAX);
    run_seed(asked, header, seed, &v);
    _exit(write(to, &v, sizeof v) == (ssize_t)sizeof v ? 0 : 1);
}

/* Until the child has spoken, or has gone; or we are interrupted, or it is end_s by the clock. */
static bool hear(int from, double end_s, verdict *v) {
    struct pollfd ready = {.fd = from, .events = POLLIN};
    ssize_t got;
    while (poll(&ready, 1, LOOK_MS) <= 0)
        if ((v->cut = cli_interrupted() != 0 || cli_seconds(CLOCK_MONOTONIC) >= end_s))
            return false;
    while ((got = read(from, v, sizeof *v)) < 0 && errno == EINTR)
        continue;
    return got == (ssize_t)sizeof *v;
}

/* What the child says, or how it ended. false: there could be none. */
static bool run_apart(const options *asked, const mn_header *header, uint64_t seed, double end_s,
                      verdict *v, mn_status *st) {
    int ends[2], status = 0;
    memset(v, 0, sizeof *v);
    fflush(NULL);
    if (pipe(ends) != 0)
        return mn_fail(st, MN_FAILED, "stress: no pipe: %s", strerror(errno)) == MN_OK;
    pid_t pid = fork();
    if (pid == 0) {
        close(ends[0]);
        child(asked, header, seed, ends[1]);
    }
    close(ends[1]);
    bool told = pid > 0 && hear(ends[0], end_s, v);
    close(ends[0]);
    v->cut |= pid > 0 && !told && cli_interrupted() != 0; /* the child has heard it as well */
    if (v->cut)
        kill(pid, SIGKILL);
    if (pid < 0)
        return mn_fail(st, MN_FAILED, "stress: no process: %s", strerror(errno)) == MN_OK;
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        continue;
    if (!v->cut && (!told || status != 0)) {
        const int by = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
        snprintf(v->wrong, sizeof v->wrong,
                 by == SIGALRM   ? "it hangs"
                 : by == SIGABRT ? "an invariant is broken (see above)"
                                 : "it was ended by signal %d",
                 by);
    }
    return true;
}

/* ---- the command ----------------------------------------------------------------------------- */

typedef struct sums {
    uint64_t runs, frames, sim, faulty, uring, uring_refused, pread, twice, all_blocks, shrunk,
        grown;
    uint64_t adapt, misses, refused, reads, damaged, io_errors, evictions;
    uint64_t damaged_file; /* of damaged, those of runs whose disk was sound */
    uint32_t k_least, k_most, k_min, settle_most;
    bool cut; /* the last run */
    double seconds;
} sums;

static void add(sums *s, const verdict *v, uint64_t frames) {
    const mn_session_stats *t = &v->totals;
    s->k_least = s->runs == 0 || v->k < s->k_least ? v->k : s->k_least;
    s->k_most = v->k > s->k_most ? v->k : s->k_most;
    s->k_min = v->k_min;
    s->settle_most = v->settle_frames > s->settle_most ? v->settle_frames : s->settle_most;
    s->runs++;
    s->frames += frames;
    s->sim += v->io == MN_IO_SIM;
    s->faulty += v->faults;
    s->uring += v->io == MN_IO_URING;
    s->uring_refused += v->uring_refused;
    s->pread += v->io == MN_IO_PREAD;
    s->twice += v->io == MN_IO_SIM && v->serial;
    s->all_blocks += v->all_blocks;
    s->shrunk += v->shrunk;
    s->grown += v->grown;
    s->adapt += t->adapt;
    s->misses += t->misses;
    s->refused += t->refused_front + t->refused_budget + t->refused_pool;
    s->reads += t->reads;
    s->evictions += t->evictions;
    s->damaged += t->checksum_failures;
    s->damaged_file += v->faults ? 0 : t->checksum_failures;
    s->io_errors += t->io_errors;
}

static void print_words(const options *o, const sums *s) {
    if (s->runs == 0) {
        if (cli_interrupted() != 0)
            printf("%s: interrupted before the first run was over\n", o->path);
        else
            printf("%s: the first run was not over in %llu second%s: more --seconds, or fewer "
                   "--frames\n",
                   o->path, (unsigned long long)o->seconds, cli_s(o->seconds));
        return;
    }
    char last_seed[32] = "", most[32] = "";
    if (s->runs > 1)
        snprintf(last_seed, sizeof last_seed, " … %llu",
                 (unsigned long long)(o->seed + s->runs - 1));
    if (s->k_most > s->k_least)
        snprintf(most, sizeof most, " to %u", s->k_most);
    printf("%s: %llu run%s, %llu frame%s, seed%s %llu%s, %.1f s\n", o->path,
           (unsigned long long)s->runs, cli_s(s->runs), (unsigned long long)s->frames,
           cli_s(s->frames), cli_s(s->runs), (unsigned long long)o->seed, last_seed, s->seconds);
    printf("  memory     %u%s place holder%s (%u is the least); %llu chunk%s taken away, %llu "
           "given back\n",
           s->k_least, most, cli_s(s->k_most), s->k_min, (unsigned long long)s->shrunk,
           cli_s(s->shrunk), (unsigned long long)s->grown);
    printf("  disks      %llu simulated (%llu with faults), %llu io_uring (%llu refused), "
           "%llu pread\n",
           (unsigned long long)s->sim, (unsigned long long)s->faulty, (unsigned long long)s->uring,
           (unsigned long long)s->uring_refused, (unsigned long long)s->pread);
    printf("  work       %llu splits and collapses, %llu misses, %llu refusals, %llu reads, %llu "
           "evictions\n",
           (unsigned long long)s->adapt, (unsigned long long)s->misses,
           (unsigned long long)s->refused, (unsigned long long)s->reads,
           (unsigned long long)s->evictions);
    printf("  trouble    %llu damaged block%s, %llu read%s failed\n",
           (unsigned long long)s->damaged, cli_s(s->damaged), (unsigned long long)s->io_errors,
           cli_s(s->io_errors));
    printf("  held       every invariant after every frame; all settled (%u frame%s at most), came "
           "back to the\n             roots, lost no command and allocated nothing; %llu ran twice "
           "alike\n",
           s->settle_most, cli_s(s->settle_most), (unsigned long long)s->twice);
    if (s->cut)
        printf("  cut        the run of seed %llu, which does not count\n",
               (unsigned long long)(o->seed + s->runs));
}

static void print_json(const options *o, const sums *s, const char *wrong, uint64_t seed) {
    json j;
    json_begin(&j, stdout);
    json_u64(&j, "seed", o->seed);
    json_u64(&j, "runs", s->runs);
    json_u64(&j, "frames", s->frames);
    json_f64(&j, "seconds", s->seconds);
    json_u64(&j, "k_min", s->k_min);
    json_u64(&j, "k_least", s->k_least);
    json_u64(&j, "k_most", s->k_most);
    json_u64(&j, "chunks_taken", s->shrunk);
    json_u64(&j, "chunks_given", s->grown);
    json_u64(&j, "runs_simulated", s->sim);
    json_u64(&j, "runs_with_faults", s->faulty);
    json_u64(&j, "runs_uring", s->uring);
    json_u64(&j, "runs_uring_refused", s->uring_refused);
    json_u64(&j, "runs_pread", s->pread);
    json_u64(&j, "runs_twice", s->twice);
    json_u64(&j, "runs_all_blocks", s->all_blocks);
    json_u64(&j, "adapt", s->adapt);
    json_u64(&j, "misses", s->misses);
    json_u64(&j, "refusals", s->refused);
    json_u64(&j, "reads", s->reads);
    json_u64(&j, "evictions", s->evictions);
    json_u64(&j, "checksum_failures", s->damaged);
    json_u64(&j, "checksum_failures_without_faults", s->damaged_file);
    json_u64(&j, "io_errors", s->io_errors);
    json_u64(&j, "settle_frames_max", s->settle_most);
    json_bool(&j, "last_run_cut", s->cut);
    json_bool(&j, "held", wrong == NULL);
    if (wrong != NULL) {
        json_str(&j, "failure", wrong);
        json_u64(&j, "failure_seed", seed);
    }
    json_end(&j);
}

static int tell_wrong(const options *o, uint64_t seed, const char *wrong) {
    static const char *const ios[] = {"uring", "pread", "sim"}; /* by mn_io_kind */
    char k[32] = "", io[32] = "", path[4 * PATH_MAX + 3];
    if (o->k_min)
        snprintf(k, sizeof k, " -K min");
    else if (o->k > 0)
        snprintf(k, sizeof k, " -K %llu", (unsigned long long)o->k);
    if (o->io > 0)
        snprintf(io, sizeof io, " --io %s", ios[o->io - 1]);
    const int code = cli_error(MN_FAILED, "stress: seed %llu: %s", (unsigned long long)seed, wrong);
    fprintf(stderr, "  again: metanode stress %s --seed %llu --runs 1 --frames %llu%s%s\n",
            cli_shell_word(o->path, path, sizeof path), (unsigned long long)seed,
            (unsigned long long)o->frames, k, io);
    return code;
}

static int go(const options *o) {
    mn_header *header = malloc(sizeof *header);
    mn_status st = {0};
    sums s = {0};
    verdict v = {0};
    cli_meter meter = {0};
    if (header == NULL)
        return cli_error(MN_FAILED, "stress: no memory");
    if (mn_header_read(o->path, header, &st) != MN_OK) {
        free(header);
        return cli_status(&st);
    }
    const double begun_s = cli_seconds(CLOCK_MONOTONIC);
    const double end_s = o->runs > 0 ? INFINITY : begun_s + (double)o->seconds;
    uint64_t seed = o->seed;
    bool more = true, good = true;
    for (; more && good && v.wrong[0] == 0; seed++) {
        good = run_apart(o, header, seed, end_s, &v, &st);
        s.cut = v.cut;
        if (good && v.wrong[0] == 0 && !v.cut)
            add(&s, &v, o->frames);
        s.seconds = cli_seconds(CLOCK_MONOTONIC) - begun_s;
        more = o->runs > 0 ? s.runs < o->runs : s.seconds < (double)o->seconds;
        const uint64_t done = o->runs > 0 ? s.runs : (uint64_t)s.seconds;
        more = cli_progress(&meter, "stress", done, o->runs > 0 ? o->runs : o->seconds) && more;
    }
    cli_progress_end(&meter);
    const char *wrong = v.wrong[0] != 0 ? v.wrong : NULL;
    if (good && o->json)
        print_json(o, &s, wrong, seed - 1);
    else if (good && wrong == NULL)
        print_words(o, &s);
    free(header);
    if (wrong != NULL)
        return v.code != MN_OK ? cli_error(v.code, "%s", wrong) : tell_wrong(o, seed - 1, wrong);
    if (good && s.damaged_file > 0)
        return cli_error(MN_BAD_INPUT,
                         "%s: damaged: %llu blocks failed their check in runs whose disk has no "
                         "faults; metanode verify names them",
                         o->path, (unsigned long long)s.damaged_file);
    return cli_status(&st);
}

int cmd_stress(int argc, char **argv) {
    static const char *const ios[] = {"mix", "uring", "pread", "sim", NULL};
    options o = {.seconds = 10, .frames = 150, .seed = 1};
    const char *k = NULL;
    bool done = false;
    const cli_flag flags[] = {
        CLI_WHOLE("seconds", &o.seconds, 1, 1000000, "in 1 … 1000000 seconds"),
        CLI_WHOLE("runs", &o.runs, 1, UINT32_MAX, "in 1 … 4294967295 runs"),
        CLI_WHOLE("frames", &o.frames, 1, 1000000, "in 1 … 1000000 frames"),
        CLI_WHOLE("seed", &o.seed, 0, UINT64_MAX / 2, "a number from 0"),
        {.name = "holders", .letter = 'K', .kind = CLI_IS_TEXT, .to = &k},
        CLI_CHOICE("io", &o.io, ios, "mix, sim, uring or pread"),
        CLI_SWITCH("json", &o.json),
        {0}};
    mn_code code = cli_flags(argc, argv, flags, help, &done);
    if (code != MN_OK || done)
        return code;
    o.k_min = k != NULL && strcmp(k, "min") == 0;
    if (k != NULL && !o.k_min && !cli_u64(k, 1, UINT32_MAX, &o.k))
        return cli_error(MN_USAGE, "stress: -K '%s' is not a number of place holders, or min", k);
    if (argc - optind != 1)
        return cli_error(MN_USAGE, "stress: one FILE, please; see metanode stress --help");
    o.path = argv[optind];
    cli_interrupts_catch();
    return go(&o);
}
