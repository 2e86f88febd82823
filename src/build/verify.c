/* Is a file sound, and is its full detail the mesh it was built from?
 *
 * Hides: nothing but the steps' order: a walk over the file checks it (walk.h) and tells of leaves,
 * another tells of simplices (against.h). Order: mn_verify alone. One thread; blocks on the disk.
 * Memory: ram_bytes, whatever the file's size. Paper: none. */
#include <string.h>

#include "against.h"
#include "cap.h"
#include "simplify.h"
#include "walk.h"

/* The largest shares of what is compared in are sorts, of 32 bytes a simplex on both sides. */
enum { MOST_EACH_BYTES = 512 };

typedef struct verifier {
    const mn_verify_desc *desc;
    mn_watch watch;
    mni_walked file;
    mni_against *against;
    mn_verify_result *out;
    mn_status *st;
} verifier;

static mn_code tell_leaf(void *context, uint32_t at, const mni_row *row, const uint32_t child[2]) {
    verifier *v = context;
    (void)child;
    return mni_against_leaf(v->against, at, row->position);
}

static mn_code tell_simplex(void *context, const mni_row_simplex *simplex) {
    verifier *v = context;
    return mni_against_simplex(v->against, simplex->corner);
}

static mn_code open_against(verifier *v, uint64_t work_bytes) {
    const mn_tree *t = &v->file.head;
    mni_against_desc desc = {.name = v->file.path,
                             .input = v->desc->against,
                             .read = v->desc->read,
                             .either_weld = v->desc->either_weld,
                             .work_bytes = work_bytes,
                             .temp_dir = v->desc->temp_dir != NULL ? v->desc->temp_dir : ".",
                             .watch = v->watch,
                             .leaves = t->leaves,
                             .triangles = t->triangles,
                             .hinges = t->simplices - t->triangles,
                             .grid_step = t->grid_step};
    memcpy(desc.origin, t->origin, sizeof desc.origin);
    return mni_against_open(&v->against, &desc, v->st);
}

/* Two walks, each with what the comparison leaves it. */
static mn_code compare(verifier *v) {
    const mni_walk_sink leaves = {.row = tell_leaf, .context = v};
    const mni_walk_sink simplices = {.simplex = tell_simplex, .context = v};
    const uint64_t ram = v->desc->ram_bytes;
    uint64_t least = MNI_AGAINST_FREE_SHARE * mni_walk_bytes(&v->file);
    least = least > MNI_AGAINST_WORK_MIN ? least : MNI_AGAINST_WORK_MIN;
    if (ram > 0 && ram < MNI_PROGRAM_BYTES + least)
        return mn_fail(v->st, MN_CAP_TOO_SMALL,
                       "%s: %.1f MB of memory are too few to compare it in: try --ram %lluM",
                       v->file.path, (double)ram / (1 << 20),
                       mni_megabytes(MNI_PROGRAM_BYTES + least));
    const mn_tree *t = &v->file.head;
    const uint64_t most = /* more is not used */
        MOST_EACH_BYTES * ((uint64_t)t->leaves + t->simplices) + (64 << 20);
    uint64_t work = ram > 0 ? ram - MNI_PROGRAM_BYTES : UINT64_C(256) << 20;
    work = work < most ? work : most > least ? most : least;
    const mni_walk_desc desc = {.ram_bytes = ram,
                                .held_bytes = work - work / MNI_AGAINST_FREE_SHARE,
                                .watch = &v->watch,
                                .phase = "checking"};
    mn_code code = open_against(v, work);
    if (code == MN_OK)
        code = mni_walk_file(&v->file, &desc, &leaves, v->st);
    if (code == MN_OK)
        code = mni_against_match(v->against);
    if (code == MN_OK)
        code = mni_walk_file(&v->file, &desc, &simplices, v->st);
    return code == MN_OK ? mni_against_end(v->against, v->out) : code;
}

static mn_code check(verifier *v) {
    static const mni_walk_sink nobody = {0};
    const mni_walk_desc desc = {
        .ram_bytes = v->desc->ram_bytes, .watch = &v->watch, .phase = "checking"};
    return mni_walk_file(&v->file, &desc, &nobody, v->st);
}

mn_code mn_verify(const char *path, const mn_verify_desc *desc, mn_verify_result *out,
                  mn_status *st) {
    static const mn_verify_desc defaults = {0};
    mn_status own = {0};
    verifier v = {
        .desc = desc != NULL ? desc : &defaults, .out = out, .st = st != NULL ? st : &own};
    memset(out, 0, sizeof *out);
    v.watch = (mn_watch){v.desc->read.progress, v.desc->read.progress_context};
    mn_code code = mni_walked_open(&v.file, path, &v.watch, v.st);
    if (code == MN_OK)
        code = v.desc->against != NULL ? compare(&v) : check(&v);
    if (code == MN_OK) {
        const mn_tree *t = &v.file.head;
        out->blocks = v.file.blocks;
        out->nodes = (uint64_t)t->leaves + t->inner;
        out->simplices = t->simplices;
        out->triangles = t->triangles;
        out->hinges = t->simplices - t->triangles;
    }
    mni_walked_close(&v.file);
    mni_against_close(v.against);
    return code;
}
