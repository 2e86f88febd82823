/* See session_options.h. Hides how options' texts become an mn_session_desc. */
#include "session_options.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum {
    SIZE_MAX_PX = 16384, /* what drivers make at most */
    FACTOR_MAX = 1000,
};
#define FACTOR "on, off, or a factor from 1 to 1000"

const char session_options_help[] =
    "  --path P          orbit, dive, flyover, or a path file\n"
    "  --ram SIZE        cap of the whole process, such as 16M (also 16MB, 16MiB); default: none\n"
    "  -K N              place holders; min: as few as work\n"
    "  --front-max N     room for N active nodes; default: what --ram leaves\n"
    "  --store S         paged (default); mapped, by the operating system; resident, all read at "
    "the\n"
    "                    start: to compare, and in both the file itself is beside the cap\n"
    "  --tolerance PX    error on the screen that is let pass (1.0)\n"
    "  --triangles-max N  a target instead: the smallest tolerance for which so many are enough;\n"
    "                    with --tolerance: none smaller than that\n"
    "  --size WxH        picture in pixels (1280x720)\n"
    "  --fov DEG         vertical opening of the camera (45)\n"
    "  --frames N        frames of the whole path (600)\n"
    "  --fps F           frames a second; 0: as fast as can be (60)\n"
    "  --nav-ops N       splits and collapses a frame at most, but for a chain of forced splits\n"
    "                    that is longer, alone in its frame; 0: no limit (0)\n"
    "  --frustum F       tolerance × F outside the picture: on (16), off, or a number\n"
    "  --cones F         tolerance × F where all faces away: on (8), off, or a number\n"
    "  --silhouettes F   tolerance ÷ F on silhouettes, and by its share where the surface is\n"
    "                    tilted: off, on (2), or a number\n"
    "  --light L         tolerance ÷ F where the light on a node's normals differs: off, on (the\n"
    "                    picture's key light), or X,Y,Z, towards the light: right, up, back\n"
    "  --light-factor F  that F (2)\n"
    "  --degrade on|off  raise the tolerance where the mesh does not fit (on)\n"
    "  --io M            uring (default), pread, sim\n"
    "  --prefetch P      ahead: what the camera, extrapolated, will want (default);\n"
    "                    neighbours: of every block in use; off\n"
    "  --io-serial       all reads of a frame done, in order, before the next\n"
    "  --seed S          of the simulated disk (0)\n"
    "  --barrier         each frame's camera stands until nothing changes\n"
    "  --trace F         everything that happens, for metanode trace\n";
const char session_options_json_help[] = "  --json            figures as one JSON object\n";

void session_options_warn(void *context, const char *text) {
    (void)context;
    fprintf(stderr, "metanode: warning: %s\n", text);
}

void session_options_init(session_options *o) {
    *o = (session_options){.fov_y_deg = 45, .frames = 600, .light_factor = SESSION_TIGHTER};
    o->desc.fps = 60;
    o->desc.width_px = 1280;
    o->desc.height_px = 720;
    o->desc.warn = session_options_warn;
}

static bool take_size(session_options *o, const char *value) {
    unsigned width = 0, height = 0;
    char rest = 0;
    if (sscanf(value, "%5u%*1[xX]%5u%c", &width, &height, &rest) != 2)
        return false;
    o->desc.width_px = width;
    o->desc.height_px = height;
    return width >= 1 && height >= 1 && width <= SIZE_MAX_PX && height <= SIZE_MAX_PX;
}

static bool take_float(const char *value, double min, double max, float *out) {
    double v = 0;
    if (!cli_double(value, min, max, &v))
        return false;
    *out = (float)v;
    return true;
}

/* on: that factor; off: 1; or a number. */
static bool take_factor(const char *value, float on, float *out) {
    const int choice = cli_choice(value, cli_on_off);
    if (choice < 0)
        return take_float(value, 1, FACTOR_MAX, out);
    *out = choice == 0 ? on : 1;
    return true;
}

/* on: the picture's key light; off; or a direction. */
static bool take_light(session_options *o, const char *value) {
    const int choice = cli_choice(value, cli_on_off);
    float *from = o->desc.weights.light_from;
    char rest = 0;
    o->light = choice != 1;
    if (choice >= 0) {
        memset(from, 0, sizeof o->desc.weights.light_from);
        return true;
    }
    if (sscanf(value, "%f,%f,%f%c", &from[0], &from[1], &from[2], &rest) != 3)
        return false;
    const float length = sqrtf(from[0] * from[0] + from[1] * from[1] + from[2] * from[2]);
    return isfinite(length) && length > 0;
}

/* As take. */
static const char *take_weight(session_options *o, int option, const char *value) {
    mn_weights *weights = &o->desc.weights;
    switch (option) {
    case SESSION_FRUSTUM:
        return take_factor(value, 0, &weights->outside) ? NULL : "--frustum: " FACTOR;
    case SESSION_CONES:
        return take_factor(value, 0, &weights->away) ? NULL : "--cones: " FACTOR;
    case SESSION_SILHOUETTES:
        return take_factor(value, SESSION_TIGHTER, &weights->silhouette) ? NULL
                                                                         : "--silhouettes: " FACTOR;
    case SESSION_LIGHT:
        return take_light(o, value) ? NULL : "--light: on, off, or a direction such as -1,1,1";
    default:
        return take_float(value, 1, FACTOR_MAX, &o->light_factor) ? NULL
                                                                  : "--light-factor: in 1 … 1000";
    }
}

static bool take_choice(const char *value, const char *const *names, int *out) {
    *out = cli_choice(value, names);
    return *out >= 0;
}

static bool take_places(session_options *o, const char *value) {
    uint64_t k = 0;
    if (strcmp(value, "min") == 0) {
        o->desc.k = MN_K_MIN;
        return true;
    }
    if (!cli_u64(value, 1, UINT32_MAX, &k))
        return false;
    o->desc.k = (int64_t)k;
    return true;
}

/* As take, of what has names. */
static const char *take_named(session_options *o, int option, const char *value) {
    static const char *const stores[] = {"paged", "mapped", "resident", NULL};
    static const char *const prefetches[] = {"ahead", "neighbours", "off", NULL};
    static const char *const ios[] = {"uring", "pread", "sim", NULL};
    int choice = 0;
    switch (option) {
    case SESSION_STORE:
        if (!take_choice(value, stores, &choice))
            return "--store: paged, mapped or resident";
        o->desc.store = (mn_store_kind)choice;
        return NULL;
    case SESSION_DEGRADE:
        if (!take_choice(value, cli_on_off, &choice))
            return "--degrade: on or off";
        o->desc.degrade_off = choice == 1;
        return NULL;
    case SESSION_IO:
        if (!take_choice(value, ios, &choice))
            return "--io: uring, pread or sim";
        o->desc.io = (mn_io_kind)choice;
        return NULL;
    default:
        if (!take_choice(value, prefetches, &choice))
            return "--prefetch: ahead, neighbours or off";
        o->desc.prefetch = (mn_prefetch)choice;
        return NULL;
    }
}

/* What the value should have been; NULL: it was good. */
static const char *take(session_options *o, int option, const char *value) {
    uint64_t count = 0;
    switch (option) {
    case SESSION_PATH:
        o->path_name = value;
        return NULL;
    case SESSION_RAM:
        return cli_size(value, &o->desc.ram_bytes) ? NULL : "--ram: a size such as 16M or 1.5G";
    case 'K':
        return take_places(o, value) ? NULL : "-K: a number of place holders, or min";
    case SESSION_FRONT_MAX:
        if (!cli_u64(value, 1, UINT32_MAX, &count))
            return "--front-max: a number of active nodes";
        o->desc.front_max = (uint32_t)count;
        return NULL;
    case SESSION_STORE:
    case SESSION_DEGRADE:
    case SESSION_IO:
    case SESSION_PREFETCH:
        return take_named(o, option, value);
    case SESSION_TOLERANCE:
        return take_float(value, 1e-3, 1e6, &o->desc.tolerance_px)
                   ? NULL
                   : "--tolerance: in 0.001 … 1000000 pixels";
    case SESSION_TRIANGLES_MAX:
        return cli_u64(value, 1, UINT32_MAX, &o->desc.triangles_max)
                   ? NULL
                   : "--triangles-max: in 1 … 4294967295";
    case SESSION_SIZE:
        return take_size(o, value) ? NULL : "--size: such as 1280x720, up to 16384 each way";
    case SESSION_FOV:
        return take_float(value, 1, 170, &o->fov_y_deg) ? NULL : "--fov: in 1 … 170 degrees";
    case SESSION_FRAMES:
        if (!cli_u64(value, 1, 1000000000, &count))
            return "--frames: in 1 … 1000000000";
        o->frames = (uint32_t)count;
        o->frames_given = true;
        return NULL;
    case SESSION_FPS:
        return take_float(value, 0, 1e6, &o->desc.fps) ? NULL : "--fps: in 0 … 1000000";
    case SESSION_NAV_OPS:
        return cli_u64(value, 0, UINT64_MAX, &o->desc.nav_ops)
                   ? NULL
                   : "--nav-ops: a number, 0 for no limit";
    case SESSION_FRUSTUM:
    case SESSION_CONES:
    case SESSION_SILHOUETTES:
    case SESSION_LIGHT:
    case SESSION_LIGHT_FACTOR:
        return take_weight(o, option, value);
    case SESSION_TRACE:
        o->desc.trace_path = value;
        return NULL;
    case SESSION_SEED:
        return cli_u64(value, 0, UINT64_MAX, &o->desc.seed) ? NULL : "--seed: a number from 0";
    default: /* the switches */
        o->desc.io_serial |= option == SESSION_IO_SERIAL;
        o->desc.barrier |= option == SESSION_BARRIER;
        o->json |= option == SESSION_JSON;
        return NULL;
    }
}

bool session_options_take(session_options *o, const char *command, int option, const char *value,
                          int *code) {
    if (option != 'K' && (option < SESSION_PATH || option >= SESSION_OPTION_END))
        return false;
    const char *wanted = take(o, option, value);
    *code = MN_OK;
    if (wanted != NULL)
        *code = cli_error(MN_USAGE, "%s: %.*s '%s' is not %s", command, (int)strcspn(wanted, ":"),
                          wanted, value, wanted + strcspn(wanted, ":") + 2);
    return true;
}

int session_options_file(session_options *o, int argc, char **argv) {
    if (argc - optind != 1)
        return cli_error(MN_USAGE, "%s: one FILE, please; see metanode %s --help", argv[0],
                         argv[0]);
    if (o->desc.triangles_max > 0 && o->desc.degrade_off)
        return cli_error(MN_USAGE,
                         "%s: --triangles-max moves the tolerance, and --degrade off "
                         "keeps it: one of them",
                         argv[0]);
    o->desc.path = argv[optind];
    o->desc.weights.light = o->light ? o->light_factor : 1;
    return session_options_output(o, argv[0], o->desc.trace_path);
}

int session_options_output(const session_options *o, const char *command, const char *out) {
    mn_code code = cli_output(command, out, o->desc.path);
    return code == MN_OK ? cli_output(command, out, o->path_name) : code;
}
