/* Goal: what rounds have made comes back as it was, from any group, however large its numbers.
 * Method: cells by lot, with the numbers that they could have and with the largest; all groups read
 * in reverse order and compared. Writes that fail. */
#include <check.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "block.h"
#include "history.h"
#include "suite.h"
#include "tree_fixture.h"
#include "varint.h"

START_TEST(numbers_come_back) {
    uint64_t state = fixture_seed(3);
    for (int round = 0; round < 200000; round++) {
        uint32_t shift = fixture_random(&state) % 32, wide = fixture_random(&state) % 32;
        uint32_t from = fixture_random(&state) >> wide, value = fixture_random(&state) >> shift;
        if (round % 100 == 0)
            value = round % 200 == 0 ? UINT32_MAX : 0;
        unsigned char bytes[16];
        unsigned char *end = mni_varint_put(bytes, mni_fold(value, from) * 2 + 1);
        const unsigned char *at = bytes;
        ck_assert_int_le(end - bytes, MNI_VARINT32_MAX);
        uint64_t code = mni_varint_get(&at);
        ck_assert_ptr_eq(at, end);
        ck_assert_uint_eq(code & 1, 1);
        ck_assert_uint_eq(mni_unfold(code / 2, from), value);
    }
    const uint64_t most[] = {0, 127, 128, UINT32_MAX, UINT64_MAX};
    for (size_t i = 0; i < sizeof most / sizeof *most; i++) {
        unsigned char bytes[16];
        const unsigned char *at = bytes;
        unsigned char *end = mni_varint_put(bytes, most[i]);
        ck_assert_uint_eq(mni_varint_get(&at), most[i]);
        ck_assert_ptr_eq(at, end);
    }
}
END_TEST

/* ---- cells by lot ---------------------------------------------------------------------------- */

enum { COLLAPSES = 3 * MNI_HISTORY_GROUP + 17 };

typedef struct made {
    mni_cell_collapse collapse[COLLAPSES];
    uint32_t (*killed)[3];
    uint32_t killed_count;
} made;

static float any_float(uint64_t *state) {
    float f = (float)(fixture_random(state) >> 8) / 65536;
    return fixture_random(state) % 20 == 0 ? 0 : fixture_random(state) % 20 == 0 ? f * 1e30f : f;
}

static uint32_t any_leaves(uint64_t *state, bool large) {
    return large ? 1 + fixture_random(state) / 2 : 1 + fixture_random(state) % 4;
}

static uint32_t any_split(uint64_t *state, uint32_t leaves) {
    return leaves == 1 ? 0 : 1 + fixture_random(state) % (leaves - 1);
}

/* A collapse's number bounds what it can refer to. */
static void make(made *m, uint64_t *state, bool large) {
    uint32_t room = 1 << 16;
    m->killed = malloc(room * sizeof *m->killed);
    m->killed_count = 0;
    for (uint32_t i = 0; i < COLLAPSES; i++) {
        mni_cell_collapse *c = &m->collapse[i];
        uint32_t ids = large ? MNI_COLLAPSE - 1 : COLLAPSES;
        *c = (mni_cell_collapse){.left = fixture_random(state) % ids,
                                 .right = fixture_random(state) % ids,
                                 .left_value = any_float(state),
                                 .right_value = any_float(state),
                                 .key = any_float(state),
                                 .left_leaves = any_leaves(state, large),
                                 .right_leaves = any_leaves(state, large),
                                 .simplices = fixture_random(state) % 4};
        c->bounds.radius = mni_radius_up(any_float(state));
        c->bounds.cone.axis[0] = (int8_t)fixture_random(state);
        c->bounds.cone.axis[1] = (int8_t)fixture_random(state);
        c->bounds.cone.angle = (uint8_t)fixture_random(state);
        if (i > 0 && fixture_random(state) % 2)
            c->left = MNI_COLLAPSE + fixture_random(state) % i;
        if (i > 0 && fixture_random(state) % 2)
            c->right = MNI_COLLAPSE + fixture_random(state) % i;
        if (i == 5000)
            c->simplices = 9000; /* more than any buffer holds */
        c->left_split = any_split(state, c->left_leaves);
        c->right_split = any_split(state, c->right_leaves);
        for (uint32_t k = 0; k < c->simplices; k++) {
            uint32_t *v = m->killed[m->killed_count++];
            ck_assert_uint_lt(m->killed_count, room);
            for (int j = 0; j < 3; j++)
                v[j] = fixture_random(state) % ids;
            if (v[2] == v[0] || fixture_random(state) % 10 == 0)
                v[2] = MN_NONE;
        }
    }
}

/* In cells of some size. */
static mn_code add(mni_history *h, made *m, uint64_t *state, mn_status *st) {
    uint32_t killed = 0;
    for (uint32_t from = 0; from < COLLAPSES;) {
        uint32_t count = fixture_random(state) % 3000;
        count = count < COLLAPSES - from ? count : COLLAPSES - from;
        mni_cell cell = {.collapse = m->collapse + from,
                         .collapses = count,
                         .killed = m->killed + killed,
                         .hinges = 1,
                         .s.counts = {.boundary_edges = 2, .collapses_by_stage = {count}}};
        for (uint32_t i = 0; i < count; i++)
            cell.killed_count += cell.collapse[i].simplices;
        mn_code code = mni_history_add(h, &cell, st);
        if (code != MN_OK)
            return code;
        killed += cell.killed_count;
        from += count;
    }
    return mni_history_end(h, st);
}

static void same_float(float a, float b) {
    ck_assert_msg(a == b, "%g is not %g", (double)a, (double)b);
}

static void check_group(mni_history *h, const made *m, uint32_t group, size_t buffer_bytes) {
    mni_history_reader r, killed;
    mn_status st = {0};
    unsigned char *buffer = malloc(buffer_bytes), *other = malloc(buffer_bytes);
    ck_assert(mni_history_group(&r, h, group, buffer, buffer_bytes, &st) == MN_OK);
    ck_assert(mni_history_group_killed(&killed, h, group, other, buffer_bytes, &st) == MN_OK);
    uint32_t at = 0, first = group * MNI_HISTORY_GROUP;
    for (uint32_t i = 0; i < first; i++)
        at += m->collapse[i].simplices;
    for (uint32_t i = first; i < COLLAPSES && i < first + MNI_HISTORY_GROUP; i++) {
        const mni_cell_collapse *a = &m->collapse[i];
        mni_history_collapse b;
        ck_assert(mni_history_next(&r, &b));
        ck_assert_uint_eq(a->left, b.left);
        ck_assert_uint_eq(a->right, b.right);
        ck_assert_uint_eq(a->left_leaves, b.left_leaves);
        ck_assert_uint_eq(a->right_leaves, b.right_leaves);
        ck_assert_uint_eq(a->left_split, b.left_split);
        ck_assert_uint_eq(a->right_split, b.right_split);
        ck_assert_uint_eq(a->simplices, b.simplices);
        ck_assert_mem_eq(&a->key, &b.key, sizeof b.key);
        same_float(mni_switch_up(a->left_value), mni_facts_value_of(mni_facts_left_value(b.facts)));
        same_float(mni_switch_up(a->right_value),
                   mni_facts_value_of(mni_facts_right_value(b.facts)));
        same_float(a->bounds.radius, mni_facts_radius_of(mni_facts_bounds(b.facts)));
        mn_cone cone = mni_facts_cone_of(mni_facts_bounds(b.facts));
        ck_assert_mem_eq(&a->bounds.cone, &cone, sizeof cone);
        for (uint32_t k = 0; k < a->simplices; k++) {
            uint32_t corner[3];
            ck_assert(mni_history_next_killed(&killed, corner));
            ck_assert_mem_eq(corner, m->killed[at++], sizeof corner);
        }
    }
    free(buffer);
    free(other);
}

START_TEST(any_group_comes_back) {
    uint64_t state = fixture_seed(5 + (uint64_t)_i);
    made *m = malloc(sizeof *m);
    mni_history h;
    mn_status st = {0};
    make(m, &state, _i == 1);
    ck_assert(mni_history_open(&h, ".", false, &st) == MN_OK);
    ck_assert_msg(add(&h, m, &state, &st) == MN_OK, "%s", st.text);
    ck_assert_uint_eq(h.collapses, COLLAPSES);
    ck_assert_uint_eq(h.killed_count, m->killed_count);
    ck_assert_uint_eq(h.counts.collapses_by_stage[0], COLLAPSES);
    for (uint32_t g = 4; g-- > 0;)
        check_group(&h, m, g, g % 2 ? MNI_HISTORY_BUFFER_MIN : 30000);
    mni_history_close(&h);
    mni_history_close(&h);
    free(m->killed);
    free(m);
}
END_TEST

START_TEST(a_disk_that_fills) {
    uint64_t state = fixture_seed(9);
    made *m = malloc(sizeof *m);
    mni_history h;
    mn_code code = MN_NO_SPACE;
    uint32_t failures = 0;
    struct rlimit limit;
    make(m, &state, false);
    signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &limit);
    for (rlim_t bytes = 0; code != MN_OK; bytes += bytes / 4 + 16, failures++) {
        mn_status st = {0};
        ck_assert(mni_history_open(&h, ".", false, &st) == MN_OK);
        limit.rlim_cur = bytes;
        setrlimit(RLIMIT_FSIZE, &limit);
        code = add(&h, m, &state, &st);
        limit.rlim_cur = RLIM_INFINITY;
        setrlimit(RLIMIT_FSIZE, &limit);
        ck_assert(code == MN_OK || code == MN_NO_SPACE);
        ck_assert(code == MN_OK || strstr(st.text, "--temp-dir") != NULL);
        mni_history_close(&h);
    }
    ck_assert_uint_gt(failures, 10);
    free(m->killed);
    free(m);
}
END_TEST

int main(void) {
    Suite *s = suite_create("history");
    TCase *t = tcase_create("history");
    tcase_set_timeout(t, 60);
    tcase_add_test(t, numbers_come_back);
    tcase_add_loop_test(t, any_group_comes_back, 0, 2);
    tcase_add_test(t, a_disk_that_fills);
    suite_add_tcase(s, t);
    return suite_run(s);
}
