/* What a camera wants of the tree.
 *
 * Hides: how a length becomes pixels, and what the frustum and the normal cones do to the
 * tolerance. A node is wanted split when its switch value, seen at the nearest point of its
 * bounding sphere, exceeds the tolerance. Outside the frustum the tolerance is 16 times, and where
 * all normals face away 8 times as large: detail that a turn of the head would show is near, and
 * yet not paid in full.
 *
 * Nested: switch values, spheres and cones of a node enclose those of its children, so a child is
 * never wanted where its parent is not. Each step keeps that: the nearest point of a sphere inside
 * another is no nearer, a sphere inside one that is outside the frustum is outside, and a cone
 * inside one that faces away, over a smaller sphere, faces away. Radii are rounded upwards as
 * floats; here all is computed in double, whose rounding is 1e-8 of that slack.
 *
 * Pure functions; any thread; no memory. Paper: §3.3.1 (switch and metric values). */
#include "wanted.h"

#include <math.h>

#include "assert.h"

#define PI 3.14159265358979323846

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* false: no direction to speak of. */
static bool unit(double v[3]) {
    double length = sqrt(dot(v, v));
    if (!(length > 0) || !isfinite(length))
        return false;
    for (int i = 0; i < 3; i++)
        v[i] /= length;
    return true;
}

/* Any right and up for a camera whose own are useless (up along the line of sight). */
static void frame_of(const mn_camera *camera, double forward[3], double right[3], double up[3]) {
    for (int i = 0; i < 3; i++)
        forward[i] = (double)camera->target[i] - (double)camera->eye[i];
    if (!unit(forward)) {
        forward[0] = forward[1] = 0;
        forward[2] = -1;
    }
    double given[3] = {camera->up[0], camera->up[1], camera->up[2]};
    cross(forward, given, right);
    if (!unit(right)) {
        double other[3] = {fabs(forward[0]) < 0.5, fabs(forward[0]) >= 0.5, 0};
        cross(forward, other, right);
        unit(right);
    }
    cross(right, forward, up);
}

void mni_lens_make(mni_lens *lens, const mn_camera *camera, uint32_t width_px, uint32_t height_px,
                   double size, double tolerance_px) {
    MN_ASSERT(width_px > 0 && height_px > 0);
    double forward[3], right[3], up[3];
    frame_of(camera, forward, right, up);
    double tan_y = tan((double)camera->fov_y_deg * PI / 360);
    double tan_x = tan_y * width_px / height_px;
    for (int i = 0; i < 3; i++) {
        lens->eye[i] = camera->eye[i];
        lens->plane[0][i] = right[i] + tan_x * forward[i];
        lens->plane[1][i] = -right[i] + tan_x * forward[i];
        lens->plane[2][i] = up[i] + tan_y * forward[i];
        lens->plane[3][i] = -up[i] + tan_y * forward[i];
        lens->plane[4][i] = forward[i];
    }
    for (int i = 0; i < 5; i++)
        unit(lens->plane[i]);
    lens->scale_px = height_px / (2 * tan_y);
    lens->distance_min = size > 0 ? size * 1e-6 : 1e-30;
    lens->tolerance_px = tolerance_px;
}

static double distance_to(const mni_lens *lens, const float position[3]) {
    double d[3] = {lens->eye[0] - position[0], lens->eye[1] - position[1],
                   lens->eye[2] - position[2]};
    return sqrt(dot(d, d));
}

double mni_lens_error_px(const mni_lens *lens, const mni_bounds *node) {
    double nearest = distance_to(lens, node->position) - (double)node->radius;
    if (nearest < lens->distance_min)
        nearest = lens->distance_min;
    return lens->scale_px * (double)node->switch_value / nearest;
}

bool mni_lens_inside(const mni_lens *lens, const mni_bounds *node) {
    double d[3] = {node->position[0] - lens->eye[0], node->position[1] - lens->eye[1],
                   node->position[2] - lens->eye[2]};
    for (int i = 0; i < 5; i++)
        if (dot(lens->plane[i], d) < -(double)node->radius)
            return false;
    return true;
}

/* With the eye at distance d from the sphere's centre, the directions from points of the sphere to
 * the eye spread by asin(r / d) about the one from the centre, and the normals by the cone's half
 * angle about its axis: all face away when the axes differ by more than a right angle plus both. */
bool mni_lens_away(const mni_lens *lens, const mni_bounds *node) {
    double half = mn_cone_half_angle(node->cone);
    double distance = distance_to(lens, node->position), radius = node->radius;
    if (half >= PI / 2 || distance <= radius)
        return false;
    float axis[3];
    mn_cone_axis(node->cone, axis);
    double along = 0;
    for (int i = 0; i < 3; i++)
        along += (double)axis[i] * (lens->eye[i] - (double)node->position[i]);
    if (along >= 0)
        return false; /* what follows costs more */
    double sin_spread = radius / distance, spread = asin(sin_spread);
    if (half + spread >= PI / 2)
        return false;
    return along < -distance * sin(half + spread);
}

double mni_lens_priority(const mni_lens *lens, const mni_bounds *node) {
    double error_px = mni_lens_error_px(lens, node);
    if (!mni_lens_inside(lens, node))
        error_px /= MNI_WANTED_OUTSIDE;
    if (mni_lens_away(lens, node))
        error_px /= MNI_WANTED_AWAY;
    return error_px;
}

bool mni_lens_wants(const mni_lens *lens, const mni_bounds *node) {
    double error_px = mni_lens_error_px(lens, node);
    if (error_px <= lens->tolerance_px) /* the tolerance only grows from here */
        return false;
    if (lens->tolerance_px < 0 ||
        error_px > lens->tolerance_px * (MNI_WANTED_OUTSIDE * MNI_WANTED_AWAY))
        return true;
    return mni_lens_priority(lens, node) > lens->tolerance_px;
}
