/* metanode verify: is a .mnt or .vdt sound, and is it the mesh it was built from? Thin over
 * mn_verify. */
#include "cli.h"

#include <stdio.h>

#include "host.h"
#include "json.h"
#include "metanode/build.h"

static const char help[] =
    "usage: metanode verify FILE [--against IN] [--ram SIZE] [--weld on|off] [--json]\n\n"
    "Reads the whole .mnt or .vdt: checksums, places, structure inside blocks and across them, "
    "and\n"
    "that the header counts what is there. Exit 3 and one line for the first thing that is "
    "wrong.\n\n"
    "  --against IN    full detail must be this mesh, triangle for triangle, each with its\n"
    "                  orientation, vertices within half a step of the file's grid; each hinge\n"
    "                  must be one of its edges\n"
    "  --weld on|off   as the file was built; without it, the one that gives as many vertices\n"
    "  --reader own|openmesh\n"
    "  --ram SIZE      cap for the whole process; a .mnt alone needs 5M for any size. A .vdt is\n"
    "                  held in memory, 120 bytes a vertex, and with --against both meshes and\n"
    "                  their edges, 430; where that does not fit it is refused. Default: half of\n"
    "                  the memory, or of what the cgroup allows\n"
    "  --json          figures as one JSON object\n";

static const char *const reader_names[] = {"own", "openmesh", NULL};

/* How many vertices the file holds; 0: it cannot be told, verify will say why. */
static uint64_t vertices_in(const char *path) {
    mn_header header;
    mn_status ignored = {0};
    return mn_header_read(path, &header, &ignored) == MN_OK ? header.leaves : 0;
}

static mn_code read_input(const char *file, const char *path, mn_read_desc *desc, int weld,
                          mn_mesh *mesh, mn_status *st) {
    desc->weld = weld == MN_WELD_OFF ? MN_WELD_OFF : MN_WELD_ON;
    mn_code code = mn_mesh_read(path, desc, mesh, st);
    uint64_t wanted = vertices_in(file);
    if (code != MN_OK || weld >= 0 || wanted == 0 || mesh->vertices == wanted)
        return code;
    mn_mesh apart;
    mn_status ignored = {0};
    desc->weld = MN_WELD_OFF;
    if (mn_mesh_read(path, desc, &apart, &ignored) != MN_OK)
        return MN_OK; /* the welded one will have to do */
    if (apart.vertices == wanted) {
        mn_mesh swap = *mesh;
        *mesh = apart;
        apart = swap;
    }
    mn_mesh_free(&apart);
    return MN_OK;
}

static void report(const char *file, const char *against, const mn_verify_result *r, bool as_json) {
    if (!as_json) {
        printf("%s: sound: ", file);
        if (r->blocks != 0) /* a .vdt has none */
            printf("%llu blocks, ", (unsigned long long)r->blocks);
        printf("%llu nodes, %llu triangles, %llu hinges%s\n", (unsigned long long)r->nodes,
               (unsigned long long)r->triangles, (unsigned long long)r->hinges,
               against != NULL ? "; full detail is the input" : "");
        if (r->merged_positions > 0)
            printf("  %llu of its positions fall together on the grid\n",
                   (unsigned long long)r->merged_positions);
        return;
    }
    json j;
    json_begin(&j, stdout);
    json_u64(&j, "blocks", r->blocks);
    json_u64(&j, "nodes", r->nodes);
    json_u64(&j, "simplices", r->simplices);
    json_u64(&j, "triangles", r->triangles);
    json_u64(&j, "hinges", r->hinges);
    if (against != NULL) {
        json_u64(&j, "matched_triangles", r->matched_triangles);
        json_u64(&j, "merged_positions", r->merged_positions);
    }
    json_end(&j);
}

int cmd_verify(int argc, char **argv) {
    const char *against = NULL;
    int weld = -1, reader = 0;
    uint64_t ram_bytes = host_default_ram_bytes();
    bool as_json = false, done;
    const cli_flag flags[] = {
        CLI_TEXT("against", &against),
        CLI_CHOICE("weld", &weld, cli_on_off, "on or off"),
        CLI_CHOICE("reader", &reader, reader_names, "own or openmesh"),
        CLI_SIZE("ram", &ram_bytes, 1, UINT64_MAX, "a size like 64M"),
        CLI_SWITCH("json", &as_json),
        {0},
    };
    mn_code code = cli_flags(argc, argv, flags, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (optind + 1 != argc)
        return cli_error(MN_USAGE, "verify: one file, please; see metanode verify --help");
    const char *file = argv[optind];
    cli_meter meter = {0};
    mn_read_desc desc = {.reader = (mn_reader)reader,
                         .ram_bytes = ram_bytes,
                         .progress = cli_progress,
                         .progress_context = &meter};
    mn_verify_result result;
    mn_mesh mesh;
    mn_status st = {0};
    if (against != NULL || mn_tree_is_vdt(file))
        code = mn_tree_fits(file, against != NULL ? MN_TREE_COMPARE : MN_TREE_LOAD, ram_bytes, &st);
    if (code == MN_OK && against != NULL)
        code = read_input(file, against, &desc, weld, &mesh, &st);
    if (code == MN_OK) {
        code = mn_verify(file, against != NULL ? &mesh : NULL, ram_bytes, CLI_WATCH(&meter),
                         &result, &st);
        if (against != NULL)
            mn_mesh_free(&mesh);
    }
    cli_progress_end(&meter);
    if (code == MN_OK)
        report(file, against, &result, as_json);
    return cli_status(&st);
}
