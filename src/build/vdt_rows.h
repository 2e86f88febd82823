/* A walk (walk.h) over the rows of a tree that is on disk as rows. */
#ifndef MNI_VDT_ROWS_H
#define MNI_VDT_ROWS_H

#include "walk.h"

/* Where the rows are (vdt.c); until close. path: of the .vdt, NULL: it is none. */
mni_rows_source mni_vdt_source(const mn_vdt *vdt);
/* What the cap must have room for beside the program and held_bytes; less may do. */
uint64_t mni_vdt_walk_bytes(const mn_tree *head);
mn_code mni_vdt_walk(const mn_vdt *vdt, const mni_walk_desc *desc, const mni_walk_sink *sink,
                     mn_status *st);

#endif
