/* The tree of a .mnt as rows in a temporary file, to be cut again.
 *
 * One call; it goes through the file twice and blocks on the disk. Paper: §3.2. */
#ifndef MNI_MNT_SPILL_H
#define MNI_MNT_SPILL_H

#include "mnt_rows.h"
#include "order.h"

/* Checks all of the file. head: counts and facts. On failure out->file is closed. MN_BAD_INPUT
 * names the first thing that is wrong; MN_CAP_TOO_SMALL, what would do; MN_NO_SPACE: temporary
 * files filled the disk. desc->temp_dir outlives *out. */
mn_code mni_mnt_spill(const char *path, const mn_open_desc *desc, mni_ordered *out, mn_tree *head,
                      bool *has_colors, mn_status *st);

#endif
