/* The view-dependence tree, inside the build. */
#ifndef MNI_TREE_H
#define MNI_TREE_H

#include "metanode/build.h"

/* Allocates the arrays for that many leaves, roots and simplices, zeroed, and sets the counts.
 * MN_FAILED: no memory; *tree is then freed and zeroed. */
mn_code mni_tree_alloc(mn_tree *tree, uint32_t leaves, uint32_t roots, uint32_t simplices,
                       bool has_colors, mn_status *st);
/* From children: intervals, roots and depth_max. MN_BAD_INPUT: not a forest numbered depth-first.
 */
mn_code mni_tree_derive(mn_tree *tree, mn_status *st);
/* XXH3 of what the tree says (counts and times aside) and, unless desc is NULL, of how it is cut.
 * MN_FAILED: no memory (4 bytes a leaf). */
mn_code mni_tree_build_id(const mn_tree *tree, const mn_block_desc *desc, uint64_t *id,
                          mn_status *st);
/* Fills box and dive point: the highest vertex along +y (the first of several), with the
 * area-weighted normal of its triangles. */
void mni_tree_shape(const mn_tree *tree, mn_header *header);
/* Collapses of the prefix front with the most triangles that are at most so many. */
uint32_t mni_tree_prefix(const mn_tree *tree, uint64_t triangles);

#endif
