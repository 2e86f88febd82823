/* The options that replay, shoot and view share: which file, which path, which memory. Main thread
 * only.
 *
 *     session_options o;
 *     session_options_init(&o);
 *     static const struct option options[] = {SESSION_OPTIONS, …, {0, 0, 0, 0}};
 *     while ((found = cli_option(argc, argv, SESSION_OPTIONS_SHORT "h", options)) != -1)
 *         if (session_options_take(&o, argv[0], found, optarg, &code)) … code …
 *         else … one of the command's own …
 *     code = session_options_file(&o, argc, argv); */
#ifndef METANODE_SESSION_OPTIONS_H
#define METANODE_SESSION_OPTIONS_H

#include "cli.h"
#include "metanode/runtime.h"

typedef struct session_options {
    mn_session_desc desc;  /* what was not given stays 0, but for fps and size: 60, 1280 × 720 */
    const char *path_name; /* --path; NULL: not given */
    float fov_y_deg;       /* 45 */
    uint32_t frames;       /* 600 */
    bool frames_given;
    bool json, light;
    float light_factor; /* for desc.weights, if light */
} session_options;

/* What cli_option returns for them; letters are free for the commands. */
enum session_option {
    SESSION_PATH = 256,
    SESSION_RAM,
    SESSION_FRONT_MAX,
    SESSION_STORE,
    SESSION_TOLERANCE,
    SESSION_TRIANGLES_MAX,
    SESSION_SIZE,
    SESSION_FOV,
    SESSION_FRAMES,
    SESSION_FPS,
    SESSION_NAV_OPS,
    SESSION_FRUSTUM,
    SESSION_CONES,
    SESSION_SILHOUETTES,
    SESSION_LIGHT,
    SESSION_LIGHT_FACTOR,
    SESSION_DEGRADE,
    SESSION_IO,
    SESSION_PREFETCH,
    SESSION_IO_SERIAL,
    SESSION_SEED,
    SESSION_BARRIER,
    SESSION_TRACE,
    SESSION_JSON,
    SESSION_OPTION_END, /* first value for a command's own long options */
};

enum { SESSION_TIGHTER = 2 }; /* on silhouettes and for the light, when nothing else is said */

#define SESSION_OPTIONS_SHORT "K:"
#define SESSION_OPTIONS                                                                            \
    {"path", required_argument, NULL, SESSION_PATH},                                               \
        {"ram", required_argument, NULL, SESSION_RAM},                                             \
        {"front-max", required_argument, NULL, SESSION_FRONT_MAX},                                 \
        {"store", required_argument, NULL, SESSION_STORE},                                         \
        {"tolerance", required_argument, NULL, SESSION_TOLERANCE},                                 \
        {"triangles-max", required_argument, NULL, SESSION_TRIANGLES_MAX},                         \
        {"size", required_argument, NULL, SESSION_SIZE},                                           \
        {"fov", required_argument, NULL, SESSION_FOV},                                             \
        {"frames", required_argument, NULL, SESSION_FRAMES},                                       \
        {"fps", required_argument, NULL, SESSION_FPS},                                             \
        {"nav-ops", required_argument, NULL, SESSION_NAV_OPS},                                     \
        {"frustum", required_argument, NULL, SESSION_FRUSTUM},                                     \
        {"cones", required_argument, NULL, SESSION_CONES},                                         \
        {"silhouettes", required_argument, NULL, SESSION_SILHOUETTES},                             \
        {"light", required_argument, NULL, SESSION_LIGHT},                                         \
        {"light-factor", required_argument, NULL, SESSION_LIGHT_FACTOR},                           \
        {"degrade", required_argument, NULL, SESSION_DEGRADE},                                     \
        {"io", required_argument, NULL, SESSION_IO},                                               \
        {"prefetch", required_argument, NULL, SESSION_PREFETCH},                                   \
        {"trace", required_argument, NULL, SESSION_TRACE},                                         \
        {"io-serial", no_argument, NULL, SESSION_IO_SERIAL},                                       \
        {"seed", required_argument, NULL, SESSION_SEED},                                           \
        {"barrier", no_argument, NULL, SESSION_BARRIER}, {                                         \
        "json", no_argument, NULL, SESSION_JSON                                                    \
    }

/* Lines for --help, one an option; --json is for who prints figures. */
extern const char session_options_help[], session_options_json_help[];

void session_options_init(session_options *o);
/* What a session warns of, on standard error; for mn_session_desc.warn, which init has set to it.
 */
void session_options_warn(void *context, const char *text);
/* Is the option one of these? Then *code is MN_OK, or MN_USAGE when its value is no good, which has
 * been reported. */
bool session_options_take(session_options *o, const char *command, int option, const char *value,
                          int *code);
/* MN_USAGE, and said, where an output (NULL: none) would go over FILE or the path. */
int session_options_output(const session_options *o, const char *command, const char *out);
/* The one FILE after the options. MN_USAGE when there is none or more than one, or the trace would
 * go over it: reported. */
int session_options_file(session_options *o, int argc, char **argv);

#endif
