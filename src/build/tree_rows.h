/* A tree in memory, given out in rows: the two sections of a .vdt, from front to back. */
#ifndef MNI_TREE_ROWS_H
#define MNI_TREE_ROWS_H

#include "rows.h"

enum { MNI_ROWS = 0, MNI_SIMPLICES, MNI_SECTIONS };

/* Takes the next bytes, whole records, of a section; first come all of MNI_ROWS. */
typedef mn_code (*mni_rows_put)(void *context, int section, const void *bytes, size_t count);

/* Hands out a sound tree (mn_tree_check). The first failure of put ends it and is returned;
 * MN_FAILED: no memory (4 bytes a leaf). */
mn_code mni_tree_rows(const mn_tree *tree, mni_rows_put put, void *context, mn_status *st);
/* XXH3-64 of each section. */
mn_code mni_tree_rows_sums(const mn_tree *tree, uint64_t sum[MNI_SECTIONS], mn_status *st);
/* XXH3-64 of what is in the rows and of what is said of them; desc: of how they are cut, or NULL.
 * Of the tree no array is looked at. */
uint64_t mni_build_id(const mn_tree *facts, bool has_colors, const uint64_t sum[MNI_SECTIONS],
                      const mn_block_desc *desc);

#endif
