/* See build_steps.h. Hidden here: the options' names, and the order of the steps. */
#include "build_steps.h"

#include <getopt.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "cap.h"
#include "host.h"

static const char *const metric_names[] = {"qem", "length", NULL};      /* by mn_metric */
static const char *const blocking_names[] = {"packed", "levels", NULL}; /* by mn_blocking */
static const char *const weld_names[] = {"on", "off", NULL};            /* by mn_weld */
static const char *const reader_names[] = {"own", "openmesh", NULL};    /* by mn_reader */

/* ---- options -------------------------------------------------------------------------------- */

enum { ZSTD_LEVEL = 3 }; /* of --zstd alone: zstd's own default */

/* As they stand on the command line. */
typedef struct words {
    const char *out, *temp_dir;
    uint64_t ram_bytes, work_bytes, position_bits, threads, levels, block_bytes, zstd_level;
    int metric, weld, reader, blocking;
    bool resume, at_once, json;
} words;

static mn_code read_words(words *w, int argc, char **argv, unsigned steps, const char *help,
                          bool *done) {
    const cli_flag simplifies[] = {
        CLI_CHOICE("metric", &w->metric, metric_names, "qem or length"),
        CLI_CHOICE("weld", &w->weld, weld_names, "on or off"),
        CLI_CHOICE("reader", &w->reader, reader_names, "own or openmesh"),
        CLI_WHOLE("position-bits", &w->position_bits, MN_POSITION_BITS_MIN, MN_POSITION_BITS_MAX,
                  "in 8 … 23"),
        CLI_SWITCH("resume", &w->resume),
        CLI_SIZE("work-ram", &w->work_bytes, 1, UINT64_MAX, "a size like 4M"),
    };
    const cli_flag blocks[] = {
        CLI_CHOICE("blocking", &w->blocking, blocking_names, "packed or levels"),
        CLI_SIZE("block-bytes", &w->block_bytes, MN_PAGE_BYTES, 1 << 20,
                 "a multiple of 4096 up to 1M"),
        {.name = "zstd",
         .kind = CLI_IS_WHOLE,
         .to = &w->zstd_level,
         .min = 1,
         .max = 22,
         .bare = ZSTD_LEVEL,
         .wants = "in 1 … 22"},
        {.name = "levels",
         .letter = 'L',
         .kind = CLI_IS_WHOLE,
         .to = &w->levels,
         .min = 1,
         .max = 16,
         .wants = "in 1 … 16"},
    };
    const cli_flag both[] = {
        CLI_OUTPUT(&w->out),
        CLI_SIZE("ram", &w->ram_bytes, 1, UINT64_MAX, "a size like 64M"),
        CLI_TEXT("temp-dir", &w->temp_dir),
        {.name = "jobs",
         .letter = 'j',
         .kind = CLI_IS_WHOLE,
         .to = &w->threads,
         .min = 1,
         .max = 1024,
         .wants = "in 1 … 1024"},
        CLI_SWITCH("json", &w->json),
    };
    cli_flag flags[CLI_FLAGS_MAX + 1] = {0};
    size_t n = 0;
    memcpy(flags, both, sizeof both);
    n += sizeof both / sizeof both[0];
    if (steps & BUILD_SIMPLIFIES) {
        memcpy(flags + n, simplifies, sizeof simplifies);
        n += sizeof simplifies / sizeof simplifies[0];
    }
    if (steps == BUILD_SIMPLIFIES)
        flags[n++] = (cli_flag)CLI_SWITCH("at-once", &w->at_once);
    if (steps & BUILD_BLOCKS)
        memcpy(flags + n, blocks, sizeof blocks);
    return cli_flags(argc, argv, flags, help, done);
}

/* What no single option can say. */
static mn_code check_words(const words *w, int argc, char **argv) {
    if (optind >= argc)
        return cli_error(MN_USAGE, "%s: which file? see metanode %s --help", argv[0], argv[0]);
    if (optind + 1 < argc)
        return cli_error(MN_USAGE, "%s: '%s' is one argument too many", argv[0], argv[optind + 1]);
    if (w->out == NULL)
        return cli_error(MN_USAGE, "%s: where to? give -o OUT", argv[0]);
    if (w->levels != 0 && w->blocking != MN_BLOCKING_LEVELS)
        return cli_error(MN_USAGE, "%s: -L is for --blocking levels", argv[0]);
    if (w->block_bytes != 0 && w->blocking != MN_BLOCKING_PACKED)
        return cli_error(MN_USAGE, "%s: --block-bytes is for --blocking packed", argv[0]);
    if (w->block_bytes % MN_PAGE_BYTES != 0)
        return cli_error(MN_USAGE, "%s: --block-bytes is not a multiple of 4096 up to 1M", argv[0]);
    if (w->at_once && (w->resume || w->ram_bytes != 0 || w->work_bytes != 0))
        return cli_error(
            MN_USAGE, "%s: --at-once has no --ram, no --work-ram and nothing to --resume", argv[0]);
    const char *ending = strcmp(argv[0], "simplify") == 0 ? ".vdt" : ".mnt";
    mn_code code = cli_output(argv[0], w->out, argv[optind]);
    if (code == MN_OK)
        code = cli_output_kind(argv[0], w->out, ending);
    return code == MN_OK ? cli_output_possible(w->out) : code;
}

/* Every step tells how far it is; whoever waits sees that, and disk is looked at meanwhile. */
static bool progress(void *context, const char *phase, uint64_t done, uint64_t total) {
    build_steps *b = context;
    temp_look(&b->temp);
    return cli_progress(&b->meter, phase, done, total);
}

/* The mesh has been read: what is needed is known better. */
static mn_code plan_disk(void *context, uint64_t bytes, mn_status *st) {
    build_steps *b = context;
    return temp_plan(&b->temp, bytes, b->out, st);
}

static void take_words(build_steps *b, const words *w) {
    b->out = w->out;
    b->json = w->json;
    b->resume = w->resume;
    b->at_once = w->at_once;
    b->ram_bytes = w->ram_bytes != 0 || w->at_once ? w->ram_bytes : host_default_ram_bytes();
    b->read = (mn_read_desc){.weld = (mn_weld)w->weld,
                             .reader = (mn_reader)w->reader,
                             .ram_bytes = b->ram_bytes,
                             .progress = progress,
                             .progress_context = b};
    b->simplify =
        (mn_simplify_desc){.metric = (mn_metric)w->metric,
                           .ram_bytes = b->ram_bytes,
                           .work_bytes = w->work_bytes,
                           .position_bits = (uint32_t)w->position_bits,
                           .threads = w->threads != 0 ? (uint32_t)w->threads : host_cpus(""),
                           .disk = plan_disk,
                           .progress = progress,
                           .progress_context = b};
    b->block = (mn_block_desc){.blocking = (mn_blocking)w->blocking,
                               .l = (uint32_t)w->levels,
                               .block_bytes = (uint32_t)w->block_bytes,
                               .zstd_level = (uint32_t)w->zstd_level,
                               .ram_bytes = b->ram_bytes,
                               .threads = b->simplify.threads,
                               .progress = progress,
                               .progress_context = b};
}

mn_code build_options(build_steps *b, int argc, char **argv, unsigned steps, const char *help,
                      bool *done) {
    words w = {0};
    *b = (build_steps){.command = argv[0]};
    mn_code code = read_words(&w, argc, argv, steps, help, done);
    if (code != MN_OK || *done)
        return code;
    code = check_words(&w, argc, argv);
    if (code != MN_OK)
        return code;
    b->in = argv[optind];
    b->blocks = (steps & BUILD_BLOCKS) != 0;
    take_words(b, &w);
    if (temp_place(&b->temp, b->out, w.temp_dir, w.resume, &b->st) != MN_OK)
        return (mn_code)cli_status(&b->st);
    b->simplify.temp_dir = b->temp.folder;
    cap_keep(b->ram_bytes);
    cli_interrupts_catch();
    return MN_OK;
}

/* ---- the steps ------------------------------------------------------------------------------ */

/* A build that was killed, and is begun again with another --temp-dir, has left a folder that
 * nobody would find again: it goes as it would from the same place, unless somebody is at work
 * there. */
static void clear_left(const build_steps *b, mn_work_desc desc) {
    mn_work *left;
    mn_status st = {0};
    desc.path = temp_left(&b->temp);
    desc.resume = false;
    if (desc.path != NULL && mn_work_open(&left, &desc, &st) == MN_OK)
        mn_work_close(left);
    else if (desc.path != NULL)
        fprintf(stderr, "metanode: warning: an earlier build's folder stays: %s\n", st.text);
}

/* Before anything is done: is there room for what it will take, and is the folder ours? */
static mn_code begin(build_steps *b) {
    uint64_t vertices, triangles;
    const mn_work_desc desc = {.path = b->temp.work,
                               .in = b->in,
                               .read = &b->read,
                               .simplify = &b->simplify,
                               .resume = b->resume};
    mn_code code = mn_mesh_expect(b->in, &vertices, &triangles, &b->st);
    if (code == MN_OK && b->blocks)
        code = mn_block_fits(b->in, &b->block, vertices, mn_vdt_ram_least(&b->simplify, vertices),
                             &b->st);
    if (code != MN_OK)
        return code;
    b->temp.planned_bytes = mn_vdt_temp_bytes(
        vertices, triangles, b->simplify.work_bytes != 0 ? b->simplify.work_bytes : b->ram_bytes);
    code = temp_check(&b->temp, b->out, &b->st);
    if (code == MN_OK) {
        temp_take(&b->temp);
        code = mn_work_open(&b->work, &desc, &b->st);
    }
    if (code == MN_OK) {
        clear_left(b, desc);
        temp_begin(&b->temp);
    }
    if (code == MN_OK && b->resume)
        fprintf(stderr, "metanode: %s\n", mn_work_note(b->work));
    return code;
}

/* The mesh and its tree in memory, without a bound, with which mn_simplify might choose cells. */
static mn_code make_at_once(build_steps *b) {
    mn_mesh mesh;
    mn_code code = mn_mesh_read(b->in, &b->read, &mesh, &b->st);
    if (code != MN_OK)
        return code;
    b->blocked.bytes_read = mesh.bytes_read;
    code = mn_mesh_quantise(&mesh, b->simplify.position_bits, &b->st);
    if (code == MN_OK)
        code = mn_simplify(&mesh, &b->simplify, &b->whole, &b->st);
    mn_mesh_free(&mesh);
    if (code == MN_OK)
        b->head = &b->whole;
    return code;
}

mn_code build_make(build_steps *b) {
    if (b->at_once)
        return make_at_once(b);
    mn_code code = begin(b);
    if (code == MN_OK)
        code = mn_vdt_make(b->in, &b->read, &b->simplify, b->work, &b->vdt, &b->st);
    if (code == MN_OK)
        b->head = mn_vdt_head(b->vdt);
    return code;
}

/* What a .mnt takes of the disk, and whether blocks fit: by what the header says. */
static mn_code begin_open(build_steps *b) {
    uint64_t vertices, triangles;
    mn_code code = mn_tree_expect(b->in, &vertices, &triangles, &b->st);
    if (code == MN_OK)
        code = mn_block_fits(b->in, &b->block, vertices, 0, &b->st);
    if (code != MN_OK || mn_tree_is_vdt(b->in))
        return code;
    b->temp.planned_bytes = mn_vdt_open_temp_bytes(vertices, triangles);
    return temp_check(&b->temp, b->out, &b->st);
}

mn_code build_open(build_steps *b) {
    const mn_watch watch = {progress, b};
    const mn_open_desc desc = {
        .ram_bytes = b->ram_bytes, .temp_dir = b->temp.folder, .watch = &watch};
    mn_code code = begin_open(b);
    if (code == MN_OK)
        code = mn_vdt_open(b->in, &desc, &b->vdt, &b->st);
    if (code != MN_OK)
        return code;
    b->head = mn_vdt_head(b->vdt);
    return MN_OK;
}

mn_code build_block(build_steps *b) {
    return mn_vdt_block(b->vdt, b->out, &b->block, &b->header, &b->blocked, &b->st);
}

mn_code build_write(build_steps *b) {
    const mn_watch watch = {progress, b};
    mn_code code = b->at_once ? mn_tree_write(b->out, &b->whole, &b->st)
                              : mn_vdt_write(b->vdt, b->out, &watch, &b->st);
    if (code != MN_OK)
        return code;
    b->blocked.bytes_written = cli_file_bytes(b->out);
    if (!b->at_once) /* a copy */
        b->blocked.bytes_read = b->blocked.bytes_written;
    return MN_OK;
}

/* The folder of finished phases goes, unless more disk or more memory is all that is missing: who
 * has it can go on. */
static void end_work(build_steps *b) {
    static const char *const phase_names[] = {"", "reading", "simplifying", "ordering"};
    const mn_phase done = mn_work_done(b->work);
    const bool full = b->st.code == MN_NO_SPACE;
    if (!full && b->st.code != MN_CAP_TOO_SMALL) {
        mn_work_close(b->work);
    } else if (mn_work_leave(b->work)) {
        mn_status left = b->st;
        b->st = (mn_status){0};
        mn_fail(&b->st, left.code, "%.350s; what %s has made is kept in %.150s%s --resume",
                left.text, phase_names[done], b->temp.work, full ? ": make room, then" : ", for");
    }
    b->work = NULL;
    temp_end(&b->temp);
}

int build_end(build_steps *b) {
    temp_look(&b->temp);
    cli_progress_end(&b->meter);
    if (b->st.code == MN_OK)
        build_report(b);
    mn_vdt_close(b->vdt);
    mn_tree_free(&b->whole);
    const bool had_work = b->work != NULL;
    end_work(b);
    return cli_status_with(&b->st, had_work ? ", no finished phase is kept" : "");
}

const char *build_metric_name(mn_metric metric) {
    return metric_names[metric];
}

const char *build_blocking_name(mn_blocking blocking) {
    return blocking_names[blocking];
}
