/* A navigator over a made globe and a paged store on a simulated disk, for tests that fly it frame
 * by frame. One includes it once. */
#ifndef MNI_TEST_FLIGHT_H
#define MNI_TEST_FLIGHT_H

#include <check.h>
#include <math.h>

#include "model.h"
#include "navigate.h"
#include "rate.h"

enum { NODES_MAX = 1 << 14, SIMPLICES_MAX = 1 << 15 };

typedef struct flight {
    model m;
    mni_block_limits limits;
    mni_arena arena;
    mni_store *store;
    mni_navigator nav;
} flight;

/* The model, whose blocks tell how many place holders there are to be. */
static inline const mn_header *flight_model(flight *f, uint32_t triangles,
                                            const mn_block_desc *blocks) {
    model_make(&f->m, MODEL_GLOBE, triangles, blocks);
    f->limits = mni_block_limits_of(&f->m.header);
    return &f->m.header;
}

/* disk: what is not to be as usual of it, its kind at least. */
static inline void flight_open(flight *f, uint32_t k, mni_store_desc disk, uint32_t nodes_max) {
    const mn_header *header = &f->m.header;
    mn_status st = {0};
    disk.path = f->m.path;
    disk.header = header;
    disk.kind = MN_STORE_PAGED;
    disk.k = k;
    disk.seed = 7;
    disk.check = mni_front_block_check;
    disk.check_context = &f->limits;
    disk.prefetch = MN_PREFETCH_AHEAD;
    disk.rate = mni_rate_block;
    disk.look_bytes = sizeof(mni_look);
    ck_assert_int_eq(mni_arena_open(&f->arena,
                                    mni_store_need_bytes(header, MN_STORE_PAGED, k) +
                                        mni_navigator_need_bytes(header, NODES_MAX, SIMPLICES_MAX),
                                    &st),
                     MN_OK);
    ck_assert_msg(mni_store_open(&disk, &f->arena, &f->store, &st) == MN_OK, "%s", st.text);
    f->nav = (mni_navigator){.looks_ahead = true, .width_px = 640, .height_px = 480, .size = 1};
    ck_assert_int_eq(
        mni_navigator_open(&f->nav, f->store, header, nodes_max, SIMPLICES_MAX, &f->arena, &st),
        MN_OK);
}

static inline void flight_close(flight *f) {
    mni_store_close(f->store);
    mni_arena_close(&f->arena);
    model_free(&f->m);
}

static inline void flight_frame(flight *f, const mn_camera *camera, double tolerance_px) {
    mni_store_frame_begin(f->store);
    mni_navigator_frame(&f->nav, camera, tolerance_px);
    mni_store_frame_end(f->store, 1.0 / 60);
    mni_navigator_check(&f->nav);
}

/* Inner nodes of the front that are wanted; *most_px: the largest error. */
static inline uint32_t flight_left(const flight *f, double *most_px) {
    const mni_front *front = &f->nav.front;
    uint32_t count = 0;
    *most_px = 0;
    for (uint32_t slot = 0; slot < front->slots_high; slot++) {
        const mni_bounds bounds = mni_front_bounds(front, slot);
        if (!mni_front_is_active(front, slot) || mni_front_is_leaf(front, slot) ||
            !mni_lens_wants(&f->nav.lens, &bounds))
            continue;
        *most_px = fmax(*most_px, mni_lens_priority(&f->nav.lens, &bounds));
        count++;
    }
    return count;
}

#endif
