/* replay --reference: the same frames with everything resident, drawn by another process, whose
 * memory is not that of the run that is measured. Main thread only. */
#ifndef METANODE_REFERENCE_H
#define METANODE_REFERENCE_H

#include <sys/types.h>

#include "metanode/gl.h"

typedef struct reference { /* zeroed: closed */
    pid_t child;
    int socket;
    size_t picture_bytes; /* RGB8 */
} reference;

/* Before anything that a second process should not have: threads, a session, a driver. Waits until
 * the other has read the file. from_settled: as of replay --open. */
mn_code reference_open(reference *r, const mn_session_desc *desc, const mn_path *path,
                       uint32_t frames, bool from_settled, mn_status *st);
/* How alike the picture of a frame, width × height × RGB8 of the desc, is to the reference's.
 * Frames rise from call to call; those between are navigated, too. Waits for the other to draw. */
mn_code reference_compare(reference *r, uint32_t frame, const uint8_t *rgb, mn_likeness *out,
                          mn_status *st);
void reference_close(reference *r);

#endif
