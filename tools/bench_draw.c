/* metanode bench draw: what handing fronts to the driver takes, in bytes and in processor time,
 * along paths with everything resident. Thin over a session and the graphics module. */
#include <math.h>
#include <stdio.h>
#include <time.h>

#include "bench.h"
#include "json.h"
#include "picture.h"
#include "session_options.h"

static const char help[] =
    "usage: metanode bench draw FILE … [--frames N] [--size WxH] [--tolerance PX] [--pictures]\n"
    "                           [--json]\n\n"
    "Navigates each file along orbit and dive, resident, and hands every front to the driver.\n"
    "METANODE_GL_UPLOAD=mapped|ranges|whole chooses how it is sent.\n\n"
    "  whole    bytes of the first front, which is sent as it is\n"
    "  sent     bytes of each later one, on average, in so many ranges\n"
    "  front    processor time of handing one over; navigate: of what came before it\n\n"
    "  picture  with --pictures: by the clock, handing a front over and drawing it, waits for the\n"
    "           driver among it; again: drawing the last one over and over, nothing sent\n\n"
    "  --frames N   of each path, 2 at least (300)\n"
    "  --pictures   draws every front; else none is\n";

enum {
    DRAW_PICTURES = SESSION_OPTION_END,
    AGAIN = 64, /* pictures of the last front */
};

static const char *const paths[] = {"orbit", "dive"};

typedef struct figures { /* means over all fronts but the first */
    uint64_t frames;
    double whole_bytes, sent_bytes, ranges, triangles, slots, adapt, front_ms, nav_ms;
    double picture_ms; /* with pictures, else 0 */
    double again_ms;   /* a picture of the last front; not a mean of the others */
} figures;

typedef struct run {
    const session_options *options;
    bool pictures;
    char driver[128];
} run;

static const mn_gl_look look; /* smooth */

static double now_ms(clockid_t clock) {
    return 1e3 * cli_seconds(clock);
}

/* The driver draws behind the program's back: it has when the picture can be read. */
static mn_code finish(picture *p, mn_status *st) {
    return p->load.api->pixels(p->gl, p->pixels, st);
}

static mn_code one_frame(mn_session *session, picture *p, const mn_camera *camera, bool first,
                         figures *f, mn_status *st) {
    mn_frame_stats frame;
    mn_front front;
    mn_gl_stats before, after;
    p->load.api->stats(p->gl, &before);
    mn_session_frame(session, camera, &frame);
    mn_session_front(session, &front);
    const double begun_ms = now_ms(CLOCK_THREAD_CPUTIME_ID), clock_ms = now_ms(CLOCK_MONOTONIC);
    mn_code code = p->load.api->front(p->gl, &front, st);
    const double took_ms = now_ms(CLOCK_THREAD_CPUTIME_ID) - begun_ms;
    if (code == MN_OK && p->pixels != NULL)
        code = p->load.api->draw(p->gl, camera, &look, st);
    p->load.api->stats(p->gl, &after);
    const double bytes = (double)(after.sent_bytes - before.sent_bytes);
    if (first) {
        f->whole_bytes = bytes;
        return code;
    }
    f->frames++;
    f->sent_bytes += bytes;
    f->ranges += (double)(after.sent_ranges - before.sent_ranges);
    f->triangles += (double)front.triangles;
    f->slots += (double)front.simplex_slots;
    f->adapt += (double)frame.adapt;
    f->front_ms += took_ms;
    f->nav_ms += frame.nav_ms;
    f->picture_ms += p->pixels != NULL ? now_ms(CLOCK_MONOTONIC) - clock_ms : 0;
    return code;
}

static mn_code again(picture *p, const mn_camera *camera, figures *f, mn_status *st) {
    const double begun_ms = now_ms(CLOCK_MONOTONIC);
    mn_code code = finish(p, st);
    f->picture_ms += now_ms(CLOCK_MONOTONIC) - begun_ms; /* the last of the path */
    const double again_ms = now_ms(CLOCK_MONOTONIC);
    for (int i = 0; i < AGAIN && code == MN_OK; i++)
        code = p->load.api->draw(p->gl, camera, &look, st);
    if (code == MN_OK)
        code = finish(p, st);
    f->again_ms = (now_ms(CLOCK_MONOTONIC) - again_ms) / AGAIN;
    return code;
}

static mn_code run_path(run *r, const char *name, figures *f, mn_status *st) {
    const session_options *o = r->options;
    mn_camera camera = {0};
    mn_session *session = NULL;
    mn_path *path = NULL;
    picture p = {0};
    mn_code code = mn_session_open(&o->desc, &session, st);
    if (code == MN_OK)
        code = mn_path_open(name, mn_session_header(session), o->fov_y_deg, &path, st);
    if (code == MN_OK)
        code = picture_open(&p, session, o->desc.width_px, o->desc.height_px, r->pictures, st);
    for (uint32_t i = 0; i < o->frames && code == MN_OK; i++) {
        mn_path_camera(path, i, o->frames, &camera);
        code = one_frame(session, &p, &camera, i == 0, f, st);
    }
    if (code == MN_OK)
        snprintf(r->driver, sizeof r->driver, "%s", p.load.api->driver(p.gl));
    if (code == MN_OK && r->pictures)
        code = again(&p, &camera, f, st);
    double *const sums[] = {&f->sent_bytes, &f->ranges,   &f->triangles, &f->slots,
                            &f->adapt,      &f->front_ms, &f->nav_ms,    &f->picture_ms};
    for (size_t i = 0; i < sizeof sums / sizeof sums[0] && f->frames > 0; i++)
        *sums[i] /= (double)f->frames;
    picture_close(&p);
    mn_path_close(path);
    mn_session_close(session);
    return code;
}

static void report(json *j, const run *r, const char *file, const char *path, const figures *f) {
    if (j == NULL) {
        printf("%s, %s: %.0f triangles in %.0f slots, %.0f splits and collapses\n"
               "  whole %.1f kB, sent %.2f kB in %.1f ranges; front %.3f ms, navigate %.3f ms\n",
               file, path, f->triangles, f->slots, f->adapt, f->whole_bytes / 1e3,
               f->sent_bytes / 1e3, f->ranges, f->front_ms, f->nav_ms);
        if (r->pictures)
            printf("  picture %.3f ms, again %.3f ms, %s\n", f->picture_ms, f->again_ms, r->driver);
        return;
    }
    json_open(j, NULL, '{');
    json_str(j, "file", file);
    json_str(j, "path", path);
    json_f64(j, "triangles_mean", f->triangles);
    json_f64(j, "simplex_slots_mean", f->slots);
    json_f64(j, "adapt_mean", f->adapt);
    json_f64(j, "whole_bytes", f->whole_bytes);
    json_f64(j, "sent_bytes_mean", f->sent_bytes);
    json_f64(j, "sent_ranges_mean", f->ranges);
    json_f64(j, "front_ms_mean", f->front_ms);
    json_f64(j, "nav_ms_mean", f->nav_ms);
    json_f64(j, "picture_ms_mean", r->pictures ? f->picture_ms : (double)NAN);
    json_f64(j, "again_ms_mean", r->pictures ? f->again_ms : (double)NAN);
    json_str(j, "gl_driver", r->driver);
    json_close(j, '}');
}

/* false: done, with *code. */
static bool parse(int argc, char **argv, session_options *o, bool *pictures, int *code) {
    static const struct option known[] = {SESSION_OPTIONS,
                                          {"pictures", no_argument, NULL, DRAW_PICTURES},
                                          {"help", no_argument, NULL, 'h'},
                                          {0, 0, 0, 0}};
    int option;
    *code = MN_OK;
    session_options_init(o);
    o->frames = 300;
    while ((option = cli_option(argc, argv, SESSION_OPTIONS_SHORT "h", known)) != -1) {
        if (option == SESSION_PATH || option == SESSION_STORE) {
            *code = cli_error(MN_USAGE, "%s: no --%s here: orbit and dive are flown, resident",
                              argv[0], option == SESSION_PATH ? "path" : "store");
            return false;
        }
        if (session_options_take(o, argv[0], option, optarg, code)) {
            if (*code != MN_OK)
                return false;
        } else if (option == DRAW_PICTURES) {
            *pictures = true;
        } else if (option == 'h') {
            fputs(help, stdout);
            return false;
        } else {
            *code = MN_USAGE;
            return false;
        }
    }
    if (optind == argc)
        *code = cli_error(MN_USAGE, "bench draw: which FILE? see metanode bench draw --help");
    else if (o->frames < 2)
        *code = cli_error(MN_USAGE, "bench draw: --frames 1: the first is sent whole, and the "
                                    "figures are of those after it: 2 at least");
    o->desc.store = MN_STORE_RESIDENT;
    return *code == MN_OK;
}

int bench_draw(int argc, char **argv) {
    session_options o;
    run r = {.options = &o};
    int code;
    if (!parse(argc, argv, &o, &r.pictures, &code))
        return code;
    json j;
    mn_status st = {0};
    if (bench_trees_are_there(argv + optind, argc - optind, &st) != MN_OK)
        return cli_status(&st);
    if (o.json) {
        json_begin(&j, stdout);
        json_open(&j, "runs", '[');
    }
    for (int i = optind; i < argc && st.code == MN_OK; i++)
        for (size_t k = 0; k < sizeof paths / sizeof paths[0] && st.code == MN_OK; k++) {
            figures f = {0};
            o.desc.path = argv[i];
            if (run_path(&r, paths[k], &f, &st) == MN_OK)
                report(o.json ? &j : NULL, &r, argv[i], paths[k], &f);
        }
    if (o.json) {
        json_close(&j, ']');
        json_end(&j);
    }
    return cli_status(&st);
}
