/* The ring of neighbours around a node, and what the two moves do to records of corners.
 *
 * Hides: vectors. A walk around a node would guess wrongly how many corners it has, whose turn it
 * is in a simplex, which of them go and which stay, and each wrong guess costs as much as looking
 * at four neighbours. So a record's eight places are gone through at once and without a branch:
 * places that are empty hold corner 0, of simplex 0, which is none and leads to the slot `nobody`,
 * whose record answers no to everything.
 *
 * With AVX2 and BMI2 by gathers and permutations; elsewhere by loops, with the same outcome.
 *
 * Threads: Navigate only. No memory. Paper: §3.3.5 (implicit dependencies). */
#include "ring.h"

#include <stddef.h>
#include <string.h>

#include "mn_assert.h"

enum { HALF = MNI_FRONT_CORNERS };
_Static_assert(HALF == 8, "what a vector holds");

static void give(mni_front *f, uint32_t corner, uint32_t slot) {
    f->simplex_node[mni_corner_at(corner)] = slot;
    f->simplex_stamp[mni_simplex_page(corner)] = (uint32_t)f->version;
}

/* ---- loops ----------------------------------------------------------------------------------- */

static void look(const mni_front *f, const uint32_t *corner, uint32_t slot[MNI_RING]) {
    for (int i = 0; i < HALF; i++) {
        slot[i] = mni_corner_slot(f, mni_corner_after(corner[i]));
        slot[HALF + i] = mni_corner_slot(f, mni_corner_before(corner[i]));
    }
}

static uint32_t above_or_below(const mni_front *f, const uint32_t slot[MNI_RING], bool split,
                               uint32_t order) {
    uint32_t mask = 0;
    for (int i = 0; i < MNI_RING; i++) {
        const mni_front_node *n = &f->node[slot[i]];
        mask |= (uint32_t)(split ? n->order > order : n->above < order) << i;
    }
    return mask;
}

static uint32_t find(const mni_front *f, const mni_ring *ring, uint32_t leaf) {
    for (int i = 0; i < MNI_RING; i++) {
        const mni_front_node *n = &f->node[ring->slot[i]];
        if (leaf - n->leaf_lo < n->leaf_hi - n->leaf_lo)
            return ring->slot[i];
    }
    return MN_NONE;
}

static void part(mni_front *f, uint32_t slot, uint32_t right, uint32_t mid) {
    uint32_t kept[HALF] = {0}, kept_count = 0, given_count = 0;
    uint32_t *corner = f->node[slot].corner, *given = f->node[right].corner;
    for (int i = 0; i < HALF && corner[i] != 0; i++) {
        if (f->simplex_leaf[mni_corner_at(corner[i])] < mid)
            kept[kept_count++] = corner[i];
        else
            give(f, given[given_count++] = corner[i], right);
    }
    memcpy(corner, kept, sizeof kept);
    f->node[slot].more = MNI_FRONT_SHORT + kept_count;
    f->node[right].more = MNI_FRONT_SHORT + given_count;
}

static bool is_beside(const mni_front *f, const uint32_t *corner, uint32_t count, uint32_t slot) {
    for (uint32_t i = 0; i < count; i++)
        if (mni_corner_slot(f, mni_corner_after(corner[i])) == slot ||
            mni_corner_slot(f, mni_corner_before(corner[i])) == slot)
            return true;
    return false;
}

/* Of each record: which corners die, and of those the third corner. Then all that live, packed. */
static void join(mni_front *f, uint32_t left, uint32_t right, mni_joined *j) {
    uint32_t kept[2 * HALF] = {0}, count = 0;
    mni_ring ring;
    j->died = j->lost = 0;
    for (int side = 0; side < 2; side++) {
        const uint32_t *corner = f->node[side ? right : left].corner;
        uint32_t other = side ? left : right;
        look(f, corner, ring.slot);
        for (int i = 0; i < HALF && corner[i] != 0; i++) {
            bool after = ring.slot[i] == other;
            if (!after && ring.slot[HALF + i] != other) {
                kept[count++] = corner[i];
                if (side == 1)
                    give(f, corner[i], left);
            } else if (side == 1) {
                j->third[j->died++] =
                    after ? mni_corner_before(corner[i]) : mni_corner_after(corner[i]);
            }
        }
    }
    for (uint32_t i = 0; i < j->died; i++)
        j->lost |= (uint32_t)!is_beside(f, kept, count, mni_corner_slot(f, j->third[i])) << i;
    memcpy(f->node[left].corner, kept, HALF * sizeof *kept);
    memcpy(j->over, kept + HALF, HALF * sizeof *kept);
    j->over_count = count < HALF ? 0 : count - HALF;
    f->node[left].more = MNI_FRONT_SHORT + count - j->over_count;
}

/* ---- vectors --------------------------------------------------------------------------------- */

#if defined(__x86_64__)
#include <immintrin.h>
#define FAST __attribute__((target("avx2,bmi2")))
enum { PAGE_SHIFT = 8 }; /* see mni_simplex_page */
_Static_assert(4 * MN_FRONT_PAGE == 1 << PAGE_SHIFT, "corners of a page");

typedef struct vectors {
    __m256i after, before; /* of a ring */
} vectors;

FAST static inline __m256i at_fast(__m256i corner) {
    return _mm256_sub_epi32(corner, _mm256_srli_epi32(corner, 2));
}

/* Three times the lowest bit. */
FAST static inline __m256i thrice(__m256i v) {
    __m256i bit = _mm256_and_si256(v, _mm256_set1_epi32(1));
    return _mm256_add_epi32(bit, _mm256_slli_epi32(bit, 1));
}

FAST static inline __m256i after_fast(__m256i corner) {
    __m256i next = _mm256_add_epi32(corner, _mm256_set1_epi32(1));
    return _mm256_sub_epi32(next, thrice(_mm256_srli_epi32(corner, 1)));
}

FAST static inline __m256i before_fast(__m256i corner) {
    __m256i next = _mm256_add_epi32(corner, _mm256_set1_epi32(2));
    return _mm256_sub_epi32(next, thrice(_mm256_or_si256(corner, _mm256_srli_epi32(corner, 1))));
}

FAST static inline __m256i corners_fast(const mni_front *f, uint32_t slot) {
    return _mm256_loadu_si256((const __m256i *)(const void *)f->node[slot].corner);
}

/* Of the corners in their arrays. */
FAST static void places_fast(const mni_front *f, uint32_t slot, uint32_t at[HALF]) {
    _mm256_storeu_si256((__m256i *)(void *)at, at_fast(corners_fast(f, slot)));
}

FAST static inline vectors look_fast(const mni_front *f, __m256i corner) {
    const int *node = (const int *)f->simplex_node;
    __m256i nobody = _mm256_set1_epi32((int)f->nobody);
    __m256i after = _mm256_i32gather_epi32(node, at_fast(after_fast(corner)), 4);
    __m256i before = _mm256_i32gather_epi32(node, at_fast(before_fast(corner)), 4);
    return (vectors){_mm256_min_epu32(after, nobody), _mm256_min_epu32(before, nobody)};
}

FAST static inline void put_fast(uint32_t slot[MNI_RING], vectors v) {
    _mm256_storeu_si256((__m256i *)(void *)slot, v.after);
    _mm256_storeu_si256((__m256i *)(void *)(slot + HALF), v.before);
}

FAST static inline vectors get_fast(const uint32_t slot[MNI_RING]) {
    return (vectors){_mm256_loadu_si256((const __m256i *)(const void *)slot),
                     _mm256_loadu_si256((const __m256i *)(const void *)(slot + HALF))};
}

/* The word of a node's record that lies so many bytes in. */
FAST static inline __m256i field_fast(const mni_front *f, __m256i slot, size_t offset) {
    const int *word = (const int *)(const void *)((const char *)f->node + offset);
    return _mm256_i32gather_epi32(word, _mm256_slli_epi32(slot, 4), 4);
}

FAST static inline uint32_t bits_of(__m256i lanes) {
    return (uint32_t)_mm256_movemask_ps(_mm256_castsi256_ps(lanes));
}

FAST static inline uint32_t equal_fast(__m256i a, __m256i b) {
    return bits_of(_mm256_cmpeq_epi32(a, b));
}

/* The lanes of the mask, first ones first, then 0. */
FAST static inline __m256i pack_fast(__m256i lanes, uint32_t mask) {
    uint64_t bytes = _pdep_u64(mask, UINT64_C(0x0101010101010101)) * 255;
    uint64_t from = _pext_u64(UINT64_C(0x0706050403020100), bytes);
    uint64_t some = bytes == 0 ? 0 : UINT64_MAX >> (64 - 8 * (uint32_t)__builtin_popcount(mask));
    __m256i packed = _mm256_permutevar8x32_epi32(
        lanes, _mm256_cvtepu8_epi32(_mm_cvtsi64_si128((long long)from)));
    return _mm256_and_si256(packed, _mm256_cvtepi8_epi32(_mm_cvtsi64_si128((long long)some)));
}

FAST static uint32_t split_fast(const mni_front *f, uint32_t slot, mni_ring *ring) {
    vectors v = look_fast(f, corners_fast(f, slot));
    __m256i own = _mm256_set1_epi32((int)f->node[slot].order);
    __m256i after = field_fast(f, v.after, offsetof(mni_front_node, order));
    __m256i before = field_fast(f, v.before, offsetof(mni_front_node, order));
    put_fast(ring->slot, v);
    uint32_t lower = equal_fast(_mm256_min_epu32(after, own), after) |
                     equal_fast(_mm256_min_epu32(before, own), before) << HALF;
    return lower ^ 0xffff;
}

FAST static inline uint32_t below_fast(const mni_front *f, __m256i slot, __m256i order) {
    __m256i above = field_fast(f, slot, offsetof(mni_front_node, above));
    return 0xff ^ equal_fast(_mm256_max_epu32(above, order), above);
}

FAST static void look_two_fast(const mni_front *f, uint32_t left, uint32_t right,
                               mni_rings *rings) {
    put_fast(rings->slot, look_fast(f, corners_fast(f, left)));
    put_fast(rings->slot + MNI_RING, look_fast(f, corners_fast(f, right)));
}

/* Both rings at once: which of them blocks is known when memory has answered, and what is guessed
 * until then would keep the next test from asking it. */
FAST static uint32_t collapse_fast(const mni_front *f, const mni_rings *rings, uint32_t order) {
    vectors l = get_fast(rings->slot), r = get_fast(rings->slot + MNI_RING);
    __m256i own = _mm256_set1_epi32((int)order);
    uint64_t lower = below_fast(f, l.after, own) | below_fast(f, l.before, own) << HALF;
    lower |= below_fast(f, r.after, own) << (2 * HALF) | below_fast(f, r.before, own) << (3 * HALF);
    return rings->slot[__builtin_ctzll(lower | UINT64_C(1) << (4 * HALF))];
}

/* lo ≤ leaf < hi, in numbers below 2^31. */
FAST static inline uint32_t holds_fast(const mni_front *f, __m256i slot, __m256i leaf) {
    __m256i lo = field_fast(f, slot, offsetof(mni_front_node, leaf_lo));
    __m256i hi = field_fast(f, slot, offsetof(mni_front_node, leaf_hi));
    return bits_of(_mm256_andnot_si256(_mm256_cmpgt_epi32(lo, leaf), _mm256_cmpgt_epi32(hi, leaf)));
}

FAST static uint32_t find_fast(const mni_front *f, const mni_ring *ring, uint32_t leaf) {
    vectors v = get_fast(ring->slot);
    __m256i wanted = _mm256_set1_epi32((int)leaf);
    uint32_t found = holds_fast(f, v.after, wanted);
    if (found == 0) /* at an open edge */
        found = holds_fast(f, v.before, wanted) << HALF;
    return found == 0 ? MN_NONE : ring->slot[__builtin_ctz(found)];
}

/* The first `count` lanes are corners that a slot gets, the others 0. As many are written as there
 * are lanes: how many it gets nobody can guess. The others' place is the first one's or, where
 * there is none, that of simplex 0, which stays as it is. */
FAST static inline void give_fast(mni_front *f, __m256i gives, uint32_t count, uint32_t slot) {
    const __m256i one = _mm256_set1_epi32(1), four = _mm256_set1_epi32(4);
    const __m256i first = _mm256_broadcastd_epi32(_mm256_castsi256_si128(gives));
    const __m256i corner = _mm256_blendv_epi8(gives, first, _mm256_cmpgt_epi32(one, gives));
    const __m256i simplex = _mm256_max_epu32(corner, four);
    const __m256i page = _mm256_srli_epi32(_mm256_sub_epi32(simplex, four), PAGE_SHIFT);
    const uint32_t who = count > 0 ? slot : MN_NONE;
    uint32_t at[HALF], pages[HALF];
    _mm256_storeu_si256((__m256i *)(void *)at, at_fast(corner));
    _mm256_storeu_si256((__m256i *)(void *)pages, page);
#pragma GCC unroll 8
    for (int i = 0; i < HALF; i++) {
        f->simplex_node[at[i]] = who;
        f->simplex_stamp[pages[i]] = (uint32_t)f->version;
    }
}

FAST static void part_fast(mni_front *f, uint32_t slot, uint32_t right, uint32_t mid) {
    const int *leaf = (const int *)f->simplex_leaf;
    __m256i corner = corners_fast(f, slot);
    __m256i leaves = _mm256_i32gather_epi32(leaf, at_fast(corner), 4);
    uint32_t keeps = bits_of(_mm256_cmpgt_epi32(_mm256_set1_epi32((int)mid), leaves));
    uint32_t there = 0xff ^ equal_fast(corner, _mm256_setzero_si256()), gives = there & ~keeps;
    const uint32_t count = (uint32_t)__builtin_popcount(gives);
    const __m256i given = pack_fast(corner, gives);
    keeps &= there;
    _mm256_storeu_si256((__m256i *)(void *)f->node[slot].corner, pack_fast(corner, keeps));
    _mm256_storeu_si256((__m256i *)(void *)f->node[right].corner, given);
    f->node[slot].more = MNI_FRONT_SHORT + (uint32_t)__builtin_popcount(keeps);
    f->node[right].more = MNI_FRONT_SHORT + count;
    give_fast(f, given, count, right);
}

/* The first `count` lanes of a, then b's; those that this pushes out go to *over. */
FAST static inline __m256i chain_fast(__m256i a, uint32_t count, __m256i b, __m256i *over) {
    const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    __m256i shift = _mm256_set1_epi32((int)count);
    __m256i turned = _mm256_permutevar8x32_epi32(b, _mm256_sub_epi32(lane, shift));
    __m256i of_b = _mm256_cmpgt_epi32(lane, _mm256_sub_epi32(shift, _mm256_set1_epi32(1)));
    *over = _mm256_andnot_si256(of_b, turned);
    return _mm256_blendv_epi8(a, turned, of_b);
}

/* Lanes of a ring in which one stands. */
FAST static inline uint32_t lanes_of(vectors v, uint32_t slot) {
    const __m256i one = _mm256_set1_epi32((int)slot);
    return bits_of(
        _mm256_or_si256(_mm256_cmpeq_epi32(v.after, one), _mm256_cmpeq_epi32(v.before, one)));
}

FAST static void join_fast(mni_front *f, uint32_t left, uint32_t right, mni_joined *j) {
    const __m256i zero = _mm256_setzero_si256(), of_left = corners_fast(f, left);
    const vectors l = look_fast(f, of_left);
    const uint32_t stay = 0xff & ~(lanes_of(l, right) | equal_fast(of_left, zero));

    const __m256i corner = corners_fast(f, right), gone = _mm256_set1_epi32((int)left);
    const vectors r = look_fast(f, corner);
    const __m256i after = _mm256_cmpeq_epi32(r.after, gone);
    const uint32_t dies = bits_of(_mm256_or_si256(after, _mm256_cmpeq_epi32(r.before, gone)));
    const uint32_t lives = 0xff & ~(dies | equal_fast(corner, zero));
    const __m256i thirds = _mm256_blendv_epi8(after_fast(corner), before_fast(corner), after);
    _mm256_storeu_si256((__m256i *)(void *)j->third, pack_fast(thirds, dies));
    j->died = (uint32_t)__builtin_popcount(dies);

    uint32_t third[HALF];
    const __m256i slots = _mm256_blendv_epi8(r.after, r.before, after);
    _mm256_storeu_si256((__m256i *)(void *)third, pack_fast(slots, dies));
    j->lost = 0;
    for (uint32_t i = 0; i < j->died; i++)
        j->lost |= (uint32_t) !((lanes_of(l, third[i]) & stay) | (lanes_of(r, third[i]) & lives))
                   << i;

    const uint32_t count = (uint32_t)__builtin_popcount(stay);
    const uint32_t more = (uint32_t)__builtin_popcount(lives), both = count + more;
    const __m256i gives = pack_fast(corner, lives);
    __m256i beyond;
    _mm256_storeu_si256((__m256i *)(void *)f->node[left].corner,
                        chain_fast(pack_fast(of_left, stay), count, gives, &beyond));
    _mm256_storeu_si256((__m256i *)(void *)j->over, beyond);
    j->over_count = both < HALF ? 0 : both - HALF;
    f->node[left].more = MNI_FRONT_SHORT + both - j->over_count;
    give_fast(f, gives, more, left);
}

FAST static uint32_t place_fast(const mni_front *f, uint32_t slot, uint32_t corner) {
    uint32_t at = equal_fast(corners_fast(f, slot), _mm256_set1_epi32((int)corner));
    return (uint32_t)__builtin_ctz(at | 1 << HALF);
}
#else
#define split_fast(f, slot, ring) 0
#define places_fast(f, slot, at) (void)0
#define look_two_fast(f, left, right, rings) (void)0
#define collapse_fast(f, rings, order) 0
#define find_fast(f, ring, leaf) 0
#define part_fast(f, slot, right, mid) (void)0
#define join_fast(f, left, right, j) (void)0
#define place_fast(f, slot, corner) 0
#endif

/* ---- either ---------------------------------------------------------------------------------- */

bool mni_ring_has_vectors(void) {
#if defined(__x86_64__)
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi2");
#else
    return false;
#endif
}

uint32_t mni_ring_block_split(const mni_front *f, uint32_t slot, mni_ring *ring) {
    if (f->vectors)
        return split_fast(f, slot, ring);
    look(f, f->node[slot].corner, ring->slot);
    return above_or_below(f, ring->slot, true, f->node[slot].order);
}

/* Who stands after a corner in its simplex stands before another's, but at an open edge: they
 * suffice. */
void mni_ring_look(const mni_front *f, uint32_t left, uint32_t right, mni_rings *rings) {
    if (f->vectors) {
        look_two_fast(f, left, right, rings);
    } else {
        look(f, f->node[left].corner, rings->slot);
        look(f, f->node[right].corner, rings->slot + MNI_RING);
    }
    rings->slot[2 * MNI_RING] = MN_NONE;
#pragma GCC unroll 8
    for (int i = 0; i < HALF; i++) {
        __builtin_prefetch(&f->node[rings->slot[i]]);
        __builtin_prefetch(&f->node[rings->slot[MNI_RING + i]]);
    }
}

uint32_t mni_ring_block_collapse(const mni_front *f, const mni_rings *rings, uint32_t order) {
    if (f->vectors)
        return collapse_fast(f, rings, order);
    uint64_t lower = above_or_below(f, rings->slot, false, order);
    lower |= (uint64_t)above_or_below(f, rings->slot + MNI_RING, false, order) << MNI_RING;
    return rings->slot[__builtin_ctzll(lower | UINT64_C(1) << (2 * MNI_RING))];
}

uint32_t mni_ring_find(const mni_front *f, const mni_ring *ring, uint32_t leaf) {
    return f->vectors ? find_fast(f, ring, leaf) : find(f, ring, leaf);
}

void mni_ring_part(mni_front *f, uint32_t slot, uint32_t right, uint32_t mid) {
    MN_ASSERT(!mni_front_is_long(&f->node[slot]) && f->node[right].corner[0] == 0);
    if (f->vectors)
        part_fast(f, slot, right, mid);
    else
        part(f, slot, right, mid);
}

void mni_ring_join(mni_front *f, uint32_t left, uint32_t right, mni_joined *j) {
    MN_ASSERT(!mni_front_is_long(&f->node[left]) && !mni_front_is_long(&f->node[right]));
    if (f->vectors)
        join_fast(f, left, right, j);
    else
        join(f, left, right, j);
}

uint32_t mni_ring_place(const mni_front *f, uint32_t slot, uint32_t corner) {
    if (f->vectors)
        return place_fast(f, slot, corner);
    uint32_t at = HALF;
    for (uint32_t i = HALF; i-- > 0;)
        at = f->node[slot].corner[i] == corner ? i : at;
    return at;
}

/* ---- ahead of time --------------------------------------------------------------------------- */

void mni_front_fetch_simplices(const mni_front *f, uint32_t slot, bool leaves) {
    uint32_t at[HALF];
    if (f->vectors)
        places_fast(f, slot, at);
    else
        for (int i = 0; i < HALF; i++)
            at[i] = (uint32_t)mni_corner_at(f->node[slot].corner[i]);
#pragma GCC unroll 8
    for (int i = 0; i < HALF; i++)
        __builtin_prefetch(&f->simplex_node[at[i]]);
    if (!leaves)
        return;
#pragma GCC unroll 8
    for (int i = 0; i < HALF; i++)
        __builtin_prefetch(&f->simplex_leaf[at[i]]);
}

/* Those that stand after it suffice, but at an open edge. */
void mni_front_fetch_ring(const mni_front *f, uint32_t slot) {
    const mni_front_node *n = &f->node[slot];
#pragma GCC unroll 8
    for (int i = 0; i < HALF; i++)
        __builtin_prefetch(&f->node[mni_corner_slot(f, mni_corner_after(n->corner[i]))]);
}
