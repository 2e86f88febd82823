/* Store `paged`: opening it is refused until the pool is there. */
#include "store_kind.h"

static size_t need_bytes(const mn_header *header, uint32_t k) {
    return (size_t)k * header->block_bytes_max;
}

static uint32_t entries_max(const mn_header *header, uint32_t k) {
    return 4 * (k + header->block_depth);
}

static mn_code refuse(const mni_store_desc *desc, mni_arena *arena, void **out, mn_status *st) {
    (void)arena, (void)out;
    return mn_fail(st, MN_FAILED,
                   "%s: this build has no paged store; use --store mapped or resident", desc->path);
}

const mni_store_kind mni_store_paged = {
    .need_bytes = need_bytes, .entries_max = entries_max, .open = refuse};
