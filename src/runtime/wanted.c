/* What a camera wants of the tree.
 *
 * Hides: how a length becomes pixels, and what frustum, normal cones and light do to the tolerance.
 * A node is wanted split when its switch value, seen at the nearest point of its bounding sphere
 * and times its weight, exceeds the tolerance. A weight below 1 is a tolerance that has grown:
 *
 *     outside the frustum                 1 / 16   detail that a turn of the head would show is
 * near, all normals face away               1 / 8    and yet not paid in full else the larger of
 *       silhouettes (off)                 F × sine of the widest angle between normal and eye: a
 *                                         shift of the surface along its normal shows by that
 *                                         (Hoppe 97: |n × v|), and 1 at least
 *       light (off)                       1 + (F - 1) × difference of the light on the cone's
 * normals (Xia, El-Sana and Varshney 97)
 *
 * Nested: switch values, spheres and cones of a node enclose those of its children, so a child is
 * never wanted where its parent is not. Each step keeps that: the nearest point of a sphere inside
 * another is no nearer, a sphere inside one that is outside the frustum is outside, and a cone
 * inside one that faces away, over a smaller sphere, faces away. The last two weights are a
 * supremum, or a range, over the pairs of a normal of the cone and a point of the sphere: of fewer
 * pairs neither is larger. A node that faces away weighs less than any that does not, so it cannot
 * outweigh a parent that does not face away. Radii are rounded upwards as floats; here all is
 * computed in double, whose rounding is 1e-8 of that slack.
 *
 * Pure functions; any thread; no memory. Paper: §3.3.1 (switch and metric values). */
#include "wanted.h"

#include <math.h>
#include <string.h>

#include "mn_assert.h"

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

static double factor(float given, double otherwise) {
    MN_ASSERT(given == 0 || given >= 1);
    return given > 0 ? (double)given : otherwise;
}

/* back: away from where the camera looks. */
static void weigh(mni_lens *lens, const mn_weights *w, const double right[3], const double up[3],
                  const double back[3]) {
    static const double key[3] = {MN_LIGHT_KEY};
    lens->outside = factor(w->outside, MNI_WANTED_OUTSIDE);
    lens->away = factor(w->away, MNI_WANTED_AWAY);
    lens->silhouette = factor(w->silhouette, 1);
    lens->light = factor(w->light, 1);
    lens->most = fmax(lens->silhouette, lens->light);
    double from[3] = {w->light_from[0], w->light_from[1], w->light_from[2]};
    if (!unit(from))
        memcpy(from, key, sizeof from);
    for (int i = 0; i < 3; i++)
        lens->light_from[i] = from[0] * right[i] + from[1] * up[i] + from[2] * back[i];
    (void)unit(lens->light_from);
}

void mni_lens_make(mni_lens *lens, const mn_camera *camera, uint32_t width_px, uint32_t height_px,
                   double distance_min, double tolerance_px, const mn_weights *weights) {
    static const mn_weights defaults = {0};
    MN_ASSERT(width_px > 0 && height_px > 0 && distance_min > 0);
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
    lens->distance_min = distance_min;
    lens->tolerance_px = tolerance_px;
    const double back[3] = {-forward[0], -forward[1], -forward[2]};
    weigh(lens, weights != NULL ? weights : &defaults, right, up, back);
}

static double distance_to(const mni_lens *lens, const float position[3]) {
    double d[3] = {lens->eye[0] - position[0], lens->eye[1] - position[1],
                   lens->eye[2] - position[2]};
    return sqrt(dot(d, d));
}

double mni_lens_to_sphere(const mni_lens *lens, const mni_bounds *node) {
    return distance_to(lens, node->position) - (double)node->radius;
}

double mni_lens_nearest(const mni_lens *lens, const mni_bounds *node) {
    double nearest = mni_lens_to_sphere(lens, node);
    return nearest < lens->distance_min ? lens->distance_min : nearest;
}

double mni_lens_error_px(const mni_lens *lens, const mni_bounds *node) {
    return lens->scale_px * (double)node->switch_value / mni_lens_nearest(lens, node);
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

/* The angle between the axis of the cone and a direction, of length `length`. */
static double angle_to(mn_cone cone, const double direction[3], double length) {
    float axis[3];
    mn_cone_axis(cone, axis);
    double along = 0;
    for (int i = 0; i < 3; i++)
        along += (double)axis[i] * direction[i];
    return acos(fmax(-1, fmin(1, along / length)));
}

double mni_lens_grazing(const mni_lens *lens, const mni_bounds *node) {
    double distance = distance_to(lens, node->position), radius = node->radius;
    if (distance <= radius)
        return 1;
    double to_eye[3];
    for (int i = 0; i < 3; i++)
        to_eye[i] = lens->eye[i] - (double)node->position[i];
    double widest = angle_to(node->cone, to_eye, distance) + asin(radius / distance) +
                    (double)mn_cone_half_angle(node->cone);
    return widest < PI / 2 ? sin(widest) : 1;
}

double mni_lens_contrast(const mni_lens *lens, const mni_bounds *node) {
    double half = mn_cone_half_angle(node->cone), angle = angle_to(node->cone, lens->light_from, 1);
    double brightest = cos(fmax(angle - half, 0)), darkest = cos(fmin(angle + half, PI));
    return fmax(brightest, 0) - fmax(darkest, 0);
}

/* Of a node that does not face away, but for the frustum: 1 and more. */
static double tightening(const mni_lens *lens, const mni_bounds *node) {
    double weight = 1;
    if (lens->silhouette > 1)
        weight = fmax(weight, lens->silhouette * mni_lens_grazing(lens, node));
    if (lens->light > 1)
        weight = fmax(weight, 1 + (lens->light - 1) * mni_lens_contrast(lens, node));
    return weight;
}

double mni_lens_priority(const mni_lens *lens, const mni_bounds *node) {
    double error_px = mni_lens_error_px(lens, node);
    if (lens->outside > 1 && !mni_lens_inside(lens, node))
        error_px /= lens->outside;
    if ((lens->away > 1 || mni_lens_tightens(lens)) && mni_lens_away(lens, node))
        return error_px / lens->away;
    return mni_lens_tightens(lens) ? error_px * tightening(lens, node) : error_px;
}

bool mni_lens_wants(const mni_lens *lens, const mni_bounds *node) {
    double error_px = mni_lens_error_px(lens, node);
    if (error_px * lens->most <= lens->tolerance_px)
        return false;
    if (lens->tolerance_px < 0 || error_px > lens->tolerance_px * (lens->outside * lens->away))
        return true;
    return mni_lens_priority(lens, node) > lens->tolerance_px;
}
