/* A front of a tree in a file as a mesh on disk, neither of which need fit in memory.
 *
 * Hides: that a front is a bit a leaf (front.h). In a prefix front every node is split whose order
 * id is at least the cut, and no other; a settled one is found by settle.c. A corner's active node
 * begins at the last leaf up to it at which one does. Triangles of the mesh are those that split
 * nodes have killed. So it takes walks (walk.h), the last ones only through the top of the tree:
 *
 *   1  all      triangles by order id, counted in BINS bins            the bin of the cut
 *   2  the top  triangles of that bin, node by node                    the cut
 *   3  the top  where active nodes begin
 *   4  the top  which of these have triangles: they are vertices, in the order of leaves
 *   5  the top  vertices and triangles, each to its part of the file
 *
 * At full detail, where every leaf is active, the walks are 4 and 5; where the front has settled,
 * too. Order: mn_extract_file alone. One thread. Memory: two bits a leaf, for a settled front three
 * and what settle.c works with; and a walk's. Paper: none. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cap.h"
#include "file.h"
#include "mn_assert.h"
#include "settle.h"
#include "simplify.h"
#include "write_ply.h"

enum {
    BINS = 1 << 16,
    RANK_WORDS = 8, /* of 64 leaves; vertices are counted before each so many */
    FACES_BYTES = 5000 * MNI_PLY_FACE_BYTES,
};

typedef struct extraction {
    const mn_extract_desc *desc;
    mni_walked file;
    mn_watch watch;
    mn_status *st;
    uint64_t held_bytes;   /* beside settle_bytes */
    uint64_t settle_bytes; /* until the front has settled */
    uint32_t leaves, inner;
    uint32_t from;         /* nodes that the walk goes to, at least */
    uint32_t made;         /* collapses that the front has gone through */
    uint32_t node;         /* of the row that came last: its number; MN_NONE: a root begins */
    bool is_split;         /* that node */
    uint32_t first, width; /* of node numbers: what is counted, and how many a bin */
    uint64_t *bin;         /* triangles */
    mni_front front;
    uint64_t *split; /* of a settled front: a bit for each inner node, by number */
    uint64_t *used;  /* a bit a leaf: the active node that begins there has triangles */
    uint32_t *rank;  /* vertices before word RANK_WORDS × i of used */
    mn_mesh mesh;    /* counts; one vertex at a time */
    float position[3];
    uint32_t color;
    mni_out out;
    uint64_t faces_at; /* in the file: where the next ones go */
    unsigned char *faces;
    uint32_t faces_bytes;
} extraction;

static uint64_t words_of(const extraction *x) {
    return mni_front_words(x->leaves);
}

static uint32_t vertex_at(const extraction *x, uint32_t leaf) {
    const uint32_t word = leaf / 64;
    uint32_t vertex = x->rank[word / RANK_WORDS];
    for (uint32_t w = word / RANK_WORDS * RANK_WORDS; w < word; w++)
        vertex += (uint32_t)__builtin_popcountll(x->used[w]);
    return vertex +
           (uint32_t)__builtin_popcountll(x->used[word] & ((UINT64_C(1) << leaf % 64) - 1));
}

static bool is_above(const void *context, uint32_t order) {
    const extraction *x = context;
    return x->split != NULL ? mni_bit(x->split, order - x->leaves) : order - x->leaves >= x->from;
}

static mn_code walk(extraction *x, uint32_t from,
                    mn_code (*row)(void *, uint32_t, const mni_row *, const uint32_t[2]),
                    mn_code (*simplex)(void *, const mni_row_simplex *), const char *phase) {
    const mni_walk_sink sink = {row, simplex, x};
    const mni_walk_desc desc = {.ram_bytes = x->desc->ram_bytes,
                                .held_bytes = x->held_bytes,
                                .wanted = from > 0 || x->split != NULL ? is_above : NULL,
                                .watch = &x->watch,
                                .phase = phase};
    x->from = from;
    return mni_walk_file(&x->file, &desc, &sink, x->st);
}

/* ---- the cut -------------------------------------------------------------------------------- */

static mn_code note_node(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    extraction *x = context;
    (void)at;
    x->node = child != NULL ? row->order - x->leaves : MN_NONE;
    return MN_OK;
}

static mn_code count_triangle(void *context, const mni_row_simplex *simplex) {
    extraction *x = context;
    const uint32_t bin = x->node >= x->first ? (x->node - x->first) / x->width : BINS;
    if (simplex->corner[2] != MN_NONE && bin < BINS)
        x->bin[bin]++;
    return MN_OK;
}

/* Lets bins go that leave more than wanted: `over` of them. The first that is not to go whole. */
static uint32_t pass_bins(const extraction *x, uint64_t *over) {
    uint32_t bin = 0;
    while (bin < BINS && x->bin[bin] < *over)
        *over -= x->bin[bin++];
    return bin;
}

/* As few collapses as leave so few triangles. */
static mn_code find_cut(extraction *x) {
    const uint64_t all = x->file.head.triangles, wanted = x->desc->triangles;
    x->first = 0;
    x->width = x->inner / BINS + 1;
    mn_code code = walk(x, 0, note_node, count_triangle, "checking");
    if (code != MN_OK || all <= wanted)
        return code;
    uint64_t over = all - wanted;
    x->first = pass_bins(x, &over) * x->width;
    memset(x->bin, 0, BINS * sizeof *x->bin);
    MN_ASSERT(x->width <= BINS); /* 2^31 nodes have bins of 2^15 */
    x->width = 1;
    code = walk(x, x->first, note_node, count_triangle, "extracting");
    if (code != MN_OK)
        return code;
    x->made = x->first;
    for (uint32_t i = 0; i < BINS && x->made < x->inner && over > 0; i++, x->made++)
        over -= x->bin[i] < over ? x->bin[i] : over; /* the file may have been changed */
    return MN_OK;
}

/* ---- the front ------------------------------------------------------------------------------ */

static mn_code mark_begin(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    extraction *x = context;
    note_node(context, at, row, child);
    if (child == NULL || x->node >= x->made)
        mni_bit_set(x->front.begins, at);
    return MN_OK;
}

static mn_code note_split(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    extraction *x = context;
    (void)row;
    x->is_split = child != NULL && mni_bit(x->front.begins, at);
    return MN_OK;
}

static mn_code mark_used(void *context, const mni_row_simplex *simplex) {
    extraction *x = context;
    if (simplex->corner[2] == MN_NONE || !x->is_split)
        return MN_OK;
    x->mesh.triangles++;
    for (int i = 0; i < 3; i++)
        mni_bit_set(x->used, mni_front_begin(&x->front, simplex->corner[i]));
    return MN_OK;
}

static mn_code settle(extraction *x) {
    const mni_settle_desc desc = {
        /* the grid has its share; less than that no front has */
        .switch_value = fmaxf(x->desc->error - mn_grid_error(x->file.head.grid_step), 0),
        .work_bytes = x->settle_bytes,
        .ram_bytes = x->desc->ram_bytes,
        .held_bytes = x->held_bytes,
        .temp_dir = x->desc->temp_dir != NULL ? x->desc->temp_dir : ".",
        .watch = &x->watch};
    return mni_settle(&x->file, &desc, &x->front, x->split, x->st);
}

static mn_code find_front(extraction *x) {
    mn_code code = MN_OK;
    if (x->desc->what == MN_EXTRACT_ERROR)
        code = settle(x);
    else if (x->made == 0)
        memset(x->front.begins, 0xff, words_of(x) * sizeof *x->front.begins);
    else
        code = walk(x, x->made, mark_begin, NULL, "extracting");
    if (code == MN_OK)
        code = walk(x, x->made, note_split, mark_used,
                    x->desc->what == MN_EXTRACT_FULL ? "checking" : "extracting");
    for (uint64_t w = 0; w < words_of(x); w++) {
        if (w % RANK_WORDS == 0)
            x->rank[w / RANK_WORDS] = x->mesh.vertices;
        x->mesh.vertices += (uint32_t)__builtin_popcountll(x->used[w]);
    }
    return code;
}

/* ---- the file ------------------------------------------------------------------------------- */

static mn_code flush_faces(extraction *x) {
    mn_code code = mni_out_write_at(&x->out, x->faces_at, x->faces, x->faces_bytes, x->st);
    x->faces_at += x->faces_bytes;
    x->faces_bytes = 0;
    return code;
}

static mn_code put_vertex(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    extraction *x = context;
    unsigned char record[MNI_PLY_VERTEX_MAX];
    note_split(context, at, row, child);
    if (!mni_bit(x->used, at))
        return MN_OK;
    memcpy(x->position, row->position, sizeof x->position);
    x->color = row->rgba;
    return mni_out_write(&x->out, record, mni_ply_vertex(&x->mesh, 0, record), x->st);
}

static mn_code put_face(void *context, const mni_row_simplex *simplex) {
    extraction *x = context;
    uint32_t corner[3];
    if (simplex->corner[2] == MN_NONE || !x->is_split)
        return MN_OK;
    for (int i = 0; i < 3; i++)
        corner[i] = vertex_at(x, mni_front_begin(&x->front, simplex->corner[i]));
    mni_ply_face(corner, x->faces + x->faces_bytes);
    x->faces_bytes += MNI_PLY_FACE_BYTES;
    return x->faces_bytes == FACES_BYTES ? flush_faces(x) : MN_OK;
}

static mn_code write_file(extraction *x, const char *path) {
    char text[MNI_PLY_HEADER_MAX];
    unsigned char record[MNI_PLY_VERTEX_MAX];
    const size_t length = mni_ply_header(&x->mesh, text);
    const uint64_t vertices = (uint64_t)x->mesh.vertices * mni_ply_vertex(&x->mesh, 0, record);
    x->faces_at = length + vertices;
    mn_code code = mni_out_open(&x->out, path, x->st);
    if (code == MN_OK)
        code = mni_out_write(&x->out, text, length, x->st);
    if (code == MN_OK)
        code = walk(x, x->made, put_vertex, put_face, "extracting");
    if (code == MN_OK)
        code = flush_faces(x);
    /* the file may have been changed between two walks */
    if (code == MN_OK &&
        (mni_out_at(&x->out) != length + vertices ||
         x->faces_at != length + vertices + (uint64_t)x->mesh.triangles * MNI_PLY_FACE_BYTES))
        code = mn_fail(x->st, MN_BAD_INPUT, "%s: was changed while it was read; try again",
                       x->file.path);
    if (code == MN_OK)
        code = mni_out_commit(&x->out, x->st);
    mni_out_abort(&x->out);
    return code;
}

/* ---- the whole ------------------------------------------------------------------------------ */

static mn_code take_memory(extraction *x) {
    const bool by_count = x->desc->what == MN_EXTRACT_TRIANGLES;
    const bool by_error = x->desc->what == MN_EXTRACT_ERROR;
    const uint64_t words = words_of(x), ranks = words / RANK_WORDS + 1, ram = x->desc->ram_bytes;
    x->held_bytes = (2 + by_error) * words * sizeof *x->used + ranks * sizeof *x->rank +
                    (by_count ? BINS * sizeof *x->bin : 0) + FACES_BYTES;
    x->settle_bytes = by_error ? mni_settle_least(x->leaves) : 0;
    const uint64_t need =
        MNI_PROGRAM_BYTES + x->held_bytes + x->settle_bytes + mni_walk_bytes(&x->file);
    if (ram > 0 && ram < need)
        return mn_fail(x->st, MN_CAP_TOO_SMALL,
                       "%s: %.1f MB of memory are too few to extract it in: try --ram %lluM",
                       x->file.path, (double)ram / (1 << 20), mni_megabytes(need));
    if (by_error) { /* half of what is left: walks can use it as well */
        const uint64_t most = mni_settle_most(x->leaves);
        const uint64_t room = ram > 0 ? x->settle_bytes + (ram - need) / 2 : most;
        x->settle_bytes = room < most ? room : most;
    }
    x->front = (mni_front){x->leaves, calloc(words, sizeof *x->front.begins)};
    x->used = calloc(words, sizeof *x->used);
    x->rank = calloc(ranks, sizeof *x->rank);
    x->faces = malloc(FACES_BYTES);
    if (by_count)
        x->bin = calloc(BINS, sizeof *x->bin);
    if (by_error)
        x->split = calloc(words, sizeof *x->split);
    if (x->front.begins == NULL || x->used == NULL || x->rank == NULL || x->faces == NULL ||
        (by_count && x->bin == NULL) || (by_error && x->split == NULL))
        return mn_fail(x->st, MN_FAILED, "%s: no memory for a front", x->file.path);
    return MN_OK;
}

static mn_code extract(extraction *x, const char *out) {
    const mn_tree *t = &x->file.head;
    x->leaves = t->leaves;
    x->inner = t->inner;
    memcpy(x->mesh.origin, t->origin, sizeof t->origin);
    x->mesh.position = x->position;
    x->mesh.color = x->file.has_colors ? &x->color : NULL;
    mn_code code = take_memory(x);
    if (code == MN_OK && x->desc->what == MN_EXTRACT_TRIANGLES)
        code = find_cut(x);
    if (code == MN_OK)
        code = find_front(x);
    return code == MN_OK ? write_file(x, out) : code;
}

mn_code mn_extract_file(const char *in, const mn_extract_desc *desc, const mn_watch *watch,
                        const char *out, mn_extract_result *result, mn_status *st) {
    mn_status own = {0};
    extraction x = {.desc = desc, .st = st != NULL ? st : &own, .out = {.fd = -1}};
    if (watch != NULL)
        x.watch = *watch;
    if (desc->what == MN_EXTRACT_ERROR && !(desc->error >= 0))
        return mn_fail(x.st, MN_USAGE, "an error of %g: it is a length, 0 or more", desc->error);
    mn_code code = mni_walked_open(&x.file, in, &x.watch, x.st);
    if (code == MN_OK)
        code = extract(&x, out);
    mni_walked_close(&x.file);
    *result = (mn_extract_result){x.mesh.vertices, x.mesh.triangles};
    free(x.front.begins);
    free(x.split);
    free(x.used);
    free(x.rank);
    free(x.bin);
    free(x.faces);
    return code;
}
