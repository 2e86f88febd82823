/* .vdt files: a simplified tree, kept so that another blocking needs no new simplification.
 *
 * Hides: the file's layout: a header and one section an array, each with its checksum
 * (docs/format.md). Intervals, roots and depths are not in the file: they follow from the children,
 * so they cannot lie. Times are not either: the same input gives the same bytes. Order:
 * mn_tree_write, mn_tree_read alone. One thread; blocks on the disk. Memory: the tree. Paper: none.
 */
#include <string.h>
#include <xxhash.h>

#include "assert.h"
#include "file.h"
#include "tree.h"

enum { VDT_VERSION = 2, SECTIONS = 9, FLAG_COLORS = 1 };
static const char magic[8] = {'M', 'N', 'V', 'D', 'T', 0, '\r', '\n'};
static const char *const section_name[SECTIONS] = {"leaf_position", "leaf_color",    "left",
                                                   "right",         "switch_value",  "radius",
                                                   "cone",          "simplex_start", "corner"};

typedef struct vdt_header {
    char magic[8];
    uint32_t version, header_bytes;
    uint64_t checksum; /* XXH3-64 of the header with this field 0 */
    uint64_t build_id, file_bytes;
    uint32_t leaves, inner, simplices, triangles;
    uint32_t roots, legal_last, depth_max, metric;
    uint32_t flags;
    float grid_step;
    double origin[3];
    uint64_t intake[8], counts[9];
    struct {
        uint64_t offset, bytes, checksum;
    } section[SECTIONS];
} vdt_header;
_Static_assert(sizeof(vdt_header) == 456, "no padding");
_Static_assert(sizeof(mn_cone) == 3, "a cone is 24 bits");

typedef struct section {
    void *data;
    uint64_t bytes;
} section;

static void sections_of(const mn_tree *t, section s[SECTIONS]) {
    uint64_t leaves = t->leaves, inner = t->inner, simplices = t->simplices;
    section all[SECTIONS] = {{t->leaf_position, 12 * leaves},
                             {t->leaf_color, t->leaf_color != NULL ? 4 * leaves : 0},
                             {t->left, 4 * inner},
                             {t->right, 4 * inner},
                             {t->switch_value, 4 * inner},
                             {t->radius, 4 * inner},
                             {t->cone, sizeof(mn_cone) * inner},
                             {t->simplex_start, 4 * (inner + 1)},
                             {t->corner, 12 * simplices}};
    memcpy(s, all, sizeof all);
}

/* Sections follow each other, each from a multiple of 8 on. */
static uint64_t place_sections(const section s[SECTIONS], vdt_header *h) {
    uint64_t at = sizeof *h;
    for (int i = 0; i < SECTIONS; i++) {
        h->section[i].offset = at;
        h->section[i].bytes = s[i].bytes;
        at += (s[i].bytes + 7) / 8 * 8;
    }
    return at;
}

static uint64_t checksum_of(const vdt_header *h) {
    vdt_header copy = *h;
    copy.checksum = 0;
    return XXH3_64bits(&copy, sizeof copy);
}

/* ---- writing -------------------------------------------------------------------------------- */

static void fill_header(const mn_tree *t, const section s[SECTIONS], vdt_header *h) {
    const mn_intake *in = &t->intake;
    const mn_build_counts *c = &t->counts;
    memset(h, 0, sizeof *h);
    memcpy(h->magic, magic, sizeof magic);
    h->version = VDT_VERSION;
    h->header_bytes = sizeof *h;
    h->build_id = mni_tree_build_id(t, NULL);
    h->leaves = t->leaves;
    h->inner = t->inner;
    h->simplices = t->simplices;
    h->triangles = t->triangles;
    h->roots = t->roots;
    h->legal_last = t->legal_last;
    h->depth_max = t->depth_max;
    h->metric = t->metric;
    h->flags = t->leaf_color != NULL ? FLAG_COLORS : 0;
    h->grid_step = t->grid_step;
    memcpy(h->origin, t->origin, sizeof h->origin);
    uint64_t intake[8] = {in->input_faces,     in->duplicate_faces,   in->degenerate_faces,
                          in->nonfinite_faces, in->misoriented_faces, in->unused_vertices,
                          in->welded_vertices, in->merged_positions};
    uint64_t counts[9] = {
        c->nonmanifold_edges,     c->boundary_edges,        c->components,
        c->collapses_by_stage[0], c->collapses_by_stage[1], c->collapses_by_stage[2],
        c->collapses_by_stage[3], c->order_violations,      c->rounds};
    memcpy(h->intake, intake, sizeof intake);
    memcpy(h->counts, counts, sizeof counts);
    h->file_bytes = place_sections(s, h);
    for (int i = 0; i < SECTIONS; i++)
        h->section[i].checksum = XXH3_64bits(s[i].data, s[i].bytes);
    h->checksum = checksum_of(h);
}

mn_code mn_tree_write(const char *path, const mn_tree *tree, mn_status *st) {
    static const char zeroes[8] = {0};
    section s[SECTIONS];
    vdt_header h;
    mni_out out = {.fd = -1};
    mn_code code = mn_tree_check(tree, st);
    if (code != MN_OK)
        return code;
    sections_of(tree, s);
    fill_header(tree, s, &h);
    code = mni_out_open(&out, path, st);
    if (code == MN_OK)
        code = mni_out_write(&out, &h, sizeof h, st);
    for (int i = 0; i < SECTIONS && code == MN_OK; i++) {
        code = mni_out_write(&out, s[i].data, s[i].bytes, st);
        if (code == MN_OK)
            code = mni_out_write(&out, zeroes, (8 - s[i].bytes % 8) % 8, st);
    }
    if (code == MN_OK)
        code = mni_out_commit(&out, st);
    mni_out_abort(&out);
    return code;
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
static mn_code check_header(const vdt_header *h, uint64_t size_bytes, const char *path,
                            mn_status *st) {
    FIELD(h->header_bytes == sizeof *h, "header_bytes");
    FIELD(h->file_bytes == size_bytes, "file_bytes (not the file's size)");
    FIELD(h->leaves >= 1 && h->leaves <= 1u << 31, "leaves");
    FIELD(h->roots >= 1 && h->roots <= h->leaves, "roots");
    FIELD(h->inner == h->leaves - h->roots, "inner");
    FIELD(h->simplices < UINT32_MAX, "simplices");
    FIELD(h->triangles <= h->simplices, "triangles");
    FIELD(h->metric == MN_METRIC_QEM || h->metric == MN_METRIC_LENGTH, "metric");
    FIELD(h->flags <= FLAG_COLORS, "flags");
    mn_tree counts = {.leaves = h->leaves, .inner = h->inner, .simplices = h->simplices};
    uint32_t color; /* present or not is all that counts */
    counts.leaf_color = h->flags & FLAG_COLORS ? &color : NULL;
    section s[SECTIONS];
    vdt_header expected;
    sections_of(&counts, s);
    FIELD(place_sections(s, &expected) == size_bytes, "its counts (they need another file size)");
    for (int i = 0; i < SECTIONS; i++)
        FIELD(h->section[i].offset == expected.section[i].offset &&
                  h->section[i].bytes == expected.section[i].bytes,
              section_name[i]);
    FIELD(h->checksum == checksum_of(h), "checksum");
    return MN_OK;
}

static mn_code read_bytes(const mni_in *in, const char *path, uint64_t offset, void *bytes,
                          uint64_t count, const char *what, mn_status *st) {
    int64_t got = mni_in_read(in, offset, bytes, count);
    if (got < 0)
        return mn_fail(st, MN_FAILED, "%s: %s: cannot read: %s", path, what, strerror((int)-got));
    if ((uint64_t)got != count)
        return mn_fail(st, MN_BAD_INPUT, "%s: %s: the file ends after %llu of %llu bytes", path,
                       what, (unsigned long long)got, (unsigned long long)count);
    return MN_OK;
}

static mn_code read_section(const mni_in *in, const char *path, const vdt_header *h, int i,
                            const section *s, mn_status *st) {
    uint64_t offset = h->section[i].offset, padding = 0;
    mn_code code = read_bytes(in, path, offset, s->data, s->bytes, section_name[i], st);
    if (code == MN_OK)
        code = read_bytes(in, path, offset + s->bytes, &padding, (8 - s->bytes % 8) % 8,
                          section_name[i], st);
    if (code == MN_OK && (padding != 0 || XXH3_64bits(s->data, s->bytes) != h->section[i].checksum))
        code = mn_fail(st, MN_BAD_INPUT,
                       "%s: %s (at byte %llu): checksum does not match; simplify again", path,
                       section_name[i], (unsigned long long)offset);
    return code;
}

static void take_counts(const vdt_header *h, mn_tree *t) {
    t->triangles = h->triangles;
    t->legal_last = h->legal_last;
    t->metric = (mn_metric)h->metric;
    t->grid_step = h->grid_step;
    memcpy(t->origin, h->origin, sizeof t->origin);
    const uint64_t *in = h->intake, *c = h->counts;
    t->intake = (mn_intake){in[0], in[1], in[2], in[3], in[4], in[5], in[6], in[7]};
    t->counts = (mn_build_counts){.nonmanifold_edges = c[0],
                                  .boundary_edges = c[1],
                                  .components = c[2],
                                  .collapses_by_stage = {c[3], c[4], c[5], c[6]},
                                  .order_violations = c[7],
                                  .rounds = c[8]};
}

static mn_code read_all(const mni_in *in, const char *path, mn_tree *out, mn_status *st) {
    vdt_header h;
    mn_code code = read_bytes(in, path, 0, &h, sizeof h, "header", st);
    if (code != MN_OK)
        return code;
    if (memcmp(h.magic, magic, sizeof magic) != 0)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: magic is not that of a .vdt; make one with metanode simplify",
                       path);
    if (h.version != VDT_VERSION)
        return mn_fail(st, MN_BAD_INPUT,
                       "%s: header: version is %u, this program reads %d; simplify again", path,
                       h.version, VDT_VERSION);
    code = check_header(&h, in->size_bytes, path, st);
    if (code == MN_OK)
        code =
            mni_tree_alloc(out, h.leaves, h.roots, h.simplices, (h.flags & FLAG_COLORS) != 0, st);
    if (code != MN_OK)
        return code;
    section s[SECTIONS];
    sections_of(out, s);
    for (int i = 0; i < SECTIONS && code == MN_OK; i++)
        code = read_section(in, path, &h, i, &s[i], st);
    take_counts(&h, out);
    mn_status why = {0};
    if (code == MN_OK && (mni_tree_derive(out, &why) != MN_OK || mn_tree_check(out, &why) != MN_OK))
        code = mn_fail(st, why.code, "%s: %s; the file is damaged: simplify again", path, why.text);
    if (code == MN_OK && out->depth_max != h.depth_max)
        code = mn_fail(st, MN_BAD_INPUT, "%s: header: depth_max is %u, of the tree it is %u", path,
                       h.depth_max, out->depth_max);
    if (code == MN_OK && mni_tree_build_id(out, NULL) != h.build_id)
        code = mn_fail(st, MN_BAD_INPUT, "%s: header: build_id is not that of the content", path);
    return code;
}

mn_code mn_tree_read(const char *path, mn_tree *out, mn_status *st) {
    mni_in in;
    memset(out, 0, sizeof *out);
    mn_code code = mni_in_open(&in, path, st);
    if (code != MN_OK)
        return code;
    code = read_all(&in, path, out, st);
    mni_in_close(&in);
    if (code != MN_OK)
        mn_tree_free(out);
    return code;
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

mn_code mn_tree_load(const char *path, const mn_watch *watch, mn_tree *out, mn_status *st) {
    return mn_tree_is_vdt(path) ? mn_tree_read(path, out, st)
                                : mni_mnt_load(path, watch, out, NULL, st);
}
