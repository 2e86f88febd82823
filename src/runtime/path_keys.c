/* Path files: cameras at key frames, and the curve through them.
 *
 * Hides: the file's text, and what lies between two keys. docs/paths.md gives both.
 *
 * The curve is a cubic in the frame number for each of the ten numbers of a camera, with Fritsch
 * and Butland's slopes (as in PCHIP: a weighted harmonic mean of the two differences around a key,
 * 0 where they disagree in sign). It passes through the keys, its derivative is continuous, and
 * between two keys no number leaves their range: a camera that stands stands, an eye above the
 * ground stays above it, an angle of view is one. A parabola's slopes would be rounder and promise
 * none of that.
 *
 * Slopes are found from four keys when they are asked for, not kept: a key takes 44 bytes.
 * Only + - × ÷ and square roots of doubles: the same on every machine.
 *
 * Order of calls: read, then at, as often as wanted, then free. Const after read: any thread. */
#include "path_keys.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "mn_assert.h"

enum {
    FRAMES_MAX = 1000000000,
    LINE_BYTES_MAX = 1024,
    NUMBERS = 10, /* of a camera */
};
#define COORDINATE_MAX 1e15f /* whose square is a float, and whose cube a double */

static const char MAGIC[] = "metanode path ";

/* ---- between keys ---------------------------------------------------------------------------- */

/* A camera's numbers as an array. */
_Static_assert(sizeof(mn_camera) == NUMBERS * sizeof(float), "a camera is ten floats");

static double number_of(const mni_path_keys *k, uint32_t key, int i) {
    const mn_camera *c = &k->camera[key];
    const float *const part[] = {c->eye, c->target, c->up, &c->fov_y_deg};
    return (double)part[i / 3][i % 3];
}

/* Difference a frame between a key and the next. */
static double secant(const mni_path_keys *k, uint32_t key, int i) {
    return (number_of(k, key + 1, i) - number_of(k, key, i)) /
           (double)(k->frame[key + 1] - k->frame[key]);
}

/* At an end: the slope of the parabola through three keys, held to what keeps the curve within
 * them. near, far: differences; a, b: lengths of the two intervals. */
static double end_slope(double near, double far, double a, double b) {
    const double slope = ((2 * a + b) * near - a * far) / (a + b);
    if (slope * near <= 0)
        return 0;
    if (near * far <= 0 && fabs(slope) > 3 * fabs(near))
        return 3 * near;
    return slope;
}

static double slope(const mni_path_keys *k, uint32_t key, int i) {
    const uint32_t last = k->count - 1;
    if (last == 1)
        return secant(k, 0, i);
    const uint32_t middle = key == 0 ? 1 : key == last ? last - 1 : key;
    const double before = secant(k, middle - 1, i), after = secant(k, middle, i);
    const double a = (double)(k->frame[middle] - k->frame[middle - 1]);
    const double b = (double)(k->frame[middle + 1] - k->frame[middle]);
    if (key == 0)
        return end_slope(before, after, a, b);
    if (key == last)
        return end_slope(after, before, b, a);
    if (before * after <= 0)
        return 0;
    return 3 * (a + b) / ((2 * b + a) / before + (b + 2 * a) / after);
}

/* Hermite's cubic between key and the next; t: 0 … 1. */
static double cubic(const mni_path_keys *k, uint32_t key, int i, double t) {
    const double from = number_of(k, key, i), to = number_of(k, key + 1, i);
    if (from == to)
        return from; /* both slopes are 0 */
    const double length = (double)(k->frame[key + 1] - k->frame[key]), u = 1 - t;
    const double value = from + t * t * (3 - 2 * t) * (to - from) +
                         length * t * u * (u * slope(k, key, i) - t * slope(k, key + 1, i));
    return fmin(fmax(value, fmin(from, to)), fmax(from, to)); /* it is, but for rounding */
}

/* The last key at or before a frame. */
static uint32_t key_before(const mni_path_keys *k, double frame) {
    uint32_t low = 0, high = k->count; /* frame[low] <= frame < frame[high] */
    while (high - low > 1) {
        const uint32_t middle = low + (high - low) / 2;
        if ((double)k->frame[middle] <= frame)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static bool make_unit(float v[3]) {
    const double x = (double)v[0], y = (double)v[1], z = (double)v[2];
    const double length = sqrt(x * x + y * y + z * z);
    if (!(length > 1e-9))
        return false;
    v[0] = (float)(x / length);
    v[1] = (float)(y / length);
    v[2] = (float)(z / length);
    return true;
}

void mni_path_keys_at(const mni_path_keys *k, double frame, mn_camera *out) {
    MN_ASSERT(k->count > 0 && frame >= 0);
    const uint32_t key = key_before(k, frame);
    *out = k->camera[key];
    if (frame == (double)k->frame[key] || key + 1 == k->count)
        return;
    const double t = (frame - (double)k->frame[key]) / (double)(k->frame[key + 1] - k->frame[key]);
    float *const part[] = {out->eye, out->target, out->up, &out->fov_y_deg};
    for (int i = 0; i < NUMBERS; i++)
        part[i / 3][i % 3] = (float)cubic(k, key, i, t);
    if (!make_unit(out->up)) /* it turns over: no direction is better than the last */
        memcpy(out->up, k->camera[key].up, sizeof out->up);
}

uint32_t mni_path_keys_last(const mni_path_keys *k) {
    return k->frame[k->count - 1];
}

/* ---- text ------------------------------------------------------------------------------------ */

static bool is_blank(char c) {
    return c == ' ' || c == '\t';
}

static const char *skip_blanks(const char *at) {
    while (is_blank(*at))
        at++;
    return at;
}

static bool ends_word(char c) {
    return c == 0 || c == '#' || is_blank(c);
}

/* NULL: no frame number. */
static const char *parse_frame(const char *at, uint32_t *frame) {
    uint32_t value = 0;
    const char *from = at;
    for (; *at >= '0' && *at <= '9' && value < FRAMES_MAX / 10; at++)
        value = 10 * value + (uint32_t)(*at - '0');
    *frame = value;
    return at > from && ends_word(*at) ? at : NULL;
}

/* All numbers until the end or a comment; -1 and why. */
static int parse_numbers(const char *at, float v[NUMBERS], const char **why) {
    int n = 0;
    for (at = skip_blanks(at); *at != 0 && *at != '#'; at = skip_blanks(at)) {
        char *end;
        const float x = strtof(at, &end);
        if (end == at || !ends_word(*end) || !isfinite(x))
            *why = "not a finite number";
        else if (n == NUMBERS)
            *why = "more numbers than eye, target, up and angle of view";
        else if (fabsf(x) > COORDINATE_MAX)
            *why = "a number beyond 1e15";
        else
            *why = NULL;
        if (*why != NULL)
            return -1;
        v[n++] = x;
        at = end;
    }
    return n;
}

/* What is wrong with a camera; NULL: nothing. Makes up a unit vector. */
static const char *check_camera(mn_camera *c) {
    double along[3], up[3], length = 0;
    for (int i = 0; i < 3; i++) {
        along[i] = (double)c->target[i] - (double)c->eye[i];
        length += along[i] * along[i];
    }
    if (!(length > 0))
        return "eye and target are the same";
    if (!make_unit(c->up))
        return "up has no length";
    length = sqrt(length);
    for (int i = 0; i < 3; i++)
        up[i] = (double)c->up[i];
    const double x = along[1] * up[2] - along[2] * up[1], y = along[2] * up[0] - along[0] * up[2],
                 z = along[0] * up[1] - along[1] * up[0];
    if (!(sqrt(x * x + y * y + z * z) > 1e-6 * length))
        return "up lies along the line of sight";
    if (!(c->fov_y_deg >= 1 && c->fov_y_deg <= 170))
        return "angle of view outside 1 ... 170 degrees";
    return NULL;
}

/* A line that is no comment. *frame: the one after the last; of version 2, replaced. */
static const char *parse_key(const char *at, int version, float fov_y_deg, uint32_t *frame,
                             mn_camera *out) {
    float v[NUMBERS];
    const char *why;
    if (version > 1 && (at = parse_frame(at, frame)) == NULL)
        return "it must begin with a frame number, 0 ... 999999999";
    const int n = parse_numbers(at, v, &why);
    if (n < 0)
        return why;
    if (n < NUMBERS - 1)
        return "fewer than 9 numbers: eye x y z, target x y z, up x y z and, if wanted, the angle "
               "of view";
    memcpy(out->eye, v, sizeof out->eye);
    memcpy(out->target, v + 3, sizeof out->target);
    memcpy(out->up, v + 6, sizeof out->up);
    out->fov_y_deg = n == NUMBERS ? v[NUMBERS - 1] : fov_y_deg;
    return check_camera(out);
}

static const char *keep(mni_path_keys *k, uint32_t frame, const mn_camera *camera) {
    if (k->count == 0 && frame != 0)
        return "the first key must be that of frame 0";
    if (k->count > 0 && frame <= k->frame[k->count - 1])
        return "its frame is not after that of the key before";
    if (k->count == MN_PATH_KEYS_MAX)
        return "more than 1500000 keys";
    if (k->count == k->room) {
        const uint32_t room = k->room > 0 ? k->room + k->room / 2 : 256;
        uint32_t *frames = realloc(k->frame, room * sizeof *frames);
        if (frames != NULL)
            k->frame = frames;
        mn_camera *cameras = realloc(k->camera, room * sizeof *cameras);
        if (cameras != NULL)
            k->camera = cameras;
        if (frames == NULL || cameras == NULL)
            return "no memory for so many keys";
        k->room = room;
    }
    k->frame[k->count] = frame;
    k->camera[k->count++] = *camera;
    return NULL;
}

/* 1, 2; 0: another text. */
static int version_of(const char *line) {
    const size_t n = sizeof MAGIC - 1;
    if (strncmp(line, MAGIC, n) != 0 || (line[n] != '1' && line[n] != '2') ||
        *skip_blanks(line + n + 1) != 0)
        return 0;
    return line[n] - '0';
}

/* A line without its end. false: the file's end. *why: it is no line of text. */
static bool next_line(FILE *f, char line[LINE_BYTES_MAX], const char **why) {
    size_t n = 0;
    int c = getc(f);
    if (c == EOF)
        return false;
    *why = NULL;
    for (; c != EOF && c != '\n' && *why == NULL; c = getc(f)) {
        if (n + 1 == LINE_BYTES_MAX)
            *why = "longer than 1023 bytes";
        else if (c < ' ' && c != '\t' && c != '\r')
            *why = "a control character: no text file";
        else
            line[n++] = (char)c;
    }
    if (n > 0 && line[n - 1] == '\r')
        n--;
    line[n] = 0;
    return true;
}

static mn_code read_lines(FILE *f, const char *name, float fov_y_deg, mni_path_keys *k,
                          mn_status *st) {
    char line[LINE_BYTES_MAX];
    const char *why;
    int version = 0;
    for (uint64_t number = 1; next_line(f, line, &why); number++) {
        const char *at = skip_blanks(line);
        if (why == NULL && number == 1) {
            version = version_of(line);
            if (version == 0)
                why = "not a path file: it must begin with 'metanode path 2'";
        } else if (why == NULL && *at != 0 && *at != '#') {
            uint32_t frame = k->count;
            mn_camera camera;
            why = parse_key(at, version, fov_y_deg, &frame, &camera);
            if (why == NULL)
                why = keep(k, frame, &camera);
        }
        if (why != NULL)
            return mn_fail(st, MN_BAD_INPUT, "%s: line %llu: %s", name, (unsigned long long)number,
                           why);
    }
    if (ferror(f))
        return mn_fail(st, MN_FAILED, "%s: cannot be read: %s", name, strerror(errno));
    if (k->count == 0)
        return mn_fail(st, MN_BAD_INPUT, "%s: %s", name,
                       version == 0 ? "empty, not a path file" : "holds no camera");
    return MN_OK;
}

mn_code mni_path_keys_read(const char *name, float fov_y_deg, mni_path_keys *k, mn_status *st) {
    struct stat info;
    if (stat(name, &info) == 0 && !S_ISREG(info.st_mode)) /* a fifo would be waited for */
        return mn_fail(st, MN_BAD_INPUT, "--path %s: not a file; give the name of a regular file",
                       name);
    FILE *f = fopen(name, "re");
    if (f == NULL)
        return mn_fail(st, errno == ENOENT ? MN_USAGE : MN_FAILED,
                       "--path %s: neither orbit, dive nor flyover, and no file: %s", name,
                       strerror(errno));
    mn_code code = read_lines(f, name, fov_y_deg, k, st);
    fclose(f);
    return code;
}

void mni_path_keys_free(mni_path_keys *k) {
    free(k->camera);
    free(k->frame);
    *k = (mni_path_keys){0};
}

/* ---- writing --------------------------------------------------------------------------------- */

const char mn_path_heading[] =
    "metanode path 2\n"
    "# frame  eye x y z  target x y z  up x y z  vertical angle of view in degrees\n";

int mn_path_line(char line[MN_PATH_LINE_BYTES], uint32_t frame, const mn_camera *c) {
    return snprintf(line, MN_PATH_LINE_BYTES,
                    "%u  %.9g %.9g %.9g  %.9g %.9g %.9g  %.9g %.9g %.9g  %.9g\n", frame,
                    (double)c->eye[0], (double)c->eye[1], (double)c->eye[2], (double)c->target[0],
                    (double)c->target[1], (double)c->target[2], (double)c->up[0], (double)c->up[1],
                    (double)c->up[2], (double)c->fov_y_deg);
}
