/* See thin.h. Hidden here: that each witness remembers the nearest one before it, its mate, and
 * that the pairs of a registerful are looked at side by side.
 *
 * Squares of distances are compared by their bits: floats that are not negative sort as these do.
 * Of pairs as close as each other it depends on the order of looking which goes, so both ways look
 * in the same: a mate is the first of the nearest ones when it is sought, and gives way to a
 * newcomer that is nearer, not to one that is as near. */
#include "thin.h"

#include <math.h>
#include <string.h>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

static uint32_t bits_of(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

/* Drops witness `gone`; the one at `heir` answers for it, and the last one moves to its place. */
static inline void drop(const mni_thin_set *s, uint32_t gone, uint32_t heir) {
    mni_points *w = s->points;
    uint32_t last = --w->count;
    float beyond = w->distance[gone] + s->slack[gone] - w->distance[heir];
    if (beyond > s->slack[heir])
        s->slack[heir] = beyond;
    w->x[gone] = w->x[last];
    w->y[gone] = w->y[last];
    w->z[gone] = w->z[last];
    w->distance[gone] = w->distance[last];
    s->slack[gone] = s->slack[last];
    s->home[gone] = s->home[last];
}

/* Of a pair the nearer one goes. Returns where it was. */
static inline uint32_t drop_one_of(const mni_thin_set *s, uint32_t first, uint32_t second) {
    const mni_points *w = s->points;
    bool first_nearer =
        w->distance[first] + s->slack[first] < w->distance[second] + s->slack[second];
    uint32_t gone = first_nearer ? first : second;
    drop(s, gone, first ^ second ^ gone);
    return gone;
}

/* ---- any number ----------------------------------------------------------------------------- */

/* Orders pairs by squared distance, then by number. */
static inline uint64_t pair_key(float apart2, uint32_t number) {
    return (uint64_t)bits_of(apart2) << 32 | number;
}

static inline uint64_t least_key(uint64_t a, uint64_t b) {
    return a < b ? a : b;
}

/* What is known of the witnesses: of each its mate, as pair_key says. */
typedef struct pairs {
    uint64_t mate[MNI_POINTS];
    float apart2[MNI_POINTS]; /* from one witness to each */
} pairs;

/* apart2[0 … n): from witness i. */
static inline void measure_apart(const mni_points *w, pairs *p, uint32_t i, uint32_t n) {
    float px = w->x[i], py = w->y[i], pz = w->z[i];
    for (uint32_t at = 0; at < n; at += MNI_LANES)
        for (uint32_t j = at; j < at + MNI_LANES; j++) {
            float x = px - w->x[j], y = py - w->y[j], z = pz - w->z[j];
            p->apart2[j] = x * x + y * y + z * z;
        }
}

/* Finds i's nearest among the witnesses before it. */
static inline void find_mate(const mni_points *w, pairs *p, uint32_t i) {
    uint64_t mate = pair_key(INFINITY, 0);
    measure_apart(w, p, i, i);
    for (uint32_t j = 0; j < i; j++)
        mate = least_key(mate, pair_key(p->apart2[j], j));
    p->mate[i] = mate;
}

/* Witness `gone` is another now: its own mate, and those of the witnesses behind it. */
static void mate_again(const mni_points *w, pairs *p, uint32_t gone) {
    uint32_t n = w->count, bereft[MNI_POINTS], count = 0;
    measure_apart(w, p, gone, n);
    for (uint32_t i = gone + 1; i < n; i++) {
        bool of_gone = (uint32_t)p->mate[i] == gone;
        uint64_t key = pair_key(p->apart2[i], gone);
        p->mate[i] = key >> 32 < p->mate[i] >> 32 ? key : p->mate[i];
        bereft[count] = i;
        count += of_gone;
    }
    find_mate(w, p, gone);
    for (uint32_t i = 0; i < count; i++)
        find_mate(w, p, bereft[i]);
}

void mni_thin_narrow(const mni_thin_set *s) {
    const mni_points *w = s->points;
    pairs p;
    if (w->count <= MNI_THIN_LEFT)
        return;
    for (uint32_t i = 0; i < w->count; i++)
        find_mate(w, &p, i);
    while (w->count > MNI_THIN_LEFT) {
        uint64_t closest = UINT64_MAX;
        for (uint32_t i = 1; i < w->count; i++)
            closest = least_key(closest, (p.mate[i] >> 32 << 32) | i);
        uint32_t second = (uint32_t)closest;
        uint32_t gone = drop_one_of(s, (uint32_t)p.mate[second], second);
        if (gone < w->count)
            mate_again(w, &p, gone);
    }
}

/* ---- a registerful -------------------------------------------------------------------------- */

#ifdef __x86_64__
#define WIDEST __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq")))

enum { LANES = 16 };

/* Places and mates stay in registers: what is written lane by lane and read as a row waits for
 * the memory each time. */
typedef struct lanes {
    __m512 x, y, z;
    __m512i apart, number; /* of the mates */
} lanes;

/* Lanes [0, n). */
WIDEST static inline __mmask16 below(uint32_t n) {
    return (__mmask16)((1u << n) - 1);
}

/* From witness i, in every lane. */
WIDEST static inline __m512i apart_from(const lanes *s, uint32_t i) {
    const __m512i at = _mm512_set1_epi32((int)i);
    __m512 x = _mm512_sub_ps(_mm512_permutexvar_ps(at, s->x), s->x);
    __m512 y = _mm512_sub_ps(_mm512_permutexvar_ps(at, s->y), s->y);
    __m512 z = _mm512_sub_ps(_mm512_permutexvar_ps(at, s->z), s->z);
    x = _mm512_add_ps(_mm512_mul_ps(x, x), _mm512_mul_ps(y, y));
    return _mm512_castps_si512(_mm512_add_ps(x, _mm512_mul_ps(z, z)));
}

/* Which of these lanes holds the least, the first of those that are alike; *least: it. */
WIDEST static inline uint32_t find_least(__m512i of, __mmask16 which, __m512i *least) {
    const __m512i none = _mm512_set1_epi32((int)bits_of(INFINITY));
    __m512i m = _mm512_mask_mov_epi32(none, which, of);
    __m512i v = _mm512_min_epu32(m, _mm512_shuffle_i64x2(m, m, 0x4e));
    v = _mm512_min_epu32(v, _mm512_shuffle_i64x2(v, v, 0xb1));
    v = _mm512_min_epu32(v, _mm512_shuffle_epi32(v, (_MM_PERM_ENUM)0x4e));
    *least = _mm512_min_epu32(v, _mm512_shuffle_epi32(v, (_MM_PERM_ENUM)0xb1));
    return (uint32_t)__builtin_ctz(1u << LANES | _mm512_mask_cmpeq_epi32_mask(which, of, *least));
}

/* Finds i's mate among apart[0 … i), distances from it. */
WIDEST static inline void find_mate_in(lanes *s, uint32_t i, __m512i apart) {
    const __mmask16 of_i = (__mmask16)(1u << i);
    __m512i least;
    uint32_t number = find_least(apart, below(i), &least) % LANES;
    s->apart = _mm512_mask_mov_epi32(s->apart, of_i, least);
    s->number = _mm512_mask_set1_epi32(s->number, of_i, (int)number);
}

/* As mate_again. */
WIDEST static inline void lanes_again(lanes *s, const mni_points *w, uint32_t gone) {
    const __mmask16 at = (__mmask16)(1u << gone);
    const __mmask16 behind = below(w->count) & (__mmask16)~below(gone + 1);
    const __m512i here = _mm512_set1_epi32((int)gone);
    s->x = _mm512_mask_mov_ps(s->x, at, _mm512_set1_ps(w->x[gone]));
    s->y = _mm512_mask_mov_ps(s->y, at, _mm512_set1_ps(w->y[gone]));
    s->z = _mm512_mask_mov_ps(s->z, at, _mm512_set1_ps(w->z[gone]));
    __m512i apart = apart_from(s, gone);
    uint32_t bereft = _mm512_mask_cmpeq_epi32_mask(behind, s->number, here);
    __mmask16 nearer = _mm512_mask_cmplt_epu32_mask(behind, apart, s->apart);
    s->apart = _mm512_mask_mov_epi32(s->apart, nearer, apart);
    s->number = _mm512_mask_mov_epi32(s->number, nearer, here);
    find_mate_in(s, gone, apart);
    for (; bereft != 0; bereft &= bereft - 1) {
        uint32_t i = (uint32_t)__builtin_ctz(bereft);
        find_mate_in(s, i, apart_from(s, i));
    }
}

WIDEST static void thin_widest(const mni_thin_set *set) {
    const mni_points *w = set->points;
    if (w->count <= MNI_THIN_LEFT)
        return;
    if (w->count > LANES) {
        mni_thin_narrow(set);
        return;
    }
    lanes s = {.x = _mm512_loadu_ps(w->x),
               .y = _mm512_loadu_ps(w->y),
               .z = _mm512_loadu_ps(w->z),
               .apart = _mm512_set1_epi32((int)bits_of(INFINITY)),
               .number = _mm512_setzero_si512()};
    for (uint32_t i = 0; i + 1 < w->count; i++) {
        __m512i apart = apart_from(&s, i);
        __mmask16 nearer = _mm512_mask_cmplt_epu32_mask((__mmask16)~below(i + 1), apart, s.apart);
        s.apart = _mm512_mask_mov_epi32(s.apart, nearer, apart);
        s.number = _mm512_mask_set1_epi32(s.number, nearer, (int)i);
    }
    while (w->count > MNI_THIN_LEFT) {
        uint32_t number[LANES];
        __m512i least;
        uint32_t second =
            find_least(s.apart, below(w->count) & (__mmask16)~below(1), &least) % LANES;
        _mm512_storeu_si512(number, s.number);
        uint32_t gone = drop_one_of(set, number[second], second);
        if (gone < w->count)
            lanes_again(&s, w, gone);
    }
}

#endif

mni_thin *mni_thin_best(void) {
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq"))
        return thin_widest;
#endif
    return mni_thin_narrow;
}
