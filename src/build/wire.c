/* See wire.h. Hidden here: how numbers are made short. */
#include "wire.h"

#include <math.h>
#include <string.h>

enum { DROPPED_BITS = 16, NO_WITNESS = MNI_WIRE_NO_WITNESS };
#define UNIT 32767.0f

/* Of a distance below 2^63, rounded up. */
static float upwards(uint64_t distance) {
    float x = (float)distance;
    return (uint64_t)x < distance ? nextafterf(x, INFINITY) : x;
}

mni_wire_reach mni_wire_reach_of(uint64_t key, mni_wire_range range) {
    return (mni_wire_reach){range.low < key ? upwards(key - range.low) : 0,
                            range.high > key ? upwards(range.high - key) : 0};
}

static void put_double(uint8_t to[6], double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    bits = (bits + (1 << (DROPPED_BITS - 1))) >> DROPPED_BITS;
    memcpy(to, &bits, 6);
}

static double get_double(const uint8_t from[6]) {
    uint64_t bits = 0;
    double x;
    memcpy(&bits, from, 6);
    bits <<= DROPPED_BITS;
    memcpy(&x, &bits, sizeof x);
    return x;
}

void mni_wire_put_quadric(mni_wire_vertex *to, const mni_vertex *q) {
    const double all[10] = {q->c, q->xx, q->yy, q->zz, q->xy, q->xz, q->yz, q->x, q->y, q->z};
    for (int i = 0; i < 10; i++)
        put_double(to->quadric[i], all[i]);
}

void mni_wire_get_quadric(const mni_wire_vertex *from, mni_vertex *q) {
    double all[10];
    for (int i = 0; i < 10; i++)
        all[i] = get_double(from->quadric[i]);
    q->c = all[0], q->xx = all[1], q->yy = all[2], q->zz = all[3];
    q->xy = all[4], q->xz = all[5], q->yz = all[6];
    q->x = all[7], q->y = all[8], q->z = all[9];
}

/* Of a float that is not negative the first 16 bits, rounded up. */
static uint16_t put_slack(float slack) {
    uint32_t bits;
    memcpy(&bits, &slack, sizeof bits);
    return slack >= 0 ? (uint16_t)((bits + 0xffff) >> 16) : NO_WITNESS;
}

static float get_slack(uint16_t slack) {
    uint32_t bits = (uint32_t)slack << 16;
    float x;
    memcpy(&x, &bits, sizeof x);
    return slack == NO_WITNESS ? -1 : x;
}

void mni_wire_put_witnesses(mni_wire_vertex *to, const mni_witnesses *from) {
    float farthest = 0;
    for (int i = 0; i < MNI_WITNESSES; i++)
        if (from->slack[i] >= 0) {
            farthest = fmaxf(farthest, fabsf(from->x[i] - to->p[0]));
            farthest = fmaxf(farthest, fabsf(from->y[i] - to->p[1]));
            farthest = fmaxf(farthest, fabsf(from->z[i] - to->p[2]));
        }
    to->scale = farthest / UNIT;
    for (int i = 0; i < MNI_WITNESSES; i++) {
        const float at[3] = {from->x[i] - to->p[0], from->y[i] - to->p[1], from->z[i] - to->p[2]};
        bool is = from->slack[i] >= 0 && to->scale > 0;
        for (int c = 0; c < 3; c++)
            to->witness[i][c] =
                is ? (int16_t)fmaxf(fminf(rintf(at[c] / to->scale), UNIT), -UNIT) : 0;
        to->slack[i] = put_slack(from->slack[i]);
    }
}

void mni_wire_get_witnesses(const mni_wire_vertex *from, mni_witnesses *to) {
    for (int i = 0; i < MNI_WITNESSES; i++) {
        to->x[i] = from->p[0] + (float)from->witness[i][0] * from->scale;
        to->y[i] = from->p[1] + (float)from->witness[i][1] * from->scale;
        to->z[i] = from->p[2] + (float)from->witness[i][2] * from->scale;
        to->slack[i] = get_slack(from->slack[i]);
    }
}

void mni_wire_put_normal(mni_wire_simplex *to, const float normal[3]) {
    for (int i = 0; i < 3; i++)
        to->normal[i] = (int16_t)rintf(normal[i] * UNIT);
    to->zero = 0;
}

void mni_wire_get_normal(const mni_wire_simplex *from, float normal[3]) {
    for (int i = 0; i < 3; i++)
        normal[i] = (float)from->normal[i] / UNIT;
}
