/* See wire.h. Hidden here: how numbers are made short.
 *
 *   vertex:  flags, place, reach, node and what is below it, value, key, bounds, quadric, witnesses
 *   simplex: flags, corners, origins that are not the corners, reach and places, normal */
#include "wire.h"

#include <math.h>
#include <string.h>

#include "mn_assert.h"
#include "varint.h"

enum { FIXED_BITS = 31, FAR = 900 /* exponents beyond count as 0 */, PLACE_BITS = 24 };
enum { WITNESSES_MASK = 15, IS_NODE = 16, REACHES = 32, HAS_VALUE = 64, HAS_OFFSET = 128 };
enum { IS_HINGE = 1, MOVED = 2 /* 4, 8 */, CROSSES = 16, HAS_NORMAL = 32 };
#define UNIT 32767.0f
_Static_assert((int)MNI_WITNESSES <= (int)WITNESSES_MASK, "their number has its bits");

/* ---- numbers -------------------------------------------------------------------------------- */

static unsigned char *put_bytes(unsigned char *to, const void *from, size_t count) {
    memcpy(to, from, count);
    return to + count;
}

static void get_bytes(const unsigned char **at, void *to, size_t count) {
    memcpy(to, *at, count);
    *at += count;
}

static unsigned char *put_u32(unsigned char *to, uint32_t value, uint32_t from) {
    return mni_varint_put(to, mni_fold(value, from));
}

static uint32_t get_u32(const unsigned char **at, uint32_t from) {
    return mni_unfold(mni_varint_take(at), from);
}

/* 2^exponent, of those that normal doubles have. */
static double power_of_2(int exponent) {
    const uint64_t bits = (uint64_t)(exponent + 1023) << 52;
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* As frexp says; of what is less than normal, something below -FAR. */
static int exponent_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return x == 0 ? 0 : (int)(bits >> 52 & 2047) - 1022;
}

/* To the nearest integer, to the even one of two; of numbers below 2^51. */
static double nearest(double x) {
    return x + 0x1.8p52 - 0x1.8p52;
}

/* Of numbers below 2^22. */
static float nearest_float(float x) {
    return x + 0x1.8p23f - 0x1.8p23f;
}

/* Numbers that are added to each other: of all as many bits below the largest one's first. */
static unsigned char *put_fixed(unsigned char *to, const double *x, int count) {
    double largest = 0;
    for (int i = 0; i < count; i++)
        largest = fabs(x[i]) > largest ? fabs(x[i]) : largest;
    const int exponent = exponent_of(largest);
    int16_t shift = (int16_t)(exponent > -FAR ? FIXED_BITS - exponent : FIXED_BITS + FAR);
    double scale = power_of_2(shift);
    to = put_bytes(to, &shift, sizeof shift);
    for (int i = 0; i < count; i++) {
        double at = nearest(x[i] * scale);
        int32_t fixed = (int32_t)(at < INT32_MAX ? at > -INT32_MAX ? at : -INT32_MAX : INT32_MAX);
        to = put_bytes(to, &fixed, sizeof fixed);
    }
    return to;
}

static void get_fixed(const unsigned char **at, double *x, int count) {
    int16_t shift;
    get_bytes(at, &shift, sizeof shift);
    double scale = power_of_2(-shift);
    for (int i = 0; i < count; i++) {
        int32_t fixed;
        get_bytes(at, &fixed, sizeof fixed);
        x[i] = fixed * scale;
    }
}

/* Of a float that is not negative the first 16 bits, rounded up. */
static uint16_t short_of(float x) {
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (uint16_t)((bits + 0xffff) >> 16);
}

static float of_short(uint16_t x) {
    uint32_t bits = (uint32_t)x << 16;
    float y;
    memcpy(&y, &bits, sizeof y);
    return y;
}

static unsigned char *put_reach(const mni_wire_pen *pen, unsigned char *to, mni_wire_reach r) {
    to = put_u32(to, r.low, pen->tile);
    return mni_varint_put(to, r.high - r.low);
}

static mni_wire_reach get_reach(const mni_wire_pen *pen, const unsigned char **at) {
    uint32_t low = get_u32(at, pen->tile);
    return (mni_wire_reach){low, low + (uint32_t)mni_varint_take(at)};
}

/* ---- places --------------------------------------------------------------------------------- */

bool mni_wire_on_grid(const float p[3], float step) {
    for (int i = 0; i < 3; i++) {
        float x = p[i] / step;
        if (!(fabsf(x) < 1 << PLACE_BITS && (float)(int32_t)x == x && x * step == p[i]))
            return false;
    }
    return true;
}

static unsigned char *put_place(mni_wire_pen *pen, unsigned char *to, const float p[3]) {
    if (pen->step == 0)
        return put_bytes(to, p, 3 * sizeof *p);
    MN_ASSERT(mni_wire_on_grid(p, pen->step));
    for (int i = 0; i < 3; i++) {
        uint32_t place = (1u << PLACE_BITS) + (uint32_t)(int32_t)(p[i] / pen->step);
        to = put_u32(to, place, pen->place[i]);
        pen->place[i] = place;
    }
    return to;
}

static void get_place(mni_wire_pen *pen, const unsigned char **at, float p[3]) {
    if (pen->step == 0) {
        get_bytes(at, p, 3 * sizeof *p);
        return;
    }
    for (int i = 0; i < 3; i++) {
        pen->place[i] = get_u32(at, pen->place[i]);
        p[i] = (float)((int32_t)pen->place[i] - (1 << PLACE_BITS)) * pen->step;
    }
}

/* ---- vertices ------------------------------------------------------------------------------- */

unsigned char *mni_wire_put_id(mni_wire_pen *pen, unsigned char *to, uint32_t id) {
    to = put_u32(to, id, pen->id);
    pen->id = id;
    return to;
}

uint32_t mni_wire_get_id(mni_wire_pen *pen, const unsigned char **at) {
    return pen->id = get_u32(at, pen->id);
}

static uint32_t witnesses_of(const mni_witnesses *w) {
    uint32_t count = 0;
    while (count < MNI_WITNESSES && w->slack[count] >= 0)
        count++;
    return count;
}

static float larger(float a, float b) {
    return b > a ? b : a;
}

static int16_t steps_of(float x) {
    return (int16_t)nearest_float(x < UNIT ? x > -UNIT ? x : -UNIT : UNIT);
}

/* Relative to p. */
static unsigned char *put_witnesses(unsigned char *to, const mni_wire_vertex *v, uint32_t count,
                                    bool slack) {
    const mni_witnesses *w = &v->points;
    const float *const of[3] = {w->x, w->y, w->z};
    float farthest = 0;
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++)
            farthest = larger(farthest, fabsf(of[c][i] - v->p[c]));
    float scale = farthest / UNIT;
    to = put_bytes(to, &scale, sizeof scale);
    for (uint32_t i = 0; i < count; i++) {
        int16_t at[3] = {0, 0, 0};
        for (int c = 0; c < 3 && scale > 0; c++)
            at[c] = steps_of((of[c][i] - v->p[c]) / scale);
        to = put_bytes(to, at, sizeof at);
        if (slack) {
            uint16_t more = short_of(w->slack[i]);
            to = put_bytes(to, &more, sizeof more);
        }
    }
    return to;
}

static void get_witnesses(const unsigned char **at, mni_wire_vertex *v, uint32_t count,
                          bool slack) {
    mni_witnesses *w = &v->points;
    float scale;
    get_bytes(at, &scale, sizeof scale);
    for (uint32_t i = 0; i < MNI_WITNESSES; i++) {
        int16_t from[3] = {0, 0, 0};
        uint16_t more = 0;
        if (i < count)
            get_bytes(at, from, sizeof from);
        if (i < count && slack)
            get_bytes(at, &more, sizeof more);
        w->x[i] = i < count ? v->p[0] + (float)from[0] * scale : 0;
        w->y[i] = i < count ? v->p[1] + (float)from[1] * scale : 0;
        w->z[i] = i < count ? v->p[2] + (float)from[2] * scale : 0;
        w->slack[i] = i < count ? of_short(more) : -1;
    }
}

static unsigned char *put_node(mni_wire_pen *pen, unsigned char *to, const mni_wire_vertex *v) {
    to = put_u32(to, v->node, pen->node);
    pen->node = v->node;
    to = mni_varint_put(to, v->leaves);
    to = mni_varint_put(to, v->split);
    return mni_varint_put(to, v->levels);
}

static void get_node(mni_wire_pen *pen, const unsigned char **at, mni_wire_vertex *v) {
    v->node = pen->node = get_u32(at, pen->node);
    v->leaves = (uint32_t)mni_varint_take(at);
    v->split = (uint32_t)mni_varint_take(at);
    v->levels = (uint32_t)mni_varint_take(at);
}

/* A quadric that has not been moved, a leaf's, is zero at its vertex: c and the linear part. */
static bool has_offset(const mni_wire_vertex *v) {
    const double *q = v->quadric;
    return q[0] != 0 || q[7] != 0 || q[8] != 0 || q[9] != 0;
}

unsigned char *mni_wire_put_vertex(mni_wire_pen *pen, unsigned char *to, const mni_wire_vertex *v) {
    bool is_node = v->node >= MNI_COLLAPSE;
    uint32_t witnesses = witnesses_of(&v->points), flags = witnesses;
    flags |= is_node ? IS_NODE : 0;
    flags |= v->reach.low < v->reach.high ? REACHES : 0;
    flags |= v->value != 0 || v->key != 0 ? HAS_VALUE : 0;
    flags |= has_offset(v) ? HAS_OFFSET : 0;
    *to++ = (unsigned char)flags;
    to = put_place(pen, to, v->p);
    if (flags & REACHES)
        to = put_reach(pen, to, v->reach);
    if (is_node)
        to = put_node(pen, to, v);
    if (flags & HAS_VALUE) {
        uint16_t value = short_of(v->value);
        to = put_bytes(to, &value, sizeof value);
        to = put_bytes(to, &v->key, sizeof v->key);
    }
    to = put_bytes(to, &v->bounds.radius, sizeof v->bounds.radius);
    to = put_bytes(to, &v->bounds.cone, sizeof v->bounds.cone);
    to = put_fixed(to, &v->quadric[1], 6);
    if (flags & HAS_OFFSET) {
        to = put_fixed(to, &v->quadric[0], 1);
        to = put_fixed(to, &v->quadric[7], 3);
    }
    return witnesses > 0 ? put_witnesses(to, v, witnesses, is_node) : to;
}

void mni_wire_get_vertex(mni_wire_pen *pen, const unsigned char **at, uint32_t id,
                         mni_wire_vertex *v) {
    uint32_t flags = *(*at)++, witnesses = flags & WITNESSES_MASK;
    *v = (mni_wire_vertex){
        .id = id, .node = id, .leaves = 1, .levels = 1, .reach = {pen->tile, pen->tile}};
    get_place(pen, at, v->p);
    if (flags & REACHES)
        v->reach = get_reach(pen, at);
    if (flags & IS_NODE)
        get_node(pen, at, v);
    if (flags & HAS_VALUE) {
        uint16_t value;
        get_bytes(at, &value, sizeof value);
        v->value = of_short(value);
        get_bytes(at, &v->key, sizeof v->key);
    }
    get_bytes(at, &v->bounds.radius, sizeof v->bounds.radius);
    get_bytes(at, &v->bounds.cone, sizeof v->bounds.cone);
    get_fixed(at, &v->quadric[1], 6);
    if (flags & HAS_OFFSET) {
        get_fixed(at, &v->quadric[0], 1);
        get_fixed(at, &v->quadric[7], 3);
    }
    if (witnesses > 0)
        get_witnesses(at, v, witnesses, flags & IS_NODE);
    else
        for (int i = 0; i < MNI_WITNESSES; i++)
            v->points.slack[i] = -1;
}

/* ---- simplices ------------------------------------------------------------------------------ */

unsigned char *mni_wire_put_simplex(mni_wire_pen *pen, unsigned char *to,
                                    const mni_wire_simplex *x) {
    bool is_hinge = x->v[2] == MN_NONE;
    uint32_t corners = is_hinge ? 2 : 3, flags = is_hinge ? IS_HINGE : 0;
    for (uint32_t c = 0; c < corners; c++)
        flags |= x->origin[c] != x->v[c] ? MOVED << c : 0;
    flags |= x->reach.low < x->reach.high ? CROSSES : 0;
    flags |= x->normal[0] != 0 || x->normal[1] != 0 || x->normal[2] != 0 ? HAS_NORMAL : 0;
    *to++ = (unsigned char)flags;
    for (uint32_t c = 0; c < corners; c++)
        to = put_u32(to, x->v[c], c == 0 ? pen->id : x->v[0]);
    pen->id = x->v[0];
    for (uint32_t c = 0; c < corners; c++)
        if (flags & MOVED << c)
            to = put_u32(to, x->origin[c], x->v[c]);
    if (flags & CROSSES) {
        to = mni_varint_put(to, x->reach.high - x->reach.low);
        for (uint32_t c = 0; c < corners; c++)
            to = put_place(pen, to, x->p[c]);
    }
    if (flags & HAS_NORMAL) {
        int16_t normal[3];
        for (int i = 0; i < 3; i++)
            normal[i] = (int16_t)nearest_float(x->normal[i] * UNIT);
        to = put_bytes(to, normal, sizeof normal);
    }
    return to;
}

void mni_wire_get_simplex(mni_wire_pen *pen, const unsigned char **at, mni_wire_simplex *x) {
    uint32_t flags = *(*at)++, corners = flags & IS_HINGE ? 2 : 3;
    *x = (mni_wire_simplex){.reach = {pen->tile, pen->tile}, .v[2] = MN_NONE, .origin[2] = MN_NONE};
    for (uint32_t c = 0; c < corners; c++)
        x->v[c] = get_u32(at, c == 0 ? pen->id : x->v[0]);
    pen->id = x->v[0];
    for (uint32_t c = 0; c < corners; c++)
        x->origin[c] = flags & MOVED << c ? get_u32(at, x->v[c]) : x->v[c];
    if (flags & CROSSES) {
        x->reach.high += (uint32_t)mni_varint_take(at);
        for (uint32_t c = 0; c < corners; c++)
            get_place(pen, at, x->p[c]);
    }
    if (flags & HAS_NORMAL) {
        int16_t normal[3];
        get_bytes(at, normal, sizeof normal);
        for (int i = 0; i < 3; i++)
            x->normal[i] = (float)normal[i] / UNIT;
    }
}

unsigned char *mni_wire_put_sight(mni_wire_pen *pen, unsigned char *to, const mni_wire_sight *s) {
    to = put_u32(to, s->id, pen->id);
    pen->id = s->id;
    return put_reach(pen, to, s->reach);
}

void mni_wire_get_sight(mni_wire_pen *pen, const unsigned char **at, mni_wire_sight *s) {
    s->id = pen->id = get_u32(at, pen->id);
    s->reach = get_reach(pen, at);
}
