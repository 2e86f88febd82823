/* Goal: the heap hands out the least item whatever was set, changed and removed, ties included.
 * Method: random steps against an array that is searched from end to end. */
#include <check.h>
#include <stdio.h>
#include <stdlib.h>

#include "heap.h"
#include "tree_fixture.h"

enum { VERTICES = 200, STEPS = 40000 };

typedef struct naive {
    mni_heap_key key[VERTICES];
    bool there[VERTICES];
    uint32_t count;
} naive;

static uint32_t least(const naive *n, uint32_t but) {
    uint32_t best = UINT32_MAX;
    for (uint32_t v = 0; v < VERTICES; v++)
        if (n->there[v] && v != but &&
            (best == UINT32_MAX || n->key[v] < n->key[best])) /* ties: the smaller number */
            best = v;
    return best;
}

static bool same(const mni_heap *h, const naive *n) {
    uint32_t top = least(n, UINT32_MAX);
    bool same = h->count == n->count && mni_heap_top(h) == top;
    for (uint32_t v = 0; v < VERTICES; v++)
        same &= n->there[v] ? h->at[v] != UINT32_MAX && mni_heap_key_of(h, v) == n->key[v]
                            : h->at[v] == UINT32_MAX;
    if (h->count >= MNI_HEAP_FORECAST)
        same &= h->item[mni_heap_second(h)].vertex == least(n, top);
    return same;
}

START_TEST(like_a_search) {
    mni_heap heap;
    static naive n;
    uint64_t random_state = fixture_seed(5);
    ck_assert(mni_heap_open(&heap, VERTICES));
    for (uint32_t i = 0; i < STEPS; i++) {
        uint32_t v = fixture_random(&random_state) % VERTICES;
        /* At first the heap fills, then it empties. Few costs and ends: ties are common. */
        bool remove = fixture_random(&random_state) % 8 < (i < STEPS / 2 ? 3u : 5u);
        if (remove) {
            v = fixture_random(&random_state) % 2 == 0 && heap.count > 0 ? mni_heap_top(&heap) : v;
            mni_heap_remove(&heap, v);
            n.count -= n.there[v];
            n.there[v] = false;
        } else {
            float cost = (float)(fixture_random(&random_state) % 30) / 8;
            mni_heap_key key = mni_heap_key_make(cost, fixture_random(&random_state) % 3);
            mni_heap_set(&heap, v, key);
            n.count += !n.there[v];
            n.there[v] = true;
            n.key[v] = key;
        }
        ck_assert_msg(same(&heap, &n), "after step %u, %u there", i, n.count);
    }
    while (heap.count > 0) {
        uint32_t v = mni_heap_top(&heap);
        mni_heap_remove(&heap, v);
        n.there[v] = false;
        n.count--;
        ck_assert(same(&heap, &n));
    }
    mni_heap_close(&heap);
}
END_TEST

START_TEST(keys_order_as_costs) {
    static const float cost[] = {0,    1e-45f, 1e-38f, 1e-9f, 0.5f,       1,
                                 1.5f, 3,      1e9f,   3e38f, 1.0f / 0.0f};
    enum { COSTS = sizeof cost / sizeof cost[0] };
    for (uint32_t i = 0; i < COSTS; i++) {
        mni_heap_key key = mni_heap_key_make(cost[i], 7);
        ck_assert(mni_heap_key_cost(key) == cost[i] && mni_heap_key_kept(key) == 7);
        ck_assert(key < MNI_HEAP_KEY_NONE && key < mni_heap_key_make(cost[i], 8));
        ck_assert(i == 0 || mni_heap_key_make(cost[i - 1], UINT32_MAX) < key);
    }
}
END_TEST

int main(void) {
    Suite *suite = suite_create("heap");
    TCase *tc = tcase_create("heap");
    tcase_add_test(tc, like_a_search);
    tcase_add_test(tc, keys_order_as_costs);
    suite_add_tcase(suite, tc);
    SRunner *runner = srunner_create(suite);
    srunner_run_all(runner, CK_ENV);
    int failed = srunner_ntests_failed(runner);
    srunner_free(runner);
    return failed == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
