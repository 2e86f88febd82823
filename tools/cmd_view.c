/* metanode view: the window. One thread: events, a frame of the session, a picture, and so on;
 * while nothing changes it sleeps in the window system. */
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "orbit.h"
#include "path_record.h"
#include "picture.h"
#include "session_options.h"

static const char help[] = "usage: metanode view FILE [--ram SIZE] [OPTION …]\n\n"
                           "  Opens at the first camera of --path (orbit), which g flies; --size "
                           "is the window's at first.\n\n";

static const char keys_help[] =
    "  left drag  turn             w  wireframe          + -    finer, coarser\n"
    "  wheel      nearer, farther  l  level of detail    space  stop and go on adapting\n"
    "  right drag the same         f  flat               s      picture to metanode-N.png\n"
    "  shift or middle drag  pan   r  back to the start  p      record a path, stop: "
    "metanode-N.path\n"
    "                        g  fly --path, stop         o      silhouettes finer\n"
    "                        h ?  this                   q esc  quit\n";

enum { NUMBERED_MAX = 10000 };      /* pictures and paths in one directory */
static const double idle_s = 1;     /* how long to sleep when nothing happens */
static const double title_s = 0.25; /* between two titles */
static const float finer = 0.8f;    /* of the tolerance, a key */

typedef struct viewer {
    session_options options;
    mn_session *session;
    gl_load load;
    mn_gl *gl;
    mn_gl_look look;
    float radius;
    orbit start, now;
    mn_path *path;
    uint32_t path_frames, path_frame; /* the next of a flight */
    bool flying;                      /* the path moves the camera: a frame a picture */
    mn_camera flown;                  /* the path's camera, while flying */
    float tolerance_px;
    uint32_t width, height;
    bool paused;
    bool dirty;    /* what is shown is not what should be */
    bool adapting; /* the session wants more frames */
    bool shoot;    /* the next picture is wanted as a file */
    bool aimed;    /* the target is on the surface, and only zooming has happened since */
    mn_frame_stats stats;
    path_record record; /* file NULL: not recording */
    double record_s;
    uint32_t drawn; /* pictures since titled_s */
    double titled_s;
    bool titled_still; /* the title says that nothing moves */
} viewer;

/* ---- start ---------------------------------------------------------------------------------- */

static int read_options(session_options *o, int argc, char **argv, bool *done) {
    static const struct option options[] = {
        SESSION_OPTIONS, {"help", no_argument, NULL, 'h'}, {0, 0, 0, 0}};
    int option, code = MN_OK;
    session_options_init(o);
    while ((option = cli_option(argc, argv, SESSION_OPTIONS_SHORT "h", options)) != -1) {
        if (session_options_take(o, argv[0], option, optarg, &code)) {
            if (code != MN_OK)
                return code;
        } else if (option == 'h') {
            printf("%s%s\n%s", help, session_options_help, keys_help);
            *done = true;
            return MN_OK;
        } else {
            return MN_USAGE;
        }
    }
    if (o->json)
        return cli_error(MN_USAGE, "view: --json is for replay and shoot");
    return session_options_file(o, argc, argv);
}

static mn_code open_path(viewer *v, mn_status *st) {
    session_options *o = &v->options;
    mn_header header;
    mn_camera camera;
    mn_code code = mn_header_read(o->desc.path, &header, st);
    if (code == MN_OK)
        code = mn_path_open(o->path_name != NULL ? o->path_name : "orbit", &header, o->fov_y_deg,
                            &v->path, st);
    if (code != MN_OK)
        return code;
    const uint32_t recorded = mn_path_frames(v->path);
    v->path_frames = recorded > 0 && !o->frames_given ? recorded : o->frames;
    o->desc.base_bytes = mn_path_bytes(v->path);
    mn_path_camera(v->path, 0, v->path_frames, &camera);
    double square = 0;
    for (int i = 0; i < 3; i++) {
        const double side = (double)header.box_max[i] - (double)header.box_min[i];
        square += 0.25 * side * side;
    }
    v->radius = (float)sqrt(square);
    v->start = v->now = orbit_from(&camera, v->radius);
    return MN_OK;
}

static mn_code open_all(viewer *v, mn_status *st) {
    mn_session_desc *desc = &v->options.desc;
    mn_gl_desc gl_desc;
    mn_code code = open_path(v, st);
    if (code == MN_OK && getenv("DISPLAY") == NULL && getenv("WAYLAND_DISPLAY") == NULL)
        code = mn_fail(st, MN_NO_GRAPHICS, "no display (DISPLAY is not set); try metanode shoot");
    if (code == MN_OK)
        code = mn_session_open(desc, &v->session, st);
    if (code == MN_OK)
        code = gl_load_module(&v->load, st);
    if (code != MN_OK)
        return code;
    picture_desc(v->session, desc->width_px, desc->height_px, &gl_desc);
    gl_desc.title = desc->path;
    const uint64_t entered = gl_load_enter(&v->load);
    code = v->load.api->window_open(&gl_desc, &v->gl, st);
    gl_load_leave(&v->load, entered);
    return code;
}

/* ---- what the user does --------------------------------------------------------------------- */

/* The tolerance × factor; with a target of triangles, that over it. */
static void coarsen(viewer *v, float factor) {
    uint64_t *target = &v->options.desc.triangles_max;
    v->adapting = true;
    if (*target > 0) {
        *target = (uint64_t)fmin(fmax((double)*target / (double)factor, 100), 1e9);
        mn_session_set_triangles_max(v->session, *target);
        printf("at most %" PRIu64 " triangle%s\n", *target, cli_s(*target));
        return;
    }
    v->tolerance_px = fminf(fmaxf(v->tolerance_px * factor, 0.01f), 1000);
    mn_session_set_tolerance(v->session, v->tolerance_px);
    printf("tolerance %.3g px\n", v->tolerance_px);
}

/* Silhouettes count for more, or do not. */
static void weigh_silhouettes(viewer *v) {
    mn_weights *weights = &v->options.desc.weights;
    weights->silhouette = weights->silhouette > 1 ? 1 : SESSION_TIGHTER;
    mn_session_set_weights(v->session, weights);
    printf("silhouettes %s\n", weights->silhouette > 1 ? "on" : "off");
    v->adapting = true;
}

/* The first name metanode-N.suffix that is free; false: all are taken. */
static bool free_name(const char *suffix, char name[32]) {
    for (int i = 1; i < NUMBERED_MAX; i++) {
        snprintf(name, 32, "metanode-%d.%s", i, suffix);
        if (access(name, F_OK) != 0)
            return true;
    }
    return false;
}

/* Failures are told and the window stays: a full disk is no reason to go. */
static void screenshot(viewer *v) {
    char name[32];
    mn_status st = {0};
    if (!free_name("png", name))
        cli_error(MN_FAILED, "no name is left for a picture in this directory");
    else if (v->load.api->png(v->gl, name, &st) == MN_OK)
        printf("%s\n", name);
    cli_status(&st);
    fflush(stdout);
}

static mn_camera camera_now(const viewer *v) {
    return v->flying ? v->flown : orbit_camera(&v->now);
}

/* Which frame of the recording it is: of --fps a second, as it was flown. Replayed, it goes by
 * frames, whatever time they take. */
static uint32_t record_frame(const viewer *v) {
    const double fps = v->options.desc.fps > 0 ? (double)v->options.desc.fps : 60;
    return (uint32_t)fmin((cli_seconds(CLOCK_MONOTONIC) - v->record_s) * fps, 1e8);
}

static void record(viewer *v) {
    const mn_camera camera = camera_now(v);
    if (v->record.file != NULL)
        path_record_camera(&v->record, record_frame(v), &camera);
}

static void stop_recording(viewer *v) {
    const mn_camera camera = camera_now(v);
    path_record_end(&v->record, record_frame(v), &camera);
    const uint32_t frames = v->record.frame + 1;
    const bool bad = ferror(v->record.file) != 0;
    if (fclose(v->record.file) != 0 || bad)
        cli_error(mn_code_of_write(errno), "the path could not be written whole: %s; %s",
                  strerror(errno), cli_write_advice(errno));
    else
        printf("recorded %u frame%s\n", frames, cli_s(frames));
    v->record = (path_record){0};
}

/* A path file for replay, shoot and view (docs/paths.md). Never over a file that is there. */
static void start_recording(viewer *v) {
    char name[32];
    do { /* another may take the name that was free */
        if (!free_name("path", name)) {
            cli_error(MN_FAILED, "no name is left for a path in this directory");
            return;
        }
        v->record.file = fopen(name, "wxe");
    } while (v->record.file == NULL && errno == EEXIST);
    if (v->record.file == NULL) {
        cli_error(MN_FAILED, "%s: cannot be written: %s", name, strerror(errno));
        return;
    }
    v->record_s = cli_seconds(CLOCK_MONOTONIC);
    printf("recording to %s; p stops\n", name);
}

/* Back to the hand, where the flight has come to. */
static void stop_flying(viewer *v) {
    if (!v->flying)
        return;
    v->flying = false;
    v->now = orbit_from(&v->flown, v->radius);
    v->aimed = false;
    printf("flown to frame %u of %u\n", v->path_frame, v->path_frames);
}

static void fly_or_stop(viewer *v) {
    if (v->flying) {
        stop_flying(v);
        return;
    }
    v->flying = true;
    v->path_frame = 0;
    mn_path_camera(v->path, 0, v->path_frames, &v->flown);
}

/* false: the user wants to go. */
static bool take_character(viewer *v, uint32_t character) {
    switch (character) {
    case 'w':
        v->look.wireframe = !v->look.wireframe;
        break;
    case 'l':
        v->look.lod_colors = !v->look.lod_colors;
        break;
    case 'f':
        v->look.flat = !v->look.flat;
        break;
    case 'r':
        stop_flying(v);
        v->now = v->start;
        v->aimed = false;
        v->adapting = true;
        break;
    case '+':
    case '=': /* the same key, unshifted */
        coarsen(v, finer);
        break;
    case '-':
        coarsen(v, 1 / finer);
        break;
    case 'o':
        weigh_silhouettes(v);
        break;
    case ' ':
        v->paused = !v->paused;
        break;
    case 's':
        v->shoot = true;
        break;
    case 'p':
        if (v->record.file != NULL)
            stop_recording(v);
        else
            start_recording(v);
        break;
    case 'g':
        fly_or_stop(v);
        break;
    case 'h':
    case '?':
        fputs(keys_help, stdout);
        break;
    default:
        return character != 'q';
    }
    fflush(stdout);
    v->dirty = true;
    return true;
}

/* Zooming goes towards what is looked at: found once a zoom, not for each of its events. */
static void aim(viewer *v) {
    mn_front front;
    if (v->aimed)
        return;
    mn_session_front(v->session, &front);
    orbit_aim(&v->now, &front);
    v->aimed = true;
}

/* false: the user wants to go. */
static bool take_input(viewer *v, const mn_gl_input *input) {
    const bool turned = input->orbit[0] != 0 || input->orbit[1] != 0;
    const bool panned = input->pan[0] != 0 || input->pan[1] != 0;
    if (turned || panned || input->zoom != 0)
        stop_flying(v);
    if (panned) {
        orbit_pan(&v->now, input->pan[0], input->pan[1]);
        v->aimed = false;
    }
    if (input->zoom != 0) {
        aim(v);
        orbit_zoom(&v->now, input->zoom);
    }
    if (turned) {
        orbit_turn(&v->now, input->orbit[0], input->orbit[1]);
        v->aimed = false;
    }
    if (turned || panned || input->zoom != 0)
        v->dirty = v->adapting = true;
    v->dirty |= input->exposed;
    bool stays = !input->closed;
    for (uint32_t i = 0; i < input->typed_count && stays; i++)
        stays = take_character(v, input->typed[i]);
    return stays;
}

/* ---- frames --------------------------------------------------------------------------------- */

static void follow_size(viewer *v) {
    uint32_t width, height;
    v->load.api->size(v->gl, &width, &height);
    if (width == 0 || height == 0 || (width == v->width && height == v->height))
        return;
    v->width = width;
    v->height = height;
    mn_session_set_size(v->session, width, height);
    v->dirty = v->adapting = true;
}

/* Has the next frame anything to do? */
static bool busy(const viewer *v) {
    return v->dirty || v->flying || (v->adapting && !v->paused);
}

static void set_title(viewer *v, double now) {
    char text[256], speed[32] = "still";
    const uint64_t rss = cli_rss_bytes();
    const int64_t ours = (int64_t)rss - v->load.held_bytes;
    const char *slash = strrchr(v->options.desc.path, '/');
    if (busy(v))
        snprintf(speed, sizeof speed, "%.0f fps", v->drawn / (now - v->titled_s));
    snprintf(text, sizeof text,
             "%s: %s, %" PRIu64 " triangle%s, %.1f MB, %" PRIu64 " miss%s, error %.2g px%s",
             slash != NULL ? slash + 1 : v->options.desc.path, speed, v->stats.triangles,
             cli_s(v->stats.triangles), (double)ours / (1 << 20), v->stats.misses,
             v->stats.misses == 1 ? "" : "es", v->stats.error_px, v->paused ? " (paused)" : "");
    v->load.api->title(v->gl, text);
    v->titled_s = now;
    v->titled_still = !busy(v);
    v->drawn = 0;
}

static mn_code hand_over(viewer *v, mn_status *st) {
    mn_front front;
    mn_session_front(v->session, &front);
    v->dirty = true;
    const uint64_t entered = gl_load_enter(&v->load);
    const mn_code code = v->load.api->front(v->gl, &front, st);
    gl_load_leave(&v->load, entered);
    return code;
}

/* A flight goes by frames, one a picture, and stops at the last. */
static void next_of_flight(viewer *v) {
    if (v->flying && v->path_frame == v->path_frames)
        stop_flying(v);
    if (!v->flying)
        return;
    mn_path_camera(v->path, v->path_frame++, v->path_frames, &v->flown);
    v->dirty = v->adapting = true;
}

/* One step of the session, if it has anything to do, and a picture, if there is anything new. */
static mn_code frame(viewer *v, mn_status *st) {
    next_of_flight(v);
    const mn_camera camera = camera_now(v);
    mn_code code = MN_OK;
    if (v->adapting && !v->paused) {
        mn_session_frame(v->session, &camera, &v->stats);
        v->adapting = v->stats.changed;
        if (v->stats.adapt > 0)
            code = hand_over(v, st);
    }
    if (code != MN_OK || !v->dirty)
        return code;
    const uint64_t entered = gl_load_enter(&v->load);
    code = v->load.api->draw(v->gl, &camera, &v->look, st);
    gl_load_leave(&v->load, entered);
    if (v->shoot && code == MN_OK)
        screenshot(v);
    record(v);
    v->shoot = false;
    v->dirty = false;
    v->drawn++;
    return code;
}

/* Sleeps until the next frame is due or, when nothing changes, until something happens. */
static bool wait(viewer *v, double due_s) {
    mn_gl_input input;
    double left = busy(v) ? fmax(due_s - cli_seconds(CLOCK_MONOTONIC), 0) : idle_s;
    bool stays = true;
    do {
        v->load.api->poll(v->gl, left, &input);
        if (!busy(v))
            record(v); /* it has stood until now */
        stays = take_input(v, &input);
        left = due_s - cli_seconds(CLOCK_MONOTONIC);
    } while (left > 1e-4 && stays);
    /* A block that could not be read is tried again only by frames. */
    if (!busy(v) && v->stats.misses > 0)
        v->adapting = true;
    return stays;
}

static mn_code loop(viewer *v, mn_status *st) {
    const double period_s = v->options.desc.fps > 0 ? 1 / (double)v->options.desc.fps : 0;
    mn_code code = hand_over(v, st);
    bool open = code == MN_OK, rested = true;
    v->adapting = true;
    while (open) {
        const double started_s = cli_seconds(CLOCK_MONOTONIC);
        if (rested)
            v->titled_s = started_s;
        follow_size(v);
        code = frame(v, st);
        rested = !busy(v);
        if (rested ? v->drawn > 0 || !v->titled_still
                   : cli_seconds(CLOCK_MONOTONIC) - v->titled_s >= title_s)
            set_title(v, cli_seconds(CLOCK_MONOTONIC));
        open = code == MN_OK && wait(v, started_s + period_s);
    }
    return code;
}

int cmd_view(int argc, char **argv) {
    viewer v = {.tolerance_px = 1};
    bool done = false;
    const int code = read_options(&v.options, argc, argv, &done);
    if (code != MN_OK || done)
        return code;
    mn_status st = {0};
    if (v.options.desc.tolerance_px > 0)
        v.tolerance_px = v.options.desc.tolerance_px;
    if (open_all(&v, &st) == MN_OK) {
        fputs(keys_help, stdout);
        fflush(stdout);
        loop(&v, &st);
    }
    if (v.record.file != NULL)
        stop_recording(&v);
    if (v.gl != NULL)
        v.load.api->close(v.gl);
    (void)mn_session_end(v.session, &st);
    mn_path_close(v.path);
    return cli_status(&st);
}
