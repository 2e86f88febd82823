/* See stress_motion.h. Hides the kinds of motion: each lasts for a stretch of frames by lot. */
#include "stress_motion.h"

#include <math.h>
#include <string.h>

enum { REST, WALK, ZOOM, TELEPORT, BACK, HOME, CLOSER, KINDS };
enum { STRETCH_MIN = 4, STRETCH_MAX = 30, ZOOM_PERIOD = 12 };
static const double NEAR = 0.01, FAR = 8; /* radii */

uint32_t motion_dice(uint64_t *state) {
    uint64_t z = *state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return (uint32_t)((z ^ (z >> 31)) >> 32);
}

static double uniform(motion *m, double low, double high) {
    return low + (high - low) * motion_dice(&m->dice) / 4294967296.0;
}

static void anywhere(motion *m, motion_place *p) {
    p->yaw = uniform(m, -M_PI, M_PI);
    p->pitch = uniform(m, -1.5, 1.5);
    p->distance = NEAR * pow(FAR / NEAR, uniform(m, 0, 1));
    for (int i = 0; i < 3; i++)
        p->target[i] = uniform(m, -1, 1);
}

void motion_begin(motion *m, const mn_header *h, uint64_t seed) {
    double square = 0;
    memset(m, 0, sizeof *m);
    m->dice = seed ^ UINT64_C(0x5354524553530000);
    for (int i = 0; i < 3; i++) {
        m->middle[i] = 0.5f * (h->box_min[i] + h->box_max[i]);
        m->half[i] = 0.5f * (h->box_max[i] - h->box_min[i]);
        square += (double)m->half[i] * (double)m->half[i];
    }
    m->radius = square > 0 ? sqrt(square) : 1;
    anywhere(m, &m->at);
}

static void new_stretch(motion *m) {
    m->kind = (int)(motion_dice(&m->dice) % KINDS);
    m->left = STRETCH_MIN + motion_dice(&m->dice) % (STRETCH_MAX - STRETCH_MIN);
    m->steps = 0;
    m->speed.yaw = uniform(m, -0.2, 0.2);
    m->speed.pitch = uniform(m, -0.1, 0.1);
    m->speed.distance = uniform(m, -0.3, 0.3);
    if (m->kind == ZOOM)
        m->speed.distance = uniform(m, 0.1, 0.8);
}

static void move(motion *m) {
    motion_place *p = &m->at;
    switch (m->kind) {
    case WALK:
        m->speed.yaw += uniform(m, -0.05, 0.05);
        m->speed.distance = fmax(-0.4, fmin(0.4, m->speed.distance + uniform(m, -0.1, 0.1)));
        p->yaw += m->speed.yaw;
        p->pitch = fmax(-1.5, fmin(1.5, p->pitch + m->speed.pitch));
        p->distance *= exp(m->speed.distance);
        break;
    case ZOOM: /* in and out again */
        p->distance *=
            exp(m->steps / (ZOOM_PERIOD / 2) % 2 == 0 ? -m->speed.distance : m->speed.distance);
        break;
    case TELEPORT:
        anywhere(m, p);
        break;
    case BACK: /* the way it has come */
        if (m->passed > 0)
            *p = m->past[--m->passed % MOTION_PAST];
        break;
    default: /* the camera stands */
        break;
    }
    p->distance = fmax(NEAR, fmin(FAR, p->distance));
    if (m->kind != BACK)
        m->past[m->passed++ % MOTION_PAST] = *p;
    m->steps++;
}

motion_step motion_next(motion *m, mn_camera *out) {
    if (m->left == 0)
        new_stretch(m);
    m->left--;
    move(m);
    const motion_place *p = &m->at;
    const double d = p->distance * m->radius;
    const double way[3] = {cos(p->pitch) * sin(p->yaw), sin(p->pitch), cos(p->pitch) * cos(p->yaw)};
    *out = (mn_camera){.up = {0, 1, 0}, .fov_y_deg = 45};
    for (int i = 0; i < 3; i++) {
        out->target[i] = m->middle[i] + (float)p->target[i] * m->half[i];
        out->eye[i] = out->target[i] + (float)(d * way[i]);
    }
    m->camera = *out;
    return m->kind == HOME ? MOTION_TO_ROOTS : m->kind == CLOSER ? MOTION_CLOSER : MOTION_AS_IT_IS;
}
