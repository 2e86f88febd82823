/* Writing path files (docs/paths.md): as a hand moves the camera, or as a path goes. Main thread.
 */
#ifndef METANODE_PATH_RECORD_H
#define METANODE_PATH_RECORD_H

#include <stdio.h>

#include "metanode/runtime.h"

/* Zeroed: nothing written yet. A camera that stands is two keys, when it came and when it left, so
 * that it stands in between when it is replayed, too. */
typedef struct path_record {
    FILE *file; /* the caller's */
    bool begun;
    uint32_t frame, seen; /* of the last key; the last at which its camera still stood */
    mn_camera camera;     /* the last key's */
} path_record;

/* The camera at a frame, which never falls. Of several at one frame the first counts. */
void path_record_camera(path_record *r, uint32_t frame, const mn_camera *camera);
/* The last one: it is written in any case. */
void path_record_end(path_record *r, uint32_t frame, const mn_camera *camera);

/* A path as a file of that many frames: each `every`th is a key, and the last. */
mn_code path_record_all(const mn_path *path, uint32_t frames, uint64_t every, const char *name,
                        mn_status *st);

#endif
