/* metanode bench adapt: how fast one core moves a front through a tree that is all in memory.
 *
 * A session of the store `resident`, without a budget and without degrading, flies the path twice:
 * fast, in so few frames that each changes much of the front, lap after lap until a second of the
 * processor's time is spent; and slowly, where next to nothing changes. Timed is the thread's
 * processor time in mn_session_frame: evaluation, dependency tests, forced splits, blocks decoded,
 * corners linked; no drawing, no statistics. From the two, by a line through both, what a node of
 * the front costs a frame, and what a split or a collapse costs besides.
 *
 * Memory: the session's, and the cameras of a path. Main thread only. */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bench.h"
#include "cli.h"
#include "json.h"
#include "metanode/format.h"
#include "metanode/runtime.h"
#include "session_options.h"

enum {
    LAPS_MIN = 3,
    LAPS_MAX = 1000,
    SLOW_FRAMES = 600,
    FRONT_MAX = 1 << 22, /* active nodes: room is not what is measured */
    PROBES = 8,          /* frames of the path that --front is a mean over */
    PROBE_STEPS = 8,     /* bisections of the tolerance */
    FRAMES_MAX = 1000000,
};
static const double lap_seconds = 1; /* of the fast flight, at least */
static const char *const path_names[] = {"orbit", "dive", "flyover"};

static const char help[] =
    "usage: metanode bench adapt FILE.mnt … [--path P] [--frames 24] [--slow-frames 600]\n"
    "                            [--tolerance 1.0 | --front N] [--json]\n\n"
    "Triangles made and removed a second by one core, everything resident, drawing excluded.\n\n"
    "  --path P         one path only; default: orbit, dive and flyover\n"
    "  --frames N       of a fast lap (24: an orbit in steps of 15 degrees)\n"
    "  --slow-frames N  of the slow lap\n"
    "  --tolerance PX   error on the screen that is let pass\n"
    "  --front N        the tolerance at which the front has N nodes on average instead\n"
    "  --json           figures as one object\n";

typedef struct options {
    const char *path;
    uint64_t frames, slow_frames, front;
    float tolerance_px;
    bool json;
} options;

/* Sums over the frames of a flight. */
typedef struct flight {
    double seconds;
    uint64_t laps, frames, moves, made, removed, nodes, waits;
} flight;

typedef struct figures {
    const char *path;
    float tolerance_px;
    flight fast, slow;
} figures;

/* ---- flights --------------------------------------------------------------------------------- */

static void lap(mn_session *session, const mn_camera *cameras, uint32_t frames, flight *f) {
    mn_session_stats before, after;
    mn_session_stats_get(session, &before);
    double start_s = cli_seconds(CLOCK_THREAD_CPUTIME_ID);
    for (uint32_t frame = 0; frame < frames; frame++)
        mn_session_frame(session, &cameras[frame], NULL);
    f->seconds += cli_seconds(CLOCK_THREAD_CPUTIME_ID) - start_s;
    mn_session_stats_get(session, &after);
    f->laps++;
    f->frames += after.frames - before.frames;
    f->moves += after.adapt - before.adapt;
    f->made += after.triangles_made - before.triangles_made;
    f->removed += after.triangles_removed - before.triangles_removed;
    f->nodes += after.active_nodes - before.active_nodes;
    f->waits += after.waits_dependency - before.waits_dependency;
}

static uint64_t nodes_at(mn_session *session, const mn_camera *cameras, double tolerance_px) {
    flight probe = {0};
    mn_session_set_tolerance(session, (float)tolerance_px);
    lap(session, cameras, PROBES, &probe);
    return probe.nodes;
}

/* The tolerance at which the front has as many nodes on average, for models of unlike size. */
static float tolerance_for(mn_session *session, const mn_path *path, uint64_t nodes) {
    mn_camera cameras[PROBES];
    for (uint32_t i = 0; i < PROBES; i++)
        mn_path_camera(path, i, PROBES, &cameras[i]);
    /* From coarse to fine, so that the front is never much larger. */
    double low = 1e4, high = low;
    while (low > 1e-3 && nodes_at(session, cameras, low) <= nodes * PROBES) {
        high = low;
        low /= 2;
    }
    for (int step = 0; step < PROBE_STEPS; step++) {
        double mid = sqrt(low * high);
        *(nodes_at(session, cameras, mid) > nodes * PROBES ? &low : &high) = mid;
    }
    return (float)high;
}

static void fly(mn_session *session, const mn_path *path, const options *o, mn_camera *cameras,
                figures *f) {
    flight warm = {0};
    f->tolerance_px = o->front > 0 ? tolerance_for(session, path, o->front) : o->tolerance_px;
    mn_session_set_tolerance(session, f->tolerance_px);
    for (uint32_t i = 0; i < o->frames; i++)
        mn_path_camera(path, i, (uint32_t)o->frames, &cameras[i]);
    lap(session, cameras, (uint32_t)o->frames, &warm);
    while (f->fast.laps < LAPS_MIN || (f->fast.seconds < lap_seconds && f->fast.laps < LAPS_MAX))
        lap(session, cameras, (uint32_t)o->frames, &f->fast);
    for (uint32_t i = 0; i < o->slow_frames; i++)
        mn_path_camera(path, i, (uint32_t)o->slow_frames, &cameras[i]);
    mn_session_frame(session, &cameras[0], NULL);
    lap(session, cameras, (uint32_t)o->slow_frames, &f->slow);
}

/* ---- report ---------------------------------------------------------------------------------- */

static double ratio(double a, double b) {
    return b > 0 ? a / b : 0;
}

static double triangles_per_second(const flight *f) {
    return ratio((double)(f->made + f->removed), f->seconds);
}

/* seconds = nodes × a + moves × b in both flights, in nanoseconds; NaN where they are too alike. */
static void line(const figures *f, double *node_ns, double *move_ns) {
    double n1 = (double)f->fast.nodes, m1 = (double)f->fast.moves, t1 = 1e9 * f->fast.seconds;
    double n2 = (double)f->slow.nodes, m2 = (double)f->slow.moves, t2 = 1e9 * f->slow.seconds;
    double det = n1 * m2 - n2 * m1;
    bool unlike = fabs(det) > 0.1 * n2 * m1;
    *node_ns = unlike ? (t1 * m2 - t2 * m1) / det : NAN;
    *move_ns = unlike ? (n1 * t2 - n2 * t1) / det : NAN;
}

static void print_row(const figures *f) {
    const flight *fast = &f->fast, *slow = &f->slow;
    double node_ns, move_ns, frames = (double)fast->frames;
    char node[32], move[32], text[32];
    line(f, &node_ns, &move_ns);
    printf(
        "%-8s %9.3g %8.0f %8.0f %8.0f %9.2f %s %10.1f %s %s\n", f->path, (double)f->tolerance_px,
        (double)fast->nodes / frames, (double)fast->moves / frames, (double)fast->waits / frames,
        1e-6 * triangles_per_second(fast),
        bench_number(fast->moves > 0 ? 1e9 * fast->seconds / (double)fast->moves : NAN, 8, 0, text),
        1e9 * ratio(slow->seconds, (double)slow->nodes), bench_number(node_ns, 8, 1, node),
        bench_number(move_ns, 8, 0, move));
    fflush(stdout);
}

static void print_flight(json *j, const char *key, const flight *f) {
    double frames = (double)f->frames;
    json_open(j, key, '{');
    json_u64(j, "frames", f->frames);
    json_f64(j, "seconds", f->seconds);
    json_f64(j, "active_nodes_mean", (double)f->nodes / frames);
    json_f64(j, "adapt_mean", (double)f->moves / frames);
    json_f64(j, "waits_dependency_mean", (double)f->waits / frames);
    json_u64(j, "triangles_made", f->made);
    json_u64(j, "triangles_removed", f->removed);
    json_f64(j, "triangles_per_second", triangles_per_second(f));
    json_f64(j, "ns_per_move", 1e9 * ratio(f->seconds, (double)f->moves));
    json_f64(j, "ns_per_node", 1e9 * ratio(f->seconds, (double)f->nodes));
    json_close(j, '}');
}

static void print_json(json *j, const figures *f) {
    double node_ns, move_ns;
    line(f, &node_ns, &move_ns);
    json_open(j, NULL, '{');
    json_str(j, "path", f->path);
    json_f64(j, "tolerance_px", (double)f->tolerance_px);
    print_flight(j, "fast", &f->fast);
    print_flight(j, "slow", &f->slow);
    json_f64(j, "node_ns", node_ns);
    json_f64(j, "move_ns", move_ns);
    json_close(j, '}');
}

/* All paths together: what the fast flights made and removed over the time they took. */
static void add(flight *sum, const flight *f) {
    sum->seconds += f->seconds;
    sum->made += f->made;
    sum->removed += f->removed;
}

static void print_head(const char *file, const mn_header *header) {
    printf("%s: %" PRIu64 " triangle%s\n", file, header->triangles, cli_s(header->triangles));
    printf("%-8s %9s %8s %8s %8s %9s %8s %10s %8s %8s\n", "path", "tolerance", "front", "moves",
           "waits", "M tri/s", "ns/move", "slow ns/n", "node ns", "move ns");
}

static mn_code measure(const char *file, const options *o, json *j, mn_status *st) {
    mn_session_desc desc = {.path = file,
                            .store = MN_STORE_RESIDENT,
                            .degrade_off = true,
                            .tolerance_px = o->tolerance_px,
                            .front_max = FRONT_MAX,
                            .warn = session_options_warn};
    mn_session *session = NULL;
    uint64_t most = o->frames > o->slow_frames ? o->frames : o->slow_frames;
    mn_camera *cameras = malloc(most * sizeof *cameras);
    mn_code code = cameras == NULL
                       ? mn_fail(st, MN_FAILED, "no memory for %" PRIu64 " cameras", most)
                       : mn_session_open(&desc, &session, st);
    flight all = {0};
    if (code == MN_OK && o->json) {
        json_open(j, NULL, '{');
        json_str(j, "file", file);
        json_u64(j, "triangles", mn_session_header(session)->triangles);
        json_open(j, "paths", '[');
    } else if (code == MN_OK) {
        print_head(file, mn_session_header(session));
    }
    size_t paths = o->path != NULL ? 1 : sizeof path_names / sizeof path_names[0];
    for (size_t i = 0; i < paths && code == MN_OK; i++) {
        figures f = {.path = o->path != NULL ? o->path : path_names[i]};
        mn_path *path = NULL;
        code = mn_path_open(f.path, mn_session_header(session), 45, &path, st);
        if (code != MN_OK)
            break;
        fly(session, path, o, cameras, &f);
        mn_path_close(path);
        add(&all, &f.fast);
        if (o->json)
            print_json(j, &f);
        else
            print_row(&f);
    }
    if (code == MN_OK && o->json) {
        json_close(j, ']');
        json_f64(j, "triangles_per_second", triangles_per_second(&all));
        json_close(j, '}');
    } else if (code == MN_OK) {
        printf("%-8s %45.2f\n", "all", 1e-6 * triangles_per_second(&all));
    }
    mn_session_close(session);
    free(cameras);
    return code;
}

/* Before any is measured: can the path be flown over each file? */
static mn_code path_is_there(char **files, int count, const options *o, mn_status *st) {
    mn_header header;
    mn_path *path = NULL;
    for (int i = 0; i < count && o->path != NULL && st->code == MN_OK; i++)
        if (mn_header_read(files[i], &header, st) == MN_OK &&
            mn_path_open(o->path, &header, 45, &path, st) == MN_OK)
            mn_path_close(path);
    return st->code;
}

static int report(char **files, int count, const options *o) {
    json j;
    mn_status st = {0};
    if (bench_trees_are_there(files, count, &st) != MN_OK ||
        path_is_there(files, count, o, &st) != MN_OK)
        return cli_status(&st);
    bench_one_core();
    if (o->json) {
        json_begin(&j, stdout);
        json_u64(&j, "fast_frames", o->frames);
        json_u64(&j, "slow_frames", o->slow_frames);
        json_open(&j, "files", '[');
    }
    for (int i = 0; i < count && st.code == MN_OK; i++)
        measure(files[i], o, &j, &st);
    if (o->json && st.code == MN_OK) {
        json_close(&j, ']');
        json_end(&j);
    }
    return cli_status(&st);
}

static mn_code read_options(options *o, int argc, char **argv, bool *done) {
    const char *tolerance = NULL;
    double tolerance_px = 1;
    const cli_flag flags[] = {
        CLI_TEXT("path", &o->path),
        CLI_WHOLE("frames", &o->frames, 1, FRAMES_MAX, "in 1 … 1000000"),
        CLI_WHOLE("slow-frames", &o->slow_frames, 1, FRAMES_MAX, "in 1 … 1000000"),
        CLI_WHOLE("front", &o->front, 1, FRONT_MAX, "in 1 … 4194304"),
        CLI_TEXT("tolerance", &tolerance),
        CLI_SWITCH("json", &o->json),
        {0},
    };
    const mn_code code = cli_flags(argc, argv, flags, help, done);
    if (code != MN_OK || *done)
        return code;
    if (tolerance != NULL && !cli_double(tolerance, 1e-3, 1e6, &tolerance_px))
        return (mn_code)cli_error(
            MN_USAGE, "bench adapt: --tolerance '%s' is not in 0.001 … 1000000", tolerance);
    if (tolerance != NULL && o->front > 0)
        return (mn_code)cli_error(
            MN_USAGE,
            "bench adapt: --front finds a tolerance, and --tolerance is one: one of them");
    if (optind >= argc)
        return (mn_code)cli_error(MN_USAGE,
                                  "bench adapt: which FILE? see metanode bench adapt --help");
    o->tolerance_px = (float)tolerance_px;
    return MN_OK;
}

int bench_adapt(int argc, char **argv) {
    options o = {.frames = 24, .slow_frames = SLOW_FRAMES};
    bool done = false;
    const mn_code code = read_options(&o, argc, argv, &done);
    if (code != MN_OK || done)
        return (int)code;
    return report(argv + optind, argc - optind, &o);
}
