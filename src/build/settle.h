/* The settled front of a tree in a file that need not fit in memory (terms.md: wanted, front). */
#ifndef MNI_SETTLE_H
#define MNI_SETTLE_H

#include "front.h"
#include "walk.h"

typedef struct mni_settle_desc {
    float switch_value;  /* who has a greater one is to be split */
    uint64_t work_bytes; /* at least mni_settle_least */
    uint64_t ram_bytes;  /* of the process; 0: no bound */
    uint64_t held_bytes; /* of them, what the caller has, work_bytes apart */
    const char *temp_dir;
    const mn_watch *watch;
} mni_settle_desc;

/* The least to work with, and what keeps off the disk. */
uint64_t mni_settle_least(uint32_t leaves);
uint64_t mni_settle_most(uint32_t leaves);

/* front: no bits set; *split: likewise, of nodes by number (order id - leaves), as many bits. Both
 * are the caller's. It reads all of the file once, and its top as often as it takes. As walks fail
 * (walk.h); MN_NO_SPACE: the temporary file filled the disk. */
mn_code mni_settle(mni_walked *file, const mni_settle_desc *desc, mni_front *front, uint64_t *split,
                   mn_status *st);

#endif
