/* metanode trace: what a trace says, in words, as a table, or for a viewer of traces. See --help.
 *
 * Main thread only. Memory: by blocks, never by events. */
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "cli.h"
#include "output.h"
#include "trace_chrome.h"
#include "trace_report.h"

static const char help[] =
    "usage: metanode trace FILE [--to report|chrome|csv] [-o OUT] [OPTION …]\n\n"
    "What happened in a session: FILE is what --trace of replay, view or shoot has written.\n\n"
    "  --to report       in words (default): misses over time and by level, latencies, prefetch,\n"
    "                    working set, and what other numbers of place holders would have come to\n"
    "  --to chrome       JSON for ui.perfetto.dev or chrome://tracing\n"
    "  --to csv          a row an event\n"
    "  -o FILE           where to (default, and -: standard output)\n"
    "  --from-frame N    chrome and csv: from that frame on\n"
    "  --to-frame N      up to that one\n"
    "  --k N,N,…         report: pools of so many place holders\n"
    "  --cut             a file that ends before its end, as after a kill, is read as far as it "
    "is\n"
    "                    whole\n"
    "  --json            the report as one JSON object\n";

enum { REPORT = 0, CHROME, CSV };

typedef struct options {
    const char *in, *out, *sizes;
    int to;
    uint64_t from_frame, to_frame, size[REPORT_SIZES - 1];
    uint32_t size_count;
    bool cut, json;
} options;

/* "64,128,256". */
static bool read_sizes(options *o) {
    char text[32];
    for (const char *at = o->sizes; at != NULL;) {
        const char *comma = strchr(at, ',');
        const size_t length = comma != NULL ? (size_t)(comma - at) : strlen(at);
        if (length >= sizeof text || o->size_count == REPORT_SIZES - 1)
            return false;
        memcpy(text, at, length);
        text[length] = 0;
        if (!cli_u64(text, 1, UINT32_MAX - 1, &o->size[o->size_count++]))
            return false;
        at = comma != NULL ? comma + 1 : NULL;
    }
    return true;
}

static int parse(options *o, int argc, char **argv, bool *done) {
    static const char *const forms[] = {"report", "chrome", "csv", NULL};
    *o = (options){.to_frame = UINT32_MAX};
    const cli_flag flags[] = {
        CLI_CHOICE("to", &o->to, forms, "report, chrome or csv"),
        CLI_OUTPUT(&o->out),
        CLI_WHOLE("from-frame", &o->from_frame, 0, UINT32_MAX, "a frame's number"),
        CLI_WHOLE("to-frame", &o->to_frame, 0, UINT32_MAX, "a frame's number"),
        CLI_TEXT("k", &o->sizes),
        CLI_SWITCH("cut", &o->cut),
        CLI_SWITCH("json", &o->json),
        {0}};
    const mn_code code = cli_flags(argc, argv, flags, help, done);
    if (code != MN_OK || *done)
        return (int)code;
    if (optind + 1 != argc)
        return cli_error(MN_USAGE, "trace: one FILE, please; see metanode trace --help");
    o->in = argv[optind];
    if (o->from_frame > o->to_frame)
        return cli_error(MN_USAGE, "trace: --from-frame comes after --to-frame");
    if (o->json && o->to != REPORT)
        return cli_error(MN_USAGE, "trace: --json is the report's; --to chrome is JSON as it is");
    if (o->to == REPORT && (o->from_frame > 0 || o->to_frame < UINT32_MAX))
        return cli_error(MN_USAGE, "trace: the report is of all frames; --from-frame and "
                                   "--to-frame are for --to chrome and --to csv");
    if (o->sizes != NULL && o->to != REPORT)
        return cli_error(MN_USAGE, "trace: --k is the report's");
    if (!read_sizes(o))
        return cli_error(MN_USAGE, "trace: --k '%s': numbers of place holders, such as 64,128,256",
                         o->sizes);
    if (o->out != NULL && strcmp(o->out, "-") == 0)
        o->out = NULL;
    return (int)cli_output("trace", o->out, o->in);
}

/* Is there a frame from which to begin? */
static mn_code has_frame(mn_trace_file *file, const options *o, mn_status *st) {
    mn_trace_event e;
    mn_code code;
    uint32_t frames = 0;
    mn_trace_rewind(file);
    while (mn_trace_next(file, &e, &code, st)) {
        if (e.kind != MN_TRACE_FRAME_BEGIN)
            continue;
        if (e.a >= o->from_frame)
            return MN_OK;
        frames = e.a + 1;
    }
    return code != MN_OK
               ? code
               : mn_fail(st, MN_USAGE, "trace: --from-frame %" PRIu64 ": %s has %u frames",
                         o->from_frame, o->in, frames);
}

static mn_code csv(mn_trace_file *file, const options *o, FILE *out, mn_status *st) {
    mn_trace_event e;
    mn_code code;
    bool inside = o->from_frame == 0;
    fputs("ns,thread,event,what,a,b\n", out);
    mn_trace_rewind(file);
    while (mn_trace_next(file, &e, &code, st) && !ferror(out)) {
        if (e.kind == MN_TRACE_FRAME_BEGIN && e.a >= o->from_frame)
            inside = true;
        if (e.kind == MN_TRACE_FRAME_BEGIN && e.a > o->to_frame)
            break;
        if (inside)
            fprintf(out, "%" PRIu64 ",%s,%s,%s,%" PRIu32 ",%" PRIu32 "\n", e.ns,
                    trace_thread_names[e.thread], trace_kind_name(&e), trace_aux_name(&e), e.a,
                    e.b);
    }
    return code;
}

static mn_code report(mn_trace_file *file, const options *o, FILE *out, mn_status *st) {
    trace_report *r = malloc(sizeof *r);
    if (r == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a report");
    const mn_code code = trace_report_make(file, o->size, o->size_count, r, st);
    if (code == MN_OK && o->json)
        trace_report_json(r, out);
    else if (code == MN_OK)
        trace_report_text(r, out);
    trace_report_free(r);
    free(r);
    return code;
}

int cmd_trace(int argc, char **argv) {
    options o;
    bool done;
    const int usage = parse(&o, argc, argv, &done);
    if (usage != MN_OK || done)
        return usage;
    mn_status st = {0};
    mn_trace_file *file = NULL;
    output written = {0};
    mn_code code = mn_trace_open(o.in, o.cut, &file, &st);
    if (code == MN_OK && o.from_frame > 0)
        code = has_frame(file, &o, &st);
    if (code == MN_OK && o.out != NULL)
        code = output_open(&written, "trace:", o.out, &st);
    FILE *out = o.out != NULL ? written.file : stdout;
    if (code == MN_OK)
        code = o.to == CHROME
                   ? trace_chrome(file, (uint32_t)o.from_frame, (uint32_t)o.to_frame, out, &st)
               : o.to == CSV ? csv(file, &o, out, &st)
                             : report(file, &o, out, &st);
    if (code == MN_OK) /* at once, while errno is the write's */
        code = cli_written(out, "trace:", o.out != NULL ? o.out : "standard output", &st);
    (void)output_close(&written, code == MN_OK, &st);
    mn_trace_close(file);
    return cli_status(&st);
}
