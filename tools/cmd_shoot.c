/* metanode shoot: one picture of a path, without a display. A session of its own settles at the
 * frame's camera from the roots, so the picture depends on file, camera and tolerance alone. */
#include <inttypes.h>
#include <stdio.h>

#include "json.h"
#include "picture.h"
#include "session_options.h"

static const char help[] =
    "usage: metanode shoot FILE -o OUT.png [--path P] [--frame N] [OPTION …]\n\n"
    "  -o FILE           the picture\n"
    "  --frame N         which frame of --path (orbit), from 0 (0)\n"
    "  --wireframe       edges over the surface\n"
    "  --lod-colors      by error: blue is fine, red is coarse\n"
    "  --flat            triangles shaded flat\n\n";

enum {
    SHOOT_FRAME = SESSION_OPTION_END,
    SHOOT_WIREFRAME,
    SHOOT_LOD_COLORS,
    SHOOT_FLAT,
    SETTLE_FRAMES_MAX = 20000, /* a front that has not settled by then is shown as it is */
};

typedef struct shoot {
    session_options session;
    const char *out;
    uint64_t frame;
    mn_gl_look look;
} shoot;

/* MN_OK with *done: help was asked for. */
static int read_options(shoot *s, int argc, char **argv, bool *done) {
    static const struct option options[] = {SESSION_OPTIONS,
                                            {"output", required_argument, NULL, 'o'},
                                            {"frame", required_argument, NULL, SHOOT_FRAME},
                                            {"wireframe", no_argument, NULL, SHOOT_WIREFRAME},
                                            {"lod-colors", no_argument, NULL, SHOOT_LOD_COLORS},
                                            {"flat", no_argument, NULL, SHOOT_FLAT},
                                            {"help", no_argument, NULL, 'h'},
                                            {0, 0, 0, 0}};
    int option, code = MN_OK;
    session_options_init(&s->session);
    while ((option = cli_option(argc, argv, SESSION_OPTIONS_SHORT "o:h", options)) != -1) {
        if (session_options_take(&s->session, argv[0], option, optarg, &code)) {
            if (code != MN_OK)
                return code;
            continue;
        }
        switch (option) {
        case 'o':
            s->out = optarg;
            break;
        case SHOOT_FRAME:
            if (!cli_u64(optarg, 0, UINT32_MAX, &s->frame))
                return cli_error(MN_USAGE, "shoot: --frame '%s' is no frame number", optarg);
            break;
        case SHOOT_WIREFRAME:
            s->look.wireframe = true;
            break;
        case SHOOT_LOD_COLORS:
            s->look.lod_colors = true;
            break;
        case SHOOT_FLAT:
            s->look.flat = true;
            break;
        case 'h':
            fputs(help, stdout);
            fputs(session_options_help, stdout);
            fputs(session_options_json_help, stdout);
            *done = true;
            return MN_OK;
        default:
            return MN_USAGE;
        }
    }
    if (s->out == NULL)
        return cli_error(MN_USAGE, "shoot: where to? give -o OUT.png");
    code = session_options_file(&s->session, argc, argv);
    if (code == MN_OK)
        code = session_options_output(&s->session, argv[0], s->out);
    if (code == MN_OK)
        code = cli_outputs_differ(argv[0], "-o", s->out, "--trace", s->session.desc.trace_path);
    if (code == MN_OK)
        code = cli_output_kind(argv[0], s->out, ".png");
    return code == MN_OK ? (int)cli_output_possible(s->out) : code;
}

/* Before the session, whose plan counts what the path takes. */
static mn_code frame_camera(shoot *s, mn_camera *out, mn_status *st) {
    mn_header header;
    mn_path *path = NULL;
    const char *name = s->session.path_name != NULL ? s->session.path_name : "orbit";
    if (mn_header_read(s->session.desc.path, &header, st) != MN_OK ||
        mn_path_open(name, &header, s->session.fov_y_deg, &path, st) != MN_OK)
        return st->code;
    s->session.desc.base_bytes = mn_path_bytes(path);
    uint32_t frames = s->session.frames;
    if (!s->session.frames_given && mn_path_frames(path) > 0)
        frames = mn_path_frames(path);
    if (s->frame >= frames)
        mn_fail(st, MN_USAGE, "shoot: --frame %" PRIu64 ": the path has frames 0 to %u", s->frame,
                frames - 1);
    else
        mn_path_camera(path, (uint32_t)s->frame, frames, out);
    mn_path_close(path);
    return st->code;
}

static void report(const shoot *s, const mn_session *session, const picture *p,
                   const mn_frame_stats *stats, uint32_t settle_frames) {
    if (!s->session.json) {
        printf("%s: %" PRIu64 " triangle%s, error %.3g px, %ssettled %s %u frame%s\n", s->out,
               stats->triangles, cli_s(stats->triangles), stats->error_px,
               stats->changed ? "not " : "", stats->changed ? "after" : "in", settle_frames,
               cli_s(settle_frames));
        return;
    }
    json j;
    mn_plan plan;
    mn_session_plan(session, &plan);
    json_begin(&j, stdout);
    json_str(&j, "picture", s->out);
    json_u64(&j, "width", s->session.desc.width_px);
    json_u64(&j, "height", s->session.desc.height_px);
    json_u64(&j, "frame", s->frame);
    json_u64(&j, "triangles", stats->triangles);
    json_u64(&j, "active_nodes", stats->active_nodes);
    json_f64(&j, "error_px", stats->error_px);
    json_f64(&j, "tolerance_px", stats->tolerance_px);
    json_u64(&j, "misses", stats->misses);
    json_u64(&j, "settle_frames", settle_frames);
    json_bool(&j, "settled", !stats->changed);
    json_cap(&j, "ram_cap_bytes", plan.ram_cap_bytes);
    json_u64(&j, "ram_planned_bytes", plan.planned_bytes);
    json_u64(&j, "rss_peak_bytes", p->load.own_peak_bytes);
    json_u64(&j, "gl_rss_bytes", p->load.rss_bytes);
    json_u64(&j, "gl_allocations", cli_alloc_theirs_since_mark());
    json_str(&j, "gl_driver", p->load.api->driver(p->gl));
    json_end(&j);
}

static mn_code take(const shoot *s, const mn_camera *camera, mn_session *session, picture *p,
                    mn_status *st) {
    const mn_session_desc *desc = &s->session.desc;
    mn_frame_stats stats;
    mn_code code = picture_open(p, session, desc->width_px, desc->height_px, false, st);
    if (code != MN_OK)
        return code;
    cli_alloc_mark();
    const uint32_t settle_frames = mn_session_settle(session, camera, SETTLE_FRAMES_MAX);
    mn_session_frame(session, camera, &stats);
    code = picture_draw(p, session, camera, &s->look, st);
    if (code == MN_OK)
        code = picture_png(p, s->out, st);
    if (code == MN_OK)
        report(s, session, p, &stats, settle_frames);
    return code;
}

int cmd_shoot(int argc, char **argv) {
    shoot s = {0};
    bool done = false;
    const int code = read_options(&s, argc, argv, &done);
    if (code != MN_OK || done)
        return code;
    mn_status st = {0};
    mn_session *session = NULL;
    picture p = {0};
    mn_camera camera;
    if (frame_camera(&s, &camera, &st) == MN_OK &&
        mn_session_open(&s.session.desc, &session, &st) == MN_OK)
        take(&s, &camera, session, &p, &st);
    picture_close(&p);
    (void)mn_session_end(session, &st);
    return cli_status(&st);
}
