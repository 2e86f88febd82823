/* The paths a camera can take: formulas from the header's bounds and dive point, or a file.
 *
 * Hides: the formulas (docs/paths.md gives them); files are path_keys.c's. A camera is a pure
 * function of path, frame and number of frames, the same on every machine: sine, cosine and
 * exponential are our own series, since those of the C libraries differ in the last bit.
 *
 * Order of calls: open, camera as often as wanted, close. A path is const after open: any thread.
 * Memory: one block, and a file's keys, freed by close. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mn_assert.h"
#include "metanode/runtime.h"
#include "path_keys.h"

typedef enum path_kind { PATH_ORBIT, PATH_DIVE, PATH_FLYOVER, PATH_FILE } path_kind;

struct mn_path {
    path_kind kind;
    double center[3], half[3], radius; /* of the bounding box; radius: half its diagonal */
    double dive_point[3], dive_normal[3];
    float fov_y_deg;
    mni_path_keys keys; /* of a file */
};

/* ---- our own elementary functions ------------------------------------------------------------ */

/* Cosine and sine of `turn` full turns, to a few 1e-16: Taylor series on an eighth of a turn. */
static void turn_to(double turn, double *cosine, double *sine) {
    turn -= floor(turn);
    int quarter = (int)floor(turn * 4 + 0.5); /* 0 … 4 */
    double x = (turn - quarter * 0.25) * 6.283185307179586476925;
    double c = 1, s = x, term_c = 1, term_s = x;
    for (int i = 1; i <= 10; i++) {
        term_c *= -x * x / ((2 * i - 1) * (2 * i));
        term_s *= -x * x / ((2 * i) * (2 * i + 1));
        c += term_c;
        s += term_s;
    }
    static const int sign_c[4] = {1, 0, -1, 0}, sign_s[4] = {0, 1, 0, -1};
    int q = quarter & 3;
    *cosine = sign_c[q] * c - sign_s[q] * s;
    *sine = sign_s[q] * c + sign_c[q] * s;
}

/* e^x for |x| < 16: the series of x / 64, squared six times. */
static double exponential(double x) {
    double y = x / 64, sum = 1, term = 1;
    for (int i = 1; i <= 16; i++) {
        term *= y / i;
        sum += term;
    }
    for (int i = 0; i < 6; i++)
        sum *= sum;
    return sum;
}

/* ---- the formulas ---------------------------------------------------------------------------- */

static void place(mn_camera *out, const double eye[3], const double target[3], const double up[3]) {
    for (int i = 0; i < 3; i++) {
        out->eye[i] = (float)eye[i];
        out->target[i] = (float)target[i];
        out->up[i] = (float)up[i];
    }
}

static void orbit(const mn_path *path, double t, mn_camera *out) {
    double c, s, rise_c, rise_s;
    turn_to(t, &c, &s);
    turn_to(1.0 / 24, &rise_c, &rise_s); /* 15 degrees above the equator */
    double direction[3] = {s * rise_c, rise_s, c * rise_c}, eye[3];
    for (int i = 0; i < 3; i++)
        eye[i] = path->center[i] + 2 * path->radius * direction[i];
    place(out, eye, path->center, (double[3]){0, 1, 0});
}

static void dive(const mn_path *path, double t, mn_camera *out) {
    double down = 1 - fabs(2 * t - 1); /* 0 at both ends, 1 in the middle */
    double height = 4 * path->radius * exponential(-5.298317366548036 * down); /* ln 200 */
    double eye[3];
    for (int i = 0; i < 3; i++)
        eye[i] = path->dive_point[i] + height * path->dive_normal[i];
    bool steep = fabs(path->dive_normal[1]) > 0.9;
    place(out, eye, path->dive_point, steep ? (double[3]){0, 0, -1} : (double[3]){0, 1, 0});
}

static void flyover(const mn_path *path, double t, mn_camera *out) {
    int along = path->half[0] >= path->half[2] ? 0 : 2;
    double eye[3] = {path->center[0], path->center[1] + path->half[1] + 0.15 * path->radius,
                     path->center[2]};
    eye[along] += (1.75 * t - 1.25) * path->half[along]; /* the model stays ahead */
    double target[3] = {eye[0], eye[1] - 0.4 * path->radius, eye[2]};
    target[along] += path->radius;
    place(out, eye, target, (double[3]){0, 1, 0});
}

/* The frame of the recording that is frame f of F: (N - 1) f / (F - 1), exact where F is N. */
static double recorded_frame(const mn_path *path, uint32_t frame, uint32_t frames) {
    const double last = (double)mni_path_keys_last(&path->keys);
    if (frames == 1)
        return 0;
    return frame < frames ? last * (double)frame / (double)(frames - 1) : last;
}

void mn_path_camera(const mn_path *path, uint32_t frame, uint32_t frames, mn_camera *out) {
    MN_ASSERT(frames > 0);
    double last = frames > 1 ? (double)(frames - 1) : 1;
    double t = frame < frames ? (double)frame / last : 1;
    out->fov_y_deg = path->fov_y_deg;
    switch (path->kind) {
    case PATH_ORBIT: /* once round: frame `frames` would be frame 0 again */
        orbit(path, (double)(frame % frames) / frames, out);
        break;
    case PATH_DIVE:
        dive(path, t, out);
        break;
    case PATH_FLYOVER:
        flyover(path, t, out);
        break;
    case PATH_FILE:
        mni_path_keys_at(&path->keys, recorded_frame(path, frame, frames), out);
        break;
    }
}

uint32_t mn_path_frames(const mn_path *path) {
    return path->kind == PATH_FILE ? mni_path_keys_last(&path->keys) + 1 : 0;
}

uint64_t mn_path_bytes(const mn_path *path) {
    return sizeof *path + path->keys.room * (uint64_t)(sizeof(uint32_t) + sizeof(mn_camera));
}

/* ---- open and close -------------------------------------------------------------------------- */

mn_code mn_path_open(const char *name, const mn_header *header, float fov_y_deg, mn_path **out,
                     mn_status *st) {
    static const char *const names[] = {"orbit", "dive", "flyover"};
    *out = NULL;
    mn_path *path = calloc(1, sizeof *path);
    if (path == NULL)
        return mn_fail(st, MN_FAILED, "no memory for a path");
    path->kind = PATH_FILE;
    path->fov_y_deg = fov_y_deg;
    double square = 0;
    for (int i = 0; i < 3; i++) {
        path->center[i] = 0.5 * ((double)header->box_min[i] + (double)header->box_max[i]);
        path->half[i] = 0.5 * ((double)header->box_max[i] - (double)header->box_min[i]);
        path->dive_point[i] = header->dive_point[i];
        path->dive_normal[i] = header->dive_normal[i];
        square += path->half[i] * path->half[i];
    }
    path->radius = square > 0 ? sqrt(square) : 1;
    for (int i = 0; i < 3; i++)
        if (strcmp(name, names[i]) == 0)
            path->kind = (path_kind)i;
    mn_code code =
        path->kind == PATH_FILE ? mni_path_keys_read(name, fov_y_deg, &path->keys, st) : MN_OK;
    if (code == MN_OK)
        *out = path;
    else
        mn_path_close(path);
    return code;
}

void mn_path_close(mn_path *path) {
    if (path == NULL)
        return;
    mni_path_keys_free(&path->keys);
    free(path);
}
