/* Goal: every plan stays under its cap, and the cap that a refusal names is the smallest that
 * works. Method: made headers of files of all sizes, caps from tiny to huge, each kind of K. */
#include <check.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "navigate.h"
#include "ram_plan.h"
#include "suite.h"

static mn_header header_of(uint32_t leaves, uint32_t block_bytes) {
    uint64_t bytes = (uint64_t)leaves * 40;
    mn_header h = {.leaves = leaves,
                   .nodes = leaves > UINT32_MAX / 2 ? UINT32_MAX : 2 * leaves - 1,
                   .triangles = 2 * (uint64_t)leaves,
                   .block_bytes_max = block_bytes,
                   .block_bytes = block_bytes,
                   .blocks = (uint32_t)(bytes / block_bytes) + 1,
                   .block_depth = 6,
                   .children_max = 40,
                   .nodes_per_block_max = 500,
                   .roots = 1};
    h.file_bytes = ((uint64_t)h.blocks + 1) * block_bytes;
    h.root[0] = (mn_root){.block = {1, block_bytes / 4096}};
    return h;
}

static void check_plan(const mn_plan *p, const mn_header *h, uint64_t ram_bytes) {
    ck_assert(ram_bytes == 0 || p->planned_bytes <= ram_bytes);
    ck_assert_uint_eq(p->planned_bytes,
                      p->base_bytes + p->pool_bytes + p->front_bytes + p->tables_bytes);
    ck_assert_uint_ge(p->k, p->k_min);
    ck_assert(p->front_max >= h->roots && p->front_max <= h->leaves);
    ck_assert(p->front_max < MNI_FRONT_NO_PARENT && p->simplices_max <= UINT32_MAX / 4);
    ck_assert(p->simplices_max <= h->triangles + h->hinges);
    ck_assert(p->front_max < h->leaves || p->simplices_max == h->triangles + h->hinges);
    ck_assert_uint_le(mni_ram_plan_arena_bytes(p, h, MN_STORE_PAGED) + p->base_bytes,
                      p->planned_bytes);
}

START_TEST(under_every_cap) {
    static const uint32_t leaves[] = {3, 1000, 50000, 2000000, 2000000000};
    static const uint32_t blocks[] = {4096, 16384, 1 << 20};
    uint32_t refused = 0, made = 0;
    for (int i = 0; i < 5; i++) {
        for (int b = 0; b < 3; b++) {
            mn_header h = header_of(leaves[i], blocks[b]);
            for (uint64_t ram = 1 << 20; ram <= UINT64_C(1) << 40; ram += ram / 3) {
                mni_ram_plan_desc desc = {.ram_bytes = ram, .k = (int64_t)(ram % 3) - 1};
                desc.k = desc.k == 1 ? 100 : desc.k;
                mn_plan plan;
                mn_code code = mni_ram_plan_make(&desc, &h, &plan, NULL);
                ck_assert(code == MN_OK || code == MN_CAP_TOO_SMALL);
                refused += code != MN_OK;
                made += code == MN_OK;
                if (code == MN_OK)
                    check_plan(&plan, &h, ram);
            }
        }
    }
    ck_assert(refused > 20 && made > 200);
}
END_TEST

/* The number in the message works, and a KiB less does not. */
START_TEST(named_cap_works) {
    static const int64_t rules[] = {MN_K_FROM_RAM, MN_K_MIN, 50, 3000};
    mn_header h = header_of(500000, 16384);
    for (int i = 0; i < 4; i++) {
        mni_ram_plan_desc desc = {.ram_bytes = 1 << 20, .k = rules[i]};
        mn_plan plan;
        mn_status st = {0};
        uint64_t named = 0;
        ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, &st), MN_CAP_TOO_SMALL);
        const char *at = strrchr(st.text, '-');
        ck_assert(at != NULL && sscanf(at, "-ram %" SCNu64 "K", &named) == 1);
        desc.ram_bytes = named * 1024;
        ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, NULL), MN_OK);
        check_plan(&plan, &h, desc.ram_bytes);
        ck_assert_uint_eq(plan.ram_min_bytes, desc.ram_bytes);
        ck_assert(rules[i] <= 0 || plan.k == rules[i]);
        desc.ram_bytes -= 1024;
        ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, NULL), MN_CAP_TOO_SMALL);
    }
}
END_TEST

START_TEST(sharing) {
    mn_header h = header_of(5000000, 16384);
    mni_ram_plan_desc desc = {.ram_bytes = 16 << 20};
    mn_plan plan, smaller;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, NULL), MN_OK);
    ck_assert_uint_gt(plan.front_max, 10000); /* of 16 MB, what a picture needs */
    ck_assert_uint_gt(plan.k, 300);
    ck_assert_uint_gt(plan.planned_bytes, (16 << 20) - 2 * 16384); /* nothing lies idle */
    desc.k = MN_K_MIN;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &smaller, NULL), MN_OK);
    ck_assert_uint_eq(smaller.k, smaller.k_min);
    ck_assert_uint_gt(smaller.front_max, plan.front_max);
    /* a small file: no more holders than blocks, and room for all of the front */
    h = header_of(1000, 16384);
    desc.k = MN_K_FROM_RAM;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, NULL), MN_OK);
    ck_assert_uint_le(plan.k, h.blocks + 16);
    ck_assert_uint_eq(plan.front_max, 1000);
}
END_TEST

START_TEST(without_a_cap) {
    mn_header h = header_of(500000, 16384);
    mni_ram_plan_desc desc = {.k = MN_K_MIN};
    mn_plan plan;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, NULL), MN_OK);
    check_plan(&plan, &h, 0);
    ck_assert_uint_eq(plan.k, plan.k_min);
    ck_assert_uint_le(plan.planned_bytes, plan.ram_min_bytes); /* the smallest session there is */
    desc.k = MN_K_FROM_RAM;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, NULL), MN_OK);
    ck_assert_uint_eq(plan.front_max, 500000);
    desc.front_max = 777;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, NULL), MN_OK);
    ck_assert_uint_eq(plan.front_max, 777);
    desc.k = 1;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &plan, NULL), MN_USAGE);
}
END_TEST

/* What the caller takes besides is the session's to do without. */
START_TEST(base) {
    mn_header h = header_of(5000000, 16384);
    mni_ram_plan_desc desc = {.ram_bytes = 32 << 20};
    mn_plan alone, beside;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &alone, NULL), MN_OK);
    desc.base_bytes = 8 << 20;
    ck_assert_int_eq(mni_ram_plan_make(&desc, &h, &beside, NULL), MN_OK);
    ck_assert_uint_eq(beside.base_bytes, alone.base_bytes + (8 << 20));
    ck_assert_uint_lt(beside.k, alone.k);
    check_plan(&beside, &h, desc.ram_bytes);
}
END_TEST

int main(void) {
    Suite *suite = suite_create("plan");
    TCase *tc = tcase_create("plan");
    tcase_add_test(tc, under_every_cap);
    tcase_add_test(tc, named_cap_works);
    tcase_add_test(tc, sharing);
    tcase_add_test(tc, without_a_cap);
    tcase_add_test(tc, base);
    suite_add_tcase(suite, tc);
    return suite_run(suite);
}
