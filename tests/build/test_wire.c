/* Goal: records between rounds lose no more than their header says, and no more the next time.
 * Method: seeded random quadrics, witnesses and normals, there and back, twice. */
#include <check.h>
#include <math.h>
#include <string.h>

#include "suite.h"
#include "tree_fixture.h"
#include "wire.h"

enum { TIMES = 20000 };

static double unit(uint64_t *state) {
    return fixture_random(state) * 0x1p-31 - 1;
}

START_TEST(quadrics) {
    uint64_t state = fixture_seed(61);
    for (int i = 0; i < TIMES; i++) {
        mni_vertex was = {0}, is = {0}, again = {0};
        mni_wire_vertex wire = {0};
        double scale = ldexp(1, (int)(fixture_random(&state) % 200) - 100);
        double *field[] = {&was.c,  &was.xx, &was.yy, &was.zz, &was.xy,
                           &was.xz, &was.yz, &was.x,  &was.y,  &was.z};
        for (int f = 0; f < 10; f++)
            *field[f] = fixture_random(&state) % 8 == 0 ? 0 : scale * unit(&state);
        mni_wire_put_quadric(&wire, &was);
        mni_wire_get_quadric(&wire, &is);
        const double of_was[] = {was.c,  was.xx, was.yy, was.zz, was.xy,
                                 was.xz, was.yz, was.x,  was.y,  was.z};
        const double of_is[] = {is.c, is.xx, is.yy, is.zz, is.xy, is.xz, is.yz, is.x, is.y, is.z};
        for (int f = 0; f < 10; f++)
            ck_assert_double_le(fabs(of_is[f] - of_was[f]), ldexp(fabs(of_was[f]), -37));
        mni_wire_put_quadric(&wire, &is);
        mni_wire_get_quadric(&wire, &again);
        ck_assert_mem_eq(&is, &again, sizeof is);
    }
}
END_TEST

START_TEST(witnesses) {
    uint64_t state = fixture_seed(62);
    for (int i = 0; i < TIMES; i++) {
        mni_wire_vertex wire = {0};
        mni_witnesses was, is;
        int count = (int)(fixture_random(&state) % (MNI_WITNESSES + 1));
        float reach = ldexpf(1, (int)(fixture_random(&state) % 60) - 30), farthest = 0;
        for (int c = 0; c < 3; c++)
            wire.p[c] = reach * (float)unit(&state);
        for (int w = 0; w < MNI_WITNESSES; w++) {
            bool flat = fixture_random(&state) % 4 == 0;
            was.x[w] = wire.p[0] + reach * (float)unit(&state);
            was.y[w] = wire.p[1] + reach * (float)unit(&state);
            was.z[w] = flat ? wire.p[2] : wire.p[2] + reach * (float)unit(&state);
            was.slack[w] = w >= count ? -1 : flat ? 0 : reach * (float)fabs(unit(&state));
            if (w < count)
                farthest =
                    fmaxf(farthest,
                          fmaxf(fabsf(was.x[w] - wire.p[0]),
                                fmaxf(fabsf(was.y[w] - wire.p[1]), fabsf(was.z[w] - wire.p[2]))));
        }
        mni_wire_put_witnesses(&wire, &was);
        mni_wire_get_witnesses(&wire, &is);
        float most = farthest / 32767 + 4e-7f * reach;
        for (int w = 0; w < MNI_WITNESSES; w++) {
            if (w >= count) {
                ck_assert(is.slack[w] < 0);
                continue;
            }
            ck_assert_float_le(fabsf(is.x[w] - was.x[w]), most);
            ck_assert_float_le(fabsf(is.y[w] - was.y[w]), most);
            ck_assert_float_le(fabsf(is.z[w] - was.z[w]), most);
            ck_assert(is.slack[w] >= was.slack[w] && is.slack[w] <= was.slack[w] * 1.008f);
            if (was.z[w] == wire.p[2]) /* what is flat stays flat */
                ck_assert(is.z[w] == was.z[w]);
        }
    }
}
END_TEST

START_TEST(normals) {
    uint64_t state = fixture_seed(63);
    for (int i = 0; i < TIMES; i++) {
        mni_wire_simplex wire;
        double n[3] = {unit(&state), unit(&state), unit(&state)};
        double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        float was[3], is[3];
        for (int c = 0; c < 3; c++)
            was[c] = i == 0 ? 0 : (float)(n[c] / length);
        mni_wire_put_normal(&wire, was);
        mni_wire_get_normal(&wire, is);
        for (int c = 0; c < 3; c++)
            ck_assert_float_le(fabsf(is[c] - was[c]), 1.0f / 32767);
        if (i == 0)
            ck_assert(is[0] == 0 && is[1] == 0 && is[2] == 0);
    }
}
END_TEST

static uint64_t random_key(uint64_t *state) {
    uint64_t key = (uint64_t)fixture_random(state) << 31 ^ fixture_random(state);
    return key >> fixture_random(state) % 63;
}

/* What is inside is inside; of what is near the cell's ends nothing is forgotten. */
START_TEST(reaches) {
    uint64_t state = fixture_seed(64);
    for (int i = 0; i < TIMES; i++) {
        uint64_t key = random_key(&state), apart[2] = {random_key(&state), random_key(&state)};
        mni_wire_range range = {key, key};
        mni_wire_widen(&range, (mni_wire_range){key - (apart[0] < key ? apart[0] : key), key});
        mni_wire_widen(&range, (mni_wire_range){key, key + apart[1] / 2});
        mni_wire_reach reach = mni_wire_reach_of(key, range);
        for (int at = 0; at < 2; at++) {
            uint64_t far = UINT64_MAX >> 1, edge = at == 0 ? range.low : range.high;
            uint64_t more = edge / 1000 + 1;
            if (at == 0) {
                ck_assert(!mni_wire_inside(key, reach, range.low, far + 1));
                if (range.low > 0 && range.high < far && (key - range.low) < 1 << 24)
                    ck_assert(mni_wire_inside(key, reach, range.low - 1, far + 1));
            } else {
                ck_assert(!mni_wire_inside(key, reach, 0, range.high));
                if (range.low > 0)
                    ck_assert(mni_wire_inside(key, reach, 0, range.high + more) || range.low < 128);
            }
        }
    }
    mni_wire_reach none = mni_wire_reach_of(7, mni_wire_nothing);
    ck_assert(none.below == 0 && none.above == 0);
}
END_TEST

int main(void) {
    Suite *s = suite_create("wire");
    TCase *t = tcase_create("wire");
    tcase_add_test(t, quadrics);
    tcase_add_test(t, witnesses);
    tcase_add_test(t, normals);
    tcase_add_test(t, reaches);
    suite_add_tcase(s, t);
    return suite_run(s);
}
