/* metanode replay: navigates along a path without a window, and says how it went. See --help.
 *
 * Hides the loop over frames and what is measured when. Memory: what it needs besides the session
 * (figures, a path file's cameras) is taken before the session is opened, and told to its
 * plan. Main thread only; GL is loaded for pictures alone. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>

#include "output.h"
#include "path_record.h"
#include "picture.h"
#include "reference.h"
#include "replay_figures.h"
#include "session_options.h"

enum {
    CSV = SESSION_OPTION_END,
    IMAGES,
    IMAGES_EVERY,
    SETTLE,
    PACED,
    OPEN,
    WRITE_PATH,
    KEY_EVERY,
    REFERENCE,
    STDIO_BYTES = 1 << 14,
    SETTLE_FRAMES_MAX = 1 << 20,
    OPENING_FRAMES_MAX = 1 << 12, /* one takes some ten; a budget of few operations, many */
    FOLDOVER_SAMPLES = 8,         /* frames of a run whose foldovers are counted: each is slow */
};

typedef struct replay {
    session_options options;
    const char *csv_name, *images_dir;
    uint64_t images_every;
    const char *path_out; /* --write-path; NULL: navigate */
    uint64_t key_every;
    bool settle, paced, from_settled; /* the first picture is there before the first frame */
    bool compared;                    /* --reference */

    mn_path *path;
    mn_session *session;
    output csv;
    picture picture;
    reference reference;
    replay_figures figures;
    char csv_buffer[STDIO_BYTES];
} replay;

static void help(void) {
    printf(
        "usage: metanode replay FILE.mnt --path P [OPTION …]\n\n"
        "Navigates along a path without a window, and prints how it went.\n\n%s"
        "  --settle          then let the last camera stand until settled, and go to the roots\n"
        "  --open O          roots: the first frame begins with the roots (default); settled:\n"
        "                    before the first frame its camera stands until all is there\n"
        "  --paced           frames in real time even where no disk needs it, and nothing counted\n"
        "                    between them that takes long: to compare times\n"
        "  --csv F           a row a frame\n"
        "  --images DIR      a picture a frame, DIR/frame-000000.png …\n"
        "  --reference       each frame's picture beside the same with everything resident, which\n"
        "                    another process draws: PSNR and SSIM (see metanode compare --help)\n"
        "  --images-every N  pictures of every Nth frame only, from the first (1)\n"
        "  --write-path F    only writes the path to F, a path file, and navigates nothing\n"
        "  --key-every N     a key frame every Nth frame, and the last (1: the same path, "
        "exactly)\n%s",
        session_options_help, session_options_json_help);
}

/* ---- options --------------------------------------------------------------------------------- */

/* An option of replay's own. MN_USAGE: it has been said what was wrong. */
static mn_code take_own(replay *r, int option, const char *value) {
    static const char *const opens[] = {"roots", "settled", NULL};
    switch (option) {
    case CSV:
        r->csv_name = value;
        return MN_OK;
    case IMAGES:
        r->images_dir = value;
        return MN_OK;
    case IMAGES_EVERY:
    case KEY_EVERY:
        if (cli_u64(value, 1, UINT32_MAX, option == KEY_EVERY ? &r->key_every : &r->images_every))
            return MN_OK;
        return (mn_code)cli_error(MN_USAGE, "replay: --%s '%s': a number above 0",
                                  option == KEY_EVERY ? "key-every" : "images-every", value);
    case SETTLE:
        r->settle = true;
        return MN_OK;
    case PACED:
        r->paced = true;
        return MN_OK;
    case OPEN:
        r->from_settled = cli_choice(value, opens) == 1;
        if (cli_choice(value, opens) >= 0)
            return MN_OK;
        return (mn_code)cli_error(MN_USAGE, "replay: --open '%s': roots or settled", value);
    case REFERENCE:
        r->compared = true;
        return MN_OK;
    case WRITE_PATH:
        r->path_out = value;
        return MN_OK;
    default:
        return MN_USAGE;
    }
}

/* false: done, with *code. */
static bool parse(replay *r, int argc, char **argv, int *code) {
    static const struct option options[] = {SESSION_OPTIONS,
                                            {"csv", required_argument, NULL, CSV},
                                            {"images", required_argument, NULL, IMAGES},
                                            {"images-every", required_argument, NULL, IMAGES_EVERY},
                                            {"settle", no_argument, NULL, SETTLE},
                                            {"paced", no_argument, NULL, PACED},
                                            {"open", required_argument, NULL, OPEN},
                                            {"reference", no_argument, NULL, REFERENCE},
                                            {"write-path", required_argument, NULL, WRITE_PATH},
                                            {"key-every", required_argument, NULL, KEY_EVERY},
                                            {"help", no_argument, NULL, 'h'},
                                            {0, 0, 0, 0}};
    int found;
    *code = MN_OK;
    session_options_init(&r->options);
    r->images_every = r->key_every = 1;
    while ((found = cli_option(argc, argv, SESSION_OPTIONS_SHORT "h", options)) != -1) {
        if (found == 'h') {
            help();
            return false;
        }
        if (!session_options_take(&r->options, argv[0], found, optarg, code))
            *code = take_own(r, found, optarg);
        if (*code != MN_OK)
            return false;
    }
    *code = session_options_file(&r->options, argc, argv);
    if (*code == MN_OK && r->options.path_name == NULL)
        *code = cli_error(MN_USAGE, "replay: which --path? orbit, dive, flyover, or a path file");
    if (*code == MN_OK && r->key_every > 1 && r->path_out == NULL)
        *code = cli_error(MN_USAGE, "replay: --key-every is for --write-path");
    if (*code == MN_OK && r->images_every > 1 && r->images_dir == NULL && !r->compared)
        *code = cli_error(MN_USAGE, "replay: --images-every is for --images and --reference");
    const char *const outputs[] = {r->csv_name, r->path_out};
    for (int i = 0; i < 2 && *code == MN_OK; i++)
        *code = session_options_output(&r->options, argv[0], outputs[i]);
    if (*code == MN_OK)
        *code = cli_outputs_differ(argv[0], "--csv", r->csv_name, "--trace",
                                   r->options.desc.trace_path);
    return *code == MN_OK;
}

/* ---- open and close -------------------------------------------------------------------------- */

static mn_code csv_open(replay *r, mn_status *st) {
    if (output_open(&r->csv, "--csv", r->csv_name, st) != MN_OK)
        return st->code;
    setvbuf(r->csv.file, r->csv_buffer, _IOFBF, sizeof r->csv_buffer);
    figures_csv_header(r->csv.file);
    return MN_OK;
}

static mn_code images_open(replay *r, mn_status *st) {
    const mn_session_desc *d = &r->options.desc;
    struct stat about = {0};
    if (r->images_dir != NULL && mkdir(r->images_dir, 0777) != 0) {
        const int error = errno;
        if (error == EEXIST && stat(r->images_dir, &about) == 0 && !S_ISDIR(about.st_mode))
            return mn_fail(st, MN_FAILED, "--images %s: is a file; name a directory",
                           r->images_dir);
        if (error != EEXIST)
            return mn_fail(
                st, mn_code_of_write(error),
                "--images %s: cannot be made: %s; name a directory in one that is there, and "
                "can be written",
                r->images_dir, strerror(error));
    }
    return picture_open(&r->picture, r->session, d->width_px, d->height_px, r->compared, st);
}

static mn_code open_path(replay *r, mn_status *st) {
    session_options *o = &r->options;
    mn_header header;
    mn_code code = mn_header_read(o->desc.path, &header, st);
    if (code == MN_OK)
        code = mn_path_open(o->path_name, &header, o->fov_y_deg, &r->path, st);
    if (code == MN_OK && !o->frames_given && mn_path_frames(r->path) > 0)
        o->frames = mn_path_frames(r->path);
    return code;
}

/* The session, which reads what the first camera wants; told apart, as it is before the frames. */
static mn_code session_open(replay *r, mn_status *st) {
    session_options *o = &r->options;
    mn_session_stats stats;
    mn_camera first;
    mn_path_camera(r->path, 0, o->frames, &first);
    mn_session_desc desc = o->desc;
    desc.first_camera = &first;
    const double from = cli_seconds(CLOCK_MONOTONIC);
    mn_code code = mn_session_open(&desc, &r->session, st);
    if (code != MN_OK)
        return code;
    mn_session_stats_get(r->session, &stats);
    r->figures.start_reads = stats.reads;
    r->figures.start_seconds = cli_seconds(CLOCK_MONOTONIC) - from;
    return MN_OK;
}

static mn_code open_all(replay *r, mn_status *st) {
    session_options *o = &r->options;
    mn_code code = open_path(r, st);
    if (code == MN_OK && r->compared)
        code = reference_open(&r->reference, &o->desc, r->path, o->frames, r->from_settled, st);
    if (code != MN_OK)
        return code;
    o->desc.base_bytes = sizeof *r + mn_path_bytes(r->path);
    o->desc.wide_front_over_wanted = !r->paced;
    code = session_open(r, st);
    if (code == MN_OK && r->csv_name != NULL)
        code = csv_open(r, st);
    if (code == MN_OK && (r->images_dir != NULL || r->compared))
        code = images_open(r, st);
    return code;
}

/* good: the run has come to its end. */
static mn_code close_all(replay *r, bool good, mn_status *st) {
    reference_close(&r->reference);
    picture_close(&r->picture);
    mn_code code = mn_session_end(r->session, st);
    mn_code written = output_close(&r->csv, good && code == MN_OK, st);
    mn_path_close(r->path);
    return code != MN_OK ? code : written;
}

/* ---- frames ---------------------------------------------------------------------------------- */

static mn_code write_image(replay *r, uint32_t frame, mn_status *st) {
    char name[4096];
    if (snprintf(name, sizeof name, "%s/frame-%06u.png", r->images_dir, frame) >= (int)sizeof name)
        return mn_fail(st, MN_USAGE, "--images: that name is longer than 4,000 characters");
    return picture_png(&r->picture, name, st);
}

/* A frame's picture, where it is wanted; *out: its figures. */
static mn_code draw(replay *r, uint32_t frame, const mn_camera *camera, figures_picture *out,
                    mn_status *st) {
    static const mn_gl_look look = {0};
    const uint64_t sent_before = r->figures.gl_sent_bytes;
    const uint8_t *rgb;
    uint32_t width, height;
    *out = (figures_picture){.compared = r->compared};
    mn_code code = picture_draw(&r->picture, r->session, camera, &look, st);
    if (code == MN_OK && r->images_dir != NULL)
        code = write_image(r, frame, st);
    if (code == MN_OK && r->compared)
        code = picture_rgb(&r->picture, &rgb, &width, &height, st);
    if (code == MN_OK && r->compared)
        code = reference_compare(&r->reference, frame, rgb, &out->likeness, st);
    mn_gl_stats gl;
    r->picture.load.api->stats(r->picture.gl, &gl);
    r->figures.gl_fronts = gl.fronts;
    r->figures.gl_sent_bytes = gl.sent_bytes;
    out->sent_bytes = gl.sent_bytes - sent_before;
    if (code == MN_OK && r->compared)
        figures_compared(&r->figures, &out->likeness);
    return code;
}

static void foldovers(replay *r) {
    if (r->options.desc.store != MN_STORE_RESIDENT || r->paced)
        return;
    uint64_t legal = 0, count = mn_session_foldovers(r->session, &legal);
    replay_figures *f = &r->figures;
    f->foldovers = count > f->foldovers ? count : f->foldovers;
    f->foldovers_legal = legal > f->foldovers_legal ? legal : f->foldovers_legal;
}

/* A disk in real time needs frames in real time; the simulated one has a clock of its own, and with
 * a barrier a frame takes what it takes. A frame that is late makes those after it as late, not
 * quicker: a disk would have less time for them, and caches stay warm from one to the next. */
static void pace(const replay *r, struct timespec *due) {
    const mn_session_desc *d = &r->options.desc;
    const bool no_disk = d->io == MN_IO_SIM || d->barrier || d->store == MN_STORE_RESIDENT;
    if (!(d->fps > 0) || (no_disk && !r->paced))
        return;
    int64_t ns = due->tv_nsec + (int64_t)(1e9 / (double)d->fps);
    due->tv_sec += (time_t)(ns / 1000000000);
    due->tv_nsec = (long)(ns % 1000000000);
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (now.tv_sec > due->tv_sec || (now.tv_sec == due->tv_sec && now.tv_nsec > due->tv_nsec))
        *due = now;
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, due, NULL) == EINTR)
        continue;
}

/* For a path that is a part of a navigation, not its start (--open settled): what the first picture
 * needs is there before the first frame, and is told apart. */
static void opening(replay *r) {
    replay_figures *f = &r->figures;
    mn_session_stats before, after;
    mn_frame_stats stats = {.changed = true};
    mn_camera camera;
    double from = cli_seconds(CLOCK_MONOTONIC);
    mn_path_camera(r->path, 0, r->options.frames, &camera);
    mn_session_stats_get(r->session, &before);
    while (stats.changed && f->opening_frames < OPENING_FRAMES_MAX) {
        (void)mn_session_opening(r->session, &camera, &stats);
        f->opening_frames++;
        f->opening_misses += stats.misses;
    }
    mn_session_stats_get(r->session, &after);
    f->opening_reads = after.reads - before.reads;
    f->opening_seconds = cli_seconds(CLOCK_MONOTONIC) - from;
}

/* A trace that cannot be written ends the run; mn_session_end says why. */
static bool goes_on(const replay *r, mn_code code) {
    return code == MN_OK && !mn_session_trace_has_failed(r->session);
}

static uint64_t major_faults(void) {
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    return (uint64_t)usage.ru_majflt;
}

static mn_code run_frames(replay *r, mn_camera *camera, mn_status *st) {
    uint32_t frames = r->options.frames;
    uint32_t sample = frames / FOLDOVER_SAMPLES > 0 ? frames / FOLDOVER_SAMPLES : 1;
    mn_code code = MN_OK;
    cli_meter meter = {0};
    struct timespec due;
    const uint64_t faults = major_faults();
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (uint32_t frame = 0; frame < frames && goes_on(r, code); frame++) {
        mn_frame_stats stats;
        mn_path_camera(r->path, frame, frames, camera);
        mn_session_frame(r->session, camera, &stats);
        figures_frame(&r->figures, &stats);
        figures_picture shown;
        const bool drawn = r->picture.gl != NULL && frame % r->images_every == 0;
        if (drawn)
            code = draw(r, frame, camera, &shown, st);
        if (r->csv.file != NULL && code == MN_OK) {
            figures_csv_row(r->csv.file, &stats, drawn ? &shown : NULL);
            code = output_good(&r->csv, st);
        }
        if (frame % sample == 0)
            foldovers(r);
        (void)cli_progress(&meter, "frames", frame + 1, frames);
        pace(r, &due);
    }
    r->figures.major_faults = major_faults() - faults;
    cli_progress_end(&meter);
    return code;
}

/* The last camera stands until settled; then everything goes back to the roots. */
static void settle(replay *r, const mn_camera *camera) {
    mn_frame_stats stats;
    r->figures.settled = true;
    r->figures.settle_frames = mn_session_settle(r->session, camera, SETTLE_FRAMES_MAX);
    mn_session_frame(r->session, camera, &stats);
    r->figures.front_hash = stats.front_hash;
    foldovers(r);
    mn_session_set_tolerance(r->session, INFINITY);
    mn_session_settle(r->session, camera, SETTLE_FRAMES_MAX);
    r->figures.back_at_roots = mn_session_at_roots(r->session);
}

/* The plan, before the first frame: who sees that the front is small need not wait for the last. */
static void say_plan(const replay *r) {
    mn_plan plan;
    mn_session_plan(r->session, &plan);
    figures_plan(&plan, mn_session_header(r->session)->block_bytes_max, stdout);
    fflush(stdout);
}

static void finish(replay *r) {
    replay_figures *f = &r->figures;
    mn_session_drain(r->session);
    f->allocations_after_seal = cli_alloc_since_mark();
    f->gl_allocations = cli_alloc_theirs_since_mark();
    f->has_gl = r->picture.gl != NULL;
    f->gl_rss_bytes = r->picture.load.rss_bytes;
    f->rss_peak_bytes = f->has_gl ? r->picture.load.own_peak_bytes : cli_rss_peak_bytes();
    f->store = r->options.desc.store;
    f->has_foldovers = f->store == MN_STORE_RESIDENT && !r->paced;
    f->prefetch = r->options.desc.prefetch;
    f->l = mn_session_header(r->session)->l;
    f->block_bytes_max = mn_session_header(r->session)->block_bytes_max;
    mn_session_plan(r->session, &f->plan);
    mn_session_stats_get(r->session, &f->totals);
    if (r->options.json)
        figures_json(f, stdout);
    else
        figures_table(f, stdout);
}

static mn_code navigate(replay *r, mn_status *st) {
    mn_camera camera;
    mn_code code = open_all(r, st);
    cli_alloc_mark();
    if (code == MN_OK && !r->options.json)
        say_plan(r);
    if (code == MN_OK && r->from_settled)
        opening(r);
    if (code == MN_OK)
        code = run_frames(r, &camera, st);
    if (r->settle && goes_on(r, code))
        settle(r, &camera);
    if (goes_on(r, code))
        finish(r);
    return code;
}

static mn_code write_path(replay *r, mn_status *st) {
    mn_code code = open_path(r, st);
    if (code == MN_OK)
        code = path_record_all(r->path, r->options.frames, r->key_every, r->path_out, st);
    if (code == MN_OK && !r->options.json)
        printf("%s: %u frame%s\n", r->path_out, r->options.frames, cli_s(r->options.frames));
    return code;
}

int cmd_replay(int argc, char **argv) {
    mn_status st = {0};
    int code;
    replay *r = calloc(1, sizeof *r);
    if (r == NULL)
        return cli_error(MN_FAILED, "replay: no memory");
    if (parse(r, argc, argv, &code)) {
        static char out_buffer[STDIO_BYTES]; /* or printing would allocate one */
        setvbuf(stdout, out_buffer, _IOFBF, sizeof out_buffer);
        code = r->path_out != NULL ? write_path(r, &st) : navigate(r, &st);
        mn_code closed = close_all(r, code == MN_OK, &st);
        code = code != MN_OK ? code : (int)closed;
        cli_status(&st);
    }
    free(r);
    return code;
}
