/* Files, whole: reading at a place, and writing so that a reader never sees half a file.
 *
 * Order: open, then read / write, then close, or commit, or abort. Each object belongs to one
 * thread at a time. Every call may block on the disk. Statuses name the file and what to do:
 * MN_NO_SPACE for a full disk or quota, MN_FAILED for other trouble. */
#ifndef MNI_FILE_H
#define MNI_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "metanode/status.h"

/* ---- reading ------------------------------------------------------------------------------- */

typedef struct mni_in {
    int fd; /* -1: closed */
    uint64_t size_bytes;
} mni_in;

/* Opens a regular file for reading. MN_BAD_INPUT: there is none, or it is a directory or device. */
mn_code mni_in_open(mni_in *in, const char *path, mn_status *st);
/* Bytes read at offset, less than asked only at the end of the file; -errno on error. Short reads
 * and EINTR are continued. */
int64_t mni_in_read(const mni_in *in, uint64_t offset, void *bytes, size_t count);
void mni_in_close(mni_in *in);

/* ---- writing ------------------------------------------------------------------------------- */

/* A file without a name, or where there are none with a temporary one, in the directory of its
 * final name. Copies path. After a failed call further ones do nothing and return the first
 * failure; abort is still due. */
typedef struct mni_out {
    int fd;              /* -1: closed */
    char *path, *temp;   /* final and temporary name */
    bool named;          /* the temporary name is in the directory */
    unsigned char *tail; /* appended, not yet written */
    size_t tail_bytes;
    uint64_t offset; /* of the tail in the file */
    mn_code failed;
} mni_out;

/* A path that is a symbolic link is followed; one that is a directory or device is refused. */
mn_code mni_out_open(mni_out *out, const char *path, mn_status *st);
/* Appends (buffered). */
mn_code mni_out_write(mni_out *out, const void *bytes, size_t count, mn_status *st);
/* Writes over what stands at offset, or beyond the end; the place for appending stays. */
mn_code mni_out_write_at(mni_out *out, uint64_t offset, const void *bytes, size_t count,
                         mn_status *st);
/* Reads what has been written, as mni_in_read. */
int64_t mni_out_read(const mni_out *out, uint64_t offset, void *bytes, size_t count);
/* What stands in [from, to) is not needed any more: the disk has its room back, where the file
 * system can do that; there are zeroes then. */
void mni_out_discard(mni_out *out, uint64_t from, uint64_t to);
/* Where the next append goes: the bytes appended so far. */
uint64_t mni_out_at(const mni_out *out);
/* Writes what is buffered, syncs, names it (by a rename where something stands), syncs the
 * directory. On failure nothing is left behind and what stood under the final name is untouched.
 * out is closed either way. */
mn_code mni_out_commit(mni_out *out, mn_status *st);
/* Removes the temporary file. Harmless after commit or abort, and on a zeroed struct. */
void mni_out_abort(mni_out *out);

#endif
