/* Options of metanode tune: see tune.h. Hidden here: the lists, their defaults, their words. */
#include <libgen.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "tune.h"

#define DEFAULT_POLICY "levels,packed"
#define DEFAULT_BLOCK_BYTES "4K,8K,16K"
#define DEFAULT_LEVELS "3,5,8"
#define DEFAULT_PLACES "1/1,1/2,1/4,1/8,min"
#define DEFAULT_PATH "orbit,dive"
#define DEFAULT_PREFETCH "ahead,neighbours,off"
enum { DEFAULT_FRAMES = 100, DEFAULT_LIMIT_S = 120 };
#define LEAST 1e-6 /* milliseconds, pixels: nothing is done in none, and the grid has its share */

static const char help[] =
    "usage: metanode tune IN -o DIR [OPTION …]\n\n"
    "Which blocks, and how many of them in memory? Builds the tree of IN (a mesh; or a .vdt or "
    ".mnt\n"
    "as it is) once, cuts it in several ways, flies paths with each under several numbers of "
    "place\n"
    "holders, and leaves in DIR a table, plots and a page, report.html. Interrupted, or asked for\n"
    "more, the same command goes on from what stands in DIR.\n\n"
    "what is tried\n"
    "  --policy LIST         of levels, packed (both)\n"
    "  --levels LIST         L of levels, 1 … 16 (" DEFAULT_LEVELS ")\n"
    "  --block-bytes LIST    of packed: multiples of 4096 up to 1M (" DEFAULT_BLOCK_BYTES ")\n"
    "  --k LIST              place holders: a number, min, or a share such as 1/6: as many as "
    "hold\n"
    "                        that part of the smallest file's blocks, so that each layout gets "
    "the\n"
    "                        same memory (" DEFAULT_PLACES ")\n"
    "  --caps LIST           --ram of the replays, such as 16M,24M; without --k they say how many\n"
    "                        place holders there are\n"
    "  --path LIST           orbit, dive, flyover, path files (" DEFAULT_PATH ")\n"
    "  --prefetch LIST       the first everywhere, the others at the best setting\n"
    "                        (" DEFAULT_PREFETCH ")\n"
    "  --cross               every prefetch rule everywhere\n"
    "how it is flown\n"
    "  --frames N            of a path; default 100, of a path file those that it has\n"
    "  --fps F, --size WxH, --tolerance PX, --degrade on|off, --open O   as of replay, but "
    "degrading\n"
    "                        is off, and frames begin settled\n"
    "  --limit S             seconds that one replay may take (120), or it has failed\n"
    "what is best\n"
    "  --p99-ms MS           Navigate takes at most so long in 99 % of the frames\n"
    "  --error-px PX         error on the screen in 95 % of the frames\n"
    "  --miss-rate R         misses of all that was wanted: 0.01\n"
    "  --ram SIZE            peak of the process; without --caps also the cap of the replays\n"
    "  --minimize WHAT       error (default), misses, p99, ram; of what keeps to those on all "
    "paths\n"
    "  --want WORDS          the same in words: \"p99 under 4 ms at 24 MB\", and besides or "
    "instead "
    "of p99\n"
    "                        \"error under 3 px\", \"misses under 1 %\"\n"
    "  --clock auto|wall|cpu  times by the clock, or the processor's; auto (default): the "
    "processor's\n"
    "                        where others had a fifth of the processors\n"
    "the rest\n"
    "  --build-ram SIZE      cap of building and cutting\n"
    "  -j N                  threads of building, and files that are cut at a time (2 at most)\n"
    "  --fresh               forget what DIR holds\n"
    "  --json                figures as one JSON object\n";

static const char *const policies[] = {"packed", "levels", NULL};             /* by mn_blocking */
static const char *const prefetches[] = {"ahead", "neighbours", "off", NULL}; /* by mn_prefetch */
static const char *const objectives[] = {"error", "misses", "p99", "ram", NULL};
static const char *const opens[] = {"settled", "roots", NULL};
static const char *const clocks[] = {"auto", "wall", "cpu", NULL}; /* by tune_clock */

const char *tune_prefetch_name(mn_prefetch prefetch) {
    return prefetches[prefetch];
}

const char *tune_objective_name(tune_objective objective) {
    return objectives[objective];
}

/* ---- lists ----------------------------------------------------------------------------------- */

const char *tune_list(const char *text, bool (*take)(void *context, const char *word),
                      void *context) {
    const char *at = text;
    for (uint32_t count = 0; count < TUNE_LIST_MAX; count++) {
        char word[PATH_MAX];
        const size_t length = strcspn(at, ",");
        if (length == 0 || length >= sizeof word)
            return at;
        memcpy(word, at, length);
        word[length] = 0;
        if (!take(context, word))
            return at;
        if (at[length] == 0)
            return NULL;
        at += length + 1;
    }
    return at;
}

static bool add_number(uint32_t *list, uint32_t *count, uint64_t value) {
    for (uint32_t i = 0; i < *count; i++)
        if (list[i] == value)
            return false;
    list[(*count)++] = (uint32_t)value;
    return true;
}

static bool take_policy(void *context, const char *word) {
    tune_options *o = context;
    const int found = cli_choice(word, policies);
    for (uint32_t i = 0; i < o->policies && found >= 0; i++)
        if (o->policy[i] == (mn_blocking)found)
            return false;
    if (found >= 0)
        o->policy[o->policies++] = (mn_blocking)found;
    return found >= 0;
}

static bool take_levels(void *context, const char *word) {
    tune_options *o = context;
    uint64_t l;
    return cli_u64(word, 1, 16, &l) && add_number(o->levels, &o->levels_count, l);
}

static bool take_block_bytes(void *context, const char *word) {
    tune_options *o = context;
    uint64_t bytes;
    return cli_size(word, &bytes) && bytes % MN_PAGE_BYTES == 0 && bytes <= 1 << 20 &&
           add_number(o->block_bytes, &o->block_bytes_count, bytes);
}

bool tune_places_parse(const char *word, tune_places *out) {
    unsigned of = 0, all = 0;
    char rest = 0;
    uint64_t count = 0;
    *out = (tune_places){.kind = TUNE_COUNT};
    const size_t length = strlen(word);
    if (length >= sizeof out->text)
        return false;
    memcpy(out->text, word, length); /* the rest is 0 */
    if (strcmp(word, "min") == 0) {
        out->kind = TUNE_LEAST;
        return true;
    }
    if (sscanf(word, "%5u/%5u%c", &of, &all, &rest) == 2 && of >= 1 && all >= 1) {
        out->kind = TUNE_SHARE;
        out->value = (double)of / all;
        return true;
    }
    const bool counted = cli_u64(word, 1, UINT32_MAX, &count);
    out->value = (double)count;
    return counted;
}

static bool take_places(void *context, const char *word) {
    tune_options *o = context;
    for (uint32_t i = 0; i < o->places_count; i++)
        if (strcmp(o->places[i].text, word) == 0)
            return false;
    return tune_places_parse(word, &o->places[o->places_count++]);
}

static bool take_cap(void *context, const char *word) {
    tune_options *o = context;
    uint64_t bytes;
    if (!cli_size(word, &bytes))
        return false;
    for (uint32_t i = 0; i < o->caps; i++)
        if (o->cap[i] == bytes)
            return false;
    o->cap[o->caps++] = bytes;
    return true;
}

static bool take_prefetch(void *context, const char *word) {
    tune_options *o = context;
    const int found = cli_choice(word, prefetches);
    for (uint32_t i = 0; i < o->prefetches && found >= 0; i++)
        if (o->prefetch[i] == (mn_prefetch)found)
            return false;
    if (found >= 0)
        o->prefetch[o->prefetches++] = (mn_prefetch)found;
    return found >= 0;
}

static bool take_path(void *context, const char *word) {
    tune_options *o = context;
    for (uint32_t i = 0; i < o->paths; i++)
        if (strcmp(o->path[i].name, word) == 0)
            return false;
    tune_path *p = &o->path[o->paths++];
    snprintf(p->name, sizeof p->name, "%s", word); /* tune_list's words are no longer */
    const char *slash = strrchr(p->name, '/');
    p->label = slash != NULL ? slash + 1 : p->name;
    return strpbrk(p->label, "\"\n") == NULL;
}

/* ---- all of them ----------------------------------------------------------------------------- */

/* As they stand on the command line. */
typedef struct words {
    const char *policy, *levels, *block_bytes, *places, *caps, *path, *prefetch;
    const char *p99, *error, *misses, *ram, *want;
    uint64_t frames;
    int frames_given, objective, clock, open;
} words;

typedef struct list {
    const char *name, *text, *wants;
    bool (*take)(void *, const char *);
} list;

/* `bad` is where tune_list stopped: what would have been taken alone stands there twice. */
static mn_code say_list(const list *l, const char *bad) {
    const int length = (int)strcspn(bad, ",");
    uint32_t before = 0;
    char word[PATH_MAX];
    for (const char *at = l->text; at < bad; at++)
        before += *at == ',';
    snprintf(word, sizeof word, "%.*s", length, bad);
    tune_options *alone = calloc(1, sizeof *alone);
    const bool good = alone != NULL && length > 0 && l->take(alone, word);
    free(alone);
    if (before >= TUNE_LIST_MAX)
        return (mn_code)cli_error(MN_USAGE, "tune: --%s '%s': more than %d at a time", l->name,
                                  l->text, TUNE_LIST_MAX);
    if (good)
        return (mn_code)cli_error(MN_USAGE, "tune: --%s '%s': '%s' stands there twice", l->name,
                                  l->text, word);
    return (mn_code)cli_error(MN_USAGE, "tune: --%s '%s': '%s' is not %s", l->name, l->text, word,
                              l->wants);
}

static mn_code read_lists(tune_options *o, const words *w) {
    const list lists[] = {
        {"policy", w->policy, "levels or packed", take_policy},
        {"levels", w->levels, "in 1 … 16", take_levels},
        {"block-bytes", w->block_bytes, "a multiple of 4096 up to 1M", take_block_bytes},
        {"k", w->places, "a number, a share such as 1/6, or min", take_places},
        {"caps", w->caps, "a size such as 16M", take_cap},
        {"path", w->path, "a path", take_path},
        {"prefetch", w->prefetch, "ahead, neighbours or off", take_prefetch},
    };
    for (size_t i = 0; i < sizeof lists / sizeof lists[0]; i++) {
        const char *bad = lists[i].text != NULL ? tune_list(lists[i].text, lists[i].take, o) : NULL;
        if (bad != NULL)
            return say_list(&lists[i], bad);
    }
    return MN_OK;
}

/* least: no setting can keep to less. */
static mn_code read_bound(const char *name, const char *text, double least, double max,
                          double *bound) {
    *bound = INFINITY;
    if (text == NULL || cli_double(text, least, max, bound))
        return MN_OK;
    return (mn_code)cli_error(MN_USAGE, "tune: --%s '%s' is not in %g … %.0f", name, text, least,
                              max);
}

/* The bound that begins at `at`, once; its length, 0: it is none. */
static int take_bound(tune_want *want, const char *at) {
    static const double MEGABYTE = 1048576, SIZE_MAX_BYTES = 4.6e18;
    const struct {
        const char *what, *unit;
        double times, min, max, *bound;
    } bounds[] = {{"p99", "ms", 1, LEAST, 1e6, &want->p99_ms},
                  {"error", "px", 1, LEAST, 1e6, &want->error_px},
                  {"misses", "%", 0.01, 0, 1, &want->miss_rate},
                  {"at", "MB", MEGABYTE, 1, SIZE_MAX_BYTES, &want->ram_bytes},
                  {"at", "GB", 1024 * MEGABYTE, 1, SIZE_MAX_BYTES, &want->ram_bytes}};
    char what[8], unit[4];
    double value;
    int length = 0;
    if (sscanf(at, "%7[a-z0-9] under %lf %3[a-z%]%n", what, &value, unit, &length) != 3 &&
        sscanf(at, "%2[at] %lf %3[GMB]%n", what, &value, unit, &length) != 3)
        return 0;
    for (size_t i = 0; i < sizeof bounds / sizeof bounds[0]; i++) {
        if (strcmp(what, bounds[i].what) != 0 || strcmp(unit, bounds[i].unit) != 0)
            continue;
        const bool good = isinf(*bounds[i].bound) && value * bounds[i].times >= bounds[i].min &&
                          value * bounds[i].times <= bounds[i].max;
        *bounds[i].bound = value * bounds[i].times;
        return good ? length : 0;
    }
    return 0;
}

const char *tune_want_take(tune_want *want, const char *text) {
    const char *at = text;
    do {
        const int length = take_bound(want, at);
        if (length == 0)
            return at;
        at += length;
        at += strspn(at, ", ");
        at += strncmp(at, "and ", 4) == 0 ? 4 : 0;
    } while (*at != 0);
    return NULL;
}

static mn_code read_want(tune_options *o, const words *w) {
    uint64_t bytes = 0;
    o->want.objective = (tune_objective)w->objective;
    o->clock = (tune_clock)w->clock;
    o->want.cpu = o->clock == TUNE_CLOCK_CPU;
    mn_code code = read_bound("p99-ms", w->p99, LEAST, 1e6, &o->want.p99_ms);
    if (code == MN_OK)
        code = read_bound("error-px", w->error, LEAST, 1e6, &o->want.error_px);
    if (code == MN_OK)
        code = read_bound("miss-rate", w->misses, 0, 1, &o->want.miss_rate);
    if (code == MN_OK && w->ram != NULL && !cli_size(w->ram, &bytes))
        code = (mn_code)cli_error(MN_USAGE, "tune: --ram '%s' is not a size like 24M", w->ram);
    o->want.ram_bytes = w->ram != NULL ? (double)bytes : INFINITY;
    const char *bad = w->want != NULL ? tune_want_take(&o->want, w->want) : NULL;
    if (code == MN_OK && bad != NULL)
        code = (mn_code)cli_error(MN_USAGE,
                                  "tune: --want '%s': '%s' is not like p99 under 4 ms, error under "
                                  "3 px, misses under 1 %%, or at 24 MB, or is wanted twice",
                                  w->want, bad);
    o->caps_given = w->caps != NULL;
    if (code == MN_OK && isfinite(o->want.ram_bytes) && w->caps == NULL)
        o->cap[o->caps++] = (uint64_t)o->want.ram_bytes;
    return code;
}

/* What replay will refuse of those that are handed on, a hundred times, had better be said once. */
static mn_code check_handed_on(tune_options *o) {
    double fps = 60, tolerance = 1;
    unsigned width, height;
    char rest;
    if (o->fps != NULL && !cli_double(o->fps, 0, 1e6, &fps))
        return (mn_code)cli_error(MN_USAGE, "tune: --fps '%s' is not a number from 0 to 1000000",
                                  o->fps);
    if (o->tolerance != NULL && !cli_double(o->tolerance, 1e-3, 1e6, &tolerance))
        return (mn_code)cli_error(MN_USAGE, "tune: --tolerance '%s' is not in 0.001 … 1000000",
                                  o->tolerance);
    if (o->size != NULL && (sscanf(o->size, "%5u%*1[xX]%5u%c", &width, &height, &rest) != 2 ||
                            width < 1 || height < 1 || width > 16384 || height > 16384))
        return (mn_code)cli_error(MN_USAGE, "tune: --size '%s' is not like 1280x720", o->size);
    if (o->degrade != NULL && cli_choice(o->degrade, cli_on_off) < 0)
        return (mn_code)cli_error(MN_USAGE, "tune: --degrade '%s' is not on or off", o->degrade);
    o->fps = o->fps != NULL ? o->fps : "60";
    o->size = o->size != NULL ? o->size : "1280x720";
    o->tolerance = o->tolerance != NULL ? o->tolerance : "1";
    o->degrade = o->degrade != NULL ? o->degrade : "off";
    o->seconds_a_frame = fps > 0 ? 1 / fps : 0;
    return MN_OK;
}

static mn_code check_file(tune_options *o, int argc, char **argv) {
    if (argc - optind != 1)
        return (mn_code)cli_error(MN_USAGE, "tune: one mesh, please; see metanode tune --help");
    if (o->folder == NULL)
        return (mn_code)cli_error(MN_USAGE, "tune: where to? give -o DIR");
    o->in = argv[optind];
    return MN_OK;
}

static mn_code read_words(tune_options *o, words *w, int argc, char **argv, bool *done) {
    const cli_flag flags[] = {
        CLI_OUTPUT(&o->folder),
        CLI_TEXT("policy", &w->policy),
        CLI_TEXT("levels", &w->levels),
        CLI_TEXT("block-bytes", &w->block_bytes),
        CLI_TEXT("k", &w->places),
        CLI_TEXT("caps", &w->caps),
        CLI_TEXT("path", &w->path),
        CLI_TEXT("prefetch", &w->prefetch),
        CLI_SWITCH("cross", &o->cross),
        {.name = "frames",
         .kind = CLI_IS_WHOLE,
         .to = &w->frames,
         .min = 1,
         .max = 1000000,
         .wants = "in 1 … 1000000",
         .given = &w->frames_given},
        CLI_TEXT("fps", &o->fps),
        CLI_TEXT("size", &o->size),
        CLI_TEXT("tolerance", &o->tolerance),
        CLI_TEXT("degrade", &o->degrade),
        CLI_CHOICE("open", &w->open, opens, "settled or roots"),
        CLI_WHOLE("limit", &o->limit_s, 1, 1000000, "in 1 … 1000000"),
        CLI_TEXT("p99-ms", &w->p99),
        CLI_TEXT("error-px", &w->error),
        CLI_TEXT("miss-rate", &w->misses),
        CLI_TEXT("ram", &w->ram),
        CLI_TEXT("want", &w->want),
        CLI_CHOICE("minimize", &w->objective, objectives, "error, misses, p99 or ram"),
        CLI_CHOICE("clock", &w->clock, clocks, "auto, wall or cpu"),
        CLI_SIZE("build-ram", &o->build_ram_bytes, 1, UINT64_MAX, "a size like 64M"),
        {.name = "jobs",
         .letter = 'j',
         .kind = CLI_IS_WHOLE,
         .to = &o->jobs,
         .min = 1,
         .max = 1024,
         .wants = "in 1 … 1024"},
        CLI_SWITCH("fresh", &o->fresh),
        CLI_SWITCH("json", &o->json),
        {.name = NULL},
    };
    return cli_flags(argc, argv, flags, help, done);
}

mn_code tune_options_read(tune_options *o, int argc, char **argv, bool *done) {
    words w = {.policy = DEFAULT_POLICY,
               .levels = DEFAULT_LEVELS,
               .block_bytes = DEFAULT_BLOCK_BYTES,
               .path = DEFAULT_PATH,
               .prefetch = DEFAULT_PREFETCH,
               .frames = DEFAULT_FRAMES};
    *o = (tune_options){.argc = argc, .argv = argv, .limit_s = DEFAULT_LIMIT_S};
    mn_code code = read_words(o, &w, argc, argv, done);
    if (code != MN_OK || *done)
        return code;
    if (w.places == NULL && w.caps == NULL)
        w.places = DEFAULT_PLACES;
    o->frames = (uint32_t)w.frames;
    o->frames_given = w.frames_given > 0;
    o->open = opens[w.open];
    code = check_file(o, argc, argv);
    if (code == MN_OK)
        code = read_lists(o, &w);
    if (code == MN_OK)
        code = read_want(o, &w);
    if (code == MN_OK)
        code = check_handed_on(o);
    if (o->caps == 0)
        o->cap[o->caps++] = 0;
    if (o->places_count == 0)
        o->places[o->places_count++] = (tune_places){.kind = TUNE_FROM_CAP, .text = "cap"};
    return code;
}
