/* metanode info: what a .mnt or .vdt says of itself. Thin over mn_header_read and mn_vdt_open. */
#include "build_steps.h"

#include <stdio.h>
#include <string.h>

#include "json.h"

static const char help[] =
    "usage: metanode info FILE [--json]\n\n"
    "What a .mnt says in its header (one read, however large the file), or "
    "a .vdt, all of which is\n"
    "read and compared with its checksums.\n\n"
    "  --json          one JSON object; docs/figures.md says what the keys mean\n";

static void json_vector(json *j, const char *key, const double *v) {
    json_open(j, key, '[');
    for (int i = 0; i < 3; i++)
        json_f64(j, NULL, v[i]);
    json_close(j, ']');
}

static void json_floats(json *j, const char *key, const float *v) {
    json_vector(j, key, (double[3]){v[0], v[1], v[2]});
}

static uint64_t disk_bytes(const mn_header *h) {
    return h->zstd_level > 0 ? h->stored_bytes : h->file_bytes;
}

static void header_json(const mn_header *h) {
    char id[24];
    json j;
    snprintf(id, sizeof id, "%016llx", (unsigned long long)h->build_id);
    json_begin(&j, stdout);
    json_str(&j, "kind", "mnt");
    json_u64(&j, "version", h->version);
    json_str(&j, "build_id", id);
    json_u64(&j, "vertices", h->leaves);
    json_u64(&j, "triangles", h->triangles);
    json_u64(&j, "hinges", h->hinges);
    json_u64(&j, "nodes", h->nodes);
    json_u64(&j, "roots", h->roots);
    json_u64(&j, "legal_last", h->legal_last);
    json_u64(&j, "depth_max", h->depth_max);
    json_u64(&j, "block_depth", h->block_depth);
    json_u64(&j, "blocks", h->blocks);
    json_f64(&j, "fill_mean", h->fill_mean);
    json_u64(&j, "block_bytes_max", h->block_bytes_max);
    json_u64(&j, "overflow_max", h->overflow_max);
    json_u64(&j, "children_max", h->children_max);
    json_u64(&j, "nodes_per_block_max", h->nodes_per_block_max);
    json_u64(&j, "file_bytes", disk_bytes(h));
    json_f64(&j, "bytes_per_vertex", (double)disk_bytes(h) / h->leaves);
    json_u64(&j, "zstd_level", h->zstd_level);
    json_u64(&j, "blocks_bytes", h->file_bytes);
    json_u64(&j, "l", h->l);
    json_u64(&j, "block_bytes", h->block_bytes);
    json_str(&j, "metric", build_metric_name(h->metric));
    json_str(&j, "blocking", build_blocking_name(h->blocking));
    json_bool(&j, "colors", h->has_colors);
    json_vector(&j, "origin", h->origin);
    json_f64(&j, "grid_step", (double)h->grid_step);
    json_floats(&j, "box_min", h->box_min);
    json_floats(&j, "box_max", h->box_max);
    json_floats(&j, "dive_point", h->dive_point);
    json_floats(&j, "dive_normal", h->dive_normal);
    json_end(&j);
}

static void header_text(const char *file, const mn_header *h) {
    printf("%s: .mnt version %u, build %016llx\n", file, h->version,
           (unsigned long long)h->build_id);
    printf("  %u vertices%s, %llu triangle%s, %u hinge%s, %u root%s, %u levels, metric %s\n",
           h->leaves, h->has_colors ? " with colours" : "", (unsigned long long)h->triangles,
           cli_s(h->triangles), h->hinges, cli_s(h->hinges), h->roots, cli_s(h->roots),
           h->depth_max, build_metric_name(h->metric));
    printf("  %u block%s (%s", h->blocks, cli_s(h->blocks), build_blocking_name(h->blocking));
    if (h->blocking == MN_BLOCKING_LEVELS)
        printf(", %u levels", h->l);
    printf("), the longest %u bytes, filled %.1f %%, %u deep, up to %u node%s and %u child%s\n",
           h->block_bytes_max, 100 * h->fill_mean, h->block_depth, h->nodes_per_block_max,
           cli_s(h->nodes_per_block_max), h->children_max, h->children_max == 1 ? "" : "ren");
    printf("  box (%g %g %g) to (%g %g %g) about (%.9g %.9g %.9g)\n", h->box_min[0], h->box_min[1],
           h->box_min[2], h->box_max[0], h->box_max[1], h->box_max[2], h->origin[0], h->origin[1],
           h->origin[2]);
    printf("  grid of %g: no point further off than %g\n", (double)h->grid_step,
           (double)mn_grid_error(h->grid_step));
    printf("  %llu bytes, %.1f a vertex\n", (unsigned long long)disk_bytes(h),
           (double)disk_bytes(h) / h->leaves);
    if (h->zstd_level > 0)
        printf("  compressed, zstd level %u: %.1f %% of %llu bytes; the longest block to %u\n",
               h->zstd_level, 100.0 * (double)disk_bytes(h) / (double)h->file_bytes,
               (unsigned long long)h->file_bytes, h->extent_bytes_max);
}

static mn_code info_vdt(const char *file, bool as_json, mn_status *st) {
    mn_vdt *vdt;
    mn_code code = mn_vdt_open(file, NULL, &vdt, st);
    if (code != MN_OK)
        return code;
    const mn_tree *t = mn_vdt_head(vdt);
    if (as_json) {
        json j;
        json_begin(&j, stdout);
        json_str(&j, "kind", "vdt");
        build_json_tree(&j, t);
        json_u64(&j, "file_bytes", cli_file_bytes(file));
        json_str(&j, "metric", build_metric_name(t->metric));
        json_bool(&j, "colors", mn_vdt_has_colors(vdt));
        json_end(&j);
    } else {
        const uint32_t hinges = t->simplices - t->triangles;
        printf("%s: .vdt: %u vertices%s, %u triangle%s, %u hinge%s, %u root%s, %u levels, metric "
               "%s\n",
               file, t->leaves, mn_vdt_has_colors(vdt) ? " with colours" : "", t->triangles,
               cli_s(t->triangles), hinges, cli_s(hinges), t->roots, cli_s(t->roots), t->depth_max,
               build_metric_name(t->metric));
    }
    mn_vdt_close(vdt);
    return MN_OK;
}

int cmd_info(int argc, char **argv) {
    bool as_json = false, done;
    const cli_flag flags[] = {CLI_SWITCH("json", &as_json), {0}};
    const mn_code code = cli_flags(argc, argv, flags, help, &done);
    if (code != MN_OK || done)
        return (int)code;
    if (optind + 1 != argc)
        return cli_error(MN_USAGE, "info: one file, please; see metanode info --help");
    const char *file = argv[optind];
    mn_status st = {0};
    mn_header header;
    if (mn_tree_is_vdt(file))
        info_vdt(file, as_json, &st);
    else if (mn_header_read(file, &header, &st) == MN_OK) {
        if (as_json)
            header_json(&header);
        else
            header_text(file, &header);
    }
    return cli_status(&st);
}
