/* Is a file sound, and is its full detail the mesh it was built from?
 *
 * Hides: nothing but the steps' order: a walk over the blocks checks them (mnt_rows.h) and tells of
 * leaves, another tells of simplices (against.h). A .vdt is loaded instead. Order: mn_verify alone.
 * One thread; blocks on the disk. Memory: ram_bytes, whatever the file's size; of a .vdt, the tree
 * besides. Paper: none. */
#include <string.h>

#include "against.h"
#include "mnt_rows.h"
#include "simplify.h"
#include "tree.h"

enum { VDT_WORK_BYTES = 8 << 20 }; /* beside the tree; need_tree.c counts it */

typedef struct verifier {
    const char *path;
    const mn_verify_desc *desc;
    mn_watch watch;
    mni_against *against;
    mn_verify_result *out;
    mn_status *st;
} verifier;

static void fill_result(mn_verify_result *out, uint64_t leaves, uint64_t inner, uint64_t simplices,
                        uint64_t triangles) {
    out->nodes = leaves + inner;
    out->simplices = simplices;
    out->triangles = triangles;
    out->hinges = simplices - triangles;
}

static mn_code open_against(verifier *v, uint64_t work_bytes, uint32_t leaves, uint32_t triangles,
                            uint32_t hinges, const double origin[3], float grid_step) {
    mni_against_desc desc = {.name = v->path,
                             .input = v->desc->against,
                             .read = v->desc->read,
                             .either_weld = v->desc->either_weld,
                             .work_bytes = work_bytes,
                             .temp_dir = v->desc->temp_dir != NULL ? v->desc->temp_dir : ".",
                             .watch = v->watch,
                             .leaves = leaves,
                             .triangles = triangles,
                             .hinges = hinges,
                             .grid_step = grid_step};
    memcpy(desc.origin, origin, sizeof desc.origin);
    return mni_against_open(&v->against, &desc, v->st);
}

/* ---- .vdt ----------------------------------------------------------------------------------- */

static mn_code compare_tree(verifier *v, const mn_tree *t) {
    mn_code code = open_against(v, VDT_WORK_BYTES, t->leaves, t->triangles,
                                t->simplices - t->triangles, t->origin, t->grid_step);
    for (uint32_t leaf = 0; leaf < t->leaves && code == MN_OK; leaf++)
        code = mni_against_leaf(v->against, leaf, t->leaf_position + 3 * (size_t)leaf);
    if (code == MN_OK)
        code = mni_against_match(v->against);
    for (uint32_t s = 0; s < t->simplices && code == MN_OK; s++)
        code = mni_against_simplex(v->against, t->corner + 3 * (size_t)s);
    return code == MN_OK ? mni_against_end(v->against, v->out) : code;
}

static mn_code verify_vdt(verifier *v) {
    mn_tree tree;
    mn_code code = mn_tree_load(v->path, &v->watch, &tree, v->st);
    if (code != MN_OK)
        return code;
    fill_result(v->out, tree.leaves, tree.inner, tree.simplices, tree.triangles);
    if (v->desc->against != NULL)
        code = compare_tree(v, &tree);
    mn_tree_free(&tree);
    return code;
}

/* ---- .mnt ----------------------------------------------------------------------------------- */

static mn_code tell_leaf(void *context, uint32_t at, const mni_row *row, const mni_node *node) {
    verifier *v = context;
    (void)node;
    return mni_against_leaf(v->against, at, row->position);
}

static mn_code tell_simplex(void *context, const mni_row_simplex *simplex) {
    verifier *v = context;
    return mni_against_simplex(v->against, simplex->corner);
}

/* Two walks, each with what the comparison leaves it. */
static mn_code compare_mnt(verifier *v, mni_mnt *mnt) {
    const mni_mnt_sink leaves = {.row = tell_leaf, .context = v};
    const mni_mnt_sink simplices = {.simplex = tell_simplex, .context = v};
    const mn_header *h = &mnt->header;
    const uint64_t ram = v->desc->ram_bytes;
    uint64_t least = MNI_AGAINST_FREE_SHARE * mni_mnt_walk_bytes(h);
    least = least > MNI_AGAINST_WORK_MIN ? least : MNI_AGAINST_WORK_MIN;
    if (ram > 0 && ram < MNI_PROGRAM_BYTES + least)
        return mn_fail(v->st, MN_CAP_TOO_SMALL,
                       "%s: %.1f MB of memory are too few to compare it in: try --ram %lluM",
                       v->path, (double)ram / (1 << 20),
                       (unsigned long long)((MNI_PROGRAM_BYTES + least) >> 20) + 1);
    const uint64_t work = ram > 0 ? ram - MNI_PROGRAM_BYTES : UINT64_C(256) << 20;
    const mni_mnt_desc desc = {.ram_bytes = ram,
                               .held_bytes = work - work / MNI_AGAINST_FREE_SHARE,
                               .watch = &v->watch,
                               .phase = "checking"};
    mn_code code = open_against(v, work, h->leaves, (uint32_t)h->triangles, h->hinges, h->origin,
                                h->grid_step);
    if (code == MN_OK)
        code = mni_mnt_walk(mnt, &desc, &leaves, v->st);
    if (code == MN_OK)
        code = mni_against_match(v->against);
    if (code == MN_OK)
        code = mni_mnt_walk(mnt, &desc, &simplices, v->st);
    return code == MN_OK ? mni_against_end(v->against, v->out) : code;
}

static mn_code verify_mnt(verifier *v) {
    static const mni_mnt_sink nobody = {0};
    const mni_mnt_desc desc = {
        .ram_bytes = v->desc->ram_bytes, .watch = &v->watch, .phase = "checking"};
    mni_mnt mnt;
    mn_code code = mni_mnt_open(&mnt, v->path, v->st);
    if (code == MN_OK)
        code = v->desc->against != NULL ? compare_mnt(v, &mnt)
                                        : mni_mnt_walk(&mnt, &desc, &nobody, v->st);
    mni_mnt_close(&mnt);
    const mn_header *h = &mnt.header;
    if (code != MN_OK)
        return code;
    v->out->blocks = h->blocks;
    fill_result(v->out, h->leaves, h->nodes - h->leaves, h->triangles + h->hinges, h->triangles);
    return MN_OK;
}

mn_code mn_verify(const char *path, const mn_verify_desc *desc, mn_verify_result *out,
                  mn_status *st) {
    static const mn_verify_desc defaults = {0};
    mn_status own = {0};
    verifier v = {.path = path,
                  .desc = desc != NULL ? desc : &defaults,
                  .out = out,
                  .st = st != NULL ? st : &own};
    memset(out, 0, sizeof *out);
    v.watch = (mn_watch){v.desc->read.progress, v.desc->read.progress_context};
    mn_code code = mn_tree_is_vdt(path) ? verify_vdt(&v) : verify_mnt(&v);
    mni_against_close(v.against);
    return code;
}
