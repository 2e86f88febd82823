/* See orbit.h. The eye is the target plus a direction of two angles, so that no history of drags
 * can roll the horizon. What is squared is a double: floats hold models whose squares they do not.
 */
#include "orbit.h"

#include <math.h>
#include <string.h>

static const float half_pi = 1.5707963f;
static const float tilt_max = 1.55f; /* a degree short of the pole: up must not lie on the axis */

/* Unit vectors of the view: right, up, and from the target to the eye. */
static void axes(const orbit *o, float right[3], float up[3], float back[3]) {
    const float st = sinf(o->turn), ct = cosf(o->turn), sp = sinf(o->tilt), cp = cosf(o->tilt);
    memcpy(right, (float[3]){ct, 0, -st}, sizeof(float[3]));
    memcpy(up, (float[3]){-st * sp, cp, -ct * sp}, sizeof(float[3]));
    memcpy(back, (float[3]){st * cp, sp, ct * cp}, sizeof(float[3]));
}

static float clamp(float v, float min, float max) {
    return fminf(fmaxf(v, min), max);
}

orbit orbit_from(const mn_camera *camera, float radius) {
    orbit o = {.fov_y_deg = camera->fov_y_deg};
    float d[3];
    double square = 0;
    for (int i = 0; i < 3; i++) {
        o.target[i] = camera->target[i];
        d[i] = camera->eye[i] - camera->target[i];
        square += (double)d[i] * (double)d[i];
    }
    if (!(radius > 0))
        radius = 1;
    o.distance_min = 1e-5f * radius;
    o.distance_max = 100 * radius;
    o.distance = clamp((float)sqrt(square), o.distance_min, o.distance_max);
    o.turn = atan2f(d[0], d[2]);
    o.tilt = clamp(asinf(clamp(d[1] / o.distance, -1, 1)), -tilt_max, tilt_max);
    return o;
}

mn_camera orbit_camera(const orbit *o) {
    mn_camera camera = {.up = {0, 1, 0}, .fov_y_deg = o->fov_y_deg};
    float right[3], up[3], back[3];
    axes(o, right, up, back);
    for (int i = 0; i < 3; i++) {
        camera.target[i] = o->target[i];
        camera.eye[i] = o->target[i] + o->distance * back[i];
    }
    return camera;
}

void orbit_turn(orbit *o, float right, float down) {
    o->turn = remainderf(o->turn - 2 * half_pi * right, 4 * half_pi);
    o->tilt = clamp(o->tilt + 2 * half_pi * down, -tilt_max, tilt_max);
}

void orbit_pan(orbit *o, float right, float down) {
    float x[3], y[3], back[3];
    const float height = 2 * o->distance * tanf(o->fov_y_deg * half_pi / 180);
    axes(o, x, y, back);
    for (int i = 0; i < 3; i++)
        o->target[i] += height * (down * y[i] - right * x[i]);
}

void orbit_zoom(orbit *o, float notches) {
    o->distance = clamp(o->distance * powf(0.875f, notches), o->distance_min, o->distance_max);
}

/* Distance along the ray at which it meets the triangle, from either side; negative: it does not.
 * Möller and Trumbore. */
static float meets(const float eye[3], const float along[3], const float *a, const float *b,
                   const float *c) {
    double d[3], e[3], f[3], s[3];
    for (int i = 0; i < 3; i++) {
        d[i] = (double)along[i];
        e[i] = (double)b[i] - (double)a[i];
        f[i] = (double)c[i] - (double)a[i];
        s[i] = (double)eye[i] - (double)a[i];
    }
    const double p[3] = {d[1] * f[2] - d[2] * f[1], d[2] * f[0] - d[0] * f[2],
                         d[0] * f[1] - d[1] * f[0]};
    const double q[3] = {s[1] * e[2] - s[2] * e[1], s[2] * e[0] - s[0] * e[2],
                         s[0] * e[1] - s[1] * e[0]};
    const double volume = e[0] * p[0] + e[1] * p[1] + e[2] * p[2];
    const double u = (s[0] * p[0] + s[1] * p[1] + s[2] * p[2]) / volume;
    const double v = (d[0] * q[0] + d[1] * q[1] + d[2] * q[2]) / volume;
    if (!(u >= 0 && v >= 0 && u + v <= 1)) /* also when the volume is 0 */
        return -1;
    return (float)((f[0] * q[0] + f[1] * q[1] + f[2] * q[2]) / volume);
}

void orbit_aim(orbit *o, const mn_front *front) {
    const mn_camera camera = orbit_camera(o);
    float right[3], up[3], along[3], nearest = INFINITY;
    axes(o, right, up, along);
    for (int i = 0; i < 3; i++)
        along[i] = -along[i];
    for (uint32_t s = 0; s < front->simplex_slots; s++) {
        const uint32_t *v = front->simplex_node + 3 * (size_t)s;
        if (v[0] == MN_NONE || v[2] == MN_NONE)
            continue;
        const float t =
            meets(camera.eye, along, front->position + 3 * (size_t)v[0],
                  front->position + 3 * (size_t)v[1], front->position + 3 * (size_t)v[2]);
        if (t > 0 && t < nearest)
            nearest = t;
    }
    if (nearest >= o->distance_max)
        return;
    o->distance = fmaxf(nearest, o->distance_min);
    for (int i = 0; i < 3; i++)
        o->target[i] = camera.eye[i] + o->distance * along[i];
}
