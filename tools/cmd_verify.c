/* metanode verify: is a .mnt or .vdt sound, and is it the mesh it was built from? Thin over
 * mn_verify. */
#include "cli.h"

#include <stdio.h>

#include "cap.h"
#include "host.h"
#include "json.h"
#include "metanode/build.h"
#include "temp.h"

static const char help[] =
    "usage: metanode verify FILE [--against IN] [--ram SIZE] [--temp-dir DIR] [--weld on|off] "
    "[--json]\n\n"
    "Reads the whole .mnt or .vdt: checksums, places, structure inside blocks and across\n"
    "them, and that the header counts what is there. Exit 3 and one line for the first thing\n"
    "that is wrong.\n\n"
    "  --against IN    full detail must be this mesh, triangle for triangle, each with its\n"
    "                  orientation, vertices within half a step of the file's grid; each hinge\n"
    "                  must be one of its edges\n"
    "  --weld on|off   as the file was built; without it, the one that gives as many vertices\n"
    "  --reader own|openmesh\n"
    "  --ram SIZE      cap for the whole process, whatever the file's size: 5M, with --against\n"
    "                  6M to 13M (10 million vertices), more where blocks are hundreds deep.\n"
    "                  Default: half of the memory, or of what the cgroup allows\n"
    "  --temp-dir DIR  with --against: where temporary files go (default: beside FILE)\n"
    "  --json          figures as one JSON object\n";

static const char *const reader_names[] = {"own", "openmesh", NULL};

static void report(const char *file, const char *against, const mn_verify_result *r, bool as_json) {
    if (!as_json) {
        printf("%s: sound: ", file);
        if (r->blocks != 0) /* a .vdt has none */
            printf("%llu block%s, ", (unsigned long long)r->blocks, cli_s(r->blocks));
        printf("%llu nodes, %llu triangle%s, %llu hinge%s%s\n", (unsigned long long)r->nodes,
               (unsigned long long)r->triangles, cli_s(r->triangles), (unsigned long long)r->hinges,
               cli_s(r->hinges), against != NULL ? "; full detail is the input" : "");
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
    mn_verify_desc desc = {.ram_bytes = host_default_ram_bytes()};
    const char *temp_dir = NULL;
    int weld = -1, reader = 0;
    bool as_json = false, done;
    const cli_flag flags[] = {
        CLI_TEXT("against", &desc.against),
        CLI_CHOICE("weld", &weld, cli_on_off, "on or off"),
        CLI_CHOICE("reader", &reader, reader_names, "own or openmesh"),
        CLI_SIZE("ram", &desc.ram_bytes, 1, UINT64_MAX, "a size like 64M"),
        CLI_TEXT("temp-dir", &temp_dir),
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
    temp_files temp;
    mn_verify_result result;
    mn_status st = {0};
    cap_keep(desc.ram_bytes);
    desc.either_weld = weld < 0;
    desc.read = (mn_read_desc){.weld = weld == MN_WELD_OFF ? MN_WELD_OFF : MN_WELD_ON,
                               .reader = (mn_reader)reader,
                               .progress = cli_progress,
                               .progress_context = &meter};
    code = temp_folder(&temp, file, temp_dir, &st);
    desc.temp_dir = temp.folder;
    if (code == MN_OK)
        code = mn_verify(file, &desc, &result, &st);
    cli_progress_end(&meter);
    if (code == MN_OK)
        report(file, desc.against, &result, as_json);
    return cli_status(&st);
}
