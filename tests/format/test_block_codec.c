/* Goal: what goes into rows comes out, at every width, and a block's tally is its true size.
 * Method: rows of random values at all widths; one-node blocks of extreme values by hand; chains
 * at the depth limit and beyond. (Whole trees: build/test_block.) */
#include <check.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "block_layout.h"
#include "frame.h"
#include "suite.h"

static uint64_t state;
static uint32_t draw(void) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(state >> 32);
}

static void seed(void) {
    const char *given = getenv("MN_SEED");
    state = given != NULL ? strtoull(given, NULL, 10) : 1;
    printf("seed %llu\n", (unsigned long long)state);
}

START_TEST(every_width_round_trips) {
    enum { ROWS = 301 };
    uint32_t width = (uint32_t)_i, row = width + 1 + draw() % 40, value[ROWS];
    size_t bytes = mni_row_bytes(ROWS, row) + MNI_BLOCK_TAIL_BYTES;
    uint8_t *bits = calloc(bytes, 1); /* of its exact size, so that a sanitizer sees any more */
    for (uint32_t i = 0; i < ROWS; i++) {
        value[i] = width == 0 ? 0 : draw() >> (32 - width);
        if (i == 0 && width > 0)
            value[i] = UINT32_MAX >> (32 - width);
        mni_bits_put(bits, (uint64_t)i * row + row - width, value[i]);
        mni_bits_put(bits, (uint64_t)i * row, 1); /* another field before it */
    }
    for (uint32_t i = 0; i < ROWS; i++)
        ck_assert_uint_eq(mni_bits_get(bits, (uint64_t)i * row + row - width, width), value[i]);
    for (size_t i = bytes - MNI_BLOCK_TAIL_BYTES; i < bytes; i++)
        ck_assert_uint_eq(bits[i], 0);
    free(bits);
}
END_TEST

/* Never less, never more than one step more, monotone, and what is known already stays. */
START_TEST(lengths_are_rounded_up) {
    const float some[] = {0,        1e-45f, 1.17e-38f, 1e-20f, 0.001f,   1,
                          1.03124f, 1.99f,  0x1.fcp0f, 2,      3.14159f, 1e18f};
    for (int round = 0; round < 5000; round++) {
        float a = round < 12 ? some[round] : mni_float_of(draw() % 0x7e000000u);
        float b = mni_float_of(mni_float_bits(a) + draw() % 0x100000u);
        float s = mni_switch_up(a), r = mni_radius_up(a);
        ck_assert(s >= a && r >= s && mni_switch_up(s) == s && mni_radius_up(r) == r);
        if (a > 1e-37f) {
            ck_assert_float_le(s, a * (1 + 1 / 32.0f));
            ck_assert_float_le(r, a * (1 + 1 / 16.0f));
        }
        ck_assert(mni_switch_up(b) >= s && mni_radius_up(b) >= r);
    }
    ck_assert_float_eq(mni_switch_up(0), 0);
    ck_assert_float_eq(mni_switch_up(1.03126f), 1.0625f);
    ck_assert(isinf(mni_switch_up(3.4e38f)));
    ck_assert(mni_grid_ok(1) && mni_grid_ok(0x1p-149f) && mni_grid_ok(0x1p100f));
    ck_assert(!mni_grid_ok(0) && !mni_grid_ok(-1) && !mni_grid_ok(3) && !mni_grid_ok(NAN));
    ck_assert(!mni_grid_ok(INFINITY));
}
END_TEST

/* ---- blocks by hand ------------------------------------------------------------------------- */

static const mni_block_limits limits = {
    .leaves = 2000, .nodes = 3999, .file_bytes = 1 << 22, .grid_step = 0.5f};

static mni_facts chain_facts(uint32_t i, uint32_t nodes) {
    return (mni_facts){3998 - i, mni_switch_up((float)(nodes - i)), 10, {{0}, 0}};
}

/* A chain: node i has leaf hi - 1 - i … on its right; `nodes` of them, all leaves on the right. */
static mni_node chain_node(uint32_t i, uint32_t nodes) {
    mni_node n = {.at = {0, nodes + 1 - i, {0, 0, 0}},
                  .facts = chain_facts(i, nodes),
                  .leaf_mid = nodes - i,
                  .right_position = {1, 2, 3.5f},
                  .right_color = UINT32_MAX,
                  .left = {.kind = i + 1 < nodes ? MNI_CHILD_INNER : MNI_CHILD_LEAF, .node = i + 1},
                  .right = {.kind = MNI_CHILD_LEAF},
                  .simplex_count = 1,
                  .overflow_ref = MN_NONE};
    return n;
}

static uint32_t encode_chain(unsigned char *bytes, uint32_t length, uint32_t nodes) {
    mni_tally tally;
    mni_encoder encoder;
    mni_subtree top = {.node = 0, .leaf_lo = 0, .leaf_hi = nodes + 1};
    mni_tally_init(&tally, false, limits.grid_step);
    mni_tally_subtree(&tally, &top);
    for (uint32_t i = 0; i < nodes; i++) {
        mni_node n = chain_node(i, nodes);
        mni_tally_node(&tally, &n);
        mni_tally_simplex(&tally, (uint32_t[3]){0, nodes - i, MN_NONE});
    }
    uint64_t end = mni_tally_bytes(&tally, 0);
    ck_assert_uint_le(end + MNI_BLOCK_TAIL_BYTES, length);
    mni_encoder_begin(&encoder, bytes, length, &tally, 0);
    mni_encoder_subtree(&encoder, &top);
    for (uint32_t i = 0; i < nodes; i++) {
        mni_node n = chain_node(i, nodes);
        mni_encoder_node(&encoder, &n);
        mni_encoder_simplex(&encoder, (uint32_t[3]){0, nodes - i, MN_NONE});
    }
    mni_encoder_end(&encoder);
    mni_frame frame = {.kind = MNI_FRAME_METANODE, .payload_bytes = (uint32_t)end};
    mni_frame_seal(bytes, &frame, (mn_block_ref){1, length / MN_PAGE_BYTES}, 77);
    return (uint32_t)end;
}

START_TEST(tallies_add_up) {
    enum { NODES = 100 };
    mni_tally all, part[2];
    mni_tally_init(&all, true, 0.5f);
    mni_tally_init(&part[0], true, 0.5f);
    mni_tally_init(&part[1], true, 0.5f);
    mni_tally_merge(&part[1], &part[0]); /* of nothing */
    for (uint32_t i = 0; i < NODES; i++) {
        mni_tally *to = &part[draw() % 2];
        mni_node n = chain_node(i, NODES);
        n.right_color = draw();
        n.right_position[0] = (float)(draw() % 100000);
        n.left.kind = (mni_child_kind)(draw() % 3);
        n.left.facts = chain_facts(draw() % NODES, NODES);
        n.simplex_count = draw() % 4;
        n.overflow_ref = draw() % 50 == 0 ? 0 : MN_NONE;
        mni_subtree top = {.node = i, .leaf_lo = draw() % 1000, .leaf_hi = 1002 + draw() % 1000};
        mni_tally_node(&all, &n);
        mni_tally_node(to, &n);
        mni_tally_subtree(&all, &top);
        mni_tally_subtree(to, &top);
        for (uint32_t k = 0; k < n.simplex_count; k++) {
            uint32_t corner[3] = {draw() % 50, 50 + draw() % 50, i % 3 == 0 ? MN_NONE : draw()};
            mni_tally_simplex(&all, corner);
            mni_tally_simplex(to, corner);
        }
    }
    mni_tally_merge(&part[0], &part[1]);
    ck_assert_uint_eq(part[0].exits, all.exits);
    ck_assert_uint_eq(part[0].has_overflow, all.has_overflow);
    for (uint32_t refs = 0; refs < 300; refs += 100)
        ck_assert_uint_eq(mni_tally_bytes(&part[0], refs), mni_tally_bytes(&all, refs));
    ck_assert_mem_eq(part[0].min, all.min, sizeof all.min);
    ck_assert_mem_eq(part[0].max, all.max, sizeof all.max);
}
END_TEST

START_TEST(a_chain_may_be_so_deep_and_no_deeper) {
    enum { LENGTH = 65536 };
    unsigned char *bytes = malloc(LENGTH);
    for (uint32_t nodes = 1; nodes <= MNI_BLOCK_DEPTH_MAX + 1; nodes++) {
        char why[100] = "";
        mni_block view, again;
        encode_chain(bytes, LENGTH, nodes);
        bool fine = mni_block_open(&view, bytes, LENGTH, &limits, why, sizeof why);
        ck_assert_msg(fine == (nodes <= MNI_BLOCK_DEPTH_MAX), "%u nodes: %s", nodes, why);
        if (!fine)
            continue;
        mni_block_reopen(&again, bytes);
        ck_assert_uint_eq(again.nodes, nodes);
        mni_walk walk;
        mni_node n;
        uint32_t at, i = 0;
        mni_walk_begin(&walk, &again);
        for (; mni_walk_next(&walk, &at, &n); i++) {
            mni_node wanted = chain_node(i, nodes);
            uint32_t corner[3];
            ck_assert_uint_eq(at, i);
            ck_assert_uint_eq(n.facts.order, wanted.facts.order);
            ck_assert_uint_eq(n.leaf_mid, wanted.leaf_mid);
            ck_assert_float_eq(n.facts.switch_value, wanted.facts.switch_value);
            ck_assert_float_eq(n.right_position[2], 3.5f);
            ck_assert_uint_eq(n.right_color, UINT32_MAX);
            ck_assert_int_eq(n.left.kind, wanted.left.kind);
            ck_assert_uint_eq(n.simplex_count, 1);
            ck_assert_uint_eq(n.overflow_ref, MN_NONE);
            mni_block_simplex(&again, &n, 0, corner);
            ck_assert_uint_eq(corner[0], 0);
            ck_assert_uint_eq(corner[1], nodes - i);
            ck_assert_uint_eq(corner[2], MN_NONE);
        }
        ck_assert_uint_eq(i, nodes);
    }
    free(bytes);
}
END_TEST

START_TEST(bounds_of_the_file_are_respected) {
    enum { LENGTH = 8192 };
    static unsigned char bytes[LENGTH];
    mni_block view;
    mni_block_limits tight = limits;
    encode_chain(bytes, LENGTH, 20);
    ck_assert(mni_block_open(&view, bytes, LENGTH, &tight, NULL, 0));
    tight.leaves = 20; /* 21 are used */
    ck_assert(!mni_block_open(&view, bytes, LENGTH, &tight, NULL, 0));
    tight = limits;
    tight.nodes = 3998;
    ck_assert(!mni_block_open(&view, bytes, LENGTH, &tight, NULL, 0));
    tight = limits;
    tight.has_colors = true;
    ck_assert(!mni_block_open(&view, bytes, LENGTH, &tight, NULL, 0));
    tight = limits;
    tight.grid_step = 1;
    ck_assert(!mni_block_open(&view, bytes, LENGTH, &tight, NULL, 0));
}
END_TEST

/* Values that count from more than the format's numbers can be. */
START_TEST(bases_have_bounds) {
    static const struct {
        uint32_t base, most;
    } bounds[] = {{BASE_SWITCH, 8191}, {BASE_RADIUS, 4095}, {BASE_AXIS, 255}, {BASE_ANGLE, 255}};
    enum { LENGTH = 4096 };
    for (size_t i = 0; i < sizeof bounds / sizeof bounds[0]; i++) {
        unsigned char bytes[LENGTH];
        char why[100] = "";
        mni_block view;
        encode_chain(bytes, LENGTH, 20);
        unsigned char *base = bytes + mni_frame_payload_at(0) + MNI_HEAD_BASE + 4 * bounds[i].base;
        uint32_t over = bounds[i].most + 1;
        memcpy(base, &over, sizeof over);
        ck_assert(!mni_block_open(&view, bytes, LENGTH, &limits, why, sizeof why));
        ck_assert_msg(strstr(why, "count from") != NULL, "%s", why);
    }
}
END_TEST

/* A length that cuts the block: never sound, never read beyond (a sanitizer sees to that). */
START_TEST(a_cut_block_is_refused) {
    enum { LENGTH = 4096 };
    unsigned char whole[LENGTH];
    uint32_t end = encode_chain(whole, LENGTH, 30);
    for (uint32_t length = MNI_FRAME_BYTES; length < end + MNI_BLOCK_TAIL_BYTES; length++) {
        unsigned char *cut = malloc(length);
        mni_block view;
        memcpy(cut, whole, length);
        ck_assert(!mni_block_open(&view, cut, length, &limits, NULL, 0));
        free(cut);
    }
}
END_TEST

/* A node with many simplices, whose third corners are near but for a few, on both sides, or none.
 */
START_TEST(third_corners_near_and_far) {
    enum { COUNT = 400, LENGTH = 8192, LO = 1000 };
    static unsigned char bytes[LENGTH];
    static uint32_t corner[COUNT][3];
    const mni_node node = {.at = {LO, LO + 2, {0, 0, 0}},
                           .facts = chain_facts(0, 1),
                           .leaf_mid = LO + 1,
                           .simplex_count = COUNT,
                           .overflow_ref = MN_NONE};
    const mni_subtree top = {.node = 0, .leaf_lo = LO, .leaf_hi = LO + 2};
    uint32_t far = (uint32_t)_i; /* of a hundred */
    mni_tally tally;
    mni_encoder encoder;
    mni_tally_init(&tally, false, limits.grid_step);
    mni_tally_subtree(&tally, &top);
    mni_tally_node(&tally, &node);
    for (uint32_t i = 0; i < COUNT; i++) {
        uint32_t away = 1 + draw() % (draw() % 100 < far ? 990 : 8);
        corner[i][0] = LO + i % 2;
        corner[i][1] = LO + 1 - i % 2;
        corner[i][2] = draw() % 9 == 0 ? MN_NONE : draw() % 2 ? LO - away : LO + 1 + away;
        mni_tally_simplex(&tally, corner[i]);
    }
    uint64_t end = mni_tally_bytes(&tally, 0);
    mni_encoder_begin(&encoder, bytes, LENGTH, &tally, 0);
    mni_encoder_subtree(&encoder, &top);
    mni_encoder_node(&encoder, &node);
    for (uint32_t i = 0; i < COUNT; i++)
        mni_encoder_simplex(&encoder, corner[i]);
    mni_encoder_end(&encoder);
    mni_frame frame = {.kind = MNI_FRAME_METANODE, .payload_bytes = (uint32_t)end};
    mni_frame_seal(bytes, &frame, (mn_block_ref){1, LENGTH / MN_PAGE_BYTES}, 77);
    mni_block view;
    mni_node got;
    char why[100] = "";
    ck_assert_msg(mni_block_open(&view, bytes, LENGTH, &limits, why, sizeof why), "%s", why);
    if (far < 20 || far > 50) /* few of many are worth rows */
        ck_assert_int_eq(view.far > 0, far > 0 && far < 20);
    mni_block_node(&view, 0, &node.at, &got);
    ck_assert_uint_eq(got.simplex_count, COUNT);
    for (uint32_t i = 0; i < COUNT; i++) {
        uint32_t back[3];
        mni_block_simplex(&view, &got, i, back);
        ck_assert_mem_eq(back, corner[i], sizeof back);
    }
    if (view.far == 0)
        return;
    uint32_t wrong = view.far - 1; /* the head's count: one row too few, and the payload with it */
    memcpy(bytes + mni_frame_payload_at(0) + MNI_HEAD_FAR, &wrong, sizeof wrong);
    frame.payload_bytes -=
        (uint32_t)(mni_row_bytes(view.far, view.far_bits) - mni_row_bytes(wrong, view.far_bits));
    mni_frame_seal(bytes, &frame, (mn_block_ref){1, LENGTH / MN_PAGE_BYTES}, 77);
    ck_assert(!mni_block_open(&view, bytes, LENGTH, &limits, why, sizeof why));
    ck_assert_msg(strstr(why, "far row") != NULL, "%s", why);
}
END_TEST

/* Widths, bases and rows of anything: what the short way reads, the long one reads as well. Rows
 * that a place leads to stay in the block's first 16 KiB. */
static void any_head(uint8_t *payload, uint32_t nodes, bool colors) {
    static const uint8_t most[FIELDS] = {32, 13, 12, 8, 8, 8, 20, 12, 12, 12, 8, 8, 8, 8, 2,  4,
                                         5,  8,  2,  3, 0, 1, 18, 18, 18, 0,  6, 6, 0, 7, 32, 9};
    const uint32_t count[5] = {nodes, 8, 40, draw() % 8,
                               (colors ? MNI_FLAG_COLORS : 0) | 31u << 8 | (draw() % 33) << 16};
    static const uint32_t base_most[] = {UINT32_MAX, 8191, 4095, 255, 255, 255};
    uint16_t edge[FIELDS + 1] = {0};
    for (uint32_t f = 0; f < FIELDS; f++) {
        bool whole = f == FIELD_TURN || draw() % 4 == 0 || (f == FIELD_EXITS && draw() % 4 > 0);
        uint32_t width = whole ? most[f] : draw() % (most[f] + 1u);
        if (!colors && f >= FIELD_COLOR && f < FIELD_EXITS)
            width = 0;
        if (f == FIELD_TURN || f == FIELD_NODE)
            edge[f] = 0;
        if (f == FIELD_REF)
            edge[f] = edge[FIELD_LEFT];
        edge[f + 1] = (uint16_t)(edge[f] + width);
    }
    memcpy(payload, count, sizeof count);
    memcpy(payload + MNI_HEAD_STEP, &limits.grid_step, sizeof limits.grid_step);
    for (uint32_t b = 0; b < BASES; b++) {
        uint32_t base = b < BASE_DELTA ? draw() % base_most[b] : draw();
        memcpy(payload + MNI_HEAD_BASE + 4 * (size_t)b, &base, sizeof base);
    }
    memcpy(payload + MNI_HEAD_EDGE, edge, 2 * FIELDS);
}

static void same_child(const mni_child *a, const mni_child *b) {
    ck_assert(a->kind == b->kind && a->node == b->node && a->exit == b->exit);
    if (a->kind != MNI_CHILD_LEAF)
        ck_assert(mni_facts_equal(&a->facts, &b->facts) || isnan(a->facts.switch_value) ||
                  isnan(a->facts.radius));
}

START_TEST(the_short_way_reads_the_same) {
    enum { LENGTH = 1 << 15, NODES = 20 };
    static uint8_t payload[LENGTH];
    uint32_t shorts = 0;
    for (int round = 0; round < 3000; round++) {
        for (size_t i = 0; i < LENGTH; i++)
            payload[i] = (uint8_t)draw();
        any_head(payload, NODES, round % 2);
        mni_block fast, slow;
        mni_block_layout(&fast, payload);
        slow = fast;
        slow.is_short = false;
        shorts += fast.is_short;
        mni_place at = {draw() % 1000, 1u << 21, {1, 2, 3}};
        for (uint32_t node = 0; node < NODES; node++) {
            mni_node a, b;
            mni_block_split(&fast, node, &at, &a);
            mni_block_split(&slow, node, &at, &b);
            mni_block_children(&fast, &a);
            mni_block_children(&slow, &b);
            same_child(&a.left, &b.left);
            same_child(&a.right, &b.right);
            ck_assert(a.leaf_mid == b.leaf_mid && a.right_color == b.right_color);
            ck_assert_mem_eq(a.right_position, b.right_position, sizeof a.right_position);
            ck_assert(a.simplex_count == b.simplex_count && a.overflow_ref == b.overflow_ref);
            a.simplex_count = b.simplex_count = MNI_INLINE;
            for (uint32_t i = 0; i < MNI_INLINE; i++) {
                uint32_t x[3], y[3];
                mni_block_simplex(&fast, &a, i, x);
                mni_block_simplex(&slow, &b, i, y);
                ck_assert_mem_eq(x, y, sizeof x);
            }
        }
    }
    ck_assert(shorts == 0 || shorts > 100); /* 0: a processor that has no such instructions */
}
END_TEST

START_TEST(overflow_blocks_hold_what_fits) {
    enum { COUNT = 5000, LENGTH = 8192 };
    static uint32_t corner[3 * COUNT];
    static unsigned char bytes[LENGTH];
    for (uint32_t i = 0; i < COUNT; i++) {
        corner[3 * i] = draw() % 50;
        corner[3 * i + 1] = 50 + draw() % 50;
        corner[3 * i + 2] = i % 7 == 0 ? MN_NONE : 100 + draw() % 1900;
    }
    mni_overflow head = {.order = 2500, .leaf_lo = 0, .leaf_mid = 50, .leaf_hi = 100};
    uint32_t fit = mni_overflow_fit(&head, corner, COUNT, LENGTH);
    ck_assert_uint_gt(fit, LENGTH / 13);
    ck_assert_uint_lt(fit, COUNT);
    uint32_t end = mni_overflow_encode(bytes, LENGTH, 1, &head, corner, fit);
    ck_assert_uint_eq(end, mni_overflow_bytes(&head, corner, fit, 1));
    ck_assert_uint_gt(mni_overflow_bytes(&head, corner, fit + 1, 1), LENGTH - MNI_BLOCK_TAIL_BYTES);
    mni_frame frame = {.kind = MNI_FRAME_OVERFLOW, .refs = 1, .payload_bytes = end};
    mni_frame_set_ref(bytes, 0, (mn_block_ref){9, 1});
    mni_frame_seal(bytes, &frame, (mn_block_ref){5, 2}, 77);
    mni_overflow view;
    char why[100] = "";
    ck_assert_msg(mni_overflow_open(&view, bytes, LENGTH, &limits, why, sizeof why), "%s", why);
    ck_assert_uint_eq(view.simplices, fit);
    ck_assert_uint_eq(view.leaf_mid, 50);
    for (uint32_t i = 0; i < fit; i++) {
        uint32_t got[3];
        mni_overflow_simplex(&view, i, got);
        ck_assert(memcmp(got, corner + 3 * i, sizeof got) == 0);
    }
    mni_block meta;
    ck_assert(!mni_block_open(&meta, bytes, LENGTH, &limits, NULL, 0)); /* another kind */
}
END_TEST

int main(void) {
    Suite *s = suite_create("block codec");
    TCase *t = tcase_create("codec");
    tcase_add_unchecked_fixture(t, seed, NULL);
    tcase_add_loop_test(t, every_width_round_trips, 0, 33);
    tcase_add_test(t, lengths_are_rounded_up);
    tcase_add_test(t, tallies_add_up);
    tcase_add_test(t, a_chain_may_be_so_deep_and_no_deeper);
    tcase_add_test(t, bounds_of_the_file_are_respected);
    tcase_add_test(t, bases_have_bounds);
    tcase_add_test(t, a_cut_block_is_refused);
    tcase_add_loop_test(t, third_corners_near_and_far, 0, 90);
    tcase_add_test(t, the_short_way_reads_the_same);
    tcase_add_test(t, overflow_blocks_hold_what_fits);
    suite_add_tcase(s, t);
    return suite_run(s);
}
