/* From a file of blocks to one of compressed blocks (extents.h). */
#ifndef MNI_BLOCK_PRESS_H
#define MNI_BLOCK_PRESS_H

#include "file.h"
#include "metanode/build.h"

/* Reads the whole file that was written to *out, header page apart, and puts in its place one whose
 * blocks are compressed; fills what *header says of that, and adds to *counts. desc: checked, its
 * zstd_level above 0. path: the final name, for the text. MN_CAP_TOO_SMALL: zstd's memory. */
mn_code mni_block_press(mni_out *out, const char *path, const mn_block_desc *desc,
                        mn_header *header, mn_block_counts *counts, mn_status *st);

#endif
