/* Goal: quantised positions are the nearest of one grid, exact as floats, and losses are counted.
 * Method: random meshes of all sizes and places, against double; hand-made limits. */
#include <check.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "block.h"
#include "suite.h"
#include "tree_fixture.h"

enum { VERTICES = 500 };

/* Vertices alone: triangles stay as they are. */
static void cloud(mn_mesh *m, float *position, uint32_t vertices) {
    memset(m, 0, sizeof *m);
    m->vertices = vertices;
    m->position = position;
}

START_TEST(the_nearest_of_one_grid) {
    uint64_t seed = fixture_seed(41);
    for (int round = 0; round < 200; round++) {
        float at[3 * VERTICES], was[3 * VERTICES];
        double size = ldexp(1, (int)(fixture_random(&seed) % 100) - 60);
        double shift = round % 3 == 0 ? 30 * size : 0;
        for (int i = 0; i < 3 * VERTICES; i++)
            at[i] = (float)(size * fixture_random(&seed) * 0x1p-32 + shift);
        memcpy(was, at, sizeof was);
        mn_mesh m;
        mn_status st = {0};
        uint32_t bits = MN_POSITION_BITS_MIN + (uint32_t)round % 16;
        cloud(&m, at, VERTICES);
        ck_assert_msg(mn_mesh_quantise(&m, bits, &st) == MN_OK, "%s", st.text);
        const double step = m.grid_step;
        ck_assert(mni_grid_ok(m.grid_step));
        double span[3];
        for (int k = 0; k < 3; k++) {
            double least = INFINITY, most = -INFINITY;
            for (int v = 0; v < VERTICES; v++) {
                least = fmin(least, was[3 * v + k]);
                most = fmax(most, was[3 * v + k]);
            }
            span[k] = most - least;
        }
        double longest = fmax(span[0], fmax(span[1], span[2]));
        ck_assert(longest <= step * (1u << bits) && longest > step / 2 * (1u << bits));
        for (int i = 0; i < 3 * VERTICES; i++) {
            ck_assert(fabs((double)at[i] - was[i]) <= step / 2);
            ck_assert(rint(at[i] / step) * step == at[i]);
        }
        memcpy(was, at, sizeof was);
        ck_assert(mn_mesh_quantise(&m, bits, &st) == MN_OK); /* a multiple of a multiple */
        ck_assert(m.grid_step >= step / 2 && m.grid_step <= step);
        ck_assert_mem_eq(at, was, sizeof was);
    }
}
END_TEST

START_TEST(what_falls_together_is_counted) {
    float at[] = {0, 0, 0, 1, 1, 1, 0.001f, 0, 0, 0.002f, 0, 0, 1, 1, 1, -0.001f, 0, 0};
    mn_mesh m;
    mn_status st = {0};
    cloud(&m, at, 6);
    m.intake.merged_positions = 5;
    ck_assert(mn_mesh_quantise(&m, 8, &st) == MN_OK);    /* a step of 1/128: 1.001 is past 1 */
    ck_assert_uint_eq(m.intake.merged_positions, 5 + 3); /* two equal ones were one before */
    ck_assert(!signbit(at[15]) && at[15] == 0);
}
END_TEST

START_TEST(limits) {
    float one[] = {3, -5, 0.1f}, zero[] = {0, 0, 0, -0.0f, 0, 0},
          least[] = {0, 0, 0, 0x1p-149f, 0, 0x1p-148f};
    mn_mesh m;
    mn_status st = {0};
    cloud(&m, one, 1);
    ck_assert(mn_mesh_quantise(&m, 0, &st) == MN_OK);
    ck_assert(one[0] == 3 && one[1] == -5 && fabsf(one[2] - 0.1f) < 1e-5f);
    cloud(&m, zero, 2);
    ck_assert(mn_mesh_quantise(&m, 0, &st) == MN_OK && mni_grid_ok(m.grid_step));
    cloud(&m, least, 2);
    ck_assert(mn_mesh_quantise(&m, 16, &st) == MN_OK);
    ck_assert(m.grid_step == 0x1p-149f && least[3] == 0x1p-149f && least[5] == 0x1p-148f);
    ck_assert(mn_mesh_quantise(&m, MN_POSITION_BITS_MIN - 1, &st) == MN_USAGE);
    ck_assert(mn_mesh_quantise(&m, MN_POSITION_BITS_MAX + 1, &st) == MN_USAGE);
    ck_assert_float_ge(mn_grid_error(2), sqrtf(3));
}
END_TEST

int main(void) {
    Suite *s = suite_create("grid");
    TCase *t = tcase_create("grid");
    tcase_add_test(t, the_nearest_of_one_grid);
    tcase_add_test(t, what_falls_together_is_counted);
    tcase_add_test(t, limits);
    suite_add_tcase(s, t);
    return suite_run(s);
}
