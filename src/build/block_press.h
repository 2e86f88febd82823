/* From a file of blocks to one of compressed blocks (extents.h). */
#ifndef MNI_BLOCK_PRESS_H
#define MNI_BLOCK_PRESS_H

#include "file.h"
#include "metanode/build.h"

/* What the process takes to compress blocks of up to so many bytes. */
uint64_t mni_block_press_bytes(const mn_block_desc *desc, uint32_t length_max);
/* MN_CAP_TOO_SMALL: that is more than ram_bytes; what is named is least_bytes or more. */
mn_code mni_block_press_fits(const char *path, const mn_block_desc *desc, uint32_t length_max,
                             uint64_t least_bytes, mn_status *st);
/* Reads the whole file that was written to *out, header page apart, and puts in its place one whose
 * blocks are compressed; fills what *header says of that, and adds to *counts. desc: checked, its
 * zstd_level above 0. path: the final name, for the text. MN_CAP_TOO_SMALL: zstd's memory. */
mn_code mni_block_press(mni_out *out, const char *path, const mn_block_desc *desc,
                        mn_header *header, mn_block_counts *counts, mn_status *st);

#endif
