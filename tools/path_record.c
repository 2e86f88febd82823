/* See path_record.h. Hides which of the cameras become keys. */
#include "path_record.h"

#include <string.h>

#include "output.h"

static void key(path_record *r, uint32_t frame, const mn_camera *camera) {
    char line[MN_PATH_LINE_BYTES];
    if (!r->begun)
        fputs(mn_path_heading, r->file);
    mn_path_line(line, frame, camera);
    fputs(line, r->file);
    r->begun = true;
    r->frame = r->seen = frame;
    r->camera = *camera;
}

void path_record_camera(path_record *r, uint32_t frame, const mn_camera *camera) {
    if (!r->begun) {
        key(r, 0, camera);
        return;
    }
    if (memcmp(camera, &r->camera, sizeof *camera) == 0) {
        r->seen = frame;
        return;
    }
    const uint32_t stood = r->seen < frame ? r->seen : frame - 1;
    if (frame > 0 && stood > r->frame)
        key(r, stood, &r->camera);
    if (frame > r->frame)
        key(r, frame, camera);
}

void path_record_end(path_record *r, uint32_t frame, const mn_camera *camera) {
    path_record_camera(r, frame, camera);
    if (memcmp(camera, &r->camera, sizeof *camera) != 0)
        key(r, r->frame + 1, camera);
    else if (r->seen > r->frame)
        key(r, r->seen, camera);
}

mn_code path_record_all(const mn_path *path, uint32_t frames, uint64_t every, const char *name,
                        mn_status *st) {
    const uint64_t steps = frames - 1, keys = steps / every + (steps % every != 0) + 1;
    if (keys > MN_PATH_KEYS_MAX)
        return mn_fail(st, MN_USAGE,
                       "--write-path %s: %llu keys are more than the %d that a path file may have; "
                       "try --key-every %llu",
                       name, (unsigned long long)keys, MN_PATH_KEYS_MAX,
                       (unsigned long long)(steps / (MN_PATH_KEYS_MAX - 1) + 1));
    output out;
    mn_code code = output_open(&out, "--write-path", name, st);
    if (code != MN_OK)
        return code;
    fputs(mn_path_heading, out.file);
    for (uint64_t frame = 0; frame < frames && code == MN_OK;) {
        mn_camera camera;
        char line[MN_PATH_LINE_BYTES];
        mn_path_camera(path, (uint32_t)frame, frames, &camera);
        mn_path_line(line, (uint32_t)frame, &camera);
        fputs(line, out.file);
        code = output_good(&out, st);
        const uint64_t next = frame + every;
        frame = next > frames - 1 && frame < frames - 1 ? frames - 1 : next;
    }
    const mn_code closed = output_close(&out, code == MN_OK, st);
    return code != MN_OK ? code : closed;
}
