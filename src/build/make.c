/* mn_make: the table of shapes, and what they share. Any thread; owns nothing between calls. */
#include "make.h"

#include <math.h>

#include "noise.h"

/* By mn_shape. A shape adds itself here. */
static mn_code (*const shapes[])(const mn_make_desc *, mni_make_ply *, mn_status *) = {
    [MN_SHAPE_SPHERE] = mni_make_sphere,
    [MN_SHAPE_TERRAIN] = mni_make_terrain,
    [MN_SHAPE_ISOSURFACE] = mni_make_isosurface,
    [MN_SHAPE_EARTH] = mni_make_earth,
};

/* Vertices are numbered with 32 bits and a reader takes 2^31 - 1 of them; closed surfaces have half
 * as many vertices as triangles. */
#define TRIANGLES_MAX UINT64_C(4000000000)

mn_code mni_make_progress(const mn_make_desc *desc, const mni_make_ply *ply, uint64_t done,
                          uint64_t total, mn_status *st) {
    if (ply->trouble.code != MN_OK)
        return ply->trouble.code; /* its text is told by close */
    if (desc->progress == NULL || desc->progress(desc->progress_context, "making", done, total))
        return MN_OK;
    return mn_fail(st, MN_FAILED, "interrupted");
}

uint64_t mni_make_sqrt(double n) {
    return (uint64_t)(sqrt(n) + 0.5);
}

double mni_make_step(double low, double high, double x) {
    double t = (x - low) / (high - low);
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return t * t * (3 - 2 * t);
}

double mni_make_sine(double t) {
    t -= (double)mni_noise_floor(t + 0.5);
    if (t > 0.25)
        t = 0.5 - t;
    if (t < -0.25)
        t = -0.5 - t;
    double x = 2 * MNI_PI * t, x2 = x * x, term = x, sum = x;
    for (int i = 2; i <= 16; i += 2) {
        term *= -x2 / (double)(i * (i + 1));
        sum += term;
    }
    return sum;
}

mni_rgb mni_rgb_mix(mni_rgb a, mni_rgb b, double t) {
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return (mni_rgb){a.r + t * (b.r - a.r), a.g + t * (b.g - a.g), a.b + t * (b.b - a.b)};
}

static uint32_t byte_of(double x) {
    return x <= 0 ? 0 : x >= 1 ? 255 : (uint32_t)(255 * x + 0.5);
}

uint32_t mni_rgb_pack(mni_rgb c) {
    return byte_of(c.r) | byte_of(c.g) << 8 | byte_of(c.b) << 16;
}

mn_code mn_make(const char *path, const mn_make_desc *desc, mn_status *st) {
    mn_make_desc d = *desc;
    if (d.triangles == 0)
        d.triangles = 100000;
    if (d.triangles > TRIANGLES_MAX)
        return mn_fail(st, MN_USAGE, "%llu triangles are more than the %llu that can be made",
                       (unsigned long long)d.triangles, (unsigned long long)TRIANGLES_MAX);
    if ((unsigned)d.shape >= sizeof shapes / sizeof shapes[0])
        return mn_fail(st, MN_USAGE, "no such shape");
    mni_make_ply ply;
    mn_code code = mni_make_ply_open(&ply, path, st);
    if (code != MN_OK)
        return code;
    code = shapes[d.shape](&d, &ply, st);
    mn_code closed = mni_make_ply_close(&ply, code == MN_OK, st);
    return code != MN_OK ? code : closed;
}
