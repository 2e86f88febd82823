/* From a cap to counts. See ram_plan.c. */
#ifndef MNI_RAM_PLAN_H
#define MNI_RAM_PLAN_H

#include "metanode/runtime.h"

/* What of mn_session_desc the plan depends on. */
typedef struct mni_ram_plan_desc {
    uint64_t ram_bytes;  /* 0: no cap */
    uint64_t base_bytes; /* of the caller, beyond the baseline */
    int64_t k;
    uint32_t front_max; /* 0: from the cap */
} mni_ram_plan_desc;

/* Fills *out. MN_CAP_TOO_SMALL names the smallest cap that would do; MN_USAGE: a K below the
 * smallest that the file's block tree allows. Pure. */
mn_code mni_ram_plan_make(const mni_ram_plan_desc *desc, const mn_header *header, mn_plan *out,
                          mn_status *st);
/* Arena bytes that such a session takes with that store. */
size_t mni_ram_plan_arena_bytes(const mn_plan *plan, const mn_header *header, mn_store_kind store);

#endif
