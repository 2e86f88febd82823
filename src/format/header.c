/* The header page: what the whole file promises, checked field by field.
 *
 * Hides: the page's layout. Fields are checked before the checksum, so that damage is named by its
 * field where a field can show it; what is left is named by the checksum. No state; any thread;
 * mn_header_read blocks for one read. Paper: none. */
#include "header.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>
#include <xxhash.h>

#include "mn_assert.h"
#include "block.h"
#include "extents.h"
#include "file.h"

static const char magic[8] = {'M', 'N', 'T', 'R', 'E', 'E', '\r', '\n'};
enum { FLAG_COLORS = 1, FLAG_ZSTD = 2 };

/* Little-endian, no padding; docs/format.md. */
typedef struct page {
    char magic[8];
    uint32_t version, header_bytes;
    uint64_t checksum; /* XXH3-64 of the page with this field 0 */
    uint64_t build_id, file_bytes, triangles;
    uint32_t leaves, nodes, hinges, legal_last;
    uint32_t flags, metric, blocking, l;
    uint32_t block_bytes, block_bytes_max, blocks, block_depth;
    uint32_t overflow_max, depth_max, children_max, nodes_per_block_max;
    double fill_mean, origin[3];
    float box_min[3], box_max[3], dive_point[3], dive_normal[3];
    uint32_t roots;
    float grid_step;
    struct {
        uint32_t id, pages, subtree, color;
        float position[3];
    } root[MN_ROOTS_MAX];
    uint64_t stored_bytes, extents_checksum; /* these four 0 without FLAG_ZSTD */
    uint32_t extent_bytes_max, zstd_level;
    uint8_t rest[288]; /* zero */
} page;
_Static_assert(sizeof(page) == MN_PAGE_BYTES, "the header is one page");

static uint64_t checksum_of(const page *p) {
    page copy = *p;
    copy.checksum = 0;
    return XXH3_64bits(&copy, sizeof copy);
}

void mni_header_encode(const mn_header *h, void *out) {
    page p = {.version = MNI_MNT_VERSION,
              .header_bytes = MN_PAGE_BYTES,
              .build_id = h->build_id,
              .file_bytes = h->file_bytes,
              .triangles = h->triangles,
              .leaves = h->leaves,
              .nodes = h->nodes,
              .hinges = h->hinges,
              .legal_last = h->legal_last,
              .flags = (h->has_colors ? FLAG_COLORS : 0) | (h->zstd_level > 0 ? FLAG_ZSTD : 0),
              .metric = h->metric,
              .blocking = h->blocking,
              .l = h->l,
              .block_bytes = h->block_bytes,
              .block_bytes_max = h->block_bytes_max,
              .blocks = h->blocks,
              .block_depth = h->block_depth,
              .overflow_max = h->overflow_max,
              .depth_max = h->depth_max,
              .children_max = h->children_max,
              .nodes_per_block_max = h->nodes_per_block_max,
              .fill_mean = h->fill_mean,
              .roots = h->roots,
              .grid_step = h->grid_step,
              .stored_bytes = h->stored_bytes,
              .extents_checksum = h->extents_checksum,
              .extent_bytes_max = h->extent_bytes_max,
              .zstd_level = h->zstd_level};
    memcpy(p.magic, magic, sizeof magic);
    memcpy(p.origin, h->origin, sizeof p.origin);
    memcpy(p.box_min, h->box_min, sizeof p.box_min);
    memcpy(p.box_max, h->box_max, sizeof p.box_max);
    memcpy(p.dive_point, h->dive_point, sizeof p.dive_point);
    memcpy(p.dive_normal, h->dive_normal, sizeof p.dive_normal);
    MN_ASSERT(h->roots <= MN_ROOTS_MAX);
    for (uint32_t i = 0; i < h->roots; i++) {
        p.root[i].id = h->root[i].block.id;
        p.root[i].pages = h->root[i].block.pages;
        p.root[i].subtree = h->root[i].subtree;
        p.root[i].color = h->root[i].color;
        memcpy(p.root[i].position, h->root[i].position, sizeof p.root[i].position);
    }
    p.checksum = checksum_of(&p);
    memcpy(out, &p, sizeof p);
}

static bool finite_all(const float *v, int n) {
    for (int i = 0; i < n; i++)
        if (!isfinite(v[i]))
            return false;
    return true;
}

/* Stops at the first field that lies and names it. */
#define FIELD(condition, field, format, value)                                                     \
    do {                                                                                           \
        if (!(condition))                                                                          \
            return mn_fail(st, MN_BAD_INPUT,                                                       \
                           "%s: header: %s is %" format ", which cannot be; the file is damaged: " \
                           "build it again",                                                       \
                           name, field, value);                                                    \
    } while (0)

static mn_code check_counts(const mn_header *h, uint64_t file_bytes, const char *name,
                            mn_status *st) {
    const uint64_t whole_bytes = mni_stored_bytes(h);
    if (file_bytes < whole_bytes)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: is cut off: it has %" PRIu64 " bytes, file_bytes is %" PRIu64
                       "; copy it whole, or build it again",
                       name, file_bytes, whole_bytes);
    if (file_bytes > whole_bytes)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: file_bytes is %" PRIu64 ", the file has %" PRIu64
                       "; copy it again, or build it again",
                       name, whole_bytes, file_bytes);
    FIELD(file_bytes % MN_PAGE_BYTES == 0, "file_bytes", PRIu64, file_bytes);
    file_bytes = h->file_bytes;
    FIELD(file_bytes % MN_PAGE_BYTES == 0 && file_bytes / MN_PAGE_BYTES <= UINT32_MAX, "file_bytes",
          PRIu64, file_bytes);
    FIELD(h->leaves >= 2 && h->leaves <= (1u << 31), "leaves", PRIu32, h->leaves);
    FIELD(h->roots >= 1 && h->roots <= MN_ROOTS_MAX && h->roots < h->leaves, "roots", PRIu32,
          h->roots);
    FIELD(h->nodes == (uint32_t)(2ull * h->leaves - h->roots) && h->nodes > h->leaves, "nodes",
          PRIu32, h->nodes);
    /* distinct nodes and simplices take more than a byte each: no allocation for what cannot be */
    FIELD(h->nodes - h->leaves <= file_bytes, "leaves", PRIu32, h->leaves);
    FIELD(h->triangles < UINT32_MAX && h->triangles <= file_bytes, "triangles", PRIu64,
          h->triangles);
    FIELD(h->hinges <= file_bytes && h->triangles + h->hinges < UINT32_MAX, "hinges", PRIu32,
          h->hinges);
    FIELD(h->legal_last >= h->leaves - 1 && h->legal_last < h->nodes, "legal_last", PRIu32,
          h->legal_last);
    FIELD(h->depth_max >= 2 && h->depth_max <= h->leaves, "depth_max", PRIu32, h->depth_max);
    return MN_OK;
}

static mn_code check_blocks(const mn_header *h, const char *name, mn_status *st) {
    FIELD(h->metric == MN_METRIC_QEM || h->metric == MN_METRIC_LENGTH, "metric", PRIu32,
          (uint32_t)h->metric);
    bool levels = h->blocking == MN_BLOCKING_LEVELS;
    FIELD(levels || h->blocking == MN_BLOCKING_PACKED, "blocking", PRIu32, (uint32_t)h->blocking);
    FIELD(levels ? h->l >= 1 && h->l <= 16 : h->l == 0, "l", PRIu32, h->l);
    FIELD(levels ? h->block_bytes == 0
                 : h->block_bytes >= MN_PAGE_BYTES && h->block_bytes <= MNI_BLOCK_BYTES_MAX &&
                       h->block_bytes % MN_PAGE_BYTES == 0,
          "block_bytes", PRIu32, h->block_bytes);
    FIELD(h->block_bytes_max >= MN_PAGE_BYTES && h->block_bytes_max % MN_PAGE_BYTES == 0 &&
              h->block_bytes_max <= h->file_bytes - MN_PAGE_BYTES &&
              (levels || h->block_bytes_max <= h->block_bytes),
          "block_bytes_max", PRIu32, h->block_bytes_max);
    FIELD(h->blocks >= 1 && h->blocks <= h->file_bytes / MN_PAGE_BYTES - 1, "blocks", PRIu32,
          h->blocks);
    FIELD(h->block_depth >= 1 && h->block_depth <= h->blocks, "block_depth", PRIu32,
          h->block_depth);
    FIELD(h->overflow_max < h->blocks, "overflow_max", PRIu32, h->overflow_max);
    FIELD(h->children_max < h->blocks, "children_max", PRIu32, h->children_max);
    FIELD(h->nodes_per_block_max >= 1 && h->nodes_per_block_max <= h->nodes - h->leaves,
          "nodes_per_block_max", PRIu32, h->nodes_per_block_max);
    FIELD(h->fill_mean > 0 && h->fill_mean <= 1, "fill_mean", "g", h->fill_mean);
    return MN_OK;
}

/* A page of the table for each 8 MiB of blocks, and a sector for each block, are there: so a file
 * cannot make a reader take more memory than a few thousand times its own length. */
static mn_code check_extents(const mn_header *h, const char *name, mn_status *st) {
    if (h->zstd_level == 0)
        return MN_OK;
    FIELD(h->zstd_level <= MNI_ZSTD_LEVEL_MAX, "zstd_level", PRIu32, h->zstd_level);
    FIELD(h->extent_bytes_max >= MNI_SECTOR_BYTES && h->extent_bytes_max % MNI_SECTOR_BYTES == 0 &&
              h->extent_bytes_max <= h->block_bytes_max,
          "extent_bytes_max", PRIu32, h->extent_bytes_max);
    FIELD(h->stored_bytes >= mni_extents_begin(h->file_bytes / MN_PAGE_BYTES) +
                                 (uint64_t)h->blocks * MNI_SECTOR_BYTES,
          "stored_bytes", PRIu64, h->stored_bytes);
    return MN_OK;
}

static mn_code check_places(const mn_header *h, const char *name, mn_status *st) {
    FIELD(isfinite(h->origin[0]) && isfinite(h->origin[1]) && isfinite(h->origin[2]), "origin", "g",
          h->origin[0]);
    FIELD(mni_grid_ok(h->grid_step), "grid_step", "g", (double)h->grid_step);
    FIELD(finite_all(h->box_min, 3), "box_min", "g", (double)h->box_min[0]);
    bool ordered = true, inside = true;
    for (int i = 0; i < 3; i++) {
        ordered = ordered && h->box_min[i] <= h->box_max[i];
        inside = inside && h->dive_point[i] >= h->box_min[i] && h->dive_point[i] <= h->box_max[i];
    }
    FIELD(finite_all(h->box_max, 3) && ordered, "box_max", "g", (double)h->box_max[0]);
    FIELD(inside, "dive_point", "g", (double)h->dive_point[1]);
    const float *n = h->dive_normal;
    double length = sqrt((double)n[0] * n[0] + (double)n[1] * n[1] + (double)n[2] * n[2]);
    FIELD(length > 0.999 && length < 1.001, "dive_normal", "g", length);
    for (uint32_t i = 0; i < h->roots; i++) {
        const mn_root *r = &h->root[i];
        FIELD(r->block.id >= 1 && r->block.id < h->file_bytes / MN_PAGE_BYTES, "root.id", PRIu32,
              r->block.id);
        FIELD(r->block.pages >= 1 && r->block.pages <= h->block_bytes_max / MN_PAGE_BYTES &&
                  r->block.id + (uint64_t)r->block.pages <= h->file_bytes / MN_PAGE_BYTES,
              "root.pages", PRIu32, r->block.pages);
        FIELD(r->subtree < MN_ROOTS_MAX, "root.subtree", PRIu32, r->subtree);
        for (int k = 0; k < 3; k++)
            FIELD(r->position[k] >= h->box_min[k] && r->position[k] <= h->box_max[k],
                  "root.position", "g", (double)r->position[k]);
    }
    return MN_OK;
}

mn_code mni_header_check(const mn_header *h, uint64_t file_bytes, const char *name, mn_status *st) {
    mn_code code = check_counts(h, file_bytes, name, st);
    if (code == MN_OK)
        code = check_blocks(h, name, st);
    if (code == MN_OK)
        code = check_extents(h, name, st);
    return code == MN_OK ? check_places(h, name, st) : code;
}

static void fill(const page *p, mn_header *h) {
    *h = (mn_header){.version = p->version,
                     .build_id = p->build_id,
                     .file_bytes = p->file_bytes,
                     .triangles = p->triangles,
                     .leaves = p->leaves,
                     .nodes = p->nodes,
                     .hinges = p->hinges,
                     .legal_last = p->legal_last,
                     .has_colors = (p->flags & FLAG_COLORS) != 0,
                     .metric = (mn_metric)p->metric,
                     .blocking = (mn_blocking)p->blocking,
                     .l = p->l,
                     .block_bytes = p->block_bytes,
                     .block_bytes_max = p->block_bytes_max,
                     .blocks = p->blocks,
                     .block_depth = p->block_depth,
                     .overflow_max = p->overflow_max,
                     .depth_max = p->depth_max,
                     .children_max = p->children_max,
                     .nodes_per_block_max = p->nodes_per_block_max,
                     .fill_mean = p->fill_mean,
                     .roots = p->roots,
                     .grid_step = p->grid_step,
                     .zstd_level = p->zstd_level,
                     .extent_bytes_max = p->extent_bytes_max,
                     .stored_bytes = p->stored_bytes,
                     .extents_checksum = p->extents_checksum};
    memcpy(h->origin, p->origin, sizeof p->origin);
    memcpy(h->box_min, p->box_min, sizeof p->box_min);
    memcpy(h->box_max, p->box_max, sizeof p->box_max);
    memcpy(h->dive_point, p->dive_point, sizeof p->dive_point);
    memcpy(h->dive_normal, p->dive_normal, sizeof p->dive_normal);
    for (uint32_t i = 0; i < h->roots && i < MN_ROOTS_MAX; i++) {
        h->root[i] = (mn_root){.block = {p->root[i].id, p->root[i].pages},
                               .subtree = p->root[i].subtree,
                               .color = p->root[i].color};
        memcpy(h->root[i].position, p->root[i].position, sizeof h->root[i].position);
    }
}

static bool is_ours(const void *bytes) {
    return memcmp(bytes, magic, sizeof magic) == 0;
}

mn_code mni_header_decode(const void *bytes, uint64_t file_bytes, const char *name, mn_header *out,
                          mn_status *st) {
    page p;
    memcpy(&p, bytes, sizeof p);
    if (memcmp(p.magic, "MNVDT\0\r\n", sizeof magic) == 0)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: is a .vdt, not a .mnt yet: make one of it with metanode block %s -o "
                       "OUT.mnt",
                       name, name);
    if (!is_ours(bytes))
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: magic is not that of a .mnt; make one with metanode build, or "
                       "with metanode block from a .vdt",
                       name);
    if (p.version != MNI_MNT_VERSION)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: version is %u, this program reads %d; build the file again",
                       name, p.version, MNI_MNT_VERSION);
    FIELD(p.header_bytes == MN_PAGE_BYTES, "header_bytes", PRIu32, p.header_bytes);
    FIELD(p.flags <= (FLAG_COLORS | FLAG_ZSTD), "flags", PRIx32, p.flags);
    FIELD(((p.flags & FLAG_ZSTD) != 0) == (p.zstd_level != 0), "zstd_level", PRIu32, p.zstd_level);
    mn_header h;
    fill(&p, &h);
    mn_code code = mni_header_check(&h, file_bytes, name, st);
    if (code != MN_OK)
        return code;
    if (p.checksum != checksum_of(&p))
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: checksum does not match; the file is damaged: build it again",
                       name);
    *out = h;
    return MN_OK;
}

mn_code mn_header_read(const char *path, mn_header *out, mn_status *st) {
    memset(out, 0, sizeof *out);
    mni_in in;
    mn_code code = mni_in_open(&in, path, st);
    if (code != MN_OK)
        return code;
    unsigned char bytes[MN_PAGE_BYTES];
    int64_t have = mni_in_read(&in, 0, bytes, sizeof bytes);
    if (have < 0)
        code = mn_fail(st, MN_FAILED, "%s: cannot read: %s", path, strerror((int)-have));
    else if (have < (int64_t)sizeof magic || (have < (int64_t)sizeof bytes && is_ours(bytes)))
        code = mn_fail(st, MN_BAD_INPUT,
                       "%s: header: the file ends after %d bytes of %d; copy it whole, or make one "
                       "with metanode build",
                       path, (int)have, MN_PAGE_BYTES);
    else
        code = mni_header_decode(bytes, in.size_bytes, path, out, st);
    mni_in_close(&in);
    return code;
}
