/* From what rounds have made to a tree on disk: its rows and simplices.
 *
 * One call; it reads a history backwards once and the mesh's vertices about once, and blocks on
 * temporary files. What comes out depends on the history alone. Memory: work_bytes, whatever the
 * model's size. Paper: §3.1 (tree), §3.2 (order). */
#ifndef MNI_ORDER_H
#define MNI_ORDER_H

#include "extmesh.h"
#include "history.h"
#include "tree_rows.h"

typedef struct mni_order_desc {
    uint64_t work_bytes;  /* at least mni_order_work_min; 0: as much as keeps off the disk */
    const char *temp_dir; /* outlives *out */
    bool keep;            /* *out is a kept spill */
    uint32_t threads;     /* 0: 1; of more than 2, 2 are used, if there is room. The same for any */
    const mn_watch *watch;
} mni_order_desc;

typedef struct mni_ordered {
    mni_spill file;                     /* packed (rowpack.h), from its beginning */
    uint64_t sum[MNI_SECTIONS];         /* of what was packed */
    uint64_t bytes_read, bytes_written; /* of all files, on the way */
} mni_ordered;

/* Grows as the square root of the model. */
uint64_t mni_order_work_min(uint64_t vertices);
/* The history has been ended (mni_history_end) and is read once. On failure *out is closed.
 * MN_NO_SPACE: temporary files filled the disk; MN_FAILED: memory, or "interrupted". */
mn_code mni_order(mni_history *history, mni_extmesh *mesh, const mni_order_desc *desc,
                  mni_ordered *out, mn_status *st);

#endif
