/* The header of a .vdt. Hides: its bytes, and which of its fields may contradict each other.
 * No memory; one thread a file; reading blocks on the disk. Paper: none. */
#include "vdt_header.h"

#include <float.h>
#include <math.h>
#include <string.h>
#include <xxhash.h>

#include "block.h"

enum { VDT_VERSION = 3, FLAG_COLORS = 1 };
static const char magic[8] = {'M', 'N', 'V', 'D', 'T', 0, '\r', '\n'};
static const char *const section_name[MNI_SECTIONS] = {"rows", "simplices"};

/* Sections follow each other; the end of the last is the file's. */
static uint64_t place_sections(mni_vdt_header *h) {
    const uint64_t bytes[MNI_SECTIONS] = {h->leaves * (uint64_t)sizeof(mni_row),
                                          h->simplices * (uint64_t)sizeof(mni_row_simplex)};
    uint64_t at = sizeof *h;
    for (int i = 0; i < MNI_SECTIONS; i++) {
        h->section[i].offset = at;
        h->section[i].bytes = bytes[i];
        at += bytes[i];
    }
    return at;
}

/* A float ≥ 0 in 16 bits, never less. */
static uint16_t upper_half(float of) {
    uint32_t bits;
    memcpy(&bits, &of, sizeof bits);
    return (uint16_t)((bits + UINT16_MAX) >> 16);
}

static float whole_of(uint16_t upper_half) {
    uint32_t bits = (uint32_t)upper_half << 16;
    float of;
    memcpy(&of, &bits, sizeof of);
    return of < FLT_MAX ? of : FLT_MAX;
}

static uint64_t checksum_of(const mni_vdt_header *h) {
    mni_vdt_header copy = *h;
    copy.checksum = 0;
    return XXH3_64bits(&copy, sizeof copy);
}

void mni_vdt_header_make(mni_vdt_header *h, const mn_tree *t, bool has_colors,
                         const uint64_t sum[MNI_SECTIONS]) {
    const mn_intake *in = &t->intake;
    const mn_build_counts *c = &t->counts;
    memset(h, 0, sizeof *h);
    memcpy(h->magic, magic, sizeof magic);
    h->version = VDT_VERSION;
    h->header_bytes = sizeof *h;
    h->build_id = mni_build_id(t, has_colors, sum, NULL);
    h->leaves = t->leaves;
    h->inner = t->inner;
    h->simplices = t->simplices;
    h->triangles = t->triangles;
    h->roots = t->roots;
    h->legal_last = t->legal_last;
    h->depth_max = t->depth_max;
    h->metric = t->metric;
    h->flags = has_colors ? FLAG_COLORS : 0;
    h->grid_step = t->grid_step;
    memcpy(h->origin, t->origin, sizeof h->origin);
    uint64_t intake[8] = {in->input_faces,     in->duplicate_faces,   in->degenerate_faces,
                          in->nonfinite_faces, in->misoriented_faces, in->unused_vertices,
                          in->welded_vertices, in->merged_positions};
    uint64_t counts[8] = {c->nonmanifold_edges,
                          c->boundary_edges,
                          c->components,
                          c->collapses_by_stage[0],
                          c->collapses_by_stage[1],
                          c->collapses_by_stage[2],
                          c->collapses_by_stage[3],
                          c->order_violations | c->order_unknown << 32};
    h->rounds = (uint32_t)c->rounds;
    h->order_violation_worst = c->order_violation_worst;
    h->order_violation_bound = upper_half(c->order_violation_bound);
    memcpy(h->intake, intake, sizeof intake);
    memcpy(h->counts, counts, sizeof counts);
    h->file_bytes = place_sections(h);
    for (int i = 0; i < MNI_SECTIONS; i++)
        h->section[i].checksum = sum[i];
    h->checksum = checksum_of(h);
}

bool mni_vdt_header_has_colors(const mni_vdt_header *h) {
    return (h->flags & FLAG_COLORS) != 0;
}

/* ---- reading -------------------------------------------------------------------------------- */

#define FIELD(condition, what)                                                                     \
    do {                                                                                           \
        if (!(condition))                                                                          \
            return mn_fail(st, MN_BAD_INPUT,                                                       \
                           "%s: header: %s cannot be; the file is damaged: simplify again", path,  \
                           what);                                                                  \
    } while (0)

/* Everything that the counts say, before anything is allocated by them. */
static mn_code check(const mni_vdt_header *h, uint64_t size_bytes, const char *path,
                     mn_status *st) {
    FIELD(h->header_bytes == sizeof *h, "header_bytes");
    if (size_bytes < h->file_bytes)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: is cut off: it has %llu bytes, file_bytes is %llu; copy it whole, or "
                       "simplify again",
                       path, (unsigned long long)size_bytes, (unsigned long long)h->file_bytes);
    if (size_bytes > h->file_bytes)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: file_bytes is %llu, the file has %llu; copy it again, or "
                       "simplify again",
                       path, (unsigned long long)h->file_bytes, (unsigned long long)size_bytes);
    FIELD(h->leaves >= 1 && h->leaves <= 1u << 31, "leaves");
    FIELD(h->roots >= 1 && h->roots <= h->leaves, "roots");
    FIELD(h->inner == h->leaves - h->roots, "inner");
    FIELD(h->simplices < UINT32_MAX, "simplices");
    FIELD(h->triangles <= h->simplices, "triangles");
    FIELD(h->legal_last >= h->leaves - 1 && h->legal_last - (h->leaves - 1) <= h->inner,
          "legal_last");
    FIELD(h->depth_max >= 1 && h->depth_max - 1 <= h->inner, "depth_max");
    FIELD(h->metric == MN_METRIC_QEM || h->metric == MN_METRIC_LENGTH, "metric");
    FIELD(h->flags <= FLAG_COLORS, "flags");
    FIELD(h->order_violation_worst >= 0, "order_violation_worst");
    FIELD(h->order_violation_worst <= whole_of(h->order_violation_bound), "order_violation_bound");
    FIELD(h->grid_step == 0 || mni_grid_ok(h->grid_step), "grid_step");
    for (int i = 0; i < 3; i++)
        FIELD(isfinite(h->origin[i]), "origin");
    mni_vdt_header expected = *h;
    FIELD(place_sections(&expected) == size_bytes, "its counts (they need another file size)");
    for (int i = 0; i < MNI_SECTIONS; i++)
        FIELD(h->section[i].offset == expected.section[i].offset &&
                  h->section[i].bytes == expected.section[i].bytes,
              section_name[i]);
    FIELD(h->checksum == checksum_of(h), "checksum");
    return MN_OK;
}

static void take_facts(const mni_vdt_header *h, mn_tree *t) {
    const uint64_t *in = h->intake, *c = h->counts;
    *t = (mn_tree){.leaves = h->leaves,
                   .inner = h->inner,
                   .simplices = h->simplices,
                   .triangles = h->triangles,
                   .roots = h->roots,
                   .legal_last = h->legal_last,
                   .depth_max = h->depth_max,
                   .metric = (mn_metric)h->metric,
                   .grid_step = h->grid_step,
                   .intake = {in[0], in[1], in[2], in[3], in[4], in[5], in[6], in[7]},
                   .counts = {.nonmanifold_edges = c[0],
                              .boundary_edges = c[1],
                              .components = c[2],
                              .collapses_by_stage = {c[3], c[4], c[5], c[6]},
                              .order_violations = c[7] & UINT32_MAX,
                              .order_unknown = c[7] >> 32,
                              .order_violation_worst = h->order_violation_worst,
                              .order_violation_bound = whole_of(h->order_violation_bound),
                              .rounds = h->rounds}};
    memcpy(t->origin, h->origin, sizeof t->origin);
}

mn_code mni_vdt_read(const mni_in *in, const char *path, uint64_t offset, void *bytes,
                     uint64_t count, const char *what, mn_status *st) {
    int64_t got = mni_in_read(in, offset, bytes, count);
    if (got < 0)
        return mn_fail(st, MN_FAILED, "%s: %s: cannot read: %s", path, what, strerror((int)-got));
    if ((uint64_t)got != count)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: %s: the file ends after %llu of %llu bytes; copy it whole, or "
                       "simplify again",
                       path, what, (unsigned long long)got, (unsigned long long)count);
    return MN_OK;
}

mn_code mni_vdt_header_read(const mni_in *in, const char *path, mni_vdt_header *h, mn_tree *facts,
                            mn_status *st) {
    mn_code code = mni_vdt_read(in, path, 0, h, sizeof *h, "header", st);
    if (code != MN_OK)
        return code;
    if (memcmp(h->magic, magic, sizeof magic) != 0)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: magic is not that of a .vdt; make one with metanode simplify",
                       path);
    if (h->version != VDT_VERSION)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: version is %u, this program reads %d; simplify again", path,
                       h->version, VDT_VERSION);
    code = check(h, in->size_bytes, path, st);
    if (code != MN_OK)
        return code;
    take_facts(h, facts);
    const uint64_t sum[MNI_SECTIONS] = {h->section[0].checksum, h->section[1].checksum};
    if (mni_build_id(facts, mni_vdt_header_has_colors(h), sum, NULL) != h->build_id)
        return mn_fail(st, MN_BAD_INPUT, "%s: header: build_id is not that of the content", path);
    return MN_OK;
}

bool mn_tree_is_vdt(const char *path) {
    mni_in in;
    char first[sizeof magic] = {0};
    mn_status ignored = {0};
    if (mni_in_open(&in, path, &ignored) != MN_OK)
        return false;
    mni_in_read(&in, 0, first, sizeof first);
    mni_in_close(&in);
    return memcmp(first, magic, sizeof magic) == 0;
}
