/* metanode extract: a mesh out of a .mnt or .vdt. Thin over mn_extract_file. */
#include "cli.h"

#include <stdio.h>

#include "cap.h"
#include "host.h"
#include "json.h"
#include "metanode/build.h"
#include "temp.h"

static const char help[] =
    "usage: metanode extract FILE (--full | --triangles N | --error E) -o OUT.ply [--ram SIZE]\n"
    "       [--temp-dir DIR] [--json]\n\n"
    "Writes one level of detail of a .mnt or .vdt as a welded mesh, binary PLY.\n\n"
    "  --full          the input\n"
    "  --triangles N   the most detailed step of the simplification with at most N triangles\n"
    "  --error E       the coarsest front on which no node's switch value exceeds E, a length in\n"
    "                  model units\n"
    "  -o FILE         what stood there stays until the new one is whole\n"
    "  --ram SIZE      cap for the whole process: 6M and 3 bits a vertex, with --error 4 bits,\n"
    "                  at most. Default: half of the memory, or of what the cgroup allows\n"
    "  --temp-dir DIR  with --error: where a temporary file of 4 bytes a vertex goes, if the cap\n"
    "                  has no room for it (default: beside OUT.ply)\n"
    "  --json          figures as one JSON object\n";

static mn_code extract(const char *in, const char *out, const mn_extract_desc *desc, bool as_json,
                       mn_status *st) {
    mn_extract_result result;
    cli_meter meter = {0};
    mn_code code = mn_extract_file(in, desc, CLI_WATCH(&meter), out, &result, st);
    cli_progress_end(&meter);
    if (code == MN_OK && as_json) {
        json j;
        json_begin(&j, stdout);
        json_u64(&j, "vertices", result.vertices);
        json_u64(&j, "triangles", result.triangles);
        json_u64(&j, "file_bytes", cli_file_bytes(out));
        json_end(&j);
    } else if (code == MN_OK) {
        printf("%s: %u vertices, %u triangle%s\n", out, result.vertices, result.triangles,
               cli_s(result.triangles));
    }
    if (code == MN_OK && result.triangles == 0 && desc->what != MN_EXTRACT_FULL)
        fprintf(stderr, "metanode: warning: %s has no triangle: so far down none is left; %s\n",
                out,
                desc->what == MN_EXTRACT_ERROR ? "a smaller --error keeps some"
                                               : "more --triangles keep some");
    return code;
}

int cmd_extract(int argc, char **argv) {
    mn_extract_desc desc = {.ram_bytes = host_default_ram_bytes()};
    const char *out = NULL, *temp_dir = NULL;
    bool full = false, as_json = false, done;
    int by_count = 0, by_error = 0;
    const cli_flag flags[] = {
        CLI_SWITCH("full", &full),
        {.name = "triangles",
         .kind = CLI_IS_WHOLE,
         .to = &desc.triangles,
         .max = UINT64_MAX,
         .wants = "a whole number, such as 5000 or 5k",
         .given = &by_count},
        {.name = "error",
         .kind = CLI_IS_LENGTH,
         .to = &desc.error,
         .wants = "a length",
         .given = &by_error},
        CLI_OUTPUT(&out),
        CLI_SIZE("ram", &desc.ram_bytes, 1, UINT64_MAX, "a size like 64M"),
        CLI_TEXT("temp-dir", &temp_dir),
        CLI_SWITCH("json", &as_json),
        {0},
    };
    const mn_code code = cli_flags(argc, argv, flags, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    desc.what = by_count > 0   ? MN_EXTRACT_TRIANGLES
                : by_error > 0 ? MN_EXTRACT_ERROR
                               : MN_EXTRACT_FULL;
    if (optind + 1 != argc)
        return cli_error(MN_USAGE, "extract: one file, please; see metanode extract --help");
    if (full + (by_count > 0) + (by_error > 0) != 1)
        return cli_error(MN_USAGE, "extract: give one of --full, --triangles N, --error E");
    if (out == NULL)
        return cli_error(MN_USAGE, "extract: where to? give -o OUT.ply");
    if (cli_output("extract", out, argv[optind]) != MN_OK ||
        cli_output_kind("extract", out, ".ply") != MN_OK)
        return MN_USAGE;
    temp_files temp;
    mn_status st = {0};
    cap_keep(desc.ram_bytes);
    desc.temp_dir = temp.folder;
    if (temp_folder(&temp, out, temp_dir, &st) == MN_OK)
        extract(argv[optind], out, &desc, as_json, &st);
    return cli_status(&st);
}
