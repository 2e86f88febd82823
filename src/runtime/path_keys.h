/* Path files: cameras at key frames, and the curve through them. See path_keys.c. */
#ifndef MNI_PATH_KEYS_H
#define MNI_PATH_KEYS_H

#include "metanode/runtime.h"

/* Const after read. Frames rise from key to key; the first is frame 0. */
typedef struct mni_path_keys {
    uint32_t count, room;
    uint32_t *frame;
    mn_camera *camera;
} mni_path_keys;

/* fov_y_deg: of keys that give none. *keys: zeroed before; freed by mni_path_keys_free, also after
 * a failure. MN_BAD_INPUT names the line. */
mn_code mni_path_keys_read(const char *name, float fov_y_deg, mni_path_keys *keys, mn_status *st);
void mni_path_keys_free(mni_path_keys *keys);

/* The camera at a frame number, whole or not, 0 … the last key's. Of a key: that key's, exactly. */
void mni_path_keys_at(const mni_path_keys *keys, double frame, mn_camera *out);
uint32_t mni_path_keys_last(const mni_path_keys *keys); /* its frame */

#endif
