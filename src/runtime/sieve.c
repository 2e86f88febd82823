/* What a camera wants, for many nodes at once and only where it is clear.
 *
 * Hides: the bounds of wanted.c in single precision and without branches, so that the compiler
 * makes vectors of it, and the room that each comparison leaves for what single precision may be
 * wrong by. Where that is too close to call the verdict is "unsure" and mni_lens_wants, in double,
 * decides: so the outcome is that function's for every node, whatever the vectors' width, and one
 * node in 10,000 is asked twice.
 *
 *     D > reach × w + r, w ≥ the node's weight for sure          unwanted
 *     D < reach × w + r, w ≤ the node's weight for sure          wanted
 *
 * "Faces away" is wanted.c's condition with the sine of a sum written out:
 * D sin(half + asin(r / D)) = sin(half) √(D² − r²) + cos(half) r. Silhouettes and light are sines
 * and cosines of sums likewise; who does not ask for them does not pay for them.
 *
 * Pure functions; any thread; no memory. Paper: none. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("O3") /* vectors; clang makes them anyway */
#endif
#include "sieve.h"

#include <math.h>
#include <string.h>

/* Of a product or sum of a few terms, relative to the largest; single precision is wrong by 6e-8
 * each time. */
#define RELATIVE 2e-5f
#define PI_F 3.14159265f

/* Models and distances whose squares, and those of a millionth of them, single precision holds; of
 * others the sieve says nothing. */
#define SIZE_LEAST 1e-12
#define SIZE_MOST 1e18

void mni_sieve_make(mni_sieve *s, const mni_lens *lens, float size) {
    double largest = size;
    for (int i = 0; i < 3; i++) {
        s->eye[i] = (float)lens->eye[i];
        largest = fmax(largest, fabs(lens->eye[i]));
        for (int p = 0; p < 5; p++)
            s->plane[p][i] = (float)lens->plane[p][i];
    }
    s->slack = (float)(largest * 1e-6);
    bool squares_fit = largest > SIZE_LEAST && largest < SIZE_MOST;
    s->reach =
        lens->tolerance_px > 0 && squares_fit ? (float)(lens->scale_px / lens->tolerance_px) : NAN;
    s->reach_most = s->reach * (float)lens->most;
    s->outside = (float)(1 / lens->outside);
    s->away = (float)(1 / lens->away);
    s->silhouette = (float)lens->silhouette;
    s->light = (float)lens->light;
    for (int i = 0; i < 3; i++)
        s->light_from[i] = (float)lens->light_from[i];
    s->tightens = mni_lens_tightens(lens);
    s->distance_min = (float)(lens->distance_min * 1.0001);
}

/* Where the light comes from, which may be the eye, counts in no margin. */
static bool weighs_alike(const mni_lens *a, const mni_lens *b) {
    return a->scale_px == b->scale_px && a->tolerance_px == b->tolerance_px &&
           a->distance_min == b->distance_min && a->outside == b->outside && a->away == b->away &&
           a->silhouette == b->silhouette && a->light == b->light && a->most == b->most;
}

/* By how much a plane's value changes, at most, over all points of the model: what the plane is
 * moved by along its normal, as seen from the origin, and what its normal turns by times how far
 * they are. Where the camera circles about the model nearly nothing is left of either. */
static double plane_motion(const mni_lens *from, const mni_lens *to, int p, double size) {
    double shift = 0, turn = 0, wrong = 0;
    for (int i = 0; i < 3; i++) {
        const double before = from->plane[p][i] * from->eye[i], now = to->plane[p][i] * to->eye[i];
        shift += now - before;
        wrong += fabs(now) + fabs(before);
        turn += fabs(to->plane[p][i] - from->plane[p][i]);
    }
    return fabs(shift) + turn * size + (wrong + size) * 1e-14;
}

/* Distances and what is asked of cones change by the eye's way. */
double mni_sieve_motion(const mni_lens *from, const mni_lens *to, double size) {
    if (!weighs_alike(from, to))
        return INFINITY;
    if (memcmp(from->eye, to->eye, sizeof to->eye) == 0 &&
        memcmp(from->plane, to->plane, sizeof to->plane) == 0)
        return 0;
    double way = 0, most;
    for (int i = 0; i < 3; i++)
        way += (to->eye[i] - from->eye[i]) * (to->eye[i] - from->eye[i]);
    most = sqrt(way);
    for (int p = 0; p < 5; p++)
        most = fmax(most, plane_motion(from, to, p, size));
    const double motion = most * 1.000001;
    return motion >= 0 ? motion : INFINITY;
}

/* An instruction of vectors, which fminf, for the sake of NaN, is not. */
static inline float least_of(float a, float b) {
    return a < b ? a : b;
}

static inline float most_of(float a, float b) {
    return a > b ? a : b;
}

/* A cone against the eye and the light, as judge() has it worked out: sines and cosines, each wrong
 * by `wrong` at most. */
typedef struct angles {
    float cos_h, sin_h;        /* of the cone, up to a right angle */
    float cos_eye, sin_spread; /* of its axis; of the sphere as the eye sees it */
    float cos_spread, cos_light;
    float wrong;
    bool bounded; /* the cone: below a right angle */
} angles;

/* Between what and what the weight of a node lies that does not face away. Sines are taken from
 * cosines: where these are near 1 that is wrong by the square root, and more by a little. */
static inline __attribute__((always_inline)) void tightening(const mni_sieve *s, const angles *a,
                                                             float *low, float *high) {
    float wrong = 4 * sqrtf(a->wrong);
    float sin_eye = sqrtf(most_of(1 - a->cos_eye * a->cos_eye, 0));
    float sin_a = a->sin_h * a->cos_spread + a->cos_h * a->sin_spread;
    float cos_a = a->cos_h * a->cos_spread - a->sin_h * a->sin_spread;
    float cos_widest = a->cos_eye * cos_a - sin_eye * sin_a;
    float sin_widest = sin_eye * cos_a + a->cos_eye * sin_a;
    float least_cos = least_of(least_of(a->cos_eye, cos_a), cos_widest);
    float most_s = least_cos < wrong ? 1 : sin_widest + wrong;
    float least_s = least_cos < -wrong ? 1 : sin_widest - wrong;

    float sin_light = sqrtf(most_of(1 - a->cos_light * a->cos_light, 0));
    float bright = a->cos_light * a->cos_h + sin_light * a->sin_h;
    float dark = most_of(a->cos_light * a->cos_h - sin_light * a->sin_h, 0);
    float most_b = a->cos_light > a->cos_h - wrong ? 1 : bright;
    float least_b = a->cos_light > a->cos_h + wrong ? 1 : bright;
    float most_c = a->bounded ? most_of(most_b, 0) - dark + wrong : 1;
    float least_c = most_of(least_b, 0) - dark - wrong;

    *high = most_of(1, most_of(s->silhouette * most_s, 1 + (s->light - 1) * most_c));
    *low = most_of(1, most_of(s->silhouette * least_s, 1 + (s->light - 1) * least_c));
}

/* A cone's axis, not of length 1, and sine and cosine of its half angle; without a bound, of a
 * right one. */
static inline __attribute__((always_inline)) void unfold(float u, float v, float h, float axis[3],
                                                         float *sin_h, float *cos_h) {
    u *= 1.0f / MN_CONE_AXIS;
    v *= 1.0f / MN_CONE_AXIS;
    float w = 1 - fabsf(u) - fabsf(v);
    float fu = copysignf(1 - fabsf(v), u), fv = copysignf(1 - fabsf(u), v);
    axis[0] = w < 0 ? fu : u;
    axis[1] = w < 0 ? fv : v;
    axis[2] = w;
    h *= PI_F / 2 / MN_CONE_NO_BOUND;
    float hh = h * h;
    *cos_h =
        1 + hh * (-1 / 2.0f +
                  hh * (1 / 24.0f + hh * (-1 / 720.0f + hh * (1 / 40320.0f - hh / 3628800.0f))));
    *sin_h = h * (1 + hh * (-1 / 6.0f +
                            hh * (1 / 120.0f +
                                  hh * (-1 / 5040.0f + hh * (1 / 362880.0f - hh / 39916800.0f)))));
}

/* Everything of one node; no branches. */
static inline __attribute__((always_inline)) uint8_t
judge(const mni_sieve *s, const mni_sieve_batch *b, int i, bool tightens, float *margin) {
    float dx = b->x[i] - s->eye[0], dy = b->y[i] - s->eye[1], dz = b->z[i] - s->eye[2];
    float r = b->radius[i], square = dx * dx + dy * dy + dz * dz, d = sqrtf(square);
    float slack = s->slack + RELATIVE * d;

    float inmost = INFINITY; /* of the sphere, over the plane that it is least inside of */
    for (int p = 0; p < 5; p++)
        inmost = least_of(inmost, s->plane[p][0] * dx + s->plane[p][1] * dy + s->plane[p][2] * dz);
    inmost += r;
    bool out = inmost<-slack, in = inmost> slack;

    float axis[3], sin_h, cos_h;
    unfold(b->axis[0][i], b->axis[1][i], b->angle[i], axis, &sin_h, &cos_h);
    float u = axis[0], v = axis[1], w = axis[2], length = sqrtf(u * u + v * v + w * w);
    float along = -(u * dx + v * dy + w * dz); /* × length */
    float rest = square - r * r, unsure = 2e-6f * square + 4 * s->slack * d;
    float most = sqrtf(rest + unsure > 0 ? rest + unsure : 0);
    float least = sqrtf(rest - unsure > 0 ? rest - unsure : 0);
    bool away = (d > r + slack) & (cos_h * least - sin_h * r > slack) &
                (along < -length * (sin_h * most + cos_h * r + slack));
    bool facing = (cos_h * most - sin_h * r < -slack) | (d < r - slack) |
                  (along > -length * (sin_h * least + cos_h * r - slack));

    float low = 1, high = 1;
    if (tightens) {
        float scale = 1 / (d * length), to_light = u * s->light_from[0] + v * s->light_from[1];
        bool beyond = d > r + slack;
        angles a = {.cos_h = cos_h,
                    .sin_h = sin_h,
                    .cos_eye = beyond ? along * scale : -1,
                    .sin_spread = beyond ? r / d : 1,
                    .cos_spread = beyond ? sqrtf(most_of(rest, 0)) / d : 0,
                    .cos_light = (to_light + w * s->light_from[2]) / length,
                    .wrong = beyond ? 2e-6f + s->slack / d : 1,
                    .bounded = b->angle[i] < MN_CONE_NO_BOUND};
        tightening(s, &a, &low, &high);
    }
    float reach = s->reach * b->switch_value[i];
    float at_most = (out ? s->outside : 1) * (away ? s->away : high);
    float at_least = (in ? 1 : s->outside) * (facing ? low : s->away);
    bool unwanted = d > (reach * at_most + r) * (1 + RELATIVE) + slack;
    bool wanted = (d < (reach * at_least + r) * (1 - RELATIVE) - slack) &
                  (reach * at_least > s->distance_min);

    /* What each of these may give way by. A normal cone's tests change by 8/3 of the eye's way at
     * most as long as that leaves it 5/4 of the radius from the centre. */
    float cone_far = d - 1.25f * r, turned = along / length;
    float away_room =
        least_of(cos_h * least - sin_h * r - slack, -turned - (sin_h * most + cos_h * r + slack));
    float facing_room =
        most_of(sin_h * r - cos_h * most - slack, turned + sin_h * least + cos_h * r - slack);
    away_room = least_of(away_room * 0.37f, cone_far);
    facing_room = most_of(r - slack - d, least_of(facing_room * 0.37f, cone_far));
    facing_room = b->angle[i] < MN_CONE_NO_BOUND ? facing_room : INFINITY;
    float heaviest = s->reach_most * b->switch_value[i], heavy = out ? s->outside : 1;
    heavy = away ? reach * heavy * s->away : heaviest * heavy;
    float unwanted_room = d - (heavy + r) * (1 + RELATIVE) - slack;
    unwanted_room = least_of(unwanted_room, out ? -inmost - slack : INFINITY);
    unwanted_room = least_of(unwanted_room, away ? away_room : INFINITY);
    unwanted_room = most_of(unwanted_room, d - (heaviest + r) * (1 + RELATIVE) - slack);
    float light = reach * (in ? 1 : s->outside) * (facing ? 1 : s->away);
    float wanted_room = (light + r) * (1 - RELATIVE) - slack - d;
    wanted_room = least_of(wanted_room, in ? inmost - slack : INFINITY);
    wanted_room = least_of(wanted_room, facing ? facing_room : INFINITY);
    wanted_room = light > s->distance_min ? wanted_room : 0;
    *margin = most_of(unwanted ? unwanted_room : wanted ? wanted_room : 0, 0);
    return (uint8_t)(unwanted ? MNI_UNWANTED : wanted ? MNI_WANTED : MNI_UNSURE);
}

/* In double what is close to call, and, since the weight is known otherwise, the error alone. */
bool mni_sieve_wants(const mni_sieve *s, const mni_lens *lens, const mni_bounds *node,
                     double *priority_px) {
    float dx = node->position[0] - s->eye[0], dy = node->position[1] - s->eye[1];
    float dz = node->position[2] - s->eye[2], r = node->radius;
    float square = dx * dx + dy * dy + dz * dz, d = sqrtf(square), slack = s->slack + RELATIVE * d;
    float reach = s->reach * node->switch_value;
    if (d > (s->reach_most * node->switch_value + r) * (1 + RELATIVE) + slack)
        return false;
    float inmost = INFINITY;
    for (int p = 0; p < 5; p++)
        inmost = least_of(inmost, s->plane[p][0] * dx + s->plane[p][1] * dy + s->plane[p][2] * dz);
    inmost += r;
    bool out = inmost<-slack, in = inmost> slack;
    float weight = out ? s->outside : 1;
    if (!s->tightens && (in || out) && d > (reach * weight + r) * (1 + RELATIVE) + slack)
        return false;

    float axis[3], sin_h, cos_h;
    unfold(node->cone.axis[0], node->cone.axis[1], node->cone.angle, axis, &sin_h, &cos_h);
    float length = sqrtf(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    float along = -(axis[0] * dx + axis[1] * dy + axis[2] * dz);
    float rest = square - r * r, unsure = 2e-6f * square + 4 * s->slack * d;
    float most = sqrtf(most_of(rest + unsure, 0)), least = sqrtf(most_of(rest - unsure, 0));
    bool away = (d > r + slack) & (cos_h * least - sin_h * r > slack) &
                (along < -length * (sin_h * most + cos_h * r + slack));
    bool facing = (cos_h * most - sin_h * r < -slack) | (d < r - slack) |
                  (along > -length * (sin_h * least + cos_h * r - slack));
    if (!s->tightens && (in || out) && (away || facing)) {
        weight = away ? weight * s->away : weight;
        if (d > (reach * weight + r) * (1 + RELATIVE) + slack)
            return false;
        if (d < (reach * weight + r) * (1 - RELATIVE) - slack && reach * weight > s->distance_min) {
            *priority_px = mni_lens_error_px(lens, node);
            if (out && lens->outside > 1)
                *priority_px /= lens->outside;
            if (away && lens->away > 1)
                *priority_px /= lens->away;
            return true;
        }
    }
    if (!mni_lens_wants(lens, node))
        return false;
    *priority_px = mni_lens_priority(lens, node);
    return true;
}

static inline __attribute__((always_inline)) float far_room(const mni_sieve *s, const float *at,
                                                            float radius, float switch_value) {
    float dx = at[0] - s->eye[0], dy = at[1] - s->eye[1], dz = at[2] - s->eye[2];
    float d = sqrtf(dx * dx + dy * dy + dz * dz), slack = s->slack + RELATIVE * d;
    return most_of(d - (s->reach_most * switch_value + radius) * (1 + RELATIVE) - slack, 0);
}

static inline __attribute__((always_inline)) void
far_all(const mni_sieve *s, const mni_sieve *soon, const float *position, const float *radius,
        const float *switch_value, float *margin) {
    if (soon == NULL)
        for (int i = 0; i < MNI_SIEVE_BATCH; i++)
            margin[i] = far_room(s, &position[3 * i], radius[i], switch_value[i]);
    else
        for (int i = 0; i < MNI_SIEVE_BATCH; i++) {
            float room = far_room(s, &position[3 * i], radius[i], switch_value[i]);
            float then = far_room(soon, &position[3 * i], radius[i], switch_value[i]);
            margin[i] = least_of(room, then);
        }
}

static inline __attribute__((always_inline)) void judge_all(const mni_sieve *s,
                                                            const mni_sieve_batch *b,
                                                            uint8_t verdict[MNI_SIEVE_BATCH],
                                                            float margin[MNI_SIEVE_BATCH]) {
    if (s->tightens)
        for (int i = 0; i < MNI_SIEVE_BATCH; i++)
            verdict[i] = judge(s, b, i, true, &margin[i]);
    else
        for (int i = 0; i < MNI_SIEVE_BATCH; i++)
            verdict[i] = judge(s, b, i, false, &margin[i]);
}

#if defined(__x86_64__)
#include <immintrin.h>
__attribute__((target("avx2"))) static void judge_avx2(const mni_sieve *s, const mni_sieve_batch *b,
                                                       uint8_t verdict[MNI_SIEVE_BATCH],
                                                       float margin[MNI_SIEVE_BATCH]) {
    judge_all(s, b, verdict, margin);
}

__attribute__((target("avx2"))) static void far_avx2(const mni_sieve *s, const mni_sieve *soon,
                                                     const float *position, const float *radius,
                                                     const float *switch_value, float *margin) {
    far_all(s, soon, position, radius, switch_value, margin);
}
#endif

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target("avx512f,avx512bw,avx512vl,avx512dq,prefer-vector-width=512")))
WIDE static void judge_avx512(const mni_sieve *s, const mni_sieve_batch *b,
                              uint8_t verdict[MNI_SIEVE_BATCH], float margin[MNI_SIEVE_BATCH]) {
    judge_all(s, b, verdict, margin);
}
#endif

#if defined(__x86_64__)
__attribute__((target("avx2"))) static uint64_t late_avx2(const float *due, float clock) {
    const __m256 now = _mm256_set1_ps(clock);
    uint64_t bits = 0;
#pragma GCC unroll 8
    for (int i = 0; i < MNI_SIEVE_BATCH; i += 8) {
        const __m256 late = _mm256_cmp_ps(_mm256_loadu_ps(due + i), now, _CMP_LE_OQ);
        bits |= (uint64_t)(uint32_t)_mm256_movemask_ps(late) << i;
    }
    return bits;
}
#endif

uint64_t mni_sieve_late(const float due[MNI_SIEVE_BATCH], float clock) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2"))
        return late_avx2(due, clock);
#endif
    uint8_t late[MNI_SIEVE_BATCH];
    uint64_t bits = 0;
    for (int i = 0; i < MNI_SIEVE_BATCH; i++)
        late[i] = due[i] <= clock;
    for (int i = 0; i < MNI_SIEVE_BATCH; i += 8) {
        uint64_t eight;
        memcpy(&eight, &late[i], sizeof eight);
        bits |= (eight * UINT64_C(0x0102040810204080) >> 56) << i;
    }
    return bits;
}

void mni_sieve_far(const mni_sieve *s, const mni_sieve *soon, const float *position,
                   const float *radius, const float *switch_value, float margin[MNI_SIEVE_BATCH]) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        far_avx2(s, soon, position, radius, switch_value, margin);
        return;
    }
#endif
    far_all(s, soon, position, radius, switch_value, margin);
}

void mni_sieve_judge(const mni_sieve *s, const mni_sieve_batch *b, uint8_t verdict[MNI_SIEVE_BATCH],
                     float margin[MNI_SIEVE_BATCH]) {
#ifdef WIDE
    if (__builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512dq")) {
        judge_avx512(s, b, verdict, margin);
        return;
    }
#endif
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2")) {
        judge_avx2(s, b, verdict, margin);
        return;
    }
#endif
    judge_all(s, b, verdict, margin);
}
