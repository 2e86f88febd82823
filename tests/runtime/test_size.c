/* Goal: a session told of another size of the picture is as one opened at that size, also where
 * the mesh does not fit. Method: settled fronts compared by hash, on the way up and down. */
#include <check.h>

#include "model.h"
#include "suite.h"

enum { SIZES = 4, ENOUGH = 5000 };
static const uint32_t sizes[SIZES][2] = {{320, 240}, {1600, 200}, {40, 800}, {1, 1}};

static uint64_t settled(mn_session *s, const mn_camera *camera) {
    mn_frame_stats stats;
    ck_assert_uint_lt(mn_session_settle(s, camera, ENOUGH), ENOUGH);
    mn_session_frame(s, camera, &stats);
    ck_assert(!stats.changed);
    return stats.front_hash;
}

START_TEST(as_if_opened_at_that_size) {
    model m;
    const mn_block_desc blocks = {.blocking = MN_BLOCKING_LEVELS, .l = 5};
    model_make(&m, MODEL_TERRAIN, 2500, &blocks);
    mn_session_desc desc = model_desc(&m);
    const mn_camera camera = model_camera(&m, 0.1, 0.8);
    uint64_t hash[SIZES];
    for (int i = 0; i < SIZES; i++) {
        desc.width_px = sizes[i][0];
        desc.height_px = sizes[i][1];
        mn_session *s = model_open(&desc);
        hash[i] = settled(s, &camera);
        mn_session_close(s);
    }
    ck_assert(hash[0] != hash[1] && hash[0] != hash[2] && hash[2] != hash[3]);
    mn_session *s = model_open(&desc);
    for (int i = 0; i < 4 * SIZES; i++) {
        const int which = (int)(model_random() % SIZES);
        mn_session_set_size(s, sizes[which][0], sizes[which][1]);
        ck_assert_uint_eq(settled(s, &camera), hash[which]);
        mn_session_check(s);
    }
    mn_session_close(s);
    model_free(&m);
}
END_TEST

/* Resizing with a front that is full must give the level of degrading another chance. */
START_TEST(degrades_anew) {
    model m;
    const mn_block_desc blocks = {.blocking = MN_BLOCKING_LEVELS, .l = 5};
    model_make(&m, MODEL_GLOBE, 2500, &blocks);
    mn_session_desc desc = model_desc(&m);
    const mn_camera camera = model_camera(&m, 0.1, 3);
    desc.front_max = 200;
    desc.width_px = desc.height_px = 2000;
    mn_session *s = model_open(&desc);
    mn_frame_stats stats;
    settled(s, &camera);
    mn_session_frame(s, &camera, &stats);
    ck_assert_double_gt(stats.tolerance_px, 1);
    mn_session_set_size(s, 20, 20);
    settled(s, &camera);
    mn_session_frame(s, &camera, &stats);
    ck_assert_double_eq(stats.tolerance_px, 1);
    mn_session_close(s);
    model_free(&m);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("size");
    TCase *tc = tcase_create("size");
    tcase_set_timeout(tc, 60);
    tcase_add_test(tc, as_if_opened_at_that_size);
    tcase_add_test(tc, degrades_anew);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
