#include "front_rig.h"

#include <check.h>
#include <stdlib.h>
#include <string.h>

void rig_start(rig *r) {
    mn_status st = {0};
    const mn_header *h = &r->m.header;
    r->limits = mni_block_limits_of(h);
    uint32_t simplices = (uint32_t)(h->triangles + h->hinges);
    size_t need = mni_store_need_bytes(h, MN_STORE_RESIDENT, 0) +
                  mni_front_need_bytes(h, h->leaves, simplices);
    mn_code code = mni_arena_open(&r->arena, need, &st);
    mni_store_desc store = {.path = r->m.path,
                            .header = h,
                            .kind = MN_STORE_RESIDENT,
                            .check = mni_front_block_check,
                            .check_context = &r->limits};
    if (code == MN_OK)
        code = mni_store_open(&store, &r->arena, &r->store, &st);
    if (code == MN_OK)
        code = mni_front_open(&r->front, r->store, h, h->leaves, simplices, &r->arena, &st);
    ck_assert_msg(code == MN_OK, "%s", st.text);
    r->usage = calloc(mni_store_entries_max(h, MN_STORE_RESIDENT, 0), sizeof *r->usage);
    ck_assert_ptr_nonnull(r->usage);
}

void rig_open(rig *r, model_shape shape, uint32_t triangles, const mn_block_desc *blocks) {
    memset(r, 0, sizeof *r);
    model_make(&r->m, shape, triangles, blocks);
    rig_start(r);
}

void rig_close(rig *r) {
    mni_store_close(r->store);
    mni_arena_close(&r->arena);
    model_free(&r->m);
    free(r->usage);
}
