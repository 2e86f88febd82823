/* The paths a camera can take: formulas from the header's bounds and dive point, or a file.
 *
 * Hides: the formulas (docs/paths.md gives them) and the file's text. A camera is a pure function
 * of path, frame and number of frames, the same on every machine: sine, cosine and exponential are
 * our own series, since those of the C libraries differ in the last bit.
 *
 * Order of calls: open, camera as often as wanted, close. A path is const after open: any thread.
 * Memory: one block, freed by close; a path file's cameras are 40 bytes a frame, at most 64 MB. */
#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "assert.h"
#include "metanode/runtime.h"

enum { FRAMES_MAX = 1600000, LINE_BYTES_MAX = 1024 };
static const char MAGIC[] = "metanode path 1";

typedef enum path_kind { PATH_ORBIT, PATH_DIVE, PATH_FLYOVER, PATH_FILE } path_kind;

struct mn_path {
    path_kind kind;
    double center[3], half[3], radius; /* of the bounding box; radius: half its diagonal */
    double dive_point[3], dive_normal[3];
    float fov_y_deg;
    uint32_t frames; /* of a file */
    uint32_t frames_room;
    mn_camera *camera;
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

/* Straight lines between the recorded cameras. */
static void recorded(const mn_path *path, double t, mn_camera *out) {
    double at = t * (path->frames - 1);
    uint32_t i = (uint32_t)at;
    if (i + 1 >= path->frames) {
        *out = path->camera[path->frames - 1];
        return;
    }
    const mn_camera *a = &path->camera[i], *b = a + 1;
    float f = (float)(at - i);
    for (int k = 0; k < 3; k++) {
        out->eye[k] = a->eye[k] + f * (b->eye[k] - a->eye[k]);
        out->target[k] = a->target[k] + f * (b->target[k] - a->target[k]);
        out->up[k] = a->up[k] + f * (b->up[k] - a->up[k]);
    }
    out->fov_y_deg = a->fov_y_deg + f * (b->fov_y_deg - a->fov_y_deg);
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
        recorded(path, t, out);
        break;
    }
}

uint32_t mn_path_frames(const mn_path *path) {
    return path->kind == PATH_FILE ? path->frames : 0;
}

/* ---- path files ------------------------------------------------------------------------------ */

/* Nine or ten finite numbers. false: why. */
static bool parse_camera(const char *line, float fov_y_deg, mn_camera *out, const char **why) {
    float v[10];
    int n = 0;
    for (const char *at = line;; n++) {
        while (isspace((unsigned char)*at))
            at++;
        if (*at == 0 || *at == '#')
            break;
        char *end;
        float x = strtof(at, &end);
        if (end == at || n == 10 || !isfinite(x)) {
            *why = n == 10 ? "more than 10 numbers" : "not a finite number";
            return false;
        }
        v[n] = x;
        at = end;
    }
    if (n != 9 && n != 10) {
        *why = "9 or 10 numbers expected: eye, target, up and, if wanted, the angle of view";
        return false;
    }
    memcpy(out->eye, v, sizeof out->eye);
    memcpy(out->target, v + 3, sizeof out->target);
    memcpy(out->up, v + 6, sizeof out->up);
    out->fov_y_deg = n == 10 ? v[9] : fov_y_deg;
    bool stands = v[0] == v[3] && v[1] == v[4] && v[2] == v[5];
    if (stands || !(out->fov_y_deg >= 1 && out->fov_y_deg <= 170)) {
        *why = stands ? "eye and target are the same" : "angle of view outside 1 … 170 degrees";
        return false;
    }
    return true;
}

static bool keep(mn_path *path, const mn_camera *camera) {
    if (path->frames == path->frames_room) {
        uint32_t room = path->frames_room ? path->frames_room * 2 : 256;
        mn_camera *more = realloc(path->camera, room * sizeof *more);
        if (more == NULL)
            return false;
        path->camera = more;
        path->frames_room = room;
    }
    path->camera[path->frames++] = *camera;
    return true;
}

static mn_code read_lines(FILE *f, const char *name, mn_path *path, mn_status *st) {
    char line[LINE_BYTES_MAX];
    for (uint32_t number = 1; fgets(line, sizeof line, f) != NULL; number++) {
        size_t length = strlen(line);
        if (length + 1 == sizeof line && line[length - 1] != '\n')
            return mn_fail(st, MN_BAD_INPUT, "%s: line %u: longer than %d bytes", name, number,
                           LINE_BYTES_MAX);
        line[strcspn(line, "\r\n")] = 0;
        if (number == 1) {
            if (strcmp(line, MAGIC) != 0)
                return mn_fail(st, MN_BAD_INPUT,
                               "%s: line 1: not a path file: it must begin with '%s'", name, MAGIC);
            continue;
        }
        const char *at = line + strspn(line, " \t"), *why;
        if (*at == 0 || *at == '#')
            continue;
        mn_camera camera;
        if (!parse_camera(at, path->fov_y_deg, &camera, &why))
            return mn_fail(st, MN_BAD_INPUT, "%s: line %u: %s", name, number, why);
        if (path->frames == FRAMES_MAX)
            return mn_fail(st, MN_BAD_INPUT, "%s: line %u: more than %d frames", name, number,
                           FRAMES_MAX);
        if (!keep(path, &camera))
            return mn_fail(st, MN_FAILED, "%s: no memory for its cameras", name);
    }
    if (ferror(f))
        return mn_fail(st, MN_FAILED, "%s: cannot be read: %s", name, strerror(errno));
    if (path->frames == 0)
        return mn_fail(st, MN_BAD_INPUT, "%s: holds no camera", name);
    return MN_OK;
}

static mn_code read_file(const char *name, mn_path *path, mn_status *st) {
    struct stat info;
    if (stat(name, &info) == 0 && !S_ISREG(info.st_mode)) /* a fifo would be waited for */
        return mn_fail(st, MN_BAD_INPUT, "--path %s: not a file; give the name of a regular file",
                       name);
    FILE *f = fopen(name, "re");
    if (f == NULL)
        return mn_fail(st, errno == ENOENT ? MN_USAGE : MN_FAILED,
                       "--path %s: neither orbit, dive nor flyover, and no file: %s", name,
                       strerror(errno));
    mn_code code = read_lines(f, name, path, st);
    fclose(f);
    return code;
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
    mn_code code = path->kind == PATH_FILE ? read_file(name, path, st) : MN_OK;
    if (code == MN_OK)
        *out = path;
    else
        mn_path_close(path);
    return code;
}

void mn_path_close(mn_path *path) {
    if (path == NULL)
        return;
    free(path->camera);
    free(path);
}
