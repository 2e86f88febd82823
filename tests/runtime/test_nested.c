/* Goal: on real trees, as their files are decoded, no node is wanted where its parent is not: so
 * settled fronts depend on the camera alone. Method: the front at full detail knows every node;
 * random cameras near and far, random weights, each node against its parent. */
#include <check.h>
#include <math.h>
#include <string.h>

#include "model.h"
#include "navigate.h"
#include "suite.h"

enum { TRIANGLES = 3000, CAMERAS = 100 };

typedef struct rig {
    model m;
    mni_block_limits limits;
    mni_arena arena;
    mni_store *store;
    mni_navigator nav;
} rig;

/* Everything split, once. */
static void rig_open(rig *r, model_shape shape) {
    static const mn_block_desc levels_5 = {.blocking = MN_BLOCKING_LEVELS, .l = 5};
    mn_status st = {0};
    memset(r, 0, sizeof *r);
    model_make(&r->m, shape, TRIANGLES, &levels_5);
    const mn_header *h = &r->m.header;
    uint32_t nodes = (h->leaves + 63) & ~63u, simplices = (uint32_t)(h->triangles + h->hinges);
    r->limits = mni_block_limits_of(h);
    mni_store_desc store = {.path = r->m.path,
                            .header = h,
                            .kind = MN_STORE_RESIDENT,
                            .check = mni_front_block_check,
                            .check_context = &r->limits};
    mn_code code = mni_arena_open(&r->arena,
                                  mni_store_need_bytes(h, MN_STORE_RESIDENT, 0) +
                                      mni_navigator_need_bytes(h, nodes, simplices),
                                  &st);
    if (code == MN_OK)
        code = mni_store_open(&store, &r->arena, &r->store, &st);
    r->nav.width_px = r->nav.height_px = 100;
    r->nav.size = 1;
    if (code == MN_OK)
        code = mni_navigator_open(&r->nav, r->store, h, nodes, simplices, &r->arena, &st);
    ck_assert_msg(code == MN_OK, "%s", st.text);
    mn_camera camera = model_camera(&r->m, 0, 3);
    mni_store_frame_begin(r->store);
    mni_navigator_frame(&r->nav, &camera, -1);
    mni_store_frame_end(r->store, 0);
    ck_assert_uint_eq(r->nav.front.active, h->leaves);
}

static void rig_close(rig *r) {
    mni_store_close(r->store);
    mni_arena_close(&r->arena);
    model_free(&r->m);
}

static float random_factor(void) {
    return model_random() % 3 == 0 ? 0 : (float)exp(model_uniform(0, 4));
}

static mni_lens random_lens(const rig *r) {
    mn_camera camera = model_camera(&r->m, model_uniform(0, 1), exp(model_uniform(-1, 3)));
    mn_weights w = {random_factor(), random_factor(), random_factor(), random_factor(), {0}};
    for (int i = 0; i < 3; i++) {
        w.light_from[i] = (float)model_uniform(-1, 1);
        if (model_random() % 2 == 0)
            camera.target[i] += (float)model_uniform(-1, 1);
    }
    mni_lens lens;
    mni_lens_make(&lens, &camera, 640, 480, mni_lens_distance_min(1), exp(model_uniform(-3, 4)),
                  &w);
    return lens;
}

START_TEST(parents_first) {
    rig r;
    uint64_t wanted = 0, unwanted = 0;
    rig_open(&r, (model_shape)_i);
    const mni_front *f = &r.nav.front;
    for (int camera = 0; camera < CAMERAS; camera++) {
        mni_lens lens = random_lens(&r);
        for (uint32_t b = 0; b < f->slots_high; b++) {
            if (!mni_front_is_branch(f, b))
                continue;
            mni_bounds node = mni_front_branch_bounds(f, b);
            bool wants = mni_lens_wants(&lens, &node);
            wanted += wants;
            unwanted += !wants;
            if (f->branch[b].parent == MNI_FRONT_NO_PARENT)
                continue;
            mni_bounds parent = mni_front_branch_bounds(f, f->branch[b].parent);
            ck_assert_msg(mni_lens_priority(&lens, &node) <=
                              mni_lens_priority(&lens, &parent) * (1 + 1e-6),
                          "branch %u", b);
            ck_assert_msg(!wants || mni_lens_wants(&lens, &parent), "branch %u", b);
        }
    }
    ck_assert(wanted > 1000 && unwanted > 1000); /* both sides were met */
    rig_close(&r);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("nested");
    TCase *tc = tcase_create("nested");
    tcase_set_timeout(tc, 120);
    tcase_add_loop_test(tc, parents_first, 0, MODEL_SHAPES);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
