/* Goal: records between rounds lose no more than their header says, and no more the next time.
 * Method: seeded random vertices, simplices and sights, there and back; vertices twice. */
#include <check.h>
#include <math.h>
#include <string.h>

#include "suite.h"
#include "tree_fixture.h"
#include "varint.h"
#include "wire.h"

enum { TIMES = 20000 };

static double unit(uint64_t *state) {
    return fixture_random(state) * 0x1p-31 - 1;
}

static float random_step(uint64_t *state) {
    return fixture_random(state) % 4 == 0 ? 0 : ldexpf(1, (int)(fixture_random(state) % 30) - 20);
}

/* On the grid, if there is one. */
static void random_place(uint64_t *state, float step, float p[3]) {
    for (int c = 0; c < 3; c++)
        p[c] = step == 0 ? (float)unit(state) : rintf(65536 * (float)unit(state)) * step;
}

static void random_quadric(uint64_t *state, bool is_node, double quadric[10]) {
    double scale = ldexp(1, (int)(fixture_random(state) % 200) - 100);
    for (int f = 0; f < 10; f++)
        if (is_node || (f >= 1 && f <= 6))
            quadric[f] = fixture_random(state) % 8 == 0 ? 0 : scale * unit(state);
}

static void random_witnesses(uint64_t *state, mni_wire_vertex *v) {
    int count = (int)(fixture_random(state) % (MNI_WITNESSES + 1));
    float reach = ldexpf(1, (int)(fixture_random(state) % 60) - 30);
    for (int w = 0; w < MNI_WITNESSES; w++) {
        bool flat = fixture_random(state) % 4 == 0;
        v->points.x[w] = v->p[0] + reach * (float)unit(state);
        v->points.y[w] = v->p[1] + reach * (float)unit(state);
        v->points.z[w] = flat ? v->p[2] : v->p[2] + reach * (float)unit(state);
        v->points.slack[w] = w >= count ? -1 : reach * (float)fabs(unit(state));
        if (w < count && v->node < MNI_COLLAPSE)
            v->points.slack[w] = 0;
    }
}

static mni_wire_vertex random_vertex(uint64_t *state, uint32_t tile, float step) {
    bool is_node = fixture_random(state) % 2, moved = fixture_random(state) % 4 == 0;
    uint32_t id = fixture_random(state) % MNI_COLLAPSE;
    mni_wire_vertex v = {.id = id, .node = id, .leaves = 1, .levels = 1, .reach = {tile, tile}};
    if (is_node) {
        v.node = MNI_COLLAPSE | fixture_random(state);
        v.leaves = 2 + fixture_random(state) % 100000;
        v.split = 1 + fixture_random(state) % (v.leaves - 1);
        v.levels = 1 + fixture_random(state) % v.leaves;
    }
    if (fixture_random(state) % 3 == 0)
        v.reach = (mni_wire_reach){tile - fixture_random(state) % 300,
                                   tile + fixture_random(state) % 300};
    random_place(state, step, v.p);
    if (is_node || moved) {
        v.value = (float)fabs(unit(state));
        v.key = (float)fabs(unit(state));
    }
    v.bounds.radius = (float)fabs(unit(state));
    v.bounds.cone = (mn_cone){{(int8_t)fixture_random(state), (int8_t)fixture_random(state)},
                              (uint8_t)fixture_random(state)};
    random_quadric(state, is_node, v.quadric);
    random_witnesses(state, &v);
    return v;
}

static void check_witnesses(const mni_wire_vertex *was, const mni_wire_vertex *is) {
    const float *const of_was[] = {was->points.x, was->points.y, was->points.z};
    const float *const of_is[] = {is->points.x, is->points.y, is->points.z};
    float farthest = 0;
    for (int w = 0; w < MNI_WITNESSES && was->points.slack[w] >= 0; w++)
        for (int c = 0; c < 3; c++)
            farthest = fmaxf(farthest, fabsf(of_was[c][w] - was->p[c]));
    for (int w = 0; w < MNI_WITNESSES; w++) {
        float slack = was->points.slack[w];
        if (slack < 0) {
            ck_assert(is->points.slack[w] < 0);
            continue;
        }
        ck_assert(is->points.slack[w] >= slack && is->points.slack[w] <= slack * 1.008f);
        for (int c = 0; c < 3; c++) {
            float rounding = 1e-7f * (fabsf(was->p[c]) + farthest);
            ck_assert_float_le(fabsf(of_is[c][w] - of_was[c][w]), farthest / 32767 + rounding);
            if (of_was[c][w] == was->p[c]) /* what is flat stays flat */
                ck_assert(of_is[c][w] == was->p[c]);
        }
    }
}

static void check_quadric(const double *was, const double *is, int first, int count) {
    double largest = 0;
    for (int f = first; f < first + count; f++)
        largest = fmax(largest, fabs(was[f]));
    for (int f = first; f < first + count; f++)
        ck_assert_double_le(fabs(is[f] - was[f]), ldexp(largest, -30));
}

static void check_vertex(const mni_wire_vertex *was, const mni_wire_vertex *is) {
    ck_assert_uint_eq(is->id, was->id);
    ck_assert_uint_eq(is->node, was->node);
    ck_assert(is->leaves == was->leaves && is->split == was->split && is->levels == was->levels);
    ck_assert(is->reach.low == was->reach.low && is->reach.high == was->reach.high);
    ck_assert_mem_eq(is->p, was->p, sizeof is->p);
    ck_assert(is->value >= was->value && is->value <= was->value * 1.008f);
    ck_assert(is->key == was->key);
    ck_assert_mem_eq(&is->bounds, &was->bounds, sizeof is->bounds);
    check_quadric(was->quadric, is->quadric, 0, 1);
    check_quadric(was->quadric, is->quadric, 1, 6);
    check_quadric(was->quadric, is->quadric, 7, 3);
    check_witnesses(was, is);
}

/* Of which some are leaves, some nodes; with a grid and without. */
START_TEST(vertices) {
    enum { COUNT = 50 };
    uint64_t state = fixture_seed(61);
    static unsigned char bytes[COUNT * (MNI_WIRE_ID_MAX + MNI_WIRE_VERTEX_MAX) + MNI_VARINT_WINDOW];
    for (int i = 0; i < TIMES / COUNT; i++) {
        uint32_t tile = 300 + fixture_random(&state) % 100000;
        float step = random_step(&state);
        mni_wire_vertex was[COUNT], is[COUNT];
        unsigned char *end = bytes;
        const unsigned char *at = bytes;
        mni_wire_pen pen = mni_wire_pen_open(tile, step);
        for (int k = 0; k < COUNT; k++) {
            was[k] = random_vertex(&state, tile, step);
            unsigned char *id_end = mni_wire_put_id(&pen, end, was[k].id);
            ck_assert_int_le(id_end - end, MNI_WIRE_ID_MAX);
            end = mni_wire_put_vertex(&pen, id_end, &was[k]);
            ck_assert_int_le(end - id_end, MNI_WIRE_VERTEX_MAX);
        }
        for (int again = 0; again < 2; again++) { /* what came once comes again as it is */
            pen = mni_wire_pen_open(tile, step);
            for (int k = 0; k < COUNT; k++) {
                uint32_t id = mni_wire_get_id(&pen, &at);
                mni_wire_get_vertex(&pen, &at, id, &is[k]);
                check_vertex(&was[k], &is[k]);
                if (again == 1)
                    ck_assert_mem_eq(is[k].quadric, was[k].quadric, sizeof is[k].quadric);
            }
            ck_assert_ptr_eq(at, end);
            memcpy(was, is, sizeof was);
            at = end = bytes;
            pen = mni_wire_pen_open(tile, step);
            for (int k = 0; k < COUNT; k++)
                end = mni_wire_put_vertex(&pen, mni_wire_put_id(&pen, end, was[k].id), &was[k]);
        }
    }
}
END_TEST

static mni_wire_simplex random_simplex(uint64_t *state, uint32_t tile, float step) {
    mni_wire_simplex x = {.reach = {tile, tile}, .v[2] = MN_NONE, .origin[2] = MN_NONE};
    bool is_hinge = fixture_random(state) % 4 == 0;
    double n[3] = {unit(state), unit(state), unit(state)};
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int c = 0; c < (is_hinge ? 2 : 3); c++) {
        x.v[c] = fixture_random(state) % MNI_COLLAPSE;
        x.origin[c] = fixture_random(state) % 2 ? x.v[c] : fixture_random(state) % MNI_COLLAPSE;
        random_place(state, step, x.p[c]);
    }
    if (fixture_random(state) % 2)
        x.reach.high += 1 + fixture_random(state) % 300;
    for (int c = 0; c < 3 && !is_hinge && fixture_random(state) % 8 > 0; c++)
        x.normal[c] = (float)(n[c] / length);
    return x;
}

START_TEST(simplices) {
    enum { COUNT = 50 };
    uint64_t state = fixture_seed(63);
    static unsigned char bytes[COUNT * MNI_WIRE_SIMPLEX_MAX + MNI_VARINT_WINDOW];
    for (int i = 0; i < TIMES / COUNT; i++) {
        uint32_t tile = fixture_random(&state) % 100000;
        float step = random_step(&state);
        mni_wire_simplex was[COUNT], is;
        unsigned char *end = bytes;
        const unsigned char *at = bytes;
        mni_wire_pen pen = mni_wire_pen_open(tile, step);
        for (int k = 0; k < COUNT; k++) {
            unsigned char *before = end;
            was[k] = random_simplex(&state, tile, step);
            end = mni_wire_put_simplex(&pen, end, &was[k]);
            ck_assert_int_le(end - before, MNI_WIRE_SIMPLEX_MAX);
        }
        pen = mni_wire_pen_open(tile, step);
        for (int k = 0; k < COUNT; k++) {
            mni_wire_get_simplex(&pen, &at, &is);
            ck_assert_mem_eq(is.v, was[k].v, sizeof is.v);
            ck_assert_mem_eq(is.origin, was[k].origin, sizeof is.origin);
            ck_assert_mem_eq(&is.reach, &was[k].reach, sizeof is.reach);
            if (is.reach.low < is.reach.high)
                ck_assert_mem_eq(is.p, was[k].p, (is.v[2] == MN_NONE ? 2 : 3) * sizeof is.p[0]);
            for (int c = 0; c < 3; c++)
                ck_assert_float_le(fabsf(is.normal[c] - was[k].normal[c]), 1.0f / 32767);
        }
        ck_assert_ptr_eq(at, end);
    }
}
END_TEST

/* Of all lengths that are taken without a branch, whatever stands behind them. */
START_TEST(numbers) {
    uint64_t state = fixture_seed(65);
    for (int i = 0; i < TIMES; i++) {
        const uint32_t bits = fixture_random(&state) % 57;
        const uint64_t any = (uint64_t)fixture_random(&state) << 32 | fixture_random(&state);
        const uint64_t most = (UINT64_C(1) << bits) - 1, value = i % 4 == 0 ? most : any & most;
        unsigned char bytes[2 * MNI_VARINT_WINDOW];
        memset(bytes, i % 3 == 0 ? 0x80 : i % 3 == 1 ? 0xff : 0, sizeof bytes);
        const unsigned char *end = mni_varint_put(bytes, value), *at = bytes;
        ck_assert_uint_eq(mni_varint_take(&at), value);
        ck_assert_ptr_eq(at, end);
    }
}
END_TEST

START_TEST(sights) {
    enum { COUNT = 50 };
    uint64_t state = fixture_seed(64);
    unsigned char bytes[COUNT * MNI_WIRE_SIGHT_MAX + MNI_VARINT_WINDOW], *end = bytes;
    const unsigned char *at = bytes;
    mni_wire_sight was[COUNT], is;
    mni_wire_pen pen = mni_wire_pen_open(400, 0);
    for (int k = 0; k < COUNT; k++) {
        uint32_t low = fixture_random(&state) % 1000;
        was[k] = (mni_wire_sight){fixture_random(&state), {low, low + fixture_random(&state) % 99}};
        end = mni_wire_put_sight(&pen, end, &was[k]);
    }
    pen = mni_wire_pen_open(400, 0);
    for (int k = 0; k < COUNT; k++) {
        mni_wire_get_sight(&pen, &at, &is);
        ck_assert_mem_eq(&is, &was[k], sizeof is);
    }
    ck_assert_ptr_eq(at, end);
}
END_TEST

START_TEST(what_is_on_the_grid) {
    const struct {
        float p[3], step;
        bool is;
    } of[] = {{{1, -2, 0}, 1, true},
              {{1, -2, 0.5f}, 1, false},
              {{1, -2, 0.5f}, 0.5f, true},
              {{16777215, 0, 0}, 1, true},
              {{0, -16777215, 0}, 1, true},
              {{0, 16777216, 0}, 1, false},
              {{0x1p-120f, 0, 0}, 1, false},
              {{3 * 0x1p-120f, 0, 0}, 0x1p-120f, true},
              {{INFINITY, 0, 0}, 1, false},
              {{0x1p60f, 0, 0}, 0x1p40f, true},
              {{1, 0x1p-24f, 0}, 0x1p-24f, false}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        ck_assert_msg(mni_wire_on_grid(of[i].p, of[i].step) == of[i].is, "%zu", i);
}
END_TEST

int main(void) {
    Suite *s = suite_create("wire");
    TCase *t = tcase_create("wire");
    tcase_add_test(t, vertices);
    tcase_add_test(t, simplices);
    tcase_add_test(t, sights);
    tcase_add_test(t, numbers);
    tcase_add_test(t, what_is_on_the_grid);
    suite_add_tcase(s, t);
    return suite_run(s);
}
