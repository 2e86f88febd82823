/* From rows to a .mnt, in memory that does not grow with the model.
 *
 * One call; blocks on the disk. Reads each row and simplex about once, a few more often, and checks
 * all of them on the way. The same rows and desc give the same bytes, wherever the rows are and
 * however much memory there is. Paper: §3.2. */
#ifndef MNI_BLOCK_ROWS_H
#define MNI_BLOCK_ROWS_H

#include "rows.h"

/* Puts defaults for zeroes. MN_USAGE: they cannot be, or not for such a tree. MN_CAP_TOO_SMALL: nor
 * in so much memory. path: the output, for the text. */
mn_code mni_block_desc_check(const char *path, const mn_tree *head, mn_block_desc *desc,
                             mn_status *st);
/* head: counts and facts of the tree; its arrays are not looked at. build_id: of the .mnt. header,
 * counts (may be NULL) are filled in. MN_BAD_INPUT: the rows are not those of a tree. MN_NO_SPACE,
 * and every other failure: what stood under path is untouched. */
mn_code mni_block_rows(const char *path, const mn_tree *head, const mni_rows_source *source,
                       uint64_t build_id, const mn_block_desc *desc, mn_header *header,
                       mn_block_counts *counts, mn_status *st);

#endif
