/* See walk.h. Hidden here: which of the two kinds of files it is. Paper: none. */
#include "walk.h"

#include <stdlib.h>
#include <string.h>

#include "mnt_rows.h"
#include "vdt_rows.h"

mn_code mni_walked_open(mni_walked *w, const char *path, const mn_watch *watch, mn_status *st) {
    const mn_open_desc desc = {.watch = watch};
    mn_code code;
    *w = (mni_walked){.path = path};
    if (mn_tree_is_vdt(path)) {
        code = mn_vdt_open(path, &desc, &w->vdt, st);
        if (code == MN_OK) {
            w->head = *mn_vdt_head(w->vdt);
            w->has_colors = mn_vdt_has_colors(w->vdt);
        }
        return code;
    }
    w->mnt = malloc(sizeof *w->mnt);
    if (w->mnt == NULL)
        return mn_fail(st, MN_FAILED, "%s: no memory to read it", path);
    code = mni_mnt_open(w->mnt, path, st);
    if (code == MN_OK) {
        w->head = mni_mnt_head(w->mnt);
        w->has_colors = w->mnt->header.has_colors;
        w->blocks = w->mnt->header.blocks;
    }
    return code;
}

void mni_walked_close(mni_walked *w) {
    mn_vdt_close(w->vdt);
    if (w->mnt != NULL)
        mni_mnt_close(w->mnt);
    free(w->mnt);
    w->vdt = NULL;
    w->mnt = NULL;
}

uint64_t mni_walk_bytes(const mni_walked *w) {
    return w->vdt != NULL ? mni_vdt_walk_bytes(&w->head) : mni_mnt_walk_bytes(&w->mnt->header);
}

mn_code mni_walk_file(mni_walked *w, const mni_walk_desc *desc, const mni_walk_sink *sink,
                      mn_status *st) {
    return w->vdt != NULL ? mni_vdt_walk(w->vdt, desc, sink, st)
                          : mni_mnt_walk(w->mnt, desc, sink, st);
}
