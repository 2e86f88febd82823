/* See build_steps.h. */
#include "build_steps.h"

#include <stdio.h>
#include <string.h>

#include "host.h"

static const char *const metric_names[] = {"qem", "length", NULL};      /* by mn_metric */
static const char *const blocking_names[] = {"packed", "levels", NULL}; /* by mn_blocking */
static const char *const weld_names[] = {"on", "off", NULL};            /* by mn_weld */
static const char *const reader_names[] = {"own", "openmesh", NULL};    /* by mn_reader */

enum { RAM = 256, METRIC, TEMP_DIR, WELD, READER, POSITION_BITS, BLOCKING, BLOCK_BYTES, JSON };

static mn_code bad(const build_steps *b, const char *option, const char *wants) {
    return cli_error(MN_USAGE, "%s: %s '%s' is not %s", b->command, option, optarg, wants);
}

static mn_code choose(const build_steps *b, const char *option, const char *const *names,
                      const char *wants, int *choice) {
    *choice = cli_choice(optarg, names);
    return *choice < 0 ? bad(b, option, wants) : MN_OK;
}

static mn_code simplify_option(build_steps *b, int option) {
    uint64_t threads, bits;
    int choice = 0;
    mn_code code = MN_OK;
    switch (option) {
    case RAM:
        return cli_size(optarg, &b->ram_bytes) ? MN_OK : bad(b, "--ram", "a size like 64M");
    case METRIC:
        code = choose(b, "--metric", metric_names, "qem or length", &choice);
        b->simplify.metric = (mn_metric)choice;
        return code;
    case WELD:
        code = choose(b, "--weld", weld_names, "on or off", &choice);
        b->read.weld = (mn_weld)choice;
        return code;
    case READER:
        code = choose(b, "--reader", reader_names, "own or openmesh", &choice);
        b->read.reader = (mn_reader)choice;
        return code;
    case POSITION_BITS:
        if (!cli_u64(optarg, MN_POSITION_BITS_MIN, MN_POSITION_BITS_MAX, &bits))
            return bad(b, "--position-bits", "in 8 … 23");
        b->position_bits = (uint32_t)bits;
        return MN_OK;
    case TEMP_DIR:
        b->simplify.temp_dir = optarg;
        return *optarg != '\0' ? MN_OK : bad(b, "--temp-dir", "a directory");
    default:
        if (!cli_u64(optarg, 1, 1024, &threads))
            return bad(b, "-j", "in 1 … 1024");
        b->simplify.threads = (uint32_t)threads;
        return MN_OK;
    }
}

static mn_code block_option(build_steps *b, int option) {
    uint64_t value;
    int choice = 0;
    mn_code code = MN_OK;
    switch (option) {
    case BLOCKING:
        code = choose(b, "--blocking", blocking_names, "packed or levels", &choice);
        b->block.blocking = (mn_blocking)choice;
        return code;
    case BLOCK_BYTES:
        if (!cli_size(optarg, &value) || value % MN_PAGE_BYTES != 0 || value > 1u << 20)
            return bad(b, "--block-bytes", "a multiple of 4096 up to 1M");
        b->block.block_bytes = (uint32_t)value;
        return MN_OK;
    default:
        if (!cli_u64(optarg, 1, 16, &value))
            return bad(b, "-L", "in 1 … 16");
        b->block.l = (uint32_t)value;
        return MN_OK;
    }
}

mn_code build_options(build_steps *b, int argc, char **argv, unsigned steps, const char *help,
                      bool *done) {
    static const struct option simplifies[] = {
        {"ram", required_argument, NULL, RAM},
        {"metric", required_argument, NULL, METRIC},
        {"weld", required_argument, NULL, WELD},
        {"reader", required_argument, NULL, READER},
        {"position-bits", required_argument, NULL, POSITION_BITS},
        {"temp-dir", required_argument, NULL, TEMP_DIR},
        {"jobs", required_argument, NULL, 'j'}};
    static const struct option blocks[] = {{"blocking", required_argument, NULL, BLOCKING},
                                           {"levels", required_argument, NULL, 'L'},
                                           {"block-bytes", required_argument, NULL, BLOCK_BYTES}};
    static const struct option both[] = {{"output", required_argument, NULL, 'o'},
                                         {"json", no_argument, NULL, JSON},
                                         {"help", no_argument, NULL, 'h'},
                                         {0}};
    struct option options[14];
    size_t n = 0;
    memset(b, 0, sizeof *b);
    b->command = argv[0];
    *done = false;
    if (steps & BUILD_SIMPLIFIES) {
        memcpy(options + n, simplifies, sizeof simplifies);
        n += sizeof simplifies / sizeof simplifies[0];
    }
    if (steps & BUILD_BLOCKS) {
        memcpy(options + n, blocks, sizeof blocks);
        n += sizeof blocks / sizeof blocks[0];
    }
    memcpy(options + n, both, sizeof both);
    const char *letters = steps == BUILD_BLOCKS  ? "o:L:h"
                          : steps & BUILD_BLOCKS ? "o:L:j:h"
                                                 : "o:j:h";
    int option;
    while ((option = cli_option(argc, argv, letters, options)) != -1) {
        mn_code code = MN_OK;
        if (option == 'h') {
            fputs(help, stdout);
            *done = true;
            return MN_OK;
        } else if (option == '?')
            code = MN_USAGE;
        else if (option == 'o')
            b->out = optarg;
        else if (option == JSON)
            b->json = true;
        else if (option == 'L' || option == BLOCKING || option == BLOCK_BYTES)
            code = block_option(b, option);
        else
            code = simplify_option(b, option);
        if (code != MN_OK)
            return code;
    }
    if (optind >= argc)
        return cli_error(MN_USAGE, "%s: which file? see metanode %s --help", b->command,
                         b->command);
    if (optind + 1 < argc)
        return cli_error(MN_USAGE, "%s: '%s' is one argument too many", b->command,
                         argv[optind + 1]);
    if (b->out == NULL)
        return cli_error(MN_USAGE, "%s: where to? give -o OUT", b->command);
    if (b->block.l != 0 && b->block.blocking != MN_BLOCKING_LEVELS)
        return cli_error(MN_USAGE, "%s: -L is for --blocking levels", b->command);
    if (b->block.block_bytes != 0 && b->block.blocking != MN_BLOCKING_PACKED)
        return cli_error(MN_USAGE, "%s: --block-bytes is for --blocking packed", b->command);
    b->in = argv[optind];
    if (cli_output(b->command, b->out, b->in) != MN_OK)
        return MN_USAGE;
    if (cli_output_possible(b->out) != MN_OK)
        return MN_FAILED;
    if (b->ram_bytes == 0)
        b->ram_bytes = host_default_ram_bytes();
    cli_interrupts_catch();
    return MN_OK;
}

/* ---- the steps ------------------------------------------------------------------------------ */

/* Temporary files lie beside the output, where there is to be room: /tmp may be memory. */
static void choose_temp_dir(build_steps *b) {
    const char *slash = strrchr(b->out, '/');
    size_t length = slash == NULL ? 0 : slash == b->out ? 1 : (size_t)(slash - b->out);
    if (b->simplify.temp_dir != NULL)
        return;
    b->simplify.temp_dir = ".";
    if (length > 0 && length < sizeof b->temp_dir) {
        memcpy(b->temp_dir, b->out, length);
        b->simplify.temp_dir = b->temp_dir;
    }
}

mn_code build_simplify(build_steps *b) {
    mn_mesh mesh;
    choose_temp_dir(b);
    if (b->simplify.threads == 0)
        b->simplify.threads = host_cpus("");
    b->read.ram_bytes = b->simplify.ram_bytes = b->ram_bytes;
    b->read.then_need_bytes = mn_simplify_need_bytes;
    b->read.progress = b->simplify.progress = cli_progress;
    b->read.progress_context = b->simplify.progress_context = &b->meter;
    mn_code code = mn_mesh_read(b->in, &b->read, &mesh, &b->st);
    if (code == MN_OK) {
        b->seconds_read = mesh.seconds_read;
        b->bytes_read = mesh.bytes_read;
        code = mn_mesh_quantise(&mesh, b->position_bits, &b->st);
        if (code == MN_OK)
            code = mn_simplify(&mesh, &b->simplify, &b->tree, &b->st);
        mn_mesh_free(&mesh);
    }
    cli_progress_end(&b->meter);
    return code;
}

mn_code build_block(build_steps *b) {
    b->block.progress = cli_progress;
    b->block.progress_context = &b->meter;
    mn_code code = mn_block_write(b->out, &b->tree, &b->block, &b->header, &b->blocked, &b->st);
    cli_progress_end(&b->meter);
    return code;
}

/* ---- the figures ---------------------------------------------------------------------------- */

const char *build_metric_name(mn_metric metric) {
    return metric_names[metric];
}

const char *build_blocking_name(mn_blocking blocking) {
    return blocking_names[blocking];
}

void build_json_tree(json *j, const mn_tree *t) {
    const mn_intake *in = &t->intake;
    const mn_build_counts *c = &t->counts;
    json_u64(j, "vertices", t->leaves);
    json_u64(j, "triangles", t->triangles);
    json_u64(j, "input_faces", in->input_faces);
    json_u64(j, "duplicate_faces", in->duplicate_faces);
    json_u64(j, "degenerate_faces", in->degenerate_faces);
    json_u64(j, "nonfinite_faces", in->nonfinite_faces);
    json_u64(j, "misoriented_faces", in->misoriented_faces);
    json_u64(j, "unused_vertices", in->unused_vertices);
    json_u64(j, "welded_vertices", in->welded_vertices);
    json_u64(j, "merged_positions", in->merged_positions);
    json_f64(j, "grid_step", (double)t->grid_step);
    json_u64(j, "nonmanifold_edges", c->nonmanifold_edges);
    json_u64(j, "boundary_edges", c->boundary_edges);
    json_u64(j, "components", c->components);
    json_u64(j, "roots", t->roots);
    json_u64(j, "nodes", (uint64_t)t->leaves + t->inner);
    json_u64(j, "hinges", t->simplices - t->triangles);
    json_open(j, "collapses_by_stage", '[');
    for (int i = 0; i < 4; i++)
        json_u64(j, NULL, c->collapses_by_stage[i]);
    json_close(j, ']');
    json_u64(j, "virtual_collapses", c->collapses_by_stage[3]);
    json_u64(j, "legal_last", t->legal_last);
    json_u64(j, "depth_max", t->depth_max);
}

static void report_json(const build_steps *b) {
    const mn_tree *t = &b->tree;
    const mn_header *h = &b->header;
    bool simplified = t->counts.seconds_simplify > 0, blocked = h->blocks > 0;
    json j;
    json_begin(&j, stdout);
    build_json_tree(&j, t);
    if (blocked) {
        json_u64(&j, "block_depth", h->block_depth);
        json_u64(&j, "blocks", h->blocks);
        json_f64(&j, "fill_mean", h->fill_mean);
    }
    json_u64(&j, "order_violations", t->counts.order_violations);
    json_u64(&j, "rounds", t->counts.rounds);
    if (simplified) {
        json_f64(&j, "collapses_per_second", t->inner / t->counts.seconds_simplify);
        json_f64(&j, "seconds_read", b->seconds_read);
        json_f64(&j, "seconds_simplify", t->counts.seconds_simplify);
    }
    if (blocked)
        json_f64(&j, "seconds_block", b->blocked.seconds_block);
    json_u64(&j, "bytes_read", b->bytes_read);
    json_u64(&j, "bytes_written", b->blocked.bytes_written);
    json_u64(&j, "file_bytes", b->blocked.bytes_written);
    json_f64(&j, "bytes_per_vertex", (double)b->blocked.bytes_written / t->leaves);
    json_u64(&j, "ram_cap_bytes", b->ram_bytes);
    json_u64(&j, "rss_peak_bytes", cli_rss_peak_bytes());
    if (blocked) {
        json_u64(&j, "l", h->l);
        json_u64(&j, "block_bytes", h->block_bytes);
    }
    json_str(&j, "metric", metric_names[t->metric]);
    if (blocked)
        json_str(&j, "blocking", blocking_names[h->blocking]);
    json_end(&j);
}

static void report_text(const build_steps *b) {
    const mn_tree *t = &b->tree;
    const mn_header *h = &b->header;
    printf("%s: %u vertices, %u triangles, %u hinges, depth %u\n", b->out, t->leaves, t->triangles,
           t->simplices - t->triangles, t->depth_max);
    const mn_intake *in = &t->intake;
    uint64_t rejected = in->duplicate_faces + in->degenerate_faces + in->nonfinite_faces;
    if (rejected > 0)
        printf("  rejected %llu faces: %llu duplicate, %llu degenerate, %llu not finite\n",
               (unsigned long long)rejected, (unsigned long long)in->duplicate_faces,
               (unsigned long long)in->degenerate_faces, (unsigned long long)in->nonfinite_faces);
    if (in->merged_positions > 0)
        printf("  %llu positions fall together with others\n",
               (unsigned long long)in->merged_positions);
    if (t->counts.seconds_simplify > 0)
        printf("  %u collapses in %.2f s (%.0f/s)\n", t->inner, t->counts.seconds_simplify,
               t->inner / t->counts.seconds_simplify);
    if (h->blocks > 0)
        printf("  %u blocks of up to %u bytes, filled %.0f %%, %u deep\n", h->blocks,
               h->block_bytes_max, 100 * h->fill_mean, h->block_depth);
    printf("  %llu bytes, %.1f a vertex\n", (unsigned long long)b->blocked.bytes_written,
           (double)b->blocked.bytes_written / t->leaves);
}

int build_report(build_steps *b) {
    cli_progress_end(&b->meter);
    if (b->st.code == MN_OK) {
        if (b->json)
            report_json(b);
        else
            report_text(b);
    }
    mn_tree_free(&b->tree);
    return cli_status(&b->st);
}
