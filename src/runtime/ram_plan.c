/* The plan: one pure function from the cap to K, the front's room, and what each of them takes.
 *
 *     cap ≥ base      code, stacks, libc, page tables, kernel memory of the rings
 *         + front     active nodes × (slot, branch, agenda) + simplices × (corners, chunks)
 *         + pool      K × longest block
 *         + tables    hash and ancestor tables, board, rings: what the store takes besides
 *
 * Hides: how the cap is shared. The front gets up to a third, the pool the rest up to one holder a
 * block of the file and a few to spare, and what is then left the front again. `mapped` and
 * `resident` are planned as `paged` is, so that one cap means one front in all three.
 *
 * Any thread, no memory, no order of calls. Paper: §4 fixes K by hand; this is design.md §4. */
#include "ram_plan.h"

#include <inttypes.h>

#include "mn_assert.h"
#include "navigate.h"
#include "store.h"

/* Measured: a replay of this program (libc, liburing, xxHash; two threads; uring) has 2.3 MB
 * resident before it opens a session, and the arena's page tables, the second stack and the rings
 * add 0.3. The rest is for what differs between machines. */
#define BASE_BYTES (UINT64_C(3584) << 10)

enum {
    FRONT_MIN = 1536,         /* active nodes below which a picture is not worth having */
    FRONT_FREE_MAX = 1 << 20, /* active nodes without a cap */
    FRONT_SHARE = 2,          /* the front gets up to half of what the base leaves */
    K_LIMIT = UINT32_MAX / 8, /* holders: indices have bits to spare */
    K_SPARE = 4,              /* holders beyond one a block: for rules that keep one free */
    SIMPLICES_EXTRA = 1024,   /* beyond 9/4 a node: fronts with many hinges or fins */
};
#define POOL_FREE_BYTES (UINT64_C(256) << 20) /* of a pool without a cap */
/* What the front's words have room for: vectors address a word of a node, and a corner of a
 * simplex, by 31 bits. */
#define NODES_LIMIT (MNI_FRONT_NODES_MAX - 1)
#define SIMPLICES_LIMIT (MNI_FRONT_SIMPLICES_MAX - 1)

static uint32_t least_u32(uint64_t a, uint64_t b) {
    uint64_t least = a < b ? a : b;
    MN_ASSERT(least <= UINT32_MAX);
    return (uint32_t)least;
}

/* A closed surface has 2 triangles a vertex; all of the file's do for full detail. */
static uint32_t simplices_for(const mn_header *header, uint32_t nodes) {
    uint64_t all = header->triangles + header->hinges;
    if (nodes < header->leaves)
        all = least_u32((uint64_t)nodes * 9 / 4 + SIMPLICES_EXTRA, all);
    return least_u32(all, SIMPLICES_LIMIT);
}

static uint32_t front_limit(const mn_header *header, uint64_t wish) {
    uint64_t most = header->leaves < NODES_LIMIT ? header->leaves : NODES_LIMIT;
    uint64_t least = header->roots > 0 ? header->roots : 1;
    return least_u32(wish < least ? least : wish, most > least ? most : least);
}

static uint64_t front_bytes(const mn_header *header, uint32_t nodes) {
    return mni_navigator_need_bytes(header, nodes, simplices_for(header, nodes)) +
           sizeof(mni_navigator);
}

/* The store with K holders, and the session's count an entry beside it. */
static uint64_t store_bytes(const mn_header *header, mn_store_kind store, uint32_t k) {
    return mni_store_need_bytes(header, store, k) +
           mni_arena_need(mni_store_entries_max(header, store, k), sizeof(uint32_t), 64);
}

static uint64_t paged_bytes(const mn_header *header, uint32_t count) {
    return store_bytes(header, MN_STORE_PAGED, count);
}

/* The largest count in [lo, hi] whose bytes are at most room; lo where none is. */
typedef struct span {
    uint32_t least, most;
} span;
typedef uint64_t (*bytes_for)(const mn_header *header, uint32_t count, const span *front);
static uint32_t largest(const mn_header *header, bytes_for bytes, const span *front, uint32_t lo,
                        uint32_t hi, uint64_t room) {
    while (lo < hi) {
        uint32_t mid = lo + (hi - lo + 1) / 2;
        if (bytes(header, mid, front) <= room)
            lo = mid;
        else
            hi = mid - 1;
    }
    return lo;
}

static uint64_t front_alone(const mn_header *header, uint32_t nodes, const span *front) {
    (void)front;
    return front_bytes(header, nodes);
}

static uint64_t pool_alone(const mn_header *header, uint32_t k, const span *front) {
    (void)front;
    return paged_bytes(header, k);
}

/* K holders with the front that they can feed: no more active nodes than so many blocks have
 * leaves. With `levels`, whose blocks hold few nodes, that is less than its share. */
static uint64_t pool_and_front(const mn_header *header, uint32_t k, const span *front) {
    uint64_t fed = (uint64_t)k * (header->leaves / (header->blocks + 1) + 1);
    fed = fed < front->least ? front->least : fed > front->most ? front->most : fed;
    return paged_bytes(header, k) + front_bytes(header, (uint32_t)fed);
}

static void fill(mn_plan *plan, const mn_header *header) {
    plan->simplices_max = simplices_for(header, plan->front_max);
    plan->front_bytes = front_bytes(header, plan->front_max);
    plan->pool_bytes = (uint64_t)plan->k * header->block_bytes_max;
    uint64_t store = paged_bytes(header, plan->k);
    MN_ASSERT(store >= plan->pool_bytes);
    plan->tables_bytes = store - plan->pool_bytes;
    plan->planned_bytes = plan->base_bytes + plan->front_bytes + store;
}

/* No cap: K by its rule, a large front. With -K min the smallest session, whose sum is the cap. */
static void plan_free(const mni_ram_plan_desc *desc, const mn_header *header, uint32_t k_least,
                      uint32_t k_most, uint32_t front_least, uint32_t front_most, mn_plan *plan) {
    plan->k = k_least;
    plan->front_max = front_most;
    if (desc->k == MN_K_FROM_RAM)
        plan->k = largest(header, pool_alone, NULL, k_least, k_most, POOL_FREE_BYTES);
    if (desc->k == MN_K_MIN)
        plan->front_max = front_least;
}

static void plan_capped(const mni_ram_plan_desc *desc, const mn_header *header, uint32_t k_least,
                        uint32_t k_most, uint32_t front_least, uint32_t front_most, mn_plan *plan) {
    uint64_t room = desc->ram_bytes - plan->base_bytes;
    plan->k = k_least;
    if (desc->k == MN_K_FROM_RAM) {
        uint32_t share =
            largest(header, front_alone, NULL, front_least, front_most, room / FRONT_SHARE);
        span front = {front_least, share};
        plan->k = largest(header, pool_and_front, &front, k_least, k_most, room);
    }
    plan->front_max = largest(header, front_alone, NULL, front_least, front_most,
                              room - paged_bytes(header, plan->k));
}

static mn_code too_small(uint64_t ram_bytes, uint32_t k, uint32_t block_bytes, uint64_t enough,
                         mn_status *st) {
    const bool whole = ram_bytes % 1024 == 0; /* as it was asked for, not rounded to 0K */
    return mn_fail(st, MN_CAP_TOO_SMALL,
                   "--ram %" PRIu64 "%s is too small for %" PRIu32 " place holders of %" PRIu32
                   "K: --ram %" PRIu64 "K would work",
                   whole ? ram_bytes >> 10 : ram_bytes, whole ? "K" : "", k, block_bytes >> 10,
                   enough >> 10);
}

mn_code mni_ram_plan_make(const mni_ram_plan_desc *desc, const mn_header *header, mn_plan *out,
                          mn_status *st) {
    mn_plan plan = {.ram_cap_bytes = desc->ram_bytes,
                    .base_bytes = BASE_BYTES + desc->base_bytes,
                    .k_min = mni_store_k_min(header)};
    if (desc->k > K_LIMIT)
        return mn_fail(st, MN_USAGE,
                       "-K %" PRId64 ": too many place holders, %d at most; this file has %" PRIu32
                       " blocks",
                       desc->k, K_LIMIT, header->blocks);
    if (desc->k != MN_K_FROM_RAM && desc->k != MN_K_MIN && desc->k < (int64_t)plan.k_min)
        return mn_fail(st, MN_USAGE,
                       "-K %" PRId64 ": this file needs at least %" PRIu32
                       " place holders; try -K min",
                       desc->k, plan.k_min);
    uint32_t k_least = desc->k > 0 ? (uint32_t)desc->k : plan.k_min;
    uint64_t enough = (uint64_t)header->blocks + K_SPARE;
    uint32_t k_most = enough > k_least ? least_u32(enough, K_LIMIT) : k_least;
    uint32_t front_most =
        front_limit(header, desc->front_max > 0 ? desc->front_max : FRONT_FREE_MAX);
    uint32_t front_least = front_limit(header, desc->front_max > 0 ? desc->front_max : FRONT_MIN);
    if (desc->ram_bytes > 0 && desc->front_max == 0)
        front_most = front_limit(header, UINT32_MAX);
    plan.ram_min_bytes =
        plan.base_bytes + paged_bytes(header, k_least) + front_bytes(header, front_least);
    plan.ram_min_bytes = (plan.ram_min_bytes + 1023) & ~UINT64_C(1023);
    if (desc->ram_bytes == 0)
        plan_free(desc, header, k_least, k_most, front_least, front_most, &plan);
    else if (desc->ram_bytes < plan.ram_min_bytes)
        return too_small(desc->ram_bytes, k_least, header->block_bytes_max, plan.ram_min_bytes, st);
    else
        plan_capped(desc, header, k_least, k_most, front_least, front_most, &plan);
    fill(&plan, header);
    MN_ASSERT(desc->ram_bytes == 0 || plan.planned_bytes <= desc->ram_bytes);
    *out = plan;
    return MN_OK;
}

size_t mni_ram_plan_arena_bytes(const mn_plan *plan, const mn_header *header, mn_store_kind store) {
    return store_bytes(header, store, plan->k) +
           mni_navigator_need_bytes(header, plan->front_max, plan->simplices_max);
}
